//! The pipeline: scan in, update out. Written once for the plane and for space.

use crate::back::BackEnd;
use crate::breaks;
use crate::front::BEFORE;
use crate::front_end::{Found, FrontEnd, Locates, Maps, MatchedOf, PreparedOf, Reading, Resumes};
use crate::jobs::{Job, JobResult, Task};
use crate::probe::{NoProbe, Probe, Stage};
use crate::settings::{Correction, Settings, SettingsError};
use crate::store::{Link, NewKeyframe, Store};
use crate::told::{self, Newest, Told, Whereabouts};
use mapwright_geom::{Pose, Stamp};
use mapwright_loops::{KnownPlace, Solving, is_old};
use mapwright_record::{
    Beams, Candidate, Edge, FragmentStart, Keyframe, KeyframeId, LeftOutReason, LocalMapReport, Localisation, NodeId,
    RunId, Session, Status, TrajectoryPose, Update,
};
use mapwright_sensor::{SpaceSweep, Sweep};
use std::sync::Arc;

mod adopt;
mod again;
mod checkpoint;
mod plane;
mod runs;
mod sighted;
mod space;

pub(crate) use adopt::weigh_ways;
pub use adopt::{Adopted, WaysSeen};
pub use sighted::Sighted;
pub use space::SpaceReading;

/// Builds a map one scan at a time: [`Mapper`] in the plane, [`SpaceMapper`] in space.
#[derive(Debug, Clone)]
pub struct MapperOf<M: Maps> {
    store: Store<M>,
    front: M::FrontEnd,
    back: BackEnd<M>,
    newest: Newest,
    /// Where a robot that is only located is in the finished map.
    locator: Option<Box<M::Locator>>,
    /// What other robots said of their ways, beside what they saw.
    ways: WaysSeen,
}

/// Builds a map of the plane one scan at a time.
pub type Mapper = MapperOf<Sweep>;

/// Builds a map of space one cloud at a time.
pub type SpaceMapper = MapperOf<SpaceSweep>;

impl<M: Maps> MapperOf<M> {
    /// A mapper that starts at the map's origin, of a robot called "robot".
    ///
    /// # Errors
    /// A setting outside its range.
    pub fn new(settings: Settings) -> Result<Self, SettingsError> {
        Self::starting_at(settings, M::Pose::identity())
    }

    /// A mapper whose robot starts at `map_from_robot`.
    ///
    /// # Errors
    /// A setting outside its range.
    pub fn starting_at(settings: Settings, map_from_robot: M::Pose) -> Result<Self, SettingsError> {
        Self::of_run(settings, RunId::of_robot("robot"), map_from_robot)
    }

