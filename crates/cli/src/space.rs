//! Recordings of sensors in space: clouds in, files out.

mod ahead;
mod calibrate;
mod disk;
mod going_on;
mod inertial;
mod live;
mod mapping;
mod merge;
mod mesh;
mod messages;
mod picture;
mod report;
mod seek;
mod simulated;
mod source;
mod tally;
mod verdict;
mod visits;

pub(crate) use calibrate::calibrate;
pub(crate) use disk::Disk;
pub(crate) use live::Drive;
pub(crate) use mapping::write_session;
pub(crate) use merge::{Input as MergeInput, each_cloud, merge};
pub(crate) use mesh::{MESH_FILE, Meshing, four_digits, mesh_file, usual_voxel_m};
pub(crate) use messages::plan_in_words;
pub(crate) use picture::up;
pub(crate) use report::{notes_in_words, notes_json};
pub(crate) use seek::{Sought, hear_metadata, in_space, is_of_space, seek};
pub(crate) use simulated::Simulation;
pub(crate) use source::{Read, Source};
pub(crate) use visits::Revisits;

use crate::args::{MappingArgs, SourceArgs, Voice};
use crate::failure::{Failure, Outcome};
use crate::interrupt::Interrupt;
use crate::maps::remove_outdated_exports;
use crate::output::OutputFolder;
use crate::report::written;
use crate::session::{EarlierInSpace, earlier_in_space, to_go_on_with_in_space};
use crate::terminal::{say, say_json};
use ahead::{Ahead, read_ahead};
use going_on::GoesOn;
use mapping::Mapping;
use mapwright::SpaceReading;
use serde_json::json;
use std::path::Path;
pub(crate) use tally::Tally;
pub(crate) use verdict::Facts as SpaceFacts;

/// Of the points of the finished map one is kept in each cube of such a side, of the smallest voxel's.
pub(crate) const MAP_SHARE: f64 = 0.1;

/// What is said of a source that files have no use for is wrong usage.
pub(crate) fn check_choice_of_files(args: &SourceArgs) -> Result<(), Failure> {
    match args.choice().of_recordings() {
        Some(option) => Err(Failure::Usage(format!(
            "{option} is for recordings of messages, found files, which have no such thing"
        ))),
        None => Ok(()),
    }
}

/// What is said of a planar laser is wrong usage where clouds are mapped.
pub(crate) fn check_choice_of_clouds(args: &SourceArgs) -> Result<(), Failure> {
    if args.has_mount() {
        let why = "--mount and the calibration of a planar laser are for planar lasers, found a recording of space: `mapwright calibrate` of it \
                   makes one of its sensors, --imu-mount says how the inertial one sits, --frame names the robot's frame";
        return Err(Failure::Usage(why.to_owned()));
    }
    Ok(())
}

/// What is mapped, under which name, where the results go, and how.
pub(crate) struct Run<'a> {
    pub(crate) name: &'a str,
    pub(crate) output: &'a Path,
    pub(crate) mapping: &'a MappingArgs,
    /// Go on with the session in the folder of results.
    pub(crate) goes_on: bool,
    /// The mesh as well.
    pub(crate) mesh: bool,
}

impl Run<'_> {
    /// The session that is gone on with.
    fn earlier(&self) -> Result<Option<EarlierInSpace>, Failure> {
        if self.goes_on {
            return to_go_on_with_in_space(self.output).map(Some);
        }
        self.mapping.resume.as_ref().map(|path| earlier_in_space(path)).transpose()
    }
}

/// Maps such a recording, or a simulated one.
pub(crate) fn map(args: &Run<'_>, mut source: Source<'_>, interrupt: &Interrupt) -> Result<Outcome, Failure> {
    if args.mapping.start.is_some() {
        let reason = "--start is for logs of planar lasers: maps of space begin at their origin";
        return Err(Failure::Log(reason.to_owned()));
    }
    let (frames, threads) = (source.frames(), args.mapping.threads.unwrap_or(1));
    let (mapping, is_cut) = read_ahead(&mut source, threads, |clouds| map_all(args, clouds, frames, interrupt))?;
    let (name, voice) = (args.name, args.mapping.voice);
    finish(
        mapping,
        &Finished {
            name,
            read: source.read(),
            simulation: source.simulation(),
            is_cut,
            output: args.output,
            voice,
            mesh_threads: args.mesh.then_some(threads as usize),
        },
    )
}

