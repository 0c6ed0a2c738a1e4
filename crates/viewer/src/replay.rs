//! A finished run over time.

use crate::feed::Feed;
use crate::model::Model;
use crate::news::{News, Robot, View};
use crate::scene::Scene;
use mapwright_record::{Entry, EntryError, Session, Status};
use nalgebra::Matrix3;

/// Moments lie so far apart, seconds, or nearly.
const STEP_S: f64 = 0.1;
const NEARLY: f64 = 0.99;
/// At its own speed a run is played unless that takes longer than this, seconds.
const PLAYED_IN_S: f64 = 60.0;

/// A finished run: what was new when. It begins where the run began, and each moment has its time.
#[derive(Debug, Clone, Default)]
pub struct Replay {
    moments: Vec<News>,
}

impl Replay {
    /// Of what was new at each moment; moments without a time, or with one before that of the last, have its time.
    #[must_use]
    pub fn new(moments: impl IntoIterator<Item = News>) -> Self {
        let mut last_s = 0.0;
        let in_order = |mut news: News| {
            last_s = news.at_s.filter(|at_s| at_s.is_finite()).map_or(last_s, |at_s: f64| at_s.max(last_s));
            news.at_s = Some(last_s);
            news
        };
        Self { moments: moments.into_iter().map(in_order).collect() }
    }

    /// How long the run took, seconds.
    #[must_use]
    pub fn duration_s(&self) -> f64 {
        self.moments.last().and_then(|news| news.at_s).unwrap_or(0.0)
    }

    /// Moments in it.
    #[must_use]
    pub fn len(&self) -> usize {
        self.moments.len()
    }

    /// Whether there is nothing to be shown.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.moments.is_empty()
    }

    /// Moments up to a time.
    fn until(&self, at_s: f64) -> usize {
        self.moments.partition_point(|news| news.at_s.is_some_and(|moment_s| moment_s <= at_s))
    }
}

/// Makes a [`Replay`] of a log, entry by entry.
///
/// A session keeps neither covariances nor what was thought of each scan, so no uncertainty is shown, and a keyframe whose scan hardly
/// fitted counts as degraded.
#[derive(Debug)]
pub struct ReplayMaker<M: View> {
    session: Session<M>,
    feed: Feed,
    moments: Vec<News>,
    last_s: Option<f64>,
}

impl<M: View> Default for ReplayMaker<M> {
    fn default() -> Self {
        Self { session: Session::default(), feed: Feed::default(), moments: Vec::new(), last_s: None }
    }
}

impl<M: View> ReplayMaker<M> {
    /// Takes the next entry of the log.
    ///
    /// # Errors
    /// [`EntryError`] for one that does not fit what came before; nothing of it is taken.
    pub fn add(&mut self, entry: Entry<M>) -> Result<(), EntryError> {
        let stamp = if let Entry::Scan(scan) = &entry { Some(scan.stamp) } else { None };
        self.feed.hear_entries(std::slice::from_ref(&entry));
        self.session.add(entry)?;
        let at_s = stamp.map(|stamp| self.feed.since_begin_s(stamp));
        if let Some(at_s) = at_s.filter(|at_s| self.last_s.is_none_or(|last_s| at_s - last_s > NEARLY * STEP_S)) {
            self.cut();
            self.last_s = Some(at_s);
        }
        Ok(())
    }

    /// The run.
    #[must_use]
    pub fn finish(mut self) -> Replay {
        self.cut();
        Replay::new(self.moments)
    }

    /// What is new since the last moment is one.
    fn cut(&mut self) {
        let Some(scan) = self.session.scans().last() else { return };
        let at_s = Some(self.feed.since_begin_s(scan.stamp));
        let place = scan.keyframe.and_then(|keyframe| self.session.place(keyframe));
        let robot = place.map(|place| Robot {
            map_from_robot: M::in_space(self.session.map_from_keyframe()[place] * scan.keyframe_from_robot),
            position_m2: Matrix3::zeros(),
            heading_sigma_rad: 0.0,
            status: if self.session.keyframes()[place].hardly_fits { Status::Degraded } else { Status::Tracking },
            is_joined: true,
        });
        let mut news = News { at_s, robot, ..self.feed.of_session(&self.session) };
        let first = self.session.keyframes().len() - news.keyframes.len();
        for (placed, keyframe) in news.keyframes.iter_mut().zip(&self.session.keyframes()[first..]) {
            placed.status = if keyframe.hardly_fits { Status::Degraded } else { Status::Tracking };
        }
        self.moments.push(news);
    }
}

/// A run that is being played.
pub(crate) struct Player {
    replay: Replay,
    /// Moments that are shown.
    shown: usize,
    pub(crate) at_s: f64,
    pub(crate) speed: f64,
    pub(crate) is_paused: bool,
}

impl Player {
    pub(crate) fn new(replay: Replay) -> Self {
        let speed = (replay.duration_s() / PLAYED_IN_S).ceil().clamp(1.0, 1000.0);
        Self { replay, shown: 0, at_s: 0.0, speed, is_paused: false }
    }

    pub(crate) fn end_s(&self) -> f64 {
        self.replay.duration_s()
    }

    /// So much time has passed. At its end a run stands still.
    pub(crate) fn advance(&mut self, elapsed_s: f64) {
        if !self.is_paused {
            self.at_s = (self.at_s + elapsed_s * self.speed).min(self.end_s());
            self.is_paused = self.at_s >= self.end_s();
        }
    }

    pub(crate) fn resume(&mut self) {
        self.is_paused = false;
        if self.at_s >= self.end_s() {
            self.at_s = 0.0;
        }
    }

    pub(crate) fn seek(&mut self, at_s: f64) {
        self.at_s = at_s.clamp(0.0, self.end_s());
    }

    /// Brings a model to where the run is.
    pub(crate) fn show(&mut self, model: &mut Model, scene: &mut Scene) {
        let wanted = self.replay.until(self.at_s);
        if wanted == self.shown {
            return;
        }
        let before = model.lengths();
        let is_back = wanted < self.shown;
        if is_back {
            model.rewind();
            self.shown = 0;
        }
        let mut news = News::default();
        self.replay.moments[self.shown..wanted].iter().for_each(|moment| news.add(moment.clone()));
        model.apply(news, scene);
        if is_back {
            model.tell_all(before);
        }
        self.shown = wanted;
    }
}
