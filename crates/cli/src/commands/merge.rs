//! `mapwright merge`

use super::map::{Finished, finish};
use crate::args::{MappingArgs, MergeArgs};
use crate::events::{self, Ending, Interrupt, Log, name_of};
use crate::failure::{Failure, Outcome};
use crate::mapping::{Mapping, settings_of};
use crate::output::OutputFolder;
use crate::progress::FirstPass;
use crate::reading::Reading;
use crate::session::{AnySession, earlier_in_plane, is_session, read_any_session};
use crate::space::{self, MergeInput};
use mapwright::{LivePolicy, Session};
use mapwright_logs::{Input as Recorded, LogError, Robot, Survey};
use std::path::Path;

/// What is merged.
enum Input {
    /// A session, and what was lost of it.
    Session(Box<Session>, Vec<String>),
    /// A log, which is read when its turn comes; and whose scans are meant where it is one of several robots.
    Log(Recorded, Option<String>),
}

pub(super) fn run(args: &MergeArgs) -> Result<Outcome, Failure> {
    let settings = settings_of(&args.mapping)?;
    refuse(&args.mapping, settings.live.policy)?;
    let interrupt = Interrupt::watch()?;
    if let Some(inputs) = in_space(args)? {
        return space::merge(args, inputs, &interrupt);
    }
    let mut inputs: Vec<(String, &Path, Input)> = Vec::new();
    for path in &args.inputs {
        inputs.append(&mut input(path, args, &interrupt)?);
    }
    if inputs.len() < 2 {
        let why = "expected two logs or sessions at least, or a recording of several robots; one log is for `map`";
        return Err(Failure::Usage(why.to_owned()));
    }
    if args.mapping.start.is_some() && inputs.first().is_some_and(|(_, _, input)| matches!(input, Input::Session(..))) {
        let why =
            "--start says where the first log begins, and the first input is a session, which begins where it does";
        return Err(Failure::Usage(why.to_owned()));
    }
    let mut mapping: Option<Mapping> = None;
    let begin = |output: &Path, earlier| {
        let output = OutputFolder::create(output)?;
        let mut begun = Mapping::begin(&args.mapping, output, None, earlier)?;
        begun.switched = args.source.switched(args.mapping.start);
        Ok::<_, Failure>(begun)
    };
    let mut read = Reading { logs: Vec::new(), notes: Vec::new() };
    let mut ending = Ending::OfLog;
    let names: Vec<String> = inputs.iter().map(|(name, _, _)| name.clone()).collect();
    for (name, path, input) in inputs {
        match (input, &mut mapping) {
            (Input::Session(session, losses), None) => {
                mapping.insert(begin(&args.output, Some((*session, losses)))?).begin_part(name);
            }
            (Input::Session(session, mut losses), Some(mapping)) => {
                mapping.begin_part(name.clone());
                mapping.earlier_losses.append(&mut losses);
                mapping.import(&session, &name, &interrupt)?;
            }
            (Input::Log(log, robot), known) => {
                let log = open((&name, path), log, robot.as_deref(), args, &interrupt)?;
                let mapping = match known {
                    Some(mapping) => {
                        mapping.switch_on()?;
                        mapping
                    }
                    None => mapping.insert(begin(&args.output, None)?),
                };
                mapping.begin_part(name);
                ending = map_log(log, mapping, &interrupt, &mut read)?;
            }
        }
        if ending == Ending::Interrupted || interrupt.came() {
            ending = Ending::Interrupted;
            break;
        }
    }
    let Some(mut mapping) = mapping else { return Err(Failure::Usage("expected logs or sessions".to_owned())) };
    mapping.end_of_scans()?;
    finish(mapping, Finished { name: names.join(", "), read, ending, output: &args.output, voice: args.mapping.voice })
}

