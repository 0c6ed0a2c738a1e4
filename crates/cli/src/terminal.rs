//! Words and numbers for people.

mod lines;

use crate::failure::Failure;
use anstream::{AutoStream, ColorChoice};
pub(crate) use lines::without_negative_zeros;
use lines::{ERROR, laid_out};
use std::ffi::OsStr;
use std::io::{self, IsTerminal, Write};
use terminal_size::terminal_size_of;

/// Columns of a terminal that does not say how wide it is.
const USUAL_COLUMNS: usize = 100;

/// Whether words have colours, from now on; by themselves they have some on a terminal, unless `NO_COLOR` is set or `TERM` is `dumb`,
/// which on servers that build software (`CI` is set) would count for nothing.
pub(crate) fn colour(choice: ColorChoice) {
    match choice {
        ColorChoice::Auto if is_dumb() => ColorChoice::Never,
        chosen => chosen,
    }
    .write_global();
}

/// Writes lines for people to the standard output: on a terminal wrapped at words, and in colours. A reader that went away early is no
/// failure.
pub(crate) fn say(text: &str) -> Result<(), Failure> {
    let out = io::stdout();
    let text = laid_out(text, columns_of(&out));
    let mut out = AutoStream::auto(out).lock();
    written(out.write_all(text.as_bytes()).and_then(|()| out.flush()))
}

/// Writes text for programs as it is.
pub(crate) fn say_raw(text: &str) -> Result<(), Failure> {
    let mut out = io::stdout().lock();
    written(out.write_all(text.as_bytes()).and_then(|()| out.flush()))
}

fn written(result: io::Result<()>) -> Result<(), Failure> {
    match result {
        Err(error) if error.kind() != io::ErrorKind::BrokenPipe => Err(Failure::Stdout(error)),
        _ => Ok(()),
    }
}

/// Writes a value as indented JSON.
pub(crate) fn say_json(value: &serde_json::Value) -> Result<(), Failure> {
    say_raw(&format!("{value:#}\n"))
}

/// Writes a failure to the standard error; nothing helps where even that fails.
pub(crate) fn complain(failure: &Failure) {
    let err = io::stderr();
    let text = laid_out(&format!("mapwright: {failure}\n"), columns_of(&err));
    let text = text.replacen("mapwright:", &format!("{ERROR}mapwright:{ERROR:#}"), 1);
    let _ = AutoStream::auto(err).lock().write_all(text.as_bytes());
}

/// Where lines of a terminal end; elsewhere, as in a file, they do not.
#[cfg(unix)]
fn columns_of(stream: &(impl IsTerminal + std::os::fd::AsFd)) -> Option<usize> {
    let said = || terminal_size_of(stream).map_or(USUAL_COLUMNS, |(width, _)| usize::from(width.0));
    stream.is_terminal().then(said)
}

#[cfg(windows)]
fn columns_of(stream: &(impl IsTerminal + std::os::windows::io::AsHandle)) -> Option<usize> {
    let said = || terminal_size_of(stream).map_or(USUAL_COLUMNS, |(width, _)| usize::from(width.0));
    stream.is_terminal().then(said)
}

/// Whether the terminal understands nothing but text in lines.
pub(crate) fn is_dumb() -> bool {
    std::env::var_os("TERM").is_some_and(|term| term == OsStr::new("dumb"))
}

/// 1234567 as `1,234,567`.
pub(crate) fn grouped(number: u64) -> String {
    let digits = number.to_string();
    let mut text = String::new();
    for (at, digit) in digits.chars().enumerate() {
        if at > 0 && (digits.len() - at).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// A small length, with as many digits as say something.
pub(crate) fn metres(m: f64) -> String {
    match m {
        m if m < 0.0005 => "less than 0.001 m".to_owned(),
        m if m < 0.01 => format!("{m:.3} m"),
        m => format!("{m:.2} m"),
    }
}

/// A time in the unit that suits it.
pub(crate) fn duration(seconds: f64) -> String {
    match seconds {
        s if s.is_nan() || s < 0.0 => "an unknown time".to_owned(),
        s if s < 90.0 => format!("{s:.1} s"),
        s if s < 5400.0 => format!("{:.0} min", s / 60.0),
        s => format!("{:.1} h", s / 3600.0),
    }
}

/// `1 scan`, `2 scans`.
pub(crate) fn count(number: u64, what: &str) -> String {
    format!("{} {what}{}", grouped(number), if number == 1 { "" } else { "s" })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_well() {
        assert_eq!([0, 999, 1000, 1_234_567].map(grouped), ["0", "999", "1,000", "1,234,567"]);
        assert_eq!([0.0, 0.0043, 0.0149].map(metres), ["less than 0.001 m", "0.004 m", "0.01 m"]);
        assert_eq!([12.34, 600.0, 7200.0].map(duration), ["12.3 s", "10 min", "2.0 h"]);
        assert_eq!([count(1, "scan"), count(2, "scan")], ["1 scan", "2 scans"]);
    }
}
