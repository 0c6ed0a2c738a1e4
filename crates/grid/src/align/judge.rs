//! What two maps say of each other at a pose, and whether that is believed.

use super::walls::{Surface, Walls};
use super::{Occupancy, Ratios};
use mapwright_geom::Pose2;

/// Walls that lie so many cells apart (of the coarser map) are the same: maps are drawn by poses that are a cell or two off.
const SAME_WALL_CELLS: f64 = 3.0;
/// Distances between walls are told up to so many cells.
const MISFIT_CELLS: f64 = 10.0;
/// Places that are looked at to learn how often one lies at a wall by chance, and how large an overlap is.
const SAMPLES: usize = 200_000;

/// Walls of one map within what the other one knows.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct WallAgreement {
    /// Wall that the other map has as well, metres.
    pub confirmed_m: f64,
    /// Wall where the other map knows free space, metres.
    pub contradicted_m: f64,
}

impl WallAgreement {
    /// Share of the wall in the overlap that the other map has as well; 0 where there is none.
    #[must_use]
    pub fn share(&self) -> f64 {
        let seen_m = self.confirmed_m + self.contradicted_m;
        if seen_m > 0.0 { self.confirmed_m / seen_m } else { 0.0 }
    }
}

/// What two maps say of each other at a pose.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Evidence {
    /// Walls of the first map.
    pub of_a: WallAgreement,
    /// Walls of the second map.
    pub of_b: WallAgreement,
    /// Wall that speaks for the pose less what speaks against it, metres: each confirmed metre counts its log likelihood ratio
    /// (against a pose taken at random) relative to that of a metre confirmed where nothing is confirmed by chance.
    pub support_m: f64,
}

impl Evidence {
    /// Share of the walls in the overlap that both maps have.
    #[must_use]
    pub fn share(&self) -> f64 {
        let sum = |part: fn(&WallAgreement) -> f64| part(&self.of_a) + part(&self.of_b);
        let both = WallAgreement { confirmed_m: sum(|a| a.confirmed_m), contradicted_m: sum(|a| a.contradicted_m) };
        both.share()
    }
}

/// Judges poses of two maps.
#[derive(Debug)]
pub(super) struct Judge<'a> {
    pub(super) a: &'a Walls<'a>,
    pub(super) b: &'a Walls<'a>,
    same_wall_m: f64,
    misfit_m: f64,
    /// What walls of the other map say at places of this one.
    in_a: Ratios,
    in_b: Ratios,
}

impl<'a> Judge<'a> {
    pub(super) fn of(a: &'a Walls<'a>, b: &'a Walls<'a>) -> Self {
        let cell_m = a.map.resolution_m.max(b.map.resolution_m);
        let same_wall_m = SAME_WALL_CELLS * cell_m;
        let in_map = |walls| Ratios::where_by_chance(beside_walls(walls, same_wall_m));
        Self { a, b, same_wall_m, misfit_m: MISFIT_CELLS * cell_m, in_a: in_map(a), in_b: in_map(b) }
    }

    /// What every `stride`-th wall cell says.
    pub(super) fn evidence(&self, a_from_b: Pose2, stride: usize) -> Evidence {
        let of_a = self.agreement(self.a, self.b, a_from_b.inverse(), stride);
        let of_b = self.agreement(self.b, self.a, a_from_b, stride);
        Evidence { of_a, of_b, support_m: (self.in_b.support(&of_a) + self.in_a.support(&of_b)) / 2.0 }
    }

    fn agreement(&self, of: &Walls<'_>, within: &Walls<'_>, within_from_of: Pose2, stride: usize) -> WallAgreement {
        let mut agreement = WallAgreement::default();
        let cell_m = of.map.resolution_m * stride as f64;
        for surface in of.surfaces.iter().step_by(stride) {
            let place = within_from_of.transform(surface.at);
            let near = nearest(within, place).filter(|(distance_m, _)| *distance_m <= self.same_wall_m);
            if let Some((_, near)) = near {
                let is_same = near.may_be(surface, surface.normal.map(|normal| turned(within_from_of, normal)));
                agreement.confirmed_m += if is_same { cell_m } else { 0.0 };
            } else if within.occupancy(place) != Occupancy::Unknown {
                agreement.contradicted_m += cell_m;
            }
        }
        agreement
    }

