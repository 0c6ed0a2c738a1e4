//! Where the laser sits and what the wheels get wrong, from matched poses and odometry.
//!
//! Over a stretch of the drive, the matched motion of the laser and odometry's motion of the robot must agree through the
//! laser's mount: `odometry(robot_from_laser * laser0_from_laser1 * laser_from_robot)` is what the wheels report (hand-eye
//! calibration in the plane, with the wheels' errors estimated beside it; after Censi et al. 2013). The mount's position
//! shows only in turns, its heading only on the move; odometry that lags behind the laser reports where the robot was then.
//!
//! The wheels' report is what is predicted, because it is what is noisy: noise in what is predicted *from* makes whatever is
//! estimated too small. For the same reason lag is told by headings alone: along a corridor a match is what the wheels had
//! predicted, as if they had no lag. Gauss-Newton with Huber weights; the uncertainty is the sandwich
//! `B^-1 (sum Z^T W r r^T W Z) B^-T` over groups of successive stretches, which stays honest where residuals are neither equal
//! nor normal nor independent of their neighbours, and what is alike all over the drive, which no scatter shows, beside it.

use mapwright_geom::{Pose2, Stamp};
use nalgebra::{SMatrix, SVector};

/// Residuals per stretch: x, y, heading.
const RESIDUALS: usize = 3;
const PARAMETERS: usize = 7;
/// The lag among the parameters, and the heading among the residuals.
const LAG: usize = 6;
const HEADING: usize = 2;
type Vector = SVector<f64, PARAMETERS>;
type Matrix = SMatrix<f64, PARAMETERS, PARAMETERS>;

/// A stretch ends after this much turning of the laser, radians, or way of it, metres.
const STRETCH_RAD: f64 = 0.4;
const STRETCH_M: f64 = 0.5;
/// The laser's motion over it is put together from so many parts at most.
const PARTS: usize = 5;
/// Residuals beyond so many robust standard deviations lose weight (Huber 1964).
const HUBER: f64 = 1.345;
/// Successive stretches whose residuals may have a cause in common.
const CLUSTER: usize = 10;
const ITERATIONS: usize = 30;
/// The estimate stands still when no parameter changes by more.
const STILL: f64 = 1e-6;
/// Steps for numerical derivatives; the model is smooth on this scale.
const STEP: f64 = 1e-6;
/// The same for the lag, seconds: poses are noisy, so that a speed is told over a while.
const LAG_STEP_S: f64 = 0.1;
/// Stretches without which nothing is said.
const STRETCHES_AT_LEAST: usize = 30;
/// Turning in all without which the mount's position does not show, radians.
const TURN_AT_LEAST_RAD: f64 = 6.0;
/// So long after a run's beginning the first stretch begins, and so long before its end the last one ends, seconds: where the robot
/// was a lag before is known there.
const MARGIN_S: f64 = 0.3;
/// Where a tenth of the scans follow the one before within this share of what only a tenth take longer for, stamps come in bursts.
const BURST: f64 = 0.25;
/// No odometry lags by more, seconds.
const LAG_AT_MOST_S: f64 = 5.0;
/// Between scans farther apart nobody knows where the robot was, seconds.
const KNOWN_WITHIN_S: f64 = 2.0;
/// What matches are off by alike all over a drive: position, metres, and heading, radians (docs/decisions/0028-calibration.md).
const ALIKE_M: f64 = 0.0015;
const ALIKE_RAD: f64 = 0.0006;
/// Matches are drawn to where a laser mounted as presumed would be, by this share of what is wrong with that.
const PULL: f64 = 0.02;

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
    /// Time by which odometry lags behind the laser, seconds; none where stamps do not tell.
    pub(crate) lag_s: Option<Estimate>,
    /// Stretches used.
    pub(crate) stretches: usize,
}

