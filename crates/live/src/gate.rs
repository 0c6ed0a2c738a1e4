//! Scans and clouds wait here until transforms say where they were taken.

mod clouds;
mod odometry;
mod passed;
mod placing;
mod settings;

pub use passed::{Arrived, Passed, Reading};
pub use settings::{GateSettings, KnownSensors};

use crate::gate::clouds::CloudTopic;
use crate::gate::odometry::{Place, Track};
use crate::gate::placing::Mounted;
use crate::pulse::Pulse;
use crate::tally::{Reason, Tally};
use mapwright::SpaceReading;
use mapwright_geom::{Pose, Pose3, Stamp};
use mapwright_ros::messages::{
    Imu as ImuMessage, LaserScan as ScanMessage, Odometry as OdometryMessage, PointCloud2, TfMessage,
};
use mapwright_ros::{Mounting, RosError, TransformBuffer, TransformCounts, TransformLimits, planar};
use mapwright_sensor::{Cloud, ImuReading, LaserModel, LaserScan, SpaceSensor, TurnRate};
use nalgebra::Vector3;
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::Duration;

/// Transforms of so long are kept, seconds.
const WINDOW_S: f64 = 10.0;
/// A clock has been set back once so many scans in a row lie before what is kept.
const SET_BACK_SCANS: u32 = 3;
/// Readings of odometry that wait for a scan before them.
const READINGS_MOST: usize = 10_000;
/// Topics that are told apart.
const TOPICS_MOST: usize = 100;
/// Nothing at all is worth a word after this time.
const NOTHING_YET: Duration = Duration::from_secs(5);

#[derive(Debug)]
enum What {
    Scan(LaserScan),
    Cloud(Cloud),
}

impl What {
    fn stamp(&self) -> Stamp {
        match self {
            Self::Scan(scan) => scan.stamp,
            Self::Cloud(cloud) => cloud.stamp,
        }
    }

    /// When its last point was taken; a scan's beams are laid out by whoever maps it.
    fn end(&self) -> Stamp {
        match self {
            Self::Scan(scan) => scan.stamp,
            Self::Cloud(cloud) => clouds::end(cloud),
        }
    }

    fn frame(&self) -> &str {
        match self {
            Self::Scan(scan) => &scan.laser.name,
            Self::Cloud(cloud) => &cloud.sensor.name,
        }
    }
}

#[derive(Debug)]
struct Waiting {
    topic: String,
    what: What,
    since: Duration,
    /// Whether it says itself where its laser sits and where odometry has the robot.
    is_whole: bool,
}

/// What is known of a topic of scans.
#[derive(Debug, Default)]
struct Topic {
    tally: Tally,
    pulse: Pulse,
    /// The stamp of the last one that passed.
    last: Option<Stamp>,
    /// Why its scans are not used, and since when.
    trouble: Option<(Duration, String)>,
    /// Whether no transform said in time where the last one was taken.
    is_without_place: bool,
    clouds: CloudTopic,
}

/// Scans on their way to the mapper, in the order in which they arrived. Bounded in all that it keeps; a scan that waits longer than
/// [`GateSettings::wait`] goes without odometry, or is dropped where nothing says where its laser sits.
#[derive(Debug)]
pub struct Gate {
    settings: GateSettings,
    transforms: TransformBuffer,
    topics: BTreeMap<String, Topic>,
    waiting: VecDeque<Waiting>,
    readings: VecDeque<Reading>,
    /// What waits for nothing.
    at_once: VecDeque<Reading>,
    odometry: Pulse,
    track: Track,
    /// The latest stamp with which odometry's place was told.
    placed: Option<Stamp>,
    told: Option<Pose3>,
    inertial: Pulse,
    /// The stamp of the last inertial reading.
    felt: Option<Stamp>,
    /// Whether transforms say where odometry has the robot: then messages of odometry say it a second time.
    is_told_by_transforms: bool,
    /// Why the last scan had no odometry.
    without_odometry: Option<String>,
    unknown: Tally,
    lasers: BTreeMap<String, Arc<LaserModel>>,
    sensors: BTreeMap<String, Arc<SpaceSensor>>,
    newest: Option<Stamp>,
    behind: u32,
    set_back: u64,
    is_paused: bool,
}

/// Whether something can be said yet.
enum Ready<T> {
    Now(T),
    Wait,
}