    /// Distances of the walls that both maps have, from the least to the greatest, metres: across walls that have a direction.
    pub(super) fn misfits(&self, a_from_b: Pose2) -> Vec<f64> {
        let mut misfits = Vec::new();
        for (of, within, pose) in [(self.b, self.a, a_from_b), (self.a, self.b, a_from_b.inverse())] {
            for surface in &of.surfaces {
                let place = pose.transform(surface.at);
                let Some(near) = within.levels[0].nearest(place).map(|number| &within.surfaces[number]) else {
                    continue;
                };
                let [dx, dy] = [place[0] - near.at[0], place[1] - near.at[1]];
                if dx.hypot(dy) <= self.misfit_m {
                    misfits.push(near.normal.map_or(dx.hypot(dy), |[nx, ny]| (dx * nx + dy * ny).abs()));
                }
            }
        }
        misfits.sort_by(f64::total_cmp);
        misfits
    }

    /// The area that both maps know, square metres, and its middle in the second map.
    pub(super) fn overlap(&self, a_from_b: Pose2) -> (f64, [f64; 2]) {
        let (mut known, mut sum) = (0, [0.0; 2]);
        let stride = stride_of(self.b);
        for_each_known(self.b, stride, |place| {
            if self.a.occupancy(a_from_b.transform(place)) != Occupancy::Unknown {
                known += 1;
                sum = [sum[0] + place[0], sum[1] + place[1]];
            }
        });
        let cell_m = self.b.map.resolution_m * stride as f64;
        (f64::from(known) * cell_m * cell_m, sum.map(|s| s / f64::from(known.max(1))))
    }
}

/// Distance to the nearest wall and that wall, where one is near.
fn nearest<'a>(walls: &'a Walls<'_>, place: [f64; 2]) -> Option<(f64, &'a Surface)> {
    let near = &walls.surfaces[walls.levels[0].nearest(place)?];
    Some(((place[0] - near.at[0]).hypot(place[1] - near.at[1]), near))
}

/// A direction of frame b in frame a.
pub(super) fn turned(a_from_b: Pose2, [x, y]: [f64; 2]) -> [f64; 2] {
    let (s, c) = a_from_b.theta.sin_cos();
    [c * x - s * y, s * x + c * y]
}

/// Share of the known places at which there is a wall by chance.
fn beside_walls(walls: &Walls<'_>, same_wall_m: f64) -> f64 {
    let (mut known, mut beside) = (0_u32, 0_u32);
    for_each_known(walls, stride_of(walls), |place| {
        known += 1;
        beside += u32::from(nearest(walls, place).is_some_and(|(distance_m, _)| distance_m <= same_wall_m));
    });
    f64::from(beside) / f64::from(known.max(1))
}

/// Every so manieth cell along x and y makes about [`SAMPLES`] of a map.
fn stride_of(walls: &Walls<'_>) -> usize {
    ((walls.map.cells.len() as f64 / SAMPLES as f64).sqrt().ceil() as usize).max(1)
}

fn for_each_known(walls: &Walls<'_>, stride: usize, mut call: impl FnMut([f64; 2])) {
    let map = walls.map;
    for y in (0..map.height).step_by(stride) {
        for x in (0..map.width).step_by(stride) {
            if map.cells[y * map.width + x] != Occupancy::Unknown {
                let cell = [x as f64 + 0.5, y as f64 + 0.5];
                call([0, 1].map(|k: usize| cell[k] * map.resolution_m - walls.middle[k]));
            }
        }
    }
}
