//! Which part of a map a picture shows: its walls and the way, without the rays that leave through doors and windows.

use super::GridImage;

/// Squares along the map's longer side, in which walls are looked for.
const SQUARES: usize = 128;
/// A square has a wall if it has so many occupied cells as stand in a row across this share of it.
const WALL_SHARE: usize = 4;
/// Walls that hang together and are less than this share of all say nothing of where the map ends.
const PIECE_SHARE: f64 = 0.01;
/// An occupied cell that fewer readings tell of is no wall: one may have been a stray one, and a second have passed beside it.
const WALL_READINGS: u8 = 3;
/// Shown around walls and way, a share of the longer side.
const RIM_SHARE: f64 = 0.03;

/// A part of the world, along axes that a picture turns to be level: least and greatest place on each, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    pub(super) low_m: [f64; 2],
    pub(super) high_m: [f64; 2],
}

impl Frame {
    /// With all of another frame along the same axes.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            low_m: [0, 1].map(|k: usize| self.low_m[k].min(other.low_m[k])),
            high_m: [0, 1].map(|k: usize| self.high_m[k].max(other.high_m[k])),
        }
    }

    /// Width and height, metres.
    #[must_use]
    pub fn sides_m(&self) -> [f64; 2] {
        [0, 1].map(|k: usize| self.high_m[k] - self.low_m[k])
    }
}

/// Where a view has what: a pixel is `px_from_map * p + offset_px`, downwards from the picture's upper left corner, of a place `p` in the
/// frame of the map, metres.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ViewPlacement {
    /// Pixels along x and y for each metre along the map's axes.
    pub px_from_map: [[f64; 3]; 2],
    /// Where the map's origin is, pixels.
    pub offset_px: [f64; 2],
}

/// A rectangle of cells, the upper bounds exclusive.
#[derive(Debug, Clone, Copy)]
pub(super) struct Window {
    pub(super) low: [usize; 2],
    pub(super) high: [usize; 2],
}

impl Window {
    /// Row by row, that of the smallest y first.
    pub(super) fn rows<'a, T>(&self, cells: &'a [T], width: usize) -> impl Iterator<Item = &'a [T]> {
        let Self { low: [u0, v0], high: [u1, v1] } = *self;
        (v0..v1).map(move |v| &cells[v * width..][u0..u1])
    }
}

/// Least and greatest place on both axes; none where the greatest is not greater.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bounds {
    pub(super) low: [f64; 2],
    pub(super) high: [f64; 2],
}

impl Bounds {
    pub(super) const NONE: Self = Self { low: [f64::INFINITY; 2], high: [f64::NEG_INFINITY; 2] };

    pub(super) fn is_none(&self) -> bool {
        !(0..2).all(|k| self.low[k] <= self.high[k])
    }

    pub(super) fn include(&mut self, place: [f64; 2]) {
        for k in 0..2 {
            self.low[k] = self.low[k].min(place[k]);
            self.high[k] = self.high[k].max(place[k]);
        }
    }

    /// With a rim around it, but for where the other ends.
    pub(super) fn widened_within(&self, other: &Self) -> Self {
        let rim = RIM_SHARE * (0..2).map(|k| self.high[k] - self.low[k]).fold(0.0, f64::max);
        Self {
            low: [0, 1].map(|k: usize| (self.low[k] - rim).max(other.low[k]).min(self.low[k])),
            high: [0, 1].map(|k: usize| (self.high[k] + rim).min(other.high[k]).max(self.high[k])),
        }
    }

    /// To whole numbers outwards.
    pub(super) fn whole(&self) -> Self {
        Self { low: self.low.map(f64::floor), high: self.high.map(f64::ceil) }
    }
}

/// The cells of walls that hang together, columns and rows; `seen` as in [`super::Picture::seen`].
pub(super) fn wall_cells(map: &GridImage, seen: Option<&[u8]>) -> Vec<[usize; 2]> {
    let is_wall = |&at: &usize| {
        let cell = map.cells[at];
        (super::OCCUPIED_FROM..=100).contains(&cell) && seen.is_none_or(|seen| seen[at] >= WALL_READINGS)
    };
    let walls: Vec<[usize; 2]> =
        (0..map.cells.len()).filter(is_wall).map(|at| [at % map.width, at / map.width]).collect();
    let side = map.width.max(map.height).div_ceil(SQUARES).max(2);
    let squares = Squares::of(map, &walls, side);
    let pieces = squares.pieces();
    let mut cells_of = vec![0_usize; pieces.iter().copied().max().map_or(0, |last| last as usize + 1)];
    walls.iter().for_each(|&cell| cells_of[pieces[squares.at(cell)] as usize] += 1);
    // The first piece is that of no wall.
    let all: usize = cells_of.iter().skip(1).sum();
    let counts = |piece: u32| piece > 0 && cells_of[piece as usize] as f64 >= PIECE_SHARE * all as f64;
    walls.into_iter().filter(|&cell| counts(pieces[squares.at(cell)])).collect()
}

/// A map in squares, and how many cells of walls each has.
struct Squares {
    side: usize,
    width: usize,
    walls: Vec<u32>,
}

impl Squares {
    fn of(map: &GridImage, walls: &[[usize; 2]], side: usize) -> Self {
        let [width, height] = [map.width, map.height].map(|cells| cells.div_ceil(side));
        let mut squares = Self { side, width, walls: vec![0; width * height] };
        for &cell in walls {
            let square = squares.at(cell);
            squares.walls[square] += 1;
        }
        squares
    }

    fn at(&self, [column, row]: [usize; 2]) -> usize {
        row / self.side * self.width + column / self.side
    }

    /// Of each square, which piece of touching squares with walls it is in, from 1 on; zero of those without.
    fn pieces(&self) -> Vec<u32> {
        let is_wall = |square: usize| self.walls[square] as usize >= (self.side / WALL_SHARE).max(1);
        let (mut pieces, mut last) = (vec![0; self.walls.len()], 0);
        for first in 0..self.walls.len() {
            if pieces[first] > 0 || !is_wall(first) {
                continue;
            }
            last += 1;
            pieces[first] = last;
            let mut open = vec![first];
            while let Some(square) = open.pop() {
                for other in self.around(square) {
                    if pieces[other] == 0 && is_wall(other) {
                        pieces[other] = last;
                        open.push(other);
                    }
                }
            }
        }
        pieces
    }

    /// A square and its eight neighbours.
    fn around(&self, square: usize) -> impl Iterator<Item = usize> {
        let (column, row) = (square % self.width, square / self.width);
        let columns = column.saturating_sub(1)..(column + 2).min(self.width);
        let rows = row.saturating_sub(1)..(row + 2).min(self.walls.len() / self.width);
        let width = self.width;
        rows.flat_map(move |row| columns.clone().map(move |column| row * width + column))
    }
}
