//! The map a scan is matched against: counts, the obstacles they make, their distance field and local lines.

use crate::counts::{Change, CountGrid, FRACTION_STEPS};
use crate::field::{DistanceField, NO_OBSTACLE};
use mapwright_geom::Pose2;
use mapwright_sensor::SweepPoints;

/// Where an occupied cell's obstacle is, and how distance to it is measured.
///
/// The squared distance of a point is `d^T A d` with `d` from the mean to the point: `A = n n^T + k t t^T` with normal
/// `n` and tangent `t` of the local line; `k` is 0 on a line and 1 where there is none.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Surfel {
    /// Mean of the end points, metres.
    pub x: f64,
    /// Mean of the end points, metres.
    pub y: f64,
    /// `A`'s upper left.
    pub axx: f32,
    /// `A`'s off-diagonal.
    pub axy: f32,
    /// `A`'s lower right.
    pub ayy: f32,
}

/// Tuning of what counts as an obstacle and as a line.
#[derive(Debug, Clone, Copy)]
pub struct LiveMapSettings {
    /// Side of a cell, metres.
    pub resolution_m: f64,
    /// Radius of the distance field, cells.
    pub radius_cells: u32,
    /// A cell is an obstacle while `hits * passes_per_hit >= passes`.
    pub passes_per_hit: u32,
    /// Weight of an obstacle whose surface direction is not known.
    pub point_weight: f64,
    /// x
    pub point_hits: f64,
    /// x
    pub mix: f64,
    /// x
    pub smooth_cells: i32,
    /// x
    pub smooth_gain: f64,
}

impl Default for LiveMapSettings {
    fn default() -> Self {
        Self {
            resolution_m: 0.05,
            radius_cells: 10,
            passes_per_hit: 5,
            point_weight: 0.1,
            point_hits: 1.0,
            mix: 0.0,
            smooth_cells: 1,
            smooth_gain: 1.0,
        }
    }
}

/// How a scan's end points agree with a map.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Agreement {
    /// End points within two cells of an obstacle.
    pub fitting: u32,
    /// End points in space that beams have passed, away from every obstacle.
    pub contradicting: u32,
    /// End points where nothing was ever measured.
    pub unknown: u32,
    /// The keyframe that first saw most of the obstacles that fit.
    pub supplier: Option<u32>,
}

impl Agreement {
    /// Share of fitting end points among those in known territory; 1 where none is.
    #[must_use]
    pub fn inlier_share(&self) -> f64 {
        let known = self.fitting + self.contradicting;
        if known == 0 { 1.0 } else { f64::from(self.fitting) / f64::from(known) }
    }

    /// Share of the end points that lie in known territory; 0 without end points.
    #[must_use]
    pub fn known_share(&self) -> f64 {
        let known = self.fitting + self.contradicting;
        let all = known + self.unknown;
        if all == 0 { 0.0 } else { f64::from(known) / f64::from(all) }
    }
}

/// Counts votes for a few candidates; candidates beyond the table's size lose their votes.
#[derive(Default)]
struct Tally {
    entries: [(u32, u32); 16],
    used: usize,
}

impl Tally {
    fn count(&mut self, candidate: u32) {
        for entry in &mut self.entries[..self.used] {
            if entry.0 == candidate {
                entry.1 += 1;
                return;
            }
        }
        if self.used < self.entries.len() {
            self.entries[self.used] = (candidate, 1);
            self.used += 1;
        }
    }

    fn most(&self) -> Option<u32> {
        self.entries[..self.used].iter().max_by_key(|entry| (entry.1, std::cmp::Reverse(entry.0))).map(|entry| entry.0)
    }
}

/// See the module's text.
#[derive(Debug, Clone)]
pub struct LiveMap {
    /// Settings it was made with.
    pub settings: LiveMapSettings,
    counts: CountGrid,
    field: DistanceField,
    surfels: Vec<Surfel>,
    flags: Vec<u8>,
    /// The keyframe that hit a cell first.
    suppliers: Vec<u32>,
    touched: Vec<u32>,
    dirty: Vec<u32>,
}

const OCCUPIED: u8 = 1;
const TOUCHED: u8 = 2;

impl LiveMap {
    /// An empty map.
    #[must_use]
    pub fn new(settings: LiveMapSettings) -> Self {
        Self {
            settings,
            counts: CountGrid::new(settings.resolution_m),
            field: DistanceField::new(settings.radius_cells),
            surfels: Vec::new(),
            flags: Vec::new(),
            suppliers: Vec::new(),
            touched: Vec::new(),
            dirty: Vec::new(),
        }
    }

