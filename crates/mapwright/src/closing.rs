//! Cycles: which old places to look for, and which findings to believe.

use crate::patches::Known;
use crate::settings::{LivePolicy, Settings};
use crate::store::{Judged, NodeId, Past};
use mapwright_geom::{Pose2, wrap_angle};
use mapwright_grid::MatcherSettings;
use mapwright_loops::{Finding, PlaceIndex, VerifySettings};
use mapwright_record::{Candidate, Detection, Edge, Evidence, Objection, Verdict};
use std::f64::consts::PI;

mod checkpoint;
mod look_back;
mod relocate;
mod solving;
mod submaps;
mod supports;
mod verification;

pub(crate) use look_back::{look_around, look_back};
pub(crate) use relocate::{Budget, Chance, Found, Ground, Heard, Seeking, Sought, follow, hopes, seek, weigh};
pub(crate) use solving::{Solved, Solving};
use submaps::{SUBMAP_M, end_points, submaps, views_along};
use supports::{Supports, agree, is_left};
pub(crate) use verification::{Target, Verification, Verified};

/// Old places are looked for after so much travel, metres.
const CHECK_EVERY_M: f64 = 1.0;
/// A submap is made of less way where it has to tell less poses apart, for the window is no wider than this to either side, metres.
const NARROW_SUBMAP_M: f64 = 2.0;
const NARROW_M: f64 = 0.5;
/// Places this near to the robot may be seen from there, metres.
const SEEN_WITHIN_M: f64 = 4.0;
/// The search's window in standard deviations, and what is added for the model's sake.
const WINDOW_SIGMAS: f64 = 3.0;
const WINDOW_M: f64 = 0.3;
const WINDOW_RAD: f64 = 0.06;
const WIDEST_M: f64 = 8.0;
/// Places looked for at a time.
const TARGETS: usize = 2;
/// What was passed so recently is no old place, metres of way.
pub(crate) const LEFT_M: f64 = 20.0;
/// Where the pose is of no use, places are asked for after so much travel, metres,
const ASK_BY_PLACE_EVERY_M: f64 = 3.0;
/// so many,
const ALIKE: usize = 5;
/// within this of where they were seen from, metres and radians to either side.
const LIKENESS_WINDOW_M: f64 = 3.0;
const LIKENESS_WINDOW_RAD: f64 = 0.3;
/// A place is described after so much way, by so much of it, metres.
const DESCRIBE_EVERY_M: f64 = 0.5;
const DESCRIBED_M: f64 = 7.0;
/// Keyframes described at most within one scan.
const DESCRIBED_AT_ONCE: usize = 32;
/// A finding that contradicts the chain of edges by more than this chi-square (three degrees of freedom) is refused. A chain states
/// too little: it does not confess failed matches and slips, so the quantile of a true chi-square (16.3 at 99.9 %) refuses
/// true closures by the dozen (docs/decisions/0011-closing-loops.md).
const IMPROBABLE_CHI2: f64 = 150.0;
/// What a match is supported by is in the local map, and certain relative to the robot as the gate has it: there the 99.9 % quantile
/// holds.
const IMPROBABLE_MATCH_CHI2: f64 = 16.3;
/// Within such an uncertainty nothing else can be meant, metres.
const SURE_M: f64 = 0.15;
/// Two findings agree up to here: metres and radians.
const AGREE_M: f64 = 0.2;
const AGREE_RAD: f64 = 0.03;
/// Where another pose fits nearly as well, but no better than this share, several findings that agree may still decide:
/// each saw other things.
const UNCLEAR_AMBIGUITY: f64 = 0.95;
const UNCLEAR_FRIENDS: usize = 3;
/// They must come from places so far apart along the way, metres, and at most so far.
const APART_M: f64 = 2.0;
const TOGETHER_M: f64 = 30.0;
/// Findings that wait at most.
const WAITING_AT_MOST: usize = 64;
/// A closure that moves nothing farther than this may wait for others, metres; a turn moves what is so far away, metres.
const STRAIN_M: f64 = 0.02;
const LEVER_M: f64 = 5.0;
const STRAINED_AT_MOST: usize = 12;

