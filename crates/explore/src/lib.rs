//! Where robots should drive to see what their map does not show yet: frontiers, shared among several robots.
//!
//! Values in, values out: a map, the robots and the time go in; a goal and a way for each robot come out, and in the end every frontier that
//! is left, with the reason. Nothing reads a clock. One robot explores by the same code as eight.
//!
//! - [`OccupancyMap`]: unknown, free, occupied; from the counts of one map or of several in one frame, or sweep by sweep ([`SharedMap`]).
//! - [`Exploration`]: who goes where ([`Exploration::decide`]). Frontiers (Yamauchi 1997), the utility of goals discounted by what others will
//!   see (Burgard et al. 2005, "Coordinated multi-robot exploration"; *Probabilistic Robotics*, chapter 17), commitment, and a watchdog
//!   with a blacklist that ages. It always ends; why stands there.
//! - [`Terrain`], [`Travel`]: where a robot can stand, and what it takes to get anywhere.
//! - [`Traffic`]: ways of robots near each other, planned in space and time in order of priority (Silver 2005).
//!
//! ```
//! use mapwright_explore::{Cell, Decides, Exploration, ExploreSettings, Explorer, OccupancyMap};
//! use mapwright_geom::Pose2;
//! // A room of 4 by 2 m, its right half unknown.
//! let cells = (0..44 * 24).map(|cell| match (cell % 44, cell / 44) {
//!     (2 | 41, 2..=21) | (2..=41, 2 | 21) => Cell::Occupied,
//!     (3..=20, 3..=20) => Cell::Free,
//!     _ => Cell::Unknown,
//! });
//! let map = OccupancyMap::new([0.0; 2], 0.1, 44, cells.collect()).unwrap();
//! let robot = Explorer {
//!     id: 1,
//!     map_from_robot: Pose2::new(1.0, 1.2, 0.0),
//!     heard_s: 0.0,
//!     radius_m: 0.2,
//!     speed_m_per_s: 0.5,
//!     reach_m: 10.0,
//!     decides: Decides::Here,
//! };
//! let decision = Exploration::new(ExploreSettings::default()).decide(&map, &[robot], 0.0);
//! assert!(decision.orders[0].goal_m.is_some_and(|[x, _]| x > 1.9) && !decision.done);
//! ```

mod assign;
mod claims;
mod explorer;
mod frontier;
mod map;
mod places;
mod robot;
mod traffic;
mod travel;

pub use assign::Strategy;
pub use explorer::{Decision, Exploration, ExploreSettings, Left, Order};
pub use map::{Cell, OccupancyMap, SharedMap};
pub use places::WhyLeft;
pub use robot::{Decides, Explorer};
pub use traffic::{Traffic, Traveller};
pub use travel::{Terrain, Travel};