    /// A mapper whose keyframes are named after this run, and whose robot starts at `map_from_robot`.
    ///
    /// # Errors
    /// A setting outside its range.
    pub fn of_run(settings: Settings, run: RunId, map_from_robot: M::Pose) -> Result<Self, SettingsError> {
        settings.validate()?;
        Ok(Self {
            store: Store::new(run, settings.to_text()),
            front: M::FrontEnd::new(settings, map_from_robot),
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
    pub fn resume(settings: Settings, session: Session<M>) -> Result<Self, SettingsError> {
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
    fn made_again(settings: Settings, mut store: Store<M>) -> (Store<M>, BackEnd<M>, M::FrontEnd) {
        let back = BackEnd::made_again(&settings, &mut store);
        let front = M::FrontEnd::resume(settings, store.past());
        (store, back, front)
    }

    /// One scan or cloud through the pipeline; of a robot with several lasers those of all in turn, each with its own [`LaserModel`].
    ///
    /// [`LaserModel`]: mapwright_sensor::LaserModel
    pub fn add_scan(&mut self, scan: &M::Scan) -> Update<M> {
        self.add_scan_probed(scan, &mut NoProbe)
    }

    /// As [`MapperOf::add_scan`], telling `probe` when each stage ends.
    pub fn add_scan_probed(&mut self, scan: &M::Scan, probe: &mut impl Probe) -> Update<M> {
        probe.begin();
        // 1. Prepare: what was seen, what was dropped counted.
        // 2. Predict: the pose by odometry or constant velocity, its covariance the match's prior.
        let mut prepared = self.front.prepare(scan);
        probe.end(Stage::Prepare);
        // 3. Match against the local map, with a guard; over a break nothing that is known is matched against.
        let switched_on = self.store.is_switched_on();
        let (past, front) = (self.store.past(), &mut self.front);
        let (matched, start) = match breaks::match_or_begin::<M>(front, past, scan, &mut prepared, switched_on) {
            Ok(matched) => (matched, None),
            Err(start) => (None, Some(start)),
        };
        let matched = matched.as_ref();
        probe.end(Stage::Match);
        self.front.settle(self.store.past(), scan, &prepared, matched);
        self.correct_slips(&prepared, matched);
        // 4. Insert a keyframe when the robot has moved enough, or a fragment begins.
        let keyframe = match start {
            None => self.insert_if_moved(scan, matched),
            Some(start) => self.begin_fragment(scan, start),
        };
        // 5. The local map follows what is certain relative to the robot.
        self.front.follow(self.store.past(), keyframe.is_some());
        self.add_pose_of_scan(scan);
        probe.end(Stage::Insert);
        // 6. and 7. Detect and correct: jobs, done at once or handed out. What is finished is not corrected: there the robot is located.
        match &mut self.locator {
            Some(locator) => locator.see(&self.front, start.is_some(), matched.is_none_or(Found::is_believed)),
            None => {
                self.detect(keyframe.is_some(), None);
                self.keep_level(keyframe.is_some());
            }
        }
        probe.end(Stage::Close);
        // 8. Report.
        self.newest = Newest { stamp: scan.stamp(), status: self.status_of(matched) };
        let PreparedOf::<M> { mut beams, refused, .. } = prepared;
        beams.moving = beams.moving.saturating_add(self.front.moving());
        self.report(Told { keyframe, beams, matched: matched.map(Found::report), refused })
    }

    /// Moves what was mapped since the wheels slipped, once scans tell that together.
    fn correct_slips(&mut self, prepared: &PreparedOf<M>, matched: Option<&MatchedOf<M>>) {
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

    fn insert_if_moved(&mut self, scan: &M::Scan, matched: Option<&MatchedOf<M>>) -> Option<NodeId> {
        let Self { store, front, back, .. } = self;
        let new = front.new_keyframe(store.past(), scan, matched)?;
        let written = back.write(store, &new, Link::Odometry)?;
        front.wrote(store.past(), &new, &written);
        self.write_down(written.node);
        Some(written.node)
    }

    fn begin_fragment(&mut self, scan: &M::Scan, start: FragmentStart) -> Option<NodeId> {
        let Self { store, front, back, .. } = self;
        let new = front.keyframe_unmatched(store.past(), scan)?;
        let new = NewKeyframe { odometry: breaks::over_break::<M>(start, new.odometry), ..new };
        let written = back.write(store, &new, Link::Break(start))?;
        front.began_fragment(store.past(), scan.stamp(), &new, &written);
        self.write_down(written.node);
        Some(written.node)
    }

    /// Where down is at a new keyframe, where that is known.
    fn write_down(&mut self, node: NodeId) {
        if let Some(down) = self.front.take_down() {
            self.store.add_gravity(node, &down);
        }
    }

    /// Solves the graph where gravity says that the map leans.
    fn keep_level(&mut self, is_keyframe: bool) {
        let Self { store, front, back, .. } = self;
        let solves = front.settings().loops.correction == Correction::Graph;
        if is_keyframe && solves && !back.is_busy() && front.is_leaning(store.session()) {
            let (graph, closures) = (store.graph(), store.closures());
            back.push(Task::Solve(Solving::of::<M::Submaps>(graph, closures)));
            self.work_inline();
        }
    }

    fn add_pose_of_scan(&mut self, scan: &M::Scan) {
        let odom_from_robot = self.front.pose().odom_from_robot();
        if let Some(own_from_robot) = scan.odom_from_robot() {
            self.store.see_odometry(own_from_robot, odom_from_robot);
        }
        self.store.add_scan(scan.stamp(), self.front.local_from_robot(), odom_from_robot);
    }

    /// Looks for old places from time to time, and at once where a match is supported by one that nobody has looked at. What is live is
    /// matched against and need not be looked for; not so the keyframes before `taken_in`, where another session begins that is taken in.
    fn detect(&mut self, is_keyframe: bool, taken_in: Option<NodeId>) {
        let Self { store, front, back, .. } = self;
        let past = store.past();
        back.count_waiting(is_keyframe);
        if !is_keyframe || back.is_busy() {
            return;
        }
        let support = front.support(past);
        if !back.closing.is_due(past) && !support.is_some_and(|support| back.closing.is_unjudged(past, support)) {
            return;
        }
        let mut known = front.survey(past);
        known.iter_mut().for_each(|place| place.live &= taken_in.is_none_or(|first| place.first >= first));
        self.look(known, support);
    }

    fn look(&mut self, known: Vec<KnownPlace<M::Pose>>, support: Option<NodeId>) {
        let Self { store, front, back, .. } = self;
        let Some(submaps) = front.submaps() else { return };
        let verification = back.closing.propose(store.past(), &known, support, submaps);
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

    /// The next job to be done, where jobs are handed out (`loops.jobs`); its result goes to [`MapperOf::apply`], after
    /// whichever scan it is there.
    pub fn next_job(&mut self) -> Option<Job<M>> {
        self.back.hand_out()
    }

    /// Takes a job's result in. It may be late: what was inserted since is carried along.
    ///
    /// A result that does not belong to this mapper is left out.
    pub fn apply(&mut self, result: JobResult<M>) -> Update<M> {
        self.back.came_back();
        self.store.add_result_taken_in();
        self.take_in(result);
        self.report(Told::default())
    }

    fn take_in(&mut self, result: JobResult<M>) {
        let Self { store, front, back, .. } = self;
        let correction = front.settings().loops.correction;
        back.take_in(store, front, result.0, correction);
    }

    /// What has changed since the last update: of a mapper that was just made the beginning of its run.
    pub fn news(&mut self) -> Update<M> {
        self.report(Told::default())
    }

    fn status_of(&self, matched: Option<&MatchedOf<M>>) -> Status {
        let is_first = self.store.next_scan() == 1;
        matched.map_or(if is_first { Status::Tracking } else { Status::Degraded }, Found::status)
    }

    fn report(&mut self, told: Told) -> Update<M> {
        let pose = self.front.pose();
        let robot = Whereabouts {
            pose,
            map_from_robot: self.store.map_from_local() * self.front.local_from_robot(),
            covariance: self.front.covariance(self.store.past()),
            localisation: self.back.localisation(),
            local_map: self.front.local_map_report(),
            waiting_keyframes: self.back.waiting_keyframes(),
        };
        let newest = self.newest;
        let mut update = told::update(&mut self.store, robot, newest, told);
        match &self.locator {
            Some(locator) => locator.report(&mut update),
            // Where a finished map is all that counts, who is not joined with it is nowhere.
            None if self.store.has_finished_map() && update.localisation == Localisation::Apart => {
                update.status = Status::Lost;
            }
            None => {}
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
    pub fn session(&self) -> &Session<M> {
        self.store.session()
    }

    /// Keyframes in the order they were made.
    #[must_use]
    pub fn keyframes(&self) -> &[Arc<Keyframe<M>>] {
        self.session().keyframes()
    }

    /// The edges that stand, in the order they were made.
    pub fn edges(&self) -> impl DoubleEndedIterator<Item = &Edge<M::Pose>> {
        self.session().edges()
    }

    /// Every place the robot may have come back to, in the order they were looked at, taken or not.
    #[must_use]
    pub fn candidates(&self) -> &[Candidate<M::Pose>] {
        self.session().candidates()
    }

    /// Present pose of each keyframe in the map.
    #[must_use]
    pub fn keyframe_poses(&self) -> &[M::Pose] {
        self.session().map_from_keyframe()
    }

    /// The whole trajectory, every scan in arrival order, with every correction made since.
    pub fn trajectory(&self) -> impl ExactSizeIterator<Item = TrajectoryPose<M::Pose>> + '_ {
        self.session().trajectory()
    }

    /// What the local map consists of.
    #[must_use]
    pub fn local_map_report(&self) -> LocalMapReport {
        self.front.local_map_report()
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
}

#[cfg(test)]
mod tests;
