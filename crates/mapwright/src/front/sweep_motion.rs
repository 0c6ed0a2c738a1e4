//! How the robot moved while a scan was taken.

use super::predict::Step;
use mapwright_geom::{Pose2, Stamp, Stored, stored};
use mapwright_sensor::{LaserScan, Odometry, TurnRate, TurnRates};
use std::collections::VecDeque;

/// More motion than this within one sweep is not believed, metres and radians.
const SWEEP_MOTION_M: f64 = 5.0;
const SWEEP_TURN_RAD: f64 = 3.0;
/// Readings of the wheels that are kept: more than the longest usual sweep has.
const ODOMETRY_READINGS: usize = 128;
/// The last reading counts for a scan that has none of its own up to so many seconds after it.
const FRESH_S: f64 = 2.0;
/// Wheels that were read for less of the sweep than this say too little of it.
const COVERED_SHARE: f64 = 0.4;
/// Readings farther apart are not joined, seconds.
const ODOMETRY_JOINED_S: f64 = 1.0;

/// What wheels and a gyroscope have said of late.
#[derive(Debug, Clone, Default)]
pub(super) struct SweepMotion {
    odometry: RecentOdometry,
    turn_rates: TurnRates,
}

/// The last readings of the wheels.
#[derive(Debug, Clone, Default)]
struct RecentOdometry(VecDeque<Odometry>);

impl Stored for RecentOdometry {
    fn put(&self, out: &mut Vec<u8>) {
        self.0.put(out);
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        VecDeque::take(from).filter(|readings| readings.len() <= ODOMETRY_READINGS).map(Self)
    }
}

stored!(SweepMotion { odometry, turn_rates });

impl RecentOdometry {
    fn add(&mut self, odometry: Odometry) {
        if self.0.len() == ODOMETRY_READINGS {
            self.0.pop_front();
        }
        self.0.push_back(odometry);
    }

    /// Where the robot was at `stamp`: between the readings around it, or as the last one before says where that is not too old. A reading
    /// from after it says where the robot was later.
    fn at(&self, stamp: Stamp) -> Option<Pose2> {
        let mut after: Option<&Odometry> = None;
        for reading in self.0.iter().rev() {
            if reading.stamp > stamp {
                after = Some(reading);
                continue;
            }
            let since_s = stamp.secs_since(reading.stamp);
            let apart_s = after.map_or(f64::INFINITY, |after| after.stamp.secs_since(reading.stamp));
            if let Some(after) = after.filter(|_| apart_s <= ODOMETRY_JOINED_S) {
                let step = reading.odom_from_robot.between(after.odom_from_robot).log();
                return Some(reading.odom_from_robot * Pose2::exp(step.map(|part| part * since_s / apart_s)));
            }
            return (since_s <= FRESH_S).then_some(reading.odom_from_robot);
        }
        None
    }

    /// The first reading from `stamp` on, or the last one before.
    fn at_or_after(&self, stamp: Stamp) -> Option<&Odometry> {
        let later = self.0.iter().rev().take_while(|odometry| odometry.stamp >= stamp).last();
        later.or(self.0.back())
    }
}

impl SweepMotion {
    pub(super) fn add_odometry(&mut self, odometry: Odometry) {
        self.odometry.add(odometry);
    }

    pub(super) fn add_turn_rate(&mut self, rate: &TurnRate) -> bool {
        self.turn_rates.add(*rate)
    }

    /// The pose by the wheels at `stamp`, where their readings say it.
    pub(super) fn odometry_at(&self, stamp: Stamp) -> Option<Pose2> {
        self.odometry.at(stamp)
    }

    /// The robot's twist per second during the sweep, which begins at the scan's stamp.
    ///
    /// A scan arrives when its sweep is over, and the wheels have been read on the way: then they say it. Otherwise the
    /// motion since the last scan is carried on, as `carried`. Turning is what a gyroscope says, where one was read on the way.
    pub(super) fn twist(
        &self,
        scan: &LaserScan,
        step: Step,
        carried: [f64; 3],
        believes: impl Fn(f64, Pose2) -> bool,
    ) -> [f64; 3] {
        let sweep_s = scan.laser.beam_period_s * scan.ranges_m.len() as f64;
        // beams that are taken at once, or in an order that nobody knows
        if sweep_s.is_nan() || sweep_s <= 0.0 {
            return [0.0; 3];
        }
        let read = if step.from_odometry { self.twist_read(scan, sweep_s, believes) } else { None };
        self.turned(scan.stamp, sweep_s, read.unwrap_or(carried))
    }

