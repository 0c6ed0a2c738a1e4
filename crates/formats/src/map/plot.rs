//! Pictures of robots that explore: a map with the way of each in its colour, and what was seen over time.

use super::canvas::{Canvas, Colour};
use super::font;
use super::footer::{Footer, Item};
use super::palette::{INK, MARGIN_PX};
use super::picture::encode;
use crate::error::FormatError;
use std::io::Write;

/// The way of one of several robots.
#[derive(Debug, Clone)]
pub struct RobotWay {
    /// Red, green, blue.
    pub colour: [u8; 3],
    /// What it is called below the picture.
    pub name: &'static str,
    /// Pixels from the left and from the top of the picture.
    pub points_px: Vec<[f32; 2]>,
}

/// Writes a map as pixels of three bytes, the top row first, with the ways of robots on it: a triangle where each begins, a square where it
/// ends. Below stand a scale and the robots' names.
///
/// # Errors
///
/// [`FormatError::CellCount`] where the bytes are not three for each pixel; [`FormatError::Io`].
pub fn write_ways_png(
    [width, height]: [usize; 2],
    rgb: &[u8],
    px_per_metre: f64,
    ways: &[RobotWay],
    writer: impl Write,
) -> Result<(), FormatError> {
    let (expected, found) = (width as u128 * height as u128, rgb.len() / 3);
    if !rgb.len().is_multiple_of(3) || expected != found as u128 || found == 0 {
        return Err(FormatError::CellCount { width, height, expected: expected.max(1), found });
    }
    let names = ways.iter().map(|way| Item::Lines(way.colour, way.name));
    let footer = Footer::of(std::iter::once(Item::ScaleBar { px_per_metre }).chain(names).collect(), width, 1.0);
    let mut canvas = Canvas::new(width, height + footer.height_px() + MARGIN_PX, [255; 3]);
    for (y, row) in rgb.chunks_exact(3 * width).enumerate() {
        for (pixel, rgb) in canvas.row(y).iter_mut().zip(row.chunks_exact(3)) {
            *pixel = [rgb[0], rgb[1], rgb[2]];
        }
    }
    for way in ways {
        way.points_px.windows(2).for_each(|pair| canvas.stroke(pair[0], pair[1], 1.2, way.colour));
    }
    for way in ways {
        way.points_px.first().into_iter().for_each(|&first| canvas.triangle(first, 6.0, way.colour));
        way.points_px.last().into_iter().for_each(|&last| canvas.square(last, 5.0, way.colour));
    }
    footer.draw(&mut canvas);
    encode(&canvas, writer)
}

/// A curve over time with both axes in words and numbers.
#[derive(Debug, Clone, Copy)]
pub struct Curve<'a> {
    /// One value a second, from zero on.
    pub values: &'a [f64],
    /// What the values are, with their unit.
    pub name: &'a str,
    /// The axis begins at zero and ends at least here.
    pub most: f64,
    /// Seconds at which something happened, and what.
    pub events: &'a [(f64, &'a str)],
    /// Red, green, blue.
    pub colour: [u8; 3],
}

const SIZE_PX: [usize; 2] = [900, 480];
/// Left, right, top and bottom of the axes, pixels.
const FRAME_PX: [f32; 4] = [78.0, 876.0, 40.0, 424.0];
/// Height of a letter is twelve of these.
const UNIT_PX: f32 = 0.9;
const RULES: Colour = [222; 3];

