//! The points of a view by cells whose sides double.

use crate::key::{Key, along, floor, is_within, pack, unpack};
use crate::plane::{Moments, Plane};
use crate::view::{PointCounts, View};
use nalgebra::Vector3;
use rustc_hash::FxHashMap;

/// Points in a cube.
#[derive(Debug, Clone)]
struct Cell {
    key: Key,
    /// From its least corner on, voxels.
    moments: Moments,
    /// The cell around it on the next level.
    parent: u32,
    /// Cells of the first level in it that have points.
    filled: u32,
}

/// What the points of a cell of the first level have besides.
#[derive(Debug, Clone, Default)]
struct Sums {
    colour: [u32; 3],
    origin_m: [f64; 3],
}

/// The points of a view, by cells of the side of a voxel, of two, of four and so on, in the keyframe's frame. Cells are in the order in which points first fell into them.
#[derive(Debug)]
pub(crate) struct Pyramid {
    levels: Vec<Vec<Cell>>,
    sums: Vec<Sums>,
    planes: Vec<Vec<Option<Plane>>>,
    /// Of all points, metres, if it is the same.
    one_origin: Option<[f32; 3]>,
    is_coloured: bool,
}

/// A plane is told by so many points at least, twice what it takes.
const PLANE_POINTS: f64 = 6.0;
/// Points of a plane spread by so much of their cell's side at least, across the way along which they spread most: a line of one ring does not. All
/// over a square it is 0.29.
const PLANE_SPREAD: f64 = 0.1;
/// And their spread across the plane is at most this share of it.
const PLANE_FLATNESS: f64 = 1.0 / 3.0;
/// The same of two planes that meet at right angles and are as wide as long: across the bisector they spread by 0.71 of what they do along the edge.
const EDGE_FLATNESS: f64 = 0.75;
/// Wider gaps between points are not closed, voxels.
const GAP_VOXELS: f64 = 3.0;
/// How far apart points are is told by so many filled cells at least.
const GAP_CELLS: u32 = 6;
/// Cells along the side of those that are drawn one after the other: of a block.
const TOGETHER_BITS: u32 = 3;

impl Pyramid {
    /// Sorts the points of a view into cells of `levels` levels, and finds the planes from level `first` on.
    pub(crate) fn build(view: &View<'_>, voxel_m: f64, first: usize, levels: usize) -> (Self, PointCounts) {
        let mut counts = PointCounts { points: view.points_m.len(), ..PointCounts::default() };
        let is_coloured = !view.colours.is_empty();
        let (mut cells, mut sums, mut places) = (Vec::<Cell>::new(), Vec::<Sums>::new(), FxHashMap::default());
        let (per_m, mut last) = (1.0 / voxel_m, (Key::MAX, 0_u32));
        let scaled = |at_m: [f32; 3]| along(|k| f64::from(at_m[k]) * per_m);
        let one_origin = (view.origins_m.len() == 1).then(|| view.origins_m[0]);
        let mut from = one_origin.map_or([0.0; 3], scaled);
        for (number, &point) in view.points_m.iter().enumerate() {
            if one_origin.is_none() {
                from = scaled(view.origins_m[number]);
            }
            let at = scaled(point);
            let apart2: f64 = (0..3).map(|k| (at[k] - from[k]).powi(2)).sum();
            let is_usable = apart2 >= 1.0 && is_within(at) && is_within(from);
            if !is_usable {
                *why_not(&mut counts, apart2) += 1;
                continue;
            }
            let place = along(|k| floor(at[k]));
            let key = pack(place);
            if key != last.0 {
                let new = cells.len() as u32;
                last = (key, *places.entry(key).or_insert(new));
                if last.1 == new {
                    cells.push(Cell { key, moments: Moments::default(), parent: 0, filled: 1 });
                    sums.push(Sums::default());
                }
            }
            let cell = last.1 as usize;
            cells[cell].moments.add(along(|k| at[k] - f64::from(place[k])));
            if one_origin.is_none() {
                (0..3).for_each(|k| sums[cell].origin_m[k] += f64::from(view.origins_m[number][k]));
            }
            if is_coloured {
                (0..3).for_each(|k| sums[cell].colour[k] += u32::from(view.colours[number][k]));
            }
        }
        let levels = add_levels(cells, levels);
        let of_level = |cells: &Vec<Cell>| cells.iter().map(|cell| plane_of(&cell.moments)).collect();
        let planes =
            levels.iter().enumerate().map(|(level, cells)| if level < first { Vec::new() } else { of_level(cells) });
        let planes = planes.collect();
        (Self { levels, sums, planes, one_origin, is_coloured }, counts)
    }

    /// How many cells there are on the first level.
    pub(crate) fn len(&self) -> usize {
        self.sums.len()
    }

    /// How many cells there are on a level.
    pub(crate) fn cells(&self, level: usize) -> usize {
        self.levels.get(level).map_or(0, Vec::len)
    }

    /// The cell around one of the first level, on another.
    pub(crate) fn cell_around(&self, number: usize, level: usize) -> Option<usize> {
        self.around(number).nth(level).map(|(_, at)| at)
    }

