//! A lidar that looks ahead and one that looks back, on one robot in space.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a test may fail loudly and show what it measured")]

use mapwright::{Cloud, Pose3, Settings, SpaceMapper, SpaceSensor, Stamp};
use mapwright_eval::{Alignment, RpeSettings, space_errors};
use mapwright_sim::space::{LidarSettings, SpaceDrive, SpaceDriveSettings, worlds};
use nalgebra::Vector3;
use std::f64::consts::PI;
use std::sync::Arc;

type Taken = (Cloud, Pose3);

fn drive(seed: u64) -> Vec<Taken> {
    let lidar = LidarSettings { columns: 360, ..LidarSettings::spinning(16) };
    let settings = SpaceDriveSettings { lidar, seed, duration_s: 12.0, ..SpaceDriveSettings::default() };
    let drive = SpaceDrive::new(Arc::new(worlds::two_storey(seed)), settings);
    drive.clouds().map(|taken| (taken.cloud, taken.world_from_robot)).collect()
}

/// What a lidar behind and turned about would have seen of the half behind, or one in place of that ahead; of each so many points one.
fn half((cloud, world_from_robot): &Taken, is_rear: bool, every: usize) -> Taken {
    let back = Pose3::exp(nalgebra::Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, PI));
    let lidar_from_sensor = Pose3 { translation: Vector3::new(-0.3, 0.0, 0.0), ..back };
    let lidar_from_sensor = if is_rear { lidar_from_sensor } else { Pose3::identity() };
    let sensor = SpaceSensor {
        name: if is_rear { "rear" } else { "front" }.to_owned(),
        robot_from_sensor: cloud.sensor.robot_from_sensor * lidar_from_sensor,
        ..SpaceSensor::clone(&cloud.sensor)
    };
    let sees = |at: &usize| (cloud.points_m[*at][0] <= 0.0) == is_rear;
    let seen: Vec<usize> = (0..cloud.points_m.len()).filter(sees).step_by(every).collect();
    let sensor_from_lidar = lidar_from_sensor.inverse();
    let point = |&at: &usize| sensor_from_lidar.transform(Vector3::from(cloud.points_m[at].map(f64::from)));
    let cloud = Cloud {
        sensor: Arc::new(sensor),
        points_m: seen.iter().map(point).map(|at| [at.x as f32, at.y as f32, at.z as f32]).collect(),
        times_s: seen.iter().map(|&at| cloud.times_s[at]).collect(),
        ..cloud.clone()
    };
    (cloud, *world_from_robot)
}

fn mapped(clouds: &[Taken], with_wheels: bool) -> (SpaceMapper, f64) {
    let mut mapper = SpaceMapper::new(Settings::default()).unwrap();
    for (cloud, _) in clouds {
        let odom_from_robot = cloud.odom_from_robot.filter(|_| with_wheels);
        mapper.add_cloud(&Cloud { odom_from_robot, ..cloud.clone() });
    }
    let error_m = error_m(&mapper, clouds);
    (mapper, error_m)
}

fn error_m(mapper: &SpaceMapper, clouds: &[Taken]) -> f64 {
    // of two clouds of one time the second counts as a nanosecond later
    let at = |number: usize, stamp: Stamp| Stamp(stamp.0 + number as i64);
    let truth: Vec<_> = clouds.iter().enumerate().map(|(k, (cloud, pose))| (at(k, cloud.stamp), *pose)).collect();
    let way = mapper.session().trajectory().enumerate();
    let way: Vec<_> = way.map(|(k, pose)| (at(k, pose.stamp), pose.map_from_robot)).collect();
    let errors = space_errors(&truth, &way, Alignment::Rigid, &RpeSettings::default()).unwrap();
    errors.absolute.translation_m.rmse
}

#[test]
fn two_lidars_are_as_good_as_one_and_both_are_drawn() {
    let whole = drive(3);
    let at_once: Vec<Taken> = whole.iter().flat_map(|taken| [false, true].map(|rear| half(taken, rear, 1))).collect();
    let in_turn: Vec<Taken> = whole.iter().enumerate().map(|(k, taken)| half(taken, k % 2 == 1, 1)).collect();
    let sparse: Vec<Taken> =
        whole.iter().flat_map(|taken| [(false, 1), (true, 4)].map(|(rear, every)| half(taken, rear, every))).collect();
    for with_wheels in [true, false] {
        let (_, alone_m) = mapped(&whole, with_wheels);
        for (name, clouds) in [("at once", &at_once), ("in turn", &in_turn), ("sparse", &sparse)] {
            let (mapper, both_m) = mapped(clouds, with_wheels);
            println!("wheels {with_wheels}, {name}: {both_m:.4} m, one lidar {alone_m:.4} m");
            assert!(both_m < 0.06, "{name}: {both_m} m, one lidar {alone_m} m");
            let session = mapper.session();
            assert!(session.fragments().len() <= 1, "{name}");
            let of_rear = session.keyframes().iter().filter(|keyframe| keyframe.sweep.sensor.name == "rear").count();
            assert!(3 * of_rear > session.keyframes().len(), "{name}: {of_rear} of {}", session.keyframes().len());
        }
    }
}

#[test]
fn a_run_of_two_lidars_goes_on_to_the_same_bits() {
    let clouds: Vec<Taken> =
        drive(5).iter().take(60).flat_map(|taken| [false, true].map(|rear| half(taken, rear, 1))).collect();
    let (whole, _) = mapped(&clouds, false);
    for stop in [41, 80] {
        let (mut first, _) = mapped(&clouds[..stop], false);
        first.checkpoint();
        let mut next = SpaceMapper::resume(Settings::default(), first.session().clone()).unwrap();
        for (cloud, _) in &clouds[stop..] {
            next.add_cloud(&Cloud { odom_from_robot: None, ..cloud.clone() });
        }
        let way =
            |mapper: &SpaceMapper| mapper.session().trajectory().map(|pose| pose.map_from_robot).collect::<Vec<_>>();
        assert!(way(&next) == way(&whole), "stopped after {stop} clouds");
    }
}
