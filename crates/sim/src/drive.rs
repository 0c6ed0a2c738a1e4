//! A drive: the stream of readings a robot records on its way, with the truth beside it.

use crate::laser::{LaserSettings, Scanner};
use crate::odometry::{OdometryNoise, Wheels};
use crate::rng::Rng;
use crate::robot::{Incident, Robot, RobotSettings, Step, TICK_NS, TICK_S, interpolate, legs};
use crate::route::Site;
use mapwright_geom::{Pose2, Stamp};
use mapwright_sensor::{LaserScan, Odometry};
use std::collections::VecDeque;
use std::sync::Arc;

/// Everything about a drive except where it leads.
#[derive(Debug, Clone, PartialEq)]
pub struct DriveSettings {
    /// How the robot moves.
    pub robot: RobotSettings,
    /// What its wheels get wrong.
    pub odometry: OdometryNoise,
    /// Its laser.
    pub laser: LaserSettings,
    /// Scans a second; kept within 0.1 to 1000.
    pub scan_rate_hz: f64,
    /// Odometry readings a second; kept within 0.1 to 1000.
    pub odometry_rate_hz: f64,
    /// What goes wrong on the way.
    pub incidents: Vec<Incident>,
    /// Number of the waypoint to start at.
    pub start_waypoint: usize,
    /// The drive ends then, seconds, or with its route.
    pub duration_s: f64,
    /// Seed of the noise of wheels and laser.
    pub seed: u64,
}

impl DriveSettings {
    /// The default robot on a long drive: 180 beams of 30 m with sigma 0.02 m; wheels with heading bias that slip too.
    #[must_use]
    pub fn long_drive(seed: u64) -> Self {
        let laser = LaserSettings { range_sigma_m: 0.02, ..LaserSettings::default() };
        Self { laser, odometry: OdometryNoise::default().with_slips(), seed, ..Self::default() }
    }
}

impl Default for DriveSettings {
    fn default() -> Self {
        Self {
            robot: RobotSettings::default(),
            odometry: OdometryNoise::default(),
            laser: LaserSettings::default(),
            scan_rate_hz: 10.0,
            odometry_rate_hz: 20.0,
            incidents: Vec::new(),
            start_waypoint: 0,
            duration_s: f64::INFINITY,
            seed: 0,
        }
    }
}

/// A scan and where it was really taken.
#[derive(Debug, Clone, PartialEq)]
pub struct TrueScan {
    /// The scan.
    pub scan: LaserScan,
    /// True pose of the robot at the scan's stamp.
    pub world_from_robot: Pose2,
}

/// What a robot records; of a real one the scans come without the truth.
#[derive(Debug, Clone, PartialEq)]
pub enum Event<S = TrueScan> {
    /// The wheels were read.
    Odometry(Odometry),
    /// The laser swept.
    Scan(S),
}

/// A drive through a site as an iterator over what is recorded, in order of stamps; odometry first at equal stamps.
///
/// Stamps begin at zero. The simulation steps at 50 Hz inside, whatever the rates, so that the same seed gives the
/// same path and the same drift at every scan rate. Nothing is kept, so a drive may be as long as it likes.
#[derive(Debug, Clone)]
pub struct Drive {
    site: Arc<Site>,
    settings: DriveSettings,
    scanner: Scanner,
    past: Ticks,
    scans_due: u64,
    odometry_due: u64,
}

impl Drive {
    /// A robot at the start of its way. A route without a leg gives a drive without events.
    #[must_use]
    pub fn new(site: Arc<Site>, mut settings: DriveSettings) -> Self {
        settings.scan_rate_hz = settings.scan_rate_hz.clamp(0.1, 1000.0);
        settings.odometry_rate_hz = settings.odometry_rate_hz.clamp(0.1, 1000.0);
        let scanner = Scanner::new(settings.laser.clone());
        let past = Ticks::new(&site, &settings);
        Self { site, settings, scanner, past, scans_due: 0, odometry_due: 0 }
    }

