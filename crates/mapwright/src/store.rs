//! What lasts: the session, and beside it what the stages need of it: dense numbers, poses in the front end's frame and the
//! length of the way. Only the mapper writes to it, entry by entry.

use crate::patches::Spacing;
use mapwright_geom::{Pose, Stamp, TangentMatrix};
use mapwright_graph::{Edge as GraphEdge, Gravity as GraphGravity, PoseGraph, Vertex};
use mapwright_loops::{Judged, RUN_WAY_M, run_of};
use mapwright_record::{
    Beams, Candidate, Edge, EdgeKind, Entry, EntryError, Fragment, FragmentStart, Gravity, Keyframe, KeyframeId,
    LeftOut, LeftOutReason, Measurement, NodeId, OdometryOrigin, Past, RecordedEdge, Run, RunId, ScanPose, Session,
    SessionEdge, Snapshot, Verdict, WheelSlip, is_sound,
};
use mapwright_sensor::{DownEstimate, Sweep};
use std::sync::Arc;

mod adopt;
mod checkpoint;
mod import;
mod new;
mod said;

pub(crate) use adopt::Adopted;
pub(crate) use import::Import;
pub(crate) use new::{Link, NewKeyframe, Slipped, Written};
pub(crate) use said::Beside;

/// What lies between two keyframes that no measurement joins, or a break, counts as so much way, metres.
const FARTHEST_WAY_M: f64 = 1000.0;

/// A session as it grows.
#[derive(Debug, Clone)]
pub(crate) struct Store<M: Measurement = Sweep> {
    session: Session<M>,
    /// Poses in the front end's frame, in which the newest keyframe never jumps.
    local_from_keyframe: Vec<M::Pose>,
    /// Moves when the past is corrected.
    map_from_local: M::Pose,
    way_m: Vec<f64>,
    /// The first scan of the run, and whether its odometry has told where it has its origin.
    first_scan: u64,
    has_origin: bool,
    /// Why the next keyframe begins a fragment, if it does.
    start: Option<FragmentStart>,
    /// The first keyframes, that corrections do not move.
    fixed: usize,
    /// What other robots say of the way to each beside what they saw, where that is known.
    beside: Vec<Option<Beside<<M::Pose as Pose>::Matrix>>>,
    /// Entries that nobody was told of yet.
    fresh: Vec<Entry<M>>,
    /// Why others could not be written.
    unwritten: Vec<EntryError>,
}

impl<M: Measurement> Store<M> {
    pub(crate) fn new(run: RunId, settings: String) -> Self {
        Self::resume(Session::default(), run, settings)
    }

    /// A store that goes on with a session as a new run.
    pub(crate) fn resume(session: Session<M>, run: RunId, settings: String) -> Self {
        let mut store = Self {
            local_from_keyframe: session.map_from_keyframe().to_vec(),
            map_from_local: M::Pose::identity(),
            way_m: way_m(&session),
            first_scan: session.next_scan(),
            has_origin: false,
            start: Some(if session.keyframes().is_empty() {
                FragmentStart::SwitchedOn
            } else {
                FragmentStart::Resumed
            }),
            fixed: 0,
            beside: Vec::new(),
            fresh: Vec::new(),
            unwritten: Vec::new(),
            session,
        };
        store.write(Entry::Run(Run { id: run, settings }));
        store
    }

    /// A run of this robot begins, which may be anywhere; the present one, where it has not seen anything yet.
    pub(crate) fn switch_on(&mut self, robot: RunId, settings: String) {
        let is_fresh = self.next_scan() == self.first_scan;
        if !is_fresh || self.session.runs().last().is_none_or(|run| run.id.robot != robot.robot) {
            self.begin_run(self.session.next_run_of(robot), settings);
        }
        self.wait_for_scans();
    }

    /// The next scan may be anywhere.
    pub(crate) fn wait_for_scans(&mut self) {
        self.start = Some(FragmentStart::SwitchedOn);
    }

    fn begin_run(&mut self, run: RunId, settings: String) {
        (self.first_scan, self.has_origin) = (self.next_scan(), false);
        self.write(Entry::Run(Run { id: run, settings }));
    }

    /// Why the next scan that sees something begins a fragment whatever is known of the robot, if it does: it was switched on.
    pub(crate) fn is_switched_on(&self) -> Option<FragmentStart> {
        self.start.filter(|start| *start == FragmentStart::SwitchedOn && self.len() > 0)
    }

    /// What is there by now is not moved by corrections any more.
    pub(crate) fn fix(&mut self) {
        self.fixed = self.len();
    }

