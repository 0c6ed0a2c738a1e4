//! The robot's body: follows a route with bounded speeds, and may come to harm.

use crate::math::{Point, add, advance, atan2, distance, dot, lerp, rotate, scale, sub, unit};
use crate::route::Route;
use crate::shape::{Circle, Segment};
use mapwright_geom::{Pose2, sin_cos, wrap_angle};
use std::f64::consts::TAU;

/// Step of the simulation, nanoseconds: 50 Hz, whatever the rates of the sensors.
pub(crate) const TICK_NS: i64 = 20_000_000;
/// The same in seconds.
pub(crate) const TICK_S: f64 = 0.02;

/// Beyond this heading error the robot turns on the spot, radians.
const TURN_ON_SPOT_RAD: f64 = 0.7;
/// Commanded turn rate per radian of heading error, 1/s.
const STEER_GAIN_PER_S: f64 = 2.5;
/// A waypoint nearer than this is reached, metres.
const REACHED_M: f64 = 0.1;
/// The robot stops at corners whose legs have a lower cosine: sharper than about 100 degrees.
const STOP_COSINE: f64 = -0.2;

/// How a differential drive moves.
#[derive(Debug, Clone, PartialEq)]
pub struct RobotSettings {
    /// Highest speed, m/s.
    pub speed_m_per_s: f64,
    /// Highest turn rate, rad/s.
    pub turn_rate_rad_per_s: f64,
    /// Highest change of speed, m/s^2.
    pub acceleration_m_per_s2: f64,
    /// Highest change of the turn rate, rad/s^2.
    pub turn_acceleration_rad_per_s2: f64,
    /// The point of the route that is steered for lies this far ahead, metres.
    pub lookahead_m: f64,
}

impl Default for RobotSettings {
    fn default() -> Self {
        Self {
            speed_m_per_s: 0.5,
            turn_rate_rad_per_s: 0.8,
            acceleration_m_per_s2: 0.5,
            turn_acceleration_rad_per_s2: 2.0,
            lookahead_m: 0.4,
        }
    }
}

/// What goes wrong on a drive; times in seconds since its start.
#[derive(Debug, Clone, PartialEq)]
pub enum Incident {
    /// The wheels turn as commanded, the robot stays where it is.
    Slip {
        /// Start.
        from_s: f64,
        /// End.
        to_s: f64,
    },
    /// The robot moves as commanded, the wheels report only a share of it.
    Skid {
        /// Start.
        from_s: f64,
        /// End.
        to_s: f64,
        /// Share of the motion that the wheels report: 0 is none.
        odometry_share: f64,
    },
    /// The robot's heading jumps; odometry does not notice.
    HeadingJump {
        /// When.
        at_s: f64,
        /// By how much, counter-clockwise.
        angle_rad: f64,
    },
    /// The robot leaves its route to turn on the spot, as fast as asked, and then drives on.
    Turn {
        /// Start.
        from_s: f64,
        /// How long the turn takes.
        duration_s: f64,
        /// By how much, counter-clockwise.
        angle_rad: f64,
        /// Share of the turn that the wheels report: 1 is all, 0 is none.
        odometry_share: f64,
    },
    /// No scan and no odometry is recorded.
    Outage {
        /// Start.
        from_s: f64,
        /// End.
        to_s: f64,
        /// Whether odometry does not even count on during the gap.
        odometry_lost: bool,
    },
    /// The robot is carried to a waypoint of its route and drives on from there; odometry does not notice.
    Kidnap {
        /// When.
        at_s: f64,
        /// Number of the waypoint.
        waypoint: usize,
    },
    /// The robot is lifted up, carried away, put down at a waypoint of its route, and drives on from there; odometry does
    /// not notice. Until it is put down it counts as being where it was lifted up.
    Carried {
        /// When it is lifted up.
        from_s: f64,
        /// When it is put down.
        to_s: f64,
        /// Number of the waypoint.
        waypoint: usize,
        /// Whether the laser sees nothing but its carrier on the way; otherwise no scan is recorded.
        blocked: bool,
    },
    /// A person stands right before the laser and moves along with it.
    Blocked {
        /// Start.
        from_s: f64,
        /// End.
        to_s: f64,
        /// Direction of the person's centre seen from the laser, counter-clockwise from above.
        bearing_rad: f64,
        /// Distance of the person's centre from the laser, metres.
        distance_m: f64,
        /// Radius of the person, metres.
        radius_m: f64,
    },
    /// Somebody walks behind the robot and pushes it all the way: two legs side by side that swing in turn.
    Pushed {
        /// Distance of the legs' middle from the robot's centre where both are level, metres.
        distance_m: f64,
        /// Radius of a leg, metres.
        radius_m: f64,
        /// Between the legs' centres, metres.
        apart_m: f64,
        /// How far a leg swings ahead and back, metres.
        swing_m: f64,
        /// How often each of them does, per second.
        strides_per_s: f64,
    },
}

