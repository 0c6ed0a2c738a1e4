//! What robots send each other, as bytes.
//!
//! | bytes | what |
//! |---|---|
//! | 4 | `MWF` and the version of the protocol, 3 |
//! | 1 | 1 beat, 2 ask, 3 records, 4 equivocation |
//! | rest | as in the type of that name; all numbers little endian |

use crate::bytes::Cursor;
use crate::intent::NOTE_AT_MOST;
use crate::keys::{SIGNATURE_BYTES, Secret};
use crate::record::{ChainId, Equivocation, Record};

/// Bytes of a message: longer ones are refused unread.
pub const MESSAGE_AT_MOST: usize = (1 << 20) + (1 << 16);
/// Records that one answer holds.
pub const RECORDS_AT_MOST: usize = 64;
/// Chains that a beat may name.
pub(crate) const CHAINS_AT_MOST: usize = 4096;

const MAGIC: [u8; 4] = *b"MWF\x03";
const DOMAIN: &[u8] = b"mapwright fleet beat 2\n";

/// A robot is alive, and holds so much.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Beat {
    /// Who says so.
    pub from: ChainId,
    /// Counts up in a session.
    pub number: u64,
    /// Of each chain it holds, the number of the record that comes next.
    pub holds: Vec<(ChainId, u32)>,
    /// What else it says: where it is and where it goes.
    pub note: Vec<u8>,
    /// The robot's, of all above.
    pub signature: [u8; SIGNATURE_BYTES],
}

impl Beat {
    pub(crate) fn sign(secret: &Secret, from: ChainId, number: u64, holds: Vec<(ChainId, u32)>, note: Vec<u8>) -> Self {
        let mut beat = Self { from, number, holds, note, signature: [0; SIGNATURE_BYTES] };
        beat.signature = secret.sign(&beat.signed());
        beat
    }

    /// What the signature is of.
    pub(crate) fn signed(&self) -> Vec<u8> {
        let mut out = DOMAIN.to_vec();
        self.put(&mut out);
        out
    }

    fn put(&self, out: &mut Vec<u8>) {
        put_chain(out, self.from);
        out.extend_from_slice(&self.number.to_le_bytes());
        out.extend_from_slice(&(self.holds.len() as u32).to_le_bytes());
        for (chain, next) in &self.holds {
            put_chain(out, *chain);
            out.extend_from_slice(&next.to_le_bytes());
        }
        out.push(self.note.len() as u8);
        out.extend_from_slice(&self.note);
    }
}

/// A message.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Message {
    Beat(Beat),
    /// Who is asked for which records of a chain, from the first on.
    Ask {
        from: u16,
        to: u16,
        chain: ChainId,
        first: u32,
        count: u32,
    },
    Records {
        chain: ChainId,
        first: u32,
        records: Vec<Record>,
    },
    Equivocation(Box<Equivocation>),
}

fn put_chain(out: &mut Vec<u8>, chain: ChainId) {
    out.extend_from_slice(&chain.rank.to_le_bytes());
    out.extend_from_slice(&chain.session.to_le_bytes());
}

fn take_chain(from: &mut Cursor<'_>) -> Option<ChainId> {
    Some(ChainId { rank: from.u16()?, session: from.u32()? })
}

impl Message {
    pub(crate) fn encode(&self) -> Vec<u8> {
        let mut out = MAGIC.to_vec();
        match self {
            Self::Beat(beat) => {
                out.push(1);
                beat.put(&mut out);
                out.extend_from_slice(&beat.signature);
            }
            Self::Ask { from, to, chain, first, count } => {
                out.push(2);
                out.extend_from_slice(&from.to_le_bytes());
                out.extend_from_slice(&to.to_le_bytes());
                put_chain(&mut out, *chain);
                out.extend_from_slice(&first.to_le_bytes());
                out.extend_from_slice(&count.to_le_bytes());
            }
            Self::Records { chain, first, records } => {
                out.push(3);
                put_chain(&mut out, *chain);
                out.extend_from_slice(&first.to_le_bytes());
                records.iter().for_each(|record| record.put(&mut out));
            }
            Self::Equivocation(proof) => {
                out.push(4);
                put_chain(&mut out, proof.chain);
                out.extend_from_slice(&proof.seq.to_le_bytes());
                for (head, signature) in &proof.heads {
                    out.extend_from_slice(&(head.len() as u32).to_le_bytes());
                    out.extend_from_slice(head);
                    out.extend_from_slice(signature);
                }
            }
        }
        out
    }

