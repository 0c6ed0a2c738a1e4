//! What sensors see of simple shapes.

use mapwright_geom::Pose3;
use mapwright_surface::{Mesh, Surface, SurfaceSettings, View};
use nalgebra::{UnitQuaternion, Vector3};

pub(crate) type Point = Vector3<f64>;

/// What a ray from a place in a direction of length one hits first, as a distance.
pub(crate) type World<'a> = &'a dyn Fn(Point, Point) -> Option<f64>;

/// Points of a depth camera with a field of view of 90 degrees that looks along x, of `side` x `side` pixels, in its frame.
pub(crate) fn seen(world: World<'_>, world_from_camera: Pose3, side: i32) -> Vec<[f32; 3]> {
    let tangent = |k: i32| (f64::from(k) + 0.5) / f64::from(side) * 2.0 - 1.0;
    let pixels = (0..side).flat_map(|row| (0..side).map(move |column| (row, column)));
    let point = |(row, column): (i32, i32)| {
        let direction = Vector3::new(1.0, tangent(column), tangent(row)).normalize();
        let range = world(world_from_camera.translation, world_from_camera.rotation * direction)?;
        Some((direction * range).cast::<f32>().into())
    };
    pixels.filter_map(point).collect()
}

/// A camera that looks at a place.
pub(crate) fn looking(from: [f64; 3], at: [f64; 3]) -> Pose3 {
    let (from, at) = (Vector3::from(from), Vector3::from(at));
    let turn = UnitQuaternion::rotation_between(&Vector3::x(), &(at - from));
    let half_turn = UnitQuaternion::from_scaled_axis(Vector3::new(0.0, 0.0, std::f64::consts::PI));
    Pose3 { translation: from, rotation: turn.unwrap_or(half_turn) }
}

pub(crate) fn plane(normal: Point, at: Point) -> impl Fn(Point, Point) -> Option<f64> {
    move |from, direction| {
        let range = normal.dot(&(at - from)) / normal.dot(&direction);
        (range > 0.0 && range < 20.0).then_some(range)
    }
}

pub(crate) fn sphere(middle: Point, radius: f64) -> impl Fn(Point, Point) -> Option<f64> {
    move |from, direction| {
        let half = direction.dot(&(middle - from));
        let rest = (middle - from).norm_squared() - radius * radius;
        let inside = half * half - rest;
        (inside > 0.0 && half > 0.0).then(|| half - inside.sqrt())
    }
}

/// A box from inside and outside.
pub(crate) fn cuboid(low: Point, high: Point) -> impl Fn(Point, Point) -> Option<f64> {
    move |from, direction| {
        let (mut enter, mut leave) = (f64::NEG_INFINITY, f64::INFINITY);
        for k in 0..3 {
            let (a, b) = ((low[k] - from[k]) / direction[k], (high[k] - from[k]) / direction[k]);
            (enter, leave) = (enter.max(a.min(b)), leave.min(a.max(b)));
        }
        if leave < enter || leave < 0.0 { None } else { Some(if enter > 0.0 { enter } else { leave }) }
    }
}

pub(crate) fn settings(voxel_m: f64) -> SurfaceSettings {
    SurfaceSettings { voxel_m, noise_m: 0.1 * voxel_m, ..SurfaceSettings::default() }
}

/// A view of points seen from the keyframe's origin.
pub(crate) fn view(points_m: &[[f32; 3]]) -> View<'_> {
    View { points_m, origins_m: &[[0.0; 3]], colours: &[] }
}

/// The surface of a world seen by cameras.
pub(crate) fn surface_of(world: World<'_>, cameras: &[Pose3], side: i32, settings: SurfaceSettings) -> Surface {
    let mut surface = Surface::new(settings).unwrap();
    for (id, &camera) in (0..).zip(cameras) {
        surface.add(id, &view(&seen(world, camera, side)), camera).unwrap();
    }
    surface
}

pub(crate) fn positions(mesh: &Mesh) -> impl Iterator<Item = Point> + '_ {
    mesh.positions_m.iter().map(|position| Vector3::from(position.map(f64::from)))
}

/// Normals of triangles by their corners' order, and their middles.
pub(crate) fn faces(mesh: &Mesh) -> impl Iterator<Item = (Point, Point)> + '_ {
    mesh.triangles.iter().map(|triangle| {
        let [a, b, c] = triangle.map(|vertex| Vector3::from(mesh.positions_m[vertex as usize].map(f64::from)));
        ((b - a).cross(&(c - a)), (a + b + c) / 3.0)
    })
}

/// Vertices at which the surface ends.
pub(crate) fn ends(mesh: &Mesh) -> impl Iterator<Item = Point> + '_ {
    let edges = |&[a, b, c]: &[u32; 3]| [[a, b], [b, c], [c, a]].map(|[a, b]| [a.min(b), a.max(b)]);
    let mut all: Vec<[u32; 2]> = mesh.triangles.iter().flat_map(edges).collect();
    all.sort_unstable();
    let of_one: Vec<u32> =
        all.chunk_by(|a, b| a == b).filter(|same| same.len() == 1).flat_map(|same| same[0]).collect();
    of_one.into_iter().map(|vertex| Vector3::from(mesh.positions_m[vertex as usize].map(f64::from)))
}
