//! Cycles: where the robot may have come back to, what speaks for it, and what was decided.

use crate::id::KeyframeId;
use mapwright_geom::{Pose, Pose2};

/// How a candidate was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Detection {
    /// By the uncertainty of the present pose: the place lies within it.
    Pose,
    /// By what the place looks like, wherever it lies.
    Place,
    /// By the match of a scan: the place is in the local map, and it supplied most of what the scan was matched against.
    Match,
    /// Two robots saw each other: where one was in the frame of the other, whatever both places look like.
    Sighting,
}

impl Detection {
    /// Lower-case name for reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Pose => "pose",
            Self::Place => "place",
            Self::Match => "match",
            Self::Sighting => "sighting",
        }
    }
}

/// The numbers of a candidate, each as far as the cascade came; shares are 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Evidence {
    /// Points of the present submap that were looked for in the old one.
    pub points: u32,
    /// Score of the best pose, share of the full one.
    pub score: Option<f64>,
    /// Score of the best pose elsewhere relative to that of the best one; 0.75 stands for that or less. None where
    /// the fit was refused for what was seen there, whatever else might fit.
    pub ambiguity: Option<f64>,
    /// Share of the points that end in territory of the other submap, the better of both directions.
    pub overlap: Option<f64>,
    /// Share of those that fit, the worse of both directions.
    pub inlier_share: Option<f64>,
    /// Share that ends in free space of the other submap, the worse of both directions.
    pub contradiction: Option<f64>,
    /// Disagreement of the cycle with the graph: chi-square with three degrees of freedom.
    pub cycle_chi2: Option<f64>,
    /// Other candidates that agree with this one.
    pub agreeing: u32,
}

/// Why a candidate is not, or no longer, a closure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Objection {
    /// Nothing in the window fits well enough.
    NoMatch,
    /// Too little is seen from both places.
    LittleOverlap,
    /// Another pose fits nearly as well.
    Ambiguous,
    /// The fit leaves a direction open, as along a corridor.
    Unconstrained,
    /// Beams end where the other place is free.
    Contradiction,
    /// What fits differs from what the graph says by more than its uncertainty allows.
    Improbable,
    /// No other candidate agrees with it yet.
    Alone,
    /// Other closures contradict it.
    Outvoted,
}

impl Objection {
    /// The reason in words.
    #[must_use]
    pub fn in_words(self) -> &'static str {
        match self {
            Self::NoMatch => "nothing in the window fits well enough",
            Self::LittleOverlap => "too little is seen from both places",
            Self::Ambiguous => "another pose fits nearly as well",
            Self::Unconstrained => "the fit leaves a direction open",
            Self::Contradiction => "beams end where the other place is free",
            Self::Improbable => "the graph says otherwise by more than its uncertainty",
            Self::Alone => "no other candidate agrees with it yet",
            Self::Outvoted => "other closures contradict it",
        }
    }
}

/// What was decided of a candidate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Verdict {
    /// It is a closure, and an edge of the graph.
    Accepted,
    /// More evidence may still make it one.
    Waiting(Objection),
    /// It is none.
    Refused(Objection),
    /// It was one, until later evidence spoke against it.
    Withdrawn(Objection),
}

impl Verdict {
    /// Lower-case name for reports.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Accepted => "accepted",
            Self::Waiting(_) => "waiting",
            Self::Refused(_) => "refused",
            Self::Withdrawn(_) => "withdrawn",
        }
    }

    /// What speaks against it, if anything does.
    #[must_use]
    pub fn objection(self) -> Option<Objection> {
        match self {
            Self::Accepted => None,
            Self::Waiting(why) | Self::Refused(why) | Self::Withdrawn(why) => Some(why),
        }
    }
}

/// A place the robot may have come back to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Candidate<P: Pose = Pose2> {
    /// The old keyframe.
    pub from: KeyframeId,
    /// The present one.
    pub to: KeyframeId,
    /// How it was found.
    pub detection: Detection,
    /// What was measured.
    pub evidence: Evidence,
    /// What was decided.
    pub verdict: Verdict,
    /// The best pose of `to` in the frame of `from`, if one was found.
    pub from_from_to: Option<P>,
    /// Covariance of its right perturbation.
    pub covariance: P::Matrix,
}
