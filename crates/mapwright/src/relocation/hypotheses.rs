//! Places that what a lost robot has seen bears out: one answer says little, a place that lasts says where it is.
//!
//! The best place of all is often another one than the true one as long as half of what was seen lately is unknown; and
//! where much has changed the true one is never plain. But of the places that fit all along, over metres of way, it is
//! the only one: hypotheses are followed from answer to answer, as in multi-hypothesis localisation (Jensfelt and
//! Kristensen 2001).

use super::look::{Look, WHOLE_OVERLAP, closeness_both_ways, fit_of_known, is_contradicted, say_the_same};
use super::weigh::{WITHOUT, same, target};
use super::{Found, LATELY_M, Seeking, Sought};
use mapwright_geom::Pose2;
use mapwright_grid::{Agreement, Matcher};
use mapwright_loops::{Finding, Judged, PlaneSubmap, Sighting, VerifySettings};
use mapwright_record::{Evidence, NodeId, Past, Verdict};
use std::cell::LazyCell;

/// Places are looked at from such a share of the full score on, and of the best,
const LEAST_SCORE: f64 = 0.65;
const LEAST_OF_BEST: f64 = 0.75;
/// the best so many, and so many of them closely.
const SIGHTINGS: usize = 48;
const LOOKS_AT_MOST: usize = 10;
/// A point that speaks against a place outweighs so many that fit.
const CONTRADICTION_WEIGHT: f64 = 3.0;
/// What fits this badly on the coarse map is not looked at closely.
const COARSE: Bounds = Bounds { overlap: 0.0, share: 0.75, contradiction: 0.2 };
/// From here on surfaces lie where they should, not near.
const EXACT_CLOSENESS: f64 = 0.86;
/// So many hypotheses are followed.
const HOPES: usize = 4;
/// A place that fits so is not given up: what was seen lately, and all that was seen on the way that is kept in mind; where
/// much has changed, what is left must fit the closer.
const TENABLE: [Fitting; 2] = [
    Fitting {
        closeness: 0.74,
        lately: Bounds { overlap: 0.6, share: 0.8, contradiction: 0.15 },
        since: Bounds { overlap: 0.0, share: 0.82, contradiction: 0.15 },
    },
    Fitting {
        closeness: 0.86,
        lately: Bounds { overlap: 0.6, share: 0.76, contradiction: 0.17 },
        since: Bounds { overlap: 0.0, share: 0.76, contradiction: 0.17 },
    },
];
/// The same for a place that is believed where it lasts.
const CLOSE: [Fitting; 2] = [
    Fitting {
        closeness: 0.8,
        lately: Bounds { overlap: 0.6, share: 0.86, contradiction: 0.09 },
        since: Bounds { overlap: 0.0, share: 0.84, contradiction: 0.11 },
    },
    Fitting {
        closeness: EXACT_CLOSENESS,
        lately: Bounds { overlap: 0.6, share: 0.78, contradiction: 0.15 },
        since: Bounds { overlap: 0.0, share: 0.78, contradiction: 0.15 },
    },
];
/// Answers are kept for so much way, metres.
const KEPT_M: f64 = 10.0;
/// It may be missing from one answer, and from two in a row or more for each so many in which it stood, up to so many.
const STOOD_FOR_EACH_MISSED: usize = 6;
const MISSED_AT_MOST: usize = 3;
/// A place is believed that has lasted for so much way, metres, the longer where less than this share of what was seen lately
/// is known, the less so where it mostly fits exactly, and fitted closely so often;
const LASTED_M: f64 = 1.5;
const LASTED_LITTLE_KNOWN_M: f64 = 4.0;
const LASTED_EXACTLY_M: f64 = 2.5;
const LITTLE_KNOWN: f64 = 0.8;
const CLOSELY: usize = 4;
/// mostly, or for so much way, metres, at least in one answer of three.
const LONGER_M: f64 = 3.0;
/// Another place is its rival where it explains such a share of what the place does.
const RIVAL_SHARE: f64 = 0.9;
/// Whatever the robot has seen before, it is not chance for so much way, metres, and so often.
const NO_CHANCE_AFTER_M: f64 = 8.0;
const NO_CHANCE_AFTER_ANSWERS: usize = 10;

