//! Another session, keyframe by keyframe with what belongs to each, in the order in which it was mapped.

use super::{FARTHEST_WAY_M, Store, information_of, next_run_m};
use mapwright_geom::Pose;
use mapwright_record::{
    Candidate, Edge, EdgeKind, Entry, Fragment, FragmentStart, Keyframe, KeyframeId, LeftOut, Measurement, NodeId,
    OdometryOrigin, RecordedEdge, RunId, ScanPose, Session, WheelSlip,
};
use mapwright_sensor::Sweep;
use std::sync::Arc;

/// A session that is taken in.
pub(crate) struct Import<'a, M: Measurement = Sweep> {
    other: &'a Session<M>,
    local_from_other: M::Pose,
    /// Place of its first keyframe here, and the number of its first scan.
    first: usize,
    first_scan: u64,
    /// How many of its scans and keyframes are here.
    scans: usize,
    keyframes: usize,
    /// What the run of its newest keyframe is called there.
    run: Option<RunId>,
    /// What its candidates are called here.
    candidates: Vec<Option<u32>>,
    /// By the place of the keyframe that they come with.
    edges_with: Vec<Vec<usize>>,
    candidates_with: Vec<Vec<usize>>,
}

/// A keyframe that was taken in.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Imported {
    /// Number of the first edge that came with it.
    pub(crate) first_edge: usize,
    /// Whether a fragment begins with it.
    pub(crate) is_first: bool,
    /// Whether it may join fragments of its own session.
    pub(crate) is_closed: bool,
}

impl<'a, M: Measurement> Import<'a, M> {
    /// A session that lies here in the front end's frame.
    pub(crate) fn new(store: &Store<M>, other: &'a Session<M>, local_from_other: M::Pose) -> Self {
        let count = other.keyframes().len();
        let (mut edges_with, mut candidates_with) = (vec![Vec::new(); count], vec![Vec::new(); count]);
        for (number, known) in other.recorded_edges().iter().enumerate() {
            let [from, to] = known.ends;
            edges_with[from.max(to) as usize].push(number);
        }
        for (number, candidate) in other.candidates().iter().enumerate() {
            let ends = other.place(candidate.from).zip(other.place(candidate.to));
            if let Some((from, to)) = ends {
                candidates_with[from.max(to)].push(number);
            }
        }
        Self {
            other,
            local_from_other,
            first: store.len(),
            first_scan: store.next_scan(),
            scans: 0,
            keyframes: 0,
            run: None,
            candidates: vec![None; other.candidates().len()],
            edges_with,
            candidates_with,
        }
    }

