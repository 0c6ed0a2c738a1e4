//! Lines and series with fewer points that look the same.

/// Places of the points of a line that are kept so that no other lies farther than `tolerance` from what is drawn (Douglas and Peucker
/// 1973); ends always.
pub(super) fn corners(line: &[[f64; 2]], tolerance: f64) -> Vec<usize> {
    let Some(last) = line.len().checked_sub(1) else { return Vec::new() };
    let mut kept = vec![false; line.len()];
    (kept[0], kept[last]) = (true, true);
    let mut open = vec![(0, last)];
    while let Some((from, to)) = open.pop() {
        let off = |k: usize| (k, distance(line[k], line[from], line[to]));
        let farthest = (from + 1..to).map(off).max_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((k, _)) = farthest.filter(|(_, off)| *off > tolerance) {
            kept[k] = true;
            open.extend([(from, k), (k, to)]);
        }
    }
    (0..line.len()).filter(|&k| kept[k]).collect()
}

/// Distance of a point from the straight piece between two others.
fn distance([x, y]: [f64; 2], a: [f64; 2], b: [f64; 2]) -> f64 {
    let along = [b[0] - a[0], b[1] - a[1]];
    let square = along[0] * along[0] + along[1] * along[1];
    let share = if square > 0.0 { ((x - a[0]) * along[0] + (y - a[1]) * along[1]) / square } else { 0.0 };
    let share = share.clamp(0.0, 1.0);
    (x - a[0] - share * along[0]).hypot(y - a[1] - share * along[1])
}

/// Values over time in at most so many equal spans from the first time to the last, of each the largest value, so that no peak is lost; in
/// the order of time.
pub(super) fn peaks(series: &[(f64, f64)], spans: usize) -> Vec<(f64, f64)> {
    let finite = || series.iter().copied().filter(|(t, v)| t.is_finite() && v.is_finite());
    let (low, high) = finite().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), (t, _)| (a.min(t), b.max(t)));
    let width = (high - low) / spans.max(1) as f64;
    let mut largest: Vec<Option<(f64, f64)>> = vec![None; spans.max(1)];
    for (t, value) in finite() {
        let span = if width > 0.0 { (((t - low) / width) as usize).min(largest.len() - 1) } else { 0 };
        if largest[span].is_none_or(|(_, known)| value > known) {
            largest[span] = Some((t, value));
        }
    }
    largest.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn corners_stay_and_what_lies_between_them_goes() {
        let line = [[0.0, 0.0], [1.0, 0.01], [2.0, 0.0], [2.0, 1.0], [2.0, 5.0], [2.0, 2.0]];
        assert_eq!(corners(&line, 0.1), [0, 2, 4, 5]);
        assert_eq!(corners(&line, 0.001), [0, 1, 2, 4, 5]);
        assert_eq!(corners(&[], 0.1), [0; 0]);
        assert_eq!(corners(&line[..1], 0.1), [0]);
    }

    #[test]
    fn no_peak_is_lost() {
        let series: Vec<(f64, f64)> = (0..1000).map(|k| (f64::from(k), if k == 777 { 9.0 } else { 0.1 })).collect();
        let thinned = peaks(&series, 50);
        assert!(thinned.len() == 50 && thinned.contains(&(777.0, 9.0)));
        assert!(thinned.windows(2).all(|pair| pair[0].0 < pair[1].0));
        assert_eq!(peaks(&[(1.0, 2.0), (1.0, 3.0), (f64::NAN, 9.0)], 10), [(1.0, 3.0)]);
        assert!(peaks(&[], 0).is_empty());
    }
}
