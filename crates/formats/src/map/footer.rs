//! The strip below a picture: a scale bar, and what its colours and marks stand for.

use super::canvas::{Canvas, Colour, blend};
use super::confidence::{CERTAIN, UNCERTAIN, draw_place};
use super::font;
use super::palette::{END, INK, MARGIN_PX, START, UNSEEN, way_colour};
use super::runs::{draw_meeting, draw_tag, run_colour};

/// Lengths are widths of a pen, which is a pixel wide in small pictures ([`super::options::pen_of`]).
/// Height of a strip of one line.
const STRIP: f32 = 30.0;
/// From one line to the next, and between two items of a line.
const LINE: f32 = 26.0;
const GAP: f32 = 28.0;
/// Between the parts of an item.
const SPACE: f32 = 7.0;
/// Length of a bar of colours, and of a stroke.
const BAR: f32 = 96.0;
const STROKE: f32 = 24.0;
/// Radius of a mark.
const MARK: f32 = 5.5;
/// The widest item, but for what is said in words.
const WIDEST: f32 = 310.0;
/// A unit of letters: the tall ones are twelve widths of a pen high.
const UNIT: f32 = 0.8;

/// What can stand there.
#[derive(Debug, Clone)]
pub(super) enum Item {
    /// A round length, about a fifth of the picture wide.
    ScaleBar { px_per_metre: f64 },
    /// The way's marks and colours.
    Way,
    /// A numbered place.
    Places,
    /// How often something was seen: from what is hardly seen on the ground of what never was to what is white.
    Seen,
    /// The tint of free space, and where it is full, metres.
    Uncertainty { full_m: f32 },
    /// By how much the picture is turned against the map's own frame, anticlockwise, radians.
    Turned { by_rad: f64 },
    /// A run by its number, which is its colour, its label and its name.
    Run([usize; 2], String),
    /// Where two of these runs met.
    Meeting([usize; 2]),
    /// Lines of a colour, by name.
    Lines(Colour, &'static str),
    /// What is said in words.
    Words(String),
    /// Heights as colours, from the lowest to the highest, metres.
    Heights { colour_at: fn(f32) -> Colour, low_m: f32, high_m: f32 },
}

/// A piece of an item.
enum Part {
    Text(String),
    Start,
    End,
    Place,
    Bar(fn(f32) -> Colour),
    Stroke(Colour),
    Tag([usize; 2]),
    Meeting([usize; 2]),
    Ruler(f32),
}

impl Part {
    /// Pixels.
    fn width(&self, pen: f32) -> f32 {
        match self {
            Self::Text(text) => font::width_px(text, UNIT * pen),
            Self::Start | Self::End => 2.0 * MARK * pen,
            Self::Place | Self::Tag(_) | Self::Meeting(_) => 3.6 * MARK * pen,
            Self::Bar(_) => BAR * pen,
            Self::Stroke(_) => STROKE * pen,
            Self::Ruler(length_px) => *length_px,
        }
    }

