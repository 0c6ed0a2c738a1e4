//! Single points: noise, and what is left of what moved.

/// Sides of a cell, of how far apart neighbouring points lie on a surface.
const CELL_POINTS: f32 = 2.0;
/// A point is single that has fewer points in its cell and the 26 around it: a line through them has more, a surface some 36.
const LEAST_AROUND: usize = 6;
/// Cells are counted from here on, so that none is below zero.
const ORIGIN: f32 = 1_048_576.0;
const BITS: u32 = 21;

/// Of each point whether it is single.
pub(super) fn are_single(points: &[[f32; 3]], point_m: f32) -> Vec<bool> {
    let per_m = 1.0 / (CELL_POINTS * point_m);
    if !(per_m.is_finite() && per_m > 0.0) {
        return vec![false; points.len()];
    }
    // Casts saturate; what lies beyond two million cells shares the last.
    let part = |v: f32| ((v * per_m).floor() + ORIGIN).clamp(1.0, 2.0 * ORIGIN - 2.0) as u64;
    let key = |p: &[f32; 3]| part(p[0]) << (2 * BITS) | part(p[1]) << BITS | part(p[2]);
    let mut order: Vec<u64> = points.iter().map(key).collect();
    let own = order.clone();
    order.sort_unstable();
    let mut cells: Vec<(u64, usize)> = Vec::new();
    for same in order.chunk_by(|a, b| a == b) {
        cells.push((same[0], same.len()));
    }
    let around = |key: u64| {
        let mut count = 0;
        for dx in -1..=1_i64 {
            for dy in -1..=1_i64 {
                // Cells along the last axis follow each other.
                let middle = key.wrapping_add_signed((dx << (2 * BITS)) + (dy << BITS));
                let from = cells.partition_point(|cell| cell.0 < middle - 1);
                count += cells[from..].iter().take_while(|cell| cell.0 <= middle + 1).map(|cell| cell.1).sum::<usize>();
            }
        }
        count
    };
    let are_single: Vec<bool> = cells.iter().map(|cell| around(cell.0) < LEAST_AROUND).collect();
    let place = |key: &u64| cells.binary_search_by_key(key, |cell| cell.0).is_ok_and(|at| are_single[at]);
    own.iter().map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_and_surfaces_are_no_single_points() {
        let surface = (0..20).flat_map(|i| (0..20).map(move |j| [i as f32 * 0.05, j as f32 * 0.05, -3.0]));
        let line = (0..40).map(|k| [5.0, -7.0, k as f32 * 0.05]);
        let single = [[3.0, 3.0, 3.0], [3.05, 3.0, 3.0], [1e30, 0.0, 0.0], [f32::NAN, 0.0, 0.0]];
        let points: Vec<[f32; 3]> = surface.chain(line).chain(single).collect();
        let found = are_single(&points, 0.05);
        let [surface, rest] = [&found[..400], &found[400..]];
        assert!(!surface.contains(&true));
        assert!(!rest[2..38].contains(&true), "{rest:?}");
        assert_eq!(rest[40..], [true; 4]);
        assert_eq!(are_single(&points, 0.0), vec![false; points.len()]);
    }
}
