//! How participants, their readers and their writers are called (9.3.1).

/// The first twelve bytes of every number that a participant gives.
pub(crate) type Prefix = [u8; 12];
/// The last four: which of a participant's readers and writers.
pub(crate) type EntityId = [u8; 4];

/// The number of a reader or a writer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Guid {
    pub(crate) prefix: Prefix,
    pub(crate) entity: EntityId,
}

impl Guid {
    pub(crate) fn read(bytes: [u8; 16]) -> Self {
        let (mut prefix, mut entity) = ([0; 12], [0; 4]);
        prefix.copy_from_slice(&bytes[..12]);
        entity.copy_from_slice(&bytes[12..]);
        Self { prefix, entity }
    }

    pub(crate) fn bytes(self) -> [u8; 16] {
        let mut bytes = [0; 16];
        bytes[..12].copy_from_slice(&self.prefix);
        bytes[12..].copy_from_slice(&self.entity);
        bytes
    }
}

/// Any reader or writer.
pub(crate) const ANY: EntityId = [0; 4];

/// The version that all makers speak (2.3), and no maker's number.
pub(crate) const VERSION: [u8; 2] = [2, 3];
pub(crate) const VENDOR: [u8; 2] = [0, 0];
