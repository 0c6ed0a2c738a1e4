//! Every heading and every shift: two maps in coarse cells, correlated for all shifts at once at each heading.
//!
//! What a wall says of a place is a log likelihood ratio: of a right pose, that puts a wall of the one map onto a wall or into
//! free space of the other, against a pose taken at random. What the other does not know says nothing. The score of a pose is
//! the sum over the walls of both maps. With `f` the ratios of a map's places and `w` its walls, the score of all shifts is the
//! real part of one complex correlation, that of `f_a + i w_a` with `w_b + i f_b`: one transform there and one back.

use super::fft::{Image, Transform};
use super::walls::Walls;
use super::{Occupancy, Ratios};
use mapwright_geom::{Pose2, sin_cos};
use std::f64::consts::TAU;

/// Coarse cells, in cells of the coarser map: as few as the work allows.
const STEPS_CELLS: [f64; 12] = [2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 16.0, 24.0, 32.0, 48.0];
/// Work in numbers of pixels times stages that is always worth a finer step, about a second;
const CHEAP: f64 = 3e8;
/// what it may take before steps get longer than [`COMFORTABLE_CELLS`],
const AFFORDABLE: f64 = 3e9;
/// and at most: a square of 500 m in cells of 0.05 m takes half of it.
const MOST: f64 = 1.5e10;
/// Steps that no building suffers from: 0.4 m in maps of the usual 0.05 m.
const COMFORTABLE_CELLS: f64 = 8.0;
/// A wall is felt so many steps away: half a step is lost to the lattice of shifts, as much to that of headings.
const REACH_STEPS: f64 = 1.5;
/// Best shifts that are kept of each heading.
const SHIFTS_PER_HEADING: usize = 10;

/// A pose of the second map's middle in the frame of the first one's.
#[derive(Debug, Clone, Copy)]
pub(super) struct Candidate {
    pub(super) a_from_b: Pose2,
    pub(super) score: f32,
}

/// What was looked at, and how finely.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Lattice {
    pub(super) step_m: f64,
    pub(super) headings: usize,
    /// Sides of the transforms.
    sides: [usize; 2],
}

impl Lattice {
    /// The finest that is worth its work; the last one where none is.
    pub(super) fn of(a: &Walls<'_>, b: &Walls<'_>) -> Self {
        let resolution_m = a.map.resolution_m.max(b.map.resolution_m);
        let lattices = STEPS_CELLS.map(|cells| (cells, Self::with_step(a, b, cells * resolution_m)));
        let limit = |cells| if cells < COMFORTABLE_CELLS { CHEAP } else { AFFORDABLE };
        let found = lattices.iter().find(|(cells, lattice)| lattice.work() <= limit(*cells));
        found.unwrap_or(&lattices[lattices.len() - 1]).1
    }

    fn with_step(a: &Walls<'_>, b: &Walls<'_>, step_m: f64) -> Self {
        let headings = (TAU * b.rms_radius_m / step_m).ceil().clamp(8.0, 1e5) as usize;
        // All shifts at which the rectangle of the one and the disc of the other touch.
        let side = |half_m: f64| (2.0 * (half_m + b.radius_m()) / step_m + 4.0 * REACH_STEPS + 2.0).ceil();
        let sides = a.half_sides.map(|half_m| (side(half_m) as usize).next_power_of_two());
        Self { step_m, headings, sides }
    }

    fn work(&self) -> f64 {
        let pixels = (self.sides[0] * self.sides[1]) as f64;
        2.0 * self.headings as f64 * pixels * pixels.log2()
    }

    /// Whether the search is within its means.
    pub(super) fn is_affordable(&self) -> bool {
        self.work() <= MOST
    }

    fn heading(&self, number: usize) -> f64 {
        TAU * number as f64 / self.headings as f64
    }
}

/// A map in coarse cells, its middle in the middle.
#[derive(Debug)]
struct Raster {
    step_m: f64,
    /// Cells on each side of the middle, along x and y.
    half: [i64; 2],
    /// What a wall of the other map at this place says, nats.
    ratios: Vec<f32>,
}

impl Raster {
    /// In cells of `step_m`, with walls that are felt `reach_m` away.
    fn of(walls: &Walls<'_>, step_m: f64, reach_m: f64) -> Self {
        let half = walls.half_sides.map(|m| ((m + reach_m) / step_m).ceil() as i64 + 1);
        let mut raster = Self { step_m, half, ratios: Vec::new() };
        let near = raster.nearness(walls, reach_m);
        let known = raster.known(walls);
        let (mut seen, mut beside) = (0.0, 0.0);
        for (&near, &known) in near.iter().zip(&known).filter(|(near, known)| **near > 0.0 || **known) {
            seen += f64::from(u8::from(known || near > 0.0));
            beside += f64::from(near);
        }
        let ratios = Ratios::where_by_chance(beside / f64::max(seen, 1.0));
        let ratio = |(&near, &known): (&f32, &bool)| {
            let missed = if known { (1.0 - near) * ratios.missed as f32 } else { 0.0 };
            near * ratios.confirmed as f32 + missed
        };
        raster.ratios = near.iter().zip(&known).map(ratio).collect();
        raster
    }

