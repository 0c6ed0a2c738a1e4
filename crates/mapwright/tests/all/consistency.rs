//! Whether the reported covariance is honest: the pose relative to its anchor keyframe against the truth, one sample a
//! simulated world (NEES; 3 is expected). `-- --nocapture` shows the means.
#![allow(clippy::expect_used, clippy::print_stdout, reason = "a test may fail loudly and show what it measured")]

use crate::support;

use mapwright::{Cov3, Pose2};
use mapwright_eval::Nees;
use mapwright_sim::{DriveSettings, Site, worlds};
use support::{in_parallel, map_all, recording};

const WORLDS: usize = 100;

/// True and estimated pose in the anchor's frame at the end of a drive, and the covariance reported with it.
fn sample(seed: u64, site: Site) -> (Pose2, Pose2, Cov3) {
    let duration_s = 60.0 + 0.37 * seed as f64;
    let scans = recording(site, DriveSettings { seed, duration_s, ..DriveSettings::default() });
    let (mapper, updates) = map_all(scans.iter().map(|s| &s.scan));
    let (last, truth) = (updates.last().expect("scans"), scans.last().expect("scans").world_from_robot);
    let anchor = last.anchor.expect("the last scan was matched").seq as usize;
    let true_anchor = scans[mapper.keyframes()[anchor].scan as usize].world_from_robot;
    let estimate = mapper.keyframe_poses()[anchor].between(last.map_from_robot);
    (true_anchor.between(truth), estimate, last.covariance)
}

fn check(world: impl Fn(u64) -> Site + Sync) {
    let samples = in_parallel(WORLDS, |seed| sample(seed as u64, world(seed as u64)));
    let mut nees = Nees::default();
    for (truth, estimate, covariance) in samples {
        assert!(nees.add(truth, estimate, &covariance), "{covariance}");
    }
    let mean = nees.mean().expect("samples");
    println!("mean NEES of {WORLDS} worlds: {mean:.2}");
    // 2.54 to 3.50.
    assert!(nees.is_consistent(0.95), "mean {mean:.2}, expected within {:?}", nees.mean_interval(0.95));
}

#[test]
fn the_covariance_is_honest_in_rooms() {
    check(worlds::rooms);
}

#[test]
fn the_covariance_is_honest_in_corridors() {
    check(|seed| worlds::corridor(seed, worlds::CorridorWalls::Features));
}
