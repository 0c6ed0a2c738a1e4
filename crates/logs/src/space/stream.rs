//! The second pass over a recording of space: its clouds and inertial readings.

use super::imu;
use super::maker::{CloudMaker, Made};
use super::pair_maker::Side;
use super::plan::SpacePlan;
use super::queue::{Queue, Waiting};
use super::topic::TopicPlan;
use crate::channel::{Decoders, Messages, TopicKind};
use crate::error::LogError;
use crate::links::{bare, stamp_or};
use crate::merge::WINDOW_S;
use crate::odometry::OdometrySource;
use crate::survey::{Survey, same_name};
use mapwright_bags::{Connection, RawMessage, Recording};
use mapwright_clouds::{NoteKind, Notes};
use mapwright_geom::{Pose3, Stamp};
use mapwright_sensor::{Cloud, CorrectedOdometry, ImuReading, OdometryReading, OdometryTrack};
use std::path::Path;

/// Odometry farther from its origin than this is none, metres.
const FARTHEST_M: f64 = 1e6;

/// What a connection is used for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Use {
    /// Of the sensor with this number.
    Clouds(usize),
    /// Of the pair of cameras with this number.
    Pair(usize, Side),
    Odometry,
    Imu,
    Nothing,
}

/// What a recording of space delivers.
#[derive(Debug, Clone, PartialEq)]
pub enum SpaceEvent {
    /// A reading of the inertial sensor, turned into the robot's frame.
    Imu(ImuReading),
    /// Odometry was read at this stamp; what it said comes with the clouds.
    Odometry(Stamp),
    /// A cloud.
    Cloud(Cloud),
}

/// The clouds of a recording according to a plan, in order of their arrival; those of several sensors in order of their stamps. One waits
/// for odometry as recent as itself and inertial readings as recent as its end, which come before it, and for clouds of the other sensors
/// that are no older, over at most 2 s of arrival, 4096 clouds and 64 MiB of them.
#[derive(Debug)]
pub struct SpaceStream {
    name: String,
    recording: Recording,
    survey: Survey,
    plan: SpacePlan,
    makers: Vec<CloudMaker>,
    /// Whether lasers tilt.
    has_joints: bool,
    decoders: Decoders,
    uses: Vec<Option<Use>>,
    waiting: Queue,
    wheels: OdometryTrack<Pose3>,
    /// Takes out what is known to be wrong with odometry.
    corrected: Option<CorrectedOdometry<Pose3>>,
    /// A reading that was not delivered yet, and the stamp of the last one.
    reading: Option<SpaceEvent>,
    last_reading: Option<Stamp>,
    notes: Notes,
    /// When the newest message was recorded.
    now: Stamp,
    read: u64,
    delivered: u64,
    first_failure: Option<String>,
    /// Of each sensor.
    last_stamps: Vec<Option<Stamp>>,
    is_end: bool,
}

impl SpaceStream {
    /// Opens a recording for its second pass; `name` is that for errors.
    ///
    /// # Errors
    /// [`LogError`] where it cannot be opened any more.
    pub fn open(name: &str, path: &Path, survey: Survey, plan: SpacePlan) -> Result<Self, LogError> {
        let recording = Recording::open(path).map_err(|cause| LogError::Recording { name: name.to_owned(), cause })?;
        Ok(Self {
            name: name.to_owned(),
            recording,
            survey,
            makers: plan.sources.iter().map(CloudMaker::new).collect(),
            has_joints: plan.sources.iter().any(|source| source.joint.is_some()),
            waiting: Queue::new(plan.sources.len()),
            last_stamps: vec![None; plan.sources.len()],
            corrected: plan.calibration.map(CorrectedOdometry::new),
            plan,
            decoders: Decoders::default(),
            uses: Vec::new(),
            wheels: OdometryTrack::default(),
            reading: None,
            last_reading: None,
            notes: Notes::default(),
            now: Stamp(0),
            read: 0,
            delivered: 0,
            first_failure: None,
            is_end: false,
        })
    }

    /// What the first pass has found.
    #[must_use]
    pub fn survey(&self) -> &Survey {
        &self.survey
    }

    /// What is mapped, and why.
    #[must_use]
    pub fn plan(&self) -> &SpacePlan {
        &self.plan
    }

    /// What was found to be wrong with messages so far; the places are topics and bytes of the recording.
    #[must_use]
    pub fn notes(&self) -> &Notes {
        &self.notes
    }

