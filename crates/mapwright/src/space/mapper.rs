//! The pipeline in space: cloud in, update out.

use super::front::{FrontEnd, ImuReport, LevelWatch, Matched, Prepared};
use crate::back::BackEnd;
use crate::jobs::{Job, JobResult, Task};
use crate::settings::{Correction, Settings, SettingsError};
use crate::store::{Link, Store};
use crate::told::{self, Newest, Told, Whereabouts};
use mapwright_geom::{Cov6, Pose3, Stamp};
use mapwright_loops::{Scope, Solving, VerifySettings};
use mapwright_record::{KeyframeId, NodeId, RunId, Session, Status, Update};
use mapwright_sensor::{Cloud, ImuReading, ImuTaken, SpaceSweep};

mod resume;

/// Builds a map of space one cloud at a time.
#[derive(Debug, Clone)]
pub struct SpaceMapper {
    store: Store<SpaceSweep>,
    front: FrontEnd,
    back: BackEnd<SpaceSweep>,
    level: LevelWatch,
    newest: Newest,
}

impl SpaceMapper {
    /// A mapper that starts at the map's origin, of a robot called "robot".
    ///
    /// # Errors
    /// A setting outside its range.
    pub fn new(settings: Settings) -> Result<Self, SettingsError> {
        Self::of_run(settings, RunId::of_robot("robot"), Pose3::identity())
    }

    /// A mapper whose keyframes are named after this run, and whose robot starts at `map_from_robot`.
    ///
    /// # Errors
    /// A setting outside its range.
    pub fn of_run(settings: Settings, run: RunId, map_from_robot: Pose3) -> Result<Self, SettingsError> {
        settings.validate()?;
        Ok(Self {
            store: Store::new(run, settings.to_text()),
            front: FrontEnd::new(settings, map_from_robot),
            back: BackEnd::new(&settings),
            level: LevelWatch::default(),
            newest: Newest { stamp: Stamp(0), status: Status::Tracking },
        })
    }

    /// Remembers a reading of an inertial sensor, for the robot's rotation between clouds and during a sweep, and for where down is:
    /// hand in what was read before the end of a sweep before its cloud. What comes late, in disorder or not at all is counted
    /// ([`SpaceMapper::imu_report`]) and does no harm.
    pub fn add_imu(&mut self, reading: ImuReading) -> ImuTaken {
        self.front.add_imu(reading)
    }

    /// What became of the readings so far.
    #[must_use]
    pub fn imu_report(&self) -> ImuReport {
        self.front.imu_report()
    }

    /// One cloud through the pipeline.
    pub fn add_cloud(&mut self, cloud: &Cloud) -> Update<SpaceSweep> {
        // 1. Prepare: points in the robot's frame, undistorted and thinned, what was dropped counted.
        // 2. Predict: the pose by odometry or constant velocity and inertial readings, its covariance the match's prior.
        let prepared = self.front.prepare(cloud);
        // 3. Match against the local map, with a guard.
        let matched = self.front.track(cloud, &prepared);
        self.front.settle(self.store.past(), cloud, &prepared, matched.as_ref());
        // 4. Insert a keyframe when the robot has moved enough.
        let keyframe = self.insert_if_moved(cloud, matched.as_ref());
        // 5. The local map follows what is certain relative to the robot.
        self.front.follow(self.store.past());
        let odom_from_robot = self.front.pose().odom_from_robot();
        self.store.add_scan(cloud.stamp, self.front.local_from_robot(), odom_from_robot);
        // 6. and 7. Detect and correct.
        if keyframe.is_some() {
            self.detect();
            self.keep_level();
        }
        // 8. Report.
        let status = matched.as_ref().map_or(self.status_unmatched(), |matched| matched.status);
        self.newest = Newest { stamp: cloud.stamp, status };
        let Prepared { beams, refused, .. } = prepared;
        self.report(Told { keyframe, beams, matched: matched.map(|matched| matched.report), refused })
    }

    fn status_unmatched(&self) -> Status {
        if self.store.len() <= 1 { Status::Tracking } else { Status::Degraded }
    }

