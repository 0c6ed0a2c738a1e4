//! Robots that have nothing in common but that they saw each other end with one map.
#![allow(clippy::expect_used, clippy::panic, reason = "a test may fail loudly")]

mod support;

use mapwright::{Detection, Mapper, Pose2, RunId, Session, Settings, Verdict};
use mapwright_fleet::{SightedRobot, Team};
use mapwright_sim::{Drive, DriveSettings, Rng, Site, TrueScan, worlds};
use std::sync::Arc;
use support::{at, name, node, radio};

/// What the sensor is worth, metres and radians.
const RANGE_SIGMA_M: f64 = 0.10;
const BEARING_SIGMA_RAD: f64 = 0.007;
/// Seconds from one step of the simulation to the next.
const STEP_S: f64 = 0.1;

struct Robot {
    mapper: Mapper,
    team: Team,
    scans: Vec<TrueScan>,
    /// Where its building stands in the world of all.
    world_from_site: Pose2,
}

impl Robot {
    fn new(count: usize, k: usize, site: Site, world_from_site: Pose2, start_waypoint: usize) -> Self {
        let settings = DriveSettings { start_waypoint, duration_s: 40.0, seed: k as u64, ..DriveSettings::default() };
        let scans = Drive::new(Arc::new(site), settings).scans().collect();
        let mapper = Mapper::of_run(Settings::default(), RunId::of_robot(&name(k)), Pose2::IDENTITY).expect("valid");
        let team = Team::new(node(count, k, 0), Settings::default()).expect("valid");
        Self { mapper, team, scans, world_from_site }
    }

    fn truth(&self, scan: usize) -> Pose2 {
        self.world_from_site * self.scans[scan.min(self.scans.len() - 1)].world_from_robot
    }

    /// What it sees of another one at a scan.
    fn sees(&self, other: &Self, observed: u16, scan: usize, rng: &mut Rng, off_m: f64) -> SightedRobot {
        let [x, y] = {
            let seen = self.truth(scan).between(other.truth(scan));
            [seen.x, seen.y]
        };
        let [before, now] = [scan.saturating_sub(3), scan].map(|k| self.scans[k].world_from_robot);
        let seconds = self.scans[scan].scan.stamp.secs_since(self.scans[scan.saturating_sub(3)].scan.stamp);
        let [ahead, _, turn] = before.between(now).log();
        let pose = self.mapper.session().scans()[scan];
        SightedRobot {
            stamp: self.scans[scan].scan.stamp,
            keyframe: pose.keyframe.expect("one"),
            keyframe_from_robot: pose.keyframe_from_robot,
            velocity: [ahead / seconds, turn / seconds],
            observed,
            range_m: x.hypot(y) + off_m + rng.normal(RANGE_SIGMA_M),
            bearing_rad: y.atan2(x) + rng.normal(BEARING_SIGMA_RAD),
            sigmas: [RANGE_SIGMA_M, BEARING_SIGMA_RAD],
        }
    }
}

/// Two robots drive; both see the other at some scans, by so much farther than they are. All who drive end with the same map.
fn drive(robots: &mut [Robot; 2], seen_at: &[usize], off_m: f64, loss: f64, seed: u64) -> Session {
    let mut air = radio(seed, loss);
    let mut rng = Rng::new(seed);
    for tick in 0..3000_i64 {
        let scan = tick as usize;
        if scan < robots[0].scans.len().min(robots[1].scans.len()) {
            for robot in robots.iter_mut() {
                let update = robot.mapper.add_scan(&robot.scans[scan].scan);
                robot.team.tell(at(tick), &update);
            }
            if seen_at.contains(&scan) {
                let seen = [
                    robots[0].sees(&robots[1], 1, scan, &mut rng, off_m),
                    robots[1].sees(&robots[0], 0, scan, &mut rng, off_m),
                ];
                robots.iter_mut().zip(seen).for_each(|(robot, seen)| robot.team.tell_sightings(&[seen]));
            }
        } else {
            robots.iter_mut().for_each(|robot| robot.team.finish());
        }
        for from in 0..2 {
            for out in robots[from].team.poll(at(tick)) {
                air.send(at(tick), 1 - from, &out.bytes, true);
            }
        }
        for arrival in air.receive(at(tick)) {
            robots[arrival.to].team.receive(at(tick), &arrival.bytes);
        }
        let has_worked = robots.iter_mut().fold(false, |has, robot| robot.team.work(at(tick), 64) | has);
        let is_over = scan > robots[0].scans.len() + (20.0 / STEP_S) as usize && !has_worked && tick % 20 == 0;
        if is_over && is_agreed(robots) {
            return robots[1].team.map().expect("a map").clone();
        }
    }
    panic!("they do not agree");
}

