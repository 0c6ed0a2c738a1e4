//! The one who maps, and what becomes of it.

use super::beat::{Frames, Known, Place, beat};
use super::clock::Clock;
use super::drawer::{Outlet, ToDraw, draw};
use super::robot::Told;
use super::{Entrance, Lanes};
use crate::args::{LiveArgs, RosArgs};
use crate::commands::{Finished, finish};
use crate::events::Ending;
use crate::failure::{Failure, Outcome};
use crate::mapping::Mapping;
use crate::reading::Reading as ReadingReport;
use crate::terminal::{count, say, say_json};
use mapwright::{Job, JobResult, LaserScan, Localisation, Mapper, Session, Settings, Update};
use mapwright_live::outgoing::pose;
use mapwright_live::{Driver, Gate, Reading};
use mapwright_ros::RosError;
use serde_json::json;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::thread::Scope;
use std::time::Duration;

/// What is missing is looked at so often.
const WATCH_EVERY: Duration = Duration::from_secs(1);

/// What is done with scans.
pub(super) enum Work {
    /// A map is made, and written down.
    Mapping(Box<Mapping>),
    /// A finished map says where the robot is.
    Localising(Box<Localising>),
}

/// A robot in a finished map.
pub(super) struct Localising {
    pub(super) mapper: Mapper,
    pub(super) scans: u64,
    pub(super) located: u64,
    /// Until the robot was located first, scans.
    pub(super) first: Option<u64>,
}

/// A robot that drives.
pub(super) struct Live {
    work: Work,
    settings: Settings,
    lanes: Lanes,
    door: Arc<Entrance>,
    clock: Arc<Clock>,
    names: RosArgs,
    told: Option<Arc<Told>>,
    known: Arc<Known>,
    is_over: Arc<AtomicBool>,
    to_draw: Option<Sender<ToDraw>>,
    /// Of each lane of scans, how many were overtaken at the door as far as the gate knows.
    overtaken: Vec<u64>,
    watched: Duration,
    /// What was missing when it was looked at last.
    missing: BTreeSet<String>,
    is_quiet: bool,
    has_odometry: bool,
    refused: u64,
    /// Why what is mapped is not written, since when.
    unwritten: Option<(Duration, String)>,
    /// The same of earlier times.
    losses: Vec<String>,
}

impl Live {
    pub(super) fn new(
        work: Work,
        settings: Settings,
        (lanes, door): (Lanes, Arc<Entrance>),
        clock: Arc<Clock>,
        args: &LiveArgs,
        told: Option<Told>,
    ) -> Self {
        let (overtaken, voice) = (vec![0; lanes.scans.len()], args.mapping.voice);
        Self {
            work,
            settings,
            lanes,
            door,
            clock,
            names: args.ros_names.clone(),
            told: told.map(Arc::new),
            known: Arc::default(),
            is_over: Arc::default(),
            to_draw: None,
            overtaken,
            watched: Duration::ZERO,
            missing: BTreeSet::new(),
            is_quiet: voice.quiet || voice.json,
            has_odometry: false,
            refused: 0,
            unwritten: None,
            losses: Vec::new(),
        }
    }

    fn session(&self) -> &Session {
        match &self.work {
            Work::Mapping(mapping) => mapping.session(),
            Work::Localising(localising) => localising.mapper.session(),
        }
    }

