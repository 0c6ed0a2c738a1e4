//! Which keyframes the live map is made of.

use crate::settings::{LivePolicy, Settings};
use mapwright_geom::Pose2;
use mapwright_graph::CertaintyGraph;
use mapwright_grid::{Change, LiveMap, LiveMapSettings};
use mapwright_sensor::{BeamTable, Sweep, SweepPoints};
use rustc_hash::FxHashMap;

/// Side of the areas over which views are bounded, metres.
const AREA_M: f64 = 1.0;
/// Side of the buckets in which keyframes near the robot are found, metres.
const BUCKET_M: f64 = 4.0;
/// A live keyframe stays live up to this multiple of the gate.
const HYSTERESIS: f64 = 2.5;
/// Keyframes a search of the graph may enter.
const SEARCH_AT_MOST: usize = 4096;

/// What the live map consists of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LiveReport {
    /// Keyframes in it.
    pub keyframes: usize,
    /// Keyframes that were taken out because they were no longer certain relative to the robot.
    pub gated_out: u64,
    /// Keyframes that came back in.
    pub let_in: u64,
    /// Keyframes that gave way to newer views of the same area.
    pub superseded: u64,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum State {
    Live,
    GatedOut,
    Superseded,
}

/// The live map and the rule that keeps it.
#[derive(Debug, Clone)]
pub(crate) struct Live {
    pub(crate) map: LiveMap,
    states: Vec<State>,
    /// Live keyframes by area and heading, oldest first.
    areas: FxHashMap<(i32, i32, i32), Vec<u32>>,
    /// All keyframes by place.
    buckets: FxHashMap<(i32, i32), Vec<u32>>,
    report: LiveReport,
    points: SweepPoints,
    table: BeamTable,
}

/// The keyframes as the live map needs them.
#[derive(Clone, Copy)]
pub(crate) struct Frames<'a> {
    pub(crate) sweeps: &'a dyn Fn(u32) -> &'a Sweep,
    pub(crate) world_from_robot: &'a [Pose2],
}

impl Live {
    pub(crate) fn new(settings: &Settings) -> Self {
        let map = LiveMapSettings {
            resolution_m: settings.map.resolution_m,
            passes_per_hit: settings.map.passes_per_hit,
            ..LiveMapSettings::default()
        };
        Self {
            map: LiveMap::new(map),
            states: Vec::new(),
            areas: FxHashMap::default(),
            buckets: FxHashMap::default(),
            report: LiveReport::default(),
            points: SweepPoints::default(),
            table: BeamTable::default(),
        }
    }

    pub(crate) fn report(&self) -> LiveReport {
        self.report
    }

    /// Draws a keyframe's beams into the map or takes them out again.
    fn draw(&mut self, settings: &Settings, frames: Frames<'_>, node: u32, change: Change) {
        self.points.fill((frames.sweeps)(node), &mut self.table, settings.scan.free_range_m);
        self.points.fill_normals();
        self.map.change(&self.points, frames.world_from_robot[node as usize], change, node);
    }

    /// A new keyframe joins; older views of its area give way.
    pub(crate) fn insert(&mut self, settings: &Settings, frames: Frames<'_>, node: u32) {
        self.draw(settings, frames, node, Change::Add);
        self.states.resize(node as usize + 1, State::GatedOut);
        self.states[node as usize] = State::Live;
        self.report.keyframes += 1;
        if settings.live.policy == LivePolicy::Everything {
            return;
        }
        let pose = frames.world_from_robot[node as usize];
        self.buckets.entry(bucket(pose)).or_default().push(node);
        self.enter_area(settings, frames, node);
    }

    fn enter_area(&mut self, settings: &Settings, frames: Frames<'_>, node: u32) {
        let views = self.areas.entry(area(frames.world_from_robot[node as usize])).or_default();
        views.push(node);
        if views.len() > settings.live.views_per_area as usize {
            let oldest = views.remove(0);
            self.states[oldest as usize] = State::Superseded;
            if let Some(nodes) = self.buckets.get_mut(&bucket(frames.world_from_robot[oldest as usize])) {
                nodes.retain(|&node| node != oldest);
            }
            self.report.superseded += 1;
            self.report.keyframes -= 1;
            self.draw(settings, frames, oldest, Change::Remove);
        }
    }

    /// Brings the live keyframes around the newest one in line with the gate.
    pub(crate) fn gate(
        &mut self,
        settings: &Settings,
        frames: Frames<'_>,
        graph: &mut CertaintyGraph,
        newest: u32,
        lever_m: f64,
        reach_m: f64,
    ) {
        if settings.live.policy == LivePolicy::Everything {
            return;
        }
        let centre = frames.world_from_robot[newest as usize];
        let poses = frames.world_from_robot;
        let gate_out_m = settings.live.gate_m * HYSTERESIS;
        let states = &self.states;
        let near = |node: u32| poses[node as usize].distance(centre) <= reach_m;
        // Superseded views are never let in again; going around them keeps the search as small as the area.
        let within = |node: u32| states[node as usize] != State::Superseded && near(node);
        let reached = graph.reach(newest, poses, gate_out_m, lever_m, SEARCH_AT_MOST, within);
        let sigmas: FxHashMap<u32, f64> = reached.iter().map(|r| (r.node, r.sigma_m)).collect();
        let rings = (reach_m / BUCKET_M).ceil() as i32;
        let middle = bucket(centre);
        for by in middle.1 - rings..=middle.1 + rings {
            for bx in middle.0 - rings..=middle.0 + rings {
                let Some(nodes) = self.buckets.get(&(bx, by)) else { continue };
                for node in nodes.clone() {
                    if near(node) {
                        self.judge(settings, frames, node, sigmas.get(&node).copied());
                    }
                }
            }
        }
    }

    fn judge(&mut self, settings: &Settings, frames: Frames<'_>, node: u32, sigma_m: Option<f64>) {
        match (self.states[node as usize], sigma_m) {
            (State::Live, None) => {
                self.states[node as usize] = State::GatedOut;
                self.report.gated_out += 1;
                self.report.keyframes -= 1;
                if let Some(views) = self.areas.get_mut(&area(frames.world_from_robot[node as usize])) {
                    views.retain(|&view| view != node);
                }
                self.draw(settings, frames, node, Change::Remove);
            }
            (State::GatedOut, Some(sigma_m)) if sigma_m <= settings.live.gate_m => {
                self.states[node as usize] = State::Live;
                self.report.let_in += 1;
                self.report.keyframes += 1;
                self.draw(settings, frames, node, Change::Add);
                self.enter_area(settings, frames, node);
            }
            _ => {}
        }
    }

    /// Takes a keyframe out for good.
    pub(crate) fn drop(&mut self, settings: &Settings, frames: Frames<'_>, node: u32) {
        let Some(state) = self.states.get_mut(node as usize) else { return };
        let was = std::mem::replace(state, State::Superseded);
        if was == State::Live {
            self.report.keyframes -= 1;
            if let Some(views) = self.areas.get_mut(&area(frames.world_from_robot[node as usize])) {
                views.retain(|&view| view != node);
            }
            self.draw(settings, frames, node, Change::Remove);
        }
    }
}

fn bucket(pose: Pose2) -> (i32, i32) {
    ((pose.x / BUCKET_M).floor() as i32, (pose.y / BUCKET_M).floor() as i32)
}

fn area(pose: Pose2) -> (i32, i32, i32) {
    let quarter = (pose.theta / std::f64::consts::FRAC_PI_2).floor() as i32;
    ((pose.x / AREA_M).floor() as i32, (pose.y / AREA_M).floor() as i32, quarter)
}
