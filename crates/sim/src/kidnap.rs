//! Drives in which the robot is carried away.

use crate::drive::{Drive, DriveSettings};
use crate::math::distance;
use crate::rng::Rng;
use crate::robot::Incident;
use crate::route::{Route, Site};
use crate::views::{first_on_ground_of, true_path};
use crate::worlds::loop_of;
use mapwright_geom::Stamp;
use std::sync::Arc;

/// A drive around a loop in which the robot is lifted up, carried elsewhere and put down, and drives on from there;
/// odometry reports nothing of it.
#[derive(Debug, Clone)]
pub struct Kidnapping {
    /// Where.
    pub site: Arc<Site>,
    /// The drive.
    pub settings: DriveSettings,
    /// When it is lifted up. From here until it is put down there are no scans, or the laser is covered.
    pub taken: Stamp,
    /// When it is put down.
    pub put_down: Stamp,
    /// Whether it is put down on ground that it has seen before; otherwise it comes back there later by itself.
    pub known_ground: bool,
    /// The first time, once it is put down, at which more than half of what it sees was seen from one place before it was
    /// taken, to 0.2 s; `None` where that never happens. Through a door that may be a matter of an instant.
    pub glimpse: Option<Stamp>,
    /// When it comes to known ground: the first such time from which on that is so for at least half of the next [`STAY_S`]
    /// seconds.
    pub home: Option<Stamp>,
}

/// Who has come to known ground is there for at least half of so long, seconds.
pub const STAY_S: f64 = 10.0;

impl Kidnapping {
    /// The recording, with its truth.
    #[must_use]
    pub fn drive(&self) -> Drive {
        Drive::new(Arc::clone(&self.site), self.settings.clone())
    }
}

/// The kidnapping of a seed: on to known ground for even seeds, to unknown ground for odd ones; with the laser covered
/// on the way or without scans, and for 5 to 15 s.
#[must_use]
pub fn kidnapping(seed: u64) -> Kidnapping {
    let mut rng = Rng::keyed(seed, 0x6b69_646e_6170);
    let site = Arc::new(loop_of(rng.next_u64(), rng.uniform(120.0, 220.0)));
    let known_ground = seed.is_multiple_of(2);
    let undisturbed = DriveSettings::long_drive(rng.next_u64());
    let drive_s = true_path(&site, &undisturbed).len() as f64;
    let (taken, put_down) = if known_ground { ([0.6, 0.85], [0.1, 0.4]) } else { ([0.2, 0.35], [0.55, 0.75]) };
    let from_s = (drive_s * rng.uniform(taken[0], taken[1])).round();
    let to_s = from_s + rng.uniform(5.0, 15.0).round();
    let waypoint = waypoint_at(&site.route, rng.uniform(put_down[0], put_down[1]));
    let incidents = vec![Incident::Carried { from_s, to_s, waypoint, blocked: rng.chance(0.5) }];
    let settings = DriveSettings { incidents, ..undisturbed };
    let (taken, put_down) = (Stamp::from_secs_f64(from_s), Stamp::from_secs_f64(to_s));
    let [glimpse, home] = first_on_ground_of(&site, &settings, taken, put_down, STAY_S);
    Kidnapping { site, settings, taken, put_down, known_ground, glimpse, home }
}

/// The waypoint nearest to this share of the way.
fn waypoint_at(route: &Route, share: f64) -> usize {
    let wanted_m = share * route.length_m();
    let (mut along_m, mut best) = (0.0, (f64::INFINITY, 0));
    for (k, leg) in route.waypoints.windows(2).enumerate() {
        if (along_m - wanted_m).abs() < best.0 {
            best = ((along_m - wanted_m).abs(), k);
        }
        along_m += distance(leg[0], leg[1]);
    }
    best.1
}
