use super::*;
use crate::places::PlaceIndex;
use crate::plane::PlaneSubmaps;
use crate::solving::Solving;
use crate::space::SpaceSubmaps;
use crate::submaps::{ClosingPolicy, Window};
use crate::views::View;
use mapwright_geom::{Pose3, Stamp};
use mapwright_graph::{Edge as GraphEdge, PoseGraph, Vertex};
use mapwright_record::{Beams, EdgeKind, Entry, EntryError, Keyframe, RecordedEdge, Run, RunId, Session};
use std::f64::consts::PI;
use std::sync::Arc;

/// A reading that knows where it was taken.
#[derive(Debug, Clone, PartialEq)]
struct Reading<P: Pose> {
    world_from_robot: P,
    sensor: Arc<()>,
}

impl<P: Pose> Measurement for Reading<P> {
    type Pose = P;
    type Sensor = ();
    const CODE: u8 = 200;

    fn without(&self, _: &Beams) -> Self {
        self.clone()
    }

    fn check(&self) -> Result<(), EntryError> {
        Ok(())
    }

    fn sensor(&self) -> &Arc<()> {
        &self.sensor
    }

    fn put_sensor((): &(), _: &mut Vec<u8>) {}

    fn take_sensor(_: &[u8]) -> Result<(), EntryError> {
        Ok(())
    }

    fn put(&self, _: &mut Vec<u8>) {}

    fn take(sensor: &Arc<()>, _: &[u8]) -> Result<Self, EntryError> {
        Ok(Self { world_from_robot: P::identity(), sensor: Arc::clone(sensor) })
    }
}

/// Submaps that are found wherever they are in the window.
#[derive(Debug, Clone, Default)]
struct Signposts<P: Pose>(std::marker::PhantomData<P>);

impl<P: Pose> Submaps for Signposts<P> {
    type Measurement = Reading<P>;
    type Submap = P;
    type Places = PlaceIndex;

    const POLICY: ClosingPolicy = if P::TRANSLATION == 2 { PlaneSubmaps::POLICY } else { SpaceSubmaps::POLICY };

    fn draw(&self, views: &[View<Reading<P>>]) -> P {
        views[0].sweep.world_from_robot * views[0].submap_from_keyframe.inverse()
    }

    fn look_for(&mut self, query: &P, target: &P, window: &Window<P>) -> Finding<P> {
        let found = target.between(*query);
        let off = window.target_from_query.between(found);
        if off.length() > window.half_width_m || off.angle() > window.half_width_rad {
            return Finding::none(Evidence::default(), Objection::NoMatch);
        }
        finding(found, None)
    }

    fn fit_at(&mut self, query: &P, target: &P, _: P) -> Finding<P> {
        finding(target.between(*query), None)
    }

    fn scored(&self) -> u64 {
        1
    }

    fn remember(&self, _: &mut PlaceIndex, _: NodeId, _: &[View<Reading<P>>]) {}

    fn remembered(places: &PlaceIndex) -> &[NodeId] {
        places.nodes()
    }

    fn alike(
        &self,
        _: &mut PlaceIndex,
        _: &[View<Reading<P>>],
        _: usize,
        _: impl Fn(NodeId) -> bool,
    ) -> Vec<(NodeId, Window<P>)> {
        Vec::new()
    }
}

const BY_POSE: ClosingSettings = ClosingSettings { by_pose: true, by_place: true, keeps_everything_live: false };

/// Keyframes as they are written.
#[derive(Debug, Clone)]
struct Way<P: Pose> {
    session: Session<Reading<P>>,
    local_from_keyframe: Vec<P>,
    way_m: Vec<f64>,
}

impl<P: Pose> Way<P> {
    fn new() -> Self {
        let mut session = Session::default();
        session.add(Entry::Run(Run { id: RunId::of_robot("walker"), settings: String::new() })).unwrap();
        Self { session, local_from_keyframe: Vec::new(), way_m: Vec::new() }
    }