    /// The keyframe that comes next, if one is left.
    pub(crate) fn next(&self) -> Option<&'a Arc<Keyframe<M>>> {
        self.other.keyframes().get(self.keyframes)
    }

    /// Writes the next keyframe, after the scans before it, with all that leads to it; `apart` is the covariance of the link of its
    /// first keyframe. None where no keyframe is left or no session can hold it.
    pub(crate) fn write_next(&mut self, store: &mut Store<M>, apart: &<M::Pose as Pose>::Matrix) -> Option<Imported> {
        let keyframe = self.next()?;
        let place = self.keyframes;
        self.begin_run(store, keyframe.id.run());
        self.write_scans(store, keyframe.scan);
        let node = NodeId::at(store.len());
        let local_from_keyframe = self.local_from_other * self.other.map_from_keyframe()[place];
        let (id, scan, sweep) = (store.id(node), store.next_scan(), Arc::clone(&keyframe.sweep));
        let imported = Keyframe { id, stamp: keyframe.stamp, scan, sweep, hardly_fits: keyframe.hardly_fits };
        let map_from_keyframe = store.map_from_local * local_from_keyframe;
        if !store.write(Entry::Keyframe { keyframe: Arc::new(imported), map_from_keyframe }) {
            return None;
        }
        store.local_from_keyframe.push(local_from_keyframe);
        self.keyframes += 1;
        self.write_left_out(store, keyframe.id, id);
        let is_first = self.write_fragments(store, keyframe.id, id);
        let first_edge = store.session.recorded_edges().len();
        self.write_links(store, node, apart);
        let edges = &store.session.recorded_edges()[first_edge..];
        let of_kind = |kind| edges.iter().map(|known| known.recorded.edge).find(move |edge| edge.kind == kind);
        let step_m = of_kind(EdgeKind::Odometry).filter(|_| !is_first).map(|edge| edge.from_from_to.length());
        let is_closed = of_kind(EdgeKind::Closure).is_some();
        let before_m = store.way_m.last().copied();
        store.way_m.push(match before_m {
            None => 0.0,
            Some(_) if place == 0 => next_run_m(&store.way_m),
            Some(before_m) => before_m + step_m.unwrap_or(FARTHEST_WAY_M),
        });
        Some(Imported { first_edge, is_first, is_closed })
    }

    /// Writes the scans after the last keyframe.
    pub(crate) fn write_rest(&mut self, store: &mut Store<M>) {
        self.write_scans(store, u64::MAX);
    }

    fn begin_run(&mut self, store: &mut Store<M>, run: RunId) {
        if self.run == Some(run) {
            return;
        }
        let settings = self.other.runs().find(|known| known.id == run).map(|known| known.settings.clone());
        let is_taken = store.session.runs().any(|known| known.id == run);
        let name = if is_taken { store.session.next_run_of(run) } else { run };
        store.begin_run(name, settings.unwrap_or_default());
        store.start = None;
        self.run = Some(run);
    }

    /// The scans with lower numbers than this one.
    fn write_scans(&mut self, store: &mut Store<M>, end: u64) {
        let scans = self.other.scans();
        let until = self.other.scan_place(end).unwrap_or(scans.len()).max(self.scans);
        for place in self.scans..until {
            self.write_origins(store, place);
            let ScanPose { stamp, keyframe, keyframe_from_robot, odom_from_robot } = scans[place];
            let keyframe = keyframe.and_then(|id| self.id(store, id));
            let map_from_other = store.map_from_local * self.local_from_other;
            let keyframe_from_robot =
                if keyframe.is_some() { keyframe_from_robot } else { map_from_other * keyframe_from_robot };
            store.write(Entry::Scan(ScanPose { stamp, keyframe, keyframe_from_robot, odom_from_robot }));
        }
        self.scans = until;
    }

    fn write_origins(&self, store: &mut Store<M>, place: usize) {
        let origins = self.other.odometry_origins().iter();
        for origin in origins.filter(|origin| self.other.scan_place(origin.from_scan) == Some(place)) {
            let from_scan = self.first_scan + place as u64;
            store.write(Entry::OdometryOrigin(OdometryOrigin { from_scan, ..*origin }));
        }
    }

    fn write_left_out(&self, store: &mut Store<M>, there: KeyframeId, keyframe: KeyframeId) {
        for known in self.other.left_out().iter().filter(|known| known.keyframe == there) {
            let (beams, reason) = (known.beams.clone(), known.reason);
            store.write(Entry::LeftOut(LeftOut { keyframe, beams, reason }));
        }
        for slip in self.other.slips().iter().filter(|slip| slip.from == there) {
            let scan = self.first_scan + self.other.scan_place(slip.scan).unwrap_or(self.scans) as u64;
            store.write(Entry::WheelSlip(WheelSlip { scan, from: keyframe, ..*slip }));
        }
    }

    /// Whether a fragment begins that nothing holds to what was there before.
    fn write_fragments(&self, store: &mut Store<M>, there: KeyframeId, first: KeyframeId) -> bool {
        if self.keyframes == 1 {
            store.write(Entry::Fragment(Fragment { first, start: FragmentStart::SwitchedOn }));
            return true;
        }
        let mut is_break = false;
        for fragment in self.other.fragments().iter().filter(|fragment| fragment.first == there) {
            is_break |= self.other.is_break(fragment);
            store.write(Entry::Fragment(Fragment { first, start: fragment.start }));
        }
        is_break
    }

    /// Candidates and edges that lead to the keyframe written last.
    fn write_links(&mut self, store: &mut Store<M>, node: NodeId, apart: &<M::Pose as Pose>::Matrix) {
        let place = self.keyframes - 1;
        for number in std::mem::take(&mut self.candidates_with[place]) {
            let candidate = &self.other.candidates()[number];
            let Some((from, to)) = self.id(store, candidate.from).zip(self.id(store, candidate.to)) else { continue };
            let known = store.session.candidates().len() as u32;
            let is_written = store.write(Entry::Candidate(Candidate { from, to, ..*candidate }));
            self.candidates[number] = is_written.then_some(known);
        }
        if let Some(last) = node.before().filter(|_| place == 0) {
            let edge = store.edge(last, node, EdgeKind::Odometry, information_of(apart));
            store.add_edge(edge, None);
        }
        for number in std::mem::take(&mut self.edges_with[place]) {
            let known = &self.other.recorded_edges()[number];
            let (edge, candidate) = (known.recorded.edge, known.recorded.candidate);
            let Some((from, to)) = self.id(store, edge.from).zip(self.id(store, edge.to)) else { continue };
            let candidate = candidate.and_then(|number| *self.candidates.get(number as usize)?);
            let number = store.session.recorded_edges().len() as u32;
            let is_written = store.write(Entry::Edge(RecordedEdge { edge: Edge { from, to, ..edge }, candidate }));
            if is_written && known.withdrawn {
                store.write(Entry::Withdrawn { number });
            }
        }
    }

    /// What a keyframe that was taken in is called here.
    fn id(&self, store: &Store<M>, there: KeyframeId) -> Option<KeyframeId> {
        let place = self.other.place(there).filter(|place| *place < self.keyframes)?;
        Some(store.id(NodeId::at(self.first + place)))
    }
}
