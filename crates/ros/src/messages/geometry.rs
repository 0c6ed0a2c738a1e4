//! Poses, transforms, and the header that most messages begin with.

use super::message;
use crate::encoder::Encoder;
use crate::error::RosError;
use crate::field::{Field, FitCheck, Fixed, mismatch};
use crate::schema::FieldType;
use crate::value::Value;
use crate::wire::{Cursor, Encoding};
use mapwright_geom::{Pose3, Stamp};
use std::borrow::Cow;

/// When and in which frame. ROS 1's has a counter in front, which is written as zero.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Header<'a> {
    /// ROS 1's counter; zero in ROS 2.
    pub seq: u32,
    /// When.
    pub stamp: Stamp,
    /// In which frame.
    pub frame_id: Cow<'a, str>,
}

impl<'a> Field<'a> for Header<'a> {
    const MIN_BYTES: usize = 12;

    fn fit(ty: &FieldType, check: &mut FitCheck<'_>) -> Result<(), RosError> {
        let kind = check.structure(ty, "std_msgs/Header")?;
        let mut next = 0;
        let mut known = vec!["stamp", "frame_id"];
        if check.encoding() == Encoding::Ros1 {
            known.push("seq");
            check.member::<u32>(&kind, "seq", true, &mut next)?;
        }
        check.member::<Stamp>(&kind, "stamp", false, &mut next)?;
        check.member::<Cow<'_, str>>(&kind, "frame_id", false, &mut next)?;
        check.others(&kind, &known);
        Ok(())
    }

    fn read(cursor: &mut Cursor<'a>) -> Result<Self, RosError> {
        let seq = if cursor.encoding() == Encoding::Ros1 { cursor.scalar() } else { Ok(0) };
        Ok(Self {
            seq: seq.map_err(|e| e.inside("seq"))?,
            stamp: Field::read(cursor).map_err(|e| e.inside("stamp"))?,
            frame_id: Field::read(cursor).map_err(|e| e.inside("frame_id"))?,
        })
    }

    fn pick(value: &Value<'a>) -> Result<Self, RosError> {
        let Value::Struct(record) = value else { return Err(mismatch("std_msgs/Header", value)) };
        let part = |name| record.field(name).ok_or_else(|| mismatch("std_msgs/Header", value));
        let seq = record.field("seq").map_or(Ok(0), u32::pick)?;
        Ok(Self { seq, stamp: Stamp::pick(part("stamp")?)?, frame_id: Field::pick(part("frame_id")?)? })
    }

    fn write(&self, out: &mut Encoder) {
        if out.encoding() == Encoding::Ros1 {
            out.scalar(self.seq);
        }
        self.stamp.write(out);
        self.frame_id.write(out);
    }
}

impl<'a> Header<'a> {
    /// A header of a stamp and a frame.
    #[must_use]
    pub fn new(stamp: Stamp, frame_id: &'a str) -> Self {
        Self { seq: 0, stamp, frame_id: Cow::Borrowed(frame_id) }
    }

    /// The frame without the slash that tf1 put in front.
    #[must_use]
    pub fn frame(&self) -> &str {
        self.frame_id.trim_start_matches('/')
    }
}

message! {
    /// A direction, or a place without a frame.
    Vector3 = ["geometry_msgs/Vector3"];
    /// Along x.
    x: f64,
    /// Along y.
    y: f64,
    /// Along z.
    z: f64,
}

message! {
    /// A place, metres.
    Point = ["geometry_msgs/Point"];
    /// Along x.
    x: f64,
    /// Along y.
    y: f64,
    /// Along z.
    z: f64,
}

message! {
    /// A rotation.
    Quaternion = ["geometry_msgs/Quaternion"];
    /// First imaginary part.
    x: f64,
    /// Second imaginary part.
    y: f64,
    /// Third imaginary part.
    z: f64,
    /// Real part.
    w: f64,
}

impl Quaternion {
    fn of(pose: &Pose3) -> Self {
        let q = pose.rotation.quaternion();
        Self { x: q.i, y: q.j, z: q.k, w: q.w }
    }
}

message! {
    /// A place and an orientation.
    Pose = ["geometry_msgs/Pose"];
    /// Where.
    position: Point,
    /// How turned.
    orientation: Quaternion,
}

impl Pose {
    /// The rigid motion; none where the quaternion has no direction.
    #[must_use]
    pub fn to_pose3(&self) -> Option<Pose3> {
        let (t, q) = (&self.position, &self.orientation);
        Pose3::from_quaternion([t.x, t.y, t.z], [q.x, q.y, q.z, q.w])
    }
}

impl From<Pose3> for Pose {
    fn from(pose: Pose3) -> Self {
        let t = pose.translation;
        Self { position: Point { x: t.x, y: t.y, z: t.z }, orientation: Quaternion::of(&pose) }
    }
}

message! {
    /// A rigid motion.
    Transform = ["geometry_msgs/Transform"];
    /// Where.
    translation: Vector3,
    /// How turned.
    rotation: Quaternion,
}

impl Transform {
    /// The rigid motion; none where the quaternion has no direction.
    #[must_use]
    pub fn to_pose3(&self) -> Option<Pose3> {
        let (t, q) = (&self.translation, &self.rotation);
        Pose3::from_quaternion([t.x, t.y, t.z], [q.x, q.y, q.z, q.w])
    }
}

impl From<Pose3> for Transform {
    fn from(pose: Pose3) -> Self {
        let t = pose.translation;
        Self { translation: Vector3 { x: t.x, y: t.y, z: t.z }, rotation: Quaternion::of(&pose) }
    }
}

message! {
    /// `parent_from_child`: the header's frame is the parent.
    TransformStamped<'a> = ["geometry_msgs/TransformStamped"];
    /// When, and the parent.
    header: Header<'a>,
    /// The child.
    child_frame_id: Cow<'a, str>,
    /// Pose of the child seen from the parent.
    transform: Transform,
}

message! {
    /// Transforms published together.
    TfMessage<'a> = ["tf2_msgs/TFMessage", "tf/tfMessage"];
    /// The transforms.
    transforms: Vec<TransformStamped<'a>>,
}

message! {
    /// A pose in a frame.
    PoseStamped<'a> = ["geometry_msgs/PoseStamped"];
    /// When and in which frame.
    header: Header<'a>,
    /// The pose.
    pose: Pose,
}

message! {
    /// A pose and its uncertainty.
    PoseWithCovariance = ["geometry_msgs/PoseWithCovariance"];
    /// The pose.
    pose: Pose,
    /// Of x, y, z and rotations about the fixed axes x, y, z.
    covariance: Fixed<36>,
}

message! {
    /// A pose in a frame and its uncertainty.
    PoseWithCovarianceStamped<'a> = ["geometry_msgs/PoseWithCovarianceStamped"];
    /// When and in which frame.
    header: Header<'a>,
    /// The pose.
    pose: PoseWithCovariance,
}

message! {
    /// Velocities.
    Twist = ["geometry_msgs/Twist"];
    /// Metres per second.
    linear: Vector3,
    /// Radians per second.
    angular: Vector3,
}

message! {
    /// Velocities and their uncertainty.
    TwistWithCovariance = ["geometry_msgs/TwistWithCovariance"];
    /// The velocities.
    twist: Twist,
    /// Of x, y, z and rotations about them.
    covariance: Fixed<36>,
}
