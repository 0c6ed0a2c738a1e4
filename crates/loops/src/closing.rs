//! Cycles: which old places to look for, and which findings to believe.

use crate::cascade::Finding;
use crate::submaps::{PoseOf, SUBMAP_M, Submaps, Window};
use crate::verification::{Judged, Target, Verification, Verified};
use crate::views::views_along;
use mapwright_geom::{Pose, Pose2, Tangent, TangentMatrix};
use mapwright_graph::Uncertainty;
use mapwright_record::{Candidate, Detection, Edge, Evidence, Measurement, NodeId, Objection, Past, Verdict};

mod apart;
mod checkpoint;
mod decision;
mod looks;
mod supports;

use apart::Apart;
pub use decision::{Decision, Ledger};
use looks::{Looked, Looks};
use supports::{Supports, agree, is_left};

/// Old places are looked for after so much travel, metres.
const CHECK_EVERY_M: f64 = 1.0;
/// A submap is made of less way where it has to tell less poses apart, for the window is no wider than this to either side, metres.
pub(crate) const NARROW_SUBMAP_M: f64 = 2.0;
const NARROW_M: f64 = 0.5;
/// Places this near to the robot may be seen from there, metres, and in space those up to half a storey above and below.
const SEEN_WITHIN_M: f64 = 4.0;
const SEEN_ABOVE_M: f64 = 1.5;
/// The search's window in standard deviations, to which comes what is added for the model's sake.
pub(crate) const WINDOW_SIGMAS: f64 = 3.0;
/// See above, metres,
pub const WINDOW_M: f64 = 0.3;
/// and radians.
pub const WINDOW_RAD: f64 = 0.06;
const WIDEST_M: f64 = 8.0;
/// Over a break it is not looked for in wider windows, metres: descriptors find as many joins, at a third of the cost.
const JOINED_WITHIN_M: f64 = 4.0;
/// After so many looks that have seen nothing of the old places nearby the robot is taken to be more uncertain by one deviation, after twice as
/// many by two, until a closure: what it states is a claim, and the place was in no window (docs/decisions/0025-bad-days.md).
const UNSEEN: u32 = 4;
/// Places looked for at a time.
const TARGETS: usize = 2;
/// What was passed so recently is no old place, metres of way.
pub const LEFT_M: f64 = 20.0;
/// Where the pose is of no use, places are asked for after so much travel, metres (in a fragment that is apart as often as findings count),
const ASK_BY_PLACE_EVERY_M: f64 = 3.0;
/// so many.
const ALIKE: usize = 5;
/// A place is described after so much way, by so much of it, metres.
const DESCRIBE_EVERY_M: f64 = 0.5;
const DESCRIBED_M: f64 = 7.0;
/// Keyframes described at most within one scan.
const DESCRIBED_AT_ONCE: usize = 32;
/// Within such an uncertainty nothing else can be meant, metres.
const SURE_M: f64 = 0.15;
/// Two findings agree up to here: metres and radians.
const AGREE_M: f64 = 0.2;
const AGREE_RAD: f64 = 0.03;
/// Where another pose fits nearly as well, but no better than this share, several findings that agree may still decide:
/// each saw other things. As many have to agree that a fragment lies elsewhere than odometry has led to, or where that says next to nothing,
/// and pairwise that the chain of edges is wrong.
const UNCLEAR_AMBIGUITY: f64 = 0.95;
const UNCLEAR_FRIENDS: usize = 3;
/// They must come from places so far apart along the way, metres,
pub const APART_M: f64 = 2.0;
/// and at most so far.
const TOGETHER_M: f64 = 30.0;
/// Findings that wait at most.
const WAITING_AT_MOST: usize = 64;
/// A closure that moves nothing farther than this may wait for others, metres; a turn moves what is so far away, metres.
const STRAIN_M: f64 = 0.02;
const LEVER_M: f64 = 5.0;
const STRAINED_AT_MOST: usize = 12;
/// and one in so many: as a map grows the whole of it is solved the more seldom, so that a scan costs the same.
const STRAINED_OF: usize = 8;

/// How cycles are looked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ClosingSettings {
    /// Within the uncertainty of the pose.
    pub by_pose: bool,
    /// By what places look like, where the pose is of no use.
    pub by_place: bool,
    /// Everything is in the local map for ever: what matches are supported by is not looked at.
    pub keeps_everything_live: bool,
}

