//! One or several logs of one drive as one stream of events.

use crate::carmen::{CarmenEvents, Next};
use crate::chain::Chain;
use crate::choice::{Choice, MountChoice};
use crate::error::LogError;
use crate::lag::Lag;
use crate::lagging::{AtOnce, Lagging, Timing, is_learnt};
use crate::merge::{WINDOW_BYTES, WINDOW_MESSAGES, WINDOW_S};
use crate::odometry::OdometrySource;
use crate::order::{Event, Order};
use crate::plan::Plan;
use crate::ranges::RangeCheck;
use crate::report::LogReport;
use crate::scans::{no_scan, no_sonar};
use crate::stream::Stream;
use crate::survey::Survey;
use crate::words::grouped;
use mapwright_bags::BagError;
use mapwright_formats::{CarmenReader, FormatError, LogEvent, LogStream, OrderReport, open_log};
use mapwright_geom::{Pose2, Stamp};
use mapwright_sensor::{
    CorrectedOdometry, LaserModel, LaserScan, Odometry, OdometryCalibration, SonarReading, TurnRate,
};
use std::cell::Cell;
use std::collections::VecDeque;
use std::fmt;
use std::io::{self, Read};
use std::path::PathBuf;
use std::rc::Rc;
use std::sync::Arc;

/// A log to read.
pub enum Input {
    /// A ROS 1 bag, an MCAP file, a ROS 2 bag as a folder or a database: read twice, so that it must be on disk.
    Recording(PathBuf),
    /// The same, where its first pass is done already.
    Surveyed(PathBuf, Box<Survey>),
    /// A CARMEN log, plain, gzip or bzip2; read once.
    Carmen(Box<dyn Read>),
}

impl fmt::Debug for Input {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Recording(path) | Self::Surveyed(path, _) => f.debug_tuple("Recording").field(path).finish(),
            Self::Carmen(_) => f.debug_tuple("Carmen").finish_non_exhaustive(),
        }
    }
}

impl Input {
    /// Whether the first bytes of a file (16 are enough) are those of a recording, compressed as a whole or not.
    #[must_use]
    pub fn is_recording(first_bytes: &[u8]) -> bool {
        const BEGINNINGS: [&[u8]; 4] = [b"#ROS", b"\x89MCAP", b"SQLite format 3\0", &[0x28, 0xb5, 0x2f, 0xfd]];
        BEGINNINGS.iter().any(|beginning| first_bytes.starts_with(beginning))
    }
}

/// A log may begin so much later than the one before ends: a robot that was switched off for longer has been moved, or may have
/// been, seconds.
const PAUSE_MOST_S: f64 = 3600.0;

/// So many scans are looked at before the first of them is handed out.
const SCANS_AHEAD: usize = 100;

/// A log of the drive.
#[derive(Debug)]
struct Part {
    name: String,
    reader: Reader,
}

#[derive(Debug)]
enum Reader {
    Carmen(Box<CarmenEvents<LogStream<Counted>>>, Rc<Cell<u64>>),
    Recording { path: PathBuf, survey: Box<Survey>, plan: Box<Plan>, timing: Timing },
    Stream(Box<Stream>),
}

/// One or several logs of one drive, in the order in which they are given.
#[derive(Debug)]
pub struct Drive {
    parts: VecDeque<Part>,
    reports: Vec<(String, LogReport)>,
    chain: Chain,
    scan: LaserScan,
    odometry: Odometry,
    turn_rate: TurnRate,
    sonar: SonarReading,
    /// Of the present log.
    order: Order,
    /// By how much its odometry lags, and what waits for that; and lasers whose motion is not undone.
    lagging: Lagging,
    timing: Timing,
    at_once: AtOnce,
    is_learnt: bool,
    /// Of the first log that says.
    lag: Option<Lag>,
    /// Events of the present log that were read ahead, in order; how many of them are scans, and their bytes.
    ahead: VecDeque<Event>,
    scans_ahead: usize,
    bytes_ahead: usize,
    /// Buffers of scans that were handed out.
    spare: Vec<LaserScan>,
    /// Nothing is left to be put in order.
    is_read: bool,
    /// How the present log ended, until what was read before is handed out.
    ended: Option<Result<(), LogError>>,
    is_begun: bool,
    /// Of the present log.
    ranges: RangeCheck,
    range_unit_m: Option<f64>,
    /// The name of the log before and its latest stamp, until the present one has said when it begins.
    before: Option<(String, Stamp)>,
    latest: Option<Stamp>,
    mount: Option<ByHand>,
    /// What is taken out of the odometry of logs that are read once.
    calibration: Option<OdometryCalibration>,
    corrected: Option<CorrectedOdometry>,
}

