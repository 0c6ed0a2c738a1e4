use super::waiting::REDRAWN_AT_MOST;
use super::*;
use mapwright_grid::CountGrid;
use mapwright_sensor::Sweep;
use mapwright_sim::{Drive, DriveSettings, worlds};

/// What is drawn of keyframes along a corridor, 0.5 m apart, at their true poses.
fn corridor(count: usize) -> (Vec<Option<Arc<Sweep>>>, Vec<Pose2>) {
    let site = worlds::corridor(1, worlds::CorridorWalls::Features);
    let (mut sweeps, mut poses) = (Vec::new(), Vec::<Pose2>::new());
    for recorded in Drive::new(site.into(), DriveSettings::default()).scans() {
        let far = poses.last().is_none_or(|last| last.distance(recorded.world_from_robot) > 0.5);
        if far && poses.len() < count {
            let (sweep, _) = Sweep::from_scan(&recorded.scan, [0.0; 3]);
            sweeps.push(Some(Arc::new(sweep)));
            poses.push(recorded.world_from_robot);
        }
    }
    (sweeps, poses)
}

fn gated() -> Settings {
    let mut settings = Settings::default();
    settings.live.policy = LivePolicy::Gated;
    settings.live.gate_m = 0.2;
    settings
}

/// A covariance of one step of the chain, of which `sigma_m` adds up.
fn step(sigma_m: f64) -> Cov3 {
    let variance_m2 = sigma_m * sigma_m / crate::patches::DISPLACEMENT_SHARE;
    Cov3::from_diagonal(&nalgebra::Vector3::new(variance_m2, variance_m2, 1e-12))
}

/// Inserts keyframes each `sigma_m` uncertain relative to the one before, with three scans between them.
fn drive(sweeps: &[Option<Arc<Sweep>>], poses: &[Pose2], sigma_m: f64, closure: Option<(u32, u32)>) -> LocalMapping {
    let settings = gated();
    let mut live = LocalMapping::new(&settings);
    for node in 0..poses.len() {
        let frames = Frames { drawn: &sweeps[..=node], world_from_robot: &poses[..=node] };
        let node = NodeId::at(node);
        if let Some(before) = node.before() {
            live.connect(before, &step(sigma_m), Spacing::default());
        }
        if let Some((_, to)) = closure.filter(|&(at, _)| at == node.number()) {
            live.connect(NodeId::new(to), &step(0.01), Spacing::default());
        }
        live.insert(&settings, frames, node, 5.0);
        for inserted in [true, false, false, false] {
            live.follow(&settings, frames, inserted);
        }
    }
    live
}

/// Counts of the keyframes that are drawn, drawn anew.
fn redrawn(live: &LocalMapping, sweeps: &[Option<Arc<Sweep>>], poses: &[Pose2]) -> CountGrid {
    let mut map = CountGrid::new(0.05);
    let (mut points, mut table) = (SweepPoints::default(), BeamTable::default());
    for node in (0..poses.len()).filter(|&node| live.views[node].drawn_at.is_some()) {
        let sweep = sweeps[node].as_ref().expect("it is drawn");
        points.fill(sweep, &mut table, Settings::default().scan.free_range_m);
        points.fill_normals();
        map.draw(&points, poses[node], Change::Add, &mut Vec::new());
    }
    map
}

fn finish(live: &mut LocalMapping, sweeps: &[Option<Arc<Sweep>>], world_from_robot: &[Pose2]) {
    live.settle_due(&gated(), Frames { drawn: sweeps, world_from_robot }, usize::MAX);
}

/// A scan like that of a keyframe meets what is there.
fn scan(live: &mut LocalMapping, sweeps: &[Option<Arc<Sweep>>], poses: &[Pose2], node: usize) {
    let (settings, mut points) = (gated(), SweepPoints::default());
    if let Some(sweep) = &sweeps[node] {
        points.fill(sweep, &mut BeamTable::default(), settings.scan.free_range_m);
    }
    live.meet(&settings, Frames { drawn: sweeps, world_from_robot: poses }, &points.hits, poses[node]);
}