/// What has to fit, and how well.
struct Bounds {
    overlap: f64,
    /// Of what is known, what fits,
    share: f64,
    /// and of all, what speaks against it at most.
    contradiction: f64,
}

impl Bounds {
    fn hold(&self, evidence: &Evidence) -> bool {
        evidence.overlap.is_some_and(|overlap| overlap >= self.overlap)
            && !is_contradicted(evidence, self.share, self.contradiction)
    }
}

/// What a place has to come up to.
struct Fitting {
    /// How closely surfaces lie on those of the other submap, as a share of how closely they lie on their own.
    closeness: f64,
    lately: Bounds,
    since: Bounds,
}

impl Fitting {
    fn holds(&self, closeness: f64, lately: &Evidence, since: &Evidence) -> bool {
        closeness >= self.closeness && self.lately.hold(lately) && self.since.hold(since)
    }
}

/// How what was seen fits at a place that it bears out.
#[derive(Debug, Clone)]
struct Fit {
    /// The old keyframe nearest to it.
    from: NodeId,
    finding: Finding,
    map_from_query: Pose2,
    closeness: f64,
    fit_of_known: f64,
    is_close: bool,
}

impl Fit {
    fn standing(&self, aside_from_query: Pose2, is_unlikely: bool) -> Standing {
        let Evidence { overlap, inlier_share, .. } = self.finding.evidence;
        let [overlap, fitting] = [overlap, inlier_share].map(Option::unwrap_or_default);
        Standing {
            map_from_aside: self.map_from_query * aside_from_query.inverse(),
            overlap,
            explains: overlap * fitting * self.closeness,
            is_close: self.is_close,
            is_exact: self.closeness >= EXACT_CLOSENESS,
            is_unlikely,
        }
    }
}

/// A place that what was seen bears out.
#[derive(Debug, Clone)]
pub(crate) struct Hypothesis {
    fit: Fit,
    is_unlikely: bool,
}

/// Where the robot may be by earlier answers.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Hope {
    map_from_aside: Pose2,
    /// For how much way it has been, metres.
    way_m: f64,
}