    /// The same with its laser there.
    #[must_use]
    pub fn with_mount(mut self, robot_from_laser: Pose2) -> Self {
        Arc::make_mut(&mut self.settings.laser.model).robot_from_laser = robot_from_laser;
        self.scanner = Scanner::new(self.settings.laser.clone());
        self
    }

    /// The scans alone.
    pub fn scans(self) -> impl Iterator<Item = TrueScan> {
        self.filter_map(|event| match event {
            Event::Scan(scan) => Some(scan),
            Event::Odometry(_) => None,
        })
    }

    /// At most so many scans, each with its true `world_from_robot`.
    #[must_use]
    pub fn log(self, at_most: usize) -> Vec<(LaserScan, Pose2)> {
        self.scans().take(at_most).map(|s| (s.scan, s.world_from_robot)).collect()
    }

    fn read_odometry(&mut self, stamp_ns: i64) -> Option<Event> {
        let odom_from_robot = self.past.at(&self.site, &self.settings, stamp_ns)?.odom_from_robot;
        Some(Event::Odometry(Odometry { stamp: Stamp(stamp_ns), odom_from_robot }))
    }

    fn read_laser(&mut self, stamp_ns: i64, index: u64) -> Option<Event> {
        let sweep_ns = (self.scanner.sweep_s() * 1e9) as i64;
        self.past.at(&self.site, &self.settings, stamp_ns + sweep_ns)?;
        let here = self.past.at(&self.site, &self.settings, stamp_ns)?;
        let ranges_m = self.sweep(stamp_ns, here.world_from_robot, index);
        let laser = self.scanner.model().clone();
        let odom_from_robot = Some(here.odom_from_robot);
        let scan = LaserScan { stamp: Stamp(stamp_ns), laser, ranges_m, odom_from_robot };
        Some(Event::Scan(TrueScan { scan, world_from_robot: here.world_from_robot }))
    }

    fn sweep(&self, stamp_ns: i64, world_from_robot: Pose2, index: u64) -> Vec<f32> {
        let time_s = stamp_ns as f64 * 1e-9;
        let world_from_laser = self.scanner.world_from_laser(world_from_robot);
        let viewpoint = [world_from_laser.x, world_from_laser.y];
        let mut moment = self.site.world.at(time_s, viewpoint, self.scanner.model().range_max_m);
        for incident in &self.settings.incidents {
            if let &Incident::Blocked { from_s, to_s, bearing_rad, distance_m, radius_m } = incident
                && from_s <= time_s
                && time_s < to_s
            {
                moment = moment.with_person(self.scanner.person(world_from_laser, bearing_rad, distance_m, radius_m));
            }
            for leg in legs(incident, world_from_robot, time_s).into_iter().flatten() {
                moment = moment.with_person(leg);
            }
        }
        let mut rng = Rng::keyed(self.settings.seed ^ 0x006c_6173_6572, index);
        if self.settings.incidents.iter().any(|incident| incident.carries(time_s) == Some(true)) {
            return self.scanner.covered(&mut rng);
        }
        let world_from_robot_at = |after_s: f64| {
            let at_ns = stamp_ns + (after_s * 1e9) as i64;
            self.past.look_up(at_ns).map_or(world_from_robot, |here| here.world_from_robot)
        };
        self.scanner.sweep(&moment, world_from_robot_at, &mut rng)
    }

    /// Whether it is a scan that is not taken because the robot is being carried.
    fn unseen(&self, event: &Event) -> bool {
        let Event::Scan(scan) = event else {
            return false;
        };
        let time_s = scan.scan.stamp.as_secs_f64();
        self.settings.incidents.iter().any(|incident| incident.carries(time_s) == Some(false))
    }

    fn in_outage(&self, stamp_ns: i64) -> bool {
        let time_s = stamp_ns as f64 * 1e-9;
        self.settings.incidents.iter().any(
            |incident| matches!(*incident, Incident::Outage { from_s, to_s, .. } if from_s <= time_s && time_s < to_s),
        )
    }
}