/// What is known of cycles beside the candidates, which are the store's.
#[derive(Debug, Clone)]
pub(crate) struct Closing {
    /// Findings that wait for company, numbers of candidates.
    waiting: Vec<u32>,
    /// Length of way when old places were looked for last, and asked for by what they look like, metres.
    checked_m: f64,
    asked_m: f64,
    /// Old places that the matches of late were supported by or that closures led to,
    supports: Supports,
    /// and whether they are looked at: not where places are not looked for by pose or nothing ever leaves the local map.
    looks_at_supports: bool,
    places: PlaceIndex,
    /// Keyframes that were described, or are too near to one that was.
    described: NodeId,
    described_m: f64,
    /// Closures the poses do not follow yet.
    strained: usize,
    urgent: bool,
}

/// What a finding makes of candidates: its own, and those that have waited and agree with it.
#[derive(Debug, Clone)]
pub(crate) struct Judgement {
    pub(crate) judged: Judged,
    /// Numbers of those that have waited and are closures now, as it is itself.
    pub(crate) agreeing: Vec<u32>,
}

impl Closing {
    pub(crate) fn new(settings: &Settings) -> Self {
        Self {
            waiting: Vec::new(),
            checked_m: 0.0,
            asked_m: 0.0,
            supports: Supports::default(),
            looks_at_supports: settings.loops.by_pose && settings.live.policy == LivePolicy::Gated,
            places: PlaceIndex::default(),
            described: 0,
            described_m: 0.0,
            strained: 0,
            urgent: false,
        }
    }

    /// Goes on with a session: what has waited waits, and closures of late hold.
    pub(crate) fn resume(&mut self, past: Past<'_>) {
        let candidates = past.session.candidates().iter().zip(0..);
        let waits = |candidate: &Candidate| match candidate.verdict {
            Verdict::Waiting(Objection::Alone) => true,
            Verdict::Waiting(Objection::Ambiguous) => {
                let Evidence { ambiguity, cycle_chi2, .. } = candidate.evidence;
                ambiguity.is_some_and(|share| share <= UNCLEAR_AMBIGUITY)
                    && cycle_chi2.is_some_and(|chi2| chi2 <= IMPROBABLE_CHI2)
            }
            _ => false,
        };
        self.waiting = candidates.filter(|(candidate, _)| waits(candidate)).map(|(_, number)| number).collect();
        self.waiting.drain(..self.waiting.len().saturating_sub(WAITING_AT_MOST));
        for known in past.session.recorded_edges().iter().filter(|known| known.recorded.candidate.is_some()) {
            let found = if known.withdrawn { supports::Found::Not } else { supports::Found::Here };
            self.supports.learn(known.ends[0], known.ends[1], found);
        }
        self.supports.forget(past.way_m);
        let way_m = past.way_m.last().copied().unwrap_or(0.0);
        (self.checked_m, self.asked_m) = (way_m, way_m);
    }

    pub(crate) fn is_due(&self, past: Past<'_>) -> bool {
        past.way_m.last().is_some_and(|now| now - self.checked_m >= CHECK_EVERY_M)
    }

    /// The old places that the newest keyframe may have come back to, as work to be done; `support` is the keyframe that
    /// supplied most of what the last scan was matched against.
    pub(crate) fn propose(
        &mut self,
        settings: &Settings,
        past: Past<'_>,
        known: &[Known],
        support: Option<NodeId>,
        matcher: MatcherSettings,
    ) -> Option<Verification> {
        let to = past.newest()?;
        self.checked_m = past.way_m[to as usize];
        self.supports.forget(past.way_m);
        let mut targets = if settings.loops.by_pose { self.near(past, to, known) } else { Vec::new() };
        if settings.loops.by_pose {
            targets.extend(support.and_then(|from| self.supporting(past, to, from, known)));
        }
        let widest_m = known.iter().filter(|place| !place.live).map(window_m).fold(0.0, f64::max);
        if settings.loops.by_place && (widest_m > 0.5 * WIDEST_M || !settings.loops.by_pose) {
            // Before they are needed, and a few at a time, for this is done within a scan.
            self.remember_places(past, DESCRIBED_AT_ONCE);
            let needed = widest_m > WIDEST_M || !settings.loops.by_pose;
            if needed && self.checked_m - self.asked_m >= ASK_BY_PLACE_EVERY_M {
                self.asked_m = self.checked_m;
                let hits = end_points(&views_along(past, to, false, DESCRIBED_M));
                targets.extend(self.alike(past, to, known, &hits));
            }
        }
        if targets.is_empty() {
            return None;
        }
        let reach_m =
            if targets.iter().all(|target| target.half_width_m <= NARROW_M) { NARROW_SUBMAP_M } else { SUBMAP_M };
        let targets =
            targets.into_iter().map(|target| (target, views_along(past, target.from, true, reach_m))).collect();
        Some(Verification {
            to,
            query: views_along(past, to, false, reach_m),
            targets,
            submaps: submaps(settings),
            verify: VerifySettings::default(),
            matcher,
        })
    }

