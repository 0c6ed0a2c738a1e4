//! A session out of any bytes: no length that they claim is believed beyond what they hold.

use super::{MAGIC, Session, SessionError, SessionScan, VERSION};
use crate::keyframe::{Edge, EdgeKind, Keyframe, KeyframeId};
use mapwright_geom::{Cov3, Pose2, Stamp};
use mapwright_sensor::{LaserModel, Sweep};
use std::sync::Arc;

/// Bytes of the checksum at the end.
const CHECKSUM_BYTES: usize = 4;
/// Least bytes of a laser, a scan, a keyframe and an edge.
const LEAST_BYTES: [usize; 4] = [69, 56, 109, 81];
/// Poses lie within, metres.
const FARTHEST_M: f64 = 1e6;
/// A code's step is at most this, metres: it reaches 32 km.
const STEP_AT_MOST_M: f64 = 0.5;
/// Motion during a sweep, metres and radians.
const SWEEP_MOTION_AT_MOST: f64 = 10.0;

impl Session {
    /// The session that these bytes are.
    ///
    /// # Errors
    /// Any [`SessionError`]; damage anywhere is one.
    pub fn decode(bytes: &[u8]) -> Result<Self, SessionError> {
        let body_bytes = bytes.len().saturating_sub(CHECKSUM_BYTES);
        let mut cursor = Cursor { bytes: &bytes[..body_bytes], at: 0 };
        cursor.begin(bytes)?;
        let settings = cursor.text("the settings")?;
        let [laser, scan, keyframe, edge] = LEAST_BYTES;
        let lasers = cursor.list("the lasers", laser, Cursor::laser)?;
        let scans = cursor.list("the scans", scan, Cursor::scan)?;
        let last_scan = scans.len();
        let keyframes = cursor.list("the keyframes", keyframe, |cursor| cursor.keyframe(&lasers, last_scan))?;
        let (keyframes, map_from_keyframe): (Vec<Keyframe>, Vec<Pose2>) = keyframes.into_iter().unzip();
        let edges = cursor.list("the edges", edge, |cursor| cursor.edge(&keyframes))?;
        cursor.end(bytes)?;
        Ok(Self { settings, scans, keyframes, map_from_keyframe, edges })
    }
}

