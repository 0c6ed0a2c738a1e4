//! Sessions of space: trajectories, clouds, octrees and floor plans.

use super::{Exported, mesh, refused, word, write_map, write_part, write_times};
use crate::args::{ExportArgs, ExportTo};
use crate::failure::Failure;
use crate::floor::{RESOLUTION_M, floor_image};
use crate::output::write_whole;
use crate::stamps::Stamper;
use crate::terminal::{count, grouped};
use mapwright::{MapSurfel, Pose3, Session, SpaceSweep, TrajectoryPose, occupancy_of, points_of, surfels_of};
use mapwright_exports::{SpacePoints, write_space_session_mcap};
use mapwright_formats::{
    CsvPose, Disc, FormatError, StampedPose3, TumWriter, write_pcd, write_ply, write_ply_discs, write_space_csv,
    write_space_kitti,
};
use mapwright_logs::SliceBounds;
use mapwright_voxel::{Occupancy, OccupancySettings, Octree, write_bt};
use std::io::Write;
use std::path::Path;

/// Heights of obstacles above the robot's origin unless said, metres: those that a sensor sees without looking up or down far.
const BAND: SliceBounds = SliceBounds { z_min_m: -0.3, z_max_m: 0.3 };

/// Writes it.
pub(super) fn export(args: &ExportArgs, session: &Session<SpaceSweep>, path: &Path) -> Result<Exported, Failure> {
    if args.map.is_some() && args.to != ExportTo::Mesh {
        return Err(refused(args, "--map needs a session of the plane or --to mesh, found one of space"));
    }
    if args.threads.is_some() && args.to != ExportTo::Mesh {
        return Err(refused(args, "--threads is for --to mesh alone"));
    }
    if args.band.is_some() && args.to != ExportTo::Pgm {
        return Err(refused(args, "--band is for --to pgm alone"));
    }
    if args.surfels && args.to != ExportTo::Ply {
        return Err(refused(args, "--surfels is for --to ply alone"));
    }
    match args.to {
        ExportTo::Tum | ExportTo::Kitti | ExportTo::Csv => trajectory(args, session, path),
        ExportTo::Ply if args.surfels => surfels(args, session, path),
        ExportTo::Ply | ExportTo::Pcd => cloud(args, session, path),
        ExportTo::Mcap => mcap(args, session, path),
        ExportTo::Octomap => octree(&occupancy(args, session), path),
        ExportTo::Pgm => floor_plan(args, session, path),
        ExportTo::Mesh => mesh::export(args, session, path),
        ExportTo::Worldfile => Err(refused(
            args,
            &format!(
                "--to {} needs a session of the plane, found one of space: tum, kitti, csv, ply, pcd, mcap, octomap, pgm or mesh",
                word(args.to)
            ),
        )),
    }
}

fn trajectory(args: &ExportArgs, session: &Session<SpaceSweep>, path: &Path) -> Result<Exported, Failure> {
    if args.resolution.is_some() {
        return Err(refused(args, "--resolution is for maps, found a trajectory"));
    }
    let mut stamper = Stamper::new(args.stamps());
    let clouds: Vec<_> =
        session.trajectory().map(|cloud| TrajectoryPose { stamp: stamper.next(cloud.stamp), ..cloud }).collect();
    write_part(path, |file| match args.to {
        ExportTo::Kitti => write_space_kitti(clouds.iter().map(|cloud| cloud.map_from_robot), file),
        ExportTo::Csv => write_space_csv(clouds.iter().map(csv_pose), file),
        _ => write_tum(&clouds, file),
    })?;
    let mut made = made_of(path, clouds.len(), "pose", "");
    if args.to == ExportTo::Kitti {
        made.files.push(write_times(path, clouds.iter().map(|cloud| cloud.stamp))?);
    }
    Ok(made)
}

fn csv_pose(cloud: &TrajectoryPose<Pose3>) -> CsvPose<Pose3> {
    CsvPose { stamp: cloud.stamp, map_from_robot: cloud.map_from_robot, odom_from_robot: cloud.odom_from_robot }
}

