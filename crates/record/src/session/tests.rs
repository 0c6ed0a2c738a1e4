use super::*;
use crate::FragmentStart::{self, Blind, Lost, Relocalised, Resumed, SwitchedOn, Uncertain};
use crate::samples::{Step, Story, pose};
use crate::{Detection, EdgeKind, Evidence, LeftOutReason, Objection, RunId};
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

/// Nine keyframes of the fragments `starts`, each linked to the one before by odometry of this deviation, metres and radians.
fn fragments(starts: &[(u32, FragmentStart)], sigma: f64) -> Story {
    let mut story = Story::of(&[]);
    keyframes(&mut story, 9);
    for &(seq, start) in starts {
        story.add(Entry::Fragment(Fragment { first: id("one", seq), start }));
    }
    (1..9).for_each(|to| link(&mut story, [to - 1, to], EdgeKind::Odometry, sigma));
    story
}

/// An edge of so many metres' deviation, and of a fifth as many radians'.
fn link(story: &mut Story, ends: [u32; 2], kind: EdgeKind, sigma: f64) {
    link_with(story, ends, kind, [sigma, 0.2 * sigma]);
}

fn link_with(story: &mut Story, [from, to]: [u32; 2], kind: EdgeKind, [sigma_m, sigma_rad]: [f64; 2]) {
    let information = Cov3::from_variances(sigma_m * sigma_m, sigma_rad * sigma_rad).try_inverse().unwrap();
    let edge = Edge { kind, information, ..edge(id("one", from), id("one", to)).edge };
    story.add(Entry::Edge(RecordedEdge { edge, candidate: None }));
}

/// Of each piece its fragments and keyframes.
fn pieces(story: &Story) -> Vec<(usize, usize)> {
    story.session.pieces().iter().map(|piece| (piece.fragments.len(), piece.keyframes)).collect()
}

/// Places of the keyframes of each map.
fn maps(story: &Story) -> Vec<Vec<usize>> {
    story.session.maps().iter().map(|map| map.places().collect()).collect()
}

#[test]
fn pieces_are_held_together_by_more_than_odometry_over_a_break() {
    let mut story = fragments(&[(0, SwitchedOn), (2, Uncertain), (4, Blind), (7, Lost)], 1.0);
    assert_eq!(pieces(&story), [(1, 2), (1, 2), (1, 3), (1, 2)]);
    link(&mut story, [1, 8], EdgeKind::Closure, 0.1);
    assert_eq!(pieces(&story), [(2, 4), (1, 2), (1, 3)], "what lies between hangs on odometry still");
    link(&mut story, [3, 5], EdgeKind::Closure, 0.1);
    assert_eq!(pieces(&story), [(2, 4), (2, 5)]);
    // A match with what lies beyond a break is worth no more than the join that allowed it.
    link(&mut story, [1, 8], EdgeKind::Match, 0.1);
    let closure = story.session.recorded_edges().len() as u32 - 3;
    story.add(Entry::Withdrawn { number: closure });
    assert_eq!(pieces(&story), [(1, 2), (2, 5), (1, 2)]);
    assert!(Session::<Sweep>::default().pieces().is_empty());
}

#[test]
fn a_session_that_goes_on_is_one_piece_and_another_robot_begins_its_own() {
    for start in [Relocalised, Resumed] {
        assert_eq!(pieces(&fragments(&[(0, SwitchedOn), (4, start)], 1.0)), [(2, 9)]);
    }
    let mut story = fragments(&[(0, SwitchedOn), (4, SwitchedOn)], 0.1);
    let [first, second] = [0, 1].map(|at| story.session.fragments()[at]);
    assert!(!story.session.is_break(&first) && story.session.is_break(&second));
    assert_eq!((pieces(&story), maps(&story)), (vec![(1, 4), (1, 5)], vec![vec![4, 5, 6, 7, 8], vec![0, 1, 2, 3]]));
    link(&mut story, [1, 8], EdgeKind::Closure, 0.1);
    assert_eq!((pieces(&story), maps(&story).len()), (vec![(2, 9)], 1));
}

