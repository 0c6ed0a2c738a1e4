//! Which keyframes the live map is made of.

use crate::patches::{Flip, Known, Patches, Spacing};
use crate::settings::{LivePolicy, Settings};
use mapwright_geom::{Cov3, Pose2};
use mapwright_grid::{Change, LiveMap, LiveMapSettings};
use mapwright_record::Keyframe;
use mapwright_sensor::{BeamTable, SweepPoints};
use rustc_hash::FxHashMap;
use std::collections::VecDeque;

/// Side of the areas in which views are found, metres.
const AREA_M: f64 = 1.0;
/// A square metre around a view and a quarter turn, over which views are bounded, metres and radians.
const ALIKE_M: f64 = 0.564;
const ALIKE_RAD: f64 = std::f64::consts::FRAC_PI_4;
/// A live keyframe stays live up to this multiple of the gate.
const HYSTERESIS: f64 = 2.5;

/// Keyframes drawn anew a scan after a correction.
const MOVES_A_SCAN: usize = 16;
/// Rounds of following that bring the surroundings of a robot into the live map that was found elsewhere.
const ARRIVAL_STEPS: usize = 400;
/// Half a keyframe more is drawn a scan for so many that are due,
const BACKLOG: usize = 64;
/// and so many halves at most.
const HALVES_AT_MOST: usize = 8;

/// A scan meets a patch that supplies what more than such a share of its end points would be matched against.
const MET_SHARE: f64 = 0.02;
/// So many halves of keyframes leave before the scan is matched, the others in the next scans.
const MET_HALVES: usize = 64;

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