/// How certain a part of what is known is.
#[derive(Debug, Clone, Copy)]
pub struct KnownPlace<P: Pose = Pose2> {
    /// The keyframe it began with.
    pub first: NodeId,
    /// Whether it is in the local map.
    pub live: bool,
    /// Covariance of the newest keyframe seen from there, a right perturbation.
    pub covariance: P::Matrix,
}

impl<P: Pose> KnownPlace<P> {
    /// A place that is as uncertain in all directions, and about all axes.
    #[must_use]
    pub fn alike_in_all(first: NodeId, live: bool, uncertainty: Uncertainty) -> Self {
        let covariance = P::Matrix::from_variances(uncertainty.displacement_m2, uncertainty.rotation_rad2);
        Self { first, live, covariance }
    }
}

/// What is known of cycles beside the candidates, which are the session's.
#[derive(Debug, Clone)]
pub struct Closing<S: Submaps> {
    settings: ClosingSettings,
    /// Findings that wait for company, numbers of candidates.
    waiting: Vec<u32>,
    /// When old places were looked for.
    looks: Looks,
    /// Old places that the matches of late were supported by or that closures led to.
    supports: Supports<PoseOf<S>>,
    places: S::Places,
    /// Keyframes that were described, or are too near to one that was, and the way up to the last one that was, metres.
    described: usize,
    described_m: Option<f64>,
    /// Closures the poses do not follow yet.
    strained: usize,
    urgent: bool,
    /// Looks since the last closure that have seen nothing of the old places that the poses have nearby.
    unseen: u32,
    /// Pieces of the map that nothing joins.
    apart: Apart,
}

/// What a finding makes of candidates: its own, and those that have waited and agree with it.
#[derive(Debug, Clone)]
struct Judgement<P: Pose> {
    /// Its own.
    judged: Judged<P>,
    /// Numbers of those that have waited and are closures now, as it is itself.
    agreeing: Vec<u32>,
    /// The keyframe after a break that odometry has led to wrongly: what links it to the one before is none.
    misled: Option<NodeId>,
}

impl<P: Pose> Judgement<P> {
    fn alone(judged: Judged<P>) -> Self {
        Self { judged, agreeing: Vec::new(), misled: None }
    }
}

impl<S: Submaps> Closing<S> {
    /// Nothing is known yet.
    #[must_use]
    pub fn new(settings: ClosingSettings) -> Self {
        Self {
            settings,
            waiting: Vec::new(),
            looks: Looks::default(),
            supports: Supports::default(),
            places: S::Places::default(),
            described: 0,
            described_m: None,
            strained: 0,
            urgent: false,
            unseen: 0,
            apart: Apart::default(),
        }
    }

    /// Describes all places by what they look like, at once: a robot that is switched on may be at any of them.
    pub fn switch_on(&mut self, past: Past<'_, S::Measurement>, submaps: &S) {
        if self.settings.by_place {
            self.remember_places(past, submaps, usize::MAX);
        }
    }

    /// A fragment begins after a break, or what leads over one was withdrawn.
    pub fn see_pieces(&mut self, past: Past<'_, S::Measurement>) {
        self.apart = Apart::of(past);
    }

    /// The newest keyframe goes on with what its robot has mapped before, whoever's keyframes were taken in since.
    pub fn see_turn(&mut self, past: Past<'_, S::Measurement>) {
        if let Some((newest, before)) = past.newest().and_then(|newest| Some((newest, past.before(newest)?))) {
            self.apart.go_on(newest, before);
        }
    }

    /// Whether robots drive at the same time: then each looks for what the others have mapped, and its own mapper for what it has itself.
    #[must_use]
    pub fn takes_turns(&self) -> bool {
        self.looks.takes_turns
    }

    /// Whether nothing joins what is mapped now with where the map begins.
    #[must_use]
    pub fn is_apart(&self) -> bool {
        self.apart.is_newest()
    }

    /// Whether nothing joins the pieces that two keyframes are of.
    #[must_use]
    pub fn is_between(&self, from: NodeId, to: NodeId) -> bool {
        self.apart.is_between(from, to)
    }

