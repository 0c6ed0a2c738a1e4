//! The global map follows corrections, and an exported one is the one drawn from scratch, to the bit.
#![allow(clippy::expect_used, reason = "a test may fail loudly")]

use crate::support;

use mapwright::{
    Beams, CountGrid, Entry, Fragment, FragmentStart, GlobalMap, Keyframe, KeyframeId, LeftOut, LeftOutReason, Mapper,
    Pose2, Run, Session, Settings, Snapshot, Sweep,
};
use mapwright_grid::{Change, HitCell};
use mapwright_sensor::{BeamTable, SweepPoints};
use mapwright_sim::{DriveSettings, worlds};
use proptest::prelude::*;
use std::sync::{Arc, LazyLock};
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

/// The first keyframes of the mapper as a session of their own, with what is left out of each; those of these numbers hardly fit.
fn session(count: usize, hardly_fits: &[usize]) -> Session {
    let mut session = Session::default();
    add(&mut session, Entry::Run(Run { id: MAPPED.keyframes()[0].id.run(), settings: String::new() }));
    (0..count).for_each(|k| add_keyframe(&mut session, k, hardly_fits.contains(&k)));
    session
}

fn add(session: &mut Session, entry: Entry) {
    session.add(entry).expect("it fits");
}

/// The mapper's keyframe of this number as the next one, and what is left out of it.
fn add_keyframe(session: &mut Session, number: usize, hardly_fits: bool) {
    let mapped = MAPPED.session();
    // There are no scans, so it is of the first.
    let keyframe = Arc::new(Keyframe { scan: 0, hardly_fits, ..(*mapped.keyframes()[number]).clone() });
    let id = keyframe.id;
    add(session, Entry::Keyframe { keyframe, map_from_keyframe: mapped.map_from_keyframe()[number] });
    for left_out in mapped.left_out().iter().filter(|left_out| left_out.keyframe == id) {
        add(session, Entry::LeftOut(left_out.clone()));
    }
}

fn leave_out(session: &mut Session, number: usize, beams: Beams) {
    let keyframe = session.keyframes()[number].id;
    add(session, Entry::LeftOut(LeftOut { keyframe, beams, reason: LeftOutReason::Asked }));
}

/// A correction moves the keyframes from one on.
fn correct(session: &mut Session, from: usize, moved: impl Fn(Pose2) -> Pose2) {
    let poses = session.keyframes().iter().zip(session.map_from_keyframe()).skip(from);
    let map_from_keyframe = poses.map(|(keyframe, &pose)| (keyframe.id, moved(pose))).collect();
    let number = session.corrections() + 1;
    add(session, Entry::Snapshot(Snapshot { number, map_from_keyframe }));
}

/// Drawn one after the other by the definition.
fn by_definition(drawn: &[Option<Arc<Sweep>>], poses: impl IntoIterator<Item = Option<Pose2>>) -> CountGrid {
    let settings = Settings::default();
    let mut map = CountGrid::new(settings.map.resolution_m);
    let (mut points, mut table) = (SweepPoints::default(), BeamTable::default());
    for (sweep, pose) in drawn.iter().zip(poses) {
        let Some((sweep, pose)) = sweep.as_ref().zip(pose) else { continue };
        points.fill(sweep, &mut table, settings.scan.free_range_m);
        points.fill_normals();
        map.draw(&points, pose, Change::Add, &mut Vec::new());
    }
    map
}

/// All that a session's map consists of.
fn whole(session: &Session) -> CountGrid {
    by_definition(session.drawn(), session.map_from_keyframe().iter().copied().map(Some))
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
    /// Nothing of a keyframe is to be drawn any more.
    LeftOut(f64),
    /// Every so many beams of a keyframe are left out.
    BeamsLeftOut(f64, usize),
}

fn events() -> impl Strategy<Value = Vec<(Event, bool)>> {
    let size = prop_oneof![Just(0.001), Just(0.02), Just(1.0)];
    let by = [-1.0..1.0, -1.0..1.0, -0.3..0.3_f64];
    let event = prop_oneof![
        (1..60_usize).prop_map(Event::New),
        (0.0..1.0, by, size).prop_map(|(from, by, size)| Event::Corrected(from, by.map(|by| by * size))),
        (0.0..1.0).prop_map(Event::LeftOut),
        (0.0..1.0, 2..9_usize).prop_map(|(at, every)| Event::BeamsLeftOut(at, every)),
    ];
    proptest::collection::vec((event, any::<bool>()), 1..12)
}

