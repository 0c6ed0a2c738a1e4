//! Finished maps of robots that share nothing else: where the one lies in the other, if anywhere.
//!
//! Every heading and every shift is tried ([`coarse`]), the best of them are refined to a part of a cell ([`fine`]) and judged by what
//! the maps say of each other ([`judge`]): a pose is believed where walls confirm each other, few lie in what the other map
//! knows to be free, the overlap is large enough and no other pose fits about as well.

mod coarse;
mod fft;
mod fine;
mod join;
mod judge;
#[cfg(test)]
mod tests;
mod walls;

pub use join::{JoinError, Source, join};
pub use judge::{Evidence, WallAgreement};

use coarse::{Lattice, displacement};
use judge::Judge;
use mapwright_geom::{Cov3, Pose2, compose_covariance, inverse_covariance};
use walls::Walls;

/// Share of its walls in the overlap that a map finds again in another one of the same place, at least: the rest has moved. Measured: 0.8 to 1
/// where maps that are not bent lie right, 0.55 to 0.77 at the best pose of different buildings that overlap by more than a wall.
const CONFIRMED_WHERE_RIGHT: f64 = 0.8;
/// Coarse poses that are looked at more closely, and those of them that are looked at with every wall.
const REFINED: usize = 120;
const JUDGED: usize = 12;
/// Wall cells of each map that are used for the first look.
const FIRST_LOOK: usize = 2_000;
/// The same for the last one, which is all of them in a building of usual size.
const LAST_LOOK: usize = 40_000;
/// Another pose is one by which walls lie farther off than so many cells (rms): within that the optimum is the same.
const ANOTHER_POSE_CELLS: f64 = 10.0;
/// Both maps have at least so many cells of wall where they overlap, and know so many cells: 10 m and 10 m2 in maps of the usual 0.05 m. With
/// less, a room was laid askew into another part of itself.
const LEAST_WALL_CELLS: f64 = 200.0;
const LEAST_OVERLAP_CELLS: f64 = 4_000.0;
/// For another pose speaks at most this share of the wall that speaks for the best one: twice as much must speak for that. Measured: 0.04 to
/// 0.5 where maps of one building lie right, nearly always above 0.6 for maps of different buildings, near 1 where both ends look alike.
const MOST_OF_RIVAL: f64 = 0.5;

/// What a map says of a cell.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Occupancy {
    /// Nothing.
    #[default]
    Unknown,
    /// It is free.
    Free,
    /// There is a wall, or what looked like one.
    Occupied,
}

/// A finished occupancy map.
#[derive(Debug, Clone, PartialEq)]
pub struct OccupancyMap {
    /// Cells along x.
    pub width: usize,
    /// Cells along y.
    pub height: usize,
    /// Side of a cell, metres.
    pub resolution_m: f64,
    /// Pose of the map's lower left corner.
    pub world_from_map: Pose2,
    /// Row by row, that of the smallest y first.
    pub cells: Vec<Occupancy>,
}

impl OccupancyMap {
    /// The cell of a place that is given in cells from the lower left corner.
    fn at(&self, [x, y]: [f64; 2]) -> Occupancy {
        // Casts saturate, so that what is beyond the sides stays there; NaN becomes the corner.
        let (u, v) = (x.floor() as i64, y.floor() as i64);
        self.cell(u, v)
    }

    fn cell(&self, u: i64, v: i64) -> Occupancy {
        let inside = (0..self.width as i64).contains(&u) && (0..self.height as i64).contains(&v);
        if inside { self.cells[v as usize * self.width + u as usize] } else { Occupancy::Unknown }
    }

    fn is_occupied(&self, u: i64, v: i64) -> bool {
        self.cell(u, v) == Occupancy::Occupied
    }

    fn validate(&self) -> Result<(), MapError> {
        let sound = self.resolution_m.is_finite() && self.resolution_m > 0.0 && self.world_from_map.is_finite();
        match sound && self.width.checked_mul(self.height) == Some(self.cells.len()) {
            true => Ok(()),
            false => Err(MapError::Geometry),
        }
    }
}

/// Why a map cannot be aligned with any.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MapError {
    /// Cells, sides, resolution or origin that are no map's.
    #[error("expected width x height cells, a resolution above zero and a finite origin, found otherwise")]
    Geometry,
    /// Nothing is known.
    #[error("expected walls, found nothing but unknown cells")]
    AllUnknown,
    /// Nothing is occupied.
    #[error("expected walls, found nothing but free cells")]
    NoWalls,
    /// More walls than any building has.
    #[error("expected at most {} wall cells, found more", walls::MAX_WALL_CELLS)]
    TooManyWalls,
    /// Walls spread so far apart that not all headings and shifts can be tried.
    #[error(
        "expected walls within about 10,000 x 10,000 cells, found walls so far apart that not all headings and shifts can be tried"
    )]
    TooLarge,
}

/// Log likelihood ratios of a wall that is confirmed and of one that is not: of a right pose against one taken at random.
#[derive(Debug, Clone, Copy)]
struct Ratios {
    confirmed: f64,
    missed: f64,
}

