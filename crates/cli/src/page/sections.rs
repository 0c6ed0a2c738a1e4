//! What the pages of one run and of two have in common.

use super::drawn::MAPS_SHOWN;
use super::figure::Figure;
use super::html::escaped;
use super::layers::{self, map_name};
use super::plot::significant;
use super::run::Run;
use super::{closures, robots, thinning};
use crate::closures::VerdictName;
use mapwright::Status;
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

/// Switches of the layers, each with all of its marks and what they mean.
pub(super) fn layer_switches(runs: &[&Run]) -> String {
    let any = |has: &dyn Fn(&Run) -> bool| runs.iter().any(|run| has(run));
    let verdict = |verdict| any(&|run| run.drawn.candidates.iter().any(|c| c.verdict == verdict));
    let status = |status| any(&|run| run.drawn.way.iter().any(|pose| pose.status == status));
    let shown = |is_shown: bool, text: String| if is_shown { text } else { String::new() };
    let sign = |class: &str, shape: &str, name: &str| {
        format!(
            "<svg class=\"sign {class}\" viewBox=\"-10 -10 20 20\" aria-hidden=\"true\"><path d=\"{shape}\"/></svg>{name}"
        )
    };
    let stroke = |class: &str, name: &str| format!("<i class=\"swatch {class}\"></i>{name}");
    let joins =
        any(&|run| run.drawn.candidates.iter().any(|c| c.joins.is_some() && c.verdict == VerdictName::Accepted));
    let switches = [
        (
            "path",
            true,
            robots::swatches(runs)
                + &sign("start", layers::START, "its start to")
                + &sign("end", layers::END, "its end"),
        ),
        (
            "closures",
            true,
            shown(verdict(VerdictName::Accepted), sign("accepted", layers::CLOSURE, "Closures"))
                + &shown(joins, sign("join", layers::JOIN, "Joins over breaks")),
        ),
        (
            "doubt",
            true,
            shown(status(Status::Degraded), stroke("degraded", "Degraded"))
                + &shown(status(Status::Lost), stroke("lost", "Lost"))
                + &shown(any(&|run| !run.drawn.breaks.is_empty()), sign("break", layers::BREAK, "Begin after a break")),
        ),
        ("next", true, shown(any(&|run| !run.drawn.next.is_empty()), sign("next", layers::NEXT, "Drive here next"))),
        (
            "refused",
            false,
            shown(verdict(VerdictName::Refused), stroke("refused", "Refused"))
                + &shown(verdict(VerdictName::Waiting), stroke("waiting", "Waiting"))
                + &shown(verdict(VerdictName::Withdrawn), stroke("withdrawn", "Withdrawn")),
        ),
        (
            "uncertainty",
            false,
            shown(any(&|run| layers::limits_m(&run.drawn.keyframes).is_some()), "Uncertainty".to_owned()),
        ),
    ];
    let switch = |(layer, is_on, signs): (&str, bool, String)| {
        let checked = if is_on { " checked=\"\"" } else { "" };
        let hidden = if signs.is_empty() { " hidden=\"\"" } else { "" };
        format!("<label{hidden}><input type=\"checkbox\" data-layer=\"{layer}\"{checked}/> {signs}</label>\n")
    };
    let switches: String = switches.into_iter().map(switch).collect();
    format!("<fieldset class=\"layers\"><legend>Layers</legend>\n{switches}{}</fieldset>\n", scale(runs))
}

/// The places that would make the maps more certain, by their numbers.
pub(super) fn drive_next(run: &Run) -> String {
    if run.drawn.next.is_empty() {
        let why = if run.drawn.is_space {
            "Maps of space have no advice yet."
        } else {
            "No place would make the map much more certain."
        };
        return format!("<p>{why}</p>\n");
    }
    let mut text = String::new();
    for of_map in run.drawn.next.chunk_by(|a, b| a.map == b.map) {
        let _ = match of_map[0].map {
            0 => write!(text, "<ol class=\"next\">"),
            map => write!(text, "<p>{}</p><ol class=\"next\">", map_name(map)),
        };
        of_map.iter().for_each(|next| _ = write!(text, "<li>{}.</li>", escaped(&next.words)));
        text += "</ol>\n";
    }
    text
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
    turning(run, figure, id)
        + &format!(
            "<figure class=\"map-figure\" data-run=\"{id}\">\n<div class=\"frame\">{}<div class=\"zoom\">{buttons}</div>\
         <div class=\"scale-bar\" aria-hidden=\"true\"><i></i><span></span></div><output class=\"at\"></output></div>\
         <figcaption>{}</figcaption></figure>\n",
            layers::svg(run, figure, &format!("map-{id}-{}", figure.map)),
            escaped(&figure.words)
        )
}

