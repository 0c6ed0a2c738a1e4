//! Robots that know of each other what they are told over the air: each has a map of its own of what all have mapped.

use super::team::{CELL_M, PASSES_PER_HIT, Points};
use super::{RADIUS_M, REACH_M};
use crate::failure::Failure;
use crate::robots::Simulated;
use mapwright::{KeyframeId, LaserScan, Pose2, Session, Settings, Stamp, Sweep};
use mapwright_eval::{Alignment, PosePair, ate_of_pairs};
use mapwright_explore::{Decides, Explorer, OccupancyMap, SharedMap};
use mapwright_fleet::{Intent, SightedRobot};
use mapwright_sim::{RadioSettings, Rng, RobotSettings, Rovers};
use std::collections::BTreeMap;
use std::sync::Arc;

/// Robots hear each other so far in the open, metres; each thing between them costs so much of it.
const HEARD_M: f64 = 50.0;
const THING_M: f64 = 4.0;
/// They see each other's tags so near, metres, and say so every so many seconds.
const SIGHT_M: f64 = 5.0;
const SIGHTED_EVERY_S: f64 = 10.0;
/// Standard deviations of what they see then: metres, radians.
const SIGHT_SIGMAS: [f64; 2] = [0.05, 0.01];

/// The robots, the air between them, and what each makes of what it was told.
pub(super) struct Told {
    pub(super) air: Simulated,
    views: Vec<View>,
    points: Points,
    rng: Rng,
    now: Stamp,
    /// When two robots saw each other last, seconds.
    sighted_s: BTreeMap<(usize, usize), f64>,
}

/// What a robot knows.
struct View {
    map: SharedMap,
    drawn: BTreeMap<KeyframeId, Drawn>,
    /// How often it was brought up to date.
    follows: u32,
    /// Its own map in the one that it drives by: that of all as soon as it is in it.
    map_from_own: Pose2,
    own_from_odom: Pose2,
}

/// A keyframe in a robot's map.
#[derive(Default)]
struct Drawn {
    at: Option<(Arc<Sweep>, Pose2)>,
    /// When it was wanted last.
    follows: u32,
}

impl View {
    /// A keyframe is wanted there.
    fn want(&mut self, session: &Session, place: usize, map_from_session: Pose2, points: &mut Points) {
        let (id, pose) = (session.keyframes()[place].id, session.map_from_keyframe()[place]);
        let drawn = self.drawn.entry(id).or_default();
        if drawn.follows != self.follows {
            drawn.follows = self.follows;
            let wanted = session.drawn()[place].as_ref().map(|sweep| (sweep, map_from_session * pose));
            points.redraw(&mut self.map, &mut drawn.at, wanted);
        }
    }

    /// Takes out what is not wanted any more.
    fn forget_others(&mut self, points: &mut Points) {
        let (map, follows) = (&mut self.map, self.follows);
        self.drawn.retain(|_, drawn| {
            let is_wanted = drawn.follows == follows;
            if !is_wanted {
                points.redraw(map, &mut drawn.at, None);
            }
            is_wanted
        });
    }
}

impl Told {
    pub(super) fn new(settings: &Settings, robots: usize, radio: RadioSettings) -> Result<Self, Failure> {
        let names: Vec<String> = (1..=robots).map(|number| format!("robot-{number}")).collect();
        let view = || View {
            map: SharedMap::new(CELL_M, PASSES_PER_HIT),
            drawn: BTreeMap::new(),
            follows: 0,
            map_from_own: Pose2::IDENTITY,
            own_from_odom: Pose2::IDENTITY,
        };
        Ok(Self {
            air: Simulated::new(&names, *settings, radio)?,
            views: (0..robots).map(|_| view()).collect(),
            points: Points::default(),
            rng: Rng::keyed(radio.seed, 0x0074_6167),
            now: Stamp(0),
            sighted_s: BTreeMap::new(),
        })
    }

    /// Takes in a robot's scan; whether it is part of the map.
    pub(super) fn add_scan(&mut self, number: usize, scan: &LaserScan) -> bool {
        let (mut is_keyframe, mut own_from_robot) = (false, Pose2::IDENTITY);
        self.air.map(number, self.now, |mapper| {
            let update = mapper.add_scan(scan);
            (is_keyframe, own_from_robot) = (update.keyframe.is_some(), update.map_from_robot);
            Some(update)
        });
        if let Some(odom_from_robot) = scan.odom_from_robot {
            self.views[number].own_from_odom = own_from_robot * odom_from_robot.inverse();
        }
        is_keyframe
    }

