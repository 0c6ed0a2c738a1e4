//! Where odometry says that a robot is.

use mapwright_geom::{Pose2, Stamp};

/// A velocity holds no longer than this, seconds: beyond it the log has a gap, and nobody knows.
const LONGEST_HOLD_S: f64 = 2.0;

/// A velocity that holds until the next one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Velocity {
    /// From when on.
    pub stamp: Stamp,
    /// Along the robot's x axis, metres per second.
    pub forward_m_per_s: f64,
    /// To the left positive, radians per second.
    pub turn_rad_per_s: f64,
}

impl Velocity {
    /// The motion after some seconds of this velocity: an arc.
    fn after(self, seconds: f64) -> Pose2 {
        Pose2::exp([self.forward_m_per_s * seconds, 0.0, self.turn_rad_per_s * seconds])
    }
}

/// Where a robot is by its odometry, and how far it drove and turned to get there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Place {
    /// The robot in the frame in which its odometry began.
    pub odom_from_robot: Pose2,
    /// Way since the beginning, metres.
    pub way_m: f64,
    /// Turning since the beginning, to either side, radians.
    pub turned_rad: f64,
}

/// Odometry of one robot as a function of time.
#[derive(Debug, Clone, Default)]
pub struct DeadReckoning {
    knots: Vec<(Velocity, Place)>,
    /// Readings left out: not finite.
    pub not_finite: usize,
    /// Readings that came later than one with a later stamp; they are sorted in.
    pub unsorted: usize,
}

impl DeadReckoning {
    /// Integrates velocities, each of which holds until the next; the robot stands in a gap of more than 2 s, and within
    /// one no place is known.
    #[must_use]
    pub fn from_velocities(velocities: &[Velocity]) -> Self {
        let is_finite = |v: &&Velocity| v.forward_m_per_s.is_finite() && v.turn_rad_per_s.is_finite();
        let mut finite: Vec<Velocity> = velocities.iter().filter(is_finite).copied().collect();
        let not_finite = velocities.len() - finite.len();
        let unsorted = count_unsorted(finite.iter().map(|v| v.stamp));
        finite.sort_by_key(|v| v.stamp);
        let mut place = Place { odom_from_robot: Pose2::IDENTITY, way_m: 0.0, turned_rad: 0.0 };
        let mut knots: Vec<(Velocity, Place)> = Vec::with_capacity(finite.len());
        for velocity in finite {
            if let Some((before, _)) = knots.last() {
                place = moved(place, *before, velocity.stamp.secs_since(before.stamp).min(LONGEST_HOLD_S));
            }
            knots.push((velocity, place));
        }
        Self { knots, not_finite, unsorted }
    }

    /// The place at a stamp; none before odometry begins, after it ends and in its gaps.
    #[must_use]
    pub fn at(&self, stamp: Stamp) -> Option<Place> {
        let after = self.knots.partition_point(|(velocity, _)| velocity.stamp <= stamp);
        let (velocity, place) = self.knots.get(after.checked_sub(1)?)?;
        let seconds = stamp.secs_since(velocity.stamp);
        (seconds <= LONGEST_HOLD_S).then(|| moved(*place, *velocity, seconds))
    }
}

fn moved(place: Place, velocity: Velocity, seconds: f64) -> Place {
    Place {
        odom_from_robot: place.odom_from_robot * velocity.after(seconds),
        way_m: place.way_m + (velocity.forward_m_per_s * seconds).abs(),
        turned_rad: place.turned_rad + (velocity.turn_rad_per_s * seconds).abs(),
    }
}

/// How many stamps are earlier than one before them.
fn count_unsorted(stamps: impl Iterator<Item = Stamp>) -> usize {
    let mut latest = Stamp(i64::MIN);
    let mut earlier = 0;
    for stamp in stamps {
        earlier += usize::from(stamp < latest);
        latest = latest.max(stamp);
    }
    earlier
}
