//! Runs of one map, such as those of robots: a colour each, who met whom, and what was refused of whom.

use super::html::escaped;
use super::run::Run;
use crate::picture::Meeting;
use crate::terminal::grouped;
use mapwright_formats::run_colour;
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt::Write;

/// The colour of a run as CSS has it.
pub(super) fn colour(number: usize) -> String {
    let [red, green, blue] = run_colour(number);
    format!("#{red:02x}{green:02x}{blue:02x}")
}

/// What the ways on the map are called.
pub(super) fn swatches(runs: &[&Run]) -> String {
    let several: Vec<&Run> = runs.iter().copied().filter(|run| !run.drawn.runs.is_empty()).collect();
    let [run] = several[..] else { return "<i class=\"swatch way\"></i>Way, from".to_owned() };
    let swatch = |known: &super::drawn::DrawnRun| format!("{} ", named(known.number, &known.name));
    format!("{}, from", run.drawn.runs.iter().map(swatch).collect::<String>().trim_end())
}

fn named(number: usize, name: &str) -> String {
    format!("<i class=\"swatch way\" style=\"--run:{}\"></i>{}", colour(number), escaped(name))
}

/// A title and what stands below it; none of a single run that nobody shares.
pub(super) fn block(run: &Run) -> Option<(&'static str, String)> {
    let robots = run.results.report["robots"].as_array().map_or(&[][..], Vec::as_slice);
    if run.drawn.runs.is_empty() && robots.is_empty() {
        return None;
    }
    let title = if robots.is_empty() { "Runs" } else { "Robots" };
    Some((title, table(run, robots) + &met(run) + &refused(robots)))
}

fn table(run: &Run, robots: &[Value]) -> String {
    let is_fleet = !robots.is_empty();
    let more = ["one map with the team", "its own map took", "the team took", ""];
    let heads = ["name", "keyframes", "way"].into_iter().chain(more.into_iter().filter(|_| is_fleet));
    let heads: String = heads.map(|head| format!("<th scope=\"col\">{head}</th>")).collect();
    let mut text = format!("<table class=\"robots\"><thead><tr>{heads}</tr></thead><tbody>\n");
    for known in &run.drawn.runs {
        let robot = robots.iter().find(|robot| robot["name"].as_str() == Some(&known.name));
        let _ = writeln!(
            text,
            "<tr><th scope=\"row\">{}</th><td>{}</td><td>{:.0} m</td>{}</tr>",
            named(known.number, &known.name),
            grouped(known.keyframes as u64),
            known.length_m,
            robot.map_or(String::new(), told)
        );
    }
    let is_shown = |robot: &&Value| run.drawn.runs.iter().any(|known| robot["name"].as_str() == Some(&known.name));
    for robot in robots.iter().filter(|robot| !is_shown(robot)) {
        let name = escaped(robot["name"].as_str().unwrap_or("?"));
        let _ = writeln!(text, "<tr><th scope=\"row\">{name}</th><td>0</td><td></td>{}</tr>", told(robot));
    }
    text + "</tbody></table>\n"
}

/// What is told of a robot beside what its map says.
fn told(robot: &Value) -> String {
    let seconds =
        |key: &str, digits: usize| robot[key].as_f64().map_or(String::new(), |seconds| format!("{seconds:.digits$} s"));
    let joined = robot["one_map_s"].as_f64().map_or("never".to_owned(), |seconds| format!("after {seconds:.0} s"));
    let states = [("solves", true, "solves"), ("alive", false, "died")];
    let state = states.iter().filter(|(key, is, _)| robot[*key].as_bool() == Some(*is)).map(|(_, _, word)| *word);
    let state = state.collect::<Vec<_>>().join(", ");
    format!("<td>{joined}</td><td>{}</td><td>{}</td><td>{state}</td>", seconds("map_s", 1), seconds("team_s", 1))
}

/// Closures between each two runs.
fn met(run: &Run) -> String {
    if run.drawn.runs.len() < 2 {
        return String::new();
    }
    let mut pairs: BTreeMap<[usize; 2], Vec<&Meeting>> = BTreeMap::new();
    run.drawn.meetings.iter().for_each(|met| pairs.entry(met.runs).or_default().push(met));
    if pairs.is_empty() {
        return "<p>No closure holds two of them together.</p>\n".to_owned();
    }
    let name = |number: usize| {
        let known = run.drawn.runs.iter().find(|known| known.number == number);
        known.map_or(String::new(), |known| named(number, &known.name))
    };
    let mut text = "<h3>Who met whom</h3>\n<table class=\"met\"><thead><tr><th scope=\"col\">who</th><th scope=\"col\">whom</th>\
                    <th scope=\"col\">closures</th><th scope=\"col\">first</th><th scope=\"col\">last</th></tr></thead><tbody>\n"
        .to_owned();
    for (pair, met) in &pairs {
        let [first, last] = [met.first(), met.last()].map(|met| met.map_or(String::new(), |met| when(run, met)));
        let [a, b] = pair.map(name);
        let _ =
            writeln!(text, "<tr><td>{a}</td><td>{b}</td><td>{}</td><td>{first}</td><td>{last}</td></tr>", met.len());
    }
    text + "</tbody></table>\n<p class=\"note\">Times are those since each began, of the one that came to the place later.</p>\n"
}

fn when(run: &Run, met: &Meeting) -> String {
    let [x, y, _] = run.drawn.keyframes.get(met.later()).map_or([0.0; 3], |known| known.place);
    format!("{:.0} s, at {x:.1}, {y:.1} m", met.at_s())
}

fn refused(robots: &[Value]) -> String {
    let mut rows = String::new();
    for robot in robots {
        for refused in robot["refused"].as_array().into_iter().flatten() {
            let word = |value: &Value| escaped(value.as_str().unwrap_or("not known"));
            let _ = writeln!(
                rows,
                "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
                word(&robot["name"]),
                word(&refused["of"]),
                word(&refused["why"]),
                grouped(refused["times"].as_u64().unwrap_or(0))
            );
        }
    }
    match (robots.is_empty(), rows.is_empty()) {
        (true, _) => String::new(),
        (_, true) => "<p>Nothing was refused of anyone.</p>\n".to_owned(),
        _ => format!(
            "<h3>What was refused of whom</h3>\n<table class=\"refused\"><thead><tr><th scope=\"col\">by</th><th scope=\"col\">of</th>\
             <th scope=\"col\">why</th><th scope=\"col\">times</th></tr></thead><tbody>\n{rows}</tbody></table>\n"
        ),
    }
}
