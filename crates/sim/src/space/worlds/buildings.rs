//! Buildings with storeys joined by ramps or stairs.

use super::rings::{Level, Rings, STOREY_M, with_visits};
use crate::math::{Point, distance, lerp};
use crate::rng::Rng;
use crate::space::SpaceSite;
use crate::space::build::SpaceBuilder;
use crate::space::plan::{Doorway, Plan};
use crate::space::site::flat;

/// Length of the drive of [`loops_1km`], metres.
const LOOPS_M: f64 = 1000.0;
/// Storeys of [`look_alike_storeys`] that are driven through.
const ALIKE: i32 = 3;

/// A building of two storeys with a corridor around each, rooms with windows, and a ramp or stairs between; the drive leads around
/// the lower storey, up, around the upper one, down, and to where it began: some 240 to 330 m.
#[must_use]
pub fn two_storey(seed: u64) -> SpaceSite {
    let mut building = Building::draw(seed, 0x0074_776f_7374, 1);
    let rings = &building.rings;
    let [c0, c1, c2, c3] = [0, 1, 2, 3].map(|k| rings.corner(0, k));
    let start = lerp(c0, c1, 0.6);
    let [low, high] = [0, 1].map(|end| rings.before_shaft(end));
    let [foot, top] = [0, 1].map(|end| rings.flight(end));
    building.drive(0, &[start, c0, c3, c2, c1, start, c0, low], 0.4);
    building.climb(&[foot, top]);
    building.drive(1, &[high, c1, c0, c3, c2, high], 0.4);
    building.climb(&[top, foot]);
    building.drive(0, &[low, c0, start, lerp(start, c1, 0.5)], 0.0);
    building.finish()
}

/// A building of two storeys, each with three corridors around each other, and a drive of 1 km: the lower storey's loops from the
/// outermost to the innermost, up, and the upper storey's from the innermost to the outermost.
#[must_use]
pub fn loops_1km(seed: u64) -> SpaceSite {
    let mut building = Building::draw(seed, 0x6c6f_6f70_316b, 3);
    let rings = &building.rings;
    let corner = |ring, number| rings.corner(ring, number);
    let around = |ring, from: Point| [from, corner(ring, 0), corner(ring, 3), corner(ring, 2), corner(ring, 1), from];
    let [low, high] = [0, 1].map(|end| rings.before_shaft(end));
    let [foot, top] = [0, 1].map(|end| rings.flight(end));
    let mut inwards: Vec<Point> = around(0, rings.on_spoke(0, 0)).to_vec();
    inwards.extend(around(1, rings.on_spoke(1, 0)));
    inwards.push(rings.on_spoke(1, 1));
    inwards.extend(around(2, rings.on_spoke(2, 1)));
    inwards.extend([corner(2, 0), low]);
    let mut outwards: Vec<Point> =
        [high, corner(2, 1), corner(2, 0), corner(2, 3), corner(2, 2), high, corner(2, 1)].to_vec();
    outwards.push(rings.on_spoke(2, 1));
    outwards.extend(around(1, rings.on_spoke(1, 1)));
    outwards.extend([corner(1, 0), corner(1, 3), corner(1, 2), corner(1, 1)]);
    outwards.push(rings.on_spoke(1, 0));
    outwards.extend(around(0, rings.on_spoke(0, 0)));
    outwards.extend([corner(0, 0), corner(0, 3)]);
    building.drive(0, &inwards, 0.05);
    building.climb(&[foot, top]);
    building.drive(1, &outwards, 0.05);
    building.way = cut(&building.way, LOOPS_M);
    building.finish()
}

/// A building whose storeys cannot be told apart: walls, furniture and stairs are the same on each, there are no windows, and above
/// and below the three that are driven through lies one more. The drive leads around each and up to the next: some 310 to 350 m.
#[must_use]
pub fn look_alike_storeys(seed: u64) -> SpaceSite {
    let mut building = Building::draw(seed, 0x616c_696b_6573, 1);
    building.levels = (-1..=ALIKE)
        .map(|number| Level { number, from_below: true, up: true, windows: false, ..building.levels[0] })
        .collect();
    building.is_alike = true;
    building.raise();
    let rings = &building.rings;
    let [c0, c1, c2, c3] = [0, 1, 2, 3].map(|k| rings.corner(0, k));
    let [low, high] = [0, 1].map(|end| rings.before_shaft(end));
    let [foot, top] = [0, 1].map(|end| rings.flight(end));
    for storey in 0..ALIKE {
        building.drive(storey, &[high, c2, c3, c0, c1, high, c2, c3], 0.0);
        if storey + 1 < ALIKE {
            building.way.push(building.at_height(low, f64::from(storey)));
            building.climb(&[foot, top]);
        }
    }
    building.finish()
}

/// A building and the way through it, as they grow.
struct Building {
    seed: u64,
    rings: Rings,
    levels: Vec<Level>,
    /// Whether all storeys are the same.
    is_alike: bool,
    builder: SpaceBuilder,
    plans: Vec<Plan>,
    doors: Vec<Vec<Doorway>>,
    way: Vec<[f64; 3]>,
    rng: Rng,
}

