//! Scans wait here until transforms say where they were taken.

use crate::pulse::Pulse;
use crate::tally::{Reason, Tally};
use mapwright_geom::{Pose2, Stamp};
use mapwright_ros::messages::{Imu as ImuMessage, LaserScan as ScanMessage, Odometry as OdometryMessage, TfMessage};
use mapwright_ros::{Mounting, RosError, TransformBuffer, TransformCounts, TransformLimits, planar};
use mapwright_sensor::{LaserModel, LaserScan, Odometry, TurnRate};
use nalgebra::Vector3;
use std::collections::{BTreeMap, VecDeque};
use std::sync::Arc;
use std::time::Duration;

/// A laser's plane is tilted by no more, degrees: else a wall is not where it seems.
const TILT_MOST_DEG: f64 = 5.0;
/// Odometry's last pose stands for one that does not come for so long, seconds.
const ODOMETRY_GAP_S: f64 = 2.0;
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

/// What a gate is told of the robot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GateSettings {
    /// The robot's own frame.
    pub robot_frame: String,
    /// The frame in which odometry has the robot.
    pub odom_frame: String,
    /// A scan waits for its transforms so long at most.
    pub wait: Duration,
    /// So many scans wait at most; the oldest makes room.
    pub waiting_most: usize,
}

impl Default for GateSettings {
    fn default() -> Self {
        Self {
            robot_frame: "base_link".to_owned(),
            odom_frame: "odom".to_owned(),
            wait: Duration::from_millis(500),
            waiting_most: 100,
        }
    }
}

/// When a message arrived.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Arrived {
    /// Since the start, by a clock that is never set.
    pub since_start: Duration,
    /// By the clock that stamps are of: that of messages that have none.
    pub stamp: Stamp,
}

/// What comes through the gate.
#[derive(Debug, Clone, PartialEq)]
pub enum Passed {
    /// A scan, with its laser's place on the robot and odometry's pose at its stamp.
    Scan(LaserScan),
    /// What was read between scans.
    Reading(Reading),
}

/// What is read of the robot's motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reading {
    /// Where odometry has it.
    Odometry(Odometry),
    /// How fast a gyroscope says that it turns.
    Turning(TurnRate),
}

impl Reading {
    fn stamp(&self) -> Stamp {
        match self {
            Self::Odometry(odometry) => odometry.stamp,
            Self::Turning(rate) => rate.stamp,
        }
    }
}

#[derive(Debug)]
struct Waiting {
    topic: String,
    scan: LaserScan,
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
    odometry: Pulse,
    /// Whether transforms say where odometry has the robot: then messages of odometry say it a second time.
    is_told_by_transforms: bool,
    /// Why the last scan had no odometry.
    without_odometry: Option<String>,
    unknown: Tally,
    lasers: BTreeMap<String, Arc<LaserModel>>,
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
            settings,
            transforms: TransformBuffer::new(limits),
            topics: BTreeMap::new(),
            waiting: VecDeque::new(),
            readings: VecDeque::new(),
            odometry: Pulse::default(),
            is_told_by_transforms: false,
            without_odometry: None,
            unknown: Tally::default(),
            lasers: BTreeMap::new(),
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
        let result = self.transforms.insert_message(message, is_static);
        for transform in &message.transforms {
            let is_odometry = self.transforms.parent(&transform.child_frame_id) == Some(transform.header.frame())
                && self.is_on_the_way(&transform.child_frame_id)
                && !is_static;
            if is_odometry {
                self.is_told_by_transforms = true;
                self.hear_place(transform.header.stamp, arrived);
            }
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
        self.hear_place(stamp, arrived);
        Ok(())
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
        self.wait(Waiting { topic: name.to_owned(), scan, since: now, is_whole: false });
    }

    /// Takes in a scan of a topic that says itself where its laser sits and where odometry has the robot, if anything does: it waits for those
    /// before it and for nothing else.
    pub fn hear_whole(&mut self, name: &str, scan: LaserScan, arrived: Arrived) {
        let Some(topic) = self.topic(name) else { return };
        topic.tally.arrive(1);
        topic.pulse.beat(arrived.since_start);
        self.wait(Waiting { topic: name.to_owned(), scan, since: arrived.since_start, is_whole: true });
    }

