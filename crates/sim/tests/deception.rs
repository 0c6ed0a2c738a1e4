//! Look-alikes, kidnapped robots, and the truth about both.
#![allow(clippy::unwrap_used, reason = "tests may")]

use mapwright_geom::{Pose2, Stamp};
use mapwright_sim::worlds::{Alias, LookAlike, LookAlikeKind, look_alike};
use mapwright_sim::{Drive, DriveSettings, REVISIT_OVERLAP, REVISIT_PATH_M, TrueScan, kidnapping, view_overlap};
use std::sync::Arc;

fn still(case: &LookAlike) -> Vec<TrueScan> {
    let mut settings = DriveSettings { scan_rate_hz: 1.0, ..case.settings.clone() };
    settings.laser.range_sigma_m = 0.0;
    Drive::new(Arc::clone(&case.site), settings).scans().collect()
}

fn at(scans: &[TrueScan], stamp: Stamp) -> &TrueScan {
    scans.iter().find(|s| s.scan.stamp == stamp).unwrap()
}

#[test]
fn the_alias_lies_where_the_seed_says_in_two_hundred_worlds() {
    for seed in 0..200 {
        let alias = look_alike(seed).alias;
        if seed % 2 == 0 {
            assert!(alias.inside_two_sigma(), "{seed}: {alias:?}");
        } else {
            assert!(alias.position_sigmas > 3.0 && alias.position_sigmas.is_finite(), "{seed}: {alias:?}");
        }
    }
}

/// From the reported poses and the motion model alone, without the code under test: many drives of the reported path.
#[test]
fn the_ellipse_is_that_of_the_motion_model() {
    for seed in [0, 4, 1, 5] {
        let case = look_alike(seed);
        let Alias { original, copy, deceived_original_from_copy: deceived, .. } = case.alias;
        let reported = |noise_seed: u64| {
            let mut settings = DriveSettings { scan_rate_hz: 1.0, seed: noise_seed, ..case.settings.clone() };
            settings.laser.beams = 0;
            let scans: Vec<TrueScan> = Drive::new(Arc::clone(&case.site), settings).scans().collect();
            let odom = |stamp| at(&scans, stamp).scan.odom_from_robot.unwrap();
            odom(original).between(odom(copy))
        };
        // Spread of odometry over robots of this kind, moved to what this robot reported.
        let ends: Vec<Pose2> = (1_000..1_150).map(reported).collect();
        let n = ends.len() as f64;
        let mean = |f: fn(&Pose2) -> f64| ends.iter().map(f).sum::<f64>() / n;
        let (mx, my) = (mean(|p| p.x), mean(|p| p.y));
        let sum = |f: &dyn Fn(&Pose2) -> f64| ends.iter().map(f).sum::<f64>() / n;
        let (xx, yy) = (sum(&|p| (p.x - mx).powi(2)), sum(&|p| (p.y - my).powi(2)));
        let xy = sum(&|p| (p.x - mx) * (p.y - my));
        let here = reported(case.settings.seed);
        let (dx, dy) = (deceived.x - here.x, deceived.y - here.y);
        let sigmas = ((yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy)).sqrt();
        let ratio = sigmas / case.alias.position_sigmas;
        assert!((0.4..2.5).contains(&ratio), "{seed}: {sigmas} and {}", case.alias.position_sigmas);
    }
}

#[test]
fn aliases_look_alike_and_are_elsewhere() {
    for seed in 0..30 {
        let case = look_alike(seed);
        let scans = still(&case);
        let (original, copy) = (at(&scans, case.alias.original), at(&scans, case.alias.copy));
        // As if the robot stood at the copy where the deception puts it: the same view but for how it came there.
        let pairs = original.scan.ranges_m.iter().zip(&copy.scan.ranges_m);
        let alike = pairs.filter(|(a, b)| (*a - *b).abs() < 0.5).count();
        assert!(alike > 110, "{seed} {:?}: {alike} of 180 beams", case.kind);
        let truth = original.world_from_robot.between(copy.world_from_robot);
        assert!(truth.distance(case.alias.original_from_copy) < 1e-9);
        let off = case.alias.deceived_original_from_copy;
        let off_rad = (truth.theta - off.theta).abs();
        assert!(truth.distance(off) > 3.0 || off_rad > 1.0, "{seed}: {truth:?} {off:?}");
        let (a, b) = (original.world_from_robot, copy.world_from_robot);
        assert!(view_overlap(&case.site.world, &case.settings, a, b) <= REVISIT_OVERLAP, "{seed} {:?}", case.kind);
        assert!(!case.revisits().contains(case.alias.original, case.alias.copy));
    }
}

#[test]
fn every_look_alike_is_clear_comes_back_and_is_a_function_of_its_seed() {
    for seed in 0..30 {
        let case = look_alike(seed);
        assert!(case.site.clearance_m() > 0.3, "{seed} {:?}: {} m", case.kind, case.site.clearance_m());
        let revisits = case.revisits();
        let known_s: f64 = revisits.stretches().iter().map(|s| s[1].secs_since(s[0])).sum();
        assert!(known_s > 20.0, "{seed} {:?}: {known_s} s", case.kind);
        let log = |case: &LookAlike| case.drive().scans().skip(100).take(5).collect::<Vec<_>>();
        assert_eq!(log(&case), log(&look_alike(seed)));
        assert_ne!(log(&case), log(&look_alike(seed + 1)));
    }
}

