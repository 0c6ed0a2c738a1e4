//! How long a pose takes to come out after its scan went in, at the pace of a real robot: a simulated drive, 1440 beams at 40 Hz, 100 readings
//! of odometry a second, loops closed on another thread.
//!
//! ```sh
//! cargo run --release -p mapwright-live --example latency [SECONDS]
//! ```
#![allow(clippy::print_stdout, clippy::expect_used, reason = "an example prints what it measures")]

#[path = "../src/mapping/tests/robot.rs"]
mod robot;

use mapwright::{Jobs, Mapper, Settings, Update};
use mapwright_geom::Stamp;
use mapwright_live::{Arrived, Door, Driver, Gate, GateSettings, Heard, Passed, Reading, map};
use mapwright_sensor::LaserModel;
use mapwright_sim::{DriveSettings, LaserSettings};
use robot::{BEGIN, Driven, lane};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

/// How many scans and transforms wait at the door at most.
const LANES: [usize; 2] = [20, 2000];

fn main() {
    let seconds: f64 = std::env::args().nth(1).map_or(30.0, |text| text.parse().expect("seconds"));
    let laser = LaserSettings::with_field_of_view(std::f64::consts::PI, 1440);
    let model = LaserModel { name: "laser".to_owned(), range_max_m: 20.0, ..(*laser.model).clone() };
    let laser = LaserSettings { model: Arc::new(model), ..laser };
    let (scan_rate_hz, odometry_rate_hz) = (40.0, 100.0);
    let drive =
        DriveSettings { duration_s: seconds, scan_rate_hz, odometry_rate_hz, laser, ..DriveSettings::default() };
    let all = robot::heard(drive, mapwright_geom::Pose2::IDENTITY);
    let sent = all.iter().filter(|(_, heard)| lane(heard) == 0).count();
    let mut settings = Settings::default();
    settings.loops.jobs = Jobs::HandedOut;
    let (door, mut gate) = (Door::new(&LANES), Gate::new(GateSettings::default()));
    let went_in = |stamp: Stamp| Duration::from_nanos((stamp.0 - BEGIN.0) as u64);
    let started = Instant::now();
    let mut came_out = BTreeMap::new();
    let mut driven = Driven::new(Mapper::new(settings).expect("valid"), |update: &Update| {
        came_out.entry(update.stamp).or_insert_with(|| started.elapsed());
    });
    thread::scope(|scope| {
        scope.spawn(|| {
            for (stamp, heard) in all {
                thread::sleep(went_in(stamp).saturating_sub(started.elapsed()));
                door.put(lane(&heard), (Arrived { since_start: started.elapsed(), stamp }, heard));
            }
            door.close();
        });
        map(&door, &|| started.elapsed(), &mut gate, &mut driven).expect("built-in definitions");
    });
    let Driven { mapper, .. } = driven;
    let mut waits: Vec<f64> =
        came_out.iter().map(|(stamp, out)| out.saturating_sub(went_in(*stamp)).as_secs_f64() * 1e3).collect();
    waits.sort_by(f64::total_cmp);
    let share = |share: f64| waits[((waits.len() - 1) as f64 * share) as usize];
    let (_, overtaken) = door.counts(0);
    println!("{sent} scans of 1440 beams at 40 Hz: {} mapped, {overtaken} overtaken", waits.len());
    gate.tallies().for_each(|(topic, tally)| println!("{topic}: {tally}"));
    println!("pose out after scan in, ms: median {:.1}, p99 {:.1}, at most {:.1}", share(0.5), share(0.99), share(1.0));
    let closures = mapper.edges().filter(|edge| edge.kind == mapwright::EdgeKind::Closure).count();
    println!("{} keyframes, {closures} closures", mapper.keyframes().len());
}
