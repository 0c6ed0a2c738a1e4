//! How fast the robot turns, as a gyroscope says it.

use mapwright_geom::{Stamp, Stored, stored};
use std::collections::VecDeque;

/// Readings that are kept: two seconds at a thousand a second.
const READINGS: usize = 2048;
/// No robot turns as fast, radians a second.
const FASTEST_RAD_PER_S: f64 = 100.0;
/// Readings farther apart are not joined, seconds.
const JOINED_S: f64 = 1.0;
/// Readings that cover less of a time than this say too little of it.
const COVERED_SHARE: f64 = 0.4;

/// A reading of a gyroscope.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TurnRate {
    /// When.
    pub stamp: Stamp,
    /// Counterclockwise about the robot's upward axis, radians a second.
    pub rad_per_s: f64,
}

/// The last readings, in the order of their stamps.
#[derive(Debug, Clone, Default)]
pub struct TurnRates(VecDeque<TurnRate>);

impl TurnRates {
    /// Keeps a reading; false where it cannot be used: not a number, beyond 100 rad/s, or up to a second older than the last
    /// one. Where stamps step farther back, a log has begun anew, and so do the readings; of two of the same time the second
    /// counts.
    pub fn add(&mut self, rate: TurnRate) -> bool {
        if rate.rad_per_s.is_nan() || rate.rad_per_s.abs() > FASTEST_RAD_PER_S {
            return false;
        }
        match self.0.back().map(|last| rate.stamp.secs_since(last.stamp)) {
            Some(since_s) if since_s < -JOINED_S => self.0.clear(),
            Some(since_s) if since_s < 0.0 => return false,
            Some(0.0) => drop(self.0.pop_back()),
            _ => {}
        }
        if self.0.len() == READINGS {
            self.0.pop_front();
        }
        self.0.push_back(rate);
        true
    }

    /// The mean from `start` to `end`, radians a second, by trapezia from the reading at or before the one to the reading at or
    /// after the other; none where they cover less than two fifths of the time, and where that is no time.
    #[must_use]
    pub fn mean(&self, start: Stamp, end: Stamp) -> Option<f64> {
        let first = self.0.partition_point(|rate| rate.stamp <= start).saturating_sub(1);
        let last = self.0.partition_point(|rate| rate.stamp < end).min(self.0.len().checked_sub(1)?);
        let (mut turned_rad, mut covered_s) = (0.0, 0.0);
        for pair in (first..last).map(|k| [self.0[k], self.0[k + 1]]) {
            let [from, until] = [pair[0].stamp.max(start), pair[1].stamp.min(end)];
            let (apart_s, within_s) = (pair[1].stamp.secs_since(pair[0].stamp), until.secs_since(from));
            if within_s <= 0.0 || apart_s > JOINED_S {
                continue;
            }
            let at = |stamp: Stamp| {
                let share = stamp.secs_since(pair[0].stamp) / apart_s;
                pair[0].rad_per_s + share * (pair[1].rad_per_s - pair[0].rad_per_s)
            };
            turned_rad += 0.5 * (at(from) + at(until)) * within_s;
            covered_s += within_s;
        }
        let says = covered_s > 0.0 && covered_s >= COVERED_SHARE * end.secs_since(start);
        says.then(|| turned_rad / covered_s)
    }
}

stored!(TurnRate { stamp, rad_per_s });

impl Stored for TurnRates {
    fn put(&self, out: &mut Vec<u8>) {
        self.0.put(out);
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        let rates: VecDeque<TurnRate> = Stored::take(from)?;
        let are_sound = rates.iter().all(|rate| rate.rad_per_s.abs() <= FASTEST_RAD_PER_S) && rates.len() <= READINGS;
        are_sound.then_some(Self(rates))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn turning_is_the_mean_over_the_sweep() {
        let at = Stamp::from_secs_f64;
        let mut rates = TurnRates::default();
        assert_eq!(rates.mean(at(0.0), at(0.1)), None);
        let read = |rates: &mut TurnRates, s: f64, rad_per_s: f64| rates.add(TurnRate { stamp: at(s), rad_per_s });
        for k in 0..4000 {
            assert!(read(&mut rates, f64::from(k) * 0.01, f64::from(k) * 0.02));
        }
        assert_eq!(rates.0.len(), READINGS);
        let mean = |rates: &TurnRates, from: f64, until: f64| rates.mean(at(from), at(until));
        assert!((mean(&rates, 38.003, 38.093).unwrap_or(0.0) - 2.0 * 38.048).abs() < 1e-6);
        // up to the last reading, where that is most of it
        assert!((mean(&rates, 39.94, 40.04).unwrap_or(0.0) - 2.0 * 39.965).abs() < 1e-6);
        assert_eq!((mean(&rates, 39.98, 40.08), mean(&rates, 3.0, 3.1), mean(&rates, 60.0, 60.1)), (None, None, None));
        // no rates, and stamps that step back
        assert!(!read(&mut rates, 41.0, f64::NAN) && !read(&mut rates, 41.0, f64::INFINITY));
        assert!(read(&mut rates, 5.0, 1.0) && read(&mut rates, 5.1, 1.0) && rates.0.len() == 2);
        assert!((mean(&rates, 5.0, 5.1).unwrap_or(0.0) - 1.0).abs() < 1e-9);
        assert!(!read(&mut rates, 4.5, 9.0), "out of order");
        assert!(read(&mut rates, 5.1, 2.0) && rates.0.len() == 2, "twice the same time");
        assert!((mean(&rates, 5.0, 5.1).unwrap_or(0.0) - 1.5).abs() < 1e-9);
        // no time, and time that runs backwards
        assert_eq!((mean(&rates, 5.05, 5.05), mean(&rates, 5.1, 5.0)), (None, None));
    }
}