impl Look<'_> {
    /// The places that what was seen lately bears out: those that earlier answers have found, and of the others first what
    /// fits without much that speaks against it, however much of it is known. And where they stood before.
    pub(super) fn hypotheses(&self) -> (Vec<Hypothesis>, Vec<Heard>) {
        let mut matcher = Matcher { settings: self.seeking.matcher };
        let mut refine = |near: Pose2| self.ground.atlas.refine(self.query, near, &mut matcher);
        let hopes = self.seeking.hopes.iter().map(|hope| refine(hope.map_from_aside * self.seeking.aside_from_query));
        let mut places: Vec<(Pose2, Agreement)> = hopes.collect();
        let sightings = self.ground.atlas.sightings(self.query, self.effort, (LEAST_SCORE, LEAST_OF_BEST), SIGHTINGS);
        let mut others: Vec<(Pose2, Agreement)> =
            sightings.iter().map(|sighting| refine(sighting.map_from_query)).collect();
        let speaks_for = |(_, there): &(Pose2, Agreement)| {
            f64::from(there.fitting) - CONTRADICTION_WEIGHT * f64::from(there.contradicting)
        };
        others.sort_by(|a, b| speaks_for(b).total_cmp(&speaks_for(a)));
        places.append(&mut others);
        let (mut looked_at, mut fits): (Vec<Pose2>, Vec<Fit>) = (Vec::new(), Vec::new());
        for (map_from_query, there) in places {
            let contradiction = f64::from(there.contradicting) / self.query.hits.len().max(1) as f64;
            let hopeless = there.inlier_share() < COARSE.share || contradiction > COARSE.contradiction;
            if hopeless || looked_at.iter().any(|&other| same(other, map_from_query, Pose2::IDENTITY)) {
                continue;
            }
            looked_at.push(map_from_query);
            let fit = self.fit(self.query, self.since, map_from_query);
            let is_new =
                |new: &Fit| !fits.iter().any(|old| same(old.map_from_query, new.map_from_query, Pose2::IDENTITY));
            if let Some(fit) = fit.filter(is_new) {
                fits.push(fit);
            }
            if looked_at.len() >= LOOKS_AT_MOST {
                break;
            }
        }
        self.stand(&fits)
    }

    /// How what was seen fits near a pose in the map, where that bears it out.
    fn fit(&self, query: &PlaneSubmap, since: &PlaneSubmap, map_from_query: Pose2) -> Option<Fit> {
        let view = self.ground.atlas.nearest(map_from_query)?;
        let target = self.place(view);
        let near = Sighting { map_from_query, score: 0.0 };
        let settings = VerifySettings { least_score: 0.0, ..VerifySettings::default() };
        let finding = self.look(view, &target, query, &near, settings);
        let lately = finding.evidence;
        let target_from_query =
            finding.target_from_query.filter(|_| TENABLE.iter().any(|fitting| fitting.lately.hold(&lately)))?;
        let map_from_query = self.ground.atlas.map_from_view(view) * target_from_query;
        let all = self.look(view, &target, since, &near, self.anything());
        let steady = say_the_same(&finding, &all);
        let (target_from_since, all) = (all.target_from_query?, all.evidence);
        let since = (since, target_from_since);
        let closeness = closeness_both_ways(&target, [Some((query, target_from_query)), Some(since)], since);
        let is = |fitting: &Fitting| fitting.holds(closeness, &lately, &all);
        // Who may never have left known ground knows nearly all that it has seen, or comes from elsewhere.
        let on_known_ground = all.overlap.is_some_and(|share| share >= WHOLE_OVERLAP);
        (TENABLE.iter().any(is) && (on_known_ground || !self.seeking.whole)).then(|| Fit {
            from: self.ground.nodes[view],
            finding,
            map_from_query,
            closeness,
            fit_of_known: fit_of_known(&finding, query, &target),
            is_close: steady && CLOSE.iter().any(is),
        })
    }

    /// Fits as hypotheses, and where they stood before: all of them since the last answer, those that it did not know also
    /// earlier.
    fn stand(&self, fits: &[Fit]) -> (Vec<Hypothesis>, Vec<Heard>) {
        let Seeking { aside_from_query, submaps, .. } = self.seeking;
        let mut heard: Vec<Heard> = Vec::new();
        let mut earlier = vec![Vec::new(); fits.len()];
        for before in self.seeking.earlier.iter().filter(|_| !fits.is_empty()) {
            let queries =
                LazyCell::new(|| [&before.lately, &before.since].map(|views| PlaneSubmap::new(views, submaps)));
            for (fit, earlier) in fits.iter().zip(&mut earlier) {
                let near = fit.map_from_query * aside_from_query.between(before.aside_from_query);
                let is_known = before.answered && self.hope(fit).is_some();
                let there = (!is_known).then(|| self.fit(&queries[0], &queries[1], near)).flatten();
                earlier.push(there.filter(|there| same(there.map_from_query, near, Pose2::IDENTITY)));
            }
            heard.push(Heard { to: before.to, standing: Vec::new() });
        }
        let stand = |(fit, earlier): (&Fit, Vec<Option<Fit>>)| {
            let is_close = fit.is_close || earlier.iter().flatten().any(|there| there.is_close);
            let is_unlikely = is_close && self.is_unlikely_place(fit);
            for ((before, heard), there) in self.seeking.earlier.iter().zip(&mut heard).zip(&earlier) {
                heard.standing.extend(there.as_ref().map(|there| there.standing(before.aside_from_query, is_unlikely)));
            }
            Hypothesis { fit: fit.clone(), is_unlikely }
        };
        let hypotheses = fits.iter().zip(earlier).map(stand).collect();
        (hypotheses, heard)
    }

    /// Whether such a place is common in what was seen before, or the robot would have been found there.
    fn is_unlikely_place(&self, fit: &Fit) -> bool {
        self.is_common(fit.finding.evidence.score.unwrap_or(0.0), fit.fit_of_known)
            || self.was_there(fit.map_from_query, self.hope(fit).map_or(0.0, |hope| hope.way_m).max(LATELY_M))
    }

    /// What earlier answers made of a place.
    fn hope(&self, fit: &Fit) -> Option<&Hope> {
        let is = |hope: &&Hope| {
            same(hope.map_from_aside * self.seeking.aside_from_query, fit.map_from_query, Pose2::IDENTITY)
        };
        self.seeking.hopes.iter().find(is)
    }
}

/// What an answer leaves standing.
#[derive(Debug, Clone)]
pub(crate) struct Heard {
    to: NodeId,
    standing: Vec<Standing>,
}

