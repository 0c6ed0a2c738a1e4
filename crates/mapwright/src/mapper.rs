//! The pipeline: scan in, update out.

use crate::back::BackEnd;
use crate::front::{BEFORE, FrontEnd, Matched, Prepared};
use crate::jobs::{Job, JobResult, Task};
use crate::locate::{Location, Locator, Seen, Withdrawal};
use crate::probe::{NoProbe, Probe, Stage};
use crate::render::GlobalMap;
use crate::settings::{Settings, SettingsError};
use crate::store::{Link, Store};
use crate::told::{self, Newest, Told, Whereabouts};
use mapwright_geom::{Pose2, Stamp, TangentMatrix};
use mapwright_grid::{CountGrid, LocalMap};
use mapwright_loops::{KnownPlace, is_old};
use mapwright_record::{
    Beams, Candidate, Edge, FragmentStart, Keyframe, KeyframeId, LeftOutReason, LocalMapReport, NodeId, RunId, Session,
    Status, TrajectoryPose, Update,
};
use mapwright_sensor::{LaserScan, Odometry, TurnRate};
use std::sync::Arc;

mod adopt;
mod again;
mod checkpoint;
mod runs;
mod sighted;

pub(crate) use adopt::weigh_ways;
pub use adopt::{Adopted, WaysSeen};
pub use sighted::Sighted;

/// Builds a map one scan at a time.
#[derive(Debug, Clone)]
pub struct Mapper {
    store: Store,
    front: FrontEnd,
    back: BackEnd,
    newest: Newest,
    /// Where a robot that is only located is in the finished map.
    locator: Option<Box<Locator>>,
    /// What other robots said of their ways, beside what they saw.
    ways: WaysSeen,
}

impl Mapper {
    /// A mapper that starts at the map's origin, of a robot called "robot".
    ///
    /// # Errors
    /// A setting outside its range.
    pub fn new(settings: Settings) -> Result<Self, SettingsError> {
        Self::starting_at(settings, Pose2::IDENTITY)
    }

    /// A mapper whose robot starts at `map_from_robot`.
    ///
    /// # Errors
    /// A setting outside its range.
    pub fn starting_at(settings: Settings, map_from_robot: Pose2) -> Result<Self, SettingsError> {
        Self::of_run(settings, RunId::of_robot("robot"), map_from_robot)
    }

    /// A mapper whose keyframes are named after this run, and whose robot starts at `map_from_robot`.
    ///
    /// # Errors
    /// A setting outside its range.
    pub fn of_run(settings: Settings, run: RunId, map_from_robot: Pose2) -> Result<Self, SettingsError> {
        settings.validate()?;
        Ok(Self {
            store: Store::new(run, settings.to_text()),
            front: FrontEnd::new(settings, map_from_robot),
            back: BackEnd::new(&settings),
            newest: Newest { stamp: Stamp(0), status: Status::Tracking },
            locator: None,
            ways: WaysSeen::default(),
        })
    }

    /// A mapper that goes on where a session ends, as a new run of the robot that ended it: with the next number, its scans and
    /// keyframes after those of the session, the robot where it was.
    ///
    /// Where the session ends with a [checkpoint](Mapper::checkpoint) that was made with the same settings, every pose is the same to
    /// the bit as if the run had never stopped. Else, as after a run that was killed, the local map is made again from keyframes and
    /// edges, and from the last scans how the robot moves. Either way stamps and odometry are taken to go on: a pause is a gap
    /// between two scans. The first update holds the beginning of the run.
    ///
    /// # Errors
    /// A setting outside its range.
    pub fn resume(settings: Settings, session: Session) -> Result<Self, SettingsError> {
        settings.validate()?;
        let run = session.next_run().unwrap_or(RunId::of_robot("robot"));
        let stamp = session.scans().last().map_or(Stamp(0), |scan| scan.stamp);
        let is_alike = session.runs().last().is_some_and(|run| run.settings == settings.to_text());
        let checkpoint = session.checkpoint().filter(|_| is_alike).cloned();
        let store = Store::resume(session, run, settings.to_text());
        let restored = checkpoint.and_then(|checkpoint| checkpoint::restore(settings, &store, &checkpoint.state));
        let (store, back, front) = restored.unwrap_or_else(|| Self::made_again(settings, store));
        let newest = Newest { stamp, status: Status::Tracking };
        Ok(Self { store, front, back, newest, locator: None, ways: WaysSeen::default() })
    }

