//! The odometry motion model of *Probabilistic Robotics* (Thrun, Burgard, Fox 2005), section 5.4.

use mapwright_geom::{Pose2, wrap_angle};

/// Motion below which the direction of travel means nothing, metres.
const STILL_M: f64 = 0.01;

/// Noise of a wheeled robot's odometry: a step is a rotation, a translation and a second rotation, each with a variance
/// that grows with the squared motions (Table 5.5; the alphas multiply squared motions).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MotionModel {
    /// Rotation variance per squared rotation.
    pub alpha1: f64,
    /// Rotation variance per squared translation, rad^2/m^2.
    pub alpha2: f64,
    /// Translation variance per squared translation.
    pub alpha3: f64,
    /// Translation variance per squared rotation, m^2/rad^2.
    pub alpha4: f64,
}

/// A step's three motions, or the variances of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Decomposed {
    /// First rotation, towards the direction of travel, rad or rad^2.
    pub rotation1: f64,
    /// Translation, m or m^2.
    pub translation: f64,
    /// Second rotation, rad or rad^2.
    pub rotation2: f64,
}

impl Decomposed {
    /// Splits a relative pose; a robot that drives backwards does not first turn around.
    #[must_use]
    pub fn of(step: Pose2) -> Self {
        let translation = step.x.hypot(step.y);
        if translation < STILL_M {
            return Self { rotation1: 0.0, translation, rotation2: step.theta };
        }
        let heading = step.y.atan2(step.x);
        let backwards = heading.abs() > std::f64::consts::FRAC_PI_2;
        let rotation1 = if backwards { wrap_angle(heading + std::f64::consts::PI) } else { heading };
        Self {
            rotation1,
            translation: if backwards { -translation } else { translation },
            rotation2: wrap_angle(step.theta - rotation1),
        }
    }

    /// The relative pose again.
    #[must_use]
    pub fn to_pose(self) -> Pose2 {
        let (s, c) = self.rotation1.sin_cos();
        Pose2::new(self.translation * c, self.translation * s, self.rotation1 + self.rotation2)
    }
}

impl MotionModel {
    /// Variances of a step's three motions (Table 5.5, lines 7 to 9).
    #[must_use]
    pub fn spread(&self, step: Pose2) -> Decomposed {
        let motions = Decomposed::of(step);
        let (r1, t, r2) = (motions.rotation1.powi(2), motions.translation.powi(2), motions.rotation2.powi(2));
        Decomposed {
            rotation1: self.alpha1 * r1 + self.alpha2 * t,
            translation: self.alpha3 * t + self.alpha4 * (r1 + r2),
            rotation2: self.alpha1 * r2 + self.alpha2 * t,
        }
    }

    /// Log density of the true step `actual` when odometry reported `reported`, up to no constant (Table 5.5).
    ///
    /// `floors` are least variances of the three motions, so that a standing robot has a density too.
    #[must_use]
    pub fn log_density(&self, reported: Pose2, actual: Pose2, floors: Decomposed) -> f64 {
        let variances = self.spread(reported);
        let (said, was) = (Decomposed::of(reported), Decomposed::of(actual));
        log_normal(wrap_angle(was.rotation1 - said.rotation1), variances.rotation1 + floors.rotation1)
            + log_normal(was.translation - said.translation, variances.translation + floors.translation)
            + log_normal(wrap_angle(was.rotation2 - said.rotation2), variances.rotation2 + floors.rotation2)
    }

    /// A step drawn from the model (Table 5.6); `normals` are three independent standard normal numbers.
    #[must_use]
    pub fn sample(&self, reported: Pose2, normals: [f64; 3]) -> Pose2 {
        let (variances, said) = (self.spread(reported), Decomposed::of(reported));
        Decomposed {
            rotation1: said.rotation1 + normals[0] * variances.rotation1.sqrt(),
            translation: said.translation + normals[1] * variances.translation.sqrt(),
            rotation2: said.rotation2 + normals[2] * variances.rotation2.sqrt(),
        }
        .to_pose()
    }
}

fn log_normal(error: f64, variance: f64) -> f64 {
    -0.5 * (error * error / variance + (std::f64::consts::TAU * variance).ln())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const MODEL: MotionModel = MotionModel { alpha1: 0.02, alpha2: 0.01, alpha3: 0.03, alpha4: 0.005 };

    proptest! {
        #[test]
        fn a_step_survives_being_split(x in -2.0..2.0f64, y in -2.0..2.0f64, theta in -3.0..3.0f64) {
            let step = Pose2::new(x, y, theta);
            let again = Decomposed::of(step).to_pose();
            prop_assume!(x.hypot(y) >= STILL_M);
            prop_assert!(step.distance(again) < 1e-12 && wrap_angle(step.theta - again.theta).abs() < 1e-12);
        }
    }

    #[test]
    fn driving_backwards_is_no_turn_around() {
        let motions = Decomposed::of(Pose2::new(-0.5, 0.001, 0.0));
        assert!(motions.rotation1.abs() < 0.01 && motions.translation < 0.0);
    }

    #[test]
    fn samples_have_the_variances_of_the_density() {
        let reported = Pose2::new(0.5, 0.1, 0.4);
        let variances = MODEL.spread(reported);
        let said = Decomposed::of(reported);
        // Deterministic normals: the sum of twelve uniform numbers from a linear congruence.
        let mut state = 1_u64;
        let mut normal = || {
            (0..12)
                .map(|_| {
                    state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                    (state >> 11) as f64 / (1_u64 << 53) as f64
                })
                .sum::<f64>()
                - 6.0
        };
        let n = 20_000;
        let (mut sum_r1, mut sum_t, mut sum_r2) = (0.0, 0.0, 0.0);
        for _ in 0..n {
            let drawn = Decomposed::of(MODEL.sample(reported, [normal(), normal(), normal()]));
            sum_r1 += wrap_angle(drawn.rotation1 - said.rotation1).powi(2);
            sum_t += (drawn.translation - said.translation).powi(2);
            sum_r2 += wrap_angle(drawn.rotation2 - said.rotation2).powi(2);
        }
        for (sum, variance) in
            [(sum_r1, variances.rotation1), (sum_t, variances.translation), (sum_r2, variances.rotation2)]
        {
            assert!((sum / f64::from(n) / variance - 1.0).abs() < 0.05);
        }
    }

    #[test]
    fn the_density_integrates_to_one() {
        let reported = Pose2::new(0.5, 0.0, 0.2);
        let floors = Decomposed { rotation1: 1e-4, translation: 1e-4, rotation2: 1e-4 };
        let (mut total, step) = (0.0, 0.01);
        for i in -60..60 {
            for j in -60..60 {
                for k in -60..60 {
                    let said = Decomposed::of(reported);
                    let actual = Decomposed {
                        rotation1: said.rotation1 + f64::from(i) * step,
                        translation: said.translation + f64::from(j) * step,
                        rotation2: said.rotation2 + f64::from(k) * step,
                    };
                    if actual.translation > STILL_M && actual.rotation1.abs() < 1.5 {
                        total += MODEL.log_density(reported, actual.to_pose(), floors).exp() * step.powi(3);
                    }
                }
            }
        }
        assert!((total - 1.0).abs() < 0.02, "{total}");
    }
}
