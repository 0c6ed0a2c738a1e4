//! The carpenter in space: walls with openings, slabs, ramps, stairs, and furniture that keeps out of the robot's way.

use super::site::{SpaceSite, flat};
use super::solid::{Point3, Solid};
use super::world::SpaceWorld;
use crate::build::{Builder, Footprint};
use crate::math::{Point, rotate};
use crate::rng::Rng;

/// Thickness of walls, metres.
const WALL_M: f64 = 0.15;
/// Thickness of floors, metres.
pub(crate) const SLAB_M: f64 = 0.3;
/// Thickness of ramps, metres.
const RAMP_M: f64 = 0.15;
/// Height of a stair's step, roughly, metres.
const STEP_M: f64 = 0.16;

/// An upright wall along an axis of the world.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Wall {
    /// The axis along it: 0 is x, 1 is y.
    pub(crate) along: usize,
    /// Where its middle lies on the other axis, metres.
    pub(crate) across_m: f64,
    /// From here to there along it, metres.
    pub(crate) span_m: [f64; 2],
    /// Bottom and top, metres.
    pub(crate) height_m: [f64; 2],
}

/// A door's or window's hole in a wall: along it, and above the wall's bottom, metres.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Opening {
    pub(crate) span_m: [f64; 2],
    pub(crate) height_m: [f64; 2],
}

/// A world in space under construction.
pub(crate) struct SpaceBuilder {
    solids: Vec<Solid>,
    /// What is taken on each storey.
    storeys: Vec<Builder>,
}

impl SpaceBuilder {
    pub(crate) fn new(storeys: usize) -> Self {
        Self { solids: Vec::new(), storeys: vec![Builder::new(); storeys] }
    }

    pub(crate) fn build(self, waypoints: Vec<Point3>) -> SpaceSite {
        SpaceSite { world: SpaceWorld::new(self.solids), waypoints }
    }

    pub(crate) fn solid(&mut self, solid: Solid) {
        self.solids.push(solid);
    }

    /// A box over a rectangle of the plan, from one height to another.
    pub(crate) fn block(&mut self, [a, b]: [Point; 2], [low_m, high_m]: [f64; 2]) {
        if a[0] < b[0] && a[1] < b[1] {
            self.solid(Solid::aligned([a[0], a[1], low_m], [b[0], b[1], high_m]));
        }
    }

    /// A floor over a rectangle but for a hole in it.
    pub(crate) fn slab(&mut self, [a, b]: [Point; 2], hole: Option<[Point; 2]>, top_m: f64) {
        let heights = [top_m - SLAB_M, top_m];
        let Some([c, d]) = hole else {
            return self.block([a, b], heights);
        };
        self.block([a, [b[0], c[1]]], heights);
        self.block([[a[0], d[1]], b], heights);
        self.block([[a[0], c[1]], [c[0], d[1]]], heights);
        self.block([[d[0], c[1]], [b[0], d[1]]], heights);
    }

    pub(crate) fn wall(&mut self, wall: &Wall, openings: &[Opening]) {
        let [bottom_m, top_m] = wall.height_m;
        let mut from_m = wall.span_m[0] - 0.5 * WALL_M;
        for opening in openings {
            let [sill_m, lintel_m] = opening.height_m.map(|height_m| bottom_m + height_m);
            self.wall_piece(wall, [from_m, opening.span_m[0]], wall.height_m);
            self.wall_piece(wall, opening.span_m, [bottom_m, sill_m]);
            self.wall_piece(wall, opening.span_m, [lintel_m, top_m]);
            from_m = opening.span_m[1];
        }
        self.wall_piece(wall, [from_m, wall.span_m[1] + 0.5 * WALL_M], wall.height_m);
    }

    fn wall_piece(&mut self, wall: &Wall, span_m: [f64; 2], height_m: [f64; 2]) {
        let across_m = [wall.across_m - 0.5 * WALL_M, wall.across_m + 0.5 * WALL_M];
        let corner =
            |end: usize| if wall.along == 0 { [span_m[end], across_m[end]] } else { [across_m[end], span_m[end]] };
        if height_m[0] < height_m[1] {
            self.block([corner(0), corner(1)], height_m);
        }
    }

    /// The open leaf of a door that is hinged to a wall at `hinge_m` along it and swings to one `side` of it.
    pub(crate) fn leaf(&mut self, wall: &Wall, hinge_m: f64, side: f64, [width_m, height_m]: [f64; 2], rng: &mut Rng) {
        let open_rad = rng.uniform(1.6, 1.85);
        // along the wall, away from the door, and into the room
        let [along, away] = rotate([1.0, 0.0], open_rad);
        let away = side * away;
        let (axis, hinge) = if wall.along == 0 {
            ([along, away], [hinge_m, wall.across_m + side * 0.5 * WALL_M])
        } else {
            ([away, along], [wall.across_m + side * 0.5 * WALL_M, hinge_m])
        };
        let middle = [hinge[0] + 0.5 * width_m * axis[0], hinge[1] + 0.5 * width_m * axis[1]];
        let centre = [middle[0], middle[1], wall.height_m[0] + 0.5 * height_m];
        self.solid(Solid::along(centre, [width_m, 0.04, height_m], axis));
        let leaf = Footprint { center: middle, along: axis, length_m: width_m + 0.1, depth_m: 0.15 };
        self.storeys.iter_mut().for_each(|storey| storey.block(leaf));
    }

    /// A ramp, or a flight of stairs whose steps end on the same line, along x.
    pub(crate) fn flight(&mut self, from: Point3, to: Point3, width_m: f64, is_stairs: bool) {
        if !is_stairs {
            return self.solid(Solid::ramp(from, to, width_m, RAMP_M));
        }
        let steps = ((to[2] - from[2]) / STEP_M).round().max(1.0);
        for step in 0..steps as usize {
            let at = |share: f64, k: usize| from[k] + share * (to[k] - from[k]);
            let (near, far) = (step as f64 / steps, (step + 1) as f64 / steps);
            let (y, top_m) = (from[1], at(near, 2));
            let low = [at(near, 0), y - 0.5 * width_m, top_m - SLAB_M];
            self.solid(Solid::aligned(low, [at(far, 0), y + 0.5 * width_m, top_m]));
        }
    }

    /// Keeps furniture of every storey away from this way.
    pub(crate) fn reserve(&mut self, way: &[Point3]) {
        let way: Vec<Point> = way.iter().map(|point| flat(*point)).collect();
        self.storeys.iter_mut().for_each(|storey| storey.reserve(&way));
    }

    /// Takes a place on a storey, unless it is in the way or taken; whether it was got.
    pub(crate) fn claim(&mut self, storey: usize, place: Footprint) -> bool {
        self.storeys.get_mut(storey).is_some_and(|storey| storey.claim(place))
    }

    /// A box over a footprint, from one height to another; its place is taken already.
    pub(crate) fn stand(&mut self, place: &Footprint, [low_m, high_m]: [f64; 2]) {
        let [x, y] = place.center;
        let size = [place.length_m, place.depth_m, high_m - low_m];
        self.solid(Solid::along([x, y, 0.5 * (low_m + high_m)], size, place.along));
    }
}
