//! `mapwright export`

mod mesh;
mod space;

use crate::args::{ExportArgs, ExportTo};
use crate::failure::{Failure, Outcome};
use crate::image::MapImage;
use crate::output::write_whole;
use crate::report::remarks;
use crate::session::{AnySession, map_of, read_any_session};
use crate::space::MESH_FILE;
use crate::stamps::Stamper;
use crate::terminal::{count, say, say_json};
use clap::ValueEnum;
use mapwright::{Session, Stamp, TrajectoryPose};
use mapwright_exports::write_session_mcap;
use mapwright_formats::{
    CsvPose, FormatError, GridImage, TumWriter, write_csv, write_kitti, write_map_yaml, write_pgm, write_plain_png,
    write_stamps, write_world_file,
};
use serde_json::json;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

pub(super) fn run(args: &ExportArgs) -> Result<Outcome, Failure> {
    let (session, lost) = read_any_session(&args.results)?;
    let path = args.output.clone().unwrap_or_else(|| beside(&args.results, default_name(args.to)));
    let made = match session {
        AnySession::Plane(session) => of_plane(args, &session, &path)?,
        AnySession::Space(session) => space::export(args, &session, &path)?,
    };
    let losses = [lost, made.losses].concat();
    if args.json {
        let files: Vec<_> = made.files.iter().map(|file| file.display().to_string()).collect();
        say_json(&json!({ "files": files, "made": made.what, "losses": losses }))?;
    } else {
        let files: Vec<_> = made.files.iter().map(|file| file.display().to_string()).collect();
        let lines = made.notes.iter().map(|note| format!("{note}\n")).collect::<String>();
        say(&(lines + &format!("{}: {}\n", files.join(" and "), made.what) + &remarks(&losses, &[])))?;
    }
    Ok(Outcome::of_losses(&losses))
}

/// What was written.
struct Exported {
    files: Vec<PathBuf>,
    /// What is in them, in words.
    what: String,
    /// What else is to be said.
    notes: Vec<String>,
    losses: Vec<String>,
}

impl Exported {
    fn of(path: &Path, what: String) -> Self {
        Self { files: vec![path.to_owned()], what, notes: Vec::new(), losses: Vec::new() }
    }
}

fn of_plane(args: &ExportArgs, session: &Session, path: &Path) -> Result<Exported, Failure> {
    let of_other_kind = |what: &str| refused(args, &format!("{what} needs a session of space, found one of the plane"));
    let asked =
        [(args.band.is_some(), "--band"), (args.resolution.is_some(), "--resolution"), (args.surfels, "--surfels")];
    if let Some((_, option)) = asked.iter().find(|(is_asked, _)| *is_asked) {
        return Err(of_other_kind(option));
    }
    if args.threads.is_some() {
        return Err(Failure::Usage(format!("--threads is for --to mesh, found --to {}", word(args.to))));
    }
    let has_map = matches!(args.to, ExportTo::Mcap | ExportTo::Pgm | ExportTo::Worldfile);
    if args.map.is_some() && !has_map {
        return Err(Failure::Usage(format!("--map is for --to pgm, worldfile and mcap, found --to {}", word(args.to))));
    }
    match args.to {
        ExportTo::Tum | ExportTo::Kitti | ExportTo::Csv => trajectory(args, session, path),
        ExportTo::Mcap => mcap(args, session, path),
        ExportTo::Pgm | ExportTo::Worldfile => map(args, session, path),
        ExportTo::Ply | ExportTo::Pcd | ExportTo::Octomap | ExportTo::Mesh => {
            Err(of_other_kind(&format!("--to {}", word(args.to))))
        }
    }
}

/// Why it cannot be done with this session.
fn refused(args: &ExportArgs, cause: &str) -> Failure {
    Failure::Session { path: args.results.clone(), cause: cause.to_owned() }
}

/// As it is typed.
fn word(to: ExportTo) -> String {
    to.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
}

fn default_name(to: ExportTo) -> &'static str {
    match to {
        ExportTo::Tum => "export.tum",
        ExportTo::Kitti => "export.kitti",
        ExportTo::Csv => "export.csv",
        ExportTo::Mcap => "export.mcap",
        ExportTo::Pgm => "export.pgm",
        ExportTo::Worldfile => "map_plain.png",
        ExportTo::Ply => "export.ply",
        ExportTo::Pcd => "export.pcd",
        ExportTo::Octomap => "export.bt",
        ExportTo::Mesh => MESH_FILE,
    }
}

/// In the folder of results.
fn beside(results: &Path, name: &str) -> PathBuf {
    if results.is_dir() { results.join(name) } else { results.with_file_name(name) }
}