impl Gate {
    /// One that has heard nothing.
    #[must_use]
    pub fn new(settings: GateSettings) -> Self {
        let limits = TransformLimits { window_s: WINDOW_S, ..TransformLimits::default() };
        Self {
            track: Track::new(settings.is_in_space, settings.known.odometry),
            settings,
            transforms: TransformBuffer::new(limits),
            topics: BTreeMap::new(),
            waiting: VecDeque::new(),
            readings: VecDeque::new(),
            at_once: VecDeque::new(),
            odometry: Pulse::default(),
            placed: None,
            told: None,
            inertial: Pulse::default(),
            felt: None,
            is_told_by_transforms: false,
            without_odometry: None,
            unknown: Tally::default(),
            lasers: BTreeMap::new(),
            sensors: BTreeMap::new(),
            newest: None,
            behind: 0,
            set_back: 0,
            is_paused: false,
        }
    }

    /// Each topic of scans, with what became of its messages.
    pub fn tallies(&self) -> impl Iterator<Item = (&str, &Tally)> {
        self.topics.iter().map(|(name, topic)| (name.as_str(), &topic.tally))
    }

    /// What became of messages for whose topics there was no room.
    #[must_use]
    pub fn unknown(&self) -> &Tally {
        &self.unknown
    }

    /// What became of the transforms.
    #[must_use]
    pub fn transforms(&self) -> TransformCounts {
        self.transforms.counts()
    }

    /// How often the clock was set back.
    #[must_use]
    pub fn set_back(&self) -> u64 {
        self.set_back
    }

    /// Takes in transforms; where `is_static`, for all times.
    ///
    /// # Errors
    /// [`RosError::Transform`], the first that was refused; the others are taken in all the same.
    pub fn hear_transforms(
        &mut self,
        message: &TfMessage<'_>,
        is_static: bool,
        arrived: Arrived,
    ) -> Result<(), RosError> {
        let mut result = self.transforms.insert_message(message, is_static);
        let mut told: Vec<Stamp> = Vec::new();
        for transform in &message.transforms {
            let is_odometry = self.transforms.parent(&transform.child_frame_id) == Some(transform.header.frame())
                && self.is_on_the_way(&transform.child_frame_id)
                && !is_static;
            // Of several links at one time one place follows.
            if is_odometry && !told.contains(&transform.header.stamp) {
                told.push(transform.header.stamp);
            }
        }
        for stamp in told {
            self.is_told_by_transforms = true;
            result = result.and(self.hear_place(stamp, arrived));
        }
        result
    }

    /// Takes in a message of odometry: it counts where transforms do not say the same.
    ///
    /// # Errors
    /// [`RosError::Transform`] where it is refused.
    pub fn hear_odometry(&mut self, message: &OdometryMessage<'_>, arrived: Arrived) -> Result<(), RosError> {
        if self.is_told_by_transforms {
            return Ok(());
        }
        let (odom, robot) = (self.settings.odom_frame.clone(), self.settings.robot_frame.clone());
        let Some(pose) = message.pose.pose.to_pose3() else {
            let reason = "its quaternion is zero or not finite".to_owned();
            return Err(RosError::Transform { parent: odom, child: robot, reason });
        };
        let stamp = stamp_or(message.header.stamp, arrived);
        self.transforms.insert(stamp, &odom, &robot, pose, false)?;
        self.hear_place(stamp, arrived)
    }

    /// Takes in a scan of a topic.
    pub fn hear_scan(&mut self, name: &str, message: &ScanMessage<'_>, arrived: Arrived) {
        let now = arrived.since_start;
        let laser = message.laser(&Mounting::IDENTITY);
        let Some(topic) = self.topic(name) else { return };
        topic.tally.arrive(1);
        topic.pulse.beat(now);
        let laser = match laser {
            Ok((laser, _)) if !message.ranges.is_empty() => laser,
            Ok(_) => return topic.refuse(Reason::Unusable, now, "a scan with 0 beams".to_owned()),
            Err(error) => return topic.refuse(Reason::Unusable, now, error.to_string()),
        };
        let scan = LaserScan { stamp: stamp_or(message.header.stamp, arrived), ..message.to_sensor(Arc::new(laser)) };
        self.wait(Waiting { topic: name.to_owned(), what: What::Scan(scan), since: now, is_whole: false });
    }