fn happen(event: &Event, session: &mut Session) {
    let known = session.keyframes().len();
    let at = |share: f64| (share * known as f64) as usize;
    match *event {
        Event::New(count) => {
            let all = known..MAPPED.keyframes().len();
            all.take(count).for_each(|k| add_keyframe(session, k, false));
        }
        Event::LeftOut(share) => leave_out(session, at(share), Beams::All),
        Event::BeamsLeftOut(share, every) => {
            let beams = session.keyframes()[at(share)].sweep.codes.len() as u32;
            leave_out(session, at(share), Beams::These((0..beams).step_by(every).collect()));
        }
        Event::Corrected(from, [x, y, theta]) => correct(session, at(from), |pose| Pose2::new(x, y, theta) * pose),
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(10))]

    #[test]
    fn an_exported_map_is_the_one_drawn_from_scratch(events in events()) {
        let mut session = session(40, &[]);
        let mut maps = [1, 2, 4].map(|threads| (threads, GlobalMap::new(&Settings::default())));
        for (event, look) in events {
            happen(&event, &mut session);
            if !look {
                continue;
            }
            let moved = maps.each_mut().map(|(threads, map)| map.follow(&session, *threads));
            prop_assert_eq!(moved, [moved[0]; 3]);
            let render_poses = (0..session.keyframes().len()).map(|k| maps[0].1.render_pose(k));
            let lazy = by_definition(session.drawn(), render_poses).to_bytes();
            for (_, map) in &maps {
                prop_assert!(map.counts().to_bytes() == lazy, "a lazy map is that of its render poses");
            }
        }
        let scratch = whole(&session).to_bytes();
        let mut fresh = GlobalMap::new(&Settings::default());
        let fresh = seen(fresh.export(&session, 1));
        for (threads, map) in &mut maps {
            let exported = map.export(&session, *threads);
            prop_assert!(exported.to_bytes() == scratch);
            prop_assert!(seen(exported) == fresh, "{threads} threads");
        }
    }
}

#[test]
fn a_map_without_normals_is_the_same_but_for_these() {
    let mut maps = [GlobalMap::new(&Settings::default()), GlobalMap::without_normals(&Settings::default())];
    let [with, without] = maps.each_mut().map(|map| map.export(MAPPED.session(), 2));
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
    let session = MAPPED.session();
    let all = session.keyframes().len();
    let moved = |by: Pose2| {
        let mut moved = session.clone();
        correct(&mut moved, 0, |pose| pose * by);
        moved
    };
    let mut map = GlobalMap::new(&Settings::default());
    assert_eq!(map.follow(session, 2), all);
    assert_eq!(map.follow(session, 2), 0);
    assert_eq!(map.follow(&moved(Pose2::new(0.0, 0.012, 0.0)), 2), 0);
    assert_eq!(map.follow(&moved(Pose2::new(0.0, 0.013, 0.0)), 2), all);
    // A rotation moves a point 3 m away by as much as 4.3 mrad of 3 m.
    assert_eq!(map.follow(&moved(Pose2::new(0.0, 0.013, 1e-5)), 2), 0);
    assert!(map.follow(&moved(Pose2::new(0.0, 0.013, 0.0126 / 3.0)), 2) > all / 2);
}

#[test]
fn dropped_keyframes_leave_the_map_whoever_draws_it() {
    let mut mapper = MAPPED.clone();
    let mut map = GlobalMap::new(mapper.settings());
    map.follow(mapper.session(), 2);
    let with = map.counts().to_bytes();
    assert!(with == mapper.render().to_bytes());
    let dropped = [3, 70].map(|k: usize| mapper.keyframes()[k].id);
    assert!(dropped.into_iter().all(|id| mapper.drop_keyframe(id)));
    assert_eq!(map.follow(mapper.session(), 2), 2);
    assert!(map.counts().to_bytes() != with);
    assert!(map.counts().to_bytes() == mapper.render_with(1).to_bytes());
    let all_at_once = mapper.render_with(3);
    assert!(seen(map.export(mapper.session(), 2)) == seen(&all_at_once));
}

