//! All entries of a log, taken together.

use crate::closure::{Candidate, Verdict};
use crate::entry::{Entry, Fragment, RecordedEdge, Run, ScanPose, Snapshot, WheelSlip};
use crate::keyframe::{Edge, Keyframe, KeyframeId, Measurement};
use crate::left_out::{Beams, LeftOut};
use mapwright_geom::{Pose, Stamp};
use mapwright_sensor::Sweep;
use std::sync::Arc;

/// Everything that maps, trajectories and graphs of a run are functions of: what all entries of its log amount to.
///
/// It grows by [`Session::add`] alone, from the updates of a mapper or from a file. Everything in it refers to what is in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Session<M: Measurement = Sweep> {
    runs: Vec<(Run, u32)>,
    scans: Vec<ScanPose<M::Pose>>,
    keyframes: Vec<Arc<Keyframe<M>>>,
    map_from_keyframe: Vec<M::Pose>,
    drawn: Vec<Option<Arc<M>>>,
    fragments: Vec<Fragment>,
    edges: Vec<SessionEdge<M::Pose>>,
    candidates: Vec<Candidate<M::Pose>>,
    left_out: Vec<LeftOut>,
    slips: Vec<WheelSlip>,
    corrections: u32,
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
    /// Pose of the robot by odometry alone; never jumps.
    pub odom_from_robot: P,
}

/// Why an entry cannot be added.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("expected {expected}, found {found}")]
pub struct EntryError {
    /// What the entry should say.
    pub expected: &'static str,
    /// What it says.
    pub found: String,
}

fn unless(expected: &'static str, holds: bool, found: impl FnOnce() -> String) -> Result<(), EntryError> {
    if holds { Ok(()) } else { Err(EntryError { expected, found: found() }) }
}

impl<M: Measurement> Default for Session<M> {
    fn default() -> Self {
        Self {
            runs: Vec::new(),
            scans: Vec::new(),
            keyframes: Vec::new(),
            map_from_keyframe: Vec::new(),
            drawn: Vec::new(),
            fragments: Vec::new(),
            edges: Vec::new(),
            candidates: Vec::new(),
            left_out: Vec::new(),
            slips: Vec::new(),
            corrections: 0,
        }
    }
}

