//! The solution: what the robot that solves has found, as records of its own, and what everybody makes of them.
//!
//! A solution is a stream of steps over its records: a group of a robot's entries is taken in, with the pose that its keyframe gets, or entries
//! follow that were found. It begins with its term, and with the solution of another robot that it goes on with, up to which record. Of all
//! solutions the one of the highest term counts, among equals that of the first robot: a function of the records alone, so that all who hold
//! the same records have the same map, to the byte.

use crate::inbox::Inbox;
use crate::record::ChainId;
use crate::steps::{Begin, NoStep, SolutionId, Step};
use mapwright::{Adoption, EdgeKind, Entry, FragmentStart, RecordedEdge, Session};
use mapwright_record::{EntryReader, Grows};
use std::cmp::Reverse;
use std::collections::BTreeMap;

/// A step is no longer than this, bytes.
const LEFT_AT_MOST: usize = 1 << 26;

/// Solutions that a robot may begin: so many, and one more for so many records that it has said. Who begins more often is not followed: so to
/// outbid others time and again takes more of a liar's own room than of theirs.
const BEGINS_FREE: u32 = 32;
const RECORDS_A_BEGIN: u32 = 16;

/// The solutions that are known by their beginnings.
#[derive(Debug, Clone, Default)]
pub(crate) struct Solutions {
    known: BTreeMap<SolutionId, Begin>,
    /// How many each chain has begun.
    begun: BTreeMap<ChainId, u32>,
    /// Solutions that hold what cannot be.
    broken: Vec<SolutionId>,
}

impl Solutions {
    /// Records of a chain are read in their order, so that all who read it leave out the same ones.
    pub(crate) fn add(&mut self, id: SolutionId, begin: Begin) {
        if self.may_begin(id, 0) {
            self.known.insert(id, begin);
        }
        *self.begun.entry(id.chain).or_default() += 1;
    }

    /// Whether a robot may begin a solution with this record, after so many that were not read yet.
    pub(crate) fn may_begin(&self, id: SolutionId, unread: u32) -> bool {
        let begun = self.begun.get(&id.chain).copied().unwrap_or(0);
        begun.saturating_add(unread) < BEGINS_FREE.saturating_add(id.begin / RECORDS_A_BEGIN)
    }

    pub(crate) fn break_off(&mut self, id: SolutionId) {
        self.broken.push(id);
    }

    /// Whether it is known.
    pub(crate) fn has(&self, id: SolutionId) -> bool {
        self.known.contains_key(&id)
    }

    pub(crate) fn get(&self, id: SolutionId) -> Option<&Begin> {
        self.known.get(&id)
    }

    /// The one that counts.
    pub(crate) fn best(&self, is_trusted: impl Fn(u16) -> bool) -> Option<(SolutionId, Begin)> {
        let usable = self.known.iter().filter(|(id, _)| !self.broken.contains(id) && is_trusted(id.chain.rank));
        let usable = usable.filter(|(_, begin)| self.path(begin).is_some());
        usable.max_by_key(|(id, begin)| (begin.term, Reverse(**id))).map(|(id, begin)| (*id, *begin))
    }

    /// The parts of other solutions that one begins with, in order; none where one of them is not there, or the term is not the next one: so
    /// nobody can claim a term that all others would have to yield to.
    fn path(&self, begin: &Begin) -> Option<Vec<(SolutionId, u32)>> {
        let (mut path, mut next, mut term) = (Vec::new(), begin.base, begin.term);
        while let Some((id, end)) = next {
            let base = self.known.get(&id)?;
            (term == base.term.checked_add(1)?).then_some(())?;
            path.push((id, end));
            (next, term) = (base.base, base.term);
        }
        path.reverse();
        (term == 1).then_some(path)
    }

    /// Where the records of one end: with the next one of the same chain.
    fn end(&self, id: SolutionId) -> u32 {
        let after = (std::ops::Bound::Excluded(id), std::ops::Bound::Unbounded);
        let next = self.known.range(after).next().filter(|(next, _)| next.chain == id.chain);
        next.map_or(u32::MAX, |(next, _)| next.begin)
    }

    /// The map of a solution, of which nothing was read yet.
    pub(crate) fn replay(&self, id: SolutionId, begin: &Begin) -> Option<Replay> {
        let mut parts: Vec<Part> = self.path(begin)?.into_iter().map(|(id, end)| Part { id, end: Some(end) }).collect();
        parts.push(Part { id, end: None });
        let next = parts.first()?.id.begin + 1;
        Some(Replay { id, parts, at: 0, next, ..Replay::default() })
    }
}

/// Whether it is for the robot that solves to say: closures and what becomes of them, where keyframes lie, and what of ways and matches is
/// contradicted. What odometry says within a fragment stands.
fn may_be_found(session: &Session, entry: &Entry) -> bool {
    let edge = |number: u32| session.recorded_edges().get(number as usize);
    let is_over_break = |ends: [u32; 2]| session.joined_fragments(ends.map(|end| end as usize)).is_some();
    match entry {
        Entry::Run(_) | Entry::Candidate(_) | Entry::Verdict { .. } | Entry::Snapshot(_) => true,
        Entry::Fragment(fragment) => fragment.start == FragmentStart::Contradicted,
        Entry::Edge(RecordedEdge { edge, .. }) => {
            let ends = session.place(edge.from).zip(session.place(edge.to));
            edge.kind == EdgeKind::Closure || ends.is_some_and(|(a, b)| session.joined_fragments([a, b]).is_some())
        }
        Entry::Withdrawn { number } => edge(*number)
            .is_some_and(|known| known.recorded.edge.kind != EdgeKind::Odometry || is_over_break(known.ends)),
        Entry::Remeasured { number, .. } => edge(*number).is_some_and(|known| is_over_break(known.ends)),
        _ => false,
    }
}

