//! `mapwright merge` of sessions and recordings of space.

use super::mapping::Mapping;
use super::source::{Read, Source};
use super::{Disk, Finished, finish, notes_in_words, seek};
use crate::args::{MergeArgs, SourceArgs};
use crate::failure::{Failure, Outcome};
use crate::interrupt::Interrupt;
use crate::output::OutputFolder;
use crate::terminal::count;
use mapwright::{Cloud, Session, SpaceReading, SpaceSweep};
use std::path::{Path, PathBuf};

/// What is merged.
pub(crate) enum Input {
    /// A session, and what was lost of it.
    Session(Box<Session<SpaceSweep>>, Vec<String>),
    /// A recording, which is read when its turn comes.
    Recording(PathBuf),
}

/// Merges sessions and recordings, in their order.
pub(crate) fn merge(args: &MergeArgs, inputs: Vec<(String, Input)>, interrupt: &Interrupt) -> Result<Outcome, Failure> {
    let names = inputs.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>().join(", ");
    let (mut mapping, mut read, mut sessions) = (None::<Mapping>, Read::default(), 0);
    for (name, input) in inputs {
        match input {
            Input::Session(session, mut losses) => {
                sessions += 1;
                match &mut mapping {
                    None => mapping = Some(begin(args, Some(*session), losses)?),
                    Some(mapping) => {
                        mapping.earlier_losses.append(&mut losses);
                        mapping.import(&session, &name, interrupt)?;
                    }
                }
            }
            Input::Recording(path) => {
                let is_first = mapping.is_none();
                let mapping = match &mut mapping {
                    Some(known) => known,
                    none => none.insert(begin(args, None, Vec::new())?),
                };
                if !is_first {
                    mapping.switch_on()?;
                }
                let of_this = with_source(&path, &args.source, interrupt, |mut source| {
                    map_all(mapping, &mut source, interrupt)?;
                    Ok(source.read())
                })?;
                read = read.and(of_this, &name);
            }
        }
        if interrupt.came() {
            break;
        }
    }
    let Some(mut mapping) = mapping else { return Err(Failure::Usage("expected recordings or sessions".to_owned())) };
    mapping.end_of_clouds();
    if sessions > 0 {
        let merged = Read { kind: count(sessions, "session"), ..Read::default() };
        read = merged.and(read, "");
    }
    let (is_cut, voice) = (interrupt.came(), args.mapping.voice);
    finish(
        mapping,
        &Finished { name: &names, read, simulation: None, is_cut, output: &args.output, voice, mesh_threads: None },
    )
}

fn begin(args: &MergeArgs, earlier: Option<Session<SpaceSweep>>, losses: Vec<String>) -> Result<Mapping, Failure> {
    Mapping::begin(&args.mapping, OutputFolder::create(&args.output)?, None, (earlier, losses))
}

/// Every cloud of a source through the mapper, until somebody interrupts.
fn map_all(mapping: &mut Mapping, source: &mut Source<'_>, interrupt: &Interrupt) -> Result<(), Failure> {
    let mut readings: Vec<SpaceReading> = Vec::new();
    while let Some(cloud) = source.next_cloud(&mut |reading| readings.push(reading))? {
        readings.drain(..).for_each(|reading| mapping.mapper.add_reading(reading));
        mapping.add_cloud(&cloud)?;
        if interrupt.came() {
            break;
        }
    }
    Ok(())
}

/// What is said of a recording whose clouds were handed on.
pub(crate) struct Said {
    pub(crate) losses: Vec<String>,
    pub(crate) odd: Vec<String>,
}

/// Who takes clouds, each with the readings before it.
pub(crate) type TakesClouds<'a> = dyn FnMut(&mut Vec<SpaceReading>, &Cloud) -> Result<(), Failure> + 'a;

/// Hands on every cloud of a recording, with the readings before it, until somebody interrupts.
pub(crate) fn each_cloud(
    path: &Path,
    args: &SourceArgs,
    interrupt: &Interrupt,
    take: &mut TakesClouds<'_>,
) -> Result<Said, Failure> {
    with_source(path, args, interrupt, |mut source| {
        let mut readings: Vec<SpaceReading> = Vec::new();
        while let Some(cloud) = source.next_cloud(&mut |reading| readings.push(reading))? {
            take(&mut readings, &cloud)?;
            readings.clear();
            if interrupt.came() {
                break;
            }
        }
        let read = source.read();
        let (lost, noted) = notes_in_words(&read.notes);
        Ok(Said { losses: [read.losses, lost].concat(), odd: [read.said, read.odd, noted].concat() })
    })
}

/// Opens a recording of space, whatever holds it.
pub(super) fn with_source<T>(
    path: &Path,
    args: &SourceArgs,
    interrupt: &Interrupt,
    make: impl FnOnce(Source<'_>) -> Result<T, Failure>,
) -> Result<T, Failure> {
    if let Some(disk) = Disk::open(path)?
        && let Some(recording) = disk.recording()?
    {
        return make(Source::files(path.display().to_string(), &recording, args)?);
    }
    let source = seek::in_space(path, args, &mut |_, _| !interrupt.came())?;
    make(source)
}
