//! The strip below a picture: a scale bar, and what its colours and marks stand for.

use super::canvas::{Canvas, Colour, blend};
use super::confidence::{CERTAIN, PLACE, UNCERTAIN};
use super::font;
use super::palette::{END, INK, MARGIN_PX, START, way_colour};

/// Height of a strip of one line, pixels.
const STRIP_PX: usize = 28;
/// From one line to the next, and between two items of a line, in widths of a pen.
const LINE: usize = 22;
const GAP: usize = 28;
/// Between the parts of an item.
const SPACE: usize = 6;
/// Length of a bar of colours, and of a stroke.
const BAR: usize = 96;
const STROKE: usize = 24;
/// Radius of a mark.
const MARK: usize = 5;

/// What can stand there.
#[derive(Debug, Clone)]
pub(super) enum Item {
    /// A round length, about a fifth of the picture wide.
    ScaleBar { px_per_metre: f64 },
    /// The way's marks and colours.
    Way,
    /// A numbered place.
    Places,
    /// The tint of free space, and where it is full, metres.
    Uncertainty { full_m: f32 },
    /// Lines of a colour, by name.
    Lines(Colour, &'static str),
    /// Heights as colours, from the lowest to the highest, metres.
    Heights { colour_at: fn(f32) -> Colour, low_m: f32, high_m: f32 },
}

/// A piece of an item.
enum Part {
    Text(String),
    Mark(Colour, &'static str),
    Bar(fn(f32) -> Colour),
    Stroke(Colour),
    Ruler(usize),
}

impl Part {
    fn width(&self, pen: usize) -> usize {
        match self {
            Self::Text(text) => text_width(text, pen),
            Self::Mark(_, "") => 2 * MARK * pen,
            Self::Mark(..) => 4 * MARK * pen,
            Self::Bar(_) => BAR * pen,
            Self::Stroke(_) => STROKE * pen,
            Self::Ruler(length_px) => *length_px,
        }
    }

    /// On the line whose letters have their feet at `bottom`.
    fn draw(&self, canvas: &mut Canvas, left: usize, bottom: usize, pen: usize) {
        let tall = font::HEIGHT_PX * 2 * pen;
        let top = bottom.saturating_sub(tall);
        let middle = (top + tall / 2) as f32;
        match self {
            Self::Text(text) => canvas.text(text, left, top, 2 * pen, INK),
            Self::Mark(colour, text) => {
                let centre = [left as f32 + 0.5 * self.width(pen) as f32, middle];
                let radius = if text.is_empty() { MARK * pen } else { 2 * MARK * pen - pen };
                canvas.marker(centre, radius as f32, *colour);
                let letter = left + self.width(pen).saturating_sub(5 * 2 * pen) / 2;
                canvas.text(text, letter, top, 2 * pen, [255; 3]);
            }
            Self::Bar(colour_at) => {
                let length = self.width(pen);
                canvas.rectangle(left.saturating_sub(1), top.saturating_sub(1), length + 2, tall + 2, INK);
                for x in 0..length {
                    canvas.rectangle(left + x, top, 1, tall, colour_at(x as f32 / length as f32));
                }
            }
            Self::Stroke(colour) => {
                let ends = [left, left + self.width(pen)].map(|x| [x as f32, middle]);
                canvas.stroke(ends[0], ends[1], 1.2 * pen as f32, *colour);
            }
            Self::Ruler(length_px) => {
                canvas.rectangle(left, bottom.saturating_sub(2 * pen), *length_px, 2 * pen, INK);
                for end in [left, left + length_px.saturating_sub(2 * pen)] {
                    canvas.rectangle(end, bottom.saturating_sub(8 * pen), 2 * pen, 8 * pen, INK);
                }
            }
        }
    }
}

impl Item {
    fn parts(&self, width_px: usize) -> Vec<Part> {
        let text = |text: &str| Part::Text(text.to_owned());
        match *self {
            Self::ScaleBar { px_per_metre } => {
                let length_m = round_length(0.2 * width_px as f64 / px_per_metre);
                let length_px = ((length_m * px_per_metre).round() as usize).max(1);
                vec![Part::Ruler(length_px), text(&length_label(length_m))]
            }
            Self::Way => {
                vec![Part::Mark(START, ""), text("start"), Part::Bar(way_colour), text("end"), Part::Mark(END, "")]
            }
            Self::Places => vec![Part::Mark(PLACE, "1"), text("drive here next")],
            Self::Uncertainty { full_m } => vec![
                text("known to ±0"),
                Part::Bar(|share| blend(CERTAIN, UNCERTAIN, share)),
                text(&format!("±{full_m} m")),
            ],
            Self::Lines(colour, name) => vec![Part::Stroke(colour), text(name)],
            Self::Heights { colour_at, low_m, high_m } => {
                // Zero has no sign.
                let label = |height_m: f32| format!("{:.1} m", (10.0 * height_m).round() / 10.0 + 0.0);
                vec![text(&format!("height {}", label(low_m))), Part::Bar(colour_at), text(&label(high_m))]
            }
        }
    }

