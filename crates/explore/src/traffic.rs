//! Ways of several robots that do not meet: each robot's way in space and time around those of the robots before it (Silver 2005,
//! "Cooperative pathfinding", windowed).

use crate::map::OccupancyMap;
use crate::travel::{CLEAR_STEP, NOWHERE, Terrain, Travel};
use std::cmp::Reverse;
use std::collections::BinaryHeap;

/// Steps that are planned ahead, each from a block to a neighbour or none: the time for a robot to get out of a doorway and a body's
/// length aside, and for the other to pass.
const WINDOW: usize = 24;
const SIDE: usize = 2 * WINDOW + 1;
/// For so many steps, times the robots near that come later in the order, these count where they stand: they must have seen the way before
/// they can clear it, and may have to wait for each other.
const NOTICE_STEPS: usize = 2;
/// Robots that may have to wait for each other, metres.
const NEAR_M: f64 = 3.0;
/// What a step costs that is waited through: less than one that leads nowhere. A step that makes a robot that comes later leave its place
/// costs as much more.
const WAIT: u32 = CLEAR_STEP / 2;
/// Of two ways that cost the same, that which waits later is taken: who puts off making way would put it off each time. So many parts
/// make a unit of cost, so that all of a window's waits together are less than a step.
const PARTS: u32 = 32;

/// A robot among others.
#[derive(Debug, Clone, Copy)]
pub struct Traveller<'a> {
    /// Where it is, metres in the map.
    pub at_m: [f64; 2],
    /// Its map, and where it can stand in it.
    pub map: &'a OccupancyMap,
    /// Where it can stand.
    pub terrain: &'a Terrain,
    /// What it takes to get anywhere from its goal; none where it has no goal and only makes way.
    pub from_goal: Option<&'a Travel>,
    /// Whether it can drive; what cannot is in the way of the others for good.
    pub drives: bool,
}

impl Traveller<'_> {
    /// Whether it has nowhere to go any more.
    fn is_there(&self) -> bool {
        if !self.drives {
            return true;
        }
        let start = self.terrain.start(self.map, self.at_m);
        self.from_goal.zip(start).is_none_or(|(from_goal, start)| from_goal.cost(start) == 0)
    }
}

/// Plans the ways of robots that drive near each other.
///
/// Robots plan one after the other, those that have a way to go first. Each finds the cheapest way of the next steps that stays clear of the ways of
/// those before it, of which waiting and making way are a part. One that finds none, for another's way leads over its place and it cannot
/// leave, comes first from then on: the others find a way around it, or make way for it. The first in the order waits for nobody, so that
/// somebody always moves.
#[derive(Debug, Clone, Default)]
pub struct Traffic {
    order: Vec<usize>,
    search: Search,
}

