//! Robots of one team over the network: keys, processes on loopback, and what is refused.

use crate::support::{assert_code, assert_refused, folder, json, log_of, run, spawn, text};
use mapwright_net::{Credentials, Wire, WireSettings};
use mapwright_sim::{Drive, DriveSettings, worlds};
use serde_json::Value;
use std::fs;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::{Child, Output};
use std::time::Duration;

/// Seconds of each robot's drive.
const DRIVE_S: f64 = 40.0;

struct Team {
    folder: PathBuf,
    keys: PathBuf,
}

/// Ports on which nobody listens just now.
fn ports<const N: usize>() -> [u16; N] {
    let listeners = [(); N].map(|()| TcpListener::bind("127.0.0.1:0").unwrap());
    listeners.map(|listener| listener.local_addr().unwrap().port())
}

fn string(path: &Path) -> String {
    path.to_str().unwrap().to_owned()
}

impl Team {
    fn new(name: &str, robots: &[(&str, u16)], more: &[&str]) -> Self {
        let folder = folder(name);
        let team = Self { keys: folder.join("keys"), folder };
        assert_code(&team.make(robots, more), 0);
        team
    }

    fn make(&self, robots: &[(&str, u16)], more: &[&str]) -> Output {
        let robots: Vec<String> = robots.iter().map(|(name, port)| format!("{name}@127.0.0.1:{port}")).collect();
        let keys = string(&self.keys);
        let mut words = vec!["fleet", "keys", "-o", &keys];
        words.extend(robots.iter().map(String::as_str));
        words.extend(more);
        run(&words)
    }

    fn file(&self, robot: &str, name: &str) -> PathBuf {
        self.keys.join(robot).join(name)
    }

    fn config(&self, robot: &str) -> String {
        string(&self.file(robot, "robot.toml"))
    }

    /// A drive through three rooms from a waypoint on, as a log.
    fn log(&self, waypoint: usize) -> String {
        let settings = DriveSettings {
            duration_s: DRIVE_S,
            seed: waypoint as u64,
            start_waypoint: waypoint,
            ..DriveSettings::default()
        };
        let path = self.folder.join(format!("{waypoint}.clf"));
        fs::write(&path, log_of(Drive::new(worlds::three_rooms(5).into(), settings))).unwrap();
        string(&path)
    }

    fn out(&self, robot: &str) -> PathBuf {
        self.folder.join(format!("out-{robot}"))
    }

    fn join(&self, robot: &str, log: &str, [rate, wait]: [&str; 2], more: &[&str]) -> Child {
        let (config, out) = (self.config(robot), string(&self.out(robot)));
        let mut words = vec!["fleet", "join", log, "--config", &config, "-o", &out, "--stay", "12"];
        words.extend(["--rate", rate, "--wait", wait]);
        words.extend(more);
        spawn(&words)
    }

    /// More lines of a robot's configuration.
    fn add(&self, robot: &str, lines: &str) {
        let path = self.file(robot, "robot.toml");
        let text = fs::read_to_string(&path).unwrap();
        fs::write(path, text.replace("# connect", &format!("{lines}\n# connect"))).unwrap();
    }

    /// A connection as this robot, which looks for others at this port.
    fn wire(&self, robot: &str, robots: &[&str], port: u16) -> Wire {
        let file = |name: &str| fs::read_to_string(self.file(robot, name)).unwrap();
        let team = file("team.toml");
        let name = team.lines().find_map(|line| line.strip_prefix("team = ")).unwrap().trim_matches('"');
        let [certificate, key, authority] = ["certificate.pem", "private.pem", "authority.pem"].map(file);
        let credentials = Credentials::new(robot, &certificate, &key, &authority).unwrap();
        let settings = WireSettings {
            team: name.to_owned(),
            robots: robots.iter().map(|&robot| robot.to_owned()).collect(),
            relays: Vec::new(),
            listen: Vec::new(),
            connect: vec![format!("tls/127.0.0.1:{port}")],
            message_at_most: mapwright_fleet::MESSAGE_AT_MOST,
        };
        Wire::open(settings, &credentials).unwrap()
    }

    fn report(&self, robot: &str) -> Value {
        json(&self.out(robot).join("fleet.json"))
    }
}

