//! Simulated robots that explore a building: the run behind `mapwright explore` and `suite explore`.

mod driver;
mod team;
mod truth;

use crate::failure::Failure;
use driver::{Driver, Ground};
use mapwright::{Pose2, Settings};
use mapwright_explore::{Decision, Exploration, ExploreSettings, Explorer, OccupancyMap, Order, Traffic};
use mapwright_sim::{LaserSettings, OdometryNoise, RobotSettings, Rovers, Site, Twist, worlds};
use std::f64::consts::TAU;
use std::sync::Arc;
use std::time::{Duration, Instant};
use team::Team;
use truth::Truth;

/// Radius of a robot, metres.
pub(crate) const RADIUS_M: f64 = 0.22;
/// What there is to see is seen from where a robot has so much room to spare, metres: a cell of its map.
const SPARE_M: f64 = 0.1;
/// How far its laser sees, metres, and its beams: a cheap one that turns.
pub(crate) const REACH_M: f64 = 12.0;
const BEAMS: usize = 360;
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
const LIMIT_S: f64 = 10_800.0;
/// What is asked for: this share of all that there is to see.
pub(crate) const SHARE: f64 = 0.99;

/// What robots know of each other.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Sharing {
    /// One map, and one decision who goes where.
    Work,
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
    /// A robot that is switched off, and when, seconds.
    pub(crate) dies: Option<(usize, f64)>,
}

/// What came of it.
#[derive(Debug)]
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
    /// Where each robot truly was, second by second.
    pub(crate) ways: Vec<Vec<Pose2>>,
    pub(crate) map: Option<OccupancyMap>,
    /// Of the keyframes, metres, rmse.
    pub(crate) error_m: Option<f64>,
    /// Time that decisions took which made a plan.
    pub(crate) deciding: Duration,
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

    pub(crate) fn rooms(seed: u64) -> Self {
        Self::of(worlds::three_rooms(seed), seed)
    }

    fn of(site: Site, seed: u64) -> Self {
        let rovers = rovers(&site, &[site.start(0.0)], seed);
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
        let team = Team::new(plan.slam.then_some(settings), &starts, plan.sharing != Sharing::Nothing)?;
        let deciders = if plan.sharing == Sharing::Work { 1 } else { plan.robots };
        let mut fleet = Fleet {
            plan: *plan,
            rovers: rovers(&self.site, &starts, plan.seed),
            drivers: starts.iter().map(|&start| Driver::standing(start)).collect(),
            traffic: Traffic::default(),
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
            },
        };
        fleet.drive();
        Ok(fleet.finish())
    }
}

fn rovers(site: &Site, starts: &[Pose2], seed: u64) -> Rovers {
    let mut laser = LaserSettings::with_field_of_view(TAU, BEAMS);
    Arc::make_mut(&mut laser.model).range_max_m = REACH_M;
    let settings = RobotSettings { turn_rate_rad_per_s: 1.5, ..RobotSettings::default() };
    Rovers::new(site.world.clone(), starts, RADIUS_M, settings, laser, OdometryNoise::default(), seed)
}

struct Fleet {
    plan: Plan,
    rovers: Rovers,
    drivers: Vec<Driver>,
    team: Team,
    truth: Truth,
    traffic: Traffic,
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
            if step % DECIDE_STEPS == 0 && self.decide(now_s) {
                return;
            }
            let speed = RobotSettings::default().speed_m_per_s;
            for number in 0..self.drivers.len() {
                let (odom, truth) = (self.rovers.odom_from_robot(number), self.rovers.world_from_robot(number));
                self.drivers[number].map_from_robot = self.team.map_from_robot(number, odom, truth);
                if self.drivers[number].alive {
                    self.team.stand(number, self.drivers[number].at_m());
                }
            }
            let twists: Vec<Twist> = (0..self.drivers.len())
                .map(|number| driver::twist(&mut self.drivers, number, RADIUS_M, speed))
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

    fn switch_off(&mut self) {
        if let Some((number, _)) = self.plan.dies {
            self.drivers[number].switch_off();
            self.team.feel(number, self.drivers[number].at_m(), 2.0 * RADIUS_M, f64::INFINITY);
        }
    }

    /// Whether another robot is what was met there.
    fn is_robot(&self, number: usize, point_m: [f64; 2]) -> bool {
        let others = self.drivers.iter().enumerate().filter(|&(other, _)| other != number);
        others.into_iter().any(|(_, other)| driver::apart_m(other.at_m(), point_m) < 2.0 * RADIUS_M)
    }

    fn scan(&mut self, number: usize) {
        if !self.drivers[number].alive {
            return;
        }
        let Some(mut scan) = self.rovers.scan(number) else { return };
        let others: Vec<[f64; 2]> = self
            .drivers
            .iter()
            .enumerate()
            .filter(|&(k, driver)| k != number && driver.alive)
            .map(|(_, driver)| driver.at_m())
            .collect();
        team::without_bodies(&mut scan, self.drivers[number].map_from_robot, &others, RADIUS_M);
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
        if now_s >= LIMIT_S {
            return true;
        }
        self.team.forget(now_s);
        self.hear(now_s);
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
            let heard: Vec<Explorer> = heard.copied().collect();
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
        self.find_ways(&orders);
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
        driver::find_ways(&mut self.traffic, &grounds, &mut self.drivers, orders, RADIUS_M);
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
        self.run
    }
}
