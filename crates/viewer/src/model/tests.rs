use super::*;
use crate::news::{Robot, View};
use crate::wire::TILE_SIDE;
use mapwright_geom::{Pose2, Pose3};
use mapwright_record::Status;
use mapwright_sensor::{LaserModel, LaserScan, Sweep};
use nalgebra::Matrix3;
use proptest::prelude::*;
use std::sync::Arc;

const PEN: Pen = Pen { resolution_m: 0.05, free_range_m: 4.0, passes_per_hit: 5 };

fn seen(seed: u32, beams: usize) -> Seen {
    let laser: Arc<LaserModel> = LaserModel { range_max_m: 12.0, ..LaserModel::half_circle("laser", beams) }.into();
    let range_m = |beam: usize| {
        let noise = (seed.wrapping_mul(7919).wrapping_add(beam as u32 * 104_729) >> 7) % 1000;
        if noise > 900 { 12.0 } else { 0.5 + noise as f32 * 0.01 }
    };
    let ranges_m = (0..beams).map(range_m).collect();
    let scan = LaserScan { stamp: mapwright_geom::Stamp(0), laser, ranges_m, odom_from_robot: None };
    Seen::Plane(Arc::new(Sweep::from_scan(&scan, [0.0; 3]).0))
}

fn pose(x: f64, y: f64, theta: f64) -> Pose3 {
    Sweep::in_space(Pose2::new(x, y, theta))
}

fn placed(seed: u32, at: Pose3) -> Placed {
    Placed { seen: seen(seed, 40), map_from_robot: at, sigma_m: Some(0.02), status: Status::Tracking, is_break: false }
}

fn settle(model: &mut Model, scene: &mut Scene) {
    model.settle(scene);
    while !model.is_settled() || model.picture().has_changed() {
        model.settle(scene);
    }
}

/// The tiles that a scene tells, of which the last told counts.
fn tiles(scene: &Scene) -> std::collections::BTreeMap<[u8; 8], Vec<u8>> {
    let message = scene.since(0, usize::MAX).map_or(Vec::new(), |(message, _)| message);
    let word = |at: usize| u32::from_le_bytes(message[at..at + 4].try_into().unwrap());
    let (mut at, mut tiles) = (4, std::collections::BTreeMap::new());
    while at < message.len() {
        let length = word(at + 4) as usize;
        if word(at) == wire::TILE {
            let bytes = &message[at + 8..at + 8 + length];
            tiles.insert(bytes[..8].try_into().unwrap(), bytes.to_vec());
        }
        at += 8 + length.next_multiple_of(4);
    }
    tiles
}

/// Whether all that is known is told, and nothing else.
fn assert_told(keyframes: &[(u32, Pose3)], scene: &Scene) {
    let mut fresh = Picture::new(PEN);
    for (number, (seed, at)) in keyframes.iter().enumerate() {
        fresh.redraw(number, Some((&seen(*seed, 40), at)));
    }
    let side = TILE_SIDE as i32;
    let mut told = tiles(scene);
    let known: BTreeSet<(i32, i32)> =
        fresh.counts().known_cells().map(|(x, y, _, _)| (x.div_euclid(side), y.div_euclid(side))).collect();
    for &tile in &known {
        let bytes = wire::tile(tile, &fresh.cells(tile));
        assert_eq!(told.remove(&bytes[..8]), Some(bytes), "tile {tile:?}");
    }
    assert!(told.values().all(|tile| tile[8..].chunks(2).all(|run| run[1] == 128)), "what is not known is told");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn the_map_follows_corrections_exactly(
        start in prop::collection::vec((0_u32..50, -20.0..20.0_f64, -20.0..20.0_f64, -3.0..3.0_f64), 1..12),
        moves in prop::collection::vec((0_usize..12, -20.0..20.0_f64, -20.0..20.0_f64, -3.0..3.0_f64), 0..12),
        left_out in 0_usize..40,
    ) {
        let (mut model, mut scene) = (Model::new(PEN, 0), Scene::default());
        let mut keyframes: Vec<(u32, Pose3)> = start.iter().map(|&(seed, x, y, theta)| (seed, pose(x, y, theta))).collect();
        let news = News { keyframes: keyframes.iter().map(|&(seed, at)| placed(seed, at)).collect(), ..News::default() };
        model.apply(news, &mut scene);
        settle(&mut model, &mut scene);
        assert_told(&keyframes, &scene);
        for (number, x, y, theta) in moves {
            let number = number % keyframes.len();
            keyframes[number].1 = pose(x, y, theta);
            model.apply(News { moved: vec![(number as u32, pose(x, y, theta))], ..News::default() }, &mut scene);
            settle(&mut model, &mut scene);
        }
        assert_told(&keyframes, &scene);
        if left_out < keyframes.len() {
            model.apply(News { redrawn: vec![(left_out as u32, Seen::Nothing)], ..News::default() }, &mut scene);
            settle(&mut model, &mut scene);
            // the last goes, so that the others keep their numbers
            let mut rest = keyframes.clone();
            rest.remove(left_out);
            assert_told(&rest, &scene);
        }
    }
}

#[test]
fn what_is_new_twice_amounts_to_one() {
    let first = || News {
        keyframes: vec![placed(1, pose(0.0, 0.0, 0.0)), placed(2, pose(1.0, 0.0, 0.0))],
        at_s: Some(1.0),
        ..News::default()
    };
    let second = || News {
        moved: vec![(1, pose(1.0, 0.5, 0.0))],
        keyframes: vec![placed(3, pose(2.0, 0.5, 0.0))],
        ..News::default()
    };
    let (mut one, mut apart) = (Model::new(PEN, 0), Model::new(PEN, 0));
    let (mut scene_one, mut scene_apart) = (Scene::default(), Scene::default());
    let mut both = first();
    both.add(second());
    assert_eq!(both.at_s, Some(1.0));
    one.apply(both, &mut scene_one);
    settle(&mut one, &mut scene_one);
    for news in [first(), second()] {
        apart.apply(news, &mut scene_apart);
        settle(&mut apart, &mut scene_apart);
    }
    assert_eq!(tiles(&scene_one), tiles(&scene_apart));
}

#[test]
fn numbers_beyond_reason_change_nothing() {
    let (mut model, mut scene) =
        (Model::new(Pen { resolution_m: f64::NAN, free_range_m: -1.0, passes_per_hit: 0 }, 0), Scene::default());
    let far = pose(f64::INFINITY, 0.0, f64::NAN);
    let robot = Robot {
        map_from_robot: far,
        position_m2: Matrix3::from_element(f64::NAN),
        heading_sigma_rad: f64::NAN,
        status: Status::Lost,
        is_joined: false,
    };
    let closure = Closure { from: 0, to: 9, verdict: Verdict::Accepted };
    let news = News {
        keyframes: vec![placed(1, far), placed(1, pose(1e6, -1e6, 0.0))],
        moved: vec![(77, far)],
        redrawn: vec![(77, Seen::Nothing)],
        closures: vec![(u32::MAX, closure), (1, closure)],
        robot: Some(robot),
        ..News::default()
    };
    model.apply(news, &mut scene);
    model.settle(&mut scene);
    model.settle(&mut scene);
    assert!(scene.version() > 0 && scene.bytes() < 100_000, "{}", scene.bytes());
}
