//! Lines on a terminal: wrapped at words, the first of them in a colour.

use anstyle::{AnsiColor, Style};
use std::borrow::Cow;
use textwrap::{Options, WordSplitter, WrapAlgorithm};

const GOOD: Style = AnsiColor::Green.on_default().bold();
const WARNING: Style = AnsiColor::Yellow.on_default().bold();
pub(super) const ERROR: Style = AnsiColor::Red.on_default().bold();

/// What lines begin with, and how it is written.
const PAINTED: [(&str, Style); 5] =
    [("good", GOOD), ("check", WARNING), ("unusable", ERROR), ("lost", WARNING), ("odd", WARNING)];
/// What stays on the line of its number, and what stands between the two meanwhile: a letter of nobody's.
const UNITS: [&str; 8] = ["%", "m", "s", "deg", "min", "h", "cm", "MiB"];
const BOUND: char = '\u{e000}';
/// Where the text of a line begins that has a label.
const LABEL_COLUMNS: usize = 9;
/// Narrower terminals wrap as they like, columns.
const LEAST_COLUMNS: usize = 30;

/// Lines as they are shown where so many columns are, or anywhere.
pub(super) fn laid_out(text: &str, columns: Option<usize>) -> String {
    without_negative_zeros(text).split_inclusive('\n').map(|line| painted(&wrapped(line, columns))).collect()
}

/// A line in several, each but the first as far from the left as the first one's text; a longer word stays whole.
fn wrapped(line: &str, columns: Option<usize>) -> Cow<'_, str> {
    let Some(columns) = columns.filter(|&columns| columns >= LEAST_COLUMNS) else { return line.into() };
    let (text, end) = line.strip_suffix('\n').map_or((line, ""), |text| (text, "\n"));
    if textwrap::core::display_width(text) <= columns {
        return line.into();
    }
    let hanging = " ".repeat(hanging_columns(text).min(columns / 2));
    let options = Options::new(columns)
        .subsequent_indent(&hanging)
        .break_words(false)
        .word_splitter(WordSplitter::NoHyphenation)
        .wrap_algorithm(WrapAlgorithm::FirstFit);
    (textwrap::wrap(&with_units(text), options).join("\n").replace(BOUND, " ") + end).into()
}

/// The text with numbers bound to the units behind them.
fn with_units(text: &str) -> String {
    let mut bound = String::with_capacity(text.len());
    for word in text.split_inclusive(' ') {
        let unit = word.trim_end_matches(|c: char| !c.is_alphanumeric() && c != '%');
        if UNITS.contains(&unit)
            && bound.ends_with(' ')
            && bound[..bound.len() - 1].ends_with(|c: char| c.is_ascii_digit())
        {
            bound.pop();
            bound.push(BOUND);
        }
        bound.push_str(word);
    }
    bound
}

/// Where the text of a line begins: behind its label, where it has one.
fn hanging_columns(text: &str) -> usize {
    let indented = text.len() - text.trim_start_matches(' ').len();
    match label_of(text) {
        Some(_) => LABEL_COLUMNS,
        None => indented,
    }
}

/// The word that stands alone in the first columns.
fn label_of(text: &str) -> Option<&str> {
    let (head, rest) = text.split_at_checked(LABEL_COLUMNS)?;
    let label = head.trim_end_matches(' ');
    let is_label =
        label.len() < LABEL_COLUMNS && !label.is_empty() && !label.contains([' ', ':', ',']) && !rest.starts_with(' ');
    is_label.then_some(label)
}

fn painted(line: &str) -> String {
    let style = label_of(line).and_then(|label| PAINTED.iter().find(|(painted, _)| *painted == label));
    match style {
        Some((label, style)) => format!("{style}{label}{style:#}{}", &line[label.len()..]),
        None => line.to_owned(),
    }
}