    /// Takes in a reading that needs no transform.
    pub fn hear_reading(&mut self, reading: Reading, arrived: Arrived) {
        if matches!(reading, Reading::Odometry(_)) {
            self.odometry.beat(arrived.since_start);
        }
        self.push_reading(reading);
    }

    /// Takes in an inertial reading: what it says of turning about the robot's upright axis.
    ///
    /// # Errors
    /// [`RosError::Transform`] where nothing says how the sensor sits on the robot.
    pub fn hear_imu(&mut self, message: &ImuMessage<'_>, arrived: Arrived) -> Result<(), RosError> {
        let stamp = stamp_or(message.header.stamp, arrived);
        let robot_from_sensor = self.transforms.lookup(&self.settings.robot_frame, message.header.frame(), stamp)?;
        let turning = &message.angular_velocity;
        let rad_per_s = (robot_from_sensor.rotation * Vector3::new(turning.x, turning.y, turning.z)).z;
        // a covariance that begins with -1 says that there is no such reading
        if rad_per_s.is_finite() && message.angular_velocity_covariance.0[0] != -1.0 {
            self.push_reading(Reading::Turning(TurnRate { stamp, rad_per_s }));
        }
        Ok(())
    }

    fn wait(&mut self, waiting: Waiting) {
        self.watch_clock(waiting.scan.stamp);
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
        if self.readings.len() >= READINGS_MOST {
            self.readings.pop_front();
        }
        self.readings.push_back(reading);
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
            let scan = self.waiting.front().map(|waiting| waiting.scan.stamp);
            let is_next = |reading: &mut Reading| scan.is_none_or(|scan| reading.stamp() <= scan);
            if let Some(reading) = self.readings.pop_front_if(is_next) {
                return Some(Passed::Reading(reading));
            }
            let waiting = self.waiting.front()?;
            let (since, stamp, frame) = (waiting.since, waiting.scan.stamp, waiting.scan.laser.name.clone());
            let topic = self.topics.get(&waiting.topic);
            let has_waited = now.saturating_sub(since) >= self.settings.wait;
            // Where others of its topic have waited for it in vain, nobody waits for its place: no scan of another laser does either.
            let is_without_place = topic.is_some_and(|topic| topic.is_without_place);
            if topic.is_some_and(|topic| topic.last.is_some_and(|last| stamp <= last)) {
                self.drop_oldest(Reason::Late);
                continue;
            }
            let placed = if waiting.is_whole {
                None
            } else {
                let mounting = match self.mounting(&frame, stamp, has_waited || is_without_place) {
                    Ready::Wait => return None,
                    Ready::Now(Ok(mounting)) => mounting,
                    Ready::Now(Err(error)) => {
                        self.refuse_oldest(now, &error);
                        continue;
                    }
                };
                let Ready::Now(odom_from_robot) = self.odometry_at(stamp, has_waited, now) else { return None };
                Some((mounting, odom_from_robot))
            };
            let Waiting { topic, mut scan, .. } = self.waiting.pop_front()?;
            if let Some((mounting, odom_from_robot)) = placed {
                scan.laser = self.placed(&scan.laser, &mounting);
                scan.odom_from_robot = odom_from_robot;
            }
            if let Some(topic) = self.topics.get_mut(&topic) {
                topic.tally.use_one();
                (topic.last, topic.trouble, topic.is_without_place) = (Some(stamp), None, false);
            }
            return Some(Passed::Scan(scan));
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
            words.push(format!("no scan has arrived for {:.0} s", now.as_secs_f64()));
        }
        for (name, topic) in &self.topics {
            if let Some(silent) = topic.pulse.fallen_silent(now) {
                words.push(format!("{name} is {silent}"));
            } else if let Some((since, why)) = &topic.trouble {
                let for_s = now.saturating_sub(*since).as_secs_f64();
                words.push(format!("{name} arrives and has not been used for {for_s:.1} s: {why}"));
            }
        }
        words.extend(self.without_odometry.as_ref().map(|why| format!("scans are mapped without odometry: {why}")));
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

