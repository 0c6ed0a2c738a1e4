//! Axes of small symmetric matrices.

use nalgebra::{Matrix3, SymmetricEigen, Vector3};

/// Eigenvalues in rising order, and their vectors as columns, of a symmetric matrix.
pub(crate) fn axes(matrix: Matrix3<f64>) -> (Vector3<f64>, Matrix3<f64>) {
    let SymmetricEigen { eigenvalues, eigenvectors } = SymmetricEigen::new(matrix);
    let mut order = [0, 1, 2];
    order.sort_by(|&a, &b| eigenvalues[a].total_cmp(&eigenvalues[b]));
    let column = |k: usize| eigenvectors.column(order[k]).into_owned();
    (
        Vector3::new(eigenvalues[order[0]], eigenvalues[order[1]], eigenvalues[order[2]]),
        Matrix3::from_columns(&[column(0), column(1), column(2)]),
    )
}
