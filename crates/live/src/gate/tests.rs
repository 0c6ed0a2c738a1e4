use super::*;
use crate::tally::Reason;
use mapwright_geom::Pose2;
use mapwright_ros::messages::{Header, Pose, PoseWithCovariance, TransformStamped};
use mapwright_sensor::OdometryCalibration;
use nalgebra::UnitQuaternion;
use proptest::prelude::*;

fn at(seconds: f64) -> Arrived {
    Arrived { since_start: Duration::from_secs_f64(seconds.max(0.0)), stamp: Stamp::from_secs_f64(1000.0 + seconds) }
}

fn link<'a>(parent: &'a str, child: &'a str, seconds: f64, x: f64) -> TfMessage<'a> {
    let pose = Pose3 { translation: [x, 0.0, 0.0].into(), ..Pose3::identity() };
    let header = Header::new(at(seconds).stamp, parent);
    TfMessage { transforms: vec![TransformStamped { header, child_frame_id: child.into(), transform: pose.into() }] }
}

fn scan(seconds: f64, ranges: &[f32]) -> ScanMessage<'_> {
    ScanMessage {
        header: Header::new(at(seconds).stamp, "laser"),
        angle_min: -1.0,
        angle_max: -1.0 + 0.5 * (ranges.len().max(1) - 1) as f32,
        angle_increment: 0.5,
        range_max: 10.0,
        ranges: ranges.into(),
        ..Default::default()
    }
}

/// The robot has driven `x = s` metres at `s` seconds.
fn drive(gate: &mut Gate, seconds: f64) {
    gate.hear_transforms(&link("odom", "base_link", seconds, seconds), false, at(seconds)).unwrap();
}

fn mounted() -> Gate {
    let mut gate = Gate::new(GateSettings::default());
    gate.hear_transforms(&link("base_link", "laser", 0.0, 0.2), true, at(0.0)).unwrap();
    gate
}

fn scans(gate: &mut Gate, seconds: f64) -> Vec<LaserScan> {
    let next = || gate.next(at(seconds).since_start);
    let is_scan = |passed| match passed {
        Passed::Scan(scan) => Some(scan),
        Passed::Cloud(_) | Passed::Reading(_) => None,
    };
    std::iter::from_fn(next).filter_map(is_scan).collect()
}

#[test]
fn a_scan_waits_for_odometry_and_lies_between_its_readings() {
    let mut gate = mounted();
    drive(&mut gate, 1.0);
    gate.hear_scan("/scan", &scan(1.05, &[1.0; 5]), at(1.06));
    assert!(scans(&mut gate, 1.07).is_empty(), "odometry is not there yet");
    drive(&mut gate, 1.1);
    let found = scans(&mut gate, 1.11);
    assert_eq!(found.len(), 1);
    let pose = found[0].odom_from_robot.unwrap();
    assert!((pose.x - 1.05).abs() < 1e-9 && found[0].laser.robot_from_laser.x == 0.2, "{pose:?}");
    assert!(gate.missing(at(1.2).since_start).is_empty());
    let tally = gate.tallies().next().unwrap().1.clone();
    assert_eq!((tally.arrived(), tally.used(), tally.waiting()), (1, 1, 0));
}

#[test]
fn odometry_passes_in_the_order_of_stamps_with_the_scans() {
    let mut gate = mounted();
    drive(&mut gate, 1.0);
    gate.hear_scan("/scan", &scan(1.05, &[1.0; 5]), at(1.06));
    drive(&mut gate, 1.1);
    let order: Vec<Stamp> = std::iter::from_fn(|| gate.next(at(1.2).since_start))
        .map(|passed| match passed {
            Passed::Scan(scan) => scan.stamp,
            Passed::Reading(reading) => reading.stamp(),
            Passed::Cloud(cloud) => cloud.stamp,
        })
        .collect();
    assert_eq!(order, [1.0, 1.05, 1.1].map(|seconds| at(seconds).stamp));
}

