//! A simulated drive that was mapped, with the truth beside it, and what the map joins.

use crate::failure::Failure;
use crate::pose_graph::standing;
use mapwright::{
    Cloud, Edge, EdgeKind, Mapper, Pose2, Pose3, Session, Settings, SpaceMapper, SpaceSweep, Stamp, Sweep,
    TrajectoryPose, Update,
};
use mapwright_eval::{
    Alignment, ErrorStats, EvalError, PosePair, Relation, RpeSettings, StampedPose, ate_of_pairs, space_errors,
};
use mapwright_geom::{Pose, Tangent};
use mapwright_record::Measurement;
use mapwright_sim::space::{SpaceDrive, TrueCloud};
use mapwright_sim::{Drive, DriveSettings, Event, HasScan, LaserSettings, TrueScan, worlds};
use serde::Serialize;

/// A match to a keyframe with more way than this between has closed a loop, metres.
pub(crate) const CLOSING_FROM_M: f64 = 20.0;
/// What is right lies within this of the truth, metres and degrees.
pub(crate) const RIGHT_M: f64 = 0.3;
pub(crate) const RIGHT_DEG: f64 = 3.0;

/// People on an office floor.
pub(crate) const PEOPLE: usize = 6;

/// The truth is compared over pairs of scans: so many scans apart, and wherever the robot comes back.
const STEP_SCANS: usize = 50;
/// A place is met again within this distance, metres, and after this time, seconds.
const AGAIN_WITHIN_M: f64 = 1.0;
const AGAIN_AFTER_S: f64 = 60.0;
/// Every so many-th scan is looked at.
const LOOK_EVERY: usize = 10;

/// A robot with a laser as they are sold, through a floor with people in it.
pub(crate) fn office(seed: u64, people: usize) -> Drive {
    let site = worlds::office_floor(seed).with_people(people, seed);
    let laser = LaserSettings {
        range_sigma_m: 0.015,
        no_return_probability: 0.001,
        random_reading_probability: 1e-4,
        quantum_m: 0.01,
        ..LaserSettings::default()
    };
    Drive::new(site.into(), DriveSettings { laser, seed, ..DriveSettings::default() })
}

/// Relations as a surveyor would take them: along the way, and between visits of the same place.
pub(crate) fn true_relations(truth: &[StampedPose]) -> Vec<Relation> {
    let relation = |a: &StampedPose, b: &StampedPose| {
        let from_from_to: Pose2 = a.world_from_robot.between(b.world_from_robot);
        Relation { from: a.stamp, to: b.stamp, from_from_to }
    };
    let looked_at: Vec<_> = truth.iter().step_by(LOOK_EVERY).collect();
    let along = looked_at.iter().zip(looked_at.iter().skip(STEP_SCANS / LOOK_EVERY)).map(|(a, b)| relation(a, b));
    let again = looked_at.iter().enumerate().filter_map(|(at, later)| {
        let met = looked_at[..at].iter().find(|earlier| {
            later.stamp.secs_since(earlier.stamp) > AGAIN_AFTER_S
                && earlier.world_from_robot.distance(later.world_from_robot) < AGAIN_WITHIN_M
        });
        met.map(|earlier| relation(earlier, later))
    });
    along.chain(again).collect()
}

/// A mapped drive, of the plane or of space.
pub(crate) struct Simulated<M: Measurement = Sweep> {
    session: Session<M>,
    /// Every scan in arrival order.
    scans: Vec<Taken<M::Pose>>,
}

/// A scan without what was seen.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Taken<P> {
    pub(crate) stamp: Stamp,
    /// The truth.
    pub(crate) world_from_robot: P,
    /// The truth at the time that a keyframe of this scan stands for: in space the middle of the sweep.
    pub(crate) world_from_keyframe: P,
    /// What the wheels say then.
    pub(crate) odom_from_keyframe: Option<P>,
    /// True length of the way up to here, metres.
    along_m: f64,
}

/// How far a relative pose lies from the truth.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct PoseError {
    pub(crate) metres: f64,
    pub(crate) degrees: f64,
}

impl PoseError {
    pub(crate) fn of<P: Pose>(found: P, truth: P) -> Self {
        let error = truth.between(found);
        Self { metres: error.length(), degrees: error.angle().to_degrees() }
    }

