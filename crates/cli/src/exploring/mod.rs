//! Simulated robots that explore a building: the run behind `mapwright explore` and `suite explore`.

mod driver;
mod knowledge;
mod team;
mod told;
mod truth;

use crate::failure::Failure;
use crate::robots::Simulated;
use driver::{Driver, Ground};
use knowledge::Knowledge;
use mapwright::{Pose2, Settings};
use mapwright_explore::{Decides, Decision, Exploration, ExploreSettings, Explorer, OccupancyMap, Order, Traffic};
use mapwright_sim::{LaserSettings, OdometryNoise, RadioSettings, RobotSettings, Rovers, Site, Twist, worlds};
use std::f64::consts::TAU;
use std::sync::Arc;
use std::time::{Duration, Instant};
use team::Team;
use told::Told;
use truth::Truth;

/// Radius of a robot, metres.
pub(crate) const RADIUS_M: f64 = 0.22;
/// What there is to see is seen from where a robot has so much room to spare, metres: a cell of its map.
const SPARE_M: f64 = 0.1;
/// How far its laser sees, metres, and its beams: a cheap one that turns.
pub(crate) const REACH_M: f64 = 12.0;
pub(crate) const BEAMS: usize = 360;
/// What held a robot that its map does not show is kept off for so long, seconds: it may have moved, and a narrow room must not stay shut.
const KEEP_OFF_S: f64 = 20.0;
/// Robots start so far from each other, metres.
const APART_M: f64 = 0.8;
/// Steps of the simulation, seconds; so many of them for a scan, and for a decision.
const STEP_S: f64 = 0.1;
const SCAN_STEPS: u32 = 2;
const PERFECT_SCAN_STEPS: u32 = 4;
const DECIDE_STEPS: u32 = 10;
/// A run that takes longer than this never ends, seconds.
pub(crate) const LIMIT_S: f64 = 10_800.0;
/// After it robots that tell each other have so long to agree, seconds.
const SETTLE_S: f64 = 120.0;
/// What is asked for: this share of all that there is to see.
pub(crate) const SHARE: f64 = 0.99;

/// What robots know of each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Sharing {
    /// One map, and one decision who goes where.
    Work,
    /// What they tell each other over the air; each makes its map of that, and decides for itself.
    Told,
    /// One map; each decides for itself and does not know where the others go.
    Map,
    /// Each has the map that it made itself.
    Nothing,
}

/// What is simulated.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plan {
    pub(crate) seed: u64,
    pub(crate) robots: usize,
    pub(crate) explore: ExploreSettings,
    pub(crate) sharing: Sharing,
    /// Each robot maps by itself; otherwise scans are drawn where they were truly taken.
    pub(crate) slam: bool,
    /// Of robots that tell each other: the share of messages that is lost.
    pub(crate) loss: f64,
    /// A robot that is switched off, and when, seconds.
    pub(crate) dies: Option<(usize, f64)>,
    /// The run ends then, seconds.
    pub(crate) until_s: f64,
    /// Of each robot's laser.
    pub(crate) beams: usize,
}

/// What came of it.
pub(crate) struct Run {
    /// When [`SHARE`] of everything was seen, seconds.
    pub(crate) seconds: Option<f64>,
    /// When the robots said that nothing is left.
    pub(crate) done_s: Option<f64>,
    /// Share seen, second by second.
    pub(crate) curve: Vec<f64>,
    pub(crate) area_m2: f64,
    /// True length of all ways, metres.
    pub(crate) driven_m: f64,
    pub(crate) bumps: u32,
    pub(crate) errands: u32,
    pub(crate) plans: u32,
    pub(crate) decision: Decision,
    /// Where each robot truly was, second by second, in the map's frame.
    pub(crate) ways: Vec<Vec<Pose2>>,
    pub(crate) map: Option<OccupancyMap>,
    /// Of the keyframes, metres, rmse.
    pub(crate) error_m: Option<f64>,
    /// Time that decisions took which made a plan.
    pub(crate) deciding: Duration,
    /// Of robots that tell each other: themselves, and how long after the end all had the same map, seconds.
    pub(crate) air: Option<Simulated>,
    pub(crate) agreed_s: Option<f64>,
}

