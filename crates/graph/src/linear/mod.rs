//! Sparse symmetric systems of `B x B` blocks: ordered and analysed once for a graph, factorised as often as values change.
//!
//! The factor is made column by column from the columns to its left (Davis 2006, "Direct Methods for Sparse Linear
//! Systems", sections 4.2 to 4.8), those of equal pattern together, in blocks whose size the compiler knows. One thread,
//! sums in a fixed order, products fused where that is written: the same bits on every machine.

mod nearby;
mod numeric;
mod substitution;
mod symbolic;

use nalgebra::SMatrix;
use numeric::{Factorisation, Work};
use substitution::{SecondHalf, Substitution, dot};
pub(crate) use symbolic::{Pattern, Slot, elimination_order};

/// Largest residual of a solve that passes, relative to `|A| |x| + |b|` in the maximum norm.
const BACKWARD_ERROR: f64 = 1e-9;
/// Rows that are multiplied at once.
const CHUNK: usize = 8;

/// Columns of a block.
type Block<const B: usize> = [[f64; B]; B];

/// A system `A x = b` of which the lower triangle is kept, columns in elimination order.
pub(crate) struct BlockSystem<'a, const B: usize> {
    pattern: &'a Pattern,
    values: Vec<Block<B>>,
    factor: Vec<f64>,
    factorised: bool,
    work: Work,
}

impl<'a, const B: usize> BlockSystem<'a, B> {
    /// All zero.
    pub(crate) fn new(pattern: &'a Pattern) -> Self {
        let values = vec![[[0.0; B]; B]; pattern.rows.len()];
        let factor = vec![0.0; pattern.factor_len::<B>()];
        Self { pattern, values, factor, factorised: false, work: Work::new::<B>(pattern) }
    }

    /// Makes every block zero.
    pub(crate) fn clear(&mut self) {
        self.values.fill([[0.0; B]; B]);
    }

    /// Adds the block (first, second) of a slot; its mirror image is understood.
    #[inline(always)]
    pub(crate) fn add(&mut self, slot: Slot, block: &SMatrix<f64, B, B>) {
        let block = if slot.transposed { block.transpose() } else { *block };
        add_to(&mut self.values[slot.at], &block.data.0);
    }

    /// Adds a symmetric block on the diagonal.
    #[inline(always)]
    pub(crate) fn add_diagonal(&mut self, variable: usize, block: &SMatrix<f64, B, B>) {
        add_to(&mut self.values[self.pattern.starts[variable]], &block.data.0);
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
        let mut solution = right_hand_sides.to_vec();
        if !self.factorise_with(&mut solution) {
            return None;
        }
        let Self { pattern, factor, work, .. } = self;
        let whole = Substitution::<B> { pattern, factor, temporary: &mut work.product, x: &mut solution };
        pulp::Arch::new().dispatch(SecondHalf(whole));
        let solved = |(b, x): (&[f64], &[f64])| self.is_solved(b, x);
        right_hand_sides.chunks_exact(n).zip(solution.chunks_exact(n)).all(solved).then_some(solution)
    }

    /// Whether `A x = b` up to rounding.
    fn is_solved(&self, b: &[f64], x: &[f64]) -> bool {
        let mut residual = b.to_vec();
        self.subtract_product(x, &mut residual);
        // the largest entry of a positive definite matrix stands on its diagonal
        let largest = self.diagonal().into_iter().fold(0.0, f64::max);
        norm(&residual) <= BACKWARD_ERROR * (largest * norm(x) + norm(b))
    }

    /// Whether the matrix is positive definite.
    pub(crate) fn factorise(&mut self) -> bool {
        self.factorise_with(&mut [])
    }

    /// The same, and multiplies right-hand sides by the factor's inverse.
    fn factorise_with(&mut self, x: &mut [f64]) -> bool {
        let Self { pattern, values, factor, work, .. } = self;
        // the same statements with the widest registers of the machine
        self.factorised = pulp::Arch::new().dispatch(Factorisation { pattern, values, factor, work, x });
        self.factorised
    }

    /// What the last factor makes of right-hand sides that stand one after the other.
    pub(crate) fn substitute(&mut self, right_hand_sides: &[f64]) -> Vec<f64> {
        let Self { pattern, factor, work, .. } = self;
        let mut x = right_hand_sides.to_vec();
        let temporary = &mut work.product;
        pulp::Arch::new().dispatch(Substitution::<B> { pattern, factor, temporary, x: &mut x });
        x
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
            let x = &mut work.sparse;
            Substitution::<B> { pattern, factor, temporary: &mut work.product, x }.forwards(run);
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

#[inline(always)]
fn add_to<const B: usize>(target: &mut Block<B>, block: &Block<B>) {
    for c in 0..B {
        for r in 0..B {
            target[c][r] += block[c][r];
        }
    }
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

    /// A band of variables, ten of them coupled with each other as well.
    fn banded<'a, const B: usize>(pattern: &'a Pattern, pairs: &[(usize, usize)]) -> BlockSystem<'a, B> {
        let mut system = BlockSystem::<B>::new(pattern);
        for variable in 0..40 {
            system.add_diagonal(variable, &SMatrix::from_fn(|r, c| if r == c { 90.0 } else { 0.3 }));
        }
        for &(a, b) in pairs {
            system.add(pattern.slot(a, b), &SMatrix::from_fn(|r, c| ((a + 3 * b) as f64 + (r * B + c) as f64).sin()));
        }
        system
    }

    fn registers_do_not_matter<const B: usize>() {
        use pulp::WithSimd;
        let clique = (30..40).flat_map(|a| (30..a).map(move |b| (a, b)));
        let pairs: Vec<_> = (0..39).map(|v| (v, v + 1)).chain((0..34).map(|v| (v, v + 6))).chain(clique).collect();
        let pattern = Pattern::new(40, &pairs).unwrap();
        let right: Vec<f64> = (0..80 * B).map(|k| (k as f64).cos()).collect();
        let widest = banded::<B>(&pattern, &pairs).solve(&right).unwrap();
        let mut system = banded::<B>(&pattern, &pairs);
        let mut x = right.clone();
        let (values, factor, work) = (&system.values, &mut system.factor, &mut system.work);
        let pattern = &pattern;
        assert!(Factorisation { pattern, values, factor, work, x: &mut x }.with_simd(pulp::Scalar::new()));
        let whole = Substitution::<B> { pattern, factor, temporary: &mut work.product, x: &mut x };
        SecondHalf(whole).with_simd(pulp::Scalar::new());
        let bits = |x: &[f64]| x.iter().map(|v| v.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(&x), bits(&widest));
        assert!(system.factorise());
        assert_eq!(bits(&system.substitute(&right)), bits(&widest));
        let again = system.solve_nearby(&right[..40 * B], 1e-2).unwrap();
        assert!(again.iter().zip(&widest).all(|(a, b)| (a - b).abs() < 1e-10));
    }

    #[test]
    fn solutions_have_the_same_bits_with_registers_of_any_width() {
        registers_do_not_matter::<1>();
        registers_do_not_matter::<2>();
        registers_do_not_matter::<3>();
        registers_do_not_matter::<6>();
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
