//! Packets of Ouster's lidars (Ouster firmware user manual 2.x, "Lidar data packet format", "IMU data packet format" and "Coordinate frames
//! and XYZ calculation").

mod info;

use super::clock::{Clock, Tick};
use super::sweep::{Place, Sweep};
use crate::notes::{NoteKind, Notes};
use crate::scalar::array;
pub use info::OusterInfo;
use info::Profile;
use mapwright_geom::{Stamp, sin_cos};
use mapwright_sensor::{ImuReading, STANDARD_GRAVITY_M_PER_S2};
use nalgebra::{UnitQuaternion, Vector3};
use std::collections::VecDeque;
use std::f64::consts::TAU;
use std::sync::Arc;

/// A packet of the inertial sensor.
pub const OUSTER_IMU_BYTES: usize = 48;
/// A packet of points begins with this number, but in the legacy profile.
const POINTS: u16 = 1;
/// Columns of one packet that are farther apart are not of one revolution, nanoseconds.
const APART_NS: i64 = 1_000_000_000;
/// Metres of a distance's unit.
const DISTANCE_M: f64 = 0.001;
/// Of a revolution's columns so many are there in a whole one.
const WHOLE: f64 = 0.9;
/// The slowest sensor turns at 5 Hz; a cloud is not longer, nanoseconds.
const SWEEP_NS_MAX: i64 = 300_000_000;

/// Whether a datagram may be a packet of points: of a length that some sensor's packets have.
pub(super) fn is_like(payload: &[u8]) -> bool {
    let lengths = |profile: Profile, beams: usize| {
        let [before, behind, column, end] = profile.frame_bytes();
        before + behind + 16 * (column + beams * profile.reading_bytes() + end)
    };
    let is_one = |profile| [16, 32, 64, 128].iter().any(|beams| lengths(profile, *beams) == payload.len());
    let is_typed = array(payload, 0).map(u16::from_le_bytes) == Some(POINTS);
    let typed = [Profile::Single, Profile::Dual, Profile::LowRate, Profile::LowRateDual];
    is_one(Profile::Legacy) || (is_typed && typed.into_iter().any(is_one))
}

/// Makes revolutions of the packets of one sensor, and readings of those of its inertial one.
#[derive(Debug)]
pub(super) struct Decoder {
    info: Arc<OusterInfo>,
    /// Whether only revolutions are counted.
    is_counting: bool,
    clock: Clock,
    revolution: Option<Revolution>,
    ready: VecDeque<Sweep>,
    /// Sine and cosine of each column's azimuth to the left, and of each beam's beside it, to save their computation for each point.
    beams: Vec<(f64, f64)>,
}

/// A cloud that has begun.
#[derive(Debug)]
struct Revolution {
    number: u16,
    /// Columns that were valid.
    columns: usize,
    sweep: Sweep,
}

/// A column of readings.
struct Column<'a> {
    sensor_ns: i64,
    place: usize,
    readings: &'a [u8],
}

impl Decoder {
    pub(super) fn new(info: &Arc<OusterInfo>, is_counting: bool) -> Self {
        Self {
            info: Arc::clone(info),
            is_counting,
            clock: Clock::default(),
            revolution: None,
            ready: VecDeque::new(),
            beams: info.beams.iter().map(|beam| sin_cos(-beam.right_rad)).collect(),
        }
    }

    pub(super) fn add(&mut self, place: Place<'_>, captured: Stamp, payload: &[u8], notes: &mut Notes) {
        let expected = self.info.packet_bytes();
        if payload.len() != expected {
            let words = || (format!("{expected} bytes, as its metadata say"), format!("{}", payload.len()));
            return notes.note(NoteKind::BadPacket, place.file, place.at, words);
        }
        let info = Arc::clone(&self.info);
        let number = number(payload, info.is_numbered_in_columns());
        if self.revolution.as_ref().is_some_and(|open| open.number == number.wrapping_add(1)) {
            let words =
                || (format!("a packet of revolution {}", number.wrapping_add(1)), format!("one of {number}, late"));
            return notes.note(NoteKind::BadPacket, place.file, place.at, words);
        }
        let [before, ..] = info.profile.frame_bytes();
        let columns = payload.get(before..).unwrap_or_default().chunks_exact(info.column_bytes());
        let mut begin = None;
        for bytes in columns.take(info.columns_per_packet) {
            let Some(column) = column(bytes, &info) else { continue };
            let begin_ns =
                *begin.get_or_insert_with(|| (column.sensor_ns, self.time(place, captured, column.sensor_ns, notes)));
            let after_ns = column.sensor_ns.saturating_sub(begin_ns.0);
            if !(-APART_NS..=APART_NS).contains(&after_ns) {
                notes.note(NoteKind::BadPacket, place.file, place.at, || ("columns of one time", "others"));
                continue;
            }
            self.add_column(place, number, &column, Stamp(begin_ns.1.0.saturating_add(after_ns)), notes);
        }
    }

