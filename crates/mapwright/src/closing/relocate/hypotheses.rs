//! Places that what a lost robot has seen bears out: one answer says little, a place that lasts says where it is.
//!
//! The best place of all is often another one than the true one as long as half of what was seen lately is unknown; and
//! where much has changed the true one is never plain. But of the places that fit all along, over metres of way, it is
//! the only one: hypotheses are followed from answer to answer, as in multi-hypothesis localisation (Jensfelt and
//! Kristensen 2001).

use super::look::{Look, is_contradicted};
use super::weigh::{WITHOUT, same, target};
use super::{Found, LATELY_M, Sought};
use crate::closing::{Closing, Past, candidate, id};
use mapwright_geom::Pose2;
use mapwright_grid::Matcher;
use mapwright_loops::{Finding, Sighting, VerifySettings};
use mapwright_record::{Evidence, Verdict};

/// Places are looked at from such a share of the full score on, and of the best,
const LEAST_SCORE: f64 = 0.65;
const LEAST_OF_BEST: f64 = 0.75;
/// the best so many, and so many of them closely.
const SIGHTINGS: usize = 24;
const LOOKS: usize = 10;
/// What fits this badly on the coarse map is not looked at closely.
const COARSE: Bounds = Bounds { closely: 0.0, overlap: 0.0, share: 0.78, contradiction: 0.18 };
/// So many hypotheses are followed.
const HOPES: usize = 4;
/// A place that fits so is not given up: what was seen lately, and all that was seen on the way that is kept in mind; there,
/// where nearly all is known, much may have changed since as long as what is left fits the closer.
const TENABLE: [[Bounds; 2]; 2] = [
    [
        Bounds { closely: 0.92, overlap: 0.6, share: 0.8, contradiction: 0.15 },
        Bounds { closely: 0.0, overlap: 0.0, share: 0.83, contradiction: 0.11 },
    ],
    [
        Bounds { closely: 0.96, overlap: 0.85, share: 0.8, contradiction: 0.15 },
        Bounds { closely: 0.0, overlap: 0.0, share: 0.82, contradiction: 0.15 },
    ],
];
/// The same for a place that is believed where it lasts; where all that was seen on the way fits well, less closely.
const CLOSE: [[Bounds; 2]; 3] = [
    [
        Bounds { closely: 0.94, overlap: 0.7, share: 0.82, contradiction: 0.14 },
        Bounds { closely: 0.0, overlap: 0.0, share: 0.86, contradiction: 0.09 },
    ],
    [
        Bounds { closely: 0.97, overlap: 0.85, share: 0.8, contradiction: 0.15 },
        Bounds { closely: 0.0, overlap: 0.0, share: 0.83, contradiction: 0.13 },
    ],
    [
        Bounds { closely: 0.92, overlap: 0.9, share: 0.85, contradiction: 0.1 },
        Bounds { closely: 0.0, overlap: 0.0, share: 0.9, contradiction: 0.06 },
    ],
];
/// Answers are kept for so much way, metres.
const KEPT_M: f64 = 10.0;
/// A place is believed that has lasted for so much way, metres, and fitted closely so often;
const LASTED_M: f64 = 1.5;
const CLOSELY: usize = 4;
/// mostly, or for so much way, metres, at least in one answer of three.
const LONGER_M: f64 = 3.0;
/// Whatever the robot has seen before, it is not chance for so much way, metres, and so often.
const WHATEVER_M: f64 = 8.0;
const WHATEVER: usize = 10;

/// What a fit has to come up to.
struct Bounds {
    /// The score as a share of the overlap,
    closely: f64,
    overlap: f64,
    /// of what is known, what fits,
    share: f64,
    /// and of all, what speaks against it at most.
    contradiction: f64,
}

impl Bounds {
    fn hold(&self, evidence: &Evidence) -> bool {
        let [score, overlap] = [evidence.score, evidence.overlap].map(Option::unwrap_or_default);
        overlap >= self.overlap
            && score >= self.closely * overlap
            && !is_contradicted(evidence, self.share, self.contradiction)
    }
}

/// A place that what was seen bears out.
#[derive(Debug, Clone)]
pub(crate) struct Hypothesis {
    /// The old keyframe nearest to it.
    pub(crate) from: u32,
    finding: Finding,
    map_from_query: Pose2,
    is_close: bool,
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
    /// The places that what was seen lately bears out, those that earlier answers have found first.
    pub(super) fn hypotheses(&self) -> Vec<Hypothesis> {
        let atlas = &self.ground.atlas;
        let mut matcher = Matcher { settings: self.seeking.matcher };
        let hopes = self.seeking.hopes.iter().map(|hope| hope.map_from_aside * self.seeking.aside_from_query);
        let sightings = atlas.sightings(self.query, LEAST_SCORE, LEAST_OF_BEST, SIGHTINGS);
        let (mut looked_at, mut hypotheses): (Vec<Pose2>, Vec<Hypothesis>) = (Vec::new(), Vec::new());
        for near in hopes.chain(sightings.iter().map(|sighting| sighting.map_from_query)) {
            let (map_from_query, agreement) = atlas.refine(self.query, near, &mut matcher);
            let contradiction = f64::from(agreement.contradicting) / self.query.hits.len().max(1) as f64;
            let hopeless = agreement.inlier_share() < COARSE.share || contradiction > COARSE.contradiction;
            if hopeless || looked_at.iter().any(|&other| same(other, map_from_query, Pose2::IDENTITY)) {
                continue;
            }
            looked_at.push(map_from_query);
            let hypothesis = self.look_closely(map_from_query);
            let is_new = |new: &Hypothesis| {
                !hypotheses.iter().any(|old| same(old.map_from_query, new.map_from_query, Pose2::IDENTITY))
            };
            if let Some(hypothesis) = hypothesis.filter(is_new) {
                hypotheses.push(hypothesis);
            }
            if looked_at.len() >= LOOKS {
                break;
            }
        }
        hypotheses
    }

