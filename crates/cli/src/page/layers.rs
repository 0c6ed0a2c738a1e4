//! The map with its layers, as SVG in the picture's pixels.

use super::drawn::{Drawn, KeyframePlace, WayPose};
use super::figure::{Figure, FigureView};
use super::html::{base64, escaped};
use super::robots::colour;
use super::run::Run;
use super::thinning::corners;
use crate::closures::VerdictName;

use mapwright::Status;
use mapwright_formats::ViewPlacement;
use std::collections::BTreeSet;
use std::fmt::Write;

/// Lines may lie off by so much of the picture, pixels.
const TOLERANCE_PX: f64 = 0.3;
/// Coordinates of lines are whole numbers of such a share of a pixel.
const FINE: f64 = 10.0;
/// Shapes of marks, about their middle.
pub(super) const START: &str = "M-7 7L0 -8L7 7Z";
pub(super) const END: &str = "M-6 -6H6V6H-6Z";
pub(super) const BREAK: &str = "M-7 -7H7L0 8Z";
pub(super) const JOIN: &str = "M0 -7L7 0L0 7L-7 0Z";
pub(super) const CLOSURE: &str = "M-5 0A5 5 0 1 0 5 0A5 5 0 1 0 -5 0Z";
pub(super) const NEXT: &str = "M-9 0A9 9 0 1 0 9 0A9 9 0 1 0 -9 0Z";
/// Steps of the scale of uncertainty.
const STEPS: usize = 5;
/// The scale of uncertainty ends here at least, metres, as in `map.png`.
const LEAST_FULL_M: f64 = 0.05;

/// A map and its layers; `id` is unique within the page.
pub(super) fn svg(run: &Run, figure: &Figure, id: &str) -> String {
    let [width, height] = figure.size_px;
    let label = format!("{} of {}. {}", map_name(figure.map), run.name, in_words(&run.drawn, figure.map));
    let grey = if figure.is_coloured { "ground" } else { "ground grey" };
    let mut text = format!(
        "<svg class=\"map\" id=\"{id}\" viewBox=\"0 0 {width} {height}\" tabindex=\"0\" role=\"group\" aria-label=\"{}\" \
         aria-describedby=\"map-keys\" data-per-metre=\"{}\" data-map=\"{}\"{}>\n\
         <image class=\"{grey}\" width=\"{width}\" height=\"{height}\" href=\"data:image/png;base64,{}\"/>\n",
        escaped(&label),
        rounded(figure.px_per_metre),
        figure.map,
        origin(figure),
        base64(&figure.png),
    );
    for view in &figure.views {
        text += &uncertainty(&run.drawn, figure.map, view);
        text += &path(&run.drawn, figure.map, view);
        text += &doubt(&run.drawn, figure.map, view);
        text += &closures(&run.drawn, figure.map, view);
        text += &next(&run.drawn, figure.map, view);
    }
    text += "<g class=\"here\" hidden=\"\"><circle r=\"7\"/></g>\n</svg>\n";
    text
}

/// For the map's name in headings.
pub(super) fn map_name(map: usize) -> String {
    if map == 0 { "Map".to_owned() } else { format!("Map {}", map + 1) }
}

/// Where the map's origin is, of a map of the plane: what is pointed at can be told in metres.
fn origin(figure: &Figure) -> String {
    match &figure.views[..] {
        [FigureView { placement: ViewPlacement { offset_px: [x, y], .. }, .. }] => {
            let turned_rad = figure.level_rad.unwrap_or(0.0);
            format!(" data-origin=\"{},{}\" data-turned=\"{turned_rad}\"", rounded(*x), rounded(*y))
        }
        _ => String::new(),
    }
}

fn rounded(value: f64) -> f64 {
    (value * 1e3).round() / 1e3 + 0.0 // no negative zero
}

/// What a picture shows, for who does not see it.
fn in_words(drawn: &Drawn, map: usize) -> String {
    let doubtful = drawn.way.iter().filter(|pose| pose.map == map && pose.status != Status::Tracking).count();
    let of_map = |keyframe: u32| drawn.keyframes.get(keyframe as usize).is_some_and(|known| known.map == map);
    let closures = drawn.candidates.iter().filter(|c| c.verdict == VerdictName::Accepted && of_map(c.to)).count();
    let poses = drawn.way.iter().filter(|pose| pose.map == map).count();
    format!(
        "The robot's way over {poses} scans, {doubtful} of them in doubt; {closures} closures, all in the table below."
    )
}

/// A line through these pixels, thinned, in tenths of a pixel.
fn line(pixels: &[[f64; 2]]) -> String {
    let fine = |k: usize| pixels[k].map(|v| (v * FINE).round() as i64);
    let mut text = String::new();
    let mut last = [0, 0];
    for (at, k) in corners(pixels, TOLERANCE_PX).into_iter().enumerate() {
        let [x, y] = fine(k);
        let [dx, dy] = [x - last[0], y - last[1]];
        match at {
            0 => _ = write!(text, "M{x} {y}"),
            1 => _ = write!(text, "l{dx} {dy}"),
            _ => _ = write!(text, " {dx} {dy}"),
        }
        last = [x, y];
    }
    // A line to where it is shows as a dot.
    if pixels.len() == 1 { text + "h0" } else { text }
}