    /// The counts.
    #[must_use]
    pub fn counts(&self) -> &CountGrid {
        &self.counts
    }

    /// The distance field.
    #[must_use]
    pub fn field(&self) -> &DistanceField {
        &self.field
    }

    /// Obstacles by slot.
    #[must_use]
    pub fn surfels(&self) -> &[Surfel] {
        &self.surfels
    }

    /// Counts a sweep's beams in or out; `supplier` is the number of its keyframe.
    pub fn change(&mut self, points: &SweepPoints, world_from_robot: Pose2, change: Change, supplier: u32) {
        let mut touched = std::mem::take(&mut self.touched);
        self.counts.draw(points, world_from_robot, change, &mut touched);
        self.touched = touched;
        self.settle(supplier);
    }

    /// How a scan's end points agree with the map at a pose.
    #[must_use]
    pub fn agreement(&self, points: &[[f64; 2]], world_from_robot: Pose2) -> Agreement {
        let (s, c) = world_from_robot.theta.sin_cos();
        let cells_per_m = 1.0 / self.settings.resolution_m;
        let near2 = (2.0 * self.settings.resolution_m).powi(2);
        let mut tally = Tally::default();
        let mut agreement = Agreement::default();
        for &[px, py] in points {
            let (x, y) = (world_from_robot.x + c * px - s * py, world_from_robot.y + s * px + c * py);
            let (cell_x, cell_y) = ((x * cells_per_m).floor() as i32, (y * cells_per_m).floor() as i32);
            let slot = self.field.nearest(cell_x, cell_y);
            if slot != NO_OBSTACLE {
                let surfel = &self.surfels[slot as usize];
                if (x - surfel.x).powi(2) + (y - surfel.y).powi(2) < near2 {
                    agreement.fitting += 1;
                    tally.count(self.suppliers[slot as usize]);
                    continue;
                }
            }
            if self.counts.passes(cell_x, cell_y) > 0 {
                agreement.contradicting += 1;
            } else {
                agreement.unknown += 1;
            }
        }
        agreement.supplier = tally.most();
        agreement
    }

    /// Brings obstacles, field and lines up to date with the cells that were touched.
    fn settle(&mut self, supplier: u32) {
        self.flags.resize(self.counts.slot_count(), 0);
        self.surfels.resize(self.counts.slot_count(), Surfel::default());
        self.suppliers.resize(self.counts.slot_count(), supplier);
        let mut touched = std::mem::take(&mut self.touched);
        for &entry in &touched {
            let slot = entry & !(1 << 31);
            let moved = entry >> 31 == 1;
            self.settle_cell(slot, moved);
        }
        for &entry in &touched {
            let slot = entry & !(1 << 31);
            self.flags[slot as usize] &= !TOUCHED;
            let hits = self.counts.cell(slot).hits;
            if hits == 1 {
                self.suppliers[slot as usize] = supplier;
            } else if hits == 0 {
                self.counts.release_if_empty(slot);
            }
        }
        touched.clear();
        self.touched = touched;
        let mut dirty = std::mem::take(&mut self.dirty);
        for &slot in &dirty {
            self.flags[slot as usize] &= !4;
            if self.flags[slot as usize] & OCCUPIED != 0 {
                self.surfels[slot as usize] = self.surfel(slot);
            }
        }
        dirty.clear();
        self.dirty = dirty;
    }

    fn settle_cell(&mut self, slot: u32, moved: bool) {
        let cell = *self.counts.cell(slot);
        let flag = &mut self.flags[slot as usize];
        if *flag & TOUCHED != 0 && !moved {
            return;
        }
        *flag |= TOUCHED;
        let passes = self.counts.passes(cell.x, cell.y);
        let occupied = cell.hits > 0 && cell.hits.saturating_mul(self.settings.passes_per_hit) >= passes;
        let was = *flag & OCCUPIED != 0;
        if occupied && !was {
            *flag |= OCCUPIED;
            self.field.insert(cell.x, cell.y, slot);
            self.counts.mark_obstacle(slot, true);
        } else if !occupied && was {
            *flag &= !OCCUPIED;
            self.field.remove(cell.x, cell.y);
            self.counts.mark_obstacle(slot, false);
        }
        if occupied != was || (occupied && moved) {
            let r = self.settings.smooth_cells;
            for ny in cell.y - r..=cell.y + r {
                for nx in cell.x - r..=cell.x + r {
                    if let Some(o) = self.counts.slot(nx, ny) {
                        if (o as usize) < self.flags.len() && self.flags[o as usize] & 4 == 0 {
                            self.flags[o as usize] |= 4;
                            self.dirty.push(o);
                        }
                    }
                }
            }
        }
    }

