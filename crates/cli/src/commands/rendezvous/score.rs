//! Encounters beside motion capture.

use super::Outcomes;
use super::data::DataSet;
use mapwright_eval::{ErrorStats, Nees, chi_square_quantile};
use mapwright_geom::Stamp;
use mapwright_rendezvous::{Encounter, Kind, RobotId};

/// Errors of some encounters.
pub(super) struct Score {
    pub(super) name: &'static str,
    /// Encounters, and how many of them the truth knows.
    pub(super) encounters: usize,
    pub(super) scored: usize,
    pub(super) errors: Option<Errors>,
}

/// Medians, 95th percentiles, and how honest covariances are.
pub(super) struct Errors {
    pub(super) translation_m: [f64; 2],
    pub(super) rotation_deg: [f64; 2],
    pub(super) nees: f64,
    /// Share within the ellipse that should hold 95 %.
    pub(super) within_95: f64,
}

/// Scores by kind; empty without truth.
pub(super) struct Scores(pub(super) Vec<Score>);

impl Scores {
    pub(super) fn of(set: &DataSet, outcomes: &Outcomes) -> Self {
        if set.robots.iter().all(|robot| robot.truth.is_none()) {
            return Self(Vec::new());
        }
        let score = |name: &'static str, is_of: fn(&Encounter) -> bool| {
            let encounters: Vec<&Encounter> = outcomes.encounters().filter(|encounter| is_of(encounter)).collect();
            Score::of(name, &encounters, set)
        };
        Self(vec![
            score("mutual", |encounter| encounter.kind == Kind::Mutual),
            score("gathered", |encounter| encounter.kind == Kind::Gathered),
            score("joins", |encounter| encounter.is_join),
        ])
    }
}

impl Score {
    fn of(name: &'static str, encounters: &[&Encounter], set: &DataSet) -> Self {
        let truth =
            |id: RobotId, stamp: Stamp| set.robots.iter().find(|robot| robot.id == id)?.truth.as_ref()?.at(stamp);
        let (mut metres, mut degrees, mut inside, mut nees) = (Vec::new(), Vec::new(), 0, Nees::default());
        let bound = chi_square_quantile(0.95, 3.0).unwrap_or(f64::NAN);
        for encounter in encounters {
            let Some((of_a, of_b)) = truth(encounter.a, encounter.stamp).zip(truth(encounter.b, encounter.stamp))
            else {
                continue;
            };
            let a_from_b = of_a.between(of_b);
            let error = encounter.a_from_b.between(a_from_b);
            metres.push(error.x.hypot(error.y));
            degrees.push(error.theta.abs().to_degrees());
            let mut alone = Nees::default();
            alone.add(a_from_b, encounter.a_from_b, &encounter.covariance);
            nees.add(a_from_b, encounter.a_from_b, &encounter.covariance);
            inside += usize::from(alone.mean().is_some_and(|sample| sample <= bound));
        }
        let scored = metres.len();
        let errors = ErrorStats::of(&metres).zip(ErrorStats::of(&degrees)).zip(nees.mean());
        let errors = errors.map(|((translation, rotation), nees)| Errors {
            translation_m: [translation.median, percentile_95(&metres)],
            rotation_deg: [rotation.median, percentile_95(&degrees)],
            nees,
            within_95: inside as f64 / scored as f64,
        });
        Self { name, encounters: encounters.len(), scored, errors }
    }
}

/// The value that 95 % lie at or below, between two of them by a straight line.
fn percentile_95(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let at = 0.95 * sorted.len().saturating_sub(1) as f64;
    let (Some(low), Some(high)) = (sorted.get(at.floor() as usize), sorted.get(at.ceil() as usize)) else {
        return f64::NAN;
    };
    low + at.fract() * (high - low)
}
