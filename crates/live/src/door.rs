//! Between those who receive and the one who maps.

use std::collections::VecDeque;
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A lane of a [`Door`], from 0: messages of one push out none of another.
pub type Lane = usize;

/// What comes out at a [`Door`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Next<T> {
    /// The message that has waited longest.
    Message(T),
    /// None has come in time.
    Nothing,
    /// The door is closed and nothing is left.
    Closed,
}

/// A queue between threads, bounded lane by lane. Where a lane is full its oldest message goes: on a robot the newest wins. Who puts one in
/// never waits for who takes it out.
#[derive(Debug)]
pub struct Door<T> {
    inside: Mutex<Inside<T>>,
    came: Condvar,
}

#[derive(Debug)]
struct Inside<T> {
    /// In the order in which they came, each with its lane.
    messages: VecDeque<(Lane, T)>,
    lanes: Vec<LaneState>,
    is_closed: bool,
}

#[derive(Debug, Clone, Copy)]
struct LaneState {
    most: usize,
    waiting: usize,
    arrived: u64,
    overtaken: u64,
}

impl<T> Door<T> {
    /// With a lane for each of these numbers, the messages that it holds at most; at least one each.
    #[must_use]
    pub fn new(most: &[usize]) -> Self {
        let lane = |most: &usize| LaneState { most: (*most).max(1), waiting: 0, arrived: 0, overtaken: 0 };
        let lanes = most.iter().map(lane).collect();
        let inside = Inside { messages: VecDeque::new(), lanes, is_closed: false };
        Self { inside: Mutex::new(inside), came: Condvar::new() }
    }

    /// Puts a message in; false, and nothing else, where there is no such lane or the door is closed.
    pub fn put(&self, lane: Lane, message: T) -> bool {
        let mut inside = self.inside();
        let is_closed = inside.is_closed;
        let Some(state) = inside.lanes.get_mut(lane).filter(|_| !is_closed) else { return false };
        state.arrived += 1;
        let is_full = state.waiting >= state.most;
        if is_full {
            state.overtaken += 1;
        } else {
            state.waiting += 1;
        }
        let oldest = is_full.then(|| inside.messages.iter().position(|(of, _)| *of == lane)).flatten();
        // dropped once the door is free again
        let gone = oldest.and_then(|oldest| inside.messages.remove(oldest));
        inside.messages.push_back((lane, message));
        drop(inside);
        self.came.notify_one();
        drop(gone);
        true
    }

    /// Whether the next message of a lane would push out another.
    #[must_use]
    pub fn is_full(&self, lane: Lane) -> bool {
        let inside = self.inside();
        !inside.is_closed && inside.lanes.get(lane).is_some_and(|state| state.waiting >= state.most)
    }

    /// The message that has waited longest; waits for one, but no longer than that.
    pub fn next(&self, at_most: Duration) -> Next<T> {
        let is_empty = |inside: &mut Inside<T>| inside.messages.is_empty() && !inside.is_closed;
        let waited = self.came.wait_timeout_while(self.inside(), at_most, is_empty);
        let mut inside = waited.unwrap_or_else(PoisonError::into_inner).0;
        match inside.messages.pop_front() {
            Some((lane, message)) => {
                inside.lanes[lane].waiting -= 1;
                Next::Message(message)
            }
            None if inside.is_closed => Next::Closed,
            None => Next::Nothing,
        }
    }

    /// Nothing is put in any more; what waits still comes out.
    pub fn close(&self) {
        self.inside().is_closed = true;
        self.came.notify_all();
    }

    /// How many messages of a lane have arrived, and how many of them were overtaken by newer ones.
    #[must_use]
    pub fn counts(&self, lane: Lane) -> (u64, u64) {
        self.inside().lanes.get(lane).map_or((0, 0), |state| (state.arrived, state.overtaken))
    }

    /// No thread leaves it half changed: one that has panicked elsewhere does not take the others down.
    fn inside(&self) -> MutexGuard<'_, Inside<T>> {
        self.inside.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::sync::Arc;
    use std::thread;

    const SOON: Duration = Duration::from_millis(1);

    fn all(door: &Door<u32>) -> Vec<u32> {
        std::iter::from_fn(|| match door.next(Duration::ZERO) {
            Next::Message(message) => Some(message),
            _ => None,
        })
        .collect()
    }

    #[test]
    fn the_newest_win_lane_by_lane() {
        let door = Door::new(&[2, 3]);
        for message in 0..10 {
            assert!(door.put(0, message));
        }
        assert!(door.put(1, 100) && !door.put(2, 7), "there is no third lane");
        assert_eq!((door.counts(0), door.counts(1), door.counts(2)), ((10, 8), (1, 0), (0, 0)));
        assert_eq!(all(&door), [8, 9, 100]);
        assert_eq!(door.next(SOON), Next::Nothing);
    }

    #[test]
    fn what_waits_comes_out_of_a_closed_door() {
        let door = Door::new(&[2]);
        door.put(0, 1);
        assert!(!door.is_full(0));
        door.close();
        assert!(!door.put(0, 2), "closed");
        assert_eq!((door.next(SOON), door.next(SOON)), (Next::Message(1), Next::Closed));
        assert_eq!(door.counts(0), (1, 0));
    }

    #[test]
    fn who_waits_is_woken() {
        let door = Arc::new(Door::new(&[1]));
        let waiting = thread::spawn({
            let door = Arc::clone(&door);
            move || (door.next(Duration::from_secs(60)), door.next(Duration::from_secs(60)))
        });
        door.put(0, 5);
        while door.counts(0).0 == 0 || !door.inside().messages.is_empty() {
            thread::yield_now();
        }
        door.close();
        assert_eq!(waiting.join().unwrap(), (Next::Message(5), Next::Closed));
    }

    proptest! {
        #[test]
        fn nothing_is_lost_unseen(puts in prop::collection::vec((0..3_usize, any::<bool>()), 0..200)) {
            let door = Door::new(&[1, 4, 20]);
            let mut out = Vec::new();
            for (number, (lane, take)) in puts.iter().enumerate() {
                prop_assert!(door.put(*lane, number as u32));
                if *take && let Next::Message(message) = door.next(Duration::ZERO) {
                    out.push(message);
                }
            }
            out.extend(all(&door));
            prop_assert!(out.is_sorted(), "in the order in which they came");
            let (mut arrived, mut overtaken) = (0, 0);
            (0..3).map(|lane| door.counts(lane)).for_each(|(a, o)| { arrived += a; overtaken += o; });
            prop_assert_eq!((arrived, arrived - overtaken), (puts.len() as u64, out.len() as u64));
        }
    }
}
