//! Adding and taking away, in any order, to the bit.

use crate::simulated::{cuboid, looking, seen, settings, view};
use mapwright_geom::Pose3;
use mapwright_surface::{Change, MeshSettings, Patch, Surface, SurfaceSettings, View, Volume, write_ply};
use nalgebra::{UnitQuaternion, Vector3};
use proptest::prelude::*;

/// A room seen by some cameras, each somewhat wrong about where it is.
fn keyframes() -> Vec<(u64, Vec<[f32; 3]>, Pose3)> {
    let room = cuboid(Vector3::new(-1.0, -1.5, -0.8), Vector3::new(1.2, 1.4, 0.9));
    let ways =
        [[9.0, 1.0, 0.0], [-9.0, 0.1, 0.0], [0.0, 9.0, 2.0], [0.0, -9.0, 0.0], [0.0, 3.0, 9.0], [2.0, 0.0, -9.0]];
    let camera = |k: usize| looking([0.05 * k as f64, 0.0, -0.03 * k as f64], ways[k]);
    let off = |k: usize| Pose3::exp(nalgebra::Vector6::new(0.03, 0.01, -0.02, 0.01, -0.02, 0.03) * (k as f64 - 2.0));
    (0..6).map(|k| (k as u64 * 7, seen(&room, camera(k), 60), camera(k) * off(k))).collect()
}

fn added(keyframes: &[(u64, Vec<[f32; 3]>, Pose3)], order: &[usize], pose: impl Fn(usize) -> Pose3) -> Surface {
    let mut surface = Surface::new(settings(0.05)).unwrap();
    for &k in order {
        surface.add(keyframes[k].0, &view(&keyframes[k].1), pose(k)).unwrap();
    }
    surface
}

fn file(surface: &Surface, threads: usize) -> Vec<u8> {
    let mut bytes = Vec::new();
    write_ply(&mut bytes, &surface.mesh(&MeshSettings { threads, ..MeshSettings::default() })).unwrap();
    bytes
}

#[test]
fn any_order_and_any_threads_give_the_same_bytes() {
    let all = keyframes();
    let rising = added(&all, &[0, 1, 2, 3, 4, 5], |k| all[k].2);
    let mut other = added(&all, &[4, 1, 5, 2], |k| if k == 2 { Pose3::identity() } else { all[k].2 });
    other.remove(all[2].0).unwrap();
    other.remove(all[4].0).unwrap();
    for k in [3, 2, 0, 4] {
        other.add(all[k].0, &view(&all[k].1), all[k].2).unwrap();
    }
    assert!(rising.volume() == other.volume());
    assert_eq!(rising.volume().bytes(), other.volume().bytes());
    assert_eq!(rising.volume().blocks(), other.volume().blocks());
    let bytes = file(&rising, 1);
    assert!(bytes.len() > 50_000);
    assert!(
        [(&other, 1), (&rising, 2), (&other, 2), (&other, 7), (&other, 100_000)]
            .iter()
            .all(|(s, n)| file(s, *n) == bytes)
    );
}

#[test]
fn a_surface_that_followed_is_the_one_drawn_from_scratch() {
    let all = keyframes();
    let corrected = |k: usize| all[k].2 * Pose3::exp(nalgebra::Vector6::new(0.0, 0.07, 0.0, 0.0, 0.0, 0.02) * k as f64);
    let scratch = added(&all, &[0, 1, 2, 3, 4, 5], corrected);
    let poses: Vec<(u64, Pose3)> = (0..6).map(|k| (all[k].0, corrected(k))).collect();

    let mut at_once = added(&all, &[0, 1, 2, 3, 4, 5], |k| all[k].2);
    assert_eq!(at_once.update(&poses, 0.0).unwrap().moved, 5, "the first stays where it is");
    assert!(at_once.volume() == scratch.volume());

    let mut bit_by_bit = added(&all, &[5, 4, 3, 2, 1, 0], |k| all[k].2);
    for chunk in poses.chunks(2) {
        bit_by_bit.update(chunk, 0.0).unwrap();
    }
    assert!(bit_by_bit.volume() == scratch.volume());
    assert_eq!(file(&bit_by_bit, 2), file(&scratch, 1));

    let mut lazy = added(&all, &[0, 1, 2, 3, 4, 5], |k| all[k].2);
    let updated = lazy.update(&poses, 0.15).unwrap();
    assert!((1..5).contains(&updated.moved), "{updated:?}");
    assert!(lazy.volume() != scratch.volume());
    lazy.update(&poses, 0.0).unwrap();
    assert!(lazy.volume() == scratch.volume());
    assert_eq!(lazy.update(&poses, 0.0).unwrap().moved, 0);
}