#[test]
fn without_odometry_scans_go_on_and_that_is_said() {
    let mut gate = mounted();
    gate.hear_scan("/scan", &scan(0.1, &[1.0; 5]), at(0.1));
    assert!(scans(&mut gate, 0.3).is_empty(), "it may still come");
    let found = scans(&mut gate, 0.7);
    assert!(found.len() == 1 && found[0].odom_from_robot.is_none());
    gate.hear_scan("/scan", &scan(0.8, &[1.0; 5]), at(0.8));
    assert_eq!(scans(&mut gate, 0.8).len(), 1, "nobody waits for what never came");
    let words = gate.missing(at(0.9).since_start).join("; ");
    assert!(words.starts_with("scans are mapped without odometry: no transform from 'base_link' to 'odom'"), "{words}");
    drive(&mut gate, 0.9);
    drive(&mut gate, 1.0);
    gate.hear_scan("/scan", &scan(0.95, &[1.0; 5]), at(1.0));
    assert!(scans(&mut gate, 1.0)[0].odom_from_robot.is_some() && gate.missing(at(1.1).since_start).is_empty());
}

#[test]
fn odometry_that_falls_silent_holds_for_a_while() {
    let mut gate = mounted();
    (0..10).for_each(|k| drive(&mut gate, 0.1 * f64::from(k)));
    gate.hear_scan("/scan", &scan(1.5, &[1.0; 5]), at(1.5));
    let found = scans(&mut gate, 2.1);
    assert!((found[0].odom_from_robot.unwrap().x - 0.9).abs() < 1e-9);
    gate.hear_scan("/scan", &scan(3.5, &[1.0; 5]), at(3.5));
    assert!(scans(&mut gate, 3.5)[0].odom_from_robot.is_none(), "2.6 s later nobody knows");
}

#[test]
fn what_is_known_of_sensors_counts_before_what_messages_say() {
    let odometry =
        OdometryCalibration { translation_scale: 2.0, rotation_scale: 1.0, drift_rad_per_m: 0.0, lag_s: 0.1 };
    let known = KnownSensors {
        laser: Some((Pose2::new(0.3, 0.0, 1.0), true)),
        imu: Some(UnitQuaternion::identity()),
        imu_lag_s: 0.25,
        odometry: Some(odometry),
        ..KnownSensors::default()
    };
    let mut gate = Gate::new(GateSettings { known, ..GateSettings::default() });
    drive(&mut gate, 1.0);
    gate.hear_scan("/scan", &scan(1.0, &[1.0; 5]), at(1.0));
    assert!(scans(&mut gate, 1.05).is_empty(), "the reading that is true at its stamp comes a lag later");
    drive(&mut gate, 1.2);
    let found = scans(&mut gate, 1.2);
    assert_eq!(found[0].laser.robot_from_laser, Pose2::new(0.3, 0.0, 1.0));
    assert!(found[0].laser.inverted, "as it was said, with no transform to its frame");
    // Read at 1.1 s by its stamps, 0.1 m on from 1 m, which was 0.2 m.
    assert!((found[0].odom_from_robot.unwrap().x - 1.2).abs() < 1e-9, "{found:?}");
    // Whoever looks up the robot at 1.0 s finds it at 1 m.
    assert!((gate.told().unwrap().translation.x - 1.0).abs() < 1e-9, "{:?}", gate.told());
    let message = ImuMessage { header: Header::new(at(1.5).stamp, "imu"), ..Default::default() };
    gate.hear_imu(&message, at(1.5)).unwrap();
    let rates = std::iter::from_fn(|| gate.next(at(1.6).since_start)).filter_map(|passed| match passed {
        Passed::Reading(Reading::Turning(rate)) => Some(rate.stamp),
        _ => None,
    });
    assert_eq!(rates.collect::<Vec<_>>(), [at(1.25).stamp]);
}

/// As a clock is that is corrected now and then: all that was seen is mapped, in the order in which it came.
#[test]
fn stamps_that_step_back_a_little_are_used() {
    let mut gate = mounted();
    (0..40).for_each(|tenth| drive(&mut gate, 0.1 * f64::from(tenth)));
    for seconds in [1.0, 2.0, 1.9, 1.9, 3.0] {
        gate.hear_scan("/scan", &scan(seconds, &[1.0; 5]), at(3.9));
    }
    let found: Vec<f64> = scans(&mut gate, 3.9).iter().map(|scan| scan.odom_from_robot.unwrap().x).collect();
    let expected = [1.0, 2.0, 1.9, 3.0];
    assert!(found.len() == 4 && found.iter().zip(expected).all(|(x, y)| (x - y).abs() < 1e-9), "{found:?}");
    assert_eq!(gate.tallies().next().unwrap().1.dropped_for(Reason::Late), 1, "the same twice");
}