    /// Whether a frame lies between odometry's and the robot's, or is the robot's.
    fn is_on_the_way(&self, frame: &str) -> bool {
        let mut at = self.settings.robot_frame.trim_start_matches('/');
        let frame = frame.trim_start_matches('/');
        while at != self.settings.odom_frame.trim_start_matches('/') {
            if at == frame {
                return true;
            }
            match self.transforms.parent(at) {
                Some(above) => at = above,
                None => return false,
            }
        }
        false
    }

    /// Odometry has told where the robot is.
    fn hear_place(&mut self, stamp: Stamp, arrived: Arrived) {
        self.odometry.beat(arrived.since_start);
        let Ok(pose) = self.transforms.lookup(&self.settings.odom_frame, &self.settings.robot_frame, stamp) else {
            return;
        };
        self.push_reading(Reading::Odometry(Odometry { stamp, odom_from_robot: planar(&pose) }));
    }

    fn mounting(&self, frame: &str, stamp: Stamp, has_waited: bool) -> Ready<Result<Mounting, RosError>> {
        match self.transforms.lookup(&self.settings.robot_frame, frame, stamp) {
            Ok(pose) => Ready::Now(Mounting::project(pose, TILT_MOST_DEG)),
            Err(_) if !has_waited => Ready::Wait,
            Err(error) => Ready::Now(Err(error)),
        }
    }

    /// Odometry's pose at a stamp: between the readings around it; else, once nothing later comes, the one before.
    fn odometry_at(&mut self, stamp: Stamp, has_waited: bool, now: Duration) -> Ready<Option<Pose2>> {
        let (odom, robot) = (&self.settings.odom_frame, &self.settings.robot_frame);
        let error = match self.transforms.lookup(odom, robot, stamp) {
            Ok(pose) => {
                self.without_odometry = None;
                return Ready::Now(Some(planar(&pose)));
            }
            Err(error) => error,
        };
        let is_over = has_waited || self.odometry.silence(now) >= self.settings.wait;
        let known = self.transforms.known_times(odom, robot).ok().flatten();
        if known.is_some_and(|(first, _)| stamp < first) {
            return Ready::Now(None);
        }
        if !is_over {
            return Ready::Wait;
        }
        let before = known.filter(|(_, last)| stamp.secs_since(*last) <= ODOMETRY_GAP_S);
        let pose = before.and_then(|(_, last)| self.transforms.lookup(odom, robot, last).ok());
        self.without_odometry = pose.is_none().then(|| error.to_string());
        Ready::Now(pose.map(|pose| planar(&pose)))
    }

    /// The laser where it sits; lasers that are alike are shared.
    fn placed(&mut self, laser: &LaserModel, mounting: &Mounting) -> Arc<LaserModel> {
        let Mounting { robot_from_laser, inverted, .. } = *mounting;
        let laser = LaserModel { robot_from_laser, inverted, ..laser.clone() };
        match self.lasers.get(&laser.name) {
            Some(known) if **known == laser => Arc::clone(known),
            _ => {
                if self.lasers.len() >= TOPICS_MOST {
                    self.lasers.clear();
                }
                let made = Arc::new(laser);
                self.lasers.insert(made.name.clone(), Arc::clone(&made));
                made
            }
        }
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
        (self.newest, self.behind, self.set_back) = (Some(stamp), 0, self.set_back + 1);
        self.transforms.forget_moving();
        self.readings.clear();
        self.topics.values_mut().for_each(|topic| topic.last = None);
        let before: Vec<Waiting> = self.waiting.drain(..).collect();
        for waiting in before {
            if waiting.scan.stamp.secs_since(stamp).abs() <= WINDOW_S {
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

/// The stamp of a header, or when its message arrived where it has none.
fn stamp_or(stamp: Stamp, arrived: Arrived) -> Stamp {
    if stamp.0 == 0 { arrived.stamp } else { stamp }
}

#[cfg(test)]
mod tests;
