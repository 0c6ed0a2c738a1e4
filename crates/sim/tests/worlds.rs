//! Ready worlds as a mapper meets them.
#![allow(clippy::unwrap_used, reason = "tests may")]

use mapwright_geom::Pose2;
use mapwright_sim::worlds::{
    CorridorWalls, corridor, corridor_grid, grand_loop, growing_building, home, loop_of, office_floor, rooms,
    three_rooms,
};
use mapwright_sim::{
    Door, Drive, DriveSettings, Event, Incident, LaserSettings, OdometryNoise, Revisits, Schedule, Segment, Site,
};
use std::sync::Arc;

fn settings(seed: u64) -> DriveSettings {
    DriveSettings { seed, ..DriveSettings::default() }
}

/// Every ready world of a seed, with its name.
fn all(seed: u64) -> Vec<(&'static str, Site)> {
    vec![
        ("office", office_floor(seed)),
        ("rooms", rooms(seed)),
        ("home", home(seed)),
        ("corridor", corridor(seed, CorridorWalls::Features)),
        ("featureless", corridor(seed, CorridorWalls::Featureless)),
        ("three rooms", three_rooms(seed)),
        ("growing", growing_building(seed, 300.0)),
        ("small loop", grand_loop(seed, 50.0)),
        ("loop", grand_loop(seed, 400.0)),
        ("loop of 150 m", loop_of(seed, 150.0)),
        ("corridor grid", corridor_grid(seed, 300.0)),
    ]
}

#[test]
fn routes_keep_clear_of_everything_for_fifty_seeds() {
    for seed in 0..50 {
        for (name, site) in all(seed) {
            assert!(site.clearance_m() > 0.3, "{name} {seed}: {} m", site.clearance_m());
        }
    }
}

#[test]
fn the_robot_itself_keeps_clear_and_finishes() {
    for seed in 0..3 {
        for (name, site) in all(seed) {
            let (site, lazy) = (Arc::new(site), DriveSettings { scan_rate_hz: 1.0, ..settings(seed) });
            let route_m = site.route.length_m();
            let most = (route_m / 0.5 * 4.0) as usize;
            let driven = Drive::new(Arc::clone(&site), lazy).log(most);
            let path: Vec<Pose2> = driven.into_iter().map(|(_, truth)| truth).collect();
            let last = path.last().unwrap();
            let goal = site.route.waypoints.last().unwrap();
            let walls = |p: &Pose2| clear_m(&site, p);
            let clear_m = path.iter().map(walls).fold(f64::INFINITY, f64::min);
            assert!(clear_m > 0.2, "{name} {seed}: {clear_m} m");
            assert!(site.route.endless || last.distance(Pose2::new(goal[0], goal[1], 0.0)) < 0.6, "{name} {seed}");
        }
    }
}

fn clear_m(site: &Site, pose: &Pose2) -> f64 {
    let at = [pose.x, pose.y];
    let walls = site.world.segments().iter().map(|s: &Segment| s.distance_to_point(at));
    let legs = site.world.circles().iter().map(|c| (c.center[0] - at[0]).hypot(c.center[1] - at[1]) - c.radius_m);
    walls.chain(legs).fold(f64::INFINITY, f64::min)
}

#[test]
fn same_seed_same_bytes_and_other_seed_other_world() {
    let log = |seed: u64| {
        let site = office_floor(seed).with_people(3, seed);
        Drive::new(site.into(), settings(seed)).log(300)
    };
    assert_eq!(log(3), log(3));
    assert_ne!(log(3)[299].0.ranges_m, log(4)[299].0.ranges_m);
}

/// FNV-1a over the bits of everything recorded.
fn fingerprint(drive: Drive, scans: usize) -> u64 {
    let mut hash = 0xcbf2_9ce4_8422_2325u64;
    let mut mix = |bits: u64| hash = (hash ^ bits).wrapping_mul(0x0100_0000_01b3);
    for (scan, truth) in drive.log(scans) {
        scan.ranges_m.iter().for_each(|r| mix(u64::from(r.to_bits())));
        let odom = scan.odom_from_robot.unwrap();
        [truth.x, truth.y, truth.theta, odom.x, odom.y, odom.theta].iter().for_each(|v| mix(v.to_bits()));
    }
    hash
}

