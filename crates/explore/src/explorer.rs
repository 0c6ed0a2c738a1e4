//! Robots share the exploration of what their common map does not show yet.

use crate::assign::{Candidate, Shown, Strategy, Weights, assign};
use crate::claims::{Claimed, Claims};
use crate::frontier::{Frontier, Views, frontiers, has_frontier};
use crate::map::OccupancyMap;
use crate::places::{Ending, Limits, Places, WhyLeft};
use crate::robot::Explorer;
use crate::travel::{Terrain, Travel};
use std::collections::BTreeMap;

/// How robots explore.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExploreSettings {
    /// Who goes where.
    pub strategy: Strategy,
    /// A robot that was not heard for so long has no part in it any more, seconds; what it was to do is given to others.
    pub silent_after_s: f64,
    /// With nothing to change, plans are made anew after so long, seconds.
    pub renew_after_s: f64,
    /// A robot that has arrived waits so long for the map to show what it sees, seconds.
    pub look_s: f64,
    /// How often robots try to get to a place that they made no progress towards.
    pub tries: u32,
    /// How often robots look from a place without seeing anything new.
    pub looks: u32,
    /// How often something new may be seen at one place: a map that bends shows old things anew.
    pub visits: u32,
    /// A second of way costs as much as so many square metres of new area.
    pub m2_per_s: f64,
}

impl Default for ExploreSettings {
    fn default() -> Self {
        Self {
            strategy: Strategy::Greedy,
            silent_after_s: 3.0,
            renew_after_s: 3.0,
            look_s: 2.0,
            tries: 3,
            looks: 2,
            visits: 20,
            m2_per_s: 1.0,
        }
    }
}

/// What a robot is to do.
#[derive(Debug, Clone, PartialEq)]
pub struct Order {
    /// Which robot.
    pub robot: u32,
    /// Where it is to go, metres in the map; none where nothing is left for it.
    pub goal_m: Option<[f64; 2]>,
    /// The way there.
    pub path_m: Vec<[f64; 2]>,
}

/// A frontier to which no robot is sent.
#[derive(Debug, Clone, PartialEq)]
pub struct Left {
    /// Its middle, metres in the map.
    pub at_m: [f64; 2],
    /// Its length, metres.
    pub length_m: f64,
    /// Why.
    pub why: WhyLeft,
}

/// Who goes where, and what is left.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Decision {
    /// One for each robot that was heard, in the order of the robots.
    pub orders: Vec<Order>,
    /// Every frontier to which no robot is sent.
    pub left: Vec<Left>,
    /// Nothing is left that any robot could do.
    pub done: bool,
}

/// A robot on its way.
#[derive(Debug, Clone)]
struct Errand {
    robot: u32,
    /// Middle of the frontier, and where to look at it from.
    frontier_m: [f64; 2],
    goal_m: [f64; 2],
    /// It fails then.
    deadline_s: f64,
    /// So near it has come, in metres of way, and when; further than that is no progress.
    nearest_m: f64,
    nearer_s: f64,
    arrived_s: Option<f64>,
    path_m: Vec<[f64; 2]>,
}

/// A robot may change its mind so often before an errand of its is ended.
const MOST_CHANGES: u32 = 3;
/// A robot fails that takes so many times as long as the way takes at its speed, on top of what it takes to notice that it is stuck.
const SLOW_TIMES: f64 = 3.0;

/// Sends robots to the frontiers of a map until there are none left.
///
/// **It ends.** Each robot has at most one errand, and each errand has a deadline. A robot changes its mind (exchanges an errand for a better
/// one, or drops it) three times at most; then it is bound, and its errand can only end. An errand that ends is booked at its frontier's
/// place: *seen* (the frontier is gone), *nothing new* (it was looked at and is still there) or *stuck* (no progress until the deadline,
/// or no way any more), which bars it for that robot only. Each place is booked at most `visits + looks` times and `tries` times for each
/// robot, plus once for each robot that was on its way there, for then it is barred; places lie three robot radii apart, so a map of bounded extent has boundedly many. Hence the number of errands
/// still to come falls with each that ends, whatever robots, map and frontiers do; and where no errand is under way, either one is given
/// or [`Decision::done`] is said: what is barred for a time only is let out when nothing else is left.
///
/// Robots that decide for themselves ([`Itself`](crate::Decides::Itself)) are left what they say they go to: each such claim has a deadline too, and only
/// so many are heeded at one place, so that nobody waits for ever for others, broken or lying. Of two that go to the same the one with the
/// lower number does; until one that has no goal has said what it chooses, it is taken to choose as it would be sent from here.
#[derive(Debug, Clone, Default)]
pub struct Exploration {
    settings: ExploreSettings,
    places: Places,
    errands: Vec<Errand>,
    /// How often robots have changed their minds since an errand of theirs was booked.
    changes: BTreeMap<u32, u32>,
    left: Vec<Left>,
    /// How far robots see in the middle: a running value.
    sight_m: Option<f64>,
    planned_s: Option<f64>,
    plans: u32,
    /// Origin and size of the map of the last plan.
    layout: Option<([f64; 2], [usize; 2])>,
    /// Whether something was taken to be there for a while only.
    had_passing: bool,
    reach: Reach,
    claims: Claims,
}

