//! How Zenoh is set up: which addresses, which certificates, who may say what, and how much.

use crate::credentials::Credentials;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use serde_json::{Value, json};

/// Milliseconds without a word, after which a link is taken to be dead and is opened anew. At 30 % loss TCP is silent for up to some seconds.
const LEASE_MS: u64 = 10_000;
/// Milliseconds that opening a link may take, and from one attempt to the next.
const OPEN_MS: u64 = 4000;
const RETRY_MS: [u64; 2] = [500, 500];
/// Batches of 64 KiB that wait on a link: a message of the greatest length has room.
const BATCHES: u64 = 16;
/// Microseconds for which a message that does not fit waits, and parts of a longer one, before it is dropped.
const WAIT_US: [u64; 2] = [1000, 200_000];

/// Who is in the team and where, and how long a message may be.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WireSettings {
    /// What the team is called: teams on one network do not hear each other.
    pub team: String,
    /// All robots of the team, this one too.
    pub robots: Vec<String>,
    /// Common names of routers that may pass on what any robot says.
    pub relays: Vec<String>,
    /// Where to listen, such as `tls/[::]:7447`; nowhere where there is none.
    pub listen: Vec<String>,
    /// Where others are found.
    pub connect: Vec<String>,
    /// Bytes of a message; longer ones pass neither way.
    pub message_at_most: usize,
}

/// Where all that a robot says lies.
pub(crate) fn of_robot(team: &str, name: &str) -> String {
    format!("mapwright/{team}/{name}")
}

/// Zenoh's settings.
pub(crate) fn zenoh_settings(settings: &WireSettings, credentials: &Credentials) -> Value {
    let coded = |pem: &str| STANDARD.encode(pem);
    let filter = json!({
        "id": "longest",
        "messages": ["put", "delete", "query", "reply"],
        "flows": ["ingress", "egress"],
        "key_exprs": ["**"],
        "size_limit": settings.message_at_most,
    });
    json!({
        "mode": "peer",
        "connect": {
            "endpoints": settings.connect,
            "timeout_ms": -1,
            "exit_on_failure": false,
            "retry": { "period_init_ms": RETRY_MS[0], "period_max_ms": RETRY_MS[1], "period_increase_factor": 2.0 },
        },
        "listen": { "endpoints": settings.listen, "timeout_ms": 0, "exit_on_failure": true },
        "scouting": { "multicast": { "enabled": false }, "gossip": { "enabled": false }, "delay": 0 },
        "open": { "return_conditions": { "connect_scouted": false, "declares": false } },
        "timestamping": { "enabled": false },
        "adminspace": { "enabled": false },
        "access_control": access_control(settings, &credentials.name),
        "low_pass_filter": [filter],
        "transport": {
            "unicast": { "open_timeout": OPEN_MS, "accept_timeout": OPEN_MS },
            "link": {
                "protocols": ["tls"],
                "tx": {
                    "lease": LEASE_MS,
                    "queue": {
                        "size": {
                            "control": 2, "real_time": 2, "interactive_high": 2, "interactive_low": 2, "data_high": 2,
                            "data": BATCHES, "data_low": 2, "background": 2,
                        },
                        "congestion_control": {
                            "drop": { "wait_before_drop": WAIT_US[0], "max_wait_before_drop_fragments": WAIT_US[1] },
                        },
                    },
                },
                // Zenoh's own head comes on top of the message.
                "rx": { "max_message_size": settings.message_at_most + 4096 },
                "tls": {
                    "enable_mtls": true,
                    // Robots are known by the names in their certificates, wherever they are reached: the rules below hold for these.
                    "verify_name_on_connect": false,
                    "close_link_on_expiration": true,
                    "root_ca_certificate_base64": coded(&credentials.authority_pem),
                    "listen_certificate_base64": coded(&credentials.certificate_pem),
                    "listen_private_key_base64": coded(&credentials.private_key_pem),
                    "connect_certificate_base64": coded(&credentials.certificate_pem),
                    "connect_private_key_base64": coded(&credentials.private_key_pem),
                },
            },
            "shared_memory": { "enabled": false },
        },
    })
}

/// Each robot may say what lies under its own name and hear what all say; nothing else passes.
fn access_control(settings: &WireSettings, own: &str) -> Value {
    let subject = |name: &String| json!({ "id": name, "cert_common_names": [name] });
    let (all, robots) = (|| settings.robots.iter().chain(&settings.relays), settings.robots.iter());
    let names: Vec<&String> = all().collect();
    let keys = |name: &str| [format!("{}/**", of_robot(&settings.team, name))];
    let everything = [format!("mapwright/{}/**", settings.team)];
    let mut rules = vec![
        json!({ "id": "hear", "messages": ["declare_subscriber"], "flows": ["ingress", "egress"],
            "permission": "allow", "key_exprs": everything }),
        json!({ "id": "say", "messages": ["put"], "flows": ["egress"],
            "permission": "allow", "key_exprs": keys(own) }),
    ];
    let mut policies = vec![json!({ "rules": ["hear", "say"], "subjects": names })];
    for name in robots {
        let id = format!("from {name}");
        rules.push(json!({ "id": id, "messages": ["put"], "flows": ["ingress"], "permission": "allow",
            "key_exprs": keys(name) }));
        policies.push(json!({ "rules": [id], "subjects": [name] }));
    }
    if !settings.relays.is_empty() {
        rules.push(json!({ "id": "relayed", "messages": ["put"], "flows": ["ingress"], "permission": "allow",
            "key_exprs": everything }));
        policies.push(json!({ "rules": ["relayed"], "subjects": settings.relays }));
    }
    json!({
        "enabled": true,
        "default_permission": "deny",
        "rules": rules,
        "subjects": all().map(subject).collect::<Vec<_>>(),
        "policies": policies,
    })
}
