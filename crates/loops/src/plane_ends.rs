//! End points of views: what can be told of them without drawing a map.

use crate::views::View;
use mapwright_geom::Pose2;
use mapwright_grid::{SearchSettings, floor_cell};
use mapwright_sensor::{BeamTable, SweepPoints};
use rustc_hash::FxHashMap;

/// End points, one of those in each cell as wide as the standard deviation by which a search scores them.
#[derive(Debug, Clone)]
pub(crate) struct Ends {
    sigma_m: f64,
    cells: FxHashMap<(i32, i32), [f64; 2]>,
}

impl Ends {
    /// Those of views, in their submap's frame.
    pub(crate) fn of(views: &[View]) -> Self {
        let mut ends = Self { sigma_m: SearchSettings::default().sigma_m, cells: FxHashMap::default() };
        let mut last = None;
        for end in end_points(views) {
            let cell = ends.cell(end);
            // Neighbouring beams end in the same cell.
            if last.replace(cell) != Some(cell) {
                ends.cells.entry(cell).or_insert(end);
            }
        }
        ends
    }

    fn cell(&self, end: [f64; 2]) -> (i32, i32) {
        let [x, y] = end.map(|metres| floor_cell(metres / self.sigma_m));
        (x, y)
    }

    /// How likely end points of other views are at a pose, 0 to 1, as a search scores them; no more than that, for of each cell one end point
    /// counts.
    pub(crate) fn likelihood(&self, query: &[View], target_from_query: Pose2) -> f64 {
        let (mut sum, mut count) = (0.0, 0_usize);
        let mut last = None;
        let placed = mover(target_from_query);
        for end in end_points(query) {
            let end = placed(end);
            let cell = self.cell(end);
            if last.replace(cell) != Some(cell) {
                sum += (-0.5 * self.nearest2(end, cell) / (self.sigma_m * self.sigma_m)).exp();
                count += 1;
            }
        }
        sum / count.max(1) as f64
    }

    /// Squared distance to the nearest end point of the cells around, square metres.
    fn nearest2(&self, [x, y]: [f64; 2], (cell_x, cell_y): (i32, i32)) -> f64 {
        let around = (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (cell_x + dx, cell_y + dy)));
        let known = around.filter_map(|cell| self.cells.get(&cell));
        known.map(|[a, b]| (a - x).powi(2) + (b - y).powi(2)).fold(f64::INFINITY, f64::min)
    }
}

/// Points as seen from a pose's frame; its sine and cosine are taken once.
fn mover(pose: Pose2) -> impl Fn([f64; 2]) -> [f64; 2] {
    let (s, c) = pose.theta.sin_cos();
    move |[x, y]| [pose.x + c * x - s * y, pose.y + s * x + c * y]
}

/// End points of views, in their submap's frame.
pub(crate) fn end_points(views: &[View]) -> Vec<[f64; 2]> {
    let (mut points, mut table, mut ends) = (SweepPoints::default(), BeamTable::default(), Vec::new());
    for view in views {
        points.fill(&view.sweep, &mut table, 0.0);
        ends.extend(points.hits.iter().copied().map(mover(view.submap_from_keyframe)));
    }
    ends
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright_sensor::Sweep;
    use mapwright_sim::{Drive, DriveSettings, worlds};
    use std::sync::Arc;

    #[test]
    fn end_points_are_likely_where_they_were_seen_and_nowhere_else() {
        let settings = DriveSettings { scan_rate_hz: 1.0, seed: 3, ..DriveSettings::default() };
        let taken: Vec<_> = Drive::new(worlds::rooms(3).into(), settings).scans().take(30).collect();
        let here = taken[29].world_from_robot;
        let views = |range: std::ops::Range<usize>| -> Vec<View> {
            let view = |k: usize| {
                let mut sweep = Sweep::empty(&taken[k].scan.laser);
                let _ = sweep.fill(&taken[k].scan, [0.0; 3], (0.1, 30.0));
                View { sweep: Arc::new(sweep), submap_from_keyframe: here.between(taken[k].world_from_robot) }
            };
            range.map(view).collect()
        };
        let (ends, query) = (Ends::of(&views(0..29)), views(29..30));
        let at = |x, y, theta| ends.likelihood(&query, Pose2::new(x, y, theta));
        assert!(at(0.0, 0.0, 0.0) > 0.7, "{}", at(0.0, 0.0, 0.0));
        for elsewhere in [at(1.5, 1.5, 0.0), at(0.0, 0.0, 0.5), at(100.0, 0.0, 0.0)] {
            assert!(elsewhere < 0.45, "{elsewhere}");
        }
        assert!(ends.likelihood(&[], Pose2::IDENTITY).abs() < f64::EPSILON);
        assert!(Ends::of(&[]).likelihood(&query, Pose2::IDENTITY).abs() < f64::EPSILON);
    }
}
