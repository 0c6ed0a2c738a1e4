//! By how much odometry lags behind the laser: the turns that successive scans show beside those of which the wheels tell.

mod panorama;

use mapwright_geom::Stamp;
use mapwright_sensor::{LaserModel, LaserScan, Odometry};
use panorama::Panorama;
use std::sync::Arc;

/// Lags are looked for up to so much to either side, in such steps, seconds.
const LAG_MOST_S: f64 = 0.6;
const LAG_STEP_S: f64 = 0.01;
/// Most odometry does not lag: the standard deviation of what is expected, seconds.
const LAG_PRIOR_S: f64 = 0.15;
/// What is alike all over a log, which no scatter shows, seconds: what is seen best may stand at one end of the sweep. Simulated drives with known
/// lags are off by up to so much beyond their scatter.
const ALIKE_S: f64 = 0.02;
/// A lag of fewer standard deviations may be none.
const SIGMAS: f64 = 3.0;
/// Differences of successive pairs of scans have causes in common, such as what stands beside the way: so many count as one.
const ALIKE_PAIRS: f64 = 4.0;
/// Groups of successive turns of which each is left out once, to see how far the estimate scatters.
const GROUPS: usize = 10;
/// Degrees of freedom of Student's distribution, which errors of turns have: some are of scans that agree nowhere.
const FREEDOM: f64 = 3.0;
/// Turns between readings, and between scans, farther apart are not known, seconds.
const JOINED_S: f64 = 1.0;
/// A turn tells of a lag where the wheels say another one a lag before or after, radians: less is within what scans show.
const TELLING_RAD: f64 = 0.02;
/// So many such turns say something; the estimate is looked at from so many turns of any kind on, and anew with so many times as many.
const TURNS_LEAST: usize = 20;
const TURNS_FIRST: usize = 200;
const TURNS_MORE: f64 = 1.5;
/// The estimate is good enough, seconds.
const SIGMA_ENOUGH_S: f64 = 0.025;
/// What is kept at most: ten minutes of scans at ten a second and readings at a hundred; and pairs of scans, to see whether undoing the motion pays.
const TURNS_KEPT: usize = 6000;
const READINGS_KEPT: usize = 60_000;
const PAIRS_KEPT: usize = 300;
/// Stamps come in bursts where a tenth of the scans follow the one before within this share of what only a tenth take longer for: those of a
/// logger, which do not say when scans were taken.
const BURST: f64 = 0.25;

/// By how much odometry lags behind the laser.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lag {
    /// A reading with the stamp `t` says where the robot was at `t - lag_s`, seconds.
    pub lag_s: f64,
    /// Its standard deviation, seconds.
    pub sigma_s: f64,
}

impl Lag {
    /// Whether it is too large to be none.
    #[must_use]
    pub fn is_clear(self) -> bool {
        self.lag_s.abs() > SIGMAS * self.sigma_s
    }
}

/// Learns by how much odometry lags from scans and readings in the order of their stamps. The scans are those of the first laser.
///
/// Turns from scan to scan, told by what is seen alone, are compared with those of the wheels so much later, with errors of Student's distribution whose
/// scale is learnt as well. How surely that tells is seen from estimates without one tenth of the drive (jackknife), for what the wheels get wrong
/// differs from lag to lag; and most odometry does not lag, which is the prior.
#[derive(Debug, Clone, Default)]
pub struct LagEstimator {
    begin: Option<Stamp>,
    laser: Option<Arc<LaserModel>>,
    last: Option<Seen>,
    turns: Vec<Turn>,
    headings: Vec<Heading>,
    apart_s: Vec<f64>,
    /// Successive scans between which the robot turned, and how far apart they are as they were taken.
    pairs: Vec<([Seen; 2], f64)>,
    /// With so many turns the estimate is looked at anew.
    look_at: usize,
}

#[derive(Debug, Clone)]
struct Seen {
    scan: LaserScan,
    as_taken: Panorama,
    begin_s: f64,
    middle_s: f64,
}

/// A turn between the middles of two sweeps.
#[derive(Debug, Clone, Copy)]
struct Turn {
    from_s: f64,
    to_s: f64,
    rad: f64,
}

