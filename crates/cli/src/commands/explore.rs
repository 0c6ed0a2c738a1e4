//! `mapwright explore`: simulated robots explore a building.

use crate::args::ExploreArgs;
use crate::exploring::{BEAMS, Building, LIMIT_S, Plan, Run, SHARE, Sharing};
use crate::failure::{Failure, Outcome};
use crate::output::OutputFolder;
use crate::terminal::{say, say_json};
use mapwright_explore::{Cell, ExploreSettings, Strategy, WhyLeft};
use mapwright_formats::{Curve, FormatError, RUN_COLOURS, RobotWay};
use serde_json::json;
use std::io::Write;

const NAMES: [&str; 16] = [
    "robot 1", "robot 2", "robot 3", "robot 4", "robot 5", "robot 6", "robot 7", "robot 8", "robot 9", "robot 10",
    "robot 11", "robot 12", "robot 13", "robot 14", "robot 15", "robot 16",
];

pub(super) fn run(args: &ExploreArgs) -> Result<Outcome, Failure> {
    let settings = crate::settings::load(&args.settings)?;
    let mut output = OutputFolder::create(&args.output)?;
    let sharing = match (args.radio, args.uncoordinated, args.alone) {
        (true, ..) => Sharing::Told,
        (_, _, true) => Sharing::Nothing,
        (_, true, _) => Sharing::Map,
        _ => Sharing::Work,
    };
    let is_shared = matches!(sharing, Sharing::Work | Sharing::Told);
    let strategy = if is_shared { Strategy::Greedy } else { Strategy::Nearest };
    let explore = ExploreSettings { strategy, ..ExploreSettings::default() };
    let robots = args.robots as usize;
    let dies = args.dies.map(|at_s| (robots - 1, at_s));
    let plan = Plan {
        seed: args.seed,
        robots,
        explore,
        sharing,
        slam: !args.true_poses,
        loss: args.loss,
        dies,
        until_s: LIMIT_S,
        beams: BEAMS,
    };
    let building = if args.rooms { Building::rooms(args.seed) } else { Building::office(args.seed) };
    let run = building.run(&plan, &settings)?;
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
        "explore  {}, seed {}, {} robots: {:.0} m2 to be seen\n\
         seen     {:.2} % of it, {:.0} % of it {}; nothing left to do {}\n\
         way      {:.0} m by all robots, held by walls or each other in {} steps\n\
         {error}left     {} frontiers: {}\n",
        if args.rooms { "three rooms" } else { "office of 2,800 m2" },
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

pub(super) fn write_area(run: &Run, writer: &mut impl Write) -> Result<(), FormatError> {
    writeln!(writer, "seconds,area_m2,share")?;
    for (second, share) in run.curve.iter().enumerate() {
        writeln!(writer, "{second},{:.2},{share:.5}", share * run.area_m2)?;
    }
    Ok(())
}

/// The map, and each robot's way in its colour: a triangle at its start, a square at its end.
fn write_map(run: &Run, writer: &mut impl Write) -> Result<(), FormatError> {
    const SCALE: usize = 2;
    let Some(map) = &run.map else { return Ok(()) };
    let [width, height] = map.size().map(|cells| cells * SCALE);
    let cells = map.cells().chunks_exact(map.size()[0]).rev();
    let mut rgb = Vec::with_capacity(3 * width * height);
    for row in cells.flat_map(|row| std::iter::repeat_n(row, SCALE)) {
        for cell in row {
            let grey = match cell {
                Cell::Unknown => 205,
                Cell::Free => 252,
                Cell::Occupied => 40,
            };
            rgb.extend([grey; 3 * SCALE]);
        }
    }
    let px_per_metre = SCALE as f64 / map.resolution_m();
    let corner_m = map.center_m(0).map(|m| m - 0.5 * map.resolution_m());
    let place = |pose: &mapwright::Pose2| {
        let [x, y] = [pose.x - corner_m[0], pose.y - corner_m[1]].map(|m| m * px_per_metre);
        [x as f32, (height as f64 - y) as f32]
    };
    let way = |(number, way): (usize, &Vec<mapwright::Pose2>)| RobotWay {
        colour: RUN_COLOURS[number % RUN_COLOURS.len()],
        name: NAMES[number % NAMES.len()],
        points_px: way.iter().map(place).collect(),
    };
    let ways: Vec<RobotWay> = run.ways.iter().enumerate().map(way).collect();
    mapwright_formats::write_ways_png([width, height], &rgb, px_per_metre, &ways, writer)
}

/// The area seen over time.
pub(super) fn write_curve(run: &Run, writer: &mut impl Write) -> Result<(), FormatError> {
    let values: Vec<f64> = run.curve.iter().map(|share| share * run.area_m2).collect();
    let events: Vec<(f64, &str)> = run.seconds.iter().map(|&second| (second, "99 of 100 seen")).collect();
    let curve =
        Curve { values: &values, name: "area seen (m2)", most: run.area_m2, events: &events, colour: RUN_COLOURS[0] };
    mapwright_formats::write_curve_png(&curve, writer)
}
