//! Where odometry begins anew.

use crate::noted::Noted;
use mapwright_geom::{Pose2, Stamp};
use mapwright_sensor::{Odometry, Pace};

/// A step of odometry that no robot can have made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OdometryJump {
    /// When the second of its two readings was taken.
    pub stamp: Stamp,
    /// The time between them, seconds; negative where stamps step backwards.
    pub elapsed_s: f64,
    /// From the first to the second.
    pub step: Pose2,
}

/// Watches the odometry of one topic: steps that no robot can have made, judged by its [`Pace`], are noted. Odometry goes on from there.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct JumpWatch {
    pace: Pace,
    last: Option<Odometry>,
    /// Where they are.
    pub jumps: Noted,
    /// The first of them.
    pub first: Option<OdometryJump>,
}

impl JumpWatch {
    /// Takes the next reading of the topic; `place` is its line or message number. The step since the one before, if there was one and a
    /// robot can have made it.
    pub fn observe(&mut self, place: u64, now: Odometry) -> Option<Pose2> {
        let last = self.last.replace(now)?;
        let elapsed_s = now.stamp.secs_since(last.stamp);
        let step = last.odom_from_robot.between(now.odom_from_robot);
        if self.pace.add(elapsed_s, step) {
            return Some(step);
        }
        self.jumps.note(place);
        self.first.get_or_insert(OdometryJump { stamp: now.stamp, elapsed_s, step });
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn is_jump(elapsed_s: f64, step_m: f64) -> bool {
        let at = |stamp_s, x_m| Odometry {
            stamp: Stamp::from_secs_f64(stamp_s),
            odom_from_robot: Pose2::new(x_m, 0.0, 0.0),
        };
        let mut watch = JumpWatch::default();
        assert_eq!(watch.observe(1, at(100.0, 1.0)), None);
        watch.observe(2, at(100.0 + elapsed_s, 1.0 + step_m)).is_none() && watch.jumps.first_places == [2]
    }

    #[test]
    fn a_robot_that_drove_on_during_a_pause_has_not_jumped() {
        assert!(!is_jump(60.0, 50.0) && !is_jump(60.0, -179.0) && !is_jump(0.1, 2.9));
    }

    #[test]
    fn what_no_robot_drives_in_the_time_is_a_jump() {
        assert!(is_jump(0.1, 3.1) && is_jump(60.0, 181.0));
    }

    #[test]
    fn stamps_that_stand_still_or_run_backwards_are_no_time() {
        assert!([0.0, -60.0].into_iter().all(|elapsed_s| is_jump(elapsed_s, 3.1) && !is_jump(elapsed_s, 2.9)));
    }
}
