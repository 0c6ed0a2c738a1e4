//! Whether a map can be used: good, to be checked, or unusable, and why. What decides is told by the run and the map themselves, without
//! a reference (docs/decisions/0027-verdict.md).

use crate::hanging::Hanging;
use crate::tally::Tally;
use crate::terminal::{count, metres};
use crate::turns::Turns;
use crate::wheels::Wheels;
use mapwright::{Advice, EdgeKind, Objection, Pose2, SeparateMap, Session, Stamp, Status, Verdict as Judged, Visits};
use mapwright_geom::Pose;
use mapwright_record::Measurement;
use serde::Serialize;
use serde_json::{Value, json};

/// What a user is told first.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum Usability {
    Good,
    Check,
    Unusable,
}

impl Usability {
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Check => "check",
            Self::Unusable => "unusable",
        }
    }
}

/// What was seen of a run and its map.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Facts {
    pub(crate) scans: u64,
    pub(crate) keyframes: usize,
    /// Share of the scans in the log that could not be used.
    pub(crate) unused: f64,
    /// Shares of the scans.
    pub(crate) degraded: f64,
    pub(crate) lost: f64,
    pub(crate) median_inlier_share: f64,
    /// Share of the keyframes that are not in the first map.
    pub(crate) elsewhere: f64,
    /// Pieces of the first map that odometry over a break alone holds.
    pub(crate) on_odometry: usize,
    /// What a single step of odometry holds.
    pub(crate) hanging: Hanging,
    /// What a place where a lost robot was found holds.
    pub(crate) on_finding: Hanging,
    /// For how long neither laser nor wheels said how the robot moves, seconds.
    pub(crate) guessed_s: f64,
    /// Share of the scans whose matches contradict the motion before, where no wheels say how the robot moves, by how many deviations at
    /// most, and the share of the returns that met what travels with the robot.
    pub(crate) against_velocity: f64,
    pub(crate) against_sigmas: f64,
    pub(crate) on_robot: f64,
    /// The way from scan to scan, as a multiple of the way in the order of the stamps.
    pub(crate) way_by_stamps: f64,
    /// Loop closures of the first map, and motions of which wheels and scans both tell: what tests a map in which no two visits can be compared.
    pub(crate) closures: usize,
    pub(crate) wheel_motions: usize,
    pub(crate) compared: usize,
    pub(crate) misfits: usize,
    pub(crate) moved_mean_m: f64,
    pub(crate) moved_90_m: f64,
    /// Of the keyframes of the first map relative to its beginning.
    pub(crate) mean_sigma_m: f64,
    pub(crate) worst_sigma_m: f64,
    /// Places that were recognised where the map does not have them.
    pub(crate) unheeded: usize,
    /// What scans say of the motion, as a multiple of what the wheels say: of turns, of ways; and the direction of the way beside theirs,
    /// degrees.
    pub(crate) turns_of_odometry: f64,
    pub(crate) way_of_odometry: f64,
    pub(crate) aside_deg: f64,
    /// How far the point about which the wheels turn lies from where the map has the robot.
    pub(crate) lever_m: f64,
    /// What to say where scans turn the other way than the wheels.
    pub(crate) mirrored: Option<String>,
}

