//! Cycles: which old places to look for, which findings to believe, and the graph they make.

use crate::jobs::{Solving, Target, Verification};
use crate::patches::Known;
use crate::settings::Settings;
use mapwright_geom::{Cov3, Pose2};
use mapwright_graph::{Edge as GraphEdge, PoseGraph2, Vertex};
use mapwright_grid::MatcherSettings;
use mapwright_loops::{Finding, SubmapSettings, VerifySettings, View};
use mapwright_record::{Candidate, Detection, Edge, EdgeKind, Keyframe, KeyframeId, Objection, Verdict};
use nalgebra::Matrix3;

/// Old places are looked for after so much travel, metres.
const CHECK_EVERY_M: f64 = 1.0;
/// Length of way that makes a submap, to one side, metres.
const SUBMAP_M: f64 = 8.0;
/// Views of a submap lie so far apart at least: metres or radians.
const VIEW_M: f64 = 0.4;
const VIEW_RAD: f64 = 0.35;
/// Views of a submap at most, to one side.
const VIEWS_AT_MOST: usize = 40;
/// Places this near to the robot may be seen from there, metres.
const NEAR_M: f64 = 4.0;
/// The search's window in standard deviations, and what is added for the model's sake.
const WINDOW_SIGMAS: f64 = 3.0;
const WINDOW_M: f64 = 0.3;
const WINDOW_RAD: f64 = 0.06;
const WIDEST_M: f64 = 8.0;
/// Places looked for at a time.
const TARGETS: usize = 2;
/// 99.9 % quantile of chi-square with three degrees of freedom.
const IMPROBABLE_CHI2: f64 = 16.3;
/// Within such an uncertainty nothing else can be meant, metres.
const SURE_M: f64 = 0.3;
/// Two findings agree up to here: metres and radians.
const AGREE_M: f64 = 0.2;
const AGREE_RAD: f64 = 0.03;
/// They must come from places so far apart along the way, metres, and at most so far.
const APART_M: f64 = 2.0;
const TOGETHER_M: f64 = 30.0;
/// Findings that wait at most.
const WAITING_AT_MOST: usize = 64;
/// A closure that moves nothing farther than this may wait for others, metres.
const STRAIN_M: f64 = 0.02;
const STRAINED_AT_MOST: usize = 12;

/// What is known of cycles.
#[derive(Debug, Clone)]
pub(crate) struct Closing {
    /// Every candidate, taken or not.
    pub(crate) candidates: Vec<Candidate>,
    pub(crate) graph: PoseGraph2,
    /// Closures: place among the graph's edges, and among the candidates.
    closures: Vec<(usize, usize)>,
    /// Findings that wait for company, places among the candidates.
    waiting: Vec<usize>,
    /// Length of way up to each keyframe.
    path_m: Vec<f64>,
    checked_m: f64,
    /// Closures the poses do not follow yet.
    strained: usize,
    urgent: bool,
}

/// The poses and measurements that closing looks at.
#[derive(Clone, Copy)]
pub(crate) struct Past<'a> {
    pub(crate) keyframes: &'a [Keyframe],
    pub(crate) local_from_keyframe: &'a [Pose2],
}

impl Closing {
    pub(crate) fn new() -> Self {
        Self {
            candidates: Vec::new(),
            graph: PoseGraph2::default(),
            closures: Vec::new(),
            waiting: Vec::new(),
            path_m: Vec::new(),
            checked_m: 0.0,
            strained: 0,
            urgent: false,
        }
    }

    /// A new keyframe and its edges.
    pub(crate) fn add(&mut self, world_from_keyframe: Pose2, step_m: f64, edges: &[Edge]) {
        let id = self.graph.vertices.len() as u64;
        self.graph.vertices.push(Vertex { id, world_from_vertex: world_from_keyframe, fixed: id == 0 });
        let before = self.path_m.last().copied().unwrap_or(0.0);
        self.path_m.push(before + step_m);
        edges.iter().for_each(|edge| self.add_edge(edge));
    }

    fn add_edge(&mut self, edge: &Edge) {
        let (from, to) = (edge.from.seq as usize, edge.to.seq as usize);
        self.graph.edges.push(GraphEdge { from, to, from_from_to: edge.from_from_to, information: edge.information });
    }

    pub(crate) fn way_m(&self, a: u32, b: u32) -> f64 {
        (self.path_m[a as usize] - self.path_m[b as usize]).abs()
    }

