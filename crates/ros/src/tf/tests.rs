use super::*;
use nalgebra::{UnitQuaternion, Vector3};
use std::f64::consts::{FRAC_PI_2, PI};

fn pose(x: f64, yaw: f64) -> Pose3 {
    Pose3 {
        translation: Vector3::new(x, 0.0, 0.0),
        rotation: UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 0.0, yaw)),
    }
}

fn at(seconds: f64) -> Stamp {
    Stamp::from_secs_f64(seconds)
}

/// map -> odom -> base_link -> laser, base_link -> camera, odom from 12.3 s to 14.5 s.
fn robot() -> TransformBuffer {
    let mut buffer = TransformBuffer::default();
    buffer.insert(at(0.0), "map", "odom", pose(10.0, 0.0), true).unwrap();
    buffer.insert(at(12.3), "/odom", "/base_link", pose(0.0, 0.0), false).unwrap();
    buffer.insert(at(14.5), "odom", "base_link", pose(2.2, FRAC_PI_2), false).unwrap();
    buffer.insert(at(0.0), "base_link", "laser", pose(0.5, 0.0), true).unwrap();
    buffer.insert(at(0.0), "base_link", "camera", pose(0.7, PI), true).unwrap();
    buffer
}

#[test]
fn frames_are_found_across_the_tree_and_interpolated() {
    let buffer = robot();
    let map_from_laser = buffer.lookup("map", "/laser", at(13.4)).unwrap();
    let half = 0.5 * std::f64::consts::FRAC_1_SQRT_2;
    assert!((map_from_laser.translation - Vector3::new(11.1 + half, half, 0.0)).norm() < 1e-9);
    let camera_from_laser = buffer.lookup("camera", "laser", at(99.0)).unwrap();
    assert!((camera_from_laser.translation - Vector3::new(0.2, 0.0, 0.0)).norm() < 1e-9);
    assert_eq!(buffer.lookup("x", "x", at(0.0)).unwrap(), Pose3::identity());
    assert_eq!(buffer.known_times("map", "laser").unwrap(), Some((at(12.3), at(14.5))));
    assert_eq!(buffer.frames(), ["base_link", "camera", "laser", "map", "odom"]);
    assert!(buffer.is_static("laser") && !buffer.is_static("base_link"));
}

#[test]
fn after_a_clock_that_was_set_back_only_what_never_moves_is_known() {
    let mut buffer = robot();
    buffer.forget_moving();
    assert!(
        buffer.lookup("odom", "base_link", at(13.0)).is_err() && buffer.lookup("base_link", "laser", at(1.0)).is_ok()
    );
    buffer.insert(at(0.5), "odom", "base_link", pose(1.0, 0.0), false).unwrap();
    assert!(buffer.lookup("odom", "laser", at(0.5)).is_ok(), "times before those known then are taken in again");
}

#[test]
fn the_missing_link_is_named() {
    let mut buffer = robot();
    let error = |buffer: &TransformBuffer, target, source, seconds| {
        buffer.lookup(target, source, at(seconds)).unwrap_err().to_string()
    };
    assert_eq!(
        error(&buffer, "base_link", "lidar", 13.0),
        "no transform from 'lidar' to 'base_link': 'lidar' is published nowhere; frames known: base_link, camera, laser, \
         map, odom"
    );
    assert_eq!(
        error(&buffer, "map", "laser", 14.72),
        "'odom' -> 'base_link' is known from 12.300 s to 14.500 s, 14.720 s was asked for"
    );
    buffer.insert(at(0.0), "world", "truth", pose(0.0, 0.0), true).unwrap();
    assert_eq!(
        error(&buffer, "map", "truth", 13.0),
        "no transform from 'truth' to 'map': 'truth' hangs below 'world' and 'map' below 'map', and nothing links the two"
    );
}

#[test]
fn cycles_and_frames_without_direction_are_refused_and_new_parents_counted() {
    let mut buffer = robot();
    let error = buffer.insert(at(0.0), "laser", "map", pose(0.0, 0.0), true).unwrap_err();
    assert_eq!(
        error.to_string(),
        "transform 'laser' -> 'map': a cycle: 'map' is above already: laser < base_link < odom < map"
    );
    assert!(buffer.insert(at(0.0), "laser", "/laser", pose(0.0, 0.0), true).is_err());
    assert!(buffer.insert(at(0.0), "laser", "tip", pose(f64::NAN, 0.0), true).is_err());
    let message = TfMessage { transforms: vec![crate::messages::TransformStamped::default()] };
    assert!(buffer.insert_message(&message, false).unwrap_err().to_string().contains("quaternion"));
    buffer.insert(at(0.0), "map", "laser", pose(1.0, 0.0), true).unwrap();
    assert_eq!(buffer.parent("laser"), Some("map"));
    assert_eq!(buffer.counts(), TransformCounts { taken: 6, too_old: 0, refused: 4, moved: 1 });
}

#[test]
fn memory_is_bounded_and_late_transforms_find_their_place() {
    let mut buffer = TransformBuffer::new(TransformLimits { window_s: 1.0, per_frame: 50, frames: 1 });
    for i in 0..1000 {
        let late = if i % 2 == 0 { 0.0 } else { 0.015 };
        buffer.insert(at(f64::from(i) * 0.01 - late), "odom", "base_link", pose(f64::from(i), 0.0), false).unwrap();
    }
    let (first, last) = buffer.known_times("odom", "base_link").unwrap().unwrap();
    assert!(last.secs_since(first) < 1.0 && last == at(9.98));
    buffer.insert(at(1.0), "odom", "base_link", pose(0.0, 0.0), false).unwrap();
    assert_eq!(buffer.counts().too_old, 1);
    assert!(buffer.insert(at(1.0), "odom", "another", pose(0.0, 0.0), false).is_err());
}

#[test]
fn half_a_turn_between_two_transforms_is_survived() {
    let mut buffer = TransformBuffer::default();
    buffer.insert(at(0.0), "a", "b", pose(0.0, 0.0), false).unwrap();
    buffer.insert(at(1.0), "a", "b", pose(1.0, PI), false).unwrap();
    assert!(buffer.lookup("a", "b", at(0.3)).unwrap().is_finite());
}
