//! What there is to see, and what of it was seen.

use mapwright::{LaserScan, Pose2};
use mapwright_sim::Rovers;
use std::f64::consts::TAU;

/// Side of a cell, metres.
const CELL_M: f64 = 0.1;
/// Robots may look around from places so many cells apart.
const LOOK_EVERY: usize = 6;
const LOOK_BEAMS: usize = 360;
/// Places are looked for within so much of where the robots start, metres.
const EXTENT_M: f64 = 80.0;
const SIDE: usize = (2.0 * EXTENT_M / CELL_M) as usize;

/// The cells that a robot could see from anywhere it can get to, and those that were seen.
#[derive(Debug, Clone)]
pub(super) struct Truth {
    center_m: [f64; 2],
    to_see: Vec<bool>,
    seen: Vec<bool>,
    cells: usize,
    count: usize,
}

/// Cells along a beam.
struct Walk {
    at: [f64; 2],
    step: [f64; 2],
    left: usize,
}

impl Walk {
    #[inline]
    fn next(&mut self) -> Option<usize> {
        if self.left == 0 {
            return None;
        }
        let cell = self.at[1] as usize * SIDE + self.at[0] as usize;
        self.left -= 1;
        self.at = [self.at[0] + self.step[0], self.at[1] + self.step[1]];
        Some(cell)
    }
}

impl Truth {
    pub(super) fn new(rovers: &Rovers, start: Pose2, radius_m: f64, reach_m: f64) -> Self {
        let mut truth = Self {
            center_m: [start.x, start.y],
            to_see: vec![false; SIDE * SIDE],
            seen: vec![false; SIDE * SIDE],
            cells: 0,
            count: 0,
        };
        for cell in truth.reachable(rovers, radius_m) {
            if (cell % SIDE).is_multiple_of(LOOK_EVERY) && (cell / SIDE).is_multiple_of(LOOK_EVERY) {
                truth.look_around(rovers, cell, reach_m);
            }
        }
        truth.cells = truth.to_see.iter().filter(|to_see| **to_see).count();
        truth
    }

    /// Cells that a robot can stand in, from the start on.
    fn reachable(&self, rovers: &Rovers, radius_m: f64) -> Vec<usize> {
        let start = SIDE / 2 * SIDE + SIDE / 2;
        let mut is_known = vec![false; SIDE * SIDE];
        let (mut cells, mut next) = (vec![start], 0);
        is_known[start] = true;
        while let Some(&cell) = cells.get(next) {
            next += 1;
            for near in [cell - 1, cell + 1, cell - SIDE, cell + SIDE] {
                let (x, y) = (near % SIDE, near / SIDE);
                let is_inside = (1..SIDE - 1).contains(&x) && (1..SIDE - 1).contains(&y);
                if is_inside && !is_known[near] {
                    is_known[near] = true;
                    if rovers.clearance_m(self.middle_m(near), radius_m + CELL_M) >= radius_m {
                        cells.push(near);
                    }
                }
            }
        }
        cells
    }

    fn middle_m(&self, cell: usize) -> [f64; 2] {
        let part = |k: usize, at: usize| self.center_m[k] - EXTENT_M + (at as f64 + 0.5) * CELL_M;
        [part(0, cell % SIDE), part(1, cell / SIDE)]
    }

    fn cell(&self, point_m: [f64; 2]) -> Option<usize> {
        let place = |k: usize| {
            let at = (point_m[k] - self.center_m[k] + EXTENT_M) / CELL_M;
            (at >= 0.0 && at < SIDE as f64).then_some(at as usize)
        };
        Some(place(1)? * SIDE + place(0)?)
    }

    fn look_around(&mut self, rovers: &Rovers, from: usize, reach_m: f64) {
        let from_m = self.middle_m(from);
        let moment = rovers.world().at(0.0, from_m, reach_m);
        for beam in 0..LOOK_BEAMS {
            let (sin, cos) = (TAU * beam as f64 / LOOK_BEAMS as f64).sin_cos();
            let length_m = moment.cast(from_m, [cos, sin]).min(reach_m);
            let Some(mut walk) = self.walk(from_m, [cos, sin], length_m) else { continue };
            while let Some(cell) = walk.next() {
                self.to_see[cell] = true;
            }
        }
    }

    /// Along a beam, but not to the cell of its end; none that leaves the map.
    fn walk(&self, from_m: [f64; 2], [cos, sin]: [f64; 2], length_m: f64) -> Option<Walk> {
        const STEP: f64 = 0.8;
        let left = ((length_m / CELL_M - 1.0) / STEP).max(0.0) as usize + 1;
        let end = [0, 1].map(|k| from_m[k] + length_m * [cos, sin][k]);
        self.cell(end)?;
        self.cell(from_m)?;
        let at = [0, 1].map(|k| (from_m[k] - self.center_m[k] + EXTENT_M) / CELL_M);
        Some(Walk { at, step: [STEP * cos, STEP * sin], left })
    }

    /// Marks what a scan shows that was taken there.
    pub(super) fn see(&mut self, scan: &LaserScan, world_from_robot: Pose2) {
        let from_m = [world_from_robot.x, world_from_robot.y];
        for (beam, &range_m) in scan.ranges_m.iter().enumerate() {
            if range_m.is_nan() {
                continue;
            }
            let bearing_rad = world_from_robot.theta + scan.laser.bearing_in_robot(beam);
            let (sin, cos) = bearing_rad.sin_cos();
            let length_m = f64::from(range_m).min(scan.laser.range_max_m);
            let Some(mut walk) = self.walk(from_m, [cos, sin], length_m) else { continue };
            while let Some(cell) = walk.next() {
                if self.to_see[cell] && !self.seen[cell] {
                    self.seen[cell] = true;
                    self.count += 1;
                }
            }
        }
    }

    /// Share that was seen.
    pub(super) fn share(&self) -> f64 {
        self.count as f64 / self.cells.max(1) as f64
    }

    /// All that is to be seen, square metres.
    pub(super) fn area_m2(&self) -> f64 {
        self.cells as f64 * CELL_M * CELL_M
    }

    /// The same with nothing seen yet.
    pub(super) fn unseen(&self) -> Self {
        Self { seen: vec![false; SIDE * SIDE], count: 0, ..self.clone() }
    }
}
