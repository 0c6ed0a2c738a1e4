//! The relation error of Kümmerle et al. 2009, "On measuring the accuracy of SLAM algorithms".

use crate::associate::StampedPose;
use crate::stats::PoseErrors;
use mapwright_geom::{Pose2, Stamp};

/// Relations that join stamps closer than this are reported apart: the local error, seconds.
const NEAR_S: f64 = 10.0;
/// Relations that join stamps further apart than this are reported apart: the global error, seconds.
const FAR_S: f64 = 60.0;
/// How many missing relations are named.
const NAMED_MISSING: usize = 5;

/// A surveyed relative pose of the robot at two stamps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Relation {
    /// Stamp of the first pose.
    pub from: Stamp,
    /// Stamp of the second pose.
    pub to: Stamp,
    /// The robot at `to`, seen from the robot at `from`.
    pub from_from_to: Pose2,
}

/// The error of one relation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RelationError {
    /// Place in the list of relations.
    pub index: usize,
    /// Seconds between the two stamps, never negative.
    pub apart_s: f64,
    /// Length of the translation error, metres.
    pub translation_m: f64,
    /// Absolute heading error, degrees.
    pub rotation_deg: f64,
}

/// Which stamp of a relation the trajectory does not have.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MissingSide {
    /// The first.
    From,
    /// The second.
    To,
    /// Neither is there.
    Both,
}

/// A relation that could not be used.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MissingRelation {
    /// Place in the list of relations.
    pub index: usize,
    /// The relation.
    pub relation: Relation,
    /// Which stamp the trajectory does not have.
    pub side: MissingSide,
}

/// What the relations say about a trajectory.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RelationReport {
    /// Relations used.
    pub used: usize,
    /// Relations with a stamp that the trajectory does not have.
    pub missing: usize,
    /// The first few of them.
    pub first_missing: Vec<MissingRelation>,
    /// Relations left out because they or their poses contain NaN or infinity.
    pub not_finite: usize,
    /// Statistics of all relations used.
    pub all: Option<PoseErrors>,
    /// Statistics of those whose stamps are less than 10 s apart.
    pub within_10_s: Option<PoseErrors>,
    /// Statistics of those whose stamps are more than 60 s apart.
    pub beyond_60_s: Option<PoseErrors>,
    /// The error of each relation used, in the order of the relations.
    pub errors: Vec<RelationError>,
}

/// Compares the relative poses of a trajectory with surveyed ones.
///
/// The error of a relation is `from_from_to^-1 (world_from_from^-1 world_from_to)`; its length and its absolute heading
/// are reported apart, as in the tables of Kümmerle et al. 2009.
///
/// Relation files print stamps with six decimals, so stamps are compared after rounding to a microsecond. Poses need not
/// be in the order of time. Where a stamp repeats in it, its first pose counts.
#[must_use]
pub fn relation_errors(trajectory: &[StampedPose], relations: &[Relation]) -> RelationReport {
    let poses = PosesByStamp::new(trajectory);
    let mut report = RelationReport::default();
    for (index, relation) in relations.iter().enumerate() {
        match (poses.get(relation.from), poses.get(relation.to)) {
            (Some(world_from_from), Some(world_from_to)) => {
                report.add(error_of(index, relation, world_from_from.between(world_from_to)));
            }
            (None, Some(_)) => report.add_missing(index, relation, MissingSide::From),
            (Some(_), None) => report.add_missing(index, relation, MissingSide::To),
            (None, None) => report.add_missing(index, relation, MissingSide::Both),
        }
    }
    report.summarise();
    report
}

fn error_of(index: usize, relation: &Relation, estimated_from_from_to: Pose2) -> RelationError {
    let error = relation.from_from_to.between(estimated_from_from_to);
    RelationError {
        index,
        apart_s: relation.to.secs_since(relation.from).abs(),
        translation_m: error.x.hypot(error.y),
        rotation_deg: error.theta.abs().to_degrees(),
    }
}

impl RelationReport {
    fn add(&mut self, error: RelationError) {
        if error.translation_m.is_finite() && error.rotation_deg.is_finite() {
            self.used += 1;
            self.errors.push(error);
        } else {
            self.not_finite += 1;
        }
    }

    fn add_missing(&mut self, index: usize, relation: &Relation, side: MissingSide) {
        self.missing += 1;
        if self.first_missing.len() < NAMED_MISSING {
            self.first_missing.push(MissingRelation { index, relation: *relation, side });
        }
    }

    fn summarise(&mut self) {
        self.all = self.statistics(|_| true);
        self.within_10_s = self.statistics(|apart_s| apart_s < NEAR_S);
        self.beyond_60_s = self.statistics(|apart_s| apart_s > FAR_S);
    }

    fn statistics(&self, belongs: impl Fn(f64) -> bool) -> Option<PoseErrors> {
        let chosen = self.errors.iter().filter(|e| belongs(e.apart_s));
        PoseErrors::of(&chosen.map(|e| (e.translation_m, e.rotation_deg)).collect::<Vec<_>>())
    }
}

