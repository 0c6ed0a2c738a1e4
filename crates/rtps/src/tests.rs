//! A service and its clients, packet by packet, over a network that loses, doubles and turns around what it carries.

use crate::ids::{Guid, Prefix};
use crate::message::{Message, Missing, Outgoing, Sample, Submessage};
use crate::packets::{Packets, To};
use crate::parameters::{Parameters, our_endpoint, our_participant, related};
use crate::participant::{Participant, ServiceNames};
use crate::source::Source;
use crate::writer::Writer;
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::net::{Ipv4Addr, SocketAddrV4};
use std::time::Duration;

const US: SocketAddrV4 = SocketAddrV4::new(Ipv4Addr::new(10, 0, 0, 1), 7411);
const OURS: Prefix = [1; 12];

fn place(client: u8) -> SocketAddrV4 {
    SocketAddrV4::new(Ipv4Addr::new(10, 0, 0, client), 7411)
}

fn names() -> ServiceNames {
    let pair = |topic: &str, kind: &str| [topic.to_owned(), kind.to_owned()];
    ServiceNames {
        requests: pair("rq/askRequest", "a::Ask_Request_"),
        responses: pair("rr/askReply", "a::Ask_Response_"),
    }
}

fn participant() -> Participant {
    let mut participant = Participant::new(OURS, 0, "enclave=/;");
    participant.found_at(vec![US], Vec::new(), Duration::ZERO);
    participant.serve(names(), Duration::ZERO).unwrap();
    participant
}

/// A client as Fast DDS is one: it says who wants the response, and asks as soon as it knows the service.
struct Client {
    prefix: Prefix,
    place: SocketAddrV4,
    /// What it tells of its writers and readers, and its requests.
    told: [Writer; 2],
    requests: Writer,
    /// Where responses come from, once it is known.
    responses: Option<Source>,
    found: [Source; 2],
    parts: BTreeMap<i64, BTreeMap<u32, Vec<u8>>>,
    /// Of the response that comes in parts.
    fragments: u32,
    answers: Vec<(i64, Vec<u8>)>,
    out: Packets,
    told_at: Option<Duration>,
}

impl Client {
    fn new(number: u8) -> Self {
        let prefix = [number; 12];
        let guid = |entity| Guid { prefix, entity };
        let us = |entity| Guid { prefix: OURS, entity };
        let found = [[0, 0, 3, 0xc2], [0, 0, 4, 0xc2]]
            .map(|entity: [u8; 4]| Source::new(us(entity), [0, 0, entity[2], 0xc7], vec![US], Duration::ZERO));
        let told = [[0, 0, 3, 0xc2], [0, 0, 4, 0xc2]]
            .map(|entity: [u8; 4]| Writer::builtin(guid(entity), [0, 0, entity[2], 0xc7]));
        let mut client = Self {
            prefix,
            place: place(number),
            told,
            requests: Writer::new(guid([0, 0, 9, 3])),
            responses: None,
            found,
            parts: BTreeMap::new(),
            fragments: 0,
            answers: Vec::new(),
            out: Packets::default(),
            told_at: None,
        };
        for (at, (entity, [topic, kind])) in
            [([0, 0, 9, 3], names().requests), ([0, 0, 8, 4], names().responses)].into_iter().enumerate()
        {
            let payload = our_endpoint(guid(entity), &topic, &kind);
            let sample = Sample { inline: Vec::new(), payload, is_key: false };
            client.told[at].write(sample, None, Duration::ZERO, &mut client.out);
            let reader = Guid { prefix: OURS, entity: [0, 0, [3, 4][at], 0xc7] };
            client.told[at].matched(reader, vec![US], true, Duration::ZERO, &mut client.out);
        }
        client
    }

    /// Asks; the answer says the number back.
    fn ask(&mut self, bytes: Vec<u8>, now: Duration) {
        let wants = Guid { prefix: self.prefix, entity: [0, 0, 8, 4] };
        let sample = Sample { inline: related(wants, -1 << 32), payload: bytes, is_key: false };
        self.requests.write(sample, None, now, &mut self.out);
    }

