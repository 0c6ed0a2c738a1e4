//! The back end: what may take longer than a scan, as jobs, and what is known of cycles.

use crate::cycles::{self, Follows};
use crate::jobs::{Job, Outcome, Task};
use crate::settings::{Correction, Jobs, LivePolicy, Settings};
use crate::store::{Link, NewKeyframe, Store, Written};
use mapwright_loops::{Closes, Closing, ClosingSettings, Solving};
use mapwright_record::{Localisation, Past};
use mapwright_sensor::Sweep;
use std::collections::VecDeque;

/// Jobs and cycles.
#[derive(Debug, Clone)]
pub(crate) struct BackEnd<M: Closes = Sweep> {
    pub(crate) closing: Closing<M::Submaps>,
    jobs: VecDeque<Job<M>>,
    /// Jobs that were handed out and have not come back.
    out: usize,
    /// Keyframes that were made since one waits.
    waiting_keyframes: u32,
    is_inline: bool,
}

impl<M: Closes> BackEnd<M> {
    pub(crate) fn new(settings: &Settings) -> Self {
        Self {
            closing: Closing::new(closing_settings(settings)),
            jobs: VecDeque::new(),
            out: 0,
            waiting_keyframes: 0,
            is_inline: settings.loops.jobs == Jobs::Inline,
        }
    }

    pub(crate) fn put(&self, out: &mut Vec<u8>) {
        self.closing.put(out);
    }

    /// Goes on as it was, with nothing under way; `past` is all of the session.
    pub(crate) fn restore(settings: &Settings, past: Past<'_, M>, from: &mut &[u8]) -> Option<Self> {
        let closing = Closing::restore(closing_settings(settings), past, from)?;
        Some(Self { closing, ..Self::new(settings) })
    }

    /// Goes on with a session by its edges alone. A killed run's log has all edges, but poses may be older than the newest.
    pub(crate) fn made_again(settings: &Settings, store: &mut Store<M>) -> Self {
        let closures = store.closures();
        let is_to_solve = !closures.is_empty() && !store.is_fixed() && settings.loops.correction == Correction::Graph;
        let solving = is_to_solve.then(|| Solving::of::<M::Submaps>(store.graph(), closures));
        if let Some(solved) = solving.and_then(Solving::run) {
            store.correct(&solved.map_from_keyframe);
        }
        let mut back = Self::new(settings);
        back.closing.resume(store.past());
        back
    }

    /// Writes a keyframe down. A match that leads to an old place is no edge until the place was looked at.
    pub(crate) fn write(&mut self, store: &mut Store<M>, new: &NewKeyframe<M>, link: Link) -> Option<Written<M::Pose>> {
        let closing = &mut self.closing;
        let written = store.add_keyframe(new, link, |past, anchor| closing.links(past, anchor))?;
        written.unjudged.into_iter().for_each(|edge| closing.wait(store.past(), edge));
        if let Link::Break(_) = link {
            closing.see_pieces(store.past());
        }
        Some(written)
    }

    /// Whether what is mapped now is joined with the rest.
    pub(crate) fn localisation(&self) -> Localisation {
        if self.closing.is_apart() { Localisation::Apart } else { Localisation::Joined }
    }

    /// Whether something is under way, which was asked of the past as it is.
    pub(crate) fn is_busy(&self) -> bool {
        self.out > 0 || !self.jobs.is_empty()
    }

    pub(crate) fn push(&mut self, task: Task<M>) {
        self.jobs.push_back(Job(task));
    }

    /// The next job, where they are done at once.
    pub(crate) fn next_inline(&mut self) -> Option<Job<M>> {
        if self.is_inline { self.jobs.pop_front() } else { None }
    }

    /// The next job, for somebody who brings its result back.
    pub(crate) fn hand_out(&mut self) -> Option<Job<M>> {
        let job = self.jobs.pop_front();
        self.out += usize::from(job.is_some());
        job
    }

    pub(crate) fn came_back(&mut self) {
        self.out = self.out.saturating_sub(1);
        self.waiting_keyframes = 0;
    }

    /// A scan has become a keyframe or not.
    pub(crate) fn count_waiting(&mut self, is_keyframe: bool) {
        if is_keyframe && self.is_busy() {
            self.waiting_keyframes = self.waiting_keyframes.saturating_add(1);
        }
    }

    pub(crate) fn waiting_keyframes(&self) -> u32 {
        self.waiting_keyframes
    }

    /// Takes in what was found at old places, or the poses of a solved graph, and hands out what follows from that; whether the past was
    /// moved. What does not belong to this run is left out.
    pub(crate) fn take_in(
        &mut self,
        store: &mut Store<M>,
        front: &mut impl Follows<M>,
        outcome: Outcome<M>,
        correction: Correction,
    ) -> bool {
        let known = store.len();
        match outcome {
            Outcome::Advanced(rest) => {
                self.jobs.push_front(Job(Task::Verify(rest)));
                false
            }
            Outcome::Verified(verified) if verified.to.index() < known => {
                let judged = cycles::judge(&mut self.closing, store, front, &verified, correction);
                judged.solving.into_iter().for_each(|solving| self.push(Task::Solve(solving)));
                judged.is_moved
            }
            Outcome::Solved(Some(solved)) if solved.map_from_keyframe.len() <= known => {
                cycles::correct(&mut self.closing, store, front, &solved)
            }
            _ => false,
        }
    }
}

/// How cycles are looked for, in the plane and in space.
pub(crate) fn closing_settings(settings: &Settings) -> ClosingSettings {
    ClosingSettings {
        by_pose: settings.loops.by_pose,
        by_place: settings.loops.by_place,
        keeps_everything_live: settings.live.policy != LivePolicy::Gated,
    }
}
