//! What the head of a scan says of its laser, and what is used where its numbers contradict each other.

use std::f64::consts::TAU;

/// Reach of a laser where nothing that can be used says it, metres: CARMEN's own assumption. The SICK lasers of its logs
/// write 81.83 or 81.91 where nothing returned, which is then beyond.
pub const RANGE_MAX_UNSAID_M: f64 = 80.0;
/// No sweep takes longer, seconds.
pub const SWEEP_MOST_S: f64 = 10.0;
/// A laser of the plane turns once; some repeat the first beams.
const TURNS_MOST: f64 = 1.5;
/// Bearings spread over more turns are degrees: as such they are a field of view of 25 degrees, less than any laser of the plane has.
const TURNS_OF_DEGREES: f64 = 4.0;
/// Nothing is spread over less: single precision of a bearing of half a turn, radians.
const NO_ANGLE_RAD: f64 = 1e-6;
/// The last beam's bearing is one step off where a driver counts steps instead of beams; beyond, heads contradict themselves.
/// Beam steps.
const LAST_BEAM_OFF: f64 = 1.5;
/// A sweep may take so many times the time from scan to scan that the head says, for drivers round and count steps for beams.
const SWEEP_OF_PERIOD: f64 = 1.5;

/// Something in a scan's head that cannot be as it stands.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OddHead {
    /// What it is about: one of few names, the same for all scans with the same fault.
    pub what: &'static str,
    /// What the head says, and what is used.
    pub words: String,
}

/// Bearings as a head says them, radians, and its names for them.
#[derive(Debug, Clone, Copy)]
pub struct SaidBearings {
    /// Of the first beam.
    pub first_rad: f64,
    /// Of the last beam.
    pub last_rad: f64,
    /// From one beam to the next.
    pub step_rad: f64,
    /// What the head calls the last beam's bearing or what says it, and the step.
    pub names: [&'static str; 2],
}

/// Bearings that are used, radians.
#[derive(Debug, Clone, PartialEq)]
pub struct Bearings {
    /// Of the first beam.
    pub first_rad: f64,
    /// From one beam to the next.
    pub step_rad: f64,
    /// What was wrong.
    pub odd: Option<OddHead>,
}

impl SaidBearings {
    /// The bearings of so many beams.
    ///
    /// First and last bearing count before the step where these contradict each other: they are what a user sets and sees, and
    /// of three numbers the step is the one that drivers compute. The step counts where the last bearing was left at zero, or
    /// would spread the beams over more than a turn. Bearings over more than four turns are degrees.
    #[must_use]
    pub fn settle(&self, beams: usize) -> Bearings {
        let steps = beams.saturating_sub(1) as f64;
        let turns = |span_rad: f64| span_rad.abs() / TAU;
        let is_over = |span_rad: f64| turns(span_rad) > TURNS_OF_DEGREES;
        if is_over(self.span_rad()) && is_over(self.step_rad * steps) && self.are_degrees() {
            return self.in_radians().settle_radians(steps, Some(self));
        }
        self.settle_radians(steps, None)
    }

    fn settle_radians(&self, steps: f64, degrees: Option<&Self>) -> Bearings {
        let (first_rad, by_step_rad) = (self.first_rad, self.step_rad * steps);
        let used = |step_rad: f64, odd: Option<OddHead>| Bearings { first_rad, step_rad, odd };
        let by_span_rad = self.span_rad() / steps.max(1.0);
        let off_most_rad = LAST_BEAM_OFF * self.step_rad.abs().max(by_span_rad.abs());
        let off_rad = by_step_rad - self.span_rad();
        let is_near = |off_rad: f64| off_rad.abs() <= off_most_rad;
        if let Some(said) = degrees {
            return used(self.step_rad, Some(said.degrees()));
        }
        // One beam has no step; a full turn may end where it began, and a bearing may be one turn off.
        if steps == 0.0 || is_near(off_rad) {
            return used(self.step_rad, None);
        }
        if is_near(by_step_rad.abs() - self.span_rad().abs()) {
            return used(-self.step_rad, Some(self.contradiction(steps, -self.step_rad)));
        }
        if is_near(off_rad.abs() - TAU) {
            return used(self.step_rad, None);
        }
        let can_be = |step_rad: f64| (NO_ANGLE_RAD..=TURNS_MOST * TAU).contains(&(step_rad * steps).abs());
        let is_unset = self.last_rad == 0.0 || !can_be(by_span_rad);
        let step_rad =
            if is_unset && can_be(self.step_rad) || !can_be(by_span_rad) { self.step_rad } else { by_span_rad };
        used(step_rad, Some(self.contradiction(steps, step_rad)))
    }

