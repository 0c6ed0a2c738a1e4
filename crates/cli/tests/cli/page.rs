//! `mapwright report` and `mapwright compare`: what stands in the page, and what a click shows in a browser.

use crate::browser::{Browser, chromium};
use crate::support::{assert_code, assert_refused, folder, json, poses, run, small_log, text};
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// A simulated floor, mapped: closures, doubt and the truth.
fn office() -> &'static Path {
    static OUT: OnceLock<PathBuf> = OnceLock::new();
    OUT.get_or_init(|| {
        let out = folder("page_office").join("out");
        assert_code(&run(&["demo", "-o", out.to_str().unwrap(), "--quiet"]), 0);
        out
    })
}

/// The page of a folder of results, written beside it under a name.
fn page(results: &Path, name: &str, more: &[&str]) -> (PathBuf, String) {
    let path = results.with_file_name(name);
    let arguments = [&["report", results.to_str().unwrap(), "-o", path.to_str().unwrap()], more].concat();
    assert_code(&run(&arguments), 0);
    (path.clone(), fs::read_to_string(path).unwrap())
}

/// What the script of a page is told.
fn data(html: &str) -> Value {
    let from = html.split_once("<script type=\"application/json\" id=\"data\">").unwrap().1;
    serde_json::from_str(from.split_once("</script>").unwrap().0).unwrap()
}

#[test]
fn a_page_is_one_file_and_the_same_again() {
    let (_, html) = page(office(), "once.html", &[]);
    assert_eq!(page(office(), "twice.html", &[]).1, html);
    assert!(html.len() < 1_500_000, "{}", html.len());
    let outside = ["src=\"http", "href=\"http", "url(http", "@import", "<link", "src=\"//"];
    outside.iter().for_each(|what| assert!(!html.contains(what), "{what}"));
    let sections = ["In numbers", "The map", "Closures", "Errors", "Over the run", "What was read", "Settings"];
    sections.iter().for_each(|title| assert!(html.contains(title), "{title}"));
    // pictures are letters that may say anything
    let words: String =
        html.split("base64,").map(|part| part.split_once('"').map_or(part, |(_, after)| after)).collect();
    assert!(!words.contains("{{") && !words.contains("NaN"));
    // beside the results where nothing else is asked for
    assert_code(&run(&["report", office().to_str().unwrap()]), 0);
    assert_eq!(fs::read_to_string(office().join("report.html")).unwrap(), html);
}

#[test]
fn every_candidate_is_told_as_it_was_decided() {
    let html = page(office(), "told.html", &[]).1;
    let (told, closures) = (data(&html), json(&office().join("closures.json")));
    let (told, closures) = (told["a"]["closures"].as_array().unwrap(), closures["candidates"].as_array().unwrap());
    assert!(told.len() == closures.len() && told.len() > 10);
    let poses = poses(office());
    let at = |stamp_s: f64| {
        let pose = poses.iter().find(|pose| (pose[0] - stamp_s).abs() < 1e-4).unwrap();
        [pose[1], pose[2], 2.0 * pose[6].atan2(pose[7])]
    };
    let mut apart_m = Vec::new();
    for (told, known) in told.iter().zip(closures) {
        assert!((&told["verdict"], &told["from"], &told["to"]) == (&known["verdict"], &known["from"], &known["to"]));
        let reason = told["reason"].as_str().unwrap();
        known["reason"].as_str().iter().for_each(|why| assert!(reason.contains(why), "{reason}"));
        // where the older keyframe is in the map, and where the newer one is as the map has it and as the match found it, to the digits shown
        let [from, to] = ["from_stamp_s", "to_stamp_s"].map(|end| at(known[end].as_f64().unwrap()));
        let is_told = |which: &str, expected: [f64; 2]| {
            let off = |k: usize| (told["placing"][which][k].as_f64().unwrap() - expected[k]).abs();
            assert!(off(0) < 1e-4 && off(1) < 1e-4, "{which} {expected:?}: {told}");
        };
        let mapped = [to[0] - from[0], to[1] - from[1]];
        is_told("mapped", mapped);
        let found = known["from_from_to"].as_array();
        assert_eq!(told["placing"]["found"].is_array(), found.is_some());
        if let Some(found) = found {
            let (x, y, (sin, cos)) = (found[0].as_f64().unwrap(), found[1].as_f64().unwrap(), from[2].sin_cos());
            let found = [cos * x - sin * y, sin * x + cos * y];
            is_told("found", found);
            if known["verdict"] == "accepted" {
                apart_m.push((found[0] - mapped[0]).abs().max((found[1] - mapped[1]).abs()));
            }
        }
    }
    // both are the same to some centimetres, once it is a closure; along a corridor, where a match says least, half of all demos have one
    // that the others overrule
    let within = |most_m: f64| apart_m.iter().filter(|apart_m| **apart_m < most_m).count() as f64;
    let all = apart_m.len() as f64;
    assert!(all > 10.0 && within(0.02) >= 0.75 * all && within(0.1) >= 0.9 * all && within(0.5) >= all, "{apart_m:?}");
    let rows = html.matches("<tr data-row=").count();
    assert_eq!(rows, closures.len());
}

