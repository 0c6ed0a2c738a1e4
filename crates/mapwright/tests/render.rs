//! The global map follows corrections, and an exported one is the one drawn from scratch, to the bit.
#![allow(clippy::expect_used, reason = "a test may fail loudly")]

mod support;

use mapwright::{CountGrid, Doubted, GlobalMap, Keyframe, Mapper, Pose2, Settings};
use mapwright_grid::{Change, HitCell};
use mapwright_sensor::{BeamTable, SweepPoints};
use mapwright_sim::{DriveSettings, worlds};
use proptest::prelude::*;
use std::sync::LazyLock;
use support::recording;

/// A mapper after a minute in an office.
static MAPPED: LazyLock<Mapper> = LazyLock::new(|| {
    let mut mapper = Mapper::new(Settings::default()).expect("valid");
    let settings = DriveSettings { seed: 3, duration_s: 60.0, ..DriveSettings::default() };
    recording(worlds::office_floor(3), settings).iter().for_each(|recorded| {
        mapper.add_scan(&recorded.scan);
    });
    assert!(mapper.keyframes().len() > 100, "{}", mapper.keyframes().len());
    mapper
});

/// Drawn one after the other by the definition.
fn by_definition(keyframes: &[Keyframe], poses: &[Option<Pose2>]) -> CountGrid {
    let settings = Settings::default();
    let mut map = CountGrid::new(settings.map.resolution_m);
    let (mut points, mut table) = (SweepPoints::default(), BeamTable::default());
    for (keyframe, pose) in keyframes.iter().zip(poses) {
        let Some(pose) = *pose else { continue };
        points.fill(&keyframe.sweep, &mut table, settings.scan.free_range_m);
        points.fill_normals();
        map.draw(&points, pose, Change::Add, &mut Vec::new());
    }
    map
}

/// Everything that can be seen of it in the order it is seen.
fn seen(map: &CountGrid) -> impl PartialEq + use<> {
    let slots: Vec<_> = (0..map.slot_count() as u32).map(|slot| *map.cell(slot)).collect();
    (map.known_cells().collect::<Vec<_>>(), slots, map.tile_count(), map.to_bytes())
}

/// What may happen to the keyframes between two looks at the map.
#[derive(Debug, Clone)]
enum Event {
    New(usize),
    /// The keyframes from a share of all on are carried by a small motion.
    Corrected(f64, [f64; 3]),
    Dropped(f64),
}

fn events() -> impl Strategy<Value = Vec<(Event, bool)>> {
    let size = prop_oneof![Just(0.001), Just(0.02), Just(1.0)];
    let by = [-1.0..1.0, -1.0..1.0, -0.3..0.3_f64];
    let event = prop_oneof![
        (1..60_usize).prop_map(Event::New),
        (0.0..1.0, by, size).prop_map(|(from, by, size)| Event::Corrected(from, by.map(|by| by * size))),
        (0.0..1.0).prop_map(Event::Dropped),
    ];
    proptest::collection::vec((event, any::<bool>()), 1..12)
}

fn happen(event: &Event, all: &[Option<Pose2>], poses: &mut Vec<Option<Pose2>>) {
    let at = |share: f64| (share * poses.len() as f64) as usize;
    match *event {
        Event::New(count) => poses.extend(all.iter().skip(poses.len()).take(count)),
        Event::Dropped(share) => {
            let at = at(share);
            poses[at..].iter_mut().take(1).for_each(|pose| *pose = None);
        }
        Event::Corrected(from, [x, y, theta]) => {
            let from = at(from);
            poses[from..].iter_mut().flatten().for_each(|pose| *pose = Pose2::new(x, y, theta) * *pose);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(10))]

    #[test]
    fn an_exported_map_is_the_one_drawn_from_scratch(events in events()) {
        let (keyframes, all) = (MAPPED.keyframes(), MAPPED.render_poses());
        let mut poses: Vec<_> = all[..40].to_vec();
        let mut maps = [1, 2, 4].map(|threads| (threads, GlobalMap::new(&Settings::default())));
        for (event, look) in events {
            happen(&event, &all, &mut poses);
            let keyframes = &keyframes[..poses.len()];
            if !look {
                continue;
            }
            let moved = maps.each_mut().map(|(threads, map)| map.follow(keyframes, &poses, *threads));
            prop_assert_eq!(moved, [moved[0]; 3]);
            let render_poses: Vec<_> = (0..poses.len()).map(|k| maps[0].1.render_pose(k)).collect();
            let lazy = by_definition(keyframes, &render_poses).to_bytes();
            for (_, map) in &maps {
                prop_assert!(map.counts().to_bytes() == lazy, "a lazy map is that of its render poses");
            }
        }
        let keyframes = &keyframes[..poses.len()];
        let scratch = by_definition(keyframes, &poses).to_bytes();
        let mut fresh = GlobalMap::new(&Settings::default());
        let fresh = seen(fresh.export(keyframes, &poses, 1));
        for (threads, map) in &mut maps {
            let exported = map.export(keyframes, &poses, *threads);
            prop_assert!(exported.to_bytes() == scratch);
            prop_assert!(seen(exported) == fresh, "{threads} threads");
        }
    }
}

#[test]
fn a_map_without_normals_is_the_same_but_for_these() {
    let (keyframes, poses) = (MAPPED.keyframes(), MAPPED.render_poses());
    let mut maps = [GlobalMap::new(&Settings::default()), GlobalMap::without_normals(&Settings::default())];
    let [with, without] = maps.each_mut().map(|map| map.export(keyframes, &poses, 2));
    assert!(with.known_cells().eq(without.known_cells()));
    assert_eq!(with.slot_count(), without.slot_count());
    for slot in 0..with.slot_count() as u32 {
        let (with, without) = (with.cell(slot), *without.cell(slot));
        let bare = HitCell { normals: 0, points: 0, sum_nxx: 0, sum_nxy: 0, sum_nx: 0, sum_ny: 0, ..*with };
        assert_eq!(without, bare);
    }
}

