//! Drives through a world in space and writes what the lidar saw:
//! `space_drive [two-storey|loops-1km|look-alike|courtyard] [seed] [folder] [clouds] [beams]`.
//!
//! Into the folder go `clouds/000000.bin` (little-endian `f32` x, y, z in metres in the sensor's frame, and an intensity that is
//! always 0.5, as in KITTI), `times.txt` (seconds), `poses_tum.txt` and `odometry_tum.txt` (`t x y z qx qy qz qw`, true
//! world_from_sensor, and the wheels' odom_from_robot) at each cloud's stamp. Points are as they were measured, distorted by the
//! robot's motion; `point_times/000000.bin` has the seconds of each after the stamp, as `f32`. No folder, or `-`: nothing is written.
#![allow(clippy::print_stdout, reason = "an example")]

use mapwright_geom::Pose3;
use mapwright_sensor::Cloud;
use mapwright_sim::space::{LidarSettings, SpaceDrive, SpaceDriveSettings, SpaceSite, worlds};
use std::error::Error;
use std::fmt::Write as _;
use std::path::Path;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let argument = |k: usize, otherwise: &'static str| arguments.get(k).map_or(otherwise, String::as_str).to_owned();
    let seed: u64 = argument(1, "1").parse()?;
    let folder = argument(2, "-");
    let (at_most, beams) = (argument(3, "200").parse::<usize>()?, argument(4, "32").parse()?);
    let start = Instant::now();
    let site = world(&argument(0, "two-storey"), seed)?;
    println!("world: {} boxes, {:.2} s", site.world.solids().len(), start.elapsed().as_secs_f64());
    let settings = SpaceDriveSettings { lidar: LidarSettings::spinning(beams), seed, ..SpaceDriveSettings::default() };
    let points = settings.lidar.points();
    let start = Instant::now();
    let drive = SpaceDrive::new(site.into(), settings);
    let (way_m, seconds) = (drive.site().length_m(), drive.duration_s());
    println!("drive: {way_m:.1} m in {seconds:.1} s, simulated in {:.2} s", start.elapsed().as_secs_f64());
    rays(&drive, seconds);
    let out = (folder != "-").then(|| Path::new(&folder));
    let (mut taken, mut busy_s) = (0, 0.0);
    let (mut times, mut poses, mut odometry) = (String::new(), String::new(), String::new());
    let mut start = Instant::now();
    for cloud in drive.clouds().take(at_most) {
        busy_s += start.elapsed().as_secs_f64();
        let stamp_s = cloud.cloud.stamp.as_secs_f64();
        writeln!(times, "{stamp_s:.6}")?;
        writeln!(poses, "{stamp_s:.6} {}", tum(cloud.world_from_robot * cloud.cloud.sensor.robot_from_sensor))?;
        writeln!(odometry, "{stamp_s:.6} {}", tum(cloud.cloud.odom_from_robot.unwrap_or_default()))?;
        if let Some(folder) = out {
            write_cloud(folder, taken, &cloud.cloud)?;
        }
        taken += 1;
        start = Instant::now();
    }
    println!("lidar: {taken} clouds, {:.2} M points/s with noise and motion", (taken * points) as f64 / busy_s / 1e6);
    if let Some(folder) = out {
        std::fs::write(folder.join("times.txt"), times)?;
        std::fs::write(folder.join("poses_tum.txt"), poses)?;
        std::fs::write(folder.join("odometry_tum.txt"), odometry)?;
    }
    Ok(())
}

fn world(name: &str, seed: u64) -> Result<SpaceSite, String> {
    match name {
        "two-storey" => Ok(worlds::two_storey(seed)),
        "loops-1km" => Ok(worlds::loops_1km(seed)),
        "look-alike" => Ok(worlds::look_alike_storeys(seed)),
        "courtyard" => Ok(worlds::courtyard(seed)),
        other => Err(format!("expected two-storey, loops-1km, look-alike or courtyard, found {other}")),
    }
}

/// Rays alone, all over the drive.
fn rays(drive: &SpaceDrive, seconds: f64) {
    let (mut count, mut sum_m) = (0_u32, 0.0);
    let start = Instant::now();
    for station in 0..200 {
        let stamp = mapwright_geom::Stamp::from_secs_f64(seconds * f64::from(station) / 200.0);
        let Some(world_from_robot) = drive.world_from_robot(stamp) else { continue };
        let eye: [f64; 3] = world_from_robot.transform([0.0, 0.0, 0.9].into()).into();
        for column in 0..500 {
            let (sin, cos) = (f64::from(column) * std::f64::consts::TAU / 500.0).sin_cos();
            for beam in 0..32 {
                let (up, out) = (-0.39 + 0.78 * f64::from(beam) / 31.0).sin_cos();
                sum_m += drive.site().world.cast(eye, [out * cos, out * sin, up], 100.0).map_or(0.0, |hit| hit.at);
                count += 1;
            }
        }
    }
    let per_s = f64::from(count) / start.elapsed().as_secs_f64();
    println!("rays: {:.2} M/s, {:.2} m on average", per_s / 1e6, sum_m / f64::from(count));
}

fn tum(pose: Pose3) -> String {
    let (t, q) = (pose.translation, pose.rotation.coords);
    format!("{:.6} {:.6} {:.6} {:.9} {:.9} {:.9} {:.9}", t.x, t.y, t.z, q.x, q.y, q.z, q.w)
}

fn write_cloud(folder: &Path, number: usize, cloud: &Cloud) -> Result<(), Box<dyn Error>> {
    let (clouds, times) = (folder.join("clouds"), folder.join("point_times"));
    std::fs::create_dir_all(&clouds)?;
    std::fs::create_dir_all(&times)?;
    let seen = || cloud.points_m.iter().zip(&cloud.times_s).filter(|(point, _)| point[0].is_finite());
    let points = seen().flat_map(|([x, y, z], _)| [*x, *y, *z, 0.5]).flat_map(f32::to_le_bytes);
    std::fs::write(clouds.join(format!("{number:06}.bin")), points.collect::<Vec<u8>>())?;
    let seconds = seen().flat_map(|(_, time_s)| time_s.to_le_bytes());
    std::fs::write(times.join(format!("{number:06}.bin")), seconds.collect::<Vec<u8>>())?;
    Ok(())
}
