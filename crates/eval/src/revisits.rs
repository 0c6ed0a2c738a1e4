//! By how much clouds of different visits ask to be moved onto each other: a trajectory judged without a reference.
//!
//! A cloud of one visit is registered on a map of another visit's few neighbouring clouds, whose poses relative to each other are
//! certain. Neither odometry nor any edge of the graph takes part, nor a prior: what the points say is compared with what the
//! trajectory says.

use crate::associate::{MAX_STAMP_DIFFERENCE_S, paired_stamps};
use crate::error::EvalError;
use crate::stats::{PoseErrors, quantile};
use mapwright_geom::{Cov6, Pose3, Stamp};
use mapwright_voxel::{Change, Fit, Matcher, MatcherSettings, Prior, Seen, SurfelMap, SurfelMapSettings, Thinner};

/// So many pairs are registered at most,
const PAIRS: usize = 300;
/// of so many scans, each with so many earlier ones, at most.
const QUERIES: usize = 1000;
const PARTNERS: usize = 16;
/// Neighbours of a scan on either side, at most, and within so many scans: by then poses have hardly drifted.
const NEIGHBOURS: usize = 2;
const NEIGHBOUR_SCANS: u64 = 15;
/// Side of the smallest voxels, of the rms range, and how many resolutions, each twice as coarse.
const FINEST_SHARE: f64 = 1.0 / 32.0;
const LEVELS: usize = 4;
/// Of the points within so many smallest voxels one is matched, and so many in all.
const POINT_SHARE: f64 = 0.8;
const POINTS: usize = 12_000;
/// A pair is registered where so many of the scan's points lie where the map knows a surface, and so many of those fit it.
const LEAST_KNOWN: f64 = 0.3;
const LEAST_FITTING: f64 = 0.4;
/// and where the points hold the position in every direction to this, metres, one standard deviation.
const LOOSEST_M: f64 = 0.05;
/// Two registrations are told apart where one explains so much more, share of the points.
const BETTER_SHARE: f64 = 0.01;

/// Scans of different visits are so far apart in order at most.
const APART_AT_MOST: u64 = 60;

/// A scan whose cloud may be registered.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RevisitScan {
    /// When it was taken.
    pub stamp: Stamp,
    /// Its number among all scans, those without a cloud counted too.
    pub number: u64,
    /// Where the robot was at that time, as the map has it.
    pub map_from_robot: Pose3,
    /// The frame of its points, seen from there: the identity unless they were undistorted to another time.
    pub robot_from_cloud: Pose3,
    /// Where the sensor was, in that frame, metres.
    pub sensor_m: [f64; 3],
}

/// Which clouds are registered, and how.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RevisitSettings {
    /// Scans that lie so far apart in order belong to different visits.
    pub apart: u64,
    /// Scans of a pair were taken nearer to each other, metres.
    pub within_m: f64,
    /// The maps of one visit that clouds of others are registered on.
    pub maps: SurfelMapSettings,
}

impl RevisitSettings {
    /// Scans apart that belong to different visits, where the robot drives so far from scan to scan: on the way it can have left the place
    /// and come back, or 60 scans where it is slow.
    #[must_use]
    pub fn apart_for(step_m: f64, within_m: f64) -> u64 {
        // a NaN and a robot that stands are slow
        let scans = (2.0 * within_m / step_m).ceil();
        if scans < APART_AT_MOST as f64 { (scans as u64).max(1) } else { APART_AT_MOST }
    }

    /// 60 scans apart and less than 5 m, for a sensor with such root mean square of its ranges, and such noise there, metres.
    #[must_use]
    pub fn for_range(range_m: f64, noise_m: f64) -> Self {
        let resolution_m = (FINEST_SHARE * range_m).max(1e-3);
        Self { apart: APART_AT_MOST, within_m: 5.0, maps: SurfelMapSettings { resolution_m, levels: LEVELS, noise_m } }
    }
}

/// What registration says of two clouds of different visits.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RevisitFit {
    /// By how much the later one has to be moved and turned to fit the earlier one's map, metres and degrees.
    Moved {
        /// How far.
        metres: f64,
        /// By how much it turns.
        degrees: f64,
    },
    /// They have seen too little in common.
    LittleInCommon,
    /// They have seen the same place, and it does not look the same.
    Misfit,
    /// What they have seen leaves a direction open.
    Loose,
}

/// What registration asks of a trajectory.
#[derive(Debug, Clone, PartialEq)]
pub struct RevisitReport {
    /// Scans with a pose of the trajectory,
    pub scans: usize,
    /// and those without, which are left out.
    pub without_pose: usize,
    /// Pairs that were registered.
    pub pairs: usize,
    /// Pairs left out as too small a share of the points is known or fits.
    pub not_fitting: usize,
    /// Pairs left out as the points leave a direction open.
    pub loose: usize,
    /// How far, and by how much, registration moves and turns a scan from where the trajectory has it; none without pairs.
    pub corrections: Option<PoseErrors>,
    /// 90th percentiles of the same, metres and degrees.
    pub percentile_90: Option<(f64, f64)>,
}

