//! Closing loops as jobs: done at once or by a worker, and replayed.
#![allow(clippy::expect_used, reason = "a test may fail loudly")]

use crate::support;

use mapwright::{Candidate, Detection, Edge, EdgeKind, JobResult, Jobs, Mapper, Pose2, Session, Settings, Verdict};
use mapwright_sim::{DriveSettings, TrueScan, kidnapping, worlds};
use std::collections::VecDeque;
use std::thread;
use support::recording;

fn drive() -> Vec<TrueScan> {
    recording(worlds::loop_of(3, 150.0), DriveSettings::long_drive(3))
}

fn mapper(jobs: Jobs) -> Mapper {
    let mut settings = Settings::default();
    settings.loops.jobs = jobs;
    Mapper::new(settings).expect("valid")
}

/// All that lasts of a run, to the bit.
fn bytes(mapper: &Mapper) -> Vec<u8> {
    let numbers = mapper.trajectory().flat_map(|pose| {
        let pose = pose.map_from_robot;
        [pose.x, pose.y, pose.theta]
    });
    let edges = mapper.edges().flat_map(|edge: &Edge| {
        let pose = edge.from_from_to;
        [f64::from(edge.from.seq), f64::from(edge.to.seq), pose.x, pose.y, pose.theta]
    });
    let mut bytes: Vec<u8> = numbers.chain(edges).flat_map(f64::to_le_bytes).collect();
    bytes.extend(mapper.render().to_bytes());
    bytes
}

fn closures(mapper: &Mapper) -> usize {
    mapper.edges().filter(|edge| edge.kind == EdgeKind::Closure).count()
}

/// A live run: results come `late` scans after their job went out; when each came is written down.
fn live(scans: &[TrueScan], late: impl Fn(usize) -> usize, in_threads: bool) -> (Mapper, Vec<usize>) {
    let mut mapper = mapper(Jobs::HandedOut);
    let mut out: VecDeque<(usize, thread::JoinHandle<JobResult>)> = VecDeque::new();
    let mut came = Vec::new();
    for (number, scan) in scans.iter().enumerate() {
        while out.front().is_some_and(|(due, _)| *due <= number) {
            let (_, worker) = out.pop_front().expect("there is one");
            mapper.apply(worker.join().expect("jobs do not panic"));
            came.push(number);
        }
        mapper.add_scan(&scan.scan);
        while let Some(job) = mapper.next_job() {
            let worker = thread::spawn(|| job.run());
            let due = number + 1 + late(out.len() + came.len());
            if in_threads {
                out.push_back((due, worker));
            } else {
                let result = worker.join().expect("jobs do not panic");
                out.push_back((due, thread::spawn(|| result)));
            }
        }
    }
    (mapper, came)
}

#[test]
fn a_live_run_is_replayed_to_the_same_bytes() {
    let scans = drive();
    let late = |job: usize| 1 + job * 7 % 23;
    let (first, came) = live(&scans, late, true);
    assert!(closures(&first) > 0 && came.len() > 3, "{} closures, {} results", closures(&first), came.len());
    let (again, came_again) = live(&scans, late, false);
    assert_eq!(came, came_again);
    assert!(bytes(&first) == bytes(&again));
    let noted: Vec<usize> = first.session().results_taken_in().iter().map(|scan| *scan as usize).collect();
    assert_eq!(noted, came, "its session says when each came");
}

#[test]
fn results_that_come_late_close_the_loop_all_the_same() {
    let scans = drive();
    let truth: Vec<_> = scans.iter().map(|scan| scan.world_from_robot).collect();
    let mut inline = mapper(Jobs::Inline);
    scans.iter().for_each(|scan| {
        inline.add_scan(&scan.scan);
    });
    let inline_m = support::ate_m(&inline, &truth);
    for late in [1, 10, 50] {
        let (mapper, _) = live(&scans, |_| late, true);
        let error_m = support::ate_m(&mapper, &truth);
        assert!(closures(&mapper) > 0);
        assert!(error_m < 1.5 * inline_m + 0.02, "{late} scans late: {error_m} m, at once {inline_m} m");
    }
}

#[test]
fn a_robot_that_was_carried_away_comes_home_by_jobs() {
    let case = kidnapping(902);
    let lasts = |scan: &TrueScan| scan.scan.stamp.secs_since(case.put_down) < 45.0;
    let scans: Vec<TrueScan> = case.drive().scans().take_while(lasts).collect();
    let late = |job: usize| 1 + job * 3 % 7;
    let (first, came) = live(&scans, late, true);
    let is_arrival = |c: &&Candidate| c.detection == Detection::Place && c.verdict == Verdict::Accepted;
    let home = first.candidates().iter().rfind(is_arrival).expect("it came home");
    assert!(home.evidence.agreeing >= 2 && home.from.seq < home.to.seq, "{home:?}");
    let (again, came_again) = live(&scans, late, false);
    assert_eq!(came, came_again);
    assert!(bytes(&first) == bytes(&again));
}

#[test]
fn results_of_another_run_are_left_out() {
    let scans = drive();
    let mut donor = mapper(Jobs::HandedOut);
    let mut results = Vec::new();
    for scan in &scans {
        donor.add_scan(&scan.scan);
        while let Some(job) = donor.next_job() {
            let result = job.run();
            results.push(result.clone());
            donor.apply(result);
        }
    }
    assert!(!results.is_empty());
    let mut young = mapper(Jobs::HandedOut);
    for result in &results {
        young.apply(result.clone());
    }
    scans[..50].iter().for_each(|scan| {
        young.add_scan(&scan.scan);
    });
    for result in results {
        young.apply(result);
    }
    let mut alone = mapper(Jobs::HandedOut);
    scans[..50].iter().for_each(|scan| {
        alone.add_scan(&scan.scan);
    });
    assert!(bytes(&young) == bytes(&alone));
}

/// Nobody has done the jobs while it drove, so that the map is drawn over itself where it comes back; what has changed is told.
#[test]
fn old_places_are_looked_for_anew_when_no_more_scans_come() {
    let scans = drive();
    let truth: Vec<Pose2> = scans.iter().map(|scan| scan.world_from_robot).collect();
    let (mut mapper, mut told) = (mapper(Jobs::HandedOut), Session::default());
    let mut waiting = 0;
    for scan in &scans {
        let update = mapper.add_scan(&scan.scan);
        waiting = update.waiting_keyframes;
        told.add_all(update.entries).expect("entries fit to those before");
    }
    assert!(waiting > 20, "that nobody fetches them is said: {waiting}");
    // By how much its end lies off, seen from its beginning.
    let off_m = |mapper: &Mapper| {
        let poses: Vec<Pose2> = mapper.trajectory().map(|pose| pose.map_from_robot).collect();
        let [found, true_one] = [&poses, &truth].map(|poses| poses[0].between(poses[poses.len() - 1]));
        found.distance(true_one)
    };
    let (open, before_m) = (closures(&mapper), off_m(&mapper));
    let update = mapper.look_again();
    assert_eq!(update.waiting_keyframes, 0);
    told.add_all(update.entries).expect("entries fit to those before");
    let (closed, after_m) = (closures(&mapper), off_m(&mapper));
    assert!(open == 0 && closed > 0 && after_m < 0.3 * before_m, "{open}, {closed}: {before_m}, {after_m} m");
    assert!(told.encode() == mapper.session().encode());
    // Nothing is left to be found.
    mapper.look_again();
    assert_eq!((closures(&mapper), off_m(&mapper)), (closed, after_m));
}