    /// With the turning that a gyroscope says; nothing where that is more than a robot can.
    pub(super) fn turned(&self, stamp: Stamp, sweep_s: f64, [x, y, turning]: [f64; 3]) -> [f64; 3] {
        let end = Stamp(stamp.0.saturating_add(Stamp::from_secs_f64(sweep_s).0));
        let twist = [x, y, self.turn_rates.mean(stamp, end).unwrap_or(turning)];
        let credible =
            twist[0].hypot(twist[1]) * sweep_s <= SWEEP_MOTION_M && twist[2].abs() * sweep_s <= SWEEP_TURN_RAD;
        if credible { twist } else { [0.0; 3] }
    }

    /// By readings of the wheels from within the sweep.
    fn twist_read(&self, scan: &LaserScan, sweep_s: f64, believes: impl Fn(f64, Pose2) -> bool) -> Option<[f64; 3]> {
        let odom_from_robot = scan.odom_from_robot.filter(|pose| pose.is_finite())?;
        let end = Stamp(scan.stamp.0.saturating_add(Stamp::from_secs_f64(sweep_s).0));
        let later = self.odometry.at_or_after(end)?;
        let elapsed_s = later.stamp.secs_since(scan.stamp);
        let says = elapsed_s >= COVERED_SHARE * sweep_s && elapsed_s <= sweep_s + ODOMETRY_JOINED_S;
        let motion = odom_from_robot.between(later.odom_from_robot);
        (says && believes(elapsed_s, motion)).then(|| motion.log().map(|d| d / elapsed_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wheels_that_fell_silent_say_nothing() {
        let mut recent = RecentOdometry::default();
        recent.add(Odometry { stamp: Stamp::from_secs_f64(10.0), odom_from_robot: Pose2::IDENTITY });
        let known = |s: f64| recent.at(Stamp::from_secs_f64(s)).is_some();
        assert_eq!([0.0, 9.0, 10.0, 11.9, 12.1, 1e6].map(known), [false, false, true, true, false, false]);
    }

    #[test]
    fn a_scan_between_two_readings_lies_between_them() {
        let mut recent = RecentOdometry::default();
        let mut read = |s: f64, x_m: f64| {
            let odom_from_robot = Pose2::new(x_m, 0.0, 0.0);
            recent.add(Odometry { stamp: Stamp::from_secs_f64(s), odom_from_robot });
        };
        read(10.0, 1.0);
        read(10.5, 2.0);
        read(13.0, 3.0);
        let x_m = |s: f64| recent.at(Stamp::from_secs_f64(s)).map(|pose| (1e6 * pose.x).round() / 1e6);
        assert_eq!([9.9, 10.0, 10.25, 10.5].map(x_m), [None, Some(1.0), Some(1.5), Some(2.0)]);
        // over a gap as the last one said, for as long as that counts
        assert_eq!([12.0, 12.9, 13.1].map(x_m), [Some(2.0), None, Some(3.0)]);
    }

    #[test]
    fn the_reading_at_the_end_of_the_sweep_counts() {
        let mut recent = RecentOdometry::default();
        assert!(recent.at_or_after(Stamp(0)).is_none());
        for stamp in 0..1000 {
            recent.add(Odometry { stamp: Stamp(stamp), odom_from_robot: Pose2::IDENTITY });
        }
        assert_eq!(recent.0.len(), ODOMETRY_READINGS);
        assert_eq!(recent.at_or_after(Stamp(950)).map(|odometry| odometry.stamp), Some(Stamp(950)));
        assert_eq!(recent.at_or_after(Stamp(5000)).map(|odometry| odometry.stamp), Some(Stamp(999)));
    }
}
