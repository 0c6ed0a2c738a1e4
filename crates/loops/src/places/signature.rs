//! What a place looks like, wherever its frame lies: directions and lengths between pairs of its points.
//!
//! All vectors between two points are counted by length and direction. Moving the frame changes none of them, turning it
//! shifts the directions. Each ring of lengths is kept as Fourier coefficients over the direction, which has a period of
//! half a turn; the turn between two places is where their correlation peaks.

use mapwright_geom::sin_cos;
use std::f64::consts::{FRAC_PI_4, PI};

/// Points farther from the frame's origin are not looked at, metres.
const RADIUS_M: f64 = 8.0;
/// One point is kept of each square of this side, metres, or of larger ones where there are too many.
const CELL_M: f64 = 0.3;
/// Points that are paired.
const MOST_POINTS: usize = 512;
/// With fewer there is no signature.
const LEAST_POINTS: usize = 8;
/// Pairs farther apart are not counted, metres.
const SIGNATURE_REACH_M: f32 = 5.0;
const RINGS: usize = 8;
const DIRECTIONS: usize = 64;
/// Harmonics of half a turn, the constant included.
const HARMONICS: usize = 12;
/// Turns at which two signatures are compared, within half a turn.
const TURNS: usize = 64;
const HALF_TURNS: usize = TURNS / 2 + 1;
/// What the constant counts for beside harmonic `m`: they are weighed by the square root of `m + CONSTANT_SHARE`. Every
/// place has its points at much the same distances, and directions tell them apart.
const CONSTANT_SHARE: f64 = 0.1;
/// Length of a signature as a vector. A sum of products of two is at most its square and fits into 32 bits.
const UNIT: f32 = 16_384.0;
const SCALE: f32 = 1.0 / (UNIT * UNIT);
/// A turn stands out where it makes places so much more alike than another does.
const LEAST_CONTRAST: f32 = 0.02;

/// Rings of harmonics, real and imaginary part; together a vector of length [`UNIT`], or zero.
pub(super) type Signature = [[[i16; 2]; HARMONICS]; RINGS];

/// Whether it is as long at most as signatures are, up to rounding: sums of products fit into 32 bits then.
pub(super) fn is_signature(signature: &Signature) -> bool {
    let squares = signature.iter().flatten().flatten().map(|&value| f64::from(value).powi(2));
    squares.sum::<f64>() <= 1.1 * f64::from(UNIT * UNIT)
}

/// A signature to compare others with.
pub(super) struct Query {
    signature: Signature,
    /// Multiplied by the imaginary unit.
    turned: Signature,
}

/// How alike two places are at the turn at which they are most alike.
#[derive(Debug, Clone, Copy)]
pub(super) struct Likeness {
    /// -1 to 1.
    pub(super) share: f32,
    /// `place_from_query`, to half a turn; `None` where no turn stands out.
    pub(super) turn_rad: Option<f64>,
}

impl Query {
    /// `None` where there is nothing to compare.
    pub(super) fn new(signature: Signature) -> Option<Self> {
        let turned = signature.map(|ring| ring.map(|[re, im]| [-im, re]));
        let some = signature.iter().flatten().flatten().any(|&value| value != 0);
        some.then_some(Self { signature, turned })
    }

    /// The likeness at turns of so many steps either way: its even and its odd part.
    fn parts(&self, place: &Signature, table: &TurnTable) -> [[f32; HALF_TURNS]; 2] {
        let (re, im) = (product(place, &self.signature), product(place, &self.turned));
        let mut parts = [[0.0; HALF_TURNS]; 2];
        let [even, odd] = &mut parts;
        for m in 0..HARMONICS {
            let (re, im) = (re[m] as f32 * SCALE, im[m] as f32 * SCALE);
            for k in 0..HALF_TURNS {
                even[k] += re * table.cosines[m][k];
                odd[k] += im * table.sines[m][k];
            }
        }
        parts
    }