/// Judges the map's own poses, or those of another trajectory of the robot (`judged`, paired by stamps as in
/// [`associate`](fn@crate::associate)), on the same pairs and maps. `points_m` gives the points of a scan, by its place in
/// `scans`, in the cloud's frame, metres.
///
/// Pairs, and the maps of neighbours, are those of the map's poses. Registration starts from the relative pose of the judged
/// trajectory and from that of the map; what explains more of the cloud counts, so that a trajectory too wrong to be registered
/// from is not spared.
///
/// # Errors
/// When no stamps match, or no two scans of different visits lie near each other.
pub fn revisit_errors<P: AsRef<[[f32; 3]]>>(
    scans: &[RevisitScan],
    judged: Option<&[(Stamp, Pose3)]>,
    points_m: impl Fn(usize) -> P,
    settings: &RevisitSettings,
) -> Result<RevisitReport, EvalError> {
    let poses = poses(scans, judged)?;
    let with_pose: Vec<usize> = (0..scans.len()).filter(|&k| poses[k].is_some()).collect();
    let pairs = pairs(scans, &with_pose, settings);
    if pairs.is_empty() {
        return Err(no_revisits(scans, &with_pose, settings));
    }
    let fits = registered(scans, &poses, &pairs, &points_m, settings);
    let moved = |fit: &RevisitFit| {
        if let RevisitFit::Moved { metres, degrees } = *fit { Some((metres, degrees)) } else { None }
    };
    let corrections: Vec<(f64, f64)> = fits.iter().filter_map(moved).collect();
    let count = |kinds: &[RevisitFit]| fits.iter().filter(|fit| kinds.contains(fit)).count();
    let not_fitting = count(&[RevisitFit::LittleInCommon, RevisitFit::Misfit]);
    let loose = count(&[RevisitFit::Loose]);
    let (metres, degrees): (Vec<f64>, Vec<f64>) = corrections.iter().copied().unzip();
    Ok(RevisitReport {
        scans: with_pose.len(),
        without_pose: scans.len() - with_pose.len(),
        pairs: corrections.len(),
        not_fitting,
        loose,
        corrections: PoseErrors::of(&corrections),
        percentile_90: quantile(&metres, 0.9).zip(quantile(&degrees, 0.9)),
    })
}

/// What registration says of such pairs of scans, each by its place in `scans`, the one on whose map the other is registered first; as the
/// map has their poses. A pair beyond `scans` is left out.
pub fn revisit_fits<P: AsRef<[[f32; 3]]>>(
    scans: &[RevisitScan],
    pairs: &[[usize; 2]],
    points_m: impl Fn(usize) -> P,
    settings: &RevisitSettings,
) -> Vec<RevisitFit> {
    let poses: Vec<Option<Pose3>> = scans.iter().map(|scan| Some(map_from_cloud(scan))).collect();
    let pairs: Vec<_> = pairs.iter().filter(|pair| pair.iter().all(|&scan| scan < scans.len())).copied().collect();
    registered(scans, &poses, &pairs, &points_m, settings)
}

/// The same of pairs of which both scans have a pose.
fn registered<P: AsRef<[[f32; 3]]>>(
    scans: &[RevisitScan],
    poses: &[Option<Pose3>],
    pairs: &[[usize; 2]],
    points_m: &impl Fn(usize) -> P,
    settings: &RevisitSettings,
) -> Vec<RevisitFit> {
    let mut registration = Registration::new(*settings);
    let mut fits = Vec::with_capacity(pairs.len());
    for &[earlier, later] in pairs {
        let (Some(world_from_earlier), Some(world_from_later)) = (poses[earlier], poses[later]) else { continue };
        let said = world_from_earlier.between(world_from_later);
        registration.draw(scans, earlier, points_m);
        let mapped = map_from_cloud(&scans[earlier]).between(map_from_cloud(&scans[later]));
        let fit = registration.register(points_m(later).as_ref(), scans[later].sensor_m, [said, mapped]);
        fits.push(if fit.known_share < LEAST_KNOWN {
            RevisitFit::LittleInCommon
        } else if fit.inlier_share < LEAST_FITTING {
            RevisitFit::Misfit
        } else if loosest_m(&fit) > LOOSEST_M {
            RevisitFit::Loose
        } else {
            let asked = said.between(fit.map_from_cloud);
            RevisitFit::Moved { metres: asked.translation.norm(), degrees: asked.rotation.angle().to_degrees() }
        });
    }
    fits
}

/// Pose of each scan's cloud in the judged trajectory, where that has one.
fn poses(scans: &[RevisitScan], judged: Option<&[(Stamp, Pose3)]>) -> Result<Vec<Option<Pose3>>, EvalError> {
    let Some(judged) = judged else { return Ok(scans.iter().map(|scan| Some(map_from_cloud(scan))).collect()) };
    let of_scans: Vec<Stamp> = scans.iter().map(|scan| scan.stamp).collect();
    let of_judged: Vec<Stamp> = judged.iter().map(|(stamp, _)| *stamp).collect();
    let mut poses = vec![None; scans.len()];
    for [scan, pose] in paired_stamps(&of_scans, &of_judged, MAX_STAMP_DIFFERENCE_S)? {
        poses[scan] = Some(judged[pose].1 * scans[scan].robot_from_cloud).filter(|pose| pose.is_finite());
    }
    Ok(poses)
}

