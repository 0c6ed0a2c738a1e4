use super::*;
use crate::gate::GateSettings;
use crate::tally::Reason;
use mapwright::{Jobs, Settings};
use mapwright_geom::{Pose2, Pose3, Stamp};
use mapwright_ros::encode;
use mapwright_ros::messages::{Header, TransformStamped};
use mapwright_sim::{Drive, DriveSettings, Event, worlds};
use nalgebra::{UnitQuaternion, Vector3};

/// Where stamps begin: one of zero is none.
const BEGIN: i64 = 1_000_000_000_000;

fn link(parent: &str, child: &str, stamp: Stamp, pose: Pose2) -> Vec<u8> {
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), pose.theta);
    let pose = Pose3 { translation: Vector3::new(pose.x, pose.y, 0.0), rotation };
    let header = Header::new(stamp, parent);
    let transform = TransformStamped { header, child_frame_id: child.into(), transform: pose.into() };
    encode(&TfMessage { transforms: vec![transform] }, Encoding::Cdr).unwrap()
}

/// What a robot hears on its way, with the scans that it has at the end: the transforms that belong to one come after it.
fn heard(seconds: f64) -> Vec<Heard> {
    let settings = DriveSettings { duration_s: seconds, ..DriveSettings::default() };
    let drive = Drive::new(worlds::loop_of(1, 60.0).into(), settings);
    let mut all = Vec::new();
    for event in drive {
        match event {
            Event::Odometry(odometry) => {
                let stamp = Stamp(odometry.stamp.0 + BEGIN);
                let bytes = link("odom", "base_link", stamp, odometry.odom_from_robot);
                all.push(Heard::Transforms { bytes, is_static: false });
            }
            Event::Scan(scan) => {
                let scan = scan.scan;
                if all.len() < 3 {
                    let mount = scan.laser.robot_from_laser;
                    let bytes = link("base_link", "laser", Stamp(BEGIN), mount);
                    all.push(Heard::Transforms { bytes, is_static: true });
                }
                let message = LaserScan {
                    header: Header::new(Stamp(scan.stamp.0 + BEGIN), "laser"),
                    angle_min: scan.laser.angle_min_rad as f32,
                    angle_max: (scan.laser.angle_min_rad + (scan.ranges_m.len() - 1) as f64 * scan.laser.angle_step_rad)
                        as f32,
                    angle_increment: scan.laser.angle_step_rad as f32,
                    range_min: scan.laser.range_min_m as f32,
                    range_max: scan.laser.range_max_m as f32,
                    ranges: scan.ranges_m[..].into(),
                    ..Default::default()
                };
                let bytes = encode(&message, Encoding::Cdr).unwrap();
                all.push(Heard::Scan { topic: "/scan".to_owned(), bytes });
            }
        }
    }
    all
}

fn mapper() -> Mapper {
    let mut settings = Settings::default();
    settings.loops.jobs = Jobs::HandedOut;
    Mapper::new(settings).unwrap()
}

fn arrived(k: usize) -> Arrived {
    Arrived { since_start: Duration::from_millis(k as u64), stamp: Stamp(BEGIN) }
}

/// Nothing waits for long in a test.
fn soon() -> Duration {
    Duration::from_millis(1)
}

fn poses(mapper: &Mapper) -> Vec<(Stamp, Pose2)> {
    mapper.trajectory().map(|at| (at.stamp, at.map_from_robot)).collect()
}

#[test]
fn a_drive_through_the_door_is_mapped_as_one_that_is_handed_to_the_mapper() {
    let all = heard(30.0);
    let (mut ears, mut gate, mut alone) = (Ears::new().unwrap(), Gate::new(GateSettings::default()), mapper());
    for (k, heard) in all.iter().enumerate() {
        ears.hear(heard, arrived(k), &mut gate).unwrap();
        while let Some(passed) = gate.next(arrived(k).since_start) {
            take_in(passed, &mut alone, &mut |_, _| ());
        }
    }
    while let Some(passed) = gate.next(Duration::MAX) {
        take_in(passed, &mut alone, &mut |_, _| ());
    }
    let door = Door::new(&[100_000, 100_000]);
    let (mut gate, mut threaded) = (Gate::new(GateSettings::default()), mapper());
    let mut scans = 0;
    thread::scope(|scope| {
        scope.spawn(|| {
            for (k, heard) in all.iter().enumerate() {
                let lane = usize::from(!matches!(heard, Heard::Scan { .. }));
                assert!(door.put(lane, (arrived(k), heard.clone())));
            }
            door.close();
        });
        let mut tell = |told: Told<'_>, _: &Mapper| match told {
            Told::Update(_) => scans += 1,
            Told::Refused(error) => panic!("{error}"),
        };
        map(&door, &soon, &mut gate, &mut threaded, &mut tell).unwrap();
    });
    let sent = all.iter().filter(|heard| matches!(heard, Heard::Scan { .. })).count();
    let tally = gate.tallies().next().unwrap().1;
    assert!(
        sent > 250 && scans >= sent && tally.used() == sent as u64 && tally.waiting() == 0,
        "{sent} {scans} {tally}"
    );
    assert_eq!(poses(&threaded), poses(&alone));
}

#[test]
fn jobs_are_done_beside_the_mapper_and_come_back() {
    let door = Door::new(&[100_000, 100_000]);
    for (k, heard) in heard(150.0).into_iter().enumerate() {
        door.put(usize::from(!matches!(heard, Heard::Scan { .. })), (arrived(k), heard));
    }
    door.close();
    let (mut gate, mut mapper) = (Gate::new(GateSettings::default()), mapper());
    map(&door, &soon, &mut gate, &mut mapper, &mut |_, _| ()).unwrap();
    let looked_at = mapper.candidates().len();
    assert!(looked_at > 0 && mapper.next_job().is_none(), "{looked_at} old places looked at, none left over");
}

#[test]
fn bytes_that_are_no_messages_are_counted_and_told() {
    let door = Door::new(&[10, 10]);
    let torn = heard(1.0).into_iter().find_map(|heard| match heard {
        Heard::Scan { topic, bytes } => Some(Heard::Scan { topic, bytes: bytes[..bytes.len() / 2].to_vec() }),
        _ => None,
    });
    door.put(0, (arrived(0), torn.unwrap()));
    door.put(0, (arrived(1), Heard::Overtaken { topic: "/scan".to_owned(), count: 7 }));
    door.put(1, (arrived(2), Heard::Transforms { bytes: vec![0, 1, 0, 0, 255, 255, 255, 255], is_static: false }));
    door.put(1, (arrived(3), Heard::Odometry { bytes: Vec::new() }));
    door.close();
    let (mut gate, mut mapper, mut refused) = (Gate::new(GateSettings::default()), mapper(), Vec::new());
    let mut tell = |told: Told<'_>, _: &Mapper| match told {
        Told::Refused(error) => refused.push(error.to_string()),
        Told::Update(update) => panic!("{update:?}"),
    };
    map(&door, &soon, &mut gate, &mut mapper, &mut tell).unwrap();
    let tally = gate.tallies().next().unwrap().1;
    assert_eq!(refused.len(), 2, "{refused:?}");
    assert_eq!(
        (tally.arrived(), tally.dropped_for(Reason::Unreadable), tally.dropped_for(Reason::Overtaken)),
        (8, 1, 7)
    );
    let words = gate.missing(Duration::from_secs(1)).join("; ");
    assert!(words.contains("expected") && words.contains("found"), "what is wrong with it and where: {words}");
}
