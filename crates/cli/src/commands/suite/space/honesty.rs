//! `mapwright suite drives --3d`: whether the stated covariances are honest.

use super::super::Measure;
use super::super::floors::{Floor, stats_in_words};
use super::{Drives, EVERY, WORLDS};
use crate::failure::Failure;
use crate::simulated::{Simulated, Taken};
use mapwright::{Cov6, Pose3, SpaceMapper, SpaceSweep, Status, Update};
use mapwright_eval::{ErrorStats, space_nees};
use serde::Serialize;
use serde_json::{Value, json};

/// Mean and median of the squared error over its variance lie within this where covariances are honest: 6 and 5.35 are expected.
const HONEST: std::ops::RangeInclusive<f64> = 4.0..=8.0;

pub(in super::super) struct Honesty(pub(in super::super) Drives);

#[derive(Debug, Serialize)]
pub(in super::super) struct World {
    seed: u64,
    building: &'static str,
    path_m: f64,
    clouds: usize,
    /// Clouds that were not tracked, and those whose covariance is none.
    untracked: usize,
    refused: usize,
    /// Of the pose relative to the keyframe that it was matched with.
    nees_mean: f64,
    nees_median: f64,
    /// The same of keyframes alone, whose poses are of the middle of their sweeps: nothing is extrapolated.
    keyframes: usize,
    keyframe_nees_mean: Option<f64>,
    keyframe_nees_median: Option<f64>,
    /// Root mean squares of what the error is and what is stated, metres and radians.
    error_m: f64,
    stated_m: f64,
    error_rad: f64,
    stated_rad: f64,
    trajectory_ate_m: f64,
    /// Of each cloud.
    #[serde(skip)]
    nees: Vec<f64>,
}

/// Squared errors relative to their variances, and sums of both.
#[derive(Default)]
struct Witness {
    nees: Vec<f64>,
    keyframe_nees: Vec<f64>,
    untracked: usize,
    refused: usize,
    /// Sums of squares: errors in metres and radians, and what was stated.
    errors: [f64; 2],
    stated: [f64; 2],
}

impl Witness {
    fn see(&mut self, mapper: &SpaceMapper, update: &Update<SpaceSweep>, taken: &[Taken<Pose3>]) {
        let session = mapper.session();
        let anchor = update.anchor.filter(|_| update.status == Status::Tracking).and_then(|id| session.place(id));
        let at_anchor = anchor.and_then(|place| {
            let scan = usize::try_from(session.keyframes().get(place)?.scan).ok()?;
            Some((session.map_from_keyframe().get(place)?, taken.get(scan)?.world_from_keyframe))
        });
        let (Some((map_from_anchor, world_from_anchor)), Some(now)) = (at_anchor, taken.last()) else {
            self.untracked += 1;
            return;
        };
        let truth = world_from_anchor.between(now.world_from_robot);
        self.add(truth, map_from_anchor.between(update.map_from_robot), &update.covariance);
        let keyframe = update.keyframe.and_then(|id| session.map_from_keyframe().get(session.place(id)?));
        self.keyframe_nees.extend(keyframe.and_then(|map_from_keyframe| {
            let truth = world_from_anchor.between(now.world_from_keyframe);
            space_nees(truth, map_from_anchor.between(*map_from_keyframe), &update.covariance)
        }));
    }

    fn add(&mut self, truth: Pose3, found: Pose3, covariance: &Cov6) {
        let Some(sample) = space_nees(truth, found, covariance) else {
            self.refused += 1;
            return;
        };
        self.nees.push(sample);
        let error = found.between(truth).log();
        for (k, at) in [0, 3].into_iter().enumerate() {
            self.errors[k] += error.fixed_rows::<3>(at).norm_squared();
            self.stated[k] += covariance.fixed_view::<3, 3>(at, at).trace();
        }
    }
}