    /// Takes in a cloud of a topic.
    pub fn hear_cloud(&mut self, name: &str, message: &PointCloud2<'_>, arrived: Arrived) {
        let now = arrived.since_start;
        let Some(topic) = self.topic(name) else { return };
        topic.tally.arrive(1);
        topic.pulse.beat(now);
        match topic.clouds.cloud(name, message, stamp_or(message.header.stamp, arrived)) {
            Ok(cloud) => {
                self.wait(Waiting { topic: name.to_owned(), what: What::Cloud(cloud), since: now, is_whole: false });
            }
            Err(why) => topic.refuse(Reason::Unusable, now, why),
        }
    }

    /// Takes in a cloud of a topic that says itself where its sensor sits and where odometry has the robot, if anything does.
    pub fn hear_whole_cloud(&mut self, name: &str, cloud: Cloud, arrived: Arrived) {
        let Some(topic) = self.topic(name) else { return };
        topic.tally.arrive(1);
        topic.pulse.beat(arrived.since_start);
        let since = arrived.since_start;
        self.wait(Waiting { topic: name.to_owned(), what: What::Cloud(cloud), since, is_whole: true });
    }

    /// Takes in a scan of a topic that says itself where its laser sits and where odometry has the robot, if anything does: it waits for those
    /// before it and for nothing else.
    pub fn hear_whole(&mut self, name: &str, scan: LaserScan, arrived: Arrived) {
        let Some(topic) = self.topic(name) else { return };
        topic.tally.arrive(1);
        topic.pulse.beat(arrived.since_start);
        let since = arrived.since_start;
        self.wait(Waiting { topic: name.to_owned(), what: What::Scan(scan), since, is_whole: true });
    }

    /// Takes in a reading that needs no transform.
    pub fn hear_reading(&mut self, reading: Reading, arrived: Arrived) {
        match reading {
            Reading::Odometry(_) | Reading::InSpace(SpaceReading::Odometry(_)) => {
                self.odometry.beat(arrived.since_start);
            }
            Reading::InSpace(SpaceReading::Imu(reading)) => self.feel(reading.stamp, arrived),
            Reading::Turning(_) => {}
        }
        match reading {
            // As of a recording, whose clouds wait for nothing either.
            Reading::InSpace(_) => push(&mut self.at_once, reading),
            _ => self.push_reading(reading),
        }
    }

    /// Takes in an inertial reading: in the plane what it says of turning about the robot's upright axis, in space all of it.
    ///
    /// # Errors
    /// [`RosError::Transform`] where nothing says how the sensor sits on the robot, or where it reads what cannot be.
    pub fn hear_imu(&mut self, message: &ImuMessage<'_>, arrived: Arrived) -> Result<(), RosError> {
        let stamp = stamp_or(message.header.stamp, arrived);
        let robot = self.settings.robot_frame.as_str();
        let robot_from_sensor = match self.settings.known.imu {
            Some(rotation) => rotation,
            None => self.transforms.lookup(robot, message.header.frame(), stamp)?.rotation,
        };
        let stamp = earlier(stamp, self.settings.known.imu_lag_s);
        // a covariance that begins with -1 says that there is no such reading
        if message.angular_velocity_covariance.0[0] == -1.0 {
            return Ok(());
        }
        let turning = &message.angular_velocity;
        let turning = robot_from_sensor * Vector3::new(turning.x, turning.y, turning.z);
        let force = &message.linear_acceleration;
        let force = Vector3::new(force.x, force.y, force.z);
        let is_felt = message.linear_acceleration_covariance.0[0] != -1.0 && force != Vector3::zeros();
        let reading = ImuReading {
            stamp,
            turn_rate_rad_per_s: turning,
            specific_force_m_per_s2: is_felt.then(|| robot_from_sensor * force),
        };
        if !self.settings.is_in_space && turning.z.is_finite() {
            self.push_reading(Reading::Turning(TurnRate { stamp, rad_per_s: turning.z }));
        } else if self.settings.is_in_space {
            if !reading.is_sound() {
                let (parent, child) = (robot.to_owned(), message.header.frame().to_owned());
                let reason = format!(
                    "an inertial reading of {} rad/s and {} m/s^2: not finite, or beyond 100 rad/s or 500 m/s^2",
                    turning.norm(),
                    force.norm()
                );
                return Err(RosError::Transform { parent, child, reason });
            }
            self.feel(stamp, arrived);
            self.push_reading(Reading::InSpace(SpaceReading::Imu(reading)));
        }
        Ok(())
    }

