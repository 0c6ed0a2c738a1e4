//! A picture of a map, with the way the robot went.

use super::GridImage;
use super::canvas::Canvas;
use super::confidence::{Tint, draw_place};
use super::footer::{Footer, Item};
use super::frame::{Frame, ViewPlacement};
use super::options::{LEGEND_PX, Picture, in_cells, pen_of, pen_scale};
use super::palette::{END, START, way_colour};
use super::raster::Shades;
use super::runs::{draw_runs, legible};
use super::view::View;
use crate::error::FormatError;
use std::io::Write;

impl Frame {
    /// What a picture shows by itself: the map's walls and the way with a rim, as far as something is known there. Walls are what several
    /// readings tell of and what hangs together; without any, all that is known is shown.
    #[must_use]
    pub fn of(map: &GridImage, picture: &Picture<'_>) -> Self {
        View::of(map, picture).frame(map)
    }
}

/// Writes a part of the map as a PNG: white free space, dark walls by probability and at least two pixels wide, grey-blue where nothing has
/// been seen and paler where little was, the way from dark blue to red, a green triangle at its start and a red square at its end. What they mean
/// stands below it, and by how much the picture is turned.
///
/// The same map gives the same bytes.
///
/// # Errors
///
/// As [`GridImage::validate`]; [`FormatError::Png`].
pub fn write_png(map: &GridImage, picture: &Picture<'_>, writer: impl Write) -> Result<(), FormatError> {
    map.validate()?;
    let mut view = View::of(map, picture);
    let way = picture.way_in_cells(map);
    let shades = Shades::of(map, picture.seen_of(map), view.shown);
    let tint = picture.confidence.as_ref().and_then(|confidence| Tint::of(map, confidence));
    let places = picture.confidence.map_or(&[][..], |confidence| confidence.places);
    let footer = view.choose_scale(picture, |view, size_px| {
        let [width_px, height_px] = size_px;
        let px_per_metre = view.px_per_cell / map.resolution_m;
        let legend = [
            (!way.is_empty()).then_some(Item::Way),
            (!places.is_empty()).then_some(Item::Places),
            tint.as_ref().map(|tint| Item::Uncertainty { full_m: tint.full_m }),
            shades.fades().then_some(Item::Seen),
            view.turned().then_some(Item::Turned { by_rad: -picture.level_rad }),
        ];
        let runs = picture.runs.iter().flat_map(|runs| {
            let run = runs.ways.iter().map(|way| Item::Run([way.number, way.label], legible(&way.name)));
            run.chain(runs.meetings.first().map(|(pair, _)| Item::Meeting(*pair)))
        });
        let legend = runs.chain(legend.into_iter().flatten()).filter(|_| width_px.max(height_px) >= LEGEND_PX);
        let items = std::iter::once(Item::ScaleBar { px_per_metre }).chain(legend);
        Footer::of(items.filter(|_| picture.scale_bar).collect(), width_px, pen_of(width_px.max(height_px)))
    });
    let mut canvas = view.paint(map, &shades, tint.as_ref());
    draw_way(&mut canvas, &view, &way);
    if let Some(runs) = &picture.runs {
        let pixel = |place| in_cells(map, std::iter::once(place)).first().map(|cell| view.pixel(*cell));
        let pen = pen_scale(&canvas);
        draw_runs(&mut canvas, runs, pen, pixel);
    }
    draw_places(&mut canvas, &view, map, places);
    footer.draw(&mut canvas);
    encode(&canvas, writer)
}

/// Where a picture of a map of the plane has what.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanePlacement {
    /// Width and height, pixels.
    pub size_px: [usize; 2],
    /// The picture's scale.
    pub px_per_metre: f64,
    /// Where it has the places of the world; the third coordinate says nothing.
    pub view: ViewPlacement,
}

