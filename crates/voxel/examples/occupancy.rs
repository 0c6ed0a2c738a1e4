//! What occupancy of a folder of `.bin` clouds costs: `FOLDER_OF_BIN POSES_TUM RESOLUTION_M [MAX_RANGE_M] [OUT.bt]`.
#![allow(missing_docs, clippy::print_stdout, clippy::unwrap_used)]

use mapwright_geom::Pose3;
use mapwright_voxel::{Change, Occupancy, OccupancySettings, write_bt};
use std::path::{Path, PathBuf};

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let number = |at: usize, default: f64| arguments.get(at).map_or(default, |text| text.parse().unwrap());
    let settings = OccupancySettings { resolution_m: number(3, 0.1), max_range_m: number(4, 60.0) };
    let (files, poses) = (clouds(Path::new(&arguments[1])), poses(Path::new(&arguments[2])));
    let mut occupancy = Occupancy::new(settings);
    let (mut points, mut cpu_s) = (0, 0.0);
    for (file, pose) in files.iter().zip(poses) {
        let bytes = std::fs::read(file).unwrap();
        let number = |bytes: &[u8]| f32::from_le_bytes(bytes.try_into().unwrap());
        let cloud = bytes.chunks_exact(16).map(|c| [number(&c[..4]), number(&c[4..8]), number(&c[8..12])]);
        points += cloud.len();
        let before_s = cpu_now_s();
        occupancy.draw(cloud, [0.0; 3], pose, Change::Add);
        cpu_s += cpu_now_s() - before_s;
    }
    println!(
        "{} clouds, {points} points: {cpu_s:.2} s of CPU drawing, {:.1} MB so far at most",
        files.len(),
        peak_mb()
    );
    let (mut occupied, mut known) = (0, 0);
    occupancy.voxels().for_each(|voxel| {
        known += 1;
        occupied += u32::from(voxel.log_odds() > 0.0);
    });
    println!("{occupied} voxels occupied, {} free", known - occupied);
    let before_s = cpu_now_s();
    let mut bt = Vec::new();
    let counts = write_bt(&occupancy, &mut bt).unwrap();
    let (nodes, leaves) = (counts.nodes, counts.occupied);
    println!(
        ".bt: {} bytes, {nodes} nodes, {leaves} occupied leaves, {:.2} s of CPU",
        bt.len(),
        cpu_now_s() - before_s
    );
    if let Some(file) = arguments.get(5) {
        std::fs::write(file, &bt).unwrap();
    }
    println!("in all {:.2} s of CPU, {:.1} MB at most", cpu_now_s(), peak_mb());
}

fn clouds(folder: &Path) -> Vec<PathBuf> {
    let files = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let mut files: Vec<_> = files.filter(|path| path.extension().is_some_and(|ending| ending == "bin")).collect();
    files.sort();
    files
}

fn poses(file: &Path) -> Vec<Pose3> {
    let text = std::fs::read_to_string(file).unwrap();
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    lines
        .map(|line| {
            let v: Vec<f64> = line.split_whitespace().map(|word| word.parse().unwrap()).collect();
            Pose3::from_quaternion([v[1], v[2], v[3]], [v[4], v[5], v[6], v[7]]).unwrap()
        })
        .collect()
}

/// User and system time of this process, seconds: fields 14 and 15 of its `stat`, hundredths.
fn cpu_now_s() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<&str> = stat.split_whitespace().collect();
    fields.get(13..15).map_or(0.0, |ticks| ticks.iter().map(|t| t.parse::<f64>().unwrap()).sum::<f64>() / 100.0)
}

fn peak_mb() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.map_or(0.0, |kb| kb.trim().trim_end_matches(" kB").parse::<f64>().unwrap() * 1024.0 / 1e6)
}