fn done(child: Child, code: i32) -> String {
    let output = child.wait_with_output().unwrap();
    assert_code(&output, code);
    text(&output.stdout)
}

#[cfg(unix)]
fn mode(path: &Path) -> u32 {
    use std::os::unix::fs::PermissionsExt;
    fs::metadata(path).unwrap().permissions().mode() & 0o777
}

#[cfg(unix)]
#[test]
fn keys_are_kept_from_others_and_robots_join_later() {
    let team = Team::new("fleet-keys", &[("anna", 7447), ("bert", 7448)], &[]);
    for robot in ["anna", "bert", "authority"] {
        assert_eq!(mode(&team.keys.join(robot)), 0o700);
        for file in fs::read_dir(team.keys.join(robot)).unwrap() {
            assert_eq!(mode(&file.unwrap().path()), 0o600);
        }
    }
    let secret = fs::read_to_string(team.file("anna", "signing.key")).unwrap();
    let again = team.make(&[("anna", 7447)], &[]);
    assert_refused(&again, 2, &["anna has keys already", "--force"]);
    assert_eq!(fs::read_to_string(team.file("anna", "signing.key")).unwrap(), secret);
    let forced = team.make(&[("anna", 7447)], &["--force"]);
    assert_code(&forced, 0);
    let changed = fs::read_to_string(team.file("anna", "signing.key")).unwrap();
    assert_ne!(changed, secret);
    let said = text(&forced.stdout) + &text(&forced.stderr);
    assert!(
        !said.contains(changed.trim()) && !said.contains("PRIVATE KEY") && said.contains("bert need it too"),
        "{said}"
    );
    assert_code(&team.make(&[("carl", 7449)], &[]), 0);
    let roster = fs::read_to_string(team.keys.join("team.toml")).unwrap();
    assert_eq!(roster.matches("[[robot]]").count(), 3);
    assert_eq!(fs::read_to_string(team.file("bert", "team.toml")).unwrap(), roster);
    for (name, says) in [("a/b", "letters, digits"), ("x@h:0", "NAME@HOST:PORT"), ("authority", "another name")] {
        assert_refused(&run(&["fleet", "keys", name, "-o", &string(&team.keys)]), 2, &[says]);
    }
}

#[cfg(unix)]
#[test]
fn what_is_wrong_with_a_robots_files_is_said() {
    use std::os::unix::fs::PermissionsExt;
    let team = Team::new("fleet-files", &[("anna", 7447), ("bert", 7448)], &[]);
    let other = Team::new("fleet-files-other", &[("anna", 7447)], &[]);
    let expired = Team::new("fleet-files-expired", &[("anna", 7447)], &["--days", "0"]);
    let log = team.log(0);
    let refused = |says: &[&str]| {
        let output = run(&["fleet", "join", &log, "--config", &team.config("anna"), "-o", &string(&team.out("anna"))]);
        let code = output.status.code().unwrap();
        assert!(code == 1 || code == 2, "{output:?}");
        assert_refused(&output, code, says);
        assert!(!team.out("anna").exists());
    };
    let with = |name: &str, from: &Path, says: &[&str]| {
        let path = team.file("anna", name);
        let kept = fs::read(&path).unwrap();
        fs::write(&path, fs::read(from).unwrap()).unwrap();
        refused(says);
        fs::write(&path, kept).unwrap();
    };
    with("signing.key", &team.file("bert", "signing.key"), &["signing.key", "of anna, found that of bert"]);
    with("signing.key", &other.file("anna", "signing.key"), &["signing.key", "one of nobody in the team"]);
    with("private.pem", &team.file("bert", "private.pem"), &["the private key of the certificate"]);
    with("private.pem", &team.file("anna", "certificate.pem"), &["a private key as PEM"]);
    with("certificate.pem", &team.file("bert", "certificate.pem"), &["certificate.pem", "of anna, found one of bert"]);
    with("authority.pem", &other.file("anna", "authority.pem"), &["this team's authority"]);
    with("team.toml", &other.file("anna", "team.toml"), &["signing.key", "one of nobody in the team"]);
    for name in ["private.pem", "signing.key"] {
        let path = team.file("anna", name);
        fs::set_permissions(&path, fs::Permissions::from_mode(0o644)).unwrap();
        refused(&[name, "0600", "found 0644", "chmod 600"]);
        fs::set_permissions(&path, fs::Permissions::from_mode(0o600)).unwrap();
        let away = team.folder.join("away");
        fs::rename(&path, &away).unwrap();
        refused(&[name, "No such file"]);
        fs::rename(&away, &path).unwrap();
    }
    let output = run(&["fleet", "join", &log, "--config", &expired.config("anna"), "-o", &string(&team.out("anna"))]);
    assert_refused(&output, 2, &["certificate.pem", "valid now", "this computer's clock says"]);
    fs::create_dir_all(team.file("anna", "state")).unwrap();
    fs::write(team.file("anna", "state").join("session"), "no number").unwrap();
    refused(&["state/session", "how often this robot was switched on", "no number"]);
    fs::remove_dir_all(team.file("anna", "state")).unwrap();
    team.add("anna", "speed = 3");
    refused(&["robot.toml", "unknown field", "speed"]);
}