/// What the wheels say, with whole turns added.
#[derive(Debug, Clone, Copy)]
struct Heading {
    at_s: f64,
    rad: f64,
}

impl LagEstimator {
    /// A reading of the wheels.
    pub fn add_odometry(&mut self, odometry: &Odometry) {
        let begin = *self.begin.get_or_insert(odometry.stamp);
        let (at_s, theta) = (odometry.stamp.secs_since(begin), odometry.odom_from_robot.theta);
        let last = self.headings.last().copied();
        if last.is_some_and(|last| at_s <= last.at_s) || !theta.is_finite() || self.headings.len() == READINGS_KEPT {
            return;
        }
        let rad = last.map_or(theta, |last| last.rad + wrapped(theta - last.rad));
        self.headings.push(Heading { at_s, rad });
    }

    /// A scan.
    pub fn add_scan(&mut self, scan: &LaserScan) {
        let begin = *self.begin.get_or_insert(scan.stamp);
        let laser = self.laser.get_or_insert_with(|| Arc::clone(&scan.laser));
        if laser.name != scan.laser.name || self.turns.len() == TURNS_KEPT {
            return;
        }
        let Some(as_taken) = Panorama::of(scan, 0.0) else { return };
        let sweep_s = (scan.laser.beam_period_s * scan.ranges_m.len() as f64).max(0.0);
        let begin_s = scan.stamp.secs_since(begin);
        let middle_s = begin_s + 0.5 * sweep_s;
        let seen = Seen { scan: scan.clone(), as_taken, begin_s, middle_s };
        let Some(last) = self.last.replace(seen) else { return };
        let Some(now) = &self.last else { return };
        let apart_s = middle_s - last.middle_s;
        self.apart_s.push(apart_s);
        if apart_s <= 0.0 || apart_s > JOINED_S {
            return;
        }
        if let Some(agreement) = last.as_taken.agreement(&now.as_taken) {
            self.turns.push(Turn { from_s: last.middle_s, to_s: middle_s, rad: agreement.turn_rad });
            if sweep_s > 0.0 && agreement.turn_rad.abs() > TELLING_RAD && self.pairs.len() < PAIRS_KEPT {
                self.pairs.push(([last, now.clone()], agreement.apart));
            }
        }
    }

    /// The lag, where scans and readings say anything of it: the mean of the posterior.
    #[must_use]
    pub fn estimate(&self) -> Option<Lag> {
        if !self.stamps_tell() {
            return None;
        }
        let steps = (LAG_MOST_S / LAG_STEP_S).round() as i32;
        let lags_s: Vec<f64> = (-steps..=steps).map(|step| LAG_STEP_S * f64::from(step)).collect();
        let telling: Vec<_> = self.turns.iter().filter_map(|turn| self.errors(turn, &lags_s)).collect();
        if telling.len() < TURNS_LEAST {
            return None;
        }
        let all_s = likeliest(&lags_s, &telling, None);
        let left_out = (0..GROUPS).map(|group| likeliest(&lags_s, &telling, Some(group)) - all_s);
        let scatter = left_out.map(|off_s| off_s * off_s).sum::<f64>() * (GROUPS - 1) as f64 / GROUPS as f64;
        let variance = scatter + ALIKE_S * ALIKE_S;
        let believed = LAG_PRIOR_S * LAG_PRIOR_S / (LAG_PRIOR_S * LAG_PRIOR_S + variance);
        let lag = Lag { lag_s: believed * all_s, sigma_s: (believed * variance).sqrt() };
        (lag.lag_s.is_finite() && lag.sigma_s.is_finite()).then_some(lag)
    }

    /// Whether undoing the motion during the sweeps by the wheels, of which that is the lag, makes successive scans less alike than they are as
    /// they were taken, beyond chance.
    #[must_use]
    pub fn undoing_harms(&self, lag_s: f64) -> bool {
        let less_alike = |([before, after], as_taken): &([Seen; 2], f64)| {
            let [before, after] = [self.undone(before, lag_s)?, self.undone(after, lag_s)?];
            Some(before.agreement(&after)?.apart - as_taken)
        };
        let less_alike: Vec<f64> = self.pairs.iter().filter_map(less_alike).collect();
        let count = less_alike.len() as f64;
        let mean = less_alike.iter().sum::<f64>() / count;
        let variance = less_alike.iter().map(|one| (one - mean) * (one - mean)).sum::<f64>() / count;
        less_alike.len() >= TURNS_LEAST && mean > SIGMAS * (ALIKE_PAIRS * variance / count).sqrt()
    }

