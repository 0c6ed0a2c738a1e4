//! Clouds of a planar laser that tilts or spins on its robot, put together by the transforms of its joint.
//!
//! One cloud is one swing: it ends where the joint turns back, and of a joint that goes round where the laser has seen all of space. The
//! robot's motion during a swing is undone by its odometry; where there is none, a short swing's points keep their times, and for a long
//! one the robot is taken to stand, which the plan says.

use crate::choice::Choice;
use crate::frames::{Place, SWING_MOST_RAD, place_in_space};
use crate::links::{Link, Links, bare, base_rank, is_world};
use crate::merge::{WINDOW_MESSAGES, WINDOW_S};
use crate::survey::{Survey, TopicSurvey};
use mapwright_geom::{Pose3, Stamp};
use mapwright_ros::Mounting;
use mapwright_ros::messages::{LaserScan, TransformStamped};
use mapwright_sensor::{LaserModel, OdometryReading, OdometryTrack};
use nalgebra::{UnitQuaternion, Vector3};
use std::collections::VecDeque;
use std::f64::consts::{PI, TAU};

/// A joint that goes back by more than this turns back, radians: more than encoders are wrong by.
const BACK_RAD: f64 = 1.0 * PI / 180.0;
/// A swing that turned by less sees no more of space than a scan does: it is no cloud. As much as swings of robots on bumpy floors.
const SWING_LEAST_RAD: f64 = SWING_MOST_RAD;
/// A swing ends after this time at the latest, seconds: a joint that hardly turns does not put a whole drive into one cloud.
const SWING_MOST_S: f64 = 60.0;
/// Points of a swing that lasts longer do not keep their times: no motion is even for so long. As of clouds' own times, seconds.
const TIMES_MOST_S: f64 = 1.5;
/// Points of one cloud at most.
const POINTS_AT_MOST: usize = 1 << 24;

/// The joint that tilts a laser, and what hangs above and below it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Joint {
    parent: String,
    child: String,
    robot_from_parent: Pose3,
    child_from_laser: Pose3,
    /// How far it swings from where it is first, radians.
    swung_rad: f64,
    /// Whether odometry says how the robot moves during a swing.
    has_odometry: bool,
}

/// The link that tilts a laser on its robot, if one does; a robot that sways is no such link.
pub(super) fn tilting<'a>(links: &'a Links, laser: &str) -> Option<&'a Link> {
    let above = links.above(laser);
    let first = above.into_iter().find(|link| !link.is_constant())?;
    let is_robot = is_world(&first.parent) || base_rank(&first.child).is_some();
    (!is_robot && first.swung_rad > SWING_MOST_RAD).then_some(first)
}

/// Whether a topic has scans of a laser that tilts.
pub(super) fn is_tilting(survey: &Survey, topic: &TopicSurvey) -> bool {
    topic.kind.is_planar() && topic.usable() > 0 && tilting(&survey.links, topic.frame()).is_some()
}

impl Joint {
    /// The joint that tilts a topic's laser, and the place of its axis: that of a sensor that looks ahead.
    ///
    /// # Errors
    /// Why nothing says where the laser is on its robot, in words.
    pub(super) fn of(
        survey: &Survey,
        topic: &TopicSurvey,
        moved: &[&str],
        choice: &Choice,
    ) -> Result<(Self, Place), String> {
        let laser = topic.frame();
        let link = tilting(&survey.links, laser).ok_or("its laser does not tilt")?;
        let links = survey.links.fixed(&link.parent, &link.child);
        let place = place_in_space(&links, laser, moved, choice)?;
        let between = |target: &str, source: &str| {
            links.constant(target, source).map_err(|_| format!("nothing says how '{source}' sits on '{target}'"))
        };
        let robot_from_parent = between(&place.robot_frame, &link.parent)?;
        let child_from_laser = between(&link.child, laser)?;
        let axis = robot_from_parent * link.parent_from_child;
        let robot_from_sensor = Pose3 { rotation: UnitQuaternion::identity(), ..axis };
        let joint = Self {
            parent: link.parent.clone(),
            child: link.child.clone(),
            robot_from_parent,
            child_from_laser,
            swung_rad: link.swung_rad,
            has_odometry: false,
        };
        Ok((joint, Place { robot_from_sensor, ..place }))
    }

    /// The same, and whether odometry says how the robot moves.
    pub(super) fn with_odometry(self, has_odometry: bool) -> Self {
        Self { has_odometry, ..self }
    }

    /// What becomes of its scans, in words.
    pub(super) fn words(&self) -> String {
        let motion = if self.has_odometry { "the robot's motion is undone by odometry" } else { "" };
        let comma = if motion.is_empty() { "" } else { ", " };
        format!(
            "'{}' swings in '{}' by up to {:.0} deg: one cloud a swing, put together by its transforms{comma}{motion}",
            self.child,
            self.parent,
            self.swung_rad.to_degrees()
        )
    }

