//! Odometry in space: over gaps, and where it is wrong.

#![allow(clippy::unwrap_used, reason = "helpers of tests")]

use mapwright::{Cloud, Pose3, Settings, SpaceMapper, Stamp};
use mapwright_eval::{Alignment, RpeSettings, space_errors};
use mapwright_sim::space::{LidarSettings, SpaceDrive, SpaceDriveSettings, worlds};
use nalgebra::Vector3;
use std::sync::Arc;

/// Clouds of a drive with wheels, five a second, each with its true pose.
fn clouds(seed: u64, duration_s: f64) -> Vec<(Cloud, Pose3)> {
    let lidar = LidarSettings { columns: 360, ..LidarSettings::spinning(16) };
    let settings = SpaceDriveSettings { lidar, seed, duration_s, ..SpaceDriveSettings::default() };
    let drive = SpaceDrive::new(Arc::new(worlds::two_storey(seed)), settings);
    let taken = (0..).step_by(2).map_while(|number| drive.cloud(number));
    taken.map(|taken| (taken.cloud, taken.world_from_robot)).collect()
}

/// Integrates the motions between clouds anew, each changed.
fn changed(clouds: &[(Cloud, Pose3)], mut change: impl FnMut(usize, Pose3) -> Pose3) -> Vec<(Cloud, Pose3)> {
    let mut odom_from_robot = Pose3::identity();
    let poses: Vec<Pose3> = clouds.iter().map(|(cloud, _)| cloud.odom_from_robot.unwrap()).collect();
    let changed = clouds.iter().enumerate().map(|(k, (cloud, truth))| {
        odom_from_robot =
            if k > 0 { odom_from_robot * change(k, poses[k - 1].between(poses[k])) } else { odom_from_robot };
        (Cloud { odom_from_robot: Some(odom_from_robot), ..cloud.clone() }, *truth)
    });
    changed.collect()
}

/// Breaks, maps, and how far the way lies from the truth, root mean square, metres.
fn mapped(clouds: &[(Cloud, Pose3)]) -> (usize, usize, f64) {
    let mut mapper = SpaceMapper::new(Settings::default()).unwrap();
    let mut last = clouds[0].0.stamp;
    for (cloud, _) in clouds {
        let heard = (0..).map(|k| Stamp(last.0 + k * 100_000_000)).take_while(|stamp| *stamp < cloud.stamp);
        heard.filter(|_| cloud.odom_from_robot.is_some()).for_each(|stamp| mapper.hear_odometry(stamp));
        last = cloud.stamp;
        mapper.add_cloud(cloud);
    }
    let session = mapper.session();
    let truth: Vec<(Stamp, Pose3)> = clouds.iter().map(|(cloud, truth)| (cloud.stamp, *truth)).collect();
    let way: Vec<(Stamp, Pose3)> = session.trajectory().map(|pose| (pose.stamp, pose.map_from_robot)).collect();
    let error = space_errors(&truth, &way, Alignment::Rigid, &RpeSettings::default()).unwrap();
    let breaks = session.fragments().iter().filter(|fragment| session.is_break(fragment)).count();
    (breaks, session.maps().len(), error.absolute.translation_m.rmse)
}

/// Without them nobody knows where the robot was then: 2.4 m, and two maps.
#[test]
fn wheels_that_go_on_carry_the_map_over_a_gap() {
    let mut all = clouds(4, 40.0);
    all.drain(70..150);
    let (_, maps, ate_m) = mapped(&all);
    assert!(maps == 1 && ate_m < 0.4, "{maps} {ate_m}");
    all.iter_mut().for_each(|(cloud, _)| cloud.odom_from_robot = None);
    assert_eq!(mapped(&all).1, 2);
}

/// Where what they say of single clouds was believed, 0.2 m, and two maps.
#[test]
fn wheels_that_err_are_doubted() {
    let all = clouds(4, 36.0);
    let long = changed(&all, |_, step| Pose3 { translation: 1.2 * step.translation, ..step });
    let far = Vector3::new(30.0, -5.0, 0.0);
    let jumping = changed(&all, |k, step| if k % 40 == 0 { Pose3 { translation: far, ..step } } else { step });
    let standing = changed(&all, |k, step| if (60..90).contains(&k) { Pose3::identity() } else { step });
    for (name, wheels) in [("long", long), ("jumping", jumping), ("standing", standing)] {
        let (breaks, maps, ate_m) = mapped(&wheels);
        assert!(breaks == 0 && maps == 1 && ate_m < 0.02, "{name}: {breaks} {maps} {ate_m}");
    }
}
