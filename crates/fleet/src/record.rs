//! Records: what a robot says for good, each signed and tied to the one before.

use crate::bytes::Cursor;
use crate::keys::{Roster, SIGNATURE_BYTES, Secret};
use sha2::{Digest, Sha256};
use std::sync::Arc;

/// Bytes that a record may carry.
pub const PAYLOAD_AT_MOST: usize = 1 << 20;

/// SHA-256.
pub type Hash = [u8; 32];

/// What every signature begins with, so that one of a record is never one of something else.
const DOMAIN: &[u8] = b"mapwright fleet record 1\n";

/// Which robot's records, of which of its sessions: each of them is a chain.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct ChainId {
    /// The robot's place in the roster.
    pub rank: u16,
    /// Which time it was switched on.
    pub session: u32,
}

/// What a record carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum Kind {
    /// Entries of the robot's own session, compressed.
    Entries,
    /// What was found among the maps of several robots, by the one that solves.
    Solution,
    /// What the robot saw of others.
    Sightings,
}

impl Kind {
    pub(crate) fn code(self) -> u8 {
        match self {
            Self::Entries => 1,
            Self::Solution => 2,
            Self::Sightings => 3,
        }
    }

    pub(crate) fn from_code(code: u8) -> Option<Self> {
        match code {
            1 => Some(Self::Entries),
            2 => Some(Self::Solution),
            3 => Some(Self::Sightings),
            _ => None,
        }
    }
}

/// A record.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Record {
    /// What it carries.
    pub kind: Kind,
    /// The bytes.
    pub payload: Arc<[u8]>,
    /// The robot's, of what is signed: whose record it is, which one, what came before it, and what it carries.
    pub signature: [u8; SIGNATURE_BYTES],
}

/// What is signed: whose record it is, which one, what came before it, and what it carries.
pub(crate) fn head(chain: ChainId, seq: u32, previous: &Hash, kind: Kind, payload: &Hash, bytes: u32) -> Vec<u8> {
    let mut head = DOMAIN.to_vec();
    head.extend_from_slice(&chain.rank.to_le_bytes());
    head.extend_from_slice(&chain.session.to_le_bytes());
    head.extend_from_slice(&seq.to_le_bytes());
    head.extend_from_slice(previous);
    head.push(kind.code());
    head.extend_from_slice(payload);
    head.extend_from_slice(&bytes.to_le_bytes());
    head
}

pub(crate) fn hash_of(bytes: &[u8]) -> Hash {
    Sha256::digest(bytes).into()
}

impl Record {
    pub(crate) fn sign(
        secret: &Secret,
        chain: ChainId,
        seq: u32,
        previous: &Hash,
        kind: Kind,
        payload: Vec<u8>,
    ) -> Self {
        let head = head(chain, seq, previous, kind, &hash_of(&payload), payload.len() as u32);
        Self { kind, payload: payload.into(), signature: secret.sign(&head) }
    }

    pub(crate) fn head(&self, chain: ChainId, seq: u32, previous: &Hash) -> Vec<u8> {
        head(chain, seq, previous, self.kind, &hash_of(&self.payload), self.payload.len() as u32)
    }

    pub(crate) fn put(&self, out: &mut Vec<u8>) {
        out.push(self.kind.code());
        out.extend_from_slice(&(self.payload.len() as u32).to_le_bytes());
        out.extend_from_slice(&self.signature);
        out.extend_from_slice(&self.payload);
    }

    pub(crate) fn take(from: &mut Cursor<'_>) -> Option<Self> {
        let kind = Kind::from_code(from.u8()?)?;
        let bytes = from.u32()? as usize;
        let signature = from.array()?;
        (bytes <= PAYLOAD_AT_MOST).then_some(())?;
        Some(Self { kind, payload: from.take(bytes)?.into(), signature })
    }

    /// Bytes that it takes in a message of its own.
    #[must_use]
    pub fn message_bytes(&self) -> usize {
        15 + self.wire_bytes()
    }

    /// Bytes that it takes in a message beside others.
    pub(crate) fn wire_bytes(&self) -> usize {
        5 + SIGNATURE_BYTES + self.payload.len()
    }
}

/// Two records of a robot that say they are the same one: it has told different robots different things.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Equivocation {
    /// Whose.
    pub chain: ChainId,
    /// Which record.
    pub seq: u32,
    /// Both, by what was signed and the signature.
    pub heads: [(Vec<u8>, [u8; SIGNATURE_BYTES]); 2],
}

impl Equivocation {
    /// Whether both were signed by the robot, are of this place, and differ.
    pub(crate) fn holds(&self, roster: &Roster) -> bool {
        let mut place = DOMAIN.to_vec();
        place.extend_from_slice(&self.chain.rank.to_le_bytes());
        place.extend_from_slice(&self.chain.session.to_le_bytes());
        place.extend_from_slice(&self.seq.to_le_bytes());
        let is_signed = |(head, signature): &(Vec<u8>, _)| {
            head.starts_with(&place) && roster.has_signed(self.chain.rank, head, signature)
        };
        self.heads[0].0 != self.heads[1].0 && self.heads.iter().all(is_signed)
    }
}
