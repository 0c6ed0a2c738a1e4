//! The one who maps, and what becomes of it.

use super::asking::{Reply, ToDraw};
use super::beat::{Known, Place, beat};
use super::cable::Words;
use super::clock::Clock;
use super::drawer::{Drawer, Drawn};
use super::node::{Node, Question};
use super::replay::Replay;
use super::robot::{Names, Told};
use super::view::View;
use super::work::{Answer, Driven, Played, Step, Work};
use super::{Entrance, Lanes};
use crate::args::LiveArgs;
use crate::failure::{Failure, Outcome};
use crate::terminal::{count, say};
use mapwright::{Job, JobResult, Pose3, Settings, Stamp, Update};
use mapwright_live::node::asked::{Asked, Said};
use mapwright_live::node::diagnostics::Diagnostics;
use mapwright_live::{Driver, Gate, Passed, Results};
use mapwright_logs::SliceBounds;
use mapwright_ros::RosError;
use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender};
use std::thread::Scope;
use std::time::Duration;

/// What is missing is looked at so often.
const WATCH_EVERY: Duration = Duration::from_secs(1);

/// A robot that drives.
pub(super) struct Live<W: Work> {
    work: W,
    settings: Settings,
    lanes: Lanes,
    door: Arc<Entrance>,
    clock: Arc<Clock>,
    ros: Option<Ros<W::Maps>>,
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
    /// Somebody who watches holds the recording, or the node is not active yet.
    pub(super) is_held: Arc<AtomicBool>,
    band: Option<SliceBounds>,
    is_played: bool,
    pub(super) replay: Option<Replay>,
    is_quiet: bool,
    is_paused: bool,
    drops_waiting: bool,
    /// As [`Gate::told`].
    told_odometry: Option<Pose3>,
    refused: u64,
    /// Why what is mapped is not written, since when.
    unwritten: Option<(Duration, String)>,
    /// The same of earlier times.
    losses: Vec<String>,
}

/// Others, and what they are told.
pub(super) struct Ros<M: Drawn> {
    pub(super) names: Names,
    pub(super) told: Arc<Told>,
    pub(super) node: Arc<Node>,
    pub(super) to_draw: Sender<ToDraw<M>>,
}

impl<W: Work> Live<W> {
    pub(super) fn new(
        (work, settings): (W, Settings),
        (lanes, door): (Lanes, Arc<Entrance>),
        (clock, known): (Arc<Clock>, Arc<Known>),
        args: &LiveArgs,
        (ros, view): (Option<Ros<W::Maps>>, Option<View>),
    ) -> Self {
        let (overtaken, voice) = (vec![0; lanes.scans.len()], args.mapping.voice);
        let is_held = Arc::new(AtomicBool::new(ros.is_some()));
        let live = Self {
            work,
            settings,
            lanes,
            door,
            clock,
            ros,
            view,
            known,
            is_over: Arc::default(),
            overtaken,
            watched: Duration::ZERO,
            missing: BTreeSet::new(),
            diagnostics: Diagnostics::default(),
            at_cable: Arc::default(),
            is_held,
            band: args.ros_names.band,
            is_played: args.log.is_some(),
            replay: None,
            is_quiet: voice.quiet || voice.json,
            is_paused: false,
            drops_waiting: false,
            told_odometry: None,
            refused: 0,
            unwritten: None,
            losses: Vec::new(),
        };
        live.view.iter().for_each(|view| live.notice(&format!("to look at: {}", view.url())));
        live
    }

