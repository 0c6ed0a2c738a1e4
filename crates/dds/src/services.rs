//! Services through RustDDS: the clients of Fast DDS tell and expect which request a response is to beside the message, which Cyclone DDS does
//! not hand out; those of Cyclone DDS say it in front of the message. Who asks is told apart by the two bytes of the maker that begin every
//! participant's number (DDSI-RTPS 2.5, 8.2.4.1 and 9.3.1.5).

use crate::configuration::Range;
use mapwright_live::wire::{Answer, Service, WireError, names};
use rustdds::bytes::Bytes;
use rustdds::mio1::{Events, Interest, Poll, Registry, Token, Waker};
use rustdds::no_key::{
    DataWriter, Decode, DefaultDecoder, DeserializedCacheChange, DeserializerAdapter, SerializerAdapter,
    SimpleDataReader,
};
use rustdds::policy::{Durability, History, Reliability};
use rustdds::rpc::SampleIdentity;
use rustdds::{
    DataWriterStatus, DomainParticipant, DomainParticipantBuilder, GUID, Publisher, QosPolicies, QosPolicyBuilder,
    RTPSEntity, RepresentationIdentifier, SequenceNumber, StatusEvented, Subscriber, Timestamp, TopicKind,
    WriteOptionsBuilder,
};
use std::collections::VecDeque;
use std::convert::Infallible;
use std::io;
use std::net::Ipv4Addr;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// A response that fits into one packet of Ethernet with what is sent beside it, bytes. A longer one goes in parts, and RustDDS 0.15 puts one byte too
/// many into parts that say which request they belong to: clients of Fast DDS drop them.
pub(crate) const RESPONSE_MOST: usize = 1300;
/// The maker of Cyclone DDS in front of its participants' numbers.
const CYCLONE: [u8; 2] = [0x01, 0x10];
/// What Cyclone's clients put in front of a request: half of their number, and the request's.
const CYCLONE_HEAD_BYTES: usize = 16;
/// Requests and responses that are kept for who is slow.
const DEPTH: i32 = 10;
/// The head of CDR: little endian, no options.
const CDR_LE: [u8; 4] = [0, 1, 0, 0];

/// A message as it is, with its head.
#[derive(Debug, Clone)]
struct Raw(Vec<u8>);

/// Takes messages as they are.
#[derive(Debug, Clone, Copy)]
struct AsItIs;

impl DeserializerAdapter<Raw> for AsItIs {
    type Error = Infallible;
    type Decoded = Raw;

    fn supported_encodings() -> &'static [RepresentationIdentifier] {
        &[RepresentationIdentifier::CDR_LE, RepresentationIdentifier::CDR_BE]
    }

    fn transform_decoded(decoded: Raw) -> Raw {
        decoded
    }
}

impl DefaultDecoder<Raw> for AsItIs {
    type Decoder = Self;
    const DECODER: Self = Self;
}

impl Decode<'_, Raw> for AsItIs {
    type Error = Infallible;

    fn decode_bytes(self, bytes: &[u8], encoding: RepresentationIdentifier) -> Result<Raw, Infallible> {
        let mut head = CDR_LE;
        head[1] = u8::from(encoding == RepresentationIdentifier::CDR_LE);
        Ok(Raw([&head, bytes].concat()))
    }
}

impl SerializerAdapter<Raw> for AsItIs {
    type Error = Infallible;

    fn output_encoding() -> RepresentationIdentifier {
        RepresentationIdentifier::CDR_LE
    }

    fn to_bytes(message: &Raw) -> Result<Bytes, Infallible> {
        Ok(Bytes::copy_from_slice(message.0.get(CDR_LE.len()..).unwrap_or(&[])))
    }
}

/// A response waits so long at most until its reader is known: sent before, it would be lost.
const READER_WITHIN: Duration = Duration::from_millis(200);
const LOOK_AGAIN: Duration = Duration::from_millis(1);
/// Participants whose readers are known; the first are forgotten.
const KNOWN_MOST: usize = 1000;

/// A service with who answers it.
struct Server {
    requests: SimpleDataReader<Raw, AsItIs>,
    responses: DataWriter<Raw, AsItIs>,
    /// The participants that are known to hear the responses.
    known: VecDeque<[u8; PREFIX_BYTES]>,
    answer: Answer,
}

/// Bytes of a number that are the participant's.
const PREFIX_BYTES: usize = 12;

fn prefix(guid: GUID) -> [u8; PREFIX_BYTES] {
    let mut prefix = [0; PREFIX_BYTES];
    prefix.copy_from_slice(&guid.to_bytes()[..PREFIX_BYTES]);
    prefix
}

