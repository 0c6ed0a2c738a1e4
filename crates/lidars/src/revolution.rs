//! Revolutions, and where one ends.

use crate::counts::Counts;
use mapwright_geom::{Stamp, wrap_angle};
use std::collections::VecDeque;

/// No revolution has more beams: an RPLIDAR S3 has 3,200 at 10 Hz. A lidar that sends more has a motor that stands.
pub(crate) const BEAMS_MOST: usize = 1 << 15;
/// So many revolutions wait to be asked for; more push out the oldest.
const WAITING_MOST: usize = 64;
/// A revolution that took longer is of a motor that has stood still: its beams' times are not known, seconds.
const REVOLUTION_MOST_S: f64 = 2.0;

/// One reading of a lidar.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Beam {
    /// Where it looks: radians from -pi to pi, counter-clockwise from the lidar's x axis, which is where its own angle is zero (the front).
    pub bearing_rad: f64,
    /// Metres as the lidar says; zero where nothing came back.
    pub range_m: f32,
    /// How bright it came back, or how sure the lidar is of it, in its own units; zero where it does not say.
    pub intensity: u8,
    /// When it was taken after the revolution's stamp, seconds; zero for all where the time of the revolution is not known.
    pub time_s: f32,
}

/// What a lidar saw while it turned once, from its angle zero on.
#[derive(Debug, Clone, PartialEq)]
pub struct Revolution {
    /// When the first beam was taken.
    pub stamp: Stamp,
    /// Time from the first beam to the first one of the next revolution, seconds; zero where that is not known.
    pub duration_s: f64,
    /// Beams in the order in which they were taken; lost ones are missing, their times are not.
    pub beams: Vec<Beam>,
}

/// A reading as the lidar has it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Reading {
    /// Degrees clockwise from the front, from 0 to below 360.
    pub(crate) clockwise_deg: f64,
    pub(crate) range_m: f32,
    pub(crate) intensity: u8,
    /// Number of the reading since the lidar began, lost ones included.
    pub(crate) number: u64,
    /// By the lidar's clock, nanoseconds.
    pub(crate) lidar_ns: i64,
    pub(crate) stamp: Stamp,
}

/// Puts readings together: a revolution ends where the angle passes zero.
#[derive(Debug, Default)]
pub(crate) struct Turns {
    open: Option<Open>,
    /// The last reading's angle, degrees clockwise.
    last_deg: Option<f64>,
    /// The back was seen since the angle last passed zero: about zero, angles may tremble.
    was_behind: bool,
    ready: VecDeque<Revolution>,
}

#[derive(Debug)]
struct Open {
    first: Reading,
    /// Began where the angle passed zero.
    is_whole: bool,
    beams: Vec<Beam>,
    numbers: Vec<u64>,
}

impl Turns {
    pub(crate) fn push(&mut self, reading: Reading, counts: &mut Counts) {
        let angle_deg = reading.clockwise_deg;
        let passes_zero = self.was_behind && angle_deg < 90.0 && self.last_deg.is_some_and(|last| last >= 180.0);
        if passes_zero {
            self.close(Some(&reading), counts);
            self.was_behind = false;
        }
        self.was_behind |= (90.0..330.0).contains(&angle_deg);
        self.last_deg = Some(angle_deg);
        let open = self.open.get_or_insert_with(|| Open {
            first: reading,
            is_whole: passes_zero,
            beams: Vec::new(),
            numbers: Vec::new(),
        });
        open.beams.push(Beam {
            bearing_rad: wrap_angle(-angle_deg.to_radians()),
            range_m: reading.range_m,
            intensity: reading.intensity,
            time_s: 0.0,
        });
        open.numbers.push(reading.number);
        if open.beams.len() >= BEAMS_MOST {
            self.break_off(counts);
        }
    }

    /// Forgets the revolution that has begun: the line broke, or the lidar begins anew.
    pub(crate) fn break_off(&mut self, counts: &mut Counts) {
        self.close(None, counts);
        (self.last_deg, self.was_behind) = (None, false);
    }

    pub(crate) fn next(&mut self) -> Option<Revolution> {
        self.ready.pop_front()
    }

    fn close(&mut self, next: Option<&Reading>, counts: &mut Counts) {
        let Some(open) = self.open.take() else { return };
        let Some(next) = next.filter(|_| open.is_whole) else {
            counts.partial_revolutions += 1;
            return;
        };
        counts.revolutions += 1;
        self.ready.push_back(open.finish(next));
        if self.ready.len() > WAITING_MOST {
            self.ready.pop_front();
            counts.overtaken += 1;
        }
    }
}

impl Open {
    /// Readings come at an even rate, so that their numbers say when each was taken.
    fn finish(mut self, next: &Reading) -> Revolution {
        let duration_s = next.lidar_ns.saturating_sub(self.first.lidar_ns) as f64 * 1e-9;
        let duration_s = if (0.0..=REVOLUTION_MOST_S).contains(&duration_s) { duration_s } else { 0.0 };
        let all = next.number.saturating_sub(self.first.number).max(1) as f64;
        for (beam, number) in self.beams.iter_mut().zip(&self.numbers) {
            beam.time_s = (duration_s * number.saturating_sub(self.first.number) as f64 / all) as f32;
        }
        Revolution { stamp: self.first.stamp, duration_s, beams: self.beams }
    }
}
