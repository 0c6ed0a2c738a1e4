//! Values over time, as SVG.

use super::html::escaped;
use super::thinning::peaks;
use std::fmt::Write;

/// The drawing's width and height, and the room for the numbers on the left and below; units of the drawing.
pub(super) const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 170.0;
pub(super) const LEFT: f64 = 56.0;
pub(super) const RIGHT: f64 = 8.0;
const BOTTOM: f64 = 22.0;
const TOP: f64 = 8.0;
/// Points of a line at most.
const POINTS: usize = 360;

/// A drawing of one or several lines over one time.
pub(super) struct Plot<'a> {
    pub(super) title: &'a str,
    pub(super) unit: &'a str,
    /// The time that it spans, seconds.
    pub(super) length_s: f64,
    pub(super) lines: Vec<Line<'a>>,
}

/// Its name, and values at seconds since the begin. Over a pause, from when to when, nothing is known and no line is drawn.
pub(super) struct Line<'a> {
    pub(super) name: &'a str,
    pub(super) values: Vec<(f64, f64)>,
    pub(super) pauses: Vec<[f64; 2]>,
}

impl Plot<'_> {
    /// A figure with title, drawing and a caption in words; empty where there is no value.
    pub(super) fn to_html(&self) -> String {
        let values = || self.lines.iter().flat_map(|line| &line.values).map(|(_, value)| *value);
        let highest = values().filter(|value| value.is_finite()).fold(f64::NEG_INFINITY, f64::max);
        if highest < 0.0 {
            return String::new();
        }
        let step = round_step(highest, 4.0);
        let top = ((highest / step).ceil() * step).max(step);
        let words = self.words();
        let mut text = format!(
            "<figure class=\"plot\"><figcaption>{}{}<span class=\"note\">{words}</span></figcaption>\
             <svg viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{}: {words}\" data-plot=\"{LEFT},{},{},{top}\">",
            escaped(self.title),
            self.legend(),
            escaped(self.title),
            WIDTH - RIGHT,
            self.length_s,
        );
        text += &self.grid(top, step);
        for (number, line) in self.lines.iter().enumerate() {
            let _ = write!(text, "<path class=\"line line-{number}\" d=\"{}\"/>", self.path(line, top));
        }
        text + "<line class=\"cursor\" y1=\"0\" y2=\"148\" hidden=\"\"/></svg></figure>\n"
    }

    fn path(&self, line: &Line<'_>, top: f64) -> String {
        let mut text = String::new();
        let mut last: Option<f64> = None;
        // Shorter pauses are no wider than a point of the line.
        let is_seen = |[from, to]: &[f64; 2]| to - from >= self.length_s / POINTS as f64;
        let is_over_pause = |before: f64, t: f64| line.pauses.iter().any(|p| is_seen(p) && before <= p[0] && p[1] <= t);
        for (t, value) in peaks(&line.values, POINTS) {
            let y = TOP + (HEIGHT - TOP - BOTTOM) * (1.0 - (value / top).clamp(0.0, 1.0));
            let goes_on = last.is_some_and(|before| !is_over_pause(before, t));
            // A line to where it begins shows a single point as a dot.
            let begins = if goes_on { String::new() } else { format!("M{:.1} {y:.1}", x(t, self.length_s)) };
            let _ = write!(text, "{begins}L{:.1} {y:.1}", x(t, self.length_s));
            last = Some(t);
        }
        text
    }

    fn grid(&self, top: f64, step: f64) -> String {
        let mut text = String::new();
        let lines = (top / step).round() as usize;
        for k in 0..=lines {
            let value = k as f64 * step;
            let y = TOP + (HEIGHT - TOP - BOTTOM) * (1.0 - value / top);
            let _ = write!(
                text,
                "<path class=\"grid\" d=\"M{LEFT} {y:.1}H{}\"/><text class=\"tick\" x=\"{}\" y=\"{:.1}\" \
                 text-anchor=\"end\">{}</text>",
                WIDTH - RIGHT,
                LEFT - 6.0,
                y + 4.0,
                number(value, step),
            );
        }
        text + &times(self.length_s, HEIGHT - 6.0)
    }

    /// What each line says, for who does not see it.
    fn words(&self) -> String {
        let line = |line: &Line<'_>| {
            let values: Vec<f64> = line.values.iter().map(|(_, value)| *value).filter(|v| v.is_finite()).collect();
            let most = values.iter().copied().fold(0.0, f64::max);
            let mean = values.iter().sum::<f64>() / values.len().max(1) as f64;
            let name = if self.lines.len() > 1 { format!("{} ", line.name) } else { String::new() };
            format!("{name}mean {} {u}, at most {} {u}", significant(mean), significant(most), u = self.unit)
        };
        escaped(&self.lines.iter().map(line).collect::<Vec<_>>().join("; "))
    }

    /// Which line is which, where there are several.
    fn legend(&self) -> String {
        if self.lines.len() < 2 {
            return String::new();
        }
        let entry = |(number, line): (usize, &Line<'_>)| {
            format!("<span class=\"key line-{number}\">{}</span>", escaped(line.name))
        };
        self.lines.iter().enumerate().map(entry).collect()
    }
}