    /// What keyframes, edges and the last scans say.
    fn made_again(settings: Settings, mut store: Store) -> (Store, BackEnd, FrontEnd) {
        let back = BackEnd::made_again(&settings, &mut store);
        let front = FrontEnd::resume(settings, store.past());
        (store, back, front)
    }

    /// Remembers a reading of the wheels: for scans up to 2 s later that carry none of their own, and for the robot's motion
    /// during a sweep.
    ///
    /// Hand in what was read during a sweep before its scan, as it arrives from a robot.
    pub fn add_odometry(&mut self, odometry: &Odometry) {
        self.front.add_odometry(odometry);
    }

    /// Remembers a reading of a gyroscope, for the robot's motion during a sweep: hand in what was read during it before its
    /// scan. False where it is no rate that a robot can have; it is left out then.
    pub fn add_turn_rate(&mut self, rate: &TurnRate) -> bool {
        self.front.add_turn_rate(rate)
    }

    /// One scan through the pipeline; of a robot with several lasers those of all in turn, each with its own [`LaserModel`].
    ///
    /// [`LaserModel`]: mapwright_sensor::LaserModel
    pub fn add_scan(&mut self, scan: &LaserScan) -> Update {
        self.add_scan_probed(scan, &mut NoProbe)
    }

    /// As [`Mapper::add_scan`], telling `probe` when each stage ends.
    pub fn add_scan_probed(&mut self, scan: &LaserScan, probe: &mut impl Probe) -> Update {
        probe.begin();
        // 1. Prepare: hits and free space as points, what was dropped counted.
        // 2. Predict: the pose by odometry or constant velocity, its covariance the match's prior.
        let prepared = self.front.prepare(scan);
        probe.end(Stage::Prepare);
        // 3. Match against the local map, with a guard; over a break nothing that is known is matched against.
        let start = self.front.find_break(self.store.past(), scan.stamp, &prepared, self.store.is_switched_on());
        let matched = match start {
            None => self.front.track(self.store.past(), scan, &prepared),
            Some(_) => self.front.leave(),
        };
        probe.end(Stage::Match);
        self.front.settle(self.store.past(), scan, &prepared, matched.as_ref());
        self.correct_slips(&prepared, matched.as_ref());
        // 4. Insert a keyframe when the robot has moved enough, or a fragment begins.
        let keyframe = match start {
            None => self.insert_if_moved(scan, matched.as_ref()),
            Some(start) => self.begin_fragment(scan, start),
        };
        // 5. The local map follows what is certain relative to the robot.
        self.front.follow(self.store.past(), keyframe.is_some());
        self.add_pose_of_scan(scan);
        probe.end(Stage::Insert);
        // 6. and 7. Detect and correct: jobs, done at once or handed out. What is finished is not corrected: there the robot is located.
        if self.locator.is_some() {
            self.locate(start.is_some(), matched.as_ref());
        } else {
            self.detect(keyframe.is_some(), None);
        }
        probe.end(Stage::Close);
        // 8. Report.
        let status = self.status_of(matched.as_ref());
        self.newest = Newest { stamp: scan.stamp, status };
        let Prepared { beams, refused, .. } = prepared;
        self.report(Told { keyframe, beams, matched: matched.map(|matched| matched.report), refused })
    }

    /// Moves what was mapped since the wheels slipped, once scans tell that together.
    fn correct_slips(&mut self, prepared: &Prepared, matched: Option<&Matched>) {
        let Self { store, front, back, .. } = self;
        let is_closed_since = |node| store.is_closed_since(node);
        let slipped = front.watch_slips(store.past(), prepared.step, matched, back.is_busy(), is_closed_since);
        let Some(slipped) = slipped else { return };
        // What the last keyframes before were matched with far back may have been led astray by it.
        let doubted = slipped.from.index().saturating_sub(BEFORE)..slipped.from.index();
        let before = store.shift(&slipped, |past, from, to| doubted.contains(&to.index()) && is_old(past, from, to));
        back.closing.forget_since(slipped.from);
        front.slip(store.past(), &before, &slipped);
    }