impl Building {
    /// Two storeys of rings, not raised yet where they are to be changed.
    fn draw(seed: u64, key: u64, rings: usize) -> Self {
        let mut rng = Rng::keyed(seed, key);
        let rings = Rings::draw(rings, &mut rng);
        let is_stairs = rng.chance(0.5);
        let level = |number| Level { number, from_below: number == 1, up: number == 0, is_stairs, windows: true };
        let levels = vec![level(0), level(1)];
        let builder = SpaceBuilder::new(0);
        Self { seed, rings, levels, is_alike: false, builder, plans: vec![], doors: vec![], way: vec![], rng }
    }

    /// The random stream of a storey's walls (0) or furniture (1).
    fn stream(&self, storey: usize, what: u64) -> Rng {
        let storey = if self.is_alike { 0 } else { storey as u64 };
        Rng::keyed(self.seed ^ 0x7374_6f72_6579, 2 * storey + what)
    }

    fn raise(&mut self) {
        self.builder = SpaceBuilder::new(self.levels.len());
        for (number, level) in self.levels.iter().enumerate() {
            let mut rng = self.stream(number, 0);
            let plan = self.rings.plan(&mut rng);
            self.doors.push(self.rings.raise(&plan, level, &mut self.builder, &mut rng));
            self.plans.push(plan);
        }
        let top = self.levels[self.levels.len() - 1];
        self.rings.roof(&mut self.builder, f64::from(top.number + 1) * STOREY_M, top.up);
    }

    fn at_height(&self, [x, y]: Point, storey: f64) -> [f64; 3] {
        [x, y, storey * STOREY_M]
    }

    /// Goes on along corridors of a storey, with visits to a share of the rooms.
    fn drive(&mut self, storey: i32, way: &[Point], visited_share: f64) {
        if self.plans.is_empty() {
            self.raise();
        }
        let number = self.levels.iter().position(|level| level.number == storey).unwrap_or(0);
        let way = with_visits(way, &self.doors[number], visited_share, &mut self.rng);
        let way: Vec<[f64; 3]> = way.into_iter().map(|point| self.at_height(point, f64::from(storey))).collect();
        self.way.extend(way);
    }

    /// Goes on up from a flight's foot to its top, or down from its top to its foot.
    fn climb(&mut self, [from, to]: &[Point; 2]) {
        let here_m = self.way.last().map_or(0.0, |point| point[2]);
        let is_up = *from == self.rings.flight(0);
        let there_m = if is_up { here_m + STOREY_M } else { here_m - STOREY_M };
        self.way.extend([[from[0], from[1], here_m], [to[0], to[1], there_m]]);
    }

    /// Furniture, what stands around, and the way without repeats.
    fn finish(mut self) -> SpaceSite {
        let mut way: Vec<[f64; 3]> = Vec::new();
        for point in std::mem::take(&mut self.way) {
            if way.last().is_none_or(|last| distance(flat(*last), flat(point)) > 0.05) {
                way.push(point);
            }
        }
        self.builder.reserve(&way);
        for door in self.doors.iter().flatten() {
            let ends = [door.front, door.inside].map(|[x, y]| [x, y, 0.0]);
            self.builder.reserve(&ends);
        }
        for number in 0..self.levels.len() {
            let mut rng = self.stream(number, 1);
            let storey = self.levels[number].storey();
            self.rings.furnish(&self.plans[number], number, &storey, &mut self.builder, &mut rng);
        }
        if !self.is_alike {
            self.neighbours();
        }
        self.builder.build(way)
    }

    /// The ground and some buildings, for windows to look at.
    fn neighbours(&mut self) {
        let [low, high] = self.rings.corners_m();
        let wide = [low.map(|v| v - 60.0), high.map(|v| v + 60.0)];
        self.builder.block(wide, [-2.0, -0.2]);
        for side in 0..4 {
            for _ in 0..3 {
                let (along, size) = (self.rng.unit(), [self.rng.uniform(6.0, 20.0), self.rng.uniform(6.0, 20.0)]);
                let away_m = self.rng.uniform(10.0, 25.0);
                let place = |k: usize| low[k] + along * (high[k] - low[k]);
                let corner = match side {
                    0 => [place(0), low[1] - away_m - size[1]],
                    1 => [place(0), high[1] + away_m],
                    2 => [low[0] - away_m - size[0], place(1)],
                    _ => [high[0] + away_m, place(1)],
                };
                let height_m = self.rng.uniform(3.0, 12.0);
                self.builder.block([corner, [corner[0] + size[0], corner[1] + size[1]]], [-0.5, height_m]);
            }
        }
    }
}

/// The first so many metres of a way, seen from above.
fn cut(way: &[[f64; 3]], length_m: f64) -> Vec<[f64; 3]> {
    let mut left_m = length_m;
    let mut kept = vec![way[0]];
    for leg in way.windows(2) {
        let leg_m = distance(flat(leg[0]), flat(leg[1]));
        if leg_m >= left_m {
            let share = left_m / leg_m;
            kept.push(std::array::from_fn(|k| leg[0][k] + share * (leg[1][k] - leg[0][k])));
            break;
        }
        left_m -= leg_m;
        kept.push(leg[1]);
    }
    kept
}
