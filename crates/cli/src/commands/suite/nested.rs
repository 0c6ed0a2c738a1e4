//! `mapwright suite nested`

use super::Measure;
use super::floors::{Floor, stats, stats_in_words};
use crate::batch::{batch_poses, true_pairs};
use crate::failure::Failure;
use crate::simulated::{Closing, PoseError, Simulated};
use mapwright::Settings;
use mapwright_eval::ErrorStats;
use mapwright_sim::{Drive, DriveSettings, Event, OdometryNoise, PerturbScans, Revisits, worlds};
use serde::Serialize;
use serde_json::{Value, json};
use std::sync::Arc;

/// Such a share of the closing edges is right, and the error is at most so much, metres.
const RIGHT_SHARE: f64 = 0.999;
const MOST_ATE_M: f64 = 0.4;

pub(super) struct Nested {
    pub(super) length_m: f64,
    /// Wheels so many times as bad as the default ones.
    pub(super) wheels: f64,
    /// Relative standard deviation of noise on each increment of odometry from scan to scan, on top.
    pub(super) noise: f64,
    pub(super) settings: Settings,
}

#[derive(Debug, Serialize)]
pub(super) struct World {
    seed: u64,
    path_m: f64,
    scans: usize,
    keyframes: usize,
    closures: usize,
    closings: usize,
    wrong: usize,
    /// Each wrong one.
    wrong_closings: Vec<Wrong>,
    /// Slips that were put right.
    slips: usize,
    /// Of the keyframes, as the batch solve's.
    ate_m: f64,
    batch_ate_m: f64,
    ratio: f64,
}

/// A closing edge that is wrong, as measured or in the final map.
#[derive(Debug, Serialize)]
pub(super) struct Wrong {
    pub(super) is_closure: bool,
    from: usize,
    to: usize,
    measured: PoseError,
    in_map: PoseError,
    /// What was measured against the truth, by the uncertainty that the edge states.
    stated_chi2: f64,
}

impl Wrong {
    pub(super) fn among(closings: &[Closing]) -> Vec<Self> {
        let wrong = |&Closing { kind, from, to, measured, in_map, stated_chi2 }: &Closing| {
            let is_closure = kind == mapwright::EdgeKind::Closure;
            Self { is_closure, from, to, measured, in_map, stated_chi2 }
        };
        closings.iter().filter(|closing| !closing.is_right()).map(wrong).collect()
    }
}

impl Measure for Nested {
    type World = World;
    const NAME: &'static str = "nested";
    const FILES: [&'static str; 2] = ["nested.jsonl", "nested.json"];

    fn world(&self, seed: u64) -> Result<World, Failure> {
        let failure = |reason: String| Failure::World { name: format!("nested loops, seed {seed}"), reason };
        let site = Arc::new(worlds::corridor_grid(seed, self.length_m));
        let odometry = OdometryNoise::default().with_slips().times(self.wheels);
        let drive = DriveSettings { odometry, ..DriveSettings::long_drive(seed) };
        let recorded = Drive::new(Arc::clone(&site), drive.clone());
        let world = if self.noise > 0.0 {
            let noisy = recorded.scans().perturb_odometry(self.noise, seed);
            Simulated::map_watched(noisy.map(Event::Scan), &self.settings, |_, _, _| {})?
        } else {
            Simulated::map(recorded, &self.settings)?
        };
        let pairs = true_pairs(&world, &Revisits::of(&site, &drive));
        let batch = batch_poses(&world, &pairs).map_err(|cause| failure(cause.to_string()))?;
        let ate = |poses| world.keyframe_ate_m(poses).map_err(|cause| failure(cause.to_string()));
        let (ate_m, batch_ate_m) = (ate(world.keyframe_poses())?, ate(&batch)?);
        let closings = world.closings();
        let wrong_closings = Wrong::among(&closings);
        Ok(World {
            seed,
            path_m: world.length_m(),
            scans: world.scan_count(),
            keyframes: world.keyframe_count(),
            closures: closings.iter().filter(|closing| closing.kind == mapwright::EdgeKind::Closure).count(),
            closings: closings.len(),
            wrong: wrong_closings.len(),
            wrong_closings,
            slips: world.session().slips().len(),
            ate_m,
            batch_ate_m,
            ratio: ate_m / batch_ate_m,
        })
    }

    fn line(world: &World) -> String {
        format!(
            "{:6}  {:4} closures, {:5} closing, {:3} wrong  ATE {:7.3} m, batch {:6.3} m, ratio {:6.2}  {:4.0} m of way",
            world.seed,
            world.closures,
            world.closings,
            world.wrong,
            world.ate_m,
            world.batch_ate_m,
            world.ratio,
            world.path_m,
        )
    }

    fn summary(&self, worlds: &[World]) -> (String, Value, Vec<Floor>) {
        let mut words = stats_in_words(
            worlds,
            &[("ATE", " m", |w| w.ate_m), ("batch", " m", |w| w.batch_ate_m), ("ratio", "", |w| w.ratio)],
        );
        let wrong: usize = worlds.iter().map(|world| world.wrong).sum();
        let closings: usize = worlds.iter().map(|world| world.closings).sum();
        let within = worlds.iter().filter(|world| world.ate_m <= MOST_ATE_M).count();
        words += &format!("wrong    {wrong} of {closings} closing edges\n");
        let mean = |stats: Option<ErrorStats>| stats.map(|stats| stats.mean);
        let value = json!({
            "length_m": self.length_m,
            "wheels": self.wheels,
            "noise": self.noise,
            "wrong_closings": wrong,
            "ate_m_mean": mean(stats(worlds, |w| w.ate_m)),
            "batch_ate_m_mean": mean(stats(worlds, |w| w.batch_ate_m)),
            "ratio_worst": stats(worlds, |w| w.ratio).map(|stats| stats.max),
        });
        let floors = vec![
            Floor::share("999 of 1000 closing edges right", RIGHT_SHARE, closings - wrong, closings),
            Floor::share("ATE at most 0.4 m in every world", 1.0, within, worlds.len()),
        ];
        (words, value, floors)
    }
}
