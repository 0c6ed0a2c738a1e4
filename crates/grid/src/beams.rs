//! What the beams of a scan say of a pose in a map that is taken for granted.

use crate::field::NO_OBSTACLE;
use crate::local_map::{LocalMap, Surfel};
use crate::tiles::floor_cell;
use mapwright_geom::Pose2;

/// An end point within two cells of an obstacle has met it, as in [`crate::Agreement`].
const MET_CELLS: f64 = 2.0;
/// A wall that a beam went through must lie so far before its end, metres: the far side of one that it has met is nearer.
const BEFORE_END_M: f64 = 0.3;
/// And stand across the beam: cosine squared between the beam and the wall's normal. A beam along a wall grazes its cells.
const ACROSS: f64 = 0.25;
/// And be a surface, which goes on to both sides of the beam: the trace of `A` of a [`Surfel`], 1 for a line and 2 for a point, hits at
/// least, and cells. A pose is not known so well that a beam must meet the leg of a chair or a corner.
const LINE: f32 = 1.5;
const SURFACE_HITS: u32 = 3;
const GOES_ON_CELLS: f64 = 2.0;

/// How the beams of a scan agree with a map at a pose, each counted once.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct BeamAgreement {
    /// End within a cell of the line of an obstacle.
    pub close: u32,
    /// End within two cells of an obstacle, but not as close to its line.
    pub near: u32,
    /// End away from every obstacle in space that beams have passed, so many as outweigh a hit.
    pub short: u32,
    /// Pass through a wall, wherever they end.
    pub through: u32,
    /// End where nothing, or too little, was ever measured.
    pub unknown: u32,
}

impl BeamAgreement {
    /// All beams.
    #[must_use]
    pub fn all(&self) -> u32 {
        self.close + self.near + self.short + self.through + self.unknown
    }

    /// Share of the beams that met an obstacle, among those the map says something about; 1 where it says nothing.
    #[must_use]
    pub fn inlier_share(&self) -> f64 {
        let known = self.all() - self.unknown;
        if known == 0 { 1.0 } else { f64::from(self.close + self.near) / f64::from(known) }
    }

    /// Share of the beams that the map says something about; 0 without beams.
    #[must_use]
    pub fn known_share(&self) -> f64 {
        let all = self.all();
        if all == 0 { 0.0 } else { f64::from(all - self.unknown) / f64::from(all) }
    }
}

impl LocalMap {
    /// How beams that start at `origin` and end at `points`, in the robot's frame, agree with the map at a pose.
    #[must_use]
    pub fn beams(&self, origin: [f64; 2], points: &[[f64; 2]], world_from_robot: Pose2) -> BeamAgreement {
        let from = world_from_robot.transform(origin);
        let mut agreement = BeamAgreement::default();
        for &point in points {
            let end = world_from_robot.transform(point);
            let count = if self.crosses_wall(from, end) {
                &mut agreement.through
            } else {
                self.end_of_beam(end, &mut agreement)
            };
            *count += 1;
        }
        agreement
    }

    /// The points, in the robot's frame, that end in known territory at a pose that may be off by `within_m`: in space that beams have passed,
    /// or so near to an obstacle. What stands where nothing is known would be drawn to the obstacle nearest to it.
    #[must_use]
    pub fn known_points(&self, points: &[[f64; 2]], world_from_robot: Pose2, within_m: f64) -> Vec<[f64; 2]> {
        let resolution_m = self.settings.resolution_m;
        let within_cells2 = (within_m / resolution_m).max(MET_CELLS).powi(2);
        let is_known = |&&point: &&[f64; 2]| {
            let [x, y] = world_from_robot.transform(point).map(|metres| floor_cell(metres / resolution_m));
            let nearest = self.field().nearest_cell(x, y);
            nearest.is_some_and(|(cells2, _)| f64::from(cells2) <= within_cells2) || self.counts().passes(x, y) > 0
        };
        points.iter().filter(is_known).copied().collect()
    }