    /// The old place that the newest keyframe was matched against, unless it was looked at lately: such a match is a closure.
    fn supporting(&mut self, past: Past<'_>, to: u32, from: u32, known: &[Known]) -> Option<Target> {
        if from >= to || !self.is_unjudged(past, from) {
            return None;
        }
        self.supports.ask(from, to);
        let Some(place) = patch_of(known, from) else {
            self.supports.learn(from, to, supports::Found::Not);
            return None;
        };
        Some(target(past, place, from, to, Detection::Match))
    }

    /// Whether a match that is supported by `from` waits for a look at that old place.
    pub(crate) fn is_unjudged(&self, past: Past<'_>, from: NodeId) -> bool {
        self.looks_at_supports && is_left(past.way_m, from) && !self.supports.is_asked(past.way_m, from)
    }

    /// Whether a match that is supported by `from` links the keyframe that comes next to it: not where that is an old place
    /// that the cascade has not found.
    pub(crate) fn links(&self, past: Past<'_>, from: NodeId) -> bool {
        let verdict = || self.supports.verdict(past.way_m, from);
        !is_left(past.way_m, from) || verdict().map_or(!self.looks_at_supports, |found| found == supports::Found::Here)
    }

    /// A match that may link when its place has been looked at.
    pub(crate) fn wait(&mut self, past: Past<'_>, edge: Edge) {
        self.supports.wait(past, edge);
    }

    /// After a verdict that has made `closures`: the matches that have waited for it and link.
    pub(crate) fn settle_matches(&mut self, past: Past<'_>, closures: &[Edge]) -> Vec<Edge> {
        self.supports.settle(past, closures)
    }

