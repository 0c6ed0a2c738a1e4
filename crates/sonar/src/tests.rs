//! Stretches of rooms whose echoes are computed by geometry: a smooth wall answers where it is met straight on.

use crate::{EchoCounts, Gatherer, GathererSettings, HeardWalls, Stretch};
use mapwright_geom::{Pose2, Stamp, wrap_angle};
use mapwright_sensor::{Odometry, SonarReading, SonarRing, SweepPoints};
use std::sync::Arc;

/// Walls as normal away from the origin, radians, and depth, metres; they have no ends.
struct Room<'a> {
    walls: &'a [(f64, f64)],
    /// A door's frame.
    edge: Option<[f64; 2]>,
}

impl Room<'_> {
    fn ranges_m(&self, ring: &SonarRing, room_from_robot: Pose2) -> Vec<f32> {
        let range = |sonar: &mapwright_sensor::Sonar| {
            let at = room_from_robot * sonar.robot_from_sonar;
            let within = |bearing_rad: f64| wrap_angle(bearing_rad - at.theta).abs() <= 0.5 * sonar.opening_rad;
            let walls = self.walls.iter().filter(|(normal_rad, _)| within(*normal_rad));
            let walls = walls.map(|(normal_rad, depth_m)| depth_m - at.x * normal_rad.cos() - at.y * normal_rad.sin());
            let edge = self.edge.map(|[x, y]| [x - at.x, y - at.y]).filter(|[x, y]| within(y.atan2(*x)));
            walls.chain(edge.map(|[x, y]| x.hypot(y))).fold(sonar.range_max_m, f64::min) as f32
        };
        ring.sonars.iter().map(range).collect()
    }
}

fn ring() -> Arc<SonarRing> {
    Arc::new(SonarRing::around("SONAR", 16, 0.2, 25f64.to_radians(), 5.0))
}

/// Straight ahead from the room's origin, a reading every 0.1 m.
fn drive(room: &Room<'_>, readings: usize) -> (Vec<Stretch>, EchoCounts) {
    let (ring, mut gatherer) = (ring(), Gatherer::new(GathererSettings::default()));
    for k in 0..readings {
        let at = Pose2::new(0.1 * k as f64, 0.0, 0.0);
        let ranges_m = room.ranges_m(&ring, at);
        let stamp = Stamp(200_000_000 * k as i64);
        gatherer.add(&SonarReading { stamp, ring: Arc::clone(&ring), ranges_m, odom_from_robot: Some(at) });
    }
    gatherer.end();
    let stretches = std::iter::from_fn(|| gatherer.next_stretch()).collect();
    (stretches, gatherer.counts())
}

const UP: f64 = std::f64::consts::FRAC_PI_2;

#[test]
fn walls_of_a_corridor_lie_where_they_are_and_as_far_as_they_were_heard() {
    let (stretches, counts) = drive(&Room { walls: &[(UP, 1.2), (-UP, 0.9)], edge: None }, 11);
    let stretch = &stretches[0];
    for (normal_rad, depth_m) in [(UP, 1.2), (-UP, 0.9)] {
        let wall = stretch.walls.iter().find(|wall| wrap_angle(wall.normal_rad - normal_rad).abs() < 0.02);
        let wall = wall.unwrap_or_else(|| panic!("{normal_rad}: {:?}", stretch.walls));
        assert!((wall.depth_m - depth_m).abs() < 0.01, "{wall:?}");
        let length_m = wall.seen_m[1] - wall.seen_m[0];
        assert!((0.9..1.5).contains(&length_m), "{wall:?}");
    }
    assert_eq!(counts.total(), 11 * 16);
    assert_eq!((counts.used, counts.alone, counts.nothing), (22, 0, 154), "one sonar on each side hears its wall");
}

#[test]
fn the_scan_shows_the_walls_and_nothing_else() {
    let (stretches, _) = drive(&Room { walls: &[(UP, 1.2), (-UP, 0.9)], edge: None }, 11);
    let scan = &stretches[0].scan;
    assert_eq!(scan.odom_from_robot.map(|pose| (10.0 * pose.x).round() / 10.0), Some(0.5));
    let beam = |deg: usize| scan.ranges_m[deg];
    assert!((beam(270) - 1.2).abs() < 0.02 && (beam(90) - 0.9).abs() < 0.02, "left and right");
    assert!(beam(180).is_nan() && beam(0).is_nan(), "ahead and behind nothing is known");
}

