use super::bytes::Coded;
use super::*;
use crate::entry::{Entry, RecordedEdge, Run, Snapshot};
use crate::error::EntryError;
use crate::id::{KeyframeId, RunId};
use crate::keyframe::{Edge, EdgeKind, Keyframe};
use crate::left_out::Beams;
use crate::samples::{Step, Story, pose, steps};
use mapwright_geom::{Cov6, Pose, Pose3, Stamp};
use proptest::prelude::*;

fn written(entries: &[Entry]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut writer = LogWriter::new();
    entries.iter().for_each(|entry| writer.append(&mut bytes, entry).unwrap());
    writer.finish(&mut bytes);
    bytes
}

fn read(bytes: &[u8]) -> (Session, LogReport) {
    Session::read(bytes).unwrap()
}

fn whole(bytes: &[u8]) -> Session {
    let (session, report) = read(bytes);
    assert_eq!((report.losses, report.unknown, report.good_bytes), (vec![], 0, Some(bytes.len())));
    session
}

/// Where entries begin, with their kinds, and where the last ends.
fn frames(bytes: &[u8]) -> (Vec<(usize, Kind)>, usize) {
    let (mut at, mut frames) = (HEADER_BYTES, Vec::new());
    while at < bytes.len() {
        let kind = <Kind as super::bytes::Coded>::from_code(bytes[at]).unwrap();
        frames.push((at, kind));
        let length = u32::from_le_bytes(bytes[at + 2..at + 6].try_into().unwrap());
        at += ENTRY_HEADER_BYTES + length as usize + CHECKSUM_BYTES;
    }
    (frames, at)
}

/// Where the `n`th entry of this kind begins.
fn nth(bytes: &[u8], kind: Kind, n: usize) -> usize {
    frames(bytes).0.into_iter().filter(|frame| frame.1 == kind).nth(n).unwrap().0
}

/// The same with the payload of that entry damaged.
fn damaged(bytes: &[u8], kind: Kind, n: usize) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    let at = nth(&bytes, kind, n);
    bytes[at + ENTRY_HEADER_BYTES] ^= 0x40;
    bytes
}

fn what_was_lost(report: &LogReport) -> Vec<&'static str> {
    report.losses.iter().map(|loss| loss.entry.unwrap_or("damage")).collect()
}

/// An entry around a payload, with the right checksum.
fn entry(kind: u8, version: u8, payload: &[u8]) -> Vec<u8> {
    let mut entry = [&[kind, version], &(payload.len() as u32).to_le_bytes()[..], payload].concat();
    entry.extend(crc32fast::hash(&entry).to_le_bytes());
    entry
}

#[test]
fn every_kind_of_entry_reads_back_to_the_bit() {
    let story = Story::small();
    let bytes = written(&story.entries);
    let mut kinds: Vec<_> = frames(&bytes).0.into_iter().map(|(_, kind)| kind.name()).collect();
    assert_eq!(read(&bytes).1.entries, kinds.len());
    kinds.sort_unstable();
    kinds.dedup();
    assert_eq!(kinds.len(), 16, "{kinds:?}");
    assert_eq!(whole(&bytes), story.session);
    let encoded = story.session.encode();
    assert_eq!(whole(&encoded), story.session);
    assert_eq!(whole(&encoded).encode(), encoded);
}

#[test]
fn keyframes_share_their_sensors() {
    let session = whole(&written(&Story::small().entries));
    let laser = |k: usize| &session.keyframes()[k].sweep.laser;
    let shared =
        (1..session.keyframes().len()).filter(|k| laser(*k) == laser(0)).all(|k| Arc::ptr_eq(laser(k), laser(0)));
    assert!(shared && (0..session.keyframes().len()).any(|k| laser(k) != laser(0)));
}

#[test]
fn a_scan_takes_74_bytes_and_a_keyframe_two_a_beam() {
    let mut story = Story::of(&[]);
    let mut sizes = vec![written(&story.entries).len()];
    for step in [(3, 6), (3, 3), (1, 1)] {
        story.step(Step { kind: step.0, a: step.1, b: 1, x: 0.5 });
        sizes.push(written(&story.entries).len());
    }
    assert_eq!(sizes[3] - sizes[2], 74);
    let laser = 10 + 4 + 5 * 8 + 24 + 1 + "front".len();
    assert_eq!(sizes[1] - sizes[0], 100 + 2 * 6 + laser);
    assert_eq!(sizes[2] - sizes[1], 100 + 2 * 3 + laser, "another laser");
}

