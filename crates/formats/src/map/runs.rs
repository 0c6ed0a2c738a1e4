//! The ways of several robots in one picture: a colour each, and where they met.

use super::canvas::{Canvas, Colour};
use super::palette::INK;
use mapwright_geom::Pose2;

/// Colours of runs, in their order; then from the first one on again. Any two of them, and each of them and a map's free space and walls, are
/// at least 19 apart in CIE 1976 L*a*b* for eyes that see all colours and for those that lack one of three kinds of cones (by the matrices of
/// Machado, Oliveira and Fernandes 2009, complete deficiency).
pub const RUN_COLOURS: [[u8; 3]; 8] = [
    [0, 65, 198],
    [213, 94, 0],
    [43, 105, 47],
    [185, 118, 155],
    [213, 185, 2],
    [86, 180, 233],
    [139, 25, 103],
    [78, 20, 133],
];

/// A name in a legend has so many letters at most.
const LETTERS: usize = 24;

/// What a picture shows of several runs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Runs<'a> {
    /// The ways, each in a colour of its own.
    pub ways: &'a [RunWay],
    /// Where two runs met: their numbers, and the place, in the order of time.
    pub meetings: &'a [([usize; 2], [f64; 2])],
}

/// The way of one run.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RunWay {
    /// Which run it is, from zero: its colour.
    pub number: usize,
    /// What its end is marked with.
    pub label: usize,
    /// What the legend calls it.
    pub name: String,
    /// Poses in the order of time; between two lines nobody knows how it went.
    pub lines: Vec<Vec<Pose2>>,
}

impl Runs<'_> {
    /// All places that it shows.
    pub(super) fn places(&self) -> impl Iterator<Item = [f64; 2]> + '_ {
        self.ways.iter().flat_map(|way| &way.lines).flatten().map(|pose| [pose.x, pose.y])
    }
}

/// The colour of a run.
#[must_use]
pub fn run_colour(number: usize) -> [u8; 3] {
    RUN_COLOURS[number % RUN_COLOURS.len()]
}

/// A name in the letters that there are.
pub(super) fn legible(name: &str) -> String {
    let letter = |letter: char| if letter == '_' { '-' } else { letter.to_ascii_lowercase() };
    let mut letters: Vec<char> = name.chars().map(letter).collect();
    if letters.len() > LETTERS {
        letters.truncate(LETTERS - 2);
        letters.extend(['.', '.']);
    }
    letters.into_iter().collect()
}

/// Number and label of a run, and its lines, pixels.
type Placed = ([usize; 2], Vec<Vec<[f32; 2]>>);

/// Draws ways, then where robots met, then starts and labelled ends; `pixel` says where a place of the world is, if anywhere.
pub(super) fn draw_runs(canvas: &mut Canvas, runs: &Runs<'_>, pen: f32, pixel: impl Fn([f64; 2]) -> Option<[f32; 2]>) {
    let drawn: Vec<Placed> = runs
        .ways
        .iter()
        .map(|way| {
            let line =
                |line: &Vec<Pose2>| line.iter().filter_map(|pose| pixel([pose.x, pose.y])).collect::<Vec<[f32; 2]>>();
            ([way.number, way.label], way.lines.iter().map(line).collect())
        })
        .collect();
    for ([number, _], lines) in &drawn {
        for line in lines {
            draw_line(canvas, line, 2.0 * pen, [255; 3]);
            draw_line(canvas, line, 1.1 * pen, run_colour(*number));
        }
    }
    let mut marked: Vec<[f32; 2]> = Vec::new();
    let radius = 5.0 * pen;
    for &(pair, place) in runs.meetings {
        let Some(centre) = pixel(place) else { continue };
        let is_near = |other: &[f32; 2]| (other[0] - centre[0]).hypot(other[1] - centre[1]) < 8.0 * radius;
        if !marked.iter().any(is_near) {
            marked.push(centre);
            draw_meeting(canvas, centre, pair, pen);
        }
    }
    for ([number, _], lines) in &drawn {
        lines.iter().flatten().take(1).for_each(|first| canvas.triangle(*first, 6.5 * pen, run_colour(*number)));
    }
    for (marks, lines) in &drawn {
        lines.iter().flatten().next_back().into_iter().for_each(|last| draw_tag(canvas, *last, *marks, pen));
    }
}

