//! A simulated drive as a source of clouds, and how far what is made of it lies from the truth.

use crate::failure::Failure;
use crate::output::OutputFolder;
use crate::simulated::{Simulated, Taken};
use mapwright::{Cloud, EdgeKind, ImuReading, Pose3, Session, SpaceSweep, Stamp};
use mapwright_eval::ErrorStats;
use mapwright_formats::{StampedPose3, TumWriter};
use mapwright_sim::space::SpaceDrive;
use serde_json::{Value, json};

/// A drive, of which every so many-th cloud is mapped.
pub(crate) struct Simulation {
    drive: SpaceDrive,
    every: usize,
    next: u64,
    /// The next reading of the inertial sensor, where the robot has one.
    next_reading: Option<u64>,
    taken: Vec<Taken<Pose3>>,
}

impl Simulation {
    pub(crate) fn of(drive: SpaceDrive, every: usize) -> Self {
        Self { drive, every: every.max(1), next: 0, next_reading: None, taken: Vec::new() }
    }

    /// The same with an inertial sensor.
    pub(crate) fn with_imu(self) -> Self {
        Self { next_reading: Some(0), ..self }
    }

    pub(super) fn imu_name(&self) -> Option<&'static str> {
        self.next_reading.map(|_| "the simulated inertial sensor")
    }

    /// The next cloud; what was read up to the end of its sweep is handed to `feel` before.
    pub(super) fn next_cloud(&mut self, feel: &mut dyn FnMut(ImuReading)) -> Option<Cloud> {
        let taken = self.drive.cloud(self.next)?;
        let end = Stamp(taken.cloud.stamp.0 + Stamp::from_secs_f64(1.0 / self.drive.lidar().rate_hz).0);
        while let Some(number) = &mut self.next_reading
            && let Some(reading) = self.drive.imu_reading(*number).filter(|reading| reading.stamp <= end)
        {
            *number += 1;
            feel(reading);
        }
        self.next += self.every as u64;
        self.taken.push(Taken::of_cloud(&self.drive, &taken, &self.taken));
        Some(taken.cloud)
    }

    pub(super) fn drive(&self) -> &SpaceDrive {
        &self.drive
    }

    /// How many clouds there are, about.
    pub(super) fn frames(&self) -> u64 {
        (self.drive.duration_s() * self.drive.lidar().rate_hz) as u64 / self.every as u64
    }

    pub(super) fn kind(&self) -> String {
        format!("clouds of a simulated lidar of {} beams", self.drive.lidar().elevations_rad.len())
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
