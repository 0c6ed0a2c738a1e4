//! Clouds whose surfaces leave a direction of the pose to the prediction are said to be doubtful, and no others.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use mapwright::{Cloud, Pose3, Settings, SpaceMapper, SpaceSensor, Stamp, Status};
use mapwright_sim::Rng;
use nalgebra::{UnitQuaternion, Vector3};
use std::sync::Arc;

const CLOUDS: i64 = 8;
const RINGS: usize = 16;
const COLUMNS: usize = 720;
const RANGE_M: f64 = 100.0;
const SIGMA_M: f64 = 0.02;
const HEIGHT_M: f64 = 1.5;

/// Walls of a world: its axis, where it stands along it, and how high it reaches.
type Wall = (usize, f64, f64);

const FLOOR: Wall = (2, 0.0, f64::INFINITY);

/// What a spinning lidar sees from there, its rings from 15 degrees below to as much above.
fn spun(walls: &[Wall], world_from_sensor: Pose3, rng: &mut Rng) -> Vec<[f32; 3]> {
    let at = world_from_sensor.translation;
    let ray = |ring: usize, column: usize| {
        let elevation = (30.0 * ring as f64 / (RINGS - 1) as f64 - 15.0).to_radians();
        let azimuth = std::f64::consts::TAU * column as f64 / COLUMNS as f64;
        let (s, c) = azimuth.sin_cos();
        Vector3::new(c * elevation.cos(), s * elevation.cos(), elevation.sin())
    };
    let rays = (0..RINGS).flat_map(|ring| (0..COLUMNS).map(move |column| ray(ring, column)));
    rays.filter_map(|along| {
        let direction = world_from_sensor.rotation * along;
        let range_m = |&(axis, stands_at, top): &Wall| {
            let range_m = (stands_at - at[axis]) / direction[axis];
            let is_hit = range_m > 0.0 && at.z + range_m * direction.z <= top;
            if is_hit { range_m } else { f64::INFINITY }
        };
        let range_m = walls.iter().map(range_m).fold(f64::INFINITY, f64::min);
        let noisy_m = range_m + rng.normal(SIGMA_M);
        (range_m < RANGE_M).then(|| (along * noisy_m).map(|v| v as f32).into())
    })
    .collect()
}

/// How a world's clouds on a way along x are judged; without the first, which begins the map, and the second, for a map of a single cloud
/// has surfaces of few points whose normals may be anything.
fn judged(points_m: impl Fn(i64, &mut Rng) -> Vec<[f32; 3]>) -> Vec<Status> {
    let sensor = Arc::new(SpaceSensor::lidar("top"));
    let (mut mapper, mut rng) = (SpaceMapper::new(Settings::default()).unwrap(), Rng::new(7));
    let add = |number: i64| {
        let cloud = Cloud {
            stamp: Stamp(number * 100_000_000),
            sensor: Arc::clone(&sensor),
            points_m: points_m(number, &mut rng),
            times_s: Vec::new(),
            colours: Vec::new(),
            intensities: Vec::new(),
            sigmas_m: Vec::new(),
            odom_from_robot: None,
        };
        let update = mapper.add_cloud(&cloud);
        assert!(update.map_from_robot.is_finite() && update.matched.is_some() == (number > 0));
        update.status
    };
    (0..CLOUDS).map(add).skip(2).collect()
}

fn in_world(walls: &[Wall], leaning_rad: f64) -> Vec<Status> {
    let rotation = UnitQuaternion::from_euler_angles(leaning_rad, -leaning_rad, 3.0 * leaning_rad);
    judged(|number, rng| {
        let at = Vector3::new(0.1 * number as f64, 0.0, HEIGHT_M);
        spun(walls, Pose3 { translation: at, rotation }, rng)
    })
}

#[test]
fn fields_tunnels_walls_and_lines_leave_something_to_the_prediction() {
    let tunnel = [FLOOR, (2, 4.0, f64::INFINITY), (1, -3.0, f64::INFINITY), (1, 3.0, f64::INFINITY)];
    let wall = [FLOOR, (1, 8.0, 5.0)];
    // However the sensor is mounted.
    for leaning_rad in [0.0, 0.05] {
        for (name, walls) in [("field", &[FLOOR][..]), ("tunnel", &tunnel), ("wall", &wall)] {
            let found = in_world(walls, leaning_rad);
            assert!(found.iter().all(|status| *status == Status::Degraded), "{name}, {leaning_rad}: {found:?}");
        }
    }
    let tube = judged(|number, rng| {
        let along = |rng: &mut Rng| {
            let (x, angle) = (rng.uniform(-12.0, 12.0), rng.uniform(0.0, std::f64::consts::TAU));
            let radius_m = 2.0 + rng.normal(SIGMA_M);
            [(x - 0.1 * number as f64) as f32, (radius_m * angle.cos()) as f32, (radius_m * angle.sin()) as f32]
        };
        (0..12_000).map(|_| along(rng)).collect()
    });
    let line = judged(|_, rng| {
        let across = |rng: &mut Rng| (rng.normal(SIGMA_M)) as f32;
        (0..2000).map(|_| [rng.uniform(1.0, 30.0) as f32, across(rng), across(rng)]).collect()
    });
    for (name, found) in [("tube", tube), ("line", line)] {
        assert!(found.iter().all(|status| *status == Status::Degraded), "{name}: {found:?}");
    }
}

#[test]
fn rooms_hold_the_pose() {
    let high = f64::INFINITY;
    let room = [FLOOR, (2, 4.0, high), (1, -3.0, high), (1, 3.0, high), (0, 8.0, high), (0, -8.0, high)];
    for leaning_rad in [0.0, 0.05] {
        let found = in_world(&room, leaning_rad);
        assert!(found.iter().all(|status| *status == Status::Tracking), "{leaning_rad}: {found:?}");
    }
}
