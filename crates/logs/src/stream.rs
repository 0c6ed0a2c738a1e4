//! The second pass over a recording: its events in order.

use crate::channel::{Decoders, Messages};
use crate::clock::ClockStep;
use crate::links::{bare, stamp_or};
use crate::merge::{Merger, Next, Source, Turn, WINDOW_MESSAGES};
use crate::odometry::OdometrySource;
use crate::order::Event;
use crate::plan::{FurtherLaser, Plan};
use crate::problem::Problem;
use crate::report::{RecordingReport, StreamReport};
use crate::scans::{ScanMaker, Taken};
use crate::sonars::SonarMaker;
use crate::survey::{NO_TURN_RATE, Survey, has_turn_rate, same_name};
use mapwright_bags::{BagError, Connection, RawMessage, Recording};
use mapwright_formats::TopicReport;
use mapwright_geom::{Pose2, Pose3, Stamp};
use mapwright_ros::messages::TfMessage;
use mapwright_ros::planar;
use mapwright_sensor::{CorrectedOdometry, FarOrigin, LaserScan, Odometry, SonarReading, TurnRate, TurnRates};
use nalgebra::Vector3;
use std::collections::VecDeque;
use std::path::Path;

/// What a connection is used for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Use {
    /// Of one of the plan's lasers, from 0.
    Scans(usize),
    Odometry,
    Turning,
    Sonar,
    Nothing,
}

/// A recording that is read according to its plan.
#[derive(Debug)]
pub(crate) struct Stream {
    recording: Recording,
    survey: Survey,
    plan: Plan,
    maker: ScanMaker,
    decoders: Decoders,
    uses: Vec<Option<Use>>,
    merger: Merger,
    turning: Turning,
    sonars: SonarMaker,
    /// Readings of sonars that wait for what was taken before them, and what they go before.
    heard: VecDeque<SonarReading>,
    next: Option<Event>,
    origin: FarOrigin,
    corrected: Option<CorrectedOdometry>,
    report: StreamReport,
    /// By laser, the beams of the last scan.
    last_beams: Vec<Option<usize>>,
    is_end: bool,
}

impl Stream {
    pub(crate) fn open(path: &Path, survey: Survey, plan: Plan) -> Result<Self, BagError> {
        let named = |name: &str| TopicReport { name: name.to_owned(), ..TopicReport::default() };
        let mut topics = vec![named(&plan.scans)];
        match &plan.odometry {
            OdometrySource::None => {}
            OdometrySource::Topic { name, .. } => topics.push(named(name)),
            OdometrySource::Transforms { parent, child, .. } => topics.push(named(&format!("{parent} -> {child}"))),
        }
        topics.extend(plan.further.iter().map(|further| named(&further.topic)));
        Ok(Self {
            recording: Recording::open(path)?,
            survey,
            maker: ScanMaker::new(&plan),
            merger: Merger::new(1 + plan.further.len(), plan.odometry != OdometrySource::None),
            turning: Turning::default(),
            sonars: SonarMaker::new(&plan.sonars),
            heard: VecDeque::new(),
            next: None,
            origin: FarOrigin::at_first_reading(),
            corrected: plan.calibration.map(CorrectedOdometry::new),
            plan,
            decoders: Decoders::default(),
            uses: Vec::new(),
            report: StreamReport { topics, ..StreamReport::default() },
            last_beams: Vec::new(),
            is_end: false,
        })
    }

    /// How much of the recording was read, from 0 to 1.
    pub(crate) fn share(&self) -> f64 {
        self.report.messages as f64 / self.survey.container.messages.max(1) as f64
    }

    /// Where the recording has the laser, where another place is asked for.
    pub(crate) fn said_mount(&self) -> Option<Pose2> {
        self.plan.said_mount
    }

    pub(crate) fn into_report(mut self) -> RecordingReport {
        self.report.odd_heads = self.maker.odd_heads;
        RecordingReport { survey: self.survey, plan: self.plan, stream: self.report }
    }

    pub(crate) fn next_event(&mut self) -> Result<Option<Event>, BagError> {
        if self.plan.sonars.is_empty() {
            return self.next_of_others();
        }
        if self.next.is_none() {
            self.next = self.next_of_others()?;
        }
        let until = self.next.as_ref().map(Event::at);
        let is_before = |reading: &mut SonarReading| until.is_none_or(|until| reading.stamp <= until);
        if let Some(reading) = self.heard.pop_front_if(is_before) {
            return Ok(Some(Event::Sonar(Box::new(reading))));
        }
        Ok(self.next.take())
    }

