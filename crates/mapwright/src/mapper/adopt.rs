//! One map of several robots while they drive: what their mappers tell is taken in as it comes, in whatever turn.

use super::Mapper;
use crate::front::anywhere;

use crate::told::{Newest, Told};
use mapwright_geom::Pose2;
use mapwright_loops::run_of;
use mapwright_record::{Adoption, Entry, Status, Update};

/// What came of a group of another mapper's entries.
#[derive(Debug, Clone)]
pub struct Adopted {
    /// Where its keyframe lies in the map now, if it has one that fits.
    pub map_from_keyframe: Option<Pose2>,
    /// Entries of the group that do not fit this session.
    pub refused: usize,
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
            self.store.adopt(group, adoption, &anywhere());
        if let Some(adopted) = keyframe {
            if adopted.is_first || adopted.is_closed {
                self.back.closing.see_pieces(self.store.past());
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
        Adopted { map_from_keyframe, refused, own: told, update }
    }

    /// Looks for the newest keyframe among the places of other runs.
    fn detect_in_others(&mut self) {
        let past = self.store.past();
        let Some(newest) = past.newest().filter(|_| self.back.closing.is_due(past)) else { return };
        let run = run_of(past.way_m[newest.index()]);
        let mut known = self.front.survey();
        let way_m = self.store.past().way_m;
        known.iter_mut().for_each(|place| place.live = run_of(way_m[place.first.index()]) == run);
        self.look(known, None);
    }
}
