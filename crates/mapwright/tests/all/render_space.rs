//! The occupancy of space follows corrections, and an exported one is the one drawn from scratch, to the bit.
#![allow(clippy::expect_used, reason = "a test may fail loudly")]

use mapwright::{
    Beams, Entry, Keyframe, KeyframeId, LeftOut, LeftOutReason, Occupancy, OccupancySettings, Pose3, Run, RunId,
    Session, Snapshot, SpaceMap, SpaceSensor, SpaceSweep, SurfaceMap, occupancy_of, surface_settings, white_of,
};
use mapwright_sim::space::{LidarSettings, SpaceDrive, SpaceDriveSettings, TrueCloud, worlds};
use mapwright_surface::{MeshSettings, write_glb};
use nalgebra::Vector6;
use proptest::prelude::*;
use std::sync::{Arc, LazyLock};

const SETTINGS: OccupancySettings = OccupancySettings { resolution_m: 0.2, max_range_m: 20.0 };

/// A building as seen once a second on a drive, each cloud where it was really taken.
static MAPPED: LazyLock<Session<SpaceSweep>> = LazyLock::new(|| {
    let lidar = LidarSettings { columns: 90, ..LidarSettings::spinning(8) };
    let settings = SpaceDriveSettings { lidar, seed: 3, duration_s: 30.0, ..SpaceDriveSettings::default() };
    let drive = SpaceDrive::new(Arc::new(worlds::two_storey(3)), settings);
    let mut session = Session::default();
    add(&mut session, Entry::Run(Run { id: RunId::of_robot("robot"), settings: String::new() }));
    for TrueCloud { cloud, world_from_robot } in (0..).step_by(10).map_while(|number| drive.cloud(number)) {
        let robot_from_sensor = cloud.sensor.robot_from_sensor;
        let seen = cloud.points_m.iter().filter(|point| point.iter().all(|v| v.is_finite()));
        let points = seen.map(|point| robot_from_sensor.transform(point.map(f64::from).into()));
        let points_m: Vec<[f32; 3]> = points.map(|point| [point.x as f32, point.y as f32, point.z as f32]).collect();
        let sweep = Arc::new(SpaceSweep::new(&cloud.sensor, &points_m, Vec::new()));
        let id = session.next_id().expect("a run has begun");
        let keyframe = Arc::new(Keyframe { id, stamp: cloud.stamp, scan: 0, sweep, hardly_fits: false });
        add(&mut session, Entry::Keyframe { keyframe, map_from_keyframe: world_from_robot });
    }
    session
});

/// The first keyframes of the drive as a session of their own.
fn session(count: usize) -> Session<SpaceSweep> {
    let mut session = Session::default();
    add(&mut session, Entry::Run(MAPPED.runs().next().expect("a run").clone()));
    (0..count).for_each(|k| add_keyframe(&mut session, k));
    session
}

fn add(session: &mut Session<SpaceSweep>, entry: Entry<SpaceSweep>) {
    session.add(entry).expect("it fits");
}

fn add_keyframe(session: &mut Session<SpaceSweep>, number: usize) {
    let keyframe = Arc::clone(&MAPPED.keyframes()[number]);
    add(session, Entry::Keyframe { keyframe, map_from_keyframe: MAPPED.map_from_keyframe()[number] });
}

fn leave_out(session: &mut Session<SpaceSweep>, number: usize, beams: Beams) {
    let keyframe = session.keyframes()[number].id;
    add(session, Entry::LeftOut(LeftOut { keyframe, beams, reason: LeftOutReason::Asked }));
}

/// A correction moves these keyframes.
fn correct(session: &mut Session<SpaceSweep>, which: std::ops::Range<usize>, moved: impl Fn(Pose3) -> Pose3) {
    let poses = session.keyframes().iter().zip(session.map_from_keyframe());
    let poses = poses.skip(which.start).take(which.len());
    let map_from_keyframe: Vec<(KeyframeId, Pose3)> =
        poses.map(|(keyframe, &pose)| (keyframe.id, moved(pose))).collect();
    let number = session.corrections() + 1;
    add(session, Entry::Snapshot(Snapshot { number, map_from_keyframe }));
}