/// The inputs, where they are of space: the first one says.
fn in_space(args: &MergeArgs) -> Result<Option<Vec<(String, MergeInput)>>, Failure> {
    let mut inputs = Vec::new();
    for path in &args.inputs {
        let name = name_of(path);
        if is_session(path)? {
            match read_any_session(path)? {
                (AnySession::Space(session), losses) => {
                    if session.keyframes().is_empty() {
                        let cause = "expected keyframes, found none".to_owned();
                        return Err(Failure::Session { path: path.clone(), cause });
                    }
                    inputs.push((name, MergeInput::Session(Box::new(session), losses)));
                    continue;
                }
                (AnySession::Plane(_), _) => {}
            }
        } else if space::is_of_space(path, &args.source)? {
            inputs.push((name, MergeInput::Recording(path.clone())));
            continue;
        }
        if inputs.is_empty() {
            return Ok(None);
        }
        return Err(Failure::Usage(format!(
            "{name} is of the plane, and what was named before it is of space: they make no map together"
        )));
    }
    if inputs.len() < 2 {
        let why = "expected two recordings or sessions at least; one recording is for `map`";
        return Err(Failure::Usage(why.to_owned()));
    }
    Ok(Some(inputs))
}

fn refuse(mapping: &MappingArgs, policy: LivePolicy) -> Result<(), Failure> {
    if mapping.resume.is_some() {
        return Err(Failure::Usage(
            "--resume is for `map`; `merge` takes sessions as they are: name it first".to_owned(),
        ));
    }
    if policy == LivePolicy::Everything {
        let why = "merge looks for places that are not matched against, and live.policy = \"everything\" leaves none";
        return Err(Failure::Usage(why.to_owned()));
    }
    Ok(())
}

/// What lies at a path: a recording of several robots counts as a log of each.
fn input<'a>(
    path: &'a Path,
    args: &MergeArgs,
    interrupt: &Interrupt,
) -> Result<Vec<(String, &'a Path, Input)>, Failure> {
    let name = name_of(path);
    if !is_session(path)? {
        let recording = match events::input(path)? {
            Recorded::Recording(recording) if !args.source.has_robot() => recording,
            log => return Ok(vec![(name, path, Input::Log(log, None))]),
        };
        let survey = looked_through(&name, &recording, args, interrupt)?;
        let log = |survey| Recorded::Surveyed(recording.clone(), Box::new(survey));
        let robots = survey.robots();
        if robots.len() < 2 {
            return Ok(vec![(name, path, Input::Log(log(survey), None))]);
        }
        let of_robot = |robot: Robot| {
            (format!("{name}, {}", robot.shown()), path, Input::Log(log(survey.clone()), Some(robot.name)))
        };
        return Ok(robots.into_iter().map(of_robot).collect());
    }
    let (session, losses) = earlier_in_plane(path)?;
    if session.keyframes().is_empty() {
        return Err(Failure::Session { path: path.to_owned(), cause: "expected keyframes, found none".to_owned() });
    }
    Ok(vec![(name, path, Input::Session(Box::new(session), losses))])
}

fn looked_through(name: &str, recording: &Path, args: &MergeArgs, interrupt: &Interrupt) -> Result<Survey, Failure> {
    let voice = args.mapping.voice;
    let mut first_pass = FirstPass::new(interrupt, voice.quiet || voice.json);
    let survey = Survey::watched(recording, &mut |messages| first_pass.look(name, messages));
    let survey = survey.map_err(|cause| Failure::log(LogError::Recording { name: name.to_owned(), cause }))?;
    survey.ok_or_else(|| Failure::log(LogError::Stopped { name: name.to_owned() }))
}

fn open(
    (name, path): (&str, &Path),
    log: Recorded,
    robot: Option<&str>,
    args: &MergeArgs,
    interrupt: &Interrupt,
) -> Result<Log, Failure> {
    let voice = args.mapping.voice;
    let mut first_pass = FirstPass::new(interrupt, voice.quiet || voice.json);
    let mut watch = |name: &str, messages| first_pass.look(name, messages);
    let source = robot.map_or_else(|| args.source.clone(), |robot| args.source.of_robot(robot));
    Log::of(vec![(name.to_owned(), log)], &[path.to_owned()], &source.choice(), &mut watch).map(Log::taking_sonars)
}

fn map_log(mut log: Log, mapping: &mut Mapping, interrupt: &Interrupt, read: &mut Reading) -> Result<Ending, Failure> {
    let ending = log.for_each(interrupt, |event, position| mapping.take(event, position))?;
    let mut log = log.finish()?;
    read.logs.append(&mut log.logs);
    read.notes.append(&mut log.notes);
    Ok(ending)
}
