//! Where the laser sits and what the wheels get wrong, from matched poses and odometry.
//!
//! Over a stretch of the drive, the matched motion of the laser and odometry's motion of the robot must agree through the
//! laser's mount: `odometry(robot_from_laser * laser0_from_laser1 * laser_from_robot)` is what the wheels report (hand-eye
//! calibration in the plane, with the wheels' errors estimated beside it; after Censi et al. 2013). The mount's position
//! shows only in turns, its heading only on the move; odometry that lags behind the laser reports where the robot was then.
//!
//! The wheels' report is what is predicted, because it is what is noisy: noise in what is predicted *from* makes whatever is
//! estimated too small. For the same reason lag is told by headings alone: along a corridor a match is what the wheels had
//! predicted, as if they had no lag. Levenberg-Marquardt with Huber weights, from the heading that the wheels' ways suggest; then, with the
//! lag, Newton's steps, which must converge to something that a robot can have, or nothing is said. The uncertainty is the sandwich
//! `B^-1 (sum Z^T W r r^T W Z) B^-T` over groups of successive stretches, which stays honest where residuals are neither equal
//! nor normal nor independent of their neighbours, and what is alike all over the drive, which no scatter shows, beside it.

pub(crate) mod words;

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
/// Successive stretches whose residuals may have a cause in common, at most; of a short drive fewer, so that there are so many groups.
const CLUSTER: usize = 10;
const CLUSTERS_LEAST: usize = 3 * PARAMETERS;
const ITERATIONS: usize = 30;
/// Damping at first, relative to each parameter's own information; what a step that makes things better or worse multiplies it by; and the
/// damping with which no step is left.
const DAMPING: f64 = 1e-3;
const DAMPING_LESS: f64 = 0.1;
const DAMPING_MORE: f64 = 10.0;
const DAMPING_MOST: f64 = 1e8;
/// One step changes the parameters by so much at most: metres, radians, scales, radians a metre and seconds.
const STEP_MOST: [f64; PARAMETERS] = [0.3, 0.3, 0.3, 0.1, 0.1, 0.3, 0.3];
/// The estimate stands still when no parameter changes by more, or by more than so much of its deviation.
const STILL: f64 = 1e-6;
const STILL_SIGMAS: f64 = 0.1;
/// Steps for numerical derivatives; the model is smooth on this scale.
const STEP: f64 = 1e-6;
/// The same for the lag, seconds: poses are noisy, so that a speed is told over a while.
const LAG_STEP_S: f64 = 0.1;
/// Stretches without which nothing is said; of a drive with fewer they are shorter, down to such a share.
const STRETCHES_AT_LEAST: usize = 30;
const SHORTEST: f64 = 0.25;
/// Turning in all without which the mount's position does not show, radians.
const TURN_AT_LEAST_RAD: f64 = 2.0;
/// A laser sits at most so far from the point about which its robot turns, metres, and what wheels say is within such a factor of the truth.
const MOUNT_MOST_M: f64 = 20.0;
const SCALES: std::ops::RangeInclusive<f64> = 0.2..=5.0;
/// A place less certain than a robot is large, metres, and a heading less certain than that, radians, are none.
const SIGMA_MOST_M: f64 = 0.3;
const SIGMA_MOST_RAD: f64 = 0.2;
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

impl Calibration {
    /// Of odometry that was put right by so much before.
    pub(crate) fn lagging(self, by_s: f64) -> Self {
        let lag_s = self.lag_s.map(|lag| Estimate { value: lag.value + by_s, ..lag });
        Self { lag_s, ..self }
    }
}