    /// Whether there are keyframes that corrections do not move.
    pub(crate) fn has_finished_map(&self) -> bool {
        self.fixed > 0
    }

    /// Whether all is where it stays.
    pub(crate) fn is_fixed(&self) -> bool {
        self.fixed == self.len()
    }

    /// The one place where a session grows.
    fn write(&mut self, entry: Entry<M>) -> bool {
        match self.session.add(entry.clone()) {
            Ok(()) => self.fresh.push(entry),
            Err(why) => {
                self.unwritten.push(why);
                return false;
            }
        }
        true
    }

    /// What was written since the last time, and why what could not be was not.
    pub(crate) fn take_fresh(&mut self) -> (Vec<Entry<M>>, Vec<EntryError>) {
        (std::mem::take(&mut self.fresh), std::mem::take(&mut self.unwritten))
    }

    pub(crate) fn session(&self) -> &Session<M> {
        &self.session
    }

    pub(crate) fn past(&self) -> Past<'_, M> {
        Past {
            session: &self.session,
            drawn: self.session.drawn(),
            local_from_keyframe: &self.local_from_keyframe,
            way_m: &self.way_m,
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.local_from_keyframe.len()
    }

    pub(crate) fn map_from_local(&self) -> M::Pose {
        self.map_from_local
    }

    pub(crate) fn id(&self, node: NodeId) -> KeyframeId {
        let known = self.session.keyframes().get(node.index()).map(|keyframe| keyframe.id);
        // Of those that are not there only the next one is ever named.
        known.or_else(|| self.session.next_id()).unwrap_or(RunId::default().keyframe(node.number()))
    }

    pub(crate) fn node(&self, id: KeyframeId) -> Option<NodeId> {
        self.session.place(id).map(NodeId::at)
    }

    /// Number of the scan that comes next.
    pub(crate) fn next_scan(&self) -> u64 {
        self.session.next_scan()
    }

    /// The robot's own odometry is this far on while that of the run is there: where it has its origin is taken down once.
    pub(crate) fn see_odometry(&mut self, own_from_robot: M::Pose, odom_from_robot: M::Pose) {
        if self.has_origin {
            return;
        }
        self.has_origin = true;
        let odom_from_start = own_from_robot * odom_from_robot.inverse();
        // A heading beyond all reason cannot be brought to within half a turn.
        if is_sound(odom_from_start) {
            self.write(Entry::OdometryOrigin(OdometryOrigin { from_scan: self.first_scan, odom_from_start }));
        }
    }

    /// A scan, where it hangs on the newest keyframe.
    pub(crate) fn add_scan(&mut self, stamp: Stamp, local_from_robot: M::Pose, odom_from_robot: M::Pose) {
        let keyframe_from_robot =
            self.local_from_keyframe.last().map_or(local_from_robot, |newest| newest.between(local_from_robot));
        let keyframe = self.past().newest().map(|node| self.id(node));
        self.write(Entry::Scan(ScanPose { stamp, keyframe, keyframe_from_robot, odom_from_robot }));
    }