    /// What has to be assumed where there is no odometry, in words.
    pub(super) fn assumed(&self) -> Option<String> {
        let words = "nothing says how the robot moves while its laser swings: during a swing of more than 1.5 s it is taken to stand";
        (!self.has_odometry).then(|| words.to_owned())
    }
}

/// A scan that waits for the transforms of its joint.
#[derive(Debug)]
struct Waiting {
    stamp: Stamp,
    end: Stamp,
    recorded: Stamp,
    laser: LaserModel,
    ranges_m: Vec<f32>,
    intensities: Vec<f32>,
}

/// A cloud of one swing, in the sensor's frame at `stamp`.
#[derive(Debug, Default)]
pub(super) struct Swing {
    pub(super) stamp: Stamp,
    pub(super) points_m: Vec<[f32; 3]>,
    pub(super) times_s: Vec<f32>,
    pub(super) intensities: Vec<f32>,
    /// How far the joint has turned, radians.
    pub(super) turned_rad: f64,
}

/// The swing that is going on.
#[derive(Debug, Default)]
struct Going {
    /// Points at their times, in the robot's frame of the first scan where odometry says how it moved, else in that of their time.
    points_m: Vec<[f64; 3]>,
    stamps: Vec<Stamp>,
    intensities: Vec<f32>,
    odom_from_robot: Option<Pose3>,
    end_from_odom: Option<Pose3>,
    end: Stamp,
    last: Option<UnitQuaternion<f64>>,
    /// The direction in which it turns, and by how much already.
    turned: Vector3<f64>,
    back_rad: f64,
}

/// Puts scans of a laser that tilts together.
#[derive(Debug)]
pub(super) struct Tilting {
    joint: Joint,
    robot_from_sensor: Pose3,
    turns: OdometryTrack<Pose3>,
    waiting: VecDeque<Waiting>,
    going: Going,
    ready: Vec<Swing>,
}

impl Tilting {
    pub(super) fn new(joint: Joint, robot_from_sensor: Pose3) -> Self {
        let (turns, waiting, going, ready) = Default::default();
        Self { joint, robot_from_sensor, turns, waiting, going, ready }
    }

    /// Hears a transform, with its stamp.
    pub(super) fn hear(&mut self, transform: &TransformStamped<'_>, stamp: Stamp) {
        let is_its =
            transform.header.frame() == self.joint.parent && bare(&transform.child_frame_id) == self.joint.child;
        if let Some(pose) = transform.transform.to_pose3().filter(|pose| is_its && pose.is_finite()) {
            self.turns.add(OdometryReading { stamp, odom_from_robot: pose, is_anew: false });
        }
    }

    /// Takes in a scan, with its stamp and when it was recorded.
    ///
    /// # Errors
    /// Why its head cannot be used, in words.
    pub(super) fn add(&mut self, scan: &LaserScan<'_>, stamp: Stamp, recorded: Stamp) -> Result<(), String> {
        let (laser, _) = scan.laser(&Mounting::IDENTITY).map_err(|error| error.to_string())?;
        let ranges_m = scan.ranges.to_vec();
        let lasts_s = laser.beam_period_s * ranges_m.len().saturating_sub(1) as f64;
        let intensities = if scan.intensities.len() == ranges_m.len() { scan.intensities.to_vec() } else { Vec::new() };
        let end = after(stamp, lasts_s);
        self.waiting.push_back(Waiting { stamp, end, recorded, laser, ranges_m, intensities });
        Ok(())
    }

    /// The swings that have ended, given odometry and the time of recording; how many scans no transform says anything of.
    pub(super) fn ended(&mut self, wheels: &OdometryTrack<Pose3>, now: Stamp, is_end: bool) -> (Vec<Swing>, usize) {
        let mut lost = 0;
        while let Some(first) = self.waiting.front() {
            let is_known = self.turns.newest().is_some_and(|newest| newest.stamp >= first.end);
            let is_counted =
                !self.joint.has_odometry || wheels.newest().is_some_and(|newest| newest.stamp >= first.end);
            let is_late = now.secs_since(first.recorded) > WINDOW_S || self.waiting.len() > WINDOW_MESSAGES;
            if !(is_known && is_counted || is_late || is_end) {
                break;
            }
            let Some(scan) = self.waiting.pop_front() else { break };
            lost += usize::from(!self.join(&scan, wheels));
        }
        if is_end {
            self.end();
        }
        (std::mem::take(&mut self.ready), lost)
    }

