//! Buildings of corridors in rings around each other, rooms between, and a shaft with ramps or stairs in the middle.

use crate::math::{Point, distance, lerp};
use crate::rng::Rng;
use crate::space::build::SpaceBuilder;
use crate::space::furnish::{furnish_corridor, furnish_room};
use crate::space::plan::{CELL_M, Doorway, Plan, Rect, Region, Storey};

/// Width of corridors and of the shaft, squares.
const CORRIDOR: usize = 5;
/// Length of a flight seen from above, squares: 3.2 m up in 13 m is 14 degrees.
const FLIGHT: usize = 26;
/// From floor to floor, metres.
pub(crate) const STOREY_M: f64 = 3.2;

/// A building's measures, the same on every storey, in squares.
#[derive(Debug, Clone)]
pub(crate) struct Rings {
    size: [usize; 2],
    /// Corridors' outer edges from the outermost ring to the innermost.
    rings: Vec<Rect>,
    /// From the shaft's ends to where its flight begins and ends, squares.
    landings: [usize; 2],
    shaft: Rect,
    /// Where a corridor joins each ring with the next, at the bottom: its low edge along x, squares.
    spokes: Vec<usize>,
}

impl Rings {
    pub(crate) fn draw(rings: usize, rng: &mut Rng) -> Self {
        let band = 9 + rng.below(4);
        let gap = 17 + rng.below(3);
        let landings = [2 + rng.below(3), 2 + rng.below(3)];
        let below = 8 + rng.below(4);
        let core = [FLIGHT + landings[0] + landings[1], below + CORRIDOR + 8 + rng.below(4)];
        let around = 2 * (band + rings * CORRIDOR + (rings - 1) * gap);
        let size = core.map(|v| v + around);
        let whole = Rect::new([0, 0], size);
        let rects: Vec<Rect> = (0..rings).map(|k| whole.inset(band + k * (CORRIDOR + gap))).collect();
        let inner = rects[rings - 1].inset(CORRIDOR);
        let shaft_low = inner.low[1] + below;
        let shaft = Rect::new([inner.low[0], shaft_low], [inner.high[0], shaft_low + CORRIDOR]);
        // each a little farther to the left than the one before, over the innermost ring
        let spokes = (1..rings).map(|k| inner.high[0] - 8 * k - rng.below(3)).collect();
        Self { size, rings: rects, landings, shaft, spokes }
    }

    /// A storey's plan; rooms as the random stream has it.
    pub(crate) fn plan(&self, rng: &mut Rng) -> Plan {
        let mut plan = Plan::new(self.size);
        let whole = Rect::new([0, 0], self.size);
        self.fill_between(&mut plan, whole, self.rings[0], None, rng);
        for (k, ring) in self.rings.iter().enumerate() {
            plan.paint(*ring, Region::Corridor);
            let inner = ring.inset(CORRIDOR);
            plan.paint(inner, Region::Outside);
            match self.rings.get(k + 1) {
                Some(next) => self.fill_between(&mut plan, inner, *next, Some(self.spokes[k]), rng),
                None => self.fill_core(&mut plan, inner, rng),
            }
        }
        for rect in self.spoke_rects() {
            plan.paint(rect, Region::Corridor);
        }
        plan
    }

    fn spoke_rects(&self) -> impl Iterator<Item = Rect> {
        let low = |k: usize| self.rings[k].low[1] + CORRIDOR;
        let rect = move |(k, x): (usize, &usize)| Rect::new([*x, low(k)], [x + CORRIDOR, self.rings[k + 1].low[1]]);
        self.spokes.iter().enumerate().map(rect)
    }

    /// Rooms between a ring and what is around it.
    fn fill_between(&self, plan: &mut Plan, outer: Rect, inner: Rect, spoke: Option<usize>, rng: &mut Rng) {
        let ([x0, y0], [x1, y1]) = (outer.low, outer.high);
        let ([u0, v0], [u1, v1]) = (inner.low, inner.high);
        match spoke {
            Some(x) => {
                plan.fill(Rect::new([u0, y0], [x, v0]), rng);
                plan.fill(Rect::new([x + CORRIDOR, y0], [u1, v0]), rng);
            }
            None => plan.fill(Rect::new([u0, y0], [u1, v0]), rng),
        }
        plan.fill(Rect::new([u0, v1], [u1, y1]), rng);
        plan.fill(Rect::new([x0, y0], [u0, y1]), rng);
        plan.fill(Rect::new([u1, y0], [x1, y1]), rng);
    }

    fn fill_core(&self, plan: &mut Plan, inner: Rect, rng: &mut Rng) {
        plan.paint(self.shaft, Region::Shaft);
        plan.fill(Rect::new(inner.low, [inner.high[0], self.shaft.low[1]]), rng);
        plan.fill(Rect::new([inner.low[0], self.shaft.high[1]], inner.high), rng);
    }

    /// Floor, walls, doors of a storey, and the flight up to the next.
    pub(crate) fn raise(&self, plan: &Plan, level: &Level, builder: &mut SpaceBuilder, rng: &mut Rng) -> Vec<Doorway> {
        let whole = Rect::new([0, 0], self.size).corners_m();
        let storey = level.storey();
        builder.slab(whole, level.from_below.then(|| self.hole()), storey.floor_m);
        let doorways = plan.raise(&storey, builder, rng);
        if level.up {
            let [[x0, y0], [x1, y1]] = self.hole();
            let (from, to) = ([x0, 0.5 * (y0 + y1), storey.floor_m], [x1, 0.5 * (y0 + y1), storey.floor_m + STOREY_M]);
            builder.flight(from, to, y1 - y0, level.is_stairs);
        }
        doorways
    }

