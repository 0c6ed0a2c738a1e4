//! Sparse symmetric systems of `B x B` blocks: ordered and analysed once for a graph, factorised as often as values change.
//!
//! The factor is made column by column from the columns to its left (Davis 2006, "Direct Methods for Sparse Linear
//! Systems", sections 4.2 to 4.8), those of equal pattern together, in blocks whose size the compiler knows. One thread,
//! sums in a fixed order, products fused where that is written: the same bits on every machine.

use crate::error::GraphError;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::SymbolicSparseColMatRef;
use faer::sparse::linalg::amd;
use nalgebra::SMatrix;

/// Largest residual of a solve that passes, relative to `|A| |x| + |b|` in the maximum norm.
const BACKWARD_ERROR: f64 = 1e-9;
/// Blocks of a factor at most: 2 GB of the largest.
const LARGEST_FACTOR: usize = 7_000_000;
/// In place of no column.
const NONE: usize = usize::MAX;

/// Rows that are multiplied at once.
const CHUNK: usize = 8;

/// Which blocks of the lower triangle a matrix and its factor have; in every column the diagonal first, rows ascending.
#[derive(Debug, Clone)]
pub(crate) struct Pattern {
    starts: Vec<usize>,
    rows: Vec<usize>,
    /// For each block of the matrix its row's place among those of its run.
    places: Vec<usize>,
    runs: Vec<Run>,
    /// Rows of the runs: first its own columns, then those below.
    run_rows: Vec<usize>,
    /// The run of each column.
    run_of: Vec<usize>,
}

/// Columns of the factor that differ in pattern by little more than their own diagonals, kept as one dense panel.
#[derive(Debug, Clone, Copy)]
struct Run {
    /// Its first column.
    first: usize,
    /// How many columns there are.
    width: usize,
    /// Where its rows begin in `run_rows`.
    rows: usize,
    /// How many rows there are.
    height: usize,
    /// Blocks in the panels before this one.
    area: usize,
}

impl Run {
    /// Where the panel begins; what follows on one may be read, not used.
    fn start<const B: usize>(&self, at: usize) -> usize {
        self.area * B * B + at * CHUNK
    }
}

/// Where the block of two variables lies.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Slot {
    at: usize,
    /// Whether the block is that of (second, first).
    transposed: bool,
}

impl Pattern {
    /// Of variables coupled by pairs, counted in elimination order, see [`elimination_order`].
    pub(crate) fn new(variables: usize, pairs: &[(usize, usize)]) -> Result<Self, GraphError> {
        let (starts, rows) = lower_pattern(variables, pairs, true);
        let (factor_starts, factor_rows) =
            factor_pattern(&starts, &rows).ok_or(GraphError::TooLarge { vertices: variables })?;
        let (runs, run_rows) = equal_runs(&factor_starts, &factor_rows);
        let (runs, run_rows) = merged_runs(&runs, &run_rows);
        let places = places_in_runs(&starts, &rows, &runs, &run_rows);
        let run_of = runs.iter().enumerate().flat_map(|(at, run)| std::iter::repeat_n(at, run.width)).collect();
        Ok(Self { starts, rows, places, runs, run_rows, run_of })
    }

    /// Where the block of a pair lies that the pattern was made with.
    pub(crate) fn slot(&self, first: usize, second: usize) -> Slot {
        let (column, row) = (first.min(second), first.max(second));
        let rows = &self.rows[self.starts[column]..self.starts[column + 1]];
        let place = rows.binary_search(&row).unwrap_or_default();
        Slot { at: self.starts[column] + place, transposed: first < second }
    }

    fn variables(&self) -> usize {
        self.starts.len() - 1
    }

    /// The run that the first row below a run belongs to.
    fn parent(&self, run: usize) -> Option<usize> {
        let first_below = self.rows_of(&self.runs[run]).get(self.runs[run].width)?;
        Some(self.run_of[*first_below])
    }

    fn rows_of(&self, run: &Run) -> &[usize] {
        &self.run_rows[run.rows..run.rows + run.height]
    }

    /// Numbers in a factor, see [`Run::start`].
    fn factor_len<const B: usize>(&self) -> usize {
        let area: usize = self.runs.iter().map(|run| run.width * run.height).sum();
        area * B * B + (self.runs.len() + 1) * CHUNK
    }
}