    pub(super) fn map_from_robot(&self, number: usize, odom_from_robot: Pose2) -> Pose2 {
        let view = &self.views[number];
        view.map_from_own * view.own_from_odom * odom_from_robot
    }

    pub(super) fn map(&self, number: usize) -> &OccupancyMap {
        self.views[number].map.map()
    }

    pub(super) fn shared(&mut self, number: usize) -> &mut SharedMap {
        &mut self.views[number].map
    }

    pub(super) fn forget(&mut self, now_s: f64) {
        self.views.iter_mut().for_each(|view| view.map.forget(now_s));
    }

    /// All say and hear what is to be said.
    pub(super) fn step(&mut self, now_s: f64) {
        self.now = Stamp((now_s * 1e9) as i64);
        self.air.step(self.now, now_s);
        self.air.note_joins(now_s);
    }

    /// Who hears whom from now on, and who sees whom.
    pub(super) fn look(&mut self, rovers: &Rovers, now_s: f64) {
        let robots = self.air.robots.len();
        self.air.reach = vec![vec![true; robots]; robots];
        for (a, b) in (0..robots).flat_map(|a| (a + 1..robots).map(move |b| (a, b))) {
            let apart_m = rovers.world_from_robot(a).distance(rovers.world_from_robot(b));
            let things = rovers.between(a, b);
            let hears = apart_m + THING_M * things as f64 <= HEARD_M;
            (self.air.reach[a][b], self.air.reach[b][a]) = (hears, hears);
            let is_due = self.sighted_s.get(&(a, b)).is_none_or(|before_s| now_s - before_s >= SIGHTED_EVERY_S);
            let are_alive = [a, b].iter().all(|&robot| self.air.robots[robot].is_alive);
            if things == 0 && apart_m <= SIGHT_M && is_due && are_alive {
                self.sighted_s.insert((a, b), now_s);
                self.see(rovers, a, b);
                self.see(rovers, b, a);
            }
        }
    }

    /// One robot sees another one's tag.
    fn see(&mut self, rovers: &Rovers, observer: usize, observed: usize) {
        let observed_rank = self.air.robots[observed].team.node().me().rank;
        let seen = rovers.world_from_robot(observer).between(rovers.world_from_robot(observed));
        let own_from_robot = self.views[observer].own_from_odom * rovers.odom_from_robot(observer);
        let own = self.air.robots[observer].mapper.session();
        let Some((keyframe, pose)) = own.keyframes().iter().zip(own.map_from_keyframe()).next_back() else { return };
        let twist = rovers.twist(observer);
        let [range_sigma_m, bearing_sigma_rad] = SIGHT_SIGMAS;
        let sighted = SightedRobot {
            stamp: self.now,
            keyframe: keyframe.id,
            keyframe_from_robot: pose.between(own_from_robot),
            velocity: [twist.speed_m_per_s, twist.turn_rate_rad_per_s],
            observed: observed_rank,
            range_m: (seen.x.hypot(seen.y) + self.rng.normal(range_sigma_m)).max(0.01),
            bearing_rad: seen.y.atan2(seen.x) + self.rng.normal(bearing_sigma_rad),
            sigmas: SIGHT_SIGMAS,
        };
        self.air.robots[observer].team.tell_sightings(&[sighted]);
    }

    /// A robot's map becomes what it was told up to now.
    pub(super) fn follow(&mut self, number: usize) {
        let robot = &self.air.robots[number];
        let own = robot.mapper.session();
        let joined = robot.team.map().zip(robot.team.map_from_own(own));
        let newest = |all: &Session| own.keyframes().iter().rev().find_map(|keyframe| all.place(keyframe.id));
        let map_from_own = joined.map_or(Pose2::IDENTITY, |(_, map_from_own)| map_from_own);
        let (view, points) = (&mut self.views[number], &mut self.points);
        view.map_from_own = map_from_own;
        view.follows += 1;
        if let Some((all, newest)) = joined.and_then(|(all, _)| Some((all, newest(all)?)))
            && let Some(map) = all.maps().iter().find(|map| map.has(newest))
        {
            map.places().for_each(|place| view.want(all, place, Pose2::IDENTITY, points));
        }
        for place in 0..own.keyframes().len() {
            let is_told = joined.is_some_and(|(all, _)| all.place(own.keyframes()[place].id).is_some());
            if !is_told {
                view.want(own, place, map_from_own, points);
            }
        }
        view.forget_others(points);
    }

