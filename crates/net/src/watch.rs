//! What Zenoh says of links that it refused or could not open: it tells nobody but its log, which is listened to here.

use std::collections::BTreeMap;
use std::fmt::{self, Debug};
use std::sync::{Mutex, OnceLock, PoisonError};
use tracing::field::{Field, Visit};
use tracing::span::{Attributes, Id, Record};
use tracing::subscriber::Interest;
use tracing::{Event, Level, Metadata, Subscriber};

/// Kinds of complaints that are kept, at most; of a kind only the last one.
const KINDS: usize = 256;

/// Something that was refused, or did not work, on the way to others.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Complaint {
    /// Whether somebody was refused who wanted in; otherwise somebody is not reached.
    pub is_refusal: bool,
    /// What happened, in words; with the address where one is known.
    pub what: String,
    /// How often.
    pub times: u64,
}

static HEARD: OnceLock<Mutex<BTreeMap<(bool, String), u64>>> = OnceLock::new();

/// Begins to listen; from then on until the process ends.
pub(crate) fn listen() {
    HEARD.get_or_init(|| {
        // Where the program has a log of its own, nothing is heard here.
        let _ = tracing::subscriber::set_global_default(Watch);
        Mutex::default()
    });
}

/// All so far.
pub(crate) fn complaints() -> Vec<Complaint> {
    let Some(heard) = HEARD.get() else { return Vec::new() };
    let heard = heard.lock().unwrap_or_else(PoisonError::into_inner);
    let complaint = |((is_refusal, what), times): (&(bool, String), &u64)| Complaint {
        is_refusal: *is_refusal,
        what: what.clone(),
        times: *times,
    };
    heard.iter().map(complaint).collect()
}

struct Watch;

/// Places in Zenoh that tell why there is no link.
fn is_watched(metadata: &Metadata<'_>) -> bool {
    match metadata.target() {
        "zenoh_link_tls::unicast" => *metadata.level() <= Level::WARN,
        "zenoh::net::runtime::orchestrator" => *metadata.level() <= Level::DEBUG,
        _ => false,
    }
}

impl Subscriber for Watch {
    fn register_callsite(&self, metadata: &'static Metadata<'static>) -> Interest {
        if is_watched(metadata) { Interest::always() } else { Interest::never() }
    }

    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        is_watched(metadata)
    }

    fn max_level_hint(&self) -> Option<tracing::level_filters::LevelFilter> {
        Some(tracing::level_filters::LevelFilter::DEBUG)
    }

    fn new_span(&self, _: &Attributes<'_>) -> Id {
        Id::from_u64(1)
    }

    fn record(&self, _: &Id, _: &Record<'_>) {}

    fn record_follows_from(&self, _: &Id, _: &Id) {}

    fn event(&self, event: &Event<'_>) {
        let mut text = Text(String::new());
        event.record(&mut text);
        let Some(what) = in_words(&text.0) else { return };
        let Some(heard) = HEARD.get() else { return };
        let mut heard = heard.lock().unwrap_or_else(PoisonError::into_inner);
        if heard.len() < KINDS || heard.contains_key(&what) {
            *heard.entry(what).or_default() += 1;
        }
    }

    fn enter(&self, _: &Id) {}

    fn exit(&self, _: &Id) {}
}

struct Text(String);

impl Visit for Text {
    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        if field.name() == "message" {
            let _ = fmt::write(&mut self.0, format_args!("{value:?}"));
        }
    }
}

/// What rustls calls it, and what it is.
const CAUSES: [(&str, &str); 14] = [
    ("UnknownIssuer", "its certificate is of another authority"),
    ("UnknownCA", "its authority is another one"),
    ("BadSignature", "its certificate is of another authority"),
    ("DecryptError", "its authority is another one"),
    ("CertificateExpired", "it refuses this robot's certificate: expired"),
    ("Expired", "its certificate has expired"),
    ("NotValidYet", "its certificate is not valid yet: a clock is wrong"),
    ("NoCertificatesPresented", "it shows no certificate"),
    ("CertificateRequired", "it asks for a certificate"),
    ("peer sent no certificates", "it shows no certificate"),
    ("refused (os error", "nobody listens there"),
    ("deadline has elapsed", "no answer"),
    ("timed out", "no answer"),
    ("Timeout", "no answer"),
];

/// A line of Zenoh's log in words; none for those that say nothing of links.
fn in_words(line: &str) -> Option<(bool, String)> {
    let cause = CAUSES.iter().find(|(sign, _)| line.contains(sign)).map(|(_, words)| *words);
    if let Some(rest) =
        line.strip_prefix("Unable to connect to ").map(|rest| rest.trim_start_matches("configured peer "))
    {
        let (address, why) = rest.split_once('!')?;
        let why = cause.unwrap_or_else(|| why.split(". Retry in").next().unwrap_or(why).trim());
        return Some((false, format!("{address}: {why}")));
    }
    let (why, _) = line.split_once(". Hint: increase the system open file limit")?;
    Some((true, format!("someone who wants in is refused: {}", cause.unwrap_or(why))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn causes_are_told_in_words() {
        let line = "Unable to connect to configured peer tls/10.0.0.1:7447! Can not create a new TLS link bound to x: \
            invalid peer certificate: UnknownIssuer at y. Retry in 1s.";
        let told = "tls/10.0.0.1:7447: its certificate is of another authority";
        assert_eq!(in_words(line), Some((false, told.to_owned())));
        let line = "invalid peer certificate: Expired. Hint: increase the system open file limit.";
        let told = "someone who wants in is refused: its certificate has expired";
        assert_eq!(in_words(line), Some((true, told.to_owned())));
        assert_eq!(in_words("Listener added: tls/10.0.0.1:7447"), None);
    }
}