    /// On the line whose letters have their feet at `foot`.
    fn draw(&self, canvas: &mut Canvas, left: f32, foot: f32, pen: f32) {
        let unit = UNIT * pen;
        let tall = font::TALL * unit;
        let width = self.width(pen);
        let centre = [left + 0.5 * width, foot - 0.45 * tall];
        match self {
            Self::Text(text) => canvas.text(text, [left, foot], unit, INK),
            Self::Start => canvas.triangle(centre, 1.2 * MARK * pen, START),
            Self::End => canvas.square(centre, MARK * pen, END),
            Self::Place => draw_place(canvas, centre, 1, 0.9 * pen),
            Self::Tag(marks) => draw_tag(canvas, centre, *marks, pen),
            Self::Meeting(pair) => draw_meeting(canvas, centre, *pair, pen),
            Self::Bar(colour_at) => {
                let [x, y, length, height] = [left, foot - tall, width, tall].map(whole);
                let rim = whole(pen);
                canvas.rectangle(x.saturating_sub(rim), y.saturating_sub(rim), length + 2 * rim, height + 2 * rim, INK);
                for at in 0..length {
                    canvas.rectangle(x + at, y, 1, height, colour_at(at as f32 / length as f32));
                }
            }
            Self::Stroke(colour) => canvas.stroke([left, centre[1]], [left + width, centre[1]], 1.2 * pen, *colour),
            Self::Ruler(length_px) => {
                let [x, bottom, length, thick, high] = [left, foot, *length_px, 2.0 * pen, 9.0 * pen].map(whole);
                canvas.rectangle(x, bottom.saturating_sub(thick), length, thick, INK);
                for end in [x, x + length.saturating_sub(thick)] {
                    canvas.rectangle(end, bottom.saturating_sub(high), thick, high, INK);
                }
            }
        }
    }
}

impl Item {
    fn parts(&self, width_px: usize) -> Vec<Part> {
        let text = |text: &str| Part::Text(text.to_owned());
        match self {
            &Self::ScaleBar { px_per_metre } => {
                let length_m = round_length(0.2 * width_px as f64 / px_per_metre);
                let length_px = ((length_m * px_per_metre).round() as f32).max(1.0);
                vec![Part::Ruler(length_px), text(&length_label(length_m))]
            }
            Self::Way => vec![Part::Start, text("start"), Part::Bar(way_colour), text("end"), Part::End],
            Self::Places => vec![Part::Place, text("drive here next")],
            Self::Seen => vec![text("seen once"), Part::Bar(|share| blend(UNSEEN, CERTAIN, share)), text("often")],
            &Self::Uncertainty { full_m } => vec![
                text("known to ±0"),
                Part::Bar(|share| blend(CERTAIN, UNCERTAIN, share)),
                text(&format!("±{full_m} m")),
            ],
            &Self::Turned { by_rad } => {
                let side = if by_rad > 0.0 { "anticlockwise" } else { "clockwise" };
                vec![text(&format!("turned {:.1}° {side}", by_rad.to_degrees().abs()))]
            }
            Self::Run(marks, name) => vec![Part::Stroke(run_colour(marks[0])), Part::Tag(*marks), text(name)],
            Self::Meeting(pair) => vec![Part::Meeting(*pair), text("met here")],
            Self::Words(words) => vec![text(words)],
            &Self::Lines(colour, name) => vec![Part::Stroke(colour), text(name)],
            &Self::Heights { colour_at, low_m, high_m } => {
                // Zero has no sign.
                let label = |height_m: f32| format!("{:.1} m", (10.0 * height_m).round() / 10.0 + 0.0);
                vec![text(&format!("height {}", label(low_m))), Part::Bar(colour_at), text(&label(high_m))]
            }
        }
    }

    /// Whether it has room in a picture of some width with the thinnest pen.
    #[cfg(test)]
    pub(super) fn is_within(&self, width_px: usize) -> bool {
        self.width(width_px, 1.0) <= width_px.saturating_sub(2 * MARGIN_PX) as f32
    }