/// The live map and the rule that keeps it.
#[derive(Debug, Clone)]
pub(crate) struct Live {
    pub(crate) map: LiveMap,
    gated: bool,
    views: Vec<View>,
    patches: Patches,
    /// Keyframes of live patches by area.
    areas: FxHashMap<(i32, i32), Vec<u32>>,
    /// Keyframes to be drawn or taken out, half of one a scan.
    due: VecDeque<u32>,
    /// The one of which the second half is missing.
    half_done: Option<(u32, Change)>,
    /// Where its first half was drawn or taken out.
    half_at: Option<Pose2>,
    lever_m: f64,
    /// Patches that the present scan meets and for how many of its end points.
    met: Vec<(u32, u32)>,
    /// Drawn keyframes that a correction has moved, to be drawn anew.
    moved: VecDeque<u32>,
    inserted_last: bool,
    report: LiveReport,
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

/// The keyframes as the live map needs them.
#[derive(Clone, Copy)]
pub(crate) struct Frames<'a> {
    pub(crate) keyframes: &'a [Keyframe],
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
            gated: settings.live.policy == LivePolicy::Gated,
            views: Vec::new(),
            patches: Patches::default(),
            areas: FxHashMap::default(),
            due: VecDeque::new(),
            half_done: None,
            half_at: None,
            lever_m: 0.0,
            met: Vec::new(),
            moved: VecDeque::new(),
            inserted_last: false,
            report: LiveReport::default(),
            points: SweepPoints::default(),
            table: BeamTable::default(),
        }
    }

    pub(crate) fn report(&self) -> LiveReport {
        self.report
    }

    /// Draws a keyframe's beams into the map or takes them out again; all, or the first or second half.
    fn draw(&mut self, settings: &Settings, frames: Frames<'_>, node: u32, change: Change, first_half: Option<bool>) {
        let sweep = &frames.keyframes[node as usize].sweep;
        self.points.fill(sweep, &mut self.table, settings.scan.free_range_m);
        self.points.fill_normals();
        if let Some(first) = first_half {
            self.points.keep_half(first);
        }
        let view = &mut self.views[node as usize];
        // The second half is drawn, or taken out, where the first one was.
        let half_at = self.half_at.filter(|_| first_half == Some(false));
        let at = half_at.or(view.drawn_at.filter(|_| change == Change::Remove));
        let at = at.unwrap_or(frames.world_from_robot[node as usize]);
        self.half_at = if first_half == Some(true) { Some(at) } else { self.half_at };
        self.map.draw(&self.points, at, change, node);
        let (drawn, was) = (change == Change::Add, view.drawn_at.is_some());
        view.drawn_at = drawn.then_some(at);
        self.report.keyframes = self.report.keyframes + usize::from(drawn && !was) - usize::from(was && !drawn);
    }

    /// The next keyframe, so far from the last one, is as uncertain relative to `from`.
    pub(crate) fn connect(&mut self, from: u32, covariance: &Cov3, spacing: Spacing) {
        if self.gated {
            self.patches.connect(from, covariance, spacing);
        }
    }

    /// A new keyframe joins; older views of its area give way.
    pub(crate) fn insert(&mut self, settings: &Settings, frames: Frames<'_>, node: u32, lever_m: f64) {
        self.views.push(View::default());
        self.lever_m = lever_m;
        self.draw(settings, frames, node, Change::Add, None);
        if self.gated {
            self.patches.add(frames.world_from_robot, lever_m);
            self.enter_area(settings, frames, node);
        }
    }

    /// Of the views around one the newest stay.
    fn enter_area(&mut self, settings: &Settings, frames: Frames<'_>, node: u32) {
        let at = frames.world_from_robot[node as usize];
        let (x, y) = area(at);
        self.views[node as usize].area = (x, y);
        self.areas.entry((x, y)).or_default().push(node);
        let (mut alike, mut oldest) = (0, node);
        for key in (y - 1..=y + 1).flat_map(|y| (x - 1..=x + 1).map(move |x| (x, y))) {
            for &other in self.areas.get(&key).into_iter().flatten() {
                let pose = frames.world_from_robot[other as usize];
                if at.distance(pose) <= ALIKE_M && at.between(pose).theta.abs() <= ALIKE_RAD {
                    (alike, oldest) = (alike + 1, oldest.min(other));
                }
            }
        }
        if alike > settings.live.views_per_area {
            self.leave_area(oldest);
            self.views[oldest as usize].gone = true;
            self.patches.forget(oldest);
            self.due.push_back(oldest);
            self.report.superseded += 1;
        }
    }

    fn leave_area(&mut self, node: u32) {
        if let Some(views) = self.areas.get_mut(&self.views[node as usize].area) {
            views.retain(|&view| view != node);
        }
    }

    /// A patch's keyframes join or leave: they are due to be drawn or taken out.
    fn flip(&mut self, settings: &Settings, frames: Frames<'_>, flip: Flip) {
        for node in self.patches.flip(flip) {
            self.due.push_back(node);
            if flip.live {
                self.report.let_in += 1;
                self.enter_area(settings, frames, node);
            } else {
                self.report.gated_out += 1;
                self.leave_area(node);
            }
        }
    }

    /// Before a scan is matched: if it would be matched against what is too uncertain for that, all that is so uncertain around
    /// the robot leaves the live map.
    pub(crate) fn meet(&mut self, settings: &Settings, frames: Frames<'_>, hits: &[[f64; 2]], predicted: Pose2) {
        if !self.patches.any_stale() {
            return;
        }
        let mut met = std::mem::take(&mut self.met);
        self.map.each_supplier(hits, predicted, |supplier| {
            let Some(patch) = self.patches.stale(supplier) else { return };
            match met.iter_mut().find(|(known, _)| *known == patch) {
                Some((_, points)) => *points += 1,
                None => met.push((patch, 1)),
            }
        });
        let waiting = self.due.len();
        let least = MET_SHARE * hits.len() as f64;
        if met.drain(..).any(|(_, points)| f64::from(points) > least) {
            for flip in self.patches.stale_around(predicted) {
                self.flip(settings, frames, flip);
            }
        }
        self.met = met;
        let leaving = self.due.len() - waiting;
        self.due.rotate_right(leaving);
        for _ in 0..(2 * leaving).min(MET_HALVES) {
            self.draw_half(settings, frames);
        }
        self.map.refresh();
    }

    /// Once a scan: brings the live keyframes around the robot in line with the gate, a little at a time.
    pub(crate) fn follow(&mut self, settings: &Settings, frames: Frames<'_>, inserted: bool) {
        if self.gated {
            self.follow_gate(settings, frames, inserted);
        }
        self.map.refresh();
    }

    fn follow_gate(&mut self, settings: &Settings, frames: Frames<'_>, inserted: bool) {
        self.move_some(settings, frames);
        let gate_m = settings.live.gate_m;
        for flip in self.patches.search(frames.world_from_robot, gate_m, gate_m * HYSTERESIS) {
            self.flip(settings, frames, flip);
        }
        // A scan that has inserted is the dearest already; where every scan inserts it cannot be helped.
        if !inserted || self.inserted_last {
            for _ in 0..=(self.due.len() / BACKLOG).min(HALVES_AT_MOST) {
                self.draw_half(settings, frames);
            }
        }
        self.inserted_last = inserted;
    }

    /// The keyframes were moved by a correction; what is drawn follows, the newest first.
    pub(crate) fn carry(&mut self, before: &[Pose2], frames: Frames<'_>) {
        if self.gated {
            self.patches.carry(before, frames.world_from_robot);
            self.areas.clear();
            for node in 0..frames.world_from_robot.len() as u32 {
                if !self.views[node as usize].gone && self.patches.is_live(node) {
                    let key = area(frames.world_from_robot[node as usize]);
                    self.views[node as usize].area = key;
                    self.areas.entry(key).or_default().push(node);
                }
            }
        }
        let quarter_m = 0.25 * self.map.settings.resolution_m;
        let lever_m = self.lever_m;
        let displaced = |node: &u32| {
            let at = frames.world_from_robot[*node as usize];
            self.views[*node as usize]
                .drawn_at
                .is_some_and(|drawn_at| drawn_at.distance(at) + lever_m * drawn_at.between(at).theta.abs() > quarter_m)
        };
        self.moved = (0..frames.world_from_robot.len() as u32).rev().filter(displaced).collect();
    }

    /// Draws some keyframes anew where they belong.
    fn move_some(&mut self, settings: &Settings, frames: Frames<'_>) {
        for _ in 0..MOVES_A_SCAN.min(self.moved.len()) {
            let Some(node) = self.moved.pop_front() else { return };
            if self.half_done.is_some_and(|(half, _)| half == node) {
                self.draw_half(settings, frames);
            }
            if self.views[node as usize].drawn_at.is_some() {
                self.draw(settings, frames, node, Change::Remove, None);
                self.draw(settings, frames, node, Change::Add, None);
            }
        }
    }

    /// A closure links two keyframes.
    pub(crate) fn close(&mut self, frames: Frames<'_>, from: u32, to: u32, covariance: &Cov3) {
        if self.gated {
            self.patches.close(frames.world_from_robot, from, to, covariance);
        }
    }

    /// A closure was none.
    pub(crate) fn open(&mut self, from: u32, to: u32) {
        if self.gated {
            self.patches.open(from, to);
        }
    }

    /// Old places that are not in the live map.
    pub(crate) fn survey(&mut self) -> Vec<Known> {
        if self.gated { self.patches.survey() } else { Vec::new() }
    }

    /// The robot was found elsewhere: the live map follows at once.
    pub(crate) fn arrive(&mut self, settings: &Settings, frames: Frames<'_>) {
        for _ in 0..ARRIVAL_STEPS {
            self.follow(settings, frames, false);
        }
    }

    /// Whether a keyframe is in the live map or is to be.
    pub(crate) fn is_live(&self, node: u32) -> bool {
        !self.gated || self.patches.is_live(node)
    }

    fn draw_half(&mut self, settings: &Settings, frames: Frames<'_>) {
        if let Some((node, change)) = self.half_done.take() {
            self.draw(settings, frames, node, change, Some(false));
            return;
        }
        while let Some(node) = self.due.pop_front() {
            let View { drawn_at, gone, .. } = self.views[node as usize];
            let drawn = drawn_at.is_some();
            let wanted = !gone && self.patches.is_live(node);
            if wanted != drawn {
                let change = if wanted { Change::Add } else { Change::Remove };
                self.draw(settings, frames, node, change, Some(true));
                self.half_done = Some((node, change));
                return;
            }
        }
    }

    /// Takes a keyframe out for good.
    pub(crate) fn drop(&mut self, settings: &Settings, frames: Frames<'_>, node: u32) {
        if self.half_done.is_some_and(|(half, _)| half == node) {
            self.draw_half(settings, frames);
        }
        let Some(view) = self.views.get_mut(node as usize) else { return };
        view.gone = true;
        if view.drawn_at.is_some() {
            self.draw(settings, frames, node, Change::Remove, None);
        }
        self.map.refresh();
        if self.gated {
            self.leave_area(node);
            self.patches.forget(node);
        }
    }
}

