//! The protocol: who is alive, what each holds, and how what is missing is got from anyone who has it.
//!
//! A node is told the time and the bytes that come in, and hands out bytes to be sent; it knows no clock and no socket. Messages may be lost,
//! doubled, late and out of order.

use crate::chain::{Added, Chain};
use crate::keys::{Roster, Secret};
use crate::message::{Beat, CHAINS_AT_MOST, MESSAGE_AT_MOST, Message, RECORDS_AT_MOST, Refusal};
use crate::record::{ChainId, Equivocation, Kind, PAYLOAD_AT_MOST, Record};
use mapwright_geom::Stamp;
use std::collections::{BTreeMap, BTreeSet};

/// Times that a robot may have been switched on: no robot can take up the room of others.
const SESSIONS_AT_MOST: usize = 64;
/// Beats of a robot that may overtake one another on different ways: ten seconds' worth.
const BEATS_LATE: u64 = 20;

/// How a node behaves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NodeSettings {
    /// A robot says that it is alive this often, seconds.
    pub beat_s: f64,
    /// Who was not heard for so long is taken to be dead or out of reach, seconds; longer where so few of its beats come that silence says less.
    pub lease_s: f64,
    /// What was asked for and did not come is asked for again after so long, seconds.
    pub ask_again_s: f64,
    /// Bytes of records that one robot may have said in all.
    pub bytes_at_most: usize,
}

impl Default for NodeSettings {
    fn default() -> Self {
        Self { beat_s: 0.5, lease_s: 3.0, ask_again_s: 1.0, bytes_at_most: 1 << 28 }
    }
}

/// Bytes to be sent.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Outgoing {
    /// To this robot alone, by its place in the roster; to all where it is none.
    pub to: Option<u16>,
    /// The message.
    pub bytes: Vec<u8>,
}

/// A silence is taken for a death if it would come about by losses once in so many times.
const SILENT_BY_CHANCE: f64 = 0.01;
/// The share of beats that come is told by about so many of the last ones.
const BEATS_REMEMBERED: f64 = 10.0;
/// Questions for the same records that are sent at the same time, at most.
const ASKED_AT_MOST: usize = 4;

/// What is known of another robot.
#[derive(Debug, Clone, Default)]
struct Peer {
    /// The newest beat of its newest session.
    session: u32,
    number: u64,
    heard: Option<Stamp>,
    /// How many of its beats were lost for each one that came, by those that came while it was taken to be alive.
    lost: f64,
    holds: BTreeMap<ChainId, u32>,
    note: Vec<u8>,
}

/// What was asked for and has not come yet.
#[derive(Debug, Clone, Copy)]
struct Asked {
    first: u32,
    of: u16,
    at: Stamp,
    /// How often in vain.
    tries: u32,
}

/// A robot's side of the protocol.
#[derive(Debug, Clone)]
pub struct Node {
    settings: NodeSettings,
    roster: Roster,
    me: ChainId,
    secret: Secret,
    chains: BTreeMap<ChainId, Chain>,
    peers: Vec<Peer>,
    asked: BTreeMap<ChainId, Asked>,
    /// Robots that have said two things, with the proof.
    equivocators: BTreeMap<u16, Equivocation>,
    /// Robots that have found what is not so.
    distrusted: BTreeSet<u16>,
    /// Robots that would solve and have taken in nothing for too long.
    passed_over: BTreeSet<u16>,
    refused: BTreeMap<(Refusal, Option<u16>), u64>,
    early: u64,
    outbox: Vec<Outgoing>,
    beats: u64,
    /// What goes with each beat.
    note: Vec<u8>,
    last_beat: Option<Stamp>,
    begun: Option<Stamp>,
}

