//! Simulated robots that explore a building: the run behind `mapwright explore` and `suite explore`.

mod driver;
mod team;
mod truth;

use crate::failure::Failure;
use driver::Driver;
use mapwright::{Pose2, Settings};
use mapwright_explore::{Decision, Exploration, ExploreSettings, Explorer, OccupancyMap, Terrain};
use mapwright_sim::{LaserSettings, OdometryNoise, RobotSettings, Rovers, Site, Twist, worlds};
use std::f64::consts::TAU;
use std::sync::Arc;
use std::time::{Duration, Instant};
use team::Team;
use truth::Truth;

/// Radius of a robot, metres.
pub(crate) const RADIUS_M: f64 = 0.22;
/// What it is planned with, on cells of 0.1 m: it may be off its way by so much more, metres.
const NEEDS_M: f64 = RADIUS_M + 0.05;
/// How far its laser sees, metres, and its beams: a cheap one that turns.
pub(crate) const REACH_M: f64 = 12.0;
const BEAMS: usize = 360;
/// A cell is driven around where one in so many beams ended: a table's leg takes up little of it.
const PASSES_PER_HIT: u32 = 12;
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

/// What is simulated.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plan {
    pub(crate) seed: u64,
    pub(crate) robots: usize,
    pub(crate) explore: ExploreSettings,
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
        let site = worlds::large_office(seed);
        let rovers = rovers(&site, &[site.start(0.0)], seed);
        let truth = Truth::new(&rovers, site.start(0.0), NEEDS_M + 0.05, REACH_M);
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
        let team = if plan.slam { Team::mapped(settings, &starts)? } else { Team::perfect(&starts) };
        let drivers = starts.iter().map(|&map_from_robot| Driver { map_from_robot, alive: true, ..Driver::default() });
        let mut fleet = Fleet {
            plan: *plan,
            rovers: rovers(&self.site, &starts, plan.seed),
            drivers: drivers.collect(),
            team,
            truth: self.truth.unseen(),
            exploration: Exploration::new(plan.explore),
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
    exploration: Exploration,
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
            }
            let twists: Vec<Twist> = (0..self.drivers.len())
                .map(|number| driver::twist(&mut self.drivers, number, RADIUS_M, speed))
                .collect();
            let before: Vec<Pose2> = (0..twists.len()).map(|number| self.rovers.world_from_robot(number)).collect();
            self.rovers.step(&twists, STEP_S);
            for (number, before) in before.into_iter().enumerate() {
                let moved_m = before.distance(self.rovers.world_from_robot(number));
                self.drivers[number].moved(twists[number], moved_m, RADIUS_M, now_s);
            }
        }
    }

    fn switch_off(&mut self) {
        if let Some((number, _)) = self.plan.dies {
            let driver = &mut self.drivers[number];
            (driver.alive, driver.goal_m, driver.way_m) = (false, None, Vec::new());
        }
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
            .map(|(_, driver)| [driver.map_from_robot.x, driver.map_from_robot.y])
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
        let Some(map) = self.team.map(PASSES_PER_HIT) else { return false };
        self.hear(now_s);
        let (started, plans) = (Instant::now(), self.exploration.plans());
        self.run.decision = self.exploration.decide(&map, &self.explorers, now_s);
        if self.exploration.plans() > plans {
            self.run.deciding += started.elapsed();
        }
        if self.run.decision.done {
            self.run.done_s = Some(now_s);
            self.run.map = Some(map);
            return true;
        }
        for order in &self.run.decision.orders {
            self.drivers[order.robot as usize].goal_m = order.goal_m;
        }
        let terrain = Terrain::new(&map, NEEDS_M);
        driver::find_ways(&map, &terrain, &mut self.drivers, RADIUS_M, now_s);
        self.run.map = Some(map);
        false
    }

    fn hear(&mut self, now_s: f64) {
        for (number, driver) in self.drivers.iter().enumerate().filter(|(_, driver)| driver.alive) {
            let explorer = Explorer {
                id: number as u32,
                map_from_robot: driver.map_from_robot,
                heard_s: now_s,
                radius_m: NEEDS_M,
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
        self.run.errands = self.exploration.errands_ended();
        self.run.plans = self.exploration.plans();
        self.run.error_m = self.team.error_m(&self.taken);
        self.run
    }
}
