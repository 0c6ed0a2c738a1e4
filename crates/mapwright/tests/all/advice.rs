//! Where to drive next: loops that are open, and the same once they are closed.
#![allow(clippy::expect_used, reason = "a test may fail loudly")]

use crate::support;

use mapwright::{Advice, Entry, Fragment, FragmentStart, LaserModel, LaserScan, Mapper, Pose2, Settings, Stamp};
use mapwright_sim::{DriveSettings, TrueScan, worlds};
use support::{mapper, recording};

const LENGTH_M: f64 = 160.0;

/// A corridor that comes back to its start, and how many of its scans leave it open.
fn lap() -> (Vec<TrueScan>, usize) {
    let scans = recording(worlds::grand_loop(3, LENGTH_M), DriveSettings { seed: 3, ..DriveSettings::default() });
    let mut travelled_m = 0.0;
    let far = |pair: &[TrueScan]| {
        travelled_m += pair[0].world_from_robot.distance(pair[1].world_from_robot);
        travelled_m > 0.72 * LENGTH_M
    };
    let open = scans.windows(2).position(far).expect("a whole lap");
    (scans, open)
}

fn mapped(scans: &[TrueScan]) -> Mapper {
    let mut settings = Settings::default();
    settings.set("live.policy", "gated").expect("a setting");
    let mut mapper = Mapper::new(settings).expect("valid");
    for recorded in scans {
        mapper.add_scan(&recorded.scan);
    }
    mapper
}

#[test]
fn an_open_loop_wants_to_be_closed_near_its_start_and_is_more_certain_once_it_is() {
    let (scans, until) = lap();
    let open = mapped(&scans[..until]);
    let advice = Advice::of(open.session());
    assert_eq!(advice, Advice::of(open.session()), "the same again");
    let best = advice.places.first().expect("there is something to be gained");
    let along = best.keyframe.seq as f64 / open.keyframes().len() as f64;
    assert!(along < 0.35, "{best:?} after {along} of the way");
    assert!(best.mean_sigma_after_m < advice.mean_sigma_m && best.way_m().is_some());
    let closed = mapped(&scans);
    let after = Advice::of(closed.session());
    assert!(
        after.mean_sigma_m < advice.mean_sigma_m && after.worst_sigma_m < advice.worst_sigma_m,
        "mean {} to {}, worst {} to {}",
        advice.mean_sigma_m,
        after.mean_sigma_m,
        advice.worst_sigma_m,
        after.worst_sigma_m
    );
}

#[test]
fn a_map_of_its_own_is_certain_relative_to_where_it_begins_and_only_the_robots_has_places_to_drive_to() {
    let (scans, until) = lap();
    let mapper = mapped(&scans[..until]);
    let (whole, all) = (mapper.session(), Advice::of(mapper.session()));
    assert_eq!(Advice::of_map(whole, &whole.maps()[0]), all, "one map is all");
    let (mut parted, middle) = (whole.clone(), whole.keyframes().len() / 2);
    let first = whole.keyframes()[middle].id;
    parted.add(Entry::Fragment(Fragment { first, start: FragmentStart::Blind })).expect("it fits");
    let advice: Vec<Advice> = parted.maps().iter().map(|map| Advice::of_map(&parted, map)).collect();
    let keyframes: Vec<usize> = advice.iter().map(|advice| advice.keyframe_sigmas_m.len()).collect();
    assert_eq!(keyframes, [middle, whole.keyframes().len() - middle]);
    assert!(advice.iter().all(|advice| advice.keyframe_sigmas_m[0] == 0.0 && advice.worst_sigma_m < all.worst_sigma_m));
    assert!(advice[0].places.is_empty(), "the robot is elsewhere");
}

#[test]
fn a_map_of_nothing_and_of_one_keyframe_have_no_advice() {
    let mut mapper = mapper();
    assert_eq!(Advice::of(mapper.session()), Advice::default());
    let laser = LaserModel { range_max_m: 30.0, ..LaserModel::half_circle("front", 181) };
    let ranges_m = vec![2.0; 181];
    let scan = LaserScan { stamp: Stamp(0), laser: laser.into(), ranges_m, odom_from_robot: Some(Pose2::IDENTITY) };
    mapper.add_scan(&scan);
    let advice = Advice::of(mapper.session());
    assert_eq!((advice.keyframe_sigmas_m.as_slice(), advice.places.len()), ([0.0].as_slice(), 0));
}
