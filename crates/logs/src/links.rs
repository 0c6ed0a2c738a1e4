//! Which frame hangs where, over a whole recording, in constant memory for each.

use mapwright_geom::{Pose3, Stamp};
use mapwright_ros::messages::TfMessage;
use nalgebra::{UnitQuaternion, Vector3};
use std::collections::BTreeMap;

/// A link that never moves farther than this stands still, metres and radians: what is left of rounding.
const CONSTANT_M: f64 = 2e-3;
const CONSTANT_RAD: f64 = 2e-3;
/// A mounting may jitter by so much, metres and radians, and its median counts: half a usual cell of a map, and what moves a wall 3 m away by
/// a cell.
const JITTER_M: f64 = 0.025;
const JITTER_RAD: f64 = 1.0 * std::f64::consts::PI / 180.0;
/// Poses of a link that are kept for its median, evenly over the recording; twice as many before every other one is dropped.
const SAMPLES: usize = 16;
/// Links that are remembered; further ones are only counted.
const LINKS_KEPT: usize = 10_000;
/// Frames above one another.
const DEPTH_MOST: usize = 256;

/// What a recording says about one frame in another.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// The outer frame.
    pub parent: String,
    /// The inner frame.
    pub child: String,
    /// Transforms.
    pub transforms: u64,
    /// Whether it is said to hold for all times.
    pub is_static: bool,
    /// The first one said.
    pub parent_from_child: Pose3,
    /// The farthest that it moved from the first, metres.
    pub moved_m: f64,
    /// The farthest that it turned from the first, radians.
    pub turned_rad: f64,
    /// How far its z axis swung from the first, radians.
    pub swung_rad: f64,
    samples: Samples,
}

/// Poses of a link that moves, evenly over the recording.
#[derive(Debug, Clone, Default, PartialEq)]
struct Samples {
    kept: Vec<Pose3>,
    /// One of so many is kept, as a power of two.
    every_log2: u32,
}

impl Samples {
    /// Takes in the pose with this number, from 0; all before the first that is taken in are like the very first.
    fn take(&mut self, number: u64, first: Pose3, pose: Pose3) {
        if self.kept.is_empty() {
            while number >> self.every_log2 > SAMPLES as u64 {
                self.every_log2 += 1;
            }
            self.kept = vec![first; (number >> self.every_log2).max(1) as usize];
        }
        if !number.is_multiple_of(1 << self.every_log2) {
            return;
        }
        self.kept.push(pose);
        if self.kept.len() >= 2 * SAMPLES {
            let mut number = 0;
            self.kept.retain(|_| {
                number += 1;
                number % 2 == 1
            });
            self.every_log2 += 1;
        }
    }

    /// Median of each coordinate, and of each angle away from the first pose.
    fn median(&self) -> Option<Pose3> {
        let first = self.kept.first()?;
        let turns: Vec<_> =
            self.kept.iter().map(|pose| (first.rotation.inverse() * pose.rotation).scaled_axis()).collect();
        let middle = |part: &dyn Fn(usize) -> f64| {
            let mut values: Vec<f64> = (0..self.kept.len()).map(part).collect();
            values.sort_by(f64::total_cmp);
            values[values.len() / 2]
        };
        let translation = Vector3::from_fn(|axis, _| middle(&|k| self.kept[k].translation[axis]));
        let turn = Vector3::from_fn(|axis, _| middle(&|k| turns[k][axis]));
        Some(Pose3 { translation, rotation: first.rotation * UnitQuaternion::from_scaled_axis(turn) })
    }
}

impl Link {
    /// Whether it holds for all times, by what is said or by what is seen; it may [jitter](Self::jitters).
    #[must_use]
    pub fn is_constant(&self) -> bool {
        self.is_static || (self.moved_m <= JITTER_M && self.turned_rad <= JITTER_RAD)
    }

    /// Whether it never moves at all.
    #[must_use]
    pub fn stands_still(&self) -> bool {
        self.moved_m <= CONSTANT_M && self.turned_rad <= CONSTANT_RAD
    }

