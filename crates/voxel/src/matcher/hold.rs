//! What surfaces hold of a pose, and what they leave to the prediction.
//!
//! The information of a match ([`Fit`](super::Fit)) is no witness of that: the normal distribution of a voxel full of floor ends where the
//! voxel does, and a cloud that lies on the floor alone seems to know where it is on it. What is summed here is what surfaces say along
//! their normals (Zhang, Kaess, Singh 2016, "On degeneracy of optimization-based state estimation problems").

use super::{Matcher, UNKNOWN_WIDTHS2, pulled};
use crate::surfel_map::SurfelMap;
use mapwright_geom::Pose3;
use nalgebra::{Matrix3, Vector3};

/// How evenly the surfaces around a cloud hold its pose: the least of what they say of a direction, as a share of the most. Next to
/// nothing where they all lie along one direction, or nowhere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hold {
    /// Of its translations.
    pub translation_share: f64,
    /// Of its rotations about its own origin.
    pub rotation_share: f64,
}

impl Matcher {
    /// How evenly the surfaces of the finest resolution hold a cloud at a pose. Points count as they do in a match.
    pub fn hold(&mut self, map: &SurfelMap, points_m: &[[f32; 3]], pose: Pose3) -> Hold {
        self.take_points(points_m, self.settings.points);
        let level = &map.levels()[0];
        let per_width2 = 1.0 / self.width2(level, pose);
        let rotation = pose.rotation.to_rotation_matrix();
        let (mut translation, mut turning) = (Matrix3::zeros(), Matrix3::zeros());
        for (point, looked) in self.points.iter().zip(&mut self.looked) {
            let arm = rotation * Vector3::from(*point);
            let at = arm + pose.translation;
            let Some(surfel) = level.surfel_at(at.into(), looked) else { continue };
            let widths2 = pulled(surfel, at).1 * per_width2;
            if widths2 >= UNKNOWN_WIDTHS2 {
                continue;
            }
            let weight = surfel.along_normal(level.size_m) / (1.0 + widths2);
            let normal = Vector3::from(surfel.normal.map(f64::from));
            let torque = arm.cross(&normal);
            translation += normal * normal.transpose() * weight;
            turning += torque * torque.transpose() * weight;
        }
        Hold { translation_share: least_share(&translation), rotation_share: least_share(&turning) }
    }
}

/// The least eigenvalue as a share of the greatest; nothing where there is none above zero.
fn least_share(information: &Matrix3<f64>) -> f64 {
    let values = information.symmetric_eigenvalues();
    let most = values.max();
    if most > 0.0 { (values.min() / most).max(0.0) } else { 0.0 }
}