    /// Places within the uncertainty of the pose, nearest first.
    fn near(&self, past: Past<'_>, to: u32, known: &[Known]) -> Vec<Target> {
        let here = past.local_from_keyframe[to as usize];
        let mut near: Vec<(f64, Target)> = Vec::new();
        for place in known.iter().filter(|place| !place.live && past.way_between_m(to, place.first) >= LEFT_M) {
            let there = past.local_from_keyframe[place.first as usize];
            let away_m = there.distance(here);
            let target = target(past, place, place.first, to, Detection::Pose);
            if away_m <= SEEN_WITHIN_M + WINDOW_SIGMAS * target.sigma_m {
                near.push((away_m, target));
            }
        }
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.from.cmp(&b.1.from)));
        let mut targets: Vec<Target> = Vec::new();
        for (_, target) in near {
            let new = |other: &Target| past.way_between_m(other.from, target.from) > SUBMAP_M;
            if targets.len() < TARGETS && targets.iter().all(new) {
                targets.push(target);
            }
        }
        targets
    }

    /// Places that look like this one, where the uncertainty of the pose allows for them.
    fn alike(&mut self, past: Past<'_>, to: u32, known: &[Known], hits: &[[f64; 2]]) -> Vec<Target> {
        let left = |node: NodeId| past.way_between_m(to, node) >= LEFT_M;
        let found = self.places.query(hits, ALIKE, left);
        let mut targets = Vec::new();
        for hit in found {
            let Some(patch) = patch_of(known, hit.node).filter(|patch| !patch.live) else { continue };
            let (sigma_m, sigma_rad) =
                (patch.uncertainty.displacement_m2.sqrt(), patch.uncertainty.rotation_rad2.sqrt());
            let [there, here] = [hit.node, to].map(|node| past.local_from_keyframe[node as usize]);
            if there.distance(here) <= SEEN_WITHIN_M + 2.0 * WINDOW_SIGMAS * sigma_m {
                targets.extend(around(hit.node, hit.heading_rad, sigma_m, sigma_rad));
            }
        }
        targets
    }

    /// Describes places since the last time, of so many keyframes at most, each by what was seen on the last metres of the way.
    fn remember_places(&mut self, past: Past<'_>, at_most: usize) {
        let end = past.way_m.len().min(self.described as usize + at_most) as NodeId;
        for node in self.described..end {
            let way_m = past.way_m[node as usize];
            if self.places.is_empty() || way_m - self.described_m >= DESCRIBE_EVERY_M {
                self.described_m = way_m;
                let hits = end_points(&views_along(past, node, false, DESCRIBED_M));
                self.places.add(node, &hits);
            }
        }
        self.described = end;
    }

    /// Judges a finding, and with it the candidates that wait.
    pub(crate) fn judge(
        &mut self,
        past: Past<'_>,
        candidates: &[Candidate],
        to: NodeId,
        (target, finding): (&Target, &Finding),
    ) -> Judgement {
        let mut judged = target.judged(to, finding);
        let found = finding.target_from_query.unwrap_or(target.middle);
        let chi2 = cycle_chi2(past, to, target, finding, found);
        let most_chi2 = if target.detection == Detection::Match { IMPROBABLE_MATCH_CHI2 } else { IMPROBABLE_CHI2 };
        judged.evidence.cycle_chi2 = finding.target_from_query.map(|_| chi2);
        let unclear = finding.objection == Some(Objection::Ambiguous)
            && judged.evidence.ambiguity.is_some_and(|ambiguity| ambiguity <= UNCLEAR_AMBIGUITY);
        judged.verdict = match finding.objection {
            Some(why @ (Objection::Ambiguous | Objection::LittleOverlap | Objection::Unconstrained)) => {
                Verdict::Waiting(why)
            }
            Some(why) => Verdict::Refused(why),
            None if chi2 > most_chi2 => Verdict::Refused(Objection::Improbable),
            None => Verdict::Waiting(Objection::Alone),
        };
        if target.detection == Detection::Match {
            self.supports.learn(target.from, to, supports::Found::Not);
        }
        let may_count = finding.objection.is_none() || unclear;
        if !may_count || chi2 > most_chi2 {
            return Judgement { judged, agreeing: Vec::new() };
        }
        let number = candidates.len() as u32;
        let others = self.waiting.iter().copied();
        let friends: Vec<u32> = others.filter(|&k| is_alike(past, &candidates[k as usize], &judged)).collect();
        judged.evidence.agreeing = friends.len() as u32;
        let is_clear = |verdict: Verdict| verdict == Verdict::Waiting(Objection::Alone);
        let any_clear = is_clear(judged.verdict) || friends.iter().any(|&k| is_clear(candidates[k as usize].verdict));
        let sure = target.sigma_m < SURE_M && !unclear;
        let enough = if any_clear { 1 } else { UNCLEAR_FRIENDS };
        if friends.len() < enough && !sure {
            self.waiting.push(number);
            if self.waiting.len() > WAITING_AT_MOST {
                self.waiting.remove(0);
            }
            return Judgement { judged, agreeing: Vec::new() };
        }
        self.waiting.retain(|other| !friends.contains(other));
        judged.verdict = Verdict::Accepted;
        Judgement { judged, agreeing: friends }
    }

    /// A candidate has become a closure, with this edge between these nodes.
    pub(crate) fn accepted(&mut self, past: Past<'_>, [from, to]: [NodeId; 2], edge: &Edge) {
        self.supports.learn(from, to, supports::Found::Here);
        let error = past.pose(from).between(past.pose(to)).between(edge.from_from_to);
        self.strained += 1;
        self.urgent |= error.x.hypot(error.y) + LEVER_M * error.theta.abs() > STRAIN_M;
    }

    /// Whether the graph is to be solved now; then it counts as solved.
    pub(crate) fn take_solving_due(&mut self) -> bool {
        let due = self.urgent || self.strained >= STRAINED_AT_MOST;
        if due {
            (self.urgent, self.strained) = (false, 0);
        }
        due
    }

    /// A closure between two keyframes was none.
    pub(crate) fn withdrawn(&mut self, [from, to]: [NodeId; 2]) {
        self.supports.unlearn(from, to);
    }

    /// A keyframe is not where it was thought to be.
    pub(crate) fn disown(&mut self, node: NodeId) {
        self.supports.disown(node);
    }

    /// The keyframes from `node` on were moved: matches that wait there say what is no longer so.
    pub(crate) fn forget_since(&mut self, node: NodeId) {
        self.supports.forget_since(node);
    }
}

