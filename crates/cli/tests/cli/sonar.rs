//! Logs of sonars: mapped without a laser, drawn beside one, and what is said where they cannot be used.

use crate::support::{assert_code, assert_refused, folder, json, run, text};
use mapwright_formats::CarmenWriter;
use mapwright_sim::{Drive, DriveSettings, Event, SonarSettings, sonar_drive, worlds};
use std::fs;
use std::path::Path;
use std::sync::{Arc, OnceLock};

const SECONDS: f64 = 60.0;

fn settings() -> DriveSettings {
    DriveSettings { duration_s: SECONDS, scan_rate_hz: 5.0, seed: 3, ..DriveSettings::default() }
}

/// A minute of sonars in three rooms, the wheels in lines of their own.
fn sonar_log() -> &'static str {
    static LOG: OnceLock<String> = OnceLock::new();
    LOG.get_or_init(|| {
        let mut writer = CarmenWriter::new(Vec::new());
        for event in sonar_drive(Arc::new(worlds::rooms(3)), settings(), SonarSettings::default()) {
            match event {
                Event::Odometry(odometry) => writer.odometry(&odometry).unwrap(),
                Event::Scan(taken) => {
                    let reading = mapwright_sensor::SonarReading { odom_from_robot: None, ..taken.reading };
                    writer.sonar(&reading).unwrap();
                }
            }
        }
        String::from_utf8(writer.finish().unwrap()).unwrap()
    })
}

fn map(folder: &Path, log: &str) -> std::process::Output {
    fs::write(folder.join("log.clf"), log).unwrap();
    run(&["map", folder.join("log.clf").to_str().unwrap(), "-o", folder.join("out").to_str().unwrap()])
}

#[test]
fn sonars_and_odometry_make_a_map_and_say_what_was_heard() {
    let folder = folder("sonars");
    let output = map(&folder, sonar_log());
    let said = text(&output.stdout);
    assert!(matches!(output.status.code(), Some(0 | 3)), "{said}{}", text(&output.stderr));
    assert!(said.contains("sonars") && said.contains("of walls") && said.contains("0.1 m a cell"), "{said}");
    let report = json(&folder.join("out/report.json"));
    let heard = &report["sonars"];
    let count = |key: &str| heard[key].as_u64().unwrap();
    let keys =
        ["echoes_of_walls", "echoes_alone", "silent", "too_near", "not_fired", "while_standing", "without_odometry"];
    let readings = sonar_log().lines().filter(|line| line.starts_with("SONAR")).count() as u64;
    assert_eq!(keys.into_iter().map(count).sum::<u64>(), 16 * readings, "{heard}");
    assert!(count("echoes_of_walls") > count("echoes_alone") && count("silent") > 0, "{heard}");
    assert!(folder.join("out/map.pgm").exists() && !folder.join("out/sonar.pgm").exists());
    let again = folder.join("again");
    assert!(
        run(&["map", folder.join("log.clf").to_str().unwrap(), "-o", again.to_str().unwrap()]).status.code().is_some()
    );
    for file in ["map.pgm", "trajectory.tum", "session.mapwright"] {
        assert!(fs::read(folder.join("out").join(file)).unwrap() == fs::read(again.join(file)).unwrap(), "{file}");
    }
}

#[test]
fn beside_a_laser_the_laser_maps_as_it_does_alone() {
    let folder = folder("sonars_beside");
    let (mut both, mut alone) = (CarmenWriter::new(Vec::new()), CarmenWriter::new(Vec::new()));
    let site = Arc::new(worlds::rooms(3));
    let heard = sonar_drive(Arc::clone(&site), settings(), SonarSettings::default());
    // between two readings of odometry, for before the first and after the last nothing says where sonars were
    let (mut waiting, mut is_known) = (None, false);
    for (seen, heard) in Drive::new(site, settings()).zip(heard) {
        match (seen, heard) {
            (Event::Scan(seen), Event::Scan(heard)) => {
                both.scan(&seen.scan).unwrap();
                alone.scan(&seen.scan).unwrap();
                let odom_from_robot = None;
                let reading = mapwright_sensor::SonarReading { odom_from_robot, ..heard.reading };
                waiting = is_known.then_some(reading);
            }
            (Event::Odometry(odometry), _) => {
                is_known = true;
                waiting.take().iter().for_each(|reading| both.sonar(reading).unwrap());
                both.odometry(&odometry).unwrap();
                alone.odometry(&odometry).unwrap();
            }
            _ => {}
        }
    }
    let [both, alone] = [both, alone].map(|writer| String::from_utf8(writer.finish().unwrap()).unwrap());
    assert_code(&map(&folder, &alone), 0);
    let trajectory = fs::read(folder.join("out/trajectory.tum")).unwrap();
    let output = map(&folder, &both);
    assert_code(&output, 0);
    assert!(trajectory == fs::read(folder.join("out/trajectory.tum")).unwrap(), "sonars move no laser");
    assert!(folder.join("out/sonar.png").exists() && folder.join("out/sonar.yaml").exists());
    assert!(text(&output.stdout).contains("the laser says where the robot was"), "{}", text(&output.stdout));
}

#[test]
fn sonars_that_cannot_be_mapped_are_refused_with_the_reason() {
    let folder = folder("sonars_refused");
    let silent: String =
        sonar_log().lines().filter(|line| !line.starts_with("ODOM")).map(|l| format!("{l}\n")).collect();
    assert_refused(&map(&folder, &silent), 1, &["expected sonars with odometry", "without odometry"]);
    let shut = sonar_log().replace("SONAR 0.43", "SONAR 3.43");
    assert_refused(&map(&folder, &shut), 1, &["a cone that opens by more than 0 and at most pi"]);
    assert!(!folder.join("out").exists());
}

#[test]
fn millimetres_are_used_and_said() {
    let folder = folder("sonars_mm");
    let in_mm = |line: &str| {
        let mut words: Vec<String> = line.split(' ').map(str::to_owned).collect();
        if words[0] == "SONAR" {
            for word in &mut words[3..19] {
                *word = format!("{:.0}", 1000.0 * word.parse::<f64>().unwrap());
            }
        }
        words.join(" ") + "\n"
    };
    let log: String = sonar_log().lines().map(in_mm).collect();
    let output = map(&folder, &log);
    assert!(text(&output.stdout).contains("ranges are millimetres: used as such"), "{}", text(&output.stdout));
    let heard = &json(&folder.join("out/report.json"))["sonars"];
    assert!(heard["echoes_of_walls"].as_u64() > heard["echoes_alone"].as_u64(), "{heard}");
}

#[test]
fn info_counts_sonars() {
    let folder = folder("sonars_info");
    fs::write(folder.join("log.clf"), sonar_log()).unwrap();
    let output = run(&["info", folder.join("log.clf").to_str().unwrap()]);
    assert_code(&output, 0);
    let said = text(&output.stdout);
    assert!(said.contains("sonars   SONAR: 16 cones of 25 deg, up to 5 m"), "{said}");
}