impl Facts {
    pub(crate) fn of(tally: &Tally, turns: &Turns, session: &Session, advice: &Advice, visits: Visits) -> Self {
        let (maps, pieces) = (session.maps(), session.pieces());
        let keyframes = session.keyframes().len();
        let first = maps.first().cloned().unwrap_or_default();
        let in_first = first.keyframes.iter().map(ExactSizeIterator::len).sum::<usize>();
        let wheels = Wheels::of(session);
        let hangs = |piece: &&usize| pieces.get(**piece).is_some_and(|piece| piece.link.is_some());
        Self {
            scans: tally.scans,
            unused: tally.share_unused(0),
            keyframes,
            degraded: tally.share(Status::Degraded),
            lost: tally.share(Status::Lost),
            median_inlier_share: tally.median_inlier_share().unwrap_or(0.0),
            elsewhere: keyframes.saturating_sub(in_first) as f64 / keyframes.max(1) as f64,
            hanging: Hanging::on_odometry(session),
            on_finding: Hanging::on_finding(session, tally.found()),
            guessed_s: tally.guessed_s(),
            against_velocity: tally.against_velocity().0,
            against_sigmas: tally.against_velocity().1,
            on_robot: tally.share_on_robot(),
            way_by_stamps: way_by_stamps(session),
            on_odometry: first.pieces.iter().filter(hangs).count(),
            closures: session.edges().filter(|edge| edge.kind == EdgeKind::Closure).count(),
            // what was predicted without odometry says nothing of it
            wheel_motions: if tally.share_by_odometry() > ODOMETRY_SHARE { wheels.motions } else { 0 },
            compared: visits.compared,
            misfits: visits.misfits,
            moved_mean_m: visits.mean_m,
            moved_90_m: visits.percentile_90_m,
            mean_sigma_m: advice.mean_sigma_m,
            worst_sigma_m: advice.worst_sigma_m,
            unheeded: unheeded(session, &first),
            turns_of_odometry: wheels.turns,
            way_of_odometry: wheels.way,
            aside_deg: wheels.aside_rad.to_degrees(),
            lever_m: if tally.share_by_odometry() > ODOMETRY_SHARE { wheels.lever_m } else { 0.0 },
            mirrored: turns.words(),
        }
    }
}

/// Scans that come in another order than they were taken in lead to and fro. Where stamps alone are wrong, as of a logger that has set them in
/// bursts, their order does.
fn way_by_stamps(session: &Session) -> f64 {
    let mut poses: Vec<(Stamp, Pose2)> = session.trajectory().map(|pose| (pose.stamp, pose.map_from_robot)).collect();
    let way_m = |poses: &[(Stamp, Pose2)]| poses.windows(2).map(|pair| pair[0].1.distance(pair[1].1)).sum::<f64>();
    let in_log_m = way_m(&poses);
    poses.sort_by_key(|(stamp, _)| *stamp);
    let by_stamps_m = way_m(&poses);
    if by_stamps_m > 0.0 { in_log_m / by_stamps_m } else { 1.0 }
}

/// A place that was recognised this far from where the map has it is not heeded, metres.
const UNHEEDED_M: f64 = 1.0;

/// Findings that nothing spoke against but the chain of edges, or that no other agreed with, and that the map says otherwise.
pub(crate) fn unheeded<M: Measurement>(session: &Session<M>, map: &SeparateMap) -> usize {
    let poses = session.map_from_keyframe();
    let found = session.candidates().iter().filter(|candidate| {
        let (Judged::Waiting(why) | Judged::Refused(why)) = candidate.verdict else { return false };
        matches!(why, Objection::Alone | Objection::Improbable)
    });
    let is_elsewhere = |from: usize, to: usize, found: M::Pose| {
        map.has(from) && map.has(to) && poses[from].between(poses[to]).distance(found) > UNHEEDED_M
    };
    let says = |candidate: &mapwright::Candidate<M::Pose>| {
        let (from, to) = (session.place(candidate.from)?, session.place(candidate.to)?);
        Some(is_elsewhere(from, to, candidate.from_from_to?))
    };
    found.filter_map(says).filter(|&elsewhere| elsewhere).count()
}

/// Why a map is not simply good.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Reason {
    pub(crate) word: Usability,
    /// A name for programs.
    pub(crate) what: &'static str,
    pub(crate) words: String,
    pub(crate) evidence: Value,
}

impl Reason {
    /// What it is about, in two or three words.
    fn short(&self) -> &str {
        match self.what {
            "nothing_mapped" => "nothing mapped",
            "unused_scans" => "unused scans",
            "mirrored" => "mirrored scans",
            "doubtful_scans" => "scans that fit badly",
            "lost_scans" => "scans that fit nowhere",
            "in_pieces" => "a map in parts",
            "hangs_on_odometry" => "a step of odometry",
            "hangs_on_finding" => "an unconfirmed relocalisation",
            "guessed" => "guessed poses",
            "disordered" => "scans out of order",
            "visits_contradict" => "contradicting visits",
            "visits_apart" => "walls apart",
            "uncertain" => "uncertain places",
            "recognised_elsewhere" => "places recognised elsewhere",
            "odometry_disagrees" => "odometry against scans",
            "untested" => "nothing tested",
            other => other,
        }
    }
}

