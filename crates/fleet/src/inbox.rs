//! What the records of all robots hold, read as they come.

use crate::chain::Chain;
use crate::keys::Roster;
use crate::message::Refusal;
use crate::record::{ChainId, Kind};
use crate::sightings::{SightedRobot, joins};
use crate::steps::{Begin, NoStep, SolutionId, Step};
use mapwright::{Entry, RunId, Sighted, groups};
use mapwright_record::EntryReader;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Bytes that a payload may have once it is unpacked.
const UNPACKED_AT_MOST: usize = 1 << 23;

/// Bytes of a chain's entries once they are unpacked: four times what a robot may say.
const UNPACKED_IN_ALL: usize = 1 << 30;

/// Packs a payload.
pub(crate) fn pack(bytes: &[u8]) -> Vec<u8> {
    // In memory, at a level that there is, it cannot fail.
    zstd::bulk::compress(bytes, 9).unwrap_or_default()
}

fn unpack(bytes: &[u8]) -> Option<Vec<u8>> {
    zstd::bulk::decompress(bytes, UNPACKED_AT_MOST).ok()
}

/// What was read of one chain.
#[derive(Default)]
struct Read {
    /// Records so far.
    records: u32,
    reader: EntryReader,
    groups: Vec<Box<[Entry]>>,
    /// Bytes of entries so far, unpacked.
    unpacked: usize,
    /// Steps of solutions, packed, by their records.
    steps: BTreeMap<u32, Arc<[u8]>>,
    /// A payload could not be read: what comes after it hangs in the air.
    is_broken: bool,
}

/// What has come.
#[derive(Default)]
pub(crate) struct News {
    /// Solutions that have begun.
    pub(crate) begun: Vec<(SolutionId, Begin)>,
    /// What cannot be read, and of whom.
    pub(crate) refused: Vec<(Refusal, Option<u16>)>,
}

/// What was read of all chains.
pub(crate) struct Inbox {
    /// By their places in the roster, what keyframes call the robots.
    robots: Vec<u128>,
    chains: BTreeMap<ChainId, Read>,
    /// What robots saw of others.
    sightings: BTreeMap<u16, Vec<SightedRobot>>,
}

impl Inbox {
    /// Nothing was read yet of the robots of this team.
    pub(crate) fn new(roster: &Roster) -> Self {
        let robots = roster.members().iter().map(|member| RunId::of_robot(&member.name).robot).collect();
        Self { robots, chains: BTreeMap::new(), sightings: BTreeMap::new() }
    }

    /// Reads what has come.
    pub(crate) fn read(&mut self, chains: &BTreeMap<ChainId, Chain>) -> News {
        let mut news = News::default();
        for (&id, chain) in chains {
            let read = self.chains.entry(id).or_default();
            while let Some(record) = chain.records().get(read.records as usize) {
                let seq = read.records;
                read.records += 1;
                let payload = unpack(&record.payload);
                let is_read = payload.is_some_and(|payload| match record.kind {
                    Kind::Entries => read.entries(&payload, self.robots.get(usize::from(id.rank)).copied()),
                    Kind::Solution => {
                        let id = SolutionId { chain: id, begin: seq };
                        read.solution(id, &payload, &record.payload, &mut news.begun);
                        true
                    }
                    Kind::Sightings => {
                        let robot = self.robots.get(usize::from(id.rank)).copied();
                        let seen = robot.and_then(|robot| SightedRobot::all(&payload, robot));
                        let is_read = seen.is_some();
                        self.sightings.entry(id.rank).or_default().extend(seen.into_iter().flatten());
                        is_read
                    }
                });
                if !is_read {
                    news.refused.push((Refusal::BadPayload, Some(id.rank)));
                }
            }
        }
        news
    }

    /// A group of a chain, by its number.
    pub(crate) fn group(&self, chain: ChainId, number: usize) -> Option<&[Entry]> {
        self.chains.get(&chain)?.groups.get(number).map(|group| &group[..])
    }

    /// How many sightings there are, and the joins that follow from them.
    pub(crate) fn sightings(&self) -> usize {
        self.sightings.values().map(Vec::len).sum()
    }

    pub(crate) fn joins(&self) -> Vec<Sighted> {
        joins(&self.sightings)
    }

    /// How many groups of each chain there are.
    pub(crate) fn groups(&self) -> impl Iterator<Item = (ChainId, usize)> {
        self.chains.iter().map(|(chain, read)| (*chain, read.groups.len()))
    }

    /// The steps of a record of a solution; empty ones for a record of something else, none where it is not there.
    ///
    /// # Errors
    /// It could not be read.
    pub(crate) fn steps(&self, chain: ChainId, seq: u32) -> Result<Option<Vec<u8>>, NoStep> {
        let Some(read) = self.chains.get(&chain).filter(|read| seq < read.records) else { return Ok(None) };
        let Some(packed) = read.steps.get(&seq) else { return Ok(Some(Vec::new())) };
        unpack(packed).map(Some).ok_or(NoStep)
    }
}

impl Read {
    /// Entries of the robot itself: it cannot speak for others.
    fn entries(&mut self, payload: &[u8], robot: Option<u128>) -> bool {
        self.unpacked = self.unpacked.saturating_add(payload.len());
        self.is_broken |= self.unpacked > UNPACKED_IN_ALL;
        if self.is_broken {
            return false;
        }
        let is_own = |entry: &Entry| !matches!(entry, Entry::Run(run) if Some(run.id.robot) != robot);
        match self.reader.read(payload) {
            Ok(entries) if entries.iter().all(is_own) => {
                self.groups.extend(groups(&entries).map(Box::from));
                true
            }
            _ => {
                self.is_broken = true;
                false
            }
        }
    }

    fn solution(&mut self, id: SolutionId, payload: &[u8], packed: &Arc<[u8]>, begun: &mut Vec<(SolutionId, Begin)>) {
        if let Ok(Some(Step::Begin(begin))) = Step::take(&mut &payload[..]) {
            begun.push((id, begin));
        } else {
            self.steps.insert(id.begin, Arc::clone(packed));
        }
    }
}
