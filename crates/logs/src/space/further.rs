//! Which sensors of one robot are mapped together.

use super::topic::Candidate;
use crate::choice::Choice;
use crate::directions::Directions;
use crate::frames::list;
use crate::links::bare;
use crate::merge::WINDOW_S;
use crate::plan::{SAME_PLACE_M, SAME_PLACE_RAD};

/// A cloud of so many times fewer points than the first lidar's is none of a lidar's beside it, unless it is asked for: radars and rings of
/// ultrasound sensors send clouds as well.
const FEWER: u64 = 10;

/// The sensors that are mapped together.
pub(super) struct Lidars<'a> {
    pub(super) chosen: Candidate<'a>,
    /// The others, and why.
    pub(super) further: Vec<(Candidate<'a>, String)>,
    /// Those that are not, and why.
    unused: Vec<String>,
}

impl<'a> Lidars<'a> {
    /// Beside the chosen one those on the same robot that see other directions, or that are asked for.
    ///
    /// # Errors
    /// Why one that is asked for cannot be mapped with it, in words.
    pub(super) fn of(
        chosen: Candidate<'a>,
        others: impl Iterator<Item = Candidate<'a>>,
        choice: &Choice,
    ) -> Result<Self, String> {
        let mut lidars = Self { chosen, further: Vec::new(), unused: Vec::new() };
        let mut seen = Directions::default();
        lidars.chosen.adds_to(&mut seen);
        for other in others {
            match lidars.why_further(&other, choice, &mut seen) {
                Ok(why) => lidars.further.push((other, why)),
                Err(why) if choice.asks_for(&other.topic.name) => {
                    return Err(format!("{} beside {}: {why}", other.topic.name, lidars.chosen.topic.name));
                }
                Err(why) => lidars.unused.push(format!("{}: {why}", other.topic.name)),
            }
        }
        Ok(lidars)
    }

    /// Why another sensor is mapped with those before it, or why not.
    fn why_further(&self, other: &Candidate<'a>, choice: &Choice, seen: &mut Directions) -> Result<String, String> {
        let chosen = &self.chosen;
        if chosen.is_camera != other.is_camera {
            return Err("a depth camera and a lidar see too differently to be mapped together".to_owned());
        }
        for candidate in [chosen, other] {
            if candidate.place.assumed.is_some() {
                return Err(format!("nothing says where '{}' sits on the robot", candidate.topic.frame()));
            }
        }
        if chosen.place.robot_frame != other.place.robot_frame {
            return Err(format!("it sits on '{}', not on '{}'", other.place.robot_frame, chosen.place.robot_frame));
        }
        let first = |candidate: &Candidate<'_>| candidate.topic.clock_ahead_s();
        if let Some(apart_s) = first(chosen).zip(first(other)).map(|(a, b)| b - a).filter(|s| s.abs() > WINDOW_S) {
            return Err(format!("its clock is {apart_s:.1} s beside"));
        }
        let mut used = std::iter::once(chosen).chain(self.further.iter().map(|(further, _)| further));
        if let Some(same) = used.find(|used| used.is_of_one_sensor_with(other)) {
            return Err(format!("it has clouds of the sensor of {}", same.topic.name));
        }
        if choice.asks_for(&other.topic.name) {
            return Ok("as asked for".to_owned());
        }
        if chosen.is_camera {
            return Err(self.to_map_it_too(other, "depth cameras are mapped together where they are asked for"));
        }
        if bare(other.topic.frame()) == bare(&other.place.robot_frame) {
            return Err("in the robot's frame, so that somebody may have put these points together".to_owned());
        }
        let [points, fewer] = [chosen, other].map(|candidate| candidate.topic.points[0]);
        if fewer.saturating_mul(FEWER) < points {
            return Err(self.to_map_it_too(other, &format!("it has {fewer} points a cloud beside {points}")));
        }
        let new = other.adds_to(seen);
        new.map(|degrees| format!("it sees {degrees} deg around the robot that the others do not"))
            .ok_or_else(|| self.to_map_it_too(other, "it sees no direction that the others do not"))
    }

    fn to_map_it_too(&self, other: &Candidate<'_>, why: &str) -> String {
        let also = self.names().map(|name| format!(" --topic {name}")).collect::<String>();
        format!("{why}; to map it too:{also} --topic {}", other.topic.name)
    }

    fn names(&self) -> impl Iterator<Item = &str> {
        std::iter::once(&self.chosen).chain(self.further.iter().map(|(other, _)| other)).map(|c| c.topic.name.as_str())
    }

    /// The first, as it is chosen among the others.
    pub(super) fn why_chosen(&self, choice: &Choice) -> String {
        let why = match self.further.len() + self.unused.len() {
            _ if choice.asks_for(&self.chosen.topic.name) => "as asked for",
            0 => "the only topic that can be mapped in space",
            _ if self.further.is_empty() => "",
            _ => "the most points",
        };
        let parts = [why.to_owned(), self.unused_words()];
        parts.into_iter().filter(|part| !part.is_empty()).collect::<Vec<_>>().join("; ")
    }

    fn unused_words(&self) -> String {
        let unused = list(self.unused.iter().map(String::as_str));
        if self.unused.is_empty() { String::new() } else { format!("not used: {unused}") }
    }
}

impl Candidate<'_> {
    /// Whether both are clouds of one sensor, as one topic may have another's filtered: in one frame, or from one place that looks one way.
    fn is_of_one_sensor_with(&self, other: &Self) -> bool {
        let [a, b] = [self, other].map(|candidate| candidate.place.robot_from_sensor);
        let is_one_place = a.distance(b) <= SAME_PLACE_M && a.rotation.angle_to(&b.rotation) <= SAME_PLACE_RAD;
        bare(self.topic.frame()) == bare(other.topic.frame()) || is_one_place
    }

    /// The directions that it adds to those that are seen, degrees.
    fn adds_to(&self, seen: &mut Directions) -> Option<usize> {
        seen.add_in_space(&self.topic.glimpse, &self.place.robot_from_sensor)
    }
}
