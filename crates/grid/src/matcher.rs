//! Maximum-likelihood matching of a scan against a live map.
//!
//! The objective is `log p(scan | pose, map) + log p(pose | prediction)` with the likelihood field of *Probabilistic
//! Robotics* (2005, section 6.4): each beam is a hit with density `exp(-q / (2 sigma^2))`, `q` its squared distance to
//! the nearest obstacle, or a random reading with the relative density `random_ratio`. Two optimisers climb it, damped
//! Gauss-Newton and the gradient ascent of Thrun, Burgard and Fox's chapter on fast incremental mapping.
//!
//! Both look a beam's obstacle up once per evaluation. A step counts only if the objective improves with every beam's
//! obstacle assigned anew.

use crate::field::NO_OBSTACLE;
use crate::live::LiveMap;
use crate::tiles::{NO_TILE, cell_in_tile, floor_cell, tile_of};
use mapwright_geom::Pose2;
use nalgebra::{Matrix3, Vector3};

/// Where the robot is thought to be before the scan is seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Prior {
    /// The expected pose.
    pub world_from_robot: Pose2,
    /// Variances of its right perturbation: x and y in m^2, heading in rad^2.
    pub variances: [f64; 3],
    /// Weight of the tail: the density is Student's, like a normal's up to about `sqrt(tail)` standard deviations.
    pub tail: f64,
}

impl Prior {
    /// Negative log density (up to a constant), gradient and curvature at a pose.
    fn evaluate(&self, world_from_robot: Pose2) -> (f64, Vector3<f64>, Vector3<f64>) {
        let error = self.world_from_robot.between(world_from_robot).log();
        let mut cost = 0.0;
        let (mut gradient, mut curvature) = (Vector3::zeros(), Vector3::zeros());
        for k in 0..3 {
            let information = 1.0 / self.variances[k];
            let spread = 1.0 + error[k] * error[k] * information / self.tail;
            cost += 0.5 * self.tail * spread.ln();
            curvature[k] = information / spread;
            gradient[k] = curvature[k] * error[k];
        }
        (cost, gradient, curvature)
    }
}

/// Settings of the sensor model and the optimisers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatcherSettings {
    /// Standard deviation of a hit in the last stage, metres.
    pub sigma_m: f64,
    /// Standard deviation of a hit in the first stage, metres.
    pub capture_sigma_m: f64,
    /// Density of random readings relative to a hit at distance zero.
    pub random_ratio: f64,
    /// Beams are correlated: a scan's log likelihood counts with this share of its beams' sum.
    pub beam_share: f64,
    /// Evaluations of the objective a stage may use.
    pub max_evaluations: u32,
    /// Converged when a step of the last stage is shorter, metres (and radians).
    pub step_m: f64,
}

impl Default for MatcherSettings {
    fn default() -> Self {
        Self { sigma_m: 0.03, capture_sigma_m: 0.15, random_ratio: 0.01, beam_share: 1.0, max_evaluations: 30, step_m: 5e-4 }
    }
}

/// The scan's term at one pose; derivatives are with respect to a right perturbation of the pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Evaluation {
    /// Negative log likelihood, up to a constant.
    pub cost: f64,
    /// Gradient of the cost with every beam's obstacle held fixed.
    pub gradient: Vector3<f64>,
    /// Gauss-Newton Hessian of the cost.
    pub hessian: Matrix3<f64>,
    /// Sum over the beams of the posterior probability that they were hits.
    pub hits: f64,
}

/// Outcome of a match.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatchResult {
    /// The best pose found.
    pub world_from_robot: Pose2,
    /// Objective there: negative log likelihood of scan and prior, up to a constant.
    pub cost: f64,
    /// Gauss-Newton Hessian of the scan's term alone.
    pub hessian: Matrix3<f64>,
    /// Evaluations used, one field look-up a beam each.
    pub evaluations: u32,
}

/// The matcher.
#[derive(Debug, Clone, Default)]
pub struct Matcher {
    /// Its settings.
    pub settings: MatcherSettings,
}

/// Objective of scan and prior at one pose.
#[derive(Clone, Copy)]
struct Objective {
    cost: f64,
    gradient: Vector3<f64>,
    hessian: Matrix3<f64>,
    scan_hessian: Matrix3<f64>,
    hits: f64,
}

