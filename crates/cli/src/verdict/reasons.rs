//! What speaks against a map, each with its bounds.

use super::facts::{Facts, UNHEEDED_M};
use super::{Reason, Usability, beyond};
use crate::hanging::Hanging;
use crate::terminal::count;
use crate::wheels::Wheels;
use serde_json::json;

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
pub(super) const ODOMETRY_OFF: f64 = 0.1;
const ASIDE_DEG: f64 = 6.0;
/// The robot turns so far from where the map has it, metres: as far as visits may be off each other.
const LEVER_M: f64 = MOVED_M[0];
/// Motions of half a metre or 0.3 rad that wheels and scans have to agree on before they bear each other out.
pub(crate) const MOTIONS_AT_LEAST: usize = 3;

fn percent(share: f64) -> String {
    if share < 0.1 { format!("{:.1} %", 100.0 * share) } else { format!("{:.0} %", 100.0 * share) }
}

pub(super) fn nothing(facts: &Facts) -> Option<Reason> {
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

pub(super) fn unused(share: f64) -> Option<Reason> {
    of_share("unused_scans", share, DOUBTFUL, "of the scans could not be used")
}

pub(super) fn mirrored(facts: &Facts) -> Option<Reason> {
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

pub(super) fn in_pieces(facts: &Facts) -> Option<Reason> {
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

pub(super) fn hangs_on_odometry(facts: &Facts) -> Option<Reason> {
    let words = ["a single step of odometry", "in which no scan fitted"];
    hangs("hangs_on_odometry", facts.hanging, HANGING, words)
}

pub(super) fn hangs_on_finding(facts: &Facts) -> Option<Reason> {
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

pub(super) fn guessed(facts: &Facts) -> Option<Reason> {
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

pub(super) fn held_back(facts: &Facts) -> Option<Reason> {
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

pub(super) fn disordered(facts: &Facts) -> Option<Reason> {
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

pub(super) fn misfits(facts: &Facts) -> Option<Reason> {
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

/// By how much visits are off each other, of so many that were compared: in the mean, and nine of ten by less, metres.
pub(crate) fn moved(compared: usize, [mean_m, percentile_90_m]: [f64; 2]) -> Option<Reason> {
    Some(Reason {
        word: beyond(mean_m, MOVED_M).filter(|_| compared >= MISFITS_AT_LEAST)?,
        what: "visits_apart",
        words: format!("where it came again, walls lie {mean_m:.2} m apart in the mean"),
        evidence: json!({ "mean_m": mean_m, "percentile_90_m": percentile_90_m, "bound_m": MOVED_M[0] }),
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

/// What wheels and scans say of the same motions, where that differs by more than a share.
pub(crate) fn odometry_off(wheels: &Wheels, most_share: f64) -> Option<Reason> {
    let Wheels { turns, way, lever_m, .. } = *wheels;
    let aside_deg = wheels.aside_rad.to_degrees();
    let words = if aside_deg.abs() > ASIDE_DEG {
        format!(
            "scans say that the robot drives {aside_deg:.0} deg beside where odometry says: is the laser mounted so?"
        )
    } else if (turns - 1.0).abs() > most_share {
        format!("scans turn {} times as far as odometry: are the laser's angles right?", rounded(turns))
    } else if (way - 1.0).abs() > most_share {
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
pub(super) fn untested(facts: &Facts) -> Option<Reason> {
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
