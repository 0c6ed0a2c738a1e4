//! Whether a scan's ranges are metres, and say anything.

use mapwright_formats::RangeReport;
use mapwright_sensor::{FoundCodes, LaserModel, LaserScan, NoReturnCodes, RANGE_MAX_UNSAID_M};
use std::collections::VecDeque;
use std::sync::Arc;

/// No laser of the plane has half of its returns beyond, and no robot has half of them within a seventh of this many
/// millimetres, or within this many centimetres: what lies beyond is not in metres.
const METRES_MOST: f32 = 150.0;
/// No laser of the plane reaches farther, metres; a larger limit of range is one in another unit.
const REACH_MOST_M: f64 = 1000.0;

/// Lasers of a log that are known by their scans before.
const LASERS_KNOWN: usize = 8;

/// Looks at the ranges of each scan of a log.
#[derive(Debug, Clone)]
pub(crate) struct RangeCheck {
    /// What one stands for, metres.
    unit_m: f64,
    scans: u64,
    /// The lasers of the scans before as the log has them, and as they are used.
    known: VecDeque<[Arc<LaserModel>; 2]>,
    /// By the lasers' names.
    codes: Vec<(String, NoReturnCodes)>,
    report: RangeReport,
}

impl RangeCheck {
    pub(crate) fn new(unit_m: Option<f64>) -> Self {
        let (known, codes, report) = (VecDeque::new(), Vec::new(), RangeReport::default());
        Self { unit_m: unit_m.unwrap_or(1.0), scans: 0, known, codes, report }
    }

    /// Looks at a scan some time before it is [taken](Self::take): codes for no return are known by then.
    pub(crate) fn look_ahead(&mut self, scan: &LaserScan) {
        let unit_m = self.unit_m as f32;
        let name = &scan.laser.name;
        let known = self.codes.iter().position(|(of, _)| of == name);
        if known.is_none() && self.codes.len() < LASERS_KNOWN {
            self.codes.push((name.clone(), NoReturnCodes::default()));
        }
        let at = known.unwrap_or(self.codes.len() - 1);
        let (_, codes) = &mut self.codes[at];
        let before = codes.found();
        codes.observe(scan.ranges_m.iter().map(|&range| range * unit_m));
        if is_other(before, codes.found()) {
            self.known.clear();
        }
    }

    /// No scan is to come that was not looked at.
    pub(crate) fn end(&mut self) {
        for (_, codes) in &mut self.codes {
            let before = codes.found();
            codes.judge();
            if is_other(before, codes.found()) {
                self.known.clear();
            }
        }
    }

    pub(crate) fn into_report(self) -> RangeReport {
        self.report
    }

    /// Brings a scan to metres; false where it is to be left out, for its ranges are none.
    pub(crate) fn take(&mut self, scan: &mut LaserScan) -> bool {
        self.scans += 1;
        self.laser(scan);
        if self.unit_m != 1.0 {
            let unit_m = self.unit_m as f32;
            scan.ranges_m.iter_mut().for_each(|range_m| *range_m *= unit_m);
        }
        let least_m = scan.laser.range_min_m as f32;
        // counters as wide as ranges, so that several beams are compared at once
        let (mut usable, mut beyond) = (0_u32, 0_u32);
        for &range_m in &scan.ranges_m {
            usable += u32::from(range_m > least_m);
            beyond += u32::from((range_m > METRES_MOST) & (range_m < f32::INFINITY));
        }
        if usable == 0 {
            self.report.blank.note(self.scans);
        }
        beyond == 0 || self.are_metres(&scan.ranges_m)
    }

    /// A range that many beams share says that nothing returned; the others are counted.
    fn are_metres(&mut self, ranges: &[f32]) -> bool {
        let finite = || ranges.iter().copied().filter(|range| range.is_finite());
        let largest = finite().fold(0.0, f32::max);
        let within = finite().filter(|range| *range > 0.0 && *range <= METRES_MOST).count();
        let beyond = finite().filter(|range| *range > METRES_MOST && *range < largest).count();
        if beyond <= within {
            return true;
        }
        self.report.beyond_reach.note(self.scans);
        self.report.largest = self.report.largest.max(largest);
        false
    }

    /// The scan's laser as it is used.
    fn laser(&mut self, scan: &mut LaserScan) {
        match self.known.iter().find(|[said, _]| Arc::ptr_eq(said, &scan.laser)) {
            Some([said, used]) => {
                if !Arc::ptr_eq(said, used) {
                    scan.laser = Arc::clone(used);
                }
            }
            None => {
                let said = Arc::clone(&scan.laser);
                if let Some(used) = self.used(&said) {
                    scan.laser = Arc::new(used);
                }
                if let Some(used) = self.below_codes(&scan.laser) {
                    scan.laser = Arc::new(used);
                }
                self.known.truncate(LASERS_KNOWN - 1);
                self.known.push_front([said, Arc::clone(&scan.laser)]);
            }
        }
    }

    /// Another laser, where readings below its largest range say that nothing returned.
    fn below_codes(&mut self, laser: &LaserModel) -> Option<LaserModel> {
        let (_, codes) = self.codes.iter().find(|(of, _)| *of == laser.name)?;
        let FoundCodes { from_m, share } = codes.found().filter(|found| found.from_m < laser.range_max_m)?;
        self.report.codes = Some(format!(
            "readings from {from_m:.3} m on, {:.1} % of all, are the same to the millimetre on many beams: no surface, this \
             laser's code for no return, used as such",
            100.0 * share
        ));
        Some(LaserModel { range_max_m: from_m, ..laser.clone() })
    }

