//! What another program does with this one: maps logs, reads and writes folders of results.

use crate::args::{Args, Command, StampPolicy};
use crate::commands::{map_until, read_map, yaml_of};
use crate::drawing::draw_believed;
use crate::failure::{Failure, USAGE};
use crate::image::map_image;
use crate::interrupt::Interrupt;
use crate::mapping::{entries_of_left_out, write_graph, write_trajectory};
use crate::maps::{MapWriter, remove_outdated_exports, remove_outdated_maps, ways};
use crate::output::OutputFolder;
use crate::picture::RunNames;
use crate::session::{AnySession, SessionLog, read_any_session, settings_of};
use crate::space::{MAP_SHARE, write_session};
use clap::Parser;
use mapwright::{Session, SpaceSweep};
use mapwright_formats::{GridImage, read_map_image, read_map_yaml, write_map_yaml, write_pgm};
use std::ffi::OsString;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// What `mapwright map` writes and a session alone does not tell.
const OF_RUNS: [&str; 3] = ["report.json", "timing.json", "trajectory_online.tum"];

/// Why something was not done, in the command's words.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CommandError {
    /// An option or a setting that makes no sense.
    #[error("{0}")]
    Usage(String),
    /// All else: files, logs.
    #[error("{0}")]
    Failed(String),
}

impl From<Failure> for CommandError {
    fn from(failure: Failure) -> Self {
        let words = failure.to_string();
        if failure.code() == USAGE { Self::Usage(words) } else { Self::Failed(words) }
    }
}

/// Maps as `mapwright map` with these words behind it, to the same bytes, and says nothing. Returns the folder of results; what was lost
/// stands in its `report.json`.
///
/// No signal is handled: once `stop` is set the mapping ends, its results complete up to there.
///
/// # Errors
/// Those of the command.
pub fn map(words: impl IntoIterator<Item = OsString>, stop: Arc<AtomicBool>) -> Result<PathBuf, CommandError> {
    let all = ["mapwright", "map", "--quiet"].into_iter().map(OsString::from).chain(words);
    let parsed = Args::try_parse_from(all).map_err(|error| {
        let text = error.to_string();
        CommandError::Usage(text.trim().trim_start_matches("error: ").to_owned())
    })?;
    let Command::Map(args) = parsed.command else {
        return Err(CommandError::Usage("expected the words of `mapwright map`".to_owned()));
    };
    map_until(&args, &Interrupt::told_by(stop))?;
    Ok(args.output())
}

/// The session of a folder of results, or that file itself, and what was lost of it, in words.
///
/// # Errors
/// No such file, or no session.
pub fn read_session(path: &Path) -> Result<(AnySession, Vec<String>), CommandError> {
    Ok(read_any_session(path)?)
}

/// The map of a folder of results, or of a YAML: 0 free, 100 occupied, 255 unknown.
///
/// # Errors
/// No such file, or no map.
pub fn read_grid(path: &Path) -> Result<GridImage, CommandError> {
    Ok(read_map(&yaml_of(path))?)
}

/// A session's first map, as [`save_plane`] writes and [`read_grid`] reads it.
///
/// # Errors
/// Settings in the session that are none.
pub fn grid_of(session: &Session) -> Result<GridImage, CommandError> {
    let settings = settings_of(session, Path::new("the session"))?;
    let maps = session.maps();
    let (counts, _) = draw_believed(&settings, session, &maps.into_iter().next().unwrap_or_default());
    let image = map_image(&counts, settings.map.passes_per_hit).image;
    let (mut pgm, mut yaml) = (Vec::new(), Vec::new());
    let read = write_pgm(&image, &mut pgm)
        .and_then(|()| write_map_yaml(&image, "map.pgm", &mut yaml))
        .and_then(|()| read_map_image(&read_map_yaml(&yaml[..])?, Cursor::new(pgm)));
    read.map_err(|cause| CommandError::Failed(cause.to_string()))
}

/// The points of a session's first map, metres, as [`save_space`] writes them.
#[must_use]
pub fn points_of(session: &Session<SpaceSweep>, resolution_m: f64) -> Vec<[f32; 3]> {
    let maps = session.maps();
    let first = maps.first().map(|map| mapwright::points_of_map(session, map, MAP_SHARE * resolution_m));
    first.map_or_else(Vec::new, |points| points.points_m)
}

/// Writes what a session of the plane tells into a folder, which is made if need be: `session.mapwright`, trajectory, graph, closures and
/// maps, as `mapwright map` does.
///
/// # Errors
/// A file that cannot be written; settings in the session that are none.
pub fn save_plane(session: &Session, folder: &Path) -> Result<(), CommandError> {
    let settings = settings_of(session, folder)?;
    let mut output = OutputFolder::create(folder)?;
    let mut log = SessionLog::begin(&mut output, Some(session))?;
    write_trajectory(&mut output, session, StampPolicy::Log)?;
    write_graph(&mut output, session)?;
    let maps = session.maps();
    let (ways, _) = ways(session, &maps);
    let names = RunNames::of_logs(std::iter::empty());
    let writer = MapWriter {
        settings: &settings,
        session,
        drawn: None,
        sonars: None,
        turn_upright: true,
        picture_side: None,
        names: &names,
    };
    let mut made = Vec::with_capacity(maps.len());
    for (number, (map, way)) in maps.iter().zip(&ways).enumerate() {
        made.push(writer.write(&mut output, (number, map), way)?);
    }
    remove_outdated_maps(&mut output, made.len());
    log.add(entries_of_left_out(&made))?;
    log.finish()?;
    commit(output)
}

/// The same of a session in space, whose smallest voxels have sides of `resolution_m`.
///
/// # Errors
/// A file that cannot be written.
pub fn save_space(session: &Session<SpaceSweep>, resolution_m: f64, folder: &Path) -> Result<(), CommandError> {
    let mut output = OutputFolder::create(folder)?;
    write_session(&mut output, session, resolution_m)?;
    commit(output)
}

/// Of an earlier run in the folder nothing stays.
fn commit(mut output: OutputFolder) -> Result<(), CommandError> {
    for name in OF_RUNS {
        output.remove_outdated(name.to_owned());
    }
    remove_outdated_exports(&mut output);
    output.commit()?;
    Ok(())
}
