//! How meshes lie to what was seen.

use crate::simulated::{
    Point, cuboid, ends, faces, looking, plane, positions, seen, settings, sphere, surface_of, view,
};
use mapwright_geom::Pose3;
use mapwright_surface::{Mesh, MeshSettings, Surface, SurfaceSettings, View};
use nalgebra::Vector3;

fn mesh(surface: &Surface) -> Mesh {
    surface.mesh(&MeshSettings::default())
}

fn worst(mesh: &Mesh, error: impl Fn(Point) -> f64) -> f64 {
    positions(mesh).map(|at| error(at).abs()).fold(0.0, f64::max)
}

#[test]
fn a_plane_is_met_to_a_tenth_of_a_voxel() {
    let voxel_m = 0.05;
    for normal in [[1.0, 0.0, 0.0], [1.0, 0.3, -0.2], [1.0, 1.0, 1.0], [0.2, 0.0, 1.0]] {
        let (normal, at) = (Vector3::from(normal).normalize(), Vector3::new(2.013, 0.0, -0.02));
        let world = plane(normal, at);
        let cameras = [looking([0.0; 3], [1.0, 0.0, 0.0]), looking([0.1, 0.4, 0.2], [1.0, -0.2, 0.0])];
        let mesh = mesh(&surface_of(&world, &cameras, 160, settings(voxel_m)));
        assert!(mesh.triangles.len() > 500, "{}", mesh.triangles.len());
        let error_m = worst(&mesh, |position| normal.dot(&(position - at)));
        assert!(error_m < 0.1 * voxel_m, "{normal:?}: {error_m} m");
        let sensor = cameras[0].translation;
        assert!(faces(&mesh).all(|(face, middle)| face.dot(&(sensor - middle)) >= 0.0), "triangles face the sensor");
        let facing = |normal: &[f32; 3]| Vector3::from(normal.map(f64::from));
        let side = normal * normal.dot(&(sensor - at)).signum();
        assert!(mesh.normals.iter().all(|normal| facing(normal).dot(&side) > 0.95));
    }
}

#[test]
fn a_floor_seen_aslant_is_where_it_is() {
    let floor = plane(Vector3::z(), Vector3::new(0.0, 0.0, -0.5));
    let cameras: Vec<Pose3> = (0..6).map(|k| looking([0.3 * f64::from(k), 0.0, 0.0], [9.0, 0.0, -0.3])).collect();
    let mesh = mesh(&surface_of(&floor, &cameras, 300, settings(0.05)));
    let far = positions(&mesh).filter(|at| at.x > 5.0).count();
    let error_m = worst(&mesh, |at| at.z + 0.5);
    assert!(far > 500 && error_m < 0.005, "{far} vertices, {error_m} m");
}

#[test]
fn a_sphere_seen_from_everywhere_is_closed() {
    let world = sphere(Vector3::new(0.11, -0.03, 0.07), 0.5);
    let around = (-1..=1).flat_map(|x| (-1..=1).flat_map(move |y| (-1..=1).map(move |z| [x, y, z])));
    let cameras: Vec<Pose3> = around
        .filter(|at| *at != [0; 3])
        .map(|at| looking(at.map(|v| 1.1 * f64::from(v)), [0.11, -0.03, 0.07]))
        .collect();
    let mesh = mesh(&surface_of(&world, &cameras, 120, settings(0.04)));
    let edges = mesh.edges();
    assert_eq!((edges.boundary, edges.non_manifold), (0, 0), "{edges:?}");
    let corners = mesh.positions_m.len() as i64 - edges.inner as i64 + mesh.triangles.len() as i64;
    assert_eq!(corners, 2, "one sphere, by Euler");
    let middle = Vector3::new(0.11, -0.03, 0.07);
    let error_m = worst(&mesh, |at| (at - middle).norm() - 0.5);
    assert!(error_m < 0.25 * 0.04, "{error_m} m");
    assert!(faces(&mesh).all(|(face, at)| face.dot(&(at - middle)) > -1e-12), "triangles face outwards");
}

