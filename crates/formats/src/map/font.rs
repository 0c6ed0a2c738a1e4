//! Letters of strokes, for scale bar and legend: they can be drawn at any size, and their edges are smooth. They are drawn
//! for mapwright and have its licences.
//!
//! Units: small letters are 10 high, tall ones 15, digits 14; the feet stand at 0.

use super::canvas::Canvas;
use super::canvas::Colour;
use mapwright_geom::sin_cos;

/// Height of tall letters, units.
pub(super) const TALL: f32 = 15.0;
/// Half the width of a stroke, units.
const HALF_STROKE: f32 = 0.95;
/// Between two letters, from stroke's middle to stroke's middle, units.
const GAP: f32 = 4.2;
/// The space between words, units.
const BLANK: f32 = 3.4;
/// A chord of an arc turns by so much at most, degrees; at the size of a legend it is off by less than a tenth of a pixel.
const CHORD_DEG: f32 = 18.0;

/// A part of a letter.
#[derive(Debug, Clone, Copy)]
enum Stroke {
    /// Straight from place to place.
    Line(&'static [[f32; 2]]),
    /// Of an ellipse: its centre, its half axes, and from which to which angle, degrees against the clock.
    Arc([f32; 2], [f32; 2], [f32; 2]),
}

use Stroke::{Arc, Line};

/// The bowl of a, b, d, g, o, p and q.
const BOWL: Stroke = Arc([4.4, 5.0], [4.4, 5.0], [0.0, 360.0]);
/// The arch of h and n.
const ARCH: Stroke = Arc([4.1, 5.9], [4.1, 4.1], [180.0, 0.0]);
const ARCH_FOOT: Stroke = Line(&[[8.2, 5.9], [8.2, 0.0]]);
const SMALL_STEM: Stroke = Line(&[[0.0, 10.0], [0.0, 0.0]]);
const TALL_STEM: Stroke = Line(&[[0.0, TALL], [0.0, 0.0]]);

/// A letter's width from the middle of its first stroke to that of its last, units, and its strokes; none where it is unknown.
fn glyph(letter: char) -> (f32, &'static [Stroke]) {
    match letter {
        'a' => (8.8, &[BOWL, Line(&[[8.8, 10.0], [8.8, 0.0]])]),
        'b' => (8.8, &[BOWL, TALL_STEM]),
        'c' => (7.6, &[Arc([4.4, 5.0], [4.4, 5.0], [48.0, 312.0])]),
        'd' => (8.8, &[BOWL, Line(&[[8.8, TALL], [8.8, 0.0]])]),
        'e' => (8.8, &[Line(&[[0.2, 5.3], [8.8, 5.3]]), Arc([4.4, 5.0], [4.4, 5.0], [4.0, 318.0])]),
        'f' => (
            5.0,
            &[
                Line(&[[1.8, 0.0], [1.8, 11.9]]),
                Arc([4.9, 11.9], [3.1, 3.1], [180.0, 80.0]),
                Line(&[[0.0, 10.0], [5.0, 10.0]]),
            ],
        ),
        'g' => (8.8, &[BOWL, Line(&[[8.8, 10.0], [8.8, -0.6]]), Arc([4.4, -0.6], [4.4, 4.2], [0.0, -145.0])]),
        'h' => (8.2, &[TALL_STEM, ARCH, ARCH_FOOT]),
        'i' => (0.0, &[SMALL_STEM, Line(&[[0.0, 13.8], [0.0, 14.2]])]),
        'j' => (
            1.8,
            &[
                Line(&[[1.8, 10.0], [1.8, -2.0]]),
                Arc([-0.6, -2.0], [2.4, 2.4], [0.0, -80.0]),
                Line(&[[1.8, 13.8], [1.8, 14.2]]),
            ],
        ),
        'k' => (7.4, &[TALL_STEM, Line(&[[7.0, 10.0], [0.0, 3.8]]), Line(&[[2.7, 6.2], [7.4, 0.0]])]),
        'l' => (0.0, &[TALL_STEM]),
        'm' => (
            13.2,
            &[
                SMALL_STEM,
                Arc([3.3, 6.7], [3.3, 3.3], [180.0, 0.0]),
                Line(&[[6.6, 6.7], [6.6, 0.0]]),
                Arc([9.9, 6.7], [3.3, 3.3], [180.0, 0.0]),
                Line(&[[13.2, 6.7], [13.2, 0.0]]),
            ],
        ),
        'n' => (8.2, &[SMALL_STEM, ARCH, ARCH_FOOT]),
        'o' => (8.8, &[BOWL]),
        'p' => (8.8, &[BOWL, Line(&[[0.0, 10.0], [0.0, -5.0]])]),
        'q' => (8.8, &[BOWL, Line(&[[8.8, 10.0], [8.8, -5.0]])]),
        'r' => (5.0, &[SMALL_STEM, Arc([4.1, 5.9], [4.1, 4.1], [180.0, 72.0])]),
        's' => (7.0, &[Arc([3.5, 7.5], [3.2, 2.5], [35.0, 270.0]), Arc([3.5, 2.5], [3.5, 2.5], [90.0, -148.0])]),
        't' => (
            5.0,
            &[
                Line(&[[1.8, 13.6], [1.8, 3.1]]),
                Arc([4.9, 3.1], [3.1, 3.1], [180.0, 275.0]),
                Line(&[[0.0, 10.0], [5.0, 10.0]]),
            ],
        ),
        'u' => (
            8.2,
            &[
                Line(&[[0.0, 10.0], [0.0, 4.1]]),
                Arc([4.1, 4.1], [4.1, 4.1], [180.0, 360.0]),
                Line(&[[8.2, 10.0], [8.2, 0.0]]),
            ],
        ),
        'v' => (8.0, &[Line(&[[0.0, 10.0], [4.0, 0.0], [8.0, 10.0]])]),
        'w' => (12.0, &[Line(&[[0.0, 10.0], [3.0, 0.0], [6.0, 9.4], [9.0, 0.0], [12.0, 10.0]])]),
        'x' => (7.6, &[Line(&[[0.0, 10.0], [7.6, 0.0]]), Line(&[[7.6, 10.0], [0.0, 0.0]])]),
        'y' => (8.0, &[Line(&[[0.0, 10.0], [4.0, 0.0]]), Line(&[[8.0, 10.0], [2.6, -4.2], [0.6, -5.0]])]),
        'z' => (7.4, &[Line(&[[0.0, 10.0], [7.4, 10.0], [0.0, 0.0], [7.4, 0.0]])]),
        '0' => (8.4, &[Arc([4.2, 7.0], [4.2, 7.0], [0.0, 360.0])]),
        '1' => (5.2, &[Line(&[[0.6, 11.2], [4.2, 14.0], [4.2, 0.0]])]),
        '2' => (8.2, &[Arc([4.1, 10.0], [4.0, 4.0], [168.0, -38.0]), Line(&[[7.25, 7.54], [0.0, 0.0], [8.2, 0.0]])]),
        '3' => (8.2, &[Arc([4.0, 10.65], [3.6, 3.35], [155.0, -90.0]), Arc([4.0, 3.65], [4.2, 3.65], [90.0, -155.0])]),
        '4' => (8.8, &[Line(&[[6.4, 0.0], [6.4, 14.0], [0.0, 4.0], [8.8, 4.0]])]),
        '5' => (8.2, &[Line(&[[7.6, 14.0], [1.4, 14.0], [0.9, 7.7]]), Arc([3.9, 4.5], [4.3, 4.5], [134.0, -150.0])]),
        '6' => (8.4, &[Arc([4.2, 4.5], [4.2, 4.5], [0.0, 360.0]), Arc([7.9, 4.5], [7.9, 9.5], [180.0, 98.0])]),
        '7' => (8.2, &[Line(&[[0.0, 14.0], [8.2, 14.0], [2.6, 0.0]])]),
        '8' => (8.4, &[Arc([4.2, 10.65], [3.5, 3.35], [0.0, 360.0]), Arc([4.2, 3.65], [4.2, 3.65], [0.0, 360.0])]),
        '9' => (8.4, &[Arc([4.2, 9.5], [4.2, 4.5], [0.0, 360.0]), Arc([0.5, 9.5], [7.9, 9.5], [0.0, -82.0])]),
        '.' => (0.0, &[Line(&[[0.0, 0.1], [0.0, 0.3]])]),
        ',' => (0.8, &[Line(&[[0.8, 0.4], [0.0, -2.8]])]),
        '-' => (5.0, &[Line(&[[0.0, 5.4], [5.0, 5.4]])]),
        '+' => (8.4, &[Line(&[[0.0, 7.0], [8.4, 7.0]]), Line(&[[4.2, 11.2], [4.2, 2.8]])]),
        '%' => (
            10.0,
            &[
                Arc([2.2, 10.9], [2.2, 3.1], [0.0, 360.0]),
                Arc([7.8, 3.1], [2.2, 3.1], [0.0, 360.0]),
                Line(&[[8.4, 14.0], [1.6, 0.0]]),
            ],
        ),
        '±' => {
            (8.4, &[Line(&[[0.0, 8.6], [8.4, 8.6]]), Line(&[[4.2, 12.8], [4.2, 4.4]]), Line(&[[0.0, 0.8], [8.4, 0.8]])])
        }
        '°' => (4.4, &[Arc([2.2, 12.0], [2.2, 2.2], [0.0, 360.0])]),
        _ => (BLANK, &[]),
    }
}

/// Whether a letter is drawn as anything.
#[cfg(test)]
pub(super) fn is_known(letter: char) -> bool {
    !glyph(letter).1.is_empty()
}

/// From the left end of a text to its right end, in pixels where a unit has so many.
pub(super) fn width_px(text: &str, unit_px: f32) -> f32 {
    let advance = |letter: char| glyph(letter).0 + GAP;
    unit_px * (text.chars().map(advance).sum::<f32>() - GAP + 2.0 * HALF_STROKE).max(0.0)
}

impl Canvas {
    /// Text whose feet stand at `foot` from the left end on, pixels; of so many pixels a unit.
    pub(super) fn text(&mut self, text: &str, [left, foot]: [f32; 2], unit_px: f32, colour: Colour) {
        let mut at = left + HALF_STROKE * unit_px;
        for letter in text.chars() {
            let (width, strokes) = glyph(letter);
            let segments: Vec<[[f32; 2]; 2]> = strokes.iter().flat_map(|stroke| segments(*stroke)).collect();
            let placed = segments.iter().map(|ends| ends.map(|[x, y]| [at + x * unit_px, foot - y * unit_px]));
            self.strokes_as_one(&placed.collect::<Vec<_>>(), HALF_STROKE * unit_px, colour);
            at += (width + GAP) * unit_px;
        }
    }

    /// The same about a centre.
    pub(super) fn text_about(&mut self, text: &str, [x, y]: [f32; 2], unit_px: f32, colour: Colour) {
        let tall = text.chars().any(|letter| letter.is_ascii_digit() || "bdfhklt".contains(letter));
        let half_height = if tall { 7.0 } else { 5.0 };
        self.text(text, [x - 0.5 * width_px(text, unit_px), y + half_height * unit_px], unit_px, colour);
    }
}

/// A stroke in straight pieces.
fn segments(stroke: Stroke) -> Vec<[[f32; 2]; 2]> {
    let places = match stroke {
        Line(places) => places.to_vec(),
        Arc([x, y], [a, b], [from, to]) => {
            let pieces = ((to - from).abs() / CHORD_DEG).ceil().max(1.0);
            let place = |piece: usize| {
                let degrees = from + (to - from) * piece as f32 / pieces;
                let (s, c) = sin_cos(f64::from(degrees).to_radians());
                [x + a * c as f32, y + b * s as f32]
            };
            (0..=pieces as usize).map(place).collect()
        }
    };
    places.windows(2).map(|pair| [pair[0], pair[1]]).collect()
}
