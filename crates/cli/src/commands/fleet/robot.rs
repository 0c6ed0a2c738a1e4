//! What a robot of a team has on disk: `robot.toml`, and what that names.

use crate::failure::Failure;
use mapwright::Settings;
use mapwright_fleet::{Roster, Secret};
use mapwright_net::Credentials;
use serde::Deserialize;
use std::fs;
use std::path::{Path, PathBuf};

/// `robot.toml`; paths are relative to it.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct RobotToml {
    name: String,
    #[serde(default = "default_team")]
    team: PathBuf,
    #[serde(default = "default_certificate")]
    certificate: PathBuf,
    #[serde(default = "default_authority")]
    authority: PathBuf,
    #[serde(default = "default_private_key")]
    private_key: PathBuf,
    #[serde(default = "default_signing_key")]
    signing_key: PathBuf,
    #[serde(default = "default_state")]
    state: PathBuf,
    #[serde(default)]
    listen: Vec<String>,
    connect: Option<Vec<String>>,
    #[serde(default)]
    relays: Vec<String>,
    #[serde(default)]
    settings: Settings,
}

pub(super) const TEAM: &str = "team.toml";
pub(super) const ROBOT: &str = "robot.toml";
pub(super) const CERTIFICATE: &str = "certificate.pem";
pub(super) const AUTHORITY: &str = "authority.pem";
pub(super) const PRIVATE_KEY: &str = "private.pem";
pub(super) const SIGNING_KEY: &str = "signing.key";

fn default_team() -> PathBuf {
    TEAM.into()
}

fn default_certificate() -> PathBuf {
    CERTIFICATE.into()
}

fn default_authority() -> PathBuf {
    AUTHORITY.into()
}

fn default_private_key() -> PathBuf {
    PRIVATE_KEY.into()
}

fn default_signing_key() -> PathBuf {
    SIGNING_KEY.into()
}

fn default_state() -> PathBuf {
    "state".into()
}

/// `team.toml`: the same on all robots.
#[derive(Debug, Clone, Default, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TeamToml {
    pub(super) team: String,
    #[serde(default)]
    pub(super) robot: Vec<MemberToml>,
}

/// A robot in it.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MemberToml {
    pub(super) name: String,
    /// Where the others find it.
    pub(super) address: String,
    /// What it signs with: the public half, in hexadecimal.
    pub(super) key: String,
}

impl TeamToml {
    pub(super) fn read(path: &Path) -> Result<Self, Failure> {
        parse(path)
    }

    /// The same as text.
    pub(super) fn to_toml(&self) -> String {
        let mut text =
            String::from("# The robots of a team: the same file on each of them. Nothing in it is secret.\n");
        text += &format!("team = \"{}\"\n", self.team);
        for MemberToml { name, address, key } in &self.robot {
            text += &format!("\n[[robot]]\nname = \"{name}\"\naddress = \"{address}\"\nkey = \"{key}\"\n");
        }
        text
    }
}

/// A robot of a team: all that it needs, read and checked.
pub(super) struct RobotFiles {
    pub(super) name: String,
    pub(super) team: TeamToml,
    pub(super) roster: Roster,
    pub(super) secret: Secret,
    pub(super) credentials: Credentials,
    /// Folder of what it must not forget.
    pub(super) state: PathBuf,
    pub(super) listen: Vec<String>,
    pub(super) connect: Vec<String>,
    pub(super) relays: Vec<String>,
    pub(super) settings: Settings,
}

