//! A robot with a lidar drives through a simulated building of two storeys, with and without its wheels: how far the map is from the truth.
//!
//! `cargo run --release -p mapwright --example map_a_building -- [SEED] [SECONDS]`
#![allow(clippy::print_stdout, reason = "an example's result")]

use mapwright::{EdgeKind, Pose3, Settings, SpaceMapper, Stamp};
use mapwright_eval::{Alignment, RpeSettings, space_errors};
use mapwright_sim::space::{SpaceDrive, SpaceDriveSettings, worlds};
use std::error::Error;
use std::sync::Arc;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let seed = arguments.next().map_or(Ok(1), |seed| seed.parse::<u64>())?;
    let duration_s = arguments.next().map_or(Ok(f64::INFINITY), |seconds| seconds.parse::<f64>())?;
    let site = Arc::new(worlds::two_storey(seed));
    let drive = SpaceDrive::new(site, SpaceDriveSettings { seed, duration_s, ..SpaceDriveSettings::default() });
    for with_wheels in [true, false] {
        let mut mapper = SpaceMapper::new(Settings::default())?;
        let (mut truth, mut mapping_s) = (Vec::<(Stamp, Pose3)>::new(), 0.0);
        for taken in drive.clouds() {
            let mut cloud = taken.cloud;
            cloud.odom_from_robot = cloud.odom_from_robot.filter(|_| with_wheels);
            truth.push((cloud.stamp, taken.world_from_robot));
            let started = Instant::now();
            mapper.add_cloud(&cloud);
            mapping_s += started.elapsed().as_secs_f64();
        }
        let session = mapper.session();
        let way: Vec<(Stamp, Pose3)> = session.trajectory().map(|pose| (pose.stamp, pose.map_from_robot)).collect();
        let errors = space_errors(&truth, &way, Alignment::Rigid, &RpeSettings::default())?;
        let closures = session.edges().filter(|edge| edge.kind == EdgeKind::Closure).count();
        println!(
            "{} wheels: ATE {:.3} m, worst {:.3} m, over {} clouds; {} keyframes, {closures} closures; {:.1} ms a cloud",
            if with_wheels { "with" } else { "without" },
            errors.absolute.translation_m.rmse,
            errors.absolute.translation_m.max,
            way.len(),
            session.keyframes().len(),
            1e3 * mapping_s / way.len().max(1) as f64
        );
    }
    Ok(())
}
