//! The bar on a terminal.

use crate::interrupt::Interrupt;
use crate::terminal::{duration, grouped, is_dumb};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use mapwright::Stamp;
use std::time::Instant;

/// Seconds between two drawings.
const DRAW_EVERY_S: f64 = 0.1;
/// How long it will still take is told when so much of the whole is done, and so many seconds have passed.
const FORESEEN_FROM: f64 = 0.01;
const FORESEEN_AFTER_S: f64 = 0.5;

/// What is told while a recording is looked through, before anything is mapped; nothing where there is no terminal.
pub(crate) struct FirstPass<'a> {
    bar: ProgressBar,
    drawn: Option<Instant>,
    interrupt: &'a Interrupt,
}

impl<'a> FirstPass<'a> {
    pub(crate) fn new(interrupt: &'a Interrupt, quiet: bool) -> Self {
        Self { bar: spinner(quiet), drawn: None, interrupt }
    }

    /// So many messages of a log were looked at; whether to go on.
    pub(crate) fn look(&mut self, name: &str, messages: u64) -> bool {
        let is_due = self.drawn.is_none_or(|drawn| drawn.elapsed().as_secs_f64() >= DRAW_EVERY_S);
        if is_due && !self.bar.is_hidden() {
            self.drawn = Some(Instant::now());
            self.bar.set_message(format!("looking through {name}: {} messages", grouped(messages)));
            self.bar.tick();
        }
        !self.interrupt.came()
    }
}

impl Drop for FirstPass<'_> {
    fn drop(&mut self) {
        self.bar.finish_and_clear();
    }
}

fn target(quiet: bool) -> ProgressDrawTarget {
    if quiet || is_dumb() { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() }
}

fn spinner(quiet: bool) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(None, target(quiet));
    if let Ok(style) = ProgressStyle::with_template("{spinner} {wide_msg}") {
        bar.set_style(style);
    }
    bar
}

/// The time that is left, scans per second, the time the log covers and the speed against real time; nothing where there is no terminal.
pub(crate) struct Progress {
    bar: ProgressBar,
    started: Instant,
    drawn_s: f64,
    scans: u64,
    first_stamp: Option<Stamp>,
}

impl Progress {
    /// A bar of `length` units, or one without end.
    pub(crate) fn new(length: Option<u64>, quiet: bool) -> Self {
        let bar = match length {
            None => spinner(quiet),
            length => {
                let bar = ProgressBar::with_draw_target(length, target(quiet));
                if let Ok(style) = ProgressStyle::with_template("{bar:24} {percent:>3} %  {wide_msg}") {
                    bar.set_style(style);
                }
                bar
            }
        };
        Self { bar, started: Instant::now(), drawn_s: 0.0, scans: 0, first_stamp: None }
    }

    /// A scan is through; `position` of the bar's length is done.
    pub(crate) fn scan(&mut self, stamp: Stamp, position: u64) {
        self.scans += 1;
        let first_stamp = *self.first_stamp.get_or_insert(stamp);
        if self.bar.is_hidden() {
            return;
        }
        let elapsed_s = self.started.elapsed().as_secs_f64();
        if elapsed_s - self.drawn_s >= DRAW_EVERY_S {
            self.drawn_s = elapsed_s;
            self.bar.set_position(position);
            let left = self.bar.length().and_then(|length| left_s(elapsed_s, position, length));
            let left = left.map_or_else(String::new, |left_s| format!("{} left, ", duration(left_s)));
            self.bar.set_message(left + &self.words(stamp.secs_since(first_stamp), elapsed_s));
            self.bar.tick();
        }
    }

    fn words(&self, log_s: f64, elapsed_s: f64) -> String {
        format!(
            "{} scans, {}/s, {} of log, {} x real time",
            grouped(self.scans),
            grouped((self.scans as f64 / elapsed_s) as u64),
            duration(log_s),
            grouped((log_s / elapsed_s).max(0.0) as u64)
        )
    }

    /// Takes the bar away.
    pub(crate) fn finish(&self) {
        self.bar.finish_and_clear();
    }
}

/// Seconds until all is done, where the rest goes as fast as what is done did; none where too little is known: of what was read all may
/// wait in memory.
fn left_s(elapsed_s: f64, position: u64, length: u64) -> Option<f64> {
    let done = position as f64 / length.max(1) as f64;
    let is_known = elapsed_s >= FORESEEN_AFTER_S && (FORESEEN_FROM..1.0).contains(&done);
    is_known.then(|| elapsed_s * (1.0 - done) / done)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_time_left_is_told_when_it_can_be_known() {
        assert_eq!(left_s(2.0, 25, 100), Some(6.0));
        assert_eq!([left_s(2.0, 0, 100), left_s(0.2, 50, 100), left_s(2.0, 5, 0)], [None; 3]);
        assert_eq!([left_s(2.0, 100, 100), left_s(2.0, 101, 100)], [None; 2], "all is read, or the file grew");
    }
}
