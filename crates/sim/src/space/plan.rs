//! Plans of storeys: regions painted on squares, and the walls that follow from where they meet.

use super::build::{Opening, SpaceBuilder, Wall};
use crate::math::Point;
use crate::rng::Rng;

/// Edge of a square, metres.
pub(crate) const CELL_M: f64 = 0.5;
/// A door's width and height, metres.
const DOOR_M: [f64; 2] = [1.2, 2.1];
/// A robot that visits a room goes so far beyond its door, metres.
const VISIT_M: f64 = 1.7;

/// Squares from `low` to below `high`, by x and y.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Rect {
    pub(crate) low: [usize; 2],
    pub(crate) high: [usize; 2],
}

impl Rect {
    pub(crate) fn new(low: [usize; 2], high: [usize; 2]) -> Self {
        Self { low, high }
    }

    /// The same without so many squares at each side.
    pub(crate) fn inset(self, cells: usize) -> Self {
        Self { low: self.low.map(|v| v + cells), high: self.high.map(|v| v - cells) }
    }

    pub(crate) fn size(self, axis: usize) -> usize {
        self.high[axis] - self.low[axis]
    }

    /// The two parts on both sides of a line across an axis.
    fn cut(self, axis: usize, at: usize) -> [Self; 2] {
        let (mut below, mut above) = (self, self);
        (below.high[axis], above.low[axis]) = (at, at);
        [below, above]
    }

    /// Its corners in metres.
    pub(crate) fn corners_m(self) -> [Point; 2] {
        [self.low, self.high].map(|corner| corner.map(|v| v as f64 * CELL_M))
    }
}

/// What a square belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Region {
    Outside,
    Corridor,
    /// Where ramps and stairs are.
    Shaft,
    /// A room by its number.
    Room(usize),
}

/// A storey's plan.
#[derive(Debug, Clone)]
pub(crate) struct Plan {
    size: [usize; 2],
    regions: Vec<Region>,
    rooms: Vec<Rect>,
}

/// A straight line along which two regions meet.
#[derive(Debug, Clone, Copy)]
struct Border {
    /// The axis along it.
    along: usize,
    /// Where it lies on the other axis, metres.
    across_m: f64,
    /// From here to there along it, metres.
    span_m: [f64; 2],
    /// What lies below and above it on the other axis.
    sides: [Region; 2],
}

/// An open door and how to drive through it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Doorway {
    /// In the middle of the corridor before it.
    pub(crate) front: Point,
    /// In the room.
    pub(crate) inside: Point,
}

/// How a storey is built.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Storey {
    /// Its floor's height, metres.
    pub(crate) floor_m: f64,
    /// From floor to floor, metres.
    pub(crate) height_m: f64,
    /// Width of its corridors, metres.
    pub(crate) corridor_m: f64,
    /// Whether the shaft has openings at its low and its high end of x.
    pub(crate) shaft_open: [bool; 2],
    /// Whether rooms have windows.
    pub(crate) windows: bool,
}

impl Plan {
    pub(crate) fn new(size: [usize; 2]) -> Self {
        Self { size, regions: vec![Region::Outside; size[0] * size[1]], rooms: Vec::new() }
    }

    pub(crate) fn paint(&mut self, rect: Rect, region: Region) {
        for y in rect.low[1]..rect.high[1] {
            self.regions[y * self.size[0] + rect.low[0]..y * self.size[0] + rect.high[0]].fill(region);
        }
    }

    pub(crate) fn rooms(&self) -> &[Rect] {
        &self.rooms
    }

    /// Fills a block with rooms along its longer side, in two rows where it is deep.
    pub(crate) fn fill(&mut self, block: Rect, rng: &mut Rng) {
        let along = usize::from(block.size(1) > block.size(0));
        let deep = block.size(1 - along);
        if deep >= 14 {
            let row = block.low[1 - along] + deep / 2;
            return block.cut(1 - along, row).into_iter().for_each(|row| self.fill_row(row, along, rng));
        }
        self.fill_row(block, along, rng);
    }

    fn fill_row(&mut self, mut row: Rect, along: usize, rng: &mut Rng) {
        loop {
            let cells = 7 + rng.below(8);
            let [room, rest] =
                if row.size(along) < cells + 7 { [row; 2] } else { row.cut(along, row.low[along] + cells) };
            self.paint(room, Region::Room(self.rooms.len()));
            self.rooms.push(room);
            if room == row {
                return;
            }
            row = rest;
        }
    }

    fn region(&self, [x, y]: [usize; 2]) -> Region {
        if x < self.size[0] && y < self.size[1] { self.regions[y * self.size[0] + x] } else { Region::Outside }
    }

    /// Where regions meet, in a fixed order.
    fn borders(&self) -> Vec<Border> {
        let mut borders: Vec<Border> = Vec::new();
        for along in 0..2 {
            for across in 0..=self.size[1 - along] {
                let mut open: Option<Border> = None;
                for at in 0..self.size[along] {
                    let square = |across: usize| if along == 0 { [at, across] } else { [across, at] };
                    let below = if across == 0 { Region::Outside } else { self.region(square(across - 1)) };
                    let sides = [below, self.region(square(across))];
                    let here_m = at as f64 * CELL_M;
                    match &mut open {
                        Some(border) if border.sides == sides => border.span_m[1] = here_m + CELL_M,
                        _ => {
                            borders.extend(open.take());
                            let span_m = [here_m, here_m + CELL_M];
                            let border = Border { along, across_m: across as f64 * CELL_M, span_m, sides };
                            open = (sides[0] != sides[1]).then_some(border);
                        }
                    }
                }
                borders.extend(open);
            }
        }
        borders
    }