/// Columns of a block.
type Block<const B: usize> = [[f64; B]; B];

/// A system `A x = b` of which the lower triangle is kept, columns in elimination order.
pub(crate) struct BlockSystem<'a, const B: usize> {
    pattern: &'a Pattern,
    values: Vec<Block<B>>,
    factor: Vec<f64>,
    work: Work,
}

impl<'a, const B: usize> BlockSystem<'a, B> {
    /// All zero.
    pub(crate) fn new(pattern: &'a Pattern) -> Self {
        let values = vec![[[0.0; B]; B]; pattern.rows.len()];
        Self { pattern, values, factor: vec![0.0; pattern.factor_len::<B>()], work: Work::new::<B>(pattern) }
    }

    /// Makes every block zero.
    pub(crate) fn clear(&mut self) {
        self.values.fill([[0.0; B]; B]);
    }

    /// Adds the block (first, second) of a slot; its mirror image is understood.
    pub(crate) fn add(&mut self, slot: Slot, block: &SMatrix<f64, B, B>) {
        let target = &mut self.values[slot.at];
        for c in 0..B {
            for r in 0..B {
                target[c][r] += if slot.transposed { block[(c, r)] } else { block[(r, c)] };
            }
        }
    }

    /// Adds a symmetric block on the diagonal.
    pub(crate) fn add_diagonal(&mut self, variable: usize, block: &SMatrix<f64, B, B>) {
        let target = &mut self.values[self.pattern.starts[variable]];
        for c in 0..B {
            for r in 0..B {
                target[c][r] += block[(r, c)];
            }
        }
    }

    /// The diagonal's entries.
    pub(crate) fn diagonal(&self) -> Vec<f64> {
        let starts = &self.pattern.starts[..self.pattern.variables()];
        starts.iter().flat_map(|&at| (0..B).map(move |k| (at, k))).map(|(at, k)| self.values[at][k][k]).collect()
    }

    /// Replaces the diagonal's entries.
    pub(crate) fn set_diagonal(&mut self, entries: impl Iterator<Item = f64>) {
        for (place, entry) in entries.enumerate() {
            self.values[self.pattern.starts[place / B]][place % B][place % B] = entry;
        }
    }

    /// Factorises and solves for right-hand sides that stand one after the other; none where the matrix is not positive
    /// definite or the solution does not solve.
    pub(crate) fn solve(&mut self, right_hand_sides: &[f64]) -> Option<Vec<f64>> {
        let n = self.pattern.variables() * B;
        if n == 0 {
            return Some(Vec::new());
        }
        if !self.factorise() {
            return None;
        }
        let solution = self.substitute(right_hand_sides);
        let solved = |(b, x): (&[f64], &[f64])| is_solved(self.pattern, &self.values, b, x);
        right_hand_sides.chunks_exact(n).zip(solution.chunks_exact(n)).all(solved).then_some(solution)
    }

    /// Whether the matrix is positive definite.
    pub(crate) fn factorise(&mut self) -> bool {
        let Self { pattern, values, factor, work } = self;
        // the same statements with the widest registers of the machine
        pulp::Arch::new().dispatch(Factorisation { pattern, values, factor, work })
    }

    /// What the last factor makes of right-hand sides that stand one after the other.
    pub(crate) fn substitute(&mut self, right_hand_sides: &[f64]) -> Vec<f64> {
        let Self { pattern, factor, work, .. } = self;
        let mut solution = right_hand_sides.to_vec();
        for x in solution.chunks_exact_mut((pattern.variables() * B).max(1)) {
            pulp::Arch::new().dispatch(Substitution::<B> { pattern, factor, temporary: &mut work.product, x });
        }
        solution
    }
}