#[test]
fn the_walls_of_a_room_are_closed_from_within() {
    let (low, high) = (Vector3::new(-1.0, -1.5, -0.8), Vector3::new(1.2, 1.4, 0.9));
    let room = cuboid(low, high);
    let ways =
        [[9.0, 0.0, 0.0], [-9.0, 0.1, 0.0], [0.0, 9.0, 0.0], [0.0, -9.0, 0.0], [0.0, 0.0, 9.0], [0.0, 0.0, -9.0]];
    let from = [[0.0, 0.0, 0.0], [0.3, -0.4, 0.2]];
    let cameras: Vec<Pose3> = from.iter().flat_map(|&from| ways.map(|at| looking(from, at))).collect();
    let mesh = mesh(&surface_of(&room, &cameras, 200, settings(0.05)));
    let edges = mesh.edges();
    assert!(edges.non_manifold == 0 && edges.boundary * 200 < edges.inner, "{edges:?}");
    let is_open = |at: Point| (0..3).filter(|&k| at[k] - low[k] > 0.15 && high[k] - at[k] > 0.15).count() >= 2;
    assert!(ends(&mesh).all(|at| !is_open(at)), "holes are where walls meet, if anywhere");
    let apart = |at: Point| (0..3).map(|k| (at[k] - low[k]).abs().min((at[k] - high[k]).abs())).fold(9.0, f64::min);
    assert!(worst(&mesh, apart) < 0.06, "corners are rounded by little more than a voxel: {}", worst(&mesh, apart));
}

#[test]
fn sparse_rings_make_one_surface() {
    // Sixteen rings two degrees apart in a room of 8 m: 0.14 m from ring to ring on its walls, at voxels of 0.05.
    let room = cuboid(Vector3::new(-4.0, -4.0, -1.2), Vector3::new(4.0, 4.0, 9.0));
    let rings = (-8..8).flat_map(|ring| (0..900).map(move |step| (f64::from(ring) * 0.035, f64::from(step) * 0.007)));
    let direction = |(up, turn): (f64, f64)| Vector3::new(up.cos() * turn.cos(), up.cos() * turn.sin(), up.sin());
    let hit = |ray: Point| (ray * room(Vector3::zeros(), ray).unwrap()).cast::<f32>().into();
    let points: Vec<[f32; 3]> = rings.map(direction).map(hit).collect();
    let mut surface = Surface::new(settings(0.05)).unwrap();
    surface.add(0, &view(&points), Pose3::identity()).unwrap();
    let mesh = surface.mesh(&MeshSettings { least_weight: 0.1, ..MeshSettings::default() });
    let wall = |at: &Point| (at.x - 4.0).abs() < 0.05 && at.y.abs() < 1.5 && at.z.abs() < 0.8;
    let [mut seen, mut all] = [0, 0];
    for (y, z) in (-14..14).flat_map(|y| (-7..7).map(move |z| (0.1 * f64::from(y), 0.1 * f64::from(z)))) {
        all += 1;
        seen += usize::from(positions(&mesh).any(|at| wall(&at) && (at.y - y).hypot(at.z - z) < 0.08));
    }
    assert!(seen * 10 > all * 9, "{seen} of {all} places on the wall");
}

/// A wall with two sides, each seen by two cameras.
fn wall(thickness_m: f64, voxel_m: f64) -> Mesh {
    let (low, high) = (Vector3::new(-0.5 * thickness_m, -9.0, -9.0), Vector3::new(0.5 * thickness_m, 9.0, 9.0));
    let world = cuboid(low.add_scalar(0.013), high.add_scalar(0.013));
    let from = [[-1.5, 0.0, 0.0], [-1.4, 0.3, 0.1], [1.5, 0.0, 0.0], [1.4, -0.3, 0.1]];
    let cameras = from.map(|from| looking(from, [0.0, 0.0, 0.0]));
    mesh(&surface_of(&world, &cameras, 200, settings(voxel_m)))
}

#[test]
fn both_sides_of_a_thin_wall_stay() {
    let voxel_m = 0.05;
    for (voxels, most) in [(3.0, 0.1), (2.0, 0.2), (1.5, 0.3)] {
        let mesh = wall(voxels * voxel_m, voxel_m);
        let half_m = 0.5 * voxels * voxel_m;
        let sides: Vec<(bool, f64)> = positions(&mesh)
            .zip(&mesh.normals)
            .filter(|(at, _)| at.y.abs() < 0.8 && at.z.abs() < 0.8)
            .map(|(at, normal)| (normal[0] > 0.0, at.x - 0.013))
            .collect();
        let count = |is_ahead: bool| sides.iter().filter(|(ahead, _)| *ahead == is_ahead).count();
        assert!(count(true) > 800 && count(false) > 800, "{voxels} voxels: {} and {}", count(true), count(false));
        let error = |&(ahead, x): &(bool, f64)| (if ahead { x - half_m } else { -x - half_m }).abs() / voxel_m;
        let worst = sides.iter().map(error).fold(0.0, f64::max);
        assert!(worst < most, "a wall of {voxels} voxels is off by {worst} of one");
    }
}

