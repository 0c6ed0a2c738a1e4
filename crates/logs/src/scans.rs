//! Scans out of messages.

use crate::channel::Messages;
use crate::plan::{Mount, Plan};
use crate::problem::Problem;
use mapwright_formats::OddHeads;
use mapwright_geom::{Pose2, Pose3, Stamp};
use mapwright_ros::messages::{LaserScan, PointCloud2};
use mapwright_ros::{Cloud, Mounting, PlanarSlice, RosError, SliceCounts};
use mapwright_sensor::{LaserModel, LaserScan as SensorScan, SonarReading, SonarRing};
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Points that were taken longer after or before their cloud's stamp say nothing of its sweep, seconds.
const LONGEST_SWEEP_S: f32 = 10.0;

/// A scan that waits for its turn.
#[derive(Debug)]
pub(crate) struct Taken {
    pub(crate) scan: SensorScan,
    /// Which of the plan's lasers took it, from 0.
    pub(crate) laser: usize,
    /// Points of the slice in the robot's frame at their times, where a cloud says these; the scan is then empty.
    pub(crate) points: Vec<TimedPoint>,
}

/// A point and its time after the scan's stamp, metres and seconds.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TimedPoint {
    place: [f32; 3],
    time_s: f32,
}

impl From<SensorScan> for Taken {
    fn from(scan: SensorScan) -> Self {
        Self { scan, laser: 0, points: Vec::new() }
    }
}

impl Taken {
    /// The first and the last time at which a beam or a point was taken.
    pub(crate) fn span(&self) -> (Stamp, Stamp) {
        let (mut first_s, mut last_s) = (0.0_f32, 0.0_f32);
        for point in self.points.iter().filter(|point| point.time_s.abs() <= LONGEST_SWEEP_S) {
            (first_s, last_s) = (first_s.min(point.time_s), last_s.max(point.time_s));
        }
        let at = |s: f32| Stamp(self.scan.stamp.0.saturating_add(Stamp::from_secs_f64(f64::from(s)).0));
        (at(first_s), at(last_s).max(end_of(&self.scan)))
    }

    /// Bytes held beside the value itself.
    pub(crate) fn held_bytes(&self) -> usize {
        self.scan.ranges_m.capacity() * size_of::<f32>() + self.points.capacity() * size_of::<TimedPoint>()
    }
}

/// When a scan is there: at the end of its sweep, so that what the wheels did during it is known; at its stamp where the
/// beams' times are not known.
pub(crate) fn end_of(scan: &SensorScan) -> Stamp {
    let sweep_s = scan.laser.beam_period_s * scan.ranges_m.len() as f64;
    // at most what a scan may take at all; a NaN is none
    let sweep_s = if sweep_s > 0.0 { sweep_s.min(10.0) } else { 0.0 };
    Stamp(scan.stamp.0.saturating_add(Stamp::from_secs_f64(sweep_s).0))
}

/// Makes scans of messages; lasers are shared by the scans they took.
#[derive(Debug)]
pub(crate) struct ScanMaker {
    mounts: BTreeMap<String, Mount>,
    slice: PlanarSlice,
    lasers: BTreeMap<String, Arc<LaserModel>>,
    /// How long a unit of the times of clouds' points lasts, seconds; none where they are left out.
    time_unit_s: Option<f64>,
    pub(crate) counts: SliceCounts,
    /// What is odd about heads of scans.
    pub(crate) odd_heads: OddHeads,
}

impl ScanMaker {
    pub(crate) fn new(plan: &Plan) -> Self {
        let slice = plan.slice.map_or_else(PlanarSlice::default, |bounds| bounds.planar());
        Self {
            mounts: plan.mounts.clone(),
            slice,
            lasers: BTreeMap::new(),
            time_unit_s: plan.times.unit_s(),
            counts: SliceCounts::default(),
            odd_heads: OddHeads::default(),
        }
    }

    /// The scan of a message, which is the recording's at that place; its stamp is that of the header.
    pub(crate) fn scan(&mut self, messages: &mut Messages, data: &[u8], place: u64) -> Result<Taken, Problem> {
        match messages {
            Messages::Scan(decoder) => Ok(self.planar(&decoder.decode(data).map_err(undecodable)?, place)?.into()),
            Messages::MultiEcho(decoder) => {
                let scan = decoder.decode(data).map_err(undecodable)?;
                let first = scan.first_echoes();
                Ok(self.planar(&scan.with_ranges(&first), place)?.into())
            }
            Messages::Cloud(decoder) => self.cloud(&decoder.decode(data).map_err(undecodable)?),
            Messages::None(Some(reason)) => Err(Problem::Undecodable(reason.clone())),
            _ => Err(Problem::Undecodable("no scans".to_owned())),
        }
    }

