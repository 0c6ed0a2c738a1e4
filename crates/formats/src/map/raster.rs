//! A part of a map in colours.

use super::canvas::{Colour, blend};
use super::confidence::Tint;
use super::frame::Window;
use super::palette::{FREE, UNSEEN, WALL};
use super::{FREE_UP_TO, GridImage, OCCUPIED_FROM};

/// Shares in which cells are shown are told in so many parts.
const FULL: u32 = 256;
/// No cell needs more readings than so many to be shown in full.
const MOST_READINGS: u8 = 8;
/// What is occupied needs so many times fewer: all rays that end at a wall are shared among its cells, all that pass count in each.
const WALL_READINGS_SHARE: u32 = 3;

/// The colours of cells: what few readings tell of is pale.
#[derive(Debug)]
pub(super) struct Shades<'a> {
    seen: Option<&'a [u8]>,
    full_at: u8,
    colours: [Colour; 256],
}

impl<'a> Shades<'a> {
    /// Free cells are shown in full from as many readings on as half of those in the window have.
    pub(super) fn of(map: &GridImage, seen: Option<&'a [u8]>, window: Window) -> Self {
        let colours = std::array::from_fn(|cell| shade(cell as u8));
        let full_at = seen.map_or(1, |seen| usual_readings(map, seen, window).clamp(1, MOST_READINGS));
        Self { seen, full_at, colours }
    }

    /// Whether anything may be pale.
    pub(super) fn fades(&self) -> bool {
        self.full_at > 1
    }

    /// Of so many readings, in parts of [`FULL`].
    fn share(&self, cell: u8, readings: u8) -> u32 {
        let weight = if cell >= OCCUPIED_FROM { WALL_READINGS_SHARE } else { 1 };
        (u32::from(readings) * weight * FULL / u32::from(self.full_at)).min(FULL)
    }

    fn colour(&self, cell: u8, readings: u8) -> Colour {
        let colour = self.colours[usize::from(cell)];
        match self.share(cell, readings) {
            FULL => colour,
            share => blend(UNSEEN, colour, share as f32 / FULL as f32),
        }
    }
}

/// The median over the free cells of a window.
fn usual_readings(map: &GridImage, seen: &[u8], window: Window) -> u8 {
    let mut with = [0_u64; 256];
    for (cells, seen) in window.rows(&map.cells, map.width).zip(window.rows(seen, map.width)) {
        for (_, &readings) in cells.iter().zip(seen).filter(|(cell, _)| **cell <= FREE_UP_TO) {
            with[usize::from(readings)] += 1;
        }
    }
    let half = with.iter().sum::<u64>().div_ceil(2);
    let mut passed = 0;
    let median = with.iter().position(|cells| {
        passed += cells;
        passed >= half
    });
    median.unwrap_or(0) as u8
}

/// A window of the map in colours, perhaps reduced; row of the smallest y first.
#[derive(Debug)]
pub(super) struct Raster {
    width: usize,
    height: usize,
    pub(super) cells_per_px: usize,
    /// Where in the map its lower left corner lies, cells.
    pub(super) corner: [f64; 2],
    pixels: Vec<Colour>,
    walls: Vec<bool>,
}

impl Raster {
    pub(super) fn of(map: &GridImage, window: Window, cells_per_px: usize, shades: &Shades<'_>) -> Self {
        let [width, height] = [0, 1].map(|k: usize| (window.high[k] - window.low[k]).div_ceil(cells_per_px));
        let corner = window.low.map(|cells| cells as f64);
        let (mut pixels, mut walls) = (Vec::with_capacity(width * height), Vec::with_capacity(width * height));
        let rows: Vec<&[u8]> = window.rows(&map.cells, map.width).collect();
        let seen: Option<Vec<&[u8]>> = shades.seen.map(|seen| window.rows(seen, map.width).collect());
        let readings = |v: usize, u: usize| seen.as_ref().map_or(u8::MAX, |rows| rows[v][u]);
        for first in (0..rows.len()).step_by(cells_per_px) {
            let mut blocks = vec![Block::default(); width];
            for (v, row) in rows.iter().enumerate().skip(first).take(cells_per_px) {
                for (u, &cell) in row.iter().enumerate() {
                    blocks[u / cells_per_px].add(cell, readings(v, u), shades);
                }
            }
            pixels.extend(blocks.iter().map(|block| block.colour(cells_per_px, shades)));
            walls.extend(blocks.iter().map(|block| block.wall.is_some_and(|(_, share)| 2 * share >= FULL)));
        }
        Self { width, height, cells_per_px, corner, pixels, walls }
    }

