//! What stands beside the session, as bytes.

use super::Store;
use mapwright_geom::{Stored, is_in_place};
use mapwright_record::{Checkpoint, Entry, FragmentStart, LeftOutReason, Measurement};
use std::sync::Arc;

impl<M: Measurement> Store<M> {
    pub(crate) fn put(&self, out: &mut Vec<u8>) {
        self.counts().put(out);
        self.local_from_keyframe.put(out);
        self.map_from_local.put(out);
        self.way_m.put(out);
        self.has_origin.put(out);
        self.is_switched_on().is_some().put(out);
    }

    /// The same session with what stood beside it, if these are bytes of that.
    pub(crate) fn restored(&self, from: &mut &[u8]) -> Option<Self> {
        let counts: [u64; 4] = Stored::take(from)?;
        let local_from_keyframe: Vec<M::Pose> = Stored::take(from)?;
        let map_from_local: M::Pose = Stored::take(from)?;
        let way_m: Vec<f64> = Stored::take(from)?;
        let has_origin = bool::take(from)?;
        let start = if bool::take(from)? { Some(FragmentStart::SwitchedOn) } else { self.start };
        let in_map = local_from_keyframe.iter().map(|&local| map_from_local * local);
        let is_sound = counts == self.counts()
            && way_m.len() == local_from_keyframe.len()
            && local_from_keyframe.iter().chain([&map_from_local]).all(|pose| is_in_place(*pose))
            && in_map.eq(self.session.map_from_keyframe().iter().copied());
        is_sound.then(|| Self { local_from_keyframe, map_from_local, way_m, has_origin, start, ..self.clone() })
    }

    /// By which it is known whether it is the same session: scans, keyframes, edges and candidates.
    fn counts(&self) -> [u64; 4] {
        let session = &self.session;
        let [keyframes, edges] = [session.keyframes().len(), session.recorded_edges().len()];
        [session.next_scan(), keyframes as u64, edges as u64, session.candidates().len() as u64]
    }

    pub(crate) fn add_checkpoint(&mut self, state: Vec<u8>) {
        self.write(Entry::Checkpoint(Checkpoint { state: state.into() }));
    }

    /// Of each keyframe what was drawn while it was mapped: the map that was made in the end may have left out more.
    pub(crate) fn drawn_while_mapping(&self) -> Vec<Option<Arc<M>>> {
        let mut drawn = self.session.drawn().to_vec();
        let in_the_end = |reason: LeftOutReason| reason == LeftOutReason::ContradictsTheMap;
        let left_out = self.session.left_out();
        for id in left_out.iter().filter(|left_out| in_the_end(left_out.reason)).map(|left_out| left_out.keyframe) {
            let Some(place) = self.session.place(id) else { continue };
            let before = left_out.iter().filter(|left_out| left_out.keyframe == id && !in_the_end(left_out.reason));
            let all = M::clone(&self.session.keyframes()[place].sweep);
            drawn[place] = Some(Arc::new(before.fold(all, |sweep, left_out| sweep.without(&left_out.beams))));
        }
        drawn
    }
}
