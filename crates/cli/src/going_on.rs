//! `mapwright map LOG -o OUT --continue`: the rest of a log that the session was made of, or another log.

use crate::failure::Failure;
use crate::mapping::Mapping;
use mapwright::{LaserScan, Session, Stamp, Sweep};
use mapwright_formats::LogEvent;
use std::sync::Arc;
use std::vec;

/// What of a log a session has already.
pub(crate) enum GoesOn {
    /// No scan was read yet; all that the session has.
    Begins(Vec<Known>),
    /// The log is the one that the session ends with; the scans that it has of it and that were not read yet.
    Same(vec::IntoIter<Known>),
    /// What comes is new.
    New,
}

/// A scan of a session: its stamp, and what was seen if it became a keyframe. Stamps alone do not tell logs apart that each begin at zero.
pub(crate) struct Known {
    stamp: Stamp,
    sweep: Option<Arc<Sweep>>,
}

impl Known {
    fn all(session: &Session) -> Vec<Self> {
        let mut all: Vec<Self> = session.scans().iter().map(|scan| Self { stamp: scan.stamp, sweep: None }).collect();
        for keyframe in session.keyframes() {
            if let Some(known) = session.scan_place(keyframe.scan).and_then(|place| all.get_mut(place)) {
                known.sweep = Some(Arc::clone(&keyframe.sweep));
            }
        }
        all
    }

    /// Whether this may be the scan: every return that the keyframe has kept is there.
    fn is(&self, scan: &LaserScan) -> bool {
        let shows = |sweep: &Arc<Sweep>| {
            let keeps = |(beam, &range_m): (usize, &f32)| {
                sweep.range_m(beam).is_none_or(|kept_m| (kept_m - f64::from(range_m)).abs() <= sweep.step_m)
            };
            sweep.codes.len() == scan.ranges_m.len() && scan.ranges_m.iter().enumerate().all(keeps)
        };
        self.stamp == scan.stamp && self.sweep.as_ref().is_none_or(shows)
    }
}

impl GoesOn {
    /// With this session.
    pub(crate) fn with(session: &Session) -> Self {
        Self::Begins(Known::all(session))
    }

    /// Whether the session does not have an event yet. Where another log begins the mapper hears of it.
    pub(crate) fn is_new(&mut self, event: &LogEvent<'_>, mapping: &mut Mapping) -> Result<bool, Failure> {
        if let Self::Begins(all) = self {
            let LogEvent::Scan(scan) = event else { return Ok(false) };
            // A log that was begun twice ends with the later beginning; a keyframe tells more than a stamp.
            let last = |is_keyframe: bool| {
                all.iter().rposition(|known| known.sweep.is_some() == is_keyframe && known.is(scan))
            };
            match last(true).or_else(|| last(false)) {
                Some(first) => *self = Self::Same(all.split_off(first).into_iter()),
                None => {
                    *self = Self::New;
                    mapping.switch_on()?;
                }
            }
        }
        if let (Self::Same(known), LogEvent::Scan(scan)) = (&mut *self, event) {
            match known.next() {
                Some(known) if known.is(scan) => {}
                Some(known) => return Err(differs(known.stamp, scan.stamp)),
                None => *self = Self::New,
            }
        }
        Ok(matches!(self, Self::New))
    }
}

fn differs(expected: Stamp, found: Stamp) -> Failure {
    let [expected, found] = [expected, found].map(|stamp| stamp.as_secs_f64());
    Failure::Log(format!(
        "the log begins as the one that the session ends with, and differs from it: expected the scan at {expected:.3} s, found one at \
         {found:.3} s that shows something else"
    ))
}