#[test]
fn only_what_may_have_moved_by_a_quarter_of_a_cell_is_drawn_anew() {
    let (keyframes, poses) = (MAPPED.keyframes(), MAPPED.render_poses());
    let moved = |by: Pose2| poses.iter().map(|pose| pose.map(|pose| pose * by)).collect::<Vec<_>>();
    let mut map = GlobalMap::new(&Settings::default());
    assert_eq!(map.follow(keyframes, &poses, 2), keyframes.len());
    assert_eq!(map.follow(keyframes, &poses, 2), 0);
    assert_eq!(map.follow(keyframes, &moved(Pose2::new(0.0, 0.012, 0.0)), 2), 0);
    assert_eq!(map.follow(keyframes, &moved(Pose2::new(0.0, 0.013, 0.0)), 2), keyframes.len());
    // A rotation moves a point 3 m away by as much as 4.3 mrad of 3 m.
    assert_eq!(map.follow(keyframes, &moved(Pose2::new(0.0, 0.013, 1e-5)), 2), 0);
    assert!(map.follow(keyframes, &moved(Pose2::new(0.0, 0.013, 0.0126 / 3.0)), 2) > keyframes.len() / 2);
}

#[test]
fn dropped_keyframes_leave_the_map_whoever_draws_it() {
    let mut mapper = MAPPED.clone();
    let mut map = GlobalMap::new(mapper.settings());
    map.follow(mapper.keyframes(), &mapper.render_poses(), 2);
    let with = map.counts().to_bytes();
    assert!(with == mapper.render().to_bytes());
    let dropped = [3, 70].map(|k: usize| mapper.keyframes()[k].id);
    assert!(dropped.into_iter().all(|id| mapper.drop_keyframe(id)));
    assert_eq!(map.follow(mapper.keyframes(), &mapper.render_poses(), 2), 2);
    assert!(map.counts().to_bytes() != with);
    assert!(map.counts().to_bytes() == mapper.render_with(1).to_bytes());
    let all_at_once = mapper.render_with(3);
    assert!(seen(map.export(mapper.keyframes(), &mapper.render_poses(), 2)) == seen(&all_at_once));
}

#[test]
fn a_scan_that_hardly_fitted_is_drawn_where_it_agrees_with_the_others_only() {
    let (keyframes, poses) = (MAPPED.keyframes(), MAPPED.render_poses());
    let settings = Settings::default();
    let doubted = [40, 80].map(|k| Doubted { keyframe: k, sweep: keyframes[k as usize].sweep.clone() });
    let mut map = GlobalMap::new(&settings);
    assert_eq!(map.export_believed(keyframes, &poses, &doubted, 2), []);
    assert!(map.counts().to_bytes() == by_definition(keyframes, &poses).to_bytes());
    // The one turned as by a match that went astray: its beams end beyond the walls and before them.
    let turned = poses[40].expect("none was dropped") * Pose2::new(0.0, 0.0, 0.35);
    let mut astray = poses.clone();
    astray[40] = Some(turned);
    assert_eq!(map.export_believed(keyframes, &astray, &doubted, 2), [40]);
    astray[40] = None;
    assert!(map.counts().to_bytes() == by_definition(keyframes, &astray).to_bytes());
    // Where the others show nothing they do not contradict.
    let far_away = Pose2::new(500.0, 0.0, 0.0);
    astray[40] = Some(far_away);
    assert_eq!(map.export_believed(keyframes, &astray, &doubted, 1), []);
    assert_eq!(map.render_pose(40), Some(far_away));
    // Numbers of keyframes that there are not are nobody's.
    let nobody = [Doubted { keyframe: u32::MAX, ..doubted[0].clone() }];
    assert_eq!(map.export_believed(keyframes, &poses, &nobody, 2), []);
}

/// Every other beam sees things nearer than they are, three scans long.
#[test]
fn the_map_lacks_the_scans_that_hardly_fitted_and_the_mapper_keeps_them() {
    const BAD: std::ops::Range<usize> = 40..43;
    let mut mapper = Mapper::new(Settings::default()).expect("valid");
    let mut recordings = recording(worlds::office_floor(3), DriveSettings { seed: 3, ..DriveSettings::default() });
    let mut bad = Vec::new();
    for (number, recorded) in recordings.iter_mut().step_by(10).take(BAD.end + 5).enumerate() {
        if BAD.contains(&number) {
            recorded.scan.ranges_m.iter_mut().step_by(2).for_each(|range_m| *range_m *= 0.7);
        }
        let made = mapper.add_scan(&recorded.scan).keyframe.filter(|_| BAD.contains(&number));
        bad.extend(made.map(|id| id.seq));
    }
    assert_eq!(bad.len(), BAD.len());
    assert!(mapper.doubted().iter().map(|doubted| doubted.keyframe).eq(bad.iter().copied()));
    assert!(bad.iter().all(|&seq| !mapper.keyframes()[seq as usize].sweep.is_blank()), "loops may be found by them");
    let mut poses = mapper.render_poses();
    bad.iter().for_each(|&seq| poses[seq as usize] = None);
    assert!(mapper.render().to_bytes() == by_definition(mapper.keyframes(), &poses).to_bytes());
}