    /// Goes on with a session: what has waited waits, and closures of late hold.
    pub fn resume(&mut self, past: Past<'_, S::Measurement>) {
        let candidates = past.session.candidates().iter().zip(0..);
        let waits = |candidate: &Candidate<PoseOf<S>>| match candidate.verdict {
            Verdict::Waiting(Objection::Alone | Objection::Improbable) => true,
            Verdict::Waiting(Objection::Ambiguous) => {
                let Evidence { ambiguity, cycle_chi2, .. } = candidate.evidence;
                ambiguity.is_some_and(|share| share <= UNCLEAR_AMBIGUITY)
                    && cycle_chi2.is_some_and(|chi2| chi2 <= S::POLICY.contradicts_chi2)
            }
            _ => false,
        };
        self.waiting = candidates.filter(|(candidate, _)| waits(candidate)).map(|(_, number)| number).collect();
        self.waiting.drain(..self.waiting.len().saturating_sub(WAITING_AT_MOST));
        for known in past.session.recorded_edges().iter().filter(|known| known.recorded.candidate.is_some()) {
            let found = if known.withdrawn { supports::Found::Not } else { supports::Found::Here };
            let [from, to] = known.ends.map(NodeId::new);
            self.supports.learn(from, to, found);
        }
        self.supports.forget(past.way_m);
        self.looks = Looks::of(Looked { checked_m: past.length_m(), asked_m: past.length_m() });
        self.see_pieces(past);
    }

    /// Whether it is time to look for old places.
    #[must_use]
    pub fn is_due(&self, past: Past<'_, S::Measurement>) -> bool {
        // Once the maps of robots that drive at the same time are one, a look says little that the one before it did not.
        let every_m =
            if self.looks.takes_turns && !self.apart.are_several() { ASK_BY_PLACE_EVERY_M } else { CHECK_EVERY_M };
        past.way_m.last().is_some_and(|&now_m| self.looks.since_m(now_m) >= every_m)
    }

    /// The old places that the newest keyframe may have come back to, as work to be done; `support` is the keyframe that
    /// supplied most of what the last scan was matched against.
    pub fn propose(
        &mut self,
        past: Past<'_, S::Measurement>,
        known: &[KnownPlace<PoseOf<S>>],
        support: Option<NodeId>,
        submaps: S,
    ) -> Option<Verification<S>> {
        let to = past.newest()?;
        self.looks.turn_to(past.way_m[to.index()]);
        self.looks.present.checked_m = past.way_m[to.index()];
        self.supports.forget(past.way_m);
        let ClosingSettings { by_pose, by_place, .. } = self.settings;
        let supporting = support.filter(|_| by_pose).and_then(|from| self.supporting(past, to, from, known));
        let window_sigmas = self.window_sigmas();
        let mut targets = if by_pose { self.near(past, to, known) } else { Vec::new() };
        targets.extend(supporting);
        let widest_m =
            known.iter().filter(|place| !place.live).map(|place| window_m(place, window_sigmas)).fold(0.0, f64::max);
        let is_apart = self.is_apart() || self.looks.takes_turns && self.apart.are_several();
        if by_place && (widest_m > 0.5 * WIDEST_M || !by_pose || is_apart) {
            // Before they are needed, and a few at a time, for this is done within a scan.
            self.remember_places(past, &submaps, DESCRIBED_AT_ONCE);
            let needed = widest_m > WIDEST_M || !by_pose || is_apart;
            let every_m = if is_apart { APART_M } else { ASK_BY_PLACE_EVERY_M };
            if needed && self.looks.present.checked_m - self.looks.present.asked_m >= every_m {
                self.looks.present.asked_m = self.looks.present.checked_m;
                targets.extend(self.alike(past, to, known, &submaps));
            }
        }
        if targets.is_empty() {
            return None;
        }
        let narrow = targets.iter().all(|target| target.window.half_width_m <= NARROW_M);
        let reach_m = if narrow { NARROW_SUBMAP_M } else { SUBMAP_M };
        let targets =
            targets.into_iter().map(|target| (target, views_along(past, target.from, true, reach_m))).collect();
        let query = views_along(past, to, false, reach_m.min(S::POLICY.query_m));
        Some(Verification::new(to, query, targets, submaps))
    }

