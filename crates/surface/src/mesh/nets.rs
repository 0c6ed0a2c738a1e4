//! Surface nets over blocks.

use super::cases::{Case, NO_SHEET, all, ends};
use super::grid::Grid;
use super::{Mesh, MeshSettings};
use crate::block::Block;
use crate::key::{BLOCK_BITS, BLOCK_SIDE, BLOCK_VOXELS, Key, pack, unpack, within_block};
use crate::sketch::WEIGHT_MOST;
use crate::volume::Volume;
use rustc_hash::FxHashMap;

/// The vertices of a block's cells.
struct Part {
    key: Key,
    /// Of each cell the case, and its first vertex among those of the block; no case where it has none.
    cells: Box<[(u8, u16); BLOCK_VOXELS]>,
    vertices: Vec<Vertex>,
}

#[derive(Clone, Copy)]
struct Vertex {
    position_m: [f32; 3],
    normal: [f32; 3],
    colour: Option<[u8; 3]>,
}

/// A vertex whose views had no colour among others that have one.
const GREY: [u8; 3] = [128; 3];

pub(super) fn mesh_of(volume: &Volume, settings: &MeshSettings) -> Mesh {
    let blocks = volume.sorted_blocks();
    let cases = all();
    let least_weight = settings.least_weight.max(0.0) * f64::from(WEIGHT_MOST);
    let parts: Vec<Part> = by_threads(&blocks, settings.threads, |blocks| {
        blocks.iter().filter_map(|block| part_of(volume, block, &cases, least_weight)).collect()
    });
    let firsts: Vec<u32> = parts
        .iter()
        .scan(0_u32, |next, part| {
            let first = *next;
            *next = next.saturating_add(part.vertices.len() as u32);
            Some(first)
        })
        .collect();
    let net = Net { places: (0..).zip(&parts).map(|(place, part)| (part.key, place)).collect(), parts: &parts, firsts };
    let numbers: Vec<usize> = (0..parts.len()).collect();
    let triangles = by_threads(&numbers, settings.threads, |numbers| {
        numbers.iter().flat_map(|&number| net.triangles(number, &cases)).collect()
    });
    let vertices = || parts.iter().flat_map(|part| &part.vertices);
    let is_coloured = vertices().any(|vertex| vertex.colour.is_some());
    let colours = vertices().filter(|_| is_coloured).map(|vertex| vertex.colour.unwrap_or(GREY));
    Mesh {
        positions_m: vertices().map(|vertex| vertex.position_m).collect(),
        normals: vertices().map(|vertex| vertex.normal).collect(),
        colours: colours.collect(),
        triangles,
    }
}

/// Works on consecutive shares of something; results follow each other in its order.
fn by_threads<T: Sync, R: Send>(all: &[T], threads: usize, work: impl Fn(&[T]) -> Vec<R> + Sync) -> Vec<R> {
    if threads <= 1 || all.len() < 2 {
        return work(all);
    }
    let share = all.len().div_ceil(threads);
    std::thread::scope(|scope| {
        let work = &work;
        let start = |share| std::thread::Builder::new().spawn_scoped(scope, move || work(share)).map_err(|_| share);
        let running: Vec<_> = all.chunks(share).map(start).collect();
        let finish = |one: Result<std::thread::ScopedJoinHandle<'_, Vec<R>>, &[T]>| match one {
            Ok(thread) => thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)),
            // No thread was to be had.
            Err(share) => work(share),
        };
        running.into_iter().flat_map(finish).collect()
    })
}

/// The vertices of a block; none where it has none.
fn part_of(volume: &Volume, block: &Block, cases: &[Case; 256], least_weight: f64) -> Option<Part> {
    block.near.as_ref()?;
    let grid = Grid::of(volume, block);
    let mut part = Part { key: block.key, cells: Box::new([(0, 0); BLOCK_VOXELS]), vertices: Vec::new() };
    let corner = unpack(block.key).map(|v| f64::from(v << BLOCK_BITS));
    for cell in 0..BLOCK_VOXELS {
        let place = [0, 1, 2].map(|k| cell >> (k * BLOCK_BITS as usize) & (BLOCK_SIDE as usize - 1));
        let Some(distances) = grid.cell(place, least_weight) else { continue };
        let behind = (0..8).filter(|&k| distances[k] < 0.0).fold(0_usize, |bits, k| bits | 1 << k);
        let case = &cases[behind];
        if case.sheets == 0 {
            continue;
        }
        part.cells[cell] = (behind as u8, part.vertices.len() as u16);
        for sheet in 0..case.sheets {
            let at = middle(&distances, case, sheet);
            let position_m =
                [0, 1, 2].map(|k| ((corner[k] + place[k] as f64 + at[k]) * volume.settings().voxel_m) as f32);
            let normal = gradient(&distances, at);
            part.vertices.push(Vertex { position_m, normal, colour: colour_of(&grid, place, case, sheet) });
        }
    }
    (!part.vertices.is_empty()).then_some(part)
}

fn edges_of(case: &Case, sheet: u8) -> impl Iterator<Item = usize> + '_ {
    (0..12).filter(move |&edge| case.sheet[edge] == sheet)
}

