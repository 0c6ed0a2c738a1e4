//! What is known of cycles, as bytes.

use super::apart::Apart;
use super::looks::{Looked, Looks};
use super::supports::Supports;
use super::{Closing, ClosingSettings};
use crate::submaps::Submaps;
use mapwright_geom::Stored;
use mapwright_record::Past;

impl<S: Submaps> Closing<S> {
    /// Appends all that it knows.
    pub fn put(&self, out: &mut Vec<u8>) {
        self.waiting.put(out);
        (self.looks.present.checked_m, self.looks.present.asked_m, self.described, self.described_m).put(out);
        (self.strained, self.urgent, self.unseen).put(out);
        self.supports.put(out);
        self.places.put(out);
    }

    /// Goes on as it was; `past` is all of the session.
    #[must_use]
    pub fn restore(settings: ClosingSettings, past: Past<'_, S::Measurement>, from: &mut &[u8]) -> Option<Self> {
        let waiting: Vec<u32> = Stored::take(from)?;
        let (checked_m, asked_m, described, described_m) = Stored::take(from)?;
        let (strained, urgent, unseen) = Stored::take(from)?;
        let supports = Supports::restore(past, from)?;
        let apart = Apart::of(past);
        let places = S::Places::take(from)?;
        let is_sound = waiting.iter().all(|&number| (number as usize) < past.session.candidates().len())
            && S::remembered(&places).iter().all(|&node| past.has(node));
        let known = Self {
            waiting,
            looks: Looks::of(Looked { checked_m, asked_m }),
            described,
            described_m,
            ..Self::new(settings)
        };
        is_sound.then_some(Self { strained, urgent, unseen, supports, apart, places, ..known })
    }
}