#[test]
fn recordings_stay_the_same_for_ever() {
    let drive = Drive::new(office_floor(1).with_people(3, 1).into(), settings(1));
    assert_eq!(fingerprint(drive, 500), 16_020_328_565_888_844_577);
}

#[test]
fn the_office_drive_comes_back_to_old_places() {
    for seed in 0..10 {
        let drive = Drive::new(office_floor(seed).into(), DriveSettings { scan_rate_hz: 1.0, ..settings(seed) });
        let path: Vec<Pose2> = drive.log(10_000).into_iter().map(|(_, truth)| truth).collect();
        let length_m: f64 = path.windows(2).map(|w| w[0].distance(w[1])).sum();
        assert!(length_m > 250.0, "{seed}: {length_m} m");
        assert!(returns(&path) >= 4, "{seed}: {} returns", returns(&path));
    }
}

/// How often the path comes within 1 m of a place left more than 30 m of travel ago, counted once every 30 m.
fn returns(path: &[Pose2]) -> usize {
    let mut along_m = vec![0.0];
    for pair in path.windows(2) {
        along_m.push(along_m[along_m.len() - 1] + pair[0].distance(pair[1]));
    }
    let (mut count, mut counted_m) = (0, 0.0);
    for k in 0..path.len() {
        let old = |j: &usize| along_m[k] - along_m[*j] > 30.0 && path[k].distance(path[*j]) < 1.0;
        if along_m[k] - counted_m > 30.0 && (0..k).any(|j| old(&j)) {
            (count, counted_m) = (count + 1, along_m[k]);
        }
    }
    count
}

#[test]
fn the_growing_building_never_shows_an_old_place() {
    let site = growing_building(2, 1_500.0);
    assert!(site.route.length_m() >= 1_500.0);
    let short = growing_building(2, 500.0);
    let common = short.route.waypoints.len() - 2;
    assert_eq!(site.route.waypoints[..common], short.route.waypoints[..common]);
    let path: Vec<Pose2> = Drive::new(site.into(), DriveSettings { scan_rate_hz: 0.5, ..settings(0) })
        .log(2_000)
        .into_iter()
        .map(|(_, truth)| truth)
        .collect();
    assert_eq!(returns(&path), 0);
}

#[test]
fn path_and_drift_are_the_same_at_every_scan_rate() {
    let at_10_s = |scan_rate_hz: f64| {
        let drive = Drive::new(office_floor(5).into(), DriveSettings { scan_rate_hz, ..settings(5) });
        let scan = drive.scans().find(|s| s.scan.stamp.0 == 10_000_000_000).unwrap();
        (scan.world_from_robot, scan.scan.odom_from_robot)
    };
    let reference = at_10_s(10.0);
    for rate_hz in [5.0, 20.0, 40.0] {
        assert_eq!(at_10_s(rate_hz), reference);
    }
}

#[test]
fn events_come_in_order_and_stop_in_an_outage() {
    let incidents = vec![Incident::Outage { from_s: 4.0, to_s: 7.0, odometry_lost: true }];
    let drive = Drive::new(rooms(1).into(), DriveSettings { incidents, ..settings(1) });
    let stamps_s: Vec<f64> = drive
        .take(600)
        .map(|event| match event {
            Event::Odometry(odometry) => odometry.stamp.as_secs_f64(),
            Event::Scan(scan) => scan.scan.stamp.as_secs_f64(),
        })
        .collect();
    assert!(stamps_s.windows(2).all(|w| w[0] <= w[1]));
    assert!(!stamps_s.iter().any(|s| (4.0..7.0).contains(s)));
}

#[test]
fn a_kidnapped_robot_turns_up_elsewhere_and_odometry_does_not_notice() {
    let incidents = vec![Incident::Kidnap { at_s: 20.0, waypoint: 40 }];
    let scans: Vec<_> = Drive::new(office_floor(1).into(), DriveSettings { incidents, ..settings(1) })
        .scans()
        .skip(199)
        .take(3)
        .collect();
    assert!(scans[0].world_from_robot.distance(scans[2].world_from_robot) > 2.0);
    let odom = |k: usize| scans[k].scan.odom_from_robot.unwrap();
    assert!(odom(0).distance(odom(2)) < 0.2);
}

