//! What of a recording a session in space has already, and where it goes on.

use crate::session::EarlierInSpace;
use mapwright::{Cloud, Session, SpaceSweep, Stamp};
use nalgebra::Vector3;
use std::sync::Arc;
use std::vec;

/// So many points of a keyframe are looked for in a cloud.
const COMPARED: usize = 64;
/// They are means of points, undistorted: each lies as near as this to one, metres, and a share of its range,
const NEAR_M: f64 = 0.1;
const NEAR_SHARE: f64 = 0.1;
/// and so large a share of them does.
const ALIKE_SHARE: f64 = 0.9;

/// A cloud of a session: its stamp, and what was seen if it became a keyframe. Stamps alone do not tell recordings apart that each begin
/// at zero.
struct Known {
    stamp: Stamp,
    sweep: Option<Arc<SpaceSweep>>,
}

impl Known {
    fn all(session: &Session<SpaceSweep>) -> Vec<Self> {
        let mut all: Vec<Self> = session.scans().iter().map(|scan| Self { stamp: scan.stamp, sweep: None }).collect();
        for keyframe in session.keyframes() {
            if let Some(known) = session.scan_place(keyframe.scan).and_then(|place| all.get_mut(place)) {
                known.sweep = Some(Arc::clone(&keyframe.sweep));
            }
        }
        all
    }

    /// Whether this may be the cloud.
    fn is(&self, cloud: &Cloud) -> bool {
        self.stamp == cloud.stamp && self.sweep.as_ref().is_none_or(|sweep| shows(cloud, sweep))
    }
}

/// Whether a keyframe's points are a cloud's.
fn shows(cloud: &Cloud, sweep: &SpaceSweep) -> bool {
    let sensor = &cloud.sensor.robot_from_sensor;
    let seen: Vec<Vector3<f64>> =
        cloud.points_m.iter().map(|point| sensor.transform(Vector3::from(point.map(f64::from)))).collect();
    let every = sweep.points.len().div_ceil(COMPARED).max(1);
    let wanted: Vec<Vector3<f64>> =
        sweep.points_m().step_by(every).map(|point| Vector3::from(point.map(f64::from))).collect();
    let is_there = |point: &&Vector3<f64>| {
        let near_m = NEAR_M + NEAR_SHARE * point.norm();
        seen.iter().any(|seen| (seen - *point).norm_squared() <= near_m * near_m)
    };
    let there = wanted.iter().filter(is_there).count();
    there as f64 >= ALIKE_SHARE * wanted.len() as f64
}

/// A session that is gone on with, and what comes of a recording that it has.
pub(super) struct GoesOn {
    /// None where it begins anew with the recording that the session begins with, for no mapper took down what it knew on the way.
    pub(super) session: Option<Session<SpaceSweep>>,
    /// Whether the recording is one that the session is made of.
    pub(super) is_same: bool,
    known: vec::IntoIter<Known>,
    /// Of those that the session has of it, how many are to be mapped again.
    again: usize,
}

impl GoesOn {
    /// With this session, of which a recording begins with that cloud.
    pub(super) fn with(earlier: EarlierInSpace, first: Option<&Cloud>) -> Self {
        let EarlierInSpace { session, at_checkpoint, .. } = earlier;
        let nothing = || Vec::new().into_iter();
        if session.scans().is_empty() {
            return Self { session: None, is_same: true, known: nothing(), again: 0 };
        }
        let mut all = Known::all(&session);
        // A recording that was begun twice ends with the later beginning; a keyframe tells more than a stamp.
        let last = |is_keyframe: bool, first: &Cloud| {
            all.iter().rposition(|known| known.sweep.is_some() == is_keyframe && known.is(first))
        };
        let Some(begin) = first.and_then(|first| last(true, first).or_else(|| last(false, first))) else {
            return Self { session: Some(session), is_same: false, known: nothing(), again: 0 };
        };
        let count = all.len();
        let session = if session.checkpoint().is_some() {
            Some(session)
        } else {
            match at_checkpoint.filter(|at_checkpoint| at_checkpoint.scans().len() > begin) {
                Some(at_checkpoint) => Some(at_checkpoint),
                None if begin == 0 => None,
                None => Some(session),
            }
        };
        let has = session.as_ref().map_or(begin, |session| session.scans().len());
        all.truncate(has);
        Self { session, is_same: true, known: all.split_off(begin).into_iter(), again: count - has }
    }

    /// Whether the session does not have what comes next.
    pub(super) fn is_through(&self) -> bool {
        self.known.len() == 0
    }

    /// Whether the session does not have this cloud.
    ///
    /// # Errors
    /// The recording turns out another one: what was expected instead, in words.
    pub(super) fn is_new(&mut self, cloud: &Cloud) -> Result<bool, String> {
        match self.known.next() {
            None => {
                self.again = self.again.saturating_sub(1);
                Ok(true)
            }
            Some(known) if known.is(cloud) => Ok(false),
            Some(known) => Err(format!(
                "the recording begins as the one that the session ends with, and differs from it: expected the cloud at {:.3} s, \
                 found one at {:.3} s that shows something else",
                known.stamp.as_secs_f64(),
                cloud.stamp.as_secs_f64()
            )),
        }
    }

    /// How many clouds that the session had did not come.
    pub(super) fn missing(&self) -> usize {
        self.known.len() + self.again
    }
}
