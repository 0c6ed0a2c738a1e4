//! Answers to where a lost robot is, weighed against each other.

use super::Sought;
use mapwright_geom::{Cov3, Pose2};
use mapwright_loops::{Finding, Judged, Target, Window};
use mapwright_record::{Detection, Evidence, NodeId, Objection, Past, Verdict};

/// So many findings that agree make it home,
const FINDINGS: usize = 3;
/// made within so much way, metres, for a place that looks the same is found once and again, but not all the way,
const WITHIN_M: f64 = 3.0;
/// the first and the last so far apart,
const APART_M: f64 = 0.7;
/// and so many of them without any one of the other places.
pub(super) const WITHOUT: usize = 2;
/// Poses up to here are the same place, metres and radians.
const SAME_M: f64 = 0.3;
const SAME_RAD: f64 = 0.06;

/// A place that a lost robot has found itself at.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Found {
    /// The old keyframe.
    pub(crate) from: NodeId,
    /// The keyframe that was made aside.
    pub(crate) to: NodeId,
    pub(crate) from_from_to: Pose2,
    pub(crate) covariance: Cov3,
}

/// An answer by which the robot may be home.
#[derive(Debug, Clone)]
pub(crate) struct Chance {
    found: Found,
    /// What the map made aside would be moved by, there and at its rivals; none where there are too many.
    map_from_aside: Option<Vec<Pose2>>,
}

impl Chance {
    fn has(&self, map_from_aside: Pose2, here: Pose2) -> bool {
        self.map_from_aside.as_ref().is_none_or(|all| all.iter().any(|&other| same(other, map_from_aside, here)))
    }
}

/// Whether two motions of the map made aside put what is `here` into the same place.
pub(super) fn same(a: Pose2, b: Pose2, here: Pose2) -> bool {
    let error = (a * here).between(b * here);
    error.x.hypot(error.y) <= SAME_M && error.theta.abs() <= SAME_RAD
}

/// Takes an answer down: what it found, as a candidate, and the place, once enough of them agree on it. `way_m` is the way
/// between two keyframes that were made provisionally.
pub(crate) fn weigh(
    past: Past<'_>,
    sought: Past<'_>,
    answer: &Sought,
    chances: &mut Vec<Chance>,
) -> Option<(Judged, Option<Found>)> {
    let newest = past.newest()?;
    let way_m = |a: NodeId, b: NodeId| sought.way_between_m(a, b);
    chances.retain(|other| way_m(other.found.to, answer.to) <= WITHIN_M);
    let (from, finding) = answer.best.as_ref().map_or_else(|| (newest, nothing()), |best| (best.from, best.finding));
    let here = sought.pose(answer.to);
    let there = finding.target_from_query.map(|pose| past.pose(from) * pose);
    // Another place may fit as well for a while; but where the best is another and does not fit, what was found before was
    // chance.
    let fits = matches!(finding.objection, None | Some(Objection::Ambiguous));
    if !fits && !there.is_some_and(|there| chances.iter().any(|chance| chance.has(there * here.inverse(), here))) {
        chances.clear();
    }
    let mut judged = target(from).judged(newest, &finding);
    judged.verdict = Verdict::Waiting(finding.objection.unwrap_or(Objection::Alone));
    let place = answer.best.as_ref().filter(|best| best.is_plain());
    let (Some(place), Some(there), Some(from_from_to)) = (place, there, finding.target_from_query) else {
        return Some((judged, None));
    };
    let found = Found { from, to: answer.to, from_from_to, covariance: finding.covariance };
    let rivals = place.rivals.as_ref().map(|rivals| [&[there], rivals.as_slice()].concat());
    let aside_from_here = here.inverse();
    let map_from_aside = rivals.map(|all| all.iter().map(|&pose| pose * aside_from_here).collect());
    chances.push(Chance { found, map_from_aside });
    let agreeing = agreeing(chances, there * aside_from_here, here);
    let far = agreeing.iter().any(|a| way_m(a.found.to, found.to) >= APART_M);
    let enough = agreeing.len() >= FINDINGS && far && is_only(&agreeing, there * aside_from_here, here);
    if enough {
        (judged.verdict, judged.evidence.agreeing) = (Verdict::Accepted, agreeing.len() as u32 - 1);
        judged.to = newest.next();
    }
    Some((judged, enough.then_some(found)))
}

/// The answers that have a place among their best.
fn agreeing(chances: &[Chance], map_from_aside: Pose2, here: Pose2) -> Vec<&Chance> {
    chances.iter().filter(|chance| chance.has(map_from_aside, here)).collect()
}

/// Whether every other place is missing from enough of the answers.
fn is_only(agreeing: &[&Chance], map_from_aside: Pose2, here: Pose2) -> bool {
    let others = agreeing.iter().filter_map(|chance| chance.map_from_aside.as_ref()).flatten();
    let without = |other: Pose2| agreeing.iter().filter(|chance| !chance.has(other, here)).count();
    let known = agreeing.iter().filter(|chance| chance.map_from_aside.is_some()).count();
    known >= WITHOUT
        && others.filter(|&&other| !same(other, map_from_aside, here)).all(|&other| without(other) >= WITHOUT)
}

/// No place fits.
fn nothing() -> Finding {
    let (evidence, objection) = (Evidence::default(), Some(Objection::NoMatch));
    Finding { target_from_query: None, covariance: Cov3::zeros(), evidence, objection }
}

/// A robot may be anywhere.
pub(super) fn target(from: NodeId) -> Target {
    Target {
        from,
        detection: Detection::Place,
        window: Window {
            target_from_query: Pose2::IDENTITY,
            half_width_m: 0.0,
            half_height_m: 0.0,
            half_width_rad: 0.0,
        },
        covariance: Cov3::from_diagonal_element(1e6),
    }
}
