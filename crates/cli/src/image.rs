//! From counts to a map that can be written.

use mapwright::{CountGrid, Pose2};
use mapwright_formats::{GridImage, UNKNOWN};
use std::collections::BTreeMap;
use std::ops::Range;

/// Cells a map file may have; a stray reading far out must not fill the disk.
const MAX_CELLS: u64 = 100_000_000;
/// Shares of the cells cut away on each side until a map fits.
const CUTS: [f64; 6] = [0.001, 0.01, 0.05, 0.15, 0.3, 0.45];

/// A rectangle of cells.
type Window = [Range<i32>; 2];

/// The map, and what it left out.
#[derive(Debug)]
pub(crate) struct MapImage {
    pub(crate) image: GridImage,
    /// How many readings tell of each of its cells, at most 255.
    pub(crate) seen: Vec<u8>,
    /// Known cells beyond the file's bounds.
    pub(crate) cells_left_out: u64,
}

/// Renders the known area, whole where it fits into a file.
pub(crate) fn map_image(counts: &CountGrid, passes_per_hit: u32) -> MapImage {
    let (window, known) = bounds(counts);
    let window = if cells_of(&window) > MAX_CELLS { dense_window(counts) } else { window };
    let [width, height] = [0, 1].map(|k: usize| window[k].len().max(1));
    let (mut cells, mut seen) = (vec![UNKNOWN; width * height], vec![0; width * height]);
    let mut drawn = 0;
    for (x, y, hits, passes) in counts.known_cells() {
        if window[0].contains(&x) && window[1].contains(&y) {
            let at = (y - window[1].start) as usize * width + (x - window[0].start) as usize;
            cells[at] = percent(hits, passes, passes_per_hit);
            seen[at] = hits.saturating_add(passes).min(255) as u8;
            drawn += 1;
        }
    }
    let resolution_m = counts.resolution_m();
    let corner_m = |k: usize| f64::from(window[k].start) * resolution_m;
    let world_from_map = Pose2::new(corner_m(0), corner_m(1), 0.0);
    let image = GridImage { width, height, resolution_m, world_from_map, cells };
    MapImage { image, seen, cells_left_out: known - drawn }
}

/// Occupied from 65 on exactly where the mapper sees an obstacle: hits times `passes_per_hit` reach the passes. Below,
/// few hits among many passes are free and what lies between is left open.
fn percent(hits: u32, passes: u32, passes_per_hit: u32) -> u8 {
    let weight = f64::from(hits) * f64::from(passes_per_hit);
    let share = weight / (weight + f64::from(passes));
    let percent = if share >= 0.5 { 65.0 + 70.0 * (share - 0.5) } else { 64.0 * (2.0 * share).powi(2) };
    percent as u8
}

/// All known cells, and how many there are.
fn bounds(counts: &CountGrid) -> (Window, u64) {
    let (mut low, mut high, mut known) = ([i32::MAX; 2], [i32::MIN; 2], 0);
    for (x, y, ..) in counts.known_cells() {
        known += 1;
        low = [low[0].min(x), low[1].min(y)];
        high = [high[0].max(x), high[1].max(y)];
    }
    let range = |k: usize| if known == 0 { 0..1 } else { low[k]..high[k] + 1 };
    ([range(0), range(1)], known)
}

fn cells_of(window: &Window) -> u64 {
    window.iter().map(|range| (i64::from(range.end) - i64::from(range.start)) as u64).product()
}

/// The part of the map where most cells are, small enough to be written.
fn dense_window(counts: &CountGrid) -> Window {
    let mut lines = [BTreeMap::new(), BTreeMap::new()];
    for (x, y, ..) in counts.known_cells() {
        *lines[0].entry(x).or_insert(0_u64) += 1;
        *lines[1].entry(y).or_insert(0_u64) += 1;
    }
    let cut = |share: f64| [0, 1].map(|k: usize| dense_range(&lines[k], share));
    let fitting = CUTS.into_iter().map(cut).find(|window| cells_of(window) <= MAX_CELLS);
    // Cells in two crowds that are hundreds of kilometres apart: the middle of the first is as good as any.
    fitting.unwrap_or_else(|| cut(0.45).map(|range| range.start..range.start + 10_000))
}

/// From where to where the lines lie without a share of all cells on each side.
fn dense_range(cells_by_line: &BTreeMap<i32, u64>, cut: f64) -> Range<i32> {
    let budget = (cells_by_line.values().sum::<u64>() as f64 * cut) as u64;
    let low = first_beyond(cells_by_line.iter(), budget).unwrap_or(0);
    let high = first_beyond(cells_by_line.iter().rev(), budget).unwrap_or(0);
    low..high.max(low) + 1
}

/// The line at which more cells than the budget have been passed.
fn first_beyond<'a>(mut lines: impl Iterator<Item = (&'a i32, &'a u64)>, budget: u64) -> Option<i32> {
    let mut passed = 0;
    lines.find_map(|(&line, &cells)| {
        passed += cells;
        (passed > budget).then_some(line)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cell_is_occupied_exactly_where_the_mapper_sees_an_obstacle() {
        for hits in 0..60_u32 {
            for passes in u32::from(hits == 0)..300 {
                assert_eq!(percent(hits, passes, 5) >= 65, hits * 5 >= passes && hits > 0, "{hits} {passes}");
            }
        }
        assert_eq!((percent(0, 9, 5), percent(9, 0, 5)), (0, 100));
    }
}