/// Estimates mount and wheels from scans that were tracked, in runs without a break; the mapper had the laser where it is presumed.
pub(crate) fn calibrate(runs: &[Vec<Sample>], presumed: Pose2) -> Result<Calibration, String> {
    let stretches: Vec<_> = runs.iter().flat_map(|run| stretches_of(run)).collect();
    let turned: f64 = stretches.iter().map(|s| s.laser0_from_laser1().theta.abs()).sum();
    if stretches.len() < STRETCHES_AT_LEAST || turned < TURN_AT_LEAST_RAD {
        return Err(format!(
            "expected at least {STRETCHES_AT_LEAST} stretches of driving with odometry and a full turn of the robot in \
             all, found {} stretches and {turned:.1} rad",
            stretches.len()
        ));
    }
    let mut at = Vector::from([presumed.x, presumed.y, presumed.theta, 1.0, 1.0, 0.0, 0.0]);
    let tells_time = tells_time(runs);
    let mut normal = Normal::at(&stretches, &at, tells_time);
    for _ in 0..ITERATIONS {
        let step = normal.step().ok_or("the drive does not show all of mount and wheels: more turns are needed")?;
        at -= step;
        at[LAG] = at[LAG].clamp(-LAG_AT_MOST_S, LAG_AT_MOST_S);
        normal = Normal::at(&stretches, &at, tells_time);
        if step.amax() < STILL {
            break;
        }
    }
    let covariance = normal.covariance().ok_or("the estimate is not determined")?;
    let estimate = |k: usize| Estimate { value: at[k], sigma: covariance[(k, k)].max(0.0).sqrt() };
    let of_mount = |k: usize, presumed: f64, alike: f64| {
        let Estimate { value, sigma } = estimate(k);
        Estimate { value, sigma: sigma.hypot(alike).hypot(PULL * (value - presumed)) }
    };
    Ok(Calibration {
        x_m: of_mount(0, presumed.x, ALIKE_M),
        y_m: of_mount(1, presumed.y, ALIKE_M),
        yaw_rad: of_mount(2, presumed.theta, ALIKE_RAD),
        translation_scale: estimate(3),
        rotation_scale: estimate(4),
        drift_rad_per_m: estimate(5),
        lag_s: tells_time.then(|| estimate(LAG)),
        stretches: stretches.len(),
    })
}

/// Whether stamps tell a lag: those of a logger that wrote them in bursts do not say when scans were taken, and between scans far apart
/// nobody knows where the robot was.
fn tells_time(runs: &[Vec<Sample>]) -> bool {
    let pairs = runs.iter().flat_map(|run| run.windows(2));
    let mut apart_s: Vec<_> = pairs.map(|pair| pair[1].stamp.secs_since(pair[0].stamp)).collect();
    apart_s.sort_unstable_by(f64::total_cmp);
    let tenth = |of_ten: usize| apart_s.get(of_ten * apart_s.len() / 10).copied().unwrap_or(0.0);
    tenth(1) > BURST * tenth(9) && tenth(5) <= KNOWN_WITHIN_S
}

/// Part of a run, from one of its scans to another.
#[derive(Debug, Clone, Copy)]
struct Stretch<'a> {
    run: &'a [Sample],
    from: usize,
    to: usize,
}

fn stretches_of(run: &[Sample]) -> Vec<Stretch<'_>> {
    let (Some(first), Some(last)) = (run.first(), run.last()) else { return Vec::new() };
    let inside = |sample: &Sample| {
        sample.stamp.secs_since(first.stamp) >= MARGIN_S && last.stamp.secs_since(sample.stamp) >= MARGIN_S
    };
    let mut stretches = Vec::new();
    let (mut start, mut turned, mut driven_m) = (None, 0.0, 0.0);
    for to in 1..run.len() {
        let Some(from) = start.filter(|_| inside(&run[to])) else {
            start = start.or(Some(to).filter(|&k| inside(&run[k])));
            continue;
        };
        let step = run[to - 1].map_from_laser.between(run[to].map_from_laser);
        turned += step.theta.abs();
        driven_m += step.x.hypot(step.y);
        if turned >= STRETCH_RAD || driven_m >= STRETCH_M {
            stretches.push(Stretch { run, from, to });
            (start, turned, driven_m) = (Some(to), 0.0, 0.0);
        }
    }
    stretches
}

