//! What can go wrong, in words.

/// Why there is no wire, or no certificate.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum NetError {
    /// Something that was to be a certificate or a key.
    #[error("expected {expected}, found {found}")]
    Unreadable {
        /// What should be there.
        expected: &'static str,
        /// What is.
        found: String,
    },
    /// A certificate of another robot.
    #[error("expected a certificate of {expected}, found one of {found}")]
    OtherName {
        /// The robot.
        expected: String,
        /// Common name of the certificate.
        found: String,
    },
    /// A certificate of another authority.
    #[error("expected a certificate that this team's authority has signed, found one that it has not")]
    OtherAuthority,
    /// A private key that does not belong to the certificate.
    #[error("expected the private key of the certificate, found that of another one")]
    OtherKey,
    /// A certificate that is not valid now.
    #[error(
        "expected a certificate that is valid now, found one valid from {from} to {to}; this computer's clock says {now}"
    )]
    NotValid {
        /// The first moment.
        from: String,
        /// The last moment.
        to: String,
        /// What the clock says.
        now: String,
    },
    /// A name that cannot be part of a key.
    #[error("expected a name of letters, digits, - and _, 64 at most, found {found:?}")]
    Name {
        /// The name.
        found: String,
    },
    /// An address that is none.
    #[error("expected an address such as tls/192.168.1.7:7447, found {found:?}")]
    Address {
        /// The address.
        found: String,
    },
    /// Zenoh could not listen, or has refused something.
    #[error("{0}")]
    Zenoh(String),
    /// A certificate could not be made.
    #[error("cannot make a certificate: {0}")]
    Made(String),
}
