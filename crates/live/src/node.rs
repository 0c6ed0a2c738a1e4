//! What a ROS 2 node answers: services, parameters, managed states, bonds, diagnostics.
//!
//! All of it is values. Bytes of a request (CDR, with the encapsulation header) go in, bytes of the response come out, and what the node shall do
//! comes out as a value. Nothing here knows a network or a clock: who calls hands the time in.
//!
//! - [`asked`]: the services of slam_toolbox, AMCL and Nav2's map server;
//! - [`parameters`]: parameters by their names there, the services that set them, parameter files;
//! - [`lifecycle`]: the states of a managed node;
//! - [`bond`]: what Nav2's lifecycle manager wants to hear from a node that is active;
//! - [`diagnostics`]: how the node is.

pub mod asked;
pub mod bond;
pub mod diagnostics;
pub mod lifecycle;
mod name;
pub mod parameters;

pub use name::NodeName;

use mapwright_ros::{Cursor, Encoding, Field, RosError, encode};

/// Why a request, a name or a file cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum NodeError {
    /// Bytes that are no such message.
    #[error(transparent)]
    Message(#[from] RosError),
    /// A request whose numbers say nothing.
    #[error("{what}: expected {expected}, found {found}")]
    Request {
        /// Which part.
        what: &'static str,
        /// What it should be.
        expected: &'static str,
        /// What it is.
        found: String,
    },
    /// A node's name that is none.
    #[error("a node's name: expected letters, digits and `_`, with `/` between namespaces, found `{found}`")]
    Name {
        /// It, shortened.
        found: String,
    },
    /// A parameter file that is none, or has a value that cannot be.
    #[error("parameter file, line {line}: expected {expected}, found {found}")]
    File {
        /// Line of the text, from 1; 0 where it is not known.
        line: u64,
        /// What should stand there.
        expected: String,
        /// What stands there.
        found: String,
    },
}

/// What a request is answered.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Answer {
    /// The response.
    pub bytes: Vec<u8>,
    /// Why what was asked for was not done, in words, where the log shall say so.
    pub refusal: Option<String>,
}

/// A message of the standard definition of its type. What follows it says nothing: Fast DDS estimates how long a message may become, and bytes
/// that were serialized by `rmw_serialize` keep what was there behind its end.
fn decode<'a, M: Field<'a>>(bytes: &'a [u8]) -> Result<M, RosError> {
    M::read(&mut Cursor::new(Encoding::Cdr, bytes)?)
}

/// That a request says nothing: some write the byte that DDS asks for, some do not.
fn decode_nothing(bytes: &[u8]) -> Result<(), RosError> {
    Cursor::new(Encoding::Cdr, bytes).map(|_| ())
}

/// The bytes of a message; none where it is longer than CDR can say.
fn bytes_of<'a, M: Field<'a>>(message: &M) -> Vec<u8> {
    encode(message, Encoding::Cdr).unwrap_or_default()
}

/// The beginning of a text that somebody else wrote, for a message.
fn excerpt(text: &str) -> String {
    const MOST: usize = 80;
    let mut short: String = text.chars().take(MOST).collect();
    if short.len() < text.len() {
        short.push_str("...");
    }
    short
}

#[cfg(test)]
mod tests;
