//! Work that may take longer than a scan: values that go out, results that come in.
//!
//! A job holds all it needs and says the same wherever and whenever it runs. When a log is processed it is done at once;
//! a robot that drives hands it to a worker and takes the result in when it is there.

use mapwright_loops::{Closes, Solved, Solving, Verification, Verified};
use mapwright_sensor::Sweep;

/// A piece of work.
#[derive(Debug, Clone)]
pub struct Job<M: Closes = Sweep>(pub(crate) Task<M>);

/// What came of a [`Job`].
#[derive(Debug, Clone)]
pub struct JobResult<M: Closes = Sweep>(pub(crate) Outcome<M>);

#[derive(Debug, Clone)]
pub(crate) enum Task<M: Closes> {
    Verify(Box<Verification<M::Submaps>>),
    Solve(Solving<M::Pose>),
}

#[derive(Debug, Clone)]
pub(crate) enum Outcome<M: Closes> {
    /// Some places were looked at, others are left.
    Advanced(Box<Verification<M::Submaps>>),
    Verified(Verified<M::Pose>),
    Solved(Option<Solved<M::Pose>>),
}

impl<M: Closes> Job<M> {
    /// Does the work.
    #[must_use]
    pub fn run(self) -> JobResult<M> {
        JobResult(match self.0 {
            Task::Verify(mut verification) => {
                if verification.advance() {
                    Outcome::Advanced(verification)
                } else {
                    Outcome::Verified(verification.run())
                }
            }
            Task::Solve(solving) => Outcome::Solved(solving.run()),
        })
    }
}
