//! Undoing the motion during a sweep pays in fast turns.
#![allow(clippy::expect_used, clippy::print_stdout, reason = "a test may fail loudly and show what it measured")]

#[path = "support/turns.rs"]
mod turns;

use turns::{Deskew, turning};

#[test]
fn undoing_the_sweeps_motion_pays_in_fast_turns() {
    let [on, off] = [Deskew::On, Deskew::Off].map(|deskew| turning(3.0, 0.1, 1, deskew).expect("defaults are valid"));
    println!("deskewed {on:?}, not {off:?}");
    assert!(on.position_m < 0.5 * off.position_m && on.position_m < 0.03);
    assert!(on.heading_deg < 0.5 * off.heading_deg && on.heading_deg < 0.5);
}