#[test]
fn a_door_frame_is_a_point() {
    let (stretches, _) = drive(&Room { walls: &[], edge: Some([1.4, 0.8]) }, 11);
    let wall = &stretches[0].walls[0];
    let [x, y] = wall.at(0.0);
    assert!((x - 0.9).abs() < 0.03 && (y - 0.8).abs() < 0.03 && wall.seen_m == [0.0; 2], "{wall:?}");
}

#[test]
fn what_nothing_bears_out_and_what_lies_behind_a_wall_is_not_drawn() {
    let (mut stretches, _) = drive(&Room { walls: &[(UP, 1.2), (-UP, 0.9)], edge: Some([0.5, 3.0]) }, 11);
    let stretch = stretches.remove(0);
    let mut points = SweepPoints::default();
    for echo in 0..stretch.echoes.len() {
        stretch.echoes.fill(echo, &mut points);
        for [x, y] in points.hits.iter().chain(&points.free_ends) {
            assert!(*y < 1.25 && *y > -0.95, "({x}, {y})");
        }
    }
    let ring = ring();
    let mut gatherer = Gatherer::new(GathererSettings::default());
    for k in 0..11_u32 {
        let mut ranges_m = vec![5.0; 16];
        ranges_m[(5 * k as usize) % 16] = 1.0 + 0.37 * (k % 3) as f32;
        let at = Pose2::new(0.1 * f64::from(k), 0.0, 0.0);
        let stamp = Stamp(i64::from(k));
        gatherer.add(&SonarReading { stamp, ring: Arc::clone(&ring), ranges_m, odom_from_robot: Some(at) });
    }
    gatherer.end();
    assert_eq!(gatherer.next_stretch().map(|stretch| stretch.echoes.len()), Some(0));
    assert_eq!((gatherer.counts().used, gatherer.counts().alone, gatherer.counts().nothing), (0, 11, 165));
}

#[test]
fn readings_wait_for_odometry_around_them() {
    let (ring, room) = (ring(), Room { walls: &[(UP, 1.2), (-UP, 0.9)], edge: None });
    let mut gatherer = Gatherer::new(GathererSettings::default());
    let reading = |k: usize| {
        let at = Pose2::new(0.1 * k as f64, 0.0, 0.0);
        let stamp = Stamp(200_000_000 * k as i64);
        SonarReading { stamp, ring: Arc::clone(&ring), ranges_m: room.ranges_m(&ring, at), odom_from_robot: None }
    };
    for k in 0..11 {
        gatherer.add(&reading(k));
        if k % 5 == 0 {
            let at = Pose2::new(0.1 * k as f64, 0.0, 0.0);
            gatherer.add_odometry(&Odometry { stamp: Stamp(200_000_000 * k as i64), odom_from_robot: at });
        }
    }
    gatherer.end();
    let (told, _) = drive(&room, 11);
    let found = gatherer.next_stretch();
    assert_eq!(found.map(|stretch| stretch.walls.len()), Some(told[0].walls.len()));
    assert_eq!((gatherer.counts().unplaced, gatherer.counts().total()), (0, 11 * 16));
    gatherer.add(&reading(12));
    gatherer.end();
    assert_eq!((gatherer.counts().unplaced, gatherer.counts().total()), (16, 12 * 16), "no odometry follows");
}

#[test]
fn a_robot_that_stands_is_heard_once() {
    let (ring, mut gatherer) = (ring(), Gatherer::new(GathererSettings::default()));
    for k in 0..100 {
        let ranges_m = vec![1.0; 16];
        let reading =
            SonarReading { stamp: Stamp(k), ring: Arc::clone(&ring), ranges_m, odom_from_robot: Some(Pose2::IDENTITY) };
        gatherer.add(&reading);
    }
    gatherer.end();
    assert_eq!(gatherer.counts(), EchoCounts { standing: 99 * 16, alone: 16, ..EchoCounts::default() });
}

