//! A robot in space that drives.

use super::mapping::Mapping;
use super::source::Read;
use super::{Finished, finish};
use crate::args::{MappingArgs, Voice};
use crate::failure::{Failure, Outcome};
use crate::output::OutputFolder;
use crate::session::{EarlierInSpace, SESSION, SessionLog};
use mapwright::{Cloud, Job, JobResult, Session, Settings, SpaceMapper, SpaceReading, SpaceSweep, Update};
use std::path::Path;

/// A map of space that grows while the robot drives.
pub(crate) struct Drive(Mapping);

/// What came of a cloud or of a job, and whether it could be written down.
pub(crate) type Came = (Update<SpaceSweep>, Result<(), Failure>);

impl Drive {
    /// Begins, or goes on with a session, wherever the robot is in it.
    pub(crate) fn begin(
        args: &MappingArgs,
        settings: Settings,
        output: OutputFolder,
        earlier: Option<EarlierInSpace>,
    ) -> Result<Self, Failure> {
        let goes_on = earlier.is_some();
        let (session, losses) = earlier.map_or((None, Vec::new()), |earlier| (Some(earlier.session), earlier.losses));
        let mut mapping = Mapping::begin_with(args, settings, output, None, (session, losses))?;
        if goes_on {
            mapping.switch_on()?;
        }
        Ok(Self(mapping))
    }

    /// What was written down.
    pub(crate) fn session(&self) -> &Session<SpaceSweep> {
        self.0.session()
    }

    /// What the mapper has recorded, the update included that was just made.
    pub(crate) fn newest(&self) -> &Session<SpaceSweep> {
        self.0.mapper.session()
    }

    pub(crate) fn folder(&self) -> &Path {
        self.0.output.folder()
    }

    pub(crate) fn add_cloud(&mut self, cloud: &Cloud) -> Came {
        self.0.add_cloud_live(cloud)
    }

    pub(crate) fn add_reading(&mut self, reading: SpaceReading) {
        self.0.mapper.add_reading(reading);
    }

    pub(crate) fn next_job(&mut self) -> Option<Job<SpaceSweep>> {
        self.0.mapper.next_job()
    }

    pub(crate) fn apply(&mut self, result: JobResult<SpaceSweep>) -> Came {
        self.0.apply(result)
    }

    /// Another map begins, or goes on with a session, in the same folder; what was mapped up to now stays there under another name.
    pub(crate) fn begin_anew(&mut self, earlier: Option<Session<SpaceSweep>>) -> Result<(), Failure> {
        self.0.begin_anew(earlier)
    }

    /// Writes the results and says what was made and lost; `read` is what was read of a recording that was played.
    pub(crate) fn finish(
        mut self,
        (name, read): (&str, Read),
        mut losses: Vec<String>,
        (output, voice): (&Path, Voice),
        is_cut: bool,
    ) -> Result<Outcome, Failure> {
        self.0.end_of_clouds();
        self.0.earlier_losses.append(&mut losses);
        finish(self.0, &Finished { name, read, simulation: None, is_cut, output, voice, mesh_threads: None })
    }
}

impl Mapping {
    fn apply(&mut self, result: JobResult<SpaceSweep>) -> Came {
        let update = self.mapper.apply(result);
        (update.clone(), self.log.add(update.entries))
    }

    fn begin_anew(&mut self, earlier: Option<Session<SpaceSweep>>) -> Result<(), Failure> {
        self.log.finish()?;
        let settings = *self.mapper.settings();
        let kept = self.output.keep(SESSION)?;
        let log = SessionLog::begin(&mut self.output, earlier.as_ref())?;
        let goes_on = earlier.is_some();
        let mapper = match earlier {
            Some(session) => SpaceMapper::resume(settings, session)?,
            None => SpaceMapper::new(settings)?,
        };
        (self.log, self.mapper) = (log, mapper);
        self.begin_trajectory()?;
        self.earlier_losses
            .push(format!("somebody asked for another map; what was mapped before is in {}", kept.display()));
        if goes_on { self.switch_on() } else { Ok(()) }
    }
}
