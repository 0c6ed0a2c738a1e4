//! Several runs in one map: one after the other, mapped apart and brought together, and a robot that is only located.
#![allow(clippy::expect_used, clippy::print_stdout, reason = "a test may fail loudly and show what it measured")]

use crate::support;

use mapwright::{
    Adoption, Entry, FragmentStart, Localisation, Mapper, Pose2, RunId, Session, Settings, Stamp, Status, Update,
    Withdrawal, groups,
};
use mapwright_sim::worlds::{Relocalisation, TwiceTheSame, relocalisation};
use mapwright_sim::{DriveSettings, TrueScan, worlds};
use std::collections::BTreeMap;
use support::{in_parallel, mapper, recording};

/// A pose that is farther off is wrong, metres and radians.
const RIGHT_M: f64 = 0.2;
const RIGHT_RAD: f64 = 0.05;
/// Where a robot's odometry may have its origin.
const ELSEWHERE: Pose2 = Pose2 { x: 30.0, y: -12.0, theta: 2.0 };

/// A drive through an office from a waypoint on, whose odometry has its origin anywhere; it begins so late.
fn drive(office: u64, waypoint: usize, late_s: i64) -> Vec<TrueScan> {
    let settings = DriveSettings {
        start_waypoint: waypoint,
        duration_s: 150.0,
        seed: waypoint as u64,
        ..DriveSettings::default()
    };
    let mut scans = recording(worlds::office_floor(office), settings);
    for scan in &mut scans {
        scan.scan.stamp = Stamp(scan.scan.stamp.0 + late_s * 1_000_000_000);
        scan.scan.odom_from_robot = scan.scan.odom_from_robot.map(|pose| ELSEWHERE * pose);
    }
    scans
}

fn map(scans: &[TrueScan]) -> Mapper {
    let mut mapper = mapper();
    scans.iter().for_each(|scan| drop(mapper.add_scan(&scan.scan)));
    mapper
}

/// True poses by stamp.
fn truths(drives: &[&[TrueScan]]) -> BTreeMap<i64, Pose2> {
    drives.iter().flat_map(|scans| scans.iter()).map(|scan| (scan.scan.stamp.0, scan.world_from_robot)).collect()
}

/// Keyframes that are wrong relative to the first one.
fn misplaced(session: &Session, truths: &BTreeMap<i64, Pose2>) -> usize {
    let truth = |at: usize| truths[&session.keyframes()[at].stamp.0];
    let poses = session.map_from_keyframe();
    let is_wrong = |&at: &usize| {
        let error = truth(0).between(truth(at)).between(poses[0].between(poses[at]));
        error.x.hypot(error.y) > RIGHT_M || error.theta.abs() > RIGHT_RAD
    };
    (0..poses.len()).filter(is_wrong).count()
}

fn starts(session: &Session) -> Vec<FragmentStart> {
    session.fragments().iter().map(|fragment| fragment.start).collect()
}

fn replayed(updates: Vec<Update>) -> Session {
    let mut session = Session::default();
    session.add_all(updates.into_iter().flat_map(|update| update.entries)).expect("what fits");
    session
}

#[test]
fn a_robot_that_is_switched_on_elsewhere_goes_on_with_the_map() {
    let joined = in_parallel(2, |k| {
        let (first, second) = (drive(3 + k as u64, 0, 0), drive(3 + k as u64, 4, 500));
        let mut mapper = map(&first);
        mapper.checkpoint();
        let mut mapper = Mapper::resume(Settings::default(), mapper.session().clone()).expect("valid");
        let robot = RunId::of_robot("another robot");
        let mut updates = vec![mapper.switch_on(robot)];
        updates.extend(second.iter().map(|scan| mapper.add_scan(&scan.scan)));
        let session = mapper.session();
        assert_eq!(starts(session), [FragmentStart::SwitchedOn; 2]);
        let runs: Vec<RunId> = session.runs().map(|run| run.id).collect();
        assert_eq!(runs.last(), Some(&robot));
        assert_eq!(session.keyframes().last().map(|keyframe| keyframe.id.run()), Some(robot));
        assert_eq!(updates[1].localisation, Localisation::Apart);
        let apart = updates.iter().filter(|update| update.localisation == Localisation::Apart).count();
        let wrong = misplaced(session, &truths(&[&first, &second]));
        println!("{apart} scans apart, {wrong} of {} keyframes misplaced", session.keyframes().len());
        (session.pieces().len(), wrong, updates.last().map(|update| update.localisation))
    });
    assert_eq!(joined, [(1, 0, Some(Localisation::Joined)); 2]);
}

