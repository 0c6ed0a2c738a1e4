//! Where to drive: a world together with a way through it.

use crate::math::{Point, add, atan2, distance, scale, sub, unit};
use crate::rng::Rng;
use crate::shape::Segment;
use crate::world::{Door, Schedule, Walker, World};
use mapwright_geom::Pose2;

/// Waypoints to be driven in order, metres in the world.
#[derive(Debug, Clone, PartialEq)]
pub struct Route {
    /// The waypoints.
    pub waypoints: Vec<Point>,
    /// Whether to go on from the last to the first, without end.
    pub endless: bool,
}

impl Route {
    /// A route with an end.
    #[must_use]
    pub fn new(waypoints: Vec<Point>) -> Self {
        Self { waypoints, endless: false }
    }

    /// Waypoint by number; an endless route wraps around.
    #[must_use]
    pub fn waypoint(&self, number: usize) -> Option<Point> {
        let index = if self.endless { number % self.waypoints.len().max(1) } else { number };
        self.waypoints.get(index).copied()
    }

    /// The straight legs, the one back to the start included where the route is endless.
    pub fn legs(&self) -> impl Iterator<Item = Segment> + '_ {
        let count = if self.endless { self.waypoints.len() } else { self.waypoints.len().saturating_sub(1) };
        (0..count).filter_map(|k| Some(Segment { a: self.waypoint(k)?, b: self.waypoint(k + 1)? }))
    }

    /// Length of all legs, metres.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        self.legs().map(|leg| leg.length_m()).sum()
    }
}

/// A world and a way through it.
#[derive(Debug, Clone)]
pub struct Site {
    /// What can be seen.
    pub world: World,
    /// Where to drive.
    pub route: Route,
}

impl Site {
    /// So many metres along the first leg of the route, looking along it; negative ones lie before its beginning.
    #[must_use]
    pub fn start(&self, along_m: f64) -> Pose2 {
        let (Some(from), Some(to)) = (self.route.waypoint(0), self.route.waypoint(1)) else { return Pose2::IDENTITY };
        let along = unit(sub(to, from));
        let [x, y] = add(from, scale(along, along_m));
        Pose2::new(x, y, atan2(along[1], along[0]))
    }

    /// The same with `count` people walking to and fro on stretches of the route, at 0.7 to 1.4 m/s.
    #[must_use]
    pub fn with_people(mut self, count: usize, seed: u64) -> Self {
        let mut rng = Rng::keyed(seed, 0x7065_6f70_6c65);
        let walkers: Vec<Walker> = (0..count).map(|_| stroller(&self.route, &mut rng)).collect();
        self.world = self.world.with_walkers(walkers);
        self
    }

    /// The same with a share of those doors shut now and then, for minutes, that the route does not lead through.
    #[must_use]
    pub fn with_changing_doors(mut self, share: f64, seed: u64) -> Self {
        let mut rng = Rng::keyed(seed, 0x646f_6f72_7363);
        let legs: Vec<Segment> = self.route.legs().collect();
        let used = |door: &Door| legs.iter().any(|leg| leg.distance_to_segment(&door.shut) < 0.6);
        let schedule = |rng: &mut Rng| {
            let (present_s, absent_s) = (rng.uniform(60.0, 400.0), rng.uniform(60.0, 400.0));
            Schedule::Repeating { present_s, absent_s, phase_s: rng.uniform(0.0, 800.0) }
        };
        let change = |door: &Door| {
            let shut_when = schedule(&mut rng);
            let changes = rng.chance(share) && door.open.is_some() && !used(door);
            Door { shut_when: if changes { shut_when } else { door.shut_when.clone() }, ..door.clone() }
        };
        let doors: Vec<Door> = self.world.doors().iter().map(change).collect();
        self.world = self.world.without_doors().with_doors(doors);
        self
    }

    /// Smallest distance of the route from anything that stands still and from doors, shut or open, metres.
    #[must_use]
    pub fn clearance_m(&self) -> f64 {
        let doors = self.world.doors().iter().flat_map(Door::leaves);
        let segments: Vec<Segment> = self.world.segments().iter().copied().chain(doors).collect();
        let clear_of_leg = |leg: Segment| {
            let walls = segments.iter().map(|wall| wall.distance_to_segment(&leg));
            let pillars = self.world.circles().iter().map(|c| leg.distance_to_point(c.center) - c.radius_m);
            walls.chain(pillars).fold(f64::INFINITY, f64::min)
        };
        self.route.legs().map(clear_of_leg).fold(f64::INFINITY, f64::min)
    }
}

/// Somebody who walks some 15 to 40 m of the route.
fn stroller(route: &Route, rng: &mut Rng) -> Walker {
    let from = rng.below(route.waypoints.len());
    let wanted_m = rng.uniform(15.0, 40.0);
    let mut path: Vec<Point> = Vec::new();
    let mut walked_m = 0.0;
    for &point in route.waypoints.iter().skip(from) {
        walked_m += path.last().map_or(0.0, |&last| distance(last, point));
        path.push(point);
        if walked_m > wanted_m {
            break;
        }
    }
    let mut walker = Walker::new(path, rng.uniform(0.7, 1.4));
    walker.start_m = rng.uniform(0.0, 40.0);
    walker
}
