//! Several robots in one recording, told apart by the namespaces of their topics.

use crate::channel::TopicKind;
use crate::choice::Choice;
use crate::links::{Links, joined, namespace};
use crate::survey::{Survey, TopicSurvey};
use crate::words::grouped;
use std::borrow::Cow;

/// A robot of a recording: a namespace with scans and with odometry or transforms of its own.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Robot {
    /// The namespace, without slashes around it; empty for that of all topics.
    pub name: String,
    /// Its topics of scans with their messages.
    scans: Vec<(String, u64)>,
    frame: String,
}

impl Robot {
    fn words(&self) -> String {
        let scans = self.scans.iter().map(|(name, count)| format!("{name}, {} scans", grouped(*count)));
        format!("{} ({})", self.shown(), scans.collect::<Vec<_>>().join("; "))
    }

    /// Its name as it is typed.
    #[must_use]
    pub fn shown(&self) -> &str {
        if self.name.is_empty() { "/" } else { &self.name }
    }
}

/// Whether a namespace is another one or lies within it.
fn is_within(namespace: &str, outer: &str) -> bool {
    outer.is_empty() || namespace.strip_prefix(outer).is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
}

/// Whether a topic is in a namespace.
pub(crate) fn is_of(topic: &str, outer: &str) -> bool {
    is_within(namespace(topic), outer)
}

/// The namespace of the nearest odometry or transforms around a topic.
fn owner<'a>(survey: &Survey, topic: &'a str) -> &'a str {
    let mut outer = namespace(topic);
    let moves =
        |topic: &&TopicSurvey| topic.usable() > 0 && matches!(topic.kind, TopicKind::Odometry | TopicKind::Transforms);
    while !outer.is_empty() && !survey.topics.iter().filter(moves).any(|topic| is_of(&topic.name, outer)) {
        outer = outer.rsplit_once('/').map_or("", |(rest, _)| rest);
    }
    outer
}

impl Survey {
    /// The robots whose scans are in the recording; one where nothing tells several apart.
    ///
    /// Scans belong to the nearest namespace around them that holds odometry or transforms. Two of these are one robot where transforms
    /// that both share fix their frames to each other.
    #[must_use]
    pub fn robots(&self) -> Vec<Robot> {
        let mut robots: Vec<Robot> = Vec::new();
        for topic in self.topics.iter().filter(|topic| topic.kind.is_planar() && topic.usable() > 0) {
            let (name, scans) = (owner(self, &topic.name), (topic.name.clone(), topic.usable()));
            match robots.iter_mut().find(|robot| robot.name == name || self.is_one(robot, name, topic.frame())) {
                Some(robot) => robot.scans.push(scans),
                None => {
                    let (name, frame) = (name.to_owned(), topic.frame().to_owned());
                    robots.push(Robot { name, scans: vec![scans], frame });
                }
            }
        }
        robots
    }

    /// Whether a frame of another namespace is fixed to a robot.
    fn is_one(&self, robot: &Robot, name: &str, frame: &str) -> bool {
        let has_tree = |name: &str| !name.is_empty() && self.trees.iter().any(|(tree, _)| is_within(tree, name));
        let share_tree = !has_tree(&robot.name) && !has_tree(name);
        share_tree && robot.frame != frame && self.links.constant(&robot.frame, frame).is_ok()
    }

    /// What there is of the robot that is asked for, by its name or by one of its topics; all, where there is but one.
    ///
    /// # Errors
    /// What to type, where there are several and none is asked for, or the name is that of none.
    pub(crate) fn of_robot(&self, choice: &Choice) -> Result<Cow<'_, Self>, String> {
        let robots = self.robots();
        let list = || robots.iter().map(Robot::words).collect::<Vec<_>>().join(", ");
        let asked = choice.robot.as_ref().map(|name| name.trim_matches('/'));
        if let Some(name) = asked
            && !robots.iter().any(|robot| robot.name == name)
        {
            return Err(format!("there is no robot {name}; there is {}", list()));
        }
        if robots.len() < 2 {
            return Ok(Cow::Borrowed(self));
        }
        let by_topic = || {
            let of_topic = |topic: &String| {
                let within = robots.iter().filter(|robot| is_of(topic, &robot.name));
                within.max_by_key(|robot| robot.name.len()).map(|robot| robot.name.as_str())
            };
            choice.topics.iter().find_map(of_topic)
        };
        match asked.or_else(by_topic) {
            Some(name) => Ok(Cow::Owned(self.without_others(name, &robots))),
            None => Err(format!(
                "{} robots in one recording: {}; choose one: mapwright map LOG --robot {} -o OUT; or map them all: mapwright \
                 merge LOG -o OUT",
                robots.len(),
                list(),
                robots.first().map_or("", Robot::shown)
            )),
        }
    }

    fn without_others(&self, name: &str, robots: &[Robot]) -> Self {
        let others: Vec<_> = robots.iter().map(|robot| &robot.name).filter(|other| *other != name).collect();
        let is_anothers = |topic: &str| {
            let nearer = others.iter().filter(|other| other.len() > name.len() || !is_of(topic, name));
            nearer.into_iter().any(|other| !other.is_empty() && is_of(topic, other))
        };
        let own =
            |topic: &&TopicSurvey| topic.kind == TopicKind::Odometry && !name.is_empty() && is_of(&topic.name, name);
        let has_own = self.topics.iter().any(|topic| own(&topic));
        let is_kept = |topic: &&TopicSurvey| {
            !is_anothers(&topic.name) && (topic.kind != TopicKind::Odometry || !has_own || own(topic))
        };
        let topics = self.topics.iter().filter(is_kept).cloned().collect();
        let is_own_tree = |tree: &&(String, Links)| !is_anothers(&format!("{}/tf", tree.0));
        let trees: Vec<_> = self.trees.iter().filter(is_own_tree).cloned().collect();
        let links = joined(&trees);
        Self {
            topics,
            links,
            trees,
            container: self.container.clone(),
            metadata_beside: self.metadata_beside.clone(),
            held_bytes: self.held_bytes,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn namespaces_hold_what_is_within_them() {
        assert_eq!(["/scan", "scan", "/a/b/scan", "a/scan"].map(namespace), ["", "", "a/b", "a"]);
        assert!(is_of("/a/b/scan", "a") && is_of("/a/scan", "a") && is_of("/scan", "") && is_of("/a/scan", ""));
        assert!(!is_of("/ab/scan", "a") && !is_of("/scan", "a"));
    }
}
