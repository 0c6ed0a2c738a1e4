//! The one who maps, and what becomes of it.

use super::asking::{Reply, ToDraw};
use super::beat::{Known, Place, beat};
use super::cable::Words;
use super::clock::Clock;
use super::drawer::{Drawer, Outlet, place_of, with_ending};
use super::node::{Node, Question};
use super::robot::{Names, Told};
use super::view::View;
use super::{Entrance, Lanes};
use crate::args::LiveArgs;
use crate::commands::map::{Finished, finish};
use crate::events::Ending;
use crate::failure::{Failure, Outcome};
use crate::mapping::Mapping;
use crate::reading::Reading as ReadingReport;
use crate::session::earlier_in_plane;
use crate::terminal::{count, say, say_json};
use mapwright::{Job, JobResult, LaserScan, Localisation, Mapper, Pose2, Session, Settings, Stamp, Update};
use mapwright_geom::Cov3;
use mapwright_live::node::asked::{Asked, PoseGiven, Said, Start, Why};
use mapwright_live::node::diagnostics::Diagnostics;
use mapwright_live::outgoing::pose;
use mapwright_live::{Driver, Gate, Reading};
use mapwright_ros::RosError;
use nalgebra::{Rotation3, Vector3};
use serde_json::json;
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender};
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
    ros: Option<Ros>,
    view: Option<View>,
    known: Arc<Known>,
    is_over: Arc<AtomicBool>,
    /// Of each lane of scans, how many were overtaken at the door as far as the gate knows.
    overtaken: Vec<u64>,
    watched: Duration,
    /// What was missing when it was looked at last.
    missing: BTreeSet<String>,
    diagnostics: Diagnostics,
    /// What happens at the cable of a lidar.
    pub(super) at_cable: Arc<Words>,
    /// Somebody who watches holds the recording.
    pub(super) is_held: Arc<AtomicBool>,
    is_played: bool,
    is_quiet: bool,
    is_paused: bool,
    drops_waiting: bool,
    has_odometry: bool,
    refused: u64,
    /// Why what is mapped is not written, since when.
    unwritten: Option<(Duration, String)>,
    /// The same of earlier times.
    losses: Vec<String>,
}

/// Others, and what they are told.
pub(super) struct Ros {
    pub(super) names: Names,
    pub(super) told: Arc<Told>,
    pub(super) node: Arc<Node>,
    pub(super) to_draw: Sender<ToDraw>,
}

impl Live {
    pub(super) fn new(
        (work, settings): (Work, Settings),
        (lanes, door): (Lanes, Arc<Entrance>),
        clock: Arc<Clock>,
        args: &LiveArgs,
        (ros, view): (Option<Ros>, Option<View>),
    ) -> Self {
        let (overtaken, voice) = (vec![0; lanes.scans.len()], args.mapping.voice);
        let live = Self {
            work,
            settings,
            lanes,
            door,
            clock,
            ros,
            view,
            known: Arc::default(),
            is_over: Arc::default(),
            overtaken,
            watched: Duration::ZERO,
            missing: BTreeSet::new(),
            diagnostics: Diagnostics::default(),
            at_cable: Arc::default(),
            is_held: Arc::default(),
            is_played: args.log.is_some(),
            is_quiet: voice.quiet || voice.json,
            is_paused: false,
            drops_waiting: false,
            has_odometry: false,
            refused: 0,
            unwritten: None,
            losses: Vec::new(),
        };
        live.view.iter().for_each(|view| live.notice(&format!("to look at: {}", view.url())));
        live
    }

    fn session(&self) -> &Session {
        match &self.work {
            Work::Mapping(mapping) => mapping.session(),
            Work::Localising(localising) => localising.mapper.session(),
        }
    }