#[test]
fn certain_keyframes_stay_and_uncertain_ones_leave_behind_the_robot() {
    let (sweeps, poses) = corridor(60);
    assert_eq!(drive(&sweeps, &poses, 0.01, None).report.keyframes, 60);
    let mut live = drive(&sweeps, &poses, 0.12, None);
    finish(&mut live, &sweeps, &poses);
    // 17 steps of 0.12 m make 0.5 m; patches and a search a metre ago blur that, and beyond 20 m nobody asks.
    let drawn: Vec<bool> = live.views.iter().map(|view| view.drawn_at.is_some()).collect();
    assert!(drawn[52..].iter().all(|&drawn| drawn), "{drawn:?}");
    assert!(drawn[22..35].iter().all(|&drawn| !drawn), "{drawn:?}");
    assert_eq!(live.report.keyframes, drawn.iter().filter(|&&drawn| drawn).count());
}

#[test]
fn what_remains_is_drawn_exactly_once() {
    let (sweeps, poses) = corridor(60);
    for closure in [None, Some((50, 33))] {
        let mut live = drive(&sweeps, &poses, 0.12, closure);
        finish(&mut live, &sweeps, &poses);
        assert!(live.report.gated_out > 5, "{:?}", live.report);
        assert!(live.map.counts().to_bytes() == redrawn(&live, &sweeps, &poses).to_bytes());
    }
}

#[test]
fn a_link_to_a_place_that_was_out_lets_it_in_again_when_a_scan_meets_it() {
    let (sweeps, poses) = corridor(60);
    let mut live = drive(&sweeps, &poses, 0.12, Some((55, 34)));
    finish(&mut live, &sweeps, &poses);
    let drawn = |live: &LocalMapping, node: usize| live.views[node].drawn_at.is_some();
    assert!(
        [33, 34].map(NodeId::new).into_iter().all(|node| live.is_live(node)) && live.report.let_in == 0,
        "{:?}",
        live.report
    );
    assert!(!drawn(&live, 33) && !drawn(&live, 34));
    scan(&mut live, &sweeps, &poses, 33);
    finish(&mut live, &sweeps, &poses);
    assert!(drawn(&live, 33) && drawn(&live, 34) && live.report.let_in > 0, "{:?}", live.report);
    live.map.refresh();
    assert!(live.map.counts().to_bytes() == redrawn(&live, &sweeps, &poses).to_bytes());
}

/// The keyframes from `first` on stay, those before are carried along the corridor.
fn corrected(poses: &[Pose2], first: usize) -> Vec<Pose2> {
    let by = |node: usize| if node < first { 0.3 } else { 0.0 };
    poses.iter().enumerate().map(|(node, pose)| Pose2 { x: pose.x + by(node), ..*pose }).collect()
}

#[test]
fn what_a_correction_moves_is_drawn_where_it_belongs_when_a_scan_meets_it() {
    let (sweeps, poses) = corridor(60);
    for first in [10, 50] {
        let mut live = drive(&sweeps, &poses, 0.001, None);
        let moved = corrected(&poses, first);
        let frames = Frames { drawn: &sweeps, world_from_robot: &moved };
        live.carry(&gated(), &poses, frames);
        finish(&mut live, &sweeps, &moved);
        let at = |live: &LocalMapping, node: usize| live.views[node].drawn_at;
        // Where most has moved all begins anew, with the newest; where little has it stays until it is met.
        let newest = (0..60).filter(|&node| at(&live, node).is_some()).count();
        assert_eq!(newest, if first == 10 { 60 } else { MET_AT_ONCE }, "{:?}", live.report);
        assert_eq!(at(&live, 5), if first == 10 { Some(poses[5]) } else { None });
        for node in 0..60 {
            scan(&mut live, &sweeps, &moved, node);
        }
        finish(&mut live, &sweeps, &moved);
        live.map.refresh();
        assert!((0..60).all(|node| at(&live, node) == Some(moved[node])), "{:?}", live.report);
        assert!(live.map.counts().to_bytes() == redrawn(&live, &sweeps, &moved).to_bytes());
    }
}

/// Out, and back beside it: the start is 30 steps old when the robot is beside it again.
fn out_and_back() -> (Vec<Option<Arc<Sweep>>>, Vec<Pose2>) {
    let (sweeps, mut poses) = corridor(60);
    for back in 30..60 {
        let there = poses[59 - back];
        poses[back] = Pose2 { y: there.y + 10.0, ..there };
    }
    (sweeps, poses)
}

