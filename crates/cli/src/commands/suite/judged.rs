//! Whether the words of verdicts are right, fault by fault.

use super::floors::Floor;
use crate::failure::Failure;
use crate::simulated::map_events;
use crate::tally::Tally;
use crate::turns::Turns;
use crate::verdict::{Facts, Usability, Usable};
use mapwright::{Advice, Session, Settings, Stamp, Visits};
use mapwright_eval::{Alignment, ErrorStats, PosePair, ate_of_pairs};
use mapwright_sim::{Event, TrueScan};
use serde::Serialize;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// Maps what was recorded; the session and what its verdict is made of.
pub(super) fn map(events: impl Iterator<Item = Event>, settings: &Settings) -> Result<(Session, Facts), Failure> {
    let (mut tally, mut turns) = (Tally::default(), Turns::default());
    let session: Session = map_events(events, settings, |_, update, scan: &TrueScan| {
        tally.add(update, scan.scan.odom_from_robot.is_some());
        turns.add(update, scan.scan.odom_from_robot, &scan.scan.laser);
    })?;
    let first = session.maps().into_iter().next().unwrap_or_default();
    let (advice, visits) = (Advice::of_map(&session, &first), Visits::of_map(&session, &first, settings));
    let facts = Facts::of(&tally, &turns, &session, &advice, visits);
    Ok((session, facts))
}

/// Maps what was recorded beside the truth: ATE of all scans, aligned rigidly, rmse in metres, and what is said of the map.
pub(super) fn map_beside_truth(
    name: &str,
    events: impl Iterator<Item = Event>,
    settings: &Settings,
) -> Result<(f64, Usable), Failure> {
    let mut truth = BTreeMap::new();
    let events = events.inspect(|event| {
        if let Event::Scan(scan) = event {
            truth.insert(scan.scan.stamp, scan.world_from_robot);
        }
    });
    let (session, facts) = map(events, settings)?;
    let pair = |(stamp, map_from_robot): (Stamp, _)| {
        Some(PosePair { stamp, world_from_robot: *truth.get(&stamp)?, map_from_robot })
    };
    let pairs: Vec<PosePair> =
        session.trajectory().map(|pose| (pose.stamp, pose.map_from_robot)).filter_map(pair).collect();
    let failure = |cause: String| Failure::World { name: name.to_owned(), reason: cause };
    let errors = ate_of_pairs(&pairs, Alignment::Rigid).map_err(|cause| failure(cause.to_string()))?;
    Ok((errors.translation_m.rmse, Usable::of(&facts)))
}

/// The same without the wheels' readings.
pub(super) fn without_wheels(events: impl Iterator<Item = Event>) -> impl Iterator<Item = Event> {
    events.filter_map(|event| match event {
        Event::Odometry(_) => None,
        Event::Scan(mut scan) => {
            scan.scan.odom_from_robot = None;
            Some(Event::Scan(scan))
        }
    })
}

/// A map is good below so many times the error without the fault, and bad beyond so many.
pub(super) const GOOD_TIMES: f64 = 3.0;
const BAD_TIMES: f64 = 10.0;

/// A recording with a fault, and what was said of its map.
#[derive(Debug, Clone, Serialize)]
pub(super) struct Judged {
    pub(super) fault: &'static str,
    /// The error, metres, and that without the fault.
    pub(super) error_m: f64,
    pub(super) clean_m: f64,
    pub(super) word: Usability,
}

impl Judged {
    fn times(&self) -> f64 {
        self.error_m / self.clean_m.max(f64::MIN_POSITIVE)
    }

    pub(super) fn line(&self) -> String {
        let Self { fault, error_m, word, .. } = self;
        format!("\n        {fault:<34} {:8} {error_m:7.3} m, {:7.1} times", word.name(), self.times())
    }
}

/// A table of the faults in the order of the first world's, the same for programs, and what must hold of the words.
pub(super) fn summary(runs: &[&Judged]) -> (String, Value, Vec<Floor>) {
    let mut faults: Vec<&str> = Vec::new();
    for run in runs {
        if !faults.contains(&run.fault) {
            faults.push(run.fault);
        }
    }
    let mut words =
        "fault                               error in the median, times that without    good  check  unusable\n"
            .to_owned();
    words += &faults.iter().filter_map(|fault| row(fault, runs)).collect::<String>();
    let good: Vec<_> = runs.iter().filter(|run| run.word == Usability::Good).collect();
    let bad: Vec<_> = runs.iter().filter(|run| run.times() > BAD_TIMES).collect();
    let right = good.iter().filter(|run| run.times() < GOOD_TIMES).count();
    let told = bad.iter().filter(|run| run.word != Usability::Good).count();
    let value = json!({
        "runs": runs.len(), "good": good.len(), "good_and_right": right, "bad": bad.len(), "bad_and_told": told,
    });
    let floors = vec![
        Floor::share("95 % of the good ones below 3 times the error without the fault", 0.95, right, good.len()),
        Floor::share("98 % of those beyond 10 times it not called good", 0.98, told, bad.len()),
    ];
    (words, value, floors)
}

fn row(fault: &str, runs: &[&Judged]) -> Option<String> {
    let of: Vec<_> = runs.iter().filter(|run| run.fault == fault).collect();
    let times = ErrorStats::of(&of.iter().map(|run| run.times()).collect::<Vec<_>>())?.median;
    let [good, check, unusable] = [Usability::Good, Usability::Check, Usability::Unusable]
        .map(|word| of.iter().filter(|run| run.word == word).count());
    Some(format!("{fault:<34}  {times:41.1}    {good:4}  {check:5}  {unusable:8}\n"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_counted_against_the_error_without_the_fault() {
        let judged = |fault, error_m, word| Judged { fault, error_m, clean_m: 0.01, word };
        let runs = [
            judged("none", 0.01, Usability::Good),
            judged("wrong", 0.2, Usability::Check),
            judged("none", 0.02, Usability::Check),
            judged("wrong", 0.15, Usability::Good),
        ];
        let (words, value, floors) = summary(&runs.iter().collect::<Vec<_>>());
        assert_eq!(value, json!({ "runs": 4, "good": 2, "good_and_right": 1, "bad": 2, "bad_and_told": 1 }));
        assert!(floors.iter().all(|floor| !floor.holds && floor.found.starts_with("50.0 %")), "{floors:?}");
        let rows: Vec<&str> = words.lines().skip(1).collect();
        assert!(rows[0].starts_with("none") && rows[0].ends_with("1      1         0"), "{words}");
        assert!(rows[1].starts_with("wrong") && rows.len() == 2, "{words}");
    }
}