/// Estimates mount and wheels from scans that were tracked, in runs without a break; the mapper had the laser where it is presumed.
pub(crate) fn calibrate(runs: &[Vec<Sample>], presumed: Pose2) -> Result<Calibration, String> {
    let stretches = stretches_of_all(runs);
    let turned: f64 = stretches.iter().map(|s| s.laser0_from_laser1().theta.abs()).sum();
    if stretches.len() < STRETCHES_AT_LEAST || turned < TURN_AT_LEAST_RAD {
        return Err(format!(
            "expected at least {STRETCHES_AT_LEAST} stretches of {:.2} m or {:.0} deg, driven with odometry and tracked, and {TURN_AT_LEAST_RAD:.0} \
             rad of turning in all, found {} stretches and {turned:.1} rad",
            SHORTEST * STRETCH_M,
            (SHORTEST * STRETCH_RAD).to_degrees(),
            stretches.len()
        ));
    }
    let tells_time = tells_time(runs);
    let heading_rad = heading_suggested(&stretches).unwrap_or(presumed.theta);
    let start = Vector::from([presumed.x, presumed.y, heading_rad, 1.0, 1.0, 0.0, 0.0]);
    let (mut at, covariance) = solved(&stretches, damped(&stretches, start), tells_time)?;
    // as near to what is presumed as the circle allows
    at[2] = presumed.theta + wrapped(at[2] - presumed.theta);
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

/// The laser's heading by which the directions of its ways are those of the wheels': the mean over stretches that lead ahead, weighed by
/// both ways. None where none do.
fn heading_suggested(stretches: &[Stretch<'_>]) -> Option<f64> {
    let (mut sin, mut cos) = (0.0, 0.0);
    for stretch in stretches {
        let (seen, said) = (stretch.laser0_from_laser1(), stretch.said());
        if seen.theta.abs() < 0.5 * STRETCH_RAD {
            // of the complex numbers said * conj(seen)
            cos += said.x * seen.x + said.y * seen.y;
            sin += said.y * seen.x - said.x * seen.y;
        }
    }
    (f64::hypot(sin, cos) > 0.0).then(|| sin.atan2(cos))
}

/// From a start that may be far off to where the residuals are least, as if nothing lagged (Levenberg-Marquardt).
fn damped(stretches: &[Stretch<'_>], start: Vector) -> Vector {
    let (mut at, mut damping) = (start, DAMPING);
    let mut normal = Normal::at(stretches, &at, false);
    for _ in 0..ITERATIONS {
        let Some(step) = normal.step(damping) else { break };
        let next = at - step;
        if step.iter().all(|v| v.is_finite())
            && cost(stretches, &next, normal.scales) <= cost(stretches, &at, normal.scales)
        {
            at = next;
            normal = Normal::at(stretches, &at, false);
            damping *= DAMPING_LESS;
            if step.amax() < STILL {
                break;
            }
        } else {
            damping *= DAMPING_MORE;
            if damping > DAMPING_MOST {
                break;
            }
        }
    }
    at
}

/// Huber's cost of all residuals.
fn cost(stretches: &[Stretch<'_>], at: &Vector, scales: [f64; RESIDUALS]) -> f64 {
    let of_one = |stretch: &Stretch<'_>| {
        let errors = stretch.look(at[LAG]).error(at);
        let sigmas = errors.iter().zip(scales).map(|(error, scale)| error.abs() / scale);
        sigmas.map(|s| if s <= HUBER { 0.5 * s * s } else { HUBER * (s - 0.5 * HUBER) }).sum::<f64>()
    };
    stretches.iter().map(of_one).sum()
}

/// The solution near a start, and its covariance; or why there is none.
fn solved(stretches: &[Stretch<'_>], start: Vector, tells_time: bool) -> Result<(Vector, Matrix), String> {
    let undetermined = || "the drive does not show all of mount and wheels: more turns are needed".to_owned();
    let (mut at, mut is_still) = (start, false);
    let mut normal = Normal::at(stretches, &at, tells_time);
    for _ in 0..ITERATIONS {
        let step = normal.step(0.0).ok_or_else(undetermined)?;
        let most = step.iter().zip(STEP_MOST).map(|(step, most)| step.abs() / most).fold(1.0, f64::max);
        at -= step / most;
        at[LAG] = at[LAG].clamp(-LAG_AT_MOST_S, LAG_AT_MOST_S);
        normal = Normal::at(stretches, &at, tells_time);
        let sigmas = normal.covariance().map_or(Vector::zeros(), |covariance| covariance.diagonal().map(f64::sqrt));
        is_still = step.iter().zip(&sigmas).all(|(step, sigma)| step.abs() < STILL.max(STILL_SIGMAS * sigma));
        if step.amax() < STILL {
            break;
        }
    }
    let covariance = normal.covariance().ok_or_else(undetermined)?;
    let [sigma_x_m, sigma_y_m, sigma_rad] = [0, 1, 2].map(|k| covariance[(k, k)].sqrt());
    // a NaN is nothing that is known
    if !(sigma_x_m.max(sigma_y_m) <= SIGMA_MOST_M && sigma_rad <= SIGMA_MOST_RAD) {
        return Err(undetermined());
    }
    let is_possible = at[0].hypot(at[1]) <= MOUNT_MOST_M && SCALES.contains(&at[3]) && SCALES.contains(&at[4]);
    if !is_still || !is_possible {
        return Err(
            "wheels and scans do not agree on any place of the laser: are odometry and the laser's angles right?"
                .to_owned(),
        );
    }
    Ok((at, covariance))
}

fn wrapped(angle_rad: f64) -> f64 {
    angle_rad.sin().atan2(angle_rad.cos())
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

/// Those of all runs, as long as there are enough of them, else shorter.
fn stretches_of_all(runs: &[Vec<Sample>]) -> Vec<Stretch<'_>> {
    let mut share = 1.0;
    loop {
        let stretches: Vec<_> = runs.iter().flat_map(|run| stretches_of(run, share)).collect();
        if stretches.len() >= 2 * STRETCHES_AT_LEAST || share <= SHORTEST {
            return stretches;
        }
        share *= 0.5;
    }
}

fn stretches_of(run: &[Sample], share: f64) -> Vec<Stretch<'_>> {
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
        if turned >= share * STRETCH_RAD || driven_m >= share * STRETCH_M {
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

    /// The robot's motion by the wheels.
    fn said(&self) -> Pose2 {
        self.run[self.from].odom_from_robot.between(self.run[self.to].odom_from_robot)
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
        Look { said: self.said(), parts }
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
    fn error(&self, at: &Vector) -> [f64; RESIDUALS] {
        let error = self.said.between(predicted(at, &self.parts[0]));
        [error.x, error.y, error.theta]
    }

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
    /// Groups of stretches that the spread is of.
    groups: usize,
    scales: [f64; RESIDUALS],
}

impl Normal {
    fn at(stretches: &[Stretch<'_>], at: &Vector, tells_time: bool) -> Self {
        let residuals: Vec<_> = stretches.iter().map(|stretch| stretch.look(at[LAG]).residual(at)).collect();
        let scales = robust_scales(&residuals);
        let zero = Matrix::zeros();
        let mut normal =
            Self { gradient: Vector::zeros(), held: zero, bread: zero, gradient_spread: zero, groups: 0, scales };
        for together in residuals.chunks((residuals.len() / CLUSTERS_LEAST).clamp(1, CLUSTER)) {
            normal.groups += 1;
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

    fn step(&self, damping: f64) -> Option<Vector> {
        let mut damped = self.held;
        for k in 0..PARAMETERS {
            damped[(k, k)] *= 1.0 + damping;
        }
        let step = damped.lu().solve(&self.gradient)?;
        step.iter().all(|v| v.is_finite()).then_some(step)
    }

    /// The sandwich; a few groups scatter less about an estimate that was made of them than about the truth.
    fn covariance(&self) -> Option<Matrix> {
        let inverse = self.bread.try_inverse()?;
        let groups = self.groups as f64;
        let unbiased = groups / (groups - PARAMETERS as f64);
        Some(inverse * self.gradient_spread * inverse.transpose() * unbiased)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may")]
mod tests;