    /// A metre from each other, thirty out and the others back.
    fn there_and_back(count: usize) -> Self {
        let mut way = Self::new();
        way.go_on(count);
        way
    }

    /// So many keyframes farther.
    fn go_on(&mut self, further: usize) {
        for node in self.way_m.len()..self.way_m.len() + further {
            let (x, turn_rad) = if node < 30 { (node as f64, 0.0) } else { (60.0 - node as f64, PI) };
            let pose = P::identity().turned([0.0, 0.0, turn_rad]).moved([x, 0.0, 0.0]);
            self.add(pose, pose);
        }
    }

    fn add(&mut self, world_from_robot: P, local_from_keyframe: P) {
        let id = self.session.next_id().unwrap();
        let sweep = Arc::new(Reading { world_from_robot, sensor: Arc::new(()) });
        let keyframe = Arc::new(Keyframe { id, stamp: Stamp(0), scan: 0, sweep, hardly_fits: false });
        self.session.add(Entry::Keyframe { keyframe, map_from_keyframe: local_from_keyframe }).unwrap();
        let step_m = self.local_from_keyframe.last().map_or(0.0, |last| last.distance(local_from_keyframe));
        self.way_m.push(self.way_m.last().copied().unwrap_or(0.0) + step_m);
        self.local_from_keyframe.push(local_from_keyframe);
        if let Some(before) = self.newest().before() {
            let edge = self.edge(before, self.newest(), EdgeKind::Odometry);
            self.add_edge(edge, None);
        }
    }

    fn newest(&self) -> NodeId {
        self.past().newest().unwrap()
    }

    fn past(&self) -> Past<'_, Reading<P>> {
        let Self { session, local_from_keyframe, way_m } = self;
        Past { session, drawn: session.drawn(), local_from_keyframe, way_m }
    }

    fn edge(&self, from: NodeId, to: NodeId, kind: EdgeKind) -> Edge<P> {
        let from_from_to = self.past().pose(from).between(self.past().pose(to));
        let [from, to] = [from, to].map(|node| self.session.keyframes()[node.index()].id);
        Edge { from, to, kind, from_from_to, information: P::Matrix::from_variances(100.0, 100.0) }
    }

    fn add_edge(&mut self, edge: Edge<P>, candidate: Option<u32>) {
        self.session.add(Entry::Edge(RecordedEdge { edge, candidate })).unwrap();
    }

    /// A match of the newest keyframe with an old one, off by so much.
    fn match_with(&self, from: NodeId, off_m: f64) -> Edge<P> {
        let edge = self.edge(from, self.newest(), EdgeKind::Match);
        Edge { from_from_to: edge.from_from_to.moved([off_m, 0.0, 0.0]), ..edge }
    }

    /// Judges a finding at the newest keyframe and writes down what comes of it: the closures.
    fn judge(&mut self, closing: &mut Closing<Signposts<P>>, target: &Target<P>, finding: &Finding<P>) -> Vec<Edge<P>> {
        let to = self.newest();
        let judgement = closing.judge(self.past(), self.session.candidates(), to, (target, finding));
        let number = self.session.candidates().len() as u32;
        let Judged { from, to, detection, evidence, verdict, from_from_to, covariance } = judgement.judged;
        let [from, to] = [from, to].map(|node| self.session.keyframes()[node.index()].id);
        let candidate = Candidate { from, to, detection, evidence, verdict, from_from_to, covariance };
        self.session.add(Entry::Candidate(candidate)).unwrap();
        if verdict != Verdict::Accepted {
            return Vec::new();
        }
        let mut closures = Vec::new();
        for number in judgement.agreeing.into_iter().chain([number]) {
            let Candidate { from, to, from_from_to, covariance, .. } = self.session.candidates()[number as usize];
            let (from_from_to, information) = (from_from_to.unwrap(), covariance.inverted().unwrap());
            let edge = Edge { from, to, kind: EdgeKind::Closure, from_from_to, information };
            self.add_edge(edge, Some(number));
            closing.accepted(self.past(), self.past().nodes([from, to]).unwrap(), &edge);
            closures.push(edge);
        }
        closures
    }

    fn graph(&self) -> Solving<P> {
        let vertex = |(k, &world_from_vertex)| Vertex { id: k as u64, world_from_vertex, fixed: k == 0 };
        let edges = self.session.recorded_edges();
        let edge = |known: &mapwright_record::SessionEdge<P>| {
            let ([from, to], Edge { from_from_to, information, .. }) = (known.ends, known.recorded.edge);
            GraphEdge { from: from as usize, to: to as usize, from_from_to, information }
        };
        let closures = (0..edges.len()).filter(|&at| edges[at].recorded.candidate.is_some()).collect();
        let vertices = self.local_from_keyframe.iter().enumerate().map(vertex).collect();
        let edges = edges.iter().map(edge).collect();
        Solving::of::<Signposts<P>>(PoseGraph { vertices, edges, ..PoseGraph::default() }, closures)
    }
}

