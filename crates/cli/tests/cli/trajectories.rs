//! Trajectories as other tools write them, and folders of results, judged by `eval`.

use crate::support::{assert_code, assert_refused, folder, run, text};
use std::fs;
use std::path::Path;

/// A curve at ten poses a second; `row` writes a pose of stamp, x, y, and sine and cosine of half its heading.
fn curve(path: &Path, header: &str, row: impl Fn(f64, f64, f64, [f64; 2]) -> String) -> String {
    let rows = (0..200).map(|k| {
        let s = 0.1 * f64::from(k);
        let (sin, cos) = (0.25 * s).sin_cos();
        row(1_700_000_000.0 + s, 2.0 * (0.5 * s).sin(), 2.0 - 2.0 * (0.5 * s).cos(), [sin, cos]) + "\n"
    });
    fs::write(path, header.to_owned() + &rows.collect::<String>()).unwrap();
    path.display().to_string()
}

#[test]
fn commas_headers_clocks_and_orders_of_quaternions_are_read_or_named() {
    let folder = folder("eval_rows");
    let at = |name: &str| folder.join(name);
    let tum = |s: f64, x: f64, y: f64, [sin, cos]: [f64; 2]| format!("{s:.6} {x:.6} {y:.6} 0 0 0 {sin:.6} {cos:.6}");
    let reference = curve(&at("ref.tum"), "", tum);
    let eval = |path: &str| run(&["eval", path, "--reference", &reference]);
    let comma = |s: f64, x: f64, y: f64, [sin, cos]: [f64; 2]| format!("{s:.6},{x:.6},{y:.6},0,0,0,{sin:.6},{cos:.6}");
    for (header, name) in [("", "a.csv"), ("timestamp,x,y,z,qx,qy,qz,qw\n", "b.csv")] {
        let output = eval(&curve(&at(name), header, comma));
        assert_code(&output, 0);
        assert!(text(&output.stdout).contains("200 of 200 poses"), "{output:?}");
    }
    let later = |s: f64, x: f64, y: f64, half: [f64; 2]| tum(s + 37.0, x, y, half);
    let says = "all its stamps are 37.000 s later than the reference's";
    assert_refused(&eval(&curve(&at("tai.tum"), "", later)), 1, &[says]);
    let w_first =
        |s: f64, x: f64, y: f64, [sin, cos]: [f64; 2]| format!("{s:.6} {x:.6} {y:.6} 0 {cos:.6} 0 0 {sin:.6}");
    let output = eval(&curve(&at("w_first.tum"), "", w_first));
    assert_code(&output, 3);
    assert!(text(&output.stdout).contains("its quaternions have w first"), "{output:?}");
    assert!(!text(&eval(&reference).stdout).contains("w first"));
}

#[test]
fn a_folder_of_results_is_its_trajectory() {
    let folder = folder("eval_folder");
    let tum = |s: f64, x: f64, y: f64, [sin, cos]: [f64; 2]| format!("{s:.6} {x:.6} {y:.6} 0 0 0 {sin:.6} {cos:.6}");
    curve(&folder.join("trajectory.tum"), "", tum);
    let results = folder.to_str().unwrap();
    let output = run(&["eval", results, "--reference", results]);
    assert_code(&output, 0);
    assert!(text(&output.stdout).contains("200 of 200 poses"), "{output:?}");
    fs::remove_file(folder.join("trajectory.tum")).unwrap();
    assert_refused(&run(&["eval", results, "--reference", results]), 1, &["trajectory.tum", "No such file"]);
}
