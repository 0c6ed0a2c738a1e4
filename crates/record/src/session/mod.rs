//! All entries of a log, taken together.

use crate::closure::{Candidate, Verdict};
use crate::entry::{
    Checkpoint, Entry, Fragment, Gravity, OdometryOrigin, RecordedEdge, Run, ScanPose, Snapshot, WheelSlip,
};
use crate::error::{EntryError, unless};
use crate::id::{KeyframeId, RunId};
use crate::keyframe::{Edge, Keyframe, Measurement};
use crate::left_out::{Beams, LeftOut};
use crate::names::Names;
use crate::numbers::Numbers;
use crate::pose::is_sound;
use mapwright_geom::{Pose, Stamp, TangentMatrix};
use mapwright_sensor::Sweep;
use spells::Spell;
use std::sync::Arc;

mod pieces;
mod spells;

pub use pieces::{OdometryLink, Piece, SeparateMap};

/// Everything that maps, trajectories and graphs of a run are functions of: what all entries of its log amount to.
///
/// It grows by [`Session::add`] alone, from the updates of a mapper or from a file. Everything in it refers to what is in it.
/// Where a damaged log has lost scans or keyframes, the numbers of scans
/// and the `seq` of keyframes have gaps; [`Session::scan_place`] and [`Session::place`] know them.
#[derive(Debug, Clone, PartialEq)]
pub struct Session<M: Measurement = Sweep> {
    runs: Vec<Run>,
    names: Names,
    scan_numbers: Numbers,
    scans: Vec<ScanPose<M::Pose>>,
    keyframes: Vec<Arc<Keyframe<M>>>,
    map_from_keyframe: Vec<M::Pose>,
    drawn: Vec<Option<Arc<M>>>,
    fragments: Vec<Fragment>,
    edges: Vec<SessionEdge<M::Pose>>,
    /// Of each keyframe the newest edge that leads to it, and of each edge the one before that leads to the same.
    newest_edge_to: Vec<Option<u32>>,
    earlier_edge: Vec<Option<u32>>,
    candidates: Vec<Candidate<M::Pose>>,
    left_out: Vec<LeftOut>,
    slips: Vec<WheelSlip>,
    results_taken_in: Vec<u64>,
    odometry_origins: Vec<OdometryOrigin<M::Pose>>,
    gravity: Vec<Gravity>,
    corrections: u32,
    checkpoint: Option<Checkpoint>,
}

/// An edge of a session.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SessionEdge<P: Pose> {
    /// What it says, and what it was made of.
    pub recorded: RecordedEdge<P>,
    /// Places of its ends among the keyframes.
    pub ends: [u32; 2],
    /// It says nothing any more.
    pub withdrawn: bool,
}

/// A pose of a trajectory.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrajectoryPose<P: Pose = mapwright_geom::Pose2> {
    /// The scan's stamp.
    pub stamp: Stamp,
    /// Pose of the robot in the map, with every correction.
    pub map_from_robot: P,
    /// Pose of the robot by odometry alone, in the frame of the robot's own odometry where it has one; never jumps.
    pub odom_from_robot: P,
}

fn sound<P: Pose>(pose: P) -> Result<(), EntryError> {
    unless("a sound pose within 10^6 m", is_sound(pose), || format!("{pose:?}"))
}

/// What an edge says.
fn measured<P: Pose>(from_from_to: P, information: &P::Matrix) -> Result<(), EntryError> {
    sound(from_from_to)?;
    unless("a finite information", information.is_finite(), || format!("{information:?}"))
}

impl<M: Measurement> Default for Session<M> {
    fn default() -> Self {
        Self {
            runs: Vec::new(),
            names: Names::default(),
            scan_numbers: Numbers::default(),
            scans: Vec::new(),
            keyframes: Vec::new(),
            map_from_keyframe: Vec::new(),
            drawn: Vec::new(),
            fragments: Vec::new(),
            edges: Vec::new(),
            newest_edge_to: Vec::new(),
            earlier_edge: Vec::new(),
            candidates: Vec::new(),
            left_out: Vec::new(),
            slips: Vec::new(),
            results_taken_in: Vec::new(),
            odometry_origins: Vec::new(),
            gravity: Vec::new(),
            corrections: 0,
            checkpoint: None,
        }
    }
}

