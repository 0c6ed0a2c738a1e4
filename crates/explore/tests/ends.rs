//! Exploration ends, whatever robots and maps do, and says why what is left is left.
#![allow(clippy::unwrap_used, clippy::panic, reason = "tests may")]

use mapwright_explore::{
    Cell, Decides, Decision, Exploration, ExploreSettings, Explorer, OccupancyMap, Strategy, WhyLeft,
};
use mapwright_geom::Pose2;
use mapwright_sim::Rng;

const SIDE: usize = 120;
const CELL_M: f64 = 0.1;

/// Rooms of random widths with doors, some of them too narrow; robots see so far as walls let them.
struct World {
    walls: Vec<bool>,
    seen: Vec<bool>,
    robots: Vec<Explorer>,
}

impl World {
    fn new(seed: u64, robots: usize) -> Self {
        let mut rng = Rng::keyed(seed, 1);
        let mut walls = vec![false; SIDE * SIDE];
        for at in (0..SIDE).step_by(30).chain([SIDE - 3]) {
            for along in 0..SIDE {
                (0..2).for_each(|k| {
                    walls[(at + k) * SIDE + along] = true;
                    walls[along * SIDE + at + k] = true;
                });
            }
        }
        for (column, row) in (0..4).flat_map(|column| (0..4).map(move |row| (column, row))) {
            let door = 4 + rng.below(8);
            let from = 8 + rng.below(8);
            for k in from..from + door {
                if column < 3 && rng.chance(0.97) {
                    (0..2).for_each(|w| walls[(row * 30 + k) * SIDE + column * 30 + 30 + w] = false);
                }
                if row < 3 {
                    (0..2).for_each(|w| walls[(row * 30 + 30 + w) * SIDE + column * 30 + k] = false);
                }
            }
        }
        let robot = |id: usize| Explorer {
            id: id as u32,
            map_from_robot: Pose2::new(1.0 + 0.6 * (id % 3) as f64, 1.0 + 0.6 * (id / 3) as f64, 0.0),
            heard_s: 0.0,
            radius_m: 0.2,
            speed_m_per_s: 0.5,
            reach_m: 5.0,
            decides: Decides::Here,
        };
        Self { walls, seen: vec![false; SIDE * SIDE], robots: (0..robots).map(robot).collect() }
    }

    fn look(&mut self) {
        for robot in &self.robots {
            for ray in 0..180 {
                let (sin, cos) = (f64::from(ray) * std::f64::consts::TAU / 180.0).sin_cos();
                for step in 0..100 {
                    let along_m = 0.05 * f64::from(step);
                    let (x, y) = (robot.map_from_robot.x + along_m * cos, robot.map_from_robot.y + along_m * sin);
                    let at = (y / CELL_M) as usize * SIDE + (x / CELL_M) as usize;
                    self.seen[at] = true;
                    if self.walls[at] {
                        break;
                    }
                }
            }
        }
    }

    fn map(&self) -> OccupancyMap {
        let cell = |(&wall, &seen): (&bool, &bool)| match (seen, wall) {
            (false, _) => Cell::Unknown,
            (true, true) => Cell::Occupied,
            (true, false) => Cell::Free,
        };
        OccupancyMap::new([0.0; 2], CELL_M, SIDE, self.walls.iter().zip(&self.seen).map(cell).collect()).unwrap()
    }

    /// Drives a second along the ways; some robots do not.
    fn drive(&mut self, decision: &Decision, now_s: f64, stands: impl Fn(u32) -> bool) {
        for order in &decision.orders {
            let robot = self.robots.iter_mut().find(|robot| robot.id == order.robot).unwrap();
            let mut left_m = if stands(robot.id) { 0.0 } else { robot.speed_m_per_s };
            let away_m = |&[x, y]: &[f64; 2]| (x - robot.map_from_robot.x).hypot(y - robot.map_from_robot.y);
            let nearest =
                (0..order.path_m.len()).min_by(|&a, &b| away_m(&order.path_m[a]).total_cmp(&away_m(&order.path_m[b])));
            for &[x, y] in order.path_m.iter().skip(nearest.map_or(0, |nearest| nearest + 1)) {
                let here = robot.map_from_robot;
                let leg_m = (x - here.x).hypot(y - here.y);
                let share = (left_m / leg_m.max(1e-9)).min(1.0);
                robot.map_from_robot = Pose2::new(here.x + share * (x - here.x), here.y + share * (y - here.y), 0.0);
                left_m -= share * leg_m;
            }
        }
        self.robots.iter_mut().for_each(|robot| robot.heard_s = now_s + 1.0);
    }
}

