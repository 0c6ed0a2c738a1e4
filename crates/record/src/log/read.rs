//! A session out of any bytes: no length that they claim is believed beyond what they hold.

use super::bytes::{Coded, Cursor, text};
use super::codes::take_verdict;
use super::{
    CHECKSUM_BYTES, ENTRY_HEADER_BYTES, ENTRY_VERSION, HEADER_BYTES, Kind, LogError, LogLoss, LogReport, NONE,
    SESSION_MAGIC, Sensors, VERSION, v1,
};
use crate::adoption::Grows;
use crate::closure::{Candidate, Evidence};
use crate::entry::{
    Checkpoint, Entry, Fragment, Gravity, OdometryOrigin, RecordedEdge, Run, ScanPose, Snapshot, WheelSlip,
};
use crate::error::{EntryError, unless};
use crate::id::{KeyframeId, RunId};
use crate::keyframe::{Edge, Keyframe, Measurement};
use crate::left_out::{Beams, LeftOut};
use crate::numbers::Numbers;
use crate::session::Session;
use mapwright_geom::Stamp;
use std::sync::Arc;

impl Session {
    /// The session that these bytes of a file are, of version 1 or 2, and what of them was left out.
    ///
    /// A torn or damaged tail takes its entry alone. After damage in the middle it goes on with the next entry, if the
    /// damaged one's length leads to a whole one; else it stops there. Entries that refer to what was lost are left out.
    ///
    /// # Errors
    /// Any [`LogError`]: another kind of file, another version; in version 1 damage anywhere.
    pub fn read(bytes: &[u8]) -> Result<(Self, LogReport), LogError> {
        match version(bytes)? {
            v1::VERSION => Ok((v1::read(bytes)?, LogReport::new(v1::VERSION))),
            _ => read_log(bytes),
        }
    }
}

/// As [`Session::read`] for any kind of measurement, in files of version 2 alone.
///
/// # Errors
/// Another kind of file, another version.
pub fn read_log<M: Measurement>(bytes: &[u8]) -> Result<(Session<M>, LogReport), LogError> {
    match version(bytes)? {
        VERSION => Ok(LogReader::new().read(bytes)),
        found => Err(LogError::Version { found }),
    }
}

/// The entries of a file of version 2, in order, each as it was when it was written, and what was left out as of [`read_log`].
///
/// # Errors
/// Another kind of file, another version.
pub fn read_entries<M: Measurement>(bytes: &[u8]) -> Result<(Vec<Entry<M>>, LogReport), LogError> {
    match version(bytes)? {
        VERSION => {
            let mut reader = LogReader { told: Some(Vec::new()), ..LogReader::new() };
            let report = reader.read_all(bytes);
            Ok((reader.told.unwrap_or_default(), report))
        }
        found => Err(LogError::Version { found }),
    }
}

/// How many of these bytes, of a file of version 2, lead up to the last checkpoint before anything damaged, with it; none where there is
/// none. What they hold is a session that ends with it.
#[must_use]
pub fn checkpoint_end(bytes: &[u8]) -> Option<usize> {
    version(bytes).ok().filter(|version| *version == VERSION)?;
    let (mut at, mut end) = (HEADER_BYTES, None);
    while let Ok(frame) = Frame::at(bytes, at) {
        let kind = Kind::from_code(frame.kind).filter(|_| frame.version == ENTRY_VERSION)?;
        end = if kind == Kind::Checkpoint { Some(frame.end) } else { end };
        at = frame.end;
    }
    end
}

/// What the file says of itself.
fn version(bytes: &[u8]) -> Result<u16, LogError> {
    let there = bytes.len().min(SESSION_MAGIC.len());
    if bytes.get(..there) != SESSION_MAGIC.get(..there) || bytes.is_empty() {
        return Err(LogError::NoSession);
    }
    let Some(&[low, high]) = bytes.get(SESSION_MAGIC.len()..).and_then(<[u8]>::first_chunk) else {
        return Err(LogError::Cut { bytes: bytes.len() });
    };
    match u16::from_le_bytes([low, high]) {
        known @ (v1::VERSION | VERSION) => Ok(known),
        found => Err(LogError::Version { found }),
    }
}

