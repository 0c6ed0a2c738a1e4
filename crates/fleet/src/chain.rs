//! The records of one robot, of one time that it was switched on.

use crate::keys::Roster;
use crate::record::{ChainId, Equivocation, Hash, Record, hash_of};

/// A chain of records as far as it is there.
#[derive(Debug, Clone, Default)]
pub struct Chain {
    records: Vec<Record>,
    /// Of each record's head: what the next one names.
    hashes: Vec<Hash>,
    bytes: usize,
}

/// What became of a record that came in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Added {
    New,
    Known,
    /// Some before it are missing.
    Gap,
    /// Not signed by the robot, or not made after the one before.
    Forged,
    /// The robot has signed another one for this place.
    Equivocates(Box<Equivocation>),
}

impl Chain {
    /// The records, in order.
    #[must_use]
    pub fn records(&self) -> &[Record] {
        &self.records
    }

    /// How many there are: the number of the one that comes next.
    #[must_use]
    pub fn next(&self) -> u32 {
        self.records.len() as u32
    }

    /// Bytes of all records, as in messages of their own.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.bytes
    }

    /// What a record names as the one before.
    pub(crate) fn previous(&self, seq: u32) -> Hash {
        (seq as usize).checked_sub(1).and_then(|before| self.hashes.get(before)).copied().unwrap_or_default()
    }

    pub(crate) fn add(&mut self, roster: &Roster, chain: ChainId, seq: u32, record: Record) -> Added {
        let next = self.next();
        if seq > next {
            return Added::Gap;
        }
        let head = record.head(chain, seq, &self.previous(seq));
        if let Some(known) = self.records.get(seq as usize) {
            if *known == record {
                return Added::Known;
            }
            if !roster.has_signed(chain.rank, &head, &record.signature) {
                return Added::Forged;
            }
            let known_head = known.head(chain, seq, &self.previous(seq));
            if known_head == head {
                return Added::Known;
            }
            let heads = [(known_head, known.signature), (head, record.signature)];
            return Added::Equivocates(Box::new(Equivocation { chain, seq, heads }));
        }
        if !roster.has_signed(chain.rank, &head, &record.signature) {
            return Added::Forged;
        }
        self.push(&head, record);
        Added::New
    }

    pub(crate) fn push(&mut self, head: &[u8], record: Record) {
        self.bytes += record.message_bytes();
        self.hashes.push(hash_of(head));
        self.records.push(record);
    }
}
