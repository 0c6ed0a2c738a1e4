//! A participant without sockets: packets and time in, packets and requests out.

use crate::ids::{ANY, EntityId, Guid, Prefix};
use crate::message::{Fragment, Message, Outgoing, Sample, Submessage};
use crate::packets::{Packets, To};
use crate::parameters::{Parameters, Participant as Told, our_end, our_endpoint, our_participant, related};
use crate::source::Source;
use crate::writer::Writer;
use std::collections::{BTreeMap, VecDeque};
use std::net::SocketAddrV4;
use std::time::Duration;

/// Readers and writers by which participants find each other (9.3.1.3).
const PARTICIPANTS: [EntityId; 2] = [[0, 1, 0, 0xc7], [0, 1, 0, 0xc2]];
const WRITERS: [EntityId; 2] = [[0, 0, 3, 0xc7], [0, 0, 3, 0xc2]];
const READERS: [EntityId; 2] = [[0, 0, 4, 0xc7], [0, 0, 4, 0xc2]];
/// Kinds of readers and writers of samples without a key.
const READER: u8 = 0x04;
const WRITER: u8 = 0x03;

/// We tell of ourselves at once, soon again, and then so often.
const TELL_EARLY: [Duration; 4] =
    [Duration::ZERO, Duration::from_millis(100), Duration::from_millis(300), Duration::from_secs(1)];
const TELL_EVERY: Duration = Duration::from_secs(3);
/// Participants that are known, and clients of one service; who comes beyond is not heard.
const PEERS_MOST: usize = 1000;
const CLIENTS_MOST: usize = 1000;
/// What arrives of clients that are not known yet is kept so long, and so much of it.
const KEPT: Duration = Duration::from_secs(3);
const KEPT_MOST: usize = 64;
/// A longer request is not read, bytes; and so many are put together of fragments at a time.
const REQUEST_MOST: usize = 1 << 20;
const ASSEMBLED_MOST: usize = 16;
/// Requests that wait for their response; those beyond are left to be sent again.
const ASKED_MOST: usize = 256;
/// A response waits so long for a reader that is not known yet.
const READER_WITHIN: Duration = Duration::from_secs(2);

/// A request, and what its response needs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Request {
    pub(crate) service: usize,
    /// The participant that asks.
    pub(crate) client: Prefix,
    /// Which request of whom the response says it belongs to.
    related: (Guid, i64),
    pub(crate) bytes: Vec<u8>,
}

/// Topics and types of a service's requests and responses, as DDS has them.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ServiceNames {
    /// Topic of the requests and their type.
    pub requests: [String; 2],
    /// Topic of the responses and their type.
    pub responses: [String; 2],
}

/// Another participant.
#[derive(Debug)]
struct Peer {
    told: Told,
    heard: Duration,
    /// Its writers that tell of its writers and of its readers.
    sources: [Source; 2],
}

#[derive(Debug)]
struct Service {
    names: ServiceNames,
    reader: EntityId,
    clients: BTreeMap<Guid, Source>,
    responses: Writer,
    /// Responses whose readers are not known yet, and until when they wait.
    waiting: VecDeque<(Prefix, Sample, Duration)>,
}

/// A request of a writer that is not known yet.
#[derive(Debug)]
struct Early {
    writer: Guid,
    number: i64,
    related: Option<(Guid, i64)>,
    bytes: Vec<u8>,
    until: Duration,
}

/// A request of which parts have come.
#[derive(Debug)]
struct Assembly {
    bytes: Vec<u8>,
    size: usize,
    has: Vec<bool>,
    related: Option<(Guid, i64)>,
}

#[derive(Debug)]
pub(crate) struct Participant {
    prefix: Prefix,
    domain: u16,
    user_data: String,
    /// Where we hear.
    locators: Vec<SocketAddrV4>,
    /// Where we tell of ourselves, besides to all.
    known_places: Vec<SocketAddrV4>,
    told: usize,
    tell_at: Duration,
    peers: BTreeMap<Prefix, Peer>,
    /// What we tell of our writers and of our readers.
    ours: [Writer; 2],
    services: Vec<Service>,
    early: VecDeque<Early>,
    assemblies: VecDeque<((Guid, i64), Assembly)>,
    pub(crate) out: Packets,
    pub(crate) requests: VecDeque<Request>,
    /// Requests that have no response yet.
    asked: usize,
}

