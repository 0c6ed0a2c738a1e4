//! Simulated scans as points in the robot's frame, and maps made from them.
#![allow(dead_code, reason = "every test file uses some of it")]

use mapwright_geom::Pose2;
use mapwright_grid::{Change, LocalMap, LocalMapSettings};
use mapwright_sensor::{BeamTable, Sweep, SweepPoints};
use mapwright_sim::{Drive, DriveSettings, Site};
use std::sync::Arc;

/// A scan's points and where it was really taken.
#[derive(Clone)]
pub(crate) struct View {
    pub(crate) points: SweepPoints,
    pub(crate) world_from_robot: Pose2,
}

/// The first views of a drive, `every`th scan only.
pub(crate) fn views(site: &Arc<Site>, seed: u64, every: usize, count: usize) -> Vec<View> {
    let mut table = BeamTable::default();
    let drive = Drive::new(Arc::clone(site), DriveSettings { seed, ..DriveSettings::default() });
    let scans = drive.scans().step_by(every).take(count);
    scans
        .map(|taken| {
            let (sweep, _) = Sweep::from_scan(&taken.scan, [0.0; 3]);
            let mut points = SweepPoints::default();
            points.fill(&sweep, &mut table, 10.0);
            points.fill_normals();
            View { points, world_from_robot: taken.world_from_robot }
        })
        .collect()
}

/// A map of views at their true poses.
pub(crate) fn map_of(views: &[View]) -> LocalMap {
    let mut map = LocalMap::new(LocalMapSettings::default());
    for (number, view) in views.iter().enumerate() {
        map.change(&view.points, view.world_from_robot, Change::Add, number as u32);
    }
    map
}

/// A map in which every one of the points in the world is an obstacle.
pub(crate) fn map_of_obstacles(hits: Vec<[f64; 2]>, settings: LocalMapSettings) -> LocalMap {
    let mut map = LocalMap::new(settings);
    // Each is seen from where it is, so that no beam passes another.
    for hit in hits {
        let points = SweepPoints { origin: hit, hits: vec![hit], normals: vec![[0.0; 2]], ..SweepPoints::default() };
        map.change(&points, Pose2::IDENTITY, Change::Add, 0);
    }
    map
}