/// The second at which it is done, and what was said then.
fn explore(
    world: &mut World,
    strategy: Strategy,
    seed: u64,
    stands: impl Fn(u32) -> bool,
    flips: bool,
) -> (u32, Decision) {
    let settings = ExploreSettings { strategy, renew_after_s: 2.0, visits: 5, ..ExploreSettings::default() };
    let mut exploration = Exploration::new(settings);
    let mut rng = Rng::keyed(seed, 2);
    for second in 0..20_000 {
        world.look();
        if flips {
            // A map that bends forgets what it has shown.
            (0..20).for_each(|_| world.seen[rng.below(SIDE * SIDE)] = false);
        }
        let decision = exploration.decide(&world.map(), &world.robots, f64::from(second));
        if decision.done {
            return (second, decision);
        }
        world.drive(&decision, f64::from(second), &stands);
    }
    panic!("seed {seed}: never ends");
}

#[test]
fn every_building_is_explored_to_its_end() {
    for seed in 0..6 {
        for (strategy, robots) in
            [(Strategy::Greedy, 1), (Strategy::Greedy, 4), (Strategy::Hungarian, 3), (Strategy::Nearest, 2)]
        {
            let mut world = World::new(seed, robots);
            let (_, decision) = explore(&mut world, strategy, seed, |_| false, false);
            for left in &decision.left {
                let may_be_tried = matches!(left.why, WhyLeft::Waiting | WhyLeft::Blacklisted { .. });
                assert!(!may_be_tried, "seed {seed}: {left:?}");
            }
            // The room that the robots start in, at least.
            assert!(world.seen[15 * SIDE + 15]);
        }
    }
}

#[test]
fn it_ends_with_robots_that_do_not_move_and_maps_that_do() {
    for seed in 0..2 {
        let (_, decision) = explore(&mut World::new(seed, 3), Strategy::Greedy, seed, |_| true, false);
        assert!(decision.left.iter().any(|left| matches!(left.why, WhyLeft::GivenUp { times: 3.. })));
    }
    explore(&mut World::new(0, 2), Strategy::Greedy, 0, |id| id == 0, true);
}

#[test]
fn what_the_nearest_robot_cannot_get_to_is_left_to_another() {
    // A room of 2 by 2 m with an open door, behind which all is unknown; neither robot ever moves.
    let cells = (0..44 * 24).map(|cell| match (cell % 44, cell / 44) {
        (3..=20, 3..=20) | (21, 8..=15) => Cell::Free,
        (2..=21, 2..=21) => Cell::Occupied,
        _ => Cell::Unknown,
    });
    let map = OccupancyMap::new([0.0; 2], CELL_M, 44, cells.collect()).unwrap();
    let mut robots = World::new(0, 2).robots;
    robots[0].map_from_robot = Pose2::new(1.4, 1.2, 0.0);
    robots[1].map_from_robot = Pose2::new(0.8, 1.2, 0.0);
    let mut exploration = Exploration::new(ExploreSettings::default());
    let mut sent = [0; 2];
    for second in 0..20_000 {
        robots.iter_mut().for_each(|robot| robot.heard_s = f64::from(second));
        let decision = exploration.decide(&map, &robots, f64::from(second));
        if decision.done {
            let given_up = |why: WhyLeft| why == WhyLeft::GivenUp { times: 3 };
            assert!(decision.left.iter().any(|left| given_up(left.why)), "{decision:?}");
            break;
        }
        decision.orders.iter().for_each(|order| sent[order.robot as usize] += u32::from(order.goal_m.is_some()));
    }
    assert!(sent[0] > 0 && sent[1] > 0, "{sent:?}");
}

#[test]
fn a_place_behind_a_wall_does_not_hide_one_that_can_be_reached() {
    // A frontier beyond a door, and, behind the same wall and nearer to the frontier's middle, free cells that nobody can get to.
    let cells = (0..60 * 50).map(|cell| match (cell % 60, cell / 60) {
        (3..=56, 3..=40) | (5..=12, 41..=43) | (16..=24, 42..=43) | (5..=24, 44) => Cell::Free,
        (2..=57, 2 | 41) | (2 | 57, 3..=40) | (4 | 13..=15, 42..=43) => Cell::Occupied,
        _ => Cell::Unknown,
    });
    let map = OccupancyMap::new([0.0; 2], CELL_M, 60, cells.collect()).unwrap();
    let mut robot = World::new(0, 1).robots[0];
    robot.map_from_robot = Pose2::new(4.0, 1.2, 0.0);
    let decision = Exploration::new(ExploreSettings::default()).decide(&map, &[robot], 0.0);
    assert!(decision.orders[0].goal_m.is_some_and(|[x, _]| x < 1.5), "{decision:?}");
}