impl<const B: usize> BlockSystem<'_, B> {
    /// `E^T A^-1 E` from the last factor, `E` having blocks at some variables and zeros elsewhere: as `L^-1 E` is zero but
    /// on the ways from there to the root of the elimination tree, that is all that is looked at.
    pub(crate) fn covariance(&mut self, blocks: &[(usize, SMatrix<f64, B, B>)]) -> SMatrix<f64, B, B> {
        let Self { pattern, factor, work, .. } = self;
        let n = pattern.variables() * B;
        work.sparse.resize(n * B, 0.0);
        let mut next: Vec<usize> = blocks.iter().map(|(variable, _)| pattern.run_of[*variable]).collect();
        for (variable, block) in blocks {
            for c in 0..B {
                (0..B).for_each(|r| work.sparse[c * n + variable * B + r] += block[(r, c)]);
            }
        }
        let mut covariance = SMatrix::<f64, B, B>::zeros();
        while let Some(run) = next.iter().min().copied() {
            for x in work.sparse.chunks_exact_mut(n) {
                Substitution::<B> { pattern, factor, temporary: &mut work.product, x }.forwards(run);
            }
            let own = pattern.runs[run].first * B..(pattern.runs[run].first + pattern.runs[run].width) * B;
            for c in 0..B {
                let column = &work.sparse[c * n..][own.clone()];
                (0..B).for_each(|r| covariance[(r, c)] += dot(&work.sparse[r * n..][own.clone()], column));
            }
            (0..B).for_each(|c| work.sparse[c * n..][own.clone()].fill(0.0));
            next = next.iter().filter_map(|&at| if at == run { pattern.parent(run) } else { Some(at) }).collect();
        }
        covariance
    }
}

/// Whether `A x = b` up to rounding.
fn is_solved<const B: usize>(pattern: &Pattern, values: &[Block<B>], b: &[f64], x: &[f64]) -> bool {
    let (starts, rows) = (&pattern.starts, &pattern.rows);
    let mut residual = b.to_vec();
    let (rest, _) = residual.as_chunks_mut::<B>();
    let (known, _) = x.as_chunks::<B>();
    let mut largest = 0.0_f64;
    for column in 0..known.len() {
        let diagonal = &values[starts[column]];
        largest = (0..B).fold(largest, |most, k| most.max(diagonal[k][k]));
        let mut own = rest[column];
        subtract_product(diagonal, &known[column], &mut own);
        for at in starts[column] + 1..starts[column + 1] {
            subtract_product(&values[at], &known[column], &mut rest[rows[at]]);
            subtract_transposed_product(&values[at], &known[rows[at]], &mut own);
        }
        rest[column] = own;
    }
    // the largest entry of a positive definite matrix stands on its diagonal
    norm(&residual) <= BACKWARD_ERROR * (largest * norm(x) + norm(b))
}

/// What a factorisation needs besides its result.
struct Work {
    /// Place of each row among those of the present run.
    place_of_row: Vec<usize>,
    /// The first run whose next row is this column, and the next such run after each run.
    first_run: Vec<usize>,
    next_run: Vec<usize>,
    /// How many rows of a run are done.
    done: Vec<usize>,
    /// Columns that are as high as the highest panel.
    product: Vec<f64>,
    /// Zeros but while right-hand sides of few entries are solved for.
    sparse: Vec<f64>,
}