impl Participant {
    pub(crate) fn new(prefix: Prefix, domain: u16, user_data: &str) -> Self {
        let builtin = |[reader, writer]: [EntityId; 2]| Writer::builtin(Guid { prefix, entity: writer }, reader);
        Self {
            prefix,
            domain,
            user_data: user_data.to_owned(),
            locators: Vec::new(),
            known_places: Vec::new(),
            told: 0,
            tell_at: Duration::ZERO,
            peers: BTreeMap::new(),
            ours: [builtin(WRITERS), builtin(READERS)],
            services: Vec::new(),
            early: VecDeque::new(),
            assemblies: VecDeque::new(),
            out: Packets::default(),
            requests: VecDeque::new(),
            asked: 0,
        }
    }

    /// Where we hear, and where else we tell of ourselves; who knows us is told at once.
    pub(crate) fn found_at(&mut self, locators: Vec<SocketAddrV4>, known_places: Vec<SocketAddrV4>, now: Duration) {
        self.known_places = known_places;
        if self.locators != locators {
            self.locators = locators;
            (self.told, self.tell_at) = (0, now);
        }
    }

    fn guid(&self, entity: EntityId) -> Guid {
        Guid { prefix: self.prefix, entity }
    }

    /// Answers a service from now on; the numbers of its reader and its writer come back. None where there are too many.
    pub(crate) fn serve(&mut self, names: ServiceNames, now: Duration) -> Option<[Guid; 2]> {
        let number = u16::try_from(self.services.len() + 1).ok()?.to_be_bytes();
        let [reader, writer] = [READER, WRITER].map(|kind| [0, number[0], number[1], kind]);
        let guids = [self.guid(reader), self.guid(writer)];
        let told = |guid, [topic, kind]: &[String; 2]| Sample {
            inline: Vec::new(),
            payload: our_endpoint(guid, topic, kind),
            is_key: false,
        };
        let (writer, reader_told) = (told(guids[1], &names.responses), told(guids[0], &names.requests));
        self.ours[0].write(writer, None, now, &mut self.out);
        self.ours[1].write(reader_told, None, now, &mut self.out);
        let responses = Writer::new(guids[1]);
        let (clients, waiting) = (BTreeMap::new(), VecDeque::new());
        self.services.push(Service { names, reader, clients, responses, waiting });
        // Whoever was there before told of clients of this service when there was none: they tell it again.
        for peer in self.peers.values_mut() {
            let [writers, readers] = &peer.sources;
            let again = [(writers, WRITERS), (readers, READERS)].map(|(source, [reader, writer])| {
                Source::new(Guid { prefix: peer.told.prefix, entity: writer }, reader, source.to.clone(), now)
            });
            peer.sources = again;
        }
        Some(guids)
    }

    /// A packet has come.
    pub(crate) fn receive(&mut self, packet: &[u8], from: SocketAddrV4, now: Duration) {
        let Some(message) = Message::read(packet) else { return };
        let mut source = message.source;
        let mut is_for_us = true;
        for submessage in message {
            match submessage {
                Submessage::Source(prefix) => source = prefix,
                Submessage::Destination(prefix) => is_for_us = prefix == self.prefix || prefix == [0; 12],
                _ if source == self.prefix || !is_for_us => {}
                _ => self.hear(source, submessage, from, now),
            }
        }
    }

    fn hear(&mut self, source: Prefix, submessage: Submessage<'_>, from: SocketAddrV4, now: Duration) {
        if let Some(peer) = self.peers.get_mut(&source) {
            peer.heard = now;
        }
        let guid = |entity| Guid { prefix: source, entity };
        match submessage {
            Submessage::Data { writer, inline, payload, .. } if writer == PARTICIPANTS[1] => {
                self.participant(source, inline, payload, from, now);
            }
            Submessage::Data { writer, number, inline, payload, .. } if [WRITERS[1], READERS[1]].contains(&writer) => {
                let is_reader = writer == READERS[1];
                let Some(peer) = self.peers.get_mut(&source) else { return };
                if peer.sources[usize::from(is_reader)].take(number) {
                    self.endpoint(source, is_reader, inline, payload, now);
                }
            }
            Submessage::Data { writer, number, inline, payload: Some(payload) } if payload.len() <= REQUEST_MOST => {
                self.request(guid(writer), number, inline.related(), payload, now);
            }
            Submessage::Fragment { writer, number, inline, fragment, .. } => {
                self.fragment(guid(writer), number, inline.related(), fragment, now);
            }
            Submessage::Heartbeat { writer, first, last, is_final, .. } => {
                let ours = self.guid(ANY);
                if let Some((source, out)) = self.source(guid(writer)) {
                    source.heartbeat([first, last], is_final, ours, out);
                }
            }
            Submessage::Gap { writer, first, set, .. } => {
                if let Some((source, _)) = self.source(guid(writer)) {
                    source.gap(first, set);
                }
            }
            Submessage::AckNack { reader, writer, missing, is_final } => {
                if let Some((writer, out)) = self.writer(writer) {
                    writer.acknack(guid(reader), missing, is_final, now, out);
                }
            }
            Submessage::NackFragments { reader, writer, number, missing } => {
                if let Some((writer, out)) = self.writer(writer) {
                    writer.nack_fragments(guid(reader), number, missing, now, out);
                }
            }
            _ => {}
        }
    }