#[test]
fn odometry_far_out_is_mapped_near_the_origin_and_told_where_it_is() {
    let mut gate = mounted();
    let far = |gate: &mut Gate, seconds: f64, x: f64| {
        gate.hear_transforms(&link("odom", "base_link", seconds, x), false, at(seconds))
    };
    far(&mut gate, 1.0, 4.5e6).unwrap();
    far(&mut gate, 1.1, 4.5e6 + 0.1).unwrap();
    gate.hear_scan("/scan", &scan(1.1, &[1.0; 5]), at(1.1));
    let found = scans(&mut gate, 1.1);
    assert!((found[0].odom_from_robot.unwrap().x - 0.1).abs() < 1e-6, "{found:?}");
    assert!((gate.told().unwrap().translation.x - 4.5e6 - 0.1).abs() < 1e-6);
    let error = far(&mut gate, 1.2, 9e9).unwrap_err().to_string();
    assert!(error.contains("odometry is at 9e9 m, 0e0 m, too far out"), "{error}");
}

/// A base on springs: two links that move, each told by itself.
#[test]
fn odometry_of_two_moving_links_is_known_as_far_as_both_are() {
    let mut gate = mounted();
    for tenth in 10..20 {
        let seconds = 0.1 * f64::from(tenth);
        gate.hear_transforms(&link("odom", "footprint", seconds, seconds), false, at(seconds)).unwrap();
        gate.hear_transforms(&link("footprint", "base_link", seconds + 0.03, 0.5), false, at(seconds + 0.03)).unwrap();
    }
    gate.hear_scan("/scan", &scan(1.55, &[1.0; 5]), at(1.95));
    let found = scans(&mut gate, 1.95);
    assert!((found[0].odom_from_robot.unwrap().x - 2.05).abs() < 1e-9, "{found:?}");
}

#[test]
fn what_says_nothing_of_its_place_is_dropped_and_named() {
    let mut gate = Gate::new(GateSettings::default());
    for k in 1..=4 {
        drive(&mut gate, f64::from(k));
        gate.hear_scan("/scan", &scan(f64::from(k), &[1.0; 5]), at(f64::from(k)));
    }
    assert!(scans(&mut gate, 4.1).is_empty());
    let words = gate.missing(at(4.2).since_start).join("; ");
    assert!(
        words.contains("/scan arrives and has not been used for") && words.contains("'laser' is published nowhere"),
        "{words}"
    );
    assert_eq!(gate.tallies().next().unwrap().1.dropped_for(Reason::NoMount), 4);
    gate.hear_transforms(&link("base_link", "laser", 4.0, 0.2), true, at(4.3)).unwrap();
    gate.hear_scan("/scan", &scan(4.0, &[1.0; 5]), at(4.3));
    assert_eq!(scans(&mut gate, 4.3).len(), 1, "as soon as it is said");
    assert!(gate.missing(at(4.4).since_start).is_empty());
}

#[test]
fn beams_that_change_their_number_are_used_and_broken_scans_named() {
    let mut gate = mounted();
    drive(&mut gate, 0.0);
    drive(&mut gate, 9.0);
    let ranges = [1.0; 9];
    for k in 1..9 {
        gate.hear_scan("/scan", &scan(f64::from(k as u8), &ranges[..k]), at(1.0));
    }
    assert_eq!(
        scans(&mut gate, 1.0).iter().map(|scan| scan.ranges_m.len()).collect::<Vec<_>>(),
        [1, 2, 3, 4, 5, 6, 7, 8]
    );
    gate.hear_scan("/scan", &scan(8.5, &[]), at(1.1));
    gate.hear_scan("/scan", &scan(8.0, &ranges), at(1.1));
    assert!(scans(&mut gate, 1.1).is_empty());
    let tally = gate.tallies().next().unwrap().1;
    assert_eq!((tally.dropped_for(Reason::Unusable), tally.dropped_for(Reason::Late), tally.waiting()), (1, 1, 0));
}