proptest! {
    #[test]
    fn reading_gives_what_adding_gives(steps in steps(60), cut in any::<prop::sample::Index>()) {
        let story = Story::of(&steps);
        let bytes = written(&story.entries);
        prop_assert_eq!(&whole(&bytes), &story.session);
        let encoded = story.session.encode();
        prop_assert_eq!(&whole(&encoded), &story.session);
        prop_assert_eq!(whole(&encoded).encode(), encoded);

        let (first, second) = story.entries.split_at(cut.index(story.entries.len() + 1));
        let mut bytes = written(first);
        let mut writer = LogWriter::resume(&whole(&bytes));
        second.iter().for_each(|entry| writer.append(&mut bytes, entry).unwrap());
        writer.finish(&mut bytes);
        prop_assert_eq!(&whole(&bytes), &story.session);
    }

    /// Whatever is lost, what is read is a session, and may be appended to or written anew.
    #[test]
    fn damage_anywhere_leaves_a_session(
        steps in steps(60), damage in prop::collection::vec((any::<prop::sample::Index>(), 1..=255_u8), 1..4), more in steps(9),
    ) {
        let mut bytes = written(&Story::of(&steps).entries);
        for (at, flip) in damage {
            let at = HEADER_BYTES + at.index(bytes.len() - HEADER_BYTES);
            bytes[at] ^= flip;
        }
        let (session, report) = read(&bytes);
        prop_assert_eq!(&whole(&session.encode()), &session);
        let Some(good_bytes) = report.good_bytes else { return Ok(()) };
        bytes.truncate(good_bytes);
        prop_assert_eq!(&read(&bytes).0, &session);
        let mut story = Story::after(session);
        more.iter().for_each(|step| story.step(*step));
        let mut writer = LogWriter::resume(&read(&bytes).0);
        story.entries.iter().for_each(|entry| writer.append(&mut bytes, entry).unwrap());
        writer.finish(&mut bytes);
        let (session, after) = read(&bytes);
        prop_assert_eq!(&session, &story.session);
        prop_assert!(after.is_whole());
    }

    #[test]
    fn any_bytes_are_survived(tail in prop::collection::vec(any::<u8>(), 0..300), keep in any::<prop::sample::Index>()) {
        let bytes = written(&Story::small().entries);
        let mut mixed = bytes[..keep.index(bytes.len())].to_vec();
        mixed.extend(&tail);
        let _ = Session::read(&mixed);
        for kind in 0..19 {
            // a right checksum around a wrong payload
            let (session, _) = read(&[&bytes[..], &entry(kind, 1, &tail)].concat());
            prop_assert_eq!(whole(&session.encode()), session);
        }
    }
}

#[test]
fn a_cut_takes_the_torn_entry_only() {
    let bytes = written(&Story::small().entries);
    let (frames, end) = frames(&bytes);
    assert_eq!(end, bytes.len());
    for cut in HEADER_BYTES..bytes.len() {
        let (before, (start, kind)) = frames.iter().copied().enumerate().rfind(|(_, (at, _))| *at <= cut).unwrap();
        let (session, report) = read(&bytes[..cut]);
        let (expected, nothing_lost) = read(&bytes[..start]);
        assert_eq!(session, expected, "{kind:?} cut at {cut}");
        assert_eq!((report.entries, nothing_lost.lost), (before, 0));
        let losses: Vec<_> = report.losses.iter().map(|loss| (loss.offset_bytes, loss.bytes)).collect();
        assert_eq!(losses, if cut == start { vec![] } else { vec![(start, cut - start)] });
        let open_sensor = before > 0 && frames[before - 1].1 == Kind::Sensor;
        assert_eq!(report.good_bytes, Some(if open_sensor { frames[before - 1].0 } else { start }));
    }
    for cut in 0..HEADER_BYTES {
        assert!(Session::read(&bytes[..cut]).is_err(), "{cut}");
    }
}

