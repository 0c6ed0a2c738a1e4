//! A CARMEN log that is read once: odometry that says nothing shows while it is read.

use crate::still::{Movement, Scenery};
use mapwright_formats::{CarmenReader, FormatError, LogEvent, ReadReport};
use mapwright_geom::{Pose, Pose2};
use mapwright_sensor::{LaserScan, Odometry, SonarReading};
use std::collections::VecDeque;
use std::io::Read;

/// So many scans are held back at most until odometry moves or what is seen changes; of one that does neither the robot stands.
const HELD_SCANS: usize = 1024;

/// What was read: a scan and a reading of the wheels lie in the buffers.
#[derive(Debug)]
pub(crate) enum Next {
    Scan,
    Odometry,
    Sonar(Box<SonarReading>),
}

/// What a line leads to.
#[derive(Debug)]
pub(crate) enum Held {
    Scan(Box<LaserScan>),
    Odometry(Odometry),
    Sonar(Box<SonarReading>),
}

/// Events of a CARMEN log, without odometry for as long as that never moved though what is seen has changed.
#[derive(Debug)]
pub(crate) struct CarmenEvents<R> {
    reader: CarmenReader<R>,
    held: VecDeque<Held>,
    held_scans: usize,
    /// The laser whose scans are compared.
    laser: Option<String>,
    movement: Movement,
    scenery: Scenery,
    is_end: bool,
    is_fake: bool,
}

impl<R: Read> CarmenEvents<R> {
    pub(crate) fn new(reader: CarmenReader<R>) -> Self {
        Self {
            reader,
            held: VecDeque::new(),
            held_scans: 0,
            laser: None,
            movement: Movement::default(),
            scenery: Scenery::default(),
            is_end: false,
            is_fake: false,
        }
    }

    /// The report, when reading is over.
    pub(crate) fn into_report(self) -> ReadReport {
        ReadReport { odometry_never_moved: self.is_fake && self.movement.stands_still(), ..self.reader.into_report() }
    }

    /// Puts the next event into one of the two, where it is of these.
    pub(crate) fn next(&mut self, scan: &mut LaserScan, odometry: &mut Odometry) -> Result<Option<Next>, FormatError> {
        while !self.movement.has_moved && !self.scenery.has_changed && !self.is_end && self.held_scans < HELD_SCANS {
            self.hold()?;
        }
        self.is_fake |= self.scenery.has_changed && self.movement.stands_still();
        loop {
            let next = match self.held.pop_front() {
                Some(Held::Scan(held)) => {
                    self.held_scans -= 1;
                    *scan = *held;
                    Next::Scan
                }
                Some(Held::Odometry(held)) => {
                    *odometry = held;
                    Next::Odometry
                }
                Some(Held::Sonar(held)) => {
                    self.held_scans -= 1;
                    Next::Sonar(held)
                }
                None => match self.read(scan, odometry)? {
                    Some(next) => next,
                    None => return Ok(None),
                },
            };
            let is_silent = self.scenery.has_changed && self.movement.stands_still();
            self.is_fake |= is_silent;
            match (is_silent, &next) {
                (true, Next::Scan) => scan.odom_from_robot = None,
                (true, Next::Odometry) => continue,
                (true, Next::Sonar(_)) | (false, _) => {}
            }
            return Ok(Some(next));
        }
    }

    /// Reads one more event behind those that are held.
    fn hold(&mut self) -> Result<(), FormatError> {
        let held = match self.reader.next_event()? {
            None => {
                self.is_end = true;
                return Ok(());
            }
            Some(LogEvent::Scan(scan)) => Held::Scan(Box::new(scan.clone())),
            Some(LogEvent::Odometry(odometry)) => Held::Odometry(*odometry),
            Some(LogEvent::Sonar(reading)) => Held::Sonar(Box::new(reading.clone())),
            Some(_) => return Ok(()),
        };
        match &held {
            Held::Scan(scan) => {
                self.held_scans += 1;
                see(&mut self.movement, scan.odom_from_robot);
                if *self.laser.get_or_insert_with(|| scan.laser.name.clone()) == scan.laser.name {
                    self.scenery.see(scan.ranges_m.iter().copied());
                }
            }
            Held::Odometry(odometry) => see(&mut self.movement, Some(odometry.odom_from_robot)),
            Held::Sonar(_) => self.held_scans += 1,
        }
        self.held.push_back(held);
        Ok(())
    }

    /// Reads one event when none is held.
    fn read(&mut self, scan: &mut LaserScan, odometry: &mut Odometry) -> Result<Option<Next>, FormatError> {
        loop {
            match self.reader.next_event()? {
                None => return Ok(None),
                Some(LogEvent::Scan(next)) => {
                    scan.stamp = next.stamp;
                    scan.laser.clone_from(&next.laser);
                    scan.ranges_m.clone_from(&next.ranges_m);
                    scan.odom_from_robot = next.odom_from_robot;
                    see(&mut self.movement, scan.odom_from_robot);
                    if self.laser.as_ref() == Some(&scan.laser.name) {
                        self.scenery.see(scan.ranges_m.iter().copied());
                    }
                    return Ok(Some(Next::Scan));
                }
                Some(LogEvent::Odometry(next)) => {
                    *odometry = *next;
                    see(&mut self.movement, Some(odometry.odom_from_robot));
                    return Ok(Some(Next::Odometry));
                }
                Some(LogEvent::Sonar(reading)) => return Ok(Some(Next::Sonar(Box::new(reading.clone())))),
                Some(_) => {}
            }
        }
    }
}

/// A log without odometry has none that could stand still.
fn see(movement: &mut Movement, odom_from_robot: Option<Pose2>) {
    movement.see(|| odom_from_robot.map(|pose| pose.in_space()));
}
