//! A close look at the places where what was seen may be.

use super::{Ground, LATELY_M, Seeking};
use mapwright_geom::Pose2;
use mapwright_grid::{Matcher, SearchWindow};
use mapwright_loops::{Atlas, Effort, Finding, PlaneSubmap, PlaneVerifier, Sighting, VerifySettings};
use mapwright_record::{Evidence, NodeId, Objection};
use std::cell::OnceCell;

/// The old place is what was seen on so much way before and after, metres.
const PLACE_WAY_M: f64 = 8.0;
/// Half widths of the window in which a sighting is looked at closely.
const CLOSELY_M: f64 = 0.3;
const CLOSELY_RAD: f64 = 0.06;
/// A place that scores more than this share of the best is its rival unless, looked at as closely, it explains less than
/// this share of what the best does
const RIVAL_SHARE: f64 = 0.9;
/// or, where the robot has come from elsewhere, leaves so many times as much unexplained.
const RIVAL_MISFIT: f64 = 3.0;
/// So many are looked at; where there are more, nothing is decided.
const RIVALS_AT_MOST: usize = 48;
/// The score of a plain fit is such a share of the overlap or, where all that was seen is looked for, such a share of what is
/// known fits.
const PLAIN_SCORE: f64 = 0.94;
const PLAIN_SHARE: f64 = 0.9;
/// A wrong place may fit to the width of a cell; surfaces lie this closely on those of the right one.
const PLAIN_CLOSENESS: f64 = 0.8;
/// What was seen lately and what was seen before as well are found no farther apart than this, metres: along a wall one of them
/// may be found elsewhere.
const SAME_PLACE_M: f64 = 0.15;
/// Who is on known ground knows such a share of what it has seen lately, and of all that it has seen where it never left it.
const PLAIN_OVERLAP: f64 = 0.9;
pub(super) const WHOLE_OVERLAP: f64 = 0.95;
/// What a place must show at least, and how much may speak against it.
const PLACE_LEAST_SHARE: f64 = 0.8;
const PLACE_MOST_CONTRADICTION: f64 = 0.14;
/// What was seen before, on the way here, and fits there to such a share of how it fits at a place, makes it common here,
const COMMON_SHARE: f64 = 0.93;
/// unless it is where the robot is, metres.
const RETURNED_M: f64 = 1.5;
/// So many places of it are looked at, from such a share of the full score on, and of the best.
const AGAIN_AT_MOST: usize = 4;
const AGAIN_SCORE: f64 = 0.7;
const AGAIN_OF_BEST: f64 = 0.93;
/// What is known to less than this share there does not count.
const AGAIN_OVERLAP: f64 = 0.5;

/// Of what a robot has seen on its way from unknown ground little is known; where it has seen more than this share of what is
/// known, it would have been found there before, unless it never left known ground.
const KNOWN_BEFORE: std::ops::Range<f64> = 0.33..0.9;
/// Who has seen this share of a scan on known ground would have been found there; so few of the scans are chance.
const ON_KNOWN_GROUND: f64 = 0.9;
const SELDOM: f64 = 0.1;

/// A place, and how what was seen fits there.
#[derive(Debug, Clone)]
pub(crate) struct Place {
    /// The old keyframe nearest to it.
    pub(crate) from: NodeId,
    pub(super) finding: Finding,
    /// Where it fits nearly as well: poses of what was looked for in the map; none where there are too many.
    pub(super) rivals: Option<Vec<Pose2>>,
    /// Whether all was looked for that was seen since the robot is lost.
    whole: bool,
    /// Whether the robot has seen elsewhere what fits nearly as well.
    common: bool,
    /// How closely surfaces lie on those that are known, as a share of how closely they lie on their own; the least of what was
    /// seen lately, all that was seen on the way, and the map.
    closeness: f64,
    /// Whether what was seen lately and what was seen before as well are found in the same place.
    steady: bool,
}