    fn insert_if_moved(&mut self, scan: &LaserScan, matched: Option<&Matched>) -> Option<NodeId> {
        let Self { store, front, back, .. } = self;
        let new = front.new_keyframe(store.past(), scan, matched)?;
        let written = back.write(store, &new, Link::Odometry)?;
        front.wrote(store.past(), &new, &written);
        Some(written.node)
    }

    fn begin_fragment(&mut self, scan: &LaserScan, start: FragmentStart) -> Option<NodeId> {
        let Self { store, front, back, .. } = self;
        let new = front.first_of_fragment(store.past(), scan, start)?;
        let written = back.write(store, &new, Link::Break(start))?;
        front.began_fragment(store.past(), scan.stamp, &new, &written);
        Some(written.node)
    }

    fn add_pose_of_scan(&mut self, scan: &LaserScan) {
        let pose = self.front.pose();
        if let Some(own_from_robot) = scan.odom_from_robot.filter(|pose| pose.is_finite()) {
            self.store.see_odometry(own_from_robot, pose.odom_from_robot());
        }
        self.store.add_scan(scan.stamp, pose.local_from_robot(), pose.odom_from_robot());
    }

    /// The newest scan as the finished map has it; over a break nothing is known of where the robot is.
    fn locate(&mut self, is_break: bool, matched: Option<&Matched>) {
        let Self { front, locator, .. } = self;
        let Some(locator) = locator else { return };
        let is_believed = matched.is_none_or(Matched::is_believed);
        let local_from_robot = front.pose().local_from_robot();
        locator.see(&Seen { local_from_robot, points: front.points(), is_break, is_believed });
    }

    /// Where the robot is likeliest to be in the finished map, and the evidence; none where nothing is known, and of a mapper that is not
    /// [localising](Mapper::localising).
    #[must_use]
    pub fn location(&self) -> Option<Location> {
        self.locator.as_ref()?.location()
    }

    /// Why the newest scan has withdrawn what was said of where the robot is in the finished map, if it has.
    #[must_use]
    pub fn withdrawal(&self) -> Option<Withdrawal> {
        self.locator.as_ref()?.withdrawal()
    }

    /// Looks for old places from time to time, and at once where a match is supported by one that nobody has looked at. What is live is
    /// matched against and need not be looked for; not so the keyframes before `taken_in`, where another session begins that is taken in.
    fn detect(&mut self, is_keyframe: bool, taken_in: Option<NodeId>) {
        let Self { store, front, back, .. } = self;
        let (past, anchor) = (store.past(), front.pose().anchor());
        let due = || back.closing.is_due(past) || anchor.is_some_and(|anchor| back.closing.is_unjudged(past, anchor));
        if !is_keyframe || back.is_busy() || !due() {
            return;
        }
        let mut known = front.survey();
        known.iter_mut().for_each(|place| place.live &= taken_in.is_none_or(|first| place.first >= first));
        self.look(known, anchor);
    }

    fn look(&mut self, known: Vec<KnownPlace>, anchor: Option<NodeId>) {
        let Self { store, front, back, .. } = self;
        let past = store.past();
        let submaps = front.submaps();
        let verification = back.closing.propose(past, &known, anchor, submaps);
        verification.into_iter().for_each(|verification| back.push(Task::Verify(Box::new(verification))));
        self.work_inline();
    }

    /// Does the jobs at once, where they are not handed out.
    fn work_inline(&mut self) {
        while let Some(job) = self.back.next_inline() {
            self.take_in(job.run());
        }
    }

    /// Does all jobs, those as well that would be handed out.
    fn work_all(&mut self) {
        while let Some(job) = self.back.hand_out() {
            let result = job.run();
            self.back.came_back();
            self.take_in(result);
        }
    }

    /// The next job to be done, where jobs are handed out (`loops.jobs`); its result goes to [`Mapper::apply`], after
    /// whichever scan it is there.
    pub fn next_job(&mut self) -> Option<Job> {
        self.back.hand_out()
    }

    /// Takes a job's result in. It may be late: what was inserted since is carried along.
    ///
    /// A result that does not belong to this mapper is left out.
    pub fn apply(&mut self, result: JobResult) -> Update {
        self.back.came_back();
        self.take_in(result);
        self.report(Told::default())
    }

