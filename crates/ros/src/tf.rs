//! Which frame is where, and when: a tree of transforms.

use crate::error::RosError;
use crate::messages::TfMessage;
use crate::track::{Found, Track};
use mapwright_geom::{Pose3, Stamp};
use std::collections::BTreeMap;

/// Limits of a [`TransformBuffer`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TransformLimits {
    /// How much of the past is kept for each frame, seconds.
    pub window_s: f64,
    /// How many transforms are kept for each frame.
    pub per_frame: usize,
    /// How many frames there may be.
    pub frames: usize,
}

impl Default for TransformLimits {
    fn default() -> Self {
        Self { window_s: 10.0, per_frame: 20_000, frames: 10_000 }
    }
}

/// What a buffer did with the transforms it was given.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TransformCounts {
    /// Taken in.
    pub taken: u64,
    /// Older than the window.
    pub too_old: u64,
    /// Refused: no rotation, numbers that are not, a cycle, too many frames.
    pub refused: u64,
    /// Frames that came to hang below another parent; what was known of them before is forgotten.
    pub moved: u64,
}

#[derive(Debug, Clone)]
struct Link {
    parent: String,
    track: Track,
}

/// Transforms of the recent past, by child frame. Memory is bounded by [`TransformLimits`].
///
/// A frame's name loses the slashes that tf1 put in front.
#[derive(Debug, Clone, Default)]
pub struct TransformBuffer {
    limits: TransformLimits,
    links: BTreeMap<String, Link>,
    counts: TransformCounts,
}

impl TransformBuffer {
    /// An empty buffer.
    #[must_use]
    pub fn new(limits: TransformLimits) -> Self {
        Self { limits, ..Self::default() }
    }

    /// What became of the transforms so far.
    #[must_use]
    pub fn counts(&self) -> TransformCounts {
        self.counts
    }

    /// Takes in a message's transforms and gives the first refusal, if any; the others are taken in all the same.
    ///
    /// # Errors
    /// [`RosError::Transform`].
    pub fn insert_message(&mut self, message: &TfMessage<'_>, is_static: bool) -> Result<(), RosError> {
        let mut first = Ok(());
        for transform in &message.transforms {
            let (parent, child) = (transform.header.frame(), &transform.child_frame_id);
            let result = match transform.transform.to_pose3() {
                Some(pose) => self.insert(transform.header.stamp, parent, child, pose, is_static),
                None => Err(self.refuse(parent, child, "its quaternion is zero or not finite".to_owned())),
            };
            first = first.and(result);
        }
        first
    }

    /// Takes in `parent_from_child`; where `is_static`, for all times.
    ///
    /// # Errors
    /// [`RosError::Transform`] for numbers that are not finite, frames without a name, frames in themselves, cycles, and
    /// more frames than the limit.
    pub fn insert(
        &mut self,
        stamp: Stamp,
        parent: &str,
        child: &str,
        parent_from_child: Pose3,
        is_static: bool,
    ) -> Result<(), RosError> {
        let (parent, child) = (bare(parent), bare(child));
        if let Some(reason) = self.why_not(parent, child, parent_from_child) {
            return Err(self.refuse(parent, child, reason));
        }
        let limits = self.limits;
        let link = self.links.entry(child.to_owned()).or_insert_with(|| Link::new(parent));
        if link.parent != parent {
            *link = Link::new(parent);
            self.counts.moved += 1;
        }
        let taken = match is_static {
            true => link.track.hold(parent_from_child),
            false => link.track.insert(stamp, parent_from_child, limits.window_s, limits.per_frame),
        };
        self.counts.taken += u64::from(taken);
        self.counts.too_old += u64::from(!taken);
        Ok(())
    }

    /// `target_from_source` at a time, over their common ancestor; dynamic links are interpolated.
    ///
    /// # Errors
    /// [`RosError::UnknownFrame`], [`RosError::Unconnected`], [`RosError::OutOfTime`]: which link is missing.
    pub fn lookup(&self, target: &str, source: &str, stamp: Stamp) -> Result<Pose3, RosError> {
        let (up, down) = self.ways(bare(target), bare(source))?;
        let ancestor_from_target = self.along(&up, stamp)?;
        let ancestor_from_source = self.along(&down, stamp)?;
        Ok(ancestor_from_target.between(ancestor_from_source))
    }

    /// The times at which [`TransformBuffer::lookup`] answers; all of them (the ends of the range) where every link is
    /// static.
    ///
    /// # Errors
    /// [`RosError::UnknownFrame`] and [`RosError::Unconnected`]; none where the links have no time in common.
    pub fn known_times(&self, target: &str, source: &str) -> Result<Option<(Stamp, Stamp)>, RosError> {
        let (up, down) = self.ways(bare(target), bare(source))?;
        let spans = up.iter().chain(&down).filter_map(|(_, link)| link.track.span());
        let all = (Stamp(i64::MIN), Stamp(i64::MAX));
        let (first, last) = spans.fold(all, |all, span| (all.0.max(span.0), all.1.min(span.1)));
        Ok((first <= last).then_some((first, last)))
    }

