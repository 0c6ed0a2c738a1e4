//! Which domain, and how Zenoh is set up.

use serde_json::Value;
use std::env;
use std::net::Ipv4Addr;
use zenoh::Config;

/// A session as rmw_zenoh sets it up, where that differs from what Zenoh does by itself; the reasons are in its
/// `DEFAULT_RMW_ZENOH_SESSION_CONFIG.json5`. What differs from there: nobody is waited for longer than a tenth of a second
/// (`max_wait_before_drop_fragments`; what is large has a queue of its own, `data_low`), a peer that takes nothing for 1 s of what must arrive is left
/// (`wait_before_close`), and no message is larger than 256 MiB.
const SESSION: &str = r#"{
    mode: "peer",
    connect: { endpoints: ["tcp/localhost:7447"], timeout_ms: -1, exit_on_failure: false },
    listen: { endpoints: ["tcp/localhost:0"] },
    scouting: {
        multicast: { enabled: false },
        gossip: {
            enabled: true,
            target: { router: ["router", "peer"], peer: ["router"] },
            autoconnect_strategy: { peer: { to_router: "always", to_peer: "greater-zid" } },
        },
    },
    timestamping: { enabled: true },
    queries_default_timeout: 60000,
    transport: {
        unicast: { open_timeout: 60000, accept_timeout: 60000, accept_pending: 10000, max_sessions: 10000 },
        link: {
            tx: {
                lease: 60000,
                keep_alive: 2,
                queue: {
                    size: { data_low: 16 },
                    congestion_control: {
                        drop: { wait_before_drop: 1000, max_wait_before_drop_fragments: 80000 },
                        block: { wait_before_close: 1000000 },
                    },
                },
            },
            rx: { max_message_size: 268435456 },
        },
    },
}"#;
/// The names of what the environment may say.
const DOMAIN: &str = "ROS_DOMAIN_ID";
const SESSION_FILE: &str = "ZENOH_SESSION_CONFIG_URI";
const ROUTER_FILE: &str = "ZENOH_ROUTER_CONFIG_URI";
const OVERRIDES: &str = "ZENOH_CONFIG_OVERRIDE";
/// What overrides say of these holds for a session alone: a router connects to nobody and listens where it is looked for.
const NOT_OF_ROUTERS: [&str; 4] = ["mode", "connect", "listen", "id"];

/// Which domain is joined, and how.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Configuration {
    /// Nodes of other domains are not heard.
    pub domain: u32,
    /// A file of Zenoh's configuration for a session, instead of rmw_zenoh's.
    pub session_file: Option<String>,
    /// The same for a router.
    pub router_file: Option<String>,
    /// Keys of the configuration and their values as JSON5, on top of it.
    pub overrides: Vec<(String, String)>,
}

/// What the environment, or a file that it names, says that cannot be.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{name}: expected {expected}, found {found}")]
pub struct ConfigurationError {
    name: &'static str,
    expected: &'static str,
    found: String,
}

/// Where a router of this machine is looked for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct RouterPlace {
    pub(crate) host: String,
    pub(crate) port: u16,
}

impl Configuration {
    /// What the environment says, as ROS 2's nodes read it.
    ///
    /// # Errors
    /// [`ConfigurationError`] where it, or a file that it names, says what cannot be.
    pub fn from_environment() -> Result<Self, ConfigurationError> {
        let configuration = Self::from(|name| env::var(name).ok().filter(|text| !text.is_empty()))?;
        configuration.session()?;
        configuration.router(&RouterPlace { host: "localhost".to_owned(), port: 7447 })?;
        Ok(configuration)
    }

