//! What a packet of a network carries by UDP.

use crate::packets::capture::Packet;
use crate::scalar::array;
use std::borrow::Cow;
use std::collections::VecDeque;

const ETHERNET: u32 = 1;
const RAW_IP: u32 = 101;
const LINUX_COOKED: u32 = 113;
const LINUX_COOKED_2: u32 = 276;
const IPV4: u16 = 0x0800;
/// Tags of virtual networks.
const TAGS: [u16; 2] = [0x8100, 0x88a8];
const UDP: u8 = 17;
/// So many datagrams that came in pieces wait for the rest of them.
const WAITING_MAX: usize = 16;
/// No datagram is longer.
const DATAGRAM_BYTES_MAX: usize = 65_535;

/// A datagram.
#[derive(Debug, Clone)]
pub(crate) struct Datagram<'a> {
    pub(crate) source: [u8; 4],
    pub(crate) port: u16,
    /// Bytes that it says that it has.
    pub(crate) claimed: usize,
    pub(crate) payload: Cow<'a, [u8]>,
}

/// What IP carries: a whole datagram, or a piece of one.
struct Ip<'a> {
    source: [u8; 4],
    id: u16,
    /// Where in the datagram it stands, and whether more comes behind it.
    offset: usize,
    has_more: bool,
    body: &'a [u8],
}

/// A datagram of which pieces have come, in order.
#[derive(Debug)]
struct Waiting {
    source: [u8; 4],
    id: u16,
    body: Vec<u8>,
}

/// Puts datagrams together that are longer than the network's packets, as an Ouster's are. Pieces that come in another order than they were
/// sent in are lost.
#[derive(Debug, Default)]
pub(crate) struct Fragments {
    waiting: VecDeque<Waiting>,
    has_taken: bool,
}

impl Fragments {
    /// The datagram in a packet, or the one that its piece completes; none where it holds something else, or more is to come.
    pub(crate) fn add<'a>(&mut self, packet: &Packet<'a>) -> Option<Datagram<'a>> {
        self.has_taken = false;
        let ip = ip_of(packet)?;
        if ip.offset == 0 && !ip.has_more {
            return datagram(ip.source, ip.body);
        }
        self.has_taken = true;
        if ip.offset == 0 {
            self.waiting.truncate(WAITING_MAX - 1);
            self.waiting.push_front(Waiting { source: ip.source, id: ip.id, body: ip.body.to_vec() });
            return None;
        }
        let is_its = |waiting: &Waiting| (waiting.source, waiting.id) == (ip.source, ip.id);
        let at = self.waiting.iter().position(is_its)?;
        let known = &mut self.waiting[at].body;
        let fits = known.len() == ip.offset && ip.offset + ip.body.len() <= DATAGRAM_BYTES_MAX;
        if fits && ip.has_more {
            known.extend_from_slice(ip.body);
            return None;
        }
        let mut whole = self.waiting.remove(at)?;
        whole.body.extend_from_slice(ip.body);
        fits.then(|| datagram(whole.source, &whole.body).map(Datagram::into_owned)).flatten()
    }

    /// Whether the last packet was a piece of a datagram.
    pub(crate) fn has_taken(&self) -> bool {
        self.has_taken
    }
}

impl Datagram<'_> {
    fn into_owned<'b>(self) -> Datagram<'b> {
        Datagram { payload: Cow::Owned(self.payload.into_owned()), ..self }
    }
}

fn ip_of<'a>(packet: &Packet<'a>) -> Option<Ip<'a>> {
    let mut rest = match packet.link {
        ETHERNET => packet.bytes.get(12..)?,
        LINUX_COOKED => packet.bytes.get(14..)?,
        LINUX_COOKED_2 if packet.bytes.starts_with(&IPV4.to_be_bytes()) => return ip(packet.bytes.get(20..)?),
        RAW_IP => return ip(packet.bytes),
        _ => return None,
    };
    while let Some(kind) = array(rest, 0).map(u16::from_be_bytes) {
        rest = rest.get(2..)?;
        if kind == IPV4 {
            return ip(rest);
        }
        if !TAGS.contains(&kind) {
            return None;
        }
        rest = rest.get(2..)?;
    }
    None
}