/// The laser at a sample's stamp less a lag: between the scans around then, or the nearest where that is not known.
fn laser_before(run: &[Sample], at: usize, lag_s: f64) -> Pose2 {
    // Counted in seconds since the sample: negative before it.
    let since = |k: usize| run[k].stamp.secs_since(run[at].stamp);
    let mut before = at;
    while before > 0 && since(before) > -lag_s {
        before -= 1;
    }
    while before + 1 < run.len() && since(before + 1) <= -lag_s {
        before += 1;
    }
    let here = run[before].map_from_laser;
    let Some(after) = run.get(before + 1) else { return here };
    let between_s = after.stamp.secs_since(run[before].stamp);
    let share = if between_s > 0.0 { ((-lag_s - since(before)) / between_s).clamp(0.0, 1.0) } else { 0.0 };
    let share = if between_s > KNOWN_WITHIN_S { share.round() } else { share };
    let step = here.between(after.map_from_laser);
    here * Pose2::new(share * step.x, share * step.y, share * step.theta)
}

/// A stretch looked at with a certain lag.
struct Look {
    /// What the wheels said.
    said: Pose2,
    /// The laser's motion from part to part, with the lag and with somewhat less and more.
    parts: [Vec<Part>; 3],
}

/// Part of the laser's motion; sine and cosine of its turn.
struct Part {
    laser0_from_laser1: Pose2,
    sin: f64,
    cos: f64,
}

impl Part {
    fn of(laser0_from_laser1: Pose2) -> Self {
        let (sin, cos) = laser0_from_laser1.theta.sin_cos();
        Self { laser0_from_laser1, sin, cos }
    }
}

impl Stretch<'_> {
    fn laser0_from_laser1(&self) -> Pose2 {
        self.run[self.from].map_from_laser.between(self.run[self.to].map_from_laser)
    }

    fn look(&self, lag_s: f64) -> Look {
        let scans = self.to - self.from;
        let count = scans.min(PARTS);
        let parts = [0.0, -LAG_STEP_S, LAG_STEP_S].map(|more_s| {
            let at = |part: usize| laser_before(self.run, self.from + part * scans / count, lag_s + more_s);
            let mut before = at(0);
            let mut part = |k| {
                let from = std::mem::replace(&mut before, at(k));
                Part::of(from.between(before))
            };
            (1..=count).map(&mut part).collect()
        });
        Look { said: self.run[self.from].odom_from_robot.between(self.run[self.to].odom_from_robot), parts }
    }
}

/// What wheels with these errors say of a laser's motion.
fn predicted(at: &Vector, parts: &[Part]) -> Pose2 {
    let (sin, cos) = at[2].sin_cos();
    parts.iter().fold(Pose2::IDENTITY, |sum, part| {
        // robot_from_laser * laser0_from_laser1 * laser_from_robot
        let Pose2 { x, y, theta } = part.laser0_from_laser1;
        let ahead_m = cos * x - sin * y + at[0] - (part.cos * at[0] - part.sin * at[1]);
        let left_m = sin * x + cos * y + at[1] - (part.sin * at[0] + part.cos * at[1]);
        let (x_m, y_m) = (ahead_m / at[3], left_m / at[3]);
        let drift_rad = at[5] * x_m.hypot(y_m).copysign(x_m);
        sum * Pose2::new(x_m, y_m, (theta - drift_rad) / at[4])
    })
}