    fn end_of_beam<'a>(&self, [x, y]: [f64; 2], agreement: &'a mut BeamAgreement) -> &'a mut u32 {
        let resolution_m = self.settings.resolution_m;
        let [cell_x, cell_y] = [x, y].map(|metres| floor_cell(metres / resolution_m));
        let slot = self.field().nearest(cell_x, cell_y);
        if slot != NO_OBSTACLE {
            let surfel = &self.surfels()[slot as usize];
            if (x - surfel.x).hypot(y - surfel.y) < MET_CELLS * resolution_m {
                let is_close = surfel.squared_distance(x, y) < resolution_m * resolution_m;
                return if is_close { &mut agreement.close } else { &mut agreement.near };
            }
        }
        if self.counts().passes(cell_x, cell_y) >= self.settings.passes_per_hit.max(1) {
            &mut agreement.short
        } else {
            &mut agreement.unknown
        }
    }

    /// Whether a wall stands across the way from one point to another, well before its end.
    #[must_use]
    pub fn crosses_wall(&self, from: [f64; 2], to: [f64; 2]) -> bool {
        let resolution_m = self.settings.resolution_m;
        let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
        let length_m = dx.hypot(dy);
        let direction = [dx / length_m, dy / length_m];
        let steps = ((length_m - BEFORE_END_M) / resolution_m).floor().max(0.0) as usize;
        let mut field = self.field().look_ups();
        let mut step = 1;
        while step <= steps {
            let along_m = step as f64 * resolution_m;
            let (x, y) = (from[0] + along_m * direction[0], from[1] + along_m * direction[1]);
            let [cell_x, cell_y] = [floor_cell(x / resolution_m), floor_cell(y / resolution_m)];
            let slot = field.nearest(cell_x, cell_y);
            if slot == NO_OBSTACLE {
                step += self.settings.radius_cells.max(1) as usize;
                continue;
            }
            let found = self.counts().cell(slot);
            let away = f64::from(found.x - cell_x).hypot(f64::from(found.y - cell_y));
            let surfel = &self.surfels()[slot as usize];
            if away < 1.0 && found.hits >= SURFACE_HITS && stands_across(surfel, direction) && self.goes_on(surfel) {
                return true;
            }
            // Nothing is nearer: so far there is no obstacle, whatever the cell's corner that the beam passes.
            step += ((away - 1.5).floor().max(1.0)) as usize;
        }
        false
    }
}

impl LocalMap {
    /// Whether there are obstacles along a line to both sides of its surfel.
    fn goes_on(&self, surfel: &Surfel) -> bool {
        let resolution_m = self.settings.resolution_m;
        let normal = [surfel.axx, surfel.ayy].map(|a| f64::from(a).max(0.0).sqrt());
        let along = [-normal[1] * f64::from(surfel.axy.signum()), normal[0]];
        [-GOES_ON_CELLS, GOES_ON_CELLS].into_iter().all(|cells| {
            let [x, y] = [surfel.x + cells * resolution_m * along[0], surfel.y + cells * resolution_m * along[1]];
            let nearest = self.field().nearest_cell(floor_cell(x / resolution_m), floor_cell(y / resolution_m));
            nearest.is_some_and(|(cells2, _)| cells2 <= 2)
        })
    }
}

fn stands_across(surfel: &Surfel, [x, y]: [f64; 2]) -> bool {
    let [axx, axy, ayy] = [surfel.axx, surfel.axy, surfel.ayy].map(f64::from);
    surfel.axx + surfel.ayy < LINE && axx * x * x + 2.0 * axy * x * y + ayy * y * y > ACROSS
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Change, LocalMapSettings};
    use mapwright_sensor::SweepPoints;

    /// A wall at x = 2 m, seen from the origin, five times.
    fn wall() -> LocalMap {
        let mut map = LocalMap::new(LocalMapSettings::default());
        let hits: Vec<[f64; 2]> = (-40..=40).map(|k| [2.0, 0.025 * f64::from(k)]).collect();
        let points = SweepPoints { normals: vec![[-1.0, 0.0]; hits.len()], hits, ..SweepPoints::default() };
        (0..5).for_each(|keyframe| map.change(&points, Pose2::IDENTITY, Change::Add, keyframe));
        map
    }

    #[test]
    fn each_beam_is_told_by_where_it_ends_and_what_it_passes() {
        let map = wall();
        let ends = [[2.0, 0.2], [2.08, 0.0], [1.0, 0.1], [3.0, 0.1], [0.0, 3.0]];
        let counts = map.beams([0.0; 2], &ends, Pose2::IDENTITY);
        assert_eq!(counts, BeamAgreement { close: 1, near: 1, short: 1, through: 1, unknown: 1 });
        assert_eq!(map.beams([0.0; 2], &[[3.0, 1.55]], Pose2::IDENTITY).through, 0, "its end");
        assert!((counts.known_share() - 0.8).abs() < 1e-12 && (counts.inlier_share() - 0.5).abs() < 1e-12);
        assert_eq!(map.beams([0.0; 2], &ends, Pose2::new(50.0, 0.0, 0.0)).unknown, 5);
    }

    #[test]
    fn what_stands_where_nothing_is_known_is_left_out() {
        let ends = [[2.0, 0.0], [1.0, 0.0], [2.08, 0.0], [2.3, 0.0]];
        let known = |within_m| wall().known_points(&ends, Pose2::IDENTITY, within_m).len();
        assert_eq!([0.0, 0.4].map(known), [3, 4]);
    }

    #[test]
    fn a_beam_along_a_wall_does_not_go_through_it() {
        let map = wall();
        assert!(!map.crosses_wall([1.9, -1.0], [2.1, 1.0]) && map.crosses_wall([1.0, 0.0], [3.0, 0.0]));
        assert!(!map.crosses_wall([1.0, 0.0], [2.1, 0.0]), "its far side");
    }
}
