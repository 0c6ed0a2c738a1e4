//! How an inertial sensor sits on the robot and by how much its stamps are late, from turns of matched clouds.
//!
//! Between two clouds the robot turns by what the gyroscope has read, seen through its mount: as rotation vectors
//! `matched = R * read(from + lag, to + lag, bias)`, for a rotation's vector turns with its axes. First every lag of a grid is tried with the
//! rotation that fits best ([`BestRotation`]) and errors of Student's distribution; then rotation, bias and lag are found together by
//! Gauss-Newton's steps with Huber weights. The uncertainty is the sandwich over groups of successive turns, as of the mount in the plane
//! (docs/decisions/0028-calibration.md), and what is known of any sensor before stands beside it: so a turn that the motion does not show
//! comes out as uncertain as it was.

use crate::lag::surprise;
use mapwright_geom::{BestRotation, Stamp, skew};
use mapwright_sensor::{ImuReading, ImuReadings};
use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};

/// Rotation about the robot's axes, bias along the sensor's axes as told, lag.
const PARAMETERS: usize = 7;
const LAG: usize = 6;
type Vector = SVector<f64, PARAMETERS>;
type Matrix = SMatrix<f64, PARAMETERS, PARAMETERS>;

/// Lags are looked for up to so much to either side, in such steps, seconds.
const LAG_MOST_S: f64 = 0.5;
const LAG_STEP_S: f64 = 0.01;
/// The derivative by the lag is that over so much to either side, seconds: single readings are noisy.
const SLOPE_S: f64 = 0.005;
/// Turns that are used, radians: more than noise makes up, less than half a turn.
const TELLING_RAD: [f64; 2] = [0.03, 1.5];
/// A turn ends after so much, radians, or so long, seconds: poses are as wrong after a large turn as after a small one.
const STRETCH_RAD: f64 = 0.2;
const STRETCH_S: f64 = 1.0;
/// Turns, and turning in all, radians, without which nothing is said.
const TURNS_LEAST: usize = 20;
const TURNED_LEAST_RAD: f64 = 2.0;
/// What is kept at most: turns of ten minutes or more, and readings of ten minutes at a thousand a second.
const TURNS_KEPT: usize = 3000;
const READINGS_KEPT: usize = 600_000;
/// What is known of a sensor before: its rotation, radians, bias, radians a second, and lag, seconds; standard deviations.
const BEFORE: [f64; 3] = [1.0, 0.05, 0.3];
/// What no scatter shows, for it is alike all over a drive: matched turns are off by so much, radians, and so much later or earlier than the
/// middle of the sweep, seconds, as what is seen best may stand at one end of it. Simulated drives whose floor tilts the robot by half a degree
/// are off by so much.
const ALIKE_RAD: f64 = 0.0003;
const ALIKE_S: f64 = 0.001;
/// A rotation less certain than this about some axis, radians, and a lag less certain than that, seconds, are not told by the motion.
const KNOWN_RAD: f64 = 0.05;
const KNOWN_S: f64 = 0.03;
/// Vectors that have less than this in common along a second direction, beside the first, lie on one line.
const LINE_SHARE: f64 = 1e-3;
/// Turns that are read so many times as large as matched ones are in degrees a second: half of what that makes, in logarithms.
const DEGREES_TIMES: f64 = 7.5;
/// What is left of half of the turns is more than this share of them: no mount explains what was read.
const LEFT_MOST: f64 = 0.3;
/// Residuals beyond so many robust standard deviations lose weight (Huber 1964).
const HUBER: f64 = 1.345;
/// The length of a vector of three standard normal numbers: its median.
const MEDIAN_OF_THREE: f64 = 1.538;
/// No match is better than this, radians.
const LEAST_RAD: f64 = 1e-4;
/// Successive turns whose residuals may have a cause in common, at most; of few turns fewer, so that there are so many groups.
const CLUSTER: usize = 10;
const CLUSTERS_LEAST: usize = 3 * PARAMETERS;
const ITERATIONS: usize = 30;
/// The estimate stands still when no parameter changes by more: radians, radians a second, seconds.
const STILL: f64 = 1e-7;