    /// A look at one old place from another, where the poses have them near each other: what they are uncertain by relative to the robot adds up.
    #[must_use]
    pub fn propose_again(
        &self,
        past: Past<'_, S::Measurement>,
        known: &[KnownPlace<PoseOf<S>>],
        [from, to]: [NodeId; 2],
        submaps: S,
    ) -> Option<Verification<S>> {
        let [of_from, of_to] = [patch_of(past, known, from)?, patch_of(past, known, to)?];
        let place = KnownPlace { covariance: of_from.covariance + of_to.covariance, live: false, ..*of_from };
        let target = target(past, &place, from, to, Detection::Pose, WINDOW_SIGMAS);
        if target.window.half_width_m > JOINED_WITHIN_M {
            return None;
        }
        let reach_m = if target.window.half_width_m <= NARROW_M { NARROW_SUBMAP_M } else { SUBMAP_M };
        let views = views_along(past, from, true, reach_m);
        let query = views_along(past, to, false, reach_m.min(S::POLICY.query_m));
        Some(Verification::new(to, query, vec![(target, views)], submaps))
    }

    /// Standard deviations that a window is wide: more, the oftener nothing was seen of what should be near. What a chain states is what a cycle
    /// is judged by all the same.
    fn window_sigmas(&self) -> f64 {
        WINDOW_SIGMAS * self.doubt()
    }

    /// Times the stated deviation that the robot is taken to be uncertain by.
    fn doubt(&self) -> f64 {
        f64::from(1 + self.unseen / UNSEEN)
    }

    /// What came of one look, before its findings are judged.
    fn looked(&mut self, verified: &Verified<PoseOf<S>>) {
        let mut nearby = verified.findings.iter().filter(|(target, _)| target.detection == Detection::Pose).peekable();
        let is_unseen = nearby.peek().is_some() && nearby.all(|(_, found)| found.objection == Some(Objection::NoMatch));
        self.unseen += u32::from(is_unseen && S::POLICY.doubts_chain);
    }

    /// The old place that the newest keyframe was matched against, unless it was looked at lately: such a match is a closure.
    fn supporting(
        &mut self,
        past: Past<'_, S::Measurement>,
        to: NodeId,
        from: NodeId,
        known: &[KnownPlace<PoseOf<S>>],
    ) -> Option<Target<PoseOf<S>>> {
        if from >= to || !self.is_unjudged(past, from) {
            return None;
        }
        self.supports.ask(from, to);
        let Some(place) = patch_of(past, known, from) else {
            self.supports.learn(from, to, supports::Found::Not);
            return None;
        };
        Some(target(past, place, from, to, Detection::Match, WINDOW_SIGMAS))
    }

    fn looks_at_supports(&self) -> bool {
        self.settings.by_pose && !self.settings.keeps_everything_live
    }

    /// Whether a match that is supported by `from` waits for a look at that old place.
    pub fn is_unjudged(&self, past: Past<'_, S::Measurement>, from: NodeId) -> bool {
        self.looks_at_supports() && is_left(past.way_m, from) && !self.supports.is_asked(past.way_m, from)
    }

    /// Whether a match that is supported by `from` links the keyframe that comes next to it: not where that is an old place
    /// that the cascade has not found.
    pub fn links(&self, past: Past<'_, S::Measurement>, from: NodeId) -> bool {
        let verdict = || self.supports.verdict(past.way_m, from);
        !is_left(past.way_m, from)
            || verdict().map_or(!self.looks_at_supports(), |found| found == supports::Found::Here)
    }

    /// A match that may link when its place has been looked at.
    pub fn wait(&mut self, past: Past<'_, S::Measurement>, edge: Edge<PoseOf<S>>) {
        self.supports.wait(past, edge);
    }

    /// After a verdict that has made `closures`: the matches that have waited for it and link.
    fn settle_matches(&mut self, past: Past<'_, S::Measurement>, closures: &[Edge<PoseOf<S>>]) -> Vec<Edge<PoseOf<S>>> {
        self.supports.settle(past, closures)
    }

