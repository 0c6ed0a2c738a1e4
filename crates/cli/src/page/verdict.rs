//! Whether the map can be used, as the run has judged it.

use super::html::escaped;
use serde_json::Value;

/// The verdict with its reasons; empty where the report has none.
pub(super) fn block(report: &Value) -> String {
    let verdict = &report["verdict"];
    let Some(word) = verdict["word"].as_str() else { return String::new() };
    let (class, sign) = match word {
        "good" => ("good", "✓"),
        "check" => ("check", "!"),
        _ => ("unusable", "✕"),
    };
    let reasons = verdict["reasons"].as_array().map_or(&[][..], Vec::as_slice);
    let items: String = reasons.iter().map(reason).collect();
    let list = match verdict["words"].as_str() {
        Some(words) if items.is_empty() => format!("<p>{}</p>", escaped(words)),
        _ if items.is_empty() => String::new(),
        _ => format!("<ul>{items}</ul>"),
    };
    format!(
        "<section class=\"verdict {class}\" aria-label=\"Verdict\"><p class=\"word\"><span class=\"sign\" \
         aria-hidden=\"true\">{sign}</span>{}</p>{list}</section>\n",
        escaped(word)
    )
}

/// What it says; the values that it was judged by stand in `report.json`.
fn reason(reason: &Value) -> String {
    let what = reason["words"].as_str().or_else(|| reason.as_str()).unwrap_or("no reason given");
    format!("<li>{}</li>", escaped(what))
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn a_verdict_stands_with_its_reasons_in_words() {
        let reasons = json!([{
            "words": "walls <stand> twice", "evidence": { "doubled_share": 0.123456, "scans": 4, "none": null },
        }]);
        let html = block(&json!({ "verdict": { "word": "check", "reasons": reasons } }));
        assert!(html.contains("class=\"verdict check\""), "{html}");
        assert!(html.contains("<li>walls &lt;stand&gt; twice</li>") && !html.contains("share"), "{html}");
        let good = block(&json!({ "verdict": { "word": "good", "reasons": [], "words": "all fits" } }));
        assert!(good.contains("<p>all fits</p>"), "{good}");
        assert!(block(&json!({})).is_empty() && block(&Value::Null).is_empty());
        assert!(block(&json!({ "verdict": { "word": "odd", "reasons": 3 } })).contains("unusable"));
    }
}