#[test]
fn errors_are_those_of_eval() {
    let (truth, found) = (office().join("truth.tum"), office().join("trajectory.tum"));
    let [truth, found] = [&truth, &found].map(|path| path.to_str().unwrap());
    let judged = run(&["eval", found, "--reference", truth, "--delta", "1m", "--json"]);
    let judged: Value = serde_json::from_slice(&judged.stdout).unwrap();
    let rmse = |of: &str| judged[0][of]["translation_m"]["rmse"].as_f64().unwrap();
    let three_digits = |value: f64| {
        let decimals = (2.0 - value.log10().floor()) as usize;
        format!("{value:.decimals$}")
    };
    let expected = format!("ATE {} m rms", three_digits(rmse("ate")));
    for more in [&[][..], &["--reference", truth]] {
        let html = page(office(), "errors.html", more).1;
        assert!(html.contains(&expected), "{expected}");
        assert!(html.contains(&format!("of way {} m", three_digits(rmse("rpe")))), "{judged}");
    }
}

#[test]
fn a_verdict_and_names_are_shown_as_text() {
    let out = folder("page_verdict").join("out");
    fs::create_dir_all(&out).unwrap();
    for name in ["session.mapwright", "report.json", "timing.json"] {
        fs::copy(office().join(name), out.join(name)).unwrap();
    }
    let hostile = "</script><img src=x onerror=alert(1)>.clf";
    let mut report = json(&out.join("report.json"));
    assert!(!page(&out, "without.html", &[]).1.contains("class=\"verdict") || report["verdict"].is_object());
    report["log"] = hostile.into();
    report["losses"] = serde_json::json!([hostile]);
    let reason = serde_json::json!({ "words": "walls stand <twice>", "evidence": { "doubled_share": 0.25 } });
    report["verdict"] = serde_json::json!({ "word": "check", "reasons": [reason] });
    fs::write(out.join("report.json"), report.to_string()).unwrap();
    let html = page(&out, "with.html", &[]).1;
    assert!(!html.contains("<img") && html.contains("&lt;img src=x"));
    assert!(html.contains("class=\"verdict check\"") && html.contains("walls stand &lt;twice&gt;"), "no verdict");
    assert!(!html.contains("doubled share") && !html.contains("doubled_share"), "a key is no word");
    assert!(!html.contains("id=\"errors\""), "without a reference there are no errors");
}

