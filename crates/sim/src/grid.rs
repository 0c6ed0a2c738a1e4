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
        // One empty cell all around, into which rounding may push a ray that has just left everything behind.
        let origin = [low[0] - cell_m, low[1] - cell_m];
        let cells_along = |axis: usize| ((high[axis] - low[axis]) / cell_m) as usize + 3;
        let (columns, rows) = (cells_along(0), cells_along(1));
        let empty = Self { origin, cell_m, columns, rows, starts: vec![], segments: vec![], circles: vec![] };
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
        while let Some(&[from, to]) = self.starts.get(walk.cell..).and_then(|rest| rest.first_chunk()) {
            nearest_m = self.nearest_of(from, to, origin, direction, nearest_m);
            if nearest_m.min(walk.last_m) <= walk.exit_m() {
                break;
            }
            walk.step();
        }
        if nearest_m <= longest_m { nearest_m } else { f64::INFINITY }
    }

    #[inline]
    fn nearest_of(&self, from: Start, to: Start, origin: Point, direction: Point, mut nearest_m: f64) -> f64 {
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
        let Circle { center: [x, y], radius_m: r } = *circle;
        self.cells_where([x - r, y - r], [x + r, y + r], |_| true)
    }

    fn cells_where(&self, low: Point, high: Point, touches: impl Fn(Point) -> bool) -> Vec<usize> {
        let index = |value: f64, axis: usize, count: usize| {
            (((value - self.origin[axis]) / self.cell_m).max(0.0) as usize).min(count - 1)
        };
        let (x0, x1) = (index(low[0] - SKIN_M, 0, self.columns), index(high[0] + SKIN_M, 0, self.columns));
        let (y0, y1) = (index(low[1] - SKIN_M, 1, self.rows), index(high[1] + SKIN_M, 1, self.rows));
        let center = |i: usize, axis: usize| self.origin[axis] + (i as f64 + 0.5) * self.cell_m;
        let all = (y0..=y1).flat_map(|y| (x0..=x1).map(move |x| (x, y)));
        all.filter(|&(x, y)| touches([center(x, 0), center(y, 1)])).map(|(x, y)| y * self.columns + x).collect()
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
    let (low, high) = ends
        .chain(rims)
        .fold(start, |(low, high), p| ([low[0].min(p[0]), low[1].min(p[1])], [high[0].max(p[0]), high[1].max(p[1])]));
    if low[0].is_finite() && high[0].is_finite() { (low, high) } else { ([0.0; 2], [1.0; 2]) }
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

/// A ray's way through the cells (Amanatides and Woo 1987). Steps are selected, not branched on: which axis comes next
/// cannot be foreseen.
struct Walk {
    cell: usize,
    /// What the cell's number grows by, modulo 2^64, for a step along each axis.
    step: [usize; 2],
    next_x_m: f64,
    next_y_m: f64,
    delta_m: [f64; 2],
    /// Where the ray leaves everything behind or becomes too long.
    last_m: f64,
}

impl Walk {
    fn enter(grid: &Grid, origin: Point, direction: Point, longest_m: f64) -> Option<Self> {
        let m = grid.cell_m;
        let inner = [(grid.columns - 2) as f64 * m, (grid.rows - 2) as f64 * m];
        let inverse = [1.0 / direction[0], 1.0 / direction[1]];
        let local = [origin[0] - grid.origin[0], origin[1] - grid.origin[1]];
        let (enter_m, leave_m) = span_m([local[0] - m, local[1] - m], inverse, inner)?;
        if enter_m > longest_m || direction == [0.0; 2] {
            return None;
        }
        let start = |axis: usize, count: usize| {
            let cell = ((local[axis] + enter_m * direction[axis]) / m).clamp(1.0, count as f64 - 2.0) as usize;
            let ahead = cell + usize::from(direction[axis] > 0.0);
            let next_m = (ahead as f64 * m - local[axis]) * inverse[axis];
            (cell, if direction[axis] == 0.0 { f64::INFINITY } else { next_m })
        };
        let ((column, next_x_m), (row, next_y_m)) = (start(0, grid.columns), start(1, grid.rows));
        let signed = |axis: usize, size: usize| {
            if direction[axis] > 0.0 { size } else { size.wrapping_neg() }
        };
        Some(Self {
            cell: row * grid.columns + column,
            step: [signed(0, 1), signed(1, grid.columns)],
            next_x_m,
            next_y_m,
            delta_m: [(m * inverse[0]).abs(), (m * inverse[1]).abs()],
            last_m: leave_m.min(longest_m),
        })
    }

    /// Where the ray leaves the current cell, metres from its origin.
    #[inline]
    fn exit_m(&self) -> f64 {
        self.next_x_m.min(self.next_y_m)
    }

    #[inline]
    fn step(&mut self) {
        let along_x = self.next_x_m <= self.next_y_m;
        self.cell = self.cell.wrapping_add(if along_x { self.step[0] } else { self.step[1] });
        self.next_x_m += if along_x { self.delta_m[0] } else { 0.0 };
        self.next_y_m += if along_x { 0.0 } else { self.delta_m[1] };
    }
}

/// Where a ray from `local` enters and leaves the box from zero to `size`, metres along it; `None` where it misses or
/// anything is not finite.
fn span_m(local: Point, inverse: Point, size: Point) -> Option<(f64, f64)> {
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
    (enter_m <= leave_m).then_some((enter_m, leave_m))
}
