//! What a voxel knows of the points in it.

use crate::eigen::axes;
use nalgebra::{Matrix3, Vector3};

/// A coordinate within a voxel is counted in so many parts of its side.
const PARTS: f64 = 4096.0;
/// A voxel with fewer points has no surfel, and one of fewer than that is no plane to rely on: so few lie on one by chance.
const LEAST_POINTS: u32 = 5;
/// A surfel that says where a surface lies has so many points at least.
pub const TELLING_POINTS: u32 = 8;
/// A surface is as thick as this share of the voxel's side at least: what is curved or rough within it.
const LEAST_THICKNESS: f64 = 0.02;

/// What a point tells along a plane's normal is less by so many times what it would tell along the plane where the points spread less:
/// nothing where they lie on a line, as those of a single beam do, whose normal nobody knows.
const ALONG: f64 = 4.0;
/// A surface that beams meet at such an angle, radians, is seen edge-on and is none: the points of one ring that goes around a corner look
/// like a plane, in which its beams lie.
const EDGE_ON: f64 = 0.05;
/// A surfel says nothing beyond where its points lie: so many squared standard deviations along it; those spread over a square reach 3 to
/// its edges and 6 to its corners.
const REACH2: f64 = 6.0;

/// Sums over the points of a voxel, in integers: what was added can be taken away to the bit, in any order.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Sums {
    pub(crate) count: u32,
    sum: [i64; 3],
    /// xx, xy, xz, yy, yz, zz.
    squares: [i64; 6],
    /// Directions in which they were seen.
    rays: [i64; 3],
}

/// The points of a voxel as a piece of a plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surfel {
    /// How many points.
    pub count: u32,
    /// Their mean, metres.
    pub mean_m: [f32; 3],
    /// The direction in which they spread least, to the side from which they were seen.
    pub normal: [f32; 3],
    /// What a point on it tells along the normal, 1/m^2; nothing where its points lie on a line.
    pub(crate) information: f32,
    /// See [`Surfel::spread_m`].
    spread_m: [f32; 2],
    /// Along which they spread most.
    far: [f32; 3],
}

impl Surfel {
    /// How far a point lies off its plane, metres.
    #[inline]
    pub(crate) fn off_m(&self, at: Vector3<f64>) -> f64 {
        let [normal, mean] = [self.normal, self.mean_m].map(|v| Vector3::from(v.map(f64::from)));
        normal.dot(&(at - mean))
    }

    /// Whether it knows its normal.
    #[inline]
    pub(crate) fn is_telling(&self) -> bool {
        self.information > 0.0
    }

    /// Whether who looks along such a ray sees its back, which is another surface: the floor above a ceiling, the other side of a wall.
    #[inline]
    pub(crate) fn is_behind(&self, ray: Vector3<f64>) -> bool {
        let along = Vector3::from(self.normal.map(f64::from)).dot(&ray);
        along > 0.0 && along * along > EDGE_ON * EDGE_ON * ray.norm_squared()
    }

    /// Whether a point lies where its points do, however far off.
    #[inline]
    pub(crate) fn covers(&self, at: [f64; 3]) -> bool {
        let [normal, mean, far] = [self.normal, self.mean_m, self.far].map(|v| Vector3::from(v.map(f64::from)));
        let from_mean = Vector3::from(at) - mean;
        let [off2, far2] = [normal, far].map(|axis| axis.dot(&from_mean).powi(2));
        let [along_m, most_m] = self.spread_m();
        (from_mean.norm_squared() - off2 - far2) / (along_m * along_m) + far2 / (most_m * most_m) <= REACH2
    }

    /// Standard deviations of its points along the surface, the lesser first, metres: one next to nothing is a line, whose normal nobody
    /// knows. Neither is less than the thickness that a surface has at least.
    #[must_use]
    pub fn spread_m(&self) -> [f64; 2] {
        self.spread_m.map(f64::from)
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
    pub(crate) fn add(&mut self, within: [f64; 3], ray: [f64; 3], sign: i64) {
        let [x, y, z] = within.map(|v| (v * PARTS) as i64);
        self.count = self.count.wrapping_add(sign as u32);
        for (sum, value) in self.sum.iter_mut().zip([x, y, z]) {
            *sum += sign * value;
        }
        for (sum, value) in self.rays.iter_mut().zip(ray) {
            *sum += sign * (value * PARTS) as i64;
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
        let [across, along, most] = [0, 1, 2].map(|k| variances[k].max(least * least));
        let ray = Vector3::from(self.rays.map(|sum| sum as f64));
        let is_by_chance = self.count < TELLING_POINTS;
        let along_ray = vectors.column(0).dot(&ray);
        let is_edge_on = along_ray.abs() < EDGE_ON * ray.norm();
        let information = if is_edge_on || is_by_chance { 0.0 } else { (1.0 / across - ALONG / along).max(0.0) as f32 };
        let spread_m = [along, most].map(|variance| variance.sqrt() as f32);
        let mean_m = [0, 1, 2].map(|k| (corner[k] * size_m + mean[k] * unit_m) as f32);
        let facing = if along_ray > 0.0 { -1.0 } else { 1.0 };
        let normal = [0, 1, 2].map(|row| (facing * vectors[(row, 0)]) as f32);
        let far = [0, 1, 2].map(|row| vectors[(row, 2)] as f32);
        Some(Surfel { count: self.count, mean_m, normal, information, spread_m, far })
    }
}
