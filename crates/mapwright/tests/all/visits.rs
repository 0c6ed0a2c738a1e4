//! Visits to the same places tell a map that is drawn over itself from a sound one.
#![allow(clippy::expect_used, reason = "helpers of tests may, as tests may")]

use mapwright::{Mapper, Settings, Visits};
use mapwright_sim::{Drive, DriveSettings, OdometryNoise, worlds};

/// Those of a loop of 150 m, with wheels that are so many times as bad as usual and, if so wished, with loops closed.
fn of_a_loop(wheels: f64, closes: bool) -> Visits {
    let mut settings = Settings::default();
    (settings.loops.by_pose, settings.loops.by_place) = (closes, closes);
    let odometry = OdometryNoise::default().times(wheels);
    let drive = DriveSettings { odometry, ..DriveSettings::long_drive(5) };
    let mut mapper = Mapper::new(settings).expect("valid");
    for scan in Drive::new(worlds::loop_of(5, 150.0).into(), drive).scans() {
        mapper.add_scan(&scan.scan);
    }
    let map = mapper.session().maps().remove(0);
    let visits = Visits::of_map(mapper.session(), &map, &settings);
    assert_eq!(visits, Visits::of_map(mapper.session(), &map, &settings), "the same again");
    visits
}

#[test]
fn visits_of_a_sound_map_agree_and_those_of_an_open_loop_do_not() {
    let (sound, open) = (of_a_loop(1.0, true), of_a_loop(8.0, false));
    assert!(sound.compared >= 10 && sound.misfits == 0 && sound.mean_m < 0.06, "{sound:?}");
    assert!(open.mean_m > 3.0 * sound.mean_m && open.mean_m > 0.1, "{open:?} beside {sound:?}");
}

#[test]
fn there_are_none_where_nothing_is_seen_twice() {
    let mapper = Mapper::new(Settings::default()).unwrap();
    let map = mapper.session().maps().remove(0);
    assert_eq!(Visits::of_map(mapper.session(), &map, &Settings::default()), Visits::default());
}
