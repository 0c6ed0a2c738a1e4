//! Times on a page: seconds of driving. What lies between two drives, of different days say, is left out.

use mapwright::Stamp;

/// A time without a scan is a pause when it is so many times as long as usual.
const PAUSE: f64 = 10.0;
/// Between two drives the axis has a gap of this share of all driving.
const GAP_SHARE: f64 = 0.01;

/// From stamps to seconds since the begin of the first drive.
#[derive(Debug)]
pub(super) struct Clock {
    drives: Vec<Drive>,
    /// Pauses within drives, seconds of driving.
    pauses: Vec<[f64; 2]>,
}

/// Scans without so long a time between them that all driving would be short beside it, and without steps back.
#[derive(Debug)]
struct Drive {
    scans: usize,
    first: Stamp,
    last: Stamp,
    from_s: f64,
}

impl Drive {
    fn seconds(&self, stamp: Stamp) -> f64 {
        self.from_s + stamp.secs_since(self.first)
    }

    fn end_s(&self) -> f64 {
        self.seconds(self.last)
    }
}

impl Clock {
    /// Of the scans in arrival order.
    pub(super) fn of(stamps: &[Stamp]) -> Self {
        let steps: Vec<f64> = stamps.windows(2).map(|pair| pair[1].secs_since(pair[0])).collect();
        let mut onward: Vec<f64> = steps.iter().copied().filter(|step| *step > 0.0).collect();
        onward.sort_unstable_by(f64::total_cmp);
        let pause_s = PAUSE * onward.get(onward.len() / 2).copied().unwrap_or(0.0);
        let driven_s: f64 = onward.iter().filter(|step| **step <= pause_s).sum();
        let ends = |step: f64| step > driven_s.max(pause_s) || step < -pause_s;
        let gap_s = GAP_SHARE * driven_s;
        let mut clock = Self { drives: Vec::new(), pauses: Vec::new() };
        for (at, &stamp) in stamps.iter().enumerate() {
            let step = at.checked_sub(1).map(|before| steps[before]);
            match clock.drives.last_mut().filter(|_| step.is_none_or(|step| !ends(step))) {
                Some(drive) => {
                    drive.scans += 1;
                    (drive.first, drive.last) = (drive.first.min(stamp), drive.last.max(stamp));
                }
                None => {
                    let from_s = clock.drives.last().map_or(0.0, |before| before.end_s() + gap_s);
                    clock.drives.push(Drive { scans: 1, first: stamp, last: stamp, from_s });
                }
            }
        }
        let is_pause = |at: &usize| steps[*at] > pause_s && !ends(steps[*at]);
        let pauses =
            (0..steps.len()).filter(is_pause).map(|at| [clock.at(at, stamps[at]), clock.at(at + 1, stamps[at + 1])]);
        clock.pauses = pauses.collect();
        clock
    }

    /// When the scan of a number in arrival order was taken.
    pub(super) fn at(&self, scan: usize, stamp: Stamp) -> f64 {
        let mut passed = 0;
        let drive = self.drives.iter().find(|drive| {
            passed += drive.scans;
            scan < passed
        });
        drive.map_or(0.0, |drive| drive.seconds(stamp))
    }

    /// When a stamp was, in the first of the drives that it lies in, or else in the nearest.
    pub(super) fn seconds(&self, stamp: Stamp) -> f64 {
        let away_s = |drive: &Drive| drive.first.secs_since(stamp).max(stamp.secs_since(drive.last)).max(0.0);
        let nearest = self.drives.iter().min_by(|a, b| away_s(a).total_cmp(&away_s(b)));
        nearest.map_or(0.0, |drive| drive.seconds(stamp))
    }

    /// Where the time axis ends.
    pub(super) fn length_s(&self) -> f64 {
        self.drives.last().map_or(0.0, Drive::end_s)
    }

    pub(super) fn driven_s(&self) -> f64 {
        self.drives.iter().map(|drive| drive.last.secs_since(drive.first)).sum()
    }

    pub(super) fn drives(&self) -> usize {
        self.drives.len()
    }

    /// What lies between drives.
    pub(super) fn cuts(&self) -> Vec<[f64; 2]> {
        self.drives.windows(2).map(|pair| [pair[0].end_s(), pair[1].from_s]).collect()
    }

    /// Times without a scan that are far longer than usual, those between drives among them.
    pub(super) fn pauses(&self) -> Vec<[f64; 2]> {
        self.pauses.iter().copied().chain(self.cuts()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn drive(from_s: f64, seconds: u32) -> Vec<Stamp> {
        (0..=10 * seconds).map(|k| Stamp::from_secs_f64(from_s + 0.1 * f64::from(k))).collect()
    }

    #[test]
    fn years_between_two_drives_take_no_room() {
        let stamps = [drive(1e6, 100), drive(9.77e8, 60), drive(50.0, 40)].concat();
        let clock = Clock::of(&stamps);
        assert_eq!((clock.drives(), clock.cuts().len()), (3, 2));
        assert!((clock.driven_s() - 200.0).abs() < 1e-3 && clock.length_s() < 1.05 * 200.0, "{clock:?}");
        let times: Vec<f64> = stamps.iter().enumerate().map(|(at, &stamp)| clock.at(at, stamp)).collect();
        assert!(times.windows(2).all(|pair| pair[0] < pair[1]));
        stamps.iter().zip(times).for_each(|(&stamp, at_s)| assert!((clock.seconds(stamp) - at_s).abs() < 1e-6));
    }

    #[test]
    fn a_pause_within_a_drive_is_shown_as_long_as_it_was() {
        let mut stamps = [drive(0.0, 100), drive(130.0, 100)].concat();
        stamps.swap(40, 41);
        let clock = Clock::of(&stamps);
        assert_eq!((clock.drives(), clock.pauses().len()), (1, 1));
        assert!((clock.length_s() - 230.0).abs() < 1e-6);
        assert_eq!(Clock::of(&[]).length_s(), 0.0);
        assert_eq!(Clock::of(&[Stamp(7), Stamp(7)]).drives(), 1);
    }
}