#[test]
fn what_is_not_there_is_said() {
    let out = folder("page_session_alone");
    fs::copy(office().join("session.mapwright"), out.join("session.mapwright")).unwrap();
    let made = run(&["report", out.to_str().unwrap()]);
    assert_code(&made, 3);
    assert!(text(&made.stdout).contains("report.json is not in the folder"), "{made:?}");
    assert!(fs::read_to_string(out.join("report.html")).unwrap().contains("timing.json is not in the folder"));
    let nowhere = folder("page_nowhere");
    assert_refused(&run(&["report", nowhere.to_str().unwrap()]), 1, &["session.mapwright", "mapwright map"]);
    fs::write(out.join("report.json"), "{\"log\": ").unwrap();
    assert_refused(&run(&["report", out.to_str().unwrap()]), 1, &["report.json", "EOF"]);
    fs::write(out.join("report.json"), "[1, {\"status\": 3}]").unwrap();
    assert_code(&run(&["report", out.to_str().unwrap()]), 3);
    let kitti = out.join("kitti.txt");
    fs::write(&kitti, "1 0 0 0 0 1 0 0 0 0 1 0\n").unwrap();
    let refused = run(&["report", out.to_str().unwrap(), "--reference", kitti.to_str().unwrap()]);
    assert_refused(&refused, 1, &["kitti.txt", "expected stamps", "found 1 of KITTI's rows"]);
}

#[test]
fn a_damaged_session_has_a_page_of_what_is_left() {
    let out = folder("page_damaged");
    let session = fs::read(office().join("session.mapwright")).unwrap();
    for cut in [24, 400, session.len() / 7, session.len() / 2] {
        fs::write(out.join("session.mapwright"), &session[..cut]).unwrap();
        let made = run(&["report", out.to_str().unwrap()]);
        assert_code(&made, 3);
        assert!(fs::read_to_string(out.join("report.html")).unwrap().contains("<h2 id=\"map-title\">"));
    }
}

#[test]
fn two_runs_stand_side_by_side() {
    let folder = folder("page_compare");
    let (log, out) = (folder.join("small.clf"), ["one", "two"].map(|name| folder.join(name).display().to_string()));
    fs::write(&log, small_log()).unwrap();
    let map = |out: &str, more: &[&str]| {
        assert_code(&run(&[&["map", log.to_str().unwrap(), "-o", out, "--quiet"], more].concat()), 0);
    };
    map(&out[0], &[]);
    map(&out[1], &["--set", "map.resolution_m=0.1"]);
    let path = folder.join("both.html");
    let compare = || {
        assert_code(&run(&["compare", &out[0], &out[1], "-o", path.to_str().unwrap()]), 0);
        fs::read_to_string(&path).unwrap()
    };
    let html = compare();
    assert_eq!(compare(), html);
    assert!(html.matches("<svg class=\"map\"").count() == 2 && html.contains("id=\"map-b-0\""));
    assert!(html.contains("<code>map.resolution_m</code></th><td>0.05 m</td><td>0.1 m</td>"), "differing settings");
    assert!(!html.contains("<code>scan.free_range_m</code>"), "those that do not differ are left out");
    assert!(html.contains("How far the two ways are apart") && html.contains("ATE "));
    assert!(data(&html)["b"]["way"].as_array().unwrap().len() > 10);
}