impl<M: Measurement> Session<M> {
    /// Takes an entry in; one that does not fit changes nothing.
    ///
    /// # Errors
    /// It names what is not there, or what is there already.
    pub fn add(&mut self, entry: Entry<M>) -> Result<(), EntryError> {
        match entry {
            Entry::Run(run) => self.begin(run),
            Entry::Scan(scan) => self.add_scan(scan),
            Entry::Keyframe { keyframe, map_from_keyframe } => self.add_keyframe(keyframe, map_from_keyframe),
            Entry::Fragment(fragment) => self.add_fragment(fragment),
            Entry::Edge(edge) => self.add_edge(edge),
            Entry::Remeasured { number, from_from_to, information } => {
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
            Entry::WheelSlip(slip) => {
                self.slips.push(slip);
                Ok(())
            }
            Entry::Snapshot(snapshot) => self.correct(&snapshot),
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
        let known = self.runs.iter().any(|(known, _)| known.id == run.id);
        unless("a run that has not begun yet", !known, || format!("{:?} again", run.id))?;
        self.runs.push((run, self.keyframes.len() as u32));
        Ok(())
    }

    fn add_scan(&mut self, scan: ScanPose<M::Pose>) -> Result<(), EntryError> {
        scan.keyframe.map_or(Ok(0), |id| self.place_or_error(id))?;
        self.scans.push(scan);
        Ok(())
    }

    fn add_keyframe(
        &mut self,
        keyframe: Arc<Keyframe<M>>,
        map_from_keyframe: M::Pose,
    ) -> Result<(), EntryError> {
        let next = self.next_id().ok_or_else(|| EntryError {
            expected: "a run before the first keyframe",
            found: format!("{:?}", keyframe.id),
        })?;
        unless("the next keyframe of the run", keyframe.id == next, || format!("{:?}, not {next:?}", keyframe.id))?;
        let scans = self.scans.len() as u64;
        unless("the number of a scan, at most the next one's", keyframe.scan <= scans, || keyframe.scan.to_string())?;
        unless("a pose within 10^6 m", map_from_keyframe.is_within_bounds(), || format!("{map_from_keyframe:?}"))?;
        self.drawn.push(Some(Arc::clone(&keyframe.sweep)));
        self.keyframes.push(keyframe);
        self.map_from_keyframe.push(map_from_keyframe);
        Ok(())
    }

    fn add_fragment(&mut self, fragment: Fragment) -> Result<(), EntryError> {
        self.place_or_error(fragment.first)?;
        self.fragments.push(fragment);
        Ok(())
    }

    fn add_edge(&mut self, recorded: RecordedEdge<M::Pose>) -> Result<(), EntryError> {
        let Edge { from, to, .. } = recorded.edge;
        let ends = [self.place_or_error(from)?, self.place_or_error(to)?];
        unless("two different keyframes", ends[0] != ends[1], || format!("{from:?} twice"))?;
        recorded.candidate.map_or(Ok(()), |number| self.candidate_exists(number))?;
        self.edges.push(SessionEdge { recorded, ends: ends.map(|end| end as u32), withdrawn: false });
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
        if self.next_id() != Some(candidate.to) {
            self.place_or_error(candidate.to)?;
        }
        self.candidates.push(candidate);
        Ok(())
    }

    fn candidate_exists(&self, number: u32) -> Result<(), EntryError> {
        let candidates = self.candidates.len();
        let exists = (number as usize) < candidates;
        unless("the number of a candidate", exists, || format!("{number} of {candidates}"))
    }

    fn change_verdict(&mut self, number: u32, verdict: Verdict, agreeing: u32) -> Result<(), EntryError> {
        self.candidate_exists(number)?;
        let candidate = &mut self.candidates[number as usize];
        (candidate.verdict, candidate.evidence.agreeing) = (verdict, agreeing);
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
            unless("a pose within 10^6 m", pose.is_within_bounds(), || format!("{pose:?}"))?;
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
        let (run, first) = self.runs.last()?;
        Some(run.id.keyframe(self.keyframes.len() as u32 - first))
    }

    /// The place of a keyframe among [`Session::keyframes`].
    #[must_use]
    pub fn place(&self, id: KeyframeId) -> Option<usize> {
        let (_, first) = self.runs.iter().rev().find(|(run, _)| run.id == id.run())?;
        let place = *first as usize + id.seq as usize;
        self.keyframes.get(place).filter(|keyframe| keyframe.id == id).map(|_| place)
    }

    fn place_or_error(&self, id: KeyframeId) -> Result<usize, EntryError> {
        self.place(id).ok_or_else(|| EntryError { expected: "a keyframe of the session", found: format!("{id:?}") })
    }

    /// The runs that it consists of.
    pub fn runs(&self) -> impl ExactSizeIterator<Item = &Run> {
        self.runs.iter().map(|(run, _)| run)
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

    /// How often the poses were corrected.
    #[must_use]
    pub fn corrections(&self) -> u32 {
        self.corrections
    }

    /// Where the robot was at every scan, in arrival order, with every correction made since.
    pub fn trajectory(&self) -> impl ExactSizeIterator<Item = TrajectoryPose<M::Pose>> + '_ {
        self.scans.iter().map(|scan| {
            let map_from_keyframe = scan.keyframe.and_then(|id| self.place(id)).map(|k| self.map_from_keyframe[k]);
            let ScanPose { stamp, keyframe_from_robot, odom_from_robot, .. } = *scan;
            let map_from_robot = map_from_keyframe.map_or(keyframe_from_robot, |pose| pose * keyframe_from_robot);
            TrajectoryPose { stamp, map_from_robot, odom_from_robot }
        })
    }
}
