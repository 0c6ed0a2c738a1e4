//! The local map of a run that goes on as if it had never stopped: what was drawn where is drawn again.

use super::{Frames, LocalMapping, View, area};
use crate::patches::Patches;
use crate::settings::Settings;
use mapwright_geom::{Pose2, Stored, is_in_place};
use mapwright_grid::Change;
use mapwright_record::NodeId;

impl LocalMapping {
    pub(crate) fn put(&self, out: &mut Vec<u8>) {
        let views: Vec<(Option<Pose2>, bool)> = self.views.iter().map(|view| (view.drawn_at, view.gone)).collect();
        views.put(out);
        self.map.suppliers().put(out);
        self.patches.put(out);
        (self.halves, self.lever_m, self.inserted_last).put(out);
        self.due.put(out);
        self.waiting.put(out);
        (self.report.gated_out, self.report.let_in, self.report.superseded).put(out);
    }

    /// Goes on as it was; `frames` are of all keyframes.
    pub(crate) fn restore(settings: &Settings, frames: Frames<'_>, from: &mut &[u8]) -> Option<Self> {
        let views: Vec<(Option<Pose2>, bool)> = Stored::take(from)?;
        let suppliers: Vec<Option<u32>> = Stored::take(from)?;
        let mut all = Self { patches: Patches::restore(from, frames.world_from_robot)?, ..Self::new(settings) };
        (all.halves, all.lever_m, all.inserted_last) = Stored::take(from)?;
        (all.due, all.waiting) = (Stored::take(from)?, Stored::take(from)?);
        (all.report.gated_out, all.report.let_in, all.report.superseded) = Stored::take(from)?;
        all.views = views.iter().map(|&(_, gone)| View { gone, ..View::default() }).collect();
        all.is_sound(frames, &suppliers).then_some(())?;
        all.redraw(settings, frames, &views)?;
        all.map.set_suppliers(&suppliers).then_some(())?;
        all.enter_areas(frames);
        Some(all)
    }

    /// Whether everything that is named is there.
    fn is_sound(&self, frames: Frames<'_>, suppliers: &[Option<u32>]) -> bool {
        let exists = |node: NodeId| node.index() < frames.world_from_robot.len();
        let patches = if self.gated { frames.world_from_robot.len() } else { 0 };
        self.views.len() == frames.world_from_robot.len()
            && self.patches.keyframes() == patches
            && self.due.iter().copied().all(exists)
            && suppliers.iter().flatten().all(|&owner| exists(NodeId::new(owner)))
            && self.waiting.iter().all(|&(_, patch)| self.patches.exists(patch))
            && self.lever_m.is_finite()
    }

    /// Draws each view where it was.
    fn redraw(&mut self, settings: &Settings, frames: Frames<'_>, views: &[(Option<Pose2>, bool)]) -> Option<()> {
        for (node, (drawn_at, _)) in NodeId::first(views.len()).zip(views) {
            let Some(at) = drawn_at else { continue };
            self.fill_points(settings, frames, node).filter(|()| is_in_place(*at))?;
            self.map.draw(&self.points, *at, Change::Add, node.number());
            self.views[node.index()].drawn_at = Some(*at);
            self.report.keyframes += 1;
        }
        self.map.refresh();
        Some(())
    }

    /// Every view that may be drawn, in the area where it is.
    pub(super) fn enter_areas(&mut self, frames: Frames<'_>) {
        if !self.gated {
            return;
        }
        self.areas.clear();
        for (node, at) in NodeId::first(self.views.len()).zip(frames.world_from_robot) {
            if !self.views[node.index()].gone && self.patches.is_live(node) {
                let key = area(*at);
                self.views[node.index()].area = key;
                self.areas.entry(key).or_default().push(node);
            }
        }
    }
}
