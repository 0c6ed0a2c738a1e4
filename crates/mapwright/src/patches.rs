//! Patches: keyframes within a few metres that are certain relative to each other.
//!
//! The gate decides on patches, for what holds for one of their keyframes holds for all. Their number grows with the area
//! that was seen, not with the time spent there.

use mapwright_geom::{Cov3, Pose2};
use mapwright_graph::{CertaintyGraph, Gate, Uncertainty};
use mapwright_grid::floor_cell;
use mapwright_loops::KnownPlace;
use mapwright_record::NodeId;
use rustc_hash::FxHashMap;

mod checkpoint;

/// A keyframe joins a patch that began up to here, metres,
const PATCH_M: f64 = 2.0;
/// if it is as certain relative to its first keyframe, metres.
const PATCH_SIGMA_M: f64 = 0.05;
/// Side of the squares by which a patch knows where it has obstacles, metres,
const OUTLINE_M: f64 = 1.0;
/// from one hit of so many.
const OUTLINE_HITS: usize = 4;
/// Side of the buckets in which live patches are found, metres.
const BUCKET_M: f64 = 8.0;
/// Shares of a link's variances that add up along a chain; the rest is the keyframe's own and does not. They hold for
/// keyframes and scans that are so far apart, metres, and grow with these powers of the distance. Calibrated by simulated
/// loops, corridors and offices (`docs/decisions/0011-closing-loops.md`).
pub(crate) const DISPLACEMENT_SHARE: f64 = 0.3;
const DISPLACEMENT_STEP_M: f64 = 0.2;
const ROTATION_SHARE: f64 = 0.1;
const ROTATION_STEP_M: f64 = 0.05;
const ROTATION_POWER: f64 = 0.75;
/// Patches up to this distance from the robot are judged, metres: what is seen 20 m away may have been drawn from 20 m beyond.
const JUDGED_M: f64 = 40.0;
/// A patch that was matched against on so much way is held, metres; until so much it may be so many times as uncertain as one
/// that is let in.
const HELD_M: f64 = 20.0;
const LEAVING_M: f64 = 80.0;
const LEAVING: f64 = 1.5;
/// The graph is searched anew after so much travel, metres,
const SEARCH_EVERY_M: f64 = 1.0;
/// so many links a scan,
const SEARCH_LINKS: usize = 64;
/// and up to so many patches in all.
const SEARCH_AT_MOST: usize = 1024;

#[derive(Debug, Clone)]
pub(crate) struct Patch {
    /// The keyframe it began with.
    pub(crate) first: NodeId,
    at: [f64; 2],
    live: bool,
    /// Relative to where the search `round` started; none before the first one.
    searched: Option<Uncertainty>,
    round: u32,
    /// How long the robot's way was when it was last there or matched against it, metres.
    used_m: f64,
    /// LocalMapping, but too uncertain to be matched against: it leaves before the next scan would be.
    stale: bool,
    /// LocalMapping, but not drawn where it belongs, for it was let in or moved: that is mended when a scan meets it.
    unsettled: bool,
    /// Its keyframes that may be drawn.
    pub(crate) views: Vec<NodeId>,
    /// Squares in which its keyframes have seen obstacles, relative to the first one.
    outline: Vec<[i16; 2]>,
}

impl Patch {
    /// Middles of the squares in which its keyframes have seen obstacles, relative to the first one, metres.
    pub(crate) fn outline(&self) -> impl Iterator<Item = [f64; 2]> + '_ {
        self.outline.iter().map(|square| square.map(|k| (f64::from(k) + 0.5) * OUTLINE_M))
    }
}

/// A keyframe's patch, and how certain it is relative to where that began.
#[derive(Debug, Clone, Copy)]
struct Member {
    patch: u32,
    uncertainty: Uncertainty,
}

/// A patch that changes sides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Flip {
    pub(crate) patch: u32,
    pub(crate) live: bool,
    /// From the robot, square metres.
    pub(crate) distance2: f64,
}

