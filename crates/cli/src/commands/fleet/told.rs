//! What a robot says of itself beside its records: for `fleet status`, and for others to see what they do differently.

use mapwright::Settings;
use mapwright_fleet::{Chain, Team};
use mapwright_geom::Stamp;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// What it is sent as.
pub(super) const SUBJECT: &str = "status";

/// Clocks that are further apart are told, seconds; no time of another robot is used.
const CLOCKS_APART_S: f64 = 60.0;

/// A robot's words about itself. What they say is not signed: they come in the name of the certificate.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Told {
    pub(super) version: String,
    pub(super) session: u32,
    /// Settings that are not as by default.
    pub(super) settings: BTreeMap<String, String>,
    pub(super) keyframes: u64,
    /// Keyframes of all robots in its map.
    pub(super) in_map: u64,
    pub(super) solves: bool,
    pub(super) log_is_over: bool,
    pub(super) clock_s: f64,
    pub(super) holds: Vec<Held>,
    pub(super) hears: Vec<Heard>,
    pub(super) links: Vec<String>,
    pub(super) refused: Vec<Refused>,
    pub(super) early: u64,
    /// Messages that found no room: coming in, going out.
    pub(super) dropped: [u64; 2],
}

/// Records of one robot, of one time that it was switched on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Held {
    pub(super) robot: String,
    pub(super) session: u32,
    pub(super) records: u32,
}

/// Another robot, and how long ago it was heard.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Heard {
    pub(super) robot: String,
    pub(super) age_s: f64,
}

/// What was not used.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Refused {
    pub(super) why: String,
    pub(super) of: Option<String>,
    pub(super) times: u64,
}

/// What a robot holds of the team's records.
pub(super) fn held(team: &Team) -> Vec<Held> {
    let node = team.node();
    let name = |rank: u16| node.roster().name(rank).unwrap_or_default().to_owned();
    let chains = node.chains().iter().filter(|(_, chain)| chain.next() > 0);
    chains
        .map(|(id, chain): (_, &Chain)| Held { robot: name(id.rank), session: id.session, records: chain.next() })
        .collect()
}

/// Others that were ever heard.
pub(super) fn heard(team: &Team, now: Stamp) -> Vec<Heard> {
    let node = team.node();
    let of = |rank: usize| {
        let (at, _) = node.heard(rank as u16)?;
        Some(Heard { robot: node.roster().name(rank as u16)?.to_owned(), age_s: now.secs_since(at) })
    };
    (0..node.roster().members().len()).filter_map(of).collect()
}

/// What was refused so far.
pub(super) fn refused(team: &Team) -> Vec<Refused> {
    let refused = team.node().refused();
    refused.map(|(why, of, times)| Refused { why: why.words().to_owned(), of: of.map(str::to_owned), times }).collect()
}

/// Settings that are not as by default.
pub(super) fn unusual(settings: &Settings) -> BTreeMap<String, String> {
    let usual = Settings::default().lines();
    let lines = settings.lines().into_iter().zip(usual).filter(|(line, usual)| line.value != usual.value);
    lines.map(|(line, _)| (format!("{}.{}", line.section, line.key), line.value)).collect()
}

impl Told {
    pub(super) fn encode(&self) -> Vec<u8> {
        serde_json::to_vec(self).unwrap_or_default()
    }

    /// None for bytes that are something else, as of another version.
    pub(super) fn decode(bytes: &[u8]) -> Option<Self> {
        serde_json::from_slice(bytes).ok()
    }

    /// What another robot does differently; each is harmless, and worth to know.
    pub(super) fn differences(&self, other: &Self, name: &str) -> Vec<String> {
        let mut found = Vec::new();
        if other.version != self.version {
            found.push(format!("{name} runs mapwright {}, this robot {}", other.version, self.version));
        }
        let keys = self.settings.keys().chain(other.settings.keys()).collect::<std::collections::BTreeSet<_>>();
        let value =
            |of: &Self, key: &String| of.settings.get(key).cloned().unwrap_or_else(|| "as by default".to_owned());
        let different = keys.into_iter().filter(|key| self.settings.get(*key) != other.settings.get(*key));
        let different: Vec<String> =
            different.map(|key| format!("{key}: {} there, {} here", value(other, key), value(self, key))).collect();
        if !different.is_empty() {
            found.push(format!("{name} has other settings: {}", different.join("; ")));
        }
        let apart_s = other.clock_s - self.clock_s;
        if apart_s.abs() > CLOCKS_APART_S {
            let which = if apart_s > 0.0 { "ahead of" } else { "behind" };
            let apart = crate::terminal::duration(apart_s.abs());
            found.push(format!(
                "{name}'s clock is {apart} {which} this one's; no time of it is used but for certificates"
            ));
        }
        found.iter().map(|text| plain(text)).collect()
    }
}

/// Text of another robot, without what a terminal would obey.
pub(super) fn plain(text: &str) -> String {
    text.chars().filter(|char| !char.is_control()).take(1000).collect()
}
