//! Which keyframes the live map is made of.

use crate::patches::{Flip, Known, Patches, Spacing};
use crate::settings::{LivePolicy, Settings};
use mapwright_geom::{Cov3, Pose2};
use mapwright_grid::{Change, LiveMap, LiveMapSettings, floor_cell};
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

/// Rounds of following that bring the surroundings of a robot into the live map that was found elsewhere.
const ARRIVAL_STEPS: usize = 400;
/// and keyframes that are drawn there at once.
const ARRIVAL_KEYFRAMES: usize = 200;
/// A keyframe is drawn anew when what it shows has moved by more than this, cells.
const DISPLACED_CELLS: f64 = 0.25;
/// So many keyframes that are due are drawn at a time, for what they have in common is settled once,
const BATCH: u32 = 8;
/// one every two scans; one more every two scans for so many that are due,
const BACKLOG: usize = 64;
/// and so many more at most.
const BACKLOG_AT_MOST: usize = 8;

/// A scan meets a patch that supplies what more than such a share of its end points would be matched against.
const MET_SHARE: f64 = 0.02;
/// Side of the squares by which it is told whether a scan meets a patch that is not drawn where it belongs, metres.
const SQUARE_M: f64 = 2.0;
/// Of a patch that is drawn again so many views stay, evenly spread.
const REDRAWN_AT_MOST: usize = 16;
/// So many keyframes leave before the scan is matched, the others in the next scans.
const MET_AT_ONCE: usize = 32;

