//! RPLIDAR of Slamtec: asked for scans, answered by nodes or capsules without end.

mod packets;
mod requests;
mod scanning;

use crate::counts::Counts;
use crate::revolution::{Revolution, Turns};
use mapwright_geom::Stamp;
use packets::Scan;
use requests::Question;
pub use requests::{Request, RplidarInfo};
use scanning::Scanning;
use std::collections::VecDeque;

/// An answer begins so: seven bytes with its length and type.
const ANSWER: [u8; 2] = [0xA5, 0x5A];
const DESCRIPTOR_BYTES: usize = 7;
/// What is on the wire when it is told to stop has arrived by then, nanoseconds.
const QUIET_NS: i64 = 100_000_000;
/// It has started anew so long after a reset, nanoseconds.
const RESET_NS: i64 = 2_000_000_000;
/// It answers within so long, nanoseconds.
const ANSWER_NS: i64 = 1_000_000_000;
/// It scans within so long after it was asked to, and sends on within so long, nanoseconds.
const SILENCE_NS: i64 = 2_000_000_000;

/// How an RPLIDAR is to scan.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ScanMode {
    /// By the mode that it says is its typical one; express, then standard, where it does not say or does not do it.
    #[default]
    Typical,
    /// Standard: five bytes a reading, with its quality.
    Standard,
    /// Express: twice the readings on the same line, without quality. Standard where it knows no express scans.
    Express,
}

/// Asks an RPLIDAR for scans and makes revolutions of them.
///
/// It is stopped, asked what and how it is, its motor is started, and it is asked to scan. Where it does not answer, or is silent for two seconds, all
/// this begins anew. One that has stopped to protect itself is reset.
#[derive(Debug)]
pub struct Rplidar {
    mode: ScanMode,
    stage: Stage,
    requests: VecDeque<Request>,
    pending: Vec<u8>,
    info: Option<RplidarInfo>,
    /// Nanoseconds from reading to reading of standard and express scans, where it says.
    sample_ns: [Option<i64>; 2],
    scanning: Scanning,
    turns: Turns,
    counts: Counts,
    problem: Option<String>,
    /// What it says of its own health, where that does not keep it from scanning.
    warning: Option<String>,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Stage {
    /// To be stopped.
    Begin,
    /// What arrives until then is of no interest.
    Quiet {
        until: Stamp,
        is_reset: bool,
    },
    /// To be asked, or asked at a time.
    Asking {
        question: Question,
        asked: Option<Stamp>,
    },
    /// To be asked to scan, or asked at a time.
    Starting {
        way: Way,
        asked: Option<Stamp>,
    },
    Scanning {
        way: Way,
        heard: Stamp,
    },
}

/// A request to scan.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Way {
    /// An express scan of a mode, and nanoseconds from reading to reading, where it says.
    Mode {
        mode: u8,
        sample_ns: Option<i64>,
    },
    Express,
    Standard,
}

impl Way {
    fn bytes(self) -> Vec<u8> {
        match self {
            Self::Mode { mode, .. } => requests::express(mode),
            Self::Express => requests::express(0),
            Self::Standard => requests::SCAN.to_vec(),
        }
    }

    /// What is tried where the lidar does not do it.
    fn otherwise(self) -> Option<Self> {
        match self {
            Self::Mode { .. } => Some(Self::Express),
            Self::Express => Some(Self::Standard),
            Self::Standard => None,
        }
    }
}

impl Default for Rplidar {
    fn default() -> Self {
        Self::new()
    }
}

impl Rplidar {
    /// A lidar of which nothing has arrived yet, to scan by its typical mode.
    #[must_use]
    pub fn new() -> Self {
        Self::of(ScanMode::default())
    }

    /// A lidar that is to scan so.
    #[must_use]
    pub fn of(mode: ScanMode) -> Self {
        Self {
            mode,
            stage: Stage::Begin,
            requests: VecDeque::new(),
            pending: Vec::new(),
            info: None,
            sample_ns: [None; 2],
            scanning: Scanning::default(),
            turns: Turns::default(),
            counts: Counts::default(),
            problem: None,
            warning: None,
        }
    }

    /// The next thing to do to the line, if there is one now. To be asked until there is none, after each receipt and at least ten times a second.
    pub fn next_request(&mut self, now: Stamp) -> Option<Request> {
        if self.requests.is_empty() {
            self.go_on(now);
        }
        self.requests.pop_front()
    }

    /// Takes in bytes, in any pieces, that arrived at a time.
    pub fn receive(&mut self, bytes: &[u8], arrived: Stamp) {
        self.counts.bytes_received += bytes.len() as u64;
        self.pending.extend_from_slice(bytes);
        let pending = std::mem::take(&mut self.pending);
        let mut rest = &pending[..];
        while let Some(taken) = self.step(rest, arrived) {
            rest = &rest[taken..];
        }
        self.pending = rest.to_vec();
    }

    /// The next whole revolution.
    pub fn next_scan(&mut self) -> Option<Revolution> {
        self.turns.next()
    }