impl Node {
    /// The node of a robot of the team, which was switched on for the `session`th time; none where it is not in the roster or the secret is
    /// not its own.
    #[must_use]
    pub fn new(settings: NodeSettings, roster: Roster, name: &str, secret: Secret, session: u32) -> Option<Self> {
        let me = ChainId { rank: roster.rank(name)?, session };
        let probe = secret.sign(b"mapwright fleet probe\n");
        roster.has_signed(me.rank, b"mapwright fleet probe\n", &probe).then_some(())?;
        let peers = vec![Peer::default(); roster.members().len()];
        Some(Self {
            settings,
            roster,
            me,
            secret,
            chains: BTreeMap::from([(me, Chain::default())]),
            peers,
            asked: BTreeMap::new(),
            equivocators: BTreeMap::new(),
            distrusted: BTreeSet::new(),
            passed_over: BTreeSet::new(),
            refused: BTreeMap::new(),
            early: 0,
            outbox: Vec::new(),
            beats: 0,
            note: Vec::new(),
            last_beat: None,
            begun: None,
        })
    }

    /// Which chain is its own.
    #[must_use]
    pub fn me(&self) -> ChainId {
        self.me
    }

    /// The robots of the team.
    #[must_use]
    pub fn roster(&self) -> &Roster {
        &self.roster
    }

    /// All chains that it holds.
    #[must_use]
    pub fn chains(&self) -> &BTreeMap<ChainId, Chain> {
        &self.chains
    }

    /// What was not used: why, of whom where that is known, how often.
    pub fn refused(&self) -> impl Iterator<Item = (Refusal, Option<&str>, u64)> {
        self.refused.iter().map(|(&(why, of), &times)| (why, of.and_then(|rank| self.roster.name(rank)), times))
    }

    /// Messages with records before which some are missing: these are asked for, and what came too early is dropped.
    #[must_use]
    pub fn early(&self) -> u64 {
        self.early
    }

    /// Robots that have told different robots different things, with the proof.
    pub fn equivocators(&self) -> impl Iterator<Item = (u16, &Equivocation)> {
        self.equivocators.iter().map(|(rank, proof)| (*rank, proof))
    }

    /// Whether the robot is taken to be alive and within reach.
    #[must_use]
    pub fn is_alive(&self, rank: u16, now: Stamp) -> bool {
        let is_heard = |peer: &Peer| peer.heard.is_some_and(|heard| now.secs_since(heard) <= self.lease_s(peer));
        rank == self.me.rank || self.peers.get(usize::from(rank)).is_some_and(is_heard)
    }

    /// How long it may be silent: losses alone bring about a longer silence once in a hundred times.
    fn lease_s(&self, peer: &Peer) -> f64 {
        let lost_share = peer.lost / (1.0 + peer.lost);
        let beats = if lost_share > 0.0 { SILENT_BY_CHANCE.ln() / lost_share.ln() } else { 0.0 };
        self.settings.lease_s.max(beats * self.settings.beat_s)
    }

    /// Whether what a robot finds as the one that solves is used.
    #[must_use]
    pub fn is_trusted(&self, rank: u16) -> bool {
        !self.equivocators.contains_key(&rank) && !self.distrusted.contains(&rank)
    }

    /// What it has found is not so.
    pub(crate) fn distrust(&mut self, rank: u16) {
        self.refuse(Refusal::Untrue, Some(rank));
        self.distrusted.insert(rank);
    }

    /// What it has found is so after all.
    pub(crate) fn trust(&mut self, rank: u16) {
        self.distrusted.remove(&rank);
    }

    /// It would solve and takes in nothing: the next one is to.
    pub(crate) fn pass_over(&mut self, rank: u16) {
        self.passed_over.insert(rank);
    }

    /// It solves.
    pub(crate) fn lead_again(&mut self, rank: u16) {
        self.passed_over.remove(&rank);
    }

    /// When a robot was heard last, and of each chain the number of the record after those that it held then; none where it never was.
    #[must_use]
    pub fn heard(&self, rank: u16) -> Option<(Stamp, &BTreeMap<ChainId, u32>)> {
        let peer = self.peers.get(usize::from(rank))?;
        Some((peer.heard?, &peer.holds))
    }