/// Three robots of which the first and the last have no link to each other, a stranger, one that the others do not know, and one that has
/// other settings: all who are of the team end with one map, the same to the byte.
#[test]
fn robots_on_a_network_end_with_the_same_map_and_strangers_stay_out() {
    let [a, b, c, d, e, f] = ports();
    let team = Team::new("fleet-join", &[("anna", a), ("bert", b), ("carl", c)], &[]);
    team.add("anna", &format!("connect = [\"tls/127.0.0.1:{b}\"]"));
    team.add("bert", "connect = []");
    team.add("carl", &format!("connect = [\"tls/127.0.0.1:{b}\"]"));
    // Of the same authority, and not in the others' team.toml.
    let roster = fs::read(team.file("bert", "team.toml")).unwrap();
    assert_code(&team.make(&[("dora", d)], &[]), 0);
    ["anna", "bert", "carl"].iter().for_each(|name| fs::write(team.file(name, "team.toml"), &roster).unwrap());
    // Of another authority.
    let others = Team::new("fleet-join-others", &[("eve", e), ("fred", f)], &[]);
    others.add("eve", &format!("connect = [\"tls/127.0.0.1:{b}\"]"));
    let logs = [0, 1, 2].map(|waypoint| team.log(waypoint));
    let quick = ["4", "90"];
    let robots = ["anna", "bert", "carl"];
    let mut running: Vec<Child> = vec![team.join("bert", &logs[1], quick, &[])];
    running.push(team.join("anna", &logs[0], quick, &["--set", "map.resolution_m=0.1"]));
    running.push(team.join("carl", &logs[2], quick, &[]));
    let dora = team.join("dora", &logs[0], ["max", "8"], &[]);
    let eve = others.join("eve", &logs[0], ["max", "8"], &[]);
    std::thread::sleep(Duration::from_secs(8));
    let status = run(&["fleet", "status", "--config", &team.config("carl"), "--json"]);
    assert_code(&status, 0);
    let status: Value = serde_json::from_slice(&status.stdout).unwrap();
    let said: Vec<&str> =
        status["robots"].as_array().unwrap().iter().filter_map(|robot| robot["says"]["version"].as_str()).collect();
    assert_eq!(said.len(), 3, "{status:#}");
    assert_eq!(status["robots"][0]["name"], "anna");
    let eve = done(eve, 3);
    assert!(eve.contains("never heard: fred") && eve.contains(&format!("tls/127.0.0.1:{b}: ")), "{eve}");
    let dora = done(dora, 3);
    assert!(dora.contains("never heard: anna, bert, carl"), "{dora}");
    let mut words = Vec::new();
    for (child, robot) in running.into_iter().zip(["bert", "anna", "carl"]) {
        words.push((robot, done(child, 0)));
    }
    let bert = &words[0].1;
    assert!(bert.contains("someone who wants in is refused: its authority is another one"), "{bert}");
    assert!(bert.contains("dora has a certificate of the authority and is not in team.toml"), "{bert}");
    assert!(bert.contains("anna has other settings: map.resolution_m: 0.1"), "{bert}");
    let sessions = robots.map(|robot| fs::read(team.out(robot).join("session.mapwright")).unwrap());
    assert!(sessions[0] == sessions[1] && sessions[1] == sessions[2], "{:?}", sessions.map(|session| session.len()));
    let reports = robots.map(|robot| team.report(robot));
    let own: u64 = reports.iter().map(|report| report["own"]["keyframes"].as_u64().unwrap()).sum();
    for report in &reports {
        assert_eq!((report["in_map"].as_u64(), report["pieces"].as_u64()), (Some(own), Some(1)), "{report:#}");
        assert_eq!(report["losses"].as_array().map(Vec::len), Some(0));
        assert!(report["own"]["holds"].as_array().unwrap().iter().all(|held| held["robot"] != "dora"));
    }
    assert!(!reports[0]["own"]["links"].as_array().unwrap().iter().any(|name| name == "carl"), "{:#}", reports[0]);
    for name in ["map.png", "map.pgm", "map.yaml", "trajectory.tum"] {
        assert!(team.out("anna").join(name).metadata().unwrap().len() > 100, "{name}");
    }
}