/// Whether a map can be used.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Usable {
    pub(crate) word: Usability,
    /// What decided, the gravest first.
    reasons: Vec<Reason>,
    /// Orders maps as their errors do, metres.
    pub(crate) expected_error_m: Option<f64>,
    well: String,
}

/// Bounds: beyond the first a map is to be checked, beyond the second it cannot be used (docs/decisions/0027-verdict.md).
/// Share of the scans that fitted badly or nowhere, or could not be used.
const DOUBTFUL: [f64; 2] = [0.08, 0.5];
const LOST: [f64; 2] = [0.005, 0.2];
/// Share of the keyframes that one step holds.
const HANGING: [f64; 2] = [0.05, f64::INFINITY];
/// The same of where a lost robot was found; real logs have none (docs/decisions/0027-verdict.md).
const FOUND: [f64; 2] = [0.01, f64::INFINITY];
/// Seconds without knowing how the robot moves: after so long a robot that sees nothing is blind (docs/decisions/0024-fragments.md).
const GUESSED_S: [f64; 2] = [4.0, f64::INFINITY];
/// Share of the scans whose matches contradict the motion before, without wheels; where such a share of the returns travels with the robot
/// each counts, for the first may have been matched before that was known.
const ON_ROBOT: f64 = 0.02;
const AGAINST_VELOCITY: [f64; 2] = [0.02, f64::INFINITY];
/// The way as a multiple of that by stamps.
const DISORDER: [f64; 2] = [1.1, f64::INFINITY];
/// Share of the comparisons of two visits that do not fit, of at least so many.
const MISFITS: [f64; 2] = [0.04, 0.4];
const MISFITS_AT_LEAST: usize = 2;
/// By how much visits are off each other in the mean, metres.
const MOVED_M: [f64; 2] = [0.1, f64::INFINITY];
/// Standard deviation of the keyframes relative to where the map begins: at worst, and in the mean, metres.
const SIGMA_M: [f64; 2] = [1.0, 10.0];
/// Places recognised elsewhere.
const UNHEEDED: usize = 2;
/// Share by which wheels and scans differ, and degrees.
const ODOMETRY_OFF: f64 = 0.1;
const ASIDE_DEG: f64 = 6.0;
/// The robot turns so far from where the map has it, metres: as far as visits may be off each other.
const LEVER_M: f64 = MOVED_M[0];
/// Motions of half a metre or 0.3 rad that wheels and scans have to agree on before they bear each other out.
const MOTIONS_AT_LEAST: usize = 3;
/// Odometry has to predict so many of the scans before it says so.
const ODOMETRY_SHARE: f64 = 0.9;

impl Usable {
    pub(crate) fn of(facts: &Facts) -> Self {
        let reasons = [
            nothing(facts),
            unused(facts.unused),
            mirrored(facts),
            doubtful(facts.degraded + facts.lost, "scans"),
            lost(facts.lost, "scans"),
            in_pieces(facts),
            hangs_on_odometry(facts),
            hangs_on_finding(facts),
            guessed(facts),
            held_back(facts),
            disordered(facts),
            misfits(facts),
            moved(facts),
            uncertain(facts.mean_sigma_m, facts.worst_sigma_m),
            unheeded_places(facts.unheeded),
            odometry_off(facts),
            untested(facts),
        ];
        Self::by(reasons, expected_error_m(facts), all_is_well(facts))
    }

    /// By what speaks against a map, and what is said where nothing does.
    pub(crate) fn by(
        reasons: impl IntoIterator<Item = Option<Reason>>,
        expected_error_m: Option<f64>,
        well: String,
    ) -> Self {
        let mut reasons: Vec<Reason> = reasons.into_iter().flatten().collect();
        reasons.sort_by_key(|reason| std::cmp::Reverse(reason.word));
        let word = reasons.first().map_or(Usability::Good, |reason| reason.word);
        Self { word, reasons, expected_error_m, well }
    }