impl Matcher {
    /// The scan's term at a pose; `points` are end points in the robot's frame, metres.
    #[must_use]
    pub fn evaluate(&self, map: &LiveMap, points: &[[f64; 2]], world_from_robot: Pose2, sigma_m: f64) -> Evaluation {
        let (s, c) = world_from_robot.theta.sin_cos();
        let cells_per_m = 1.0 / map.settings.resolution_m;
        let scale = 0.5 / (sigma_m * sigma_m);
        let (field, surfels) = (map.field(), map.surfels());
        let random = self.settings.random_ratio;
        let mut missed = 0_u32;
        let (mut log_sum, mut product, mut hits) = (0.0, 1.0, 0.0);
        let (mut gx, mut gy, mut gt) = (0.0, 0.0, 0.0);
        let (mut hxx, mut hxy, mut hyy, mut hxt, mut hyt, mut htt) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        let mut current = (i32::MIN, i32::MIN);
        let mut tile = NO_TILE;
        for &[px, py] in points {
            let (rx, ry) = (c * px - s * py, s * px + c * py);
            let (wx, wy) = (world_from_robot.x + rx, world_from_robot.y + ry);
            let (cell_x, cell_y) = (floor_cell(wx * cells_per_m), floor_cell(wy * cells_per_m));
            if tile_of(cell_x, cell_y) != current {
                current = tile_of(cell_x, cell_y);
                tile = field.tile_number(current);
            }
            let slot = if tile == NO_TILE {
                NO_OBSTACLE
            } else {
                field.tiles[tile as usize].nearest[cell_in_tile(cell_x, cell_y)]
            };
            if slot == NO_OBSTACLE {
                missed += 1;
                continue;
            }
            let surfel = &surfels[slot as usize];
            let (dx, dy) = (wx - surfel.x, wy - surfel.y);
            let (axx, axy, ayy) = (f64::from(surfel.axx), f64::from(surfel.axy), f64::from(surfel.ayy));
            let (ex, ey) = (axx * dx + axy * dy, axy * dx + ayy * dy);
            let hit = exp_of_negative((dx * ex + dy * ey) * scale);
            let total = hit + random;
            // One logarithm for many factors: their product stays above 1e-200.
            product *= total;
            if product < 1e-100 {
                log_sum += product.ln();
                product = 1.0;
            }
            let w = hit / total;
            hits += w;
            // The end point turns about the robot: d(wx, wy)/d(theta) = (-ry, rx).
            let (tx, ty) = (axy * rx - axx * ry, ayy * rx - axy * ry);
            gx += w * ex;
            gy += w * ey;
            gt += w * (ey * rx - ex * ry);
            hxx += w * axx;
            hxy += w * axy;
            hyy += w * ayy;
            hxt += w * tx;
            hyt += w * ty;
            htt += w * (ty * rx - tx * ry);
        }
        log_sum += product.ln();
        let cost = -log_sum - f64::from(missed) * random.ln();
        // The sums are over a translation in the world's frame; a right perturbation's is in the robot's.
        let world_from_tangent = Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0);
        let k = 2.0 * scale;
        let gradient = world_from_tangent.transpose() * Vector3::new(gx, gy, gt) * k;
        let sums = Matrix3::new(hxx, hxy, hxt, hxy, hyy, hyt, hxt, hyt, htt);
        let hessian = world_from_tangent.transpose() * sums * world_from_tangent * k;
        Evaluation { cost, gradient, hessian, hits }
    }

    fn objective(&self, map: &LiveMap, points: &[[f64; 2]], prior: &Prior, pose: Pose2, sigma_m: f64) -> Objective {
        let scan = self.evaluate(map, points, pose, sigma_m);
        let share = self.settings.beam_share;
        let (cost, gradient, curvature) = prior.evaluate(pose);
        Objective {
            cost: scan.cost * share + cost,
            gradient: scan.gradient * share + gradient,
            hessian: scan.hessian * share + Matrix3::from_diagonal(&curvature),
            scan_hessian: scan.hessian,
            hits: scan.hits,
        }
    }

    /// The stages' standard deviations: wide to capture, then narrow to be exact.
    fn stages(&self) -> [f64; 3] {
        let (wide, narrow) = (self.settings.capture_sigma_m.max(self.settings.sigma_m), self.settings.sigma_m);
        [wide, (wide * narrow).sqrt(), narrow]
    }

    /// Damped Gauss-Newton (Levenberg 1944, Marquardt 1963), stage by stage.
    #[must_use]
    pub fn gauss_newton(&self, map: &LiveMap, points: &[[f64; 2]], prior: &Prior, start: Pose2) -> MatchResult {
        self.climb(map, points, prior, start, Self::gauss_newton_stage)
    }

    /// Gradient ascent with one adaptive step length, stage by stage.
    ///
    /// Steps are `kappa diag(1, 1, 1/L^2) grad / sum of weights` with `L` the rms range: the scaling makes a metre and a
    /// radian count alike, so that one `kappa` serves both.
    #[must_use]
    pub fn gradient_ascent(&self, map: &LiveMap, points: &[[f64; 2]], prior: &Prior, start: Pose2) -> MatchResult {
        self.climb(map, points, prior, start, Self::gradient_stage)
    }

    fn climb(
        &self,
        map: &LiveMap,
        points: &[[f64; 2]],
        prior: &Prior,
        start: Pose2,
        stage: impl Fn(&Self, &Problem<'_>, Pose2) -> (Pose2, Objective, u32),
    ) -> MatchResult {
        let stages = self.stages();
        let mut pose = start;
        let mut evaluations = 0;
        let mut last = None;
        for (k, &sigma_m) in stages.iter().enumerate() {
            let final_stage = k + 1 == stages.len();
            let tolerance_m = if final_stage { self.settings.step_m } else { 0.2 * sigma_m };
            let problem = Problem { map, points, prior, sigma_m, tolerance_m };
            let (better, objective, used) = stage(self, &problem, pose);
            pose = better;
            evaluations += used;
            last = Some(objective);
        }
        let (cost, hessian) = last.map_or((0.0, Matrix3::zeros()), |o| (o.cost, o.scan_hessian));
        MatchResult { world_from_robot: pose, cost, hessian, evaluations }
    }

    fn at(&self, problem: &Problem<'_>, pose: Pose2) -> Objective {
        self.objective(problem.map, problem.points, problem.prior, pose, problem.sigma_m)
    }

    fn gauss_newton_stage(&self, problem: &Problem<'_>, start: Pose2) -> (Pose2, Objective, u32) {
        let mut pose = start;
        let mut here = self.at(problem, pose);
        let mut evaluations = 1;
        let mut damping = 1e-4;
        while evaluations < self.settings.max_evaluations {
            let mut damped = here.hessian;
            for k in 0..3 {
                damped[(k, k)] *= 1.0 + damping;
            }
            let Some(factor) = damped.cholesky() else { break };
            let step = -factor.solve(&here.gradient);
            if step[0].hypot(step[1]).max(step[2].abs()) < problem.tolerance_m {
                break;
            }
            let next_pose = pose * Pose2::exp(step.into());
            let next = self.at(problem, next_pose);
            evaluations += 1;
            if next.cost <= here.cost {
                (pose, here) = (next_pose, next);
                damping = (damping * 0.1_f64).max(1e-6);
            } else {
                damping = (damping * 10.0_f64).max(0.1);
                if damping > 1e4 {
                    break;
                }
            }
        }
        (pose, here, evaluations)
    }

    fn gradient_stage(&self, problem: &Problem<'_>, start: Pose2) -> (Pose2, Objective, u32) {
        let squares: f64 = problem.points.iter().map(|p| p[0] * p[0] + p[1] * p[1]).sum();
        let lever2 = (squares / problem.points.len().max(1) as f64).max(1e-6);
        let variance = problem.sigma_m * problem.sigma_m;
        let mut pose = start;
        let mut here = self.at(problem, pose);
        let mut evaluations = 1;
        let mut kappa = 1.0;
        while evaluations < self.settings.max_evaluations {
            let k = kappa * variance / here.hits.max(1e-6);
            let step = [-k * here.gradient[0], -k * here.gradient[1], -k * here.gradient[2] / lever2];
            if step[0].hypot(step[1]).max(step[2].abs()) < 0.2 * problem.tolerance_m {
                break;
            }
            let next_pose = pose * Pose2::exp(step);
            let next = self.at(problem, next_pose);
            evaluations += 1;
            if next.cost < here.cost {
                (pose, here) = (next_pose, next);
                kappa *= 1.5;
            } else {
                kappa *= 0.4;
            }
        }
        (pose, here, evaluations)
    }
}

/// `exp(-u)` for `u >= 0`, relative error below 2e-7; zero beyond 60.
///
/// `2^n` from the exponent's bits times a polynomial for the rest (minimax on `[-ln 2 / 2, ln 2 / 2]`).
fn exp_of_negative(u: f64) -> f64 {
    const ROUND: f64 = 6_755_399_441_055_744.0; // 1.5 * 2^52: adding it rounds to the nearest integer
    if !(u < 60.0) {
        return 0.0;
    }
    let t = -u * std::f64::consts::LOG2_E + ROUND;
    let n = t - ROUND;
    let r = -u - n * std::f64::consts::LN_2;
    let exp_r = 1.0 + r * (1.0 + r * (0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0 + r / 720.0)))));
    let power = f64::from_bits(((n as i64 + 1023) as u64) << 52);
    exp_r * power
}

/// One stage's problem.
struct Problem<'a> {
    map: &'a LiveMap,
    points: &'a [[f64; 2]],
    prior: &'a Prior,
    sigma_m: f64,
    tolerance_m: f64,
}
