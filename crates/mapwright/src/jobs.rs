//! Work that may take longer than a scan: values that go out, results that come in.
//!
//! A job holds all it needs and says the same wherever and whenever it runs. When a log is processed it is done at once;
//! a robot that drives hands it to a worker and takes the result in when it is there.

use crate::closing::{Seeking, Sought};
use mapwright_geom::Pose2;
use mapwright_graph::{PoseGraph2, SolverSettings, optimize};
use mapwright_grid::{Matcher, MatcherSettings, SearchWindow};
use mapwright_loops::{Finding, Submap, SubmapSettings, Verifier, VerifySettings, View};
use mapwright_record::Detection;

/// A piece of work.
#[derive(Debug, Clone)]
pub struct Job(pub(crate) Task);

/// What came of a [`Job`].
#[derive(Debug, Clone)]
pub struct JobResult(pub(crate) Outcome);

#[derive(Debug, Clone)]
pub(crate) enum Task {
    Verify(Verification),
    Solve(Solving),
    Seek(Seeking),
}

#[derive(Debug, Clone)]
pub(crate) enum Outcome {
    Verified { to: u32, findings: Vec<(Target, Finding)>, work: (usize, u64) },
    Solved { solved: Option<Solved> },
    Sought(Box<Sought>),
}

impl Job {
    /// Does the work.
    #[must_use]
    pub fn run(self) -> JobResult {
        JobResult(match self.0 {
            Task::Verify(verification) => verification.run(),
            Task::Solve(solving) => solving.run(),
            Task::Seek(seeking) => Outcome::Sought(Box::new(seeking.run())),
        })
    }
}

/// The present submap is looked for in old ones.
#[derive(Debug, Clone)]
pub(crate) struct Verification {
    /// The newest keyframe, whose frame is that of the query.
    pub(crate) to: u32,
    pub(crate) query: Vec<View>,
    pub(crate) targets: Vec<(Target, Vec<View>)>,
    pub(crate) submaps: SubmapSettings,
    pub(crate) verify: VerifySettings,
    pub(crate) matcher: MatcherSettings,
}

/// An old place and where the robot may be, seen from there.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Target {
    pub(crate) from: u32,
    pub(crate) detection: Detection,
    /// The middle of the window.
    pub(crate) middle: Pose2,
    /// Standard deviations of that, metres and radians.
    pub(crate) sigma_m: f64,
    pub(crate) sigma_rad: f64,
    pub(crate) half_width_m: f64,
    pub(crate) half_width_rad: f64,
}

impl Verification {
    /// Every target with what was found there.
    fn run(self) -> Outcome {
        let mut verifier = Verifier::new(self.verify, Matcher { settings: self.matcher });
        let query = Submap::new(&self.query, &self.submaps);
        let mut work = (self.query.len(), 0);
        let look = |(target, views): &(Target, Vec<View>)| {
            let submap = Submap::new(views, &self.submaps);
            let window = SearchWindow {
                world_from_robot: target.middle,
                half_width_m: target.half_width_m,
                half_width_rad: target.half_width_rad,
            };
            let finding = verifier.look_for(&query, &submap, &window);
            work = (work.0 + views.len(), work.1 + verifier.scored());
            (*target, finding)
        };
        let findings = self.targets.iter().map(look).collect();
        Outcome::Verified { to: self.to, findings, work }
    }
}

/// A graph to be brought to its optimum.
#[derive(Debug, Clone)]
pub(crate) struct Solving {
    pub(crate) graph: PoseGraph2,
    /// Places of the closures among the edges.
    pub(crate) closures: Vec<usize>,
    /// A closure that the optimum strains more than this is taken back.
    pub(crate) most_chi2: f64,
}

/// A solved graph.
#[derive(Debug, Clone)]
pub(crate) struct Solved {
    pub(crate) world_from_keyframe: Vec<Pose2>,
    /// Places of the closures, among the edges, that the others contradict.
    pub(crate) taken_back: Vec<usize>,
}

/// Closures that one solution may take back.
const TAKEN_BACK_AT_MOST: usize = 16;
const ITERATIONS_AT_MOST: usize = 25;

impl Solving {
    fn run(mut self) -> Outcome {
        let before: Vec<Pose2> = self.graph.vertices.iter().map(|v| v.world_from_vertex).collect();
        let settings =
            SolverSettings { chordal: false, max_iterations: ITERATIONS_AT_MOST, ..SolverSettings::default() };
        let mut taken_back = Vec::new();
        loop {
            if optimize(&mut self.graph, &settings).is_err() {
                return Outcome::Solved { solved: None };
            }
            let Some(worst) = self.most_strained().filter(|_| taken_back.len() < TAKEN_BACK_AT_MOST) else { break };
            taken_back.push(worst);
            self.graph.edges[worst].information.fill(0.0);
            self.graph.vertices.iter_mut().zip(&before).for_each(|(vertex, &pose)| vertex.world_from_vertex = pose);
        }
        let world_from_keyframe = self.graph.vertices.iter().map(|v| v.world_from_vertex).collect();
        Outcome::Solved { solved: Some(Solved { world_from_keyframe, taken_back }) }
    }

    /// The closure with the largest chi-square, where that is too large.
    fn most_strained(&self) -> Option<usize> {
        let chi2 = |&at: &usize| {
            let edge = &self.graph.edges[at];
            let [from, to] = [edge.from, edge.to].map(|v| self.graph.vertices[v].world_from_vertex);
            let error = edge.from_from_to.between(from.between(to)).to_vector();
            (at, error.dot(&(edge.information * error)))
        };
        let worst = self.closures.iter().map(chi2).max_by(|a, b| a.1.total_cmp(&b.1).then(b.0.cmp(&a.0)));
        worst.filter(|(_, chi2)| *chi2 > self.most_chi2).map(|(at, _)| at)
    }
}
