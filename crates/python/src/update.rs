//! What one reading led to.

use crate::arrays::table;
use crate::kind::Kind;
use mapwright::{EdgeKind, Entry, RecordedEdge, Update as MapperUpdate};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;

/// What one scan or cloud led to: where the robot is, how certain that is, and what is new in the map.
#[pyclass(frozen, module = "mapwright")]
pub(crate) struct Update {
    stamp_ns: i64,
    scan: u64,
    pose: Vec<f64>,
    odom: Vec<f64>,
    covariance: Vec<f64>,
    status: &'static str,
    localisation: &'static str,
    keyframe: Option<u32>,
    refused: Option<&'static str>,
    inlier_share: Option<f64>,
    moved: bool,
    closures: Vec<Closure>,
}

impl Update {
    pub(crate) fn of<M: Kind>(update: &MapperUpdate<M>) -> Self {
        let closures = update.entries.iter().filter_map(|entry| match entry {
            Entry::Edge(RecordedEdge { edge, .. }) if edge.kind == EdgeKind::Closure => {
                Some(Closure { from: edge.from.seq, to: edge.to.seq, from_from_to: M::numbers(edge.from_from_to) })
            }
            _ => None,
        });
        Self {
            stamp_ns: update.stamp.0,
            scan: update.scan,
            pose: M::numbers(update.map_from_robot),
            odom: M::numbers(update.odom_from_robot),
            covariance: M::rows(&update.covariance),
            status: update.status.name(),
            localisation: update.localisation.name(),
            keyframe: update.keyframe.map(|keyframe| keyframe.seq),
            refused: update.refused,
            inlier_share: update.matched.map(|matched| matched.inlier_share),
            moved: update.entries.iter().any(|entry| matches!(entry, Entry::Snapshot(_))),
            closures: closures.collect(),
        }
    }
}

#[pymethods]
impl Update {
    /// The reading's time, seconds.
    #[getter]
    fn t(&self) -> f64 {
        mapwright::Stamp(self.stamp_ns).as_secs_f64()
    }

    /// The reading's time, whole nanoseconds.
    #[getter]
    fn stamp_ns(&self) -> i64 {
        self.stamp_ns
    }

    /// Number of the scan or cloud, from zero.
    #[getter]
    fn scan(&self) -> u64 {
        self.scan
    }

    /// Pose of the robot in the map: x, y, yaw; in space x, y, z, qx, qy, qz, qw. Metres and radians.
    #[getter]
    fn pose<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.pose)
    }

    /// Pose of the robot by odometry alone; it never jumps.
    #[getter]
    fn odom<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.odom)
    }

    /// Covariance of the pose relative to the keyframes that it was matched with: 3 x 3, in space 6 x 6, of a right perturbation,
    /// translation first.
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        table(py, self.covariance.clone(), self.covariance.len().isqrt())
    }

    /// "tracking", "degraded" or "lost".
    #[getter]
    fn status(&self) -> &'static str {
        self.status
    }

    /// "joined", or "apart" while the robot maps a fragment of its own after a break.
    #[getter]
    fn localisation(&self) -> &'static str {
        self.localisation
    }

    /// Number of the keyframe that this became; None where it became none.
    #[getter]
    fn keyframe(&self) -> Option<u32> {
        self.keyframe
    }

    /// Why the reading was refused as a whole; None where it was taken.
    #[getter]
    fn refused(&self) -> Option<&'static str> {
        self.refused
    }

    /// Share of what was seen that fits the map, 0 to 1; None where nothing was matched.
    #[getter]
    fn inlier_share(&self) -> Option<f64> {
        self.inlier_share
    }

    /// Whether poses of the past have moved: a trajectory or a map asked for earlier is outdated.
    #[getter]
    fn moved(&self) -> bool {
        self.moved
    }

    /// The loop closures that were accepted.
    #[getter]
    fn closures(&self) -> Vec<Closure> {
        self.closures.clone()
    }

    fn __repr__(&self) -> String {
        let pose: Vec<String> = self.pose.iter().map(|number| format!("{number:.3}")).collect();
        let keyframe = self.keyframe.map_or_else(|| "None".to_owned(), |keyframe| keyframe.to_string());
        format!(
            "Update(scan={}, pose=[{}], status={:?}, keyframe={keyframe}, closures={})",
            self.scan,
            pose.join(", "),
            self.status,
            self.closures.len()
        )
    }
}

/// A loop closure: two keyframes of one place.
#[pyclass(frozen, module = "mapwright")]
#[derive(Clone)]
pub(crate) struct Closure {
    from: u32,
    to: u32,
    from_from_to: Vec<f64>,
}

#[pymethods]
impl Closure {
    /// Number of the earlier keyframe.
    #[getter]
    fn earlier(&self) -> u32 {
        self.from
    }

    /// Number of the later keyframe.
    #[getter]
    fn later(&self) -> u32 {
        self.to
    }

    /// Pose of the later keyframe in the frame of the earlier one, numbers as of `Update.pose`.
    #[getter]
    fn earlier_from_later<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.from_from_to)
    }

    fn __repr__(&self) -> String {
        format!("Closure(earlier={}, later={})", self.from, self.to)
    }
}
