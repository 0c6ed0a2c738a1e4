//! Entries as bytes.

use super::bytes::{Coded, put_f64, put_matrix, put_pose, put_u32};
use super::codes::put_verdict;
use super::{CHECKSUM_BYTES, ENTRY_HEADER_BYTES, ENTRY_VERSION, Kind, NONE, SESSION_MAGIC, Sensors, VERSION};
use crate::closure::{Candidate, Evidence, Verdict};
use crate::entry::{Entry, Fragment, Gravity, OdometryOrigin, RecordedEdge, Run, ScanPose, Snapshot, WheelSlip};
use crate::error::{EntryError, unless};
use crate::id::{KeyframeId, RunId};
use crate::keyframe::{Keyframe, Measurement};
use crate::left_out::{Beams, LeftOut};
use crate::names::Names;
use crate::session::Session;
use mapwright_geom::Pose;
use mapwright_sensor::Sweep;
use std::sync::Arc;

/// Writes the entries of a run, in order, as the bytes of a log.
///
/// It fills a buffer and knows no file: whoever maps appends the buffer to the file and empties it when it likes. It wants the
/// entries that a [`Session`] takes, in the same order. It does not check values, only that what is referred to was written.
///
/// Snapshots are large and frequent, so they are kept back: the latest pose of each keyframe that has moved is written once
/// as many bytes have been written since the last snapshot as this one will take, so that snapshots at most double the file.
/// What is still kept back is written by [`LogWriter::finish`], as often as one likes. A log that ends without it has all its
/// edges, but older keyframes stand where they did before the last corrections: solve its graph before a map is made of it.
#[derive(Debug)]
pub struct LogWriter<M: Measurement = Sweep> {
    begun: bool,
    names: Names,
    keyframes: u32,
    next_scan: u64,
    edges: u32,
    candidates: u32,
    sensors: Sensors<M>,
    kept_back: Option<KeptBack<M>>,
    since_snapshot_bytes: usize,
    /// Bytes of other entries for each one of snapshots, at least.
    per_snapshot_byte: f64,
}

/// Snapshots that are not written yet, merged.
#[derive(Debug)]
struct KeptBack<M: Measurement> {
    number: u32,
    /// By the keyframes' numbers.
    map_from_keyframe: Vec<Option<M::Pose>>,
    moved: usize,
}

impl<M: Measurement> Default for LogWriter<M> {
    fn default() -> Self {
        Self::new()
    }
}

impl<M: Measurement> LogWriter<M> {
    /// A writer for an empty file.
    #[must_use]
    pub fn new() -> Self {
        Self { begun: false, ..Self::resume(&Session::default()) }
    }

    /// A writer that goes on with a log that was read: for a file cut to [`LogReport::good_bytes`](super::LogReport), which
    /// says whether that may be done.
    #[must_use]
    pub fn resume(session: &Session<M>) -> Self {
        Self {
            begun: true,
            names: session.names().clone(),
            keyframes: session.keyframes().len() as u32,
            next_scan: session.scan_numbers().next(),
            edges: session.recorded_edges().len() as u32,
            candidates: session.candidates().len() as u32,
            sensors: Sensors::of(session),
            kept_back: None,
            since_snapshot_bytes: 0,
            per_snapshot_byte: 1.0,
        }
    }

    /// Snapshots take at most this share of the log, above zero, instead of half of it.
    #[must_use]
    pub fn with_snapshots_of(self, share: f64) -> Self {
        Self { per_snapshot_byte: 1.0 / share.clamp(1e-3, 1.0) - 1.0, ..self }
    }

    /// Appends an entry's bytes, or keeps it back if it is a snapshot.
    ///
    /// # Errors
    /// The entry refers to what was not written, or would take 4 GiB. Nothing of it is appended then, and the writer may go on
    /// without it.
    pub fn append(&mut self, out: &mut Vec<u8>, entry: &Entry<M>) -> Result<(), EntryError> {
        let before = out.len();
        self.begin(out);
        self.write(out, entry)?;
        self.since_snapshot_bytes += out.len() - before;
        self.write_snapshot_if(out, |writer, bytes| {
            writer.since_snapshot_bytes as f64 >= writer.per_snapshot_byte * bytes as f64
        })
    }

    /// Counts an entry that the reader has from elsewhere ([`EntryReader`](super::EntryReader)) as written.
    ///
    /// # Errors
    /// As [`LogWriter::append`].
    pub fn skip(&mut self, entry: &Entry<M>) -> Result<(), EntryError> {
        let mut elsewhere = Vec::new();
        self.write(&mut elsewhere, entry)?;
        self.since_snapshot_bytes += elsewhere.len();
        Ok(())
    }

