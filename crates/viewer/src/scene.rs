//! What a page shows, as items of bytes with versions.

use crate::wire::{self, HEAD};
use std::collections::BTreeMap;

/// What an item is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Key {
    Frame,
    Words,
    Totals,
    Robot,
    Scan,
    Lines,
    Clock,
    Path(u32),
    Closures(u32),
    Tile(i32, i32),
    Cloud(u32),
}

impl Key {
    fn kind(self) -> u32 {
        match self {
            Self::Frame => wire::FRAME,
            Self::Words => wire::WORDS,
            Self::Totals => wire::TOTALS,
            Self::Robot => wire::ROBOT,
            Self::Scan => wire::SCAN,
            Self::Lines => wire::LINES,
            Self::Clock => wire::CLOCK,
            Self::Path(_) => wire::PATH,
            Self::Closures(_) => wire::CLOSURES,
            Self::Tile(..) => wire::TILE,
            Self::Cloud(_) => wire::CLOUD,
        }
    }
}

#[derive(Debug)]
struct Item {
    version: u64,
    bytes: Vec<u8>,
}

/// What a page shows: items of bytes, each with the version of the scene in which it changed last.
///
/// Whoever knows a version asks for what has changed since ([`Scene::since`]). However often and with whatever bound it asks, it ends up
/// with what somebody gets who knows nothing; the scene keeps nothing of who asks.
#[derive(Debug, Default)]
pub struct Scene {
    items: BTreeMap<Key, Item>,
    /// One version changes one item, so the versions that still stand say in which order items changed.
    changes: BTreeMap<u64, Key>,
    version: u64,
}

impl Scene {
    /// The present version; zero is an empty scene.
    #[must_use]
    pub fn version(&self) -> u64 {
        self.version
    }

    /// What has changed after a version, as one message ([`crate::wire`]): the oldest changes first, as many as fit into `most_bytes`, but
    /// one at least. Comes with the version that the message leads to. None where nothing has changed.
    #[must_use]
    pub fn since(&self, version: u64, most_bytes: usize) -> Option<(Vec<u8>, u64)> {
        let mut message = HEAD.to_vec();
        let mut reached = None;
        for (&version, key) in self.changes.range(version.saturating_add(1)..) {
            let Some(item) = self.items.get(key) else { continue };
            if reached.is_some() && message.len() + item.bytes.len() + 12 > most_bytes {
                break;
            }
            message.extend(key.kind().to_le_bytes());
            message.extend((item.bytes.len() as u32).to_le_bytes());
            message.extend(&item.bytes);
            message.resize(message.len().next_multiple_of(4), 0);
            reached = Some(version);
        }
        reached.map(|version| (message, version))
    }

    /// Bytes of all items.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.items.values().map(|item| item.bytes.len()).sum()
    }

    /// Sets an item; one that is the same already does not change.
    pub(crate) fn set(&mut self, key: Key, bytes: Vec<u8>) {
        if self.items.get(&key).is_some_and(|item| item.bytes == bytes) {
            return;
        }
        self.version += 1;
        let item = Item { version: self.version, bytes };
        if let Some(old) = self.items.insert(key, item) {
            self.changes.remove(&old.version);
        }
        self.changes.insert(self.version, key);
    }

    /// Forgets an item, of which a page is told otherwise.
    pub(crate) fn remove(&mut self, key: Key) {
        if let Some(old) = self.items.remove(&key) {
            self.changes.remove(&old.version);
        }
    }

    #[cfg(test)]
    fn keys(&self) -> impl Iterator<Item = Key> + '_ {
        self.items.keys().copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A page: by kind and place, what it was told last.
    #[derive(Default, PartialEq, Debug)]
    struct Page(BTreeMap<(u32, [u8; 8]), Vec<u8>>);

    impl Page {
        fn take(&mut self, message: &[u8]) {
            assert_eq!(message[..4], HEAD);
            let mut at = 4;
            let word = |at: usize| u32::from_le_bytes(message[at..at + 4].try_into().unwrap());
            while at < message.len() {
                let (kind, length) = (word(at), word(at + 4) as usize);
                let bytes = message[at + 8..at + 8 + length].to_vec();
                let mut place = [0; 8];
                let named = if kind == wire::TILE { 8 } else { 4 };
                place[..named].copy_from_slice(&bytes[..named]);
                self.0.insert((kind, place), bytes);
                at += 8 + length.next_multiple_of(4);
            }
        }
    }

    /// Sets the item `number`, one of few, to some bytes that begin with its place.
    fn set(scene: &mut Scene, number: u8, value: u8, length: u8) {
        let key = if number < 8 { Key::Tile(i32::from(number), -1) } else { Key::Path(u32::from(number)) };
        let place = match key {
            Key::Tile(x, y) => [x.to_le_bytes(), y.to_le_bytes()].concat(),
            _ => u32::from(number).to_le_bytes().to_vec(),
        };
        scene.set(key, [place, vec![value; usize::from(length)]].concat());
    }

    proptest! {
        #[test]
        fn who_asks_often_ends_up_with_what_a_late_joiner_gets(
            steps in prop::collection::vec((0_u8..16, 0_u8..4, 0_u8..40, 0_usize..400, prop::bool::ANY), 1..200),
        ) {
            let (mut scene, mut page, mut known) = (Scene::default(), Page::default(), 0);
            for (number, value, length, most_bytes, asks) in steps {
                set(&mut scene, number, value, length);
                if asks && let Some((message, version)) = scene.since(known, most_bytes) {
                    prop_assert!(version > known);
                    page.take(&message);
                    known = version;
                }
            }
            while let Some((message, version)) = scene.since(known, 100) {
                page.take(&message);
                known = version;
            }
            let mut late = Page::default();
            late.take(&scene.since(0, usize::MAX).unwrap().0);
            prop_assert_eq!(&page, &late);
            prop_assert_eq!(known, scene.version());
            prop_assert_eq!(late.0.len(), scene.keys().count());
        }
    }

    #[test]
    fn what_stays_the_same_is_not_told_again() {
        let mut scene = Scene::default();
        assert!(scene.since(0, 1000).is_none());
        scene.set(Key::Scan, vec![1, 2, 3]);
        scene.set(Key::Scan, vec![1, 2, 3]);
        assert_eq!(scene.version(), 1);
        scene.remove(Key::Scan);
        assert!(scene.since(0, 1000).is_none() && scene.bytes() == 0);
    }

    #[test]
    fn an_item_beyond_the_bound_comes_alone() {
        let mut scene = Scene::default();
        scene.set(Key::Scan, vec![7; 1000]);
        scene.set(Key::Lines, vec![8; 1000]);
        let (message, version) = scene.since(0, 10).unwrap();
        assert_eq!((message.len(), version), (4 + 8 + 1000, 1));
        assert_eq!(scene.since(version, 10).unwrap().1, 2);
    }
}