/// A close look at places that were sighted.
pub(super) struct Look<'a> {
    pub(super) seeking: &'a Seeking,
    pub(super) ground: &'a Ground,
    pub(super) effort: &'a Effort,
    /// What is looked for,
    pub(super) query: &'a PlaneSubmap,
    /// all that was seen on the way that is kept in mind,
    pub(super) since: &'a PlaneSubmap,
    /// whether the one is the other,
    pub(super) all: bool,
    /// what was seen lately where all is looked for, and the other way round, where that is not the same,
    pub(super) other: Option<&'a PlaneSubmap>,
    /// and whether that is the whole way since the robot is lost.
    pub(super) whole: bool,
    /// What was seen before that, once it was drawn,
    pub(super) before: &'a OnceCell<Atlas>,
    /// and where what is looked for fits in it: the score of the search, and how well that fits which is known.
    pub(super) again: OnceCell<Vec<(f64, f64)>>,
}

impl Look<'_> {
    /// The place of all where what is looked for fits best.
    pub(super) fn best(&self) -> Option<Place> {
        self.judge(&self.ground.atlas.find(self.query, self.effort)?)
    }

    /// The best place as a finding: refined, judged as a closure is, by what was seen before, and by its rivals.
    fn judge(&self, best: &Sighting) -> Option<Place> {
        let view = self.ground.atlas.nearest(best.map_from_query)?;
        let target = self.place(view);
        let mut finding = self.look(view, &target, self.query, best, self.verify());
        let from = self.ground.nodes[view];
        // Where it fits a little farther along a wall as well, the place is as good.
        let mut fits = matches!(finding.objection, None | Some(Objection::Ambiguous));
        let other = self.other.filter(|_| fits).map(|other| self.look(view, &target, other, best, self.anything()));
        if fits && !self.all && other.is_some_and(|seen| self.is_against(&seen.evidence)) {
            (finding.objection, fits) = (Some(Objection::Contradiction), false);
        }
        let steady = other.is_none_or(|other| say_the_same(&finding, &other));
        let closeness = self.closeness(&target, &finding, other.as_ref());
        let mut rivals = Some(Vec::new());
        if fits && self.is_unlikely(best, fit_of_known(&finding, self.query, &target)) {
            finding.objection = Some(Objection::Ambiguous);
            return Some(Place { from, finding, rivals, whole: false, common: true, closeness, steady });
        } else if fits {
            let (equal, many) = self.rivals(best, &finding.evidence);
            if let Some(first) = equal.first() {
                finding.evidence.ambiguity = Some(first.score / best.score);
                finding.objection = Some(Objection::Ambiguous);
            }
            rivals = (!many).then(|| equal.iter().map(|rival| rival.map_from_query).collect());
        }
        Some(Place { from, finding, rivals, whole: self.whole, common: false, closeness, steady })
    }

    /// How closely what is looked for, what else was seen lately or on the way, and, seen from the map, all of that lies where
    /// it should.
    fn closeness(&self, target: &PlaneSubmap, finding: &Finding, other: Option<&Finding>) -> f64 {
        let Some(pose) = finding.target_from_query else { return 0.0 };
        let there = other.and_then(|other| other.target_from_query);
        let since = if self.all { (self.query, pose) } else { (self.since, there.unwrap_or(pose)) };
        closeness_both_ways(target, [Some((self.query, pose)), self.other.zip(there)], since)
    }

    /// Whether what a robot has seen before it came here speaks against a place: what fits nearly as well, for then such
    /// places are common in this building, and the one that is known need not be the one; or, were it there, too much of what
    /// is known, for the robot was not found then.
    fn is_unlikely(&self, best: &Sighting, here: f64) -> bool {
        if self.seeking.before.is_empty() {
            return false;
        }
        let map_from_aside = best.map_from_query * self.seeking.aside_from_query.inverse();
        KNOWN_BEFORE.contains(&self.ground.atlas.share_of(self.before(), map_from_aside))
            || self.is_common(best.score, here)
    }

    /// Whether what is looked for fits nearly as well where it was seen before: by the search and, looked at as closely, by how
    /// well that fits which is known of it, `here`.
    pub(super) fn is_common(&self, score: f64, here: f64) -> bool {
        if self.seeking.before.is_empty() {
            return false;
        }
        let again = self.again.get_or_init(|| self.seen_again());
        again.iter().any(|&(again, there)| again >= COMMON_SHARE * score && there >= COMMON_SHARE * here)
    }

    /// Where what is looked for fits in what was seen before: the score of the search and, looked at closely, how well that
    /// fits which is known.
    fn seen_again(&self) -> Vec<(f64, f64)> {
        let before = self.before();
        let sightings = before.sightings(self.query, self.effort, (AGAIN_SCORE, AGAIN_OF_BEST), AGAIN_AT_MOST);
        let elsewhere = sightings
            .iter()
            .filter(|sighting| sighting.map_from_query.distance(self.seeking.aside_from_query) > RETURNED_M);
        let look = |sighting: &Sighting| {
            let view = before.nearest(sighting.map_from_query)?;
            let target = PlaneSubmap::new(&before.around(view, PLACE_WAY_M), &self.seeking.submaps);
            let near = before.map_from_view(view).between(sighting.map_from_query);
            let finding = self.look_near(near, &target, self.query, self.anything());
            Some((sighting.score, fit_of_known(&finding, self.query, &target)))
        };
        elsewhere.filter_map(look).collect()
    }

    fn before(&self) -> &Atlas {
        let Seeking { before, submaps, .. } = self.seeking;
        self.before.get_or_init(|| Atlas::new(before.iter().map(|(_, view)| view.clone()).collect(), submaps))
    }

    /// Whether a robot that is there would have been on known ground before so much way, metres, and was not found.
    pub(super) fn was_there(&self, map_from_query: Pose2, way_m: f64) -> bool {
        let Seeking { before, aside_from_query, .. } = self.seeking;
        let earlier = before.iter().filter(|(back_m, _)| *back_m > way_m + LATELY_M).map(|(_, view)| view);
        let map_from_aside = map_from_query * aside_from_query.inverse();
        self.ground.atlas.share_on_known_ground(earlier, map_from_aside, ON_KNOWN_GROUND) > SELDOM
    }

    /// The other places that explain what was seen nearly as well, and whether there are too many to look at.
    fn rivals(&self, best: &Sighting, evidence: &Evidence) -> (Vec<Sighting>, bool) {
        let (mut equal, mut looked_at) = (Vec::new(), 0);
        self.ground.atlas.rivals(self.query, self.effort, best, RIVAL_SHARE, |rival| {
            looked_at += 1;
            if looked_at > RIVALS_AT_MOST || !self.explains_less(rival, evidence) {
                equal.push(*rival);
            }
            looked_at <= RIVALS_AT_MOST
        });
        (equal, looked_at > RIVALS_AT_MOST)
    }

    /// As for a closure, but where all that was seen has to fit, things that have moved since count for less.
    fn verify(&self) -> VerifySettings {
        let strict = VerifySettings::default();
        if !self.whole {
            return strict;
        }
        VerifySettings { least_inlier_share: PLACE_LEAST_SHARE, most_contradiction: PLACE_MOST_CONTRADICTION, ..strict }
    }

    /// What was seen around a view.
    pub(super) fn place(&self, view: usize) -> PlaneSubmap {
        PlaneSubmap::new(&self.ground.atlas.around(view, PLACE_WAY_M), &self.seeking.submaps)
    }

    pub(super) fn look(
        &self,
        view: usize,
        target: &PlaneSubmap,
        query: &PlaneSubmap,
        sighting: &Sighting,
        settings: VerifySettings,
    ) -> Finding {
        let near = self.ground.atlas.map_from_view(view).between(sighting.map_from_query);
        self.look_near(near, target, query, settings)
    }

    fn look_near(&self, near: Pose2, target: &PlaneSubmap, query: &PlaneSubmap, settings: VerifySettings) -> Finding {
        let window = SearchWindow { world_from_robot: near, half_width_m: CLOSELY_M, half_width_rad: CLOSELY_RAD };
        PlaneVerifier::new(settings, Matcher { settings: self.seeking.matcher }).look_for(query, target, &window)
    }

    /// For looks at what need not fit.
    pub(super) fn anything(&self) -> VerifySettings {
        VerifySettings { least_score: 0.0, ..self.verify() }
    }

    /// Whether what was seen before, on the way here, speaks against a place. Most of it may have been seen on unknown ground:
    /// little of it needs to fit, but that well.
    fn is_against(&self, seen: &Evidence) -> bool {
        let settings = self.anything();
        is_contradicted(seen, settings.least_inlier_share, settings.most_contradiction)
    }

    /// Whether another place, looked at as closely, is by far the worse explanation. By how much two places differ says
    /// little where both score nearly in full; how much either leaves unexplained says it all.
    fn explains_less(&self, rival: &Sighting, best: &Evidence) -> bool {
        let Some(view) = self.ground.atlas.nearest(rival.map_from_query) else { return false };
        let there = self.look(view, &self.place(view), self.query, rival, self.anything()).evidence;
        let (there, here) = (misfit(&there), misfit(best));
        // All that it has seen fits: other places have to explain as much of it. Of what was seen lately there is less to go by.
        if self.whole { 1.0 - there < RIVAL_SHARE * (1.0 - here) } else { there >= RIVAL_MISFIT * here }
    }
}

