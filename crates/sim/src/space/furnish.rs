//! What stands in rooms and corridors and hangs from their ceilings.

use super::build::{SLAB_M, SpaceBuilder};
use super::plan::{Rect, Storey};
use crate::build::Footprint;
use crate::math::{Point, add, rotate, scale};
use crate::rng::Rng;

/// Between furniture and the middle of the wall it stands at, metres.
const FROM_WALL_M: f64 = 0.1;

/// A wall seen from inside: where it begins, along it, away from it, its length.
#[derive(Clone, Copy)]
struct Inner {
    origin: Point,
    along: Point,
    away: Point,
    length_m: f64,
}

impl Inner {
    fn of(room: Rect, side: usize) -> Self {
        let [[x0, y0], [x1, y1]] = room.corners_m();
        match side {
            0 => Self { origin: [x0, y0], along: [1.0, 0.0], away: [0.0, 1.0], length_m: x1 - x0 },
            1 => Self { origin: [x0, y1], along: [1.0, 0.0], away: [0.0, -1.0], length_m: x1 - x0 },
            2 => Self { origin: [x0, y0], along: [0.0, 1.0], away: [1.0, 0.0], length_m: y1 - y0 },
            _ => Self { origin: [x1, y0], along: [0.0, 1.0], away: [-1.0, 0.0], length_m: y1 - y0 },
        }
    }

    /// A place of a size somewhere at the wall.
    fn place(&self, length_m: f64, depth_m: f64, rng: &mut Rng) -> Footprint {
        let low_m = 0.5 * length_m + 0.1;
        let at_m = rng.uniform(low_m, (self.length_m - low_m).max(low_m + 0.01));
        let off = scale(self.away, FROM_WALL_M + 0.5 * depth_m);
        let center = add(add(self.origin, scale(self.along, at_m)), off);
        Footprint { center, along: self.along, length_m, depth_m }
    }
}

/// Fills a room with tables, shelves, boxes and lamps as its size suggests.
pub(crate) fn furnish_room(builder: &mut SpaceBuilder, number: usize, storey: &Storey, room: Rect, rng: &mut Rng) {
    let [low, high] = room.corners_m();
    let area_m2 = (high[0] - low[0]) * (high[1] - low[1]);
    let floor_m = storey.floor_m;
    for _ in 0..3 + (area_m2 / 6.0) as usize {
        let wall = Inner::of(room, rng.below(4));
        match rng.below(3) {
            0 => table(builder, number, floor_m, &wall, rng),
            _ => cupboard(builder, number, floor_m, &wall, rng),
        }
    }
    for _ in 0..1 + (area_m2 / 12.0) as usize {
        let at = |k: usize, rng: &mut Rng| rng.uniform(low[k] + 0.6, high[k] - 0.6);
        let center = [at(0, rng), at(1, rng)];
        let place = Footprint {
            center,
            along: rotate([1.0, 0.0], rng.uniform(0.0, 3.1)),
            length_m: rng.uniform(0.3, 0.9),
            depth_m: rng.uniform(0.3, 0.6),
        };
        let height_m = rng.uniform(0.3, 1.2);
        if builder.claim(number, place) {
            builder.stand(&place, [floor_m, floor_m + height_m]);
        }
    }
    lamps(builder, storey, room, rng);
}

/// Shelves, radiators and columns along a corridor.
pub(crate) fn furnish_corridor(
    builder: &mut SpaceBuilder,
    number: usize,
    storey: &Storey,
    corridor: Rect,
    rng: &mut Rng,
) {
    let along = usize::from(corridor.size(1) > corridor.size(0));
    let pieces = corridor.size(along) / 8;
    for _ in 0..pieces {
        let wall = Inner::of(corridor, 2 * along + rng.below(2));
        let (length_m, depth_m, height_m) = match rng.below(3) {
            0 => (rng.uniform(0.3, 0.5), rng.uniform(0.15, 0.3), storey.height_m - SLAB_M),
            1 => (rng.uniform(0.8, 1.6), rng.uniform(0.1, 0.2), rng.uniform(0.5, 0.8)),
            _ => (rng.uniform(0.4, 1.2), rng.uniform(0.25, 0.4), rng.uniform(0.9, 2.0)),
        };
        let place = wall.place(length_m, depth_m, rng);
        if builder.claim(number, place) {
            builder.stand(&place, [storey.floor_m, storey.floor_m + height_m]);
        }
    }
    lamps(builder, storey, corridor, rng);
}

/// A top on four legs, and perhaps a chair before it.
fn table(builder: &mut SpaceBuilder, number: usize, floor_m: f64, wall: &Inner, rng: &mut Rng) {
    let place = wall.place(rng.uniform(1.0, 1.8), rng.uniform(0.6, 0.9), rng);
    let chair_m = rng.uniform(-0.2, 0.2);
    if !builder.claim(number, place) {
        return;
    }
    builder.stand(&place, [floor_m + 0.70, floor_m + 0.74]);
    let inset = Footprint { length_m: place.length_m - 0.1, depth_m: place.depth_m - 0.1, ..place };
    for center in inset.corners() {
        builder.stand(&Footprint { center, length_m: 0.05, depth_m: 0.05, ..place }, [floor_m, floor_m + 0.70]);
    }
    let off = add(scale(wall.away, 0.5 * place.depth_m + 0.35), scale(wall.along, chair_m));
    let turned = rotate(wall.along, 2.0 * chair_m);
    let seat = Footprint { center: add(place.center, off), along: turned, length_m: 0.45, depth_m: 0.45 };
    if builder.claim(number, seat) {
        builder.stand(&seat, [floor_m + 0.40, floor_m + 0.48]);
        let back = Footprint { center: add(seat.center, scale(wall.away, 0.2)), depth_m: 0.05, ..seat };
        builder.stand(&back, [floor_m + 0.48, floor_m + 0.95]);
        builder.stand(&Footprint { length_m: 0.08, depth_m: 0.08, ..seat }, [floor_m, floor_m + 0.40]);
    }
}

fn cupboard(builder: &mut SpaceBuilder, number: usize, floor_m: f64, wall: &Inner, rng: &mut Rng) {
    let place = wall.place(rng.uniform(0.6, 2.0), rng.uniform(0.3, 0.6), rng);
    let height_m = if rng.chance(0.5) { rng.uniform(1.6, 2.2) } else { rng.uniform(0.6, 1.2) };
    if builder.claim(number, place) {
        builder.stand(&place, [floor_m, floor_m + height_m]);
    }
}

/// Lamps in a row under the ceiling, and a beam here and there.
fn lamps(builder: &mut SpaceBuilder, storey: &Storey, room: Rect, rng: &mut Rng) {
    let along = usize::from(room.size(1) > room.size(0));
    let [low, high] = room.corners_m();
    let ceiling_m = storey.floor_m + storey.height_m - SLAB_M;
    let middle_m = 0.5 * (low[1 - along] + high[1 - along]);
    let mut at_m = low[along] + rng.uniform(0.8, 2.0);
    while at_m < high[along] - 0.8 {
        let center = if along == 0 { [at_m, middle_m] } else { [middle_m, at_m] };
        let lamp = Footprint { center, along: [1.0, 0.0], length_m: 0.6, depth_m: 0.6 };
        builder.stand(&lamp, [ceiling_m - 0.08, ceiling_m]);
        at_m += rng.uniform(2.0, 4.5);
    }
}
