//! Events out of a CARMEN log.

use super::Tag;
use super::fields::{BadLine, Cursor, PoseField, Tail};
use super::models::{Geometry, ModelCache, SAME_MOUNT, same_mount};
use super::params::{LaserParams, Params};
use super::sonar;
use crate::error::FormatError;
use crate::excerpt::Excerpt;
use crate::lines::{Line, LineReader, MAX_LINE_BYTES};
use crate::report::{DropReason, DroppedLine, ReadReport, TopicReport};
use mapwright_geom::{Pose2, Stamp};
use mapwright_sensor::{
    Bearings, FarOrigin, LaserScan, OddHead, Odometry, RANGE_MAX_UNSAID_M, SaidBearings, SonarReading, SonarRing,
    TurnRate,
};
use std::collections::VecDeque;
use std::io::Read;
use std::sync::Arc;

/// One event, lent until the next is asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum LogEvent<'a> {
    /// A laser's sweep.
    Scan(&'a LaserScan),
    /// A reading of the wheels.
    Odometry(&'a Odometry),
    /// A reading of a gyroscope; CARMEN logs have none.
    TurnRate(&'a TurnRate),
    /// Readings of a ring of sonars.
    Sonar(&'a SonarReading),
}

/// Reads a CARMEN log line by line, with bounded memory and no allocation per line.
///
/// Events come in the order of the file; a line that cannot be used is dropped, counted and described in the
/// [`report`](CarmenReader::report), and reading goes on.
///
/// ```
/// use mapwright_formats::{CarmenReader, LogEvent};
/// let log = "ODOM 1 0 0 0 0 0 12.5 host 0.1\nFLASER 3 1.00 2.00 81.83 1 0 0 1 0 0 12.75 host 0.2\n";
/// let mut reader = CarmenReader::new(log.as_bytes());
/// while let Some(event) = reader.next_event()? {
///     if let LogEvent::Scan(scan) = event {
///         assert_eq!(scan.ranges_m, [1.0, 2.0, 81.83]);
///         assert_eq!(scan.stamp.0, 12_750_000_000);
///     }
/// }
/// assert!(reader.report().has_scans() && !reader.report().has_losses());
/// # Ok::<(), mapwright_formats::FormatError>(())
/// ```
#[derive(Debug)]
pub struct CarmenReader<R> {
    lines: LineReader<R>,
    /// Lines read ahead, to see whether `RAWLASER` lines are scans of their own.
    ahead: VecDeque<KeptLine>,
    parser: Parser,
}

/// So many `RAWLASER` lines at most are read ahead until one with a pose comes: CARMEN's programs write one with each.
const RAW_AHEAD: usize = 64;

/// No laser sits farther from the origin of a robot that drives indoors, metres.
const MOUNT_MOST_M: f64 = 1.0;

/// So many bytes of lines are kept meanwhile: as many as one line may have.
const BYTES_AHEAD: usize = MAX_LINE_BYTES;

/// A [`Line`] with its bytes.
#[derive(Debug)]
struct KeptLine {
    number: u64,
    bytes: Vec<u8>,
    terminated: bool,
    skipped_bytes: Option<u64>,
}

impl KeptLine {
    fn of(line: Line<'_>) -> Self {
        let Line { number, bytes, terminated, skipped_bytes } = line;
        Self { number, bytes: bytes.to_vec(), terminated, skipped_bytes }
    }

    fn line(&self) -> Line<'_> {
        Line { number: self.number, bytes: &self.bytes, terminated: self.terminated, skipped_bytes: self.skipped_bytes }
    }
}

impl<R: Read> CarmenReader<R> {
    /// Reads the log from `reader`, which needs no buffering; compressed logs go through
    /// [`open_log`](crate::open_log) first.
    pub fn new(reader: R) -> Self {
        Self { lines: LineReader::new(reader), ahead: VecDeque::new(), parser: Parser::new() }
    }

    /// The next scan or odometry reading in the order of the file, or none at its end.
    ///
    /// # Errors
    ///
    /// [`FormatError::Io`] where the stream below fails; nothing else.
    pub fn next_event(&mut self) -> Result<Option<LogEvent<'_>>, FormatError> {
        let kind = loop {
            if let Some(kept) = self.ahead.pop_front() {
                if let Some(kind) = self.parser.take_line(kept.line()) {
                    break kind;
                }
                continue;
            }
            let Some(line) = self.lines.next_line()? else {
                self.note_end();
                return Ok(None);
            };
            if self.parser.is_undecided(line) {
                self.ahead.push_back(KeptLine::of(line));
                self.look_ahead()?;
            } else if let Some(kind) = self.parser.take_line(line) {
                break kind;
            }
        };
        Ok(Some(match kind {
            EventKind::Scan => LogEvent::Scan(&self.parser.scan),
            EventKind::Odometry => LogEvent::Odometry(&self.parser.odometry),
            EventKind::Sonar => LogEvent::Sonar(&self.parser.sonar),
        }))
    }

    /// Number of the line that was read last, from 1: that of the last event.
    #[must_use]
    pub fn line(&self) -> u64 {
        self.parser.report.lines
    }

    /// What has been read and lost so far; complete once [`next_event`](Self::next_event) has returned none.
    #[must_use]
    pub fn report(&self) -> &ReadReport {
        &self.parser.report
    }

    /// The report, when reading is over.
    #[must_use]
    pub fn into_report(self) -> ReadReport {
        self.parser.report
    }

    /// Reads on until it is known whether `RAWLASER` lines are scans of their own.
    fn look_ahead(&mut self) -> Result<(), FormatError> {
        let (mut raw, mut bytes) = (1, 0);
        self.parser.raw_lasers = RawLasers::Used;
        while raw < RAW_AHEAD && bytes < BYTES_AHEAD {
            let Some(line) = self.lines.next_line()? else { return Ok(()) };
            let tag = Tag::of(Cursor::new(line.bytes).word());
            bytes += line.bytes.len() + size_of::<KeptLine>();
            self.ahead.push_back(KeptLine::of(line));
            match tag {
                Some(Tag::RawLaser(_)) => raw += 1,
                Some(Tag::FrontLaser | Tag::RearLaser | Tag::RobotLaser(_)) => {
                    self.parser.raw_lasers = RawLasers::Unused;
                    return Ok(());
                }
                Some(Tag::Odometry | Tag::Sonar) | None => {}
            }
        }
        Ok(())
    }

    fn note_end(&mut self) {
        let report = &mut self.parser.report;
        report.lines = self.lines.lines();
        report.bytes = self.lines.bytes();
        report.tear = self.lines.take_tear().or(report.tear.take());
    }
}

/// A rear laser sits no farther from the robot's centre, metres, and looks back within 30 degrees.
const REAR_AT_MOST_M: f64 = 2.0;
const REAR_COSINE: f64 = -0.866;

/// Which buffer holds the event.
#[derive(Debug, Clone, Copy)]
enum EventKind {
    Scan,
    Odometry,
    Sonar,
}

/// What a line leads to.
enum Outcome {
    Event(EventKind),
    Nothing,
}

/// Everything but the stream.
#[derive(Debug)]
struct Parser {
    scan: LaserScan,
    odometry: Odometry,
    sonar: SonarReading,
    params: Params,
    models: ModelCache,
    topics: [Option<Topic>; Tag::COUNT],
    /// By tag, the most numbers seen before a stamp.
    fullest_layout: [usize; Tag::COUNT],
    last_stamp: Stamp,
    raw_lasers: RawLasers,
    /// Whether the first `FLASER` line was asked where the laser sits.
    is_mount_settled: bool,
    origin: FarOrigin,
    report: ReadReport,
}

/// Whether `RAWLASER` lines are scans: not where others say the same scans with the robot's pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum RawLasers {
    Undecided,
    Used,
    Unused,
}

