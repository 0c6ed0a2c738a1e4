//! A floor whose corridor leads around and home.

use super::without_repeats;
use crate::band::{Band, Room, RoomKind, WALL_M, build_band};
use crate::build::{Builder, Footprint, Frame};
use crate::furnish::{box_in, corridor_piece};
use crate::math::{Point, add, cross, distance, dot, lerp, rotate, scale, sub, unit};
use crate::rng::Rng;
use crate::route::{Route, Site};

/// Share of a long drive that the corridor takes; visits to rooms take the rest.
const CORRIDOR_SHARE: f64 = 0.88;
/// Below this length there is no room for visits, metres.
const VISITS_FROM_M: f64 = 160.0;
/// Niches and doors ajar reach this far behind a wall, metres.
const FEATURES_M: f64 = 2.5;

/// A floor of corridors and rooms around a loop of no particular shape, and a drive of `length_m` (kept within 50 to
/// 2000 m) around it with visits to rooms, until it is back where it began, and then 12 to 20 m further on known ground.
///
/// Corners have any angle; walls have rooms, niches and pillars; some doors open and shut. The drive has the chosen
/// length to within 5 %, measured to where it is back.
#[must_use]
pub fn loop_of(seed: u64, length_m: f64) -> Site {
    let mut rng = Rng::keyed(seed, 0x6c6f_6f70_6f66);
    let length_m = length_m.clamp(50.0, 2000.0);
    let mut builder = Builder::new();
    let ring = Ring::draw(length_m, &mut rng);
    let rooms = ring.build(&mut builder, &mut rng);
    let way = ring.drive(length_m, &rooms, &mut rng);
    builder.reserve(&way);
    rooms.iter().for_each(|(_, room)| room.furnish(&mut builder, &mut rng));
    ring.furnish(&mut builder, &mut rng);
    Site { world: builder.build(), route: Route::new(way) }
}

/// Outlines before they are bent, counter-clockwise, about one across.
fn outline(length_m: f64, rng: &mut Rng) -> Vec<Point> {
    let kinds = if length_m < 100.0 { 2 } else { 5 };
    match rng.below(kinds) {
        0 => vec![[0.0, 0.0], [1.0, 0.0], [1.0, 0.7], [0.0, 0.7]],
        1 => vec![[0.2, 0.0], [0.85, 0.0], [1.0, 0.4], [0.8, 0.8], [0.1, 0.8], [0.0, 0.35]],
        2 => vec![[0.0, 0.0], [1.0, 0.0], [1.0, 0.45], [0.5, 0.45], [0.5, 0.9], [0.0, 0.9]],
        3 => vec![[0.0, 0.0], [1.2, 0.0], [1.2, 0.8], [0.85, 0.8], [0.85, 0.35], [0.4, 0.35], [0.4, 0.7], [0.0, 0.7]],
        _ => {
            let round = (0..7).map(|k| rotate([0.35, 0.0], -1.5 + 0.5 * f64::from(k)));
            [[0.0, 0.35], [0.0, -0.35]].into_iter().chain(round.map(|p| add(p, [0.6, 0.0]))).collect()
        }
    }
}

/// The corridor's middle line, closed and counter-clockwise.
struct Ring {
    corners: Vec<Point>,
    half_m: f64,
}

/// One side of the ring.
#[derive(Clone, Copy)]
struct Side {
    from: Point,
    to: Point,
    along: Point,
}

impl Ring {
    fn draw(length_m: f64, rng: &mut Rng) -> Self {
        let half_m = 0.5 * rng.uniform(1.9, 2.6);
        // Bent, sheared, turned and perhaps mirrored.
        let shear = rng.uniform(-0.15, 0.15);
        let (turn_rad, flip) = (rng.uniform(0.0, std::f64::consts::TAU), rng.chance(0.5));
        let jitter = |p: Point, rng: &mut Rng| add(p, [rng.uniform(-0.045, 0.045), rng.uniform(-0.045, 0.045)]);
        let bend = |p: Point| rotate([p[0] + shear * p[1], p[1]], turn_rad);
        let outline = outline(length_m, rng);
        let mut corners: Vec<Point> = outline.into_iter().map(|p| bend(jitter(p, rng))).collect();
        if flip {
            corners = corners.into_iter().rev().map(|[x, y]| [-x, y]).collect();
        }
        let around = |corners: &[Point]| -> f64 {
            (0..corners.len()).map(|k| distance(corners[k], corners[(k + 1) % corners.len()])).sum()
        };
        let wanted_m = if length_m < VISITS_FROM_M { length_m } else { CORRIDOR_SHARE * length_m };
        let factor = wanted_m / around(&corners);
        Self { corners: corners.into_iter().map(|p| scale(p, factor)).collect(), half_m }
    }