impl Traffic {
    /// Each robot's way until it must wait, as points from where it is on. Robots keep so far from each other, middle to middle.
    pub fn ways(&mut self, robots: &[Traveller<'_>], keep_m: f64) -> Vec<Vec<[f64; 2]>> {
        if self.order.len() != robots.len() {
            self.order = (0..robots.len()).collect();
        }
        self.order.sort_by_key(|&k| (robots[k].drives, robots[k].is_there()));
        let mut plans: Vec<Option<Vec<[f64; 2]>>> = Vec::new();
        for attempt in 0..=robots.len() {
            plans = vec![None; robots.len()];
            let mut failed = None;
            for place in 0..self.order.len() {
                let k = self.order[place];
                let plan = if robots[k].drives { self.search.plan(robots, k, &plans, keep_m) } else { None };
                if plan.is_none() && robots[k].drives {
                    failed = failed.or(Some(place));
                    if attempt < robots.len() {
                        break;
                    }
                }
                plans[k] = Some(plan.unwrap_or_else(|| vec![robots[k].at_m]));
            }
            let Some(place) = failed else { break };
            let first = self.order.iter().take_while(|&&k| !robots[k].drives).count();
            self.order[first..=place].rotate_right(1);
        }
        plans.into_iter().map(|plan| until_it_waits(plan.unwrap_or_default())).collect()
    }
}

/// The steps up to the first wait.
fn until_it_waits(mut plan: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    let moves = plan.windows(2).take_while(|pair| pair[0] != pair[1]).count();
    plan.truncate(moves + 1);
    plan
}

/// A place after so many steps, on a square of blocks around the robot.
#[derive(Debug, Clone, Default)]
struct Search {
    cost: Vec<u32>,
    before: Vec<u32>,
    open: BinaryHeap<Reverse<(u32, Reverse<usize>, u32)>>,
    /// The block of each place of the square, where it was met.
    blocks: Vec<usize>,
}

impl Search {
    /// The cheapest way of the next steps: the robot's place now, and that after each step. None where every way meets another robot's.
    fn plan(
        &mut self,
        robots: &[Traveller<'_>],
        number: usize,
        plans: &[Option<Vec<[f64; 2]>>],
        keep_m: f64,
    ) -> Option<Vec<[f64; 2]>> {
        let Traveller { at_m, map, terrain, from_goal, .. } = robots[number];
        let start = terrain.start(map, at_m)?;
        let near_m = 2.0 * WINDOW as f64 * 1.5 * Terrain::block_m(map) + keep_m;
        let away_m = |other: usize| apart_m(robots[other].at_m, at_m);
        let later = (0..robots.len()).filter(|&other| other != number && plans[other].is_none());
        let later = later.filter(|&other| away_m(other) < NEAR_M).count();
        let notice_steps = (NOTICE_STEPS * later).min(WINDOW / 2);
        let others: Vec<Other<'_>> = (0..robots.len())
            .filter(|&other| other != number && away_m(other) < near_m)
            .map(|other| match &plans[other] {
                Some(plan) => Other { places_m: plan, steps: usize::MAX },
                None => Other { places_m: std::slice::from_ref(&robots[other].at_m), steps: notice_steps },
            })
            .collect();
        let from_goal = from_goal.filter(|from_goal| from_goal.cost(start) != NOWHERE);
        let to_go = |block: usize| from_goal.map_or(0, |from_goal| from_goal.cost(block).saturating_mul(PARTS));
        let area = SIDE * SIDE;
        self.cost.clear();
        self.cost.resize(area * (WINDOW + 1), NOWHERE);
        self.before.resize(area * (WINDOW + 1), 0);
        self.blocks.resize(area, 0);
        self.open.clear();
        let first = WINDOW * SIDE + WINDOW;
        (self.cost[first], self.blocks[first]) = (0, start);
        // In the block that it is in it stands where it is.
        let stand_m = |place: usize, block: usize| if place == first { at_m } else { terrain.middle_m(map, block) };
        self.open.push(Reverse((to_go(start), Reverse(0), first as u32)));
        while let Some(Reverse((_, Reverse(step), state))) = self.open.pop() {
            let (state, place) = (state as usize, state as usize % area);
            if step == WINDOW {
                return Some(self.way(map, terrain, at_m, state));
            }
            let (block, cost) = (self.blocks[place], self.cost[state]);
            let here_m = stand_m(place, block);
            let wait_cost = (WINDOW - step) as u32 + if to_go(block) == 0 { 0 } else { WAIT * PARTS };
            let waits = (place, block, wait_cost);
            let moves = terrain.leads(block).map(|(way, near, cost)| {
                let [x, y] = Terrain::STEPS[way];
                (place.wrapping_add_signed((y * SIDE as i32 + x) as isize), near, cost * PARTS)
            });
            for (place, block, step_cost) in moves.chain([waits]) {
                let (there, to_go) = ((step + 1) * area + place, to_go(block));
                let there_m = stand_m(place, block);
                let met = others.iter().map(|other| other.met(step + 1, here_m, there_m, keep_m)).max();
                let cost = cost.saturating_add(step_cost).saturating_add(met.unwrap_or(0));
                if to_go == NOWHERE || cost == NOWHERE || cost >= self.cost[there] {
                    continue;
                }
                self.blocks[place] = block;
                (self.cost[there], self.before[there]) = (cost, state as u32);
                self.open.push(Reverse((cost + to_go, Reverse(step + 1), there as u32)));
            }
        }
        None
    }

    fn way(&self, map: &OccupancyMap, terrain: &Terrain, at_m: [f64; 2], mut state: usize) -> Vec<[f64; 2]> {
        let area = SIDE * SIDE;
        let mut places = Vec::with_capacity(WINDOW + 1);
        while state >= area {
            places.push(state % area);
            state = self.before[state] as usize;
        }
        places.reverse();
        let first = WINDOW * SIDE + WINDOW;
        let stand_m = |&place: &usize| {
            if place == first { at_m } else { terrain.middle_m(map, self.blocks[place]) }
        };
        std::iter::once(at_m).chain(places.iter().map(stand_m)).collect()
    }
}

/// Another robot's places step by step, the last of them for good.
struct Other<'a> {
    places_m: &'a [[f64; 2]],
    /// How long it is there for sure: always, or, where it comes later in the order, until it has made way.
    steps: usize,
}

impl Other<'_> {
    /// What a step costs that leads nearer to it than robots keep from each other. The other may be a step late.
    fn met(&self, step: usize, from_m: [f64; 2], to_m: [f64; 2], keep_m: f64) -> u32 {
        let last = self.places_m.len() - 1;
        let [before_m, now_m] = [step - 1, step].map(|step| self.places_m[step.min(last)]);
        let nearest_m = apart_m(to_m, before_m).min(apart_m(to_m, now_m));
        let is_near = nearest_m < keep_m;
        let is_nearer = nearest_m < apart_m(from_m, before_m) - 1e-6;
        match (step <= self.steps, is_near, is_nearer) {
            (_, false, _) | (true, true, false) => 0,
            (true, true, true) => NOWHERE,
            (false, true, _) => WAIT * PARTS,
        }
    }
}

