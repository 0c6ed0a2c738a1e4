//! A robot in space.

use super::asking::Reply;
use super::drawer::{place_of, with_ending};
use super::work::{Answer, Driven, Played, Step, Work};
use crate::failure::{Failure, Outcome};
use crate::session::earlier_in_space;
use crate::space::{Drive, Read};
use mapwright::{Job, JobResult, Session, SpaceSweep, Update};
use mapwright_live::node::asked::{Asked, Start, Why};
use mapwright_live::{Passed, Reading};

/// A map of space that is made, and written down.
pub(super) struct Clouds(pub(super) Drive);

impl Clouds {
    fn begin_anew(&mut self, file: &str) -> Result<(), (Why, String)> {
        let path = place_of(self.0.folder(), file).map_err(|words| (Why::NoSuchFile, words))?;
        let path = with_ending(&path, "mapwright");
        if !path.exists() {
            return Err((Why::NoSuchFile, format!("there is no {}", path.display())));
        }
        earlier_in_space(&path)
            .and_then(|earlier| self.0.begin_anew(Some(earlier.session)))
            .map_err(|failure| (Why::Unreadable, failure.to_string()))
    }
}

fn step((update, written): (Update<SpaceSweep>, Result<(), Failure>)) -> Step<SpaceSweep> {
    Step { update, is_located: true, written }
}

impl Work for Clouds {
    type Maps = SpaceSweep;

    fn session(&self) -> &Session<SpaceSweep> {
        self.0.session()
    }

    fn newest(&self) -> &Session<SpaceSweep> {
        self.0.newest()
    }

    fn is_made(&self) -> bool {
        true
    }

    fn add(&mut self, passed: &Passed) -> Result<Option<Step<SpaceSweep>>, Failure> {
        match passed {
            Passed::Cloud(cloud) => Ok(Some(step(self.0.add_cloud(cloud)))),
            Passed::Reading(Reading::InSpace(reading)) => {
                self.0.add_reading(*reading);
                Ok(None)
            }
            Passed::Scan(_) | Passed::Reading(Reading::Odometry(_) | Reading::Turning(_)) => Ok(None),
        }
    }

    fn next_job(&mut self) -> Option<Job<SpaceSweep>> {
        self.0.next_job()
    }

    fn apply(&mut self, result: JobResult<SpaceSweep>) -> Option<Step<SpaceSweep>> {
        Some(step(self.0.apply(result)))
    }

    fn answer(&mut self, asked: Asked, _frame: &str) -> Answer {
        let refused = |why, words: &str| Answer::Reply(Reply::refused(why, words));
        match asked {
            Asked::Reset { .. } => self.0.begin_anew(None).map_err(|failure| (Why::Other, failure.to_string())).into(),
            Asked::Deserialize { start: Start::LocaliseFrom { .. }, .. }
            | Asked::FindAnew
            | Asked::SetPose(_)
            | Asked::LoadMap { .. } => refused(Why::WrongMode, "a map of space is being made"),
            Asked::Deserialize { file, .. } => self.begin_anew(&file).into(),
            _ => refused(Why::Other, "that is not offered"),
        }
    }

    fn finish(self, driven: Driven<'_>) -> Result<Outcome, Failure> {
        let Driven { args, played, losses, is_interrupted, topics, .. } = driven;
        let is_cut = played.is_some() && is_interrupted;
        let (name, read) = match played {
            Some((name, Played::Space(read))) => (name, *read),
            Some((name, Played::Plane(_))) => (name, Read::live(&topics)),
            None => ("live".to_owned(), Read::live(&topics)),
        };
        self.0.finish((&name, read), losses, (&args.output, args.mapping.voice), is_cut)
    }
}