#[test]
fn sessions_that_were_mapped_apart_become_one_map() {
    let joined = in_parallel(2, |k| {
        let office = 3 + k as u64;
        let (first, second) = (drive(office, 0, 0), drive(office, 4, 500));
        let (first_map, second_map) = (map(&first), map(&second));
        let mut mapper = Mapper::resume(Settings::default(), first_map.session().clone()).expect("valid");
        let mut updates = Vec::new();
        let told: Result<(), ()> = mapper.import(second_map.session(), |update| {
            updates.push(update);
            Ok(())
        });
        let session = mapper.session();
        let (one, other) = (first_map.session(), second_map.session());
        assert!(told.is_ok() && updates.len() == other.keyframes().len() + 1);
        assert!(session.shares_keyframes(other) && !one.shares_keyframes(other));
        // All is there, under a name of its own, and the updates say all of it.
        assert_eq!(session.scans().len(), first.len() + second.len());
        assert_eq!(session.keyframes().len(), one.keyframes().len() + other.keyframes().len());
        let runs: Vec<u32> = session.runs().map(|run| run.id.session).collect();
        assert_eq!(runs, [0, 1, 2]);
        let mut read = one.clone();
        let of_runs = Entry::Run(session.runs().nth(1).expect("the run that goes on").clone());
        read.add(of_runs).expect("it goes on");
        let entries: Vec<Entry> = updates.into_iter().flat_map(|update| update.entries).collect();
        read.add_all(entries.into_iter().filter(|entry| !matches!(entry, Entry::Run(run) if run.id.session == 1)))
            .expect("what fits");
        assert_eq!(&read, session);
        let wrong = misplaced(session, &truths(&[&first, &second]));
        println!("{wrong} of {} keyframes misplaced", session.keyframes().len());
        (session.pieces().len(), wrong)
    });
    assert_eq!(joined, [(1, 0); 2]);
}

/// Robots that drive at the same time, whose mappers tell what they have found every so many scans.
#[test]
fn robots_that_take_turns_have_one_map() {
    let drives = [drive(3, 0, 0), drive(3, 4, 0)];
    let mut robots = [0, 1].map(|k| {
        let run = RunId::of_robot(&format!("robot {k}"));
        (Mapper::of_run(Settings::default(), run, Pose2::IDENTITY).expect("valid"), Adoption::default())
    });
    let mut team = Mapper::of_run(Settings::default(), RunId::of_robot("all"), Pose2::IDENTITY).expect("valid");
    let mut updates = vec![team.news()];
    let scans = drives.iter().map(Vec::len).max().unwrap_or(0);
    for first in (0..scans).step_by(40) {
        for ((mapper, adoption), drive) in robots.iter_mut().zip(&drives) {
            let part = drive.iter().skip(first).take(40);
            let told: Vec<Entry> = part.flat_map(|scan| mapper.add_scan(&scan.scan).entries).collect();
            for group in groups(&told) {
                let adopted = team.adopt(group, adoption);
                assert_eq!(adopted.refused, 0);
                updates.push(adopted.update);
            }
        }
    }
    let session = team.session();
    assert_eq!(replayed(updates), *session);
    let (read, report) = Session::read(&session.encode()).expect("a session");
    assert!(report.is_whole() && &read == session);
    // Each keeps its names and its way, and what both have mapped is one map, as right as one robot's.
    for (mapper, _) in &robots {
        let mut way = Vec::new();
        for keyframe in mapper.keyframes() {
            way.push(session.place(keyframe.id).expect("it is there"));
        }
        assert!(
            way.windows(2)
                .all(|pair| session.before(pair[1]) == Some(pair[0]) && session.after(pair[0]) == Some(pair[1]))
        );
    }
    let kept: usize = robots.iter().map(|(mapper, _)| mapper.keyframes().len()).sum();
    let truth = |keyframe: &mapwright::Keyframe| {
        let robot = robots.iter().position(|(mapper, _)| mapper.session().place(keyframe.id).is_some()).expect("whose");
        let own = robots[robot].0.session().place(keyframe.id).expect("there");
        drives[robot][robots[robot].0.keyframes()[own].scan as usize].world_from_robot
    };
    let (keyframes, poses) = (session.keyframes(), session.map_from_keyframe());
    let is_wrong = |at: &usize| {
        let error = truth(&keyframes[0]).between(truth(&keyframes[*at])).between(poses[0].between(poses[*at]));
        error.x.hypot(error.y) > RIGHT_M || error.theta.abs() > RIGHT_RAD
    };
    let wrong = (0..poses.len()).filter(is_wrong).count();
    assert_eq!((keyframes.len(), session.pieces().len(), wrong), (kept, 1, 0));
}

