//! What the page and the view say to each other.
//!
//! **From the view**: binary messages, little endian. Each begins with the four bytes `MW`, 1 (the version), 0, and is a row of records: a
//! kind (`u32`), the length of what follows (`u32`, bytes), and that, filled up with zeros to a multiple of four bytes. Metres, seconds,
//! radians; positions in the frame of the map, x and y in the plane, z up. Keyframes are counted from zero in the order they were made.
//!
//! - 1 frame: `f32` side of a cell in metres; `u32` 1 for maps of space, else 0; `u32` abilities: 1 the run can be paused, 2 it has a time
//!   line
//! - 2 tile: `i32` column, `i32` row of the tile; its 64 x 64 cells from the lowest row on, each row by rising x: pairs of a count (`u8`,
//!   1 to 255) and a value (`u8`). 0 is free, 255 an obstacle, 128 unknown. Cell (0, 0) of tile (0, 0) has its corner at the origin
//! - 3 path: `u32` number of the first keyframe; of each `f32` x, y, z, quaternion x, y, z, w, standard deviation of the position (NaN:
//!   not known), `u32` flags: 0 to 1 status (0 tracking, 1 degraded, 2 lost), 2 a break before it, 3 left out of the map
//! - 4 closures: `u32` number of the first; of each `u32` old keyframe, `u32` new keyframe (2^32 - 1: not known), `u8` state (0 waiting, 1
//!   accepted, 2 refused, 3 withdrawn), `u8` reason (place in the words, 255 none), `u16` 0
//! - 5 scan: `f32` x, y, z, quaternion x, y, z, w of the robot then; of each end point `f32` x, y, z in the robot's frame
//! - 6 robot: `f32` x, y, z, quaternion x, y, z, w; covariance of the position xx, xy, xz, yy, yz, zz in m^2; standard deviation of the
//!   heading; `u32` status as above; `u32` 1 where its map is joined with the rest
//! - 7 lines: text in UTF-8, a line each: a name, a tab, a value
//! - 8 clock: `f32` seconds since the begin, `f32` those of the whole run (0: it is going on), `f32` how many times as fast as it was,
//!   `u32` 1 while paused
//! - 9 cloud: `u32` keyframe, `f32` metres per step, points of it in the robot's frame: `i16` x, y, z in steps
//! - 10 totals: `u32` keyframes, `u32` closures: what is beyond is gone
//! - 11 words: the reasons, UTF-8, a line each
//!
//! A record replaces the one of its kind and place that came before.
//!
//! **From the page**: text messages of [`MOST_ASKED`] bytes at most. `ready` asks for one message, which comes when there is something
//! new. `pause`, `resume`, `seek SECONDS` and `speed TIMES` steer what can be steered. Anything else ends the connection.

use crate::news::{Closure, Placed, Robot, Seen};
use mapwright_geom::Pose3;
use mapwright_record::{Objection, Status, Verdict};

/// Cells along a side of a tile.
pub const TILE_SIDE: usize = 64;
/// Longest message from a page, bytes.
pub const MOST_ASKED: usize = 64;
/// What each message begins with.
pub const HEAD: [u8; 4] = [b'M', b'W', 1, 0];

pub(crate) const FRAME: u32 = 1;
pub(crate) const TILE: u32 = 2;
pub(crate) const PATH: u32 = 3;
pub(crate) const CLOSURES: u32 = 4;
pub(crate) const SCAN: u32 = 5;
pub(crate) const ROBOT: u32 = 6;
pub(crate) const LINES: u32 = 7;
pub(crate) const CLOCK: u32 = 8;
pub(crate) const CLOUD: u32 = 9;
pub(crate) const TOTALS: u32 = 10;
pub(crate) const WORDS: u32 = 11;

const OBJECTIONS: [Objection; 8] = [
    Objection::NoMatch,
    Objection::LittleOverlap,
    Objection::Ambiguous,
    Objection::Unconstrained,
    Objection::Contradiction,
    Objection::Improbable,
    Objection::Alone,
    Objection::Outvoted,
];

/// What a page asks for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Asked {
    Ready,
    Pause,
    Resume,
    Seek(f64),
    Speed(f64),
}

impl Asked {
    /// None for what is no request.
    pub(crate) fn read(text: &str) -> Option<Self> {
        let number = |text: &str| text.parse::<f64>().ok().filter(|number| number.is_finite() && *number >= 0.0);
        match text.split_once(' ') {
            None if text == "ready" => Some(Self::Ready),
            None if text == "pause" => Some(Self::Pause),
            None if text == "resume" => Some(Self::Resume),
            Some(("seek", seconds)) => number(seconds).map(Self::Seek),
            Some(("speed", times)) => number(times).filter(|times| (0.01..=1000.0).contains(times)).map(Self::Speed),
            _ => None,
        }
    }
}

/// Little-endian bytes of what a record holds.
#[derive(Debug, Default)]
pub(crate) struct Bytes(pub(crate) Vec<u8>);

impl Bytes {
    pub(crate) fn u32(mut self, value: u32) -> Self {
        self.0.extend(value.to_le_bytes());
        self
    }

    pub(crate) fn i32(self, value: i32) -> Self {
        self.u32(value as u32)
    }

    pub(crate) fn f32(self, value: f64) -> Self {
        self.u32((value as f32).to_bits())
    }

    fn pose(self, pose: &Pose3) -> Self {
        let (at, turned) = (pose.translation, pose.rotation.coords);
        at.iter().chain(turned.iter()).fold(self, |bytes, &value| bytes.f32(value))
    }
}

