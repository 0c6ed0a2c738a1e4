//! Several logs and sessions: merged, gone on with, and a robot that is only located.

use crate::support::{assert_code, assert_refused, folder, json, log_of, run, text};
use mapwright_geom::{Pose2, Stamp};
use mapwright_sim::{Drive, DriveSettings, Event, worlds};
use std::fs;
use std::path::{Path, PathBuf};

/// Where the odometry of a second drive has its origin.
const ELSEWHERE: Pose2 = Pose2 { x: -7.0, y: 20.0, theta: -2.5 };

/// A drive through three rooms from a waypoint on, so late, its odometry from anywhere.
fn drive(rooms: u64, waypoint: usize, late_s: i64) -> Vec<u8> {
    let settings =
        DriveSettings { duration_s: 60.0, seed: waypoint as u64, start_waypoint: waypoint, ..DriveSettings::default() };
    let elsewhere = if waypoint == 0 { Pose2::IDENTITY } else { ELSEWHERE };
    let later = |stamp: Stamp| Stamp(stamp.0 + late_s * 1_000_000_000);
    log_of(Drive::new(worlds::three_rooms(rooms).into(), settings).map(|event| match event {
        Event::Odometry(mut odometry) => {
            (odometry.stamp, odometry.odom_from_robot) = (later(odometry.stamp), elsewhere * odometry.odom_from_robot);
            Event::Odometry(odometry)
        }
        Event::Scan(mut scan) => {
            scan.scan.stamp = later(scan.scan.stamp);
            scan.scan.odom_from_robot = scan.scan.odom_from_robot.map(|pose| elsewhere * pose);
            Event::Scan(scan)
        }
    }))
}

fn write(folder: &Path, name: &str, log: &[u8]) -> String {
    let path = folder.join(name);
    fs::write(&path, log).unwrap();
    path.to_str().unwrap().to_owned()
}

fn out(folder: &Path, name: &str) -> (PathBuf, String) {
    let path = folder.join(name);
    (path.clone(), path.to_str().unwrap().to_owned())
}

/// Pixels of a picture that have a colour.
fn pixels_of(path: &Path, colour: [u8; 3]) -> usize {
    let mut reader = png::Decoder::new(std::io::BufReader::new(fs::File::open(path).unwrap())).read_info().unwrap();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    reader.next_frame(&mut pixels).unwrap();
    pixels.as_chunks::<3>().0.iter().filter(|pixel| **pixel == colour).count()
}

/// Poses of a trajectory without their stamps.
fn poses(path: &Path) -> Vec<String> {
    let text = fs::read_to_string(path).unwrap();
    text.lines().filter(|line| !line.starts_with('#')).map(|line| line.split_once(' ').unwrap().1.to_owned()).collect()
}

