//! What is no surface.

use crate::simulated::{looking, plane, seen, settings, view};
use mapwright_geom::Pose3;
use mapwright_surface::{Change, MeshSettings, Patch, Surface, SurfaceError, SurfaceSettings, View, Volume};
use nalgebra::Vector3;

#[test]
fn settings_that_cannot_be_are_refused() {
    let good = SurfaceSettings::default();
    let bad = [
        SurfaceSettings { voxel_m: 0.0, ..good },
        SurfaceSettings { voxel_m: -1.0, ..good },
        SurfaceSettings { voxel_m: f64::NAN, ..good },
        SurfaceSettings { voxel_m: f64::INFINITY, ..good },
        SurfaceSettings { noise_m: f64::NAN, ..good },
        SurfaceSettings { noise_m: 0.2, ..good },
        SurfaceSettings { noise_per_m: -0.1, ..good },
        SurfaceSettings { near_m: -1.0, ..good },
        SurfaceSettings { near_m: f64::NAN, ..good },
        SurfaceSettings { memory_mb: 0, ..good },
    ];
    for settings in bad {
        assert!(matches!(Surface::new(settings), Err(SurfaceError::Setting { .. })), "{settings:?}");
        assert!(matches!(Patch::prepare(&view(&[]), &settings), Err(SurfaceError::Setting { .. })));
    }
    assert!(Surface::new(good).is_ok());
}

#[test]
fn points_that_cannot_be_used_are_counted() {
    let (nan, far) = (f32::NAN, 1e30);
    let points =
        [[nan, 0.0, 0.0], [f32::INFINITY, 0.0, 0.0], [far, 0.0, 0.0], [0.0; 3], [0.01, 0.0, 0.0], [1.0, 0.0, 0.0]];
    let mut surface = Surface::new(settings(0.05)).unwrap();
    let counts = surface.add(0, &view(&points), Pose3::identity()).unwrap();
    assert_eq!((counts.points, counts.not_finite, counts.far, counts.near), (6, 2, 1, 2));
    let nowhere = View { origins_m: &[[nan; 3]], ..view(&points) };
    assert_eq!(surface.add(1, &nowhere, Pose3::identity()).unwrap().not_finite, 6);
    let counts = surface.add(2, &view(&[]), Pose3::identity()).unwrap();
    assert_eq!(counts.points, 0);
}

#[test]
fn columns_and_poses_that_do_not_fit_are_refused() {
    let points = [[1.0, 0.0, 0.0], [1.0, 0.1, 0.0]];
    let mut surface = Surface::new(settings(0.05)).unwrap();
    let mut add = |origins_m: &[[f32; 3]], colours: &[[u8; 3]], pose| {
        surface.add(0, &View { points_m: &points, origins_m, colours }, pose)
    };
    assert!(matches!(add(&[], &[], Pose3::identity()), Err(SurfaceError::Columns { what: "origins", .. })));
    assert!(matches!(add(&[[0.0; 3]; 3], &[], Pose3::identity()), Err(SurfaceError::Columns { .. })));
    assert!(matches!(
        add(&[[0.0; 3]], &[[0; 3]], Pose3::identity()),
        Err(SurfaceError::Columns { what: "colours", .. })
    ));
    let nowhere = Pose3 { translation: Vector3::new(f64::NAN, 0.0, 0.0), ..Pose3::identity() };
    assert!(matches!(add(&[[0.0; 3]], &[], nowhere), Err(SurfaceError::Pose)));
    assert!(add(&[[0.0; 3]; 2], &[[0; 3]; 2], Pose3::identity()).is_ok());
    assert!(matches!(add(&[[0.0; 3]], &[], Pose3::identity()), Err(SurfaceError::Twice { id: 0 })));
    assert!(matches!(surface.remove(5), Err(SurfaceError::Unknown { id: 5 })));
    assert!(matches!(surface.update(&[(0, nowhere)], 0.0), Err(SurfaceError::Pose)));
    assert_eq!(surface.update(&[(5, Pose3::identity())], 0.0).unwrap().unknown, 1);
    surface.remove(0).unwrap();
    assert!(surface.volume().is_empty());
}

#[test]
fn what_lies_beyond_the_map_is_left_out() {
    let wall = plane(Vector3::x(), Vector3::new(2.0, 0.0, 0.0));
    let points = seen(&wall, Pose3::identity(), 40);
    let patch = Patch::prepare(&view(&points), &settings(0.05)).unwrap();
    let mut volume = Volume::new(settings(0.05)).unwrap();
    for (x, is_outside) in [(1e300, true), (26_300.0, true), (-26_300.0, true), (26_000.0, false)] {
        let at = Pose3 { translation: Vector3::new(x, 0.0, 0.0), ..Pose3::identity() };
        let outside = volume.draw(&patch, at, Change::Add).unwrap();
        assert_eq!(outside, if is_outside { patch.len() } else { 0 }, "at {x}");
        assert_eq!(volume.is_empty(), is_outside);
    }
    assert!(!volume.mesh(&MeshSettings::default()).triangles.is_empty());
}

#[test]
fn memory_has_a_bound_and_the_error_says_what_would_fit() {
    let wall = plane(Vector3::x(), Vector3::new(8.0, 0.0, 0.0));
    let camera = looking([0.0; 3], [1.0, 0.0, 0.0]);
    let points = seen(&wall, camera, 600);
    let small = SurfaceSettings { memory_mb: 2, ..settings(0.02) };
    let mut surface = Surface::new(small).unwrap();
    let before = surface.volume().clone();
    let Err(SurfaceError::Memory { limit_mb: 2, fits_m, .. }) = surface.add(0, &view(&points), camera) else {
        panic!("expected to be refused");
    };
    assert!(*surface.volume() == before && surface.keyframes().count() == 0);
    assert!(fits_m > 0.02, "{fits_m}");
    let error = surface.add(0, &view(&points), camera).unwrap_err().to_string();
    assert!(error.contains("would fit"), "{error}");

    // Tiny voxels: no plane goes through points that lie thousands of voxels apart.
    let tiny = SurfaceSettings { voxel_m: 1e-5, noise_m: 1e-5, memory_mb: 8, ..SurfaceSettings::default() };
    let near = seen(&plane(Vector3::x(), Vector3::new(2.0, 0.0, 0.0)), camera, 100);
    let mut surface = Surface::new(tiny).unwrap();
    surface.add(0, &view(&near), camera).unwrap();
    assert!(surface.volume().is_empty());
}

#[test]
fn a_patch_belongs_to_its_voxels() {
    let patch = Patch::prepare(&view(&[[1.0, 0.0, 0.0]]), &settings(0.05)).unwrap();
    let mut volume = Volume::new(settings(0.1)).unwrap();
    assert!(matches!(volume.draw(&patch, Pose3::identity(), Change::Add), Err(SurfaceError::OtherVoxels { .. })));
    let mut same = Volume::new(settings(0.05)).unwrap();
    // What was never added is taken away: nonsense, but no panic.
    same.draw(&patch, Pose3::identity(), Change::Remove).unwrap();
    let _ = (
        same.mesh(&MeshSettings { least_weight: f64::NAN, ..MeshSettings::default() }),
        same.distance_at([f64::NAN; 3]),
    );
}
