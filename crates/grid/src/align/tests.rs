//! Maps of simulated buildings, seen from different places and drawn in different frames.

use super::*;
use mapwright_sim::{Segment, Site, World, worlds};
use std::f64::consts::TAU;

/// A map as a robot would have drawn it that looked around at these places, its own frame anywhere.
fn seen_from(site: &Site, places: &[[f64; 2]], world_from_map: Pose2, resolution_m: f64) -> OccupancyMap {
    const REACH_M: f64 = 12.0;
    let (map_from_world, cells_of) = (world_from_map.inverse(), |m: f64| (m / resolution_m).floor() as i64);
    let mut seen: Vec<([i64; 2], Occupancy)> = Vec::new();
    for &place in places {
        let moment = site.world.at(0.0, place, REACH_M);
        for beam in 0..720 {
            let (s, c) = (TAU * f64::from(beam) / 720.0).sin_cos();
            let range_m = moment.cast(place, [c, s]);
            let cell =
                |along_m: f64| map_from_world.transform([place[0] + along_m * c, place[1] + along_m * s]).map(cells_of);
            let steps = (range_m.min(REACH_M) / resolution_m) as usize;
            seen.extend((0..steps).map(|step| (cell(step as f64 * resolution_m), Occupancy::Free)));
            if range_m < REACH_M {
                seen.push((cell(range_m), Occupancy::Occupied));
            }
        }
    }
    drawn(&seen, world_from_map, resolution_m)
}

fn drawn(seen: &[([i64; 2], Occupancy)], world_from_map: Pose2, resolution_m: f64) -> OccupancyMap {
    let bound = |k: usize| {
        let along = || seen.iter().map(|(cell, _)| cell[k]);
        (along().min().unwrap(), along().max().unwrap() + 1)
    };
    let ((left, right), (low, high)) = (bound(0), bound(1));
    let (width, height) = ((right - left) as usize, (high - low) as usize);
    let mut cells = vec![Occupancy::Unknown; width * height];
    for (at, what) in seen {
        let cell = &mut cells[(at[1] - low) as usize * width + (at[0] - left) as usize];
        *cell = if *cell == Occupancy::Occupied { *cell } else { *what };
    }
    // The robot's own world: its map lies somewhere in it, and turned.
    let corner = Pose2::new(left as f64 * resolution_m, low as f64 * resolution_m, 0.0);
    OccupancyMap { width, height, resolution_m, world_from_map: OWN.inverse() * world_from_map * corner, cells }
}

/// Where a robot's own world lies in the true one.
const OWN: Pose2 = Pose2 { x: 3.0, y: -2.0, theta: 0.4 };

fn along(site: &Site, share: std::ops::Range<f64>) -> Vec<[f64; 2]> {
    let mut places = Vec::new();
    for leg in site.route.legs() {
        let steps = (leg.length_m() / 2.0).ceil().max(1.0);
        places.extend((0..steps as usize).map(|k| {
            let t = k as f64 / steps;
            [0, 1].map(|axis: usize| leg.a[axis] + t * (leg.b[axis] - leg.a[axis]))
        }));
    }
    let at = |share: f64| (share * places.len() as f64) as usize;
    places[at(share.start)..at(share.end)].to_vec()
}

#[test]
fn two_parts_of_an_office_are_joined_whatever_their_headings_and_cells() {
    for (seed, turned) in [(1, 2.0), (6, -0.7)] {
        let site = worlds::office_floor(seed);
        let a = seen_from(&site, &along(&site, 0.0..0.6), Pose2::IDENTITY, 0.05);
        let mut b = seen_from(&site, &along(&site, 0.3..1.0), Pose2::new(20.0, -4.0, turned), 0.04);
        // The second robot's world is another one.
        let elsewhere = Pose2::new(-30.0, 12.0, 1.3);
        b.world_from_map = elsewhere * b.world_from_map;
        let found = align(&a, &b).unwrap();
        assert_eq!(found.refusal, None, "{found:?}");
        let error = elsewhere.inverse().between(found.a_from_b);
        let middle = found.overlap_middle_b;
        let off_m = {
            let [one, other] = [elsewhere.inverse(), found.a_from_b].map(|pose| pose.transform(middle));
            (one[0] - other[0]).hypot(one[1] - other[1])
        };
        assert!(off_m < 0.02 && error.theta.abs() < 0.1_f64.to_radians(), "{off_m} {error:?}");
        assert!(found.evidence.share() > 0.9 && found.misfit_m[0] < 0.03, "{found:?}");
        // The other way round it is the inverse.
        let back = align(&b, &a).unwrap();
        let round = found.a_from_b * back.a_from_b;
        assert!(round.theta.abs() < 1e-6 && round.x.hypot(round.y) < 1e-4, "{round:?}");
    }
}

