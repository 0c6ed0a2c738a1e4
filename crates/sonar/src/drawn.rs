//! What echoes say of a map's cells: the inverse model of *Probabilistic Robotics* (2005), Table 9.2.

use crate::arc::Arc2;
use crate::wall::Wall;
use mapwright_geom::{Pose2, sin_cos, wrap_angle};
use mapwright_sensor::SweepPoints;
use std::collections::HashMap;

/// Free space ends so far before an echo or a wall, metres: the cell of the echo is not free.
const FREE_SHORT_M: f64 = 0.1;
/// Rays of free space are so far apart at their ends, metres: no cell of 0.1 m lies between two.
const FREE_STEP_M: f64 = 0.08;
/// What lies so far behind a wall was not heard straight through it, metres: three standard deviations of an echo from 3 m away.
const BEHIND_M: f64 = 0.15;

/// What the echoes of a stretch say: something where each came from, nothing nearer within its cone.
///
/// The table marks the whole arc as occupied. Here the arc has shrunk to where the others of its stretch leave it, the wall that it is
/// tangent to or the edge that it crosses. Echoes that nothing bears out say nothing: of a detour both halves would be wrong. Nor does
/// silence, for smooth walls are silent. For the same reason a cone is free up to the walls of its stretch only, and what seems to lie behind one
/// came by a detour.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DrawnEchoes {
    walls: Vec<Wall>,
    /// Each with the number of its wall and its place along it, metres.
    echoes: Vec<(Arc2, usize, f64)>,
}

/// Where walls were heard on the whole way, in cells of the map, and which way they face.
///
/// A smooth wall is silent to a cone that it does not face: a cone that heard something behind it says nothing against the wall, and
/// nothing of what lies behind.
#[derive(Debug, Clone, PartialEq)]
pub struct HeardWalls {
    cell_m: f64,
    /// How often, and the sums of the cosines and sines of twice the normal's angle: the same for both sides.
    cells: HashMap<[i32; 2], (u32, [f64; 2])>,
}

/// A wall is where so many echoes came from.
const HEARD_TIMES: u32 = 2;

impl HeardWalls {
    /// None yet, in a map of cells of this side.
    #[must_use]
    pub fn new(cell_m: f64) -> Self {
        Self { cell_m, cells: HashMap::new() }
    }

    /// Those of a stretch's echoes, taken at this pose.
    pub fn add(&mut self, points: &SweepPoints, map_from_robot: Pose2) {
        for (hit, normal) in points.hits.iter().zip(&points.normals) {
            let (sin, cos) = sin_cos(2.0 * (map_from_robot.theta + normal[1].atan2(normal[0])));
            let (times, [x, y]) = self.cells.entry(self.cell(map_from_robot.transform(*hit))).or_default();
            *times += 1;
            *x += cos;
            *y += sin;
        }
    }

    /// Ends free rays of a cone with this axis in the robot's frame before walls that are silent to it.
    pub fn shorten(&self, points: &mut SweepPoints, arc: &Arc2, map_from_robot: Pose2) {
        let from = map_from_robot.transform(points.origin);
        let back = map_from_robot.inverse();
        let seen = Arc2 { stretch_from_sonar: map_from_robot * arc.stretch_from_sonar, ..*arc };
        for end in &mut points.free_ends {
            let to = map_from_robot.transform(*end);
            let (away, far_m) = direction(from, to);
            let steps = (far_m / self.cell_m).floor().min(1e4) as u32;
            let at = |step: u32| [0, 1].map(|k| from[k] + f64::from(step) * self.cell_m * away[k]);
            if let Some(step) = (1..=steps).find(|&step| self.is_silent(at(step), away, &seen)) {
                *end = back.transform(at(step - 1));
            }
        }
    }

