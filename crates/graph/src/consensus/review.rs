//! Closure by closure: what fits is taken in, what is likely an accident is dropped.

use super::neighbours::covariance;
use super::{Search, TAILS, Test, VAGUE_ALONE, deviation, relative_covariance};
use crate::consistency::{Relative, quantile_99};
use crate::error::GraphError;
use crate::group::PoseGroup;

/// How many random closures may be expected to fit as well as one that is believed without support.
const LIKELY: f64 = 0.1;
/// The same, by the volume that they fill, where nothing else is believed.
const LIKELY_ALONE: f64 = 0.05;
/// By how much the ellipsoid is larger in which random closures are counted.
const WIDER: f64 = 64.0;
/// How many random closures may be expected to lie as near as a believed one does to the graph without it, where that is
/// farther off than its covariance says.
const LIKELY_OUTLIER: f64 = 0.05;
/// Rounds of dropping what is an accident after all, at most.
const MAX_REVIEWS: usize = 20;
/// Share of the believed closures that may be false by accident.
const ACCIDENTS: f64 = 0.001;

impl<P: PoseGroup<D>, const D: usize> Search<'_, P, D> {
    /// Closure by closure: what the poses meet is believed, what they do not is not.
    pub(super) fn take_in_what_fits(&mut self) -> Result<(), GraphError> {
        for _ in 0..8 {
            let believed = self.believed_closures();
            if believed == 0 {
                break;
            }
            let chi2: Vec<f64> = (0..self.closures.len()).map(|at| self.closure_chi2(at)).collect();
            let threshold = self.generous_threshold(&chi2, believed);
            let before = self.believed.clone();
            for (at, chi2) in chi2.into_iter().enumerate() {
                self.believed[self.edges[at]] = chi2 <= threshold && !self.accident[at];
            }
            if self.believed == before {
                break;
            }
            self.solve()?;
        }
        Ok(())
    }

    /// Single closures far from where the poses are, but as near as the poses are certain, where random closures would
    /// not have come so near.
    pub(super) fn take_in_what_is_no_accident(&mut self) -> Result<(), GraphError> {
        // those that came and went do not come again
        let mut tried = self.accident.clone();
        for _ in 0..self.settings.max_rounds {
            let doubted: Vec<usize> = (0..self.closures.len()).filter(|&at| !self.believed[self.edges[at]]).collect();
            if doubted.is_empty() {
                break;
            }
            let alone = doubted.len() == self.closures.len();
            let tests: Vec<(usize, Test)> = self.with_factor(|search, problem, normal| {
                let tests = doubted.iter().filter_map(|&at| Some((at, search.tested(at, problem, normal)?)));
                // where nothing is believed yet no test is sharp: what fits exactly is enough
                tests.filter(|(_, test)| alone || test.vagueness <= VAGUE_ALONE).collect()
            })?;
            let chance = Chance::counted(tests.iter().map(|(_, test)| test.chi2), D);
            let fits = |&&(at, test): &&(usize, Test)| {
                !tried[at]
                    && test.chi2 <= quantile_99(D) / TAILS
                    && chance.expected(test.chi2) <= LIKELY
                    && (!alone || doubted.len() as f64 * test.share(D) <= LIKELY_ALONE)
            };
            let found: Vec<usize> = tests.iter().filter(fits).map(|(at, _)| *at).collect();
            if found.is_empty() {
                break;
            }
            for at in found {
                self.believed[self.edges[at]] = true;
                tried[at] = true;
            }
            self.solve()?;
            self.take_in_what_fits()?;
        }
        Ok(())
    }

    /// The largest chi-square up to which hardly any false closure is met by accident, as those just beyond the quantile
    /// let expect.
    fn generous_threshold(&self, chi2: &[f64], believed: usize) -> f64 {
        let (quantile, half) = (quantile_99(D), D as f64 / 2.0);
        let beyond = chi2.iter().filter(|&&chi2| chi2 > quantile && chi2 <= 9.0 * quantile).count();
        let expected = beyond as f64 / (9.0_f64.powf(half) - 1.0);
        let allowed = (ACCIDENTS * believed as f64).max(0.5);
        let shrunk = if expected > allowed { (allowed / expected).powf(1.0 / half) } else { 1.0 };
        quantile * shrunk.max(self.scale)
    }

    /// Drops believed closures that lie as far from where the graph without them puts them as random ones can be expected
    /// to, the likeliest accidents first: what is wrong makes others look wrong.
    pub(super) fn review(&mut self) -> Result<(), GraphError> {
        for _ in 0..MAX_REVIEWS {
            let doubted = (self.closures.len() - self.believed_closures()) as f64;
            let mut outliers = self.left_out()?;
            outliers.retain(|(_, test)| test.chi2 > quantile_99(D) && doubted * test.share(D) > LIKELY_OUTLIER);
            let likeliest = outliers.iter().map(|(_, test)| test.share(D)).fold(0.0, f64::max);
            outliers.retain(|(_, test)| test.share(D) >= 0.5 * likeliest);
            if outliers.is_empty() {
                break;
            }
            for (at, _) in outliers {
                self.believed[self.edges[at]] = false;
                self.accident[at] = true;
            }
            self.solve()?;
        }
        Ok(())
    }

    /// The test of each believed closure against the graph without it.
    ///
    /// With its covariance `C`, `P` of what the whole graph says of it, and its error `e` there, the graph without it says
    /// `C (C - P)^-1 e` with covariance `C (C - P)^-1 P`, the sum of that and `C` being `C (C - P)^-1 C`.
    pub(super) fn left_out(&self) -> Result<Vec<(usize, Test)>, GraphError> {
        let believed: Vec<usize> = (0..self.closures.len()).filter(|&at| self.believed[self.edges[at]]).collect();
        self.with_factor(|search, problem, normal| {
            let test = |&at: &usize| {
                let edge = &search.graph.edges[search.edges[at]];
                let [from, to] = [edge.from, edge.to].map(|v| search.poses[v]);
                let own = covariance(&edge.information);
                let rest = own - relative_covariance(problem, normal, &search.poses, edge.from, edge.to);
                let error = Relative {
                    pose: edge.from_from_to.inverse() * (from.inverse() * to),
                    covariance: rest * search.scale,
                };
                let chi2 = error.chi2_of_cycle();
                let deviation = deviation(&(own * search.scale)).powi(2) / deviation(&error.covariance);
                // not where nothing but the closure says where the two are
                chi2.is_finite().then(|| (at, search.test(chi2, deviation)))
            };
            believed.iter().filter_map(test).collect()
        })
    }
}