    fn receive(&mut self, packet: &[u8], now: Duration) {
        let message = Message::read(packet).unwrap();
        assert_eq!(message.source, OURS);
        for submessage in message {
            match submessage {
                Submessage::Data { writer: [0, 1, 0, 0xc2], payload, .. } => {
                    let told = Parameters::of_payload(payload.unwrap()).unwrap().participant().unwrap();
                    assert_eq!((told.prefix, told.metatraffic), (OURS, vec![US]));
                }
                Submessage::Data { writer, number, payload, .. } if writer[3] == 0xc2 => {
                    let is_reader = writer[2] == 4;
                    if self.found[usize::from(is_reader)].take(number) {
                        let told = Parameters::of_payload(payload.unwrap()).unwrap();
                        let told = told.endpoint().unwrap();
                        if is_reader {
                            self.requests.matched(told.guid, vec![US], true, now, &mut self.out);
                        } else {
                            let source = Source::new(told.guid, [0, 0, 8, 4], vec![US], now);
                            self.responses.get_or_insert(source);
                        }
                    }
                }
                Submessage::Data { number, inline, payload, .. } => {
                    let Some(source) = &mut self.responses else { continue };
                    if source.take(number) {
                        let (wants, request) = inline.related().unwrap();
                        assert_eq!(wants.prefix, self.prefix, "others' responses do not come here");
                        self.answers.push((request, payload.unwrap().to_vec()));
                    }
                }
                Submessage::Fragment { number, inline, fragment, .. } => {
                    let Some(source) = &mut self.responses else { continue };
                    let parts = self.parts.entry(number).or_default();
                    parts.insert(fragment.first, fragment.bytes.to_vec());
                    self.fragments = fragment.whole.div_ceil(u32::from(fragment.size));
                    if parts.len() == self.fragments as usize {
                        let mut whole: Vec<u8> = parts.values().flatten().copied().collect();
                        whole.truncate(fragment.whole as usize);
                        self.parts.remove(&number);
                        if source.take(number) {
                            self.answers.push((inline.related().unwrap().1, whole));
                        }
                    }
                }
                Submessage::Heartbeat { writer, first, last, is_final } => {
                    let from = Guid { prefix: self.prefix, entity: [0; 4] };
                    let source = match writer[3] {
                        0xc2 => Some(&mut self.found[usize::from(writer[2] == 4)]),
                        _ => self.responses.as_mut(),
                    };
                    // Of what has come in part the rest is asked for, as Fast DDS does.
                    let begun = self.parts.iter().find(|(number, _)| (first..=last).contains(number));
                    if writer[3] != 0xc2
                        && let Some((number, parts)) = begun
                    {
                        let fragments = i64::from(self.fragments);
                        let base = (1..=fragments).find(|part| !parts.contains_key(&(*part as u32))).unwrap();
                        let lacks = (base..=fragments).filter(|part| !parts.contains_key(&(*part as u32)));
                        let missing = Missing::of(base, lacks);
                        self.out.send(&[US], self.prefix, OURS, |message| {
                            message.nack_fragments([[0, 0, 8, 4], writer], *number, missing);
                        });
                    } else if let Some(source) = source {
                        source.heartbeat([first, last], is_final, from, &mut self.out);
                    }
                }
                Submessage::Gap { first, set, .. } => {
                    if let Some(source) = &mut self.responses {
                        source.gap(first, set);
                    }
                }
                Submessage::AckNack { reader, writer, missing, is_final } => {
                    let guid = Guid { prefix: OURS, entity: reader };
                    let writer = match writer[3] {
                        0xc2 => &mut self.told[usize::from(writer[2] == 4)],
                        _ => &mut self.requests,
                    };
                    writer.acknack(guid, missing, is_final, now, &mut self.out);
                }
                Submessage::NackFragments { reader, number, missing, .. } => {
                    let guid = Guid { prefix: OURS, entity: reader };
                    self.requests.nack_fragments(guid, number, missing, now, &mut self.out);
                }
                Submessage::Destination(to) => assert!(to == self.prefix),
                Submessage::Source(_) => unreachable!(),
            }
        }
    }

