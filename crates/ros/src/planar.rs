//! A horizontal slice of a point cloud as a laser scan.

use mapwright_geom::{Pose2, Stamp};
use mapwright_sensor::{LaserModel, LaserScan};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

/// Which points of a cloud make a scan.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanarSlice {
    /// Points below are left out, metres in the robot's frame.
    pub z_min_m: f64,
    /// Points above are left out, metres in the robot's frame.
    pub z_max_m: f64,
    /// Points nearer to the sensor are left out, metres in the plane.
    pub range_min_m: f64,
    /// Points at or beyond are left out, metres in the plane.
    pub range_max_m: f64,
    /// Beams of a full turn.
    pub beams: usize,
}

impl Default for PlanarSlice {
    fn default() -> Self {
        Self { z_min_m: 0.1, z_max_m: 1.0, range_min_m: 0.3, range_max_m: 80.0, beams: 720 }
    }
}

/// What became of a cloud's points.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SliceCounts {
    /// Within the slice.
    pub used: u64,
    /// Above, below, too near or too far.
    pub outside: u64,
    /// Not finite.
    pub invalid: u64,
}

impl PlanarSlice {
    /// The laser that sees the slice from the sensor's place: beams once around, anticlockwise, the first to the rear.
    #[must_use]
    pub fn laser(&self, name: &str, sensor_in_robot: [f64; 2]) -> LaserModel {
        let step = self.step_rad();
        LaserModel {
            name: name.to_owned(),
            angle_min_rad: -PI + 0.5 * step,
            angle_step_rad: step,
            range_min_m: self.range_min_m,
            range_max_m: self.range_max_m,
            robot_from_laser: Pose2::new(sensor_in_robot[0], sensor_in_robot[1], 0.0),
            inverted: false,
            beam_period_s: 0.0,
        }
    }

    /// The nearest point of each beam; NaN where there is none, for a beam that brought nothing back within the slice
    /// may have passed above or below anything. `points` are in the robot's frame.
    pub fn scan(
        &self,
        stamp: Stamp,
        laser: Arc<LaserModel>,
        points: impl IntoIterator<Item = [f64; 3]>,
    ) -> (LaserScan, SliceCounts) {
        let mut ranges_m = vec![f32::NAN; self.beams];
        let mut counts = SliceCounts::default();
        let sensor = laser.robot_from_laser;
        for [x, y, z] in points {
            let (dx, dy) = (x - sensor.x, y - sensor.y);
            let range = dx.hypot(dy);
            if !(range.is_finite() && z.is_finite()) {
                counts.invalid += 1;
            } else if !(z >= self.z_min_m && z <= self.z_max_m && range >= self.range_min_m && range < self.range_max_m)
            {
                counts.outside += 1;
            } else if let Some(nearest) = ranges_m.get_mut(self.beam(dy.atan2(dx))) {
                counts.used += 1;
                *nearest = nearest.min(range as f32); // min of a NaN and a number is the number
            }
        }
        (LaserScan { stamp, laser, ranges_m, odom_from_robot: None }, counts)
    }

    fn step_rad(&self) -> f64 {
        TAU / self.beams.max(1) as f64
    }

    fn beam(&self, bearing_rad: f64) -> usize {
        let beam = ((bearing_rad + PI) / self.step_rad()) as usize;
        beam.min(self.beams.saturating_sub(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_point_of_each_beam_within_the_slice_counts() {
        let slice = PlanarSlice { z_min_m: 0.0, z_max_m: 1.0, beams: 360, ..PlanarSlice::default() };
        let laser = Arc::new(slice.laser("cloud", [1.0, 0.0]));
        let points = [
            [4.0, 0.01, 0.5],
            [3.0, 0.01, 0.5],
            [2.0, 0.01, 1.5],
            [1.0, 2.0, 0.0],
            [1.1, 0.0, 0.5],
            [f64::NAN, 0.0, 0.0],
        ];
        let (scan, counts) = slice.scan(Stamp(3), laser.clone(), points);
        assert_eq!(counts, SliceCounts { used: 3, outside: 2, invalid: 1 });
        let hits: Vec<_> = (0..360).filter(|beam| !scan.ranges_m[*beam].is_nan()).collect();
        assert_eq!(hits.len(), 2);
        for (beam, [x, y]) in hits.into_iter().zip([[3.0, 0.01], [1.0, 2.0]]) {
            let bearing = laser.bearing_in_robot(beam);
            let range = f64::from(scan.ranges_m[beam]);
            let seen = [1.0 + range * bearing.cos(), range * bearing.sin()];
            assert!((seen[0] - x).hypot(seen[1] - y) < 0.02, "{seen:?}");
        }
    }

    #[test]
    fn a_slice_without_beams_is_an_empty_scan() {
        let slice = PlanarSlice { beams: 0, ..PlanarSlice::default() };
        let (scan, _) = slice.scan(Stamp(0), Arc::new(slice.laser("cloud", [0.0; 2])), [[1.0, 0.0, 0.5]]);
        assert!(scan.ranges_m.is_empty());
    }
}
