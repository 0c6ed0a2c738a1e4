//! Suites of rooms with doors between them.

use super::without_repeats;
use crate::band::WALL_M;
use crate::build::{Builder, Frame, Gap};
use crate::furnish::{Inside, furnish, furnish_home};
use crate::math::{Point, add, scale};
use crate::rng::Rng;
use crate::route::{Route, Site};

/// A suite of 3 to 4 by 3 to 4 cluttered rooms of random sizes, and a drive through the doors that are known least.
#[must_use]
pub fn rooms(seed: u64) -> Site {
    let mut rng = Rng::keyed(seed, 0x0072_6f6f_6d73);
    let columns_m = edges(3 + rng.below(2), [3.8, 7.5], &mut rng);
    let rows_m = edges(3 + rng.below(2), [3.8, 7.5], &mut rng);
    let suite = Suite::draw(columns_m, rows_m, &mut rng);
    let mut builder = Builder::new();
    suite.build_walls(&mut builder);
    let waypoints = without_repeats(suite.stroll(4 * suite.hubs.len(), &mut rng));
    builder.reserve(&waypoints);
    for room in 0..suite.hubs.len() {
        let inside = suite.inside(room);
        furnish(&mut builder, &inside, &mut rng);
        furnish(&mut builder, &inside, &mut rng);
    }
    Site { world: builder.build(), route: Route::new(waypoints) }
}

/// An apartment of 2 to 3 by 2 to 3 small rooms full of furniture, and a drive through the doors that are known least.
#[must_use]
pub fn home(seed: u64) -> Site {
    let mut rng = Rng::keyed(seed, 0x686f_6d65);
    let (columns, rows) = (2 + rng.below(2), 2 + rng.below(2));
    let columns_m = edges(columns, [2.6, 5.2], &mut rng);
    let rows_m = edges(rows, [2.6, 5.2], &mut rng);
    let suite = Suite::draw(columns_m, rows_m, &mut rng);
    let mut builder = Builder::new();
    suite.build_walls(&mut builder);
    let waypoints = without_repeats(suite.stroll(5 * suite.hubs.len(), &mut rng));
    builder.reserve(&waypoints);
    (0..suite.hubs.len()).for_each(|room| furnish_home(&mut builder, &suite.inside(room), &mut rng));
    Site { world: builder.build(), route: Route::new(waypoints) }
}

/// Three furnished rooms of which each has doors to both others, driven around without end.
#[must_use]
pub fn three_rooms(seed: u64) -> Site {
    let mut rng = Rng::keyed(seed, 0x0074_6872_6565);
    let columns_m = [0.0, rng.uniform(4.5, 6.0), rng.uniform(9.5, 11.5)];
    let rows_m = [0.0, rng.uniform(4.5, 5.5), rng.uniform(9.0, 10.5)];
    let (x, y) = (columns_m[1], rows_m[1]);
    let mut builder = Builder::new();
    let far = [columns_m[2], rows_m[2]];
    // Two rooms below, one above.
    let doors =
        [[x, rng.uniform(1.2, y - 1.2)], [rng.uniform(x + 1.2, far[0] - 1.2), y], [rng.uniform(1.2, x - 1.2), y]];
    let hubs = [[0.5 * x, 0.45 * y], [0.5 * (x + far[0]), 0.45 * y], [0.5 * far[0], 0.5 * (y + far[1])]];
    builder.wall([x, 0.0], [x, y], WALL_M, &[gap(doors[0][1])]);
    builder.wall([0.0, y], [far[0], y], WALL_M, &[gap(doors[1][0]), gap(doors[2][0])]);
    outer_walls(&mut builder, far);
    let mut way = vec![hubs[0]];
    way.extend(through(doors[0], [1.0, 0.0]));
    way.push(hubs[1]);
    way.extend(through(doors[1], [0.0, 1.0]));
    way.push(hubs[2]);
    way.extend(through(doors[2], [0.0, -1.0]));
    builder.reserve(&way);
    builder.reserve(&[way[way.len() - 1], way[0]]);
    let spaces = [([0.0, 0.0], [x, y]), ([x, 0.0], [far[0], y]), ([0.0, y], far)];
    for (low, high) in spaces {
        furnish(&mut builder, &inside_of(low, high), &mut rng);
    }
    Site { world: builder.build(), route: Route { waypoints: way, endless: true } }
}

fn gap(at_m: f64) -> Gap {
    [at_m - 0.5, at_m + 0.5]
}

/// Shortly before and after a door.
fn through(door: Point, direction: Point) -> [Point; 2] {
    [add(door, scale(direction, -0.6)), add(door, scale(direction, 0.6))]
}

fn outer_walls(builder: &mut Builder, far: Point) {
    let corners = [[0.0, 0.0], [far[0], 0.0], far, [0.0, far[1]], [0.0, 0.0]];
    corners.windows(2).for_each(|pair| builder.wall(pair[0], pair[1], WALL_M, &[]));
}

fn inside_of(low: Point, high: Point) -> Inside {
    let half_m = 0.5 * WALL_M;
    let frame = Frame { origin: [low[0] + half_m, low[1] + half_m], u: [1.0, 0.0], v: [0.0, 1.0] };
    Inside { frame, width_m: high[0] - low[0] - WALL_M, depth_m: high[1] - low[1] - WALL_M }
}

