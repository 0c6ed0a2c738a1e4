//! A simulated drive as a source of clouds, and how far what is made of it lies from the truth.

use crate::failure::Failure;
use crate::output::OutputFolder;
use crate::simulated::{Simulated, Taken};
use mapwright::{Cloud, EdgeKind, ImuReading, Pose3, Session, SpaceSweep, Stamp};
use mapwright_clouds::{StereoDepth, StereoPairPlan};
use mapwright_eval::ErrorStats;
use mapwright_formats::{StampedPose3, TumWriter};
use mapwright_sensor::{PinholeCamera, SpaceSensor};
use mapwright_sim::space::{SpaceDrive, StereoSettings, TrueCloud, TrueDepthImage, TrueStereoPair};
use mapwright_stereo::{GreyImage, StereoCamera, StereoError};
use serde_json::{Value, json};
use std::sync::Arc;

/// A drive, of which every so many-th cloud is mapped.
pub(crate) struct Simulation {
    drive: SpaceDrive,
    eye: Eye,
    every: usize,
    next: u64,
    /// The next reading of the inertial sensor, where the robot has one.
    next_reading: Option<u64>,
    taken: Vec<Taken<Pose3>>,
}

/// What the robot sees by.
enum Eye {
    Lidar,
    /// With the directions of all pixels.
    Depth(Vec<[f32; 2]>),
    Stereo(Box<StereoEye>),
}

/// A stereo camera, and the images of its last pair.
struct StereoEye {
    depth: StereoDepth,
    sensor: Arc<SpaceSensor>,
    images: [GreyImage; 2],
}

impl Simulation {
    pub(crate) fn of(drive: SpaceDrive, every: usize) -> Self {
        Self::by(drive, Eye::Lidar, every)
    }

    /// By its depth camera.
    pub(crate) fn of_depth(drive: SpaceDrive, every: usize) -> Self {
        let directions = drive.depth_camera().camera.directions();
        Self::by(drive, Eye::Depth(directions), every)
    }

    /// By its stereo camera.
    pub(crate) fn of_stereo(drive: SpaceDrive, every: usize) -> Result<Self, StereoError> {
        let StereoSettings { camera, baseline_m, robot_from_left, .. } = drive.stereo_camera();
        let PinholeCamera { width, height, focal_px: [fx, fy], centre_px: [cx, cy], .. } = **camera;
        let pair = StereoCamera { width, height, fx, fy, cx, cx_right: cx, cy, baseline_m: *baseline_m };
        let depth = StereoDepth::new(&StereoPairPlan::Rectified(pair), None)?;
        let sensor = SpaceSensor { robot_from_sensor: *robot_from_left, ..depth.sensor("simulated") };
        let eye = StereoEye { depth, sensor: Arc::new(sensor), images: Default::default() };
        Ok(Self::by(drive, Eye::Stereo(Box::new(eye)), every))
    }

    fn by(drive: SpaceDrive, eye: Eye, every: usize) -> Self {
        Self { drive, eye, every: every.max(1), next: 0, next_reading: None, taken: Vec::new() }
    }

    /// The same with an inertial sensor.
    pub(crate) fn with_imu(self) -> Self {
        Self { next_reading: Some(0), ..self }
    }