/// What has to be remembered of a topic.
#[derive(Debug, Clone, Copy)]
struct Topic {
    report_index: usize,
    beams: Option<usize>,
}

impl Parser {
    fn new() -> Self {
        let (params, mut models) = (Params::default(), ModelCache::default());
        let laser = Arc::clone(models.model(Tag::FrontLaser, Geometry::conventional(1, &params.front), &params));
        let scan = LaserScan { stamp: Stamp(0), laser, ranges_m: Vec::new(), odom_from_robot: None };
        let odometry = Odometry { stamp: Stamp(0), odom_from_robot: Pose2::IDENTITY };
        let ring = Arc::new(SonarRing { name: String::new(), sonars: Vec::new() });
        let sonar = SonarReading { stamp: Stamp(0), ring, ranges_m: Vec::new(), odom_from_robot: None };
        let report = ReadReport::default();
        let (topics, fullest_layout) = ([None; Tag::COUNT], [0; Tag::COUNT]);
        Self {
            scan,
            odometry,
            sonar,
            params,
            models,
            topics,
            fullest_layout,
            last_stamp: Stamp(0),
            raw_lasers: RawLasers::Undecided,
            is_mount_settled: false,
            origin: FarOrigin::at_two_readings(),
            report,
        }
    }

    /// Whether the line is the first scan, and one without a pose.
    fn is_undecided(&self, line: Line<'_>) -> bool {
        self.raw_lasers == RawLasers::Undecided
            && matches!(Tag::of(Cursor::new(line.bytes).word()), Some(Tag::RawLaser(_)))
    }

