//! Pictures of a room, and of odd input.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use super::*;
use crate::map::palette::{END, START};

struct Image {
    width: usize,
    pixels: Vec<Colour>,
}

fn draw(picture: &SpacePicture<'_>) -> Image {
    let mut out = Vec::new();
    write_space_png(picture, &mut out).unwrap();
    let mut again = Vec::new();
    write_space_png(picture, &mut again).unwrap();
    assert_eq!(out, again);
    decoded(out)
}

/// The bare picture, whose placement says its size.
fn draw_bare(picture: &SpacePicture<'_>) -> (Image, SpacePlacement) {
    let mut out = Vec::new();
    let placement = write_bare_space_png(picture, &mut out).unwrap();
    let image = decoded(out);
    assert_eq!([image.width, image.height()], placement.size_px);
    (image, placement)
}

fn decoded(png: Vec<u8>) -> Image {
    let mut reader = png::Decoder::new(std::io::Cursor::new(png)).read_info().unwrap();
    let mut bytes = vec![0; reader.output_buffer_size().unwrap()];
    let info = reader.next_frame(&mut bytes).unwrap();
    let pixels = bytes.as_chunks::<3>().0.to_vec();
    Image { width: info.width as usize, pixels }
}

impl Image {
    fn height(&self) -> usize {
        self.pixels.len() / self.width
    }

    /// How many pixels of the upper part, the view from above, are like this colour.
    fn above_like(&self, colour: Colour) -> usize {
        let near = |p: &&Colour| (0..3).all(|k| p[k].abs_diff(colour[k]) < 25);
        self.pixels[..self.width * self.height() / 2].iter().filter(near).count()
    }
}

/// A room of 8 by 4 by 2.5 m with a red floor, blue walls and a green ceiling.
fn room() -> (Vec<[f32; 3]>, Vec<Colour>) {
    let (mut points, mut colours) = (Vec::new(), Vec::new());
    let mut add = |point: [f32; 3], colour: Colour| {
        points.push(point);
        colours.push(colour);
    };
    for i in 0..=160 {
        let x = i as f32 * 0.05;
        for j in 0..=80 {
            let y = j as f32 * 0.05;
            add([x, y, 0.0], [220, 30, 30]);
            add([x, y, 2.5], [30, 220, 30]);
        }
        for k in 0..=50 {
            let z = k as f32 * 0.05;
            add([x, 0.0, z], [30, 30, 220]);
            add([x, 4.0, z], [30, 30, 220]);
        }
    }
    (points, colours)
}

const WAY: [[f64; 3]; 2] = [[2.0, 2.0, 1.4], [6.0, 2.0, 1.4]];

#[test]
fn a_low_ceiling_does_not_hide_the_room() {
    let (points_m, colours) = room();
    let picture = SpacePicture { points_m: &points_m, colours: &colours, way_m: &WAY, ..SpacePicture::default() };
    let image = draw(&picture);
    assert_eq!(image.width.max(image.height()), 1600);
    assert!(image.above_like([220, 30, 30]) > 100_000, "{}", image.above_like([220, 30, 30]));
    assert_eq!(image.above_like([30, 220, 30]), 0);
    // without a way nothing is cut away
    let image = draw(&SpacePicture { way_m: &[], ..picture });
    assert!(image.above_like([30, 220, 30]) > 100_000);
}

#[test]
fn heights_are_colours_where_there_are_none_and_walls_throw_shadows() {
    let (points_m, _) = room();
    let closures_m = [[[1.0, 1.0, 1.0], [7.0, 3.0, 1.0]]];
    let picture = SpacePicture { points_m: &points_m, way_m: &WAY, closures_m: &closures_m, ..SpacePicture::default() };
    let image = draw(&picture);
    assert!(image.above_like(HEIGHTS[0]) > 100_000 && image.above_like(CLOSURE) > 500);
    // along a column through the floor it is darker beside the wall than in the middle
    let column: Vec<_> = (0..image.height() / 2).map(|y| image.pixels[y * image.width + image.width / 4]).collect();
    let light = |p: &Colour| p.iter().map(|&v| u32::from(v)).sum::<u32>();
    let shadow = |p: &&Colour| p[0] >= p[2] && light(p) < light(&HEIGHTS[0]) * 9 / 10;
    assert!(column.iter().filter(shadow).count() >= 4);
}

#[test]
fn a_bare_picture_says_where_the_way_would_be() {
    let (points_m, _) = room();
    let picture = SpacePicture { points_m: &points_m, way_m: &WAY, ..SpacePicture::default() };
    let drawn = draw(&picture);
    let (bare, placement) = draw_bare(&picture);
    assert!(bare.width == drawn.width && bare.height() < drawn.height(), "without the lines below: {placement:?}");
    for (place, colour) in WAY.iter().zip([START, END]) {
        for view in &placement.views {
            let ViewPlacement { px_from_map, offset_px } = view.placement;
            let pixel =
                [0, 1].map(|k| offset_px[k] + (0..3).map(|axis| px_from_map[k][axis] * place[axis]).sum::<f64>());
            assert_eq!(drawn.pixels[pixel[1] as usize * drawn.width + pixel[0] as usize], colour);
        }
    }
}