    /// Both together; at the bounds of what is right each counts one.
    pub(crate) fn size(self) -> f64 {
        self.metres / RIGHT_M + self.degrees / RIGHT_DEG
    }

    pub(crate) fn is_right(self) -> bool {
        self.metres <= RIGHT_M && self.degrees <= RIGHT_DEG
    }
}

/// An edge that joins the map to itself: a closure, or a match to a keyframe [`CLOSING_FROM_M`] of way back.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Closing {
    pub(crate) kind: EdgeKind,
    pub(crate) from: usize,
    pub(crate) to: usize,
    /// What was measured, against the truth.
    pub(crate) measured: PoseError,
    /// Where the final map has the two keyframes, against the truth.
    pub(crate) in_map: PoseError,
    /// What was measured against the truth, by the uncertainty that the edge states.
    pub(crate) stated_chi2: f64,
}

impl Closing {
    /// Measured right, and right in the final map.
    pub(crate) fn is_right(&self) -> bool {
        self.measured.is_right() && self.in_map.is_right()
    }
}

impl Simulated {
    /// Maps a drive.
    pub(crate) fn map(drive: Drive, settings: &Settings) -> Result<Self, Failure> {
        Self::map_watched(drive, settings, |_, _, _| {})
    }

    /// Maps a drive; `watch` sees the mapper after every scan, its update and the robot's true pose.
    pub(crate) fn map_watched(
        drive: impl Iterator<Item = Event>,
        settings: &Settings,
        mut watch: impl FnMut(&Mapper, &Update, Pose2),
    ) -> Result<Self, Failure> {
        let mut scans: Vec<Taken<Pose2>> = Vec::new();
        let session = map_events(drive, settings, |mapper, update, scan: &TrueScan| {
            let truth = scan.world_from_robot;
            scans.push(Taken {
                stamp: scan.scan.stamp,
                world_from_robot: truth,
                world_from_keyframe: truth,
                odom_from_keyframe: scan.scan.odom_from_robot,
                along_m: along_m(&scans, truth),
            });
            watch(mapper, update, truth);
        })?;
        Ok(Self { session, scans })
    }
}

/// Maps what was recorded, simulated or real; `watch` sees the mapper after every scan, its update and the scan.
pub(crate) fn map_events<S: HasScan>(
    events: impl Iterator<Item = Event<S>>,
    settings: &Settings,
    mut watch: impl FnMut(&Mapper, &Update, &S),
) -> Result<Session, Failure> {
    let mut mapper = Mapper::new(*settings)?;
    for event in events {
        match event {
            Event::Odometry(odometry) => mapper.add_odometry(&odometry),
            Event::Scan(scan) => {
                let update = mapper.add_scan(scan.scan());
                watch(&mapper, &update, &scan);
            }
        }
    }
    mapper.look_again();
    Ok(mapper.session().clone())
}

impl Simulated<SpaceSweep> {
    /// Maps every so many-th cloud of a drive in space; `watch` sees the mapper after each, its update and the clouds so far.
    pub(crate) fn map_space(
        drive: &SpaceDrive,
        every: usize,
        settings: &Settings,
        mut watch: impl FnMut(&SpaceMapper, &Update<SpaceSweep>, &[Taken<Pose3>]),
    ) -> Result<Self, Failure> {
        let mut mapper = SpaceMapper::new(*settings)?;
        let mut scans: Vec<Taken<Pose3>> = Vec::new();
        for number in (0..).step_by(every.max(1)) {
            let Some(taken) = drive.cloud(number) else { break };
            scans.push(Taken::of_cloud(drive, &taken, &scans));
            let update = mapper.add_cloud(&taken.cloud);
            watch(&mapper, &update, &scans);
        }
        mapper.look_again();
        Ok(Self { session: mapper.session().clone(), scans })
    }
}

impl Taken<Pose3> {
    pub(crate) fn of_cloud(drive: &SpaceDrive, taken: &TrueCloud, before: &[Self]) -> Self {
        let TrueCloud { cloud, world_from_robot } = taken;
        let middle = middle_of(cloud);
        Self {
            stamp: cloud.stamp,
            world_from_robot: *world_from_robot,
            world_from_keyframe: drive.world_from_robot(middle).unwrap_or(*world_from_robot),
            odom_from_keyframe: drive.odom_from_robot(middle).or(cloud.odom_from_robot),
            along_m: along_m(before, *world_from_robot),
        }
    }
}

