//! Bytes of a scan to readings.

use super::packets::{Capsule, Node, Scan};
use crate::clock::Clock;
use crate::counts::Counts;
use crate::revolution::{Reading, Turns};
use mapwright_geom::Stamp;

/// So many nodes in a row with good check bits, each a little farther on, are no chance: five bytes have but three bits to be told by.
const NODES_FOUND: usize = 6;
/// A node counts once the next one is good as well: of one that was torn the rest is another one's.
const NODES_IN_STEP: usize = 2;
/// From node to node a lidar turns by less, degrees: 1.4 at 15 Hz and 4,000 a second, and some are lost.
const STEP_MOST_DEG: f64 = 30.0;
/// A capsule that turns by so many times what the last ones did is followed by lost ones.
const TURNED_MORE: f64 = 1.5;
/// Unless it turns like this twice in a row, within this share: that is how fast it turns now.
const AGAIN: f64 = 0.25;

/// A scan that goes on.
#[derive(Debug)]
pub(super) struct Scanning {
    scan: Scan,
    sample_ns: Option<i64>,
    is_in_step: bool,
    /// Waits for the next one, which says where its readings end.
    previous: Option<(Capsule, Stamp)>,
    /// How far a capsule turns, once two in a row agree, and how far the last one seemed to, 64ths of a degree.
    turn_q6: Option<i32>,
    seemed_q6: Option<i32>,
    number: u64,
    clock: Clock,
}

impl Default for Scanning {
    fn default() -> Self {
        Self::of(Scan::Standard, None)
    }
}

impl Scanning {
    /// A scan that has just begun: the next byte is its first one.
    pub(super) fn of(scan: Scan, sample_ns: Option<i64>) -> Self {
        Self {
            scan,
            sample_ns,
            is_in_step: true,
            previous: None,
            turn_q6: None,
            seemed_q6: None,
            number: 0,
            clock: Clock::default(),
        }
    }

    /// Reads a node or capsule, or passes over bytes: how many were done with, and whether they were good; none where more are needed.
    pub(super) fn step(
        &mut self,
        rest: &[u8],
        arrived: Stamp,
        turns: &mut Turns,
        counts: &mut Counts,
    ) -> Option<(usize, bool)> {
        if self.scan == Scan::Standard {
            self.step_node(rest, arrived, turns, counts)
        } else {
            self.step_capsule(rest, arrived, turns, counts)
        }
    }

    fn step_node(
        &mut self,
        rest: &[u8],
        arrived: Stamp,
        turns: &mut Turns,
        counts: &mut Counts,
    ) -> Option<(usize, bool)> {
        let bytes = Scan::Standard.bytes();
        let are_nodes = are_nodes(rest, if self.is_in_step { NODES_IN_STEP } else { NODES_FOUND })?;
        let node = Node::parse(rest.get(..bytes)?);
        let Some(node) = node.filter(|_| are_nodes) else { return Some((self.skip(1, counts), false)) };
        self.is_in_step = true;
        counts.packets += 1;
        counts.bytes_used += bytes as u64;
        self.push((node.clockwise_deg, node.range_m, node.quality), self.taken(arrived, 0), turns, counts);
        Some((bytes, true))
    }

    fn step_capsule(
        &mut self,
        rest: &[u8],
        arrived: Stamp,
        turns: &mut Turns,
        counts: &mut Counts,
    ) -> Option<(usize, bool)> {
        if rest.is_empty() {
            return None;
        }
        if !Capsule::may_begin(rest) {
            return Some((self.skip(1, counts), false));
        }
        let bytes = self.scan.bytes();
        let Some(capsule) = Capsule::parse(self.scan, rest.get(..bytes)?) else {
            // where the next one begins behind it, all of it is damaged; else it was none
            let is_whole = self.is_in_step && Capsule::may_begin(rest.get(bytes..bytes + 2)?);
            return Some((self.skip(if is_whole { bytes } else { 1 }, counts), false));
        };
        self.is_in_step = true;
        if capsule.is_plausible() {
            counts.packets += 1;
            counts.bytes_used += bytes as u64;
            self.add(capsule, arrived, turns, counts);
        } else {
            counts.implausible += 1;
            counts.bytes_skipped += bytes as u64;
            self.forget(counts);
        }
        Some((bytes, true))
    }