#[test]
fn relations_are_scored_as_eval_does() {
    let truth: Vec<Vec<f64>> = fs::read_to_string(office().join("truth.tum"))
        .unwrap()
        .lines()
        .filter(|line| !line.starts_with('#'))
        .map(|line| line.split(' ').map(|word| word.parse().unwrap()).collect())
        .collect();
    let relation = |[a, b]: [&Vec<f64>; 2]| {
        let yaw = |pose: &Vec<f64>| 2.0 * pose[6].atan2(pose[7]);
        let ([dx, dy], (s, c)) = ([b[1] - a[1], b[2] - a[2]], yaw(a).sin_cos());
        let turn = (yaw(b) - yaw(a)).sin().atan2((yaw(b) - yaw(a)).cos());
        format!("{:.6} {:.6} {} {} 0 0 0 {turn}\n", a[0], b[0], c * dx + s * dy, c * dy - s * dx)
    };
    let pairs =
        (0..truth.len() - 900).step_by(400).flat_map(|k| [[&truth[k], &truth[k + 20]], [&truth[k], &truth[k + 900]]]);
    let path = office().with_file_name("office.relations");
    fs::write(&path, pairs.map(relation).collect::<String>()).unwrap();
    let (relations, found) = (path.to_str().unwrap(), office().join("trajectory.tum"));
    let judged = run(&["eval", found.to_str().unwrap(), "--relations", relations, "--json"]);
    let judged: Value = serde_json::from_slice(&judged.stdout).unwrap();
    let mean = judged[0]["all"]["translation_m"]["mean"].as_f64().unwrap();
    assert!(mean > 0.0 && mean < 0.05, "{judged}");
    for option in ["--reference", "--relations"] {
        let html = page(office(), "related.html", &[option, relations]).1;
        assert!(html.contains("id=\"relations\"") && html.contains(&format!("<td>{mean:.4} ± ")), "{option}: {mean}");
        assert!(html.contains(&format!("{} relations used, 0 missing", judged[0]["used"])), "{judged}");
        assert!(html.contains("id=\"errors\""), "the truth in the folder is shown as well");
    }
    assert!(!page(office(), "unrelated.html", &[]).1.contains("id=\"relations\""));
}

#[test]
fn maps_of_space_have_pages_too() {
    let out = folder("page_space").join("out");
    assert_code(&run(&["demo", "--3d", "--seconds", "12", "-o", out.to_str().unwrap(), "--quiet"]), 0);
    let html = page(&out, "space.html", &[]).1;
    assert!(html.contains("a map of space") && html.contains("Absolute error (ATE)"));
    assert!(html.len() < 3_000_000, "{}", html.len());
    assert!(html.contains("<noscript>") && html.contains("points, one in each cube of"));
    // the way is drawn from above and from the side
    assert_eq!(html.matches("<path class=\"way\"").count(), 2);
    assert_eq!(data(&html)["a"]["way"][0][2].as_array().unwrap().len(), 4);
}

