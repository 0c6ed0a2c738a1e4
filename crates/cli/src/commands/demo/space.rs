//! `mapwright demo --3d`, `--depth` and `--stereo`: a building of two storeys.

use crate::args::DemoArgs;
use crate::events::Interrupt;
use crate::failure::{Failure, Outcome};
use crate::mapping::settings_of;
use crate::space::{Run, Simulation, Source, map};
use mapwright_sim::RobotSettings;
use mapwright_sim::space::{LidarSettings, SpaceDrive, SpaceDriveSettings, worlds};

/// As of a small lidar, at a brisk walk; every so many-th of its ten clouds a second is mapped.
const BEAMS: usize = 16;
const COLUMNS: usize = 512;
const SPEED_M_PER_S: f64 = 1.5;
const EVERY: usize = 4;
/// Of a camera's thirty images a second every so many-th: five a second, between which the robot turns by 14 degrees at most.
const EVERY_IMAGE: usize = 6;

pub(super) fn run(args: &DemoArgs) -> Result<Outcome, Failure> {
    settings_of(&args.mapping)?;
    let interrupt = Interrupt::watch()?;
    let name = format!("simulated building of two storeys, seed {}", args.seed);
    let simulation = match (args.depth, args.stereo) {
        (true, _) => Simulation::of_depth(drive(args), EVERY_IMAGE),
        (_, true) => {
            Simulation::of_stereo(drive(args), EVERY_IMAGE).map_err(|cause| Failure::Log(cause.to_string()))?
        }
        _ => Simulation::of(drive(args), EVERY),
    };
    let simulation = if args.imu { simulation.with_imu() } else { simulation };
    let source = Source::Simulated(Box::new(simulation));
    map(
        &Run { name: &name, output: &args.output, mapping: &args.mapping, goes_on: false, mesh: false },
        source,
        &interrupt,
    )
}

fn drive(args: &DemoArgs) -> SpaceDrive {
    let settings = SpaceDriveSettings::default();
    let settings = SpaceDriveSettings {
        robot: RobotSettings { speed_m_per_s: SPEED_M_PER_S, ..settings.robot },
        lidar: LidarSettings { columns: COLUMNS, ..LidarSettings::spinning(BEAMS) },
        seed: args.seed,
        duration_s: args.seconds.unwrap_or(f64::INFINITY),
        ..settings
    };
    SpaceDrive::new(worlds::two_storey(args.seed).into(), settings)
}