    fn feel(&mut self, stamp: Stamp, arrived: Arrived) {
        self.inertial.beat(arrived.since_start);
        // The last, not the newest: one stamp far ahead would say for ever that all is felt.
        self.felt = Some(stamp);
    }

    fn wait(&mut self, waiting: Waiting) {
        self.watch_clock(waiting.what.stamp());
        if self.is_paused {
            if let Some(topic) = self.topics.get_mut(&waiting.topic) {
                topic.tally.drop_one(Reason::Paused);
            }
            return;
        }
        if self.waiting.len() >= self.settings.waiting_most.max(1) {
            self.drop_oldest(Reason::Overtaken);
        }
        self.waiting.push_back(waiting);
    }

    fn push_reading(&mut self, reading: Reading) {
        push(&mut self.readings, reading);
    }

    /// A message of a topic that is no scan, or one whose bytes are none: counted.
    pub fn hear_unreadable(&mut self, name: &str, error: &RosError, arrived: Arrived) {
        if let Some(topic) = self.topic(name) {
            topic.tally.arrive(1);
            topic.refuse(Reason::Unreadable, arrived.since_start, error.to_string());
        }
    }

    /// Scans of a topic that were overtaken before they came here.
    pub fn overtaken(&mut self, name: &str, count: u64) {
        if let Some(topic) = self.topic(name) {
            topic.tally.arrive(count);
            topic.tally.drop_many(Reason::Overtaken, count);
        }
    }

    /// The next that is for the mapper, if any is by now.
    pub fn next(&mut self, now: Duration) -> Option<Passed> {
        loop {
            if let Some(reading) = self.at_once.pop_front() {
                return Some(Passed::Reading(reading));
            }
            let end = self.waiting.front().map(|waiting| waiting.what.end());
            let is_next = |reading: &mut Reading| end.is_none_or(|end| reading.stamp() <= end);
            if let Some(reading) = self.readings.pop_front_if(is_next) {
                return Some(Passed::Reading(reading));
            }
            let waiting = self.waiting.front()?;
            let (since, stamp, frame) = (waiting.since, waiting.what.stamp(), waiting.what.frame().to_owned());
            let topic = self.topics.get(&waiting.topic);
            let has_waited = now.saturating_sub(since) >= self.settings.wait;
            // Where others of its topic have waited for it in vain, nobody waits for its place: no scan of another sensor does either.
            let is_without_place = topic.is_some_and(|topic| topic.is_without_place);
            // Clocks that are corrected step back a little: what was taken then is mapped as of a recording.
            let is_over = |last: Stamp| stamp == last || last.secs_since(stamp) > WINDOW_S;
            if topic.is_some_and(|topic| topic.last.is_some_and(is_over)) {
                self.drop_oldest(Reason::Late);
                continue;
            }
            if !waiting.is_whole && !self.is_felt(&waiting.what, has_waited, now) {
                return None;
            }
            let placed = if waiting.is_whole {
                None
            } else {
                let place = match self.place(&frame, stamp, has_waited || is_without_place) {
                    Ready::Wait => return None,
                    Ready::Now(Ok(place)) => place,
                    Ready::Now(Err(error)) => {
                        self.refuse_oldest(now, &error);
                        continue;
                    }
                };
                let Ready::Now(odom_from_robot) = self.odometry_at(stamp, has_waited, now) else { return None };
                self.told = self.told_at(stamp).or(self.told);
                Some((place, odom_from_robot))
            };
            let Waiting { topic, what, .. } = self.waiting.pop_front()?;
            if let Some(topic) = self.topics.get_mut(&topic) {
                topic.tally.use_one();
                (topic.last, topic.trouble, topic.is_without_place) = (Some(stamp), None, false);
            }
            return Some(self.passed(what, placed));
        }
    }

    /// A scan or a cloud where it was taken.
    fn passed(&mut self, what: What, placed: Option<(Mounted, Option<Place>)>) -> Passed {
        match (what, placed) {
            (What::Scan(mut scan), Some((Mounted::InPlane(mounting), odom_from_robot))) => {
                scan.laser = self.placed(&scan.laser, &mounting);
                scan.odom_from_robot = match odom_from_robot {
                    Some(Place::InPlane(pose)) => Some(pose),
                    Some(Place::InSpace(pose)) => Some(planar(&pose)),
                    None => None,
                };
                Passed::Scan(scan)
            }
            (What::Cloud(mut cloud), Some((Mounted::InSpace(robot_from_sensor), odom_from_robot))) => {
                cloud.sensor = self.placed_in_space(&cloud.sensor, robot_from_sensor);
                cloud.odom_from_robot = match odom_from_robot {
                    Some(Place::InSpace(pose)) => Some(pose),
                    _ => None,
                };
                Passed::Cloud(cloud)
            }
            (What::Scan(scan), _) => Passed::Scan(scan),
            (What::Cloud(cloud), _) => Passed::Cloud(cloud),
        }
    }

