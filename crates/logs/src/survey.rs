//! The first pass over a recording: what is there.

use crate::camera::CameraSurvey;
use crate::channel::{Decoders, Messages, TopicKind};
use crate::directions::{Glimpse, Reach};
use crate::foxglove::PointCloud;
use crate::links::{Links, bare, joined, namespace};
use crate::packets::{Metadata, OUSTER_FRAME, PacketSurvey};
use crate::still::{Movement, Scenery};
use mapwright_bags::{BagError, Connection, RawMessage, ReadReport, Recording};
use mapwright_clouds::{Distances, OusterInfo, read_png16};
use mapwright_geom::Stamp;
use mapwright_ros::messages::{
    CompressedImage, DepthCompression, Header, Image, Imu, LaserScan, Odometry, PointCloud2,
};
use mapwright_ros::{Cloud, DepthNumbers, Mounting, RosError};
use mapwright_sensor::{SweepTimes, settle_times};
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

/// Frames of a topic that are remembered.
const FRAMES_KEPT: usize = 16;
/// Sonars of one topic that are remembered.
const SONARS_KEPT: usize = 256;
/// Who watches is told after so many messages.
const WATCHED_EVERY: u64 = 64;
/// Of so many scans one is looked at for the directions in which its laser sees.
const REACH_EVERY: u64 = 8;
/// A packet has about so many bytes a point.
const BYTES_A_POINT: u64 = 4;
/// Clouds of which the times of points are looked at.
const SWEEPS_LOOKED_AT: usize = 64;
/// Of larger images nothing but the first bytes is looked at.
const PIXELS_LOOKED_AT: u64 = 1 << 22;
/// Topics of which the messages are looked at.
const TOPICS_KEPT: usize = 4096;

/// What a message of one sonar says of it: opening in radians, least and greatest range.
pub(crate) type SonarHead = [f32; 3];

/// One topic of a recording.
#[derive(Debug, Clone, PartialEq)]
pub struct TopicSurvey {
    /// Its name.
    pub name: String,
    /// The type as written.
    pub type_name: String,
    /// What it is good for.
    pub kind: TopicKind,
    /// Messages.
    pub messages: u64,
    /// Their bytes.
    pub bytes: u64,
    /// First and last time at which it was recorded.
    pub recorded: Option<(Stamp, Stamp)>,
    /// Frames of its headers and how often each; of scans, clouds, odometry and inertial readings.
    pub frames: BTreeMap<String, u64>,
    /// Frames that odometry moves, and how often each.
    pub child_frames: BTreeMap<String, u64>,
    /// Messages that could not be decoded.
    pub undecodable: u64,
    /// What was wrong with the first of them, or with all.
    pub first_error: Option<String>,
    /// Whether the messages say when each beam or point was taken.
    pub has_times: bool,
    /// The fields of a cloud's points, the beams of the first scan, or the first image's size and encoding, in words.
    pub shape: String,
    /// Whether its messages are images of depth, by the first of them.
    pub is_depth: bool,
    /// Whether they are images in grey or colour.
    pub is_picture: bool,
    /// What the first of its messages says of a camera.
    pub camera: Option<CameraSurvey>,
    /// Of texts: what an Ouster sensor says of itself.
    pub(crate) ouster: Option<Metadata>,
    /// Of packets.
    pub(crate) packets: PacketSurvey,
    /// Points of a cloud or pixels of an image, of the first; and rows of it.
    pub(crate) points: [u64; 2],
    /// Of clouds, and of images of depth by their encoding.
    pub(crate) distances: Distances,
    /// The number that stands for a metre by the encoding, of images of depth.
    pub(crate) depth_per_m: f64,
    /// Of clouds.
    pub(crate) sweeps: Sweeps,
    /// What the message says, where it is one number: an option of a camera.
    pub(crate) number: Option<f32>,
    /// Of sonars, by their frames.
    pub(crate) sonars: BTreeMap<String, SonarHead>,
    /// Of odometry.
    pub(crate) movement: Movement,
    /// Of planar scans.
    pub(crate) scenery: Scenery,
    /// Of planar scans.
    pub(crate) reach: Reach,
    /// Of clouds.
    pub(crate) glimpse: Glimpse,
}