    /// Builds the walls of a storey; out come its doors.
    pub(crate) fn raise(&self, storey: &Storey, builder: &mut SpaceBuilder, rng: &mut Rng) -> Vec<Doorway> {
        let borders = self.borders();
        let chosen: Vec<Option<usize>> = (0..self.rooms.len()).map(|room| choose_door(&borders, room, rng)).collect();
        let mut doorways = Vec::new();
        for (number, border) in borders.iter().enumerate() {
            let wall = Wall {
                along: border.along,
                across_m: border.across_m,
                span_m: border.span_m,
                height_m: [storey.floor_m, storey.floor_m + storey.height_m],
            };
            let mut openings = Vec::new();
            let is_door = |room: usize| chosen.get(room).copied().flatten() == Some(number);
            match border.sides {
                [Region::Room(room), Region::Corridor] | [Region::Corridor, Region::Room(room)] if is_door(room) => {
                    let at_m = rng.uniform(border.span_m[0] + 1.0, border.span_m[1] - 1.0);
                    doorways.push(border.doorway(at_m, storey.corridor_m));
                    openings.push(Opening { span_m: around(at_m, DOOR_M[0]), height_m: [0.0, DOOR_M[1]] });
                    builder.leaf(&wall, at_m - 0.5 * DOOR_M[0], border.room_side(), DOOR_M, rng);
                }
                [Region::Room(_), Region::Outside] | [Region::Outside, Region::Room(_)] if storey.windows => {
                    openings = windows(border.span_m, rng);
                }
                [Region::Corridor, Region::Shaft] if border.along == 1 && storey.shaft_open[0] => {
                    openings.push(border.whole_width());
                }
                [Region::Shaft, Region::Corridor] if border.along == 1 && storey.shaft_open[1] => {
                    openings.push(border.whole_width());
                }
                _ => {}
            }
            builder.wall(&wall, &openings);
        }
        doorways
    }
}

fn choose_door(borders: &[Border], room: usize, rng: &mut Rng) -> Option<usize> {
    let is_fit = |border: &Border| {
        let [a, b] = border.sides;
        let leads = [(a, b), (b, a)].contains(&(Region::Room(room), Region::Corridor));
        leads && border.span_m[1] - border.span_m[0] >= 2.5
    };
    let fit: Vec<usize> = (0..borders.len()).filter(|number| is_fit(&borders[*number])).collect();
    (!fit.is_empty()).then(|| fit[rng.below(fit.len())])
}

fn around(at_m: f64, width_m: f64) -> [f64; 2] {
    [at_m - 0.5 * width_m, at_m + 0.5 * width_m]
}

fn windows([from_m, to_m]: [f64; 2], rng: &mut Rng) -> Vec<Opening> {
    let (width_m, sill_m, top_m) = (rng.uniform(0.9, 1.5), rng.uniform(0.6, 1.0), rng.uniform(1.9, 2.4));
    let count = ((to_m - from_m - 0.4) / (width_m + 0.6)) as usize;
    let at_m = |k: usize| from_m + (k as f64 + 0.5) / count as f64 * (to_m - from_m);
    let window = |k| Opening { span_m: around(at_m(k), width_m), height_m: [sill_m, top_m] };
    (0..count).filter(|_| rng.chance(0.8)).map(window).collect()
}

impl Border {
    /// Which way along the other axis the room lies.
    fn room_side(&self) -> f64 {
        if matches!(self.sides[1], Region::Room(_)) { 1.0 } else { -1.0 }
    }

    fn doorway(&self, at_m: f64, corridor_m: f64) -> Doorway {
        let place = |off_m: f64| {
            let across_m = self.across_m + self.room_side() * off_m;
            if self.along == 0 { [at_m, across_m] } else { [across_m, at_m] }
        };
        Doorway { front: place(-0.5 * corridor_m), inside: place(VISIT_M) }
    }

    /// An opening as wide as the border without a jamb at each side.
    fn whole_width(&self) -> Opening {
        Opening { span_m: [self.span_m[0] + 0.3, self.span_m[1] - 0.3], height_m: [0.0, 2.3] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn walls_stand_where_regions_meet_and_nowhere_else() {
        let mut plan = Plan::new([10, 6]);
        plan.paint(Rect::new([0, 0], [10, 3]), Region::Corridor);
        plan.fill(Rect::new([0, 3], [10, 6]), &mut Rng::new(1));
        assert_eq!(plan.rooms().len(), 1);
        let borders = plan.borders();
        let length_m: f64 = borders.iter().map(|border| border.span_m[1] - border.span_m[0]).sum();
        assert_eq!(length_m, 2.0 * (5.0 + 3.0) + 5.0);
        let storey = Storey { floor_m: 0.0, height_m: 3.0, corridor_m: 1.5, shaft_open: [false; 2], windows: false };
        let doors = plan.raise(&storey, &mut SpaceBuilder::new(1), &mut Rng::new(1));
        assert_eq!(doors.len(), 1);
        assert!((doors[0].front[1] - 0.75).abs() < 1e-12 && doors[0].inside[1] > 2.5);
    }
}
