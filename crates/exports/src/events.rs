//! A log's events into another format.

use crate::carmen::CarmenEvents;
use crate::error::ExportError;
use crate::recording::Recording;
use crate::ros_events::RosEvents;
use mapwright_formats::LogEvent;
use std::io::{Seek, Write};

/// What was written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct EventCounts {
    /// Sweeps of lasers.
    pub scans: u64,
    /// Readings of the wheels.
    pub odometry: u64,
    /// Readings of a gyroscope.
    pub turn_rates: u64,
    /// Readings of rings of sonars.
    pub sonars: u64,
    /// Events of a kind that the format has no place for.
    pub left_out: u64,
}

/// Writes a log's scans, odometry and turn rates in the order in which they come.
///
/// ROS 1 bags and MCAP get scans on `/scan` (further lasers on `/scan_NAME`), the wheels on `/odom`, `odom -> base_link`
/// on `/tf`, turn rates on `/imu` in the robot's frame, and the mounts of lasers on `/tf_static`; a laser's frame is its name.
/// CARMEN has no place for turn rates. Odometry that a scan carries itself is a
/// reading of the same stamp just before it. Messages bear the events' stamps; they
/// are received in the order in which they are written, so that a reader that sorts keeps that order.
#[derive(Debug)]
pub struct EventWriter<W: Write + Seek> {
    kind: Kind<W>,
    counts: EventCounts,
}

#[derive(Debug)]
enum Kind<W: Write + Seek> {
    Carmen(Box<CarmenEvents<W>>),
    Ros(Box<RosEvents<W>>),
}

impl<W: Write + Seek> EventWriter<W> {
    /// A CARMEN log. A laser whose angles are FLASER's to the precision of ROS messages becomes one, and a reading of the
    /// wheels that the next scan carries itself gets no line of its own.
    pub fn carmen(writer: W) -> Self {
        Self::of(Kind::Carmen(Box::new(CarmenEvents::new(writer))))
    }

    /// A ROS 1 bag with lz4 chunks.
    ///
    /// # Errors
    /// [`ExportError::Bag`].
    pub fn bag1(writer: W) -> Result<Self, ExportError> {
        Ok(Self::of(Kind::Ros(Box::new(RosEvents::new(Recording::bag1(writer)?)))))
    }

    /// An MCAP file of ROS 2 with zstd chunks.
    ///
    /// # Errors
    /// [`ExportError::Bag`].
    pub fn mcap(writer: W) -> Result<Self, ExportError> {
        Ok(Self::of(Kind::Ros(Box::new(RosEvents::new(Recording::mcap(writer)?)))))
    }

    fn of(kind: Kind<W>) -> Self {
        Self { kind, counts: EventCounts::default() }
    }

    /// Appends an event.
    ///
    /// # Errors
    /// What the format cannot carry: for ROS 1 stamps before 1970 and after 2106, for MCAP before 1970, for CARMEN poses
    /// beyond 1000 km; [`ExportError::Bag`] and [`ExportError::Format`] where the stream below fails.
    pub fn write(&mut self, event: LogEvent<'_>) -> Result<(), ExportError> {
        match (event, &mut self.kind) {
            (LogEvent::Scan(scan), kind) => {
                match kind {
                    Kind::Carmen(carmen) => carmen.scan(scan)?,
                    Kind::Ros(ros) => ros.scan(scan)?,
                }
                self.counts.scans += 1;
            }
            (LogEvent::Odometry(odometry), kind) => {
                match kind {
                    Kind::Carmen(carmen) => carmen.odometry(odometry)?,
                    Kind::Ros(ros) => ros.odometry(odometry)?,
                }
                self.counts.odometry += 1;
            }
            (LogEvent::TurnRate(rate), Kind::Ros(ros)) => {
                ros.turn_rate(rate)?;
                self.counts.turn_rates += 1;
            }
            (LogEvent::Sonar(reading), Kind::Carmen(carmen)) => {
                carmen.sonar(reading)?;
                self.counts.sonars += 1;
            }
            _ => self.counts.left_out += 1,
        }
        Ok(())
    }

    /// Completes the file and hands the stream back, flushed.
    ///
    /// # Errors
    /// [`ExportError::Bag`], [`ExportError::Format`].
    pub fn finish(self) -> Result<(W, EventCounts), ExportError> {
        let writer = match self.kind {
            Kind::Carmen(carmen) => carmen.finish()?,
            Kind::Ros(ros) => ros.finish()?,
        };
        Ok((writer, self.counts))
    }
}
