//! An office floor: rooms around a ring of corridors with one or two corridors across.

use super::without_repeats;
use crate::band::{Band, Room, RoomKind, WALL_M, build_band};
use crate::build::{Builder, Frame};
use crate::furnish::{box_in, corridor_piece};
use crate::math::{Point, add, distance, lerp, scale, sub, unit};
use crate::rng::Rng;
use crate::route::{Route, Site};
use crate::world::World;

/// Area of [`large_office`], square metres.
const LARGE_M2: f64 = 2800.0;

/// A floor of 34 to 45 by 26 to 34 m and a drive of several hundred metres through it: twice around the main ring,
/// through every corridor across, in and out of many rooms, back to where it began.
#[must_use]
pub fn office_floor(seed: u64) -> Site {
    let mut rng = Rng::keyed(seed, 0x6f66_6669_6365);
    let plan = Plan::draw(&mut rng);
    plan.site(rng)
}

/// A floor of 40 by 20 m and a drive through it as that of [`office_floor`]: rooms around a ring of corridors with one across.
#[must_use]
pub fn small_office(seed: u64) -> Site {
    let mut rng = Rng::keyed(seed, 0x736d_616c_6c6f);
    let mut plan = Plan::draw(&mut rng);
    (plan.width_m, plan.height_m) = (40.0, 20.0);
    plan.depth_m = [(); 4].map(|()| rng.uniform(3.6, 4.4));
    let inner_m = plan.width_m - plan.depth_m[1] - plan.depth_m[3] - 2.0 * plan.corridor_m;
    let start_m = plan.depth_m[3] + plan.corridor_m;
    plan.across_x_m = vec![start_m + rng.uniform(0.36, 0.64) * inner_m];
    plan.site(rng)
}

/// The floor of [`office_floor`] for several robots to explore: doors stand as they are, open, or shut for good. Its route is the corridor
/// below, from where a corridor across meets it.
#[must_use]
pub fn office_to_explore(seed: u64) -> Site {
    let mut rng = Rng::keyed(seed, 0x6f66_6669_6365);
    let plan = Plan::draw(&mut rng);
    let world = plan.build_to_explore(&mut rng);
    let ring = plan.ring();
    let route = Route::new(vec![[plan.across_x_m[0], ring[0][1]], ring[1], ring[0]]);
    Site { world, route }
}

/// A floor of 62 to 70 by about 42 m, 2,800 m² in all, for several robots to explore: some ninety rooms around a ring of corridors
/// with three corridors across and one along the middle. Doors stand as they are: open, or shut for good. Its route is the middle
/// corridor, from where a corridor across meets it.
#[must_use]
pub fn large_office(seed: u64) -> Site {
    let mut rng = Rng::keyed(seed, 0x6c61_7267_656f);
    let plan = Plan::draw_large(&mut rng);
    let world = plan.build_to_explore(&mut rng);
    let (ring, y_m) = (plan.ring(), plan.middle_y_m.first().copied().unwrap_or(0.0));
    let meeting_m = plan.across_x_m[rng.below(plan.across_x_m.len())];
    let route = Route::new(vec![[meeting_m, y_m], [ring[1][0], y_m], [ring[0][0], y_m]]);
    Site { world, route }
}

/// The measures of a floor, metres; the origin is its lower left corner.
struct Plan {
    width_m: f64,
    height_m: f64,
    /// Depth of the rooms outside the ring: below, right, above, left.
    depth_m: [f64; 4],
    corridor_m: f64,
    /// Middle lines of the corridors across.
    across_x_m: Vec<f64>,
    /// Middle lines of the corridors along, inside the ring.
    middle_y_m: Vec<f64>,
}

impl Plan {
    fn draw(rng: &mut Rng) -> Self {
        let (width_m, height_m) = (rng.uniform(34.0, 45.0), rng.uniform(26.0, 34.0));
        let depth_m = [(); 4].map(|()| rng.uniform(4.6, 6.2));
        let corridor_m = rng.uniform(1.8, 2.5);
        let inner_m = width_m - depth_m[1] - depth_m[3] - 2.0 * corridor_m;
        let start_m = depth_m[3] + corridor_m;
        let shares = if inner_m > 25.0 && rng.chance(0.6) {
            vec![rng.uniform(0.28, 0.4), rng.uniform(0.62, 0.74)]
        } else {
            vec![rng.uniform(0.36, 0.64)]
        };
        let across_x_m = shares.into_iter().map(|share| start_m + share * inner_m).collect();
        Self { width_m, height_m, depth_m, corridor_m, across_x_m, middle_y_m: Vec::new() }
    }

