//! A robot that was found: it writes nothing and goes on mapping aside until what it sees has borne that out for metres.

use super::Mapper;
use super::guard::Matched;
use super::relocation::Lost;
use crate::closing::Past;
use mapwright_geom::Pose2;
use mapwright_sensor::LaserScan;

/// What was seen lately speaks against the place where less than this share of what is known fits, or more than this share of
/// all is contradicted: a right place keeps 0.83 and 0.11 (docs/decisions/0012).
const LEAST_SHARE: f64 = 0.78;
const MOST_CONTRADICTION: f64 = 0.15;
/// So many looks in a row are no accident.
const AGAINST: u32 = 2;

/// Where a robot was found, and what it would be otherwise.
#[derive(Debug, Clone)]
pub(super) struct Arrival {
    /// The keyframe of its arrival.
    node: u32,
    /// An old keyframe that it is near.
    near: u32,
    lost: Box<Lost>,
    /// Looks in a row that spoke against the place.
    against: u32,
}

impl Arrival {
    pub(super) fn new(node: u32, near: u32, lost: Box<Lost>) -> Self {
        Self { node, near, lost, against: 0 }
    }

    #[cfg(test)]
    pub(super) fn with_against(self, against: u32) -> Self {
        Self { against, ..self }
    }

    pub(super) fn lost(&mut self) -> &mut Lost {
        &mut self.lost
    }

    /// A scan, matched in the map; whether what was seen lately speaks against the place.
    pub(super) fn is_refuted(&mut self, mapper: &Mapper, scan: &LaserScan, matched: &Matched) -> bool {
        let supplier = matched.agreement.supplier.filter(|&node| node < self.node && mapper.live.is_live(node));
        self.near = supplier.unwrap_or(self.near);
        if self.lost.see(mapper, scan).keyframe.is_some() {
            let is_against = self.is_against(mapper, matched.world_from_robot);
            self.against = if is_against { self.against + 1 } else { 0 };
        }
        self.against >= AGAINST
    }

    fn is_against(&self, mapper: &Mapper, local_from_robot: Pose2) -> bool {
        let past = Past { keyframes: &mapper.keyframes, local_from_keyframe: &mapper.local_from_keyframe };
        let (aside, keyframe_from_robot) = self.lost.aside();
        let near_from_newest =
            mapper.local_from_keyframe[self.near as usize].between(local_from_robot * keyframe_from_robot.inverse());
        let (settings, matcher) = (&mapper.settings, mapper.matcher.settings);
        let finding = mapper.closing.look_around(settings, past, matcher, self.near, aside, near_from_newest);
        finding.is_some_and(|finding| {
            finding.evidence.inlier_share.is_some_and(|share| share < LEAST_SHARE)
                || finding.evidence.contradiction.is_some_and(|share| share > MOST_CONTRADICTION)
        })
    }

    /// Whether the last look spoke against the place.
    pub(super) fn is_doubted(&self) -> bool {
        self.against > 0
    }

    /// The robot was blind: what it has seen says nothing of where it is now.
    pub(super) fn anew(mut self, mapper: &Mapper) -> Self {
        self.lost.begin_again(mapper);
        Self { against: 0, ..self }
    }
}

impl Mapper {
    /// The robot did not arrive where it thought: the keyframe of its arrival is none, and it goes on being lost.
    pub(super) fn leave_again(&mut self, arrival: Arrival) -> Box<Lost> {
        let Arrival { node, mut lost, .. } = arrival;
        let _ = self.drop_keyframe(self.id(node));
        let arrived = self.id(node);
        self.edges.retain(|edge| edge.to != arrived);
        self.closing.disown(node);
        lost.give_up();
        lost
    }
}