    /// A robot says where it is and where it goes.
    pub(super) fn say(&mut self, number: usize, odom_from_robot: Pose2, goal_m: Option<[f64; 2]>) {
        let view = &self.views[number];
        let robot = &mut self.air.robots[number];
        let own = robot.mapper.session();
        let is_told = |id: KeyframeId| robot.team.map().is_some_and(|all| all.place(id).is_some());
        let newest = own.keyframes().iter().zip(own.map_from_keyframe()).rev();
        let told = newest.clone().find(|(keyframe, _)| is_told(keyframe.id));
        let Some((keyframe, own_from_keyframe)) = told.or_else(|| newest.clone().next()) else { return };
        let keyframe_from_map = (view.map_from_own * *own_from_keyframe).inverse();
        let intent = Intent {
            keyframe: keyframe.id,
            keyframe_from_robot: own_from_keyframe.between(view.own_from_odom * odom_from_robot),
            keyframe_from_goal_m: goal_m.map(|goal_m| keyframe_from_map.transform(goal_m)),
            radius_m: RADIUS_M,
            speed_m_per_s: RobotSettings::default().speed_m_per_s,
            reach_m: REACH_M,
        };
        robot.team.tell_intent(&intent);
    }

    /// The others as a robot was told they are, those that it has in its map.
    pub(super) fn others(&self, number: usize) -> Vec<Explorer> {
        let robot = &self.air.robots[number];
        let Some(all) = robot.team.map() else { return Vec::new() };
        let explorer = |(rank, heard, intent): (u16, Stamp, Intent)| {
            let id = self.air.robots.iter().position(|other| other.team.node().me().rank == rank)?;
            self.views[number].drawn.get(&intent.keyframe)?;
            let map_from_keyframe = *all.map_from_keyframe().get(all.place(intent.keyframe)?)?;
            let goal_m = intent.keyframe_from_goal_m.map(|goal_m| map_from_keyframe.transform(goal_m));
            Some(Explorer {
                id: id as u32,
                map_from_robot: map_from_keyframe * intent.keyframe_from_robot,
                heard_s: heard.as_secs_f64(),
                radius_m: intent.radius_m,
                speed_m_per_s: intent.speed_m_per_s,
                reach_m: intent.reach_m,
                decides: Decides::Itself { goal_m },
            })
        };
        robot.team.intents(self.now).filter_map(explorer).collect()
    }

    /// How far the keyframes of all lie from the truth, metres, rmse: in the map of the first robot that is alive, moved onto the truth.
    pub(super) fn error_m(&self, taken: &[Vec<(u64, Pose2)>]) -> Option<f64> {
        let all = self.air.robots.iter().filter(|robot| robot.is_alive).find_map(|robot| robot.team.map())?;
        let maps = all.maps();
        let pairs = maps.first()?.places().filter_map(|place| {
            let keyframe = &all.keyframes()[place];
            let own = |number: usize| {
                let session = self.air.robots[number].mapper.session();
                Some((number, session.keyframes()[session.place(keyframe.id)?].scan))
            };
            let (number, scan) = (0..self.air.robots.len()).find_map(own)?;
            let at = taken[number].binary_search_by_key(&scan, |(scan, _)| *scan).ok()?;
            let (world_from_robot, map_from_robot) = (taken[number][at].1, all.map_from_keyframe()[place]);
            Some(PosePair { stamp: keyframe.stamp, world_from_robot, map_from_robot })
        });
        let ate = ate_of_pairs(&pairs.collect::<Vec<_>>(), Alignment::Rigid).ok()?;
        Some(ate.translation_m.rmse)
    }

    /// Nobody drives any more: what is left to be said is said, until all have the same map. Seconds that it took; none where they do not agree.
    pub(super) fn settle(&mut self, now_s: f64, at_most_s: f64) -> Option<f64> {
        for number in 0..self.air.robots.len() {
            self.air.map(number, self.now, |mapper| Some(mapper.look_again()));
            self.air.robots[number].team.finish();
        }
        let steps = (at_most_s / super::STEP_S) as u32;
        for step in 1..=steps {
            let after_s = f64::from(step) * super::STEP_S;
            self.step(now_s + after_s);
            if after_s >= 15.0 && step % 10 == 0 && self.air.is_agreed() {
                return Some(after_s);
            }
        }
        None
    }
}