/// The mounting that is asked for, for the first laser of a log that is read once, and for all scans of that.
#[derive(Debug)]
struct ByHand {
    choice: MountChoice,
    said_and_used: Option<[Arc<LaserModel>; 2]>,
}

impl ByHand {
    /// Where the log has the laser.
    fn said_mount(&self) -> Option<Pose2> {
        self.said_and_used.as_ref().map(|[said, _]| said.robot_from_laser)
    }

    fn put(&mut self, laser: &mut Arc<LaserModel>) {
        if let Some([said, used]) = &self.said_and_used {
            if said == laser {
                laser.clone_from(used);
                return;
            }
            if said.name != laser.name {
                return;
            }
        }
        let MountChoice { robot_from_laser, inverted } = self.choice;
        let used = Arc::new(LaserModel { robot_from_laser, inverted, ..(**laser).clone() });
        let said = std::mem::replace(laser, Arc::clone(&used));
        self.said_and_used = Some([said, used]);
    }
}

/// Which buffer holds the event.
enum Kind {
    Scan,
    Odometry,
    TurnRate,
    Sonar,
}

impl Drive {
    /// Opens logs, each with its name for reports; recordings are read once from end to end and planned.
    ///
    /// Frames that an earlier recording has fixed hold for later ones too, for a split recording says them only once.
    ///
    /// # Errors
    /// [`LogError`]; what is refused says what to type instead.
    pub fn open(inputs: Vec<(String, Input)>, choice: &Choice) -> Result<Self, LogError> {
        Self::open_watched(inputs, choice, &mut |_, _| true)
    }

    /// As [`Drive::open`]; while recordings are looked through, `watch` hears now and then a log's name and how many of its
    /// messages were looked at, and says whether to go on.
    ///
    /// # Errors
    /// As of [`Drive::open`]; [`LogError::Stopped`] where `watch` does not go on.
    pub fn open_watched(
        inputs: Vec<(String, Input)>,
        choice: &Choice,
        watch: &mut dyn FnMut(&str, u64) -> bool,
    ) -> Result<Self, LogError> {
        let mut parts = VecDeque::new();
        let mut links = None;
        for (name, input) in inputs {
            let failed = |cause| LogError::Recording { name: name.clone(), cause };
            let (path, mut survey) = match input {
                Input::Recording(path) => {
                    let survey = Survey::watched(&path, &mut |seen| watch(&name, seen)).map_err(failed)?;
                    let survey = survey.ok_or_else(|| LogError::Stopped { name: name.clone() })?;
                    (path, Box::new(survey))
                }
                Input::Surveyed(path, survey) => (path, survey),
                Input::Carmen(source) => {
                    if let Some(option) = choice.of_recordings() {
                        let reason = format!(
                            "{option} is for recordings of messages, found a CARMEN log, which has no such thing"
                        );
                        return Err(LogError::refused(&name, &reason));
                    }
                    let reader = carmen(source).map_err(|cause| LogError::Carmen { name: name.clone(), cause })?;
                    parts.push_back(Part { name, reader });
                    continue;
                }
            };
            if let Some(links) = &links {
                survey.links.inherit(links);
            }
            links = Some(survey.links.clone());
            let plan = Plan::of(&survey, choice);
            let mut plan = plan.map_err(|reason| LogError::refused(&name, &reason))?;
            let timing = if is_learnt(choice) && plan.odometry != OdometrySource::None {
                Timing::of_recording(&path, &survey, &plan).map_err(failed)?
            } else {
                Timing::default()
            };
            plan.calibration = plan.calibration.or(timing.lag.map(|lag| OdometryCalibration::of_lag(lag.lag_s)));
            let reader = Reader::Recording { path, survey, plan: Box::new(plan), timing };
            parts.push_back(Part { name, reader });
        }
        let odometry = Odometry { stamp: Stamp(0), odom_from_robot: Pose2::IDENTITY };
        let turn_rate = TurnRate { stamp: Stamp(0), rad_per_s: 0.0 };
        let (chain, reports) = (Chain::default(), Vec::new());
        Ok(Self {
            parts,
            reports,
            chain,
            scan: no_scan(),
            odometry,
            turn_rate,
            sonar: no_sonar(),
            order: Order::default(),
            lagging: Lagging::default(),
            timing: Timing::default(),
            at_once: AtOnce::default(),
            is_learnt: is_learnt(choice),
            lag: None,
            ahead: VecDeque::new(),
            scans_ahead: 0,
            bytes_ahead: 0,
            spare: Vec::new(),
            is_read: false,
            ended: None,
            is_begun: false,
            ranges: RangeCheck::new(choice.range_unit_m),
            range_unit_m: choice.range_unit_m,
            before: None,
            latest: None,
            mount: choice.mount.map(|choice| ByHand { choice, said_and_used: None }),
            calibration: choice.odometry,
            corrected: None,
        })
    }

