//! Readings that are a laser's codes for "nothing returned", told by the readings themselves.

/// Readings are counted to this many metres; no laser of the plane reaches farther.
const COUNTED_M: f32 = 200.0;
/// Codes lie within so many millimetres of each other: SICK's 8 m mode has 8183, 8187 and 8191.
const BAND_MM: usize = 20;
/// Surfaces are seen at all ranges: a code is met so many times as often as any range within the half metre in front of it.
const NEARER_MM: usize = 500;
const TIMES_NEARER: u64 = 8;
/// A code makes at least so much of all readings,
const LEAST_SHARE: f64 = 0.002;
/// is met in so many of 64 sectors of the sweep (a wall seen by a robot that stands still fills few),
const LEAST_SECTORS: u32 = 8;
/// and readings beyond it are fewer than one in so many of it.
const BEYOND_ONE_IN: u64 = 20;
/// Asked again after so many sweeps.
const ASKED_EVERY: u32 = 50;

/// Counts a laser's readings to the millimetre, and finds those at their far end that many beams share: no surface lies at the
/// same range in all directions, so these say that nothing returned.
#[derive(Debug, Clone, Default)]
pub struct NoReturnCodes {
    /// By millimetres: how many, and in which sectors of the sweep.
    counts: Vec<(u32, u64)>,
    readings: u64,
    sweeps: u32,
    found: Option<FoundCodes>,
}

/// Codes that were found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FoundCodes {
    /// The least of them, metres: readings from here on are no returns.
    pub from_m: f64,
    /// Their share of all readings.
    pub share: f64,
}

impl NoReturnCodes {
    /// Takes in one sweep's readings, metres. They are judged now and then: ask [`Self::found`].
    pub fn observe(&mut self, ranges_m: impl ExactSizeIterator<Item = f32>) {
        let beams = ranges_m.len().max(1);
        for (beam, range_m) in ranges_m.enumerate() {
            if range_m > 0.05 && range_m < COUNTED_M {
                let mm = (range_m * 1000.0 + 0.5) as usize;
                if self.counts.len() <= mm {
                    self.counts.resize(mm + 1, (0, 0));
                }
                let (count, sectors) = &mut self.counts[mm];
                *count = count.saturating_add(1);
                *sectors |= 1 << (beam * 64 / beams);
                self.readings += 1;
            }
        }
        self.sweeps = self.sweeps.wrapping_add(1);
        if self.sweeps.is_multiple_of(ASKED_EVERY) {
            self.judge();
        }
    }

    /// Judges what was seen so far.
    pub fn judge(&mut self) {
        self.found = self.find();
    }

    /// The codes, where there are any, as of the last time that they were judged.
    #[must_use]
    pub fn found(&self) -> Option<FoundCodes> {
        self.found
    }

    fn find(&self) -> Option<FoundCodes> {
        let least = ((self.readings as f64 * LEAST_SHARE) as u64).max(1);
        let mut beyond = 0;
        for mm in (0..self.counts.len()).rev() {
            beyond += self.counts.get(mm + BAND_MM).map_or(0, |&(count, _)| u64::from(count));
            if beyond * BEYOND_ONE_IN > self.readings {
                return None;
            }
            if self.is_code(mm, least) && beyond * BEYOND_ONE_IN <= u64::from(self.counts[mm].0) {
                // Others of the same laser are rarer.
                let band = mm.saturating_sub(BAND_MM)..=mm;
                let from = band.into_iter().find(|&other| self.is_code(other, least / 4 + 1))?;
                let all: u64 = self.counts[from..].iter().map(|&(count, _)| u64::from(count)).sum();
                return Some(FoundCodes {
                    from_m: (from as f64 - 0.5) * 1e-3,
                    share: all as f64 / self.readings as f64,
                });
            }
        }
        None
    }

    fn is_code(&self, mm: usize, least: u64) -> bool {
        let (count, sectors) = self.counts[mm];
        if u64::from(count) < least || sectors.count_ones() < LEAST_SECTORS {
            return false;
        }
        let nearer = &self.counts[mm.saturating_sub(NEARER_MM)..mm.saturating_sub(BAND_MM)];
        let most = nearer.iter().map(|&(count, _)| u64::from(count)).max().unwrap_or(0);
        u64::from(count) >= TIMES_NEARER * most.max(1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sweeps in rooms of all sizes up to `most_m`; beams that would see farther read `code_m`.
    fn codes(sweeps: usize, most_m: f32, code_m: impl Fn(usize) -> f32, steps_per_m: f32) -> Option<FoundCodes> {
        let mut codes = NoReturnCodes::default();
        for sweep in 0..sweeps {
            let ranges: Vec<_> = (0..180)
                .map(|beam| {
                    let range_m =
                        0.5 + 7.0 * ((sweep as f32 * 0.37 + beam as f32 * 0.11).sin()).abs() + 0.003 * beam as f32;
                    if range_m < most_m { (range_m * steps_per_m).round() / steps_per_m } else { code_m(beam + sweep) }
                })
                .collect();
            codes.observe(ranges.iter().copied());
        }
        codes.judge();
        codes.found()
    }

    #[test]
    fn what_many_beams_share_at_the_far_end_is_a_code() {
        let found = codes(100, 6.5, |_| 8.183, 1000.0).unwrap();
        assert!((found.from_m - 8.1825).abs() < 1e-9 && found.share > 0.05, "{found:?}");
        let three = codes(100, 6.5, |k| [8.183, 8.183, 8.183, 8.183, 8.187, 8.191][k % 6], 1000.0).unwrap();
        assert!((three.from_m - 8.1825).abs() < 1e-9, "{three:?}");
        let cut = codes(100, 3.5, |_| 3.5, 100.0).unwrap();
        assert!((cut.from_m - 3.4995).abs() < 1e-9, "{cut:?}");
    }

    #[test]
    fn walls_are_no_code() {
        assert_eq!(codes(100, 100.0, |_| 0.0, 1000.0), None);
        assert_eq!(codes(100, 100.0, |_| 0.0, 100.0), None, "readings in centimetres");
        assert_eq!(codes(100, 3.5, |_| f32::INFINITY, 1000.0), None);
        assert_eq!(codes(0, 3.5, |_| 3.5, 1000.0), None);
        // A robot that stands still before a wall reads the same for as long.
        let mut still = NoReturnCodes::default();
        let wall: Vec<_> = (0..181).map(|beam| 4.0 / (0.4 * (beam as f32 - 90.0) / 90.0).cos()).collect();
        (0..200).for_each(|_| still.observe(wall.iter().copied()));
        assert_eq!(still.found(), None);
        still.observe([].into_iter());
        still.observe([f32::NAN, -1.0, 1e30].into_iter());
    }
}