/// The patches and the search that judges them.
#[derive(Debug, Clone, Default)]
pub(crate) struct Patches {
    graph: CertaintyGraph,
    /// The same, with the patches that have no view left.
    whole: CertaintyGraph,
    patches: Vec<Patch>,
    members: Vec<Member>,
    /// LocalMapping patches by place.
    buckets: FxHashMap<(i32, i32), Vec<u32>>,
    /// Links of the next keyframe.
    links: Vec<(NodeId, Uncertainty)>,
    lever_m: f64,
    /// Length of the robot's way, metres.
    way_m: f64,
    round: u32,
    /// How many patches are stale.
    stale: usize,
    /// The last search that has ended.
    judged: u32,
    searching: bool,
    searched_from: [f64; 2],
    /// Of the newest keyframe relative to where the last search started,
    since_searched: Uncertainty,
    /// and to where the present one did.
    since_started: Uncertainty,
}

impl Patches {
    /// The next keyframe, so far from the last one, is as uncertain relative to `from`.
    pub(crate) fn connect(&mut self, from: NodeId, covariance: &Cov3, spacing: Spacing) {
        self.links.push((from, accumulating(covariance, spacing)));
    }

    /// Puts the next keyframe into the nearest live patch it is certain in, or begins one.
    pub(crate) fn add(&mut self, poses: &[Pose2], lever_m: f64, hits: &[[f64; 2]]) {
        self.lever_m = lever_m;
        let node = NodeId::at(self.members.len());
        let at = position(poses[node.index()]);
        let (mut links, mut chained) = (Vec::new(), false);
        for (from, link) in std::mem::take(&mut self.links) {
            let Member { patch, uncertainty } = self.members[from.index()];
            let step_m = distance2(position(poses[from.index()]), at).sqrt();
            links.push((patch, uncertainty.then(link, step_m)));
            self.patches[patch as usize].used_m = self.way_m;
            if from.next() == node {
                chained = true;
                self.way_m += step_m;
                self.since_searched = self.since_searched.then(link, step_m);
                self.since_started = self.since_started.then(link, step_m);
            }
        }
        if node.index() > 0 && !chained {
            // The way is broken: what was known relative to the robot no longer is.
            (self.searching, self.judged, self.searched_from) = (false, self.round + 1, [f64::INFINITY; 2]);
            self.way_m += LEAVING_M;
        }
        let member = self.joined(at, &links).unwrap_or_else(|| Member { patch: self.begin(node, at), ..Member::NONE });
        self.members.push(member);
        let Patch { first, views, used_m, outline, .. } = &mut self.patches[member.patch as usize];
        views.push(node);
        *used_m = self.way_m;
        let Pose2 { x, y, theta } = poses[first.index()].between(poses[node.index()]);
        let (s, c) = theta.sin_cos();
        let square = |&[hx, hy]: &[f64; 2]| {
            [x + c * hx - s * hy, y + s * hx + c * hy].map(|metres| floor_cell(metres / OUTLINE_M) as i16)
        };
        let mut last = None;
        for square in
            hits.iter().step_by(OUTLINE_HITS).map(square).filter(|&square| last.replace(square) != Some(square))
        {
            if let Err(at) = outline.binary_search(&square) {
                outline.insert(at, square);
            }
        }
        for (patch, link) in links {
            self.link(patch, member, link, at);
        }
    }

    fn link(&mut self, patch: u32, member: Member, link: Uncertainty, at: [f64; 2]) {
        for graph in [&mut self.graph, &mut self.whole] {
            graph.add_link(patch, member.patch, link.then(member.uncertainty, 0.0), at, self.lever_m);
        }
    }

    /// Links two keyframes that are there already: a closure.
    pub(crate) fn close(&mut self, poses: &[Pose2], from: NodeId, to: NodeId, covariance: &Cov3) {
        let [from, to] = [from, to].map(|node| (self.members[node.index()], position(poses[node.index()])));
        let (Member { patch, uncertainty }, step_m) = (from.0, distance2(from.1, to.1).sqrt());
        self.link(patch, to.0, uncertainty.then(accumulating(covariance, Spacing::default()), step_m), to.1);
    }

    /// A closure was none: what it linked is apart again.
    pub(crate) fn open(&mut self, from: NodeId, to: NodeId) {
        let [from, to] = [from, to].map(|node| self.members[node.index()].patch);
        for graph in [&mut self.graph, &mut self.whole] {
            graph.remove_link(from, to);
        }
    }