    /// What goes with each beat from now on.
    pub(crate) fn set_note(&mut self, note: Vec<u8>) {
        self.note = note;
    }

    /// What came with the last beats of the others that are alive, and when.
    pub(crate) fn notes(&self, now: Stamp) -> impl Iterator<Item = (u16, Stamp, &[u8])> {
        let others = self.peers.iter().enumerate().map(|(rank, peer)| (rank as u16, peer));
        let alive = others.filter(move |(rank, _)| *rank != self.me.rank && self.is_alive(*rank, now));
        alive.filter_map(|(rank, peer)| Some((rank, peer.heard?, peer.note.as_slice())))
    }

    /// Who solves: of those alive the first in the roster that does something. None until one lease has passed since this robot was switched on, for it has not
    /// heard of others yet.
    #[must_use]
    pub fn leader(&self, now: Stamp) -> Option<u16> {
        let begun = self.begun?;
        let trusted = |rank: &u16| self.is_trusted(*rank) && !self.passed_over.contains(rank);
        let first = (0..self.peers.len() as u16).filter(trusted).find(|rank| self.is_alive(*rank, now))?;
        (first != self.me.rank || now.secs_since(begun) >= self.settings.lease_s).then_some(first)
    }

    /// Says something for good. False where it is more than a record or a robot may say.
    pub fn publish(&mut self, kind: Kind, payload: Vec<u8>) -> bool {
        let (me, bytes) = (self.me, payload.len());
        let chain = self.chains.entry(me).or_default();
        if bytes > PAYLOAD_AT_MOST || chain.bytes() + bytes > self.settings.bytes_at_most {
            return false;
        }
        let seq = chain.next();
        let previous = chain.previous(seq);
        let record = Record::sign(&self.secret, me, seq, &previous, kind, payload);
        let head = record.head(me, seq, &previous);
        chain.push(&head, record.clone());
        self.send(None, &Message::Records { chain: me, first: seq, records: vec![record] });
        true
    }

    /// Takes in bytes that came from anywhere.
    pub fn receive(&mut self, now: Stamp, bytes: &[u8]) {
        self.begun.get_or_insert(now);
        let of = match Message::decode(bytes) {
            Ok(Message::Beat(beat)) => self.hear(now, beat, bytes),
            Ok(Message::Ask { from, to, chain, first, count }) => self.answer(from, to, chain, first, count),
            Ok(Message::Records { chain, first, records }) => self.take_in(chain, first, records),
            Ok(Message::Equivocation(proof)) => self.convict(*proof),
            Err(why) => Err((why, None)),
        };
        if let Err((why, of)) = of {
            self.refuse(why, of);
        }
    }

    /// What is to be sent now; asked often, some ten times a second.
    pub fn poll(&mut self, now: Stamp) -> Vec<Outgoing> {
        self.begun.get_or_insert(now);
        if self.last_beat.is_none_or(|last| now.secs_since(last) >= self.settings.beat_s) {
            self.last_beat = Some(now);
            self.beats += 1;
            let holds = self.chains.iter().map(|(chain, known)| (*chain, known.next())).take(CHAINS_AT_MOST).collect();
            let beat = Beat::sign(&self.secret, self.me, self.beats, holds, self.note.clone());
            self.send(None, &Message::Beat(beat));
        }
        self.ask(now);
        std::mem::take(&mut self.outbox)
    }

    /// Says that a payload of a chain cannot be used; it is counted.
    pub(crate) fn refuse(&mut self, why: Refusal, of: Option<u16>) {
        *self.refused.entry((why, of)).or_default() += 1;
    }

    fn send(&mut self, to: Option<u16>, message: &Message) {
        self.outbox.push(Outgoing { to, bytes: message.encode() });
    }

