//! How simulated robots follow their ways.

use mapwright::{LaserScan, Pose2};
use mapwright_explore::{OccupancyMap, Order, Terrain, Traffic, Travel, Traveller};
use mapwright_geom::wrap_angle;
use mapwright_sim::Twist;

/// The point of the way that is steered for lies so far ahead, metres.
const LOOKAHEAD_M: f64 = 0.25;
/// Beyond this heading error a robot turns on the spot, radians.
const TURN_ON_SPOT_RAD: f64 = 0.7;
/// Turn rate per radian of heading error, 1/s.
const STEER_GAIN_PER_S: f64 = 2.5;
/// Distance that robots keep from each other beyond their radii, metres: half a cell, and what a pose may be off.
const KEEP_M: f64 = 0.1;
/// Robots farther from each other than this need not mind each other for a second, nor make room in time, metres: what a window of ways is
/// long.
pub(super) const MEETING_M: f64 = 6.0;
/// Robots keep so much room on top of their radius to what their laser shows, metres, where there is so much: half a cell, as ways do.
const ROOM_M: f64 = 0.05;
/// They turn so far out of their way for it, radians, for each metre that is missing.
const TURN_RAD_PER_M: f64 = 20.0;
/// Directions that are weighed: so many to each side, so far from each other, radians.
const TURNS: i32 = 18;
const TURN_RAD: f64 = 0.0873;
/// What the laser shows beyond this does not matter for the next step, metres.
const NEAR_M: f64 = 1.0;
/// A robot does not drive on where another stands on so much of its way, metres.
const CLEAR_M: f64 = 0.5;
/// After so many steps without moving a robot was held by something, and backs off for so many.
const HELD_STEPS: u32 = 10;
const BACK_STEPS: u32 = 10;
const BACK_M_PER_S: f64 = -0.2;

/// A robot as its driver knows it.
#[derive(Debug, Clone, Default)]
pub(super) struct Driver {
    pub(super) map_from_robot: Pose2,
    pub(super) alive: bool,
    /// Where it is to go, and what it takes to get anywhere from there.
    goal_m: Option<[f64; 2]>,
    from_goal: Travel,
    /// What that was computed for is no more.
    is_old: bool,
    /// It follows its order's way, for nobody is near.
    is_alone: bool,
    /// The way ahead, from the robot on, as far as it need not wait.
    way_m: Vec<[f64; 2]>,
    /// Steps that it did not move though it was to, and steps that it still backs off.
    held: u32,
    back: u32,
    /// What its laser shows near it, in the frame of its odometry, and where it is in that now.
    odom_from_near: Vec<[f64; 2]>,
    odom_from_robot: Pose2,
}

/// Where a robot drives.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ground<'a> {
    pub(super) map: &'a OccupancyMap,
    pub(super) terrain: &'a Terrain,
    /// Not what it was when ways were last found.
    pub(super) is_new: bool,
}

impl Driver {
    pub(super) fn standing(map_from_robot: Pose2) -> Self {
        Self { map_from_robot, alive: true, ..Self::default() }
    }

    pub(super) fn at_m(&self) -> [f64; 2] {
        [self.map_from_robot.x, self.map_from_robot.y]
    }

    /// It stays where it is for good.
    pub(super) fn switch_off(&mut self) {
        (self.alive, self.goal_m) = (false, None);
        self.way_m.clear();
    }

    /// Sees what is near. Its map shows that too, but only as cells.
    pub(super) fn look(&mut self, scan: &LaserScan, odom_from_robot: Pose2) {
        self.odom_from_near.clear();
        for (beam, range_m) in scan.ranges_m.iter().map(|&range_m| f64::from(range_m)).enumerate() {
            if (scan.laser.range_min_m..NEAR_M).contains(&range_m) {
                let (sin, cos) = mapwright_geom::sin_cos(scan.laser.bearing_in_robot(beam));
                let Pose2 { x, y, .. } = scan.laser.robot_from_laser;
                self.odom_from_near.push(odom_from_robot.transform([x + range_m * cos, y + range_m * sin]));
            }
        }
    }