impl Ratios {
    /// Where a wall is confirmed by chance with this probability.
    fn where_by_chance(chance: f64) -> Self {
        let chance = chance.clamp(0.01, 0.75);
        Self {
            confirmed: (CONFIRMED_WHERE_RIGHT / chance).ln(),
            missed: ((1.0 - CONFIRMED_WHERE_RIGHT) / (1.0 - chance)).ln(),
        }
    }

    /// In metres of wall.
    fn support(&self, agreement: &WallAgreement) -> f64 {
        agreement.confirmed_m * self.confirmed + agreement.contradicted_m * self.missed
    }
}

/// Where one map lies in another, or why it is not said to lie anywhere.
#[derive(Debug, Clone, PartialEq)]
pub struct Alignment {
    /// Pose of the second map's world in the first one's; the best there is, believed or not.
    pub a_from_b: Pose2,
    /// Covariance of its right perturbation.
    pub covariance: Cov3,
    /// What the maps say of each other there.
    pub evidence: Evidence,
    /// The best pose that is another one, and what speaks for it.
    pub rival: Option<(Pose2, Evidence)>,
    /// Area that both maps know, square metres.
    pub overlap_m2: f64,
    /// Its middle, in the second map's world, metres.
    pub overlap_middle_b: [f64; 2],
    /// Distances of the walls that both maps have, metres: the median and the 95th percentile.
    pub misfit_m: [f64; 2],
    /// Step of the shifts and number of the headings that were tried.
    pub step_m: f64,
    /// See `step_m`.
    pub headings: usize,
    /// Why it is not believed.
    pub refusal: Option<Refusal>,
}

/// Why two maps are not joined.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Refusal {
    /// Nowhere do more walls lie upon walls than by chance, or hardly any do.
    #[error(
        "expected a pose at which both maps have {least_wall_m:.1} m of wall and know {least_m2:.1} m2, found at best {wall_m:.1} m and {overlap_m2:.1} m2"
    )]
    Apart {
        /// Wall that both maps have, metres, and the least that is asked for.
        wall_m: f64,
        /// See `wall_m`.
        least_wall_m: f64,
        /// Area that both know, square metres, and the least that is asked for.
        overlap_m2: f64,
        /// See `overlap_m2`.
        least_m2: f64,
    },
    /// Walls of the one map lie in what the other one knows to be free.
    #[error(
        "expected {:.0} % of the walls in the overlap in both maps, found {:.0} % at best: the rest lies where the other map knows free space",
        100.0 * least,
        100.0 * share
    )]
    Contradicted {
        /// Share of the walls in the overlap that both maps have.
        share: f64,
        /// The least that is asked for.
        least: f64,
    },
    /// Another pose fits about as well: the building looks alike there, or neither is right.
    #[error(
        "expected one pose that fits best, found another one for which {:.0} % as much wall speaks (at most {:.0} %): x {:.2} m, y {:.2} m, {:.1} deg",
        100.0 * ratio,
        100.0 * most,
        rival.x,
        rival.y,
        rival.theta.to_degrees()
    )]
    Ambiguous {
        /// The other pose.
        rival: Pose2,
        /// What speaks for it, as a share of what speaks for the best.
        ratio: f64,
        /// The most that is let pass.
        most: f64,
    },
}

/// Where the second map lies in the first one.
///
/// # Errors
///
/// A [`MapError`] and which of the two maps it is about, 0 or 1.
pub fn align(a: &OccupancyMap, b: &OccupancyMap) -> Result<Alignment, (usize, MapError)> {
    let walls = |which: usize, map: &'_ OccupancyMap| map.validate().map_err(|cause| (which, cause));
    walls(0, a)?;
    walls(1, b)?;
    let mut a = Walls::of(a).map_err(|cause| (0, cause))?;
    let mut b = Walls::of(b).map_err(|cause| (1, cause))?;
    // The smaller one is turned: fewer headings, and all of the overlap lies within it.
    if a.radius_m() >= b.radius_m() {
        return aligned(&mut a, &mut b).map_err(|cause| (0, cause));
    }
    Ok(aligned(&mut b, &mut a).map_err(|cause| (1, cause))?.inverse())
}

impl Alignment {
    /// Standard deviations of the pose at the middle of the overlap: along x and y of the second map, metres, and of the heading, radians.
    #[must_use]
    pub fn deviations(&self) -> [f64; 3] {
        let [x, y] = self.overlap_middle_b;
        let there = compose_covariance(&self.covariance, Pose2::new(x, y, 0.0), &Cov3::zeros());
        [0, 1, 2].map(|k| there[(k, k)].max(0.0).sqrt())
    }