#[test]
fn a_torn_log_goes_on() {
    let bytes = written(&Story::small().entries);
    for cut in (HEADER_BYTES..bytes.len()).step_by(3) {
        let (session, report) = read(&bytes[..cut]);
        let mut log = bytes[..report.good_bytes.unwrap()].to_vec();
        let mut writer = LogWriter::resume(&session);
        let mut story = Story::after(session);
        for kind in [0, 1, 3, 1, 3, 5, 9, 10, 13] {
            // either laser is new to some of the cuts, and torn off in others
            story.step(Step { kind, a: cut as u32, b: 1, x: 0.5 });
        }
        story.entries.iter().for_each(|entry| writer.append(&mut log, entry).unwrap());
        writer.finish(&mut log);
        assert_eq!(whole(&log), story.session, "{cut}");
    }
}

#[test]
fn what_is_read_before_a_cut_is_what_was_added_before_it() {
    let story = Story::small();
    let (mut bytes, mut writer, mut session) = (Vec::new(), LogWriter::new(), Session::default());
    for entry in &story.entries {
        session.add(entry.clone()).unwrap();
        writer.append(&mut bytes, entry).unwrap();
        writer.finish(&mut bytes);
        assert_eq!(whole(&bytes), session);
    }
}

#[test]
fn every_flipped_byte_is_told_and_nothing_is_taken_for_something_else() {
    let story = Story::small();
    let bytes = written(&story.entries);
    let here = |session: &Session, id: KeyframeId| session.keyframes()[session.place(id).unwrap()].clone();
    for at in 0..bytes.len() {
        for flip in [0x01, 0x10, 0x80, 0xff] {
            let mut damaged = bytes.clone();
            damaged[at] ^= flip;
            let Ok((session, report)) = Session::read(&damaged) else { continue };
            assert!(!report.is_whole() && report.lost_bytes > 0, "{at} {flip}");
            assert!(session.keyframes().iter().all(|keyframe| *keyframe == here(&story.session, keyframe.id)));
            assert!(session.scans().iter().all(|scan| story.session.scans().contains(scan)));
            let known = |edge: &crate::SessionEdge<_>| {
                let same = |other: &&crate::SessionEdge<_>| other.recorded.edge == edge.recorded.edge;
                story.session.recorded_edges().iter().any(|other| same(&other) && (other.withdrawn || !edge.withdrawn))
            };
            let remeasured = story.entries.iter().any(|entry| matches!(entry, Entry::Remeasured { .. }));
            let unknown = session.recorded_edges().iter().filter(|edge| !known(edge)).count();
            assert!(unknown <= usize::from(remeasured), "{at} {flip}: {unknown}");
        }
    }
}

#[test]
fn losses_say_what_where_and_how_much() {
    let bytes = written(&Story::small().entries);
    let at = nth(&bytes, Kind::Edge, 0);
    let (_, report) = read(&damaged(&bytes, Kind::Edge, 0));
    let text = report.losses[0].to_string();
    assert!(text.starts_with("expected an entry's checksum, found "), "{text}");
    assert!(text.ends_with(&format!(", at byte {at}: 123 bytes left out")), "{text}");
    assert_eq!(report.losses[0].offset_bytes, at);
    let text = read(&bytes[..bytes.len() - 1]).1.losses[0].to_string();
    assert!(text.starts_with("expected an entry, found ") && text.ends_with(" bytes left out"), "{text}");
}

/// Keyframes 0 to 4, edges from each to the next, a scan on each.
fn chain() -> Story {
    let mut story = Story::of(&[]);
    for k in 0..5 {
        story.step(Step { kind: 1, a: 0, b: 0, x: f64::from(k) });
        story.step(Step { kind: 3, a: 3 * (k / 3), b: 0, x: f64::from(k) });
        if k > 0 {
            story.step(Step { kind: 5, a: k - 1, b: k, x: f64::from(k) });
        }
        story.step(Step { kind: 1, a: k, b: 1, x: 0.5 });
    }
    story.add(Entry::Withdrawn { number: 1 });
    story.add(Entry::Withdrawn { number: 3 });
    story
}