#[test]
fn what_is_too_uncertain_to_be_matched_against_leaves_before_a_scan_would_be() {
    let (sweeps, poses) = out_and_back();
    let mut live = drive(&sweeps, &poses, 0.05, None);
    finish(&mut live, &sweeps, &poses);
    let drawn = |live: &LocalMapping, node: usize| live.views[node].drawn_at.is_some();
    scan(&mut live, &sweeps, &poses, 59);
    assert!(live.report.gated_out == 0 && drawn(&live, 0), "no scan has met it: {:?}", live.report);
    scan(&mut live, &sweeps, &poses, 0);
    assert!(live.report.gated_out > 0 && !drawn(&live, 0) && drawn(&live, 59), "{:?}", live.report);
    finish(&mut live, &sweeps, &poses);
    live.map.refresh();
    assert!(live.map.counts().to_bytes() == redrawn(&live, &sweeps, &poses).to_bytes());
}

#[test]
fn of_a_place_that_is_drawn_again_some_views_stay() {
    let (sweeps, poses) = corridor(2);
    let most = gated().live.views_per_area as usize;
    let (sweeps, poses) = (vec![sweeps[1].clone(); most], vec![poses[1]; most]);
    let mut live = drive(&sweeps, &poses, 0.001, None);
    let frames = Frames { drawn: &sweeps, world_from_robot: &poses };
    for is_live in [false, true] {
        live.flip(&gated(), frames, Flip { patch: 0, live: is_live, distance2: 0.0 });
        finish(&mut live, &sweeps, &poses);
        assert_eq!(live.report.keyframes, 0, "out, and not met yet");
    }
    live.note_waiting(frames);
    scan(&mut live, &sweeps, &poses, 0);
    finish(&mut live, &sweeps, &poses);
    live.map.refresh();
    assert_eq!((live.report.keyframes, live.report.superseded), (REDRAWN_AT_MOST, (most - REDRAWN_AT_MOST) as u64));
    assert!(live.map.counts().to_bytes() == redrawn(&live, &sweeps, &poses).to_bytes());
}

#[test]
fn a_keyframe_that_is_to_leave_can_be_dropped() {
    let (sweeps, poses) = corridor(60);
    let mut live = drive(&sweeps, &poses, 0.001, None);
    let frames = Frames { drawn: &sweeps, world_from_robot: &poses };
    live.flip(&gated(), frames, Flip { patch: 0, live: false, distance2: 0.0 });
    let drawn = |live: &LocalMapping, node: NodeId| live.views[node.index()].drawn_at.is_some();
    let leaving = live.due.iter().copied().find(|&node| drawn(&live, node));
    let leaving = leaving.expect("what leaves is taken out a few at a time");
    live.drop(&gated(), frames, leaving);
    assert!(!drawn(&live, leaving));
    finish(&mut live, &sweeps, &poses);
    live.map.refresh();
    assert!(live.map.counts().to_bytes() == redrawn(&live, &sweeps, &poses).to_bytes());
}

#[test]
fn a_keyframe_that_is_left_out_is_a_place_and_nothing_drawn() {
    let (mut sweeps, poses) = corridor(40);
    sweeps[20] = None;
    let mut live = drive(&sweeps, &poses, 0.001, None);
    let frames = Frames { drawn: &sweeps, world_from_robot: &poses };
    let is_out = |live: &LocalMapping| {
        live.views[20].drawn_at.is_none() && !live.areas.values().flatten().any(|k| k.index() == 20)
    };
    assert!(
        is_out(&live) && [20, 39].map(NodeId::new).into_iter().all(|node| live.is_live(node)),
        "it is known where it is, and what follows"
    );
    for is_live in [false, true] {
        for patch in 0..5 {
            live.flip(&gated(), frames, Flip { patch, live: is_live, distance2: 0.0 });
        }
        finish(&mut live, &sweeps, &poses);
    }
    live.note_waiting(frames);
    scan(&mut live, &sweeps, &poses, 20);
    finish(&mut live, &sweeps, &poses);
    live.map.refresh();
    assert!(is_out(&live));
    assert!(live.map.counts().to_bytes() == redrawn(&live, &sweeps, &poses).to_bytes());
}

#[test]
fn a_place_seen_again_and_again_keeps_the_newest_views() {
    let (sweeps, poses) = corridor(2);
    let (sweep, pose) = (&sweeps[1], poses[1]);
    let settings = gated();
    let (sweeps, poses) = (vec![sweep.clone(); 200], vec![pose; 200]);
    let mut live = drive(&sweeps, &poses, 0.001, None);
    finish(&mut live, &sweeps, &poses);
    let most = settings.live.views_per_area as usize;
    assert_eq!(live.report.keyframes, most);
    assert!(live.views[200 - most..].iter().all(|view| view.drawn_at.is_some()));
    assert!(live.map.counts().to_bytes() == redrawn(&live, &sweeps, &poses).to_bytes());
}