    fn source(&mut self, writer: Guid) -> Option<(&mut Source, &mut Packets)> {
        let builtin = [WRITERS[1], READERS[1]].iter().position(|entity| *entity == writer.entity);
        let source = match builtin {
            Some(which) => self.peers.get_mut(&writer.prefix).map(|peer| &mut peer.sources[which]),
            None => self.services.iter_mut().find_map(|service| service.clients.get_mut(&writer)),
        };
        Some((source?, &mut self.out))
    }

    fn writer(&mut self, entity: EntityId) -> Option<(&mut Writer, &mut Packets)> {
        let ours = self.ours.iter_mut().chain(self.services.iter_mut().map(|service| &mut service.responses));
        let writer = ours.into_iter().find(|writer| writer.guid().entity == entity)?;
        Some((writer, &mut self.out))
    }

    /// Another participant tells of itself, or that it goes.
    fn participant(
        &mut self,
        source: Prefix,
        inline: Parameters<'_>,
        payload: Option<&[u8]>,
        from: SocketAddrV4,
        now: Duration,
    ) {
        let list = payload.and_then(Parameters::of_payload);
        if inline.is_over() {
            let about = list.and_then(Parameters::about).or_else(|| inline.key());
            // Nobody speaks for others.
            if about.is_none_or(|about| about.prefix == source) {
                self.peer_is_gone(source);
            }
            return;
        }
        let Some(mut told) = list.and_then(Parameters::participant).filter(|told| told.prefix == source) else {
            return;
        };
        if let Some(peer) = self.peers.get(&source) {
            let is_there = |(now, then): (&[SocketAddrV4], &[SocketAddrV4])| then.iter().all(|to| now.contains(to));
            let places = [(&*told.metatraffic, &*peer.told.metatraffic), (&*told.default, &*peer.told.default)];
            if places.into_iter().all(is_there) {
                return self.tell_again(source, now);
            }
            // It hears elsewhere: everything about it is said again.
            self.peer_is_gone(source);
        }
        (told.metatraffic, told.default) = (nearest(told.metatraffic, from), nearest(told.default, from));
        if told.metatraffic.is_empty() || told.default.is_empty() {
            return;
        }
        if self.peers.len() >= PEERS_MOST {
            return;
        }
        let to = told.metatraffic.clone();
        let sources = [WRITERS, READERS]
            .map(|[reader, writer]| Source::new(Guid { prefix: source, entity: writer }, reader, to.clone(), now));
        self.peers.insert(source, Peer { told, heard: now, sources });
        // It knows us at once, not when all are told next.
        let ourselves = self.ourselves();
        self.out.send(&to, self.prefix, source, |message| message.data(PARTICIPANTS, 1, &ourselves));
        for (ours, [reader, _]) in self.ours.iter_mut().zip([WRITERS, READERS]) {
            ours.matched(Guid { prefix: source, entity: reader }, to.clone(), true, now, &mut self.out);
        }
    }

    /// Tells a participant of us that tells of itself and has not heard us yet: it may not have listened when it told the first time.
    fn tell_again(&mut self, peer: Prefix, now: Duration) {
        let mut is_heard = false;
        for (ours, [reader, _]) in self.ours.iter_mut().zip([WRITERS, READERS]) {
            is_heard |= ours.is_heard_by(Guid { prefix: peer, entity: reader }, now);
        }
        let Some(known) = self.peers.get(&peer).filter(|_| !is_heard) else { return };
        let (ourselves, to) = (self.ourselves(), known.told.metatraffic.clone());
        self.out.send(&to, self.prefix, peer, |message| message.data(PARTICIPANTS, 1, &ourselves));
    }

    fn peer_is_gone(&mut self, prefix: Prefix) {
        if self.peers.remove(&prefix).is_none() {
            return;
        }
        let is_gone = |guid: Guid| guid.prefix == prefix;
        self.ours.iter_mut().for_each(|writer| writer.gone(is_gone));
        for service in &mut self.services {
            service.responses.gone(is_gone);
            service.clients.retain(|guid, _| !is_gone(*guid));
            service.waiting.retain(|(to, ..)| *to != prefix);
        }
        self.early.retain(|early| !is_gone(early.writer));
        self.assemblies.retain(|((writer, _), _)| !is_gone(*writer));
    }

