//! The little that is needed of directions in space.

pub(super) fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// The direction of a vector; none of one that is zero or not finite.
pub(super) fn unit(v: [f64; 3]) -> Option<[f64; 3]> {
    let length = dot(v, v).sqrt();
    (length > 1e-9 && length.is_finite()).then(|| v.map(|x| x / length))
}

/// Two directions at right angles to a direction up and to each other, so that all three are right-handed: the first is as near
/// to x as may be, or to y where x points up.
pub(super) fn horizontals(up: [f64; 3]) -> [[f64; 3]; 2] {
    let axis = if up[0].abs() < 0.9 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    let height = dot(axis, up);
    let first = unit(std::array::from_fn(|k| axis[k] - height * up[k])).unwrap_or(axis);
    [first, cross(up, first)]
}
