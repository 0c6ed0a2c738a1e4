//! `mapwright suite offices`

use super::Measure;
use super::floors::Floor;
use crate::failure::Failure;
use crate::simulated::{Simulated, office};
use mapwright::{Settings, Status, Verdict};
use mapwright_eval::ErrorStats;
use serde::Serialize;
use serde_json::{Value, json};

/// The error may be so much, metres.
const MOST_ATE_M: f64 = 0.05;

pub(super) struct Offices {
    pub(super) people: usize,
    pub(super) settings: Settings,
}

#[derive(Debug, Serialize)]
pub(super) struct World {
    seed: u64,
    path_m: f64,
    scans: usize,
    /// Scans of which part was dropped because it moved, and those that were doubtful or lost.
    with_movers: usize,
    in_doubt: usize,
    closures: usize,
    ate_m: f64,
}

impl Measure for Offices {
    type World = World;
    const NAME: &'static str = "offices";
    const FILES: [&'static str; 2] = ["offices.jsonl", "offices.json"];

    fn world(&self, seed: u64) -> Result<World, Failure> {
        let (mut with_movers, mut in_doubt) = (0, 0);
        let world = Simulated::map_watched(office(seed, self.people), &self.settings, |_, update, _| {
            with_movers += usize::from(update.beams.moving > 0);
            in_doubt += usize::from(update.status != Status::Tracking);
        })?;
        let failure = |reason: String| Failure::World { name: format!("office floor, seed {seed}"), reason };
        Ok(World {
            seed,
            path_m: world.length_m(),
            scans: world.scan_count(),
            with_movers,
            in_doubt,
            closures: world.session().candidates().iter().filter(|found| found.verdict == Verdict::Accepted).count(),
            ate_m: world.trajectory_ate_m().map_err(|cause| failure(cause.to_string()))?,
        })
    }

    fn line(world: &World) -> String {
        format!(
            "{:6}  ATE {:6.3} m  {:4.0} m of way, {:5} scans, {:4} with movers, {:4} in doubt, {:2} closures",
            world.seed, world.ate_m, world.path_m, world.scans, world.with_movers, world.in_doubt, world.closures,
        )
    }

    fn summary(&self, worlds: &[World]) -> (String, Value, Vec<Floor>) {
        let ate = ErrorStats::of(&worlds.iter().map(|world| world.ate_m).collect::<Vec<_>>());
        let words = ate.as_ref().map_or(String::new(), |ate| {
            format!("ATE      mean {:.3} m, median {:.3} m, worst {:.3} m\n", ate.mean, ate.median, ate.max)
        });
        let value = json!({
            "people": self.people,
            "ate_m_mean": ate.as_ref().map(|ate| ate.mean),
            "ate_m_worst": ate.as_ref().map(|ate| ate.max),
        });
        let within = worlds.iter().filter(|world| world.ate_m <= MOST_ATE_M).count();
        (words, value, vec![Floor::share("ATE at most 0.05 m in every world", 1.0, within, worlds.len())])
    }
}
