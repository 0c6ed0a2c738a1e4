//! What `PARAM` lines say about the lasers.

use super::fields::{BadLine, Cursor};
use super::sonar::{REACH_M, SonarParams};
use crate::report::DropReason;
use mapwright_geom::Pose2;
use std::f64::consts::PI;

/// Mount and reach of one laser.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LaserParams {
    pub(super) robot_from_laser: Pose2,
    /// Whether a parameter gave (part of) the mount.
    pub(super) mount_given: bool,
    pub(super) range_max_m: Option<f64>,
}

/// The parameters that matter, as of the line reached.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Params {
    pub(super) front: LaserParams,
    pub(super) rear: LaserParams,
    pub(super) range_min_m: f64,
    pub(super) beam_period_s: f64,
    pub(super) inverted: bool,
    pub(super) sonar: SonarParams,
}

impl Default for Params {
    /// Both lasers at the robot's origin, the rear one looking backwards. Nothing is nearer than a reading's own step of
    /// a centimetre, so that zero, which some drivers write for no return, is none.
    fn default() -> Self {
        let front = LaserParams { robot_from_laser: Pose2::IDENTITY, mount_given: false, range_max_m: None };
        let rear = LaserParams { robot_from_laser: Pose2::new(0.0, 0.0, PI), ..front };
        Self { front, rear, range_min_m: 0.01, beam_period_s: 0.0, inverted: false, sonar: SonarParams::default() }
    }
}

/// Names written by this crate for what CARMEN has no name for.
pub(super) const RANGE_MIN: &str = "mapwright_laser_range_min";
/// See [`RANGE_MIN`].
pub(super) const BEAM_PERIOD: &str = "mapwright_laser_beam_period";
/// See [`RANGE_MIN`].
pub(super) const INVERTED: &str = "mapwright_laser_inverted";
/// See [`RANGE_MIN`].
pub(super) const SONAR_RANGE_MAX: &str = "mapwright_sonar_range_max";
/// See [`RANGE_MIN`].
pub(super) const SONAR_OPENING: &str = "mapwright_sonar_opening";

impl Params {
    /// Takes over the parameter in the rest of a `PARAM` line. Unknown ones are fine.
    ///
    /// Offsets are in metres, angular offsets in radians and counted from the robot's forward direction, for the rear
    /// laser too. `laser_*_flipped` is left alone on purpose: CARMEN's driver has put the readings of a flipped
    /// laser in order before they were logged.
    pub(super) fn take<'a>(&mut self, mut line: Cursor<'a>) -> Result<(), BadLine<'a>> {
        let name = line.word();
        match name.strip_prefix(b"robot_").or_else(|| name.strip_prefix(b"laser_")).unwrap_or(name) {
            b"frontlaser_offset" => self.front.mount(|p| &mut p.x, line),
            b"frontlaser_side_offset" => self.front.mount(|p| &mut p.y, line),
            b"frontlaser_angular_offset" => self.front.mount(|p| &mut p.theta, line),
            b"rearlaser_offset" => self.rear.mount(|p| &mut p.x, line),
            b"rearlaser_side_offset" => self.rear.mount(|p| &mut p.y, line),
            b"rearlaser_angular_offset" => self.rear.mount(|p| &mut p.theta, line),
            b"front_laser_max" => self.front.reach(line),
            b"rear_laser_max" => self.rear.reach(line),
            _ => self.take_own(name, line),
        }
    }

    fn take_own<'a>(&mut self, name: &[u8], line: Cursor<'a>) -> Result<(), BadLine<'a>> {
        if name == RANGE_MIN.as_bytes() {
            self.range_min_m = bounded(line, 0.0, 1e4)?;
        } else if name == BEAM_PERIOD.as_bytes() {
            self.beam_period_s = bounded(line, 0.0, 10.0)?;
        } else if name == INVERTED.as_bytes() {
            self.inverted = bounded(line, 0.0, 1.0)? != 0.0;
        } else if name == SONAR_RANGE_MAX.as_bytes() {
            self.sonar.range_max_m = Some(bounded(line, REACH_M[0], REACH_M[1])?);
        } else if name == SONAR_OPENING.as_bytes() {
            self.sonar.opening_rad = Some(bounded(line, 1e-3, PI)?);
        }
        Ok(())
    }
}

impl LaserParams {
    fn mount<'a>(&mut self, part: fn(&mut Pose2) -> &mut f64, line: Cursor<'a>) -> Result<(), BadLine<'a>> {
        let mut pose = self.robot_from_laser;
        *part(&mut pose) = bounded(line, -100.0, 100.0)?;
        self.robot_from_laser = Pose2::new(pose.x, pose.y, pose.theta);
        self.mount_given = true;
        Ok(())
    }

    fn reach<'a>(&mut self, line: Cursor<'a>) -> Result<(), BadLine<'a>> {
        self.range_max_m = Some(bounded(line, 1e-3, 1e6)?);
        Ok(())
    }
}

/// A parameter's value within its bounds.
fn bounded(mut line: Cursor<'_>, least: f64, most: f64) -> Result<f64, BadLine<'_>> {
    let word = line.clone().word();
    let value = line.number("a parameter's value")?;
    if (least..=most).contains(&value) {
        Ok(value)
    } else {
        Err(BadLine::new(DropReason::BadNumber, format!("a value from {least} to {most}"), word))
    }
}