#[test]
fn many_are_faster_than_one() {
    let seconds = |robots: usize| -> u32 {
        (0..4).map(|seed| explore(&mut World::new(seed, robots), Strategy::Greedy, seed, |_| false, false).0).sum()
    };
    let (one, four) = (seconds(1), seconds(4));
    assert!(f64::from(one) > 1.5 * f64::from(four), "{one} s, {four} s");
}

#[test]
fn a_silent_robots_work_is_given_away_within_five_seconds() {
    let mut world = World::new(3, 2);
    let mut exploration = Exploration::new(ExploreSettings::default());
    world.look();
    let map = world.map();
    let goals =
        |decision: &Decision| decision.orders.iter().map(|order| (order.robot, order.goal_m)).collect::<Vec<_>>();
    let before = goals(&exploration.decide(&map, &world.robots, 0.0));
    assert_eq!(before.len(), 2);
    let lost = before[0].1.unwrap();
    let mut taken = false;
    for second in 1..=5 {
        world.robots[1].heard_s = f64::from(second);
        let decision = exploration.decide(&map, &world.robots, f64::from(second));
        let after = goals(&decision);
        let waits = decision.left.iter().any(|left| left.why == WhyLeft::Waiting);
        taken |= after.len() == 1 && after[0].0 == 1 && (after[0].1 == Some(lost) || waits);
    }
    assert!(taken, "{before:?}");
}

/// The second at which every robot that decides for itself says that it is done. What robots choose the others hear a second later; what
/// robots say that `lies` gives a goal for is not what they do.
fn explore_each(world: &mut World, seed: u64, lies: impl Fn(u32, u32) -> Option<[f64; 2]>) -> u32 {
    let settings = ExploreSettings { renew_after_s: 2.0, visits: 5, ..ExploreSettings::default() };
    let mut explorations = vec![Exploration::new(settings); world.robots.len()];
    let mut goals_m = vec![None; world.robots.len()];
    for second in 0..20_000 {
        world.look();
        let map = world.map();
        let mut said = Decision::default();
        let mut done = true;
        for (number, exploration) in explorations.iter_mut().enumerate() {
            let known = |other: &Explorer| Explorer {
                decides: match other.id as usize {
                    id if id == number => Decides::Here,
                    id => Decides::Itself { goal_m: goals_m[id] },
                },
                ..*other
            };
            let robots: Vec<Explorer> = world.robots.iter().map(known).collect();
            let decision = exploration.decide(&map, &robots, f64::from(second));
            assert!(decision.orders.iter().all(|order| order.robot as usize == number));
            done &= decision.done || lies(number as u32, second).is_some();
            said.orders.extend(decision.orders);
        }
        if done {
            return second;
        }
        for order in &said.orders {
            goals_m[order.robot as usize] = lies(order.robot, second).or(order.goal_m);
        }
        world.drive(&said, f64::from(second), |id| lies(id, second).is_some());
    }
    panic!("seed {seed}: never ends");
}

#[test]
fn robots_that_decide_for_themselves_share_the_work() {
    let (mut shared, mut each, mut alone) = (0, 0, 0);
    for seed in 0..6 {
        let time = |robots: usize| explore(&mut World::new(seed, robots), Strategy::Greedy, seed, |_| false, false).0;
        (shared, alone) = (shared + time(4), alone + time(1));
        each += explore_each(&mut World::new(seed, 4), seed, |_, _| None);
    }
    println!("one decision for four robots {shared} s, each its own {each} s; one robot {alone} s");
    assert!(f64::from(each) < 1.3 * f64::from(shared), "{each} and {shared} s");
}

#[test]
fn a_robot_that_claims_everything_for_ever_holds_nobody_up() {
    for seed in 0..3 {
        let mut rng = Rng::keyed(seed, 3);
        let goals_m: Vec<[f64; 2]> = (0..20_000).map(|_| [rng.uniform(0.5, 11.5), rng.uniform(0.5, 11.5)]).collect();
        let mut world = World::new(seed, 3);
        let ended = explore_each(&mut world, seed, |id, second| (id == 0).then(|| goals_m[second as usize / 7]));
        let mut honest = World::new(seed, 2);
        let two = explore_each(&mut honest, seed, |_, _| None);
        println!("seed {seed}: with a liar {ended} s, without {two} s");
        let seen = |world: &World| world.seen.iter().filter(|seen| **seen).count() as f64;
        assert!(seen(&world) > 0.98 * seen(&honest));
    }
}