/// Writes the same picture in grey with nothing drawn over the map, for who draws over it, and says where it has what.
///
/// # Errors
///
/// As [`write_png`].
pub fn write_bare_png(
    map: &GridImage,
    picture: &Picture<'_>,
    writer: impl Write,
) -> Result<PlanePlacement, FormatError> {
    map.validate()?;
    let mut view = View::of(map, picture);
    let shades = Shades::of(map, picture.seen_of(map), view.shown);
    view.choose_scale(picture, |_, [width_px, _]| Footer::of(Vec::new(), width_px, 1.0));
    let canvas = view.paint(map, &shades, None);
    let grey = |pixel: &[u8; 3]| {
        ((77 * u32::from(pixel[0]) + 150 * u32::from(pixel[1]) + 29 * u32::from(pixel[2])) >> 8) as u8
    };
    let pixels: Vec<u8> = canvas.pixels.iter().map(grey).collect();
    write_pixels(
        (canvas.width, canvas.height, &pixels),
        png::ColorType::Grayscale,
        png::Compression::Balanced,
        writer,
    )?;
    let map_from_world = map.world_from_map.inverse();
    let pixel = |place: [f64; 2]| view.exact_pixel(map_from_world.transform(place).map(|m| m / map.resolution_m));
    let (origin, along) = (pixel([0.0; 2]), [pixel([1.0, 0.0]), pixel([0.0, 1.0])]);
    let row = |k: usize| [along[0][k] - origin[k], along[1][k] - origin[k], 0.0];
    Ok(PlanePlacement {
        size_px: [canvas.width, canvas.height],
        px_per_metre: view.px_per_cell / map.resolution_m,
        view: ViewPlacement { px_from_map: [row(0), row(1)], offset_px: origin },
    })
}

/// Writes what was drawn as a PNG.
pub(super) fn encode(canvas: &Canvas, writer: impl Write) -> Result<(), FormatError> {
    encode_as(canvas, png::Compression::Fast, writer)
}

/// The same with more time for fewer bytes.
pub(super) fn encode_as(canvas: &Canvas, compression: png::Compression, writer: impl Write) -> Result<(), FormatError> {
    write_pixels((canvas.width, canvas.height, canvas.pixels.as_flattened()), png::ColorType::Rgb, compression, writer)
}

/// Writes a picture of three bytes a pixel, red, green and blue, the top row first.
///
/// # Errors
///
/// [`FormatError::CellCount`] where the bytes are not three for each pixel; [`FormatError::Io`].
pub fn write_rgb_png(width: usize, height: usize, rgb: &[u8], writer: impl Write) -> Result<(), FormatError> {
    let (expected, found) = (width as u128 * height as u128, rgb.len() / 3);
    if !rgb.len().is_multiple_of(3) || expected != found as u128 || found == 0 {
        return Err(FormatError::CellCount { width, height, expected: expected.max(1), found });
    }
    write_pixels((width, height, rgb), png::ColorType::Rgb, png::Compression::Fast, writer)
}

fn write_pixels(
    (width, height, bytes): (usize, usize, &[u8]),
    colours: png::ColorType,
    compression: png::Compression,
    writer: impl Write,
) -> Result<(), FormatError> {
    let mut encoder = png::Encoder::new(writer, width as u32, height as u32);
    encoder.set_color(colours);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(compression);
    let mut image = encoder.write_header()?;
    image.write_image_data(bytes)?;
    Ok(image.finish()?)
}

fn draw_way(canvas: &mut Canvas, view: &View, way: &[[f64; 2]]) {
    let (Some(&first), Some(&last)) = (way.first(), way.last()) else { return };
    let half_width = 0.9 * pen_scale(canvas);
    let mut from = view.pixel(first);
    for (index, &place) in way.iter().enumerate() {
        let to = view.pixel(place);
        let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
        // Shorter strokes would only cover each other.
        if dx * dx + dy * dy >= 1.0 {
            canvas.stroke(from, to, half_width, way_colour(index as f32 / way.len() as f32));
            from = to;
        }
    }
    canvas.triangle(view.pixel(first), 6.5 * half_width, START);
    canvas.square(view.pixel(last), 5.0 * half_width, END);
}

