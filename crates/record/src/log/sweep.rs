//! Sweeps as measurements of keyframes, and lasers and sweeps as bytes.

use super::bytes::{Cursor, put_f64, put_pose, text};
use crate::error::EntryError;
use crate::keyframe::Measurement;
use crate::left_out::Beams;
use mapwright_geom::Pose2;
use mapwright_sensor::{BEAM_DROPPED, LaserModel, Sweep};
use std::sync::Arc;

/// A code's step is at most this, metres: it reaches 32 km.
const STEP_AT_MOST_M: f64 = 0.5;
/// Motion during a sweep, metres and radians.
const SWEEP_MOTION_AT_MOST: f64 = 10.0;

impl Measurement for Sweep {
    type Pose = Pose2;
    type Sensor = LaserModel;

    const CODE: u8 = 1;

    fn without(&self, beams: &Beams) -> Self {
        let Beams::These(beams) = beams else { return self.blanked() };
        let mut sweep = self.clone();
        for &beam in beams {
            if let Some(code) = sweep.codes.get_mut(beam as usize) {
                *code = BEAM_DROPPED;
            }
        }
        sweep
    }

    fn check(&self) -> Result<(), EntryError> {
        check(self)
    }

    fn sensor(&self) -> &Arc<LaserModel> {
        &self.laser
    }

    fn is_of_one_sensor_with(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.laser, &other.laser) || self.laser.is_one_with(&other.laser)
    }

    fn put_sensor(laser: &LaserModel, out: &mut Vec<u8>) {
        put_laser(laser, out);
    }

    fn take_sensor(bytes: &[u8]) -> Result<LaserModel, EntryError> {
        take_laser(bytes)
    }

    fn put(&self, out: &mut Vec<u8>) {
        put_sweep(self, out);
    }

    fn take(laser: &Arc<LaserModel>, bytes: &[u8]) -> Result<Self, EntryError> {
        take_sweep(laser, bytes)
    }
}

/// Whether a sweep can be mapped with.
pub(crate) fn check(sweep: &Sweep) -> Result<(), EntryError> {
    let beams = sweep.codes.len();
    sweep.laser.check(beams).map_err(|reason| EntryError {
        expected: "a sweep of a laser that can be mapped with",
        found: reason.to_owned(),
    })?;
    if !(sweep.step_m > 0.0 && sweep.step_m <= STEP_AT_MOST_M) {
        return Err(EntryError { expected: "a step of ranges up to 0.5 m", found: sweep.step_m.to_string() });
    }
    let sweep_s = (sweep.laser.beam_period_s * beams as f64).abs();
    if sweep.twist_per_s.iter().all(|rate| rate.is_finite() && rate.abs() * sweep_s <= SWEEP_MOTION_AT_MOST) {
        return Ok(());
    }
    let found = format!("{:?} a second", sweep.twist_per_s);
    Err(EntryError { expected: "at most 10 m and 10 rad of motion in a sweep", found })
}

pub(crate) fn put_laser(laser: &LaserModel, out: &mut Vec<u8>) {
    put_geometry(laser, out);
    out.extend_from_slice(laser.name.as_bytes());
}

fn put_geometry(laser: &LaserModel, out: &mut Vec<u8>) {
    let LaserModel { angle_min_rad, angle_step_rad, range_min_m, range_max_m, beam_period_s, .. } = *laser;
    let numbers = [angle_min_rad, angle_step_rad, range_min_m, range_max_m, beam_period_s];
    numbers.into_iter().for_each(|number| put_f64(out, number));
    put_pose(out, laser.robot_from_laser);
    out.push(u8::from(laser.inverted));
}

pub(crate) fn take_laser(bytes: &[u8]) -> Result<LaserModel, EntryError> {
    let mut cursor = Cursor::new(bytes);
    let laser = geometry(&mut cursor)?;
    Ok(LaserModel { name: text(cursor.rest(), "a laser's name")?, ..laser })
}

/// A laser without its name.
pub(super) fn geometry(cursor: &mut Cursor<'_>) -> Result<LaserModel, EntryError> {
    let mut number = || cursor.f64("a laser's geometry");
    let [angle_min_rad, angle_step_rad, range_min_m, range_max_m, beam_period_s] =
        [number()?, number()?, number()?, number()?, number()?];
    Ok(LaserModel {
        name: String::new(),
        angle_min_rad,
        angle_step_rad,
        range_min_m,
        range_max_m,
        robot_from_laser: cursor.pose()?,
        inverted: cursor.flag("whether a laser is upside down, 0 or 1")?,
        beam_period_s,
    })
}

pub(crate) fn put_sweep(sweep: &Sweep, out: &mut Vec<u8>) {
    put_f64(out, sweep.step_m);
    sweep.twist_per_s.into_iter().for_each(|rate| put_f64(out, rate));
    out.push(u8::from(sweep.scatters));
    out.reserve(2 * sweep.codes.len());
    sweep.codes.iter().for_each(|code| out.extend_from_slice(&code.to_le_bytes()));
}

pub(crate) fn take_sweep(laser: &Arc<LaserModel>, bytes: &[u8]) -> Result<Sweep, EntryError> {
    let mut cursor = Cursor::new(bytes);
    let sweep = without_beams(laser, &mut cursor)?;
    Ok(Sweep { codes: codes(cursor.rest())?, ..sweep })
}

pub(super) fn without_beams(laser: &Arc<LaserModel>, cursor: &mut Cursor<'_>) -> Result<Sweep, EntryError> {
    let mut number = || cursor.f64("a sweep");
    let step_m = number()?;
    let twist_per_s = [number()?, number()?, number()?];
    let scatters = cursor.flag("whether the laser scatters, 0 or 1")?;
    Ok(Sweep { laser: Arc::clone(laser), codes: Vec::new(), step_m, twist_per_s, scatters })
}

pub(super) fn codes(bytes: &[u8]) -> Result<Vec<u16>, EntryError> {
    let (codes, odd) = bytes.as_chunks();
    if !odd.is_empty() {
        return Err(EntryError { expected: "two bytes a beam", found: format!("{} bytes", bytes.len()) });
    }
    Ok(codes.iter().map(|code| u16::from_le_bytes(*code)).collect())
}
