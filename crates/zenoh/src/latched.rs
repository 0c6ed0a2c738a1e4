//! Messages that are kept for who comes late.
//!
//! What others see is `zenoh-ext`'s advanced publisher with a cache. The cache is ours, for two reasons: that one answers on the thread that reads
//! from who asks, of which there are two, and holds what new messages go into; and its word of which message was the newest waits for who takes
//! nothing. Each would let one who has stopped stop others.

use crate::keys::Attachment;
use std::collections::VecDeque;
use std::ops::RangeInclusive;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;
use zenoh::pubsub::{Publisher, PublisherBuilder, Subscriber};
use zenoh::qos::{CongestionControl, Priority, Reliability};
use zenoh::query::{Parameters, Query, Queryable};
use zenoh::sample::{Locality, Sample};
use zenoh::{Session, Wait};
use zenoh_ext::{AdvancedPublisher, AdvancedPublisherBuilderExt, MissDetectionConfig, z_serialize};

/// What is short and comes often goes before and beside all else, and makes nobody wait (`Drop`). Requests and their responses have the usual
/// priority, of which Zenoh lets nothing else go to a peer while a long one goes there; what is kept has a lower one.
pub(crate) fn short<'a, 'b>(publisher: PublisherBuilder<'a, 'b>) -> PublisherBuilder<'a, 'b> {
    publisher.congestion_control(CongestionControl::Drop).priority(Priority::DataHigh)
}

/// How often others are told which message was the newest, so that who has missed it asks for it; as rmw_zenoh does.
const NEWEST_EVERY: Duration = Duration::from_millis(500);
/// So many who come late are sent at a time what was kept.
const ANSWERED_MOST: usize = 32;

/// Sends the newest messages of a topic and keeps them for who comes late.
pub(crate) struct Latched {
    waiting: Arc<(Mutex<Waiting>, Condvar)>,
    depth: usize,
    thread: Option<JoinHandle<()>>,
    _keeps: Subscriber<()>,
    _answers: Queryable<()>,
}

#[derive(Default)]
struct Waiting {
    messages: VecDeque<(Vec<u8>, Attachment)>,
    is_over: bool,
}

/// What was sent last, oldest first.
type Kept = Mutex<VecDeque<Sample>>;

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Latched {
    pub(crate) fn advertise(session: &Session, key: &str, depth: u32) -> zenoh::Result<Self> {
        let depth = usize::try_from(depth).unwrap_or(usize::MAX).max(1);
        let publisher = session
            .declare_publisher(key.to_owned())
            .congestion_control(CongestionControl::Drop)
            .priority(Priority::DataLow)
            .reliability(Reliability::Reliable)
            .sample_miss_detection(MissDetectionConfig::default())
            .publisher_detection()
            .wait()?;
        let own = publisher.id();
        let cache_key = format!("{key}/@adv/pub/{}/{}/_", own.zid(), own.eid());
        let kept = Arc::<Kept>::default();
        let keep = {
            let kept = Arc::clone(&kept);
            move |sample: Sample| {
                if sample.source_info().is_some_and(|info| *info.source_id() == own) {
                    let mut kept = lock(&kept);
                    while kept.len() >= depth {
                        kept.pop_front();
                    }
                    kept.push_back(sample);
                }
            }
        };
        let keeps =
            session.declare_subscriber(key.to_owned()).allowed_origin(Locality::SessionLocal).callback(keep).wait()?;
        let answered = Arc::new(());
        let answer = move |query| answer_beside(query, &kept, &answered);
        let answers = session.declare_queryable(cache_key.clone()).callback(answer).wait()?;
        let newest = short(session.declare_publisher(cache_key)).wait()?;
        let waiting = Arc::<(Mutex<Waiting>, Condvar)>::default();
        let thread = thread::Builder::new().name("latched".to_owned()).spawn({
            let waiting = Arc::clone(&waiting);
            move || send_until_over(&publisher, &newest, &waiting)
        })?;
        Ok(Self { waiting, depth, thread: Some(thread), _keeps: keeps, _answers: answers })
    }

    /// Hands a message on; of those that still wait only the newest go.
    pub(crate) fn send(&self, message: Vec<u8>, attachment: Attachment) {
        let (waiting, changed) = &*self.waiting;
        let mut waiting = lock(waiting);
        while waiting.messages.len() >= self.depth {
            waiting.messages.pop_front();
        }
        waiting.messages.push_back((message, attachment));
        changed.notify_one();
    }
}

