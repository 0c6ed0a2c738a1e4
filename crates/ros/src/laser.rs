//! Laser scans and odometry as the mapper takes them.

use crate::error::RosError;
use crate::messages::{LaserScan, MultiEchoLaserScan, Odometry};
use crate::mounting::{Mounting, planar};
use mapwright_sensor::{LaserModel, LaserScan as SensorScan, Odometry as SensorOdometry};
use std::sync::Arc;

impl LaserScan<'_> {
    /// The laser that took the scan, by the name of its frame.
    ///
    /// # Errors
    /// [`RosError::Scan`] for geometry that cannot be mapped with.
    pub fn laser(&self, mounting: &Mounting) -> Result<LaserModel, RosError> {
        let laser = LaserModel {
            name: self.header.frame().to_owned(),
            angle_min_rad: angle_as_meant(self.angle_min),
            angle_step_rad: angle_as_meant(self.angle_increment),
            range_min_m: f64::from(self.range_min),
            range_max_m: f64::from(self.range_max),
            robot_from_laser: mounting.robot_from_laser,
            inverted: mounting.inverted,
            beam_period_s: f64::from(self.time_increment),
        };
        let beams = self.ranges.len();
        let problem = laser.check(beams).err().or_else(|| {
            (beams > 1 && self.angle_increment == 0.0)
                .then_some("all beams have the same bearing (angle_increment is 0)")
        });
        match problem {
            Some(reason) => Err(RosError::Scan { frame: laser.name, reason: reason.to_owned() }),
            None => Ok(laser),
        }
    }

    /// The scan as the mapper takes it, with a laser made by [`LaserScan::laser`] of this scan or of one like it.
    #[must_use]
    pub fn to_sensor(&self, laser: Arc<LaserModel>) -> SensorScan {
        SensorScan { stamp: self.header.stamp, laser, ranges_m: self.ranges.to_vec(), odom_from_robot: None }
    }
}

/// The angle before it was rounded to single precision, where it was a whole number of thousandths of a degree, as those
/// of most lasers are.
fn angle_as_meant(angle_rad: f32) -> f64 {
    let thousandths = (f64::from(angle_rad).to_degrees() * 1e3).round();
    let meant_rad = (thousandths / 1e3).to_radians();
    if meant_rad as f32 == angle_rad { meant_rad } else { f64::from(angle_rad) }
}

impl MultiEchoLaserScan<'_> {
    /// The first echo of each beam; NaN for beams without any.
    #[must_use]
    pub fn first_echoes(&self) -> Vec<f32> {
        self.ranges.iter().map(|echo| echo.echoes.get(0).unwrap_or(f32::NAN)).collect()
    }

    /// The scan of the given ranges, such as [`MultiEchoLaserScan::first_echoes`].
    #[must_use]
    pub fn with_ranges<'r>(&'r self, ranges: &'r [f32]) -> LaserScan<'r> {
        LaserScan {
            header: self.header.clone(),
            angle_min: self.angle_min,
            angle_max: self.angle_max,
            angle_increment: self.angle_increment,
            time_increment: self.time_increment,
            scan_time: self.scan_time,
            range_min: self.range_min,
            range_max: self.range_max,
            ranges: ranges.into(),
            intensities: Default::default(),
        }
    }
}

impl Odometry<'_> {
    /// The reading in the plane; none where the quaternion has no direction or the place is not finite.
    #[must_use]
    pub fn to_sensor(&self) -> Option<SensorOdometry> {
        let odom_from_robot = self.pose.pose.to_pose3().filter(|pose| pose.is_finite())?;
        Some(SensorOdometry { stamp: self.header.stamp, odom_from_robot: planar(&odom_from_robot) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::messages::{Header, LaserEcho};
    use mapwright_geom::Stamp;

    #[test]
    fn a_scan_becomes_the_mappers() {
        let ranges = [1.0, f32::NAN, 3.0];
        let scan = LaserScan {
            header: Header::new(Stamp(7), "/laser"),
            angle_increment: 0.5,
            time_increment: 1e-5,
            ranges: ranges[..].into(),
            ..Default::default()
        };
        let laser = Arc::new(scan.laser(&Mounting::IDENTITY).unwrap());
        assert_eq!((laser.name.as_str(), laser.beam_period_s), ("laser", f64::from(1e-5_f32)));
        let sensor = scan.to_sensor(laser);
        assert_eq!((sensor.stamp, sensor.ranges_m.len()), (Stamp(7), 3));
    }

    #[test]
    fn angles_of_lasers_are_not_rounded_to_single_precision() {
        let half = mapwright_sensor::LaserModel::half_circle("", 180);
        for meant_rad in [half.angle_min_rad, half.angle_step_rad, 0.25_f64.to_radians(), f64::from(-2.35_f32), 0.0] {
            assert_eq!(angle_as_meant(meant_rad as f32), meant_rad);
        }
        assert!(angle_as_meant(f32::NAN).is_nan() && angle_as_meant(f32::INFINITY).is_infinite());
    }

    #[test]
    fn geometry_that_cannot_be_mapped_with_is_refused() {
        let ranges = [1.0; 3];
        let flat = LaserScan { ranges: ranges[..].into(), ..Default::default() };
        assert!(flat.laser(&Mounting::IDENTITY).unwrap_err().to_string().contains("angle_increment"));
        let absurd = LaserScan { angle_increment: f32::NAN, ..flat };
        assert!(absurd.laser(&Mounting::IDENTITY).is_err());
    }

    #[test]
    fn of_several_echoes_the_first_counts() {
        let echo = |echoes: &'static [f32]| LaserEcho { echoes: echoes.into() };
        let scan = MultiEchoLaserScan { ranges: vec![echo(&[2.0, 5.0]), echo(&[])], ..Default::default() };
        let first = scan.first_echoes();
        assert!(first[0] == 2.0 && first[1].is_nan());
        assert_eq!(scan.with_ranges(&first).ranges.len(), 2);
    }

    #[test]
    fn odometry_is_seen_from_above_and_needs_a_direction() {
        let mut odometry = Odometry { header: Header::new(Stamp(7), "odom"), ..Default::default() };
        assert!(odometry.to_sensor().is_none());
        odometry.pose.pose.orientation.z = 1.0;
        odometry.pose.pose.position.x = 2.0;
        let seen = odometry.to_sensor().unwrap();
        assert_eq!(
            (seen.stamp, seen.odom_from_robot),
            (Stamp(7), mapwright_geom::Pose2::new(2.0, 0.0, std::f64::consts::PI))
        );
    }
}
