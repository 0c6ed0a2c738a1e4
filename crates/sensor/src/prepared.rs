//! Preparation of a scan: what is a return, what only shows free space, what is dropped and why.

use crate::scan::{LaserModel, LaserScan};
use mapwright_geom::{Pose2, sin_cos};
use std::sync::Arc;

/// A beam that was dropped.
pub const BEAM_DROPPED: u16 = 0;
/// A beam that met nothing within the laser's reach; it still shows free space.
pub const BEAM_NO_RETURN: u16 = u16::MAX;

/// What became of a scan's beams. The fields add up to the number of beams.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BeamCounts {
    /// Beams that met something.
    pub returns: u32,
    /// Beams at or above maximum range, and infinite ones: free space, no return.
    pub no_return: u32,
    /// Beams below minimum range, zero or negative.
    pub too_near: u32,
    /// Beams of scans that were refused as a whole.
    pub refused: u32,
    /// Beams that are not a number.
    pub not_a_number: u32,
    /// Returns without a neighbour at their range, from a laser with many of them: see [`Sweep::drop_isolated`].
    pub isolated: u32,
    /// Returns from things that move.
    pub moving: u32,
    /// Returns from what travels with the robot: its own body, who pushes it.
    pub on_robot: u32,
    /// Points whose own standard deviation is large beside the voxels that they would be drawn in.
    pub uncertain: u32,
}

impl BeamCounts {
    /// Adds another scan's counts; saturates.
    pub fn add(&mut self, other: &Self) {
        self.returns = self.returns.saturating_add(other.returns);
        self.no_return = self.no_return.saturating_add(other.no_return);
        self.too_near = self.too_near.saturating_add(other.too_near);
        self.not_a_number = self.not_a_number.saturating_add(other.not_a_number);
        self.isolated = self.isolated.saturating_add(other.isolated);
        self.moving = self.moving.saturating_add(other.moving);
        self.on_robot = self.on_robot.saturating_add(other.on_robot);
        self.uncertain = self.uncertain.saturating_add(other.uncertain);
        self.refused = self.refused.saturating_add(other.refused);
    }
}

/// A scan's ranges, two bytes each, and the motion of the robot while it was taken.
///
/// A range is `code * step_m`, except for [`BEAM_DROPPED`] and [`BEAM_NO_RETURN`]. Everything that is later computed from
/// a scan, matching and drawing alike, starts from these codes.
#[derive(Debug, Clone, PartialEq)]
pub struct Sweep {
    /// The laser that took it.
    pub laser: Arc<LaserModel>,
    /// One code a beam.
    pub codes: Vec<u16>,
    /// Metres per code step: 1, 2, 5, 10... mm, the finest that reaches the laser's maximum range.
    pub step_m: f64,
    /// The robot's twist during the sweep, per second; zero where beam times are not known.
    pub twist_per_s: [f64; 3],
    /// The laser scatters, and its isolated returns were dropped: see [`Sweep::drop_isolated`].
    pub scatters: bool,
}

impl Sweep {
    /// A sweep without beams.
    #[must_use]
    pub fn empty(laser: &Arc<LaserModel>) -> Self {
        Self { laser: Arc::clone(laser), codes: Vec::new(), step_m: 0.001, twist_per_s: [0.0; 3], scatters: false }
    }

    /// Quantises a scan's ranges and counts what was dropped.
    #[must_use]
    pub fn from_scan(scan: &LaserScan, twist_per_s: [f64; 3]) -> (Self, BeamCounts) {
        let mut sweep = Self::empty(&scan.laser);
        let counts = sweep.fill(scan, twist_per_s, (0.0, f64::INFINITY));
        (sweep, counts)
    }

    /// As [`Sweep::from_scan`], into buffers that are kept from scan to scan; `limits_m` narrow the laser's own
    /// least and largest range.
    pub fn fill(&mut self, scan: &LaserScan, twist_per_s: [f64; 3], limits_m: (f64, f64)) -> BeamCounts {
        if !Arc::ptr_eq(&self.laser, &scan.laser) {
            self.laser = Arc::clone(&scan.laser);
        }
        self.step_m = code_step_m(scan.laser.range_max_m.min(limits_m.1));
        self.twist_per_s = if scan.laser.beam_period_s > 0.0 { twist_per_s } else { [0.0; 3] };
        self.scatters = false;
        self.codes.clear();
        let mut counts = BeamCounts::default();
        let min_m = scan.laser.range_min_m.max(limits_m.0).max(0.0) as f32;
        let max_m = scan.laser.range_max_m.min(limits_m.1) as f32;
        let steps_per_m = (1.0 / self.step_m) as f32;
        self.codes.extend(scan.ranges_m.iter().map(|&range_m| {
            if range_m >= max_m {
                counts.no_return += 1;
                BEAM_NO_RETURN
            } else if range_m > min_m {
                counts.returns += 1;
                ((range_m * steps_per_m + 0.5) as u32).clamp(1, 65_534) as u16
            } else if range_m.is_nan() {
                counts.not_a_number += 1;
                BEAM_DROPPED
            } else {
                counts.too_near += 1;
                BEAM_DROPPED
            }
        }));
        counts
    }