    /// Another laser, where this one's limits of range are not in metres. With them a unit holds for both limits.
    fn used(&mut self, said: &LaserModel) -> Option<LaserModel> {
        if said.range_max_m <= REACH_MOST_M {
            return None;
        }
        let [least_m, most_m] = [said.range_min_m, said.range_max_m].map(|limit| limit * self.unit_m);
        let (range_min_m, range_max_m) = if most_m <= REACH_MOST_M {
            (least_m, most_m)
        } else {
            self.report.limits.get_or_insert_with(|| {
                format!(
                    "the largest range is {most_m:.0} m, farther than any laser of the plane: not used, ranges count up to \
                     {RANGE_MAX_UNSAID_M} m"
                )
            });
            (if least_m < 1.0 { least_m } else { 0.0 }, RANGE_MAX_UNSAID_M)
        };
        Some(LaserModel { range_min_m, range_max_m, ..said.clone() })
    }
}

/// Whether what is known of a laser's codes is another than before, so that the laser that is used is made anew.
fn is_other(before: Option<FoundCodes>, now: Option<FoundCodes>) -> bool {
    before.map(|found| found.from_m) != now.map(|found| found.from_m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright_geom::Stamp;

    fn scan(ranges: &[f32], range_max_m: f64) -> LaserScan {
        let laser =
            LaserModel { range_max_m, range_min_m: 0.001 * range_max_m, ..LaserModel::half_circle("", ranges.len()) };
        LaserScan { stamp: Stamp(0), laser: Arc::new(laser), ranges_m: ranges.to_vec(), odom_from_robot: None }
    }

    #[test]
    fn metres_pass_untouched_whatever_stands_for_no_return() {
        let mut check = RangeCheck::new(None);
        for no_return in [0.0, -1.0, 81.91, 655.35, 1e9, f32::INFINITY, f32::NAN] {
            let mut ranges = vec![no_return; 300];
            ranges[..40].iter_mut().enumerate().for_each(|(k, range)| *range = 2.0 + k as f32);
            let mut taken = scan(&ranges, 80.0);
            let said = Arc::clone(&taken.laser);
            assert!(check.take(&mut taken) && Arc::ptr_eq(&said, &taken.laser), "{no_return}");
            assert!(taken.ranges_m.iter().zip(&ranges).all(|(a, b)| a.to_bits() == b.to_bits()));
        }
        assert_eq!(check.into_report(), RangeReport::default());
    }

    #[test]
    fn millimetres_are_left_out_unless_the_unit_is_said() {
        let ranges: Vec<f32> = (0..90).map(|k| if k < 9 { 81_000.0 } else { 300.0 + 200.0 * k as f32 }).collect();
        for range_max in [81.0, 81_000.0] {
            let mut check = RangeCheck::new(None);
            assert!(!check.take(&mut scan(&ranges, range_max)));
            let report = check.into_report();
            assert_eq!((report.beyond_reach.count, report.largest), (1, 81_000.0));
            let (mut check, mut taken) = (RangeCheck::new(Some(0.001)), scan(&ranges, range_max));
            assert!(check.take(&mut taken));
            assert!((taken.ranges_m[10] - 2.3).abs() < 1e-6 && taken.laser.range_max_m == 81.0);
            assert_eq!(check.into_report(), RangeReport::default());
        }
    }

    #[test]
    fn a_largest_range_in_another_unit_is_not_used() {
        let (mut check, mut taken) = (RangeCheck::new(None), scan(&[1.0, 2.0, 3.0], 81_910.0));
        assert!(
            check.take(&mut taken) && taken.laser.range_max_m == RANGE_MAX_UNSAID_M && taken.laser.range_min_m == 0.0
        );
        assert!(check.into_report().limits.unwrap().contains("81910 m"));
    }

    #[test]
    fn codes_for_no_return_are_known_before_the_first_scan_is_taken() {
        let mut check = RangeCheck::new(None);
        let ranges =
            |k: usize| -> Vec<f32> {
                (0..180)
                    .map(|beam| {
                        if (beam + k).is_multiple_of(10) { 8.183 } else { 1.0 + 0.03 * beam as f32 + 0.011 * k as f32 }
                    })
                    .collect()
            };
        let scans: Vec<_> = (0..20).map(|k| scan(&ranges(k), 80.0)).collect();
        scans.iter().for_each(|scan| check.look_ahead(scan));
        check.end();
        let mut first = scans[0].clone();
        assert!(check.take(&mut first) && (first.laser.range_max_m - 8.1825).abs() < 1e-9);
        assert!(check.into_report().codes.unwrap().contains("8.183 m"));
        // Where the head says that they are beyond, nothing is to be said.
        let mut known = RangeCheck::new(None);
        let mut scans: Vec<_> = (0..20).map(|k| scan(&ranges(k), 8.0)).collect();
        scans.iter().for_each(|scan| known.look_ahead(scan));
        known.end();
        assert!(known.take(&mut scans[0]) && scans[0].laser.range_max_m == 8.0);
        assert_eq!(known.into_report(), RangeReport::default());
    }

    #[test]
    fn scans_without_a_range_are_counted() {
        let mut check = RangeCheck::new(None);
        for ranges in [[0.0; 3], [f32::NAN; 3], [-1.0, 0.0, 0.01], [f32::INFINITY; 3]] {
            assert!(check.take(&mut scan(&ranges, 80.0)));
        }
        assert_eq!(check.into_report().blank.first_places, [1, 2, 3]);
    }
}