    /// The first line, or the two of them.
    pub(crate) fn words(&self) -> String {
        format!("{:<8} {}\n", self.word.name(), self.why())
    }

    fn why(&self) -> String {
        let why: Vec<&str> = self.reasons.iter().take(2).map(|reason| reason.words.as_str()).collect();
        match self.reasons.len() {
            0 => self.well.clone(),
            1 | 2 => why.join("; "),
            _ => {
                let others: Vec<&str> = self.reasons[2..].iter().map(|reason| reason.short()).collect();
                format!(
                    "{}; and {} in report.json: {}",
                    why.join("; "),
                    count(others.len() as u64, "further reason"),
                    others.join(", ")
                )
            }
        }
    }

    /// A map that cannot be used is a loss.
    pub(crate) fn loss(&self) -> Option<String> {
        let gravest = self.reasons.first().filter(|reason| reason.word == Usability::Unusable)?;
        Some(format!("the map cannot be used: {}", gravest.words))
    }

    /// For `report.json`.
    pub(crate) fn to_json(&self) -> Value {
        let reason = |reason: &Reason| {
            let mut value = json!({ "what": reason.what, "word": reason.word.name(), "words": reason.words });
            value["evidence"] = reason.evidence.clone();
            value
        };
        json!({
            "word": self.word.name(),
            "words": self.why(),
            "reasons": self.reasons.iter().map(reason).collect::<Vec<_>>(),
            "expected_error_m": self.expected_error_m,
        })
    }
}

/// The word for a value beyond one of two bounds.
pub(crate) fn beyond(value: f64, [check, unusable]: [f64; 2]) -> Option<Usability> {
    match value {
        value if value > unusable => Some(Usability::Unusable),
        value if value > check => Some(Usability::Check),
        _ => None,
    }
}

fn percent(share: f64) -> String {
    if share < 0.1 { format!("{:.1} %", 100.0 * share) } else { format!("{:.0} %", 100.0 * share) }
}

fn nothing(facts: &Facts) -> Option<Reason> {
    (facts.keyframes == 0).then(|| Reason {
        word: Usability::Unusable,
        what: "nothing_mapped",
        words: format!(
            "there is no map: {} of {}",
            count(facts.keyframes as u64, "keyframe"),
            count(facts.scans, "scan")
        ),
        evidence: json!({ "keyframes": facts.keyframes, "scans": facts.scans }),
    })
}

fn unused(share: f64) -> Option<Reason> {
    of_share("unused_scans", share, DOUBTFUL, "of the scans could not be used")
}

fn mirrored(facts: &Facts) -> Option<Reason> {
    let words = facts.mirrored.clone()?;
    let evidence = json!({ "turns": facts.turns_of_odometry });
    Some(Reason { word: Usability::Unusable, what: "mirrored", words, evidence })
}

/// Of a share of what was mapped, `of` in the plural.
pub(crate) fn doubtful(share: f64, of: &str) -> Option<Reason> {
    of_share("doubtful_scans", share, DOUBTFUL, &format!("of the {of} fit the map badly"))
}

pub(crate) fn lost(share: f64, of: &str) -> Option<Reason> {
    of_share("lost_scans", share, LOST, &format!("of the {of} fit nowhere"))
}

fn of_share(what: &'static str, share: f64, bounds: [f64; 2], words: &str) -> Option<Reason> {
    Some(Reason {
        word: beyond(share, bounds)?,
        what,
        words: format!("{} {words}", percent(share)),
        evidence: json!({ "share": share, "bounds": bounds }),
    })
}

