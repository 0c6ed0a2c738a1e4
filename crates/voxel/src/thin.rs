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
    intensity: f64,
    time: f64,
    origin: [f64; 3],
    sigma: f64,
    count: u32,
}

/// Points, and what is known of each: nothing, or as much as there are points.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PointColumns {
    /// Where they are, metres.
    pub points_m: Vec<[f32; 3]>,
    /// Red, green and blue of each; empty where there are none.
    pub colours: Vec<[u8; 3]>,
    /// How bright each is; empty where that is not known.
    pub intensities: Vec<f32>,
    /// When each was taken, seconds after a time that is common to them; empty where that is not known.
    pub times_s: Vec<f32>,
    /// Where each was seen from, in the same frame, metres; empty where that is not known.
    pub origins_m: Vec<[f32; 3]>,
    /// Standard deviation of each along its ray, metres; empty where that is not known.
    pub sigmas_m: Vec<f32>,
}

impl PointColumns {
    /// Forgets all, and keeps the room.
    pub fn clear(&mut self) {
        self.points_m.clear();
        self.colours.clear();
        self.intensities.clear();
        self.times_s.clear();
        self.origins_m.clear();
        self.sigmas_m.clear();
    }

    /// Keeps the points whose number this holds of, with what there is of each.
    pub fn retain_numbers(&mut self, holds: impl Fn(usize) -> bool) {
        fn of<T>(column: &mut Vec<T>, holds: &impl Fn(usize) -> bool) {
            let mut numbers = 0..;
            column.retain(|_| numbers.next().is_some_and(holds));
        }
        let Self { points_m, colours, intensities, times_s, origins_m, sigmas_m } = self;
        of(points_m, &holds);
        of(colours, &holds);
        of(intensities, &holds);
        of(times_s, &holds);
        of(origins_m, &holds);
        of(sigmas_m, &holds);
    }

    /// Keeps the points of which this holds, with what there is of each.
    pub fn retain(&mut self, holds: impl Fn(&[f32; 3]) -> bool) {
        let Self { points_m, colours, intensities, times_s, origins_m, sigmas_m } = self;
        keep(colours, points_m, &holds);
        keep(intensities, points_m, &holds);
        keep(times_s, points_m, &holds);
        keep(origins_m, points_m, &holds);
        keep(sigmas_m, points_m, &holds);
        points_m.retain(|point| holds(point));
    }
}

/// Of a column what is of points of which this holds.
fn keep<T>(column: &mut Vec<T>, points_m: &[[f32; 3]], holds: impl Fn(&[f32; 3]) -> bool) {
    let mut points = points_m.iter();
    column.retain(|_| points.next().is_none_or(&holds));
}

impl Thinner {
    /// For each voxel of side `size_m` the mean of the points in it, in the order in which voxels are met first.
    pub fn thin(&mut self, points_m: &[[f32; 3]], size_m: f64, out: &mut Vec<[f32; 3]>) {
        self.gather(points_m, size_m, |_, _| {});
        out.clear();
        out.extend(self.sums.iter().map(|sum| sum.mean_of(sum.point)));
    }

    /// The same with the mean of each column that there is.
    pub fn thin_columns(&mut self, from: &PointColumns, size_m: f64, out: &mut PointColumns) {
        let PointColumns { points_m, colours, intensities, times_s, origins_m, sigmas_m } = from;
        self.gather(points_m, size_m, |sum, number| {
            if let Some(colour) = colours.get(number) {
                (0..3).for_each(|k| sum.colour[k] += u32::from(colour[k]));
            }
            if let Some(intensity) = intensities.get(number).filter(|intensity| intensity.is_finite()) {
                sum.intensity += f64::from(*intensity);
            }
            // neighbours err alike: the mean of points is as uncertain as one of them
            sum.sigma += sigmas_m.get(number).copied().map_or(0.0, f64::from);
            sum.time += times_s.get(number).copied().map_or(0.0, f64::from);
            if let Some(origin) = origins_m.get(number) {
                (0..3).for_each(|k| sum.origin[k] += f64::from(origin[k]));
            }
        });
        out.clear();
        out.points_m.extend(self.sums.iter().map(|sum| sum.mean_of(sum.point)));
        if !colours.is_empty() {
            out.colours.extend(self.sums.iter().map(|sum| sum.colour.map(|v| (v / sum.count) as u8)));
        }
        if !intensities.is_empty() {
            out.intensities.extend(self.sums.iter().map(|sum| (sum.intensity / f64::from(sum.count)) as f32));
        }
        if !times_s.is_empty() {
            out.times_s.extend(self.sums.iter().map(|sum| (sum.time / f64::from(sum.count)) as f32));
        }
        if !sigmas_m.is_empty() {
            out.sigmas_m.extend(self.sums.iter().map(|sum| (sum.sigma / f64::from(sum.count)) as f32));
        }
        if !origins_m.is_empty() {
            out.origins_m.extend(self.sums.iter().map(|sum| sum.mean_of(sum.origin)));
        }
    }

    fn gather(&mut self, points_m: &[[f32; 3]], size_m: f64, mut also: impl FnMut(&mut Sum, usize)) {
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
            also(sum, number);
            sum.count += 1;
        }
    }
}

impl Sum {
    fn mean_of(&self, sum: [f64; 3]) -> [f32; 3] {
        sum.map(|v| (v / f64::from(self.count)) as f32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_voxel_keeps_the_mean_of_its_points_and_of_what_is_known_of_them() {
        let from = PointColumns {
            points_m: vec![[0.1, 0.1, 0.1], [5.0, 0.0, 0.0], [0.3, 0.1, 0.1], [f32::NAN, 0.0, 0.0]],
            colours: vec![[10, 0, 255], [1, 2, 3], [20, 0, 255], [0, 0, 0]],
            intensities: vec![1.0, 7.0, 2.0, 0.0],
            times_s: vec![0.1, 0.2, 0.3, 0.4],
            origins_m: vec![[1.0, 2.0, 3.0], [0.0; 3], [3.0, 2.0, 1.0], [9.0; 3]],
            sigmas_m: vec![0.1, 0.5, 0.3, 0.2],
        };
        let mut out = PointColumns::default();
        Thinner::default().thin_columns(&from, 1.0, &mut out);
        assert_eq!(
            (out.colours.as_slice(), out.intensities.as_slice()),
            ([[15, 0, 255], [1, 2, 3]].as_slice(), [1.5, 7.0].as_slice())
        );
        assert!(out.points_m.len() == 2 && (out.points_m[0][0] - 0.2).abs() < 1e-6);
        assert!(out.times_s.len() == 2 && (out.times_s[0] - 0.2).abs() < 1e-6);
        assert!((out.sigmas_m[0] - 0.2).abs() < 1e-6 && out.sigmas_m[1] == 0.5);
        assert_eq!(out.origins_m, [[2.0, 2.0, 2.0], [0.0; 3]]);
        let bare = PointColumns { points_m: from.points_m, ..PointColumns::default() };
        Thinner::default().thin_columns(&bare, 1.0, &mut out);
        assert!(out.points_m.len() == 2 && out.colours.is_empty());
        assert!(out.intensities.is_empty() && out.times_s.is_empty() && out.origins_m.is_empty());
    }
}