    fn width(&self, width_px: usize, pen: f32) -> f32 {
        let parts = self.parts(width_px);
        let gaps = parts.len().saturating_sub(1) as f32 * SPACE * pen;
        parts.iter().map(|part| part.width(pen)).sum::<f32>() + gaps
    }
}

/// The lines of a strip in a picture of some width.
#[derive(Debug, Clone)]
pub(super) struct Footer {
    /// Each item with its line and its left end, pixels.
    placed: Vec<(Item, usize, f32)>,
    width_px: usize,
    lines: usize,
    pen: f32,
}

impl Footer {
    /// Items from left to right, line by line; one that is wider than the picture even with the thinnest pen is left out.
    pub(super) fn of(items: Vec<Item>, width_px: usize, pen: f32) -> Self {
        let room = width_px.saturating_sub(2 * MARGIN_PX) as f32;
        // In a tall picture letters are smaller rather than an item left out.
        let pen = pen.min(room / WIDEST).max(1.0);
        let (mut placed, mut line, mut end) = (Vec::new(), 0, 0.0);
        for item in items {
            let width = item.width(width_px, pen);
            if width > room {
                continue;
            }
            let mut left = if end == 0.0 { 0.0 } else { end + GAP * pen };
            if left + width > room {
                (line, left) = (line + 1, 0.0);
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
            lines => whole((STRIP + (lines - 1) as f32 * LINE) * self.pen),
        }
    }

    /// Draws it at the picture's lower edge.
    pub(super) fn draw(&self, canvas: &mut Canvas) {
        let last = canvas.height.saturating_sub(MARGIN_PX) as f32 + 0.3 * STRIP * self.pen.min(1.0);
        for (item, line, left) in &self.placed {
            let foot = last - (self.lines - 1 - line) as f32 * LINE * self.pen;
            let mut left = MARGIN_PX as f32 + left;
            for part in item.parts(self.width_px) {
                part.draw(canvas, left, foot, self.pen);
                left += part.width(self.pen) + SPACE * self.pen;
            }
        }
    }
}

/// The nearest whole number of pixels.
fn whole(px: f32) -> usize {
    px.round().max(0.0) as usize
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
    use super::super::confidence::PLACE;
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
        assert_eq!(Footer::of(items(), 1600, 1.0).lines, 1);
        assert_eq!(Footer::of(vec![], 1600, 1.0).height_px(), 0);
        for pen in [1.0, 2.5] {
            let mut lines = 0;
            for width_px in (60..3000).rev().step_by(3) {
                let footer = Footer::of(items(), width_px, pen);
                let ends = footer.placed.iter().map(|(item, _, left)| left + item.width(width_px, footer.pen));
                let room_px = width_px.saturating_sub(2 * MARGIN_PX) as f32;
                assert!(ends.fold(0.0, f32::max) <= room_px, "{width_px}");
                lines = lines.max(footer.lines);
            }
            assert_eq!(lines, 4);
        }
    }

    #[test]
    fn every_word_has_its_letters_and_is_seen() {
        let items = [
            Item::Way,
            Item::Places,
            Item::Seen,
            Item::Uncertainty { full_m: 0.5 },
            Item::Lines(START, "closures"),
            Item::Words("from above, storey 1 of 2; 0.4 % of the points lie outside".replace(';', ",")),
            Item::Turned { by_rad: 0.5 },
            Item::Turned { by_rad: -0.123 },
        ];
        let heights = Item::Heights { colour_at: |_| START, low_m: -0.04, high_m: 2.5 };
        let words = items.iter().chain([&heights]).flat_map(|item| item.parts(800));
        for part in words {
            let Part::Text(text) = part else { continue };
            assert!(!text.contains("-0.0"), "{text}");
            for letter in text.chars().filter(|letter| *letter != ' ') {
                assert!(font::is_known(letter), "{letter:?} of {text:?}");
            }
        }
        let mut canvas = Canvas::new(800, 200, [255; 3]);
        Footer::of(items.to_vec(), 800, 1.0).draw(&mut canvas);
        for colour in [START, END, PLACE, INK, UNCERTAIN] {
            let near = |p: &&Colour| (0..3).all(|k| p[k].abs_diff(colour[k]) < 8);
            assert!(canvas.pixels.iter().filter(near).count() > 10, "{colour:?}");
        }
    }

    #[test]
    fn letters_are_as_high_in_proportion_in_every_picture() {
        for side_px in [800_usize, 4000] {
            let pen = super::super::options::pen_of(side_px);
            let mut canvas = Canvas::new(side_px, side_px, [255; 3]);
            Footer::of(vec![Item::Lines(START, "closures")], side_px, pen).draw(&mut canvas);
            let is_ink = |y: &usize| canvas.pixels[y * side_px..][..side_px].iter().any(|p| p[0] < 120 && p[1] < 120);
            let rows = (0..side_px).filter(is_ink).count();
            assert!((0.01..0.03).contains(&(rows as f64 / side_px as f64)), "{rows} of {side_px}");
        }
    }
}
