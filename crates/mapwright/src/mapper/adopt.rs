//! One map of several robots while they drive: what their mappers tell is taken in as it comes, in whatever turn.

use super::Mapper;
use crate::breaks::anywhere;
use crate::front_end::FrontEnd;
use crate::store::{Beside, Store};
use crate::told::{Newest, Told};
use mapwright_geom::Pose2;
use mapwright_loops::{PlaneSubmaps, SUBMAP_M, SaidAndSeen, fit_where_said, is_found_where_said, run_of};
use mapwright_record::{Adoption, EdgeKind, Entry, KeyframeId, NodeId, Status, Update};
use std::collections::BTreeMap;

/// What came of a group of another mapper's entries.
#[derive(Debug, Clone)]
pub struct Adopted {
    /// Where its keyframe lies in the map now, if it has one that fits.
    pub map_from_keyframe: Option<Pose2>,
    /// Entries of the group that do not fit this session.
    pub refused: usize,
    /// Whether what its robot says of how it came there was contradicted by what it saw,
    pub is_contradicted: bool,
    /// and how many other edges of the group were.
    pub contradicted: usize,
    /// How many of the update's entries are the group's own; the others are what was found.
    pub own: usize,
    /// What changed.
    pub update: Update,
}

impl Mapper {
    /// Takes in one group ([`mapwright_record::groups`]) of what another robot's mapper tells, with what is known of its entries from the
    /// groups before (`adoption`, one for each robot). Robots may take turns as they like: each goes on where it was. A run that begins is a
    /// fragment that is [apart](mapwright_record::Localisation) until it is recognised, as with [`Mapper::switch_on`] and [`Mapper::import`].
    ///
    /// Places of other runs are looked for; those of its own its own mapper has looked for.
    pub fn adopt(&mut self, group: &[Entry], adoption: &mut Adoption) -> Adopted {
        let crate::store::Adopted { map_from_keyframe, told, refused, keyframe } =
            self.store.adopt(group, adoption, &anywhere::<Pose2>());
        let (mut is_contradicted, mut contradicted) = (false, 0);
        if let Some(mut adopted) = keyframe {
            (is_contradicted, contradicted) = self.contradict(adopted.first_edge, adopted.is_first);
            adopted.is_first |= is_contradicted;
            if adopted.is_first || adopted.is_closed {
                self.back.closing.see_pieces(self.store.past());
            } else {
                self.back.closing.see_turn(self.store.past());
            }
            self.front.take_in(self.store.past(), adopted.first_edge, adopted.is_first);
            if let Some(newest) = self.session().keyframes().last() {
                self.newest = Newest { stamp: newest.stamp, status: Status::Tracking };
            }
            self.detect_in_others();
        }
        self.work_all();
        let keyframe = keyframe.and_then(|_| self.store.past().newest());
        let update = self.report(Told { keyframe, ..Told::default() });
        Adopted { map_from_keyframe, refused, is_contradicted, contradicted, own: told, update }
    }

    /// What a robot says of its own way counts where what it saw bears it out: otherwise the newest keyframe begins a fragment that may lie
    /// anywhere, and edges that lead elsewhere say nothing. Whether the way was contradicted, and how many edges.
    fn contradict(&mut self, first_edge: usize, is_first: bool) -> (bool, usize) {
        let Some(to) = self.store.past().newest() else { return (false, 0) };
        let is_contradicted =
            !is_first && weigh_way(&mut self.store, to, &mut self.front.plane_submaps(), &mut self.ways) == Some(false);
        if is_contradicted {
            self.store.contradict(first_edge, &anywhere::<Pose2>());
        }
        let mut edges = 0;
        for (number, ends, kind, from_from_to) in self.store.edges_since(first_edge) {
            let is_wrong = match kind {
                EdgeKind::Odometry => false,
                EdgeKind::Match if self.store.is_over_break(ends) => true,
                EdgeKind::Match if self.store.past().way_between_m(ends[0], ends[1]) <= SUBMAP_M => false,
                EdgeKind::Match | EdgeKind::Closure => self.is_edge_contradicted(ends, from_from_to),
            };
            if is_wrong {
                self.store.disbelieve(number);
                edges += 1;
            }
        }
        (is_contradicted, edges)
    }

    /// What robots say of their ways is weighed by what they saw, as it is where a mapper takes it in: for one that goes on with what another
    /// one has taken in.
    pub fn weigh_ways(&mut self, known: WaysSeen) {
        self.ways = known;
        weigh_ways(&mut self.store, &mut self.front.plane_submaps(), &mut self.ways);
    }

    /// All that was compared so far; of this mapper nothing is left of it.
    pub fn take_ways(&mut self) -> WaysSeen {
        std::mem::take(&mut self.ways)
    }

    fn is_edge_contradicted(&self, ends: [NodeId; 2], from_from_to: Pose2) -> bool {
        !is_found_where_said(self.store.past(), ends, from_from_to, &mut self.front.plane_submaps())
    }

    /// Looks for the newest keyframe among the places of other runs.
    fn detect_in_others(&mut self) {
        let past = self.store.past();
        let Some(newest) = past.newest().filter(|_| self.back.closing.is_due(past)) else { return };
        let run = run_of(past.way_m[newest.index()]);
        let mut known = self.front.survey(self.store.past());
        let way_m = self.store.past().way_m;
        known.iter_mut().for_each(|place| place.live = run_of(way_m[place.first.index()]) == run);
        self.look(known, None);
    }
}

/// What robots said of their ways, beside what they saw: of each keyframe it is compared once, whoever asks.
#[derive(Debug, Clone, Default)]
pub struct WaysSeen {
    fits: BTreeMap<KeyframeId, Option<SaidAndSeen>>,
}

/// What a robot says of all ways beside what it saw.
pub(crate) fn weigh_ways(store: &mut Store, submaps: &mut PlaneSubmaps, ways: &mut WaysSeen) {
    for to in (0..store.len()).map(NodeId::at) {
        if !store.is_first(to) {
            weigh_way(store, to, submaps, ways);
        }
    }
}

/// What a robot says of the way to a keyframe counts as much as what it saw allows; whether that bears it out, where anything can be compared.
fn weigh_way(store: &mut Store, to: NodeId, submaps: &mut PlaneSubmaps, ways: &mut WaysSeen) -> Option<bool> {
    let past = store.past();
    let id = past.session.keyframes()[to.index()].id;
    let fit = *ways.fits.entry(id).or_insert_with(|| fit_where_said(past, to, submaps));
    let fit = fit?;
    let beside = fit.measured.map(|(variance_factor, covariance)| Beside { variance_factor, covariance });
    store.set_beside(to, beside.filter(|_| fit.bears_out()));
    Some(fit.bears_out())
}
