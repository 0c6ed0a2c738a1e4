//! When odometry's next reading is no motion but a fault.

use mapwright_sensor::Odometry;

/// Nearer than this a step is believed, however short the time, metres.
const JUMP_M: f64 = 10.0;
/// Slower than this a step is believed, however far, metres per second: a log may pause while the robot drives on.
const JUMP_MPS: f64 = 3.0;

/// Whether a reading of odometry is farther from the one before than a robot drives in the time between them: more than
/// 10 m, and faster than 3 m/s. Stamps that stand still or run backwards count as no time.
#[must_use]
pub fn is_odometry_jump(before: &Odometry, now: &Odometry) -> bool {
    let elapsed_s = now.stamp.secs_since(before.stamp).max(0.0);
    let step_m = before.odom_from_robot.distance(now.odom_from_robot);
    step_m > JUMP_M.max(JUMP_MPS * elapsed_s)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright_geom::{Pose2, Stamp};

    fn is_jump(elapsed_s: f64, step_m: f64) -> bool {
        let at = |stamp_s, x_m| Odometry {
            stamp: Stamp::from_secs_f64(stamp_s),
            odom_from_robot: Pose2::new(x_m, 0.0, 0.0),
        };
        is_odometry_jump(&at(100.0, 1.0), &at(100.0 + elapsed_s, 1.0 + step_m))
    }

    #[test]
    fn a_robot_that_drove_on_during_a_pause_has_not_jumped() {
        assert!(!is_jump(60.0, 50.0) && !is_jump(60.0, -179.0) && !is_jump(0.1, 9.9));
    }

    #[test]
    fn what_no_robot_drives_in_the_time_is_a_jump() {
        assert!(is_jump(0.1, 10.1) && is_jump(60.0, 181.0));
    }

    #[test]
    fn stamps_that_stand_still_or_run_backwards_are_no_time() {
        assert!([0.0, -60.0].into_iter().all(|elapsed_s| is_jump(elapsed_s, 10.1) && !is_jump(elapsed_s, 9.9)));
    }
}