    fn next_of_others(&mut self) -> Result<Option<Event>, BagError> {
        loop {
            if let Some(rate) = self.turning.next_rate() {
                self.report.turn_rates += 1;
                return Ok(Some(Event::TurnRate(rate)));
            }
            if let Some((scan, _)) = self.turning.scan.take() {
                return Ok(Some(Event::Scan(scan)));
            }
            match self.merger.pop(self.is_end) {
                Some(Turn::Scan(next)) => {
                    let end = next.item.span().1;
                    self.turning.scan = Some((self.scan(next), end));
                }
                Some(Turn::Odometry(next)) => return Ok(Some(Event::Odometry(self.odometry(next)))),
                None if self.is_end => return Ok(None),
                None => self.read()?,
            }
        }
    }

    /// Takes in one more message.
    fn read(&mut self) -> Result<(), BagError> {
        let held_bytes = self.recording.held_bytes() + self.merger.held_bytes() + self.turning.held_bytes();
        self.report.held_bytes = self.report.held_bytes.max(held_bytes);
        let Some(message) = self.recording.next_message()? else {
            self.is_end = true;
            return Ok(());
        };
        self.report.messages += 1;
        self.merger.at(message.log_stamp);
        let place = self.report.messages;
        let used = used(&mut self.uses, message.connection, &self.plan);
        if used == Use::Nothing {
            return Ok(());
        }
        let messages = self.decoders.of(message.connection);
        let (taken, report) = match used {
            Use::Turning => (self.turning.take(&self.plan, messages, &message), &mut self.report),
            Use::Sonar => {
                let reading = self.sonars.reading(messages, &message);
                let taken = reading.map(|(reading, is_stamped)| {
                    self.report.sonar_readings += 1;
                    if self.heard.len() == WINDOW_MESSAGES {
                        self.heard.pop_front();
                        self.report.sonars_passed_over += 1;
                    }
                    self.heard.push_back(reading);
                    is_stamped
                });
                (taken, &mut self.report)
            }
            Use::Scans(laser) => {
                let taken = take_scan(&mut self.maker, messages, &message, (laser, place), &mut self.merger);
                (taken, &mut self.report)
            }
            _ => {
                let (source, merger) = (&self.plan.odometry, &mut self.merger);
                let mut take = |reading: Odometry| {
                    let made = self.corrected.as_mut().map(|corrected| Odometry {
                        stamp: corrected.stamp(reading.stamp),
                        odom_from_robot: corrected.pose(reading.odom_from_robot),
                    });
                    merger.push_odometry(place, made.unwrap_or(reading));
                };
                let taken = take_odometry(source, messages, &message, &mut take, &mut self.origin);
                self.report.odometry_origin_m = self.origin.at_m();
                (taken, &mut self.report)
            }
        };
        if let Some((source, by_s)) = self.merger.take_clock_set() {
            report.clock_steps += 1;
            let topic = report.topics.get(topic_of(source, &self.plan));
            let name = topic.map_or_else(String::new, |topic| topic.name.clone());
            let is_first = topic.is_some_and(|topic| topic.events == 0);
            report.first_clock_step.get_or_insert(ClockStep { name, place, by_s, is_first });
        }
        match taken {
            Ok(true) => {}
            Ok(false) => report.unstamped.note(place),
            Err(Problem::Undecodable(reason)) => report.undecodable.note(place, message.offset_bytes, || reason),
            Err(Problem::Unusable(reason)) if used == Use::Turning => {
                report.refused_turn_rates.note(place, message.offset_bytes, || reason);
            }
            Err(Problem::Unusable(reason)) => report.unusable.note(place, message.offset_bytes, || reason),
        }
        Ok(())
    }