/// A hypothesis of an answer.
#[derive(Debug, Clone, Copy)]
struct Standing {
    map_from_aside: Pose2,
    /// The share of what was seen lately that is known there, and that it explains.
    overlap: f64,
    explains: f64,
    is_close: bool,
    is_exact: bool,
    is_unlikely: bool,
}

impl Heard {
    /// The newest keyframe that was asked about.
    pub(crate) fn to(&self) -> NodeId {
        self.to
    }

    /// Whether no place was left.
    pub(crate) fn is_nowhere(&self) -> bool {
        self.standing.is_empty()
    }

    fn of(&self, map_from_aside: Pose2, here: Pose2) -> Option<Standing> {
        self.standing.iter().find(|other| same(other.map_from_aside, map_from_aside, here)).copied()
    }
}

/// Takes in what stood already.
fn merge(heard: &mut Vec<Heard>, earlier: &Heard, here: Pose2) {
    if heard.last().is_none_or(|last| last.to < earlier.to) {
        heard.push(earlier.clone());
    } else if let Some(answer) = heard.iter_mut().find(|answer| answer.to == earlier.to) {
        for standing in &earlier.standing {
            if answer.of(standing.map_from_aside, here).is_none() {
                answer.standing.push(*standing);
            }
        }
    }
}

/// The answers that have a place standing, the latest first, but for a few in a row between them: one, or the more the longer
/// it had been standing.
fn run_of(heard: &[Heard], map_from_aside: Pose2, here: Pose2) -> Vec<(&Heard, Standing)> {
    let (mut run, mut missed) = (Vec::new(), 0);
    for answer in heard {
        if let Some(standing) = answer.of(map_from_aside, here) {
            missed = 0;
            run.push((answer, standing));
        } else {
            missed += 1;
            if missed > (run.len() / STOOD_FOR_EACH_MISSED).clamp(1, MISSED_AT_MOST) {
                run.clear();
            }
        }
    }
    run.reverse();
    run
}

/// What is to be looked at again.
pub(crate) fn hopes(sought: Past<'_>, heard: &[Heard]) -> Vec<Hope> {
    let mut hopes: Vec<Hope> = Vec::new();
    let Some((to, &here)) = sought.local_from_keyframe.iter().enumerate().next_back() else { return hopes };
    for standing in heard.iter().rev().take(MISSED_AT_MOST).flat_map(|answer| &answer.standing) {
        let Standing { map_from_aside, .. } = *standing;
        if hopes.len() < HOPES && !hopes.iter().any(|hope| same(hope.map_from_aside, map_from_aside, here)) {
            let first = run_of(heard, map_from_aside, here).last().map(|(first, _)| first.to);
            let way_m = first.map_or(0.0, |first| sought.way_between_m(first, NodeId::at(to)));
            hopes.push(Hope { map_from_aside, way_m });
        }
    }
    hopes
}

/// Takes down what an answer leaves standing; the place, once it has lasted and is the only one that has, and what was found of
/// it as a candidate.
pub(crate) fn follow(
    past: Past<'_>,
    sought: Past<'_>,
    answer: &Sought,
    heard: &mut Vec<Heard>,
) -> Option<(Judged, Found)> {
    let newest = past.newest()?;
    let here = sought.pose(answer.to);
    let way_m = |a: NodeId, b: NodeId| sought.way_between_m(a, b);
    heard.retain(|other| way_m(other.to, answer.to) <= KEPT_M);
    let hypotheses = answer.hypotheses.as_ref()?;
    for earlier in answer.earlier.iter().filter(|earlier| earlier.to < answer.to) {
        merge(heard, earlier, here);
    }
    let standing = |hypothesis: &Hypothesis| hypothesis.fit.standing(here, hypothesis.is_unlikely);
    heard.push(Heard { to: answer.to, standing: hypotheses.iter().map(standing).collect() });
    for hypothesis in hypotheses.iter().filter(|hypothesis| hypothesis.fit.is_close) {
        let run = run_of(heard, standing(hypothesis).map_from_aside, here);
        let span_m = run.last().map_or(0.0, |(first, _)| way_m(first.to, answer.to));
        if !(lasts(&run, span_m) && is_only(&run, here)) {
            continue;
        }
        let Fit { from, finding, .. } = hypothesis.fit;
        let mut judged = target(from).judged(newest.next(), &finding);
        (judged.verdict, judged.evidence.agreeing) = (Verdict::Accepted, run.len() as u32 - 1);
        let from_from_to = finding.target_from_query?;
        return Some((judged, Found { from, to: answer.to, from_from_to, covariance: finding.covariance }));
    }
    None
}