impl<M: Measurement> Session<M> {
    /// Takes an entry in; one that does not fit changes nothing.
    ///
    /// # Errors
    /// It names what is not there or is there already, or a pose or measurement that is not sound.
    pub fn add(&mut self, entry: Entry<M>) -> Result<(), EntryError> {
        match entry {
            Entry::Run(run) => self.begin(run),
            Entry::BackTo(run) => self.go_back_to(run),
            Entry::Scan(scan) => self.add_scan(self.scan_numbers.next(), scan),
            Entry::Keyframe { keyframe, map_from_keyframe } => {
                self.is_next(&keyframe)?;
                self.add_keyframe(keyframe, map_from_keyframe)
            }
            Entry::Fragment(fragment) => self.add_fragment(fragment),
            Entry::Edge(edge) => self.add_edge(edge),
            Entry::Remeasured { number, from_from_to, information } => {
                measured::<M::Pose>(from_from_to, &information)?;
                let edge = &mut self.edge_mut(number)?.recorded.edge;
                (edge.from_from_to, edge.information) = (from_from_to, information);
                Ok(())
            }
            Entry::Withdrawn { number } => {
                self.edge_mut(number)?.withdrawn = true;
                Ok(())
            }
            Entry::Candidate(candidate) => self.add_candidate(candidate),
            Entry::Verdict { number, verdict, agreeing } => self.change_verdict(number, verdict, agreeing),
            Entry::LeftOut(left_out) => self.leave_out(left_out),
            Entry::WheelSlip(slip) => self.add_slip(slip),
            Entry::ResultTakenIn { scan } => {
                self.results_taken_in.push(scan);
                Ok(())
            }
            Entry::OdometryOrigin(origin) => self.add_origin(origin),
            Entry::Gravity(gravity) => self.add_gravity(gravity),
            Entry::Snapshot(snapshot) => self.correct(&snapshot),
            Entry::Checkpoint(checkpoint) => {
                self.checkpoint = Some(checkpoint);
                Ok(())
            }
        }
    }

    /// Takes all entries in.
    ///
    /// # Errors
    /// The first that does not fit; those after it are left out.
    pub fn add_all(&mut self, entries: impl IntoIterator<Item = Entry<M>>) -> Result<(), EntryError> {
        entries.into_iter().try_for_each(|entry| self.add(entry))
    }

    fn begin(&mut self, run: Run) -> Result<(), EntryError> {
        unless("a run that has not begun yet", self.names.begin(run.id), || format!("{:?} again", run.id))?;
        self.runs.push(run);
        self.checkpoint = None;
        Ok(())
    }

    fn go_back_to(&mut self, run: RunId) -> Result<(), EntryError> {
        unless("a run that has begun", self.names.go_back_to(run), || format!("{run:?}"))
    }

    /// Adds a scan with the next number, or with a later one where a log has lost some.
    pub(crate) fn add_scan(&mut self, number: u64, scan: ScanPose<M::Pose>) -> Result<(), EntryError> {
        let next = self.scan_numbers.next();
        unless("the number of the next scan", number >= next, || format!("{number}, not {next}"))?;
        scan.keyframe.map_or(Ok(0), |id| self.place_or_error(id))?;
        [scan.keyframe_from_robot, scan.odom_from_robot].into_iter().try_for_each(sound)?;
        self.scan_numbers.leap_to(number);
        self.scan_numbers.push();
        self.scans.push(scan);
        self.checkpoint = None;
        Ok(())
    }

    fn is_next(&self, keyframe: &Keyframe<M>) -> Result<(), EntryError> {
        let (next, id) = (self.next_id(), keyframe.id);
        unless("the next keyframe of a run that has begun", next == Some(id), || format!("{id:?}, not {next:?}"))?;
        let scans = self.scan_numbers.next();
        unless("the number of a scan, at most the next one's", keyframe.scan <= scans, || keyframe.scan.to_string())
    }

    /// Adds the next keyframe, or a later one of the present run where a log has lost some.
    pub(crate) fn add_keyframe(
        &mut self,
        keyframe: Arc<Keyframe<M>>,
        map_from_keyframe: M::Pose,
    ) -> Result<(), EntryError> {
        let (next, id) = (self.next_id(), keyframe.id);
        let follows = next.is_some_and(|next| next.run() == id.run() && next.seq <= id.seq);
        unless("a keyframe that follows in the present run", follows, || format!("{id:?}, not {next:?}"))?;
        let scan = keyframe.scan;
        unless("the number of a scan, 32 bits", scan <= u64::from(u32::MAX), || scan.to_string())?;
        sound(map_from_keyframe)?;
        keyframe.sweep.check()?;
        self.scan_numbers.leap_to(scan);
        self.names.push(id.seq);
        self.drawn.push(Some(Arc::clone(&keyframe.sweep)));
        self.keyframes.push(keyframe);
        self.newest_edge_to.push(None);
        self.map_from_keyframe.push(map_from_keyframe);
        self.checkpoint = None;
        Ok(())
    }

