//! Cholesky factorisation of the panels, column of blocks by column of blocks from those to its left. Panels are
//! column-major, `height * B` by `width * B` numbers.

use super::substitution::Substitution;
use super::symbolic::{NONE, Pattern};
use super::{Block, CHUNK};

/// What a factorisation needs besides its result.
pub(super) struct Work {
    /// Place of each row among those of the present run.
    place_of_row: Vec<usize>,
    /// The first run whose next row is this column, and the next such run after each run.
    first_run: Vec<usize>,
    next_run: Vec<usize>,
    /// How many rows of a run are done.
    done: Vec<usize>,
    /// Columns that are as high as the highest panel.
    pub(super) product: Vec<f64>,
    /// Zeros but while right-hand sides of few entries are solved for.
    pub(super) sparse: Vec<f64>,
}

impl Work {
    pub(super) fn new<const B: usize>(pattern: &Pattern) -> Self {
        let (variables, runs) = (pattern.variables(), pattern.runs.len());
        let highest = pattern.runs.iter().map(|run| run.height).max().unwrap_or(0);
        Self {
            place_of_row: vec![0; variables],
            first_run: vec![NONE; variables],
            next_run: vec![NONE; runs],
            done: vec![0; runs],
            product: vec![0.0; B * (highest * B + CHUNK)],
            sparse: Vec::new(),
        }
    }

    /// Puts a run where the next of its rows, if there is one, will look for it.
    fn enqueue(&mut self, pattern: &Pattern, run: usize) {
        let Some(&row) = pattern.rows_of(&pattern.runs[run]).get(self.done[run]) else { return };
        self.next_run[run] = self.first_run[row];
        self.first_run[row] = run;
    }
}

/// `A = L L^T` and `x := L^-1 x`, each panel as soon as it is made; false where the matrix is not positive definite.
pub(super) struct Factorisation<'a, const B: usize> {
    pub(super) pattern: &'a Pattern,
    pub(super) values: &'a [Block<B>],
    pub(super) factor: &'a mut [f64],
    pub(super) work: &'a mut Work,
    pub(super) x: &'a mut [f64],
}

impl<const B: usize> pulp::WithSimd for Factorisation<'_, B> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(mut self, _: S) -> bool {
        self.work.first_run.fill(NONE);
        for run in 0..self.pattern.runs.len() {
            self.begin(run);
            for column in 0..self.pattern.runs[run].width {
                self.subtract_earlier_runs::<S>(run, column);
                self.subtract_earlier_columns::<S>(run, column);
                if !self.finish(run, column) {
                    return false;
                }
            }
            self.work.done[run] = self.pattern.runs[run].width;
            self.work.enqueue(self.pattern, run);
            let Self { pattern, factor, work, x, .. } = &mut self;
            Substitution::<B> { pattern, factor, temporary: &mut work.product, x }.forwards(run);
        }
        true
    }
}