impl Work {
    fn new<const B: usize>(pattern: &Pattern) -> Self {
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

/// `A = L L^T`; false where the matrix is not positive definite.
struct Factorisation<'a, const B: usize> {
    pattern: &'a Pattern,
    values: &'a [Block<B>],
    factor: &'a mut [f64],
    work: &'a mut Work,
}

impl<const B: usize> pulp::WithSimd for Factorisation<'_, B> {
    type Output = bool;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(mut self, _: S) -> bool {
        self.factor.fill(0.0);
        self.work.first_run.fill(NONE);
        for run in 0..self.pattern.runs.len() {
            self.begin(run);
            for column in 0..self.pattern.runs[run].width {
                self.subtract_earlier_runs(run, column);
                self.subtract_earlier_columns(run, column);
                if !self.finish(run, column) {
                    return false;
                }
            }
            self.work.done[run] = self.pattern.runs[run].width;
            self.work.enqueue(self.pattern, run);
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
    fn subtract_earlier_runs(&mut self, at: usize, column: usize) {
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
            multiply::<B>(panel, high, done * B, earlier.width * B, &mut self.work.product);
            for (place, &row) in rows.iter().enumerate() {
                let corner = target + self.work.place_of_row[row] * B;
                for c in 0..B {
                    let product = &self.work.product[c * (high - done * B + CHUNK) + place * B..][..B];
                    subtract(&mut self.factor[corner + c * length..][..B], product);
                }
            }
            self.work.done[other] += 1;
            self.work.enqueue(pattern, other);
        }
    }

    /// Takes from a column what the earlier ones of its run have in common with it.
    #[inline(always)]
    fn subtract_earlier_columns(&mut self, at: usize, column: usize) {
        let run = &self.pattern.runs[at];
        let (start, length, done) = (run.start::<B>(at), run.height * B, column * B);
        if column == 0 {
            return;
        }
        multiply::<B>(&self.factor[start..], length, done, done, &mut self.work.product);
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
fn multiply<const B: usize>(panel: &[f64], length: usize, from: usize, columns: usize, product: &mut [f64]) {
    let rows = length - from;
    for first in (0..rows).step_by(CHUNK) {
        let mut sums = [[0.0; CHUNK]; B];
        for k in 0..columns {
            let column = &panel[k * length + from..];
            let (Some(right), Some(left)) = (column.first_chunk::<B>(), column[first..].first_chunk::<CHUNK>()) else {
                break;
            };
            for c in 0..B {
                for r in 0..CHUNK {
                    sums[c][r] = left[r].mul_add(right[c], sums[c][r]);
                }
            }
        }
        for c in 0..B {
            product[c * (rows + CHUNK) + first..][..CHUNK].copy_from_slice(&sums[c]);
        }
    }
}

#[inline(always)]
fn subtract(target: &mut [f64], product: &[f64]) {
    target.iter_mut().zip(product).for_each(|(t, p)| *t -= p);
}

/// `x := (L L^T)^-1 x`.
struct Substitution<'a, const B: usize> {
    pattern: &'a Pattern,
    factor: &'a [f64],
    temporary: &'a mut [f64],
    x: &'a mut [f64],
}

impl<const B: usize> pulp::WithSimd for Substitution<'_, B> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(mut self, _: S) {
        (0..self.pattern.runs.len()).for_each(|run| self.forwards(run));
        (0..self.pattern.runs.len()).rev().for_each(|run| self.backwards(run));
    }
}

impl<const B: usize> Substitution<'_, B> {
    #[inline(always)]
    fn forwards(&mut self, at: usize) {
        let run = &self.pattern.runs[at];
        let (length, own) = (run.height * B, run.width * B);
        let panel = &self.factor[run.start::<B>(at)..][..own * length];
        let x = &mut self.x[run.first * B..][..own];
        let below = &mut self.temporary[..length - own];
        below.fill(0.0);
        for k in 0..own {
            let column = &panel[k * length..(k + 1) * length];
            x[k] /= column[k];
            let known = x[k];
            x[k + 1..].iter_mut().zip(&column[k + 1..own]).for_each(|(value, l)| *value -= known * l);
            below.iter_mut().zip(&column[own..]).for_each(|(value, l)| *value += known * l);
        }
        for (place, &row) in self.pattern.rows_of(run)[run.width..].iter().enumerate() {
            subtract(&mut self.x[row * B..][..B], &self.temporary[place * B..][..B]);
        }
    }

    #[inline(always)]
    fn backwards(&mut self, at: usize) {
        let run = &self.pattern.runs[at];
        let (length, own) = (run.height * B, run.width * B);
        let panel = &self.factor[run.start::<B>(at)..][..own * length];
        for (place, &row) in self.pattern.rows_of(run)[run.width..].iter().enumerate() {
            self.temporary[place * B..][..B].copy_from_slice(&self.x[row * B..][..B]);
        }
        let below = &self.temporary[..length - own];
        let x = &mut self.x[run.first * B..][..own];
        for k in (0..own).rev() {
            let column = &panel[k * length..(k + 1) * length];
            x[k] -= dot(&column[own..], below) + dot(&column[k + 1..own], &x[k + 1..]);
            x[k] /= column[k];
        }
    }
}

/// In four sums.
#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<4>(), b.as_chunks::<4>());
    for (a, b) in a.iter().zip(b) {
        (0..4).for_each(|k| sums[k] += a[k] * b[k]);
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    (sums[0] + sums[1]) + (sums[2] + sums[3]) + rest
}