    /// Makes walls that are thinner than so many pixels as wide: those that no square of that side lies in, and that are no single dots.
    pub(super) fn widen_walls(&mut self, side: usize) {
        if side <= 1 || self.width < side || self.height < side {
            return;
        }
        let thick = self.thick_walls(side);
        let drawn = self.pixels.clone();
        let before = (side - 1) / 2;
        let is_thin = |&at: &usize| self.walls[at] && !thick[at] && self.hangs_together(at);
        for at in (0..drawn.len()).filter(is_thin).collect::<Vec<_>>() {
            let (x, y) = (at % self.width, at / self.width);
            let left = x.saturating_sub(before).min(self.width - side);
            let low = y.saturating_sub(before).min(self.height - side);
            for y in low..low + side {
                for pixel in &mut self.pixels[y * self.width..][left..left + side] {
                    if lightness(*pixel) > lightness(drawn[at]) {
                        *pixel = drawn[at];
                    }
                }
            }
        }
    }

    /// Whether a pixel of a wall has another beside it or at a corner: what stands alone is no wall that a picture should stress.
    fn hangs_together(&self, at: usize) -> bool {
        let (x, y) = (at % self.width, at / self.width);
        let rows = y.saturating_sub(1)..(y + 2).min(self.height);
        let around = rows.flat_map(|y| &self.walls[y * self.width..][x.saturating_sub(1)..(x + 2).min(self.width)]);
        around.filter(|is_wall| **is_wall).count() > 1
    }

    /// The pixels of walls that lie in a square of walls.
    fn thick_walls(&self, side: usize) -> Vec<bool> {
        // Rows of so many from here on, and then so many of these below each other.
        let run = |walls: &[bool], at: usize, step: usize, room: usize| {
            room >= side && (0..side).all(|k| walls[at + k * step])
        };
        let across: Vec<bool> =
            (0..self.walls.len()).map(|at| run(&self.walls, at, 1, self.width - at % self.width)).collect();
        let mut thick = vec![false; self.walls.len()];
        for at in 0..across.len() {
            if run(&across, at, self.width, self.height - at / self.width) {
                (0..side).for_each(|k| thick[at + k * self.width..][..side].fill(true));
            }
        }
        thick
    }

    pub(super) fn tint(&mut self, tint: &Tint) {
        let cells_per_px = self.cells_per_px as f64;
        for (y, row) in self.pixels.chunks_exact_mut(self.width.max(1)).enumerate() {
            tint.apply(row, [self.corner[0], self.corner[1] + y as f64 * cells_per_px], cells_per_px);
        }
    }

    /// Cells as crisp squares, along a row of the map.
    pub(super) fn sample_nearest(&self, row: &mut [Colour], [u, v]: [f64; 2], du: f64) {
        if v < 0.0 || v >= self.height as f64 {
            return;
        }
        let cells = &self.pixels[v as usize * self.width..][..self.width];
        for (x, pixel) in row.iter_mut().enumerate() {
            let u = u + x as f64 * du;
            if u >= 0.0 && u < self.width as f64 {
                *pixel = cells[u as usize];
            }
        }
    }

    /// Bilinear between the centres of pixels, in fixed point with 16 binary places. Enlarged, they are mixed over a pixel of the picture at
    /// their edges alone: cells stay crisp at any angle.
    pub(super) fn sample_between(&self, row: &mut [Colour], [u, v]: [f64; 2], step: [f64; 2]) {
        let fixed = |w: f64| (w * 65_536.0).round() as i64;
        let (mut u, mut v) = (fixed(u - 0.5), fixed(v - 0.5));
        let (du, dv) = (fixed(step[0]), fixed(step[1]));
        let enlarged = (1.0 / step[0].hypot(step[1])).clamp(1.0, 1e3);
        let steepness = (256.0 * enlarged).round() as i64;
        let share = |w: i64| (((((w >> 8 & 255) - 128) * steepness) >> 8) + 128).clamp(0, 256) as u32;
        for pixel in row {
            let (column, line) = (u >> 16, v >> 16);
            // One beyond each side, so that the map's edge fades into what is unseen.
            if (-1..self.width as i64).contains(&column) && (-1..self.height as i64).contains(&line) {
                *pixel = self.between(column, line, share(u), share(v));
            }
            u += du;
            v += dv;
        }
    }