    /// Begins to draw and to tell, where anybody hears it.
    pub(super) fn start<'scope>(
        &mut self,
        scope: &'scope Scope<'scope, '_>,
        (outlet, heard): (Outlet, Receiver<ToDraw>),
        folder: &Path,
    ) {
        let Some(ros) = &self.ros else { return };
        let (clock, node) = (Arc::clone(&self.clock), Arc::clone(&ros.node));
        let (settings, session) = (self.settings, self.session().clone());
        let drawer = Drawer { settings, session, folder: folder.to_owned(), clock, node };
        scope.spawn(move || drawer.draw(&heard, Some(outlet)));
        let (known, clock, over) = (Arc::clone(&self.known), Arc::clone(&self.clock), Arc::clone(&self.is_over));
        let (names, told, node) = (ros.names.clone(), Arc::clone(&ros.told), Arc::clone(&ros.node));
        scope.spawn(move || beat(&*told.tf, &known, (&names, &node), &clock, &over));
    }

    /// Ends what was begun.
    pub(super) fn stop(&mut self) {
        self.is_over.store(true, Ordering::Release);
        if let Some(ros) = &self.ros {
            ros.node.leave(&self.clock);
            // Who draws may have ended already.
            let _ = ros.to_draw.send(ToDraw::End);
        }
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
        if let Some(Ros { names, told, .. }) = &self.ros
            && let Ok(bytes) = pose(&names.map_frame, update.stamp, update.map_from_robot, &update.covariance)
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
    pub(super) fn notice(&self, words: &str) {
        if !self.is_quiet {
            let _ = say(&format!("{:>7.1} s  {words}\n", self.clock.since_start().as_secs_f64()));
        }
    }

    /// What was overtaken at the door has arrived, and was dropped.
    fn count_overtaken(&mut self, gate: &mut Gate) {
        for (lane, (topic, known)) in self.lanes.scans.iter().zip(&mut self.overtaken).enumerate() {
            let (_, overtaken) = self.door.counts(lane);
            if overtaken > *known {
                gate.overtaken(topic, overtaken - *known);
                *known = overtaken;
            }
        }
    }

    fn watch(&mut self, gate: &mut Gate, now: Duration) {
        self.count_overtaken(gate);
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
        if let Some(view) = &mut self.view {
            let missing = self.missing.iter().map(|words| ("missing".to_owned(), words.clone()));
            let tallies = gate.tallies().map(|(topic, tally)| (topic.to_owned(), tally.to_string()));
            view.status(&missing.chain(tallies).collect::<Vec<_>>());
        }
        if let Some(Ros { node, .. }) = &self.ros {
            let missing: Vec<String> = self.missing.iter().cloned().collect();
            let stamp = self.clock.stamp().unwrap_or(Stamp(0));
            let message = self.diagnostics.report(&node.name, stamp, gate.tallies(), &missing);
            let _ = node.diagnostics.publish(&message);
        }
    }

    /// What somebody asks, done or refused.
    fn answer(&mut self, asked: Asked) -> Reply {
        let done = Reply::Said(Said::Done);
        match (asked, &mut self.work) {
            (Asked::Pause, _) => {
                self.is_paused = !self.is_paused;
                self.ros.iter().for_each(|ros| ros.node.tell_paused(self.is_paused));
                Reply::Said(Said::Paused(self.is_paused))
            }
            (Asked::ClearQueue, _) => {
                self.drops_waiting = true;
                done
            }
            // Every scan is matched, whether the robot stands or not.
            (Asked::NoMotionUpdate, _) => done,
            (Asked::Reset { pause }, Work::Mapping(mapping)) => {
                self.is_paused = pause;
                self.ros.iter().for_each(|ros| ros.node.tell_paused(pause));
                match mapping.begin_anew(None) {
                    Ok(()) => self.anew(),
                    Err(failure) => Reply::refused(Why::Other, failure.to_string()),
                }
            }
            (Asked::Deserialize { file, start }, Work::Mapping(mapping)) => {
                if let Start::LocaliseFrom { .. } = start {
                    return Reply::refused(Why::WrongMode, "to be found in a finished map, start with --localise");
                }
                let path = match place_of(mapping.output.folder(), &file) {
                    Ok(path) => with_ending(&path, "mapwright"),
                    Err(words) => return Reply::refused(Why::NoSuchFile, words),
                };
                if !path.exists() {
                    return Reply::refused(Why::NoSuchFile, format!("there is no {}", path.display()));
                }
                // Wherever it is said to stand: it is found.
                let goes_on = earlier_in_plane(&path)
                    .and_then(|(session, _)| mapping.begin_anew(Some(session)))
                    .and_then(|()| mapping.switch_on());
                match goes_on {
                    Ok(()) => self.anew(),
                    Err(failure) => Reply::refused(Why::Unreadable, failure.to_string()),
                }
            }
            (Asked::FindAnew, Work::Localising(localising)) => {
                localising.mapper.find_anew();
                done
            }
            (Asked::SetPose(given), Work::Localising(localising)) => {
                let frame = self.ros.as_ref().map_or("map", |ros| ros.names.map_frame.as_str());
                if !given.frame.is_empty() && given.frame != frame {
                    let words = format!("expected a pose in {frame}, found one in {}", given.frame);
                    return Reply::refused(Why::Other, words);
                }
                let (map_from_robot, covariance) = in_the_plane(&given);
                match localising.mapper.place(map_from_robot, covariance) {
                    true => done,
                    false => Reply::refused(Why::Other, "expected a pose with a covariance, found none"),
                }
            }
            (Asked::LoadMap { .. } | Asked::Reset { .. } | Asked::Deserialize { .. }, Work::Localising(_)) => {
                Reply::refused(Why::WrongMode, "the finished map stays as it is; start again with another one")
            }
            (Asked::FindAnew | Asked::SetPose(_) | Asked::LoadMap { .. }, Work::Mapping(_)) => Reply::refused(
                Why::WrongMode,
                "a map is being made; to be found in a finished one, start with --localise",
            ),
            _ => Reply::refused(Why::Other, "that is not offered"),
        }
    }

    /// Everything has begun anew.
    fn anew(&mut self) -> Reply {
        self.known.set(None);
        if let Some(ros) = &self.ros {
            let _ = ros.to_draw.send(ToDraw::Anew(Box::new(self.session().clone())));
        }
        Reply::Said(Said::Done)
    }

    /// Writes the results and says what was made and lost.
    pub(super) fn finish(
        mut self,
        args: &LiveArgs,
        played: Option<(String, ReadingReport)>,
        gate: &mut Gate,
        interrupted: bool,
    ) -> Result<Outcome, Failure> {
        self.count_overtaken(gate);
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
        self.show(Some(scan), &update);
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
                self.show(None, &update);
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

    fn asked(&mut self, what: mapwright_live::Asked) {
        let Ok(question) = what.downcast::<Question>() else { return };
        let Question { asked, reply } = *question;
        let answer = self.answer(asked);
        match (reply, answer) {
            // Whoever asked may have gone.
            (Some(reply), answer) => drop(reply.try_send(answer)),
            (None, Reply::Said(Said::Refused(_, words))) => self.notice(&format!("refused: {words}")),
            (None, _) => {}
        }
    }

    fn turn(&mut self, gate: &mut Gate, now: Duration) {
        let is_active = self.ros.as_ref().is_none_or(|ros| ros.node.is_active());
        let is_held = self.view.as_ref().is_some_and(View::is_paused);
        // A recording waits; a robot drives on, and its scans are counted.
        self.is_held.store(is_held, Ordering::Release);
        gate.pause(self.is_paused || is_held && !self.is_played || !is_active);
        if std::mem::take(&mut self.drops_waiting) {
            gate.drop_waiting();
        }
        if now >= self.watched + WATCH_EVERY {
            self.watched = now;
            self.watch(gate, now);
            let words = self.ros.as_ref().map_or_else(Vec::new, |ros| ros.node.words());
            words.iter().chain(&self.at_cable.take()).for_each(|words| self.notice(words));
        }
    }
}

impl Live {
    fn show(&mut self, scan: Option<&LaserScan>, update: &Update) {
        let session = match &self.work {
            Work::Mapping(mapping) => mapping.mapper_session(),
            Work::Localising(localising) => localising.mapper.session(),
        };
        if let Some(view) = &mut self.view {
            view.show(scan, update, session);
        }
    }

    fn draw(&self, update: Update) {
        if let (Some(ros), Work::Mapping(_)) = (&self.ros, &self.work) {
            // Who draws goes last.
            let _ = ros.to_draw.send(ToDraw::Entries(update.entries));
        }
    }
}

/// What a pose in space says of a robot in the plane, with the covariance in the robot's axes.
fn in_the_plane(given: &PoseGiven) -> (Pose2, Cov3) {
    let pose = given.frame_from_robot;
    let theta = pose.rotation.euler_angles().2;
    let entry = |row: usize, column: usize| given.covariance[6 * row + column];
    let places = [0, 1, 5];
    let in_map = Cov3::from_fn(|row, column| entry(places[row], places[column]));
    let turned = Rotation3::from_axis_angle(&Vector3::z_axis(), theta);
    let covariance = turned.matrix().transpose() * in_map * turned.matrix();
    (Pose2::new(pose.translation.x, pose.translation.y, theta), covariance)
}
