//! Which keyframes the local map is made of.

use crate::patches::{Flip, Patches, Spacing};
use crate::settings::{LivePolicy, Settings};
use mapwright_geom::{Cov3, Pose2};
use mapwright_grid::{Change, LocalMap, LocalMapSettings};
use mapwright_loops::KnownPlace;
use mapwright_record::{LocalMapReport, Measurement, NodeId, Past};
use mapwright_sensor::{BeamTable, Sweep, SweepPoints};
use rustc_hash::FxHashMap;
use std::collections::VecDeque;
use std::sync::Arc;

mod checkpoint;
mod resume;
mod waiting;

pub(crate) use resume::Earlier;

/// Side of the areas in which views are found, metres.
const AREA_M: f64 = 1.0;
/// A square metre around a view and a quarter turn, over which views are bounded, metres and radians.
const SAME_VIEW_M: f64 = 0.564;
const SAME_VIEW_RAD: f64 = std::f64::consts::FRAC_PI_4;
/// A live keyframe stays live up to this multiple of the gate.
const HYSTERESIS: f64 = 2.5;

/// A keyframe is drawn anew when what it shows has moved by more than this, cells.
const DISPLACED_CELLS: f64 = 0.25;
/// So many keyframes that are due are drawn at a time, for what they have in common is settled once,
const DRAWN_AT_ONCE: u32 = 8;
/// one every two scans; one more every two scans for so many that are due,
const BACKLOG: usize = 64;
/// and so many more at most.
const BACKLOG_AT_MOST: usize = 8;

/// A scan meets a patch that supplies what more than such a share of its end points would be matched against.
const MET_SHARE: f64 = 0.02;
/// So many keyframes leave before the scan is matched, the others in the next scans.
const MET_AT_ONCE: usize = 32;

/// The local map and the rule that keeps it.
#[derive(Debug, Clone)]
pub(crate) struct LocalMapping {
    pub(crate) map: LocalMap,
    gated: bool,
    views: Vec<View>,
    patches: Patches,
    /// Keyframes of live patches by area.
    areas: FxHashMap<(i32, i32), Vec<NodeId>>,
    /// Keyframes to be drawn or taken out.
    due: VecDeque<NodeId>,
    /// How many halves of them may be drawn by now.
    halves: u32,
    lever_m: f64,
    /// Patches that the present scan meets and for how many of its end points.
    met: Vec<(u32, u32)>,
    /// Patches that wait until a scan meets them to be drawn where they belong, by the squares in which they have obstacles.
    waiting: Vec<((i32, i32), u32)>,
    inserted_last: bool,
    report: LocalMapReport,
    points: SweepPoints,
    table: BeamTable,
}

#[derive(Debug, Clone, Copy, Default)]
struct View {
    /// Where it is drawn, if it is.
    drawn_at: Option<Pose2>,
    /// Where its area's list has it.
    area: (i32, i32),
    /// Gave way to newer views or was dropped; never comes back.
    gone: bool,
}

/// The keyframes as the local map needs them.
#[derive(Clone, Copy)]
pub(crate) struct Frames<'a> {
    /// What is drawn of each, if anything is.
    pub(crate) drawn: &'a [Option<Arc<Sweep>>],
    pub(crate) world_from_robot: &'a [Pose2],
}

impl<'a> Frames<'a> {
    pub(crate) fn of(past: Past<'a>) -> Self {
        Self { drawn: past.drawn, world_from_robot: past.local_from_keyframe }
    }
}

impl LocalMapping {
    pub(crate) fn new(settings: &Settings) -> Self {
        let map = LocalMapSettings {
            resolution_m: settings.map.resolution_m,
            passes_per_hit: settings.map.passes_per_hit,
            ..LocalMapSettings::default()
        };
        Self {
            map: LocalMap::new(map),
            gated: settings.live.policy == LivePolicy::Gated,
            views: Vec::new(),
            patches: Patches::default(),
            areas: FxHashMap::default(),
            due: VecDeque::new(),
            halves: 0,
            lever_m: 0.0,
            met: Vec::new(),
            waiting: Vec::new(),
            inserted_last: false,
            report: LocalMapReport::default(),
            points: SweepPoints::default(),
            table: BeamTable::default(),
        }
    }

