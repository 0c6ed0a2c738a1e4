//! Loops are closed, look-alikes are not: a sample of the suites.
#![allow(clippy::expect_used, clippy::print_stdout, reason = "a test may fail loudly and show what it measured")]

use crate::support;

use mapwright::{
    Candidate, Correction, Detection, Edge, EdgeKind, KeyframeId, Mapper, Objection, Pose2, Settings, Verdict,
};
use mapwright_sim::{DriveSettings, TrueScan, worlds};
use support::{ate_m, in_parallel, recording};

/// A mapped recording with the true pose of every keyframe.
struct Mapped {
    mapper: Mapper,
    truth: Vec<Pose2>,
    world_from_keyframe: Vec<Pose2>,
}

fn map_with(settings: Settings, scans: &[TrueScan]) -> Mapped {
    let mut mapper = Mapper::new(settings).expect("valid");
    let mut world_from_keyframe = Vec::new();
    for scan in scans {
        mapper.add_scan(&scan.scan);
        world_from_keyframe.resize(mapper.keyframes().len(), scan.world_from_robot);
    }
    let truth = scans.iter().map(|scan| scan.world_from_robot).collect();
    Mapped { mapper, truth, world_from_keyframe }
}

impl Mapped {
    fn closures(&self) -> usize {
        self.mapper.edges().filter(|edge| edge.kind == EdgeKind::Closure).count()
    }

    /// Length of way up to each keyframe.
    fn way_m(&self) -> Vec<f64> {
        let poses = self.mapper.keyframe_poses();
        let mut way_m = vec![0.0];
        for pair in poses.windows(2) {
            way_m.push(way_m[way_m.len() - 1] + pair[0].distance(pair[1]));
        }
        way_m
    }

    /// Closures whose ends lie, in the final map, otherwise than in the world.
    fn wrong_closures(&self) -> usize {
        let closures = self.mapper.edges().filter(|edge| edge.kind == EdgeKind::Closure);
        let wrong = closures.filter(|edge| {
            let [from, to] = [edge.from.seq, edge.to.seq].map(|seq| seq as usize);
            let poses = self.mapper.keyframe_poses();
            let truth = self.world_from_keyframe[from].between(self.world_from_keyframe[to]);
            [edge.from_from_to, poses[from].between(poses[to])].into_iter().any(|found| {
                let error = truth.between(found);
                error.x.hypot(error.y) > 0.3 || error.theta.abs() > 3_f64.to_radians()
            })
        });
        wrong.count()
    }
}

#[test]
fn loops_are_closed_and_the_past_corrected() {
    let results = in_parallel(4, |k| {
        let seed = 900 + k as u64;
        let scans = recording(worlds::loop_of(seed, 300.0), DriveSettings::long_drive(seed));
        let closed = map_with(Settings::default(), &scans);
        let mut open = Settings::default();
        (open.loops.by_pose, open.loops.by_place) = (false, false);
        let open = map_with(open, &scans);
        (
            closed.closures(),
            closed.wrong_closures(),
            ate_m(&closed.mapper, &closed.truth),
            ate_m(&open.mapper, &open.truth),
        )
    });
    for &(closures, wrong, closed_m, open_m) in &results {
        println!("{closures} closures, {wrong} wrong, ATE {closed_m:.3} m, without closing {open_m:.3} m");
        assert!(closures > 0 && wrong == 0);
        assert!(closed_m < 0.25, "{closed_m} m");
    }
    let sum = |of: fn(&(usize, usize, f64, f64)) -> f64| results.iter().map(of).sum::<f64>();
    assert!(sum(|r| r.2) < 0.8 * sum(|r| r.3), "closing must make maps better");
}

#[test]
fn matches_that_old_places_support_are_closures_and_are_judged_as_such() {
    let results = in_parallel(4, |k| {
        let seed = 900 + k as u64;
        let mapped =
            map_with(Settings::default(), &recording(worlds::office_floor(seed), DriveSettings::long_drive(seed)));
        let candidates = mapped.mapper.candidates().iter().filter(|c| c.detection == Detection::Match);
        let accepted: Vec<_> = candidates.filter(|c| c.verdict == Verdict::Accepted).collect();
        let is_edge = |c: &&&Candidate| {
            let is = |edge: &&Edge| (edge.kind, edge.from, edge.to) == (EdgeKind::Closure, c.from, c.to);
            mapped.mapper.edges().any(|edge| is(&edge))
        };
        let way_m = mapped.way_m();
        let apart_m = |a: KeyframeId, b: KeyframeId| (way_m[a.seq as usize] - way_m[b.seq as usize]).abs();
        let old = |edge: &&Edge| edge.kind == EdgeKind::Match && apart_m(edge.from, edge.to) > 21.0;
        let found = |edge: &&Edge| {
            let mut closures = mapped.mapper.edges().filter(|edge| edge.kind == EdgeKind::Closure);
            closures.any(|other| apart_m(edge.from, other.from) < 31.0 && apart_m(edge.to, other.to) < 31.0)
        };
        let old: Vec<&Edge> = mapped.mapper.edges().filter(old).collect();
        let unfound = old.iter().filter(|edge| !found(edge)).count();
        (accepted.len(), accepted.iter().filter(is_edge).count(), mapped.wrong_closures(), old.len(), unfound)
    });
    println!("accepted, edges, wrong; matches with old places, not found there: {results:?}");
    assert!(
        results.iter().all(|&(accepted, edges, wrong, _, unfound)| accepted == edges && wrong == 0 && unfound == 0)
    );
    assert!(results.iter().map(|r| r.0).sum::<usize>() > 0 && results.iter().map(|r| r.3).sum::<usize>() > 0);
}

#[test]
fn what_looks_alike_is_not_taken_for_the_same() {
    let results = in_parallel(8, |k| {
        let case = worlds::look_alike(900 + k as u64);
        let scans: Vec<TrueScan> = case.drive().scans().collect();
        let mapped = map_with(Settings::default(), &scans);
        let all_have_numbers = mapped.mapper.candidates().iter().all(|candidate| {
            let found = candidate.from_from_to.is_some() && candidate.evidence.score.is_some();
            found || candidate.verdict.objection() == Some(Objection::NoMatch)
        });
        (mapped.wrong_closures(), all_have_numbers, ate_m(&mapped.mapper, &mapped.truth))
    });
    for (wrong, all_have_numbers, error_m) in results {
        assert!(wrong == 0 && all_have_numbers && error_m < 0.15, "{wrong} wrong, ATE {error_m} m");
    }
}

#[test]
fn the_chapters_spread_alone_closes_loops() {
    let results = in_parallel(4, |k| {
        let seed = 900 + k as u64;
        let scans = recording(worlds::loop_of(seed, 300.0), DriveSettings::long_drive(seed));
        [Correction::Spread, Correction::None].map(|correction| {
            let mut settings = Settings::default();
            settings.loops.correction = correction;
            let mapped = map_with(settings, &scans);
            assert!(mapped.mapper.candidates().iter().any(|c| c.verdict == Verdict::Accepted));
            ate_m(&mapped.mapper, &mapped.truth)
        })
    });
    println!("spread, only reported: {results:.3?} m");
    let sum = |k: usize| results.iter().map(|errors_m| errors_m[k]).sum::<f64>();
    assert!(sum(0) < 0.8 * sum(1), "closing by the spread must make maps better");
}
