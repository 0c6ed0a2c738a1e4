//! What robots know: their maps, one for all or one each, and where each of them is in it.

use crate::failure::Failure;
use mapwright::{LaserScan, Mapper, Pose2, Settings, Sweep};
use mapwright_explore::{OccupancyMap, SharedMap};
use mapwright_grid::Change;
use mapwright_sensor::{BeamTable, SweepPoints};
use std::sync::Arc;

/// Side of a cell of the map that ways are planned in, metres: a door of a metre leaves several cells to a robot.
pub(super) const CELL_M: f64 = 0.1;
/// A cell is driven around where one in so many beams ended: a table's leg takes up little of it.
pub(super) const PASSES_PER_HIT: u32 = 12;
/// A keyframe is drawn anew where a point of it may have moved by so much, metres: a quarter of a cell.
const FOLLOW_M: f64 = 0.25 * CELL_M;
/// Hits within this of where a robot of the team says it is are its body, metres: what poses may be off.
const BODY_MARGIN_M: f64 = 0.2;

/// The robots and their maps.
pub(super) struct Team {
    maps: Vec<SharedMap>,
    robots: Vec<Robot>,
    points: Points,
}

/// A robot, which maps by itself from a known start in one frame; without a mapper its scans are drawn where they were truly taken.
struct Robot {
    mapper: Option<Box<Mapper>>,
    /// Which sweeps of its keyframes are drawn, and where.
    drawn: Vec<Option<(Arc<Sweep>, Pose2)>>,
    map_from_odom: Pose2,
}

impl Team {
    /// Robots that share one map, or have one each.
    pub(super) fn new(settings: Option<&Settings>, starts: &[Pose2], one_map: bool) -> Result<Self, Failure> {
        let robot = |&start: &Pose2| -> Result<Robot, Failure> {
            let mapper = settings.map(|settings| Mapper::starting_at(*settings, start)).transpose()?;
            Ok(Robot { mapper: mapper.map(Box::new), drawn: Vec::new(), map_from_odom: start })
        };
        let maps = if one_map { 1 } else { starts.len() };
        Ok(Self {
            maps: vec![SharedMap::new(CELL_M, PASSES_PER_HIT); maps],
            robots: starts.iter().map(robot).collect::<Result<_, _>>()?,
            points: Points::default(),
        })
    }

    /// Takes in a robot's scan; whether it is part of the map.
    pub(super) fn add_scan(&mut self, number: usize, scan: &LaserScan, world_from_robot: Pose2) -> bool {
        let robot = &mut self.robots[number];
        let Some(mapper) = &mut robot.mapper else {
            let (sweep, _) = Sweep::from_scan(scan, [0.0; 3]);
            let own = number.min(self.maps.len() - 1);
            let Points { points, table } = &mut self.points;
            points.fill(&sweep, table, scan.laser.range_max_m);
            return self.maps[own].draw(points, world_from_robot, Change::Add);
        };
        let update = mapper.add_scan(scan);
        if let Some(odom_from_robot) = scan.odom_from_robot {
            robot.map_from_odom = update.map_from_robot * odom_from_robot.inverse();
        }
        let is_keyframe = update.keyframe.is_some();
        if is_keyframe {
            self.follow(number);
        }
        is_keyframe
    }

    /// Draws a robot's new keyframes and those that have moved.
    fn follow(&mut self, number: usize) {
        let own = number.min(self.maps.len() - 1);
        let Robot { mapper: Some(mapper), drawn, .. } = &mut self.robots[number] else { return };
        let session = mapper.session();
        let map = &mut self.maps[own];
        drawn.resize(session.drawn().len(), None);
        for ((sweep, &pose), drawn) in session.drawn().iter().zip(session.map_from_keyframe()).zip(drawn) {
            self.points.redraw(map, drawn, sweep.as_ref().map(|sweep| (sweep, pose)));
        }
    }

    /// Where a robot believes that it is.
    pub(super) fn map_from_robot(&self, number: usize, odom_from_robot: Pose2, world_from_robot: Pose2) -> Pose2 {
        let robot = &self.robots[number];
        if robot.mapper.is_some() { robot.map_from_odom * odom_from_robot } else { world_from_robot }
    }