    /// Mean of a cell's end points, metres.
    fn mean(&self, slot: u32) -> [f64; 2] {
        let cell = self.counts.cell(slot);
        let scale = 1.0 / (f64::from(cell.hits) * FRACTION_STEPS);
        let half = 0.5 / FRACTION_STEPS;
        [
            (f64::from(cell.x) + half + f64::from(cell.sum_x) * scale) * self.settings.resolution_m,
            (f64::from(cell.y) + half + f64::from(cell.sum_y) * scale) * self.settings.resolution_m,
        ]
    }

    fn surfel(&self, slot: u32) -> Surfel {
        let [x, y] = self.mean(slot);
        let cell = self.counts.cell(slot);
        if cell.normals == 0 {
            let w = (self.settings.point_weight * f64::from(cell.points) / f64::from(cell.hits)) as f32;
            return Surfel { x, y, axx: w, axy: 0.0, ayy: w };
        }
        let smooth = self.settings.smooth_cells;
        if smooth > 0 {
            return self.smooth_surfel(slot, smooth);
        }
        let scale = 1.0 / (f64::from(cell.normals) * FRACTION_STEPS);
        let axx = f64::from(cell.sum_nxx) * scale;
        let axy = f64::from(cell.sum_nxy as i32) * scale;
        Surfel { x, y, axx: axx as f32, axy: axy as f32, ayy: (1.0 - axx) as f32 }
    }

    fn smooth_surfel(&self, slot: u32, r: i32) -> Surfel {
        let [x, y] = self.mean(slot);
        let cell = self.counts.cell(slot);
        let (mut n, mut sxx, mut sxy) = (0.0, 0.0, 0.0);
        let mut near = [(0.0, 0.0, 0.0); 49];
        let mut k = 0;
        for ny in cell.y - r..=cell.y + r {
            for nx in cell.x - r..=cell.x + r {
                let Some(other) = self.counts.slot(nx, ny) else { continue };
                let o = self.counts.cell(other);
                if self.flags[other as usize] & OCCUPIED == 0 || o.normals == 0 {
                    continue;
                }
                let w = f64::from(o.normals);
                let dist2 = f64::from((nx - cell.x).pow(2) + (ny - cell.y).pow(2));
                let g = self.settings.smooth_gain.powf(dist2);
                n += w * g;
                sxx += f64::from(o.sum_nxx) * g;
                sxy += f64::from(o.sum_nxy as i32) * g;
                let [ox, oy] = self.mean(other);
                near[k] = (ox - x, oy - y, f64::from(o.hits) * g);
                k += 1;
            }
        }
        let scale = 1.0 / (n * FRACTION_STEPS);
        let axx = sxx * scale;
        let axy = sxy * scale;
        let ayy = 1.0 - axx;
        // Principal normal.
        let half_diff = 0.5 * (axx - ayy);
        let root = (half_diff * half_diff + axy * axy).sqrt();
        if root < 0.35 {
            return Surfel { x, y, axx: axx as f32, axy: axy as f32, ayy: ayy as f32 };
        }
        let pxx = 0.5 + 0.5 * half_diff / root;
        let pxy = 0.5 * axy / root;
        let pyy = 1.0 - pxx;
        let (mut wx, mut wy, mut w) = (0.0, 0.0, 0.0);
        for &(dx, dy, hits) in &near[..k] {
            wx += hits * (pxx * dx + pxy * dy);
            wy += hits * (pxy * dx + pyy * dy);
            w += hits;
        }
        if self.settings.mix > 0.0 {
            let iso = f64::from(cell.hits - cell.normals) * self.settings.mix;
            let all = f64::from(cell.hits);
            let n = f64::from(cell.normals);
            return Surfel {
                x: x + wx / w,
                y: y + wy / w,
                axx: ((axx * n + iso) / all) as f32,
                axy: (axy * n / all) as f32,
                ayy: ((ayy * n + iso) / all) as f32,
            };
        }
        Surfel { x: x + wx / w, y: y + wy / w, axx: axx as f32, axy: axy as f32, ayy: ayy as f32 }
    }
}
