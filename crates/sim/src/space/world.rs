//! What stands still in space, and rays into it.

use super::solid::{Ray, Solid};
use super::tree::Tree;

/// Where a ray ends.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpaceHit {
    /// How far that is, in lengths of the ray's direction: metres where that is a unit vector.
    pub at: f64,
    /// Number of the solid.
    pub solid: usize,
}

/// Solids, and a tree of them for rays.
#[derive(Debug, Clone)]
pub struct SpaceWorld {
    solids: Vec<Solid>,
    tree: Tree,
}

impl SpaceWorld {
    /// A world of solids, which may overlap.
    #[must_use]
    pub fn new(solids: Vec<Solid>) -> Self {
        let tree = Tree::new(&solids);
        Self { solids, tree }
    }

    /// What it is made of.
    #[must_use]
    pub fn solids(&self) -> &[Solid] {
        &self.solids
    }

    /// What a ray hits first within `far` lengths of its direction, to some 1e-5 of its length; from within a solid, that solid at zero.
    #[must_use]
    pub fn cast(&self, origin: [f64; 3], direction: [f64; 3], far: f64) -> Option<SpaceHit> {
        let ray = Ray::new(origin, direction);
        let (solid, roughly) = self.tree.cast(&self.solids, &ray, far)?;
        // single precision finds the solid, double precision the place
        Some(SpaceHit { at: self.solids[solid].cast(&ray).unwrap_or(roughly), solid })
    }

    /// Distance of a point from the nearest solid, metres; zero inside of one. Looks at every solid.
    #[must_use]
    pub fn distance_m(&self, point: [f64; 3]) -> f64 {
        self.solids.iter().map(|solid| solid.distance_m(point)).fold(f64::INFINITY, f64::min)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rng::Rng;

    #[test]
    fn rays_in_a_room_end_where_they_should() {
        let slab = |low, high| Solid::aligned(low, high);
        let world = SpaceWorld::new(vec![
            slab([-5.0, -5.0, -1.0], [5.0, 5.0, 0.0]),
            slab([-5.0, -5.0, 3.0], [5.0, 5.0, 4.0]),
            slab([4.0, -5.0, 0.0], [5.0, 5.0, 3.0]),
        ]);
        let range = |direction| world.cast([0.0, 0.0, 1.0], direction, 100.0).map(|hit| (hit.solid, hit.at));
        assert_eq!(range([0.0, 0.0, -1.0]), Some((0, 1.0)));
        assert_eq!(range([0.0, 0.0, 1.0]), Some((1, 2.0)));
        assert_eq!(range([1.0, 0.0, 0.0]), Some((2, 4.0)));
        assert_eq!(range([-1.0, 0.0, 0.0]), None);
        let (solid, at) = range([0.6, 0.0, -0.8]).unwrap();
        assert!(solid == 0 && (at - 1.25).abs() < 1e-12);
        assert_eq!(world.cast([0.0, 0.0, 1.0], [1.0, 0.0, 0.0], 3.9), None);
        assert_eq!(world.distance_m([0.0, 0.0, 1.0]), 1.0);
    }

    #[test]
    fn the_tree_finds_what_looking_at_every_solid_finds() {
        let mut rng = Rng::new(3);
        let any = |rng: &mut Rng, reach: f64| [0; 3].map(|_| rng.uniform(-reach, reach));
        let solid = |k: usize, rng: &mut Rng| {
            let (centre, size) = (any(rng, 20.0), any(rng, 3.0).map(f64::abs));
            if k.is_multiple_of(3) {
                Solid::turned(centre, size, rng.uniform(-3.0, 3.0))
            } else {
                Solid::along(centre, size, [1.0, 0.0])
            }
        };
        for count in [0, 1, 2, 5, 300] {
            let world = SpaceWorld::new((0..count).map(|k| solid(k, &mut rng)).collect());
            for _ in 0..2_000 {
                let (origin, direction) = (any(&mut rng, 25.0), any(&mut rng, 1.0));
                let ray = Ray::new(origin, direction);
                let all = world.solids().iter().filter_map(|solid| solid.cast(&ray)).fold(f64::INFINITY, f64::min);
                let found = world.cast(origin, direction, 1e3).map_or(f64::INFINITY, |hit| hit.at);
                assert!(found == all || (found - all).abs() < 1e-4 * (1.0 + all), "{found} {all}");
            }
        }
    }

    #[test]
    fn rays_along_axes_and_in_faces_do_no_harm() {
        let world = SpaceWorld::new(vec![Solid::aligned([1.0, 0.0, 0.0], [2.0, 1.0, 1.0])]);
        assert!(world.cast([0.0, 0.5, 0.5], [1.0, 0.0, 0.0], 9.0).is_some());
        assert!(world.cast([0.0, 2.0, 0.5], [1.0, 0.0, 0.0], 9.0).is_none());
        assert!(world.cast([0.0, 0.5, 0.5], [0.0; 3], 9.0).is_none());
    }
}