impl Incident {
    /// Whether the laser is covered while the robot is being carried; `None` when it is not being carried.
    pub(crate) fn carries(&self, time_s: f64) -> Option<bool> {
        match *self {
            Self::Carried { from_s, to_s, blocked, .. } if from_s <= time_s && time_s < to_s => Some(blocked),
            _ => None,
        }
    }
}

/// The legs of who pushes a robot that is here, where an incident is that.
pub(crate) fn legs(incident: &Incident, world_from_robot: Pose2, time_s: f64) -> Option<[Circle; 2]> {
    let Incident::Pushed { distance_m, radius_m, apart_m, swing_m, strides_per_s } = *incident else { return None };
    let (swing, _) = sin_cos(TAU * strides_per_s * time_s);
    let leg = |side: f64| {
        let in_robot = [-distance_m + side * swing_m * swing, 0.5 * side * apart_m];
        let away = rotate(in_robot, world_from_robot.theta);
        Circle { center: add([world_from_robot.x, world_from_robot.y], away), radius_m }
    };
    Some([1.0, -1.0].map(leg))
}

/// One step: from here, with constant speed and turn rate, both as they are and as the wheels report them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Step {
    pub(crate) world_from_robot: Pose2,
    pub(crate) true_move: Arc2,
    pub(crate) wheel_move: Arc2,
}

/// An arc: distance driven and angle turned.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Arc2 {
    pub(crate) distance_m: f64,
    pub(crate) turn_rad: f64,
}

/// The robot on its way.
#[derive(Debug, Clone)]
pub(crate) struct Robot {
    settings: RobotSettings,
    world_from_robot: Pose2,
    speed_m_per_s: f64,
    turn_rate_rad_per_s: f64,
    /// Number of the waypoint at which the current leg begins.
    leg: usize,
}

impl Robot {
    /// Stands on a waypoint and looks at the next; `None` where the route has no such leg.
    pub(crate) fn new(route: &Route, waypoint: usize, settings: RobotSettings) -> Option<Self> {
        let world_from_robot = pose_at_waypoint(route, waypoint)?;
        Some(Self { settings, world_from_robot, speed_m_per_s: 0.0, turn_rate_rad_per_s: 0.0, leg: waypoint })
    }

    /// Lives through the tick that begins at `time_s`; `None` at the end of the route.
    pub(crate) fn step(&mut self, route: &Route, incidents: &[Incident], time_s: f64) -> Option<Step> {
        self.suffer_jumps(route, incidents, time_s);
        let target = self.target(route)?;
        self.steer(target);
        let commanded = Arc2 { distance_m: self.speed_m_per_s * TICK_S, turn_rad: self.turn_rate_rad_per_s * TICK_S };
        let (true_move, wheel_move) = self.suffer_moves(incidents, time_s, commanded);
        let step = Step { world_from_robot: self.world_from_robot, true_move, wheel_move };
        self.world_from_robot = advance(self.world_from_robot, true_move.distance_m, true_move.turn_rad);
        Some(step)
    }

    /// Number of the waypoint at which the current leg begins.
    pub(crate) fn leg(&self) -> usize {
        self.leg
    }

    fn position(&self) -> Point {
        [self.world_from_robot.x, self.world_from_robot.y]
    }

    /// The point to steer for, and how far it is to the next stop; moves on along the legs on the way.
    fn target(&mut self, route: &Route) -> Option<Target> {
        loop {
            let leg = Segment { a: route.waypoint(self.leg)?, b: route.waypoint(self.leg + 1)? };
            let next = route.waypoint(self.leg + 2).map(|end| Segment { a: leg.b, b: end });
            // A sharp corner is a stop, as is the end.
            let next = next.filter(|next| dot(direction(&leg), direction(next)) > STOP_COSINE);
            if !self.finished(&leg, next.as_ref()) {
                return Some(self.lookahead(&leg, next.as_ref()));
            }
            self.leg += 1;
        }
    }

    /// Whether the end of the leg is reached, or the leg to go on with is nearer already.
    fn finished(&self, leg: &Segment, next: Option<&Segment>) -> bool {
        let here = self.position();
        let left_m = dot(sub(leg.b, here), direction(leg));
        let next_nearer = |next: &Segment| next.distance_to_point(here) < leg.distance_to_point(here);
        left_m <= 0.03 || distance(leg.b, here) <= REACHED_M || next.is_some_and(next_nearer)
    }