/// Rooms in rows and columns.
struct Suite {
    columns_m: Vec<f64>,
    rows_m: Vec<f64>,
    /// Where a visitor crosses each room, row by row.
    hubs: Vec<Point>,
    doors: Vec<Link>,
}

/// A door between two rooms; `direction` leads from the first to the second.
struct Link {
    rooms: [usize; 2],
    at: Point,
    direction: Point,
}

impl Suite {
    /// Rooms between these edges, metres.
    fn draw(columns_m: Vec<f64>, rows_m: Vec<f64>, rng: &mut Rng) -> Self {
        let mut suite = Self { columns_m, rows_m, hubs: vec![], doors: vec![] };
        suite.hubs = (0..suite.columns() * suite.rows()).map(|room| suite.hub(room, rng)).collect();
        suite.doors = suite.all_doors(rng);
        suite.wall_up_some(rng);
        suite
    }

    fn columns(&self) -> usize {
        self.columns_m.len() - 1
    }

    fn rows(&self) -> usize {
        self.rows_m.len() - 1
    }

    /// Lower left and upper right corner of a room.
    fn corners(&self, room: usize) -> [Point; 2] {
        let (column, row) = (room % self.columns(), room / self.columns());
        [[self.columns_m[column], self.rows_m[row]], [self.columns_m[column + 1], self.rows_m[row + 1]]]
    }

    fn hub(&self, room: usize, rng: &mut Rng) -> Point {
        let [low, high] = self.corners(room);
        [0, 1].map(|axis| low[axis] + rng.uniform(0.35, 0.65) * (high[axis] - low[axis]))
    }

    fn inside(&self, room: usize) -> Inside {
        let [low, high] = self.corners(room);
        inside_of(low, high)
    }

    fn all_doors(&self, rng: &mut Rng) -> Vec<Link> {
        let mut doors = Vec::new();
        for room in 0..self.hubs.len() {
            let [low, high] = self.corners(room);
            if room % self.columns() + 1 < self.columns() {
                let at = [high[0], rng.uniform(low[1] + 0.9, high[1] - 0.9)];
                doors.push(Link { rooms: [room, room + 1], at, direction: [1.0, 0.0] });
            }
            if room / self.columns() + 1 < self.rows() {
                let at = [rng.uniform(low[0] + 0.9, high[0] - 0.9), high[1]];
                doors.push(Link { rooms: [room, room + self.columns()], at, direction: [0.0, 1.0] });
            }
        }
        doors
    }

    /// Removes a third of the doors, as long as every room can still be reached.
    fn wall_up_some(&mut self, rng: &mut Rng) {
        for _ in 0..self.doors.len() / 3 {
            let chosen = rng.below(self.doors.len());
            let door = self.doors.remove(chosen);
            if !self.all_reachable() {
                self.doors.insert(chosen, door);
            }
        }
    }

    fn all_reachable(&self) -> bool {
        let mut reached = vec![false; self.hubs.len()];
        reached[0] = true;
        for _ in 0..self.hubs.len() {
            for door in &self.doors {
                let [a, b] = door.rooms;
                (reached[a], reached[b]) = (reached[a] || reached[b], reached[a] || reached[b]);
            }
        }
        reached.into_iter().all(|room| room)
    }

    fn build_walls(&self, builder: &mut Builder) {
        let far = [self.columns_m[self.columns()], self.rows_m[self.rows()]];
        outer_walls(builder, far);
        for &x in &self.columns_m[1..self.columns()] {
            let doors = self.doors.iter().filter(|door| door.direction[0] > 0.0 && door.at[0] == x);
            let gaps: Vec<Gap> = doors.map(|door| gap(door.at[1])).collect();
            builder.wall([x, 0.0], [x, far[1]], WALL_M, &gaps);
        }
        for &y in &self.rows_m[1..self.rows()] {
            let doors = self.doors.iter().filter(|door| door.direction[1] > 0.0 && door.at[1] == y);
            let gaps: Vec<Gap> = doors.map(|door| gap(door.at[0])).collect();
            builder.wall([0.0, y], [far[0], y], WALL_M, &gaps);
        }
    }

    /// Through so many doors, each time the one used least so far.
    fn stroll(&self, steps: usize, rng: &mut Rng) -> Vec<Point> {
        let mut used = vec![0.0; self.doors.len()];
        let (mut room, mut way) = (0, vec![self.hubs[0]]);
        for _ in 0..steps {
            let here = (0..self.doors.len()).filter(|&d| self.doors[d].rooms.contains(&room));
            let weighed: Vec<(f64, usize)> = here.map(|d| (used[d] + 0.9 * rng.unit(), d)).collect();
            let Some(&(_, d)) = weighed.iter().min_by(|a, b| a.0.total_cmp(&b.0)) else {
                break;
            };
            used[d] += 1.0;
            let door = &self.doors[d];
            let forth = door.rooms[0] == room;
            way.extend(through(door.at, scale(door.direction, if forth { 1.0 } else { -1.0 })));
            room = door.rooms[usize::from(forth)];
            way.push(self.hubs[room]);
        }
        way
    }
}

/// Edges of so many columns or rows, so far apart, metres.
fn edges(count: usize, [least_m, most_m]: [f64; 2], rng: &mut Rng) -> Vec<f64> {
    let mut edges = vec![0.0];
    for k in 0..count {
        edges.push(edges[k] + rng.uniform(least_m, most_m));
    }
    edges
}
