//! Submaps: what was seen along a few metres of the way, as one small map.

use crate::views::View;
use mapwright_geom::Pose2;
use mapwright_grid::{Change, LocalMap, LocalMapSettings};
use mapwright_sensor::{BeamTable, SweepPoints};

/// Standard deviation by which closeness is judged: so many times that of the laser, no less and no more than so many cells.
const CLOSENESS_SIGMAS: f64 = 1.25;
const CLOSENESS_CELLS: [f64; 2] = [0.5, 1.0];
/// Median of the offset of a hit from the line through its neighbours with a standard deviation of 1: `0.6745 sqrt(1.5)`.
const MEDIAN_OFFSET: f64 = 0.826;

/// How submaps are drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaneSubmapSettings {
    /// Side of a cell, metres.
    pub resolution_m: f64,
    /// A cell is an obstacle while `hits * passes_per_hit >= passes`.
    pub passes_per_hit: u32,
    /// A beam without return clears free space up to here, metres.
    pub free_range_m: f64,
    /// End points farther from the submap's origin are not compared, metres.
    pub reach_m: f64,
    /// Of the end points within as many cells along x and y one is compared.
    pub thin_cells: u32,
}

/// A small map of what was seen along a few metres of the way.
#[derive(Debug, Clone)]
pub struct PlaneSubmap {
    /// The map, in the submap's frame.
    pub map: LocalMap,
    /// End points that the other views do not contradict, thinned, in the submap's frame, metres.
    pub hits: Vec<[f64; 2]>,
    /// Standard deviation of the end points across surfaces, metres, as neighbours tell it: the laser's noise.
    pub sigma_m: f64,
}

impl PlaneSubmap {
    /// Draws the views.
    #[must_use]
    pub fn new(views: &[View], settings: &PlaneSubmapSettings) -> Self {
        let mut offsets_m = Vec::new();
        let (map, ends) = draw_each(views, settings, |points| offsets_m.extend(points.offsets_m()));
        let hits = thinned(&map, ends, settings);
        let middle = offsets_m.len() / 2;
        let median_m =
            if offsets_m.is_empty() { 0.0 } else { *offsets_m.select_nth_unstable_by(middle, f64::total_cmp).1 };
        Self { map, hits, sigma_m: median_m / MEDIAN_OFFSET }
    }

    /// How closely the end points that are known in another submap lie on the surfaces there, as a share of how closely they
    /// lie on their own: about 0.8 to 1 where they belong.
    #[must_use]
    pub fn closeness(&self, target: &PlaneSubmap, target_from_self: Pose2) -> f64 {
        let [least_m, most_m] = CLOSENESS_CELLS.map(|cells| cells * self.map.settings.resolution_m);
        let sigma_m = (CLOSENESS_SIGMAS * self.sigma_m).clamp(least_m, most_m);
        let own = self.map.closeness(&self.hits, Pose2::IDENTITY, sigma_m);
        if own > 0.0 { target.map.closeness(&self.hits, target_from_self, sigma_m) / own } else { 0.0 }
    }
}

/// The map of some views, and all their end points in its frame; calls with the points of each view.
fn draw_each(
    views: &[View],
    settings: &PlaneSubmapSettings,
    mut call: impl FnMut(&SweepPoints),
) -> (LocalMap, Vec<[f64; 2]>) {
    let mut map = LocalMap::new(LocalMapSettings {
        resolution_m: settings.resolution_m,
        passes_per_hit: settings.passes_per_hit,
        ..LocalMapSettings::default()
    });
    let (mut points, mut table) = (SweepPoints::default(), BeamTable::default());
    let mut ends = Vec::new();
    for view in views {
        points.fill(&view.sweep, &mut table, settings.free_range_m);
        points.fill_normals();
        call(&points);
        map.draw(&points, view.submap_from_keyframe, Change::Add, 0);
        ends.extend(points.hits.iter().map(|&hit| view.submap_from_keyframe.transform(hit)));
    }
    map.refresh();
    (map, ends)
}