    pub(crate) fn report(&self) -> LocalMapReport {
        self.report
    }

    /// Draws a keyframe's beams into the map or takes them out again.
    fn draw(&mut self, settings: &Settings, frames: Frames<'_>, node: NodeId, change: Change) {
        let Some(()) = self.fill_points(settings, frames, node) else { return };
        let view = &mut self.views[node.index()];
        let drawn_at = view.drawn_at.filter(|_| change == Change::Remove);
        let at = drawn_at.unwrap_or(frames.world_from_robot[node.index()]);
        self.map.draw(&self.points, at, change, node.number());
        let (drawn, was) = (change == Change::Add, view.drawn_at.is_some());
        view.drawn_at = drawn.then_some(at);
        self.report.keyframes = self.report.keyframes + usize::from(drawn && !was) - usize::from(was && !drawn);
    }

    /// What a keyframe shows, if it does.
    fn fill_points(&mut self, settings: &Settings, frames: Frames<'_>, node: NodeId) -> Option<()> {
        let sweep = frames.drawn[node.index()].as_ref()?;
        self.points.fill(sweep, &mut self.table, settings.scan.free_range_m);
        self.points.fill_normals();
        Some(())
    }

    /// The next keyframe, so far from the last one, is as uncertain relative to `from`.
    pub(crate) fn connect(&mut self, from: NodeId, covariance: &Cov3, spacing: Spacing) {
        if self.gated {
            self.patches.connect(from, covariance, spacing);
        }
    }

    /// A new keyframe joins; older views of its area give way.
    pub(crate) fn insert(&mut self, settings: &Settings, frames: Frames<'_>, node: NodeId, lever_m: f64) {
        self.views.push(View::default());
        self.lever_m = lever_m;
        let blank = frames.drawn[node.index()].is_none();
        if blank {
            // It is where the robot is, and there is nothing to draw.
            self.points.clear();
            self.views[node.index()].gone = true;
        } else {
            self.draw(settings, frames, node, Change::Add);
        }
        if self.gated {
            self.patches.add(frames.world_from_robot, lever_m, &self.points.hits);
        }
        if self.gated && !blank {
            self.enter_area(settings, frames, node);
        }
    }

    /// Of the views around one the newest stay.
    fn enter_area(&mut self, settings: &Settings, frames: Frames<'_>, node: NodeId) {
        let at = frames.world_from_robot[node.index()];
        let (x, y) = area(at);
        self.views[node.index()].area = (x, y);
        self.areas.entry((x, y)).or_default().push(node);
        let (mut alike, mut oldest) = (0, node);
        let seen = |node: NodeId| frames.drawn[node.index()].as_ref();
        let is_of_one_laser = |other| seen(node).zip(seen(other)).is_none_or(|(a, b)| a.is_of_one_sensor_with(b));
        for key in (y - 1..=y + 1).flat_map(|y| (x - 1..=x + 1).map(move |x| (x, y))) {
            for &other in self.areas.get(&key).into_iter().flatten() {
                let pose = frames.world_from_robot[other.index()];
                if at.distance(pose) <= SAME_VIEW_M
                    && at.between(pose).theta.abs() <= SAME_VIEW_RAD
                    && is_of_one_laser(other)
                {
                    (alike, oldest) = (alike + 1, oldest.min(other));
                }
            }
        }
        if alike > settings.live.views_per_area {
            self.leave_area(oldest);
            self.supersede(oldest);
        }
    }

    /// A view gives way to others for good.
    fn supersede(&mut self, node: NodeId) {
        self.views[node.index()].gone = true;
        self.patches.forget(node);
        self.due.push_back(node);
        self.report.superseded += 1;
    }

    fn leave_area(&mut self, node: NodeId) {
        if let Some(views) = self.areas.get_mut(&self.views[node.index()].area) {
            views.retain(|&view| view != node);
        }
    }

