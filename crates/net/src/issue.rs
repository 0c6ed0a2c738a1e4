//! Making keys and certificates.

use crate::credentials::{certificate_in, is_team_name, key_in};
use crate::error::NetError;
use rcgen::{
    BasicConstraints, CertificateParams, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer, KeyPair, KeyUsagePurpose,
    SerialNumber,
};
use ring::rand::{SecureRandom, SystemRandom};
use std::time::{Duration, SystemTime};

/// Clocks of robots may differ by so much: certificates are valid from before they were made.
const CLOCKS_APART: Duration = Duration::from_secs(48 * 3600);
const DAY_S: u64 = 86_400;

/// Random bytes for a secret.
///
/// # Errors
/// The system has none.
pub fn random_bytes() -> Result<[u8; 32], NetError> {
    let mut bytes = [0; 32];
    let filled = SystemRandom::new().fill(&mut bytes);
    filled.map(|()| bytes).map_err(|_| NetError::Made("the system gives no random bytes".to_owned()))
}

/// A certificate and its private key, as PEM.
#[derive(Clone)]
pub struct Issued {
    /// For everybody.
    pub certificate_pem: String,
    /// For its owner alone.
    pub private_key_pem: String,
}

/// Who says which certificates are of the team; it is needed to make more of them, and nowhere else.
pub struct Authority {
    issuer: Issuer<'static, KeyPair>,
    certificate_pem: String,
}

impl Authority {
    /// A new one, for so many days.
    ///
    /// # Errors
    /// A team's name that is none, or no random numbers.
    pub fn new(team: &str, days: u32) -> Result<Self, NetError> {
        let key = KeyPair::generate().map_err(made)?;
        let params = params_of(team, days)?;
        let certificate_pem = params.self_signed(&key).map_err(made)?.pem();
        Ok(Self { issuer: Issuer::new(params, key), certificate_pem })
    }

    /// The one that was made before, from its files.
    ///
    /// # Errors
    /// What they hold is no certificate or key, or the two do not belong together, or are of another team.
    pub fn read(team: &str, certificate_pem: &str, private_key_pem: &str) -> Result<Self, NetError> {
        let key = key_in(private_key_pem)?;
        let own = certificate_in(certificate_pem, "the authority's certificate")?;
        if !own.is_of_key(&key) {
            return Err(NetError::OtherKey);
        }
        let params = params_of(team, 1)?;
        let expected = common_name(team);
        let found = own.common_name()?;
        if found != expected {
            return Err(NetError::OtherName { expected, found });
        }
        Ok(Self { issuer: Issuer::new(params, key), certificate_pem: certificate_pem.to_owned() })
    }

    /// Its certificate, which every robot has.
    #[must_use]
    pub fn certificate_pem(&self) -> &str {
        &self.certificate_pem
    }

    /// Its private key.
    #[must_use]
    pub fn private_key_pem(&self) -> String {
        self.issuer.key().serialize_pem()
    }

    /// A certificate for a robot, for so many days; 0 makes one that is not valid any more.
    ///
    /// # Errors
    /// A name that is none.
    pub fn issue(&self, name: &str, days: u32) -> Result<Issued, NetError> {
        if !is_team_name(name) {
            return Err(NetError::Name { found: name.to_owned() });
        }
        let mut params = named(name, days)?;
        params.use_authority_key_identifier_extension = true;
        params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
        params.extended_key_usages = vec![ExtendedKeyUsagePurpose::ServerAuth, ExtendedKeyUsagePurpose::ClientAuth];
        let key = KeyPair::generate().map_err(made)?;
        let certificate = params.signed_by(&key, &self.issuer).map_err(made)?;
        Ok(Issued { certificate_pem: certificate.pem(), private_key_pem: key.serialize_pem() })
    }
}

fn common_name(team: &str) -> String {
    format!("{team}, authority of mapwright")
}

fn params_of(team: &str, days: u32) -> Result<CertificateParams, NetError> {
    if !is_team_name(team) {
        return Err(NetError::Name { found: team.to_owned() });
    }
    let mut params = named(&common_name(team), days)?;
    params.subject_alt_names.clear();
    params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
    Ok(params)
}

fn named(name: &str, days: u32) -> Result<CertificateParams, NetError> {
    let alternative = if is_team_name(name) { vec![name.to_owned()] } else { Vec::new() };
    let mut params = CertificateParams::new(alternative).map_err(made)?;
    params.distinguished_name = rcgen::DistinguishedName::new();
    params.distinguished_name.push(DnType::CommonName, name);
    let now = SystemTime::now();
    let from = now.checked_sub(CLOCKS_APART).unwrap_or(now);
    let to = now + Duration::from_secs(u64::from(days) * DAY_S);
    (params.not_before, params.not_after) = (from.into(), to.into());
    params.serial_number = Some(SerialNumber::from_slice(&random_bytes()?[..16]));
    Ok(params)
}

fn made(cause: rcgen::Error) -> NetError {
    NetError::Made(cause.to_string())
}