/// Writes a curve over time.
///
/// # Errors
///
/// [`FormatError::Io`].
pub fn write_curve_png(curve: &Curve<'_>, writer: impl Write) -> Result<(), FormatError> {
    let mut canvas = Canvas::new(SIZE_PX[0], SIZE_PX[1], [255; 3]);
    let [left, right, top, bottom] = FRAME_PX;
    let most_s = curve.values.len().saturating_sub(1).max(1) as f64;
    let most = curve.values.iter().copied().fold(curve.most, f64::max).max(f64::MIN_POSITIVE);
    let place = |second: f64, value: f64| {
        [left + (second / most_s) as f32 * (right - left), bottom - (value / most) as f32 * (bottom - top)]
    };
    for value in ticks(most, 6.0) {
        let [x, y] = place(0.0, value);
        canvas.stroke([x, y], [right, y], 0.5, RULES);
        let label = format!("{value}");
        let width = font::width_px(&label, UNIT_PX);
        canvas.text(&label, [x - width - 8.0, y + 0.45 * font::TALL * UNIT_PX], UNIT_PX, INK);
    }
    for second in ticks(most_s, 9.0) {
        let [x, y] = place(second, 0.0);
        canvas.stroke([x, y], [x, top], 0.5, RULES);
        canvas.text_about(&format!("{second}"), [x, y + 16.0], UNIT_PX, INK);
    }
    canvas.stroke([left, top], [left, bottom], 0.8, INK);
    canvas.stroke([left, bottom], [right, bottom], 0.8, INK);
    canvas.text(curve.name, [left - 60.0, top - 16.0], UNIT_PX, INK);
    canvas.text_about("time (s)", [0.5 * (left + right), bottom + 40.0], UNIT_PX, INK);
    for (number, &(second, what)) in curve.events.iter().enumerate().filter(|(_, event)| event.0 <= most_s) {
        let [x, _] = place(second, 0.0);
        canvas.stroke([x, bottom], [x, top], 0.8, INK);
        let width = font::width_px(what, UNIT_PX);
        // Beside each other's lines, each lower than the one before.
        let foot = bottom - 12.0 - 20.0 * (number % 8) as f32;
        canvas.text(what, [if x + width + 8.0 < right { x + 6.0 } else { x - width - 6.0 }, foot], UNIT_PX, INK);
    }
    for (second, pair) in curve.values.windows(2).enumerate() {
        let second = second as f64;
        canvas.stroke(place(second, pair[0]), place(second + 1.0, pair[1]), 1.2, curve.colour);
    }
    encode(&canvas, writer)
}

/// Round numbers from zero to a limit, about so many.
fn ticks(most: f64, count: f64) -> Vec<f64> {
    let raw = most / count;
    let power = 10_f64.powi(raw.log10().floor() as i32);
    let step = [1.0, 2.0, 5.0, 10.0].map(|times| times * power).into_iter().find(|&step| step >= raw).unwrap_or(raw);
    (0..=(most / step).floor() as usize).map(|k| k as f64 * step).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_end_before_the_limit() {
        assert_eq!(ticks(1000.0, 5.0), [0.0, 200.0, 400.0, 600.0, 800.0, 1000.0]);
        assert_eq!(ticks(2203.0, 6.0), [0.0, 500.0, 1000.0, 1500.0, 2000.0]);
    }

    #[test]
    fn pictures_hold_what_they_are_to_show() {
        let decode = |bytes: &[u8]| {
            let mut reader = png::Decoder::new(std::io::Cursor::new(bytes)).read_info().unwrap();
            let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
            let info = reader.next_frame(&mut pixels).unwrap();
            (info.width as usize, info.height as usize, pixels)
        };
        let has = |pixels: &[u8], colour: [u8; 3]| pixels.chunks_exact(3).any(|pixel| pixel == colour);
        let mut bytes = Vec::new();
        let way = RobotWay { colour: [200, 0, 0], name: "robot 1", points_px: vec![[20.0, 20.0], [380.0, 20.0]] };
        write_ways_png([400, 100], &[250; 3 * 400 * 100], 10.0, &[way], &mut bytes).unwrap();
        let (width, height, pixels) = decode(&bytes);
        assert!(width == 400 && height > 110 && has(&pixels, [200, 0, 0]));
        assert!(has(&pixels[3 * 400 * 100..], [200, 0, 0]), "its name and colour stand below");
        assert!(write_ways_png([400, 100], &[0; 3], 10.0, &[], Vec::new()).is_err());
        let mut bytes = Vec::new();
        let values: Vec<f64> = (0..300).map(f64::from).collect();
        let curve =
            Curve { values: &values, name: "area (m2)", most: 400.0, events: &[(50.0, "met")], colour: [0, 0, 200] };
        write_curve_png(&curve, &mut bytes).unwrap();
        assert!(has(&decode(&bytes).2, [0, 0, 200]));
        write_curve_png(&Curve { values: &[], events: &[], ..curve }, Vec::new()).unwrap();
    }
}