/// How an inertial sensor sits and reads beside what was told of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ImuFit {
    /// Turns what was read, as told, into the robot's frame: identity where it sits as told.
    pub robot_from_told: UnitQuaternion<f64>,
    /// Covariance of its left perturbation, about the robot's axes, rad^2.
    pub rotation_covariance_rad2: Matrix3<f64>,
    /// A reading with the stamp `t` was taken at `t - lag_s` by the clouds' clock, seconds.
    pub lag_s: f64,
    /// Its standard deviation, seconds.
    pub lag_sigma_s: f64,
    /// What the gyroscope reads at rest, along its axes as told, radians a second.
    pub bias_rad_per_s: [f64; 3],
    /// Standard deviations of that, radians a second.
    pub bias_sigma_rad_per_s: [f64; 3],
    /// Turns between clouds that were used.
    pub turns: usize,
    /// How far they lead in all, radians.
    pub turned_rad: f64,
    /// How far matched and read turns differ, radians: the robust standard deviation of each component.
    pub residual_rad: f64,
}

impl ImuFit {
    /// Whether the motion tells how the sensor is turned about every axis.
    #[must_use]
    pub fn knows_rotation(&self) -> bool {
        self.least_known().1 <= KNOWN_RAD
    }

    /// Whether the motion tells by how much its stamps are late.
    #[must_use]
    pub fn knows_lag(&self) -> bool {
        self.lag_sigma_s <= KNOWN_S
    }

    /// The robot's axis about which it is least known how the sensor is turned, and the standard deviation of that, radians.
    #[must_use]
    pub fn least_known(&self) -> (Vector3<f64>, f64) {
        let parts = self.rotation_covariance_rad2.symmetric_eigen();
        let most = parts.eigenvalues.imax();
        (parts.eigenvectors.column(most).into_owned(), parts.eigenvalues[most].max(0.0).sqrt())
    }
}

/// A turn between the middles of two sweeps.
#[derive(Debug, Clone, Copy)]
struct Turn {
    from: Stamp,
    to: Stamp,
    /// As matched, in the robot's frame.
    rad: Vector3<f64>,
}

/// Learns how an inertial sensor sits from matched clouds and readings; these may come late.
#[derive(Debug, Clone)]
pub struct ImuCalibrator {
    readings: ImuReadings,
    turns: Vec<Turn>,
    /// Where the turn that is not over began.
    began: Option<(Stamp, UnitQuaternion<f64>)>,
}

impl Default for ImuCalibrator {
    fn default() -> Self {
        Self { readings: ImuReadings::keeping(READINGS_KEPT), turns: Vec::new(), began: None }
    }
}

impl ImuCalibrator {
    /// A reading, turned by the mount that is told.
    pub fn add_reading(&mut self, reading: ImuReading) {
        if self.readings.len() < READINGS_KEPT && self.turns.len() < TURNS_KEPT {
            self.readings.add(reading);
        }
    }

    /// How the robot stood in the middle of a sweep, in the order of time, as matched without the readings or with what is known of them.
    pub fn add_pose(&mut self, middle: Stamp, local_from_robot: UnitQuaternion<f64>) {
        let (from, local_from_then) = *self.began.get_or_insert((middle, local_from_robot));
        let rad = (local_from_then.inverse() * local_from_robot).scaled_axis();
        if rad.norm() < STRETCH_RAD && middle.secs_since(from) < STRETCH_S {
            return;
        }
        if (TELLING_RAD[0]..TELLING_RAD[1]).contains(&rad.norm()) && middle > from && self.turns.len() < TURNS_KEPT {
            self.turns.push(Turn { from, to: middle, rad });
        }
        self.began = Some((middle, local_from_robot));
    }

    /// The next pose is in no known relation to the last one.
    pub fn break_off(&mut self) {
        self.began = None;
    }

