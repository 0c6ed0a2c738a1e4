//! Clouds that take time: the pose in the middle and the motion during the sweep, matched together.
//!
//! A sweep is a piece of a trajectory. Its points, undistorted by a motion that is wrong, lie bent; how the robot moved follows from that
//! as its pose does (Dellenbach et al. 2022, "CT-ICP: real-time elastic lidar odometry with loop closure", sec. III; here one twist
//! beside the pose, with what is known of it as its prior).

use super::{Eyes, Fit, Level, Matcher, POINTS_AS_ONE, Prior, Sums, along_body, held, surfel_seen};
use crate::surfel_map::SurfelMap;
use mapwright_geom::{Cov6, Pose3};
use nalgebra::{Matrix6, Vector3, Vector6};

/// A cloud, and when each of its points was taken.
#[derive(Debug, Clone, Copy, Default)]
pub struct Seen<'a> {
    /// Points in its frame, metres.
    pub points_m: &'a [[f32; 3]],
    /// Seconds after its middle, of each point; none where they were taken at once.
    pub times_s: &'a [f32],
    /// Where they were seen from, in that frame, metres: one place for all, or one for each; none where that is not known, and both sides of a
    /// surface are one.
    pub origins_m: &'a [[f32; 3]],
    /// Standard deviation of each along its ray, metres; none where the surfels' own says all.
    pub sigmas_m: &'a [f32],
}

impl<'a> From<&'a [[f32; 3]]> for Seen<'a> {
    fn from(points_m: &'a [[f32; 3]]) -> Self {
        Self { points_m, times_s: &[], origins_m: &[], sigmas_m: &[] }
    }
}

impl<'a> From<&'a Vec<[f32; 3]>> for Seen<'a> {
    fn from(points_m: &'a Vec<[f32; 3]>) -> Self {
        points_m.as_slice().into()
    }
}

/// Where a match begins, or what it comes to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Start {
    /// Where the cloud is, in its middle.
    pub map_from_cloud: Pose3,
    /// How it moves besides that by which its points were undistorted: metres and radians a second along its axes.
    pub twist_per_s: Vector6<f64>,
}

impl From<Pose3> for Start {
    fn from(map_from_cloud: Pose3) -> Self {
        Self { map_from_cloud, twist_per_s: Vector6::zeros() }
    }
}

/// What is known of the motion during a sweep, beside that by which its points were undistorted: metres and radians a second along the
/// cloud's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TwistPrior {
    /// What it is thought to be.
    pub twist_per_s: Vector6<f64>,
    /// Information of that.
    pub information: Cov6,
}

/// A match of a sweep.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BentFit {
    /// Of its middle; information is what is left of it where the motion is not known but by the prior and the points.
    pub fit: Fit,
    /// The motion, as in the prior.
    pub twist_per_s: Vector6<f64>,
    /// Covariance of that.
    pub covariance: Cov6,
    unlikeliness: f64,
}

impl BentFit {
    /// Log likelihood by points and both priors.
    #[must_use]
    pub fn posterior(&self, prior: &Prior) -> f64 {
        self.fit.posterior(prior) - self.unlikeliness
    }
}

/// At each resolution pose and motion are followed so often.
const ROUNDS: usize = 2;

/// What the points say of the motion at a pose, after the pose that is best for each motion; along the map's axes.
struct Reduced {
    gradient: Vector6<f64>,
    hessian: Matrix6<f64>,
    /// Of the pose, after the motion that is best for each.
    of_pose: Matrix6<f64>,
}

impl Matcher {
    /// Climbs as [`Matcher::climb_near`] does, the motion during the sweep along with the pose; the start, as it was undistorted, if that
    /// is no likelier.
    pub fn climb_bent(
        &mut self,
        map: &SurfelMap,
        seen: Seen<'_>,
        (prior, start): (&Prior, Pose3),
        motion: &TwistPrior,
    ) -> BentFit {
        self.take_points(seen, self.settings.points);
        let still = Vector6::zeros();
        let before = self.bent_fit(map.levels(), prior, start, (motion, still), 0);
        let (mut pose, mut twist_per_s, mut evaluations) = (start, motion.twist_per_s, before.fit.evaluations);
        self.bend(&twist_per_s);
        for finest in (0..map.levels().len().div_ceil(2)).rev() {
            let levels = &map.levels()[finest..];
            for _ in 0..ROUNDS {
                pose = self.climb_level(levels, prior, pose, self.settings.steps, &mut evaluations);
                let Some(step) = self.twist_step(levels, prior, pose, (motion, &twist_per_s)) else { break };
                twist_per_s += step;
                self.bend(&twist_per_s);
            }
        }
        pose = self.climb_level(map.levels(), prior, pose, self.settings.steps, &mut evaluations);
        let bent = self.bent_fit(map.levels(), prior, pose, (motion, twist_per_s), evaluations);
        if bent.posterior(prior) >= before.posterior(prior) { bent } else { before }
    }

