//! Derived and simulated logs in CARMEN's format.

use super::Tag;
use super::models::Geometry;
use super::params::{BEAM_PERIOD, INVERTED, LaserParams, Params, RANGE_MIN, SONAR_RANGE_MAX};
use super::sonar::{MAX_SONARS, REACH_M};
use crate::error::FormatError;
use crate::number::write_stamp;
use mapwright_geom::{FARTHEST_M, Pose2, Stamp};
use mapwright_sensor::{LaserModel, LaserScan, Odometry, SonarReading};
use std::io::Write;
use std::sync::Arc;

/// Writes scans and odometry so that [`CarmenReader`](crate::CarmenReader) reads the same values back: ranges, poses,
/// stamps and laser geometry are exact, the mount of a laser included. Only its name becomes the tag.
///
/// A laser that looks like CARMEN's `FLASER` (or `RLASER`, by its name) is written as such, preceded by the `PARAM`
/// lines that say where it sits; any other as `ROBOTLASER1` (or as its name says). Smallest range, time between beams
/// and upside-down mount stand in `PARAM` lines that other programs pass over.
#[derive(Debug)]
pub struct CarmenWriter<W> {
    writer: W,
    line: Vec<u8>,
    params: Params,
    laser: Option<Arc<LaserModel>>,
    tag: Tag,
}

impl<W: Write> CarmenWriter<W> {
    /// Writes to `writer`, one call a line: hand in a buffered one.
    pub fn new(writer: W) -> Self {
        Self { writer, line: Vec::new(), params: Params::default(), laser: None, tag: Tag::FrontLaser }
    }

    /// Writes a line of comment; line feeds in `text` become spaces.
    ///
    /// # Errors
    ///
    /// [`FormatError::Io`].
    pub fn comment(&mut self, text: &str) -> Result<(), FormatError> {
        self.line.extend_from_slice(b"# ");
        self.line.extend(text.bytes().map(|b| if b == b'\n' || b == b'\r' { b' ' } else { b }));
        self.flush_line()
    }

    /// Writes a reading of the wheels.
    ///
    /// # Errors
    ///
    /// [`FormatError::OutOfRange`] for a pose the reader would refuse; [`FormatError::Io`].
    pub fn odometry(&mut self, odometry: &Odometry) -> Result<(), FormatError> {
        check_pose(odometry.odom_from_robot)?;
        self.line.extend_from_slice(b"ODOM");
        push_pose(&mut self.line, odometry.odom_from_robot);
        self.line.extend_from_slice(b" 0 0 0");
        self.finish_event(odometry.stamp)
    }

    /// Writes a sweep; one without odometry gets NaN poses.
    ///
    /// # Errors
    ///
    /// [`FormatError::OutOfRange`] for a pose or a laser's number that the reader would refuse,
    /// [`FormatError::LaserNotRepresentable`] for a sweep without beams; [`FormatError::Io`].
    pub fn scan(&mut self, scan: &LaserScan) -> Result<(), FormatError> {
        if scan.ranges_m.is_empty() {
            let laser = scan.laser.name.clone();
            return Err(FormatError::LaserNotRepresentable { laser, reason: "a scan needs at least one beam" });
        }
        if let Some(odom_from_robot) = scan.odom_from_robot {
            check_pose(odom_from_robot)?;
        }
        self.introduce(scan)?;
        match self.tag {
            Tag::RobotLaser(_) => self.robot_laser(scan),
            _ => self.conventional_laser(scan),
        }
        self.finish_event(scan.stamp)
    }

    /// Writes readings of a ring of sonars, after a reading of the wheels where they bring one. NaN stands for a sonar that was not fired.
    ///
    /// # Errors
    ///
    /// [`FormatError::OutOfRange`] for a pose that the reader would refuse; [`FormatError::LaserNotRepresentable`] for a ring whose sonars
    /// differ in cone or reach, or that cannot be mapped with; [`FormatError::Io`].
    pub fn sonar(&mut self, reading: &SonarReading) -> Result<(), FormatError> {
        let ring = &reading.ring;
        let refused = |reason| FormatError::LaserNotRepresentable { laser: ring.name.clone(), reason };
        let Some(first) = ring.sonars.first() else { return Err(refused("a ring needs at least one sonar")) };
        let alike = |sonar: &mapwright_sensor::Sonar| {
            (sonar.opening_rad, sonar.range_max_m) == (first.opening_rad, first.range_max_m)
        };
        if ring.sonars.len() > MAX_SONARS
            || ring.sonars.len() != reading.ranges_m.len()
            || !ring.sonars.iter().all(alike)
        {
            return Err(refused("its sonars must be at most 1024, with one reading, cone and reach each"));
        }
        if ring.check().is_err() || first.range_max_m < REACH_M[0] {
            return Err(refused("its sonars must open by up to pi and hear from 0.1 to 50 m"));
        }
        if let Some(odom_from_robot) = reading.odom_from_robot {
            self.odometry(&Odometry { stamp: reading.stamp, odom_from_robot })?;
        }
        if self.params.sonar.range_max_m != Some(first.range_max_m) {
            self.params.sonar.range_max_m = Some(first.range_max_m);
            self.param(SONAR_RANGE_MAX, first.range_max_m)?;
        }
        self.line.extend_from_slice(Tag::Sonar.name().as_bytes());
        // With a point, so that it cannot be taken for a count.
        let _ = write!(self.line, " {:?}", first.opening_rad);
        push_ranges(&mut self.line, &reading.ranges_m);
        ring.sonars.iter().for_each(|sonar| push_pose(&mut self.line, sonar.robot_from_sonar));
        self.finish_event(reading.stamp)
    }

