//! A log's events as CARMEN has them.

use crate::error::ExportError;
use mapwright_formats::CarmenWriter;
use mapwright_sensor::{LaserModel, LaserScan, Odometry, SonarReading};
use std::borrow::Cow;
use std::collections::VecDeque;
use std::io::Write;
use std::sync::Arc;

/// Headings that went through a quaternion differ by no more, radians.
const SAME_RAD: f64 = 1e-12;

/// Readings that are held back at most until the next scan.
const HELD_BACK: usize = 1024;
/// Scans whose odometry is remembered.
const CARRIED: usize = 64;

/// Writes events, the wheels' readings with the next scan: one that a scan carries itself is left out.
#[derive(Debug)]
pub(crate) struct CarmenEvents<W> {
    writer: CarmenWriter<W>,
    conventional: Conventional,
    pending: VecDeque<Odometry>,
    /// What the last scans carried: where stamps step backwards a reading may come later.
    carried: VecDeque<Odometry>,
}

impl<W: Write> CarmenEvents<W> {
    pub(crate) fn new(writer: W) -> Self {
        let writer = CarmenWriter::new(writer);
        Self { writer, conventional: Conventional::default(), pending: VecDeque::new(), carried: VecDeque::new() }
    }

    pub(crate) fn scan(&mut self, scan: &LaserScan) -> Result<(), ExportError> {
        let carried = |odom_from_robot| Odometry { stamp: scan.stamp, odom_from_robot };
        self.carried.extend(scan.odom_from_robot.map(carried));
        if self.carried.len() > CARRIED {
            self.carried.pop_front();
        }
        while let Some(odometry) = self.pending.pop_front() {
            if !self.is_carried(&odometry) {
                self.writer.odometry(&odometry)?;
            }
        }
        Ok(self.writer.scan(&self.conventional.scan(scan))?)
    }

    pub(crate) fn odometry(&mut self, odometry: &Odometry) -> Result<(), ExportError> {
        if self.is_carried(odometry) {
            return Ok(());
        }
        self.pending.push_back(*odometry);
        let oldest = if self.pending.len() > HELD_BACK { self.pending.pop_front() } else { None };
        oldest.map_or(Ok(()), |odometry| Ok(self.writer.odometry(&odometry)?))
    }

    /// Behind the wheels' readings that came before.
    pub(crate) fn sonar(&mut self, reading: &SonarReading) -> Result<(), ExportError> {
        while let Some(odometry) = self.pending.pop_front() {
            if !self.is_carried(&odometry) {
                self.writer.odometry(&odometry)?;
            }
        }
        Ok(self.writer.sonar(reading)?)
    }

    pub(crate) fn finish(mut self) -> Result<W, ExportError> {
        self.pending.iter().try_for_each(|odometry| self.writer.odometry(odometry))?;
        Ok(self.writer.finish()?)
    }

    fn is_carried(&self, odometry: &Odometry) -> bool {
        self.carried.iter().any(|carried| {
            let off = carried.odom_from_robot.between(odometry.odom_from_robot);
            carried.stamp == odometry.stamp && (off.x, off.y) == (0.0, 0.0) && off.theta.abs() <= SAME_RAD
        })
    }
}

/// Numbers of a laser that came through single precision as they were before: angles by CARMEN's convention where they
/// are those to that precision, limits and times as the shortest decimals.
#[derive(Debug, Default)]
pub(crate) struct Conventional {
    /// The last laser, its beams, and what became of it.
    last: Option<(Arc<LaserModel>, usize, Arc<LaserModel>)>,
}

impl Conventional {
    pub(crate) fn scan<'a>(&mut self, scan: &'a LaserScan) -> Cow<'a, LaserScan> {
        let beams = scan.ranges_m.len();
        let known = self.last.as_ref().filter(|(of, n, _)| *n == beams && Arc::ptr_eq(of, &scan.laser));
        let laser = match known {
            Some((_, _, laser)) => Arc::clone(laser),
            None => {
                let laser = conventional(&scan.laser, beams).map_or_else(|| Arc::clone(&scan.laser), Arc::new);
                self.last = Some((Arc::clone(&scan.laser), beams, Arc::clone(&laser)));
                laser
            }
        };
        if Arc::ptr_eq(&laser, &scan.laser) {
            Cow::Borrowed(scan)
        } else {
            Cow::Owned(LaserScan { laser, ..scan.clone() })
        }
    }
}

/// The laser as it was before single precision; none where that says nothing.
fn conventional(laser: &LaserModel, beams: usize) -> Option<LaserModel> {
    let half = LaserModel::half_circle("", beams);
    let same = |a: f64, b: f64| a as f32 == b as f32;
    let by_convention =
        same(laser.angle_min_rad, half.angle_min_rad) && same(laser.angle_step_rad, half.angle_step_rad);
    let (angle_min_rad, angle_step_rad) = if by_convention {
        (half.angle_min_rad, half.angle_step_rad)
    } else {
        (laser.angle_min_rad, laser.angle_step_rad)
    };
    let found = LaserModel {
        angle_min_rad,
        angle_step_rad,
        range_min_m: shortest(laser.range_min_m),
        range_max_m: shortest(laser.range_max_m),
        beam_period_s: shortest(laser.beam_period_s),
        ..laser.clone()
    };
    (found != *laser).then_some(found)
}

/// Of a number in single precision the shortest decimal; others as they are.
fn shortest(value: f64) -> f64 {
    let single = value as f32;
    let is_single = f64::from(single).to_bits() == value.to_bits();
    if is_single { single.to_string().parse().unwrap_or(value) } else { value }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_went_through_single_precision_is_found_again() {
        let before = LaserModel { range_min_m: 0.01, beam_period_s: 2.5e-5, ..LaserModel::half_circle("FLASER", 180) };
        let single = |value: f64| f64::from(value as f32);
        let after = LaserModel {
            angle_min_rad: single(before.angle_min_rad),
            angle_step_rad: single(before.angle_step_rad),
            range_min_m: single(before.range_min_m),
            beam_period_s: single(before.beam_period_s),
            ..before.clone()
        };
        assert_eq!(conventional(&after, 180), Some(before.clone()));
        assert_eq!(conventional(&before, 180), None);
        assert_eq!(shortest(f64::INFINITY), f64::INFINITY);
    }
}
