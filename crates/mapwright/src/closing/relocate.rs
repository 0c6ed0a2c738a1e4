//! Where a lost robot is: what it has seen since, looked for in all that is known.

use super::{AGREE_M, AGREE_RAD, Closing, Past, candidate, id, submaps, views};
use crate::jobs::Target;
use crate::settings::Settings;
use mapwright_geom::{Cov3, Pose2};
use mapwright_grid::{Matcher, MatcherSettings, SearchWindow};
use mapwright_loops::{Atlas, Finding, Sighting, Submap, SubmapSettings, Verifier, VerifySettings, View};
use mapwright_record::{Detection, Evidence, Objection, Verdict};
use rustc_hash::FxHashSet;
use std::f64::consts::FRAC_PI_4;
use std::sync::Arc;

/// What was seen on so much way is looked for, metres; nothing of it may contradict a place,
const SINCE_M: f64 = 8.0;
/// and where that is nowhere, what was seen on so much, for a robot that comes from unknown ground knows the rest of it not.
const LATELY_M: f64 = 2.5;
/// The old place is what was seen on so much way before and after, metres.
const PLACE_M: f64 = 8.0;
/// The atlas has one view, the newest, for each square of this side, metres, and eighth of a turn.
const VIEW_EVERY_M: f64 = 0.5;
/// Half widths of the window in which a sighting is looked at closely.
const CLOSELY_M: f64 = 0.3;
const CLOSELY_RAD: f64 = 0.06;
/// A place that scores more than this share of the best is its rival
const RIVAL_SHARE: f64 = 0.9;
/// unless, looked at as closely, it leaves so many times as much unexplained.
const RIVAL_MISFIT: f64 = 3.0;
/// So many are looked at; where there are more, one of them will do.
const RIVALS_AT_MOST: usize = 4;
/// Of what is known from both places so much fits, or the score is such a share of the overlap.
const PLAIN_SHARE: f64 = 0.9;
const PLAIN_SCORE: f64 = 0.94;
/// So many findings that agree make it home,
const FINDINGS: usize = 3;
/// made within so much way, metres, for a place that looks the same is found once and again, but not all the way,
const WITHIN_M: f64 = 2.0;
/// the first and the last so far apart.
const APART_M: f64 = 0.7;

/// All that is known, drawn once for as long as the robot is lost.
#[derive(Debug)]
pub(crate) struct Ground {
    atlas: Atlas,
    /// The keyframe of each of its views.
    nodes: Vec<u32>,
}

impl Ground {
    fn new(views: Vec<(u32, View)>, submaps: &SubmapSettings) -> Self {
        let (nodes, views) = views.into_iter().unzip();
        Self { atlas: Atlas::new(views, submaps), nodes }
    }
}

/// The same, or what it is to be drawn from.
#[derive(Debug, Clone)]
pub(crate) enum Known {
    Drawn(Arc<Ground>),
    Views(Vec<(u32, View)>),
}

/// What a lost robot has seen is looked for in all that is known.
#[derive(Debug, Clone)]
pub(crate) struct Seeking {
    /// Number of the question.
    pub(crate) question: u64,
    /// The newest keyframe that was made aside, whose frame is that of the queries.
    to: u32,
    known: Known,
    /// What was seen lately, and all that was seen since the robot is lost, up to a bound.
    lately: Vec<View>,
    since: Vec<View>,
    submaps: SubmapSettings,
    matcher: MatcherSettings,
}

/// What came of it.
#[derive(Debug, Clone)]
pub(crate) struct Sought {
    pub(crate) question: u64,
    pub(crate) to: u32,
    pub(crate) ground: Arc<Ground>,
    /// The old keyframe nearest to the best place of all, and how what was seen fits there.
    pub(crate) best: Option<(u32, Finding)>,
}

impl Seeking {
    pub(crate) fn run(self) -> Sought {
        let ground = match self.known {
            Known::Drawn(ref ground) => Arc::clone(ground),
            Known::Views(ref views) => Arc::new(Ground::new(views.clone(), &self.submaps)),
        };
        let best = self.look_for(&ground, &self.since);
        let sure = best.is_some_and(|(_, finding)| finding.objection.is_none());
        // A robot that comes from unknown ground knows little of what it has seen but the last of it.
        let less = !sure && self.lately.len() < self.since.len();
        let best = if less { self.look_for(&ground, &self.lately).or(best) } else { best };
        Sought { question: self.question, to: self.to, ground, best }
    }

    fn look_for(&self, ground: &Ground, seen: &[View]) -> Option<(u32, Finding)> {
        let query = Submap::new(seen, &self.submaps);
        let best = ground.atlas.find(&query)?;
        Look { seeking: self, ground, query, all: seen.len() == self.since.len() }.judge(&best)
    }
}

