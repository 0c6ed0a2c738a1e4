//! A local map in space as bytes, and one that is made again from keyframes and edges.

use super::{LocalMapping, View};
use crate::front::Links;
use crate::settings::Settings;
use crate::space::scale::Scale;
use mapwright_geom::{Cov6, Pose3, Stored, is_in_place, stored};
use mapwright_graph::CovarianceGraph;
use mapwright_record::{LocalMapReport, NodeId, Past};
use mapwright_sensor::SpaceSweep;
use mapwright_voxel::Change;
use std::collections::VecDeque;

stored!(View { drawn_at, live, gone });

impl LocalMapping {
    /// Points are not kept: keyframes have them.
    pub(crate) fn put(&self, out: &mut Vec<u8>) {
        self.views.put(out);
        self.graph.put(out);
        self.due.put(out);
        self.map.suppliers().put(out);
        let LocalMapReport { gated_out, let_in, superseded, .. } = self.report;
        [gated_out, let_in, superseded].put(out);
    }

    /// Goes on as it was: what was drawn is drawn again; `past` is all of the session.
    pub(crate) fn restore(
        settings: &Settings,
        scale: Scale,
        past: Past<'_, SpaceSweep>,
        from: &mut &[u8],
    ) -> Option<Self> {
        let views: Vec<View> = Stored::take(from)?;
        let graph: CovarianceGraph = Stored::take(from)?;
        let due: VecDeque<NodeId> = Stored::take(from)?;
        let suppliers: Vec<u32> = Stored::take(from)?;
        let [gated_out, let_in, superseded] = Stored::take(from)?;
        let is_sound = views.len() == past.local_from_keyframe.len()
            && graph.len() == views.len()
            && due.iter().all(|&node| past.has(node))
            && suppliers.iter().all(|&supplier| (supplier as usize) < views.len())
            && views.iter().filter_map(|view| view.drawn_at).all(is_in_place);
        is_sound.then_some(())?;
        let report = LocalMapReport { gated_out, let_in, superseded, ..LocalMapReport::default() };
        let mut again = Self { views, graph, due, report, ..Self::new(settings, scale) };
        for node in NodeId::first(again.views.len()) {
            let Some(at) = again.views[node.index()].drawn_at else { continue };
            let sweep = past.drawn[node.index()].as_ref()?;
            again.points.clear();
            again.points.extend(sweep.points_m());
            again.map.draw(&again.points, sweep.origin_m(), at, Change::Add, node.number());
            again.report.keyframes += 1;
        }
        again.map.refresh();
        again.map.set_suppliers(&suppliers).then_some(again)
    }

    /// Made again from what lasts: the edges that lead to each keyframe. What is certain relative to the newest is drawn.
    pub(crate) fn of_links(
        settings: &Settings,
        scale: Scale,
        past: Past<'_, SpaceSweep>,
        links: &[Links<Pose3>],
    ) -> Self {
        let mut again = Self::new(settings, scale);
        for (node, links) in NodeId::first(links.len()).zip(links) {
            again.take_note(past, node, &links.all(past, node));
        }
        for (node, links) in NodeId::first(links.len()).zip(links) {
            links.closures.iter().for_each(|(from, covariance)| again.close(past, *from, node, covariance));
        }
        let Some(newest) = past.newest() else { return again };
        if again.gated {
            again.judge(newest);
            NodeId::first(again.views.len()).for_each(|node| again.give_way(past, node));
        } else {
            again.views.iter_mut().for_each(|view| view.live = true);
        }
        again.due.clear();
        for node in NodeId::first(again.views.len()) {
            let View { live, gone, .. } = again.views[node.index()];
            if live && !gone {
                again.draw(past, node, Change::Add);
            }
        }
        again.map.refresh();
        again
    }

    /// Takes a keyframe of another session in without drawing it: what it is certain relative to is known from then on.
    pub(crate) fn take_in(
        &mut self,
        past: Past<'_, SpaceSweep>,
        node: NodeId,
        links: &[(NodeId, Cov6)],
        closures: &[(NodeId, Cov6)],
    ) {
        self.take_note(past, node, links);
        closures.iter().for_each(|(from, covariance)| self.close(past, *from, node, covariance));
        self.views[node.index()].live = true;
        if self.gated {
            self.judge(node);
        }
        self.due.clear();
    }
}
