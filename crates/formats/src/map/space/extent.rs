//! What of a map is shown: where nearly all of its points lie.

/// A share of the points counts as much as so many times this share of the picture's side: what is ten times as sparse as the middle ninety in a hundred
/// is left outside where it lies at an end, and so is a stray wall behind a gap.
const SPARSE: f64 = 10.0;
/// So many of the points may lie outside at each end of each axis.
const OUTSIDE_MOST: f64 = 0.04;
/// The middle of the points, between this share and the rest of it, says how wide they are spread.
const END_SHARE: f64 = 0.05;

/// From where to where along an axis: the ends `low` and `high` of which `(high - low) / spread + SPARSE * share outside` is least, where the middle of the points is
/// spread so far. None where there are no points.
pub(super) fn extent(along: &mut [f32]) -> Option<[f32; 2]> {
    along.sort_unstable_by(f32::total_cmp);
    let (first, last) = (*along.first()?, *along.last()?);
    let count = along.len() as f64;
    let end = (END_SHARE * count) as usize;
    let spread = f64::from(along[along.len() - 1 - end] - along[end]);
    let is_flat = spread <= 1e-6;
    if is_flat {
        return Some([first, last]);
    }
    let most = (OUTSIDE_MOST * count) as usize;
    let cut = |from_end: &dyn Fn(usize) -> f64| {
        let worth = |k: &usize| from_end(*k) / spread - SPARSE * *k as f64 / count;
        (0..=most).max_by(|a, b| worth(a).total_cmp(&worth(b))).unwrap_or(0)
    };
    let low = cut(&|k| f64::from(along[k] - first));
    let high = cut(&|k| f64::from(last - along[along.len() - 1 - k]));
    Some([along[low], along[along.len() - 1 - high]])
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

    use super::*;

    #[test]
    fn a_stray_wall_lies_outside_and_a_sparse_floor_within() {
        let room = || (0..10_000).map(|k| k as f32 * 0.003);
        let wall = |count: usize, at: f32| std::iter::repeat_n(at, count);
        assert_eq!(extent(&mut room().collect::<Vec<_>>()).unwrap(), [0.0, 29.997]);
        let with_wall: Vec<f32> = room().chain(wall(200, -18.0)).collect();
        assert_eq!(extent(&mut with_wall.clone()).unwrap(), [0.0, 29.997]);
        // one that is near costs the picture little, and one of many points is no stray one
        let near: Vec<f32> = room().chain(wall(200, -2.0)).collect();
        assert_eq!(extent(&mut near.clone()).unwrap(), [-2.0, 29.997]);
        let many: Vec<f32> = room().chain(wall(2000, -18.0)).collect();
        assert_eq!(extent(&mut many.clone()).unwrap(), [-18.0, 29.997]);
        // floor that thins out by half
        let sparse: Vec<f32> = room().chain((0..1000).map(|k| 30.0 + k as f32 * 0.006)).collect();
        assert!(extent(&mut sparse.clone()).unwrap()[1] > 35.9);
        assert_eq!(extent(&mut []), None);
        assert_eq!(extent(&mut [2.0]), Some([2.0, 2.0]));
    }
}
