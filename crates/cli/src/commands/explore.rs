//! `mapwright explore`: simulated robots explore a building.

use crate::args::ExploreArgs;
use crate::exploring::{Building, Plan, Run, SHARE, Sharing};
use crate::failure::{Failure, Outcome};
use crate::output::OutputFolder;
use crate::terminal::{say, say_json};
use mapwright_explore::{Cell, ExploreSettings, Strategy, WhyLeft};
use mapwright_formats::FormatError;
use serde_json::json;
use std::io::Write;

/// A colour for each robot, dark enough on white.
const COLOURS: [[u8; 3]; 8] = [
    [214, 39, 40],
    [31, 119, 180],
    [44, 160, 44],
    [148, 103, 189],
    [255, 127, 14],
    [23, 160, 175],
    [227, 119, 194],
    [120, 100, 20],
];

pub(super) fn run(args: &ExploreArgs) -> Result<Outcome, Failure> {
    let settings = crate::settings::load(&args.settings)?;
    let mut output = OutputFolder::create(&args.output)?;
    let strategy = if args.uncoordinated { Strategy::Nearest } else { Strategy::Greedy };
    let explore = ExploreSettings { strategy, ..ExploreSettings::default() };
    let robots = args.robots as usize;
    let dies = args.dies.map(|at_s| (robots - 1, at_s));
    let sharing = if args.uncoordinated { Sharing::Map } else { Sharing::Work };
    let plan = Plan { seed: args.seed, robots, explore, sharing, slam: !args.true_poses, dies };
    let run = Building::office(args.seed).run(&plan, &settings)?;
    output.write("map.png", |writer| write_map(&run, writer))?;
    output.write("area.png", |writer| write_curve(&run, writer))?;
    output.write("area.csv", |writer| write_area(&run, writer))?;
    let report = report(args, &run);
    output.write_json("explore.json", &report)?;
    let files = output.commit()?;
    if args.voice.json {
        say_json(&json!({ "files": files, "report": report }))?;
    } else if !args.voice.quiet {
        say(&format!("{}written  {}: {}\n", words(args, &run), args.output.display(), files.join(" ")))?;
    }
    let complete = run.seconds.is_some() && run.done_s.is_some();
    Ok(if complete { Outcome::Done } else { Outcome::WithLoss })
}

/// Short names of why frontiers are left, and how many of each.
fn reasons(run: &Run) -> Vec<(&'static str, usize)> {
    let name = |why: &WhyLeft| match why {
        WhyLeft::TooSmall { .. } => "too small",
        WhyLeft::TooNarrow => "too narrow",
        WhyLeft::Unreachable => "unreachable",
        WhyLeft::Blacklisted { .. } => "blacklisted for now",
        WhyLeft::GivenUp { .. } => "given up, no progress",
        WhyLeft::NothingNew { .. } => "nothing new seen",
        WhyLeft::SeenTooOften { .. } => "seen too often",
        WhyLeft::Waiting => "waiting",
    };
    let mut reasons: Vec<(&str, usize)> = Vec::new();
    for left in &run.decision.left {
        let name = name(&left.why);
        match reasons.iter_mut().find(|reason| reason.0 == name) {
            Some(reason) => reason.1 += 1,
            None => reasons.push((name, 1)),
        }
    }
    reasons.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(b.0)));
    reasons
}

fn words(args: &ExploreArgs, run: &Run) -> String {
    let when = |seconds: Option<f64>| seconds.map_or("never".to_owned(), |seconds| format!("after {seconds:.0} s"));
    let reasons: Vec<String> = reasons(run).iter().map(|(name, count)| format!("{count} {name}")).collect();
    let error = run.error_m.map_or(String::new(), |error_m| format!("error    keyframes {error_m:.3} m, rmse\n"));
    format!(
        "explore  office of 2,800 m2, seed {}, {} robots: {:.0} m2 to be seen\n\
         seen     {:.2} % of it, {:.0} % of it {}; nothing left to do {}\n\
         way      {:.0} m by all robots, held by walls or each other in {} steps\n\
         {error}left     {} frontiers: {}\n",
        args.seed,
        args.robots,
        run.area_m2,
        100.0 * run.share(),
        100.0 * SHARE,
        when(run.seconds),
        when(run.done_s),
        run.driven_m,
        run.bumps,
        run.decision.left.len(),
        reasons.join(", "),
    )
}

fn report(args: &ExploreArgs, run: &Run) -> serde_json::Value {
    let left = |left: &mapwright_explore::Left| json!({ "x_m": left.at_m[0], "y_m": left.at_m[1], "length_m": left.length_m, "why": format!("{:?}", left.why) });
    json!({
        "seed": args.seed,
        "robots": args.robots,
        "area_m2": run.area_m2,
        "share_seen": run.share(),
        "seconds_to_99_percent": run.seconds,
        "done_s": run.done_s,
        "driven_m": run.driven_m,
        "errands": run.errands,
        "plans": run.plans,
        "keyframe_error_m": run.error_m,
        "left": run.decision.left.iter().map(left).collect::<Vec<_>>(),
    })
}

