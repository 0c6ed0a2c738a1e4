//! Sparse symmetric systems of `B x B` blocks: ordered once, factorised as often as their values change.

use crate::error::GraphError;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::sparse::linalg::amd;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Conj, MatMut, Par, Side};
use nalgebra::SMatrix;

/// Largest residual of a solve that passes, relative to `|A| |x| + |b|` in the maximum norm.
const BACKWARD_ERROR: f64 = 1e-9;

/// A system `A x = b` of which the lower triangle is kept, columns in elimination order.
///
/// One thread: parallel factors need not have the same bits.
pub(crate) struct BlockSystem<const B: usize> {
    /// Where each scalar column begins.
    column_starts: Vec<usize>,
    rows: Vec<usize>,
    values: Vec<f64>,
    /// Block rows of each block column, the diagonal first.
    block_starts: Vec<usize>,
    block_rows: Vec<usize>,
    symbolic: SymbolicCholesky<usize>,
    factor: Vec<f64>,
    memory: MemBuffer,
}

/// Where the block of two variables lies.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Slot {
    column: usize,
    /// Place within the block column, the diagonal being 0.
    place: usize,
    /// Whether the block is that of (second, first).
    transposed: bool,
}

impl<const B: usize> BlockSystem<B> {
    /// A system over as many variables as `order` is long, coupled by pairs of variables. Variables are counted in
    /// elimination order, see [`elimination_order`].
    pub(crate) fn new(variables: usize, pairs: &[(usize, usize)]) -> Result<Self, GraphError> {
        let (block_starts, block_rows) = lower_pattern(variables, pairs, true);
        let (column_starts, rows) = scalar_pattern::<B>(&block_starts, &block_rows);
        let n = variables * B;
        // without reordering, the elimination tree is read off the upper triangle, whatever side is named
        let (upper_starts, upper_rows) = transposed(&column_starts, &rows);
        let pattern = SymbolicSparseColMatRef::new_checked(n, n, &upper_starts, None, &upper_rows);
        let params = CholeskySymbolicParams::default();
        let symbolic = factorize_symbolic_cholesky(pattern, Side::Upper, SymmetricOrdering::Identity, params)
            .map_err(|_| GraphError::TooLarge { vertices: variables })?;
        let needed = symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Default::default());
        let needed = needed.or(symbolic.solve_in_place_scratch::<f64>(3, Par::Seq));
        let memory = MemBuffer::try_new(needed).map_err(|_| GraphError::TooLarge { vertices: variables })?;
        let factor = vec![0.0; symbolic.len_val()];
        let values = vec![0.0; rows.len()];
        Ok(Self { column_starts, rows, values, block_starts, block_rows, symbolic, factor, memory })
    }

    /// Makes every block zero.
    pub(crate) fn clear(&mut self) {
        self.values.fill(0.0);
    }

    /// Where the block of a pair lies that the system was made with.
    pub(crate) fn slot(&self, first: usize, second: usize) -> Slot {
        let (column, row) = (first.min(second), first.max(second));
        let rows = &self.block_rows[self.block_starts[column]..self.block_starts[column + 1]];
        let place = rows.binary_search(&row).unwrap_or_default();
        Slot { column, place, transposed: first < second }
    }

    /// Adds the block (first, second) of a slot; its mirror image is understood.
    pub(crate) fn add(&mut self, slot: Slot, block: &SMatrix<f64, B, B>) {
        for k in 0..B {
            let start = self.column_starts[slot.column * B + k] + slot.place * B - k;
            let target = &mut self.values[start..start + B];
            for (r, value) in target.iter_mut().enumerate() {
                *value += if slot.transposed { block[(k, r)] } else { block[(r, k)] };
            }
        }
    }

    /// Adds a symmetric block on the diagonal.
    pub(crate) fn add_diagonal(&mut self, variable: usize, block: &SMatrix<f64, B, B>) {
        for k in 0..B {
            let start = self.column_starts[variable * B + k];
            for r in k..B {
                self.values[start + r - k] += block[(r, k)];
            }
        }
    }

    /// The diagonal's entries.
    pub(crate) fn diagonal(&self) -> Vec<f64> {
        self.column_starts[..self.column_starts.len() - 1].iter().map(|&at| self.values[at]).collect()
    }

    /// Replaces the diagonal's entries.
    pub(crate) fn set_diagonal(&mut self, entries: impl Iterator<Item = f64>) {
        for (&at, entry) in self.column_starts.iter().zip(entries) {
            self.values[at] = entry;
        }
    }

    /// Factorises and solves for right-hand sides that stand one after the other; none where the matrix is not positive
    /// definite or the solution does not solve.
    pub(crate) fn solve(&mut self, right_hand_sides: &[f64]) -> Option<Vec<f64>> {
        let n = self.column_starts.len() - 1;
        if n == 0 {
            return Some(Vec::new());
        }
        let Self { column_starts, rows, values, symbolic, factor, memory, .. } = self;
        let pattern = SymbolicSparseColMatRef::new_checked(n, n, column_starts, None, rows);
        let matrix = SparseColMatRef::new(pattern, values.as_slice());
        let regularization = LltRegularization::default();
        let llt: LltRef<'_, usize, f64> = symbolic
            .factorize_numeric_llt(
                factor,
                matrix,
                Side::Lower,
                regularization,
                Par::Seq,
                MemStack::new(memory),
                Default::default(),
            )
            .ok()?;
        let mut solution = right_hand_sides.to_vec();
        let columns = right_hand_sides.len() / n;
        let target = MatMut::from_column_major_slice_mut(&mut solution, n, columns);
        llt.solve_in_place_with_conj(Conj::No, target, Par::Seq, MemStack::new(memory));
        let solved = |(b, x): (&[f64], &[f64])| self.is_solved(b, x);
        right_hand_sides.chunks(n).zip(solution.chunks(n)).all(solved).then_some(solution)
    }

    /// Whether `A x = b` up to rounding.
    fn is_solved(&self, b: &[f64], x: &[f64]) -> bool {
        let mut residual = b.to_vec();
        let mut largest = 0.0_f64;
        for column in 0..x.len() {
            let (start, end) = (self.column_starts[column], self.column_starts[column + 1]);
            largest = largest.max(self.values[start]);
            residual[column] -= self.values[start] * x[column];
            let mut below = 0.0;
            for at in start + 1..end {
                residual[self.rows[at]] -= self.values[at] * x[column];
                below += self.values[at] * x[self.rows[at]];
            }
            residual[column] -= below;
        }
        // the largest entry of a positive definite matrix stands on its diagonal
        norm(&residual) <= BACKWARD_ERROR * (largest * norm(x) + norm(b))
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
    let mut entries: Vec<(usize, usize)> =
        pairs.iter().filter(|(a, b)| a != b).map(|&(a, b)| (a.min(b), a.max(b))).collect();
    if with_diagonal {
        entries.extend((0..variables).map(|v| (v, v)));
    }
    entries.sort_unstable();
    entries.dedup();
    let mut starts = vec![0; variables + 1];
    for &(column, _) in &entries {
        starts[column + 1] += 1;
    }
    for column in 0..variables {
        starts[column + 1] += starts[column];
    }
    (starts, entries.into_iter().map(|(_, row)| row).collect())
}

