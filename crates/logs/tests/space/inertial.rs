//! Inertial sensors beside clouds.

use super::*;

/// Everything that a recording delivers, in order.
fn events(path: &Path) -> (Vec<SpaceEvent>, Notes, SpacePlan) {
    let survey = Survey::of(path).unwrap();
    let plan = SpacePlan::of(&survey, &Choice::default(), &CameraOptions::default()).unwrap();
    let mut stream = SpaceStream::open("log", path, survey, plan.clone()).unwrap();
    let events = std::iter::from_fn(|| stream.next_event().unwrap()).collect();
    (events, stream.notes().clone(), plan)
}

fn readings(events: &[SpaceEvent]) -> Vec<ImuReading> {
    let reading = |event: &SpaceEvent| if let SpaceEvent::Imu(reading) = event { Some(*reading) } else { None };
    events.iter().filter_map(reading).collect()
}

#[test]
fn inertial_readings_come_in_the_robots_frame_before_the_clouds_that_they_tell_of() {
    let mut recorder = Recorder::new("imu_space.mcap");
    let half = std::f64::consts::FRAC_1_SQRT_2;
    // lying on its side: its y axis is the robot's z
    let lying = Pose3::from_quaternion([0.1, 0.0, 0.3], [half, 0.0, 0.0, half]).unwrap();
    recorder.link("/tf_static", 0, "base_link", "lidar", shifted(0.2, 1.0));
    recorder.link("/tf_static", 0, "base_link", "imu_link", lying);
    for k in 0..40 {
        recorder.imu("/imu/data", "imu_link", 10 * k, [0.1, 0.5, 0.0], [0.0, 9.8, 0.0]);
        recorder.imu("/imu/other", "imu_link", 10 * k, [9.0; 3], [0.0; 3]);
        if k % 10 == 0 {
            recorder.cloud(10 * k, &floats(&[1.0, 2.0, 3.0]));
            recorder.imu("/imu/data", "imu_link", 10 * k + 5, [0.1, 0.5, 0.0], [0.0, 9.8, 0.0]);
        }
    }
    let path = recorder.finish();
    let (events, notes, plan) = events(&path);
    let source = plan.imu.as_ref().unwrap();
    assert_eq!((source.name.as_str(), source.messages, source.frame.as_str()), ("/imu/data", 44, "imu_link"));
    let reason = &plan.reasons.iter().find(|(what, _)| *what == "imu").unwrap().1;
    assert!(reason.contains("44 messages, 11") && reason.contains("not used: /imu/other"), "{reason}");
    assert!(plan.assumed.iter().all(|assumed| !assumed.contains("imu_link")), "{plan:?}");
    let found = readings(&events);
    assert_eq!(found.len(), 44);
    for reading in &found {
        let force = reading.specific_force_m_per_s2.unwrap();
        assert!((reading.turn_rate_rad_per_s - nalgebra::Vector3::new(0.1, 0.0, 0.5)).norm() < 1e-9, "{reading:?}");
        assert!((force - nalgebra::Vector3::new(0.0, 0.0, 9.8)).norm() < 1e-9, "{reading:?}");
    }
    let mut last = Stamp(0);
    for event in &events {
        match event {
            SpaceEvent::Imu(reading) => last = reading.stamp,
            SpaceEvent::Odometry(_) => {}
            SpaceEvent::Cloud(cloud) => assert!(last >= cloud.stamp, "{last:?} {:?}", cloud.stamp),
        }
    }
    assert_eq!(events.len(), 48);
    assert_eq!(notes, Notes::default());
    let (clouds, _, _) = read(&path);
    assert_eq!(clouds.len(), 4, "clouds alone");
}

#[test]
fn of_several_inertial_sensors_that_beside_the_lidar_is_read() {
    let mut recorder = Recorder::new("two_imus.mcap");
    let points = floats(&[1.0, 2.0, 3.0]);
    for k in 0..20 {
        recorder.imu("/imu", "elsewhere", 10 * k, [1.0; 3], [0.0, 0.0, 9.8]);
        recorder.imu("/imu", "elsewhere", 10 * k + 5, [1.0; 3], [0.0, 0.0, 9.8]);
        recorder.imu("/os/imu", "os_imu", 10 * k, [2.0; 3], [0.0; 3]);
        recorder.write("/os/points", CLOUD, ms(10 * k), &cloud(ms(10 * k), &points));
    }
    let (events, _, plan) = events(&recorder.finish());
    assert_eq!(plan.imu.unwrap().name, "/os/imu");
    let assumed = plan.assumed.iter().find(|assumed| assumed.contains("'os_imu'")).unwrap();
    assert!(assumed.contains("its axes are taken for the robot's"), "{assumed}");
    let found = readings(&events);
    assert!(
        found.iter().all(|reading| reading.specific_force_m_per_s2.is_none() && reading.turn_rate_rad_per_s.x == 2.0)
    );
}

#[test]
fn inertial_messages_that_cannot_be_are_counted() {
    let mut recorder = Recorder::new("bad_imu.mcap");
    let level = [0.0, 0.0, 9.8];
    recorder.imu("/imu", "lidar", 0, [0.0; 3], level);
    recorder.imu("/imu", "lidar", 10, [f64::NAN, 0.0, 0.0], level);
    recorder.imu("/imu", "lidar", 20, [0.0; 3], [0.0, f64::INFINITY, 0.0]);
    recorder.imu("/imu", "lidar", 30, [0.0, 1e9, 0.0], level);
    recorder.imu("/imu", "elsewhere", 40, [0.0; 3], level);
    recorder.raw("/imu", IMU, ms(50), &[0, 1, 0, 0, 1, 2]);
    let mut without_rate = imu(ms(60), "lidar", [0.0; 3], level);
    without_rate.angular_velocity_covariance.0[0] = -1.0;
    recorder.write("/imu", IMU, ms(60), &without_rate);
    let mut without_force = imu(ms(70), "lidar", [0.0; 3], level);
    without_force.linear_acceleration_covariance.0[0] = -1.0;
    recorder.write("/imu", IMU, ms(70), &without_force);
    recorder.write("/imu", IMU, ms(80), &imu(Stamp(0), "lidar", [0.0; 3], level));
    recorder.write("/imu", IMU, ms(90), &imu(ms(5), "lidar", [0.0; 3], level));
    recorder.cloud(100, &floats(&[1.0, 2.0, 3.0]));
    let (events, notes, _) = events(&recorder.finish());
    let found = readings(&events);
    assert_eq!(found.iter().map(|reading| reading.stamp).collect::<Vec<_>>(), [ms(0), ms(70), ms(80), ms(5)]);
    assert_eq!(found[1].specific_force_m_per_s2, None);
    let kinds = [NoteKind::UnreadableImu, NoteKind::RecordedStamp, NoteKind::BackwardStamp];
    assert_eq!(kinds.map(|kind| notes.count(kind)), [6, 1, 1], "{notes:?}");
    assert_eq!(events.len(), 5);
}

#[test]
fn an_inertial_sensor_that_falls_silent_holds_clouds_up_and_loses_none() {
    let mut recorder = Recorder::new("silent_imu.mcap");
    for k in 0..100 {
        recorder.cloud(100 * k, &floats(&[1.0, 2.0, 3.0]));
        if k < 10 {
            recorder.imu("/imu", "lidar", 100 * k + 1, [0.0; 3], [0.0, 0.0, 9.8]);
        }
    }
    let (events, notes, _) = events(&recorder.finish());
    assert_eq!((events.len(), notes), (110, Notes::default()));
}
