//! Keyframes and the edges between them.

use crate::left_out::Beams;
use crate::log::sweep;
use crate::session::EntryError;
use mapwright_geom::{Pose, Pose2, Stamp};
use mapwright_sensor::{BEAM_DROPPED, LaserModel, Sweep};
use std::fmt::Debug;
use std::sync::Arc;

/// Which run of which robot: what the names of keyframes begin with.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct RunId {
    /// The robot.
    pub robot: u128,
    /// Which of its runs, from zero.
    pub session: u32,
}

impl RunId {
    /// The robot of this name: the same on every machine (128-bit FNV-1a of the name's bytes).
    #[must_use]
    pub fn of_robot(name: &str) -> Self {
        const OFFSET: u128 = 0x6c62_272e_07bb_0142_62b8_2175_6295_c58d;
        const PRIME: u128 = 0x0000_0000_0100_0000_0000_0000_0000_013b;
        let robot = name.bytes().fold(OFFSET, |hash, byte| (hash ^ u128::from(byte)).wrapping_mul(PRIME));
        Self { robot, session: 0 }
    }

    /// The keyframe that is the `seq`th of this run, from zero.
    #[must_use]
    pub fn keyframe(self, seq: u32) -> KeyframeId {
        KeyframeId { robot: self.robot, session: self.session, seq }
    }
}

/// Name of a keyframe for ever and across robots. Order within a session is `seq`; stamps are neither unique nor ordered.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct KeyframeId {
    /// Who took it.
    pub robot: u128,
    /// Which run of that robot.
    pub session: u32,
    /// Place in that run's order.
    pub seq: u32,
}

impl KeyframeId {
    /// The run it belongs to.
    #[must_use]
    pub fn run(self) -> RunId {
        RunId { robot: self.robot, session: self.session }
    }
}

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

impl Measurement for Sweep {
    type Pose = Pose2;
    type Sensor = LaserModel;

    const CODE: u8 = 1;

    fn without(&self, beams: &Beams) -> Self {
        let Beams::These(beams) = beams else { return self.blanked() };
        let mut sweep = self.clone();
        for &beam in beams {
            if let Some(code) = sweep.codes.get_mut(beam as usize) {
                *code = BEAM_DROPPED;
            }
        }
        sweep
    }

    fn check(&self) -> Result<(), EntryError> {
        sweep::check(self)
    }

    fn sensor(&self) -> &Arc<LaserModel> {
        &self.laser
    }

    fn put_sensor(laser: &LaserModel, out: &mut Vec<u8>) {
        sweep::put_laser(laser, out);
    }

    fn take_sensor(bytes: &[u8]) -> Result<LaserModel, EntryError> {
        sweep::take_laser(bytes)
    }

    fn put(&self, out: &mut Vec<u8>) {
        sweep::put_sweep(self, out);
    }

    fn take(laser: &Arc<LaserModel>, bytes: &[u8]) -> Result<Self, EntryError> {
        sweep::take_sweep(laser, bytes)
    }
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
