//! Graduated non-convexity with truncated least squares (Yang, Antonante, Tzoumas, Carlone 2020, "Graduated
//! non-convexity for robust spatial perception", section IV): closures that contradict the others lose their say.

use crate::consensus::Consensus;
use crate::consistency::quantile_99;
use crate::descent::Descent;
use crate::group::PoseGroup;
use crate::problem::{Normal, Problem};

/// How false closures are outvoted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gnc {
    /// Chi-square up to which a closure is believed; none for the 99 % quantile of as many degrees of freedom.
    pub threshold_chi2: Option<f64>,
    /// By how much the surrogate approaches the truncated cost in each stage.
    pub step: f64,
    /// Stages at most.
    pub max_stages: usize,
    /// Steps in each stage.
    pub iterations_per_stage: usize,
    /// The search for closures that agree, which comes instead of the stages; none for the stages from the start given.
    pub consensus: Option<Consensus>,
}

impl Default for Gnc {
    fn default() -> Self {
        Self {
            threshold_chi2: None,
            step: 1.4,
            max_stages: 100,
            iterations_per_stage: 2,
            consensus: Some(Consensus::default()),
        }
    }
}

/// Finds the weights, and moves the poses on the way.
pub(crate) fn graduate<P: PoseGroup<D>, const D: usize>(
    gnc: &Gnc,
    trusted: &[bool],
    problem: &Problem<P, D>,
    normal: &mut Normal<'_, D>,
    poses: &mut Vec<P>,
    weights: &mut [f64],
    descent: &mut Descent,
) {
    let threshold = gnc.threshold_chi2.unwrap_or_else(|| quantile_99(D));
    let closures: Vec<usize> = (0..trusted.len()).filter(|&at| !trusted[at]).collect();
    let worst = closures.iter().map(|&at| problem.term_chi2(at, poses)).fold(0.0, f64::max);
    if worst <= threshold {
        return;
    }
    // eq. after (14): the surrogate is convex at first
    let mut control = threshold / (2.0 * worst - threshold);
    for _ in 0..gnc.max_stages {
        let mut undecided = 0;
        for &at in &closures {
            weights[at] = weight(problem.term_chi2(at, poses), threshold, control);
            undecided += usize::from(weights[at] > 0.0 && weights[at] < 1.0);
        }
        descent.chi2 = problem.chi2(poses, weights);
        descent.run(problem, normal, poses, weights, gnc.iterations_per_stage);
        if undecided == 0 && control > 1.0 {
            break;
        }
        control *= gnc.step;
    }
    // the truncated cost itself
    for &at in &closures {
        weights[at] = f64::from(u8::from(problem.term_chi2(at, poses) <= threshold));
    }
}

/// Weight of an edge (eq. 14).
fn weight(chi2: f64, threshold: f64, control: f64) -> f64 {
    if chi2 >= (control + 1.0) / control * threshold {
        0.0
    } else if chi2 <= control / (control + 1.0) * threshold {
        1.0
    } else {
        ((threshold / chi2).sqrt() * (control * (control + 1.0)).sqrt() - control).clamp(0.0, 1.0)
    }
}