    /// The estimate.
    ///
    /// # Errors
    /// What the motion would have to be, or that nothing fits, in words.
    pub fn fit(&self) -> Result<ImuFit, String> {
        let steps = (LAG_MOST_S / LAG_STEP_S).round() as i32;
        let lags_s: Vec<f64> = (-steps..=steps).map(|step| LAG_STEP_S * f64::from(step)).collect();
        let is_covered = |turn: &&Turn| {
            [-LAG_MOST_S - SLOPE_S, LAG_MOST_S + SLOPE_S]
                .iter()
                .all(|lag_s| turn.read(&self.readings, *lag_s, Vector3::zeros()).is_some())
        };
        let turns: Vec<Turn> = self.turns.iter().filter(is_covered).copied().collect();
        let turned_rad = turns.iter().fold(0.0, |sum, turn| sum + turn.rad.norm());
        if turns.len() < TURNS_LEAST || turned_rad < TURNED_LEAST_RAD {
            return Err(format!(
                "expected at least {TURNS_LEAST} turns of {:.0} to {:.0} deg within a second or from cloud to cloud, with readings {LAG_MOST_S} s before and after, and \
                 {TURNED_LEAST_RAD:.0} rad of turning in all, found {} and {turned_rad:.1} rad",
                TELLING_RAD[0].to_degrees(),
                TELLING_RAD[1].to_degrees(),
                turns.len()
            ));
        }
        if self.times_matched(&turns) > DEGREES_TIMES {
            return Err(
                "turn rates are some 57 times those of matches: expected radians a second, found degrees".to_owned()
            );
        }
        let known = Known { readings: &self.readings, turns: &turns };
        let tried: Vec<(f64, UnitQuaternion<f64>)> = lags_s.iter().filter_map(|lag_s| known.try_lag(*lag_s)).collect();
        let best = (0..tried.len()).reduce(|a, b| if tried[b].0 < tried[a].0 { b } else { a });
        let best = best.filter(|_| tried.len() == lags_s.len()).ok_or("turns that were read are not finite")?;
        let fit = known.refined(tried[best].1, lags_s[best])?;
        if fit.lag_s.abs() > LAG_MOST_S - LAG_STEP_S {
            return Err(format!(
                "readings fit best {:.2} s beside their stamps, or farther: expected stamps of one clock, within {LAG_MOST_S} s",
                fit.lag_s
            ));
        }
        Ok(ImuFit { turned_rad, ..fit })
    }

    /// How many times as large as matched turns those are that were read.
    fn times_matched(&self, turns: &[Turn]) -> f64 {
        let length = |turn: &Turn| {
            let pieces = self.readings.pieces(turn.from, turn.to);
            pieces.map(|piece| piece.turn_rate_rad_per_s * piece.elapsed_s).sum::<Vector3<f64>>().norm()
        };
        let (read, matched) =
            turns.iter().fold((0.0, 0.0), |sum, turn| (sum.0 + length(turn), sum.1 + turn.rad.norm()));
        read / matched
    }
}

impl Turn {
    /// As it was read with some lag, and its right perturbation's derivative by the bias, seconds.
    fn read(&self, readings: &ImuReadings, lag_s: f64, bias: Vector3<f64>) -> Option<(Vector3<f64>, Matrix3<f64>)> {
        let [from, to] = [self.from, self.to].map(|stamp| Stamp(stamp.0.saturating_add(Stamp::from_secs_f64(lag_s).0)));
        let turned = readings.turned(from, to, bias)?;
        Some((turned.start_from_end.scaled_axis(), turned.by_bias_s))
    }
}

/// What an estimate is made of.
struct Known<'a> {
    readings: &'a ImuReadings,
    turns: &'a [Turn],
}

/// An estimate on the way.
#[derive(Debug, Clone, Copy)]
struct At {
    rotation: UnitQuaternion<f64>,
    bias: Vector3<f64>,
    lag_s: f64,
}

impl At {
    fn moved(self, step: &Vector) -> Self {
        let by: Vector3<f64> = step.fixed_rows::<3>(0).into();
        Self {
            rotation: UnitQuaternion::from_scaled_axis(by) * self.rotation,
            bias: self.bias + step.fixed_rows::<3>(3),
            lag_s: self.lag_s + step[LAG],
        }
    }
}

/// What is left of a turn, and its derivatives by each parameter.
type Left = (Vector3<f64>, SMatrix<f64, 3, PARAMETERS>);

