//! Maximum-likelihood matching of a scan against a live map.

use crate::field::NO_OBSTACLE;
use crate::live::LiveMap;
use crate::tiles::{NO_TILE, cell_in_tile, tile_of};
use mapwright_geom::{Cov3, Pose2};
use nalgebra::{Matrix3, Vector3};

/// Where the robot is thought to be before the scan is seen.
#[derive(Debug, Clone, Copy)]
pub struct Prior {
    /// The expected pose.
    pub world_from_robot: Pose2,
    /// Inverse of its covariance (right perturbation).
    pub information: Cov3,
    /// x
    pub tail2: f64,
}

/// Settings.
#[derive(Debug, Clone, Copy)]
pub struct MatcherSettings {
    /// Standard deviation of a hit, metres.
    pub sigma_m: f64,
    /// Share of beams that are random, relative to hits: `z_rand / z_hit` as a density ratio at distance zero.
    pub random_ratio: f64,
    /// Weight of one beam's log likelihood: beams are correlated.
    pub beam_weight: f64,
    /// At most so many evaluations.
    pub max_evaluations: u32,
    /// Converged when a step is below this, metres (rotation times 1 m likewise).
    pub step_m: f64,
}

impl Default for MatcherSettings {
    fn default() -> Self {
        Self { sigma_m: 0.05, random_ratio: 0.05, beam_weight: 0.2, max_evaluations: 20, step_m: 5e-4 }
    }
}

/// Objective, gradient and Gauss-Newton Hessian of the scan term at one pose (right perturbation).
#[derive(Debug, Clone, Copy)]
pub struct Evaluation {
    /// Negative log likelihood, up to a constant.
    pub cost: f64,
    /// Its gradient.
    pub gradient: Vector3<f64>,
    /// Its Gauss-Newton Hessian.
    pub hessian: Matrix3<f64>,
    /// Sum of the posteriors that beams were hits.
    pub inliers: f64,
}

/// Outcome.
#[derive(Debug, Clone, Copy)]
pub struct MatchResult {
    /// The best pose.
    pub world_from_robot: Pose2,
    /// Scan term there.
    pub evaluation: Evaluation,
    /// Evaluations used.
    pub evaluations: u32,
}

/// The matcher.
#[derive(Debug, Clone)]
pub struct Matcher {
    /// Settings.
    pub settings: MatcherSettings,
}

impl Matcher {
    /// Scan term at a pose.
    #[must_use]
    pub fn evaluate(&self, map: &LiveMap, points: &[[f64; 2]], world_from_robot: Pose2, sigma_m: f64) -> Evaluation {
        let (s, c) = world_from_robot.theta.sin_cos();
        let inv = 1.0 / map.settings.resolution_m;
        let inv2s = 0.5 / sigma_m.powi(2);
        let field = map.field();
        let surfels = map.surfels();
        let a = self.settings.random_ratio;
        let floor_cost = -(a.ln());
        let mut cost = 0.0;
        let (mut gx, mut gy, mut gt) = (0.0, 0.0, 0.0);
        let (mut hxx, mut hxy, mut hyy, mut hxt, mut hyt, mut htt) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        let mut inliers = 0.0;
        let mut current = (i32::MIN, i32::MIN);
        let mut tile = NO_TILE;
        for &[px, py] in points {
            let (rx, ry) = (c * px - s * py, s * px + c * py);
            let (wx, wy) = (world_from_robot.x + rx, world_from_robot.y + ry);
            let (cx, cy) = ((wx * inv).floor() as i32, (wy * inv).floor() as i32);
            if tile_of(cx, cy) != current {
                current = tile_of(cx, cy);
                tile = field.tile_number(current);
            }
            if tile == NO_TILE {
                cost += floor_cost;
                continue;
            }
            let handle = field.tiles[tile as usize].nearest[cell_in_tile(cx, cy)];
            if handle == NO_OBSTACLE {
                cost += floor_cost;
                continue;
            }
            let surfel = &surfels[handle as usize];
            let (dx, dy) = (wx - surfel.x, wy - surfel.y);
            let (axx, axy, ayy) = (f64::from(surfel.axx), f64::from(surfel.axy), f64::from(surfel.ayy));
            let (ex, ey) = (axx * dx + axy * dy, axy * dx + ayy * dy);
            let q = dx * ex + dy * ey;
            let hit = (-q * inv2s).exp();
            let total = hit + a;
            cost -= total.ln();
            let w = hit / total;
            inliers += w;
            // d(world point)/d(theta) = (-ry, rx)
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
        let k = self.settings.beam_weight * 2.0 * inv2s;
        // World-frame translation to right perturbation.
        let rot = Matrix3::new(c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0);
        let g = rot.transpose() * Vector3::new(gx, gy, gt) * k;
        let h = rot.transpose() * Matrix3::new(hxx, hxy, hxt, hxy, hyy, hyt, hxt, hyt, htt) * rot * k;
        Evaluation { cost: cost * self.settings.beam_weight, gradient: g, hessian: h, inliers }
    }

    /// Damped Gauss-Newton on scan term plus prior.
    #[must_use]
    pub fn gauss_newton(&self, map: &LiveMap, points: &[[f64; 2]], prior: &Prior, start: Pose2, sigmas: &[f64]) -> MatchResult {
        let prior_cost = |pose: Pose2| {
            let t = Vector3::from(prior.world_from_robot.between(pose).log());
            let (mut cost, mut w) = (0.0, Vector3::zeros());
            for k in 0..3 {
                let m2 = t[k] * t[k] * prior.information[(k, k)];
                let c2 = prior.tail2;
                cost += 0.5 * c2 * (1.0 + m2 / c2).ln();
                w[k] = prior.information[(k, k)] / (1.0 + m2 / c2);
            }
            (cost, w.component_mul(&t), w)
        };
        let mut pose = start;
        let mut evaluations = 0;
        let mut out = None;
        for (level, &sigma) in sigmas.iter().enumerate() {
            let last = level + 1 == sigmas.len();
            let tol = if last { self.settings.step_m } else { 0.2 * sigma };
            let mut eval = self.evaluate(map, points, pose, sigma);
            evaluations += 1;
            let (mut pc, mut pt, mut pw) = prior_cost(pose);
            let mut lambda = 1e-4;
            let mut n = 0;
            while n < self.settings.max_evaluations {
                let g = eval.gradient + pt;
                let mut h = eval.hessian + Matrix3::from_diagonal(&pw);
                for k in 0..3 {
                    h[(k, k)] *= 1.0 + lambda;
                }
                let Some(chol) = h.cholesky() else { break };
                let step = -chol.solve(&g);
                let size = step[0].hypot(step[1]).max(step[2].abs());
                if size < tol { break; }
                let next = pose * Pose2::exp(step.into());
                let next_eval = self.evaluate(map, points, next, sigma);
                n += 1;
                let (npc, npt, npw) = prior_cost(next);
                if next_eval.cost + npc <= eval.cost + pc {
                    (pose, eval, pc, pt, pw) = (next, next_eval, npc, npt, npw);
                    lambda = (lambda * 0.1_f64).max(1e-6);
                } else {
                    lambda = (lambda * 10.0_f64).max(1e-1);
                    if lambda > 1e4 {
                        break;
                    }
                }
            }
            evaluations += n;
            out = Some(eval);
        }
        MatchResult { world_from_robot: pose, evaluation: out.unwrap(), evaluations }
    }
}