    pub(crate) fn is_due(&self) -> bool {
        self.path_m.last().is_some_and(|now| now - self.checked_m >= CHECK_EVERY_M)
    }

    /// The old places that the newest keyframe may have come back to, as work to be done.
    pub(crate) fn propose(
        &mut self,
        settings: &Settings,
        past: Past<'_>,
        known: &[Known],
        matcher: MatcherSettings,
    ) -> Option<Verification> {
        let to = past.keyframes.len().checked_sub(1)? as u32;
        self.checked_m = self.path_m[to as usize];
        let here = past.local_from_keyframe[to as usize];
        let mut near: Vec<(f64, Target)> = Vec::new();
        for place in known.iter().filter(|place| !place.live) {
            let there = past.local_from_keyframe[place.first as usize];
            let sigma_m = place.uncertainty.displacement_m2.sqrt();
            let sigma_rad = place.uncertainty.rotation_rad2.sqrt();
            let away_m = there.distance(here);
            if self.way_m(to, place.first) < 20.0 || away_m > NEAR_M + WINDOW_SIGMAS * sigma_m {
                continue;
            }
            let target = Target {
                from: place.first,
                detection: Detection::Pose,
                from_from_to: there.between(here),
                sigma_m,
                sigma_rad,
                half_width_m: (WINDOW_M + WINDOW_SIGMAS * sigma_m).min(WIDEST_M),
                half_width_rad: WINDOW_RAD + WINDOW_SIGMAS * sigma_rad,
            };
            near.push((away_m, target));
        }
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.from.cmp(&b.1.from)));
        let mut targets: Vec<Target> = Vec::new();
        for (_, target) in near {
            let new = |other: &Target| self.way_m(other.from, target.from) > SUBMAP_M;
            if targets.len() < TARGETS && targets.iter().all(new) {
                targets.push(target);
            }
        }
        if targets.is_empty() {
            return None;
        }
        let submaps = SubmapSettings {
            resolution_m: settings.map.resolution_m,
            passes_per_hit: settings.map.passes_per_hit,
            free_range_m: settings.scan.free_range_m,
            reach_m: 15.0,
            thin_cells: 2,
        };
        let targets = targets.into_iter().map(|target| (target, self.views(past, target.from, true))).collect();
        let query = self.views(past, to, false);
        Some(Verification { to, query, targets, submaps, verify: VerifySettings::default(), matcher })
    }

    /// Keyframes along the way around `at`, before it and, if so wished, after it.
    fn views(&self, past: Past<'_>, at: u32, both_sides: bool) -> Vec<View> {
        let submap_from_local = past.local_from_keyframe[at as usize].inverse();
        let mut views = Vec::new();
        let before: Vec<usize> = (0..=at as usize).rev().collect();
        let after: Vec<usize> = if both_sides { (at as usize..past.keyframes.len()).collect() } else { Vec::new() };
        for side in [before, after] {
            let mut last: Option<Pose2> = None;
            for node in side.into_iter().take_while(|&node| self.way_m(node as u32, at) <= SUBMAP_M).take(400) {
                let pose = past.local_from_keyframe[node];
                let far =
                    last.is_none_or(|last| last.distance(pose) >= VIEW_M || last.between(pose).theta.abs() >= VIEW_RAD);
                if far && (views.is_empty() || node != at as usize) {
                    let sweep = past.keyframes[node].sweep.clone();
                    views.push(View { sweep, submap_from_keyframe: submap_from_local * pose });
                }
                if far {
                    last = Some(pose);
                }
                if views.len() >= 2 * VIEWS_AT_MOST {
                    break;
                }
            }
        }
        views
    }

    /// Judges a finding; the closures that it makes, as edges.
    pub(crate) fn judge(&mut self, past: Past<'_>, to: u32, target: &Target, finding: &Finding) -> Vec<Edge> {
        let mut candidate = Candidate {
            from: id(target.from),
            to: id(to),
            detection: target.detection,
            evidence: finding.evidence,
            verdict: Verdict::Accepted,
            from_from_to: finding.target_from_query,
            covariance: finding.covariance,
        };
        let found = finding.target_from_query.unwrap_or(target.from_from_to);
        let expected = past.local_from_keyframe[target.from as usize].between(past.local_from_keyframe[to as usize]);
        let error = expected.between(found);
        let variance_m2 = target.sigma_m * target.sigma_m + finding.covariance[(0, 0)].max(finding.covariance[(1, 1)]);
        let variance_rad2 = target.sigma_rad * target.sigma_rad + finding.covariance[(2, 2)];
        let distance2 = error.x * error.x + error.y * error.y;
        let chi2 = distance2 / variance_m2 + error.theta * error.theta / variance_rad2;
        candidate.evidence.cycle_chi2 = finding.target_from_query.map(|_| chi2);
        candidate.verdict = match finding.objection {
            Some(why @ (Objection::Ambiguous | Objection::LittleOverlap | Objection::Unconstrained)) => {
                Verdict::Waiting(why)
            }
            Some(why) => Verdict::Refused(why),
            None if chi2 > IMPROBABLE_CHI2 => Verdict::Refused(Objection::Improbable),
            None => Verdict::Waiting(Objection::Alone),
        };
        let this = self.candidates.len();
        self.candidates.push(candidate);
        if candidate.verdict != Verdict::Waiting(Objection::Alone) {
            return Vec::new();
        }
        let friends: Vec<usize> = self
            .waiting
            .iter()
            .copied()
            .filter(|&other| self.agree(past, &self.candidates[other], &candidate))
            .collect();
        self.candidates[this].evidence.agreeing = friends.len() as u32;
        let sure = target.sigma_m < SURE_M;
        if friends.is_empty() && !sure {
            self.waiting.push(this);
            if self.waiting.len() > WAITING_AT_MOST {
                self.waiting.remove(0);
            }
            return Vec::new();
        }
        self.waiting.retain(|other| !friends.contains(other));
        let mut edges = Vec::new();
        for at in friends.into_iter().chain([this]) {
            self.candidates[at].verdict = Verdict::Accepted;
            let Candidate { from, to, from_from_to, covariance, .. } = self.candidates[at];
            let Some((from_from_to, information)) = from_from_to.zip(covariance.try_inverse()) else { continue };
            let edge = Edge { from, to, kind: EdgeKind::Closure, from_from_to, information };
            self.closures.push((self.graph.edges.len(), at));
            self.add_edge(&edge);
            let expected =
                past.local_from_keyframe[from.seq as usize].between(past.local_from_keyframe[to.seq as usize]);
            let error = expected.between(from_from_to);
            self.strained += 1;
            self.urgent |= error.x.hypot(error.y) + 5.0 * error.theta.abs() > STRAIN_M;
            edges.push(edge);
        }
        edges
    }

    /// Whether two findings say the same, by the short ways between their ends.
    fn agree(&self, past: Past<'_>, a: &Candidate, b: &Candidate) -> bool {
        let (Some(a_pose), Some(b_pose)) = (a.from_from_to, b.from_from_to) else { return false };
        let way_to = self.way_m(a.to.seq, b.to.seq);
        if !(APART_M..=TOGETHER_M).contains(&way_to) || self.way_m(a.from.seq, b.from.seq) > TOGETHER_M {
            return false;
        }
        let local = |id: KeyframeId| past.local_from_keyframe[id.seq as usize];
        let via_a = local(b.from).between(local(a.from)) * a_pose * local(a.to).between(local(b.to));
        let error = via_a.between(b_pose);
        error.x.hypot(error.y) <= AGREE_M && error.theta.abs() <= AGREE_RAD
    }

    /// The graph to be solved, when that is due.
    pub(crate) fn solving(&mut self, world_from_keyframe: &[Pose2]) -> Option<Solving> {
        if !self.urgent && self.strained < STRAINED_AT_MOST {
            return None;
        }
        (self.urgent, self.strained) = (false, 0);
        for (vertex, &pose) in self.graph.vertices.iter_mut().zip(world_from_keyframe) {
            vertex.world_from_vertex = pose;
        }
        let closures = self.closures.iter().map(|&(edge, _)| edge).collect();
        Some(Solving { graph: self.graph.clone(), closures, most_chi2: 25.0 })
    }

    /// Later evidence speaks against closures.
    pub(crate) fn take_back(&mut self, edges: &[usize]) {
        for &edge in edges {
            self.graph.edges[edge].information = Matrix3::zeros();
            for &(_, candidate) in self.closures.iter().filter(|(at, _)| *at == edge) {
                self.candidates[candidate].verdict = Verdict::TakenBack(Objection::Outvoted);
            }
        }
        self.closures.retain(|(at, _)| !edges.contains(at));
    }

    pub(crate) fn covariance_of(&self, edge: &Edge) -> Cov3 {
        edge.information.try_inverse().unwrap_or_else(|| Cov3::identity() * 100.0)
    }
}

fn id(node: u32) -> KeyframeId {
    KeyframeId { robot: 0, session: 0, seq: node }
}
