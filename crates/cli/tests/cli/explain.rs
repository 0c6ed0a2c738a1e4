//! `mapwright explain` and the files it and `mapwright optimize` read.

use crate::support::{assert_code, assert_refused, folder, run, small_log_in, text};
use std::fs;
use std::process::Output;

const CLOSURES: &str = r#"{"keyframes": 50, "candidates": [
  {"from": 2, "to": 40, "from_stamp_s": 1.5, "to_stamp_s": 90.25, "detection": "pose", "verdict": "accepted",
   "reason": null, "evidence": {"points": 170, "score": 0.81, "ambiguity": 0.4, "overlap": 0.9, "inlier_share": 0.93,
   "contradiction": 0.01, "cycle_chi2": 2.5, "agreeing": 3}, "from_from_to": [0.1, -0.2, 0.05],
   "sigmas": [0.01, 0.01, 0.002]},
  {"from": 7, "to": 41, "from_stamp_s": 3.5, "to_stamp_s": 91.0, "detection": "place", "verdict": "refused",
   "reason": "another pose fits nearly as well", "evidence": {"points": 160, "score": 0.6, "ambiguity": 0.97,
   "overlap": null, "inlier_share": null, "contradiction": null, "cycle_chi2": null, "agreeing": 0},
   "from_from_to": null, "sigmas": null},
  {"from": 2, "to": 44, "from_stamp_s": 1.5, "to_stamp_s": 95.0, "detection": "place", "verdict": "taken back",
   "reason": "other closures contradict it", "evidence": {"points": 12, "score": null, "ambiguity": null,
   "overlap": null, "inlier_share": null, "contradiction": null, "cycle_chi2": null, "agreeing": 1},
   "from_from_to": null, "sigmas": null}],
  "slips": [{"from": 30, "from_stamp_s": 61.5, "scan": 211, "metres": 0.4}]}"#;

/// Explains what stands in a folder of this name; tests run side by side, each in its own.
fn explain(name: &str, closures: &str, more: &[&str]) -> Output {
    let out = folder(name);
    fs::write(out.join("closures.json"), closures).unwrap();
    run(&[&["explain", out.to_str().unwrap()], more].concat())
}

#[test]
fn candidates_are_told_with_verdict_reason_and_numbers() {
    let said = |more: &[&str]| {
        let output = explain("explain_told", CLOSURES, more);
        assert_code(&output, 0);
        text(&output.stdout)
    };
    let all = said(&[]);
    let expected = [
        "3 candidates among 50 keyframes: 1 accepted, 1 withdrawn, 1 refused",
        "2 (1.500 s) -> 40 (90.250 s), found by pose, at 0.100 m -0.200 m 2.86 deg",
        "score 0.81",
        "cycle chi-square 2.5",
        "refused, another pose fits nearly as well: 1",
        "score 0.60, share of it that the runner-up scores 0.97",
        "1 slip of the wheels",
        "30 (61.500 s): 0.400 m, settled by scan 211",
    ];
    expected.iter().for_each(|what| assert!(all.contains(what), "expected {what:?}, found {all}"));
    let pairs = |more: &[&str]| said(more).lines().filter(|line| line.contains(" -> ")).count();
    assert_eq!(pairs(&["--accepted"]), 1);
    assert_eq!(pairs(&["--refused"]), 2);
    assert_eq!(pairs(&["--keyframe", "2"]), 2);
    assert_eq!(pairs(&["--refused", "--keyframe", "44"]), 1);
    assert!(said(&["--keyframe", "9"]).contains("shown: 0"));
    let slips = |more: &[&str]| said(more).contains("of the wheels");
    assert!(slips(&["--keyframe", "30"]) && !slips(&["--keyframe", "9"]) && !slips(&["--accepted"]));
    let older = CLOSURES.replace("\"slips\"", "\"notes\"");
    let output = explain("explain_older", &older, &[]);
    assert_code(&output, 0);
    let said = text(&output.stdout);
    assert!(said.contains("candidates among 50 keyframes") && !said.contains("of the wheels"), "{said}");
}