impl Run {
    pub(crate) fn share(&self) -> f64 {
        self.curve.last().copied().unwrap_or(0.0)
    }
}

/// A building to be explored, with what there is to see in it.
pub(crate) struct Building {
    site: Site,
    truth: Truth,
}

impl Building {
    pub(crate) fn office(seed: u64) -> Self {
        Self::of(worlds::large_office(seed), seed)
    }

    /// A smaller floor, of 900 to 1,500 square metres.
    pub(crate) fn floor(seed: u64) -> Self {
        Self::of(worlds::office_to_explore(seed), seed)
    }

    pub(crate) fn rooms(seed: u64) -> Self {
        Self::of(worlds::three_rooms(seed), seed)
    }

    fn of(site: Site, seed: u64) -> Self {
        let rovers = rovers(&site, &[site.start(0.0)], seed, BEAMS);
        let truth = Truth::new(&rovers, site.start(0.0), RADIUS_M + SPARE_M, REACH_M);
        Self { site, truth }
    }

    /// All that there is to see, square metres.
    pub(crate) fn area_m2(&self) -> f64 {
        self.truth.area_m2()
    }

    pub(crate) fn run(&self, plan: &Plan, settings: &Settings) -> Result<Run, Failure> {
        let middle = 0.5 * (plan.robots as f64 - 1.0);
        let starts: Vec<Pose2> =
            (0..plan.robots).map(|number| self.site.start((number as f64 - middle) * APART_M)).collect();
        let team = if plan.sharing == Sharing::Told {
            let radio = RadioSettings { loss: plan.loss, doubled: 0.05, delay_s: [0.005, 0.2], seed: plan.seed };
            Knowledge::Told(Box::new(Told::new(settings, plan.robots, radio)?))
        } else {
            let one_map = plan.sharing != Sharing::Nothing;
            Knowledge::Given(Team::new(plan.slam.then_some(settings), &starts, one_map)?)
        };
        let deciders = if plan.sharing == Sharing::Work { 1 } else { plan.robots };
        let mut fleet = Fleet {
            plan: *plan,
            rovers: rovers(&self.site, &starts, plan.seed, plan.beams),
            drivers: starts.iter().map(|&start| Driver::standing(start)).collect(),
            traffic: vec![Traffic::default(); deciders],
            beside: vec![vec![Driver::default(); plan.robots]; plan.robots],
            team,
            truth: self.truth.unseen(),
            explorations: vec![Exploration::new(plan.explore); deciders],
            planned: vec![0; plan.robots],
            explorers: Vec::new(),
            taken: vec![Vec::new(); plan.robots],
            scans: vec![0; plan.robots],
            run: Run {
                seconds: None,
                done_s: None,
                curve: Vec::new(),
                area_m2: self.truth.area_m2(),
                driven_m: 0.0,
                bumps: 0,
                errands: 0,
                plans: 0,
                decision: Decision::default(),
                ways: vec![Vec::new(); plan.robots],
                map: None,
                error_m: None,
                deciding: Duration::ZERO,
                air: None,
                agreed_s: None,
            },
        };
        fleet.drive();
        Ok(fleet.finish())
    }
}

fn rovers(site: &Site, starts: &[Pose2], seed: u64, beams: usize) -> Rovers {
    let mut laser = LaserSettings::with_field_of_view(TAU, beams);
    Arc::make_mut(&mut laser.model).range_max_m = REACH_M;
    let settings = RobotSettings { turn_rate_rad_per_s: 1.5, ..RobotSettings::default() };
    Rovers::new(site.world.clone(), starts, RADIUS_M, settings, laser, OdometryNoise::default(), seed)
}

struct Fleet {
    plan: Plan,
    rovers: Rovers,
    drivers: Vec<Driver>,
    team: Knowledge,
    truth: Truth,
    /// One for all, or each robot's own.
    traffic: Vec<Traffic>,
    /// Of robots that tell each other: the others as each robot takes them to drive.
    beside: Vec<Vec<Driver>>,
    /// One for all, or each robot's own.
    explorations: Vec<Exploration>,
    /// Plans by whose terrain each robot drives.
    planned: Vec<u32>,
    /// As each robot was last heard.
    explorers: Vec<Explorer>,
    /// Number and true pose of each robot's scans.
    taken: Vec<Vec<(u64, Pose2)>>,
    scans: Vec<u64>,
    run: Run,
}