    fn known(&self, rank: u16) -> Result<(), (Refusal, Option<u16>)> {
        if usize::from(rank) < self.peers.len() { Ok(()) } else { Err((Refusal::Unknown, None)) }
    }

    /// A beat: passed on once, so that it reaches those who do not hear its robot.
    fn hear(&mut self, now: Stamp, beat: Beat, bytes: &[u8]) -> Result<(), (Refusal, Option<u16>)> {
        let rank = beat.from.rank;
        self.known(rank)?;
        if rank == self.me.rank {
            // Its own, passed on by others; of a later session somebody else has its key.
            return if beat.from.session <= self.me.session { Ok(()) } else { Err((Refusal::OwnName, None)) };
        }
        let peer = &self.peers[usize::from(rank)];
        if peer.heard.is_some() && (beat.from.session, beat.number) <= (peer.session, peer.number) {
            // The same one over several ways, or one that was overtaken on them, is no fault.
            let is_overtaken = beat.from.session == peer.session && peer.number - beat.number <= BEATS_LATE;
            return if is_overtaken { Ok(()) } else { Err((Refusal::Replayed, Some(rank))) };
        }
        if !self.roster.has_signed(rank, &beat.signed(), &beat.signature) {
            return Err((Refusal::Forged, Some(rank)));
        }
        let holds = beat.holds.into_iter().filter(|(chain, _)| usize::from(chain.rank) < self.peers.len()).collect();
        let before = &self.peers[usize::from(rank)];
        let is_next = before.session == beat.from.session && self.is_alive(rank, now);
        let missed = beat.number.saturating_sub(before.number).saturating_sub(1) as f64;
        let lost = if is_next { before.lost + (missed - before.lost) / BEATS_REMEMBERED } else { before.lost };
        self.peers[usize::from(rank)] =
            Peer { session: beat.from.session, number: beat.number, heard: Some(now), lost, holds, note: beat.note };
        self.outbox.push(Outgoing { to: None, bytes: bytes.to_vec() });
        Ok(())
    }

    fn answer(
        &mut self,
        from: u16,
        to: u16,
        chain: ChainId,
        first: u32,
        count: u32,
    ) -> Result<(), (Refusal, Option<u16>)> {
        self.known(from)?;
        let Some(known) = self.chains.get(&chain).filter(|_| to == self.me.rank) else { return Ok(()) };
        let mut left = MESSAGE_AT_MOST - 64;
        let mut records = Vec::new();
        let asked = known.records().iter().skip(first as usize).take((count as usize).min(RECORDS_AT_MOST));
        for record in asked {
            let Some(after) = left.checked_sub(record.wire_bytes()) else { break };
            left = after;
            records.push(record.clone());
        }
        if !records.is_empty() {
            self.send(Some(from), &Message::Records { chain, first, records });
        }
        Ok(())
    }

