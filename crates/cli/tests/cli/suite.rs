//! `mapwright suite`: what is measured, in small.

use crate::support::{assert_code, assert_refused, folder, json, run, small_log_in, text};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::Output;

/// The worlds that a suite left behind.
fn worlds(path: &Path) -> Vec<Value> {
    let text = fs::read_to_string(path).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// What was said, without the seconds.
fn said(output: &Output) -> String {
    text(&output.stdout).lines().filter(|line| !line.starts_with("time ")).map(|line| format!("{line}\n")).collect()
}

#[test]
fn loops_are_compared_with_the_batch_solve_whatever_the_threads() {
    let folder = folder("suite_loops");
    let map = |name: &str, threads: &str| {
        let out = folder.join(name);
        let out = out.to_str().unwrap();
        run(&["suite", "loops", "--length", "60", "--worlds", "3", "--seed", "4", "--threads", threads, "-o", out])
    };
    let (one, two) = (map("one", "1"), map("two", "2"));
    assert_code(&one, 0);
    assert_eq!(said(&one), said(&two));
    for file in ["loops.jsonl", "loops.json"] {
        let read = |run: &str| fs::read(folder.join(run).join(file)).unwrap();
        assert!(read("one") == read("two"), "{file} differs");
    }
    let worlds = worlds(&folder.join("one/loops.jsonl"));
    assert_eq!(worlds.iter().map(|world| world["seed"].as_u64().unwrap()).collect::<Vec<_>>(), [4, 5, 6]);
    for world in &worlds {
        let number = |key: &str| world[key].as_f64().unwrap();
        // Loops this short come back into the local map by themselves.
        assert!(world["closed"] == true && world["wrong"] == 0, "{world}");
        assert!(number("true_closures") > 20.0 && number("batch_ate_m") < 0.1, "{world}");
        assert!((number("ratio") - number("ate_m") / number("batch_ate_m")).abs() < 1e-9, "{world}");
    }
    let summary = json(&folder.join("one/loops.json"));
    assert!(summary["closed"] == 3 && summary["floors"][0]["holds"] == true, "{summary}");
}

/// With nothing seen beyond 1.2 m and no wheels there is no map to speak of.
#[test]
fn a_missed_floor_ends_with_three() {
    let blind = ["--set", "scan.max_range_m=1.2", "--set", "motion.use_odometry=false"];
    let output = run(&[["suite", "loops", "--length", "120", "--worlds", "1"].as_slice(), &blind].concat());
    assert_code(&output, 3);
    let said = said(&output);
    assert!(said.contains("ratio at most 1.3 in every world: 0.0 % (0 of 1), MISSED"), "{said}");
}

/// The legs of who pushes are left out; where they are matched the robot stands still in its own map.
#[test]
fn who_pushes_a_robot_without_wheels_does_not_hold_it_back() {
    let folder = folder("suite_legs");
    let map = |name: &str, drop_moving: &str, code: i32| {
        let out = folder.join(name);
        let set = format!("scan.drop_moving={drop_moving}");
        let output =
            run(&["suite", "legs", "--seed", "102", "--worlds", "1", "--set", &set, "-o", out.to_str().unwrap()]);
        assert_code(&output, code);
        let world = worlds(&out.join("legs.jsonl")).remove(0);
        assert!(world["clean_m"].as_f64().unwrap() < 0.01, "{world}");
        world["error_m"].as_f64().unwrap()
    };
    let (left_out, matched) = (map("left_out", "true", 0), map("matched", "false", 3));
    assert!(left_out < 0.01 && matched > 0.5, "{left_out} m, {matched} m");
}

/// Two apartments on wheels and two by hand. By the motion before alone the hand's sweeps are undone to 0.034 and 0.067 m.
#[test]
fn homes_are_mapped_on_wheels_and_by_hand() {
    let out = folder("suite_homes");
    let output = run(&["suite", "homes", "--seed", "2000", "--worlds", "4", "-o", out.to_str().unwrap()]);
    assert_code(&output, 0);
    let worlds = worlds(&out.join("homes.jsonl"));
    let kinds: Vec<(bool, f64)> =
        worlds.iter().map(|world| (world["by_hand"] == true, world["reach_m"].as_f64().unwrap())).collect();
    assert_eq!(kinds, [(false, 3.5), (false, 8.0), (true, 3.5), (true, 8.0)]);
    for world in &worlds {
        assert!(world["error_m"].as_f64().unwrap() < 0.025 && world["word"] == "good", "{world}");
    }
    let summary = json(&out.join("homes.json"));
    assert!(summary["silently_wrong"] == 0 && summary["by"]["by hand"]["median_m"].as_f64() < Some(0.025), "{summary}");
}

#[test]
fn fleets_end_with_identical_maps_over_a_bad_radio() {
    let folder = folder("suite-fleet");
    for (suite, seed) in [("fleet", "6"), ("partition", "10")] {
        let out = folder.join(suite);
        let output = run(&["suite", suite, "--seed", seed, "--worlds", "1", "-o", out.to_str().unwrap()]);
        assert_code(&output, 0);
        let text = said(&output);
        assert!(text.contains("agreed") && text.contains("do not end with identical maps: 0, holds"), "{text}");
        let [world] = &worlds(&out.join(format!("{suite}.jsonl")))[..] else { panic!("{text}") };
        assert_eq!((world["identical"].as_bool(), world["wrong"].as_u64()), (Some(true), Some(0)));
        assert!(world["closures"].as_u64() > Some(0) && world["error_m"].as_f64() < Some(0.05), "{world}");
    }
    assert_refused(&run(&["suite", "fleet", "--robots", "1"]), 2, &["2..=64"]);
    assert_refused(&run(&["suite", "fleet", "--cell", "1"]), 2, &["0.02 to 0.2"]);
}

#[test]
fn who_lies_does_not_spoil_what_others_make() {
    let out = folder("suite-liars");
    let output = run(&["suite", "liars", "--seed", "6", "--worlds", "6", "-o", out.to_str().unwrap()]);
    assert_code(&output, 0);
    assert_eq!(said(&output).matches(": 0, holds").count(), 3, "{output:?}");
    let worlds = worlds(&out.join("liars.jsonl"));
    let lies: Vec<&str> = worlds.iter().map(|world| world["liars"][0]["lie"].as_str().unwrap()).collect();
    assert_eq!(lies, ["rotation", "scaled", "replay", "forged", "solution", "outbid"]);
    for world in &worlds {
        let others = &world["lying"];
        assert!(world["ratio"].as_f64() < Some(1.1) && others["error_m"].as_f64() < Some(0.01), "{world}");
        assert!(
            others["identical"] == true && others["left_out"] == 0 && others["keyframes"].as_u64() > Some(80),
            "{world}"
        );
        assert!((&others["broken"], &others["accused"]) == (&0.into(), &0.into()), "{world}");
    }
    // Who turns by 30 degrees at once is found out.
    assert!(worlds[0]["lying"]["broken_of_liars"].as_u64() > Some(0), "{}", worlds[0]);
    assert_refused(&run(&["suite", "liars", "--liars", "8"]), 2, &["1..=7"]);
}

#[test]
fn look_alikes_count_wrong_edges_and_true_returns() {
    let out = folder("suite_look_alike");
    let output = run(&["suite", "look-alike", "--seed", "4", "--worlds", "2", "-o", out.to_str().unwrap()]);
    assert!(matches!(output.status.code(), Some(0 | 3)), "{output:?}");
    let worlds = worlds(&out.join("look-alike.jsonl"));
    assert_eq!([&worlds[0], &worlds[1]].map(|world| world["inside"].as_bool().unwrap()), [true, false]);
    for world in &worlds {
        let number = |key: &str| world[key].as_u64().unwrap();
        assert!(number("closed") <= number("times") && number("times") > 10, "{world}");
        assert!(number("pairs_right") <= number("pairs") && number("pairs") >= number("times"), "{world}");
        assert!(number("wrong") <= number("wrong_measured") + number("wrong_in_map"), "{world}");
    }
    let groups = json(&out.join("look-alike.json"))["groups"].clone();
    assert!(groups["all"]["worlds"] == 2 && groups["repeated rooms"]["worlds"] == 2, "{groups}");
    assert!(said(&output).contains("alias inside two sigma"));
}

#[test]
fn a_kidnapping_is_witnessed() {
    let out = folder("suite_kidnapped");
    let output = run(&["suite", "kidnapped", "--seed", "1", "--worlds", "1", "-o", out.to_str().unwrap()]);
    assert!(matches!(output.status.code(), Some(0 | 3)), "{output:?}");
    let world = &worlds(&out.join("kidnapped.jsonl"))[0];
    assert!(world["known_ground"] == false && world["home_s"].as_f64().unwrap() > 5.0, "{world}");
    let number = |key: &str| world[key].as_u64().unwrap();
    assert!(number("keyframes") > 50 && number("apart") + number("misplaced") <= number("keyframes"), "{world}");
    let floors = json(&out.join("kidnapped.json"))["floors"].as_array().unwrap().len();
    assert_eq!(floors, 3);
}

#[test]
fn a_log_is_scored_under_noise() {
    let folder = folder("suite_noise");
    let log = small_log_in(&folder);
    let relations = folder.join("some.relations");
    fs::write(&relations, "0.0 0.1 0 0 0 0 0 0\n0.0 39.0 0 0 0 0 0 0\n").unwrap();
    let noise = |more: &[&str]| {
        let all = ["suite", "noise", "--log", &log, "--relations", relations.to_str().unwrap(), "--seeds", "2"];
        run(&[&all, more].concat())
    };
    let output = noise(&["--amount", "0.1", "--threads", "2"]);
    assert_code(&output, 0);
    assert!(said(&output).contains("over 2 relations") && said(&output).contains("worst"), "{}", said(&output));
    assert_refused(&noise(&["--amount", "7"]), 2, &["share from 0 to 1"]);
    fs::write(&relations, "900.0 901.0 0 0 0 0 0 0\n").unwrap();
    assert_refused(&noise(&[]), 1, &["seed 0", "no relation has its stamps"]);
}

/// Relations of the small log's own map: an unbroken run has no error, so that what gaps cost is all that is measured.
#[test]
fn breaks_are_counted_and_can_be_repeated() {
    let folder = folder("suite_breaks");
    let path = |name: &str| folder.join(name).display().to_string();
    let log = small_log_in(&folder);
    assert_code(&run(&["map", &log, "-o", &path("whole")]), 0);
    let poses = fs::read_to_string(folder.join("whole/trajectory.tum")).unwrap();
    let stamps: Vec<&str> = poses.lines().filter_map(|line| line.split(' ').next()).collect();
    let relation = |pair: &[&str]| format!("{} {} 0 0 0 0 0 0\n", pair[0], pair[1]);
    let relations = path("some.relations");
    fs::write(&relations, stamps.windows(2).map(relation).collect::<String>()).unwrap();
    let breaks = |more: &[&str]| run(&[&["suite", "breaks", &log, "--relations", &relations], more].concat());
    let out = path("out");
    let output = breaks(&["--lengths", "3,10", "--places", "2", "--all", "-o", &out]);
    assert!(matches!(output.status.code(), Some(0 | 3)), "{output:?}");
    let runs = worlds(&folder.join("out/breaks.jsonl"));
    assert_eq!(runs.iter().map(|run| run["lasts_s"].as_f64().unwrap()).collect::<Vec<_>>(), [3.0, 3.0, 10.0, 10.0]);
    for run in &runs {
        let number = |key: &str| run[key].as_f64().unwrap();
        assert_eq!(number("missing_scans"), 10.0 * number("lasts_s"), "{run}");
        assert_eq!(number("relations"), (stamps.len() - 2) as f64 - number("missing_scans"), "{run}");
        assert!(number("begins_at") > 0.2 && number("pieces") >= 1.0 && number("cpu_times") > 0.0, "{run}");
    }
    let said = said(&output);
    for what in ["breaks: 4 runs", "bound", "     3 s     2", "    10 s     2", "no scan left out", "CPU at most 2.5"] {
        assert!(said.contains(what), "expected {what:?}, found {said}");
    }
    let summary = json(&folder.join("out/breaks.json"));
    assert!(summary["runs"] == 4 && summary["logs"][0]["groups"][1]["runs"] == 2, "{summary}");

    // the command that a run names leads to a log of which a map has the same error
    let command: Vec<&str> = runs[3]["command"].as_str().unwrap().split(' ').collect();
    let broken = path("broken.clf");
    assert_eq!((command[0], command[command.len() - 1]), ("mapwright", "broken.clf"));
    assert_code(&run(&[&command[1..command.len() - 1], &[&broken]].concat()), 0);
    // Nothing joins what it sees after the gap with what it saw before, which is said.
    let again = run(&["map", &broken, "-o", &path("again")]);
    assert_code(&again, 3);
    let words = String::from_utf8_lossy(&again.stdout);
    assert!(words.contains("pieces   2, of 2 fragments (1 break)"), "{words}");
    let eval = run(&["eval", &path("again/trajectory.tum"), "--relations", &relations, "--json"]);
    let value: Value = serde_json::from_slice(&eval.stdout).unwrap();
    let again_m = value[0]["all"]["translation_m"]["mean"].as_f64().unwrap();
    assert!((again_m - runs[3]["error_m"].as_f64().unwrap()).abs() < 1e-6, "{again_m}");

    // a bound that nothing can hold is missed, and only such runs are said
    let strict = breaks(&["--gap", "0.3:3", "--within", "0.001"]);
    assert_code(&strict, 3);
    let said = text(&strict.stdout);
    assert!(said.contains("BAD") && said.contains("--gap 0.3:3 -o broken.clf") && said.contains("MISSED"), "{said}");
    let lenient = text(&breaks(&["--gap", "0.3:3", "--within", "100"]).stdout);
    assert!(!lenient.contains("BAD") && lenient.contains("within the bound: 100.0 % (1 of 1), holds"), "{lenient}");
}

#[test]
fn breaks_need_no_data() {
    let out = folder("suite_breaks_office");
    let output = run(&["suite", "breaks", "--seed", "2", "--gap", "0.5:10", "--all", "-o", out.to_str().unwrap()]);
    assert!(matches!(output.status.code(), Some(0 | 3)), "{output:?}");
    let runs = worlds(&out.join("breaks.jsonl"));
    assert!(runs.len() == 1 && runs[0]["missing_scans"] == 100, "{runs:?}");
    assert_eq!(runs[0]["command"], "mapwright suite breaks --seed 2 --gap 0.5:10 --all");
    let whole_m = json(&out.join("breaks.json"))["logs"][0]["whole"]["error_m"].as_f64().unwrap();
    assert!(whole_m < 0.02, "{whole_m}");
}

#[test]
fn breaks_that_cannot_be_are_told() {
    let log = small_log_in(&folder("suite_no_breaks"));
    let relations = folder("suite_no_breaks_relations").join("some.relations");
    fs::write(&relations, "900.0 901.0 0 0 0 0 0 0\n").unwrap();
    let with =
        |more: &[&str]| run(&[&["suite", "breaks", &log, "--relations", relations.to_str().unwrap()], more].concat());
    assert_refused(&run(&["suite", "breaks", &log]), 2, &["--relations"]);
    assert_refused(&with(&[&log]), 2, &["for each log", "2 logs and 1 of relations"]);
    assert_refused(&with(&["--gap", "0.5:3", "--places", "2"]), 2, &["--places"]);
    assert_refused(&with(&["--worlds", "2"]), 2, &["--worlds"]);
    assert_refused(&with(&[]), 1, &["small.clf", "more than 140 s", "--lengths"]);
    assert_refused(&with(&["--gap", "0.9:30"]), 1, &["small.clf", "expected scans after it"]);
    assert_refused(&with(&["--gap", "0.5:3"]), 1, &["small.clf", "expected relations"]);
}

#[test]
fn wrong_usage_is_told_before_anything_is_mapped() {
    assert_refused(&run(&["suite"]), 2, &["loops", "look-alike", "kidnapped", "noise"]);
    assert_refused(&run(&["suite", "loops", "--worlds", "0"]), 2, &["--worlds"]);
    assert_refused(&run(&["suite", "loops", "--length", "7"]), 2, &["50 to 2000 m"]);
    assert_refused(&run(&["suite", "loops", "--3d", "--length", "70"]), 2, &["--length", "--3d"]);
    assert_refused(&run(&["suite", "loops", "--beams", "16"]), 2, &["--3d"]);
    assert_refused(&run(&["suite", "drives"]), 2, &["--3d"]);
    assert_refused(&run(&["suite", "kidnapped", "--set", "map.colour=1"]), 2, &["map.colour"]);
}

#[test]
fn storeys_are_closed_and_compared_with_the_batch_solve() {
    let out = folder("suite_space_look_alike");
    let small = ["suite", "look-alike", "--3d", "--beams", "8", "--seconds", "125", "--worlds", "1", "--seed", "1"];
    let output = run(&[small.as_slice(), &["-o", out.to_str().unwrap()]].concat());
    assert!(matches!(output.status.code(), Some(0 | 3)), "{output:?}");
    let world = &worlds(&out.join("look-alike-3d.jsonl"))[0];
    let number = |key: &str| world[key].as_f64().unwrap();
    // The robot is back where it began and goes on around the same corner.
    assert!(number("loops") >= 1.0 && number("closed") <= number("loops") && number("times") > 5.0, "{world}");
    assert!(number("times_closed") <= number("times") && number("wrong") == 0.0, "{world}");
    assert_eq!(world["open_s"].as_array().unwrap().len() as f64, number("loops") - number("closed"));
    assert!(number("true_closures") > 5.0 && number("batch_ate_m") < 0.3, "{world}");
    assert!((number("ratio") - number("ate_m") / number("batch_ate_m")).abs() < 1e-9, "{world}");
    let summary = json(&out.join("look-alike-3d.json"));
    assert!(summary["loops"] == world["loops"] && summary["floors"][0]["holds"] == true, "{summary}");
}

#[test]
fn verdicts_in_space_are_compared_with_the_truth_fault_by_fault() {
    let out = folder("suite_space_verdicts");
    let small = ["suite", "verdicts", "--3d", "--beams", "8", "--seconds", "14", "--worlds", "1", "--seed", "4"];
    let output = run(&[small.as_slice(), &["-o", out.to_str().unwrap()]].concat());
    assert!(matches!(output.status.code(), Some(0 | 3)), "{output:?}");
    let world = &worlds(&out.join("verdicts-3d.jsonl"))[0];
    assert!(world["building"] == "two storeys" && world["with_odometry"] == true && world["clouds"] == 35, "{world}");
    let runs = world["runs"].as_array().unwrap();
    let of = |fault: &str| runs.iter().find(|run| run["fault"] == fault).unwrap();
    let (none, covered, coarse) = (of("none"), of("sensor covered for 5 of 20 s"), of("voxels of 8 m"));
    assert!(none["word"] == "good" && none["error_m"] == none["clean_m"], "{none}");
    assert!(coarse["word"] != "good" && coarse["error_m"].as_f64() > none["error_m"].as_f64(), "{coarse}");
    assert_eq!(
        [none, covered, of("every 2nd cloud")].map(|run| run["facts"]["clouds"].as_u64().unwrap()),
        [35, 35, 18]
    );
    let (words, summary) = (said(&output), json(&out.join("verdicts-3d.json")));
    assert!(words.contains("\nnone  ") && words.contains("\nvoxels of 8 m  "), "{words}");
    assert!(
        summary["runs"] == 14
            && summary["good"].as_u64() >= Some(1)
            && summary["floors"].as_array().unwrap().len() == 2,
        "{summary}"
    );
}

#[test]
fn drives_in_space_say_how_honest_the_covariances_are_whatever_the_threads() {
    let folder = folder("suite_drives");
    let drive = |name: &str, threads: &str| {
        let out = folder.join(name).display().to_string();
        let small = ["suite", "drives", "--3d", "--beams", "8", "--seconds", "8", "--worlds", "2", "--seed", "3"];
        run(&[small.as_slice(), &["--threads", threads, "-o", &out]].concat())
    };
    let (one, two) = (drive("one", "1"), drive("two", "2"));
    assert!(matches!(one.status.code(), Some(0 | 3)), "{one:?}");
    assert_eq!(said(&one), said(&two));
    let read = |run: &str| fs::read(folder.join(run).join("drives-3d.jsonl")).unwrap();
    assert!(read("one") == read("two"));
    let worlds = worlds(&folder.join("one/drives-3d.jsonl"));
    assert_eq!([&worlds[0], &worlds[1]].map(|world| world["building"].as_str().unwrap()), ["loops", "two storeys"]);
    for world in &worlds {
        let number = |key: &str| world[key].as_f64().unwrap();
        assert!(number("clouds") == 40.0 && number("untracked") < 5.0 && number("refused") == 0.0, "{world}");
        assert!((0.1..100.0).contains(&number("nees_mean")) && number("trajectory_ate_m") < 0.1, "{world}");
    }
    assert!(said(&one).contains("mean NEES from 4 to 8"));
}

#[test]
fn calibrations_are_compared_with_the_mounts_that_are_known() {
    let out = folder("suite_calibrations");
    let output = run(&["suite", "calibrations", "--worlds", "1", "--seed", "3", "-o", out.to_str().unwrap()]);
    assert!(matches!(output.status.code(), Some(0 | 3)), "{output:?}");
    let world = &worlds(&out.join("calibrations.jsonl"))[0];
    let off =
        |k: usize| (world["found"]["Ok"][k]["value"].as_f64().unwrap() - world["truth"][k].as_f64().unwrap()).abs();
    assert!(off(0) < 0.005 && off(1) < 0.005 && off(2) < 0.004 && off(3) < 0.02, "{world}");
    assert!(said(&output).contains("yaw within 3 standard deviations"));
}
