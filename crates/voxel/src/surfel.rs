//! What a voxel knows of the points in it.

use crate::eigen::axes;
use nalgebra::Matrix3;

/// A coordinate within a voxel is counted in so many parts of its side.
const PARTS: f64 = 4096.0;
/// A voxel with fewer points says nothing of a surface.
const LEAST_POINTS: u32 = 5;
/// A surface is as thick as this share of the voxel's side at least: what is curved or rough within it.
const LEAST_THICKNESS: f64 = 0.02;

/// Points that spread along both directions of a surface by this share of the voxel's side at least show one: those that fill a
/// voxel by 0.29; those of one ring of a lidar, or of two where a wall meets the floor, are a line or an angle, whose normal nobody knows.
const LEAST_EXTENT: f64 = 0.15;
/// Of a surface no thinner than its sensor's noise it is not certain which way it lies: what it says across is taken off so many times.
const ACROSS: f64 = 2.0;

/// Sums over the points of a voxel, in integers: what was added can be taken away to the bit, in any order.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Sums {
    pub(crate) count: u32,
    sum: [i64; 3],
    /// xx, xy, xz, yy, yz, zz.
    squares: [i64; 6],
}

/// The points of a voxel as a normal distribution.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surfel {
    /// How many points.
    pub count: u32,
    /// Their mean, metres.
    pub mean_m: [f32; 3],
    /// The direction in which they spread least.
    pub normal: [f32; 3],
    /// Inverse covariance of a point on it, 1/m^2: xx, xy, xz, yy, yz, zz.
    pub(crate) information: [f32; 6],
}

impl Surfel {
    /// Standard deviations of its points along the surface, the lesser first, metres: one next to nothing is a line, whose normal nobody
    /// knows. Neither is less than the thickness that a surface has at least.
    #[must_use]
    pub fn spread_m(&self) -> [f64; 2] {
        let [xx, xy, xz, yy, yz, zz] = self.information.map(f64::from);
        let Some(covariance) = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz).try_inverse() else { return [0.0; 2] };
        let (variances, _) = axes(covariance);
        [1, 2].map(|k| variances[k].max(0.0).sqrt())
    }

    /// What a point on it tells along its normal, because it is a surface and not because of where it ends, 1/m^2: nothing where its
    /// points show none in a voxel of side `size_m`.
    #[inline]
    pub(crate) fn along_normal(&self, size_m: f64) -> f64 {
        let [xx, xy, xz, yy, yz, zz] = self.information.map(f64::from);
        let [x, y, z] = self.normal.map(f64::from);
        let most = x * x * xx + y * y * yy + z * z * zz + 2.0 * (x * y * xy + x * z * xz + y * z * yz);
        // The other two eigenvalues by their sum and the sum of their squares.
        let sum = xx + yy + zz - most;
        let squares = xx * xx + yy * yy + zz * zz + 2.0 * (xy * xy + xz * xz + yz * yz) - most * most;
        let across = 0.5 * (sum + (2.0 * squares - sum * sum).max(0.0).sqrt());
        let is_surface = across * (LEAST_EXTENT * size_m).powi(2) <= 1.0;
        if is_surface { (most - ACROSS * across).max(0.0) } else { 0.0 }
    }

    /// Radius of the disc on which evenly spread points would lie as far apart as these, metres: such a disc of radius `r` has a variance
    /// of `r^2 / 4` along each of its axes.
    #[must_use]
    pub fn radius_m(&self) -> f64 {
        let [a, b] = self.spread_m();
        (2.0 * (a * a + b * b)).sqrt()
    }
}

impl Sums {
    /// Adds a point or takes it away (`sign` -1), which lies at so many voxels from the voxel's least corner.
    #[inline]
    pub(crate) fn add(&mut self, within: [f64; 3], sign: i64) {
        let [x, y, z] = within.map(|v| (v * PARTS) as i64);
        self.count = self.count.wrapping_add(sign as u32);
        for (sum, value) in self.sum.iter_mut().zip([x, y, z]) {
            *sum += sign * value;
        }
        for (sum, value) in self.squares.iter_mut().zip([x * x, x * y, x * z, y * y, y * z, z * z]) {
            *sum += sign * value;
        }
    }

    /// The surfel of a voxel of side `size_m` with its least corner there, of points with such noise; none where there are too few points.
    pub(crate) fn surfel(&self, corner: [f64; 3], size_m: f64, noise_m: f64) -> Option<Surfel> {
        if self.count < LEAST_POINTS {
            return None;
        }
        let share = 1.0 / f64::from(self.count);
        let mean = self.sum.map(|sum| sum as f64 * share);
        let [xx, xy, xz, yy, yz, zz] = self.squares.map(|sum| sum as f64 * share);
        let [mx, my, mz] = mean;
        let covariance = Matrix3::new(
            xx - mx * mx,
            xy - mx * my,
            xz - mx * mz,
            xy - mx * my,
            yy - my * my,
            yz - my * mz,
            xz - mx * mz,
            yz - my * mz,
            zz - mz * mz,
        );
        let unit_m = size_m / PARTS;
        let (variances, vectors) = axes(covariance * (unit_m * unit_m));
        let least = (LEAST_THICKNESS * size_m).max(noise_m);
        let weights = variances.map(|variance| 1.0 / variance.max(least * least));
        let information = vectors * Matrix3::from_diagonal(&weights) * vectors.transpose();
        let mean_m = [0, 1, 2].map(|k| (corner[k] * size_m + mean[k] * unit_m) as f32);
        let normal = [0, 1, 2].map(|k| vectors[(k, 0)] as f32);
        let entry = |row, column| information[(row, column)] as f32;
        let information = [entry(0, 0), entry(0, 1), entry(0, 2), entry(1, 1), entry(1, 2), entry(2, 2)];
        Some(Surfel { count: self.count, mean_m, normal, information })
    }
}
