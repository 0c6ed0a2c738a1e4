//! What a mapper knows beside its session, so that another one goes on as if the run had never stopped.

use super::MapperOf;
use crate::back::BackEnd;
use crate::front_end::{FrontEnd, Maps, Resumes};
use crate::settings::Settings;
use crate::store::Store;
use crate::told::Told;
use mapwright_geom::{Stored, is_in_place};
use mapwright_record::{NodeId, Past, Update};

impl<M: Maps> MapperOf<M> {
    /// Takes down what keyframes and edges do not say, where a run stops: [`MapperOf::resume`] goes on with it to the same poses, bit
    /// by bit, as this mapper would. Jobs that wait are done before. The entry is the update's; this mapper may go on as well.
    ///
    /// There is none while a job is out: what is resumed then learns again how it moves.
    pub fn checkpoint(&mut self) -> Update<M> {
        self.work_all();
        if !self.back.is_busy() {
            let mut state = vec![M::FrontEnd::VERSION];
            self.store.put(&mut state);
            self.back.put(&mut state);
            self.front.put(&mut state);
            self.store.add_checkpoint(state);
        }
        self.report(Told::default())
    }
}

/// The three that a mapper consists of.
pub(super) type Stages<M> = (Store<M>, BackEnd<M>, <M as Maps>::FrontEnd);

/// All that goes on as it was, if these are bytes of this session's end.
pub(super) fn restore<M: Maps>(settings: Settings, store: &Store<M>, mut state: &[u8]) -> Option<Stages<M>> {
    let from = &mut state;
    u8::take(from).filter(|version| *version == M::FrontEnd::VERSION)?;
    let store = store.restored(from)?;
    let back = BackEnd::restore(&settings, store.past(), from)?;
    let drawn = store.drawn_while_mapping();
    let past = Past { drawn: &drawn, ..store.past() };
    let mut front = M::FrontEnd::restore(settings, past, from)?;
    for node in NodeId::first(store.len()).filter(|&node| store.past().drawn[node.index()].is_none()) {
        front.drop_keyframe(past, node);
    }
    let map_from_robot = store.map_from_local() * front.pose().local_from_robot();
    (from.is_empty() && is_in_place(map_from_robot)).then_some((store, back, front))
}