    /// The message that these bytes are.
    ///
    /// # Errors
    /// What is wrong with them, for who counts.
    pub(crate) fn decode(bytes: &[u8]) -> Result<Self, Refusal> {
        if bytes.len() > MESSAGE_AT_MOST {
            return Err(Refusal::TooLong);
        }
        let mut from = Cursor(bytes);
        match from.array::<4>() {
            Some(MAGIC) => {}
            Some([b'M', b'W', b'F', _]) => return Err(Refusal::OtherVersion),
            _ => return Err(Refusal::Malformed),
        }
        let message = Self::take(&mut from).ok_or(Refusal::Malformed)?;
        if from.is_empty() { Ok(message) } else { Err(Refusal::Malformed) }
    }

    fn take(from: &mut Cursor<'_>) -> Option<Self> {
        match from.u8()? {
            1 => {
                let (sender, number) = (take_chain(from)?, from.u64()?);
                let count = from.u32()? as usize;
                (count <= CHAINS_AT_MOST).then_some(())?;
                let holds = (0..count).map(|_| Some((take_chain(from)?, from.u32()?))).collect::<Option<_>>()?;
                let length = usize::from(from.u8()?);
                (length <= NOTE_AT_MOST).then_some(())?;
                let note = from.take(length)?.to_vec();
                Some(Self::Beat(Beat { from: sender, number, holds, note, signature: from.array()? }))
            }
            2 => {
                let (sender, to, chain) = (from.u16()?, from.u16()?, take_chain(from)?);
                Some(Self::Ask { from: sender, to, chain, first: from.u32()?, count: from.u32()? })
            }
            3 => {
                let (chain, first) = (take_chain(from)?, from.u32()?);
                let mut records = Vec::new();
                while !from.is_empty() {
                    (records.len() < RECORDS_AT_MOST).then_some(())?;
                    records.push(Record::take(from)?);
                }
                Some(Self::Records { chain, first, records })
            }
            4 => {
                let (chain, seq) = (take_chain(from)?, from.u32()?);
                let mut head = || {
                    let bytes = from.u32()? as usize;
                    Some((from.take(bytes)?.to_vec(), from.array()?))
                };
                Some(Self::Equivocation(Box::new(Equivocation { chain, seq, heads: [head()?, head()?] })))
            }
            _ => None,
        }
    }
}

/// Why something that came in is not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum Refusal {
    /// Longer than [`MESSAGE_AT_MOST`].
    TooLong,
    /// Of another version of the protocol.
    OtherVersion,
    /// No message, or one that is cut or has bytes too many.
    Malformed,
    /// Of a robot that is not in the roster.
    Unknown,
    /// Not signed by the robot that it says it is of.
    Forged,
    /// A beat that is much older than the last one.
    Replayed,
    /// Of this robot itself, which has not said it: another one has its key, or it has lost its log.
    OwnName,
    /// Of a robot that has told different robots different things.
    Equivocator,
    /// More records, or more bytes, than a robot may have said.
    TooMuch,
    /// A payload that does not hold what it says.
    BadPayload,
    /// Entries that do not fit the map of all, as of a run whose name is there already.
    Unfitting,
    /// What it says of its way does not fit what it has seen.
    Contradicted,
    /// A map of all that does not follow from what it is made of.
    Untrue,
}

impl Refusal {
    /// In words.
    #[must_use]
    pub fn words(self) -> &'static str {
        match self {
            Self::TooLong => "longer than a message may be",
            Self::OtherVersion => "of another version of the protocol",
            Self::Malformed => "not a whole message",
            Self::Unknown => "of a robot that is not in the team",
            Self::Forged => "not signed by the robot named",
            Self::Replayed => "sent before",
            Self::OwnName => "in this robot's own name",
            Self::Equivocator => "of a robot that contradicts itself",
            Self::TooMuch => "more than a robot may send",
            Self::BadPayload => "a payload that cannot be read",
            Self::Unfitting => "entries that do not fit the map of all",
            Self::Contradicted => "says of its way what its readings contradict",
            Self::Untrue => "a map of all that does not follow from what all have seen",
        }
    }
}