impl Fleet {
    fn drive(&mut self) {
        for step in 0.. {
            let now_s = f64::from(step) * STEP_S;
            if self.plan.dies.is_some_and(|(number, at_s)| self.drivers[number].alive && now_s >= at_s) {
                self.switch_off();
            }
            if step % if self.plan.slam { SCAN_STEPS } else { PERFECT_SCAN_STEPS } == 0 {
                (0..self.drivers.len()).for_each(|number| self.scan(number));
            }
            if let Knowledge::Told(told) = &mut self.team {
                told.step(now_s);
            }
            if step % DECIDE_STEPS == 0 && self.decide(now_s) {
                return self.settle(now_s);
            }
            let speed = RobotSettings::default().speed_m_per_s;
            for number in 0..self.drivers.len() {
                let (odom, truth) = (self.rovers.odom_from_robot(number), self.rovers.world_from_robot(number));
                self.drivers[number].move_to(self.team.map_from_robot(number, odom, truth), odom);
                if self.drivers[number].alive {
                    self.team.stand(number, self.drivers[number].at_m());
                }
            }
            let twists: Vec<Twist> = (0..self.drivers.len())
                .map(|number| {
                    let others_m = self.others_m(number);
                    driver::twist(&mut self.drivers[number], &others_m, RADIUS_M, speed)
                })
                .collect();
            let before: Vec<Pose2> = (0..twists.len()).map(|number| self.rovers.world_from_robot(number)).collect();
            self.rovers.step(&twists, STEP_S);
            for (number, before) in before.into_iter().enumerate() {
                let moved_m = before.distance(self.rovers.world_from_robot(number));
                if let Some(point_m) = self.drivers[number].moved(twists[number], moved_m, RADIUS_M)
                    && !self.is_robot(number, point_m)
                {
                    self.team.feel(number, point_m, 0.0, now_s + KEEP_OFF_S);
                }
            }
        }
    }

    fn alive(&self) -> Vec<usize> {
        (0..self.drivers.len()).filter(|&number| self.drivers[number].alive).collect()
    }

    fn switch_off(&mut self) {
        let Some((number, _)) = self.plan.dies else { return };
        self.drivers[number].switch_off();
        if let Knowledge::Told(told) = &mut self.team {
            // Whoever comes near sees it stand there.
            told.air.robots[number].is_alive = false;
        } else {
            self.team.feel(number, self.drivers[number].at_m(), 2.0 * RADIUS_M, f64::INFINITY);
        }
    }

    /// Where the others are, in the map of a robot: those that it sees, where each knows only its own pose.
    fn others_m(&self, number: usize) -> Vec<[f64; 2]> {
        let others = (0..self.drivers.len()).filter(|&other| other != number);
        others.filter_map(|other| Some(self.beside_m(number, other)?.0)).collect()
    }

    /// Where another robot is in the map of a robot, and whether it drives.
    fn beside_m(&self, number: usize, other: usize) -> Option<([f64; 2], bool)> {
        let drives = self.drivers[other].alive;
        if self.plan.sharing != Sharing::Told {
            return Some((self.drivers[other].at_m(), drives));
        }
        let [own, other] = [number, other].map(|robot| self.rovers.world_from_robot(robot));
        let seen = own.between(other);
        let is_near = seen.x.hypot(seen.y) < driver::MEETING_M;
        is_near.then(|| (self.drivers[number].map_from_robot.transform([seen.x, seen.y]), drives))
    }

    /// Whether another robot is what was met there.
    fn is_robot(&self, number: usize, point_m: [f64; 2]) -> bool {
        self.others_m(number).into_iter().any(|other_m| driver::apart_m(other_m, point_m) < 2.0 * RADIUS_M)
    }

    fn scan(&mut self, number: usize) {
        if !self.drivers[number].alive {
            return;
        }
        let Some(mut scan) = self.rovers.scan(number) else { return };
        let others = (0..self.drivers.len()).filter(|&other| other != number);
        let alive = others.filter_map(|other| self.beside_m(number, other).filter(|(_, drives)| *drives));
        let others: Vec<[f64; 2]> = alive.map(|(other_m, _)| other_m).collect();
        team::without_bodies(&mut scan, self.drivers[number].map_from_robot, &others, RADIUS_M);
        self.drivers[number].look(&scan, self.rovers.odom_from_robot(number));
        let truth = self.rovers.world_from_robot(number);
        self.taken[number].push((self.scans[number], truth));
        self.scans[number] += 1;
        if self.team.add_scan(number, &scan, truth) {
            self.truth.see(&scan, truth);
        }
    }