    /// What became of all bytes.
    #[must_use]
    pub fn counts(&self) -> &Counts {
        &self.counts
    }

    /// What it says of itself, once it has.
    #[must_use]
    pub fn info(&self) -> Option<&RplidarInfo> {
        self.info.as_ref()
    }

    /// What keeps it from scanning, or what it warns of itself, in words; none while all is well.
    #[must_use]
    pub fn problem(&self) -> Option<&str> {
        self.problem.as_deref().or(self.warning.as_deref())
    }

    /// The cable was pulled out and put back: what has begun is left out, and the lidar is started anew.
    pub fn restart(&mut self) {
        self.counts.restarts += 1;
        self.begin_anew();
    }

    /// What is to be done to the line before it is left alone: the lidar stops, and so does its motor.
    #[must_use]
    pub fn last_requests(&self) -> [Request; 3] {
        let model = self.info.map_or(0, |info| info.model);
        let stop = Request::Bytes(requests::STOP.to_vec());
        [stop, Request::Bytes(requests::stop_motor(model)), Request::Dtr(true)]
    }

    fn begin_anew(&mut self) {
        self.skip(self.pending.len());
        self.pending.clear();
        self.requests.clear();
        self.turns.break_off(&mut self.counts);
        self.stage = Stage::Begin;
    }

    fn skip(&mut self, bytes: usize) -> usize {
        self.counts.bytes_skipped += bytes as u64;
        bytes
    }

    fn use_up(&mut self, bytes: usize) -> usize {
        self.counts.bytes_used += bytes as u64;
        bytes
    }

    /// What is due at a time: requests, or another try where an answer is.
    fn go_on(&mut self, now: Stamp) {
        let since_ns = |then: Stamp| now.0.saturating_sub(then.0);
        match self.stage {
            Stage::Begin => {
                self.requests.extend([Request::Dtr(false), Request::Bytes(requests::STOP.to_vec())]);
                self.stage = Stage::Quiet { until: Stamp(now.0.saturating_add(QUIET_NS)), is_reset: false };
            }
            Stage::Quiet { until, is_reset: true } if now >= until => self.begin_anew(),
            Stage::Quiet { until, .. } if now >= until => self.ask(Question::Info),
            Stage::Asking { question, asked: None } => {
                self.requests.push_back(Request::Bytes(question.bytes()));
                self.stage = Stage::Asking { question, asked: Some(now) };
            }
            Stage::Asking { question, asked: Some(asked) } if since_ns(asked) > ANSWER_NS => self.unanswered(question),
            Stage::Starting { way, asked: None } => {
                self.requests.push_back(Request::Bytes(way.bytes()));
                self.stage = Stage::Starting { way, asked: Some(now) };
            }
            Stage::Starting { way, asked: Some(asked) } if since_ns(asked) > SILENCE_NS => {
                self.counts.timeouts += 1;
                self.start_otherwise(way);
            }
            Stage::Scanning { heard, .. } if since_ns(heard) > SILENCE_NS => {
                self.problem =
                    Some("the lidar has sent nothing that can be used for 2 s: it is started anew".to_owned());
                self.restart();
            }
            _ => {}
        }
    }

    fn ask(&mut self, question: Question) {
        self.stage = Stage::Asking { question, asked: None };
    }

    fn start(&mut self, way: Way) {
        self.stage = Stage::Starting { way, asked: None };
    }

    fn unanswered(&mut self, question: Question) {
        self.counts.timeouts += 1;
        match question {
            Question::Info | Question::Health => {
                let words = "no answer within 1 s: expected an RPLIDAR, found silence or something else (another speed of the line?)";
                self.problem = Some(words.to_owned());
                self.begin_anew();
            }
            Question::SampleTimes => self.start_motor(),
            Question::TypicalMode | Question::ModeAnswer(_) => self.start(Way::Express),
            Question::ModeSampleTime(mode) => self.start(Way::Mode { mode: mode as u8, sample_ns: None }),
        }
    }

    fn start_otherwise(&mut self, way: Way) {
        match way.otherwise() {
            Some(way) => self.start(way),
            None => {
                self.problem =
                    Some("the lidar answers, and does not scan when it is asked to: it is started anew".to_owned());
                self.restart();
            }
        }
    }

    /// The motor starts before the lidar is asked to scan.
    fn start_motor(&mut self) {
        let model = self.info.map_or(0, |info| info.model);
        self.requests.push_back(Request::Bytes(requests::start_motor(model)));
        match self.mode {
            ScanMode::Typical => self.ask(Question::TypicalMode),
            ScanMode::Express => self.start(Way::Express),
            ScanMode::Standard => self.start(Way::Standard),
        }
    }

