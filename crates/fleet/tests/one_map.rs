//! Robots of one team end with one map, the same to the byte, and it is right.
#![allow(clippy::expect_used, clippy::panic, reason = "a test may fail loudly")]

mod support;

use mapwright::{Mapper, Pose2, RunId, Session, Settings};
use mapwright_fleet::{Kind, Team};
use mapwright_sim::{Drive, DriveSettings, TrueScan, worlds};
use support::{at, name, node, radio};

/// A pose that is farther off is wrong, metres.
const RIGHT_M: f64 = 0.2;

struct Robot {
    mapper: Mapper,
    team: Team,
    scans: Vec<TrueScan>,
    next: usize,
    is_alive: bool,
}

fn robots(count: usize, duration_s: f64) -> Vec<Robot> {
    let site = std::sync::Arc::new(worlds::office_floor(3));
    let robot = |k: usize| {
        let settings = DriveSettings { start_waypoint: 4 * k, duration_s, seed: k as u64, ..DriveSettings::default() };
        let scans = Drive::new(std::sync::Arc::clone(&site), settings).scans().collect();
        let mapper = Mapper::of_run(Settings::default(), RunId::of_robot(&name(k)), Pose2::IDENTITY).expect("valid");
        let team = Team::new(node(count, k, 0), Settings::default()).expect("valid");
        Robot { mapper, team, scans, next: 0, is_alive: true }
    };
    (0..count).map(robot).collect()
}

/// Drives until all who live have one map; a robot may die at a tick.
fn drive(robots: &mut [Robot], radio: (u64, f64), dies: Option<(usize, i64)>) -> i64 {
    drive_with(robots, radio, dies, |_| ())
}

/// The same; calls at every tick.
fn drive_with(
    robots: &mut [Robot],
    (seed, loss): (u64, f64),
    dies: Option<(usize, i64)>,
    call: impl Fn(&mut [Robot]),
) -> i64 {
    let mut air = radio(seed, loss);
    for tick in 0..9000 {
        let seconds = tick as f64 * 0.1;
        call(robots);
        for (k, robot) in robots.iter_mut().enumerate() {
            robot.is_alive &= dies != Some((k, tick));
            let first = robot.scans[0].scan.stamp;
            while robot.is_alive
                && let Some(scan) = robot.scans.get(robot.next)
                && scan.scan.stamp.secs_since(first) <= seconds
            {
                let update = robot.mapper.add_scan(&scan.scan);
                robot.team.tell(at(tick), &update);
                robot.next += 1;
                if robot.next == robot.scans.len() {
                    robot.team.finish();
                }
            }
        }
        for from in (0..robots.len()).filter(|&k| robots[k].is_alive).collect::<Vec<_>>() {
            for out in robots[from].team.poll(at(tick)) {
                for to in
                    (0..robots.len()).filter(|to| *to != from && out.to.is_none_or(|wanted| usize::from(wanted) == *to))
                {
                    air.send(at(tick), to, &out.bytes, true);
                }
            }
        }
        for arrival in air.receive(at(tick)) {
            robots[arrival.to].team.receive(at(tick), &arrival.bytes);
        }
        let mut has_worked = false;
        for robot in robots.iter_mut().filter(|robot| robot.is_alive) {
            has_worked |= robot.team.work(at(tick), 64);
        }
        let has_driven = robots.iter().all(|robot| !robot.is_alive || robot.next == robot.scans.len());
        if has_driven && !has_worked && tick % 50 == 0 && is_agreed(robots) {
            return tick;
        }
    }
    panic!("they do not agree");
}

fn is_agreed(robots: &[Robot]) -> bool {
    let alive: Vec<&Robot> = robots.iter().filter(|robot| robot.is_alive).collect();
    let maps: Option<Vec<Vec<u8>>> = alive.iter().map(|robot| robot.team.map().map(Session::encode)).collect();
    let has_all = |map: &Session| {
        alive.iter().all(|r| r.mapper.keyframes().last().is_some_and(|last| map.place(last.id).is_some()))
    };
    alive.iter().all(|robot| robot.team.has_audited())
        && maps.is_some_and(|maps| maps.windows(2).all(|pair| pair[0] == pair[1]))
        && alive[0].team.map().is_some_and(has_all)
}