/// What a plan is made of.
struct Ground<'a> {
    map: &'a OccupancyMap,
    /// Those that are given orders, and those whose choice is to be foreseen.
    robots: &'a [Explorer],
    /// Where others go.
    claimed: &'a [Claimed],
    now_s: f64,
}

/// Where the robots can drive, by the last plan.
#[derive(Debug, Clone, Default)]
struct Reach {
    /// One for each radius, that of the narrowest robot first.
    terrains: Vec<Terrain>,
    /// Of each robot: which terrain is its, and what it takes to get anywhere.
    travel: Vec<(usize, Travel)>,
}

/// Where to look at a frontier from, and how long a robot takes to get there.
#[derive(Clone, Copy)]
struct Chosen<'a> {
    frontier: &'a Frontier,
    stand: usize,
    seconds: f64,
}

impl Exploration {
    /// Nothing explored yet.
    #[must_use]
    pub fn new(settings: ExploreSettings) -> Self {
        Self { settings, ..Self::default() }
    }

    /// Plans that were made, as opposed to decisions that left everything as it was.
    #[must_use]
    pub fn plans(&self) -> u32 {
        self.plans
    }

    /// Errands that have ended.
    #[must_use]
    pub fn errands_ended(&self) -> u32 {
        self.places.booked()
    }

    /// Where a robot of such a radius can stand, by the last plan.
    #[must_use]
    pub fn terrain(&self, radius_m: f64) -> Option<&Terrain> {
        self.reach.terrains.iter().find(|terrain| terrain.radius_m() == radius_m)
    }

    /// Who goes where now. To be called every second or so; plans anew only where something has happened.
    pub fn decide(&mut self, map: &OccupancyMap, robots: &[Explorer], now_s: f64) -> Decision {
        let heard = |robot: &&Explorer| {
            now_s - robot.heard_s < self.settings.silent_after_s && robot.map_from_robot.is_finite()
        };
        let mut robots: Vec<Explorer> = robots.iter().filter(heard).copied().collect();
        let before = self.errands.len();
        self.errands.retain(|errand| robots.iter().any(|robot| robot.id == errand.robot && robot.is_ordered()));
        let lost = before != self.errands.len();
        if !robots.iter().any(Explorer::is_ordered) {
            return Decision::default();
        }
        let same_m = same_m(map, &robots);
        let patience_s = |robot: &Explorer| Self::patience_s(self.sight_m.unwrap_or(robot.reach_m), robot);
        let (limits, heeded_s) = (self.settings.visits, self.settings.renew_after_s);
        let has_changed = self.claims.hear(&robots, now_s, same_m, patience_s);
        let claimed = self.claims.heeded(&robots, now_s, limits);
        robots.retain(|robot| robot.is_ordered() || self.claims.is_choosing(robot, now_s, heeded_s));
        let lost = lost || has_changed;
        let ground = Ground { map, robots: &robots, claimed: &claimed, now_s };
        let ended = self.end_errands(&ground);
        let is_old = self.planned_s.is_none_or(|planned_s| now_s - planned_s >= self.settings.renew_after_s);
        // What the last plan said of cells is of no use where a map that has grown numbers them otherwise.
        let is_laid_out = self.layout.is_some_and(|(origin_m, size)| map.is_laid_out_as(origin_m, size));
        // What has gone may have opened a way.
        let has_gone = self.had_passing && !map.has_passing();
        self.had_passing = map.has_passing();
        if lost || ended || is_old || has_gone || !is_laid_out {
            self.plan(&ground);
        }
        self.decision(map, &robots)
    }

