//! Whether a map can be used: good, to be checked, or unusable, and why. What decides is told by the run and the map themselves, without
//! a reference (docs/decisions/0027-verdict.md).

mod expected;
mod facts;
mod reasons;

pub(crate) use facts::{Facts, unheeded};
pub(crate) use reasons::{MOTIONS_AT_LEAST, doubtful, lost, moved, odometry_off, uncertain, unheeded_places};

use crate::terminal::count;
use expected::{all_is_well, expected_error_m};
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
            "of_sonars" => "sonars alone",
            "against_velocity" => "sudden motions without wheels",
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

impl Usable {
    pub(crate) fn of(facts: &Facts) -> Self {
        let reasons = [
            reasons::nothing(facts),
            reasons::unused(facts.unused),
            reasons::mirrored(facts),
            doubtful(facts.degraded + facts.lost, "scans"),
            lost(facts.lost, "scans"),
            reasons::in_pieces(facts),
            reasons::hangs_on_odometry(facts),
            reasons::hangs_on_finding(facts),
            reasons::guessed(facts),
            reasons::held_back(facts),
            reasons::disordered(facts),
            reasons::misfits(facts),
            moved(facts.compared, [facts.moved_mean_m, facts.moved_90_m]),
            uncertain(facts.mean_sigma_m, facts.worst_sigma_m),
            unheeded_places(facts.unheeded),
            odometry_off(&facts.wheels(), reasons::ODOMETRY_OFF).filter(|_| facts.mirrored.is_none()),
            reasons::untested(facts),
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

    /// The same with one reason more.
    pub(crate) fn also(self, reason: Option<Reason>) -> Self {
        let reasons = self.reasons.into_iter().map(Some).chain([reason]);
        Self::by(reasons, self.expected_error_m, self.well)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hanging::Hanging;

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
