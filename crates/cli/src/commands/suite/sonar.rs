//! `mapwright suite sonar`

use super::Measure;
use super::floors::{Floor, stats_in_words};
use crate::failure::Failure;
use crate::sonar::{CellScore, SonarOffice, Sonars, sonar_office};
use mapwright::{LaserScan, Mapper, Pose2, Settings, Stamp, Status, Verdict};
use mapwright_eval::{Alignment, Ate, PosePair, ate_of_pairs};
use mapwright_sim::Event;
use serde::Serialize;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// The map's error may be so much of odometry's, and so many of its cells must be right.
const MOST_OF_ODOMETRY: f64 = 0.5;
const LEAST_RIGHT: f64 = 0.8;

pub(super) struct SonarOffices {
    pub(super) settings: Settings,
}

#[derive(Debug, Serialize)]
pub(super) struct World {
    seed: u64,
    path_m: f64,
    /// Stretches of way that were mapped, and those of them that were doubtful or lost.
    stretches: usize,
    in_doubt: usize,
    closures: usize,
    maps: usize,
    ate_m: f64,
    odometry_ate_m: f64,
    ratio: f64,
    /// By odometry in the directions that walls have corrected, before anything is mapped.
    compass_ate_m: f64,
    cells_right: f64,
    free_right: f64,
    occupied_right: f64,
    walls_found: f64,
    echoes_of_walls: u64,
    echoes_alone: u64,
    silent: u64,
}

impl Measure for SonarOffices {
    type World = World;
    const NAME: &'static str = "sonar";
    const FILES: [&'static str; 2] = ["sonar.jsonl", "sonar.json"];

    fn world(&self, seed: u64) -> Result<World, Failure> {
        let SonarOffice { site, events } = sonar_office(seed);
        let (mut mapper, mut sonars) = (Mapper::new(self.settings)?, Sonars::default());
        let (mut truth, mut way, mut in_doubt) = (BTreeMap::new(), Vec::new(), 0);
        let mut corrected = BTreeMap::new();
        let mut take = |mapper: &mut Mapper, scans: Vec<LaserScan>| {
            for scan in scans {
                corrected.insert(scan.stamp, scan.odom_from_robot);
                in_doubt += usize::from(mapper.add_scan(&scan).status != Status::Tracking);
            }
        };
        for event in events {
            match event {
                Event::Odometry(odometry) => mapper.add_odometry(&odometry),
                Event::Scan(taken) => {
                    truth.insert(taken.reading.stamp, (taken.world_from_robot, taken.reading.odom_from_robot));
                    way.push(taken.world_from_robot);
                    take(&mut mapper, sonars.add(&taken.reading));
                }
            }
        }
        take(&mut mapper, sonars.end());
        mapper.look_again();
        let trajectory: Vec<_> = mapper.trajectory().map(|pose| (pose.stamp, pose.map_from_robot)).collect();
        let failure = |reason: String| Failure::World { name: format!("sonar office, seed {seed}"), reason };
        let errors = |said: &dyn Fn(Stamp, Pose2) -> Option<Pose2>| -> Result<Ate, Failure> {
            let pair = |&(stamp, map_from_robot): &(_, Pose2)| {
                let (world_from_robot, _) = *truth.get(&stamp)?;
                Some(PosePair { stamp, world_from_robot, map_from_robot: said(stamp, map_from_robot)? })
            };
            let pairs: Vec<_> = trajectory.iter().filter_map(pair).collect();
            ate_of_pairs(&pairs, Alignment::Rigid).map_err(|cause| failure(cause.to_string()))
        };
        let ate = errors(&|_, map_from_robot| Some(map_from_robot))?;
        let odometry = errors(&|stamp, _| truth.get(&stamp)?.1)?;
        let compass = errors(&|stamp, _| *corrected.get(&stamp)?)?;
        let (drawn, passes_per_hit) = (sonars.draw(&trajectory), self.settings.map.passes_per_hit);
        let cells = CellScore::of(&drawn, passes_per_hit, ate.alignment.world_from_map, &site, &way);
        let counts = sonars.counts();
        Ok(World {
            seed,
            path_m: way.windows(2).map(|step| step[0].distance(step[1])).sum(),
            stretches: trajectory.len(),
            in_doubt,
            closures: mapper.session().candidates().iter().filter(|found| found.verdict == Verdict::Accepted).count(),
            maps: mapper.session().maps().len(),
            ate_m: ate.translation_m.rmse,
            odometry_ate_m: odometry.translation_m.rmse,
            ratio: ate.translation_m.rmse / odometry.translation_m.rmse,
            compass_ate_m: compass.translation_m.rmse,
            cells_right: cells.right(),
            free_right: cells.free_share(),
            occupied_right: cells.occupied_share(),
            walls_found: cells.walls_share(),
            echoes_of_walls: counts.used,
            echoes_alone: counts.alone,
            silent: counts.nothing,
        })
    }

    fn line(world: &World) -> String {
        let percent = |share: f64| 100.0 * share;
        format!(
            "{:6}  ATE {:6.3} m, by headings alone {:6.3} m, odometry {:6.3} m ({:.2}); {:4.1} % of the cells right (free {:4.1}, occupied {:4.1}), {:4.1} % of the \
             walls found; {:4.0} m, {:4} stretches, {:3} in doubt, {:2} closures, {} maps",
            world.seed,
            world.ate_m,
            world.compass_ate_m,
            world.odometry_ate_m,
            world.ratio,
            percent(world.cells_right),
            percent(world.free_right),
            percent(world.occupied_right),
            percent(world.walls_found),
            world.path_m,
            world.stretches,
            world.in_doubt,
            world.closures,
            world.maps,
        )
    }

    fn summary(&self, worlds: &[World]) -> (String, Value, Vec<Floor>) {
        let words = stats_in_words(
            worlds,
            &[
                ("ATE", " m", |world: &World| world.ate_m),
                ("odometry", " m", |world| world.odometry_ate_m),
                ("headings", " m", |world| world.compass_ate_m),
                ("ratio", "", |world| world.ratio),
                ("wrong", "", |world| 1.0 - world.cells_right),
                ("occupied", " wrong", |world| 1.0 - world.occupied_right),
                ("walls", " missed", |world| 1.0 - world.walls_found),
            ],
        );
        let mean = |pick: fn(&World) -> f64| worlds.iter().map(pick).sum::<f64>() / worlds.len().max(1) as f64;
        let value = json!({
            "ate_m_mean": mean(|world| world.ate_m),
            "odometry_ate_m_mean": mean(|world| world.odometry_ate_m),
            "compass_ate_m_mean": mean(|world| world.compass_ate_m),
            "ratio_mean": mean(|world| world.ratio),
            "cells_right_mean": mean(|world| world.cells_right),
            "walls_found_mean": mean(|world| world.walls_found),
        });
        let better = worlds.iter().filter(|world| world.ratio <= MOST_OF_ODOMETRY).count();
        let right = worlds.iter().filter(|world| world.cells_right >= LEAST_RIGHT).count();
        let floors = vec![
            Floor::share("ATE at most half of odometry's in every world", 1.0, better, worlds.len()),
            Floor::share("80 % of the cells right in every world", 1.0, right, worlds.len()),
        ];
        (words, value, floors)
    }
}