/// An entry whose checksum is right.
struct Frame<'a> {
    kind: u8,
    version: u8,
    payload: &'a [u8],
    end: usize,
}

/// What stands in place of a whole entry, and where it would end if its length can be believed.
struct Damage {
    cause: EntryError,
    end: Option<usize>,
}

impl<'a> Frame<'a> {
    fn at(bytes: &'a [u8], start: usize) -> Result<Self, Damage> {
        let left = bytes.get(start..).unwrap_or_default();
        let torn = |whole: usize| Damage {
            cause: EntryError { expected: "an entry", found: format!("{} bytes of {whole}", left.len()) },
            end: None,
        };
        let Some((&[kind, version, l0, l1, l2, l3], _)) = left.split_first_chunk::<ENTRY_HEADER_BYTES>() else {
            return Err(torn(ENTRY_HEADER_BYTES + CHECKSUM_BYTES));
        };
        let checked_bytes = ENTRY_HEADER_BYTES + u32::from_le_bytes([l0, l1, l2, l3]) as usize;
        let Some((checked, Some(checksum))) =
            left.split_at_checked(checked_bytes).map(|(checked, rest)| (checked, rest.first_chunk()))
        else {
            return Err(torn(checked_bytes + CHECKSUM_BYTES));
        };
        let end = start + checked_bytes + CHECKSUM_BYTES;
        let (claimed, given) = (u32::from_le_bytes(*checksum), crc32fast::hash(checked));
        if claimed == given {
            return Ok(Self { kind, version, payload: checked.get(ENTRY_HEADER_BYTES..).unwrap_or_default(), end });
        }
        let found = format!("{claimed:08x} where its bytes give {given:08x}");
        Err(Damage { cause: EntryError { expected: "an entry's checksum", found }, end: Some(end) })
    }
}

impl Damage {
    /// Where the next whole entry begins; the file's end where there is none to be sure of.
    fn next(&self, bytes: &[u8]) -> usize {
        self.end.filter(|end| Frame::at(bytes, *end).is_ok()).unwrap_or(bytes.len())
    }
}

/// Turns entries' bytes into a session, entry by entry.
struct LogReader<M: Measurement> {
    session: Session<M>,
    runs: Numbers,
    keyframes: Numbers,
    edges: Numbers,
    candidates: Numbers,
    sensor_numbers: Numbers,
    sensors: Sensors<M>,
    /// Sensors since the last entry that is none: the keyframe they were written for is missing.
    open_sensors: usize,
    /// What was taken in since somebody asked, where somebody does.
    told: Option<Vec<Entry<M>>>,
}

impl<M: Measurement> LogReader<M> {
    fn new() -> Self {
        Self {
            session: Session::default(),
            runs: Numbers::default(),
            keyframes: Numbers::default(),
            edges: Numbers::default(),
            candidates: Numbers::default(),
            sensor_numbers: Numbers::default(),
            sensors: Sensors(Vec::new()),
            open_sensors: 0,
            told: None,
        }
    }

    fn add(&mut self, entry: Entry<M>) -> Result<(), EntryError> {
        let told = self.told.is_some().then(|| entry.clone());
        self.session.add(entry)?;
        told.into_iter().for_each(|entry| self.tell(|| entry));
        Ok(())
    }

    fn tell(&mut self, entry: impl FnOnce() -> Entry<M>) {
        if let Some(told) = &mut self.told {
            told.push(entry());
        }
    }

    fn read(mut self, bytes: &[u8]) -> (Session<M>, LogReport) {
        let report = self.read_all(bytes);
        (self.session, report)
    }

