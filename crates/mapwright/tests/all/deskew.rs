//! Undoing the motion during a sweep pays in fast turns.
#![allow(clippy::expect_used, clippy::print_stdout, reason = "a test may fail loudly and show what it measured")]

use crate::support::turns;

use turns::{Deskew, turning};

#[test]
fn undoing_the_sweeps_motion_pays_in_fast_turns() {
    let of = |deskew| turning(3.0, 0.1, 1, deskew).expect("defaults are valid");
    let [on, carried_on] = [Deskew::On, Deskew::CarriedOn].map(of);
    let [off, at_once] = [Deskew::Off, Deskew::NotNeeded].map(of);
    println!("as read {on:?}, carried on {carried_on:?}, not {off:?}, at once {at_once:?}");
    assert!(on.position_m < 0.25 * off.position_m && on.position_m < at_once.position_m + 0.005);
    assert!(on.heading_deg < 0.1 * off.heading_deg);
    assert!(on.heading_deg < 0.5 * carried_on.heading_deg && carried_on.heading_deg < 0.5 * off.heading_deg);
}

/// Wheels that slip in a turn shape the sweep wrongly; a gyroscope does not.
#[test]
fn a_gyroscope_says_how_the_robot_turned() {
    let of = |deskew| turning(3.0, 1.0, 1, deskew).expect("defaults are valid");
    let [wheels, gyroscope] = [Deskew::On, Deskew::Gyroscope].map(of);
    println!("by the wheels {wheels:?}, by a gyroscope {gyroscope:?}");
    assert!(gyroscope.heading_deg < 0.5 * wheels.heading_deg && gyroscope.position_m < 0.7 * wheels.position_m);
}
