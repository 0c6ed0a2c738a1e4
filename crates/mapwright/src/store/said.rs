//! What other robots say of their ways counts as much as what they saw there allows.

use super::{FARTHEST_WAY_M, Store};
use mapwright_geom::{Pose, TangentMatrix};
use mapwright_record::{Measurement, NodeId};

/// How far off a robot is in what it says of its way is the same over this much of it, metres.
const ALIKE_M: f64 = 4.0;

/// How far what a robot says of a step is from what it saw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Beside<M> {
    /// Squared, in units of the covariance with which that can be told, by the median of what chance leaves: 1 where it says what it saw.
    pub(crate) variance_factor: f64,
    /// That covariance.
    pub(crate) covariance: M,
}

impl<M: Measurement> Store<M> {
    /// What was seen at a keyframe beside what was said of the way to it.
    pub(crate) fn set_beside(&mut self, node: NodeId, beside: Option<Beside<<M::Pose as Pose>::Matrix>>) {
        if self.beside.len() <= node.index() {
            self.beside.resize(node.index() + 1, None);
        }
        self.beside[node.index()] = beside;
    }

    /// Whether no way leads to a keyframe: the first of all, or one after a break.
    pub(crate) fn is_first(&self, node: NodeId) -> bool {
        let before = self.past().before(node);
        before.is_none_or(|before| self.way_m[node.index()] - self.way_m[before.index()] >= FARTHEST_WAY_M)
    }

    /// What is left of the information of an edge to a keyframe, or of a closure with what was seen about it. Where the steps about it are
    /// farther from what was seen than chance allows, their variance grows by that: a variance factor, as adjustment computation estimates it,
    /// by the median of the steps, so that a single one that fits nowhere says nothing of the others.
    pub(super) fn as_borne_out(&self, to: usize, information: <M::Pose as Pose>::Matrix) -> <M::Pose as Pose>::Matrix {
        let Some(beside) = self.beside_along(to) else { return information };
        let excess = beside.variance_factor - 1.0;
        if excess <= 0.0 {
            return information;
        }
        // (information^-1 + covariance)^-1, where the information may be singular.
        let by = (beside.covariance * excess).inverted().and_then(|of_excess| (information + of_excess).inverted());
        by.map_or(information, |by| information - information * by * information)
    }

    /// The median variance factor of the steps from a keyframe on, with the nearest one's covariance; where the way ends before, of the last ones.
    fn beside_along(&self, to: usize) -> Option<Beside<<M::Pose as Pose>::Matrix>> {
        if self.beside.is_empty() {
            return None;
        }
        let is_near = |a: usize, b: usize| (self.way_m[a] - self.way_m[b]).abs() <= ALIKE_M;
        let ahead = std::iter::successors(Some(to), |&at| self.session.after(at).filter(|&next| is_near(to, next)));
        let mut steps: Vec<usize> = ahead.collect();
        let last = steps[steps.len() - 1];
        if self.session.after(last).is_none() {
            let back = |&at: &usize| self.session.before(at).filter(|&before| is_near(before, last));
            steps.extend(std::iter::successors(back(&to), back));
        }
        let measured = || steps.iter().filter_map(|&at| self.beside.get(at).copied().flatten());
        let nearest = measured().next()?;
        let mut factors: Vec<f64> = measured().map(|of| of.variance_factor).collect();
        factors.sort_unstable_by(f64::total_cmp);
        Some(Beside { variance_factor: factors[factors.len() / 2], ..nearest })
    }
}
