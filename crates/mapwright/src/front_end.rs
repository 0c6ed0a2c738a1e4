//! What a mapper asks of a front end, in the plane or in space: the one place where the two differ, beside what submaps are
//! ([`Submaps`](mapwright_loops::Submaps)).

use crate::cycles::Follows;
use crate::pose::RobotPose;
use crate::settings::Settings;
use crate::store::{NewKeyframe, Slipped, Written};
use crate::watch::Watch;
use mapwright_geom::{Pose, Pose2, Pose3, Stamp};
use mapwright_loops::{Closes, KnownPlace};
use mapwright_record::{
    FragmentStart, LocalMapReport, MatchReport, Measurement, NodeId, Past, Session, Status, Update,
};
use mapwright_sensor::{BeamCounts, Cloud, DownEstimate, LaserScan};
use std::fmt::Debug;

/// A measurement that maps are made of. Implemented by [`Sweep`](mapwright_sensor::Sweep), in the plane, and by
/// [`SpaceSweep`](mapwright_sensor::SpaceSweep); it cannot be implemented elsewhere.
pub trait Maps: Closes {
    /// What a sensor hands over.
    type Scan: Reading<Self::Pose>;
    /// Where the robot is from scan to scan.
    #[doc(hidden)]
    type FrontEnd: FrontEnd<Self>;
    /// Where it is in a finished map.
    #[doc(hidden)]
    type Locator: Locates<Self>;
}

/// Covariances of a kind of measurement's poses.
pub(crate) type CovarianceOf<M> = <<M as Measurement>::Pose as Pose>::Matrix;

/// What every reading says beside what was seen.
pub trait Reading<P: Pose> {
    /// When it was taken.
    fn stamp(&self) -> Stamp;

    /// The robot's own odometry then, if it came along and can be used.
    fn odom_from_robot(&self) -> Option<P>;
}

impl Reading<Pose2> for LaserScan {
    fn stamp(&self) -> Stamp {
        self.stamp
    }

    fn odom_from_robot(&self) -> Option<Pose2> {
        self.odom_from_robot.filter(|pose| pose.is_finite())
    }
}

impl Reading<Pose3> for Cloud {
    fn stamp(&self) -> Stamp {
        self.stamp
    }

    fn odom_from_robot(&self) -> Option<Pose3> {
        self.odom_from_robot.filter(|pose| pose.is_finite())
    }
}

/// A scan that was prepared, and where the robot should be.
#[derive(Debug, Clone, Copy)]
pub struct Prepared<P: Pose, S> {
    pub(crate) step: S,
    /// The prediction, in the front end's frame; its covariance is the step's.
    pub(crate) predicted: P,
    pub(crate) odom_from_robot: Option<P>,
    pub(crate) beams: BeamCounts,
    pub(crate) refused: Option<&'static str>,
}

/// That of a kind of measurement.
pub(crate) type PreparedOf<M> = Prepared<<M as Measurement>::Pose, <<M as Maps>::FrontEnd as FrontEnd<M>>::Step>;

/// What its match stage hands on.
pub(crate) type MatchedOf<M> = <<M as Maps>::FrontEnd as FrontEnd<M>>::Matched;

/// What came of a match.
pub trait Found {
    /// How it went.
    fn status(&self) -> Status;

    /// What is told of it.
    fn report(&self) -> MatchReport;

    /// Whether its pose is believed.
    fn is_believed(&self) -> bool {
        self.status() != Status::Lost
    }
}

/// A front end that goes on with an earlier run.
pub trait Resumes<M: Measurement>: Sized {
    /// Of a checkpoint's bytes; another one's are not read.
    const VERSION: u8;

    /// Appends its bytes, between two scans.
    fn put(&self, out: &mut Vec<u8>);

