//! Steps 4 and 5: keyframes, their edges and their covariances.

use super::guard::{DOUBT_SHARE, Matched};
use super::{MAP_FLOOR, Mapper, fuse};
use crate::live::Frames;
use crate::patches::Spacing;
use crate::render::{Doubted, MISFIT_KNOWN_SHARE};
use mapwright_geom::{Cov3, compose_covariance};
use mapwright_record::{Edge, EdgeKind, Keyframe, Status};
use mapwright_sensor::{BEAM_DROPPED, LaserScan, Sweep};
use nalgebra::{Matrix3, Vector3};

/// From this share of end points in space that beams have passed on, they are taken for somebody in the way and left
/// out of the keyframe.
const INTRUDER_SHARE: f64 = 0.15;
/// After so many keyframes in a row it is the world that has changed.
const INTRUDED_AT_MOST: u32 = 16;

impl Mapper {
    pub(super) fn insert_if_moved(&mut self, scan: &LaserScan, matched: Option<&Matched>) -> Option<u32> {
        let lost = matched.is_some_and(|m| m.status == Status::Lost);
        let empty = self.points.hits.is_empty();
        let moved = self
            .local_from_keyframe
            .last()
            .is_none_or(|newest| self.settings.keyframes.is_far(newest.between(self.local_from_robot)));
        let inserted =
            (moved && !lost && !empty && self.suspicion.is_none()).then(|| self.insert(scan, matched)).flatten();
        let frames = Frames { keyframes: &self.keyframes, world_from_robot: &self.local_from_keyframe };
        self.live.follow(&self.settings, frames, inserted.is_some());
        let newest = self.keyframes.len().checked_sub(1).map(|k| k as u32);
        let keyframe_from_robot = newest
            .map_or(self.local_from_robot, |k| self.local_from_keyframe[k as usize].between(self.local_from_robot));
        self.scans.push((scan.stamp, newest, keyframe_from_robot));
        inserted
    }

    pub(super) fn insert(&mut self, scan: &LaserScan, matched: Option<&Matched>) -> Option<u32> {
        let sweep = self.believed_sweep()?;
        let node = self.insert_sweep(scan, matched, sweep);
        if let Some(sweep) = self.sweep.as_ref().filter(|_| matched.is_some_and(hardly_fits)) {
            self.doubted.push(Doubted { keyframe: node, sweep: sweep.clone() });
        }
        Some(node)
    }

    /// A keyframe where the robot is.
    pub(super) fn insert_sweep(&mut self, scan: &LaserScan, matched: Option<&Matched>, sweep: Sweep) -> u32 {
        self.budget.earn_keyframe();
        let node = self.keyframes.len() as u32;
        let id = self.id(node);
        let covariance = self.covariance();
        self.keyframes.push(Keyframe { id, stamp: scan.stamp, scan: self.scans.len() as u64, sweep });
        self.local_from_keyframe.push(self.local_from_robot);
        self.world_from_keyframe.push(self.world_from_local * self.local_from_robot);
        if node > 0 {
            self.connect(node, matched, &covariance);
        } else {
            self.closing.add(self.world_from_keyframe[0], 0.0, &[]);
        }
        self.links.push(fuse(&self.odometry_since_keyframe, &self.information));
        self.keyframe_from_anchor = covariance;
        self.odometry_since_keyframe = Cov3::zeros();
        let frames = Frames { keyframes: &self.keyframes, world_from_robot: &self.local_from_keyframe };
        let (lever_m, _) = self.points.lever_and_reach_m();
        self.live.insert(&self.settings, frames, node, lever_m);
        node
    }

    /// The sweep, without the beams that end in space known to be free where they are many: people in the way, or a
    /// match that is wrong. Few of them are news, a door or a chair, and stay.
    fn believed_sweep(&mut self) -> Option<Sweep> {
        let mut sweep = self.sweep.clone()?;
        let mut intruders = Vec::new();
        let map = &self.live.map;
        let _ = map.agreement_of_each(&self.points.hits, self.local_from_robot, |hit| intruders.push(hit));
        let many = intruders.len() as f64 >= INTRUDER_SHARE * self.points.hits.len() as f64;
        self.intruded = if many { self.intruded + 1 } else { 0 };
        if !many || self.intruded > INTRUDED_AT_MOST {
            return Some(sweep);
        }
        let returns: Vec<usize> = (0..sweep.codes.len()).filter(|&beam| sweep.range_m(beam).is_some()).collect();
        for hit in intruders {
            sweep.codes[returns[hit]] = BEAM_DROPPED;
        }
        Some(sweep)
    }