    /// Appends what was kept back. The writer may go on after it.
    pub fn finish(&mut self, out: &mut Vec<u8>) {
        self.begin(out);
        // of 4 GiB alone it says that it cannot be written
        let _ = self.write_snapshot_if(out, |_, _| true);
    }

    fn begin(&mut self, out: &mut Vec<u8>) {
        if !self.begun {
            out.extend_from_slice(SESSION_MAGIC);
            out.extend_from_slice(&VERSION.to_le_bytes());
            self.begun = true;
        }
    }

    fn write(&mut self, out: &mut Vec<u8>, entry: &Entry<M>) -> Result<(), EntryError> {
        match entry {
            Entry::Run(run) => self.run(out, run),
            Entry::BackTo(run) => self.back_to(out, *run),
            Entry::Scan(scan) => self.scan(out, scan),
            Entry::Keyframe { keyframe, map_from_keyframe } => self.keyframe(out, keyframe, *map_from_keyframe),
            Entry::Fragment(fragment) => self.fragment(out, *fragment),
            Entry::Edge(edge) => self.edge(out, edge),
            Entry::Remeasured { number, from_from_to, information } => {
                self.is_edge(*number)?;
                put_entry(out, Kind::Remeasured, |out| {
                    put_u32(out, *number);
                    put_pose(out, *from_from_to);
                    put_matrix::<M::Pose>(out, information);
                })
            }
            Entry::Withdrawn { number } => {
                self.is_edge(*number)?;
                put_entry(out, Kind::Withdrawn, |out| put_u32(out, *number))
            }
            Entry::Candidate(candidate) => self.candidate(out, candidate),
            Entry::Verdict { number, verdict, agreeing } => self.verdict(out, *number, *verdict, *agreeing),
            Entry::LeftOut(left_out) => self.left_out(out, left_out),
            Entry::WheelSlip(slip) => self.wheel_slip(out, slip),
            Entry::ResultTakenIn { scan } => {
                put_entry(out, Kind::ResultTakenIn, |out| out.extend_from_slice(&scan.to_le_bytes()))
            }
            Entry::OdometryOrigin(OdometryOrigin { from_scan, odom_from_start }) => {
                put_entry(out, Kind::OdometryOrigin, |out| {
                    out.extend_from_slice(&from_scan.to_le_bytes());
                    put_pose(out, *odom_from_start);
                })
            }
            Entry::Gravity(Gravity { keyframe, down_in_keyframe, sigma_rad }) => {
                let keyframe = self.place(*keyframe)?;
                put_entry(out, Kind::Gravity, |out| {
                    put_u32(out, keyframe);
                    down_in_keyframe.iter().chain([sigma_rad]).for_each(|number| put_f64(out, *number));
                })
            }
            Entry::Snapshot(snapshot) => self.keep_back(snapshot),
            Entry::Checkpoint(checkpoint) => {
                put_entry(out, Kind::Checkpoint, |out| out.extend_from_slice(&checkpoint.state))
            }
        }
    }

    fn run(&mut self, out: &mut Vec<u8>, run: &Run) -> Result<(), EntryError> {
        let number = self.names.run_count();
        unless("a run that has not begun yet", self.names.run_number(run.id).is_none(), || {
            format!("{:?} again", run.id)
        })?;
        put_entry(out, Kind::Run, |out| {
            put_u32(out, number as u32);
            out.push(M::CODE);
            out.extend_from_slice(&run.id.robot.to_le_bytes());
            put_u32(out, run.id.session);
            out.extend_from_slice(run.settings.as_bytes());
        })?;
        self.names.begin(run.id);
        Ok(())
    }

    fn back_to(&mut self, out: &mut Vec<u8>, run: RunId) -> Result<(), EntryError> {
        let number = self.names.run_number(run);
        let number =
            number.ok_or_else(|| EntryError { expected: "a run that has begun", found: format!("{run:?}") })?;
        put_entry(out, Kind::BackTo, |out| put_u32(out, number as u32))?;
        self.names.go_back_to(run);
        Ok(())
    }

    fn scan(&mut self, out: &mut Vec<u8>, scan: &ScanPose<M::Pose>) -> Result<(), EntryError> {
        let number = self.next_scan;
        unless("fewer than 2^32 scans", number < u64::from(u32::MAX), || number.to_string())?;
        let keyframe = scan.keyframe.map_or(Ok(NONE), |id| self.place(id))?;
        put_entry(out, Kind::Scan, |out| {
            put_u32(out, number as u32);
            out.extend_from_slice(&scan.stamp.0.to_le_bytes());
            put_u32(out, keyframe);
            put_pose(out, scan.keyframe_from_robot);
            put_pose(out, scan.odom_from_robot);
        })?;
        self.next_scan += 1;
        Ok(())
    }