/// All that is known, and the file that it becomes.
fn seen(occupancy: &Occupancy) -> impl PartialEq + use<> {
    let mut octree = Vec::new();
    mapwright_voxel::write_bt(occupancy, &mut octree).expect("a vector does not fail");
    (occupancy.voxels().collect::<Vec<_>>(), octree)
}

/// A surface without anything.
fn surface() -> SurfaceMap {
    let settings = surface_settings(&SpaceSensor::lidar("top"), 10.0, 0.2);
    SurfaceMap::new(settings, None).expect("voxels of a size that can be")
}

/// The file that a surface becomes.
fn file(map: &SurfaceMap, threads: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mesh = map.mesh(&MeshSettings { threads, ..MeshSettings::default() });
    write_glb(&mut bytes, &mesh).expect("a vector does not fail");
    bytes
}

/// The session with every keyframe where it is drawn.
fn as_drawn(map: &SpaceMap, session: &Session<SpaceSweep>) -> Occupancy {
    let mut session = session.clone();
    let ids: Vec<KeyframeId> = session.keyframes().iter().map(|keyframe| keyframe.id).collect();
    let drawn = ids.into_iter().enumerate().filter_map(|(k, id)| Some((id, map.render_pose(k)?)));
    let number = session.corrections() + 1;
    let map_from_keyframe = drawn.collect();
    add(&mut session, Entry::Snapshot(Snapshot { number, map_from_keyframe }));
    occupancy_of(&session, SETTINGS)
}

/// What may happen to the keyframes between two looks at the map.
#[derive(Debug, Clone)]
enum Event {
    New(usize),
    /// The keyframes from a share of all on are carried by a small motion.
    Corrected(f64, [f64; 6]),
    /// Nothing of a keyframe is to be drawn any more.
    LeftOut(f64),
    /// Every so many points of a keyframe are left out.
    PointsLeftOut(f64, usize),
}

fn events() -> impl Strategy<Value = Vec<(Event, bool)>> {
    let size = prop_oneof![Just(0.001), Just(0.02), Just(1.0)];
    let by = [-1.0..1.0, -1.0..1.0, -1.0..1.0, -0.3..0.3, -0.3..0.3, -0.3..0.3_f64];
    let event = prop_oneof![
        (1..8_usize).prop_map(Event::New),
        (0.0..1.0, by, size).prop_map(|(from, by, size)| Event::Corrected(from, by.map(|by| by * size))),
        (0.0..1.0).prop_map(Event::LeftOut),
        (0.0..1.0, 2..9_usize).prop_map(|(at, every)| Event::PointsLeftOut(at, every)),
    ];
    prop::collection::vec((event, any::<bool>()), 1..10)
}

