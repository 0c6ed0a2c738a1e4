//! Robots that explore.

use mapwright_geom::Pose2;

/// A robot as it last said it was.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Explorer {
    /// Its number, unlike any other's.
    pub id: u32,
    /// Where it is in the map.
    pub map_from_robot: Pose2,
    /// When it last said so, seconds.
    pub heard_s: f64,
    /// Radius of the circle that it needs, metres.
    pub radius_m: f64,
    /// How fast it drives, m/s.
    pub speed_m_per_s: f64,
    /// How far its sensor sees, metres.
    pub reach_m: f64,
    /// Who says where it goes.
    pub decides: Decides,
}

/// Who says where a robot goes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Decides {
    /// It is given orders here.
    #[default]
    Here,
    /// It decides for itself, by the same code on its own computer, and says what it has chosen.
    Itself {
        /// Where it goes, metres in the map; none where it has chosen nothing.
        goal_m: Option<[f64; 2]>,
    },
}

impl Explorer {
    pub(crate) fn at_m(&self) -> [f64; 2] {
        [self.map_from_robot.x, self.map_from_robot.y]
    }

    pub(crate) fn is_ordered(&self) -> bool {
        self.decides == Decides::Here
    }
}
