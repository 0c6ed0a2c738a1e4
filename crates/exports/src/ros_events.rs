//! A log's events as messages.

use crate::error::ExportError;
use crate::frames::{frame_of, scan_topic};
use crate::messages::{laser_scan, mounts, odom_transform, odometry, turn_rate};
use crate::recording::{Durability, Recording, Topic};
use mapwright_geom::{Pose2, Stamp};
use mapwright_ros::messages::TfMessage;
use mapwright_sensor::{LaserModel, LaserScan, Odometry, TurnRate};
use std::io::{Seek, Write};
use std::sync::Arc;

/// Topics are added when their first message comes.
#[derive(Debug)]
pub(crate) struct RosEvents<W: Write + Seek> {
    recording: Recording<W>,
    odom: Option<Topic>,
    imu: Option<Topic>,
    tf: Option<Topic>,
    tf_static: Option<Topic>,
    lasers: Vec<Known>,
}

/// A laser's frame with its topic and the model it had last.
#[derive(Debug)]
struct Known {
    frame: String,
    topic: Topic,
    laser: Arc<LaserModel>,
}

impl<W: Write + Seek> RosEvents<W> {
    pub(crate) fn new(recording: Recording<W>) -> Self {
        Self { recording, odom: None, imu: None, tf: None, tf_static: None, lasers: Vec::new() }
    }

    pub(crate) fn scan(&mut self, scan: &LaserScan) -> Result<(), ExportError> {
        let topic = self.introduce(scan)?;
        if let Some(odom_from_robot) = scan.odom_from_robot {
            self.odometry(&Odometry { stamp: scan.stamp, odom_from_robot })?;
        }
        self.recording.write(topic, scan.stamp, &laser_scan(scan.stamp, &scan.laser, &scan.ranges_m))
    }

    pub(crate) fn odometry(&mut self, reading: &Odometry) -> Result<(), ExportError> {
        let Odometry { stamp, odom_from_robot } = *reading;
        let topic = match self.odom {
            Some(topic) => topic,
            None => *self.odom.insert(self.recording.add("/odom", "nav_msgs/Odometry", Durability::Volatile)?),
        };
        self.recording.write(topic, stamp, &odometry(stamp, odom_from_robot))?;
        self.transform(stamp, odom_from_robot)
    }

    pub(crate) fn turn_rate(&mut self, rate: &TurnRate) -> Result<(), ExportError> {
        let topic = match self.imu {
            Some(topic) => topic,
            None => *self.imu.insert(self.recording.add("/imu", "sensor_msgs/Imu", Durability::Volatile)?),
        };
        self.recording.write(topic, rate.stamp, &turn_rate(rate))
    }

    pub(crate) fn finish(self) -> Result<W, ExportError> {
        self.recording.finish()
    }

    fn transform(&mut self, stamp: Stamp, odom_from_robot: Pose2) -> Result<(), ExportError> {
        let topic = match self.tf {
            Some(topic) => topic,
            None => *self.tf.insert(self.recording.add("/tf", "tf2_msgs/TFMessage", Durability::Volatile)?),
        };
        let message = TfMessage { transforms: vec![odom_transform(stamp, odom_from_robot)] };
        self.recording.write(topic, stamp, &message)
    }

    /// The topic of a scan's laser; where it sits is written when that is new.
    fn introduce(&mut self, scan: &LaserScan) -> Result<Topic, ExportError> {
        let laser = &scan.laser;
        let frame = frame_of(laser);
        let place = self.lasers.iter().position(|known| known.frame == frame);
        let mut moved = true;
        let place = match place {
            Some(place) => {
                let before = std::mem::replace(&mut self.lasers[place].laser, Arc::clone(laser));
                moved = (before.robot_from_laser, before.inverted) != (laser.robot_from_laser, laser.inverted);
                place
            }
            None => {
                let name = scan_topic(frame, self.lasers.is_empty());
                let topic = self.recording.add(&name, "sensor_msgs/LaserScan", Durability::Volatile)?;
                self.lasers.push(Known { frame: frame.to_owned(), topic, laser: Arc::clone(laser) });
                self.lasers.len() - 1
            }
        };
        if moved {
            self.write_mounts(scan.stamp)?;
        }
        Ok(self.lasers[place].topic)
    }

    /// All of them: only the last message reaches those who come later.
    fn write_mounts(&mut self, stamp: Stamp) -> Result<(), ExportError> {
        let topic = match self.tf_static {
            Some(topic) => topic,
            None => {
                let topic = self.recording.add("/tf_static", "tf2_msgs/TFMessage", Durability::TransientLocal)?;
                *self.tf_static.insert(topic)
            }
        };
        let message = mounts(stamp, self.lasers.iter().map(|known| &*known.laser));
        self.recording.write(topic, stamp, &message)
    }
}
