//! Old places looked for anew, at a log's end: corrections have moved visits near each other that no window had reached.

use super::MapperOf;
use crate::front_end::{FrontEnd, Maps};
use crate::jobs::Task;
use crate::settings::{Correction, LivePolicy};
use crate::told::Told;
use crate::visits::{COMPARED, pairs};
use mapwright_loops::{APART_M, LEFT_M, SUBMAP_M, Solving, run_of};
use mapwright_record::{EdgeKind, Measurement, NodeId, Past, Update};

/// Times at most that the whole map is looked at.
const ROUNDS: usize = 3;

impl<M: Maps> MapperOf<M> {
    /// For who has no more scans: looks at places that two visits have passed and that no edge links, judges what is found there as at any
    /// time, and solves the graph, until nothing is found or three times. The update holds what has changed. A robot that is only located
    /// moves nothing.
    pub fn look_again(&mut self) -> Update<M> {
        self.work_all();
        let settings = self.settings();
        let looks = settings.loops.by_pose
            && settings.loops.correction == Correction::Graph
            && settings.live.policy == LivePolicy::Gated
            && !self.store.is_fixed();
        let mut rounds = 0;
        while looks && rounds < ROUNDS && self.look_once() {
            rounds += 1;
        }
        self.report(Told::default())
    }

    /// Whether anything was found, which the poses follow then.
    fn look_once(&mut self) -> bool {
        let before = self.store.closures().len();
        let known = self.front.survey(self.store.past());
        let are_all = !self.back.closing.takes_turns();
        for [from, to] in unlinked(self.store.past(), are_all) {
            let Some(submaps) = self.front.submaps() else { continue };
            let verification = self.back.closing.propose_again(self.store.past(), &known, [from, to], submaps);
            verification.into_iter().for_each(|verification| self.back.push(Task::Verify(Box::new(verification))));
            self.work_all();
        }
        let (graph, closures) = (self.store.graph(), self.store.closures());
        let is_found = closures.len() > before;
        if is_found {
            self.back.push(Task::Solve(Solving::of::<M::Submaps>(graph, closures)));
            self.work_all();
        }
        is_found
    }
}

/// Visits of the first map that lie beside each other without a match or a closure between them, as far apart along the way as two findings
/// that agree have to be, and no more than are compared for the verdict; visits of one run where `are_all`.
fn unlinked<M: Measurement>(past: Past<'_, M>, are_all: bool) -> Vec<[NodeId; 2]> {
    let Some(map) = past.session.maps().into_iter().next() else { return Vec::new() };
    let is_drawn = |place: &usize| past.drawn.get(*place).is_some_and(Option::is_some);
    let nodes: Vec<NodeId> = map.places().filter(is_drawn).map(NodeId::at).collect();
    let edges = past.session.edges().filter(|edge| edge.kind != EdgeKind::Odometry);
    let ends = edges.filter_map(|edge| past.nodes([edge.from, edge.to]));
    let mut links: Vec<[NodeId; 2]> = ends.map(|[a, b]| [a.min(b), a.max(b)]).collect();
    links.retain(|&[from, to]| past.way_between_m(from, to) >= LEFT_M);
    links.sort_unstable_by_key(|&[from, to]| (to, from));
    let is_linked = |[earlier, later]: [NodeId; 2]| {
        let begin = links.partition_point(|&[_, to]| to < later && past.way_between_m(to, later) > SUBMAP_M);
        let near =
            links[begin..].iter().take_while(|&&[_, to]| to <= later || past.way_between_m(to, later) <= SUBMAP_M);
        near.into_iter().any(|&[from, _]| past.way_between_m(from, earlier) <= SUBMAP_M)
    };
    let mut last: Option<NodeId> = None;
    let run = |node: NodeId| run_of(past.way_m[node.index()]);
    let mut found = pairs(past, &nodes);
    found.retain(|&[from, to]| are_all || run(from) != run(to));
    found.retain(|&pair| {
        let is_new = last.is_none_or(|last| past.way_between_m(last, pair[1]) >= APART_M) && !is_linked(pair);
        last = if is_new { Some(pair[1]) } else { last };
        is_new
    });
    let every = found.len().div_ceil(COMPARED).max(1);
    found.into_iter().step_by(every).collect()
}