#[test]
fn a_lost_keyframe_takes_only_what_hangs_on_it() {
    let bytes = written(&chain().entries);
    let (session, report) = read(&damaged(&bytes, Kind::Keyframe, 1));
    assert_eq!(session.keyframes().iter().map(|keyframe| keyframe.id.seq).collect::<Vec<_>>(), [0, 2, 3, 4]);
    assert_eq!(what_was_lost(&report), ["damage", "edge", "scan", "edge", "withdrawn edge"]);
    let ends: Vec<_> = session.recorded_edges().iter().map(|edge| (edge.ends, edge.withdrawn)).collect();
    assert_eq!(ends, [([1, 2], false), ([2, 3], true)], "numbers of edges are the log's");
    assert_eq!(report.good_bytes, None);
    let found = &report.losses[1].found;
    assert_eq!(found, "1, which is not there");
    assert_eq!(session.next_id().unwrap().seq, 5);
    let id = session.keyframes()[1].id;
    assert_eq!((session.place(id), session.place(KeyframeId { seq: 1, ..id })), (Some(1), None));
    assert_eq!(whole(&session.encode()), session);
}

#[test]
fn a_lost_scan_leaves_the_others_their_numbers() {
    let story = chain();
    let bytes = written(&story.entries);
    let mut twice = damaged(&bytes, Kind::Scan, 2);
    twice = damaged(&twice, Kind::Scan, 6);
    let (session, report) = read(&twice);
    assert_eq!(what_was_lost(&report), ["damage", "damage"]);
    assert_eq!(
        (session.keyframes(), session.recorded_edges()),
        (story.session.keyframes(), story.session.recorded_edges())
    );
    let scans = |numbers: [u64; 5]| numbers.map(|number| session.scan_place(number));
    assert_eq!(scans([1, 2, 3, 6, 9]), [Some(1), None, Some(2), None, Some(7)]);
    assert_eq!(session.scans()[7], story.session.scans()[9]);
    assert_eq!(whole(&session.encode()), session);
    assert_eq!(report.good_bytes, None);
}

#[test]
fn what_needs_a_lost_laser_or_run_is_left_out() {
    let bytes = written(&chain().entries);
    let (session, report) = read(&damaged(&bytes, Kind::Sensor, 1));
    assert_eq!(session.keyframes().len(), 3, "the other laser's");
    assert!(report.losses.iter().any(|loss| loss.expected == "the number of a sensor"));
    assert_eq!(report.good_bytes, None);
    let (session, report) = read(&damaged(&bytes, Kind::Run, 0));
    assert_eq!(
        (session.keyframes().len(), session.scans().len()),
        (0, 5),
        "scans that hang on no keyframe need no run"
    );
    assert_eq!(report.lost, 1 + 5 + 4 + 2 + 5);
}

#[test]
fn a_snapshot_moves_the_keyframes_that_are_left() {
    let mut story = chain();
    story.step(Step { kind: 13, a: 0, b: 0, x: 100.0 });
    let bytes = written(&story.entries);
    let (session, report) = read(&damaged(&bytes, Kind::Keyframe, 1));
    assert_eq!(session.map_from_keyframe(), [0, 2, 3, 4].map(|k| pose(100.0 + f64::from(k))));
    assert_eq!(report.losses.last().unwrap().bytes, 28, "one pose");
    let (session, report) = read(&damaged(&bytes, Kind::Snapshot, 0));
    assert_eq!(session.map_from_keyframe(), [0, 1, 2, 3, 4].map(|k| pose(f64::from(k))));
    assert_eq!((what_was_lost(&report), session.corrections()), (vec!["damage"], 0));
}

#[test]
fn a_damaged_length_ends_the_reading() {
    let bytes = written(&chain().entries);
    let at = nth(&bytes, Kind::Keyframe, 2);
    for (byte, flip) in [(2, 1), (3, 1), (5, 0x80)] {
        let mut damaged = bytes.clone();
        damaged[at + byte] ^= flip;
        let (session, report) = read(&damaged);
        assert_eq!((session, report.entries), (read(&bytes[..at]).0, read(&bytes[..at]).1.entries));
        assert_eq!((report.lost, report.lost_bytes), (1, bytes.len() - at));
    }
}