    fn span_rad(&self) -> f64 {
        self.last_rad - self.first_rad
    }

    fn are_degrees(&self) -> bool {
        [self.first_rad, self.last_rad, self.step_rad].iter().all(|angle| angle.abs() <= 360.0 * TURNS_MOST)
    }

    fn in_radians(&self) -> Self {
        let [first_rad, last_rad, step_rad] = [self.first_rad, self.last_rad, self.step_rad].map(f64::to_radians);
        Self { first_rad, last_rad, step_rad, ..*self }
    }

    fn degrees(&self) -> OddHead {
        let words = format!(
            "bearings from {} to {} rad by {}: taken as degrees",
            short(self.first_rad),
            short(self.last_rad),
            short(self.step_rad)
        );
        OddHead { what: "bearings", words }
    }

    fn contradiction(&self, steps: f64, used_rad: f64) -> OddHead {
        let [last, step] = self.names;
        let degrees = |angle_rad: f64| format!("{:+.1}", angle_rad.to_degrees());
        let words = format!(
            "{last} says {} deg for the last of {} beams, the first bearing and {step} say {} deg: used are {:.3} deg a beam, \
             from {} to {} deg",
            degrees(self.last_rad),
            steps + 1.0,
            degrees(self.first_rad + self.step_rad * steps),
            used_rad.to_degrees(),
            degrees(self.first_rad),
            degrees(self.first_rad + used_rad * steps)
        );
        OddHead { what: "bearings", words }
    }
}

/// Least and largest range that are used of those that a head says, metres.
#[must_use]
pub fn settle_ranges(min_m: f64, max_m: f64) -> ([f64; 2], Option<OddHead>) {
    let odd = |words: String| Some(OddHead { what: "range limits", words });
    let least_m = if min_m.is_finite() { min_m.max(0.0) } else { 0.0 };
    if !(max_m.is_finite() && max_m > 0.0) {
        let words = format!("range_max is {max_m}: not used, ranges count up to {RANGE_MAX_UNSAID_M} m");
        return ([if least_m < RANGE_MAX_UNSAID_M { least_m } else { 0.0 }, RANGE_MAX_UNSAID_M], odd(words));
    }
    if !min_m.is_finite() {
        return ([0.0, max_m], odd(format!("range_min is {min_m}: not used")));
    }
    if least_m >= max_m {
        let words =
            format!("range_min is {} m and range_max {} m: taken the other way round", short(min_m), short(max_m));
        return ([max_m, least_m], odd(words));
    }
    ([least_m, max_m], None)
}

/// Time from beam to beam, seconds, of those that a head says; 0 where it cannot be known.
#[must_use]
pub fn settle_times(beam_period_s: f64, scan_period_s: f64, beams: usize) -> (f64, Option<OddHead>) {
    let sweep_s = beam_period_s * beams as f64;
    let unknown = |why: String| {
        let words = format!(
            "time_increment is {} s, so that a sweep takes {} s, {why}: taken as unknown, all beams count as taken at once",
            short(beam_period_s),
            short(sweep_s)
        );
        (0.0, Some(OddHead { what: "times of beams", words }))
    };
    if sweep_s.is_nan() || sweep_s.abs() > SWEEP_MOST_S {
        return unknown("which no laser does (nanoseconds?)".to_owned());
    }
    if sweep_s < 0.0 {
        return unknown("less than none".to_owned());
    }
    if scan_period_s > 0.0 && scan_period_s.is_finite() && sweep_s > SWEEP_OF_PERIOD * scan_period_s {
        return unknown(format!("while scan_time says {} s", short(scan_period_s)));
    }
    (beam_period_s, None)
}

/// A number with six digits, as single precision has them.
fn short(number: f64) -> String {
    if !number.is_finite() || number == 0.0 {
        return number.to_string();
    }
    let digits = (5 - number.abs().log10().floor() as i32).clamp(0, 12);
    let text = format!("{number:.*}", digits as usize);
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn settled(first_deg: f64, last_deg: f64, step_deg: f64, beams: usize) -> ([f64; 2], Option<String>) {
        let [first_rad, last_rad, step_rad] = [first_deg, last_deg, step_deg].map(f64::to_radians);
        let said = SaidBearings { first_rad, last_rad, step_rad, names: ["angle_max", "angle_increment"] };
        let Bearings { first_rad, step_rad, odd } = said.settle(beams);
        let rounded = |angle_rad: f64| (1e6 * angle_rad.to_degrees()).round() / 1e6;
        ([rounded(first_rad), rounded(step_rad)], odd.map(|odd| odd.words))
    }

    #[test]
    fn heads_that_agree_and_those_one_step_off_are_taken_as_they_are() {
        for (first, last, step, beams) in [
            (-90.0, 89.0, 1.0, 180),
            (-90.0, 90.0, 1.0, 180),
            (90.0, -90.0, -0.5, 361),
            (-180.0, 180.0, 1.0, 360),
            (0.0, 0.0, 1.0, 360),
            (0.0, -0.5, 0.5, 720),
            (0.0, 0.0, 0.0, 1),
        ] {
            assert_eq!(settled(first, last, step, beams), ([first, step], None), "{first} {last} {step} {beams}");
        }
    }

    #[test]
    fn first_and_last_bearing_count_before_a_step_that_contradicts_them() {
        let (used, odd) = settled(-90.0, 88.0, -2.0, 90);
        assert_eq!(used, [-90.0, 2.0]);
        let odd = odd.unwrap();
        assert!(odd.contains("angle_max says +88.0 deg") && odd.contains("say -268.0 deg"), "{odd}");
        let (used, odd) = settled(-90.0, 88.0, 1.6, 90);
        assert!(used == [-90.0, 2.0] && odd.unwrap().contains("used are 2.000 deg a beam"));
        // every other beam left out
        assert_eq!(settled(-90.0, 90.0, 0.5, 181).0, [-90.0, 1.0]);
        // a full turn the wrong way
        assert_eq!(settled(-180.0, 179.0, -1.0, 360).0, [-180.0, 1.0]);
    }

    #[test]
    fn the_step_counts_where_the_last_bearing_was_left_out_or_cannot_be() {
        for (last, beams) in [(0.0, 181), (f64::NAN, 181), (5000.0, 181)] {
            let (used, odd) = settled(-90.0, last, 1.0, beams);
            assert!(used == [-90.0, 1.0] && odd.is_some(), "{last}: {used:?} {odd:?}");
        }
        assert_eq!(settled(-90.0, 90.0, 0.0, 181).0, [-90.0, 1.0]);
        // nothing says how far the beams are spread
        assert_eq!(settled(-90.0, -90.0 + 1e-6, 0.0, 181).0, [-90.0, 0.0]);
        assert_eq!(settled(-90.0, 90.0, f64::NAN, 181).0, [-90.0, 1.0]);
    }

    #[test]
    fn bearings_over_many_turns_are_degrees() {
        let said = SaidBearings { first_rad: -135.0, last_rad: 135.0, step_rad: 0.25, names: ["last", "step"] };
        let Bearings { first_rad, step_rad, odd } = said.settle(1081);
        assert!((first_rad.to_degrees() + 135.0).abs() < 1e-9 && (step_rad.to_degrees() - 0.25).abs() < 1e-9);
        assert!(odd.unwrap().words.contains("taken as degrees"));
    }

    #[test]
    fn limits_of_range_that_cannot_be_are_replaced_and_said() {
        for max_m in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            let (limits_m, odd) = settle_ranges(0.1, max_m);
            assert!(limits_m == [0.1, RANGE_MAX_UNSAID_M] && odd.unwrap().words.starts_with("range_max is "));
        }
        assert_eq!(settle_ranges(30.0, 0.1).0, [0.1, 30.0]);
        assert_eq!(settle_ranges(f64::NAN, 30.0).0, [0.0, 30.0]);
        assert_eq!(settle_ranges(-1.0, 30.0), ([0.0, 30.0], None));
    }

    #[test]
    fn sweeps_that_no_laser_makes_have_no_times() {
        assert_eq!(settle_times(5e-4, 0.1, 180), (5e-4, None));
        assert_eq!(settle_times(5e-4, 0.0, 180), (5e-4, None));
        for (beam_s, scan_s) in [(138_888.0, 1e8), (f64::NAN, 0.1), (-1e-4, 0.1), (5e-3, 0.1)] {
            let (used_s, odd) = settle_times(beam_s, scan_s, 180);
            assert!(used_s == 0.0 && odd.is_some(), "{beam_s} {scan_s}");
        }
    }

    #[test]
    fn numbers_are_as_long_as_single_precision_is_exact() {
        assert_eq!(
            [0.0, 138_888.89, 0.1_f32.into(), -2.5, 1e8, f64::NAN].map(short),
            ["0", "138889", "0.1", "-2.5", "100000000", "NaN"]
        );
    }
}