/// What the live map consists of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct LiveReport {
    /// Keyframes in it.
    pub keyframes: usize,
    /// Keyframes that were taken out because they were no longer certain relative to the robot; those that were left behind
    /// where the map began anew are not counted.
    pub gated_out: u64,
    /// Keyframes that were drawn again.
    pub let_in: u64,
    /// Keyframes that gave way to other views of the same area.
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
    /// Keyframes to be drawn or taken out.
    due: VecDeque<u32>,
    /// How many halves of them may be drawn by now.
    halves: u32,
    lever_m: f64,
    /// Patches that the present scan meets and for how many of its end points.
    met: Vec<(u32, u32)>,
    /// Patches that wait until a scan meets them to be drawn where they belong, by the squares in which they have obstacles.
    waiting: Vec<((i32, i32), u32)>,
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
            halves: 0,
            lever_m: 0.0,
            met: Vec::new(),
            waiting: Vec::new(),
            inserted_last: false,
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
        let sweep = &frames.keyframes[node as usize].sweep;
        self.points.fill(sweep, &mut self.table, settings.scan.free_range_m);
        self.points.fill_normals();
        let view = &mut self.views[node as usize];
        let drawn_at = view.drawn_at.filter(|_| change == Change::Remove);
        let at = drawn_at.unwrap_or(frames.world_from_robot[node as usize]);
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
        let blank = frames.keyframes[node as usize].sweep.is_blank();
        if blank {
            // It is where the robot is, and there is nothing to draw.
            self.points.clear();
            self.views[node as usize].gone = true;
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
            self.supersede(oldest);
        }
    }

    /// A view gives way to others for good.
    fn supersede(&mut self, node: u32) {
        self.views[node as usize].gone = true;
        self.patches.forget(node);
        self.due.push_back(node);
        self.report.superseded += 1;
    }

    fn leave_area(&mut self, node: u32) {
        if let Some(views) = self.areas.get_mut(&self.views[node as usize].area) {
            views.retain(|&view| view != node);
        }
    }

    /// A patch's keyframes join or leave: they are due to be taken out, or wait until a scan meets them to be drawn.
    fn flip(&mut self, settings: &Settings, frames: Frames<'_>, flip: Flip) {
        for node in self.patches.flip(flip) {
            if self.views[node as usize].gone {
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
    /// the robot leaves the live map, the nearest at once.
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
            if let Some(patch) = self.patches.stale(supplier) {
                count(&mut met, patch, 1);
            }
        });
        let least = MET_SHARE * hits.len() as f64;
        let is_met = met.drain(..).any(|(_, points)| f64::from(points) > least);
        self.met = met;
        is_met
    }

    /// What is certain and was not drawn yet is due as soon as a scan ends on it.
    fn meet_waiting(&mut self, hits: &[[f64; 2]], predicted: Pose2) {
        if self.waiting.is_empty() {
            return;
        }
        let mut met = std::mem::take(&mut self.met);
        let (s, c) = predicted.theta.sin_cos();
        let square = |&[x, y]: &[f64; 2]| square([predicted.x + c * x - s * y, predicted.y + s * x + c * y]);
        // Neighbouring beams end in the same square.
        let mut hits_left = hits.iter().map(square).peekable();
        while let Some(square) = hits_left.next() {
            let mut points = 1;
            while hits_left.next_if_eq(&square).is_some() {
                points += 1;
            }
            let first = self.waiting.partition_point(|&(other, _)| other < square);
            for &(_, patch) in self.waiting[first..].iter().take_while(|(other, _)| *other == square) {
                count(&mut met, patch, points);
            }
        }
        let least = MET_SHARE * hits.len() as f64;
        met.sort_unstable_by_key(|&(patch, points)| (std::cmp::Reverse(points), patch));
        for (patch, _) in met.drain(..).filter(|&(_, points)| f64::from(points) > least) {
            let views = self.patches.settle(patch).to_vec();
            let count = views.len();
            let stays = |k: usize| k * REDRAWN_AT_MOST / count != (k + 1) * REDRAWN_AT_MOST / count;
            for (k, view) in views.into_iter().enumerate() {
                if count <= REDRAWN_AT_MOST || stays(k) {
                    self.due.push_back(view);
                } else {
                    self.leave_area(view);
                    self.supersede(view);
                }
            }
            self.waiting.retain(|&(_, other)| other != patch);
        }
        self.met = met;
    }

    /// Notes where the patches around that wait have their obstacles, and where these are drawn if they are.
    fn note_waiting(&mut self, frames: Frames<'_>) {
        self.waiting.clear();
        let Some(&at) = frames.world_from_robot.last() else { return };
        let Self { patches, waiting, views, .. } = self;
        let pose = |node: u32| frames.world_from_robot[node as usize];
        patches.each_waiting(at, |number, patch| {
            let drawn =
                patch.views.iter().find_map(|&view| Some(views[view as usize].drawn_at? * pose(view).inverse()));
            for moved in [Some(Pose2::IDENTITY), drawn].into_iter().flatten() {
                let Pose2 { x, y, theta } = moved * pose(patch.first);
                let (s, c) = theta.sin_cos();
                let in_world = |[px, py]: [f64; 2]| [x + c * px - s * py, y + s * px + c * py];
                waiting.extend(patch.outline().map(|point| (square(in_world(point)), number)));
            }
        });
        waiting.sort_unstable();
        waiting.dedup();
    }

    /// Once a scan: brings the live keyframes around the robot in line with the gate, a little at a time.
    pub(crate) fn follow(&mut self, settings: &Settings, frames: Frames<'_>, inserted: bool) {
        if self.gated {
            self.follow_gate(settings, frames);
        }
        // A scan that has inserted is the dearest already; where every scan inserts it cannot be helped.
        if !inserted || self.inserted_last {
            self.halves += 1 + (self.due.len() / BACKLOG).min(BACKLOG_AT_MOST) as u32;
            if self.halves >= 2 * BATCH {
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
            self.areas.clear();
            for node in 0..frames.world_from_robot.len() as u32 {
                if !self.views[node as usize].gone && self.patches.is_live(node) {
                    let key = area(frames.world_from_robot[node as usize]);
                    self.views[node as usize].area = key;
                    self.areas.entry(key).or_default().push(node);
                }
            }
        }
        let nodes = 0..frames.world_from_robot.len() as u32;
        let displaced = nodes.clone().filter(|&node| self.is_displaced(frames, node) && self.is_wanted(node));
        let displaced: Vec<u32> = displaced.collect();
        if !self.gated {
            self.due = displaced.into();
            return;
        }
        let wanted = nodes.filter(|&node| self.views[node as usize].drawn_at.is_some() && self.is_wanted(node)).count();
        let stay = wanted - displaced.len();
        for node in displaced {
            self.patches.unsettle(node);
        }
        if self.report.keyframes > 2 * stay {
            self.begin_anew(settings, frames);
        }
        self.note_waiting(frames);
    }

    /// Whether a keyframe is to be in the live map.
    fn is_wanted(&self, node: u32) -> bool {
        !self.views[node as usize].gone && self.is_live(node)
    }

    /// Whether a keyframe is drawn elsewhere than where it belongs.
    fn is_displaced(&self, frames: Frames<'_>, node: u32) -> bool {
        let at = frames.world_from_robot[node as usize];
        self.views[node as usize].drawn_at.is_some_and(|drawn_at| {
            let moved_m = drawn_at.distance(at) + self.lever_m * drawn_at.between(at).theta.abs();
            moved_m > DISPLACED_CELLS * self.map.settings.resolution_m
        })
    }

    /// Where more would have to be taken out of the live map than stays, it begins anew, with the newest views. The others wait.
    fn begin_anew(&mut self, settings: &Settings, frames: Frames<'_>) {
        self.map = LiveMap::new(self.map.settings);
        self.views.iter_mut().for_each(|view| view.drawn_at = None);
        self.report.keyframes = 0;
        self.due.clear();
        self.patches.unsettle_all();
        let mut left = MET_AT_ONCE;
        for node in (0..self.views.len() as u32).rev() {
            if left > 0 && self.is_wanted(node) {
                self.draw(settings, frames, node, Change::Add);
                left -= 1;
            }
        }
        self.map.refresh();
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

    /// The robot was found elsewhere: the live map follows at once, as far as a scan from there sees.
    pub(crate) fn arrive(&mut self, settings: &Settings, frames: Frames<'_>, hits: &[[f64; 2]], at: Pose2) {
        for _ in 0..ARRIVAL_STEPS {
            self.follow(settings, frames, false);
        }
        self.meet_waiting(hits, at);
        self.settle_due(settings, frames, ARRIVAL_KEYFRAMES);
        self.map.refresh();
    }

    /// Whether a keyframe is in the live map or is to be.
    pub(crate) fn is_live(&self, node: u32) -> bool {
        !self.gated || self.patches.is_live(node)
    }

    /// Draws, takes out or moves up to so many of the keyframes that are due.
    fn settle_due(&mut self, settings: &Settings, frames: Frames<'_>, most: usize) {
        let mut left = most;
        while left > 0 {
            let Some(node) = self.due.pop_front() else { return };
            let drawn = self.views[node as usize].drawn_at.is_some();
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
            self.report.gated_out += u64::from(!wanted && !self.views[node as usize].gone);
            left -= 1;
        }
    }

    /// Takes a keyframe out for good.
    pub(crate) fn drop(&mut self, settings: &Settings, frames: Frames<'_>, node: u32) {
        let Some(view) = self.views.get_mut(node as usize) else { return };
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

fn square([x, y]: [f64; 2]) -> (i32, i32) {
    (floor_cell(x / SQUARE_M), floor_cell(y / SQUARE_M))
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
        live.settle_due(&gated(), Frames { keyframes, world_from_robot }, usize::MAX);
    }

    /// A scan like that of a keyframe meets what is there.
    fn scan(live: &mut Live, keyframes: &[Keyframe], poses: &[Pose2], node: usize) {
        let (settings, mut points) = (gated(), SweepPoints::default());
        points.fill(&keyframes[node].sweep, &mut BeamTable::default(), settings.scan.free_range_m);
        live.meet(&settings, Frames { keyframes, world_from_robot: poses }, &points.hits, poses[node]);
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
    fn a_link_to_a_place_that_was_out_lets_it_in_again_when_a_scan_meets_it() {
        let (keyframes, poses) = corridor(60);
        let mut live = drive(&keyframes, &poses, 0.12, Some((55, 34)));
        finish(&mut live, &keyframes, &poses);
        let drawn = |live: &Live, node: usize| live.views[node].drawn_at.is_some();
        assert!(live.is_live(33) && live.is_live(34) && live.report.let_in == 0, "{:?}", live.report);
        assert!(!drawn(&live, 33) && !drawn(&live, 34));
        scan(&mut live, &keyframes, &poses, 33);
        finish(&mut live, &keyframes, &poses);
        assert!(drawn(&live, 33) && drawn(&live, 34) && live.report.let_in > 0, "{:?}", live.report);
        live.map.refresh();
        assert!(live.map.counts().to_bytes() == redrawn(&live, &keyframes, &poses).to_bytes());
    }

    /// The keyframes from `first` on stay, those before are carried along the corridor.
    fn corrected(poses: &[Pose2], first: usize) -> Vec<Pose2> {
        let by = |node: usize| if node < first { 0.3 } else { 0.0 };
        poses.iter().enumerate().map(|(node, pose)| Pose2 { x: pose.x + by(node), ..*pose }).collect()
    }

    #[test]
    fn what_a_correction_moves_is_drawn_where_it_belongs_when_a_scan_meets_it() {
        let (keyframes, poses) = corridor(60);
        for first in [10, 50] {
            let mut live = drive(&keyframes, &poses, 0.001, None);
            let moved = corrected(&poses, first);
            let frames = Frames { keyframes: &keyframes, world_from_robot: &moved };
            live.carry(&gated(), &poses, frames);
            finish(&mut live, &keyframes, &moved);
            let at = |live: &Live, node: usize| live.views[node].drawn_at;
            // Where most has moved all begins anew, with the newest; where little has it stays until it is met.
            let newest = (0..60).filter(|&node| at(&live, node).is_some()).count();
            assert_eq!(newest, if first == 10 { 60 } else { MET_AT_ONCE }, "{:?}", live.report);
            assert_eq!(at(&live, 5), if first == 10 { Some(poses[5]) } else { None });
            for node in 0..60 {
                scan(&mut live, &keyframes, &moved, node);
            }
            finish(&mut live, &keyframes, &moved);
            live.map.refresh();
            assert!((0..60).all(|node| at(&live, node) == Some(moved[node])), "{:?}", live.report);
            assert!(live.map.counts().to_bytes() == redrawn(&live, &keyframes, &moved).to_bytes());
        }
    }

    /// Out, and back beside it: the start is 30 steps old when the robot is beside it again.
    fn out_and_back() -> (Vec<Keyframe>, Vec<Pose2>) {
        let (keyframes, mut poses) = corridor(60);
        for back in 30..60 {
            let there = poses[59 - back];
            poses[back] = Pose2 { y: there.y + 10.0, ..there };
        }
        (keyframes, poses)
    }

    #[test]
    fn what_is_too_uncertain_to_be_matched_against_leaves_before_a_scan_would_be() {
        let (keyframes, poses) = out_and_back();
        let mut live = drive(&keyframes, &poses, 0.05, None);
        finish(&mut live, &keyframes, &poses);
        let drawn = |live: &Live, node: usize| live.views[node].drawn_at.is_some();
        scan(&mut live, &keyframes, &poses, 59);
        assert!(live.report.gated_out == 0 && drawn(&live, 0), "no scan has met it: {:?}", live.report);
        scan(&mut live, &keyframes, &poses, 0);
        assert!(live.report.gated_out > 0 && !drawn(&live, 0) && drawn(&live, 59), "{:?}", live.report);
        finish(&mut live, &keyframes, &poses);
        live.map.refresh();
        assert!(live.map.counts().to_bytes() == redrawn(&live, &keyframes, &poses).to_bytes());
    }

    #[test]
    fn of_a_place_that_is_drawn_again_some_views_stay() {
        let (keyframes, poses) = corridor(2);
        let most = gated().live.views_per_area as usize;
        let (keyframes, poses) = (vec![keyframes[1].clone(); most], vec![poses[1]; most]);
        let mut live = drive(&keyframes, &poses, 0.001, None);
        let frames = Frames { keyframes: &keyframes, world_from_robot: &poses };
        for is_live in [false, true] {
            live.flip(&gated(), frames, Flip { patch: 0, live: is_live, distance2: 0.0 });
            finish(&mut live, &keyframes, &poses);
            assert_eq!(live.report.keyframes, 0, "out, and not met yet");
        }
        live.note_waiting(frames);
        scan(&mut live, &keyframes, &poses, 0);
        finish(&mut live, &keyframes, &poses);
        live.map.refresh();
        assert_eq!((live.report.keyframes, live.report.superseded), (REDRAWN_AT_MOST, (most - REDRAWN_AT_MOST) as u64));
        assert!(live.map.counts().to_bytes() == redrawn(&live, &keyframes, &poses).to_bytes());
    }

    #[test]
    fn a_keyframe_that_is_to_leave_can_be_dropped() {
        let (keyframes, poses) = corridor(60);
        let mut live = drive(&keyframes, &poses, 0.001, None);
        let frames = Frames { keyframes: &keyframes, world_from_robot: &poses };
        live.flip(&gated(), frames, Flip { patch: 0, live: false, distance2: 0.0 });
        let drawn = |live: &Live, node: u32| live.views[node as usize].drawn_at.is_some();
        let leaving = live.due.iter().copied().find(|&node| drawn(&live, node));
        let leaving = leaving.expect("what leaves is taken out a few at a time");
        live.drop(&gated(), frames, leaving);
        assert!(!drawn(&live, leaving));
        finish(&mut live, &keyframes, &poses);
        live.map.refresh();
        assert!(live.map.counts().to_bytes() == redrawn(&live, &keyframes, &poses).to_bytes());
    }

    #[test]
    fn a_keyframe_without_beams_is_a_place_and_nothing_drawn() {
        let (mut keyframes, poses) = corridor(40);
        keyframes[20].sweep = keyframes[20].sweep.blanked();
        let mut live = drive(&keyframes, &poses, 0.001, None);
        let frames = Frames { keyframes: &keyframes, world_from_robot: &poses };
        let is_out =
            |live: &Live| live.views[20].drawn_at.is_none() && !live.areas.values().flatten().any(|&k| k == 20);
        assert!(is_out(&live) && live.is_live(20) && live.is_live(39), "it is known where it is, and what follows");
        for is_live in [false, true] {
            for patch in 0..5 {
                live.flip(&gated(), frames, Flip { patch, live: is_live, distance2: 0.0 });
            }
            finish(&mut live, &keyframes, &poses);
        }
        live.note_waiting(frames);
        scan(&mut live, &keyframes, &poses, 20);
        finish(&mut live, &keyframes, &poses);
        live.map.refresh();
        assert!(is_out(&live));
        assert!(live.map.counts().to_bytes() == redrawn(&live, &keyframes, &poses).to_bytes());
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