fn write_area(run: &Run, writer: &mut impl Write) -> Result<(), FormatError> {
    writeln!(writer, "seconds,area_m2,share")?;
    for (second, share) in run.curve.iter().enumerate() {
        writeln!(writer, "{second},{:.2},{share:.5}", share * run.area_m2)?;
    }
    Ok(())
}

/// Pixels, the top row first.
struct Pixels {
    width: usize,
    height: usize,
    rgb: Vec<u8>,
}

impl Pixels {
    fn new(width: usize, height: usize) -> Self {
        Self { width, height, rgb: vec![255; 3 * width * height] }
    }

    fn set(&mut self, x: usize, y: usize, colour: [u8; 3]) {
        if x < self.width && y < self.height {
            self.rgb[3 * (y * self.width + x)..][..3].copy_from_slice(&colour);
        }
    }

    fn square(&mut self, [x, y]: [f64; 2], half: usize, colour: [u8; 3]) {
        let (x, y) = (x.max(0.0) as usize, y.max(0.0) as usize);
        for row in y.saturating_sub(half)..=y + half {
            (x.saturating_sub(half)..=x + half).for_each(|column| self.set(column, row, colour));
        }
    }

    fn line(&mut self, from: [f64; 2], to: [f64; 2], half: usize, colour: [u8; 3]) {
        let steps = (to[0] - from[0]).abs().max((to[1] - from[1]).abs()).ceil().max(1.0);
        for k in 0..=steps as usize {
            let share = k as f64 / steps;
            self.square([0, 1].map(|axis| from[axis] + share * (to[axis] - from[axis])), half, colour);
        }
    }

    fn write(&self, writer: &mut impl Write) -> Result<(), FormatError> {
        mapwright_formats::write_rgb_png(self.width, self.height, &self.rgb, writer)
    }
}

/// The map, and each robot's way in its colour: a square at its start, a larger one at its end.
fn write_map(run: &Run, writer: &mut impl Write) -> Result<(), FormatError> {
    const SCALE: usize = 2;
    let Some(map) = &run.map else { return Pixels::new(1, 1).write(writer) };
    let [width, height] = map.size();
    let mut pixels = Pixels::new(width * SCALE, height * SCALE);
    for (index, cell) in map.cells().iter().enumerate() {
        let colour = match cell {
            Cell::Unknown => [205; 3],
            Cell::Free => [252; 3],
            Cell::Occupied => [40; 3],
        };
        let (x, y) = (index % width * SCALE, (height - 1 - index / width) * SCALE);
        for k in 0..SCALE * SCALE {
            pixels.set(x + k % SCALE, y + k / SCALE, colour);
        }
    }
    let corner = map.center_m(0).map(|m| m - 0.5 * map.resolution_m());
    let place = |pose: &mapwright::Pose2| {
        let cells = [pose.x - corner[0], pose.y - corner[1]].map(|m| m / map.resolution_m() * SCALE as f64);
        [cells[0], (height * SCALE) as f64 - cells[1]]
    };
    for (number, way) in run.ways.iter().enumerate() {
        let colour = COLOURS[number % COLOURS.len()];
        way.windows(2).for_each(|pair| pixels.line(place(&pair[0]), place(&pair[1]), 1, colour));
        way.first().into_iter().for_each(|pose| pixels.square(place(pose), 4, colour));
        way.last().into_iter().for_each(|pose| pixels.square(place(pose), 8, colour));
    }
    pixels.write(writer)
}

/// The area seen over time: lines at every tenth of all there is to see and every hundred seconds.
fn write_curve(run: &Run, writer: &mut impl Write) -> Result<(), FormatError> {
    const SIZE: [usize; 2] = [800, 400];
    let mut pixels = Pixels::new(SIZE[0], SIZE[1]);
    let seconds = run.curve.len().max(2) as f64;
    let place =
        |second: f64, share: f64| [second / seconds * (SIZE[0] - 1) as f64, (1.0 - share) * (SIZE[1] - 1) as f64];
    for tenth in 0..=10 {
        let share = f64::from(tenth) / 10.0;
        pixels.line(place(0.0, share), place(seconds, share), 0, [225; 3]);
    }
    for hundred in 0..=(seconds / 100.0) as usize {
        let second = 100.0 * hundred as f64;
        pixels.line(place(second, 0.0), place(second, 1.0), 0, [225; 3]);
    }
    for (second, pair) in run.curve.windows(2).enumerate() {
        pixels.line(place(second as f64, pair[0]), place(second as f64 + 1.0, pair[1]), 1, COLOURS[1]);
    }
    pixels.write(writer)
}