    /// Reads one line; the event, if it is one, then lies in `scan` or `odometry`.
    fn take_line(&mut self, line: Line<'_>) -> Option<EventKind> {
        self.report.lines = line.number;
        match self.read_line(line) {
            Ok(Outcome::Event(kind)) => Some(kind),
            Ok(Outcome::Nothing) => None,
            Err(bad) => {
                self.drop_line(line, &bad);
                None
            }
        }
    }

    fn read_line<'a>(&mut self, line: Line<'a>) -> Result<Outcome, BadLine<'a>> {
        if line.skipped_bytes.is_some() {
            return Err(BadLine::new(DropReason::LineTooLong, "a line of at most 16 MiB", line.bytes));
        }
        let mut cursor = Cursor::new(line.bytes);
        let word = cursor.word();
        match Tag::of(word) {
            Some(Tag::Odometry) => self.read_odometry(cursor, line),
            Some(Tag::Sonar) => self.read_sonar(cursor, line),
            Some(tag @ Tag::RobotLaser(_)) => self.read_robot_laser(tag, cursor, line),
            Some(Tag::RawLaser(_)) if self.raw_lasers == RawLasers::Unused => self.read_other(word, cursor),
            Some(Tag::RawLaser(number)) => self.read_raw_laser(number, cursor, line),
            Some(tag) => self.read_laser(tag, cursor, line),
            None => self.read_other(word, cursor),
        }
    }

    fn read_other<'a>(&mut self, tag: &'a [u8], cursor: Cursor<'a>) -> Result<Outcome, BadLine<'a>> {
        if tag.is_empty() || tag[0] == b'#' {
            return Ok(Outcome::Nothing);
        }
        let is_word = tag.len() <= 64 && tag.iter().all(|b| b.is_ascii_alphanumeric() || b"_-.:/".contains(b));
        let Some(name) = std::str::from_utf8(tag).ok().filter(|_| is_word) else {
            return Err(BadLine::new(DropReason::NotText, "a tag such as ODOM or FLASER", tag));
        };
        self.report.count_tag(name);
        if tag == b"PARAM" {
            self.params.take(cursor)?;
        }
        Ok(Outcome::Nothing)
    }

    /// `ODOM x y theta tv rv accel`; old logs lack the acceleration or the speeds.
    fn read_odometry<'a>(&mut self, cursor: Cursor<'a>, line: Line<'a>) -> Result<Outcome, BadLine<'a>> {
        let tail = Tail::read(cursor, &[6, 5, 3], line.terminated)?;
        tail.not_shorter_than(&mut self.fullest_layout[Tag::Odometry.index()])?;
        let PoseField::Usable(odom_from_robot) = self.placed(tail.pose(0)?) else {
            return Err(refused_pose(tail.word(0)));
        };
        let stamp = self.stamp(line.number, tail.stamp);
        self.odometry = Odometry { stamp, odom_from_robot };
        self.report.odometry += 1;
        self.note_event(Tag::Odometry, line.number, stamp, Some(odom_from_robot));
        Ok(Outcome::Event(EventKind::Odometry))
    }

    /// `SONAR cone_angle n ranges offsets`; odometry's readings around it say where the robot was.
    fn read_sonar<'a>(&mut self, cursor: Cursor<'a>, line: Line<'a>) -> Result<Outcome, BadLine<'a>> {
        let (stamp, odd) = sonar::read(cursor, line.terminated, self.params.sonar, &mut self.sonar)?;
        self.sonar.stamp = self.stamp(line.number, stamp);
        odd.into_iter().for_each(|odd| self.report.odd_heads.note(line.number, odd));
        self.report.sonar_readings += 1;
        self.note_event(Tag::Sonar, line.number, self.sonar.stamp, None);
        Ok(Outcome::Event(EventKind::Sonar))
    }

    /// `FLASER n ranges x y theta odom_x odom_y odom_theta`; old logs lack the last three.
    fn read_laser<'a>(&mut self, tag: Tag, mut cursor: Cursor<'a>, line: Line<'a>) -> Result<Outcome, BadLine<'a>> {
        let non_finite = cursor.ranges(&mut self.scan.ranges_m)?;
        let tail = Tail::read(cursor, &[6, 3], line.terminated)?;
        tail.not_shorter_than(&mut self.fullest_layout[tag.index()])?;
        let pose = tail.pose(tail.numbers() - 3)?;
        if tag == Tag::FrontLaser && tail.numbers() == 6 && !self.is_mount_settled {
            self.settle_mount(line.number, pose, tail.pose(0)?);
        }
        let laser = if tag == Tag::RearLaser { self.params.rear } else { self.params.front };
        let mut geometry = Geometry::conventional(self.scan.ranges_m.len(), &laser);
        if tag == Tag::RearLaser && !laser.mount_given && tail.numbers() == 6 {
            let said = mount(pose, tail.pose(0)?, &laser);
            geometry.robot_from_laser = said.filter(looks_back).unwrap_or(laser.robot_from_laser);
        }
        self.scan.odom_from_robot = self.usable_pose(line.number, pose);
        Ok(self.finish_scan(tag, geometry, tail.stamp, non_finite, line.number))
    }

    /// Where no parameter says where the front laser sits, the first line's two poses do: that of the laser straight ahead of the robot's
    /// or behind it. In logs that a mapper has corrected the first pose is the mapper's, and turned against odometry's or the same.
    fn settle_mount(&mut self, line: u64, robot: PoseField, laser: PoseField) {
        self.is_mount_settled = true;
        let front = &mut self.params.front;
        let (PoseField::Usable(world_from_robot), PoseField::Usable(world_from_laser)) = (robot, laser) else { return };
        let said = world_from_robot.between(world_from_laser);
        let is_on_axis = said.y.abs() <= 2.0 * SAME_MOUNT && said.theta.abs() <= SAME_MOUNT;
        if front.mount_given || !is_on_axis || !(2.0 * SAME_MOUNT..=MOUNT_MOST_M).contains(&said.x.abs()) {
            return;
        }
        let ahead_m = (said.x / SAME_MOUNT).round() * SAME_MOUNT;
        front.robot_from_laser = Pose2::new(ahead_m, 0.0, 0.0);
        front.mount_given = true;
        let words = format!(
            "FLASER's two poses say that the laser sits {:.3} m {} the robot's origin: used as its mounting",
            ahead_m.abs(),
            if ahead_m > 0.0 { "ahead of" } else { "behind" }
        );
        self.report.odd_heads.note(line, OddHead { what: "mounting", words });
    }

    /// The newer lines, which say themselves how the beams lie.
    fn read_robot_laser<'a>(
        &mut self,
        tag: Tag,
        mut cursor: Cursor<'a>,
        line: Line<'a>,
    ) -> Result<Outcome, BadLine<'a>> {
        let sweep = Sweep::read(&mut cursor)?;
        let non_finite = cursor.ranges(&mut self.scan.ranges_m)?;
        cursor.skip_remissions()?;
        let tail = Tail::read(cursor, &[11], line.terminated)?;
        let (laser_pose, robot_pose) = (tail.pose(0)?, tail.pose(3)?);
        let laser = if tag == Tag::RobotLaser(2) { self.params.rear } else { self.params.front };
        let robot_from_laser = mount(robot_pose, laser_pose, &laser).ok_or_else(|| refused_pose(tail.word(0)))?;
        let geometry = self.geometry(line.number, &sweep, robot_from_laser);
        self.scan.odom_from_robot = self.usable_pose(line.number, robot_pose);
        Ok(self.finish_scan(tag, geometry, tail.stamp, non_finite, line.number))
    }

    /// `RAWLASER`: as a `ROBOTLASER` without its poses; odometry's readings before it say where the robot was.
    fn read_raw_laser<'a>(
        &mut self,
        number: u8,
        mut cursor: Cursor<'a>,
        line: Line<'a>,
    ) -> Result<Outcome, BadLine<'a>> {
        let sweep = Sweep::read(&mut cursor)?;
        let non_finite = cursor.ranges(&mut self.scan.ranges_m)?;
        cursor.skip_remissions()?;
        let tail = Tail::read(cursor, &[0], line.terminated)?;
        let laser = if number == 2 { self.params.rear } else { self.params.front };
        let geometry = self.geometry(line.number, &sweep, laser.robot_from_laser);
        self.scan.odom_from_robot = None;
        Ok(self.finish_scan(Tag::RawLaser(number), geometry, tail.stamp, non_finite, line.number))
    }

    fn geometry(&mut self, line: u64, sweep: &Sweep, robot_from_laser: Pose2) -> Geometry {
        let beams = self.scan.ranges_m.len();
        let Bearings { first_rad, step_rad, odd } = sweep.bearings(beams);
        for odd in odd.into_iter().chain(sweep.odd_reach()) {
            self.report.odd_heads.note(line, odd);
        }
        sweep.geometry(beams, first_rad, step_rad, robot_from_laser)
    }

    /// A pose relative to the origin, where odometry lies too far out.
    fn placed(&mut self, pose: PoseField) -> PoseField {
        let (PoseField::Usable(said) | PoseField::Far(said)) = pose else { return pose };
        let near = self.origin.near(said);
        self.report.odometry_origin_m = self.origin.at_m();
        near.map_or(PoseField::Refused, PoseField::Usable)
    }

    fn usable_pose(&mut self, line: u64, pose: PoseField) -> Option<Pose2> {
        match self.placed(pose) {
            PoseField::Usable(odom_from_robot) => Some(odom_from_robot),
            PoseField::Absent => None,
            PoseField::Far(_) | PoseField::Refused => {
                self.report.refused_scan_poses.note(line);
                None
            }
        }
    }

    fn finish_scan(
        &mut self,
        tag: Tag,
        geometry: Geometry,
        stamp: Option<Stamp>,
        non_finite: u64,
        line: u64,
    ) -> Outcome {
        self.scan.laser = Arc::clone(self.models.model(tag, geometry, &self.params));
        self.scan.stamp = self.stamp(line, stamp);
        if self.raw_lasers == RawLasers::Undecided {
            self.raw_lasers = RawLasers::Unused;
        }
        self.report.scans += 1;
        self.report.non_finite_ranges += non_finite;
        self.note_event(tag, line, self.scan.stamp, self.scan.odom_from_robot);
        self.note_beams(tag, line, geometry.beams);
        Outcome::Event(EventKind::Scan)
    }

    /// The line's stamp, or the one before where it has none.
    fn stamp(&mut self, line: u64, stamp: Option<Stamp>) -> Stamp {
        match stamp {
            Some(stamp) => self.last_stamp = stamp,
            None => self.report.unstamped.note(line),
        }
        self.last_stamp
    }

    /// Counts an event and looks at its stamp and how far the odometry has come.
    fn note_event(&mut self, tag: Tag, line: u64, stamp: Stamp, odom_from_robot: Option<Pose2>) {
        let topic = self.topics[tag.index()].get_or_insert_with(|| {
            self.report.topics.push(TopicReport { name: tag.name().to_owned(), ..TopicReport::default() });
            Topic { report_index: self.report.topics.len() - 1, beams: None }
        });
        let report = &mut self.report.topics[topic.report_index];
        report.events += 1;
        report.stamps.observe(line, stamp);
        if let Some(odom_from_robot) = odom_from_robot {
            report.odometry.observe(line, Odometry { stamp, odom_from_robot });
        }
    }

    fn note_beams(&mut self, tag: Tag, line: u64, beams: usize) {
        if let Some(topic) = &mut self.topics[tag.index()] {
            if topic.beams.is_some_and(|before| before != beams) {
                self.report.topics[topic.report_index].beam_count_changes.note(line);
            }
            topic.beams = Some(beams);
        }
    }

    fn drop_line(&mut self, line: Line<'_>, bad: &BadLine<'_>) {
        let cut = !line.terminated && line.skipped_bytes.is_none();
        self.report.truncated_last_line |= cut;
        let reason = if cut { DropReason::TruncatedLastLine } else { bad.reason };
        self.report.drop_line(reason, || DroppedLine {
            line: line.number,
            expected: bad.expected.to_string(),
            found: line.skipped_bytes.map_or_else(
                || Excerpt::new(bad.found),
                |length| Excerpt::remark(format!("{length} bytes beginning {}", Excerpt::new(bad.found))),
            ),
        });
    }
}