fn map_from_cloud(scan: &RevisitScan) -> Pose3 {
    scan.map_from_robot * scan.robot_from_cloud
}

/// Pairs of scans of different visits, the earlier first, evenly spread.
fn pairs(scans: &[RevisitScan], with_pose: &[usize], settings: &RevisitSettings) -> Vec<[usize; 2]> {
    let mut pairs = Vec::new();
    for &later in evenly(with_pose, QUERIES) {
        let is_revisit = |&&earlier: &&usize| {
            are_apart(&scans[earlier], &scans[later], settings.apart)
                && scans[earlier].map_from_robot.distance(scans[later].map_from_robot) < settings.within_m
        };
        let partners: Vec<usize> = with_pose.iter().filter(is_revisit).copied().collect();
        pairs.extend(evenly(&partners, PARTNERS).map(|&earlier| [earlier, later]));
    }
    evenly(&pairs, PAIRS).copied().collect()
}

fn are_apart(earlier: &RevisitScan, later: &RevisitScan, apart: u64) -> bool {
    later.number.checked_sub(earlier.number).is_some_and(|between| between >= apart)
}

/// Says what there is instead: how near to each other scans so far apart in order lie.
fn no_revisits(scans: &[RevisitScan], with_pose: &[usize], settings: &RevisitSettings) -> EvalError {
    let nearest_m = evenly(with_pose, QUERIES).flat_map(|&later| {
        let earlier =
            with_pose.iter().filter(move |&&earlier| are_apart(&scans[earlier], &scans[later], settings.apart));
        earlier.map(move |&earlier| scans[earlier].map_from_robot.distance(scans[later].map_from_robot))
    });
    let RevisitSettings { apart, within_m, .. } = *settings;
    EvalError::NoRevisits { scans: with_pose.len(), apart, within_m, nearest_m: nearest_m.reduce(f64::min) }
}

/// So many at most, evenly spread.
fn evenly<T>(all: &[T], at_most: usize) -> impl Iterator<Item = &T> {
    let count = all.len().min(at_most);
    (0..count).map(move |k| &all[k * all.len() / count])
}

/// What the position's standard deviation is in the direction that is held least, metres.
fn loosest_m(fit: &Fit) -> f64 {
    let variance = |covariance: Cov6| covariance.fixed_view::<3, 3>(0, 0).symmetric_eigenvalues().max();
    fit.information.try_inverse().map_or(f64::INFINITY, |covariance| variance(covariance).max(0.0).sqrt())
}

/// Registers clouds on maps; keeps its buffers.
struct Registration {
    map: SurfelMap,
    matcher: Matcher,
    thinner: Thinner,
    points_m: Vec<[f32; 3]>,
}

impl Registration {
    fn new(settings: RevisitSettings) -> Self {
        Self {
            map: SurfelMap::new(settings.maps),
            matcher: Matcher::new(MatcherSettings { points: POINTS, ..MatcherSettings::default() }),
            thinner: Thinner::default(),
            points_m: Vec::new(),
        }
    }

    /// A map of the scan and its neighbours, in the frame of its cloud.
    fn draw<P: AsRef<[[f32; 3]]>>(&mut self, scans: &[RevisitScan], middle: usize, points_m: impl Fn(usize) -> P) {
        self.map = SurfelMap::new(*self.map.settings());
        let is_near = |&other: &usize| scans[other].number.abs_diff(scans[middle].number) <= NEIGHBOUR_SCANS;
        let last = (middle + NEIGHBOURS).min(scans.len() - 1);
        for other in (middle.saturating_sub(NEIGHBOURS)..=last).filter(is_near) {
            let middle_from_other = map_from_cloud(&scans[middle]).between(map_from_cloud(&scans[other]));
            self.map.draw(
                points_m(other).as_ref(),
                scans[other].sensor_m,
                middle_from_other,
                Change::Add,
                other as u32,
            );
        }
        self.map.refresh();
    }

    /// Of the poses that `starts` lead to, the one that explains most; the first where both do.
    fn register(&mut self, points_m: &[[f32; 3]], sensor_m: [f64; 3], starts: [Pose3; 2]) -> Fit {
        self.thinner.thin(points_m, POINT_SHARE * self.map.settings().resolution_m, &mut self.points_m);
        let mut climb = |start: Pose3| {
            let prior = Prior { map_from_cloud: start, information: Cov6::zeros() };
            let seen = Seen { origins_m: &[sensor_m.map(|v| v as f32)], ..self.points_m.as_slice().into() };
            self.matcher.climb(&self.map, seen, &prior, start)
        };
        let explained = |fit: &Fit| fit.known_share * fit.inlier_share;
        let first = climb(starts[0]);
        if starts[0] == starts[1] {
            return first;
        }
        let second = climb(starts[1]);
        if explained(&second) > explained(&first) + BETTER_SHARE { second } else { first }
    }
}
