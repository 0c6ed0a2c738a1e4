//! The map a scan is matched against: counts, the obstacles they make, their distance field and local lines.

use crate::counts::{BEAM_END, Change, CountGrid, FRACTION_STEPS, HitCell, NO_SLOT};
use crate::field::{DistanceField, NO_OBSTACLE};
use crate::tiles::floor_cell;
use mapwright_geom::Pose2;
use mapwright_sensor::SweepPoints;

mod suppliers;

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
    /// Mean of the unit normals, which point to where the surface was seen from: short where both sides were seen.
    pub facing: [f32; 2],
}

impl Surfel {
    /// Squared distance of a point from the surface, square metres.
    #[must_use]
    pub fn squared_distance(&self, x: f64, y: f64) -> f64 {
        let (dx, dy) = (x - self.x, y - self.y);
        f64::from(self.axx) * dx * dx + 2.0 * f64::from(self.axy) * dx * dy + f64::from(self.ayy) * dy * dy
    }

    /// Whether a beam in this direction would end on the surface's far side.
    #[inline]
    pub(crate) fn is_seen_from_behind(&self, [rx, ry]: [f32; 2]) -> bool {
        let away = self.facing[0] * rx + self.facing[1] * ry;
        // Most are seen from the front.
        away > 0.0 && is_far_behind(away, [rx, ry])
    }
}

#[cold]
#[inline(never)]
fn is_far_behind(away: f32, [rx, ry]: [f32; 2]) -> bool {
    away * away > BEHIND * BEHIND * (rx * rx + ry * ry)
}

/// So far from an end point that is nearest to a wall's far side its near side is looked for.
const THICKNESS_CELLS: f64 = 3.0;
/// Cosine between beam and normal, times how much the normals agree, from which a surface is seen from behind.
const BEHIND: f32 = 0.1;

/// What counts as an obstacle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalMapSettings {
    /// Side of a cell, metres.
    pub resolution_m: f64,
    /// Radius of the distance field, cells.
    pub radius_cells: u32,
    /// A cell is an obstacle while `hits * passes_per_hit >= passes`.
    pub passes_per_hit: u32,
    /// Weight of an obstacle that is no piece of a surface, relative to one that is.
    pub point_weight: f64,
}