/// The middle of a sweep.
fn middle_of(cloud: &Cloud) -> Stamp {
    let times = || cloud.times_s.iter().copied();
    let (first_s, last_s) = (times().fold(f32::INFINITY, f32::min), times().fold(f32::NEG_INFINITY, f32::max));
    let middle_s = if first_s <= last_s { 0.5 * f64::from(first_s + last_s) } else { 0.0 };
    Stamp(cloud.stamp.0 + (1e9 * middle_s).round() as i64)
}

/// True length of the way up to a pose after these scans, metres.
fn along_m<P: Pose>(scans: &[Taken<P>], truth: P) -> f64 {
    scans.last().map_or(0.0, |before| before.along_m + before.world_from_robot.distance(truth))
}

/// Poses of which trajectories are scored.
pub(crate) trait Scored: Pose {
    /// ATE of stamps, true poses and estimated ones, aligned rigidly, metres.
    fn ate(poses: &[(Stamp, Self, Self)]) -> Result<ErrorStats, EvalError>;
}

impl Scored for Pose2 {
    fn ate(poses: &[(Stamp, Self, Self)]) -> Result<ErrorStats, EvalError> {
        let pair =
            |&(stamp, world_from_robot, map_from_robot): &_| PosePair { stamp, world_from_robot, map_from_robot };
        let pairs: Vec<_> = poses.iter().map(pair).collect();
        Ok(ate_of_pairs(&pairs, Alignment::Rigid)?.translation_m)
    }
}

impl Scored for Pose3 {
    fn ate(poses: &[(Stamp, Self, Self)]) -> Result<ErrorStats, EvalError> {
        let truth: Vec<_> = poses.iter().map(|&(stamp, truth, _)| (stamp, truth)).collect();
        let estimate: Vec<_> = poses.iter().map(|&(stamp, _, estimate)| (stamp, estimate)).collect();
        Ok(space_errors(&truth, &estimate, Alignment::Rigid, &RpeSettings::default())?.absolute.translation_m)
    }
}

impl<M: Measurement<Pose: Scored>> Simulated<M> {
    /// A drive that was mapped, with its scans in arrival order.
    pub(crate) fn of(session: Session<M>, scans: Vec<Taken<M::Pose>>) -> Self {
        Self { session, scans }
    }

    /// True length of the way, metres.
    pub(crate) fn length_m(&self) -> f64 {
        self.scans.last().map_or(0.0, |scan| scan.along_m)
    }

    pub(crate) fn scan_count(&self) -> usize {
        self.scans.len()
    }

    pub(crate) fn session(&self) -> &Session<M> {
        &self.session
    }

    /// Where the final map has each keyframe.
    pub(crate) fn keyframe_poses(&self) -> &[M::Pose] {
        self.session.map_from_keyframe()
    }

    pub(crate) fn keyframe_count(&self) -> usize {
        self.session().keyframes().len()
    }

    fn scan_of(&self, keyframe: usize) -> Taken<M::Pose> {
        self.scans[self.session().keyframes()[keyframe].scan as usize]
    }

    /// True pose of the robot at a keyframe, in space in the middle of its sweep.
    pub(crate) fn truth(&self, keyframe: usize) -> M::Pose {
        self.scan_of(keyframe).world_from_keyframe
    }

    /// True pose of the robot at the scan nearest to a stamp; there is one.
    pub(crate) fn truth_at(&self, stamp: Stamp) -> M::Pose {
        let nearest = self.scans.iter().min_by_key(|scan| scan.stamp.0.abs_diff(stamp.0));
        nearest.map_or(M::Pose::identity(), |scan| scan.world_from_robot)
    }

    /// True length of the way up to a keyframe, metres.
    pub(crate) fn along_m(&self, keyframe: usize) -> f64 {
        self.scan_of(keyframe).along_m
    }