impl Server {
    /// Answers all that has come.
    fn turn(&mut self) {
        self.requests.drain_read_notifications();
        // a request that cannot be read is passed over, so that the next one is answered
        loop {
            match self.requests.try_take_one() {
                Ok(Some(request)) => self.answer(&request),
                Ok(None) => return,
                Err(_) => {}
            }
        }
    }

    fn answer(&mut self, request: &DeserializedCacheChange<Raw>) {
        let writer = request.writer_guid();
        let mut identity = request
            .related_sample_identity()
            .unwrap_or(SampleIdentity { writer_guid: writer, sequence_number: request.sequence_number });
        // Fast DDS says who wants the response, and leaves the number to the message's own.
        if identity.sequence_number == SequenceNumber::UNKNOWN {
            identity.sequence_number = request.sequence_number;
        }
        let Some((head, message)) = split(writer, &request.sample.0) else { return };
        let Ok(response) = catch_unwind(AssertUnwindSafe(|| (self.answer)(&message))) else { return };
        let response = Raw(with_head(&head, response));
        self.wait_for_reader(prefix(identity.writer_guid));
        let options =
            WriteOptionsBuilder::new().source_timestamp(Timestamp::now()).related_sample_identity(identity).build();
        // Whoever has gone meanwhile gets nothing.
        let _ = self.responses.write_with_options(response, options);
    }
}

impl Server {
    /// A client that has just come may have found this service before its reader of responses was found.
    fn wait_for_reader(&mut self, client: [u8; PREFIX_BYTES]) {
        let begun = Instant::now();
        loop {
            while let Some(status) = self.responses.try_recv_status() {
                if let DataWriterStatus::PublicationMatched { reader, .. } = status {
                    self.know(prefix(reader));
                }
            }
            if self.known.contains(&client) {
                return;
            }
            if begun.elapsed() >= READER_WITHIN {
                // Nobody waits for it a second time.
                return self.know(client);
            }
            thread::sleep(LOOK_AGAIN);
        }
    }

    fn know(&mut self, participant: [u8; PREFIX_BYTES]) {
        if self.known.len() >= KNOWN_MOST {
            self.known.pop_front();
        }
        self.known.push_back(participant);
    }
}

/// What a client puts in front of its request, and the request; none where it is too short.
fn split(writer: GUID, request: &[u8]) -> Option<(Vec<u8>, Vec<u8>)> {
    if writer.to_bytes()[..2] != CYCLONE {
        return Some((Vec::new(), request.to_vec()));
    }
    let (cdr, body) = request.split_at_checked(CDR_LE.len())?;
    let (head, message) = body.split_at_checked(CYCLONE_HEAD_BYTES)?;
    // sixteen bytes leave what follows as it was laid out
    Some((head.to_vec(), [cdr, message].concat()))
}

/// A response with what was in front of the request put in front of it, up to a multiple of four bytes, as RustDDS wants it.
fn with_head(head: &[u8], response: Vec<u8>) -> Vec<u8> {
    let mut whole = match response.split_at_checked(CDR_LE.len()) {
        Some((cdr, message)) if !head.is_empty() => [cdr, head, message].concat(),
        _ => response,
    };
    whole.resize(whole.len().next_multiple_of(4), 0);
    whole
}

/// Answers services on a thread of its own, until dropped.
pub(crate) struct Services {
    participant: DomainParticipant,
    subscriber: Subscriber,
    publisher: Publisher,
    qos: QosPolicies,
    registry: Registry,
    servers: Arc<Mutex<Vec<Server>>>,
    is_over: Arc<AtomicBool>,
    waker: Waker,
    thread: Option<JoinHandle<()>>,
}

const WOKEN: Token = Token(usize::MAX);

impl Services {
    /// In a domain; where others in the network are not looked for, on this machine alone.
    pub(crate) fn new(domain: u16, range: Range) -> Result<Self, WireError> {
        let failed = |why: String| WireError { doing: format!("a participant for services in domain {domain}"), why };
        let io = |error: io::Error| failed(error.to_string());
        let builder = DomainParticipantBuilder::new(domain);
        let builder = match range {
            Range::Subnet => builder,
            Range::Localhost | Range::Off => builder.with_only_networks([Ipv4Addr::LOCALHOST]),
        };
        let participant = builder.build().map_err(|e| failed(e.to_string()))?;
        let qos = QosPolicyBuilder::new()
            .reliability(Reliability::Reliable { max_blocking_time: rustdds::Duration::from_millis(100) })
            .durability(Durability::Volatile)
            .history(History::KeepLast { depth: DEPTH })
            .build();
        let subscriber = participant.create_subscriber(&qos).map_err(|e| failed(e.to_string()))?;
        let publisher = participant.create_publisher(&qos).map_err(|e| failed(e.to_string()))?;
        let poll = Poll::new().map_err(io)?;
        let registry = poll.registry().try_clone().map_err(io)?;
        let waker = Waker::new(poll.registry(), WOKEN).map_err(io)?;
        let servers = Arc::new(Mutex::new(Vec::new()));
        let is_over = Arc::new(AtomicBool::new(false));
        let thread = thread::Builder::new().name("services".to_owned()).spawn({
            let (servers, is_over) = (Arc::clone(&servers), Arc::clone(&is_over));
            move || answer_until(&is_over, poll, &servers)
        });
        let thread = Some(thread.map_err(io)?);
        Ok(Self { participant, subscriber, publisher, qos, registry, servers, is_over, waker, thread })
    }