    fn add_fragment(&mut self, fragment: Fragment) -> Result<(), EntryError> {
        self.place_or_error(fragment.first)?;
        self.fragments.push(fragment);
        Ok(())
    }

    fn add_edge(&mut self, recorded: RecordedEdge<M::Pose>) -> Result<(), EntryError> {
        let Edge { from, to, from_from_to, information, .. } = recorded.edge;
        let ends = [self.place_or_error(from)?, self.place_or_error(to)?];
        unless("two different keyframes", ends[0] != ends[1], || format!("{from:?} twice"))?;
        recorded.candidate.map_or(Ok(()), |number| self.candidate_exists(number))?;
        measured::<M::Pose>(from_from_to, &information)?;
        let number = self.edges.len() as u32;
        self.edges.push(SessionEdge { recorded, ends: ends.map(|end| end as u32), withdrawn: false });
        self.earlier_edge.push(self.newest_edge_to[ends[1]].replace(number));
        Ok(())
    }

    fn edge_mut(&mut self, number: u32) -> Result<&mut SessionEdge<M::Pose>, EntryError> {
        let edges = self.edges.len();
        let edge = self.edges.get_mut(number as usize);
        edge.ok_or_else(|| EntryError { expected: "the number of an edge", found: format!("{number} of {edges}") })
    }

    /// A candidate may lead to the keyframe that comes next: there the robot was looked for and is about to be.
    fn add_candidate(&mut self, candidate: Candidate<M::Pose>) -> Result<(), EntryError> {
        self.place_or_error(candidate.from)?;
        self.is_or_was_next(candidate.to)?;
        candidate.from_from_to.map_or(Ok(()), sound)?;
        self.candidates.push(candidate);
        Ok(())
    }

    fn add_slip(&mut self, slip: WheelSlip) -> Result<(), EntryError> {
        self.is_or_was_next(slip.from)?;
        self.slips.push(slip);
        Ok(())
    }

    fn add_origin(&mut self, origin: OdometryOrigin<M::Pose>) -> Result<(), EntryError> {
        sound(origin.odom_from_start)?;
        let last = self.odometry_origins.last().map(|last| last.from_scan);
        unless("a scan after that of the last origin", last < Some(origin.from_scan), || origin.from_scan.to_string())?;
        self.odometry_origins.push(origin);
        Ok(())
    }

    fn add_gravity(&mut self, gravity: Gravity) -> Result<(), EntryError> {
        let Gravity { keyframe, down_in_keyframe: [x, y, z], sigma_rad } = gravity;
        self.place_or_error(keyframe)?;
        let is_direction = ((x * x + y * y + z * z).sqrt() - 1.0).abs() <= 1e-6;
        unless("a direction of length one", is_direction, || format!("{x} {y} {z}"))?;
        let is_deviation = (1e-6..=std::f64::consts::PI).contains(&sigma_rad);
        unless("a deviation of 10^-6 to pi rad", is_deviation, || sigma_rad.to_string())?;
        self.gravity.push(gravity);
        Ok(())
    }

    fn is_or_was_next(&self, id: KeyframeId) -> Result<(), EntryError> {
        unless("a keyframe of the session or the next", self.names.is_or_was_next(id), || format!("{id:?}"))
    }

    fn candidate_exists(&self, number: u32) -> Result<(), EntryError> {
        let candidates = self.candidates.len();
        let exists = (number as usize) < candidates;
        unless("the number of a candidate", exists, || format!("{number} of {candidates}"))
    }

    fn change_verdict(&mut self, number: u32, verdict: Verdict, agreeing: u32) -> Result<(), EntryError> {
        self.candidate_exists(number)?;
        if let Some(candidate) = self.candidates.get_mut(number as usize) {
            (candidate.verdict, candidate.evidence.agreeing) = (verdict, agreeing);
        }
        Ok(())
    }

