//! A uniform grid over everything that stands still, so that a ray looks only at what lies on its way.

use crate::math::{Point, cross, sub};
use crate::shape::{Circle, Segment};

const CELL_M: f64 = 0.5;
/// Above this the cells grow instead of their number.
const MOST_CELLS: f64 = 4e6;
/// Cells reach this far beyond their edges, metres: more than rounding can move a ray.
const SKIN_M: f64 = 1e-6;

/// Where a cell's shapes begin in the two lists; they end where the next cell's begin.
#[derive(Debug, Clone, Copy, Default)]
struct Start {
    segment: u32,
    circle: u32,
}

#[derive(Debug, Clone)]
pub(crate) struct Grid {
    origin: Point,
    cell_m: f64,
    columns: usize,
    rows: usize,
    starts: Vec<Start>,
    // Copied into the order of the cells: a visit reads one stretch of memory.
    segments: Vec<Segment>,
    circles: Vec<Circle>,
}

impl Grid {
    pub(crate) fn new(segments: &[Segment], circles: &[Circle]) -> Self {
        let (low, high) = bounds(segments, circles);
        let cell_m = CELL_M.max(((high[0] - low[0]) * (high[1] - low[1]) / MOST_CELLS).sqrt());
        let origin = [low[0] - 0.5 * cell_m, low[1] - 0.5 * cell_m];
        let cells_along = |axis: usize| ((high[axis] - low[axis]) / cell_m) as usize + 2;
        let (columns, rows) = (cells_along(0), cells_along(1));
        let empty = Self {
            origin,
            cell_m,
            columns,
            rows,
            starts: vec![],
            segments: vec![],
            circles: vec![],
        };
        empty.filled(segments, circles)
    }

    fn filled(mut self, segments: &[Segment], circles: &[Circle]) -> Self {
        let segment_cells: Vec<Vec<usize>> = segments.iter().map(|s| self.cells_of_segment(s)).collect();
        let circle_cells: Vec<Vec<usize>> = circles.iter().map(|c| self.cells_of_circle(c)).collect();
        let (segment_starts, segments) = in_cell_order(segments, &segment_cells, self.columns * self.rows);
        let (circle_starts, circles) = in_cell_order(circles, &circle_cells, self.columns * self.rows);
        let pair = |(segment, circle)| Start { segment, circle };
        self.starts = segment_starts.into_iter().zip(circle_starts).map(pair).collect();
        self.segments = segments;
        self.circles = circles;
        self
    }

    /// Distance to the first hit along the ray, metres; infinite where there is none within `longest_m`.
    pub(crate) fn cast(&self, origin: Point, direction: Point, longest_m: f64) -> f64 {
        let Some(mut walk) = Walk::enter(self, origin, direction, longest_m) else {
            return f64::INFINITY;
        };
        let mut nearest_m = f64::INFINITY;
        loop {
            nearest_m = self.nearest_in_cell(walk.cell(self.columns), origin, direction, nearest_m);
            let exit_m = walk.exit_m();
            if nearest_m <= exit_m || exit_m > longest_m || !walk.step() {
                break;
            }
        }
        if nearest_m <= longest_m {
            nearest_m
        } else {
            f64::INFINITY
        }
    }

    #[inline]
    fn nearest_in_cell(&self, cell: usize, origin: Point, direction: Point, mut nearest_m: f64) -> f64 {
        let (from, to) = (self.starts[cell], self.starts[cell + 1]);
        for segment in &self.segments[from.segment as usize..to.segment as usize] {
            nearest_m = nearest_m.min(segment.cast(origin, direction));
        }
        for circle in &self.circles[from.circle as usize..to.circle as usize] {
            nearest_m = nearest_m.min(circle.cast(origin, direction));
        }
        nearest_m
    }

    fn cells_of_segment(&self, segment: &Segment) -> Vec<usize> {
        let Segment { a, b } = *segment;
        let low = [a[0].min(b[0]), a[1].min(b[1])];
        let high = [a[0].max(b[0]), a[1].max(b[1])];
        let along = sub(b, a);
        // Separating axis: the cell's corners must not all lie on one side of the line.
        let reach = (self.cell_m * 0.5 + SKIN_M) * (along[0].abs() + along[1].abs());
        let touches = |center: Point| cross(along, sub(center, a)).abs() <= reach;
        self.cells_where(low, high, touches)
    }

    fn cells_of_circle(&self, circle: &Circle) -> Vec<usize> {
        let Circle {
            center: [x, y],
            radius_m: r,
        } = *circle;
        self.cells_where([x - r, y - r], [x + r, y + r], |_| true)
    }

    fn cells_where(&self, low: Point, high: Point, touches: impl Fn(Point) -> bool) -> Vec<usize> {
        let index = |value: f64, axis: usize, count: usize| {
            (((value - self.origin[axis]) / self.cell_m).max(0.0) as usize).min(count - 1)
        };
        let (x0, x1) = (
            index(low[0] - SKIN_M, 0, self.columns),
            index(high[0] + SKIN_M, 0, self.columns),
        );
        let (y0, y1) = (
            index(low[1] - SKIN_M, 1, self.rows),
            index(high[1] + SKIN_M, 1, self.rows),
        );
        let center = |i: usize, axis: usize| self.origin[axis] + (i as f64 + 0.5) * self.cell_m;
        let all = (y0..=y1).flat_map(|y| (x0..=x1).map(move |x| (x, y)));
        all.filter(|&(x, y)| touches([center(x, 0), center(y, 1)]))
            .map(|(x, y)| y * self.columns + x)
            .collect()
    }
}

