//! From odometry alone to the hypotheses that the graph bears out, the sharpest first.

use super::{Hypothesis, Search, State, Test, VAGUE_ALONE};
use crate::consistency::{cycle_of, quantile_99};
use crate::error::GraphError;
use crate::group::PoseGroup;

/// Share of the volume of all closures in which an accident is no longer excluded.
const VAGUE: f64 = 0.02;
/// Hypotheses up to which those without support take part from the beginning.
const ALONE: usize = 400;

/// A hypothesis that passes the test of what is believed so far.
struct Candidate {
    hypothesis: usize,
    /// Share of random closures that would pass.
    vagueness: f64,
}

impl<P: PoseGroup<D>, const D: usize> Search<'_, P, D> {
    /// Believes the sharpest of what passes, solves, and looks again.
    pub(super) fn grow(&mut self) -> Result<(), GraphError> {
        for _ in 0..self.settings.max_rounds {
            let candidates = self.candidates()?;
            let chosen = self.chosen(candidates);
            if chosen.is_empty() {
                break;
            }
            for hypothesis in chosen {
                self.set_state(hypothesis, State::Believed);
            }
            self.solve()?;
            self.drop_what_does_not_fit()?;
        }
        Ok(())
    }

    /// Open hypotheses that the graph so far allows, the sharpest first; others are refuted.
    fn candidates(&mut self) -> Result<Vec<Candidate>, GraphError> {
        let alone_allowed = self.hypotheses.len() <= ALONE;
        let open = |hypothesis: &Hypothesis| {
            hypothesis.state == State::Open && (hypothesis.members.len() > 1 || alone_allowed)
        };
        let open: Vec<usize> = (0..self.hypotheses.len()).filter(|&at| open(&self.hypotheses[at])).collect();
        let tested: Vec<(usize, Test)> = self.with_factor(|search, problem, normal| {
            let test = |&at: &usize| Some((at, search.tested(search.hypotheses[at].middle(), problem, normal)?));
            open.iter().filter_map(test).collect()
        })?;
        let mut candidates = Vec::new();
        for (hypothesis, Test { chi2, vagueness }) in tested {
            self.hypotheses[hypothesis].vagueness = vagueness;
            if chi2 <= quantile_99(D) {
                candidates.push(Candidate { hypothesis, vagueness });
            } else if vagueness < VAGUE {
                self.hypotheses[hypothesis].state = State::Refuted;
            }
        }
        candidates.sort_by(|a, b| a.vagueness.total_cmp(&b.vagueness));
        Ok(candidates)
    }

    /// What is to be believed next.
    fn chosen(&self, candidates: Vec<Candidate>) -> Vec<usize> {
        let allowed = |candidate: &Candidate| match self.hypotheses[candidate.hypothesis].members.len() {
            1 => candidate.vagueness <= VAGUE_ALONE,
            2 => candidate.vagueness <= VAGUE,
            _ => true,
        };
        let mut candidates: Vec<Candidate> = candidates.into_iter().filter(allowed).collect();
        let Some(sharpest) = candidates.first().map(|candidate| candidate.vagueness) else { return Vec::new() };
        if sharpest > VAGUE {
            return self.best_supported(&candidates);
        }
        candidates.retain(|candidate| candidate.vagueness <= (2.0 * sharpest).max(0.25 * VAGUE));
        candidates.into_iter().map(|candidate| candidate.hypothesis).collect()
    }

    /// Where no test is sharp: the hypothesis with which most closures agree.
    fn best_supported(&self, candidates: &[Candidate]) -> Vec<usize> {
        let members = |at: usize| &self.hypotheses[at].members;
        let middle = |at: usize| &self.closures[self.hypotheses[at].middle()];
        let support = |a: &Candidate| -> usize {
            let agreeing = candidates.iter().filter(|b| {
                let cycle = cycle_of(middle(a.hypothesis), middle(b.hypothesis), |a, b| self.chain.leg(a, b));
                cycle.is_some_and(|cycle| cycle.chi2_of_cycle() <= self.threshold())
            });
            agreeing.map(|b| members(b.hypothesis).len()).sum()
        };
        let best = candidates.iter().max_by_key(|&c| (support(c), std::cmp::Reverse(c.hypothesis)));
        best.map(|candidate| candidate.hypothesis).into_iter().collect()
    }

    /// Doubts hypotheses again most of whose members were not met.
    fn drop_what_does_not_fit(&mut self) -> Result<(), GraphError> {
        let mut dropped = false;
        for at in 0..self.hypotheses.len() {
            if self.hypotheses[at].state != State::Believed {
                continue;
            }
            let members = &self.hypotheses[at].members;
            let missed = members.iter().filter(|&&m| self.closure_chi2(m) > self.threshold()).count();
            if 2 * missed > members.len() {
                self.set_state(at, State::Refuted);
                dropped = true;
            }
        }
        if dropped { self.solve() } else { Ok(()) }
    }
}