fn write_tum(clouds: &[TrajectoryPose<Pose3>], file: impl Write) -> Result<(), FormatError> {
    let mut writer = TumWriter::new(file);
    clouds.iter().try_for_each(|cloud| writer.write(&StampedPose3::of_pose(cloud.stamp, cloud.map_from_robot)))?;
    writer.finish().map(|_| ())
}

fn resolution_m(args: &ExportArgs) -> f64 {
    args.resolution.unwrap_or(RESOLUTION_M)
}

fn occupancy(args: &ExportArgs, session: &Session<SpaceSweep>) -> Occupancy {
    occupancy_of(session, OccupancySettings { resolution_m: resolution_m(args), ..OccupancySettings::default() })
}

fn cloud(args: &ExportArgs, session: &Session<SpaceSweep>, path: &Path) -> Result<Exported, Failure> {
    let map = points_of(session, resolution_m(args));
    write_part(path, |file| match args.to {
        ExportTo::Pcd => write_pcd(&map.points_m, &map.colours, &map.intensities, file),
        _ => write_ply(&map.points_m, &map.colours, &map.intensities, file),
    })?;
    let words = match (map.colours.is_empty(), map.intensities.is_empty()) {
        (true, true) => "",
        (false, true) => " with colours",
        (true, false) => " with intensities",
        (false, false) => " with colours and intensities",
    };
    Ok(made_of(path, map.points_m.len(), "point", words))
}

fn surfels(args: &ExportArgs, session: &Session<SpaceSweep>, path: &Path) -> Result<Exported, Failure> {
    let map = surfels_of(session, resolution_m(args));
    let disc = |surfel: &MapSurfel| Disc { point_m: surfel.mean_m, normal: surfel.normal, radius_m: surfel.radius_m };
    let discs: Vec<Disc> = map.surfels.iter().map(disc).collect();
    write_part(path, |file| write_ply_discs(&discs, &map.colours, file))?;
    let mut made = made_of(path, discs.len(), "surfel", if map.colours.is_empty() { "" } else { " with colours" });
    if map.lines > 0 {
        made.notes.push(format!("left out {} of which the points lie on a line", count(map.lines as u64, "voxel")));
    }
    Ok(made)
}

fn mcap(args: &ExportArgs, session: &Session<SpaceSweep>, path: &Path) -> Result<Exported, Failure> {
    let map = points_of(session, resolution_m(args));
    let mut stamper = Stamper::new(args.stamps());
    let counts = write_whole(path, |file| {
        let points = SpacePoints { points_m: &map.points_m, colours: &map.colours, intensities: &map.intensities };
        let written = write_space_session_mcap(session, points, |stamp| stamper.next(stamp), file);
        written.map(|(_, counts)| counts).map_err(|cause| Failure::write_in_words(path, &cause))
    })?;
    let what = format!(
        "map of {}, {}, {}",
        count(counts.points as u64, "point"),
        count(counts.poses as u64, "pose"),
        count(counts.closures as u64, "closure"),
    );
    Ok(Exported::of(path, what))
}

fn made_of(path: &Path, made: usize, what: &str, with: &str) -> Exported {
    Exported::of(path, format!("{}{with}", count(made as u64, what)))
}

fn octree(occupancy: &Occupancy, path: &Path) -> Result<Exported, Failure> {
    let written =
        write_whole(path, |file| write_bt(occupancy, file).map_err(|cause| Failure::write_in_words(path, &cause)))?;
    let (side_m, occupied) = (occupancy.resolution_m(), grouped(written.occupied as u64));
    let what = format!("voxels of {side_m} m, {occupied} of the leaves occupied");
    let left_out = Some(Octree::left_out(occupancy)).filter(|&voxels| voxels > 0);
    let lost = left_out.map(|voxels| format!("{} lie too far out for an octree", count(voxels, "known voxel")));
    Ok(Exported { losses: lost.into_iter().collect(), ..Exported::of(path, what) })
}

fn floor_plan(args: &ExportArgs, session: &Session<SpaceSweep>, path: &Path) -> Result<Exported, Failure> {
    let image = floor_image(&occupancy(args, session), session, args.band.unwrap_or(BAND));
    let image = image.map_err(|words| refused(args, &words))?;
    write_map(args.to, &image, path)
}
