//! Why something is no entry.

/// Why an entry cannot be added.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("expected {expected}, found {found}")]
pub struct EntryError {
    /// What the entry should say.
    pub expected: &'static str,
    /// What it says.
    pub found: String,
}

/// An error unless it holds.
pub(crate) fn unless(expected: &'static str, holds: bool, found: impl FnOnce() -> String) -> Result<(), EntryError> {
    if holds { Ok(()) } else { Err(EntryError { expected, found: found() }) }
}
