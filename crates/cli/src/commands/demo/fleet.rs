//! `mapwright demo --fleet`: robots explore a floor, meet, and make one map; one of them dies.

use crate::args::DemoArgs;
use crate::commands::explore::{write_area, write_curve};
use crate::commands::fleet::report::{RobotResult, TeamResult, Written, write_results};
use crate::exploring::{Building, LIMIT_S, Plan, Run, SHARE, Sharing};
use crate::failure::{Failure, Outcome};
use crate::mapping::settings_of;
use crate::output::OutputFolder;
use crate::robots::{Robot, Simulated};
use crate::terminal::{say, say_json};
use mapwright_explore::ExploreSettings;
use serde_json::{Map, Value, json};

const ROBOTS: usize = 4;
/// The last of them is switched off then, seconds.
const DIES_S: f64 = 60.0;
/// Of each robot's laser: half as many as in `explore`, for a demo is waited for.
const BEAMS: usize = 180;
/// Share of the messages that is lost.
const LOSS: f64 = 0.2;

pub(super) fn run(args: &DemoArgs) -> Result<Outcome, Failure> {
    let settings = settings_of(&args.mapping)?;
    let mut output = OutputFolder::create(&args.output)?;
    let building = Building::floor(args.seed);
    let plan = Plan {
        seed: args.seed,
        robots: ROBOTS,
        explore: ExploreSettings::default(),
        sharing: Sharing::Told,
        slam: true,
        loss: LOSS,
        dies: Some((ROBOTS - 1, DIES_S)),
        until_s: args.seconds.unwrap_or(LIMIT_S),
        beams: BEAMS,
    };
    let run = building.run(&plan, &settings)?;
    output.write("area.png", |writer| write_curve(&run, writer))?;
    output.write("area.csv", |writer| write_area(&run, writer))?;
    let Some(air) = &run.air else { return Err(Failure::Usage("expected robots that tell each other".to_owned())) };
    let map = air.robots.iter().filter(|robot| robot.is_alive).find_map(|robot| robot.team.map());
    let robots: Vec<RobotResult> = air.robots.iter().map(|robot| RobotResult::of(robot, map)).collect();
    let mut losses = Vec::new();
    if run.agreed_s.is_none() {
        losses.push("robots did not come to the same map".to_owned());
    }
    if run.done_s.is_none() && args.seconds.is_none() {
        losses.push("robots did not come to an end".to_owned());
    }
    let team = TeamResult { settings: &settings, map, robots: &robots, facts: facts(args, &run, air), losses };
    let written = write_results(team, output, &args.output)?;
    let voice = args.mapping.voice;
    if voice.json {
        say_json(&written.value)?;
    } else if !voice.quiet {
        say(&words(args, &run, air, &written))?;
    }
    Ok(Outcome::of_losses(&written.losses))
}

fn facts(args: &DemoArgs, run: &Run, air: &Simulated) -> Map<String, Value> {
    let (messages, bytes) = air.radio.sent();
    let facts = [
        ("seed", json!(args.seed)),
        ("area_m2", json!(run.area_m2)),
        ("share_seen", json!(run.share())),
        ("seconds_to_99_percent", json!(run.seconds)),
        ("done_s", json!(run.done_s)),
        ("agreed_s", json!(run.agreed_s)),
        ("driven_m", json!(run.driven_m)),
        ("keyframe_error_m", json!(run.error_m)),
        ("sent", json!({ "messages": messages, "bytes": bytes })),
        ("loss", json!(LOSS)),
    ];
    facts.into_iter().map(|(key, fact)| (key.to_owned(), fact)).collect()
}

fn words(args: &DemoArgs, run: &Run, air: &Simulated, written: &Written) -> String {
    let after = |seconds: Option<f64>| seconds.map_or("never".to_owned(), |seconds| format!("after {seconds:.0} s"));
    let joined = |robot: &Robot| format!("{} {}", robot.name, after(robot.joined_s));
    let joined: Vec<String> = air.robots.iter().filter(|robot| robot.is_alive).map(joined).collect();
    let error =
        run.error_m.map_or(String::new(), |error_m| format!("truth    keyframes are off by {error_m:.3} m, rmse\n"));
    let losses: String = written.losses.iter().map(|loss| format!("! {loss}\n")).collect();
    format!(
        "fleet    simulated office floor, seed {}: {ROBOTS} robots, {:.0} % of their messages lost; the last one dies after {DIES_S:.0} s\n\
         seen     {:.1} % of {:.0} m2, {:.0} % {}; nothing left to do {}\n\
         one map  {}\n\
         same     to the byte for all who live {} later\n\
         {error}{losses}written  {}: {}\n",
        args.seed,
        100.0 * LOSS,
        100.0 * run.share(),
        run.area_m2,
        100.0 * SHARE,
        after(run.seconds),
        after(run.done_s),
        joined.join(", "),
        run.agreed_s.map_or("not".to_owned(), |seconds| format!("{seconds:.0} s")),
        args.output.display(),
        written.files.join(" "),
    )
}
