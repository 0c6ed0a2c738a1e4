//! What odometry says of the motion between two clouds, and how far it is believed: as in the plane, beside what wheels do not see.

use crate::odometry::{OdometryTrust, odometry_variances};
use crate::settings::MotionSettings;
use mapwright_geom::{Cov6, Pose2, Pose3, is_in_place, stored};
use mapwright_sensor::Pace;

/// What wheels do not see, a share of the way: height, and the robot's roll and pitch, radians per metre.
const UNSEEN_SHARE: f64 = 0.05;
/// No odometry errs by more, metres and radians squared.
const LARGEST: f64 = 1e3;

/// What is remembered of odometry.
#[derive(Debug, Clone, Default)]
pub(super) struct Wheels {
    odom_from_robot: Option<Pose3>,
    pace: Pace,
    trust: OdometryTrust,
}
stored!(Wheels { odom_from_robot, pace, trust });

/// The components along which wheels are compared with matches: what of a tangent, and whether it is translation or rotation.
const COMPARED: [(usize, usize); 3] = [(0, 0), (1, 0), (5, 1)];

impl Wheels {
    /// The motion since the cloud before and its information, where odometry says one that a robot can have made; over so many steps as long
    /// as may be without being a gap, and by `lead` farther than its reading.
    pub(super) fn step(
        &self,
        settings: &MotionSettings,
        (odom_from_robot, lead): (Option<Pose3>, Option<Pose3>),
        (elapsed_s, steps): (f64, f64),
    ) -> Option<(Pose3, Cov6)> {
        let (last, now) = self.odom_from_robot.zip(odom_from_robot).filter(|_| settings.use_odometry)?;
        let motion = lead.map_or(last.between(now), |lead| last.between(now) * lead);
        let is_believed = is_in_place(motion) && self.pace.believes(elapsed_s, planar(motion));
        is_believed.then(|| (motion, self.information(settings, motion, (elapsed_s, steps))))
    }

    fn information(&self, settings: &MotionSettings, motion: Pose3, (elapsed_s, steps): (f64, f64)) -> Cov6 {
        let [x, y, heading] = odometry_variances(settings, planar(motion), elapsed_s, steps);
        let [translation, rotation] = self.trust.worse();
        let sigmas = [translation * x, translation * y, rotation * heading].map(f64::sqrt);
        let unseen = UNSEEN_SHARE * motion.translation.norm();
        let floor_m = settings.translation_floor_m + settings.translation_per_second_m * elapsed_s;
        let floor_rad = settings.rotation_floor_rad + settings.rotation_per_second_rad * elapsed_s;
        let tilt = floor_rad + unseen;
        let sigmas = [sigmas[0], sigmas[1], floor_m + unseen, tilt, tilt, sigmas[2]];
        Cov6::from_diagonal(&sigmas.map(|sigma| 1.0 / (sigma * sigma)).into())
    }

    /// A match that alone knew the pose to `information` has put it so far from where wheels had it that told of such a motion, whose
    /// information was `told`; of their turns nothing where another sensor told these.
    pub(super) fn observe(
        &mut self,
        settings: &MotionSettings,
        (motion, elapsed_s, steps): (Pose3, f64, f64),
        (told, tell_turns): (&Cov6, bool),
        (correction, information): (Pose3, &Cov6),
    ) {
        let Some(scan) = information.try_inverse() else { return };
        let by_model = odometry_variances(settings, planar(motion), elapsed_s, steps);
        let correction = correction.log();
        let compared = by_model.into_iter().zip(COMPARED).filter(|(_, (_, kind))| *kind == 0 || tell_turns);
        for (expected, (axis, kind)) in compared {
            let prior = [1.0 / told[(axis, axis)], expected];
            self.trust.observe(kind, correction[axis], prior, scan[(axis, axis)]);
        }
    }

    /// Remembers a cloud: what odometry said with it, and else how the robot has moved.
    pub(super) fn settle(&mut self, elapsed_s: f64, odom_from_robot: Option<Pose3>, moved: Option<Pose3>) {
        let odom_from_robot = odom_from_robot.filter(|pose| is_in_place(*pose));
        if let Some((last, now)) = self.odom_from_robot.zip(odom_from_robot) {
            self.pace.add(elapsed_s, planar(last.between(now)));
        }
        let driven = || self.odom_from_robot.zip(moved).map(|(last, moved)| last * moved).or(self.odom_from_robot);
        self.odom_from_robot = odom_from_robot.or_else(driven);
    }

    /// Whether these are numbers that it may have come to.
    pub(super) fn is_sound(&self) -> bool {
        self.odom_from_robot.is_none_or(is_in_place) && self.pace.is_sound() && self.trust.is_sound(LARGEST)
    }
}

/// The same motion as wheels count it: the way and the turn.
fn planar(motion: Pose3) -> Pose2 {
    Pose2::new(motion.translation.x, motion.translation.y, motion.rotation.scaled_axis().z)
}