    pub(super) fn move_to(&mut self, map_from_robot: Pose2, odom_from_robot: Pose2) {
        (self.map_from_robot, self.odom_from_robot) = (map_from_robot, odom_from_robot);
    }

    /// Takes an order. A robot that is alone follows the order's way from when that was found on.
    fn send(&mut self, order: Option<&Order>, ground: Ground<'_>, is_alone: bool) {
        let goal_m = order.and_then(|order| order.goal_m).filter(|_| self.alive);
        let is_new = ground.is_new || goal_m != self.goal_m;
        self.goal_m = goal_m;
        self.is_old |= is_new;
        self.is_alone = is_alone && (is_new || self.is_alone);
        if is_new && self.is_alone {
            self.way_m.clear();
            self.way_m.extend(order.iter().flat_map(|order| &order.path_m));
        }
        if !self.is_alone
            && self.is_old
            && let Some(goal_m) = goal_m
        {
            self.from_goal.fill(ground.map, ground.terrain, goal_m);
            self.is_old = false;
        }
    }

    /// Notes how far the robot got in a step that it was told to drive in. Where it was held for long enough to say so.
    pub(super) fn moved(&mut self, told: Twist, moved_m: f64, radius_m: f64) -> Option<[f64; 2]> {
        self.back = self.back.saturating_sub(1);
        let is_held = told.speed_m_per_s > 0.05 && moved_m < 1e-3;
        self.held = if is_held { self.held + 1 } else { 0 };
        if self.held <= HELD_STEPS {
            return None;
        }
        (self.held, self.back) = (0, BACK_STEPS);
        Some(self.map_from_robot.transform([radius_m, 0.0]))
    }

    /// The bearing to drive on: that of the way, or, where something stands too near to it, one beside (as vector field histograms,
    /// Borenstein and Koren 1991), and whether there is room straight ahead.
    fn clear_bearing(&self, way_rad: f64, length_m: f64, radius_m: f64) -> (f64, bool) {
        let robot_from_odom = self.odom_from_robot.inverse();
        let near: Vec<[f64; 2]> = self.odom_from_near.iter().map(|&point| robot_from_odom.transform(point)).collect();
        // Of everything that the robot would get nearer to.
        let clearance_m = |bearing_rad: f64, length_m: f64| {
            let (sin, cos) = mapwright_geom::sin_cos(bearing_rad);
            let away_m = |&[x, y]: &[f64; 2]| {
                let along_m = x * cos + y * sin;
                let end_m = along_m.min(length_m);
                if along_m <= 0.0 { f64::INFINITY } else { (x - end_m * cos).hypot(y - end_m * sin) }
            };
            near.iter().map(away_m).fold(f64::INFINITY, f64::min)
        };
        let cost = |&turn_rad: &f64| {
            let missing_m = (radius_m + ROOM_M - clearance_m(way_rad + turn_rad, length_m)).max(0.0);
            turn_rad.abs() + TURN_RAD_PER_M * missing_m
        };
        let turns = (-TURNS..=TURNS).map(|k| f64::from(k) * TURN_RAD);
        let turn_rad = turns.min_by(|a, b| cost(a).total_cmp(&cost(b))).unwrap_or(0.0);
        (wrap_angle(way_rad + turn_rad), clearance_m(0.0, 0.5 * LOOKAHEAD_M) > radius_m)
    }

