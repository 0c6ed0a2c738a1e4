//! The points of a Livox lidar as mapping in space wants them.

use crate::cloud::{CloudPoints, SWEEP_S};
use crate::messages::{LivoxPoint, LivoxScan};

impl LivoxPoint {
    /// Whether something came back, and the lidar does not take it for rain, dust, or a shadow between two surfaces. Bits 2 and 3 of the
    /// tag judge the intensity, 0 and 1 the place; 01 is most likely noise (Mid-70 manual 1.2, HAP manual 1.0, "Point cloud data").
    #[must_use]
    pub fn counts(&self) -> bool {
        let is_noise = self.tag & 0b11 == 0b01 || self.tag & 0b1100 == 0b0100;
        [self.x, self.y, self.z] != [0.0; 3] && !is_noise
    }
}

impl LivoxScan<'_> {
    /// The points that count, with their times after the stamp and how bright they came back (0 to 255).
    #[must_use]
    pub fn to_points(&self) -> CloudPoints {
        let there: Vec<_> = self.points.iter().filter(|point| point.counts()).collect();
        let points_m: Vec<_> = there.iter().map(|point| [point.x, point.y, point.z]).collect();
        let not_finite = points_m.iter().filter(|point| !point.iter().all(|v| v.is_finite())).count();
        let last_s = there.iter().map(|point| f64::from(point.offset_time) * 1e-9).fold(0.0, f64::max);
        let is_sweep = last_s <= SWEEP_S;
        let timed = there.iter().filter(|_| is_sweep && last_s > 0.0);
        let times_s = timed.map(|point| (f64::from(point.offset_time) * 1e-9) as f32).collect();
        let refused_time = (!is_sweep).then(|| "offset_time".to_owned());
        let mut intensities: Vec<_> = there.iter().map(|point| f32::from(point.reflectivity)).collect();
        if intensities.windows(2).all(|pair| pair[0] == pair[1]) {
            intensities.clear();
        }
        CloudPoints { points_m, not_finite, times_s, refused_time, intensities, ..CloudPoints::default() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(offset_time: u32, x: f32, tag: u8) -> LivoxPoint {
        LivoxPoint { offset_time, x, tag, ..LivoxPoint::default() }
    }

    #[test]
    fn points_that_count_have_times() {
        let points = vec![point(0, 1.0, 0x10), point(5, 0.0, 0), point(7, 2.0, 0x11), point(9, 2.0, 0x04)];
        let last = point(100_000_000, 3.0, 0);
        let scan = LivoxScan { points: [points, vec![last]].concat(), ..LivoxScan::default() };
        let points = scan.to_points();
        assert_eq!((points.points_m, points.times_s), (vec![[1.0, 0.0, 0.0], [3.0, 0.0, 0.0]], vec![0.0, 0.1]));
        assert!(points.intensities.is_empty());
    }

    #[test]
    fn reflectivities_are_intensities() {
        let at = |x: f32, reflectivity: u8| LivoxPoint { reflectivity, ..point(0, x, 0) };
        let scan = LivoxScan { points: vec![at(1.0, 7), at(0.0, 9), at(2.0, 255)], ..LivoxScan::default() };
        assert_eq!(scan.to_points().intensities, [7.0, 255.0]);
    }

    #[test]
    fn times_of_more_than_a_sweep_are_refused() {
        let scan = LivoxScan { points: vec![point(0, 1.0, 0), point(2_000_000_000, 1.0, 0)], ..LivoxScan::default() };
        let points = scan.to_points();
        assert_eq!((points.times_s.len(), points.refused_time.as_deref()), (0, Some("offset_time")));
    }
}