fn finding<P: Pose>(target_from_query: P, objection: Option<Objection>) -> Finding<P> {
    let covariance = P::Matrix::from_variances(1e-4, 1e-5);
    Finding { target_from_query: Some(target_from_query), covariance, evidence: Evidence::default(), objection }
}

/// A robot that climbs two rounds of a ramp (in the plane it goes round in circles) and drifts comes back, and is set right by
/// closures that closing asks for, judges and solves by itself.
fn comes_back<P: Pose>() {
    let (mut way, mut closing) = (Way::<P>::new(), Closing::<Signposts<P>>::new(BY_POSE));
    let drift = P::identity().turned([0.0, 0.0005, 0.001]).moved([0.002, 0.002, 0.001]);
    let truth = |k: u32| {
        let along_rad = f64::from(k) * 0.1;
        let [sine, cosine] = [along_rad.sin(), along_rad.cos()];
        let tilt = P::identity().turned([0.1 * sine, 0.0, 0.0]);
        tilt.turned([0.0, 0.0, along_rad]).moved([10.0 * cosine, 10.0 * sine, sine])
    };
    let (mut local, mut closed) = (truth(0), 0);
    for k in 0..126 {
        if k > 0 {
            local = local * truth(k - 1).between(truth(k)) * drift;
        }
        way.add(truth(k), local);
        if !closing.is_due(way.past()) {
            continue;
        }
        let [sigma_m, sigma_rad] = [0.01, 0.001].map(|a_step| a_step * f64::from(k));
        let uncertainty = Uncertainty { displacement_m2: sigma_m * sigma_m, rotation_rad2: sigma_rad * sigma_rad };
        let old = NodeId::first(k.saturating_sub(30) as usize);
        let known: Vec<KnownPlace<P>> = old.map(|first| KnownPlace::alike_in_all(first, false, uncertainty)).collect();
        let Some(verification) = closing.propose(way.past(), &known, None, Signposts::default()) else { continue };
        for (target, finding) in verification.run().findings {
            closed += way.judge(&mut closing, &target, &finding).len();
        }
    }
    assert!(closed > 20 && closing.take_solving_due(|| closed), "{closed} closures");
    let error_m = |poses: &[P]| {
        let aligned = truth(0) * poses[0].inverse();
        let off_m = poses.iter().zip(0..).map(|(&pose, k)| (aligned * pose).distance(truth(k)));
        off_m.fold(0.0, f64::max)
    };
    let before_m = error_m(&way.local_from_keyframe);
    let solved = way.graph().run().expect("it can be solved");
    let after_m = error_m(&solved.map_from_keyframe);
    assert!(
        solved.taken_back.is_empty() && before_m > 0.5 && after_m < 0.3 * before_m,
        "{before_m} m, then {after_m} m"
    );
}

#[test]
fn a_robot_that_comes_back_is_set_right_in_the_plane_and_in_space() {
    comes_back::<Pose2>();
    comes_back::<Pose3>();
}