impl<const B: usize> Factorisation<'_, B> {
    /// The matrix's own blocks to their places.
    #[inline(always)]
    fn begin(&mut self, at: usize) {
        let (pattern, run) = (self.pattern, &self.pattern.runs[at]);
        for (place, &row) in pattern.rows_of(run).iter().enumerate() {
            self.work.place_of_row[row] = place;
        }
        let (start, length) = (run.start::<B>(at), run.height * B);
        self.factor[start..][..run.width * B * length].fill(0.0);
        for column in 0..run.width {
            for block in pattern.starts[run.first + column]..pattern.starts[run.first + column + 1] {
                let corner = start + column * B * length + pattern.places[block] * B;
                for (c, values) in self.values[block].iter().enumerate() {
                    self.factor[corner + c * length..][..B].copy_from_slice(values);
                }
            }
        }
    }

    /// Takes from a column what the runs to its left have in common with it.
    #[inline(always)]
    fn subtract_earlier_runs<S: pulp::Simd>(&mut self, at: usize, column: usize) {
        let (pattern, run) = (self.pattern, &self.pattern.runs[at]);
        let length = run.height * B;
        let target = run.start::<B>(at) + column * B * length;
        let mut next = self.work.first_run[run.first + column];
        while next != NONE {
            let (other, done) = (next, self.work.done[next]);
            next = self.work.next_run[other];
            let earlier = &pattern.runs[other];
            let rows = &pattern.rows_of(earlier)[done..];
            let (panel, high) = (&self.factor[earlier.start::<B>(other)..], earlier.height * B);
            multiply::<S, B>(panel, high, done * B, earlier.width * B, &mut self.work.product);
            for (place, &row) in rows.iter().enumerate() {
                let corner = target + self.work.place_of_row[row] * B;
                for c in 0..B {
                    let product = &self.work.product[c * (high - done * B + CHUNK) + place * B..];
                    subtract_block::<B>(&mut self.factor[corner + c * length..], product);
                }
            }
            self.work.done[other] += 1;
            self.work.enqueue(pattern, other);
        }
    }

    /// Takes from a column what the earlier ones of its run have in common with it.
    #[inline(always)]
    fn subtract_earlier_columns<S: pulp::Simd>(&mut self, at: usize, column: usize) {
        let run = &self.pattern.runs[at];
        let (start, length, done) = (run.start::<B>(at), run.height * B, column * B);
        if column == 0 {
            return;
        }
        multiply::<S, B>(&self.factor[start..], length, done, done, &mut self.work.product);
        for c in 0..B {
            let target = &mut self.factor[start + (done + c) * length + done..][..length - done];
            subtract(target, &self.work.product[c * (length - done + CHUNK)..][..length - done]);
        }
    }

    /// Diagonal block to its Cholesky factor, what is below divided by it; not where a pivot is not positive.
    #[inline(always)]
    fn finish(&mut self, at: usize, column: usize) -> bool {
        let run = &self.pattern.runs[at];
        let (length, done) = (run.height * B, column * B);
        let columns = &mut self.factor[run.start::<B>(at) + done * length..][..B * length];
        for c in 0..B {
            let (left, rest) = columns.split_at_mut(c * length);
            let own = &mut rest[done + c..length];
            for k in 0..c {
                let earlier = &left[k * length + done + c..(k + 1) * length];
                let factor = earlier[0];
                own.iter_mut().zip(earlier).for_each(|(value, e)| *value -= factor * e);
            }
            let inverse = 1.0 / own[0].sqrt();
            // neither zero, nor negative, nor NaN
            if !inverse.is_finite() {
                return false;
            }
            own.iter_mut().for_each(|value| *value *= inverse);
        }
        true
    }
}

/// `P[from..] P[from..from + B]^T` over the first columns of a panel `P` with columns of some length; columns of the product
/// are longer by [`CHUNK`] than those of `P[from..]`.
#[inline(always)]
fn multiply<S: pulp::Simd, const B: usize>(
    panel: &[f64],
    length: usize,
    from: usize,
    columns: usize,
    product: &mut [f64],
) {
    let (rows, mut first) = (length - from, 0);
    // as many sums at once as registers hold; each is the same sum however many there are
    if S::F64_LANES >= 8 && B < 4 {
        while first + 3 * CHUNK < rows {
            multiply_rows::<B, { 4 * CHUNK }>(panel, length, from, columns, first, product);
            first += 4 * CHUNK;
        }
    }
    if S::F64_LANES >= 8 || B < 4 {
        while first + CHUNK < rows {
            multiply_rows::<B, { 2 * CHUNK }>(panel, length, from, columns, first, product);
            first += 2 * CHUNK;
        }
    }
    while first < rows {
        multiply_rows::<B, CHUNK>(panel, length, from, columns, first, product);
        first += CHUNK;
    }
}

/// Some rows of the product.
#[inline(always)]
fn multiply_rows<const B: usize, const R: usize>(
    panel: &[f64],
    length: usize,
    from: usize,
    columns: usize,
    first: usize,
    product: &mut [f64],
) {
    let mut sums = [[0.0; R]; B];
    for k in 0..columns {
        let column = &panel[k * length + from..];
        let (Some(right), Some(left)) = (column.first_chunk::<B>(), column[first..].first_chunk::<R>()) else {
            break;
        };
        for c in 0..B {
            for r in 0..R {
                sums[c][r] = left[r].mul_add(right[c], sums[c][r]);
            }
        }
    }
    for c in 0..B {
        product[c * (length - from + CHUNK) + first..][..R].copy_from_slice(&sums[c]);
    }
}

#[inline(always)]
fn subtract_block<const B: usize>(target: &mut [f64], product: &[f64]) {
    if let (Some(target), Some(product)) = (target.first_chunk_mut::<B>(), product.first_chunk::<B>()) {
        for r in 0..B {
            target[r] -= product[r];
        }
    }
}

#[inline(always)]
fn subtract(target: &mut [f64], product: &[f64]) {
    target.iter_mut().zip(product).for_each(|(t, p)| *t -= p);
}