/// The last place first, so that the first one lies on top.
fn draw_places(canvas: &mut Canvas, view: &View, map: &GridImage, places: &[[f64; 2]]) {
    let pen = pen_scale(canvas);
    for (index, &[x, y]) in places.iter().enumerate().rev() {
        for &place in &in_cells(map, std::iter::once([x, y])) {
            draw_place(canvas, view.pixel(place), index + 1, pen);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::canvas::Colour;
    use super::super::confidence::Confidence;
    use super::super::palette::{INK, MARGIN_PX, UNSEEN};
    use super::super::raster::shade;
    use super::*;
    use crate::UNKNOWN;
    use mapwright_geom::Pose2;

    fn decode(bytes: &[u8]) -> (usize, usize, Vec<u8>) {
        let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        (info.width as usize, info.height as usize, pixels)
    }

    fn draw(map: &GridImage, picture: &Picture<'_>) -> Vec<u8> {
        let mut out = Vec::new();
        write_png(map, picture, &mut out).unwrap();
        out
    }

    fn room(width: usize, height: usize) -> GridImage {
        let wall = |at: usize, side: usize| at == 2 || at == side - 3;
        let cells = (0..width * height).map(|i| {
            let (x, y) = (i % width, i / width);
            let outside = x < 2 || y < 2 || x > width - 3 || y > height - 3;
            if outside {
                UNKNOWN
            } else if wall(x, width) || wall(y, height) {
                97
            } else {
                3
            }
        });
        GridImage {
            width,
            height,
            resolution_m: 0.05,
            world_from_map: Pose2::new(-1.0, -2.0, 0.3),
            cells: cells.collect(),
        }
    }

    #[test]
    fn small_maps_are_enlarged_and_large_ones_reduced() {
        let bare = Picture { scale_bar: false, ..Picture::default() };
        let (width, height, _) = decode(&draw(&room(104, 54), &bare));
        assert_eq!((width, height), (800 + 2 * MARGIN_PX, 400 + 2 * MARGIN_PX));
        let (width, height, pixels) = decode(&draw(&room(6_004, 3_004), &bare));
        assert!(width <= 2400 && height <= 2400 && width > 1900);
        let dark = pixels.chunks(3).filter(|p| p[0] < 120).count();
        assert!(dark > 2 * (width + height) - 400, "thin walls survive reduction: {dark}");
    }

    #[test]
    fn any_trajectory_and_any_angle_can_be_drawn_and_give_the_same_bytes_again() {
        let map = room(60, 40);
        let odd = [f64::NAN, f64::INFINITY, 1e300, -1e5, 0.0, 1.0].map(|v| Pose2 { x: v, y: 0.5, theta: v });
        for level_rad in [0.0, 0.4, -2.0, f64::NAN, f64::INFINITY] {
            let picture = Picture { world_from_robot: &odd, level_rad, ..Picture::default() };
            assert_eq!(draw(&map, &picture), draw(&map, &picture));
        }
    }

    #[test]
    fn a_map_of_nothing_and_a_map_of_one_cell_have_pictures_too() {
        for cells in [vec![UNKNOWN], vec![0], vec![100], vec![180]] {
            let map = GridImage { width: 1, height: 1, cells, ..room(6, 6) };
            decode(&draw(&map, &Picture::default()));
        }
        let sides = Picture { min_side_px: 0, max_side_px: 0, ..Picture::default() };
        decode(&draw(&room(300, 20), &sides));
    }

    #[test]
    fn a_side_that_is_asked_for_is_the_longer_one_to_the_pixel() {
        for (width, height) in [(104, 54), (54, 104), (100, 100), (7, 900), (900, 7), (2000, 1500)] {
            let map = room(width.max(7), height.max(7));
            let way = [Pose2::new(-0.5, -1.0, 0.0), Pose2::new(0.4, 0.4, 0.0)];
            let seen_from = [([0.0, 0.0], 0.1)];
            let confidence = Some(Confidence { seen_from: &seen_from, places: &[[0.2, 0.1]] });
            for side_px in [100, 333, 800, 801, 1999] {
                for level_rad in [0.0, 0.7] {
                    let picture = Picture {
                        world_from_robot: &way,
                        confidence,
                        level_rad,
                        side_px: Some(side_px),
                        ..Picture::default()
                    };
                    let (w, h, _) = decode(&draw(&map, &picture));
                    assert_eq!(w.max(h), side_px, "{width} x {height}, {level_rad}");
                }
            }
        }
    }

    #[test]
    fn cells_stay_crisp_when_they_are_turned() {
        let bare = Picture { scale_bar: false, level_rad: 0.3, ..Picture::default() };
        let (_, _, pixels) = decode(&draw(&room(54, 44), &bare));
        let shades: Vec<Colour> = [3, 97].map(shade).into_iter().chain([UNSEEN]).collect();
        let pixels = pixels.as_chunks::<3>().0;
        let mixed = pixels.iter().filter(|pixel| !shades.contains(pixel)).count();
        // A wall of a cell is 15 pixels wide here and has two edges: blurred over whole cells a third of all would be mixed.
        assert!(mixed * 14 < pixels.len(), "{mixed} of {}", pixels.len());
    }

    #[test]
    fn maps_in_one_frame_have_pictures_of_one_size_that_lie_over_each_other() {
        let (one, other) = (room(60, 40), GridImage { world_from_map: Pose2::new(2.0, -1.0, 0.3), ..room(30, 70) });
        for level_rad in [0.0, 0.4] {
            let bare = Picture { level_rad, ..Picture::default() };
            let frame = Frame::of(&one, &bare).and(Frame::of(&other, &bare));
            let at = [Pose2::new(0.5, -0.5, 0.0)];
            let [a, b] = [&one, &other].map(|map| {
                let picture = Picture { world_from_robot: &at, level_rad, frame: Some(frame), ..Picture::default() };
                decode(&draw(map, &picture))
            });
            assert_eq!((a.0, a.1), (b.0, b.1));
            let discs = [&a, &b].map(|(_, _, pixels)| {
                let end = |pixel: &[u8; 3]| (0..3).all(|k| pixel[k].abs_diff(END[k]) < 4);
                pixels.as_chunks::<3>().0.iter().position(end)
            });
            assert!(discs[0].is_some() && discs[0] == discs[1], "{discs:?}");
        }
    }

    #[test]
    fn the_legend_stands_below_the_map() {
        let way = [Pose2::new(-0.5, -1.0, 0.0), Pose2::new(0.4, 0.4, 0.0)];
        let (width, height, pixels) =
            decode(&draw(&room(104, 54), &Picture { world_from_robot: &way, ..Picture::default() }));
        let strip = &pixels.as_chunks::<3>().0[(height - 40) * width..];
        for colour in [START, END, INK, way_colour(0.5)] {
            let near = |p: &&Colour| (0..3).all(|k| p[k].abs_diff(colour[k]) < 6);
            assert!(strip.iter().filter(near).count() > 8, "{colour:?}");
        }
    }

    /// The same room with a ray through its wall that ends far away, and how many readings tell of each cell: of the room many, of the ray one.
    fn with_a_stray_ray(width: usize) -> (GridImage, Vec<u8>) {
        let (inner, [columns, rows]) = (room(104, 54), [104, 54]);
        let (mut cells, mut seen) = (vec![UNKNOWN; width * rows], vec![0; width * rows]);
        for at in 0..columns * rows {
            let to = at / columns * width + at % columns;
            cells[to] = inner.cells[at];
            seen[to] = if cells[to] == UNKNOWN { 0 } else { 40 };
        }
        let ray = 27 * width + columns - 3..28 * width - 1;
        cells[ray.clone()].fill(3);
        seen[ray.clone()].fill(1);
        (cells[ray.end], seen[ray.end]) = (100, 1);
        (GridImage { width, cells, ..inner }, seen)
    }

    #[test]
    fn a_stray_ray_neither_widens_the_picture_nor_outshouts_the_walls() {
        let (map, seen) = with_a_stray_ray(900);
        let plain = room(104, 54);
        let of = |map: &GridImage, seen| Frame::of(map, &Picture { seen, ..Picture::default() }).sides_m();
        let [alone, with] = [of(&plain, None), of(&map, Some(&seen[..]))];
        assert!((0..2).all(|k| with[k] < 1.1 * alone[k]), "{with:?} beside {alone:?}");
        // where readings are not told it is but one cell of all
        assert!(of(&map, None)[0] < 1.1 * alone[0]);
        let frame = Some(Frame { low_m: [-50.0; 2], high_m: [50.0; 2] });
        let picture = Picture { seen: Some(&seen), frame, scale_bar: false, ..Picture::default() };
        let (_, _, pixels) = decode(&draw(&map, &picture));
        let near = |wanted: Colour| {
            let alike = |p: &&Colour| (0..3).all(|k| p[k].abs_diff(wanted[k]) < 4);
            pixels.as_chunks::<3>().0.iter().filter(alike).count()
        };
        let pale = super::super::canvas::blend(UNSEEN, shade(3), 1.0 / 8.0);
        assert!(near(shade(3)) > 4000 && near(pale) > 700, "{} {}", near(shade(3)), near(pale));
    }

    #[test]
    fn a_way_beyond_the_walls_is_shown() {
        let (map, seen) = with_a_stray_ray(900);
        let far = map.world_from_map.transform([40.0, 1.35]);
        let way = [map.world_from_map.transform([2.0, 1.35]), far].map(|[x, y]| Pose2::new(x, y, 0.0));
        let picture = Picture { world_from_robot: &way, seen: Some(&seen), ..Picture::default() };
        assert!(Frame::of(&map, &picture).sides_m()[0] > 39.0);
    }

    #[test]
    fn walls_are_two_pixels_wide_at_any_scale() {
        for (width, height) in [(1500, 900), (2300, 1300), (6004, 3004)] {
            for level_rad in [0.0, 0.2] {
                let bare = Picture { scale_bar: false, level_rad, ..Picture::default() };
                let (w, h, pixels) = decode(&draw(&room(width, height), &bare));
                let pixels = pixels.as_chunks::<3>().0;
                // across the middle: the left wall and the right one
                let row = &pixels[h / 2 * w..][..w];
                // nearer to a wall's colour than to any ground's, which is mixed in where the picture is turned
                let half = u32::from(UNSEEN[0] - 45);
                let runs: Vec<usize> = row
                    .chunk_by(|a, b| (u32::from(a[0]) < half) == (u32::from(b[0]) < half))
                    .filter(|run| u32::from(run[0][0]) < half)
                    .map(<[Colour]>::len)
                    .collect();
                assert!(runs.len() == 2 && runs.iter().all(|&px| (2..=6).contains(&px)), "{width}: {runs:?}");
            }
        }
    }

    #[test]
    fn a_bare_picture_says_where_the_map_has_what() {
        for level_rad in [0.0, 0.4] {
            let map = room(104, 54);
            let picture = Picture { level_rad, scale_bar: false, ..Picture::default() };
            let mut png = Vec::new();
            let placed = write_bare_png(&map, &picture, &mut png).unwrap();
            let (width, height, grey) = decode(&png);
            assert!([width, height] == placed.size_px && grey.len() == width * height);
            let at = |cell: [f64; 2]| {
                let place = map.world_from_map.transform(cell.map(|cells| cells * map.resolution_m));
                let pixel = [0, 1].map(|k| {
                    let [x, y, _] = placed.view.px_from_map[k];
                    placed.view.offset_px[k] + x * place[0] + y * place[1]
                });
                grey[pixel[1] as usize * width + pixel[0] as usize]
            };
            assert!(at([2.5, 27.5]) < 60 && at([50.5, 51.5]) < 60 && at([50.5, 27.5]) > 240, "{level_rad}");
        }
    }
}
