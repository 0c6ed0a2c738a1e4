//! One weighted least-squares problem of a graph, brought down to its optimum.

use crate::group::PoseGroup;
use crate::problem::{Normal, Problem};
use nalgebra::SVector;

/// Damping that a rejected Gauss-Newton step brings, relative to the diagonal.
const FIRST_DAMPING: f64 = 1e-7;
/// Damping above which nothing moves any more.
const LAST_DAMPING: f64 = 1e15;
/// Turns of errors from which on the quadratic model is not even tried, radians.
const FAR_OFF: f64 = 0.5;
/// Share of its promise that a step keeps where the quadratic model holds all the way.
const KEPT_PROMISE: f64 = 0.9;
/// Difference of a step's gain from one up to which the last factor serves for the next step as well.
const EXACT: f64 = 0.01;
/// What a step from the last factor may leave, in shares of what ends the search.
const LEFT: f64 = 0.1;
/// A promised decrease below this share of chi-square is rounding.
const ROUNDING: f64 = 1e-12;
/// Smallest entry of the damping's diagonal, relative to the largest: directions without information stay put.
const DIAGONAL_FLOOR: f64 = 1e-12;

/// Gauss-Newton that turns into Levenberg-Marquardt where a step fails, damped by Nielsen's rule (1999, "Damping parameter
/// in Marquardt's method", eq. 2.4) in proportion to the diagonal.
pub(crate) struct Descent {
    relative_decrease: f64,
    damping: f64,
    growth: f64,
    /// Chi-square at the poses.
    pub(crate) chi2: f64,
    /// What the last step promised, where it kept its promise.
    last_promise: Option<f64>,
    /// Whether the last step found the quadratic model exact, so that its factor serves once more.
    exact: bool,
    pub(crate) iterations: usize,
}

impl Descent {
    pub(crate) fn new(relative_decrease: f64, chi2: f64) -> Self {
        Self { relative_decrease, damping: 0.0, growth: 2.0, chi2, last_promise: None, exact: false, iterations: 0 }
    }

    /// Takes a first undamped step where chi-square falls nearly as much as that promises: then the start is so good that
    /// no relaxation is needed. Where rotations are far off, that is not tried.
    pub(crate) fn begins_well<P: PoseGroup<D>, const D: usize>(
        &mut self,
        problem: &Problem<P, D>,
        normal: &mut Normal<'_, D>,
        poses: &mut Vec<P>,
    ) -> bool {
        if problem.largest_turn(poses) > FAR_OFF {
            return false;
        }
        let weights = vec![1.0; problem.terms.len()];
        normal.linearise(problem, poses, &weights);
        self.iterations += 1;
        let diagonal = vec![0.0; problem.variables * D];
        let Some(tried) = attempt(problem, normal, poses, &diagonal, 0.0, None) else { return false };
        let tried_chi2 = problem.chi2(&tried.poses, &weights);
        let fallen = self.chi2 - tried_chi2;
        let holds = fallen > 0.0 && fallen >= KEPT_PROMISE * tried.promised;
        if holds {
            self.last_promise = Some(tried.promised);
            (*poses, self.chi2) = (tried.poses, tried_chi2);
        }
        holds
    }

    /// Descends until the stop rule is met, which it says, or the iterations are used up.
    ///
    /// An undamped step that makes things worse gets a second one to make up for it before damping begins: far from the
    /// optimum, rotations and translations take turns.
    pub(crate) fn run<P: PoseGroup<D>, const D: usize>(
        &mut self,
        problem: &Problem<P, D>,
        normal: &mut Normal<'_, D>,
        poses: &mut Vec<P>,
        weights: &[f64],
        max_iterations: usize,
    ) -> bool {
        let mut diagonal = Vec::new();
        let mut before_detour: Option<(Vec<P>, f64)> = None;
        let (mut moved, mut converged) = (true, false);
        (self.damping, self.growth, self.exact) = (0.0, 2.0, false);
        for _ in 0..max_iterations {
            if problem.variables == 0 || self.chi2 == 0.0 {
                return true;
            }
            if moved {
                normal.linearise(problem, poses, weights);
                diagonal = floored(normal.system.diagonal());
            }
            self.iterations += 1;
            let (best_chi2, detour) =
                (before_detour.as_ref().map_or(self.chi2, |(_, best)| *best), before_detour.is_some());
            let damping = self.damping;
            let nearby = std::mem::take(&mut self.exact).then_some(LEFT * self.relative_decrease * self.chi2);
            let tried = attempt(problem, normal, poses, &diagonal, damping, nearby);
            let candidate_chi2 = tried.as_ref().map_or(f64::INFINITY, |tried| problem.chi2(&tried.poses, weights));
            match tried {
                Some(tried) if candidate_chi2 < best_chi2 => {
                    let gain = (self.chi2 - candidate_chi2) / tried.promised;
                    let small =
                        self.promise(tried.promised, gain) <= self.relative_decrease * self.chi2 && damping == 0.0;
                    converged = small || tried.promised <= ROUNDING * self.chi2;
                    self.exact = damping == 0.0 && nearby.is_none() && (gain - 1.0).abs() <= EXACT;
                    self.accept(gain);
                    (*poses, self.chi2, moved) = (tried.poses, candidate_chi2, true);
                    before_detour = None;
                }
                Some(tried) if !detour && tried.promised <= ROUNDING * self.chi2 => converged = true,
                Some(tried) if !detour && damping == 0.0 && candidate_chi2.is_finite() => {
                    before_detour = Some((std::mem::replace(poses, tried.poses), self.chi2));
                    (self.chi2, moved) = (candidate_chi2, true);
                }
                _ => {
                    moved = detour;
                    if let Some((best, best_chi2)) = before_detour.take() {
                        (*poses, self.chi2) = (best, best_chi2);
                    }
                    if !self.reject() {
                        return false;
                    }
                }
            }
            if converged {
                return true;
            }
        }
        if let Some((best, best_chi2)) = before_detour {
            (*poses, self.chi2) = (best, best_chi2);
        }
        false
    }