/// How many random closures come as near as one, counted where they are not yet near: they fill space evenly.
struct Chance {
    /// Those within the wider ellipsoid.
    counted: usize,
    /// Its chi-square.
    wider: f64,
    freedom: usize,
}

impl Chance {
    fn counted(chi2: impl Iterator<Item = f64>, freedom: usize) -> Self {
        let wider = quantile_99(freedom) * WIDER.powf(2.0 / freedom as f64);
        Self { counted: chi2.filter(|chi2| *chi2 <= wider).count(), wider, freedom }
    }

    fn expected(&self, chi2: f64) -> f64 {
        self.counted as f64 * (chi2 / self.wider).powf(self.freedom as f64 / 2.0)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test may fail loudly")]
mod tests {
    use super::super::neighbours::Odometry;
    use super::super::{Consensus, Search};
    use crate::pose_graph::{Edge, PoseGraph, Vertex};
    use mapwright_geom::Pose2;
    use nalgebra::Matrix3;

    /// A circle driven three times, closed in six places.
    fn rounds() -> PoseGraph<Pose2> {
        let mut graph = PoseGraph::default();
        let step = Pose2::exp([1.0, 0.0, std::f64::consts::TAU / 20.0]);
        let mut world_from_vertex = Pose2::IDENTITY;
        for id in 0..60 {
            graph.vertices.push(Vertex { id, world_from_vertex, fixed: false });
            world_from_vertex = world_from_vertex * step;
        }
        let noise =
            |k: usize| Pose2::new(0.01 * (k as f64).sin(), 0.01 * (2.0 * k as f64).cos(), 1e-3 * (k as f64).cos());
        let mut connect = |from: usize, to: usize, pose: Pose2| {
            let information = Matrix3::identity() * 1e4;
            graph.edges.push(Edge { from, to, from_from_to: pose * noise(from + to), information });
        };
        (1..60).for_each(|k| connect(k - 1, k, step));
        [3, 9, 14, 21, 28, 35].into_iter().for_each(|k| connect(k, k + 20, Pose2::IDENTITY));
        graph
    }

    #[test]
    fn a_closure_left_out_is_tested_as_by_the_graph_without_it() {
        let (graph, settings) = (rounds(), Consensus::default());
        let odometry = Odometry::new(&graph);
        let mut search = Search::new(&graph, &settings, &odometry, odometry.inflated(&settings, 1.0)).unwrap();
        search.believed.fill(true);
        search.solve().unwrap();
        for (at, left_out) in search.left_out().unwrap() {
            search.believed[search.edges[at]] = false;
            search.solve().unwrap();
            let without =
                search.with_factor(|search, problem, normal| search.tested(at, problem, normal)).unwrap().unwrap();
            assert!((left_out.chi2 / without.chi2 - 1.0).abs() < 0.02, "{left_out:?} {without:?}");
            assert!((left_out.vagueness / without.vagueness - 1.0).abs() < 0.02, "{left_out:?} {without:?}");
            search.believed[search.edges[at]] = true;
        }
    }
}