    /// Begins to draw and to tell, where anybody hears it.
    pub(super) fn start<'scope>(&mut self, scope: &'scope Scope<'scope, '_>, outlet: Option<Outlet>) {
        let Some(told) = self.told.clone() else { return };
        let (sender, heard) = channel();
        self.to_draw = Some(sender);
        let drawn = (self.settings, self.session().clone());
        let (clock, every) = (Arc::clone(&self.clock), Duration::from_secs_f64(self.names.map_every));
        scope.spawn(move || draw(&heard, drawn, outlet.as_ref(), &clock, every));
        let (known, clock, over) = (Arc::clone(&self.known), Arc::clone(&self.clock), Arc::clone(&self.is_over));
        let frames = Frames {
            map: self.names.map_frame.clone(),
            odom: self.names.odom_frame.clone(),
            robot: self.names.robot_frame.clone(),
            tolerance: Duration::from_secs_f64(self.names.transform_tolerance),
        };
        scope.spawn(move || beat(&*told.tf, &known, &frames, &clock, &over));
    }

    /// Ends what was begun.
    pub(super) fn stop(&mut self) {
        self.is_over.store(true, Ordering::Release);
        self.to_draw = None;
    }

    /// Tells others what came of a scan, or of a job.
    fn tell(&mut self, update: &Update, is_located: bool) {
        if !is_located {
            self.known.set(None);
            return;
        }
        self.known.set(Some(Place {
            stamp: update.stamp,
            map_from_odom: update.map_from_odom,
            odom_from_robot: update.odom_from_robot,
            is_without_odometry: !self.has_odometry,
        }));
        if let Some(told) = &self.told
            && let Ok(bytes) = pose(&self.names.map_frame, update.stamp, update.map_from_robot, &update.covariance)
        {
            // The next one follows soon.
            let _ = told.pose.publish(&bytes);
            let _ = told.amcl_pose.publish(&bytes);
        }
    }

    /// What was mapped may not be writable now, as on a full disk: mapping goes on, and it is said.
    fn written(&mut self, result: Result<(), Failure>) {
        let now = self.clock.since_start();
        match (result, &self.unwritten) {
            (Ok(()), Some((since, why))) => {
                let words = format!("{why}, for {:.0} s", (now - *since).as_secs_f64());
                self.notice(&format!("written again: {words}"));
                self.losses.push(words);
                self.unwritten = None;
            }
            (Err(failure), None) => {
                self.notice(&format!("{failure}; mapping goes on"));
                self.unwritten = Some((now, failure.to_string()));
            }
            _ => {}
        }
    }

    /// Says something to whoever looks.
    fn notice(&self, words: &str) {
        if !self.is_quiet {
            let _ = say(&format!("{:>7.1} s  {words}\n", self.clock.since_start().as_secs_f64()));
        }
    }

    fn watch(&mut self, gate: &mut Gate, now: Duration) {
        for (lane, (topic, known)) in self.lanes.scans.iter().zip(&mut self.overtaken).enumerate() {
            let (_, overtaken) = self.door.counts(lane);
            if overtaken > *known {
                gate.overtaken(topic, overtaken - *known);
                *known = overtaken;
            }
        }
        let missing: BTreeSet<String> = gate.missing(now).into_iter().collect();
        // Words that only count on are no news.
        let kind = |words: &String| words.split(|c: char| c.is_ascii_digit()).map(str::to_owned).collect::<String>();
        let known: BTreeSet<String> = self.missing.iter().map(kind).collect();
        let news: Vec<String> = missing.iter().filter(|words| !known.contains(&kind(words))).cloned().collect();
        news.iter().for_each(|words| self.notice(words));
        if missing.is_empty() && !self.missing.is_empty() {
            self.notice("nothing is missing any more");
        }
        self.missing = missing;
    }

    /// Writes the results and says what was made and lost.
    pub(super) fn finish(
        mut self,
        args: &LiveArgs,
        played: Option<(String, ReadingReport)>,
        gate: &Gate,
        interrupted: bool,
    ) -> Result<Outcome, Failure> {
        let arrived: Vec<String> = gate.tallies().map(|(topic, tally)| format!("{topic}: {tally}")).collect();
        let dropped = gate.tallies().flat_map(|(_, tally)| tally.dropped().map(|(_, count)| count)).sum::<u64>();
        self.losses.extend(self.unwritten.take().map(|(_, why)| why));
        if dropped > 0 {
            self.losses.push(format!("{} dropped: {}", count(dropped, "scan"), arrived.join("; ")));
        }
        if self.refused > 0 {
            self.losses.push(format!("{} of transforms or odometry refused", count(self.refused, "message")));
        }
        match self.work {
            Work::Mapping(mut mapping) => {
                mapping.end_of_scans()?;
                mapping.earlier_losses.append(&mut self.losses);
                let ending = if played.is_some() && interrupted { Ending::Interrupted } else { Ending::OfLog };
                let (name, read) = played.unwrap_or_else(|| ("live".to_owned(), ReadingReport::default()));
                let voice = args.mapping.voice;
                finish(*mapping, Finished { name, read, ending, output: &args.output, voice })
            }
            Work::Localising(localising) => localising.finish(args, &arrived, &self.losses),
        }
    }
}

