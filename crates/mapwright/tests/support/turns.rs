//! Fast turns with a laser that needs most of its period for a sweep: mapped with the sweep's motion undone, and without.

use mapwright::{LaserScan, Mapper, Pose2, Settings, SettingsError};
use mapwright_eval::{Alignment, EvalError, PosePair, ate_of_pairs};
use mapwright_sim::{Drive, DriveSettings, Incident, LaserSettings, RobotSettings, TrueScan, worlds};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Beams of a full turn, and how long they take: all but a tenth of the time between two scans.
const BEAMS: usize = 360;
const SWEEP_S: f64 = 0.09;
/// A turn on the spot begins every so many seconds.
const EVERY_S: f64 = 6.0;
const DURATION_S: f64 = 60.0;

/// What a map's poses are wrong by.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Errors {
    /// Root mean square after rigid alignment, metres.
    pub(crate) position_m: f64,
    /// The same of headings, degrees.
    pub(crate) heading_deg: f64,
}

/// How a drive is mapped.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Deskew {
    /// The motion during the sweep is undone.
    On,
    /// The mapper is told that all beams were taken at once.
    Off,
    /// All beams were taken at once: what there is to gain.
    NotNeeded,
}

/// Drives through an office with whole turns at `rad_per_s`, alternately to either side, and maps it.
pub(crate) fn turning(rad_per_s: f64, seed: u64, deskew: Deskew) -> Result<Errors, SettingsError> {
    let scans = drive(rad_per_s, seed, deskew != Deskew::NotNeeded);
    let mut mapper = Mapper::new(Settings::default())?;
    let at_once = |scan: &LaserScan| LaserScan {
        laser: Arc::new(mapwright::LaserModel { beam_period_s: 0.0, ..(*scan.laser).clone() }),
        ..scan.clone()
    };
    for taken in &scans {
        match deskew {
            Deskew::Off => mapper.add_scan(&at_once(&taken.scan)),
            Deskew::On | Deskew::NotNeeded => mapper.add_scan(&taken.scan),
        };
    }
    let truth = scans.iter().map(|taken| taken.world_from_robot);
    Ok(errors(&mapper, truth).unwrap_or(Errors { position_m: f64::NAN, heading_deg: f64::NAN }))
}

fn drive(rad_per_s: f64, seed: u64, sweeps: bool) -> Vec<TrueScan> {
    let mut laser = LaserSettings::with_field_of_view(TAU, BEAMS);
    if sweeps {
        Arc::make_mut(&mut laser.model).beam_period_s = SWEEP_S / BEAMS as f64;
    }
    let robot = RobotSettings {
        speed_m_per_s: 1.0,
        turn_rate_rad_per_s: rad_per_s,
        turn_acceleration_rad_per_s2: 4.0 * rad_per_s,
        ..RobotSettings::default()
    };
    let turns = (1..(DURATION_S / EVERY_S) as u32).map(|turn| Incident::Turn {
        from_s: EVERY_S * f64::from(turn),
        duration_s: TAU / rad_per_s,
        angle_rad: if turn % 2 == 0 { TAU } else { -TAU },
        odometry_share: 1.0,
    });
    let settings = DriveSettings {
        robot,
        laser,
        incidents: turns.collect(),
        duration_s: DURATION_S,
        odometry_rate_hz: 50.0,
        seed,
        ..DriveSettings::default()
    };
    Drive::new(worlds::office_floor(seed).into(), settings).scans().collect()
}

fn errors(mapper: &Mapper, truth: impl Iterator<Item = Pose2>) -> Result<Errors, EvalError> {
    let pair = |(pose, world_from_robot): (mapwright::TrajectoryPose, Pose2)| PosePair {
        stamp: pose.stamp,
        world_from_robot,
        map_from_robot: pose.map_from_robot,
    };
    let pairs: Vec<PosePair> = mapper.trajectory().zip(truth).map(pair).collect();
    let ate = ate_of_pairs(&pairs, Alignment::Rigid)?;
    Ok(Errors { position_m: ate.translation_m.rmse, heading_deg: ate.rotation_deg.rmse })
}
