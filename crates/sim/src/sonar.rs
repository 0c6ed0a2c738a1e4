//! A ring of sonars: sound that walls throw away from them like mirrors, and that comes back by detours.

use crate::drive::{Drive, DriveSettings, Event};
use crate::math::{Point, add, cross, distance, dot, rotate, scale, sub, unit};
use crate::rng::Rng;
use crate::route::Site;
use crate::world::Moment;
use mapwright_geom::Pose2;
use mapwright_sensor::{SonarReading, SonarRing};
use std::sync::Arc;

/// Sonars and their faults.
#[derive(Debug, Clone, PartialEq)]
pub struct SonarSettings {
    /// Where they sit and how they look.
    pub ring: Arc<SonarRing>,
    /// Walls are smooth: sound that meets one farther off the perpendicular than this does not come straight back, radians.
    pub echo_within_rad: f64,
    /// Probability that an edge, as of a door's frame, is heard.
    pub edge_probability: f64,
    /// Sigma of a range, metres, and its share of the range.
    pub range_sigma_m: f64,
    /// See above.
    pub range_sigma_share: f64,
    /// Probability that an echo is missed.
    pub dropout_probability: f64,
    /// Probability that a reading is anything from zero to the maximum range: another sonar's sound.
    pub crosstalk_probability: f64,
    /// What is delivered where nothing came back, metres.
    pub nothing_reading_m: f32,
}

impl Default for SonarSettings {
    /// 16 cones of 25 degrees around a robot of 0.2 m, reach 5 m, 10 mm and 0.5 % of noise; smooth walls answer within 10 degrees.
    fn default() -> Self {
        Self {
            ring: Arc::new(SonarRing::around("SONAR", 16, 0.2, 25f64.to_radians(), 5.0)),
            echo_within_rad: 10f64.to_radians(),
            edge_probability: 0.5,
            range_sigma_m: 0.01,
            range_sigma_share: 0.005,
            dropout_probability: 0.02,
            crosstalk_probability: 0.01,
            nothing_reading_m: 5.0,
        }
    }
}

/// A ring's readings, and where they were really taken.
#[derive(Debug, Clone, PartialEq)]
pub struct TrueSonar {
    /// The readings.
    pub reading: SonarReading,
    /// True pose of the robot at their stamp.
    pub world_from_robot: Pose2,
}

/// A drive of a robot with a ring of sonars: its events are those of [`Drive`], with the ring's readings in place of each scan.
pub fn sonar_drive(
    site: Arc<Site>,
    settings: DriveSettings,
    sonar: SonarSettings,
) -> impl Iterator<Item = Event<TrueSonar>> {
    let seed = settings.seed ^ 0x736f_6e61_7200;
    let mut index = 0;
    Drive::new(Arc::clone(&site), settings).map(move |event| match event {
        Event::Odometry(odometry) => Event::Odometry(odometry),
        Event::Scan(scan) => {
            let mut rng = Rng::keyed(seed, index);
            index += 1;
            let at = scan.world_from_robot;
            let moment = site.world.at(scan.scan.stamp.as_secs_f64(), [at.x, at.y], 2.0 * sonar.ring.reach_m());
            let reading = SonarReading {
                stamp: scan.scan.stamp,
                ring: Arc::clone(&sonar.ring),
                ranges_m: sonar.read(&moment, at, &mut rng),
                odom_from_robot: scan.scan.odom_from_robot,
            };
            Event::Scan(TrueSonar { reading, world_from_robot: at })
        }
    })
}

/// Rays that stand for a cone are so far apart, radians.
const RAY_STEP_RAD: f64 = 0.0175;
/// A surface's direction is told by two rays so far to either side, radians,
const PROBE_RAD: f64 = 0.002;
/// which end no farther apart than a surface would have them at this incidence, tangent.
const STEEPEST: f64 = 12.0;
/// A surface that a detour ends on is met within this of the perpendicular, cosine: sound comes back the way it went.
const BACK_COSINE: f64 = 0.9994;
/// After two walls in a corner the sound runs back beside the way it came, no farther off than this, metres.
const CORNER_ASIDE_M: f64 = 0.3;
/// A reflected ray begins so far before the surface, metres.
const OFF_SURFACE_M: f64 = 1e-6;

/// Where a ray meets something.
struct Met {
    range_m: f64,
    point: Point,
    /// Towards where the ray came from; none at an edge.
    normal: Option<Point>,
}

impl SonarSettings {
    /// What each sonar reads, the robot being there.
    fn read(&self, moment: &Moment<'_>, world_from_robot: Pose2, rng: &mut Rng) -> Vec<f32> {
        let sonars = self.ring.sonars.iter();
        let reading = sonars.map(|sonar| {
            let world_from_sonar = world_from_robot * sonar.robot_from_sonar;
            let (fate, noise) = (rng.unit(), rng.normal(1.0));
            let heard_edge = rng.chance(self.edge_probability);
            if fate < self.dropout_probability {
                return self.nothing_reading_m;
            }
            if fate < self.dropout_probability + self.crosstalk_probability {
                return rng.uniform(0.0, sonar.range_max_m) as f32;
            }
            let rays = (sonar.opening_rad / RAY_STEP_RAD).ceil().max(1.0) as i32;
            let ray = |k: i32| sonar.opening_rad * (f64::from(k) / f64::from(rays) - 0.5);
            let echo = |k: i32| self.echo_m(moment, world_from_sonar, ray(k), heard_edge);
            let nearest_m = (0..=rays).filter_map(echo).fold(f64::INFINITY, f64::min);
            let range_m = nearest_m + noise * (self.range_sigma_m + self.range_sigma_share * nearest_m);
            if range_m < sonar.range_max_m { range_m.max(0.0) as f32 } else { self.nothing_reading_m }
        });
        reading.collect()
    }