    fn decision(&self, map: &OccupancyMap, robots: &[Explorer]) -> Decision {
        let order = |robot: &Explorer| {
            let errand = self.errands.iter().find(|errand| errand.robot == robot.id);
            let path_m = errand.map_or(Vec::new(), |errand| errand.path_m.clone());
            Order { robot: robot.id, goal_m: errand.map(|errand| errand.goal_m), path_m }
        };
        // What is barred by what may go away is not given up yet.
        let may_open = map.has_passing() && self.left.iter().any(|left| left.why == WhyLeft::Unreachable);
        let done = self.errands.is_empty() && !self.is_waiting() && !may_open;
        let ordered = robots.iter().filter(|robot| robot.is_ordered());
        Decision { orders: ordered.map(order).collect(), left: self.left.clone(), done }
    }

    fn same_m(ground: &Ground<'_>) -> f64 {
        same_m(ground.map, ground.robots)
    }

    /// How far robots see in the middle. The half-life is some ten plans.
    fn sight_m(&mut self, ground: &Ground<'_>, views: &Views<'_>) -> f64 {
        for robot in ground.robots.iter().filter(|robot| robot.is_ordered()) {
            let Some(cell) = ground.map.index_of(robot.at_m()) else { continue };
            let now_m = views.sight_m(cell, robot.reach_m);
            let before_m = self.sight_m.unwrap_or(now_m);
            self.sight_m = Some(before_m + 0.05 * (now_m - before_m));
        }
        self.sight_m.unwrap_or(0.0).max(10.0 * ground.map.resolution_m())
    }

    /// A robot that gets no nearer for so long is stuck, seconds: the time to drive as far as one sees and back.
    fn patience_s(sight_m: f64, robot: &Explorer) -> f64 {
        4.0 * sight_m / robot.speed_m_per_s.max(1e-3)
    }

    /// Books errands whose frontier is gone, or that have been looked at long enough. Whether there were any.
    fn end_errands(&mut self, ground: &Ground<'_>) -> bool {
        let same_m = Self::same_m(ground);
        let (look_s, now_s) = (self.settings.look_s, ground.now_s);
        let mut ended = Vec::new();
        for errand in &mut self.errands {
            let Some(robot) = ground.robots.iter().find(|robot| robot.id == errand.robot) else { continue };
            if !has_frontier(ground.map, errand.frontier_m, same_m) {
                ended.push((errand.clone(), Ending::Seen));
                continue;
            }
            let away_m = (robot.at_m()[0] - errand.goal_m[0]).hypot(robot.at_m()[1] - errand.goal_m[1]);
            if away_m <= robot.radius_m.max(2.0 * ground.map.resolution_m()) {
                let arrived_s = *errand.arrived_s.get_or_insert(now_s);
                if now_s - arrived_s >= look_s {
                    ended.push((errand.clone(), Ending::NothingNew));
                }
            }
        }
        for (errand, ending) in &ended {
            self.end(errand, *ending, same_m, now_s, 0.0);
        }
        !ended.is_empty()
    }

    fn end(&mut self, errand: &Errand, ending: Ending, same_m: f64, now_s: f64, age_s: f64) {
        self.places.book(errand.robot, errand.frontier_m, same_m, ending, now_s, age_s);
        self.errands.retain(|other| other.robot != errand.robot);
        self.changes.remove(&errand.robot);
    }

    fn is_bound(&self, robot: u32) -> bool {
        self.changes.get(&robot).is_some_and(|changes| *changes >= MOST_CHANGES)
    }

    /// Gives robots their errands.
    fn plan(&mut self, ground: &Ground<'_>) {
        (self.planned_s, self.plans) = (Some(ground.now_s), self.plans + 1);
        self.layout = Some((ground.map.origin_m(), ground.map.size()));
        let mut views = Views::new(ground.map);
        let sight_m = self.sight_m(ground, &views);
        let found = frontiers(ground.map, sight_m);
        let mut reach = std::mem::take(&mut self.reach);
        reach.fill(ground);
        self.end_stuck(ground, &reach, sight_m);
        self.give(ground, &found, &reach, &mut views, sight_m);
        // Who was bound to what it cannot reach any more is free now.
        for _ in ground.robots {
            if !self.errands.is_empty() || !self.is_waiting() || !ground.is_alone() {
                break;
            }
            self.give(ground, &found, &reach, &mut views, sight_m);
        }
        if self.errands.is_empty() && self.left.iter().any(|left| matches!(left.why, WhyLeft::Blacklisted { .. })) {
            self.places.let_out();
            self.give(ground, &found, &reach, &mut views, sight_m);
        }
        self.reach = reach;
    }