impl Look {
    /// How far what was said lies from what was to be expected, and the derivative of each residual by each parameter.
    fn residual(&self, at: &Vector) -> ([f64; RESIDUALS], [Vector; RESIDUALS]) {
        let [parts, sooner, later] = &self.parts;
        let expected = predicted(at, parts);
        let mut rows = [Vector::zeros(); RESIDUALS];
        for k in 0..PARAMETERS {
            let (change, per) = if k == LAG {
                (predicted(at, sooner).between(predicted(at, later)), 2.0 * LAG_STEP_S)
            } else {
                let mut ahead = *at;
                ahead[k] += STEP;
                (expected.between(predicted(&ahead, parts)), STEP)
            };
            for (row, change) in rows.iter_mut().zip([change.x, change.y, change.theta]) {
                row[k] = change / per;
            }
        }
        let error = self.said.between(expected);
        ([error.x, error.y, error.theta], rows)
    }
}

/// Standard deviation of each residual from its median absolute value.
fn robust_scales(residuals: &[([f64; RESIDUALS], [Vector; RESIDUALS])]) -> [f64; RESIDUALS] {
    std::array::from_fn(|k| {
        let mut sizes: Vec<_> = residuals.iter().map(|(r, _)| r[k].abs()).collect();
        sizes.sort_unstable_by(f64::total_cmp);
        (1.4826 * sizes[sizes.len() / 2]).max(1e-6)
    })
}

/// The equations that the estimate solves, `sum Z^T W r = 0`, where `Z` are the derivatives without those of positions by the lag.
struct Normal {
    gradient: Vector,
    /// Derivative of the gradient with the weights held, by which the estimate steps, and with all.
    held: Matrix,
    bread: Matrix,
    gradient_spread: Matrix,
}