    fn keyframe(
        &mut self,
        out: &mut Vec<u8>,
        keyframe: &Keyframe<M>,
        map_from_keyframe: M::Pose,
    ) -> Result<(), EntryError> {
        let id = keyframe.id;
        let follows = self.names.next().is_some_and(|next| next.run() == id.run() && next.seq <= id.seq);
        unless("a keyframe that follows in the present run", follows, || format!("{id:?}"))?;
        let [run, seq] = self.name(id)?;
        let sensor = self.sensor(out, keyframe.sweep.sensor())?;
        put_entry(out, Kind::Keyframe, |out| {
            [self.keyframes, run, seq].into_iter().for_each(|number| put_u32(out, number));
            out.extend_from_slice(&keyframe.stamp.0.to_le_bytes());
            out.extend_from_slice(&keyframe.scan.to_le_bytes());
            out.push(u8::from(keyframe.hardly_fits));
            put_pose(out, map_from_keyframe);
            put_u32(out, sensor);
            keyframe.sweep.put(out);
        })?;
        self.names.push(id.seq);
        self.keyframes += 1;
        self.next_scan = self.next_scan.max(keyframe.scan);
        Ok(())
    }

    /// The number of a sensor, which is written if it is new.
    fn sensor(&mut self, out: &mut Vec<u8>, sensor: &Arc<M::Sensor>) -> Result<u32, EntryError> {
        if let Some(place) = self.sensors.place(sensor) {
            return Ok(place as u32);
        }
        let number = self.sensors.0.len() as u32;
        put_entry(out, Kind::Sensor, |out| {
            put_u32(out, number);
            M::put_sensor(sensor, out);
        })?;
        self.sensors.0.push(Arc::clone(sensor));
        Ok(number)
    }

    fn fragment(&self, out: &mut Vec<u8>, fragment: Fragment) -> Result<(), EntryError> {
        let first = self.place(fragment.first)?;
        put_entry(out, Kind::Fragment, |out| {
            put_u32(out, first);
            out.push(fragment.start.code());
        })
    }

    fn edge(&mut self, out: &mut Vec<u8>, recorded: &RecordedEdge<M::Pose>) -> Result<(), EntryError> {
        let edge = &recorded.edge;
        let ends = [self.place(edge.from)?, self.place(edge.to)?];
        recorded.candidate.map_or(Ok(()), |number| self.is_candidate(number))?;
        put_entry(out, Kind::Edge, |out| {
            put_u32(out, self.edges);
            ends.into_iter().for_each(|end| put_u32(out, end));
            out.push(edge.kind.code());
            put_u32(out, recorded.candidate.unwrap_or(NONE));
            put_pose(out, edge.from_from_to);
            put_matrix::<M::Pose>(out, &edge.information);
        })?;
        self.edges += 1;
        Ok(())
    }

    fn candidate(&mut self, out: &mut Vec<u8>, candidate: &Candidate<M::Pose>) -> Result<(), EntryError> {
        let (from, to) = (self.place(candidate.from)?, self.name(candidate.to)?);
        put_entry(out, Kind::Candidate, |out| {
            put_u32(out, self.candidates);
            put_u32(out, from);
            to.into_iter().for_each(|number| put_u32(out, number));
            out.push(candidate.detection.code());
            put_verdict(out, candidate.verdict);
            put_evidence(out, &candidate.evidence, candidate.from_from_to.is_some());
            candidate.from_from_to.into_iter().for_each(|pose| put_pose(out, pose));
            put_matrix::<M::Pose>(out, &candidate.covariance);
        })?;
        self.candidates += 1;
        Ok(())
    }

    fn verdict(&self, out: &mut Vec<u8>, number: u32, verdict: Verdict, agreeing: u32) -> Result<(), EntryError> {
        self.is_candidate(number)?;
        put_entry(out, Kind::Verdict, |out| {
            put_u32(out, number);
            put_verdict(out, verdict);
            put_u32(out, agreeing);
        })
    }

