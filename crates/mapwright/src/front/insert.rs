//! Step 4: what of a scan a keyframe shows.

use super::prepare::Preparation;
use crate::sensors::PerSensor;
use mapwright_geom::{Pose2, stored};
use mapwright_grid::LocalMap;
use mapwright_record::Beams;

/// From this share of end points in space that beams have passed on, they are taken for somebody in the way and left
/// out of the map.
const INTRUDER_SHARE: f64 = 0.15;
/// After so many keyframes in a row it is the world that has changed.
const INTRUDED_AT_MOST: u32 = 16;

/// Tells people in the way from a world that has changed.
#[derive(Debug, Clone, Default)]
pub(super) struct Intruders {
    /// By laser, keyframes in a row with somebody in the way.
    in_a_row: PerSensor<u32>,
}

stored!(Intruders { in_a_row });

impl Intruders {
    /// The beams of the present scan that end in space known to be free, where they are many: people in the way, or a match
    /// that is wrong. Few of them are news, a door or a chair, and stay.
    pub(super) fn find(&mut self, map: &LocalMap, scan: &Preparation, local_from_robot: Pose2) -> Option<Beams> {
        let (sweep, hits) = (scan.sweep()?, &scan.points().hits);
        let mut intruders = Vec::new();
        let _ = map.agreement_of_each(hits, local_from_robot, |hit| intruders.push(hit));
        let many = intruders.len() as f64 >= INTRUDER_SHARE * hits.len() as f64;
        let in_a_row = self.in_a_row.of(scan.laser());
        *in_a_row = if many { *in_a_row + 1 } else { 0 };
        if !many || *in_a_row > INTRUDED_AT_MOST {
            return None;
        }
        let hits: Vec<u32> = (0..sweep.codes.len()).filter(|&b| sweep.range_m(b).is_some()).map(|b| b as u32).collect();
        Some(Beams::These(intruders.into_iter().map(|hit| hits[hit]).collect()))
    }
}
