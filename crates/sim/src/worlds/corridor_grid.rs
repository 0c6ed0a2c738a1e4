//! A building of corridors that look alike, driven along a way of loops within loops.

use super::without_repeats;
use crate::band::WALL_M;
use crate::build::{Builder, Frame};
use crate::furnish::corridor_piece;
use crate::math::{Point, distance, scale, sub, unit};
use crate::rng::Rng;
use crate::route::{Route, Site};

/// A recessed door, metres.
const DOOR_M: f64 = 0.95;

/// Corridors around 3 to 5 by 2 to 4 blocks that come in few sizes, most with nothing but the same doors at the same distance, and a
/// drive of at least `way_m` (kept within 100 to 5000 m) that takes the corridor least driven at every crossing: loops within
/// loops, of 80 m and of several hundred.
#[must_use]
pub fn corridor_grid(seed: u64, way_m: f64) -> Site {
    let mut rng = Rng::keyed(seed, 0x6772_6964_7321);
    let grid = Grid::draw(&mut rng);
    let way = grid.drive(way_m.clamp(100.0, 5000.0), &mut rng);
    let mut builder = Builder::new();
    builder.reserve(&way);
    grid.build(&mut builder, &mut rng);
    Site { world: builder.build(), route: Route::new(way) }
}

/// Middle lines of the corridors.
struct Grid {
    x_m: Vec<f64>,
    y_m: Vec<f64>,
    half_m: f64,
    /// From door to door.
    pitch_m: f64,
}

impl Grid {
    fn draw(rng: &mut Rng) -> Self {
        let half_m = 0.5 * rng.uniform(1.9, 2.6);
        let widths_m = [(); 2].map(|()| rng.uniform(18.0, 45.0));
        let heights_m = [(); 2].map(|()| rng.uniform(12.0, 28.0));
        let (columns, rows) = (3 + rng.below(3), 2 + rng.below(3));
        let lines = |sizes_m: [f64; 2], count: usize, rng: &mut Rng| {
            let mut lines_m = vec![0.0];
            for k in 0..count {
                lines_m.push(lines_m[k] + sizes_m[rng.below(2)] + 2.0 * half_m);
            }
            lines_m
        };
        let (x_m, y_m) = (lines(widths_m, columns, rng), lines(heights_m, rows, rng));
        Self { x_m, y_m, half_m, pitch_m: rng.uniform(3.0, 5.0) }
    }

    fn crossing(&self, [column, row]: [usize; 2]) -> Point {
        [self.x_m[column], self.y_m[row]]
    }

    fn neighbours(&self, [column, row]: [usize; 2]) -> Vec<[usize; 2]> {
        let mut all = Vec::new();
        if column > 0 {
            all.push([column - 1, row]);
        }
        if column + 1 < self.x_m.len() {
            all.push([column + 1, row]);
        }
        if row > 0 {
            all.push([column, row - 1]);
        }
        if row + 1 < self.y_m.len() {
            all.push([column, row + 1]);
        }
        all
    }

    /// On along the corridor least driven, never straight back, until the way is long enough.
    fn drive(&self, way_m: f64, rng: &mut Rng) -> Vec<Point> {
        let mut here = [rng.below(self.x_m.len()), rng.below(self.y_m.len())];
        let (mut before, mut driven, mut left_m) = (here, Vec::new(), way_m);
        let mut way = vec![self.crossing(here)];
        while left_m > 0.0 {
            let ahead: Vec<_> = self.neighbours(here).into_iter().filter(|&next| next != before).collect();
            let times =
                |next: [usize; 2]| driven.iter().filter(|&&leg| leg == [here.min(next), here.max(next)]).count();
            let fewest = ahead.iter().map(|&next| times(next)).min().unwrap_or(0);
            let best: Vec<_> = ahead.into_iter().filter(|&next| times(next) == fewest).collect();
            let next = best[rng.below(best.len())];
            driven.push([here.min(next), here.max(next)]);
            left_m -= distance(self.crossing(here), self.crossing(next));
            (before, here) = (here, next);
            way.push(self.crossing(here));
        }
        without_repeats(way)
    }

    fn build(&self, builder: &mut Builder, rng: &mut Rng) {
        let [left, low] = [self.x_m[0], self.y_m[0]].map(|m| m - self.half_m);
        let [right, high] = [&self.x_m, &self.y_m].map(|lines_m| lines_m[lines_m.len() - 1] + self.half_m);
        self.build_ring(builder, [[left, low], [right, low], [right, high], [left, high]], -1.0, rng);
        for x_m in self.x_m.windows(2) {
            for y_m in self.y_m.windows(2) {
                let [left, low] = [x_m[0], y_m[0]].map(|m| m + self.half_m);
                let [right, high] = [x_m[1], y_m[1]].map(|m| m - self.half_m);
                self.build_ring(builder, [[left, low], [right, low], [right, high], [left, high]], 1.0, rng);
            }
        }
    }

    /// Four walls with their backs to the inside of a ring of corners (1) or to its outside (-1).
    fn build_ring(&self, builder: &mut Builder, corners: [Point; 4], inside: f64, rng: &mut Rng) {
        for k in 0..4 {
            let (a, b) = (corners[k], corners[(k + 1) % 4]);
            let u = unit(sub(b, a));
            let away = scale([-u[1], u[0]], inside);
            let wall = Frame { origin: a, u, v: away };
            if rng.chance(0.2) {
                builder.feature_wall(a, b, away, 5.0, rng);
            } else {
                self.build_doors(builder, &wall, distance(a, b));
            }
            let front = Frame { origin: a, u, v: scale(away, -1.0) }.moved(0.0, 0.5 * WALL_M);
            for _ in 0..(distance(a, b) / 20.0) as usize {
                corridor_piece(builder, &front, rng.uniform(1.5, distance(a, b) - 1.5), rng);
            }
        }
    }

    /// Doors at equal distances, as many as there is space for, around the middle.
    fn build_doors(&self, builder: &mut Builder, wall: &Frame, length_m: f64) {
        let doors = ((length_m - 2.0) / self.pitch_m).max(0.0) as usize;
        let first_m = 0.5 * (length_m - (doors.saturating_sub(1)) as f64 * self.pitch_m - DOOR_M);
        let mut outline = vec![wall.at(0.0, 0.0)];
        for door in 0..doors {
            let from_m = first_m + door as f64 * self.pitch_m;
            let corners = [[from_m, 0.0], [from_m, 0.12], [from_m + DOOR_M, 0.12], [from_m + DOOR_M, 0.0]];
            outline.extend(corners.map(|[u_m, v_m]| wall.at(u_m, v_m)));
        }
        outline.push(wall.at(length_m, 0.0));
        builder.polyline(&outline);
    }
}