impl RobotFiles {
    pub(super) fn read(path: &Path) -> Result<Self, Failure> {
        let robot: RobotToml = parse(path)?;
        let beside = |name: &Path| path.parent().unwrap_or(Path::new("")).join(name);
        let wrong = |file: &Path, cause: String| Failure::Config { path: file.to_owned(), cause };
        let team_path = beside(&robot.team);
        let team = TeamToml::read(&team_path)?;
        let keys = team.robot.iter().map(|member| Ok((member.name.clone(), key_of(member)?)));
        let keys: Result<Vec<_>, String> = keys.collect();
        let roster = keys.and_then(|keys| Roster::new(keys).map_err(|cause| cause.to_string()));
        let roster = roster.map_err(|cause| wrong(&team_path, cause))?;
        let Some(own) = team.robot.iter().find(|member| member.name == robot.name) else {
            let names: Vec<&str> = team.robot.iter().map(|member| member.name.as_str()).collect();
            let cause = format!("expected {} among the robots of the team, found {}", robot.name, names.join(", "));
            return Err(wrong(&team_path, cause));
        };
        let signing_key = beside(&robot.signing_key);
        let secret = unhex(secret_in(&signing_key)?.trim())
            .ok_or_else(|| wrong(&signing_key, "expected a signing key of 64 hexadecimal digits".to_owned()))?;
        let secret = Secret::from_bytes(&secret);
        if hex(&secret.public()) != own.key {
            let owner = team.robot.iter().find(|member| member.key == hex(&secret.public()));
            let found = owner.map_or("one of nobody in the team", |member| member.name.as_str());
            let cause = format!("expected the signing key of {}, found that of {found}", robot.name);
            return Err(wrong(&signing_key, if owner.is_some() { cause } else { cause.replace("that of ", "") }));
        }
        let [certificate, private_key, authority] =
            [&robot.certificate, &robot.private_key, &robot.authority].map(|file| beside(file));
        let credentials =
            Credentials::new(&robot.name, &text_in(&certificate)?, &secret_in(&private_key)?, &text_in(&authority)?);
        let credentials = credentials.map_err(|cause| wrong(&certificate, cause.to_string()))?;
        // Of two robots the later one looks for the other: two links at once between the same two get into each other's way.
        let before = team.robot.iter().filter(|member| member.name < robot.name);
        let connect = robot.connect.unwrap_or_else(|| before.map(|member| member.address.clone()).collect());
        let state = beside(&robot.state);
        let RobotToml { name, listen, relays, settings, .. } = robot;
        settings.validate()?;
        Ok(Self { name, team, roster, secret, credentials, state, listen, connect, relays, settings })
    }

    /// Names of all robots of the team, in the roster's order.
    pub(super) fn names(&self) -> Vec<String> {
        self.roster.members().iter().map(|member| member.name.clone()).collect()
    }
}

fn parse<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T, Failure> {
    let text = text_in(path)?;
    let parsed: Result<T, toml::de::Error> = toml::from_str(&text);
    parsed.map_err(|error| Failure::Config { path: path.to_owned(), cause: error.to_string().trim_end().to_owned() })
}

fn text_in(path: &Path) -> Result<String, Failure> {
    fs::read_to_string(path).map_err(|error| Failure::open(path, error))
}

/// A file that its owner alone may read: others could speak in the robot's name.
fn secret_in(path: &Path) -> Result<String, Failure> {
    let metadata = fs::metadata(path).map_err(|error| Failure::open(path, error))?;
    if let Some(mode) = read_by_others(&metadata) {
        let cause = format!(
            "expected a secret that its owner alone may read (0600), found {mode:04o}: chmod 600 {}",
            path.display()
        );
        return Err(Failure::Config { path: path.to_owned(), cause });
    }
    text_in(path)
}

#[cfg(unix)]
fn read_by_others(metadata: &fs::Metadata) -> Option<u32> {
    use std::os::unix::fs::PermissionsExt;
    let mode = metadata.permissions().mode() & 0o7777;
    (mode & 0o077 != 0).then_some(mode)
}

/// Elsewhere who may read a file is not told by a mode.
#[cfg(not(unix))]
fn read_by_others(_: &fs::Metadata) -> Option<u32> {
    None
}

fn key_of(member: &MemberToml) -> Result<[u8; 32], String> {
    unhex(&member.key).ok_or_else(|| format!("expected a key of 64 hexadecimal digits of {}", member.name))
}

pub(super) fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn unhex(text: &str) -> Option<[u8; 32]> {
    let is_hex = text.len() == 64 && text.bytes().all(|byte| byte.is_ascii_hexdigit());
    let byte = |at: usize| u8::from_str_radix(text.get(2 * at..2 * at + 2)?, 16).ok();
    let bytes: Option<Vec<u8>> = (0..32).map(byte).collect();
    bytes.filter(|_| is_hex)?.try_into().ok()
}