    fn left_out(&self, out: &mut Vec<u8>, left_out: &LeftOut) -> Result<(), EntryError> {
        let keyframe = self.place(left_out.keyframe)?;
        put_entry(out, Kind::LeftOut, |out| {
            put_u32(out, keyframe);
            out.push(left_out.reason.code());
            out.push(u8::from(left_out.beams == Beams::All));
            if let Beams::These(beams) = &left_out.beams {
                beams.iter().for_each(|beam| put_u32(out, *beam));
            }
        })
    }

    fn wheel_slip(&self, out: &mut Vec<u8>, slip: &WheelSlip) -> Result<(), EntryError> {
        let from = self.name(slip.from)?;
        put_entry(out, Kind::WheelSlip, |out| {
            out.extend_from_slice(&slip.scan.to_le_bytes());
            from.into_iter().for_each(|number| put_u32(out, number));
            put_f64(out, slip.metres);
        })
    }

    fn keep_back(&mut self, snapshot: &Snapshot<M::Pose>) -> Result<(), EntryError> {
        let place = |&(id, pose)| Ok((self.place(id)?, pose));
        let moved = snapshot.map_from_keyframe.iter().map(place).collect::<Result<Vec<_>, _>>()?;
        let nothing = || KeptBack { number: 0, map_from_keyframe: Vec::new(), moved: 0 };
        let kept_back = self.kept_back.get_or_insert_with(nothing);
        kept_back.number = snapshot.number;
        kept_back.map_from_keyframe.resize(self.keyframes as usize, None);
        for (keyframe, map_from_keyframe) in moved {
            if let Some(pose) = kept_back.map_from_keyframe.get_mut(keyframe as usize) {
                kept_back.moved += usize::from(pose.replace(map_from_keyframe).is_none());
            }
        }
        Ok(())
    }

    fn write_snapshot_if(
        &mut self,
        out: &mut Vec<u8>,
        is_due: impl FnOnce(&Self, usize) -> bool,
    ) -> Result<(), EntryError> {
        let Some(kept_back) = &self.kept_back else { return Ok(()) };
        let bytes = snapshot_bytes::<M>(kept_back.moved);
        if !is_due(self, bytes) {
            return Ok(());
        }
        put_entry(out, Kind::Snapshot, |out| {
            put_u32(out, kept_back.number);
            let moved = kept_back.map_from_keyframe.iter().zip(0..);
            for (pose, keyframe) in moved.filter_map(|(pose, keyframe)| Some(((*pose)?, keyframe))) {
                put_u32(out, keyframe);
                put_pose(out, pose);
            }
        })?;
        self.kept_back = None;
        self.since_snapshot_bytes = 0;
        Ok(())
    }

    fn place(&self, id: KeyframeId) -> Result<u32, EntryError> {
        let place = self.names.place(id).map(|place| place as u32);
        place.ok_or_else(|| EntryError { expected: "a keyframe of the log", found: format!("{id:?}") })
    }

    /// The name of a keyframe that may be about to come: the number of its run, and its place in the run's order.
    fn name(&self, id: KeyframeId) -> Result<[u32; 2], EntryError> {
        let run = self.names.run_number(id.run()).map(|run| [run as u32, id.seq]);
        run.ok_or_else(|| EntryError { expected: "a keyframe of a run of the log", found: format!("{id:?}") })
    }

    fn is_edge(&self, number: u32) -> Result<(), EntryError> {
        unless("the number of an edge", number < self.edges, || format!("{number} of {}", self.edges))
    }

    fn is_candidate(&self, number: u32) -> Result<(), EntryError> {
        unless("the number of a candidate", number < self.candidates, || format!("{number} of {}", self.candidates))
    }
}

fn snapshot_bytes<M: Measurement>(poses: usize) -> usize {
    ENTRY_HEADER_BYTES + 4 + poses * (4 + 8 * M::Pose::NUMBERS) + CHECKSUM_BYTES
}

/// A whole entry around its payload; nothing where it would be too long.
fn put_entry(out: &mut Vec<u8>, kind: Kind, payload: impl FnOnce(&mut Vec<u8>)) -> Result<(), EntryError> {
    let start = out.len();
    out.extend_from_slice(&[kind.code(), ENTRY_VERSION, 0, 0, 0, 0]);
    payload(out);
    let length = out.len() - start - ENTRY_HEADER_BYTES;
    let Ok(length) = u32::try_from(length) else {
        out.truncate(start);
        return Err(EntryError { expected: "an entry of less than 4 GiB", found: format!("{length} bytes") });
    };
    out[start + 2..start + ENTRY_HEADER_BYTES].copy_from_slice(&length.to_le_bytes());
    let checksum = crc32fast::hash(&out[start..]);
    put_u32(out, checksum);
    Ok(())
}