    /// What the robot does now to follow its way.
    fn steer(&mut self, radius_m: f64, speed_m_per_s: f64) -> Twist {
        if self.back > 0 {
            return Twist { speed_m_per_s: BACK_M_PER_S, turn_rate_rad_per_s: 0.0 };
        }
        let (at_m, heading_rad) = (self.at_m(), self.map_from_robot.theta);
        let passed = self.way_m.iter().take_while(|point| apart_m(**point, at_m) < LOOKAHEAD_M).count();
        self.way_m.drain(..passed.min(self.way_m.len().saturating_sub(1)));
        let Some((&target, &end)) = self.way_m.first().zip(self.way_m.last()) else { return Twist::default() };
        let end_m = apart_m(at_m, end);
        if end_m < 0.06 {
            return Twist::default();
        }
        let way_rad = (target[1] - at_m[1]).atan2(target[0] - at_m[0]) - heading_rad;
        let (error_rad, has_room) = self.clear_bearing(way_rad, apart_m(at_m, target).min(LOOKAHEAD_M), radius_m);
        // Who is not turned to where it is to drive yet does not drive where it cannot.
        let turns = !has_room && error_rad.abs() > TURN_RAD;
        let straight = if turns { 0.0 } else { (1.0 - error_rad.abs() / TURN_ON_SPOT_RAD).max(0.0) };
        let slower = (end_m / 0.3).clamp(0.2, 1.0);
        Twist { speed_m_per_s: speed_m_per_s * straight * slower, turn_rate_rad_per_s: STEER_GAIN_PER_S * error_rad }
    }

    /// Whether the next piece of the way leads nearer to what stands there.
    fn leads_into(&self, other_m: [f64; 2], keep_m: f64) -> bool {
        let (at_m, mut along_m, mut from) = (self.at_m(), 0.0, self.at_m());
        for &to in &self.way_m {
            along_m += apart_m(from, to);
            if along_m > CLEAR_M {
                break;
            }
            let away_m = apart_m(to, other_m);
            if away_m < keep_m && away_m < apart_m(at_m, other_m) - 0.01 {
                return true;
            }
            from = to;
        }
        false
    }
}

/// What a robot does now: along its way, but not into another robot.
pub(super) fn twist(driver: &mut Driver, others_m: &[[f64; 2]], radius_m: f64, speed_m_per_s: f64) -> Twist {
    if !driver.alive {
        return Twist::default();
    }
    let twist = driver.steer(radius_m, speed_m_per_s);
    let keep_m = 2.0 * radius_m + 0.5 * KEEP_M;
    let in_the_way = others_m.iter().any(|&other_m| driver.leads_into(other_m, keep_m));
    let speed_m_per_s = if in_the_way { twist.speed_m_per_s.min(0.0) } else { twist.speed_m_per_s };
    Twist { speed_m_per_s, ..twist }
}