fn path(drawn: &Drawn, map: usize, view: &FigureView) -> String {
    let mut text = String::from("<g class=\"layer-path\">");
    let mut of_map: Vec<&WayPose> = drawn.way.iter().filter(|pose| pose.map == map).collect();
    of_map.sort_by_key(|pose| pose.part[0]);
    let pixels = |poses: &[&WayPose]| -> Vec<[f64; 2]> {
        poses.iter().map(|pose| view.pixel(pose.map_from_robot.translation.into())).collect()
    };
    let is_shown = |pose: &&WayPose| view.shows(pose.map_from_robot.translation.into());
    // Nobody knows how the robot went over a break.
    let is_one = drawn.runs.is_empty();
    for run in of_map.chunk_by(|a, b| is_one || a.part[0] == b.part[0]) {
        let parts =
            run.chunk_by(|a, b| a.part == b.part && is_shown(a) == is_shown(b)).filter(|part| is_shown(&part[0]));
        let d: String = parts.map(|part| line(&pixels(part))).collect();
        let (shown, of) = match drawn.runs.iter().find(|known| !is_one && known.number == run[0].part[0]) {
            Some(known) => (format!(" style=\"--run:{}\"", colour(known.number)), format!(" of {}", known.name)),
            None => (String::new(), String::new()),
        };
        let rim = if is_one { "rim" } else { "rim light" };
        let _ = write!(text, "<path class=\"{rim}\" d=\"{d}\"/><path class=\"way\"{shown} d=\"{d}\"/>");
        text += &if is_one { String::new() } else { format!("<g class=\"of-run\"{shown}>") };
        for (end, class, shape) in [(run.first(), "start", START), (run.last(), "end", END)] {
            if let Some(pose) = end.filter(|pose| is_shown(pose)) {
                let at = view.pixel(pose.map_from_robot.translation.into());
                text += &marker(class, at, &format!("{class} of the way{of}"), shape);
            }
        }
        text += if is_one { "" } else { "</g>" };
    }
    text + "</g>\n"
}

/// A shape of a size that stays the same when the map is enlarged.
fn marker(class: &str, [x, y]: [f64; 2], title: &str, d: &str) -> String {
    format!(
        "<g class=\"mark {class}\" transform=\"translate({} {})\"><path d=\"{d}\"/><title>{}</title></g>",
        rounded(x),
        rounded(y),
        escaped(title)
    )
}

/// Scans in doubt as lines from where the robot was before, and where something begins after a break.
fn doubt(drawn: &Drawn, map: usize, view: &FigureView) -> String {
    let mut text = String::from("<g class=\"layer-doubt\">");
    for status in [Status::Degraded, Status::Lost] {
        let mut d = String::new();
        let is_shown = |pose: &WayPose| pose.map == map && view.shows(pose.map_from_robot.translation.into());
        for run in drawn.way.chunk_by(|a, b| (a.status, is_shown(a)) == (b.status, is_shown(b))) {
            if run[0].status == status && is_shown(&run[0]) {
                let pixels: Vec<_> =
                    run.iter().map(|pose| view.pixel(pose.map_from_robot.translation.into())).collect();
                d += &line(&pixels);
            }
        }
        let _ = write!(text, "<path class=\"{}\" d=\"{d}\"/>", status.name());
    }
    for (keyframe, start) in &drawn.breaks {
        if let Some(known) = drawn.keyframes.get(*keyframe).filter(|known| known.map == map && view.shows(known.place))
        {
            let title = format!("a fragment begins here after a break: {start}");
            text += &marker("break", view.pixel(known.place), &title, BREAK);
        }
    }
    text + "</g>\n"
}

/// Numbered places to drive to, the first on top.
fn next(drawn: &Drawn, map: usize, view: &FigureView) -> String {
    let mut text = String::from("<g class=\"layer-next\">");
    let of_map = drawn.next.iter().filter(|next| next.map == map).enumerate();
    for (number, next) in of_map.filter(|(_, next)| view.shows(next.place)).collect::<Vec<_>>().into_iter().rev() {
        let [x, y] = view.pixel(next.place).map(rounded);
        let _ = write!(
            text,
            "<g class=\"mark next\" transform=\"translate({x} {y})\"><path d=\"{NEXT}\"/><text>{}</text><title>{}</title></g>",
            number + 1,
            escaped(&next.words)
        );
    }
    text + "</g>\n"
}