    /// Flushes and hands the stream back.
    ///
    /// # Errors
    ///
    /// [`FormatError::Io`].
    pub fn finish(mut self) -> Result<W, FormatError> {
        self.writer.flush()?;
        Ok(self.writer)
    }

    fn conventional_laser(&mut self, scan: &LaserScan) {
        self.line.extend_from_slice(self.tag.name().as_bytes());
        push_ranges(&mut self.line, &scan.ranges_m);
        push_optional_pose(
            &mut self.line,
            scan.odom_from_robot.map(|odom_from_robot| odom_from_robot * scan.laser.robot_from_laser),
        );
        push_optional_pose(&mut self.line, scan.odom_from_robot);
    }

    fn robot_laser(&mut self, scan: &LaserScan) {
        let laser = &scan.laser;
        let field_of_view_rad = laser.angle_step_rad * (scan.ranges_m.len() - 1) as f64;
        self.line.extend_from_slice(self.tag.name().as_bytes());
        self.line.extend_from_slice(b" 0");
        for value in [laser.angle_min_rad, field_of_view_rad, laser.angle_step_rad, laser.range_max_m] {
            push_number(&mut self.line, value);
        }
        self.line.extend_from_slice(b" 0 0");
        push_ranges(&mut self.line, &scan.ranges_m);
        self.line.extend_from_slice(b" 0");
        push_optional_pose(
            &mut self.line,
            scan.odom_from_robot.map(|odom_from_robot| odom_from_robot * laser.robot_from_laser),
        );
        push_optional_pose(&mut self.line, scan.odom_from_robot);
        self.line.extend_from_slice(b" 0 0 0 0 0");
    }

    /// Writes the `PARAM` lines that the reader needs to know the scan's laser.
    fn introduce(&mut self, scan: &LaserScan) -> Result<(), FormatError> {
        let laser = &scan.laser;
        check_laser(laser)?;
        self.tag = tag_of(laser, scan.ranges_m.len());
        if self.laser.as_ref().is_some_and(|before| Arc::ptr_eq(before, laser)) {
            return Ok(());
        }
        self.laser = Some(Arc::clone(laser));
        self.introduce_own(laser)?;
        let rear = matches!(self.tag, Tag::RearLaser | Tag::RobotLaser(2));
        let said = if rear { self.params.rear } else { self.params.front };
        let wanted = LaserParams {
            robot_from_laser: laser.robot_from_laser,
            mount_given: true,
            range_max_m: Some(laser.range_max_m),
        };
        self.introduce_mount(if rear { "rear" } else { "front" }, said, wanted)?;
        *(if rear { &mut self.params.rear } else { &mut self.params.front }) = wanted;
        Ok(())
    }

    fn introduce_mount(&mut self, side: &str, said: LaserParams, wanted: LaserParams) -> Result<(), FormatError> {
        if said == wanted {
            return Ok(());
        }
        let pose = wanted.robot_from_laser;
        self.param(&format!("robot_{side}laser_offset"), pose.x)?;
        self.param(&format!("robot_{side}laser_side_offset"), pose.y)?;
        self.param(&format!("robot_{side}laser_angular_offset"), pose.theta)?;
        wanted.range_max_m.map_or(Ok(()), |max| self.param(&format!("robot_{side}_laser_max"), max))
    }

    /// The parameters that only this crate knows, where they change.
    fn introduce_own(&mut self, laser: &LaserModel) -> Result<(), FormatError> {
        if self.params.range_min_m != laser.range_min_m {
            self.params.range_min_m = laser.range_min_m;
            self.param(RANGE_MIN, laser.range_min_m)?;
        }
        if self.params.beam_period_s != laser.beam_period_s {
            self.params.beam_period_s = laser.beam_period_s;
            self.param(BEAM_PERIOD, laser.beam_period_s)?;
        }
        if self.params.inverted != laser.inverted {
            self.params.inverted = laser.inverted;
            self.param(INVERTED, f64::from(u8::from(laser.inverted)))?;
        }
        Ok(())
    }