    /// Whether it is constant but for a jitter.
    #[must_use]
    pub fn jitters(&self) -> bool {
        !self.is_static && self.is_constant() && !self.stands_still()
    }

    /// The one pose that stands for all: the first one said, and of a link that jitters the median.
    #[must_use]
    pub fn pose(&self) -> Pose3 {
        let median = if self.jitters() { self.samples.median() } else { None };
        median.unwrap_or(self.parent_from_child)
    }

    fn see(&mut self, now: Pose3) {
        let number = self.transforms;
        self.transforms += 1;
        let first = self.parent_from_child;
        self.moved_m = self.moved_m.max(first.translation.metric_distance(&now.translation));
        self.turned_rad = self.turned_rad.max(first.rotation.angle_to(&now.rotation));
        let (up_first, up_now) = (first.rotation * Vector3::z(), now.rotation * Vector3::z());
        self.swung_rad = self.swung_rad.max(up_first.angle(&up_now));
        if self.jitters() {
            self.samples.take(number, first, now);
        } else {
            self.samples = Samples::default();
        }
    }
}

/// All links of a recording. Frames' names lose the slashes that tf1 put in front.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Links {
    /// By child, then by parent, of which there should be one.
    by_child: BTreeMap<String, Vec<Link>>,
    kept: usize,
    /// Transforms with numbers that are none, frames without a name, and those for which there was no room.
    pub refused: u64,
}

impl Links {
    /// Takes in a message's transforms.
    pub fn see(&mut self, message: &TfMessage<'_>, is_static: bool) {
        for transform in &message.transforms {
            let (parent, child) = (transform.header.frame(), bare(&transform.child_frame_id));
            match transform.transform.to_pose3().filter(|pose| pose.is_finite()) {
                Some(pose) if !parent.is_empty() && !child.is_empty() && parent != child => {
                    self.insert(parent, child, pose, is_static);
                }
                _ => self.refused += 1,
            }
        }
    }

    fn insert(&mut self, parent: &str, child: &str, parent_from_child: Pose3, is_static: bool) {
        let links = self.by_child.get_mut(child);
        if let Some(link) = links.and_then(|links| links.iter_mut().find(|link| link.parent == parent)) {
            link.is_static |= is_static;
            return link.see(parent_from_child);
        }
        if self.kept >= LINKS_KEPT {
            self.refused += 1;
            return;
        }
        self.kept += 1;
        self.by_child.entry(child.to_owned()).or_default().push(Link {
            parent: parent.to_owned(),
            child: child.to_owned(),
            transforms: 1,
            is_static,
            parent_from_child,
            moved_m: 0.0,
            turned_rad: 0.0,
            swung_rad: 0.0,
            samples: Samples::default(),
        });
    }

    /// Takes what another recording of the same drive says about frames that this one says nothing about.
    pub fn inherit(&mut self, earlier: &Self) {
        for (child, links) in &earlier.by_child {
            let constant = links.iter().filter(|link| link.is_constant());
            if !self.by_child.contains_key(child) {
                let constant: Vec<_> = constant.cloned().collect();
                if !constant.is_empty() {
                    self.kept += constant.len();
                    self.by_child.insert(child.clone(), constant);
                }
            }
        }
    }

    /// The same with one link taken for constant.
    pub(crate) fn fixed(&self, parent: &str, child: &str) -> Self {
        let mut fixed = self.clone();
        let links = fixed.by_child.get_mut(child).into_iter().flatten();
        links.filter(|link| link.parent == parent).for_each(|link| link.is_static = true);
        fixed
    }

    /// Takes in what another tree says.
    pub(crate) fn merge(&mut self, other: Self) {
        self.kept += other.kept;
        self.refused += other.refused;
        for (child, links) in other.by_child {
            self.by_child.entry(child).or_default().extend(links);
        }
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.by_child.is_empty()
    }

    /// All links, by the names of their children.
    pub fn iter(&self) -> impl Iterator<Item = &Link> {
        self.by_child.values().flatten()
    }

    /// Whether anything is said about a frame.
    #[must_use]
    pub fn knows(&self, frame: &str) -> bool {
        let frame = bare(frame);
        self.by_child.contains_key(frame) || self.iter().any(|link| link.parent == frame)
    }

