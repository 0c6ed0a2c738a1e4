//! A node of ROS 2.

use crate::configuration::Configuration;
use crate::keys::{Attachment, Kind, MESSAGE_MOST, Named, NodeKeys, listener_tokens, now_ns, qos, sender};
use crate::latched::{self, Latched};
use crate::listeners::{Listeners, tell};
use crate::opening;
use crate::services::Services;
use mapwright_live::wire::{Answer, Delivery, Hear, Publisher, Service, Topic, Wire, WireError, names};
use mapwright_ros::builtin;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicI64, Ordering};
use std::sync::{Mutex, PoisonError};
use std::time::Duration;
use zenoh::liveliness::LivelinessToken;
use zenoh::qos::Reliability;
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait};
use zenoh_ext::{AdvancedSubscriberBuilderExt, HistoryConfig, RecoveryConfig};

/// What was kept for who comes late arrives within that time.
const KEPT_WITHIN: Duration = Duration::from_secs(60);
/// Services are asked and answered as `rmw_qos_profile_services_default` says.
const OF_SERVICES: Delivery = Delivery::Reliable { depth: 10 };

/// A node of ROS 2 in a domain, over Zenoh.
pub struct Zenoh {
    session: Session,
    is_router: bool,
    keys: NodeKeys,
    services: Services,
    /// Said as long as the node is there; the first one says that it is.
    tokens: Vec<LivelinessToken>,
    /// Ends that have had a number; the node itself has 0.
    ends: usize,
}

impl std::fmt::Debug for Zenoh {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Zenoh")
            .field("node", &self.keys.name)
            .field("is_router", &self.is_router)
            .finish_non_exhaustive()
    }
}

impl Zenoh {
    /// Joins a domain as a node of a name. Where nodes of this machine look for a router and find none, this session becomes it.
    ///
    /// # Errors
    /// [`WireError`] where the configuration, the network or the name does not allow it.
    pub fn join(configuration: &Configuration, namespace: &str, name: &str) -> Result<Self, WireError> {
        let domain = configuration.domain;
        let failed = |why: String| WireError { doing: format!("joining domain {domain} over Zenoh as {name}"), why };
        if !names::is_name(&format!("/{name}")) || !(namespace == "/" || names::is_name(namespace)) {
            return Err(failed(format!("{namespace} and {name} cannot name a node")));
        }
        let (session, is_router) = opening::open(configuration).map_err(failed)?;
        let (namespace, name) = (namespace.to_owned(), name.to_owned());
        let keys = NodeKeys { domain, session: session.zid().to_string(), namespace, name };
        let services = Services::begin().map_err(|error| failed(error.to_string()))?;
        let token = tell(&session, &keys.token()).map_err(|error| failed(error.to_string()))?;
        Ok(Self { session, is_router, keys, services, tokens: vec![token], ends: 0 })
    }

    /// Whether others of this machine find each other through this session.
    #[must_use]
    pub fn is_router(&self) -> bool {
        self.is_router
    }

    /// A token for another end.
    fn end_token(&mut self, kind: Kind, named: &Named, delivery: Delivery) -> String {
        self.ends += 1;
        self.keys.end_token(self.ends, kind, named, &qos(delivery))
    }
}

fn named(name: &str, kind: &str) -> Result<Named, String> {
    let dds = names::dds_type(kind, "").ok_or("no such type")?;
    if !names::is_name(name) {
        return Err("nothing can be called so".to_owned());
    }
    let hash = builtin::type_hash(kind)
        .map_err(|_| format!("the definition of {kind} is not known here, and so not its hash, by which nodes meet"))?;
    Ok(Named { name: name.to_owned(), kind: dds, hash })
}

fn topic_failed<E: ToString>(topic: &Topic) -> impl Fn(E) -> WireError {
    let doing = format!("topic {} of type {}", topic.name, topic.kind);
    move |error| WireError { doing: doing.clone(), why: error.to_string() }
}

/// Hands on what is a message.
fn heard(hear: Hear) -> impl Fn(Sample) + Send + Sync + 'static {
    let hear = Mutex::new(hear);
    move |sample| {
        if sample.kind() != SampleKind::Put || !(4..=MESSAGE_MOST).contains(&sample.payload().len()) {
            return;
        }
        let bytes = sample.payload().to_bytes();
        let mut hear = hear.lock().unwrap_or_else(PoisonError::into_inner);
        // This is a thread of Zenoh, which others need.
        let _ = catch_unwind(AssertUnwindSafe(|| hear(&bytes)));
    }
}

