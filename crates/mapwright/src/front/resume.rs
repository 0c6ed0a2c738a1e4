//! A front end that goes on with an earlier run: the local map from its keyframes and edges, the prediction from its last scans.
//!
//! What no log keeps begins anew: how scans have fitted and how far odometry was wrong of late, and what moves. It is learnt within
//! seconds.

use super::PlaneFrontEnd;
use crate::front_end::FrontEnd;
use crate::local_map::{Earlier, Frames};
use crate::pose::{RobotPose, map_floor};
use crate::settings::Settings;
use crate::store::spacing;
use mapwright_geom::{Cov3, Pose, Pose2, TangentMatrix, compose_covariance};
use mapwright_record::{Edge, EdgeKind, Measurement, NodeId, Past, SessionEdge};
use nalgebra::{Matrix3, Vector3};

/// The last scans tell how the robot moves: so many.
const SCANS: usize = 256;
/// Of a covariance that nobody knows, m^2 and rad^2.
const UNKNOWN_VARIANCE: f64 = 100.0;

/// The edges that lead to one keyframe.
#[derive(Debug, Clone)]
pub(crate) struct Links<P: Pose = Pose2> {
    odometry: Option<Edge<P>>,
    matched: Option<(NodeId, Edge<P>)>,
    pub(crate) closures: Vec<(NodeId, P::Matrix)>,
}

impl<P: Pose> Default for Links<P> {
    fn default() -> Self {
        Self { odometry: None, matched: None, closures: Vec::new() }
    }
}

impl PlaneFrontEnd {
    /// Goes on where the session ends; `past` is all of it.
    pub(super) fn made_again(settings: Settings, past: Past<'_>) -> Self {
        let mut front = Self::new(settings, Pose2::IDENTITY);
        let links = links(past);
        front.take_in_keyframes(past, &links);
        let covariances = links.iter().map(Links::fused).collect();
        let (local_from_robot, since_keyframe) = front.go_through_scans(past);
        front.pose = RobotPose::resume(local_from_robot, covariances, since_keyframe);
        front
    }

    pub(super) fn take_in_keyframes(&mut self, past: Past<'_>, links: &[Links]) {
        let Self { settings, local_map, .. } = self;
        let breaks = past.session.fragments().iter().filter(|fragment| past.session.is_break(fragment));
        let breaks: Vec<usize> = breaks.filter_map(|fragment| past.session.place(fragment.first)).collect();
        for (node, links) in links.iter().enumerate() {
            if breaks.contains(&node) {
                local_map.leave_all();
            }
            let earlier = links.earlier(past, NodeId::at(node));
            local_map.take_in(settings, Frames::of(past.until(node + 1)), &earlier);
        }
        local_map.draw_wanted(settings, Frames::of(past));
    }

    /// Takes in the newest keyframe, which another session brings along, with the edges that lead to it, from a number on; `is_first` where
    /// a fragment begins.
    pub(super) fn take_in_newest(&mut self, past: Past<'_>, first_edge: usize, is_first: bool) {
        let Some(node) = past.newest() else { return };
        let mut links = Links::default();
        past.session.recorded_edges().iter().skip(first_edge).for_each(|known| links.add(known));
        if is_first {
            self.local_map.leave_all();
        }
        self.pose.take_in(node, past.pose(node), links.fused());
        self.local_map.take_in(&self.settings, Frames::of(past), &links.earlier(past, node));
    }

