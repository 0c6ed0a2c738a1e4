//! Whether logs are mapped in the plane or in space.

use super::disk::Disk;
use super::messages::Messages;
use super::source::Source;
use crate::args::{MapArgs, SourceArgs};
use crate::events::{input, name_of};
use crate::failure::Failure;
use mapwright_logs::{Input, LogError, SpacePlan, Survey};
use std::fs;
use std::path::Path;

/// Larger ones are none.
const METADATA_BYTES_AT_MOST: u64 = 1 << 20;

/// What logs are mapped as.
pub(crate) enum Sought<'a> {
    Space(Source<'a>),
    Plane(Vec<(String, Input)>),
}

/// Looks into what is to be mapped: in space where that is asked for, or where there is nothing else to map in a recording.
pub(crate) fn seek<'a>(args: &MapArgs, watch: &mut dyn FnMut(&str, u64) -> bool) -> Result<Sought<'a>, Failure> {
    let mut inputs = Vec::new();
    for path in &args.logs {
        inputs.push((name_of(path), input(path)?));
    }
    if inputs.len() == 1 && args.source.choice().slice.is_none() {
        return one(args, inputs, watch);
    }
    if args.space {
        return Err(not_one(&format!("{} logs", inputs.len())));
    }
    Ok(Sought::Plane(inputs))
}

fn one<'a>(
    args: &MapArgs,
    inputs: Vec<(String, Input)>,
    watch: &mut dyn FnMut(&str, u64) -> bool,
) -> Result<Sought<'a>, Failure> {
    let (choice, options) = (args.source.choice(), args.source.camera());
    let mut sought = Vec::new();
    for (name, input) in inputs {
        let Input::Recording(path) = input else {
            if args.space {
                return Err(not_one(&format!("{name}, a CARMEN log")));
            }
            sought.push((name, input));
            continue;
        };
        let survey = surveyed(&name, &path, watch)?;
        if args.space || SpacePlan::is_default(&survey, &choice) {
            let messages = Messages::open(&name, &path, survey, &choice, &options)?;
            return Ok(Sought::Space(Source::Messages(Box::new(messages))));
        }
        sought.push((name, Input::Surveyed(path, Box::new(survey))));
    }
    Ok(Sought::Plane(sought))
}

fn surveyed(name: &str, path: &Path, watch: &mut dyn FnMut(&str, u64) -> bool) -> Result<Survey, Failure> {
    let survey = Survey::watched(path, &mut |messages| watch(name, messages));
    let survey = survey.map_err(|cause| Failure::log(LogError::Recording { name: name.to_owned(), cause }))?;
    let mut survey = survey.ok_or_else(|| Failure::log(LogError::Stopped { name: name.to_owned() }))?;
    hear_metadata(path, &mut survey);
    Ok(survey)
}

/// What a sensor says of itself may lie beside a recording, in a file of its name.
pub(crate) fn hear_metadata(path: &Path, survey: &mut Survey) {
    let file = path.with_extension("json");
    let is_small = fs::metadata(&file).is_ok_and(|found| found.is_file() && found.len() <= METADATA_BYTES_AT_MOST);
    if let Some(text) = fs::read_to_string(&file).ok().filter(|_| is_small) {
        survey.hear_metadata(&text);
    }
}

fn not_one(found: &str) -> Failure {
    Failure::Log(format!("--space: expected one recording of clouds or images of depth, found {found}"))
}

/// Whether what lies at a path is mapped in space, as `map` would.
pub(crate) fn is_of_space(path: &Path, args: &SourceArgs) -> Result<bool, Failure> {
    if let Some(disk) = Disk::open(path)?
        && disk.recording()?.is_some()
    {
        return Ok(true);
    }
    let Input::Recording(recording) = input(path)? else { return Ok(false) };
    if args.choice().slice.is_some() {
        return Ok(false);
    }
    let survey =
        Survey::of(&recording).map_err(|cause| Failure::log(LogError::Recording { name: name_of(path), cause }))?;
    Ok(SpacePlan::is_default(&survey, &args.choice()))
}

/// The clouds of a recording of messages.
pub(crate) fn in_space<'a>(
    path: &Path,
    args: &SourceArgs,
    watch: &mut dyn FnMut(&str, u64) -> bool,
) -> Result<Source<'a>, Failure> {
    let name = name_of(path);
    match input(path)? {
        Input::Recording(path) => {
            super::check_choice_of_clouds(args)?;
            let survey = surveyed(&name, &path, watch)?;
            let messages = Messages::open(&name, &path, survey, &args.choice(), &args.camera())?;
            Ok(Source::Messages(Box::new(messages)))
        }
        _ => Err(Failure::Log(format!(
            "{name}: expected a recording of clouds or images of depth, found a log of a planar laser"
        ))),
    }
}
