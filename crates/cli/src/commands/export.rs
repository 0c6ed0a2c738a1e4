//! `mapwright export`

mod space;

use crate::args::{ExportArgs, ExportTo};
use crate::failure::{Failure, Outcome};
use crate::image::MapImage;
use crate::output::write_whole;
use crate::session::{AnySession, map_of, read_any_session};
use crate::terminal::{count, say};
use clap::ValueEnum;
use mapwright::{Session, TrajectoryPose};
use mapwright_exports::write_session_mcap;
use mapwright_formats::{
    CsvPose, FormatError, GridImage, TumWriter, write_csv, write_kitti, write_map_yaml, write_pgm, write_plain_png,
    write_world_file,
};
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
    let losses = [lost, made].concat();
    say(&losses.iter().map(|loss| format!("lost     {loss}\n")).collect::<String>())?;
    Ok(Outcome::of_losses(&losses))
}

fn of_plane(args: &ExportArgs, session: &Session, path: &Path) -> Result<Vec<String>, Failure> {
    let refused = |what: &str| Failure::Session {
        path: args.results.clone(),
        cause: format!("{what} needs a session of space, found one of the plane"),
    };
    let asked =
        [(args.band.is_some(), "--band"), (args.resolution.is_some(), "--resolution"), (args.surfels, "--surfels")];
    if let Some((_, option)) = asked.iter().find(|(is_asked, _)| *is_asked) {
        return Err(refused(option));
    }
    let has_map = matches!(args.to, ExportTo::Mcap | ExportTo::Pgm | ExportTo::Worldfile);
    if args.map.is_some() && !has_map {
        return Err(Failure::Usage(format!("--map is for --to pgm, worldfile and mcap, found --to {}", word(args.to))));
    }
    match args.to {
        ExportTo::Tum | ExportTo::Kitti | ExportTo::Csv => trajectory(args.to, session, path),
        ExportTo::Mcap => mcap(args, session, path),
        ExportTo::Pgm | ExportTo::Worldfile => map(args, session, path),
        ExportTo::Ply | ExportTo::Pcd | ExportTo::Octomap => Err(refused(&format!("--to {}", word(args.to)))),
    }
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
    }
}

/// In the folder of results.
fn beside(results: &Path, name: &str) -> PathBuf {
    if results.is_dir() { results.join(name) } else { results.with_file_name(name) }
}

fn trajectory(to: ExportTo, session: &Session, path: &Path) -> Result<Vec<String>, Failure> {
    let scans = session.trajectory();
    write_whole(path, |file| {
        let written = match to {
            ExportTo::Kitti => write_kitti(scans.map(|scan| scan.map_from_robot), file),
            ExportTo::Csv => write_csv(scans.map(csv_pose), file),
            _ => write_tum(session, file),
        };
        written.map_err(|cause| Failure::write(path, cause))
    })?;
    say(&format!("{}: {}\n", path.display(), count(session.scans().len() as u64, "pose")))?;
    Ok(Vec::new())
}

fn csv_pose(scan: TrajectoryPose) -> CsvPose {
    CsvPose { stamp: scan.stamp, map_from_robot: scan.map_from_robot, odom_from_robot: scan.odom_from_robot }
}

fn write_tum(session: &Session, file: impl Write) -> Result<(), FormatError> {
    let mut writer = TumWriter::new(file);
    session.trajectory().try_for_each(|scan| writer.write_planar(scan.stamp, scan.map_from_robot))?;
    writer.finish().map(|_| ())
}

fn mcap(args: &ExportArgs, session: &Session, path: &Path) -> Result<Vec<String>, Failure> {
    let (made, further) = wanted_map(args, session)?;
    let counts = write_whole(path, |file| {
        let written = write_session_mcap(session, &made.image, file);
        written.map(|(_, counts)| counts).map_err(|cause| Failure::write_in_words(path, &cause))
    })?;
    say(&format!(
        "{}: map of {} x {} cells, {}, {}, {}\n",
        path.display(),
        made.image.width,
        made.image.height,
        count(counts.poses as u64, "pose"),
        count(counts.scans as u64, "scan"),
        count(counts.closures as u64, "closure"),
    ))?;
    Ok([losses(&made), further].concat())
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
fn map(args: &ExportArgs, session: &Session, path: &Path) -> Result<Vec<String>, Failure> {
    let (made, further) = wanted_map(args, session)?;
    write_map(args.to, &made.image, path)?;
    Ok([losses(&made), further].concat())
}

fn write_map(to: ExportTo, image: &GridImage, path: &Path) -> Result<(), Failure> {
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
    let (width, height) = (image.width, image.height);
    say(&format!("{} and {}: {width} x {height} cells\n", path.display(), second.display()))
}

fn write_part(path: &Path, write: impl FnOnce(&mut BufWriter<File>) -> Result<(), FormatError>) -> Result<(), Failure> {
    write_whole(path, |file| write(file).map_err(|cause| Failure::write(path, cause)))
}

fn losses(made: &MapImage) -> Vec<String> {
    let left_out = (made.cells_left_out > 0).then(|| count(made.cells_left_out, "known cell"));
    left_out.map(|cells| format!("{cells} lie too far out for a map's file")).into_iter().collect()
}