impl Known<'_> {
    /// How surprising what is left is with a lag, and the rotation that fits best with it.
    fn try_lag(&self, lag_s: f64) -> Option<(f64, UnitQuaternion<f64>)> {
        let read = self.turns.iter().map(|turn| Some(turn.read(self.readings, lag_s, Vector3::zeros())?.0));
        let read: Vec<Vector3<f64>> = read.collect::<Option<_>>()?;
        let (mut rotation, mut left) = (UnitQuaternion::identity(), vec![0.0; read.len()]);
        // all alike at first, then those that fit
        for _ in 0..3 {
            let scale = scale_of(left.iter().copied());
            let pairs = self.turns.iter().zip(&read).zip(&left);
            let across = pairs.map(|((turn, read), left)| turn.rad * read.transpose() * weight(left / scale)).sum();
            rotation = likeliest(&across)?;
            left = self.turns.iter().zip(&read).map(|(turn, read)| (turn.rad - rotation * read).norm()).collect();
        }
        Some((surprise(left.into_iter()), rotation))
    }

    /// What is left of each turn.
    fn left(&self, at: At) -> Option<Vec<Left>> {
        let rotation = at.rotation.to_rotation_matrix();
        let of_one = |turn: &Turn| {
            let (read, by_bias_s) = turn.read(self.readings, at.lag_s, at.bias)?;
            let beside = |by_s: f64| Some(turn.read(self.readings, at.lag_s + by_s, at.bias)?.0);
            let by_lag = (beside(SLOPE_S)? - beside(-SLOPE_S)?) / (2.0 * SLOPE_S);
            let seen = rotation * read;
            let mut slopes = SMatrix::<f64, 3, PARAMETERS>::zeros();
            slopes.fixed_columns_mut::<3>(0).copy_from(&skew(&seen));
            slopes.fixed_columns_mut::<3>(3).copy_from(&-(rotation.matrix() * log_slope(&read) * by_bias_s));
            slopes.fixed_columns_mut::<1>(LAG).copy_from(&-(rotation * by_lag));
            Some((turn.rad - seen, slopes))
        };
        self.turns.iter().map(of_one).collect()
    }

    /// How uncertain a rotation is about the robot's axes by what all turns are off by alike: the more, the less they lead across an axis.
    fn alike_rad2(&self) -> Option<Matrix3<f64>> {
        let across = |turn: &Turn| skew(&turn.rad).transpose() * skew(&turn.rad);
        let sum: Matrix3<f64> = self.turns.iter().map(across).sum();
        let mean_rad2 = sum / self.turns.len() as f64;
        (mean_rad2 / ALIKE_RAD.powi(2) + Matrix3::identity() / BEFORE[0].powi(2)).try_inverse()
    }

    /// Rotation, bias and lag together, from a start.
    fn refined(&self, rotation: UnitQuaternion<f64>, lag_s: f64) -> Result<ImuFit, String> {
        let uncovered = || "there are no readings around the turns that were matched".to_owned();
        let mut at = At { rotation, bias: Vector3::zeros(), lag_s };
        for _ in 0..ITERATIONS {
            let normal = Normal::of(&self.left(at).ok_or_else(uncovered)?, at);
            let step = normal.bread.cholesky().map(|bread| bread.solve(&normal.gradient));
            let step = step.filter(|step| step.iter().all(|v| v.is_finite())).ok_or_else(uncovered)?;
            at = at.moved(&-step);
            // beyond this nothing is read
            at.lag_s = at.lag_s.clamp(-LAG_MOST_S, LAG_MOST_S);
            if step.amax() < STILL {
                break;
            }
        }
        let normal = Normal::of(&self.left(at).ok_or_else(uncovered)?, at);
        let usual = median(self.turns.iter().map(|turn| turn.rad.norm()));
        if MEDIAN_OF_THREE * normal.scale > LEFT_MOST * usual {
            return Err(format!(
                "no mount explains what was read: of turns of {:.1} deg half differ from those of matches by {:.1} deg or more",
                usual.to_degrees(),
                (MEDIAN_OF_THREE * normal.scale).to_degrees()
            ));
        }
        let covariance = normal.covariance().ok_or_else(uncovered)?;
        let sigma = |k: usize| covariance[(k, k)].max(0.0).sqrt();
        Ok(ImuFit {
            robot_from_told: at.rotation,
            rotation_covariance_rad2: covariance.fixed_view::<3, 3>(0, 0) + self.alike_rad2().ok_or_else(uncovered)?,
            lag_s: at.lag_s,
            lag_sigma_s: sigma(LAG).hypot(ALIKE_S),
            bias_rad_per_s: at.bias.into(),
            bias_sigma_rad_per_s: [3, 4, 5].map(sigma),
            turns: self.turns.len(),
            turned_rad: 0.0,
            residual_rad: normal.scale,
        })
    }
}

