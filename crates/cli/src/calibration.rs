//! Where the laser sits and what the wheels get wrong, from matched poses and odometry.
//!
//! Over a stretch of the drive, odometry's motion of the robot and the matched motion of the laser must agree through
//! the laser's mount: `robot0_from_robot1 * robot_from_laser = robot_from_laser * laser0_from_laser1` (hand-eye
//! calibration in the plane, with the wheels' errors estimated beside it; after Censi et al. 2013). The mount's position
//! shows only in turns, its heading only on the move; odometry that lags behind the laser looks like a laser that sits
//! further ahead the faster the robot drives, so the lag is estimated too. Gauss-Newton with Huber weights; the
//! uncertainty is the sandwich `H^-1 (sum J^T W r r^T W J) H^-1` over groups of successive stretches, which stays honest
//! where residuals are neither equal nor normal nor independent of their neighbours.

use mapwright_geom::{Pose2, Stamp};
use nalgebra::{SMatrix, SVector};

/// Residuals per stretch: x, y, heading.
const RESIDUALS: usize = 3;
const PARAMETERS: usize = 7;
/// Those of the wheels.
const WHEELS: std::ops::Range<usize> = 3..6;
type Vector = SVector<f64, PARAMETERS>;
type Matrix = SMatrix<f64, PARAMETERS, PARAMETERS>;

/// A stretch ends after this much turning, radians, or driving, metres.
const STRETCH_RAD: f64 = 0.4;
const STRETCH_M: f64 = 0.5;
/// Residuals beyond so many robust standard deviations lose weight (Huber 1964).
const HUBER: f64 = 1.345;
/// Successive stretches whose residuals may have a cause in common.
const CLUSTER: usize = 10;
const ITERATIONS: usize = 30;
/// Steps for numerical derivatives; the model is smooth on this scale.
const STEP: f64 = 1e-6;
/// Stretches without which nothing is said.
const STRETCHES_AT_LEAST: usize = 30;
/// Turning in all without which the mount's position does not show, radians.
const TURN_AT_LEAST_RAD: f64 = 6.0;

/// Scans farther apart say nothing about the speed between them, seconds.
const SPEED_WITHIN_S: f64 = 2.0;

/// A scan's pose by the wheels and by the match.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sample {
    pub(crate) stamp: Stamp,
    pub(crate) odom_from_robot: Pose2,
    /// The laser itself, not the robot: no mount is presumed.
    pub(crate) map_from_laser: Pose2,
}

/// A value and its standard deviation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Estimate {
    pub(crate) value: f64,
    pub(crate) sigma: f64,
}

/// The result.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Calibration {
    /// Laser ahead of the robot's centre, metres.
    pub(crate) x_m: Estimate,
    /// Laser left of it, metres.
    pub(crate) y_m: Estimate,
    /// Laser turned to the left, radians.
    pub(crate) yaw_rad: Estimate,
    /// True distance per reported distance.
    pub(crate) translation_scale: Estimate,
    /// True turn per reported turn.
    pub(crate) rotation_scale: Estimate,
    /// True turn per metre driven that the wheels do not report, radians per metre.
    pub(crate) drift_rad_per_m: Estimate,
    /// Time by which odometry lags behind the laser, seconds.
    pub(crate) lag_s: Estimate,
    /// Stretches used.
    pub(crate) stretches: usize,
}

/// One stretch: the wheels' increments and the laser's motion over all of them.
#[derive(Debug, Clone)]
struct Stretch {
    increments: Vec<Pose2>,
    /// The wheels' speed at both ends, per second.
    twists_per_s: [[f64; 3]; 2],
    laser0_from_laser1: Pose2,
}