impl Drop for Latched {
    fn drop(&mut self) {
        lock(&self.waiting.0).is_over = true;
        self.waiting.1.notify_one();
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

/// What is to be done next.
enum Turn {
    Send(Vec<u8>, Attachment),
    TellNewest,
    End,
}

fn send_until_over(publisher: &AdvancedPublisher<'_>, newest: &Publisher<'_>, waiting: &(Mutex<Waiting>, Condvar)) {
    let mut sent = 0_u32;
    loop {
        // A session that is closed has nobody to send to.
        match next(waiting) {
            Turn::Send(message, attachment) => {
                let _ = publisher.put(message).attachment(attachment.to_bytes()).wait();
                sent = sent.wrapping_add(1);
            }
            // They are counted from 0.
            Turn::TellNewest if sent > 0 => drop(newest.put(z_serialize(&(sent - 1))).wait()),
            Turn::TellNewest => {}
            Turn::End => return,
        }
    }
}

fn next((waiting, changed): &(Mutex<Waiting>, Condvar)) -> Turn {
    let idle = |waiting: &mut Waiting| waiting.messages.is_empty() && !waiting.is_over;
    let (mut waiting, _) =
        changed.wait_timeout_while(lock(waiting), NEWEST_EVERY, idle).unwrap_or_else(PoisonError::into_inner);
    match waiting.messages.pop_front() {
        Some((message, attachment)) => Turn::Send(message, attachment),
        None if waiting.is_over => Turn::End,
        None => Turn::TellNewest,
    }
}

/// Sends what was kept on a thread of its own, until who asks has it or has taken nothing for too long.
fn answer_beside(query: Query, kept: &Arc<Kept>, answered: &Arc<()>) {
    if Arc::strong_count(answered) > ANSWERED_MOST {
        let _ = query.reply_err("too many are sent what was kept").wait();
        return;
    }
    let (samples, answered) = (wanted(&lock(kept), query.parameters()), Arc::clone(answered));
    // Without a thread the query ends unanswered, and is asked again once a newer message is told of.
    let _ = thread::Builder::new().name("kept".to_owned()).spawn(move || {
        for sample in samples {
            let reply = query.reply(sample.key_expr(), sample.payload().clone()).encoding(sample.encoding().clone());
            let reply = reply.attachment(sample.attachment().cloned()).timestamp(sample.timestamp().copied());
            // Whoever has gone meanwhile gets nothing.
            let _ = reply.source_info(sample.source_info().cloned()).wait();
        }
        drop(answered);
    });
}

/// Of what was kept the numbers that are asked for, and of these the newest.
fn wanted(kept: &VecDeque<Sample>, parameters: &Parameters<'_>) -> Vec<Sample> {
    let numbers = parameters.get("_sn").map_or(0..=u32::MAX, numbers);
    let most = parameters.get("_max").and_then(|text| text.parse().ok()).unwrap_or(usize::MAX);
    let is_asked = |sample: &&Sample| sample.source_info().is_some_and(|info| numbers.contains(&info.source_sn()));
    let asked: Vec<&Sample> = kept.iter().filter(is_asked).collect();
    asked[asked.len().saturating_sub(most)..].iter().map(|sample| (*sample).clone()).collect()
}

/// `3..7`, `3..`, `..7`, `3`; both ends are meant.
fn numbers(text: &str) -> RangeInclusive<u32> {
    let (from, to) = text.split_once("..").unwrap_or((text, text));
    from.parse().unwrap_or(0)..=to.parse().unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_as_they_are_asked_for() {
        assert_eq!((numbers("3..7"), numbers("3.."), numbers("..7")), (3..=7, 3..=u32::MAX, 0..=7));
        assert_eq!((numbers("3"), numbers(".."), numbers("a..b")), (3..=3, 0..=u32::MAX, 0..=u32::MAX));
    }
}