    /// Adds a scan to the swing; false where no transform says where its laser was.
    fn join(&mut self, scan: &Waiting, wheels: &OdometryTrack<Pose3>) -> bool {
        let ends = self.turns.between(scan.stamp).zip(self.turns.between(scan.end));
        let Some((before, after)) = ends else { return false };
        if self.turns_back(&after.rotation) || self.is_whole(scan) {
            self.end();
        }
        let odometry = || Some([wheels.at(scan.stamp)?, wheels.at(scan.end)?]);
        let odometry = if self.joint.has_odometry { odometry() } else { None };
        if self.joint.has_odometry && odometry.is_none() != self.going.odom_from_robot.is_none() {
            self.end();
        }
        self.going.turn(&after.rotation);
        let (lasts_s, beams) = (scan.end.secs_since(scan.stamp), scan.ranges_m.len());
        let way = odometry.map(|[first, last]| first.between(last).log());
        let in_range = scan.laser.range_min_m as f32..scan.laser.range_max_m as f32;
        let going = &mut self.going;
        if going.odom_from_robot.is_none() {
            going.odom_from_robot = odometry.map(|[first, _]| first);
        }
        let first_from_scan = odometry.zip(going.odom_from_robot).map(|([now, _], first)| first.between(now));
        for (beam, range_m) in scan.ranges_m.iter().enumerate().filter(|(_, range_m)| in_range.contains(*range_m)) {
            let share = beam as f64 / beams.saturating_sub(1).max(1) as f64;
            let taken = self::after(scan.stamp, lasts_s * share);
            let parent_from_child = self.turns.between(taken).unwrap_or(before);
            let (sin, cos) = scan.laser.bearing_in_robot(beam).sin_cos();
            let in_laser = Vector3::new(cos, sin, 0.0) * f64::from(*range_m);
            let in_child = self.joint.child_from_laser.transform(in_laser);
            let in_robot = self.joint.robot_from_parent.transform(parent_from_child.transform(in_child));
            let kept = match first_from_scan.zip(way) {
                Some((first_from_scan, way)) => (first_from_scan * Pose3::exp(way * share)).transform(in_robot),
                None => in_robot,
            };
            going.points_m.push(kept.into());
            going.stamps.push(taken);
            going.intensities.extend(scan.intensities.get(beam));
        }
        going.end = scan.end;
        going.end_from_odom = odometry.map(|[_, last]| last.inverse());
        true
    }

    /// Whether the joint turns back with this.
    fn turns_back(&mut self, now: &UnitQuaternion<f64>) -> bool {
        let going = &mut self.going;
        let Some(last) = going.last.filter(|_| going.turned.norm() > BACK_RAD) else { return false };
        let step = (last.inverse() * now).scaled_axis();
        let along = step.dot(&going.turned.normalize());
        going.back_rad = if along < 0.0 { going.back_rad - along } else { 0.0 };
        going.back_rad > BACK_RAD
    }

    /// Whether the swing has seen all that it can, or has lasted for too long: a laser that sees half of its plane has seen all after half
    /// a turn, another one after a whole one.
    fn is_whole(&self, scan: &Waiting) -> bool {
        let going = &self.going;
        let sees_rad = scan.laser.angle_step_rad.abs() * scan.ranges_m.len() as f64;
        let whole_rad = if sees_rad >= PI { PI } else { TAU };
        let lasts_s = going.stamps.first().map_or(0.0, |first| scan.end.secs_since(*first).abs());
        going.turned.norm() >= whole_rad
            || lasts_s > SWING_MOST_S
            || going.points_m.len() + scan.ranges_m.len() > POINTS_AT_MOST
    }

    /// The swing that is going on is a cloud, and the next begins.
    fn end(&mut self) {
        let going = std::mem::take(&mut self.going);
        self.going.last = going.last;
        let (Some(first), false) = (going.stamps.first().copied(), going.points_m.is_empty()) else { return };
        let lasts_s = going.end.secs_since(first);
        let keeps_times = !self.joint.has_odometry && lasts_s <= TIMES_MOST_S;
        let end_from_first = going.odom_from_robot.zip(going.end_from_odom).map(|(first, end)| end * first);
        let sensor_from_robot = self.robot_from_sensor.inverse();
        let sensor_from_kept = end_from_first.map_or(sensor_from_robot, |moved| sensor_from_robot * moved);
        let in_sensor = |point: &[f64; 3]| -> [f32; 3] {
            let there = sensor_from_kept.transform(Vector3::from(*point));
            [there.x as f32, there.y as f32, there.z as f32]
        };
        let times_s = going.stamps.iter().map(|stamp| stamp.secs_since(first) as f32);
        self.ready.push(Swing {
            stamp: if keeps_times { first } else { going.end },
            points_m: going.points_m.iter().map(in_sensor).collect(),
            times_s: if keeps_times { times_s.collect() } else { Vec::new() },
            intensities: if going.intensities.len() == going.points_m.len() { going.intensities } else { Vec::new() },
            turned_rad: going.turned.norm(),
        });
    }
}

impl Swing {
    /// Whether it is a cloud rather than a plane.
    pub(super) fn is_cloud(&self) -> bool {
        self.turned_rad > SWING_LEAST_RAD
    }
}

impl Going {
    fn turn(&mut self, now: &UnitQuaternion<f64>) {
        if let Some(last) = self.last {
            self.turned += (last.inverse() * now).scaled_axis();
        }
        self.last = Some(*now);
    }
}

fn after(stamp: Stamp, s: f64) -> Stamp {
    Stamp(stamp.0.saturating_add(Stamp::from_secs_f64(s).0))
}