    /// That of the first map in the second.
    fn inverse(self) -> Self {
        let swapped = |evidence: Evidence| Evidence { of_a: evidence.of_b, of_b: evidence.of_a, ..evidence };
        Self {
            a_from_b: self.a_from_b.inverse(),
            covariance: inverse_covariance(self.a_from_b, &self.covariance),
            evidence: swapped(self.evidence),
            rival: self.rival.map(|(pose, evidence)| (pose.inverse(), swapped(evidence))),
            overlap_middle_b: self.a_from_b.transform(self.overlap_middle_b),
            refusal: self.refusal.map(|refusal| match refusal {
                Refusal::Ambiguous { rival, ratio, most } => Refusal::Ambiguous { rival: rival.inverse(), ratio, most },
                other => other,
            }),
            ..self
        }
    }
}

fn aligned(a: &mut Walls<'_>, b: &mut Walls<'_>) -> Result<Alignment, MapError> {
    let lattice = Lattice::of(a, b);
    if !lattice.is_affordable() {
        return Err(MapError::TooLarge);
    }
    let width_m = lattice.step_m;
    a.reach(2.0 * width_m);
    b.reach(2.0 * width_m);
    let (a, b) = (&*a, &*b);
    let judge = Judge::of(a, b);
    let poses = judged(&judge, &lattice);
    let another_m = ANOTHER_POSE_CELLS * a.map.resolution_m.max(b.map.resolution_m);
    let (best, evidence) = poses.first().copied().unwrap_or_default();
    let rival = poses.iter().find(|(pose, _)| displacement(best, *pose, b) > another_m);
    let world = |pose: Pose2| world_from_middle(a) * pose * world_from_middle(b).inverse();
    let (overlap_m2, middle) = judge.overlap(best);
    let misfits = judge.misfits(best);
    let share = |share: f64| misfits.get((share * misfits.len() as f64) as usize).copied().unwrap_or(0.0);
    let covariance = fine::covariance(a, b, best);
    let mut alignment = Alignment {
        a_from_b: world(best),
        covariance: compose_covariance(&covariance, world_from_middle(b).inverse(), &Cov3::zeros()),
        evidence,
        rival: rival.map(|&(pose, evidence)| (world(pose), evidence)),
        overlap_m2,
        overlap_middle_b: world_from_middle(b).transform(middle),
        misfit_m: [share(0.5), share(0.95)],
        step_m: lattice.step_m,
        headings: lattice.headings,
        refusal: None,
    };
    alignment.refusal = refusal(&alignment, a.map.resolution_m.max(b.map.resolution_m));
    Ok(alignment)
}

/// Why a pose is not believed, if it is not. A thing is asked only where all before it hold.
fn refusal(found: &Alignment, cell_m: f64) -> Option<Refusal> {
    let Evidence { of_a, of_b, support_m } = found.evidence;
    let wall_m = if support_m > 0.0 { of_a.confirmed_m.min(of_b.confirmed_m) } else { 0.0 };
    let (least_wall_m, least_m2) = (LEAST_WALL_CELLS * cell_m, LEAST_OVERLAP_CELLS * cell_m * cell_m);
    if wall_m < least_wall_m || found.overlap_m2 < least_m2 {
        return Some(Refusal::Apart { wall_m, least_wall_m, overlap_m2: found.overlap_m2, least_m2 });
    }
    let share = found.evidence.share();
    if share < CONFIRMED_WHERE_RIGHT {
        return Some(Refusal::Contradicted { share, least: CONFIRMED_WHERE_RIGHT });
    }
    let (rival, against) = found.rival?;
    let ratio = against.support_m / support_m;
    (ratio > MOST_OF_RIVAL).then_some(Refusal::Ambiguous { rival, ratio, most: MOST_OF_RIVAL })
}

/// The best poses, refined, best first.
fn judged(judge: &Judge<'_>, lattice: &Lattice) -> Vec<(Pose2, Evidence)> {
    let (a, b) = (judge.a, judge.b);
    let stride = |wanted: usize| a.surfaces.len().max(b.surfaces.len()).div_ceil(wanted).max(1);
    let refined = |poses: Vec<Pose2>, width_m: f64, stride: usize| {
        let refine = |pose: Pose2| fine::refine(a, b, pose, width_m, stride);
        let mut poses: Vec<_> =
            poses.into_iter().map(refine).map(|pose| (pose, judge.evidence(pose, stride))).collect();
        poses.sort_by(|x, y| y.1.support_m.total_cmp(&x.1.support_m));
        poses
    };
    let coarse = coarse::search(a, b, lattice, REFINED).into_iter().map(|candidate| candidate.a_from_b).collect();
    let first = refined(coarse, lattice.step_m, stride(FIRST_LOOK));
    let cell_m = a.map.resolution_m.max(b.map.resolution_m);
    let mut apart: Vec<Pose2> = Vec::new();
    for (pose, _) in first {
        if apart.len() < JUDGED && apart.iter().all(|known| displacement(*known, pose, b) > ANOTHER_POSE_CELLS * cell_m)
        {
            apart.push(pose);
        }
    }
    refined(apart, 0.0, stride(LAST_LOOK))
}

fn world_from_middle(walls: &Walls<'_>) -> Pose2 {
    walls.map.world_from_map * Pose2::new(walls.middle[0], walls.middle[1], 0.0)
}