    fn param(&mut self, name: &str, value: f64) -> Result<(), FormatError> {
        self.line.extend_from_slice(b"PARAM ");
        self.line.extend_from_slice(name.as_bytes());
        push_number(&mut self.line, value);
        self.line.extend_from_slice(b" nohost 0");
        self.flush_line()
    }

    fn finish_event(&mut self, stamp: Stamp) -> Result<(), FormatError> {
        self.line.push(b' ');
        write_stamp(&mut self.line, stamp);
        self.line.extend_from_slice(b" nohost ");
        write_stamp(&mut self.line, stamp);
        self.flush_line()
    }

    fn flush_line(&mut self) -> Result<(), FormatError> {
        self.line.push(b'\n');
        let written = self.writer.write_all(&self.line);
        self.line.clear();
        Ok(written?)
    }
}

/// The line a laser is written as: by convention where its beams lie that way, and otherwise with its own geometry.
fn tag_of(laser: &LaserModel, beams: usize) -> Tag {
    let named =
        Tag::of(laser.name.as_bytes()).filter(|&tag| !matches!(tag, Tag::Odometry | Tag::RawLaser(_) | Tag::Sonar));
    let conventional = Geometry::conventional(beams, &Params::default().front);
    let by_convention =
        (laser.angle_min_rad, laser.angle_step_rad) == (conventional.angle_min_rad, conventional.angle_step_rad);
    match named {
        Some(tag @ Tag::RobotLaser(_)) => tag,
        Some(Tag::RearLaser) if !by_convention => Tag::RobotLaser(2),
        Some(tag) if by_convention => tag,
        None if by_convention => Tag::FrontLaser,
        _ => Tag::RobotLaser(1),
    }
}

fn check_pose(pose: Pose2) -> Result<(), FormatError> {
    check("a pose's x", pose.x, FARTHEST_M)?;
    check("a pose's y", pose.y, FARTHEST_M)?;
    check("a pose's heading", pose.theta, FARTHEST_M)
}

fn check_laser(laser: &LaserModel) -> Result<(), FormatError> {
    check("the laser's x on the robot", laser.robot_from_laser.x, 100.0)?;
    check("the laser's y on the robot", laser.robot_from_laser.y, 100.0)?;
    check("the laser's heading on the robot", laser.robot_from_laser.theta, 100.0)?;
    check("the laser's first bearing", laser.angle_min_rad, 100.0)?;
    check("the laser's step", laser.angle_step_rad, 100.0)?;
    check("the laser's smallest range", laser.range_min_m, 1e4)?;
    check("the laser's largest range", laser.range_max_m, 1e6)?;
    check("the laser's time between beams", laser.beam_period_s, 10.0)?;
    let no_reach = laser.range_max_m < 1e-3 || laser.range_min_m < 0.0 || laser.beam_period_s < 0.0;
    let reason = "ranges and times must not be negative, nor the largest range below a millimetre";
    if no_reach { Err(FormatError::LaserNotRepresentable { laser: laser.name.clone(), reason }) } else { Ok(()) }
}

fn check(what: &'static str, value: f64, limit: f64) -> Result<(), FormatError> {
    if value.abs() <= limit { Ok(()) } else { Err(FormatError::OutOfRange { what, value, limit }) }
}

/// Appends a space and the shortest decimal that reads back as `value`.
fn push_number(line: &mut Vec<u8>, value: impl std::fmt::Display) {
    // A vector takes everything.
    let _ = write!(line, " {value}");
}

fn push_pose(line: &mut Vec<u8>, pose: Pose2) {
    for value in [pose.x, pose.y, pose.theta] {
        push_number(line, value);
    }
}

fn push_optional_pose(line: &mut Vec<u8>, pose: Option<Pose2>) {
    match pose {
        Some(pose) => push_pose(line, pose),
        None => line.extend_from_slice(b" nan nan nan"),
    }
}

/// Appends the number of ranges and the ranges, two decimals where that is exact.
fn push_ranges(line: &mut Vec<u8>, ranges_m: &[f32]) {
    push_number(line, ranges_m.len());
    for &range_m in ranges_m {
        let hundredths = (range_m * 100.0).round();
        if range_m.is_sign_positive() && hundredths < 1e4 && hundredths / 100.0 == range_m {
            let _ = write!(line, " {}.{:02}", hundredths as u32 / 100, hundredths as u32 % 100);
        } else {
            push_number(line, range_m);
        }
    }
}