    /// What casts doubt on a map of what was read so far, in words.
    pub fn doubts(&self) -> impl Iterator<Item = &String> {
        self.makers.iter().flat_map(CloudMaker::doubts)
    }

    /// The next cloud; none at the end. Readings before it are passed over.
    ///
    /// # Errors
    /// [`LogError::Recording`] where the file fails, [`LogError::Refused`] at the end, if not one message was a cloud.
    pub fn next_cloud(&mut self) -> Result<Option<Cloud>, LogError> {
        loop {
            match self.next_event()? {
                Some(SpaceEvent::Cloud(cloud)) => return Ok(Some(cloud)),
                Some(SpaceEvent::Imu(_) | SpaceEvent::Odometry(_)) => {}
                None => return Ok(None),
            }
        }
    }

    /// The next cloud or reading; none at the end.
    ///
    /// # Errors
    /// As [`SpaceStream::next_cloud`].
    pub fn next_event(&mut self) -> Result<Option<SpaceEvent>, LogError> {
        loop {
            if let Some(reading) = self.reading.take() {
                return Ok(Some(reading));
            }
            if let Some(cloud) = self.pop() {
                self.delivered += 1;
                return Ok(Some(SpaceEvent::Cloud(cloud)));
            }
            if self.is_end {
                return self.end();
            }
            self.read()?;
        }
    }

    fn end(&self) -> Result<Option<SpaceEvent>, LogError> {
        match &self.first_failure {
            Some(first) if self.delivered == 0 => {
                let reason = format!("none of the messages of {} can be mapped; the first: {first}", self.plan.topic);
                Err(LogError::Refused { name: self.name.clone(), reason })
            }
            _ => Ok(None),
        }
    }

    /// Takes in one more message.
    fn read(&mut self) -> Result<(), LogError> {
        let next = self.recording.next_message();
        let next = next.map_err(|cause| LogError::Recording { name: self.name.clone(), cause })?;
        let Some(message) = next else {
            self.is_end = true;
            self.take_swings(0);
            for source in 0..self.makers.len() {
                let last = self.makers[source].finish(&mut self.notes);
                last.into_iter().for_each(|made| self.take(source, made, 0));
            }
            return Ok(());
        };
        self.read += 1;
        self.now = message.log_stamp;
        let at = message.offset_bytes;
        let place = usize::try_from(at).unwrap_or(usize::MAX);
        if self.has_joints
            && let Messages::Transforms(decoder) = self.decoders.of(message.connection)
            && let Ok(transforms) = decoder.decode(message.data)
        {
            self.makers.iter_mut().for_each(|maker| maker.hear(&transforms, message.log_stamp));
        }
        match used(&mut self.uses, message.connection, &self.plan) {
            Use::Nothing => {}
            Use::Clouds(source) => {
                let messages = self.decoders.of(message.connection);
                match self.makers[source].make(messages, &message, &mut self.notes) {
                    Ok(all) => all.into_iter().for_each(|made| self.take(source, made, at)),
                    Err(reason) => {
                        self.first_failure.get_or_insert_with(|| reason.clone());
                        let words = || ("a message that can be mapped", reason);
                        self.notes.note(NoteKind::UnreadableFrame, &self.plan.sources[source].topic, place, words);
                    }
                }
            }
            Use::Pair(source, side) => {
                let messages = self.decoders.of(message.connection);
                match self.makers[source].make_of_pair(side, messages, &message, &mut self.notes) {
                    Ok(all) => all.into_iter().for_each(|made| self.take(source, made, at)),
                    Err(reason) => {
                        self.first_failure.get_or_insert_with(|| reason.clone());
                        let words = || ("an image of a pair", reason);
                        self.notes.note(NoteKind::UnreadableFrame, &message.connection.topic, place, words);
                    }
                }
            }
            Use::Imu => {
                let Some(source) = &self.plan.imu else { return Ok(()) };
                let messages = self.decoders.of(message.connection);
                if let Messages::OusterPackets(decoder) = messages {
                    let reading =
                        decoder.decode(message.data).ok().and_then(|packet| self.makers.first()?.reading(packet.buf));
                    if let Some(reading) = reading {
                        let turned = imu::turned(source, reading);
                        self.take_reading(turned, false, place);
                    }
                    return Ok(());
                }
                match imu::reading(source, messages, message.data, message.log_stamp) {
                    Ok((reading, is_unstamped)) => self.take_reading(reading, is_unstamped, place),
                    Err(reason) => {
                        let words = || ("an inertial reading", reason);
                        self.notes.note(NoteKind::UnreadableImu, &source.name, place, words);
                    }
                }
            }
            Use::Odometry => {
                let messages = self.decoders.of(message.connection);
                let taken =
                    take_odometry(&self.plan.odometry, messages, &message, (&mut self.corrected, &mut self.wheels));
                if let Ok(stamp) = taken {
                    self.reading = stamp.map(SpaceEvent::Odometry);
                } else if let Err(reason) = taken {
                    let topic = &message.connection.topic;
                    self.notes.note(NoteKind::UnreadableOdometry, topic, place, || ("a pose", reason));
                }
            }
        }
        if self.has_joints {
            self.take_swings(at);
        }
        Ok(())
    }

