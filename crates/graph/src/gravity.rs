//! Gravity: what a keyframe says of where down is, a factor on roll and pitch alone.

use mapwright_geom::{Pose3, skew};
use nalgebra::{Matrix3, SMatrix, SVector, UnitQuaternion, Vector3};

/// Down in the world: its z axis is up.
pub(crate) const WORLD_DOWN: Vector3<f64> = Vector3::new(0.0, 0.0, -1.0);
/// The first vertex of a part that gravity levels keeps its position and heading this closely, metres and radians: enough for the
/// rest to hang on, and little enough for the equations to stay well conditioned.
const HELD_SIGMA: f64 = 1e-4;

/// The measured direction of gravity at a vertex of a graph of space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gravity {
    /// Place of the vertex in [`PoseGraph::vertices`](crate::PoseGraph::vertices).
    pub vertex: usize,
    /// Where down is, in the vertex's frame; of length one.
    pub down_in_vertex: Vector3<f64>,
    /// Standard deviation of its angle about any level axis, radians.
    pub sigma_rad: f64,
}

impl Gravity {
    /// Whether it is a direction and a deviation above zero.
    #[must_use]
    pub(crate) fn is_sound(&self) -> bool {
        // not `<`: NaN must fail
        (self.down_in_vertex.norm() - 1.0).abs() <= 1e-6 && self.sigma_rad >= 1e-6 && self.sigma_rad.is_finite()
    }
}

/// The error of a measured direction: the chord to where the world's down is by the pose, twice the sine of half the angle between
/// the two and so never flat short of opposite; and its derivative by a right perturbation.
pub(crate) fn tilt(world_from_vertex: Pose3, down_in_vertex: &Vector3<f64>) -> (Vector3<f64>, SMatrix<f64, 3, 6>) {
    let down = world_from_vertex.rotation.inverse() * WORLD_DOWN;
    let mut jacobian = SMatrix::<f64, 3, 6>::zeros();
    // exp(-w) down = down + down x w to first order
    jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&skew(&down));
    (down - down_in_vertex, jacobian)
}

/// How far a vertex is from where it is held, in units of what it is held by: position and heading, not roll and pitch; and the
/// derivative by a right perturbation.
pub(crate) fn held(world_from_vertex: Pose3, at: Pose3) -> (SVector<f64, 4>, SMatrix<f64, 4, 6>) {
    let off = world_from_vertex.translation - at.translation;
    let (vector, real) = positive(world_from_vertex.rotation * at.rotation.inverse());
    let rotation: Matrix3<f64> = *world_from_vertex.rotation.to_rotation_matrix().matrix();
    let mut jacobian = SMatrix::<f64, 4, 6>::zeros();
    jacobian.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
    let heading = Vector3::new(vector.y, -vector.x, real);
    jacobian.fixed_view_mut::<1, 3>(3, 3).copy_from(&(heading.transpose() * rotation));
    (SVector::<f64, 4>::new(off.x, off.y, off.z, 2.0 * vector.z) / HELD_SIGMA, jacobian / HELD_SIGMA)
}

