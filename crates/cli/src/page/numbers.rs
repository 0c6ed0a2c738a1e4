//! The numbers of one run, or of two side by side.

use super::errors::Errors;
use super::html::escaped;
use super::plot::significant;
use super::run::Run;
use crate::closures::VerdictName;
use crate::terminal::grouped;
use mapwright_eval::RelationReport;
use serde_json::Value;
use std::fmt::Write;

/// A number and what it is.
pub(super) struct Number {
    what: &'static str,
    unit: &'static str,
    value: Option<f64>,
}

/// All numbers of a run that are known of any.
pub(super) fn of(run: &Run, errors: Option<&Errors>, related: Option<&RelationReport>) -> Vec<Number> {
    let related = related.and_then(|report| report.all);
    let (report, timing) = (&run.results.report, &run.results.timing);
    let number = |what, unit, value: Option<f64>| Number { what, unit, value };
    let counted = |what, value: usize| Number { what, unit: "", value: Some(value as f64) };
    let closures = |verdict| run.drawn.candidates.iter().filter(|c| c.verdict == verdict).count();
    let joins = run.drawn.candidates.iter().filter(|c| c.joins.is_some() && c.verdict == VerdictName::Accepted).count();
    let inliers = report["matches"]["median_inlier_share"].as_f64();
    vec![
        counted(if run.drawn.is_space { "clouds" } else { "scans" }, run.drawn.way.len()),
        number("length of the log", "s", Some(run.clock.driven_s())),
        counted("drives", run.clock.drives()),
        number("path", "m", report["path_m"].as_f64()),
        number("height climbed", "m", report["climbed_m"].as_f64()),
        counted("keyframes", run.drawn.keyframes.len()),
        counted("maps", run.drawn.maps),
        counted("breaks", run.drawn.breaks.len()),
        counted("closures", closures(VerdictName::Accepted)),
        counted("of them joins over breaks", joins),
        counted("refused or waiting", run.drawn.candidates.len() - closures(VerdictName::Accepted)),
        counted("wheel slips corrected", run.drawn.slips),
        number("tracking", "%", share(report, "tracking")),
        number("degraded", "%", share(report, "degraded")),
        number("lost", "%", share(report, "lost")),
        number("beams that fit (median)", "%", inliers.map(|share| 100.0 * share)),
        number("uncertainty, mean", "m", report["certainty"]["mean_sigma_m"].as_f64()),
        number("uncertainty, worst", "m", report["certainty"]["worst_sigma_m"].as_f64()),
        number("ATE (rms)", "m", errors.and_then(Errors::ate_m)),
        number("RPE over 1 m (rms)", "m", errors.and_then(Errors::rpe_m)),
        number("relation error, mean", "m", related.map(|errors| errors.translation_m.mean)),
        number("relation error of heading, mean", "°", related.map(|errors| errors.rotation_deg.mean)),
        number("time taken", "s", timing["total_s"].as_f64()),
        number("speed", "scans/s", timing["scans_per_second"].as_f64()),
        // Of drives of different days it would count the days between them.
        number("times real time", "", timing["times_real_time"].as_f64().filter(|_| run.clock.drives() < 2)),
        number("memory, most", "MiB", timing["peak_memory_mib"].as_f64()),
    ]
}

/// Of scans with a status, percent of all that the report counts.
fn share(report: &Value, status: &str) -> Option<f64> {
    let of = |status: &str| report["status"][status].as_u64().map(|scans| scans as f64);
    let all = of("tracking")? + of("degraded")? + of("lost")?;
    (all > 0.0).then_some(100.0 * of(status)? / all)
}

impl Number {
    /// Counts of what is usually not there are told only where it is.
    fn is_told(&self) -> bool {
        let is_exception = ["breaks", "of them joins over breaks", "wheel slips corrected", "maps", "drives", "lost"]
            .contains(&self.what);
        let usual = f64::from(u8::from(["maps", "drives"].contains(&self.what)));
        self.value.is_some_and(|value| !is_exception || value > usual)
    }

    fn in_words(&self) -> String {
        let Some(value) = self.value else { return "–".to_owned() };
        let is_whole = value.fract() == 0.0 || value.abs() >= 1000.0;
        let number = if is_whole { grouped(value.max(0.0).round() as u64) } else { significant(value) };
        format!("{number} {}", self.unit).trim_end().to_owned()
    }
}

/// Those of one run.
pub(super) fn list(numbers: &[Number]) -> String {
    let told = numbers.iter().filter(|number| number.is_told());
    let entry =
        |number: &Number| format!("<div><dt>{}</dt><dd>{}</dd></div>\n", number.what, escaped(&number.in_words()));
    format!("<dl class=\"numbers\">\n{}</dl>\n", told.map(entry).collect::<String>())
}

/// Those of two runs, and by how much the second differs from the first.
pub(super) fn table(names: [&str; 2], [first, second]: [&[Number]; 2]) -> String {
    let mut text = format!(
        "<table class=\"numbers\"><thead><tr><th scope=\"col\"></th><th scope=\"col\">{}</th><th scope=\"col\">{}</th>\
         <th scope=\"col\">difference</th></tr></thead><tbody>\n",
        names[0], names[1]
    );
    for (a, b) in first.iter().zip(second).filter(|(a, b)| a.is_told() || b.is_told()) {
        let _ = writeln!(
            text,
            "<tr><th scope=\"row\">{}</th><td>{}</td><td>{}</td><td>{}</td></tr>",
            a.what,
            escaped(&a.in_words()),
            escaped(&b.in_words()),
            difference(a, b)
        );
    }
    text + "</tbody></table>\n"
}

fn difference(a: &Number, b: &Number) -> String {
    let Some((a, b)) = a.value.zip(b.value) else { return "–".to_owned() };
    let by = b - a;
    if by == 0.0 {
        return "same".to_owned();
    }
    let sign = if by > 0.0 { "+" } else { "−" };
    let size = if by.fract() == 0.0 { grouped(by.abs() as u64) } else { significant(by.abs()) };
    let percent = if a != 0.0 { format!(" ({sign}{} %)", significant(100.0 * (by / a).abs())) } else { String::new() };
    format!("{sign}{size}{percent}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_have_a_sign_and_a_share() {
        let number = |value| Number { what: "path", unit: "m", value };
        let cases = [(Some(2.0), Some(2.0), "same"), (Some(2.0), Some(3.0), "+1 (+50.0 %)"), (Some(2.0), None, "–")];
        cases.iter().for_each(|(a, b, words)| assert_eq!(difference(&number(*a), &number(*b)), *words));
        assert_eq!(difference(&number(Some(0.5)), &number(Some(0.25))), "−0.250 (−50.0 %)");
        assert_eq!(number(Some(506.123)).in_words(), "506 m");
        assert_eq!(number(Some(12_345.6)).in_words(), "12,346 m");
    }
}