    /// Takes in the clouds of lasers that tilt whose swings have ended.
    fn take_swings(&mut self, at: u64) {
        for source in 0..self.makers.len() {
            let swings = self.makers[source].swings(&self.wheels, self.now, self.is_end, &mut self.notes);
            swings.into_iter().for_each(|made| self.take(source, made, at));
        }
    }

    fn take_reading(&mut self, reading: ImuReading, is_unstamped: bool, place: usize) {
        let (topic, lag_s) = self.plan.imu.as_ref().map_or(("", 0.0), |source| (source.name.as_str(), source.lag_s));
        let reading =
            ImuReading { stamp: Stamp(reading.stamp.0.saturating_sub(Stamp::from_secs_f64(lag_s).0)), ..reading };
        if is_unstamped {
            self.notes.note(NoteKind::RecordedStamp, topic, place, || ("a stamp in the header", "zero"));
        }
        if let Some(last) = self.last_reading.filter(|last| reading.stamp < *last) {
            let words = || (format!("a stamp after {}", seconds(last)), seconds(reading.stamp));
            self.notes.note(NoteKind::BackwardStamp, topic, place, words);
        }
        self.last_reading = Some(reading.stamp);
        self.reading = Some(SpaceEvent::Imu(reading));
    }

    fn take(&mut self, source: usize, made: Made, offset_bytes: u64) {
        let Made { cloud, is_unstamped, not_finite, refused_time } = made;
        let topic = self.plan.sources[source].topic.as_str();
        let place = usize::try_from(offset_bytes).unwrap_or(usize::MAX);
        let notes = &mut self.notes;
        if is_unstamped {
            notes.note(NoteKind::RecordedStamp, topic, place, || ("a stamp in the header", "zero"));
        }
        if let Some([expected, found]) = refused_time {
            notes.note(NoteKind::BadPointTimes, topic, place, || (expected, found));
        }
        let points = cloud.points_m.len();
        if points == 0 {
            notes.note(NoteKind::EmptyCloud, topic, place, || ("points", "none"));
        }
        if not_finite > 0 {
            let words = || ("finite points", format!("{not_finite} of {points} that are not"));
            notes.note(NoteKind::NotFinite, topic, place, words);
        }
        let last_s = cloud.times_s.iter().copied().filter(|s| s.is_finite()).fold(0.0_f32, f32::max);
        let end = Stamp(cloud.stamp.0.saturating_add(Stamp::from_secs_f64(f64::from(last_s).min(WINDOW_S)).0));
        self.waiting.push(source, Waiting { cloud, end, recorded: self.now, offset_bytes });
    }

    /// The next cloud, where the wheels' reading and the inertial ones are there or have been waited for long enough.
    fn pop(&mut self) -> Option<Cloud> {
        let has_odometry = self.plan.odometry != OdometrySource::None;
        let has_imu = self.plan.imu.is_some();
        let newest_reading = self.last_reading;
        let newest_count = self.wheels.newest();
        let is_due = |first: &Waiting| {
            let is_counted = !has_odometry || newest_count.is_some_and(|newest| newest.stamp >= first.cloud.stamp);
            let is_felt = !has_imu || newest_reading.is_some_and(|newest| newest >= first.end);
            is_counted && is_felt
        };
        let (source, Waiting { mut cloud, offset_bytes, .. }) = self.waiting.pop(self.now, self.is_end, is_due)?;
        cloud.odom_from_robot = self.wheels.at(cloud.stamp);
        let topic = self.plan.sources[source].topic.as_str();
        let place = usize::try_from(offset_bytes).unwrap_or(usize::MAX);
        if has_odometry && cloud.odom_from_robot.is_none() {
            let words = || ("odometry within 2 s before the cloud", format!("none at {}", seconds(cloud.stamp)));
            self.notes.note(NoteKind::WithoutOdometry, topic, place, words);
        }
        if let Some(last) = self.last_stamps[source].filter(|last| cloud.stamp < *last) {
            let words = || (format!("a stamp after {}", seconds(last)), seconds(cloud.stamp));
            self.notes.note(NoteKind::BackwardStamp, topic, place, words);
        }
        self.last_stamps[source] = Some(cloud.stamp);
        Some(cloud)
    }
}

