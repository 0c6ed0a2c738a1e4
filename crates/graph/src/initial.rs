//! Poses to start from that do not depend on where the vertices are believed to be: the chordal relaxation (Carlone,
//! Tron, Daniilidis, Dellaert 2015, "Initialization techniques for 3D SLAM", section IV), rotations first.

use crate::group::PoseGroup;
use crate::linear::BlockSystem;
use crate::problem::Problem;
use nalgebra::{Matrix3, SMatrix, Vector3};

/// Weight of an edge without information, relative to the largest, so that every system has one solution.
const LEAST_WEIGHT: f64 = 1e-9;

/// Rotations and then translations by linear least squares; none where either system cannot be solved.
pub(crate) fn chordal_poses<P: PoseGroup<D>, const D: usize>(problem: &Problem<P, D>, poses: &[P]) -> Option<Vec<P>> {
    let rotations =
        if P::TRANSLATION == 2 { rotations::<P, D, 2>(problem, poses)? } else { rotations::<P, D, 3>(problem, poses)? };
    let translations = translations(problem, poses, &rotations)?;
    let pose = |v: usize| match problem.places[v] {
        Some(_) => P::from_parts(&rotations[v], translations[v]),
        None => Some(poses[v]),
    };
    (0..poses.len()).map(pose).collect()
}

/// Least `sum w |R_j - R_i R_ij|^2` over matrices, one row of them at a time, then the nearest rotations.
fn rotations<P: PoseGroup<D>, const D: usize, const B: usize>(
    problem: &Problem<P, D>,
    poses: &[P],
) -> Option<Vec<Matrix3<f64>>> {
    let weights = mean_information(problem, P::TRANSLATION..D);
    let mut system = BlockSystem::<B>::new(&problem.pattern);
    let n = problem.variables * B;
    let mut right = vec![0.0; n * B];
    for ((term, slot), weight) in problem.terms.iter().zip(&problem.slots).zip(weights) {
        let measured: SMatrix<f64, B, B> = term.measurement().parts().0.fixed_view::<B, B>(0, 0) * weight;
        for end in [term.from, term.to].into_iter().filter_map(|v| problem.places[v]) {
            system.add_diagonal(end, &SMatrix::from_diagonal_element(weight));
        }
        let known = |v: usize| -> SMatrix<f64, B, B> { poses[v].parts().0.fixed_view::<B, B>(0, 0).into_owned() };
        match (problem.places[term.from], problem.places[term.to]) {
            (Some(_), Some(_)) => slot.iter().for_each(|&slot| system.add(slot, &-measured)),
            (Some(from), None) => add_rows(&mut right, n, from, &(known(term.to) * measured.transpose())),
            (None, Some(to)) => add_rows(&mut right, n, to, &(known(term.from) * measured)),
            (None, None) => {}
        }
    }
    let solved = system.solve(&right)?;
    let rotation = |v: usize| -> Option<Matrix3<f64>> {
        let Some(place) = problem.places[v] else { return Some(poses[v].parts().0) };
        let mut matrix = Matrix3::identity();
        for row in 0..B {
            for column in 0..B {
                matrix[(row, column)] = solved[row * n + place * B + column];
            }
        }
        P::from_parts(&matrix, Vector3::zeros()).map(|pose| pose.parts().0)
    };
    (0..poses.len()).map(rotation).collect()
}

/// Row `k` of a matrix is what right-hand side `k` says of a variable.
fn add_rows<const B: usize>(right: &mut [f64], n: usize, place: usize, matrix: &SMatrix<f64, B, B>) {
    for row in 0..B {
        for column in 0..B {
            right[row * n + place * B + column] += matrix[(row, column)];
        }
    }
}

/// Least `sum w |t_j - t_i - R_i t_ij|^2`, one axis at a time.
fn translations<P: PoseGroup<D>, const D: usize>(
    problem: &Problem<P, D>,
    poses: &[P],
    rotations: &[Matrix3<f64>],
) -> Option<Vec<Vector3<f64>>> {
    let weights = mean_information(problem, 0..P::TRANSLATION);
    let mut system = BlockSystem::<1>::new(&problem.pattern);
    let n = problem.variables;
    let mut right = vec![0.0; 3 * n];
    for ((term, slot), weight) in problem.terms.iter().zip(&problem.slots).zip(weights) {
        let step = rotations[term.from] * term.measurement().parts().1;
        for (end, other, sign) in [(term.from, term.to, -1.0), (term.to, term.from, 1.0)] {
            let Some(place) = problem.places[end] else { continue };
            system.add_diagonal(place, &SMatrix::from_element(weight));
            let known = if problem.places[other].is_none() { poses[other].parts().1 } else { Vector3::zeros() };
            let pull = weight * (known + sign * step);
            (0..3).for_each(|axis| right[axis * n + place] += pull[axis]);
        }
        slot.iter().for_each(|&slot| system.add(slot, &SMatrix::from_element(-weight)));
    }
    let solved = system.solve(&right)?;
    let translation = |v: usize| match problem.places[v] {
        Some(place) => Vector3::from_fn(|axis, _| solved[axis * n + place]),
        None => poses[v].parts().1,
    };
    Some((0..poses.len()).map(translation).collect())
}

/// For every edge the mean of some diagonal entries of its information.
fn mean_information<P, const D: usize>(problem: &Problem<P, D>, entries: std::ops::Range<usize>) -> Vec<f64> {
    let count = entries.len() as f64;
    let mean = |information: &SMatrix<f64, D, D>| entries.clone().map(|k| information[(k, k)]).sum::<f64>() / count;
    let weights: Vec<f64> = problem.terms.iter().map(|term| mean(&term.information)).collect();
    let largest = weights.iter().fold(0.0_f64, |most, w| most.max(*w));
    let least = if largest > 0.0 { LEAST_WEIGHT * largest } else { 1.0 };
    weights.into_iter().map(|w| w.max(least)).collect()
}
