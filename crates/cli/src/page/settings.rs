//! The settings in force, and what was switched on the command line beside them: those that are not the defaults, then all.

use super::html::escaped;
use super::run::Run;
use mapwright::{SettingLine, Settings};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

/// Of one run.
pub(super) fn block(run: &Run) -> String {
    let Some(settings) = run.settings else { return "<p>No run has begun in this session.</p>\n".to_owned() };
    let switched = switched(run);
    let mut text = String::new();
    if !switched.is_empty() {
        text += "<table><thead><tr><th scope=\"col\">option</th><th scope=\"col\">value</th><th scope=\"col\">meaning</th></tr></thead><tbody>\n";
        switched.iter().for_each(|(option, value)| text += &row_of_option(option, &[value]));
        text += "</tbody></table>\n";
    }
    let (lines, defaults) = (settings.lines(), Settings::default().lines());
    let changed: Vec<_> = lines.iter().zip(&defaults).filter(|(line, known)| line.value != known.value).collect();
    if changed.is_empty() {
        text += "<p>All settings are the defaults.</p>\n";
    } else {
        text += "<table><thead><tr><th scope=\"col\">setting</th><th scope=\"col\">value</th><th scope=\"col\">default</th>\
                 <th scope=\"col\">meaning</th></tr></thead><tbody>\n";
        for (line, known) in changed {
            text += &row(line, &[&line.value, &known.value]);
        }
        text += "</tbody></table>\n";
    }
    text += "<details><summary>All settings</summary><table><tbody>\n";
    lines.iter().for_each(|line| text += &row(line, &[&line.value]));
    text + "</tbody></table></details>\n"
}

/// Of two runs: where they differ.
pub(super) fn differences(names: [&str; 2], runs: [&Run; 2]) -> String {
    let [Some(first), Some(second)] = runs.map(|run| run.settings) else {
        return "<p>The settings of one of the runs are not known.</p>\n".to_owned();
    };
    let (first, second) = (first.lines(), second.lines());
    let rows = first.iter().zip(&second).filter(|(a, b)| a.value != b.value);
    let rows: String = rows.map(|(a, b)| row(a, &[&a.value, &b.value])).collect();
    let options = runs.map(switched);
    let all: BTreeSet<&String> = options.iter().flat_map(BTreeMap::keys).collect();
    let row_of = |option: &String| {
        let values = options.each_ref().map(|given| given.get(option).map_or("not given", String::as_str));
        (values[0] != values[1]).then(|| row_of_option(option, &values))
    };
    let rows = rows + &all.into_iter().filter_map(row_of).collect::<String>();
    if rows.is_empty() {
        return "<p>Both runs have the same settings, and the same was switched on the command line.</p>\n".to_owned();
    }
    format!(
        "<table><thead><tr><th scope=\"col\">setting</th><th scope=\"col\">{}</th><th scope=\"col\">{}</th>\
         <th scope=\"col\">meaning</th></tr></thead><tbody>\n{rows}</tbody></table>\n",
        names[0], names[1]
    )
}

/// What was switched on the command line beside the settings.
fn switched(run: &Run) -> BTreeMap<String, String> {
    let given = run.results.report["command_line"].as_object();
    given
        .into_iter()
        .flatten()
        .filter_map(|(option, value)| Some((option.clone(), value.as_str()?.to_owned())))
        .collect()
}

fn row_of_option(option: &str, values: &[&str]) -> String {
    let values: String = values.iter().map(|value| format!("<td>{}</td>", escaped(value))).collect();
    format!(
        "<tr><th scope=\"row\"><code>{}</code></th>{values}<td>given on the command line</td></tr>\n",
        escaped(option)
    )
}

fn row(line: &SettingLine, values: &[&str]) -> String {
    let mut text = format!("<tr><th scope=\"row\"><code>{}.{}</code></th>", line.section, line.key);
    let unit = if line.unit.is_empty() { String::new() } else { format!(" {}", line.unit) };
    for value in values {
        let _ = write!(text, "<td>{}{}</td>", escaped(value), escaped(&unit));
    }
    text + &format!("<td>{}</td></tr>\n", escaped(line.meaning))
}