    fn width(&self) -> usize {
        (2 * self.half[0]) as usize
    }

    /// The cell of a place; the middle is the corner of four.
    fn index(&self, place: [f64; 2]) -> Option<usize> {
        let [x, y] = [0, 1].map(|k: usize| (place[k] / self.step_m).floor() as i64 + self.half[k]);
        let inside = (0..2 * self.half[0]).contains(&x) && (0..2 * self.half[1]).contains(&y);
        inside.then(|| y as usize * self.width() + x as usize)
    }

    /// Of each cell: 1 at a wall, falling to 0 at the reach.
    fn nearness(&self, walls: &Walls<'_>, reach_m: f64) -> Vec<f32> {
        let (width, cells) = (self.width(), 4 * self.half[0] * self.half[1]);
        let mut occupied = vec![false; cells as usize];
        walls.surfaces.iter().filter_map(|s| self.index(s.at)).for_each(|at| occupied[at] = true);
        let reach = reach_m / self.step_m;
        let r = reach.ceil() as i64;
        let disc: Vec<(i64, i64, f32)> = (-r..=r)
            .flat_map(|dy| (-r..=r).map(move |dx| (dx, dy, (1.0 - (dx as f64).hypot(dy as f64) / reach) as f32)))
            .filter(|entry| entry.2 > 0.0)
            .collect();
        let mut near = vec![0.0_f32; cells as usize];
        for at in (0..occupied.len()).filter(|&at| occupied[at]) {
            let [x, y] = [(at % width) as i64, (at / width) as i64];
            for &(dx, dy, value) in &disc {
                let [x, y] = [x + dx, y + dy];
                if (0..2 * self.half[0]).contains(&x) && (0..2 * self.half[1]).contains(&y) {
                    let cell = &mut near[y as usize * width + x as usize];
                    *cell = cell.max(value);
                }
            }
        }
        near
    }

    /// Of each cell: whether the map knows its middle to be free.
    fn known(&self, walls: &Walls<'_>) -> Vec<bool> {
        let middle = |at: usize, half: i64| (at as i64 - half) as f64 + 0.5;
        let of_row = |y: usize| {
            (0..self.width()).map(move |x| {
                let place = [middle(x, self.half[0]), middle(y, self.half[1])].map(|cells| cells * self.step_m);
                walls.occupancy(place) == Occupancy::Free
            })
        };
        (0..(2 * self.half[1]) as usize).flat_map(of_row).collect()
    }
}

/// The best poses of all, best first, no two of which are within two steps of each other.
pub(super) fn search(a: &Walls<'_>, b: &Walls<'_>, lattice: &Lattice, keep: usize) -> Vec<Candidate> {
    let mut search = Search::new(a, b, lattice);
    let mut candidates = Vec::new();
    for number in 0..lattice.headings {
        search.at_heading(lattice.heading(number), &mut candidates);
    }
    candidates.sort_by(|x: &Candidate, y| y.score.total_cmp(&x.score));
    let mut kept: Vec<Candidate> = Vec::new();
    for candidate in candidates {
        if kept.iter().all(|known| displacement(known.a_from_b, candidate.a_from_b, b) > 2.0 * lattice.step_m) {
            kept.push(candidate);
            if kept.len() == keep {
                break;
            }
        }
    }
    kept
}

/// By how much walls of the second map lie elsewhere by one pose than by another, root mean square.
pub(super) fn displacement(one: Pose2, other: Pose2, b: &Walls<'_>) -> f64 {
    let turn = (one.theta - other.theta) / 2.0;
    one.distance(other).hypot(2.0 * b.rms_radius_m * sin_cos(turn).0)
}

struct Search<'a> {
    b: &'a Walls<'a>,
    step_m: f64,
    /// Of the second map, in cells half as large, for it is turned.
    ratios: Raster,
    /// What a surface of the second map counts, and what a coarse cell of them does at most is 1.
    weight: f32,
    radius_cells: i64,
    /// The first map's, transformed.
    of_a: Image,
    turned: Image,
    of_b: Image,
    scores: Image,
    transform: Transform,
}

