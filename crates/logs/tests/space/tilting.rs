//! Planar lasers that tilt.

use super::*;
use mapwright_logs::Plan;
use nalgebra::{UnitQuaternion, Vector3};

const BEAMS: usize = 181;
/// Half the size of the room around the origin, metres.
const ROOM_M: [f64; 3] = [5.0, 4.0, 2.0];
/// From beam to beam, seconds: a scan takes 50 ms.
const BEAM_S: f64 = 0.05 / (BEAMS - 1) as f64;

/// A laser that is 0.1 m before its joint, which sits 0.3 m above the robot and turns about its y axis.
struct Drive {
    /// How far the joint is turned at a time in seconds, radians.
    joint: fn(f64) -> f64,
    /// Metres a second along x.
    speed_m_s: f64,
    has_odometry: bool,
}

fn turned(angle: f64, at: [f64; 3]) -> Pose3 {
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::y_axis(), angle);
    Pose3 { rotation, translation: Vector3::from(at) }
}

/// From inside the room to its wall.
fn range_m(world_from_laser: Pose3, bearing: f64) -> f32 {
    let towards = world_from_laser.rotation * Vector3::new(bearing.cos(), bearing.sin(), 0.0);
    let at = world_from_laser.translation;
    (0..3).map(|k| (ROOM_M[k] * towards[k].signum() - at[k]) / towards[k]).fold(f64::INFINITY, f64::min) as f32
}

impl Drive {
    fn world_from_laser(&self, s: f64) -> Pose3 {
        let world_from_robot = shifted(self.speed_m_s * s, 0.0);
        world_from_robot * turned((self.joint)(s), [0.0, 0.0, 0.3]) * shifted(0.1, 0.0)
    }

    fn record(&self, name: &str, duration_s: f64) -> PathBuf {
        let mut recorder = Recorder::new(name);
        recorder.link("/tf_static", 0, "tilt", "laser", shifted(0.1, 0.0));
        let last = (duration_s * 50.0) as i64;
        for tick in 0..=last + 3 {
            let (at_ms, s) = (tick * 20, tick as f64 * 0.02);
            recorder.link("/tf", at_ms, "base_link", "tilt", turned((self.joint)(s), [0.0, 0.0, 0.3]));
            if self.has_odometry {
                recorder.odometry(at_ms, shifted(self.speed_m_s * s, 0.0));
            }
            if tick % 3 == 0 && tick < last {
                self.scan(&mut recorder, at_ms + 5);
            }
        }
        recorder.finish()
    }

    fn scan(&self, recorder: &mut Recorder, at_ms: i64) {
        let (first, step) = (-1.6_f64, 3.2 / (BEAMS - 1) as f64);
        let ranges: Vec<f32> = (0..BEAMS)
            .map(|k| range_m(self.world_from_laser(at_ms as f64 * 1e-3 + k as f64 * BEAM_S), first + k as f64 * step))
            .collect();
        let scan = LaserScan {
            header: Header::new(ms(at_ms), "laser"),
            angle_min: first as f32,
            angle_max: -first as f32,
            angle_increment: step as f32,
            time_increment: BEAM_S as f32,
            scan_time: 0.06,
            range_min: 0.1,
            range_max: 30.0,
            ranges: ranges[..].into(),
            intensities: ranges[..].into(),
        };
        recorder.write("/scan", "sensor_msgs/msg/LaserScan", ms(at_ms), &scan);
    }
}

/// How far the points of a cloud lie off the walls at most, metres, and how far they reach, in a robot that is at `x` then.
fn off_walls(cloud: &Cloud, x: f64) -> (f64, [f64; 3]) {
    let (mut worst, mut reach) = (0.0_f64, [0.0_f64; 3]);
    for point in &cloud.points_m {
        let there = cloud.sensor.robot_from_sensor.transform(Vector3::from(point.map(f64::from)));
        let world = [there.x + x, there.y, there.z];
        let off = (0..3).map(|k| (world[k].abs() - ROOM_M[k]).abs()).fold(f64::INFINITY, f64::min);
        worst = worst.max(off);
        (0..3).for_each(|k| reach[k] = reach[k].max(world[k].abs()));
    }
    (worst, reach)
}

/// A second to one side and a second back, by 50 degrees.
fn nods(s: f64) -> f64 {
    0.87 * (std::f64::consts::PI * s).cos()
}

