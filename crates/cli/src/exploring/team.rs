//! What robots know together: one map, and where each of them is in it.

use crate::failure::Failure;
use mapwright::{CountGrid, GlobalMap, LaserScan, Mapper, Pose2, Settings, Sweep};
use mapwright_explore::OccupancyMap;
use mapwright_grid::Change;
use mapwright_sensor::{BeamTable, SweepPoints};

/// Side of a cell of the map that ways are planned in, metres: a door of a metre leaves several cells to a robot.
const CELL_M: f64 = 0.1;
/// Hits within this of where a robot of the team says it is are its body, metres: what poses may be off.
const BODY_MARGIN_M: f64 = 0.2;

/// The robots' common map.
pub(super) enum Team {
    /// Every scan drawn where it was truly taken.
    Perfect { counts: CountGrid, points: Box<SweepPoints>, table: BeamTable, poses: Vec<Pose2> },
    /// Each robot maps by itself, from a known start in one frame; the team's map is all their keyframes.
    Mapped { robots: Vec<Mapped> },
}

/// A robot with its mapper.
pub(super) struct Mapped {
    pub(super) mapper: Box<Mapper>,
    map: GlobalMap,
    map_from_odom: Pose2,
}

impl Team {
    pub(super) fn perfect(starts: &[Pose2]) -> Self {
        let counts = CountGrid::new(CELL_M);
        Self::Perfect { counts, points: Box::default(), table: BeamTable::default(), poses: starts.to_vec() }
    }

    pub(super) fn mapped(settings: &Settings, starts: &[Pose2]) -> Result<Self, Failure> {
        let mut coarse = *settings;
        coarse.map.resolution_m = CELL_M;
        let robot = |&start: &Pose2| -> Result<Mapped, Failure> {
            let mapper = Box::new(Mapper::starting_at(*settings, start)?);
            Ok(Mapped { mapper, map: GlobalMap::without_normals(&coarse), map_from_odom: start })
        };
        let robots = starts.iter().map(robot).collect::<Result<Vec<_>, _>>()?;
        Ok(Self::Mapped { robots })
    }

    /// Takes in a robot's scan; whether it is part of the map.
    pub(super) fn add_scan(&mut self, number: usize, scan: &LaserScan, world_from_robot: Pose2) -> bool {
        match self {
            Self::Perfect { counts, points, table, poses } => {
                let (sweep, _) = Sweep::from_scan(scan, [0.0; 3]);
                points.fill(&sweep, table, scan.laser.range_max_m);
                points.normals.resize(points.hits.len(), [0.0; 2]);
                counts.draw(points, world_from_robot, Change::Add, &mut Vec::new());
                poses[number] = world_from_robot;
                true
            }
            Self::Mapped { robots } => {
                let robot = &mut robots[number];
                let update = robot.mapper.add_scan(scan);
                if let Some(odom_from_robot) = scan.odom_from_robot {
                    robot.map_from_odom = update.map_from_robot * odom_from_robot.inverse();
                }
                update.keyframe.is_some()
            }
        }
    }

    /// Where a robot believes that it is.
    pub(super) fn map_from_robot(&self, number: usize, odom_from_robot: Pose2, world_from_robot: Pose2) -> Pose2 {
        match self {
            Self::Perfect { .. } => world_from_robot,
            Self::Mapped { robots } => robots[number].map_from_odom * odom_from_robot,
        }
    }

    /// The common map as it is now.
    pub(super) fn map(&mut self, passes_per_hit: u32) -> Option<OccupancyMap> {
        match self {
            Self::Perfect { counts, .. } => OccupancyMap::of_counts(&[counts], passes_per_hit),
            Self::Mapped { robots } => {
                robots.iter_mut().for_each(|robot| {
                    robot.map.follow(robot.mapper.session(), 1);
                });
                let maps: Vec<&CountGrid> = robots.iter().map(|robot| robot.map.counts()).collect();
                OccupancyMap::of_counts(&maps, passes_per_hit)
            }
        }
    }

    /// How far the robots' keyframes lie from the truth in the team's frame, metres, rmse; none where poses are perfect.
    pub(super) fn error_m(&self, truth: &[Vec<(u64, Pose2)>]) -> Option<f64> {
        let Self::Mapped { robots } = self else { return None };
        let (mut sum, mut count) = (0.0, 0_u32);
        for (robot, truth) in robots.iter().zip(truth) {
            let session = robot.mapper.session();
            for (keyframe, pose) in session.keyframes().iter().zip(session.map_from_keyframe()) {
                let Ok(at) = truth.binary_search_by_key(&keyframe.scan, |(scan, _)| *scan) else { continue };
                sum += truth[at].1.distance(*pose).powi(2);
                count += 1;
            }
        }
        Some((sum / f64::from(count.max(1))).sqrt())
    }
}

/// Takes beams out that met a robot of the team.
pub(super) fn without_bodies(scan: &mut LaserScan, map_from_robot: Pose2, others_m: &[[f64; 2]], radius_m: f64) {
    let map_from_laser = map_from_robot * scan.laser.robot_from_laser;
    let laser_from_map = map_from_laser.inverse();
    for &other in others_m {
        let [x, y] = laser_from_map.transform(other);
        let away_m = x.hypot(y);
        let within_m = radius_m + BODY_MARGIN_M;
        if away_m > scan.laser.range_max_m + within_m {
            continue;
        }
        let scale = scan.laser.angle_step_rad;
        for beam in 0..scan.ranges_m.len() {
            let bearing_rad = scan.laser.angle_min_rad + beam as f64 * scale;
            let (sin, cos) = bearing_rad.sin_cos();
            let range_m = f64::from(scan.ranges_m[beam]);
            if (range_m * cos - x).hypot(range_m * sin - y) < within_m {
                scan.ranges_m[beam] = f32::NAN;
            }
        }
    }
}
