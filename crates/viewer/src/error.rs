//! Why there is no view.

use std::io;
use std::net::SocketAddr;
use thiserror::Error;

/// Why there is no view.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ViewerError {
    /// The address cannot be listened on.
    #[error("the view cannot listen on {address}: {cause}")]
    Listen {
        /// The address.
        address: SocketAddr,
        /// What the system says.
        cause: io::Error,
    },
    /// Others could look in.
    #[error("the view on {address}, which other machines reach, needs a token")]
    TokenMissing {
        /// The address.
        address: SocketAddr,
    },
    /// A token that can be guessed, or that an address cannot hold.
    #[error("a token of the view has {least} to {most} characters of A-Z a-z 0-9 - _; found {found} characters")]
    Token {
        /// So many at least.
        least: usize,
        /// So many at most.
        most: usize,
        /// So many it has.
        found: usize,
    },
    /// The view's thread does not start.
    #[error("the view's thread does not start: {0}")]
    Thread(#[from] io::Error),
}