/// Whether there is so much way between two keyframes that the one is an old place to the other.
pub(crate) fn is_old(past: Past<'_>, from: NodeId, to: NodeId) -> bool {
    past.way_between_m(from, to) >= LEFT_M
}

/// How far a finding differs from what the poses say: chi-square with three degrees of freedom.
fn cycle_chi2(past: Past<'_>, to: NodeId, target: &Target, finding: &Finding, found: Pose2) -> f64 {
    let error = past.pose(target.from).between(past.pose(to)).between(found);
    let variance_m2 = target.sigma_m * target.sigma_m + finding.covariance[(0, 0)].max(finding.covariance[(1, 1)]);
    let variance_rad2 = target.sigma_rad * target.sigma_rad + finding.covariance[(2, 2)];
    let distance2 = error.x * error.x + error.y * error.y;
    distance2 / variance_m2 + error.theta * error.theta / variance_rad2
}

/// Whether a candidate that waits and a finding say the same, by the short ways between their ends.
fn is_alike(past: Past<'_>, waiting: &Candidate, judged: &Judged) -> bool {
    let (Some(a_pose), Some(b_pose)) = (waiting.from_from_to, judged.from_from_to) else { return false };
    let Some([from, to]) = past.nodes([waiting.from, waiting.to]) else { return false };
    (APART_M..=TOGETHER_M).contains(&past.way_between_m(to, judged.to))
        && past.way_between_m(from, judged.from) <= TOGETHER_M
        && agree(past, (from, to, a_pose), (judged.from, judged.to, b_pose))
}

/// Half the width of the window in which a place has to be looked for, metres.
fn window_m(place: &Known) -> f64 {
    WINDOW_M + WINDOW_SIGMAS * place.uncertainty.displacement_m2.sqrt()
}

/// The patch that tells how certain a place is: the one that began last before it.
fn patch_of(known: &[Known], node: u32) -> Option<&Known> {
    known.iter().filter(|patch| patch.first <= node).max_by_key(|patch| patch.first)
}

/// A place is looked for where the poses say it is.
fn target(past: Past<'_>, place: &Known, from: u32, to: u32, detection: Detection) -> Target {
    let [there, here] = [from, to].map(|node| past.pose(node));
    let (sigma_m, sigma_rad) = (place.uncertainty.displacement_m2.sqrt(), place.uncertainty.rotation_rad2.sqrt());
    Target {
        from,
        detection,
        middle: there.between(here),
        sigma_m,
        sigma_rad,
        half_width_m: window_m(place).min(WIDEST_M),
        half_width_rad: WINDOW_RAD + WINDOW_SIGMAS * sigma_rad,
    }
}

/// Both ways around in which a place may look alike.
fn around(from: u32, heading_rad: Option<f64>, sigma_m: f64, sigma_rad: f64) -> impl Iterator<Item = Target> {
    let turns = if heading_rad.is_some() { 2 } else { 1 };
    let half_width_rad = if heading_rad.is_some() { LIKENESS_WINDOW_RAD } else { PI };
    (0..turns).map(move |half| Target {
        from,
        detection: Detection::Place,
        middle: Pose2::new(0.0, 0.0, wrap_angle(heading_rad.unwrap_or(0.0) + f64::from(half) * PI)),
        sigma_m,
        sigma_rad,
        half_width_m: LIKENESS_WINDOW_M,
        half_width_rad,
    })
}

#[cfg(test)]
mod tests;
