//! `mapwright demo --sonar`: an office from sixteen sonars and bad wheels.

use super::finish;
use crate::args::DemoArgs;
use crate::failure::{Failure, Outcome};
use crate::interrupt::Interrupt;
use crate::mapping::{Mapping, settings_of};
use crate::output::OutputFolder;
use crate::session::earlier_in_plane;
use crate::sonar::{CellScore, SonarOffice, sonar_office};
use mapwright::Pose2;
use mapwright_eval::{Alignment, StampedPose, ate};
use mapwright_sim::Event;
use serde_json::json;

pub(super) fn run(args: &DemoArgs) -> Result<Outcome, Failure> {
    settings_of(&args.mapping)?;
    let interrupt = Interrupt::watch()?;
    let earlier = args.mapping.resume.as_ref().map(|path| earlier_in_plane(path)).transpose()?;
    let output = OutputFolder::create(&args.output)?;
    let name = format!("simulated office of 40 x 20 m, sonars, seed {}", args.seed);
    let mut mapping = Mapping::begin(&args.mapping, output, None, earlier)?;
    let (mut truth, mut wheels) = (Vec::new(), Vec::new());
    let SonarOffice { site, events } = sonar_office(args.seed);
    for event in events {
        match event {
            Event::Odometry(odometry) => mapping.add_odometry(&odometry, 0)?,
            Event::Scan(taken) => {
                mapping.add_sonar(&taken.reading, 0)?;
                let stamp = taken.reading.stamp;
                truth.push(StampedPose { stamp, world_from_robot: taken.world_from_robot });
                let said = taken.reading.odom_from_robot;
                wheels.extend(said.map(|odom_from_robot| StampedPose { stamp, world_from_robot: odom_from_robot }));
            }
        }
        if interrupt.came() {
            break;
        }
    }
    mapping.end_of_scans()?;
    if !interrupt.came() {
        mapping.look_again()?;
    }
    finish(args, &name, mapping, &truth, interrupt.came(), |mapping, absolute| {
        let failed = |cause| Failure::Score { path: args.output.clone(), cause };
        let by_wheels = ate(&truth, &wheels, Alignment::Rigid).map_err(failed)?.translation_m.rmse;
        let way: Vec<Pose2> = truth.iter().map(|pose| pose.world_from_robot).collect();
        let trajectory: Vec<_> = mapping.session().trajectory().map(|pose| (pose.stamp, pose.map_from_robot)).collect();
        let drawn = mapping.sonars.draw(&trajectory);
        let passes_per_hit = mapping.settings.map.passes_per_hit;
        let score = CellScore::of(&drawn, passes_per_hit, absolute.alignment.world_from_map, &site, &way);
        let words = format!(
            "         odometry alone: ATE rmse {by_wheels:.3} m\n         cells right within 0.15 m: {:.1} %, free {:.1} %, occupied {:.1} %; \
             of the walls near the way {:.1} % found\n",
            100.0 * score.right(),
            100.0 * score.free_share(),
            100.0 * score.occupied_share(),
            100.0 * score.walls_share()
        );
        let value = json!({
            "odometry_ate_rmse_m": by_wheels,
            "cells_right": score.right(),
            "free_right": score.free_share(),
            "occupied_right": score.occupied_share(),
            "walls_found": score.walls_share(),
        });
        Ok(Some((words, value)))
    })
}
