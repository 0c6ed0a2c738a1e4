//! Patches that wait to be drawn where they belong until a scan meets them.

use super::{Frames, LocalMapping, MET_SHARE, count};
use mapwright_geom::Pose2;
use mapwright_grid::floor_cell;
use mapwright_record::NodeId;

/// Side of the squares by which it is told whether a scan meets a patch that is not drawn where it belongs, metres.
const MEETING_SQUARE_M: f64 = 2.0;
/// Of a patch that is drawn again so many views stay, evenly spread.
pub(super) const REDRAWN_AT_MOST: usize = 16;

impl LocalMapping {
    /// What is certain and was not drawn yet is due as soon as a scan ends on it.
    pub(super) fn meet_waiting(&mut self, hits: &[[f64; 2]], predicted: Pose2) {
        if self.waiting.is_empty() {
            return;
        }
        let mut met = std::mem::take(&mut self.met);
        let (s, c) = predicted.theta.sin_cos();
        let square = |&[x, y]: &[f64; 2]| square([predicted.x + c * x - s * y, predicted.y + s * x + c * y]);
        // Neighbouring beams end in the same square.
        let mut hits_left = hits.iter().map(square).peekable();
        while let Some(square) = hits_left.next() {
            let mut points = 1;
            while hits_left.next_if_eq(&square).is_some() {
                points += 1;
            }
            let first = self.waiting.partition_point(|&(other, _)| other < square);
            for &(_, patch) in self.waiting[first..].iter().take_while(|(other, _)| *other == square) {
                count(&mut met, patch, points);
            }
        }
        let least = MET_SHARE * hits.len() as f64;
        met.sort_unstable_by_key(|&(patch, points)| (std::cmp::Reverse(points), patch));
        for (patch, _) in met.drain(..).filter(|&(_, points)| f64::from(points) > least) {
            let views = self.patches.settle(patch).to_vec();
            let count = views.len();
            let stays = |k: usize| k * REDRAWN_AT_MOST / count != (k + 1) * REDRAWN_AT_MOST / count;
            for (k, view) in views.into_iter().enumerate() {
                if count <= REDRAWN_AT_MOST || stays(k) {
                    self.due.push_back(view);
                } else {
                    self.leave_area(view);
                    self.supersede(view);
                }
            }
            self.waiting.retain(|&(_, other)| other != patch);
        }
        self.met = met;
    }

    /// Notes where the patches around that wait have their obstacles, and where these are drawn if they are.
    pub(super) fn note_waiting(&mut self, frames: Frames<'_>) {
        self.waiting.clear();
        let Some(&at) = frames.world_from_robot.last() else { return };
        let Self { patches, waiting, views, .. } = self;
        let pose = |node: NodeId| frames.world_from_robot[node.index()];
        patches.each_waiting(at, |number, patch| {
            let drawn = patch.views.iter().find_map(|&view| Some(views[view.index()].drawn_at? * pose(view).inverse()));
            for moved in [Some(Pose2::IDENTITY), drawn].into_iter().flatten() {
                let Pose2 { x, y, theta } = moved * pose(patch.first);
                let (s, c) = theta.sin_cos();
                let in_world = |[px, py]: [f64; 2]| [x + c * px - s * py, y + s * px + c * py];
                waiting.extend(patch.outline().map(|point| (square(in_world(point)), number)));
            }
        });
        waiting.sort_unstable();
        waiting.dedup();
    }
}

fn square([x, y]: [f64; 2]) -> (i32, i32) {
    (floor_cell(x / MEETING_SQUARE_M), floor_cell(y / MEETING_SQUARE_M))
}
