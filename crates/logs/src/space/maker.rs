//! Clouds out of messages.

use super::camera::CameraPlan;
use super::pair_maker::{MadePair, PairMaker, Side};
use super::tilting::{Swing, Tilting};
use super::topic::TopicPlan;
use crate::channel::Messages;
use crate::links::stamp_or;
use crate::packets::OUSTER_FRAME;
use mapwright_bags::RawMessage;
use mapwright_clouds::{NoteKind, Notes, PacketDecoder, Place, Sweep, read_png16};
use mapwright_geom::{Pose3, Stamp};
use mapwright_ros::messages::{CompressedImage, DepthCompression, Header, LaserScan, PointCloud2, TfMessage};
use mapwright_ros::{Cloud as RosCloud, CloudPoints, DepthNumbers};
use mapwright_sensor::{Cloud, DepthImage, ImuReading, OdometryTrack, PinholeCamera, SpaceSensor, SweepTimes};
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::sync::Arc;

/// No sweep or image has more points or pixels; bounds the memory that one message may take.
const POINTS_AT_MOST: u64 = 1 << 24;

/// Clouds of packets, whose messages begin and end anywhere in a revolution.
#[derive(Debug)]
struct Packets {
    decoder: PacketDecoder,
    /// The frame of the last message.
    frame: String,
}

/// A cloud and what is odd about it.
#[derive(Debug)]
pub(super) struct Made {
    pub(super) cloud: Cloud,
    /// The header had no stamp: that of the recording stands in.
    pub(super) is_unstamped: bool,
    /// Points that are not finite, of a lidar's.
    pub(super) not_finite: usize,
    /// What times of points should be and what they are, where these are no times of one sweep.
    pub(super) refused_time: Option<[String; 2]>,
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
    topic: String,
    packets: Option<Packets>,
    tilting: Option<Tilting>,
    pairs: Option<PairMaker>,
    view: Option<View>,
    unit_m: f64,
    times: SweepTimes,
}

impl CloudMaker {
    pub(super) fn new(plan: &TopicPlan) -> Self {
        let sensors = plan.sensors.iter().map(|(frame, sensor)| (frame.clone(), Arc::new(sensor.clone())));
        let decoder =
            plan.packets.as_ref().and_then(|packets| PacketDecoder::new(packets.lidar, packets.info.as_ref()).ok());
        let packets = decoder.map(|decoder| Packets { decoder, frame: String::new() });
        let (camera, topic) = (plan.camera.clone(), plan.topic.clone());
        let (unit_m, times) = (plan.unit_m, plan.times);
        let tilting = plan.joint.clone().map(|joint| Tilting::new(joint, plan.sensor.robot_from_sensor));
        let pairs = plan.stereo.as_ref().and_then(|stereo| PairMaker::new(&plan.topic, stereo));
        Self { sensors: sensors.collect(), camera, topic, packets, tilting, pairs, view: None, unit_m, times }
    }

    /// The clouds that a message ends, without odometry: one, but of packets none or several.
    ///
    /// # Errors
    /// Why the message is none, in words.
    pub(super) fn make(
        &mut self,
        messages: &mut Messages,
        message: &RawMessage<'_>,
        notes: &mut Notes,
    ) -> Result<Vec<Made>, String> {
        let (data, recorded) = (message.data, message.log_stamp);
        let at = usize::try_from(message.offset_bytes).unwrap_or(usize::MAX);
        match messages {
            Messages::LidarPackets(decoder) => {
                let scan = decoder.decode(data).map_err(words)?;
                for packet in &scan.packets {
                    let (stamp, _) = stamp_or(packet.stamp, recorded);
                    self.add_packet(packet.payload(), scan.header.frame(), stamp, at, notes);
                }
                self.ended()
            }
            Messages::OusterPackets(decoder) => {
                let packet = decoder.decode(data).map_err(words)?;
                self.add_packet(packet.buf, OUSTER_FRAME, recorded, at, notes);
                self.ended()
            }
            Messages::Scan(decoder) => self.scan(&decoder.decode(data).map_err(words)?, recorded),
            Messages::MultiEcho(decoder) => {
                let scan = decoder.decode(data).map_err(words)?;
                let first = scan.first_echoes();
                self.scan(&scan.with_ranges(&first), recorded)
            }
            _ => self.one(messages, data, recorded).map(|made| vec![made]),
        }
    }