    /// The plans of the recordings that are not yet begun, with their names.
    pub fn plans(&self) -> impl Iterator<Item = (&str, &Plan)> {
        self.parts.iter().filter_map(|part| match &part.reader {
            Reader::Recording { plan, .. } => Some((part.name.as_str(), &**plan)),
            _ => None,
        })
    }

    /// Which log the events come from now, from 0.
    #[must_use]
    pub fn part(&self) -> usize {
        self.reports.len()
    }

    /// How much of the present log was read: bytes of a CARMEN log, the share of a recording.
    #[must_use]
    pub fn read_of_part(&self, size_bytes: u64) -> u64 {
        match self.parts.front().map(|part| &part.reader) {
            Some(Reader::Carmen(_, read_bytes)) => read_bytes.get(),
            Some(Reader::Stream(stream)) => (stream.share() * size_bytes as f64) as u64,
            _ => 0,
        }
    }

    /// How the odometry of one log goes on in the next, in words.
    #[must_use]
    pub fn notes(&self) -> &[String] {
        &self.chain.notes
    }

    /// The next scan or reading, or none at the end of the last log.
    ///
    /// # Errors
    /// [`LogError`] where a file fails. Damage and bad messages are in the [reports](Self::into_reports).
    pub fn next_event(&mut self) -> Result<Option<LogEvent<'_>>, LogError> {
        let Some(kind) = self.advance()? else { return Ok(None) };
        Ok(Some(match kind {
            Kind::Scan => LogEvent::Scan(&self.scan),
            Kind::Odometry => LogEvent::Odometry(&self.odometry),
            Kind::TurnRate => LogEvent::TurnRate(&self.turn_rate),
            Kind::Sonar => LogEvent::Sonar(&self.sonar),
        }))
    }

    fn advance(&mut self) -> Result<Option<Kind>, LogError> {
        while let Some(part) = self.parts.front_mut() {
            if !self.is_begun {
                self.timing = part.begin()?;
                self.chain.begin(&part.name);
                self.is_begun = true;
                let is_read_once = matches!(part.reader, Reader::Carmen(..));
                let calibration = self.calibration.filter(|_| is_read_once);
                self.corrected = calibration.map(CorrectedOdometry::new);
                let lag_s = calibration.map(|calibration| calibration.lag_s);
                self.lagging = Lagging::of(lag_s, self.is_learnt && is_read_once);
            }
            if let Some(kind) = self.next_in_order()? {
                if matches!(kind, Kind::Scan) && !self.ranges.take(&mut self.scan) {
                    continue;
                }
                self.follow(&kind)?;
                if let (Kind::Scan, Some(mount)) = (&kind, &mut self.mount) {
                    mount.put(&mut self.scan.laser);
                }
                if matches!(kind, Kind::Scan) && self.timing().at_once {
                    self.at_once.put(&mut self.scan.laser);
                }
                self.correct(&kind);
                self.chain(&kind);
                return Ok(Some(kind));
            }
            self.end_part();
        }
        Ok(None)
    }

    /// The next event of the present log in its buffer, or none at the log's end. Where a file fails, what was read before comes first.
    fn next_in_order(&mut self) -> Result<Option<Kind>, LogError> {
        self.read_ahead();
        let Some(event) = self.ahead.pop_front() else {
            return self.ended.take().unwrap_or(Ok(())).map(|()| None);
        };
        self.bytes_ahead -= event.held_bytes();
        Ok(Some(match event {
            Event::Scan(scan) => {
                self.scans_ahead -= 1;
                self.spare.push(std::mem::replace(&mut self.scan, scan));
                Kind::Scan
            }
            Event::Odometry(odometry) => {
                self.odometry = odometry;
                Kind::Odometry
            }
            Event::TurnRate(turn_rate) => {
                self.turn_rate = turn_rate;
                Kind::TurnRate
            }
            Event::Sonar(sonar) => {
                self.sonar = *sonar;
                Kind::Sonar
            }
        }))
    }

    /// Reads until so many scans wait that what they have in common is known.
    fn read_ahead(&mut self) {
        let has_room = |it: &Self| it.ahead.len() < WINDOW_MESSAGES && it.bytes_ahead < WINDOW_BYTES;
        while !self.is_read && self.scans_ahead < SCANS_AHEAD && has_room(self) {
            if let Some(event) = self.lagging.pop() {
                self.scans_ahead += usize::from(matches!(event, Event::Scan(_)));
                self.bytes_ahead += event.held_bytes();
                self.ahead.push_back(event);
            } else if let Some(event) = self.order.pop(self.ended.is_some()) {
                if let Event::Scan(scan) = &event {
                    self.ranges.look_ahead(scan);
                }
                self.lagging.push(event);
            } else if self.ended.is_some() && !self.lagging.is_over() {
                self.lagging.end();
            } else if self.ended.is_some() {
                self.is_read = true;
                self.ranges.end();
            } else if let Some(part) = self.parts.front_mut() {
                match part.read(&mut self.spare) {
                    Ok(Some(event)) => self.order.push(event),
                    Ok(None) => self.ended = Some(Ok(())),
                    Err(cause) => self.ended = Some(Err(cause)),
                }
            } else {
                self.is_read = true;
            }
        }
    }

    /// Whether the log can follow the one before, as far as stamps say.
    fn follow(&mut self, kind: &Kind) -> Result<(), LogError> {
        let stamp = match kind {
            Kind::Scan => self.scan.stamp,
            Kind::Odometry => self.odometry.stamp,
            Kind::Sonar => self.sonar.stamp,
            Kind::TurnRate => return Ok(()),
        };
        self.latest = Some(self.latest.map_or(stamp, |latest| latest.max(stamp)));
        let Some((before, last)) = self.before.take() else { return Ok(()) };
        let pause_s = stamp.secs_since(last);
        if (-WINDOW_S..=PAUSE_MOST_S).contains(&pause_s) {
            return Ok(());
        }
        let name = self.parts.front().map_or_else(String::new, |part| part.name.clone());
        Err(LogError::NotOneDrive { name, before, why: pause_words(pause_s) })
    }

    /// What is known of the times of the present log.
    fn timing(&self) -> Timing {
        if self.lagging.timing == Timing::default() { self.timing } else { self.lagging.timing }
    }

    /// By how much odometry was found to lag, and was put right, in the first log that was begun and says.
    #[must_use]
    pub fn lag(&self) -> Option<Lag> {
        self.lag.or_else(|| self.timing().lag.filter(|_| self.is_learnt))
    }

    fn correct(&mut self, kind: &Kind) {
        let Some(corrected) = &mut self.corrected else { return };
        match kind {
            Kind::Scan => self.scan.odom_from_robot = self.scan.odom_from_robot.map(|said| corrected.pose(said)),
            Kind::Odometry => self.odometry.odom_from_robot = corrected.pose(self.odometry.odom_from_robot),
            Kind::TurnRate | Kind::Sonar => {}
        }
    }

    fn chain(&mut self, kind: &Kind) {
        match kind {
            Kind::Scan => {
                let stamp = self.scan.stamp;
                self.scan.odom_from_robot = self.scan.odom_from_robot.map(|pose| self.chain.pose(stamp, pose));
            }
            Kind::Odometry => {
                let Odometry { stamp, odom_from_robot } = self.odometry;
                self.odometry.odom_from_robot = self.chain.pose(stamp, odom_from_robot);
            }
            Kind::TurnRate | Kind::Sonar => {}
        }
    }

    fn end_part(&mut self) {
        (self.is_begun, self.is_read) = (false, false);
        self.ahead.clear();
        (self.scans_ahead, self.bytes_ahead) = (0, 0);
        let timing = if self.is_learnt { self.timing() } else { Timing::default() };
        self.lag = self.lag.or(timing.lag);
        (self.timing, self.lagging) = (Timing::default(), Lagging::default());
        if let Some(part) = self.parts.pop_front() {
            self.before = self.latest.take().map(|latest| (part.name.clone(), latest)).or(self.before.take());
            let ranges = std::mem::replace(&mut self.ranges, RangeCheck::new(self.range_unit_m));
            let said_mount = match &part.reader {
                Reader::Stream(stream) => stream.said_mount(),
                _ => self.mount.as_ref().and_then(ByHand::said_mount),
            };
            let mut report = match part.reader {
                Reader::Carmen(reader, _) => LogReport::Carmen(Box::new(reader.into_report())),
                Reader::Stream(stream) => LogReport::Recording(Box::new(stream.into_report())),
                Reader::Recording { .. } => return,
            };
            report.set_ranges(ranges.into_report());
            let Timing { lag, at_once } = timing;
            if let (Some(by_hand), Some(said)) = (&self.mount, said_mount) {
                report.set_moved_mount([said, by_hand.choice.robot_from_laser]);
            }
            let lag_s = lag.map(|lag| [lag.lag_s, lag.sigma_s]);
            report.set_order(OrderReport { lag_s, at_once, ..std::mem::take(&mut self.order).report() });
            self.reports.push((part.name, report));
        }
    }

    /// The report of each log that was begun, with its name.
    #[must_use]
    pub fn into_reports(mut self) -> Vec<(String, LogReport)> {
        if self.is_begun {
            self.end_part();
        }
        self.reports
    }
}