    /// The keyframes have moved.
    pub(crate) fn carry(&mut self, before: &[Pose2], poses: &[Pose2]) {
        let moved = |patch: &Patch| poses[patch.first.index()] * before[patch.first.index()].inverse();
        let motions: Vec<Pose2> = self.patches.iter().map(moved).collect();
        for graph in [&mut self.graph, &mut self.whole] {
            graph.carry(|patch| motions[patch as usize]);
        }
        self.buckets.clear();
        for (number, patch) in (0..).zip(&mut self.patches) {
            patch.at = position(poses[patch.first.index()]);
            if patch.live && !patch.views.is_empty() {
                self.buckets.entry(bucket(patch.at)).or_default().push(number);
            }
        }
        (self.searching, self.searched_from) = (false, [f64::INFINITY; 2]);
    }

    /// Every patch that still has a view, and how certain it is relative to the newest keyframe.
    pub(crate) fn survey(&mut self) -> Vec<KnownPlace> {
        let Some(newest) = self.members.last() else { return Vec::new() };
        let gate = Gate { sigma_m: f64::INFINITY, lever_m: self.lever_m, reach_m: f64::INFINITY };
        self.whole.begin(newest.patch, newest.uncertainty, gate);
        while !self.whole.advance(usize::MAX, usize::MAX) {}
        let known = self.whole.reached().iter().map(|r| (&self.patches[r.node as usize], r.uncertainty));
        let seen = known.filter(|(patch, _)| !patch.views.is_empty());
        seen.map(|(&Patch { first, live, .. }, uncertainty)| KnownPlace::alike_in_all(first, live, uncertainty))
            .collect()
    }

    fn joined(&self, at: [f64; 2], links: &[(u32, Uncertainty)]) -> Option<Member> {
        let mut best: Option<(f64, Member)> = None;
        self.each_live_within(at, PATCH_M, |patch, distance2| {
            let Patch { searched, round, .. } = self.patches[patch as usize];
            let searched = searched.filter(|_| round == self.judged).map(|known| known.then(self.since_searched, 0.0));
            let linked = links.iter().filter(|(to, _)| *to == patch).map(|&(_, link)| link);
            let sigma_m = |u: &Uncertainty| u.sigma_m(self.lever_m);
            let known = linked.chain(searched).min_by(|a, b| sigma_m(a).total_cmp(&sigma_m(b)));
            let Some(uncertainty) = known.filter(|u| sigma_m(u) <= PATCH_SIGMA_M) else { return };
            if best.is_none_or(|(nearest, _)| distance2 < nearest) {
                best = Some((distance2, Member { patch, uncertainty }));
            }
        });
        best.map(|(_, member)| member)
    }

    fn begin(&mut self, first: NodeId, at: [f64; 2]) -> u32 {
        let (round, used_m) = (self.round, self.way_m);
        let (views, outline) = (Vec::new(), Vec::new());
        let fresh = Patch {
            first,
            at,
            live: true,
            searched: None,
            round,
            used_m,
            stale: false,
            unsettled: false,
            views,
            outline,
        };
        self.patches.push(fresh);
        self.whole.add_node(at);
        let patch = self.graph.add_node(at);
        self.buckets.entry(bucket(at)).or_default().push(patch);
        patch
    }

    /// Calls with every live patch up to `within_m` away and its squared distance, in a fixed order.
    fn each_live_within(&self, at: [f64; 2], within_m: f64, mut call: impl FnMut(u32, f64)) {
        let [low, high] = [-within_m, within_m].map(|by| bucket([at[0] + by, at[1] + by]));
        for by in low.1..=high.1 {
            for bx in low.0..=high.0 {
                for &patch in self.buckets.get(&(bx, by)).into_iter().flatten() {
                    let distance2 = distance2(self.patches[patch as usize].at, at);
                    if distance2 <= within_m * within_m {
                        call(patch, distance2);
                    }
                }
            }
        }
    }