    fn draw_large(rng: &mut Rng) -> Self {
        let width_m = rng.uniform(62.0, 70.0);
        let height_m = LARGE_M2 / width_m;
        let depth_m = [(); 4].map(|()| rng.uniform(4.6, 6.2));
        let corridor_m = rng.uniform(1.9, 2.4);
        let inner_m = width_m - depth_m[1] - depth_m[3] - 2.0 * corridor_m;
        let start_m = depth_m[3] + corridor_m;
        let across_x_m = [0.25, 0.5, 0.75].map(|share| start_m + (share + rng.uniform(-0.04, 0.04)) * inner_m).to_vec();
        let middle_y_m = vec![0.5 * (height_m + depth_m[0] - depth_m[2]) + rng.uniform(-0.6, 0.6)];
        Self { width_m, height_m, depth_m, corridor_m, across_x_m, middle_y_m }
    }

    /// Rooms, doors and furniture, and a drive through them.
    fn site(&self, mut rng: Rng) -> Site {
        let mut builder = Builder::new();
        self.build_outer_walls(&mut builder, &mut rng);
        let rooms = self.build_rooms(&mut builder, &mut rng);
        let waypoints = Tour { plan: self, rooms: &rooms }.waypoints(&mut rng);
        builder.reserve(&waypoints);
        rooms.iter().for_each(|room| room.furnish(&mut builder, &mut rng));
        self.furnish_corridors(&mut builder, &mut rng);
        Site { world: builder.build(), route: Route::new(waypoints) }
    }

    /// Rooms with clear ways in along clear corridors; doors stand as they are.
    fn build_to_explore(&self, rng: &mut Rng) -> World {
        let mut builder = Builder::new();
        self.build_outer_walls(&mut builder, rng);
        let rooms = self.build_rooms(&mut builder, rng);
        let half_m = 0.5 * self.corridor_m;
        self.corridors().iter().for_each(|ends| builder.reserve(ends));
        rooms.iter().for_each(|room| builder.reserve(&room.way_in(half_m)));
        rooms.iter().for_each(|room| room.furnish(&mut builder, rng));
        self.furnish_corridors(&mut builder, rng);
        builder.build().with_doors_settled()
    }

    /// Corners of the ring's middle line, counter-clockwise from the lower left.
    fn ring(&self) -> [Point; 4] {
        let half_m = 0.5 * self.corridor_m;
        let [below_m, right_m, above_m, left_m] = self.depth_m;
        let (x0, x1) = (left_m + half_m, self.width_m - right_m - half_m);
        let (y0, y1) = (below_m + half_m, self.height_m - above_m - half_m);
        [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]
    }

    /// Outer walls with columns and radiators on the inside.
    fn build_outer_walls(&self, builder: &mut Builder, rng: &mut Rng) {
        let corners = [[0.0, 0.0], [self.width_m, 0.0], [self.width_m, self.height_m], [0.0, self.height_m]];
        let spacing_m = rng.uniform(3.5, 6.5);
        for side in 0..4 {
            let (a, b) = (corners[side], corners[(side + 1) % 4]);
            builder.wall(a, b, 0.3, &[]);
            let along = unit(sub(b, a));
            let wall = Frame { origin: a, u: along, v: [-along[1], along[0]] };
            let mut at_m = spacing_m * rng.uniform(0.3, 0.7);
            while at_m < distance(a, b) - 1.0 {
                let (width_m, depth_m) = (rng.uniform(0.38, 0.42), 0.28);
                builder.solid(box_in(&wall.moved(0.0, 0.16), at_m, 0.5 * depth_m, width_m, depth_m));
                at_m += spacing_m;
            }
        }
    }

    fn build_rooms(&self, builder: &mut Builder, rng: &mut Rng) -> Vec<Room> {
        let mut rooms = Vec::new();
        for band in self.outer_bands() {
            rooms.extend(build_band(builder, &band, rng));
        }
        for block in self.inner_blocks() {
            for band in self.block_bands(block, rng) {
                rooms.extend(build_band(builder, &band, rng));
            }
        }
        rooms
    }

