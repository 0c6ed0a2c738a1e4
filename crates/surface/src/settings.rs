//! How a surface is drawn.

use crate::error::SurfaceError;

/// How a surface is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceSettings {
    /// Side of a voxel, metres.
    pub voxel_m: f64,
    /// Standard deviation of a point across its surface near the sensor, metres, the error of its pose included; at most two voxels.
    pub noise_m: f64,
    /// How much the standard deviation grows with the square of the range, 1/m: 0 of lidars, 0.0019 of structured light (Nguyen, Izadi and Lovell 2012,
    /// "Modeling Kinect sensor noise", eq. 2), some 0.002 of stereo. What is seen from near counts for more.
    pub noise_per_m: f64,
    /// What is seen from here or nearer counts fully, metres, and what is farther by the inverse of its variance beside that: about where most points are, for
    /// a view counts as one of 31 steps at least and rays take away what counts for little.
    pub near_m: f64,
    /// Whether rays take away what they pass through: what moved, and noise.
    pub carve: bool,
    /// What the voxels may take, megabytes. What a [`crate::Surface`] keeps of each keyframe, some 36 bytes for each voxel that it sees a surface in, is beside it.
    pub memory_mb: u32,
}

impl Default for SurfaceSettings {
    fn default() -> Self {
        Self { voxel_m: 0.05, noise_m: 0.01, noise_per_m: 0.0, near_m: 0.0, carve: true, memory_mb: 4096 }
    }
}

/// A cell that the surface crosses reaches so far from it at most, voxels: its diagonal.
const CELL_REACH: f64 = 1.732_050_807_568_877_2;
/// A point is off its surface by so many standard deviations at most.
const NOISE_REACH: f64 = 3.0;
/// More noise than so many voxels would write whole blocks for each point, and belongs to larger voxels.
pub(crate) const NOISE_VOXELS: f64 = 2.0;

impl SurfaceSettings {
    /// Standard deviation of a point at a range, voxels, two at most; `range` is in voxels.
    pub(crate) fn noise_voxels(&self, range: f64) -> f64 {
        (self.noise_m / self.voxel_m + self.noise_per_m * self.voxel_m * range * range).min(NOISE_VOXELS)
    }

    /// Distances are known up to here on either side of a surface, metres, that is seen from a range, metres: the corners of every cell that the surface
    /// crosses, wherever noise puts it.
    #[must_use]
    pub fn truncation_m(&self, range_m: f64) -> f64 {
        truncation_voxels(self.noise_voxels(range_m / self.voxel_m)) * self.voxel_m
    }

    /// Whether they can be used.
    ///
    /// # Errors
    /// [`SurfaceError::Setting`] with the first that cannot be.
    pub fn validate(&self) -> Result<(), SurfaceError> {
        let check = |is_right: bool, name, expected, found| {
            if is_right { Ok(()) } else { Err(SurfaceError::Setting { name, expected, found }) }
        };
        let (voxel_m, noise_m) = (self.voxel_m, self.noise_m);
        check((1e-6..=1e6).contains(&voxel_m), "voxel_m", "0.000001 to 1000000 m", voxel_m)?;
        check((0.0..=NOISE_VOXELS * voxel_m).contains(&noise_m), "noise_m", "0 to two voxels", noise_m)?;
        check((0.0..=1.0).contains(&self.noise_per_m), "noise_per_m", "0 to 1 per m", self.noise_per_m)?;
        check((0.0..=1e6).contains(&self.near_m), "near_m", "0 to 1000000 m", self.near_m)?;
        check(self.memory_mb > 0, "memory_mb", "1 or more", 0.0)
    }
}

/// Of a standard deviation in voxels.
pub(crate) fn truncation_voxels(noise: f64) -> f64 {
    CELL_REACH + NOISE_REACH * noise
}
