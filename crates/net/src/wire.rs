//! A robot's connection to its team.

use crate::credentials::{Credentials, is_team_name};
use crate::error::NetError;
use crate::queue::Queue;
use crate::rules::{WireSettings, of_robot, zenoh_settings};
use crate::watch::{self, Complaint};
use std::collections::BTreeSet;
use std::sync::Arc;
use std::thread::JoinHandle;
use std::time::Duration;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::sample::{Locality, Sample};
use zenoh::{Session, Wait};

/// Bytes that wait to be taken, and to be sent.
const INCOMING_AT_MOST: usize = 1 << 26;
const OUTGOING_AT_MOST: usize = 1 << 23;
/// Messages of so many bytes at most go before longer ones: that others are alive must not wait behind what they have mapped.
const SHORT: usize = 1024;
/// How often the thread that sends looks whether it is over.
const TICK: Duration = Duration::from_millis(200);

/// A message that has come.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Arrival {
    /// In whose name: that of the certificate, unless a relay has passed it on.
    pub from: String,
    /// What it was sent as: `all`, `to` for this robot alone, or a word of the sender's.
    pub subject: String,
    /// The bytes.
    pub bytes: Vec<u8>,
}

/// A link that stands.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Link {
    /// The name in the other side's certificate.
    pub name: String,
    /// Whether it is one of the team; of others nothing passes.
    pub is_of_team: bool,
}

/// What is on its way out: the key, the bytes, whether it is short.
type Outgoing = (String, Vec<u8>, bool);

/// A connection to the team. What is dropped, here or in Zenoh, is gone: who speaks over it must ask again.
pub struct Wire {
    session: Session,
    settings: WireSettings,
    own_key: String,
    incoming: Arc<Queue<Arrival>>,
    outgoing: Arc<Queue<Outgoing>>,
    sender: Option<JoinHandle<()>>,
}

impl Wire {
    /// Listens, and begins to look for the others; it does not wait for them.
    ///
    /// # Errors
    /// A name or an address that is none, an address that cannot be listened at.
    pub fn open(settings: WireSettings, credentials: &Credentials) -> Result<Self, NetError> {
        let heard = format!("mapwright/{}/*/all", settings.team);
        let own = format!("mapwright/{}/*/to/{}", settings.team, credentials.name);
        Self::open_for(settings, credentials, &[heard, own])
    }

    /// The same to hear what all robots say of themselves under this subject, and nothing else.
    ///
    /// # Errors
    /// As for [`Wire::open`].
    pub fn overhear(settings: WireSettings, credentials: &Credentials, subject: &str) -> Result<Self, NetError> {
        let heard = format!("mapwright/{}/*/{subject}", settings.team);
        Self::open_for(settings, credentials, &[heard])
    }

    /// Hears what all robots say under a subject of their own as well.
    ///
    /// # Errors
    /// What Zenoh says.
    pub fn also_hear(&self, subject: &str) -> Result<(), NetError> {
        subscribe(&self.session, &self.incoming, &format!("mapwright/{}/*/{subject}", self.settings.team))
    }

    fn open_for(settings: WireSettings, credentials: &Credentials, heard: &[String]) -> Result<Self, NetError> {
        let names = [&settings.team].into_iter().chain(&settings.robots).chain(&settings.relays);
        if let Some(name) = names.into_iter().find(|name| !is_team_name(name)) {
            return Err(NetError::Name { found: name.clone() });
        }
        let is_address = |address: &&String| address.strip_prefix("tls/").is_some_and(|rest| rest.contains(':'));
        if let Some(address) = settings.listen.iter().chain(&settings.connect).find(|address| !is_address(address)) {
            return Err(NetError::Address { found: address.clone() });
        }
        watch::listen();
        let text = zenoh_settings(&settings, credentials).to_string();
        // What Zenoh says of its settings could hold a part of them.
        let config = zenoh::Config::from_json5(&text)
            .map_err(|_| NetError::Zenoh("the settings of the wire do not suit this version of Zenoh".to_owned()))?;
        let session = zenoh::open(config).wait().map_err(|cause| not_open(&settings, &cause.to_string()))?;
        let incoming = Arc::new(Queue::new(INCOMING_AT_MOST));
        for key in heard {
            subscribe(&session, &incoming, key)?;
        }
        let outgoing = Arc::new(Queue::new(OUTGOING_AT_MOST));
        let own_key = of_robot(&settings.team, &credentials.name);
        let sender = {
            let (session, outgoing) = (session.clone(), Arc::clone(&outgoing));
            std::thread::Builder::new().name("wire".to_owned()).spawn(move || send_all(&session, &outgoing))
        };
        let sender = sender.map_err(|cause| NetError::Zenoh(format!("cannot begin a thread: {cause}")))?;
        Ok(Self { session, settings, own_key, incoming, outgoing, sender: Some(sender) })
    }

