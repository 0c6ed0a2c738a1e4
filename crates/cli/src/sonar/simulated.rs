//! The simulated office of `demo --sonar` and `suite sonar`.

use mapwright_sim::{DriveSettings, Event, OdometryNoise, Site, SonarSettings, TrueSonar, sonar_drive, worlds};
use std::sync::Arc;

/// Readings of the ring a second: sonars wait for their own sound, 16 of them in turns of four for some 0.05 s each.
const RATE_HZ: f64 = 5.0;

/// A floor of 40 by 20 m, and a drive through it.
pub(crate) struct SonarOffice {
    pub(crate) site: Arc<Site>,
    pub(crate) events: Box<dyn Iterator<Item = Event<TrueSonar>>>,
}

/// A robot with 16 sonars whose wheels err by 10 % of every metre and of every radian (sigma of that much way), by 3 % of all ways and
/// turns, and whose heading drifts as office robots' does.
pub(crate) fn sonar_office(seed: u64) -> SonarOffice {
    let site = Arc::new(worlds::small_office(seed));
    let odometry = OdometryNoise {
        alpha1: 0.01,
        alpha3: 0.01,
        scale_sigma: 0.03,
        turn_scale_sigma: 0.03,
        ..OdometryNoise::default()
    };
    let drive = DriveSettings { odometry, seed, scan_rate_hz: RATE_HZ, ..DriveSettings::default() };
    let events = Box::new(sonar_drive(Arc::clone(&site), drive, SonarSettings::default()));
    SonarOffice { site, events }
}
