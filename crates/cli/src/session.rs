//! `session.mapwright`: what the maps, trajectories and graphs of a run are functions of, for `mapwright export`.

use crate::closures::taken_back;
use crate::drawing::draw;
use crate::failure::Failure;
use crate::image::{MapImage, map_image};
use mapwright::{Edge, EdgeKind, Mapper, Pose2, Settings};
use mapwright_record::{Session, SessionScan};
use std::fs;
use std::path::Path;

/// Its name in the folder of results.
pub(crate) const SESSION: &str = "session.mapwright";

/// The run so far; `odom_from_robot` has odometry's pose at every scan. Keyframes that the map leaves out have no beams.
pub(crate) fn session_of(mapper: &Mapper, odom_from_robot: &[Pose2], left_out: &[u32]) -> Session {
    let gone = taken_back(mapper.candidates());
    let stands = |edge: &&Edge| edge.kind != EdgeKind::Closure || !gone.contains(&[edge.from, edge.to]);
    let scan = |(pose, &odom_from_robot): (mapwright::TrajectoryPose, &Pose2)| SessionScan {
        stamp: pose.stamp,
        map_from_robot: pose.map_from_robot,
        odom_from_robot,
    };
    let mut keyframes = mapper.keyframes().to_vec();
    for &k in left_out {
        if let Some(keyframe) = keyframes.get_mut(k as usize) {
            keyframe.sweep = keyframe.sweep.blanked();
        }
    }
    Session {
        settings: serde_json::to_string(mapper.settings()).unwrap_or_default(),
        scans: mapper.trajectory().zip(odom_from_robot).map(scan).collect(),
        keyframes,
        map_from_keyframe: mapper.keyframe_poses().to_vec(),
        edges: mapper.edges().iter().filter(stands).copied().collect(),
    }
}

/// The session of a folder of results, or that file itself.
pub(crate) fn read_session(path: &Path) -> Result<Session, Failure> {
    let path = if path.is_dir() { path.join(SESSION) } else { path.to_owned() };
    let bytes = fs::read(&path).map_err(|error| Failure::open(&path, format!("{error}; `mapwright map` writes it")))?;
    Session::decode(&bytes).map_err(|cause| Failure::Session { path, cause: cause.to_string() })
}

/// The map of a session, drawn anew.
pub(crate) fn map_of(session: &Session, path: &Path) -> Result<MapImage, Failure> {
    let settings: Settings = serde_json::from_str(&session.settings)
        .map_err(|error| Failure::Session { path: path.to_owned(), cause: format!("its settings: {error}") })?;
    settings.validate()?;
    let poses: Vec<Option<Pose2>> = session.map_from_keyframe.iter().copied().map(Some).collect();
    Ok(map_image(&draw(&settings, &session.keyframes, &poses), settings.map.passes_per_hit))
}
