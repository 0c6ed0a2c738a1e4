//! Whether scans turn the way odometry does.

use mapwright::{LaserModel, Pose2, Status, Update};
use std::sync::Arc;

/// Turning is compared over stretches in which one of both has turned so far, radians: a match is good to a hundredth of that.
const STRETCH_RAD: f64 = 0.1;
/// So much has to be turned in all, radians, before anything is said: ten stretches.
const TURNED_AT_LEAST_RAD: f64 = 1.0;
/// Scans turn the other way where they are off by so much less then, in squares: by half as much. Of mapped drives in four buildings
/// they are off by four to seven times as much.
const LESS: f64 = 4.0;

/// How the robot has turned by odometry and by matches.
#[derive(Debug, Clone, Default)]
pub(crate) struct Turns {
    /// Where the stretch began: headings by odometry and by matches.
    from: Option<[f64; 2]>,
    turned_rad: f64,
    /// Squares of what matches are off by, if scans turn as odometry does and if they turn the other way.
    off: [f64; 2],
    laser: Option<Arc<LaserModel>>,
}

impl Turns {
    /// Takes note of a scan, and of where odometry had the robot at it.
    pub(crate) fn add(&mut self, update: &Update, odom_from_robot: Option<Pose2>, laser: &Arc<LaserModel>) {
        let tracked = odom_from_robot.filter(|_| update.status != Status::Lost);
        let Some(odom_from_robot) = tracked else {
            self.from = None;
            return;
        };
        if self.laser.is_none() {
            self.laser = Some(Arc::clone(laser));
        }
        let now = [odom_from_robot.theta, update.map_from_robot.theta];
        let from = *self.from.get_or_insert(now);
        let [said, matched] = [wrapped(now[0] - from[0]), wrapped(now[1] - from[1])];
        if said.abs().max(matched.abs()) >= STRETCH_RAD {
            self.turned_rad += said.abs();
            self.off[0] += (matched - said).powi(2);
            self.off[1] += (matched + said).powi(2);
            self.from = Some(now);
        }
    }

    /// What to say and to type where scans turn against odometry.
    pub(crate) fn words(&self) -> Option<String> {
        let laser = self.laser.as_ref()?;
        let [same, other] = self.off;
        if self.turned_rad < TURNED_AT_LEAST_RAD || other * LESS >= same {
            return None;
        }
        let at = laser.robot_from_laser;
        let (now, flipped) = if laser.inverted { ("upright", "") } else { ("upside down", ",flipped") };
        Some(format!(
            "scans turn the other way than odometry, so that the map is mirrored: is the laser {now}? Then type --mount \
             {:.3},{:.3},{:.4}{flipped}",
            at.x, at.y, at.theta
        ))
    }
}

fn wrapped(angle_rad: f64) -> f64 {
    Pose2::new(0.0, 0.0, angle_rad).theta
}