/// Smallest box around all shapes; the unit box where there are none.
fn bounds(segments: &[Segment], circles: &[Circle]) -> (Point, Point) {
    let ends = segments.iter().flat_map(|s| [s.a, s.b]);
    let rims = circles.iter().flat_map(|c| {
        let ([x, y], r) = (c.center, c.radius_m);
        [[x - r, y - r], [x + r, y + r]]
    });
    let start = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    let (low, high) = ends.chain(rims).fold(start, |(low, high), p| {
        (
            [low[0].min(p[0]), low[1].min(p[1])],
            [high[0].max(p[0]), high[1].max(p[1])],
        )
    });
    if low[0].is_finite() && high[0].is_finite() {
        (low, high)
    } else {
        ([0.0; 2], [1.0; 2])
    }
}

/// Copies of the shapes sorted by cell, and where each cell's stretch begins (one entry more than cells).
fn in_cell_order<T: Copy>(shapes: &[T], cells_of_shape: &[Vec<usize>], cells: usize) -> (Vec<u32>, Vec<T>) {
    let mut pairs: Vec<(u32, u32)> = cells_of_shape
        .iter()
        .enumerate()
        .flat_map(|(shape, cells)| cells.iter().map(move |&cell| (cell as u32, shape as u32)))
        .collect();
    pairs.sort_unstable();
    let mut starts = vec![0u32; cells + 1];
    for &(cell, _) in &pairs {
        starts[cell as usize + 1] += 1;
    }
    for cell in 0..cells {
        starts[cell + 1] += starts[cell];
    }
    (starts, pairs.iter().map(|&(_, shape)| shapes[shape as usize]).collect())
}

/// A ray's way through the cells (Amanatides and Woo 1987).
struct Walk {
    cell: [i64; 2],
    step: [i64; 2],
    count: [i64; 2],
    next_m: [f64; 2],
    delta_m: [f64; 2],
}

impl Walk {
    fn enter(grid: &Grid, origin: Point, direction: Point, longest_m: f64) -> Option<Self> {
        let size = [grid.columns as f64 * grid.cell_m, grid.rows as f64 * grid.cell_m];
        let inverse = [1.0 / direction[0], 1.0 / direction[1]];
        let enter_m = entry_m(sub(origin, grid.origin), inverse, size)?;
        if enter_m > longest_m || direction == [0.0; 2] {
            return None;
        }
        let count = [grid.columns as i64, grid.rows as i64];
        let mut walk = Self {
            cell: [0; 2],
            step: [0; 2],
            count,
            next_m: [0.0; 2],
            delta_m: [0.0; 2],
        };
        for axis in 0..2 {
            let local = origin[axis] + enter_m * direction[axis] - grid.origin[axis];
            let cell = ((local / grid.cell_m) as i64).clamp(0, count[axis] - 1);
            let ahead = if direction[axis] > 0.0 { cell + 1 } else { cell };
            let edge = grid.origin[axis] + ahead as f64 * grid.cell_m;
            walk.cell[axis] = cell;
            walk.step[axis] = if direction[axis] > 0.0 { 1 } else { -1 };
            walk.delta_m[axis] = (grid.cell_m * inverse[axis]).abs();
            walk.next_m[axis] = if direction[axis] == 0.0 {
                f64::INFINITY
            } else {
                (edge - origin[axis]) * inverse[axis]
            };
        }
        Some(walk)
    }

    #[inline]
    fn cell(&self, columns: usize) -> usize {
        self.cell[1] as usize * columns + self.cell[0] as usize
    }

    /// Where the ray leaves the current cell, metres from its origin.
    #[inline]
    fn exit_m(&self) -> f64 {
        self.next_m[0].min(self.next_m[1])
    }

    /// Moves on to the next cell; false where the ray leaves the grid.
    #[inline]
    fn step(&mut self) -> bool {
        let axis = usize::from(self.next_m[1] < self.next_m[0]);
        self.cell[axis] += self.step[axis];
        self.next_m[axis] += self.delta_m[axis];
        (0..self.count[axis]).contains(&self.cell[axis])
    }
}

/// Distance at which a ray from `local` enters the box from zero to `size`, zero inside; `None` where it misses or
/// anything is not finite.
fn entry_m(local: Point, inverse: Point, size: Point) -> Option<f64> {
    let (mut enter_m, mut leave_m) = (0.0f64, f64::INFINITY);
    for axis in 0..2 {
        if !local[axis].is_finite() || inverse[axis].is_nan() {
            return None;
        }
        if inverse[axis].is_infinite() {
            if local[axis] < 0.0 || local[axis] > size[axis] {
                return None;
            }
            continue;
        }
        let (a, b) = (-local[axis] * inverse[axis], (size[axis] - local[axis]) * inverse[axis]);
        enter_m = enter_m.max(a.min(b));
        leave_m = leave_m.min(a.max(b));
    }
    (enter_m <= leave_m).then_some(enter_m)
}