impl TopicSurvey {
    fn new(connection: &Connection) -> Self {
        Self {
            name: connection.topic.clone(),
            type_name: connection.type_name.clone(),
            kind: TopicKind::of(&connection.type_name),
            messages: 0,
            bytes: 0,
            recorded: None,
            frames: BTreeMap::new(),
            child_frames: BTreeMap::new(),
            undecodable: 0,
            first_error: None,
            has_times: false,
            shape: String::new(),
            is_depth: false,
            is_picture: false,
            camera: None,
            ouster: None,
            packets: PacketSurvey::default(),
            points: [0, 0],
            distances: Distances::default(),
            depth_per_m: DepthNumbers::Millimetres.per_m(),
            sweeps: Sweeps::default(),
            number: None,
            sonars: BTreeMap::new(),
            movement: Movement::default(),
            scenery: Scenery::default(),
            reach: Reach::default(),
            glimpse: Glimpse::default(),
        }
    }

    /// Messages that can be used.
    #[must_use]
    pub fn usable(&self) -> u64 {
        self.messages.saturating_sub(self.undecodable)
    }

    /// Messages a second by the times of their recording.
    #[must_use]
    pub fn rate_hz(&self) -> Option<f64> {
        let (first, last) = self.recorded?;
        let span_s = last.secs_since(first);
        (span_s > 0.0 && self.messages > 1).then(|| (self.messages - 1) as f64 / span_s)
    }

    /// The frame of most of its messages.
    #[must_use]
    pub fn frame(&self) -> &str {
        most(&self.frames)
    }

    /// The frame that most of its messages move; of odometry.
    #[must_use]
    pub fn child_frame(&self) -> &str {
        most(&self.child_frames)
    }

    /// By how much the stamp of its first cloud is ahead of when that was recorded, seconds.
    pub(crate) fn clock_ahead_s(&self) -> Option<f64> {
        let stamp = *self.sweeps.stamps.first()?;
        (stamp != Stamp(0)).then(|| Some(stamp.secs_since(self.recorded?.0)))?
    }

    /// Pixels of its first image, across and down.
    pub(crate) fn size(&self) -> Option<[u32; 2]> {
        let [pixels, rows] = self.points;
        let width = pixels.checked_div(rows)?;
        (self.kind.is_images() && width > 0).then_some([u32::try_from(width).ok()?, u32::try_from(rows).ok()?])
    }

    fn count(&mut self, message: &RawMessage<'_>) {
        self.messages += 1;
        self.bytes += message.data.len() as u64;
        let stamp = message.log_stamp;
        let (first, last) = self.recorded.unwrap_or((stamp, stamp));
        self.recorded = Some((first.min(stamp), last.max(stamp)));
    }

    fn header(&mut self, header: &Header<'_>) {
        note_frame(&mut self.frames, header.frame());
    }

    fn odometry(&mut self, odometry: &Odometry<'_>) {
        self.header(&odometry.header);
        note_frame(&mut self.child_frames, bare(&odometry.child_frame_id));
        self.movement.see(|| odometry.pose.pose.to_pose3());
    }

    fn image(&mut self, image: &Image<'_>) {
        let encoding: String = image.encoding.chars().take(40).collect();
        let numbers = DepthNumbers::of(&image.encoding);
        self.is_depth = numbers.is_some();
        self.is_picture = image.is_picture();
        self.depth_per_m = numbers.unwrap_or(DepthNumbers::Millimetres).per_m();
        self.shape = format!("images of {} x {} as `{encoding}`", image.width, image.height);
        self.points = [u64::from(image.width) * u64::from(image.height), u64::from(image.height)];
    }

    /// The first cloud of a topic.
    fn cloud(&mut self, message: &PointCloud2<'_>) -> Result<(), String> {
        let cloud = Cloud::new(message).map_err(|error| error.to_string())?;
        let fields: Vec<_> = message.fields.iter().take(12).map(|field| &*field.name).collect();
        self.has_times = cloud.time().is_some();
        self.shape = format!("{} points of {}", cloud.len(), fields.join(" "));
        self.points = [cloud.len() as u64, u64::from(message.height)];
        Ok(())
    }

