//! Poses in space of plain IEEE operations only, so that a seed gives the same bytes on every CPU.

use mapwright_geom::{Pose3, sin_cos};

/// A pose on the floor: turned by yaw about z, then pitch about y (positive is nose down), then roll about x.
pub(crate) fn upright(translation: [f64; 3], yaw_rad: f64, pitch_rad: f64, roll_rad: f64) -> Pose3 {
    let [(sy, cy), (sp, cp), (sr, cr)] = [yaw_rad, pitch_rad, roll_rad].map(|angle| sin_cos(0.5 * angle));
    let quaternion = [
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    ];
    Pose3::from_quaternion(translation, quaternion).unwrap_or_default()
}

/// A pose on the straight way from one pose to another nearby.
pub(crate) fn interpolate(from: Pose3, to: Pose3, share: f64) -> Pose3 {
    let translation = from.translation * (1.0 - share) + to.translation * share;
    let (a, b) = (from.rotation.coords, to.rotation.coords);
    let b = if a.dot(&b) < 0.0 { -b } else { b };
    let between = a * (1.0 - share) + b * share;
    Pose3::from_quaternion(translation.into(), between.into()).unwrap_or(to)
}

/// Its axes in the outer frame: rows of the rotation matrix.
pub(crate) fn rows(pose: &Pose3) -> [[f64; 3]; 3] {
    let matrix = *pose.rotation.to_rotation_matrix().matrix();
    std::array::from_fn(|row| std::array::from_fn(|column| matrix[(row, column)]))
}

/// A vector turned by the rows of a rotation matrix.
#[inline]
pub(crate) fn turned(rows: &[[f64; 3]; 3], [x, y, z]: [f64; 3]) -> [f64; 3] {
    rows.map(|row| row[0] * x + row[1] * y + row[2] * z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positive_pitch_is_nose_down_and_positive_roll_lifts_the_left() {
        let ahead = turned(&rows(&upright([0.0; 3], 0.0, 0.1, 0.0)), [1.0, 0.0, 0.0]);
        assert!((ahead[2] + 0.1f64.sin()).abs() < 1e-12);
        let left = turned(&rows(&upright([0.0; 3], 0.0, 0.0, 0.1)), [0.0, 1.0, 0.0]);
        assert!((left[2] - 0.1f64.sin()).abs() < 1e-12);
        let ahead = turned(&rows(&upright([0.0; 3], 0.5, 0.0, 0.2)), [1.0, 0.0, 0.0]);
        assert!((ahead[0] - 0.5f64.cos()).abs() < 1e-12 && (ahead[1] - 0.5f64.sin()).abs() < 1e-12);
    }

    #[test]
    fn half_way_lies_half_way() {
        let (a, b) = (upright([1.0, 0.0, 0.0], 3.1, 0.0, 0.0), upright([2.0, 2.0, 0.0], -3.1, 0.0, 0.0));
        let middle = interpolate(a, b, 0.5);
        let wanted = upright([1.5, 1.0, 0.0], std::f64::consts::PI, 0.0, 0.0);
        assert!(middle.distance(wanted) < 1e-12 && middle.rotation.angle_to(&wanted.rotation) < 1e-6);
    }
}
