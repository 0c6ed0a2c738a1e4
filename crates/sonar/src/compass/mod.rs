//! The walls of a building as a compass: most are parallel or at right angles, and say where the robot looks to, however long ago it
//! set out.
//!
//! What odometry's heading is off by is a histogram over the angles within a right angle (*Probabilistic Robotics*, section 8.2):
//! turns and ways spread it, and each wall sharpens it, with the probability that it is parallel at all. That share is learnt on the
//! way: where walls go in all directions it falls, and odometry stays what it is. A heading is settled when the robot is some metres on, by
//! what was heard before it and after it (forwards and backwards: a corner is where wheels err, and the walls that tell come behind it).

mod belief;
mod faults;

use crate::arc::Arc2;
use crate::edge::line_rather_than_point;
use crate::hough::walls;
use crate::place::stands;
use belief::{Belief, wrap_right_angle};
use faults::Faults;
use mapwright_geom::{Pose2, sin_cos, wrap_angle};
use mapwright_sensor::{Echo, SonarReading};
use std::collections::VecDeque;

/// Variance of headings a radian turned and a metre driven, rad^2: wheels err by 10 % and by 1.3 degrees beside what they always get wrong.
const TURN_VARIANCE: f64 = 0.01;
const WAY_VARIANCE: f64 = 5e-4;
/// As how much way a turn counts, metres a radian.
pub(crate) const LEVER_M: f64 = 0.5;
/// Headings are told anew after so much way, metres, and settled after so much more: walls tell themselves from others over some two
/// metres, and a second one should be among them.
const LEG_M: f64 = 0.3;
const SETTLED_M: f64 = 4.0;
/// Walls are looked for among the echoes of so much way, metres: as far as odometry keeps straight.
const HEARD_OVER_M: f64 = 2.5;
/// By so much the summed squared deviations of a wall's echoes must be less than from any point: an edge has no direction.
const NO_POINT: f64 = 6.0;
/// Walls of a building are parallel to this, radians.
const PARALLEL_RAD: f64 = 0.02;
/// A heading is corrected where it is known so well; 0 is not at all, 1 exactly.
const SURE: f64 = 0.5;
/// Walls that are parallel and those that were asked, before any was: one of three.
const ASSUMED: [f64; 2] = [1.0, 3.0];

/// A reading, and the robot's pose by odometry.
type Placed = (SonarReading, Pose2);

/// A short piece of way.
#[derive(Debug, Clone)]
struct Leg {
    /// The way when it began, metres.
    way_m: f64,
    driven_m: f64,
    turned_rad: f64,
    /// Variance of what odometry gets wrong in heading on it.
    variance: f64,
    /// Directions of walls heard in it by odometry, and their standard deviations, radians.
    walls: Vec<[f64; 2]>,
    /// Each with the way when it was taken, metres.
    readings: Vec<(f64, Placed)>,
}

/// Corrects the headings of odometry by walls; readings come out some metres later.
#[derive(Debug, Clone, Default)]
pub(crate) struct Compass {
    last: Option<Pose2>,
    /// Odometry without what wheels always get wrong.
    odom_from_robot: Option<Pose2>,
    way_m: f64,
    /// Number of the place where the robot is, and where that is by odometry: sonars that take turns are heard from one place.
    place: u32,
    stood_at: Option<Pose2>,
    legs: VecDeque<Leg>,
    /// Echoes of the last metres, each with the way then.
    heard: VecDeque<(f64, Arc2)>,
    settled: Belief,
    /// What the last settled heading was off by, radians: what is to be added to odometry's.
    correction_rad: f64,
    /// Direction of the building's walls, radians; they may be found long after the robot set out.
    building_rad: Option<f64>,
    /// Poses of the last reading that came out, by odometry and corrected.
    corrected: Option<[Pose2; 2]>,
    ready: VecDeque<Placed>,
    faults: Faults,
    /// Walls that were parallel, by their probabilities, and all.
    parallel: f64,
    asked: f64,
    /// Log of how much likelier they are in a building of parallel walls than in one whose walls have any directions, each told
    /// beforehand by those before it.
    evidence: f64,
}

