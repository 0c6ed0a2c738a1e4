//! Steps 6 and 7: old places are looked for, and the past is corrected.

use super::{MAP_FLOOR, Mapper};
use crate::closing::Past;
use crate::jobs::{Job, JobResult, Outcome, Solved, Task};
use crate::live::Frames;
use crate::patches::Known;
use mapwright_geom::Cov3;
use mapwright_record::KeyframeId;

impl Mapper {
    /// Looks for old places from time to time.
    pub(super) fn detect(&mut self, keyframe: Option<u32>) {
        if keyframe.is_none() || !self.closing.is_due() {
            return;
        }
        let known = self.live.survey();
        let matcher = self.matcher.settings;
        let past = Past { keyframes: &self.keyframes, local_from_keyframe: &self.local_from_keyframe };
        if let Some(verification) = self.closing.propose(&self.settings, past, &known, matcher) {
            self.jobs.push_back(Job(Task::Verify(verification)));
        }
        while let Some(job) = self.jobs.pop_front() {
            self.apply(job.run());
        }
    }

    /// How certain the first keyframe of each patch of the map is relative to the newest one: larger standard deviation
    /// of the position, metres, and that of the heading, radians.
    pub fn certainty(&mut self) -> Vec<(KeyframeId, f64, f64)> {
        let sigmas = |known: Known| {
            let (m2, rad2) = (known.uncertainty.displacement_m2, known.uncertainty.rotation_rad2);
            (KeyframeId { robot: 0, session: 0, seq: known.first }, m2.sqrt(), rad2.sqrt())
        };
        self.live.survey().into_iter().map(sigmas).collect()
    }

    /// Takes a job's result in.
    pub fn apply(&mut self, result: JobResult) {
        match result.0 {
            Outcome::Verified { to, findings } => {
                for (target, finding) in findings {
                    let past = Past { keyframes: &self.keyframes, local_from_keyframe: &self.local_from_keyframe };
                    let edges = self.closing.judge(past, to, &target, &finding);
                    for edge in edges {
                        let covariance = self.closing.covariance_of(&edge);
                        let frames = Frames { keyframes: &self.keyframes, world_from_robot: &self.local_from_keyframe };
                        self.live.close(frames, edge.from.seq, edge.to.seq, &covariance);
                        self.edges.push(edge);
                    }
                }
                if let Some(solving) = self.closing.solving(&self.world_from_keyframe) {
                    self.jobs.push_back(Job(Task::Solve(solving)));
                }
            }
            Outcome::Solved { solved, .. } => {
                if let Some(solved) = solved {
                    self.correct(&solved);
                }
            }
        }
    }

    /// Moves the past; the newest keyframe of the solution stays where it is in the front end's frame.
    fn correct(&mut self, solved: &Solved) {
        self.closing.take_back(&solved.taken_back);
        let Some(last) = solved.world_from_keyframe.len().checked_sub(1) else { return };
        let before = self.local_from_keyframe.clone();
        self.world_from_local = solved.world_from_keyframe[last] * self.local_from_keyframe[last].inverse();
        let local_from_world = self.world_from_local.inverse();
        for (local, &world) in self.local_from_keyframe.iter_mut().zip(&solved.world_from_keyframe) {
            *local = local_from_world * world;
        }
        self.world_from_keyframe =
            self.local_from_keyframe.iter().map(|&local| self.world_from_local * local).collect();
        let frames = Frames { keyframes: &self.keyframes, world_from_robot: &self.local_from_keyframe };
        self.live.carry(&before, frames);
    }

    /// Error of the map between two keyframes so far apart that no single match shows.
    pub(crate) fn map_floor(away_m: f64) -> Cov3 {
        let [floor_m, floor_rad] = MAP_FLOOR.map(|[at_anchor, per_metre]| at_anchor + per_metre * away_m);
        Cov3::from_diagonal(&[floor_m * floor_m, floor_m * floor_m, floor_rad * floor_rad].into())
    }
}