#[test]
fn a_scan_that_hardly_fitted_is_drawn_where_it_agrees_with_the_others_only() {
    let as_mapped = session(MAPPED.keyframes().len(), &[40, 80]);
    let doubted = as_mapped.keyframes()[40].id;
    let pose = as_mapped.map_from_keyframe()[40];
    let mut map = GlobalMap::new(&Settings::default());
    assert_eq!(map.export_believed(&as_mapped, 2), []);
    assert!(map.counts().to_bytes() == whole(&as_mapped).to_bytes());
    let moved_to = |pose: Pose2| {
        let mut astray = as_mapped.clone();
        add(&mut astray, Entry::Snapshot(Snapshot { number: 1, map_from_keyframe: vec![(doubted, pose)] }));
        astray
    };
    // The one turned as by a match that went astray: its beams end beyond the walls and before them.
    let astray = moved_to(pose * Pose2::new(0.0, 0.0, 0.35));
    assert_eq!(map.export_believed(&astray, 2), [doubted]);
    let mut without = astray.clone();
    leave_out(&mut without, 40, Beams::All);
    assert!(map.counts().to_bytes() == whole(&without).to_bytes());
    // What is left out anyway nobody has to judge.
    assert_eq!(map.export_believed(&without, 2), []);
    assert!(map.counts().to_bytes() == whole(&without).to_bytes());
    // Where the others show nothing they do not contradict.
    let far_away = Pose2::new(500.0, 0.0, 0.0);
    assert_eq!(map.export_believed(&moved_to(far_away), 1), []);
    assert_eq!(map.render_pose(40), Some(far_away));
}

#[test]
fn each_map_of_a_session_is_drawn_and_judged_by_its_own_keyframes_alone() {
    const BREAK: usize = 60;
    let count = MAPPED.keyframes().len();
    let mut parted = session(count, &[40, 80]);
    for (first, start) in [(0, FragmentStart::SwitchedOn), (BREAK, FragmentStart::Blind)] {
        let first = parted.keyframes()[first].id;
        add(&mut parted, Entry::Fragment(Fragment { first, start }));
    }
    // Where the second lies nobody knows: over the first, and askew.
    correct(&mut parted, BREAK, |pose| Pose2::new(0.4, 0.3, 0.3) * pose);
    let maps = parted.maps();
    assert_eq!(maps.len(), 2);
    // That of the most keyframes comes first.
    assert_eq!([maps[0].has(0), maps[1].has(0)], [BREAK > count - BREAK, BREAK <= count - BREAK]);
    for map in &maps {
        let own = if map.has(0) { 0..BREAK } else { BREAK..count };
        let mut drawn = GlobalMap::new(&Settings::default());
        assert_eq!(drawn.export_believed_of(&parted, map, 2), []);
        let poses = parted.map_from_keyframe().iter().enumerate().map(|(k, &pose)| own.contains(&k).then_some(pose));
        assert!(drawn.counts().to_bytes() == by_definition(parted.drawn(), poses).to_bytes());
    }
}

/// Every other beam sees things nearer than they are, three scans long.
#[test]
fn the_map_lacks_the_scans_that_hardly_fitted_and_the_mapper_keeps_them() {
    const BAD: std::ops::Range<usize> = 40..43;
    let mut mapper = Mapper::new(Settings::default()).expect("valid");
    let mut recordings = recording(worlds::office_floor(3), DriveSettings { seed: 3, ..DriveSettings::default() });
    let mut bad: Vec<KeyframeId> = Vec::new();
    for (number, recorded) in recordings.iter_mut().step_by(10).take(BAD.end + 5).enumerate() {
        if BAD.contains(&number) {
            recorded.scan.ranges_m.iter_mut().step_by(2).for_each(|range_m| *range_m *= 0.7);
        }
        bad.extend(mapper.add_scan(&recorded.scan).keyframe.filter(|_| BAD.contains(&number)));
    }
    assert_eq!(bad.len(), BAD.len());
    let hardly_fit = mapper.keyframes().iter().filter(|keyframe| keyframe.hardly_fits).map(|keyframe| keyframe.id);
    assert!(hardly_fit.eq(bad.iter().copied()));
    let places: Vec<usize> = bad.iter().filter_map(|&id| mapper.session().place(id)).collect();
    assert!(places.iter().all(|&k| !mapper.keyframes()[k].sweep.is_blank()), "loops may be found by them");
    let mut without = mapper.session().clone();
    places.iter().for_each(|&k| leave_out(&mut without, k, Beams::All));
    assert!(mapper.render().to_bytes() == whole(&without).to_bytes());
    assert_eq!(GlobalMap::new(mapper.settings()).export_believed(mapper.session(), 2), bad);
}