/// Where a time is, of all drawings over time.
pub(super) fn x(seconds: f64, length_s: f64) -> f64 {
    LEFT + (WIDTH - LEFT - RIGHT) * (seconds / length_s.max(1e-9)).clamp(0.0, 1.0)
}

/// The numbers along the time axis, their feet at `y`.
pub(super) fn times(length_s: f64, y: f64) -> String {
    let (unit_s, unit) = time_unit(length_s);
    let step = round_step(length_s / unit_s, 8.0);
    let count = (length_s / unit_s / step).floor() as usize;
    let mut text = String::new();
    for k in 0..=count.min(20) {
        let value = k as f64 * step;
        let x = x(value * unit_s, length_s);
        let unit = if k == 0 { format!(" {unit}") } else { String::new() };
        let _ = write!(
            text,
            "<text class=\"tick\" x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"middle\">{}{unit}</text>",
            number(value, step)
        );
    }
    text
}

/// Seconds in the unit that suits a time, and its name.
pub(super) fn time_unit(length_s: f64) -> (f64, &'static str) {
    match length_s {
        s if s < 180.0 => (1.0, "s"),
        s if s < 10_800.0 => (60.0, "min"),
        _ => (3600.0, "h"),
    }
}

/// The smallest of 1, 2 and 5 times a power of ten that parts a length into at most so many steps.
pub(super) fn round_step(length: f64, steps: f64) -> f64 {
    let powers = (-7..10).map(|power| 10_f64.powi(power));
    let rounds = powers.flat_map(|power| [power, 2.0 * power, 5.0 * power]);
    rounds.into_iter().find(|step| length / step <= steps).unwrap_or(1e10)
}

/// A multiple of a step, with the decimals that the step needs.
fn number(value: f64, step: f64) -> String {
    let decimals = (-step.log10().floor()).clamp(0.0, 7.0) as usize;
    format!("{value:.decimals$}")
}

/// Three digits that say something.
pub(super) fn significant(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return "0".to_owned();
    }
    let decimals = (2.0 - value.abs().log10().floor()).clamp(0.0, 6.0) as usize;
    let text = format!("{value:.decimals$}");
    let is_zero = text.trim_start_matches('-').chars().all(|c| matches!(c, '0' | '.'));
    if is_zero { text.trim_start_matches('-').to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_round_and_numbers_have_the_decimals_that_they_need() {
        assert_eq!([0.031, 7.0, 44.9, 1234.0].map(|length| round_step(length, 4.0)), [0.01, 2.0, 20.0, 500.0]);
        assert_eq!(number(0.03, 0.01), "0.03");
        assert_eq!(number(1500.0, 500.0), "1500");
        assert_eq!([0.01234, 1.5, 420.4, 0.0, -1e-9].map(significant), ["0.0123", "1.50", "420", "0", "0.000000"]);
    }

    #[test]
    fn a_plot_has_a_line_a_title_and_words() {
        let values = vec![(0.0, 1.0), (30.0, 4.0), (60.0, f64::NAN)];
        let line = |name| Line { name, values: values.clone(), pauses: Vec::new() };
        let plot = Plot { title: "a < b", unit: "m", length_s: 60.0, lines: vec![line("one"), line("two")] };
        let html = plot.to_html();
        assert!(html.contains("a &lt; b") && html.contains("one mean 2.50 m, at most 4.00 m; two mean"), "{html}");
        assert_eq!(html.matches("<path class=\"line ").count(), 2);
        assert!(Plot { lines: Vec::new(), ..plot }.to_html().is_empty());
    }

    #[test]
    fn no_line_is_drawn_over_a_pause() {
        let values: Vec<(f64, f64)> = (0..100).filter(|k| !(40..60).contains(k)).map(|k| (f64::from(k), 1.0)).collect();
        let strokes = |pauses: Vec<[f64; 2]>| {
            let lines = vec![Line { name: "one", values: values.clone(), pauses }];
            let html = Plot { title: "errors", unit: "m", length_s: 99.0, lines }.to_html();
            html.split_once("class=\"line line-0\" d=\"").unwrap().1.split_once('"').unwrap().0.matches('M').count()
        };
        assert_eq!(strokes(Vec::new()), 1);
        assert_eq!(strokes(vec![[39.0, 60.0]]), 2);
        assert_eq!(strokes(vec![[39.0, 39.1], [70.0, 70.1]]), 1, "what is narrower than a point is no gap");
    }
}
