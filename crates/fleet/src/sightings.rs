//! What robots saw of each other, as bytes, and the joins that follow where both saw the other within a second.

use crate::bytes::Cursor;
use mapwright::{KeyframeId, Pose2, Sighted, Stamp};
use mapwright_geom::{Cov3, compose_covariance};
use mapwright_rendezvous::{DeadReckoning, Kind, Settings, Sighting, Velocity, meet};
use std::collections::BTreeMap;

/// A velocity is taken to hold so long before and after a sighting, seconds. Sightings that are farther apart are solved apart.
const HOLDS_S: f64 = 2.0;
/// Bytes of one sighting.
const BYTES: usize = 90;

/// A robot sees another one of its team.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SightedRobot {
    /// When, by the clock of the observer, which is that of its scans.
    pub stamp: Stamp,
    /// A keyframe of the observer, as recent as there is.
    pub keyframe: KeyframeId,
    /// The observer in the frame of that keyframe, when it saw the other.
    pub keyframe_from_robot: Pose2,
    /// How it moved: metres a second ahead, and radians a second to the left.
    pub velocity: [f64; 2],
    /// Whom it saw, by the place in the roster.
    pub observed: u16,
    /// How far, metres, and where to the left of ahead, radians.
    pub range_m: f64,
    /// The direction.
    pub bearing_rad: f64,
    /// Standard deviations of both: metres, radians.
    pub sigmas: [f64; 2],
}

impl SightedRobot {
    pub(crate) fn put(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.stamp.0.to_le_bytes());
        out.extend_from_slice(&self.keyframe.session.to_le_bytes());
        out.extend_from_slice(&self.keyframe.seq.to_le_bytes());
        out.extend_from_slice(&self.observed.to_le_bytes());
        let Pose2 { x, y, theta } = self.keyframe_from_robot;
        let numbers = [x, y, theta, self.velocity[0], self.velocity[1], self.range_m, self.bearing_rad];
        numbers.iter().chain(&self.sigmas).for_each(|number| out.extend_from_slice(&number.to_le_bytes()));
    }

    fn take(cursor: &mut Cursor<'_>, robot: u128) -> Option<Self> {
        let stamp = Stamp(i64::from_le_bytes(cursor.array()?));
        let (session, seq) = (cursor.u32()?, cursor.u32()?);
        let observed = cursor.u16()?;
        let mut number = || cursor.f64().filter(|number| number.is_finite());
        let keyframe_from_robot = Pose2 { x: number()?, y: number()?, theta: number()? };
        let velocity = [number()?, number()?];
        let (range_m, bearing_rad) = (number()?, number()?);
        let sigmas = [number()?, number()?];
        let keyframe = KeyframeId { robot, session, seq };
        Some(Self { stamp, keyframe, keyframe_from_robot, velocity, observed, range_m, bearing_rad, sigmas })
    }

    /// Those of a payload; the robot can speak for itself alone. None where they are none.
    pub(crate) fn all(payload: &[u8], robot: u128) -> Option<Vec<Self>> {
        let mut cursor = Cursor(payload);
        let mut all = Vec::with_capacity(payload.len() / BYTES);
        while !cursor.is_empty() {
            all.push(Self::take(&mut cursor, robot)?);
        }
        Some(all)
    }

    fn as_seen_by(&self, observer: u16) -> Sighting {
        Sighting {
            observer: observer.into(),
            observed: Some(self.observed.into()),
            stamp: self.stamp,
            range_m: Some(self.range_m),
            bearing_rad: Some(self.bearing_rad),
            range_sigma_m: self.sigmas[0],
            bearing_sigma_rad: self.sigmas[1],
        }
    }

    fn velocity_from(&self, stamp: Stamp) -> Velocity {
        Velocity { stamp, forward_m_per_s: self.velocity[0], turn_rad_per_s: self.velocity[1] }
    }

    /// The robot in the frame of its keyframe a little before or after.
    fn keyframe_from_robot_at(&self, stamp: Stamp) -> Pose2 {
        let seconds = stamp.secs_since(self.stamp);
        self.keyframe_from_robot * Pose2::exp([self.velocity[0] * seconds, 0.0, self.velocity[1] * seconds])
    }
}

/// The joins of all pairs of robots that saw each other within a second; of each meeting one, the most certain. Robots by their places in the roster.
pub(crate) fn joins(by_robot: &BTreeMap<u16, Vec<SightedRobot>>) -> Vec<Sighted> {
    let mut joins = Vec::new();
    for (&a, of_a) in by_robot {
        for (&b, of_b) in by_robot.range(a.saturating_add(1)..) {
            let seen_by = |observer: u16, all: &[SightedRobot], observed: u16| -> Vec<(u16, SightedRobot)> {
                all.iter().filter(|seen| seen.observed == observed).map(|seen| (observer, *seen)).collect()
            };
            let mut all = seen_by(a, of_a, b);
            all.extend(seen_by(b, of_b, a));
            all.sort_by_key(|(observer, seen)| (seen.stamp, *observer));
            let near = |x: &(u16, SightedRobot), y: &(u16, SightedRobot)| y.1.stamp.secs_since(x.1.stamp) <= HOLDS_S;
            joins.extend(all.chunk_by(near).filter_map(|meeting| join([a, b], meeting)));
        }
    }
    joins
}

/// The join of one meeting.
fn join(pair: [u16; 2], meeting: &[(u16, SightedRobot)]) -> Option<Sighted> {
    let of = |robot: u16| meeting.iter().filter(move |(observer, _)| *observer == robot).map(|(_, seen)| *seen);
    let wheels = pair.map(|robot| {
        let own: Vec<SightedRobot> = of(robot).collect();
        let before = own.first().map(|first| first.velocity_from(Stamp(first.stamp.0 - (HOLDS_S * 1e9) as i64)));
        let velocities = own.iter().map(|seen| seen.velocity_from(seen.stamp));
        DeadReckoning::from_velocities(&before.into_iter().chain(velocities).collect::<Vec<_>>())
    });
    let sightings: Vec<Sighting> = meeting.iter().map(|(observer, seen)| seen.as_seen_by(*observer)).collect();
    let [a, b] = pair;
    let met = meet([a.into(), b.into()], &sightings, [&wheels[0], &wheels[1]], &Settings::default());
    let mutual = met.encounters.iter().filter(|encounter| encounter.kind == Kind::Mutual);
    let certainty = |covariance: &Cov3| covariance.determinant();
    let encounter = mutual.min_by(|x, y| certainty(&x.covariance).total_cmp(&certainty(&y.covariance)))?;
    let nearest = |robot: u16| of(robot).min_by_key(|seen| seen.stamp.0.abs_diff(encounter.stamp.0));
    let (seen_a, seen_b) = (nearest(a)?, nearest(b)?);
    let a_from_robot = seen_a.keyframe_from_robot_at(encounter.stamp);
    let robot_from_b = seen_b.keyframe_from_robot_at(encounter.stamp).inverse();
    Some(Sighted {
        a: seen_a.keyframe,
        b: seen_b.keyframe,
        a_from_b: a_from_robot * encounter.a_from_b * robot_from_b,
        covariance: compose_covariance(&encounter.covariance, robot_from_b, &Cov3::zeros()),
    })
}