    fn read_all(&mut self, bytes: &[u8]) -> LogReport {
        let mut report = LogReport::new(VERSION);
        let (mut at, mut good_bytes, mut torn) = (HEADER_BYTES, HEADER_BYTES, 0);
        while at < bytes.len() {
            at = match Frame::at(bytes, at) {
                Ok(frame) => {
                    self.take_frame(&frame, at, &mut report);
                    good_bytes = if self.open_sensors == 0 { frame.end } else { good_bytes };
                    frame.end
                }
                Err(damage) => {
                    let next = damage.next(bytes);
                    torn += usize::from(next == bytes.len());
                    let EntryError { expected, found } = damage.cause;
                    report.lose(LogLoss { offset_bytes: at, bytes: next - at, entry: None, expected, found });
                    next
                }
            };
        }
        report.good_bytes = (report.lost == torn && self.numbers_as_the_log()).then_some(good_bytes);
        report
    }

    /// Whether the session numbers everything as the log does, but for sensors at its end that would be cut off.
    fn numbers_as_the_log(&self) -> bool {
        let numbers = [&self.runs, &self.keyframes, &self.edges, &self.candidates, &self.sensor_numbers];
        let settled = self.sensors.0.len().checked_sub(self.open_sensors);
        let settled = settled.and_then(|count| self.sensors.0.get(..count));
        numbers.into_iter().all(Numbers::is_whole) && settled == Some(&Sensors::of(&self.session).0)
    }

    fn take_frame(&mut self, frame: &Frame<'_>, offset_bytes: usize, report: &mut LogReport) {
        let Some(kind) = Kind::from_code(frame.kind).filter(|_| frame.version == ENTRY_VERSION) else {
            report.unknown += 1;
            self.open_sensors = 0;
            return;
        };
        if kind == Kind::Checkpoint && report.lost + report.unknown > 0 {
            // It was made of all that came before.
            report.entries += 1;
            return;
        }
        let lose = |report: &mut LogReport, bytes, EntryError { expected, found }| {
            report.lose(LogLoss { offset_bytes, bytes, entry: Some(kind.name()), expected, found });
        };
        self.open_sensors = if kind == Kind::Sensor { self.open_sensors } else { 0 };
        let mut cursor = Cursor::new(frame.payload);
        match self.take(kind, &mut cursor) {
            Ok(None) => report.entries += 1,
            Ok(Some(loss)) => {
                report.entries += 1;
                lose(report, loss.bytes, loss.cause);
            }
            Err(cause) => lose(report, frame.end - offset_bytes, cause),
        }
    }

    fn take(&mut self, kind: Kind, cursor: &mut Cursor<'_>) -> Result<Option<PartLost>, EntryError> {
        match kind {
            Kind::Run => self.run(cursor)?,
            Kind::BackTo => self.back_to(cursor)?,
            Kind::Sensor => self.sensor(cursor)?,
            Kind::Scan => self.scan(cursor)?,
            Kind::Keyframe => self.keyframe(cursor)?,
            Kind::Edge => self.edge(cursor)?,
            Kind::Candidate => self.candidate(cursor)?,
            Kind::Snapshot => return self.snapshot(cursor),
            Kind::Fragment => self.fragment(cursor)?,
            Kind::Remeasured => self.remeasured(cursor)?,
            Kind::Withdrawn => self.withdrawn(cursor)?,
            Kind::Verdict => self.verdict(cursor)?,
            Kind::LeftOut => self.left_out(cursor)?,
            Kind::WheelSlip => self.wheel_slip(cursor)?,
            Kind::ResultTakenIn => {
                let scan = cursor.u64("a result's scan")?;
                cursor.end()?;
                self.add(Entry::ResultTakenIn { scan })?;
            }
            Kind::OdometryOrigin => self.odometry_origin(cursor)?,
            Kind::Gravity => self.gravity(cursor)?,
            Kind::Checkpoint => self.add(Entry::Checkpoint(Checkpoint { state: cursor.rest().into() }))?,
        }
        Ok(None)
    }