/// `target -= a x`.
#[inline(always)]
fn subtract_product<const B: usize>(a: &Block<B>, x: &[f64; B], target: &mut [f64; B]) {
    for c in 0..B {
        for r in 0..B {
            target[r] -= a[c][r] * x[c];
        }
    }
}

/// `target -= a^T x`.
#[inline(always)]
fn subtract_transposed_product<const B: usize>(a: &Block<B>, x: &[f64; B], target: &mut [f64; B]) {
    for c in 0..B {
        for r in 0..B {
            target[c] -= a[c][r] * x[r];
        }
    }
}

fn norm(v: &[f64]) -> f64 {
    // unlike `f64::max`, NaN stays
    v.iter().fold(0.0, |most, value| if value.abs() <= most { most } else { value.abs() })
}

/// Approximate minimum degree (Amestoy, Davis, Duff 1996) over the graph of blocks: place of each variable.
pub(crate) fn elimination_order(variables: usize, pairs: &[(usize, usize)]) -> Result<Vec<usize>, GraphError> {
    let too_large = || GraphError::TooLarge { vertices: variables };
    let (starts, rows) = lower_pattern(variables, pairs, false);
    let pattern = SymbolicSparseColMatRef::new_checked(variables, variables, &starts, None, &rows);
    let (mut order, mut places) = (vec![0_usize; variables], vec![0_usize; variables]);
    let needed = amd::order_scratch::<usize>(variables, rows.len());
    let mut memory = MemBuffer::try_new(needed).map_err(|_| too_large())?;
    amd::order(&mut order, &mut places, pattern, amd::Control::default(), MemStack::new(&mut memory))
        .map_err(|_| too_large())?;
    Ok(places)
}

/// Columns of the lower triangle, each sorted and without repetition.
fn lower_pattern(variables: usize, pairs: &[(usize, usize)], with_diagonal: bool) -> (Vec<usize>, Vec<usize>) {
    let mut starts = vec![0; variables + 2];
    let lower = || pairs.iter().filter(|(a, b)| a != b).map(|&(a, b)| (a.min(b), a.max(b)));
    let own = usize::from(with_diagonal);
    lower().for_each(|(column, _)| starts[column + 2] += 1);
    (0..variables).for_each(|column| starts[column + 2] += starts[column + 1] + own);
    let mut rows = vec![0; starts[variables + 1]];
    // `starts[column + 1]` moves from the column's beginning to its end
    (0..variables * own).for_each(|column| push(&mut rows, &mut starts[column + 1], column));
    lower().for_each(|(column, row)| push(&mut rows, &mut starts[column + 1], row));
    without_repetition(&mut starts, &mut rows);
    starts.pop();
    (starts, rows)
}

fn push(rows: &mut [usize], end: &mut usize, row: usize) {
    rows[*end] = row;
    *end += 1;
}

/// Sorts every column and drops what stands there twice.
fn without_repetition(starts: &mut [usize], rows: &mut Vec<usize>) {
    let (mut kept, mut begin) = (0, 0);
    for end in starts.iter_mut().skip(1) {
        let stop = (*end).min(rows.len());
        rows[begin.min(stop)..stop].sort_unstable();
        let first = kept;
        for at in begin..stop {
            if kept == first || rows[kept - 1] != rows[at] {
                rows[kept] = rows[at];
                kept += 1;
            }
        }
        begin = stop;
        *end = kept;
    }
    rows.truncate(kept);
}

/// The pattern of the factor; none where it is too large. Row by row, so that columns come out sorted: row `i` of the
/// factor is what the elimination tree reaches from row `i` of the matrix (Davis, section 4.2).
fn factor_pattern(starts: &[usize], rows: &[usize]) -> Option<(Vec<usize>, Vec<usize>)> {
    let variables = starts.len() - 1;
    let (row_starts, columns) = transposed(starts, rows);
    let parents = elimination_tree(&row_starts, &columns);
    let mut counts = vec![1_usize; variables];
    reach(&row_starts, &columns, &parents, |_, column| counts[column] += 1);
    let mut factor_starts = vec![0; variables + 1];
    (0..variables).for_each(|k| factor_starts[k + 1] = factor_starts[k] + counts[k]);
    if factor_starts[variables] > LARGEST_FACTOR {
        return None;
    }
    let mut factor_rows = vec![0; factor_starts[variables]];
    let mut ends = factor_starts[..variables].to_vec();
    (0..variables).for_each(|k| push(&mut factor_rows, &mut ends[k], k));
    reach(&row_starts, &columns, &parents, |row, column| push(&mut factor_rows, &mut ends[column], row));
    Some((factor_starts, factor_rows))
}