    /// Hears how the joint of a laser that tilts is turned.
    pub(super) fn hear(&mut self, transforms: &TfMessage<'_>, recorded: Stamp) {
        let Some(tilting) = &mut self.tilting else { return };
        for transform in &transforms.transforms {
            tilting.hear(transform, stamp_or(transform.header.stamp, recorded).0);
        }
    }

    /// The clouds of a laser that tilts whose swing has ended, given odometry; `now` is the time of recording.
    pub(super) fn swings(
        &mut self,
        wheels: &OdometryTrack<Pose3>,
        now: Stamp,
        is_end: bool,
        notes: &mut Notes,
    ) -> Vec<Made> {
        let Some(tilting) = &mut self.tilting else { return Vec::new() };
        let (swings, lost) = tilting.ended(wheels, now, is_end);
        for _ in 0..lost {
            let words = || ("transforms of its joint before and after it, at most 2 s apart", "none");
            notes.note(NoteKind::UnreadableFrame, &self.topic, 0, words);
        }
        let sensor = self.sensors.values().next().cloned();
        let (clouds, flat): (Vec<Swing>, Vec<Swing>) = swings.into_iter().partition(Swing::is_cloud);
        for swing in flat {
            let words = || ("a swing of a laser", format!("one of {:.1} deg", swing.turned_rad.to_degrees()));
            notes.note(NoteKind::PartialRevolution, &self.topic, 0, words);
        }
        let made = |swing: Swing| {
            let Swing { stamp, points_m, times_s, intensities, .. } = swing;
            let sensor = sensor.as_ref().map(Arc::clone)?;
            let cloud = Cloud {
                stamp,
                sensor,
                points_m,
                times_s,
                colours: Vec::new(),
                intensities,
                sigmas_m: Vec::new(),
                odom_from_robot: None,
            };
            Some(Made { cloud, is_unstamped: false, not_finite: 0, refused_time: None })
        };
        clouds.into_iter().filter_map(made).collect()
    }

    fn scan(&mut self, scan: &LaserScan<'_>, recorded: Stamp) -> Result<Vec<Made>, String> {
        self.sensor(&scan.header)?;
        let tilting = self.tilting.as_mut().ok_or("scans of a laser that does not tilt")?;
        tilting.add(scan, stamp_or(scan.header.stamp, recorded).0, recorded)?;
        Ok(Vec::new())
    }

    /// The clouds that an image of a pair of cameras completes, without odometry.
    ///
    /// # Errors
    /// Why the message is none, in words.
    pub(super) fn make_of_pair(
        &mut self,
        side: Side,
        messages: &mut Messages,
        message: &RawMessage<'_>,
        notes: &mut Notes,
    ) -> Result<Vec<Made>, String> {
        let pairs = self.pairs.as_mut().ok_or("images of one camera, expected those of two")?;
        let at = usize::try_from(message.offset_bytes).unwrap_or(usize::MAX);
        let place = (message.log_stamp, at);
        match messages {
            Messages::Image(decoder) => {
                let image = decoder.decode(message.data).map_err(words)?;
                few_enough(u64::from(image.width) * u64::from(image.height))?;
                pairs.add(side, &image, place)?;
            }
            Messages::CompressedImage(decoder) => {
                pairs.add_file(side, &decoder.decode(message.data).map_err(words)?, place)?;
            }
            Messages::None(Some(reason)) => return Err(reason.clone()),
            _ => return Err("messages of another kind".to_owned()),
        }
        let sensors = &self.sensors;
        let sensor_of = |frame: &str| sensor_in(sensors, frame);
        let made = |MadePair { cloud, is_unstamped }| Made { cloud, is_unstamped, not_finite: 0, refused_time: None };
        Ok(pairs.ended(sensor_of, notes)?.into_iter().map(made).collect())
    }

    /// What casts doubt on a map of what was read so far, in words.
    pub(super) fn doubts(&self) -> &[String] {
        self.pairs.as_ref().map_or(&[], PairMaker::doubts)
    }

    /// The clouds that the end of the recording ends.
    pub(super) fn finish(&mut self, notes: &mut Notes) -> Vec<Made> {
        if let Some(pairs) = &mut self.pairs {
            pairs.finish(notes);
        }
        let Some(packets) = &mut self.packets else { return Vec::new() };
        packets.decoder.finish(&self.topic, notes);
        self.ended().unwrap_or_default()
    }

