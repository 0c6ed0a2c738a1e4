//! Packets that are to be sent.

use crate::ids::Prefix;
use crate::message::Outgoing;
use std::net::SocketAddrV4;

/// Where a packet goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum To {
    /// To all who hear of participants.
    All,
    One(SocketAddrV4),
}

/// Packets that are to be sent.
#[derive(Debug, Default)]
pub(crate) struct Packets(pub(crate) Vec<(To, Vec<u8>)>);

impl Packets {
    pub(crate) fn send(&mut self, to: &[SocketAddrV4], from: Prefix, peer: Prefix, fill: impl FnOnce(&mut Outgoing)) {
        let mut message = Outgoing::new(from, Some(peer));
        fill(&mut message);
        let bytes = message.bytes();
        self.0.extend(to.iter().map(|to| (To::One(*to), bytes.clone())));
    }
}
