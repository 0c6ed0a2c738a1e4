//! Surfaces of sessions of space as triangles: what `map --mesh` and `export --to mesh` write.

use super::MAP_SHARE;
use crate::failure::Failure;
use crate::output::OutputFolder;
use crate::terminal::count;
use mapwright::{SeparateMap, Session, SpaceSweep, SurfaceMap, surface_settings, usual_range_m, white_of};
use mapwright_surface::{Mesh, MeshSettings, PointCounts, SurfaceError, SurfaceSettings, write_glb};
use std::path::{Path, PathBuf};

/// The first map's mesh where no other name is given.
pub(crate) const MESH_FILE: &str = "mesh.glb";
/// How far apart the points lie that a keyframe keeps, where the session does not say, metres.
const POINTS_APART_M: f64 = 0.1;
/// Pieces of surface smaller than so many voxels are left out: single points and noise.
const PIECE_VOXELS: f64 = 8.0;

/// Side of voxels where none is asked for, metres: as far apart as the points lie that a keyframe keeps, those of several lie between each other.
pub(crate) fn usual_voxel_m(resolution_m: Option<f64>) -> f64 {
    resolution_m.map_or(POINTS_APART_M, |side_m| MAP_SHARE * side_m)
}

/// How the maps of a session become meshes.
pub(crate) struct Meshing<'a> {
    session: &'a Session<SpaceSweep>,
    settings: SurfaceSettings,
    white: Option<f32>,
    threads: usize,
}

impl<'a> Meshing<'a> {
    /// By the sensor's noise; none of a session without keyframes.
    pub(crate) fn of(session: &'a Session<SpaceSweep>, voxel_m: f64, threads: usize) -> Option<Self> {
        let sensor = &session.keyframes().first()?.sweep.sensor;
        let settings = surface_settings(sensor, usual_range_m(session), voxel_m);
        Some(Self { session, settings, white: white_of(session), threads })
    }

    pub(crate) fn voxel_m(&self) -> f64 {
        self.settings.voxel_m
    }

    /// The mesh of one map, and in words what is left out of it; or why there is none.
    pub(crate) fn mesh(&self, map: &SeparateMap) -> Result<(Mesh, Vec<String>), String> {
        let mut surface = SurfaceMap::new(self.settings, self.white).map_err(|cause| in_words(&cause))?;
        surface.export_map(self.session, map, self.threads).map_err(|cause| in_words(&cause))?;
        let mesh = surface.mesh(&MeshSettings {
            least_piece_m: PIECE_VOXELS * self.voxel_m(),
            threads: self.threads,
            ..MeshSettings::default()
        });
        Ok((mesh, left_out(&surface)))
    }
}

fn in_words(cause: &SurfaceError) -> String {
    match cause {
        SurfaceError::Memory { needed_mb, limit_mb, voxel_m, fits_m } => format!(
            "voxels of {} m need more than {} MB for this map ({} MB are allowed): --resolution {fits_m:.3} would fit",
            four_digits(*voxel_m),
            needed_mb.min(limit_mb),
            limit_mb
        ),
        other => other.to_string(),
    }
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
pub(crate) fn mesh_file(path: &Path, number: usize) -> PathBuf {
    if number == 0 {
        return path.to_owned();
    }
    let part = |part: Option<&std::ffi::OsStr>| part.unwrap_or_default().to_string_lossy().into_owned();
    path.with_file_name(format!("{}-{}.{}", part(path.file_stem()), number + 1, part(path.extension())))
}

pub(crate) fn four_digits(value: f64) -> f64 {
    (value * 1e4).round() / 1e4
}

/// The meshes of all maps into a folder of results, as `export --to mesh` makes them of it. What is missing, in words.
pub(super) fn write_meshes(
    output: &mut OutputFolder,
    session: &Session<SpaceSweep>,
    (voxel_m, threads): (f64, usize),
) -> Result<Vec<String>, Failure> {
    let Some(meshing) = Meshing::of(session, voxel_m, threads) else { return Ok(Vec::new()) };
    let mut missing = Vec::new();
    for (number, map) in session.maps().iter().enumerate() {
        let name = mesh_file(Path::new(MESH_FILE), number).display().to_string();
        let (mesh, left_out) = match meshing.mesh(map) {
            Ok(made) => made,
            Err(why) => {
                missing.push(format!("there is no {name}, which `mapwright export --to mesh` makes as well: {why}"));
                continue;
            }
        };
        let mut file = output.begin(name.clone())?;
        write_glb(&mut file, &mesh).map_err(|cause| {
            output.failed_to_write();
            Failure::write_in_words(&output.path(&name), &cause)
        })?;
        missing.extend(left_out.into_iter().map(|words| format!("{name}: {words}")));
    }
    Ok(missing)
}