/// How much way is looked for, seen from the newest keyframe, and in how much, from the old one, by a robot that hardly knows where it is.
fn ways_compared<P: Pose>() -> [f64; 2] {
    let (way, mut closing) = (Way::<P>::there_and_back(50), Closing::<Signposts<P>>::new(BY_POSE));
    let uncertainty = Uncertainty { displacement_m2: 1.0, rotation_rad2: 1e-4 };
    let known = [KnownPlace::alike_in_all(NodeId::new(10), false, uncertainty)];
    let verification = closing.propose(way.past(), &known, None, Signposts::default()).expect("it may be there");
    let reach_m =
        |views: &[View<Reading<P>>]| views.iter().map(|view| view.submap_from_keyframe.length()).fold(0.0, f64::max);
    [reach_m(&verification.query), reach_m(&verification.targets.as_slice()[0].1)]
}

#[test]
fn in_space_the_way_that_is_looked_for_is_half_as_long_as_the_one_it_is_looked_for_in() {
    assert_eq!([ways_compared::<Pose2>(), ways_compared::<Pose3>()], [[8.0, 8.0], [4.0, 8.0]]);
}

fn match_with_an_old_place<P: Pose>() {
    let [ten, eleven, twelve, just_now, newest] = [10, 11, 12, 45, 59].map(NodeId::new);
    for objection in [None, Some(Objection::Contradiction), Some(Objection::LittleOverlap)] {
        let (mut closing, mut way) = (Closing::<Signposts<P>>::new(BY_POSE), Way::<P>::there_and_back(60));
        let known = [KnownPlace::alike_in_all(NodeId::new(0), true, Uncertainty::default())];
        let past = way.past();
        assert!(
            closing.supporting(past, newest, just_now, &known).is_none() && closing.links(past, just_now),
            "passed just now"
        );
        assert!(closing.is_unjudged(past, ten) && !closing.links(past, ten), "nobody has looked");
        let (good, bad) = (way.match_with(eleven, 0.05), way.match_with(twelve, 0.3));
        closing.wait(past, good);
        let target = closing.supporting(past, newest, ten, &known).expect("it is old and was not looked at");
        assert_eq!((target.from, target.detection), (ten, Detection::Match));
        assert!(!closing.is_unjudged(past, ten) && !closing.links(past, ten), "nobody knows yet");
        assert!(closing.links(past, just_now));
        closing.wait(past, bad);
        assert!(closing.supporting(past, newest, twelve, &known).is_none(), "it was looked at just now");
        assert!(closing.settle_matches(past, &[]).is_empty(), "the verdict is not there");
        let closures = way.judge(&mut closing, &target, &finding(target.window.target_from_query, objection));
        let is_closure = objection.is_none();
        // What has waited links if the place was found where the match says.
        let settled = closing.settle_matches(way.past(), &closures);
        assert_eq!(settled, if is_closure { vec![good] } else { Vec::new() });
        settled.into_iter().for_each(|edge| way.add_edge(edge, None));
        let beside_odometry = way.session.edges().filter(|edge| edge.kind != EdgeKind::Odometry);
        assert_eq!(beside_odometry.count(), 2 * usize::from(is_closure));
        assert!(closing.settle_matches(way.past(), &closures).is_empty(), "once");
        if is_closure {
            let mut doubted = closing.clone();
            doubted.withdrawn(way.past(), [ten, newest]);
            assert!(!doubted.links(way.past(), ten), "later evidence speaks against it");
        }
        let links = [ten, twelve].map(|from| closing.links(way.past(), from));
        assert_eq!((closures.len(), links), (usize::from(is_closure), [is_closure; 2]));
        // Farther on it has to show again, and soon if it was not found: then what was seen before links too.
        for (further, asked) in [(5, !is_closure), (40, true)] {
            let (mut later, mut way) = (closing.clone(), way.clone());
            way.go_on(further);
            later.supports.forget(way.past().way_m);
            let target = later.supporting(way.past(), way.newest(), ten, &known);
            assert_eq!(target.is_some(), asked, "{further} m on");
            if let Some(target) = target {
                let closures = way.judge(&mut later, &target, &finding(target.window.target_from_query, None));
                let settled = later.settle_matches(way.past(), &closures);
                assert_eq!(settled, if further == 5 { vec![good] } else { Vec::new() });
            }
        }
    }
}

