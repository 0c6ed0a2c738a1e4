//! What a report says of something that happens often.

/// Places kept of each kind of remark; further ones are only counted.
pub(crate) const PLACES_KEPT: usize = 20;

/// A count, and the first places (line or message numbers) where it happened.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Noted {
    /// How often.
    pub count: u64,
    /// Where first, at most 20 of them.
    pub first_places: Vec<u64>,
}

impl Noted {
    /// Counts one more, at `place`.
    pub fn note(&mut self, place: u64) {
        self.count += 1;
        if self.first_places.len() < PLACES_KEPT {
            self.first_places.push(place);
        }
    }
}
