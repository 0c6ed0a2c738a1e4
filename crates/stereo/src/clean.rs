//! What is taken out of a map of disparity: what stands alone.

use crate::disparity::DisparityMap;
use crate::lanes::{Kernel, Lanes};

/// Neighbours that lie on one surface differ by no more, pixels (Hirschmueller 2008, section 2.5.1).
const SMOOTH_PX: f32 = 1.0;

/// So many neighbours are known on more than one side.
const MOST_OF_8: u8 = 5;

/// Memory that is used again.
#[derive(Debug, Default)]
pub(crate) struct Cleaner {
    before: Vec<f32>,
    visited: Vec<bool>,
    patch: Vec<u32>,
}

impl Cleaner {
    /// Each known disparity becomes the median of those around it, of 3 x 3 pixels; where one of them is unknown, its own counts
    /// instead. By what it is moved it is in doubt as well.
    pub(crate) fn median(&mut self, map: &mut DisparityMap) {
        let (width, height) = (map.width() as usize, map.height() as usize);
        if width < 3 || height < 3 {
            return;
        }
        self.before.clone_from(&map.disparity);
        for y in 1..height - 1 {
            let rows = [y - 1, y, y + 1].map(|y| &self.before[y * width..][..width]);
            let row = y * width + 1..(y + 1) * width - 1;
            crate::lanes::run(Medians { rows, disparity: &mut map.disparity[row.clone()], sigma: &mut map.sigma[row] });
        }
    }

    /// Fills holes within a surface: an unknown pixel most of whose eight neighbours are known, and lie on one surface, gets their mean. It
    /// may be off by as much as they differ, besides. Beside an edge of depth nothing is filled in, for there is no telling on which side
    /// of it a pixel lies (Hirschmueller 2008, section 2.5.3).
    pub(crate) fn holes(&mut self, map: &mut DisparityMap) {
        let (width, height) = (map.width() as usize, map.height() as usize);
        self.before.clone_from(&map.disparity);
        for y in 1..height.saturating_sub(1) {
            for x in 1..width.saturating_sub(1) {
                let at = y * width + x;
                if self.before[at].is_nan()
                    && let Some((mean, spread)) = mean_around(&self.before, width, at)
                {
                    let around = [at - width, at - 1, at + 1, at + width].map(|at| map.sigma[at]);
                    let sigma = around.into_iter().fold(0.0, f32::max);
                    map.disparity[at] = mean;
                    map.sigma[at] = (sigma * sigma + spread * spread).sqrt();
                }
            }
        }
    }

    /// Disparities of patches of fewer pixels become unknown; a patch is what hangs together by neighbours, left, right,
    /// above and below, on one surface.
    pub(crate) fn speckles(&mut self, map: &mut DisparityMap, least: usize) {
        let width = map.width() as usize;
        self.visited.clear();
        self.visited.resize(map.disparity.len(), false);
        for start in 0..map.disparity.len() {
            if self.visited[start] || map.disparity[start].is_nan() {
                continue;
            }
            self.collect(&map.disparity, width, start);
            if self.patch.len() < least {
                for at in &self.patch {
                    map.disparity[*at as usize] = f32::NAN;
                    map.sigma[*at as usize] = f32::NAN;
                }
            }
        }
    }

    fn collect(&mut self, disparity: &[f32], width: usize, start: usize) {
        let Self { visited, patch, .. } = self;
        patch.clear();
        patch.push(start as u32);
        visited[start] = true;
        let mut next = 0;
        while let Some(&at) = patch.get(next) {
            next += 1;
            let at = at as usize;
            let here = disparity[at];
            let mut look = |to: usize| {
                if !visited[to] && (disparity[to] - here).abs() <= SMOOTH_PX {
                    visited[to] = true;
                    patch.push(to as u32);
                }
            };
            let x = at % width;
            if x > 0 {
                look(at - 1);
            }
            if x + 1 < width {
                look(at + 1);
            }
            if at >= width {
                look(at - width);
            }
            if at + width < disparity.len() {
                look(at + width);
            }
        }
    }
}

/// The mean of the eight pixels around one, and by how much they differ, if most of them are known and lie on one surface.
fn mean_around(disparity: &[f32], width: usize, at: usize) -> Option<(f32, f32)> {
    let (mut low, mut high, mut sum, mut known) = (f32::INFINITY, f32::NEG_INFINITY, 0.0, 0_u8);
    for from in [at - width - 1, at - 1, at + width - 1] {
        for value in &disparity[from..from + 3] {
            if !value.is_nan() {
                (low, high, sum, known) = (low.min(*value), high.max(*value), sum + value, known + 1);
            }
        }
    }
    (known >= MOST_OF_8 && high - low <= SMOOTH_PX).then(|| (sum / f32::from(known), high - low))
}

