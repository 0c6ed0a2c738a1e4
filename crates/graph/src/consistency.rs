//! Which closures agree with each other: pairwise consistency maximisation (Mangelson, Dominic, Eustice, Vasudevan 2018,
//! "Pairwise consistent measurement set maximization for robust multi-robot map merging", sections IV and V).
//!
//! Two closures and the two pieces of the chain between their ends make a cycle. Where the cycle ends too far from where
//! it began, for the covariances it went through, one of the two closures is false.

use crate::clique::largest_clique;
use crate::group::{PoseGroup, RotationError};
use mapwright_geom::{Apart, Pose, Pose2, Pose3, TangentMatrix, compose_covariance, inverse_covariance};

/// A relative pose and the covariance of its right perturbation, translation first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Relative<P: Pose> {
    /// `first_from_second`.
    pub pose: P,
    /// Of `pose * exp(noise)`.
    pub covariance: P::Matrix,
}

impl<P: Pose> Relative<P> {
    /// What is known for sure: a pose relative to itself.
    #[must_use]
    pub fn identity() -> Self {
        Self { pose: P::identity(), covariance: P::Matrix::zero() }
    }

    /// `a_from_c` of `a_from_b` and an independent `b_from_c`.
    #[must_use]
    pub fn then(&self, next: &Self) -> Self {
        let covariance = compose_covariance(&self.covariance, next.pose, &next.covariance);
        Self { pose: self.pose * next.pose, covariance }
    }

    /// `b_from_a` of `a_from_b`.
    #[must_use]
    pub fn inverse(&self) -> Self {
        Self { pose: self.pose.inverse(), covariance: inverse_covariance(self.pose, &self.covariance) }
    }

    /// Squared distance from the identity in standard deviations; infinite where the covariance is not positive definite.
    #[must_use]
    pub fn chi2_of_cycle(&self) -> f64 {
        P::apart::<CycleChi2>(*self)
    }
}

/// See [`Relative::chi2_of_cycle`].
struct CycleChi2;

impl Apart for CycleChi2 {
    type Of<'a, P: Pose> = Relative<P>;
    type Output<P: Pose> = f64;

    fn plane(cycle: Relative<Pose2>) -> f64 {
        chi2_of_cycle(&cycle)
    }

    fn space(cycle: Relative<Pose3>) -> f64 {
        chi2_of_cycle(&cycle)
    }
}

fn chi2_of_cycle<P: PoseGroup<D>, const D: usize>(cycle: &Relative<P>) -> f64 {
    let error = cycle.pose.coordinates(RotationError::RotationVector);
    let jacobian = cycle.pose.coordinates_jacobian(RotationError::RotationVector);
    let covariance = jacobian * cycle.covariance * jacobian.transpose();
    let solved = covariance.cholesky().map(|factor| error.dot(&factor.solve(&error)));
    solved.filter(|chi2| *chi2 >= 0.0).unwrap_or(f64::INFINITY)
}

/// Two keyframes that are believed to have been seen from each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Closure<P: Pose> {
    /// Place of one keyframe in the chain.
    pub from: usize,
    /// Place of the other.
    pub to: usize,
    /// `from_from_to`.
    pub measured: Relative<P>,
}

impl<P: Pose> Closure<P> {
    /// The same, from the earlier keyframe to the later.
    #[must_use]
    pub fn forwards(&self) -> Self {
        if self.from <= self.to {
            return *self;
        }
        Self { from: self.to, to: self.from, measured: self.measured.inverse() }
    }
}

/// When closures agree, and how long to search.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConsistencySettings {
    /// Chi-square of a cycle up to which two closures agree; none for the 99 % quantile of as many degrees of freedom.
    pub threshold_chi2: Option<f64>,
    /// Whether a closure must also agree with the chain alone.
    pub chain_alone: bool,
    /// Branches of the search at most; beyond them the best set found so far is taken.
    pub max_branches: usize,
}

impl Default for ConsistencySettings {
    fn default() -> Self {
        Self { threshold_chi2: None, chain_alone: true, max_branches: 20_000 }
    }
}

/// What came out.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Consistent {
    /// Closures that all agree with each other, ascending.
    pub members: Vec<usize>,
    /// The largest such set among the others, ascending: how strong the case against the members is.
    pub rivals: Vec<usize>,
    /// Closures that contradict the chain alone, ascending.
    pub against_chain: Vec<usize>,
    /// Whether it is certain that there is no larger set.
    pub exhausted: bool,
}

/// The largest set of closures that agree pairwise, see [`ConsistencySettings`].
///
/// `chain(a, b)` is keyframe `b` seen from `a` without closures, for `a <= b`; none where nothing leads there, and then
/// no cycle contradicts anything. Time and memory grow with the square of the closures; the same input gives the same
/// set.
#[must_use]
pub fn largest_consistent_set<P: Pose>(
    closures: &[Closure<P>],
    chain: impl Fn(usize, usize) -> Option<Relative<P>>,
    settings: &ConsistencySettings,
) -> Consistent {
    let threshold = settings.threshold_chi2.unwrap_or_else(|| quantile_99(P::DIMENSION));
    let forwards: Vec<Closure<P>> = closures.iter().map(Closure::forwards).collect();
    let holds = |closure: &Closure<P>| {
        let alone = chain(closure.from, closure.to).map(|leg| closure.measured.then(&leg.inverse()));
        alone.is_none_or(|cycle| cycle.chi2_of_cycle() <= threshold)
    };
    let (possible, against_chain): (Vec<usize>, Vec<usize>) =
        (0..forwards.len()).partition(|&at| !settings.chain_alone || holds(&forwards[at]));
    let agree = |&a: &usize, &b: &usize| {
        let cycle = cycle_of(&forwards[a], &forwards[b], &chain);
        cycle.is_none_or(|cycle| cycle.chi2_of_cycle() <= threshold)
    };
    let found = largest_clique(&possible, agree, settings.max_branches);
    Consistent { members: found.members, rivals: found.rivals, against_chain, exhausted: found.exhausted }
}

