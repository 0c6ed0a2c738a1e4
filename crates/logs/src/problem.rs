//! What is wrong with a message.

/// Why a message is no reading.
#[derive(Debug)]
pub(crate) enum Problem {
    Undecodable(String),
    Unusable(String),
}
