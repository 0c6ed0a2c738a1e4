//! What a laser sees at even bearings: by how much it turned from one scan to the next, and how alike the two are then.

use mapwright_sensor::LaserScan;
use std::f64::consts::TAU;

/// Bearings lie at least so far apart, radians: finer ones cost time and say little more of a turn.
const STEP_LEAST_RAD: f64 = 0.008;
/// A robot turns by so much from scan to scan at most, radians.
const TURN_MOST_RAD: f64 = 1.0;
/// The logarithm of two ranges' ratio counts up to so much: farther apart, they are of different surfaces.
const APART_MOST: f32 = 0.2;
/// So many bearings have to be seen in both scans, and such a share of those with a hit in the one that has fewer.
const COMMON_LEAST: usize = 20;
const COMMON_SHARE: f64 = 0.5;

/// Logarithms of ranges at even bearings in the robot's frame, NaN where nothing was hit.
#[derive(Debug, Clone)]
pub(super) struct Panorama {
    logs: Vec<f32>,
    hits: usize,
    step_rad: f64,
    is_round: bool,
}

/// How two scans agree best.
#[derive(Debug, Clone, Copy)]
pub(super) struct Agreement {
    /// By so much the robot has turned, radians.
    pub(super) turn_rad: f64,
    /// The mean difference of the logarithms of ranges.
    pub(super) apart: f64,
}

impl Panorama {
    /// Of a scan during which the robot turned so fast, radians a second; none of a laser of too few beams.
    pub(super) fn of(scan: &LaserScan, turning_rad_per_s: f64) -> Option<Self> {
        let laser = &scan.laser;
        let (beams, apart_rad) = (scan.ranges_m.len(), laser.angle_step_rad.abs());
        laser.check(beams).ok()?;
        if apart_rad.is_nan() || apart_rad <= 0.0 || beams < COMMON_LEAST {
            return None;
        }
        let seen_rad = apart_rad * beams as f64;
        let is_round = seen_rad > TAU - 2.5 * apart_rad;
        let count = (seen_rad.min(TAU) / apart_rad.max(STEP_LEAST_RAD)).floor();
        let step_rad = if is_round { TAU / count } else { seen_rad / count };
        // the bearing of a beam grows evenly with its number, also while the robot turns
        let signed_rad = if laser.inverted { -laser.angle_step_rad } else { laser.angle_step_rad };
        let moved_rad = signed_rad + turning_rad_per_s * laser.beam_period_s;
        if moved_rad * signed_rad <= 0.0 {
            return None;
        }
        let first_rad = if signed_rad > 0.0 { 0.0 } else { seen_rad - apart_rad };
        let logs = (0..count as usize).map(|bin| {
            let at_rad = bin as f64 * step_rad;
            let beam = |at_rad: f64| {
                let beam = ((at_rad - first_rad) / moved_rad).round();
                (beam >= 0.0).then(|| scan.ranges_m.get(beam as usize).copied()).flatten()
            };
            let range_m =
                beam(at_rad).or_else(|| is_round.then(|| beam(at_rad - TAU).or(beam(at_rad + TAU))).flatten());
            let is_hit = |range_m: &f32| {
                let range_m = f64::from(*range_m);
                range_m > 0.0 && range_m >= laser.range_min_m && range_m < laser.range_max_m
            };
            range_m.filter(is_hit).map_or(f32::NAN, f32::ln)
        });
        let logs: Vec<f32> = logs.collect();
        let hits = logs.iter().filter(|log| !log.is_nan()).count();
        Some(Self { logs, hits, step_rad, is_round })
    }

    /// How this scan agrees with a later one.
    pub(super) fn agreement(&self, later: &Self) -> Option<Agreement> {
        if self.logs.len() != later.logs.len() {
            return None;
        }
        let most = (TURN_MOST_RAD / self.step_rad).floor().min(0.5 * self.logs.len() as f64) as i64;
        let apart: Vec<f64> = (-most..=most).map(|turned| self.apart(later, turned)).collect();
        let best = (0..apart.len()).min_by(|&a, &b| apart[a].total_cmp(&apart[b]))?;
        let [before, here, after] = [apart.get(best.checked_sub(1)?)?, &apart[best], apart.get(best + 1)?].map(|a| *a);
        let bend = before + after - 2.0 * here;
        if !bend.is_finite() || bend <= 0.0 {
            return None;
        }
        let between = 0.5 * (before - after) / bend;
        let turn_rad = (best as f64 - most as f64 + between) * self.step_rad;
        Some(Agreement { turn_rad, apart: here - 0.25 * (before - after) * between })
    }

    /// The mean difference if the robot has turned by so many bearings; infinite where too few are seen in both.
    fn apart(&self, later: &Self, turned: i64) -> f64 {
        let (then, now, count) = (&self.logs[..], &later.logs[..], self.logs.len() as i64);
        let ahead = (if self.is_round { turned.rem_euclid(count) } else { turned.clamp(-count, count) }) as isize;
        let [of_then, of_now] = if ahead < 0 { [0, ahead.unsigned_abs()] } else { [ahead.unsigned_abs(), 0] };
        let mut all = Differences::default();
        all.add(&then[of_then..], &now[of_now..]);
        if self.is_round {
            all.add(then, &now[now.len() - of_then..]);
        }
        let (sum, common) = all.total();
        let is_enough = common >= COMMON_LEAST && common as f64 >= COMMON_SHARE * self.hits.min(later.hits) as f64;
        if is_enough { sum / common as f64 } else { f64::INFINITY }
    }
}

const LANES: usize = 8;

/// Differences of logarithms, summed side by side.
#[derive(Default)]
struct Differences {
    sums: [f32; LANES],
    counts: [u32; LANES],
}

impl Differences {
    /// Those of what both have, as far as both reach.
    fn add(&mut self, then: &[f32], now: &[f32]) {
        let length = then.len().min(now.len());
        let ((then, then_rest), (now, now_rest)) =
            (then[..length].as_chunks::<LANES>(), now[..length].as_chunks::<LANES>());
        for (then, now) in then.iter().zip(now) {
            self.add_lanes(then, now);
        }
        for (lane, (then, now)) in then_rest.iter().zip(now_rest).enumerate() {
            let [mut thens, mut nows] = [[f32::NAN; LANES]; 2];
            (thens[lane], nows[lane]) = (*then, *now);
            self.add_lanes(&thens, &nows);
        }
    }

    fn add_lanes(&mut self, then: &[f32; LANES], now: &[f32; LANES]) {
        for lane in 0..LANES {
            let apart = (then[lane] - now[lane]).abs();
            let is_in_both = !apart.is_nan();
            self.sums[lane] += if is_in_both { apart.min(APART_MOST) } else { 0.0 };
            self.counts[lane] += u32::from(is_in_both);
        }
    }

    fn total(&self) -> (f64, usize) {
        let sum = self.sums.iter().map(|sum| f64::from(*sum)).sum();
        (sum, self.counts.iter().map(|count| *count as usize).sum())
    }
}