/// A bit for each number that there is, the last but one for a pose that follows; then these numbers.
fn put_evidence(out: &mut Vec<u8>, evidence: &Evidence, has_pose: bool) {
    let Evidence { points, score, ambiguity, overlap, inlier_share, contradiction, cycle_chi2, agreeing } = *evidence;
    put_u32(out, points);
    put_u32(out, agreeing);
    let numbers = [score, ambiguity, overlap, inlier_share, contradiction, cycle_chi2];
    let bits = numbers.iter().map(Option::is_some).chain([has_pose]);
    out.push(bits.enumerate().fold(0, |mask, (bit, is_there)| mask | u8::from(is_there) << bit));
    numbers.into_iter().flatten().for_each(|number| put_f64(out, number));
}

impl<M: Measurement> Session<M> {
    /// The session as one complete log, which [reads](super::read_log) back as the same session, to the bit.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let mut whole = Whole { session: self, writer: LogWriter::new(), out: Vec::new(), runs: 0, scans: 0 };
        whole.all();
        whole.writer.finish(&mut whole.out);
        whole.out
    }
}

/// A session on its way into one log.
struct Whole<'a, M: Measurement> {
    session: &'a Session<M>,
    writer: LogWriter<M>,
    out: Vec<u8>,
    /// Written so far.
    runs: usize,
    scans: usize,
}

impl<M: Measurement> Whole<'_, M> {
    fn all(&mut self) {
        let session = self.session;
        for (place, (keyframe, pose)) in session.keyframes().iter().zip(session.map_from_keyframe()).enumerate() {
            self.runs_from(place);
            self.go_back_to(Some(keyframe.id.run()));
            self.scans_before(keyframe.scan);
            self.put(&Entry::Keyframe { keyframe: Arc::clone(keyframe), map_from_keyframe: *pose });
        }
        self.runs_from(session.keyframes().len());
        self.go_back_to(session.present_run());
        self.scans_before(u64::MAX);
        session.fragments().iter().for_each(|fragment| self.put(&Entry::Fragment(*fragment)));
        session.candidates().iter().for_each(|candidate| self.put(&Entry::Candidate(*candidate)));
        session.recorded_edges().iter().for_each(|edge| self.put(&Entry::Edge(edge.recorded)));
        let edges = session.recorded_edges().iter().zip(0..);
        edges.filter(|(edge, _)| edge.withdrawn).for_each(|(_, number)| self.put(&Entry::Withdrawn { number }));
        session.left_out().iter().for_each(|left_out| self.put(&Entry::LeftOut(left_out.clone())));
        session.slips().iter().for_each(|slip| self.put(&Entry::WheelSlip(*slip)));
        session.results_taken_in().iter().for_each(|&scan| self.put(&Entry::ResultTakenIn { scan }));
        session.odometry_origins().iter().for_each(|origin| self.put(&Entry::OdometryOrigin(*origin)));
        session.gravity().iter().for_each(|gravity| self.put(&Entry::Gravity(*gravity)));
        let snapshot = Snapshot { number: session.corrections(), map_from_keyframe: Vec::new() };
        self.put(&Entry::Snapshot(snapshot));
        let checkpoint = session.checkpoint().cloned();
        checkpoint.into_iter().for_each(|checkpoint| self.put(&Entry::Checkpoint(checkpoint)));
    }

    /// What is in a session fits, and only what takes 4 GiB alone cannot be written.
    fn put(&mut self, entry: &Entry<M>) {
        let _ = self.writer.append(&mut self.out, entry);
    }

    /// The runs whose first keyframe stands here, or would.
    fn runs_from(&mut self, place: usize) {
        let session = self.session;
        while session.names().first_of_run(self.runs).is_some_and(|first| first <= place) {
            session.runs().nth(self.runs).into_iter().for_each(|run| self.put(&Entry::Run(run.clone())));
            self.runs += 1;
        }
    }

    /// What comes next is of this run.
    fn go_back_to(&mut self, run: Option<RunId>) {
        let other = run.filter(|run| self.writer.names.present() != Some(*run));
        other.into_iter().for_each(|run| self.put(&Entry::BackTo(run)));
    }

    /// Scans that were there before a keyframe of this one; so they hang on keyframes before it.
    fn scans_before(&mut self, number: u64) {
        let session = self.session;
        while let Some(scan) = session.scans().get(self.scans) {
            let its_number = session.scan_numbers().number(self.scans);
            if its_number >= number {
                return;
            }
            self.writer.next_scan = its_number;
            self.put(&Entry::Scan(*scan));
            self.scans += 1;
        }
    }
}