    /// The link of a frame to the one it hangs below. Of several the one that is not a map's, then the one said most often.
    #[must_use]
    pub fn up(&self, frame: &str) -> Option<&Link> {
        let links = self.by_child.get(bare(frame))?;
        links.iter().max_by_key(|link| (!is_map(&link.parent), link.is_static, link.transforms))
    }

    /// The links from a frame up to its root.
    #[must_use]
    pub fn above(&self, frame: &str) -> Vec<&Link> {
        let mut way: Vec<&Link> = Vec::new();
        let mut at = bare(frame);
        while let Some(link) = self.up(at) {
            let is_cycle = way.iter().any(|below| below.child == link.parent) || link.parent == bare(frame);
            if is_cycle || way.len() >= DEPTH_MOST {
                break;
            }
            way.push(link);
            at = &link.parent;
        }
        way
    }

    /// `target_from_source`, where only constant links lie between; else the first that is not, or none where nothing
    /// links the two.
    ///
    /// # Errors
    /// The link that moves, or none.
    pub fn constant(&self, target: &str, source: &str) -> Result<Pose3, Option<&Link>> {
        let (target, source) = (bare(target), bare(source));
        let (up, down) = (self.above(target), self.above(source));
        let reach = |way: &[&Link], start: &str, frame: &str| {
            if start == frame { Some(0) } else { way.iter().position(|link| link.parent == frame).map(|at| at + 1) }
        };
        let frames = std::iter::once(source).chain(down.iter().map(|link| link.parent.as_str()));
        let meeting = frames.enumerate().find_map(|(at, frame)| Some((at, reach(&up, target, frame)?)));
        let Some((down_steps, up_steps)) = meeting else { return Err(None) };
        let ancestor_from_source = along(&down[..down_steps])?;
        let ancestor_from_target = along(&up[..up_steps])?;
        Ok(ancestor_from_target.between(ancestor_from_source))
    }
}

fn along<'a>(way: &[&'a Link]) -> Result<Pose3, Option<&'a Link>> {
    let mut ancestor_from_frame = Pose3::identity();
    for link in way.iter().rev() {
        if !link.is_constant() || is_world(&link.parent) {
            return Err(Some(link));
        }
        ancestor_from_frame = ancestor_from_frame * link.pose();
    }
    Ok(ancestor_from_frame)
}

/// What several trees say.
pub(crate) fn joined(trees: &[(String, Links)]) -> Links {
    let mut all = Links::default();
    trees.iter().for_each(|(_, links)| all.merge(links.clone()));
    all
}

/// The namespace of a topic: all before its last part.
pub(crate) fn namespace(topic: &str) -> &str {
    let topic = topic.trim_start_matches('/');
    topic.rsplit_once('/').map_or("", |(namespace, _)| namespace)
}

/// The name without tf1's slashes.
pub(crate) fn bare(frame: &str) -> &str {
    frame.trim_start_matches('/')
}

/// The last part of a name, as in `robot1/odom`.
fn last_name(frame: &str) -> &str {
    frame.rsplit('/').next().unwrap_or(frame)
}

/// Whether a frame is that of a map, against which only another mapper knows where the robot is.
pub(crate) fn is_map(frame: &str) -> bool {
    matches!(last_name(frame), "map" | "world" | "earth" | "global")
}

/// Whether a frame is one in which robots move, even where this one stood still.
pub(crate) fn is_world(frame: &str) -> bool {
    is_map(frame) || last_name(frame).starts_with("odom")
}

/// How likely a frame is a robot's, by its name.
pub(crate) fn base_rank(frame: &str) -> Option<usize> {
    ["base_footprint", "base_link", "base", "base_frame", "robot", "body", "chassis"]
        .iter()
        .position(|name| *name == last_name(frame))
}

/// A header's stamp, or that of the recording where it has none; whether it had none.
pub(crate) fn stamp_or(header: Stamp, log: Stamp) -> (Stamp, bool) {
    if header.0 == 0 { (log, true) } else { (header, false) }
}
