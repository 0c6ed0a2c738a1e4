//! The finished map that a robot is located in, and where in it a scan may have been taken at all.

use crate::settings::Settings;
use mapwright_geom::Pose2;
use mapwright_grid::{Change, LocalMap, LocalMapSettings};
use mapwright_record::{NodeId, Session};
use mapwright_sensor::{BeamTable, SweepPoints};
use std::cmp::Reverse;
use std::collections::BinaryHeap;
use std::f64::consts::TAU;

/// Side of the cells of a search over the whole map, metres: as wide as two steps of it may be off and a match still finds its way.
const SEARCH_CELL_M: f64 = 0.2;
/// Cells a robot may stand in at most, so that a search takes a tenth of a second; in a larger map cells are larger,
const STANDS_AT_MOST: f64 = 40_000.0;
/// up to this side, metres.
const SEARCH_CELL_AT_MOST_M: f64 = 0.5;
/// Beams that pass through a cell before it counts as one that a robot may stand in.
const FREE_PASSES: u32 = 2;
/// Points a search compares.
const SEARCH_POINTS: usize = 48;
/// They are the nearer half of those seen, or those within this distance, metres: farther ones ask for finer headings.
const SEARCH_REACH_M: f64 = 8.0;
/// What a point scores in a cell with an obstacle, beside one, where nothing is known, and in free space.
const SCORES: [u8; 4] = [6, 4, 2, 0];
/// The best poses that are kept before those near to a better one are dropped, and after that.
const KEPT: usize = 8_000;
const PEAKS: usize = 250;
/// Poses nearer than this are one peak, metres and radians.
const PEAK_M: f64 = 0.4;
const PEAK_RAD: f64 = 0.2;

/// A map that is not added to.
#[derive(Debug, Clone)]
pub(super) struct FinishedMap {
    pub(super) map: LocalMap,
    cell_m: f64,
    low: [i32; 2],
    width: i32,
    height: i32,
    /// What a point scores there, row by row.
    scores: Vec<u8>,
    /// Cells that a robot may stand in.
    stands: Vec<[i32; 2]>,
}

impl FinishedMap {
    /// The map of a session, where it has several the first, as it is exported.
    pub(super) fn of(settings: &Settings, session: &Session) -> Self {
        let mut map = LocalMap::new(LocalMapSettings {
            resolution_m: settings.map.resolution_m,
            passes_per_hit: settings.map.passes_per_hit,
            ..LocalMapSettings::default()
        });
        let maps = session.maps();
        let first = maps.first();
        let (mut points, mut table) = (SweepPoints::default(), BeamTable::default());
        let drawn = session.drawn().iter().zip(session.map_from_keyframe()).enumerate();
        for (place, (sweep, &map_from_keyframe)) in drawn {
            let Some(sweep) = sweep.as_ref().filter(|_| first.is_none_or(|map| map.has(place))) else { continue };
            points.fill(sweep, &mut table, settings.scan.free_range_m);
            points.fill_normals();
            map.draw(&points, map_from_keyframe, Change::Add, NodeId::at(place).number());
        }
        map.refresh();
        Self::searchable(map)
    }