    /// Places within the uncertainty of the pose, nearest first.
    fn near(
        &self,
        past: Past<'_, S::Measurement>,
        to: NodeId,
        known: &[KnownPlace<PoseOf<S>>],
    ) -> Vec<Target<PoseOf<S>>> {
        let (here, window_sigmas) = (past.pose(to), self.window_sigmas());
        let mut near: Vec<(f64, Target<PoseOf<S>>)> = Vec::new();
        let is_left = |place: &&KnownPlace<_>| !place.live && past.way_between_m(to, place.first) >= LEFT_M;
        let is_narrow = |place: &&KnownPlace<_>| {
            window_m(place, window_sigmas) <= JOINED_WITHIN_M || !self.apart.is_between(place.first, to)
        };
        for place in known.iter().filter(is_left).filter(is_narrow) {
            let there = past.pose(place.first);
            let away_m = there.distance(here);
            let target = target(past, place, place.first, to, Detection::Pose, window_sigmas);
            let above_m = (there.translation()[2] - here.translation()[2]).abs();
            let is_level = above_m <= SEEN_ABOVE_M + target.window.half_height_m;
            if away_m <= SEEN_WITHIN_M + window_sigmas * sigmas(place).0 && is_level {
                near.push((away_m, target));
            }
        }
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.from.cmp(&b.1.from)));
        let mut targets: Vec<Target<PoseOf<S>>> = Vec::new();
        for (_, target) in near {
            let new = |other: &Target<PoseOf<S>>| past.way_between_m(other.from, target.from) > SUBMAP_M;
            if targets.len() < TARGETS && targets.iter().all(new) {
                targets.push(target);
            }
        }
        targets
    }

    /// Places that look like this one, where the uncertainty of the pose allows for them; everywhere in what the robot is apart from.
    fn alike(
        &mut self,
        past: Past<'_, S::Measurement>,
        to: NodeId,
        known: &[KnownPlace<PoseOf<S>>],
        submaps: &S,
    ) -> Vec<Target<PoseOf<S>>> {
        let left = |node: NodeId| past.way_between_m(to, node) >= LEFT_M;
        let window_sigmas = self.window_sigmas();
        let found = submaps.alike(&mut self.places, &views_along(past, to, false, DESCRIBED_M), ALIKE, left);
        let target = |(from, window)| {
            let place = patch_of(past, known, from).filter(|place| !place.live)?;
            let most_m = SEEN_WITHIN_M + 2.0 * window_sigmas * sigmas(place).0;
            let is_near = self.apart.is_between(from, to) || past.pose(from).distance(past.pose(to)) <= most_m;
            let covariance = place.covariance;
            is_near.then_some(Target { from, detection: Detection::Place, window, covariance })
        };
        found.into_iter().filter_map(target).collect()
    }

    /// Describes places since the last time, of so many keyframes at most, each by what was seen on the last metres of the way.
    fn remember_places(&mut self, past: Past<'_, S::Measurement>, submaps: &S, at_most: usize) {
        let end = past.way_m.len().min(self.described.saturating_add(at_most));
        for (node, &way_m) in NodeId::first(end).zip(past.way_m).skip(self.described) {
            if self.described_m.is_none_or(|last_m| (way_m - last_m).abs() >= DESCRIBE_EVERY_M) {
                self.described_m = Some(way_m);
                submaps.remember(&mut self.places, node, &views_along(past, node, false, DESCRIBED_M));
            }
        }
        self.described = end;
    }

    /// Judges a finding, and with it the candidates that wait.
    fn judge(
        &mut self,
        past: Past<'_, S::Measurement>,
        candidates: &[Candidate<PoseOf<S>>],
        to: NodeId,
        (target, finding): (&Target<PoseOf<S>>, &Finding<PoseOf<S>>),
    ) -> Judgement<PoseOf<S>> {
        let mut judged = target.judged(to, finding);
        let found = finding.target_from_query.unwrap_or(target.window.target_from_query);
        let chi2 = cycle_chi2(past, to, target, finding, found);
        let joins = self.apart.is_between(target.from, to);
        let is_match = target.detection == Detection::Match;
        let may_wait = joins || S::POLICY.doubts_chain && !is_match;
        // Where the submap holds all of the other piece no other place of it can be meant: a finding is judged as within a fragment.
        let is_whole = joins && self.apart.is_within(past, target.from, SUBMAP_M);
        let is_strict = is_match || joins && !is_whole;
        let most_chi2 = if is_strict { S::POLICY.match_contradicts_chi2 } else { S::POLICY.contradicts_chi2 };
        judged.evidence.cycle_chi2 = finding.target_from_query.map(|_| chi2);
        let unclear = finding.objection == Some(Objection::Ambiguous)
            && judged.evidence.ambiguity.is_some_and(|ambiguity| ambiguity <= UNCLEAR_AMBIGUITY);
        judged.verdict = match finding.objection {
            Some(why @ (Objection::Ambiguous | Objection::LittleOverlap | Objection::Unconstrained)) => {
                Verdict::Waiting(why)
            }
            Some(why) => Verdict::Refused(why),
            None if chi2 > most_chi2 && may_wait => Verdict::Waiting(Objection::Improbable),
            None if chi2 > most_chi2 => Verdict::Refused(Objection::Improbable),
            None => Verdict::Waiting(Objection::Alone),
        };
        if is_match {
            self.supports.learn(target.from, to, supports::Found::Not);
        }
        let is_misled = chi2 > most_chi2;
        let may_count = finding.objection.is_none() || unclear && !is_misled;
        if !may_count || is_misled && !may_wait {
            return Judgement::alone(judged);
        }
        let number = candidates.len() as u32;
        let mut friends = self.friends(past, candidates, &judged);
        if is_misled && !joins {
            friends = pairwise(past, candidates, &friends);
        }
        judged.evidence.agreeing = friends.len() as u32;
        let is_clear = |verdict: Verdict| verdict == Verdict::Waiting(Objection::Alone);
        let any_clear = is_clear(judged.verdict) || friends.iter().any(|&k| is_clear(candidates[k as usize].verdict));
        let sigma_m = self.doubt() * target.covariance.position_variance_m2().sqrt();
        let sure = sigma_m < SURE_M && !unclear;
        let is_vouched = !is_misled && sigma_m <= WIDEST_M;
        let enough = if any_clear && (is_vouched || is_whole) { 1 } else { UNCLEAR_FRIENDS };
        if friends.len() < enough && (is_misled || !sure) {
            self.waiting.push(number);
            if self.waiting.len() > WAITING_AT_MOST {
                self.waiting.remove(0);
            }
            return Judgement::alone(judged);
        }
        self.waiting.retain(|other| !friends.contains(other));
        judged.verdict = Verdict::Accepted;
        let misled = self.apart.misled(to).filter(|_| is_misled && joins);
        Judgement { judged, agreeing: friends, misled }
    }

    /// Those that wait and say the same.
    fn friends(
        &self,
        past: Past<'_, S::Measurement>,
        candidates: &[Candidate<PoseOf<S>>],
        judged: &Judged<PoseOf<S>>,
    ) -> Vec<u32> {
        let Some(found) = judged.from_from_to else { return Vec::new() };
        let is_apart = |other: NodeId| past.way_between_m(other, judged.to) >= APART_M;
        let says_the_same = |&number: &u32| {
            let other = says(past, &candidates[number as usize]);
            other.is_some_and(|other| is_apart(other.1) && is_alike(past, other, (judged.from, judged.to, found)))
        };
        self.waiting.iter().copied().filter(says_the_same).collect()
    }

    /// A candidate has become a closure, with this edge between these nodes.
    fn accepted(&mut self, past: Past<'_, S::Measurement>, [from, to]: [NodeId; 2], edge: &Edge<PoseOf<S>>) {
        self.see_pieces(past);
        self.unseen = 0;
        self.supports.learn(from, to, supports::Found::Here);
        let error = past.pose(from).between(past.pose(to)).between(edge.from_from_to);
        self.strained += 1;
        self.urgent |= error.length() + LEVER_M * error.angle() > STRAIN_M;
    }

    /// Whether the graph is to be solved now; then it counts as solved. There are so many closures.
    fn take_solving_due(&mut self, closures: impl FnOnce() -> usize) -> bool {
        let is_crowded = self.strained >= STRAINED_AT_MOST && self.strained >= closures() / STRAINED_OF;
        let is_due = is_crowded || self.urgent;
        if is_due {
            (self.urgent, self.strained) = (false, 0);
        }
        is_due
    }

    /// A closure between two keyframes was none.
    pub fn withdrawn(&mut self, past: Past<'_, S::Measurement>, [from, to]: [NodeId; 2]) {
        self.see_pieces(past);
        self.supports.unlearn(from, to);
    }

    /// The keyframes from `node` on were moved: matches that wait there say what is no longer so.
    pub fn forget_since(&mut self, node: NodeId) {
        self.supports.forget_since(node);
    }
}

