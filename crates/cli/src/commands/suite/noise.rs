//! `mapwright suite noise`

use super::Measure;
use super::floors::Floor;
use crate::args::NoiseArgs;
use crate::commands::eval::read_relation_file;
use crate::commands::perturb::Scans;
use crate::failure::Failure;
use crate::simulated::map_events;
use mapwright::{LaserScan, Settings, Status};
use mapwright_eval::{ErrorStats, PoseErrors, Relation, StampedPose, relation_errors};
use mapwright_sim::{Event, PerturbScans};
use serde::Serialize;
use serde_json::{Value, json};

pub(super) struct Noise {
    amount: f64,
    settings: Settings,
    scans: Vec<LaserScan>,
    relations: Vec<Relation>,
    /// What of the log could not be read.
    losses: Vec<String>,
}

#[derive(Debug, Serialize)]
pub(super) struct World {
    seed: u64,
    relations: usize,
    missing: usize,
    translation_m: f64,
    translation_std_m: f64,
    rotation_deg: f64,
    lost_scans: usize,
}

impl Noise {
    pub(super) fn read(args: &NoiseArgs, settings: Settings) -> Result<Self, Failure> {
        let relations = read_relation_file(&args.relations)?;
        let mut reader = Scans::open(&args.log)?;
        let scans = reader.by_ref().collect();
        let losses = reader.finish()?.losses();
        Ok(Self { amount: args.amount, settings, scans, relations, losses })
    }
}

impl Measure for Noise {
    type World = World;
    const NAME: &'static str = "noise";
    const FILES: [&'static str; 2] = ["noise.jsonl", "noise.json"];

    fn world(&self, seed: u64) -> Result<World, Failure> {
        let mut lost_scans = 0;
        let scans = self.scans.iter().cloned().perturb_odometry(self.amount, seed);
        let session = map_events(scans.map(Event::Scan), &self.settings, |_, update, _| {
            lost_scans += usize::from(update.status == Status::Lost);
        })?;
        let pose =
            |pose: mapwright::TrajectoryPose| StampedPose { stamp: pose.stamp, world_from_robot: pose.map_from_robot };
        let report = relation_errors(&session.trajectory().map(pose).collect::<Vec<_>>(), &self.relations);
        let none = || Failure::World {
            name: format!("noise, seed {seed}"),
            reason: "no relation has its stamps in the log".into(),
        };
        let PoseErrors { translation_m, rotation_deg } = report.all.ok_or_else(none)?;
        Ok(World {
            seed,
            relations: report.used,
            missing: report.missing,
            translation_m: translation_m.mean,
            translation_std_m: translation_m.std,
            rotation_deg: rotation_deg.mean,
            lost_scans,
        })
    }

    fn line(world: &World) -> String {
        format!(
            "{:6}  relation error {:.4} +- {:.4} m, {:.3} deg over {} relations, {} scans lost",
            world.seed,
            world.translation_m,
            world.translation_std_m,
            world.rotation_deg,
            world.relations,
            world.lost_scans,
        )
    }

    fn summary(&self, worlds: &[World]) -> (String, Value, Vec<Floor>) {
        let stats = |pick: fn(&World) -> f64| ErrorStats::of(&worlds.iter().map(pick).collect::<Vec<_>>());
        let (Some(metres), Some(degrees)) = (stats(|w| w.translation_m), stats(|w| w.rotation_deg)) else {
            return (String::new(), json!({}), Vec::new());
        };
        let worst = worlds.iter().max_by(|a, b| a.translation_m.total_cmp(&b.translation_m)).map(|world| world.seed);
        let words = format!(
            "mean     {:.4} m, {:.3} deg\nworst    {:.4} m (seed {}), {:.3} deg\n",
            metres.mean,
            degrees.mean,
            metres.max,
            worst.unwrap_or_default(),
            degrees.max,
        );
        let value = json!({
            "amount": self.amount,
            "translation_m": { "mean": metres.mean, "worst": metres.max, "worst_seed": worst },
            "rotation_deg": { "mean": degrees.mean, "worst": degrees.max },
        });
        let found = if self.losses.is_empty() { "yes".to_owned() } else { self.losses.join("; ") };
        let floors = vec![Floor { what: "all of the log read", found, holds: self.losses.is_empty() }];
        (words, value, floors)
    }
}