    fn run(&mut self, cursor: &mut Cursor<'_>) -> Result<(), EntryError> {
        let number = new_number(&self.runs, cursor)?;
        let code = cursor.byte("a run's measurements")?;
        unless("measurements of the kind that is read", code == M::CODE, || format!("kind {code}, not {}", M::CODE))?;
        let robot = u128::from_le_bytes(cursor.array("a run's robot")?);
        let id = RunId { robot, session: cursor.u32("a run's session")? };
        let settings = text(cursor.rest(), "a run's settings")?;
        self.add(Entry::Run(Run { id, settings }))?;
        count(&mut self.runs, number);
        Ok(())
    }

    fn back_to(&mut self, cursor: &mut Cursor<'_>) -> Result<(), EntryError> {
        let run = self.known_run(cursor)?;
        cursor.end()?;
        self.add(Entry::BackTo(run))
    }

    fn sensor(&mut self, cursor: &mut Cursor<'_>) -> Result<(), EntryError> {
        let number = new_number(&self.sensor_numbers, cursor)?;
        self.sensors.0.push(Arc::new(M::take_sensor(cursor.rest())?));
        count(&mut self.sensor_numbers, number);
        self.open_sensors += 1;
        Ok(())
    }

    fn scan(&mut self, cursor: &mut Cursor<'_>) -> Result<(), EntryError> {
        let number = cursor.u32("a scan's number")?;
        let stamp = stamp(cursor)?;
        let keyframe = cursor.u32("a scan's keyframe")?;
        let scan = ScanPose {
            stamp,
            keyframe: if keyframe == NONE { None } else { Some(self.keyframe_id(keyframe)?) },
            keyframe_from_robot: cursor.pose()?,
            odom_from_robot: cursor.pose()?,
        };
        cursor.end()?;
        self.session.add_scan(u64::from(number), scan)?;
        self.tell(|| Entry::Scan(scan));
        Ok(())
    }

    fn keyframe(&mut self, cursor: &mut Cursor<'_>) -> Result<(), EntryError> {
        let number = new_number(&self.keyframes, cursor)?;
        let id = self.name(cursor)?;
        let stamp = stamp(cursor)?;
        let scan = cursor.u64("a keyframe's scan")?;
        let hardly_fits = cursor.flag("whether a keyframe hardly fits, 0 or 1")?;
        let map_from_keyframe = cursor.pose()?;
        let sensor = cursor.u32("a keyframe's sensor")?;
        let known = self.sensor_numbers.place(u64::from(sensor)).and_then(|place| self.sensors.0.get(place));
        let known = known.ok_or_else(|| missing("the number of a sensor", sensor))?;
        let sweep = Arc::new(M::take(known, cursor.rest())?);
        let keyframe = Arc::new(Keyframe { id, stamp, scan, sweep, hardly_fits });
        self.session.add_keyframe(Arc::clone(&keyframe), map_from_keyframe)?;
        self.tell(|| Entry::Keyframe { keyframe, map_from_keyframe });
        count(&mut self.keyframes, number);
        Ok(())
    }

    fn fragment(&mut self, cursor: &mut Cursor<'_>) -> Result<(), EntryError> {
        let first = self.known_keyframe(cursor)?;
        let start = cursor.coded("why a fragment begins, 0 to 2")?;
        cursor.end()?;
        self.add(Entry::Fragment(Fragment { first, start }))
    }

    fn edge(&mut self, cursor: &mut Cursor<'_>) -> Result<(), EntryError> {
        let number = new_number(&self.edges, cursor)?;
        let [from, to] = [self.known_keyframe(cursor)?, self.known_keyframe(cursor)?];
        let kind = cursor.coded("an edge's kind, 0 to 2")?;
        let candidate = match cursor.u32("an edge's candidate")? {
            NONE => None,
            candidate => Some(session_number(&self.candidates, candidate, "the number of a candidate")?),
        };
        let (from_from_to, information) = (cursor.pose()?, cursor.matrix::<M::Pose>()?);
        cursor.end()?;
        let edge = Edge { from, to, kind, from_from_to, information };
        self.add(Entry::Edge(RecordedEdge { edge, candidate }))?;
        count(&mut self.edges, number);
        Ok(())
    }

