//! Places of keyframes among those of a session.

use mapwright_geom::Stored;

/// Place of a keyframe among those of a session; outside a run a keyframe goes by its [`KeyframeId`](crate::KeyframeId).
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct NodeId(u32);

impl NodeId {
    /// The keyframe with this number, from 0.
    #[must_use]
    pub const fn new(number: u32) -> Self {
        Self(number)
    }

    /// The keyframe at this place; a session has less than 2^32.
    #[must_use]
    pub const fn at(place: usize) -> Self {
        Self(place as u32)
    }

    /// The first so many keyframes, in order.
    pub fn first(count: usize) -> impl DoubleEndedIterator<Item = Self> + ExactSizeIterator {
        (0..count).map(Self::at)
    }

    /// Where it stands in a slice of something for each keyframe.
    #[must_use]
    pub const fn index(self) -> usize {
        self.0 as usize
    }

    /// The keyframe after it.
    #[must_use]
    pub const fn next(self) -> Self {
        Self(self.0 + 1)
    }

    /// The keyframe before it, if it is not the first.
    #[must_use]
    pub fn before(self) -> Option<Self> {
        self.0.checked_sub(1).map(Self)
    }

    /// Its number, for what counts owners without knowing of keyframes.
    #[must_use]
    pub const fn number(self) -> u32 {
        self.0
    }
}

/// As its number.
impl Stored for NodeId {
    fn put(&self, out: &mut Vec<u8>) {
        self.0.put(out);
    }

    fn take(from: &mut &[u8]) -> Option<Self> {
        Stored::take(from).map(Self)
    }
}
