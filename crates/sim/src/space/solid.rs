//! What worlds in space are made of: boxes, aligned with the axes or turned.

use crate::math::Point;
use mapwright_geom::{Point as _, sin_cos};

/// A point or vector in space, metres.
pub(crate) type Point3 = [f64; 3];

/// A ray that never runs quite parallel to a face.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Ray {
    pub(crate) origin: Point3,
    pub(crate) direction: Point3,
    pub(crate) inverse: Point3,
}

impl Ray {
    pub(crate) fn new(origin: Point3, direction: Point3) -> Self {
        let inverse = direction.map(|d| if d.abs() > 1e-12 { 1.0 / d } else { 1e12 });
        Self { origin, direction, inverse }
    }
}

/// A solid box.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Solid {
    centre: Point3,
    half_m: Point3,
    /// Unit vectors along its edges; none where they are the world's axes.
    axes: Option<[Point3; 3]>,
}

impl Solid {
    /// A box between two corners, aligned with the world's axes, metres.
    #[must_use]
    pub fn aligned(low: [f64; 3], high: [f64; 3]) -> Self {
        let centre = std::array::from_fn(|k| 0.5 * (low[k] + high[k]));
        let half_m = std::array::from_fn(|k| 0.5 * (high[k] - low[k]).abs());
        Self { centre, half_m, axes: None }
    }

    /// An upright box of a size, turned about its centre by `yaw_rad` counter-clockwise from above.
    #[must_use]
    pub fn turned(centre: [f64; 3], size_m: [f64; 3], yaw_rad: f64) -> Self {
        let (sin, cos) = sin_cos(yaw_rad);
        Self::along(centre, size_m, [cos, sin])
    }

    /// An upright box whose first side lies along a unit vector of the plane.
    pub(crate) fn along(centre: Point3, size_m: Point3, [x, y]: Point) -> Self {
        let axes = [[x, y, 0.0], [-y, x, 0.0], [0.0, 0.0, 1.0]];
        let is_aligned = x == 1.0 && y == 0.0;
        Self { centre, half_m: size_m.map(|side| 0.5 * side), axes: (!is_aligned).then_some(axes) }
    }

    /// A ramp: the middle line of its upper face leads `from` one point `to` another, not straight up.
    #[must_use]
    pub fn ramp(from: [f64; 3], to: [f64; 3], width_m: f64, thickness_m: f64) -> Self {
        let way = to.minus(from);
        let (length_m, run_m) = (way.dot(way).sqrt(), (way[0] * way[0] + way[1] * way[1]).sqrt());
        let ahead = way.map(|v| v / length_m);
        let left = [-way[1] / run_m, way[0] / run_m, 0.0];
        let up = cross(ahead, left);
        let centre = from.plus(0.5, way).plus(-0.5 * thickness_m, up);
        Self { centre, half_m: [0.5 * length_m, 0.5 * width_m, 0.5 * thickness_m], axes: Some([ahead, left, up]) }
    }

    /// Whether its edges run along the world's axes.
    pub(crate) fn is_aligned(&self) -> bool {
        self.axes.is_none()
    }

    /// Low and high corner of the aligned box around it.
    pub(crate) fn bounds(&self) -> [Point3; 2] {
        let reach_m: Point3 = match self.axes {
            None => self.half_m,
            Some(axes) => std::array::from_fn(|k| (0..3).map(|side| self.half_m[side] * axes[side][k].abs()).sum()),
        };
        [self.centre.minus(reach_m), self.centre.plus(1.0, reach_m)]
    }

    /// Its centre, metres.
    #[must_use]
    pub fn centre(&self) -> [f64; 3] {
        self.centre
    }

    /// A vector of the world along its edges.
    fn inside(&self, v: Point3) -> Point3 {
        self.axes.map_or(v, |axes| axes.map(|axis| axis.dot(v)))
    }