    /// Share of the returns that have no return of about their range among the two beams on either side; 0 without any.
    ///
    /// Thin objects and edges make a few per cent of them. Random readings make more.
    #[must_use]
    pub fn isolated_share(&self) -> f64 {
        let returns = self.codes.iter().filter(|&&code| is_return(code)).count();
        let reach = self.isolated_reach();
        let isolated = (0..self.codes.len()).filter(|&beam| is_isolated(&self.codes, beam, &reach)).count();
        if returns == 0 { 0.0 } else { isolated as f64 / returns as f64 }
    }

    /// Drops those returns and says how many there were.
    pub fn drop_isolated(&mut self) -> u32 {
        self.scatters = true;
        let (before, reach) = (self.codes.clone(), self.isolated_reach());
        let mut dropped = 0;
        for beam in 0..before.len() {
            if is_isolated(&before, beam, &reach) {
                self.codes[beam] = BEAM_DROPPED;
                dropped += 1;
            }
        }
        dropped
    }

    fn isolated_reach(&self) -> Neighbourhood {
        let step = self.reading_step();
        Neighbourhood { least_steps: (ISOLATED_M / self.step_m) as i32, beams: 2 * step + step / 2 }
    }

    /// Beams from one that has a reading to the next, the median: 1 but for lidars whose readings are put into a finer grid of bearings
    /// than they measure, which leaves most of its beams without a reading.
    #[must_use]
    pub fn reading_step(&self) -> usize {
        let dropped = self.codes.iter().map(|&code| u32::from(code == BEAM_DROPPED)).sum::<u32>() as usize;
        if dropped * 2 < self.codes.len() {
            return 1;
        }
        let mut gaps = [0_usize; READING_STEP_MOST];
        let (mut last, mut seen) = (None, 0);
        for (beam, _) in self.codes.iter().enumerate().filter(|&(_, &code)| code != BEAM_DROPPED) {
            if let Some(last) = last.replace(beam) {
                gaps[(beam - last).min(READING_STEP_MOST) - 1] += 1;
                seen += 1;
            }
        }
        let mut below = 0;
        gaps.iter()
            .position(|&count| {
                below += count;
                2 * below >= seen
            })
            .map_or(1, |step| step + 1)
    }

    /// The same sweep with every beam dropped: it says where the laser was and nothing of what it saw.
    #[must_use]
    pub fn blanked(&self) -> Self {
        let mut blank = self.clone();
        blank.codes.fill(BEAM_DROPPED);
        blank
    }

    /// Whether every beam was dropped.
    #[must_use]
    pub fn is_blank(&self) -> bool {
        self.codes.iter().all(|&code| code == BEAM_DROPPED)
    }

    /// Range of the farthest return in metres; 0 without any.
    #[must_use]
    pub fn farthest_m(&self) -> f64 {
        let farthest =
            self.codes.iter().fold(0, |most, &code| if code == BEAM_NO_RETURN { most } else { most.max(code) });
        f64::from(farthest) * self.step_m
    }

    /// Range of a return in metres, or `None` for a beam that is none.
    #[must_use]
    pub fn range_m(&self, beam: usize) -> Option<f64> {
        match self.codes.get(beam) {
            None | Some(&BEAM_DROPPED | &BEAM_NO_RETURN) => None,
            Some(&code) => Some(f64::from(code) * self.step_m),
        }
    }
}

/// A neighbour is at about the same range within this, metres, or within this share of the range.
const ISOLATED_M: f64 = 0.15;
const ISOLATED_SHARE: f64 = 0.1;
/// No grid of bearings is so many times finer than the readings put into it; longer gaps count as such.
const READING_STEP_MOST: usize = 32;