struct Cursor<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Cursor<'a> {
    fn begin(&mut self, bytes: &[u8]) -> Result<(), SessionError> {
        if !bytes.starts_with(MAGIC) {
            return Err(SessionError::NoSession);
        }
        self.take(MAGIC.len(), "the file's first line")?;
        match u16::from_le_bytes(self.array("the version")?) {
            VERSION => Ok(()),
            found => Err(SessionError::Version { found }),
        }
    }

    /// Nothing follows but the checksum.
    fn end(&self, bytes: &[u8]) -> Result<(), SessionError> {
        let left = self.bytes.len() - self.at;
        if left > 0 {
            return Err(value(self.at, "the checksum at the file's end", format!("{left} bytes before it")));
        }
        let tail = bytes.get(self.at..).and_then(|tail| tail.first_chunk().copied());
        let expected = tail.map(u32::from_le_bytes).unwrap_or_default();
        let found = crc32fast::hash(self.bytes);
        if expected == found { Ok(()) } else { Err(SessionError::Checksum { expected, found }) }
    }

    fn take(&mut self, length: usize, expected: &'static str) -> Result<&'a [u8], SessionError> {
        let left = &self.bytes[self.at..];
        let Some(taken) = left.get(..length) else {
            return Err(SessionError::Cut { offset_bytes: self.at, expected, left_bytes: left.len() });
        };
        self.at += length;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self, expected: &'static str) -> Result<[u8; N], SessionError> {
        let mut array = [0; N];
        array.copy_from_slice(self.take(N, expected)?);
        Ok(array)
    }

    fn u32(&mut self, expected: &'static str) -> Result<u32, SessionError> {
        Ok(u32::from_le_bytes(self.array(expected)?))
    }

    fn stamp(&mut self) -> Result<Stamp, SessionError> {
        Ok(Stamp(i64::from_le_bytes(self.array("a stamp")?)))
    }

    fn number(&mut self, expected: &'static str) -> Result<f64, SessionError> {
        Ok(f64::from_le_bytes(self.array(expected)?))
    }

    fn flag(&mut self, expected: &'static str) -> Result<bool, SessionError> {
        let at = self.at;
        match self.array(expected)? {
            [0] => Ok(false),
            [1] => Ok(true),
            [other] => Err(value(at, expected, other.to_string())),
        }
    }

    fn text(&mut self, expected: &'static str) -> Result<String, SessionError> {
        let at = self.at;
        let length = self.u32(expected)? as usize;
        let text = std::str::from_utf8(self.take(length, expected)?);
        text.map(str::to_owned).map_err(|_| value(at, expected, "bytes that are no UTF-8".to_owned()))
    }

    /// A counted list whose items take at least so many bytes each.
    fn list<T>(
        &mut self,
        expected: &'static str,
        least_bytes: usize,
        mut item: impl FnMut(&mut Self) -> Result<T, SessionError>,
    ) -> Result<Vec<T>, SessionError> {
        let at = self.at;
        let count = self.u32(expected)? as usize;
        let left_bytes = self.bytes.len() - self.at;
        if count > left_bytes / least_bytes {
            return Err(SessionError::Cut { offset_bytes: at, expected, left_bytes });
        }
        (0..count).map(|_| item(self)).collect()
    }

    fn pose(&mut self) -> Result<Pose2, SessionError> {
        let (at, expected) = (self.at, "a pose within 10^6 m, its heading within half a turn");
        let [x, y, theta] = [self.number(expected)?, self.number(expected)?, self.number(expected)?];
        let usable = x.abs() <= FARTHEST_M && y.abs() <= FARTHEST_M && theta.abs() <= std::f64::consts::PI;
        // not `new`, which wraps and may change the last digit
        if usable { Ok(Pose2 { x, y, theta }) } else { Err(value(at, expected, format!("{x} {y} {theta}"))) }
    }

    fn laser(&mut self) -> Result<Arc<LaserModel>, SessionError> {
        let at = self.at;
        let name = self.text("a laser's name")?;
        let mut number = || self.number("a laser's geometry");
        let [angle_min_rad, angle_step_rad, range_min_m, range_max_m, beam_period_s] =
            [number()?, number()?, number()?, number()?, number()?];
        let robot_from_laser = self.pose()?;
        let inverted = self.flag("whether a laser is upside down, 0 or 1")?;
        let laser = LaserModel {
            name,
            angle_min_rad,
            angle_step_rad,
            range_min_m,
            range_max_m,
            robot_from_laser,
            inverted,
            beam_period_s,
        };
        match laser.check(1) {
            Ok(()) => Ok(Arc::new(laser)),
            Err(reason) => Err(value(at, "a laser that can be mapped with", reason.to_owned())),
        }
    }

    fn scan(&mut self) -> Result<SessionScan, SessionError> {
        Ok(SessionScan { stamp: self.stamp()?, map_from_robot: self.pose()?, odom_from_robot: self.pose()? })
    }

    fn keyframe(&mut self, lasers: &[Arc<LaserModel>], scans: usize) -> Result<(Keyframe, Pose2), SessionError> {
        let robot = u128::from_le_bytes(self.array("a keyframe's name")?);
        let id = KeyframeId { robot, session: self.u32("a keyframe's name")?, seq: self.u32("a keyframe's name")? };
        let stamp = self.stamp()?;
        let at = self.at;
        let scan = u64::from_le_bytes(self.array("a keyframe's scan")?);
        if scan >= scans as u64 {
            return Err(value(at, "the number of one of the scans", scan.to_string()));
        }
        let map_from_keyframe = self.pose()?;
        let at = self.at;
        let number = self.u32("a keyframe's laser")?;
        let laser = lasers.get(number as usize);
        let laser = laser.ok_or_else(|| value(at, "the number of one of the lasers", number.to_string()))?;
        Ok((Keyframe { id, stamp, scan, sweep: self.sweep(laser)? }, map_from_keyframe))
    }

    fn sweep(&mut self, laser: &Arc<LaserModel>) -> Result<Sweep, SessionError> {
        let (at, expected) = (self.at, "a sweep");
        let step_m = self.number(expected)?;
        let twist_per_s = [self.number(expected)?, self.number(expected)?, self.number(expected)?];
        let scatters = self.flag("whether the laser scatters, 0 or 1")?;
        let beams = self.u32("a sweep's beams")? as usize;
        let bytes = self.take(beams.saturating_mul(2), "a sweep's beams")?;
        if !(step_m > 0.0 && step_m <= STEP_AT_MOST_M) {
            return Err(value(at, "a step of ranges up to 0.5 m", step_m.to_string()));
        }
        if let Err(reason) = laser.check(beams) {
            return Err(value(at, "a sweep of a laser that can be mapped with", reason.to_owned()));
        }
        let sweep_s = (laser.beam_period_s * beams as f64).abs();
        if !twist_per_s.iter().all(|rate| rate.is_finite() && rate.abs() * sweep_s <= SWEEP_MOTION_AT_MOST) {
            return Err(value(at, "at most 10 m and 10 rad of motion in a sweep", format!("{twist_per_s:?} a second")));
        }
        let codes = bytes.as_chunks().0.iter().map(|code| u16::from_le_bytes(*code)).collect();
        Ok(Sweep { laser: Arc::clone(laser), codes, step_m, twist_per_s, scatters })
    }

    fn edge(&mut self, keyframes: &[Keyframe]) -> Result<Edge, SessionError> {
        let [from, to] = [self.end_of_edge(keyframes)?, self.end_of_edge(keyframes)?];
        let at = self.at;
        let kind = match self.array("an edge's kind")? {
            [0] => EdgeKind::Odometry,
            [1] => EdgeKind::Match,
            [2] => EdgeKind::Closure,
            [other] => return Err(value(at, "an edge's kind, 0 to 2", other.to_string())),
        };
        let from_from_to = self.pose()?;
        let mut information = Cov3::zeros();
        for row in 0..3 {
            for column in row..3 {
                let at = self.at;
                let entry = self.number("an edge's information")?;
                if !entry.is_finite() {
                    return Err(value(at, "a finite information", entry.to_string()));
                }
                (information[(row, column)], information[(column, row)]) = (entry, entry);
            }
        }
        Ok(Edge { from, to, kind, from_from_to, information })
    }

    fn end_of_edge(&mut self, keyframes: &[Keyframe]) -> Result<KeyframeId, SessionError> {
        let at = self.at;
        let number = self.u32("an edge's keyframe")?;
        let keyframe = keyframes.get(number as usize);
        keyframe
            .map(|keyframe| keyframe.id)
            .ok_or_else(|| value(at, "the number of one of the keyframes", number.to_string()))
    }
}

fn value(offset_bytes: usize, expected: &'static str, found: String) -> SessionError {
    SessionError::Value { offset_bytes, expected, found }
}