    /// Above and below over the whole width; left and right between them.
    fn outer_bands(&self) -> [Band; 4] {
        let (w, h) = (self.width_m, self.height_m);
        let [below_m, right_m, above_m, left_m] = self.depth_m;
        let half_m = 0.5 * self.corridor_m;
        let whole = |frame, depth_m| Band {
            frame,
            length_m: w,
            depth_m,
            doors_between: [left_m + half_m, w - right_m - half_m],
            end_walls: [false, false],
            back_wall: false,
        };
        let side_m = h - below_m - above_m;
        let between = |frame, depth_m| Band {
            length_m: side_m,
            doors_between: [half_m, side_m - half_m],
            ..whole(frame, depth_m)
        };
        [
            whole(Frame { origin: [0.0, below_m], u: [1.0, 0.0], v: [0.0, -1.0] }, below_m),
            between(Frame { origin: [w - right_m, below_m], u: [0.0, 1.0], v: [1.0, 0.0] }, right_m),
            whole(Frame { origin: [0.0, h - above_m], u: [1.0, 0.0], v: [0.0, 1.0] }, above_m),
            between(Frame { origin: [left_m, below_m], u: [0.0, 1.0], v: [-1.0, 0.0] }, left_m),
        ]
    }

    /// The islands between the corridors: lower left and upper right corners.
    fn inner_blocks(&self) -> Vec<[Point; 2]> {
        let half_m = 0.5 * self.corridor_m;
        let [lower_left, _, upper_right, _] = self.ring();
        let between = |first_m: f64, middles_m: &[f64], last_m: f64| {
            let lows = std::iter::once(first_m).chain(middles_m.iter().copied());
            lows.zip(middles_m.iter().copied().chain([last_m])).collect::<Vec<_>>()
        };
        let columns = between(lower_left[0], &self.across_x_m, upper_right[0]);
        let rows = between(lower_left[1], &self.middle_y_m, upper_right[1]);
        let block = |(left, right): (f64, f64), (low, high): (f64, f64)| {
            [[left + half_m, low + half_m], [right - half_m, high - half_m]]
        };
        rows.iter().flat_map(|&row| columns.iter().map(move |&column| block(column, row))).collect()
    }

    /// Ends of the middle lines of all corridors.
    fn corridors(&self) -> Vec<[Point; 2]> {
        let ring = self.ring();
        let mut corridors: Vec<[Point; 2]> = (0..4).map(|k| [ring[k], ring[(k + 1) % 4]]).collect();
        corridors.extend(self.across_x_m.iter().map(|&x| [[x, ring[0][1]], [x, ring[2][1]]]));
        corridors.extend(self.middle_y_m.iter().map(|&y| [[ring[0][0], y], [ring[1][0], y]]));
        corridors
    }

    /// Two rows of rooms back to back.
    fn block_bands(&self, [low, high]: [Point; 2], rng: &mut Rng) -> [Band; 2] {
        let (length_m, height_m) = (high[0] - low[0], high[1] - low[1]);
        let lower_m = height_m * rng.uniform(0.42, 0.58);
        let row = |origin, v, depth_m, back_wall| Band {
            frame: Frame { origin, u: [1.0, 0.0], v },
            length_m,
            depth_m,
            doors_between: [0.0, length_m],
            end_walls: [true, true],
            back_wall,
        };
        [row(low, [0.0, 1.0], lower_m, true), row([low[0], high[1]], [0.0, -1.0], height_m - lower_m, false)]
    }

    fn furnish_corridors(&self, builder: &mut Builder, rng: &mut Rng) {
        for [a, b] in self.corridors() {
            let pieces = 2 + (distance(a, b) / 6.0) as usize;
            for _ in 0..pieces {
                let side = if rng.chance(0.5) { 1.0 } else { -1.0 };
                let wall = corridor_wall(a, b, side, 0.5 * self.corridor_m - 0.5 * WALL_M);
                let at_m = rng.uniform(1.8, distance(a, b) - 1.8);
                corridor_piece(builder, &wall, at_m, rng);
            }
        }
    }
}

/// The wall on one side of a corridor's middle line, with `v` into the corridor.
fn corridor_wall(a: Point, b: Point, side: f64, half_m: f64) -> Frame {
    let along = unit(sub(b, a));
    let across = scale([-along[1], along[0]], side);
    Frame { origin: add(a, scale(across, half_m)), u: along, v: scale(across, -1.0) }
}

/// The drive through a floor.
struct Tour<'a> {
    plan: &'a Plan,
    rooms: &'a [Room],
}

/// A side trip from the ring, and where it leaves and comes back, metres along the ring.
struct Trip {
    from_m: f64,
    to_m: f64,
    way: Vec<Point>,
}

