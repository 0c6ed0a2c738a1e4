//! What was mapped wrongly, or has changed since, can be put right.
#![allow(clippy::expect_used, clippy::print_stdout, reason = "a test may fail loudly and show what it measured")]

use crate::support;

use mapwright::{CountGrid, KeyframeId, LaserModel, LaserScan, LocalMap, Mapper, Pose2, Settings, Stamp, Sweep};
use mapwright_grid::{Change, LocalMapSettings};
use mapwright_sensor::{BeamTable, SweepPoints};
use mapwright_sim::{Door, DriveSettings, Route, Schedule, Segment, Site, TrueScan, World, worlds};
use std::sync::Arc;
use support::{mapper, recording};

const PASSES_PER_HIT: usize = 5;

/// A mapper that believes odometry, so that a scan can be forced to a wrong place.
fn believer() -> Mapper {
    let mut settings = Settings::default();
    for (key, value) in [("alpha1", "0"), ("alpha2", "0"), ("alpha3", "0"), ("alpha4", "0"), ("tail", "1e9")] {
        settings.set(&format!("motion.{key}"), value).expect("a setting");
    }
    for floor in ["translation_floor_m", "rotation_floor_rad"] {
        settings.set(&format!("motion.{floor}"), "1e-5").expect("a setting");
    }
    for floor in ["translation_per_second_m", "rotation_per_second_rad"] {
        settings.set(&format!("motion.{floor}"), "0").expect("a setting");
    }
    Mapper::new(settings).expect("valid")
}

/// Scans along a bare corridor, where a step of 1 m goes unnoticed; odometry is true.
fn corridor() -> Vec<LaserScan> {
    let site = worlds::corridor(4, worlds::CorridorWalls::Featureless);
    let settings = DriveSettings { seed: 4, duration_s: 25.0, ..DriveSettings::default() };
    let with_true_odometry = |recorded: TrueScan| {
        let mut scan = recorded.scan;
        scan.odom_from_robot = Some(recorded.world_from_robot);
        scan
    };
    recording(site, settings).into_iter().map(with_true_odometry).collect()
}

/// The scan when odometry says that the robot has moved on.
fn moved(scan: &LaserScan, by: Pose2) -> LaserScan {
    LaserScan { odom_from_robot: scan.odom_from_robot.map(|pose| pose * by), ..scan.clone() }
}

fn drawn_without(mapper: &Mapper, dropped: KeyframeId) -> CountGrid {
    let mut map = CountGrid::new(mapper.settings().map.resolution_m);
    for (keyframe, &world_from_robot) in mapper.keyframes().iter().zip(mapper.keyframe_poses()) {
        if keyframe.id != dropped {
            map.draw(&points_of(&keyframe.sweep), world_from_robot, Change::Add, &mut Vec::new());
        }
    }
    map
}

fn points_of(sweep: &Sweep) -> SweepPoints {
    let mut points = SweepPoints::default();
    points.fill(sweep, &mut BeamTable::default(), Settings::default().scan.free_range_m);
    points.fill_normals();
    points
}

fn obstacles(map: &LocalMap) -> Vec<(i32, i32)> {
    let mut cells: Vec<_> = map.field().obstacles().collect();
    cells.sort_unstable();
    cells
}

#[test]
fn a_scan_inserted_1_m_off_is_taken_out_without_a_trace() {
    let scans = corridor();
    let mut mapper = believer();
    let (before, after) = scans.split_at(scans.len() / 2);
    for scan in before {
        mapper.add_scan(scan);
    }
    let bytes_before = mapper.local_map().counts().to_bytes();
    let obstacles_before = obstacles(mapper.local_map());
    let right = mapper.trajectory().last().expect("scans").map_from_robot;
    // 1 m further on than it was taken: the corridor's walls fit, its end does not.
    let last = &before[before.len() - 1];
    let two_seconds_later = LaserScan { stamp: Stamp(last.stamp.0 + 2_000_000_000), ..last.clone() };
    let wrong = mapper.add_scan(&moved(&two_seconds_later, Pose2::new(1.0, 0.0, 0.0)));
    let dropped = wrong.keyframe.expect("a keyframe");
    assert!((wrong.map_from_robot.distance(right) - 1.0).abs() < 0.1, "{:?} {:?}", wrong.map_from_robot, right);
    assert!(mapper.local_map().counts().to_bytes() != bytes_before);

    let mut at_once = mapper.clone();
    assert!(at_once.drop_keyframe(dropped));
    assert!(at_once.local_map().counts().to_bytes() == bytes_before);
    assert_eq!(obstacles(at_once.local_map()), obstacles_before);

    for scan in after {
        mapper.add_scan(scan);
    }
    assert!(mapper.keyframes().len() > dropped.seq as usize + 10);
    assert!(mapper.drop_keyframe(dropped));
    assert!(mapper.local_map().counts().to_bytes() == drawn_without(&mapper, dropped).to_bytes());
}