    /// Once a second; whether the run is over.
    fn decide(&mut self, now_s: f64) -> bool {
        let share = self.truth.share();
        self.run.curve.push(share);
        if self.run.seconds.is_none() && share >= SHARE {
            self.run.seconds = Some(now_s);
        }
        for (number, way) in self.run.ways.iter_mut().enumerate() {
            way.push(self.rovers.world_from_robot(number));
        }
        if now_s >= self.plan.until_s {
            return true;
        }
        self.team.forget(now_s);
        self.hear(now_s);
        let alive = self.alive();
        if let Knowledge::Told(told) = &mut self.team {
            told.look(&self.rovers, now_s);
            for number in alive {
                told.follow(number);
                let odom_from_robot = self.rovers.odom_from_robot(number);
                let before = self.drivers[number].map_from_robot;
                let now = told.map_from_robot(number, odom_from_robot);
                if before.distance(now) > driver::MEETING_M {
                    // In another frame nothing is where it was.
                    self.explorations[number] = Exploration::new(self.plan.explore);
                }
                self.drivers[number].map_from_robot = now;
            }
        }
        let done = self.give_goals(now_s);
        if done {
            self.run.done_s = Some(now_s);
        }
        done
    }

    /// Has goals given and ways found; whether nothing is left.
    fn give_goals(&mut self, now_s: f64) -> bool {
        let mut orders = vec![None; self.drivers.len()];
        let mut done = true;
        self.run.decision = Decision::default();
        for (number, exploration) in self.explorations.iter_mut().enumerate() {
            let one = self.plan.sharing != Sharing::Work;
            let heard = self.explorers.iter().filter(|explorer| !one || explorer.id as usize == number);
            let mut heard: Vec<Explorer> = heard.copied().collect();
            if let Knowledge::Told(told) = &self.team {
                heard.iter_mut().for_each(|own| own.map_from_robot = self.drivers[number].map_from_robot);
                heard.extend(told.others(number));
            }
            let (started, plans) = (Instant::now(), exploration.plans());
            let decision = exploration.decide(self.team.map(number), &heard, now_s);
            if exploration.plans() > plans {
                self.run.deciding += started.elapsed();
            }
            decision.orders.iter().for_each(|order| orders[order.robot as usize] = Some(order.clone()));
            // Of a robot that was not heard nothing is asked any more.
            done &= decision.done || decision.orders.is_empty();
            if !decision.left.is_empty() {
                self.run.decision = decision;
            }
        }
        if let Knowledge::Told(told) = &mut self.team {
            for (number, order) in orders.iter().enumerate().filter(|&(number, _)| self.drivers[number].alive) {
                let goal_m = order.as_ref().and_then(|order: &Order| order.goal_m);
                told.say(number, self.rovers.odom_from_robot(number), goal_m);
            }
            self.find_ways_beside(&orders);
        } else {
            self.find_ways(&orders);
        }
        done
    }

    fn find_ways(&mut self, orders: &[Option<Order>]) {
        let mut grounds = Vec::new();
        for number in 0..self.drivers.len() {
            let exploration = &self.explorations[number.min(self.explorations.len() - 1)];
            let Some(terrain) = exploration.terrain(RADIUS_M) else { return };
            let is_new = self.planned[number] != exploration.plans();
            self.planned[number] = exploration.plans();
            grounds.push(Ground { map: self.team.map(number), terrain, is_new });
        }
        driver::find_ways(&mut self.traffic[0], &grounds, &mut self.drivers, orders, RADIUS_M);
    }