#[test]
fn lengths_are_not_believed() {
    let start = [&SESSION_MAGIC[..], &VERSION.to_le_bytes()].concat();
    for kind in 0..19 {
        let (session, report) = read(&[&start[..], &[kind, 1], &u32::MAX.to_le_bytes(), &[7; 40]].concat());
        assert_eq!((session, report.lost_bytes), (Session::default(), 46));
        assert_eq!(report.losses[0].found, "46 bytes of 4294967305");
        let (_, report) = read(&[&start[..], &entry(kind, 1, &[0xff; 40])].concat());
        let any_bytes_will_do = kind == Kind::Checkpoint.code();
        assert_eq!(report.lost + report.unknown, usize::from(!any_bytes_will_do), "kind {kind}");
    }
}

#[test]
fn a_checkpoint_is_for_the_end_of_a_whole_session() {
    let mut story = chain();
    let checkpoint = Entry::Checkpoint(crate::Checkpoint { state: [1, 2, 3].into() });
    story.add(checkpoint.clone());
    let bytes = written(&story.entries);
    assert_eq!(whole(&bytes).checkpoint().map(|checkpoint| &checkpoint.state[..]), Some(&[1, 2, 3][..]));
    let (session, report) = read(&damaged(&bytes, Kind::Scan, 1));
    assert!(session.checkpoint().is_none() && report.lost == 1, "a scan was lost before");
    story.step(Step { kind: 1, a: 4, b: 0, x: 0.0 });
    assert!(whole(&written(&story.entries)).checkpoint().is_none(), "the run went on");
}

#[test]
fn later_kinds_and_versions_are_skipped_and_counted() {
    let mut story = chain();
    let before = written(&story.entries);
    let mut bytes = [&before[..], &entry(77, 1, b"what is this"), &entry(3, 2, b"a scan, but more")].concat();
    let (session, report) = read(&bytes);
    assert_eq!((session, report.unknown, report.lost), (whole(&before), 2, 0));
    assert_eq!(report.good_bytes, Some(bytes.len()));
    let mut writer = LogWriter::resume(&story.session);
    story.step(Step { kind: 3, a: 4, b: 0, x: 0.0 });
    writer.append(&mut bytes, story.entries.last().unwrap()).unwrap();
    let (session, report) = read(&bytes);
    assert_eq!((session, report.unknown), (story.session, 2));
}

#[test]
fn other_files_and_later_versions_are_refused() {
    let bytes = written(&chain().entries);
    let error = |bytes: &[u8]| Session::read(bytes).unwrap_err().to_string();
    assert_eq!(error(b"P5 3 3"), "byte 0: expected a session of mapwright, found something else");
    assert_eq!(error(b""), "byte 0: expected a session of mapwright, found something else");
    assert_eq!(error(&bytes[..19]), "byte 0: expected a session of mapwright, found 19 bytes of its first 20");
    let newer = [&bytes[..18], &[9, 0], &bytes[20..]].concat();
    assert_eq!(error(&newer), "byte 18: expected version 1 or 2 of a session's file, found 9");
    assert!(matches!(read_log::<mapwright_sensor::Sweep>(OLD), Err(LogError::Version { found: 1 })));
}

#[test]
fn another_kind_of_measurement_is_told() {
    let mut bytes = written(&[Entry::Run(Run::default())]);
    let at = HEADER_BYTES + ENTRY_HEADER_BYTES;
    let payload = [&bytes[at..at + 4], &[2], &bytes[at + 5..bytes.len() - 4]].concat();
    bytes = [&bytes[..HEADER_BYTES], &entry(1, 1, &payload)].concat();
    let loss = read(&bytes).1.losses[0].to_string();
    assert_eq!(
        loss,
        "expected measurements of the kind that is read, found kind 2, not 1, at byte 20: 35 bytes left out of a whole \
         entry (run)"
    );
}

/// Points in space, as another sensor sees them.
#[derive(Debug, Clone, PartialEq)]
struct Cloud {
    sensor: Arc<String>,
    heights_m: Vec<u8>,
}

impl Measurement for Cloud {
    type Pose = Pose3;
    type Sensor = String;

    const CODE: u8 = 200;

    fn without(&self, _: &Beams) -> Self {
        self.clone()
    }