#[test]
fn robots_that_drive_at_the_same_time_share_one_map() {
    let folder = folder("fleet");
    let logs = [(0, "a.clf"), (2, "b.clf")].map(|(at, name)| write(&folder, name, &drive(5, at, 100 * at as i64)));
    let (team, path) = out(&folder, "team");
    let output = run(&["fleet", "simulate", &logs[0], &logs[1], "-o", &path, "--loss", "0.3"]);
    assert_code(&output, 0);
    let said = text(&output.stdout);
    assert!(said.contains("1-a: ") && said.contains("solves") && said.contains("bytes a keyframe"), "{said}");
    let report = json(&team.join("fleet.json"));
    assert_eq!((report["pieces"].as_u64(), report["losses"].as_array().map(Vec::len)), (Some(1), Some(0)), "{report}");
    assert!(report["agreed_s"].as_f64().unwrap() < 30.0 && report["robots"][1]["one_map_s"].as_f64().is_some());
    // The session is one like any other, and holds what both have mapped.
    let exported = out(&folder, "map.pgm").1;
    assert_code(&run(&["export", &path, "--to", "pgm", "-o", &exported]), 0);
    let robots = [0, 1].map(|robot| report["robots"][robot]["keyframes"].as_u64().unwrap());
    assert_eq!(report["keyframes"].as_u64(), Some(robots.iter().sum()));
    for name in ["map.png", "map.pgm", "map.yaml", "trajectory.tum", "trajectory-1-a.tum", "trajectory-2-b.tum"] {
        assert!(team.join(name).metadata().unwrap().len() > 100, "{name}");
    }
    // The page has both robots with their colours, and who met whom.
    let page = fs::read_to_string(team.join("report.html")).unwrap();
    for words in ["Robots</h2>", "1-a</th>", "2-b</th>", "Who met whom", "refused of", "--run:#0041c6", "--run:#d55e00"]
    {
        assert!(page.contains(words), "{words}");
    }
    for colour in [[0, 65, 198], [213, 94, 0]] {
        assert!(pixels_of(&team.join("map.png"), colour) > 300, "{colour:?}");
    }
    // The same seed, the same bytes; a robot of another building has a map of its own, and that is said.
    let (again, path) = out(&folder, "again");
    assert_code(&run(&["fleet", "simulate", &logs[0], &logs[1], "-o", &path, "--loss", "0.3", "--quiet"]), 0);
    assert_eq!(fs::read(team.join("session.mapwright")).unwrap(), fs::read(again.join("session.mapwright")).unwrap());
    let other = write(&folder, "other.clf", &drive(11, 1, 900));
    let path = out(&folder, "apart").1;
    let output = run(&["fleet", "simulate", &logs[0], &other, "-o", &path]);
    assert_code(&output, 3);
    assert!(text(&output.stdout).contains("2 that nothing joins"));
    // One that dies leaves what it has said.
    let (died, path) = out(&folder, "died");
    assert_code(&run(&["fleet", "simulate", &logs[0], &logs[1], "-o", &path, "--dies", "1@40"]), 0);
    let report = json(&died.join("fleet.json"));
    assert_eq!(
        (report["robots"][0]["alive"].as_bool(), report["robots"][1]["solves"].as_bool()),
        (Some(false), Some(true))
    );
    let refused = run(&["fleet", "simulate", &logs[0], &logs[1], "-o", &path, "--dies", "3@4"]);
    assert_refused(&refused, 2, &["--dies", "1 to 2", "3"]);
    assert_refused(&run(&["fleet", "simulate", &logs[0], &logs[1], "-o", &path, "--loss", "1.5"]), 2, &["0 to 0.95"]);
}

#[test]
fn others_are_not_misled_by_a_robot_that_lies() {
    let folder = folder("liars");
    let logs = [(0, "a.clf"), (2, "b.clf"), (4, "c.clf")]
        .map(|(at, name)| write(&folder, name, &drive(5, at, 100 * at as i64)));
    let simulate = |name: &str, lies: &[&str]| {
        let (team, path) = out(&folder, name);
        let lies = lies.iter().flat_map(|lie| ["--lies", lie]);
        let args = ["fleet", "simulate", &logs[0], &logs[1], &logs[2], "-o", &path].into_iter().chain(lies);
        let output = run(&args.collect::<Vec<_>>());
        assert!(matches!(output.status.code(), Some(0 | 3)), "{}", text(&output.stderr));
        let refused = |why: &str, of: u64| -> u64 {
            let report = json(&team.join("fleet.json"));
            let robots = report["robots"].as_array().unwrap().clone();
            let refused = robots.iter().flat_map(|robot| robot["refused"].as_array().unwrap().clone());
            let of_it = refused.filter(|row| row["why"].as_str().unwrap().contains(why) && row["of"] == logs_name(of));
            of_it.map(|row| row["times"].as_u64().unwrap()).sum()
        };
        (positions(&team, &["1-a", "2-b", "3-c"]), refused("its readings contradict", 2), refused("does not follow", 1))
    };
    let honest = simulate("honest", &[]);
    assert_eq!((honest.1, honest.2), (0, 0));
    for lie in ["offset", "forged"] {
        let (lied, contradicted, _) = simulate(lie, &[&format!("2:{lie}@20")]);
        for robot in [0, 2] {
            let off_m = farthest_m(&lied[robot], &honest.0[robot]);
            assert!(off_m < 0.05, "{lie}: robot {robot} {off_m} m off");
        }
        assert!(contradicted > 0, "{lie}");
    }
    // The robot that solves lies about what it has found: others refuse that, and go on without it.
    let (lied, _, untrue) = simulate("solution", &["1:solution@0"]);
    assert!(untrue == 2 && farthest_m(&lied[1], &honest.0[1]) < 0.05, "{untrue}");
    let path = out(&folder, "none").1;
    let refused = run(&["fleet", "simulate", &logs[0], &logs[1], "-o", &path, "--lies", "2:nonsense@4"]);
    assert_refused(&refused, 2, &["offset", "nonsense"]);
}