/// Parent of each column (Liu 1986), from the rows of the lower triangle.
fn elimination_tree(row_starts: &[usize], columns: &[usize]) -> Vec<usize> {
    let variables = row_starts.len() - 1;
    let (mut parents, mut ancestors) = (vec![NONE; variables], vec![NONE; variables]);
    for row in 0..variables {
        for &column in &columns[row_starts[row]..row_starts[row + 1]] {
            let mut at = column;
            while at != NONE && at < row {
                let next = std::mem::replace(&mut ancestors[at], row);
                if next == NONE {
                    parents[at] = row;
                }
                at = next;
            }
        }
    }
    parents
}

/// Visits every block (row, column) of the factor below the diagonal, rows ascending.
fn reach(row_starts: &[usize], columns: &[usize], parents: &[usize], mut visit: impl FnMut(usize, usize)) {
    let mut seen = vec![NONE; parents.len()];
    for row in 0..parents.len() {
        seen[row] = row;
        for &column in &columns[row_starts[row]..row_starts[row + 1]] {
            let mut at = column;
            while at != NONE && seen[at] != row {
                seen[at] = row;
                visit(row, at);
                at = parents[at];
            }
        }
    }
}

/// Runs and their rows.
fn equal_runs(factor_starts: &[usize], factor_rows: &[usize]) -> (Vec<Run>, Vec<usize>) {
    let (mut runs, mut run_rows, mut area): (Vec<Run>, Vec<usize>, usize) = (Vec::new(), Vec::new(), 0);
    for column in 0..factor_starts.len() - 1 {
        let rows = &factor_rows[factor_starts[column]..factor_starts[column + 1]];
        // columns nest: a parent has all rows of its child
        let continued = runs.last_mut().filter(|run| run.height - run.width == rows.len());
        match continued.filter(|run| run_rows.get(run.rows + run.width) == Some(&column)) {
            Some(run) => {
                run.width += 1;
                area += run.height;
            }
            None => {
                runs.push(Run { first: column, width: 1, rows: run_rows.len(), height: rows.len(), area });
                run_rows.extend_from_slice(rows);
                area += rows.len();
            }
        }
    }
    (runs, run_rows)
}

/// Widths up to which runs are merged, and what share of the blocks may then be zeros.
const MERGED: [(usize, f64); 3] = [(4, 0.5), (8, 0.25), (usize::MAX, 0.05)];

/// Runs that lead into the next one are merged with it where few zeros come of that: a wide panel is worth some.
fn merged_runs(runs: &[Run], run_rows: &[usize]) -> (Vec<Run>, Vec<usize>) {
    // the last run stands open; how many of its blocks are zeros
    let (mut merged, mut zeros): (Vec<Run>, usize) = (Vec::new(), 0);
    let mut last_rows = Vec::new();
    let (mut rows, mut area) = (Vec::new(), 0);
    for next in runs {
        let next_rows = &run_rows[next.rows..next.rows + next.height];
        if let Some(last) = merged.last_mut() {
            let more = last.width * (next.height + last.width).saturating_sub(last.height);
            let (width, height) = (last.width + next.width, last.width + next.height);
            let share = (zeros + more) as f64 / (width * height) as f64;
            let leads_there = last_rows.get(last.width) == Some(&next.first);
            if leads_there && MERGED.iter().any(|&(widest, most)| width <= widest && share <= most) {
                last_rows.truncate(last.width);
                last_rows.extend_from_slice(next_rows);
                (last.width, last.height, zeros) = (width, height, zeros + more);
                continue;
            }
            area += last.width * last.height;
            rows.append(&mut last_rows);
        }
        merged.push(Run { rows: rows.len(), area, ..*next });
        last_rows.extend_from_slice(next_rows);
        zeros = 0;
    }
    rows.append(&mut last_rows);
    (merged, rows)
}