fn happen(event: &Event, session: &mut Session<SpaceSweep>) {
    let known = session.keyframes().len();
    let at = |share: f64| (share * known as f64) as usize;
    match *event {
        Event::New(count) => (known..MAPPED.keyframes().len()).take(count).for_each(|k| add_keyframe(session, k)),
        Event::LeftOut(share) => leave_out(session, at(share), Beams::All),
        Event::PointsLeftOut(share, every) => {
            let points = session.keyframes()[at(share)].sweep.points.len() as u32;
            leave_out(session, at(share), Beams::These((0..points).step_by(every).collect()));
        }
        Event::Corrected(from, by) => {
            correct(session, at(from)..known, |pose| Pose3::exp(Vector6::from(by)) * pose);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 10, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn an_exported_surface_is_the_one_drawn_from_scratch(events in events(), threads in 1..4_usize) {
        let mut session = session(12);
        let mut map = surface();
        for (event, look) in events {
            happen(&event, &mut session);
            if look {
                map.follow(&session, threads).expect("memory suffices");
            }
        }
        let mut scratch = surface();
        scratch.export(&session, 1).expect("memory suffices");
        let exported = map.export(&session, threads).expect("memory suffices");
        prop_assert!(exported.volume() == scratch.surface().volume());
        prop_assert!(exported.volume().is_empty() == session.drawn().iter().all(Option::is_none));
        prop_assert!(file(&map, threads) == file(&scratch, 1));
    }

    #[test]
    fn an_exported_map_is_the_one_drawn_from_scratch(events in events()) {
        let mut session = session(12);
        let mut map = SpaceMap::new(SETTINGS);
        for (event, look) in events {
            happen(&event, &mut session);
            if look {
                map.follow(&session);
                prop_assert!(seen(map.occupancy()) == seen(&as_drawn(&map, &session)), "a lazy map is that of its render poses");
            }
        }
        prop_assert!(seen(map.export(&session)) == seen(&occupancy_of(&session, SETTINGS)));
    }
}

#[test]
fn only_what_may_have_moved_by_a_quarter_of_a_voxel_is_drawn_anew() {
    let all = MAPPED.keyframes().len();
    assert!(all > 20, "{all}");
    let moved = |which: std::ops::Range<usize>, [x, turned_rad]: [f64; 2]| {
        let mut moved = MAPPED.clone();
        correct(&mut moved, which, |pose| pose * Pose3::exp(Vector6::new(x, 0.0, 0.0, 0.0, 0.0, turned_rad)));
        moved
    };
    let mut map = SpaceMap::new(SETTINGS);
    assert_eq!(map.follow(&MAPPED), all);
    assert_eq!(map.follow(&MAPPED), 0);
    let whole = seen(map.occupancy());
    assert!(whole == seen(&occupancy_of(&MAPPED, SETTINGS)));
    assert_eq!(map.follow(&moved(0..all, [0.0499, 0.0])), 0);
    assert!(whole == seen(map.occupancy()));
    // A rotation moves a point 3 m away by as much as 17 mrad of 3 m.
    assert!(map.clone().follow(&moved(0..all, [0.0, 0.051 / 3.0])) > all / 2);
    // A correction of a few redraws these alone, and taken back it is as it was.
    assert_eq!(map.follow(&moved(4..7, [0.0501, 0.0])), 3);
    assert!(whole != seen(map.occupancy()));
    assert_eq!(map.follow(&MAPPED), 3);
    assert!(whole == seen(map.occupancy()));
}

#[test]
fn what_is_left_out_leaves_the_map_and_so_does_what_the_session_has_no_more() {
    let mut left_out = MAPPED.clone();
    [3, 9].into_iter().for_each(|number| leave_out(&mut left_out, number, Beams::All));
    let mut map = SpaceMap::new(SETTINGS);
    map.follow(&MAPPED);
    assert_eq!(map.follow(&left_out), 2);
    assert!(seen(map.occupancy()) == seen(&occupancy_of(&left_out, SETTINGS)));
    let fewer = session(15);
    map.export(&fewer);
    assert!(seen(map.occupancy()) == seen(&occupancy_of(&fewer, SETTINGS)));
}

#[test]
fn what_is_left_out_is_in_no_surface_and_intensities_are_grey() {
    let mut session = session(6);
    let mut map = surface();
    map.export(&session, 2).expect("memory suffices");
    let whole = map.surface().volume().clone();
    assert!(whole.blocks() > 100, "{} blocks", whole.blocks());
    assert!(map.mesh(&MeshSettings::default()).colours.is_empty() && white_of(&session).is_none());
    leave_out(&mut session, 2, Beams::All);
    map.export(&session, 2).expect("memory suffices");
    assert!(*map.surface().volume() != whole && map.surface().keyframes().count() == 5);

    // the same keyframe with intensities: half of its points bright, all others nearly dark
    let keyframe = &MAPPED.keyframes()[0];
    let count = keyframe.sweep.points.len();
    let intensities: Vec<f32> = (0..count).map(|k| if k < count / 2 { 200.0 } else { 2.0 }).collect();
    let sweep = Arc::new(keyframe.sweep.as_ref().clone().with_intensities(&intensities));
    let mut bright = Session::default();
    add(&mut bright, Entry::Run(MAPPED.runs().next().expect("a run").clone()));
    let keyframe = Arc::new(Keyframe { sweep, ..keyframe.as_ref().clone() });
    add(&mut bright, Entry::Keyframe { keyframe, map_from_keyframe: Pose3::identity() });
    let white = white_of(&bright);
    assert_eq!(white, Some(200.0));
    let mut map = SurfaceMap::new(*whole.settings(), white).expect("voxels of a size that can be");
    map.export(&bright, 1).expect("memory suffices");
    let mesh = map.mesh(&MeshSettings::default());
    let near =
        |grey: u8| mesh.colours.iter().filter(|colour| colour.iter().all(|part| part.abs_diff(grey) < 4)).count();
    assert!(near(255) > 10 && near(25) > 10, "{} bright, {} dark", near(255), near(25));
}