fn is_agreed(robots: &[Robot; 2]) -> bool {
    let maps: Vec<&Session> = robots.iter().filter_map(|robot| robot.team.map()).collect();
    let [a, b] = maps[..] else { return false };
    let has_all = |robot: &Robot| robot.mapper.keyframes().last().is_some_and(|last| a.place(last.id).is_some());
    a.encode() == b.encode() && robots.iter().all(has_all)
}

/// How far the last keyframe of one robot lies from the truth, in the frame of a keyframe of the other one: metres and radians.
fn error(robots: &[Robot; 2], map: &Session, scan: usize) -> [f64; 2] {
    let pose = |robot: &Robot| {
        let own = robot.mapper.session().scans()[scan];
        let place = map.place(own.keyframe.expect("one")).expect("in the map");
        map.map_from_keyframe()[place] * own.keyframe_from_robot
    };
    let found = pose(&robots[0]).between(pose(&robots[1]));
    let by = robots[0].truth(scan).between(robots[1].truth(scan)).between(found);
    [by.x.hypot(by.y), by.theta.abs()]
}

/// Where a keyframe truly was taken.
fn truth_of(robots: &[Robot; 2], id: mapwright::KeyframeId) -> Pose2 {
    let own = |robot: &Robot| robot.mapper.session().place(id).map(|at| robot.mapper.keyframes()[at].scan);
    robots.iter().find_map(|robot| Some(robot.truth(own(robot)? as usize))).expect("its robot")
}

fn strangers(seed: u64) -> [Robot; 2] {
    // What one robot sees is nowhere in what the other one sees: two buildings of which the second stands askew, as if behind a wall.
    [
        Robot::new(2, 0, worlds::three_rooms(seed), Pose2::IDENTITY, 0),
        Robot::new(2, 1, worlds::three_rooms(seed + 50), Pose2::new(3.0, 2.0, 1.0), 2),
    ]
}

#[test]
fn robots_without_a_place_in_common_are_joined_by_what_they_saw_of_each_other() {
    for (seed, seen_at) in [(1, &[200][..]), (2, &[150, 153, 156]), (3, &[100, 300])] {
        let mut robots = strangers(seed);
        let map = drive(&mut robots, seen_at, 0.0, 0.3, seed);
        assert_eq!(map.maps().len(), 1, "seed {seed}");
        let sighted: Vec<_> = map.candidates().iter().filter(|c| c.detection == Detection::Sighting).collect();
        assert!(!sighted.is_empty() && sighted.iter().all(|c| c.verdict == Verdict::Accepted), "seed {seed}");
        // The error of the map at the sighting is one that its covariance allows: chi-square with three degrees of freedom, once in a thousand.
        for known in sighted {
            let [from, to] = [known.from, known.to].map(|id| map.map_from_keyframe()[map.place(id).expect("there")]);
            let [from_true, to_true] = [known.from, known.to].map(|id| truth_of(&robots, id));
            let off = from_true.between(to_true).between(from.between(to)).to_vector();
            let chi2 = (off.transpose() * known.covariance.try_inverse().expect("a covariance") * off)[0];
            assert!(chi2 < 16.3, "seed {seed}: {chi2}");
            let sigma_m = known.covariance[(0, 0)].max(known.covariance[(1, 1)]).sqrt();
            assert!((0.01..0.5).contains(&sigma_m), "seed {seed}: {sigma_m} m");
        }
    }
}

#[test]
fn robots_that_saw_nobody_and_nothing_in_common_have_maps_of_their_own() {
    let mut robots = strangers(4);
    let map = drive(&mut robots, &[], 0.0, 0.0, 4);
    assert_eq!(map.maps().len(), 2);
}

#[test]
fn a_sighting_that_closures_contradict_is_withdrawn() {
    let site = || worlds::three_rooms(5);
    let mut robots = [Robot::new(2, 0, site(), Pose2::IDENTITY, 0), Robot::new(2, 1, site(), Pose2::IDENTITY, 2)];
    let map = drive(&mut robots, &[390], 4.0, 0.0, 6);
    let sighted: Vec<_> = map.candidates().iter().filter(|c| c.detection == Detection::Sighting).collect();
    assert_eq!((map.maps().len(), sighted.len()), (1, 1));
    assert!(matches!(sighted[0].verdict, Verdict::Withdrawn(_)), "{:?}", sighted[0].verdict);
    let [off_m, turned_rad] = error(&robots, &map, 390);
    assert!(off_m < 0.1 && turned_rad < 0.02, "{off_m} m, {turned_rad} rad");
}