/// Every cloud that an earlier run has not mapped, until somebody interrupts: then true comes with it.
fn map_all(
    args: &Run<'_>,
    clouds: &mut Ahead<'_, '_>,
    frames: u64,
    interrupt: &Interrupt,
) -> Result<(Mapping, bool), Failure> {
    let name = args.name;
    let mut readings: Vec<SpaceReading> = Vec::new();
    let mut next = clouds.next_cloud(&mut readings)?;
    let mut earlier = args.earlier()?;
    let earlier_losses = earlier.iter_mut().flat_map(|earlier| std::mem::take(&mut earlier.losses)).collect();
    let mut went_on = earlier.map(|earlier| GoesOn::with(earlier, next.as_ref()));
    if args.goes_on && went_on.as_ref().is_some_and(|went_on| !went_on.is_same) {
        return Err(Failure::Usage(format!(
            "--continue goes on with the recording that the session in {} is made of, found another one; what was recorded right after it, \
             in a file of its own, goes on with --resume {} into another folder",
            args.output.display(),
            args.output.display()
        )));
    }
    let session = went_on.as_mut().and_then(|went_on| went_on.session.take());
    let output = OutputFolder::create(args.output)?;
    let mut mapping = Mapping::begin(args.mapping, output, Some(frames), (session, earlier_losses))?;
    let mut is_cut = false;
    while let Some(cloud) = next {
        let is_new = went_on.as_mut().map_or(Ok(true), |went_on| went_on.is_new(&cloud)).map_err(Failure::Log)?;
        if is_new {
            readings.drain(..).for_each(|reading| mapping.mapper.add_reading(reading));
            mapping.add_cloud(&cloud)?;
        }
        is_cut = interrupt.came();
        if is_cut {
            break;
        }
        // Before a cloud that the session has come readings that its mapper knows.
        readings.clear();
        next = clouds.next_cloud(&mut readings)?;
        if went_on.as_ref().is_some_and(|went_on| !went_on.is_through()) {
            readings.clear();
        }
    }
    mapping.end_of_clouds();
    let missing = went_on.as_ref().map_or(0, GoesOn::missing);
    if missing > 0 && !is_cut {
        return Err(Failure::Log(format!(
            "{name}: expected a recording of which the session has the beginning, found one that ends {missing} clouds before the session does"
        )));
    }
    Ok((mapping, is_cut))
}

/// A run whose clouds were all taken in.
struct Finished<'a> {
    name: &'a str,
    read: Read,
    simulation: Option<&'a Simulation>,
    is_cut: bool,
    output: &'a Path,
    voice: Voice,
    /// On so many threads the mesh is made, if it is asked for.
    mesh_threads: Option<usize>,
}

/// Writes the results and says what was made and lost.
fn finish(mut mapping: Mapping, finished: &Finished<'_>) -> Result<Outcome, Failure> {
    let Finished { name, ref read, simulation, is_cut, output, voice, mesh_threads } = *finished;
    let (mut losses, mut odd) = (read.losses.clone(), read.odd.clone());
    losses.append(&mut mapping.earlier_losses);
    let (lost, noted) = notes_in_words(&read.notes);
    losses.extend(lost);
    odd.extend(noted);
    if is_cut {
        losses.push(format!("interrupted after {} clouds; the results are complete up to there", mapping.tally.clouds));
    }
    if mapping.mapper.session().keyframes().is_empty() {
        let why: String = read.odd.iter().chain(&read.doubts).map(|why| format!("; {why}")).collect();
        return Err(Failure::Log(format!(
            "{name}: expected clouds with at least 100 returns, found none in {} clouds: there is nothing to map{why}",
            mapping.tally.clouds
        )));
    }
    if !is_cut {
        mapping.look_again()?;
    }
    let results = mapping.write_results(read, simulation)?;
    odd.extend(results.odd());
    losses.extend(results.losses());
    if let Some(threads) = mesh_threads {
        losses.extend(mapping.write_meshes(threads)?);
    }
    let usable = SpaceFacts::of(&mapping.tally, &mut mapping.mapper).doubting(&read.doubts).judged();
    let all_losses: Vec<String> = losses.iter().cloned().chain(usable.loss()).collect();
    let mut report = report::to_json(name, read, &mapping.tally, &results, (&usable, &all_losses));
    report["odd"] = json!(odd);
    mapping.output.write_json("report.json", &report)?;
    let timing = mapping.clock.report(mapping.tally.clouds, results.log_s);
    mapping.output.write_json("timing.json", &timing)?;
    odd.extend(remove_outdated_exports(&mut mapping.output));
    let written = written(output, mapping.output.names());
    let words = report::to_words((read, &mapping.tally, &results), (name, &timing, &usable), (&losses, &odd), &written);
    let files = mapping.output.commit()?;
    if voice.json {
        say_json(&json!({ "files": files, "report": report, "timing": timing }))?;
    } else if !voice.quiet {
        say(&words)?;
    }
    Ok(Outcome::of_losses(&all_losses))
}