fn ip(bytes: &[u8]) -> Option<Ip<'_>> {
    let header = usize::from(bytes.first()? & 15) * 4;
    if bytes[0] >> 4 != 4 || *bytes.get(9)? != UDP {
        return None;
    }
    let place = u16::from_be_bytes(array(bytes, 6)?);
    let claimed = usize::from(u16::from_be_bytes(array(bytes, 2)?));
    // behind a short packet Ethernet has bytes that are none of IP's; some captures have no length
    let body = bytes.get(header..claimed).filter(|body| !body.is_empty()).or_else(|| bytes.get(header..))?;
    Some(Ip {
        source: array(bytes, 12)?,
        id: u16::from_be_bytes(array(bytes, 4)?),
        offset: usize::from(place & 0x1fff) * 8,
        has_more: place & 0x2000 != 0,
        body,
    })
}

fn datagram(source: [u8; 4], udp: &[u8]) -> Option<Datagram<'_>> {
    let claimed = usize::from(u16::from_be_bytes(array(udp, 4)?)).checked_sub(8)?;
    let payload = udp.get(8..)?;
    Some(Datagram {
        source,
        port: u16::from_be_bytes(array(udp, 2)?),
        claimed,
        payload: Cow::Borrowed(payload.get(..claimed).unwrap_or(payload)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright_geom::Stamp;
    use proptest::prelude::*;

    fn piece(id: u16, place: u16, body: &[u8]) -> Vec<u8> {
        let mut bytes = vec![0x45, 0];
        bytes.extend((20 + body.len() as u16).to_be_bytes());
        bytes.extend([id.to_be_bytes(), place.to_be_bytes()].concat());
        bytes.extend([64, UDP, 0, 0, 10, 0, 0, 1, 10, 0, 0, 2]);
        bytes.extend(body);
        bytes
    }

    fn add(fragments: &mut Fragments, bytes: &[u8]) -> Option<Vec<u8>> {
        let packet = Packet { at: 0, stamp: Stamp(0), link: RAW_IP, bytes };
        fragments.add(&packet).map(|datagram| datagram.payload.into_owned())
    }

    #[test]
    fn datagrams_are_put_together_of_their_pieces() {
        let mut udp = [7_u16, 7502, 8 + 24, 0].map(u16::to_be_bytes).concat();
        udp.extend(0..24);
        let mut fragments = Fragments::default();
        assert_eq!(add(&mut fragments, &piece(5, 0x2000, &udp[..16])), None);
        assert_eq!(add(&mut fragments, &piece(6, 0x2000, &udp[..16])), None);
        assert_eq!(add(&mut fragments, &piece(5, 0x2002, &udp[16..24])), None);
        assert!(fragments.has_taken());
        assert_eq!(add(&mut fragments, &piece(5, 3, &udp[24..])), Some((0..24).collect()));
        // one piece of the other is missing
        assert_eq!(add(&mut fragments, &piece(6, 3, &udp[24..])), None);
        assert!(fragments.waiting.is_empty());
        assert_eq!(add(&mut fragments, &piece(7, 0, &udp)), Some((0..24).collect()));
    }

    proptest! {
        #[test]
        fn any_bytes(packets in prop::collection::vec((0..4_u16, 0..0x3fff_u16, prop::collection::vec(any::<u8>(), 0..40)), 0..60)) {
            let mut fragments = Fragments::default();
            for (id, place, body) in packets {
                add(&mut fragments, &piece(id, place & 0x2003, &body));
                add(&mut fragments, &body);
                prop_assert!(fragments.waiting.len() <= WAITING_MAX);
            }
        }
    }
}