    fn leave_out(&mut self, left_out: LeftOut) -> Result<(), EntryError> {
        let place = self.place_or_error(left_out.keyframe)?;
        self.drawn[place] = match (&left_out.beams, &self.drawn[place]) {
            (Beams::All, _) | (_, None) => None,
            (beams, Some(drawn)) => Some(Arc::new(drawn.without(beams))),
        };
        self.left_out.push(left_out);
        Ok(())
    }

    fn correct(&mut self, snapshot: &Snapshot<M::Pose>) -> Result<(), EntryError> {
        for &(id, pose) in &snapshot.map_from_keyframe {
            self.place_or_error(id)?;
            sound(pose)?;
        }
        for &(id, pose) in &snapshot.map_from_keyframe {
            if let Some(place) = self.place(id) {
                self.map_from_keyframe[place] = pose;
            }
        }
        self.corrections = snapshot.number;
        Ok(())
    }

    /// The name of the keyframe that comes next; none before the first run.
    #[must_use]
    pub fn next_id(&self) -> Option<KeyframeId> {
        self.names.next()
    }

    /// The place of a keyframe among [`Session::keyframes`].
    #[must_use]
    pub fn place(&self, id: KeyframeId) -> Option<usize> {
        self.names.place(id)
    }

    /// The run of the keyframe that comes next; none before the first.
    #[must_use]
    pub fn present_run(&self) -> Option<RunId> {
        self.names.present()
    }

    /// The place of the keyframe that stands before the one at this place on the robot's way: keyframes of robots that drive at the same time
    /// may stand between them.
    #[must_use]
    pub fn before(&self, place: usize) -> Option<usize> {
        self.names.before(place)
    }

    /// The place of the keyframe that follows on the robot's way, if there is one yet.
    #[must_use]
    pub fn after(&self, place: usize) -> Option<usize> {
        self.names.after(place)
    }

    /// The place among [`Session::scans`] of the scan with this number, as [`Keyframe::scan`] gives it.
    #[must_use]
    pub fn scan_place(&self, number: u64) -> Option<usize> {
        self.scan_numbers.place(number)
    }

    /// The number of the scan that comes next.
    #[must_use]
    pub fn next_scan(&self) -> u64 {
        self.scan_numbers.next()
    }

    /// Whether any keyframe of another session is here as well, by what it shows and when.
    #[must_use]
    pub fn shares_keyframes(&self, other: &Self) -> bool {
        let mut by_stamp: Vec<&Arc<Keyframe<M>>> = self.keyframes.iter().collect();
        by_stamp.sort_by_key(|known| known.stamp);
        other.keyframes.iter().any(|keyframe| {
            let from = by_stamp.partition_point(|known| known.stamp < keyframe.stamp);
            let same = by_stamp[from..].iter().take_while(|known| known.stamp == keyframe.stamp);
            same.into_iter().any(|known| known.sweep == keyframe.sweep)
        })
    }

    pub(crate) fn names(&self) -> &Names {
        &self.names
    }

    pub(crate) fn scan_numbers(&self) -> &Numbers {
        &self.scan_numbers
    }

    fn place_or_error(&self, id: KeyframeId) -> Result<usize, EntryError> {
        self.place(id).ok_or_else(|| EntryError { expected: "a keyframe of the session", found: format!("{id:?}") })
    }

    /// The runs that it consists of.
    pub fn runs(&self) -> impl ExactSizeIterator<Item = &Run> {
        self.runs.iter()
    }

    /// The name of a run that goes on with it: of the robot that ended it, with the next number; none where there is no run.
    #[must_use]
    pub fn next_run(&self) -> Option<RunId> {
        Some(self.next_run_of(self.runs.last()?.id))
    }

    /// The name of another run of the robot that this one is of: with the next number that it has not had.
    #[must_use]
    pub fn next_run_of(&self, run: RunId) -> RunId {
        let of_robot = self.runs.iter().filter(|known| known.id.robot == run.robot);
        let sessions = of_robot.map(|known| known.id.session.saturating_add(1));
        RunId { session: sessions.max().unwrap_or(0), ..run }
    }

    /// Every scan in arrival order.
    #[must_use]
    pub fn scans(&self) -> &[ScanPose<M::Pose>] {
        &self.scans
    }

    /// Keyframes in the order they were made.
    #[must_use]
    pub fn keyframes(&self) -> &[Arc<Keyframe<M>>] {
        &self.keyframes
    }