    /// Each robot finds its own way around the others that it sees, which it takes to go where they say.
    fn find_ways_beside(&mut self, orders: &[Option<Order>]) {
        let Knowledge::Told(told) = &self.team else { return };
        for number in self.alive() {
            let Some(terrain) = self.explorations[number].terrain(RADIUS_M) else { continue };
            let is_new = self.planned[number] != self.explorations[number].plans();
            self.planned[number] = self.explorations[number].plans();
            let said = told.others(number);
            let (mut drivers, mut ways) = (Vec::new(), Vec::new());
            let mut who = Vec::new();
            for other in 0..self.drivers.len() {
                if other == number {
                    drivers.push(self.drivers[number].clone());
                    ways.push(orders[number].clone());
                } else if let Some(([x, y], alive)) = self.beside_m(number, other) {
                    let goal_m =
                        said.iter().find(|said| said.id as usize == other).and_then(|said| match said.decides {
                            Decides::Itself { goal_m } => goal_m,
                            Decides::Here => None,
                        });
                    let mut driver = std::mem::take(&mut self.beside[number][other]);
                    (driver.map_from_robot, driver.alive) = (Pose2::new(x, y, 0.0), alive);
                    drivers.push(driver);
                    ways.push(Some(Order { robot: other as u32, goal_m, path_m: Vec::new() }));
                } else {
                    continue;
                }
                who.push(other);
            }
            let ground = Ground { map: told.map(number), terrain, is_new };
            let grounds = vec![ground; drivers.len()];
            driver::find_ways(&mut self.traffic[number], &grounds, &mut drivers, &ways, RADIUS_M);
            for (driver, other) in drivers.into_iter().zip(who) {
                let place = if other == number { &mut self.drivers[number] } else { &mut self.beside[number][other] };
                *place = driver;
            }
        }
    }

    /// Nobody drives any more; robots that tell each other say what is left to be said.
    fn settle(&mut self, now_s: f64) {
        if let Knowledge::Told(told) = &mut self.team {
            self.run.agreed_s = told.settle(now_s, SETTLE_S);
        }
    }

    fn hear(&mut self, now_s: f64) {
        for (number, driver) in self.drivers.iter().enumerate().filter(|(_, driver)| driver.alive) {
            let explorer = Explorer {
                id: number as u32,
                map_from_robot: driver.map_from_robot,
                heard_s: now_s,
                radius_m: RADIUS_M,
                speed_m_per_s: RobotSettings::default().speed_m_per_s,
                reach_m: REACH_M,
                decides: Decides::Here,
            };
            match self.explorers.iter_mut().find(|known| known.id == explorer.id) {
                Some(known) => *known = explorer,
                None => self.explorers.push(explorer),
            }
        }
    }

    fn finish(mut self) -> Run {
        self.run.driven_m = (0..self.drivers.len()).map(|number| self.rovers.driven_m(number)).sum();
        self.run.bumps = self.rovers.bumps();
        self.run.errands = self.explorations.iter().map(Exploration::errands_ended).sum();
        self.run.plans = self.explorations.iter().map(Exploration::plans).sum();
        self.run.map = Some(self.team.map(0).clone());
        self.run.error_m = self.team.error_m(&self.taken);
        if let Knowledge::Told(told) = self.team {
            self.run.air = Some(told.air);
            // Nobody was told where it starts: the map begins where its robot does.
            if let Some(world_from_map) = self.run.ways.first().and_then(|way| way.first()).copied() {
                let map_from_world = world_from_map.inverse();
                self.run.ways.iter_mut().flatten().for_each(|pose| *pose = map_from_world * *pose);
            }
        }
        self.run
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may")]
mod tests {
    use super::*;
    use mapwright_explore::Cell;

    #[test]
    fn ways_lie_where_the_map_is_free_in_whatever_frame_it_is() {
        for sharing in [Sharing::Work, Sharing::Told] {
            let plan = Plan {
                seed: 2,
                robots: 2,
                explore: ExploreSettings::default(),
                sharing,
                slam: true,
                loss: 0.1,
                dies: None,
                until_s: 60.0,
                beams: 180,
            };
            let run = Building::rooms(2).run(&plan, &Settings::default()).unwrap();
            let map = run.map.as_ref().unwrap();
            let poses = || run.ways.iter().flatten();
            let free = poses().filter(|pose| map.at([pose.x, pose.y]) == Cell::Free).count();
            assert!(poses().count() > 100 && free as f64 > 0.98 * poses().count() as f64, "{free}, {sharing:?}");
        }
    }
}
