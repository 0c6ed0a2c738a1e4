//! Positions in the plane and in space.

use crate::sealed::Sealed;
use std::fmt::Debug;
use std::ops::{Index, IndexMut};

/// A position or a difference of two, metres: `[f64; 2]` in the plane, `[f64; 3]` in space.
pub trait Point:
    Copy + Debug + PartialEq + Default + Send + Sync + Index<usize, Output = f64> + IndexMut<usize> + Sealed + 'static
{
    /// How many coordinates there are.
    const DIMENSION: usize;

    /// The point with these coordinates.
    #[must_use]
    fn from_fn(coordinate: impl FnMut(usize) -> f64) -> Self;

    /// The scalar product, m^2.
    #[must_use]
    fn dot(self, other: Self) -> f64;

    /// `self - other`.
    #[inline]
    #[must_use]
    fn minus(self, other: Self) -> Self {
        Self::from_fn(|axis| self[axis] - other[axis])
    }

    /// `self + factor * other`.
    #[inline]
    #[must_use]
    fn plus(self, factor: f64, other: Self) -> Self {
        Self::from_fn(|axis| self[axis] + factor * other[axis])
    }

    /// Distance of two points, metres.
    #[inline]
    #[must_use]
    fn distance(self, other: Self) -> f64 {
        let apart = self.minus(other);
        apart.dot(apart).sqrt()
    }
}

impl Sealed for [f64; 2] {}
impl Sealed for [f64; 3] {}

impl Point for [f64; 2] {
    const DIMENSION: usize = 2;

    #[inline]
    fn from_fn(coordinate: impl FnMut(usize) -> f64) -> Self {
        std::array::from_fn(coordinate)
    }

    #[inline]
    fn dot(self, other: Self) -> f64 {
        self[0] * other[0] + self[1] * other[1]
    }
}

impl Point for [f64; 3] {
    const DIMENSION: usize = 3;

    #[inline]
    fn from_fn(coordinate: impl FnMut(usize) -> f64) -> Self {
        std::array::from_fn(coordinate)
    }

    #[inline]
    fn dot(self, other: Self) -> f64 {
        self[0] * other[0] + self[1] * other[1] + self[2] * other[2]
    }
}