/// Keyframes that are wrong relative to the first one.
fn misplaced(robots: &[Robot], map: &Session) -> usize {
    let truth = |at: usize| {
        let keyframe = &map.keyframes()[at];
        let robot = robots.iter().find(|robot| robot.mapper.session().place(keyframe.id).is_some()).expect("its robot");
        let own = &robot.mapper.keyframes()[robot.mapper.session().place(keyframe.id).expect("there")];
        robot.scans[own.scan as usize].world_from_robot
    };
    let poses = map.map_from_keyframe();
    let error_m = |at: usize| truth(0).between(truth(at)).distance(poses[0].between(poses[at]));
    (0..poses.len()).filter(|at| error_m(*at) > RIGHT_M).count()
}

#[test]
fn three_robots_have_one_map_over_a_bad_radio() {
    let mut robots = robots(3, 150.0);
    drive(&mut robots, (5, 0.4), None);
    let map = robots[2].team.map().expect("a map");
    assert_eq!((map.pieces().len(), misplaced(&robots, map)), (1, 0));
    assert!(robots.iter().map(|robot| robot.team.is_solving()).eq([true, false, false]));
    // What is written down is the same session, and each robot knows where its own map lies.
    let (read, report) = Session::read(&map.encode()).expect("a session");
    assert!(report.is_whole() && &read == map);
    for robot in &robots {
        let map_from_own = robot.team.map_from_own(robot.mapper.session()).expect("it is in the map");
        let (own, last) = (robot.mapper.session(), robot.mapper.keyframes().last().expect("keyframes"));
        let place = map.place(last.id).expect("there");
        let pose = map_from_own * *own.map_from_keyframe().last().expect("a pose");
        assert!(pose.distance(map.map_from_keyframe()[place]) < 1e-9);
    }
}

#[test]
fn the_map_goes_on_when_the_robot_that_solves_dies() {
    let mut robots = robots(3, 150.0);
    drive(&mut robots, (5, 0.1), Some((0, 700)));
    let map = robots[1].team.map().expect("a map");
    let of_dead =
        map.keyframes().iter().filter(|keyframe| keyframe.id.robot == RunId::of_robot(&name(0)).robot).count();
    assert_eq!((map.pieces().len(), misplaced(&robots, map)), (1, 0));
    assert!(of_dead > 20 && robots[1].team.is_solving(), "{of_dead} keyframes of the dead robot");
}

/// Records of a solution come late and in pieces, robots take each other for dead: who was not believed for that has to be believed again, and
/// nobody begins one solution after the other.
#[test]
fn robots_agree_where_most_messages_are_lost() {
    for seed in 0..4 {
        let mut robots = robots(4, 20.0);
        drive(&mut robots, (seed, 0.88), Some((1, 120)));
        let begun = |robot: &Robot| {
            let own = &robot.team.node().chains()[&robot.team.node().me()];
            own.records().iter().filter(|record| record.kind == Kind::Solution).count()
        };
        let most = robots.iter().map(begun).max().expect("robots");
        assert!(most < 200, "{most} records of solutions, seed {seed}");
    }
}

#[test]
fn a_robot_that_outbids_others_and_solves_nothing_is_passed_over() {
    let mut robots = robots(3, 60.0);
    drive_with(&mut robots, (5, 0.1), None, |robots| robots[0].team.outbid());
    let map = robots[2].team.map().expect("a map");
    assert_eq!((map.pieces().len(), misplaced(&robots, map)), (1, 0));
    assert!(robots[1].team.is_solving() && !robots[2].team.is_solving());
}

/// A map without keyframes says nothing that could be untrue.
#[test]
fn robots_that_are_switched_on_long_before_they_drive_believe_each_other() {
    let mut teams = [0, 1].map(|k| Team::new(node(2, k, 0), Settings::default()).expect("valid"));
    for tick in 0..400 {
        for from in [0, 1] {
            for out in teams[from].poll(at(tick)) {
                teams[1 - from].receive(at(tick), &out.bytes);
            }
        }
        teams.iter_mut().for_each(|team| {
            team.work(at(tick), 64);
        });
    }
    assert!(teams.iter().all(|team| team.has_audited() && team.node().refused().next().is_none()));
    assert!(teams.iter().all(|team| team.node().leader(at(400)) == Some(0)));
}
