//! How far odometry is believed. Written once for the plane and for space.

use crate::settings::MotionSettings;
use mapwright_geom::{Pose2, stored};
use mapwright_sensor::MotionModel;

/// Odometry is believed as it deserves: weight of the newest scan, how much worse than the model it may be at most, and
/// the least share of a correction that is the scan's own.
const WRONG_WEIGHT: f64 = 0.01;
pub(crate) const WORSE_AT_MOST: f64 = 25.0;
const LEAST_GAIN: f64 = 0.3;
/// From so many times the model's variance on a slip would not be seen in it.
const DOUBTED: f64 = 1.2;

/// What odometry has been wrong by of late, and what the model expected: variances of translation and of rotation.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct OdometryTrust {
    wrong: [[f64; 2]; 2],
}

stored!(OdometryTrust { wrong });

impl OdometryTrust {
    /// How many times the model's variances odometry errs by, of translation and of rotation.
    pub(crate) fn worse(&self) -> [f64; 2] {
        self.wrong.map(|[was, expected]| if expected > 0.0 { (was / expected).clamp(1.0, WORSE_AT_MOST) } else { 1.0 })
    }

    /// A match that knew its pose by itself, to a variance `scan` of this component (0 translation, 1 rotation), has moved the prediction by
    /// `correction`, which had the variance `prior`, and by the model alone `expected`.
    pub(crate) fn observe(&mut self, kind: usize, correction: f64, [prior, expected]: [f64; 2], scan: f64) {
        let gain = prior / (prior + scan);
        if gain < LEAST_GAIN || !gain.is_finite() {
            return;
        }
        // One match that is wrong itself must not make odometry worthless for long; a hair more, so that the most is reached.
        let most = (1.0 + 1e-9) * WORSE_AT_MOST * expected;
        let seen = ((correction / gain).powi(2) - scan).min(most);
        let [was, was_expected] = &mut self.wrong[kind];
        *was += WRONG_WEIGHT * (seen - *was);
        *was_expected += WRONG_WEIGHT * (expected - *was_expected);
    }

    /// Whether odometry's translations have lately been much worse than its model.
    pub(crate) fn doubts(&self) -> bool {
        let [was, expected] = self.wrong[0];
        was > DOUBTED * expected
    }

    /// Whether these are numbers that it may have come to.
    pub(crate) fn is_sound(&self, largest: f64) -> bool {
        self.wrong.as_flattened().iter().all(|number| number.abs() <= largest)
    }
}

/// Variances of a motion by odometry, of x, y and heading, over a gap of so many steps as long as may be without being one: each adds its own.
pub(crate) fn odometry_variances(settings: &MotionSettings, motion: Pose2, elapsed_s: f64, steps: f64) -> [f64; 3] {
    let model = MotionModel {
        alpha1: settings.alpha1,
        alpha2: settings.alpha2,
        alpha3: settings.alpha3,
        alpha4: settings.alpha4,
    };
    let step = Pose2::new(motion.x.hypot(motion.y) / steps, 0.0, motion.theta / steps);
    let spread = model.spread(if steps > 1.0 { step } else { motion });
    let floor_t =
        steps * settings.translation_floor_m.powi(2) + (settings.translation_per_second_m * elapsed_s).powi(2);
    let floor_r = steps * settings.rotation_floor_rad.powi(2) + (settings.rotation_per_second_rad * elapsed_s).powi(2);
    let rotation = steps * (spread.rotation1 + spread.rotation2) + floor_r;
    let translation = steps * spread.translation + floor_t;
    // Errors of heading on the way displace its end, by Pythagoras and the mean of the squares from 0 to 1.
    let swept = if steps > 1.0 { rotation * (motion.x * motion.x + motion.y * motion.y) / 3.0 } else { 0.0 };
    [translation + swept, translation + swept, rotation]
}