/// Vector and real part of the quaternion whose real part is positive.
fn positive(rotation: UnitQuaternion<f64>) -> (Vector3<f64>, f64) {
    let (vector, real) = (rotation.imag(), rotation.w);
    if real < 0.0 { (-vector, -real) } else { (vector, real) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Edge, PoseGraph3, SolverSettings, Vertex, optimize};
    use mapwright_geom::Pose;
    use nalgebra::{Matrix6, Vector6};
    use proptest::prelude::*;

    const STEP: f64 = 1e-6;

    fn perturbed(pose: Pose3, axis: usize, by: f64) -> Pose3 {
        let mut tangent = Vector6::zeros();
        tangent[axis] = by;
        pose.retract(&tangent)
    }

    proptest! {
        #[test]
        fn jacobians_are_the_derivatives(
            t in prop::array::uniform6(-1.5..1.5f64),
            down in prop::array::uniform3(-1.0..1.0f64).prop_filter("a direction", |v| Vector3::from(*v).norm() > 0.1),
        ) {
            let (pose, down) = (Pose3::exp(t.into()), Vector3::from(down).normalize());
            let at = pose.retract(&(Vector6::from(t) * 0.1));
            let (jacobian, held_jacobian) = (tilt(pose, &down).1, held(pose, at).1);
            for axis in 0..6 {
                let [more, less] = [STEP, -STEP].map(|by| perturbed(pose, axis, by));
                let numeric = (tilt(more, &down).0 - tilt(less, &down).0) / (2.0 * STEP);
                prop_assert!((numeric - jacobian.column(axis)).norm() < 1e-8);
                let numeric = (held(more, at).0 - held(less, at).0) / (2.0 * STEP);
                prop_assert!((numeric - held_jacobian.column(axis)).norm() * HELD_SIGMA < 1e-8);
            }
        }
    }

    fn tilted(k: usize, tilt_rad: f64) -> Pose3 {
        Pose3::identity().moved([k as f64, 0.0, 0.0]).turned([0.3 * tilt_rad, tilt_rad, 0.0])
    }

    /// A way straight ahead whose odometry pitches by 0.02 rad a step while the robot stays level.
    fn drifting(count: usize, gravity: bool) -> PoseGraph3 {
        let mut graph = PoseGraph3::default();
        let step = Pose3::identity().moved([1.0, 0.0, 0.0]).turned([0.0, 0.02, 0.0]);
        let mut pose = tilted(0, 0.1);
        for k in 0..count {
            graph.vertices.push(Vertex { id: k as u64, world_from_vertex: pose, fixed: false });
            pose = pose * step;
            if gravity {
                graph.gravity.push(Gravity { vertex: k, down_in_vertex: -Vector3::z(), sigma_rad: 0.02 });
            }
            if k > 0 {
                let information = Matrix6::from_diagonal(&Vector6::new(1e4, 1e4, 1e4, 2.5e3, 2.5e3, 2.5e3));
                graph.edges.push(Edge { from: k - 1, to: k, from_from_to: step, information });
            }
        }
        graph
    }

    #[test]
    fn gravity_bounds_roll_and_pitch_and_levels_the_first() {
        let settings = SolverSettings::default();
        let (mut with, mut without) = (drifting(60, true), drifting(60, false));
        let solution = optimize(&mut with, &settings).unwrap();
        assert!(solution.converged && solution.chi2_after < 0.1 * solution.chi2_before, "{solution:?}");
        assert!((with.chi2().unwrap() - solution.chi2_after).abs() < 1e-6 * solution.chi2_after);
        optimize(&mut without, &settings).unwrap();
        let lean = |graph: &PoseGraph3, k: usize| {
            let down = graph.vertices[k].world_from_vertex.rotation.inverse() * WORLD_DOWN;
            (down + Vector3::z()).norm()
        };
        let worst = |graph: &PoseGraph3| (0..60).map(|k| lean(graph, k)).fold(0.0, f64::max);
        assert!(worst(&with) < 0.04 && worst(&without) > 0.9, "{} {}", worst(&with), worst(&without));
        let first = with.vertices[0].world_from_vertex;
        assert!(first.translation.norm() < 1e-3, "{first:?}");
        // its heading by the rotation's smallest way to where it was
        assert!((first.rotation * tilted(0, 0.1).rotation.inverse()).imag().z.abs() < 1e-3);
    }

    /// Closures that odometry's drift contradicts are true where gravity takes the drift away, and the false one is not.
    #[test]
    fn with_gravity_true_closures_are_believed_and_the_map_is_level() {
        let with_closures = |gravity: bool| {
            let mut graph = drifting(60, gravity);
            let information = Matrix6::from_diagonal(&Vector6::new(1e3, 1e3, 1e3, 1e3, 1e3, 1e3));
            for (from, to, ahead_m) in (0..12).map(|k| (k, k + 45, 45.0)).chain([(3, 40, -9.0)]) {
                let from_from_to = Pose3::identity().moved([ahead_m, 0.0, 0.0]);
                graph.edges.push(Edge { from, to, from_from_to, information });
            }
            graph
        };
        let lean = |graph: &PoseGraph3| {
            let down = |vertex: &Vertex<Pose3>| vertex.world_from_vertex.rotation.inverse() * WORLD_DOWN;
            graph.vertices.iter().map(|vertex| (down(vertex) + Vector3::z()).norm()).fold(0.0, f64::max)
        };
        let robust = SolverSettings { robust: Some(crate::Gnc::default()), ..SolverSettings::default() };
        let mut with = with_closures(true);
        let solution = optimize(&mut with, &robust).unwrap();
        let closures = &solution.weights[59..];
        assert!(solution.refused.is_none() && solution.converged, "{solution:?}");
        assert!(closures[..12].iter().all(|weight| *weight == 1.0) && closures[12] == 0.0, "{closures:?}");
        assert!(lean(&with) < 0.04, "{}", lean(&with));
        let mut alone = with_closures(true);
        alone.edges.truncate(59 + 12);
        optimize(&mut alone, &SolverSettings::default()).unwrap();
        for (a, b) in with.vertices.iter().zip(&alone.vertices) {
            assert!(a.world_from_vertex.distance(b.world_from_vertex) < 1e-3, "{a:?} {b:?}");
        }
        let mut without = with_closures(false);
        optimize(&mut without, &robust).unwrap();
        assert!(lean(&without) > 0.1, "{}", lean(&without));
    }

    #[test]
    fn a_fixed_vertex_stays_whatever_gravity_says() {
        let mut graph = drifting(10, true);
        graph.vertices[0].fixed = true;
        optimize(&mut graph, &SolverSettings::default()).unwrap();
        assert_eq!(graph.vertices[0].world_from_vertex, tilted(0, 0.1));
    }

    #[test]
    fn gravity_that_cannot_be_is_refused() {
        let good = Gravity { vertex: 1, down_in_vertex: -Vector3::z(), sigma_rad: 0.01 };
        let bad = [
            Gravity { vertex: 10, ..good },
            Gravity { down_in_vertex: Vector3::new(0.0, 0.0, -0.9), ..good },
            Gravity { down_in_vertex: Vector3::repeat(f64::NAN), ..good },
            Gravity { sigma_rad: 0.0, ..good },
            Gravity { sigma_rad: f64::NAN, ..good },
        ];
        for bad in bad {
            let mut graph = drifting(3, false);
            graph.gravity = vec![good, bad];
            let error = optimize(&mut graph, &SolverSettings::default()).unwrap_err();
            assert!(error.to_string().contains("gravity 1"), "{error}");
        }
    }
}