/// The way of each run begins this much farther than that of the one before it, metres: more than any robot drives.
pub const RUN_WAY_M: f64 = 1e6;

/// Which run a keyframe is of, by the length of way up to it.
#[must_use]
pub fn run_of(way_m: f64) -> u64 {
    (way_m / RUN_WAY_M) as u64
}

/// Whether there is so much way between two keyframes that the one is an old place to the other.
#[must_use]
pub fn is_old<M: Measurement>(past: Past<'_, M>, from: NodeId, to: NodeId) -> bool {
    past.way_between_m(from, to) >= LEFT_M
}

/// How far a finding differs from what the poses say: chi-square with as many degrees of freedom as a pose has.
fn cycle_chi2<M: Measurement>(
    past: Past<'_, M>,
    to: NodeId,
    target: &Target<M::Pose>,
    finding: &Finding<M::Pose>,
    found: M::Pose,
) -> f64 {
    let error = past.pose(target.from).between(past.pose(to)).local(found);
    let information = (target.covariance + finding.covariance).inverted();
    information.map_or(f64::INFINITY, |information| error.squared_by(&information))
}

/// The relative pose of two keyframes that a candidate has found.
fn says<M: Measurement>(past: Past<'_, M>, candidate: &Candidate<M::Pose>) -> Option<(NodeId, NodeId, M::Pose)> {
    let [from, to] = past.nodes([candidate.from, candidate.to])?;
    Some((from, to, candidate.from_from_to?))
}

