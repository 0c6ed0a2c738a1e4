//! Which directions a planar laser sees: lasers that look different ways are mapped together.

use mapwright_geom::{Pose3, wrap_angle};
use mapwright_ros::Mounting;
use mapwright_sensor::LaserModel;
use nalgebra::Vector3;
use std::f64::consts::TAU;

/// Directions are told apart by steps of five degrees.
const SECTORS: usize = 72;
/// What never sees farther looks at the robot's own body, metres.
const BODY_M: f32 = 1.0;
/// A further laser sees so many sectors at least that the others do not: 10 degrees, more than mounts are wrong by.
const NEW_SECTORS: usize = 2;

/// How far a laser has seen, by direction in its own frame.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Reach {
    farthest_m: [f32; SECTORS],
}

impl Default for Reach {
    fn default() -> Self {
        Self { farthest_m: [0.0; SECTORS] }
    }
}

impl Reach {
    /// Takes in a scan of a laser that sits in its frame's origin.
    pub(crate) fn see(&mut self, laser: &LaserModel, ranges: impl Iterator<Item = f32>) {
        for (beam, range_m) in ranges.enumerate() {
            let farthest_m = &mut self.farthest_m[sector(laser.bearing_in_robot(beam))];
            // what is not a number is no reading
            if range_m > *farthest_m {
                *farthest_m = range_m;
            }
        }
    }
}

/// Points of a cloud that are looked at, of the first few: some ten in each direction.
const POINTS_OF_CLOUD: usize = 1021;

/// Where points of the first clouds of a lidar lie, metres in its own frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Glimpse {
    points_m: Vec<[f32; 3]>,
}

impl Glimpse {
    /// Takes in a cloud of so many points.
    pub(crate) fn see(&mut self, points_m: impl Iterator<Item = [f64; 3]>, count: usize) {
        self.points_m.extend(points_m.step_by(count / POINTS_OF_CLOUD + 1).map(|point| point.map(|v| v as f32)));
    }
}

/// The directions in which a robot's lasers see, ahead of it first.
#[derive(Debug, Clone, Default)]
pub(crate) struct Directions {
    seen: Vec<usize>,
}

impl Directions {
    /// The degrees that a laser sees and those before it do not, where it is worth being mapped for them; they are seen from now on.
    pub(crate) fn add(&mut self, reach: &Reach, mounting: &Mounting) -> Option<usize> {
        let step_rad = TAU / SECTORS as f64;
        let sees = |sector: &usize| reach.farthest_m[*sector] > BODY_M;
        let in_robot = |at: usize| {
            let in_laser = (at as f64 + 0.5) * step_rad;
            sector(mounting.robot_from_laser.theta + if mounting.inverted { -in_laser } else { in_laser })
        };
        self.add_sectors((0..SECTORS).filter(sees).map(in_robot))
    }

    /// The same of a lidar in space, the directions being those around the robot.
    pub(crate) fn add_in_space(&mut self, glimpse: &Glimpse, robot_from_sensor: &Pose3) -> Option<usize> {
        let turned = |point: &[f32; 3]| robot_from_sensor.rotation * Vector3::from(point.map(f64::from));
        // not `<=`: NaN is no point
        let sees = |at: &Vector3<f64>| at.x.hypot(at.y) > f64::from(BODY_M) && at.norm().is_finite();
        self.add_sectors(glimpse.points_m.iter().map(turned).filter(sees).map(|at| sector(at.y.atan2(at.x))))
    }

    fn add_sectors(&mut self, sectors: impl Iterator<Item = usize>) -> Option<usize> {
        let mut new: Vec<usize> = sectors.filter(|at| !self.seen.contains(at)).collect();
        new.sort_unstable();
        new.dedup();
        if new.len() < NEW_SECTORS {
            return None;
        }
        self.seen.extend(&new);
        Some(new.len() * 360 / SECTORS)
    }
}

fn sector(bearing_rad: f64) -> usize {
    let turned = wrap_angle(bearing_rad).rem_euclid(TAU);
    ((turned / TAU * SECTORS as f64) as usize).min(SECTORS - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright_geom::Pose2;

    /// What beams over so many degrees, centred ahead, see at so many metres.
    fn seen(degrees: usize, range_m: f32) -> Reach {
        let half_rad = 0.5 * (degrees as f64).to_radians();
        let laser = LaserModel {
            angle_min_rad: -half_rad,
            angle_step_rad: 1_f64.to_radians(),
            ..LaserModel::half_circle("laser", 181)
        };
        let mut reach = Reach::default();
        reach.see(&laser, (0..degrees).map(|_| range_m));
        reach
    }

    fn turned(degrees: f64, inverted: bool) -> Mounting {
        let robot_from_laser = Pose2::new(0.0, 0.0, degrees.to_radians());
        Mounting { robot_from_laser, inverted, ..Mounting::IDENTITY }
    }

    #[test]
    fn lasers_that_look_different_ways_add_directions_and_others_do_not() {
        let mut all = Directions::default();
        assert!(all.add(&seen(270, 4.0), &turned(45.0, false)).is_some_and(|degrees| (265..=280).contains(&degrees)));
        assert_eq!(all.clone().add(&seen(270, 4.0), &turned(45.0, true)), None, "the same way, upside down");
        assert_eq!(all.clone().add(&seen(180, 4.0), &turned(30.0, false)), None);
        assert!(all.add(&seen(270, 4.0), &turned(-135.0, false)).is_some_and(|degrees| (80..=95).contains(&degrees)));
        assert_eq!(all.add(&seen(360, 4.0), &turned(0.0, false)), None, "all round is seen");
    }

    #[test]
    fn what_sees_the_robot_alone_or_nothing_adds_none() {
        for range_m in [0.4, 0.0, f32::NAN] {
            assert_eq!(Directions::default().add(&seen(360, range_m), &turned(0.0, false)), None, "{range_m}");
        }
        assert!(Directions::default().add(&seen(360, f32::INFINITY), &turned(0.0, false)).is_some(), "nothing near");
    }
}
