//! Step 8, report: what stages know, put together. Written once for the plane and for space.

use crate::pose::RobotPose;
use crate::store::Store;
use mapwright_geom::{Pose, Stamp};
use mapwright_record::{LocalMapReport, Localisation, MatchReport, Measurement, NodeId, Status, Update};
use mapwright_sensor::BeamCounts;

/// The newest scan or cloud.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Newest {
    pub(crate) stamp: Stamp,
    pub(crate) status: Status,
}

/// What an update says of one beside what is asked of the stages.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Told {
    pub(crate) keyframe: Option<NodeId>,
    pub(crate) beams: BeamCounts,
    pub(crate) matched: Option<MatchReport>,
    pub(crate) refused: Option<&'static str>,
}

/// How the robot is off.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Whereabouts<'a, P: Pose> {
    pub(crate) pose: &'a RobotPose<P>,
    /// At the newest stamp, in the map.
    pub(crate) map_from_robot: P,
    /// Of that, relative to the anchor, of which the map is made where there is none.
    pub(crate) covariance: P::Matrix,
    pub(crate) localisation: Localisation,
    pub(crate) local_map: LocalMapReport,
    pub(crate) waiting_keyframes: u32,
}

/// Everything that anybody outside may know, with the entries since the last time.
pub(crate) fn update<M: Measurement>(
    store: &mut Store<M>,
    robot: Whereabouts<'_, M::Pose>,
    newest: Newest,
    told: Told,
) -> Update<M> {
    let (entries, unwritten) = store.take_fresh();
    let Whereabouts { pose, map_from_robot, covariance, localisation, local_map, waiting_keyframes } = robot;
    let odom_from_robot = pose.odom_from_robot();
    Update {
        scan: store.next_scan().saturating_sub(1),
        stamp: newest.stamp,
        map_from_robot,
        covariance,
        anchor: pose.anchor().map(|node| store.id(node)),
        status: newest.status,
        localisation,
        map_from_odom: map_from_robot * odom_from_robot.inverse(),
        odom_from_robot,
        keyframe: told.keyframe.map(|node| store.id(node)),
        beams: told.beams,
        matched: told.matched,
        refused: told.refused,
        local_map,
        waiting_keyframes,
        entries,
        unwritten,
    }
}
