//! Which domain, and who is looked for.

use std::env;

/// Domains above this have no ports of their own (DDSI-RTPS 2.5, 9.6.2.3).
const DOMAIN_MOST: u16 = 232;
/// What is received is kept by the system until it is read, bytes: a cloud of 2 MB in one go, where the system allows it.
const RECEIVE_BYTES: &str = "4MB";
/// No message is larger: who says so is not believed, and takes no memory.
const MESSAGE_MOST: &str = "256MB";

/// Who has not confirmed a message is asked for what is missing so often, and where nothing is heard ever more seldom, up to that: a reader whose
/// buffers hold the twentieth part of a large map has it in half a second instead of two.
const ASKED_EVERY: &str = "20ms";
const ASKED_AT_LEAST_EVERY: &str = "100ms";

/// How far others are looked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Range {
    /// On this machine alone.
    Localhost,
    /// In this network.
    #[default]
    Subnet,
    /// Nowhere but where static peers say.
    Off,
}

/// Which domain is joined, and how.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Configuration {
    /// From 0 to 232.
    pub domain: u16,
    /// How far others are looked for.
    pub range: Range,
    /// Addresses where others are looked for besides.
    pub peers: Vec<String>,
    /// More configuration of Cyclone DDS, as `CYCLONEDDS_URI` has it; what it says comes last.
    pub cyclone: Option<String>,
}

/// What the environment says that cannot be.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{name}: expected {expected}, found {found:?}")]
pub struct ConfigurationError {
    name: &'static str,
    expected: &'static str,
    found: String,
}

impl Configuration {
    /// What the environment says, as ROS 2's nodes read it.
    ///
    /// # Errors
    /// [`ConfigurationError`] where it says what cannot be.
    pub fn from_environment() -> Result<Self, ConfigurationError> {
        Self::from(|name| env::var(name).ok().filter(|text| !text.is_empty()))
    }

    fn from(read: impl Fn(&str) -> Option<String>) -> Result<Self, ConfigurationError> {
        let wrong = |name, expected, found| ConfigurationError { name, expected, found };
        let domain = match read("ROS_DOMAIN_ID") {
            None => 0,
            Some(text) => text
                .trim()
                .parse()
                .ok()
                .filter(|domain| *domain <= DOMAIN_MOST)
                .ok_or_else(|| wrong("ROS_DOMAIN_ID", "a number from 0 to 232", text))?,
        };
        let range = match read("ROS_AUTOMATIC_DISCOVERY_RANGE").as_deref() {
            None | Some("SUBNET" | "SYSTEM_DEFAULT" | "NOT_SET") => Range::Subnet,
            Some("LOCALHOST") => Range::Localhost,
            Some("OFF") => Range::Off,
            Some(text) => {
                return Err(wrong(
                    "ROS_AUTOMATIC_DISCOVERY_RANGE",
                    "SUBNET, LOCALHOST, OFF or SYSTEM_DEFAULT",
                    text.to_owned(),
                ));
            }
        };
        let peers = read("ROS_STATIC_PEERS").unwrap_or_default();
        let peers = peers.split(';').map(str::trim).filter(|peer| !peer.is_empty()).map(str::to_owned).collect();
        Ok(Self { domain, range, peers, cyclone: read("CYCLONEDDS_URI") })
    }

    /// Cyclone DDS's configuration.
    pub(crate) fn xml(&self) -> String {
        let escape = |text: &str| text.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;");
        let peers: String = self.peers.iter().map(|peer| format!("<Peer address=\"{}\"/>", escape(peer))).collect();
        let local = if self.range == Range::Localhost { "<Peer address=\"localhost\"/>" } else { "" };
        let multicast = match self.range {
            Range::Subnet => "",
            Range::Off => "<AllowMulticast>false</AllowMulticast>",
            Range::Localhost => {
                "<AllowMulticast>false</AllowMulticast><Interfaces><NetworkInterface address=\"127.0.0.1\"/></Interfaces>"
            }
        };
        let ours = format!(
            "<CycloneDDS><Domain><General>{multicast}</General><Discovery><ParticipantIndex>auto</ParticipantIndex>\
             <MaxAutoParticipantIndex>119</MaxAutoParticipantIndex><Peers>{local}{peers}</Peers></Discovery><Internal>\
             <SocketReceiveBufferSize max=\"{RECEIVE_BYTES}\"/><MaxSampleSize>{MESSAGE_MOST}</MaxSampleSize>\
             <HeartbeatInterval max=\"{ASKED_AT_LEAST_EVERY}\">{ASKED_EVERY}</HeartbeatInterval></Internal></Domain></CycloneDDS>"
        );
        match &self.cyclone {
            Some(theirs) => format!("{ours},{theirs}"),
            None => ours,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(pairs: &[(&str, &str)]) -> Result<Configuration, ConfigurationError> {
        Configuration::from(|name| pairs.iter().find(|(n, _)| *n == name).map(|(_, value)| (*value).to_owned()))
    }

    #[test]
    fn the_environment_is_read_as_ros_reads_it() {
        assert_eq!(of(&[]).unwrap(), Configuration::default());
        let pairs = [
            ("ROS_DOMAIN_ID", "42"),
            ("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST"),
            ("ROS_STATIC_PEERS", "10.0.0.1; robot.local"),
            ("CYCLONEDDS_URI", "file:///etc/dds.xml"),
        ];
        let found = of(&pairs).unwrap();
        assert_eq!((found.domain, found.range, found.peers.len()), (42, Range::Localhost, 2));
        let xml = found.xml();
        assert!(xml.contains("<Peer address=\"robot.local\"/>") && xml.contains("<AllowMulticast>false"), "{xml}");
        assert!(xml.ends_with(",file:///etc/dds.xml"), "what the user says comes last: {xml}");
    }

    #[test]
    fn what_cannot_be_is_refused_with_what_was_expected() {
        let error = of(&[("ROS_DOMAIN_ID", "233")]).unwrap_err();
        assert_eq!(error.to_string(), "ROS_DOMAIN_ID: expected a number from 0 to 232, found \"233\"");
        assert!(of(&[("ROS_AUTOMATIC_DISCOVERY_RANGE", "FAR")]).is_err());
    }

    #[test]
    fn addresses_stay_text() {
        let peers = vec!["\"><Tracing>".to_owned()];
        assert!(!Configuration { peers, ..Configuration::default() }.xml().contains("<Tracing>"));
    }
}