pub(crate) fn frame(resolution_m: f64, is_space: bool, abilities: u32) -> Vec<u8> {
    Bytes::default().f32(resolution_m).u32(u32::from(is_space)).u32(abilities).0
}

pub(crate) fn tile((x, y): (i32, i32), cells: &[u8]) -> Vec<u8> {
    let mut bytes = Bytes::default().i32(x).i32(y).0;
    for run in cells.chunk_by(|a, b| a == b) {
        for part in run.chunks(255) {
            bytes.extend([part.len() as u8, part[0]]);
        }
    }
    bytes
}

pub(crate) fn path(first: usize, keyframes: &[Placed]) -> Vec<u8> {
    let all = keyframes.iter().fold(Bytes::default().u32(first as u32), |bytes, keyframe| {
        let is_left_out = matches!(keyframe.seen, Seen::Nothing);
        let flags = status(keyframe.status) | u32::from(keyframe.is_break) << 2 | u32::from(is_left_out) << 3;
        bytes.pose(&keyframe.map_from_robot).f32(keyframe.sigma_m.unwrap_or(f64::NAN)).u32(flags)
    });
    all.0
}

pub(crate) fn closures(first: usize, closures: &[Closure]) -> Vec<u8> {
    let all = closures.iter().fold(Bytes::default().u32(first as u32), |bytes, closure| {
        let state = match closure.verdict {
            Verdict::Waiting(_) => 0,
            Verdict::Accepted => 1,
            Verdict::Refused(_) => 2,
            Verdict::Withdrawn(_) => 3,
        };
        let objection = closure.verdict.objection();
        let reason = objection.and_then(|objection| OBJECTIONS.iter().position(|known| *known == objection));
        bytes.u32(closure.from).u32(closure.to).u32(state | (reason.unwrap_or(255) as u32) << 8)
    });
    all.0
}

pub(crate) fn scan(map_from_robot: &Pose3, points_m: &[[f32; 3]]) -> Vec<u8> {
    points_m.iter().flatten().fold(Bytes::default().pose(map_from_robot), |bytes, &value| bytes.f32(f64::from(value))).0
}

pub(crate) fn robot(robot: &Robot) -> Vec<u8> {
    let m2 = &robot.position_m2;
    let covariance = [m2[(0, 0)], m2[(0, 1)], m2[(0, 2)], m2[(1, 1)], m2[(1, 2)], m2[(2, 2)]];
    let bytes = Bytes::default().pose(&robot.map_from_robot);
    let bytes = covariance.iter().fold(bytes, |bytes, &value| bytes.f32(value)).f32(robot.heading_sigma_rad);
    bytes.u32(status(robot.status)).u32(u32::from(robot.is_joined)).0
}

pub(crate) fn lines(lines: &[(String, String)]) -> Vec<u8> {
    let plain = |text: &str| text.replace(['\t', '\n', '\r'], " ");
    lines.iter().map(|(name, value)| format!("{}\t{}\n", plain(name), plain(value))).collect::<String>().into_bytes()
}

pub(crate) fn clock(at_s: f64, end_s: f64, speed: f64, is_paused: bool) -> Vec<u8> {
    Bytes::default().f32(at_s).f32(end_s).f32(speed).u32(u32::from(is_paused)).0
}

pub(crate) fn cloud(keyframe: usize, step_m: f64, points: &[[i16; 3]]) -> Vec<u8> {
    let mut bytes = Bytes::default().u32(keyframe as u32).f32(step_m).0;
    bytes.extend(points.iter().flatten().flat_map(|value| value.to_le_bytes()));
    bytes
}

pub(crate) fn totals(keyframes: usize, closures: usize) -> Vec<u8> {
    Bytes::default().u32(keyframes as u32).u32(closures as u32).0
}

pub(crate) fn words() -> Vec<u8> {
    OBJECTIONS.map(Objection::in_words).join("\n").into_bytes()
}

fn status(status: Status) -> u32 {
    match status {
        Status::Tracking => 0,
        Status::Degraded => 1,
        Status::Lost => 2,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_is_a_request_is_taken() {
        let read = Asked::read;
        assert_eq!(
            (read("ready"), read("pause"), read("resume")),
            (Some(Asked::Ready), Some(Asked::Pause), Some(Asked::Resume))
        );
        assert_eq!((read("seek 12.5"), read("speed 4")), (Some(Asked::Seek(12.5)), Some(Asked::Speed(4.0))));
        for text in
            ["", " ", "ready ", "seek", "seek -1", "seek NaN", "seek inf", "speed 0", "speed 1e9", "seek 1 2", "drop"]
        {
            assert_eq!(read(text), None, "{text:?}");
        }
    }

    #[test]
    fn a_tile_is_its_runs() {
        let mut cells = vec![128; TILE_SIDE * TILE_SIDE];
        cells[300] = 0;
        let bytes = tile((-2, 3), &cells);
        assert_eq!(bytes[..8], [254, 255, 255, 255, 3, 0, 0, 0]);
        assert_eq!(bytes[8..16], [255, 128, 45, 128, 1, 0, 255, 128]);
        let told: usize = bytes[8..].chunks(2).map(|run| usize::from(run[0])).sum();
        assert_eq!(told, cells.len());
    }

    #[test]
    fn lines_cannot_be_broken() {
        let line = ("a\tb".to_owned(), "c\nd".to_owned());
        assert_eq!(lines(&[line]), b"a b\tc d\n");
    }
}
