//! `mapwright calibrate` of a recording of clouds: how the inertial sensor sits and by how much its stamps are late, where the lidar sits and
//! what the wheels get wrong.
//!
//! Clouds are mapped without the inertial readings first, and what matches say is compared with these: matches that know them agree with
//! them, however they were taken to sit. Matches are drawn to where the wheels would have the lidar, too: so clouds are mapped once more, with
//! the lidar where it was found, and with the readings, by which turns are found that matches alone have lost. Wheels drive in the plane of
//! the robot: motions of the lidar and of odometry are seen from above on the robot, and calibrated as those of a planar laser.

mod said;

use super::Source;
use super::merge::with_source;
use crate::args::{CalibrateArgs, SourceArgs};
use crate::calibrated::Calibrated;
use crate::calibration::{Calibration, Sample};
use crate::failure::{Failure, Outcome};
use crate::interrupt::Interrupt;
use crate::progress::Progress;
use crate::settings;
use crate::terminal::{say, say_json};
use mapwright::{Cloud, Pose2, Pose3, SpaceMapper, SpaceReading, Status};
use mapwright_logs::{ImuCalibrator, ImuFit, ImuSource, OdometrySource};
use nalgebra::{UnitQuaternion, Vector3};
use std::fs;

/// Calibrates the sensors of a recording of clouds.
pub(crate) fn calibrate(args: &CalibrateArgs, interrupt: &Interrupt) -> Result<Outcome, Failure> {
    let name = args.log.display().to_string();
    let first = pass(args, &args.source, false, interrupt)?;
    let (mut found, told, outcome) = (first.found(), first.told, first.outcome);
    let is_more_to_find = found.imu.is_err() && told.imu.is_some() || found.wheels.is_ok();
    if is_more_to_find && !interrupt.came() {
        let second = pass(args, &args.source.calibrated(found.calibrated(false)), true, interrupt)?.found();
        if !interrupt.came() {
            found = Found { imu: found.imu.or(second.imu), wheels: second.wheels.or(found.wheels) };
        }
    }
    if let Some(reason) = found.nothing() {
        return Err(Failure::NotCalibrated { name, reason });
    }
    if let Some(path) = &args.apply {
        let text = found.calibrated(true).to_text(&name);
        fs::write(path, text).map_err(|cause| Failure::write(path, cause))?;
    }
    if args.voice.json {
        say_json(&said::to_json(&name, &found, &told))?;
    } else if !args.voice.quiet {
        say(&said::to_words(&name, &found, &told))?;
    }
    Ok(outcome)
}

/// What a recording says, or what is presumed, of its sensors.
#[derive(Debug, Clone)]
struct Told {
    imu: Option<ImuSource>,
    robot_from_sensor: Pose3,
    has_odometry: bool,
}

impl Told {
    /// Where the lidar sits in the robot's plane.
    fn planar(&self) -> Pose2 {
        let (_, _, yaw) = self.robot_from_sensor.rotation.euler_angles();
        Pose2::new(self.robot_from_sensor.translation.x, self.robot_from_sensor.translation.y, yaw)
    }
}

/// How the inertial sensor was found to sit, beside what was told when that was found.
#[derive(Debug, Clone)]
struct FoundImu {
    fit: ImuFit,
    told: ImuSource,
}

impl FoundImu {
    /// By how much its stamps are late in all, seconds.
    fn lag_s(&self) -> f64 {
        self.told.lag_s + self.fit.lag_s
    }
}

/// What was found, or why it was not.
#[derive(Debug, Clone)]
struct Found {
    imu: Result<FoundImu, String>,
    wheels: Result<Calibration, String>,
}

impl Found {
    /// Why nothing was found at all.
    fn nothing(&self) -> Option<String> {
        let imu = match &self.imu {
            Ok(imu) if imu.fit.knows_rotation() || imu.fit.knows_lag() => return None,
            Ok(_) => "the motion tells neither how it sits nor by how much it is late",
            Err(why) => why,
        };
        let Err(wheels) = &self.wheels else { return None };
        Some(format!("there is nothing to calibrate: inertial sensor: {imu}; lidar on the wheels: {wheels}"))
    }

    /// As a file has it: what the motion tells.
    fn calibrated(&self, with_odometry: bool) -> Calibrated {
        let of_wheels = self.wheels.as_ref().ok().map(|wheels| (Calibrated::lidar(wheels), wheels));
        let wheels = of_wheels.map(|(lidar, wheels)| if with_odometry { lidar.with_odometry(wheels) } else { lidar });
        let wheels = wheels.unwrap_or_default();
        let Ok(imu) = &self.imu else { return wheels };
        let robot_from_imu = imu.fit.knows_rotation().then(|| imu.fit.robot_from_told * imu.told.robot_from_imu);
        wheels.with_imu(robot_from_imu, imu.fit.knows_lag().then(|| imu.lag_s()))
    }
}

/// A recording that was read once.
struct Pass {
    collector: Collector,
    told: Told,
    outcome: Outcome,
}

