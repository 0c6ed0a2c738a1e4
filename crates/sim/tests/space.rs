//! Worlds and drives in space: what anybody who maps with them relies on.

use mapwright_geom::{Point as _, Pose3, Stamp};
use mapwright_sim::space::{
    LidarSettings, SpaceDrive, SpaceDriveSettings, SpaceOdometryNoise, SpaceSite, TrueCloud, Wobble, worlds,
};
use std::sync::Arc;

/// A world by its seed.
type World = fn(u64) -> SpaceSite;

const WORLDS: [(&str, World); 5] = [
    ("two_storey", worlds::two_storey),
    ("loops_1km", worlds::loops_1km),
    ("look_alike_storeys", worlds::look_alike_storeys),
    ("courtyard", worlds::courtyard),
    ("growing_halls", |seed| worlds::growing_halls(seed, 260.0)),
];

fn settings(seed: u64) -> SpaceDriveSettings {
    let lidar = LidarSettings { columns: 256, ..LidarSettings::spinning(16) };
    SpaceDriveSettings { lidar, seed, ..SpaceDriveSettings::default() }
}

/// A lidar without noise on a floor without bumps.
fn exact(seed: u64) -> SpaceDriveSettings {
    let mut settings = settings(seed);
    let sensor = Arc::make_mut(&mut settings.lidar.sensor);
    sensor.range_sigma_m = 0.0;
    settings.lidar.dropout_probability = 0.0;
    SpaceDriveSettings { wobble: Wobble::NONE, odometry: SpaceOdometryNoise::NONE, ..settings }
}

fn above(world_from_robot: Pose3, height_m: f64) -> [f64; 3] {
    let [x, y, z] = world_from_robot.translation.into();
    [x, y, z + height_m]
}

/// All numbers of a cloud as bits, for NaN is not equal to itself.
fn bits(taken: &TrueCloud) -> Vec<u64> {
    let points = taken.cloud.points_m.iter().flatten().map(|v| u64::from(v.to_bits()));
    let pose = taken.world_from_robot;
    let pose = pose.translation.iter().chain(pose.rotation.coords.iter()).map(|v| v.to_bits()).collect::<Vec<_>>();
    points.chain(pose).collect()
}

#[test]
fn drives_end_where_their_way_ends_and_are_as_long_as_they_say() {
    for (name, world) in WORLDS {
        for seed in 0..3 {
            let site = Arc::new(world(seed));
            let length_m = site.length_m();
            let bounds_m = match name {
                "loops_1km" => 999.9..1000.1,
                "two_storey" => 180.0..500.0,
                "courtyard" => 550.0..800.0,
                _ => 250.0..500.0,
            };
            assert!(bounds_m.contains(&length_m), "{name} {seed}: {length_m} m");
            let drive = SpaceDrive::new(Arc::clone(&site), settings(seed));
            let last = drive.world_from_robot(Stamp::from_secs_f64(drive.duration_s() - 0.001)).unwrap();
            let end = site.waypoints[site.waypoints.len() - 1];
            let off_m = above(last, 0.0).distance(end);
            assert!(off_m < 0.2, "{name} {seed}: ends at {}", last.translation);
        }
    }
}

#[test]
fn the_robot_keeps_clear_of_everything() {
    for (name, world) in WORLDS {
        for seed in 0..3 {
            let drive = SpaceDrive::new(world(seed).into(), settings(seed));
            for tenth in 0..(drive.duration_s() * 4.0) as u32 {
                let world_from_robot = drive.world_from_robot(Stamp::from_secs_f64(0.25 * f64::from(tenth))).unwrap();
                for height_m in [0.35, 0.7, 1.1] {
                    let at = world_from_robot.transform([0.0, 0.0, height_m].into());
                    let clear_m = drive.site().world.distance_m(at.into());
                    assert!(clear_m > 0.3, "{name} {seed}: {clear_m} m at {at}, {} s", 0.25 * f64::from(tenth));
                }
            }
        }
    }
}

#[test]
fn the_robot_stands_on_a_floor() {
    // seeds 1 and 2 of two storeys: a ramp and stairs
    for ((name, world), seed) in WORLDS.into_iter().flat_map(|world| [(world, 1), (world, 2)]) {
        let drive = SpaceDrive::new(world(seed).into(), exact(seed));
        for second in 0..drive.duration_s() as u32 {
            let world_from_robot = drive.world_from_robot(Stamp::from_secs_f64(f64::from(second))).unwrap();
            let from = above(world_from_robot, 0.5);
            let floor = drive.site().world.cast(from, [0.0, 0.0, -1.0], 5.0).map(|hit| hit.at);
            // stairs lie up to a step below the line over their edges; on an edge and in a dip wheels ahead and behind carry the robot
            assert!(
                floor.is_some_and(|at| (0.46..0.70).contains(&at)),
                "{name} {seed}: {floor:?} below {from:?}, {second} s"
            );
        }
    }
}

#[test]
fn same_seed_same_bytes_whoever_asks() {
    let site = Arc::new(worlds::two_storey(4));
    let drive = SpaceDrive::new(Arc::clone(&site), settings(4));
    let in_order: Vec<Vec<u64>> = drive.clouds().take(12).map(|taken| bits(&taken)).collect();
    let again = SpaceDrive::new(worlds::two_storey(4).into(), settings(4));
    let by_threads: Vec<Vec<u64>> = std::thread::scope(|scope| {
        let take = |number| {
            scope.spawn({
                let again = &again;
                move || bits(&again.cloud(number).unwrap())
            })
        };
        let workers: Vec<_> = (0..12).rev().map(take).collect();
        workers.into_iter().rev().map(|worker| worker.join().unwrap()).collect()
    });
    assert!(in_order == by_threads);
    let other = SpaceDrive::new(site, settings(5)).cloud(3).unwrap();
    assert!(bits(&other) != in_order[3]);
    let image = drive.depth_image(7).unwrap();
    assert_eq!(image, again.depth_image(7).unwrap());
}

