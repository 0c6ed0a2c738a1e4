//! Laser scans and odometry as the mapper takes them.

use crate::error::RosError;
use crate::messages::{LaserEcho, LaserScan, MultiEchoLaserScan, Odometry};
use crate::mounting::{Mounting, planar};
use mapwright_sensor::{
    Bearings, LaserModel, LaserScan as SensorScan, OddHead, Odometry as SensorOdometry, SaidBearings, settle_ranges,
    settle_times,
};
use std::sync::Arc;

impl LaserScan<'_> {
    /// The laser that took the scan, by the name of its frame; and what of the head contradicts itself, with what is used.
    ///
    /// # Errors
    /// [`RosError::Scan`] for geometry that cannot be mapped with.
    pub fn laser(&self, mounting: &Mounting) -> Result<(LaserModel, Vec<OddHead>), RosError> {
        let beams = self.ranges.len();
        let Bearings { first_rad, step_rad, odd } = self.bearings().settle(beams);
        let ([range_min_m, range_max_m], odd_ranges) =
            settle_ranges(f64::from(self.range_min), f64::from(self.range_max));
        let (beam_period_s, odd_times) = self.beam_period_s();
        let laser = LaserModel {
            name: self.header.frame().to_owned(),
            angle_min_rad: first_rad,
            angle_step_rad: step_rad,
            range_min_m,
            range_max_m,
            robot_from_laser: mounting.robot_from_laser,
            inverted: mounting.inverted,
            beam_period_s,
        };
        let one_bearing =
            (beams > 1 && step_rad == 0.0).then_some("all beams have the same bearing (angle_increment is 0)");
        let problem = laser.check(beams).err().or(one_bearing);
        match problem {
            Some(reason) => Err(RosError::Scan { frame: laser.name, reason: reason.to_owned() }),
            None => Ok((laser, [odd, odd_ranges, odd_times].into_iter().flatten().collect())),
        }
    }

    /// Time from beam to beam, seconds; 0 where it cannot be known, and why where the head says something else.
    #[must_use]
    pub fn beam_period_s(&self) -> (f64, Option<OddHead>) {
        settle_times(f64::from(self.time_increment), f64::from(self.scan_time), self.ranges.len())
    }

    fn bearings(&self) -> SaidBearings {
        SaidBearings {
            first_rad: angle_as_meant(self.angle_min),
            last_rad: angle_as_meant(self.angle_max),
            step_rad: angle_as_meant(self.angle_increment),
            names: ["angle_max", "angle_increment"],
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
    /// The first echo of each beam that lies within the limits of range, else its first at all; NaN for beams without any.
    ///
    /// What is nearest along a beam is what the robot must not drive into; later echoes lie behind glass, rain or an edge.
    #[must_use]
    pub fn first_echoes(&self) -> Vec<f32> {
        let is_return = |range_m: &f32| *range_m > self.range_min && *range_m < self.range_max;
        let first = |echo: &LaserEcho<'_>| {
            let mut echoes = (0..echo.echoes.len()).map_while(|at| echo.echoes.get(at));
            echoes.find(is_return).or_else(|| echo.echoes.get(0)).unwrap_or(f32::NAN)
        };
        self.ranges.iter().map(first).collect()
    }

    /// The most echoes that a beam of it has.
    #[must_use]
    pub fn most_echoes(&self) -> usize {
        self.ranges.iter().map(|echo| echo.echoes.len()).max().unwrap_or(0)
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
    use crate::messages::Header;
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
        let laser = Arc::new(scan.laser(&Mounting::IDENTITY).unwrap().0);
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
    fn heads_that_contradict_themselves_are_settled_and_said() {
        let ranges = [1.0; 90];
        let said = |scan: LaserScan<'_>| {
            let (laser, odd) = scan.laser(&Mounting::IDENTITY).unwrap();
            (laser, odd.into_iter().map(|odd| odd.words).collect::<Vec<_>>())
        };
        let [first, last, step] = [-90.0_f32, 88.0, 2.0].map(f32::to_radians);
        let good = || LaserScan {
            angle_min: first,
            angle_max: last,
            angle_increment: step,
            time_increment: 1e-4,
            range_max: 81.0,
            ranges: ranges[..].into(),
            ..Default::default()
        };
        let (sound, odd) = said(good());
        assert!(odd.is_empty(), "{odd:?}");
        for (scan, what) in [
            (LaserScan { angle_increment: -step, ..good() }, "angle_max says +88.0 deg"),
            (LaserScan { angle_increment: 0.8 * step, ..good() }, "used are 2.000 deg a beam"),
            (LaserScan { range_max: 0.0, ..good() }, "range_max is 0: not used"),
            (LaserScan { time_increment: 1e5, scan_time: 1e8, ..good() }, "nanoseconds?"),
        ] {
            let (laser, odd) = said(scan);
            assert!(odd.len() == 1 && odd[0].contains(what), "{odd:?}");
            assert!((laser.angle_step_rad - sound.angle_step_rad).abs() < 1e-7, "{laser:?}");
        }
    }

    #[test]
    fn of_several_echoes_the_first_counts() {
        let echo = |echoes: &'static [f32]| LaserEcho { echoes: echoes.into() };
        let scan = MultiEchoLaserScan { ranges: vec![echo(&[2.0, 5.0]), echo(&[])], ..Default::default() };
        let first = scan.first_echoes();
        assert!(first[0] == 2.0 && first[1].is_nan());
        assert_eq!(scan.with_ranges(&first).ranges.len(), 2);
        let scan = MultiEchoLaserScan {
            range_min: 0.1,
            range_max: 9.0,
            ranges: vec![echo(&[0.0, 5.0, 7.0]), echo(&[20.0])],
            ..Default::default()
        };
        assert_eq!((scan.first_echoes(), scan.most_echoes()), (vec![5.0, 20.0], 3));
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