#[test]
fn odometry_over_a_break_links_pieces_unless_it_says_nothing() {
    let links = |story: &Story| -> Vec<Option<(usize, f64)>> {
        let rounded = |link: OdometryLink| (link.to, (1e6 * link.sigma_m).round() / 1e6);
        story.session.pieces().iter().map(|piece| piece.link.map(rounded)).collect()
    };
    for (start, sigma, linked) in
        [(Uncertain, 7.9, true), (Uncertain, 8.1, false), (Blind, 0.5, false), (Lost, 0.5, false)]
    {
        let story = fragments(&[(0, SwitchedOn), (5, start)], sigma);
        assert_eq!(links(&story), [None, linked.then_some((0, sigma))], "{start:?} {sigma}");
        assert_eq!(maps(&story).len(), 2 - usize::from(linked), "{start:?} {sigma}");
    }
    // Nor where it does not know the heading.
    for (sigma_rad, linked) in [(1.7, true), (1.9, false)] {
        let mut story = Story::of(&[]);
        keyframes(&mut story, 4);
        for (seq, start) in [(0, SwitchedOn), (2, Uncertain)] {
            story.add(Entry::Fragment(Fragment { first: id("one", seq), start }));
        }
        (1..4).for_each(|to| link_with(&mut story, [to - 1, to], EdgeKind::Odometry, [0.5, sigma_rad]));
        assert_eq!(maps(&story).len(), 2 - usize::from(linked), "{sigma_rad}");
    }
    // Joined fragments that lie apart in time; the later one is linked, and what lies between hangs on the earlier one.
    let mut story = fragments(&[(0, SwitchedOn), (2, Blind), (4, Uncertain), (7, Uncertain)], 2.0);
    link(&mut story, [3, 8], EdgeKind::Closure, 0.1);
    assert_eq!(pieces(&story), [(1, 2), (2, 4), (1, 3)]);
    assert_eq!(links(&story), [None, None, Some((1, 2.0))]);
    assert_eq!(maps(&story), [vec![2, 3, 4, 5, 6, 7, 8], vec![0, 1]], "the larger one first");
    assert!(story.session.maps()[0].has(5) && !story.session.maps()[0].has(1) && !story.session.maps()[1].has(2));
    // What odometry says of a piece may be said where it ends: fragment 2 hangs on nothing, but leads to where the robot is known.
    let mut story = fragments(&[(0, SwitchedOn), (2, Blind), (4, Uncertain)], 2.0);
    link(&mut story, [1, 8], EdgeKind::Closure, 0.1);
    assert_eq!((links(&story), maps(&story).len()), (vec![None, Some((0, 2.0))], 1));
    // Withdrawn links say nothing.
    let number = story.session.recorded_edges().iter().position(|known| known.ends == [3, 4]).unwrap() as u32;
    story.add(Entry::Withdrawn { number });
    assert_eq!(maps(&story), [vec![0, 1, 4, 5, 6, 7, 8], vec![2, 3]]);
}

#[test]
fn sessions_without_fragments_are_one_map_and_joins_know_their_fragments() {
    assert_eq!(Session::<Sweep>::default().maps(), [SeparateMap::default()]);
    let story = fragments(&[], 1.0);
    assert_eq!((pieces(&story), maps(&story)), (vec![(0, 9)], vec![(0..9).collect()]));
    let story = fragments(&[(0, SwitchedOn), (3, Blind), (6, Resumed)], 1.0);
    let joined = |keyframes| story.session.joined_fragments(keyframes).map(|both| both.map(|fragment| fragment.start));
    assert_eq!(joined([8, 1]), Some([Resumed, SwitchedOn]));
    assert_eq!((joined([2, 3]), joined([2, 1]), joined([3, 8])), (Some([SwitchedOn, Blind]), None, None));
    // To the keyframe that is about to be made.
    assert_eq!(joined([0, 9]), Some([SwitchedOn, Resumed]));
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

    #[test]
    fn every_keyframe_is_in_one_piece_and_in_one_map(steps in crate::samples::steps(80)) {
        let session = Story::of(&steps).session;
        let (pieces, maps) = (session.pieces(), session.maps());
        prop_assert_eq!(pieces.iter().map(|piece| piece.keyframes).sum::<usize>(), session.keyframes().len());
        let in_maps = |place: usize| maps.iter().filter(|map| map.has(place)).count();
        prop_assert!((0..session.keyframes().len()).all(|place| in_maps(place) == 1));
        let mut all: Vec<usize> = maps.iter().flat_map(|map| map.pieces.iter().copied()).collect();
        all.sort_unstable();
        prop_assert!(all.into_iter().eq(0..pieces.len()));
        for map in &maps {
            prop_assert!(map.places().all(|place| map.has(place)) && map.places().is_sorted());
            let links: Vec<_> = map.pieces.iter().map(|&at| pieces[at].link.map(|link| link.to)).collect();
            prop_assert_eq!(links.iter().filter(|link| link.is_none()).count(), map.pieces.len().min(1));
            prop_assert!(links.iter().flatten().all(|to| map.pieces.contains(to)));
        }
    }
}
