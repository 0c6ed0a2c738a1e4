//! Maximum-likelihood matching of a scan against a local map.
//!
//! The objective is `log p(scan | pose, map) + log p(pose | prediction)` with the likelihood field of *Probabilistic
//! Robotics* (2005, section 6.4): each beam is a hit with density `exp(-q / (2 sigma^2))`, `q` its squared distance to
//! the nearest obstacle that was seen from the beam's side, or a random reading with the relative density
//! `random_ratio`. Two optimisers climb it, damped Gauss-Newton and the gradient ascent of Thrun, Burgard and Fox's
//! chapter on fast incremental mapping.
//!
//! Both look a beam's obstacle up once per evaluation, and once more where it was only seen from the other side. A step
//! counts only if the objective improves with every beam's obstacle assigned anew.

use crate::field::{LookUps, NO_OBSTACLE};
use crate::local_map::LocalMap;
use crate::tiles::floor_cell;
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
    /// Negative log density at a pose, up to a constant: zero where the robot is expected.
    #[must_use]
    pub fn cost(&self, world_from_robot: Pose2) -> f64 {
        self.evaluate(world_from_robot).0
    }

    /// Negative log density (up to a constant), gradient and curvature at a pose.
    fn evaluate(&self, world_from_robot: Pose2) -> (f64, Vector3<f64>, Vector3<f64>) {
        let error = self.world_from_robot.between(world_from_robot).log();
        let mut spreads = 1.0_f64;
        let (mut gradient, mut curvature) = (Vector3::zeros(), Vector3::zeros());
        for k in 0..3 {
            let information = 1.0 / self.variances[k];
            let spread = 1.0 + error[k] * error[k] * information / self.tail;
            spreads *= spread;
            curvature[k] = information / spread;
            gradient[k] = curvature[k] * error[k];
        }
        (0.5 * self.tail * spreads.ln(), gradient, curvature)
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
        Self {
            sigma_m: 0.025,
            capture_sigma_m: 0.15,
            random_ratio: 0.01,
            beam_share: 1.0,
            max_evaluations: 30,
            step_m: 5e-4,
        }
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
    /// The scan's part of the objective there: negative log likelihood up to a constant.
    pub scan_cost: f64,
    /// The prior's part.
    pub prior_cost: f64,
    /// Gauss-Newton Hessian of the scan's term alone.
    pub hessian: Matrix3<f64>,
    /// Evaluations used, one field look-up a beam each, two where the first finds a wall's far side.
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
    scan_cost: f64,
    gradient: Vector3<f64>,
    hessian: Matrix3<f64>,
    scan_hessian: Matrix3<f64>,
    hits: f64,
}

impl Matcher {
    /// The scan's term at a pose; `points` are end points in the robot's frame, metres.
    #[must_use]
    pub fn evaluate(&self, map: &LocalMap, points: &[[f64; 2]], world_from_robot: Pose2, sigma_m: f64) -> Evaluation {
        let random = self.settings.random_ratio;
        pulp::Arch::new().dispatch(Term { map, points, world_from_robot, sigma_m, random })
    }