    fn width(&self, width_px: usize, pen: usize) -> usize {
        let parts = self.parts(width_px);
        let gaps = parts.len().saturating_sub(1) * SPACE * pen;
        parts.iter().map(|part| part.width(pen)).sum::<usize>() + gaps
    }
}

/// The lines of a strip in a picture of some width.
#[derive(Debug, Clone)]
pub(super) struct Footer {
    /// Each item with its line and its left end, pixels.
    placed: Vec<(Item, usize, usize)>,
    width_px: usize,
    lines: usize,
    pen: usize,
}

impl Footer {
    /// Items from left to right, line by line; one that is wider than the picture is left out.
    pub(super) fn of(items: Vec<Item>, width_px: usize, pen: usize) -> Self {
        let room = width_px.saturating_sub(2 * MARGIN_PX);
        let (mut placed, mut line, mut end) = (Vec::new(), 0, 0);
        for item in items {
            let width = item.width(width_px, pen);
            if width > room {
                continue;
            }
            let mut left = if end == 0 { 0 } else { end + GAP * pen };
            if left + width > room {
                (line, left) = (line + 1, 0);
            }
            end = left + width;
            placed.push((item, line, left));
        }
        let lines = if placed.is_empty() { 0 } else { line + 1 };
        Self { placed, width_px, lines, pen }
    }

    /// What it takes of a picture's height, pixels.
    pub(super) fn height_px(&self) -> usize {
        match self.lines {
            0 => 0,
            lines => STRIP_PX + (lines - 1) * LINE * self.pen,
        }
    }

    /// Draws it at the picture's lower edge.
    pub(super) fn draw(&self, canvas: &mut Canvas) {
        let last = canvas.height.saturating_sub(MARGIN_PX / 2);
        for (item, line, left) in &self.placed {
            let bottom = last.saturating_sub((self.lines - 1 - line) * LINE * self.pen);
            let mut left = MARGIN_PX + left;
            for part in item.parts(self.width_px) {
                part.draw(canvas, left, bottom, self.pen);
                left += part.width(self.pen) + SPACE * self.pen;
            }
        }
    }
}

fn text_width(text: &str, pen: usize) -> usize {
    (text.chars().count() * font::ADVANCE_PX).saturating_sub(1) * 2 * pen
}

/// The largest of 1, 2 and 5 times a power of ten that does not exceed `limit_m`.
fn round_length(limit_m: f64) -> f64 {
    let powers = (-7..9).map(|p| 10_f64.powi(p));
    let lengths = powers.flat_map(|p| [p, 2.0 * p, 5.0 * p]);
    lengths.take_while(|&length| length <= limit_m).last().unwrap_or(1e-7)
}

fn length_label(length_m: f64) -> String {
    if length_m >= 1000.0 { format!("{} km", length_m / 1000.0) } else { format!("{length_m} m") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_bar_has_a_round_length() {
        assert_eq!([0.3, 7.3, 10.0, 49.0, 2600.0].map(round_length), [0.2, 5.0, 10.0, 20.0, 2000.0]);
        assert_eq!([0.2, 20.0, 2000.0].map(length_label), ["0.2 m", "20 m", "2 km"]);
    }

    #[test]
    fn items_take_as_many_lines_as_they_need_and_stay_within_the_picture() {
        let items =
            || vec![Item::ScaleBar { px_per_metre: 20.0 }, Item::Way, Item::Places, Item::Uncertainty { full_m: 0.5 }];
        assert_eq!(Footer::of(items(), 1600, 1).lines, 1);
        assert_eq!(Footer::of(vec![], 1600, 1).height_px(), 0);
        let mut lines = 0;
        for width_px in (60..1200).rev() {
            let footer = Footer::of(items(), width_px, 1);
            let ends = footer.placed.iter().map(|(item, _, left)| left + item.width(width_px, 1));
            assert!(ends.max().unwrap_or(0) + 2 * MARGIN_PX <= width_px.max(2 * MARGIN_PX));
            lines = lines.max(footer.lines);
        }
        assert_eq!(lines, 4);
    }

    #[test]
    fn every_word_has_its_letters_and_is_seen() {
        let items = [Item::Way, Item::Places, Item::Uncertainty { full_m: 0.5 }, Item::Lines(START, "closures")];
        let heights = Item::Heights { colour_at: |_| START, low_m: -0.04, high_m: 2.5 };
        let words = items.iter().chain([&heights]).flat_map(|item| item.parts(800));
        for part in words {
            let Part::Text(text) = part else { continue };
            assert!(!text.contains("-0.0"), "{text}");
            for letter in text.chars().filter(|letter| *letter != ' ') {
                assert!(font::glyph(letter) != [0; font::HEIGHT_PX], "{letter:?} of {text:?}");
            }
        }
        let mut canvas = Canvas::new(800, 100, [255; 3]);
        Footer::of(items.to_vec(), 800, 1).draw(&mut canvas);
        for colour in [START, END, PLACE, INK, UNCERTAIN] {
            let near = |p: &&Colour| (0..3).all(|k| p[k].abs_diff(colour[k]) < 8);
            assert!(canvas.pixels.iter().filter(near).count() > 10, "{colour:?}");
        }
    }
}