    /// Mean of the points of a cell of the first level, voxels.
    pub(crate) fn mean(&self, number: usize) -> Vector3<f64> {
        let cell = &self.levels[0][number];
        corner(cell.key, 0) + cell.moments.mean()
    }

    /// Mean of where they were seen from, metres.
    pub(crate) fn origin_m(&self, number: usize) -> Vector3<f64> {
        let mean = || Vector3::from(self.sums[number].origin_m) / self.levels[0][number].moments.count;
        self.one_origin.map_or_else(mean, |origin| Vector3::from(origin.map(f64::from)))
    }

    /// Mean of their colours, if they have any.
    pub(crate) fn colour(&self, number: usize) -> Option<[u8; 3]> {
        let count = self.levels[0][number].moments.count as u32;
        self.is_coloured.then(|| self.sums[number].colour.map(|sum| ((sum + count / 2) / count.max(1)) as u8))
    }

    /// The normal of the plane through the points around a cell of the first level, of the least cell from level `first` on in which they spread both ways and lie flat, and that
    /// cell's level; where there is none, of the least that is bent as an edge of a room is. `noise` is the standard deviation of a point, voxels: a
    /// cell whose own points are three of it off the plane is none of it.
    pub(crate) fn plane_around(&self, number: usize, first: usize, noise: f64) -> Option<(Vector3<f64>, usize)> {
        let mean = self.mean(number);
        let with = |flatness: f64| {
            self.around(number).skip(first).find_map(|(level, at)| {
                let plane = (*self.planes[level].get(at)?)?;
                let side = f64::from(1_u32 << level);
                let from_plane = plane.normal.dot(&(mean - corner(self.levels[level][at].key, level) - plane.mean));
                let [across, along] = plane.variances.map(f64::sqrt);
                let is_plane = along >= PLANE_SPREAD * side && across <= flatness * along;
                (is_plane && from_plane.abs() <= 0.5 + 3.0 * noise).then_some((plane.normal, level))
            })
        };
        with(PLANE_FLATNESS).or_else(|| with(EDGE_FLATNESS))
    }

    /// How far apart points are around a cell, voxels: as evenly spread over a face of the cube around it that is filled most, of level `most` at most. Between 1 and [`GAP_VOXELS`].
    pub(crate) fn gap(&self, number: usize, most: usize) -> f64 {
        let told = self.around(number).take(most + 1).filter(|&(level, at)| self.levels[level][at].filled >= GAP_CELLS);
        let spread =
            |(level, at): (usize, usize)| f64::from(1_u32 << level) / f64::from(self.levels[level][at].filled).sqrt();
        let widest = 0.5 * f64::from(1_u32 << most);
        told.map(spread).fold(widest, f64::min).clamp(1.0, GAP_VOXELS)
    }

    /// The cells of the first level, those of one block one after the other: what is drawn lies together in memory.
    pub(crate) fn in_order(&self) -> Vec<usize> {
        let block = |cell: &Cell| pack(unpack(cell.key).map(|v| v >> TOGETHER_BITS));
        let mut order: Vec<(Key, usize)> = self.levels[0].iter().map(block).zip(0..).collect();
        order.sort_unstable();
        order.into_iter().map(|(_, number)| number).collect()
    }

    /// The cells around a cell of the first level, itself the first: level and number.
    fn around(&self, number: usize) -> impl Iterator<Item = (usize, usize)> + '_ {
        let mut at = number;
        self.levels.iter().enumerate().map(move |(level, cells)| {
            let here = at;
            at = cells[here].parent as usize;
            (level, here)
        })
    }
}

/// Which count a point adds to that cannot be used, by the square of its distance from the sensor, voxels.
fn why_not(counts: &mut PointCounts, apart2: f64) -> &mut usize {
    if !apart2.is_finite() {
        &mut counts.not_finite
    } else if apart2 < 1.0 {
        &mut counts.near
    } else {
        &mut counts.far
    }
}

/// The least corner of a cell, voxels.
fn corner(key: Key, level: usize) -> Vector3<f64> {
    Vector3::from(unpack(key).map(|v| f64::from(v << level)))
}

fn plane_of(moments: &Moments) -> Option<Plane> {
    if moments.count < PLANE_POINTS { None } else { moments.plane() }
}

/// The levels above the first, each made of the one before.
fn add_levels(first: Vec<Cell>, levels: usize) -> Vec<Vec<Cell>> {
    let mut all = vec![first];
    for level in 1..levels.max(1) {
        let Some(below) = all.last_mut() else { break };
        let (mut above, mut places) = (Vec::<Cell>::new(), FxHashMap::default());
        for cell in below.iter_mut() {
            let place = unpack(cell.key);
            let key = pack(place.map(|v| v >> 1));
            cell.parent = *places.entry(key).or_insert_with(|| {
                above.push(Cell { key, moments: Moments::default(), parent: 0, filled: 0 });
                above.len() as u32 - 1
            });
            let around = &mut above[cell.parent as usize];
            around.filled += cell.filled;
            around.moments.merge(&cell.moments, place.map(|v| f64::from((v & 1) << (level - 1))));
        }
        all.push(above);
    }
    all
}