/// Finds every robot's way anew: to its goal around the others, or out of their way.
pub(super) fn find_ways(
    traffic: &mut Traffic,
    grounds: &[Ground<'_>],
    drivers: &mut [Driver],
    orders: &[Option<Order>],
    radius_m: f64,
) {
    let at_m: Vec<[f64; 2]> = drivers.iter().map(Driver::at_m).collect();
    for (number, driver) in drivers.iter_mut().enumerate() {
        let near = |other: usize| other != number && apart_m(at_m[other], at_m[number]) < MEETING_M;
        driver.send(orders[number].as_ref(), grounds[number], !(0..at_m.len()).any(near));
    }
    let robots: Vec<Traveller<'_>> = drivers
        .iter()
        .zip(grounds)
        .map(|(driver, ground)| Traveller {
            at_m: driver.at_m(),
            map: ground.map,
            terrain: ground.terrain,
            from_goal: driver.goal_m.filter(|_| !driver.is_alone).map(|_| &driver.from_goal),
            drives: driver.alive,
        })
        .collect();
    let ways_m = traffic.ways(&robots, 2.0 * radius_m + KEEP_M);
    for (driver, way_m) in drivers.iter_mut().zip(ways_m).filter(|(driver, _)| !driver.is_alone) {
        driver.way_m = way_m;
        // From the middle of the goal's block to the goal.
        let near = |goal_m: &[f64; 2]| driver.way_m.last().is_some_and(|&end| apart_m(end, *goal_m) < 0.2);
        driver.way_m.extend(driver.goal_m.filter(near));
    }
}

pub(super) fn apart_m(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright_explore::Cell;

    const RADIUS_M: f64 = 0.22;
    const STEP_S: f64 = 0.1;

    /// Robots in a drawn world that drive as they are told, but not into each other.
    struct World {
        map: OccupancyMap,
        drivers: Vec<Driver>,
        orders: Vec<Option<Order>>,
    }

    impl World {
        /// Walls as letters, each half a metre wide; robots with their headings and goals.
        fn new(lines: &[&str], robots: &[([f64; 3], Option<[f64; 2]>)]) -> Self {
            const CELLS: usize = 5;
            let width = lines[0].len() * CELLS;
            let cell = |index: usize| {
                let (x, y) = (index % width / CELLS, index / width / CELLS);
                if lines[lines.len() - 1 - y].as_bytes()[x] == b'#' { Cell::Occupied } else { Cell::Free }
            };
            let cells = (0..width * lines.len() * CELLS).map(cell).collect();
            let map = OccupancyMap::new([0.0; 2], 0.1, width, cells).unwrap();
            let robot = |&([x, y, theta], _): &([f64; 3], _)| Driver::standing(Pose2::new(x, y, theta));
            let order = |(number, &(_, goal_m)): (usize, &(_, Option<[f64; 2]>))| {
                Some(Order { robot: number as u32, goal_m, path_m: Vec::new() })
            };
            let orders = robots.iter().enumerate().map(order).collect();
            Self { map, drivers: robots.iter().map(robot).collect(), orders }
        }

        fn has_arrived(&self, number: usize) -> bool {
            let goal_m = self.orders[number].as_ref().and_then(|order| order.goal_m);
            !self.drivers[number].alive
                || goal_m.is_none_or(|goal_m| apart_m(self.drivers[number].at_m(), goal_m) < 0.27)
        }

        /// The second at which every robot has arrived.
        fn arrive(&mut self, most_s: usize) -> Option<usize> {
            self.arrive_and(most_s, |_| ())
        }

        fn arrive_and(&mut self, most_s: usize, mut at_each_step: impl FnMut(&mut Self)) -> Option<usize> {
            let terrain = Terrain::new(&self.map, RADIUS_M);
            let mut traffic = Traffic::default();
            for second in 0..most_s {
                if (0..self.drivers.len()).all(|number| self.has_arrived(number)) {
                    return Some(second);
                }
                for (number, order) in self.orders.iter_mut().enumerate() {
                    let Some(Order { goal_m: Some(goal_m), path_m, .. }) = order else { continue };
                    let travel = Travel::from(&self.map, &terrain, self.drivers[number].at_m());
                    *path_m = travel.path_m(&self.map, &terrain, self.map.index_of(*goal_m).unwrap());
                }
                let ground = Ground { map: &self.map, terrain: &terrain, is_new: second % 3 == 0 };
                let grounds = vec![ground; self.drivers.len()];
                find_ways(&mut traffic, &grounds, &mut self.drivers, &self.orders, RADIUS_M);
                for _ in 0..10 {
                    at_each_step(self);
                    self.step();
                }
            }
            None
        }

        fn step(&mut self) {
            for number in 0..self.drivers.len() {
                let others = (0..self.drivers.len()).filter(|&other| other != number);
                let others_m: Vec<[f64; 2]> = others.map(|other| self.drivers[other].at_m()).collect();
                let driver = &mut self.drivers[number];
                let Twist { speed_m_per_s, turn_rate_rad_per_s } = twist(driver, &others_m, RADIUS_M, 0.5);
                let here = self.drivers[number].map_from_robot;
                let turn_rad = STEP_S * turn_rate_rad_per_s.clamp(-1.5, 1.5);
                let there = here * Pose2::new(STEP_S * speed_m_per_s, 0.0, turn_rad);
                let (from_m, to_m) = ([here.x, here.y], [there.x, there.y]);
                let others = self.drivers.iter().enumerate().filter(|&(other, _)| other != number);
                let meets = others.into_iter().any(|(_, other)| {
                    let away_m = apart_m(to_m, other.at_m());
                    away_m < 2.0 * RADIUS_M && away_m < apart_m(from_m, other.at_m())
                });
                let stays = Pose2::new(here.x, here.y, there.theta);
                self.drivers[number].map_from_robot = if meets { stays } else { there };
                assert!(self.map.at([there.x, there.y]) != Cell::Occupied, "robot {number} drives into a wall");
            }
        }
    }

    const CORRIDOR: [&str; 6] = [
        "############################",
        "#..........................#",
        "#..........................#",
        "#..........................#",
        "#..........................#",
        "############################",
    ];
    const ROOMS: [&str; 9] = [
        "#####################",
        "#.........#.........#",
        "#.........#.........#",
        "#.........#.........#",
        "#...................#",
        "#...................#",
        "#.........#.........#",
        "#.........#.........#",
        "#####################",
    ];

    #[test]
    fn two_robots_that_meet_in_a_corridor_pass_each_other() {
        for y_m in [1.05, 1.25, 1.45] {
            let robots = [([1.2, y_m, 0.0], Some([12.5, 1.25])), ([12.5, 1.25, 3.1], Some([1.2, 1.25]))];
            let mut world = World::new(&CORRIDOR, &robots);
            let arrived = world.arrive(60);
            assert!(arrived.is_some(), "{y_m}: {:?}", world.drivers.iter().map(Driver::at_m).collect::<Vec<_>>());
        }
    }

    #[test]
    fn robots_pass_a_doorway_from_both_sides() {
        let robots = [
            ([2.0, 2.0, 0.0], Some([8.0, 2.5])),
            ([1.2, 1.2, 0.0], Some([9.0, 1.0])),
            ([8.0, 2.0, 3.1], Some([2.0, 2.5])),
            ([9.0, 3.0, 3.1], Some([1.2, 3.2])),
        ];
        let mut world = World::new(&ROOMS, &robots);
        let arrived = world.arrive(120);
        assert!(arrived.is_some(), "{:?}", world.drivers.iter().map(Driver::at_m).collect::<Vec<_>>());
    }

    #[test]
    fn a_robot_drives_around_what_its_way_leads_too_near_to() {
        for beside_m in [0.0, 0.05, -0.1, 0.2] {
            let mut world = World::new(&CORRIDOR, &[([1.2, 1.25, 0.0], Some([8.0, 1.25]))]);
            let leg_m = [4.0, 1.25 + beside_m];
            let mut nearest_m = f64::INFINITY;
            world.drivers[0].odom_from_near = vec![leg_m];
            let arrived = world.arrive_and(40, |world| {
                let here = world.drivers[0].map_from_robot;
                world.drivers[0].move_to(here, here);
                nearest_m = nearest_m.min(apart_m(world.drivers[0].at_m(), leg_m));
            });
            assert!(arrived.is_some() && nearest_m > RADIUS_M, "{beside_m}: {nearest_m}");
        }
    }

    #[test]
    fn a_robot_with_nothing_to_do_leaves_the_doorway_to_others() {
        let mut world = World::new(&ROOMS, &[([5.2, 2.0, 1.0], None), ([2.0, 2.0, 0.0], Some([8.0, 2.0]))]);
        assert!(world.arrive(60).is_some());
    }

    #[test]
    fn a_robot_that_died_in_a_doorway_holds_nobody_up_who_need_not_pass_it() {
        let robots =
            [([5.2, 2.0, 0.0], None), ([4.4, 2.0, 0.0], Some([1.2, 3.0])), ([3.5, 2.0, 0.0], Some([1.2, 1.0]))];
        let mut world = World::new(&ROOMS, &robots);
        world.drivers[0].switch_off();
        assert!(world.arrive(40).is_some());
        // Who is to pass it waits before it and does not push.
        world.orders[1].as_mut().unwrap().goal_m = Some([8.0, 2.0]);
        assert!(world.arrive(40).is_none());
        assert!(apart_m(world.drivers[1].at_m(), world.drivers[0].at_m()) >= 2.0 * RADIUS_M);
        // It goes on with something else.
        world.orders[1].as_mut().unwrap().goal_m = Some([1.2, 3.0]);
        assert!(world.arrive(40).is_some());
    }
}