    fn turn(&mut self, now: Duration) {
        if self.told_at.is_none_or(|at| now >= at + Duration::from_millis(500)) {
            self.told_at = Some(now);
            let payload = our_participant(self.prefix, 0, &[self.place], "enclave=/;");
            let mut message = Outgoing::new(self.prefix, None);
            message.data([[0, 1, 0, 0xc7], [0, 1, 0, 0xc2]], 1, &Sample { inline: Vec::new(), payload, is_key: false });
            self.out.0.push((To::All, message.bytes()));
        }
        let from = Guid { prefix: self.prefix, entity: [0; 4] };
        for source in self.found.iter_mut().chain(&mut self.responses) {
            source.turn(now, from, &mut self.out);
        }
        for writer in self.told.iter_mut().chain([&mut self.requests]) {
            writer.turn(now, &mut self.out);
        }
    }
}

/// Random numbers, the same each time.
struct Dice(u64);

impl Dice {
    fn below(&mut self, most: u64) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0 % most
    }
}

/// Carries packets for a time, a millisecond at a time; of a hundred so many are lost, and so many are late. A service repeats what it is asked `times` times.
fn carry(
    ours: &mut Participant,
    clients: &mut [Client],
    [from, to]: [u64; 2],
    [lost, late]: [u64; 2],
    times: usize,
    seed: u64,
) -> usize {
    let mut dice = Dice(seed);
    let mut waiting: Vec<(u64, To, Option<usize>, Vec<u8>)> = Vec::new();
    let mut carried = 0;
    for at in from..to {
        let now = Duration::from_millis(at);
        ours.turn(now);
        clients.iter_mut().for_each(|client| client.turn(now));
        while let Some(request) = ours.requests.pop_front() {
            let response = request.bytes.iter().copied().cycle().take(request.bytes.len() * times).collect();
            ours.respond(&request, Some(response), now);
        }
        let sent = clients.iter_mut().enumerate().flat_map(|(which, client)| {
            std::mem::take(&mut client.out.0).into_iter().map(move |(to, bytes)| (to, Some(which), bytes))
        });
        let sent: Vec<_> =
            sent.chain(std::mem::take(&mut ours.out.0).into_iter().map(|(to, bytes)| (to, None, bytes))).collect();
        for (to, which, bytes) in sent {
            if dice.below(100) >= lost {
                let delay = if dice.below(100) < late { 1 + dice.below(30) } else { 0 };
                waiting.push((at + delay, to, which, bytes));
            }
        }
        let (due, later): (Vec<_>, Vec<_>) = waiting.into_iter().partition(|(due, ..)| *due <= at);
        waiting = later;
        for (_, to, which, bytes) in due {
            carried += bytes.len();
            if let Some(which) = which {
                assert!(to == To::All || to == To::One(US));
                ours.receive(&bytes, clients[which].place, now);
            } else {
                let reached = |client: &&mut Client| to == To::All || to == To::One(client.place);
                clients.iter_mut().filter(reached).for_each(|client| client.receive(&bytes, now));
            }
        }
    }
    carried
}

#[test]
fn a_client_is_answered_as_soon_as_it_knows_the_service() {
    let (mut ours, mut client) = (participant(), Client::new(2));
    let clients = std::slice::from_mut(&mut client);
    clients[0].ask(b"one.".to_vec(), Duration::ZERO);
    carry(&mut ours, clients, [0, 20], [0, 0], 1, 7);
    // What is asked before the service is known goes to nobody, as with any volatile writer.
    assert_eq!(clients[0].answers, []);
    clients[0].ask(b"two.".to_vec(), Duration::from_millis(20));
    carry(&mut ours, clients, [20, 25], [0, 0], 1, 7);
    assert_eq!(clients[0].answers, [(2, b"two.".to_vec())]);
}

#[test]
fn a_request_that_comes_before_its_writer_is_known_is_answered() {
    let (mut ours, mut client) = (participant(), Client::new(2));
    let clients = std::slice::from_mut(&mut client);
    // What tells of the client's writers and readers is held up.
    let nothing = [[0, 0, 3, 0xc2], [0, 0, 4, 0xc2]]
        .map(|entity: [u8; 4]| Writer::builtin(Guid { prefix: [2; 12], entity }, [0, 0, entity[2], 0xc7]));
    let held = std::mem::replace(&mut clients[0].told, nothing);
    let sent = std::mem::take(&mut clients[0].out.0);
    carry(&mut ours, clients, [0, 20], [0, 0], 1, 7);
    clients[0].ask(b"ask.".to_vec(), Duration::from_millis(20));
    carry(&mut ours, clients, [20, 60], [0, 0], 1, 7);
    assert_eq!(clients[0].answers, []);
    clients[0].told = held;
    clients[0].out.0.extend(sent);
    carry(&mut ours, clients, [60, 200], [0, 0], 1, 7);
    assert_eq!(clients[0].answers, [(1, b"ask.".to_vec())]);
}