impl Measure for Honesty {
    type World = World;
    const NAME: &'static str = "drives in space";
    const FILES: [&'static str; 2] = ["drives-3d.jsonl", "drives-3d.json"];

    fn world(&self, seed: u64) -> Result<World, Failure> {
        let (building, site) = WORLDS[(seed % WORLDS.len() as u64) as usize];
        let failure = |reason: String| Failure::World { name: format!("{building}, seed {seed}"), reason };
        let mut witness = Witness::default();
        let drive = self.0.drive(site(seed), seed);
        let world = Simulated::map_space(&drive, EVERY, &self.0.settings, |mapper, update, taken| {
            witness.see(mapper, update, taken);
        })?;
        let stats = ErrorStats::of(&witness.nees);
        let stats = stats.ok_or_else(|| failure("expected clouds that are tracked, found none".to_owned()))?;
        let of_keyframes = ErrorStats::of(&witness.keyframe_nees);
        let rms = |sum: f64| (sum / witness.nees.len() as f64).sqrt();
        Ok(World {
            seed,
            building,
            path_m: world.length_m(),
            clouds: world.scan_count(),
            untracked: witness.untracked,
            refused: witness.refused,
            nees_mean: stats.mean,
            nees_median: stats.median,
            keyframes: witness.keyframe_nees.len(),
            keyframe_nees_mean: of_keyframes.map(|stats| stats.mean),
            keyframe_nees_median: of_keyframes.map(|stats| stats.median),
            error_m: rms(witness.errors[0]),
            stated_m: rms(witness.stated[0]),
            error_rad: rms(witness.errors[1]),
            stated_rad: rms(witness.stated[1]),
            trajectory_ate_m: world.trajectory_ate_m().map_err(|cause| failure(cause.to_string()))?,
            nees: witness.nees,
        })
    }

    fn line(world: &World) -> String {
        format!(
            "{:6}  {:18}  NEES mean {:6.2}, median {:5.2} of {:4}, {:3} untracked; of keyframes {:6.2}, {:5.2}  error {:.4} m, stated {:.4}, \
             {:.5} rad, stated {:.5}  ATE {:6.3} m  {:4.0} m of way",
            world.seed,
            world.building,
            world.nees_mean,
            world.nees_median,
            world.nees.len(),
            world.untracked,
            world.keyframe_nees_mean.unwrap_or(f64::NAN),
            world.keyframe_nees_median.unwrap_or(f64::NAN),
            world.error_m,
            world.stated_m,
            world.error_rad,
            world.stated_rad,
            world.trajectory_ate_m,
            world.path_m,
        )
    }

    fn summary(&self, worlds: &[World]) -> (String, Value, Vec<Floor>) {
        let all: Vec<f64> = worlds.iter().flat_map(|world| world.nees.iter().copied()).collect();
        let stats = ErrorStats::of(&all);
        let mut words = stats_in_words(worlds, &[("ATE", " m", |w| w.trajectory_ate_m)]);
        words += &stats.map_or(String::new(), |s| {
            format!("NEES     mean {:.2}, median {:.2}, worst {:.1} of {} clouds\n", s.mean, s.median, s.max, all.len())
        });
        let value = json!({
            "nees_mean": stats.map(|stats| stats.mean),
            "nees_median": stats.map(|stats| stats.median),
            "clouds": all.len(),
            "untracked": worlds.iter().map(|world| world.untracked).sum::<usize>(),
            "refused": worlds.iter().map(|world| world.refused).sum::<usize>(),
        });
        let within = |what, found: Option<f64>| Floor {
            what,
            found: found.map_or("nothing".to_owned(), |found| format!("{found:.2}")),
            holds: found.is_some_and(|found| HONEST.contains(&found)),
        };
        let floors = vec![
            within("mean NEES from 4 to 8", stats.map(|stats| stats.mean)),
            within("median NEES from 4 to 8", stats.map(|stats| stats.median)),
        ];
        (words, value, floors)
    }
}
