//! What updates tell is all that lasts: their entries are the session, and the log of it.
#![allow(clippy::expect_used, clippy::print_stdout, reason = "a test may fail loudly and show what it measured")]

use crate::support;

use mapwright::{
    Beams, EdgeKind, Entry, JobResult, Jobs, KeyframeId, LeftOutReason, Localisation, Mapper, Pose2, RunId, Session,
    Settings, Sweep, Update,
};
use mapwright_record::LogWriter;
use mapwright_sensor::BEAM_DROPPED;
use mapwright_sim::{DriveSettings, TrueScan, kidnapping, worlds};
use std::collections::VecDeque;
use support::recording;

const RUN: RunId = RunId { robot: 0xfeed_0000_0000_0000_0000_0000_0000_beef, session: 3 };
/// Results of jobs that are handed out come so many scans later.
const LATE: usize = 10;

fn settings(jobs: Jobs) -> Settings {
    let mut settings = Settings::default();
    settings.loops.jobs = jobs;
    settings
}

/// Maps a recording as one run; every update there was, those of results of jobs among them.
fn mapped(settings: Settings, scans: &[TrueScan]) -> (Mapper, Vec<Update>) {
    let mut mapper = Mapper::of_run(settings, RUN, Pose2::new(3.0, -2.0, 0.7)).expect("valid");
    let mut results: VecDeque<(usize, JobResult)> = VecDeque::new();
    let mut updates = Vec::new();
    for (number, scan) in scans.iter().enumerate() {
        while let Some((_, result)) = results.pop_front_if(|(due, _)| *due <= number) {
            updates.push(mapper.apply(result));
        }
        updates.push(mapper.add_scan(&scan.scan));
        while let Some(job) = mapper.next_job() {
            results.push_back((number + LATE, job.run()));
        }
    }
    (mapper, updates)
}

/// An office, long enough for loops to be closed.
fn office() -> Vec<TrueScan> {
    recording(worlds::office_floor(900), DriveSettings::long_drive(900))
}

/// A robot that is carried away, until a while after what it maps was joined.
fn carried() -> Vec<TrueScan> {
    let case = kidnapping(902);
    let lasts = |scan: &TrueScan| scan.scan.stamp.secs_since(case.put_down) < 45.0;
    case.drive().scans().take_while(lasts).collect()
}

fn entries(updates: &[Update]) -> impl Iterator<Item = &Entry> {
    updates.iter().flat_map(|update| &update.entries)
}

/// The same, and every number of it to the bit.
fn assert_same(found: &Session, expected: &Session) {
    assert!(found == expected, "{} of {} scans", found.scans().len(), expected.scans().len());
    assert!(found.encode() == expected.encode(), "equal, but not to the bit");
}

/// The updates of a run are its session, added one by one and by way of a file.
fn assert_told(mapper: &Mapper, updates: &[Update]) {
    let (mut folded, mut log, mut file) = (Session::default(), LogWriter::new(), Vec::new());
    for entry in entries(updates) {
        folded.add(entry.clone()).expect("entries fit to those before");
        log.append(&mut file, entry).expect("what fits a session fits a log");
    }
    log.finish(&mut file);
    assert_same(&folded, mapper.session());
    let (read, report) = Session::read(&file).expect("a log");
    assert!(report.is_whole() && report.unknown == 0, "{report:?}");
    assert_same(&read, mapper.session());
}

fn closures(session: &Session) -> usize {
    session.edges().filter(|edge| edge.kind == EdgeKind::Closure).count()
}

#[test]
fn updates_of_a_drive_with_jobs_done_at_once_are_its_session() {
    let (mapper, updates) = mapped(settings(Jobs::Inline), &office());
    let session = mapper.session();
    println!("{} closures, {} corrections", closures(session), session.corrections());
    assert!(closures(session) > 0 && session.corrections() > 0);
    assert_told(&mapper, &updates);
}

#[test]
fn updates_of_a_drive_with_jobs_handed_out_are_its_session() {
    let (mapper, updates) = mapped(settings(Jobs::HandedOut), &office());
    let session = mapper.session();
    println!("{} closures, {} corrections", closures(session), session.corrections());
    assert!(closures(session) > 0 && session.corrections() > 0);
    assert!(updates.len() > session.scans().len(), "some are those of results");
    assert_told(&mapper, &updates);
}

#[test]
fn updates_of_a_robot_that_was_carried_are_its_session() {
    for jobs in [Jobs::Inline, Jobs::HandedOut] {
        let (mapper, updates) = mapped(settings(jobs), &carried());
        let is_apart = |update: &&Update| update.localisation == Localisation::Apart;
        let apart = updates.iter().filter(is_apart).count();
        println!("{jobs:?}: {apart} of {} updates while apart", updates.len());
        assert!(apart > 0, "it was carried away");
        assert!(updates.last().is_some_and(|update| !is_apart(&update)), "it was joined");
        assert_told(&mapper, &updates);
    }
}

