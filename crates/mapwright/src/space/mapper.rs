//! The pipeline in space: cloud in, update out.

use super::front::{FrontEnd, Matched, Prepared};
use crate::back::closing_settings;
use crate::cycles;
use crate::settings::{Settings, SettingsError};
use crate::store::{Link, Store};
use mapwright_geom::{Pose3, Stamp};
use mapwright_loops::{Closing, KnownPlace, Solving, SpaceSubmaps, VerifySettings};
use mapwright_record::{KeyframeId, Localisation, NodeId, RunId, Session, Status, Update};
use mapwright_sensor::{Cloud, SpaceSweep};

/// Builds a map of space one cloud at a time.
#[derive(Debug, Clone)]
pub struct SpaceMapper {
    store: Store<SpaceSweep>,
    front: FrontEnd,
    closing: Closing<SpaceSubmaps>,
    stamp: Stamp,
    status: Status,
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
            closing: Closing::new(closing_settings(&settings)),
            stamp: Stamp(0),
            status: Status::Tracking,
        })
    }

    /// One cloud through the pipeline.
    pub fn add_cloud(&mut self, cloud: &Cloud) -> Update<SpaceSweep> {
        // 1. Prepare: points in the robot's frame, undistorted and thinned, what was dropped counted.
        // 2. Predict: the pose by odometry or constant velocity, its covariance the match's prior.
        let prepared = self.front.prepare(cloud);
        // 3. Match against the local map, with a guard.
        let matched = self.front.track(&prepared);
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
        }
        // 8. Report.
        self.stamp = cloud.stamp;
        self.status = matched.as_ref().map_or(self.status_unmatched(), |matched| matched.status);
        self.report(keyframe, &prepared, matched)
    }

    fn status_unmatched(&self) -> Status {
        if self.store.len() <= 1 { Status::Tracking } else { Status::Degraded }
    }

    fn insert_if_moved(&mut self, cloud: &Cloud, matched: Option<&Matched>) -> Option<NodeId> {
        let Self { store, front, closing, .. } = self;
        let new = front.new_keyframe(store.past(), cloud, matched)?;
        let written = store.add_keyframe(&new, Link::Odometry, |past, anchor| closing.links(past, anchor))?;
        if let Some(edge) = written.unjudged {
            closing.wait(store.past(), edge);
        }
        front.wrote(store.past(), &new, &written);
        Some(written.node)
    }

    /// Looks for old places from time to time, and at once where a match is supported by one that nobody has looked at.
    fn detect(&mut self) {
        let Self { store, front, closing, .. } = self;
        let (past, anchor) = (store.past(), front.pose().anchor());
        let due = closing.is_due(past) || anchor.is_some_and(|anchor| closing.is_unjudged(past, anchor));
        let Some(submaps) = front.submaps(VerifySettings::default()).filter(|_| due) else { return };
        let known = front.survey();
        let Some(verification) = closing.propose(past, &known, anchor, submaps) else { return };
        let correction = front.settings().loops.correction;
        let judged = cycles::judge(closing, store, front, &verification.run(), correction);
        if let Some(solved) = judged.solving.and_then(Solving::run) {
            cycles::correct(closing, store, front, &solved);
        }
    }

    fn report(
        &mut self,
        keyframe: Option<NodeId>,
        prepared: &Prepared,
        matched: Option<Matched>,
    ) -> Update<SpaceSweep> {
        let (entries, unwritten) = self.store.take_fresh();
        let (pose, past) = (self.front.pose(), self.store.past());
        let map_from_robot = self.store.map_from_local() * self.front.local_from_robot();
        let odom_from_robot = pose.odom_from_robot();
        Update {
            scan: self.store.next_scan().saturating_sub(1),
            stamp: self.stamp,
            map_from_robot,
            covariance: pose.covariance(past),
            anchor: pose.anchor().map(|node| self.store.id(node)),
            status: self.status,
            localisation: Localisation::default(),
            map_from_odom: map_from_robot * odom_from_robot.inverse(),
            odom_from_robot,
            keyframe: keyframe.map(|node| self.store.id(node)),
            beams: prepared.beams,
            matched: matched.map(|matched| matched.report),
            refused: prepared.refused,
            local_map: self.front.local_map_report(),
            entries,
            unwritten,
        }
    }

    /// How certain each keyframe is relative to the newest one: standard deviation of the position in the direction in which it is
    /// largest, metres, and that of the rotation about the axis about which it is, radians.
    pub fn certainty(&mut self) -> Vec<(KeyframeId, f64, f64)> {
        let sigmas = |known: KnownPlace| {
            let (m2, rad2) = (known.uncertainty.displacement_m2, known.uncertainty.rotation_rad2);
            (self.store.id(known.first), m2.sqrt(), rad2.sqrt())
        };
        self.front.survey().into_iter().map(sigmas).collect()
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
}
