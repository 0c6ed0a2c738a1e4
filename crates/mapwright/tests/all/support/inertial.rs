//! Simulated drives in space, mapped with and without an inertial sensor.

use mapwright::{Cloud, ImuReading, ImuReport, Pose3, Settings, SpaceMapper, Stamp, Status};
use mapwright_eval::{Alignment, RpeSettings, SpaceErrors, space_errors};
use mapwright_sim::RobotSettings;
use mapwright_sim::space::{ImuSettings, LidarSettings, SpaceDrive, SpaceDriveSettings, worlds};
use nalgebra::Vector3;
use std::sync::Arc;

/// A drive.
#[derive(Debug, Clone)]
pub(crate) struct Wanted {
    pub(crate) seed: u64,
    pub(crate) seconds: f64,
    /// Of so many clouds one is mapped.
    pub(crate) every: usize,
    pub(crate) turn_rate_rad_per_s: f64,
    pub(crate) imu: ImuSettings,
    pub(crate) beams: usize,
}

impl Default for Wanted {
    fn default() -> Self {
        Self { seed: 1, seconds: 30.0, every: 1, turn_rate_rad_per_s: 1.2, imu: ImuSettings::default(), beams: 16 }
    }
}

/// What the mapper is given besides clouds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Given {
    Nothing,
    Imu,
    Wheels,
    WheelsAndImu,
    /// A gyroscope without an accelerometer.
    TurnsOnly,
}

/// What came out.
#[derive(Debug, Clone)]
pub(crate) struct Found {
    pub(crate) mapper: SpaceMapper,
    pub(crate) errors: SpaceErrors,
    /// Clouds that were not tracked.
    pub(crate) untracked: usize,
    /// By how much predicted rotations from cloud to cloud differ from the true ones, of an inertial sensor those that it has told: median
    /// and worst, degrees.
    pub(crate) predicted_deg: [f64; 2],
    /// The largest true rotation between two clouds that were mapped, degrees.
    pub(crate) fastest_deg: f64,
    /// How far the map's down is from the true one: worst, and mean over the last fifth, degrees.
    pub(crate) lean_deg: [f64; 2],
    /// Error of the written directions of gravity, in standard deviations: root mean square per axis; and in degrees.
    pub(crate) gravity_sigmas: [f64; 2],
    pub(crate) report: ImuReport,
}

pub(crate) fn drive(wanted: &Wanted) -> SpaceDrive {
    let lidar = LidarSettings { columns: 360, ..LidarSettings::spinning(wanted.beams) };
    let usual = SpaceDriveSettings::default();
    let robot = RobotSettings { turn_rate_rad_per_s: wanted.turn_rate_rad_per_s, ..usual.robot.clone() };
    let settings = SpaceDriveSettings {
        lidar,
        robot,
        imu: wanted.imu.clone(),
        seed: wanted.seed,
        duration_s: wanted.seconds,
        ..usual
    };
    SpaceDrive::new(Arc::new(worlds::two_storey(wanted.seed)), settings)
}

/// Maps a drive: before each cloud what was read up to its end.
pub(crate) fn mapped(wanted: &Wanted, given: Given) -> Found {
    mapped_with(wanted, given, Settings::default(), |reading| vec![reading], |_| ())
}

pub(crate) fn mapped_with(
    wanted: &Wanted,
    given: Given,
    settings: Settings,
    handed_in: impl Fn(ImuReading) -> Vec<ImuReading>,
    change: impl Fn(&mut Cloud),
) -> Found {
    let drive = drive(wanted);
    let mut mapper = SpaceMapper::new(settings).unwrap();
    let mut readings = drive.imu_readings().peekable();
    let (mut truth, mut untracked) = (Vec::<(Stamp, Pose3)>::new(), 0);
    let (mut predicted, mut fastest) = (Vec::new(), 0.0_f64);
    let (mut last_odom, mut last_middle) = (None::<Pose3>, None::<Pose3>);
    let has_imu = matches!(given, Given::Imu | Given::WheelsAndImu | Given::TurnsOnly);
    for taken in drive.clouds().step_by(wanted.every) {
        let mut cloud = taken.cloud;
        let end = Stamp(cloud.stamp.0 + 100_000_000);
        while let Some(mut reading) = readings.next_if(|reading| reading.stamp <= end) {
            if given == Given::TurnsOnly {
                reading.specific_force_m_per_s2 = None;
            }
            if has_imu {
                for reading in handed_in(reading) {
                    mapper.add_imu(reading);
                }
            }
        }
        if !matches!(given, Given::Wheels | Given::WheelsAndImu) {
            cloud.odom_from_robot = None;
        }
        change(&mut cloud);
        let predicted_before = mapper.imu_report().predicted;
        let update = mapper.add_cloud(&cloud);
        let is_read = mapper.imu_report().predicted > predicted_before;
        untracked += usize::from(update.status != Status::Tracking);
        // predictions lead from the middle of one sweep to that of the next
        let middle = drive.world_from_robot(Stamp(cloud.stamp.0 + 50_000_000)).unwrap_or(taken.world_from_robot);
        let true_step = last_middle.map(|last| last.between(middle));
        last_middle = Some(middle);
        let step = last_odom.map(|last| last.between(update.odom_from_robot));
        if let Some((true_step, step)) = true_step.zip(step).filter(|_| is_read || !has_imu) {
            predicted.push(true_step.rotation.angle_to(&step.rotation).to_degrees());
            fastest = fastest.max(true_step.rotation.angle().to_degrees());
        }
        last_odom = Some(update.odom_from_robot);
        truth.push((cloud.stamp, taken.world_from_robot));
    }
    let way: Vec<(Stamp, Pose3)> =
        mapper.session().trajectory().map(|pose| (pose.stamp, pose.map_from_robot)).collect();
    let errors = space_errors(&truth, &way, Alignment::Rigid, &RpeSettings::default()).unwrap();
    predicted.sort_by(f64::total_cmp);
    let predicted_deg =
        [predicted.len() / 2, predicted.len().saturating_sub(1)].map(|k| predicted.get(k).copied().unwrap_or(0.0));
    let lean = |(truth, found): (&(Stamp, Pose3), &(Stamp, Pose3))| {
        let [a, b] = [truth.1, found.1].map(|pose| pose.rotation.inverse() * Vector3::z());
        a.angle(&b).to_degrees()
    };
    let lean: Vec<f64> = truth.iter().zip(&way).map(lean).collect();
    let last = &lean[lean.len() - lean.len() / 5..];
    let lean_deg = [lean.iter().copied().fold(0.0, f64::max), last.iter().sum::<f64>() / last.len() as f64];
    let gravity = mapper.session().gravity().iter().map(|known| {
        let keyframe = &mapper.session().keyframes()[mapper.session().place(known.keyframe).unwrap()];
        let middle = drive.world_from_robot(Stamp(keyframe.stamp.0 + 50_000_000)).unwrap();
        let error = middle.rotation.inverse() * -Vector3::z() - Vector3::from(known.down_in_keyframe);
        (error.norm_squared() / (2.0 * known.sigma_rad * known.sigma_rad), 0.5 * error.norm_squared())
    });
    let gravity: Vec<(f64, f64)> = gravity.collect();
    let mean = |of: fn(&(f64, f64)) -> f64| gravity.iter().map(of).sum::<f64>() / gravity.len().max(1) as f64;
    let gravity_sigmas = [mean(|g| g.0).sqrt(), mean(|g| g.1).sqrt().to_degrees()];
    let report = mapper.imu_report();
    Found { mapper, errors, untracked, predicted_deg, fastest_deg: fastest, lean_deg, gravity_sigmas, report }
}