    fn between(&self, column: i64, line: i64, right: u32, up: u32) -> Colour {
        let [a, b] = self.pair(column, line);
        let [c, d] = self.pair(column, line + 1);
        if a == b && a == c && a == d {
            return a;
        }
        let mix = |k: usize| {
            let low = u32::from(a[k]) * (256 - right) + u32::from(b[k]) * right;
            let high = u32::from(c[k]) * (256 - right) + u32::from(d[k]) * right;
            ((low * (256 - up) + high * up + (1 << 15)) >> 16) as u8
        };
        [mix(0), mix(1), mix(2)]
    }

    /// The pixels at a column and the one to its right; unseen beyond the map.
    fn pair(&self, column: i64, line: i64) -> [Colour; 2] {
        if line < 0 || line >= self.height as i64 {
            return [UNSEEN; 2];
        }
        let cells = &self.pixels[line as usize * self.width..][..self.width];
        let at = |column: i64| usize::try_from(column).ok().and_then(|c| cells.get(c)).copied().unwrap_or(UNSEEN);
        [at(column), at(column + 1)]
    }
}

/// The colour of a cell: from free to wall along a smooth step, so that doubtful cells show as such.
pub(super) fn shade(cell: u8) -> Colour {
    if cell > 100 {
        return UNSEEN;
    }
    let t = ((f32::from(cell) - 15.0) / 75.0).clamp(0.0, 1.0);
    blend(FREE, WALL, t * t * (3.0 - 2.0 * t))
}

fn lightness(colour: Colour) -> u32 {
    colour.iter().map(|&value| u32::from(value)).sum()
}

/// The cells that share a pixel.
#[derive(Debug, Clone, Copy, Default)]
struct Block {
    known: u32,
    unseen: u32,
    /// Of the cells' shares, and of the cells by their shares.
    shares: u32,
    sum: u64,
    /// The most occupied of the walls, and in what share it is shown.
    wall: Option<(u8, u32)>,
    /// A cell and its readings, where there is but one.
    last: (u8, u8),
}

impl Block {
    fn add(&mut self, cell: u8, readings: u8, shades: &Shades<'_>) {
        self.last = (cell, readings);
        if cell > 100 {
            self.unseen += 1;
            return;
        }
        let share = shades.share(cell, readings);
        self.known += 1;
        self.shares += share;
        self.sum += u64::from(share) * u64::from(cell);
        if cell >= OCCUPIED_FROM {
            // What is shown the most counts, and of those what is occupied the most.
            let (most, most_share) = self.wall.unwrap_or((0, 0));
            if (share, cell) > (most_share, most) {
                self.wall = Some((cell, share));
            }
        }
    }

    /// The mean of what is known, drawn to its most occupied cell so that thin walls survive, over what is unseen.
    fn colour(&self, cells_per_px: usize, shades: &Shades<'_>) -> Colour {
        if self.known + self.unseen == 1 {
            let (cell, readings) = self.last;
            return shades.colour(cell, readings);
        }
        if self.shares == 0 {
            return UNSEEN;
        }
        let mean = shades.colours[(self.sum / u64::from(self.shares)) as usize];
        // A row of cells across the pixel is enough to make it known.
        let enough = if self.unseen == 0 { self.known } else { cells_per_px as u32 };
        let share = (self.shares as f32 / (enough * FULL) as f32).min(1.0);
        let ground = blend(UNSEEN, mean, share);
        match self.wall {
            Some((most, share)) => blend(ground, shades.colours[usize::from(most)], 0.8 * share as f32 / FULL as f32),
            None => ground,
        }
    }
}