/// The map of space that can be turned; the script shows it where there is WebGL.
fn turning(run: &Run, figure: &Figure, id: &str) -> String {
    let Some(turning) = &figure.turning else { return String::new() };
    let (name, map) = (map_name(figure.map), figure.map);
    let buttons = [
        ("in", "+", "nearer"),
        ("out", "−", "farther"),
        ("above", "⊤", "from above"),
        ("side", "⊢", "from the side"),
        ("storeys", "◫", "storeys beside each other or back"),
        ("all", "⤢", "as at first"),
    ];
    let buttons = buttons.iter().filter(|(act, ..)| turning.has_storeys || *act != "storeys");
    let button = |(act, sign, what): &(&str, &str, &str)| {
        format!(
            "<button type=\"button\" data-turn=\"{act}\" aria-label=\"{name}: {what}\" title=\"{what}\">{sign}</button>"
        )
    };
    let buttons: String = buttons.map(button).collect();
    let storeys = if turning.has_storeys { "; <kbd>S</kbd> puts storeys beside each other, and back" } else { "" };
    let label = format!("{name} of {} in space, to be turned: its points, the way of the robot and closures", run.name);
    format!(
        "<figure class=\"turning\" data-run=\"{id}\" data-map=\"{map}\">\n<div class=\"frame\">\
         <canvas hidden=\"\" tabindex=\"0\" role=\"img\" aria-label=\"{}\" aria-describedby=\"turning-{id}-{map}\"></canvas>\
         <div class=\"turning-tools\" hidden=\"\"><div class=\"zoom\">{buttons}</div>\
         <label class=\"height\">Heights up to <input type=\"range\"/> <span class=\"cut\"></span></label>\
         <output class=\"at\"></output></div></div>\
         <figcaption id=\"turning-{id}-{map}\">{}. Drag or arrow keys turn it, <kbd>+</kbd> <kbd>−</kbd> bring it nearer, Shift with either moves it, \
         <kbd>0</kbd> is as at first{storeys}; the slider takes away what is higher, such as ceilings.</figcaption>\
         <noscript><p>Where scripts run the map can be turned. The picture below shows it from above and from the side.</p></noscript></figure>\n",
        escaped(&label),
        escaped(&turning.words),
    )
}

/// What the script is told of a run.
pub(super) fn data(run: &Run) -> Value {
    let turning = run
        .drawn
        .figures
        .iter()
        .filter_map(|figure| Some((figure.map.to_string(), figure.turning.as_ref()?.to_json().clone())));
    let turning: serde_json::Map<String, Value> = turning.collect();
    let mut data =
        json!({ "closures": closures::to_json(run), "submaps": run.drawn.overlays.to_json(), "way": way(run) });
    if !turning.is_empty() {
        data["turning"] = Value::Object(turning);
    }
    data
}

/// Times in tenths of a second, and where the robot was in each view of its map: whole pixels.
fn way(run: &Run) -> Value {
    let timed: Vec<(f64, f64)> = (0..run.drawn.way.len()).map(|k| (run.seconds_at(k), k as f64)).collect();
    let mut told: Vec<Value> = Vec::new();
    for (seconds, k) in thinning::peaks(&timed, WAY_POINTS) {
        let pose = run.drawn.way[k as usize];
        let Some(figure) = run.drawn.figures.iter().find(|figure| figure.map == pose.map) else { continue };
        let place = pose.map_from_robot.translation.into();
        let shown = figure.views.iter().filter(|view| view.shows(place));
        let at = shown.flat_map(|view| view.pixel(place).map(|v| v.round() as i64));
        let at: Vec<i64> = at.collect();
        told.push(json!([(10.0 * seconds).round() as i64, pose.map, at]));
    }
    Value::Array(told)
}