    fn mount(&self, frame: &str) -> Result<Mount, Problem> {
        let found = self.mounts.get(frame).copied();
        found.ok_or_else(|| Problem::Unusable(format!("nothing says where '{frame}' sits on the robot")))
    }

    fn planar(&mut self, scan: &LaserScan<'_>, place: u64) -> Result<SensorScan, Problem> {
        if scan.ranges.is_empty() {
            return Err(Problem::Unusable(format!("a scan of `{}` with 0 beams", scan.header.frame())));
        }
        let mounting = match self.mount(scan.header.frame())? {
            Mount::Planar(mounting) => mounting,
            Mount::Space(_) => Mounting::IDENTITY,
        };
        let (laser, odd) = scan.laser(&mounting).map_err(unusable)?;
        odd.into_iter().for_each(|odd| self.odd_heads.note(place, odd));
        Ok(scan.to_sensor(self.shared(laser)))
    }

    fn cloud(&mut self, message: &PointCloud2<'_>) -> Result<Taken, Problem> {
        let robot_from_sensor = match self.mount(message.header.frame())? {
            Mount::Space(pose) => pose,
            Mount::Planar(_) => Pose3::identity(),
        };
        let cloud = Cloud::new(message).map_err(unusable)?;
        let at = robot_from_sensor.translation;
        let laser = self.shared(self.slice.laser(message.header.frame(), [at.x, at.y]));
        let stamp = message.header.stamp;
        let in_robot = |place: [f64; 3]| -> [f64; 3] { robot_from_sensor.transform(Vector3::from(place)).into() };
        let Some(time_unit_s) = self.time_unit_s.filter(|_| cloud.time().is_some()) else {
            return Ok(self.sliced(stamp, laser, cloud.positions().map(in_robot)).into());
        };
        let heights = self.slice.z_min_m..=self.slice.z_max_m;
        let mut points = Vec::new();
        for point in cloud.points() {
            let place = in_robot(point.position);
            if heights.contains(&place[2]) {
                points.push(TimedPoint {
                    place: place.map(|part| part as f32),
                    time_s: (time_unit_s * point.time_s) as f32,
                });
            } else {
                self.counts.outside += 1;
            }
        }
        let scan = SensorScan { stamp, laser, ranges_m: Vec::new(), odom_from_robot: None };
        Ok(Taken { scan, laser: 0, points })
    }

    /// The scan, with the motion undone that the robot made between its stamp and each point, given its twist per second.
    pub(crate) fn finish(&mut self, taken: Taken, twist_per_s: Option<[f64; 3]>) -> SensorScan {
        let Taken { scan, points, .. } = taken;
        if !scan.ranges_m.is_empty() {
            return scan;
        }
        let twist = twist_per_s.unwrap_or([0.0; 3]);
        let points = points.iter().map(|point| {
            let [x, y, z] = point.place.map(f64::from);
            let stamp_from_then = Pose2::exp(twist.map(|rate| rate * f64::from(point.time_s)));
            let [x, y] = stamp_from_then.transform([x, y]);
            [x, y, z]
        });
        self.sliced(scan.stamp, scan.laser, points)
    }

    fn sliced(&mut self, stamp: Stamp, laser: Arc<LaserModel>, points: impl Iterator<Item = [f64; 3]>) -> SensorScan {
        let (scan, counts) = self.slice.scan(stamp, laser, points);
        self.counts.used += counts.used;
        self.counts.outside += counts.outside + counts.invalid;
        scan
    }

    /// The laser as it is known already, where it is the same.
    fn shared(&mut self, laser: LaserModel) -> Arc<LaserModel> {
        match self.lasers.get(&laser.name) {
            Some(known) if **known == laser => Arc::clone(known),
            _ => {
                let made = Arc::new(laser);
                self.lasers.insert(made.name.clone(), Arc::clone(&made));
                made
            }
        }
    }
}

/// A scan that holds a place until the first one comes.
pub(crate) fn no_scan() -> SensorScan {
    let laser = Arc::new(LaserModel::half_circle("", 1));
    SensorScan { stamp: Stamp(0), laser, ranges_m: Vec::new(), odom_from_robot: None }
}

/// Readings of sonars that hold a place until the first ones come.
pub(crate) fn no_sonar() -> SonarReading {
    let ring = Arc::new(SonarRing { name: String::new(), sonars: Vec::new() });
    SonarReading { stamp: Stamp(0), ring, ranges_m: Vec::new(), odom_from_robot: None }
}

fn undecodable(error: RosError) -> Problem {
    Problem::Undecodable(error.to_string())
}

fn unusable(error: RosError) -> Problem {
    Problem::Unusable(error.to_string())
}
