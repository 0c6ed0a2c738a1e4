//! What a ray can hit.

use crate::math::{Point, add, cross, distance, dot, lerp, norm, scale, sub};

/// Share of a segment's length by which a hit may lie beyond its ends, so that no ray slips through a corner.
const END_SLACK: f64 = 1e-9;

/// A straight wall from `a` to `b`, metres in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// One end.
    pub a: Point,
    /// The other end.
    pub b: Point,
}

/// A round thing, metres in the world: pillar, table leg or person.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circle {
    /// Its centre.
    pub center: Point,
    /// Its radius.
    pub radius_m: f64,
}

impl Segment {
    /// Distance along the ray from `origin` in unit `direction` to the segment, metres; infinite where it misses.
    #[must_use]
    #[inline]
    pub fn cast(&self, origin: Point, direction: Point) -> f64 {
        let along = sub(self.b, self.a);
        let to_start = sub(self.a, origin);
        let inverse = 1.0 / cross(direction, along);
        let range_m = cross(to_start, along) * inverse;
        let share = cross(to_start, direction) * inverse;
        if range_m >= 0.0 && (-END_SLACK..=1.0 + END_SLACK).contains(&share) { range_m } else { f64::INFINITY }
    }

    /// Length, metres.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        distance(self.a, self.b)
    }

    /// Distance from a point to the nearest point of the segment, metres.
    #[must_use]
    pub fn distance_to_point(&self, point: Point) -> f64 {
        let along = sub(self.b, self.a);
        let squared = dot(along, along);
        let share = if squared > 0.0 { (dot(sub(point, self.a), along) / squared).clamp(0.0, 1.0) } else { 0.0 };
        distance(point, lerp(self.a, self.b, share))
    }

    /// Smallest distance of two segments, metres; zero where they cross.
    #[must_use]
    pub fn distance_to_segment(&self, other: &Self) -> f64 {
        if self.crosses(other) {
            return 0.0;
        }
        let here = self.distance_to_point(other.a).min(self.distance_to_point(other.b));
        here.min(other.distance_to_point(self.a)).min(other.distance_to_point(self.b))
    }

    fn crosses(&self, other: &Self) -> bool {
        let (d, e) = (sub(self.b, self.a), sub(other.b, other.a));
        let sides = |base: Point, along: Point, p: Point, q: Point| {
            cross(along, sub(p, base)) * cross(along, sub(q, base)) < 0.0
        };
        sides(self.a, d, other.a, other.b) && sides(other.a, e, self.a, self.b)
    }
}

impl Circle {
    /// Distance along the ray from `origin` in unit `direction` to the circle, metres; infinite where it misses or
    /// starts inside.
    #[must_use]
    #[inline]
    pub fn cast(&self, origin: Point, direction: Point) -> f64 {
        let to_center = sub(self.center, origin);
        let along_m = dot(to_center, direction);
        let outside = dot(to_center, to_center) - self.radius_m * self.radius_m;
        let discriminant = along_m * along_m - outside;
        if along_m < 0.0 || outside < 0.0 || discriminant < 0.0 {
            return f64::INFINITY;
        }
        along_m - discriminant.sqrt()
    }

    /// The circle moved away from `point` until its centre is at least `keep_m` from it.
    pub(crate) fn kept_from(self, point: Point, keep_m: f64) -> Self {
        let away = sub(self.center, point);
        let far_m = norm(away);
        if far_m >= keep_m || far_m == 0.0 {
            return self;
        }
        Self { center: add(point, scale(away, keep_m / far_m)), ..self }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_hit_where_drawn() {
        let wall = Segment { a: [2.0, -1.0], b: [2.0, 1.0] };
        assert_eq!(wall.cast([0.0, 0.0], [1.0, 0.0]), 2.0);
        assert_eq!(wall.cast([0.0, 0.0], [-1.0, 0.0]), f64::INFINITY);
        assert_eq!(wall.cast([0.0, 0.0], [0.0, 1.0]), f64::INFINITY);
        let pillar = Circle { center: [3.0, 0.0], radius_m: 0.5 };
        assert_eq!(pillar.cast([0.0, 0.0], [1.0, 0.0]), 2.5);
        assert_eq!(pillar.cast([0.0, 0.6], [1.0, 0.0]), f64::INFINITY);
        assert_eq!(pillar.cast([3.1, 0.0], [1.0, 0.0]), f64::INFINITY);
    }

    #[test]
    fn distances_of_segments() {
        let a = Segment { a: [0.0, 0.0], b: [2.0, 0.0] };
        assert_eq!(a.distance_to_segment(&Segment { a: [1.0, -1.0], b: [1.0, 1.0] }), 0.0);
        assert_eq!(a.distance_to_segment(&Segment { a: [3.0, 0.0], b: [4.0, 5.0] }), 1.0);
    }
}