    fn check(&self) -> Result<(), EntryError> {
        Ok(())
    }

    fn sensor(&self) -> &Arc<String> {
        &self.sensor
    }

    fn put_sensor(sensor: &String, out: &mut Vec<u8>) {
        out.extend_from_slice(sensor.as_bytes());
    }

    fn take_sensor(bytes: &[u8]) -> Result<String, EntryError> {
        super::bytes::text(bytes, "a name")
    }

    fn put(&self, out: &mut Vec<u8>) {
        out.extend_from_slice(&self.heights_m);
    }

    fn take(sensor: &Arc<String>, bytes: &[u8]) -> Result<Self, EntryError> {
        Ok(Self { sensor: Arc::clone(sensor), heights_m: bytes.to_vec() })
    }
}

#[test]
fn measurements_in_space_read_back_too() {
    let run = RunId::of_robot("drone");
    let pose = |k: u8| Pose3::identity().turned([0.1, 0.02 * f64::from(k), -0.3]).moved([1.0, f64::from(k), 0.1]);
    let mut session = Session::default();
    session.add(Entry::Run(Run { id: run, settings: String::new() })).unwrap();
    for k in 0..4 {
        let sweep = Arc::new(Cloud { sensor: Arc::new("spinning".to_owned()), heights_m: vec![k; 3] });
        let id = run.keyframe(u32::from(k));
        let keyframe = Arc::new(Keyframe { id, stamp: Stamp(0), scan: 0, sweep, hardly_fits: false });
        session.add(Entry::Keyframe { keyframe, map_from_keyframe: pose(k) }).unwrap();
    }
    let information = Cov6::from_fn(|row, column| (row + column) as f64);
    let [from, to] = [0, 3].map(|k| run.keyframe(k));
    let edge = Edge { from, to, kind: EdgeKind::Match, from_from_to: pose(9), information };
    session.add(Entry::Edge(RecordedEdge { edge, candidate: None })).unwrap();
    let bytes = session.encode();
    let (again, report) = read_log::<Cloud>(&bytes).unwrap();
    assert_eq!((again, report.lost), (session, 0));
    let (plane, report) = read(&bytes);
    assert_eq!((plane, report.lost, report.good_bytes), (Session::default(), 7, None));
}

#[test]
fn a_verdict_on_the_keyframe_that_comes_next_survives() {
    let mut story = chain();
    let next = story.session.next_id().unwrap();
    for a in [1, 2] {
        story.step(Step { kind: 9, a, b: 2, x: 1.0 });
    }
    assert_eq!(whole(&written(&story.entries)).candidates()[1].to, next);
    // it never came, and another run began
    story.step(Step { kind: 0, a: 0, b: 0, x: 0.0 });
    story.step(Step { kind: 3, a: 0, b: 0, x: 0.0 });
    assert_eq!(whole(&written(&story.entries)), story.session);
    assert_eq!(whole(&story.session.encode()), story.session);
}

#[test]
fn snapshots_are_kept_back_and_merged() {
    let mut story = chain();
    let all = story.session.keyframes().len();
    let (mut bytes, mut writer) = (Vec::new(), LogWriter::new());
    story.entries.iter().for_each(|entry| writer.append(&mut bytes, entry).unwrap());
    let mut lengths = vec![bytes.len()];
    for _ in 0..30 {
        story.step(Step { kind: 13, a: 0, b: 0, x: lengths.len() as f64 });
        writer.append(&mut bytes, story.entries.last().unwrap()).unwrap();
        lengths.push(bytes.len());
    }
    let size = 14 + 28 * all;
    assert_eq!(lengths[1] - lengths[0], size, "long enough ago");
    assert_eq!(lengths[30], lengths[1], "nothing was written since");
    writer.finish(&mut bytes);
    assert_eq!(bytes.len(), lengths[30] + size);
    writer.finish(&mut bytes);
    assert_eq!(bytes.len(), lengths[30] + size, "there is nothing more");
    assert_eq!(whole(&bytes), story.session);
    assert_eq!(whole(&bytes).corrections(), 30);
}