/// A close look at places that were sighted.
struct Look<'a> {
    seeking: &'a Seeking,
    ground: &'a Ground,
    /// What is looked for,
    query: Submap,
    /// and whether it is all that was seen.
    all: bool,
}

impl Look<'_> {
    /// The best place as a finding: refined, judged as a closure is, by what was seen before, and by its rivals.
    fn judge(&self, best: &Sighting) -> Option<(u32, Finding)> {
        let view = self.ground.atlas.nearest(best.map_from_query)?;
        let target = self.place(view);
        let mut finding = self.look(view, &target, &self.query, best, self.verify());
        if finding.objection.is_none() && self.is_contradicted(view, &target, best) {
            finding.objection = Some(Objection::Contradiction);
        }
        if finding.objection.is_none()
            && let Some(rival) = self.rival(best, &finding.evidence)
        {
            finding.evidence.ambiguity = Some(rival.score / best.score);
            finding.objection = Some(Objection::Ambiguous);
        }
        Some((self.ground.nodes[view], finding))
    }

    /// The best of the other places that explain what was seen nearly as well.
    fn rival(&self, best: &Sighting, evidence: &Evidence) -> Option<Sighting> {
        let (mut equal, mut looked_at) = (None, 0);
        self.ground.atlas.rivals(&self.query, best, RIVAL_SHARE, |rival| {
            looked_at += 1;
            if looked_at > RIVALS_AT_MOST || !self.explains_less(rival, evidence) {
                equal = Some(*rival);
            }
            equal.is_none()
        });
        equal
    }

    fn verify(&self) -> VerifySettings {
        VerifySettings::default()
    }

    /// What was seen around a view.
    fn place(&self, view: usize) -> Submap {
        Submap::new(&self.ground.atlas.around(view, PLACE_M), &self.seeking.submaps)
    }

    fn look(
        &self,
        view: usize,
        target: &Submap,
        query: &Submap,
        sighting: &Sighting,
        settings: VerifySettings,
    ) -> Finding {
        let window = SearchWindow {
            world_from_robot: self.ground.atlas.map_from_view(view).between(sighting.map_from_query),
            half_width_m: CLOSELY_M,
            half_width_rad: CLOSELY_RAD,
        };
        Verifier::new(settings, Matcher { settings: self.seeking.matcher }).look_for(query, target, &window)
    }

    /// For looks at what need not fit.
    fn anything(&self) -> VerifySettings {
        VerifySettings { least_score: 0.0, ..self.verify() }
    }

    /// Whether what was seen before, on the way here, speaks against a place. Most of it may have been seen on unknown ground:
    /// little of it needs to fit, but that well.
    fn is_contradicted(&self, view: usize, target: &Submap, sighting: &Sighting) -> bool {
        let Seeking { since, submaps, .. } = self.seeking;
        if self.all {
            return false;
        }
        let settings = self.anything();
        let seen = self.look(view, target, &Submap::new(since, submaps), sighting, settings).evidence;
        seen.contradiction.is_none_or(|share| share > settings.most_contradiction)
            || seen.inlier_share.is_none_or(|share| share < settings.least_inlier_share)
    }

    /// Whether another place, looked at as closely, is by far the worse explanation. By how much two places differ says
    /// little where both score nearly in full; how much either leaves unexplained says it all.
    fn explains_less(&self, rival: &Sighting, best: &Evidence) -> bool {
        let Some(view) = self.ground.atlas.nearest(rival.map_from_query) else { return false };
        let there = self.look(view, &self.place(view), &self.query, rival, self.anything()).evidence;
        misfit(&there) >= RIVAL_MISFIT * misfit(best)
    }
}

/// The share of what was seen that a place leaves unexplained.
fn misfit(evidence: &Evidence) -> f64 {
    1.0 - evidence.score.unwrap_or(0.0) * evidence.inlier_share.unwrap_or(0.0)
}

/// A place that a lost robot has found itself at.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Found {
    /// The old keyframe.
    pub(crate) from: u32,
    /// The keyframe that was made aside.
    pub(crate) to: u32,
    pub(crate) from_from_to: Pose2,
    pub(crate) covariance: Cov3,
}