#[test]
fn after_a_broken_scan_the_next_waits_for_odometry_as_ever() {
    let mut gate = mounted();
    drive(&mut gate, 1.0);
    gate.hear_scan("/scan", &scan(1.02, &[]), at(1.02));
    gate.hear_scan("/scan", &scan(1.05, &[1.0; 5]), at(1.06));
    assert!(scans(&mut gate, 1.07).is_empty());
    drive(&mut gate, 1.1);
    assert!((scans(&mut gate, 1.11)[0].odom_from_robot.unwrap().x - 1.05).abs() < 1e-9);
}

#[test]
fn a_laser_without_a_place_makes_another_wait_once() {
    let mut gate = mounted();
    for k in 1..=5 {
        let seconds = f64::from(k);
        drive(&mut gate, seconds);
        let of_rear = ScanMessage { header: Header::new(at(seconds).stamp, "rear"), ..scan(seconds, &[1.0; 5]) };
        gate.hear_scan("/rear", &of_rear, at(seconds));
        gate.hear_scan("/scan", &scan(seconds, &[1.0; 5]), at(seconds));
        assert_eq!(scans(&mut gate, seconds).len(), usize::from(k > 1), "{k}");
        assert_eq!(scans(&mut gate, seconds + 0.6).len(), usize::from(k == 1), "{k}");
    }
}

#[test]
fn a_clock_that_is_set_back_begins_anew_and_a_late_scan_does_not() {
    let mut gate = mounted();
    for k in 0..50 {
        drive(&mut gate, 100.0 + 0.1 * f64::from(k));
    }
    gate.hear_scan("/scan", &scan(104.8, &[1.0; 5]), at(105.0));
    assert_eq!(scans(&mut gate, 105.0).len(), 1);
    gate.hear_scan("/scan", &scan(3.0, &[1.0; 5]), at(105.1));
    assert!(scans(&mut gate, 105.1).is_empty() && gate.set_back() == 0, "late");
    for k in 0..10 {
        gate.hear_scan("/scan", &scan(1.0 + 0.1 * f64::from(k), &[1.0; 5]), at(106.0));
        drive(&mut gate, 1.0 + 0.1 * f64::from(k));
    }
    let found = scans(&mut gate, 106.6);
    assert!(gate.set_back() == 1 && found.len() >= 7, "{} of ten", found.len());
    assert!(found.iter().skip(1).all(|scan| scan.odom_from_robot.is_some()));
}

#[test]
fn messages_of_odometry_count_where_transforms_do_not_say_the_same() {
    let mut gate = mounted();
    let message = |seconds: f64, x: f64| OdometryMessage {
        header: Header::new(at(seconds).stamp, "odom"),
        child_frame_id: "base_link".into(),
        pose: PoseWithCovariance {
            pose: Pose::from(Pose3 { translation: [x, 0.0, 0.0].into(), ..Pose3::identity() }),
            ..Default::default()
        },
        ..Default::default()
    };
    gate.hear_odometry(&message(1.0, 5.0), at(1.0)).unwrap();
    gate.hear_odometry(&message(2.0, 6.0), at(2.0)).unwrap();
    gate.hear_scan("/scan", &scan(1.5, &[1.0; 5]), at(2.0));
    assert!((scans(&mut gate, 2.0)[0].odom_from_robot.unwrap().x - 5.5).abs() < 1e-9);
    drive(&mut gate, 2.1);
    gate.hear_odometry(&message(2.2, 99.0), at(2.2)).unwrap();
    gate.hear_scan("/scan", &scan(2.1, &[1.0; 5]), at(2.2));
    assert!((scans(&mut gate, 2.2)[0].odom_from_robot.unwrap().x - 2.1).abs() < 1e-9);
}

#[derive(Debug, Clone)]
enum Event {
    Scan(usize, f64, usize),
    Drive(f64),
    Mount,
    Wait(f64),
    Odd(f64),
}