#[test]
fn the_update_of_a_result_tells_of_the_newest_scan_and_nothing_new_of_it() {
    let (mapper, updates) = mapped(settings(Jobs::HandedOut), &office());
    let mut newest: Option<&Update> = None;
    let mut results = 0;
    for update in &updates {
        let is_of_scan = update.entries.iter().any(|entry| matches!(entry, Entry::Scan(_)));
        if is_of_scan {
            assert_eq!(update.scan, newest.map_or(0, |newest| newest.scan + 1));
            newest = Some(update);
            continue;
        }
        let newest = newest.expect("no result before the first scan");
        assert_eq!((update.scan, update.stamp, update.status), (newest.scan, newest.stamp, newest.status));
        assert_eq!((update.keyframe, update.matched, update.refused), (None, None, None));
        assert_eq!(update.beams, mapwright::BeamCounts::default());
        assert_eq!(update.odom_from_robot, newest.odom_from_robot, "odometry never jumps");
        results += 1;
    }
    assert!(results > 0);
    assert_eq!(newest.map(|update| update.scan + 1), Some(mapper.session().scans().len() as u64));
}

/// The keyframes that an entry names.
fn named(entry: &Entry) -> Vec<KeyframeId> {
    match entry {
        Entry::Scan(scan) => scan.keyframe.into_iter().collect(),
        Entry::Keyframe { keyframe, .. } => vec![keyframe.id],
        Entry::Fragment(fragment) => vec![fragment.first],
        Entry::Edge(recorded) => vec![recorded.edge.from, recorded.edge.to],
        Entry::Candidate(candidate) => vec![candidate.from, candidate.to],
        Entry::LeftOut(left_out) => vec![left_out.keyframe],
        Entry::WheelSlip(slip) => vec![slip.from],
        Entry::Snapshot(snapshot) => snapshot.map_from_keyframe.iter().map(|&(id, _)| id).collect(),
        _ => Vec::new(),
    }
}

#[test]
fn all_that_a_run_tells_is_named_after_it() {
    for scans in [office(), carried()] {
        let (mapper, updates) = mapped(settings(Jobs::Inline), &scans);
        let runs = entries(&updates).filter_map(|entry| if let Entry::Run(run) = entry { Some(run.id) } else { None });
        assert!(runs.eq([RUN]), "it begins once");
        assert!(matches!(entries(&updates).next(), Some(Entry::Run(_))), "with the run");
        let in_entries = entries(&updates).flat_map(named);
        let beside = updates.iter().flat_map(|update| [update.keyframe, update.anchor]).flatten();
        assert!(in_entries.chain(beside).all(|id| id.run() == RUN));
        let seqs = mapper.keyframes().iter().map(|keyframe| keyframe.id);
        assert!(seqs.eq((0..mapper.keyframes().len() as u32).map(|seq| RUN.keyframe(seq))));
    }
}

#[test]
fn who_gives_no_name_is_the_robot_robot() {
    let scans = recording(worlds::rooms(3), DriveSettings { duration_s: 5.0, ..DriveSettings::default() });
    let (mapper, _) = support::map_all(scans.iter().map(|scan| &scan.scan));
    assert!(mapper.keyframes().iter().all(|keyframe| keyframe.id.run() == RunId::of_robot("robot")));
}

/// Somebody walks so near in front of the robot, metres, for these scans.
const NEAR_M: f32 = 0.6;
const IN_THE_WAY: std::ops::Range<usize> = 100..140;

/// A drive on which somebody stands in a quarter of all beams for a while.
fn with_somebody_in_the_way() -> Vec<TrueScan> {
    let drive = DriveSettings { seed: 3, duration_s: 20.0, ..DriveSettings::default() };
    let mut scans = recording(worlds::office_floor(3), drive);
    for scan in &mut scans[IN_THE_WAY] {
        let beams = scan.scan.ranges_m.len();
        for range_m in &mut scan.scan.ranges_m[3 * beams / 8..5 * beams / 8] {
            *range_m = range_m.min(NEAR_M);
        }
    }
    scans
}

#[test]
fn a_keyframe_keeps_what_was_seen_and_the_map_lacks_who_stood_in_the_way() {
    let scans = with_somebody_in_the_way();
    let mut settings = Settings::default();
    settings.scan.drop_moving = false;
    let (mapper, _) = mapped(settings, &scans);
    let session = mapper.session();
    let mut found = 0;
    for (place, keyframe) in session.keyframes().iter().enumerate() {
        let scan = &scans[keyframe.scan as usize].scan;
        let (seen, _) = Sweep::from_scan(scan, keyframe.sweep.twist_per_s);
        assert!(*keyframe.sweep == seen, "a keyframe is what was seen");
        let drawn = session.drawn()[place].as_ref().expect("some of it is drawn");
        let mut left_out = session.left_out().iter().filter(|left_out| left_out.keyframe == keyframe.id);
        let Some(left_out) = left_out.next() else {
            assert!(drawn == &keyframe.sweep);
            continue;
        };
        assert_eq!(left_out.reason, LeftOutReason::InTheWay);
        let Beams::These(beams) = &left_out.beams else { unreachable!("{:?}", left_out.beams) };
        for (beam, (&drawn, &seen)) in drawn.codes.iter().zip(&keyframe.sweep.codes).enumerate() {
            let expected = if beams.contains(&(beam as u32)) { BEAM_DROPPED } else { seen };
            assert_eq!(drawn, expected, "beam {beam}");
        }
        let near = (0..scan.ranges_m.len()).filter(|&beam| scan.ranges_m[beam] == NEAR_M);
        let lacking = near.clone().filter(|&beam| drawn.range_m(beam).is_none()).count();
        println!("keyframe {place}: {} beams left out, {lacking} of {} near ones", beams.len(), near.clone().count());
        assert!(IN_THE_WAY.contains(&(keyframe.scan as usize)) && 10 * lacking > 9 * near.count());
        found += 1;
    }
    assert!(found > 2, "{found} keyframes with somebody in the way");
}
