//! Lists of parameters: what participants, readers and writers say of themselves, and what stands in front of a sample (9.4.2.11, 9.6.3).

use crate::bytes::{Put, Reader};
use crate::ids::{EntityId, Guid, Prefix, VENDOR, VERSION};
use std::net::{Ipv4Addr, SocketAddrV4};
use std::time::Duration;

const SENTINEL: u16 = 0x0001;
const LEASE_DURATION: u16 = 0x0002;
const TOPIC_NAME: u16 = 0x0005;
const TYPE_NAME: u16 = 0x0007;
const DOMAIN_ID: u16 = 0x000f;
const PROTOCOL_VERSION: u16 = 0x0015;
const VENDOR_ID: u16 = 0x0016;
const RELIABILITY: u16 = 0x001a;
const DURABILITY: u16 = 0x001d;
const USER_DATA: u16 = 0x002c;
const UNICAST_LOCATOR: u16 = 0x002f;
const DEFAULT_UNICAST_LOCATOR: u16 = 0x0031;
const METATRAFFIC_UNICAST_LOCATOR: u16 = 0x0032;
const PARTICIPANT_GUID: u16 = 0x0050;
const BUILTIN_ENDPOINT_SET: u16 = 0x0058;
const ENDPOINT_GUID: u16 = 0x005a;
const KEY_HASH: u16 = 0x0070;
const STATUS_INFO: u16 = 0x0071;
const RELATED_SAMPLE_IDENTITY: u16 = 0x0083;
/// What Fast DDS used before, and still reads.
const RELATED_SAMPLE_IDENTITY_CUSTOM: u16 = 0x800f;
/// Bits that say how makers read what they do not know; the rest tells parameters apart.
const MUST_UNDERSTAND: u16 = 0x4000;

const RELIABLE: u32 = 2;
const UDP_V4: u32 = 1;
/// Addresses that are kept of one participant or endpoint.
const LOCATORS_MOST: usize = 16;
/// Parameters in CDR: either byte order (10.2).
const PL_CDR_BE: [u8; 2] = [0, 2];
const PL_CDR_LE: [u8; 2] = [0, 3];
/// What a participant of ours has of the endpoints that find others: those that tell and hear of participants, of writers and of readers (9.3.2.12).
const ENDPOINTS: u32 = 0x3f;
/// How long a participant may be silent that does not say so.
const LEASE: Duration = Duration::from_secs(100);
/// How long we may be.
pub(crate) const OUR_LEASE: Duration = Duration::from_secs(20);

/// A list as it was received.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Parameters<'a>(Reader<'a>);

impl<'a> Parameters<'a> {
    pub(crate) fn none() -> Self {
        Self(Reader::new(&[], true))
    }

    /// The list in front of a payload; the reader stands behind it then. None where it has no end.
    pub(crate) fn read(reader: &mut Reader<'a>) -> Option<Self> {
        let list = Self(*reader);
        loop {
            let (id, length) = (reader.u16()?, reader.u16()?);
            if id == SENTINEL {
                return Some(list);
            }
            reader.take(usize::from(length))?;
        }
    }

    /// A payload that is a list, whether it says where it ends or not.
    pub(crate) fn of_payload(payload: &'a [u8]) -> Option<Self> {
        let mut reader = Reader::new(payload, true);
        let encoding: [u8; 2] = reader.array()?;
        reader.take(2)?;
        reader.is_little = encoding == PL_CDR_LE;
        (reader.is_little || encoding == PL_CDR_BE).then_some(Self(reader))
    }

    fn all(self) -> impl Iterator<Item = (u16, Reader<'a>)> {
        let mut reader = self.0;
        std::iter::from_fn(move || {
            let (id, length) = (reader.u16()?, reader.u16()?);
            let value = Reader::new(reader.take(usize::from(length))?, reader.is_little);
            (id != SENTINEL).then_some((id & !MUST_UNDERSTAND, value))
        })
    }

