//! A run as pages show it.

use super::drawn::Drawn;
use super::results::Results;
use super::{plane, space};
use crate::failure::Failure;
use crate::session::{AnySession, settings_of};
use mapwright::{Pose3, Settings, Stamp};
use std::path::Path;

/// A time without a scan is a pause when it is so many times as long as usual.
const PAUSE: f64 = 10.0;

/// A run, and all that is told of it.
pub(super) struct Run {
    pub(super) name: String,
    pub(super) results: Results,
    pub(super) settings: Option<Settings>,
    pub(super) drawn: Drawn,
}

impl Run {
    pub(super) fn read(path: &Path) -> Result<Self, Failure> {
        let results = Results::read(path)?;
        let (settings, drawn) = match &results.session {
            AnySession::Plane(session) => {
                let settings = settings_of(session, path)?;
                (settings, plane::draw(session, &settings, &results.report)?)
            }
            AnySession::Space(session) => {
                let settings = settings_of(session, path)?;
                (settings, space::draw(session, settings, &results.report)?)
            }
        };
        let settings = Some(settings).filter(|_| !drawn.way.is_empty());
        Ok(Self { name: results.name(), results, settings, drawn })
    }

    /// The stamp that times on the page are counted from.
    pub(super) fn begin(&self) -> Stamp {
        self.drawn.way.iter().map(|pose| pose.stamp).min().unwrap_or(Stamp(0))
    }

    /// Seconds since the begin.
    pub(super) fn seconds(&self, stamp: Stamp) -> f64 {
        stamp.secs_since(self.begin())
    }

    /// From the first stamp to the last, seconds.
    pub(super) fn length_s(&self) -> f64 {
        self.drawn.way.iter().map(|pose| pose.stamp).max().map_or(0.0, |last| self.seconds(last))
    }

    /// Times without a scan that are far longer than usual, seconds.
    pub(super) fn pauses(&self) -> Vec<[f64; 2]> {
        let times: Vec<f64> = self.drawn.way.iter().map(|pose| self.seconds(pose.stamp)).collect();
        let between = || times.windows(2).map(|pair| [pair[0], pair[1]]).filter(|[from, to]| to > from);
        let mut lengths: Vec<f64> = between().map(|[from, to]| to - from).collect();
        lengths.sort_unstable_by(f64::total_cmp);
        let usual_s = lengths.get(lengths.len() / 2).copied().unwrap_or(0.0);
        between().filter(|[from, to]| to - from > PAUSE * usual_s).collect()
    }

    pub(super) fn trajectory(&self) -> Vec<(Stamp, Pose3)> {
        self.drawn.way.iter().map(|pose| (pose.stamp, pose.map_from_robot)).collect()
    }
}