    /// Likeness at the best of all turns.
    pub(super) fn share(&self, place: &Signature, table: &TurnTable) -> f32 {
        let [even, odd] = self.parts(place, table);
        even.iter().zip(&odd).map(|(even, odd)| even + odd.abs()).fold(-1.0, |a, b| if b > a { b } else { a })
    }

    /// The same with the turn.
    pub(super) fn likeness(&self, place: &Signature, table: &TurnTable) -> Likeness {
        let [even, odd] = self.parts(place, table);
        let at = |turn: usize| {
            let turn = turn % TURNS;
            if turn < HALF_TURNS { even[turn] + odd[turn] } else { even[TURNS - turn] - odd[TURNS - turn] }
        };
        let best = (1..TURNS).fold(0, |best, turn| if at(turn) > at(best) { turn } else { best });
        let least = (0..TURNS).map(at).fold(f32::MAX, f32::min);
        let (before, share, after) = (at(best + TURNS - 1), at(best), at(best + 1));
        let bend = before - 2.0 * share + after;
        let aside = if bend < 0.0 { f64::from(0.5 * (before - after) / bend).clamp(-0.5, 0.5) } else { 0.0 };
        let turn_rad = (best as f64 + aside) * PI / TURNS as f64;
        let in_half = if turn_rad > 0.5 * PI { turn_rad - PI } else { turn_rad };
        Likeness { share, turn_rad: (share - least > LEAST_CONTRAST).then_some(in_half) }
    }
}

/// Sums over the rings, by harmonic.
fn product(place: &Signature, query: &Signature) -> [i32; HARMONICS] {
    let mut sums = [0; HARMONICS];
    for (place, query) in place.iter().zip(query) {
        for m in 0..HARMONICS {
            let ([a, b], [c, d]) = (place[m], query[m]);
            sums[m] += i32::from(a) * i32::from(c) + i32::from(b) * i32::from(d);
        }
    }
    sums
}

/// Sines and cosines of each harmonic.
#[derive(Debug, Clone)]
pub(super) struct TurnTable {
    cosines: [[f32; HALF_TURNS]; HARMONICS],
    sines: [[f32; HALF_TURNS]; HARMONICS],
    waves: [[[f32; 2]; DIRECTIONS]; HARMONICS],
}

impl Default for TurnTable {
    fn default() -> Self {
        let wave = |m: usize, step: usize, steps: usize| {
            let (s, c) = sin_cos(2.0 * PI * (m * step % steps) as f64 / steps as f64);
            [c as f32, s as f32]
        };
        Self {
            cosines: std::array::from_fn(|m| std::array::from_fn(|turn| wave(m, turn, TURNS)[0])),
            sines: std::array::from_fn(|m| std::array::from_fn(|turn| wave(m, turn, TURNS)[1])),
            waves: std::array::from_fn(|m| std::array::from_fn(|k| wave(m, k, DIRECTIONS))),
        }
    }
}

/// Makes signatures; keeps its buffers.
#[derive(Debug, Clone, Default)]
pub(super) struct Describer {
    /// Sums and number of the points of each cell.
    cells: Vec<([f64; 2], u32)>,
    points: Vec<[f32; 2]>,
    /// Pairs by ring and direction.
    counts: Vec<[f32; DIRECTIONS]>,
    pub(super) table: TurnTable,
}

impl Describer {
    pub(super) fn describe(&mut self, points: &[[f64; 2]]) -> Signature {
        let cell_m = self.thin(points);
        if self.points.len() < LEAST_POINTS {
            return [[[0; 2]; HARMONICS]; RINGS];
        }
        self.count_pairs(cell_m);
        self.transform()
    }

    /// The mean point of each cell, row by row; the side of the cells it took.
    fn thin(&mut self, points: &[[f64; 2]]) -> f64 {
        let mut cell_m = CELL_M;
        loop {
            self.fill_cells(points, cell_m);
            let mean = |&([x, y], count): &([f64; 2], u32)| {
                let each = 1.0 / f64::from(count);
                (count > 0).then_some([(x * each) as f32, (y * each) as f32])
            };
            self.points.clear();
            self.points.extend(self.cells.iter().filter_map(mean));
            if self.points.len() <= MOST_POINTS {
                return cell_m;
            }
            cell_m *= 1.25;
        }
    }