/// Where the neighbours of a return are looked for.
struct Neighbourhood {
    /// Steps of range to either side, at least.
    least_steps: i32,
    /// Beams to either side.
    beams: usize,
}

fn is_return(code: u16) -> bool {
    code != BEAM_DROPPED && code != BEAM_NO_RETURN
}

#[inline]
fn is_isolated(codes: &[u16], beam: usize, reach: &Neighbourhood) -> bool {
    // Most have a near neighbour at once.
    let next = codes.get(beam + 1).filter(|&&next| is_return(next));
    let is_near = next.is_some_and(|&next| i32::from(next.abs_diff(codes[beam])) <= reach.least_steps);
    is_return(codes[beam]) && !is_near && is_alone(codes, beam, reach)
}

#[inline(never)]
fn is_alone(codes: &[u16], beam: usize, reach: &Neighbourhood) -> bool {
    let code = i32::from(codes[beam]);
    let steps = reach.least_steps.max((ISOLATED_SHARE * f64::from(code)) as i32);
    let near = |&other: &u16| is_return(other) && (i32::from(other) - code).abs() <= steps;
    let before = &codes[beam.saturating_sub(reach.beams)..beam];
    let after = &codes[(beam + 1).min(codes.len())..codes.len().min(beam + 1 + reach.beams)];
    !before.iter().chain(after).any(near)
}

/// The finest step of the ladder 1, 2, 5 mm, 1, 2, 5 cm... with which a code reaches `range_max_m`.
fn code_step_m(range_max_m: f64) -> f64 {
    let needed_mm = if range_max_m.is_finite() { range_max_m / 65.534 } else { 1.0 };
    let mut decade_mm = 1.0;
    loop {
        for factor in [1.0, 2.0, 5.0] {
            if factor * decade_mm >= needed_mm || decade_mm > 1e9 {
                return factor * decade_mm * 1e-3;
            }
        }
        decade_mm *= 10.0;
    }
}

/// Unit directions of a laser's beams and its origin, both in the robot's frame. Computed once per laser and beam count.
#[derive(Debug, Clone, Default)]
pub struct BeamTable {
    key: Option<(Arc<LaserModel>, usize)>,
    directions: Vec<[f64; 2]>,
}

impl BeamTable {
    /// Directions in the robot's frame of the first `beams` beams of `laser`.
    pub fn directions(&mut self, laser: &Arc<LaserModel>, beams: usize) -> &[[f64; 2]] {
        let known = self.key.as_ref().is_some_and(|(model, n)| *n == beams && Arc::ptr_eq(model, laser));
        if !known {
            self.directions.clear();
            self.directions.extend((0..beams).map(|beam| {
                let (s, c) = sin_cos(laser.bearing_in_robot(beam));
                [c, s]
            }));
            self.key = Some((Arc::clone(laser), beams));
        }
        &self.directions
    }
}

/// Neighbours of a hit that tell its surface's direction lie within this, metres.
const NORMAL_REACH_M: f64 = 0.12;
/// The adjacent hit counts as neighbour up to so many beam spacings.
const NORMAL_GAP_SPACINGS: f64 = 3.5;
/// A hit without neighbours is a small object where beams are nearer to each other than this, metres.
const POINT_SPACING_M: f64 = 0.1;
/// Largest ratio of the neighbours' two variances at which they are a line.
const NORMAL_RATIO: f64 = 0.1;
/// Where a hit has no such neighbours, so many hits in a row, none farther from the next than the gap and none farther
/// off their common line than the width, show a surface that the beams graze. Beyond the gap a beam's spot is smeared
/// over so much of the surface that its range is biased.
const GRAZED_HITS: usize = 4;
const GRAZED_GAP_M: f64 = 0.3;
const GRAZED_WIDTH_M: f64 = 0.03;
/// Hits are compared with the line through those so many before and after them, where these are no farther apart, metres.
const OFFSET_HITS: usize = 2;
const OFFSET_REACH_M: f64 = 0.5;

/// End points of a sweep in the robot's frame at the sweep's stamp, metres, as the matcher and the map want them.
#[derive(Debug, Clone, Default)]
pub struct SweepPoints {
    /// Where beams met something.
    pub hits: Vec<[f64; 2]>,
    /// Unit normal of the surface at each hit, on the sensor's side, zero where the scan does not show one; see
    /// [`SweepPoints::fill_normals`].
    pub normals: Vec<[f64; 2]>,
    /// Ends of the free space along beams that met nothing.
    pub free_ends: Vec<[f64; 2]>,
    /// Where the beams start.
    pub origin: [f64; 2],
    /// Angle between neighbouring beams that have a reading, radians.
    pub beam_step_rad: f64,
    /// Hits in a row that may lie off a surface without ending it: random readings of a laser that scatters.
    pub misses: u32,
}