/// The mean of where the edges of a sheet are crossed, within its cell of side one.
fn middle(distances: &[f32; 8], case: &Case, sheet: u8) -> [f64; 3] {
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    for edge in edges_of(case, sheet) {
        let [low, high] = ends(edge);
        let [from, to] = [low, high].map(|corner| f64::from(distances[corner]));
        (0..3).for_each(|k| sum[k] += (low >> k & 1) as f64);
        sum[edge / 4] += from / (from - to);
        count += 1.0;
    }
    sum.map(|v| v / count)
}

/// The direction in which distances rise at a place within a cell, from their trilinear interpolation; up where they do not.
fn gradient(distances: &[f32; 8], at: [f64; 3]) -> [f32; 3] {
    let share = |k: usize, side: usize| if side == 1 { at[k] } else { 1.0 - at[k] };
    let along = |axis: usize| -> f64 {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let edges = (0..4).map(|k| (k & 1, k >> 1));
        let rise = |(bu, bv): (usize, usize)| {
            let low = bu << u | bv << v;
            share(u, bu) * share(v, bv) * f64::from(distances[low | 1 << axis] - distances[low])
        };
        edges.map(rise).sum()
    };
    let rise = [along(0), along(1), along(2)];
    let length = rise.iter().map(|v| v * v).sum::<f64>().sqrt();
    if length > 0.0 { rise.map(|v| (v / length) as f32) } else { [0.0, 0.0, 1.0] }
}

/// The mean colour at the ends of the edges of a sheet.
fn colour_of(grid: &Grid<'_>, place: [usize; 3], case: &Case, sheet: u8) -> Option<[u8; 3]> {
    let mut sums = [0_u64; 4];
    for corner in edges_of(case, sheet).flat_map(ends) {
        let colour = grid.colour([0, 1, 2].map(|k| place[k] + (corner >> k & 1)));
        sums.iter_mut().zip(colour).for_each(|(sum, part)| *sum += u64::from(part));
    }
    let [red, green, blue, weight] = sums;
    (weight > 0).then(|| [red, green, blue].map(|sum| ((sum + weight / 2) / weight) as u8))
}

/// All blocks' vertices.
struct Net<'a> {
    parts: &'a [Part],
    places: FxHashMap<Key, usize>,
    firsts: Vec<u32>,
}

impl Net<'_> {
    /// The triangles around the edges that begin in a block.
    fn triangles(&self, number: usize, cases: &[Case; 256]) -> Vec<[u32; 3]> {
        let part = &self.parts[number];
        let place = unpack(part.key);
        let before: [Option<usize>; 8] = std::array::from_fn(|back| {
            let key = pack([0, 1, 2].map(|k| place[k] - (back >> k & 1) as i32));
            self.places.get(&key).copied()
        });
        let mut triangles = Vec::new();
        for cell in (0..BLOCK_VOXELS).filter(|&cell| part.cells[cell].0 != 0) {
            let at = [0, 1, 2].map(|k| (cell >> (k * BLOCK_BITS as usize) & (BLOCK_SIDE as usize - 1)) as i32);
            let behind = part.cells[cell].0;
            for axis in (0..3).filter(|&axis| (behind & 1) != (behind >> (1 << axis) & 1)) {
                let corner = |bu: i32, bv: i32| {
                    let mut at = at;
                    at[(axis + 1) % 3] -= bu;
                    at[(axis + 2) % 3] -= bv;
                    self.vertex(&before, at, 4 * axis + (bu + 2 * bv) as usize, cases)
                };
                let (Some(a), Some(b), Some(c), Some(d)) = (corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1))
                else {
                    continue;
                };
                // Counterclockwise seen from along the axis, where the surface is seen from if its beginning lies behind.
                let square = if behind & 1 == 1 { [a, b, c, d] } else { [a, d, c, b] };
                self.split(square, &mut triangles);
            }
        }
        triangles
    }

    /// The vertex of the sheet of a cell that crosses one of its edges, by its place among all; the cell may lie in a block before.
    fn vertex(&self, before: &[Option<usize>; 8], at: [i32; 3], edge: usize, cases: &[Case; 256]) -> Option<u32> {
        let back = (0..3).fold(0, |bits, k| bits | usize::from(at[k] < 0) << k);
        let number = before[back]?;
        let (behind, first) = self.parts[number].cells[within_block(at)];
        let sheet = cases[usize::from(behind)].sheet[edge];
        (sheet != NO_SHEET).then(|| self.firsts[number] + u32::from(first) + u32::from(sheet))
    }

    /// Two triangles of a square, along the shorter diagonal.
    fn split(&self, [a, b, c, d]: [u32; 4], triangles: &mut Vec<[u32; 3]>) {
        let apart2 = |from: u32, to: u32| {
            let (from, to) = (self.position_m(from), self.position_m(to));
            (0..3).map(|k| (from[k] - to[k]).powi(2)).sum::<f32>()
        };
        triangles.extend(if apart2(a, c) <= apart2(b, d) { [[a, b, c], [a, c, d]] } else { [[a, b, d], [b, c, d]] });
    }

    fn position_m(&self, vertex: u32) -> [f32; 3] {
        let part = self.firsts.partition_point(|&first| first <= vertex).saturating_sub(1);
        self.parts[part].vertices[(vertex - self.firsts[part]) as usize].position_m
    }
}
