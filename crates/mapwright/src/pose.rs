//! Where the robot is in the front end's frame, and how certain that is relative to the anchor: the keyframe that supplied
//! most of what the last scan was matched with.

use mapwright_geom::{Pose, Pose2, Stored, TangentMatrix, compose_covariance, is_covariance, is_in_place};
use mapwright_record::{Measurement, NodeId, Past};

/// Keyframes back from the newest over which the chain of covariances is kept in mind.
const CHAIN: usize = 64;
/// Error of the map between the anchor and here that no single match shows: at the anchor and per metre away from it,
/// for positions (m) and headings (rad); calibrated with the scale of the information (`tests/consistency.rs`).
const MAP_FLOOR: [[f64; 2]; 2] = [[0.0005, 0.0007], [0.0007, 0.0006]];

/// The robot's pose and covariances.
#[derive(Debug, Clone)]
pub struct RobotPose<P: Pose = Pose2> {
    local_from_robot: P,
    odom_from_robot: P,
    /// Information of the last match, zero where there was none.
    information: P::Matrix,
    /// Motion-model covariance alone, relative to the newest keyframe.
    odometry_since_keyframe: P::Matrix,
    /// Fused covariance of each keyframe relative to the one before.
    links: Vec<P::Matrix>,
    anchor: Option<NodeId>,
    /// Covariance of the newest keyframe relative to the anchor.
    keyframe_from_anchor: P::Matrix,
}

/// The motion of a scan since the one before.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Motion<P: Pose> {
    pub(crate) last_from_robot: P,
    /// Its covariance by the motion model.
    pub(crate) noise: P::Matrix,
    /// Where the robot is after it.
    pub(crate) predicted: P,
}

impl<P: Pose> RobotPose<P> {
    pub(crate) fn new(local_from_robot: P) -> Self {
        Self {
            local_from_robot,
            odom_from_robot: P::identity(),
            information: P::Matrix::zero(),
            odometry_since_keyframe: P::Matrix::zero(),
            links: Vec::new(),
            anchor: None,
            keyframe_from_anchor: P::Matrix::zero(),
        }
    }

    /// A robot that goes on where it was: the fused covariances of all keyframes relative to the ones before, and the motion model's
    /// since the newest.
    pub(crate) fn resume(local_from_robot: P, links: Vec<P::Matrix>, odometry_since_keyframe: P::Matrix) -> Self {
        Self { links, odometry_since_keyframe, ..Self::new(local_from_robot) }
    }

    pub(crate) fn local_from_robot(&self) -> P {
        self.local_from_robot
    }

    pub(crate) fn odom_from_robot(&self) -> P {
        self.odom_from_robot
    }

    pub(crate) fn anchor(&self) -> Option<NodeId> {
        self.anchor
    }

    /// Motion-model covariance alone, relative to the newest keyframe.
    pub(crate) fn odometry_since_keyframe(&self) -> P::Matrix {
        self.odometry_since_keyframe
    }

    /// Of the newest keyframe-to-be relative to the one before, by wheels and scan together.
    pub(crate) fn fused(&self) -> P::Matrix {
        fuse(&self.odometry_since_keyframe, &self.information)
    }

    /// Takes the motion of a scan over, and where it was matched and the information of that, if that is believed; `anchor` supplied
    /// it. The motion since the scan before.
    pub(crate) fn settle<M: Measurement<Pose = P>>(
        &mut self,
        past: Past<'_, M>,
        motion: Motion<P>,
        matched: Option<(P, P::Matrix)>,
        anchor: Option<NodeId>,
    ) -> P {
        let before = self.local_from_robot;
        let Motion { last_from_robot, noise, predicted } = motion;
        self.information = P::Matrix::zero();
        self.odometry_since_keyframe = compose_covariance(&self.odometry_since_keyframe, last_from_robot, &noise);
        self.local_from_robot = predicted;
        if let Some((local_from_robot, information)) = matched {
            (self.local_from_robot, self.information) = (local_from_robot, information);
            self.anchor_at(past, anchor);
        }
        let newest = past.local_from_keyframe.last();
        let is_near = newest.is_none_or(|newest| newest.between(self.local_from_robot).is_within_bounds());
        if !self.local_from_robot.is_within_bounds() || !is_near {
            self.local_from_robot = before;
        }
        let odom_from_robot = self.odom_from_robot * last_from_robot;
        if odom_from_robot.is_within_bounds() {
            self.odom_from_robot = odom_from_robot;
        }
        before.between(self.local_from_robot)
    }

    /// Makes `anchor` the keyframe that covariances are relative to.
    fn anchor_at<M: Measurement<Pose = P>>(&mut self, past: Past<'_, M>, anchor: Option<NodeId>) {
        let Some(anchor) = anchor.filter(|_| anchor != self.anchor) else { return };
        let newest = past.local_from_keyframe.len().saturating_sub(1);
        self.anchor = Some(anchor);
        if newest - anchor.index().min(newest) <= CHAIN {
            self.keyframe_from_anchor = (anchor.index() + 1..=newest).fold(P::Matrix::zero(), |sum, k| {
                let step = past.local_from_keyframe[k - 1].between(past.local_from_keyframe[k]);
                compose_covariance(&sum, step, &self.links[k])
            });
        }
    }

