//! Fast turns with a laser that needs most of its period for a sweep: mapped with the sweep's motion undone, and without.

use mapwright::{LaserScan, Mapper, Pose2, Settings, SettingsError, Stamp, TurnRate};
use mapwright_eval::{Alignment, EvalError, PosePair, ate_of_pairs};
use mapwright_sim::{Drive, DriveSettings, Event, Incident, LaserSettings, OdometryNoise, RobotSettings, worlds};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Beams of a full turn, and how long they take: all but a tenth of the time between two scans.
const BEAMS: usize = 360;
const SWEEP_S: f64 = 0.09;
/// A gyroscope's noise and its bias, radians a second.
const GYROSCOPE_SIGMA: f64 = 0.01;
const GYROSCOPE_BIAS: f64 = 0.01;
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
    /// The same, and a gyroscope was read as often as the wheels.
    Gyroscope,
    /// As [`Deskew::On`], but scans are there at their first beam, and the motion before them is carried on.
    CarriedOn,
    /// The mapper is told that all beams were taken at once.
    Off,
    /// All beams were taken at once: what there is to gain.
    NotNeeded,
}

/// Drives through an office with whole turns at `rad_per_s`, alternately to either side, and maps it. The wheels' noise
/// is the simulator's times `wheels`.
pub(crate) fn turning(rad_per_s: f64, wheels: f64, seed: u64, deskew: Deskew) -> Result<Errors, SettingsError> {
    let as_they_arrive = matches!(deskew, Deskew::On | Deskew::Gyroscope);
    let events = drive(rad_per_s, wheels, seed, deskew != Deskew::NotNeeded, as_they_arrive);
    let gyroscope = if deskew == Deskew::Gyroscope { turn_rates(rad_per_s, seed) } else { Vec::new() };
    let mut gyroscope = gyroscope.iter().peekable();
    let mut mapper = Mapper::new(Settings::default())?;
    let at_once = |scan: &LaserScan| LaserScan {
        laser: Arc::new(mapwright::LaserModel { beam_period_s: 0.0, ..(*scan.laser).clone() }),
        ..scan.clone()
    };
    let mut truth = Vec::new();
    for event in &events {
        while let Some(rate) = gyroscope.next_if(|rate| rate.stamp.0 <= arrival_ns(event)) {
            mapper.add_turn_rate(rate);
        }
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
        events.sort_by_key(arrival_ns);
    }
    events
}

fn arrival_ns(event: &Event) -> i64 {
    match event {
        Event::Odometry(odometry) => odometry.stamp.0,
        Event::Scan(taken) => taken.scan.stamp.0 + (SWEEP_S * 1e9) as i64,
    }
}

/// What a gyroscope reads on the drive: by wheels that do not err, halfway between their readings.
fn turn_rates(rad_per_s: f64, seed: u64) -> Vec<TurnRate> {
    let wheels: Vec<_> = drive(rad_per_s, 0.0, seed, true, true)
        .into_iter()
        .filter_map(|event| if let Event::Odometry(odometry) = event { Some(odometry) } else { None })
        .collect();
    let rate = |(k, pair): (usize, &[mapwright::Odometry])| {
        let elapsed_s = pair[1].stamp.secs_since(pair[0].stamp);
        let turned_rad = pair[0].odom_from_robot.between(pair[1].odom_from_robot).theta;
        // as good as noise for what is summed over a few readings
        let noise = GYROSCOPE_SIGMA * std::f64::consts::SQRT_2 * (k as f64 * 2.399_963).sin();
        let stamp = Stamp(pair[0].stamp.0.midpoint(pair[1].stamp.0));
        TurnRate { stamp, rad_per_s: turned_rad / elapsed_s + GYROSCOPE_BIAS + noise }
    };
    wheels.windows(2).enumerate().map(rate).collect()
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