    fn side(&self, k: usize) -> Side {
        let count = self.corners.len();
        let (from, to) = (self.corners[k % count], self.corners[(k + 1) % count]);
        Side { from, to, along: unit(sub(to, from)) }
    }

    fn sides(&self) -> impl Iterator<Item = Side> {
        (0..self.corners.len()).map(|k| self.side(k))
    }

    /// Where the wall at `offset_m` to the left of the middle line turns the corner at the end of side `k`.
    fn mitre(&self, k: usize, offset_m: f64) -> Point {
        let (here, next) = (self.side(k), self.side(k + 1));
        let half_tan = cross(here.along, next.along) / (1.0 + dot(here.along, next.along));
        let left = [-here.along[1], here.along[0]];
        add(here.to, add(scale(left, offset_m), scale(here.along, -offset_m * half_tan)))
    }

    /// The rooms, each with where its door lies along the ring.
    fn build(&self, builder: &mut Builder, rng: &mut Rng) -> Vec<(f64, Room)> {
        let mut taken: Vec<Footprint> = self.sides().map(|side| self.corridor(side)).collect();
        let mut rooms = Vec::new();
        for k in 0..self.corners.len() {
            for offset_m in [self.half_m, -self.half_m] {
                let before = (k + self.corners.len() - 1) % self.corners.len();
                let ends = [self.mitre(before, offset_m), self.mitre(k, offset_m)];
                rooms.extend(self.build_wall(builder, ends, offset_m.signum(), &mut taken, rng));
            }
        }
        let mut placed: Vec<(f64, Room)> = rooms.into_iter().map(|room| (self.place(&room), room)).collect();
        placed.sort_by(|a, b| a.0.total_cmp(&b.0));
        placed
    }

    fn corridor(&self, Side { from, to, along }: Side) -> Footprint {
        let depth_m = 2.0 * self.half_m - 0.05;
        Footprint { center: lerp(from, to, 0.5), along, length_m: distance(from, to) - 0.05, depth_m }
    }

    /// One wall of one side in stretches: rooms, niches or nothing, as there is space behind it.
    fn build_wall(
        &self,
        builder: &mut Builder,
        [a, b]: [Point; 2],
        left: f64,
        taken: &mut Vec<Footprint>,
        rng: &mut Rng,
    ) -> Vec<Room> {
        let (length_m, u) = (distance(a, b), unit(sub(b, a)));
        let wall = Frame { origin: a, u, v: scale([-u[1], u[0]], left) };
        let mut rooms = Vec::new();
        let mut at_m = 0.0;
        while at_m < length_m - 1e-9 {
            let short = at_m == 0.0 || rng.chance(0.3);
            let wanted_m = if short { rng.uniform(1.5, 5.0) } else { rng.uniform(8.0, 32.0) };
            let end_m = if at_m + wanted_m > length_m - 2.5 { length_m } else { at_m + wanted_m };
            rooms.extend(stretch(builder, &wall.moved(at_m, 0.0), end_m - at_m, taken, rng));
            at_m = end_m;
        }
        rooms
    }

    fn place(&self, room: &Room) -> f64 {
        let door = room.doorstep(self.half_m);
        let error_m = |side: &Side| distance(side.from, door) + distance(door, side.to) - distance(side.from, side.to);
        let mut before_m = 0.0;
        let mut best = (f64::INFINITY, 0.0);
        for side in self.sides() {
            if error_m(&side) < best.0 {
                best = (error_m(&side), before_m + distance(side.from, door));
            }
            before_m += distance(side.from, side.to);
        }
        best.1
    }

    /// Corners with where they lie along the ring.
    fn stations(&self) -> Vec<(f64, Vec<Point>)> {
        let mut at_m = 0.0;
        let mut stations = Vec::new();
        for side in self.sides() {
            stations.push((at_m, vec![side.from]));
            at_m += distance(side.from, side.to);
        }
        stations
    }

    fn length_m(&self) -> f64 {
        self.sides().map(|side| distance(side.from, side.to)).sum()
    }

    fn point_at(&self, along_m: f64) -> Point {
        let mut left_m = along_m.rem_euclid(self.length_m());
        for side in self.sides() {
            let side_m = distance(side.from, side.to);
            if left_m <= side_m {
                return lerp(side.from, side.to, left_m / side_m);
            }
            left_m -= side_m;
        }
        self.corners[0]
    }

