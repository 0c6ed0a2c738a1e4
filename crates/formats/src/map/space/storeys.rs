//! Storeys: heights between which a robot went about, one over the other.

/// No storey is lower, metres.
const STOREY_M: f32 = 2.0;
/// A way that is level stays within so much, metres: what robots and people who carry a sensor bob by.
const LEVEL_M: f32 = 1.0;
/// A level holds this share of the way at least; a ramp or a flight of stairs holds less within [`LEVEL_M`].
const LEVEL_SHARE: f32 = 0.1;
/// Two levels lie over each other where this share of the lower one's way
const OVER_SHARE: f32 = 0.1;
/// has that of the other within so much around it as seen from above, metres: the width of two rooms.
const OVER_M: f32 = 5.0;
/// Bins of heights, metres.
const BIN_M: f32 = 0.1;
/// A floor's bin holds this share of the fullest one's points: the highest such is the floor, the ceiling below has as many.
const FLOOR_SHARE: f32 = 0.5;
/// Storeys are parted so far below the upper floor, metres: its noise is above.
const BELOW_FLOOR_M: f32 = 0.15;
/// Places of the way that are looked at.
const WAY_USED: usize = 600;

/// The heights that part storeys, rising, of points and a way along the axes right, away and up: none of a map of one storey, or where storeys lie beside each other.
pub(super) fn parting_heights(points: &[[f32; 3]], way: &[[f32; 3]]) -> Vec<f32> {
    let way = evenly(way);
    let levels = levels(&way);
    let parted = levels.windows(2).filter(|pair| is_over(&way, pair[0], pair[1]));
    parted.map(|pair| floor(points, &way, pair[0], pair[1]) - BELOW_FLOOR_M).collect()
}

/// Places at even lengths of the way, for a robot that waits says nothing of storeys.
fn evenly(way: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let apart = |a: &[f32; 3], b: &[f32; 3]| (0..3).map(|k| (a[k] - b[k]) * (a[k] - b[k])).sum::<f32>().sqrt();
    let length: f32 = way.windows(2).map(|pair| apart(&pair[0], &pair[1])).sum();
    let step = length / WAY_USED as f32;
    let mut places: Vec<[f32; 3]> = way.first().copied().into_iter().collect();
    let mut gone = 0.0;
    for pair in way.windows(2) {
        gone += apart(&pair[0], &pair[1]);
        if gone > step {
            places.push(pair[1]);
            gone = 0.0;
        }
    }
    places
}

/// Heights that hold much of the way, rising, a storey apart at least.
fn levels(way: &[[f32; 3]]) -> Vec<f32> {
    let mut heights: Vec<f32> = way.iter().map(|place| place[2]).collect();
    heights.sort_unstable_by(f32::total_cmp);
    let least = (LEVEL_SHARE * heights.len() as f32).max(2.0) as usize;
    // How many lie within a level that begins at each, and the middle of them.
    let held = |first: usize| heights.partition_point(|&height| height <= heights[first] + LEVEL_M) - first;
    let mut windows: Vec<(usize, usize)> = (0..heights.len()).map(|first| (held(first), first)).collect();
    windows.sort_unstable_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
    let mut levels: Vec<f32> = Vec::new();
    for (count, first) in windows.into_iter().filter(|(count, _)| *count >= least) {
        let middle = heights[first + count / 2];
        let is_apart = |known: &f32| (middle - known).abs() >= STOREY_M;
        if levels.iter().all(is_apart) {
            levels.push(middle);
        }
    }
    levels.sort_unstable_by(f32::total_cmp);
    levels
}

fn is_over(way: &[[f32; 3]], low: f32, high: f32) -> bool {
    let of = |level: f32| way.iter().filter(move |place| (place[2] - level).abs() <= LEVEL_M);
    let squared = |a: &[f32; 3], b: &[f32; 3]| (a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]);
    let below = of(low).filter(|place| of(high).any(|above| squared(place, above) <= OVER_M * OVER_M)).count();
    below as f32 >= OVER_SHARE * of(low).count() as f32
}

