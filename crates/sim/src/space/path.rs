//! Where the robot is in space at any time, and where its wheels say it is.

use super::settings::SpaceDriveSettings;
use super::site::{SpaceSite, flat};
use super::turn::{interpolate, upright};
use super::wheels::Odometry;
use super::wobble::Waves;
use crate::math::{atan2, distance, dot, sub, unit};
use crate::rng::Rng;
use crate::robot::{Robot, TICK_NS, TICK_S};
use crate::route::Route;
use mapwright_geom::{Pose2, Pose3};

/// The floor is felt so far ahead of and behind the robot's origin, metres.
const HALF_WHEELBASE_M: f64 = 0.25;
/// A drive ends after this many times the time its way takes at full speed, and ten minutes.
const PATIENCE: f64 = 20.0;

/// The robot's poses at one time.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Whereabouts {
    pub(crate) world_from_robot: Pose3,
    pub(crate) odom_from_robot: Pose3,
}

/// A whole drive, simulated at 50 Hz.
#[derive(Debug, Clone)]
pub(crate) struct Path {
    ticks: Vec<Whereabouts>,
}

impl Path {
    pub(crate) fn new(site: &SpaceSite, settings: &SpaceDriveSettings) -> Self {
        let profile = Profile::new(&site.waypoints);
        let body = Body::new(settings);
        let route = Route::new(site.waypoints.iter().map(|point| flat(*point)).collect());
        let patience_s = 600.0 + PATIENCE * route.length_m() / settings.robot.speed_m_per_s.max(1e-3);
        let ends_s = settings.duration_s.min(patience_s);
        let Some(mut robot) = Robot::new(&route, 0, settings.robot.clone()) else {
            return Self { ticks: Vec::new() };
        };
        let mut odometry = Odometry::new(&settings.odometry, settings.seed);
        let mut ticks: Vec<Whereabouts> = Vec::new();
        let mut driven_m = 0.0;
        while ticks.len() as f64 * TICK_S <= ends_s {
            let time_s = ticks.len() as f64 * TICK_S;
            let Some(step) = robot.step(&route, &[], time_s) else {
                break;
            };
            let along_m = profile.along_m(robot.leg(), step.world_from_robot);
            let world_from_robot = body.pose(&profile, along_m, driven_m, step.world_from_robot);
            let odom_from_robot = odometry.count(world_from_robot, step.true_move);
            ticks.push(Whereabouts { world_from_robot, odom_from_robot });
            driven_m += step.true_move.distance_m.abs();
        }
        Self { ticks }
    }

    /// Where the robot is then; `None` before and after the drive.
    pub(crate) fn at(&self, at_ns: i64) -> Option<Whereabouts> {
        let first = usize::try_from(at_ns.div_euclid(TICK_NS)).ok()?;
        let (from, to) = (self.ticks.get(first)?, self.ticks.get(first + 1)?);
        let share = at_ns.rem_euclid(TICK_NS) as f64 / TICK_NS as f64;
        Some(Whereabouts {
            world_from_robot: interpolate(from.world_from_robot, to.world_from_robot, share),
            odom_from_robot: interpolate(from.odom_from_robot, to.odom_from_robot, share),
        })
    }

    /// How long the drive is, seconds.
    pub(crate) fn duration_s(&self) -> f64 {
        self.ticks.len().saturating_sub(1) as f64 * TICK_S
    }
}

/// Heights along the way.
struct Profile<'a> {
    waypoints: &'a [[f64; 3]],
    /// Length of the way up to each waypoint, seen from above, metres.
    before_m: Vec<f64>,
}

impl<'a> Profile<'a> {
    fn new(waypoints: &'a [[f64; 3]]) -> Self {
        let mut before_m = vec![0.0];
        for leg in waypoints.windows(2) {
            before_m.push(before_m[before_m.len() - 1] + distance(flat(leg[0]), flat(leg[1])));
        }
        Self { waypoints, before_m }
    }

    /// How far along the way the robot is that is on a leg.
    fn along_m(&self, leg: usize, world_from_robot: Pose2) -> f64 {
        let leg = leg.min(self.waypoints.len() - 2);
        let (a, b) = (flat(self.waypoints[leg]), flat(self.waypoints[leg + 1]));
        self.before_m[leg] + dot(sub([world_from_robot.x, world_from_robot.y], a), unit(sub(b, a)))
    }

    fn height_m(&self, along_m: f64) -> f64 {
        let after = self.before_m.partition_point(|before| *before <= along_m).clamp(1, self.waypoints.len() - 1);
        let (from_m, to_m) = (self.before_m[after - 1], self.before_m[after]);
        let share = ((along_m - from_m) / (to_m - from_m).max(1e-9)).clamp(0.0, 1.0);
        self.waypoints[after - 1][2] * (1.0 - share) + self.waypoints[after][2] * share
    }
}

