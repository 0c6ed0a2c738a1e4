//! Whether a cloud costs the same after kilometres as in the beginning: a drive through ever new halls, the last fifth of its way
//! compared with the second: CPU time a cloud, mean and median, and what is matched against. 16 beams of 360 columns, so that it is
//! quick; every second cloud of ten a second.
//!
//! `cargo run --release -p mapwright --example cost_over_way -- [METRES] [loops|no-loops]`

#![allow(clippy::print_stdout, reason = "an example's result")]

use mapwright::{Settings, SpaceMapper};
use mapwright_sim::RobotSettings;
use mapwright_sim::space::{LidarSettings, SpaceDrive, SpaceDriveSettings, worlds};
use std::error::Error;
use std::fs;
use std::time::Instant;

const FIFTHS: usize = 5;
/// More than this, relative, is growth.
const FLAT: f64 = 0.2;
const SPEED_M_PER_S: f64 = 2.0;
const EVERY: usize = 2;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let length_m = arguments.next().map_or(Ok(5000.0), |metres| metres.parse::<f64>())?;
    let with_loops = arguments.next().is_none_or(|which| which != "no-loops");
    let mut mapper = SpaceMapper::new(settings(with_loops))?;
    let drive = drive(length_m);
    let (mut way_m, mut last) = (0.0, None);
    let mut fifths = vec![Fifth::default(); FIFTHS];
    for number in (0..).step_by(EVERY) {
        let Some(taken) = drive.cloud(number) else { break };
        let here = taken.world_from_robot;
        way_m += last.replace(here).map_or(0.0, |before| here.distance(before));
        let started = Clock::start();
        mapper.add_cloud(&taken.cloud);
        let spent_ms = started.spent_ms();
        let fifth = ((way_m / length_m * FIFTHS as f64) as usize).min(FIFTHS - 1);
        fifths[fifth].add(spent_ms, mapper.local_map_voxels());
    }
    let session = mapper.session();
    println!(
        "{way_m:.0} m of new ground, {} keyframes, {} candidates, resolution {:.2} m; loops {}",
        session.keyframes().len(),
        session.candidates().len(),
        mapper.resolution_m().unwrap_or(0.0),
        if with_loops { "looked for" } else { "not looked for" }
    );
    for (number, fifth) in (1..).zip(&fifths) {
        let (mean_ms, median_ms, voxels) = fifth.means();
        println!(
            "fifth {number}: {} clouds, {mean_ms:.2} ms a cloud, median {median_ms:.2} ms, {voxels:.0} voxels matched against",
            fifth.times_ms.len()
        );
    }
    let (second, last) = (fifths[1].means(), fifths[FIFTHS - 1].means());
    for (what, second, last) in [("mean", second.0, last.0), ("median", second.1, last.1), ("voxels", second.2, last.2)]
    {
        let change = last / second - 1.0;
        let verdict = if change <= FLAT { "flat within" } else { "GROWS by more than" };
        println!("{what}: {:+.0} % from the second fifth to the last, {verdict} 20 %", 100.0 * change);
    }
    Ok(())
}

fn settings(with_loops: bool) -> Settings {
    let mut settings = Settings::default();
    (settings.loops.by_pose, settings.loops.by_place) = (with_loops, with_loops);
    settings
}

fn drive(length_m: f64) -> SpaceDrive {
    let settings = SpaceDriveSettings::default();
    let settings = SpaceDriveSettings {
        robot: RobotSettings { speed_m_per_s: SPEED_M_PER_S, ..settings.robot },
        lidar: LidarSettings { columns: 360, ..LidarSettings::spinning(16) },
        seed: 1,
        ..settings
    };
    SpaceDrive::new(worlds::growing_halls(1, length_m).into(), settings)
}

/// What was measured on a fifth of the way.
#[derive(Debug, Clone, Default)]
struct Fifth {
    times_ms: Vec<f64>,
    voxels: usize,
}

impl Fifth {
    fn add(&mut self, spent_ms: f64, voxels: usize) {
        self.times_ms.push(spent_ms);
        self.voxels += voxels;
    }

    /// Mean and median of the milliseconds a cloud, and mean of the voxels.
    fn means(&self) -> (f64, f64, f64) {
        let mut sorted = self.times_ms.clone();
        sorted.sort_by(f64::total_cmp);
        let count = sorted.len().max(1) as f64;
        let median_ms = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
        (sorted.iter().sum::<f64>() / count, median_ms, self.voxels as f64 / count)
    }
}

/// CPU time of this thread where the system says (Linux), else the time that passes.
struct Clock {
    cpu_ns: Option<u64>,
    wall: Instant,
}

impl Clock {
    fn start() -> Self {
        Self { cpu_ns: cpu_ns(), wall: Instant::now() }
    }

    fn spent_ms(&self) -> f64 {
        match self.cpu_ns.zip(cpu_ns()) {
            Some((before, now)) => 1e-6 * now.saturating_sub(before) as f64,
            None => 1e3 * self.wall.elapsed().as_secs_f64(),
        }
    }
}

/// The first number of `schedstat`: nanoseconds on a CPU.
fn cpu_ns() -> Option<u64> {
    fs::read_to_string("/proc/thread-self/schedstat").ok()?.split(' ').next()?.parse().ok()
}