    fn bent_fit(
        &mut self,
        levels: &[Level],
        prior: &Prior,
        pose: Pose3,
        (motion, twist_per_s): (&TwistPrior, Vector6<f64>),
        evaluations: u32,
    ) -> BentFit {
        let mut fit = self.fit(levels, pose, evaluations);
        let reduced = self.reduced(levels, prior, pose, &motion.information);
        let body = along_body(pose);
        fit.information = body.transpose() * reduced.of_pose * body;
        let covariance = (body.transpose() * reduced.hessian * body).try_inverse();
        let off = twist_per_s - motion.twist_per_s;
        let unlikeliness = 0.5 * off.dot(&(motion.information * off)) * POINTS_AS_ONE / self.points.len().max(1) as f64;
        let covariance = covariance.map_or_else(Cov6::zeros, |covariance| covariance * POINTS_AS_ONE);
        BentFit { fit, twist_per_s, covariance, unlikeliness }
    }

    /// Bends a cloud that took time as such a motion does.
    pub(super) fn bend(&mut self, twist_per_s: &Vector6<f64>) {
        for ((point, straight), time_s) in self.points.iter_mut().zip(&self.straight).zip(&self.times) {
            *point = Pose3::exp(twist_per_s * *time_s).transform(Vector3::from(*straight)).into();
        }
        self.forget_voxels();
    }

    /// By how much the motion should differ, along the cloud's axes, a second.
    fn twist_step(
        &mut self,
        levels: &[Level],
        prior: &Prior,
        pose: Pose3,
        (motion, twist_per_s): (&TwistPrior, &Vector6<f64>),
    ) -> Option<Vector6<f64>> {
        let reduced = self.reduced(levels, prior, pose, &motion.information);
        let body = along_body(pose);
        let pull = motion.information * (twist_per_s - motion.twist_per_s) * POINTS_AS_ONE;
        let step = reduced.hessian.cholesky()?.solve(&-(reduced.gradient + body * pull));
        Some(body.transpose() * step)
    }

    /// A point taken so long after the middle moves with the twist by that much of what it moves with the pose.
    fn reduced(&mut self, levels: &[Level], prior: &Prior, pose: Pose3, of_motion: &Cov6) -> Reduced {
        let width2 = self.width2(levels, pose);
        let rotation = pose.rotation.to_rotation_matrix();
        let eyes = Eyes::new((&self.origins, &self.sigmas), rotation);
        let mut sums = [Sums::default(); 3];
        let points = self.points.iter().zip(&mut self.looked).zip(&self.times);
        for (number, ((point, looked), &time_s)) in points.enumerate() {
            let arm = rotation * Vector3::from(*point);
            let at = arm + pose.translation;
            let Some(surfel) = surfel_seen(levels, (arm, eyes.of(number)), at, looked) else { continue };
            let (off_m, information) = (surfel.off_m(at), eyes.information(number, surfel, arm));
            let widths2 = information * off_m * off_m / width2;
            if widths2 >= super::UNKNOWN_WIDTHS2 {
                continue;
            }
            let (weight, normal) = (information / (1.0 + widths2), surfel.normal.map(f64::from));
            for (sums, of_time) in sums.iter_mut().zip([1.0, time_s, time_s * time_s]) {
                sums.add(weight * of_time, off_m, normal, &arm);
            }
        }
        let body = along_body(pose);
        let mut parts = sums.map(|sums| sums.derivatives());
        // By one scale, or the two would not agree on what is open.
        if let (Some(scale), _) = held(&parts[0].1) {
            for (gradient, hessian) in &mut parts {
                *gradient = scale * scale * *gradient;
                *hessian = scale * *hessian * scale;
            }
        }
        let [of_pose, across, of_twist] = parts;
        let error = prior.map_from_cloud.between(pose).log();
        let of_prior = prior.information * POINTS_AS_ONE;
        let pose_gradient = of_pose.0 + body * (of_prior * error);
        let with_prior = of_pose.1 + body * of_prior * body.transpose();
        let twist_hessian = of_twist.1 + body * of_motion * body.transpose() * POINTS_AS_ONE;
        let through_pose = with_prior.try_inverse().map_or_else(Matrix6::zeros, |inverse| across.1 * inverse);
        let through_twist = twist_hessian.try_inverse().map_or_else(Matrix6::zeros, |inverse| across.1 * inverse);
        Reduced {
            gradient: across.0 - through_pose * pose_gradient,
            hessian: twist_hessian - through_pose * across.1,
            of_pose: of_pose.1 - through_twist * across.1,
        }
    }
}
