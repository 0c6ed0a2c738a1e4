//! `mapwright demo --show`: what rights a loop, in errors and pictures.

use crate::support::{assert_code, assert_refused, folder, picture_size, run, text};
use serde_json::Value;
use std::fs;
use std::path::Path;

fn errors(folder: &Path, what: &str, seed: u64) -> Value {
    let (out, seed) = (folder.join(format!("{what}-{seed}")), seed.to_string());
    let show = ["demo", "--show", what, "--length", "70", "--seed", &seed, "-o", out.to_str().unwrap(), "--json"];
    let output = run(&show);
    assert_code(&output, 0);
    for name in ["before.png", "after.png"] {
        assert!(fs::read(out.join(name)).unwrap().starts_with(b"\x89PNG"), "{what}: {name}");
    }
    let [before, after] = ["before.png", "after.png"].map(|name| out.join(name));
    assert_ne!(fs::read(&before).unwrap(), fs::read(&after).unwrap());
    assert_eq!(picture_size(&before), picture_size(&after), "{what}: both are in one frame");
    let value: Value = serde_json::from_slice(&output.stdout).unwrap();
    value["errors"].clone()
}

#[test]
fn each_lesson_is_shown_with_its_errors() {
    let folder = folder("show");
    let ate_m = |errors: &Value, what: &str| errors["ate_m"][what].as_f64().unwrap();
    // The ends of one open loop may meet by chance.
    let open: Vec<_> = [1, 2, 5].into_iter().map(|seed| errors(&folder, "no-closure", seed)).collect();
    let all_m = |what: &str| open.iter().map(|errors| ate_m(errors, what)).sum::<f64>();
    assert!(all_m("optimised") < 0.5 * all_m("open"), "{open:?}");
    assert!(open.iter().all(|errors| ate_m(errors, "optimised") < ate_m(errors, "open")), "{open:?}");
    let spread = errors(&folder, "spread", 5);
    assert!(ate_m(&spread, "spread") < 0.4 * ate_m(&spread, "wheels"), "{spread}");
    assert!(spread["gap"]["translation_m"].as_f64().unwrap() > 3.0, "{spread}");
    let false_closure = errors(&folder, "false-closure", 5);
    assert_eq!(false_closure["false_closure_outvoted"], true);
    assert!(ate_m(&false_closure, "obeyed") > 2.0 * ate_m(&false_closure, "outvoted"), "{false_closure}");
    assert!(ate_m(&false_closure, "outvoted") < 1.5 * ate_m(&false_closure, "without"), "{false_closure}");
}

#[test]
fn what_is_shown_is_said_in_words() {
    let out = folder("show_words").join("out");
    let output = run(&["demo", "--show", "spread", "--length", "60", "--seed", "2", "-o", out.to_str().unwrap()]);
    assert_code(&output, 0);
    let said = text(&output.stdout);
    ["loop of 60 m, seed 2", "before   wheels alone", "after    the error spread", "before.png after.png"]
        .iter()
        .for_each(|what| assert!(said.contains(what), "expected {what:?}, found {said}"));
    assert_refused(&run(&["demo", "--show", "nothing"]), 2, &["nothing", "false-closure"]);
    assert_refused(&run(&["demo", "--show", "spread", "--length", "5"]), 2, &["50 to 2000 m"]);
    assert_refused(&run(&["demo", "--length", "100"]), 2, &["--show"]);
}

#[test]
fn the_spread_is_shown_where_the_laser_knows_the_place_no_more() {
    let folder = folder("show_spread");
    let out = folder.join("out");
    // What is shown without a length: its wheels lead the robot so far astray that it would be lost.
    assert_code(&run(&["demo", "--show", "spread", "-o", out.to_str().unwrap()]), 0);
    assert!(out.join("after.png").exists());
    let sized = ["demo", "--show", "spread", "--length", "60", "--picture-side", "777", "-o", out.to_str().unwrap()];
    assert_code(&run(&sized), 0);
    for name in ["before.png", "after.png"] {
        assert_eq!(picture_size(&out.join(name)).iter().max(), Some(&777), "{name}");
    }
}