fn logs_name(robot: u64) -> String {
    ["1-a", "2-b", "3-c"][robot as usize - 1].to_owned()
}

/// Where each robot was.
fn positions(team: &Path, robots: &[&str]) -> Vec<Vec<[f64; 2]>> {
    let read = |robot: &&str| {
        let poses = poses(&team.join(format!("trajectory-{robot}.tum")));
        poses
            .iter()
            .map(|pose| {
                let mut numbers = pose.split(' ').map(|number| number.parse().unwrap());
                [numbers.next().unwrap(), numbers.next().unwrap()]
            })
            .collect()
    };
    robots.iter().map(read).collect()
}

fn farthest_m(a: &[[f64; 2]], b: &[[f64; 2]]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a[0] - b[0]).hypot(a[1] - b[1])).fold(0.0, f64::max)
}

#[test]
fn logs_and_sessions_of_one_building_become_one_map() {
    let folder = folder("merge");
    let [first, second] =
        [(0, "a.clf"), (2, "b.clf")].map(|(at, name)| write(&folder, name, &drive(5, at, 100 * at as i64)));
    let other = write(&folder, "other.clf", &drive(11, 1, 900));
    let [(_, a), (_, b)] = ["a", "b"].map(|name| out(&folder, name));
    assert_code(&run(&["map", &first, "-o", &a, "--quiet"]), 0);
    assert_code(&run(&["map", &second, "-o", &b, "--quiet"]), 0);
    for (name, inputs) in [("logs", [&first, &second]), ("sessions", [&a, &b]), ("mixed", [&a, &second])] {
        let (merged, path) = out(&folder, name);
        let output = run(&["merge", inputs[0], inputs[1], "-o", &path]);
        assert_code(&output, 0);
        let said = text(&output.stdout);
        assert!(said.contains("pieces   1, of 2 fragments (1 break)"), "{name}: {said}");
        let report = json(&merged.join("report.json"));
        let parts: Vec<&str> =
            report["parts"].as_array().unwrap().iter().map(|part| part["name"].as_str().unwrap()).collect();
        assert_eq!(parts, inputs);
        assert!(
            report["parts"][1]["maps"].as_array().unwrap().len() == 1 && report["parts"][1]["maps"][0] == "map.png"
        );
        assert!(!merged.join("map-2.png").exists());
        assert_code(&run(&["report", &path]), 0);
        let page = fs::read_to_string(merged.join("report.html")).unwrap();
        assert!(
            page.contains("Runs</h2>") && page.contains("Who met whom") && page.contains("--run:#d55e00"),
            "{name}"
        );
        assert!(pixels_of(&merged.join("map.png"), [213, 94, 0]) > 300, "{name}");
    }
    // A run alone has no colours of runs.
    assert_code(&run(&["report", &a]), 0);
    let page = fs::read_to_string(Path::new(&a).join("report.html")).unwrap();
    assert!(!page.contains("--run:#") && !page.contains("Runs</h2>"));
    assert_eq!(pixels_of(&Path::new(&a).join("map.png"), [213, 94, 0]), 0);
    // Another building is a map of its own, and that is said.
    let (merged, path) = out(&folder, "two");
    let output = run(&["merge", &a, &other, "-o", &path]);
    assert_code(&output, 3);
    let said = text(&output.stdout);
    assert!(said.contains("maps of their own") && said.contains("other.clf: "), "{said}");
    assert!(merged.join("map-2.png").exists());
    let report = json(&merged.join("report.json"));
    // That of the most keyframes is map.png.
    let mut maps = [0, 1].map(|part| report["parts"][part]["maps"][0].as_str().unwrap().to_owned());
    maps.sort();
    assert_eq!(maps, ["map-2.png", "map.png"]);
    let path = out(&folder, "twice").1;
    assert_refused(&run(&["merge", &a, &a, "-o", &path]), 2, &["given twice"]);
    assert!(!Path::new(&path).exists());
    // What overlaps is told as well, in whichever order, and where it begins cannot be said of a session.
    let logs = out(&folder, "logs").1;
    for inputs in [[&logs, &b], [&b, &logs]] {
        assert_refused(&run(&["merge", inputs[0], inputs[1], "-o", &path]), 2, &["overlaps"]);
    }
    assert_refused(&run(&["merge", &a, &b, "-o", &path, "--start", "1,2,0"]), 2, &["--start"]);
    assert_refused(&run(&["merge", &a, &b, "-o", &path, "--set", "live.policy=everything"]), 2, &["live.policy"]);
}

