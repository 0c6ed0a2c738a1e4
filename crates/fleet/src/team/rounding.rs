//! What is told, in no more figures than mean something.

use mapwright::{Cov3, Entry, Pose2, RecordedEdge};

/// Poses are told in steps of a metre or a radian divided by this: 2^20.
const POSE_STEPS: f64 = 1_048_576.0;

/// An entry as others are told it: poses to a millionth of a metre, information and covariances in single precision. More is noise, and
/// takes most of a message.
pub(super) fn rounded(entry: &Entry) -> Entry {
    let mut entry = entry.clone();
    match &mut entry {
        Entry::Keyframe { map_from_keyframe, .. } => round_pose(map_from_keyframe),
        Entry::Edge(RecordedEdge { edge, .. }) => {
            round_pose(&mut edge.from_from_to);
            round_matrix(&mut edge.information);
        }
        Entry::Remeasured { from_from_to, information, .. } => {
            round_pose(from_from_to);
            round_matrix(information);
        }
        Entry::Candidate(candidate) => {
            candidate.from_from_to.iter_mut().for_each(round_pose);
            round_matrix(&mut candidate.covariance);
        }
        Entry::Snapshot(snapshot) => snapshot.map_from_keyframe.iter_mut().for_each(|(_, pose)| round_pose(pose)),
        _ => {}
    }
    entry
}

fn round_pose(pose: &mut Pose2) {
    for number in [&mut pose.x, &mut pose.y, &mut pose.theta] {
        *number = (*number * POSE_STEPS).round() / POSE_STEPS;
    }
}

fn round_matrix(matrix: &mut Cov3) {
    matrix.iter_mut().for_each(|number| *number = f64::from(*number as f32));
}