impl Default for LocalMapSettings {
    fn default() -> Self {
        Self { resolution_m: 0.05, radius_cells: 10, passes_per_hit: 5, point_weight: 0.1 }
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
    /// The keyframe in the map that supplied most of the obstacles that fit.
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

/// Candidates a tally has room for.
const TALLIED: usize = 16;

/// Counts votes for a few candidates; candidates beyond the table's size lose their votes.
struct Tally {
    candidates: [u32; TALLIED],
    votes: [u32; TALLIED],
    used: usize,
    /// Where a candidate with such lowest bits was found last.
    hints: [u8; HINTS],
}

/// Keyframes that are drawn together have numbers close together.
const HINTS: usize = 32;

impl Tally {
    const EMPTY: Self = Self { candidates: [NO_SUPPLIER; TALLIED], votes: [0; TALLIED], used: 0, hints: [0; HINTS] };

    #[inline]
    fn count(&mut self, candidate: u32) {
        if candidate == NO_SUPPLIER {
            return;
        }
        let hint = &mut self.hints[candidate as usize % HINTS];
        let mut at = usize::from(*hint) % TALLIED;
        if self.candidates[at] != candidate {
            // All at once: that is quicker than one after the other.
            let same = |k: usize| u32::from(self.candidates[k] == candidate) << k;
            let known = (0..TALLIED).map(same).sum::<u32>().trailing_zeros() as usize;
            at = known.min(self.used);
            if at == TALLIED {
                return;
            }
            self.candidates[at] = candidate;
            self.used = self.used.max(at + 1);
            *hint = at as u8;
        }
        self.votes[at] += 1;
    }

    fn most(&self) -> Option<u32> {
        let most = (0..self.used).max_by_key(|&k| (self.votes[k], std::cmp::Reverse(self.candidates[k])));
        most.map(|k| self.candidates[k])
    }
}

/// See the module's text.
#[derive(Debug, Clone)]
pub struct LocalMap {
    /// Settings it was made with.
    pub settings: LocalMapSettings,
    counts: CountGrid,
    field: DistanceField,
    surfels: Vec<Surfel>,
    flags: Vec<u8>,
    /// What each slot's cell is to the surfaces around it.
    pieces: Vec<Piece>,
    /// The keyframe that doubled a cell's hits last: where a place was mapped twice, it tells which copy this is.
    /// [`NO_SUPPLIER`] where that keyframe was taken out and none took its place since.
    suppliers: Vec<u32>,
    touched: Vec<u32>,
    changed: Vec<u32>,
    dirty: Vec<u32>,
    vanished: Vec<(i32, i32)>,
}

/// What an obstacle adds to the surface of its neighbours.
#[derive(Debug, Clone, Copy)]
struct Piece {
    /// Mean of the end points, metres.
    mean: [f64; 2],
    hits: f64,
    /// As in [`HitCell`]; zero where the cell is no obstacle.
    normals: u32,
    sum_nxx: u32,
    sum_nxy: i32,
    facing: [i32; 2],
}

impl Piece {
    /// No obstacle.
    const NONE: Self = Self { mean: [0.0; 2], hits: 0.0, normals: 0, sum_nxx: 0, sum_nxy: 0, facing: [0; 2] };
}

const NO_SUPPLIER: u32 = u32::MAX;
/// The slot's cell is an obstacle.
const OCCUPIED: u8 = 1;
/// The cell's counts have changed.
const TOUCHED: u8 = 2;
/// A beam's end was added to the cell or taken out.
const MOVED: u8 = 4;
/// The surfel must be computed anew.
const DIRTY: u8 = 8;

impl LocalMap {
    /// An empty map.
    #[must_use]
    pub fn new(settings: LocalMapSettings) -> Self {
        Self {
            settings,
            counts: CountGrid::new(settings.resolution_m),
            field: DistanceField::new(settings.radius_cells),
            surfels: Vec::new(),
            flags: Vec::new(),
            pieces: Vec::new(),
            suppliers: Vec::new(),
            touched: Vec::new(),
            changed: Vec::new(),
            dirty: Vec::new(),
            vanished: Vec::new(),
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

    /// The obstacle that a beam `from` a point is matched against where it ends at another, in the map's frame, metres: the
    /// nearest, unless it was only seen from the other side.
    #[must_use]
    pub fn obstacle_seen(&self, from: [f64; 2], end: [f64; 2]) -> Option<&Surfel> {
        let ray = [0, 1].map(|k| (end[k] - from[k]) as f32);
        let [x, y] = end.map(|metres| floor_cell(metres / self.settings.resolution_m));
        let nearest = self.surfels.get(self.field.nearest(x, y) as usize)?;
        if nearest.is_seen_from_behind(ray) { self.near_side(nearest, end, ray) } else { Some(nearest) }
    }

    /// The near side of a wall of which an end point is nearest to the far side.
    #[cold]
    pub(crate) fn near_side(&self, far_side: &Surfel, end: [f64; 2], ray: [f32; 2]) -> Option<&Surfel> {
        let away = far_side.facing.map(|f| THICKNESS_CELLS * f64::from(f));
        let [x, y] = [0, 1].map(|k| floor_cell(end[k] / self.settings.resolution_m - away[k]));
        let surfel = self.surfels.get(self.field.nearest(x, y) as usize);
        surfel.filter(|surfel| !surfel.is_seen_from_behind(ray))
    }

    /// Counts a sweep's beams in or out; `supplier` is the number of its keyframe.
    pub fn change(&mut self, points: &SweepPoints, world_from_robot: Pose2, change: Change, supplier: u32) {
        self.draw(points, world_from_robot, change, supplier);
        self.refresh();
    }

    /// As [`LocalMap::change`], the obstacles left for [`LocalMap::refresh`]: cheaper where many sweeps change.
    pub fn draw(&mut self, points: &SweepPoints, world_from_robot: Pose2, change: Change, supplier: u32) {
        let known = self.touched.len();
        self.counts.draw(points, world_from_robot, change, &mut self.touched);
        self.suppliers.resize(self.counts.slot_count(), NO_SUPPLIER);
        for entry in self.touched[known..].iter().filter(|&entry| entry & BEAM_END != 0) {
            let slot = entry & !BEAM_END;
            let hits = self.counts.cell(slot).hits;
            let known = &mut self.suppliers[slot as usize];
            match change {
                Change::Add if *known == NO_SUPPLIER || hits.is_power_of_two() => *known = supplier,
                Change::Remove if *known == supplier || hits == 0 => *known = NO_SUPPLIER,
                _ => {}
            }
        }
    }

    /// How a scan's end points agree with the map at a pose.
    #[must_use]
    pub fn agreement(&self, points: &[[f64; 2]], world_from_robot: Pose2) -> Agreement {
        self.agreement_of_each(points, world_from_robot, |_| {})
    }

    /// As [`LocalMap::agreement`]; `contradicts` hears the index of every end point in space that beams have passed.
    #[must_use]
    pub fn agreement_of_each(
        &self,
        points: &[[f64; 2]],
        world_from_robot: Pose2,
        mut contradicts: impl FnMut(usize),
    ) -> Agreement {
        let (s, c) = world_from_robot.theta.sin_cos();
        let cells_per_m = 1.0 / self.settings.resolution_m;
        let near2 = (2.0 * self.settings.resolution_m).powi(2);
        let mut tally = Tally::EMPTY;
        let mut agreement = Agreement::default();
        let mut field = self.field.look_ups();
        for (k, &[px, py]) in points.iter().enumerate() {
            let (x, y) = (world_from_robot.x + c * px - s * py, world_from_robot.y + s * px + c * py);
            let (cell_x, cell_y) = (floor_cell(x * cells_per_m), floor_cell(y * cells_per_m));
            let slot = field.nearest(cell_x, cell_y);
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
                contradicts(k);
            } else {
                agreement.unknown += 1;
            }
        }
        agreement.supplier = tally.most();
        agreement
    }

    /// How closely the end points in known territory lie on the surfaces at a pose: the mean of `exp(-d^2 / (2 sigma^2))`, with
    /// `d` from the line of the nearest surface, metres, or from the surface itself where that is no longer near. A likelihood
    /// field (Thrun, Burgard and Fox 2005, section 6.4) whose obstacles are lines. Zero where nothing is known.
    #[must_use]
    pub fn closeness(&self, points: &[[f64; 2]], world_from_robot: Pose2, sigma_m: f64) -> f64 {
        let (s, c) = world_from_robot.theta.sin_cos();
        let cells_per_m = 1.0 / self.settings.resolution_m;
        let [known2, near2] = [2.0, 3.0].map(|cells| (cells * self.settings.resolution_m).powi(2));
        let per_d2 = 0.5 / (sigma_m * sigma_m);
        let (mut sum, mut known) = (0.0, 0_u32);
        let mut field = self.field.look_ups();
        for &[px, py] in points {
            let (x, y) = (world_from_robot.x + c * px - s * py, world_from_robot.y + s * px + c * py);
            let (cell_x, cell_y) = (floor_cell(x * cells_per_m), floor_cell(y * cells_per_m));
            let slot = field.nearest(cell_x, cell_y);
            let surfel = (slot != NO_OBSTACLE).then(|| &self.surfels[slot as usize]);
            let away2 = surfel.map_or(f64::INFINITY, |surfel| (x - surfel.x).powi(2) + (y - surfel.y).powi(2));
            if away2 < known2 || self.counts.passes(cell_x, cell_y) > 0 {
                known += 1;
                let off2 = surfel.filter(|_| away2 < near2).map_or(away2, |surfel| surfel.squared_distance(x, y));
                sum += (-off2 * per_d2).exp();
            }
        }
        if known == 0 { 0.0 } else { sum / f64::from(known) }
    }

    /// Calls with the keyframe behind the obstacle nearest to each end point at a pose, from whichever side it was seen.
    pub fn each_supplier(&self, points: &[[f64; 2]], world_from_robot: Pose2, mut call: impl FnMut(u32)) {
        let (s, c) = world_from_robot.theta.sin_cos();
        let cells_per_m = 1.0 / self.settings.resolution_m;
        let mut field = self.field.look_ups();
        for &[px, py] in points {
            let (x, y) = (world_from_robot.x + c * px - s * py, world_from_robot.y + s * px + c * py);
            let slot = field.nearest(floor_cell(x * cells_per_m), floor_cell(y * cells_per_m));
            if slot != NO_OBSTACLE && self.suppliers[slot as usize] != NO_SUPPLIER {
                call(self.suppliers[slot as usize]);
            }
        }
    }

    /// Brings obstacles, field and surfels up to date with what was drawn.
    pub fn refresh(&mut self) {
        if self.touched.is_empty() {
            return;
        }
        let slots = self.counts.slot_count();
        self.flags.resize(slots, 0);
        self.surfels.resize(slots, Surfel::default());
        self.pieces.resize(slots, Piece::NONE);
        self.collect_changed();
        let mut changed = std::mem::take(&mut self.changed);
        for &slot in &changed {
            self.settle_cell(slot);
        }
        self.field.remove_all(&self.vanished);
        self.vanished.clear();
        for slot in changed.drain(..) {
            self.flags[slot as usize] &= !(TOUCHED | MOVED);
            self.counts.release_if_empty(slot);
        }
        self.changed = changed;
        let mut dirty = std::mem::take(&mut self.dirty);
        for slot in dirty.drain(..) {
            self.flags[slot as usize] &= !DIRTY;
            if self.flags[slot as usize] & OCCUPIED != 0 {
                self.surfels[slot as usize] = self.surfel(slot);
            }
        }
        self.dirty = dirty;
    }

    /// Each touched slot once.
    fn collect_changed(&mut self) {
        for entry in self.touched.drain(..) {
            let slot = entry & !BEAM_END;
            let flag = &mut self.flags[slot as usize];
            if *flag & TOUCHED == 0 {
                self.changed.push(slot);
            }
            *flag |= if entry & BEAM_END != 0 { TOUCHED | MOVED } else { TOUCHED };
        }
    }

    fn settle_cell(&mut self, slot: u32) {
        let cell = *self.counts.cell(slot);
        let flag = self.flags[slot as usize];
        let moved = flag & MOVED != 0;
        let passes = self.counts.passes(cell.x, cell.y);
        let occupied = cell.is_obstacle(passes, self.settings.passes_per_hit);
        let was = flag & OCCUPIED != 0;
        if occupied && !was {
            self.flags[slot as usize] |= OCCUPIED;
            self.field.insert(cell.x, cell.y, slot);
            self.counts.mark_obstacle(slot, true);
        } else if !occupied && was {
            self.flags[slot as usize] &= !OCCUPIED;
            self.vanished.push((cell.x, cell.y));
            self.counts.mark_obstacle(slot, false);
        }
        if occupied != was || (occupied && moved) {
            self.pieces[slot as usize] = if occupied { self.piece(&cell) } else { Piece::NONE };
            for near in self.counts.neighbours(cell.x, cell.y) {
                if near != NO_SLOT && self.flags[near as usize] & DIRTY == 0 {
                    self.flags[near as usize] |= DIRTY;
                    self.dirty.push(near);
                }
            }
        }
    }

    fn piece(&self, cell: &HitCell) -> Piece {
        let scale = 1.0 / (f64::from(cell.hits) * FRACTION_STEPS);
        // Fractions were rounded down: half a step makes up for it.
        let half = 0.5 / FRACTION_STEPS;
        Piece {
            mean: [
                (f64::from(cell.x) + half + f64::from(cell.sum_x) * scale) * self.settings.resolution_m,
                (f64::from(cell.y) + half + f64::from(cell.sum_y) * scale) * self.settings.resolution_m,
            ],
            hits: f64::from(cell.hits),
            normals: cell.normals,
            sum_nxx: cell.sum_nxx,
            sum_nxy: cell.sum_nxy as i32,
            facing: [cell.sum_nx as i32, cell.sum_ny as i32],
        }
    }

    /// Surface of an obstacle and its eight neighbours: normals averaged, and the mean moved along the normal to theirs, so
    /// that a wall that straddles two rows of cells is one line.
    fn surfel(&self, slot: u32) -> Surfel {
        let own = self.pieces[slot as usize];
        let ([x, y], cell) = (own.mean, self.counts.cell(slot));
        if own.normals == 0 {
            let w = (self.settings.point_weight * f64::from(cell.points) / f64::from(cell.hits)) as f32;
            return Surfel { x, y, axx: w, axy: 0.0, ayy: w, facing: [0.0; 2] };
        }
        let (mut sum_dx, mut sum_dy, mut hits) = (0.0, 0.0, 0.0);
        let (mut n, mut sum_nxx, mut sum_nxy, mut sum_n) = (0_i64, 0_i64, 0_i64, [0_i64; 2]);
        let [own_x, own_y] = own.facing.map(i64::from);
        for near in self.counts.neighbours(cell.x, cell.y) {
            let Some(piece) = self.pieces.get(near as usize) else { continue };
            let facing = piece.facing.map(i64::from);
            // The other side of a thin wall is another surface.
            if piece.normals > 0 && own_x * facing[0] + own_y * facing[1] >= 0 {
                sum_n = [sum_n[0] + facing[0], sum_n[1] + facing[1]];
                sum_dx += piece.hits * (piece.mean[0] - x);
                sum_dy += piece.hits * (piece.mean[1] - y);
                hits += piece.hits;
                n += i64::from(piece.normals);
                sum_nxx += i64::from(piece.sum_nxx);
                sum_nxy += i64::from(piece.sum_nxy);
            }
        }
        let scale = 1.0 / (n as f64 * FRACTION_STEPS);
        let (axx, axy) = (sum_nxx as f64 * scale, sum_nxy as f64 * scale);
        let ayy = 1.0 - axx;
        let facing = sum_n.map(|sum| (sum as f64 * scale) as f32);
        let plain = Surfel { x, y, axx: axx as f32, axy: axy as f32, ayy: ayy as f32, facing };
        // Eigenvalues of A are 1/2 +- root: far apart where the normals agree.
        let half_difference = 0.5 * (axx - ayy);
        let root = (half_difference * half_difference + axy * axy).sqrt();
        if root < AGREEING_NORMALS {
            return plain;
        }
        let (pxx, pxy) = (0.5 + 0.5 * half_difference / root, 0.5 * axy / root);
        let pyy = 1.0 - pxx;
        let (shift_x, shift_y) = (pxx * sum_dx + pxy * sum_dy, pxy * sum_dx + pyy * sum_dy);
        Surfel { x: x + shift_x / hits, y: y + shift_y / hits, ..plain }
    }
}

/// Half the difference of `A`'s eigenvalues from which a neighbourhood has one normal.
const AGREEING_NORMALS: f64 = 0.35;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_keyframe_that_was_taken_out_is_nobodys_anchor() {
        let hits: Vec<_> = (0..40).map(|k| [2.0, 0.05 * f64::from(k)]).collect();
        let points = SweepPoints { normals: vec![[1.0, 0.0]; hits.len()], hits, ..SweepPoints::default() };
        let mut map = LocalMap::new(LocalMapSettings::default());
        let supplier = |map: &LocalMap| map.agreement(&points.hits, Pose2::IDENTITY).supplier;
        for keyframe in 3..=5 {
            map.change(&points, Pose2::IDENTITY, Change::Add, keyframe);
        }
        assert_eq!(supplier(&map), Some(4), "the second hit doubled the first, the third doubles nothing");
        map.change(&points, Pose2::IDENTITY, Change::Remove, 4);
        assert_eq!(supplier(&map), None);
        map.change(&points, Pose2::IDENTITY, Change::Add, 6);
        assert_eq!(supplier(&map), Some(6));
        for keyframe in [3, 5, 6] {
            map.change(&points, Pose2::IDENTITY, Change::Remove, keyframe);
        }
        map.change(&points, Pose2::IDENTITY, Change::Add, 7);
        assert_eq!(supplier(&map), Some(7));
    }

    #[test]
    fn closeness_is_what_a_normal_distribution_makes_of_the_distance_from_the_line() {
        const SIGMA_M: f64 = 0.025;
        let hits: Vec<_> = (0..80).map(|k| [2.0, 0.025 * f64::from(k) - 1.0]).collect();
        let points = SweepPoints { normals: vec![[-1.0, 0.0]; hits.len()], hits, ..SweepPoints::default() };
        let mut map = LocalMap::new(LocalMapSettings::default());
        map.change(&points, Pose2::IDENTITY, Change::Add, 0);
        let inner = &points.hits[10..70];
        for (off_m, along_m) in [(0.0, 0.0), (0.0, 0.1), (0.02, 0.0), (-0.04, 0.1), (0.09, 0.0)] {
            let there = map.closeness(inner, Pose2::new(off_m, along_m, 0.0), SIGMA_M);
            let expected = (-0.5 * (off_m / SIGMA_M).powi(2)).exp();
            assert!((there - expected).abs() < 1e-3, "{off_m} m off, {along_m} m along: {there}, expected {expected}");
        }
        let nowhere = map.closeness(inner, Pose2::new(1.0, 0.0, 0.0), SIGMA_M);
        assert!(nowhere < f64::EPSILON, "nothing is known there: {nowhere}");
    }
}