#[test]
fn a_session_is_gone_on_with() {
    let folder = folder("continue");
    let log = drive(5, 0, 0);
    let lines: Vec<&[u8]> = log.split_inclusive(|&byte| byte == b'\n').collect();
    let whole = write(&folder, "whole.clf", &log);
    let half = write(&folder, "half.clf", &lines[..lines.len() / 2].concat());
    let second = write(&folder, "second.clf", &drive(5, 2, 200));
    let [(whole_out, whole_path), (out_folder, path)] = ["whole", "out"].map(|name| out(&folder, name));
    assert_refused(&run(&["map", &whole, "-o", &path, "--continue"]), 1, &["session.mapwright"]);
    assert_code(&run(&["map", &whole, "-o", &whole_path, "--quiet"]), 0);
    // What was mapped of a log is not mapped again, and the rest as if there had been no stop.
    assert_code(&run(&["map", &half, "-o", &path, "--quiet"]), 0);
    let output = run(&["map", &whole, "-o", &path, "--continue"]);
    assert_code(&output, 0);
    assert!(text(&output.stdout).contains("of them mapped now"));
    assert_eq!(poses(&out_folder.join("trajectory.tum")), poses(&whole_out.join("trajectory.tum")));
    // Once more there is nothing new.
    let output = run(&["map", &whole, "-o", &path, "--continue"]);
    assert_code(&output, 0);
    assert!(text(&output.stdout).contains(", 0 of them mapped now"), "{}", text(&output.stdout));
    assert_eq!(poses(&out_folder.join("trajectory.tum")), poses(&whole_out.join("trajectory.tum")));
    // Another log may begin anywhere, and at the same time as the first one.
    let (_, alike) = out(&folder, "alike");
    let same_time = write(&folder, "same_time.clf", &drive(5, 2, 0));
    assert_code(&run(&["map", &whole, "-o", &alike, "--quiet"]), 0);
    let output = run(&["map", &same_time, "-o", &alike, "--continue"]);
    assert_code(&output, 0);
    assert!(text(&output.stdout).contains("pieces   1, of 2 fragments (1 break)"), "{}", text(&output.stdout));
    let output = run(&["map", &second, "-o", &path, "--continue"]);
    assert_code(&output, 0);
    assert!(text(&output.stdout).contains("pieces   1, of "), "{}", text(&output.stdout));
    // One that begins alike and differs is refused, and the session is as it was.
    let late = String::from_utf8(log.clone()).unwrap();
    let mut late: Vec<&str> = late.lines().collect();
    let scans =
        || late.iter().enumerate().filter(|(_, line)| line.starts_with("FLASER") || line.starts_with("ROBOTLASER"));
    let third = scans().nth(scans().count() / 3).unwrap().0;
    late.remove(third);
    let changed = write(&folder, "changed.clf", (late.join("\n") + "\n").as_bytes());
    let (_, again) = out(&folder, "again");
    assert_code(&run(&["map", &whole, "-o", &again, "--quiet"]), 0);
    let session = |folder: &str| fs::read(Path::new(folder).join("session.mapwright")).unwrap();
    let before = session(&again);
    assert_refused(&run(&["map", &changed, "-o", &again, "--continue"]), 1, &["differs from it"]);
    assert_eq!(session(&again), before);
}

