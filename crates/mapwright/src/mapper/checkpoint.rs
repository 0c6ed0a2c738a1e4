//! What a mapper knows beside its session, so that another one goes on as if the run had never stopped.

use super::Mapper;
use crate::back::BackEnd;
use crate::front::FrontEnd;
use crate::settings::Settings;
use crate::store::Store;
use crate::told::Told;
use mapwright_geom::Stored;
use mapwright_geom::is_in_place;
use mapwright_record::{NodeId, Past, Update};

/// Of the bytes; another one's are not read.
const VERSION: u8 = 6;

impl Mapper {
    /// Takes down what keyframes and edges do not say, where a run stops: [`Mapper::resume`] goes on with it to the same poses, bit
    /// by bit, as this mapper would. Jobs that wait are done before. The entry is the update's; this mapper may go on as well.
    ///
    /// There is none while a job is out: what is resumed then learns again how it moves.
    pub fn checkpoint(&mut self) -> Update {
        self.work_all();
        if !self.back.is_busy() {
            let mut state = vec![VERSION];
            self.store.put(&mut state);
            self.back.put(&mut state);
            self.front.put(&mut state);
            self.store.add_checkpoint(state);
        }
        self.report(Told::default())
    }
}

/// All that goes on as it was, if these are bytes of this session's end.
pub(super) fn restore(settings: Settings, store: &Store, mut state: &[u8]) -> Option<(Store, BackEnd, FrontEnd)> {
    let from = &mut state;
    u8::take(from).filter(|version| *version == VERSION)?;
    let store = store.restored(from)?;
    let back = BackEnd::restore(&settings, store.past(), from)?;
    let drawn = store.drawn_while_mapping();
    let past = Past { drawn: &drawn, ..store.past() };
    let mut front = FrontEnd::restore(settings, past, from)?;
    for node in NodeId::first(store.len()).filter(|&node| store.past().drawn[node.index()].is_none()) {
        front.drop_keyframe(past, node);
    }
    let map_from_robot = store.map_from_local() * front.pose().local_from_robot();
    (from.is_empty() && is_in_place(map_from_robot)).then_some((store, back, front))
}