    /// Reads what is next, or passes over bytes: how many were done with; none where more are needed.
    fn step(&mut self, rest: &[u8], arrived: Stamp) -> Option<usize> {
        if rest.is_empty() {
            return None;
        }
        match self.stage {
            Stage::Begin | Stage::Quiet { .. } => Some(self.skip(rest.len())),
            Stage::Asking { question, .. } => self.step_answer(question, rest, arrived),
            Stage::Starting { way, .. } => self.step_start(way, rest, arrived),
            Stage::Scanning { way, .. } => {
                let (taken, is_good) = self.scanning.step(rest, arrived, &mut self.turns, &mut self.counts)?;
                if is_good {
                    self.stage = Stage::Scanning { way, heard: arrived };
                }
                Some(taken)
            }
        }
    }

    fn step_answer(&mut self, question: Question, rest: &[u8], arrived: Stamp) -> Option<usize> {
        let Some((kind, length)) = descriptor(rest)? else { return Some(self.skip(1)) };
        if !question.is_answer(kind, length) {
            return Some(self.skip(1));
        }
        let answer = rest.get(DESCRIPTOR_BYTES..DESCRIPTOR_BYTES + length)?;
        self.take_answer(question, answer, arrived);
        Some(self.use_up(DESCRIPTOR_BYTES + length))
    }

    fn step_start(&mut self, way: Way, rest: &[u8], arrived: Stamp) -> Option<usize> {
        let Some((kind, length)) = descriptor(rest)? else { return Some(self.skip(1)) };
        match Scan::of(kind) {
            Some(scan) if scan.bytes() == length => {
                self.scanning = Scanning::of(scan, self.sample_ns_of(way, scan));
                (self.stage, self.problem) = (Stage::Scanning { way, heard: arrived }, None);
            }
            // an answer without end (its send mode says so) that is not read here
            None if kind > 0x81 && rest[5] & 0xC0 != 0 => {
                self.requests.push_back(Request::Bytes(requests::STOP.to_vec()));
                self.start_otherwise(way);
            }
            _ => return Some(self.skip(1)),
        }
        Some(self.use_up(DESCRIPTOR_BYTES))
    }

    fn sample_ns_of(&self, way: Way, scan: Scan) -> Option<i64> {
        match (way, scan) {
            (Way::Mode { sample_ns, .. }, _) => sample_ns,
            (_, Scan::Standard) => self.sample_ns[0],
            (_, Scan::Express) => self.sample_ns[1],
            (_, Scan::Ultra | Scan::Dense) => None,
        }
    }

    fn take_answer(&mut self, question: Question, answer: &[u8], arrived: Stamp) {
        match question {
            Question::Info => {
                self.info = RplidarInfo::parse(answer);
                self.ask(Question::Health);
            }
            Question::Health => self.take_health(answer, arrived),
            Question::SampleTimes => {
                let micros = |at: usize| i64::from(u16::from_le_bytes([answer[at], answer[at + 1]])) * 1000;
                self.sample_ns = [0, 2].map(|at| Some(micros(at)).filter(|&ns| ns > 0));
                self.start_motor();
            }
            Question::TypicalMode => match question.number(answer) {
                // an express scan of mode 0 is what all know, whatever mode 0 is called
                Some(mode @ 1..=255) => self.ask(Question::ModeAnswer(mode as u16)),
                _ => self.start(Way::Express),
            },
            Question::ModeAnswer(mode) => match question.number(answer).map(|kind| Scan::of(kind as u8)) {
                Some(Some(Scan::Standard)) => self.start(Way::Standard),
                Some(Some(_)) => self.ask(Question::ModeSampleTime(mode)),
                _ => self.start(Way::Express),
            },
            Question::ModeSampleTime(mode) => {
                // microseconds in 256ths
                let sample_ns = question.number(answer).map(|said| i64::from(said) * 1000 / 256).filter(|&ns| ns > 0);
                self.start(Way::Mode { mode: mode as u8, sample_ns });
            }
        }
    }

    fn take_health(&mut self, answer: &[u8], arrived: Stamp) {
        let code = u16::from_le_bytes([answer[1], answer[2]]);
        self.warning = None;
        match answer[0] {
            0 => self.ask(Question::SampleTimes),
            1 => {
                self.warning = Some(format!("the lidar warns of itself (code {code:#06x}), and scans"));
                self.ask(Question::SampleTimes);
            }
            _ => {
                self.problem = Some(format!(
                    "the lidar has stopped to protect itself (protection stop, code {code:#06x}): it is reset; where that does not help, see \
                     whether something keeps it from turning"
                ));
                self.counts.resets += 1;
                self.requests.push_back(Request::Bytes(requests::RESET.to_vec()));
                self.stage = Stage::Quiet { until: Stamp(arrived.0.saturating_add(RESET_NS)), is_reset: true };
            }
        }
    }
}

/// Type and length of an answer that begins here: none where more bytes are needed, `Some(None)` where none begins.
fn descriptor(rest: &[u8]) -> Option<Option<(u8, usize)>> {
    if !ANSWER.starts_with(&rest[..rest.len().min(ANSWER.len())]) {
        return Some(None);
    }
    let head = rest.first_chunk::<DESCRIPTOR_BYTES>()?;
    let length = u32::from_le_bytes([head[2], head[3], head[4], head[5]]) & 0x3FFF_FFFF;
    Some(Some((head[6], length as usize)))
}
