//! Streets around a block of houses with a courtyard.

use crate::build::Footprint;
use crate::math::{Point, rotate};
use crate::rng::Rng;
use crate::space::SpaceSite;
use crate::space::build::SpaceBuilder;
use crate::space::solid::Solid;

/// Width of a passage through a wing and its height, metres.
const PASSAGE_M: [f64; 2] = [4.5, 4.0];
/// The courtyard lies so far below the street, metres.
const SUNK_M: f64 = 0.6;
/// From floor to floor of a house, metres.
const FLOOR_M: f64 = 3.0;
/// Depth of the houses across the street, metres.
const ACROSS_M: f64 = 8.0;

/// A block of houses between streets, with facades of bays, sills and balconies, parked cars, trees, alleys, and a courtyard
/// 0.6 m below the street behind two passages. The drive leads around the block, through the courtyard, and around half the block
/// again: some 600 to 750 m.
#[must_use]
pub fn courtyard(seed: u64) -> SpaceSite {
    let mut rng = Rng::keyed(seed, 0x0063_6f75_7274);
    let block = Block::draw(&mut rng);
    let mut builder = SpaceBuilder::new(1);
    let way = block.way();
    builder.reserve(&way);
    block.ground(&mut builder);
    block.wings(&mut builder, &mut rng);
    block.across_the_street(&mut builder, &mut rng);
    block.clutter(&mut builder, &mut rng);
    builder.build(way)
}

/// Measures; the block's outer corner is the origin.
struct Block {
    size: Point,
    wing_m: f64,
    street_m: f64,
    /// Where the passages of the low and the high side lie along x.
    passages: [f64; 2],
}

/// A stretch of a facade: the axis along it, from where to where, where it stands on the other axis, which way it looks.
#[derive(Clone, Copy)]
struct Facade {
    along: usize,
    span_m: [f64; 2],
    across_m: f64,
    outward: f64,
    bottom_m: f64,
    floors: usize,
}

impl Block {
    fn draw(rng: &mut Rng) -> Self {
        let size = [rng.uniform(60.0, 76.0), rng.uniform(46.0, 58.0)];
        let wing_m = rng.uniform(9.0, 11.0);
        let passage = |rng: &mut Rng| rng.uniform(wing_m + 8.0, size[0] - wing_m - 8.0);
        Self { size, wing_m, street_m: rng.uniform(10.0, 13.0), passages: [passage(rng), passage(rng)] }
    }

    fn way(&self) -> Vec<[f64; 3]> {
        let [x, y] = self.size;
        let (off, yard) = (0.5 * self.street_m, self.wing_m + 4.5);
        let street = |x: f64, y: f64| [x, y, 0.0];
        let inside = |x: f64, y: f64| [x, y, -SUNK_M];
        let [low, high] = self.passages;
        let corners = [street(-off, -off), street(x + off, -off), street(x + off, y + off), street(-off, y + off)];
        let mut way = vec![street(low, -off)];
        way.extend([corners[1], corners[2], corners[3], corners[0], street(low, -off)]);
        way.extend([street(low, 0.0), inside(low, self.wing_m), inside(low, yard)]);
        way.extend([inside(x - yard, yard), inside(x - yard, y - yard), inside(yard, y - yard), inside(yard, yard)]);
        way.extend([inside(low, yard), inside(x - yard, yard), inside(x - yard, y - yard), inside(high, y - yard)]);
        way.extend([inside(high, y - self.wing_m), street(high, y), street(high, y + off)]);
        way.extend([corners[3], corners[0], street(low, -off), street(low + 15.0, -off)]);
        way
    }

    fn ground(&self, builder: &mut SpaceBuilder) {
        let [x, y] = self.size;
        let (far, w, half) = (self.street_m + ACROSS_M + 10.0, self.wing_m, 0.5 * PASSAGE_M[0]);
        let street = [-2.0, 0.0];
        builder.block([[-far, -far], [x + far, 0.0]], street);
        builder.block([[-far, y], [x + far, y + far]], street);
        builder.block([[-far, 0.0], [0.0, y]], street);
        builder.block([[x, 0.0], [x + far, y]], street);
        builder.block([[w, w], [x - w, y - w]], [-2.0, -SUNK_M]);
        let [low, high] = self.passages;
        builder.solid(Solid::ramp([low, 0.0, 0.0], [low, w, -SUNK_M], 2.0 * half, 0.5));
        builder.solid(Solid::ramp([high, y, 0.0], [high, y - w, -SUNK_M], 2.0 * half, 0.5));
    }

