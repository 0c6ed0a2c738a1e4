//! What is new of a session since it was last read: on the mapper's thread, so by cursors, and nothing of it is looked at twice.

use crate::news::{Closure, News, Placed, Robot, Seen, View};
use mapwright_geom::{Stamp, TangentMatrix};
use mapwright_record::{Entry, Localisation, Session, Status, Update};

/// Candidates of which something else is thought, as many as are kept by their numbers; beyond that all are told again.
const MOST_CHANGED: usize = 4096;

/// How far a session was read.
#[derive(Debug, Default)]
pub(crate) struct Feed {
    /// Of each keyframe that was made while this listened, from the first: standard deviation in metres, status.
    made: Vec<(usize, f32, Status)>,
    keyframes: usize,
    corrections: u32,
    left_out: usize,
    fragments: usize,
    candidates: usize,
    changed: Vec<u32>,
    begin: Option<Stamp>,
}

impl Feed {
    /// Hears what an update says that a session does not keep.
    pub(crate) fn hear<M: View>(&mut self, update: &Update<M>, session: &Session<M>) {
        self.begin.get_or_insert(update.stamp);
        if update.keyframe.is_some() {
            let place = session.keyframes().len().saturating_sub(1);
            let sigma_m = update.covariance.position_variance_m2().sqrt() as f32;
            self.made.push((place, sigma_m, update.status));
        }
        self.hear_entries(&update.entries);
    }

    pub(crate) fn hear_entries<M: View>(&mut self, entries: &[Entry<M>]) {
        for entry in entries {
            if let Entry::Verdict { number, .. } = entry
                && (*number as usize) < self.candidates
            {
                self.changed.push(*number);
            }
        }
        if self.changed.len() > MOST_CHANGED {
            self.changed.clear();
            self.candidates = 0;
        }
    }

    /// What is new, and where the robot is.
    pub(crate) fn news<M: View>(&mut self, update: &Update<M>, session: &Session<M>) -> News {
        let (position_m2, heading_sigma_rad) = M::position(update.map_from_robot, &update.covariance);
        let robot = Robot {
            map_from_robot: M::in_space(update.map_from_robot),
            position_m2,
            heading_sigma_rad,
            status: update.status,
            is_joined: update.localisation == Localisation::Joined,
        };
        News { robot: Some(robot), at_s: Some(self.since_begin_s(update.stamp)), ..self.of_session(session) }
    }

    pub(crate) fn since_begin_s(&mut self, stamp: Stamp) -> f64 {
        stamp.secs_since(*self.begin.get_or_insert(stamp))
    }

    /// What is new in a session, which is that of the last call, grown.
    pub(crate) fn of_session<M: View>(&mut self, session: &Session<M>) -> News {
        let poses = session.map_from_keyframe();
        let moved = if session.corrections() == self.corrections { 0 } else { self.keyframes.min(poses.len()) };
        self.corrections = session.corrections();
        if self.begin.is_none() {
            self.begin = session.keyframes().first().map(|keyframe| keyframe.stamp);
        }
        News {
            is_space: M::IS_SPACE,
            at_s: None,
            moved: (0_u32..).zip(&poses[..moved]).map(|(number, &pose)| (number, M::in_space(pose))).collect(),
            redrawn: self.redrawn(session),
            keyframes: self.new_keyframes(session),
            closures: self.closures(session),
            robot: None,
            scan: None,
        }
    }

    fn redrawn<M: View>(&mut self, session: &Session<M>) -> Vec<(u32, Seen)> {
        let fresh = session.left_out().get(self.left_out..).unwrap_or_default();
        self.left_out = session.left_out().len();
        let known = self.keyframes;
        let places =
            fresh.iter().filter_map(|left_out| session.place(left_out.keyframe)).filter(|place| *place < known);
        places.map(|place| (place as u32, seen(session, place))).collect()
    }

    fn new_keyframes<M: View>(&mut self, session: &Session<M>) -> Vec<Placed> {
        let fresh = session.fragments().get(self.fragments..).unwrap_or_default();
        let mut breaks: Vec<usize> = fresh.iter().filter_map(|fragment| session.place(fragment.first)).collect();
        breaks.sort_unstable();
        self.fragments = session.fragments().len();
        let poses = session.map_from_keyframe();
        let new = self.keyframes.min(poses.len())..poses.len();
        let placed = new.map(|place| {
            let made = self.made.binary_search_by_key(&place, |made| made.0).ok().map(|at| self.made[at]);
            Placed {
                seen: seen(session, place),
                map_from_robot: M::in_space(poses[place]),
                sigma_m: made.map(|(_, sigma_m, _)| f64::from(sigma_m)),
                status: made.map_or(Status::Tracking, |(_, _, status)| status),
                is_break: breaks.binary_search(&place).is_ok(),
            }
        });
        let placed = placed.collect();
        self.keyframes = poses.len();
        self.made.clear();
        placed
    }

    fn closures<M: View>(&mut self, session: &Session<M>) -> Vec<(u32, Closure)> {
        let all = session.candidates();
        let new = self.candidates.min(all.len()) as u32..all.len() as u32;
        self.candidates = all.len();
        let numbers = std::mem::take(&mut self.changed).into_iter().chain(new);
        let of = |number: u32| {
            Some((number, Closure::of::<M>(all.get(number as usize)?, |id| session.place(id)).unwrap_or(NOWHERE)))
        };
        numbers.filter_map(of).collect()
    }
}

/// A candidate whose keyframes the session does not know: numbers stay those of the session.
const NOWHERE: Closure = Closure {
    from: u32::MAX,
    to: u32::MAX,
    verdict: mapwright_record::Verdict::Refused(mapwright_record::Objection::NoMatch),
};

fn seen<M: View>(session: &Session<M>, place: usize) -> Seen {
    session.drawn().get(place).and_then(Option::as_ref).map_or(Seen::Nothing, M::seen)
}