/// One that is killed comes back under another number; two of one name are found out; Ctrl-C leaves results.
#[cfg(unix)]
#[test]
fn robots_come_back_and_two_of_one_name_are_found_out() {
    let [a, b, other] = ports();
    let team = Team::new("fleet-again", &[("anna", a), ("bert", b)], &[]);
    let logs = [0, 1].map(|waypoint| team.log(waypoint));
    let bert = team.join("bert", &logs[1], ["2", "30"], &[]);
    let mut anna = team.join("anna", &logs[0], ["4", "30"], &[]);
    std::thread::sleep(Duration::from_secs(6));
    // The robot itself runs: another process of it is refused.
    let output =
        run(&["fleet", "join", &logs[0], "--config", &team.config("anna"), "-o", &string(&team.out("second"))]);
    assert_refused(&output, 2, &["this robot runs already"]);
    anna.kill().unwrap();
    anna.wait().unwrap();
    let state = team.file("anna", "state").join("session");
    let number = fs::read_to_string(&state).unwrap();
    let anna = team.join("anna", &logs[0], ["4", "30"], &[]);
    std::thread::sleep(Duration::from_secs(4));
    assert_ne!(fs::read_to_string(&state).unwrap(), number);
    // Another computer with a copy of anna's keys.
    let twin = team.keys.join("twin");
    fs::create_dir(&twin).unwrap();
    for file in ["team.toml", "certificate.pem", "authority.pem", "private.pem", "signing.key", "robot.toml"] {
        fs::copy(team.file("anna", file), twin.join(file)).unwrap();
    }
    let config = twin.join("robot.toml");
    let text = fs::read_to_string(&config).unwrap().replace(&a.to_string(), &other.to_string());
    fs::write(&config, text).unwrap();
    team.add("twin", &format!("connect = [\"tls/127.0.0.1:{b}\"]"));
    let twin = team.join("twin", &logs[1], ["1", "20"], &[]);
    std::thread::sleep(Duration::from_secs(6));
    let interrupt = std::process::Command::new("kill").arg(twin.id().to_string()).status().unwrap();
    assert!(interrupt.success());
    let said = done(twin, 3);
    assert!(said.contains("interrupted") && team.out("twin").join("session.mapwright").exists(), "{said}");
    let anna = anna.wait_with_output().unwrap();
    let said = crate::support::text(&anna.stdout);
    assert!(said.contains("in this robot's own name"), "{said}");
    let bert = bert.wait_with_output().unwrap();
    for (robot, output) in [("anna", &anna), ("bert", &bert)] {
        assert!(matches!(output.status.code(), Some(0 | 3)), "{robot}: {output:?}");
        let report = team.report(robot);
        assert!(
            report["own"]["keyframes"].as_u64().unwrap() > 10 && report["in_map"].as_u64().unwrap() > 20,
            "{report:#}"
        );
    }
}

