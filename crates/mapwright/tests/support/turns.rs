//! Fast turns with a laser that needs most of its period for a sweep: mapped with the sweep's motion undone, and without.

use mapwright::{LaserScan, Mapper, Pose2, Settings, SettingsError};
use mapwright_eval::{Alignment, EvalError, PosePair, ate_of_pairs};
use mapwright_sim::{Drive, DriveSettings, Event, Incident, LaserSettings, OdometryNoise, RobotSettings, worlds};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Beams of a full turn, and how long they take: all but a tenth of the time between two scans.
const BEAMS: usize = 360;
const SWEEP_S: f64 = 0.09;
/// A turn on the spot begins every so many seconds.
const EVERY_S: f64 = 8.0;
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
    /// The motion during the sweep is undone, as the wheels were read during it: a scan is there when its sweep is over.
    On,
    /// The same, but scans are there at their first beam, and the motion before them is carried on.
    CarriedOn,
    /// The mapper is told that all beams were taken at once.
    Off,
    /// All beams were taken at once: what there is to gain.
    NotNeeded,
}

/// Drives through an office with whole turns at `rad_per_s`, alternately to either side, and maps it. The wheels' noise
/// is the simulator's times `wheels`.
pub(crate) fn turning(rad_per_s: f64, wheels: f64, seed: u64, deskew: Deskew) -> Result<Errors, SettingsError> {
    let events = drive(rad_per_s, wheels, seed, deskew != Deskew::NotNeeded, deskew == Deskew::On);
    let mut mapper = Mapper::new(Settings::default())?;
    let at_once = |scan: &LaserScan| LaserScan {
        laser: Arc::new(mapwright::LaserModel { beam_period_s: 0.0, ..(*scan.laser).clone() }),
        ..scan.clone()
    };
    let mut truth = Vec::new();
    for event in &events {
        match event {
            Event::Odometry(odometry) => mapper.add_odometry(odometry),
            Event::Scan(taken) => {
                let scan = if deskew == Deskew::Off { at_once(&taken.scan) } else { taken.scan.clone() };
                mapper.add_scan(&scan);
                truth.push(taken.world_from_robot);
            }
        }
    }
    Ok(errors(&mapper, truth).unwrap_or(Errors { position_m: f64::NAN, heading_deg: f64::NAN }))
}

/// The drive's events in the order of their stamps, or as they arrive.
fn drive(rad_per_s: f64, wheels: f64, seed: u64, sweeps: bool, as_they_arrive: bool) -> Vec<Event> {
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
        odometry: OdometryNoise::default().times(wheels),
        odometry_rate_hz: 50.0,
        seed,
        ..DriveSettings::default()
    };
    let mut events: Vec<Event> = Drive::new(worlds::office_floor(seed).into(), settings).collect();
    if as_they_arrive {
        events.sort_by_key(|event| match event {
            Event::Odometry(odometry) => odometry.stamp.0,
            Event::Scan(taken) => taken.scan.stamp.0 + (SWEEP_S * 1e9) as i64,
        });
    }
    events
}

fn errors(mapper: &Mapper, truth: Vec<Pose2>) -> Result<Errors, EvalError> {
    let pair = |(pose, world_from_robot): (mapwright::TrajectoryPose, Pose2)| PosePair {
        stamp: pose.stamp,
        world_from_robot,
        map_from_robot: pose.map_from_robot,
    };
    let pairs: Vec<PosePair> = mapper.trajectory().zip(truth).map(pair).collect();
    let ate = ate_of_pairs(&pairs, Alignment::Rigid)?;
    Ok(Errors { position_m: ate.translation_m.rmse, heading_deg: ate.rotation_deg.rmse })
}
