//! Surfaces of sessions of space as triangles.

use super::{Exported, refused};
use crate::args::ExportArgs;
use crate::failure::Failure;
use crate::output::write_whole;
use crate::session::settings_of;
use crate::space::MAP_SHARE;
use crate::terminal::{count, grouped};
use mapwright::{SeparateMap, Session, SpaceMapper, SpaceSweep, SurfaceMap, surface_settings, usual_range_m, white_of};
use mapwright_surface::{Mesh, MeshSettings, PointCounts, SurfaceError, SurfaceSettings, write_glb, write_ply};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

/// Side of voxels, of how far apart the points lie that a keyframe keeps: those of several keyframes lie between each other.
const VOXEL_SHARE: f64 = 1.0;
/// How far apart those lie where the session does not say, metres.
const POINTS_APART_M: f64 = 0.1;
/// Pieces of surface smaller than so many voxels are left out: single points and noise.
const PIECE_VOXELS: f64 = 8.0;

/// How it is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Format {
    Glb,
    Ply,
}

impl Format {
    fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "glb" => Some(Self::Glb),
            "ply" => Some(Self::Ply),
            _ => None,
        }
    }
}

pub(super) fn export(args: &ExportArgs, session: &Session<SpaceSweep>, path: &Path) -> Result<Exported, Failure> {
    let Some(format) = Format::of(path) else {
        return Err(Failure::Usage(format!("{}: expected a name that ends in .glb or .ply", path.display())));
    };
    let settings = settings_for(args, session)?;
    let white = white_of(session);
    let mut made = Exported { files: Vec::new(), ..Exported::of(path, String::new()) };
    let mut whats = Vec::new();
    for (number, map) in wanted_maps(args, session)? {
        let surface = drawn(args, session, (&map, settings, white))?;
        let voxel_m = settings.voxel_m;
        let mesh = surface.mesh(&MeshSettings {
            least_piece_m: PIECE_VOXELS * voxel_m,
            threads: threads(args),
            ..MeshSettings::default()
        });
        let path = if args.map.is_some() { path.to_owned() } else { of_map(path, number) };
        write_whole(&path, |file| {
            let written = match format {
                Format::Glb => write_glb(file, &mesh),
                Format::Ply => write_ply(file, &mesh),
            };
            written.map_err(|cause| Failure::write_in_words(&path, &cause))
        })?;
        whats.push(in_words(&mesh, session, white));
        made.losses.extend(left_out(&surface));
        made.files.push(path);
    }
    made.what = format!("{}; voxels of {} m", whats.join("; "), three_digits(settings.voxel_m));
    Ok(made)
}

fn threads(args: &ExportArgs) -> usize {
    args.threads.map_or(1, |threads| threads as usize)
}

/// By the sensor's noise, and by how far apart points lie where no side is asked for.
fn settings_for(args: &ExportArgs, session: &Session<SpaceSweep>) -> Result<SurfaceSettings, Failure> {
    let Some(first) = session.keyframes().first() else {
        return Err(refused(args, "--to mesh needs keyframes, found none"));
    };
    let voxel_m = match args.resolution {
        Some(voxel_m) => voxel_m,
        None => {
            let settings = settings_of(session, &args.results)?;
            let resolution_m = SpaceMapper::resume(settings, session.clone())?.resolution_m();
            VOXEL_SHARE * resolution_m.map_or(POINTS_APART_M, |side_m| MAP_SHARE * side_m)
        }
    };
    Ok(surface_settings(&first.sweep.sensor, usual_range_m(session), voxel_m))
}

/// The maps that are asked for, and their numbers from zero on.
fn wanted_maps(args: &ExportArgs, session: &Session<SpaceSweep>) -> Result<Vec<(usize, SeparateMap)>, Failure> {
    let maps = session.maps();
    let Some(asked) = args.map.map(NonZeroUsize::get) else { return Ok(maps.into_iter().enumerate().collect()) };
    let found = count(maps.len() as u64, "map");
    let map = maps.into_iter().nth(asked - 1);
    let map =
        map.ok_or_else(|| Failure::Usage(format!("{}: expected map {asked}, found {found}", args.results.display())))?;
    Ok(vec![(asked - 1, map)])
}

fn drawn(
    args: &ExportArgs,
    session: &Session<SpaceSweep>,
    (map, settings, white): (&SeparateMap, SurfaceSettings, Option<f32>),
) -> Result<SurfaceMap, Failure> {
    let failed = |cause: SurfaceError| match cause {
        SurfaceError::Memory { needed_mb, limit_mb, voxel_m, fits_m } => refused(
            args,
            &format!(
                "voxels of {} m need more than {} MB for this map ({} MB are allowed): --resolution {fits_m:.3} would fit",
                three_digits(voxel_m),
                needed_mb.min(limit_mb),
                limit_mb
            ),
        ),
        other => refused(args, &other.to_string()),
    };
    let mut surface = SurfaceMap::new(settings, white).map_err(failed)?;
    surface.export_map(session, map, threads(args)).map_err(failed)?;
    Ok(surface)
}

/// What could not be drawn, in words.
fn left_out(surface: &SurfaceMap) -> Vec<String> {
    let PointCounts { not_finite, far, .. } = *surface.counts();
    let counts = [
        (not_finite + far, "point", "too far from its keyframe for voxels of this side"),
        (surface.surface().outside(), "piece of surface", "beyond half a million voxels from the map's origin"),
    ];
    let lost = counts.into_iter().filter(|(lost, ..)| *lost > 0);
    lost.map(|(lost, what, why)| format!("left out {}: {why}", count(lost as u64, what))).collect()
}

/// The first map's file, and `-2` and so on before the ending of the others'.
fn of_map(path: &Path, number: usize) -> PathBuf {
    if number == 0 {
        return path.to_owned();
    }
    let part = |part: Option<&std::ffi::OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
    path.with_file_name(format!("{}-{}.{}", part(path.file_stem()), number + 1, part(path.extension())))
}

fn in_words(mesh: &Mesh, session: &Session<SpaceSweep>, white: Option<f32>) -> String {
    let is_coloured = session.drawn().iter().flatten().any(|sweep| !sweep.colours.is_empty());
    let with = match (is_coloured, white) {
        _ if mesh.colours.is_empty() => "",
        (true, _) => " with colours",
        (false, _) => " with intensities in grey",
    };
    format!(
        "{} of {} vertices{with}",
        count(mesh.triangles.len() as u64, "triangle"),
        grouped(mesh.positions_m.len() as u64)
    )
}

fn three_digits(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}
