#[allow(clippy::expect_used, reason = "of a test")]
mod robot;

use super::*;
use crate::gate::GateSettings;
use crate::tally::Reason;
use mapwright::{Jobs, Settings};
use mapwright_geom::{Pose2, Stamp};
use mapwright_sim::DriveSettings;
use robot::{BEGIN, lane};

fn heard(seconds: f64) -> Vec<Heard> {
    let settings = DriveSettings { duration_s: seconds, ..DriveSettings::default() };
    robot::heard(settings).into_iter().map(|(_, heard)| heard).collect()
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
                assert!(door.put(lane(heard), (arrived(k), heard.clone())));
            }
            door.close();
        });
        let mut tell = |told: Told<'_>, _: &Mapper| match told {
            Told::Update(_) => scans += 1,
            Told::Refused(error) => panic!("{error}"),
        };
        map(&door, &soon, &mut gate, &mut threaded, &mut tell).unwrap();
    });
    let sent = all.iter().filter(|heard| lane(heard) == 0).count();
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
        door.put(lane(&heard), (arrived(k), heard));
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
