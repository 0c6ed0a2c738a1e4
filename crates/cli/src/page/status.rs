//! Speed, memory and status over the run.

use super::plot::{LEFT, Line, Plot, RIGHT, WIDTH, times, x};
use super::run::Run;
use crate::terminal::{count, grouped};
use mapwright::Status;
use serde_json::Value;
use std::fmt::Write;

/// A run of scans is so wide at least, or nobody would see it.
const LEAST_WIDTH: f64 = 1.5;

/// All of it, of one run.
pub(super) fn over_the_run(run: &Run) -> String {
    let drives = match run.clock.drives() {
        0 | 1 => String::new(),
        drives => {
            format!("<p class=\"note\">Time is that of {drives} drives; what lies between them is left out.</p>\n")
        }
    };
    format!("{drives}<div class=\"plots over\">{}{}</div>\n", strip(run), speed_and_memory(run))
}

/// How scans fitted, along the time.
fn strip(run: &Run) -> String {
    let words = words(run);
    let mut text = format!(
        "<figure class=\"plot\"><figcaption>Status<span class=\"key tracking\">tracking</span>\
         <span class=\"key degraded\">degraded</span><span class=\"key lost\">lost</span>\
         <span class=\"note\">{words}</span></figcaption>\
         <svg viewBox=\"0 0 {WIDTH} 48\" role=\"img\" aria-label=\"Status over the run: {words}\" \
         data-plot=\"{LEFT},{},{}\"><rect class=\"tracking\" x=\"{LEFT}\" y=\"4\" width=\"{}\" height=\"22\"/>",
        WIDTH - RIGHT,
        run.length_s(),
        WIDTH - LEFT - RIGHT
    );
    let x = |seconds: f64| x(seconds, run.length_s());
    let mut place = 0;
    for same in run.drawn.way.chunk_by(|a, b| a.status == b.status) {
        let (status, first, last) = (same[0].status, place, place + same.len() - 1);
        place += same.len();
        if status != Status::Tracking {
            let (from, to) = (x(run.seconds_at(first)), x(run.seconds_at(last)));
            let (y, height) = if status == Status::Lost { (0, 30) } else { (4, 22) };
            let _ = write!(
                text,
                "<rect class=\"{}\" x=\"{from:.1}\" y=\"{y}\" width=\"{:.1}\" height=\"{height}\"/>",
                status.name(),
                (to - from).max(LEAST_WIDTH)
            );
        }
    }
    for [from, to] in run.clock.cuts() {
        let (from, to) = (x(from), x(to));
        let _ = write!(text, "<rect class=\"cut\" x=\"{from:.1}\" y=\"0\" width=\"{:.1}\" height=\"30\"/>", to - from);
    }
    text += &times(run.length_s(), 44.0);
    text + "<line class=\"cursor\" y1=\"0\" y2=\"30\" hidden=\"\"/></svg></figure>\n"
}

/// The report's own counts, which know of every scan.
fn words(run: &Run) -> String {
    let status = &run.results.report["status"];
    let counted = [Status::Tracking, Status::Degraded, Status::Lost].map(|s| status[s.name()].as_u64());
    let [Some(tracking), Some(degraded), Some(lost)] = counted else {
        return format!("{}; how they fitted is not in the folder", count(run.drawn.way.len() as u64, "scan"));
    };
    format!("{} scans tracking, {} degraded, {} lost", grouped(tracking), grouped(degraded), grouped(lost))
}

fn speed_and_memory(run: &Run) -> String {
    let Samples { speeds, memory } = Samples::of(run);
    let plot = |title, unit, values| {
        let lines = vec![Line { name: title, values, pauses: run.clock.cuts() }];
        Plot { title, unit, length_s: run.length_s(), lines }.to_html()
    };
    if speeds.is_empty() {
        return "<p class=\"note\">How fast it was along the way was not recorded by this run.</p>\n".to_owned();
    }
    plot("Speed", "scans/s", speeds) + &plot("Memory", "MiB", memory)
}

/// What `timing.json` says along the way: scans a second and MiB, over seconds of the log.
struct Samples {
    speeds: Vec<(f64, f64)>,
    memory: Vec<(f64, f64)>,
}

impl Samples {
    fn of(run: &Run) -> Self {
        let samples = &run.results.timing["over_the_run"];
        let numbers = |key: &str| -> Vec<f64> {
            let values = samples[key].as_array().map_or(&[][..], Vec::as_slice);
            values.iter().map(|value: &Value| value.as_f64().unwrap_or(f64::NAN)).collect()
        };
        let (scans, elapsed_s, memory_mib) = (numbers("scan"), numbers("elapsed_s"), numbers("memory_mib"));
        let way = &run.drawn.way;
        let time = |scan: f64| {
            let at = way.partition_point(|pose| (pose.scan as f64) < scan);
            run.seconds_at(at)
        };
        let (at, spent) = (scans.windows(2), elapsed_s.windows(2));
        let speed = |(scans, spent): (&[f64], &[f64])| {
            (time(scans[1]), (scans[1] - scans[0]) / (spent[1] - spent[0]).max(1e-6))
        };
        Self {
            speeds: at.zip(spent).map(speed).collect(),
            memory: scans.iter().zip(memory_mib).map(|(&scan, mib)| (time(scan), mib)).collect(),
        }
    }
}