#[test]
fn a_match_that_an_old_place_supports_links_it_only_if_it_is_found_there() {
    match_with_an_old_place::<Pose2>();
    match_with_an_old_place::<Pose3>();
}

#[test]
fn matches_link_unseen_where_nobody_looks() {
    for blind in
        [ClosingSettings { by_pose: false, ..BY_POSE }, ClosingSettings { keeps_everything_live: true, ..BY_POSE }]
    {
        let (mut closing, way) = (Closing::<Signposts<Pose2>>::new(blind), Way::there_and_back(60));
        let (past, [old, newest]) = (way.past(), [10, 59].map(NodeId::new));
        assert!(!closing.is_unjudged(past, old) && closing.links(past, old));
        assert!(closing.supporting(past, newest, old, &[]).is_none());
    }
}

/// What becomes of findings that all say that the newest keyframes lie so far elsewhere, a few metres of way apart; the closures.
fn elsewhere<P: Pose>(detection: Detection, off_m: &[f64]) -> (Way<P>, Vec<Vec<Edge<P>>>) {
    let (mut closing, mut way) = (Closing::<Signposts<P>>::new(BY_POSE), Way::<P>::there_and_back(44));
    let mut closures = Vec::new();
    for off_m in off_m {
        way.go_on(3);
        let to = way.newest();
        let from = NodeId::new(60 - to.number());
        let known = KnownPlace::alike_in_all(from, false, Uncertainty { displacement_m2: 1e-3, rotation_rad2: 1e-5 });
        let target = target(way.past(), &known, from, to, detection, WINDOW_SIGMAS);
        let found = way.past().pose(from).between(way.past().pose(to)).moved([0.0, *off_m, 0.0]);
        closures.push(way.judge(&mut closing, &target, &finding(found, None)));
    }
    (way, closures)
}

#[test]
fn four_that_agree_pairwise_outvote_the_chain_which_gives_way() {
    let (way, closures) = elsewhere::<Pose2>(Detection::Pose, &[0.8, 0.8, 0.8, 0.8]);
    assert_eq!(closures.iter().map(Vec::len).collect::<Vec<_>>(), [0, 0, 0, 4]);
    let improbable = |candidate: &Candidate| candidate.evidence.cycle_chi2.is_some_and(|chi2| chi2 > 150.0);
    assert!(way.session.candidates().iter().all(improbable));
    let solved = way.graph().run().expect("it can be solved");
    assert!(solved.taken_back.is_empty());
    for edge in &closures[3] {
        let [from, to] =
            way.past().nodes([edge.from, edge.to]).unwrap().map(|node| solved.map_from_keyframe[node.index()]);
        let off_m = from.between(to).distance(edge.from_from_to);
        assert!(off_m < 0.02, "{off_m} m");
    }
}

#[test]
fn fewer_or_others_do_not_outvote_the_chain() {
    let waits = Verdict::Waiting(Objection::Improbable);
    let verdicts = |way: &Way<Pose2>| way.session.candidates().iter().map(|c| c.verdict).collect::<Vec<_>>();
    // The fourth agrees with each of the three, but they do not with each other.
    let (way, closures) = elsewhere::<Pose2>(Detection::Pose, &[0.8, 0.92, 1.08, 0.94]);
    assert!(closures.iter().all(Vec::is_empty), "{closures:?}");
    assert_eq!(verdicts(&way), [waits; 4]);
    // What the scan was matched with itself is of the same making as the match.
    let (way, closures) = elsewhere::<Pose2>(Detection::Match, &[0.8; 5]);
    assert!(closures.iter().all(Vec::is_empty));
    assert_eq!(verdicts(&way), [Verdict::Refused(Objection::Improbable); 5]);
    // Storeys look alike from end to end.
    let (way, closures) = elsewhere::<Pose3>(Detection::Pose, &[0.8; 5]);
    assert!(closures.iter().all(Vec::is_empty));
    assert!(way.session.candidates().iter().all(|c| c.verdict == Verdict::Refused(Objection::Improbable)));
}

