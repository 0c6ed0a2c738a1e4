//! The gated local map keeps what is certain relative to the robot, and only that.
#![allow(clippy::expect_used, clippy::print_stdout, reason = "a test may fail loudly and show what it measured")]

use crate::support;

use mapwright::{CountGrid, LivePolicy, LocalMapReport, Mapper, Settings};
use mapwright_grid::Change;
use mapwright_sensor::{BeamTable, SweepPoints};
use mapwright_sim::{DriveSettings, Site, worlds};
use support::{ate_m, in_parallel, recording};

/// Maps a drive with the gate; the local map's account and the trajectory's error.
fn mapped(site: Site, seed: u64, duration_s: f64, gate_m: f64) -> (LocalMapReport, f64) {
    let mut settings = Settings::default();
    settings.live.policy = LivePolicy::Gated;
    settings.live.gate_m = gate_m;
    (settings.loops.by_pose, settings.loops.by_place) = (false, false);
    let mut mapper = Mapper::new(settings).expect("valid");
    let recorded = recording(site, DriveSettings { seed, duration_s, ..DriveSettings::default() });
    for scan in &recorded {
        mapper.add_scan(&scan.scan);
    }
    let truth: Vec<_> = recorded.iter().map(|scan| scan.world_from_robot).collect();
    (mapper.local_map_report(), ate_m(&mapper, &truth))
}

#[test]
fn the_start_of_a_short_loop_stays_and_that_of_a_long_one_leaves() {
    let gate_m = Settings::default().live.gate_m;
    let cases = [
        (60.0, 4, gate_m, true),
        (120.0, 4, gate_m, false),
        (60.0, 1, 2.0 * gate_m, true),
        (120.0, 4, 2.0 * gate_m, false),
        (120.0, 4, 5.0 * gate_m, true),
        (300.0, 1, 5.0 * gate_m, false),
        (400.0, 2, 5.0 * gate_m, false),
    ];
    let reports = in_parallel(cases.len(), |k| {
        let (length_m, seed, gate_m, _) = cases[k];
        let (report, error_m) = mapped(worlds::grand_loop(seed, length_m), seed, f64::INFINITY, gate_m);
        println!("{length_m} m, gate {gate_m} m: {report:?}, {error_m:.3} m");
        (report, error_m)
    });
    for ((length_m, _, gate_m, stays), (report, error_m)) in cases.into_iter().zip(reports) {
        if stays {
            assert_eq!(report.gated_out, report.let_in, "{length_m} m, gate {gate_m} m");
            assert!(error_m < 0.1, "{error_m} m, closed by matching against the start");
        } else {
            assert!(report.gated_out > 100 && report.let_in == 0, "{length_m} m, gate {gate_m} m: {report:?}");
        }
    }
}

/// What is drawn of all keyframes of a mapper, one after the other.
fn drawn_anew(mapper: &Mapper) -> CountGrid {
    let mut map = CountGrid::new(mapper.settings().map.resolution_m);
    let mut points = SweepPoints::default();
    for (sweep, &pose) in mapper.session().drawn().iter().zip(mapper.keyframe_poses()) {
        let sweep = sweep.as_ref().expect("none is left out altogether");
        points.fill(sweep, &mut BeamTable::default(), mapper.settings().scan.free_range_m);
        points.fill_normals();
        map.draw(&points, pose, Change::Add, &mut Vec::new());
    }
    map
}

#[test]
fn the_exported_map_holds_every_keyframe_whatever_is_live_or_on_its_way_out() {
    let mut settings = Settings::default();
    settings.live.policy = LivePolicy::Gated;
    settings.live.gate_m = 0.02;
    settings.live.views_per_area = 2;
    let mut mapper = Mapper::new(settings).expect("valid");
    let drive = DriveSettings { seed: 1, duration_s: 60.0, ..DriveSettings::default() };
    for (k, scan) in recording(worlds::three_rooms(1), drive).iter().enumerate() {
        mapper.add_scan(&scan.scan);
        if k % 37 == 0 || k > 590 {
            assert!(mapper.render().to_bytes() == drawn_anew(&mapper).to_bytes(), "after scan {k}");
        }
    }
    assert!(mapper.local_map_report().superseded > 20, "{:?}", mapper.local_map_report());
}

#[test]
fn in_the_same_rooms_the_live_map_stops_growing_and_stays_right() {
    let (early, _) = mapped(worlds::three_rooms(1), 1, 400.0, Settings::default().live.gate_m);
    let (late, error_m) = mapped(worlds::three_rooms(1), 1, 1200.0, Settings::default().live.gate_m);
    println!("{early:?}, {late:?}, {error_m:.3} m");
    assert!(late.superseded > early.superseded + 1000);
    assert!(late.keyframes as f64 <= 1.15 * early.keyframes as f64, "{} and {}", early.keyframes, late.keyframes);
    assert_eq!(late.gated_out, 0);
    assert!(error_m < 0.03, "{error_m} m");
}