#[test]
fn candidates_over_a_break_say_what_they_join() {
    let joins = r#""joins": [{"start": "switched on", "stamp_s": 0.5}, {"start": "blind", "stamp_s": 88.0}], "sigmas""#;
    let output = explain("explain_joins", &CLOSURES.replace("\"sigmas\"", joins), &[]);
    assert_code(&output, 0);
    let said = text(&output.stdout);
    let fragments = "the fragment that began blind at 88.000 s with the one that began at 0.500 s (switched on)";
    let expected = [
        "1 accepted, 1 withdrawn, 1 refused; 1 joins fragments over a break".to_owned(),
        format!(
            "-> 40 (90.250 s), found by pose, at 0.100 m -0.200 m 2.86 deg +- 0.010 m 0.010 m 0.11 deg\n      joins {fragments}\n"
        ),
        format!("      would have joined {fragments}\n"),
        format!("      joined, until it was taken back, {fragments}\n"),
    ];
    expected.iter().for_each(|what| assert!(said.contains(what), "expected {what:?}, found {said}"));
}

#[test]
fn damaged_files_are_refused_in_words() {
    let refused = |closures: &str, says: &[&str]| assert_refused(&explain("explain_damaged", closures, &[]), 1, says);
    refused("", &["closures.json", "line 1"]);
    refused(&CLOSURES[..300], &["closures.json", "EOF", "line"]);
    refused(&CLOSURES.replace("\"accepted\"", "\"perhaps\""), &["perhaps", "expected one of", "`withdrawn`"]);
    refused(&CLOSURES.replace("\"to\": 44,", ""), &["missing field `to`", "line"]);
    refused(&CLOSURES.replace("\"to\": 44,", "\"to\": -4,"), &["-4", "expected u32"]);
    refused(&CLOSURES.replace("\"to\": 44,", "\"to\": 50,"), &["candidate 2", "keyframes below 50", "found 50"]);
    refused(&CLOSURES.replace("0.81", "1e999"), &["number out of range"]);
    let nowhere = folder("explain_nowhere");
    assert_refused(&run(&["explain", nowhere.to_str().unwrap()]), 1, &["closures.json", "No such file"]);
    assert_refused(&run(&["explain", "x", "--refused", "--accepted"]), 2, &["cannot be used with"]);
    for cut in 0..CLOSURES.len() {
        // Any other end of the file is as good: nothing may panic.
        if cut % 97 == 0 {
            assert_code(&explain("explain_damaged", &CLOSURES[..cut], &[]), 1);
        }
    }
}

#[test]
fn a_run_leaves_its_graph_and_its_candidates() {
    let folder = folder("graph");
    let (log, out) = (small_log_in(&folder), folder.join("out"));
    assert_code(&run(&["map", &log, "-o", out.to_str().unwrap(), "--quiet"]), 0);
    let explained = run(&["explain", out.to_str().unwrap()]);
    assert_code(&explained, 0);
    assert!(text(&explained.stdout).contains("candidates among"), "{explained:?}");
    let (graph, solved) = (out.join("graph.g2o"), out.join("solved.g2o"));
    let keyframes = fs::read_to_string(&graph).unwrap().lines().filter(|line| line.starts_with("VERTEX_SE2")).count();
    assert!(text(&explained.stdout).contains(&format!("{keyframes} keyframes")));
    let optimized = run(&["optimize", graph.to_str().unwrap(), "-o", solved.to_str().unwrap(), "--json"]);
    assert_code(&optimized, 0);
    let value: serde_json::Value = serde_json::from_slice(&optimized.stdout).unwrap();
    assert_eq!(value["vertices"], keyframes);
    assert!(value["connected_parts"] == 1 && value["converged"] == true, "{value}");
}