    /// Sends to all, or to one robot; what does not fit is dropped and counted.
    pub fn send(&self, to: Option<&str>, bytes: Vec<u8>) {
        let subject = to.map_or_else(|| "all".to_owned(), |name| format!("to/{name}"));
        self.send_as(&subject, bytes);
    }

    /// Sends under a subject of its own.
    pub fn send_as(&self, subject: &str, bytes: Vec<u8>) {
        let (length, is_short) = (bytes.len(), bytes.len() <= SHORT);
        self.outgoing.push(length, is_short, (format!("{}/{subject}", self.own_key), bytes, is_short));
    }

    /// The next message; none where none comes within that time.
    #[must_use]
    pub fn receive(&self, wait: Duration) -> Option<Arrival> {
        self.incoming.pop(wait)
    }

    /// Messages that were dropped here because too many waited: coming in, going out.
    #[must_use]
    pub fn dropped(&self) -> [u64; 2] {
        [self.incoming.dropped(), self.outgoing.dropped()]
    }

    /// Whose links stand now.
    #[must_use]
    pub fn links(&self) -> Vec<Link> {
        let names = self.session.info().links().wait().filter_map(|link| link.auth_identifier().map(str::to_owned));
        let names: BTreeSet<String> = names.collect();
        let is_of_team = |name: &String| self.settings.robots.contains(name) || self.settings.relays.contains(name);
        names.into_iter().map(|name| Link { is_of_team: is_of_team(&name), name }).collect()
    }

    /// Why others are not reached, and who was refused, so far.
    #[must_use]
    pub fn complaints(&self) -> Vec<Complaint> {
        watch::complaints()
    }
}

impl Drop for Wire {
    fn drop(&mut self) {
        self.outgoing.close();
        if let Some(sender) = self.sender.take() {
            let _ = sender.join(); // it ends by itself
        }
        let _ = self.session.close().wait(); // nothing helps where even that fails
    }
}

fn subscribe(session: &Session, incoming: &Arc<Queue<Arrival>>, key: &str) -> Result<(), NetError> {
    let incoming = Arc::clone(incoming);
    let take = move |sample: Sample| {
        let key = sample.key_expr().as_str();
        let mut parts = key.splitn(4, '/').skip(2);
        let (Some(from), Some(subject)) = (parts.next(), parts.next()) else { return };
        let subject = subject.split('/').next().unwrap_or(subject).to_owned();
        let bytes = sample.payload().to_bytes().into_owned();
        incoming.push(bytes.len(), false, Arrival { from: from.to_owned(), subject, bytes });
    };
    // Not what this session has sent itself; the subscription lasts as long as the session.
    let made = session.declare_subscriber(key.to_owned()).callback(take).allowed_origin(Locality::Remote).background();
    made.wait().map_err(|cause| NetError::Zenoh(format!("cannot hear {key}: {cause}")))
}

fn send_all(session: &Session, outgoing: &Queue<Outgoing>) {
    while !outgoing.is_over() {
        let Some((key, bytes, is_short)) = outgoing.pop(TICK) else { continue };
        let priority = if is_short { Priority::InteractiveHigh } else { Priority::Data };
        let put = session.put(key, bytes).congestion_control(CongestionControl::Drop).priority(priority);
        let put = put.express(is_short).allowed_destination(Locality::Remote);
        // A session that is closed has nobody to send to.
        let _ = put.wait();
    }
}

fn not_open(settings: &WireSettings, cause: &str) -> NetError {
    let why = match cause {
        _ if cause.contains("Address already in use") => "something else listens there already",
        _ if cause.contains("Cannot assign requested address") => "this computer has no such address",
        _ if cause.contains("Permission denied") => "this user may not",
        _ => cause.split(" at /").next().unwrap_or(cause),
    };
    NetError::Zenoh(format!("cannot listen at {}: {why}", settings.listen.join(", ")))
}