fn trajectory(args: &ExportArgs, session: &Session, path: &Path) -> Result<Exported, Failure> {
    let mut stamper = Stamper::new(args.stamps());
    let scans: Vec<_> =
        session.trajectory().map(|scan| TrajectoryPose { stamp: stamper.next(scan.stamp), ..scan }).collect();
    let mut made = Exported::of(path, count(scans.len() as u64, "pose"));
    write_part(path, |file| match args.to {
        ExportTo::Kitti => write_kitti(scans.iter().map(|scan| scan.map_from_robot), file),
        ExportTo::Csv => write_csv(scans.iter().map(csv_pose), file),
        _ => write_tum(&scans, file),
    })?;
    if args.to == ExportTo::Kitti {
        made.files.push(write_times(path, scans.iter().map(|scan| scan.stamp))?);
    }
    Ok(made)
}

/// The stamps of KITTI's poses, in a file beside them.
fn write_times(path: &Path, stamps: impl Iterator<Item = Stamp>) -> Result<PathBuf, Failure> {
    let times = path.with_extension("times");
    if times == path {
        return Err(Failure::write(
            path,
            std::io::Error::other("expected another ending: .times is that of the stamps"),
        ));
    }
    write_part(&times, |file| write_stamps(stamps, file))?;
    Ok(times)
}

fn csv_pose(scan: &TrajectoryPose) -> CsvPose {
    CsvPose { stamp: scan.stamp, map_from_robot: scan.map_from_robot, odom_from_robot: scan.odom_from_robot }
}

fn write_tum(scans: &[TrajectoryPose], file: impl Write) -> Result<(), FormatError> {
    let mut writer = TumWriter::new(file);
    scans.iter().try_for_each(|scan| writer.write_planar(scan.stamp, scan.map_from_robot))?;
    writer.finish().map(|_| ())
}

fn mcap(args: &ExportArgs, session: &Session, path: &Path) -> Result<Exported, Failure> {
    let (made, further) = wanted_map(args, session)?;
    let mut stamper = Stamper::new(args.stamps());
    let counts = write_whole(path, |file| {
        let written = write_session_mcap(session, &made.image, |stamp| stamper.next(stamp), file);
        written.map(|(_, counts)| counts).map_err(|cause| Failure::write_in_words(path, &cause))
    })?;
    let what = format!(
        "map of {} x {} cells, {}, {}, {}",
        made.image.width,
        made.image.height,
        count(counts.poses as u64, "pose"),
        count(counts.scans as u64, "scan"),
        count(counts.closures as u64, "closure"),
    );
    Ok(Exported { losses: [losses(&made), further].concat(), ..Exported::of(path, what) })
}

/// The map that is asked for, otherwise the first; then it is told in words that there are more.
fn wanted_map(args: &ExportArgs, session: &Session) -> Result<(MapImage, Vec<String>), Failure> {
    let maps = session.maps();
    let number = args.map.map_or(1, NonZeroUsize::get);
    let Some(map) = maps.get(number - 1) else {
        let found = count(maps.len() as u64, "map");
        return Err(Failure::Usage(format!("{}: expected map {number}, found {found}", args.results.display())));
    };
    let further = (args.map.is_none() && maps.len() > 1).then(|| {
        let further = count(maps.len() as u64 - 1, "further map");
        format!("{further} of pieces that nothing holds to the first: --map 2 and so on exports them")
    });
    Ok((map_of(session, map, &args.results)?, further.into_iter().collect()))
}

/// The map and what says where it lies, beside it.
fn map(args: &ExportArgs, session: &Session, path: &Path) -> Result<Exported, Failure> {
    let (made, further) = wanted_map(args, session)?;
    Ok(Exported { losses: [losses(&made), further].concat(), ..write_map(args.to, &made.image, path)? })
}

fn write_map(to: ExportTo, image: &GridImage, path: &Path) -> Result<Exported, Failure> {
    let is_pgm = to == ExportTo::Pgm;
    let second = path.with_extension(if is_pgm { "yaml" } else { "pgw" });
    if second == path {
        return Err(Failure::write(path, std::io::Error::other("expected an image's name, such as map.png")));
    }
    let name = path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    write_part(path, |file| if is_pgm { write_pgm(image, file) } else { write_plain_png(image, file) })?;
    write_part(
        &second,
        |file| if is_pgm { write_map_yaml(image, &name, file) } else { write_world_file(image, file) },
    )?;
    let mut made = Exported::of(path, format!("{} x {} cells", image.width, image.height));
    made.files.push(second);
    Ok(made)
}

fn write_part(path: &Path, write: impl FnOnce(&mut BufWriter<File>) -> Result<(), FormatError>) -> Result<(), Failure> {
    write_whole(path, |file| write(file).map_err(|cause| Failure::write(path, cause)))
}

fn losses(made: &MapImage) -> Vec<String> {
    let left_out = (made.cells_left_out > 0).then(|| count(made.cells_left_out, "known cell"));
    left_out.map(|cells| format!("{cells} lie too far out for a map's file")).into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whatever_has_a_name_of_its_own_goes_with_the_results_that_it_was_made_of() {
        for to in ExportTo::value_variants() {
            assert!(crate::maps::EXPORTS.contains(&default_name(*to)), "{}", word(*to));
        }
    }
}