    /// Goes on searching. When a search has ended, the patches that change sides: live ones more uncertain than `out_m`,
    /// others at most as uncertain as `in_m`, nearest first.
    pub(crate) fn search(&mut self, poses: &[Pose2], in_m: f64, out_m: f64) -> Option<Vec<Flip>> {
        let newest = self.members.last()?;
        let at = position(poses[self.members.len() - 1]);
        if !self.searching && distance2(at, self.searched_from) > SEARCH_EVERY_M * SEARCH_EVERY_M {
            self.round += 1;
            let gate = Gate { sigma_m: out_m, lever_m: self.lever_m, reach_m: JUDGED_M };
            self.graph.begin(newest.patch, newest.uncertainty, gate);
            (self.searching, self.searched_from, self.since_started) = (true, at, Uncertainty::default());
        }
        if !self.searching || !self.graph.advance(SEARCH_LINKS, SEARCH_AT_MOST) {
            return None;
        }
        (self.searching, self.judged, self.since_searched) = (false, self.round, self.since_started);
        Some(self.verdict(at, in_m, out_m))
    }

    fn verdict(&mut self, at: [f64; 2], in_m: f64, out_m: f64) -> Vec<Flip> {
        let mut flips = Vec::new();
        for reached in self.graph.reached() {
            let patch = &mut self.patches[reached.node as usize];
            (patch.searched, patch.round) = (Some(reached.uncertainty), self.round);
            let distance2 = distance2(patch.at, at);
            let near = distance2 <= JUDGED_M * JUDGED_M;
            if near && !patch.live && !patch.views.is_empty() && reached.uncertainty.sigma_m(self.lever_m) <= in_m {
                flips.push(Flip { patch: reached.node, live: true, distance2 });
            }
        }
        let mut near = Vec::new();
        self.each_live_within(at, JUDGED_M, |patch, distance2| near.push((patch, distance2)));
        for (number, distance2) in near {
            let patch = &mut self.patches[number as usize];
            // What has not been matched against for a while has to be as certain as to be let in.
            let most_m = match self.way_m - patch.used_m {
                unused_m if unused_m <= HELD_M => out_m,
                unused_m if unused_m <= LEAVING_M => LEAVING * in_m,
                _ => in_m,
            };
            // One that has just begun was not looked for; one that was not reached is more uncertain than all that may stay.
            let reached = patch.round == self.round;
            let sigma_m = patch.searched.filter(|_| reached).map(|known| known.sigma_m(self.lever_m));
            let sigma_m = sigma_m.unwrap_or(if reached { 0.0 } else { f64::INFINITY });
            self.stale = self.stale + usize::from(sigma_m > most_m) - usize::from(patch.stale);
            patch.stale = sigma_m > most_m;
            if sigma_m > out_m {
                flips.push(Flip { patch: number, live: false, distance2 });
            }
        }
        nearest_first(flips)
    }

    /// Whether there are patches that have to leave when a scan meets them.
    pub(crate) fn any_stale(&self) -> bool {
        self.stale > 0
    }

    /// A keyframe's patch, if it is one of those.
    pub(crate) fn stale(&self, node: NodeId) -> Option<u32> {
        let patch = self.members.get(node.index())?.patch;
        self.patches[patch as usize].stale.then_some(patch)
    }

    /// The flips that make all patches leave that have to when a scan meets them, nearest first.
    pub(crate) fn stale_around(&self, at: Pose2) -> Vec<Flip> {
        let mut flips = Vec::new();
        self.each_live_within(position(at), JUDGED_M, |patch, distance2| {
            if self.patches[patch as usize].stale {
                flips.push(Flip { patch, live: false, distance2 });
            }
        });
        nearest_first(flips)
    }

    /// Nothing is matched against any more.
    pub(crate) fn leave_all(&mut self) {
        for patch in &mut self.patches {
            (patch.live, patch.stale, patch.unsettled) = (false, false, false);
        }
        self.buckets.clear();
        self.stale = 0;
        (self.searching, self.judged, self.searched_from) = (false, self.round + 1, [f64::INFINITY; 2]);
        self.way_m += LEAVING_M;
    }

    /// Carries a flip out and returns the keyframes concerned.
    pub(crate) fn flip(&mut self, flip: Flip) -> Vec<NodeId> {
        let Patch { at, live, stale, unsettled, views, .. } = &mut self.patches[flip.patch as usize];
        self.stale -= usize::from(*stale);
        (*live, *stale, *unsettled) = (flip.live, false, flip.live);
        let nodes = self.buckets.entry(bucket(*at)).or_default();
        nodes.retain(|&patch| patch != flip.patch);
        if flip.live {
            nodes.push(flip.patch);
        }
        views.clone()
    }

