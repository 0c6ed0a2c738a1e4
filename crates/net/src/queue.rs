//! Messages that wait, bounded in bytes: what does not fit is dropped and counted.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

pub(crate) struct Queue<T> {
    inner: Mutex<Inner<T>>,
    has_more: Condvar,
    bytes_at_most: usize,
}

struct Inner<T> {
    /// Urgent ones, and the others.
    waiting: [VecDeque<(usize, T)>; 2],
    bytes: usize,
    dropped: u64,
    is_closed: bool,
}

impl<T> Inner<T> {
    fn is_empty(&self) -> bool {
        self.waiting.iter().all(VecDeque::is_empty)
    }

    fn pop(&mut self) -> Option<(usize, T)> {
        self.waiting.iter_mut().find_map(VecDeque::pop_front)
    }
}

impl<T> Queue<T> {
    pub(crate) fn new(bytes_at_most: usize) -> Self {
        let inner = Inner { waiting: [VecDeque::new(), VecDeque::new()], bytes: 0, dropped: 0, is_closed: false };
        Self { inner: Mutex::new(inner), has_more: Condvar::new(), bytes_at_most }
    }

    fn lock(&self) -> MutexGuard<'_, Inner<T>> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Puts a message of so many bytes last, or last of the urgent ones, which go before.
    pub(crate) fn push(&self, bytes: usize, is_urgent: bool, message: T) {
        // Of messages without bytes there may not be any number either.
        let bytes = bytes + size_of::<(usize, T)>();
        let mut inner = self.lock();
        if inner.is_closed || inner.bytes + bytes > self.bytes_at_most {
            inner.dropped += 1;
            return;
        }
        inner.bytes += bytes;
        inner.waiting[usize::from(!is_urgent)].push_back((bytes, message));
        drop(inner);
        self.has_more.notify_one();
    }

    /// The first message; none where none comes within that time.
    pub(crate) fn pop(&self, wait: Duration) -> Option<T> {
        let inner = self.lock();
        let is_empty = |inner: &mut Inner<T>| inner.is_empty() && !inner.is_closed;
        let waited = self.has_more.wait_timeout_while(inner, wait, is_empty);
        let (mut inner, _) = waited.unwrap_or_else(PoisonError::into_inner);
        let (bytes, message) = inner.pop()?;
        inner.bytes -= bytes;
        Some(message)
    }

    pub(crate) fn dropped(&self) -> u64 {
        self.lock().dropped
    }

    pub(crate) fn close(&self) {
        self.lock().is_closed = true;
        self.has_more.notify_all();
    }

    pub(crate) fn is_over(&self) -> bool {
        let inner = self.lock();
        inner.is_closed && inner.is_empty()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_is_dropped_and_counted_and_urgent_ones_go_first() {
        let queue = Queue::new(1000);
        (0..20).for_each(|k| queue.push(100, false, k));
        let kept = std::iter::from_fn(|| queue.pop(Duration::ZERO)).collect::<Vec<i32>>();
        assert!(kept.len() < 10 && kept == (0..kept.len() as i32).collect::<Vec<_>>(), "{kept:?}");
        assert_eq!(queue.dropped(), 20 - kept.len() as u64);
        queue.push(1, false, 1);
        queue.push(1, true, 2);
        queue.push(1, true, 3);
        assert_eq!([(); 3].map(|()| queue.pop(Duration::ZERO)), [Some(2), Some(3), Some(1)]);
        queue.close();
        queue.push(1, false, 3);
        assert!(queue.pop(Duration::from_secs(60)).is_none() && queue.is_over());
    }
}