    pub(super) fn imu_name(&self) -> Option<&'static str> {
        self.next_reading.map(|_| "the simulated inertial sensor")
    }

    /// The next cloud; what was read up to the end of its sweep is handed to `feel` before.
    pub(super) fn next_cloud(&mut self, feel: &mut dyn FnMut(ImuReading)) -> Result<Option<Cloud>, Failure> {
        let Some(taken) = self.look()? else { return Ok(None) };
        let sweep_s = if matches!(self.eye, Eye::Lidar) { 1.0 / self.rate_hz() } else { 0.0 };
        let end = Stamp(taken.cloud.stamp.0 + Stamp::from_secs_f64(sweep_s).0);
        while let Some(number) = &mut self.next_reading
            && let Some(reading) = self.drive.imu_reading(*number).filter(|reading| reading.stamp <= end)
        {
            *number += 1;
            feel(reading);
        }
        self.next += self.every as u64;
        self.taken.push(Taken::of_cloud(&self.drive, &taken, &self.taken));
        Ok(Some(taken.cloud))
    }

    /// The truth is that of so many clouds; more were read than mapped.
    pub(super) fn forget_after(&mut self, clouds: usize) {
        self.taken.truncate(clouds);
    }

    #[cfg(test)]
    pub(super) fn clouds_taken(&self) -> usize {
        self.taken.len()
    }

    fn look(&mut self) -> Result<Option<TrueCloud>, Failure> {
        match &mut self.eye {
            Eye::Lidar => Ok(self.drive.cloud(self.next)),
            Eye::Depth(directions) => {
                let Some(taken) = self.drive.depth_image(self.next) else { return Ok(None) };
                let TrueDepthImage { image, odom_from_robot, world_from_robot } = taken;
                let cloud = image.to_cloud(&self.drive.depth_camera().sensor, directions);
                let cloud = cloud.map_err(|reason| Failure::Log(format!("the simulated camera: {reason}")))?;
                let cloud = Cloud { odom_from_robot: Some(odom_from_robot), ..cloud };
                Ok(Some(TrueCloud { cloud, world_from_robot }))
            }
            Eye::Stereo(eye) => {
                let Some(taken) = self.drive.stereo_pair(self.next) else { return Ok(None) };
                let PinholeCamera { width, height, .. } = *self.drive.stereo_camera().camera;
                let cloud = eye.cloud(&taken, [width, height]);
                let cloud = cloud.map_err(|cause| Failure::Log(format!("the simulated cameras: {cause}")))?;
                let cloud = Cloud { odom_from_robot: Some(taken.odom_from_robot), ..cloud };
                Ok(Some(TrueCloud { cloud, world_from_robot: taken.world_from_robot }))
            }
        }
    }

    pub(super) fn sensor(&self) -> &SpaceSensor {
        match &self.eye {
            Eye::Lidar => &self.drive.lidar().sensor,
            Eye::Depth(_) => &self.drive.depth_camera().sensor,
            Eye::Stereo(eye) => &eye.sensor,
        }
    }

    fn rate_hz(&self) -> f64 {
        match &self.eye {
            Eye::Lidar => self.drive.lidar().rate_hz,
            Eye::Depth(_) => self.drive.depth_camera().rate_hz,
            Eye::Stereo(_) => self.drive.stereo_camera().rate_hz,
        }
    }

    /// How many clouds there are, about.
    pub(super) fn frames(&self) -> u64 {
        (self.drive.duration_s() * self.rate_hz()) as u64 / self.every as u64
    }

    pub(super) fn kind(&self) -> String {
        let of = |camera: &PinholeCamera| format!("{} x {} pixels", camera.width, camera.height);
        match &self.eye {
            Eye::Lidar => {
                format!("clouds of a simulated lidar of {} beams", self.drive.lidar().elevations_rad.len())
            }
            Eye::Depth(_) => format!("images of a simulated depth camera of {}", of(&self.drive.depth_camera().camera)),
            Eye::Stereo(_) => {
                let StereoSettings { camera, baseline_m, .. } = self.drive.stereo_camera();
                format!("pairs of a simulated stereo camera of {}, {baseline_m} m apart", of(camera))
            }
        }
    }

    /// Writes the true trajectory, and measures what was made of it.
    pub(super) fn judge(
        &self,
        output: &mut OutputFolder,
        session: &Session<SpaceSweep>,
    ) -> Result<AgainstTruth, Failure> {
        output.write("truth.tum", |writer| {
            let mut trajectory = TumWriter::new(writer);
            let poses = self.taken.iter().map(|taken| StampedPose3::of_pose(taken.stamp, taken.world_from_robot));
            poses.into_iter().try_for_each(|pose| trajectory.write(&pose))?;
            trajectory.finish().map(|_| ())
        })?;
        AgainstTruth::of(&Simulated::of(session.clone(), self.taken.clone()))
            .map_err(|cause| Failure::Score { path: output.path("trajectory.tum"), cause })
    }
}

impl StereoEye {
    fn cloud(&mut self, taken: &TrueStereoPair, [width, height]: [u32; 2]) -> Result<Cloud, StereoError> {
        let [left, right] = &mut self.images;
        left.set_grey8(width, height, &taken.left)?;
        right.set_grey8(width, height, &taken.right)?;
        let colours = taken.left.iter().map(|value| [*value; 3]).collect();
        self.depth.cloud((left, right), (taken.stamp, &self.sensor), colours)
    }
}

/// A trajectory and its closures against the truth.
#[derive(Debug, Clone)]
pub(super) struct AgainstTruth {
    absolute_m: ErrorStats,
    /// Closures, and all edges that close, each with the number of those that are wrong.
    closures: [usize; 2],
    closings: [usize; 2],
}

impl AgainstTruth {
    fn of(world: &Simulated<SpaceSweep>) -> Result<Self, mapwright_eval::EvalError> {
        let closings = world.closings();
        let count = |is_counted: &dyn Fn(EdgeKind) -> bool| {
            let counted = || closings.iter().filter(|closing| is_counted(closing.kind));
            [counted().count(), counted().filter(|closing| !closing.is_right()).count()]
        };
        let (closures, all) = (count(&|kind| kind == EdgeKind::Closure), count(&|_| true));
        Ok(Self { absolute_m: world.trajectory_ate()?, closures, closings: all })
    }

    pub(super) fn to_words(&self) -> String {
        let Self { absolute_m, closures, closings } = self;
        format!(
            "truth    ATE rmse {:.3} m, at most {:.3} m; {} of {} closures are wrong, {} of {} edges that close\n",
            absolute_m.rmse, absolute_m.max, closures[1], closures[0], closings[1], closings[0]
        )
    }

    pub(super) fn to_json(&self) -> Value {
        json!({
            "ate_rmse_m": self.absolute_m.rmse,
            "ate_max_m": self.absolute_m.max,
            "closures": self.closures[0],
            "wrong_closures": self.closures[1],
            "closings": self.closings[0],
            "wrong_closings": self.closings[1],
        })
    }
}