    /// Where a ray enters it, in lengths of its direction; zero from within.
    pub(crate) fn cast(&self, ray: &Ray) -> Option<f64> {
        let from = self.inside(ray.origin.minus(self.centre));
        let inverse = match self.axes {
            None => ray.inverse,
            Some(_) => Ray::new(from, self.inside(ray.direction)).inverse,
        };
        let (mut near, mut far) = (0.0_f64, f64::INFINITY);
        for k in 0..3 {
            let [a, b] = [(-self.half_m[k] - from[k]) * inverse[k], (self.half_m[k] - from[k]) * inverse[k]];
            near = near.max(a.min(b));
            far = far.min(a.max(b));
        }
        (near <= far).then_some(near)
    }

    /// Distance of a point from it, metres; zero inside.
    pub(crate) fn distance_m(&self, point: Point3) -> f64 {
        let from = self.inside(point.minus(self.centre));
        let beyond: Point3 = std::array::from_fn(|k| (from[k].abs() - self.half_m[k]).max(0.0));
        beyond.dot(beyond).sqrt()
    }

    /// The outward normal of the face that a point on its surface lies on.
    #[must_use]
    pub fn normal_at(&self, point: [f64; 3]) -> [f64; 3] {
        let from = self.inside(point.minus(self.centre));
        let depth_m: Point3 = std::array::from_fn(|k| from[k].abs() - self.half_m[k]);
        let face = (1..3).fold(0, |best, k| if depth_m[k] > depth_m[best] { k } else { best });
        let sign = 1.0_f64.copysign(from[face]);
        let unit: Point3 = std::array::from_fn(|k| if k == face { 1.0 } else { 0.0 });
        self.axes.map_or(unit, |axes| axes[face]).map(|v| sign * v)
    }
}

fn cross(a: Point3, b: Point3) -> Point3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: Point3, b: Point3) -> bool {
        a.distance(b) < 1e-12
    }

    #[test]
    fn a_turned_box_is_hit_on_its_edge() {
        let solid = Solid::turned([5.0, 0.0, 1.0], [2.0, 2.0, 2.0], std::f64::consts::FRAC_PI_4);
        let hit = solid.cast(&Ray::new([0.0, 0.0, 1.0], [1.0, 0.0, 0.0])).unwrap();
        assert!((hit - (5.0 - 2f64.sqrt())).abs() < 1e-9, "{hit}");
        assert!(solid.cast(&Ray::new([0.0, 1.5, 1.0], [1.0, 0.0, 0.0])).is_none());
        let half = 0.5f64.sqrt();
        assert!(close(solid.normal_at([5.0 - half, half, 1.0]), [-half, half, 0.0]));
    }

    #[test]
    fn a_ramp_is_as_high_as_its_way() {
        let ramp = Solid::ramp([1.0, 2.0, 0.5], [9.0, 2.0, 2.5], 2.0, 0.2);
        for (x, z) in [(1.0, 0.5), (5.0, 1.5), (8.99, 2.4975)] {
            let hit = ramp.cast(&Ray::new([x, 2.9, 10.0], [0.0, 0.0, -1.0])).unwrap();
            assert!((hit - (10.0 - z)).abs() < 1e-9, "at {x}: {hit}");
        }
        assert!(close(ramp.normal_at([5.0, 2.0, 1.5]), [-0.25, 0.0, 1.0].map(|v: f64| v / 1.0625f64.sqrt())));
        assert!((ramp.distance_m([5.0, 2.0, 1.5]) - 0.0).abs() < 1e-12);
    }

    #[test]
    fn distances_are_those_to_the_nearest_face_or_corner() {
        let solid = Solid::aligned([0.0; 3], [1.0, 2.0, 3.0]);
        assert_eq!(solid.distance_m([4.0, 6.0, 3.0]), 5.0);
        assert_eq!(solid.distance_m([0.5, 0.5, 0.5]), 0.0);
        assert_eq!(solid.cast(&Ray::new([0.5, 0.5, 0.5], [1.0, 0.0, 0.0])), Some(0.0));
        assert_eq!(solid.cast(&Ray::new([-2.0, 1.0, 1.0], [1.0, 0.0, 0.0])), Some(2.0));
        assert_eq!(solid.cast(&Ray::new([-2.0, 1.0, 1.0], [-1.0, 0.0, 0.0])), None);
    }
}
