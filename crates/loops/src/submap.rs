//! Submaps: what was seen along a few metres of the way, as one small map.

use mapwright_geom::Pose2;
use mapwright_grid::{Change, LiveMap, LiveMapSettings};
use mapwright_sensor::{BeamTable, Sweep, SweepPoints};

/// What a submap is made of: a keyframe's measurement at its place.
#[derive(Debug, Clone)]
pub struct View {
    /// What the laser saw.
    pub sweep: Sweep,
    /// Where from.
    pub submap_from_keyframe: Pose2,
}

/// How submaps are drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SubmapSettings {
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
pub struct Submap {
    /// The map, in the submap's frame.
    pub map: LiveMap,
    /// End points that the other views do not contradict, thinned, in the submap's frame, metres.
    pub hits: Vec<[f64; 2]>,
}

impl Submap {
    /// Draws the views.
    #[must_use]
    pub fn new(views: &[View], settings: &SubmapSettings) -> Self {
        let (map, ends) = draw(views, settings);
        let hits = thinned(&map, ends, settings);
        Self { map, hits }
    }
}

/// The map of some views, and all their end points in its frame.
pub(crate) fn draw(views: &[View], settings: &SubmapSettings) -> (LiveMap, Vec<[f64; 2]>) {
    let mut map = LiveMap::new(LiveMapSettings {
        resolution_m: settings.resolution_m,
        passes_per_hit: settings.passes_per_hit,
        ..LiveMapSettings::default()
    });
    let (mut points, mut table) = (SweepPoints::default(), BeamTable::default());
    let mut ends = Vec::new();
    for view in views {
        points.fill(&view.sweep, &mut table, settings.free_range_m);
        points.fill_normals();
        map.draw(&points, view.submap_from_keyframe, Change::Add, 0);
        ends.extend(points.hits.iter().map(|&hit| view.submap_from_keyframe.transform(hit)));
    }
    map.refresh();
    (map, ends)
}

/// Of the end points in reach that stand on obstacles, one for each of the larger cells, in the order of these.
fn thinned(map: &LiveMap, mut ends: Vec<[f64; 2]>, settings: &SubmapSettings) -> Vec<[f64; 2]> {
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