/// Whether two findings say the same, by the short ways between their ends, and each by itself.
fn is_alike<M: Measurement>(past: Past<'_, M>, a: (NodeId, NodeId, M::Pose), b: (NodeId, NodeId, M::Pose)) -> bool {
    past.way_between_m(a.1, b.1) <= TOGETHER_M && past.way_between_m(a.0, b.0) <= TOGETHER_M && agree(past, a, b)
}

/// Of findings those that nothing but the chain speaks against, and that say the same as all those before.
fn pairwise<M: Measurement>(past: Past<'_, M>, candidates: &[Candidate<M::Pose>], numbers: &[u32]) -> Vec<u32> {
    let mut clique: Vec<u32> = Vec::new();
    for &number in numbers {
        let candidate = &candidates[number as usize];
        let is_clear = matches!(candidate.verdict, Verdict::Waiting(Objection::Alone | Objection::Improbable));
        let says_the_same = |&other: &u32| {
            let pair = says(past, candidate).zip(says(past, &candidates[other as usize]));
            pair.is_some_and(|(a, b)| past.way_between_m(a.1, b.1) >= APART_M && is_alike(past, a, b))
        };
        if is_clear && clique.iter().all(says_the_same) {
            clique.push(number);
        }
    }
    clique
}

/// Standard deviations of where the robot is seen from a place, along the ground in the direction in which it is largest, metres,
/// and of its heading, radians.
fn sigmas<P: Pose>(place: &KnownPlace<P>) -> (f64, f64) {
    let variance = |axis: usize| place.covariance[(axis, axis)];
    (variance(0).max(variance(1)).sqrt(), variance(P::DIMENSION - 1).sqrt())
}

/// Half the width of the window in which a place has to be looked for, metres.
fn window_m<P: Pose>(place: &KnownPlace<P>, window_sigmas: f64) -> f64 {
    WINDOW_M + window_sigmas * sigmas(place).0
}

/// The patch that tells how certain a place is: the one that began last before it on the robot's way.
fn patch_of<'a, M: Measurement>(
    past: Past<'_, M>,
    known: &'a [KnownPlace<M::Pose>],
    node: NodeId,
) -> Option<&'a KnownPlace<M::Pose>> {
    let way_m = |node: NodeId| past.way_m[node.index()];
    let is_before = |patch: &&KnownPlace<M::Pose>| patch.first <= node && way_m(patch.first) <= way_m(node);
    let last = |a: &&KnownPlace<M::Pose>, b: &&KnownPlace<M::Pose>| {
        way_m(a.first).total_cmp(&way_m(b.first)).then(a.first.cmp(&b.first))
    };
    known.iter().filter(is_before).max_by(last)
}

/// A place is looked for where the poses say it is.
fn target<M: Measurement>(
    past: Past<'_, M>,
    place: &KnownPlace<M::Pose>,
    from: NodeId,
    to: NodeId,
    detection: Detection,
    window_sigmas: f64,
) -> Target<M::Pose> {
    let (_, sigma_rad) = sigmas(place);
    let up_m2 = if M::Pose::TRANSLATION == 3 { place.covariance[(2, 2)] } else { 0.0 };
    let window = Window {
        target_from_query: past.pose(from).between(past.pose(to)),
        half_width_m: window_m(place, window_sigmas).min(WIDEST_M),
        half_height_m: (WINDOW_M + window_sigmas * up_m2.sqrt()).min(WIDEST_M),
        half_width_rad: WINDOW_RAD + window_sigmas * sigma_rad,
    };
    Target { from, detection, window, covariance: place.covariance }
}

#[cfg(test)]
mod tests;