impl SweepPoints {
    /// Computes the end points. Beams that returned nothing show free space up to `free_range_m`, and never farther than the
    /// laser sees: its largest range, and the farthest return of this sweep.
    pub fn fill(&mut self, sweep: &Sweep, table: &mut BeamTable, free_range_m: f64) {
        let free_range_m = free_range_m.min(sweep.laser.range_max_m).min(sweep.farthest_m());
        self.hits.clear();
        self.normals.clear();
        self.free_ends.clear();
        let robot_from_laser = sweep.laser.robot_from_laser;
        self.origin = [robot_from_laser.x, robot_from_laser.y];
        self.beam_step_rad = sweep.laser.angle_step_rad.abs() * sweep.reading_step() as f64;
        self.misses = u32::from(sweep.scatters);
        let moving = sweep.twist_per_s != [0.0; 3];
        let directions = table.directions(&sweep.laser, sweep.codes.len());
        for (beam, (&code, &[c, s])) in sweep.codes.iter().zip(directions).enumerate() {
            if code == BEAM_DROPPED {
                continue;
            }
            let no_return = code == BEAM_NO_RETURN;
            let range_m = if no_return { free_range_m } else { f64::from(code) * sweep.step_m };
            let mut end = [self.origin[0] + range_m * c, self.origin[1] + range_m * s];
            if moving {
                let t = beam as f64 * sweep.laser.beam_period_s;
                end = Pose2::exp(sweep.twist_per_s.map(|rate| rate * t)).transform(end);
            }
            if no_return { self.free_ends.push(end) } else { self.hits.push(end) }
        }
    }

    /// Forgets all points.
    pub fn clear(&mut self) {
        self.hits.clear();
        self.normals.clear();
        self.free_ends.clear();
    }

    /// Fits a line to the neighbours of each hit along the sweep and keeps its normal where they are one.
    ///
    /// Neighbours on a side are hits within 0.12 m, and the adjacent one up to 3.5 beam spacings. A hit without any may
    /// still lie in a straight row of hits, where beams graze a wall.
    pub fn fill_normals(&mut self) {
        self.normals.clear();
        self.normals.reserve(self.hits.len());
        for i in 0..self.hits.len() {
            let [nx, ny] = self.normal(i);
            let [x, y] = self.hits[i];
            let to_sensor = nx * (self.origin[0] - x) + ny * (self.origin[1] - y);
            self.normals.push(if to_sensor < 0.0 { [-nx, -ny] } else { [nx, ny] });
        }
    }

    fn normal(&self, i: usize) -> [f64; 2] {
        let here = self.hits[i];
        let (dx, dy) = (here[0] - self.origin[0], here[1] - self.origin[1]);
        let spacing_m = self.beam_step_rad * (dx * dx + dy * dy).sqrt();
        let gap2 = (NORMAL_GAP_SPACINGS * spacing_m).max(NORMAL_REACH_M).powi(2);
        let mut near = Neighbours::of(here);
        near.gather(self.hits[i + 1..].iter().take(8), gap2, self.misses);
        near.gather(self.hits[i.saturating_sub(8)..i].iter().rev(), gap2, self.misses);
        if near.n < 2.5 {
            // Alone among densely spaced beams: something small. Alone among sparse ones: nothing is known.
            let dense = spacing_m < POINT_SPACING_M;
            return self.grazed(i).unwrap_or(if dense { [f64::NAN; 2] } else { [0.0; 2] });
        }
        let line = near.line().filter(|line| line.across <= NORMAL_RATIO * line.along);
        line.map_or([f64::NAN; 2], |line| line.normal)
    }