    /// Drops all scans that wait.
    pub fn drop_waiting(&mut self) {
        while !self.waiting.is_empty() {
            self.drop_oldest(Reason::Paused);
        }
    }

    /// Whether scans are dropped as they come; odometry and transforms are heard all the same.
    pub fn pause(&mut self, is_paused: bool) {
        self.is_paused = is_paused;
        if is_paused {
            self.drop_waiting();
        }
    }

    /// What the robot lacks by now, in words.
    #[must_use]
    pub fn missing(&self, now: Duration) -> Vec<String> {
        let mut words = Vec::new();
        if self.topics.is_empty() && now > NOTHING_YET {
            let what = if self.settings.is_in_space { "cloud" } else { "scan" };
            words.push(format!("no {what} has arrived for {:.0} s", now.as_secs_f64()));
        }
        for (name, topic) in &self.topics {
            if let Some(silent) = topic.pulse.fallen_silent(now) {
                words.push(format!("{name} is {silent}"));
            } else if let Some((since, why)) = &topic.trouble {
                let for_s = now.saturating_sub(*since).as_secs_f64();
                words.push(format!("{name} arrives and has not been used for {for_s:.1} s: {why}"));
            } else if let Some(odd) = &topic.clouds.odd {
                words.push(format!("{name}: {odd}"));
            }
        }
        let what = if self.settings.is_in_space { "clouds" } else { "scans" };
        words.extend(self.without_odometry.as_ref().map(|why| format!("{what} are mapped without odometry: {why}")));
        words
    }

    /// The topic of a name; counted where there is no room for another.
    fn topic(&mut self, name: &str) -> Option<&mut Topic> {
        if !self.topics.contains_key(name) && self.topics.len() >= TOPICS_MOST {
            self.unknown.arrive(1);
            self.unknown.drop_one(Reason::UnknownTopic);
            return None;
        }
        Some(self.topics.entry(name.to_owned()).or_default())
    }

    /// Odometry has told where the robot is.
    fn hear_place(&mut self, stamp: Stamp, arrived: Arrived) -> Result<(), RosError> {
        self.odometry.beat(arrived.since_start);
        let (odom, robot) = (&self.settings.odom_frame, &self.settings.robot_frame);
        let there = self.transforms.lookup(odom, robot, stamp).ok().map(|pose| (stamp, pose)).or_else(|| {
            // Of several links that move each is told by itself: the place is known up to the one that was told first.
            let last = self.transforms.known_times(odom, robot).ok()??.1;
            let is_new = self.placed.is_none_or(|placed| last > placed);
            Some((last, self.transforms.lookup(odom, robot, last).ok().filter(|_| is_new)?))
        });
        let Some((stamp, pose)) = there else { return Ok(()) };
        self.placed = self.placed.max(Some(stamp));
        let Some(reading) = self.track.add(stamp, pose) else {
            let reason = format!("odometry is at {:e} m, {:e} m, too far out", pose.translation.x, pose.translation.y);
            return Err(RosError::Transform { parent: odom.clone(), child: robot.clone(), reason });
        };
        self.push_reading(reading);
        Ok(())
    }

    /// Where odometry had the robot when the last scan or cloud was taken that passed: as it is told, and as others therefore look it up, not as it
    /// is mapped with. None where nobody has told.
    #[must_use]
    pub fn told(&self) -> Option<Pose3> {
        self.told
    }

    /// Odometry's pose as it is told, at a stamp or the last before.
    fn told_at(&self, stamp: Stamp) -> Option<Pose3> {
        let (odom, robot) = (&self.settings.odom_frame, &self.settings.robot_frame);
        let at = |stamp| self.transforms.lookup(odom, robot, stamp).ok();
        let pose = at(stamp).or_else(|| at(self.transforms.known_times(odom, robot).ok()??.1))?;
        Some(if self.settings.is_in_space { pose } else { planar(&pose).in_space() })
    }

