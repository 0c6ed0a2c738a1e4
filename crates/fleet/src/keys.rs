//! Who is in the team, and with what they sign.

use ed25519_dalek::{Signature, Signer, SigningKey, VerifyingKey};
use mapwright_record::RunId;
use std::fmt;

/// Bytes of a signature.
pub const SIGNATURE_BYTES: usize = 64;

/// A robot's secret: with it what it says is signed. It is never shown.
#[derive(Clone)]
pub struct Secret(SigningKey);

impl Secret {
    /// The secret that these 32 bytes are: random ones, kept where only the robot can read them.
    #[must_use]
    pub fn from_bytes(bytes: &[u8; 32]) -> Self {
        Self(SigningKey::from_bytes(bytes))
    }

    /// What others check its signatures with.
    #[must_use]
    pub fn public(&self) -> [u8; 32] {
        self.0.verifying_key().to_bytes()
    }

    pub(crate) fn sign(&self, bytes: &[u8]) -> [u8; SIGNATURE_BYTES] {
        self.0.sign(bytes).to_bytes()
    }
}

impl fmt::Debug for Secret {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("Secret(..)")
    }
}

/// A robot of the team.
#[derive(Debug, Clone)]
pub struct Member {
    /// What it is called.
    pub name: String,
    key: VerifyingKey,
}

/// The robots of a team, by their names: the first one alive solves, and its frame is the map's.
#[derive(Debug, Clone)]
pub struct Roster {
    members: Vec<Member>,
}

/// Why robots are no team.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RosterError {
    /// Two robots of one name, or of names that are one to the map.
    #[error("expected a name of its own for each robot, found {name} twice")]
    TwiceNamed {
        /// The name.
        name: String,
    },
    /// A key is none.
    #[error("expected an ed25519 key of {name}, found 32 bytes that are none")]
    NoKey {
        /// Whose.
        name: String,
    },
    /// One key for two robots: one could speak for the other.
    #[error("expected a key of its own for each robot, found one of {first} and {second}")]
    TwiceUsed {
        /// One of them.
        first: String,
        /// The other.
        second: String,
    },
    /// More than a team may have.
    #[error("expected {at_most} robots at most, found {found}")]
    TooMany {
        /// How many there may be.
        at_most: usize,
        /// How many there are.
        found: usize,
    },
}

impl Roster {
    /// Robots that a team may have.
    pub const AT_MOST: usize = 1000;

    /// A team of robots with these names and public keys.
    ///
    /// # Errors
    /// Two robots of one name or key, a key that is none, more than [`Roster::AT_MOST`].
    pub fn new(robots: impl IntoIterator<Item = (String, [u8; 32])>) -> Result<Self, RosterError> {
        let mut robots: Vec<(String, [u8; 32])> = robots.into_iter().collect();
        if robots.len() > Self::AT_MOST {
            return Err(RosterError::TooMany { at_most: Self::AT_MOST, found: robots.len() });
        }
        robots.sort();
        for (at, (name, key)) in robots.iter().enumerate() {
            for (other, other_key) in &robots[..at] {
                if RunId::of_robot(other).robot == RunId::of_robot(name).robot {
                    return Err(RosterError::TwiceNamed { name: name.clone() });
                }
                if other_key == key {
                    return Err(RosterError::TwiceUsed { first: other.clone(), second: name.clone() });
                }
            }
        }
        let member = |(name, key): (String, [u8; 32])| match VerifyingKey::from_bytes(&key) {
            Ok(key) => Ok(Member { name, key }),
            Err(_) => Err(RosterError::NoKey { name }),
        };
        Ok(Self { members: robots.into_iter().map(member).collect::<Result<_, _>>()? })
    }

    /// The robots, by name.
    #[must_use]
    pub fn members(&self) -> &[Member] {
        &self.members
    }

    /// The place of a robot among them.
    #[must_use]
    pub fn rank(&self, name: &str) -> Option<u16> {
        self.members.iter().position(|member| member.name == name).map(|rank| rank as u16)
    }

    /// Name of the robot at a place.
    #[must_use]
    pub fn name(&self, rank: u16) -> Option<&str> {
        Some(&self.members.get(usize::from(rank))?.name)
    }

    /// Whether the robot has signed these bytes.
    pub(crate) fn has_signed(&self, rank: u16, bytes: &[u8], signature: &[u8; SIGNATURE_BYTES]) -> bool {
        let member = self.members.get(usize::from(rank));
        member.is_some_and(|member| member.key.verify_strict(bytes, &Signature::from_bytes(signature)).is_ok())
    }
}