    fn scan(&mut self, next: Next<Taken>) -> LaserScan {
        let Next { place, at, is_late, item } = next;
        let (laser, (first, last)) = (item.laser, item.span());
        let turning = self.turning.rates.mean(first, last);
        let read = self.merger.twist_per_s(at);
        let twist_per_s = turning.map_or(read, |turning| {
            let [x, y, _] = read.unwrap_or([0.0; 3]);
            Some([x, y, turning])
        });
        let mut scan = self.maker.finish(item, twist_per_s);
        scan.odom_from_robot = self.merger.odom_from_robot(at);
        let report = &mut self.report;
        report.scans += 1;
        report.points_used = self.maker.counts.used;
        report.points_outside = self.maker.counts.outside;
        if is_late {
            report.late.note(place);
        }
        if scan.odom_from_robot.is_none() && self.plan.odometry != OdometrySource::None {
            report.without_odometry.note(place);
            let behind_s = self.merger.last_odometry().map(|last| at.secs_since(last));
            report.odometry_behind_s = report.odometry_behind_s.or(behind_s);
        }
        report.non_finite_ranges += scan.ranges_m.iter().filter(|range_m| !range_m.is_finite()).count() as u64;
        if self.last_beams.len() <= laser {
            self.last_beams.resize(laser + 1, None);
        }
        let last_beams = self.last_beams[laser].replace(scan.ranges_m.len());
        if let Some(topic) = report.topics.get_mut(topic_of(Source::Laser(laser), &self.plan)) {
            topic.events += 1;
            topic.stamps.observe(place, scan.stamp);
            if last_beams.is_some_and(|beams| beams != scan.ranges_m.len()) {
                topic.beam_count_changes.note(place);
            }
        }
        scan
    }

    fn odometry(&mut self, next: Next<Odometry>) -> Odometry {
        let Next { place, is_late, item, .. } = next;
        self.report.odometry += 1;
        if is_late {
            self.report.late.note(place);
        }
        if let Some(topic) = self.report.topics.get_mut(1) {
            topic.events += 1;
            topic.stamps.observe(place, item.stamp);
            topic.odometry.observe(place, item);
        }
        item
    }
}

/// Where a topic stands in the report: the first laser, odometry where there is one, further lasers.
fn topic_of(source: Source, plan: &Plan) -> usize {
    match source {
        Source::Laser(0) => 0,
        Source::Odometry => 1,
        Source::Laser(further) => further + usize::from(plan.odometry != OdometrySource::None),
    }
}

/// Turn rates that wait for the scan during whose sweep they were read.
#[derive(Debug, Default)]
struct Turning {
    waiting: VecDeque<TurnRate>,
    /// The newest as read.
    rates: TurnRates,
    /// The scan that is next, and when its sweep is over.
    scan: Option<(LaserScan, Stamp)>,
}

impl Turning {
    /// Those from before the end of the next scan's sweep.
    fn next_rate(&mut self) -> Option<TurnRate> {
        let end = self.scan.as_ref()?.1;
        self.waiting.pop_front_if(|rate| rate.stamp <= end)
    }

    /// Whether the message had a stamp of its own.
    fn take(&mut self, plan: &Plan, messages: &mut Messages, message: &RawMessage<'_>) -> Result<bool, Problem> {
        let (Some(source), Messages::Imu(decoder)) = (&plan.turning, messages) else { return Ok(true) };
        let imu = decoder.decode(message.data).map_err(|error| Problem::Undecodable(error.to_string()))?;
        let (stamp, is_unstamped) = stamp_or(imu.header.stamp, message.log_stamp);
        let omega = Vector3::new(imu.angular_velocity.x, imu.angular_velocity.y, imu.angular_velocity.z);
        let rate = TurnRate { stamp, rad_per_s: omega.dot(&Vector3::from(source.up_in_sensor)) };
        if !has_turn_rate(&imu) {
            return Err(Problem::Unusable(NO_TURN_RATE.to_owned()));
        }
        if !self.rates.add(rate) {
            let expected = "expected turn rates within 100 rad/s in the order of their stamps";
            return Err(Problem::Unusable(format!("{expected}, found {} rad/s", rate.rad_per_s)));
        }
        if self.waiting.len() == WINDOW_MESSAGES {
            self.waiting.pop_front();
        }
        self.waiting.push_back(rate);
        Ok(!is_unstamped)
    }

    fn held_bytes(&self) -> usize {
        self.waiting.capacity() * size_of::<TurnRate>()
    }
}