#[test]
fn anything_can_be_drawn() {
    let odd = [[f32::NAN, 0.0, 0.0], [1e30, 0.0, 0.0], [1.0, 2.0, 3.0]];
    let way = [[f64::INFINITY, 0.0, 0.0], [0.5, 0.0, -3.0]];
    for points_m in [&odd[..], &odd[..2], &[]] {
        for (up, side_px) in [([0.0; 3], 0), ([f64::NAN; 3], 300), ([1.0, 0.0, 0.0], 5000)] {
            for way_m in [&way[..], &[]] {
                let closures_m = [[way[0], way[1]], [way[1], way[1]]];
                let picture =
                    SpacePicture { points_m, way_m, closures_m: &closures_m, up, side_px, ..SpacePicture::default() };
                draw(&picture);
            }
        }
        draw(&SpacePicture { points_m, point_m: f64::NAN, ..SpacePicture::default() });
    }
}

/// Two rooms over each other and a ramp between them, a wall far outside, and a speck above the upper floor.
fn house() -> (Vec<[f32; 3]>, Vec<[f64; 3]>) {
    let grid = |from: [f32; 2], to: [f32; 2]| {
        let steps = move |k: usize| ((to[k] - from[k]) / 0.1) as usize;
        (0..=steps(0))
            .flat_map(move |i| (0..=steps(1)).map(move |j| [from[0] + i as f32 * 0.1, from[1] + j as f32 * 0.1]))
    };
    let mut points: Vec<[f32; 3]> = Vec::new();
    for floor in [0.0, 3.0] {
        points.extend(grid([0.0, 0.0], [20.0, 12.0]).map(|[x, y]| [x, y, floor]));
        points.extend(grid([0.0, floor], [20.0, floor + 2.5]).map(|[x, z]| [x, 0.0, z]));
        points.extend(grid([0.0, floor], [20.0, floor + 2.5]).map(|[x, z]| [x, 12.0, z]));
    }
    points.extend(grid([0.0, 0.0], [6.0, 1.5]).map(|[y, z]| [-25.0, y + 3.0, z]));
    points.push([15.0, 9.0, 4.2]);
    let around = |height: f64| {
        let at = move |k: u32| f64::from(k) * 0.1;
        (0..160).map(move |k| [2.0 + at(k), 6.0, height])
    };
    let ramp = (0..160).map(|k| [18.0 - f64::from(k) * 0.1, 4.0, 0.3 + f64::from(k) * 3.0 / 160.0]);
    (points, around(0.3).chain(ramp).chain(around(3.3)).collect())
}

#[test]
fn storeys_lie_beside_each_other_and_a_stray_wall_outside() {
    let (points_m, way_m) = house();
    let picture = SpacePicture { points_m: &points_m, way_m: &way_m, point_m: 0.1, ..SpacePicture::default() };
    let (_, placement) = draw_bare(&picture);
    let captions: Vec<&str> = placement.views.iter().map(|view| view.caption.as_str()).collect();
    assert_eq!(captions, ["from above, storey 1 of 2", "from above, storey 2 of 2", "from the side"]);
    let [first, second] = [0, 1].map(|k| placement.views[k].heights_m);
    assert!(
        first[1] == second[0] && (2.5..3.0).contains(&first[1]) && second[1] == f64::INFINITY,
        "{first:?} {second:?}"
    );
    // side by side: the same place, one view farther to the right
    let [left, right] = [0, 1].map(|k| placement.views[k].placement.offset_px);
    assert!(left[1] == right[1] && right[0] - left[0] > 20.0 * placement.px_per_metre);
    // the wall would take half of the frame
    let across = [0, 1].map(|k| placement.high_m[k] - placement.low_m[k]);
    assert!(across[0].max(across[1]) < 21.0, "{across:?}");
    let wall = 61.0 * 16.0 / points_m.len() as f64;
    assert!((placement.outside_share - wall).abs() < 0.2 * wall, "{} {wall}", placement.outside_share);
}

#[test]
fn a_speck_has_no_halo() {
    let (points_m, way_m) = house();
    let (upper, speck): (Vec<[f32; 3]>, Vec<[f32; 3]>) =
        points_m.into_iter().filter(|p| p[2] >= 2.9 && p[0] >= 0.0).partition(|p| p[2] != 4.2);
    let picture = |points_m| SpacePicture { points_m, way_m: &way_m[320..], point_m: 0.1, ..SpacePicture::default() };
    let without = draw(&picture(&upper));
    let both = [upper.clone(), speck].concat();
    let with = draw(&picture(&both));
    assert_eq!((with.width, with.pixels.len()), (without.width, without.pixels.len()));
    let differing: Vec<usize> = (0..with.pixels.len()).filter(|&at| with.pixels[at] != without.pixels[at]).collect();
    let rows = || differing.iter().map(|at| at / with.width).filter(|row| *row < with.height() / 2);
    let apart = rows().max().zip(rows().min()).map(|(last, first)| last - first + 1);
    let point_px = 1.6 * 0.1 * write_bare_space_png(&picture(&upper), Vec::new()).unwrap().px_per_metre;
    assert!(apart.is_some_and(|apart| (apart as f64) < point_px + 3.0), "{apart:?} rows, a point is {point_px} wide");
}