    /// Frames that are known, in alphabetical order.
    #[must_use]
    pub fn frames(&self) -> Vec<&str> {
        let mut frames: Vec<_> =
            self.links.iter().flat_map(|(child, link)| [child.as_str(), link.parent.as_str()]).collect();
        frames.sort_unstable();
        frames.dedup();
        frames
    }

    /// The frame that another hangs below; none for roots and unknown frames.
    #[must_use]
    pub fn parent(&self, frame: &str) -> Option<&str> {
        self.links.get(bare(frame)).map(|link| link.parent.as_str())
    }

    /// Whether a frame's place in its parent never changes.
    #[must_use]
    pub fn is_static(&self, frame: &str) -> bool {
        self.links.get(bare(frame)).is_some_and(|link| link.track.span().is_none())
    }

    /// Forgets what moves, as after a clock that was set back; what holds for all times stays.
    pub fn forget_moving(&mut self) {
        self.links.retain(|_, link| link.track.span().is_none());
    }

    fn why_not(&self, parent: &str, child: &str, pose: Pose3) -> Option<String> {
        if parent.is_empty() || child.is_empty() {
            return Some("a frame has no name".to_owned());
        }
        if parent == child {
            return Some("a frame cannot hang below itself".to_owned());
        }
        if !pose.is_finite() {
            return Some("its numbers are not finite".to_owned());
        }
        if !self.links.contains_key(child) && self.links.len() >= self.limits.frames {
            return Some(format!("there are {} frames already", self.limits.frames));
        }
        let above: Vec<_> = self.ancestors(parent).map(|(frame, _)| frame).collect();
        above.contains(&child).then(|| format!("a cycle: '{child}' is above already: {}", above.join(" < ")))
    }

    fn refuse(&mut self, parent: &str, child: &str, reason: String) -> RosError {
        self.counts.refused += 1;
        RosError::Transform { parent: parent.to_owned(), child: bare(child).to_owned(), reason }
    }

    /// A frame and those above it, each with its link upwards.
    fn ancestors<'b>(&'b self, frame: &'b str) -> impl Iterator<Item = (&'b str, Option<&'b Link>)> {
        let link = |frame: &str| self.links.get(frame);
        std::iter::successors(Some((frame, link(frame))), move |(_, above)| {
            above.map(|above| (above.parent.as_str(), link(&above.parent)))
        })
    }

    /// The links from the target and from the source up to their common ancestor.
    fn ways<'b>(&'b self, target: &'b str, source: &'b str) -> Result<(Way<'b>, Way<'b>), RosError> {
        if target == source {
            return Ok((Vec::new(), Vec::new()));
        }
        self.check_known(target, source)?;
        let (up, down): (Vec<_>, Vec<_>) = (self.ancestors(target).collect(), self.ancestors(source).collect());
        let place_in_up: BTreeMap<_, _> = up.iter().enumerate().map(|(index, (frame, _))| (*frame, index)).collect();
        let meeting = down.iter().enumerate().find_map(|(at, (frame, _))| Some((*place_in_up.get(frame)?, at)));
        let Some((up_steps, down_steps)) = meeting else {
            let root = |way: &[(&str, Option<&Link>)]| way.last().map_or("", |(frame, _)| *frame).to_owned();
            return Err(RosError::Unconnected {
                target: target.to_owned(),
                source_frame: source.to_owned(),
                target_root: root(&up),
                source_root: root(&down),
            });
        };
        let links = |way: Vec<(&'b str, Option<&'b Link>)>, steps| {
            way.into_iter().take(steps).filter_map(|(frame, link)| Some((frame, link?))).collect()
        };
        Ok((links(up, up_steps), links(down, down_steps)))
    }

    fn check_known(&self, target: &str, source: &str) -> Result<(), RosError> {
        let frames = self.frames();
        let Some(missing) = [source, target].into_iter().find(|frame| frames.binary_search(frame).is_err()) else {
            return Ok(());
        };
        let known = if frames.is_empty() { "none".to_owned() } else { frames.join(", ") };
        let (target, source_frame, missing) = (target.to_owned(), source.to_owned(), missing.to_owned());
        Err(RosError::UnknownFrame { target, source_frame, missing, known })
    }

    /// `ancestor_from_frame` along a way.
    fn along(&self, way: &[(&str, &Link)], stamp: Stamp) -> Result<Pose3, RosError> {
        let mut ancestor_from_frame = Pose3::identity();
        for (child, link) in way.iter().rev() {
            let parent_from_child = match link.track.at(stamp) {
                Found::At(pose) => pose,
                Found::Outside { first, last } => {
                    let (parent, child) = (link.parent.clone(), (*child).to_owned());
                    return Err(RosError::OutOfTime { parent, child, first, last, asked: stamp });
                }
            };
            ancestor_from_frame = ancestor_from_frame * parent_from_child;
        }
        Ok(ancestor_from_frame)
    }
}

/// Frames from the innermost up, each with its link to the next.
type Way<'b> = Vec<(&'b str, &'b Link)>;

impl Link {
    fn new(parent: &str) -> Self {
        Self { parent: parent.to_owned(), track: Track::default() }
    }
}

/// The name without tf1's slashes.
fn bare(frame: &str) -> &str {
    frame.trim_start_matches('/')
}

#[cfg(test)]
mod tests;