    fn from(read: impl Fn(&str) -> Option<String>) -> Result<Self, ConfigurationError> {
        let domain = read(DOMAIN).map_or(Ok(0), |text| {
            let expected = "a number from 0 to 4294967295";
            text.trim().parse().map_err(|_| ConfigurationError { name: DOMAIN, expected, found: format!("{text:?}") })
        })?;
        let overrides = read(OVERRIDES).unwrap_or_default();
        let overrides = overrides.split(';').filter(|pair| !pair.trim().is_empty()).map(|pair| {
            let expected = "key=value, several with ; between them";
            let wrong = || ConfigurationError { name: OVERRIDES, expected, found: format!("{pair:?}") };
            let (key, value) = pair.split_once('=').ok_or_else(wrong)?;
            Ok((key.trim().to_owned(), value.trim().to_owned()))
        });
        let overrides = overrides.collect::<Result<_, ConfigurationError>>()?;
        Ok(Self { domain, session_file: read(SESSION_FILE), router_file: read(ROUTER_FILE), overrides })
    }

    /// Zenoh's configuration of a session among others.
    pub(crate) fn session(&self) -> Result<Config, ConfigurationError> {
        let config = match &self.session_file {
            Some(file) => from_file(SESSION_FILE, file)?,
            None => ours()?,
        };
        self.overridden(config, |_| true)
    }

    /// Zenoh's configuration of the router that is looked for at a place.
    pub(crate) fn router(&self, place: &RouterPlace) -> Result<Config, ConfigurationError> {
        let config = match &self.router_file {
            Some(file) => from_file(ROUTER_FILE, file)?,
            None => {
                let any = if std::net::TcpListener::bind("[::]:0").is_ok() { "[::]" } else { "0.0.0.0" };
                let mut config = ours()?;
                let listen = format!("[\"tcp/{any}:{}\"]", place.port);
                for (key, value) in
                    [("mode", "\"router\""), ("connect/endpoints", "[]"), ("listen/endpoints", &*listen)]
                {
                    insert(&mut config, key, value)?;
                }
                config
            }
        };
        self.overridden(config, |key| !NOT_OF_ROUTERS.iter().any(|not| key.split('/').next() == Some(not)))
    }

    fn overridden(&self, mut config: Config, holds: impl Fn(&str) -> bool) -> Result<Config, ConfigurationError> {
        for (key, value) in self.overrides.iter().filter(|(key, _)| holds(key)) {
            insert(&mut config, key, value)?;
        }
        Ok(config)
    }
}

fn ours() -> Result<Config, ConfigurationError> {
    let expected = "what this version of Zenoh reads";
    Config::from_json5(SESSION).map_err(|e| ConfigurationError { name: "built in", expected, found: e.to_string() })
}

fn from_file(name: &'static str, file: &str) -> Result<Config, ConfigurationError> {
    let expected = "a file of Zenoh's configuration, JSON5 or YAML";
    Config::from_file(file).map_err(|error| ConfigurationError { name, expected, found: format!("{file}: {error}") })
}

fn insert(config: &mut Config, key: &str, value: &str) -> Result<(), ConfigurationError> {
    let expected = "keys of Zenoh's configuration with values as JSON5";
    let found = |error: &dyn std::fmt::Display| format!("{key}={value}: {error}");
    config.insert_json5(key, value).map_err(|error| ConfigurationError {
        name: OVERRIDES,
        expected,
        found: found(&error),
    })
}

/// Where on this machine a session of this configuration looks for a router; none where it looks elsewhere, or is none that needs one.
pub(crate) fn router_place(config: &Config) -> Option<RouterPlace> {
    let read = |key: &str| config.get_json(key).ok().and_then(|json| serde_json::from_str::<Value>(&json).ok());
    if read("mode").is_some_and(|mode| mode.as_str().is_some_and(|mode| mode != "peer")) {
        return None;
    }
    let endpoints = read("connect/endpoints")?;
    let endpoints = endpoints.get("peer").unwrap_or(&endpoints);
    endpoints.as_array()?.iter().filter_map(Value::as_str).find_map(local)
}