impl Compass {
    /// The next reading, its pose corrected.
    pub(crate) fn next_corrected(&mut self) -> Option<Placed> {
        self.ready.pop_front()
    }

    /// Walls whose directions were told, and how many of them were parallel or at right angles to the others.
    pub(crate) fn walls(&self) -> [f64; 2] {
        [self.asked, self.parallel]
    }

    /// No more readings come: all headings are settled, and what follows is another way.
    pub(crate) fn end(&mut self) {
        self.find_walls();
        while !self.legs.is_empty() {
            self.settle();
        }
        let Self { ready, parallel, asked, .. } = std::mem::take(self);
        *self = Self { ready, parallel, asked, ..Self::default() };
    }

    pub(crate) fn add(&mut self, reading: SonarReading, by_wheels: Pose2) {
        let step = self.last.replace(by_wheels).map_or(Pose2::IDENTITY, |last| last.between(by_wheels));
        let (driven_m, turned_rad) = (step.x.hypot(step.y), wrap_angle(step.theta));
        let step = Pose2 { theta: wrap_angle(turned_rad + self.faults.correction_rad(driven_m, turned_rad)), ..step };
        let odom_from_robot = self.odom_from_robot.map_or(by_wheels, |last| last * step);
        self.odom_from_robot = Some(odom_from_robot);
        self.way_m += driven_m + LEVER_M * turned_rad.abs();
        if self.stood_at.is_none_or(|at| !stands(at, by_wheels)) {
            self.stood_at = Some(by_wheels);
            self.place += 1;
        }
        if self.legs.back().is_none_or(|leg| self.way_m - leg.way_m >= LEG_M) {
            self.find_walls();
            self.legs.push_back(Leg {
                way_m: self.way_m,
                driven_m: 0.0,
                turned_rad: 0.0,
                variance: 0.0,
                walls: Vec::new(),
                readings: Vec::new(),
            });
            while self.legs.front().is_some_and(|leg| leg.way_m < self.way_m - SETTLED_M) {
                self.settle();
            }
        }
        self.heard.extend(echoes(&reading, odom_from_robot, self.place).map(|arc| (self.way_m, arc)));
        while self.heard.pop_front_if(|(way_m, _)| *way_m < self.way_m - HEARD_OVER_M).is_some() {}
        if let Some(leg) = self.legs.back_mut() {
            leg.driven_m += driven_m;
            leg.turned_rad += turned_rad;
            leg.variance += TURN_VARIANCE * turned_rad.abs() + WAY_VARIANCE * driven_m;
            leg.readings.push((self.way_m, (reading, odom_from_robot)));
        }
    }

    /// Walls that have answered of late tell their directions; their echoes tell no more.
    fn find_walls(&mut self) {
        let Some(robot) = self.odom_from_robot else { return };
        let arcs: Vec<Arc2> = self.heard.iter().map(|(_, arc)| arc.seen_from(robot)).collect();
        let mut told = vec![false; arcs.len()];
        for wall in walls(&arcs, 0.0) {
            if line_rather_than_point(&arcs, &wall) < NO_POINT {
                continue;
            }
            wall.echoes.iter().for_each(|&(echo, _)| told[echo] = true);
            let middle = wall.echoes.get(wall.echoes.len() / 2).and_then(|&(echo, _)| self.heard.get(echo));
            let Some(&(middle_m, arc)) = middle else { continue };
            let length_m = wall.seen_m[1] - wall.seen_m[0];
            // Least squares over places evenly spread along it.
            let variance = (arc.sigma_m() / length_m).powi(2) * 12.0 / wall.echoes.len() as f64 + PARALLEL_RAD.powi(2);
            if let Some(leg) = self.legs.iter_mut().rev().find(|leg| leg.way_m <= middle_m) {
                leg.walls.push([robot.theta + wall.normal_rad, variance.sqrt()]);
            }
        }
        let mut told = told.into_iter();
        self.heard.retain(|_| told.next() == Some(false));
    }

