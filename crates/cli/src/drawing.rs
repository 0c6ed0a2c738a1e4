//! Maps of keyframes at any poses, and their pictures.

use crate::failure::Failure;
use crate::image::{MapImage, map_image};
use crate::output::OutputFolder;
use mapwright::{CountGrid, GlobalMap, KeyframeId, Pose2, SeparateMap, Session, Settings, Sweep};
use mapwright_formats::{Frame, Picture, wall_direction, write_png};
use std::sync::Arc;

/// Walls that are turned by less are level, for directions are found to a tenth of a degree: cells stay crisp.
const LEVEL_RAD: f64 = 0.15 * std::f64::consts::PI / 180.0;

/// What a picture shows of sweeps at these poses; those that are none are left out.
pub(crate) fn draw(settings: &Settings, drawn: &[Option<Arc<Sweep>>], map_from_keyframe: &[Pose2]) -> CountGrid {
    let mut map = GlobalMap::without_normals(settings);
    map.export_at(drawn, map_from_keyframe, 2);
    map.into_counts()
}

/// What a picture shows of one of a session's maps.
pub(crate) fn draw_map(settings: &Settings, session: &Session, map: &SeparateMap) -> CountGrid {
    let own = |(place, drawn): (usize, &Option<Arc<Sweep>>)| drawn.clone().filter(|_| map.has(place));
    let drawn: Vec<_> = session.drawn().iter().enumerate().map(own).collect();
    draw(settings, &drawn, session.map_from_keyframe())
}

/// The same, and the keyframes that it leaves out because they contradict the others.
pub(crate) fn draw_believed(settings: &Settings, session: &Session, map: &SeparateMap) -> (CountGrid, Vec<KeyframeId>) {
    let mut counts = GlobalMap::without_normals(settings);
    let left_out = counts.export_believed_of(session, map, 2);
    (counts.into_counts(), left_out)
}

/// The same map before and after, in one frame, both turned so that the walls of the latter are upright.
pub(crate) fn write_before_and_after(
    output: &mut OutputFolder,
    (settings, session): (&Settings, &Session),
    [before, after]: [&[Pose2]; 2],
    side_px: Option<u16>,
) -> Result<(), Failure> {
    let drawn = |poses| map_image(&draw(settings, session.drawn(), poses), settings.map.passes_per_hit);
    let [drawn_before, drawn_after]: [MapImage; 2] = [drawn(before), drawn(after)];
    let level_rad = wall_angle(&drawn_after).unwrap_or(0.0);
    let side_px = side_px.map(usize::from);
    let pictures = [(&drawn_before, before), (&drawn_after, after)];
    let pictures = pictures.map(|(drawn, way)| (drawn, picture(drawn, way, level_rad)));
    let [frame_before, frame_after] = pictures.map(|(drawn, picture)| Frame::of(&drawn.image, &picture));
    let frame = Some(frame_before.and(frame_after));
    for (name, (drawn, picture)) in ["before.png", "after.png"].into_iter().zip(pictures) {
        let picture = Picture { frame, side_px, ..picture };
        output.write(name, |writer| write_png(&drawn.image, &picture, writer))?;
    }
    Ok(())
}

fn picture<'a>(drawn: &'a MapImage, way: &'a [Pose2], level_rad: f64) -> Picture<'a> {
    Picture { world_from_robot: way, seen: Some(&drawn.seen), level_rad, ..Picture::default() }
}

/// The direction of a map's walls in its own frame, radians, where they have one; zero where they are level as well as can be found.
pub(crate) fn wall_angle(drawn: &MapImage) -> Option<f64> {
    let angle_rad = wall_direction(&drawn.image.wall_points_map(), drawn.image.resolution_m)?;
    Some(if angle_rad.abs() < LEVEL_RAD { 0.0 } else { angle_rad })
}