#[test]
fn what_does_not_belong_together_stays_apart() {
    let (first, second) = (drive(3, 0, 0), drive(11, 2, 500));
    let mut updates = Vec::new();
    let mut mapper = mapper();
    updates.extend(first.iter().map(|scan| mapper.add_scan(&scan.scan)));
    updates.push(mapper.switch_on(RunId::of_robot("robot")));
    updates.extend(second.iter().map(|scan| mapper.add_scan(&scan.scan)));
    let pieces = mapper.session().pieces();
    assert_eq!(pieces.len(), 2);
    assert_eq!(pieces.iter().map(|piece| piece.keyframes).sum::<usize>(), mapper.keyframes().len());
    assert_eq!(mapper.session().runs().map(|run| run.id.session).collect::<Vec<_>>(), [0, 1]);
    assert_eq!(replayed(updates), *mapper.session());
}

/// Of a robot that was switched on nothing has been seen yet: a run that goes on there knows that too.
#[test]
fn it_may_be_anywhere_after_a_stop_as_well() {
    let (first, second) = (drive(3, 0, 0), drive(3, 4, 500));
    let mut mapper = map(&first[..600]);
    mapper.switch_on(RunId::of_robot("robot"));
    mapper.checkpoint();
    let mut resumed = Mapper::resume(Settings::default(), mapper.session().clone()).expect("valid");
    for scan in &second[..200] {
        let (one, other) = (mapper.add_scan(&scan.scan), resumed.add_scan(&scan.scan));
        assert_eq!((one.map_from_robot, one.localisation), (other.map_from_robot, other.localisation));
    }
    assert_eq!(starts(resumed.session()), [FragmentStart::SwitchedOn; 2]);
}

#[test]
fn a_robot_is_located_in_a_map_that_stays_as_it_is() {
    let (first, second) = (drive(3, 0, 0), drive(3, 4, 500));
    let map = map(&first);
    let before = map.session().map_from_keyframe().to_vec();
    let mut mapper = Mapper::localising(Settings::default(), map.session().clone()).expect("valid");
    let world_from_map =
        first[0].world_from_robot * map.session().trajectory().next().expect("a scan").map_from_robot.inverse();
    let (mut located, mut wrong) = (0, 0);
    for scan in &second {
        let update = mapper.add_scan(&scan.scan);
        assert!(mapper.keyframe_poses()[..before.len()] == before, "the map has moved");
        if update.localisation == Localisation::Joined && update.status != Status::Lost {
            let error = scan.world_from_robot.between(world_from_map * update.map_from_robot);
            located += 1;
            wrong += usize::from(error.x.hypot(error.y) > RIGHT_M || error.theta.abs() > RIGHT_RAD);
        }
    }
    println!("{located} of {} scans located, {wrong} wrongly", second.len());
    assert!(located * 2 > second.len() && wrong == 0);
}

/// What was said of the scans of a later drive in the map of a first one.
#[derive(Debug, Default)]
struct Said {
    /// The first scan that was located.
    first: Option<usize>,
    located: usize,
    wrong: usize,
    /// The longest stretch of scans that were located wrongly.
    wrong_at_a_stretch: usize,
    taken_back: Vec<Withdrawal>,
    /// Whether the last scan is located, and rightly.
    is_found: bool,
}

/// Locates the later drive in the map of so many scans of the first.
fn located(case: &Relocalisation, mapped: usize) -> Said {
    let first: Vec<TrueScan> = case.mapping_drive().scans().take(mapped).collect();
    let map = map(&first);
    let begin = map.session().trajectory().next().expect("a scan").map_from_robot;
    let world_from_map = first[0].world_from_robot * begin.inverse();
    let mut mapper = Mapper::localising(Settings::default(), map.session().clone()).expect("valid");
    let (mut said, mut stretch) = (Said::default(), 0);
    for (number, scan) in case.later_drive().scans().enumerate() {
        let update = mapper.add_scan(&scan.scan);
        said.taken_back.extend(mapper.withdrawal());
        let error = scan.world_from_robot.between(world_from_map * update.map_from_robot);
        let is_right = error.x.hypot(error.y) <= 2.0 * RIGHT_M && error.theta.abs() <= 2.0 * RIGHT_RAD;
        let is_located = update.localisation == Localisation::Joined && update.status != Status::Lost;
        said.is_found = is_located && is_right;
        stretch = if is_located && !is_right { stretch + 1 } else { 0 };
        said.wrong_at_a_stretch = said.wrong_at_a_stretch.max(stretch);
        if is_located {
            said.first.get_or_insert(number);
            said.located += 1;
            said.wrong += usize::from(!is_right);
        }
    }
    println!("{:?}: {said:?}", case.twice);
    said
}

#[test]
fn where_two_ends_of_a_room_look_alike_the_robot_is_located_once_it_has_left() {
    let said = in_parallel(2, |k| {
        let case = relocalisation(6 * k as u64);
        assert_eq!(case.twice, TwiceTheSame::EndsOfRoom);
        located(&case, usize::MAX)
    });
    for said in said {
        assert!(said.is_found && said.wrong == 0, "{said:?}");
        // It begins by driving to the other end and back, where nothing tells them apart.
        assert!(said.first.is_some_and(|first| first > 100), "{said:?}");
    }
}
