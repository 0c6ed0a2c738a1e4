use super::*;
use crate::samples::{Step, Story, pose};
use crate::{Detection, EdgeKind, Evidence, FragmentStart, LeftOutReason, Objection, RunId};
use mapwright_geom::{Cov3, Pose2};
use proptest::prelude::*;

fn id(run: &str, seq: u32) -> KeyframeId {
    RunId::of_robot(run).keyframe(seq)
}

fn run(name: &str) -> Entry {
    Entry::Run(Run { id: RunId::of_robot(name), settings: String::new() })
}

fn scan(keyframe: Option<KeyframeId>, x: f64) -> Entry {
    let (stamp, keyframe_from_robot, odom_from_robot) = (Stamp(7), pose(x), pose(-x));
    Entry::Scan(ScanPose { stamp, keyframe, keyframe_from_robot, odom_from_robot })
}

fn keyframes(story: &mut Story, count: u32) {
    (0..count).for_each(|k| story.step(Step { kind: 3, a: 6, b: 0, x: f64::from(k) }));
}

fn edge(from: KeyframeId, to: KeyframeId) -> RecordedEdge {
    let information = Cov3::identity();
    let edge = Edge { from, to, kind: EdgeKind::Match, from_from_to: pose(1.0), information };
    RecordedEdge { edge, candidate: None }
}

fn gravity(keyframe: KeyframeId, down_in_keyframe: [f64; 3], sigma_rad: f64) -> Entry {
    Entry::Gravity(Gravity { keyframe, down_in_keyframe, sigma_rad })
}

fn candidate(from: KeyframeId, to: KeyframeId) -> Candidate {
    Candidate {
        from,
        to,
        detection: Detection::Place,
        evidence: Evidence::default(),
        verdict: Verdict::Waiting(Objection::Alone),
        from_from_to: None,
        covariance: Cov3::identity(),
    }
}

/// The run `one` with three keyframes, then `two` with two.
fn two_runs() -> Story {
    let mut story = Story::of(&[]);
    keyframes(&mut story, 3);
    story.add(run("two"));
    keyframes(&mut story, 2);
    story
}

#[test]
fn names_of_several_runs_resolve() {
    let session = two_runs().session;
    let places = [("one", 0), ("one", 2), ("one", 3), ("two", 0), ("two", 1), ("two", 2), ("three", 0)];
    let places = places.map(|(run, seq)| session.place(id(run, seq)));
    assert_eq!(places, [Some(0), Some(2), None, Some(3), Some(4), None, None]);
    assert_eq!(session.next_id(), Some(id("two", 2)));
    assert_eq!(session.runs().len(), 2);
    assert!(session.keyframes().iter().enumerate().all(|(k, keyframe)| session.place(keyframe.id) == Some(k)));
    assert_eq!(Session::<Sweep>::default().next_id(), None);
}

/// What a keyframe is made into before it is tried.
type Change = fn(&mut Keyframe);

