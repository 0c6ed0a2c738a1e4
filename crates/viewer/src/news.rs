//! What is new of a run, as plain data.

use mapwright_geom::{Pose2, Pose3, TangentMatrix};
use mapwright_record::{Candidate, Measurement, Status, Verdict};
use mapwright_sensor::{SpaceSweep, Sweep};
use nalgebra::{Matrix3, UnitQuaternion, Vector3};
use std::sync::Arc;

/// What a keyframe contributes to the picture.
#[derive(Debug, Clone)]
pub enum Seen {
    /// A laser's sweep: cells.
    Plane(Arc<Sweep>),
    /// A cloud: points.
    Space(Arc<SpaceSweep>),
    /// It is left out.
    Nothing,
}

/// Measurements that a view can show.
pub trait View: Measurement {
    /// Whether maps of them have three dimensions.
    const IS_SPACE: bool;

    /// As a picture has it.
    fn seen(sweep: &Arc<Self>) -> Seen;

    /// A pose in space; in the plane z is zero.
    fn in_space(pose: Self::Pose) -> Pose3;

    /// Covariance of the position along the axes of the map, m^2, and standard deviation of the heading, radians, where a pose's right
    /// perturbation has this one.
    fn position(pose: Self::Pose, covariance: &<Self::Pose as mapwright_geom::Pose>::Matrix) -> (Matrix3<f64>, f64);
}

impl View for Sweep {
    const IS_SPACE: bool = false;

    fn seen(sweep: &Arc<Self>) -> Seen {
        Seen::Plane(Arc::clone(sweep))
    }

    fn in_space(pose: Pose2) -> Pose3 {
        Pose3 {
            translation: Vector3::new(pose.x, pose.y, 0.0),
            rotation: UnitQuaternion::from_axis_angle(&Vector3::z_axis(), pose.theta),
        }
    }

    fn position(pose: Pose2, covariance: &nalgebra::Matrix3<f64>) -> (Matrix3<f64>, f64) {
        let mut own = Matrix3::zeros();
        own.fixed_view_mut::<2, 2>(0, 0).copy_from(&covariance.fixed_view::<2, 2>(0, 0));
        let turned = Self::in_space(pose).rotation.to_rotation_matrix();
        (turned * own * turned.transpose(), covariance.rotation_variance_rad2().max(0.0).sqrt())
    }
}

impl View for SpaceSweep {
    const IS_SPACE: bool = true;

    fn seen(sweep: &Arc<Self>) -> Seen {
        Seen::Space(Arc::clone(sweep))
    }

    fn in_space(pose: Pose3) -> Pose3 {
        pose
    }

    fn position(pose: Pose3, covariance: &nalgebra::Matrix6<f64>) -> (Matrix3<f64>, f64) {
        let own: Matrix3<f64> = covariance.fixed_view::<3, 3>(0, 0).into();
        let turned = pose.rotation.to_rotation_matrix();
        (turned * own * turned.transpose(), covariance.rotation_variance_rad2().max(0.0).sqrt())
    }
}

/// A keyframe where it is.
#[derive(Debug, Clone)]
pub struct Placed {
    /// What it saw.
    pub seen: Seen,
    /// Where the robot was, in the map.
    pub map_from_robot: Pose3,
    /// Standard deviation of its position along the direction of which least is known, metres, as the caller knows it: of a robot that
    /// drives relative to the keyframe that its scan was matched against. None where it is not known.
    pub sigma_m: Option<f64>,
    /// How well the robot knew then where it was.
    pub status: Status,
    /// Tracking does not link it with the keyframe before.
    pub is_break: bool,
}

/// A place that the robot may have come back to. Keyframes are numbers in the order they were made, from zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Closure {
    /// The old keyframe.
    pub from: u32,
    /// The present one.
    pub to: u32,
    /// What was decided.
    pub verdict: Verdict,
}

impl Closure {
    /// Of a session's candidate, where it knows both keyframes.
    pub(crate) fn of<M: Measurement>(
        candidate: &Candidate<M::Pose>,
        place: impl Fn(mapwright_record::KeyframeId) -> Option<usize>,
    ) -> Option<Self> {
        let number = |id| place(id).and_then(|place| u32::try_from(place).ok());
        Some(Self { from: number(candidate.from)?, to: number(candidate.to)?, verdict: candidate.verdict })
    }
}

/// The robot now.
#[derive(Debug, Clone, Copy)]
pub struct Robot {
    /// Its pose in the map.
    pub map_from_robot: Pose3,
    /// Covariance of its position along the axes of the map, m^2, relative to the keyframe that its scan was matched against.
    pub position_m2: Matrix3<f64>,
    /// Standard deviation of its heading, radians; in space of its rotation.
    pub heading_sigma_rad: f64,
    /// How well it knows where it is.
    pub status: Status,
    /// Whether what it maps is joined with what was mapped before.
    pub is_joined: bool,
}

/// What is new since the last news. Several in a row amount to one ([`News::add`]).
#[derive(Debug, Clone, Default)]
pub struct News {
    /// Whether the map has three dimensions; says nothing where there are no keyframes.
    pub is_space: bool,
    /// Time since the run began, seconds.
    pub at_s: Option<f64>,
    /// Keyframes that were made, in order.
    pub keyframes: Vec<Placed>,
    /// Keyframes that are drawn otherwise than before, some of their beams or all being left out.
    pub redrawn: Vec<(u32, Seen)>,
    /// Keyframes that were moved by a correction, and where they are now.
    pub moved: Vec<(u32, Pose3)>,
    /// Candidates by their numbers: new ones, and old ones of which something else is thought now.
    pub closures: Vec<(u32, Closure)>,
    /// The robot now.
    pub robot: Option<Robot>,
    /// End points of the newest scan in the robot's frame, metres.
    pub scan: Option<Vec<[f32; 3]>>,
}

impl News {
    /// Takes in what came after.
    pub fn add(&mut self, later: Self) {
        self.is_space |= later.is_space;
        self.keyframes.extend(later.keyframes);
        self.redrawn.extend(later.redrawn);
        self.moved.extend(later.moved);
        self.closures.extend(later.closures);
        self.at_s = later.at_s.or(self.at_s);
        self.robot = later.robot.or(self.robot);
        self.scan = later.scan.or(self.scan.take());
    }
}