    /// A keyframe with its edges: of odometry with the motion model's information, of the match with the scan's; never both
    /// in one. `links` says whether a match with a keyframe is an edge already. None where no session can hold it.
    pub(crate) fn add_keyframe(
        &mut self,
        new: &NewKeyframe<M>,
        link: Link,
        links: impl Fn(Past<'_, M>, NodeId) -> bool,
    ) -> Option<Written<M::Pose>> {
        let node = self.add_alone(new)?;
        let over_break = if let Link::Break(start) = link { Some(start) } else { None };
        if let Some(start) = self.start.take().or(over_break) {
            self.write(Entry::Fragment(Fragment { first: self.id(node), start }));
        }
        let Some(last) = node.before() else {
            self.way_m.push(0.0);
            return Some(Written { node, links: Vec::new(), spacing: Spacing::default(), unjudged: None });
        };
        let mut unjudged = None;
        let mut edges = vec![self.edge(last, node, EdgeKind::Odometry, information_of(&new.odometry))];
        let mut known = vec![(last, if over_break.is_some() { new.odometry } else { new.fused })];
        let step = self.local_from_keyframe[last.index()].between(new.local_from_keyframe);
        let step_m = match over_break {
            Some(FragmentStart::SwitchedOn) => next_run_m(&self.way_m) - self.way_m[last.index()],
            Some(_) => FARTHEST_WAY_M,
            None => step.length(),
        };
        if let Some((anchor, information)) = new.matched.filter(|&(anchor, _)| anchor < node) {
            let edge = self.edge(anchor, node, EdgeKind::Match, information);
            if links(self.past(), anchor) {
                edges.push(edge)
            } else {
                unjudged = Some(edge)
            }
            if known.iter().all(|&(from, _)| from != anchor) {
                known.push((anchor, new.covariance));
            }
        }
        self.way_m.push(self.way_m[last.index()] + step_m);
        edges.into_iter().for_each(|edge| self.add_edge(edge, None));
        let spacing = spacing(self.session.keyframes(), node.index(), step_m);
        Some(Written { node, links: known, spacing, unjudged })
    }

    fn add_alone(&mut self, new: &NewKeyframe<M>) -> Option<NodeId> {
        let node = NodeId::at(self.len());
        let keyframe = Arc::new(Keyframe {
            id: self.id(node),
            stamp: new.stamp,
            scan: self.next_scan(),
            sweep: Arc::clone(&new.sweep),
            hardly_fits: new.hardly_fits,
        });
        let map_from_keyframe = self.map_from_local * new.local_from_keyframe;
        if !self.write(Entry::Keyframe { keyframe, map_from_keyframe }) {
            return None;
        }
        self.local_from_keyframe.push(new.local_from_keyframe);
        if let Some((beams, reason)) = &new.left_out {
            self.leave_out(node, beams.clone(), *reason);
        }
        Some(node)
    }

    /// Beams of a keyframe are not drawn from now on.
    pub(crate) fn leave_out(&mut self, node: NodeId, beams: Beams, reason: LeftOutReason) {
        self.write(Entry::LeftOut(LeftOut { keyframe: self.id(node), beams, reason }));
    }

    fn edge(&self, from: NodeId, to: NodeId, kind: EdgeKind, information: <M::Pose as Pose>::Matrix) -> Edge<M::Pose> {
        let from_from_to = self.local_from_keyframe[from.index()].between(self.local_from_keyframe[to.index()]);
        Edge { from: self.id(from), to: self.id(to), kind, from_from_to, information }
    }

    pub(crate) fn add_edge(&mut self, edge: Edge<M::Pose>, candidate: Option<u32>) {
        self.write(Entry::Edge(RecordedEdge { edge, candidate }));
    }

    /// Where down is at a keyframe.
    pub(crate) fn add_gravity(&mut self, node: NodeId, down: &DownEstimate) {
        let DownEstimate { down_in_robot, sigma_rad } = *down;
        self.write(Entry::Gravity(Gravity {
            keyframe: self.id(node),
            down_in_keyframe: down_in_robot.into(),
            sigma_rad,
        }));
    }

    /// Takes a candidate down and returns its number; none where no session can hold it.
    pub(crate) fn add_candidate(&mut self, judged: &Judged<M::Pose>) -> Option<u32> {
        let Judged { from, to, detection, evidence, verdict, from_from_to, covariance } = *judged;
        let (from, to) = (self.id(from), self.id(to));
        let number = self.session.candidates().len() as u32;
        let candidate = Candidate { from, to, detection, evidence, verdict, from_from_to, covariance };
        self.write(Entry::Candidate(candidate)).then_some(number)
    }

    /// A candidate is a closure: the edge that it makes, if it says where it leads and how surely.
    pub(crate) fn accept(&mut self, number: u32) -> Option<Edge<M::Pose>> {
        let candidate = *self.session.candidates().get(number as usize)?;
        if candidate.verdict != Verdict::Accepted {
            let agreeing = candidate.evidence.agreeing;
            self.write(Entry::Verdict { number, verdict: Verdict::Accepted, agreeing });
        }
        let Candidate { from, to, from_from_to, covariance, .. } = candidate;
        let (from_from_to, information) = from_from_to.zip(covariance.inverted())?;
        let edge = Edge { from, to, kind: EdgeKind::Closure, from_from_to, information };
        self.add_edge(edge, Some(number));
        Some(edge)
    }

    /// An edge says nothing any more, and what it was made of is none; its ends.
    pub(crate) fn withdraw(&mut self, number: usize, verdict: Verdict) -> Option<[NodeId; 2]> {
        let edge = *self.session.recorded_edges().get(number)?;
        self.write(Entry::Withdrawn { number: number as u32 });
        if let Some(number) = edge.recorded.candidate {
            let agreeing = self.session.candidates()[number as usize].evidence.agreeing;
            self.write(Entry::Verdict { number, verdict, agreeing });
        }
        Some(edge.ends.map(NodeId::new))
    }

    /// The edge of odometry that leads to a keyframe, if it stands.
    pub(crate) fn odometry_to(&self, node: NodeId) -> Option<usize> {
        self.session.recorded_edges().iter().position(|known| {
            known.ends[1] == node.number() && known.recorded.edge.kind == EdgeKind::Odometry && !known.withdrawn
        })
    }

    /// Whether a verified closure leads to one of the keyframes from `node` on.
    pub(crate) fn is_closed_since(&self, node: NodeId) -> bool {
        let closes =
            |edge: &&Edge<M::Pose>| edge.kind == EdgeKind::Closure && self.node(edge.to).is_some_and(|to| to >= node);
        self.session.edges().rev().any(|edge| closes(&edge))
    }

    /// The graph to be solved: every edge once, in the order they were found, and gravity. Those that were withdrawn say nothing. The
    /// first keyframe stays; where gravity levels the map, with its position and heading.
    pub(crate) fn graph(&self) -> PoseGraph<M::Pose> {
        let poses = self.session.map_from_keyframe().iter().enumerate();
        let gravity: Vec<GraphGravity> =
            self.session.gravity().iter().filter_map(|known| self.graph_gravity(known)).collect();
        let stays = gravity.is_empty();
        let vertex = |(k, &world_from_vertex): (usize, &M::Pose)| Vertex {
            id: k as u64,
            world_from_vertex,
            fixed: k == 0 && stays || k < self.fixed,
        };
        let edges = self.session.recorded_edges().iter().map(|known| {
            let [from, to] = known.ends.map(|end| end as usize);
            let Edge { from_from_to, information, kind, .. } = known.recorded.edge;
            let information = match kind {
                _ if known.withdrawn => TangentMatrix::zero(),
                EdgeKind::Closure => self.as_borne_out(from, self.as_borne_out(to, information)),
                EdgeKind::Odometry | EdgeKind::Match => self.as_borne_out(to, information),
            };
            GraphEdge { from, to, from_from_to, information }
        });
        PoseGraph { vertices: poses.map(vertex).collect(), edges: edges.collect(), gravity, ..PoseGraph::default() }
    }

    fn graph_gravity(&self, known: &Gravity) -> Option<GraphGravity> {
        let vertex = self.session.place(known.keyframe)?;
        Some(GraphGravity { vertex, down_in_vertex: known.down_in_keyframe.into(), sigma_rad: known.sigma_rad })
    }

    /// Numbers of the edges that were made of candidates and stand.
    pub(crate) fn closures(&self) -> Vec<usize> {
        let edges = self.session.recorded_edges().iter().enumerate();
        edges.filter(|(_, edge)| edge.recorded.candidate.is_some() && !edge.withdrawn).map(|(at, _)| at).collect()
    }

    /// The matches that stand: numbers and ends.
    pub(crate) fn matches(&self) -> Vec<(usize, [NodeId; 2])> {
        let edges = self.session.recorded_edges().iter().enumerate();
        let stands = |known: &SessionEdge<M::Pose>| known.recorded.edge.kind == EdgeKind::Match && !known.withdrawn;
        edges.filter(|(_, known)| stands(known)).map(|(at, known)| (at, known.ends.map(NodeId::new))).collect()
    }

    /// Moves the past to where a solution has it, which may be older than the newest keyframes: they are carried along, and its
    /// newest stays where it is in the front end's frame. The poses before, in that frame; none where the solution is of no use.
    pub(crate) fn correct(&mut self, map_from_keyframe: &[M::Pose]) -> Option<Vec<M::Pose>> {
        let last = map_from_keyframe.len().checked_sub(1)?;
        if !map_from_keyframe.iter().all(|pose| pose.is_within_bounds()) {
            return None;
        }
        let before = self.local_from_keyframe.clone();
        self.map_from_local = map_from_keyframe[last] * self.local_from_keyframe[last].inverse();
        let local_from_map = self.map_from_local.inverse();
        for (local, &map) in self.local_from_keyframe.iter_mut().zip(map_from_keyframe) {
            *local = local_from_map * map;
        }
        self.take_snapshot();
        Some(before)
    }

    fn take_snapshot(&mut self) {
        let Self { session, local_from_keyframe, map_from_local, .. } = self;
        let poses = local_from_keyframe.iter().map(|&local| *map_from_local * local).skip(self.fixed);
        let known = session.keyframes().iter().zip(session.map_from_keyframe()).skip(self.fixed);
        let moved = known.zip(poses);
        let moved = moved.filter(|((_, was), is)| *was != is).map(|((keyframe, _), is)| (keyframe.id, is));
        let (number, moved): (u32, Vec<_>) = (session.corrections() + 1, moved.collect());
        if moved.is_empty() {
            return;
        }
        self.write(Entry::Snapshot(Snapshot { number, map_from_keyframe: moved }));
    }

    /// What follows is of a job's result, that came between two scans.
    pub(crate) fn add_result_taken_in(&mut self) {
        self.write(Entry::ResultTakenIn { scan: self.next_scan() });
    }

    /// The wheels have slipped: keyframes from one on are moved, edges across say what they say now, the wheels' not much, and
    /// matches of the last keyframes before with old places nothing, for they may have been led astray by it. The poses before.
    pub(crate) fn shift(
        &mut self,
        slipped: &Slipped<M::Pose>,
        doubted: impl Fn(Past<'_, M>, NodeId, NodeId) -> bool,
    ) -> Vec<M::Pose> {
        let Slipped { from, metres, .. } = *slipped;
        let before = self.local_from_keyframe.clone();
        for pose in &mut self.local_from_keyframe[from.index()..] {
            *pose = slipped.new_from_old * *pose;
        }
        self.write(Entry::WheelSlip(WheelSlip { scan: self.next_scan(), from: self.id(from), metres }));
        for number in 0..self.session.recorded_edges().len() {
            self.remeasure(number, slipped, &doubted);
        }
        self.take_snapshot();
        before
    }

    fn remeasure(
        &mut self,
        number: usize,
        slipped: &Slipped<M::Pose>,
        doubted: impl Fn(Past<'_, M>, NodeId, NodeId) -> bool,
    ) {
        let known = self.session.recorded_edges()[number];
        let ([from, to], Edge { kind, information, .. }) = (known.ends.map(NodeId::new), known.recorded.edge);
        if known.withdrawn || kind == EdgeKind::Closure {
            return;
        }
        let number = number as u32;
        if kind == EdgeKind::Match && doubted(self.past(), from, to) {
            self.write(Entry::Withdrawn { number });
        } else if from < slipped.from && to >= slipped.from {
            let [a, b] = [from, to].map(|node| self.local_from_keyframe[node.index()]);
            let information = if from.next() == to { slipped.weakened(information) } else { information };
            self.write(Entry::Remeasured { number, from_from_to: a.between(b), information });
        }
    }
}

/// Length of the way up to each keyframe, as the edges along it say.
pub(crate) fn way_m<M: Measurement>(session: &Session<M>) -> Vec<f64> {
    let mut steps_m = vec![FARTHEST_WAY_M; session.keyframes().len()];
    for known in session.recorded_edges().iter().filter(|known| known.recorded.edge.kind == EdgeKind::Odometry) {
        steps_m[known.ends[1] as usize] = known.recorded.edge.from_from_to.length();
    }
    let mut begins_run = vec![false; steps_m.len()];
    for fragment in session.fragments() {
        let Some(first) = session.place(fragment.first) else { continue };
        steps_m[first] = FARTHEST_WAY_M;
        begins_run[first] = fragment.start == FragmentStart::SwitchedOn;
    }
    let mut way_m: Vec<f64> = Vec::with_capacity(steps_m.len());
    for (place, (step_m, begins_run)) in steps_m.into_iter().zip(begins_run).enumerate() {
        let before_m = session.before(place).and_then(|before| way_m.get(before).copied());
        way_m.push(match before_m {
            None => 0.0,
            Some(_) if begins_run => next_run_m(&way_m),
            Some(before_m) => before_m + step_m,
        });
    }
    way_m
}

/// Where the way of a run begins that comes after all these.
fn next_run_m(way_m: &[f64]) -> f64 {
    let runs = way_m.iter().map(|&way_m| run_of(way_m)).max().map_or(0, |last| last + 1);
    runs as f64 * RUN_WAY_M
}

fn information_of<C: TangentMatrix>(covariance: &C) -> C {
    covariance.inverted().unwrap_or_else(C::zero)
}

/// How far apart keyframes and scans are before a keyframe that is a step on from the last one.
pub(crate) fn spacing<M>(keyframes: &[Arc<Keyframe<M>>], node: usize, step_m: f64) -> Spacing {
    let scan = |node: usize| keyframes.get(node).map_or(0, |keyframe| keyframe.scan);
    let is_break = step_m >= FARTHEST_WAY_M;
    let scans = if is_break { 1 } else { scan(node).saturating_sub(scan(node.saturating_sub(1))).max(1) };
    Spacing { keyframe_m: step_m, scan_m: step_m / scans as f64 }
}