    /// Normal of the straightest row of hits around a hit that has no near neighbours.
    fn grazed(&self, i: usize) -> Option<[f64; 2]> {
        let mut best = (GRAZED_WIDTH_M, None);
        for first in (i + 1).saturating_sub(GRAZED_HITS)..=i {
            let Some(row) = self.hits.get(first..first + GRAZED_HITS) else { break };
            let far = |w: &[[f64; 2]]| (w[0][0] - w[1][0]).powi(2) + (w[0][1] - w[1][1]).powi(2) > GRAZED_GAP_M.powi(2);
            if row.windows(2).any(far) {
                continue;
            }
            let [mx, my] = [0, 1].map(|k| row.iter().map(|p| p[k]).sum::<f64>() / GRAZED_HITS as f64);
            let scatter = |a: usize, b: usize| row.iter().map(|p| (p[a] - [mx, my][a]) * (p[b] - [mx, my][b])).sum();
            let Some(Line { normal: [nx, ny], .. }) = Line::of_scatter(scatter(0, 0), scatter(0, 1), scatter(1, 1))
            else {
                continue;
            };
            let width = row.iter().map(|p| ((p[0] - mx) * nx + (p[1] - my) * ny).abs()).fold(0.0, f64::max);
            if width < best.0 {
                best = (width, Some([nx, ny]));
            }
        }
        best.1
    }

    /// How far hits lie from the line through the second one before and the second one after them, metres, where those are
    /// within 0.5 m of each other. On a straight wall with noise of sigma across it their variance is `1.5 sigma^2`.
    pub fn offsets_m(&self) -> impl Iterator<Item = f64> + '_ {
        self.hits.windows(2 * OFFSET_HITS + 1).filter_map(|row| {
            let (a, here, b) = (row[0], row[OFFSET_HITS], row[2 * OFFSET_HITS]);
            let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
            let apart_m = dx.hypot(dy);
            let off_m = ((here[0] - a[0]) * dy - (here[1] - a[1]) * dx).abs() / apart_m;
            (apart_m > 0.0 && apart_m <= OFFSET_REACH_M).then_some(off_m)
        })
    }

    /// Root mean square range of the hits and the range of the farthest one, metres; 1 m each without hits.
    #[must_use]
    pub fn lever_and_reach_m(&self) -> (f64, f64) {
        let squared = |p: &[f64; 2]| (p[0] - self.origin[0]).powi(2) + (p[1] - self.origin[1]).powi(2);
        let sum: f64 = self.hits.iter().map(squared).sum();
        let farthest = self.hits.iter().map(squared).fold(0.0, f64::max);
        if self.hits.is_empty() { (1.0, 1.0) } else { ((sum / self.hits.len() as f64).sqrt(), farthest.sqrt()) }
    }
}

/// Sums over a hit and its neighbours, relative to it.
struct Neighbours {
    here: [f64; 2],
    n: f64,
    sx: f64,
    sy: f64,
    sxx: f64,
    sxy: f64,
    syy: f64,
}

impl Neighbours {
    fn of(here: [f64; 2]) -> Self {
        Self { here, n: 1.0, sx: 0.0, sy: 0.0, sxx: 0.0, sxy: 0.0, syy: 0.0 }
    }

    /// Adds the hits of one side, from the nearest on, until more than `misses` are too far away.
    #[inline]
    fn gather<'a>(&mut self, side: impl Iterator<Item = &'a [f64; 2]>, gap2: f64, misses: u32) {
        let (mut limit2, mut missed) = (gap2, 0);
        for p in side {
            let (dx, dy) = (p[0] - self.here[0], p[1] - self.here[1]);
            let (dxx, dyy) = (dx * dx, dy * dy);
            if dxx + dyy > limit2 {
                if missed == misses {
                    break;
                }
                missed += 1;
                continue;
            }
            limit2 = NORMAL_REACH_M * NORMAL_REACH_M;
            self.n += 1.0;
            self.sx += dx;
            self.sy += dy;
            self.sxx += dxx;
            self.sxy += dx * dy;
            self.syy += dyy;
        }
    }

    fn line(&self) -> Option<Line> {
        let n = self.n;
        let (mx, my) = (self.sx / n, self.sy / n);
        Line::of_scatter(self.sxx / n - mx * mx, self.sxy / n - mx * my, self.syy / n - my * my)
    }
}

/// A line through points, from their scatter matrix.
struct Line {
    normal: [f64; 2],
    /// Variances along and across it.
    along: f64,
    across: f64,
}