#[test]
fn snapshots_at_most_double_the_file() {
    let mut story = Story::of(&[]);
    for k in 0..200 {
        story.step(Step { kind: 3, a: 6, b: 0, x: f64::from(k) });
        story.step(Step { kind: 13, a: 0, b: 0, x: f64::from(k) });
    }
    let without: Vec<_> = story.entries.iter().filter(|entry| !matches!(entry, Entry::Snapshot(_))).cloned().collect();
    let last = 14 + 28 * 200;
    let [most, least] = [written(&story.entries), written(&without)].map(|bytes| bytes.len());
    assert!(most <= 2 * least + last, "{most} {least}");
    assert_eq!(whole(&written(&story.entries)), story.session);
}

#[test]
fn what_refers_to_nothing_is_not_written() {
    let story = chain();
    let mut other = Story::of(&[]);
    other.add(Entry::Run(Run { id: RunId::of_robot("two"), settings: String::new() }));
    other.step(Step { kind: 3, a: 0, b: 0, x: 0.0 });
    let (mut bytes, mut writer) = (Vec::new(), LogWriter::new());
    story.entries.iter().for_each(|entry| writer.append(&mut bytes, entry).unwrap());
    let before = bytes.clone();
    let id = other.session.keyframes()[0].id;
    let snapshot = Snapshot { number: 1, map_from_keyframe: vec![(id, pose(0.0))] };
    for entry in [
        other.entries[0].clone(),
        other.entries[2].clone(),
        Entry::Withdrawn { number: 4 },
        Entry::Verdict { number: 0, verdict: crate::Verdict::Accepted, agreeing: 0 },
        Entry::Snapshot(snapshot),
    ] {
        assert!(writer.append(&mut bytes, &entry).is_err(), "{entry:?}");
        writer.finish(&mut bytes);
        assert_eq!(bytes, before);
    }
}

/// Written by the program of version 1: 60 scans, every eighth of a log of the Intel lab.
const OLD: &[u8] = include_bytes!("../../tests/fixtures/v1.mapwright");

#[test]
fn version_1_is_read() {
    let (session, report) = read(OLD);
    assert_eq!((report.version, report.is_whole(), report.good_bytes), (1, true, None));
    assert_eq!((session.scans().len(), session.keyframes().len()), (60, 56));
    assert_eq!((session.edges().count(), session.runs().count()), (110, 1));
    assert!(session.runs().next().unwrap().settings.starts_with("{\"map\":{\"resolution_m\":0.05,"));
    let last = session.trajectory().last().unwrap();
    assert_eq!(last.stamp, Stamp(976_052_999_895_712_000));
    let [x, y, theta] = [-2.898_535_112, -16.934_771_254, 2.0 * (-0.969_815_305_f64).atan2(0.243_840_674)];
    let truth = mapwright_geom::Pose2::new(x, y, theta);
    assert!(last.map_from_robot.distance(truth) < 1e-8 && last.map_from_robot.between(truth).theta.abs() < 1e-8);
    let keyframe = &session.keyframes()[55];
    assert_eq!((keyframe.id.seq, session.scans()[keyframe.scan as usize].stamp), (55, keyframe.stamp));
    assert_eq!(keyframe.sweep.codes.len(), 180);
    assert_eq!(session.scans()[keyframe.scan as usize].keyframe_from_robot, session.map_from_keyframe()[55]);
    assert!(Arc::ptr_eq(&keyframe.sweep.laser, &session.keyframes()[0].sweep.laser));
    assert_eq!(whole(&session.encode()), session);
}

#[test]
fn damage_to_version_1_is_told() {
    for cut in (0..OLD.len()).step_by(97) {
        assert!(Session::read(&OLD[..cut]).is_err(), "{cut}");
    }
    for at in (0..OLD.len()).step_by(31) {
        let mut damaged = OLD.to_vec();
        damaged[at] ^= 0x10;
        assert!(Session::read(&damaged).is_err(), "{at}");
    }
    // many settings, with the right checksum
    let mut claims = [&OLD[..20], &u32::MAX.to_le_bytes(), b"{}"].concat();
    claims.extend(crc32fast::hash(&claims).to_le_bytes());
    let error = Session::read(&claims).unwrap_err().to_string();
    assert_eq!(error, "byte 24: expected the settings, found 2 bytes of 4294967295");
}