#[test]
fn undistorting_by_the_true_motion_puts_every_point_on_a_surface() {
    let mut settings = exact(2);
    settings.wobble = Wobble::default();
    let drive = SpaceDrive::new(worlds::two_storey(2).into(), settings);
    let mut worst_without_m = 0.0_f64;
    for number in [40, 133, 420] {
        let TrueCloud { cloud, world_from_robot } = drive.cloud(number).unwrap();
        let off_m = |point: [f32; 3], after_s: f64| {
            let at = Stamp(cloud.stamp.0 + (after_s * 1e9).round() as i64);
            let world_from_sensor = drive.world_from_robot(at).unwrap() * cloud.sensor.robot_from_sensor;
            drive.site().world.distance_m(world_from_sensor.transform(point.map(f64::from).into()).into())
        };
        assert_eq!(drive.world_from_robot(cloud.stamp), Some(world_from_robot));
        let seen = cloud.points_m.iter().zip(&cloud.times_s).filter(|(point, _)| point[0].is_finite());
        for (point, time_s) in seen.step_by(7) {
            assert!((0.0..0.1).contains(time_s));
            let off = off_m(*point, f64::from(*time_s));
            assert!(off < 1e-4, "{off} m off the surface at {time_s} s");
            worst_without_m = worst_without_m.max(off_m(*point, 0.0));
        }
    }
    assert!(worst_without_m > 0.03, "motion during a turn shows: {worst_without_m} m");
}

/// Ranges from the same place of three storeys.
fn from_each_storey(site: &SpaceSite, [x, y, z]: [f64; 3], direction: [f64; 3]) -> [f64; 3] {
    let range_m = |floor_m: f64| site.world.cast([x, y, z + floor_m], direction, 30.0).map_or(30.0, |hit| hit.at);
    [0.0, 3.2, 6.4].map(range_m)
}

#[test]
fn storeys_look_alike() {
    for seed in 0..4 {
        let drive = SpaceDrive::new(worlds::look_alike_storeys(seed).into(), exact(seed));
        // the same stations on each storey: where the robot passes on the lowest
        let stations = (0..300).filter_map(|k| drive.world_from_robot(Stamp::from_secs_f64(f64::from(k))));
        let stations: Vec<Pose3> = stations.filter(|at| at.translation.z == 0.0).collect();
        assert!(stations.len() > 60, "{}", stations.len());
        for station in stations {
            let eye = above(station, 0.9);
            for ray in 0..500 {
                let (sin, cos) = f64::sin_cos(f64::from(ray) * 0.37);
                let direction = [cos, sin, -0.4 + 0.0016 * f64::from(ray)];
                let [low, middle, high] = from_each_storey(drive.site(), eye, direction);
                let is_same = (low - middle).abs() < 1e-4 && (low - high).abs() < 1e-4;
                assert!(is_same, "seed {seed}: {low} {middle} {high} m from {eye:?} along {direction:?}");
            }
        }
    }
}

#[test]
fn other_storeys_do_not() {
    let site = worlds::two_storey(3);
    let [x, y, _] = site.waypoints[0];
    let differs = |ray: &u32| {
        let (sin, cos) = f64::sin_cos(f64::from(*ray) * 0.37);
        let [low, high, _] = from_each_storey(&site, [x, y, 0.9], [cos, sin, 0.1]);
        (low - high).abs() > 0.05
    };
    let differing = (0..500).filter(differs).count();
    assert!(differing > 50, "{differing}");
}

#[test]
fn depth_images_as_points_lie_on_surfaces() {
    let mut settings = exact(6);
    let sensor = Arc::make_mut(&mut settings.depth.sensor);
    (sensor.range_sigma_m, sensor.range_sigma_per_m) = (0.0, 0.0);
    let (sensor, camera) = (Arc::clone(&settings.depth.sensor), Arc::clone(&settings.depth.camera));
    let drive = SpaceDrive::new(worlds::two_storey(6).into(), settings);
    let taken = drive.depth_image(900).unwrap();
    let cloud = taken.image.to_cloud(&sensor, &camera.directions()).unwrap();
    let seen: Vec<_> = cloud.points_m.iter().filter(|point| point[0].is_finite()).collect();
    assert!(seen.len() > 20_000, "{}", seen.len());
    for point in seen.into_iter().step_by(31) {
        let at = taken.world_from_robot * sensor.robot_from_sensor;
        let off_m = drive.site().world.distance_m(at.transform(point.map(f64::from).into()).into());
        assert!(off_m < 1e-4, "{off_m} m off the surface");
    }
}

#[test]
fn odometry_drifts_but_not_wildly() {
    let drive = SpaceDrive::new(worlds::two_storey(1).into(), settings(1));
    let end = Stamp::from_secs_f64(drive.duration_s() - 0.01);
    let start = drive.world_from_robot(Stamp(0)).unwrap();
    let off_m = (start * drive.odom_from_robot(end).unwrap()).distance(drive.world_from_robot(end).unwrap());
    assert!((0.3..80.0).contains(&off_m), "{off_m} m after {} m", drive.site().length_m());
    let perfect = SpaceDrive::new(worlds::two_storey(1).into(), exact(1));
    let end = Stamp::from_secs_f64(perfect.duration_s() - 0.01);
    let start = perfect.world_from_robot(Stamp(0)).unwrap();
    let reported = start * perfect.odom_from_robot(end).unwrap();
    assert!(reported.distance(perfect.world_from_robot(end).unwrap()) < 1e-6);
}
