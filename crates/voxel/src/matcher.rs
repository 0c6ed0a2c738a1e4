//! Clouds matched against surfels: the pose of greatest likelihood, coarse resolutions first.

use crate::surfel_map::{Level, SurfelMap};
use mapwright_geom::{Cov6, Pose3};
use nalgebra::{Matrix3, Matrix6, UnitQuaternion, Vector3, Vector6};

/// How clouds are matched.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatcherSettings {
    /// Steps at most, at each resolution.
    pub steps: usize,
    /// Points at most, at the finest resolution; others are passed over evenly.
    pub points: usize,
    /// The kernel's width: so many times the median residual of points on surfels.
    pub kernel_medians: f64,
    /// A point fits whose residual is below so many standard deviations of its surfel.
    pub fit_sigmas: f64,
}

impl Default for MatcherSettings {
    fn default() -> Self {
        Self { steps: 15, points: 4000, kernel_medians: 3.0, fit_sigmas: 3.0 }
    }
}

/// What is known of the pose before the cloud is looked at.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// Where the cloud is thought to be.
    pub map_from_cloud: Pose3,
    /// Information of its right perturbation, translation first.
    pub information: Cov6,
}

/// A match.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fit {
    /// The pose.
    pub map_from_cloud: Pose3,
    /// Information of its right perturbation by the points alone, each taken for independent.
    pub information: Cov6,
    /// Share of the points that lie in voxels with a surfel, at the finest resolution.
    pub known_share: f64,
    /// Share of those that fit it.
    pub inlier_share: f64,
    /// Mean robust cost of a known point.
    pub cost: f64,
    /// Evaluations of the objective.
    pub evaluations: u32,
}

/// Matches clouds; keeps its buffers.
#[derive(Debug, Clone, Default)]
pub struct Matcher {
    /// Its settings.
    pub settings: MatcherSettings,
    points: Vec<[f64; 3]>,
    residuals: Vec<f32>,
}

/// The objective and its derivatives around a pose, by a perturbation about the cloud's origin along the map's axes.
#[derive(Debug, Clone, Copy)]
struct Evaluation {
    cost: f64,
    gradient: Vector6<f64>,
    hessian: Matrix6<f64>,
    known: u32,
    fitting: u32,
}

impl Matcher {
    /// A matcher.
    #[must_use]
    pub fn new(settings: MatcherSettings) -> Self {
        Self { settings, ..Self::default() }
    }

    /// Climbs from `start` through the resolutions, the coarsest first.
    pub fn climb(&mut self, map: &SurfelMap, points_m: &[[f32; 3]], prior: &Prior, start: Pose3) -> Fit {
        self.climb_from(map, points_m, prior, start, map.levels().len())
    }

    /// The same, from one of the resolutions on: that many are used.
    pub fn climb_from(
        &mut self,
        map: &SurfelMap,
        points_m: &[[f32; 3]],
        prior: &Prior,
        start: Pose3,
        levels: usize,
    ) -> Fit {
        let mut pose = start;
        let mut evaluations = 0;
        for level in map.levels()[..levels].iter().rev() {
            self.take_points(points_m, self.settings.points);
            pose = self.climb_level(level, prior, pose, &mut evaluations);
        }
        let level = &map.levels()[0];
        let width2 = self.width2(level, pose);
        let at = self.evaluate(level, pose, width2);
        let rotation = pose.rotation.to_rotation_matrix().into_inner();
        let mut body = Matrix6::zeros();
        body.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
        body.fixed_view_mut::<3, 3>(3, 3).copy_from(&rotation);
        let share = |part: u32, all: u32| if all == 0 { 0.0 } else { f64::from(part) / f64::from(all) };
        Fit {
            map_from_cloud: pose,
            information: body.transpose() * at.hessian * body,
            known_share: share(at.known, self.points.len() as u32),
            inlier_share: share(at.fitting, at.known),
            cost: at.cost / f64::from(at.known.max(1)),
            evaluations: evaluations + 1,
        }
    }

    fn take_points(&mut self, points_m: &[[f32; 3]], most: usize) {
        let every = points_m.len().div_ceil(most.max(1)).max(1);
        self.points.clear();
        self.points.extend(points_m.iter().step_by(every).map(|point| point.map(f64::from)));
    }

    fn climb_level(&mut self, level: &Level, prior: &Prior, start: Pose3, evaluations: &mut u32) -> Pose3 {
        let mut pose = start;
        let mut damping = 0.0;
        let width2 = self.width2(level, pose);
        let mut width2 = width2;
        let mut at = self.with_prior(prior, pose, self.evaluate(level, pose, width2));
        *evaluations += 2;
        for step_number in 0..self.settings.steps {
            let diagonal = Matrix6::from_diagonal(&at.hessian.diagonal().map(|v| damping * v + 1e-9));
            let Some(step) = (at.hessian + diagonal).cholesky().map(|factor| factor.solve(&-at.gradient)) else { break };
            let next = moved(pose, &step);
            let tried = self.with_prior(prior, next, self.evaluate(level, next, width2));
            *evaluations += 1;
            if tried.cost <= at.cost {
                pose = next;
                at = tried;
                damping *= 0.3;
                let small = step.fixed_rows::<3>(0).norm() < 1e-3 * level.size_m && step.fixed_rows::<3>(3).norm() < 1e-4;
                if small {
                    break;
                }
                if step_number % 3 == 2 {
                    width2 = self.width2(level, pose);
                    at = self.with_prior(prior, pose, self.evaluate(level, pose, width2));
                    *evaluations += 1;
                }
            } else {
                damping = if damping == 0.0 { 1e-3 } else { damping * 10.0 };
                if damping > 1e6 {
                    break;
                }
            }
        }
        pose
    }

