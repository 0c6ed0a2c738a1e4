//! A run as pages show it.

use super::clock::Clock;
use super::drawn::Drawn;
use super::results::Results;
use super::{plane, space};
use crate::failure::Failure;
use crate::session::{AnySession, settings_of};
use mapwright::{Pose3, Settings, Stamp};
use std::path::Path;

/// What maps of space that can be turned take of a page, bytes before they are written as letters: with pictures and all else it stays below 3 MB.
pub(super) const TURNING_BYTES: usize = 1_000_000;

/// A run, and all that is told of it.
pub(super) struct Run {
    pub(super) name: String,
    pub(super) results: Results,
    pub(super) settings: Option<Settings>,
    pub(super) drawn: Drawn,
    pub(super) clock: Clock,
}

impl Run {
    /// Maps of the plane are turned until the direction that is given is level, or as the run has turned them.
    /// Of maps of space what can be turned takes so many bytes at most.
    pub(super) fn read(path: &Path, level_rad: Option<f64>, turning_bytes: usize) -> Result<Self, Failure> {
        let results = Results::read(path)?;
        let (settings, drawn) = match &results.session {
            AnySession::Plane(session) => {
                let settings = settings_of(session, path)?;
                (settings, plane::draw(session, &settings, &results.report, level_rad)?)
            }
            AnySession::Space(session) => {
                let settings = settings_of(session, path)?;
                (settings, space::draw(session, settings, &results.report, turning_bytes)?)
            }
        };
        let settings = Some(settings).filter(|_| !drawn.way.is_empty());
        let clock = Clock::of(&drawn.way.iter().map(|pose| pose.stamp).collect::<Vec<_>>());
        Ok(Self { name: results.name(), results, settings, drawn, clock })
    }

    /// Seconds of driving before a stamp.
    pub(super) fn seconds(&self, stamp: Stamp) -> f64 {
        self.clock.seconds(stamp)
    }

    /// The same of a place on the way.
    pub(super) fn seconds_at(&self, place: usize) -> f64 {
        self.drawn.way.get(place).map_or(f64::NAN, |pose| self.clock.at(place, pose.stamp))
    }

    /// Where the time axis ends.
    pub(super) fn length_s(&self) -> f64 {
        self.clock.length_s()
    }

    pub(super) fn trajectory(&self) -> Vec<(Stamp, Pose3)> {
        self.drawn.way.iter().map(|pose| (pose.stamp, pose.map_from_robot)).collect()
    }
}