/// Once around: along the first closure, the chain, back along the second, the chain. Both must lead forwards, so that
/// the pieces of the chain are as short as can be.
pub(crate) fn cycle_of<P: Pose>(
    first: &Closure<P>,
    second: &Closure<P>,
    chain: impl Fn(usize, usize) -> Option<Relative<P>>,
) -> Option<Relative<P>> {
    let leg = |a: usize, b: usize| if a <= b { chain(a, b) } else { chain(b, a).map(|leg| leg.inverse()) };
    let outward = first.measured.then(&leg(first.to, second.to)?);
    Some(outward.then(&second.measured.inverse()).then(&leg(second.from, first.from)?))
}

/// 99 % quantile of chi-square: three degrees of freedom in the plane, six in space.
pub(crate) fn quantile_99(freedom: usize) -> f64 {
    if freedom == 3 { 11.345 } else { 16.812 }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a test may fail loudly")]
mod tests {
    use super::*;
    use mapwright_geom::Tangent;

    /// A motion in the plane; in space it also rises and rolls.
    fn motion<P: Pose>(x: f64, y: f64, yaw: f64, out_of_plane: f64) -> P {
        P::identity().retract(&P::Tangent::from_fn(|k| match k {
            0 => x,
            1 => y,
            k if k + 1 == P::DIMENSION => yaw,
            _ => out_of_plane,
        }))
    }

    /// Two rounds of 40 keyframes each, on a circle or a helix; one metre and 9 degrees a step.
    fn chain<P: Pose>(a: usize, b: usize) -> Option<Relative<P>> {
        let step = Relative {
            pose: motion(1.0, 0.0, std::f64::consts::TAU / 40.0, 0.05),
            covariance: P::Matrix::from_variances(1e-4, 1e-5),
        };
        Some((a..b).fold(Relative::identity(), |so_far, _| so_far.then(&step)))
    }

    fn closure<P: Pose>(from: usize, to: usize, error: P) -> Closure<P> {
        let pose = chain::<P>(from.min(to), from.max(to)).unwrap().pose;
        let pose = if from < to { pose } else { pose.inverse() };
        Closure {
            from,
            to,
            measured: Relative { pose: pose * error, covariance: P::Matrix::from_variances(1e-4, 1e-5) },
        }
    }

    fn majority_is_found<P: Pose>(shift_m: f64) {
        let small = motion::<P>(0.01, -0.01, 0.002, 0.002);
        let mut closures: Vec<_> = (0..8).map(|k| closure(4 * k, 4 * k + 40, small)).collect();
        closures[3] = closure(52, 12, small);
        // four that agree with each other, within what the chain allows, but not with the others
        closures.extend((0..4).map(|k| {
            let mut false_one = closure(2 + 4 * k, 42 + 4 * k, P::identity());
            let shift = P::identity().moved([shift_m, 0.0, 0.0]);
            let at = chain::<P>(0, 2 + 4 * k).unwrap().pose;
            false_one.measured.pose = at.inverse() * shift * at * false_one.measured.pose;
            false_one
        }));
        closures.push(closure(5, 33, motion(3.0, 2.0, 1.0, 1.0)));
        let found = largest_consistent_set(&closures, chain, &ConsistencySettings::default());
        assert_eq!(found.members, (0..8).collect::<Vec<_>>());
        assert_eq!((found.rivals, found.against_chain), ((8..12).collect(), vec![12]));
        assert!(found.exhausted);
    }

    #[test]
    fn the_majority_that_agrees_is_found_and_its_rival_named() {
        majority_is_found::<Pose2>(0.2);
        majority_is_found::<Pose3>(0.25);
    }

    fn both_directions_mean_the_same<P: Pose>() {
        let there = closure(3, 45, motion::<P>(0.1, 0.2, 0.03, 0.01));
        let back = Closure { from: 45, to: 3, measured: there.measured.inverse() }.forwards();
        let apart = there.measured.pose.local(back.measured.pose);
        let difference = there.measured.covariance - back.measured.covariance;
        for row in 0..P::DIMENSION {
            assert!(apart[row].abs() < 1e-12);
            assert!((0..P::DIMENSION).all(|column| difference[(row, column)].abs() < 1e-12));
        }
    }

    #[test]
    fn a_closure_means_the_same_in_both_directions() {
        both_directions_mean_the_same::<Pose2>();
        both_directions_mean_the_same::<Pose3>();
    }

    fn nonsense_is_survived<P: Pose>() {
        let settings = ConsistencySettings::default();
        assert_eq!(largest_consistent_set::<P>(&[], chain, &settings).members, Vec::<usize>::new());
        let mut broken = closure(3, 45, P::identity());
        broken.measured.covariance = P::Matrix::from_fn(|_, _| f64::NAN);
        let found = largest_consistent_set(&[broken], chain, &settings);
        assert_eq!((found.members, found.against_chain), (vec![], vec![0]));
    }

    #[test]
    fn nothing_and_nonsense_are_survived() {
        nonsense_is_survived::<Pose2>();
        nonsense_is_survived::<Pose3>();
    }
}
