//! CARMEN logs, the text format of the classic benchmarks: one message a line, tag first.
//!
//! | line | fields |
//! |---|---|
//! | `ODOM` | x y theta tv rv accel ipc_timestamp host logger_timestamp |
//! | `FLASER`, `RLASER` | n ranges x y theta odom_x odom_y odom_theta ipc_timestamp host logger_timestamp |
//! | `ROBOTLASER1` to `5` | type start_angle fov step max_range accuracy remission_mode n ranges m remissions, laser pose, robot pose, tv rv forward_safety_dist side_safety_dist turn_axis ipc_timestamp host logger_timestamp |
//! | `RAWLASER1` to `5` | as `ROBOTLASER` up to the remissions, then ipc_timestamp host logger_timestamp |
//! | `SONAR` | cone_angle n ranges n times x y theta ipc_timestamp host logger_timestamp; older ones n ranges n and n times x y theta |
//! | `PARAM` | name value ... |
//!
//! A `RAWLASER` is what a driver hands out, before the robot's pose is put to it. Where lines with poses follow within the
//! first 64 of them, these are the same scans and the raw ones are passed over.
//!
//! Older logs lack trailing fields; the layout is told by the number of fields and by where the host's name stands.

mod fields;
mod models;
mod params;
mod reader;
mod sonar;
mod writer;

pub use reader::{CarmenReader, LogEvent};
pub use writer::CarmenWriter;

/// The kinds of lines that become events; each is a topic of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Tag {
    Odometry,
    FrontLaser,
    RearLaser,
    /// `ROBOTLASER1` to `ROBOTLASER5`.
    RobotLaser(u8),
    /// `RAWLASER1` to `RAWLASER5`: without the robot's pose.
    RawLaser(u8),
    /// A ring of sonars.
    Sonar,
}

impl Tag {
    /// Number of tags.
    const COUNT: usize = 14;

    fn of(word: &[u8]) -> Option<Self> {
        match word {
            b"ODOM" => Some(Self::Odometry),
            b"FLASER" => Some(Self::FrontLaser),
            b"RLASER" => Some(Self::RearLaser),
            b"SONAR" => Some(Self::Sonar),
            [rest @ .., number @ b'1'..=b'5'] if rest == b"ROBOTLASER" => Some(Self::RobotLaser(number - b'0')),
            [rest @ .., number @ b'1'..=b'5'] if rest == b"RAWLASER" => Some(Self::RawLaser(number - b'0')),
            _ => None,
        }
    }

    /// Distinct and below [`Tag::COUNT`].
    fn index(self) -> usize {
        match self {
            Self::Odometry => 0,
            Self::FrontLaser => 1,
            Self::RearLaser => 2,
            Self::RobotLaser(number) => 2 + usize::from(number.clamp(1, 5)),
            Self::RawLaser(number) => 7 + usize::from(number.clamp(1, 5)),
            Self::Sonar => 13,
        }
    }

    fn name(self) -> &'static str {
        #[rustfmt::skip]
        const NAMES: [&str; Tag::COUNT] = [
            "ODOM", "FLASER", "RLASER",
            "ROBOTLASER1", "ROBOTLASER2", "ROBOTLASER3", "ROBOTLASER4", "ROBOTLASER5",
            "RAWLASER1", "RAWLASER2", "RAWLASER3", "RAWLASER4", "RAWLASER5",
            "SONAR",
        ];
        NAMES[self.index()]
    }
}