fn draw_line(canvas: &mut Canvas, line: &[[f32; 2]], half_width: f32, colour: Colour) {
    let Some(&first) = line.first() else { return };
    let mut from = first;
    for &to in line {
        // Shorter strokes would only cover each other.
        if (to[0] - from[0]).hypot(to[1] - from[1]) >= 1.0 {
            canvas.stroke(from, to, half_width, colour);
            from = to;
        }
    }
}

/// A square in the colour of a run with its label.
pub(super) fn draw_tag(canvas: &mut Canvas, centre: [f32; 2], [number, label]: [usize; 2], pen: f32) {
    let colour = run_colour(number);
    canvas.square(centre, 7.5 * pen, colour);
    let bright = 0.3 * f32::from(colour[0]) + 0.59 * f32::from(colour[1]) + 0.11 * f32::from(colour[2]);
    let ink = if bright > 140.0 { INK } else { [255; 3] };
    canvas.text_about(&label.to_string(), centre, 0.65 * pen, ink);
}

/// A disc in the colours of both.
pub(super) fn draw_meeting(canvas: &mut Canvas, centre: [f32; 2], pair: [usize; 2], pen: f32) {
    let half = 0.5 * 3.6 * pen;
    canvas.stroke(centre, centre, 6.6 * pen, INK);
    canvas.stroke(centre, centre, 5.6 * pen, [255; 3]);
    for (number, side) in pair.into_iter().zip([-1.0, 1.0]) {
        let x = centre[0] + side * half;
        canvas.stroke([x, centre[1] - half], [x, centre[1] + half], 1.5 * pen, run_colour(number));
    }
}

#[cfg(test)]
mod tests {
    use super::super::footer;
    use super::*;
    use crate::{GridImage, Picture, write_png};

    #[test]
    fn every_run_has_its_colour_and_its_place_in_the_legend() {
        let world_from_map = Pose2::new(0.0, 0.0, 0.0);
        let map = GridImage { width: 200, height: 100, resolution_m: 0.1, world_from_map, cells: vec![2; 20_000] };
        let way = |number: usize| RunWay {
            number,
            label: number + 1,
            name: format!("Robot_{number} {}", "x".repeat(number * 9)),
            lines: vec![vec![
                Pose2::new(2.0, 1.0 + number as f64, 0.0),
                Pose2::new(17.0, 1.0 + number as f64, 0.0),
                Pose2::new(f64::NAN, 1e300, 0.0),
            ]],
        };
        let ways: Vec<RunWay> = (0..8).map(way).collect();
        let draw = |ways: &[RunWay]| {
            let meetings = [([0, 7], [9.0, 5.0]), ([0, 7], [9.1, 5.0])];
            let picture = Picture { runs: Some(Runs { ways, meetings: &meetings }), ..Picture::default() };
            let mut out = Vec::new();
            write_png(&map, &picture, &mut out).unwrap();
            let mut reader = png::Decoder::new(std::io::Cursor::new(out)).read_info().unwrap();
            let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut pixels).unwrap();
            pixels
        };
        let pixels = draw(&ways);
        for colour in RUN_COLOURS {
            let near = |p: &&[u8; 3]| (0..3).all(|k| p[k].abs_diff(colour[k]) < 4);
            assert!(pixels.as_chunks::<3>().0.iter().filter(near).count() > 900, "{colour:?}");
        }
        assert_eq!(pixels, draw(&ways));
        let shown = legible(&ways[7].name);
        assert!(shown.starts_with("robot-7 xx") && shown.ends_with("..") && shown.chars().count() == LETTERS);
        assert!(footer::Item::Run([7, 8], shown).is_within(320));
    }
}