    /// Half of the time that the beams of a scan are said to take: turns are told between the middles of the sweeps.
    pub(crate) fn half_sweep_s(&self) -> f64 {
        self.last.as_ref().map_or(0.0, |seen| seen.middle_s - seen.begin_s)
    }

    fn undone(&self, seen: &Seen, lag_s: f64) -> Option<Panorama> {
        let (from_s, sweep_s) = (seen.begin_s + lag_s, 2.0 * (seen.middle_s - seen.begin_s));
        let turned_rad = self.heading(from_s + sweep_s)? - self.heading(from_s)?;
        Panorama::of(&seen.scan, turned_rad / sweep_s)
    }

    /// Whether more scans and readings would change little; asked for after each scan, it is looked at now and then.
    pub(crate) fn knows_enough(&mut self) -> bool {
        if self.turns.len() < self.look_at.max(TURNS_FIRST) {
            return false;
        }
        self.look_at = (TURNS_MORE * self.turns.len() as f64) as usize;
        self.turns.len() == TURNS_KEPT || self.estimate().is_some_and(|lag| lag.sigma_s < SIGMA_ENOUGH_S)
    }

    fn stamps_tell(&self) -> bool {
        let mut apart_s = self.apart_s.clone();
        apart_s.sort_unstable_by(f64::total_cmp);
        let tenth = |of_ten: usize| apart_s.get(of_ten * apart_s.len() / 10).copied().unwrap_or(0.0);
        tenth(1) > BURST * tenth(9)
    }

    /// What the wheels say less what scans show, for each lag; none where the wheels are not known around it, or say the same anyway.
    fn errors(&self, turn: &Turn, lags_s: &[f64]) -> Option<Vec<f64>> {
        let error =
            |lag_s: &f64| Some(self.heading(turn.to_s + lag_s)? - self.heading(turn.from_s + lag_s)? - turn.rad);
        let errors: Option<Vec<f64>> = lags_s.iter().map(error).collect();
        let errors = errors?;
        let least = errors.iter().copied().fold(f64::INFINITY, f64::min);
        let most = errors.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        (most - least > TELLING_RAD).then_some(errors)
    }

    fn heading(&self, at_s: f64) -> Option<f64> {
        let after = self.headings.partition_point(|heading| heading.at_s < at_s);
        let after_it = self.headings.get(after)?;
        if after_it.at_s == at_s {
            return Some(after_it.rad);
        }
        let before = self.headings.get(after.checked_sub(1)?)?;
        let apart_s = after_it.at_s - before.at_s;
        let share = (at_s - before.at_s) / apart_s;
        (apart_s <= JOINED_S).then_some(before.rad + share * (after_it.rad - before.rad))
    }
}

/// The mean of the lags, weighed by their likelihood; without one group of turns. The errors are those of each turn for each lag.
fn likeliest(lags_s: &[f64], telling: &[Vec<f64>], without: Option<usize>) -> f64 {
    let is_in = |turn: usize| without != Some(turn * GROUPS / telling.len());
    let surprise_at =
        |at: usize| surprise(telling.iter().enumerate().filter(|(turn, _)| is_in(*turn)).map(|(_, errors)| errors[at]));
    let costs: Vec<f64> = (0..lags_s.len()).map(surprise_at).collect();
    let least = costs.iter().copied().fold(f64::INFINITY, f64::min);
    let weights: Vec<f64> = costs.iter().map(|cost| (least - cost).exp()).collect();
    lags_s.iter().zip(&weights).map(|(lag_s, weight)| lag_s * weight).sum::<f64>() / weights.iter().sum::<f64>()
}

/// The negative logarithm of the likelihood of errors of Student's distribution, whose scale is that of their median, or a milliradian.
pub(crate) fn surprise(errors: impl Iterator<Item = f64>) -> f64 {
    let mut sizes: Vec<f64> = errors.map(f64::abs).collect();
    sizes.sort_unstable_by(f64::total_cmp);
    let scale = (1.31 * sizes[sizes.len() / 2]).max(1e-3);
    let of_one =
        |size: &f64| scale.ln() + 0.5 * (FREEDOM + 1.0) * (size / scale).powi(2).mul_add(1.0 / FREEDOM, 1.0).ln();
    sizes.iter().map(of_one).sum()
}