    fn look_closely(&self, map_from_query: Pose2) -> Option<Hypothesis> {
        let view = self.ground.atlas.nearest(map_from_query)?;
        let target = self.place(view);
        let near = Sighting { map_from_query, score: 0.0 };
        let settings = VerifySettings { least_score: 0.0, ..VerifySettings::default() };
        let finding = self.look(view, &target, self.query, &near, settings);
        let lately = TENABLE.iter().any(|[lately, _]| lately.hold(&finding.evidence));
        let map_from_query = self.ground.atlas.map_from_view(view) * finding.target_from_query.filter(|_| lately)?;
        let since = self.look(view, &target, self.since, &near, self.anything()).evidence;
        let is = |bounds: &[[Bounds; 2]]| {
            bounds.iter().any(|bounds| bounds[0].hold(&finding.evidence) && bounds[1].hold(&since))
        };
        let (is_tenable, is_close) = (is(&TENABLE), is(&CLOSE));
        let is_unlikely = || {
            let hope = self.seeking.hopes.iter().find(|hope| {
                same(hope.map_from_aside * self.seeking.aside_from_query, map_from_query, Pose2::IDENTITY)
            });
            let score = finding.evidence.score.unwrap_or(0.0);
            self.is_common(&Sighting { map_from_query, score })
                || self.was_there(map_from_query, hope.map_or(0.0, |hope| hope.way_m).max(LATELY_M))
        };
        let from = self.ground.nodes[view];
        is_tenable.then(|| Hypothesis {
            from,
            finding,
            map_from_query,
            is_close,
            is_unlikely: is_close && is_unlikely(),
        })
    }
}

/// What an answer leaves standing.
#[derive(Debug, Clone)]
pub(crate) struct Heard {
    to: u32,
    standing: Vec<Standing>,
}

/// A hypothesis of an answer.
#[derive(Debug, Clone, Copy)]
struct Standing {
    map_from_aside: Pose2,
    is_close: bool,
    is_unlikely: bool,
}

impl Heard {
    /// Whether no place was left.
    pub(crate) fn is_nowhere(&self) -> bool {
        self.standing.is_empty()
    }

    fn of(&self, map_from_aside: Pose2, here: Pose2) -> Option<Standing> {
        self.standing.iter().find(|other| same(other.map_from_aside, map_from_aside, here)).copied()
    }
}

/// The answers that have a place standing, the latest first, but for single ones between them.
fn run_of(heard: &[Heard], map_from_aside: Pose2, here: Pose2) -> Vec<(&Heard, Standing)> {
    let mut missed = 0;
    let known = heard.iter().rev().map_while(|answer| {
        let standing = answer.of(map_from_aside, here);
        missed = if standing.is_some() { 0 } else { missed + 1 };
        (missed < 2).then_some(standing.map(|standing| (answer, standing)))
    });
    known.flatten().collect()
}

/// What is to be looked at again.
pub(crate) fn hopes(sought: Past<'_>, heard: &[Heard], way_m: impl Fn(u32, u32) -> f64) -> Vec<Hope> {
    let mut hopes: Vec<Hope> = Vec::new();
    let Some((to, &here)) = sought.local_from_keyframe.iter().enumerate().next_back() else { return hopes };
    for standing in heard.iter().rev().take(3).flat_map(|answer| &answer.standing) {
        let Standing { map_from_aside, .. } = *standing;
        if hopes.len() < HOPES && !hopes.iter().any(|hope| same(hope.map_from_aside, map_from_aside, here)) {
            let first = run_of(heard, map_from_aside, here).last().map(|(first, _)| first.to);
            let way_m = first.map_or(0.0, |first| way_m(first, to as u32));
            hopes.push(Hope { map_from_aside, way_m });
        }
    }
    hopes
}