/// Poses to be found by their stamp's microsecond.
struct PosesByStamp(Vec<(i64, Pose2)>);

impl PosesByStamp {
    fn new(trajectory: &[StampedPose]) -> Self {
        let mut poses: Vec<_> = trajectory.iter().map(|p| (microseconds(p.stamp), p.world_from_robot)).collect();
        poses.sort_by_key(|(stamp_us, _)| *stamp_us); // stable: of equal stamps the first stays first
        Self(poses)
    }

    fn get(&self, stamp: Stamp) -> Option<Pose2> {
        let wanted = microseconds(stamp);
        let place = self.0.partition_point(|(stamp_us, _)| *stamp_us < wanted);
        self.0.get(place).filter(|(stamp_us, _)| *stamp_us == wanted).map(|(_, pose)| *pose)
    }
}

fn microseconds(stamp: Stamp) -> i64 {
    stamp.0.saturating_add(500).div_euclid(1000)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn at(seconds: f64, x: f64, theta: f64) -> StampedPose {
        StampedPose { stamp: Stamp::from_secs_f64(seconds), world_from_robot: Pose2::new(x, 0.0, theta) }
    }

    fn relation(from_s: f64, to_s: f64, x: f64) -> Relation {
        let from_from_to = Pose2::new(x, 0.0, 0.0);
        Relation { from: Stamp::from_secs_f64(from_s), to: Stamp::from_secs_f64(to_s), from_from_to }
    }

    #[test]
    fn near_and_far_relations_are_told_apart() {
        let trajectory = [at(0.0, 0.0, 0.0), at(100.0, 9.0, 0.1), at(5.0, 1.5, 0.0)];
        let relations = [relation(0.0, 5.0, 1.0), relation(100.0, 0.0, -9.0), relation(30.0, 0.0, 0.0)];
        let report = relation_errors(&trajectory, &relations);
        assert_eq!((report.used, report.missing, report.first_missing[0].index), (2, 1, 2));
        assert_eq!(report.first_missing[0].side, MissingSide::From);
        assert!((report.within_10_s.unwrap().translation_m.mean - 0.5).abs() < 1e-12);
        let far = report.beyond_60_s.unwrap();
        assert!((far.rotation_deg.mean - 0.1f64.to_degrees()).abs() < 1e-12);
        assert!((far.translation_m.mean - 2.0 * 9.0 * 0.05f64.sin()).abs() < 1e-12);
        assert_eq!(report.all.unwrap().translation_m.count, 2);
    }

    #[test]
    fn a_repeated_stamp_counts_once_and_nan_never() {
        let trajectory = [at(2.0, 5.0, 0.0), at(1.0, 0.0, 0.0), at(2.0, 7.0, 0.0), at(3.0, f64::NAN, 0.0)];
        let report = relation_errors(&trajectory, &[relation(1.0, 2.0, 5.0), relation(1.0, 3.0, 5.0)]);
        assert_eq!((report.used, report.not_finite), (1, 1));
        assert_eq!(report.all.unwrap().translation_m.max, 0.0);
    }

    #[test]
    fn stamps_of_the_unix_epoch_meet_by_their_microsecond() {
        let trajectory = [
            StampedPose { stamp: Stamp(976_052_905_167_303_128), world_from_robot: Pose2::IDENTITY },
            StampedPose { stamp: Stamp(976_052_911_885_495_901), world_from_robot: Pose2::IDENTITY },
        ];
        let relations = [relation(976_052_905.167_303, 976_052_911.885_496, 0.0)];
        assert_eq!(relation_errors(&trajectory, &relations).used, 1);
        assert_eq!(relation_errors(&[], &relations).first_missing[0].side, MissingSide::Both);
    }

    proptest! {
        #[test]
        fn the_maps_frame_does_not_matter(x in -99.0..99.0f64, y in -99.0..99.0f64, theta in -3.1..3.1f64) {
            let trajectory: Vec<_> = (0..20).map(f64::from).map(|k| at(k, 0.1 * k, 0.2 * k)).collect();
            let relations: Vec<_> = (0..19).map(|k| relation(f64::from(k), f64::from(k + 1), 0.3)).collect();
            let map_from_world = Pose2::new(x, y, theta);
            let moved: Vec<_> = trajectory
                .iter()
                .map(|p| StampedPose { world_from_robot: map_from_world * p.world_from_robot, ..*p })
                .collect();
            let (a, b) = (relation_errors(&trajectory, &relations), relation_errors(&moved, &relations));
            prop_assert!((a.all.unwrap().translation_m.sse - b.all.unwrap().translation_m.sse).abs() < 1e-9);
            prop_assert!((a.all.unwrap().rotation_deg.sse - b.all.unwrap().rotation_deg.sse).abs() < 1e-6);
        }
    }
}