    fn remeasured(&mut self, cursor: &mut Cursor<'_>) -> Result<(), EntryError> {
        let number = self.known_edge(cursor)?;
        let (from_from_to, information) = (cursor.pose()?, cursor.matrix::<M::Pose>()?);
        cursor.end()?;
        self.add(Entry::Remeasured { number, from_from_to, information })
    }

    fn withdrawn(&mut self, cursor: &mut Cursor<'_>) -> Result<(), EntryError> {
        let number = self.known_edge(cursor)?;
        cursor.end()?;
        self.add(Entry::Withdrawn { number })
    }

    fn candidate(&mut self, cursor: &mut Cursor<'_>) -> Result<(), EntryError> {
        let number = new_number(&self.candidates, cursor)?;
        let (from, to) = (self.known_keyframe(cursor)?, self.name(cursor)?);
        let detection = cursor.coded("how a candidate was found, 0 to 2")?;
        let verdict = take_verdict(cursor)?;
        let (evidence, has_pose) = take_evidence(cursor)?;
        let from_from_to = if has_pose { Some(cursor.pose()?) } else { None };
        let covariance = cursor.matrix::<M::Pose>()?;
        cursor.end()?;
        let candidate = Candidate { from, to, detection, evidence, verdict, from_from_to, covariance };
        self.add(Entry::Candidate(candidate))?;
        count(&mut self.candidates, number);
        Ok(())
    }

    fn verdict(&mut self, cursor: &mut Cursor<'_>) -> Result<(), EntryError> {
        let number = cursor.u32("a verdict's candidate")?;
        let number = session_number(&self.candidates, number, "the number of a candidate")?;
        let (verdict, agreeing) = (take_verdict(cursor)?, cursor.u32("how many candidates agree")?);
        cursor.end()?;
        self.add(Entry::Verdict { number, verdict, agreeing })
    }

    fn left_out(&mut self, cursor: &mut Cursor<'_>) -> Result<(), EntryError> {
        let keyframe = self.known_keyframe(cursor)?;
        let reason = cursor.coded("why beams are left out, 0 to 3")?;
        let beams = if cursor.flag("whether all beams are left out, 0 or 1")? {
            cursor.end()?;
            Beams::All
        } else {
            Beams::These(beams(cursor.rest())?)
        };
        self.add(Entry::LeftOut(LeftOut { keyframe, beams, reason }))
    }

    fn odometry_origin(&mut self, cursor: &mut Cursor<'_>) -> Result<(), EntryError> {
        let (from_scan, odom_from_start) = (cursor.u64("the first scan of an origin")?, cursor.pose()?);
        cursor.end()?;
        self.add(Entry::OdometryOrigin(OdometryOrigin { from_scan, odom_from_start }))
    }

    fn gravity(&mut self, cursor: &mut Cursor<'_>) -> Result<(), EntryError> {
        let keyframe = self.known_keyframe(cursor)?;
        let mut number = || cursor.f64("where down is, and how surely");
        let (down_in_keyframe, sigma_rad) = ([number()?, number()?, number()?], number()?);
        cursor.end()?;
        self.add(Entry::Gravity(Gravity { keyframe, down_in_keyframe, sigma_rad }))
    }

    fn wheel_slip(&mut self, cursor: &mut Cursor<'_>) -> Result<(), EntryError> {
        let scan = cursor.u64("a slip's scan")?;
        let (from, metres) = (self.name(cursor)?, cursor.f64("a slip's length")?);
        cursor.end()?;
        self.add(Entry::WheelSlip(WheelSlip { scan, from, metres }))
    }