fn apart_m(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::map::Cell;
    use crate::travel::tests::rooms;

    const KEEP_M: f64 = 0.54;

    /// Robots that drive 0.4 m a second along their ways, with goals or none.
    struct Robots {
        map: OccupancyMap,
        at_m: Vec<[f64; 2]>,
        goals_m: Vec<Option<[f64; 2]>>,
        dead: Option<usize>,
    }

    impl Robots {
        /// The second at which all have arrived.
        fn arrive(&mut self, most_s: usize) -> Option<usize> {
            let terrain = Terrain::new(&self.map, 0.22);
            let fields: Vec<Option<Travel>> =
                self.goals_m.iter().map(|goal_m| Some(Travel::from(&self.map, &terrain, (*goal_m)?))).collect();
            let mut traffic = Traffic::default();
            for second in 0..most_s {
                let arrived = |(at_m, goal_m): (&[f64; 2], &Option<[f64; 2]>)| {
                    goal_m.is_none_or(|goal_m| apart_m(*at_m, goal_m) < 0.3)
                };
                if self.at_m.iter().zip(&self.goals_m).all(arrived) {
                    return Some(second);
                }
                let robots: Vec<Traveller<'_>> = (0..self.at_m.len())
                    .map(|k| Traveller {
                        at_m: self.at_m[k],
                        map: &self.map,
                        terrain: &terrain,
                        from_goal: fields[k].as_ref(),
                        drives: self.dead != Some(k),
                    })
                    .collect();
                let ways = traffic.ways(&robots, KEEP_M);
                for step in 1..=2 {
                    let next: Vec<[f64; 2]> = ways.iter().map(|way| way[step.min(way.len() - 1)]).collect();
                    for (k, &to_m) in next.iter().enumerate() {
                        // As a body would: no step into another.
                        let free = (0..next.len()).filter(|&other| other != k).all(|other| {
                            let away_m = apart_m(to_m, self.at_m[other]);
                            away_m >= 0.44 || away_m >= apart_m(self.at_m[k], self.at_m[other])
                        });
                        if free && self.dead != Some(k) {
                            self.at_m[k] = to_m;
                        }
                    }
                }
            }
            None
        }
    }

    /// A corridor of 12 m, so many cells wide, with a bay for one robot at its middle, or none.
    fn corridor(wide: usize, bay: bool) -> OccupancyMap {
        let (width, height) = (124, 30);
        let cell = |index: usize| {
            let (x, y) = (index % width, index / width);
            let inside = (2..width - 2).contains(&x) && (4..4 + wide).contains(&y);
            let bay = bay && (56..66).contains(&x) && (4 + wide..14 + wide).contains(&y);
            if inside || bay { Cell::Free } else { Cell::Occupied }
        };
        OccupancyMap::new([0.0; 2], 0.1, width, (0..width * height).map(cell).collect()).unwrap()
    }

    #[test]
    fn two_that_meet_head_on_pass_each_other() {
        for (wide, bay, most_s) in [(18, false, 45), (9, true, 120)] {
            for shift_m in [0.0, 0.1, 1.3, -2.0] {
                let y_m = 0.4 + 0.05 * wide as f64;
                let (left, right) = ([1.0 + f64::max(shift_m, 0.0), y_m], [11.0 + f64::min(shift_m, 0.0), y_m]);
                let goals_m = vec![Some([11.4, y_m]), Some([0.7, y_m])];
                let mut robots = Robots { map: corridor(wide, bay), at_m: vec![left, right], goals_m, dead: None };
                let arrived = robots.arrive(most_s);
                assert!(arrived.is_some(), "{wide} cells wide, {shift_m}: {:?}", robots.at_m);
            }
        }
    }

    #[test]
    fn robots_change_rooms_through_one_door() {
        let at_m = vec![[1.0, 1.0], [1.5, 2.0], [5.0, 1.0], [4.5, 2.2]];
        let goals_m = vec![Some([5.0, 2.4]), Some([5.6, 0.7]), Some([0.8, 2.4]), Some([1.8, 0.7])];
        let mut robots = Robots { map: rooms(9), at_m, goals_m, dead: None };
        assert!(robots.arrive(90).is_some(), "{:?}", robots.at_m);
    }

    #[test]
    fn a_robot_without_a_goal_makes_way_in_a_door() {
        let (at_m, goals_m) = (vec![[3.2, 1.45], [1.0, 1.45]], vec![None, Some([5.0, 1.45])]);
        let mut robots = Robots { map: rooms(9), at_m, goals_m, dead: None };
        assert!(robots.arrive(40).is_some(), "{:?}", robots.at_m);
    }

    #[test]
    fn a_robot_that_died_in_a_door_is_waited_for_by_nobody_else() {
        let at_m = vec![[3.2, 1.45], [1.0, 1.45], [2.4, 1.45]];
        let goals_m = vec![None, Some([2.2, 2.5]), Some([0.8, 0.8])];
        let mut robots = Robots { map: rooms(9), at_m, goals_m, dead: Some(0) };
        assert!(robots.arrive(40).is_some(), "{:?}", robots.at_m);
        // Behind it nothing can be reached, and nobody runs into it.
        robots.goals_m[1] = Some([5.0, 1.45]);
        assert!(robots.arrive(40).is_none());
        assert!(apart_m(robots.at_m[1], robots.at_m[0]) >= 0.44);
        // Where there is room it is driven around.
        let (at_m, goals_m) = (vec![[6.0, 1.3], [1.0, 1.3]], vec![None, Some([11.0, 1.3])]);
        let mut robots = Robots { map: corridor(18, false), at_m, goals_m, dead: Some(0) };
        assert!(robots.arrive(40).is_some(), "{:?}", robots.at_m);
    }
}
