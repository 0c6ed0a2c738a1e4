//! What was read, and what of it was dropped or is odd.

use super::html::escaped;
use super::run::Run;
use serde_json::Value;
use std::fmt::Write;

/// Entries of a list that are shown; the rest is counted.
const SHOWN: usize = 12;
/// Levels within each other.
const DEPTH: usize = 6;

/// Losses first, then all that the report says of the reading.
pub(super) fn block(run: &Run) -> String {
    let report = &run.results.report;
    let mut text = sentences("Lost", report["losses"].as_array(), &run.results.losses);
    text += &sentences("Odd", report["odd"].as_array(), &[]);
    if text.is_empty() {
        text += "<p>Nothing was lost, and nothing is odd.</p>\n";
    }
    let details = [
        ("What was read", &report["read"]),
        ("The recording", &report["recording"]),
        ("Beams", &report["beams"]),
        ("Points", &report["points"]),
        ("Of which logs", &report["parts"]),
        ("Pieces of the map", &report["pieces"]),
        ("Where it was in doubt", &report["status"]["doubt"]),
    ];
    for (title, value) in details.iter().filter(|(_, value)| !is_empty(value)) {
        let _ = writeln!(text, "<details><summary>{title}</summary>{}</details>", tree(value, 0));
    }
    text
}

fn sentences(title: &str, told: Option<&Vec<Value>>, more: &[String]) -> String {
    let told = told.into_iter().flatten().filter_map(Value::as_str);
    let items: String =
        told.chain(more.iter().map(String::as_str)).map(|text| format!("<li>{}</li>", escaped(text))).collect();
    if items.is_empty() { String::new() } else { format!("<h3>{title}</h3><ul>{items}</ul>\n") }
}

fn is_empty(value: &Value) -> bool {
    match value {
        Value::Null => true,
        Value::Array(values) => values.is_empty(),
        Value::Object(entries) => entries.values().all(is_empty),
        _ => false,
    }
}

/// A value with all in it, without what is empty.
fn tree(value: &Value, depth: usize) -> String {
    match value {
        _ if depth >= DEPTH => escaped(&value.to_string()),
        Value::Object(entries) => {
            let entry = |(key, value): (&String, &Value)| {
                format!("<dt>{}</dt><dd>{}</dd>", escaped(&key.replace('_', " ")), tree(value, depth + 1))
            };
            let told = entries.iter().filter(|(_, value)| !is_empty(value));
            format!("<dl class=\"tree\">{}</dl>", told.map(entry).collect::<String>())
        }
        Value::Array(values) if values.iter().any(|value| value.is_object() || value.is_array()) => {
            let items = values.iter().take(SHOWN).map(|value| format!("<li>{}</li>", tree(value, depth + 1)));
            format!("<ul>{}{}</ul>", items.collect::<String>(), further(values.len(), "li"))
        }
        Value::Array(values) => {
            let shown: Vec<String> = values.iter().take(SHOWN).map(|value| tree(value, depth + 1)).collect();
            shown.join(", ") + &further(values.len(), "span")
        }
        Value::String(text) => escaped(text),
        other => escaped(&other.to_string()),
    }
}

fn further(all: usize, tag: &str) -> String {
    let more = all.saturating_sub(SHOWN);
    if more == 0 { String::new() } else { format!("<{tag} class=\"note\"> and {more} more</{tag}>") }
}