    fn is_waiting(&self) -> bool {
        self.left.iter().any(|left| left.why == WhyLeft::Waiting)
    }

    /// The watchdog: books errands without progress.
    fn end_stuck(&mut self, ground: &Ground<'_>, reach: &Reach, sight_m: f64) {
        let mut stuck = Vec::new();
        for errand in &mut self.errands {
            let Some(k) = ground.robots.iter().position(|robot| robot.id == errand.robot) else { continue };
            let robot = &ground.robots[k];
            let left_m = ground.map.index_of(errand.goal_m).and_then(|cell| reach.cost_m(ground, k, cell));
            if left_m.is_some_and(|left_m| left_m < errand.nearest_m - robot.radius_m) {
                (errand.nearest_m, errand.nearer_s) = (left_m.unwrap_or(0.0), ground.now_s);
            }
            let patience_s = Self::patience_s(sight_m, robot);
            if ground.now_s - errand.nearer_s > patience_s || ground.now_s > errand.deadline_s {
                stuck.push((errand.clone(), patience_s));
            }
        }
        for (errand, patience_s) in stuck {
            self.end(&errand, Ending::Stuck, Self::same_m(ground), ground.now_s, 2.0 * patience_s);
        }
    }

    fn give(&mut self, ground: &Ground<'_>, found: &[Frontier], reach: &Reach, views: &mut Views<'_>, sight_m: f64) {
        let weights = self.weights(ground, sight_m);
        let (candidates, looks) = self.candidates(ground, found, reach, views, sight_m);
        let first = ground.robots.iter().filter(|robot| robot.is_ordered()).map(|robot| robot.id).min().unwrap_or(0);
        let claims: Vec<_> =
            ground.claimed.iter().filter_map(|claim| claim.seen(ground.map, views, sight_m, first)).collect();
        let shown = Shown { blocks: views.blocks(), m2: |block| views.unknown_m2(block), claims: &claims };
        let goals = assign(self.settings.strategy, &candidates, ground.robots.len(), weights, &shown);
        for (k, goal) in goals.iter().enumerate().filter(|&(k, _)| ground.robots[k].is_ordered()) {
            let chosen = goal.and_then(|goal| {
                let (frontier, stand) = looks[goal];
                Some(Chosen { frontier: &found[frontier], stand, seconds: candidates[goal].seconds[k]? })
            });
            self.set_errand(ground, k, chosen, reach, sight_m);
        }
        let is_taken = |goal: usize| goals.contains(&Some(goal));
        for (_, &(number, _)) in looks.iter().enumerate().filter(|&(goal, _)| !is_taken(goal)) {
            self.left.push(left(ground.map, &found[number], WhyLeft::Waiting));
        }
    }

    fn weights(&self, ground: &Ground<'_>, sight_m: f64) -> Weights {
        let speed = ground.robots.iter().map(|robot| robot.speed_m_per_s).fold(0.0, f64::max).max(1e-3);
        Weights {
            m2_per_s: self.settings.m2_per_s,
            most_m2: sight_m * sight_m,
            loyal_m2: self.settings.m2_per_s * 0.5 * sight_m / speed,
            least_m2: least_m2(ground),
        }
    }

    /// Frontiers that robots may be sent to, with the number of each and where to look from; why the others are left is noted.
    fn candidates(
        &mut self,
        ground: &Ground<'_>,
        found: &[Frontier],
        reach: &Reach,
        views: &mut Views<'_>,
        sight_m: f64,
    ) -> (Vec<Candidate>, Vec<(usize, usize)>) {
        let held: Vec<(usize, usize, bool)> = self.held(ground, found);
        let (mut candidates, mut looks) = (Vec::new(), Vec::new());
        self.left.clear();
        for (number, frontier) in found.iter().enumerate() {
            let holder = held.iter().find(|(_, of, _)| *of == number);
            match self.judge(ground, frontier, reach, views, sight_m) {
                Ok((stand, blocks)) => {
                    let seconds = |(k, robot): (usize, &Explorer)| {
                        let bound = held.iter().any(|&(held_by, of, bound)| held_by == k && bound && of != number);
                        let barred = bound || self.barred(ground, robot, frontier).is_some();
                        let cost_m = if barred { None } else { reach.cost_m(ground, k, stand) };
                        Some(cost_m? / robot.speed_m_per_s.max(1e-3))
                    };
                    let seconds = ground.robots.iter().enumerate().map(seconds).collect();
                    let held_by = holder.map(|holder| holder.0);
                    let bound = holder.filter(|holder| holder.2).map(|holder| holder.0);
                    candidates.push(Candidate { blocks, seconds, held_by, bound });
                    looks.push((number, stand));
                }
                Err(why) => self.left.push(left(ground.map, frontier, why)),
            }
        }
        (candidates, looks)
    }