    fn foxglove(&mut self, cloud: &PointCloud<'_>) -> Result<(), String> {
        note_frame(&mut self.frames, bare(&cloud.frame));
        let message = cloud.message()?;
        self.see_cloud(&message);
        if self.shape.is_empty() {
            self.cloud(&message)?;
        }
        Ok(())
    }

    /// The first image's size and, of the first few, how far they see.
    fn compressed_image(&mut self, image: &CompressedImage<'_>) {
        self.is_depth = is_depth_file(image);
        self.is_picture = !self.is_depth && [PNG, JPEG].iter().any(|head| image.data.starts_with(head));
        let numbers = image.depth().and_then(|_| DepthNumbers::of_format(&image.format));
        self.depth_per_m = numbers.unwrap_or(DepthNumbers::Millimetres).per_m();
        self.shape = format!("images as `{}`", image.format.chars().take(40).collect::<String>());
        let file = image.depth().map_or(image.data, |packed| packed.file);
        if let Some([width, height]) = png_size(file).filter(|_| self.is_depth) {
            self.points = [u64::from(width) * u64::from(height), u64::from(height)];
        }
    }

    fn see_distances(&mut self, depth_m: &[f32]) {
        // what looks along z sees as far as it is deep, but for its edges
        let points =
            depth_m.iter().map(|&depth_m| if depth_m > 0.0 { [0.0, 0.0, f64::from(depth_m)] } else { [0.0; 3] });
        self.distances.add(points, depth_m.len());
    }

    fn see_compressed_distances(&mut self, image: &CompressedImage<'_>) {
        let (file, numbers) = match image.depth() {
            Some(packed) => (packed.file, DepthNumbers::of_format(&image.format).unwrap_or(DepthNumbers::Millimetres)),
            None => (image.data, DepthNumbers::Millimetres),
        };
        let plain = DepthCompression { quant_a: 0.0, quant_b: 0.0, file };
        let packed = image.depth().unwrap_or(plain);
        if let Ok((_, stored)) = read_png16("the image", file, PIXELS_LOOKED_AT) {
            self.see_distances(&packed.depth_m(numbers, &stored, None));
        }
    }

    /// How far a cloud sees, and when its points were taken.
    fn see_cloud(&mut self, message: &PointCloud2<'_>) {
        let wants_times = self.sweeps.stamps.len() < SWEEPS_LOOKED_AT && self.sweeps.are_of(message.header.frame());
        if !(wants_times || self.distances.wants_more()) {
            return;
        }
        let Ok(cloud) = Cloud::new(message) else { return };
        if self.distances.wants_more() {
            self.glimpse.see(cloud.positions(), cloud.len());
        }
        self.distances.add(cloud.positions(), cloud.len());
        if wants_times {
            self.sweeps.add(message.header.stamp, cloud.time().map_or(0.0, |time| time.span_s));
        }
    }

    fn see_directions(&mut self, scan: &LaserScan<'_>) {
        if self.messages % REACH_EVERY == 1
            && let Ok((laser, _)) = scan.laser(&Mounting::IDENTITY)
        {
            self.reach.see(&laser, scan.ranges.iter());
        }
    }