    fn skip(&mut self, bytes: usize, counts: &mut Counts) -> usize {
        counts.bad_checksums += u64::from(std::mem::take(&mut self.is_in_step));
        counts.bytes_skipped += bytes as u64;
        self.forget(counts);
        bytes
    }

    /// Nothing says any more where the readings of the capsule that waits end.
    fn forget(&mut self, counts: &mut Counts) {
        if self.previous.take().is_some() {
            counts.unplaced += 1;
            self.number += self.scan.readings() as u64;
        }
    }

    fn add(&mut self, capsule: Capsule, arrived: Stamp, turns: &mut Turns, counts: &mut Counts) {
        if capsule.is_first() {
            self.forget(counts);
        }
        if let Some((previous, then)) = self.previous.take() {
            let lost = self.lost(previous.turn_to_q6(&capsule));
            counts.lost += lost;
            if lost == 0 {
                for (place, (clockwise_deg, range_m)) in previous.readings(&capsule).into_iter().enumerate() {
                    let taken = self.taken(then, self.scan.readings() - 1 - place);
                    self.push((clockwise_deg, range_m, 0), taken, turns, counts);
                }
            } else {
                counts.unplaced += 1;
                self.number += (1 + lost) * self.scan.readings() as u64;
            }
        }
        self.previous = Some((capsule, arrived));
    }

    /// How many capsules were lost before one that lies so far ahead.
    fn lost(&mut self, seems_q6: i32) -> u64 {
        let before_q6 = self.seemed_q6.replace(seems_q6);
        let is_as_before =
            before_q6.is_some_and(|before| f64::from((seems_q6 - before).abs()) <= AGAIN * f64::from(before));
        match self.turn_q6 {
            Some(turn) if turn > 0 && !is_as_before && f64::from(seems_q6) > TURNED_MORE * f64::from(turn) => {
                ((f64::from(seems_q6) / f64::from(turn)).round() as u64).saturating_sub(1)
            }
            turn => {
                self.turn_q6 = turn.map(|_| seems_q6).or(is_as_before.then_some(seems_q6));
                0
            }
        }
    }

    /// When a reading was taken by the lidar's own count, where it says how fast it measures, and by arrival: so many more of its packet came after it.
    fn taken(&self, arrived: Stamp, after: usize) -> (Option<i64>, Stamp) {
        let Some(sample_ns) = self.sample_ns else { return (None, arrived) };
        let after_ns = sample_ns.saturating_mul(after as i64);
        let lidar_ns = sample_ns.saturating_mul(self.number.min(i64::MAX as u64) as i64);
        (Some(lidar_ns), Stamp(arrived.0.saturating_sub(after_ns)))
    }

    fn push(
        &mut self,
        (clockwise_deg, range_m, intensity): (f64, f32, u8),
        (lidar_ns, arrived): (Option<i64>, Stamp),
        turns: &mut Turns,
        counts: &mut Counts,
    ) {
        let stamp = lidar_ns.map_or(arrived, |lidar_ns| self.clock.read(lidar_ns, arrived));
        let lidar_ns = lidar_ns.unwrap_or(arrived.0);
        turns.push(Reading { clockwise_deg, range_m, intensity, number: self.number, lidar_ns, stamp }, counts);
        self.number += 1;
    }
}

/// Whether so many nodes begin here; none where more bytes are needed to know.
fn are_nodes(rest: &[u8], count: usize) -> Option<bool> {
    let mut last_deg: Option<f64> = None;
    for bytes in rest.chunks(Scan::Standard.bytes()).take(count) {
        if bytes.len() < Scan::Standard.bytes() {
            return None;
        }
        let Some(node) = Node::parse(bytes) else { return Some(false) };
        let step_deg = last_deg.map_or(0.0, |last| (node.clockwise_deg - last).rem_euclid(360.0));
        // angles may tremble by what corrects them
        if step_deg > STEP_MOST_DEG && step_deg < 360.0 - STEP_MOST_DEG / 2.0 {
            return Some(false);
        }
        last_deg = Some(node.clockwise_deg);
    }
    (rest.len() >= count * Scan::Standard.bytes()).then_some(true)
}