    /// A patch's keyframes join or leave: they are due to be taken out, or wait until a scan meets them to be drawn.
    fn flip(&mut self, settings: &Settings, frames: Frames<'_>, flip: Flip) {
        for node in self.patches.flip(flip) {
            if self.views[node.index()].gone {
                continue;
            }
            if flip.live {
                self.enter_area(settings, frames, node);
            } else {
                self.due.push_back(node);
                self.leave_area(node);
            }
        }
    }

    /// Before a scan is matched: if it would be matched against what is too uncertain for that, all that is so uncertain around
    /// the robot leaves the local map, the nearest at once.
    pub(crate) fn meet(&mut self, settings: &Settings, frames: Frames<'_>, hits: &[[f64; 2]], predicted: Pose2) {
        self.meet_waiting(hits, predicted);
        if !self.patches.any_stale() || !self.meets_stale(hits, predicted) {
            return;
        }
        let waiting = self.due.len();
        for flip in self.patches.stale_around(predicted) {
            self.flip(settings, frames, flip);
        }
        let leaving = self.due.len() - waiting;
        self.due.rotate_right(leaving);
        self.settle_due(settings, frames, leaving.min(MET_AT_ONCE));
        self.map.refresh();
    }

    /// Whether one of the patches that are too uncertain supplies what more than a few of a scan's end points would be matched
    /// against.
    fn meets_stale(&mut self, hits: &[[f64; 2]], predicted: Pose2) -> bool {
        let mut met = std::mem::take(&mut self.met);
        self.map.each_supplier(hits, predicted, |supplier| {
            if let Some(patch) = self.patches.stale(NodeId::new(supplier)) {
                count(&mut met, patch, 1);
            }
        });
        let least = MET_SHARE * hits.len() as f64;
        let is_met = met.drain(..).any(|(_, points)| f64::from(points) > least);
        self.met = met;
        is_met
    }

    /// Once a scan: brings the live keyframes around the robot in line with the gate, a little at a time.
    pub(crate) fn follow(&mut self, settings: &Settings, frames: Frames<'_>, inserted: bool) {
        if self.gated {
            self.follow_gate(settings, frames);
        }
        // A scan that has inserted is the dearest already; where every scan inserts it cannot be helped.
        if !inserted || self.inserted_last {
            self.halves += 1 + (self.due.len() / BACKLOG).min(BACKLOG_AT_MOST) as u32;
            if self.halves >= 2 * DRAWN_AT_ONCE {
                self.settle_due(settings, frames, self.halves as usize / 2);
                self.halves %= 2;
            }
        }
        self.inserted_last = inserted;
        self.map.refresh();
    }

    fn follow_gate(&mut self, settings: &Settings, frames: Frames<'_>) {
        let gate_m = settings.live.gate_m;
        let Some(flips) = self.patches.search(frames.world_from_robot, gate_m, gate_m * HYSTERESIS) else { return };
        for flip in flips {
            self.flip(settings, frames, flip);
        }
        self.note_waiting(frames);
    }

    /// The keyframes were moved by a correction; what is drawn follows where scans meet it.
    pub(crate) fn carry(&mut self, settings: &Settings, before: &[Pose2], frames: Frames<'_>) {
        if self.gated {
            self.waiting.clear();
            self.patches.carry(before, frames.world_from_robot);
            self.enter_areas(frames);
        }
        let nodes = || NodeId::first(frames.world_from_robot.len());
        let displaced = nodes().filter(|&node| self.is_displaced(frames, node) && self.is_wanted(node));
        let displaced: Vec<NodeId> = displaced.collect();
        if !self.gated {
            self.due = displaced.into();
            return;
        }
        let wanted =
            nodes().filter(|&node| self.views[node.index()].drawn_at.is_some() && self.is_wanted(node)).count();
        let stay = wanted - displaced.len();
        for node in displaced {
            self.patches.unsettle(node);
        }
        if self.report.keyframes > 2 * stay {
            self.begin_anew(settings, frames);
        }
        self.note_waiting(frames);
    }

    /// Whether a keyframe is to be in the local map.
    fn is_wanted(&self, node: NodeId) -> bool {
        !self.views[node.index()].gone && self.is_live(node)
    }

