//! Surfaces of sessions of space as triangles.

use super::{Exported, refused};
use crate::args::ExportArgs;
use crate::failure::Failure;
use crate::output::write_whole;
use crate::session::settings_of;
use crate::space::{Meshing, four_digits, mesh_file, usual_voxel_m};
use crate::terminal::{count, grouped};
use mapwright::{SeparateMap, Session, SpaceMapper, SpaceSweep};
use mapwright_surface::{Mesh, write_glb, write_ply};
use std::num::NonZeroUsize;
use std::path::Path;

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
    let threads = args.threads.map_or(1, |threads| threads as usize);
    let meshing = Meshing::of(session, voxel_m(args, session)?, threads)
        .ok_or_else(|| refused(args, "--to mesh needs keyframes, found none"))?;
    let mut made = Exported { files: Vec::new(), ..Exported::of(path, String::new()) };
    let mut whats = Vec::new();
    for (number, map) in wanted_maps(args, session)? {
        let (mesh, left_out) = meshing.mesh(&map).map_err(|why| refused(args, &why))?;
        let path = if args.map.is_some() { path.to_owned() } else { mesh_file(path, number) };
        write_whole(&path, |file| {
            let written = match format {
                Format::Glb => write_glb(file, &mesh),
                Format::Ply => write_ply(file, &mesh),
            };
            written.map_err(|cause| Failure::write_in_words(&path, &cause))
        })?;
        whats.push(in_words(&mesh, session));
        made.losses.extend(left_out);
        made.files.push(path);
    }
    made.what = format!("{}; voxels of {} m", whats.join("; "), four_digits(meshing.voxel_m()));
    Ok(made)
}

/// By how far apart points lie where no side is asked for.
fn voxel_m(args: &ExportArgs, session: &Session<SpaceSweep>) -> Result<f64, Failure> {
    if let Some(voxel_m) = args.resolution {
        return Ok(voxel_m);
    }
    let settings = settings_of(session, &args.results)?;
    Ok(usual_voxel_m(SpaceMapper::resume(settings, session.clone())?.resolution_m()))
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

fn in_words(mesh: &Mesh, session: &Session<SpaceSweep>) -> String {
    let is_coloured = session.drawn().iter().flatten().any(|sweep| !sweep.colours.is_empty());
    let with = match (is_coloured, mesh.colours.is_empty()) {
        (_, true) => "",
        (true, _) => " with colours",
        (false, _) => " with intensities in grey",
    };
    format!(
        "{} of {} vertices{with}",
        count(mesh.triangles.len() as u64, "triangle"),
        grouped(mesh.positions_m.len() as u64)
    )
}
