//! Scans out of messages.

use crate::channel::Messages;
use crate::plan::{Mount, Plan};
use mapwright_geom::{Pose3, Stamp};
use mapwright_ros::messages::{LaserScan, PointCloud2};
use mapwright_ros::{Cloud, Mounting, PlanarSlice, RosError, SliceCounts};
use mapwright_sensor::{LaserModel, LaserScan as SensorScan};
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Why a message is no scan.
#[derive(Debug)]
pub(crate) enum Problem {
    Undecodable(String),
    Unusable(String),
}

/// Makes scans of messages; lasers are shared by the scans they took.
#[derive(Debug)]
pub(crate) struct ScanMaker {
    mounts: BTreeMap<String, Mount>,
    slice: PlanarSlice,
    lasers: BTreeMap<String, Arc<LaserModel>>,
    pub(crate) counts: SliceCounts,
}

impl ScanMaker {
    pub(crate) fn new(plan: &Plan) -> Self {
        let slice = plan.slice.map_or_else(PlanarSlice::default, |bounds| bounds.planar());
        Self { mounts: plan.mounts.clone(), slice, lasers: BTreeMap::new(), counts: SliceCounts::default() }
    }

    /// The scan; its stamp is that of the header.
    pub(crate) fn scan(&mut self, messages: &mut Messages, data: &[u8]) -> Result<SensorScan, Problem> {
        match messages {
            Messages::Scan(decoder) => self.planar(&decoder.decode(data).map_err(undecodable)?),
            Messages::MultiEcho(decoder) => {
                let scan = decoder.decode(data).map_err(undecodable)?;
                let first = scan.first_echoes();
                self.planar(&scan.with_ranges(&first))
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

    fn planar(&mut self, scan: &LaserScan<'_>) -> Result<SensorScan, Problem> {
        let mounting = match self.mount(scan.header.frame())? {
            Mount::Planar(mounting) => mounting,
            Mount::Space(_) => Mounting::IDENTITY,
        };
        let laser = scan.laser(&mounting).map_err(unusable)?;
        Ok(scan.to_sensor(self.shared(laser)))
    }

    fn cloud(&mut self, message: &PointCloud2<'_>) -> Result<SensorScan, Problem> {
        let robot_from_sensor = match self.mount(message.header.frame())? {
            Mount::Space(pose) => pose,
            Mount::Planar(_) => Pose3::identity(),
        };
        let cloud = Cloud::new(message).map_err(unusable)?;
        let at = robot_from_sensor.translation;
        let laser = self.shared(self.slice.laser(message.header.frame(), [at.x, at.y]));
        let points = cloud.positions().map(|point| robot_from_sensor.transform(Vector3::from(point)).into());
        let (scan, counts) = self.slice.scan(message.header.stamp, laser, points);
        self.counts.used += counts.used;
        self.counts.outside += counts.outside + counts.invalid;
        Ok(scan)
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

fn undecodable(error: RosError) -> Problem {
    Problem::Undecodable(error.to_string())
}

fn unusable(error: RosError) -> Problem {
    Problem::Unusable(error.to_string())
}
