//! Keyframes and the edges between them.

use crate::error::EntryError;
use crate::id::KeyframeId;
use crate::left_out::Beams;
use mapwright_geom::{Pose, Pose2, Stamp};
use mapwright_sensor::Sweep;
use std::fmt::Debug;
use std::sync::Arc;

/// What a keyframe keeps of a sensor's reading: a laser's sweep in the plane, later a cloud in space.
///
/// It knows its own bytes, little endian: what [`Measurement::put`] writes [`Measurement::take`] gives back to the bit. How
/// many there are the log knows, and keeps the sensors that measurements share.
pub trait Measurement: Clone + Debug + PartialEq + Send + Sync + 'static {
    /// The poses of what takes it.
    type Pose: Pose;
    /// What many measurements have in common, and a log holds once: the geometry of their sensor.
    type Sensor: Debug + PartialEq + Send + Sync + 'static;

    /// What a log calls this kind of measurement; each kind has its own.
    const CODE: u8;

    /// The same without some of its beams, as a map is to draw it.
    #[must_use]
    fn without(&self, beams: &Beams) -> Self;

    /// Whether it can be mapped with; a session takes no other.
    ///
    /// # Errors
    /// What it should be and is not.
    fn check(&self) -> Result<(), EntryError>;

    /// The sensor that took it.
    fn sensor(&self) -> &Arc<Self::Sensor>;

    /// Whether both are of one sensor, of a robot that may have several that look different ways.
    fn is_of_one_sensor_with(&self, _other: &Self) -> bool {
        true
    }

    /// Appends a sensor's bytes.
    fn put_sensor(sensor: &Self::Sensor, out: &mut Vec<u8>);

    /// The sensor that has exactly these bytes.
    ///
    /// # Errors
    /// What should have stood there.
    fn take_sensor(bytes: &[u8]) -> Result<Self::Sensor, EntryError>;

    /// Appends its bytes, without the sensor's.
    fn put(&self, out: &mut Vec<u8>);

    /// The measurement of this sensor that has exactly these bytes; whether it can be mapped with is asked apart.
    ///
    /// # Errors
    /// What should have stood there.
    fn take(sensor: &Arc<Self::Sensor>, bytes: &[u8]) -> Result<Self, EntryError>;
}

/// A prepared measurement that the map is made of. It never changes; what a map leaves out of it is a record of its own
/// ([`crate::LeftOut`]).
#[derive(Debug, Clone, PartialEq)]
pub struct Keyframe<M = Sweep> {
    /// Its name.
    pub id: KeyframeId,
    /// When it was taken.
    pub stamp: Stamp,
    /// Number of the scan in arrival order, from zero.
    pub scan: u64,
    /// What the sensor saw.
    pub sweep: Arc<M>,
    /// Its scan hardly fitted when it was made: the finished map says whether it is drawn.
    pub hardly_fits: bool,
}

/// Where an edge's knowledge comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EdgeKind {
    /// The motion model alone.
    Odometry,
    /// A scan matched against the local map, to the keyframe that supplied most of the matched points; the scan alone.
    Match,
    /// A verified return to a place seen before.
    Closure,
}

/// A relative pose of two keyframes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Edge<P: Pose = Pose2> {
    /// The keyframe it starts at.
    pub from: KeyframeId,
    /// The keyframe it leads to.
    pub to: KeyframeId,
    /// Where its knowledge comes from.
    pub kind: EdgeKind,
    /// Pose of `to` in the frame of `from`.
    pub from_from_to: P,
    /// Information of its tangent (right perturbation, translation first; in the plane 1/m^2, 1/(m rad), 1/rad^2).
    pub information: P::Matrix,
}
