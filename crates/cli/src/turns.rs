//! Whether scans turn the way odometry does.

use mapwright::{LaserModel, Pose2, Status, Update};
use std::sync::Arc;

/// Turning is compared over stretches in which one of both has turned so far, radians: a match is good to a hundredth of that.
const STRETCH_RAD: f64 = 0.1;
/// A turn is one way round at one place: it ends where the robot has driven on so far, metres. Of one turn a robot that was lifted, or whose
/// wheels spun, may tell anything; it counts as so much, radians, however long it is.
const TURN_M: f64 = 1.0;
const TURN_RAD: f64 = 0.5;
/// So much has to be turned in all, radians, before anything is said: ten stretches, of two turns at least.
const TURNED_AT_LEAST_RAD: f64 = 1.0;
/// Scans turn the other way where they are off by so much less then, in squares: by half as much. Of mapped drives in four buildings
/// they are off by four to seven times as much.
const LESS: f64 = 4.0;

/// How the robot has turned by odometry and by matches.
#[derive(Debug, Clone, Default)]
pub(crate) struct Turns {
    /// Where the stretch began: by odometry, and its heading by matches.
    from: Option<(Pose2, f64)>,
    /// The turn that goes on, and where it began by odometry.
    turn: Option<(Pose2, Turned)>,
    before: Turned,
    laser: Option<Arc<LaserModel>>,
}

/// What was turned.
#[derive(Debug, Clone, Copy, Default)]
struct Turned {
    /// By odometry; of one turn with its sign, radians.
    rad: f64,
    /// Squares of what matches are off by, as shares of the stretch, times its length: if scans turn as odometry does, and if they turn the other way.
    off: [f64; 2],
}

impl Turned {
    /// A turn more.
    fn with(self, turn: Self) -> Self {
        let weight = (TURN_RAD / turn.rad.abs()).min(1.0);
        let off = [0, 1].map(|k| self.off[k] + weight * turn.off[k]);
        Self { rad: self.rad + weight * turn.rad.abs(), off }
    }
}

impl Turns {
    /// Takes note of a scan, and of where odometry had the robot at it.
    pub(crate) fn add(&mut self, update: &Update, odom_from_robot: Option<Pose2>, laser: &Arc<LaserModel>) {
        // Where nothing was matched the pose is odometry's own.
        let tracked = odom_from_robot.filter(|_| update.matched.is_some() && update.status != Status::Lost);
        if tracked.is_some() && self.laser.is_none() {
            self.laser = Some(Arc::clone(laser));
        }
        self.see(tracked, update.map_from_robot.theta);
    }

    fn see(&mut self, odom_from_robot: Option<Pose2>, map_rad: f64) {
        let Some(now) = odom_from_robot else {
            self.from = None;
            return;
        };
        let (from, from_rad) = *self.from.get_or_insert((now, map_rad));
        let [said, matched] = [wrapped(now.theta - from.theta), wrapped(map_rad - from_rad)];
        let most = said.abs().max(matched.abs());
        if most >= STRETCH_RAD {
            let counts = most.min(STRETCH_RAD);
            let off = [matched - said, matched + said].map(|off| counts * (off / most).powi(2));
            self.add_stretch(from, Turned { rad: said.clamp(-STRETCH_RAD, STRETCH_RAD), off });
            self.from = Some((now, map_rad));
        }
    }

    fn add_stretch(&mut self, from: Pose2, stretch: Turned) {
        let goes_on = |(began, turn): &(Pose2, Turned)| began.distance(from) < TURN_M && turn.rad * stretch.rad >= 0.0;
        let (began, turn) = match self.turn.take() {
            Some(turn) if goes_on(&turn) => turn,
            ended => {
                self.before = ended.map_or(self.before, |(_, turn)| self.before.with(turn));
                (from, Turned::default())
            }
        };
        let off = [0, 1].map(|k| turn.off[k] + stretch.off[k]);
        self.turn = Some((began, Turned { rad: turn.rad + stretch.rad, off }));
    }

    /// Whether scans turn against odometry.
    fn is_against(&self) -> bool {
        let Turned { rad, off: [same, other] } = self.turn.map_or(self.before, |(_, turn)| self.before.with(turn));
        rad >= TURNED_AT_LEAST_RAD && other * LESS < same
    }

    /// What to say and to type where scans turn against odometry.
    pub(crate) fn words(&self) -> Option<String> {
        let laser = self.laser.as_ref().filter(|_| self.is_against())?;
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Turns by odometry, radians, each in steps of so much with a metre driven before it; scans turn by so many times as much.
    fn turned(turns_rad: &[f64], step_rad: f64, times: impl Fn(usize) -> f64) -> Turns {
        let (mut turns, mut odom, mut map_rad) = (Turns::default(), Pose2::IDENTITY, 0.0);
        for (k, &turn_rad) in turns_rad.iter().enumerate() {
            odom = odom * Pose2::new(1.2, 0.0, 0.0);
            turns.see(Some(odom), map_rad);
            for _ in 0..(turn_rad.abs() / step_rad).round() as usize {
                odom = odom * Pose2::new(0.0, 0.0, step_rad * turn_rad.signum());
                map_rad += times(k) * step_rad * turn_rad.signum();
                turns.see(Some(odom), map_rad);
            }
        }
        turns
    }

    #[test]
    fn many_turns_tell_that_scans_turn_the_other_way_and_a_single_one_does_not() {
        let way = [1.5, -1.5, 1.5, 1.5, -1.5, 1.5];
        for step_rad in [0.05, 0.75] {
            assert!(turned(&way, step_rad, |_| -1.0).is_against(), "{step_rad}");
            assert!(!turned(&way, step_rad, |_| 1.0).is_against(), "{step_rad}");
            // Lifted and turned while the wheels count the other way, among sound turns and alone.
            let lifted = |k| if k == 2 { -1.0 } else { 1.0 };
            assert!(!turned(&[1.0, -1.5, 9.0, 0.6], step_rad, lifted).is_against(), "{step_rad}");
            assert!(!turned(&[9.0], step_rad, |_| -1.0).is_against(), "{step_rad}");
        }
        // A step that no match bears out, neither as odometry has it nor the other way.
        assert!(!turned(&[0.4, -3.0, -0.4, 0.4], 0.4, |k| if k == 1 { -0.9 } else { 1.0 }).is_against());
    }
}