/// What the floor does to the robot.
struct Body {
    pitch: Waves,
    roll: Waves,
    heave: Waves,
}

impl Body {
    fn new(settings: &SpaceDriveSettings) -> Self {
        let mut rng = Rng::keyed(settings.seed, 0x0066_6c6f_6f72);
        let wobble = settings.wobble;
        let mut draw = |sigma| Waves::draw(sigma, &mut rng);
        Self {
            pitch: draw(wobble.tilt_sigma_rad),
            roll: draw(wobble.tilt_sigma_rad),
            heave: draw(wobble.heave_sigma_m),
        }
    }

    fn pose(&self, profile: &Profile<'_>, along_m: f64, driven_m: f64, seen_from_above: Pose2) -> Pose3 {
        let [front_m, back_m] = [HALF_WHEELBASE_M, -HALF_WHEELBASE_M].map(|off_m| profile.height_m(along_m + off_m));
        let climb_rad = atan2(front_m - back_m, 2.0 * HALF_WHEELBASE_M);
        let height_m = 0.5 * (front_m + back_m) + self.heave.at(driven_m);
        let (pitch_rad, roll_rad) = (self.pitch.at(driven_m) - climb_rad, self.roll.at(driven_m));
        upright([seen_from_above.x, seen_from_above.y, height_m], seen_from_above.theta, pitch_rad, roll_rad)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::odometry::OdometryNoise;
    use crate::space::{SpaceOdometryNoise, SpaceWorld, Wobble};

    fn over_a_ramp() -> SpaceSite {
        let waypoints = vec![[0.0; 3], [3.0, 0.0, 0.0], [13.0, 0.0, 2.0], [16.0, 0.0, 2.0], [16.0, 4.0, 2.0]];
        SpaceSite { world: SpaceWorld::new(Vec::new()), waypoints }
    }

    fn settings() -> SpaceDriveSettings {
        SpaceDriveSettings { wobble: Wobble::NONE, odometry: SpaceOdometryNoise::NONE, ..SpaceDriveSettings::default() }
    }

    #[test]
    fn the_robot_follows_the_ramp_with_its_nose_up() {
        let path = Path::new(&over_a_ramp(), &settings());
        let climbing = path.ticks.iter().filter(|tick| (4.0..12.0).contains(&tick.world_from_robot.translation.x));
        for tick in climbing {
            let at = tick.world_from_robot;
            assert!((at.translation.z - 0.2 * (at.translation.x - 3.0)).abs() < 1e-9, "{at:?}");
            let ahead = crate::space::turn::rows(&at).map(|row| row[0]);
            assert!((ahead[2] / ahead[0] - 0.2).abs() < 1e-9);
        }
        let end = path.ticks[path.ticks.len() - 1].world_from_robot.translation;
        assert!((end.x - 16.0).hypot(end.y - 4.0) < 0.15 && end.z == 2.0, "{end}");
        for pair in path.ticks.windows(2) {
            let step = pair[0].world_from_robot.between(pair[1].world_from_robot);
            assert!(step.translation.norm() < 1.1 * TICK_S && step.rotation.angle() < 0.05, "{step:?}");
        }
    }

    #[test]
    fn perfect_odometry_is_the_truth_seen_from_the_start() {
        let path = Path::new(&over_a_ramp(), &settings());
        let start = path.ticks[0].world_from_robot;
        for tick in &path.ticks {
            assert!((start * tick.odom_from_robot).distance(tick.world_from_robot) < 1e-9);
        }
    }

    #[test]
    fn odometry_drifts_as_much_as_asked() {
        let sigma_of = |odometry: &SpaceOdometryNoise, value: fn(&Whereabouts) -> f64| {
            let end = |seed| {
                let noisy = SpaceDriveSettings { seed, odometry: odometry.clone(), ..settings() };
                let straight = SpaceSite { waypoints: vec![[0.0; 3], [20.0, 0.0, 0.0]], ..over_a_ramp() };
                let path = Path::new(&straight, &noisy);
                value(&path.ticks[path.ticks.len() - 1])
            };
            ((0..300).map(|seed| end(seed).powi(2)).sum::<f64>() / 300.0).sqrt()
        };
        let tilt = SpaceOdometryNoise { tilt_variance_rad2_per_m: 1e-6, ..SpaceOdometryNoise::NONE };
        let pitch = sigma_of(&tilt, |end| end.odom_from_robot.rotation.euler_angles().1);
        assert!((pitch / 20e-6f64.sqrt() - 1.0).abs() < 0.15, "{pitch}");
        let wheels = OdometryNoise { alpha3: 1e-4, ..OdometryNoise::NONE };
        let along = sigma_of(&SpaceOdometryNoise { wheels, tilt_variance_rad2_per_m: 0.0 }, |end| {
            end.odom_from_robot.translation.x - end.world_from_robot.translation.x
        });
        assert!((along / 20e-4f64.sqrt() - 1.0).abs() < 0.15, "{along}");
    }
}
