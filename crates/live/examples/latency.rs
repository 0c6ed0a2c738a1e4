//! How long a pose takes to come out after its scan went in, at the pace of a real robot: a simulated drive, 1440 beams at 40 Hz, 100 readings
//! of odometry a second, loops closed on another thread.
//!
//! ```sh
//! cargo run --release -p mapwright-live --example latency [SECONDS]
//! ```
#![allow(clippy::print_stdout, clippy::expect_used, reason = "an example prints what it measures")]

use mapwright::{Jobs, Mapper, Settings};
use mapwright_geom::{Pose2, Pose3, Stamp};
use mapwright_live::{Arrived, Door, Gate, GateSettings, Heard, Told, map};
use mapwright_ros::messages::{Header, LaserScan, TfMessage, TransformStamped};
use mapwright_ros::{Encoding, encode};
use mapwright_sensor::LaserModel;
use mapwright_sim::{Drive, DriveSettings, Event, LaserSettings, worlds};
use nalgebra::{UnitQuaternion, Vector3};
use std::collections::BTreeMap;
use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

/// Lanes of the door: scans and transforms.
const LANES: [usize; 2] = [20, 2000];
const BEGIN: i64 = 1_000_000_000_000;

fn link(parent: &str, child: &str, stamp: Stamp, pose: Pose2) -> Vec<u8> {
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), pose.theta);
    let pose = Pose3 { translation: Vector3::new(pose.x, pose.y, 0.0), rotation };
    let header = Header::new(stamp, parent);
    let transform = TransformStamped { header, child_frame_id: child.into(), transform: pose.into() };
    encode(&TfMessage { transforms: vec![transform] }, Encoding::Cdr).expect("short")
}

/// What is heard, with the time at which it is.
fn heard(seconds: f64) -> Vec<(Duration, Stamp, Heard)> {
    let model = LaserModel { range_max_m: 20.0, ..LaserModel::half_circle("laser", 1440) };
    let laser = LaserSettings { model: Arc::new(model), ..LaserSettings::default() };
    let settings = DriveSettings {
        duration_s: seconds,
        scan_rate_hz: 40.0,
        odometry_rate_hz: 100.0,
        laser,
        ..DriveSettings::default()
    };
    let mount = Heard::Transforms { bytes: link("base_link", "laser", Stamp(BEGIN), Pose2::IDENTITY), is_static: true };
    let mut all = vec![(Duration::ZERO, Stamp(BEGIN), mount)];
    for event in Drive::new(worlds::loop_of(1, 60.0).into(), settings) {
        let (stamp, heard) = match event {
            Event::Odometry(odometry) => {
                let bytes = link("odom", "base_link", Stamp(odometry.stamp.0 + BEGIN), odometry.odom_from_robot);
                (odometry.stamp, Heard::Transforms { bytes, is_static: false })
            }
            Event::Scan(scan) => {
                let scan = scan.scan;
                let last_rad = scan.laser.angle_min_rad + (scan.ranges_m.len() - 1) as f64 * scan.laser.angle_step_rad;
                let message = LaserScan {
                    header: Header::new(Stamp(scan.stamp.0 + BEGIN), "laser"),
                    angle_min: scan.laser.angle_min_rad as f32,
                    angle_max: last_rad as f32,
                    angle_increment: scan.laser.angle_step_rad as f32,
                    range_max: scan.laser.range_max_m as f32,
                    ranges: scan.ranges_m[..].into(),
                    ..Default::default()
                };
                let bytes = encode(&message, Encoding::Cdr).expect("short");
                (scan.stamp, Heard::Scan { topic: "/scan".to_owned(), bytes })
            }
        };
        all.push((Duration::from_nanos(stamp.0 as u64), Stamp(stamp.0 + BEGIN), heard));
    }
    all
}

fn main() {
    let seconds: f64 = std::env::args().nth(1).map_or(30.0, |text| text.parse().expect("seconds"));
    let all = heard(seconds);
    let sent = all.iter().filter(|(_, _, heard)| matches!(heard, Heard::Scan { .. })).count();
    let mut settings = Settings::default();
    settings.loops.jobs = Jobs::HandedOut;
    let mut mapper = Mapper::new(settings).expect("valid");
    let (door, mut gate) = (Door::new(&LANES), Gate::new(GateSettings::default()));
    let started = Instant::now();
    let mut came_out = BTreeMap::new();
    thread::scope(|scope| {
        scope.spawn(|| {
            for (at, stamp, heard) in &all {
                thread::sleep(at.saturating_sub(started.elapsed()));
                let lane = usize::from(!matches!(heard, Heard::Scan { .. }));
                door.put(lane, (Arrived { since_start: started.elapsed(), stamp: *stamp }, heard.clone()));
            }
            door.close();
        });
        let mut tell = |told: Told<'_>, _: &Mapper| {
            if let Told::Update(update) = told {
                came_out.entry(update.stamp).or_insert_with(|| started.elapsed());
            }
        };
        map(&door, &|| started.elapsed(), &mut gate, &mut mapper, &mut tell).expect("built-in definitions");
    });
    let went_in = |stamp: &Stamp| Duration::from_nanos((stamp.0 - BEGIN) as u64);
    let mut waits: Vec<f64> =
        came_out.iter().map(|(stamp, out)| out.saturating_sub(went_in(stamp)).as_secs_f64() * 1e3).collect();
    waits.sort_by(f64::total_cmp);
    let share = |share: f64| waits[((waits.len() - 1) as f64 * share) as usize];
    let (_, overtaken) = door.counts(0);
    println!("{sent} scans of 1440 beams at 40 Hz: {} mapped, {overtaken} overtaken", waits.len());
    gate.tallies().for_each(|(topic, tally)| println!("{topic}: {tally}"));
    println!("pose out after scan in, ms: median {:.1}, p99 {:.1}, at most {:.1}", share(0.5), share(0.99), share(1.0));
    let closures = mapper.edges().filter(|edge| edge.kind == mapwright::EdgeKind::Closure).count();
    println!("{} keyframes, {closures} closures", mapper.keyframes().len());
}
