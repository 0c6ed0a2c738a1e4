//! Clouds of packets, and where a revolution ends.

use crate::notes::{NoteKind, Notes};
use mapwright_geom::Stamp;
use std::collections::VecDeque;

/// Hundredths of a degree in a revolution.
pub(super) const TURN: u32 = 36_000;
/// Clouds of less are noted, hundredths of a degree.
const WHOLE: u32 = 35_000;
/// The slowest sensor turns at 5 Hz; a cloud is not longer, nanoseconds.
const SWEEP_NS_MAX: i64 = 300_000_000;
/// No cloud has more points: a VLS-128 at 5 Hz with two returns has 960,000.
const POINTS_MAX: usize = 1 << 20;

/// Where a packet stands: the file or topic, and the byte.
#[derive(Debug, Clone, Copy)]
pub struct Place<'a> {
    /// The file or topic.
    pub file: &'a str,
    /// Where in it.
    pub at: usize,
}

/// A revolution.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Sweep {
    /// When its first laser fired.
    pub stamp: Stamp,
    /// Points in the sensor's frame, metres.
    pub points_m: Vec<[f32; 3]>,
    /// When each was taken after the stamp, seconds.
    pub times_s: Vec<f32>,
    /// How bright each came back, as the sensor has it (to 255; to 65,535 in an Ouster's legacy packets); empty where all are the same.
    pub intensities: Vec<f32>,
    /// Where its first packet stands in the file.
    pub at: usize,
}

impl Sweep {
    pub(super) fn begin(stamp: Stamp, at: usize) -> Self {
        Self { stamp, at, ..Self::default() }
    }

    /// A point that came back so bright and was taken at a time.
    pub(super) fn push(&mut self, point_m: [f64; 3], intensity: f32, taken: Stamp) {
        if self.points_m.len() < POINTS_MAX {
            self.points_m.push(point_m.map(|v| v as f32));
            self.intensities.push(intensity);
            self.times_s.push((taken.0.saturating_sub(self.stamp.0) as f64 * 1e-9) as f32);
        }
    }

    /// Begins with its first point, where packets came in another order than they were sent in.
    pub(super) fn settle(&mut self) {
        let first_s = self.times_s.iter().copied().fold(0.0, f32::min);
        if first_s < 0.0 {
            self.stamp = Stamp(self.stamp.0.saturating_add(Stamp::from_secs_f64(f64::from(first_s)).0));
            self.times_s.iter_mut().for_each(|time_s| *time_s -= first_s);
        }
    }

    /// When its last point was taken.
    pub(super) fn end(&self) -> Stamp {
        let last_s = self.times_s.iter().copied().fold(0.0, f32::max);
        Stamp(self.stamp.0.saturating_add(Stamp::from_secs_f64(f64::from(last_s)).0))
    }
}

/// The revolutions of a sensor that says where it looks: one ends where the sensor has turned once since it began.
#[derive(Debug, Default)]
pub(super) struct Revolutions {
    azimuth: Option<u32>,
    /// How far the cloud that has begun has turned, hundredths of a degree.
    turned: u32,
    sweep: Option<Sweep>,
    pub(super) ready: VecDeque<Sweep>,
}

impl Revolutions {
    /// Goes on to an azimuth, hundredths of a degree below a turn.
    pub(super) fn turn(&mut self, place: Place<'_>, azimuth: u32, stamp: Stamp, notes: &mut Notes) {
        let advance = self.azimuth.map_or(0, |last| (azimuth + TURN - last) % TURN);
        self.azimuth = Some(azimuth);
        // half a turn forward is a step back: the sensor trembles
        self.turned += if advance < TURN / 2 { advance } else { 0 };
        let began = self.sweep.as_ref().map(|sweep| sweep.stamp.0);
        let is_too_long = began.is_some_and(|began| stamp.0.saturating_sub(began) > SWEEP_NS_MAX);
        if self.turned >= TURN || is_too_long {
            let beyond = self.turned.saturating_sub(TURN);
            self.cut(place.file, notes);
            self.turned = beyond;
            self.azimuth = Some(azimuth);
        }
        self.sweep.get_or_insert_with(|| Sweep::begin(stamp, place.at));
    }

    /// The cloud that has begun.
    pub(super) fn open(&mut self) -> Option<&mut Sweep> {
        self.sweep.as_mut()
    }

    /// Ends a cloud, if one has begun.
    pub(super) fn cut(&mut self, file: &str, notes: &mut Notes) {
        let turned = std::mem::take(&mut self.turned);
        self.azimuth = None;
        let Some(sweep) = self.sweep.take() else { return };
        if turned < WHOLE {
            let found = || ("360 degrees", format!("{:.1}", f64::from(turned) * 0.01));
            notes.note(NoteKind::PartialRevolution, file, sweep.at, found);
        }
        self.ready.push_back(sweep);
    }
}
