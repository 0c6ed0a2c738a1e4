//! Who hears a topic, by the tokens of others.

use std::collections::BTreeSet;
use std::sync::{Arc, Mutex, PoisonError};
use zenoh::liveliness::LivelinessToken;
use zenoh::pubsub::Subscriber;
use zenoh::sample::{Sample, SampleKind};
use zenoh::{Session, Wait};

/// More are not counted.
const LISTENERS_MOST: usize = 10_000;

/// Who hears a topic now.
pub(crate) struct Listeners {
    tokens: Arc<Mutex<BTreeSet<String>>>,
    _watch: Subscriber<()>,
}

impl Listeners {
    pub(crate) fn watch(session: &Session, tokens: String) -> zenoh::Result<Self> {
        let known = Arc::new(Mutex::new(BTreeSet::new()));
        let changed = {
            let known = Arc::clone(&known);
            move |sample: Sample| {
                let token = sample.key_expr().as_str();
                let mut known = known.lock().unwrap_or_else(PoisonError::into_inner);
                match sample.kind() {
                    SampleKind::Put if known.len() < LISTENERS_MOST => known.insert(token.to_owned()),
                    SampleKind::Put => false,
                    SampleKind::Delete => known.remove(token),
                };
            }
        };
        let watch = session.liveliness().declare_subscriber(tokens).history(true).callback(changed).wait()?;
        Ok(Self { tokens: known, _watch: watch })
    }

    pub(crate) fn count(&self) -> usize {
        self.tokens.lock().unwrap_or_else(PoisonError::into_inner).len()
    }
}

/// Says that something is there, until dropped.
pub(crate) fn tell(session: &Session, token: &str) -> zenoh::Result<LivelinessToken> {
    session.liveliness().declare_token(token.to_owned()).wait()
}