/// Estimates mount and wheels from scans that were tracked, in runs without a break.
pub(crate) fn calibrate(runs: &[Vec<Sample>], presumed: Pose2) -> Result<Calibration, String> {
    let stretches: Vec<_> = runs.iter().flat_map(|run| stretches_of(run)).collect();
    let turned: f64 = stretches.iter().map(|s| s.laser0_from_laser1.theta.abs()).sum();
    if stretches.len() < STRETCHES_AT_LEAST || turned < TURN_AT_LEAST_RAD {
        return Err(format!(
            "expected at least {STRETCHES_AT_LEAST} stretches of driving with odometry and a full turn of the robot in \
             all, found {} stretches and {turned:.1} rad",
            stretches.len()
        ));
    }
    let mut at = Vector::from([presumed.x, presumed.y, presumed.theta, 1.0, 1.0, 0.0, 0.0]);
    let mut scales = [1.0; RESIDUALS];
    for _ in 0..ITERATIONS {
        scales = robust_scales(&stretches, &at);
        let normal = Normal::at(&stretches, &at, &scales);
        let step = normal.solve().ok_or("the drive does not show all of mount and wheels: more turns are needed")?;
        at -= step;
        if step.amax() < 1e-9 {
            break;
        }
    }
    let covariance = Normal::at(&stretches, &at, &scales).covariance().ok_or("the estimate is not determined")?;
    let estimate = |k: usize| Estimate { value: at[k], sigma: covariance[(k, k)].max(0.0).sqrt() };
    Ok(Calibration {
        x_m: estimate(0),
        y_m: estimate(1),
        yaw_rad: estimate(2),
        translation_scale: estimate(3),
        rotation_scale: estimate(4),
        drift_rad_per_m: estimate(5),
        lag_s: estimate(6),
        stretches: stretches.len(),
    })
}

fn stretches_of(run: &[Sample]) -> Vec<Stretch> {
    let mut stretches = Vec::new();
    let (mut start, mut increments, mut turned, mut driven_m) = (0, Vec::new(), 0.0, 0.0);
    for k in 1..run.len() {
        let increment = run[k - 1].odom_from_robot.between(run[k].odom_from_robot);
        turned += increment.theta.abs();
        driven_m += increment.x.hypot(increment.y);
        increments.push(increment);
        if turned >= STRETCH_RAD || driven_m >= STRETCH_M {
            let laser0_from_laser1 = run[start].map_from_laser.between(run[k].map_from_laser);
            let twists_per_s = [start, k].map(|at| twist_per_s(run, at));
            stretches.push(Stretch { increments: std::mem::take(&mut increments), twists_per_s, laser0_from_laser1 });
            (start, turned, driven_m) = (k, 0.0, 0.0);
        }
    }
    stretches
}

/// The wheels' speed around a sample, per second; zero where the stamps do not tell.
fn twist_per_s(run: &[Sample], at: usize) -> [f64; 3] {
    let (before, after) = (run[at.saturating_sub(1)], run[(at + 1).min(run.len() - 1)]);
    let seconds = after.stamp.secs_since(before.stamp);
    let telling = seconds > 0.0 && seconds < SPEED_WITHIN_S;
    if telling { before.odom_from_robot.between(after.odom_from_robot).log().map(|v| v / seconds) } else { [0.0; 3] }
}

impl Stretch {
    /// Odometry put together anew with the wheels' errors taken out.
    fn robot_motion(&self, at: &Vector) -> Pose2 {
        self.increments.iter().fold(Pose2::IDENTITY, |sum, step| {
            let ahead = if step.x < 0.0 { -1.0 } else { 1.0 };
            let drift = at[5] * ahead * step.x.hypot(step.y);
            sum * Pose2::new(at[3] * step.x, at[3] * step.y, at[4] * step.theta + drift)
        })
    }

    fn residual(&self, at: &Vector) -> [f64; RESIDUALS] {
        self.residual_of(at, self.robot_motion(at))
    }

    /// The same where the wheels' motion is known.
    fn residual_of(&self, at: &Vector, motion: Pose2) -> [f64; RESIDUALS] {
        let robot_from_laser = Pose2::new(at[0], at[1], at[2]);
        let [start, end] = self.twists_per_s.map(|twist| Pose2::exp(twist.map(|v| v * at[6])));
        let robot0_from_robot1 = start.inverse() * motion * end;
        let by_wheels = robot_from_laser.inverse() * robot0_from_robot1 * robot_from_laser;
        let error = self.laser0_from_laser1.between(by_wheels);
        [error.x, error.y, error.theta]
    }

    /// Derivative of each residual by each parameter, by central differences.
    fn jacobian(&self, at: &Vector) -> [Vector; RESIDUALS] {
        let mut rows = [Vector::zeros(); RESIDUALS];
        let motion = self.robot_motion(at);
        for k in 0..PARAMETERS {
            let (mut ahead, mut behind) = (*at, *at);
            ahead[k] += STEP;
            behind[k] -= STEP;
            // Mount and lag change nothing of what the wheels say.
            let motion_at = |at: &Vector| if WHEELS.contains(&k) { self.robot_motion(at) } else { motion };
            let [ahead, behind] = [ahead, behind].map(|at| self.residual_of(&at, motion_at(&at)));
            for (row, (a, b)) in rows.iter_mut().zip(ahead.iter().zip(&behind)) {
                row[k] = (a - b) / (2.0 * STEP);
            }
        }
        rows
    }
}