fn in_pieces(facts: &Facts) -> Option<Reason> {
    let words = if facts.elsewhere > 0.0 {
        format!("the map is in parts: nothing joins {} of it with the rest", percent(facts.elsewhere))
    } else if facts.on_odometry > 0 {
        format!("odometry alone holds {} over a break", count(facts.on_odometry as u64, "piece"))
    } else {
        return None;
    };
    let evidence = json!({ "elsewhere": facts.elsewhere, "on_odometry": facts.on_odometry });
    Some(Reason { word: Usability::Check, what: "in_pieces", words, evidence })
}

fn hangs_on_odometry(facts: &Facts) -> Option<Reason> {
    let words = ["a single step of odometry", "in which no scan fitted"];
    hangs("hangs_on_odometry", facts.hanging, HANGING, words)
}

fn hangs_on_finding(facts: &Facts) -> Option<Reason> {
    let words =
        ["where the robot, lost before, was found", "and no place seen before and after says that it was there"];
    hangs("hangs_on_finding", facts.on_finding, FOUND, words)
}

fn hangs(what: &'static str, hanging: Hanging, bounds: [f64; 2], [on, why]: [&str; 2]) -> Option<Reason> {
    let Hanging { share, from_s } = hanging;
    Some(Reason {
        word: beyond(share, bounds)?,
        what,
        words: format!("{} of the map hangs on {on}, at {from_s:.1} s, {why}", percent(share)),
        evidence: json!({ "share": share, "at_s": from_s, "bound": bounds[0] }),
    })
}

fn guessed(facts: &Facts) -> Option<Reason> {
    Some(Reason {
        word: beyond(facts.guessed_s, GUESSED_S)?,
        what: "guessed",
        words: format!(
            "for {:.0} s neither laser nor wheels said how the robot moves: its poses there are guesses",
            facts.guessed_s
        ),
        evidence: json!({ "longest_s": facts.guessed_s, "bound_s": GUESSED_S[0] }),
    })
}

fn held_back(facts: &Facts) -> Option<Reason> {
    let (share, sigmas) = (facts.against_velocity, facts.against_sigmas);
    let bounds = if facts.on_robot > ON_ROBOT { [0.0, AGAINST_VELOCITY[1]] } else { AGAINST_VELOCITY };
    Some(Reason {
        word: beyond(share, bounds)?,
        what: "against_velocity",
        words: format!(
            "{} of the scans say that the robot suddenly moves otherwise, by up to {sigmas:.0} sigmas, and no wheels do: does something that \
             travels with it hold its matches back?",
            percent(share)
        ),
        evidence: json!({ "share": share, "sigmas": sigmas, "bound": bounds[0], "on_robot": facts.on_robot }),
    })
}

fn disordered(facts: &Facts) -> Option<Reason> {
    let way = facts.way_by_stamps;
    Some(Reason {
        word: beyond(way, DISORDER)?,
        what: "disordered",
        words: format!(
            "the robot drives to and fro, {way:.2} times the way in the order of the stamps: are scans recorded late?"
        ),
        evidence: json!({ "way_by_stamps": way, "bound": DISORDER[0] }),
    })
}

fn misfits(facts: &Facts) -> Option<Reason> {
    let share = facts.misfits as f64 / facts.compared.max(1) as f64;
    let (misfits, compared) = (facts.misfits, facts.compared);
    let few = misfits < MISFITS_AT_LEAST;
    // one that does not fit beside others that do may be a room that has changed
    let word = beyond(share, MISFITS).filter(|_| !few || misfits == compared)?;
    let word = if few { Usability::Check } else { word };
    Some(Reason {
        word,
        what: "visits_contradict",
        words: format!(
            "where it came again, {misfits} of {compared} places do not fit what was seen before: walls may be doubled"
        ),
        evidence: json!({ "misfits": misfits, "compared": compared, "bounds": MISFITS }),
    })
}

fn moved(facts: &Facts) -> Option<Reason> {
    Some(Reason {
        word: beyond(facts.moved_mean_m, MOVED_M).filter(|_| facts.compared >= MISFITS_AT_LEAST)?,
        what: "visits_apart",
        words: format!("where it came again, walls lie {:.2} m apart in the mean", facts.moved_mean_m),
        evidence: json!({ "mean_m": facts.moved_mean_m, "percentile_90_m": facts.moved_90_m, "bound_m": MOVED_M[0] }),
    })
}

