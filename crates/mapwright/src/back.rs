//! The back end: what may take longer than a scan, as jobs, and what is known of cycles.

use crate::jobs::{Job, Task};
use crate::relocation::Budget;
use crate::settings::{Jobs, LivePolicy, Settings};
use mapwright_geom::Stored;
use mapwright_loops::{Closing, ClosingSettings, PlaneSubmaps};
use mapwright_record::Past;
use std::collections::VecDeque;

/// Jobs and cycles.
#[derive(Debug, Clone)]
pub(crate) struct BackEnd {
    pub(crate) closing: Closing<PlaneSubmaps>,
    jobs: VecDeque<Job>,
    /// Jobs that were handed out and have not come back.
    out: usize,
    is_inline: bool,
    /// How often it was asked where the robot is, and what that may cost.
    questions: u64,
    pub(crate) budget: Budget,
}

impl BackEnd {
    pub(crate) fn new(settings: &Settings) -> Self {
        Self {
            closing: Closing::new(closing_settings(settings)),
            jobs: VecDeque::new(),
            out: 0,
            is_inline: settings.loops.jobs == Jobs::Inline,
            questions: 0,
            budget: Budget::default(),
        }
    }

    pub(crate) fn put(&self, out: &mut Vec<u8>) {
        self.closing.put(out);
        self.questions.put(out);
        self.budget.put(out);
    }

    /// Goes on as it was, with nothing under way; `past` is all of the session.
    pub(crate) fn restore(settings: &Settings, past: Past<'_>, from: &mut &[u8]) -> Option<Self> {
        let closing = Closing::restore(closing_settings(settings), past, from)?;
        let (questions, budget) = Stored::take(from)?;
        Some(Self { closing, questions, budget, ..Self::new(settings) })
    }

    /// Whether something is under way, which was asked of the past as it is.
    pub(crate) fn is_busy(&self) -> bool {
        self.out > 0 || !self.jobs.is_empty()
    }

    pub(crate) fn push(&mut self, task: Task) {
        self.jobs.push_back(Job(task));
    }

    /// The next job, where they are done at once.
    pub(crate) fn next_inline(&mut self) -> Option<Job> {
        if self.is_inline { self.jobs.pop_front() } else { None }
    }

    /// The next job, for somebody who brings its result back.
    pub(crate) fn hand_out(&mut self) -> Option<Job> {
        let job = self.jobs.pop_front();
        self.out += usize::from(job.is_some());
        job
    }

    pub(crate) fn came_back(&mut self) {
        self.out = self.out.saturating_sub(1);
    }

    /// The number of a question where the robot is, and what it may cost; none while that is too little.
    pub(crate) fn next_question(&mut self) -> Option<(u64, u64)> {
        let effort = self.budget.for_question()?;
        self.questions += 1;
        Some((self.questions, effort))
    }

    #[cfg(test)]
    pub(crate) fn questions(&self) -> u64 {
        self.questions
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