impl Line {
    fn of_scatter(xx: f64, xy: f64, yy: f64) -> Option<Self> {
        let (mean, diff) = (0.5 * (xx + yy), 0.5 * (xx - yy));
        let root = (diff * diff + xy * xy).sqrt();
        // Eigenvector of the smaller eigenvalue, from the better conditioned row.
        let (vx, vy) = if diff > 0.0 { (-xy, root + diff) } else { (root - diff, -xy) };
        let norm = (vx * vx + vy * vy).sqrt();
        (norm > 0.0).then(|| Self { normal: [vx / norm, vy / norm], along: mean + root, across: mean - root })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_blank_sweep_has_its_beams_and_saw_nothing() {
        let laser = Arc::new(LaserModel::half_circle("front", 3));
        let ranges_m = vec![1.0, f32::INFINITY, f32::NAN];
        let scan = LaserScan { stamp: mapwright_geom::Stamp(0), laser, ranges_m, odom_from_robot: None };
        let (sweep, _) = Sweep::from_scan(&scan, [0.0; 3]);
        let blank = sweep.blanked();
        assert!(blank.is_blank() && !sweep.is_blank() && blank.codes.len() == 3);
        let free = Sweep { codes: vec![BEAM_DROPPED, BEAM_NO_RETURN, BEAM_DROPPED], ..blank };
        assert!(!free.is_blank(), "a beam without a return has seen free space");
    }

    fn prepared(ranges_m: Vec<f32>, range_max_m: f64) -> (Sweep, SweepPoints) {
        let laser = Arc::new(LaserModel { range_max_m, ..LaserModel::half_circle("front", ranges_m.len()) });
        let scan = LaserScan { stamp: mapwright_geom::Stamp(0), laser, ranges_m, odom_from_robot: None };
        let (sweep, _) = Sweep::from_scan(&scan, [0.0; 3]);
        let mut points = SweepPoints::default();
        points.fill(&sweep, &mut BeamTable::default(), 6.0);
        (sweep, points)
    }

    #[test]
    fn beams_without_return_clear_no_farther_than_the_laser_sees() {
        let free_m = |ranges_m: [f32; 3], range_max_m: f64| {
            let (_, points) = prepared(ranges_m.to_vec(), range_max_m);
            points.free_ends.iter().map(|[x, y]| x.hypot(*y)).collect::<Vec<_>>()
        };
        let is_near = |found: Vec<f64>, expected: &[f64]| {
            found.len() == expected.len() && found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9)
        };
        assert!(is_near(free_m([20.0, f32::INFINITY, 3.0], 30.0), &[6.0]), "as far as is asked for");
        assert!(is_near(free_m([3.0, f32::INFINITY, 3.5], 3.5), &[3.0, 3.0]), "as far as returns of this sweep go");
        assert!(is_near(free_m([9.0, 2.0, f32::INFINITY], 80.0), &[6.0]));
        assert!(is_near(free_m([f32::INFINITY; 3], 3.5), &[0.0; 3]), "a laser that sees nothing clears nothing");
    }

    #[test]
    fn readings_in_a_finer_grid_of_bearings_are_as_good_as_in_their_own() {
        let wall: Vec<f32> = (0..180).map(|beam| 2.0 + 0.001 * beam as f32).collect();
        let mut fine = vec![0.0; 180 * 9 / 2];
        // every fourth or fifth of the grid's beams
        wall.iter().enumerate().for_each(|(beam, &range_m)| fine[beam * 9 / 2] = range_m);
        let ((own, own_points), (mut sparse, points)) = (prepared(wall, 80.0), prepared(fine, 80.0));
        assert_eq!((own.reading_step(), own.isolated_share()), (1, 0.0));
        assert!((4..=5).contains(&sparse.reading_step()) && sparse.isolated_share() == 0.0);
        assert!((points.beam_step_rad / own_points.beam_step_rad - 1.0).abs() < 0.15);
        sparse.codes[90] = 60;
        assert_eq!(sparse.drop_isolated(), 1, "one that stands alone is told all the same");
        assert_eq!(prepared(vec![0.0; 9], 80.0).0.reading_step(), 1);
    }

    #[test]
    fn normals_point_to_where_the_surface_was_seen_from() {
        let along = |k: i32| -1.0 + 0.04 * f64::from(k);
        for origin in [[0.5, 0.2], [-3.0, 0.0], [3.0, 0.0]] {
            let hits = [-2.0, 2.0].into_iter().flat_map(|x| (0..50).map(move |k| [x, along(k)])).collect();
            let mut points = SweepPoints { hits, origin, beam_step_rad: 0.01, ..SweepPoints::default() };
            points.fill_normals();
            for (hit, normal) in points.hits.iter().zip(&points.normals) {
                assert!(normal[0].abs() > 0.99, "{normal:?} at {hit:?}");
                assert!(normal[0] * (origin[0] - hit[0]) > 0.0, "{normal:?} at {hit:?} seen from {origin:?}");
            }
            assert_eq!(points.normals.len(), 100);
        }
    }
}