/// Half the window, metres, in which an old place is looked for after so many looks that have seen nothing of it.
fn window_after<P: Pose>(looks: u32, closes: bool) -> f64 {
    let (mut closing, mut way) = (Closing::<Signposts<P>>::new(BY_POSE), Way::<P>::there_and_back(50));
    let known =
        [KnownPlace::alike_in_all(NodeId::new(10), false, Uncertainty { displacement_m2: 0.01, rotation_rad2: 1e-4 })];
    let target = target(way.past(), &known[0], NodeId::new(10), way.newest(), Detection::Pose, WINDOW_SIGMAS);
    let unseen = Finding::none(Evidence::default(), Objection::NoMatch);
    let look = |findings: &[_]| Verified { to: target.from, findings: findings.to_vec(), work: (0, 0) };
    (0..looks).for_each(|_| closing.looked(&look(&[(target, unseen)])));
    // What is seen of it, even if it does not count, is no such look, and neither is one at places that only look alike.
    let by_likeness = Target { detection: Detection::Place, ..target };
    let contradicting = finding(target.window.target_from_query, Some(Objection::Contradiction));
    (0..9).for_each(|_| closing.looked(&look(&[(by_likeness, unseen)])));
    (0..9).for_each(|_| closing.looked(&look(&[(target, contradicting), (target, unseen)])));
    if closes {
        let edge = way.match_with(NodeId::new(10), 0.0);
        closing.accepted(way.past(), [NodeId::new(10), way.newest()], &edge);
    }
    way.go_on(1);
    let verification = closing.propose(way.past(), &known, None, Signposts::default()).expect("it is nearby");
    verification.targets.as_slice()[0].0.window.half_width_m
}

#[test]
fn windows_grow_while_nothing_is_seen_of_places_nearby_until_a_closure() {
    let widths =
        [(3, false), (4, false), (8, false), (8, true)].map(|(looks, closes)| window_after::<Pose2>(looks, closes));
    for (width_m, sigmas) in widths.iter().zip([3.0, 6.0, 9.0, 3.0]) {
        assert!((width_m - (WINDOW_M + sigmas * 0.1)).abs() < 1e-9, "{widths:?}");
    }
    assert!((window_after::<Pose3>(8, false) - window_after::<Pose3>(0, false)).abs() < 1e-9);
}

/// Pieces of one fragment each, begun by the keyframes 0, 10 and 25: what was mapped before 10 may be all within a submap.
#[test]
fn a_submap_holds_a_piece_that_is_all_within_reach() {
    let way = Way::<Pose2>::there_and_back(31);
    let node = NodeId::new;
    let apart = Apart::of_fragments(&[(node(0), 0), (node(10), 1), (node(25), 2)]);
    let holds = |at: u32, reach_m: f64| apart.is_within(way.past(), node(at), reach_m);
    assert!(holds(4, 5.0) && !holds(4, 4.9) && !holds(0, 8.0) && holds(9, 9.0));
    assert!(holds(17, 7.0) && !holds(17, 6.9) && holds(28, 3.0) && !holds(24, 8.0));
    // A piece of two fragments lies on both sides of a break.
    let joined = Apart::of_fragments(&[(node(0), 0), (node(10), 1), (node(25), 0)]);
    assert!(!joined.is_within(way.past(), node(4), 8.0) && joined.is_within(way.past(), node(17), 8.0));
}