    /// Where to look at a frontier from and what is to be seen there, or why no robot is sent.
    fn judge(
        &self,
        ground: &Ground<'_>,
        frontier: &Frontier,
        reach: &Reach,
        views: &mut Views<'_>,
        sight_m: f64,
    ) -> Result<(usize, Vec<u32>), WhyLeft> {
        let map = ground.map;
        let Some(terrain) = reach.terrains.first() else { return Err(WhyLeft::TooNarrow) };
        if frontier.length_m(map) < terrain.radius_m() {
            return Err(WhyLeft::TooSmall { new_m2: 0.0 });
        }
        let ordered: Vec<usize> = (0..ground.robots.len()).filter(|&k| ground.robots[k].is_ordered()).collect();
        let gets_to = |k: usize, cell: usize| reach.cost_m(ground, k, cell).is_some();
        let stands = frontier.stands(map, terrain);
        if stands.is_empty() {
            return Err(WhyLeft::TooNarrow);
        }
        let is_reached = |stand: &usize| ordered.iter().any(|&k| gets_to(k, *stand));
        let stand = stands.into_iter().find(is_reached).ok_or(WhyLeft::Unreachable)?;
        // Barred for all that get there, if only for a time.
        let bars =
            ordered.iter().filter(|&&k| gets_to(k, stand)).map(|&k| self.barred(ground, &ground.robots[k], frontier));
        let bars: Option<Vec<WhyLeft>> = bars.collect();
        let for_a_time = |why: &&WhyLeft| matches!(why, WhyLeft::Blacklisted { .. });
        if let Some(why) = bars.as_ref().and_then(|bars| bars.iter().find(for_a_time).or(bars.first())) {
            return Err(*why);
        }
        let reach_m = ground.robots.iter().map(|robot| robot.reach_m).fold(0.0, f64::max);
        let blocks = views.seen_from(stand, reach_m, sight_m);
        let new_m2 = blocks.iter().map(|&block| views.unknown_m2(block)).sum::<f64>();
        if new_m2 < least_m2(ground) { Err(WhyLeft::TooSmall { new_m2 }) } else { Ok((stand, blocks)) }
    }

    /// Why a robot may not be sent to a frontier, if so.
    fn barred(&self, ground: &Ground<'_>, robot: &Explorer, frontier: &Frontier) -> Option<WhyLeft> {
        let limits = Limits { tries: self.settings.tries, looks: self.settings.looks, visits: self.settings.visits };
        self.places.barred(robot.id, ground.map.center_m(frontier.middle), Self::same_m(ground), ground.now_s, limits)
    }

    /// Robots with the numbers of the frontiers that they are on their way to, and whether they may not change their mind any more.
    fn held(&self, ground: &Ground<'_>, found: &[Frontier]) -> Vec<(usize, usize, bool)> {
        let held = |errand: &Errand| {
            let robot = ground.robots.iter().position(|robot| robot.id == errand.robot)?;
            let frontier = nearest_frontier(ground.map, found, errand.frontier_m, Self::same_m(ground))?;
            Some((robot, frontier, self.is_bound(errand.robot)))
        };
        self.errands.iter().filter_map(held).collect()
    }