/// The equations that the estimate solves.
struct Normal {
    /// Of half the cost, what is known before added.
    gradient: Vector,
    bread: Matrix,
    /// Spread of the gradient over groups of turns, and of what is known before.
    spread: Matrix,
    scale: f64,
}

impl Normal {
    fn of(left: &[Left], at: At) -> Self {
        let scale = scale_of(left.iter().map(|(left, _)| left.norm()));
        let [rotation, bias, lag] = BEFORE.map(|sigma: f64| sigma.powi(-2));
        let before = Matrix::from_diagonal(&Vector::from([rotation, rotation, rotation, bias, bias, bias, lag]));
        // of the rotation nothing is known but that it is one
        let mut from_before = Vector::zeros();
        from_before.fixed_rows_mut::<3>(3).copy_from(&at.bias);
        from_before[LAG] = at.lag_s;
        let (mut gradient, mut bread, mut spread) = (before * from_before, before, Matrix::zeros());
        let together = (left.len() / CLUSTERS_LEAST).clamp(1, CLUSTER);
        for group in left.chunks(together) {
            let mut own = Vector::zeros();
            for (left, slopes) in group {
                let information = weight(left.norm() / (MEDIAN_OF_THREE * scale)) / (scale * scale);
                own += slopes.transpose() * left * information;
                bread += slopes.transpose() * slopes * information;
            }
            gradient += own;
            spread += own * own.transpose();
        }
        let groups = left.len().div_ceil(together) as f64;
        // a few groups scatter less about an estimate that was made of them than about the truth
        let spread = spread * (groups / (groups - PARAMETERS as f64).max(1.0)) + before;
        Self { gradient, bread, spread, scale }
    }

    fn covariance(&self) -> Option<Matrix> {
        let inverse = self.bread.try_inverse()?;
        Some(inverse * self.spread * inverse)
    }
}

/// The rotation that fits best; of turns about one axis the shortest one that brings it where it belongs.
fn likeliest(across: &Matrix3<f64>) -> Option<UnitQuaternion<f64>> {
    let best = BestRotation::of(across)?;
    if best.common[1] > LINE_SHARE * best.common[0] {
        return Some(best.rotation);
    }
    let [matched, read] = best.principal;
    let reversed = || UnitQuaternion::from_axis_angle(&across_of(&read), std::f64::consts::PI);
    Some(UnitQuaternion::rotation_between(&read, &matched).unwrap_or_else(reversed))
}

/// A direction across another one: that of the axis which has least of it.
fn across_of(direction: &Vector3<f64>) -> nalgebra::Unit<Vector3<f64>> {
    nalgebra::Unit::new_normalize(direction.cross(&Vector3::ith(direction.iamin(), 1.0)))
}

/// From lengths of what is left, the standard deviation of each of three components.
fn scale_of(left: impl Iterator<Item = f64>) -> f64 {
    (median(left) / MEDIAN_OF_THREE).max(LEAST_RAD)
}

fn median(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.collect();
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(0.0)
}

/// Huber's.
fn weight(sigmas: f64) -> f64 {
    if sigmas <= HUBER { 1.0 } else { HUBER / sigmas }
}

/// How a rotation's vector changes with its right perturbation: the inverse of the right Jacobian (Forster et al. 2017, eq. 9).
fn log_slope(rad: &Vector3<f64>) -> Matrix3<f64> {
    let (angle_rad, across) = (rad.norm(), skew(rad));
    let second = if angle_rad < 1e-4 {
        1.0 / 12.0
    } else {
        1.0 / (angle_rad * angle_rad) - (1.0 + angle_rad.cos()) / (2.0 * angle_rad * angle_rad.sin())
    };
    Matrix3::identity() + 0.5 * across + second * across * across
}

#[cfg(test)]
mod tests;
