//! The plane and space: poses, covariances and sessions of both as numbers.

use mapwright::{Maps, Pose2, Pose3, Session, SpaceSweep, Sweep};
use mapwright_cli::AnySession;
use mapwright_geom::Pose;
use mapwright_record::Measurement;

/// The plane or space: how poses and covariances are told as numbers.
pub(crate) trait Kind: Maps {
    /// Numbers of a pose.
    const POSE: usize;

    fn numbers(pose: Self::Pose) -> Vec<f64>;
    /// A covariance, row by row.
    fn rows(matrix: &Covariance<Self>) -> Vec<f64>;
    /// The session, if it is of this kind.
    fn session(any: AnySession) -> Option<Session<Self>>;
}

/// A covariance of poses.
pub(crate) type Covariance<M> = <<M as Measurement>::Pose as Pose>::Matrix;

impl Kind for Sweep {
    const POSE: usize = 3;

    fn numbers(pose: Pose2) -> Vec<f64> {
        vec![pose.x, pose.y, pose.theta]
    }

    fn rows(matrix: &Covariance<Self>) -> Vec<f64> {
        matrix.transpose().iter().copied().collect()
    }

    fn session(any: AnySession) -> Option<Session<Self>> {
        match any {
            AnySession::Plane(session) => Some(session),
            AnySession::Space(_) => None,
        }
    }
}

impl Kind for SpaceSweep {
    const POSE: usize = 7;

    fn numbers(pose: Pose3) -> Vec<f64> {
        let rotation = pose.rotation.coords; // x, y, z, w
        pose.translation.iter().chain(rotation.iter()).copied().collect()
    }

    fn rows(matrix: &Covariance<Self>) -> Vec<f64> {
        matrix.transpose().iter().copied().collect()
    }

    fn session(any: AnySession) -> Option<Session<Self>> {
        match any {
            AnySession::Space(session) => Some(session),
            AnySession::Plane(_) => None,
        }
    }
}

/// Time in seconds and pose of each scan.
pub(crate) fn trajectory_rows<M: Kind>(session: &Session<M>) -> Vec<f64> {
    let mut rows = Vec::with_capacity(session.scans().len() * (1 + M::POSE));
    for pose in session.trajectory() {
        rows.push(pose.stamp.as_secs_f64());
        rows.extend(M::numbers(pose.map_from_robot));
    }
    rows
}

/// Time of each scan, nanoseconds.
pub(crate) fn stamps_of<M: Kind>(session: &Session<M>) -> Vec<i64> {
    session.scans().iter().map(|scan| scan.stamp.0).collect()
}
