//! The motion during a sweep as the scan's own match tells it, beside what the wheels say.
//!
//! The middle of a sweep hardly depends on the motion by which the sweep was undone. So the motion from the middle of the last sweep to the
//! middle of this one says how the robot moves as this one begins: half a sweep late, but with no more noise than matches have. The wheels
//! say it in time, with theirs. Both count by how wrong they have been.

use mapwright_geom::{Pose2, stored};

/// Weight of the newest error in the running means.
const WEIGHT: f64 = 0.05;

/// What the last sweeps have told.
#[derive(Debug, Clone, Default)]
pub(super) struct SweepTwist {
    /// The middle of the last sweep in the frame of its scan, where the scan is known to be.
    last_middle: Option<Pose2>,
    /// The twist per second up to there.
    last: Option<[f64; 3]>,
    /// How many errors there were, and their mean squares: of wheels and of matches, each of translation and of rotation.
    errors: u32,
    wheels: [f64; 2],
    matches: [f64; 2],
}

stored!(SweepTwist { last_middle, last, errors, wheels, matches });

/// A scan after a first match, by which its sweep's motion is told.
#[derive(Debug, Clone, Copy)]
pub(super) struct Glance {
    /// From the last scan to this one, as matched; and as the wheels say, if they do.
    pub(super) last_from_now: Pose2,
    pub(super) by_wheels: Option<Pose2>,
    /// The middle of the sweep in the frame of its scan, as it was undone by `twist` per second.
    pub(super) middle: Pose2,
    pub(super) twist: [f64; 3],
    /// Since the last scan, seconds.
    pub(super) elapsed_s: f64,
}

impl SweepTwist {
    /// Whether the last sweep can be told from.
    pub(super) fn is_known(&self) -> bool {
        self.last_middle.is_some()
    }

    /// The middle of the newest sweep, now that it is known where it was taken.
    pub(super) fn remember(&mut self, middle: Option<Pose2>) {
        self.last_middle = middle;
    }

    /// The next sweep has no last one.
    pub(super) fn forget(&mut self) {
        (self.last_middle, self.last) = (None, None);
    }

    /// The twist per second of a sweep; none after one that cannot be told from.
    pub(super) fn of(&mut self, seen: &Glance) -> Option<[f64; 3]> {
        let between_middles = self.last_middle?.inverse() * seen.last_from_now * seen.middle;
        let told = between_middles.log().map(|part| part / seen.elapsed_s);
        let before = self.last.replace(told);
        let Some(by_wheels) = seen.by_wheels else { return Some(told) };
        // The twist goes on to change as it did: over half a sweep, by half of what it did in a whole one.
        let late = before.map(|before| [0, 1, 2].map(|k| 0.5 * seen.elapsed_s * (told[k] - before[k])));
        if let Some(late) = late {
            self.errors = self.errors.saturating_add(1);
            let weight = WEIGHT.max(1.0 / f64::from(self.errors));
            let off = by_wheels.between(seen.last_from_now).log();
            for (means, [x, y, turn]) in [(&mut self.wheels, off), (&mut self.matches, late)] {
                means[0] += weight * (x * x + y * y - means[0]);
                means[1] += weight * (turn * turn - means[1]);
            }
        }
        let share = [0, 1].map(|kind| {
            let both = self.wheels[kind] + self.matches[kind];
            if both > 0.0 { self.wheels[kind] / both } else { 0.0 }
        });
        Some([0, 1, 2].map(|k| seen.twist[k] + share[k / 2] * (told[k] - seen.twist[k])))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may")]
mod tests {
    use super::*;

    /// A robot that speeds up evenly from scan to scan, told by wheels that are so far off each time.
    fn drive(off_m: f64, speeding_up: f64) -> [f64; 2] {
        let mut twist = SweepTwist::default();
        let (period_s, mut x_m, mut speed) = (0.2, 0.0, 0.5);
        let mut told = None;
        for scan in 0..40 {
            let last_m = x_m;
            speed += speeding_up * period_s * if scan % 8 < 4 { 1.0 } else { -1.0 };
            x_m += speed * period_s;
            let last_from_now = Pose2::new(x_m - last_m, 0.0, 0.0);
            let off_m = if scan % 2 == 0 { off_m } else { -off_m };
            let by_wheels = Some(Pose2::new(last_from_now.x + off_m, 0.0, 0.0));
            let wheels_speed = speed + off_m / period_s;
            let middle = Pose2::new(0.5 * period_s * speed, 0.0, 0.0);
            let seen =
                Glance { last_from_now, by_wheels, middle, twist: [wheels_speed, 0.0, 0.0], elapsed_s: period_s };
            told = twist.of(&seen).map(|twist| [twist[0], wheels_speed]);
            twist.remember(Some(middle));
        }
        told.map(|[told, wheels]| [(told - speed).abs(), (wheels - speed).abs()]).unwrap()
    }

    #[test]
    fn the_better_of_wheels_and_matches_counts() {
        let [told, wheels] = drive(0.03, 0.0);
        assert!(told < 0.01 && wheels > 0.1, "steady, with bad wheels: {told} m/s, {wheels} by the wheels");
        let [told, wheels] = drive(0.0, 1.0);
        assert!(told < 1e-9 && wheels < 1e-9, "good wheels, never steady: {told}");
        let [told, wheels] = drive(0.03, 1.0);
        assert!(told < wheels, "both: {told} m/s, {wheels} by the wheels");
    }

    #[test]
    fn without_wheels_matches_say_it_alone() {
        let mut twist = SweepTwist::default();
        let middle = Pose2::new(0.05, 0.0, 0.05);
        let seen = Glance {
            last_from_now: Pose2::exp([0.1, 0.0, 0.1]),
            by_wheels: None,
            middle,
            twist: [0.0; 3],
            elapsed_s: 0.2,
        };
        assert!(twist.of(&seen).is_none());
        twist.remember(Some(Pose2::exp([0.05, 0.0, 0.05])));
        let told = twist.of(&Glance { middle: Pose2::exp([0.05, 0.0, 0.05]), ..seen }).unwrap();
        assert!([0.5, 0.0, 0.5].iter().zip(told).all(|(a, b)| (a - b).abs() < 1e-9), "{told:?}");
        twist.forget();
        assert!(!twist.is_known() && twist.of(&seen).is_none());
    }
}