    fn take_in(&mut self, chain: ChainId, first: u32, records: Vec<Record>) -> Result<(), (Refusal, Option<u16>)> {
        self.known(chain.rank)?;
        if self.equivocators.contains_key(&chain.rank) {
            return Err((Refusal::Equivocator, Some(chain.rank)));
        }
        let sessions = || self.chains.keys().filter(|known| known.rank == chain.rank).count();
        if !self.chains.contains_key(&chain) && sessions() >= SESSIONS_AT_MOST {
            return Err((Refusal::TooMuch, Some(chain.rank)));
        }
        let (roster, at_most) = (&self.roster, self.settings.bytes_at_most);
        let said = |chains: &BTreeMap<ChainId, Chain>| -> usize {
            let of_robot = chains.iter().filter(|(id, _)| id.rank == chain.rank);
            of_robot.map(|(_, known)| known.bytes()).sum()
        };
        let (mut left, is_own) = (at_most.saturating_sub(said(&self.chains)), chain == self.me);
        for (record, seq) in records.into_iter().zip(first..) {
            let known = self.chains.get(&chain).map_or(0, Chain::next);
            if seq >= known {
                if is_own {
                    return Err((Refusal::OwnName, None));
                }
                let Some(after) = left.checked_sub(record.message_bytes()) else {
                    return Err((Refusal::TooMuch, Some(chain.rank)));
                };
                left = after;
            }
            let mut fresh = Chain::default();
            let holder = self.chains.get_mut(&chain);
            let is_new = holder.is_none();
            let added = holder.unwrap_or(&mut fresh).add(roster, chain, seq, record);
            if is_new && added == Added::New {
                self.chains.insert(chain, fresh);
            }
            match added {
                Added::New | Added::Known => {}
                Added::Gap => {
                    self.early += 1;
                    return Ok(());
                }
                Added::Forged => return Err((Refusal::Forged, Some(chain.rank))),
                Added::Equivocates(proof) => return self.convict(*proof),
            }
        }
        if let Some(asked) = self.asked.get(&chain)
            && self.chains.get(&chain).is_some_and(|known| known.next() > asked.first)
        {
            self.asked.remove(&chain);
        }
        Ok(())
    }

    /// What a robot that contradicts itself has said stays; nothing more of it is believed.
    fn convict(&mut self, proof: Equivocation) -> Result<(), (Refusal, Option<u16>)> {
        let rank = proof.chain.rank;
        self.known(rank)?;
        if self.equivocators.contains_key(&rank) {
            return Ok(());
        }
        if !proof.holds(&self.roster) {
            return Err((Refusal::Forged, Some(rank)));
        }
        self.equivocators.insert(rank, proof.clone());
        self.send(None, &Message::Equivocation(Box::new(proof)));
        Err((Refusal::Equivocator, Some(rank)))
    }

    /// Asks for what others hold and this robot does not: of a chain one range at a time, twice as often where no answer came, and sooner. Who
    /// have it are asked in turn; where they are fewer, a question goes to one of them several times, for it is short beside its answer.
    fn ask(&mut self, now: Stamp) {
        let mut wanted: BTreeMap<ChainId, u32> = BTreeMap::new();
        for (rank, peer) in self.peers.iter().enumerate() {
            if self.is_alive(rank as u16, now) {
                for (&chain, &next) in &peer.holds {
                    let most = wanted.entry(chain).or_default();
                    *most = next.max(*most);
                }
            }
        }
        for (chain, most) in wanted {
            let first = self.chains.get(&chain).map_or(0, Chain::next);
            if first >= most || chain == self.me || self.equivocators.contains_key(&chain.rank) {
                continue;
            }
            let before = self.asked.get(&chain).copied();
            let wait_s = |asked: &Asked| self.settings.ask_again_s / f64::from(1 + asked.tries.min(1));
            if before.is_some_and(|asked| now.secs_since(asked.at) < wait_s(&asked)) {
                continue;
            }
            let tries = before.filter(|asked| asked.first == first).map_or(0, |asked| asked.tries + 1);
            let has = |rank: &u16| {
                let peer = &self.peers[usize::from(*rank)];
                *rank != self.me.rank
                    && self.is_alive(*rank, now)
                    && peer.holds.get(&chain).is_some_and(|next| *next > first)
            };
            let last = before.map_or(chain.rank, |asked| asked.of + 1);
            let count = self.peers.len() as u16;
            let holders: Vec<u16> = (0..count).map(|k| (last + k) % count).filter(has).collect();
            let times = ASKED_AT_MOST.min(1 << tries.min(8));
            let Some(&of) = holders.get(..times).unwrap_or(&holders).last() else { continue };
            self.asked.insert(chain, Asked { first, of, at: now, tries });
            for &to in holders.iter().cycle().take(times) {
                let ask = Message::Ask { from: self.me.rank, to, chain, first, count: RECORDS_AT_MOST as u32 };
                self.send(Some(to), &ask);
            }
        }
    }
}