#[test]
fn a_moving_laser_distorts_its_scan() {
    let distorted = |beam_period_s: f64| {
        let mut laser = LaserSettings { range_sigma_m: 0.0, ..LaserSettings::default() };
        let mut model = (*laser.model).clone();
        model.beam_period_s = beam_period_s;
        laser.model = Arc::new(model);
        let still = DriveSettings { laser, odometry: OdometryNoise::NONE, ..settings(0) };
        Drive::new(three_rooms(0).into(), still).log(51).pop().unwrap()
    };
    let ((sharp, at), (smeared, also_at)) = (distorted(0.0), distorted(0.1 / 180.0));
    assert_eq!((at, sharp.ranges_m[0]), (also_at, smeared.ranges_m[0]));
    let ahead_m = |scan: &mapwright_sensor::LaserScan| scan.ranges_m.iter().copied().filter(|r| *r < 30.0).sum::<f32>();
    assert_ne!(ahead_m(&sharp), ahead_m(&smeared));
}

#[test]
fn loops_have_the_length_asked_for_and_come_home() {
    for (k, length_m) in [50.0, 70.0, 120.0, 200.0, 325.0, 500.0, 800.0, 2_000.0].into_iter().enumerate() {
        for seed in 0..if length_m < 600.0 { 25 } else { 3 } {
            let site = loop_of(seed + 100 * k as u64, length_m);
            assert!(site.clearance_m() > 0.3, "{length_m} {seed}: {} m", site.clearance_m());
            let way = &site.route.waypoints;
            let home = way.iter().rposition(|p| *p == way[0]).unwrap();
            let leg_m = |w: &[[f64; 2]]| (w[0][0] - w[1][0]).hypot(w[0][1] - w[1][1]);
            let lap_m: f64 = way[..=home].windows(2).map(leg_m).sum();
            let on_m: f64 = way[home..].windows(2).map(leg_m).sum();
            assert!((lap_m / length_m - 1.0).abs() < 0.05, "{length_m} {seed}: {lap_m} m");
            assert!(on_m >= 10.0, "{length_m} {seed}: {on_m} m");
        }
    }
}

#[test]
fn a_loop_ends_on_ground_seen_at_its_start() {
    for seed in 0..4 {
        let site = Arc::new(loop_of(seed, 200.0));
        let revisits = Revisits::of(&site, &DriveSettings::long_drive(seed));
        let last = revisits.pairs().last().unwrap();
        assert!(last.later.secs_since(last.earlier) > 300.0, "{seed}: {last:?}");
    }
}

#[test]
fn loops_are_the_same_for_a_seed_and_others_for_others() {
    let print = |seed: u64| {
        let site = loop_of(seed, 120.0).with_people(4, seed).with_changing_doors(0.3, seed);
        fingerprint(Drive::new(site.into(), DriveSettings::long_drive(seed)), 200)
    };
    assert_eq!(print(1), print(1));
    assert_ne!(print(1), print(2));
}

#[test]
fn no_ray_leaves_a_loop() {
    for seed in 0..10 {
        let drive = Drive::new(loop_of(seed, 200.0).into(), DriveSettings { scan_rate_hz: 0.5, ..settings(seed) });
        let (mut lost, mut beams) = (0, 0);
        for scan in drive.scans() {
            lost += scan.scan.ranges_m.iter().filter(|r| **r > 30.0).count();
            beams += scan.scan.ranges_m.len();
        }
        assert!(lost * 50 < beams, "{seed}: {lost} of {beams}");
    }
}

#[test]
fn doors_change_off_the_route_only() {
    for seed in 0..5 {
        let site = loop_of(seed, 300.0).with_changing_doors(0.5, seed);
        let changing = |door: &&Door| matches!(door.shut_when, Schedule::Repeating { .. });
        let count = site.world.doors().iter().filter(changing).count();
        assert!(count > 5, "{seed}: {count} doors");
        assert!(site.clearance_m() > 0.3, "{seed}: {} m", site.clearance_m());
    }
}