    /// What all further steps will bring, no more than this one: where steps keep their promises and these fall by a
    /// factor of ten and more, they go on to fall at least as a geometric series.
    fn promise(&mut self, promised: f64, gain: f64) -> f64 {
        let kept = (gain - 1.0).abs() <= 0.25;
        let last = std::mem::replace(&mut self.last_promise, kept.then_some(promised));
        let ratio = last.filter(|_| kept).map_or(1.0, |last| promised / last);
        if ratio <= 0.1 { promised * ratio / (1.0 - ratio) } else { promised }
    }

    fn accept(&mut self, gain: f64) {
        self.damping *= (1.0 - (2.0 * gain - 1.0).powi(3)).clamp(1.0 / 3.0, 2.0);
        self.growth = 2.0;
        if self.damping < 0.1 * FIRST_DAMPING {
            self.damping = 0.0;
        }
        if gain < 0.1 && self.damping == 0.0 {
            self.damping = FIRST_DAMPING;
        }
    }

    /// Whether more damping can help.
    fn reject(&mut self) -> bool {
        self.damping = (self.damping * self.growth).max(FIRST_DAMPING);
        self.growth *= 2.0;
        self.damping < LAST_DAMPING
    }
}

/// A step that could be taken.
struct Tried<P> {
    poses: Vec<P>,
    /// By how much the quadratic model says that chi-square falls.
    promised: f64,
}

/// Solves for a step, with the last factor if all but `nearby` of chi-square can be had from that; none where that fails.
fn attempt<P: PoseGroup<D>, const D: usize>(
    problem: &Problem<P, D>,
    normal: &mut Normal<'_, D>,
    poses: &[P],
    diagonal: &[f64],
    damping: f64,
    nearby: Option<f64>,
) -> Option<Tried<P>> {
    let undamped = normal.system.diagonal();
    normal.system.set_diagonal(undamped.iter().zip(diagonal).map(|(d, floored)| d + damping * floored));
    let descent: Vec<f64> = normal.gradient.iter().map(|g| -g).collect();
    let step = nearby.and_then(|left| normal.system.solve_nearby(&descent, left));
    let step = step.or_else(|| normal.system.solve(&descent));
    normal.system.set_diagonal(undamped.into_iter());
    let step = step?;
    let promised = promised_decrease(&step, &descent, diagonal, damping);
    Some(Tried { poses: moved_by(problem, poses, &step), promised })
}

/// What the quadratic model promises: `-g^T x + lambda x^T D x`.
fn promised_decrease(step: &[f64], descent: &[f64], diagonal: &[f64], damping: f64) -> f64 {
    let terms = step.iter().zip(descent).zip(diagonal);
    terms.map(|((x, b), d)| x * b + damping * d * x * x).sum()
}

fn floored(mut diagonal: Vec<f64>) -> Vec<f64> {
    let least = DIAGONAL_FLOOR * diagonal.iter().fold(0.0_f64, |most, d| most.max(*d));
    diagonal.iter_mut().for_each(|d| *d = d.max(least));
    diagonal
}

fn moved_by<P: PoseGroup<D>, const D: usize>(problem: &Problem<P, D>, poses: &[P], step: &[f64]) -> Vec<P> {
    let moved = |(pose, place): (&P, &Option<usize>)| match place {
        Some(place) => pose.retract(&SVector::from_column_slice(&step[place * D..(place + 1) * D])),
        None => *pose,
    };
    poses.iter().zip(&problem.places).map(moved).collect()
}