    /// From the middle of the longest side around, with visits until the length is reached, and on.
    fn drive(&self, length_m: f64, rooms: &[(f64, Room)], rng: &mut Rng) -> Vec<Point> {
        let around_m = self.length_m();
        let start_m = self.start_m();
        let after = |at_m: f64| (at_m - start_m).rem_euclid(around_m);
        let mut stops = self.stations();
        stops.extend(self.visits(length_m - around_m, rooms, rng));
        let mut stops: Vec<(f64, Vec<Point>)> = stops.into_iter().map(|(m, way)| (after(m), way)).collect();
        stops.sort_by(|a, b| a.0.total_cmp(&b.0));
        let on_m = rng.uniform(12.0, 20.0);
        let known = stops.iter().filter(|stop| stop.0 < on_m && stop.1.len() == 1).cloned();
        let known: Vec<Point> = known.flat_map(|stop| stop.1).collect();
        let mut way = vec![self.point_at(start_m)];
        way.extend(stops.into_iter().flat_map(|stop| stop.1));
        way.push(self.point_at(start_m));
        way.extend(known);
        way.push(self.point_at(start_m + on_m));
        without_repeats(way)
    }

    fn start_m(&self) -> f64 {
        let mut at_m = 0.0;
        let mut best = (0.0, 0.0);
        for side in self.sides() {
            let side_m = distance(side.from, side.to);
            if side_m > best.0 {
                best = (side_m, at_m + 0.35 * side_m);
            }
            at_m += side_m;
        }
        best.1
    }

    /// Visits to rooms anywhere, `budget_m` long together.
    fn visits(&self, budget_m: f64, rooms: &[(f64, Room)], rng: &mut Rng) -> Vec<(f64, Vec<Point>)> {
        let mut open: Vec<&(f64, Room)> = rooms.iter().filter(|(_, room)| room.kind != RoomKind::Private).collect();
        let (mut left_m, mut visits) = (budget_m, Vec::new());
        while !open.is_empty() && left_m > 4.0 {
            let (at_m, room) = open.swap_remove(rng.below(open.len()));
            let way = room.visit(self.half_m);
            let way_m: f64 = way.windows(2).map(|leg| distance(leg[0], leg[1])).sum();
            if way_m <= left_m + 4.0 {
                left_m -= way_m;
                visits.push((*at_m, way));
            }
        }
        visits
    }

    fn furnish(&self, builder: &mut Builder, rng: &mut Rng) {
        for side in self.sides() {
            let side_m = distance(side.from, side.to);
            for _ in 0..1 + (side_m / 7.0) as usize {
                let left = if rng.chance(0.5) { 1.0 } else { -1.0 };
                let across = scale([-side.along[1], side.along[0]], left);
                let origin = add(side.from, scale(across, self.half_m - 0.5 * WALL_M));
                let wall = Frame { origin, u: side.along, v: scale(across, -1.0) };
                let low_m = (self.half_m + 0.8).min(0.4 * side_m);
                corridor_piece(builder, &wall, rng.uniform(low_m, side_m - low_m), rng);
            }
        }
    }
}

/// A stretch of wall, `frame` with `v` away from the corridor, with the best that there is space for.
fn stretch(
    builder: &mut Builder,
    frame: &Frame,
    length_m: f64,
    taken: &mut Vec<Footprint>,
    rng: &mut Rng,
) -> Vec<Room> {
    let mut claim = |depth_m: f64| {
        let place = box_in(frame, 0.5 * length_m, 0.5 * depth_m + 0.05, length_m - 0.02, depth_m);
        let free = !taken.iter().any(|other| other.overlaps(&place));
        if free {
            taken.push(place);
        }
        free
    };
    let depth_m = rng.uniform(4.2, 6.4);
    if length_m > 7.0 && rng.chance(0.75) && claim(depth_m + 0.3) {
        let (doors_between, end_walls) = ([0.0, length_m], [true, true]);
        let band = Band { frame: *frame, length_m, depth_m, doors_between, end_walls, back_wall: true };
        return build_band(builder, &band, rng);
    }
    let (a, b) = (frame.at(0.0, 0.0), frame.at(length_m, 0.0));
    if length_m > 4.0 && claim(FEATURES_M) {
        builder.feature_wall(a, b, frame.v, 3.5, rng);
    } else {
        builder.segment(a, b);
    }
    Vec::new()
}
