//! Revolutions as scans with beams at even steps.

use crate::revolution::Revolution;
use mapwright_geom::Pose2;
use mapwright_sensor::{LaserModel, LaserScan};
use std::f64::consts::TAU;
use std::sync::Arc;

/// A fan has at least so many beams for each that the lidar measures: bearings are then off by an eighth of the lidar's step at most.
const FINER: usize = 4;
/// Fans have a multiple of so many beams,
const STEPS: usize = 360;
/// and no more than this; a scan may step over 32 beams without a reading.
const BEAMS_MOST: usize = 14_400;
/// A laser's time from beam to beam is that of its first scan, until it is off by so much of itself: an LD06 says milliseconds, two of a hundred tremble.
const SAME_SPEED: f64 = 0.03;

/// Puts the readings of revolutions into a fan of beams at even steps, as [`LaserScan`] has them: each into the beam that looks its way.
///
/// The fan's size is that of the first revolution's readings, four beams for each, and stays: a map is matched and drawn by one laser then. Beams of the
/// fan without a reading are NaN. Of two readings for one beam a return counts more than none, and the one nearer to the beam's middle more
/// than the other; [`Fan::crowded_out`] counts the rest.
#[derive(Debug)]
pub struct Fan {
    mounted: LaserModel,
    /// Its beams, and the laser as of the last scan.
    made: Option<(usize, Arc<LaserModel>)>,
    crowded_out: u64,
}

impl Fan {
    /// Fans of a lidar with a name that sits on the robot somewhere, and whose returns lie between two ranges in metres.
    #[must_use]
    pub fn new(name: &str, robot_from_laser: Pose2, [range_min_m, range_max_m]: [f64; 2]) -> Self {
        let mounted = LaserModel { robot_from_laser, range_min_m, range_max_m, ..LaserModel::half_circle(name, 2) };
        Self { mounted, made: None, crowded_out: 0 }
    }

    /// Readings of all revolutions that another one of the same beam of the fan left no place for.
    #[must_use]
    pub fn crowded_out(&self) -> u64 {
        self.crowded_out
    }

    /// The scan of a revolution, with beams clockwise from the lidar's front. Readings of zero metres stay zero: nothing came back, which is not
    /// to say that nothing is there.
    pub fn scan(&mut self, revolution: &Revolution) -> LaserScan {
        let (beams, laser) = self.laser(revolution);
        let mut ranges_m = vec![f32::NAN; beams];
        let mut offs = vec![f64::INFINITY; beams];
        for beam in &revolution.beams {
            let along = (-beam.bearing_rad).rem_euclid(TAU) / TAU * beams as f64;
            let place = (along as usize).min(beams - 1);
            // half a step at most, and a whole one more where nothing came back
            let off = (along - place as f64 - 0.5).abs() + f64::from(u8::from(beam.range_m <= 0.0));
            self.crowded_out += u64::from(offs[place].is_finite());
            if off < offs[place] {
                (ranges_m[place], offs[place]) = (beam.range_m, off);
            }
        }
        LaserScan { stamp: revolution.stamp, laser, ranges_m, odom_from_robot: None }
    }

    fn laser(&mut self, revolution: &Revolution) -> (usize, Arc<LaserModel>) {
        let beams = self.made.as_ref().map_or_else(|| beams_for(revolution.beams.len()), |(beams, _)| *beams);
        let beam_period_s = revolution.duration_s / beams as f64;
        if let Some((_, laser)) = &self.made
            && (laser.beam_period_s - beam_period_s).abs() <= SAME_SPEED * laser.beam_period_s
        {
            return (beams, Arc::clone(laser));
        }
        let step_rad = TAU / beams as f64;
        let laser = Arc::new(LaserModel {
            angle_min_rad: -0.5 * step_rad,
            angle_step_rad: -step_rad,
            beam_period_s,
            ..self.mounted.clone()
        });
        self.made = Some((beams, Arc::clone(&laser)));
        (beams, laser)
    }
}

fn beams_for(readings: usize) -> usize {
    ((FINER * readings).div_ceil(STEPS) * STEPS).clamp(2 * STEPS, BEAMS_MOST)
}