/// A fan of beams that end on a wall across the robot's way.
fn fan(wall_m: f32) -> SweepPoints {
    let laser = LaserModel {
        angle_min_rad: -0.2,
        angle_step_rad: 0.01,
        range_max_m: 30.0,
        ..LaserModel::half_circle("fan", 41)
    };
    let ranges_m = (0..41).map(|beam| wall_m / (-0.2 + 0.01 * beam as f32).cos()).collect();
    let scan = LaserScan { stamp: Stamp(0), laser: Arc::new(laser), ranges_m, odom_from_robot: None };
    points_of(&Sweep::from_scan(&scan, [0.0; 3]).0)
}

#[test]
fn a_wall_seen_often_outlives_a_beam_through_it_and_goes_when_it_is_gone() {
    const SEEN: usize = 20;
    let mut map = LocalMap::new(LocalMapSettings::default());
    (0..SEEN).for_each(|_| map.change(&fan(2.02), Pose2::IDENTITY, Change::Add, 0));
    let wall = obstacles(&map);
    assert!(wall.len() > 10);
    let stands = |map: &LocalMap| wall.iter().filter(|&&(x, y)| map.field().is_occupied(x, y)).count();
    map.change(&fan(4.02), Pose2::IDENTITY, Change::Add, 1);
    assert_eq!(stands(&map), wall.len());
    // Fewer beams pass the cells at the edges than had hit them.
    (0..4 * SEEN * PASSES_PER_HIT).for_each(|_| map.change(&fan(4.02), Pose2::IDENTITY, Change::Add, 1));
    assert_eq!(stands(&map), 0);
}

/// A hall of 10 m by 5 m, with a wall across at 5 m and a door in it that is shut until `shut_s`.
fn hall(shut_s: f64, route: Vec<[f64; 2]>) -> Site {
    let wall = |a, b| Segment { a, b };
    let corners = [[0.0, 0.0], [10.0, 0.0], [10.0, 5.0], [0.0, 5.0]];
    let mut walls: Vec<Segment> = (0..4).map(|k| wall(corners[k], corners[(k + 1) % 4])).collect();
    walls.extend([wall([5.0, 0.0], [5.0, 2.0]), wall([5.0, 3.0], [5.0, 5.0])]);
    walls.extend([wall([1.0, 4.0], [1.6, 4.4]), wall([8.5, 0.5], [9.0, 1.2])]);
    let door = Door {
        shut: wall([5.0, 2.0], [5.0, 3.0]),
        open: Some(wall([5.0, 2.0], [6.0, 2.0])),
        shut_when: Schedule::During(vec![[0.0, shut_s]]),
    };
    Site { world: World::new(walls, Vec::new()).with_doors([door]), route: Route::new(route) }
}

/// Cells of the door that are obstacles, in the middle 60 cm of the way through.
fn door_cells(mapper: &Mapper, map_from_world: Pose2) -> usize {
    let in_the_way = |&(x, y): &(i32, i32)| {
        let in_map = Pose2::new((f64::from(x) + 0.5) * 0.05, (f64::from(y) + 0.5) * 0.05, 0.0);
        let cell = map_from_world.inverse() * in_map;
        (cell.x - 5.0).abs() < 0.15 && (cell.y - 2.5).abs() < 0.3
    };
    mapper.local_map().field().obstacles().filter(in_the_way).count()
}

#[test]
fn a_door_that_has_opened_is_open_in_the_map_after_some_ways_through() {
    let in_front = [[1.5, 2.5], [3.8, 2.5], [1.5, 2.5], [3.8, 2.5], [1.5, 2.5]];
    let through = [[8.5, 2.5], [1.5, 2.5]];
    let route: Vec<_> = in_front.into_iter().chain((0..6).flat_map(|_| through)).collect();
    let shut_s = 26.0;
    let scans = recording(hall(shut_s, route), DriveSettings { seed: 2, ..DriveSettings::default() });
    let mut mapper = mapper();
    let map_from_world = scans[0].world_from_robot.inverse();
    let (mut shut, mut ways, mut side) = (0, 0, false);
    let mut healed_after = None;
    for recorded in &scans {
        mapper.add_scan(&recorded.scan);
        let cells = door_cells(&mapper, map_from_world);
        shut = cells.max(shut);
        let beyond = recorded.world_from_robot.x > 5.0;
        ways += usize::from(beyond != side);
        side = beyond;
        assert!(!beyond || recorded.scan.stamp.0 as f64 * 1e-9 > shut_s, "drove through a shut door");
        if shut > 5 && cells == 0 && healed_after.is_none() {
            healed_after = Some((ways, recorded.scan.stamp.0 as f64 * 1e-9 - shut_s));
        }
    }
    println!(
        "{shut} cells shut, {} left after {ways} ways; open after {healed_after:?}",
        door_cells(&mapper, map_from_world)
    );
    assert!(shut > 5, "the shut door was mapped: {shut}");
    assert_eq!(door_cells(&mapper, map_from_world), 0, "after {ways} ways through");
}