fn seconds(stamp: Stamp) -> String {
    format!("{:.6} s", stamp.as_secs_f64())
}

fn used(uses: &mut Vec<Option<Use>>, connection: &Connection, plan: &SpacePlan) -> Use {
    let at = connection.id as usize;
    if uses.len() <= at {
        uses.resize(at + 1, None);
    }
    *uses[at].get_or_insert_with(|| {
        let kind = TopicKind::of(&connection.type_name);
        let is_odometry = match &plan.odometry {
            OdometrySource::None => false,
            OdometrySource::Topic { name, .. } => kind == TopicKind::Odometry && same_name(name, &connection.topic),
            OdometrySource::Transforms { .. } => kind == TopicKind::Transforms,
        };
        let is_source = |source: &TopicPlan| kind == source.kind && same_name(&source.topic, &connection.topic);
        let is_right = |source: &TopicPlan| {
            let of = source.stereo.as_ref();
            of.is_some_and(|of| kind == of.right_kind && same_name(&of.right, &connection.topic))
        };
        if let Some(source) = plan.sources.iter().position(is_right) {
            Use::Pair(source, Side::Right)
        } else if let Some(source) = plan.sources.iter().position(is_source) {
            let is_pair = plan.sources[source].stereo.is_some();
            if is_pair { Use::Pair(source, Side::Left) } else { Use::Clouds(source) }
        } else if matches!(kind, TopicKind::Imu | TopicKind::OusterPackets)
            && plan.imu.as_ref().is_some_and(|imu| same_name(&imu.name, &connection.topic))
        {
            Use::Imu
        } else if is_odometry {
            Use::Odometry
        } else {
            Use::Nothing
        }
    })
}

fn take_odometry(
    source: &OdometrySource,
    messages: &mut Messages,
    message: &RawMessage<'_>,
    (corrected, wheels): (&mut Option<CorrectedOdometry<Pose3>>, &mut OdometryTrack<Pose3>),
) -> Result<Option<Stamp>, String> {
    let mut newest = None;
    let mut add = |header: Stamp, odom_from_child: Option<Pose3>, child_from_robot: Pose3| {
        let odom_from_robot = odom_from_child.map(|pose| pose * child_from_robot);
        let is_usable = |pose: &Pose3| pose.is_finite() && pose.translation.norm() <= FARTHEST_M;
        let usable =
            odom_from_robot.filter(is_usable).ok_or("none that is finite, within 10^6 m and has a rotation")?;
        let stamp = stamp_or(header, message.log_stamp).0;
        let (stamp, usable) = match corrected {
            Some(corrected) => (corrected.stamp(stamp), corrected.pose(usable)),
            None => (stamp, usable),
        };
        wheels.add(OdometryReading { stamp, odom_from_robot: usable, is_anew: false });
        newest = newest.max(Some(stamp));
        Ok::<(), String>(())
    };
    match (source, messages) {
        (OdometrySource::Topic { child_from_robot, .. }, Messages::Odometry(decoder)) => {
            let odometry = decoder.decode(message.data).map_err(|error| error.to_string())?;
            add(odometry.header.stamp, odometry.pose.pose.to_pose3(), *child_from_robot)?;
        }
        (OdometrySource::Transforms { parent, child, child_from_robot }, Messages::Transforms(decoder)) => {
            let transforms = decoder.decode(message.data).map_err(|error| error.to_string())?;
            let is_its = |header: &str, of: &str| header == parent && bare(of) == child;
            let links = transforms.transforms.iter();
            for link in links.filter(|link| is_its(link.header.frame(), &link.child_frame_id)) {
                add(link.header.stamp, link.transform.to_pose3(), *child_from_robot)?;
            }
        }
        (_, Messages::None(Some(reason))) => return Err(reason.clone()),
        _ => {}
    }
    Ok(newest)
}