    /// Whether what an inertial sensor feels until the end of a cloud is known, or nobody waits for it any more.
    fn is_felt(&self, what: &What, has_waited: bool, now: Duration) -> bool {
        let is_over = has_waited || self.inertial.silence(now) >= self.settings.wait;
        matches!(what, What::Scan(_)) || is_over || self.felt.is_none_or(|felt| felt >= what.end())
    }

    /// Odometry's pose at a stamp: between the readings around it; else, once nothing later comes, the one before.
    fn odometry_at(&mut self, stamp: Stamp, has_waited: bool, now: Duration) -> Ready<Option<Place>> {
        let span = self.track.span();
        if span.is_some_and(|[first, _]| stamp < first) {
            return Ready::Now(None);
        }
        let is_over = has_waited || self.odometry.silence(now) >= self.settings.wait;
        // Where what is told runs ahead of what was true, others look up the place at the stamp itself.
        let is_told = self.placed.is_some_and(|placed| stamp <= placed);
        if !is_over && (span.is_none_or(|[_, last]| stamp > last) || !is_told) {
            return Ready::Wait;
        }
        let place = self.track.at(stamp);
        self.without_odometry = if place.is_none() {
            let error = self.transforms.lookup(&self.settings.odom_frame, &self.settings.robot_frame, stamp).err();
            Some(error.map_or_else(|| "its readings are too far apart".to_owned(), |error| error.to_string()))
        } else {
            None
        };
        Ready::Now(place)
    }

    fn drop_oldest(&mut self, reason: Reason) {
        let oldest = self.waiting.pop_front();
        if let Some(topic) = oldest.and_then(|oldest| self.topics.get_mut(&oldest.topic)) {
            topic.tally.drop_one(reason);
        }
    }

    fn refuse_oldest(&mut self, now: Duration, error: &RosError) {
        let reason = if matches!(error, RosError::Tilted { .. }) { Reason::Unusable } else { Reason::NoMount };
        let oldest = self.waiting.pop_front();
        if let Some(topic) = oldest.and_then(|oldest| self.topics.get_mut(&oldest.topic)) {
            topic.is_without_place = reason == Reason::NoMount;
            topic.refuse(reason, now, error.to_string());
        }
    }

    /// A clock that was set back, as a simulation's is that begins again, makes all that is kept useless. One scan that is late does not.
    fn watch_clock(&mut self, stamp: Stamp) {
        let newest = self.newest.map_or(stamp, |newest| newest.max(stamp));
        self.behind = if newest.secs_since(stamp) > WINDOW_S { self.behind + 1 } else { 0 };
        self.newest = Some(newest);
        if self.behind < SET_BACK_SCANS {
            return;
        }
        (self.newest, self.behind, self.set_back, self.felt) = (Some(stamp), 0, self.set_back + 1, None);
        self.transforms.forget_moving();
        self.track.clear();
        (self.placed, self.told) = (None, None);
        self.readings.clear();
        self.topics.values_mut().for_each(|topic| topic.last = None);
        let before: Vec<Waiting> = self.waiting.drain(..).collect();
        for waiting in before {
            if waiting.what.stamp().secs_since(stamp).abs() <= WINDOW_S {
                self.waiting.push_back(waiting);
            } else if let Some(topic) = self.topics.get_mut(&waiting.topic) {
                topic.tally.drop_one(Reason::Late);
            }
        }
    }
}

impl Topic {
    fn refuse(&mut self, reason: Reason, now: Duration, why: String) {
        self.tally.drop_one(reason);
        let since = self.trouble.take().map_or(now, |(since, _)| since);
        self.trouble = Some((since, why));
    }
}

/// The oldest makes room.
fn push(readings: &mut VecDeque<Reading>, reading: Reading) {
    if readings.len() >= READINGS_MOST {
        readings.pop_front();
    }
    readings.push_back(reading);
}

fn earlier(stamp: Stamp, by_s: f64) -> Stamp {
    Stamp(stamp.0.saturating_sub(Stamp::from_secs_f64(by_s).0))
}

/// The stamp of a header, or when its message arrived where it has none.
fn stamp_or(stamp: Stamp, arrived: Arrived) -> Stamp {
    if stamp.0 == 0 { arrived.stamp } else { stamp }
}

#[cfg(test)]
mod tests;
