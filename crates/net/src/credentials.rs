//! What a robot shows to others, and what it checks theirs with.

use crate::error::NetError;
use rcgen::{KeyPair, PublicKeyData};
use std::time::SystemTime;
use x509_parser::pem::parse_x509_pem;
use x509_parser::prelude::{ASN1Time, X509Certificate};
use x509_parser::x509::X509Name;

/// Whether a robot or a team can be called so: it becomes part of Zenoh's keys and of a certificate.
#[must_use]
pub fn is_team_name(name: &str) -> bool {
    let is_plain = |byte: u8| byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_';
    (1..=64).contains(&name.len()) && name.bytes().all(is_plain)
}

/// A robot's certificate, its private key and the certificate of the team's authority; checked, and never shown.
#[derive(Clone)]
pub struct Credentials {
    pub(crate) name: String,
    pub(crate) certificate_pem: String,
    pub(crate) private_key_pem: String,
    pub(crate) authority_pem: String,
    days_left: u64,
}

impl Credentials {
    /// Those of the robot of this name.
    ///
    /// # Errors
    /// What is no certificate or key; a certificate of another name or authority, or not valid now; a key that does not belong to it.
    pub fn new(
        name: &str,
        certificate_pem: &str,
        private_key_pem: &str,
        authority_pem: &str,
    ) -> Result<Self, NetError> {
        let own = certificate_in(certificate_pem, "the robot's certificate as PEM")?;
        let authority = certificate_in(authority_pem, "the authority's certificate as PEM")?;
        let found = own.common_name()?;
        if found != name {
            return Err(NetError::OtherName { expected: name.to_owned(), found });
        }
        if !own.is_of_key(&key_in(private_key_pem)?) {
            return Err(NetError::OtherKey);
        }
        if !own.is_signed_by(&authority)? {
            return Err(NetError::OtherAuthority);
        }
        authority.check_time()?;
        let days_left = own.check_time()?;
        Ok(Self {
            name: name.to_owned(),
            certificate_pem: certificate_pem.to_owned(),
            private_key_pem: private_key_pem.to_owned(),
            authority_pem: authority_pem.to_owned(),
            days_left,
        })
    }

    /// Whole days for which the certificate is still valid.
    #[must_use]
    pub fn days_left(&self) -> u64 {
        self.days_left
    }
}

impl std::fmt::Debug for Credentials {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Credentials of {}", self.name)
    }
}

/// A certificate's bytes.
pub(crate) struct CertificateBytes(Vec<u8>);

/// The certificate in a PEM text.
pub(crate) fn certificate_in(pem: &str, expected: &'static str) -> Result<CertificateBytes, NetError> {
    let unreadable = |found: String| NetError::Unreadable { expected, found };
    let (_, block) = parse_x509_pem(pem.as_bytes()).map_err(|_| unreadable("something else".to_owned()))?;
    if block.label != "CERTIFICATE" {
        return Err(unreadable(format!("a {}", block.label.to_lowercase())));
    }
    let certificate = CertificateBytes(block.contents);
    certificate.parsed()?;
    Ok(certificate)
}

impl CertificateBytes {
    fn parsed(&self) -> Result<X509Certificate<'_>, NetError> {
        let unreadable = NetError::Unreadable { expected: "a certificate", found: "bytes that are none".to_owned() };
        x509_parser::parse_x509_certificate(&self.0).map(|(_, certificate)| certificate).map_err(|_| unreadable)
    }

    pub(crate) fn common_name(&self) -> Result<String, NetError> {
        let certificate = self.parsed()?;
        Ok(common_name_of(certificate.subject()).unwrap_or_default().to_owned())
    }

    pub(crate) fn is_of_key(&self, key: &KeyPair) -> bool {
        self.parsed().is_ok_and(|certificate| certificate.public_key().raw == key.subject_public_key_info())
    }

    fn is_signed_by(&self, authority: &Self) -> Result<bool, NetError> {
        let (own, authority) = (self.parsed()?, authority.parsed()?);
        let has_name = own.issuer() == authority.subject();
        Ok(has_name && own.verify_signature(Some(authority.public_key())).is_ok())
    }

    /// Whole days that are left.
    fn check_time(&self) -> Result<u64, NetError> {
        let certificate = self.parsed()?;
        let (from, to) = (certificate.validity().not_before, certificate.validity().not_after);
        let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let now_s = i64::try_from(since.as_secs()).unwrap_or(i64::MAX);
        if (from.timestamp()..to.timestamp()).contains(&now_s) {
            return Ok((to.timestamp() - now_s).unsigned_abs() / 86_400);
        }
        let now = ASN1Time::from_timestamp(now_s).map_or_else(|_| "nothing".to_owned(), |now| now.to_string());
        Err(NetError::NotValid { from: from.to_string(), to: to.to_string(), now })
    }
}

fn common_name_of<'a>(name: &'a X509Name<'a>) -> Option<&'a str> {
    name.iter_common_name().next().and_then(|part| part.as_str().ok())
}

pub(crate) fn key_in(pem: &str) -> Result<KeyPair, NetError> {
    // The cause is left out: it could say what is in the file.
    KeyPair::from_pem(pem)
        .map_err(|_| NetError::Unreadable { expected: "a private key as PEM", found: "something else".to_owned() })
}