struct Medians<'a> {
    rows: [&'a [f32]; 3],
    disparity: &'a mut [f32],
    sigma: &'a mut [f32],
}

impl Kernel for Medians<'_> {
    #[inline(always)]
    fn run<L: Lanes>(self, _: L) {
        let count = self.disparity.len();
        let [above, level, below] = self.rows;
        let mut neighbours = [above; 9];
        for k in 0..3 {
            neighbours[k] = &above[k..][..count];
            neighbours[3 + k] = &level[k..][..count];
            neighbours[6 + k] = &below[k..][..count];
        }
        let sigma = &mut self.sigma[..count];
        for x in 0..count {
            let own = neighbours[4][x];
            let mut values = [own; 9];
            for k in 0..9 {
                let value = neighbours[k][x];
                values[k] = if value.is_nan() { own } else { value };
            }
            let median = median_of_9(values);
            let moved = median - own;
            self.disparity[x] = median;
            sigma[x] = (sigma[x] * sigma[x] + moved * moved).sqrt();
        }
    }
}

/// By Paeth's network of exchanges (Graphics Gems, 1990).
#[inline(always)]
fn median_of_9([mut a, mut b, mut c, mut d, mut e, mut f, mut g, mut h, mut i]: [f32; 9]) -> f32 {
    (b, c) = ordered(b, c);
    (e, f) = ordered(e, f);
    (h, i) = ordered(h, i);
    (a, b) = ordered(a, b);
    (d, e) = ordered(d, e);
    (g, h) = ordered(g, h);
    (b, c) = ordered(b, c);
    (e, f) = ordered(e, f);
    (h, i) = ordered(h, i);
    d = ordered(a, d).1;
    f = ordered(f, i).0;
    (e, h) = ordered(e, h);
    g = ordered(d, g).1;
    e = ordered(b, e).1;
    c = ordered(c, f).0;
    e = ordered(e, h).0;
    (e, c) = ordered(e, c);
    e = ordered(g, e).1;
    ordered(e, c).0
}

#[inline(always)]
fn ordered(a: f32, b: f32) -> (f32, f32) {
    if b < a { (b, a) } else { (a, b) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_network_finds_the_median(values: [i8; 9]) {
            let values = values.map(f32::from);
            let mut sorted = values;
            sorted.sort_by(f32::total_cmp);
            prop_assert_eq!(median_of_9(values), sorted[4]);
        }
    }

    fn map(width: u32, disparity: &[f32]) -> DisparityMap {
        let mut map = DisparityMap::default();
        map.reset([width, disparity.len() as u32 / width]);
        map.disparity.copy_from_slice(disparity);
        map.sigma = disparity.iter().map(|d| d * 0.0 + 0.1).collect();
        map
    }

    #[test]
    fn one_that_stands_out_is_moved_and_doubted() {
        let mut map = map(3, &[5.0, 5.0, 5.0, 5.0, 9.0, 6.0, 6.0, 6.0, f32::NAN]);
        Cleaner::default().median(&mut map);
        assert_eq!(map.at(1, 1), Some((6.0, (0.01_f32 + 9.0).sqrt())));
        assert_eq!(map.at(2, 2), None);
    }

    #[test]
    fn holes_are_filled_within_a_surface_only() {
        let nan = f32::NAN;
        let mut inside = map(3, &[5.0, 5.0, nan, 5.5, nan, 6.0, nan, 6.0, 6.0]);
        Cleaner::default().holes(&mut inside);
        let (mean, sigma) = inside.at(1, 1).unwrap();
        assert!((mean - 33.5 / 6.0).abs() < 1e-6 && (sigma - 1.01_f32.sqrt()).abs() < 1e-6, "{mean} {sigma}");
        assert_eq!(inside.at(2, 0), None);
        for at_edge in [[5.0, 5.0, nan, 5.0, nan, nan, 5.0, nan, nan], [5.0, 5.0, 5.0, 5.0, nan, 5.0, 7.0, 7.0, 7.0]] {
            let mut at_edge = map(3, &at_edge);
            Cleaner::default().holes(&mut at_edge);
            assert_eq!(at_edge.at(1, 1), None);
        }
    }

    #[test]
    fn small_patches_go() {
        let nan = f32::NAN;
        let mut map = map(4, &[1.0, 1.5, 9.0, 9.0, 2.0, nan, nan, 9.5, 7.0, 2.0, 2.0, nan]);
        Cleaner::default().speckles(&mut map, 3);
        let known: Vec<bool> = map.disparity().iter().map(|d| !d.is_nan()).collect();
        let t = true;
        let f = false;
        assert_eq!(known, [t, t, t, t, t, f, f, t, f, f, f, f]);
        assert_eq!(map.sigma().iter().filter(|s| s.is_nan()).count(), 6);
    }
}
