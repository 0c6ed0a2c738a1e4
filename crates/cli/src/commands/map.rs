//! `mapwright map`

use crate::args::{MapArgs, Voice};
use crate::events::{Ending, Interrupt, Log};
use crate::failure::{Failure, Outcome};
use crate::going_on::GoesOn;
use crate::mapping::{Mapping, settings_of};
use crate::maps::remove_outdated_exports;
use crate::output::OutputFolder;
use crate::progress::FirstPass;
use crate::reading::Reading;
use crate::report::{self, LastWords};
use crate::session::{earlier_in_plane, to_go_on_with};
use crate::space::{self, Disk, Sought, Source};
use crate::terminal::{count, say, say_json};
use crate::timing::StageClock;
use serde_json::json;
use std::path::Path;

pub(super) fn run(args: &MapArgs) -> Result<Outcome, Failure> {
    run_until(args, &Interrupt::watch()?)
}

/// Maps until somebody interrupts.
pub(crate) fn run_until(args: &MapArgs, interrupt: &Interrupt) -> Result<Outcome, Failure> {
    settings_of(&args.mapping)?; // wrong usage is told before anything is touched
    if let [path] = &args.logs[..]
        && let Some(disk) = Disk::open(path)?
        && let Some(recording) = disk.recording()?
    {
        space::check_choice_of_files(&args.source)?;
        let source = Source::files(path.display().to_string(), &recording, &args.source)?;
        return map_space(args, source, interrupt);
    }
    let clock = StageClock::start(); // a recording's first pass counts as well
    let voice = args.mapping.voice;
    let mut first_pass = FirstPass::new(interrupt, voice.quiet || voice.json);
    let mut watch = |name: &str, messages| first_pass.look(name, messages);
    let inputs = match space::seek(args, &mut watch)? {
        Sought::Space(source) => {
            drop(first_pass);
            return map_space(args, source, interrupt);
        }
        Sought::Plane(_) if args.mesh => {
            return Err(Failure::Usage("--mesh needs a recording of space, found one of the plane".to_owned()));
        }
        Sought::Plane(inputs) => inputs,
    };
    let mut log = Log::of(inputs, &args.logs, &args.source.choice(), &mut watch)?.taking_sonars();
    drop(first_pass);
    let resumed = args.mapping.resume.as_ref().map(|path| earlier_in_plane(path)).transpose()?;
    let folder = args.output();
    let output = OutputFolder::create(&folder)?;
    let earlier = if args.goes_on { Some(to_go_on_with(&folder)?) } else { resumed };
    let mut went_on = earlier.as_ref().filter(|_| args.goes_on).map(|(session, _)| GoesOn::with(session));
    let mut mapping = Mapping::begin(&args.mapping, output, log.size_bytes(), earlier)?;
    mapping.clock = clock;
    mapping.switched = args.source.switched(args.mapping.start);
    let ending = log.for_each(interrupt, |event, position| {
        let is_new = went_on.as_mut().map_or(Ok(true), |went_on| went_on.is_new(&event, &mut mapping));
        if is_new? { mapping.take(event, position) } else { Ok(()) }
    })?;
    mapping.end_of_scans()?;
    let name = log.name();
    let read = log.finish()?;
    finish(mapping, Finished { name, read, ending, output: &folder, voice })
}

/// A run whose scans were all taken in.
pub(crate) struct Finished<'a> {
    pub(crate) name: String,
    pub(crate) read: Reading,
    pub(crate) ending: Ending,
    pub(crate) output: &'a Path,
    pub(crate) voice: Voice,
}

/// Writes the results and says what was made and lost.
pub(crate) fn finish(mut mapping: Mapping, finished: Finished<'_>) -> Result<Outcome, Failure> {
    let Finished { name, read, ending, output, voice } = finished;
    if ending == Ending::OfLog {
        mapping.look_again()?;
    }
    let made = mapping.write_results()?;
    // one cell is no map
    let cell_m = mapping.settings.map.resolution_m;
    let is_empty = mapping.session().keyframes().is_empty()
        || made.maps.iter().all(|map| map.sides_m.iter().all(|side_m| *side_m <= cell_m));
    if is_empty && ending == Ending::OfLog {
        return Err(nothing_mapped(&name, &read, &mapping));
    }
    let mut lost = read.losses();
    lost.append(&mut mapping.earlier_losses);
    lost.extend(report::mapping_losses(&mapping, &made));
    if ending == Ending::Interrupted {
        lost.push(format!("interrupted after {}; the results are complete up to there", read.place()));
    }
    let usable = report::usable(&mapping, &made, read.scans_left_out());
    let mut losses = lost.clone();
    losses.extend(usable.loss());
    let mut report = report::full_report(&name, read.to_json(), &mut mapping, &made, &usable, &losses);
    report["odd"] = json!(read.oddities());
    mapping.output.write_json("report.json", &report)?;
    let timing = mapping.clock.report(mapping.tally.scans, mapping.tally.log_s());
    mapping.output.write_json("timing.json", &timing)?;
    let mut odd = read.oddities();
    odd.extend(remove_outdated_exports(&mut mapping.output));
    let words = LastWords {
        name: &name,
        usable: &usable,
        made: &made,
        timing: &timing,
        truth: String::new(),
        losses: &lost,
        odd: &odd,
        used: read.used(),
        folder: output,
    };
    let words = words.of(&mapping);
    let files = mapping.output.commit()?;
    if voice.json {
        say_json(&json!({ "files": files, "report": report, "timing": timing }))?;
    } else if !voice.quiet {
        say(&words)?;
    }
    Ok(Outcome::of_losses(&losses))
}

/// Scans that do not make a map.
fn nothing_mapped(name: &str, read: &Reading, mapping: &Mapping) -> Failure {
    if mapping.sonars.is_heard() && mapping.tally.scans == 0 {
        let heard = mapping.sonars.words();
        let odd: String = read.losses().into_iter().chain(read.oddities()).map(|odd| format!("; {odd}")).collect();
        return Failure::Log(format!(
            "{name}: expected sonars with odometry beside them, whose echoes walls answer more than once, found none: {}{odd}",
            heard.trim_start_matches("sonars").trim()
        ));
    }
    let tally = &mapping.tally;
    let refused = tally.refused.iter().map(|(reason, &scans)| format!("{} refused: {reason}", count(scans, "scan")));
    let odd = read.losses().into_iter().chain(read.oddities()).chain(refused);
    let odd: String = odd.map(|odd| format!("; {odd}")).collect();
    let (scans, beams) = (count(tally.scans, "scan"), tally.beam_words());
    Failure::Log(format!(
        "{name}: expected scans that can be mapped, found {scans} of which none can: of their beams {beams}{odd}"
    ))
}

fn map_space(args: &MapArgs, source: Source<'_>, interrupt: &Interrupt) -> Result<Outcome, Failure> {
    space::check_choice_of_clouds(&args.source)?;
    let name = args.logs.first().map_or_else(String::new, |path| path.display().to_string());
    space::map(
        &space::Run {
            name: &name,
            output: &args.output(),
            mapping: &args.mapping,
            goes_on: args.goes_on,
            mesh: args.mesh,
        },
        source,
        interrupt,
    )
}