    /// Squared width of the kernel: what residuals are like there.
    fn width2(&mut self, level: &Level, pose: Pose3) -> f64 {
        let rotation = pose.rotation.to_rotation_matrix();
        self.residuals.clear();
        for point in &self.points {
            let at = rotation * Vector3::from(*point) + pose.translation;
            if let Some(surfel) = level.surfel_at(at.into()) {
                let (_, d2) = pulled(surfel, at);
                self.residuals.push(d2 as f32);
            }
        }
        if self.residuals.is_empty() {
            return 1.0;
        }
        let middle = self.residuals.len() / 2;
        let median = f64::from(*self.residuals.select_nth_unstable_by(middle, f32::total_cmp).1);
        (self.settings.kernel_medians.powi(2) * median).max(1.0)
    }

    fn with_prior(&self, prior: &Prior, pose: Pose3, mut at: Evaluation) -> Evaluation {
        let error = prior.map_from_cloud.between(pose).log();
        let rotation = pose.rotation.to_rotation_matrix().into_inner();
        let mut body = Matrix6::zeros();
        body.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
        body.fixed_view_mut::<3, 3>(3, 3).copy_from(&rotation);
        at.cost += 0.5 * error.dot(&(prior.information * error));
        at.gradient += body * (prior.information * error);
        at.hessian += body * prior.information * body.transpose();
        at
    }

    /// Cauchy's kernel over squared residuals in standard deviations.
    fn evaluate(&self, level: &Level, pose: Pose3, width2: f64) -> Evaluation {
        let rotation = pose.rotation.to_rotation_matrix();
        let mut gradient = Vector6::zeros();
        let mut hessian = Matrix6::zeros();
        let (mut cost, mut known, mut fitting) = (0.0, 0, 0);
        let fit2 = self.settings.fit_sigmas.powi(2);
        let unknown_cost = 0.5 * width2 * (1.0_f64 + 9.0).ln();
        for point in &self.points {
            let arm = rotation * Vector3::from(*point);
            let at = arm + pose.translation;
            let Some(surfel) = level.surfel_at(at.into()) else {
                cost += unknown_cost;
                continue;
            };
            let (pull, d2) = pulled(surfel, at);
            known += 1;
            fitting += u32::from(d2 < fit2);
            cost += (0.5 * width2 * (1.0 + d2 / width2).ln()).min(unknown_cost);
            let weight = 1.0 / (1.0 + d2 / width2);
            let [xx, xy, xz, yy, yz, zz] = surfel.information.map(f64::from);
            let omega = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz) * weight;
            let pull = pull * weight;
            // of `at` by a turn: -[arm]x
            let cross = arm.cross_matrix();
            let omega_cross = omega * cross;
            let turn = cross.transpose() * omega_cross;
            for row in 0..3 {
                for column in 0..3 {
                    hessian[(row, column)] += omega[(row, column)];
                    hessian[(row, column + 3)] -= omega_cross[(row, column)];
                    hessian[(row + 3, column + 3)] += turn[(row, column)];
                }
                gradient[row] += pull[row];
            }
            let torque = arm.cross(&pull);
            for row in 0..3 {
                gradient[row + 3] += torque[row];
            }
        }
        for row in 0..3 {
            for column in 0..3 {
                hessian[(row + 3, column)] = hessian[(column, row + 3)];
            }
        }
        Evaluation { cost, gradient, hessian, known, fitting }
    }
}

/// `information * (at - mean)`, and the squared residual in standard deviations.
#[inline]
fn pulled(surfel: &crate::surfel::Surfel, at: Vector3<f64>) -> (Vector3<f64>, f64) {
    let error = at - Vector3::from(surfel.mean_m.map(f64::from));
    let [xx, xy, xz, yy, yz, zz] = surfel.information.map(f64::from);
    let pull = Vector3::new(
        xx * error.x + xy * error.y + xz * error.z,
        xy * error.x + yy * error.y + yz * error.z,
        xz * error.x + yz * error.y + zz * error.z,
    );
    (pull, error.dot(&pull))
}

fn moved(pose: Pose3, step: &Vector6<f64>) -> Pose3 {
    let turn = UnitQuaternion::from_scaled_axis(step.fixed_rows::<3>(3).into_owned());
    let mut rotation = turn * pose.rotation;
    rotation.renormalize();
    Pose3 { translation: pose.translation + step.fixed_rows::<3>(0), rotation }
}
