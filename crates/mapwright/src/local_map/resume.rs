//! The local map of a run that is continued: what it was made of is made again from the keyframes and their links.

use super::{Frames, LocalMapping, View};
use crate::patches::Spacing;
use crate::settings::Settings;
use mapwright_geom::Cov3;
use mapwright_grid::Change;
use mapwright_record::NodeId;

/// A keyframe of an earlier run.
pub(crate) struct Earlier {
    pub(crate) node: NodeId,
    /// The keyframes before it that it is linked with, and its covariance relative to each.
    pub(crate) links: Vec<(NodeId, Cov3)>,
    pub(crate) spacing: Spacing,
    /// Closures that lead to it, and their covariances.
    pub(crate) closures: Vec<(NodeId, Cov3)>,
    /// Scans since the keyframe before.
    pub(crate) scans: u64,
}

/// The gate needs no more scans than these to follow a step.
const FOLLOWED_SCANS: u64 = 16;

impl LocalMapping {
    /// Takes a keyframe in without drawing it; they come in their order.
    pub(crate) fn take_in(&mut self, settings: &Settings, frames: Frames<'_>, earlier: &Earlier) {
        let Earlier { node, ref links, spacing, ref closures, scans } = *earlier;
        for (from, covariance) in links {
            self.connect(*from, covariance, spacing);
        }
        let sweep = frames.drawn[node.index()].as_ref();
        self.views.push(View { gone: sweep.is_none(), ..View::default() });
        self.points.clear();
        if let Some(sweep) = sweep {
            self.points.fill(sweep, &mut self.table, settings.scan.free_range_m);
            self.lever_m = self.points.lever_and_reach_m().0;
        }
        if !self.gated {
            return;
        }
        self.patches.add(frames.world_from_robot, self.lever_m, &self.points.hits);
        if sweep.is_some() {
            self.enter_area(settings, frames, node);
        }
        for (from, covariance) in closures {
            self.close(frames, *from, node, covariance);
        }
        for _ in 0..scans.min(FOLLOWED_SCANS) {
            self.follow_gate(settings, frames);
        }
    }

    /// Draws what is wanted, once all keyframes are taken in.
    pub(crate) fn draw_wanted(&mut self, settings: &Settings, frames: Frames<'_>) {
        self.due.clear();
        for node in NodeId::first(self.views.len()) {
            if self.is_wanted(node) {
                self.draw(settings, frames, node, Change::Add);
            }
        }
        self.patches.settle_all();
        self.waiting.clear();
        self.map.refresh();
    }
}
