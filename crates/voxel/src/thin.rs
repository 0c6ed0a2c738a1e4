//! Clouds thinned by voxel.

use crate::key::{Key, key_of};
use rustc_hash::FxHashMap;

/// Thins clouds; keeps its buffers.
#[derive(Debug, Clone, Default)]
pub struct Thinner {
    seen: FxHashMap<Key, u32>,
    sums: Vec<([f64; 3], u32)>,
}

impl Thinner {
    /// For each voxel of side `size_m` the mean of the points in it, in the order in which voxels are met first.
    pub fn thin(&mut self, points_m: &[[f32; 3]], size_m: f64, out: &mut Vec<[f32; 3]>) {
        self.seen.clear();
        self.sums.clear();
        let per_m = 1.0 / size_m;
        for point in points_m {
            let at = point.map(f64::from);
            let Some(key) = key_of(at.map(|v| v * per_m)) else { continue };
            let place = *self.seen.entry(key).or_insert_with(|| {
                self.sums.push(([0.0; 3], 0));
                self.sums.len() as u32 - 1
            });
            let (sum, count) = &mut self.sums[place as usize];
            (0..3).for_each(|k| sum[k] += at[k]);
            *count += 1;
        }
        out.clear();
        out.extend(self.sums.iter().map(|(sum, count)| sum.map(|v| (v / f64::from(*count)) as f32)));
    }
}
