//! Steps 6 and 7: old places are looked for, and the past is corrected.

use super::{MAP_FLOOR, Mapper};
use crate::closing::Past;
use crate::jobs::Target;
use crate::jobs::{Job, JobResult, Outcome, Solved, Task};
use crate::live::Frames;
use crate::patches::Known;
use crate::settings::{Correction, Jobs};
use mapwright_geom::Cov3;
use mapwright_graph::spread;
use mapwright_loops::Finding;
use mapwright_record::{Edge, EdgeKind, KeyframeId};

impl Mapper {
    /// Looks for old places from time to time, and at once where a match is supported by one that nobody has looked at.
    pub(super) fn detect(&mut self, keyframe: Option<u32>) {
        let busy = self.jobs_out > 0 || !self.jobs.is_empty();
        let due = || self.closing.is_due() || self.anchor.is_some_and(|anchor| self.closing.is_unjudged(anchor));
        if keyframe.is_none() || busy || !due() {
            return;
        }
        let known = self.live.survey();
        let matcher = self.matcher.settings;
        let past = Past { keyframes: &self.keyframes, local_from_keyframe: &self.local_from_keyframe };
        if let Some(verification) = self.closing.propose(&self.settings, past, &known, self.anchor, matcher) {
            self.jobs.push_back(Job(Task::Verify(verification)));
        }
        self.work_inline();
    }

    /// Does the jobs at once, where they are not handed out.
    pub(super) fn work_inline(&mut self) {
        while self.settings.loops.jobs == Jobs::Inline
            && let Some(job) = self.jobs.pop_front()
        {
            self.apply(job.run());
        }
    }

    /// The next job to be done, where jobs are handed out (`loops.jobs`); its result goes to [`Mapper::apply`], after
    /// whichever scan it is there.
    pub fn next_job(&mut self) -> Option<Job> {
        let job = self.jobs.pop_front();
        self.jobs_out += usize::from(job.is_some());
        job
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

    /// Takes a job's result in. It may be late: what was inserted since is carried along.
    ///
    /// A result that does not belong to this mapper is left out.
    pub fn apply(&mut self, result: JobResult) {
        self.jobs_out = self.jobs_out.saturating_sub(1);
        let known = self.keyframes.len();
        match result.0 {
            Outcome::Verified { to, findings, work } if (to as usize) < known => {
                self.budget.earn_verification(work.0, work.1);
                self.judge(to, &findings);
            }
            Outcome::Solved { solved: Some(solved) } if solved.world_from_keyframe.len() <= known => {
                self.correct(&solved);
            }
            Outcome::Sought(answer) => self.hear(&answer),
            _ => {}
        }
    }

    fn judge(&mut self, to: u32, findings: &[(Target, Finding)]) {
        let mut closures = Vec::new();
        for (target, finding) in findings.iter().filter(|(target, _)| target.from < to) {
            let past = Past { keyframes: &self.keyframes, local_from_keyframe: &self.local_from_keyframe };
            for edge in self.closing.judge(past, to, target, finding) {
                let covariance = self.closing.covariance_of(&edge);
                let frames = Frames { keyframes: &self.keyframes, world_from_robot: &self.local_from_keyframe };
                self.live.close(frames, edge.from.seq, edge.to.seq, &covariance);
                self.edges.push(edge);
                closures.push(edge);
                if self.settings.loops.correction == Correction::Spread {
                    self.spread(&edge);
                }
            }
        }
        let past = Past { keyframes: &self.keyframes, local_from_keyframe: &self.local_from_keyframe };
        self.edges.extend(self.closing.settle_matches(past, &closures));
        if self.settings.loops.correction == Correction::Graph
            && let Some(solving) = self.closing.solving(&self.world_from_keyframe)
        {
            self.jobs.push_back(Job(Task::Solve(solving)));
        }
    }

    /// The chapter's backwards correction: the closure's error is shared among the steps of the loop.
    fn spread(&mut self, closure: &Edge) {
        let [first, last] = [closure.from.seq, closure.to.seq].map(|node| node as usize);
        let mut world_from_keyframe = self.world_from_keyframe.clone();
        let Some(steps) = world_from_keyframe.get(first..=last) else { return };
        let shares = spread::shares_by_motion(steps);
        if spread::spread(&mut world_from_keyframe, first, last, closure.from_from_to, &shares).is_ok() {
            self.correct(&Solved { world_from_keyframe, taken_back: Vec::new() });
        }
    }

    /// Moves the past; the newest keyframe of the solution stays where it is in the front end's frame.
    fn correct(&mut self, solved: &Solved) {
        for (from, to) in self.closing.take_back(&solved.taken_back) {
            self.live.open(from.seq, to.seq);
            self.edges.retain(|edge| edge.kind != EdgeKind::Closure || (edge.from, edge.to) != (from, to));
        }
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
        self.live.carry(&self.settings, &before, frames);
        self.redraw_ground();
    }

    /// Error of the map between two keyframes so far apart that no single match shows.
    pub(crate) fn map_floor(away_m: f64) -> Cov3 {
        let [floor_m, floor_rad] = MAP_FLOOR.map(|[at_anchor, per_metre]| at_anchor + per_metre * away_m);
        Cov3::from_diagonal(&[floor_m * floor_m, floor_m * floor_m, floor_rad * floor_rad].into())
    }
}