#[test]
fn clients_get_their_own_answers_over_a_bad_network_once() {
    for (seed, losses) in [(1, [0, 0]), (2, [5, 20]), (3, [30, 50]), (4, [50, 90])] {
        let mut ours = participant();
        let mut clients: Vec<Client> = (2..6).map(Client::new).collect();
        carry(&mut ours, &mut clients, [0, 10_000], losses, 1, seed);
        for asked in 0..20_u8 {
            for client in &mut clients {
                client.ask(vec![0, 1, 0, 0, asked, client.prefix[0], 0, 0], Duration::from_secs(10));
            }
        }
        carry(&mut ours, &mut clients, [10_000, 30_000], losses, 1, seed + 10);
        for client in &mut clients {
            client.answers.sort();
            let expected: Vec<(i64, Vec<u8>)> = (0..20_u8)
                .map(|asked| (i64::from(asked) + 1, vec![0, 1, 0, 0, asked, client.prefix[0], 0, 0]))
                .collect();
            assert_eq!(client.answers, expected, "seed {seed}");
        }
    }
}

#[test]
fn long_answers_arrive_in_fragments_over_a_bad_network() {
    for (seed, losses) in [(1, [0, 0]), (2, [10, 30])] {
        let mut ours = participant();
        let mut clients: Vec<Client> = (2..4).map(Client::new).collect();
        carry(&mut ours, &mut clients, [0, 1000], losses, 1, seed);
        let asked: Vec<u8> = (0..252).collect();
        clients[0].ask(asked.clone(), Duration::from_secs(1));
        let bytes = carry(&mut ours, &mut clients, [1000, 20_000], losses, 8000, seed);
        assert_eq!(clients[0].answers.len(), 1, "seed {seed}");
        assert!(clients[0].answers[0].1 == asked.repeat(8000));
        assert!(clients[1].answers.is_empty());
        let most = if losses == [0, 0] { 2_300_000 } else { 3_500_000 };
        assert!(bytes < most, "{bytes} bytes for 2 MB");
    }
}

/// It tells of itself before it listens, as Fast DDS does.
#[test]
fn a_client_that_did_not_hear_the_first_answer_is_told_again() {
    let (mut ours, mut client) = (participant(), Client::new(2));
    ours.turn(Duration::from_secs(5));
    client.turn(Duration::from_secs(5));
    for (_, packet) in std::mem::take(&mut client.out.0) {
        ours.receive(&packet, client.place, Duration::from_secs(5));
    }
    ours.out.0.clear();
    client.told_at = None;
    carry(&mut ours, std::slice::from_mut(&mut client), [5100, 5110], [0, 0], 1, 7);
    client.ask(b"ask.".to_vec(), Duration::from_millis(5110));
    carry(&mut ours, std::slice::from_mut(&mut client), [5110, 5120], [0, 0], 1, 7);
    assert_eq!(client.answers.len(), 1);
}

#[test]
fn who_goes_or_is_silent_is_forgotten() {
    let (mut ours, mut client) = (participant(), Client::new(2));
    carry(&mut ours, std::slice::from_mut(&mut client), [0, 100], [0, 0], 1, 7);
    assert!(ours.knows([2; 12]));
    let (inline, payload) = crate::parameters::our_end([2; 12]);
    let mut message = Outgoing::new([3; 12], None);
    message.data(
        [[0, 1, 0, 0xc7], [0, 1, 0, 0xc2]],
        2,
        &Sample { inline: inline.clone(), payload: payload.clone(), is_key: true },
    );
    ours.receive(&message.bytes(), place(3), Duration::from_millis(100));
    assert!(ours.knows([2; 12]), "nobody speaks for others");
    let mut message = Outgoing::new([2; 12], None);
    message.data([[0, 1, 0, 0xc7], [0, 1, 0, 0xc2]], 2, &Sample { inline, payload, is_key: true });
    ours.receive(&message.bytes(), place(2), Duration::from_millis(100));
    assert!(!ours.knows([2; 12]));
    let mut another = Client::new(4);
    carry(&mut ours, std::slice::from_mut(&mut another), [100, 200], [0, 0], 1, 7);
    assert!(ours.knows([4; 12]));
    ours.turn(Duration::from_secs(30));
    assert!(!ours.knows([4; 12]), "its lease is 20 s");
}