    /// The four wings and their facades to both sides.
    fn wings(&self, builder: &mut SpaceBuilder, rng: &mut Rng) {
        let ([x, y], w, half) = (self.size, self.wing_m, 0.5 * PASSAGE_M[0]);
        for (side, [from_m, to_m]) in [(0, [0.0, w]), (1, [y - w, y])] {
            let floors = 3 + rng.below(3);
            let top_m = floors as f64 * FLOOR_M;
            let [left, right] = [self.passages[side] - half, self.passages[side] + half];
            builder.block([[0.0, from_m], [left, to_m]], [-2.0, top_m]);
            builder.block([[right, from_m], [x, to_m]], [-2.0, top_m]);
            builder.block([[left, from_m], [right, to_m]], [PASSAGE_M[1], top_m]);
            let outer = [0.0, y][side];
            let (inner, outward) = ([w, y - w][side], [-1.0, 1.0][side]);
            for span_m in [[0.0, left - 0.3], [right + 0.3, x]] {
                let street = Facade { along: 0, span_m, across_m: outer, outward, bottom_m: 0.0, floors };
                let yard = [span_m[0].max(w), span_m[1].min(x - w)];
                street.build(builder, rng);
                Facade { span_m: yard, across_m: inner, outward: -outward, bottom_m: -SUNK_M, ..street }
                    .build(builder, rng);
            }
        }
        for (across_m, inner, outward) in [(0.0, w, -1.0), (x, x - w, 1.0)] {
            let floors = 3 + rng.below(3);
            let ends = [across_m.min(inner), across_m.max(inner)];
            builder.block([[ends[0], w], [ends[1], y - w]], [-2.0, floors as f64 * FLOOR_M]);
            let street = Facade { along: 1, span_m: [0.0, y], across_m, outward, bottom_m: 0.0, floors };
            street.build(builder, rng);
            let yard = Facade { span_m: [w, y - w], across_m: inner, outward: -outward, bottom_m: -SUNK_M, ..street };
            yard.build(builder, rng);
        }
    }

    /// Houses of different depth, with alleys between some.
    fn across_the_street(&self, builder: &mut SpaceBuilder, rng: &mut Rng) {
        let ([x, y], s) = (self.size, self.street_m);
        let rows = [(0, x, -s, 1.0), (0, x, y + s, -1.0), (1, y, -s, 1.0), (1, y, x + s, -1.0)];
        for (along, length_m, across_m, outward) in rows {
            let mut from_m = -s;
            while from_m < length_m + s - 4.0 {
                let to_m = (from_m + rng.uniform(8.0, 20.0)).min(length_m + s);
                let across_m = across_m - outward * rng.uniform(0.0, 2.5);
                let floors = 1 + rng.below(5);
                let back_m = across_m - outward * ACROSS_M;
                let ends = [across_m.min(back_m), across_m.max(back_m)];
                let corner = |end: usize| {
                    if along == 0 { [[from_m, to_m][end], ends[end]] } else { [ends[end], [from_m, to_m][end]] }
                };
                builder.block([corner(0), corner(1)], [-2.0, floors as f64 * FLOOR_M]);
                Facade { along, span_m: [from_m, to_m], across_m, outward, bottom_m: 0.0, floors }.build(builder, rng);
                from_m = to_m + if rng.chance(0.3) { rng.uniform(2.0, 5.0) } else { 0.0 };
            }
        }
    }

    /// Parked cars, trees, posts.
    fn clutter(&self, builder: &mut SpaceBuilder, rng: &mut Rng) {
        let ([x, y], s, w) = (self.size, self.street_m, self.wing_m);
        for _ in 0..90 {
            let along = rng.below(2);
            let at_m = rng.uniform(-s + 2.0, [x, y][along] + s - 2.0);
            let from_house_m = if rng.chance(0.5) { rng.uniform(2.6, 3.2) } else { s - rng.uniform(2.6, 3.2) };
            let across_m = if rng.chance(0.5) { -from_house_m } else { [y, x][along] + from_house_m };
            let center = if along == 0 { [at_m, across_m] } else { [across_m, at_m] };
            let axis = rotate(if along == 0 { [1.0, 0.0] } else { [0.0, 1.0] }, rng.uniform(-0.08, 0.08));
            match rng.below(3) {
                0 => tree(builder, center, 0.0, rng),
                1 => post(builder, center),
                _ => car(builder, center, axis, rng),
            }
        }
        for _ in 0..10 {
            let center = [rng.uniform(w + 3.0, x - w - 3.0), rng.uniform(w + 3.0, y - w - 3.0)];
            tree(builder, center, -SUNK_M, rng);
        }
    }
}

