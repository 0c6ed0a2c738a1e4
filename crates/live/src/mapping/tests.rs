#[allow(clippy::expect_used, reason = "of a test")]
mod robot;

use super::*;
use crate::gate::GateSettings;
use crate::tally::Reason;
use mapwright::{Jobs, Mapper, Settings, Update};
use mapwright_geom::{Pose2, Stamp};
use mapwright_sensor::TurnRate;
use mapwright_sim::DriveSettings;
use robot::{BEGIN, Driven, lane};
use std::sync::Arc;

fn heard(seconds: f64) -> Vec<Heard> {
    let settings = DriveSettings { duration_s: seconds, ..DriveSettings::default() };
    robot::heard(settings, Pose2::IDENTITY).into_iter().map(|(_, heard)| heard).collect()
}

fn mapper() -> Mapper {
    let mut settings = Settings::default();
    settings.loops.jobs = Jobs::HandedOut;
    Mapper::new(settings).unwrap()
}

fn arrived(k: usize) -> Arrived {
    Arrived { since_start: Duration::from_millis(k as u64), stamp: BEGIN }
}

/// Nothing waits for long in a test.
fn soon() -> Duration {
    Duration::from_millis(1)
}

fn poses(mapper: &Mapper) -> Vec<(Stamp, Pose2)> {
    mapper.trajectory().map(|at| (at.stamp, at.map_from_robot)).collect()
}

fn take_in(gate: &mut Gate, now: Duration, driven: &mut dyn Driver<Maps = mapwright_sensor::Sweep>) {
    while let Some(passed) = gate.next(now) {
        driven.add(&passed, gate);
    }
}

#[test]
fn a_drive_through_the_door_is_mapped_as_one_that_is_handed_to_the_mapper() {
    let (mut ears, mut gate) = (Ears::new().unwrap(), Gate::new(GateSettings::default()));
    let mut alone = Driven::new(mapper(), |_: &Update| ());
    for (k, heard) in heard(30.0).into_iter().enumerate() {
        ears.hear(heard, arrived(k), &mut gate).unwrap();
        take_in(&mut gate, arrived(k).since_start, &mut alone);
    }
    take_in(&mut gate, Duration::MAX, &mut alone);
    let all = heard(30.0);
    let sent = all.iter().filter(|heard| lane(heard) == 0).count();
    let door = Door::new(&[100_000, 100_000]);
    let mut gate = Gate::new(GateSettings::default());
    let mut scans = 0;
    let mut threaded = Driven::new(mapper(), |_: &Update| scans += 1);
    thread::scope(|scope| {
        scope.spawn(|| {
            for (k, heard) in all.into_iter().enumerate() {
                assert!(door.put(lane(&heard), (arrived(k), heard)));
            }
            door.close();
        });
        map(&door, &soon, &mut gate, &mut threaded).unwrap();
    });
    assert_eq!((poses(&threaded.mapper), threaded.refused), (poses(&alone.mapper), Vec::new()));
    let tally = gate.tallies().next().unwrap().1;
    assert!(
        sent > 250 && scans >= sent && tally.used() == sent as u64 && tally.waiting() == 0,
        "{sent} {scans} {tally}"
    );
}

#[test]
fn jobs_are_done_beside_the_mapper_and_come_back() {
    let door = Door::new(&[100_000, 100_000]);
    for (k, heard) in heard(150.0).into_iter().enumerate() {
        door.put(lane(&heard), (arrived(k), heard));
    }
    door.close();
    let mut driven = Driven::new(mapper(), |_: &Update| ());
    map(&door, &soon, &mut Gate::new(GateSettings::default()), &mut driven).unwrap();
    let looked_at = driven.mapper.candidates().len();
    assert!(looked_at > 0 && driven.mapper.next_job().is_none(), "{looked_at} old places looked at, none left over");
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
    let mut gate = Gate::new(GateSettings::default());
    let mut driven = Driven::new(mapper(), |update: &Update| panic!("{update:?}"));
    map(&door, &soon, &mut gate, &mut driven).unwrap();
    let tally = gate.tallies().next().unwrap().1;
    assert_eq!(driven.refused.len(), 2, "{:?}", driven.refused);
    assert_eq!(
        (tally.arrived(), tally.dropped_for(Reason::Unreadable), tally.dropped_for(Reason::Overtaken)),
        (8, 1, 7)
    );
    let words = gate.missing(Duration::from_secs(1)).join("; ");
    assert!(words.contains("expected") && words.contains("found"), "what is wrong with it and where: {words}");
}

#[test]
fn whole_scans_wait_for_nothing_and_what_is_asked_is_asked_in_its_turn() {
    struct Listener(Vec<String>);
    impl Driver for Listener {
        type Maps = mapwright_sensor::Sweep;
        fn add(&mut self, passed: &Passed, _gate: &Gate) {
            self.0.push(match passed {
                Passed::Reading(reading) => format!("{reading:?}"),
                Passed::Scan(scan) => format!("scan {}", scan.stamp.0),
                Passed::Cloud(cloud) => format!("cloud {}", cloud.stamp.0),
            });
        }
        fn next_job(&mut self) -> Option<Job> {
            None
        }
        fn apply(&mut self, _result: JobResult) {}
        fn refused(&mut self, error: &RosError) {
            panic!("{error}");
        }
        fn asked(&mut self, what: Asked) {
            self.0.push(what.downcast_ref::<&str>().unwrap().to_string());
        }
    }
    let door = Door::new(&[10, 10]);
    let laser = Arc::new(mapwright_sensor::LaserModel::half_circle("laser", 3));
    let whole = |nanoseconds: i64| {
        let (stamp, laser) = (Stamp(nanoseconds), Arc::clone(&laser));
        let scan = Box::new(LaserScan { stamp, laser, ranges_m: vec![1.0; 3], odom_from_robot: None });
        Heard::Whole { topic: "/cable".to_owned(), scan }
    };
    door.put(0, (arrived(0), whole(10)));
    door.put(1, (arrived(1), Heard::Reading(Reading::Turning(TurnRate { stamp: Stamp(20), rad_per_s: 0.5 }))));
    door.put(1, (arrived(2), Heard::Asked(Box::new("pause"))));
    door.put(0, (arrived(3), whole(30)));
    door.put(0, (arrived(4), whole(30)));
    door.close();
    let (mut gate, mut listener) = (Gate::new(GateSettings::default()), Listener(Vec::new()));
    map(&door, &soon, &mut gate, &mut listener).unwrap();
    assert_eq!(listener.0, ["scan 10", "Turning(TurnRate { stamp: Stamp(20), rad_per_s: 0.5 })", "pause", "scan 30"]);
    let tally = gate.tallies().next().unwrap().1;
    assert_eq!((tally.arrived(), tally.used(), tally.dropped_for(Reason::Late)), (3, 2, 1), "{tally}");
}
