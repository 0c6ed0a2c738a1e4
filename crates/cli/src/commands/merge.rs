//! `mapwright merge`

use super::map::{Finished, finish};
use crate::args::{MappingArgs, MergeArgs};
use crate::events::{Ending, Interrupt, Log, name_of};
use crate::failure::{Failure, Outcome};
use crate::mapping::{Mapping, settings_of};
use crate::output::OutputFolder;
use crate::progress::FirstPass;
use crate::reading::Reading;
use crate::session::{earlier_in_plane, is_session};
use mapwright::{LivePolicy, Session};
use std::path::Path;

/// What is merged: a session, and what was lost of it; none where it is a log, which is read when its turn comes.
type Input = Option<(Session, Vec<String>)>;

pub(super) fn run(args: &MergeArgs) -> Result<Outcome, Failure> {
    let settings = settings_of(&args.mapping)?;
    refuse(&args.mapping, settings.live.policy)?;
    let interrupt = Interrupt::watch()?;
    let inputs: Vec<Input> = args.inputs.iter().map(|path| input(path.as_path())).collect::<Result<_, _>>()?;
    if args.mapping.start.is_some() && inputs.first().is_some_and(Option::is_some) {
        let why =
            "--start says where the first log begins, and the first input is a session, which begins where it does";
        return Err(Failure::Usage(why.to_owned()));
    }
    let mut mapping: Option<Mapping> = None;
    let begin = |output: &Path, earlier| {
        let output = OutputFolder::create(output)?;
        Mapping::begin(&args.mapping, output, None, earlier)
    };
    let mut read = Reading { logs: Vec::new(), notes: Vec::new() };
    let mut ending = Ending::OfLog;
    for (path, input) in args.inputs.iter().zip(inputs) {
        match (input, &mut mapping) {
            (Some(session), None) => mapping.insert(begin(&args.output, Some(session))?).begin_part(name_of(path)),
            (Some((session, mut losses)), Some(mapping)) => {
                mapping.begin_part(name_of(path));
                mapping.earlier_losses.append(&mut losses);
                mapping.import(&session, &name_of(path), &interrupt)?;
            }
            (None, known) => {
                let log = open(path, args, &interrupt)?;
                let mapping = match known {
                    Some(mapping) => {
                        mapping.switch_on()?;
                        mapping
                    }
                    None => mapping.insert(begin(&args.output, None)?),
                };
                mapping.begin_part(name_of(path));
                ending = map_log(log, mapping, &interrupt, &mut read)?;
            }
        }
        if ending == Ending::Interrupted || interrupt.came() {
            ending = Ending::Interrupted;
            break;
        }
    }
    let Some(mut mapping) = mapping else { return Err(Failure::Usage("expected logs or sessions".to_owned())) };
    mapping.end_of_scans();
    let names: Vec<String> = args.inputs.iter().map(|path| name_of(path)).collect();
    finish(mapping, Finished { name: names.join(", "), read, ending, output: &args.output, voice: args.mapping.voice })
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

fn input(path: &Path) -> Result<Input, Failure> {
    if !is_session(path)? {
        return Ok(None);
    }
    let (session, losses) = earlier_in_plane(path)?;
    if session.keyframes().is_empty() {
        return Err(Failure::Session { path: path.to_owned(), cause: "expected keyframes, found none".to_owned() });
    }
    Ok(Some((session, losses)))
}

fn open(path: &Path, args: &MergeArgs, interrupt: &Interrupt) -> Result<Log, Failure> {
    let voice = args.mapping.voice;
    let mut first_pass = FirstPass::new(interrupt, voice.quiet || voice.json);
    let mut watch = |name: &str, messages| first_pass.look(name, messages);
    Log::open_all(&[path.to_owned()], &args.source.choice(), &mut watch)
}

fn map_log(mut log: Log, mapping: &mut Mapping, interrupt: &Interrupt, read: &mut Reading) -> Result<Ending, Failure> {
    let ending = log.for_each(interrupt, |event, position| mapping.take(event, position))?;
    let mut log = log.finish()?;
    read.logs.append(&mut log.logs);
    read.notes.append(&mut log.notes);
    Ok(ending)
}
