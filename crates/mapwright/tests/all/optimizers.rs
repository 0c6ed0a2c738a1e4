//! Every optimiser that can be chosen maps a drive.
#![allow(clippy::expect_used, clippy::print_stdout, reason = "a test may fail loudly and show what it measured")]

use crate::support;

use mapwright::{Mapper, Settings};
use mapwright_sim::{DriveSettings, worlds};
use support::{ate_m, recording};

#[test]
fn every_optimizer_maps_a_drive() {
    let recorded = recording(worlds::rooms(4), DriveSettings { seed: 4, duration_s: 30.0, ..DriveSettings::default() });
    let truth: Vec<_> = recorded.iter().map(|scan| scan.world_from_robot).collect();
    for name in ["gauss-newton", "gradient-ascent", "unscaled-gradient-ascent"] {
        let mut settings = Settings::default();
        settings.set("matching.optimizer", name).expect("an optimiser");
        let mut mapper = Mapper::new(settings).expect("valid");
        for taken in &recorded {
            mapper.add_scan(&taken.scan);
        }
        let ate_m = ate_m(&mapper, &truth);
        println!("{name}: {ate_m:.4} m");
        assert!(ate_m < 0.03, "{name}: {ate_m} m");
    }
}