/// Whether a rear laser can sit so: an `RLASER` line whose two poses are those of laser and robot says where it sits; in logs that were
/// corrected the first is another pose of the robot.
fn looks_back(robot_from_laser: &Pose2) -> bool {
    robot_from_laser.x.hypot(robot_from_laser.y) <= REAR_AT_MOST_M && robot_from_laser.theta.cos() < REAR_COSINE
}

fn refused_pose(found: &[u8]) -> BadLine<'_> {
    BadLine::new(DropReason::PoseRefused, "a finite pose within 10^6 m", found)
}

/// Where the laser sits on the robot. A `PARAM` is preferred to the difference of the line's two rounded poses as long
/// as they agree, and stands in where the robot's pose is absent; none where a pose is refused.
fn mount(world_from_robot: PoseField, world_from_laser: PoseField, params: &LaserParams) -> Option<Pose2> {
    use PoseField::{Far, Usable};
    let ((Usable(world_from_robot), Usable(world_from_laser)) | (Far(world_from_robot), Far(world_from_laser))) =
        (world_from_robot, world_from_laser)
    else {
        let is_refused = |pose| matches!(pose, PoseField::Refused | PoseField::Far(_));
        let refused = is_refused(world_from_robot) || is_refused(world_from_laser);
        return (!refused).then_some(params.robot_from_laser);
    };
    let robot_from_laser = world_from_robot.between(world_from_laser);
    let agree = params.mount_given && same_mount(robot_from_laser, params.robot_from_laser);
    Some(if agree { params.robot_from_laser } else { robot_from_laser })
}