fn places_in_runs(starts: &[usize], rows: &[usize], runs: &[Run], run_rows: &[usize]) -> Vec<usize> {
    let mut places = Vec::with_capacity(rows.len());
    for run in runs {
        let own = &run_rows[run.rows..run.rows + run.height];
        for column in run.first..run.first + run.width {
            let mut place = column - run.first;
            for row in &rows[starts[column]..starts[column + 1]] {
                while own[place] != *row {
                    place += 1;
                }
                places.push(place);
            }
        }
    }
    places
}

/// The pattern of the transposed matrix, its columns sorted.
fn transposed(starts: &[usize], rows: &[usize]) -> (Vec<usize>, Vec<usize>) {
    let n = starts.len() - 1;
    let mut transposed_starts = vec![0; n + 1];
    rows.iter().for_each(|&row| transposed_starts[row + 1] += 1);
    (0..n).for_each(|k| transposed_starts[k + 1] += transposed_starts[k]);
    let mut next = transposed_starts.clone();
    let mut columns = vec![0; rows.len()];
    for column in 0..n {
        for &row in &rows[starts[column]..starts[column + 1]] {
            columns[next[row]] = column;
            next[row] += 1;
        }
    }
    (transposed_starts, columns)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{DMatrix, DVector, Matrix3};
    use std::ops::AddAssign;

    #[test]
    fn a_system_of_blocks_is_solved_like_a_dense_one() {
        let pairs: Vec<_> = (0..19).map(|v| (v, v + 1)).chain([(3, 17), (12, 1), (3, 17)]).collect();
        let places = elimination_order(20, &pairs).unwrap();
        let pairs: Vec<_> = pairs.iter().map(|&(a, b)| (places[a], places[b])).collect();
        let pattern = Pattern::new(20, &pairs).unwrap();
        let mut system = BlockSystem::<3>::new(&pattern);
        let mut dense = DMatrix::<f64>::zeros(60, 60);
        for variable in 0..20 {
            let block = Matrix3::from_fn(|r, c| if r == c { 30.0 } else { 1.0 / (2 + r + c) as f64 });
            system.add_diagonal(variable, &block);
            dense.view_mut((3 * variable, 3 * variable), (3, 3)).copy_from(&block);
        }
        for &(a, b) in &pairs {
            let block = Matrix3::from_fn(|r, c| (r as f64 - 2.0 * c as f64 + a as f64 * 0.1).sin());
            let slot = pattern.slot(a, b);
            system.add(slot, &block);
            let mut view = dense.view_mut((3 * a, 3 * b), (3, 3));
            view += block;
            let mut view = dense.view_mut((3 * b, 3 * a), (3, 3));
            view += block.transpose();
        }
        let b = DVector::from_fn(60, |k, _| (k as f64).cos());
        let x = system.solve(b.as_slice()).unwrap();
        for (first, second) in [(0, 19), (7, 7), (4, 11)] {
            let (here, there) = (Matrix3::identity(), Matrix3::from_fn(|r, c| (r + 2 * c) as f64 - 2.0));
            let found = system.covariance(&[(first, here), (second, there)]);
            let mut ends = DMatrix::zeros(60, 3);
            ends.view_mut((3 * first, 0), (3, 3)).add_assign(&here);
            ends.view_mut((3 * second, 0), (3, 3)).add_assign(&there);
            let expected = ends.transpose() * dense.clone().try_inverse().unwrap() * ends;
            assert!((found - expected).norm() < 1e-10);
        }
        let expected = dense.cholesky().unwrap().solve(&b);
        assert!((DVector::from_vec(x) - expected).norm() < 1e-10);
    }

    #[test]
    fn what_is_not_positive_definite_is_refused() {
        let pattern = Pattern::new(2, &[(0, 1)]).unwrap();
        let mut system = BlockSystem::<1>::new(&pattern);
        let slot = pattern.slot(0, 1);
        system.add(slot, &SMatrix::from_element(2.0));
        system.set_diagonal([1.0, 1.0].into_iter());
        assert!(system.solve(&[1.0, 1.0]).is_none());
        system.set_diagonal([f64::NAN, 1.0].into_iter());
        assert!(system.solve(&[1.0, 1.0]).is_none());
    }
}
