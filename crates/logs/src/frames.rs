//! Where a sensor sits on which robot, by the transforms of a recording.

use crate::choice::Choice;
use crate::links::{Link, Links, base_rank, is_world};
use mapwright_geom::Pose3;

/// The robot's frame moves by no more than this out of the plane, radians.
pub(crate) const SWING_MOST_RAD: f64 = 5.0 * std::f64::consts::PI / 180.0;

/// A sensor's place.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Place {
    pub(crate) robot_frame: String,
    pub(crate) robot_from_sensor: Pose3,
    /// Why the robot's frame is this one.
    pub(crate) reason: String,
    /// What had to be assumed, where nothing says where the sensor sits.
    pub(crate) assumed: Option<String>,
}

/// Finds the robot that carries a sensor. `moved` are the frames that odometry says it moves.
pub(crate) fn place(links: &Links, sensor: &str, moved: &[&str], choice: &Choice) -> Result<Place, String> {
    place_within(links, sensor, moved, choice, SWING_MOST_RAD)
}

/// The same of a robot that may swing as it likes.
pub(crate) fn place_in_space(links: &Links, sensor: &str, moved: &[&str], choice: &Choice) -> Result<Place, String> {
    place_within(links, sensor, moved, choice, f64::INFINITY)
}

fn place_within(
    links: &Links,
    sensor: &str,
    moved: &[&str],
    choice: &Choice,
    swing_most_rad: f64,
) -> Result<Place, String> {
    if let Some(robot_frame) = &choice.frame {
        if !links.knows(sensor) && robot_frame.trim_start_matches('/') != sensor {
            return Ok(assumed_on(robot_frame.trim_start_matches('/'), sensor, "as asked for"));
        }
        return on(links, robot_frame.trim_start_matches('/'), sensor, "as asked for".to_owned(), swing_most_rad);
    }
    let above = links.above(sensor);
    if above.is_empty() {
        return Ok(unplaced(links, sensor, moved, swing_most_rad));
    }
    let is_moved = |link: &&Link| is_world(&link.parent) || moved.contains(&link.child.as_str());
    let robot = above.iter().position(is_moved).or_else(|| above.iter().position(|link| !link.is_constant()));
    let Some(at) = robot else {
        let frames = above.iter().map(|link| link.parent.as_str());
        let named = frames.filter_map(|frame| Some((base_rank(frame)?, frame))).min();
        let root = above.last().map_or(sensor, |link| &link.parent);
        let (robot_frame, reason) = match named {
            Some((_, frame)) => (frame, "a robot's frame by its name"),
            None => (root, "the root of the tree that the sensor is in"),
        };
        return on(links, robot_frame, sensor, reason.to_owned(), swing_most_rad);
    };
    // What hangs below the robot's frame may not move on it; in space a name is no sign of that.
    let carrier = above[at..].iter().map(|link| link.parent.as_str());
    let is_named = |frame: &str| swing_most_rad.is_finite() && base_rank(frame).is_some();
    let mut carrier = carrier.filter(|frame| moved.contains(frame) || is_named(frame));
    if !above.iter().any(is_moved)
        && let Some(robot_frame) = carrier.next()
    {
        return on(links, robot_frame, sensor, "the frame that carries the laser".to_owned(), swing_most_rad);
    }
    let link = above[at];
    let is_named = is_moved(&link);
    if !is_named && link.swung_rad > swing_most_rad {
        return Err(swinging(link, sensor));
    }
    let reason = if moved.contains(&link.child.as_str()) {
        "the frame that odometry moves".to_owned()
    } else {
        format!("the frame that moves in '{}' and carries '{sensor}'", link.parent)
    };
    on(links, &link.child, sensor, reason, swing_most_rad)
}

/// With the sensor rigidly on a frame that is known.
fn on(links: &Links, robot_frame: &str, sensor: &str, reason: String, swing_most_rad: f64) -> Result<Place, String> {
    match links.constant(robot_frame, sensor) {
        Ok(robot_from_sensor) => {
            Ok(Place { robot_frame: robot_frame.to_owned(), robot_from_sensor, reason, assumed: None })
        }
        Err(Some(link)) if link.swung_rad > swing_most_rad => Err(swinging(link, sensor)),
        Err(Some(link)) => Err(format!(
            "'{sensor}' moves on the robot: '{}' moves in '{}' by up to {:.3} m and {:.1} deg; expected a sensor that is \
             fixed to '{robot_frame}'. To map with the sensor itself as the robot: --frame {sensor}; where it is fixed after all: \
             --mount X,Y,YAW",
            link.child,
            link.parent,
            link.moved_m,
            link.turned_rad.to_degrees()
        )),
        Err(None) => Err(format!(
            "nothing links '{sensor}' to '{robot_frame}'; frames above '{sensor}': {}",
            list(links.above(sensor).iter().map(|link| link.parent.as_str()))
        )),
    }
}

fn swinging(link: &Link, sensor: &str) -> String {
    format!(
        "'{sensor}' tilts during the log: '{}' swings in '{}' by up to {:.1} deg out of the plane; a laser that tilts sweeps \
         through space, and its scans are no horizontal plane to map",
        link.child,
        link.parent,
        link.swung_rad.to_degrees()
    )
}

/// A sensor of which it is said by hand where it is on the robot.
pub(crate) fn placed_by_hand(links: &Links, sensor: &str, moved: &[&str], choice: &Choice) -> Place {
    let robot_frame = choice.frame.as_deref().map(|frame| frame.trim_start_matches('/'));
    let place = robot_frame.map_or_else(
        || unplaced(links, sensor, moved, f64::INFINITY),
        |frame| assumed_on(frame, sensor, "as asked for"),
    );
    Place { assumed: None, ..place }
}

/// A sensor of which no transform says where it is: in the robot's origin.
fn unplaced(links: &Links, sensor: &str, moved: &[&str], swing_most_rad: f64) -> Place {
    let named = links.iter().flat_map(|link| [link.child.as_str(), link.parent.as_str()]);
    let named = named.filter_map(|frame| Some((base_rank(frame)?, frame))).min().map(|(_, frame)| frame);
    let by_odometry = moved.iter().copied().find(|frame| !frame.is_empty());
    let (robot_frame, reason) = match (by_odometry, named) {
        (Some(frame), _) => (frame, "the frame that odometry moves"),
        (None, Some(frame)) => (frame, "a robot's frame by its name"),
        (None, None) => (sensor, "the sensor's own, for there is no other"),
    };
    if let Ok(place) = on(links, robot_frame, sensor, reason.to_owned(), swing_most_rad) {
        return place; // the sensor is the tree's root, or the robot itself
    }
    assumed_on(robot_frame, sensor, reason)
}

fn assumed_on(robot_frame: &str, sensor: &str, reason: &str) -> Place {
    let assumed = format!(
        "no transform says where '{sensor}' sits on the robot: assumed to sit in the origin of '{robot_frame}' and to look \
         ahead"
    );
    Place {
        robot_frame: robot_frame.to_owned(),
        robot_from_sensor: Pose3::identity(),
        reason: reason.to_owned(),
        assumed: Some(assumed),
    }
}

/// Names for people, the first few.
pub(crate) fn list<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let names: Vec<_> = names.collect();
    match names.len() {
        0 => "none".to_owned(),
        1..=12 => names.join(", "),
        more => format!("{} and {} more", names[..12].join(", "), more - 12),
    }
}
