//! What another robot says of its own way, looked at again by who has its readings: what it saw at a keyframe has to fit what it saw on the way
//! there. A robot that says how it moved and is wrong, whatever the reason, says where its readings do not fit each other.

use crate::cascade::Finding;
use crate::submaps::{PoseOf, Submaps, Window};
use crate::views::views_along;
use mapwright_record::{Measurement, NodeId, Past};

/// Length of the way that a keyframe is compared with, metres: what one sees of a room.
pub const COMPARED_M: f64 = 4.0;
/// Where it says it is one may be wrong by so much, metres and radians, as in any look at an old place.
const CLAIM_M: f64 = super::closing::WINDOW_M;
const CLAIM_RAD: f64 = super::closing::WINDOW_RAD;

/// What was seen at `to` looked for in what the same sensor saw within so many metres of the way around `from`, on both sides or only before it,
/// where the robot says it was. None where nothing can be compared.
pub fn look_where_said<S: Submaps>(
    past: Past<'_, S::Measurement>,
    [from, to]: [NodeId; 2],
    from_from_to: PoseOf<S>,
    both_sides: bool,
    submaps: &mut S,
) -> Option<Finding<PoseOf<S>>> {
    let query = views_along(past, to, false, 0.0);
    let sensor = &query.first()?.sweep;
    let mut views = views_along(past, from, both_sides, COMPARED_M);
    views.retain(|view| view.sweep.is_of_one_sensor_with(sensor));
    if views.is_empty() {
        return None;
    }
    let window = Window {
        target_from_query: from_from_to,
        half_width_m: CLAIM_M,
        half_height_m: CLAIM_M,
        half_width_rad: CLAIM_RAD,
    };
    let (target, query) = (submaps.draw(&views), submaps.draw(&query));
    Some(submaps.look_for(&query, &target, &window))
}
