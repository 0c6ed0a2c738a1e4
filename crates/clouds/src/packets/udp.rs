//! What a packet of a network carries by UDP.

use crate::packets::capture::Packet;
use crate::scalar::array;

const ETHERNET: u32 = 1;
const RAW_IP: u32 = 101;
const LINUX_COOKED: u32 = 113;
const IPV4: u16 = 0x0800;
/// Tags of virtual networks.
const TAGS: [u16; 2] = [0x8100, 0x88a8];
const UDP: u8 = 17;

/// A datagram.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Datagram<'a> {
    pub(crate) source: [u8; 4],
    pub(crate) port: u16,
    /// Bytes that it says that it has.
    pub(crate) claimed: usize,
    pub(crate) payload: &'a [u8],
}

/// The datagram in a packet; none where it holds something else.
pub(crate) fn datagram<'a>(packet: &Packet<'a>) -> Option<Datagram<'a>> {
    let mut ip = match packet.link {
        ETHERNET => packet.bytes.get(12..)?,
        LINUX_COOKED => packet.bytes.get(14..)?,
        RAW_IP => return of_ip(packet.bytes),
        _ => return None,
    };
    while let Some(kind) = array(ip, 0).map(u16::from_be_bytes) {
        ip = ip.get(2..)?;
        if kind == IPV4 {
            return of_ip(ip);
        }
        if !TAGS.contains(&kind) {
            return None;
        }
        ip = ip.get(2..)?;
    }
    None
}

fn of_ip(ip: &[u8]) -> Option<Datagram<'_>> {
    let header = usize::from(ip.first()? & 15) * 4;
    let is_whole = u16::from_be_bytes(array(ip, 6)?) & 0x3fff == 0; // neither a fragment nor the first of several
    if ip[0] >> 4 != 4 || *ip.get(9)? != UDP || !is_whole {
        return None;
    }
    let udp = ip.get(header..)?;
    let claimed = usize::from(u16::from_be_bytes(array(udp, 4)?)).checked_sub(8)?;
    let payload = udp.get(8..)?;
    Some(Datagram {
        source: array(ip, 12)?,
        port: u16::from_be_bytes(array(udp, 2)?),
        claimed,
        payload: payload.get(..claimed).unwrap_or(payload),
    })
}