/// Records of a solution up to one.
#[derive(Debug, Clone, Copy)]
struct Part {
    id: SolutionId,
    end: Option<u32>,
}

/// A solution as far as its records, and those of the robots, are there.
#[derive(Default)]
pub(crate) struct Replay {
    pub(crate) id: SolutionId,
    parts: Vec<Part>,
    /// Which part is read, and its next record.
    at: usize,
    next: u32,
    /// Steps that were not made yet, and whether the first of them takes in what is not there yet.
    left: Vec<u8>,
    is_blocked: bool,
    /// Whether the last step says that there is nothing to add.
    pub(crate) is_settled: bool,
    reader: EntryReader,
    pub(crate) adoptions: BTreeMap<ChainId, Adoption>,
    /// How many groups of each chain were taken in.
    pub(crate) taken: BTreeMap<ChainId, usize>,
}

impl Replay {
    pub(crate) fn session(&self) -> &Session {
        self.reader.session()
    }

    /// How far it was read: up to which record of which solution; none where a step waits for what is not there yet.
    pub(crate) fn reached(&self) -> Option<(SolutionId, u32)> {
        let part = self.parts.get(self.at).filter(|_| !self.is_blocked)?;
        Some((part.id, self.next))
    }

    /// The same up to before the record at which it waits, to be read anew.
    pub(crate) fn before_block(&self) -> Option<Self> {
        let mut parts = self.parts.get(..=self.at)?.to_vec();
        parts.last_mut()?.end = Some(self.next.checked_sub(1)?);
        let next = parts.first()?.id.begin + 1;
        Some(Self { id: self.id, parts, next, ..Self::default() })
    }

    /// Reads on; whether the map has changed.
    ///
    /// # Errors
    /// A step that cannot be made by any reader.
    pub(crate) fn advance(&mut self, solutions: &Solutions, inbox: &Inbox) -> Result<bool, NoStep> {
        let mut has_changed = self.make_steps(inbox)?;
        while let Some(&Part { id, end }) = self.parts.get(self.at).filter(|_| !self.is_blocked) {
            let end = end.unwrap_or(u32::MAX).min(solutions.end(id));
            if self.next >= end {
                let Some(part) = self.parts.get(self.at + 1) else { break };
                (self.at, self.next) = (self.at + 1, part.id.begin + 1);
                // Who goes on did not know how that step ends.
                self.left.clear();
                continue;
            }
            let Some(steps) = inbox.steps(id.chain, self.next)? else { break };
            self.next += 1;
            self.left.extend_from_slice(&steps);
            if self.left.len() > LEFT_AT_MOST {
                return Err(NoStep);
            }
            has_changed |= self.make_steps(inbox)?;
        }
        Ok(has_changed)
    }

    fn make_steps(&mut self, inbox: &Inbox) -> Result<bool, NoStep> {
        let left = std::mem::take(&mut self.left);
        let (mut rest, mut has_changed) = (&left[..], false);
        self.is_blocked = false;
        loop {
            let before = rest;
            let Some(step) = Step::take(&mut rest)? else { break };
            if !self.make(&step, inbox)? {
                (rest, self.is_blocked) = (before, true);
                break;
            }
            has_changed = true;
        }
        self.left = rest.to_vec();
        Ok(has_changed)
    }

    /// Whether the step could be made: what it takes in may not be there yet.
    fn make(&mut self, step: &Step<'_>, inbox: &Inbox) -> Result<bool, NoStep> {
        self.is_settled = *step == Step::Settled;
        match step {
            Step::Begin(_) => Err(NoStep),
            Step::Settled => Ok(true),
            Step::TakeIn(chain, pose) => {
                let taken = self.taken.entry(*chain).or_default();
                let Some(group) = inbox.group(*chain, *taken) else { return Ok(false) };
                *taken += 1;
                self.adoptions.entry(*chain).or_default().take_in(&mut self.reader, group, *pose);
                Ok(true)
            }
            Step::Found(bytes) => {
                let found = self.reader.read(bytes).map_err(|_| NoStep)?;
                let session = self.reader.session();
                if found.iter().all(|entry| may_be_found(session, entry)) { Ok(true) } else { Err(NoStep) }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A robot that begins one solution on the other, `apart` records apart; the numbers of those that count.
    fn outbid(apart: u32, times: u32) -> Vec<u32> {
        let chain = ChainId { rank: 1, session: 0 };
        let mut solutions = Solutions::default();
        let first = SolutionId { chain: ChainId { rank: 0, session: 0 }, begin: 0 };
        solutions.add(first, Begin { term: 1, base: None });
        let mut counting = Vec::new();
        let mut base = first;
        for number in 0..times {
            let id = SolutionId { chain, begin: number * apart };
            let begin = Begin { term: u64::from(number) + 2, base: Some((base, base.begin + 1)) };
            solutions.add(id, begin);
            if solutions.best(|_| true).is_some_and(|(best, _)| best == id) {
                counting.push(number);
            }
            base = id;
        }
        counting
    }

    #[test]
    fn who_outbids_others_time_and_again_is_not_followed() {
        assert_eq!(outbid(1, 1000).len(), BEGINS_FREE as usize + 2);
        assert_eq!(outbid(RECORDS_A_BEGIN, 1000).len(), 1000);
    }
}
