//! Solutions with the factor of a matrix nearby: conjugate gradients (Hestenes, Stiefel 1952), preconditioned.

use super::substitution::dot;
use super::{Block, BlockSystem, Pattern, subtract_product, subtract_transposed_product};

/// Steps at most; a new factor costs no more than some of them.
const MOST_STEPS: usize = 3;
/// Times the error that may be left from which a beginning is hopeless.
const HOPELESS: f64 = 1e3;

impl<const B: usize> BlockSystem<'_, B> {
    /// Solves with the last factor although values have changed since, until `x^T A x` of the error is below a limit; none
    /// where that is not soon so.
    pub(crate) fn solve_nearby(&mut self, right_hand_side: &[f64], most_left: f64) -> Option<Vec<f64>> {
        let mut rest = right_hand_side.to_vec();
        let (mut x, mut direction) = (vec![0.0; rest.len()], vec![0.0; rest.len()]);
        let mut last_error = f64::INFINITY;
        let most_steps = if self.factorised { MOST_STEPS } else { 0 };
        for _ in 0..most_steps {
            let preconditioned = self.substitute(&rest);
            // as long as the factor's matrix is like this one
            let error = dot(&rest, &preconditioned);
            if error.is_nan() || error > HOPELESS * most_left {
                return None;
            }
            direction.iter_mut().zip(&preconditioned).for_each(|(d, z)| *d = z + error / last_error * *d);
            let mut image = vec![0.0; rest.len()];
            self.subtract_product(&direction, &mut image);
            let length = -error / dot(&direction, &image);
            x.iter_mut().zip(&direction).for_each(|(x, d)| *x += length * d);
            if error <= most_left {
                return length.is_finite().then_some(x);
            }
            rest.iter_mut().zip(&image).for_each(|(r, q)| *r += length * q);
            last_error = error;
        }
        None
    }

    /// `target -= A x`.
    pub(super) fn subtract_product(&self, x: &[f64], target: &mut [f64]) {
        pulp::Arch::new().dispatch(Product { pattern: self.pattern, values: &self.values, x, target });
    }
}

/// `target -= A x`.
struct Product<'a, const B: usize> {
    pattern: &'a Pattern,
    values: &'a [Block<B>],
    x: &'a [f64],
    target: &'a mut [f64],
}

impl<const B: usize> pulp::WithSimd for Product<'_, B> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let (starts, rows) = (&self.pattern.starts, &self.pattern.rows);
        let (target, _) = self.target.as_chunks_mut::<B>();
        let (x, _) = self.x.as_chunks::<B>();
        for column in 0..x.len() {
            let mut own = target[column];
            subtract_product(&self.values[starts[column]], &x[column], &mut own);
            for at in starts[column] + 1..starts[column + 1] {
                subtract_product(&self.values[at], &x[column], &mut target[rows[at]]);
                subtract_transposed_product(&self.values[at], &x[rows[at]], &mut own);
            }
            target[column] = own;
        }
    }
}