    /// Each pose stands for itself: those of keyframes that were lost are left out, and the others count.
    fn snapshot(&mut self, cursor: &mut Cursor<'_>) -> Result<Option<PartLost>, EntryError> {
        let number = cursor.u32("a snapshot's number")?;
        let (mut map_from_keyframe, mut lost) = (Vec::new(), None);
        while cursor.left_bytes() > 0 {
            let before = cursor.left_bytes();
            let id = self.known_keyframe(cursor);
            let pose = cursor.pose()?;
            match id {
                Ok(id) => map_from_keyframe.push((id, pose)),
                Err(cause) => PartLost::add(&mut lost, cause, before - cursor.left_bytes()),
            }
        }
        self.add(Entry::Snapshot(Snapshot { number, map_from_keyframe }))?;
        Ok(lost)
    }

    fn keyframe_id(&self, number: u32) -> Result<KeyframeId, EntryError> {
        let place = self.keyframes.place(u64::from(number));
        let keyframe = place.and_then(|place| self.session.keyframes().get(place));
        keyframe.map(|keyframe| keyframe.id).ok_or_else(|| missing("the number of a keyframe", number))
    }

    fn known_keyframe(&self, cursor: &mut Cursor<'_>) -> Result<KeyframeId, EntryError> {
        self.keyframe_id(cursor.u32("the number of a keyframe")?)
    }

    fn known_edge(&self, cursor: &mut Cursor<'_>) -> Result<u32, EntryError> {
        session_number(&self.edges, cursor.u32("the number of an edge")?, "the number of an edge")
    }

    /// A keyframe by its run and its place in the run's order.
    fn name(&self, cursor: &mut Cursor<'_>) -> Result<KeyframeId, EntryError> {
        let run = self.known_run(cursor)?;
        Ok(run.keyframe(cursor.u32("a keyframe's place in its run")?))
    }

    fn known_run(&self, cursor: &mut Cursor<'_>) -> Result<RunId, EntryError> {
        let number = cursor.u32("the number of a run")?;
        let run = self.runs.place(u64::from(number)).and_then(|place| self.session.runs().nth(place));
        run.map(|run| run.id).ok_or_else(|| missing("the number of a run", number))
    }
}

/// Reads a log as it comes, entry by entry, into a session of its own.
///
/// Entries may be handed over as they are as well ([`Grows::write`]), in between: of a log of which a reader has a part from elsewhere.
/// [`LogWriter::skip`](super::LogWriter) leaves these out.
pub struct EntryReader<M: Measurement = mapwright_sensor::Sweep>(LogReader<M>);

impl<M: Measurement> Default for EntryReader<M> {
    fn default() -> Self {
        Self::new()
    }
}

impl<M: Measurement> EntryReader<M> {
    /// Nothing was read yet.
    #[must_use]
    pub fn new() -> Self {
        Self(LogReader { told: Some(Vec::new()), ..LogReader::new() })
    }

    /// The next bytes: whole entries, without the head of a file. What they hold, in order.
    ///
    /// # Errors
    /// The first thing that is no entry or does not fit. What came before it is in the session.
    pub fn read(&mut self, bytes: &[u8]) -> Result<Vec<Entry<M>>, LogLoss> {
        let (mut report, mut at) = (LogReport::new(VERSION), 0);
        while at < bytes.len() {
            match Frame::at(bytes, at) {
                Ok(frame) => {
                    self.0.take_frame(&frame, at, &mut report);
                    at = frame.end;
                }
                Err(Damage { cause: EntryError { expected, found }, .. }) => {
                    let bytes = bytes.len() - at;
                    return Err(LogLoss { offset_bytes: at, bytes, entry: None, expected, found });
                }
            }
            if let Some(loss) = report.losses.pop() {
                return Err(loss);
            }
        }
        Ok(self.0.told.replace(Vec::new()).unwrap_or_default())
    }
}

impl<M: Measurement> Grows<M> for EntryReader<M> {
    fn session(&self) -> &Session<M> {
        &self.0.session
    }

