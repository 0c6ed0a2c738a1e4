//! Work that may take longer than a scan: values that go out, results that come in.
//!
//! A job holds all it needs and says the same wherever and whenever it runs. When a log is processed it is done at once;
//! a robot that drives hands it to a worker and takes the result in when it is there.

use crate::relocation::{Seeking, Sought};
use mapwright_loops::{PlaneSubmaps, Solved, Solving, Verification, Verified};

/// A piece of work.
#[derive(Debug, Clone)]
pub struct Job(pub(crate) Task);

/// What came of a [`Job`].
#[derive(Debug, Clone)]
pub struct JobResult(pub(crate) Outcome);

#[derive(Debug, Clone)]
pub(crate) enum Task {
    Verify(Box<Verification<PlaneSubmaps>>),
    Solve(Solving),
    Seek(Seeking),
}

#[derive(Debug, Clone)]
pub(crate) enum Outcome {
    Verified(Verified),
    Solved(Option<Solved>),
    Sought(Box<Sought>),
}

impl Job {
    /// Does the work.
    #[must_use]
    pub fn run(self) -> JobResult {
        JobResult(match self.0 {
            Task::Verify(verification) => Outcome::Verified(verification.run()),
            Task::Solve(solving) => Outcome::Solved(solving.run()),
            Task::Seek(seeking) => Outcome::Sought(Box::new(seeking.run())),
        })
    }
}