/// Of the end points in reach that stand on obstacles, one for each of the larger cells, in the order of these.
fn thinned(map: &LocalMap, mut ends: Vec<[f64; 2]>, settings: &PlaneSubmapSettings) -> Vec<[f64; 2]> {
    let reach2 = settings.reach_m * settings.reach_m;
    ends.retain(|[x, y]| x * x + y * y <= reach2);
    let mut gone = vec![false; ends.len()];
    let _ = map.agreement_of_each(&ends, Pose2::IDENTITY, |hit| gone[hit] = true);
    let side_m = settings.resolution_m * f64::from(settings.thin_cells.max(1));
    let cell = |[x, y]: [f64; 2]| ((y / side_m).floor() as i64, (x / side_m).floor() as i64);
    let mut keyed: Vec<((i64, i64), usize)> =
        (0..ends.len()).filter(|&k| !gone[k]).map(|k| (cell(ends[k]), k)).collect();
    // Neighbouring beams end in the same cell.
    keyed.dedup_by_key(|(cell, _)| *cell);
    keyed.sort_unstable();
    keyed.dedup_by_key(|(cell, _)| *cell);
    keyed.into_iter().map(|(_, k)| ends[k]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright_sensor::Sweep;
    use mapwright_sim::{Drive, DriveSettings, TrueScan, worlds};
    use std::sync::Arc;

    const SETTINGS: PlaneSubmapSettings =
        PlaneSubmapSettings { resolution_m: 0.05, passes_per_hit: 5, free_range_m: 8.0, reach_m: 15.0, thin_cells: 2 };

    /// What a laser of such noise has seen of the same rooms, and where it stood at the end.
    fn seen(sigma_m: f64, seed: u64, seconds: std::ops::Range<usize>) -> (PlaneSubmap, Pose2) {
        let mut drive = DriveSettings { scan_rate_hz: 1.0, seed, ..DriveSettings::default() };
        drive.laser.range_sigma_m = sigma_m;
        let scans = Drive::new(worlds::rooms(3).into(), drive).scans().take(seconds.end).skip(seconds.start);
        let scans: Vec<TrueScan> = scans.collect();
        let here = scans[scans.len() - 1].world_from_robot;
        let view = |scan: &TrueScan| {
            let mut sweep = Sweep::empty(&scan.scan.laser);
            let _ = sweep.fill(&scan.scan, [0.0; 3], (0.1, 30.0));
            View { sweep: Arc::new(sweep), submap_from_keyframe: here.between(scan.world_from_robot) }
        };
        (PlaneSubmap::new(&scans.iter().map(view).collect::<Vec<_>>(), &SETTINGS), here)
    }

    #[test]
    fn closeness_tells_where_they_belong_whatever_the_noise() {
        for sigma_m in [0.0, 0.005, 0.02, 0.03, 0.06] {
            let ((old, there), (new, here)) = (seen(sigma_m, 3, 20..45), seen(sigma_m, 4, 30..40));
            let truth = there.between(here);
            let at = |dx: f64, dy: f64| new.closeness(&old, truth * Pose2::new(dx, dy, 0.0));
            let (right, beside, away) = (at(0.0, 0.0), at(0.06, 0.06), at(0.6, 0.6));
            assert!((0.85..1.1).contains(&right), "{right} with a noise of {sigma_m} m");
            assert!(beside < right - if sigma_m > 0.03 { 0.05 } else { 0.2 }, "{beside} with a noise of {sigma_m} m");
            assert!(away < 0.3, "{away} with a noise of {sigma_m} m");
            assert!(
                at(500.0, 0.0).abs() < f64::EPSILON && PlaneSubmap::new(&[], &SETTINGS).closeness(&old, truth) == 0.0
            );
        }
    }

    #[test]
    fn neighbours_tell_the_noise_of_the_laser() {
        for sigma_m in [0.0, 0.01, 0.02, 0.03] {
            let estimate_m = seen(sigma_m, 3, 20..45).0.sigma_m;
            assert!((estimate_m - sigma_m).abs() < 0.001 + 0.1 * sigma_m, "{estimate_m}, expected {sigma_m}");
        }
        assert!(PlaneSubmap::new(&[], &SETTINGS).sigma_m == 0.0);
    }
}
