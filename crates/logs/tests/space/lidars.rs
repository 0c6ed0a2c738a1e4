//! Several lidars of one robot.

use super::*;

/// A point in each direction within so many degrees of ahead.
fn fan(half_deg: i32) -> Vec<u8> {
    let at = |deg: i32| f64::from(deg).to_radians();
    floats(
        &(-half_deg..=half_deg)
            .flat_map(|deg| [5.0 * at(deg).cos() as f32, 5.0 * at(deg).sin() as f32, 0.2])
            .collect::<Vec<_>>(),
    )
}

/// Two lidars that look ahead and back, of which clouds were recorded so: the topic, the frame, when it was taken and recorded, ms.
fn two_lidars(name: &str, half_deg: i32, mounts: &[&str], clouds: &[(&str, &str, i64, i64)]) -> PathBuf {
    let mut recorder = Recorder::new(name);
    for frame in mounts {
        let is_rear = frame.ends_with("rear");
        let turned = if is_rear { [0.0, 0.0, 1.0, 0.0] } else { [0.0, 0.0, 0.0, 1.0] };
        let x = if is_rear { -0.3 } else { 0.2 };
        recorder.link("/tf_static", 0, "base_link", frame, Pose3::from_quaternion([x, 0.0, 0.5], turned).unwrap());
    }
    let data = fan(half_deg);
    for &(topic, frame, stamp_ms, recorded_ms) in clouds {
        let message = PointCloud2 { header: Header::new(ms(stamp_ms), frame), ..cloud(ms(stamp_ms), &data) };
        recorder.write(topic, CLOUD, ms(recorded_ms), &message);
    }
    recorder.finish()
}

const IN_TURN: [(&str, &str, i64, i64); 5] = [
    ("/front", "lidar_front", 100, 130),
    ("/rear", "lidar_rear", 50, 140),
    ("/rear", "lidar_rear", 150, 190),
    ("/front", "lidar_front", 200, 230),
    ("/front", "lidar_front", 300, 330),
];

#[test]
fn lidars_that_look_different_ways_are_mapped_together_in_the_order_of_their_stamps() {
    let path = two_lidars("two_lidars.mcap", 90, &["lidar_front", "lidar_rear"], &IN_TURN);
    let (clouds, notes, plan) = read(&path);
    let found: Vec<_> = clouds.iter().map(|cloud| (cloud.sensor.name.as_str(), cloud.stamp)).collect();
    assert_eq!(
        found,
        [("/rear", ms(50)), ("/front", ms(100)), ("/rear", ms(150)), ("/front", ms(200)), ("/front", ms(300))]
    );
    assert_eq!(clouds.iter().map(|cloud| cloud.sensor.robot_from_sensor.translation.x).next(), Some(-0.3));
    assert_eq!((plan.topic.as_str(), &plan.further[..], plan.messages), ("/front", &["/rear".to_owned()][..], 5));
    assert!(said(&plan.reasons, "mapped too, it sees 175 deg around the robot"), "{:?}", plan.reasons);
    assert_eq!(notes.count(NoteKind::BackwardStamp), 0);
}

#[test]
fn a_second_lidar_that_sees_no_more_is_mapped_where_it_is_asked_for() {
    let path = two_lidars("two_all_round.mcap", 180, &["lidar_front", "lidar_rear"], &IN_TURN);
    let (clouds, _, plan) = read(&path);
    assert!(clouds.len() == 3 && plan.further.is_empty());
    assert!(said(&plan.reasons, "to map it too: --topic /front --topic /rear"), "{:?}", plan.reasons);
    let choice = Choice { topics: vec!["/rear".to_owned(), "front".to_owned()], ..Choice::default() };
    assert_eq!(read_with(&path, &choice, &CameraOptions::default()).0.len(), 5);
}

#[test]
fn a_second_lidar_of_which_nothing_says_where_it_sits_is_refused_where_it_is_asked_for() {
    let path = two_lidars("no_second_mount.mcap", 90, &["lidar_front"], &IN_TURN);
    let (clouds, _, plan) = read(&path);
    assert_eq!(clouds.len(), 3);
    assert!(said(&plan.reasons, "not used: /rear: nothing says where 'lidar_rear' sits"), "{:?}", plan.reasons);
    let choice = Choice { topics: vec!["/front".to_owned(), "/rear".to_owned()], ..Choice::default() };
    let refused = SpacePlan::of(&Survey::of(&path).unwrap(), &choice, &CameraOptions::default()).unwrap_err();
    assert!(refused.contains("/rear beside /front: nothing says where 'lidar_rear' sits on the robot"), "{refused}");
}

#[test]
fn a_clock_that_is_seconds_beside_keeps_lidars_apart() {
    let beside = IN_TURN.map(|(topic, frame, stamp, recorded)| {
        (topic, frame, if topic == "/rear" { stamp + 20_000 } else { stamp }, recorded)
    });
    let path = two_lidars("two_clocks.mcap", 90, &["lidar_front", "lidar_rear"], &beside);
    let (clouds, _, plan) = read(&path);
    assert_eq!(clouds.len(), 3);
    assert!(said(&plan.reasons, "its clock is 19.9 s beside"), "{:?}", plan.reasons);
}