    /// How long the sound of one ray is on its way and back, as a range, metres.
    fn echo_m(&self, moment: &Moment<'_>, world_from_sonar: Pose2, bearing_rad: f64, heard_edge: bool) -> Option<f64> {
        let origin = [world_from_sonar.x, world_from_sonar.y];
        let direction = rotate([1.0, 0.0], world_from_sonar.theta + bearing_rad);
        let met = meet(moment, origin, direction)?;
        let Some(normal) = met.normal else { return heard_edge.then_some(met.range_m) };
        let cosine = -dot(direction, normal);
        let (_, least_cosine) = mapwright_geom::sin_cos(self.echo_within_rad);
        if cosine >= least_cosine {
            return Some(met.range_m);
        }
        // Off the mirror, and back from what lies there: the same way, or beside it out of a corner.
        let onward = mirrored(direction, normal);
        let second = meet(moment, add(met.point, scale(normal, OFF_SURFACE_M)), onward)?;
        let there = second.normal?;
        if -dot(onward, there) >= BACK_COSINE {
            return Some(met.range_m + second.range_m);
        }
        let out = mirrored(onward, there);
        let back = sub(origin, second.point);
        let is_back = -dot(out, direction) >= BACK_COSINE && cross(out, back).abs() <= CORNER_ASIDE_M;
        is_back.then(|| 0.5 * (met.range_m + second.range_m + distance(origin, second.point)))
    }
}

fn mirrored(direction: Point, normal: Point) -> Point {
    sub(direction, scale(normal, 2.0 * dot(direction, normal)))
}

fn meet(moment: &Moment<'_>, origin: Point, direction: Point) -> Option<Met> {
    let range_m = moment.cast(origin, direction);
    if !range_m.is_finite() {
        return None;
    }
    let at = |angle_rad: f64| {
        let aside = rotate(direction, angle_rad);
        let range_m = moment.cast(origin, aside);
        add(origin, scale(aside, range_m))
    };
    let (left, right) = (at(PROBE_RAD), at(-PROBE_RAD));
    let along = sub(left, right);
    let apart_m = distance(left, right);
    let point = add(origin, scale(direction, range_m));
    let bent_m = cross(unit(along), sub(point, right)).abs();
    let is_surface = apart_m <= 2.0 * PROBE_RAD * range_m * STEEPEST && bent_m <= 0.1 * apart_m;
    // Counter-clockwise of a ray lies its left: the perpendicular of right to left points back.
    let normal = is_surface.then(|| unit([-along[1], along[0]]));
    Some(Met { range_m, point, normal })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::shape::Segment;
    use crate::world::World;
    use mapwright_sensor::Sonar;

    fn one(bearing_rad: f64) -> SonarSettings {
        let sonar = Sonar {
            robot_from_sonar: Pose2::new(0.0, 0.0, bearing_rad),
            opening_rad: 25f64.to_radians(),
            range_min_m: 0.1,
            range_max_m: 5.0,
        };
        SonarSettings {
            ring: Arc::new(SonarRing { name: "SONAR".to_owned(), sonars: vec![sonar] }),
            edge_probability: 0.0,
            range_sigma_m: 0.0,
            range_sigma_share: 0.0,
            dropout_probability: 0.0,
            crosstalk_probability: 0.0,
            ..SonarSettings::default()
        }
    }

    fn read(walls: &[[f64; 4]], bearing_deg: f64) -> f32 {
        let walls = walls.iter().map(|&[ax, ay, bx, by]| Segment { a: [ax, ay], b: [bx, by] }).collect();
        let world = World::new(walls, vec![]);
        let moment = world.at(0.0, [0.0; 2], 20.0);
        one(bearing_deg.to_radians()).read(&moment, Pose2::IDENTITY, &mut Rng::new(1))[0]
    }

    #[test]
    fn a_smooth_wall_is_heard_across_and_not_along() {
        let wall = [[2.0, -30.0, 2.0, 30.0]];
        assert!((read(&wall, 0.0) - 2.0).abs() < 1e-3);
        assert!((read(&wall, 10.0) - 2.0).abs() < 1e-3, "its foot is in the cone");
        assert!((read(&wall, 20.0) - 2.0).abs() < 0.05);
        assert_eq!(read(&wall, 40.0), 5.0, "beyond, the sound goes away");
    }

    #[test]
    fn sound_comes_by_a_detour_and_out_of_corners() {
        // A mirror at 45 degrees 1 m ahead sends it to a wall 2 m to the left.
        let detour = read(&[[0.5, -0.5, 1.5, 0.5], [-9.0, 2.0, 9.0, 2.0]], 0.0);
        assert!((detour - 3.0).abs() < 0.02, "{detour}");
        let corner = read(&[[2.0, -9.0, 2.0, 2.0], [-9.0, 2.0, 2.0, 2.0]], 45.0);
        assert!((corner - 8f32.sqrt()).abs() < 0.05, "{corner}");
    }
}