impl<'a> Search<'a> {
    fn new(a: &Walls<'_>, b: &'a Walls<'a>, lattice: &Lattice) -> Self {
        let (step_m, [width, height]) = (lattice.step_m, lattice.sides);
        let reach_m = REACH_STEPS * step_m;
        let mut transform = Transform::new(width, height);
        let ratios = Raster::of(a, step_m, reach_m);
        let mut image = Image::new(width, height);
        for (at, &ratio) in ratios.ratios.iter().enumerate() {
            let x = (at % ratios.width()) as i64 - ratios.half[0];
            let y = (at / ratios.width()) as i64 - ratios.half[1];
            let into = wrapped(&image, [x, y]);
            image.re[into] = ratio;
        }
        let weight = (a.map.resolution_m / step_m) as f32;
        for surface in &a.surfaces {
            let at = wrapped(&image, surface.at.map(|m| (m / step_m).floor() as i64));
            image.im[at] = (image.im[at] + weight).min(1.0);
        }
        let mut of_a = Image::new(height, width);
        transform.forward(&mut image, &mut of_a);
        Self {
            b,
            step_m,
            ratios: Raster::of(b, step_m / 2.0, reach_m),
            weight: (b.map.resolution_m / step_m) as f32,
            radius_cells: ((b.radius_m() + reach_m) / step_m).ceil() as i64,
            of_a,
            turned: image,
            of_b: Image::new(height, width),
            scores: Image::new(width, height),
            transform,
        }
    }

    fn at_heading(&mut self, heading_rad: f64, candidates: &mut Vec<Candidate>) {
        self.turn(heading_rad);
        self.transform.forward(&mut self.turned, &mut self.of_b);
        self.transform.correlation(&self.of_a, &self.of_b, &mut self.scores);
        for (score, [x, y]) in peaks(&self.scores) {
            let [x, y] = [x, y].map(|cells| cells as f64 * self.step_m);
            candidates.push(Candidate { a_from_b: Pose2::new(x, y, heading_rad), score });
        }
    }

    /// Draws the second map, turned about its middle.
    fn turn(&mut self, heading_rad: f64) {
        let (s, c) = sin_cos(heading_rad);
        let image = &mut self.turned;
        image.clear();
        for surface in &self.b.surfaces {
            let [x, y] = surface.at;
            let at = wrapped(image, [c * x - s * y, s * x + c * y].map(|m| (m / self.step_m).floor() as i64));
            image.re[at] = (image.re[at] + self.weight).min(1.0);
        }
        let middle = |cells: i64| (cells as f64 + 0.5) * self.step_m;
        for v in -self.radius_cells..self.radius_cells {
            for u in -self.radius_cells..self.radius_cells {
                let [x, y] = [middle(u), middle(v)];
                if let Some(at) = self.ratios.index([c * x + s * y, c * y - s * x]) {
                    let into = wrapped(image, [u, v]);
                    image.im[into] = self.ratios.ratios[at];
                }
            }
        }
    }
}

/// Index of a pixel, counted cyclically.
fn wrapped(image: &Image, [x, y]: [i64; 2]) -> usize {
    // Sides are powers of two.
    let (x, y) = (x as usize & (image.width - 1), y as usize & (image.height - 1));
    y * image.width + x
}

/// The best pixels that none of the eight around is better than, and their shift.
fn peaks(scores: &Image) -> Vec<(f32, [i64; 2])> {
    let (width, height) = (scores.width, scores.height);
    let mut best: Vec<(f32, usize)> = Vec::with_capacity(SHIFTS_PER_HEADING + 1);
    let mut least = 0.0;
    for at in 0..scores.re.len() {
        let score = scores.re[at];
        if score > least && is_peak(scores, at) {
            let place = best.partition_point(|known| known.0 >= score);
            best.insert(place, (score, at));
            best.truncate(SHIFTS_PER_HEADING);
            least = if best.len() == SHIFTS_PER_HEADING { best[SHIFTS_PER_HEADING - 1].0 } else { 0.0 };
        }
    }
    let signed = |at: usize, side: usize| if 2 * at >= side { at as i64 - side as i64 } else { at as i64 };
    let pixels = (width * height) as f32;
    best.into_iter()
        .map(|(score, at)| (score / pixels, [signed(at % width, width), signed(at / width, height)]))
        .collect()
}

fn is_peak(scores: &Image, at: usize) -> bool {
    let (x, y) = ((at % scores.width) as i64, (at / scores.width) as i64);
    let around = (-1..=1).flat_map(|dy| (-1..=1).map(move |dx| [x + dx, y + dy]));
    around.map(|cell| scores.re[wrapped(scores, cell)]).all(|other| other <= scores.re[at])
}
