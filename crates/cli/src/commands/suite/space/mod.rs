//! `mapwright suite ... --3d`: worlds in space.

mod closing;
mod honesty;
mod runs;
mod verdicts;

pub(super) use closing::{LookAlikes, Loops};
pub(super) use honesty::Honesty;
pub(super) use runs::{Cut, Localise};
pub(super) use verdicts::Verdicts;

use crate::args::LidarArgs;
use mapwright::Settings;
use mapwright_sim::space::{LidarSettings, SpaceDrive, SpaceDriveSettings, SpaceSite, worlds};

/// Every so many-th cloud is mapped, of 10 a second.
const EVERY: usize = 2;
/// Directions in which the beams are taken a turn: as many as the slowest of today's lidars have.
const COLUMNS: usize = 512;

/// A kind of world: its name, and the world of a seed.
type Kind = (&'static str, fn(u64) -> SpaceSite);

/// Worlds by turns.
const WORLDS: [Kind; 4] = [
    ("two storeys", worlds::two_storey),
    ("courtyard", worlds::courtyard),
    ("look-alike storeys", worlds::look_alike_storeys),
    ("loops", worlds::loops_1km),
];

/// How worlds are driven through, and mapped.
pub(super) struct Drives {
    beams: usize,
    duration_s: f64,
    settings: Settings,
}

impl Drives {
    pub(super) fn new(args: &LidarArgs, settings: Settings) -> Self {
        let duration_s = args.seconds.unwrap_or(f64::INFINITY);
        Self { beams: args.beams as usize, duration_s, settings }
    }

    fn drive(&self, site: SpaceSite, seed: u64) -> SpaceDrive {
        let lidar = LidarSettings { columns: COLUMNS, ..LidarSettings::spinning(self.beams) };
        let duration_s = self.duration_s;
        SpaceDrive::new(site.into(), SpaceDriveSettings { lidar, seed, duration_s, ..SpaceDriveSettings::default() })
    }
}