/// The head of a `ROBOTLASER` or `RAWLASER` line.
#[derive(Debug, Clone, Copy)]
struct Sweep {
    start_angle_rad: f64,
    field_of_view_rad: f64,
    step_rad: f64,
    range_max_m: f64,
}

impl Sweep {
    /// `laser_type start_angle fov angular_res max_range accuracy remission_mode`.
    fn read<'a>(cursor: &mut Cursor<'a>) -> Result<Self, BadLine<'a>> {
        cursor.number("a laser type")?;
        let start_angle_rad = angle(cursor, "a start angle within 540")?;
        let field_of_view_rad = angle(cursor, "a field of view within 540")?;
        let step_rad = angle(cursor, "an angular resolution within 540")?;
        let range_max_m = cursor.number("a maximum range")?;
        cursor.number("an accuracy")?;
        cursor.number("a remission mode")?;
        Ok(Self { start_angle_rad, field_of_view_rad, step_rad, range_max_m })
    }

    /// A resolution of 0 says that the field of view is spread over the beams.
    fn bearings(&self, beams: usize) -> Bearings {
        let spread_rad = self.field_of_view_rad / (beams.max(2) - 1) as f64;
        let said = SaidBearings {
            first_rad: self.start_angle_rad,
            last_rad: self.start_angle_rad + self.field_of_view_rad,
            step_rad: if self.step_rad == 0.0 { spread_rad } else { self.step_rad },
            names: ["the field of view", "angular resolution"],
        };
        said.settle(beams)
    }

    fn geometry(&self, beams: usize, angle_min_rad: f64, angle_step_rad: f64, robot_from_laser: Pose2) -> Geometry {
        let range_max_m = self.usable_reach_m().unwrap_or(RANGE_MAX_UNSAID_M);
        Geometry { beams, angle_min_rad, angle_step_rad, range_max_m, robot_from_laser }
    }

    fn usable_reach_m(&self) -> Option<f64> {
        Some(self.range_max_m).filter(|reach_m| reach_m.is_finite() && *reach_m > 0.0)
    }

    fn odd_reach(&self) -> Option<OddHead> {
        let words = || {
            format!("the maximum range is {}: not used, ranges count up to {RANGE_MAX_UNSAID_M} m", self.range_max_m)
        };
        self.usable_reach_m().is_none().then(|| OddHead { what: "range limits", words: words() })
    }
}

/// In radians, or in degrees up to one turn and a half.
fn angle<'a>(cursor: &mut Cursor<'a>, what: &'static str) -> Result<f64, BadLine<'a>> {
    let word = cursor.clone().word();
    let value = cursor.number(what)?;
    if value.abs() <= 540.0 { Ok(value) } else { Err(BadLine::new(DropReason::BadNumber, what, word)) }
}
