//! A simulated robot as others hear it: for tests and examples, which bring `Heard` along.

use super::{Driver, Gate, Heard, Passed, Reading};
use mapwright::{Job, JobResult, Mapper, Update};
use mapwright_geom::{Pose2, Pose3, Stamp};
use mapwright_ros::messages::{Header, LaserScan, TfMessage, TransformStamped};
use mapwright_ros::{Encoding, RosError, encode};
use mapwright_sensor::Sweep;
use mapwright_sim::{Drive, DriveSettings, Event, worlds};
use nalgebra::{UnitQuaternion, Vector3};

/// Where stamps begin: one of zero is none.
pub(crate) const BEGIN: Stamp = Stamp(1_000_000_000_000);

fn link(parent: &str, child: &str, stamp: Stamp, pose: Pose2) -> Vec<u8> {
    let rotation = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), pose.theta);
    let pose = Pose3 { translation: Vector3::new(pose.x, pose.y, 0.0), rotation };
    let header = Header::new(stamp, parent);
    let transform = TransformStamped { header, child_frame_id: child.into(), transform: pose.into() };
    encode(&TfMessage { transforms: vec![transform] }, Encoding::Cdr).expect("it is short")
}

/// What is heard on a drive around a loop of 60 m, each with its stamp: where the laser sits, odometry as transforms, scans. Odometry begins here.
pub(crate) fn heard(settings: DriveSettings, odom_from_begin: Pose2) -> Vec<(Stamp, Heard)> {
    let mount = settings.laser.model.robot_from_laser;
    let bytes = link("base_link", "laser", BEGIN, mount);
    let mut all = vec![(BEGIN, Heard::Transforms { bytes, is_static: true })];
    let after = |stamp: Stamp| Stamp(stamp.0 + BEGIN.0);
    for event in Drive::new(worlds::loop_of(1, 60.0).into(), settings) {
        all.push(match event {
            Event::Odometry(odometry) => {
                let stamp = after(odometry.stamp);
                let bytes = link("odom", "base_link", stamp, odom_from_begin * odometry.odom_from_robot);
                (stamp, Heard::Transforms { bytes, is_static: false })
            }
            Event::Scan(taken) => {
                let (stamp, laser, ranges_m) = (after(taken.scan.stamp), &taken.scan.laser, &taken.scan.ranges_m);
                let last_rad = laser.angle_min_rad + (ranges_m.len() - 1) as f64 * laser.angle_step_rad;
                let message = LaserScan {
                    header: Header::new(stamp, "laser"),
                    angle_min: laser.angle_min_rad as f32,
                    angle_max: last_rad as f32,
                    angle_increment: laser.angle_step_rad as f32,
                    range_min: laser.range_min_m as f32,
                    range_max: laser.range_max_m as f32,
                    ranges: ranges_m[..].into(),
                    ..Default::default()
                };
                let bytes = encode(&message, Encoding::Cdr).expect("it is short");
                (stamp, Heard::Scan { topic: "/scan".to_owned(), bytes })
            }
        });
    }
    all
}

/// The lane of a message at a door with two: scans, and all else.
pub(crate) fn lane(heard: &Heard) -> usize {
    usize::from(!matches!(heard, Heard::Scan { .. }))
}

/// A mapper that drives, and what it tells.
pub(crate) struct Driven<F: FnMut(&Update)> {
    pub(crate) mapper: Mapper,
    pub(crate) tell: F,
    pub(crate) refused: Vec<String>,
}

impl<F: FnMut(&Update)> Driven<F> {
    pub(crate) fn new(mapper: Mapper, tell: F) -> Self {
        Self { mapper, tell, refused: Vec::new() }
    }
}

impl<F: FnMut(&Update)> Driver for Driven<F> {
    type Maps = Sweep;

    fn add(&mut self, passed: &Passed, _gate: &Gate) {
        match passed {
            Passed::Scan(scan) => (self.tell)(&self.mapper.add_scan(scan)),
            Passed::Reading(Reading::Odometry(odometry)) => self.mapper.add_odometry(odometry),
            Passed::Reading(Reading::Turning(rate)) => {
                self.mapper.add_turn_rate(rate);
            }
            Passed::Cloud(_) | Passed::Reading(Reading::InSpace(_)) => {}
        }
    }

    fn next_job(&mut self) -> Option<Job> {
        self.mapper.next_job()
    }

    fn apply(&mut self, result: JobResult) {
        (self.tell)(&self.mapper.apply(result));
    }

    fn refused(&mut self, error: &RosError) {
        self.refused.push(error.to_string());
    }
}