/// The floor of the upper of two storeys: the highest height below its way that holds many points around that way. Halfway between the ways where there are none.
fn floor(points: &[[f32; 3]], way: &[[f32; 3]], low: f32, high: f32) -> f32 {
    let from = (low + 0.5 * (high - low)).max(high - STOREY_M);
    let bins = ((high + 2.0 * BIN_M - from) / BIN_M).clamp(1.0, 1000.0) as usize;
    let mut counts = vec![0_u32; bins];
    let upper: Vec<[f32; 3]> = way.iter().filter(|place| (place[2] - high).abs() <= LEVEL_M).copied().collect();
    let bounds = |k: usize| {
        let ends = |(low, high): (f32, f32), place: &[f32; 3]| (low.min(place[k]), high.max(place[k]));
        upper.iter().fold((f32::INFINITY, f32::NEG_INFINITY), ends)
    };
    let around = [bounds(0), bounds(1)];
    for point in points {
        let is_around = (0..2).all(|k| point[k] >= around[k].0 - OVER_M && point[k] <= around[k].1 + OVER_M);
        let bin = (point[2] - from) / BIN_M;
        if is_around && bin >= 0.0 && (bin as usize) < bins {
            counts[bin as usize] += 1;
        }
    }
    let most = counts.iter().copied().max().unwrap_or(0);
    let is_full = |count: &u32| most > 0 && *count as f32 >= FLOOR_SHARE * most as f32;
    counts.iter().rposition(is_full).map_or(0.5 * (low + high), |bin| from + bin as f32 * BIN_M)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Around a square of so many metres at a height, five centimetres from place to place.
    fn around(side: f32, height: f32) -> Vec<[f32; 3]> {
        let steps = (side / 0.05) as usize;
        let at = |k: usize| k as f32 * 0.05;
        let corner = |k: usize| [[at(k), 0.0], [side, at(k)], [side - at(k), side], [0.0, side - at(k)]];
        (0..4).flat_map(|edge| (0..steps).map(move |k| corner(k)[edge])).map(|[x, y]| [x, y, height]).collect()
    }

    fn slab(side: f32, height: f32) -> impl Iterator<Item = [f32; 3]> {
        let at = move |k: usize| k as f32 * side / 100.0;
        (0..100).flat_map(move |i| (0..100).map(move |j| [at(i), at(j), height]))
    }

    #[test]
    fn two_floors_and_a_ramp_are_two_storeys() {
        let ramp = (0..400).map(|k| [k as f32 * 0.05, 0.0, k as f32 * 0.0075]);
        let way: Vec<[f32; 3]> = around(20.0, 0.0).into_iter().chain(ramp).chain(around(20.0, 3.0)).collect();
        // the sensor is 0.4 m above floors; the lower ceiling is 0.3 m below the upper floor
        let points: Vec<[f32; 3]> = [-0.4, 2.3, 2.6, 5.3].into_iter().flat_map(|height| slab(20.0, height)).collect();
        let parted = parting_heights(&points, &way);
        assert_eq!(parted.len(), 1, "{parted:?}");
        assert!((2.3..2.6).contains(&parted[0]), "{parted:?}");
        // without a floor it is halfway
        let halfway = parting_heights(&[], &way);
        assert!((halfway[0] - (1.5 - BELOW_FLOOR_M)).abs() < 0.2, "{halfway:?}");
        assert!(parting_heights(&points, &around(20.0, 0.0)).is_empty());
    }

    #[test]
    fn a_hill_is_no_house() {
        let hill: Vec<[f32; 3]> = (0..4000).map(|k| [k as f32 * 0.05, 0.0, k as f32 * 0.005]).collect();
        assert!(parting_heights(&[], &hill).is_empty());
        let beside: Vec<[f32; 3]> = around(20.0, 0.0)
            .into_iter()
            .chain(around(20.0, 3.0).into_iter().map(|[x, y, z]| [x + 40.0, y, z]))
            .collect();
        assert!(parting_heights(&[], &beside).is_empty());
        assert!(parting_heights(&[], &[]).is_empty());
    }
}
