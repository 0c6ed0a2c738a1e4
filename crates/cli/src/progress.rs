//! The bar on a terminal.

use crate::interrupt::Interrupt;
use crate::terminal::{duration, grouped};
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use mapwright::Stamp;
use std::time::Instant;

/// Scans between two looks at the clock.
const LOOK_EVERY: u64 = 64;
/// Seconds between two drawings.
const DRAW_EVERY_S: f64 = 0.1;

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
    if quiet { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() }
}

fn spinner(quiet: bool) -> ProgressBar {
    let bar = ProgressBar::with_draw_target(None, target(quiet));
    if let Ok(style) = ProgressStyle::with_template("{spinner} {msg}") {
        bar.set_style(style);
    }
    bar
}

/// Scans per second, the time the log covers and the speed against real time; nothing where there is no terminal.
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
                if let Ok(style) = ProgressStyle::with_template("{bar:32} {percent:>3} %  {msg}") {
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
        if self.bar.is_hidden() || !self.scans.is_multiple_of(LOOK_EVERY) {
            return;
        }
        let elapsed_s = self.started.elapsed().as_secs_f64();
        if elapsed_s - self.drawn_s >= DRAW_EVERY_S {
            self.drawn_s = elapsed_s;
            self.bar.set_position(position);
            self.bar.set_message(self.words(stamp.secs_since(first_stamp), elapsed_s));
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
