//! Triangular systems with the panels of a factor, some columns at a time: a factor is read from afar.

use super::CHUNK;
use super::symbolic::Pattern;

/// `x := (L L^T)^-1 x` for right-hand sides that stand one after the other.
pub(super) struct Substitution<'a, const B: usize> {
    pub(super) pattern: &'a Pattern,
    pub(super) factor: &'a [f64],
    pub(super) temporary: &'a mut [f64],
    pub(super) x: &'a mut [f64],
}

/// `x := L^-T x`, its second half.
pub(super) struct SecondHalf<'a, const B: usize>(pub(super) Substitution<'a, B>);

impl<const B: usize> pulp::WithSimd for Substitution<'_, B> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(mut self, simd: S) {
        // loops, as closures would be compiled without the wide registers
        for run in 0..self.pattern.runs.len() {
            self.forwards(run);
        }
        SecondHalf(self).with_simd(simd);
    }
}

impl<const B: usize> pulp::WithSimd for SecondHalf<'_, B> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(mut self, _: S) {
        for run in (0..self.0.pattern.runs.len()).rev() {
            self.0.backwards(run);
        }
    }
}

impl<const B: usize> Substitution<'_, B> {
    #[inline(always)]
    pub(super) fn forwards(&mut self, at: usize) {
        let run = &self.pattern.runs[at];
        let (length, own) = (run.height * B, run.width * B);
        let panel = &self.factor[run.start::<B>(at)..];
        let known = &mut self.temporary[..length + CHUNK];
        for x in self.x.chunks_exact_mut(self.pattern.variables() * B) {
            known[..own].copy_from_slice(&x[run.first * B..][..own]);
            known[own..].fill(0.0);
            if B.is_multiple_of(2) {
                for done in (0..own).step_by(2) {
                    forwards_columns::<2>(panel, length, done, known);
                }
            } else {
                for done in (0..own).step_by(B) {
                    forwards_columns::<B>(panel, length, done, known);
                }
            }
            x[run.first * B..][..own].copy_from_slice(&known[..own]);
            for (place, &row) in self.pattern.rows_of(run).iter().enumerate().skip(run.width) {
                for r in 0..B {
                    x[row * B + r] += known[place * B + r];
                }
            }
        }
    }

    #[inline(always)]
    fn backwards(&mut self, at: usize) {
        let run = &self.pattern.runs[at];
        let (length, own) = (run.height * B, run.width * B);
        let panel = &self.factor[run.start::<B>(at)..];
        let known = &mut self.temporary[..length + CHUNK];
        known[length..].fill(0.0);
        for x in self.x.chunks_exact_mut(self.pattern.variables() * B) {
            for (place, &row) in self.pattern.rows_of(run).iter().enumerate() {
                known[place * B..][..B].copy_from_slice(&x[row * B..][..B]);
            }
            if B.is_multiple_of(2) {
                for done in (0..own).step_by(2).rev() {
                    backwards_columns::<2>(panel, length, done, known);
                }
            } else {
                for done in (0..own).step_by(B).rev() {
                    backwards_columns::<B>(panel, length, done, known);
                }
            }
            x[run.first * B..][..own].copy_from_slice(&known[..own]);
        }
    }
}

/// Solves for some unknowns and takes them from those below.
#[inline(always)]
fn forwards_columns<const C: usize>(panel: &[f64], length: usize, done: usize, known: &mut [f64]) {
    let mut solved = [0.0; C];
    for c in 0..C {
        let column = &panel[(done + c) * length + done..][..C];
        solved[c] = (solved[c] + known[done + c]) / column[c];
        for r in c + 1..C {
            solved[r] -= column[r] * solved[c];
        }
    }
    known[done..][..C].copy_from_slice(&solved);
    for first in (done + C..length).step_by(CHUNK) {
        let Some(rest) = known[first..].first_chunk_mut::<CHUNK>() else { break };
        for c in 0..C {
            let Some(column) = panel[(done + c) * length + first..].first_chunk::<CHUNK>() else { break };
            for r in 0..CHUNK {
                rest[r] -= column[r] * solved[c];
            }
        }
    }
}

/// Solves for some unknowns, given those below.
#[inline(always)]
fn backwards_columns<const C: usize>(panel: &[f64], length: usize, done: usize, known: &mut [f64]) {
    let mut sums = [[0.0; CHUNK]; C];
    for first in (done + C..length).step_by(CHUNK) {
        let Some(rest) = known[first..].first_chunk::<CHUNK>() else { break };
        for c in 0..C {
            let Some(column) = panel[(done + c) * length + first..].first_chunk::<CHUNK>() else { break };
            for r in 0..CHUNK {
                sums[c][r] += column[r] * rest[r];
            }
        }
    }
    for c in (0..C).rev() {
        let column = &panel[(done + c) * length + done..][..C];
        let mut value = known[done + c] - total(&sums[c]);
        for r in c + 1..C {
            value -= column[r] * known[done + r];
        }
        known[done + c] = value / column[c];
    }
}

#[inline(always)]
fn total(sums: &[f64; CHUNK]) -> f64 {
    ((sums[0] + sums[4]) + (sums[2] + sums[6])) + ((sums[1] + sums[5]) + (sums[3] + sums[7]))
}

/// In eight sums.
#[inline(always)]
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; CHUNK];
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<CHUNK>(), b.as_chunks::<CHUNK>());
    for (a, b) in a.iter().zip(b) {
        for k in 0..CHUNK {
            sums[k] += a[k] * b[k];
        }
    }
    for (k, (a, b)) in a_rest.iter().zip(b_rest).enumerate() {
        sums[k] += a * b;
    }
    total(&sums)
}