    fn first<T>(self, wanted: u16, read: impl Fn(Reader<'a>) -> Option<T>) -> Option<T> {
        self.all().filter(|(id, _)| *id == wanted).find_map(|(_, value)| read(value))
    }

    fn guid(self, wanted: u16) -> Option<Guid> {
        self.first(wanted, |mut value| value.array()).map(Guid::read)
    }

    fn locators(self, wanted: u16) -> Vec<SocketAddrV4> {
        self.all().filter(|(id, _)| *id == wanted).filter_map(|(_, value)| locator(value)).take(LOCATORS_MOST).collect()
    }

    /// What the sample is about has gone (9.6.3.9): a participant, a reader or a writer.
    pub(crate) fn is_over(self) -> bool {
        self.first(STATUS_INFO, |mut value| value.array::<4>()).is_some_and(|status| status[3] & 3 != 0)
    }

    /// Which sample of which writer this one belongs to.
    pub(crate) fn related(self) -> Option<(Guid, i64)> {
        let read = |mut value: Reader<'_>| Some((Guid::read(value.array()?), value.sequence_number()?));
        self.first(RELATED_SAMPLE_IDENTITY, read).or_else(|| self.first(RELATED_SAMPLE_IDENTITY_CUSTOM, read))
    }

    /// Whose the endpoint is that the sample is about, by its key alone.
    pub(crate) fn key(self) -> Option<Guid> {
        self.guid(KEY_HASH)
    }

    /// Which endpoint, or which participant, it is about.
    pub(crate) fn about(self) -> Option<Guid> {
        self.guid(ENDPOINT_GUID).or_else(|| self.guid(PARTICIPANT_GUID))
    }

    pub(crate) fn participant(self) -> Option<Participant> {
        let guid = self.guid(PARTICIPANT_GUID)?;
        let lease = |mut value: Reader<'_>| Some(Duration::from_secs(u64::from(value.u32()?)));
        Some(Participant {
            prefix: guid.prefix,
            metatraffic: self.locators(METATRAFFIC_UNICAST_LOCATOR),
            default: self.locators(DEFAULT_UNICAST_LOCATOR),
            lease: self.first(LEASE_DURATION, lease).unwrap_or(LEASE),
        })
    }

    pub(crate) fn endpoint(self) -> Option<Endpoint<'a>> {
        Some(Endpoint {
            guid: self.guid(ENDPOINT_GUID)?,
            topic: self.first(TOPIC_NAME, |mut value| value.text())?,
            kind: self.first(TYPE_NAME, |mut value| value.text())?,
            is_reliable: self.first(RELIABILITY, |mut value| value.u32()) == Some(RELIABLE),
            locators: self.locators(UNICAST_LOCATOR),
        })
    }
}

fn locator(mut value: Reader<'_>) -> Option<SocketAddrV4> {
    let kind = value.u32()?;
    let port = u16::try_from(value.u32()?).ok()?;
    value.take(12)?;
    let address: [u8; 4] = value.array()?;
    let address = Ipv4Addr::from(address);
    (kind == UDP_V4 && port != 0 && !address.is_unspecified() && !address.is_multicast() && !address.is_broadcast())
        .then_some(SocketAddrV4::new(address, port))
}

/// What a participant says of itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Participant {
    pub(crate) prefix: Prefix,
    /// Where it hears of others.
    pub(crate) metatraffic: Vec<SocketAddrV4>,
    /// Where its readers and writers hear, unless they say otherwise.
    pub(crate) default: Vec<SocketAddrV4>,
    /// Who has been silent for so long is gone.
    pub(crate) lease: Duration,
}

/// What a participant says of one of its readers or writers.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Endpoint<'a> {
    pub(crate) guid: Guid,
    pub(crate) topic: &'a str,
    pub(crate) kind: &'a str,
    pub(crate) is_reliable: bool,
    pub(crate) locators: Vec<SocketAddrV4>,
}

/// A list that is being written.
struct List(Vec<u8>);

impl List {
    fn payload() -> Self {
        Self(vec![PL_CDR_LE[0], PL_CDR_LE[1], 0, 0])
    }

    fn put(mut self, id: u16, value: &[u8]) -> Self {
        self.0.put_u16(id);
        self.0.put_u16(u16::try_from(value.len().next_multiple_of(4)).unwrap_or(0));
        self.0.extend(value);
        self.0.resize(self.0.len().next_multiple_of(4), 0);
        self
    }

    fn put_u32(self, id: u16, value: u32) -> Self {
        self.put(id, &value.to_le_bytes())
    }

    fn put_bytes(self, id: u16, bytes: &[u8]) -> Self {
        let length = u32::try_from(bytes.len()).unwrap_or(0);
        self.put(id, &[&length.to_le_bytes(), bytes].concat())
    }

    fn put_text(self, id: u16, text: &str) -> Self {
        self.put_bytes(id, &[text.as_bytes(), &[0]].concat())
    }

    fn put_locator(self, id: u16, to: SocketAddrV4) -> Self {
        let mut value = Vec::with_capacity(24);
        value.put_u32(UDP_V4);
        value.put_u32(u32::from(to.port()));
        value.extend([0; 12]);
        value.extend(to.ip().octets());
        self.put(id, &value)
    }

    fn end(self) -> Vec<u8> {
        self.put(SENTINEL, &[]).0
    }
}

/// A participant of ours, as it tells of itself: what it is made of, where it hears, and what is told with it (ROS: its enclave).
pub(crate) fn our_participant(prefix: Prefix, domain: u16, locators: &[SocketAddrV4], user_data: &str) -> Vec<u8> {
    let guid = Guid { prefix, entity: PARTICIPANT }.bytes();
    let mut lease = Vec::new();
    lease.put_u32(OUR_LEASE.as_secs() as u32);
    lease.put_u32(0);
    let mut list = List::payload()
        .put(PROTOCOL_VERSION, &[VERSION[0], VERSION[1], 0, 0])
        .put(VENDOR_ID, &[VENDOR[0], VENDOR[1], 0, 0])
        .put(PARTICIPANT_GUID, &guid)
        .put_u32(DOMAIN_ID, u32::from(domain))
        .put_u32(BUILTIN_ENDPOINT_SET, ENDPOINTS)
        .put(LEASE_DURATION, &lease)
        .put_bytes(USER_DATA, user_data.as_bytes());
    for locator in locators {
        list = list.put_locator(METATRAFFIC_UNICAST_LOCATOR, *locator).put_locator(DEFAULT_UNICAST_LOCATOR, *locator);
    }
    list.end()
}