#[test]
fn an_entry_that_does_not_fit_changes_nothing() {
    let mut story = two_runs();
    story.add(scan(None, 0.0));
    story.add(Entry::Edge(edge(id("one", 0), id("two", 0))));
    let session = story.session.clone();
    let (known, nobody) = (id("one", 0), id("three", 0));
    let far = Pose2::new(2e6, 0.0, 0.0);
    let turned = Pose2 { theta: 4.0, ..pose(0.0) };
    let moved =
        |id, other| Entry::Snapshot(Snapshot { number: 1, map_from_keyframe: vec![(known, pose(0.5)), (id, other)] });
    let unsure = Cov3::from_element(f64::NAN);
    let mut from_a_candidate = edge(known, id("one", 1));
    from_a_candidate.candidate = Some(0);
    let far_edge = RecordedEdge { edge: Edge { from_from_to: far, ..edge(known, id("one", 1)).edge }, candidate: None };
    let mut entries = vec![
        run("one"),
        scan(Some(nobody), 0.0),
        scan(Some(known), 3e6),
        Entry::Fragment(Fragment { first: nobody, start: FragmentStart::Resumed }),
        Entry::Edge(edge(known, nobody)),
        Entry::Edge(edge(known, known)),
        Entry::Edge(from_a_candidate),
        Entry::Edge(far_edge),
        Entry::Remeasured { number: 1, from_from_to: pose(0.0), information: Cov3::identity() },
        Entry::Remeasured { number: 0, from_from_to: turned, information: Cov3::identity() },
        Entry::Remeasured { number: 0, from_from_to: pose(0.0), information: unsure },
        Entry::Withdrawn { number: 1 },
        Entry::Candidate(candidate(nobody, known)),
        Entry::Candidate(candidate(known, nobody)),
        Entry::Candidate(candidate(known, id("two", 3))),
        Entry::Verdict { number: 0, verdict: Verdict::Accepted, agreeing: 1 },
        Entry::LeftOut(LeftOut { keyframe: nobody, beams: Beams::All, reason: LeftOutReason::Asked }),
        Entry::WheelSlip(WheelSlip { scan: 0, from: nobody, metres: 1.0 }),
        gravity(nobody, [0.0, 0.0, -1.0], 0.01),
        gravity(known, [0.0, 0.1, -1.0], 0.01),
        gravity(known, [f64::NAN, 0.0, -1.0], 0.01),
        gravity(known, [0.0, 0.0, -1.0], 0.0),
        gravity(known, [0.0, 0.0, -1.0], f64::NAN),
        moved(nobody, pose(1.0)),
        moved(id("one", 1), Pose2::new(0.0, f64::INFINITY, 0.0)),
    ];
    let Some(Entry::Keyframe { keyframe, .. }) = story.keyframe(Step { kind: 3, a: 6, b: 0, x: 0.0 }) else { panic!() };
    let changes: [Change; 6] = [
        |keyframe| keyframe.id.seq += 1,
        |keyframe| keyframe.id = id("one", 3),
        |keyframe| keyframe.id = id("three", 0),
        |keyframe| keyframe.scan = 2,
        |keyframe| Arc::make_mut(&mut keyframe.sweep).step_m = 0.0,
        |keyframe| Arc::make_mut(&mut keyframe.sweep).twist_per_s[0] = f64::NAN,
    ];
    for change in changes {
        let mut keyframe = Keyframe::clone(&keyframe);
        change(&mut keyframe);
        entries.push(Entry::Keyframe { keyframe: Arc::new(keyframe), map_from_keyframe: pose(0.0) });
    }
    entries.push(Entry::Keyframe { keyframe: Arc::clone(&keyframe), map_from_keyframe: far });
    for entry in entries {
        let error = story.session.add(entry.clone()).unwrap_err();
        assert_eq!(story.session, session, "{error}: {entry:?}");
    }
    story.add(Entry::Keyframe { keyframe, map_from_keyframe: pose(0.0) });
}

#[test]
fn errors_say_what_was_expected_and_what_was_found() {
    let mut session = two_runs().session;
    let error = session.add(Entry::Withdrawn { number: 3 }).unwrap_err();
    assert_eq!(error.to_string(), "expected the number of an edge, found 3 of 0");
}

#[test]
fn the_trajectory_follows_corrections() {
    let mut story = two_runs();
    story.add(scan(None, 3.0));
    story.add(scan(Some(id("one", 1)), 0.5));
    story.add(scan(Some(id("two", 1)), 0.25));
    let before: Vec<_> = story.session.trajectory().map(|pose| pose.map_from_robot).collect();
    assert_eq!(before, [pose(3.0), pose(1.0) * pose(0.5), pose(1.0) * pose(0.25)]);
    let moved = vec![(id("one", 1), pose(9.0))];
    story.add(Entry::Snapshot(Snapshot { number: 4, map_from_keyframe: moved }));
    let after: Vec<_> = story.session.trajectory().collect();
    assert_eq!(after[1].map_from_robot, pose(9.0) * pose(0.5));
    assert_eq!([after[0], after[2]].map(|pose| pose.map_from_robot), [before[0], before[2]]);
    assert_eq!(after[1].odom_from_robot, pose(-0.5), "odometry never jumps");
    assert_eq!(story.session.corrections(), 4);
}

#[test]
fn beams_that_are_left_out_are_not_drawn() {
    let mut story = two_runs();
    let seen = |story: &Story, k: usize| story.session.drawn()[k].as_ref().map(|sweep| sweep.codes.clone());
    let before = seen(&story, 1).unwrap();
    let mut leave = |seq, beams| {
        story.add(Entry::LeftOut(LeftOut { keyframe: id("one", seq), beams, reason: LeftOutReason::InTheWay }));
    };
    leave(1, Beams::These(vec![2, 77]));
    leave(1, Beams::These(vec![4]));
    leave(2, Beams::All);
    leave(2, Beams::These(vec![1]));
    let mut expected = before.clone();
    (expected[2], expected[4]) = (mapwright_sensor::BEAM_DROPPED, mapwright_sensor::BEAM_DROPPED);
    assert_eq!((seen(&story, 1), seen(&story, 2)), (Some(expected), None));
    assert_eq!(story.session.keyframes()[1].sweep.codes, before, "the keyframe stays as it is");
    assert_eq!(story.session.left_out().len(), 4);
}