fn used(uses: &mut Vec<Option<Use>>, connection: &Connection, plan: &Plan) -> Use {
    let at = connection.id as usize;
    if uses.len() <= at {
        uses.resize(at + 1, None);
    }
    *uses[at].get_or_insert_with(|| {
        let kind = crate::TopicKind::of(&connection.type_name);
        let is_odometry = match &plan.odometry {
            OdometrySource::None => false,
            OdometrySource::Topic { name, .. } => {
                kind == crate::TopicKind::Odometry && same_name(name, &connection.topic)
            }
            OdometrySource::Transforms { .. } => {
                kind == crate::TopicKind::Transforms && plan.transforms.contains(&connection.topic)
            }
        };
        let is_turning = plan.turning.as_ref().is_some_and(|turning| same_name(&turning.name, &connection.topic));
        let is_further = |further: &FurtherLaser| kind == further.kind && same_name(&further.topic, &connection.topic);
        let is_sonar = kind == crate::TopicKind::Range;
        if is_sonar && plan.sonars.iter().any(|sonar| same_name(&sonar.topic, &connection.topic)) {
            Use::Sonar
        } else if kind == plan.kind && same_name(&plan.scans, &connection.topic) {
            Use::Scans(0)
        } else if let Some(further) = plan.further.iter().position(is_further) {
            Use::Scans(further + 1)
        } else if is_odometry {
            Use::Odometry
        } else if is_turning && kind == crate::TopicKind::Imu {
            Use::Turning
        } else {
            Use::Nothing
        }
    })
}

/// Whether the message had a stamp of its own.
fn take_scan(
    maker: &mut ScanMaker,
    messages: &mut Messages,
    message: &RawMessage<'_>,
    (laser, place): (usize, u64),
    merger: &mut Merger,
) -> Result<bool, Problem> {
    let mut taken = Taken { laser, ..maker.scan(messages, message.data, place)? };
    let (stamp, is_unstamped) = stamp_or(taken.scan.stamp, message.log_stamp);
    taken.scan.stamp = stamp;
    merger.push_scan(place, taken);
    Ok(!is_unstamped)
}

/// Whether the message had a stamp of its own.
fn take_odometry(
    source: &OdometrySource,
    messages: &mut Messages,
    message: &RawMessage<'_>,
    take: &mut impl FnMut(Odometry),
    origin: &mut FarOrigin,
) -> Result<bool, Problem> {
    let undecodable = |error: mapwright_ros::RosError| Problem::Undecodable(error.to_string());
    match (source, messages) {
        (OdometrySource::Topic { child_from_robot, .. }, Messages::Odometry(decoder)) => {
            let odometry = decoder.decode(message.data).map_err(undecodable)?;
            let pose = odometry.pose.pose.to_pose3();
            let (stamp, is_unstamped) = stamp_or(odometry.header.stamp, message.log_stamp);
            take(reading(stamp, pose, *child_from_robot, origin)?);
            Ok(!is_unstamped)
        }
        (OdometrySource::Transforms { parent, child, child_from_robot }, Messages::Transforms(decoder)) => {
            let transforms: TfMessage<'_> = decoder.decode(message.data).map_err(undecodable)?;
            let mut all_stamped = true;
            for link in &transforms.transforms {
                if link.header.frame() == parent && bare(&link.child_frame_id) == child {
                    let (stamp, is_unstamped) = stamp_or(link.header.stamp, message.log_stamp);
                    take(reading(stamp, link.transform.to_pose3(), *child_from_robot, origin)?);
                    all_stamped &= !is_unstamped;
                }
            }
            Ok(all_stamped)
        }
        (_, Messages::None(Some(reason))) => Err(Problem::Undecodable(reason.clone())),
        _ => Ok(true),
    }
}

fn reading(
    stamp: Stamp,
    odom_from_child: Option<Pose3>,
    child_from_robot: Pose3,
    origin: &mut FarOrigin,
) -> Result<Odometry, Problem> {
    let odom_from_robot = odom_from_child.map(|pose| planar(&(pose * child_from_robot)));
    let near = odom_from_robot.and_then(|said| origin.near(said));
    let unusable = || Problem::Unusable("expected a finite pose within 10^6 m with a direction".to_owned());
    near.map(|odom_from_robot| Odometry { stamp, odom_from_robot }).ok_or_else(unusable)
}