    /// When a packet's first column was taken.
    fn time(&mut self, place: Place<'_>, captured: Stamp, sensor_ns: i64, notes: &mut Notes) -> Stamp {
        let (stamp, tick) = self.clock.read(sensor_ns, captured);
        if let Tick::Jumped { captured_ns, sensor_ns } = tick {
            let words = || (format!("{} us later", captured_ns / 1000), format!("{} us", sensor_ns / 1000));
            notes.note(NoteKind::ClockJump, place.file, place.at, words);
            self.cut(place.file, notes);
        }
        stamp
    }

    fn add_column(&mut self, place: Place<'_>, number: u16, column: &Column<'_>, taken: Stamp, notes: &mut Notes) {
        let is_of_another =
            |open: &Revolution| open.number != number || taken.0.saturating_sub(open.sweep.stamp.0) > SWEEP_NS_MAX;
        if self.revolution.as_ref().is_some_and(is_of_another) {
            self.cut(place.file, notes);
        }
        let revolution = self.revolution.get_or_insert_with(|| Revolution {
            number,
            columns: 0,
            sweep: Sweep::begin(taken, place.at),
        });
        revolution.columns += 1;
        if self.is_counting {
            return;
        }
        let info = &*self.info;
        let (sin, cos) = sin_cos(TAU * (1.0 - column.place as f64 / info.columns_per_frame as f64));
        let readings = column.readings.chunks_exact(info.profile.reading_bytes());
        for ((reading, beam), (sin_beam, cos_beam)) in readings.zip(&info.beams).zip(&self.beams) {
            // the encoder's angle and the beam's beside it
            let (sin_there, cos_there) = (sin * cos_beam + cos * sin_beam, cos * cos_beam - sin * sin_beam);
            for (range_mm, reflectivity) in returns(info.profile, reading).into_iter().filter(|(range, _)| *range > 0) {
                let [out_m, up_m] = info.origin_m;
                let range_m = f64::from(range_mm) * DISTANCE_M - out_m.hypot(up_m);
                let level_m = range_m * beam.elevation.1;
                let in_lidar = Vector3::new(
                    level_m * cos_there + out_m * cos,
                    level_m * sin_there + out_m * sin,
                    range_m * beam.elevation.0 + up_m,
                );
                let point = info.sensor_from_lidar.transform(in_lidar);
                revolution.sweep.push([point.x, point.y, point.z], f32::from(reflectivity), taken);
            }
        }
    }

    /// Ends a cloud, if one has begun.
    pub(super) fn cut(&mut self, file: &str, notes: &mut Notes) {
        let Some(mut revolution) = self.revolution.take() else { return };
        let whole = self.info.columns_seen;
        if (revolution.columns as f64) < WHOLE * whole as f64 {
            let words = || (format!("{whole} columns"), revolution.columns.to_string());
            notes.note(NoteKind::PartialRevolution, file, revolution.sweep.at, words);
        }
        revolution.sweep.settle();
        self.ready.push_back(revolution.sweep);
    }

    pub(super) fn pop(&mut self) -> Option<Sweep> {
        self.ready.pop_front()
    }

    pub(super) fn is_ready(&self) -> bool {
        !self.ready.is_empty()
    }

    /// The reading of a packet of the inertial sensor, by the clock of the points' packets; none before the first of these.
    pub(super) fn reading(&self, payload: &[u8]) -> Option<ImuReading> {
        let (sensor_ns, reading) = imu(payload, self.info.sensor_from_imu)?;
        Some(ImuReading { stamp: self.clock.near(sensor_ns)?, ..reading })
    }
}

