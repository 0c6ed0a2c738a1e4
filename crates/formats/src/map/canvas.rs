//! Drawing into a picture. Plain arithmetic only, so that the same map gives the same bytes everywhere.

/// Red, green, blue.
pub(super) type Colour = [u8; 3];

/// Between two colours, `share` from 0 to 1.
pub(super) fn blend(from: Colour, to: Colour, share: f32) -> Colour {
    std::array::from_fn(|k| {
        let (a, b) = (f32::from(from[k]), f32::from(to[k]));
        (a + (b - a) * share + 0.5) as u8
    })
}

/// Pixels, the top row first.
#[derive(Debug)]
pub(super) struct Canvas {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) pixels: Vec<Colour>,
}

impl Canvas {
    pub(super) fn new(width: usize, height: usize, background: Colour) -> Self {
        Self { width, height, pixels: vec![background; width * height] }
    }

    /// The pixels of one row.
    pub(super) fn row(&mut self, y: usize) -> &mut [Colour] {
        &mut self.pixels[y * self.width..(y + 1) * self.width]
    }

    /// A straight stroke with round ends; `from` and `to` in pixels, pixel centres at halves.
    pub(super) fn stroke(&mut self, from: [f32; 2], to: [f32; 2], half_width: f32, colour: Colour) {
        let reach = half_width + 1.0;
        let rows = clip(from[1].min(to[1]) - reach, from[1].max(to[1]) + reach, self.height);
        for y in rows {
            let [left, right] = span_near_row(from, to, y as f32 + 0.5, reach);
            let columns = clip(left - reach, right + reach, self.width);
            for (x, pixel) in columns.clone().zip(&mut self.row(y)[columns]) {
                let centre = [x as f32 + 0.5, y as f32 + 0.5];
                let cover = half_width + 0.5 - distance_to_segment(centre, from, to);
                if cover > 0.0 {
                    *pixel = blend(*pixel, colour, cover.min(1.0));
                }
            }
        }
    }

    /// A filled disc with a white rim.
    pub(super) fn marker(&mut self, centre: [f32; 2], radius: f32, colour: Colour) {
        self.stroke(centre, centre, radius * 1.35, [255; 3]);
        self.stroke(centre, centre, radius, colour);
    }

    /// A filled square with a white rim; `half` is half its side.
    pub(super) fn square(&mut self, centre: [f32; 2], half: f32, colour: Colour) {
        for (half, colour) in [(1.35 * half, [255; 3]), (half, colour)] {
            let [left, top] = centre.map(|at| (at - half).round().max(0.0) as usize);
            let [right, bottom] = centre.map(|at| (at + half).round().max(0.0) as usize);
            self.rectangle(left, top, right.saturating_sub(left), bottom.saturating_sub(top), colour);
        }
    }

    /// A filled triangle that points upwards, with a white rim; `half` is half its base.
    pub(super) fn triangle(&mut self, [x, y]: [f32; 2], half: f32, colour: Colour) {
        for (half, colour) in [(1.5 * half, [255; 3]), (half, colour)] {
            let bottom = y + 0.8 * half;
            for row in clip(y - half, bottom, self.height) {
                // The sides rise by 1.8 halves over one.
                let middle = row as f32 + 0.5;
                let reach = ((middle - (y - half)) / 1.8).min(half);
                if reach > 0.0 && middle <= bottom {
                    let left = (x - reach).round().max(0.0) as usize;
                    let right = (x + reach).round().max(0.0) as usize;
                    self.rectangle(left, row, right.saturating_sub(left), 1, colour);
                }
            }
        }
    }

    /// An upright filled rectangle.
    pub(super) fn rectangle(&mut self, left: usize, top: usize, width: usize, height: usize, colour: Colour) {
        let columns = left.min(self.width)..left.saturating_add(width).min(self.width);
        for y in top.min(self.height)..top.saturating_add(height).min(self.height) {
            self.row(y)[columns.clone()].fill(colour);
        }
    }

    /// Strokes of one letter: where they meet they cover no more than one of them.
    pub(super) fn strokes_as_one(&mut self, strokes: &[[[f32; 2]; 2]], half_width: f32, colour: Colour) {
        let reach = half_width + 1.0;
        let bounds = |k: usize| {
            let along = || strokes.iter().flatten().map(|place| place[k]);
            [along().fold(f32::INFINITY, f32::min) - reach, along().fold(f32::NEG_INFINITY, f32::max) + reach]
        };
        let [[left, right], [top, bottom]] = [bounds(0), bounds(1)];
        for y in clip(top, bottom, self.height) {
            let columns = clip(left, right, self.width);
            for (x, pixel) in columns.clone().zip(&mut self.row(y)[columns]) {
                let centre = [x as f32 + 0.5, y as f32 + 0.5];
                let away = strokes.iter().map(|[from, to]| distance_to_segment(centre, *from, *to));
                let cover = half_width + 0.5 - away.fold(f32::INFINITY, f32::min);
                if cover > 0.0 {
                    *pixel = blend(*pixel, colour, cover.min(1.0));
                }
            }
        }
    }
}

/// The whole numbers from `low` to `high` that lie in `0..limit`.
fn clip(low: f32, high: f32, limit: usize) -> std::ops::Range<usize> {
    // Casts saturate; what is not a number becomes zero.
    let from = (low.max(0.0) as usize).min(limit);
    from..((high.max(0.0) as usize).saturating_add(1)).clamp(from, limit)
}

/// The leftmost and rightmost x of the part of a segment within `reach` of the row at `y`.
fn span_near_row(from: [f32; 2], to: [f32; 2], y: f32, reach: f32) -> [f32; 2] {
    let rise = to[1] - from[1];
    if rise.abs() < 1e-3 {
        return [from[0].min(to[0]), from[0].max(to[0])];
    }
    let at = |y: f32| from[0] + (to[0] - from[0]) * ((y - from[1]) / rise).clamp(0.0, 1.0);
    let (a, b) = (at(y - reach), at(y + reach));
    [a.min(b), a.max(b)]
}

fn distance_to_segment(point: [f32; 2], from: [f32; 2], to: [f32; 2]) -> f32 {
    let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
    let (px, py) = (point[0] - from[0], point[1] - from[1]);
    let length2 = dx * dx + dy * dy;
    let along = if length2 > 0.0 { ((px * dx + py * dy) / length2).clamp(0.0, 1.0) } else { 0.0 };
    let (ex, ey) = (px - along * dx, py - along * dy);
    (ex * ex + ey * ey).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn strokes_cover_their_line_and_stay_within_the_picture() {
        let mut canvas = Canvas::new(40, 30, [0; 3]);
        canvas.stroke([5.0, 5.0], [35.0, 25.0], 1.0, [255; 3]);
        assert_eq!(canvas.pixels[15 * 40 + 20], [255; 3]);
        assert_eq!(canvas.pixels[5 * 40 + 30], [0; 3]);
        canvas.stroke([-1e9, -1e9], [1e9, 1e9], 2.0, [9; 3]);
        canvas.stroke([f32::NAN, 0.0], [3.0, f32::INFINITY], 2.0, [9; 3]);
        canvas.text("12.5 km", [30.0, 45.0], 3.0, [1; 3]);
        canvas.text("12.5 km", [-1e9, f32::NAN], 3.0, [1; 3]);
        canvas.strokes_as_one(&[], 1.0, [1; 3]);
        canvas.square([-1e9, f32::NAN], 1e9, [1; 3]);
        canvas.triangle([f32::NAN, 1e30], f32::INFINITY, [1; 3]);
        canvas.square([1e30, f32::INFINITY], f32::INFINITY, [1; 3]);
    }
}