fn closures(drawn: &Drawn, map: usize, view: &FigureView) -> String {
    let groups = [("layer-closures", true), ("layer-refused", false)];
    let mut text = String::new();
    for (layer, is_closure) in groups {
        let _ = write!(text, "<g class=\"{layer}\">");
        // Of what joins two fragments the first is marked as a join: robots that drive at a time are joined by hundreds.
        let mut joined = BTreeSet::new();
        for (number, candidate) in drawn.candidates.iter().enumerate() {
            let ends = [candidate.from, candidate.to].map(|k| drawn.keyframes.get(k as usize));
            let [Some(from), Some(to)] = ends else { continue };
            if to.map != map || (candidate.verdict == VerdictName::Accepted) != is_closure {
                continue;
            }
            let fragments = candidate
                .joins
                .as_ref()
                .map(|joins| joins.each_ref().map(|fragment| fragment.stamp_s.map(f64::to_bits)));
            let is_join = fragments.is_some_and(|fragments| joined.insert(fragments));
            let class = if is_join { "join" } else { candidate.verdict.name() };
            if [from, to].iter().all(|known| view.shows(known.place)) {
                text += &closure(number, class, [from, to].map(|known| view.pixel(known.place)));
            }
        }
        text += "</g>\n";
    }
    text
}

fn closure(number: usize, class: &str, ends: [[f64; 2]; 2]) -> String {
    let [[x1, y1], [x2, y2]] = ends.map(|end| end.map(rounded));
    let shape = if class == "join" { JOIN } else { CLOSURE };
    format!(
        "<g class=\"closure {class}\" data-closure=\"{number}\"><path class=\"link\" d=\"M{x1} {y1}L{x2} {y2}\"/>\
         <g class=\"mark\" transform=\"translate({} {})\"><path d=\"{shape}\"/></g></g>",
        rounded(0.5 * (x1 + x2)),
        rounded(0.5 * (y1 + y2))
    )
}

/// The way in steps of uncertainty; empty where nothing is known of it.
fn uncertainty(drawn: &Drawn, map: usize, view: &FigureView) -> String {
    let Some(limits_m) = limits_m(&drawn.keyframes) else { return String::new() };
    let step = |known: &KeyframePlace| {
        let sigma_m = known.sigma_m.filter(|_| view.shows(known.place))?;
        Some((known.part, limits_m.iter().position(|&limit_m| sigma_m <= limit_m).unwrap_or(STEPS - 1)))
    };
    let mut lines = vec![String::new(); STEPS];
    let mut own: Vec<&KeyframePlace> = drawn.keyframes.iter().filter(|known| known.map == map).collect();
    own.sort_by_key(|known| known.part[0]);
    let mut first = 0;
    for run in own.chunk_by(|a, b| step(a) == step(b)) {
        let goes_on = own.get(first + run.len()).is_some_and(|next| next.part == run[0].part);
        let end = first + run.len() + usize::from(goes_on);
        let pixels: Vec<_> = own[first..end].iter().map(|known| view.pixel(known.place)).collect();
        if let Some((_, step)) = step(run[0]) {
            lines[step] += &line(&pixels);
        }
        first += run.len();
    }
    let paths = lines.iter().enumerate().map(|(step, d)| format!("<path class=\"sigma sigma-{step}\" d=\"{d}\"/>"));
    format!("<g class=\"layer-uncertainty\">{}</g>\n", paths.collect::<String>())
}

/// Where the steps end, metres: each twice as far as the one before, the last at 1, 2 or 5 times a power of ten; none where no deviation
/// is known.
pub(super) fn limits_m(keyframes: &[KeyframePlace]) -> Option<[f64; STEPS]> {
    let worst_m = keyframes.iter().filter_map(|known| known.sigma_m).reduce(f64::max)?;
    let ends = (-2..7).flat_map(|power| [1.0, 2.0, 5.0].map(|lead: f64| lead * 10_f64.powi(power)));
    let full_m = ends.into_iter().find(|&end| end >= worst_m.max(LEAST_FULL_M))?;
    Some(std::array::from_fn(|step| full_m * 0.5_f64.powi((STEPS - 1 - step) as i32)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_told_in_steps_of_tenths() {
        assert_eq!(line(&[[1.0, 2.0], [1.5, 2.0], [2.0, 2.0], [2.0, 4.04]]), "M10 20l10 0 0 20");
        assert_eq!(line(&[[1.0, 2.0]]), "M10 20h0");
        assert_eq!(line(&[]), "");
    }

    #[test]
    fn the_scale_ends_at_a_round_number() {
        let at = |sigma_m| KeyframePlace { place: [0.0; 3], map: 0, part: [0, 0], sigma_m };
        let full_m = |keyframes: &[KeyframePlace]| limits_m(keyframes).map(|limits_m| limits_m[STEPS - 1]);
        assert_eq!(full_m(&[at(Some(0.01)), at(None)]), Some(0.05));
        assert_eq!(full_m(&[at(Some(0.01)), at(Some(0.12))]), Some(0.2));
        assert_eq!(full_m(&[at(None)]), None);
        assert_eq!(limits_m(&[at(Some(0.7))]), Some([0.0625, 0.125, 0.25, 0.5, 1.0]));
    }
}