/// When a log begins, seen from the end of the one before.
fn pause_words(pause_s: f64) -> String {
    let words = match pause_s.abs() {
        s if s < 120.0 => format!("{s:.1} s"),
        s if s < 7200.0 => format!("{:.0} min", s / 60.0),
        s => format!("{} h", grouped((s / 3600.0).round() as u64)),
    };
    if pause_s < 0.0 {
        format!("it begins {words} before that ends")
    } else {
        format!("it begins {words} after that ends")
    }
}

impl Part {
    /// Opens a recording for its second pass; what is known of its times.
    fn begin(&mut self) -> Result<Timing, LogError> {
        let Reader::Recording { path, survey, plan, timing } = &self.reader else { return Ok(Timing::default()) };
        let (stream, timing) = (Stream::open(path, (**survey).clone(), (**plan).clone()), *timing);
        self.reader = Reader::Stream(Box::new(stream.map_err(|cause| self.failed(cause))?));
        Ok(timing)
    }

    fn failed(&self, cause: BagError) -> LogError {
        LogError::Recording { name: self.name.clone(), cause }
    }

    /// The next event as it arrived; a scan is put into a buffer to spare.
    fn read(&mut self, spare: &mut Vec<LaserScan>) -> Result<Option<Event>, LogError> {
        let event = match &mut self.reader {
            Reader::Recording { .. } => return Ok(None),
            Reader::Stream(stream) => stream.next_event().map(Ok),
            Reader::Carmen(events, _) => {
                let mut scan = spare.pop().unwrap_or_else(no_scan);
                let mut odometry = Odometry { stamp: Stamp(0), odom_from_robot: Pose2::IDENTITY };
                Ok(events.next(&mut scan, &mut odometry).map(|event| match event? {
                    Next::Scan => Some(Event::Scan(scan)),
                    Next::Odometry => {
                        spare.push(scan);
                        Some(Event::Odometry(odometry))
                    }
                    Next::Sonar(reading) => {
                        spare.push(scan);
                        Some(Event::Sonar(reading))
                    }
                }))
            }
        };
        match event {
            Ok(Ok(event)) => Ok(event),
            Ok(Err(cause)) => Err(LogError::Carmen { name: self.name.clone(), cause }),
            Err(cause) => Err(self.failed(cause)),
        }
    }
}

fn carmen(source: Box<dyn Read>) -> Result<Reader, FormatError> {
    let read_bytes = Rc::new(Cell::new(0));
    let stream = open_log(Counted { source, read_bytes: Rc::clone(&read_bytes) })?;
    Ok(Reader::Carmen(Box::new(CarmenEvents::new(CarmenReader::new(stream))), read_bytes))
}

/// Counts the bytes taken from a source.
struct Counted {
    source: Box<dyn Read>,
    read_bytes: Rc<Cell<u64>>,
}

impl Read for Counted {
    fn read(&mut self, out: &mut [u8]) -> io::Result<usize> {
        let got = self.source.read(out)?;
        self.read_bytes.set(self.read_bytes.get() + got as u64);
        Ok(got)
    }
}