#[test]
fn edges_are_remeasured_and_withdrawn() {
    let mut story = two_runs();
    let mut crooked = edge(id("two", 1), id("one", 0));
    crooked.edge.information[(2, 0)] = 0.5;
    story.add(Entry::Edge(crooked));
    story.add(Entry::Edge(edge(id("one", 0), id("one", 2))));
    assert_eq!(story.session.recorded_edges()[0].ends, [4, 0]);
    assert_eq!(story.session.recorded_edges()[0].recorded, crooked, "to the last digit of either triangle");
    story.add(Entry::Remeasured { number: 1, from_from_to: pose(5.0), information: 2.0 * Cov3::identity() });
    story.add(Entry::Withdrawn { number: 0 });
    let standing: Vec<_> = story.session.edges().map(|edge| (edge.from_from_to, edge.information[(0, 0)])).collect();
    assert_eq!(standing, [(pose(5.0), 2.0)]);
}

#[test]
fn candidates_may_lead_to_the_next_keyframe_and_change_their_verdict() {
    let mut story = two_runs();
    story.add(Entry::Candidate(candidate(id("one", 0), id("two", 2))));
    story.add(Entry::Verdict { number: 0, verdict: Verdict::Accepted, agreeing: 3 });
    let candidate = &story.session.candidates()[0];
    assert_eq!((candidate.verdict, candidate.evidence.agreeing), (Verdict::Accepted, 3));
    assert_eq!(story.session.place(candidate.to), None);
    keyframes(&mut story, 1);
    assert_eq!(story.session.place(id("two", 2)), Some(5));
}

#[test]
fn pieces_are_held_together_by_more_than_odometry_over_a_break() {
    let mut story = Story::of(&[]);
    keyframes(&mut story, 9);
    let at = |seq: u32| id("one", seq);
    let starts = [
        (0, FragmentStart::SwitchedOn),
        (2, FragmentStart::Uncertain),
        (4, FragmentStart::Blind),
        (7, FragmentStart::Lost),
    ];
    starts.iter().for_each(|&(seq, start)| story.add(Entry::Fragment(Fragment { first: at(seq), start })));
    let link = |from: u32, to: u32, kind: EdgeKind| {
        let edge = Edge { kind, ..edge(at(from), at(to)).edge };
        Entry::Edge(RecordedEdge { edge, candidate: None })
    };
    (1..9).for_each(|to| story.add(link(to - 1, to, EdgeKind::Odometry)));
    let pieces = |story: &Story| -> Vec<(usize, usize)> {
        story.session.pieces().iter().map(|piece| (piece.fragments.len(), piece.keyframes)).collect()
    };
    assert_eq!(pieces(&story), [(1, 2), (1, 2), (1, 3), (1, 2)]);
    story.add(link(1, 8, EdgeKind::Closure));
    assert_eq!(pieces(&story), [(2, 4), (1, 2), (1, 3)], "what lies between hangs on odometry still");
    story.add(link(3, 5, EdgeKind::Match));
    assert_eq!(pieces(&story), [(2, 4), (2, 5)]);
    let closure = story.session.recorded_edges().len() as u32 - 2;
    story.add(Entry::Withdrawn { number: closure });
    assert_eq!(pieces(&story), [(1, 2), (2, 5), (1, 2)]);
    assert!(Session::<Sweep>::default().pieces().is_empty());
}

proptest! {
    #[test]
    fn every_name_resolves(steps in crate::samples::steps(80)) {
        let session = Story::of(&steps).session;
        for (place, keyframe) in session.keyframes().iter().enumerate() {
            prop_assert_eq!(session.place(keyframe.id), Some(place));
        }
        for edge in session.recorded_edges() {
            let ends = [edge.recorded.edge.from, edge.recorded.edge.to].map(|id| session.place(id).unwrap() as u32);
            prop_assert_eq!(edge.ends, ends);
        }
        prop_assert_eq!(session.trajectory().len(), session.scans().len());
        prop_assert_eq!(session.drawn().len(), session.keyframes().len());
    }
}