    /// True length of the way up to the last scan before a stamp, or of that stamp, metres.
    pub(crate) fn along_at_m(&self, stamp: Stamp) -> f64 {
        let after = self.scans.partition_point(|scan| scan.stamp <= stamp);
        self.scans[..after].last().map_or(0.0, |scan| scan.along_m)
    }

    pub(crate) fn stamp(&self, keyframe: usize) -> Stamp {
        self.scan_of(keyframe).stamp
    }

    /// One keyframe seen from another, as the wheels say.
    pub(crate) fn wheels_between(&self, from: usize, to: usize) -> Option<M::Pose> {
        let [from, to] = [from, to].map(|keyframe| self.scan_of(keyframe).odom_from_keyframe);
        Some(from?.between(to?))
    }

    /// The truth that an edge between two keyframes should say.
    pub(crate) fn true_between(&self, from: usize, to: usize) -> M::Pose {
        self.truth(from).between(self.truth(to))
    }

    /// Where these poses have one keyframe seen from another, against the truth.
    pub(crate) fn error_between(&self, world_from_keyframe: &[M::Pose], from: usize, to: usize) -> PoseError {
        PoseError::of(world_from_keyframe[from].between(world_from_keyframe[to]), self.true_between(from, to))
    }

    /// The keyframe nearest to a stamp in time; none where there is no keyframe.
    pub(crate) fn keyframe_at(&self, stamp: Stamp) -> Option<usize> {
        let keyframes = self.session().keyframes();
        let after = keyframes.partition_point(|keyframe| keyframe.stamp < stamp);
        let near = after.saturating_sub(1)..(after + 1).min(keyframes.len());
        near.min_by_key(|&k| keyframes[k].stamp.0.abs_diff(stamp.0))
    }

    /// Length of the way between two keyframes, metres.
    pub(crate) fn apart_m(&self, [from, to]: [usize; 2]) -> f64 {
        (self.along_m(to) - self.along_m(from)).abs()
    }

    /// Whether an edge joins the map to itself, be it right or wrong, believed or not.
    pub(crate) fn closes(&self, ends: [usize; 2], edge: &Edge<M::Pose>) -> bool {
        match edge.kind {
            EdgeKind::Odometry => false,
            EdgeKind::Match => self.apart_m(ends) > CLOSING_FROM_M,
            EdgeKind::Closure => true,
        }
    }

    /// Every edge that closes, but those that were withdrawn.
    pub(crate) fn closings(&self) -> Vec<Closing> {
        let closing = |([from, to], edge): ([usize; 2], &Edge<M::Pose>)| {
            let measured = PoseError::of(edge.from_from_to, self.true_between(from, to));
            let in_map = self.error_between(self.keyframe_poses(), from, to);
            let stated_chi2 = self.true_between(from, to).local(edge.from_from_to).squared_by(&edge.information);
            Closing { kind: edge.kind, from: from.min(to), to: from.max(to), measured, in_map, stated_chi2 }
        };
        standing(self.session()).filter(|(ends, edge)| self.closes(*ends, edge)).map(closing).collect()
    }

    /// ATE of the keyframes at these poses, aligned, rmse in metres.
    pub(crate) fn keyframe_ate_m(&self, world_from_keyframe: &[M::Pose]) -> Result<f64, EvalError> {
        let pose = |(k, &estimate): (usize, &M::Pose)| (self.stamp(k), self.truth(k), estimate);
        Ok(M::Pose::ate(&world_from_keyframe.iter().enumerate().map(pose).collect::<Vec<_>>())?.rmse)
    }

    /// ATE of the whole final trajectory, every scan, aligned, rmse in metres.
    pub(crate) fn trajectory_ate_m(&self) -> Result<f64, EvalError> {
        Ok(self.trajectory_ate()?.rmse)
    }

    /// ATE of the whole final trajectory, every scan, aligned, metres.
    pub(crate) fn trajectory_ate(&self) -> Result<ErrorStats, EvalError> {
        let poses = self.session.trajectory().zip(&self.scans);
        let pose = |(pose, scan): (TrajectoryPose<M::Pose>, &Taken<M::Pose>)| {
            (scan.stamp, scan.world_from_robot, pose.map_from_robot)
        };
        M::Pose::ate(&poses.map(pose).collect::<Vec<_>>())
    }
}
