//! Which keyframe stands where.

use crate::id::{KeyframeId, RunId};
use crate::numbers::Numbers;

/// Runs and the names of their keyframes, one run after the other, as they stand in a session or in a log.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Names {
    runs: Vec<NamedRun>,
    keyframes: usize,
}

#[derive(Debug, Clone, PartialEq)]
struct NamedRun {
    id: RunId,
    /// Place of its first keyframe.
    first: usize,
    seqs: Numbers,
}

impl Names {
    /// A run begins; false where it has begun before.
    pub(crate) fn begin(&mut self, id: RunId) -> bool {
        let new = self.run_number(id).is_none();
        if new {
            self.runs.push(NamedRun { id, first: self.keyframes, seqs: Numbers::default() });
        }
        new
    }

    /// How many have begun.
    pub(crate) fn run_count(&self) -> usize {
        self.runs.len()
    }

    /// Which run this is, from zero.
    pub(crate) fn run_number(&self, id: RunId) -> Option<usize> {
        self.runs.iter().rposition(|run| run.id == id)
    }

    /// Place of a run's first keyframe.
    pub(crate) fn first_of_run(&self, number: usize) -> Option<usize> {
        Some(self.runs.get(number)?.first)
    }

    fn run(&self, id: KeyframeId) -> Option<&NamedRun> {
        self.runs.get(self.run_number(id.run())?)
    }

    /// The name of the keyframe that comes next; none before the first run, nor where a run has had all there are.
    pub(crate) fn next(&self) -> Option<KeyframeId> {
        let run = self.runs.last()?;
        Some(run.id.keyframe(u32::try_from(run.seqs.next()).ok()?))
    }

    /// The next keyframe of the present run stands there too, with this place in the run's order or a later one.
    pub(crate) fn push(&mut self, seq: u32) {
        if let Some(run) = self.runs.last_mut() {
            run.seqs.leap_to(u64::from(seq));
            run.seqs.push();
            self.keyframes += 1;
        }
    }

    /// The place of a keyframe.
    pub(crate) fn place(&self, id: KeyframeId) -> Option<usize> {
        let run = self.run(id)?;
        Some(run.first + run.seqs.place(u64::from(id.seq))?)
    }

    /// Whether the keyframe is or was there, or was about to come when it was named.
    pub(crate) fn is_or_was_next(&self, id: KeyframeId) -> bool {
        self.run(id).is_some_and(|run| u64::from(id.seq) <= run.seqs.next())
    }
}