/// What the heading of each stretch is off by, radians: driven along true poses with odometry's beside.
fn off_rad(room: &Room<'_>, poses: impl Iterator<Item = [Pose2; 2]>) -> Vec<f64> {
    let (ring, mut gatherer, mut truth) = (ring(), Gatherer::new(GathererSettings::default()), Vec::new());
    for (k, [at, by_wheels]) in poses.enumerate() {
        let (ranges_m, stamp) = (room.ranges_m(&ring, at), Stamp(200_000_000 * k as i64));
        truth.push((stamp, at.theta));
        gatherer.add(&SonarReading { stamp, ring: Arc::clone(&ring), ranges_m, odom_from_robot: Some(by_wheels) });
    }
    gatherer.end();
    let off = |stretch: Stretch| {
        let (_, theta) = truth.iter().find(|(stamp, _)| *stamp == stretch.scan.stamp)?;
        Some(wrap_angle(stretch.scan.odom_from_robot?.theta - theta))
    };
    std::iter::from_fn(|| gatherer.next_stretch()).filter_map(off).collect()
}

#[test]
fn a_corridor_holds_the_heading_of_wheels_that_drift() {
    // 2 degrees a metre: after 15 m half a radian.
    let drift = 2f64.to_radians();
    let along = |k: u32| {
        let way_m = 0.1 * f64::from(k);
        let turned_rad = drift * way_m;
        let by_wheels = Pose2::new(turned_rad.sin() / drift, (1.0 - turned_rad.cos()) / drift, turned_rad);
        [Pose2::new(way_m, 0.0, 0.0), by_wheels]
    };
    let off = off_rad(&Room { walls: &[(UP, 1.2), (-UP, 0.9)], edge: None }, (0..150).map(along));
    let spread_rad = off.iter().fold(f64::NEG_INFINITY, |most, &off| most.max(off))
        - off.iter().copied().fold(f64::INFINITY, f64::min);
    assert!(off.len() >= 12 && spread_rad < 0.06, "{off:?}");
}

#[test]
fn walls_in_all_directions_leave_good_odometry_as_it_is() {
    // Five walls, no two of them parallel or at right angles, and a robot that goes round.
    let walls: Vec<(f64, f64)> = (0..5).map(|k| (f64::from(k) * std::f64::consts::TAU / 5.0, 3.0)).collect();
    let round = |k: u32| {
        let angle_rad = 0.1 * f64::from(k);
        [Pose2::new(angle_rad.sin(), 1.0 - angle_rad.cos(), angle_rad); 2]
    };
    let off = off_rad(&Room { walls: &walls, edge: None }, (0..300).map(round));
    assert!(off.len() >= 20 && off.iter().all(|off| off.abs() < 0.1), "{off:?}");
}

#[test]
fn a_silent_wall_ends_free_space_and_one_that_would_have_been_heard_does_not() {
    let pose = Pose2::new(3.0, -2.0, 0.7);
    // A wall across the way, 1 m ahead, that was heard twice; and something 2 m away, straight on and aslant.
    let wall = SweepPoints { hits: vec![[1.0, 0.0]; 2], normals: vec![[-1.0, 0.0]; 2], ..SweepPoints::default() };
    let slanted = SweepPoints { normals: vec![[-0.5, 0.75f64.sqrt()]; 2], ..wall.clone() };
    let free_m = |heard: &SweepPoints, times: usize| {
        let mut walls = HeardWalls::new(0.1);
        let some = SweepPoints {
            hits: heard.hits[..times].to_vec(),
            normals: heard.normals[..times].to_vec(),
            ..heard.clone()
        };
        walls.add(&some, pose);
        let arc = crate::Arc2 { stretch_from_sonar: Pose2::IDENTITY, half_rad: 0.2, range_m: 2.0, place: 0 };
        let mut points = SweepPoints { free_ends: vec![[2.0, 0.0]], ..SweepPoints::default() };
        walls.shorten(&mut points, &arc, pose);
        points.free_ends[0][0]
    };
    assert!((free_m(&wall, 2) - 2.0).abs() < 1e-9, "it faces the cone, and was not heard: it is not there any more");
    assert!((0.7..1.0).contains(&free_m(&slanted, 2)), "{}", free_m(&slanted, 2));
    assert!((free_m(&slanted, 1) - 2.0).abs() < 1e-9, "one echo is no wall");
}