    fn fill_cells(&mut self, points: &[[f64; 2]], cell_m: f64) {
        let side = (2.0 * RADIUS_M / cell_m) as usize + 1;
        self.cells.clear();
        self.cells.resize(side * side, ([0.0; 2], 0));
        for &[x, y] in points {
            // False for what is not a number.
            if x * x + y * y < RADIUS_M * RADIUS_M {
                let [column, row] = [x, y].map(|v| ((v + RADIUS_M) / cell_m) as usize);
                let ([sum_x, sum_y], count) = &mut self.cells[row.min(side - 1) * side + column.min(side - 1)];
                *sum_x += x;
                *sum_y += y;
                *count = count.saturating_add(1);
            }
        }
    }

    fn count_pairs(&mut self, cell_m: f64) {
        const RINGS_PER_M: f32 = RINGS as f32 / SIGNATURE_REACH_M;
        self.counts.clear();
        self.counts.resize(RINGS, [0.0; DIRECTIONS]);
        // Points come row by row, so that no later one is lower by more than a row.
        let beyond_m = SIGNATURE_REACH_M + cell_m as f32;
        for (k, a) in self.points.iter().enumerate() {
            for b in &self.points[k + 1..] {
                let (x, y) = (b[0] - a[0], b[1] - a[1]);
                let length2_m = x * x + y * y;
                if length2_m >= SIGNATURE_REACH_M * SIGNATURE_REACH_M {
                    if y > beyond_m { break } else { continue }
                }
                // Shared between the two nearest rings.
                let at = length2_m.sqrt() * RINGS_PER_M - 0.5;
                let low = at.max(0.0) as usize;
                let share = (at - low as f32).clamp(0.0, 1.0);
                let direction = direction(x, y);
                self.counts[low.min(RINGS - 1)][direction] += 1.0 - share;
                if low + 1 < RINGS {
                    self.counts[low + 1][direction] += share;
                }
            }
        }
    }

    fn transform(&self) -> Signature {
        let mut values = [[[0.0; 2]; HARMONICS]; RINGS];
        for (ring, counts) in values.iter_mut().zip(&self.counts) {
            for (m, z) in ring.iter_mut().enumerate() {
                // In a real function's energy the constant counts once, the others twice.
                let weight = (CONSTANT_SHARE + m as f64).sqrt() * if m == 0 { 0.5 } else { 1.0 };
                let sum = |part: usize| -> f64 {
                    let terms = counts.iter().zip(&self.table.waves[m]);
                    terms.map(|(&count, wave)| f64::from(count) * f64::from(wave[part])).sum()
                };
                *z = [weight * sum(0), weight * sum(1)];
            }
        }
        let length = values.iter().flatten().flatten().map(|v| v * v).sum::<f64>().sqrt();
        let scale = if length > 0.0 { f64::from(UNIT) / length } else { 0.0 };
        values.map(|ring| ring.map(|z| z.map(|v| (v * scale).round() as i16)))
    }
}

/// Number of the direction of a vector, of which opposite ones are one.
fn direction(x: f32, y: f32) -> usize {
    // Arc tangent to 0.004 rad in plain arithmetic, the same everywhere.
    let eighth = |ratio: f32| ratio * (FRAC_PI_4 as f32 + 0.273 * (1.0 - ratio.abs()));
    let angle_rad =
        if x.abs() >= y.abs() { if x == 0.0 { 0.0 } else { eighth(y / x) } } else { 0.5 * PI as f32 - eighth(x / y) };
    let turns = angle_rad * (DIRECTIONS as f64 / PI) as f32;
    (turns + DIRECTIONS as f32) as usize % DIRECTIONS
}