impl Wire for Zenoh {
    fn subscribe(&mut self, topic: &Topic, hear: Hear) -> Result<(), WireError> {
        let named = named(&topic.name, topic.kind).map_err(topic_failed(topic))?;
        let subscriber = self.session.declare_subscriber(named.any_key(self.keys.domain)).callback(heard(hear));
        let made = match topic.delivery {
            Delivery::BestEffort { .. } | Delivery::Reliable { .. } | Delivery::AsOffered { .. } => {
                subscriber.background().wait()
            }
            Delivery::Latched { depth } => {
                let depth = usize::try_from(depth).unwrap_or(usize::MAX);
                let history = HistoryConfig::default().detect_late_publishers().max_samples(depth);
                subscriber
                    .history(history)
                    .recovery(RecoveryConfig::default().heartbeat())
                    .subscriber_detection()
                    .query_timeout(KEPT_WITHIN)
                    .background()
                    .wait()
            }
        };
        made.map_err(topic_failed(topic))?;
        let token = self.end_token(Kind::Subscription, &named, topic.delivery);
        self.tokens.push(tell(&self.session, &token).map_err(topic_failed(topic))?);
        Ok(())
    }

    fn advertise(&mut self, topic: &Topic) -> Result<Box<dyn Publisher>, WireError> {
        let named = named(&topic.name, topic.kind).map_err(topic_failed(topic))?;
        let key = named.key(self.keys.domain);
        let way = match topic.delivery {
            Delivery::BestEffort { .. } => now(&self.session, key, Reliability::BestEffort),
            Delivery::Reliable { .. } | Delivery::AsOffered { .. } => now(&self.session, key, Reliability::Reliable),
            Delivery::Latched { depth } => Latched::advertise(&self.session, &key, depth).map(Way::Latched),
        };
        let way = way.map_err(topic_failed(topic))?;
        let tokens = listener_tokens(self.keys.domain, &named);
        let listeners = Listeners::watch(&self.session, tokens).map_err(topic_failed(topic))?;
        let token = self.end_token(Kind::Publisher, &named, topic.delivery);
        let (sender, count) = (sender(&token), AtomicI64::new(1));
        let _token = tell(&self.session, &token).map_err(topic_failed(topic))?;
        Ok(Box::new(Told { way, topic: topic.clone(), sender, count, listeners, _token }))
    }

    fn serve(&mut self, service: &Service, answer: Answer) -> Result<(), WireError> {
        let failed =
            |why: String| WireError { doing: format!("service {} of type {}", service.name, service.kind), why };
        let named = named(&service.name, service.kind).map_err(failed)?;
        let keys = (named.key(self.keys.domain), named.any_key(self.keys.domain));
        self.services.serve(&self.session, keys, answer).map_err(|error| failed(error.to_string()))?;
        let token = self.end_token(Kind::Service, &named, OF_SERVICES);
        self.tokens.push(tell(&self.session, &token).map_err(|error| failed(error.to_string()))?);
        Ok(())
    }
}

impl Drop for Zenoh {
    fn drop(&mut self) {
        // Nothing helps where even that fails.
        let _ = self.session.close().wait();
    }
}

/// How a topic's messages go out.
enum Way {
    /// At once. Who takes nothing is waited for a thousandth of a second, and with a message of many parts for eight hundredths.
    Now(zenoh::pubsub::Publisher<'static>),
    Latched(Latched),
}

fn now(session: &Session, key: String, reliability: Reliability) -> zenoh::Result<Way> {
    latched::short(session.declare_publisher(key)).reliability(reliability).wait().map(Way::Now)
}

struct Told {
    way: Way,
    topic: Topic,
    sender: [u8; 16],
    count: AtomicI64,
    listeners: Listeners,
    /// Others see it as long as it is there.
    _token: LivelinessToken,
}

impl Publisher for Told {
    fn publish(&self, message: &[u8]) -> Result<(), WireError> {
        if message.len() > MESSAGE_MOST {
            let why = format!("expected a message of {MESSAGE_MOST} bytes at most, found one of {}", message.len());
            return Err(topic_failed(&self.topic)(why));
        }
        let number = self.count.fetch_add(1, Ordering::Relaxed);
        let attachment = Attachment { number, stamp_ns: now_ns(), sender: self.sender };
        match &self.way {
            Way::Now(publisher) => publisher
                .put(message.to_vec())
                .attachment(attachment.to_bytes())
                .wait()
                .map_err(topic_failed(&self.topic)),
            Way::Latched(latched) => {
                latched.send(message.to_vec(), attachment);
                Ok(())
            }
        }
    }

    fn listeners(&self) -> usize {
        self.listeners.count()
    }
}