impl Iterator for Drive {
    type Item = Event;

    fn next(&mut self) -> Option<Event> {
        loop {
            let scan_ns = stamp_ns(self.scans_due, self.settings.scan_rate_hz);
            let odometry_ns = stamp_ns(self.odometry_due, self.settings.odometry_rate_hz);
            self.past.forget_before(scan_ns.min(odometry_ns));
            let event = if odometry_ns <= scan_ns {
                self.odometry_due += 1;
                self.read_odometry(odometry_ns)?
            } else {
                self.scans_due += 1;
                self.read_laser(scan_ns, self.scans_due - 1)?
            };
            if !self.in_outage(scan_ns.min(odometry_ns)) && !self.unseen(&event) {
                return Some(event);
            }
        }
    }
}

/// When reading number `index` is due, nanoseconds.
pub(crate) fn stamp_ns(index: u64, rate_hz: f64) -> i64 {
    (index as f64 * 1e9 / rate_hz).round() as i64
}

/// The robot's two poses at one time.
#[derive(Debug, Clone, Copy)]
struct Whereabouts {
    world_from_robot: Pose2,
    odom_from_robot: Pose2,
}

/// The recent past, simulated on demand: as many ticks as the readings still to come may ask about.
#[derive(Debug, Clone)]
struct Ticks {
    robot: Option<Robot>,
    wheels: Wheels,
    /// Number of the first tick kept.
    first: i64,
    /// Each tick with odometry's pose at its start and end.
    kept: VecDeque<(Step, Pose2, Pose2)>,
}

impl Ticks {
    fn new(site: &Site, settings: &DriveSettings) -> Self {
        let robot = Robot::new(&site.route, settings.start_waypoint, settings.robot.clone());
        let wheels = Wheels::new(settings.odometry.clone(), settings.seed);
        Self { robot, wheels, first: 0, kept: VecDeque::new() }
    }

    /// Where the robot is then, driving on as far as needed; `None` beyond the end of the drive.
    fn at(&mut self, site: &Site, settings: &DriveSettings, at_ns: i64) -> Option<Whereabouts> {
        while self.first + self.kept.len() as i64 <= at_ns / TICK_NS {
            self.simulate_tick(site, settings)?;
        }
        self.look_up(at_ns)
    }

    fn look_up(&self, at_ns: i64) -> Option<Whereabouts> {
        let (step, before, after) = self.kept.get(usize::try_from(at_ns / TICK_NS - self.first).ok()?)?;
        let share = (at_ns % TICK_NS) as f64 / TICK_NS as f64;
        let odom_from_robot = interpolate(*before, *after, share);
        Some(Whereabouts { world_from_robot: step.world_from_robot_at(share), odom_from_robot })
    }

    fn simulate_tick(&mut self, site: &Site, settings: &DriveSettings) -> Option<()> {
        let time_s = (self.first + self.kept.len() as i64) as f64 * TICK_S;
        if time_s > settings.duration_s {
            return None;
        }
        let step = self.robot.as_mut()?.step(&site.route, &settings.incidents, time_s)?;
        let before = self.wheels.odom_from_robot();
        if !odometry_lost(&settings.incidents, time_s) {
            self.wheels.count(step.wheel_move);
        }
        self.kept.push_back((step, before, self.wheels.odom_from_robot()));
        Some(())
    }

    fn forget_before(&mut self, needed_ns: i64) {
        while self.first < needed_ns / TICK_NS && self.kept.pop_front().is_some() {
            self.first += 1;
        }
    }
}

fn odometry_lost(incidents: &[Incident], time_s: f64) -> bool {
    incidents.iter().any(|incident| {
        matches!(*incident, Incident::Outage { from_s, to_s, odometry_lost: true } if from_s <= time_s && time_s < to_s)
    })
}