#[test]
fn a_map_of_space_is_turned_in_a_browser() {
    let Some(chromium) = chromium() else {
        eprintln!("a map that turns in a browser: skipped: no Chromium (MAPWRIGHT_CHROMIUM or chromium in PATH)");
        return;
    };
    let out = folder("page_turning").join("out");
    assert_code(&run(&["demo", "--3d", "--seconds", "12", "-o", out.to_str().unwrap(), "--quiet"]), 0);
    let (path, html) = page(&out, "turning.html", &[]);
    let mut browser = Browser::open(&chromium, &folder("turning_profile"), &path);
    let canvas = "document.querySelector('figure.turning canvas')";
    browser.wait_for(&format!("Boolean({canvas}.dataset.drawn) || {canvas}.hidden"));
    if browser.value(&format!("{canvas}.hidden")) == true {
        eprintln!("a map that turns in a browser: skipped: Chromium without WebGL");
        let told = browser.text("document.querySelector('figure.turning figcaption').textContent");
        assert!(told.contains("no WebGL"), "{told}");
        return;
    }
    let told = data(&html)["a"]["turning"]["0"]["points"].as_str().unwrap().len() / 4 * 3 / 8;
    let drawn = browser.text(&format!("{canvas}.dataset.drawn"));
    let points: usize = drawn.split(',').next().unwrap().parse().unwrap();
    assert!(points > 1000 && points.abs_diff(told) <= 1, "{drawn} of {told}");
    // pixels that are not the ground, their colours, and a sum that tells two pictures apart
    let pixels = format!(
        "(() => {{ const c = {canvas}, gl = c.getContext('webgl'), all = new Uint8Array(4 * c.width * c.height); \
         gl.readPixels(0, 0, c.width, c.height, gl.RGBA, gl.UNSIGNED_BYTE, all); const seen = new Set(); let sum = 0, shown = 0; \
         for (let k = 0; k < all.length; k += 4) {{ const v = all[k] << 16 | all[k + 1] << 8 | all[k + 2]; seen.add(v); \
         if (k > 0 && v !== (all[0] << 16 | all[1] << 8 | all[2])) shown += 1; sum = (sum * 31 + v) % 1000000007; }} \
         return [shown / (c.width * c.height), seen.size, sum]; }})()"
    );
    let look = |browser: &mut Browser| look(browser, &pixels);
    let first = look(&mut browser);
    assert!(first[0] > 0.05 && first[1] > 20.0, "{first:?}");
    browser.value(&format!("{canvas}.focus()"));
    assert!(browser.text("getComputedStyle(document.activeElement).outlineStyle") != "none", "focus is seen");
    let mut last = first;
    for (key, code, text) in [("ArrowLeft", 37, ""), ("ArrowUp", 38, ""), ("+", 187, "+"), ("-", 189, "-")] {
        browser.key(key, code, text);
        let now = look(&mut browser);
        assert!(now[2] != last[2] && now[0] > 0.02, "{key}: {last:?} {now:?}");
        last = now;
    }
    let words = browser.text("document.querySelector('figure.turning .at').textContent");
    assert!(words.contains("° above"), "{words}");
    browser.key("0", 48, "0");
    assert_eq!(look(&mut browser), first, "as at first");
    browser.click("[data-turn=above]");
    assert!(look(&mut browser)[2] != first[2]);
    // what is higher than the slider says goes
    let above = look(&mut browser);
    browser.value(
        "(() => { const range = document.querySelector('figure.turning input'); range.value = range.min; \
         range.dispatchEvent(new Event('input')); })()",
    );
    assert!(look(&mut browser)[0] < 0.5 * above[0], "{above:?}");
    assert_eq!(
        browser.value("performance.getEntriesByType('resource').filter((r) => !r.name.startsWith('data:')).length"),
        0
    );
    // one storey needs no button; with a second one, said to begin just above the sensor, S puts it beside the first, and back
    assert!(!html.contains("data-turn=\"storeys\"") && !html.contains("<kbd>S</kbd>"));
    let [[begin_m, level_m]]: [[f64; 2]; 1] =
        serde_json::from_value(data(&html)["a"]["turning"]["0"]["storeys"].clone()).unwrap();
    let [one, two] = [format!("[[{begin_m:?},{level_m:?}]]"), format!("[[{begin_m},{level_m}],[{level_m},{level_m}]]")];
    assert_eq!(html.matches(&one).count(), 1, "{one}");
    let path = path.with_file_name("storeys.html");
    fs::write(&path, html.replace(&one, &two)).unwrap();
    drop(browser);
    let mut browser = Browser::open(&chromium, &folder("storeys_profile"), &path);
    browser.wait_for(&format!("Boolean({canvas}.dataset.drawn)"));
    let captions = "[...document.querySelectorAll('figure.turning .caption')].filter((c) => !c.hidden).map((c) => c.textContent).join()";
    browser.value(&format!("{canvas}.focus()"));
    let first = look(&mut browser);
    assert_eq!(browser.text(captions), "");
    browser.key("s", 83, "s");
    assert!(look(&mut browser)[2] != first[2]);
    assert_eq!(browser.text(captions), "storey 1 of 2,storey 2 of 2");
    browser.key("s", 83, "s");
    assert_eq!((look(&mut browser), browser.text(captions)), (first, String::new()));
}

/// What pixels say two frames later, when everything that is asked for is drawn.
fn look(browser: &mut Browser, pixels: &str) -> [f64; 3] {
    browser.value(
        "window.frames_seen = 0; requestAnimationFrame(() => requestAnimationFrame(() => { window.frames_seen = 2; }))",
    );
    browser.wait_for("window.frames_seen === 2");
    serde_json::from_value(browser.value(pixels)).unwrap()
}