    /// Whether there is a wall that this cone would not have heard.
    fn is_silent(&self, place: [f64; 2], away: [f64; 2], arc: &Arc2) -> bool {
        let Some((times, [x, y])) = self.cells.get(&self.cell(place)) else { return false };
        let normal_rad = 0.5 * y.atan2(*x);
        let (sin, cos) = sin_cos(normal_rad);
        let is_away = cos * away[0] + sin * away[1] > 0.0;
        let away_rad = if is_away { normal_rad } else { wrap_angle(normal_rad + std::f64::consts::PI) };
        *times >= HEARD_TIMES && !arc.faces(away_rad)
    }

    fn cell(&self, place: [f64; 2]) -> [i32; 2] {
        place.map(|metres| (metres / self.cell_m).floor() as i32)
    }
}

impl DrawnEchoes {
    /// Of all walls of a stretch.
    pub(crate) fn new(arcs: &[Arc2], walls: &[Wall]) -> Self {
        let of_wall = |(number, wall): (usize, &Wall)| {
            let echo = |&(echo, along_m): &(usize, f64)| Some((*arcs.get(echo)?, number, along_m));
            wall.echoes.iter().filter_map(echo).collect::<Vec<_>>()
        };
        let echoes = walls.iter().enumerate().flat_map(of_wall).collect();
        let walls = walls.iter().map(|wall| Wall { echoes: Vec::new(), ..wall.clone() }).collect();
        Self { walls, echoes }
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.echoes.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.echoes.is_empty()
    }

    /// An echo's arc.
    #[must_use]
    pub fn arc(&self, echo: usize) -> Option<&Arc2> {
        self.echoes.get(echo).map(|(arc, _, _)| arc)
    }

    /// Puts an echo where a scan's points are drawn from: one hit, and free rays over the cone, all in the stretch's frame. Nothing
    /// where it came by a detour, or where there is no such echo.
    pub fn fill(&self, echo: usize, points: &mut SweepPoints) {
        points.clear();
        let Some(&(arc, number, along_m)) = self.echoes.get(echo) else { return };
        let Some(wall) = self.walls.get(number) else { return };
        let sonar = [arc.stretch_from_sonar.x, arc.stretch_from_sonar.y];
        let hit = wall.at(along_m);
        let (away, distance_m) = direction(sonar, hit);
        if self.clear_m(number, sonar, away, distance_m) + BEHIND_M < distance_m {
            return;
        }
        points.origin = sonar;
        points.hits.push(hit);
        let (normal, _) = wall.axes();
        points.normals.push(normal.map(|n| -n));
        let free_m = arc.range_m - FREE_SHORT_M;
        if free_m <= 0.0 {
            return;
        }
        let steps = (2.0 * arc.half_rad * free_m / FREE_STEP_M).ceil().clamp(1.0, 360.0) as u32;
        for k in 0..=steps {
            let bearing_rad = arc.half_rad * (2.0 * f64::from(k) / f64::from(steps) - 1.0);
            let (sin, cos) = sin_cos(arc.stretch_from_sonar.theta + bearing_rad);
            let clear_m = self.clear_m(usize::MAX, sonar, [cos, sin], free_m + FREE_SHORT_M) - FREE_SHORT_M;
            if clear_m > 0.0 {
                points.free_ends.push([sonar[0] + clear_m * cos, sonar[1] + clear_m * sin]);
            }
        }
    }

    /// How far a ray goes, at most so far, until it meets a wall but this one from the robot's side, metres.
    fn clear_m(&self, but: usize, from: [f64; 2], direction: [f64; 2], most_m: f64) -> f64 {
        let others = self.walls.iter().enumerate().filter(|(number, _)| *number != but);
        others.filter_map(|(_, wall)| wall.met_m(from, direction)).fold(most_m, f64::min)
    }
}

fn direction(from: [f64; 2], to: [f64; 2]) -> ([f64; 2], f64) {
    let away = [to[0] - from[0], to[1] - from[1]];
    let distance_m = away[0].hypot(away[1]);
    (away.map(|part| part / distance_m.max(1e-9)), distance_m)
}