/// Standard deviation of each residual from its median absolute value.
fn robust_scales(stretches: &[Stretch], at: &Vector) -> [f64; RESIDUALS] {
    let residuals: Vec<_> = stretches.iter().map(|stretch| stretch.residual(at)).collect();
    std::array::from_fn(|k| {
        let mut sizes: Vec<_> = residuals.iter().map(|r| r[k].abs()).collect();
        sizes.sort_by(f64::total_cmp);
        (1.4826 * sizes[sizes.len() / 2]).max(1e-6)
    })
}

/// Normal equations, and the spread of the gradient.
struct Normal {
    hessian: Matrix,
    gradient: Vector,
    gradient_spread: Matrix,
}

impl Normal {
    fn at(stretches: &[Stretch], at: &Vector, scales: &[f64; RESIDUALS]) -> Self {
        let (mut hessian, mut gradient, mut gradient_spread) = (Matrix::zeros(), Vector::zeros(), Matrix::zeros());
        for together in stretches.chunks(CLUSTER) {
            let mut own = Vector::zeros();
            for stretch in together {
                for ((row, residual), scale) in stretch.jacobian(at).iter().zip(stretch.residual(at)).zip(scales) {
                    let sigmas = residual.abs() / scale;
                    let weight = if sigmas > HUBER { HUBER / sigmas } else { 1.0 } / (scale * scale);
                    hessian += row * row.transpose() * weight;
                    own += row * (weight * residual);
                }
            }
            gradient += own;
            gradient_spread += own * own.transpose();
        }
        Self { hessian, gradient, gradient_spread }
    }

    fn solve(&self) -> Option<Vector> {
        let step = self.hessian.cholesky()?.solve(&self.gradient);
        step.iter().all(|v| v.is_finite()).then_some(step)
    }

    fn covariance(&self) -> Option<Matrix> {
        let inverse = self.hessian.try_inverse()?;
        Some(inverse * self.gradient_spread * inverse)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may")]
mod tests {
    use super::*;

    #[test]
    fn what_was_put_in_comes_out() {
        let robot_from_laser = Pose2::new(-0.04, 0.03, 0.02);
        let (mut world_from_robot, mut odom_from_robot) = (Pose2::IDENTITY, Pose2::IDENTITY);
        let mut run = Vec::new();
        for k in 0..2000 {
            let stamp = Stamp(i64::from(k) * 100_000_000);
            run.push(Sample { stamp, odom_from_robot, map_from_laser: world_from_robot * robot_from_laser });
            let (turn, ahead_m) = (0.06 * (f64::from(k) * 0.02).sin(), 0.05 + 0.03 * (f64::from(k) * 0.031).sin());
            world_from_robot = world_from_robot * Pose2::new(ahead_m, 0.0, turn);
            odom_from_robot = odom_from_robot * Pose2::new(ahead_m / 1.02, 0.0, (turn - 0.01 * ahead_m) / 0.97);
        }
        let found = calibrate(&[run], Pose2::IDENTITY).unwrap();
        let near = |estimate: Estimate, value: f64| assert!((estimate.value - value).abs() < 1e-3, "{estimate:?}");
        near(found.x_m, -0.04);
        near(found.y_m, 0.03);
        near(found.yaw_rad, 0.02);
        near(found.translation_scale, 1.02);
        near(found.rotation_scale, 0.97);
        near(found.drift_rad_per_m, 0.01 * 1.02);
        near(found.lag_s, 0.0);
    }

    #[test]
    fn a_drive_without_turns_is_refused_in_words() {
        let sample = |k: i32| Pose2::new(0.05 * f64::from(k), 0.0, 0.0);
        let stamp = |k: i32| Stamp(i64::from(k) * 100_000_000);
        let run = (0..2000)
            .map(|k| Sample { stamp: stamp(k), odom_from_robot: sample(k), map_from_laser: sample(k) })
            .collect();
        assert!(calibrate(&[run], Pose2::IDENTITY).unwrap_err().contains("full turn"));
    }
}