/// A reader or a writer of ours: reliable, and for those who are there.
pub(crate) fn our_endpoint(guid: Guid, topic: &str, kind: &str) -> Vec<u8> {
    let mut reliability = Vec::new();
    reliability.put_u32(RELIABLE);
    // as long as a writer would wait at most, a tenth of a second: seconds and 2^-32 of them
    reliability.put_u32(0);
    reliability.put_u32(u32::MAX / 10);
    List::payload()
        .put(ENDPOINT_GUID, &guid.bytes())
        .put(PARTICIPANT_GUID, &Guid { prefix: guid.prefix, entity: PARTICIPANT }.bytes())
        .put_text(TOPIC_NAME, topic)
        .put_text(TYPE_NAME, kind)
        .put(RELIABILITY, &reliability)
        .put_u32(DURABILITY, 0)
        .end()
}

/// The payload and what stands in front of it where a participant of ours goes.
pub(crate) fn our_end(prefix: Prefix) -> (Vec<u8>, Vec<u8>) {
    let guid = Guid { prefix, entity: PARTICIPANT }.bytes();
    let inline = List(Vec::new()).put(KEY_HASH, &guid).put(STATUS_INFO, &[0, 0, 0, 3]).end();
    (inline, List::payload().put(PARTICIPANT_GUID, &guid).end())
}

/// What says in front of a response to which request it belongs, in both ways that are in use.
pub(crate) fn related(writer: Guid, number: i64) -> Vec<u8> {
    let mut value = writer.bytes().to_vec();
    value.put_sequence_number(number);
    List(Vec::new()).put(RELATED_SAMPLE_IDENTITY, &value).put(RELATED_SAMPLE_IDENTITY_CUSTOM, &value).end()
}

/// The participant itself.
pub(crate) const PARTICIPANT: EntityId = [0, 0, 1, 0xc1];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_told_is_read_back() {
        let to = SocketAddrV4::new(Ipv4Addr::new(10, 0, 0, 7), 7411);
        let payload = our_participant([7; 12], 3, &[to], "enclave=/;");
        let found = Parameters::of_payload(&payload).unwrap().participant().unwrap();
        let expected = Participant { prefix: [7; 12], metatraffic: vec![to], default: vec![to], lease: OUR_LEASE };
        assert_eq!(found, expected);

        let guid = Guid { prefix: [7; 12], entity: [0, 0, 1, 3] };
        let payload = our_endpoint(guid, "rr/askReply", "std_srvs::srv::dds_::Empty_Response_");
        let found = Parameters::of_payload(&payload).unwrap().endpoint().unwrap();
        let (topic, kind) = ("rr/askReply", "std_srvs::srv::dds_::Empty_Response_");
        assert_eq!(found, Endpoint { guid, topic, kind, is_reliable: true, locators: Vec::new() });

        let (inline, payload) = our_end([7; 12]);
        let inline = Parameters(Reader::new(&inline, true));
        assert!(inline.is_over() && inline.key().unwrap().entity == PARTICIPANT);
        assert_eq!(Parameters::of_payload(&payload).unwrap().about(), inline.key());

        let bytes = related(guid, 1 << 33);
        assert_eq!(Parameters(Reader::new(&bytes, true)).related(), Some((guid, 1 << 33)));
    }

    #[test]
    fn either_byte_order_is_read_and_addresses_that_cannot_be_are_not() {
        let mut payload = vec![0, 2, 0, 0];
        for (kind, port, address) in
            [(1_u32, 7411_u32, [10, 0, 0, 7]), (1, 0, [10, 0, 0, 7]), (16, 1, [10, 0, 0, 7]), (1, 1, [0; 4])]
        {
            payload.extend([0x80, 0x31, 0, 24].map(|byte| if byte == 0x80 { 0 } else { byte }));
            payload.extend(kind.to_be_bytes());
            payload.extend(port.to_be_bytes());
            payload.extend([0; 12]);
            payload.extend(address);
        }
        payload.extend([0, 0x50, 0, 16]);
        payload.extend([9; 16]);
        let found = Parameters::of_payload(&payload).unwrap().participant().unwrap();
        assert_eq!((found.prefix, found.default), ([9; 12], vec![SocketAddrV4::new(Ipv4Addr::new(10, 0, 0, 7), 7411)]));
        assert_eq!(found.lease, LEASE);
    }
}