    /// A keyframe was made here, this certain relative to the anchor.
    pub(crate) fn made_keyframe(&mut self, covariance: P::Matrix) {
        self.links.push(self.fused());
        self.keyframe_from_anchor = covariance;
        self.odometry_since_keyframe = P::Matrix::zero();
    }

    /// A robot is switched on; nobody knows where, so that it may as well be here. Its odometry begins anew.
    pub(crate) fn switch_on(&mut self) {
        let links = std::mem::take(&mut self.links);
        *self = Self { links, ..Self::new(self.local_from_robot) };
    }

    /// A keyframe of an earlier run lies here, as uncertain relative to the one before.
    pub(crate) fn take_in(&mut self, node: NodeId, local_from_keyframe: P, link: P::Matrix) {
        self.links.push(link);
        let links = std::mem::take(&mut self.links);
        *self = Self { links, anchor: Some(node), ..Self::new(local_from_keyframe) };
    }

    /// What comes is relative to this keyframe, which was just made here.
    pub(crate) fn begin_fragment(&mut self, node: NodeId) {
        self.anchor = Some(node);
        self.keyframe_from_anchor = P::Matrix::zero();
    }

    /// The wheels had slipped before keyframe `from`: the robot is elsewhere, and so much less certain.
    pub(crate) fn slip(&mut self, from: NodeId, local_from_robot: P, slip: &P::Matrix) {
        self.local_from_robot = local_from_robot;
        match self.links.get_mut(from.index()) {
            Some(link) => *link += *slip,
            None => self.odometry_since_keyframe += *slip,
        }
    }

    /// Covariance of the robot relative to the anchor.
    pub(crate) fn covariance<M: Measurement<Pose = P>>(&self, past: Past<'_, M>) -> P::Matrix {
        let predicted = match past.local_from_keyframe.last() {
            Some(newest) => {
                let step = newest.between(self.local_from_robot);
                compose_covariance(&self.keyframe_from_anchor, step, &self.odometry_since_keyframe)
            }
            None => self.odometry_since_keyframe,
        };
        let away_m = self.anchor.map_or(0.0, |anchor| past.pose(anchor).distance(self.local_from_robot));
        fuse(&predicted, &self.information) + map_floor::<P::Matrix>(away_m)
    }
}

/// As bytes, for a run that is continued.
impl<P: Pose> RobotPose<P> {
    pub(crate) fn put(&self, out: &mut Vec<u8>) {
        (self.local_from_robot, self.odom_from_robot).put(out);
        [self.information, self.odometry_since_keyframe, self.keyframe_from_anchor].put(out);
        self.anchor.put(out);
        // Of those before only their number will ever be asked for.
        self.links[self.links.len().saturating_sub(CHAIN)..].to_vec().put(out);
    }

    /// Goes on as it was.
    pub(crate) fn restore<M: Measurement<Pose = P>>(past: Past<'_, M>, from: &mut &[u8]) -> Option<Self> {
        let keyframes = past.local_from_keyframe.len();
        let (local_from_robot, odom_from_robot): (P, P) = Stored::take(from)?;
        let [information, odometry_since_keyframe, keyframe_from_anchor] = Stored::take(from)?;
        let anchor: Option<NodeId> = Stored::take(from)?;
        let newest: Vec<P::Matrix> = Stored::take(from)?;
        let mut links = vec![P::Matrix::zero(); keyframes.checked_sub(newest.len())?];
        links.extend(newest);
        let near = past.local_from_keyframe.last().map_or(local_from_robot, |newest| newest.between(local_from_robot));
        let is_sound = [local_from_robot, odom_from_robot, near].iter().all(|pose| is_in_place(*pose))
            && [odometry_since_keyframe, keyframe_from_anchor].iter().chain(&links).all(is_covariance::<P::Matrix>)
            && anchor.is_none_or(|anchor| anchor.index() < keyframes);
        is_sound.then_some(Self {
            local_from_robot,
            odom_from_robot,
            information,
            odometry_since_keyframe,
            links,
            anchor,
            keyframe_from_anchor,
        })
    }
}

/// Error of the map between two keyframes so far apart that no single match shows.
pub(crate) fn map_floor<C: TangentMatrix>(away_m: f64) -> C {
    let [floor_m, floor_rad] = MAP_FLOOR.map(|[at_anchor, per_metre]| at_anchor + per_metre * away_m);
    C::from_variances(floor_m * floor_m, floor_rad * floor_rad)
}

/// Posterior covariance of a prior covariance and a measurement's information.
fn fuse<C: TangentMatrix>(covariance: &C, information: &C) -> C {
    covariance.inverted().and_then(|prior| (prior + *information).inverted()).unwrap_or(*covariance)
}