    /// Looks into a message; what is wrong with it, if anything.
    fn look(&mut self, messages: &mut Messages, data: &[u8], trees: &mut Trees) -> Result<(), String> {
        let words = |error: RosError| error.to_string();
        let is_first = self.shape.is_empty();
        match messages {
            Messages::Scan(decoder) => {
                let scan = decoder.decode(data).map_err(words)?;
                self.header(&scan.header);
                self.has_times |= scan.beam_period_s().0 > 0.0;
                self.scenery.see(scan.ranges.iter());
                self.see_directions(&scan);
                if is_first {
                    self.shape = format!("{} beams", scan.ranges.len());
                }
            }
            Messages::MultiEcho(decoder) => {
                let scan = decoder.decode(data).map_err(words)?;
                self.header(&scan.header);
                let (beams, period_s) = (scan.ranges.len(), f64::from(scan.scan_time));
                self.has_times |= settle_times(f64::from(scan.time_increment), period_s, beams).0 > 0.0;
                if self.messages % REACH_EVERY == 1 {
                    self.see_directions(&scan.with_ranges(&scan.first_echoes()));
                }
                if is_first {
                    let echoes = scan.most_echoes();
                    self.shape = format!("{beams} beams of up to {echoes} echoes, of which the nearest counts");
                }
            }
            Messages::Cloud(decoder) => {
                let message = decoder.decode(data).map_err(words)?;
                self.header(&message.header);
                self.see_cloud(&message);
                if is_first {
                    self.cloud(&message)?;
                }
            }
            Messages::Odometry(decoder) => self.odometry(&decoder.decode(data).map_err(words)?),
            Messages::Transforms(decoder) => {
                let transforms = decoder.decode(data).map_err(words)?;
                tree(trees, namespace(&self.name)).see(&transforms, self.name.ends_with("tf_static"));
            }
            Messages::Imu(decoder) => {
                let imu = decoder.decode(data).map_err(words)?;
                self.header(&imu.header);
                if !has_turn_rate(&imu) {
                    return Err(NO_TURN_RATE.to_owned());
                }
            }
            Messages::Image(decoder) => {
                let image = decoder.decode(data).map_err(words)?;
                self.header(&image.header);
                if is_first {
                    self.image(&image);
                }
                let pixels = u64::from(image.width) * u64::from(image.height);
                if self.is_depth
                    && self.distances.wants_more()
                    && pixels <= PIXELS_LOOKED_AT
                    && let Ok(depth_m) = image.depth_m(None)
                {
                    self.see_distances(&depth_m);
                }
            }
            Messages::CompressedImage(decoder) => {
                let image = decoder.decode(data).map_err(words)?;
                self.header(&image.header);
                if is_first {
                    self.compressed_image(&image);
                }
                if self.is_depth && self.distances.wants_more() {
                    self.see_compressed_distances(&image);
                }
            }
            Messages::CameraInfo(decoder) => {
                let info = decoder.decode(data).map_err(words)?;
                self.header(&info.header);
                if self.camera.is_none() {
                    let camera = CameraSurvey::of(&info).map_err(words)?;
                    self.shape = format!("{} x {} pixels", info.width, info.height);
                    self.camera = Some(camera);
                }
            }
            Messages::Livox(decoder) => {
                let scan = decoder.decode(data).map_err(words)?;
                self.header(&scan.header);
                self.has_times |= scan.points.iter().any(|point| point.offset_time > 0);
                if is_first {
                    self.shape = format!("{} points", scan.points.len());
                    self.points = [scan.points.len() as u64, 1];
                }
            }
            Messages::Foxglove(layout) => self.foxglove(&layout.decode(data)?)?,
            Messages::LidarPackets(decoder) => {
                let scan = decoder.decode(data).map_err(words)?;
                self.header(&scan.header);
                self.has_times = true;
                scan.packets.iter().for_each(|packet| self.packets.see(packet.payload()));
                if is_first {
                    let bytes: usize = scan.packets.iter().map(|packet| packet.payload().len()).sum();
                    self.shape = format!("{} packets", scan.packets.len());
                    self.points = [bytes as u64 / BYTES_A_POINT, 1];
                }
            }
            Messages::OusterPackets(decoder) => {
                let packet = decoder.decode(data).map_err(words)?;
                note_frame(&mut self.frames, OUSTER_FRAME);
                self.has_times = true;
                self.packets.see_ouster(packet.buf);
                if is_first {
                    let of = if self.packets.is_inertial { "of its inertial sensor" } else { "of points" };
                    self.shape = format!("packets of {} bytes, {of}", packet.buf.len());
                    self.points = [packet.buf.len() as u64 / BYTES_A_POINT, 1];
                }
            }
            Messages::Range(decoder) => {
                let range = decoder.decode(data).map_err(words)?;
                self.header(&range.header);
                let frame = range.header.frame();
                if !self.sonars.contains_key(frame) && self.sonars.len() < SONARS_KEPT {
                    let said = [range.field_of_view, range.min_range, range.max_range];
                    self.sonars.insert(frame.to_owned(), said);
                }
                if is_first {
                    self.shape = format!("single ranges within {:.0} deg", range.field_of_view.to_degrees());
                }
            }
            Messages::Text(decoder) => {
                let text = decoder.decode(data).map_err(words)?;
                if self.ouster.is_none() && OusterInfo::is_like(&text.data) {
                    self.ouster = Some(OusterInfo::parse(&text.data).map(Arc::new));
                }
            }
            Messages::None(None) if self.type_name.ends_with("/Float32") => self.number = last_float(data),
            Messages::None(None) => {}
            Messages::None(Some(reason)) => return Err(reason.clone()),
        }
        Ok(())
    }
}

