//! What is done with what a robot sees: in the plane or in space, a map that is made or one that is finished.

use super::asking::Reply;
use super::drawer::Drawn;
use super::view::Shown;
use crate::args::LiveArgs;
use crate::failure::{Failure, Outcome};
use crate::reading::Reading as ReadingReport;
use crate::space::Read;
use mapwright::{Job, JobResult, Session, Update};
use mapwright_live::Passed;
use mapwright_live::node::asked::{Asked, Why};

/// What came of a scan, a cloud or a job.
pub(super) struct Step<M: Drawn> {
    pub(super) update: Update<M>,
    /// Whether it is known where the robot is.
    pub(super) is_located: bool,
    /// Whether it could be written down.
    pub(super) written: Result<(), Failure>,
}

/// What comes of what somebody asks.
pub(super) enum Answer {
    Reply(Reply),
    /// Everything has begun anew.
    Anew,
}

impl From<Result<(), (Why, String)>> for Answer {
    fn from(result: Result<(), (Why, String)>) -> Self {
        match result {
            Ok(()) => Self::Anew,
            Err((why, words)) => Self::Reply(Reply::refused(why, words)),
        }
    }
}

/// What was read of a recording that was played.
pub(super) enum Played {
    Plane(Box<ReadingReport>),
    Space(Box<Read>),
}

/// All that is known once a robot has driven.
pub(super) struct Driven<'a> {
    pub(super) args: &'a LiveArgs,
    /// Of a recording that was played: its name, and what was read.
    pub(super) played: Option<(String, Played)>,
    /// The topics of scans or clouds.
    pub(super) topics: String,
    /// Of each topic, what arrived and what became of it.
    pub(super) arrived: Vec<String>,
    /// What was lost, in words.
    pub(super) losses: Vec<String>,
    /// Whether somebody wanted it to end.
    pub(super) is_interrupted: bool,
}

/// What is done with what a robot sees.
pub(super) trait Work {
    /// The plane or space.
    type Maps: Drawn + Shown;

    /// What was written down.
    fn session(&self) -> &Session<Self::Maps>;
    /// What the mapper has recorded, the update included that was just made.
    fn newest(&self) -> &Session<Self::Maps>;
    /// Whether a map is made, that others are told.
    fn is_made(&self) -> bool;
    /// Takes in what has come through the gate; nothing comes of readings between scans.
    fn add(&mut self, passed: &Passed) -> Result<Option<Step<Self::Maps>>, Failure>;
    /// The next job to be done beside.
    fn next_job(&mut self) -> Option<Job<Self::Maps>>;
    /// Takes in a job's result.
    fn apply(&mut self, result: JobResult<Self::Maps>) -> Option<Step<Self::Maps>>;
    /// What somebody asks of the map, done or refused; `frame` is the map's.
    fn answer(&mut self, asked: Asked, frame: &str) -> Answer;
    /// Writes the results and says what was made and lost.
    fn finish(self, driven: Driven<'_>) -> Result<Outcome, Failure>;
}