/// What the robot saw, cast anew from the other time, beam by beam.
#[test]
fn revisits_overlap_and_lie_far_apart_along_the_way() {
    for seed in 0..6 {
        let case = look_alike(seed);
        let scans = still(&case);
        let way_m = |from: Stamp, to: Stamp| -> f64 {
            let part = scans.windows(2).filter(|w| w[0].scan.stamp >= from && w[1].scan.stamp <= to);
            part.map(|w| w[0].world_from_robot.distance(w[1].world_from_robot)).sum()
        };
        for pair in case.revisits().pairs().iter().step_by(40) {
            assert!(way_m(pair.earlier, pair.later) > REVISIT_PATH_M - 0.01);
            let (a, b) = (at(&scans, pair.earlier), at(&scans, pair.later));
            let shared = shared(&case, a, b.world_from_robot).min(shared(&case, b, a.world_from_robot));
            assert!(shared > REVISIT_OVERLAP - 0.1, "{seed}: {shared} and {}", pair.overlap);
        }
    }
}

/// Share of a scan's end points that a robot elsewhere has in view.
fn shared(case: &LookAlike, seen: &TrueScan, world_from_robot: Pose2) -> f64 {
    let moment = case.site.world.at(0.0, [world_from_robot.x, world_from_robot.y], 30.0);
    let laser = &seen.scan.laser;
    let returns = seen.scan.ranges_m.iter().enumerate().filter(|(_, r)| **r < 30.0);
    let in_view = |(beam, range_m): (usize, &f32)| {
        let bearing_rad = laser.angle_min_rad + beam as f64 * laser.angle_step_rad;
        let (sin, cos) = bearing_rad.sin_cos();
        let range_m = f64::from(*range_m);
        let end = seen.world_from_robot.transform([range_m * cos, range_m * sin]);
        let local = world_from_robot.inverse().transform(end);
        let away_m = local[0].hypot(local[1]);
        let direction = [(end[0] - world_from_robot.x) / away_m, (end[1] - world_from_robot.y) / away_m];
        local[0] > 0.0 && moment.cast([world_from_robot.x, world_from_robot.y], direction) > away_m - 0.1
    };
    let (count, total) = (returns.clone().filter(|r| in_view(*r)).count(), returns.count());
    count as f64 / total as f64
}

#[test]
fn all_kinds_come_with_both_parities() {
    let kinds = |parity: u64| [0, 2, 4].map(|seed| look_alike(seed + parity).kind);
    let all = [LookAlikeKind::ParallelCorridors, LookAlikeKind::SymmetricFloor, LookAlikeKind::RepeatedRooms];
    assert_eq!(kinds(0), all);
    assert_eq!(kinds(1), all);
}

#[test]
fn a_kidnapped_robot_is_blind_on_the_way_and_comes_home() {
    let mut blocked = 0;
    for seed in 0..30 {
        let case = kidnapping(seed);
        let scans: Vec<TrueScan> = case.drive().scans().collect();
        let on_the_way = scans.iter().filter(|s| (case.taken..case.put_down).contains(&s.scan.stamp));
        let covered = on_the_way.clone().all(|s| s.scan.ranges_m.iter().all(|r| *r < 0.5));
        assert!(covered, "{seed}");
        blocked += usize::from(on_the_way.count() > 0);
        let before = scans.iter().rev().find(|s| s.scan.stamp < case.taken).unwrap();
        let after = scans.iter().find(|s| s.scan.stamp >= case.put_down).unwrap();
        let moved_m = before.world_from_robot.distance(after.world_from_robot);
        assert!(moved_m > 5.0, "{seed}: {moved_m} m");
        let odom = |s: &TrueScan| s.scan.odom_from_robot.unwrap();
        assert!(odom(before).distance(odom(after)) < 0.2, "{seed}: odometry noticed");
        let home_s = case.home.unwrap().secs_since(case.put_down);
        assert!(if case.known_ground { home_s < 6.0 } else { home_s > 5.0 }, "{seed}: home after {home_s} s");
    }
    assert!((5..25).contains(&blocked));
}

#[test]
fn a_glimpse_of_known_ground_is_no_homecoming() {
    // Through doors two of these see for an instant what they have seen before, and come there half a minute later.
    for (seed, away_s) in [(19_003, 20.0..35.0), (19_017, 20.0..35.0), (19_001, 0.0..0.3), (19_005, 0.0..0.3)] {
        let case = kidnapping(seed);
        let [glimpse, home] = [case.glimpse, case.home].map(|at| at.expect("it comes home"));
        println!("{seed}: home {:.1} s after a glimpse", home.secs_since(glimpse));
        assert!(away_s.contains(&home.secs_since(glimpse)), "{seed}");
    }
}