impl Facade {
    /// Bays that stand out by up to 0.7 m, each floor with sills or a balcony.
    fn build(&self, builder: &mut SpaceBuilder, rng: &mut Rng) {
        let mut from_m = self.span_m[0];
        while from_m < self.span_m[1] - 0.5 {
            let wanted_m = from_m + rng.uniform(2.0, 6.0);
            let to_m = if wanted_m > self.span_m[1] - 1.5 { self.span_m[1] } else { wanted_m };
            let depth_m = if rng.chance(0.4) { 0.0 } else { rng.uniform(0.1, 0.7) };
            let top_m = self.bottom_m + self.floors as f64 * FLOOR_M - rng.uniform(0.0, 1.0);
            self.piece(builder, [from_m, to_m], [0.0, depth_m], [self.bottom_m, top_m]);
            let is_balcony = rng.chance(0.25);
            let door_m = rng.uniform(0.3, 0.7) * (to_m - from_m);
            self.piece(builder, [from_m + door_m - 0.2, from_m + door_m + 0.2], [depth_m, depth_m + 0.12], [0.0, 2.4]);
            for floor in 0..self.floors {
                let at_m = self.bottom_m + floor as f64 * FLOOR_M;
                let span_m = [from_m + 0.4, to_m - 0.4];
                if is_balcony && floor > 0 {
                    self.piece(builder, span_m, [depth_m, depth_m + 1.0], [at_m - 0.1, at_m + 0.1]);
                    self.piece(builder, span_m, [depth_m + 0.95, depth_m + 1.0], [at_m + 0.1, at_m + 1.0]);
                } else {
                    self.piece(builder, span_m, [depth_m, depth_m + 0.15], [at_m + 0.9, at_m + 1.0]);
                    self.piece(builder, span_m, [depth_m, depth_m + 0.1], [at_m + 2.3, at_m + 2.45]);
                }
            }
            from_m = to_m;
        }
    }

    /// A box along the facade, so far before it.
    fn piece(&self, builder: &mut SpaceBuilder, span_m: [f64; 2], before_m: [f64; 2], height_m: [f64; 2]) {
        let across_m = before_m.map(|off_m| self.across_m + self.outward * off_m);
        let across_m = [across_m[0].min(across_m[1]), across_m[0].max(across_m[1])];
        let corner =
            |end: usize| if self.along == 0 { [span_m[end], across_m[end]] } else { [across_m[end], span_m[end]] };
        builder.block([corner(0), corner(1)], height_m);
    }
}

fn car(builder: &mut SpaceBuilder, center: Point, along: Point, rng: &mut Rng) {
    let place = Footprint { center, along, length_m: rng.uniform(3.8, 4.8), depth_m: rng.uniform(1.6, 1.9) };
    if builder.claim(0, place) {
        builder.stand(&place, [0.25, 0.9]);
        let cabin = Footprint { length_m: 0.55 * place.length_m, depth_m: place.depth_m - 0.2, ..place };
        builder.stand(&cabin, [0.9, rng.uniform(1.35, 1.7)]);
    }
}

fn post(builder: &mut SpaceBuilder, center: Point) {
    let place = Footprint { center, along: [1.0, 0.0], length_m: 0.15, depth_m: 0.15 };
    if builder.claim(0, place) {
        builder.stand(&place, [0.0, 5.0]);
    }
}

/// A trunk and a crown of three boxes.
fn tree(builder: &mut SpaceBuilder, center: Point, ground_m: f64, rng: &mut Rng) {
    let trunk = Footprint { center, along: rotate([1.0, 0.0], rng.uniform(0.0, 3.0)), length_m: 0.35, depth_m: 0.35 };
    if !builder.claim(0, trunk) {
        return;
    }
    let crown_m = ground_m + rng.uniform(2.2, 3.2);
    builder.stand(&trunk, [ground_m, crown_m + 0.5]);
    for layer in 0..3 {
        let (size_m, low_m) = (rng.uniform(1.2, 3.0), crown_m + 0.8 * f64::from(layer));
        let along = rotate([1.0, 0.0], rng.uniform(0.0, 3.0));
        builder.stand(&Footprint { center, along, length_m: size_m, depth_m: size_m }, [low_m, low_m + 0.8]);
    }
}