    /// Another participant tells of one of its readers or writers, or that it goes.
    fn endpoint(
        &mut self,
        source: Prefix,
        is_reader: bool,
        inline: Parameters<'_>,
        payload: Option<&[u8]>,
        now: Duration,
    ) {
        let list = payload.and_then(Parameters::of_payload);
        if inline.is_over() {
            let Some(gone) =
                list.and_then(Parameters::about).or_else(|| inline.key()).filter(|gone| gone.prefix == source)
            else {
                return;
            };
            for service in &mut self.services {
                service.clients.remove(&gone);
                service.responses.gone(|guid| guid == gone);
            }
            return;
        }
        let Some(told) = list.and_then(Parameters::endpoint).filter(|told| told.guid.prefix == source) else { return };
        let Some(peer) = self.peers.get(&source) else { return };
        let default = &peer.told.default;
        let theirs: Vec<SocketAddrV4> = told.locators.iter().filter(|to| default.contains(to)).copied().collect();
        // Those of its own, where they are not the participant's anyway.
        let to = match (theirs.is_empty(), told.locators.is_empty()) {
            (false, _) => theirs,
            (true, true) => default.clone(),
            (true, false) => told.locators.clone(),
        };
        for at in 0..self.services.len() {
            let Service { names, reader, clients, responses, .. } = &mut self.services[at];
            let [topic, kind] = if is_reader { &names.responses } else { &names.requests };
            if told.topic != topic || told.kind != kind {
                continue;
            }
            if is_reader {
                responses.matched(told.guid, to.clone(), told.is_reliable, now, &mut self.out);
                self.tell_waiting(at, source, now);
            } else if told.is_reliable && (clients.contains_key(&told.guid) || clients.len() < CLIENTS_MOST) {
                let reader = *reader;
                clients
                    .entry(told.guid)
                    .and_modify(|client| client.to.clone_from(&to))
                    .or_insert_with(|| Source::new(told.guid, reader, to.clone(), now));
                self.take_early(told.guid, now);
            }
        }
    }

    /// A whole request has come.
    fn request(&mut self, writer: Guid, number: i64, related: Option<(Guid, i64)>, bytes: &[u8], now: Duration) {
        let known = self
            .services
            .iter_mut()
            .enumerate()
            .find_map(|(at, service)| Some((at, service.clients.get_mut(&writer)?)));
        let Some((service, client)) = known else {
            self.early.retain(|early| early.until > now);
            if writer.entity[3] == WRITER && self.early.len() < KEPT_MOST && bytes.len() <= REQUEST_MOST / KEPT_MOST {
                self.early.push_back(Early { writer, number, related, bytes: bytes.to_vec(), until: now + KEPT });
            }
            return;
        };
        if self.asked < ASKED_MOST && client.take(number) {
            self.asked += 1;
            // Fast DDS says who wants the response, and leaves the number to the message's own.
            let (wants, asked) = related.unwrap_or((writer, number));
            let related = (wants, if asked < 1 { number } else { asked });
            self.requests.push_back(Request { service, client: writer.prefix, related, bytes: bytes.to_vec() });
        }
    }

    fn take_early(&mut self, writer: Guid, now: Duration) {
        let (ours, others): (VecDeque<Early>, VecDeque<Early>) =
            std::mem::take(&mut self.early).into_iter().partition(|early| early.writer == writer);
        self.early = others;
        for early in ours {
            self.request(early.writer, early.number, early.related, &early.bytes, now);
        }
    }

    /// A part of a request has come.
    fn fragment(&mut self, writer: Guid, number: i64, related: Option<(Guid, i64)>, part: Fragment<'_>, now: Duration) {
        let (size, whole) = (usize::from(part.size), part.whole as usize);
        let is_ours = self.services.iter().any(|service| service.clients.contains_key(&writer));
        if !is_ours || size == 0 || whole > REQUEST_MOST {
            return;
        }
        let key = (writer, number);
        if !self.assemblies.iter().any(|(of, _)| *of == key) {
            if self.assemblies.len() >= ASSEMBLED_MOST {
                self.assemblies.pop_front();
            }
            let (bytes, has) = (vec![0; whole], vec![false; whole.div_ceil(size)]);
            self.assemblies.push_back((key, Assembly { bytes, size, has, related }));
        }
        let Some(at) = self.assemblies.iter().position(|(of, _)| *of == key) else { return };
        let assembly = &mut self.assemblies[at].1;
        if assembly.size != size || assembly.bytes.len() != whole {
            return;
        }
        let first = (part.first as usize).saturating_sub(1);
        for (slot, bytes) in (first..).zip(part.bytes.chunks(size)) {
            let Some(room) = assembly.bytes.chunks_mut(size).nth(slot) else { break };
            // The last bytes of a packet may be there to fill it up.
            let Some(bytes) = bytes.get(..room.len()) else { break };
            room.copy_from_slice(bytes);
            assembly.has[slot] = true;
        }
        if assembly.has.iter().all(|has| *has)
            && let Some((_, done)) = self.assemblies.remove(at)
        {
            self.request(writer, number, done.related, &done.bytes, now);
        }
    }