#[test]
fn a_client_that_starts_again_is_answered_again() {
    let mut ours = participant();
    for (round, number) in [2, 2, 2].into_iter().enumerate() {
        let begun = 30_000 * round as u64;
        let mut client = Client::new(number);
        carry(&mut ours, std::slice::from_mut(&mut client), [begun, begun + 500], [0, 0], 1, 7);
        client.ask(b"ask.".to_vec(), Duration::from_millis(begun + 500));
        carry(&mut ours, std::slice::from_mut(&mut client), [begun + 500, begun + 600], [0, 0], 1, 7);
        assert_eq!(client.answers.len(), 1, "round {round}");
    }
}

fn missing() -> impl Strategy<Value = Missing> {
    (any::<i64>(), proptest::collection::vec(0_i64..300, 0..20))
        .prop_map(|(base, offsets)| Missing::of(base, offsets.into_iter().map(|offset| base.saturating_add(offset))))
}

proptest! {
    #[test]
    fn any_bytes_are_heard_in_silence(packets in proptest::collection::vec(proptest::collection::vec(any::<u8>(), 0..200), 0..20)) {
        let mut ours = participant();
        for packet in packets {
            ours.receive(&packet, place(9), Duration::ZERO);
            let header = [&b"RTPS\x02\x03\x01\x0f"[..], &[9; 12]].concat();
            ours.receive(&[header, packet].concat(), place(9), Duration::ZERO);
            ours.turn(Duration::from_secs(1));
        }
    }

    /// Of a real conversation any byte may be another one.
    #[test]
    fn broken_packets_take_nothing_down(changes in proptest::collection::vec((any::<u16>(), any::<u8>()), 1..40), cut in 0_usize..100) {
        let (mut ours, mut client) = (participant(), Client::new(2));
        carry(&mut ours, std::slice::from_mut(&mut client), [0, 50], [0, 0], 1, 7);
        client.ask(vec![3; 3000], Duration::from_millis(50));
        client.told_at = None;
        client.turn(Duration::from_millis(50));
        let mut changes = changes.into_iter().cycle();
        for (_, mut packet) in std::mem::take(&mut client.out.0) {
            let length = packet.len();
            for (at, byte) in changes.by_ref().take(3) {
                packet[20 + usize::from(at) % (length - 20)] = byte;
            }
            packet.truncate(length - cut.min(length));
            ours.receive(&packet, client.place, Duration::from_millis(50));
            ours.turn(Duration::from_millis(60));
        }
    }

    #[test]
    fn numbers_beyond_all_bounds_are_survived(missing in missing(), first in any::<i64>(), last in any::<i64>(), is_final: bool) {
        let (mut ours, mut client) = (participant(), Client::new(2));
        let clients = std::slice::from_mut(&mut client);
        carry(&mut ours, clients, [0, 50], [0, 0], 1, 7);
        clients[0].ask(b"one.".to_vec(), Duration::from_millis(50));
        carry(&mut ours, clients, [50, 60], [0, 0], 1, 7);
        for (reader, writer) in [([0, 0, 8, 4], [0, 0, 1, 3]), ([0, 0, 3, 0xc7], [0, 0, 3, 0xc2])] {
            let mut message = Outgoing::new([2; 12], Some(OURS));
            message.acknack([reader, writer], missing, is_final, 1);
            message.heartbeat([[0, 0, 1, 4], [0, 0, 9, 3]], [first, last], 1);
            message.gap([[0, 0, 1, 4], [0, 0, 9, 3]], first, last);
            ours.receive(&message.bytes(), place(2), Duration::from_millis(60));
        }
        ours.turn(Duration::from_millis(70));
        prop_assert!(ours.out.0.len() < 2000);
    }
}
