//! How fast a robot drives and turns, learnt from its odometry; and which steps of odometry no robot can have made.

use mapwright_geom::{Pose2, stored};

/// A step is believed up to so many times the fastest speed seen so far: a robot may drive faster than it did.
const FASTER: f64 = 2.0;
/// The fastest until so much was seen, metres and radians a second: robots that map buildings drive up to 3 m/s and turn half around
/// in one.
const FASTEST_AT_FIRST: [f64; 2] = [1.5, 1.6];
/// The fastest at least, however slowly it has driven so far: it may just have crept.
const FASTEST_AT_LEAST: [f64; 2] = [0.5, 1.0];
/// Speeds are means over so long at least, and a step is given as much time, seconds: stamps are those of a logger, which may be late
/// (in the log of the Intel lab they step back by up to 0.47 s).
const WINDOW_S: f64 = 1.0;
/// So many such means are known before they count alone.
const WINDOWS_AT_LEAST: u32 = 10;
/// A step like one too fast before it shows that the robot does drive so fast: nearer to it than this share of it.
const ALIKE: f64 = 0.5;
/// No speed that is gone on with is larger, metres or radians a second.
const LARGEST: f64 = 1e6;

/// What one source of odometry has shown so far. Feed it every step in order.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Pace {
    /// Metres and radians a second.
    fastest: [f64; 2],
    windows: u32,
    /// Seconds, metres and radians of the mean that is being made.
    open: [f64; 3],
    /// The step before, where that was too fast.
    fast: Option<Pose2>,
}

stored!(Pace { fastest, windows, open, fast });

impl Pace {
    /// Whether a robot can have made this step in so many seconds. Time that stands still or runs backwards is none.
    #[must_use]
    pub fn believes(&self, elapsed_s: f64, step: Pose2) -> bool {
        self.is_possible(elapsed_s, step) || self.fast.is_some_and(|before| is_alike(before, step))
    }

    fn is_possible(&self, elapsed_s: f64, step: Pose2) -> bool {
        let known = self.windows >= WINDOWS_AT_LEAST;
        let least = if known { FASTEST_AT_LEAST } else { FASTEST_AT_FIRST };
        let within_s = elapsed_s.max(WINDOW_S);
        let moved = [step.x.hypot(step.y), step.theta.abs()];
        // a NaN fails the comparison
        (0..2).all(|axis| moved[axis] <= FASTER * self.fastest[axis].max(least[axis]) * within_s)
    }

    /// Takes a step in; false where no robot can have made it: odometry began anew, or is broken.
    pub fn add(&mut self, elapsed_s: f64, step: Pose2) -> bool {
        let is_believed = self.believes(elapsed_s, step);
        self.fast = Some(step).filter(|step| step.is_finite() && !self.is_possible(elapsed_s, *step));
        if is_believed {
            self.learn([elapsed_s.max(0.0), step.x.hypot(step.y), step.theta.abs()]);
        }
        is_believed
    }

    fn learn(&mut self, step: [f64; 3]) {
        for (sum, part) in self.open.iter_mut().zip(step) {
            *sum += part;
        }
        let [seconds, metres, radians] = self.open;
        if seconds >= WINDOW_S {
            self.fastest = [self.fastest[0].max(metres / seconds), self.fastest[1].max(radians / seconds)];
            self.windows = self.windows.saturating_add(1);
            self.open = [0.0; 3];
        }
    }

    /// Whether these are numbers that a pace may have.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        self.fastest.iter().chain(&self.open).all(|number| (0.0..=LARGEST).contains(number))
            && self.fast.is_none_or(Pose2::is_finite)
    }
}

fn is_alike(before: Pose2, step: Pose2) -> bool {
    let size = |step: Pose2| step.x.hypot(step.y) + step.theta.abs();
    size(before.between(step)) <= ALIKE * size(before).min(size(step))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright_geom::Stored;

    /// Drives so fast at 10 readings a second, for so many seconds.
    fn driven(pace: &mut Pace, m_per_s: f64, rad_per_s: f64, seconds: u32) -> bool {
        let step = Pose2::new(0.1 * m_per_s, 0.0, 0.1 * rad_per_s);
        (0..10 * seconds).fold(true, |all, _| pace.add(0.1, step) && all)
    }

    #[test]
    fn a_step_is_judged_by_what_the_robot_has_driven() {
        let mut pace = Pace::default();
        assert!(pace.believes(0.4, Pose2::new(2.5, 0.0, 0.0)), "nothing is known yet");
        assert!(driven(&mut pace, 0.6, 0.2, 20));
        assert!(!pace.believes(0.4, Pose2::new(2.5, 0.0, 0.0)) && !pace.believes(0.4, Pose2::new(0.0, 0.0, 2.5)));
        assert!(pace.believes(0.4, Pose2::new(1.0, 0.0, 0.0)), "a logger may be late");
        assert!(pace.believes(60.0, Pose2::new(40.0, 0.0, 3.0)), "it may have driven on during a pause");
        assert!(!pace.believes(-5.0, Pose2::new(2.5, 0.0, 0.0)), "time that runs backwards is none");
        assert!(!pace.believes(60.0, Pose2::new(f64::NAN, 0.0, 0.0)));
    }

    #[test]
    fn after_a_jump_odometry_goes_on() {
        let mut pace = Pace::default();
        driven(&mut pace, 0.6, 0.0, 20);
        assert!(!pace.add(0.4, Pose2::new(-6.0, 2.0, 0.4)));
        assert!(driven(&mut pace, 0.6, 0.0, 20));
        // of two sources in one topic every step is refused
        assert!((0..20).all(|k| !pace.add(0.1, Pose2::new(if k % 2 == 0 { 6.0 } else { -6.0 }, 0.0, 0.0))));
    }

    #[test]
    fn a_robot_that_is_faster_than_any_is_believed_from_its_second_step_on() {
        let mut pace = Pace::default();
        assert!(!pace.add(0.2, Pose2::new(8.0, 0.0, 0.0)) && pace.add(0.2, Pose2::new(8.1, 0.0, 0.01)));
        assert!((0..100).all(|_| pace.add(0.2, Pose2::new(8.0, 0.0, 0.0))));
        assert!(pace.is_sound());
    }

    #[test]
    fn it_goes_on_from_its_bytes() {
        let mut pace = Pace::default();
        driven(&mut pace, 0.6, 0.1, 20);
        pace.add(0.4, Pose2::new(-6.0, 2.0, 0.4));
        let mut bytes = Vec::new();
        pace.put(&mut bytes);
        assert_eq!(Pace::take(&mut &bytes[..]), Some(pace));
    }
}