    /// A point `lookahead_m` on along the route, not beyond a stop.
    fn lookahead(&self, leg: &Segment, next: Option<&Segment>) -> Target {
        let left_m = dot(sub(leg.b, self.position()), direction(leg));
        let beyond_m = self.settings.lookahead_m - left_m;
        let point = match next {
            Some(next) if beyond_m > 0.0 => add(next.a, scale(direction(next), beyond_m.min(next.length_m()))),
            _ => add(leg.b, scale(direction(leg), beyond_m.min(0.0))),
        };
        Target { point, stop_m: if next.is_some() { f64::INFINITY } else { left_m } }
    }

    fn steer(&mut self, target: Target) {
        let s = &self.settings;
        let to_target = sub(target.point, self.position());
        let error_rad = wrap_angle(atan2(to_target[1], to_target[0]) - self.world_from_robot.theta);
        let turn_rate = (STEER_GAIN_PER_S * error_rad).clamp(-s.turn_rate_rad_per_s, s.turn_rate_rad_per_s);
        let straight = (1.0 - error_rad.abs() / TURN_ON_SPOT_RAD).max(0.0);
        // Braking distance, with a remainder so that the stop is reached at all.
        let braking = (2.0 * s.acceleration_m_per_s2 * target.stop_m).sqrt().max(0.05);
        let speed = (s.speed_m_per_s * straight).min(braking);
        let change = s.acceleration_m_per_s2 * TICK_S;
        self.speed_m_per_s += (speed - self.speed_m_per_s).clamp(-2.0 * change, change);
        let change = s.turn_acceleration_rad_per_s2 * TICK_S;
        self.turn_rate_rad_per_s += (turn_rate - self.turn_rate_rad_per_s).clamp(-change, change);
    }

    fn suffer_jumps(&mut self, route: &Route, incidents: &[Incident], time_s: f64) {
        let now = |at_s: f64| time_s <= at_s && at_s < time_s + TICK_S;
        for incident in incidents {
            match *incident {
                Incident::HeadingJump { at_s, angle_rad } if now(at_s) => {
                    self.world_from_robot = advance(self.world_from_robot, 0.0, angle_rad);
                }
                Incident::Kidnap { at_s, waypoint } | Incident::Carried { to_s: at_s, waypoint, .. } if now(at_s) => {
                    self.carry_to(route, waypoint);
                }
                _ => {}
            }
        }
    }

    fn carry_to(&mut self, route: &Route, waypoint: usize) {
        if let Some(world_from_robot) = pose_at_waypoint(route, waypoint) {
            self.world_from_robot = world_from_robot;
            self.leg = waypoint;
        }
    }

    /// True and reported motion of this tick.
    fn suffer_moves(&mut self, incidents: &[Incident], time_s: f64, commanded: Arc2) -> (Arc2, Arc2) {
        let (mut true_move, mut wheel_move) = (commanded, commanded);
        for incident in incidents {
            match *incident {
                Incident::Slip { from_s, to_s } if from_s <= time_s && time_s < to_s => true_move = Arc2::default(),
                Incident::Skid { from_s, to_s, odometry_share: share } if from_s <= time_s && time_s < to_s => {
                    wheel_move =
                        Arc2 { distance_m: commanded.distance_m * share, turn_rad: commanded.turn_rad * share };
                }
                Incident::Carried { from_s, to_s, .. } if from_s <= time_s && time_s < to_s => {
                    (true_move, wheel_move) = (Arc2::default(), Arc2::default());
                    (self.speed_m_per_s, self.turn_rate_rad_per_s) = (0.0, 0.0);
                }
                Incident::Turn { from_s, duration_s, angle_rad, odometry_share } => {
                    let share = overlap_share(time_s, from_s, duration_s);
                    if share > 0.0 {
                        true_move = Arc2 { distance_m: 0.0, turn_rad: angle_rad * share };
                        wheel_move = Arc2 { distance_m: 0.0, turn_rad: angle_rad * share * odometry_share };
                        (self.speed_m_per_s, self.turn_rate_rad_per_s) = (0.0, 0.0);
                    }
                }
                _ => {}
            }
        }
        (true_move, wheel_move)
    }
}

fn direction(leg: &Segment) -> Point {
    unit(sub(leg.b, leg.a))
}

/// What to steer for.
struct Target {
    point: Point,
    stop_m: f64,
}

