//! Which keyframe stands where.

use crate::id::{KeyframeId, RunId};
use crate::numbers::Numbers;
use std::collections::BTreeMap;

/// Runs and the names of their keyframes as they stand in a session or in a log: one run after the other, or of several robots that
/// drive at the same time in turn.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Names {
    runs: Vec<NamedRun>,
    /// The run of the keyframe that comes next.
    present: usize,
    keyframes: usize,
    /// Where a run goes on after keyframes of others: the place of its next keyframe by that of its last one before, and the other way round.
    next: BTreeMap<usize, usize>,
    last: BTreeMap<usize, usize>,
}

#[derive(Debug, Clone, PartialEq)]
struct NamedRun {
    id: RunId,
    seqs: Numbers,
    /// Its keyframes without others between them, in order; never empty.
    stretches: Vec<Stretch>,
}

/// Keyframes of a run that stand one after the other.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Stretch {
    /// Place of the first.
    first: usize,
    /// How many keyframes of the run stand before it.
    before: usize,
}

impl NamedRun {
    /// The place of one of its keyframes, of which so many stand before it.
    fn place(&self, before: usize) -> Option<usize> {
        let begun = self.stretches.partition_point(|stretch| stretch.before <= before);
        let stretch = self.stretches.get(begun.checked_sub(1)?)?;
        Some(stretch.first + before - stretch.before)
    }
}

impl Names {
    /// A run begins; false where it has begun before.
    pub(crate) fn begin(&mut self, id: RunId) -> bool {
        let new = self.run_number(id).is_none();
        if new {
            let stretches = vec![Stretch { first: self.keyframes, before: 0 }];
            self.present = self.runs.len();
            self.runs.push(NamedRun { id, seqs: Numbers::default(), stretches });
        }
        new
    }

    /// What comes next is of this run again; false where it has not begun.
    pub(crate) fn go_back_to(&mut self, id: RunId) -> bool {
        let number = self.run_number(id);
        self.present = number.unwrap_or(self.present);
        number.is_some()
    }

    /// How many have begun.
    pub(crate) fn run_count(&self) -> usize {
        self.runs.len()
    }

    /// Which run this is, from zero.
    pub(crate) fn run_number(&self, id: RunId) -> Option<usize> {
        self.runs.iter().rposition(|run| run.id == id)
    }

    /// The run of the keyframe that comes next.
    pub(crate) fn present(&self) -> Option<RunId> {
        Some(self.runs.get(self.present)?.id)
    }

    /// Place of a run's first keyframe.
    pub(crate) fn first_of_run(&self, number: usize) -> Option<usize> {
        Some(self.runs.get(number)?.stretches.first()?.first)
    }

    fn run(&self, id: KeyframeId) -> Option<&NamedRun> {
        self.runs.get(self.run_number(id.run())?)
    }

    /// The name of the keyframe that comes next; none before the first run, nor where a run has had all there are.
    pub(crate) fn next(&self) -> Option<KeyframeId> {
        let run = self.runs.get(self.present)?;
        Some(run.id.keyframe(u32::try_from(run.seqs.next()).ok()?))
    }

    /// The next keyframe of the present run stands there too, with this place in the run's order or a later one.
    pub(crate) fn push(&mut self, seq: u32) {
        let Some(run) = self.runs.get_mut(self.present) else { return };
        let (first, before) = (self.keyframes, run.seqs.count());
        match before.checked_sub(1).map(|last| run.place(last)) {
            // Nothing of it is there yet: it begins here, whatever came since it was named.
            None => run.stretches = vec![Stretch { first, before }],
            Some(Some(last)) if last + 1 != first => {
                run.stretches.push(Stretch { first, before });
                self.next.insert(last, first);
                self.last.insert(first, last);
            }
            Some(_) => {}
        }
        run.seqs.leap_to(u64::from(seq));
        run.seqs.push();
        self.keyframes += 1;
    }

    /// The place of a keyframe.
    pub(crate) fn place(&self, id: KeyframeId) -> Option<usize> {
        let run = self.run(id)?;
        run.place(run.seqs.place(u64::from(id.seq))?)
    }

    /// Whether the keyframe is or was there, or was about to come when it was named.
    pub(crate) fn is_or_was_next(&self, id: KeyframeId) -> bool {
        self.run(id).is_some_and(|run| u64::from(id.seq) <= run.seqs.next())
    }

    /// The place of the keyframe that the robot made before the one at this place, where keyframes of others may stand between them.
    pub(crate) fn before(&self, place: usize) -> Option<usize> {
        self.last.get(&place).copied().or_else(|| place.checked_sub(1))
    }

    /// The place of the keyframe that the robot made after the one at this place; none where keyframes of others are the newest.
    pub(crate) fn after(&self, place: usize) -> Option<usize> {
        let next = self.next.get(&place).copied();
        next.or_else(|| Some(place + 1).filter(|next| *next < self.keyframes && !self.last.contains_key(next)))
    }

    /// Where runs go on after keyframes of others, in order.
    pub(crate) fn returns(&self) -> impl Iterator<Item = usize> + '_ {
        self.last.keys().copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_in_turn_know_their_own_way() {
        let mut names = Names::default();
        let [a, b] = ["a", "b"].map(RunId::of_robot);
        assert!(names.begin(a) && !names.begin(a) && !names.go_back_to(b));
        // a a b a b b a
        [0, 1].into_iter().for_each(|seq| names.push(seq));
        assert!(names.begin(b));
        names.push(0);
        assert!(names.go_back_to(a) && names.next() == Some(a.keyframe(2)));
        names.push(2);
        names.go_back_to(b);
        [1, 2].into_iter().for_each(|seq| names.push(seq));
        names.go_back_to(a);
        names.push(5);
        let places = |run: RunId| (0..6).map(|seq| names.place(run.keyframe(seq))).collect::<Vec<_>>();
        assert_eq!(places(a), [Some(0), Some(1), Some(3), None, None, Some(6)]);
        assert_eq!(places(b), [Some(2), Some(4), Some(5), None, None, None]);
        let before: Vec<_> = (0..7).map(|place| names.before(place)).collect();
        assert_eq!(before, [None, Some(0), Some(1), Some(1), Some(2), Some(4), Some(3)]);
        let after: Vec<_> = (0..7).map(|place| names.after(place)).collect();
        assert_eq!(after, [Some(1), Some(3), Some(4), Some(6), Some(5), None, None]);
        assert_eq!(names.returns().collect::<Vec<_>>(), [3, 4, 6]);
        assert_eq!((names.first_of_run(1), names.present()), (Some(2), Some(a)));
    }
}
