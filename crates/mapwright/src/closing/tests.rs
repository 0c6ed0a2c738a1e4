use super::*;
use crate::store::{Link, NewKeyframe, Store};
use mapwright_geom::{Cov3, Stamp};
use mapwright_record::{EdgeKind, Evidence, RunId};
use mapwright_sensor::{LaserModel, Sweep};
use std::sync::Arc;

/// Keyframes a metre from each other, thirty out and the others back.
fn pose(node: NodeId) -> Pose2 {
    if node < 30 { Pose2::new(f64::from(node), 0.0, 0.0) } else { Pose2::new(60.0 - f64::from(node), 0.0, PI) }
}

/// The way up to so many keyframes.
fn way(count: NodeId) -> Store {
    let mut store = Store::new(RunId::of_robot("walker"), String::new());
    go_on(&mut store, count);
    store
}

/// So many keyframes farther.
fn go_on(store: &mut Store, further: u32) {
    let laser = Arc::new(LaserModel::half_circle("front", 3));
    let sweep = Arc::new(Sweep { laser, codes: vec![2000; 3], step_m: 0.001, twist_per_s: [0.0; 3], scatters: false });
    for _ in 0..further {
        let new = NewKeyframe {
            stamp: Stamp(0),
            sweep: Arc::clone(&sweep),
            left_out: None,
            hardly_fits: false,
            local_from_keyframe: pose(store.len()),
            covariance: Cov3::identity(),
            odometry: Cov3::identity(),
            fused: Cov3::identity(),
            matched: None,
        };
        store.add_keyframe(&new, Link::Odometry, |_, _| true);
    }
}

fn finding(target_from_query: Pose2, objection: Option<Objection>) -> Finding {
    let covariance = Cov3::from_diagonal(&[1e-4, 1e-4, 1e-5].into());
    Finding { target_from_query: Some(target_from_query), covariance, evidence: Evidence::default(), objection }
}

/// A match of the newest keyframe with an old one, off by so much.
fn match_with(store: &Store, from: NodeId, off_m: f64) -> Edge {
    let to = store.len() - 1;
    let between = store.past().pose(from).between(store.past().pose(to));
    let from_from_to = Pose2 { x: between.x + off_m, ..between };
    let (from, to) = (store.id(from), store.id(to));
    Edge { from, to, kind: EdgeKind::Match, from_from_to, information: Cov3::identity() }
}

/// Judges a finding at the newest keyframe and writes down what comes of it: the closures.
fn judge(closing: &mut Closing, store: &mut Store, target: &Target, finding: &Finding) -> Vec<Edge> {
    let to = store.len() - 1;
    let judgement = closing.judge(store.past(), store.session().candidates(), to, (target, finding));
    let number = store.add_candidate(&judgement.judged);
    if judgement.judged.verdict != Verdict::Accepted {
        return Vec::new();
    }
    let mut closures = Vec::new();
    for number in judgement.agreeing.into_iter().chain([number]) {
        let edge = store.accept(number).expect("a candidate that leads somewhere");
        let ends = store.past().nodes([edge.from, edge.to]).expect("they are there");
        closing.accepted(store.past(), ends, &edge);
        closures.push(edge);
    }
    closures
}

#[test]
fn a_match_that_an_old_place_supports_links_it_only_if_it_is_found_there() {
    for objection in [None, Some(Objection::Contradiction), Some(Objection::LittleOverlap)] {
        let (mut closing, mut store) = (Closing::new(&Settings::default()), way(60));
        let known = [Known { first: 0, live: true, uncertainty: Default::default() }];
        let past = store.past();
        assert!(closing.supporting(past, 59, 45, &known).is_none() && closing.links(past, 45), "passed just now");
        assert!(closing.is_unjudged(past, 10) && !closing.links(past, 10), "nobody has looked");
        let (good, bad) = (match_with(&store, 11, 0.05), match_with(&store, 12, 0.3));
        closing.wait(past, good);
        let target = closing.supporting(past, 59, 10, &known).expect("it is old and was not looked at");
        assert_eq!((target.from, target.detection), (10, Detection::Match));
        assert!(!closing.is_unjudged(past, 10) && !closing.links(past, 10), "nobody knows yet");
        assert!(closing.links(past, 45));
        closing.wait(past, bad);
        assert!(closing.supporting(past, 59, 12, &known).is_none(), "it was looked at just now");
        assert!(closing.settle_matches(past, &[]).is_empty(), "the verdict is not there");
        let closures = judge(&mut closing, &mut store, &target, &finding(target.middle, objection));
        let is_closure = objection.is_none();
        // What has waited links if the place was found where the match says.
        let settled = closing.settle_matches(store.past(), &closures);
        assert_eq!(settled, if is_closure { vec![good] } else { Vec::new() });
        settled.into_iter().for_each(|edge| store.add_edge(edge, None));
        let beside_odometry = store.session().edges().filter(|edge| edge.kind != EdgeKind::Odometry);
        assert_eq!(beside_odometry.count(), 2 * usize::from(is_closure));
        assert!(closing.settle_matches(store.past(), &closures).is_empty(), "once");
        if is_closure {
            let (mut doubted, mut store) = (closing.clone(), store.clone());
            let closures = store.closures();
            let ends = store.withdraw(closures[0], Verdict::Withdrawn(Objection::Outvoted));
            assert_eq!((closures.len(), ends), (1, Some([10, 59])));
            doubted.withdrawn([10, 59]);
            assert!(!doubted.links(store.past(), 10), "later evidence speaks against it");
        }
        let links = [10, 12].map(|from| closing.links(store.past(), from));
        assert_eq!((closures.len(), links), (usize::from(is_closure), [is_closure; 2]));
        // Farther on it has to show again, and soon if it was not found: then what was seen before links too.
        for (further, asked) in [(5, !is_closure), (40, true)] {
            let (mut later, mut store) = (closing.clone(), store.clone());
            go_on(&mut store, further);
            later.supports.forget(store.past().way_m);
            let target = later.supporting(store.past(), store.len() - 1, 10, &known);
            assert_eq!(target.is_some(), asked, "{further} m on");
            if let Some(target) = target {
                let closures = judge(&mut later, &mut store, &target, &finding(target.middle, None));
                let settled = later.settle_matches(store.past(), &closures);
                assert_eq!(settled, if further == 5 { vec![good] } else { Vec::new() });
            }
        }
    }
}

#[test]
fn matches_link_unseen_where_nobody_looks() {
    let mut blind = Settings::default();
    blind.loops.by_pose = false;
    let mut everything = Settings::default();
    everything.live.policy = LivePolicy::Everything;
    for settings in [blind, everything] {
        let (mut closing, store) = (Closing::new(&settings), way(60));
        let past = store.past();
        assert!(!closing.is_unjudged(past, 10) && closing.links(past, 10));
        assert!(closing.supporting(past, 59, 10, &[]).is_none());
    }
}