impl Closing {
    /// The question where in all that is known a lost robot may be, as work to be done; `ground` is what earlier answers
    /// were found on.
    pub(crate) fn seek(
        &self,
        settings: &Settings,
        past: Past<'_>,
        dropped: &FxHashSet<u32>,
        sought: Past<'_>,
        ground: Option<&Arc<Ground>>,
        (question, matcher): (u64, MatcherSettings),
    ) -> Option<Seeking> {
        let to = sought.keyframes.len().checked_sub(1)? as u32;
        let step_m = |node: usize| sought.local_from_keyframe[node - 1].distance(sought.local_from_keyframe[node]);
        let seen_on = |way_m: f64| views(sought, to, false, way_m, step_m);
        let known = ground.map_or_else(|| Known::Views(everything(past, dropped)), |g| Known::Drawn(Arc::clone(g)));
        let submaps = submaps(settings);
        Some(Seeking { question, to, known, lately: seen_on(LATELY_M), since: seen_on(SINCE_M), submaps, matcher })
    }

    /// Takes an answer down; the place, once enough of them agree on it. `way_m` is the way between two keyframes that
    /// were made aside.
    pub(crate) fn weigh(
        &mut self,
        past: Past<'_>,
        sought: Past<'_>,
        answer: &Sought,
        findings: &mut Vec<Found>,
        way_m: impl Fn(u32, u32) -> f64,
    ) -> Option<Found> {
        let newest = past.keyframes.len().checked_sub(1)? as u32;
        findings.retain(|other| way_m(other.to, answer.to) <= WITHIN_M);
        let (from, finding) = answer.best.unwrap_or_else(|| (newest, nothing()));
        // Another place may fit as well for a while; but where the best does not fit, what was found before was chance.
        if !matches!(finding.objection, None | Some(Objection::Ambiguous)) {
            findings.clear();
        }
        let this = self.candidates.len();
        let mut candidate = candidate(&target(from), newest, &finding);
        candidate.verdict = Verdict::Waiting(finding.objection.unwrap_or(Objection::Alone));
        self.candidates.push(candidate);
        let plain = finding.objection.is_none() && is_plain(&finding.evidence);
        let from_from_to = finding.target_from_query.filter(|_| plain)?;
        let found = Found { from, to: answer.to, from_from_to, covariance: finding.covariance };
        let agreeing: Vec<&Found> = findings.iter().filter(|other| agree(past, sought, other, &found)).collect();
        let enough = agreeing.len() + 1 >= FINDINGS && agreeing.iter().any(|a| way_m(a.to, found.to) >= APART_M);
        if enough {
            let candidate = &mut self.candidates[this];
            (candidate.verdict, candidate.evidence.agreeing) = (Verdict::Accepted, agreeing.len() as u32);
            candidate.to = id(newest + 1);
        }
        findings.push(found);
        enough.then_some(found)
    }
}

/// No place fits.
fn nothing() -> Finding {
    let (evidence, objection) = (Evidence::default(), Some(Objection::NoMatch));
    Finding { target_from_query: None, covariance: Cov3::zeros(), evidence, objection }
}

/// Whether two findings put the robot into the same place.
fn agree(past: Past<'_>, sought: Past<'_>, a: &Found, b: &Found) -> bool {
    let local = |found: &Found| past.local_from_keyframe[found.from as usize] * found.from_from_to;
    let [there, here] = [a, b].map(|found| sought.local_from_keyframe[found.to as usize]);
    let error = (local(a) * there.between(here)).between(local(b));
    error.x.hypot(error.y) <= AGREE_M && error.theta.abs() <= AGREE_RAD
}

/// Whether a fit is good enough for a robot that has nothing else to go by: nearly all that is known of either submap fits, or
/// all points in known territory fit closely.
fn is_plain(evidence: &Evidence) -> bool {
    let closely = evidence.score.zip(evidence.overlap).is_some_and(|(score, overlap)| score >= PLAIN_SCORE * overlap);
    closely || evidence.inlier_share.is_some_and(|share| share >= PLAIN_SHARE)
}

/// Views of all ground, along the way; where it was seen often, as it was seen last.
fn everything(past: Past<'_>, dropped: &FxHashSet<u32>) -> Vec<(u32, View)> {
    let mut seen = FxHashSet::default();
    let mut views = Vec::new();
    for node in (0..past.keyframes.len()).rev().filter(|&node| !dropped.contains(&(node as u32))) {
        let pose = past.local_from_keyframe[node];
        let [x, y] = [pose.x, pose.y].map(|m| (m / VIEW_EVERY_M).floor() as i32);
        if seen.insert((x, y, (pose.theta / FRAC_PI_4).floor() as i32)) {
            views.push((node as u32, View { sweep: past.keyframes[node].sweep.clone(), submap_from_keyframe: pose }));
        }
    }
    views.reverse();
    views
}

/// A robot may be anywhere.
fn target(from: u32) -> Target {
    Target {
        from,
        detection: Detection::Place,
        middle: Pose2::IDENTITY,
        sigma_m: 1e3,
        sigma_rad: 1e3,
        half_width_m: CLOSELY_M,
        half_width_rad: CLOSELY_RAD,
    }
}