    /// Calls with every live patch around that is not settled, and its number.
    pub(crate) fn each_waiting(&self, at: Pose2, mut call: impl FnMut(u32, &Patch)) {
        self.each_live_within(position(at), JUDGED_M, |number, _| {
            let patch = &self.patches[number as usize];
            if patch.unsettled {
                call(number, patch);
            }
        });
    }

    /// A keyframe is not drawn as it should be, and with it its patch.
    pub(crate) fn unsettle(&mut self, node: NodeId) {
        if let Some(member) = self.members.get(node.index()) {
            let patch = &mut self.patches[member.patch as usize];
            patch.unsettled = patch.live;
        }
    }

    /// Nothing is drawn any more: that is as it should be where a patch is not live.
    pub(crate) fn unsettle_all(&mut self) {
        self.patches.iter_mut().for_each(|patch| patch.unsettled = patch.live);
    }

    /// All that is live is drawn as it should be.
    pub(crate) fn settle_all(&mut self) {
        self.patches.iter_mut().for_each(|patch| patch.unsettled = false);
    }

    /// A patch is about to be drawn as it should be: its views, if there is something to be done.
    pub(crate) fn settle(&mut self, patch: u32) -> &[NodeId] {
        let Patch { unsettled, views, .. } = &mut self.patches[patch as usize];
        if std::mem::take(unsettled) { views } else { &[] }
    }

    /// Whether a keyframe's patch is live.
    pub(crate) fn is_live(&self, node: NodeId) -> bool {
        self.members.get(node.index()).is_some_and(|member| self.patches[member.patch as usize].live)
    }

    /// A keyframe will not be drawn again; a patch without any is left out of searches.
    pub(crate) fn forget(&mut self, node: NodeId) {
        let Some(&Member { patch, .. }) = self.members.get(node.index()) else { return };
        let Patch { at, views, stale, .. } = &mut self.patches[patch as usize];
        views.retain(|&view| view != node);
        if views.is_empty() {
            self.stale -= usize::from(std::mem::take(stale));
            self.graph.isolate(patch);
            if let Some(nodes) = self.buckets.get_mut(&bucket(*at)) {
                nodes.retain(|&other| other != patch);
            }
        }
    }
}

impl Member {
    const NONE: Self = Self { patch: 0, uncertainty: Uncertainty { displacement_m2: 0.0, rotation_rad2: 0.0 } };
}

/// How densely the way is covered.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Spacing {
    /// From keyframe to keyframe, metres.
    pub(crate) keyframe_m: f64,
    /// From scan to scan, metres.
    pub(crate) scan_m: f64,
}

/// What of a link's uncertainty adds up along the way. Keyframes that are close together are matched with the same older
/// ones and share their errors, and the scans between them, each from the last one's pose, average their headings; farther
/// apart each adds its own.
pub(crate) fn accumulating(covariance: &Cov3, spacing: Spacing) -> Uncertainty {
    let displacement = DISPLACEMENT_SHARE * (spacing.keyframe_m / DISPLACEMENT_STEP_M).max(1.0);
    let rotation = ROTATION_SHARE * (spacing.scan_m / ROTATION_STEP_M).max(1.0).powf(ROTATION_POWER);
    Uncertainty {
        displacement_m2: displacement.min(1.0) * larger_variance(covariance),
        rotation_rad2: rotation.min(1.0) * covariance[(2, 2)],
    }
}

/// Of the position, in the direction in which it is least certain.
fn larger_variance(covariance: &Cov3) -> f64 {
    covariance.fixed_view::<2, 2>(0, 0).symmetric_eigenvalues().max()
}

fn nearest_first(mut flips: Vec<Flip>) -> Vec<Flip> {
    flips.sort_by(|a, b| a.distance2.total_cmp(&b.distance2).then(a.patch.cmp(&b.patch)));
    flips
}

fn position(pose: Pose2) -> [f64; 2] {
    [pose.x, pose.y]
}

fn distance2(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1])
}

fn bucket([x, y]: [f64; 2]) -> (i32, i32) {
    ((x / BUCKET_M).floor() as i32, (y / BUCKET_M).floor() as i32)
}