    /// As if it had been read.
    fn write(&mut self, entry: Entry<M>) -> bool {
        let (counted, sensor) = match &entry {
            Entry::Run(_) => (Some(Kind::Run), None),
            Entry::Keyframe { keyframe, .. } => (Some(Kind::Keyframe), Some(Arc::clone(keyframe.sweep.sensor()))),
            Entry::Edge(_) => (Some(Kind::Edge), None),
            Entry::Candidate(_) => (Some(Kind::Candidate), None),
            _ => (None, None),
        };
        if self.0.session.add(entry).is_err() {
            return false;
        }
        if let Some(sensor) = sensor.filter(|sensor| self.0.sensors.place(sensor).is_none()) {
            let number = self.0.sensor_numbers.next();
            self.0.sensors.0.push(sensor);
            count(&mut self.0.sensor_numbers, number);
        }
        let numbers = match counted {
            Some(Kind::Run) => &mut self.0.runs,
            Some(Kind::Keyframe) => &mut self.0.keyframes,
            Some(Kind::Edge) => &mut self.0.edges,
            Some(Kind::Candidate) => &mut self.0.candidates,
            _ => return true,
        };
        let number = numbers.next();
        count(numbers, number);
        true
    }
}

/// Part of an entry does not fit.
struct PartLost {
    cause: EntryError,
    bytes: usize,
}

impl PartLost {
    /// The first cause stands for all.
    fn add(lost: &mut Option<Self>, cause: EntryError, bytes: usize) {
        lost.get_or_insert(Self { cause, bytes: 0 }).bytes += bytes;
    }
}

/// A number that is counted up, after gaps where entries were lost.
fn new_number(numbers: &Numbers, cursor: &mut Cursor<'_>) -> Result<u64, EntryError> {
    let number = u64::from(cursor.u32("a number")?);
    let is_new = number >= numbers.next();
    unless("a number that none before it has", is_new, || number.to_string())?;
    Ok(number)
}

fn count(numbers: &mut Numbers, number: u64) {
    numbers.leap_to(number);
    numbers.push();
}

/// What the session calls that which the log calls by this number.
fn session_number(numbers: &Numbers, number: u32, expected: &'static str) -> Result<u32, EntryError> {
    let place = numbers.place(u64::from(number)).map(|place| place as u32);
    place.ok_or_else(|| missing(expected, number))
}

fn missing(expected: &'static str, number: u32) -> EntryError {
    EntryError { expected, found: format!("{number}, which is not there") }
}

fn stamp(cursor: &mut Cursor<'_>) -> Result<Stamp, EntryError> {
    Ok(Stamp(i64::from_le_bytes(cursor.array("a stamp")?)))
}

fn beams(bytes: &[u8]) -> Result<Vec<u32>, EntryError> {
    let (beams, odd) = bytes.as_chunks();
    unless("four bytes a beam", odd.is_empty(), || format!("{} bytes", bytes.len()))?;
    Ok(beams.iter().map(|beam| u32::from_le_bytes(*beam)).collect())
}

fn take_evidence(cursor: &mut Cursor<'_>) -> Result<(Evidence, bool), EntryError> {
    let points = cursor.u32("a candidate's points")?;
    let agreeing = cursor.u32("how many candidates agree")?;
    let mask = cursor.byte("what is known of a candidate")?;
    unless("seven bits of what is known of a candidate", mask < 128, || mask.to_string())?;
    let mut number = |bit: u8| {
        let is_there = mask >> bit & 1 == 1;
        is_there.then(|| cursor.f64("a candidate's evidence")).transpose()
    };
    let evidence = Evidence {
        points,
        score: number(0)?,
        ambiguity: number(1)?,
        overlap: number(2)?,
        inlier_share: number(3)?,
        contradiction: number(4)?,
        cycle_chi2: number(5)?,
        agreeing,
    };
    Ok((evidence, mask >> 6 == 1))
}