impl Closing {
    /// Takes down what an answer leaves standing; the place, once it has lasted and is the only one that has. `way_m` is
    /// the way between two keyframes that were made aside.
    pub(crate) fn follow(
        &mut self,
        past: Past<'_>,
        sought: Past<'_>,
        answer: &Sought,
        heard: &mut Vec<Heard>,
        way_m: impl Fn(u32, u32) -> f64,
    ) -> Option<Found> {
        let newest = past.keyframes.len().checked_sub(1)? as u32;
        let here = sought.local_from_keyframe[answer.to as usize];
        heard.retain(|other| way_m(other.to, answer.to) <= KEPT_M);
        let standing = |hypothesis: &Hypothesis| {
            let Hypothesis { map_from_query, is_close, is_unlikely, .. } = *hypothesis;
            Standing { map_from_aside: map_from_query * here.inverse(), is_close, is_unlikely }
        };
        heard.push(Heard { to: answer.to, standing: answer.hypotheses.iter().map(standing).collect() });
        for hypothesis in answer.hypotheses.iter().filter(|hypothesis| hypothesis.is_close) {
            let run = run_of(heard, standing(hypothesis).map_from_aside, here);
            let span_m = run.last().map_or(0.0, |(first, _)| way_m(first.to, answer.to));
            if !(lasts(&run, span_m) && is_only(&run, here)) {
                continue;
            }
            let Hypothesis { from, finding, .. } = *hypothesis;
            let mut candidate = candidate(&target(from), newest, &finding);
            (candidate.verdict, candidate.evidence.agreeing) = (Verdict::Accepted, run.len() as u32 - 1);
            candidate.to = id(newest + 1);
            self.candidates.push(candidate);
            let from_from_to = finding.target_from_query?;
            return Some(Found { from, to: answer.to, from_from_to, covariance: finding.covariance });
        }
        None
    }
}

/// Whether a place has been standing for long enough, and fitted closely often enough.
fn lasts(run: &[(&Heard, Standing)], span_m: f64) -> bool {
    let count = |is: fn(&Standing) -> bool| run.iter().filter(|(_, standing)| is(standing)).count();
    let closely = count(|standing| standing.is_close);
    let likely = count(|standing| standing.is_close && !standing.is_unlikely);
    let mostly = 3 * closely >= 2 * run.len();
    let often = mostly || (span_m >= LONGER_M && 3 * closely >= run.len());
    (likely >= CLOSELY && 3 * likely >= 2 * closely && span_m >= LASTED_M && often)
        || (closely >= WHATEVER && span_m >= WHATEVER_M && mostly)
}

/// Whether every other place that stood meanwhile is missing from enough of the answers.
fn is_only(run: &[(&Heard, Standing)], here: Pose2) -> bool {
    let without = |other: Pose2| run.iter().filter(|(answer, _)| answer.of(other, here).is_none()).count();
    run.iter().all(|(answer, this)| {
        answer.standing.iter().all(|other| {
            same(other.map_from_aside, this.map_from_aside, here)
                || without(other.map_from_aside) >= WITHOUT.max(run.len() / 3)
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
    /// as `t`.
    fn heard(answers: &[&[&str]]) -> Vec<Heard> {
        let standing = |(k, what): (usize, &&str)| {
            let map_from_aside = place(k);
            (*what != "-").then_some(Standing { map_from_aside, is_close: *what != "t", is_unlikely: *what == "u" })
        };
        let answer = |(to, places): (usize, &&[&str])| {
            let standing = places.iter().enumerate().filter_map(standing).collect();
            Heard { to: to as u32, standing }
        };
        answers.iter().enumerate().map(answer).collect()
    }

    fn is_home(answers: &[&[&str]]) -> bool {
        let heard = heard(answers);
        let run = run_of(&heard, place(0), HERE);
        let span_m = run.last().map_or(0.0, |(first, _)| 0.25 * f64::from(heard.len() as u32 - 1 - first.to));
        lasts(&run, span_m) && is_only(&run, HERE)
    }

    #[test]
    fn a_place_that_lasts_is_believed() {
        let close: &[&str] = &["c"];
        assert!(is_home(&[close; 7]));
        assert!(!is_home(&[close; 6]), "it has not lasted yet");
        assert!(is_home(&[close, close, &["-"], close, close, close, &["t"], close]), "single answers may miss it");
        assert!(!is_home(&[close, close, close, close, &[], &[], close, close, close]), "two in a row may not");
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
    }

    #[test]
    fn a_place_where_it_would_have_been_found_before_has_to_last_whatever() {
        let unlikely: &[&str] = &["u"];
        assert!(!is_home(&[unlikely; 32]) && is_home(&[unlikely; 33]));
    }

    #[test]
    fn each_bound_counts() {
        let fit = |score, overlap, inlier_share, contradiction| Evidence {
            score: Some(score),
            overlap: Some(overlap),
            inlier_share: Some(inlier_share),
            contradiction: Some(contradiction),
            ..Evidence::default()
        };
        let bounds = &CLOSE[0][0];
        assert!(bounds.hold(&fit(0.8, 0.8, 0.9, 0.1)));
        for worse in
            [fit(0.7, 0.8, 0.9, 0.1), fit(0.69, 0.69, 0.9, 0.1), fit(0.8, 0.8, 0.81, 0.1), fit(0.8, 0.8, 0.9, 0.15)]
        {
            assert!(!bounds.hold(&worse), "{worse:?}");
        }
        assert!(!bounds.hold(&Evidence::default()));
    }
}