    fn searchable(map: LocalMap) -> Self {
        let resolution_m = map.settings.resolution_m;
        let is_obstacle = |x, y| map.field().is_occupied(x, y);
        let (mut low, mut high, mut free) = ([i32::MAX; 2], [i32::MIN; 2], 0_u32);
        for (x, y, hits, passes) in map.counts().known_cells() {
            (low, high) = ([low[0].min(x), low[1].min(y)], [high[0].max(x), high[1].max(y)]);
            free += u32::from(hits == 0 && passes >= FREE_PASSES);
        }
        let area_m2 = f64::from(free) * resolution_m * resolution_m;
        let cell_m = (area_m2 / STANDS_AT_MOST).sqrt().clamp(SEARCH_CELL_M, SEARCH_CELL_AT_MOST_M).max(resolution_m);
        let fine = (cell_m / resolution_m).round().max(1.0) as i32;
        let cell_m = f64::from(fine) * resolution_m;
        let low = low.map(|edge| if edge == i32::MAX { 0 } else { edge.div_euclid(fine) - 1 });
        let high = high.map(|edge| if edge == i32::MIN { 0 } else { edge.div_euclid(fine) + 1 });
        let (width, height) = (high[0] - low[0] + 1, high[1] - low[1] + 1);
        let [on, beside, unknown, clear] = SCORES;
        let mut scores = vec![unknown; width as usize * height as usize];
        let index = |x: i32, y: i32| ((y - low[1]) * width + x - low[0]) as usize;
        let mut stands = Vec::new();
        for (x, y, hits, passes) in map.counts().known_cells() {
            if hits == 0 && passes >= FREE_PASSES {
                let cell = [x.div_euclid(fine), y.div_euclid(fine)];
                let score = &mut scores[index(cell[0], cell[1])];
                if *score == unknown {
                    *score = clear;
                    stands.push(cell);
                }
            }
        }
        let mut walls: Vec<[i32; 2]> = map
            .counts()
            .known_cells()
            .filter(|&(x, y, hits, _)| hits > 0 && is_obstacle(x, y))
            .map(|(x, y, ..)| [x.div_euclid(fine), y.div_euclid(fine)])
            .collect();
        walls.sort_unstable();
        walls.dedup();
        for [x, y] in walls {
            for (dx, dy) in (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| (dx, dy))) {
                let score = &mut scores[index(x + dx, y + dy)];
                *score = (*score).max(if (dx, dy) == (0, 0) { on } else { beside });
            }
        }
        Self { map, cell_m, low, width, height, scores, stands }
    }

    /// How many places a robot may stand at that are told apart, one at least.
    pub(super) fn places(&self) -> f64 {
        let area_m2 = self.stands.len() as f64 * self.cell_m * self.cell_m;
        (area_m2 / (PEAK_M * PEAK_M) * TAU / PEAK_RAD).max(1.0)
    }

    /// Poses at which points in the robot's frame may have been seen, the likeliest first: peaks of how many end at obstacles, over all poses.
    pub(super) fn peaks(&self, points: &[[f64; 2]]) -> Vec<Pose2> {
        let most_m = middle_range_m(points).max(SEARCH_REACH_M);
        let within = |point: &&[f64; 2]| point[0].hypot(point[1]) <= most_m;
        let all: Vec<[f64; 2]> = points.iter().filter(within).copied().collect();
        let every = all.len().div_ceil(SEARCH_POINTS).max(1);
        let points: Vec<[f64; 2]> = all.into_iter().step_by(every).collect();
        let reach_m = points.iter().map(|[x, y]| x.hypot(*y)).fold(self.cell_m, f64::max);
        let headings = (TAU * reach_m / (2.0 * self.cell_m)).ceil().max(8.0) as u32;
        let mut best: BinaryHeap<Reverse<(u32, u32, u32)>> = BinaryHeap::new();
        let mut offsets = Vec::new();
        for heading in 0..headings {
            let turn = Pose2::new(0.0, 0.0, TAU * f64::from(heading) / f64::from(headings));
            offsets.clear();
            offsets.extend(points.iter().map(|&p| turn.transform(p).map(|m| (m / self.cell_m).round() as i32)));
            for (number, &stand) in self.stands.iter().enumerate() {
                let least = best.peek().filter(|_| best.len() == KEPT).map_or(0, |least| least.0.0 + 1);
                let Some(score) = self.score_from(stand, &offsets, least) else { continue };
                if best.len() == KEPT {
                    best.pop();
                }
                best.push(Reverse((score, heading, number as u32)));
            }
        }
        let mut sorted = best.into_vec();
        sorted.sort_unstable();
        let mut peaks: Vec<Pose2> = Vec::new();
        for Reverse((_, heading, number)) in sorted {
            let pose = self.pose(self.stands[number as usize], TAU * f64::from(heading) / f64::from(headings));
            if peaks.iter().all(|&peak| is_elsewhere(peak, pose, [PEAK_M, PEAK_RAD])) {
                peaks.push(pose);
                if peaks.len() == PEAKS {
                    break;
                }
            }
        }
        peaks
    }

    fn pose(&self, [x, y]: [i32; 2], heading_rad: f64) -> Pose2 {
        let middle_m = |cell: i32| (f64::from(cell) + 0.5) * self.cell_m;
        Pose2::new(middle_m(x), middle_m(y), mapwright_geom::wrap_angle(heading_rad))
    }

    /// What the points score there; none where that is less than `least`, which is told by the first of them mostly.
    fn score_from(&self, [x, y]: [i32; 2], offsets: &[[i32; 2]], least: u32) -> Option<u32> {
        let (mut score, mut left) = (0, offsets.len() as u32 * u32::from(SCORES[0]));
        for part in offsets.chunks(12) {
            score += part.iter().map(|[dx, dy]| u32::from(self.score(x + dx, y + dy))).sum::<u32>();
            left -= part.len() as u32 * u32::from(SCORES[0]);
            if score + left < least {
                return None;
            }
        }
        Some(score)
    }

    #[inline]
    fn score(&self, x: i32, y: i32) -> u8 {
        let (u, v) = (x - self.low[0], y - self.low[1]);
        let is_inside = (0..self.width).contains(&u) && (0..self.height).contains(&v);
        if is_inside { self.scores[(v * self.width + u) as usize] } else { SCORES[2] }
    }
}

/// Median range of points, metres; 1 without any.
pub(super) fn middle_range_m(points: &[[f64; 2]]) -> f64 {
    let mut ranges_m: Vec<f64> = points.iter().map(|[x, y]| x.hypot(*y)).collect();
    let middle = ranges_m.len() / 2;
    if ranges_m.is_empty() { 1.0 } else { *ranges_m.select_nth_unstable_by(middle, f64::total_cmp).1 }
}

/// Whether two poses are farther apart than so many metres or radians.
pub(super) fn is_elsewhere(one: Pose2, other: Pose2, [m, rad]: [f64; 2]) -> bool {
    one.distance(other) > m || one.between(other).theta.abs() > rad
}
