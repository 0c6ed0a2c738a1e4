//! Clouds out of messages.

use super::camera::CameraPlan;
use super::plan::SpacePlan;
use crate::channel::Messages;
use crate::links::stamp_or;
use mapwright_clouds::read_png16;
use mapwright_geom::Stamp;
use mapwright_ros::messages::{CompressedImage, DepthCompression, Header, PointCloud2};
use mapwright_ros::{Cloud as RosCloud, DepthNumbers};
use mapwright_sensor::{Cloud, DepthImage, PinholeCamera, SpaceSensor};
use std::collections::BTreeMap;
use std::sync::Arc;

/// No sweep or image has more points or pixels; bounds the memory that one message may take.
const POINTS_AT_MOST: u64 = 1 << 24;

/// A cloud and what is odd about it.
#[derive(Debug)]
pub(super) struct Made {
    pub(super) cloud: Cloud,
    /// The header had no stamp: that of the recording stands in.
    pub(super) is_unstamped: bool,
    /// Points that are not finite, of a lidar's.
    pub(super) not_finite: usize,
    /// The field of times, where these are no times of one sweep.
    pub(super) refused_time: Option<String>,
}

/// A camera and the directions of its pixels.
#[derive(Debug)]
struct View {
    camera: Arc<PinholeCamera>,
    directions: Vec<[f32; 2]>,
}

/// Makes clouds of the messages of one topic; sensors are shared by the clouds they took.
#[derive(Debug)]
pub(super) struct CloudMaker {
    sensors: BTreeMap<String, Arc<SpaceSensor>>,
    camera: Option<CameraPlan>,
    view: Option<View>,
}

impl CloudMaker {
    pub(super) fn new(plan: &SpacePlan) -> Self {
        let sensors = plan.sensors.iter().map(|(frame, sensor)| (frame.clone(), Arc::new(sensor.clone())));
        Self { sensors: sensors.collect(), camera: plan.camera.clone(), view: None }
    }

    /// The cloud, without odometry.
    ///
    /// # Errors
    /// Why the message is none, in words.
    pub(super) fn make(&mut self, messages: &mut Messages, data: &[u8], recorded: Stamp) -> Result<Made, String> {
        match messages {
            Messages::Cloud(decoder) => self.cloud(&decoder.decode(data).map_err(words)?, recorded),
            Messages::Image(decoder) => {
                let image = decoder.decode(data).map_err(words)?;
                few_enough(u64::from(image.width) * u64::from(image.height))?;
                let depth_m = image.depth_m(self.depth_per_m()).map_err(words)?;
                self.image(&image.header, [image.width, image.height], depth_m, recorded)
            }
            Messages::CompressedImage(decoder) => {
                let image = decoder.decode(data).map_err(words)?;
                let (size, depth_m) = self.decompressed(&image)?;
                self.image(&image.header, size, depth_m, recorded)
            }
            Messages::None(Some(reason)) => Err(reason.clone()),
            _ => Err("messages of another kind".to_owned()),
        }
    }

    fn depth_per_m(&self) -> Option<f64> {
        self.camera.as_ref().and_then(|plan| plan.depth_per_m)
    }

    fn sensor(&self, header: &Header<'_>) -> Result<&Arc<SpaceSensor>, String> {
        let found = self.sensors.get(header.frame());
        found.ok_or_else(|| format!("nothing says where '{}' sits on the robot", header.frame()))
    }

    fn cloud(&self, message: &PointCloud2<'_>, recorded: Stamp) -> Result<Made, String> {
        let sensor = Arc::clone(self.sensor(&message.header)?);
        let points = RosCloud::new(message).map_err(words)?;
        few_enough(points.len() as u64)?;
        let points = points.to_points();
        let (header, is_unstamped) = stamp_or(message.header.stamp, recorded);
        let cloud = Cloud {
            stamp: Stamp(header.0.saturating_add(Stamp::from_secs_f64(points.start_s).0)),
            sensor,
            points_m: points.points_m,
            times_s: points.times_s,
            colours: points.colours,
            odom_from_robot: None,
        };
        Ok(Made { cloud, is_unstamped, not_finite: points.not_finite, refused_time: points.refused_time })
    }

    /// Size and depth of a compressed image.
    fn decompressed(&self, image: &CompressedImage<'_>) -> Result<([u32; 2], Vec<f32>), String> {
        let plain = DepthCompression { quant_a: 0.0, quant_b: 0.0, file: image.data };
        let numbers = DepthNumbers::of_format(&image.format).unwrap_or(DepthNumbers::Millimetres);
        let (packed, numbers) = match image.depth() {
            Some(packed) => (packed, numbers),
            None => (plain, DepthNumbers::Millimetres),
        };
        let (size, stored) = read_png16("the image", packed.file, POINTS_AT_MOST).map_err(words)?;
        Ok((size, packed.depth_m(numbers, &stored, self.depth_per_m())))
    }

    fn image(
        &mut self,
        header: &Header<'_>,
        size: [u32; 2],
        depth_m: Vec<f32>,
        recorded: Stamp,
    ) -> Result<Made, String> {
        let sensor = Arc::clone(self.sensor(header)?);
        let (stamp, is_unstamped) = stamp_or(header.stamp, recorded);
        let view = self.view(size)?;
        let image = DepthImage { stamp, camera: Arc::clone(&view.camera), depth_m, colours: Vec::new() };
        let cloud = image.to_cloud(&sensor, &view.directions)?;
        Ok(Made { cloud, is_unstamped, not_finite: 0, refused_time: None })
    }

    /// The camera that takes images of a size; room is made for as many pixels as the first image has.
    fn view(&mut self, size: [u32; 2]) -> Result<&View, String> {
        let plan = self.camera.as_ref().ok_or("nothing says what the camera is")?;
        let known = self
            .view
            .as_ref()
            .map_or([plan.camera.width, plan.camera.height], |view| [view.camera.width, view.camera.height]);
        if known != [0, 0] && known != size {
            let [expected, found] = [known, size].map(|[width, height]| format!("{width} x {height} pixels"));
            return Err(format!("the camera has {expected}, the image {found}"));
        }
        Ok(self.view.get_or_insert_with(|| {
            let camera = PinholeCamera { width: size[0], height: size[1], ..plan.camera };
            View { directions: camera.directions(), camera: Arc::new(camera) }
        }))
    }
}

fn few_enough(points: u64) -> Result<(), String> {
    if points > POINTS_AT_MOST {
        return Err(format!("expected at most {POINTS_AT_MOST} points, found {points}"));
    }
    Ok(())
}

fn words(error: impl ToString) -> String {
    error.to_string()
}