/// Parts that are uncertain make a map one to be checked; it cannot be used where most of it is.
pub(crate) fn uncertain(mean_sigma_m: f64, worst_sigma_m: f64) -> Option<Reason> {
    let [check_m, unusable_m] = SIGMA_M;
    let is_unusable = mean_sigma_m > unusable_m;
    let worst = beyond(worst_sigma_m, [check_m, f64::INFINITY])?;
    let (sigma_m, which) =
        if mean_sigma_m > check_m { (mean_sigma_m, "in the mean") } else { (worst_sigma_m, "at worst") };
    Some(Reason {
        word: if is_unusable { Usability::Unusable } else { worst },
        what: "uncertain",
        words: format!("it is certain to {sigma_m:.1} m only, {which}"),
        evidence: json!({ "mean_sigma_m": mean_sigma_m, "worst_sigma_m": worst_sigma_m, "bounds_m": SIGMA_M }),
    })
}

pub(crate) fn unheeded_places(findings: usize) -> Option<Reason> {
    (findings >= UNHEEDED).then(|| Reason {
        word: Usability::Check,
        what: "recognised_elsewhere",
        words: format!("{} looked like another than the map has there", count(findings as u64, "place")),
        evidence: json!({ "findings": findings, "farther_than_m": UNHEEDED_M }),
    })
}

fn odometry_off(facts: &Facts) -> Option<Reason> {
    let Facts { turns_of_odometry: turns, way_of_odometry: way, aside_deg, lever_m, .. } = *facts;
    let words = if facts.mirrored.is_some() {
        return None;
    } else if aside_deg.abs() > ASIDE_DEG {
        format!(
            "scans say that the robot drives {aside_deg:.0} deg beside where odometry says: is the laser mounted so?"
        )
    } else if (turns - 1.0).abs() > ODOMETRY_OFF {
        format!("scans turn {} times as far as odometry: are the laser's angles right?", rounded(turns))
    } else if (way - 1.0).abs() > ODOMETRY_OFF {
        format!("scans say {} times the way of odometry: are ranges and wheels right?", rounded(way))
    } else if lever_m > LEVER_M {
        format!(
            "wheels and scans say that the robot turns about a point {lever_m:.2} m from where the log has it: does the laser sit where the log \
             says? `mapwright calibrate` measures it"
        )
    } else {
        return None;
    };
    let evidence = json!({ "turns": turns, "way": way, "aside_deg": aside_deg, "lever_m": lever_m });
    Some(Reason { word: Usability::Check, what: "odometry_disagrees", words, evidence })
}

/// Nothing has tested the map: no place was seen twice, none was recognised, and no wheels bear out how the robot moved.
fn untested(facts: &Facts) -> Option<Reason> {
    let is_tested = facts.compared > facts.misfits || facts.closures > 0 || facts.wheel_motions >= MOTIONS_AT_LEAST;
    (!is_tested && facts.keyframes > 0).then(|| Reason {
        word: Usability::Check,
        what: "untested",
        words: match facts.scans {
            1 => "one scan tells nothing: nothing tests the map".to_owned(),
            _ if facts.compared > 0 => "nothing bears out the map: where it came again nothing fits what was seen before".to_owned(),
            _ => "nothing tests the map: no place was seen twice, and no wheels bear out how the robot moved".to_owned(),
        },
        evidence: json!({ "closures": facts.closures, "wheel_motions": facts.wheel_motions, "bound": MOTIONS_AT_LEAST }),
    })
}

fn rounded(times: f64) -> String {
    format!("{times:.2}")
}

/// What adds to the error that is expected of a map: such a share of the deviation of its keyframes, and metres for each whole share by which
/// wheels and scans differ beyond what is usual, of scans that fit badly, and of keyframes that are elsewhere.
const OF_SIGMA: f64 = 0.1;
const OF_ODOMETRY_M: f64 = 2.0;
const USUAL_ODOMETRY: f64 = 0.02;
const OF_DOUBTFUL_M: f64 = 1.0;
const OF_ELSEWHERE_M: f64 = 1.0;