    /// Odometry edge with the motion model's information, match edge with the scan's; never both in one.
    fn connect(&mut self, node: u32, matched: Option<&Matched>, covariance: &Cov3) {
        let last = node - 1;
        let between =
            |from: u32| self.local_from_keyframe[from as usize].between(self.local_from_keyframe[node as usize]);
        let mut edges = Vec::new();
        let mut links = Vec::new();
        let mut step_m = between(last).x.hypot(between(last).y);
        if let Some(broken) = self.broken.take() {
            let information = broken.covariance.try_inverse().unwrap_or_else(Cov3::zeros);
            edges.push((broken.from, EdgeKind::Closure, information));
            links.push((broken.from, broken.covariance));
            step_m = super::relocation::BROKEN_WAY_M;
        } else {
            let information = self.odometry_since_keyframe.try_inverse().unwrap_or_else(Cov3::zeros);
            edges.push((last, EdgeKind::Odometry, information));
            links.push((last, fuse(&self.odometry_since_keyframe, &self.information)));
        }
        if let (Some(matched), Some(anchor)) = (matched, self.anchor.filter(|&a| a < node)) {
            let (from_from_to, information) = (between(anchor), matched.information);
            if self.closing.links(anchor) {
                edges.push((anchor, EdgeKind::Match, information));
            } else {
                let (from, to) = (self.id(anchor), self.id(node));
                self.closing.wait(Edge { from, to, kind: EdgeKind::Match, from_from_to, information });
            }
            if links.iter().all(|&(from, _)| from != anchor) {
                links.push((anchor, *covariance));
            }
        }
        let edge = |&(from, kind, information): &(u32, EdgeKind, Cov3)| Edge {
            from: self.id(from),
            to: self.id(node),
            kind,
            from_from_to: between(from),
            information,
        };
        let edges: Vec<Edge> = edges.iter().map(edge).collect();
        self.closing.add(self.world_from_keyframe[node as usize], step_m, &edges);
        self.edges.extend(edges);
        let spacing = spacing(&self.keyframes, node as usize, step_m);
        for (from, covariance) in links {
            self.live.connect(from, &covariance, spacing);
        }
    }

    /// Covariance of the robot relative to the anchor.
    pub(super) fn covariance(&self) -> Cov3 {
        let predicted = match self.local_from_keyframe.last() {
            Some(newest) => {
                let step = newest.between(self.local_from_robot);
                compose_covariance(&self.keyframe_from_anchor, step, &self.odometry_since_keyframe)
            }
            None => self.odometry_since_keyframe,
        };
        let away_m = self.anchor.map_or(0.0, |a| self.local_from_keyframe[a as usize].distance(self.local_from_robot));
        let [floor_m, floor_rad] = MAP_FLOOR.map(|[at_anchor, per_metre]| at_anchor + per_metre * away_m);
        let floor = Vector3::new(floor_m * floor_m, floor_m * floor_m, floor_rad * floor_rad);
        fuse(&predicted, &self.information) + Matrix3::from_diagonal(&floor)
    }
}

/// Whether a scan fits badly where much is known.
fn hardly_fits(matched: &Matched) -> bool {
    matched.agreement.inlier_share() < DOUBT_SHARE && matched.agreement.known_share() > MISFIT_KNOWN_SHARE
}

/// How far apart keyframes and scans are before a keyframe that is a step on from the last one.
pub(crate) fn spacing(keyframes: &[Keyframe], node: usize, step_m: f64) -> Spacing {
    let scan = |node: usize| keyframes.get(node).map_or(0, |keyframe| keyframe.scan);
    let scans = scan(node).saturating_sub(scan(node.saturating_sub(1))).max(1);
    Spacing { keyframe_m: step_m, scan_m: step_m / scans as f64 }
}
