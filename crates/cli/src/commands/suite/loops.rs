//! `mapwright suite loops`

use super::Measure;
use super::floors::{Floor, stats, stats_in_words};
use crate::batch::{batch_poses, true_pairs};
use crate::failure::Failure;
use crate::simulated::{Closing, Simulated};
use mapwright::Settings;
use mapwright_eval::ErrorStats;
use mapwright_sim::{Drive, DriveSettings, Revisits, worlds};
use serde::Serialize;
use serde_json::{Value, json};
use std::sync::Arc;

/// A loop is closed between the first and the last so much of its way, metres.
const ENDS_M: f64 = 30.0;
/// The error may be so many times that of the batch solve.
pub(super) const MOST_RATIO: f64 = 1.3;

pub(super) struct Loops {
    pub(super) length_m: f64,
    pub(super) settings: Settings,
}

#[derive(Debug, Serialize)]
pub(super) struct World {
    seed: u64,
    path_m: f64,
    scans: usize,
    keyframes: usize,
    closed: bool,
    closings: usize,
    wrong: usize,
    candidates: usize,
    true_closures: usize,
    /// Of the keyframes, as the batch solve's.
    ate_m: f64,
    batch_ate_m: f64,
    ratio: f64,
    /// Of all scans.
    trajectory_ate_m: f64,
}

impl Measure for Loops {
    type World = World;
    const NAME: &'static str = "loops";
    const FILES: [&'static str; 2] = ["loops.jsonl", "loops.json"];

    fn world(&self, seed: u64) -> Result<World, Failure> {
        let failure = |reason: String| Failure::World { name: format!("loop, seed {seed}"), reason };
        let site = Arc::new(worlds::loop_of(seed, self.length_m));
        let drive = DriveSettings::long_drive(seed);
        let world = Simulated::map(Drive::new(Arc::clone(&site), drive.clone()), &self.settings)?;
        let pairs = true_pairs(&world, &Revisits::of(&site, &drive));
        let batch = batch_poses(&world, &pairs).map_err(|cause| failure(cause.to_string()))?;
        let ate = |poses| world.keyframe_ate_m(poses).map_err(|cause| failure(cause.to_string()));
        let (ate_m, batch_ate_m) = (ate(world.keyframe_poses())?, ate(&batch)?);
        let closings = world.closings();
        Ok(World {
            seed,
            path_m: world.length_m(),
            scans: world.scan_count(),
            keyframes: world.keyframe_count(),
            closed: closings.iter().any(|closing| closing.is_right() && joins_the_ends(&world, closing)),
            closings: closings.len(),
            wrong: closings.iter().filter(|closing| !closing.is_right()).count(),
            candidates: world.session().candidates().len(),
            true_closures: pairs.len(),
            ate_m,
            batch_ate_m,
            ratio: ate_m / batch_ate_m,
            trajectory_ate_m: world.trajectory_ate_m().map_err(|cause| failure(cause.to_string()))?,
        })
    }

    fn line(world: &World) -> String {
        format!(
            "{:6}  {}  {:5} closing, {:3} wrong  ATE {:7.3} m, batch {:6.3} m, ratio {:6.2}  {:4.0} m of way",
            world.seed,
            if world.closed { "closed" } else { "open  " },
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
        let closed = worlds.iter().filter(|world| world.closed).count();
        let wrong: usize = worlds.iter().map(|world| world.wrong).sum();
        let mean = |stats: Option<ErrorStats>| stats.map(|stats| stats.mean);
        let value = json!({
            "length_m": self.length_m,
            "closed": closed,
            "wrong_closings": wrong,
            "ate_m_mean": mean(stats(worlds, |w| w.ate_m)),
            "batch_ate_m_mean": mean(stats(worlds, |w| w.batch_ate_m)),
            "ratio_worst": stats(worlds, |w| w.ratio).map(|stats| stats.max),
        });
        words += &format!("wrong    {wrong} closing edges\n");
        let within = worlds.iter().filter(|world| world.ratio <= MOST_RATIO).count();
        let floors = vec![
            Floor::share("every loop closed", 1.0, closed, worlds.len()),
            Floor::share("ratio at most 1.3 in every world", 1.0, within, worlds.len()),
        ];
        (words, value, floors)
    }
}

fn joins_the_ends(world: &Simulated, closing: &Closing) -> bool {
    world.along_m(closing.from) <= ENDS_M && world.along_m(closing.to) >= world.length_m() - ENDS_M
}
