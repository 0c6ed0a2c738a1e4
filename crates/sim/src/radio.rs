//! Radios between robots: what one sends the others hear late, twice, out of order or not at all.

use crate::rng::Rng;
use mapwright_geom::Stamp;
use std::collections::BTreeMap;

/// What becomes of messages.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RadioSettings {
    /// Share that is lost, 0 to 1.
    pub loss: f64,
    /// Share that comes twice, 0 to 1.
    pub doubled: f64,
    /// Shortest and longest time under way, seconds; drawn anew for each message, so that they overtake each other.
    pub delay_s: [f64; 2],
    /// Everything random is drawn from it.
    pub seed: u64,
}

impl Default for RadioSettings {
    fn default() -> Self {
        Self { loss: 0.0, doubled: 0.0, delay_s: [0.005, 0.05], seed: 0 }
    }
}

/// A message under way.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Arrival {
    /// Who hears it.
    pub to: usize,
    /// The message.
    pub bytes: Vec<u8>,
}

/// The air between so many robots.
#[derive(Debug, Clone)]
pub struct Radio {
    settings: RadioSettings,
    rng: Rng,
    /// By when they arrive, and in the order in which they were sent.
    under_way: BTreeMap<(i64, u64), Arrival>,
    sent: u64,
    sent_bytes: u64,
    carried: u64,
}

impl Radio {
    /// Nothing is under way.
    #[must_use]
    pub fn new(settings: RadioSettings) -> Self {
        Self {
            settings,
            rng: Rng::keyed(settings.seed, 0x7261_6469),
            under_way: BTreeMap::new(),
            sent: 0,
            sent_bytes: 0,
            carried: 0,
        }
    }

    /// Sends a message to one robot; `is_in_reach` says whether that hears the sender now. It counts as sent all the same.
    pub fn send(&mut self, now: Stamp, to: usize, bytes: &[u8], is_in_reach: bool) {
        self.sent += 1;
        self.sent_bytes += bytes.len() as u64;
        let RadioSettings { loss, doubled, delay_s: [shortest_s, longest_s], .. } = self.settings;
        let times = 1 + usize::from(self.rng.chance(doubled));
        for _ in 0..times {
            let is_lost = self.rng.chance(loss);
            let delay_s = self.rng.uniform(shortest_s, longest_s);
            if is_in_reach && !is_lost {
                let at = now.0.saturating_add((delay_s * 1e9) as i64);
                self.carried += 1;
                self.under_way.insert((at, self.carried), Arrival { to, bytes: bytes.to_vec() });
            }
        }
    }

    /// What has arrived by now, in order.
    pub fn receive(&mut self, now: Stamp) -> Vec<Arrival> {
        let later = self.under_way.split_off(&(now.0.saturating_add(1), 0));
        std::mem::replace(&mut self.under_way, later).into_values().collect()
    }

    /// Messages and bytes that were sent.
    #[must_use]
    pub fn sent(&self) -> (u64, u64) {
        (self.sent, self.sent_bytes)
    }

    /// Messages are lost as often as this from now on, 0 to 1.
    pub fn set_loss(&mut self, loss: f64) {
        self.settings.loss = loss;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn as_many_are_lost_and_doubled_as_are_said() {
        let settings = RadioSettings { loss: 0.3, doubled: 0.2, seed: 5, ..RadioSettings::default() };
        let mut radio = Radio::new(settings);
        (0..10_000_u32).for_each(|k| radio.send(Stamp(0), 1, &k.to_le_bytes(), true));
        radio.send(Stamp(0), 1, &[0], false);
        let early = radio.receive(Stamp(4_000_000)).len();
        let arrived = radio.receive(Stamp(1_000_000_000));
        assert_eq!((early, radio.sent()), (0, (10_001, 40_001)));
        // 1.2 times 0.7 of them.
        assert!((8_200..8_600).contains(&arrived.len()), "{}", arrived.len());
        assert!(!arrived.windows(2).all(|pair| pair[0].bytes <= pair[1].bytes), "all in order");
        assert!(radio.receive(Stamp(i64::MAX)).is_empty());
    }
}
