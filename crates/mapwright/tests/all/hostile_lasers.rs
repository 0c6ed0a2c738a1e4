//! Lasers that cannot be are refused scan by scan; what is mapped stays.

#![allow(clippy::unwrap_used, clippy::expect_used)]

use mapwright::{LaserModel, LaserScan, Mapper, Pose2, Settings, Stamp};
use proptest::prelude::*;

fn scan(laser: LaserModel) -> LaserScan {
    LaserScan {
        stamp: Stamp(0),
        laser: laser.into(),
        ranges_m: vec![2.0; 90],
        odom_from_robot: Some(Pose2::new(0.5, 0.0, 0.0)),
    }
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        Just(f64::NAN),
        Just(f64::INFINITY),
        Just(-1e300),
        Just(1e18),
        Just(1e9),
        -200.0..200.0f64,
        -1.0..1.0f64
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]
    #[test]
    fn any_laser_is_mapped_with_or_refused(n in prop::array::uniform8(number())) {
        let mut mapper = Mapper::new(Settings::default()).unwrap();
        mapper.add_scan(&scan(LaserModel::half_circle("sound", 90)));
        let strange = LaserModel {
            angle_min_rad: n[0],
            angle_step_rad: n[1],
            range_min_m: n[2],
            range_max_m: n[3],
            robot_from_laser: Pose2 { x: n[4], y: n[5], theta: n[6] },
            beam_period_s: n[7],
            ..LaserModel::half_circle("strange", 90)
        };
        let refusable = strange.check(90).is_err();
        let update = mapper.add_scan(&scan(strange));
        prop_assert_eq!(update.refused.is_some(), refusable);
        prop_assert!(update.map_from_robot.is_finite());
        prop_assert!(!mapper.keyframes().is_empty());
    }
}

#[test]
fn a_refused_scan_says_why() {
    let mut mapper = Mapper::new(Settings::default()).unwrap();
    let update = mapper.add_scan(&scan(LaserModel { angle_step_rad: f64::NAN, ..LaserModel::half_circle("nan", 90) }));
    assert!(update.refused.unwrap().contains("bearings"));
    assert!(mapper.keyframes().is_empty());
}