impl Pass {
    fn found(&self) -> Found {
        let imu = match &self.told.imu {
            Some(told) => self.collector.inertial.fit().map(|fit| FoundImu { fit, told: told.clone() }),
            None => Err("the recording has none that can be used".to_owned()),
        };
        let wheels = match self.told.has_odometry {
            true => crate::calibration::calibrate(&self.collector.runs, self.told.planar()),
            false => Err("the recording has no odometry".to_owned()),
        };
        Found { imu, wheels }
    }
}

/// Maps the recording, with the inertial readings or without.
fn pass(args: &CalibrateArgs, source: &SourceArgs, feels: bool, interrupt: &Interrupt) -> Result<Pass, Failure> {
    let quiet = args.voice.quiet || args.voice.json;
    with_source(&args.log, source, interrupt, |mut source: Source<'_>| {
        let Some(plan) = source.plan() else {
            let why = "calibrate: expected a recording of messages (ROS bag, MCAP) or of a planar laser, found files of clouds, which say nothing \
                       of other sensors";
            return Err(Failure::Usage(why.to_owned()));
        };
        let told = Told {
            imu: plan.imu.clone(),
            robot_from_sensor: plan.sensor.robot_from_sensor,
            has_odometry: plan.odometry != OdometrySource::None,
        };
        let mapper = SpaceMapper::new(settings::load(&args.settings)?)?;
        let mut collector = Collector::new(mapper, feels, told.planar());
        let mut progress = Progress::new(Some(source.frames()), quiet);
        let (mut readings, mut clouds) = (Vec::new(), 0);
        while let Some(cloud) = source.next_cloud(&mut |reading| readings.push(reading))? {
            collector.add(&mut readings, &cloud);
            clouds += 1;
            progress.scan(cloud.stamp, clouds);
            if interrupt.came() {
                break;
            }
        }
        progress.finish();
        let read = source.read();
        let (lost, _) = super::notes_in_words(&read.notes);
        let outcome = Outcome::of_losses(&[read.losses, lost].concat());
        Ok(Pass { collector, told, outcome })
    })
}

/// Poses of tracked clouds, in runs without a break.
struct Collector {
    mapper: SpaceMapper,
    feels: bool,
    inertial: ImuCalibrator,
    robot_from_level: Pose3,
    runs: Vec<Vec<Sample>>,
    /// The last tracked cloud by odometry and by the match.
    last: Option<[Pose3; 2]>,
}

impl Collector {
    fn new(mapper: SpaceMapper, feels: bool, robot_from_sensor: Pose2) -> Self {
        Self {
            mapper,
            feels,
            inertial: ImuCalibrator::default(),
            robot_from_level: in_plane(robot_from_sensor),
            runs: Vec::new(),
            last: None,
        }
    }

    fn add(&mut self, readings: &mut Vec<SpaceReading>, cloud: &Cloud) {
        for reading in readings.drain(..) {
            let SpaceReading::Imu(felt) = reading else {
                self.mapper.add_reading(reading);
                continue;
            };
            self.inertial.add_reading(felt);
            if self.feels {
                self.mapper.add_imu(felt);
            }
        }
        let update = self.mapper.add_cloud(cloud);
        if update.status != Status::Tracking {
            self.inertial.break_off();
            self.last = None;
            return;
        }
        let (middle, local_from_robot) = self.mapper.middle_of_sweep(cloud);
        self.inertial.add_pose(middle, local_from_robot.rotation);
        let Some(odom_from_robot) = cloud.odom_from_robot else {
            self.last = None;
            return;
        };
        let now = [odom_from_robot, update.map_from_robot * self.robot_from_level];
        let steps = self.last.replace(now).map(|[odom, map]| [odom.between(now[0]), map.between(now[1])]);
        let before = steps.and(self.runs.last().and_then(|run| run.last())).copied();
        let [odom, map] = steps.unwrap_or([Pose3::identity(); 2]).map(seen_from_above);
        let sample = |odom_from_robot, map_from_laser| Sample { stamp: cloud.stamp, odom_from_robot, map_from_laser };
        match (before, self.runs.last_mut()) {
            (Some(before), Some(run)) => run.push(sample(before.odom_from_robot * odom, before.map_from_laser * map)),
            _ => self.runs.push(vec![sample(Pose2::IDENTITY, Pose2::IDENTITY)]),
        }
    }
}

/// A place in the robot's plane.
fn in_plane(at: Pose2) -> Pose3 {
    Pose3 {
        rotation: UnitQuaternion::from_euler_angles(0.0, 0.0, at.theta),
        translation: Vector3::new(at.x, at.y, 0.0),
    }
}

/// A motion in the plane of where it begins.
fn seen_from_above(step: Pose3) -> Pose2 {
    let ahead = step.rotation * Vector3::x();
    Pose2::new(step.translation.x, step.translation.y, ahead.y.atan2(ahead.x))
}
