//! `mapwright map LOG -o OUT --continue`: the rest of a log that the session was made of, or another log.

use crate::failure::Failure;
use crate::mapping::Mapping;
use mapwright::{Session, Stamp};
use mapwright_formats::LogEvent;
use std::vec;

/// What of a log a session has already.
pub(crate) enum GoesOn {
    /// No scan was read yet; the stamps of all that the session has.
    Begins(Vec<Stamp>),
    /// The log is the one that the session ends with; the stamps of the scans that it has of it and that were not read yet.
    Same(vec::IntoIter<Stamp>),
    /// What comes is new.
    New,
}

impl GoesOn {
    /// With this session.
    pub(crate) fn with(session: Option<&Session>) -> Self {
        Self::Begins(session.into_iter().flat_map(|session| session.scans().iter().map(|scan| scan.stamp)).collect())
    }

    /// Whether the session does not have an event yet. Where another log begins the mapper hears of it.
    pub(crate) fn is_new(&mut self, event: &LogEvent<'_>, mapping: &mut Mapping) -> Result<bool, Failure> {
        if let Self::Begins(stamps) = self {
            let LogEvent::Scan(scan) = event else { return Ok(false) };
            // A log that was begun twice ends with the later beginning.
            match stamps.iter().rposition(|stamp| *stamp == scan.stamp) {
                Some(first) => *self = Self::Same(stamps.split_off(first).into_iter()),
                None => {
                    *self = Self::New;
                    mapping.switch_on()?;
                }
            }
        }
        if let (Self::Same(stamps), LogEvent::Scan(scan)) = (&mut *self, event) {
            match stamps.next() {
                Some(stamp) if stamp == scan.stamp => {}
                Some(stamp) => return Err(differs(stamp, scan.stamp)),
                None => *self = Self::New,
            }
        }
        Ok(matches!(self, Self::New))
    }
}

fn differs(expected: Stamp, found: Stamp) -> Failure {
    let [expected, found] = [expected, found].map(|stamp| stamp.as_secs_f64());
    Failure::Log(format!(
        "the log begins as the one that the session ends with, and differs from it: expected a scan at {expected:.3} s, found one at \
         {found:.3} s"
    ))
}