impl Normal {
    fn at(stretches: &[Stretch<'_>], at: &Vector, tells_time: bool) -> Self {
        let residuals: Vec<_> = stretches.iter().map(|stretch| stretch.look(at[LAG]).residual(at)).collect();
        let scales = robust_scales(&residuals);
        let zero = Matrix::zeros();
        let mut normal = Self { gradient: Vector::zeros(), held: zero, bread: zero, gradient_spread: zero };
        for together in residuals.chunks(CLUSTER) {
            let mut own = Vector::zeros();
            for (residual, rows) in together {
                for (k, ((row, residual), scale)) in rows.iter().zip(residual).zip(scales).enumerate() {
                    let (mut instrument, mut row) = (*row, *row);
                    if k != HEADING {
                        instrument[LAG] = 0.0;
                    }
                    if !tells_time {
                        (instrument[LAG], row[LAG]) = (0.0, 0.0);
                    }
                    let (sigmas, information) = (residual.abs() / scale, 1.0 / (scale * scale));
                    let product = instrument * row.transpose() * information;
                    own += instrument * (information * residual * (HUBER / sigmas).min(1.0));
                    normal.held += product * (HUBER / sigmas).min(1.0);
                    if sigmas <= HUBER {
                        normal.bread += product;
                    }
                }
            }
            normal.gradient += own;
            normal.gradient_spread += own * own.transpose();
        }
        if !tells_time {
            (normal.held[(LAG, LAG)], normal.bread[(LAG, LAG)]) = (1.0, 1.0);
        }
        normal
    }

    fn step(&self) -> Option<Vector> {
        let step = self.held.lu().solve(&self.gradient)?;
        step.iter().all(|v| v.is_finite()).then_some(step)
    }

    fn covariance(&self) -> Option<Matrix> {
        let inverse = self.bread.try_inverse()?;
        Some(inverse * self.gradient_spread * inverse.transpose())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may")]
mod tests {
    use super::*;
    use mapwright_sim::Rng;

    /// So many steps from scan to scan, each so long, seconds.
    const STEPS: usize = 10;
    const STEP_S: f64 = 0.01;
    const SCANS: usize = 4000;

    /// A drive with turns to both sides whose wheels scatter and lag by so many steps; along its way a match says what the wheels do,
    /// if asked for, as in a corridor.
    fn scattered(robot_from_laser: Pose2, lag_steps: usize, in_corridor: bool) -> Vec<Sample> {
        let mut rng = Rng::new(7);
        let steps: Vec<[Pose2; 2]> = (0..STEPS * SCANS)
            .map(|k| {
                let at_s = STEP_S * k as f64;
                let ahead_m = STEP_S * (0.3 + 0.2 * (0.9 * at_s).sin());
                let turn_rad = STEP_S * 0.8 * (0.3 * at_s).sin().powi(5);
                let said = Pose2::new(ahead_m * 1.02 + rng.normal(0.002), 0.0, turn_rad * 0.97 + rng.normal(0.0025));
                [Pose2::new(ahead_m, 0.0, turn_rad), said]
            })
            .collect();
        let [mut map_from_robot, mut odom_from_robot] = [Pose2::IDENTITY; 2];
        let mut samples = Vec::new();
        for (k, [moved, _]) in steps.iter().enumerate().skip(lag_steps) {
            let [_, said] = steps[k - lag_steps];
            if (k - lag_steps).is_multiple_of(STEPS) {
                let map_from_laser = map_from_robot * robot_from_laser;
                samples.push(Sample {
                    stamp: Stamp::from_secs_f64(STEP_S * k as f64),
                    odom_from_robot,
                    map_from_laser,
                });
            }
            let ahead_m = if in_corridor { said.x } else { moved.x };
            map_from_robot = map_from_robot * Pose2::new(ahead_m, 0.0, moved.theta);
            odom_from_robot = odom_from_robot * said;
        }
        samples
    }

    #[test]
    fn scatter_of_the_wheels_makes_nothing_smaller() {
        let found = calibrate(&[scattered(Pose2::new(0.2, -0.1, 0.1), 12, false)], Pose2::IDENTITY).unwrap();
        let near = |what: &str, Estimate { value, sigma }: Estimate, truth: f64, within: f64| {
            let off = (value - truth).abs();
            assert!(off < within && off < 3.0 * sigma, "{what}: {value} +- {sigma} instead of {truth}");
        };
        near("lag", found.lag_s.unwrap(), 0.12, 0.01);
        near("x", found.x_m, 0.2, 0.01);
        near("y", found.y_m, -0.1, 0.02);
        near("yaw", found.yaw_rad, 0.1, 0.003);
        near("scale of turns", found.rotation_scale, 1.0 / 0.97, 0.006);
    }

    #[test]
    fn a_match_that_follows_the_wheels_hides_no_lag() {
        let found = calibrate(&[scattered(Pose2::IDENTITY, 12, true)], Pose2::IDENTITY).unwrap();
        let Estimate { value, sigma } = found.lag_s.unwrap();
        assert!((value - 0.12).abs() < 0.01 && (value - 0.12).abs() < 3.0 * sigma, "{value} +- {sigma}");
    }

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
        near(found.lag_s.unwrap(), 0.0);
    }

    #[test]
    fn stamps_in_bursts_tell_no_lag() {
        let mut samples = scattered(Pose2::new(0.2, -0.1, 0.1), 0, false);
        for (k, sample) in samples.iter_mut().enumerate() {
            sample.stamp = Stamp((k / 4) as i64 * 400_000_000 + (k % 4) as i64 * 1_000_000);
        }
        let found = calibrate(&[samples], Pose2::IDENTITY).unwrap();
        assert_eq!(found.lag_s, None);
        assert!((found.x_m.value - 0.2).abs() < 3.0 * found.x_m.sigma, "{:?}", found.x_m);
    }

    #[test]
    fn scans_seconds_apart_tell_no_lag() {
        let mut samples = scattered(Pose2::new(0.2, -0.1, 0.1), 0, false);
        // as a logger with stamps in whole seconds writes them
        for (k, sample) in samples.iter_mut().enumerate() {
            sample.stamp = Stamp((6 * k + usize::from(k % 3 == 0)) as i64 * 1_000_000_000);
        }
        let found = calibrate(&[samples], Pose2::IDENTITY).unwrap();
        assert_eq!(found.lag_s, None);
        assert!((found.x_m.value - 0.2).abs() < 3.0 * found.x_m.sigma, "{:?}", found.x_m);
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