    /// How many walls are parallel.
    fn share(&self) -> f64 {
        (self.parallel + ASSUMED[0]) / (self.asked + ASSUMED[1])
    }

    fn told(&self, leg: &Leg) -> Belief {
        let share = self.share();
        leg.walls.iter().fold(Belief::default(), |told, &[direction_rad, sigma_rad]| {
            told.with(&Belief::of_wall(direction_rad, sigma_rad, share))
        })
    }

    /// The heading of the first leg by all that was heard before it, on it and after it.
    fn settle(&mut self) {
        let after = self
            .legs
            .iter()
            .skip(1)
            .rev()
            .fold(Belief::default(), |after, leg| after.with(&self.told(leg)).spread(leg.variance.sqrt()));
        let Some(leg) = self.legs.pop_front() else { return };
        let before = self.settled.spread(leg.variance.sqrt());
        let around = before.with(&after);
        let told = self.told(&leg);
        let (angle_rad, sure) = around.with(&told).mean();
        let share = self.share();
        for &[direction_rad, sigma_rad] in &leg.walls {
            let parallel = Belief::of_wall(direction_rad, sigma_rad, 1.0);
            // How much likelier it is among parallel walls than among walls of all directions.
            let likelier = |belief: &Belief| belief.likelihood(&parallel) / belief.likelihood(&Belief::default());
            self.evidence += (share * likelier(&before) + 1.0 - share).ln();
            self.asked += 1.0;
            self.parallel += share * likelier(&around) / (share * likelier(&around) + 1.0 - share);
        }
        self.settled = before.with(&told);
        let before_rad = self.correction_rad;
        let mut growth_rad = 0.0;
        if sure >= SURE && self.evidence > 0.0 {
            let building_rad = *self.building_rad.get_or_insert(angle_rad - before_rad);
            growth_rad = wrap_right_angle(angle_rad - building_rad - before_rad);
            self.correction_rad += growth_rad;
        }
        self.faults.learn([leg.driven_m, leg.turned_rad], growth_rad, sure / leg.variance.max(f64::MIN_POSITIVE));
        let Some(&(last_m, _)) = leg.readings.last() else { return };
        for (way_m, (reading, odom_from_robot)) in leg.readings {
            let share = if last_m > leg.way_m { (way_m - leg.way_m) / (last_m - leg.way_m) } else { 1.0 };
            self.correct(reading, odom_from_robot, before_rad + share * growth_rad);
        }
    }

    /// A reading comes out, its pose as far on as odometry says in the corrected direction.
    fn correct(&mut self, reading: SonarReading, odom_from_robot: Pose2, correction_rad: f64) {
        let theta = wrap_angle(odom_from_robot.theta + correction_rad);
        let pose = match self.corrected {
            None => Pose2 { theta, ..odom_from_robot },
            Some([before, pose]) => {
                let step = before.between(odom_from_robot);
                let (sin, cos) = sin_cos(wrap_angle(theta - step.theta));
                Pose2::new(pose.x + cos * step.x - sin * step.y, pose.y + sin * step.x + cos * step.y, theta)
            }
        };
        self.corrected = Some([odom_from_robot, pose]);
        self.ready.push_back((reading, pose));
    }
}

/// A reading's echoes, in the frame that the pose is in.
fn echoes(reading: &SonarReading, from_robot: Pose2, place: u32) -> impl Iterator<Item = Arc2> {
    let sonars = reading.ring.sonars.iter().zip(&reading.ranges_m);
    sonars.filter_map(move |(sonar, &range_m)| match sonar.echo(range_m) {
        Echo::At(range_m) => Some(Arc2 {
            stretch_from_sonar: from_robot * sonar.robot_from_sonar,
            half_rad: 0.5 * sonar.opening_rad,
            range_m,
            place,
        }),
        Echo::Nothing | Echo::TooNear | Echo::NotFired => None,
    })
}