/// The same without the sign of numbers that are rounded to zero: `-0.000` says no more than `0.000`.
pub(crate) fn without_negative_zeros(text: &str) -> Cow<'_, str> {
    if !text.contains("-0") {
        return text.into();
    }
    let mut out = String::with_capacity(text.len());
    let mut rest = text;
    while let Some(at) = rest.find("-0") {
        let (before, from) = rest.split_at(at);
        out.push_str(before);
        let number = from.len() - from[1..].trim_start_matches(|c: char| c.is_ascii_digit() || c == '.').len();
        let (number, after) = from.split_at(number);
        let is_zero = number[1..].trim_end_matches('.').chars().all(|c| c == '0' || c == '.');
        // In `run-0` and `3e-05` it is no sign.
        let is_sign = !out.ends_with(|c: char| c.is_alphanumeric() || matches!(c, '-' | '_' | '.'));
        let goes_on = after.starts_with(|c: char| c.is_alphanumeric() || matches!(c, '-' | '_'));
        out.push_str(if is_zero && is_sign && !goes_on { &number[1..] } else { number });
        rest = after;
    }
    out.push_str(rest);
    out.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(text: &str, columns: usize) -> Vec<String> {
        laid_out(text, Some(columns)).lines().map(|line| anstream::adapter::strip_str(line).to_string()).collect()
    }

    #[test]
    fn lines_wrap_at_words_and_hang_under_their_text() {
        let text = "quality  tracking 99.1 %, degraded 0.9 %, lost 0.0 % of the scans\nshort line\n";
        assert_eq!(
            lines(text, 40),
            ["quality  tracking 99.1 %, degraded", "         0.9 %, lost 0.0 % of the scans", "short line"]
        );
        assert!(laid_out(text, None).lines().eq(text.lines()), "nothing is wrapped where no terminal is");
        let indented = lines("         first: degraded from scan 12, and so on", 36);
        assert_eq!(indented, ["         first: degraded from scan", "         12, and so on"]);
        assert!(laid_out(text, Some(40)).ends_with("short line\n"));
    }

    #[test]
    fn words_count_as_wide_as_they_are_shown_and_stay_whole() {
        // each of these takes two columns, and three bytes
        let text = "written  \u{5730}\u{56fe}\u{5730}\u{56fe} \u{5730}\u{56fe}\u{5730}\u{56fe} \u{5730}\u{56fe}\u{5730}\u{56fe}";
        let shown = lines(text, 30);
        assert_eq!(shown.len(), 2, "{shown:?}");
        assert_eq!(shown[0], "written  \u{5730}\u{56fe}\u{5730}\u{56fe} \u{5730}\u{56fe}\u{5730}\u{56fe}");
        let path = "/a/very-long/path/that-has-hyphens/and/is/longer-than-the-line/map.png";
        let shown = lines(&format!("written  to {path} and more"), 40);
        assert_eq!(shown, ["written  to".to_owned(), format!("         {path}"), "         and more".to_owned()]);
        assert_eq!(lines("±0.05 m ±0.05 m ±0.05 m ±0.05 m", 31).len(), 1);
    }

    #[test]
    fn the_verdict_and_warnings_have_colours() {
        let text = laid_out("good     all is well\nlost     3 scans\nmap      10 m\ngoodness is not\n", None);
        let rows: Vec<_> = text.lines().collect();
        assert_eq!(rows[0], format!("{GOOD}good{GOOD:#}     all is well"));
        assert_eq!(rows[1], format!("{WARNING}lost{WARNING:#}     3 scans"));
        assert_eq!(rows[2..], ["map      10 m", "goodness is not"]);
        assert!(laid_out("unusable there is no map\n", Some(80)).starts_with(&format!("{ERROR}unusable{ERROR:#} ")));
    }

    #[test]
    fn zero_has_no_sign() {
        let said =
            without_negative_zeros("at (-0.000, -0.0), -0 deg, -0.010, -00.0 m; run-0 3e-05 -0x 2026-01-00 -0.0.");
        assert_eq!(said, "at (0.000, 0.0), 0 deg, -0.010, 00.0 m; run-0 3e-05 -0x 2026-01-00 0.0.");
    }
}