    /// The roof above so many storeys.
    pub(crate) fn roof(&self, builder: &mut SpaceBuilder, height_m: f64, hole: bool) {
        builder.slab(Rect::new([0, 0], self.size).corners_m(), hole.then(|| self.hole()), height_m);
    }

    /// What is left open for the flight that comes up from below.
    fn hole(&self) -> [Point; 2] {
        let [mut low, mut high] = self.shaft.corners_m();
        low[0] += self.landings[0] as f64 * CELL_M;
        high[0] -= self.landings[1] as f64 * CELL_M;
        [low, high]
    }

    /// Furnishes a storey, once ways and doors are reserved.
    pub(crate) fn furnish(
        &self,
        plan: &Plan,
        number: usize,
        storey: &Storey,
        builder: &mut SpaceBuilder,
        rng: &mut Rng,
    ) {
        plan.rooms().iter().for_each(|room| furnish_room(builder, number, storey, *room, rng));
        for ring in &self.rings {
            let ([x0, y0], [x1, y1]) = (ring.low, ring.high);
            let sides = [
                Rect::new([x0, y0], [x1, y0 + CORRIDOR]),
                Rect::new([x0, y1 - CORRIDOR], [x1, y1]),
                Rect::new([x0, y0 + CORRIDOR], [x0 + CORRIDOR, y1 - CORRIDOR]),
                Rect::new([x1 - CORRIDOR, y0 + CORRIDOR], [x1, y1 - CORRIDOR]),
            ];
            sides.into_iter().for_each(|side| furnish_corridor(builder, number, storey, side, rng));
        }
        self.spoke_rects().for_each(|spoke| furnish_corridor(builder, number, storey, spoke, rng));
    }

    /// Corners of a ring's middle line: low and high.
    fn middle(&self, ring: usize) -> [Point; 2] {
        let [low, high] = self.rings[ring].corners_m();
        let half_m = 0.5 * CORRIDOR as f64 * CELL_M;
        [low.map(|v| v + half_m), high.map(|v| v - half_m)]
    }

    /// A corner of a ring, counter-clockwise from the one at the bottom left.
    pub(crate) fn corner(&self, ring: usize, number: usize) -> Point {
        let [low, high] = self.middle(ring);
        [low, [high[0], low[1]], high, [low[0], high[1]]][number]
    }

    /// On a ring's bottom, where a spoke ends.
    pub(crate) fn on_spoke(&self, ring: usize, spoke: usize) -> Point {
        [(self.spokes[spoke] as f64 + 0.5 * CORRIDOR as f64) * CELL_M, self.middle(ring)[0][1]]
    }

    /// On the innermost ring, before the shaft's low end (0) or its high end (1).
    pub(crate) fn before_shaft(&self, end: usize) -> Point {
        let [low, high] = self.shaft.corners_m();
        [self.middle(self.rings.len() - 1)[end][0], 0.5 * (low[1] + high[1])]
    }

    /// Where the flight begins (0) and ends (1).
    pub(crate) fn flight(&self, end: usize) -> Point {
        [self.hole()[end][0], self.before_shaft(end)[1]]
    }

    pub(crate) fn corners_m(&self) -> [Point; 2] {
        Rect::new([0, 0], self.size).corners_m()
    }
}

/// A storey's place in its building.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Level {
    /// Height of its floor in storeys; below zero underground.
    pub(crate) number: i32,
    /// Whether a flight comes up from below, and one leads up.
    pub(crate) from_below: bool,
    pub(crate) up: bool,
    /// Whether that one is of stairs.
    pub(crate) is_stairs: bool,
    pub(crate) windows: bool,
}

impl Level {
    pub(crate) fn storey(&self) -> Storey {
        Storey {
            floor_m: f64::from(self.number) * STOREY_M,
            height_m: STOREY_M,
            corridor_m: CORRIDOR as f64 * CELL_M,
            shaft_open: [self.up, self.from_below],
            windows: self.windows,
        }
    }
}

/// A way with visits to some of the rooms whose doors it passes, each once.
pub(crate) fn with_visits(way: &[Point], doors: &[Doorway], share: f64, rng: &mut Rng) -> Vec<Point> {
    let mut left: Vec<Doorway> = doors.iter().filter(|_| rng.chance(share)).copied().collect();
    let mut visited = vec![way[0]];
    for leg in way.windows(2) {
        let length_m = distance(leg[0], leg[1]);
        let along_m = |door: &Doorway| {
            let at_m = distance(leg[0], door.front);
            let off_m = distance(lerp(leg[0], leg[1], at_m / length_m), door.front);
            (off_m < 0.01 && (0.8..length_m - 0.8).contains(&at_m)).then_some(at_m)
        };
        let mut passed: Vec<(f64, Doorway)> = left.iter().filter_map(|door| Some((along_m(door)?, *door))).collect();
        passed.sort_by(|a, b| a.0.total_cmp(&b.0));
        left.retain(|door| along_m(door).is_none());
        for (_, door) in passed {
            visited.extend([door.front, door.inside, door.front]);
        }
        visited.push(leg[1]);
    }
    visited
}
