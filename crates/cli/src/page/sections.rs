//! What the pages of one run and of two have in common.

use super::drawn::MAPS_SHOWN;
use super::figure::Figure;
use super::html::escaped;
use super::layers::{self, map_name};
use super::plot::significant;
use super::run::Run;
use super::{closures, thinning};
use serde_json::{Value, json};
use std::fmt::Write;

/// Points of the way that the script is told, to show where the robot was at a time.
const WAY_POINTS: usize = 1500;

/// A heading and what stands below it.
pub(super) fn section(id: &str, title: &str, content: &str) -> String {
    format!(
        "<section id=\"{id}\" aria-labelledby=\"{id}-title\"><h2 id=\"{id}-title\">{title}</h2>\n{content}</section>\n"
    )
}

/// Switches of the layers and what their signs mean.
pub(super) fn layer_switches(runs: &[&Run]) -> String {
    let any = |has: &dyn Fn(&Run) -> bool| runs.iter().any(|run| has(run));
    let has_sigmas = any(&|run| layers::limits_m(&run.drawn.keyframes).is_some());
    let mut switches = vec![
        ("path", "Path", true, "<i class=\"swatch way\"></i>"),
        ("closures", "Closures and joins", true, "<i class=\"swatch accepted\"></i><i class=\"swatch join\"></i>"),
        ("doubt", "Doubt and breaks", true, "<i class=\"swatch degraded\"></i><i class=\"swatch break\"></i>"),
        ("refused", "Refused and waiting", false, "<i class=\"swatch refused\"></i>"),
    ];
    if has_sigmas {
        switches.push(("uncertainty", "Uncertainty", false, ""));
    }
    let switch = |(layer, name, is_on, sign): (&str, &str, bool, &str)| {
        let checked = if is_on { " checked=\"\"" } else { "" };
        format!("<label><input type=\"checkbox\" data-layer=\"{layer}\"{checked}/> {sign}{name}</label>\n")
    };
    let switches: String = switches.into_iter().map(switch).collect();
    format!("<fieldset class=\"layers\"><legend>Layers</legend>\n{switches}{}</fieldset>\n", scale(runs))
}

/// What the steps of uncertainty stand for.
fn scale(runs: &[&Run]) -> String {
    let mut scales: Vec<String> = Vec::new();
    for run in runs {
        let Some(limits_m) = layers::limits_m(&run.drawn.keyframes) else { continue };
        let from = if run.drawn.is_space { "where the way ends" } else { "where the map begins" };
        let step = |(step, limit_m): (usize, &f64)| format!("<i class=\"sigma-{step}\"></i>{}", significant(*limit_m));
        let steps: String = limits_m.iter().enumerate().map(step).collect();
        scales.push(format!("<span class=\"scale\">one sigma relative to {from}, up to{steps} m</span>\n"));
    }
    scales.dedup();
    scales.concat()
}

/// Every map of a run that has a picture.
pub(super) fn maps(run: &Run, id: &str) -> String {
    let mut text: String = run.drawn.figures.iter().map(|figure| map(run, figure, id)).collect();
    if run.drawn.maps > MAPS_SHOWN {
        let _ = writeln!(text, "<p>{} further maps are in the folder alone.</p>", run.drawn.maps - MAPS_SHOWN);
    }
    text
}

fn map(run: &Run, figure: &Figure, id: &str) -> String {
    let name = map_name(figure.map);
    let buttons = [("in", "+", "enlarge"), ("out", "−", "reduce"), ("all", "⤢", "show all")];
    let buttons: String = buttons
        .iter()
        .map(|(act, sign, what)| {
            format!("<button type=\"button\" data-zoom=\"{act}\" aria-label=\"{name}: {what}\" title=\"{what}\">{sign}</button>")
        })
        .collect();
    format!(
        "<figure class=\"map-figure\" data-run=\"{id}\">\n<div class=\"frame\">{}<div class=\"zoom\">{buttons}</div>\
         <div class=\"scale-bar\" aria-hidden=\"true\"><i></i><span></span></div><output class=\"at\"></output></div>\
         <figcaption>{}</figcaption></figure>\n",
        layers::svg(run, figure, &format!("map-{id}-{}", figure.map)),
        escaped(&figure.words)
    )
}

/// What the script is told of a run.
pub(super) fn data(run: &Run) -> Value {
    json!({ "closures": closures::to_json(run), "submaps": run.drawn.overlays.to_json(), "way": way(run) })
}

/// Times in tenths of a second, and where the robot was in each view of its map: whole pixels.
fn way(run: &Run) -> Value {
    let timed: Vec<(f64, f64)> =
        run.drawn.way.iter().enumerate().map(|(k, p)| (run.seconds(p.stamp), k as f64)).collect();
    let mut told: Vec<Value> = Vec::new();
    for (seconds, k) in thinning::peaks(&timed, WAY_POINTS) {
        let pose = run.drawn.way[k as usize];
        let Some(figure) = run.drawn.figures.iter().find(|figure| figure.map == pose.map) else { continue };
        let at = figure.views.iter().flat_map(|view| {
            super::figure::pixel(view, pose.map_from_robot.translation.into()).map(|v| v.round() as i64)
        });
        let at: Vec<i64> = at.collect();
        told.push(json!([(10.0 * seconds).round() as i64, pose.map, at]));
    }
    Value::Array(told)
}
