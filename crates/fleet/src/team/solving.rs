//! What the robot that solves works on.

use super::TOLD_S;
use crate::inbox::Inbox;
use crate::message::Refusal;
use crate::record::ChainId;
use crate::solution::Replay;
use crate::steps::{SolutionId, Step};
use mapwright::{Adoption, Entry, Mapper, Session, Stamp};
use mapwright_record::LogWriter;
use std::collections::BTreeMap;

/// Bytes of steps that make a record of the solution.
const STEPS_BYTES: usize = 1 << 15;
/// Bytes of steps in one record at most.
const STEPS_AT_MOST: usize = 1 << 19;
/// Corrections take at most this share of what is told.
const SNAPSHOTS: f64 = 0.2;
/// Keyframes that are taken in of one robot before it is another one's turn.
const TURN: usize = 8;
/// When nothing has come for so long, the poses are handed out as they are, seconds,
const SETTLED_S: f64 = 5.0;
/// and old places are looked for anew.
const LOOKED_AGAIN_S: f64 = 10.0;

/// The solution that this robot works on.
pub(super) struct Solving {
    pub(super) id: SolutionId,
    pub(super) mapper: Mapper,
    writer: LogWriter,
    adoptions: BTreeMap<ChainId, Adoption>,
    taken: BTreeMap<ChainId, usize>,
    /// Whose turn it is.
    turn: ChainId,
    steps: Vec<u8>,
    /// What was refused of whom, once each.
    pub(super) refused: Vec<(Refusal, u16)>,
    /// How many sightings and keyframes there were when joins were last made of them.
    met: [usize; 2],
    last_new: Stamp,
    last_said: Option<Stamp>,
    is_settled: bool,
    has_looked_again: bool,
    pub(super) falsify: Option<fn(&mut Entry)>,
}

impl Solving {
    /// Goes on with what is known.
    pub(super) fn new(
        id: SolutionId,
        mapper: Mapper,
        known: Option<&Replay>,
        now: Stamp,
        falsify: Option<fn(&mut Entry)>,
    ) -> Self {
        let writer =
            known.map_or_else(|| LogWriter::resume(&Session::default()), |known| LogWriter::resume(known.session()));
        let mut solving = Self {
            id,
            mapper,
            writer: writer.with_snapshots_of(SNAPSHOTS),
            adoptions: known.map(|known| known.adoptions.clone()).unwrap_or_default(),
            taken: known.map(|known| known.taken.clone()).unwrap_or_default(),
            // The first robot's keyframes come first: the frame is its own.
            turn: ChainId { rank: u16::MAX, session: u32::MAX },
            steps: Vec::new(),
            refused: Vec::new(),
            met: [0; 2],
            // What the one before has not told yet, of poses that its closures have moved, this one tells at once.
            last_new: Stamp(now.0.saturating_sub((1e9 * SETTLED_S) as i64)),
            last_said: None,
            is_settled: false,
            has_looked_again: false,
            falsify,
        };
        let update = solving.mapper.news();
        solving.find(&update.entries);
        solving
    }

    /// Takes in so many keyframes, of each robot some in turn; whether there was anything to do.
    pub(super) fn work(&mut self, inbox: &Inbox, now: Stamp, keyframes: usize) -> bool {
        let mut left = keyframes;
        while left > 0
            && let Some(chain) = self.next_chain(inbox)
        {
            let first = self.taken.get(&chain).copied().unwrap_or(0);
            for number in first..first + TURN.min(left) {
                let Some(group) = inbox.group(chain, number) else { break };
                self.take_in(chain, group);
                left -= 1;
            }
            (self.last_new, self.is_settled, self.has_looked_again) = (now, false, false);
        }
        if self.meet(inbox) {
            (self.last_new, self.is_settled, self.has_looked_again) = (now, false, false);
        }
        let still_s = now.secs_since(self.last_new);
        if left < keyframes || still_s < SETTLED_S {
            return left < keyframes;
        }
        if !self.has_looked_again && still_s >= LOOKED_AGAIN_S {
            (self.has_looked_again, self.is_settled) = (true, false);
            let update = self.mapper.look_again();
            self.find(&update.entries);
        }
        if !self.is_settled {
            self.is_settled = true;
            let mut found = Vec::new();
            self.writer.finish(&mut found);
            self.put_found(&found);
            if self.has_looked_again {
                Step::Settled.put(&mut self.steps);
            }
            return true;
        }
        false
    }

    /// The next chain in turn of which something is left.
    fn next_chain(&mut self, inbox: &Inbox) -> Option<ChainId> {
        let has_more = |&(chain, groups): &(ChainId, usize)| groups > self.taken.get(&chain).copied().unwrap_or(0);
        let after = inbox.groups().filter(has_more).find(|(chain, _)| *chain > self.turn);
        let (chain, _) = after.or_else(|| inbox.groups().find(has_more))?;
        self.turn = chain;
        Some(chain)
    }

    fn take_in(&mut self, chain: ChainId, group: &[Entry]) {
        let adopted = self.mapper.adopt(group, self.adoptions.entry(chain).or_default());
        *self.taken.entry(chain).or_default() += 1;
        self.refused.extend(std::iter::repeat_n((Refusal::Unfitting, chain.rank), adopted.refused));
        let contradicted = usize::from(adopted.is_contradicted) + adopted.contradicted;
        self.refused.extend(std::iter::repeat_n((Refusal::Contradicted, chain.rank), contradicted));
        Step::TakeIn(chain, adopted.map_from_keyframe).put(&mut self.steps);
        let (own, found) = adopted.update.entries.split_at(adopted.own.min(adopted.update.entries.len()));
        for entry in own {
            // What the session has taken the writer takes as well.
            let _ = self.writer.skip(entry);
        }
        self.find(found);
    }

    /// Joins maps of robots that saw each other; whether there was anything to join.
    fn meet(&mut self, inbox: &Inbox) -> bool {
        let known = [inbox.sightings(), self.mapper.keyframes().len()];
        if known[0] == 0 || self.met == known {
            return false;
        }
        self.met = known;
        let mut has_met = false;
        for join in inbox.joins() {
            let update = self.mapper.sighted(&join);
            has_met |= !update.entries.is_empty();
            self.find(&update.entries);
        }
        has_met
    }

    fn find(&mut self, entries: &[Entry]) {
        let mut found = Vec::new();
        for entry in entries {
            let mut entry = entry.clone();
            self.falsify.iter().for_each(|falsify| falsify(&mut entry));
            let _ = self.writer.append(&mut found, &entry);
        }
        self.put_found(&found);
    }

    fn put_found(&mut self, found: &[u8]) {
        if !found.is_empty() {
            Step::Found(found).put(&mut self.steps);
        }
    }

    /// The steps that are due to be told.
    pub(super) fn take_steps(&mut self, now: Stamp) -> Vec<Vec<u8>> {
        let is_due = self.steps.len() >= STEPS_BYTES
            || self.last_said.is_none_or(|last| now.secs_since(last) >= TOLD_S)
            || self.is_settled;
        if self.steps.is_empty() || !is_due {
            return Vec::new();
        }
        self.last_said = Some(now);
        std::mem::take(&mut self.steps).chunks(STEPS_AT_MOST).map(<[u8]>::to_vec).collect()
    }
}