impl Localising {
    fn finish(&self, args: &LiveArgs, arrived: &[String], losses: &[String]) -> Result<Outcome, Failure> {
        let Self { scans, located, first, .. } = self;
        if args.mapping.voice.json {
            say_json(&json!({ "scans": scans, "located": located, "first_located": first, "losses": losses }))?;
        } else if !args.mapping.voice.quiet {
            let first =
                first.map_or("never located".to_owned(), |first| format!("first after {}", count(first, "scan")));
            say(&format!("located  {located} of {}, {first}\n", count(*scans, "scan")))?;
            say(&format!("arrived  {}\n", arrived.join("; ")))?;
        }
        Ok(Outcome::of_losses(losses))
    }
}

impl Driver for Live {
    fn add_reading(&mut self, reading: &Reading) {
        self.has_odometry |= matches!(reading, Reading::Odometry(_));
        match (&mut self.work, reading) {
            (Work::Mapping(mapping), Reading::Odometry(odometry)) => {
                let result = mapping.add_odometry(odometry, 0);
                self.written(result);
            }
            (Work::Mapping(mapping), Reading::Turning(rate)) => mapping.add_turn_rate(rate),
            (Work::Localising(localising), Reading::Odometry(odometry)) => localising.mapper.add_odometry(odometry),
            (Work::Localising(localising), Reading::Turning(rate)) => {
                localising.mapper.add_turn_rate(rate);
            }
        }
    }

    fn add_scan(&mut self, scan: &LaserScan) {
        self.has_odometry |= scan.odom_from_robot.is_some();
        let (update, is_located, result) = match &mut self.work {
            Work::Mapping(mapping) => {
                let (update, result) = mapping.add_scan_live(scan);
                (update, true, result)
            }
            Work::Localising(localising) => {
                let update = localising.mapper.add_scan(scan);
                let is_located = update.localisation == Localisation::Joined
                    && localising.mapper.location().is_none_or(|location| location.is_located);
                localising.scans += 1;
                localising.located += u64::from(is_located);
                if is_located && localising.first.is_none() {
                    localising.first = Some(localising.scans);
                }
                (update, is_located, Ok(()))
            }
        };
        self.written(result);
        self.tell(&update, is_located);
        self.draw(update);
    }

    fn next_job(&mut self) -> Option<Job> {
        match &mut self.work {
            Work::Mapping(mapping) => mapping.next_job(),
            Work::Localising(localising) => localising.mapper.next_job(),
        }
    }

    fn apply(&mut self, job: JobResult) {
        match &mut self.work {
            Work::Mapping(mapping) => {
                let (update, result) = mapping.apply(job);
                self.written(result);
                self.tell(&update, true);
                self.draw(update);
            }
            Work::Localising(localising) => {
                localising.mapper.apply(job);
            }
        }
    }

    fn refused(&mut self, error: &RosError) {
        if self.refused == 0 {
            self.notice(&format!("refused: {error}"));
        }
        self.refused += 1;
    }

    fn turn(&mut self, gate: &mut Gate, now: Duration) {
        if now >= self.watched + WATCH_EVERY {
            self.watched = now;
            self.watch(gate, now);
        }
    }
}

impl Live {
    fn draw(&self, update: Update) {
        if let (Some(to_draw), Work::Mapping(_)) = (&self.to_draw, &self.work) {
            // Who draws goes last.
            let _ = to_draw.send(ToDraw::Entries(update.entries));
        }
    }
}
