//! Clouds of points out of messages, as they come.

use mapwright_geom::Stamp;
use mapwright_ros::Cloud as CloudMessage;
use mapwright_ros::messages::PointCloud2;
use mapwright_sensor::{Cloud, SpaceSensor, SweepTimes};
use std::collections::VecDeque;
use std::sync::Arc;

/// No cloud has more points; bounds the memory that one message may take.
const POINTS_AT_MOST: usize = 1 << 24;
/// What times of points are is told by so many clouds.
const STAMPS: usize = 20;
/// A sweep takes no longer, seconds: what a cloud says beyond that nobody waits for.
const SWEEP_MOST_S: f64 = 2.0;

/// What is known of a topic of clouds.
#[derive(Debug, Default)]
pub(super) struct CloudTopic {
    /// Of the newest clouds, in the order in which they came: their stamps, and how long the times of their points span, as they are read, seconds.
    newest: VecDeque<(Stamp, f64)>,
    /// What is odd about the last one, in words.
    pub(super) odd: Option<String>,
}

impl CloudTopic {
    /// The cloud of a message whose stamp is this, in its sensor's frame, by whose name the sensor goes.
    ///
    /// # Errors
    /// Why it is none, in words.
    pub(super) fn cloud(&mut self, topic: &str, message: &PointCloud2<'_>, stamp: Stamp) -> Result<Cloud, String> {
        let read = CloudMessage::new(message).map_err(|error| error.to_string())?;
        if read.len() > POINTS_AT_MOST {
            return Err(format!("expected at most {POINTS_AT_MOST} points, found {}", read.len()));
        }
        let is_absolute = read.time().is_some_and(|time| time.absolute);
        let mut points = read.to_points();
        if points.points_m.len() == points.not_finite {
            return Err("a cloud of 0 points".to_owned());
        }
        let span_s = points.times_s.iter().copied().fold(0.0_f32, f32::max);
        if self.newest.len() >= STAMPS {
            self.newest.pop_front();
        }
        self.newest.push_back((stamp, f64::from(span_s)));
        let stamps: Vec<Stamp> = self.newest.iter().map(|(stamp, _)| *stamp).collect();
        let longest_s = self.newest.iter().fold(0.0_f64, |longest_s, (_, span_s)| longest_s.max(*span_s));
        let refused = points.settle_times(SweepTimes::of(longest_s, &stamps), is_absolute);
        self.odd = refused.map(|[expected, found]| {
            format!("its clouds are mapped as if taken at once: times of points, expected {expected}, found {found}")
        });
        let frame = message.header.frame();
        // As of recordings: in an optical frame, or in rows and called so.
        let is_camera = frame.ends_with("optical_frame") || message.height > 1 && topic.contains("depth");
        let sensor = if is_camera { SpaceSensor::depth_camera(frame) } else { SpaceSensor::lidar(frame) };
        Ok(points.into_cloud(stamp, Arc::new(sensor)))
    }
}

/// When the last point of a cloud was taken.
pub(super) fn end(cloud: &Cloud) -> Stamp {
    let last_s = cloud.times_s.iter().copied().filter(|s| s.is_finite()).fold(0.0_f32, f32::max);
    Stamp(cloud.stamp.0.saturating_add(Stamp::from_secs_f64(f64::from(last_s).min(SWEEP_MOST_S)).0))
}