    /// Pose of the robot in the map at each keyframe, with every correction.
    #[must_use]
    pub fn map_from_keyframe(&self) -> &[M::Pose] {
        &self.map_from_keyframe
    }

    /// Of each keyframe what maps are to draw; none where it is left out altogether.
    #[must_use]
    pub fn drawn(&self) -> &[Option<Arc<M>>] {
        &self.drawn
    }

    /// Where keyframes begin that tracking links without a break.
    #[must_use]
    pub fn fragments(&self) -> &[Fragment] {
        &self.fragments
    }

    /// All edges in the order they were found, those that were withdrawn among them.
    #[must_use]
    pub fn recorded_edges(&self) -> &[SessionEdge<M::Pose>] {
        &self.edges
    }

    /// The edges that lead to a keyframe, the newest first.
    pub fn edges_to(&self, place: usize) -> impl Iterator<Item = &SessionEdge<M::Pose>> {
        let newest = self.newest_edge_to.get(place).copied().flatten();
        let numbers = std::iter::successors(newest, |&number| self.earlier_edge[number as usize]);
        numbers.map(|number| &self.edges[number as usize])
    }

    /// The edges that stand, in the order they were found.
    pub fn edges(&self) -> impl DoubleEndedIterator<Item = &Edge<M::Pose>> {
        self.edges.iter().filter(|edge| !edge.withdrawn).map(|edge| &edge.recorded.edge)
    }

    /// Every place the robot may have come back to, in the order they were looked at.
    #[must_use]
    pub fn candidates(&self) -> &[Candidate<M::Pose>] {
        &self.candidates
    }

    /// What maps leave out, and why.
    #[must_use]
    pub fn left_out(&self) -> &[LeftOut] {
        &self.left_out
    }

    /// Slips of the wheels that were corrected.
    #[must_use]
    pub fn slips(&self) -> &[WheelSlip] {
        &self.slips
    }

    /// Before which scan each result of a job that was handed out was taken in, by the number of scans there were, in that order. Replayed with
    /// these the run comes to the same bytes.
    #[must_use]
    pub fn results_taken_in(&self) -> &[u64] {
        &self.results_taken_in
    }

    /// Where odometry has its origin, in the order of the scans that each holds for.
    #[must_use]
    pub fn odometry_origins(&self) -> &[OdometryOrigin<M::Pose>] {
        &self.odometry_origins
    }

    /// Where down is at keyframes that inertial readings have told it of, in the order they were made.
    #[must_use]
    pub fn gravity(&self) -> &[Gravity] {
        &self.gravity
    }

    /// How often the poses were corrected.
    #[must_use]
    pub fn corrections(&self) -> u32 {
        self.corrections
    }

    /// What the mapper knew that has made it; none once it goes on, or where some of the log before was lost.
    #[must_use]
    pub fn checkpoint(&self) -> Option<&Checkpoint> {
        self.checkpoint.as_ref()
    }

    /// Where the robot was at every scan, in arrival order, with every correction made since. Where it followed its odometry alone before a break,
    /// the way is bent so that it ends where the map has the robot after it.
    pub fn trajectory(&self) -> impl ExactSizeIterator<Item = TrajectoryPose<M::Pose>> + '_ {
        let mut origins = self.odometry_origins.iter().peekable();
        let mut odom_from_start = M::Pose::identity();
        let spells = self.spells();
        self.scans.iter().enumerate().map(move |(place, scan)| {
            let number = self.scan_numbers.number(place);
            while let Some(origin) = origins.next_if(|origin| origin.from_scan <= number) {
                odom_from_start = origin.odom_from_start;
            }
            let odom_from_robot = odom_from_start * scan.odom_from_robot;
            let map_from_robot = Spell::pose(&spells, place).unwrap_or_else(|| self.corrected(scan));
            TrajectoryPose { stamp: scan.stamp, map_from_robot, odom_from_robot }
        })
    }

    /// Where the robot was at a scan by the keyframe that its pose was found from.
    fn corrected(&self, scan: &ScanPose<M::Pose>) -> M::Pose {
        let map_from_keyframe = scan.keyframe.and_then(|id| self.place(id)).map(|k| self.map_from_keyframe[k]);
        map_from_keyframe.map_or(scan.keyframe_from_robot, |pose| pose * scan.keyframe_from_robot)
    }
}

#[cfg(test)]
mod tests;