/// The pattern of scalars: of a diagonal block only the lower triangle.
fn scalar_pattern<const B: usize>(block_starts: &[usize], block_rows: &[usize]) -> (Vec<usize>, Vec<usize>) {
    let mut starts = vec![0];
    let mut rows = Vec::with_capacity(block_rows.len() * B * B);
    for column in block_starts.windows(2) {
        let blocks = &block_rows[column[0]..column[1]];
        for k in 0..B {
            for (place, &block) in blocks.iter().enumerate() {
                let first = if place == 0 { k } else { 0 };
                rows.extend((first..B).map(|r| block * B + r));
            }
            starts.push(rows.len());
        }
    }
    (starts, rows)
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

    #[test]
    fn a_system_of_blocks_is_solved_like_a_dense_one() {
        let pairs: Vec<_> = (0..19).map(|v| (v, v + 1)).chain([(3, 17), (12, 1), (3, 17)]).collect();
        let places = elimination_order(20, &pairs).unwrap();
        let pairs: Vec<_> = pairs.iter().map(|&(a, b)| (places[a], places[b])).collect();
        let mut system = BlockSystem::<3>::new(20, &pairs).unwrap();
        let mut dense = DMatrix::<f64>::zeros(60, 60);
        for variable in 0..20 {
            let block = Matrix3::from_fn(|r, c| if r == c { 30.0 } else { 1.0 / (2 + r + c) as f64 });
            system.add_diagonal(variable, &block);
            dense.view_mut((3 * variable, 3 * variable), (3, 3)).copy_from(&block);
        }
        for &(a, b) in &pairs {
            let block = Matrix3::from_fn(|r, c| (r as f64 - 2.0 * c as f64 + a as f64 * 0.1).sin());
            let slot = system.slot(a, b);
            system.add(slot, &block);
            let mut view = dense.view_mut((3 * a, 3 * b), (3, 3));
            view += block;
            let mut view = dense.view_mut((3 * b, 3 * a), (3, 3));
            view += block.transpose();
        }
        let b = DVector::from_fn(60, |k, _| (k as f64).cos());
        let x = system.solve(b.as_slice()).unwrap();
        let expected = dense.cholesky().unwrap().solve(&b);
        assert!((DVector::from_vec(x) - expected).norm() < 1e-10);
    }

    #[test]
    fn what_is_not_positive_definite_is_refused() {
        let mut system = BlockSystem::<1>::new(2, &[(0, 1)]).unwrap();
        let slot = system.slot(0, 1);
        system.add(slot, &SMatrix::from_element(2.0));
        system.set_diagonal([1.0, 1.0].into_iter());
        assert!(system.solve(&[1.0, 1.0]).is_none());
        system.set_diagonal([f64::NAN, 1.0].into_iter());
        assert!(system.solve(&[1.0, 1.0]).is_none());
    }
}
