//! What the whole-pipeline tests share.
#![allow(dead_code, reason = "examples use parts, too")]

pub(crate) mod inertial;
pub(crate) mod turns;

use mapwright::{LaserScan, Mapper, Pose2, Settings, Update};
use mapwright_eval::{Alignment, PosePair, ate_of_pairs};
use mapwright_sim::{Drive, DriveSettings, Site, TrueScan};
use std::sync::Arc;

/// A mapper with default settings.
pub(crate) fn mapper() -> Mapper {
    Mapper::new(Settings::default()).expect("defaults are valid")
}

/// A recording of a drive through a site.
pub(crate) fn recording(site: impl Into<Arc<Site>>, settings: DriveSettings) -> Vec<TrueScan> {
    Drive::new(site.into(), settings).scans().collect()
}

/// Maps a recording with default settings.
pub(crate) fn map_all<'a>(scans: impl IntoIterator<Item = &'a LaserScan>) -> (Mapper, Vec<Update>) {
    let mut mapper = mapper();
    let updates = scans.into_iter().map(|scan| mapper.add_scan(scan)).collect();
    (mapper, updates)
}

/// Root mean square of the trajectory's distance from the truth after rigid alignment, metres.
pub(crate) fn ate_m(mapper: &Mapper, truth: &[Pose2]) -> f64 {
    let pairs: Vec<PosePair> = mapper
        .trajectory()
        .zip(truth)
        .map(|(pose, &world_from_robot)| PosePair {
            stamp: pose.stamp,
            world_from_robot,
            map_from_robot: pose.map_from_robot,
        })
        .collect();
    ate_of_pairs(&pairs, Alignment::Rigid).expect("a robot that moved").translation_m.rmse
}

/// Whether a pose in the map is right, relative to the true pose `known` of each keyframe from before.
pub(crate) fn is_right(mapper: &Mapper, known: &[Pose2], map_from_robot: Pose2, truth: Pose2) -> bool {
    let away_m = |k: &usize| known[*k].distance(truth);
    let nearest = (0..known.len()).min_by(|a, b| away_m(a).total_cmp(&away_m(b))).expect("it mapped before");
    let error = known[nearest].between(truth).between(mapper.keyframe_poses()[nearest].between(map_from_robot));
    error.x.hypot(error.y) < 0.3 && error.theta.abs() < 3_f64.to_radians()
}

/// `work` of each number below `count`, in order, by two threads.
pub(crate) fn in_parallel<T: Send>(count: usize, work: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let work = &work;
    let every_second = |first: usize| move || (first..count).step_by(2).map(work).collect::<Vec<T>>();
    let (even, odd) = std::thread::scope(|scope| {
        let odd = scope.spawn(every_second(1));
        (every_second(0)(), odd.join().expect("no panic"))
    });
    let mut odd = odd.into_iter();
    even.into_iter().flat_map(|item| std::iter::once(item).chain(odd.next())).collect()
}