/// Whether too little is for a place or too much against it.
pub(super) fn is_contradicted(evidence: &Evidence, least_share: f64, most_contradiction: f64) -> bool {
    evidence.contradiction.is_none_or(|share| share > most_contradiction)
        || evidence.inlier_share.is_none_or(|share| share < least_share)
}

/// Whether what was seen lately and what was seen before as well are found in the same place.
pub(super) fn say_the_same(one: &Finding, other: &Finding) -> bool {
    one.target_from_query.zip(other.target_from_query).is_some_and(|(one, other)| one.distance(other) <= SAME_PLACE_M)
}

/// How closely what was seen lies on the surfaces of a place, and these on all that was seen on the way: the least of these, for
/// a wrong place may fit to the width of a cell, but hardly all the way, and seen from either side, to that of a wall.
pub(super) fn closeness_both_ways(
    target: &PlaneSubmap,
    seen: [Option<(&PlaneSubmap, Pose2)>; 2],
    (since, target_from_since): (&PlaneSubmap, Pose2),
) -> f64 {
    let back = target.closeness(since, target_from_since.inverse());
    seen.into_iter().flatten().map(|(submap, pose)| submap.closeness(target, pose)).fold(back, f64::min)
}

/// How well what is known of a submap fits in another: the share of it that does, by how closely; nothing where little is known.
pub(super) fn fit_of_known(finding: &Finding, query: &PlaneSubmap, target: &PlaneSubmap) -> f64 {
    let Finding { target_from_query, evidence: Evidence { overlap, inlier_share, .. }, .. } = finding;
    let fitting = inlier_share.filter(|_| overlap.is_some_and(|overlap| overlap >= AGAIN_OVERLAP)).unwrap_or(0.0);
    target_from_query.map_or(0.0, |pose| fitting * query.closeness(target, pose))
}

/// The share of what was seen that a place leaves unexplained.
fn misfit(evidence: &Evidence) -> f64 {
    1.0 - evidence.score.unwrap_or(0.0) * evidence.inlier_share.unwrap_or(0.0)
}

impl Place {
    /// Whether a fit is good enough for a robot that has nothing else to go by, be it that it fits elsewhere too: nearly all
    /// points in known territory fit closely, or, of all that was seen, nearly all that is known of either submap fits.
    pub(super) fn is_plain(&self) -> bool {
        let Evidence { score, overlap, inlier_share, .. } = self.finding.evidence;
        let closely = score.zip(overlap).is_some_and(|(score, overlap)| score >= PLAIN_SCORE * overlap);
        let nearly_all = self.whole && inlier_share.is_some_and(|share| share >= PLAIN_SHARE);
        let on_known_ground =
            overlap.is_some_and(|share| share >= if self.whole { WHOLE_OVERLAP } else { PLAIN_OVERLAP });
        !self.common
            && self.closeness >= PLAIN_CLOSENESS
            && self.steady
            && on_known_ground
            && (closely || nearly_all)
            && matches!(self.finding.objection, None | Some(Objection::Ambiguous))
    }
}