/// A run that was killed leaves a part, from which the next goes on; nothing of it is lost, whatever becomes of that.
#[test]
fn a_killed_run_is_gone_on_with() {
    let folder = folder("continue_killed");
    let log = drive(5, 0, 0);
    let (whole, nothing) = (write(&folder, "whole.clf", &log), write(&folder, "nothing.clf", b"# nothing\n"));
    let (results, path) = out(&folder, "out");
    assert_code(&run(&["map", &whole, "-o", &path, "--quiet"]), 0);
    let session = fs::read(results.join("session.mapwright")).unwrap();
    fs::remove_dir_all(&results).unwrap();
    fs::create_dir(&results).unwrap();
    let torn = &session[..session.len() / 2];
    fs::write(results.join("session.mapwright.part"), torn).unwrap();
    assert_refused(&run(&["map", &nothing, "-o", &path, "--continue"]), 1, &["nothing.clf"]);
    assert_eq!(fs::read(results.join("session.mapwright")).unwrap(), torn);
    let output = run(&["map", &whole, "-o", &path, "--continue"]);
    assert_code(&output, 3);
    assert!(text(&output.stdout).contains("expected an entry"), "{}", text(&output.stdout));
    let log = text(&log);
    assert_eq!(
        poses(&results.join("trajectory.tum")).len(),
        log.lines().filter(|line| line.starts_with("FLASER") || line.starts_with("ROBOTLASER")).count()
    );
    assert!(!results.join("session.mapwright.part").exists());
}

#[test]
fn a_robot_is_located_in_a_finished_map() {
    let folder = folder("localise");
    let (first, second) = (write(&folder, "a.clf", &drive(5, 0, 0)), write(&folder, "b.clf", &drive(5, 2, 200)));
    let other = write(&folder, "other.clf", &drive(11, 1, 900));
    let (map, path) = out(&folder, "map");
    assert_code(&run(&["map", &first, "-o", &path, "--quiet"]), 0);
    let before = fs::read(map.join("session.mapwright")).unwrap();
    let [(tum, tum_path), (csv, csv_path)] = ["poses.tum", "poses.csv"].map(|name| out(&folder, name));
    let output = run(&["localise", &second, "--map", &path, "-o", &tum_path, "--json"]);
    let said: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let located = said["located"].as_u64().unwrap();
    let code = if said["scans"] == located { 0 } else { 3 };
    assert_code(&output, code);
    assert!(2 * located > said["scans"].as_u64().unwrap(), "{said}");
    assert_eq!(poses(&tum).len() as u64, located);
    assert_code(&run(&["localise", &second, "--map", &path, "-o", &csv_path, "--quiet"]), code);
    let rows = fs::read_to_string(&csv).unwrap();
    let rows: Vec<Vec<&str>> = rows.lines().map(|row| row.split(',').collect()).collect();
    assert!(rows.iter().all(|row| row.len() == rows[0].len()) && rows[0][1] == "located");
    assert_eq!(rows.iter().filter(|row| row[1] == "1").count() as u64, located);
    assert_eq!(fs::read(map.join("session.mapwright")).unwrap(), before);
    // Elsewhere it is nowhere, and that is said.
    let output = run(&["localise", &other, "--map", &path, "-o", &csv_path]);
    assert_code(&output, 3);
    assert!(text(&output.stdout).contains("nowhere recognised"), "{}", text(&output.stdout));
    assert_refused(&run(&["localise", &second, "--map", &first, "-o", &csv_path]), 1, &["a.clf"]);
}

/// A long room with two ends alike: the robot is not located before it leaves it, and scans without a pose are a loss.
#[test]
fn scans_that_are_not_located_are_said_and_counted_as_lost() {
    let folder = folder("localise_late");
    let case = worlds::relocalisation(0);
    let first = write(&folder, "a.clf", &log_of(case.mapping_drive()));
    let second = write(&folder, "b.clf", &log_of(case.later_drive()));
    let [(_, map), (csv, csv_path)] = ["map", "poses.csv"].map(|name| out(&folder, name));
    run(&["map", &first, "-o", &map, "--quiet"]);
    let output = run(&["localise", &second, "--map", &map, "-o", &csv_path]);
    assert_code(&output, 3);
    let said = text(&output.stdout);
    assert!(said.contains("not located before the robot was found"), "{said}");
    let rows = fs::read_to_string(&csv).unwrap();
    let rows: Vec<Vec<&str>> = rows.lines().skip(1).map(|row| row.split(',').collect()).collect();
    let (lost, located): (Vec<_>, Vec<_>) = rows.into_iter().partition(|row| row[1] == "0");
    assert!(lost.len() > 100 && lost.iter().all(|row| row[2].is_empty() && row[9] == "lost"));
    assert!(!located.is_empty() && located.iter().all(|row| row[9] != "lost"));
}