/// `tcp/localhost:7447`, `tcp/[::1]:7447#iface=lo`.
fn local(endpoint: &str) -> Option<RouterPlace> {
    let address = endpoint.strip_prefix("tcp/")?.split(['?', '#']).next()?;
    let (host, port) = address.rsplit_once(':')?;
    let host = host.trim_start_matches('[').trim_end_matches(']');
    let is_local = host == "localhost" || host == "::1" || host.parse::<Ipv4Addr>().is_ok_and(|ip| ip.is_loopback());
    is_local.then_some(RouterPlace { host: host.to_owned(), port: port.parse().ok()? })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(pairs: &[(&str, &str)]) -> Result<Configuration, ConfigurationError> {
        Configuration::from(|name| pairs.iter().find(|(n, _)| *n == name).map(|(_, value)| (*value).to_owned()))
    }

    fn json(config: &Config, key: &str) -> String {
        config.get_json(key).unwrap()
    }

    #[test]
    fn without_a_word_it_is_what_rmw_zenoh_does() {
        let found = of(&[]).unwrap();
        assert_eq!(found, Configuration::default());
        let session = found.session().unwrap();
        assert_eq!(json(&session, "mode"), "\"peer\"");
        assert_eq!(json(&session, "scouting/multicast/enabled"), "false");
        let place = router_place(&session).unwrap();
        assert_eq!((place.host.as_str(), place.port), ("localhost", 7447));
        let router = found.router(&place).unwrap();
        assert_eq!(json(&router, "mode"), "\"router\"");
        assert!(json(&router, "listen/endpoints").contains(":7447"), "{}", json(&router, "listen/endpoints"));
        assert_eq!(router_place(&router), None);
    }

    #[test]
    fn overrides_hold_for_sessions_and_but_for_places_for_routers() {
        let text = "connect/endpoints=[\"tcp/127.0.0.1:17447\"];scouting/multicast/enabled=true;";
        let found = of(&[("ROS_DOMAIN_ID", " 42"), ("ZENOH_CONFIG_OVERRIDE", text)]).unwrap();
        assert_eq!((found.domain, found.overrides.len()), (42, 2));
        let session = found.session().unwrap();
        let place = router_place(&session).unwrap();
        assert_eq!((place.host.as_str(), place.port), ("127.0.0.1", 17447));
        let router = found.router(&place).unwrap();
        assert_eq!(json(&router, "connect/endpoints"), "[]");
        assert!(json(&router, "listen/endpoints").contains(":17447"));
        assert_eq!(json(&router, "scouting/multicast/enabled"), "true");
    }

    #[test]
    fn a_router_elsewhere_is_not_replaced() {
        for text in ["connect/endpoints=[\"tcp/10.0.0.1:7447\"]", "connect/endpoints=[]", "mode=\"client\""] {
            assert_eq!(router_place(&of(&[(OVERRIDES, text)]).unwrap().session().unwrap()), None, "{text}");
        }
        assert_eq!(local("tcp/[::1]:7447#iface=lo").unwrap().host, "::1");
        assert_eq!(local("udp/localhost:7447"), None);
    }

    #[test]
    fn what_cannot_be_is_refused_with_what_was_found() {
        let said = |pairs: &[(&str, &str)]| match of(pairs).and_then(|c| c.session().map(|_| ())) {
            Err(error) => error.to_string(),
            Ok(()) => panic!("{pairs:?} is taken"),
        };
        assert_eq!(
            said(&[(DOMAIN, "house")]),
            "ROS_DOMAIN_ID: expected a number from 0 to 4294967295, found \"house\""
        );
        assert!(said(&[(OVERRIDES, "mode")]).ends_with("found \"mode\""));
        assert!(said(&[(OVERRIDES, "mode=\"submarine\"")]).contains("mode=\"submarine\""));
        assert!(said(&[(OVERRIDES, "no/such/key=1")]).contains("no/such/key"));
        assert!(said(&[(SESSION_FILE, "/nowhere/zenoh.json5")]).contains("/nowhere/zenoh.json5"));
    }
}
