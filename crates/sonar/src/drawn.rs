//! What echoes say of a map's cells: the inverse model of *Probabilistic Robotics* (2005), Table 9.2.

use crate::arc::Arc2;
use crate::wall::Wall;
use mapwright_geom::sin_cos;
use mapwright_sensor::SweepPoints;

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