#[test]
fn floors_of_different_buildings_are_refused() {
    let floors: Vec<OccupancyMap> = (1..4)
        .map(|seed| {
            let site = worlds::office_floor(seed);
            seen_from(&site, &along(&site, 0.0..1.0), Pose2::new(1.0, 2.0, 0.3 * seed as f64), 0.05)
        })
        .collect();
    for (k, a) in floors.iter().enumerate() {
        for b in &floors[k + 1..] {
            let found = align(a, b).unwrap();
            assert!(found.refusal.is_some(), "{found:?}");
        }
    }
}

/// Walls of a room from corner to corner, seen from its middle.
fn room(corners: &[[f64; 2]]) -> OccupancyMap {
    let next = corners.iter().skip(1).chain(&corners[..1]);
    let walls = corners.iter().zip(next).map(|(&a, &b)| Segment { a, b }).collect();
    let site = Site { world: World::new(walls, Vec::new()), route: worlds::rooms(1).route };
    seen_from(&site, &[[1.0, 1.0], [4.0, 1.5]], Pose2::new(0.3, 0.1, 0.2), 0.05)
}

#[test]
fn a_room_with_two_ends_alike_is_ambiguous_and_one_with_a_corner_cut_is_not() {
    let alike = room(&[[-1.0, -1.0], [7.0, -1.0], [7.0, 4.0], [-1.0, 4.0]]);
    let found = align(&alike, &alike).unwrap();
    let Some(Refusal::Ambiguous { rival, ratio, .. }) = found.refusal else { panic!("{found:?}") };
    assert!(
        ratio > 0.9 && (rival.between(found.a_from_b).theta.abs() - std::f64::consts::PI).abs() < 0.02,
        "{found:?}"
    );
    assert!(Refusal::Ambiguous { rival, ratio, most: 0.5 }.to_string().contains("expected one pose that fits best"));

    let unlike =
        room(&[[-1.0, -1.0], [7.0, -1.0], [7.0, 1.5], [5.0, 2.7], [3.0, 2.7], [3.0, 6.5], [0.5, 6.5], [-1.0, 5.0]]);
    let found = align(&unlike, &unlike).unwrap();
    assert_eq!(found.refusal, None, "{found:?}");
    assert!(found.a_from_b.x.hypot(found.a_from_b.y) < 1e-3 && found.a_from_b.theta.abs() < 1e-4, "{found:?}");
    assert!(found.deviations().iter().all(|deviation| *deviation < 0.02), "{:?}", found.deviations());
}

#[test]
fn a_joined_map_has_what_either_knows_and_walls_once() {
    let site = worlds::office_floor(3);
    let a = seen_from(&site, &along(&site, 0.0..0.6), Pose2::IDENTITY, 0.05);
    let b = seen_from(&site, &along(&site, 0.3..1.0), Pose2::new(20.0, -4.0, 2.0), 0.05);
    let found = align(&a, &b).unwrap();
    let (joined, sources) = join(&a, &b, found.a_from_b).unwrap();
    let known = |map: &OccupancyMap| map.cells.iter().filter(|cell| **cell != Occupancy::Unknown).count();
    assert!(known(&joined) > known(&a) && known(&joined) < known(&a) + known(&b));
    let whole = seen_from(&site, &along(&site, 0.0..1.0), Pose2::IDENTITY, 0.05);
    let ratio = known(&joined) as f64 / known(&whole) as f64;
    assert!((0.97..1.03).contains(&ratio), "{ratio}");
    let walls = |map: &OccupancyMap| map.cells.iter().filter(|cell| **cell == Occupancy::Occupied).count();
    let ratio = walls(&joined) as f64 / walls(&whole) as f64;
    assert!((0.9..1.2).contains(&ratio), "{ratio}");
    let contradicted = sources.iter().filter(|source| **source == Source::Contradicted).count();
    assert!((contradicted as f64) < 0.05 * walls(&whole) as f64, "{contradicted}");
}

#[test]
fn maps_without_walls_are_errors() {
    let blank = |what| OccupancyMap {
        width: 30,
        height: 20,
        resolution_m: 0.05,
        world_from_map: Pose2::IDENTITY,
        cells: vec![what; 600],
    };
    let good = room(&[[-1.0, -1.0], [7.0, -1.0], [7.0, 4.0], [-1.0, 4.0]]);
    assert_eq!(align(&blank(Occupancy::Unknown), &good), Err((0, MapError::AllUnknown)));
    assert_eq!(align(&good, &blank(Occupancy::Free)), Err((1, MapError::NoWalls)));
    let all = align(&good, &blank(Occupancy::Occupied)).unwrap();
    assert!(all.refusal.is_some());
    for broken in [
        OccupancyMap { resolution_m: 0.0, ..good.clone() },
        OccupancyMap { width: 3, ..good.clone() },
        OccupancyMap { world_from_map: Pose2 { x: f64::NAN, y: 0.0, theta: 0.0 }, ..good.clone() },
    ] {
        assert_eq!(align(&good, &broken), Err((1, MapError::Geometry)));
    }
}
