//! Where to drive in space: a world together with a way through it.

use super::world::SpaceWorld;
use crate::math::{Point, distance};

/// A world in space and a way through it.
#[derive(Debug, Clone)]
pub struct SpaceSite {
    /// What can be seen.
    pub world: SpaceWorld,
    /// Waypoints on the floor to be driven in order, metres in the world.
    pub waypoints: Vec<[f64; 3]>,
}

impl SpaceSite {
    /// Length of the way seen from above, metres.
    #[must_use]
    pub fn length_m(&self) -> f64 {
        self.waypoints.windows(2).map(|leg| distance(flat(leg[0]), flat(leg[1]))).sum()
    }
}

/// A waypoint seen from above.
pub(crate) fn flat([x, y, _]: [f64; 3]) -> Point {
    [x, y]
}
