//! Which keyframes the local map in space is made of: those that are certain relative to the robot.

use super::scale::Scale;
use crate::settings::{LivePolicy, Settings};
use mapwright_geom::{Cov6, Pose, Pose3, TangentMatrix};
use mapwright_graph::{CovarianceGraph, Gate, Projected};
use mapwright_loops::{KnownPlace, is_old};
use mapwright_record::{LocalMapReport, NodeId, Past};
use mapwright_sensor::SpaceSweep;
use mapwright_voxel::{Change, SurfelMap};
use std::collections::VecDeque;

mod resume;

/// Those that the robot stays near are matched against until they are so many times as uncertain as others may be.
const HYSTERESIS: f64 = 2.5;
/// Of a link's variances such a share adds up along the way; the rest is shared by keyframes that are matched with the same older ones.
/// Calibrated on simulated buildings of several storeys (docs/decisions/0023-space.md).
const ACCUMULATING_SHARE: f64 = 0.25;
/// Keyframes are in the local map up to this far from the robot, of the rms range.
const REACH_RANGES: f64 = 8.0;
/// An old place so near, of the rms range, is looked at.
const NEARBY_SHARE: f64 = 0.5;
/// So many keyframes see the same, within such a share of the rms range, and radians; older ones give way.
const VIEWS_ALIKE: usize = 4;
const ALIKE_SHARE: f64 = 0.12;
const ALIKE_RAD: f64 = 0.8;
/// So many keyframes that are due are drawn or taken out after a cloud.
const DRAWN_AT_ONCE: usize = 2;
/// A keyframe is drawn anew when what it shows has moved by more than this share of a voxel.
const DISPLACED_SHARE: f64 = 0.1;

/// The local map and the rule that keeps it.
#[derive(Debug, Clone)]
pub(crate) struct LocalMapping {
    map: SurfelMap,
    gated: bool,
    scale: Scale,
    views: Vec<View>,
    graph: CovarianceGraph,
    due: VecDeque<NodeId>,
    report: LocalMapReport,
    points: Vec<[f32; 3]>,
}

#[derive(Debug, Clone, Copy, Default)]
struct View {
    /// Where it is drawn, if it is.
    drawn_at: Option<Pose3>,
    /// Certain relative to the robot.
    live: bool,
    /// Gave way to newer views; never comes back.
    gone: bool,
}

impl LocalMapping {
    pub(crate) fn new(settings: &Settings, scale: Scale) -> Self {
        Self {
            map: SurfelMap::new(scale.maps()),
            gated: settings.live.policy == LivePolicy::Gated,
            scale,
            views: Vec::new(),
            graph: CovarianceGraph::default(),
            due: VecDeque::new(),
            report: LocalMapReport::default(),
            points: Vec::new(),
        }
    }

    pub(crate) fn map(&self) -> &SurfelMap {
        &self.map
    }

    pub(crate) fn report(&self) -> LocalMapReport {
        self.report
    }

    pub(crate) fn is_drawn(&self, node: NodeId) -> bool {
        self.views.get(node.index()).is_some_and(|view| view.drawn_at.is_some())
    }

    /// A new keyframe joins, this certain relative to others; what it makes uncertain is due to leave.
    pub(crate) fn insert(&mut self, past: Past<'_, SpaceSweep>, node: NodeId, links: &[(NodeId, Cov6)]) {
        self.take_note(past, node, links);
        self.views[node.index()].live = true;
        self.draw(past, node, Change::Add);
        if self.gated {
            self.give_way(past, node);
            self.judge(node);
        }
    }

    /// A keyframe is known of, this certain relative to others.
    fn take_note(&mut self, past: Past<'_, SpaceSweep>, node: NodeId, links: &[(NodeId, Cov6)]) {
        while self.views.len() <= node.index() {
            self.graph.add_node(past.local_from_keyframe[self.views.len()].translation);
            self.views.push(View::default());
        }
        for (from, covariance) in links {
            let ends = [from.number(), node.number()];
            self.graph.add_link(ends, &(covariance * ACCUMULATING_SHARE), past.pose(node), self.scale.range_m);
        }
    }

    /// Of the views alike, which one sensor has taken, the newest stay.
    fn give_way(&mut self, past: Past<'_, SpaceSweep>, node: NodeId) {
        let here = past.pose(node);
        let sensor = |node: NodeId| past.session.keyframes()[node.index()].sweep.sensor.as_ref();
        let of = sensor(node);
        let alike = |&other: &NodeId| {
            let (view, there) = (self.views[other.index()], past.pose(other));
            view.live
                && !view.gone
                && here.distance(there) <= ALIKE_SHARE * self.scale.range_m
                && here.between(there).angle() <= ALIKE_RAD
                && sensor(other).is_one_with(of)
        };
        let alike: Vec<NodeId> = NodeId::first(node.index() + 1).filter(alike).collect();
        if alike.len() > VIEWS_ALIKE {
            self.views[alike[0].index()].gone = true;
            self.report.superseded += 1;
            self.due.push_back(alike[0]);
        }
    }

    /// Who is certain enough relative to the newest keyframe.
    fn judge(&mut self, node: NodeId) {
        let gate_m = self.scale.gate_m();
        let reach_m = REACH_RANGES * self.scale.range_m;
        let gate = Gate { sigma_m: HYSTERESIS * gate_m, lever_m: self.scale.range_m, reach_m };
        let mut certain = vec![false; self.views.len()];
        for projected in self.graph.project(node.number(), gate) {
            let node = projected.node as usize;
            let most_m = if self.views[node].live { gate.sigma_m } else { gate_m };
            certain[node] = projected.uncertainty().sigma_m(self.scale.range_m) <= most_m;
        }
        for ((node, view), is_live) in NodeId::first(certain.len()).zip(&mut self.views).zip(certain) {
            if view.live != is_live {
                view.live = is_live;
                self.due.push_back(node);
            }
        }
    }