fn pose_at_waypoint(route: &Route, waypoint: usize) -> Option<Pose2> {
    let (here, next) = (route.waypoint(waypoint)?, route.waypoint(waypoint + 1)?);
    let ahead = sub(next, here);
    Some(Pose2::new(here[0], here[1], atan2(ahead[1], ahead[0])))
}

/// Share of the span of `duration_s` from `from_s` that falls into the tick at `time_s`.
fn overlap_share(time_s: f64, from_s: f64, duration_s: f64) -> f64 {
    let overlap_s = (time_s + TICK_S).min(from_s + duration_s) - time_s.max(from_s);
    (overlap_s / duration_s.max(1e-9)).clamp(0.0, 1.0)
}

impl Step {
    /// True pose at a share of the tick.
    pub(crate) fn world_from_robot_at(&self, share: f64) -> Pose2 {
        advance(self.world_from_robot, self.true_move.distance_m * share, self.true_move.turn_rad * share)
    }
}

/// A pose on the straight way from one pose to another nearby.
pub(crate) fn interpolate(from: Pose2, to: Pose2, share: f64) -> Pose2 {
    let [x, y] = lerp([from.x, from.y], [to.x, to.y], share);
    Pose2::new(x, y, from.theta + share * wrap_angle(to.theta - from.theta))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may")]
mod tests {
    use super::*;

    fn drive(route: &Route, incidents: &[Incident]) -> Vec<Step> {
        let mut robot = Robot::new(route, 0, RobotSettings::default()).unwrap();
        (0..100_000i32).map_while(|k| robot.step(route, incidents, f64::from(k) * TICK_S)).collect()
    }

    #[test]
    fn speeds_stay_bounded_and_the_route_is_finished_nearby() {
        let corners = vec![[0.0, 0.0], [5.0, 0.0], [5.0, 3.0], [1.0, 3.0], [5.0, 3.0], [5.0, 6.0]];
        let route = Route::new(corners);
        let steps = drive(&route, &[]);
        assert!(steps.len() < 4_000, "took {} ticks", steps.len());
        for step in &steps {
            assert!(step.true_move.distance_m <= 0.5 * TICK_S + 1e-12 && step.true_move.distance_m >= -1e-12);
            assert!(step.true_move.turn_rad.abs() <= 0.8 * TICK_S + 1e-12);
            let at = [step.world_from_robot.x, step.world_from_robot.y];
            let off_m = route.legs().map(|leg| leg.distance_to_point(at)).fold(f64::INFINITY, f64::min);
            assert!(off_m < 0.2, "{off_m} m off the route");
        }
        let last = steps.last().unwrap().world_from_robot;
        assert!(last.distance(Pose2::new(5.0, 6.0, 0.0)) < 0.15);
    }

    #[test]
    fn a_slip_moves_the_wheels_only() {
        let route = Route::new(vec![[0.0, 0.0], [20.0, 0.0]]);
        let steps = drive(&route, &[Incident::Slip { from_s: 5.0, to_s: 7.0 }]);
        let sum = |f: fn(&Step) -> f64| steps.iter().map(f).sum::<f64>();
        let slipped_m = sum(|s| s.wheel_move.distance_m) - sum(|s| s.true_move.distance_m);
        assert!((slipped_m - 1.0).abs() < 0.02, "{slipped_m}");
    }

    #[test]
    fn a_skid_moves_the_robot_only() {
        let route = Route::new(vec![[0.0, 0.0], [20.0, 0.0]]);
        let steps = drive(&route, &[Incident::Skid { from_s: 5.0, to_s: 7.0, odometry_share: 0.25 }]);
        let sum = |f: fn(&Step) -> f64| steps.iter().map(f).sum::<f64>();
        let missed_m = sum(|s| s.true_move.distance_m) - sum(|s| s.wheel_move.distance_m);
        assert!((missed_m - 0.75).abs() < 0.02, "{missed_m}");
    }

    #[test]
    fn a_turn_turns_by_what_was_asked() {
        let route = Route::new(vec![[0.0, 0.0], [20.0, 0.0]]);
        let turn = Incident::Turn { from_s: 5.013, duration_s: 0.171, angle_rad: 1.0, odometry_share: 0.25 };
        let steps = drive(&route, &[turn]);
        let turned = steps[250..260].iter().map(|s| s.true_move.turn_rad).sum::<f64>();
        let reported = steps[250..260].iter().map(|s| s.wheel_move.turn_rad).sum::<f64>();
        assert!((turned - 1.0).abs() < 0.05 && (reported - 0.25).abs() < 0.05, "{turned} {reported}");
    }
}
