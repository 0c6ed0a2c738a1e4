//! Maps of keyframes at any poses, and their pictures.

use crate::failure::Failure;
use crate::image::{map_image, without_outliers};
use crate::output::OutputFolder;
use mapwright::{CountGrid, GlobalMap, KeyframeId, Pose2, SeparateMap, Session, Settings, Sweep};
use mapwright_formats::{Frame, GridImage, Picture, dominant_wall_angle, write_png};
use std::sync::Arc;

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
    let image = |poses| map_image(&draw(settings, session.drawn(), poses), settings.map.passes_per_hit).image;
    let whole: GridImage = image(after);
    let level_rad = dominant_wall_angle(&whole.wall_points_map(), whole.resolution_m);
    let (image_before, image_after) = (without_outliers(&image(before), before), without_outliers(&whole, after));
    let frame = Frame::of(&image_before, before, level_rad).and(Frame::of(&image_after, after, level_rad));
    for (name, image, way) in [("before.png", image_before, before), ("after.png", image_after, after)] {
        let side_px = side_px.map(usize::from);
        let picture = Picture { world_from_robot: way, level_rad, frame: Some(frame), side_px, ..Picture::default() };
        output.write(name, |writer| write_png(&image, &picture, writer))?;
    }
    Ok(())
}