    fn take_in(&mut self, result: JobResult) {
        let Self { store, front, back, .. } = self;
        let correction = front.settings().loops.correction;
        back.take_in(store, front, result.0, correction);
    }

    /// What has changed since the last update: of a mapper that was just made the beginning of its run.
    pub fn news(&mut self) -> Update {
        self.report(Told::default())
    }

    fn status_of(&self, matched: Option<&Matched>) -> Status {
        let is_first = self.store.next_scan() == 1;
        matched.map_or(if is_first { Status::Tracking } else { Status::Degraded }, |matched| matched.status)
    }

    fn report(&mut self, told: Told) -> Update {
        let pose = self.front.pose();
        let robot = Whereabouts {
            pose,
            map_from_robot: self.store.map_from_local() * pose.local_from_robot(),
            covariance: pose.covariance(self.store.past()),
            localisation: self.back.localisation(),
            local_map: self.front.local_map_report(),
        };
        let newest = self.newest;
        let mut update = told::update(&mut self.store, robot, newest, told);
        if let Some(locator) = &self.locator {
            locator.report(&mut update);
        }
        update
    }

    /// The settings in force.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        self.front.settings()
    }

    /// Everything that lasts of the run so far: what the entries of all updates amount to.
    #[must_use]
    pub fn session(&self) -> &Session {
        self.store.session()
    }

    /// Keyframes in the order they were made.
    #[must_use]
    pub fn keyframes(&self) -> &[Arc<Keyframe>] {
        self.session().keyframes()
    }

    /// The edges that stand, in the order they were made.
    pub fn edges(&self) -> impl DoubleEndedIterator<Item = &Edge> {
        self.session().edges()
    }

    /// Every place the robot may have come back to, in the order they were looked at, taken or not.
    #[must_use]
    pub fn candidates(&self) -> &[Candidate] {
        self.session().candidates()
    }

    /// Present pose of each keyframe in the map.
    #[must_use]
    pub fn keyframe_poses(&self) -> &[Pose2] {
        self.session().map_from_keyframe()
    }

    /// The whole trajectory, every scan in arrival order, with every correction made since.
    pub fn trajectory(&self) -> impl ExactSizeIterator<Item = TrajectoryPose> + '_ {
        self.session().trajectory()
    }

    /// The map that scans are matched against.
    #[must_use]
    pub fn local_map(&self) -> &LocalMap {
        self.front.local_map()
    }

    /// What the local map consists of.
    #[must_use]
    pub fn local_map_report(&self) -> LocalMapReport {
        self.front.local_map_report()
    }

    /// How certain the first keyframe of each patch of the map is relative to the newest one: larger standard deviation
    /// of the position, metres, and that of the heading, radians.
    pub fn certainty(&mut self) -> Vec<(KeyframeId, f64, f64)> {
        let sigmas = |known: KnownPlace| {
            let (m2, rad2) = (known.covariance.position_variance_m2(), known.covariance.rotation_variance_rad2());
            (self.store.id(known.first), m2.sqrt(), rad2.sqrt())
        };
        self.front.survey().into_iter().map(sigmas).collect()
    }

    /// Takes a keyframe out of the map for good: its beams, and what scans are matched against.
    ///
    /// Returns whether there is such a keyframe.
    pub fn drop_keyframe(&mut self, id: KeyframeId) -> bool {
        let Some(node) = self.store.node(id) else { return false };
        self.front.drop_keyframe(self.store.past(), node);
        self.store.leave_out(node, Beams::All, LeftOutReason::Asked);
        true
    }

    /// Counts of every keyframe of the first map ([`Session::maps`]) at its present pose, drawn from scratch on two threads, without those
    /// that hardly fitted and contradict the others: the map to export. Others are drawn by [`GlobalMap::export_believed_of`].
    #[must_use]
    pub fn render(&self) -> CountGrid {
        self.render_with(2)
    }

    /// As [`Mapper::render`], on so many threads; the map is the same.
    #[must_use]
    pub fn render_with(&self, threads: usize) -> CountGrid {
        let mut map = GlobalMap::new(self.settings());
        let maps = self.session().maps();
        map.export_believed_of(self.session(), &maps.into_iter().next().unwrap_or_default(), threads);
        map.into_counts()
    }
}

#[cfg(test)]
mod tests;