fn events() -> impl Strategy<Value = Vec<Event>> {
    let event = prop_oneof![
        4 => (0..3_usize, -20.0..40.0, 0..6_usize).prop_map(|(topic, s, beams)| Event::Scan(topic, s, beams)),
        4 => (-20.0..40.0).prop_map(Event::Drive),
        1 => Just(Event::Mount),
        3 => (0.0..1.0).prop_map(Event::Wait),
        1 => prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(1e300)].prop_map(Event::Odd),
    ];
    prop::collection::vec(event, 0..150)
}

/// Three points of a frame, taken `spread` seconds apart.
fn cloud_bytes(spread: f32) -> Vec<u8> {
    let points = [[1.0, 0.0, 0.5], [2.0, 1.0, 0.0], [f32::NAN, 0.0, 0.0]];
    let timed = (0_u16..).zip(points).flat_map(|(k, [x, y, z])| [x, y, z, spread * f32::from(k)]);
    timed.flat_map(f32::to_le_bytes).collect()
}

fn cloud<'a>(seconds: f64, frame: &'a str, data: &'a [u8]) -> PointCloud2<'a> {
    let field = |(name, offset): (&'static str, u32)| mapwright_ros::messages::PointField {
        name: name.into(),
        offset,
        datatype: 7,
        count: 1,
    };
    PointCloud2 {
        header: Header::new(at(seconds).stamp, frame),
        height: 1,
        width: (data.len() / 16) as u32,
        fields: [("x", 0), ("y", 4), ("z", 8), ("time", 12)].map(field).into(),
        is_bigendian: false,
        point_step: 16,
        row_step: data.len() as u32,
        data,
        is_dense: false,
    }
}

fn imu(seconds: f64, forward: f64) -> ImuMessage<'static> {
    let mut message = ImuMessage { header: Header::new(at(seconds).stamp, "lidar"), ..Default::default() };
    (message.angular_velocity.x, message.linear_acceleration.z) = (forward, 9.81);
    message
}

fn in_space() -> Gate {
    let mut gate = Gate::new(GateSettings { is_in_space: true, ..GateSettings::default() });
    gate.hear_transforms(&link("base_link", "lidar", 0.0, 0.2), true, at(0.0)).unwrap();
    gate
}

fn passed(gate: &mut Gate, seconds: f64) -> Vec<Passed> {
    std::iter::from_fn(|| gate.next(at(seconds).since_start)).collect()
}

#[test]
fn a_cloud_waits_for_odometry_at_its_beginning_and_for_inertial_readings_until_its_end() {
    let (mut gate, data) = (in_space(), cloud_bytes(0.04));
    drive(&mut gate, 0.9);
    gate.hear_imu(&imu(0.95, 0.5), at(0.95)).unwrap();
    gate.hear_cloud("/points", &cloud(1.0, "lidar", &data), at(1.09));
    let is_cloud = |passed: &Passed| matches!(passed, Passed::Cloud(_));
    assert!(!passed(&mut gate, 1.1).iter().any(is_cloud), "neither is there");
    drive(&mut gate, 1.1);
    assert!(!passed(&mut gate, 1.11).iter().any(is_cloud), "its end is not felt yet");
    gate.hear_imu(&imu(1.03, 0.5), at(1.12)).unwrap();
    assert!(!passed(&mut gate, 1.13).iter().any(is_cloud), "its end is not felt yet");
    gate.hear_imu(&imu(1.12, 0.7), at(1.13)).unwrap();
    let out = passed(&mut gate, 1.14);
    let found: Vec<&Cloud> = out
        .iter()
        .filter_map(|passed| match passed {
            Passed::Cloud(cloud) => Some(cloud),
            _ => None,
        })
        .collect();
    let [cloud] = found[..] else { panic!("{out:?}") };
    let pose = cloud.odom_from_robot.unwrap();
    assert!((pose.translation.x - 1.0).abs() < 1e-9 && cloud.sensor.robot_from_sensor.translation.x == 0.2, "{pose:?}");
    assert_eq!((cloud.points_m.len(), &cloud.times_s[..2]), (3, &[0.0, 0.04][..]));
    assert!(gate.missing(at(1.15).since_start).is_empty());
}