    /// Whether a keyframe is drawn elsewhere than where it belongs.
    fn is_displaced(&self, frames: Frames<'_>, node: NodeId) -> bool {
        let at = frames.world_from_robot[node.index()];
        self.views[node.index()].drawn_at.is_some_and(|drawn_at| {
            let moved_m = drawn_at.distance(at) + self.lever_m * drawn_at.between(at).theta.abs();
            moved_m > DISPLACED_CELLS * self.map.settings.resolution_m
        })
    }

    /// Where more would have to be taken out of the local map than stays, it begins anew, with the newest views. The others wait.
    fn begin_anew(&mut self, settings: &Settings, frames: Frames<'_>) {
        self.map = LocalMap::new(self.map.settings);
        self.views.iter_mut().for_each(|view| view.drawn_at = None);
        self.report.keyframes = 0;
        self.due.clear();
        self.patches.unsettle_all();
        let mut left = MET_AT_ONCE;
        for node in NodeId::first(self.views.len()).rev() {
            if left > 0 && self.is_wanted(node) {
                self.draw(settings, frames, node, Change::Add);
                left -= 1;
            }
        }
        self.map.refresh();
    }

    /// Nothing that is known is matched against any more.
    pub(crate) fn leave_all(&mut self) {
        self.patches.leave_all();
        self.map = LocalMap::new(self.map.settings);
        self.views.iter_mut().for_each(|view| view.drawn_at = None);
        self.report.keyframes = 0;
        self.due.clear();
        self.areas.clear();
        self.waiting.clear();
    }

    /// A closure links two keyframes.
    pub(crate) fn close(&mut self, frames: Frames<'_>, from: NodeId, to: NodeId, covariance: &Cov3) {
        if self.gated {
            self.patches.close(frames.world_from_robot, from, to, covariance);
        }
    }

    /// A closure was none.
    pub(crate) fn open(&mut self, from: NodeId, to: NodeId) {
        if self.gated {
            self.patches.open(from, to);
        }
    }

    /// Old places that are not in the local map.
    pub(crate) fn survey(&mut self) -> Vec<KnownPlace> {
        if self.gated { self.patches.survey() } else { Vec::new() }
    }

    /// Whether a keyframe is in the local map or is to be.
    pub(crate) fn is_live(&self, node: NodeId) -> bool {
        !self.gated || self.patches.is_live(node)
    }

    /// Draws, takes out or moves up to so many of the keyframes that are due.
    fn settle_due(&mut self, settings: &Settings, frames: Frames<'_>, most: usize) {
        let mut left = most;
        while left > 0 {
            let Some(node) = self.due.pop_front() else { return };
            let drawn = self.views[node.index()].drawn_at.is_some();
            let wanted = self.is_wanted(node);
            if wanted == drawn && !(wanted && self.is_displaced(frames, node)) {
                continue;
            }
            if drawn {
                self.draw(settings, frames, node, Change::Remove);
            }
            if wanted {
                self.draw(settings, frames, node, Change::Add);
            }
            self.report.let_in += u64::from(wanted && !drawn);
            self.report.gated_out += u64::from(!wanted && !self.views[node.index()].gone);
            left -= 1;
        }
    }

    /// Takes a keyframe out for good.
    pub(crate) fn drop(&mut self, settings: &Settings, frames: Frames<'_>, node: NodeId) {
        let Some(view) = self.views.get_mut(node.index()) else { return };
        view.gone = true;
        if view.drawn_at.is_some() {
            self.draw(settings, frames, node, Change::Remove);
        }
        self.map.refresh();
        if self.gated {
            self.leave_area(node);
            self.patches.forget(node);
        }
    }
}

fn count(met: &mut Vec<(u32, u32)>, patch: u32, points: u32) {
    match met.iter_mut().find(|(known, _)| *known == patch) {
        Some((_, sum)) => *sum += points,
        None => met.push((patch, points)),
    }
}

fn area(pose: Pose2) -> (i32, i32) {
    ((pose.x / AREA_M).floor() as i32, (pose.y / AREA_M).floor() as i32)
}

#[cfg(test)]
mod tests;
