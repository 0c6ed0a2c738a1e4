//! What other robots tell of their sessions while they drive.

use super::{FARTHEST_WAY_M, Store, information_of, next_run_m};
use crate::store::import::Imported;
use mapwright_geom::Pose;
use mapwright_record::{
    Adoption, EdgeKind, Entry, Fragment, FragmentStart, Grows, Measurement, NodeId, Objection, Session, Verdict,
    place_of,
};

impl<M: Measurement> Grows<M> for Store<M> {
    fn session(&self) -> &Session<M> {
        &self.session
    }

    fn write(&mut self, entry: Entry<M>) -> bool {
        Self::write(self, entry)
    }
}

/// What becomes of a robot's own closure that its readings contradict.
const WITHDRAWN: Verdict = Verdict::Withdrawn(Objection::NoMatch);

/// What came of a group of entries.
pub(crate) struct Adopted<P> {
    /// Where its keyframe lies in the map, if it has one.
    pub(crate) map_from_keyframe: Option<P>,
    /// How many entries nobody was told of yet once it was taken in, before anything was found.
    pub(crate) told: usize,
    /// Entries that do not fit.
    pub(crate) refused: usize,
    pub(crate) keyframe: Option<Imported>,
}

impl<M: Measurement> Store<M> {
    /// Writes a group of another session; `apart` is the covariance of the link of a run's first keyframe.
    pub(crate) fn adopt(
        &mut self,
        group: &[Entry<M>],
        adoption: &mut Adoption,
        apart: &<M::Pose as Pose>::Matrix,
    ) -> Adopted<M::Pose> {
        let (before, first_edge) = (self.len(), self.session.recorded_edges().len());
        let map_from_keyframe = place_of(&self.session, group);
        let refused = adoption.take_in(self, group, map_from_keyframe);
        let told = self.fresh.len();
        let is_written = self.session.keyframes().len() > before;
        let place = map_from_keyframe.filter(|_| is_written);
        let keyframe = place.map(|place| self.adopted(before, place, first_edge, apart));
        Adopted { map_from_keyframe: place, told, refused, keyframe }
    }

    /// The keyframe that was written last joins the way of its robot.
    fn adopted(
        &mut self,
        place: usize,
        map_from_keyframe: M::Pose,
        first_edge: usize,
        apart: &<M::Pose as Pose>::Matrix,
    ) -> Imported {
        let node = NodeId::at(place);
        self.local_from_keyframe.push(self.map_from_local.inverse() * map_from_keyframe);
        let id = self.id(node);
        let fragment = self.session.fragments().iter().rev().find(|fragment| fragment.first == id).copied();
        let edges = || self.session.recorded_edges()[first_edge..].iter().map(|known| known.recorded.edge);
        let step_m = edges().find(|edge| edge.kind == EdgeKind::Odometry).map(|edge| edge.from_from_to.length());
        let is_closed = edges().any(|edge| edge.kind == EdgeKind::Closure);
        let is_first = fragment.is_some_and(|fragment| self.session.is_break(&fragment));
        let begins_run = place > 0 && fragment.is_some_and(|fragment| fragment.start == FragmentStart::SwitchedOn);
        let before = self.session.before(place);
        let way_m = match before.map(|before| self.way_m[before]) {
            None => 0.0,
            Some(_) if begins_run => next_run_m(&self.way_m),
            Some(before_m) if is_first => before_m + FARTHEST_WAY_M,
            Some(before_m) => before_m + step_m.unwrap_or(FARTHEST_WAY_M),
        };
        self.way_m.push(way_m);
        if let Some(last) = node.before().filter(|_| begins_run) {
            let edge = self.edge(last, node, EdgeKind::Odometry, information_of(apart));
            self.add_edge(edge, None);
        }
        Imported { first_edge, is_first, is_closed }
    }

    /// Edges that were taken in from a number on, with their ends.
    pub(crate) fn edges_since(&self, first: usize) -> Vec<(usize, [NodeId; 2], EdgeKind, M::Pose)> {
        let known = self.session.recorded_edges().iter().enumerate().skip(first);
        let stands = known.filter(|(_, known)| !known.withdrawn);
        stands
            .map(|(number, known)| {
                let edge = &known.recorded.edge;
                (number, known.ends.map(NodeId::new), edge.kind, edge.from_from_to)
            })
            .collect()
    }

    /// Whether two keyframes are of fragments between which there is a break.
    pub(crate) fn is_over_break(&self, ends: [NodeId; 2]) -> bool {
        self.session.joined_fragments(ends.map(NodeId::index)).is_some()
    }

    /// What the robot says of how it came to the newest keyframe counts no more than a break: it may have come from anywhere within `apart`.
    pub(crate) fn contradict(&mut self, first_edge: usize, apart: &<M::Pose as Pose>::Matrix) {
        let Some(node) = self.past().newest() else { return };
        self.write(Entry::Fragment(Fragment { first: self.id(node), start: FragmentStart::Contradicted }));
        for (number, [_, to], kind, from_from_to) in self.edges_since(first_edge) {
            if to == node && kind == EdgeKind::Odometry {
                let information = information_of(apart);
                self.write(Entry::Remeasured { number: number as u32, from_from_to, information });
            } else if to == node && kind == EdgeKind::Match {
                self.withdraw(number, WITHDRAWN);
            }
        }
        if let Some(way_m) = self.way_m.last_mut() {
            *way_m += FARTHEST_WAY_M;
        }
    }

    /// An edge that another robot told says nothing.
    pub(crate) fn disbelieve(&mut self, number: usize) {
        self.withdraw(number, WITHDRAWN);
    }
}