/// Transforms by the namespaces of their topics.
type Trees = Vec<(String, Links)>;

fn tree<'a>(trees: &'a mut Trees, namespace: &str) -> &'a mut Links {
    let known = trees.iter().position(|(name, _)| name == namespace);
    let at = known.unwrap_or_else(|| {
        trees.push((namespace.to_owned(), Links::default()));
        trees.len() - 1
    });
    &mut trees[at].1
}

/// `std_msgs/Float32`: four bytes, behind the four that CDR begins with.
fn last_float(data: &[u8]) -> Option<f32> {
    let bytes = data.last_chunk::<4>().filter(|_| matches!(data.len(), 4 | 8))?;
    Some(f32::from_le_bytes(*bytes))
}

/// Pixels across and down, by a PNG's header.
fn png_size(file: &[u8]) -> Option<[u32; 2]> {
    let side = |at: usize| file.get(at..at + 4)?.try_into().ok().map(u32::from_be_bytes);
    Some([side(16)?, side(20)?]).filter(|_| file.starts_with(PNG))
}

/// Stamps of the first clouds of a topic's first frame, and how long their points were taken at most.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Sweeps {
    frame: Option<String>,
    stamps: Vec<Stamp>,
    pub(crate) span_s: f64,
}

impl Sweeps {
    /// Lidars that share a topic come in turn.
    fn are_of(&mut self, frame: &str) -> bool {
        self.frame.get_or_insert_with(|| frame.to_owned()) == frame
    }

    fn add(&mut self, stamp: Stamp, span_s: f64) {
        self.stamps.push(stamp);
        self.span_s = self.span_s.max(span_s);
    }

    /// What the points' times are.
    pub(crate) fn times(&self) -> SweepTimes {
        SweepTimes::of(self.span_s, &self.stamps)
    }
}

const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";
const JPEG: &[u8] = b"\xff\xd8";

/// Whether a compressed image is one of depth: sent as such, or a greyscale PNG of 16 bits.
fn is_depth_file(image: &CompressedImage<'_>) -> bool {
    // a PNG's header has bits and kind of its pixels here
    image.depth().is_some() || (image.data.starts_with(PNG) && image.data.get(24..26) == Some(&[16, 0]))
}

pub(crate) const NO_TURN_RATE: &str = "no turn rate: its covariance begins with -1";

/// By the convention of the message a covariance that begins with -1 says that there is no such reading.
pub(crate) fn has_turn_rate(imu: &Imu<'_>) -> bool {
    imu.angular_velocity_covariance.0[0] != -1.0
}

fn most(frames: &BTreeMap<String, u64>) -> &str {
    frames.iter().max_by_key(|(_, count)| **count).map_or("", |(frame, _)| frame)
}

fn note_frame(frames: &mut BTreeMap<String, u64>, frame: &str) {
    if let Some(count) = frames.get_mut(frame) {
        *count += 1;
    } else if frames.len() < FRAMES_KEPT {
        frames.insert(frame.to_owned(), 1);
    }
}

/// What a recording holds, by a pass over all of it. Memory does not depend on its length.
#[derive(Debug, Clone)]
pub struct Survey {
    /// Topics in the order of their appearance; two of one name where their types differ.
    pub topics: Vec<TopicSurvey>,
    /// Which frame hangs where.
    pub links: Links,
    /// The same by the namespaces of the transforms' topics, where there are several.
    pub(crate) trees: Vec<(String, Links)>,
    /// What the container's reader says.
    pub container: ReadReport,
    /// What an Ouster sensor says of itself in a file beside the recording.
    pub(crate) metadata_beside: Option<Metadata>,
    /// The most memory that the reader's buffers held, bytes.
    pub held_bytes: usize,
}

