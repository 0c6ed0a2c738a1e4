//! Speed, memory and status over the run.

use super::plot::{Line, Plot};
use super::run::Run;
use crate::terminal::{count, grouped};
use mapwright::Status;
use serde_json::Value;
use std::fmt::Write;

/// The drawing's width and height, and where it begins, as in plots.
const WIDTH: f64 = 720.0;
const LEFT: f64 = 56.0;
const RIGHT: f64 = 8.0;
/// A run of scans is so wide at least, or nobody would see it.
const LEAST_WIDTH: f64 = 1.5;

/// All of it, of one run.
pub(super) fn over_the_run(run: &Run) -> String {
    strip(run) + &speed_and_memory(run)
}

/// How scans fitted, along the time.
fn strip(run: &Run) -> String {
    let words = words(run);
    let mut text = format!(
        "<figure class=\"plot\"><figcaption>Status<span class=\"key tracking\">tracking</span>\
         <span class=\"key degraded\">degraded</span><span class=\"key lost\">lost</span>\
         <span class=\"note\">{words}</span></figcaption>\
         <svg viewBox=\"0 0 {WIDTH} 30\" role=\"img\" aria-label=\"Status over the run: {words}\" \
         data-plot=\"{LEFT},{},{}\"><rect class=\"tracking\" x=\"{LEFT}\" y=\"4\" width=\"{}\" height=\"22\"/>",
        WIDTH - RIGHT,
        run.length_s(),
        WIDTH - LEFT - RIGHT
    );
    let x = |seconds: f64| LEFT + (WIDTH - LEFT - RIGHT) * (seconds / run.length_s().max(1e-9)).clamp(0.0, 1.0);
    for same in run.drawn.way.chunk_by(|a, b| a.status == b.status) {
        let (status, first, last) = (same[0].status, same[0].stamp, same[same.len() - 1].stamp);
        if status != Status::Tracking {
            let (from, to) = (x(run.seconds(first)), x(run.seconds(last)));
            let (y, height) = if status == Status::Lost { (0, 30) } else { (4, 22) };
            let _ = write!(
                text,
                "<rect class=\"{}\" x=\"{from:.1}\" y=\"{y}\" width=\"{:.1}\" height=\"{height}\"/>",
                status.name(),
                (to - from).max(LEAST_WIDTH)
            );
        }
    }
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
        let lines = vec![Line { name: title, values, pauses: Vec::new() }];
        Plot { title, unit, length_s: run.length_s(), lines }.to_html()
    };
    if speeds.is_empty() {
        return "<p class=\"note\">How fast it was along the way was not recorded by this run.</p>\n".to_owned();
    }
    format!("<div class=\"plots\">{}{}</div>\n", plot("Speed", "scans/s", speeds), plot("Memory", "MiB", memory))
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
            way.get(at).map_or(f64::NAN, |pose| run.seconds(pose.stamp))
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