    /// Answers a request; without a response it is only done with.
    pub(crate) fn respond(&mut self, request: &Request, response: Option<Vec<u8>>, now: Duration) {
        self.asked = self.asked.saturating_sub(1);
        let (Some(service), Some(payload)) = (self.services.get_mut(request.service), response) else { return };
        let sample = Sample { inline: related(request.related.0, request.related.1), payload, is_key: false };
        if service.responses.reaches(request.client) {
            service.responses.write(sample, Some(request.client), now, &mut self.out);
        } else if service.waiting.len() < KEPT_MOST {
            service.waiting.push_back((request.client, sample, now + READER_WITHIN));
        }
    }

    fn tell_waiting(&mut self, service: usize, client: Prefix, now: Duration) {
        let Service { waiting, responses, .. } = &mut self.services[service];
        for (to, sample, until) in std::mem::take(waiting) {
            if to == client {
                responses.write(sample, Some(to), now, &mut self.out);
            } else {
                waiting.push_back((to, sample, until));
            }
        }
    }

    fn ourselves(&self) -> Sample {
        let payload = our_participant(self.prefix, self.domain, &self.locators, &self.user_data);
        Sample { inline: Vec::new(), payload, is_key: false }
    }

    fn tell_all(&mut self, sample: &Sample, number: i64) {
        let mut message = Outgoing::new(self.prefix, None);
        message.data(PARTICIPANTS, number, sample);
        let bytes = message.bytes();
        let places = self.peers.values().flat_map(|peer| &peer.told.metatraffic).chain(&self.known_places);
        let places: Vec<To> = std::iter::once(To::All).chain(places.map(|to| To::One(*to))).collect();
        self.out.0.extend(places.into_iter().map(|to| (to, bytes.clone())));
    }

    /// Does what is due, and says when something is next.
    pub(crate) fn turn(&mut self, now: Duration) -> Duration {
        if now >= self.tell_at && !self.locators.is_empty() {
            let ourselves = self.ourselves();
            self.tell_all(&ourselves, 1);
            self.told += 1;
            self.tell_at = now + TELL_EARLY.get(self.told).map_or(TELL_EVERY, |at| *at - TELL_EARLY[self.told - 1]);
        }
        let silent: Vec<Prefix> = self
            .peers
            .iter()
            .filter(|(_, peer)| now.saturating_sub(peer.heard) > peer.told.lease)
            .map(|(prefix, _)| *prefix)
            .collect();
        silent.into_iter().for_each(|prefix| self.peer_is_gone(prefix));
        let ours = self.guid(ANY);
        let out = &mut self.out;
        let mut next = self.tell_at.max(now + Duration::from_millis(1));
        let mut sooner = |at: Option<Duration>| next = at.map_or(next, |at| next.min(at));
        for peer in self.peers.values_mut() {
            peer.sources.iter_mut().for_each(|source| sooner(source.turn(now, ours, out)));
        }
        self.ours.iter_mut().for_each(|writer| sooner(writer.turn(now, out)));
        for service in &mut self.services {
            service.waiting.retain(|(_, _, until)| *until > now);
            service.clients.values_mut().for_each(|source| sooner(source.turn(now, ours, out)));
            sooner(service.responses.turn(now, out));
        }
        next
    }

    #[cfg(test)]
    pub(crate) fn knows(&self, prefix: Prefix) -> bool {
        self.peers.contains_key(&prefix)
    }

    /// Tells all that we go.
    pub(crate) fn leave(&mut self) {
        let (inline, payload) = our_end(self.prefix);
        self.tell_all(&Sample { inline, payload, is_key: true }, 2);
    }
}

/// Of the addresses of a participant the one from which it was heard, where that is one of them: what goes to all arrives several times.
fn nearest(locators: Vec<SocketAddrV4>, from: SocketAddrV4) -> Vec<SocketAddrV4> {
    match locators.iter().find(|locator| locator.ip() == from.ip()) {
        Some(locator) => vec![*locator],
        None => locators,
    }
}