    /// Once a cloud: draws or takes out a few of those that are due.
    pub(crate) fn follow(&mut self, past: Past<'_, SpaceSweep>) {
        let mut left = DRAWN_AT_ONCE;
        while left > 0
            && let Some(node) = self.due.pop_front()
        {
            left -= usize::from(self.settle(past, node));
        }
        self.map.refresh();
    }

    /// Brings a keyframe in line with what it should be; whether there was anything to do.
    fn settle(&mut self, past: Past<'_, SpaceSweep>, node: NodeId) -> bool {
        let view = self.views[node.index()];
        let wanted = view.live && !view.gone;
        let moved = view.drawn_at.is_some_and(|at| self.is_displaced(at, past.pose(node)));
        if view.drawn_at.is_some() == wanted && !moved {
            return false;
        }
        if view.drawn_at.is_some() {
            self.draw(past, node, Change::Remove);
            self.report.gated_out += u64::from(!wanted && !view.gone);
        }
        if wanted {
            self.draw(past, node, Change::Add);
            self.report.let_in += 1;
        }
        true
    }

    fn is_displaced(&self, drawn_at: Pose3, at: Pose3) -> bool {
        let moved_m = drawn_at.distance(at) + self.scale.range_m * drawn_at.between(at).angle();
        moved_m > DISPLACED_SHARE * self.scale.resolution_m
    }

    fn draw(&mut self, past: Past<'_, SpaceSweep>, node: NodeId, change: Change) {
        let Some(sweep) = &past.drawn[node.index()] else { return };
        let view = &mut self.views[node.index()];
        let drawn_at = view.drawn_at.filter(|_| change == Change::Remove);
        let at = drawn_at.unwrap_or(past.pose(node));
        self.points.clear();
        self.points.extend(sweep.points_m());
        self.map.draw(&self.points, sweep.origin_m(), at, change, node.number());
        let is_drawn = change == Change::Add;
        view.drawn_at = is_drawn.then_some(at);
        self.report.keyframes =
            if is_drawn { self.report.keyframes + 1 } else { self.report.keyframes.saturating_sub(1) };
    }

    /// Nothing that is known is matched against any more.
    pub(crate) fn leave_all(&mut self) {
        self.map = SurfelMap::new(self.scale.maps());
        self.views.iter_mut().for_each(|view| (view.drawn_at, view.live) = (None, false));
        self.report.keyframes = 0;
        self.due.clear();
    }

    /// Takes a keyframe out for good.
    pub(crate) fn drop(&mut self, past: Past<'_, SpaceSweep>, node: NodeId) {
        let Some(view) = self.views.get_mut(node.index()) else { return };
        view.gone = true;
        if view.drawn_at.is_some() {
            self.draw(past, node, Change::Remove);
        }
        self.map.refresh();
    }

    /// The keyframes were moved by a correction; what is drawn elsewhere is due.
    pub(crate) fn carry(&mut self, past: Past<'_, SpaceSweep>, before: &[Pose3]) {
        self.graph.carry(|node| past.local_from_keyframe[node as usize] * before[node as usize].inverse());
        for (node, &View { drawn_at, live, gone }) in NodeId::first(self.views.len()).zip(&self.views) {
            if live && !gone && drawn_at.is_some_and(|at| self.is_displaced(at, past.pose(node))) {
                self.due.push_back(node);
            }
        }
    }

    /// A closure links two keyframes.
    pub(crate) fn close(&mut self, past: Past<'_, SpaceSweep>, from: NodeId, to: NodeId, covariance: &Cov6) {
        self.graph.add_link([from.number(), to.number()], covariance, past.pose(to), self.scale.range_m);
    }

    /// A closure was none.
    pub(crate) fn open(&mut self, from: NodeId, to: NodeId) {
        self.graph.remove_link(from.number(), to.number());
    }

    /// The keyframe nearest to the newest one of those that are certain relative to it and from where the robot was long ago, within
    /// half of what the sensor sees: what matches are supported by there is a closure, once it is looked at.
    pub(crate) fn old_place_nearby(&self, past: Past<'_, SpaceSweep>) -> Option<NodeId> {
        let newest = past.newest()?;
        let here = past.pose(newest);
        let old = NodeId::first(self.views.len())
            .filter(|&node| self.views[node.index()].live && is_old(past, node, newest))
            .map(|node| (past.pose(node).distance(here), node));
        let nearest = old.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)))?;
        (nearest.0 <= NEARBY_SHARE * self.scale.range_m).then_some(nearest.1)
    }

    /// Every keyframe, and how certain it is relative to the newest.
    pub(crate) fn survey(&mut self, past: Past<'_, SpaceSweep>) -> Vec<KnownPlace<Pose3>> {
        let Some(newest) = past.newest().filter(|newest| newest.index() < self.views.len()) else { return Vec::new() };
        let gate = Gate { sigma_m: f64::INFINITY, lever_m: self.scale.range_m, reach_m: f64::INFINITY };
        let newest_from_map = Pose3 { translation: nalgebra::Vector3::zeros(), ..past.pose(newest).inverse() };
        let axes = newest_from_map.adjoint();
        let known = |projected: Projected| {
            let Projected { node, at_start, .. } = projected;
            let first = NodeId::new(node);
            let live = self.views[first.index()].live;
            KnownPlace { first, live, covariance: at_start.carried_by(&axes) }
        };
        self.graph.project(newest.number(), gate).into_iter().map(known).collect()
    }
}
