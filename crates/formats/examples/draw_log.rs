//! Draws a map of a CARMEN log (standard input) at the poses of a trajectory file into a PNG (standard output).
//!
//! `cargo run --release --example draw_log -- intel.gmapping_reference.txt < intel.clf > intel.png`
#![allow(clippy::print_stderr)]

use mapwright_formats::{
    CarmenReader, GridImage, LogEvent, Picture, UNKNOWN, dominant_wall_angle, open_log, read_trajectory, write_png,
};
use mapwright_geom::Pose2;
use mapwright_sensor::LaserScan;
use std::collections::HashMap;
use std::error::Error;
use std::fs::File;
use std::io::{BufWriter, stdin, stdout};
use std::time::Instant;

const RESOLUTION_M: f64 = 0.05;
const SIDE: usize = 2000;

/// How often each cell was hit and passed.
struct Counts {
    hits: Vec<u32>,
    passes: Vec<u32>,
}

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args().nth(1).ok_or("expected the name of a trajectory file")?;
    let poses = read_trajectory(open_log(File::open(path)?)?)?;
    let pose_at: HashMap<_, _> = poses.iter().map(|p| (p.stamp, p.world_from_robot)).collect();
    let mut counts = Counts { hits: vec![0; SIDE * SIDE], passes: vec![0; SIDE * SIDE] };
    let mut reader = CarmenReader::new(open_log(stdin().lock())?);
    while let Some(event) = reader.next_event()? {
        if let LogEvent::Scan(scan) = event
            && let Some(&world_from_robot) = pose_at.get(&scan.stamp)
        {
            counts.add(scan, world_from_robot);
        }
    }
    let map = counts.into_map();
    let way: Vec<Pose2> = poses.iter().map(|p| p.world_from_robot).collect();
    let started = Instant::now();
    let level_rad =
        if std::env::args().nth(2).is_some() { 0.0 } else { dominant_wall_angle(&map.wall_points_map(), RESOLUTION_M) };
    let levelled = started.elapsed();
    let picture = Picture { world_from_robot: &way, level_rad, ..Picture::default() };
    write_png(&map, &picture, BufWriter::new(stdout().lock()))?;
    eprintln!(
        "walls at {:.1} deg found in {levelled:?}, drawn in {:?}",
        level_rad.to_degrees(),
        started.elapsed() - levelled
    );
    Ok(())
}

impl Counts {
    fn add(&mut self, scan: &LaserScan, world_from_robot: Pose2) {
        let world_from_laser = world_from_robot * scan.laser.robot_from_laser;
        for (beam, &range_m) in scan.ranges_m.iter().enumerate() {
            let range_m = f64::from(range_m);
            if range_m >= scan.laser.range_max_m {
                continue;
            }
            let bearing_rad = scan.laser.angle_min_rad + beam as f64 * scan.laser.angle_step_rad;
            let along = |r: f64| world_from_laser.transform([r * bearing_rad.cos(), r * bearing_rad.sin()]);
            let steps = (range_m / RESOLUTION_M) as usize;
            for step in 0..steps.saturating_sub(1) {
                if let Some(at) = cell(along(step as f64 * RESOLUTION_M)) {
                    self.passes[at] += 1;
                }
            }
            if let Some(at) = cell(along(range_m)) {
                self.hits[at] += 1;
            }
        }
    }

    fn into_map(self) -> GridImage {
        let percent = |(&hits, &passes): (&u32, &u32)| {
            if hits + passes == 0 { UNKNOWN } else { (200 * hits / (2 * hits + passes)).min(100) as u8 }
        };
        let half_m = 0.5 * SIDE as f64 * RESOLUTION_M;
        GridImage {
            width: SIDE,
            height: SIDE,
            resolution_m: RESOLUTION_M,
            world_from_map: Pose2::new(-half_m, -half_m, 0.0),
            cells: self.hits.iter().zip(&self.passes).map(percent).collect(),
        }
    }
}

fn cell([x, y]: [f64; 2]) -> Option<usize> {
    let index = |w: f64| (w / RESOLUTION_M + 0.5 * SIDE as f64) as usize;
    let (u, v) = (index(x), index(y));
    (u < SIDE && v < SIDE).then_some(v * SIDE + u)
}