    /// Begins to draw and to tell, where anybody hears it.
    pub(super) fn start<'scope>(
        &mut self,
        scope: &'scope Scope<'scope, '_>,
        (outlet, heard): (<W::Maps as Drawn>::Outlet, Receiver<ToDraw<W::Maps>>),
        folder: &Path,
    ) {
        let Some(ros) = &self.ros else { return };
        let (clock, node) = (Arc::clone(&self.clock), Arc::clone(&ros.node));
        let (settings, session) = (self.settings, self.work.session().clone());
        let drawer = Drawer { settings, session, folder: folder.to_owned(), band: self.band, clock, node };
        scope.spawn(move || drawer.draw(&heard, outlet));
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
    fn tell(&mut self, update: &Update<W::Maps>, is_located: bool) {
        if !is_located {
            self.known.set(None);
            return;
        }
        // The mapper's own odometry begins where it began; others look up where theirs has the robot.
        let map_from_robot = <W::Maps as Drawn>::in_space(update.map_from_robot);
        let own = <W::Maps as Drawn>::in_space(update.odom_from_robot);
        let odom_from_robot = self.told_odometry.unwrap_or(own);
        self.known.set(Some(Place {
            stamp: update.stamp,
            map_from_odom: map_from_robot * odom_from_robot.inverse(),
            odom_from_robot,
            is_without_odometry: self.told_odometry.is_none(),
        }));
        if let Some(Ros { names, told, .. }) = &self.ros
            && let Ok(bytes) = <W::Maps as Drawn>::pose(&names.map_frame, update)
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
        match asked {
            Asked::Pause => {
                self.pause(!self.is_paused);
                return Reply::Said(Said::Paused(self.is_paused));
            }
            Asked::ClearQueue => {
                self.drops_waiting = true;
                return Reply::Said(Said::Done);
            }
            // Every scan is matched, whether the robot stands or not.
            Asked::NoMotionUpdate => return Reply::Said(Said::Done),
            Asked::Reset { pause } if self.work.is_made() => self.pause(pause),
            _ => {}
        }
        let frame = self.ros.as_ref().map_or("map", |ros| ros.names.map_frame.as_str());
        match self.work.answer(asked, frame) {
            Answer::Reply(reply) => reply,
            Answer::Anew => self.anew(),
        }
    }

    fn pause(&mut self, is_paused: bool) {
        self.is_paused = is_paused;
        self.ros.iter().for_each(|ros| ros.node.tell_paused(is_paused));
    }

    /// Everything has begun anew.
    fn anew(&mut self) -> Reply {
        self.known.set(None);
        if let Some(ros) = &self.ros {
            let _ = ros.to_draw.send(ToDraw::Anew(Box::new(self.work.session().clone())));
        }
        Reply::Said(Said::Done)
    }

    /// Writes the results and says what was made and lost.
    pub(super) fn finish(
        mut self,
        args: &LiveArgs,
        played: Option<(String, Played)>,
        gate: &mut Gate,
        interrupted: bool,
    ) -> Result<Outcome, Failure> {
        self.count_overtaken(gate);
        let arrived: Vec<String> = gate.tallies().map(|(topic, tally)| format!("{topic}: {tally}")).collect();
        let dropped = gate.tallies().flat_map(|(_, tally)| tally.dropped().map(|(_, count)| count)).sum::<u64>();
        self.losses.extend(self.unwritten.take().map(|(_, why)| why));
        if dropped > 0 {
            let what = if W::Maps::IS_IN_SPACE { "cloud" } else { "scan" };
            self.losses.push(format!("{} dropped: {}", count(dropped, what), arrived.join("; ")));
        }
        self.losses.extend(self.replay.iter().flat_map(Replay::losses));
        if self.refused > 0 {
            self.losses.push(format!("{} of transforms or odometry refused", count(self.refused, "message")));
        }
        let topics = self.lanes.scans.join(", ");
        let driven = Driven { args, played, topics, arrived, losses: self.losses, is_interrupted: interrupted };
        self.work.finish(driven)
    }
}

impl<W: Work> Driver for Live<W> {
    type Maps = W::Maps;

    fn add(&mut self, passed: &Passed, gate: &Gate) {
        let stamp = match passed {
            Passed::Scan(scan) => Some(scan.stamp),
            Passed::Cloud(cloud) => Some(cloud.stamp),
            Passed::Reading(_) => None,
        };
        if let (Some(replay), Some(stamp)) = (&mut self.replay, stamp)
            && !replay.take(stamp)
        {
            return;
        }
        self.told_odometry = gate.told();
        match self.work.add(passed) {
            Ok(Some(step)) => self.step(Some(passed), step),
            Ok(None) => {}
            Err(failure) => self.written(Err(failure)),
        }
    }

    fn next_job(&mut self) -> Option<Job<W::Maps>> {
        self.work.next_job()
    }

    fn results(&mut self) -> Results {
        let scans = self.work.newest().next_scan();
        self.replay.as_mut().map_or(Results::Done, |replay| replay.due(scans))
    }

    fn apply(&mut self, job: JobResult<W::Maps>) {
        self.replay.iter_mut().for_each(Replay::taken);
        if let Some(step) = self.work.apply(job) {
            self.step(None, step);
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
        let is_held = is_held || !is_active;
        self.is_held.store(is_held, Ordering::Release);
        gate.pause(self.is_paused || is_held && !self.is_played);
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

impl<W: Work> Live<W> {
    /// What came of a scan, a cloud or a job is told, shown and drawn.
    fn step(&mut self, passed: Option<&Passed>, step: Step<W::Maps>) {
        self.written(step.written);
        self.tell(&step.update, step.is_located);
        if let Some(view) = &mut self.view {
            view.show(passed, &step.update, self.work.newest());
        }
        if let Some(ros) = self.ros.as_ref().filter(|_| self.work.is_made()) {
            // Who draws goes last.
            let _ = ros.to_draw.send(ToDraw::Entries(step.update.entries));
        }
    }
}
