//! People who walk along with the robot and in its way.
#![allow(clippy::expect_used, clippy::print_stdout, reason = "a test may fail loudly and show what it measured")]

use crate::support;

use mapwright::{Mapper, Settings};
use mapwright_sim::{Drive, DriveSettings, worlds};
use support::{ate_m, in_parallel};

/// Error over an office floor with six people, and beams that ended on something that moves.
fn office(seed: u64, drop_moving: bool) -> (f64, u32) {
    let mut settings = Settings::default();
    settings.scan.drop_moving = drop_moving;
    let mut mapper = Mapper::new(settings).expect("valid settings");
    let site = worlds::office_floor(seed).with_people(6, seed);
    let drive = Drive::new(site.into(), DriveSettings { seed, ..DriveSettings::default() });
    let (mut truth, mut moving) = (Vec::new(), 0);
    for recorded in drive.scans() {
        moving += mapper.add_scan(&recorded.scan).beams.moving;
        truth.push(recorded.world_from_robot);
    }
    (ate_m(&mapper, &truth), moving)
}

#[test]
fn people_do_not_hold_the_robot_back() {
    let seeds = [32, 41, 45, 57];
    let [dropped, kept] = [true, false].map(|drop| in_parallel(seeds.len(), |k| office(seeds[k], drop)));
    println!("dropped {dropped:?}\nkept    {kept:?}");
    assert!(dropped.iter().all(|&(ate_m, moving)| ate_m < 0.05 && moving > 1000), "{dropped:?}");
    assert!(kept.iter().all(|&(_, moving)| moving == 0), "{kept:?}");
    assert!(kept.iter().any(|&(ate_m, _)| ate_m > 0.5), "{kept:?}: without people in the way the test says nothing");
}
