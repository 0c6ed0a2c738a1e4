//! Patches as bytes, with the search that is under way.

use super::{Member, Patch, Patches, bucket, position};
use mapwright_geom::{Pose2, Stored, stored};
use mapwright_graph::{CertaintyGraph, Uncertainty};
use mapwright_record::NodeId;

stored!(Member { patch, uncertainty });
stored!(Patch { first, live, searched, round, used_m, stale, unsettled, views, outline; at });

impl Patches {
    pub(crate) fn put(&self, out: &mut Vec<u8>) {
        self.graph.put(out);
        self.whole.put(out);
        self.patches.put(out);
        self.members.put(out);
        self.found_in_order().put(out);
        (self.lever_m, self.way_m).put(out);
        (self.round, self.judged, self.searching, self.searched_from).put(out);
        (self.since_searched, self.since_started).put(out);
    }

    /// Goes on as they were; `poses` are those of all keyframes.
    pub(crate) fn restore(from: &mut &[u8], poses: &[Pose2]) -> Option<Self> {
        let (graph, whole): (CertaintyGraph, CertaintyGraph) = Stored::take(from)?;
        let (patches, members): (Vec<Patch>, Vec<Member>) = Stored::take(from)?;
        let found: Vec<u32> = Stored::take(from)?;
        let (lever_m, way_m) = Stored::take(from)?;
        let (round, judged, searching, searched_from) = Stored::take(from)?;
        let (since_searched, since_started): (Uncertainty, Uncertainty) = Stored::take(from)?;
        let mut all = Self { graph, whole, patches, members, lever_m, way_m, round, judged, ..Self::default() };
        (all.searching, all.searched_from) = (searching, searched_from);
        (all.since_searched, all.since_started) = (since_searched, since_started);
        (all.is_sound(poses.len()) && found.iter().all(|&patch| all.exists(patch))).then_some(())?;
        all.patches.iter_mut().for_each(|patch| patch.at = position(poses[patch.first.index()]));
        for patch in found {
            all.buckets.entry(bucket(all.patches[patch as usize].at)).or_default().push(patch);
        }
        all.stale = all.patches.iter().filter(|patch| patch.stale).count();
        Some(all)
    }

    /// How many keyframes they have.
    pub(crate) fn keyframes(&self) -> usize {
        self.members.len()
    }

    pub(crate) fn exists(&self, patch: u32) -> bool {
        (patch as usize) < self.patches.len()
    }

    /// Whether everything that is named is there.
    fn is_sound(&self, keyframes: usize) -> bool {
        let is_keyframe = |node: &NodeId| node.index() < keyframes;
        [self.graph.len(), self.whole.len()] == [self.patches.len(); 2]
            && self.members.iter().all(|member| self.exists(member.patch))
            && self.patches.iter().all(|patch| patch.views.iter().chain([&patch.first]).all(is_keyframe))
    }

    /// The patches that are found by place, bucket by bucket.
    fn found_in_order(&self) -> Vec<u32> {
        let mut keys: Vec<(i32, i32)> = self.patches.iter().map(|patch| bucket(patch.at)).collect();
        keys.sort_unstable();
        keys.dedup();
        keys.iter().filter_map(|key| self.buckets.get(key)).flatten().copied().collect()
    }
}
