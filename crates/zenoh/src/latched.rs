//! Messages that are kept for who comes late, sent by a thread of their own: one who comes late and then takes nothing holds the cache
//! that new messages go into, for as long as Zenoh has patience with it.

use crate::keys::Attachment;
use std::collections::VecDeque;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;
use zenoh::qos::{CongestionControl, Priority, Reliability};
use zenoh::{Session, Wait};
use zenoh_ext::{AdvancedPublisher, AdvancedPublisherBuilderExt, CacheConfig, MissDetectionConfig};

/// How often others are told which message was the newest, so that who has missed it asks for it; as rmw_zenoh does.
const NEWEST_EVERY: Duration = Duration::from_millis(500);

/// Sends the newest messages of a topic and keeps them for who comes late.
pub(crate) struct Latched {
    waiting: Arc<(Mutex<Waiting>, Condvar)>,
    depth: usize,
    thread: Option<JoinHandle<()>>,
}

#[derive(Default)]
struct Waiting {
    messages: VecDeque<(Vec<u8>, Attachment)>,
    is_over: bool,
}

fn lock(waiting: &Mutex<Waiting>) -> MutexGuard<'_, Waiting> {
    waiting.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Latched {
    pub(crate) fn advertise(session: &Session, key: String, depth: u32) -> zenoh::Result<Self> {
        let depth = usize::try_from(depth).unwrap_or(usize::MAX).max(1);
        let publisher = session
            .declare_publisher(key)
            .congestion_control(CongestionControl::Drop)
            .priority(Priority::DataLow)
            .reliability(Reliability::Reliable)
            .cache(CacheConfig::default().max_samples(depth))
            .sample_miss_detection(MissDetectionConfig::default().sporadic_heartbeat(NEWEST_EVERY))
            .publisher_detection()
            .wait()?;
        let waiting = Arc::<(Mutex<Waiting>, Condvar)>::default();
        let thread = thread::Builder::new().name("latched".to_owned()).spawn({
            let waiting = Arc::clone(&waiting);
            move || send_until_over(&publisher, &waiting)
        })?;
        Ok(Self { waiting, depth, thread: Some(thread) })
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

fn send_until_over(publisher: &AdvancedPublisher<'_>, waiting: &(Mutex<Waiting>, Condvar)) {
    while let Some((message, attachment)) = next(waiting) {
        // A session that is closed has nobody to send to.
        let _ = publisher.put(message).attachment(attachment.to_bytes()).wait();
    }
}

/// The next message; none where there will be none.
fn next((waiting, changed): &(Mutex<Waiting>, Condvar)) -> Option<(Vec<u8>, Attachment)> {
    let mut waiting = lock(waiting);
    loop {
        match waiting.messages.pop_front() {
            None if !waiting.is_over => waiting = changed.wait(waiting).unwrap_or_else(PoisonError::into_inner),
            message => return message,
        }
    }
}