    fn insert_if_moved(&mut self, cloud: &Cloud, matched: Option<&Matched>) -> Option<NodeId> {
        let Self { store, front, back, .. } = self;
        let new = front.new_keyframe(store.past(), cloud, matched)?;
        let written = back.write(store, &new, Link::Odometry)?;
        front.wrote(store.past(), &new, &written);
        if let Some(down) = front.take_down() {
            store.add_gravity(written.node, &down);
        }
        Some(written.node)
    }

    /// Looks for old places from time to time, and at those that the local map has and nobody has looked at.
    fn detect(&mut self) {
        let Self { store, front, back, .. } = self;
        let past = store.past();
        if back.is_busy() || !back.closing.is_due(past) {
            return;
        }
        let Some(submaps) = front.submaps(VerifySettings::in_space()) else { return };
        let known = front.survey(past);
        let verification = back.closing.propose(past, &known, front.old_place_nearby(past), submaps);
        verification.into_iter().for_each(|verification| back.push(Task::Verify(Box::new(verification))));
        self.work_inline();
    }

    /// The next job to be done, where jobs are handed out (`loops.jobs`); its result goes to [`SpaceMapper::apply`], after whichever
    /// cloud it is there.
    pub fn next_job(&mut self) -> Option<Job<SpaceSweep>> {
        self.back.hand_out()
    }

    /// Takes a job's result in. It may be late: what was inserted since is carried along.
    ///
    /// A result that does not belong to this mapper is left out.
    pub fn apply(&mut self, result: JobResult<SpaceSweep>) -> Update<SpaceSweep> {
        self.back.came_back();
        self.take_in(result);
        self.report(Told::default())
    }

    fn take_in(&mut self, result: JobResult<SpaceSweep>) {
        let Self { store, front, back, .. } = self;
        let correction = front.settings().loops.correction;
        back.take_in(store, front, result.0, correction);
    }

    /// Solves the graph where gravity says that the map leans.
    fn keep_level(&mut self) {
        let Self { store, front, back, level, .. } = self;
        let solves = front.settings().loops.correction == Correction::Graph;
        if solves && !back.is_busy() && level.is_leaning(store.session()) {
            let (graph, closures) = (store.graph(), store.closures());
            back.push(Task::Solve(Solving { graph, closures, scope: Scope::Whole }));
            self.work_inline();
        }
    }

    /// Does the jobs at once, where they are not handed out.
    fn work_inline(&mut self) {
        while let Some(job) = self.back.next_inline() {
            self.take_in(job.run());
        }
    }

    fn report(&mut self, told: Told) -> Update<SpaceSweep> {
        let robot = Whereabouts {
            pose: self.front.pose(),
            map_from_robot: self.store.map_from_local() * self.front.local_from_robot(),
            covariance: self.front.covariance(self.store.past()),
            localisation: self.back.localisation(),
            local_map: self.front.local_map_report(),
        };
        told::update(&mut self.store, robot, self.newest, told)
    }

    /// How certain each keyframe is relative to the newest one: covariance of the newest one's pose seen from it, a right perturbation,
    /// translation first, metres and radians.
    pub fn certainty(&mut self) -> Vec<(KeyframeId, Cov6)> {
        let known = self.front.survey(self.store.past());
        known.into_iter().map(|known| (self.store.id(known.first), known.covariance)).collect()
    }

    /// Everything that lasts of the run so far: what the entries of all updates amount to.
    #[must_use]
    pub fn session(&self) -> &Session<SpaceSweep> {
        self.store.session()
    }

    /// The settings in force.
    #[must_use]
    pub fn settings(&self) -> &Settings {
        self.front.settings()
    }

    /// Voxels of all resolutions that clouds are matched with: what the local map takes in memory.
    #[must_use]
    pub fn local_map_voxels(&self) -> usize {
        self.front.local_map_voxels()
    }

    /// Side of the smallest voxels, metres, once there was a cloud with enough points to derive it from.
    #[must_use]
    pub fn resolution_m(&self) -> Option<f64> {
        self.front.scale().map(|scale| scale.resolution_m)
    }

    /// How far the sensor sees, root mean square of the first such cloud's ranges, metres.
    #[must_use]
    pub fn range_m(&self) -> Option<f64> {
        self.front.scale().map(|scale| scale.range_m)
    }
}