    /// A reading of the inertial sensor in a lidar that sends packets, in the frame of its points.
    pub(super) fn reading(&self, payload: &[u8]) -> Option<ImuReading> {
        self.packets.as_ref()?.decoder.reading(payload)
    }

    fn add_packet(&mut self, payload: &[u8], frame: &str, stamp: Stamp, at: usize, notes: &mut Notes) {
        let Some(packets) = &mut self.packets else { return };
        if packets.frame != frame {
            frame.clone_into(&mut packets.frame);
        }
        packets.decoder.add(Place { file: &self.topic, at }, stamp, payload, notes);
    }

    fn ended(&mut self) -> Result<Vec<Made>, String> {
        let packets = self.packets.as_mut().ok_or("packets that nothing says how to read")?;
        let sweeps: Vec<Sweep> = std::iter::from_fn(|| packets.decoder.next_sweep()).collect();
        let Some(packets) = self.packets.as_ref().filter(|_| !sweeps.is_empty()) else { return Ok(Vec::new()) };
        let sensor = Arc::clone(self.sensor_in(&packets.frame)?);
        let unit_m = self.unit_m as f32;
        let made = |sweep: Sweep| Made {
            cloud: Cloud {
                stamp: sweep.stamp,
                sensor: Arc::clone(&sensor),
                points_m: sweep.points_m.into_iter().map(|point| point.map(|v| v * unit_m)).collect(),
                times_s: sweep.times_s,
                colours: Vec::new(),
                intensities: sweep.intensities,
                sigmas_m: Vec::new(),
                odom_from_robot: None,
            },
            is_unstamped: false,
            not_finite: 0,
            refused_time: None,
        };
        Ok(sweeps.into_iter().map(made).collect())
    }

    /// The cloud of a message that has one.
    fn one(&mut self, messages: &mut Messages, data: &[u8], recorded: Stamp) -> Result<Made, String> {
        match messages {
            Messages::Cloud(decoder) => self.cloud(&decoder.decode(data).map_err(words)?, recorded),
            Messages::Livox(decoder) => {
                let scan = decoder.decode(data).map_err(words)?;
                few_enough(scan.points.len() as u64)?;
                self.of_points(&scan.header, scan.to_points(), false, recorded)
            }
            Messages::Foxglove(layout) => {
                let cloud = layout.decode(data)?;
                let mut made = self.cloud(&cloud.message()?, recorded)?;
                move_points(&mut made.cloud, cloud.frame_from_points);
                Ok(made)
            }
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
        self.sensor_in(header.frame())
    }

    fn sensor_in(&self, frame: &str) -> Result<&Arc<SpaceSensor>, String> {
        sensor_in(&self.sensors, frame)
    }

    fn cloud(&self, message: &PointCloud2<'_>, recorded: Stamp) -> Result<Made, String> {
        let points = RosCloud::new(message).map_err(words)?;
        few_enough(points.len() as u64)?;
        let is_absolute = points.time().is_some_and(|time| time.absolute);
        self.of_points(&message.header, points.to_points(), is_absolute, recorded)
    }

    fn of_points(
        &self,
        header: &Header<'_>,
        mut points: CloudPoints,
        is_absolute: bool,
        recorded: Stamp,
    ) -> Result<Made, String> {
        let sensor = Arc::clone(self.sensor(header)?);
        let refused_time = points.settle_times(self.times, is_absolute);
        if self.unit_m != 1.0 {
            let metres = |coordinate: &mut f32| *coordinate = (f64::from(*coordinate) * self.unit_m) as f32;
            points.points_m.iter_mut().flatten().for_each(metres);
        }
        let (header, is_unstamped) = stamp_or(header.stamp, recorded);
        let not_finite = points.not_finite;
        Ok(Made { cloud: points.into_cloud(header, sensor), is_unstamped, not_finite, refused_time })
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

fn sensor_in<'a>(sensors: &'a BTreeMap<String, Arc<SpaceSensor>>, frame: &str) -> Result<&'a Arc<SpaceSensor>, String> {
    sensors.get(frame).ok_or_else(|| format!("nothing says where '{frame}' sits on the robot"))
}

fn move_points(cloud: &mut Cloud, frame_from_points: Pose3) {
    if frame_from_points == Pose3::identity() {
        return;
    }
    for point in &mut cloud.points_m {
        let there = frame_from_points.transform(Vector3::from(point.map(f64::from)));
        *point = [there.x as f32, there.y as f32, there.z as f32];
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