#[test]
fn each_swing_of_a_laser_that_nods_is_a_cloud() {
    let drive = Drive { joint: nods, speed_m_s: 0.0, has_odometry: false };
    let path = drive.record("nods.mcap", 6.0);
    assert!(SpacePlan::is_default(&Survey::of(&path).unwrap(), &Choice::default()));
    let (clouds, notes, plan) = read(&path);
    assert_eq!((plan.robot_frame.as_str(), clouds.len()), ("base_link", 6), "{plan:?}");
    for cloud in &clouds {
        let (off, reach) = off_walls(cloud, 0.0);
        assert!(off < 0.005, "{off}");
        assert!((0..3).all(|k| (reach[k] - ROOM_M[k]).abs() < 0.005), "{reach:?}");
        // short swings keep the times of their points, so that the motion can be found with the pose
        assert_eq!((cloud.times_s.len(), cloud.intensities.len()), (cloud.points_m.len(), cloud.points_m.len()));
        assert!(cloud.times_s.iter().all(|s| (0.0..=1.5).contains(s)));
    }
    assert!(!notes.has_losses(), "{notes:?}");
    assert!(plan.reasons.iter().any(|(what, why)| *what == "motion" && why.contains("one cloud a swing")), "{plan:?}");
    assert_eq!(plan.assumed.len(), 1, "{plan:?}");
}

#[test]
fn the_motion_during_a_slow_swing_is_undone_by_odometry() {
    let nods_slowly = |s: f64| nods(0.25 * s);
    let drive = Drive { joint: nods_slowly, speed_m_s: 0.2, has_odometry: true };
    let (clouds, _, plan) = read(&drive.record("drives.mcap", 12.0));
    assert!(clouds.len() == 3 && plan.assumed.is_empty(), "{} {plan:?}", clouds.len());
    for cloud in &clouds {
        let at = cloud.odom_from_robot.unwrap().translation.x;
        let (off, reach) = off_walls(cloud, at);
        assert!(off < 0.005 && reach[2] > 1.99 && cloud.times_s.is_empty(), "{off} {reach:?}");
    }
    // without odometry it is taken to stand, and that is said
    let (clouds, _, plan) = read(&Drive { has_odometry: false, ..drive }.record("stands.mcap", 12.0));
    assert!(off_walls(&clouds[1], 1.6).0 > 0.1 && plan.assumed.iter().any(|words| words.contains("taken to stand")));
}

#[test]
fn a_laser_that_goes_round_has_seen_all_after_half_a_turn() {
    let drive = Drive { joint: |s| 1.5 * s, speed_m_s: 0.0, has_odometry: false };
    let (clouds, _, _) = read(&drive.record("round.mcap", 6.5));
    assert_eq!(clouds.len(), 4); // three half turns and a part of one
    assert!(clouds.iter().all(|cloud| off_walls(cloud, 0.0).0 < 0.005));
    assert!(clouds[..3].iter().all(|cloud| cloud.times_s.is_empty()));
}

#[test]
fn scans_without_transforms_are_counted_and_a_robot_that_sways_is_no_laser_that_tilts() {
    let drive = Drive { joint: nods, speed_m_s: 0.0, has_odometry: false };
    let mut recorder = Recorder::new("gap.mcap");
    recorder.link("/tf_static", 0, "tilt", "laser", shifted(0.1, 0.0));
    for tick in 0..400_i64 {
        let at_ms = 20 * tick;
        if !(100..300).contains(&tick) {
            recorder.link("/tf", at_ms, "base_link", "tilt", turned(nods(at_ms as f64 * 1e-3), [0.0, 0.0, 0.3]));
        }
        if tick % 3 == 0 {
            drive.scan(&mut recorder, at_ms + 5);
        }
    }
    let (clouds, notes, _) = read(&recorder.finish());
    assert!(clouds.len() >= 4 && notes.count(NoteKind::UnreadableFrame) > 20, "{} {notes:?}", clouds.len());
    assert!(notes.has_losses());
    let mut recorder = Recorder::new("sways.mcap");
    recorder.link("/tf_static", 0, "base_link", "laser", shifted(0.1, 0.0));
    for tick in 0..100_i64 {
        recorder.link(
            "/tf",
            20 * tick,
            "base_stabilized",
            "base_link",
            turned(0.5 * nods(0.02 * tick as f64), [0.0; 3]),
        );
        recorder.scan(20 * tick);
    }
    let survey = Survey::of(&recorder.finish()).unwrap();
    assert!(!SpacePlan::is_default(&survey, &Choice::default()));
    let refused = Plan::of(&survey, &Choice::default()).unwrap_err();
    assert!(refused.contains("tilts during the log"), "{refused}");
}