impl Survey {
    /// Reads a recording from its beginning to its end.
    ///
    /// # Errors
    /// [`BagError`] where it cannot be read at all.
    pub fn of(path: &Path) -> Result<Self, BagError> {
        Ok(Self::look_through(path, &mut |_| true)?.0)
    }

    /// As [`Survey::of`]; `watch` hears now and then how many messages were looked at and says whether to go on. None where it
    /// did not.
    ///
    /// # Errors
    /// [`BagError`] where the recording cannot be read at all.
    pub fn watched(path: &Path, watch: &mut dyn FnMut(u64) -> bool) -> Result<Option<Self>, BagError> {
        let (survey, is_whole) = Self::look_through(path, watch)?;
        Ok(is_whole.then_some(survey))
    }

    fn look_through(path: &Path, watch: &mut dyn FnMut(u64) -> bool) -> Result<(Self, bool), BagError> {
        let mut recording = Recording::open(path)?;
        let (mut decoders, mut trees) = (Decoders::default(), Trees::new());
        let (mut topics, mut topic_of): (Vec<TopicSurvey>, Vec<Option<usize>>) = (Vec::new(), Vec::new());
        let (mut held_bytes, mut seen, mut is_whole) = (0, 0_u64, true);
        while let Some(message) = recording.next_message()? {
            if let Some(at) = place(&mut topics, &mut topic_of, message.connection) {
                let topic = &mut topics[at];
                topic.count(&message);
                if let Err(reason) = topic.look(decoders.of(message.connection), message.data, &mut trees) {
                    topic.undecodable += 1;
                    topic.first_error.get_or_insert(reason);
                }
            }
            held_bytes = held_bytes.max(recording.held_bytes());
            seen += 1;
            if seen.is_multiple_of(WATCHED_EVERY) && !watch(seen) {
                is_whole = false;
                break;
            }
        }
        for connection in recording.connections() {
            place(&mut topics, &mut topic_of, connection);
        }
        let links = match &mut trees[..] {
            [(_, links)] => std::mem::take(links),
            several => joined(several),
        };
        Ok((
            Self { topics, links, trees, container: recording.report().clone(), metadata_beside: None, held_bytes },
            is_whole,
        ))
    }

    /// Hands in the text of a file beside the recording, which may be what an Ouster sensor says of itself.
    pub fn hear_metadata(&mut self, text: &str) {
        if OusterInfo::is_like(text) {
            self.metadata_beside = Some(OusterInfo::parse(text).map(Arc::new));
        }
    }

    /// A topic by its name; the slash in front may be left out.
    #[must_use]
    pub fn topic(&self, name: &str) -> Option<&TopicSurvey> {
        self.topics.iter().find(|topic| same_name(&topic.name, name))
    }

    /// Whether planar scans show that the robot moved.
    pub(crate) fn scans_change(&self) -> bool {
        self.topics.iter().any(|topic| topic.scenery.has_changed)
    }

    /// First and last time of any message, by the times of recording.
    #[must_use]
    pub fn recorded(&self) -> Option<(Stamp, Stamp)> {
        let spans = self.topics.iter().filter_map(|topic| topic.recorded);
        spans.reduce(|all, span| (all.0.min(span.0), all.1.max(span.1)))
    }
}

/// `/scan` is `scan`.
pub(crate) fn same_name(a: &str, b: &str) -> bool {
    a.trim_start_matches('/') == b.trim_start_matches('/')
}

/// Where a connection's topic stands in the list.
fn place(topics: &mut Vec<TopicSurvey>, topic_of: &mut Vec<Option<usize>>, connection: &Connection) -> Option<usize> {
    let id = connection.id as usize;
    if topic_of.len() <= id {
        topic_of.resize(id + 1, None);
    }
    if topic_of[id].is_none() {
        let same = |topic: &TopicSurvey| topic.name == connection.topic && topic.type_name == connection.type_name;
        topic_of[id] = topics.iter().position(same).or_else(|| {
            (topics.len() < TOPICS_KEPT).then(|| {
                topics.push(TopicSurvey::new(connection));
                topics.len() - 1
            })
        });
    }
    topic_of[id]
}