#[test]
fn nothing_is_left_of_what_is_taken_out() {
    let all = keyframes();
    let mut surface = added(&all, &[0, 1, 2, 3, 4, 5], |k| all[k].2);
    assert!(surface.volume().bytes() > 100_000);
    for (id, ..) in &all {
        surface.remove(*id).unwrap();
    }
    let volume = surface.volume();
    assert!(volume.is_empty() && volume.bytes() == 0 && volume.blocks() == 0 && volume.views() == 0);
    assert!(volume.voxels().next().is_none() && surface.mesh(&MeshSettings::default()).triangles.is_empty());
    assert!(*volume == Volume::new(settings(0.05)).unwrap());
}

type Cloud = (Vec<[f32; 3]>, Vec<[u8; 3]>, [f32; 3], [f64; 6]);

/// Points near a plane, and some that are anywhere or nowhere.
fn cloud() -> impl Strategy<Value = Cloud> {
    let near = prop::array::uniform3(-0.4..0.4f32).prop_map(|[u, v, off]| [2.0 + 0.3 * u + 0.05 * off, u, v]);
    let point = prop_oneof![30 => near, 1 => prop::array::uniform3(prop::num::f32::ANY), 1 => Just([0.0; 3])];
    let points = prop::collection::vec((point, prop::array::uniform3(any::<u8>())), 0..150);
    (points, prop::array::uniform3(-0.3..0.3f32), prop::array::uniform6(-2.0..2.0f64)).prop_map(
        |(points, origin, twist)| {
            let (points, colours) = points.into_iter().unzip();
            (points, colours, origin, twist)
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn arbitrary_clouds_come_and_go_exactly(clouds in prop::collection::vec(cloud(), 1..5), seed in any::<u64>(), is_noisy in any::<bool>()) {
        let settings = SurfaceSettings { noise_per_m: if is_noisy { 0.05 } else { 0.0 }, ..settings(0.1) };
        let patches: Vec<(Patch, Pose3)> = clouds.iter().map(|(points, colours, origin, twist)| {
            let view = View { points_m: points, origins_m: &[*origin], colours };
            let pose = Pose3 {
                translation: Vector3::new(twist[0], twist[1], twist[2]),
                rotation: UnitQuaternion::from_scaled_axis(Vector3::new(twist[3], twist[4], twist[5])),
            };
            (Patch::prepare(&view, &settings).unwrap(), pose)
        }).collect();
        let mut rising = Volume::new(settings).unwrap();
        patches.iter().for_each(|(patch, at)| assert_eq!(rising.draw(patch, *at, Change::Add).unwrap(), 0));
        let mut other = Volume::new(settings).unwrap();
        let first = seed as usize % patches.len();
        other.draw(&patches[first].0, patches[first].1 * patches[0].1, Change::Add).unwrap();
        patches.iter().rev().for_each(|(patch, at)| assert_eq!(other.draw(patch, *at, Change::Add).unwrap(), 0));
        other.draw(&patches[first].0, patches[first].1 * patches[0].1, Change::Remove).unwrap();
        prop_assert!(rising == other);
        prop_assert_eq!(rising.bytes(), other.bytes());
        let mesh = |volume: &Volume, threads| volume.mesh(&MeshSettings { least_weight: 0.0, threads, least_piece_m: 0.05 });
        prop_assert_eq!(mesh(&rising, 1), mesh(&other, 2));
        prop_assert!(rising.voxels().all(|voxel| voxel.distance_m.abs() <= settings.truncation_m(1e9) + 0.1 / 128.0));
        patches.iter().for_each(|(patch, at)| assert_eq!(other.draw(patch, *at, Change::Remove).unwrap(), 0));
        prop_assert!(other.is_empty() && other.bytes() == 0);
    }
}