#[test]
fn what_moved_is_carved_away() {
    let back = plane(Vector3::x(), Vector3::new(3.0, 0.0, 0.0));
    let visitor = sphere(Vector3::new(1.6, 0.1, 0.0), 0.3);
    let busy = |from, direction| visitor(from, direction).or_else(|| back(from, direction));
    let left = |carve| {
        let settings = SurfaceSettings { carve, ..settings(0.05) };
        let mut surface = Surface::new(settings).unwrap();
        for id in 0..16_u64 {
            let camera = looking([0.0, 0.02 * id as f64, 0.01 * id as f64], [3.0, 0.0, 0.0]);
            let points = if id < 2 { seen(&busy, camera, 120) } else { seen(&back, camera, 120) };
            surface.add(id, &view(&points), camera).unwrap();
        }
        let mesh = surface.mesh(&MeshSettings::default());
        let [visitors, walls] = [0.0..2.5, 2.9..3.1].map(|x| positions(&mesh).filter(|at| x.contains(&at.x)).count());
        (visitors, walls)
    };
    let (with, without) = (left(true), left(false));
    assert!(without.0 > 100 && with.0 * 20 < without.0, "{with:?} with carving, {without:?} without");
    assert!(with.1 * 100 > without.1 * 98, "the wall stays: {with:?} with carving, {without:?} without");
}

#[test]
fn small_pieces_go_if_asked() {
    let wall = plane(Vector3::x(), Vector3::new(2.0, 0.0, 0.0));
    let speck = sphere(Vector3::new(1.0, 0.0, 0.0), 0.06);
    let both = |from, direction| speck(from, direction).or_else(|| wall(from, direction));
    let cameras = [looking([0.0; 3], [1.0, 0.0, 0.0]), looking([0.0, 0.1, 0.1], [1.0, 0.0, 0.0])];
    let surface = surface_of(&both, &cameras, 200, settings(0.03));
    let count = |least_piece_m| {
        let mesh = surface.mesh(&MeshSettings { least_piece_m, ..MeshSettings::default() });
        let near = positions(&mesh).filter(|at| at.x < 1.5).count();
        let is_sound = mesh.triangles.iter().flatten().all(|&vertex| (vertex as usize) < mesh.positions_m.len());
        assert!(is_sound && mesh.normals.len() == mesh.positions_m.len());
        (near, mesh.positions_m.len())
    };
    let ((speck, all), (left, rest)) = (count(0.0), count(0.5));
    assert!(speck > 10 && left == 0 && rest == all - speck, "{speck} of {all}, then {left} of {rest}");
    assert_eq!(count(99.0), (0, 0));
}

#[test]
fn colours_are_those_of_the_points() {
    let wall = plane(Vector3::x(), Vector3::new(1.0, 0.0, 0.0));
    let camera = looking([0.0; 3], [1.0, 0.0, 0.0]);
    let points = seen(&wall, camera, 150);
    let colours: Vec<[u8; 3]> =
        points.iter().map(|at| if at[1] > 0.0 { [200, 10, 30] } else { [20, 100, 250] }).collect();
    let mut surface = Surface::new(settings(0.04)).unwrap();
    surface.add(1, &View { colours: &colours, ..view(&points) }, camera).unwrap();
    let all = MeshSettings { least_weight: 0.0, ..MeshSettings::default() };
    let mesh = surface.mesh(&all);
    assert_eq!(mesh.colours.len(), mesh.positions_m.len());
    let is_right = |(at, colour): (Point, &[u8; 3])| match at.y {
        y if y > 0.08 => *colour == [200, 10, 30],
        y if y < -0.08 => *colour == [20, 100, 250],
        _ => true,
    };
    assert!(positions(&mesh).zip(&mesh.colours).all(is_right));
    surface.add(2, &view(&points), camera).unwrap();
    assert!(surface.mesh(&all).colours == mesh.colours, "points without colours change none");
}
