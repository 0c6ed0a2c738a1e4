//! Clouds thinned by voxel.

use crate::key::{Key, key_of};
use rustc_hash::FxHashMap;

/// Thins clouds; keeps its buffers.
#[derive(Debug, Clone, Default)]
pub struct Thinner {
    seen: FxHashMap<Key, u32>,
    sums: Vec<Sum>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Sum {
    point: [f64; 3],
    colour: [u32; 3],
    count: u32,
}

impl Thinner {
    /// For each voxel of side `size_m` the mean of the points in it, in the order in which voxels are met first.
    pub fn thin(&mut self, points_m: &[[f32; 3]], size_m: f64, out: &mut Vec<[f32; 3]>) {
        self.gather(points_m, &[], size_m);
        out.clear();
        out.extend(self.sums.iter().map(Sum::mean));
    }

    /// The same with a colour for each point, if there are any.
    pub fn thin_coloured(
        &mut self,
        (points_m, colours): (&[[f32; 3]], &[[u8; 3]]),
        size_m: f64,
        (out, out_colours): (&mut Vec<[f32; 3]>, &mut Vec<[u8; 3]>),
    ) {
        self.gather(points_m, colours, size_m);
        out.clear();
        out.extend(self.sums.iter().map(Sum::mean));
        out_colours.clear();
        if !colours.is_empty() {
            out_colours.extend(self.sums.iter().map(|sum| sum.colour.map(|v| (v / sum.count) as u8)));
        }
    }

    fn gather(&mut self, points_m: &[[f32; 3]], colours: &[[u8; 3]], size_m: f64) {
        self.seen.clear();
        self.sums.clear();
        let per_m = 1.0 / size_m;
        for (number, point) in points_m.iter().enumerate() {
            let at = point.map(f64::from);
            let Some(key) = key_of(at.map(|v| v * per_m)) else { continue };
            let place = *self.seen.entry(key).or_insert_with(|| {
                self.sums.push(Sum::default());
                self.sums.len() as u32 - 1
            });
            let sum = &mut self.sums[place as usize];
            (0..3).for_each(|k| sum.point[k] += at[k]);
            if let Some(colour) = colours.get(number) {
                (0..3).for_each(|k| sum.colour[k] += u32::from(colour[k]));
            }
            sum.count += 1;
        }
    }
}

impl Sum {
    fn mean(&self) -> [f32; 3] {
        self.point.map(|v| (v / f64::from(self.count)) as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_voxel_keeps_the_mean_of_its_points_and_colours() {
        let points = [[0.1, 0.1, 0.1], [5.0, 0.0, 0.0], [0.3, 0.1, 0.1], [f32::NAN, 0.0, 0.0]];
        let colours = [[10, 0, 255], [1, 2, 3], [20, 0, 255], [0, 0, 0]];
        let (mut out, mut out_colours) = (Vec::new(), Vec::new());
        Thinner::default().thin_coloured((&points, &colours), 1.0, (&mut out, &mut out_colours));
        assert_eq!((out.len(), out_colours.as_slice()), (2, [[15, 0, 255], [1, 2, 3]].as_slice()));
        assert!((out[0][0] - 0.2).abs() < 1e-6);
    }
}