fn wrapped(angle_rad: f64) -> f64 {
    angle_rad.sin().atan2(angle_rad.cos())
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright_geom::Pose2;
    use std::f64::consts::TAU;

    const BEAMS: usize = 180;
    const SWEEP_S: f64 = 0.18;

    fn heading_at(at_s: f64) -> f64 {
        0.9 * (0.8 * at_s).sin() + 0.3 * (2.1 * at_s).sin()
    }

    /// From the middle of a room of 8 by 5 metres with a cupboard.
    fn range_m(bearing_rad: f64) -> f64 {
        let (sin, cos) = bearing_rad.sin_cos();
        let wall = |half_m: f64, along: f64| if along.abs() > 1e-9 { half_m / along.abs() } else { 1e9 };
        let cupboard = if (0.4..0.7).contains(&bearing_rad.rem_euclid(TAU)) { 1.5 } else { 1e9 };
        wall(4.0, cos).min(wall(2.5, sin)).min(cupboard)
    }

    /// Forty seconds at five scans a second; beams are said to be taken one after the other, and are or are not.
    fn drive(lag_s: f64, are_swept: bool) -> LagEstimator {
        let model = LaserModel {
            angle_min_rad: 0.0,
            angle_step_rad: TAU / BEAMS as f64,
            beam_period_s: SWEEP_S / BEAMS as f64,
            ..LaserModel::half_circle("round", BEAMS)
        };
        let laser = Arc::new(model);
        let mut estimator = LagEstimator::default();
        for k in 0..4000 {
            let at_s = 0.01 * f64::from(k);
            let stamp = Stamp::from_secs_f64(at_s);
            let odom_from_robot = Pose2::new(0.0, 0.0, heading_at(at_s - lag_s));
            estimator.add_odometry(&Odometry { stamp, odom_from_robot });
            if k % 20 == 0 {
                let beam_range_m = |beam: usize| {
                    let after_s = if are_swept { laser.beam_period_s * beam as f64 } else { 0.0 };
                    range_m(laser.bearing_in_robot(beam) + heading_at(at_s + after_s)) as f32
                };
                let ranges_m = (0..BEAMS).map(beam_range_m).collect();
                estimator.add_scan(&LaserScan { stamp, laser: Arc::clone(&laser), ranges_m, odom_from_robot: None });
            }
        }
        estimator
    }

    #[test]
    fn a_lag_is_found_from_what_is_seen_alone() {
        for lag_s in [0.3, 0.12, 0.0, -0.2] {
            let found = drive(lag_s, true).estimate().unwrap();
            assert!((found.lag_s - lag_s).abs() < 3.0 * found.sigma_s && found.sigma_s < 0.035, "{lag_s}: {found:?}");
            assert_eq!(found.is_clear(), lag_s != 0.0, "{lag_s}: {found:?}");
        }
    }

    #[test]
    fn undoing_is_left_out_where_beams_were_taken_at_once_all_the_same() {
        assert!(!drive(0.0, true).undoing_harms(0.0));
        assert!(!drive(0.3, true).undoing_harms(0.3));
        assert!(drive(0.0, false).undoing_harms(0.0));
    }

    #[test]
    fn who_does_not_turn_says_nothing_of_a_lag() {
        assert_eq!(LagEstimator::default().estimate(), None);
        let laser = Arc::new(LaserModel::half_circle("half", BEAMS));
        let mut estimator = LagEstimator::default();
        for k in 0..400 {
            let stamp = Stamp::from_secs_f64(0.1 * f64::from(k));
            estimator.add_odometry(&Odometry { stamp, odom_from_robot: Pose2::IDENTITY });
            let ranges_m = vec![2.0; BEAMS];
            estimator.add_scan(&LaserScan { stamp, laser: Arc::clone(&laser), ranges_m, odom_from_robot: None });
        }
        assert_eq!(estimator.estimate(), None);
        assert!(!estimator.undoing_harms(0.0));
    }
}