    /// Goes through the last scans again; where the robot is, and how uncertain since the newest keyframe by odometry alone.
    fn go_through_scans(&mut self, past: Past<'_>) -> (Pose2, Cov3) {
        let session = past.session;
        let has_odometry = !session.odometry_origins().is_empty();
        let newest = session.keyframes().last().map(|keyframe| keyframe.id);
        let first = session.scans().len().saturating_sub(SCANS);
        let (mut last, mut since_keyframe) = (None::<Pose2>, Cov3::zeros());
        for (pose, scan) in session.trajectory().zip(session.scans()).skip(first) {
            let last_from_robot = last.map_or(Pose2::IDENTITY, |last| last.between(pose.map_from_robot));
            let odom_from_robot = has_odometry.then_some(pose.odom_from_robot);
            let motion = &self.settings.motion;
            let variances = self.predictor.go_through(motion, pose.stamp, odom_from_robot, last_from_robot);
            let is_later = scan.keyframe == newest && scan.keyframe_from_robot != Pose2::IDENTITY;
            since_keyframe = match is_later {
                true => {
                    let noise = Matrix3::from_diagonal(&Vector3::from(variances));
                    compose_covariance(&since_keyframe, last_from_robot, &noise)
                }
                false => Cov3::zeros(),
            };
            last = Some(pose.map_from_robot);
        }
        (last.unwrap_or_default(), since_keyframe)
    }
}

/// The edges that stand, by the keyframe that they lead to.
pub(crate) fn links<M: Measurement>(past: Past<'_, M>) -> Vec<Links<M::Pose>> {
    let mut links = vec![Links::default(); past.way_m.len()];
    for known in past.session.recorded_edges() {
        let [from, to] = known.ends;
        links[from.max(to) as usize].add(known);
    }
    links
}

impl Links {
    /// The keyframe that they lead to, as a local map takes it in.
    fn earlier(&self, past: Past<'_>, node: NodeId) -> Earlier {
        let (keyframes, at) = (past.session.keyframes(), node.index());
        let before = past.before(node).map(NodeId::index);
        let step_m = before.map_or(0.0, |before| past.way_m[at] - past.way_m[before]);
        let before = before.map_or(0, |before| keyframes[before].scan);
        Earlier {
            node,
            links: self.all(past, node),
            spacing: spacing(keyframes, at, step_m),
            closures: self.closures.clone(),
            scans: keyframes[at].scan.saturating_sub(before),
        }
    }
}

impl<P: Pose> Links<P> {
    /// An edge that leads to the keyframe, if it stands.
    pub(crate) fn add(&mut self, known: &SessionEdge<P>) {
        let (edge, [from, to]) = (known.recorded.edge, known.ends.map(NodeId::new));
        match edge.kind {
            _ if known.withdrawn => {}
            EdgeKind::Odometry => self.odometry = Some(edge),
            EdgeKind::Match => self.matched = Some((from, edge)),
            EdgeKind::Closure => self.closures.push((from.min(to), covariance(&edge.information))),
        }
    }

    /// What a keyframe is linked with: the one before by wheels and scan together, and the one it was matched with.
    pub(crate) fn all<M: Measurement<Pose = P>>(&self, past: Past<'_, M>, node: NodeId) -> Vec<(NodeId, P::Matrix)> {
        let mut all = Vec::new();
        let before = past.before(node);
        if let Some(before) = before.filter(|_| self.odometry.is_some()) {
            all.push((before, self.fused()));
        }
        if let Some((anchor, edge)) = self.matched.filter(|(anchor, _)| Some(*anchor) != before) {
            let away_m = past.pose(anchor).distance(past.pose(node));
            all.push((anchor, covariance(&edge.information) + map_floor::<P::Matrix>(away_m)));
        }
        all
    }

    /// Covariance relative to the keyframe before, by wheels and scan together.
    pub(crate) fn fused(&self) -> P::Matrix {
        let matched = self.matched.map_or_else(P::Matrix::zero, |(_, edge)| edge.information);
        self.odometry.map_or_else(P::Matrix::zero, |edge| covariance(&(edge.information + matched)))
    }
}

fn covariance<C: TangentMatrix>(information: &C) -> C {
    information.inverted().unwrap_or_else(|| C::from_variances(UNKNOWN_VARIANCE, UNKNOWN_VARIANCE))
}