#[test]
fn a_stamp_far_ahead_does_not_say_for_ever_that_all_is_felt() {
    let (mut gate, data) = (in_space(), cloud_bytes(0.04));
    for seconds in [0.9, 1e6, 0.95] {
        gate.hear_imu(&imu(seconds, 0.5), at(0.95)).unwrap();
    }
    drive(&mut gate, 0.9);
    drive(&mut gate, 1.1);
    gate.hear_cloud("/points", &cloud(1.0, "lidar", &data), at(1.1));
    let is_cloud = |passed: &Passed| matches!(passed, Passed::Cloud(_));
    assert!(!passed(&mut gate, 1.11).iter().any(is_cloud), "its end is not felt yet");
    gate.hear_imu(&imu(1.1, 0.5), at(1.12)).unwrap();
    assert!(passed(&mut gate, 1.13).iter().any(is_cloud));
}

#[test]
fn a_cloud_that_nothing_says_the_place_of_is_said_and_one_without_points_too() {
    let (mut gate, data) = (in_space(), cloud_bytes(0.0));
    gate.hear_cloud("/points", &cloud(1.0, "camera", &data), at(1.0));
    assert!(passed(&mut gate, 1.1).is_empty());
    assert!(passed(&mut gate, 2.0).is_empty());
    assert!(gate.missing(at(2.0).since_start)[0].contains("camera"), "{:?}", gate.missing(at(2.0).since_start));
    gate.hear_cloud("/points", &cloud(2.1, "lidar", &data[32..]), at(2.1));
    gate.hear_cloud("/points", &cloud(2.2, "lidar", &[]), at(2.2));
    let (_, tally) = gate.tallies().next().unwrap();
    assert_eq!((tally.arrived(), tally.dropped_for(Reason::NoMount), tally.dropped_for(Reason::Unusable)), (3, 1, 2));
    let odd = ImuMessage { header: Header::new(at(2.3).stamp, "lidar"), ..imu(2.3, f64::NAN) };
    assert!(gate.hear_imu(&odd, at(2.3)).is_err(), "no robot turns so");
}

#[test]
fn times_of_points_that_cannot_be_of_a_sweep_are_left_out_and_said() {
    let (mut gate, data) = (in_space(), cloud_bytes(0.5));
    for k in 0..10_u8 {
        gate.hear_cloud("/points", &cloud(1.0 + 0.1 * f64::from(k), "lidar", &data), at(1.0 + 0.1 * f64::from(k)));
    }
    assert!(
        gate.missing(at(2.0).since_start)[0].contains("times of points"),
        "{:?}",
        gate.missing(at(2.0).since_start)
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(200))]

    #[test]
    fn what_has_arrived_is_used_dropped_or_waits(events in events()) {
        let settings = GateSettings { waiting_most: 5, ..GateSettings::default() };
        let mut gate = Gate::new(settings);
        let (mut now, mut heard, mut passed) = (0.0, 0_u64, 0_u64);
        for event in events {
            match event {
                Event::Scan(topic, seconds, beams) => {
                    heard += 1;
                    gate.hear_scan(["/a", "/b", "/c"][topic], &scan(seconds, &[1.0; 6][..beams]), at(now));
                }
                Event::Drive(seconds) => {
                    // Places may jump by 10^300 m here, which is refused and said.
                    let _ = gate.hear_transforms(&link("odom", "base_link", seconds, seconds), false, at(seconds));
                }
                Event::Mount => gate.hear_transforms(&link("base_link", "laser", now, 0.1), true, at(now)).unwrap(),
                Event::Odd(x) => { let _ = gate.hear_transforms(&link("odom", "base_link", now, x), false, at(now)); }
                Event::Wait(seconds) => {
                    now += seconds;
                    passed += scans(&mut gate, now).len() as u64;
                }
            }
            let (mut arrived, mut used, mut waiting) = (0, 0, 0);
            for (_, tally) in gate.tallies() {
                (arrived, used, waiting) = (arrived + tally.arrived(), used + tally.used(), waiting + tally.waiting());
            }
            prop_assert_eq!((arrived, used), (heard, passed));
            prop_assert_eq!(waiting, gate.waiting.len() as u64);
            prop_assert!(waiting <= 5);
        }
        let _ = gate.missing(at(now).since_start);
        scans(&mut gate, now + 1.0);
        prop_assert!(gate.waiting.is_empty(), "nothing waits longer than that");
    }
}