impl Tour<'_> {
    /// Around the ring with many visits; a figure of eight through each corridor across; the ring the other way with
    /// few visits.
    fn waypoints(&self, rng: &mut Rng) -> Vec<Point> {
        let ring_m = self.ring_m();
        let start_m = 0.3 * self.across_on_ring(0)[0];
        let (many, few) = (self.trips(0.55, rng), self.trips(0.15, rng));
        let mut way = self.along(start_m, start_m + ring_m, &many);
        for across in 0..self.plan.across_x_m.len() {
            let [below_m, above_m] = self.across_on_ring(across);
            way.extend(self.along(start_m, below_m, &[]));
            way.extend(self.along(above_m, ring_m + start_m, &few));
        }
        way.extend(self.along(start_m + ring_m, start_m, &few));
        let [below_m, above_m] = self.across_on_ring(0);
        way.extend(self.along(start_m, above_m, &[]));
        way.extend(self.along(below_m, start_m, &[]));
        without_repeats(way)
    }

    fn ring_m(&self) -> f64 {
        self.corner_m(4)
    }

    /// Where corner number `k` of the ring lies along it.
    fn corner_m(&self, k: usize) -> f64 {
        let ring = self.plan.ring();
        (0..k).map(|k| distance(ring[k % 4], ring[(k + 1) % 4])).sum()
    }

    /// Where a corridor across leaves the ring below and above.
    fn across_on_ring(&self, across: usize) -> [f64; 2] {
        let (ring, x_m) = (self.plan.ring(), self.plan.across_x_m[across]);
        [x_m - ring[0][0], self.corner_m(2) + ring[1][0] - x_m]
    }

    fn point_at(&self, along_m: f64) -> Point {
        let along_m = along_m.rem_euclid(self.ring_m());
        let ring = self.plan.ring();
        let side = (0..3).find(|&k| along_m <= self.corner_m(k + 1)).unwrap_or(3);
        let (a, b) = (ring[side], ring[(side + 1) % 4]);
        lerp(a, b, (along_m - self.corner_m(side)) / distance(a, b))
    }

    /// Where on the ring a point of its middle line lies.
    fn place_on_ring(&self, point: Point) -> f64 {
        let ring = self.plan.ring();
        let side_error = |k: usize| {
            let (a, b) = (ring[k], ring[(k + 1) % 4]);
            distance(a, point) + distance(point, b) - distance(a, b)
        };
        let side = (0..4).min_by(|&a, &b| side_error(a).total_cmp(&side_error(b))).unwrap_or(0);
        self.corner_m(side) + distance(ring[side], point)
    }

    /// Visits to a share of the rooms, in the order of the ring.
    fn trips(&self, share: f64, rng: &mut Rng) -> Vec<Trip> {
        let mut trips = Vec::new();
        let mut k = 0;
        while k < self.rooms.len() {
            let room = &self.rooms[k];
            if room.kind != RoomKind::Private && rng.chance(share) {
                trips.push(self.trip(room, self.rooms.get(k + 1)));
                k += usize::from(room.has_next_door());
            }
            k += 1;
        }
        trips.sort_by(|a, b| a.from_m.total_cmp(&b.from_m));
        trips
    }

    fn trip(&self, room: &Room, next: Option<&Room>) -> Trip {
        let half_m = 0.5 * self.plan.corridor_m;
        let through = next.and_then(|next| room.visit_through(next, half_m));
        let mut way = through.unwrap_or_else(|| room.visit(half_m));
        let ends = [way[0], way[way.len() - 1]].map(|end| self.place_on_ring(end));
        if ends[0] > ends[1] {
            way.reverse();
        }
        Trip { from_m: ends[0].min(ends[1]), to_m: ends[0].max(ends[1]), way }
    }

    /// Along the ring, either way, with the trips that lie between.
    fn along(&self, from_m: f64, to_m: f64, trips: &[Trip]) -> Vec<Point> {
        if from_m > to_m {
            let mut way = self.along(to_m, from_m, trips);
            way.reverse();
            return way;
        }
        let mut stops: Vec<(f64, Vec<Point>)> = Vec::new();
        for lap_m in [0.0, self.ring_m()] {
            let within = |m: f64| from_m <= m && m <= to_m;
            let corners = (0..4).map(|k| self.corner_m(k) + lap_m).filter(|&m| within(m));
            stops.extend(corners.map(|m| (m, vec![self.point_at(m)])));
            let trips = trips.iter().filter(|trip| within(trip.from_m + lap_m) && within(trip.to_m + lap_m));
            stops.extend(trips.map(|trip| (trip.from_m + lap_m, trip.way.clone())));
        }
        stops.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut way = vec![self.point_at(from_m)];
        way.extend(stops.into_iter().flat_map(|(_, stop)| stop));
        way.push(self.point_at(to_m));
        way
    }
}