/// What a robot of a later version says: the protocol's messages are refused and counted, the rest is told, and the robot maps.
#[test]
fn another_version_and_a_clock_that_is_hours_off_are_told_and_harm_nothing() {
    let [a, b] = ports();
    let team = Team::new("fleet-version", &[("anna", a), ("bert", b)], &[]);
    let anna = team.join("anna", &team.log(0), ["8", "6"], &[]);
    let wire = team.wire("bert", &["anna", "bert"], a);
    for _ in 0..40 {
        wire.send(None, b"MWF\x09a message of another version".to_vec());
        wire.send(Some("anna"), b"no message at all".to_vec());
        let clock_s = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap().as_secs_f64();
        let said = serde_json::json!({
            "version": "99.1.0", "session": 7, "settings": { "map.resolution_m": "0.2" }, "keyframes": 1, "in_map": 1,
            "solves": false, "log_is_over": false, "clock_s": clock_s - 5.0 * 3600.0, "holds": [], "hears": [], "links": [],
            "refused": [], "early": 0, "dropped": [0, 0], "a word of a later version": 3,
        });
        wire.send_as("status", serde_json::to_vec(&said).unwrap());
        wire.send_as("status", b"{ not what it was }".to_vec());
        std::thread::sleep(Duration::from_millis(200));
    }
    let said = done(anna, 3);
    for what in [
        "refused: of another version of the protocol",
        "refused: not a whole message",
        "bert runs mapwright 99.1.0, this robot",
        "bert has other settings: map.resolution_m: 0.2 there",
        "bert's clock is 5.0 h behind this one's",
        "never heard: bert",
    ] {
        assert!(said.contains(what), "expected {what:?}, found {said}");
    }
    let report = team.report("anna");
    let refused = report["own"]["refused"].as_array().unwrap();
    let times =
        |why: &str| refused.iter().filter(|of| of["why"] == why).filter_map(|of| of["times"].as_u64()).sum::<u64>();
    assert!(times("of another version of the protocol") > 5 && times("not a whole message") > 5, "{refused:?}");
    assert!(report["own"]["keyframes"].as_u64().unwrap() > 10, "{report:#}");
    assert_eq!(report["in_map"], report["own"]["keyframes"]);
}

/// Results that find no room are an error; what the robot has mapped until then the others have. Without room for the number of this time it
/// maps, and says nothing to others.
#[cfg(unix)]
#[test]
fn a_full_disk_is_told_and_the_others_have_what_was_mapped() {
    use crate::support::spawn_with_files_of;
    let [a, b] = ports();
    let team = Team::new("fleet-full", &[("anna", a), ("bert", b)], &[]);
    let logs = [0, 1].map(|waypoint| team.log(waypoint));
    let bert = team.join("bert", &logs[1], ["8", "60"], &[]);
    let (config, out) = (team.config("anna"), string(&team.out("anna")));
    let words = ["fleet", "join", &logs[0], "--config", &config, "-o", &out, "--rate", "8", "--stay", "12"];
    let anna = spawn_with_files_of(4, &words).wait_with_output().unwrap();
    assert_refused(&anna, 1, &["cannot write", "File too large"]);
    assert!(!team.out("anna").join("fleet.json").exists(), "half of the results");
    done(bert, 0);
    let report = team.report("bert");
    let own = report["own"]["keyframes"].as_u64().unwrap();
    assert!(own > 10 && report["in_map"].as_u64().unwrap() > own + 10, "{report:#}");

    // The folder of the state is on a disk that takes nothing: here it cannot even be made.
    let team = Team::new("fleet-full-state", &[("anna", a), ("bert", b)], &[]);
    fs::write(team.folder.join("file"), "no folder").unwrap();
    let settings = fs::read_to_string(team.config("anna")).unwrap();
    fs::write(team.config("anna"), settings.replace("state = \"state\"", "state = \"../../file/state\"")).unwrap();
    let said = done(team.join("anna", &logs[0], ["8", "2"], &[]), 3);
    assert!(said.contains("this robot maps and says nothing to others"), "{said}");
    let report = team.report("anna");
    assert!(report["own"]["keyframes"].as_u64().unwrap() > 10, "{report:#}");
    assert_eq!(report["in_map"], report["own"]["keyframes"]);
    assert!(team.out("anna").join("map.png").exists());
}