fn area(pose: Pose2) -> (i32, i32) {
    ((pose.x / AREA_M).floor() as i32, (pose.y / AREA_M).floor() as i32)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Stamp;
    use mapwright_grid::CountGrid;
    use mapwright_record::KeyframeId;
    use mapwright_sensor::Sweep;
    use mapwright_sim::{Drive, DriveSettings, worlds};

    /// Keyframes along a corridor, 0.5 m apart, at their true poses.
    fn corridor(count: usize) -> (Vec<Keyframe>, Vec<Pose2>) {
        let site = worlds::corridor(1, worlds::CorridorWalls::Features);
        let (mut keyframes, mut poses) = (Vec::new(), Vec::<Pose2>::new());
        for recorded in Drive::new(site.into(), DriveSettings::default()).scans() {
            let far = poses.last().is_none_or(|last| last.distance(recorded.world_from_robot) > 0.5);
            if far && poses.len() < count {
                let id = KeyframeId { robot: 0, session: 0, seq: poses.len() as u32 };
                let (sweep, _) = Sweep::from_scan(&recorded.scan, [0.0; 3]);
                keyframes.push(Keyframe { id, stamp: Stamp(0), scan: 0, sweep });
                poses.push(recorded.world_from_robot);
            }
        }
        (keyframes, poses)
    }

    fn gated() -> Settings {
        let mut settings = Settings::default();
        settings.live.policy = LivePolicy::Gated;
        settings.live.gate_m = 0.2;
        settings
    }

    /// A covariance of one step of the chain, of which `sigma_m` adds up.
    fn step(sigma_m: f64) -> Cov3 {
        let variance_m2 = sigma_m * sigma_m / crate::patches::DISPLACEMENT_SHARE;
        Cov3::from_diagonal(&nalgebra::Vector3::new(variance_m2, variance_m2, 1e-12))
    }

    /// Inserts keyframes each `sigma_m` uncertain relative to the one before, with three scans between them.
    fn drive(keyframes: &[Keyframe], poses: &[Pose2], sigma_m: f64, closure: Option<(u32, u32)>) -> Live {
        let settings = gated();
        let mut live = Live::new(&settings);
        for node in 0..poses.len() {
            let frames = Frames { keyframes: &keyframes[..=node], world_from_robot: &poses[..=node] };
            let node = node as u32;
            if node > 0 {
                live.connect(node - 1, &step(sigma_m), Spacing::default());
            }
            if let Some((_, to)) = closure.filter(|&(at, _)| at == node) {
                live.connect(to, &step(0.01), Spacing::default());
            }
            live.insert(&settings, frames, node, 5.0);
            for inserted in [true, false, false, false] {
                live.follow(&settings, frames, inserted);
            }
        }
        live
    }

    /// Counts of the keyframes that are drawn, drawn anew.
    fn redrawn(live: &Live, keyframes: &[Keyframe], poses: &[Pose2]) -> CountGrid {
        let mut map = CountGrid::new(0.05);
        let (mut points, mut table) = (SweepPoints::default(), BeamTable::default());
        for node in (0..poses.len()).filter(|&node| live.views[node].drawn_at.is_some()) {
            points.fill(&keyframes[node].sweep, &mut table, Settings::default().scan.free_range_m);
            points.fill_normals();
            map.draw(&points, poses[node], Change::Add, &mut Vec::new());
        }
        map
    }

    fn finish(live: &mut Live, keyframes: &[Keyframe], world_from_robot: &[Pose2]) {
        while live.half_done.is_some() || !live.due.is_empty() {
            live.draw_half(&gated(), Frames { keyframes, world_from_robot });
        }
    }

    #[test]
    fn certain_keyframes_stay_and_uncertain_ones_leave_behind_the_robot() {
        let (keyframes, poses) = corridor(60);
        assert_eq!(drive(&keyframes, &poses, 0.01, None).report.keyframes, 60);
        let mut live = drive(&keyframes, &poses, 0.12, None);
        finish(&mut live, &keyframes, &poses);
        // 17 steps of 0.12 m make 0.5 m; patches and a search a metre ago blur that, and beyond 20 m nobody asks.
        let drawn: Vec<bool> = live.views.iter().map(|view| view.drawn_at.is_some()).collect();
        assert!(drawn[52..].iter().all(|&drawn| drawn), "{drawn:?}");
        assert!(drawn[22..35].iter().all(|&drawn| !drawn), "{drawn:?}");
        assert_eq!(live.report.keyframes, drawn.iter().filter(|&&drawn| drawn).count());
    }

    #[test]
    fn what_remains_is_drawn_exactly_once() {
        let (keyframes, poses) = corridor(60);
        for closure in [None, Some((50, 33))] {
            let mut live = drive(&keyframes, &poses, 0.12, closure);
            finish(&mut live, &keyframes, &poses);
            assert!(live.report.gated_out > 5, "{:?}", live.report);
            assert!(live.map.counts().to_bytes() == redrawn(&live, &keyframes, &poses).to_bytes());
        }
    }

    #[test]
    fn a_link_to_a_place_that_was_out_lets_it_in_again() {
        let (keyframes, poses) = corridor(60);
        let mut live = drive(&keyframes, &poses, 0.12, Some((55, 34)));
        finish(&mut live, &keyframes, &poses);
        assert!(
            live.views[33].drawn_at.is_some() && live.views[34].drawn_at.is_some() && live.report.let_in > 0,
            "{:?}",
            live.report
        );
    }

    #[test]
    fn what_is_too_uncertain_to_be_matched_against_leaves_before_a_scan_would_be() {
        // Out, and back beside it: the start is 30 steps of 0.05 m old when the robot is beside it again.
        let (keyframes, mut poses) = corridor(60);
        for back in 30..60 {
            let there = poses[59 - back];
            poses[back] = Pose2 { y: there.y + 10.0, ..there };
        }
        let (settings, frames) = (gated(), Frames { keyframes: &keyframes, world_from_robot: &poses });
        let mut live = drive(&keyframes, &poses, 0.05, None);
        finish(&mut live, &keyframes, &poses);
        let drawn = |live: &Live, node: usize| live.views[node].drawn_at.is_some();
        let scan = |live: &mut Live, node: usize| {
            let mut points = SweepPoints::default();
            points.fill(&keyframes[node].sweep, &mut BeamTable::default(), settings.scan.free_range_m);
            live.meet(&settings, frames, &points.hits, poses[node]);
        };
        scan(&mut live, 59);
        assert!(live.report.gated_out == 0 && drawn(&live, 0), "no scan has met it: {:?}", live.report);
        scan(&mut live, 0);
        assert!(live.report.gated_out > 0 && !drawn(&live, 0) && drawn(&live, 59), "{:?}", live.report);
        finish(&mut live, &keyframes, &poses);
        live.map.refresh();
        assert!(live.map.counts().to_bytes() == redrawn(&live, &keyframes, &poses).to_bytes());
    }

    #[test]
    fn a_keyframe_that_is_half_taken_out_can_be_dropped() {
        let (keyframes, poses) = corridor(60);
        let mut live = drive(&keyframes, &poses, 0.12, None);
        let frames = Frames { keyframes: &keyframes, world_from_robot: &poses };
        let newest = 59;
        live.due.clear();
        live.views[newest].gone = true;
        live.due.push_back(newest as u32);
        live.half_done = None;
        live.draw_half(&gated(), frames);
        assert_eq!(live.half_done, Some((newest as u32, Change::Remove)));
        live.drop(&gated(), frames, newest as u32);
        assert!(live.views[newest].drawn_at.is_none() && live.half_done.is_none());
    }

    #[test]
    fn a_place_seen_again_and_again_keeps_the_newest_views() {
        let (keyframes, poses) = corridor(2);
        let (keyframe, pose) = (&keyframes[1], poses[1]);
        let settings = gated();
        let (keyframes, poses) = (vec![keyframe.clone(); 200], vec![pose; 200]);
        let mut live = drive(&keyframes, &poses, 0.001, None);
        finish(&mut live, &keyframes, &poses);
        let most = settings.live.views_per_area as usize;
        assert_eq!(live.report.keyframes, most);
        assert!(live.views[200 - most..].iter().all(|view| view.drawn_at.is_some()));
        assert!(live.map.counts().to_bytes() == redrawn(&live, &keyframes, &poses).to_bytes());
    }
}
