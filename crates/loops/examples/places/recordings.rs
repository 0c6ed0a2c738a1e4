//! Drives with what was seen on the way and which places are truly the same.

use mapwright_formats::{CarmenReader, LogEvent, StampedPose2, open_log, read_trajectory};
use mapwright_geom::{Pose2, Stamp};
use mapwright_sensor::{BeamTable, Sweep, SweepPoints};
use mapwright_sim::{Drive, DriveSettings, LaserSettings, Rng, Site, view_overlap};
use std::error::Error;
use std::f64::consts::TAU;
use std::fs::File;
use std::sync::Arc;

/// A keyframe.
pub(crate) struct Place {
    pub(crate) stamp: Stamp,
    pub(crate) along_m: f64,
    pub(crate) world_from_robot: Pose2,
    pub(crate) hits: Vec<[f64; 2]>,
}

/// A drive's keyframes.
pub(crate) struct Recording {
    pub(crate) places: Vec<Place>,
    /// For each keyframe the earlier ones that are the same place.
    pub(crate) same: Vec<Vec<u32>>,
    odom_from_robot: Vec<Pose2>,
}

const SPACING_M: f64 = 0.5;
const TURN_RAD: f64 = 0.5;
/// Earlier places are at least so much way apart, metres.
pub(crate) const APART_M: f64 = 20.0;
/// Hits beyond show nothing of a place, metres.
const REACH_M: f64 = 15.0;
/// Places of a log nearer than this are the same: what verifying a hit searches.
const SAME_M: f64 = 3.0;
/// Overlap from which two simulated places are the same.
const OVERLAP: f64 = 0.5;

impl Recording {
    /// A simulated drive; places overlap as seen by a laser that looks all around.
    pub(crate) fn simulated(site: &Arc<Site>, settings: &DriveSettings) -> Self {
        let settings = DriveSettings { scan_rate_hz: 4.0, ..settings.clone() };
        let scans = Drive::new(Arc::clone(site), settings.clone()).scans();
        let sweeps = scans.map(|s| (Sweep::from_scan(&s.scan, [0.0; 3]).0, s.scan.stamp, s.world_from_robot));
        let all_around =
            DriveSettings { laser: LaserSettings::with_field_of_view(TAU, 360), ..DriveSettings::default() };
        let overlap = |a: &Place, b: &Place| {
            view_overlap(&site.world, &all_around, a.world_from_robot, b.world_from_robot) > OVERLAP
        };
        Self::of(sweeps, settings.seed, overlap)
    }

    /// A log with a trajectory that is near the truth. Places are the same by position alone: a truth made of the hits
    /// would choose those places that look alike to what is being judged.
    pub(crate) fn real(log: &str, trajectory: &str) -> Result<Self, Box<dyn Error>> {
        let poses = read_trajectory(File::open(trajectory)?)?;
        // Stamps of a log may step backwards; its trajectory has a row for each scan that has one, in the log's order.
        let mut poses = poses.into_iter().peekable();
        let mut sweeps = Vec::new();
        let mut reader = CarmenReader::new(open_log(File::open(log)?)?);
        while let Some(event) = reader.next_event()? {
            let LogEvent::Scan(scan) = event else { continue };
            let of_scan = |pose: &StampedPose2| pose.stamp.secs_since(scan.stamp).abs() < 1e-4;
            if let Some(pose) = poses.next_if(of_scan) {
                sweeps.push((Sweep::from_scan(scan, [0.0; 3]).0, scan.stamp, pose.world_from_robot));
            }
        }
        if let Some(pose) = poses.next() {
            return Err(format!("{trajectory}: no scan of {log} for the pose at {:?}", pose.stamp).into());
        }
        let mut recording = Self::of(sweeps.into_iter(), 1, |_, _| false);
        recording.find_same(SAME_M, |_, _, _| true);
        Ok(recording)
    }

    fn of(
        sweeps: impl Iterator<Item = (Sweep, Stamp, Pose2)>,
        seed: u64,
        overlap: impl Fn(&Place, &Place) -> bool,
    ) -> Self {
        let mut rng = Rng::keyed(seed, 77);
        let (mut places, mut odom_from_robot) = (Vec::<Place>::new(), vec![Pose2::IDENTITY]);
        let (mut table, mut points) = (BeamTable::default(), SweepPoints::default());
        let (mut along_m, mut before) = (0.0, None);
        for (sweep, stamp, world_from_robot) in sweeps {
            along_m += before.replace(world_from_robot).map_or(0.0, |b: Pose2| b.distance(world_from_robot));
            let step = places.last().map(|place| place.world_from_robot.between(world_from_robot));
            if step.is_some_and(|step| step.x.hypot(step.y) < SPACING_M && step.theta.abs() < TURN_RAD) {
                continue;
            }
            points.fill(&sweep, &mut table, 1.0);
            let hits = points.hits.iter().copied().filter(|p| p[0].hypot(p[1]) < REACH_M).collect();
            if let Some(step) = step {
                let noisy = |v: f64, rng: &mut Rng| v + rng.normal(0.01 * v.abs());
                let turn = step.theta + rng.normal(0.003 + 0.01 * step.theta.abs());
                let noisy = Pose2::new(noisy(step.x, &mut rng), noisy(step.y, &mut rng), turn);
                odom_from_robot.push(odom_from_robot[odom_from_robot.len() - 1] * noisy);
            }
            places.push(Place { stamp, along_m, world_from_robot, hits });
        }
        let mut recording = Self { same: vec![Vec::new(); places.len()], places, odom_from_robot };
        recording.find_same(10.0, |r, a, b| overlap(&r.places[a], &r.places[b]));
        recording
    }

    fn find_same(&mut self, within_m: f64, overlap: impl Fn(&Self, usize, usize) -> bool) {
        self.same = (0..self.places.len())
            .map(|k| {
                let here = &self.places[k];
                let earlier = (0..k).filter(|&e| {
                    let there = &self.places[e];
                    here.along_m - there.along_m > APART_M
                        && here.world_from_robot.distance(there.world_from_robot) < within_m
                        && overlap(self, e, k)
                });
                earlier.map(|e| e as u32).collect()
            })
            .collect();
    }

    /// End points of the keyframes of the last `length_m` of way in the frame of the last one, the newest first.
    pub(crate) fn submap(&self, k: usize, length_m: f64) -> Vec<[f64; 2]> {
        let mut points = Vec::new();
        for j in (0..=k).rev() {
            if self.places[k].along_m - self.places[j].along_m > length_m {
                break;
            }
            let k_from_j = self.odom_from_robot[k].between(self.odom_from_robot[j]);
            points.extend(self.places[j].hits.iter().map(|&p| k_from_j.transform(p)));
        }
        points
    }

    /// The same with no keyframe before `first`.
    pub(crate) fn submap_from(&self, k: usize, first: usize) -> Vec<[f64; 2]> {
        let k_from = |j: usize| self.odom_from_robot[k].between(self.odom_from_robot[j]);
        (first..=k).flat_map(|j| self.places[j].hits.iter().map(move |&p| k_from(j).transform(p))).collect()
    }

    pub(crate) fn apart_m(&self, earlier: usize, later: usize) -> f64 {
        self.places[later].along_m - self.places[earlier].along_m
    }

    pub(crate) fn pose(&self, k: usize) -> Pose2 {
        self.places[k].world_from_robot
    }

    pub(crate) fn overlap(&self, earlier: usize, later: usize) -> bool {
        self.same[later].contains(&(earlier as u32))
    }
}