    /// Goes on as it was; `past` is all of the session. None where these are no such bytes.
    fn restore(settings: Settings, past: Past<'_, M>, from: &mut &[u8]) -> Option<Self>;

    /// Goes on where a session ends, by keyframes and edges alone; `past` is all of it.
    fn resume(settings: Settings, past: Past<'_, M>) -> Self;
}

/// The present scan, prediction, tracker, the robot's pose and the local map, in a frame of its own in which the newest keyframe never
/// jumps. What it finds it returns.
pub trait FrontEnd<M: Maps>: Clone + Debug + Resumes<M> + Follows<M> {
    /// How the robot has moved since the scan before, and how sure that is.
    type Step: Copy + Debug;
    /// What the match stage hands on.
    type Matched: Found;

    /// One whose robot starts here.
    fn new(settings: Settings, local_from_robot: M::Pose) -> Self;

    /// The settings in force.
    fn settings(&self) -> &Settings;

    /// The robot's pose.
    fn pose(&self) -> &RobotPose<M::Pose>;

    /// Where the robot was at the newest stamp.
    fn local_from_robot(&self) -> M::Pose {
        self.pose().local_from_robot()
    }

    /// Covariance of that relative to the anchor.
    fn covariance(&self, past: Past<'_, M>) -> CovarianceOf<M> {
        self.pose().covariance(past)
    }

    /// Steps 1 and 2: what was seen, what was dropped counted, and where the robot should be.
    fn prepare(&mut self, scan: &M::Scan) -> PreparedOf<M>;

    /// Whether the present scan shows anything to be matched.
    fn sees(&self) -> bool;

    /// Since when nothing was seen, and how many scans in a row were not believed.
    fn watch(&self) -> &Watch;

    /// Usual time from scan to scan, seconds; zero while it is not known.
    fn usual_period_s(&self) -> f64;

    /// Whether the robot has not moved from the scan before, as far as its wheels or its velocity say.
    fn has_stood(&self, prepared: &PreparedOf<M>) -> bool;

    /// Whether the scan before is longer ago than is usual.
    fn is_after_gap(&self, prepared: &PreparedOf<M>) -> bool;

    /// Whether the prediction is so uncertain that a match may find a place that only looks like the right one.
    fn has_strayed(&self, prepared: &PreparedOf<M>) -> bool;

    /// Whether the robot is known to be where something is known all the same, though it may have been carried for such a reason; the
    /// prediction is put right then.
    fn is_known_to_be(
        &mut self,
        past: Past<'_, M>,
        scan: &M::Scan,
        prepared: &mut PreparedOf<M>,
        why: FragmentStart,
    ) -> bool;

    /// Whether the scan was matched so badly, and where the robot is so unlikely to be, that it may be anywhere.
    fn is_found_nowhere(&self, _prepared: &PreparedOf<M>, _matched: &Self::Matched) -> bool {
        false
    }

    /// Step 3: the scan against the local map. What was prepared may have been predicted wrongly, and is then predicted otherwise.
    fn track(&mut self, past: Past<'_, M>, scan: &M::Scan, prepared: &mut PreparedOf<M>) -> Option<Self::Matched>;

    /// What is known is not matched against any more.
    fn leave(&mut self);

    /// Takes over the new pose and its covariance, now that it is known whether the match is believed.
    fn settle(&mut self, past: Past<'_, M>, scan: &M::Scan, prepared: &PreparedOf<M>, matched: Option<&Self::Matched>);

    /// Points of the newest keyframe, where the present scan is one, that were left out once its pose was known, for they lie on what moves.
    fn moving(&self) -> u32 {
        0
    }

    /// A slip of the wheels that scans tell together, while nothing is under way (`busy`).
    fn watch_slips(
        &mut self,
        _past: Past<'_, M>,
        _step: Self::Step,
        _matched: Option<&Self::Matched>,
        _busy: bool,
        _is_closed_since: impl Fn(NodeId) -> bool,
    ) -> Option<Slipped<M::Pose>> {
        None
    }

    /// A slip was corrected in the past, which was `before`; the robot follows.
    fn slip(&mut self, _past: Past<'_, M>, _before: &[M::Pose], _slipped: &Slipped<M::Pose>) {}

    /// Step 4: a keyframe, once the robot has moved enough and sees something.
    fn new_keyframe(
        &mut self,
        past: Past<'_, M>,
        scan: &M::Scan,
        matched: Option<&Self::Matched>,
    ) -> Option<NewKeyframe<M>>;

    /// One at its predicted place, if anything is seen.
    fn keyframe_unmatched(&self, past: Past<'_, M>, scan: &M::Scan) -> Option<NewKeyframe<M>>;

    /// The keyframe was written: it joins the local map.
    fn wrote(&mut self, past: Past<'_, M>, new: &NewKeyframe<M>, written: &Written<M::Pose>);

    /// The first of a fragment was written: the robot goes on from there.
    fn began_fragment(&mut self, past: Past<'_, M>, stamp: Stamp, new: &NewKeyframe<M>, written: &Written<M::Pose>);

    /// Where down is at a keyframe that was made of the present scan, where that is known well enough and was not told yet.
    fn take_down(&mut self) -> Option<DownEstimate> {
        None
    }

    /// Whether the map leans, as what was written of where down is says; true once for each time.
    fn is_leaning(&mut self, _session: &Session<M>) -> bool {
        false
    }

    /// Step 5, once a scan: the local map follows what is certain relative to the robot.
    fn follow(&mut self, past: Past<'_, M>, inserted: bool);

    /// How submaps are drawn and looked for; none before anything was seen.
    fn submaps(&self) -> Option<M::Submaps>;

    /// How certain old places are relative to the newest keyframe.
    fn survey(&mut self, past: Past<'_, M>) -> Vec<KnownPlace<M::Pose>>;

    /// The place that the newest keyframe is matched against: where it is an old one that nobody has looked at, it is looked at.
    fn support(&self, past: Past<'_, M>) -> Option<NodeId>;

    /// A robot is switched on: of how it moves, what it saw last and what is wrong with its odometry nothing is known.
    fn switch_on(&mut self);

    /// Takes in the newest keyframe, which another session brings along, with the edges that lead to it, from a number on; `is_first`
    /// where a fragment begins.
    fn take_in(&mut self, past: Past<'_, M>, first_edge: usize, is_first: bool);

    /// A keyframe is taken out for good; before it is left out of what is drawn.
    fn drop_keyframe(&mut self, past: Past<'_, M>, node: NodeId);

    /// What the local map consists of.
    fn local_map_report(&self) -> LocalMapReport;
}

/// Finds a robot in a finished map.
pub trait Locates<M: Maps>: Clone + Debug + Sized {
    /// One for the map of a session; none where joins with it, as they are found while mapping, say where the robot is.
    fn of(settings: &Settings, session: &Session<M>) -> Option<Self>;

    /// Takes the newest scan in; `is_believed` where it fits what the front end has mapped, `is_break` where the robot may be anywhere.
    fn see(&mut self, front: &M::FrontEnd, is_break: bool, is_believed: bool);

    /// What an update says of the newest scan, by the finished map alone.
    fn report(&self, update: &mut Update<M>);
}

/// In space the robot is where a join with the finished map has it: there is no other locator.
#[derive(Debug, Clone, Copy)]
pub enum ByJoins {}

impl<M: Maps> Locates<M> for ByJoins {
    fn of(_settings: &Settings, _session: &Session<M>) -> Option<Self> {
        None
    }

    fn see(&mut self, _front: &M::FrontEnd, _is_break: bool, _is_believed: bool) {
        match *self {}
    }

    fn report(&self, _update: &mut Update<M>) {
        match *self {}
    }
}