/// Which revolution a packet is of.
fn number(payload: &[u8], is_in_columns: bool) -> u16 {
    array(payload, if is_in_columns { 10 } else { 2 }).map_or(0, u16::from_le_bytes)
}

/// The numbers of revolutions that a packet may have, by where they may stand; for who counts before the metadata are there.
#[must_use]
pub fn ouster_numbers(payload: &[u8]) -> [u16; 2] {
    [false, true].map(|is_in_columns| number(payload, is_in_columns))
}

/// A column, if it is valid.
fn column<'a>(bytes: &'a [u8], info: &OusterInfo) -> Option<Column<'a>> {
    let [_, _, before, behind] = info.profile.frame_bytes();
    let is_valid = match info.profile {
        Profile::Legacy => array(bytes, bytes.len().checked_sub(4)?).map(u32::from_le_bytes)? == u32::MAX,
        _ => array(bytes, 10).map(u16::from_le_bytes)? & 1 == 1,
    };
    let sensor_ns = i64::try_from(array(bytes, 0).map(u64::from_le_bytes)?).ok()?;
    let place = usize::from(array(bytes, 8).map(u16::from_le_bytes)?);
    let readings = bytes.get(before..bytes.len().checked_sub(behind)?)?;
    (is_valid && place < info.columns_per_frame).then_some(Column { sensor_ns, place, readings })
}

/// The ranges of a reading, millimetres, and how much of the light came back; zero where nothing did. Both returns, where the second is
/// another.
fn returns(profile: Profile, reading: &[u8]) -> [(u32, u16); 2] {
    let u32_at = |at: usize, mask: u32| array(reading, at).map_or(0, u32::from_le_bytes) & mask;
    let u16_at = |at: usize| 8 * u32::from(array(reading, at).map_or(0, u16::from_le_bytes) & 0x7fff);
    let u8_at = |at: usize| reading.get(at).map_or(0, |byte| u16::from(*byte));
    let [first, second] = match profile {
        // firmware before 2.1 has it in 16 bits, later one in the lower 8
        Profile::Legacy => [(u32_at(0, 0x000f_ffff), array(reading, 4).map_or(0, u16::from_le_bytes)), (0, 0)],
        Profile::Single => [(u32_at(0, 0x0007_ffff), u8_at(4)), (0, 0)],
        Profile::Dual => [(u32_at(0, 0x0007_ffff), u8_at(3)), (u32_at(4, 0x0007_ffff), u8_at(7))],
        Profile::LowRate => [(u16_at(0), u8_at(2)), (0, 0)],
        Profile::LowRateDual => [(u16_at(0), u8_at(2)), (u16_at(4), u8_at(6))],
    };
    [first, if second.0 == first.0 { (0, 0) } else { second }]
}

/// A packet of the inertial sensor: when by the sensor's clock, nanoseconds, and the reading along the axes of the lidar.
#[must_use]
pub fn ouster_imu(payload: &[u8], info: &OusterInfo) -> Option<(i64, ImuReading)> {
    imu(payload, info.sensor_from_imu)
}

/// Three times (of the packet, of the accelerometer, of the gyroscope), then g and degrees a second along three axes.
fn imu(payload: &[u8], sensor_from_imu: UnitQuaternion<f64>) -> Option<(i64, ImuReading)> {
    let payload: &[u8; OUSTER_IMU_BYTES] = payload.try_into().ok()?;
    let sensor_ns = i64::try_from(array(payload, 16).map(u64::from_le_bytes)?).ok()?;
    let number =
        |place: usize| array(payload, 24 + 4 * place).map_or(0.0, |bytes| f64::from(f32::from_le_bytes(bytes)));
    let [force, turn] = [0, 3].map(|first| Vector3::new(number(first), number(first + 1), number(first + 2)));
    let reading = ImuReading {
        stamp: Stamp(sensor_ns),
        turn_rate_rad_per_s: sensor_from_imu * turn.map(f64::to_radians),
        specific_force_m_per_s2: Some(sensor_from_imu * force * STANDARD_GRAVITY_M_PER_S2),
    };
    reading.is_sound().then_some((sensor_ns, reading))
}

#[cfg(test)]
mod tests;