    fn set_errand(&mut self, ground: &Ground<'_>, k: usize, chosen: Option<Chosen<'_>>, reach: &Reach, sight_m: f64) {
        let robot = &ground.robots[k];
        let before = self.errands.iter().position(|errand| errand.robot == robot.id);
        let before = before.map(|place| self.errands.remove(place));
        let Some(Chosen { frontier, stand, seconds }) = chosen else {
            return self.drop_errand(ground, robot, before, sight_m);
        };
        let path_m = reach.path_m(ground, k, stand);
        let (frontier_m, goal_m) = (ground.map.center_m(frontier.middle), ground.map.center_m(stand));
        let same_m = Self::same_m(ground);
        let is_same = |errand: &Errand| {
            frontier.cells.iter().any(|&cell| apart_m(ground.map.center_m(cell), errand.frontier_m) <= same_m)
        };
        let errand = match before {
            // Its clock goes on. Where to look from may have moved with the frontier; that is no progress.
            Some(errand) if is_same(&errand) => Errand { goal_m, path_m, ..errand },
            before => {
                self.drop_errand(ground, robot, before, sight_m);
                Errand {
                    robot: robot.id,
                    frontier_m,
                    goal_m,
                    deadline_s: ground.now_s + SLOW_TIMES * seconds + Self::patience_s(sight_m, robot),
                    nearest_m: f64::INFINITY,
                    nearer_s: ground.now_s,
                    arrived_s: None,
                    path_m,
                }
            }
        };
        self.errands.push(errand);
    }

    /// A change of mind, or, where the robot may change it no more, an end.
    fn drop_errand(&mut self, ground: &Ground<'_>, robot: &Explorer, errand: Option<Errand>, sight_m: f64) {
        let Some(errand) = errand else { return };
        if self.is_bound(errand.robot) {
            let age_s = 2.0 * Self::patience_s(sight_m, robot);
            self.end(&errand, Ending::Stuck, Self::same_m(ground), ground.now_s, age_s);
        } else {
            *self.changes.entry(errand.robot).or_insert(0) += 1;
        }
    }
}

impl Ground<'_> {
    /// Whether all robots are given orders here.
    fn is_alone(&self) -> bool {
        self.claimed.is_empty() && self.robots.iter().all(Explorer::is_ordered)
    }
}

impl Reach {
    fn fill(&mut self, ground: &Ground<'_>) {
        let mut radii_m: Vec<f64> = ground.robots.iter().map(|robot| robot.radius_m).collect();
        radii_m.sort_by(f64::total_cmp);
        radii_m.dedup();
        self.terrains = radii_m.iter().map(|&radius_m| Terrain::new(ground.map, radius_m)).collect();
        self.travel.resize_with(ground.robots.len(), Default::default);
        for (robot, (number, travel)) in ground.robots.iter().zip(&mut self.travel) {
            *number = radii_m.partition_point(|&radius_m| radius_m < robot.radius_m);
            travel.fill(ground.map, &self.terrains[*number], robot.at_m());
        }
    }

    /// Of a robot's way to a cell.
    fn cost_m(&self, ground: &Ground<'_>, robot: usize, cell: usize) -> Option<f64> {
        let (number, travel) = &self.travel[robot];
        travel.cost_m(ground.map, &self.terrains[*number], cell)
    }

    fn path_m(&self, ground: &Ground<'_>, robot: usize, cell: usize) -> Vec<[f64; 2]> {
        let (number, travel) = &self.travel[robot];
        travel.path_m(ground.map, &self.terrains[*number], cell)
    }
}

/// Frontiers this near to each other are one place, metres.
fn same_m(map: &OccupancyMap, robots: &[Explorer]) -> f64 {
    let widest = robots.iter().map(|robot| robot.radius_m).fold(0.0, f64::max);
    (3.0 * widest).max(3.0 * map.resolution_m())
}

/// What is not worth a robot's way: no more area than the narrowest robot stands on, square metres.
fn least_m2(ground: &Ground<'_>) -> f64 {
    let narrowest_m = ground.robots.iter().map(|robot| robot.radius_m).fold(f64::INFINITY, f64::min);
    std::f64::consts::PI * narrowest_m * narrowest_m
}

fn left(map: &OccupancyMap, frontier: &Frontier, why: WhyLeft) -> Left {
    Left { at_m: map.center_m(frontier.middle), length_m: frontier.length_m(map), why }
}

fn apart_m(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// The frontier with the cell nearest to a point, within a distance.
fn nearest_frontier(map: &OccupancyMap, found: &[Frontier], point_m: [f64; 2], within_m: f64) -> Option<usize> {
    let away_m = |frontier: &Frontier| {
        let cells = frontier.cells.iter().map(|&cell| apart_m(map.center_m(cell), point_m));
        cells.fold(f64::INFINITY, f64::min)
    };
    let nearest = found.iter().enumerate().map(|(number, frontier)| (number, away_m(frontier)));
    nearest.filter(|(_, away_m)| *away_m <= within_m).min_by(|a, b| a.1.total_cmp(&b.1)).map(|(number, _)| number)
}
