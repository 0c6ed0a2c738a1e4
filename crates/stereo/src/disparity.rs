//! Maps of disparity.

/// The disparity of each pixel of the left image, and how far it may be off.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DisparityMap {
    width: u32,
    height: u32,
    pub(crate) disparity: Vec<f32>,
    pub(crate) sigma: Vec<f32>,
}

impl DisparityMap {
    /// Pixels across.
    #[must_use]
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Pixels down.
    #[must_use]
    pub fn height(&self) -> u32 {
        self.height
    }

    /// By how many pixels each pixel lies further right in the left image than in the right one, row by row; NaN where
    /// that is unknown.
    #[must_use]
    pub fn disparity(&self) -> &[f32] {
        &self.disparity
    }

    /// The standard deviation of each disparity, pixels; NaN where the disparity is unknown.
    #[must_use]
    pub fn sigma(&self) -> &[f32] {
        &self.sigma
    }

    /// Disparity and standard deviation of a pixel, where they are known.
    #[must_use]
    pub fn at(&self, x: u32, y: u32) -> Option<(f32, f32)> {
        if x >= self.width || y >= self.height {
            return None;
        }
        let at = y as usize * self.width as usize + x as usize;
        Some((self.disparity[at], self.sigma[at])).filter(|(disparity, _)| !disparity.is_nan())
    }

    /// The share of pixels whose disparity is known.
    #[must_use]
    pub fn density(&self) -> f64 {
        let known = self.disparity.iter().filter(|disparity| !disparity.is_nan()).count();
        known as f64 / self.disparity.len().max(1) as f64
    }

    /// Nothing is known of any pixel of an image of that size.
    pub(crate) fn reset(&mut self, [width, height]: [u32; 2]) {
        (self.width, self.height) = (width, height);
        let count = width as usize * height as usize;
        for values in [&mut self.disparity, &mut self.sigma] {
            values.clear();
            values.resize(count, f32::NAN);
        }
    }
}