    fn objective(&self, map: &LocalMap, points: &[[f64; 2]], prior: &Prior, pose: Pose2, sigma_m: f64) -> Objective {
        let scan = self.evaluate(map, points, pose, sigma_m);
        let share = self.settings.beam_share;
        let (cost, gradient, curvature) = prior.evaluate(pose);
        Objective {
            cost: scan.cost * share + cost,
            scan_cost: scan.cost * share,
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
    pub fn gauss_newton(&self, map: &LocalMap, points: &[[f64; 2]], prior: &Prior, start: Pose2) -> MatchResult {
        self.climb(map, points, prior, start, Self::gauss_newton_stage)
    }

    /// Gradient ascent with one adaptive step length, stage by stage.
    ///
    /// Steps are `kappa diag(1, 1, 1/L^2) grad / sum of weights` with `L` the rms range: the scaling makes a metre and a
    /// radian count alike, so that one `kappa` serves both.
    #[must_use]
    pub fn gradient_ascent(&self, map: &LocalMap, points: &[[f64; 2]], prior: &Prior, start: Pose2) -> MatchResult {
        let squares: f64 = points.iter().map(|p| p[0] * p[0] + p[1] * p[1]).sum();
        let lever2 = (squares / points.len().max(1) as f64).max(1e-6);
        self.climb(map, points, prior, start, |matcher, problem, pose| matcher.gradient_stage(problem, pose, lever2))
    }

    /// The same with `L` = 1 m, so that a radian counts as a metre whatever the range: turns first, then shifts.
    #[must_use]
    pub fn unscaled_gradient_ascent(
        &self,
        map: &LocalMap,
        points: &[[f64; 2]],
        prior: &Prior,
        start: Pose2,
    ) -> MatchResult {
        self.climb(map, points, prior, start, |matcher, problem, pose| matcher.gradient_stage(problem, pose, 1.0))
    }

    fn climb(
        &self,
        map: &LocalMap,
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
            let problem = Problem { map, points, prior, sigma_m, tolerance_m, last: final_stage };
            let (better, objective, used) = stage(self, &problem, pose);
            pose = better;
            evaluations += used;
            last = Some(objective);
        }
        let (scan_cost, hessian) = last.map_or((0.0, Matrix3::zeros()), |o| (o.scan_cost, o.scan_hessian));
        let prior_cost = prior.evaluate(pose).0;
        MatchResult { world_from_robot: pose, scan_cost, prior_cost, hessian, evaluations }
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
            let next_pose = pose * Pose2::exp(step.into());
            if step[0].hypot(step[1]).max(step[2].abs()) < problem.tolerance_m {
                // The next stage judges this step; the last stage is exact enough without it.
                let pose = if problem.last { pose } else { next_pose };
                return (pose, here, evaluations);
            }
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

    fn gradient_stage(&self, problem: &Problem<'_>, start: Pose2, lever2: f64) -> (Pose2, Objective, u32) {
        let variance = problem.sigma_m * problem.sigma_m;
        let mut pose = start;
        let mut here = self.at(problem, pose);
        let mut evaluations = 1;
        let mut kappa = 1.0;
        // Strides that are left to get out of a dent, where shorter steps have failed.
        let mut strides = DENT_STRIDES.iter();
        while evaluations < self.settings.max_evaluations {
            let k = kappa * variance / here.hits.max(1e-6);
            let step = [-k * here.gradient[0], -k * here.gradient[1], -k * here.gradient[2] / lever2];
            if step[0].hypot(step[1]).max(step[2].abs()) < 0.2 * problem.tolerance_m {
                match strides.next() {
                    Some(&stride) if problem.last => {
                        kappa = stride;
                        continue;
                    }
                    _ => break,
                }
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

/// The scan's term at a pose, for the widest registers there are: without fused operations the sums are the same in all.
struct Term<'a> {
    map: &'a LocalMap,
    points: &'a [[f64; 2]],
    world_from_robot: Pose2,
    sigma_m: f64,
    random: f64,
}

impl pulp::WithSimd for Term<'_> {
    type Output = Evaluation;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> Evaluation {
        let Self { map, points, world_from_robot, sigma_m, random } = self;
        let (s, c) = world_from_robot.theta.sin_cos();
        let scale = 0.5 / (sigma_m * sigma_m);
        let mut lookup = Lookup::new(map, world_from_robot, (s, c));
        let mut block = Block::EMPTY;
        let mut sums = Sums::default();
        for some in points.chunks(BLOCK) {
            lookup.gather(some, &mut block);
            sums.add(&block, scale as f32, random as f32);
        }
        // The sums are over a translation in the world's frame; a right perturbation's is in the robot's.
        let [gx, gy, gt, hxx, hxy, hyy, hxt, hyt, htt, hits] = sums.totals.map(f64::from);
        let world_from_tangent = Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0);
        let k = 2.0 * scale;
        let gradient = world_from_tangent.transpose() * Vector3::new(gx, gy, gt) * k;
        let second = Matrix3::new(hxx, hxy, hxt, hxy, hyy, hyt, hxt, hyt, htt);
        let hessian = world_from_tangent.transpose() * second * world_from_tangent * k;
        // Slots of the last block that held no beam counted as random readings.
        let padding = points.len().div_ceil(BLOCK) * BLOCK - points.len();
        let cost = -sums.log_likelihood + padding as f64 * random.ln();
        Evaluation { cost, gradient, hessian, hits }
    }
}

/// Where gradient ascent has come to rest, it tries steps of these `kappa` once more: a dent is as wide as a cell.
const DENT_STRIDES: [f64; 3] = [30.0, 10.0, 3.0];

/// Beams that are evaluated together.
const BLOCK: usize = 64;
/// Single-precision numbers that processors handle at once; sums are kept in as many parts.
const LANES: usize = 8;

/// What beams found in the field, relative to the obstacle and to the robot, so that single precision is plenty.
struct Block {
    /// From the obstacle to the end point, metres.
    dx: [f32; BLOCK],
    dy: [f32; BLOCK],
    /// From the robot to the end point, in the world's axes.
    rx: [f32; BLOCK],
    ry: [f32; BLOCK],
    axx: [f32; BLOCK],
    axy: [f32; BLOCK],
    ayy: [f32; BLOCK],
}

impl Block {
    const EMPTY: Self = Self {
        dx: [0.0; BLOCK],
        dy: [0.0; BLOCK],
        rx: [0.0; BLOCK],
        ry: [0.0; BLOCK],
        axx: [0.0; BLOCK],
        axy: [0.0; BLOCK],
        ayy: [0.0; BLOCK],
    };

    /// A beam without obstacle: so far away that it cannot be a hit.
    fn set_missed(&mut self, k: usize) {
        (self.dx[k], self.dy[k], self.rx[k], self.ry[k]) = (1e4, 0.0, 0.0, 0.0);
        (self.axx[k], self.axy[k], self.ayy[k]) = (1.0, 0.0, 0.0);
    }
}

/// One field look-up a beam, two where the first finds a wall's far side.
struct Lookup<'a> {
    map: &'a LocalMap,
    field: LookUps<'a>,
    world_from_robot: Pose2,
    sin_cos: (f64, f64),
    cells_per_m: f64,
}

impl<'a> Lookup<'a> {
    fn new(map: &'a LocalMap, world_from_robot: Pose2, sin_cos: (f64, f64)) -> Self {
        let cells_per_m = 1.0 / map.settings.resolution_m;
        Self { map, field: map.field().look_ups(), world_from_robot, sin_cos, cells_per_m }
    }

    #[inline(always)]
    fn gather(&mut self, points: &[[f64; 2]], block: &mut Block) {
        let (s, c) = self.sin_cos;
        let surfels = self.map.surfels();
        for (k, &[px, py]) in points.iter().enumerate() {
            let (rx, ry) = (c * px - s * py, s * px + c * py);
            let (wx, wy) = (self.world_from_robot.x + rx, self.world_from_robot.y + ry);
            let (cell_x, cell_y) = (floor_cell(wx * self.cells_per_m), floor_cell(wy * self.cells_per_m));
            let slot = self.field.nearest(cell_x, cell_y);
            #[cfg(test)]
            tests::LOOK_UPS.set(tests::LOOK_UPS.get() + 1);
            if slot == NO_OBSTACLE {
                block.set_missed(k);
                continue;
            }
            let mut surfel = &surfels[slot as usize];
            let (rx, ry) = (rx as f32, ry as f32);
            if surfel.is_seen_from_behind([rx, ry]) {
                let Some(near) = self.map.near_side(surfel, [wx, wy], [rx, ry]) else {
                    block.set_missed(k);
                    continue;
                };
                surfel = near;
            }
            (block.dx[k], block.dy[k]) = ((wx - surfel.x) as f32, (wy - surfel.y) as f32);
            (block.rx[k], block.ry[k]) = (rx, ry);
            (block.axx[k], block.axy[k], block.ayy[k]) = (surfel.axx, surfel.axy, surfel.ayy);
        }
        for k in points.len()..BLOCK {
            block.set_missed(k);
        }
    }
}

/// Sums over beams: gradient (x, y, theta), Hessian (xx, xy, yy, x theta, y theta, theta theta), posterior of being hits.
#[derive(Default)]
struct Sums {
    totals: [f32; 10],
    log_likelihood: f64,
}

impl Sums {
    #[inline(always)]
    fn add(&mut self, block: &Block, scale: f32, random: f32) {
        let mut sums = [[0.0_f32; LANES]; 10];
        let mut product = [1.0_f32; LANES];
        for start in (0..BLOCK).step_by(LANES) {
            let lanes = |all: &[f32; BLOCK]| -> [f32; LANES] { std::array::from_fn(|l| all[start + l]) };
            let (dx, dy, rx, ry) = (lanes(&block.dx), lanes(&block.dy), lanes(&block.rx), lanes(&block.ry));
            let (axx, axy, ayy) = (lanes(&block.axx), lanes(&block.axy), lanes(&block.ayy));
            for l in 0..LANES {
                let (ex, ey) = (axx[l] * dx[l] + axy[l] * dy[l], axy[l] * dx[l] + ayy[l] * dy[l]);
                let hit = exp_of_negative((dx[l] * ex + dy[l] * ey) * scale);
                let total = hit + random;
                product[l] *= total;
                let w = hit / total;
                // The end point turns about the robot: d(wx, wy)/d(theta) = (-ry, rx).
                let (tx, ty) = (axy[l] * rx[l] - axx[l] * ry[l], ayy[l] * rx[l] - axy[l] * ry[l]);
                sums[0][l] += w * ex;
                sums[1][l] += w * ey;
                sums[2][l] += w * (ey * rx[l] - ex * ry[l]);
                sums[3][l] += w * axx[l];
                sums[4][l] += w * axy[l];
                sums[5][l] += w * ayy[l];
                sums[6][l] += w * tx;
                sums[7][l] += w * ty;
                sums[8][l] += w * (ty * rx[l] - tx * ry[l]);
                sums[9][l] += w;
            }
        }
        for (total, parts) in self.totals.iter_mut().zip(&sums) {
            *total += parts.iter().sum::<f32>();
        }
        // One logarithm for the block: 64 factors of at least 1e-4 stay above the smallest double.
        self.log_likelihood += product.iter().map(|&p| f64::from(p)).product::<f64>().ln();
    }
}

/// `exp(-u)` for `u >= 0`, relative error below 3e-7; `exp(-80)` beyond 80.
///
/// `2^n` from the exponent's bits times a polynomial for the rest.
#[inline(always)]
fn exp_of_negative(u: f32) -> f32 {
    const ROUND: f32 = 12_582_912.0; // 1.5 * 2^23: adding it rounds to the nearest integer
    let u = if u < 80.0 { u } else { 80.0 };
    let t = u * -std::f32::consts::LOG2_E + ROUND;
    let n = t - ROUND;
    // ln 2 in two parts, so that the rest is exact.
    let r = (-u - n * 0.693_145_75) - n * 1.428_606_8e-6;
    let exp_r = 1.0 + r * (1.0 + r * (0.5 + r * (1.0 / 6.0 + r * (1.0 / 24.0 + r * (1.0 / 120.0)))));
    let power = f32::from_bits(t.to_bits().wrapping_sub(ROUND.to_bits()).wrapping_add(127) << 23);
    exp_r * power
}

/// One stage's problem.
struct Problem<'a> {
    map: &'a LocalMap,
    points: &'a [[f64; 2]],
    prior: &'a Prior,
    sigma_m: f64,
    tolerance_m: f64,
    last: bool,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::counts::Change;
    use crate::local_map::LocalMapSettings;
    use mapwright_sensor::SweepPoints;
    use std::cell::Cell;

    thread_local! {
        /// Obstacles looked up by this thread.
        pub(super) static LOOK_UPS: Cell<usize> = const { Cell::new(0) };
    }

    /// Two walls of a room's corner, as a sweep sees them.
    fn corner() -> SweepPoints {
        let along = |k: i32| -2.0 + 0.04 * f64::from(k);
        let hits = (0..100).map(|k| [3.0, along(k)]).chain((0..77).map(|k| [along(k), -2.5])).collect();
        let mut points = SweepPoints { hits, beam_step_rad: 0.01, ..SweepPoints::default() };
        points.fill_normals();
        points
    }

    #[test]
    fn a_match_looks_up_one_obstacle_a_beam_and_evaluation() {
        let points = corner();
        let mut map = LocalMap::new(LocalMapSettings::default());
        map.change(&points, Pose2::IDENTITY, Change::Add, 0);
        let matcher = Matcher::default();
        let prior = Prior { world_from_robot: Pose2::IDENTITY, variances: [0.01; 3], tail: 1e8 };
        let start = Pose2::new(0.06, -0.04, 0.02);
        for result in [
            |m: &Matcher, map: &LocalMap, p: &SweepPoints, prior, start| m.gauss_newton(map, &p.hits, prior, start),
            |m: &Matcher, map: &LocalMap, p: &SweepPoints, prior, start| m.gradient_ascent(map, &p.hits, prior, start),
            |m: &Matcher, map: &LocalMap, p: &SweepPoints, prior, start| {
                m.unscaled_gradient_ascent(map, &p.hits, prior, start)
            },
        ] {
            LOOK_UPS.set(0);
            let result = result(&matcher, &map, &points, &prior, start);
            assert!(result.evaluations > 3);
            assert_eq!(LOOK_UPS.get(), result.evaluations as usize * points.hits.len());
            assert!(result.world_from_robot.distance(Pose2::IDENTITY) < 0.01, "{result:?}");
        }
    }

    #[test]
    fn wide_registers_give_the_same_bits() {
        use pulp::WithSimd;
        let points = corner();
        let mut map = LocalMap::new(LocalMapSettings::default());
        map.change(&points, Pose2::IDENTITY, Change::Add, 0);
        for k in 0..20 {
            let pose = Pose2::new(0.01 * f64::from(k), -0.007 * f64::from(k), 0.003 * f64::from(k));
            let (hits, sigma_m) = (&points.hits[k as usize..], 0.02 * f64::from(k + 1));
            let term = Term { map: &map, points: hits, world_from_robot: pose, sigma_m, random: 0.01 };
            let narrow = term.with_simd(pulp::Scalar::new());
            assert_eq!(Matcher::default().evaluate(&map, hits, pose, sigma_m), narrow);
            assert!(narrow.hits > 1.0);
        }
    }

    /// A wall along y, seen from a point on the x axis.
    fn wall(x: f64, from_x: f64) -> SweepPoints {
        let hits = (0..100).map(|k| [x, -2.0 + 0.04 * f64::from(k)]).collect();
        let mut points = SweepPoints { hits, origin: [from_x, 0.0], beam_step_rad: 0.01, ..SweepPoints::default() };
        points.fill_normals();
        points
    }

    #[test]
    fn a_wall_is_not_matched_against_its_other_side() {
        // The corridor's side of a wall is known, and the room's other walls; the robot, in the room, sees the room's side.
        let mut map = LocalMap::new(LocalMapSettings::default());
        map.change(&wall(0.0, -1.0), Pose2::IDENTITY, Change::Add, 0);
        let mut sides = SweepPoints::default();
        for y in [-2.0, 2.0] {
            sides.hits.extend((0..100).map(|k| [0.15 + 0.04 * f64::from(k), y]));
        }
        (sides.origin, sides.beam_step_rad) = ([2.0, 0.0], 0.01);
        sides.fill_normals();
        map.change(&sides, Pose2::IDENTITY, Change::Add, 1);
        let from_room = Pose2::new(2.0, 0.0, 0.0);
        let seen = |world: [f64; 2]| from_room.inverse().transform(world);
        let hits: Vec<_> = wall(0.15, 2.0).hits.iter().chain(&sides.hits).map(|&hit| seen(hit)).collect();
        let prior = Prior { world_from_robot: from_room, variances: [0.01; 3], tail: 1e8 };
        let found = Matcher::default().gauss_newton(&map, &hits, &prior, from_room).world_from_robot;
        assert!(found.distance(from_room) < 0.01 && found.theta.abs() < 0.005, "{found:?}");
        // With the room's side in the map too it is found from beyond the wall's middle.
        map.change(&wall(0.15, 2.0), Pose2::IDENTITY, Change::Add, 2);
        let start = Pose2::new(1.88, 0.0, 0.0);
        let prior = Prior { world_from_robot: start, variances: [0.01; 3], tail: 1e8 };
        let found = Matcher::default().gauss_newton(&map, &hits, &prior, start).world_from_robot;
        assert!(found.distance(from_room) < 0.01 && found.theta.abs() < 0.005, "{found:?}");
    }

    #[test]
    fn the_sides_of_a_thin_wall_are_two_lines() {
        let mut map = LocalMap::new(LocalMapSettings::default());
        let sides = [(0.02, -1.0), (0.08, 1.0)];
        for (node, &(x, from_x)) in (0..).zip(&sides) {
            map.change(&wall(x, from_x), Pose2::IDENTITY, Change::Add, node);
        }
        for (x, from_x) in sides {
            let line = map.obstacle_seen([from_x, 0.0], [x, 0.1]).expect("the side that is seen");
            assert!((line.x - x).abs() < 1e-3, "{line:?}");
            let line = map.obstacle_seen([from_x, 0.0], [0.1 - x, 0.1]).expect("the side that is seen");
            assert!((line.x - x).abs() < 1e-3, "{line:?}");
        }
    }
}