    /// A robot's map as it is now.
    pub(super) fn map(&self, number: usize) -> &OccupancyMap {
        self.maps[number.min(self.maps.len() - 1)].map()
    }

    /// A robot is there.
    pub(super) fn stand(&mut self, number: usize, point_m: [f64; 2]) {
        let own = number.min(self.maps.len() - 1);
        self.maps[own].stand(point_m);
    }

    /// Something held a robot there, or a robot died there.
    pub(super) fn feel(&mut self, number: usize, point_m: [f64; 2], radius_m: f64, until_s: f64) {
        let own = number.min(self.maps.len() - 1);
        self.maps[own].feel(point_m, radius_m, until_s);
    }

    pub(super) fn forget(&mut self, now_s: f64) {
        self.maps.iter_mut().for_each(|map| map.forget(now_s));
    }

    /// How far the robots' keyframes lie from the truth in the team's frame, metres, rmse; none where poses are perfect.
    pub(super) fn error_m(&self, truth: &[Vec<(u64, Pose2)>]) -> Option<f64> {
        let (mut sum, mut count) = (0.0, 0_u32);
        for (robot, truth) in self.robots.iter().zip(truth) {
            let session = robot.mapper.as_ref()?.session();
            for (keyframe, pose) in session.keyframes().iter().zip(session.map_from_keyframe()) {
                let Ok(at) = truth.binary_search_by_key(&keyframe.scan, |(scan, _)| *scan) else { continue };
                sum += truth[at].1.distance(*pose).powi(2);
                count += 1;
            }
        }
        Some((sum / f64::from(count.max(1))).sqrt())
    }
}

/// What sweeps are drawn with.
#[derive(Default)]
pub(super) struct Points {
    points: SweepPoints,
    table: BeamTable,
}

impl Points {
    /// Draws a keyframe's sweep where it is wanted now, if that is elsewhere than where it is drawn.
    pub(super) fn redraw(
        &mut self,
        map: &mut SharedMap,
        drawn: &mut Option<(Arc<Sweep>, Pose2)>,
        wanted: Option<(&Arc<Sweep>, Pose2)>,
    ) {
        let is_drawn = match (&drawn, wanted) {
            (Some((before, at)), Some((sweep, pose))) => {
                let moved_m = at.distance(pose) + sweep.laser.range_max_m * at.between(pose).theta.abs();
                Arc::ptr_eq(before, sweep) && moved_m <= FOLLOW_M
            }
            (drawn, wanted) => drawn.is_none() && wanted.is_none(),
        };
        if is_drawn {
            return;
        }
        let wanted = wanted.map(|(sweep, pose)| (Arc::clone(sweep), pose));
        for (what, change) in [(drawn.take(), Change::Remove), (wanted, Change::Add)] {
            let Some((sweep, pose)) = what else { continue };
            self.points.fill(&sweep, &mut self.table, sweep.laser.range_max_m);
            if map.draw(&self.points, pose, change) && change == Change::Add {
                *drawn = Some((sweep, pose));
            }
        }
    }
}

/// Takes beams out that met a robot of the team.
pub(super) fn without_bodies(scan: &mut LaserScan, map_from_robot: Pose2, others_m: &[[f64; 2]], radius_m: f64) {
    let laser_from_map = (map_from_robot * scan.laser.robot_from_laser).inverse();
    let within_m = radius_m + BODY_MARGIN_M;
    for &other in others_m {
        let [x, y] = laser_from_map.transform(other);
        let away_m = x.hypot(y);
        let near = |range_m: f32| (f64::from(range_m) - away_m).abs() < within_m;
        for (beam, range_m) in scan.ranges_m.iter_mut().enumerate().filter(|(_, range_m)| near(**range_m)) {
            let bearing_rad = scan.laser.angle_min_rad + beam as f64 * scan.laser.angle_step_rad;
            let (sin, cos) = bearing_rad.sin_cos();
            if (f64::from(*range_m) * cos - x).hypot(f64::from(*range_m) * sin - y) < within_m {
                *range_m = f32::NAN;
            }
        }
    }
}