    /// Answers a service; the sixteen bytes of its reader and its writer come back.
    pub(crate) fn serve(&mut self, service: &Service, answer: Answer) -> Result<[[u8; 16]; 2], WireError> {
        let failed =
            |why: String| WireError { doing: format!("service {} of type {}", service.name, service.kind), why };
        let topic = |prefix: &str, suffix: &str, part: &str| {
            let kind = names::dds_type(service.kind, part).ok_or_else(|| failed("no such type".to_owned()))?;
            let name = format!("{prefix}{}{suffix}", service.name);
            self.participant.create_topic(name, kind, &self.qos, TopicKind::NoKey).map_err(|e| failed(e.to_string()))
        };
        let (asked, said) = (topic("rq", "Request", "_Request")?, topic("rr", "Reply", "_Response")?);
        let mut requests: SimpleDataReader<Raw, AsItIs> = self
            .subscriber
            .create_simple_datareader_no_key(&asked, Some(self.qos.clone()))
            .map_err(|e| failed(e.to_string()))?;
        let responses: DataWriter<Raw, AsItIs> = self
            .publisher
            .create_datawriter_no_key(&said, Some(self.qos.clone()))
            .map_err(|e| failed(e.to_string()))?;
        let guids = [requests.guid().to_bytes(), responses.guid().to_bytes()];
        let mut servers = self.servers.lock().unwrap_or_else(PoisonError::into_inner);
        self.registry
            .register(&mut requests, Token(servers.len()), Interest::READABLE)
            .map_err(|e| failed(e.to_string()))?;
        servers.push(Server { requests, responses, known: VecDeque::new(), answer });
        drop(servers);
        // one may have come before anybody looked
        let _ = self.waker.wake();
        Ok(guids)
    }
}

impl Drop for Services {
    fn drop(&mut self) {
        self.is_over.store(true, Ordering::Release);
        let _ = self.waker.wake();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

fn answer_until(is_over: &AtomicBool, mut poll: Poll, servers: &Mutex<Vec<Server>>) {
    let mut events = Events::with_capacity(64);
    while !is_over.load(Ordering::Acquire) {
        if let Err(error) = poll.poll(&mut events, None)
            && error.kind() != io::ErrorKind::Interrupted
        {
            return;
        }
        let mut servers = servers.lock().unwrap_or_else(PoisonError::into_inner);
        for event in &events {
            match event.token() {
                WOKEN => servers.iter_mut().for_each(Server::turn),
                Token(number) => servers.get_mut(number).into_iter().for_each(Server::turn),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_client_of_cyclone_gets_its_head_back() {
        let cyclone = GUID::from_bytes([1, 0x10, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 3]);
        let request: Vec<u8> = CDR_LE.into_iter().chain(10..26).chain([7, 0, 0, 0]).collect();
        let (head, message) = split(cyclone, &request).unwrap();
        assert_eq!((head.clone(), message), ((10..26).collect::<Vec<u8>>(), vec![0, 1, 0, 0, 7, 0, 0, 0]));
        let response = with_head(&head, vec![0, 1, 0, 0, 1]);
        assert_eq!(response, CDR_LE.into_iter().chain(10..26).chain([1, 0, 0, 0]).collect::<Vec<u8>>());
        assert_eq!(split(cyclone, &request[..19]), None, "too short");
    }

    #[test]
    fn others_put_nothing_in_front() {
        let fast = GUID::from_bytes([1, 0x0f, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 3]);
        let (head, message) = split(fast, &[0, 1, 0, 0, 7]).unwrap();
        assert_eq!((head.len(), &message), (0, &vec![0, 1, 0, 0, 7]));
        assert_eq!(with_head(&head, vec![0, 1, 0, 0]), [0, 1, 0, 0]);
    }
}