#[test]
fn a_closure_is_clicked_and_a_layer_switched_in_a_browser() {
    let Some(chromium) = chromium() else {
        eprintln!("a page in a browser: skipped: no Chromium (MAPWRIGHT_CHROMIUM or chromium in PATH)");
        return;
    };
    let (path, html) = page(office(), "clicked.html", &[]);
    let mut browser = Browser::open(&chromium, &folder("page_profile"), &path);
    layers_are_switched(&mut browser);
    closures_are_clicked(&mut browser, &data(&html));
    maps_are_enlarged(&mut browser);
    assert_eq!(
        browser.value("performance.getEntriesByType('resource').filter((r) => !r.name.startsWith('data:')).length"),
        0
    );
}

/// The boxes of all elements that the selector finds: left, top, right and bottom on the page.
fn boxes(browser: &mut Browser, selector: &str) -> Vec<[f64; 4]> {
    let script = format!(
        "[...document.querySelectorAll({selector:?})].map((e) => e.getBoundingClientRect()).map((b) => \
         [b.left, b.top + scrollY, b.right, b.bottom + scrollY])"
    );
    serde_json::from_value(browser.value(&script)).unwrap()
}

fn set_size(browser: &mut Browser, width: u32, height: u32) {
    let size = serde_json::json!({ "width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600 });
    browser.call("Emulation.setDeviceMetricsOverride", &size);
    browser.wait_for(&format!("innerWidth === {width}"));
}

#[test]
fn the_map_comes_first_and_nothing_overflows_on_a_phone() {
    let Some(chromium) = chromium() else {
        eprintln!("a page on a phone: skipped: no Chromium (MAPWRIGHT_CHROMIUM or chromium in PATH)");
        return;
    };
    // a long name without a blank, and closures and further lists of all kinds
    let out = folder("page_phone").join("a-very-long-name-of-a-folder-".repeat(5)).join("out");
    fs::create_dir_all(&out).unwrap();
    for name in ["session.mapwright", "report.json", "timing.json", "truth.tum"] {
        fs::copy(office().join(name), out.join(name)).unwrap();
    }
    let (path, _) = page(&out, "phone.html", &[]);
    let mut browser = Browser::open(&chromium, &folder("phone_profile"), &path);
    set_size(&mut browser, 1280, 800);
    let top = |browser: &mut Browser, selector: &str| boxes(browser, selector)[0][1];
    let (map, numbers) = (top(&mut browser, "svg.map"), top(&mut browser, "dl.numbers"));
    assert!(map < 400.0 && map < numbers, "the map at {map}, the numbers at {numbers}");
    charts_have_one_axis(&mut browser);
    for width in [390, 320] {
        set_size(&mut browser, width, 844);
        browser.value("document.querySelectorAll('details').forEach((details) => { details.open = true; })");
        // what a box of its own scrolls may be wider
        let wide = "[...document.querySelectorAll('body *')].filter((e) => e.getBoundingClientRect().right > innerWidth + 0.5 && \
                    !e.closest('table, svg, .skip, .scroll')).map((e) => e.outerHTML.slice(0, 120))";
        assert_eq!(browser.value(wide), serde_json::json!([]), "at {width}");
        assert_eq!(browser.value("document.documentElement.scrollWidth"), width);
        let table = browser
            .value("(() => { const s = document.querySelector('.scroll'); return s.scrollWidth - s.clientWidth; })()");
        assert_eq!(table, 0, "the table of closures at {width}");
    }
}

/// The status bar ends where the axes of the charts below it do.
fn charts_have_one_axis(browser: &mut Browser) {
    let bar = boxes(browser, ".over rect.tracking")[0];
    let axes = boxes(browser, ".over path.grid");
    assert!(axes.len() >= 4);
    for axis in axes {
        assert!((axis[0] - bar[0]).abs() < 0.6 && (axis[2] - bar[2]).abs() < 0.6, "{axis:?} beside {bar:?}");
    }
}

#[test]
fn every_mark_on_the_map_is_in_the_legend() {
    let html = page(office(), "marks.html", &[]).1;
    let (legend, map) = (html.split_once("<fieldset class=\"layers\">").unwrap().1, &html);
    let legend = legend.split_once("</fieldset>").unwrap().0;
    for mark in ["start", "end", "break", "next"] {
        let is_drawn = map.contains(&format!("class=\"mark {mark}\""));
        assert_eq!(legend.contains(&format!("class=\"sign {mark}\"")), is_drawn, "{mark}");
    }
    for verdict in ["accepted", "refused", "waiting", "withdrawn"] {
        let is_drawn = map.contains(&format!("class=\"closure {verdict}\""));
        let is_told = ["sign", "swatch"].iter().any(|kind| legend.contains(&format!("class=\"{kind} {verdict}\"")));
        assert_eq!(is_told, is_drawn, "{verdict}");
    }
    assert!(html.contains("<h2 id=\"next-title\">Where to drive next</h2>"));
}

#[test]
fn drives_of_different_years_have_charts_of_what_was_driven() {
    let folder = folder("page_years");
    let (log, later) = (folder.join("small.clf"), folder.join("later.clf"));
    fs::write(&log, small_log()).unwrap();
    // ten years on: the last two stamps of each line
    let shifted = |line: &str| {
        let mut words: Vec<String> = line.split(' ').map(str::to_owned).collect();
        let count = words.len();
        let stamps =
            if count > 4 && !line.starts_with(['#', 'P']) { [count - 3, count - 1].to_vec() } else { Vec::new() };
        for at in stamps {
            if let Ok(seconds) = words[at].parse::<f64>() {
                words[at] = format!("{:.6}", seconds + 3.2e8);
            }
        }
        words.join(" ") + "\n"
    };
    fs::write(&later, text(small_log()).lines().map(shifted).collect::<String>()).unwrap();
    let out = folder.join("out");
    let [first, second, both] = [&log, &later, &out].map(|path| path.to_str().unwrap());
    let code = run(&["merge", first, second, "-o", both, "--quiet"]).status.code();
    assert!(code == Some(0) || code == Some(3), "{code:?}");
    let html = page(&out, "years.html", &[]).1;
    let length_s: f64 =
        html.split_once("data-plot=\"56,712,").unwrap().1.split(['"', ',']).next().unwrap().parse().unwrap();
    assert!(length_s < 200.0 && html.contains("Time is that of 2 drives"), "{length_s}");
    let times = data(&html)["a"]["way"].as_array().unwrap().len();
    assert!(times > 100, "{times} points of the way");
}

#[test]
fn two_maps_move_together_until_they_are_told_not_to() {
    let Some(chromium) = chromium() else {
        eprintln!("two maps in a browser: skipped: no Chromium (MAPWRIGHT_CHROMIUM or chromium in PATH)");
        return;
    };
    let path = office().with_file_name("coupled.html");
    let [out, page] = [office(), &path].map(|path| path.to_str().unwrap());
    assert_code(&run(&["compare", out, out, "-o", page]), 0);
    let mut browser = Browser::open(&chromium, &folder("coupled_profile"), &path);
    let boxes = |browser: &mut Browser| {
        let of = |id: &str| format!("document.getElementById('map-{id}-0').getAttribute('viewBox')");
        ["a", "b"].map(|id| {
            let text = browser.text(&of(id));
            text.split(' ').map(|number| number.parse::<f64>().unwrap()).collect::<Vec<_>>()
        })
    };
    let are_alike = |[a, b]: &[Vec<f64>; 2]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 0.01 * a.abs().max(1.0));
    let whole = boxes(&mut browser);
    browser.click("[data-run=a] [data-zoom=in]");
    browser.value("document.getElementById('map-b-0').focus()");
    browser.key("+", 187, "+");
    browser.key("ArrowRight", 39, "");
    let enlarged = boxes(&mut browser);
    assert!(are_alike(&enlarged) && enlarged[0][2] < 0.5 * whole[0][2], "{whole:?} {enlarged:?}");
    browser.click("#coupled");
    browser.click("[data-run=a] [data-zoom=in]");
    let apart = boxes(&mut browser);
    assert!(apart[1] == enlarged[1] && apart[0][2] < 0.8 * enlarged[0][2], "{enlarged:?} {apart:?}");
    browser.click("#coupled");
    browser.click("[data-run=a] [data-zoom=all]");
    assert_eq!(boxes(&mut browser), whole);
}

fn layers_are_switched(browser: &mut Browser) {
    let is_shown = |browser: &mut Browser, layer: &str| {
        browser.text(&format!("getComputedStyle(document.querySelector('.layer-{layer}')).display")) != "none"
    };
    for (layer, at_first) in [("path", true), ("doubt", true), ("uncertainty", false)] {
        assert_eq!(is_shown(browser, layer), at_first, "{layer}");
        browser.click(&format!("input[data-layer={layer}]"));
        assert_eq!(is_shown(browser, layer), !at_first, "{layer}");
    }
    // and by the keyboard
    browser.value("document.querySelector('input[data-layer=path]').focus()");
    browser.key(" ", 32, " ");
    assert!(is_shown(browser, "path"));
}

fn closures_are_clicked(browser: &mut Browser, data: &Value) {
    let closures = data["a"]["closures"].as_array().unwrap();
    let accepted = closures.iter().position(|closure| closure["verdict"] == "accepted").unwrap();
    let refused = closures.iter().position(|closure| closure["verdict"] == "refused").unwrap();
    let is_told = |browser: &mut Browser, number: usize| {
        assert_eq!(browser.text("document.getElementById('detail-reason').textContent"), closures[number]["reason"]);
        let drawn = browser.text("document.getElementById('overlay').dataset.drawn");
        let points: Vec<usize> = drawn.split(',').map(|points| points.parse().unwrap()).collect();
        assert!(points.iter().all(|&points| points > 50), "{drawn}");
    };
    // on the map, where nothing lies over it
    browser.click("button.choose");
    browser.click("#close");
    assert_eq!(browser.value("document.getElementById('detail-body').hidden"), true);
    let top = "(() => { const all = [...document.querySelectorAll('.layer-closures .closure')]; return all.at(-1).dataset.closure; })()";
    let top: usize = browser.text(top).parse().unwrap();
    browser.click(&format!(".layer-closures .closure[data-closure=\"{top}\"] .mark"));
    is_told(browser, top);
    assert!(
        closures[top]["verdict"] == "accepted" && browser.text("location.hash") == format!("#closure=a-{}", top + 1)
    );
    // in the table
    browser.click(&format!("button.choose[data-closure=\"{refused}\"]"));
    is_told(browser, refused);
    // by the keyboard, and back
    browser.value(&format!("document.querySelector('button.choose[data-closure=\"{accepted}\"]').focus()"));
    browser.key("Enter", 13, "\r");
    is_told(browser, accepted);
    assert_eq!(browser.text("document.activeElement.id"), "detail-title");
    browser.key("Escape", 27, "");
    assert_eq!(browser.text("document.activeElement.dataset.closure"), accepted.to_string());
}

fn maps_are_enlarged(browser: &mut Browser) {
    let width = "document.querySelector('svg.map').viewBox.baseVal.width";
    let whole = browser.value(width).as_f64().unwrap();
    browser.click("[data-zoom=in]");
    let enlarged = browser.value(width).as_f64().unwrap();
    assert!(enlarged < 0.8 * whole);
    browser.value("document.querySelector('svg.map').focus()");
    browser.key("+", 187, "+");
    assert!(browser.value(width).as_f64().unwrap() < 0.8 * enlarged);
    let left = "document.querySelector('svg.map').viewBox.baseVal.x";
    let before = browser.value(left).as_f64().unwrap();
    browser.key("ArrowRight", 39, "");
    assert!(browser.value(left).as_f64().unwrap() > before);
    browser.key("0", 48, "0");
    assert_eq!(browser.value(width).as_f64().unwrap(), whole);
}