/// A number that orders maps as their errors do, metres; none where there is no map.
fn expected_error_m(facts: &Facts) -> Option<f64> {
    let beyond = |share: f64| (share.abs() - USUAL_ODOMETRY).max(0.0);
    let odometry = beyond(facts.way_of_odometry - 1.0)
        + beyond(facts.turns_of_odometry - 1.0)
        + beyond(facts.aside_deg.to_radians());
    let parts_m = [
        facts.moved_mean_m,
        OF_SIGMA * facts.mean_sigma_m,
        OF_ODOMETRY_M * odometry,
        OF_DOUBTFUL_M * (facts.degraded + facts.lost),
        OF_ELSEWHERE_M * facts.elsewhere,
    ];
    (facts.keyframes > 0).then(|| parts_m.iter().map(|part_m| part_m * part_m).sum::<f64>().sqrt())
}

/// Why nothing speaks against it.
fn all_is_well(facts: &Facts) -> String {
    let certain = || format!("certain to {} in the mean", metres(facts.mean_sigma_m));
    match facts.compared {
        0 if facts.closures > 0 => {
            format!("{} recognised where the map has them; {}", count(facts.closures as u64, "old place"), certain())
        }
        0 => format!("wheels and scans agree; nothing was seen twice; {}", certain()),
        compared => {
            let fits = (compared - facts.misfits) as u64;
            format!(
                "{} seen again fit what was seen before, to {} in the mean",
                count(fits, "place"),
                metres(facts.moved_mean_m)
            )
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOUND: Facts = Facts {
        scans: 5000,
        keyframes: 1000,
        unused: 0.001,
        degraded: 0.01,
        lost: 0.0,
        median_inlier_share: 0.98,
        elsewhere: 0.0,
        on_odometry: 0,
        hanging: Hanging { share: 0.001, from_s: 70.0 },
        on_finding: Hanging { share: 0.001, from_s: 80.0 },
        guessed_s: 0.5,
        against_velocity: 0.004,
        against_sigmas: 5.0,
        on_robot: 0.001,
        way_by_stamps: 0.8,
        closures: 30,
        wheel_motions: 500,
        compared: 100,
        misfits: 2,
        moved_mean_m: 0.02,
        moved_90_m: 0.03,
        mean_sigma_m: 0.05,
        worst_sigma_m: 0.1,
        unheeded: 0,
        turns_of_odometry: 1.01,
        way_of_odometry: 0.99,
        aside_deg: 0.2,
        lever_m: 0.05,
        mirrored: None,
    };

    fn said(facts: Facts) -> (Usability, String) {
        let usable = Usable::of(&facts);
        (usable.word, usable.words())
    }

    #[test]
    fn a_sound_map_is_good_and_says_why() {
        assert_eq!(
            said(SOUND),
            (
                Usability::Good,
                "good     98 places seen again fit what was seen before, to 0.02 m in the mean\n".to_owned()
            )
        );
        let once = Facts { compared: 0, misfits: 0, moved_mean_m: 0.0, closures: 0, ..SOUND };
        assert!(said(once.clone()).1.contains("nothing was seen twice"));
        assert!(said(Facts { closures: 2, ..once }).1.contains("2 old places recognised"));
        assert!(Usable::of(&SOUND).loss().is_none());
    }

    #[test]
    fn good_means_that_something_was_tested() {
        let once = Facts { compared: 0, misfits: 0, moved_mean_m: 0.0, closures: 0, wheel_motions: 0, ..SOUND };
        assert_eq!(said(Facts { wheel_motions: 3, ..once.clone() }).0, Usability::Good);
        let (word, told) = said(once.clone());
        assert!(word == Usability::Check && told.contains("no wheels"), "{told}");
        let (word, told) = said(Facts { scans: 1, keyframes: 1, ..once });
        assert!(word == Usability::Check && told.contains("one scan"), "{told}");
    }

    #[test]
    fn each_reason_is_told() {
        let doubtful = [
            (Facts { degraded: 0.2, ..SOUND }, "fit the map badly"),
            (Facts { lost: 0.01, ..SOUND }, "fit nowhere"),
            (Facts { elsewhere: 0.3, ..SOUND }, "in parts"),
            (Facts { unused: 0.2, ..SOUND }, "20 % of the scans could not be used"),
            (Facts { on_odometry: 1, ..SOUND }, "odometry alone holds 1 piece"),
            (
                Facts { hanging: Hanging { share: 0.3, from_s: 70.0 }, ..SOUND },
                "30 % of the map hangs on a single step of odometry, at 70.0 s",
            ),
            (
                Facts { on_finding: Hanging { share: 0.2, from_s: 80.0 }, ..SOUND },
                "20 % of the map hangs on where the robot, lost before, was found, at 80.0 s, and no place",
            ),
            (Facts { guessed_s: 35.0, ..SOUND }, "for 35 s neither laser nor wheels"),
            (
                Facts { against_velocity: 0.048, against_sigmas: 7.2, ..SOUND },
                "4.8 % of the scans say that the robot suddenly",
            ),
            (Facts { on_robot: 0.1, ..SOUND }, "by up to 5 sigmas, and no wheels do"),
            (Facts { way_by_stamps: 1.466, ..SOUND }, "to and fro, 1.47 times the way"),
            (Facts { misfits: 10, ..SOUND }, "10 of 100 places do not fit"),
            (Facts { compared: 1, misfits: 1, ..SOUND }, "1 of 1 places do not fit"),
            (Facts { moved_mean_m: 0.2, ..SOUND }, "0.20 m apart"),
            (Facts { mean_sigma_m: 2.0, worst_sigma_m: 4.0, ..SOUND }, "certain to 2.0 m only, in the mean"),
            (Facts { worst_sigma_m: 2.451, ..SOUND }, "certain to 2.5 m only, at worst"),
            (Facts { unheeded: 3, ..SOUND }, "3 places looked like another"),
            (Facts { turns_of_odometry: 0.8, ..SOUND }, "turn 0.80 times"),
            (Facts { way_of_odometry: 1.3, ..SOUND }, "1.30 times the way"),
            (Facts { aside_deg: 57.0, ..SOUND }, "57 deg beside"),
            (Facts { lever_m: 0.21, ..SOUND }, "0.21 m from"),
        ];
        for (facts, words) in doubtful {
            let (word, told) = said(facts.clone());
            assert!(word == Usability::Check && told.contains(words), "{told}");
            assert!(Usable::of(&facts).expected_error_m >= Usable::of(&SOUND).expected_error_m, "{told}");
        }
        let unusable = [
            Facts { mirrored: Some("scans turn the other way".to_owned()), ..SOUND },
            Facts { keyframes: 0, ..SOUND },
            Facts { degraded: 0.6, ..SOUND },
            Facts { lost: 0.3, ..SOUND },
            Facts { misfits: 50, ..SOUND },
            Facts { mean_sigma_m: 20.0, worst_sigma_m: 40.0, ..SOUND },
        ];
        for facts in unusable {
            assert!(said(facts.clone()).0 == Usability::Unusable && Usable::of(&facts).loss().is_some(), "{facts:?}");
        }
    }

    #[test]
    fn the_gravest_two_reasons_come_first() {
        let facts = Facts { degraded: 0.2, on_odometry: 1, unheeded: 2, misfits: 50, ..SOUND };
        let (word, told) = said(facts.clone());
        assert!(word == Usability::Unusable && told.starts_with("unusable where it came again, 50 of 100"), "{told}");
        let others = "; and 2 further reasons in report.json: a map in parts, places recognised elsewhere";
        assert!(told.contains(others), "{told}");
        let value = Usable::of(&facts).to_json();
        assert_eq!(value["word"], "unusable");
        assert_eq!(value["reasons"][0]["what"], "visits_contradict");
        assert_eq!(value["reasons"][0]["evidence"]["misfits"], 50);
    }
}