/// Whether a place has been standing for long enough, and fitted closely often enough.
fn lasts(run: &[(&Heard, Standing)], span_m: f64) -> bool {
    let count = |is: fn(&Standing) -> bool| run.iter().filter(|(_, standing)| is(standing)).count();
    let closely = count(|standing| standing.is_close);
    let likely = count(|standing| standing.is_close && !standing.is_unlikely);
    let mostly = 3 * closely >= 2 * run.len();
    let often = mostly || (span_m >= LONGER_M && 3 * closely >= run.len());
    let little_known = run.first().is_none_or(|(_, latest)| latest.overlap < LITTLE_KNOWN);
    let exactly = count(|standing| standing.is_close && standing.is_exact);
    let lasted_m = match (little_known, 3 * exactly >= 2 * closely) {
        (false, _) => LASTED_M,
        (true, true) => LASTED_EXACTLY_M,
        (true, false) => LASTED_LITTLE_KNOWN_M,
    };
    (likely >= CLOSELY && 3 * likely >= 2 * closely && span_m >= lasted_m && often)
        || (closely >= NO_CHANCE_AFTER_ANSWERS && span_m >= NO_CHANCE_AFTER_M && mostly)
}

/// Whether no other place explains as much now, and every one that did meanwhile is missing from enough of the answers.
fn is_only(run: &[(&Heard, Standing)], here: Pose2) -> bool {
    let rivals = |other: &Standing, this: &Standing| other.explains >= RIVAL_SHARE * this.explains;
    let without = |other: Pose2| {
        let lacks =
            |(answer, this): &&(&Heard, Standing)| answer.of(other, here).is_none_or(|other| !rivals(&other, this));
        run.iter().filter(lacks).count()
    };
    run.iter().enumerate().all(|(back, (answer, this))| {
        answer.standing.iter().all(|other| {
            same(other.map_from_aside, this.map_from_aside, here)
                || !rivals(other, this)
                || (back > 0 && without(other.map_from_aside) >= WITHOUT.max(run.len() / 3))
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const HERE: Pose2 = Pose2 { x: 3.0, y: 1.0, theta: 0.3 };

    fn place(k: usize) -> Pose2 {
        Pose2::new(5.0 * k as f64, -2.0, 0.1)
    }

    /// Answers every quarter of a metre; for each the places that stand, close ones as `c`, unlikely ones as `u`, tenable ones
    /// as `t`, close ones of which little is known as `l`, exact ones as `e`, which explain less.
    fn heard(answers: &[&[&str]]) -> Vec<Heard> {
        let standing = |(k, what): (usize, &&str)| {
            let map_from_aside = place(k);
            let overlap = if "le".contains(what) { 0.7 } else { 0.9 };
            (*what != "-").then_some(Standing {
                map_from_aside,
                overlap,
                explains: 0.9 * overlap,
                is_close: *what != "t",
                is_exact: *what == "e",
                is_unlikely: *what == "u",
            })
        };
        let answer = |(to, places): (usize, &&[&str])| {
            let standing = places.iter().enumerate().filter_map(standing).collect();
            Heard { to: NodeId::at(to), standing }
        };
        answers.iter().enumerate().map(answer).collect()
    }

    fn is_home(answers: &[&[&str]]) -> bool {
        let heard = heard(answers);
        let run = run_of(&heard, place(0), HERE);
        let span_m = run.last().map_or(0.0, |(first, _)| 0.25 * (heard.len() - 1 - first.to.index()) as f64);
        lasts(&run, span_m) && is_only(&run, HERE)
    }

    #[test]
    fn a_place_that_lasts_is_believed() {
        let close: &[&str] = &["c"];
        assert!(is_home(&[close; 7]));
        assert!(!is_home(&[close; 6]), "it has not lasted yet");
        assert!(is_home(&[close, close, &["-"], close, close, close, &["t"], close]), "single answers may miss it");
        assert!(!is_home(&[close, close, close, close, &[], &[], close, close, close]), "two in a row may not");
        let none: &[&str] = &[];
        let after = |stood: usize, missed: usize| [vec![close; stood], vec![none; missed], vec![close]].concat();
        assert!(is_home(&after(12, 2)) && !is_home(&after(11, 2)), "unless it has lasted for long");
        assert!(is_home(&after(18, 3)) && !is_home(&after(30, 4)));
    }

    #[test]
    fn a_place_of_which_little_is_known_has_to_last_longer() {
        let little: &[&str] = &["l"];
        assert!(!is_home(&[little; 16]) && is_home(&[little; 17]));
        let exact: &[&str] = &["e"];
        assert!(!is_home(&[exact; 10]) && is_home(&[exact; 11]), "not for so long where it fits exactly,");
        let mixed: [&[&str]; 12] = std::array::from_fn(|k| if k % 2 == 0 { exact } else { little });
        assert!(!is_home(&mixed), "mostly");
        assert!(is_home(&[little, little, &["c"], &["c"], &["c"], &["c"], &["c"]]), "it is known by now");
    }

    #[test]
    fn a_place_that_explains_less_is_no_rival() {
        assert!(is_home(&[["c", "l"].as_slice(); 7]));
        assert!(!is_home(&[["l", "c"].as_slice(); 12]), "the other way round it is one");
    }

    #[test]
    fn a_place_that_fits_at_times_has_to_last_longer() {
        let at_times: [&[&str]; 13] = std::array::from_fn(|k| if k % 2 == 0 { &["c"] as &[&str] } else { &["t"] });
        assert!(!is_home(&at_times[..9]) && is_home(&at_times));
        assert!(!is_home(&[["t"].as_slice(); 20]), "none is close");
    }

    #[test]
    fn another_place_that_lasts_as_long_is_its_rival() {
        let both: &[&str] = &["c", "t"];
        let one: &[&str] = &["c", "-"];
        assert!(!is_home(&[both; 12]));
        assert!(!is_home(&[both, both, both, both, both, both, both, both, one]), "one answer without it is chance");
        assert!(is_home(&[both, both, both, both, both, one, one, one, one]));
        assert!(!is_home(&[one, one, one, one, one, one, one, one, both]), "now it stands");
    }

    #[test]
    fn a_place_where_it_would_have_been_found_before_has_to_last_whatever() {
        let unlikely: &[&str] = &["u"];
        assert!(!is_home(&[unlikely; 32]) && is_home(&[unlikely; 33]));
    }

    #[test]
    fn what_stood_already_is_taken_in() {
        let mut known = heard(&[&["c"], &["t"]]);
        known[1].to = NodeId::new(3);
        let [one, two]: [&[&str]; 2] = [&["c"], &["c", "c"]];
        for (to, places) in [(0, two), (1, one), (3, two), (4, one)] {
            let standing = heard(&[places]).swap_remove(0).standing;
            merge(&mut known, &Heard { to: NodeId::new(to), standing }, HERE);
        }
        let stood: Vec<(usize, usize)> =
            known.iter().map(|answer| (answer.to.index(), answer.standing.len())).collect();
        assert_eq!(stood, [(0, 2), (3, 2), (4, 1)], "what lies between answers without one of its own is left");
        assert!(!known[1].standing[0].is_close, "what an answer has found stays");
    }

    #[test]
    fn each_bound_counts() {
        let fit = |overlap, inlier_share, contradiction| Evidence {
            overlap: Some(overlap),
            inlier_share: Some(inlier_share),
            contradiction: Some(contradiction),
            ..Evidence::default()
        };
        let (good, bounds) = (fit(0.8, 0.9, 0.08), &CLOSE[0]);
        assert!(bounds.holds(0.85, &good, &good));
        assert!(!bounds.holds(0.79, &good, &good), "not closely");
        for worse in [fit(0.8, 0.81, 0.08), fit(0.8, 0.9, 0.12)] {
            assert!(!bounds.holds(0.85, &worse, &good) && !bounds.holds(0.85, &good, &worse), "{worse:?}");
        }
        let little = fit(0.5, 0.9, 0.08);
        assert!(
            !bounds.holds(0.85, &little, &good) && bounds.holds(0.85, &good, &little),
            "what is new may be elsewhere"
        );
        assert!(!bounds.holds(0.85, &Evidence::default(), &good));
    }
}
