//! `mapwright info`

mod contents;
mod differences;
mod recorded;
mod space;

use crate::args::{InfoArgs, SourceArgs};
use crate::events::{Ending, Log, input, name_of};
use crate::failure::{Failure, Outcome};
use crate::interrupt::Interrupt;
use crate::progress::FirstPass;
use crate::reading::Reading;
use crate::report::remarks;
use crate::space::{Disk, check_choice_of_files, hear_metadata, plan_in_words};
use crate::terminal::{count, grouped, say, say_json};
use contents::Contents;
use differences::{Differences, Steps};
use mapwright_logs::{Choice, Input, Links, LogError, LogReport, Plan, SpacePlan, Survey};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

pub(super) fn run(args: &InfoArgs) -> Result<Outcome, Failure> {
    let interrupt = Interrupt::watch()?;
    let (mut found, mut links) = (Vec::new(), Links::default());
    for path in &args.logs {
        let log = match Found::in_space(path, &args.source)? {
            Some(found) => found,
            None => Found::at(path, args, &mut links, &interrupt)?,
        };
        if !args.json {
            say(&log.words)?;
        }
        found.push(log);
    }
    let differences = match &found[..] {
        [first, second] if !first.is_of_space && !second.is_of_space => {
            Some(Differences::of(&first.log(), &second.log()))
        }
        _ => None,
    };
    let losses: Vec<_> = found.iter().flat_map(|log| log.losses.clone()).collect();
    if args.json {
        let logs: Vec<_> = found.into_iter().map(|log| log.value).collect();
        match <[Value; 1]>::try_from(logs) {
            Ok([value]) => say_json(&value)?,
            Err(logs) => say_json(&json!({ "logs": logs, "differences": differences.map(|found| found.to_json()) }))?,
        }
    } else if let Some(differences) = &differences {
        say(&differences.to_words())?;
    }
    Ok(Outcome::of_losses(&losses))
}

/// All that was found in one log.
struct Found {
    name: String,
    contents: Contents,
    steps: Steps,
    words: String,
    value: Value,
    losses: Vec<String>,
    /// Of such the input is not compared.
    is_of_space: bool,
}

impl Found {
    /// A recording of a sensor in space; none where it is something else.
    fn in_space(path: &Path, source: &SourceArgs) -> Result<Option<Self>, Failure> {
        let Some(disk) = Disk::open(path)? else { return Ok(None) };
        let Some(recording) = disk.recording()? else { return Ok(None) };
        check_choice_of_files(source)?;
        let name = name_of(path);
        let (words, value, losses) = space::look(&name, &recording, source)?;
        let (contents, steps) = (Contents::default(), Steps::default());
        Ok(Some(Self { name, contents, steps, words, value, losses, is_of_space: true }))
    }

    fn at(path: &Path, args: &InfoArgs, links: &mut Links, interrupt: &Interrupt) -> Result<Self, Failure> {
        let name = name_of(path);
        match input(path)? {
            Input::Recording(path) => Self::in_recording(name, &path, args, links, interrupt),
            other => {
                let mut found = Self::by_reading(name, other, path, &args.source.choice(), interrupt)?;
                found.words = format!("{}: {}", found.name, found.words);
                Ok(found)
            }
        }
    }

    fn in_recording(
        name: String,
        path: &Path,
        args: &InfoArgs,
        links: &mut Links,
        interrupt: &Interrupt,
    ) -> Result<Self, Failure> {
        let choice = &args.source.choice();
        let mut first_pass = FirstPass::new(interrupt, args.json);
        let survey = Survey::watched(path, &mut |messages| first_pass.look(&name, messages));
        drop(first_pass);
        let survey = survey.map_err(|cause| Failure::log(LogError::Recording { name: name.clone(), cause }))?;
        let stopped = || Failure::log(LogError::Stopped { name: name.clone() });
        let mut survey = Box::new(survey.ok_or_else(stopped)?);
        hear_metadata(path, &mut survey);
        survey.links.inherit(links);
        links.clone_from(&survey.links);
        let (words, plan) = (recorded::words(&name, &survey), Plan::of(&survey, choice));
        if SpacePlan::is_default(&survey, choice) {
            let plan = SpacePlan::of(&survey, choice, &args.source.camera());
            return Ok(match plan {
                Ok(plan) => Self::messages_in_space(name, &survey, words, &plan),
                Err(reason) => Self::refused(name, &survey, words, &reason),
            });
        }
        if let Err(reason) = plan {
            return Ok(Self::refused(name, &survey, words, &reason));
        }
        let input = Input::Surveyed(path.to_owned(), survey.clone());
        match Self::by_reading(name.clone(), input, path, choice, interrupt) {
            Err(Failure::NoScan { found, .. }) => {
                Ok(Self::refused(name, &survey, words, &format!("expected laser scans, found {found}")))
            }
            found => found.map(|found| Self { words: words + &found.words, ..found }),
        }
    }

    /// A recording in which there is nothing to map.
    fn refused(name: String, survey: &Survey, words: String, reason: &str) -> Self {
        let reason = LogError::refused(&name, reason).to_string();
        let words = format!("{words}no map   {reason}\n");
        Self::looked_through(name, survey, words, ("refused", json!(reason)))
    }

    /// A recording that is mapped in space.
    fn messages_in_space(name: String, survey: &Survey, words: String, plan: &SpacePlan) -> Self {
        let topics = std::iter::once(&plan.topic).chain(&plan.further).cloned().collect::<Vec<_>>().join(" and ");
        let said = format!("{topics} can be mapped: mapwright map {name} --space -o OUT");
        let odd = plan.odd.iter().chain(&plan.doubts).map(|odd| format!("odd      {odd}\n")).collect::<String>();
        let words = format!("{words}space    {said}\n{}{odd}", plan_in_words(plan));
        let reasons: Vec<_> = plan.reasons.iter().map(|(what, why)| json!({ "what": what, "why": why })).collect();
        let value = json!({ "topic": plan.topic, "further": plan.further, "reasons": reasons, "assumed": plan.assumed, "odd": plan.odd, "doubts": plan.doubts });
        Self::looked_through(name, survey, words, ("space", value))
    }

    /// A recording of which nothing but its first pass is told.
    fn looked_through(name: String, survey: &Survey, words: String, (key, found): (&str, Value)) -> Self {
        let losses: Vec<_> = crate::reading::damage_words(&survey.container, true).collect();
        let odd: Vec<_> = crate::reading::damage_words(&survey.container, false).collect();
        let words = words + &remarks(&losses, &odd);
        let value = json!({
            "log": name,
            "lasers": [],
            "read": crate::reading::survey_json(survey),
            key: found,
            "odd": odd,
            "losses": losses,
        });
        Self { name, contents: Contents::default(), steps: Steps::default(), words, value, losses, is_of_space: false }
    }

    /// Reads a log from end to end.
    fn by_reading(
        name: String,
        input: Input,
        path: &Path,
        choice: &Choice,
        interrupt: &Interrupt,
    ) -> Result<Self, Failure> {
        let mut log =
            Log::of(vec![(name.clone(), input)], &[PathBuf::from(path)], choice, &mut |_, _| !interrupt.came())?
                .taking_sonars();
        let (mut contents, mut steps) = (Contents::default(), Steps::default());
        let ending = log.for_each(interrupt, |event, _| {
            steps.add(event);
            contents.add(event);
            Ok(())
        })?;
        let read = log.finish()?;
        let mut losses = read.losses();
        if ending == Ending::Interrupted {
            losses.push(format!("interrupted after {}", read.place()));
        }
        let odd = read.oddities();
        let words = head(&read) + &contents.to_words() + &remarks(&losses, &odd);
        let mut value = contents.to_json(&name);
        value["read"] = read.to_json();
        value["odd"] = json!(odd);
        value["losses"] = json!(losses);
        Ok(Self { name, contents, steps, words, value, losses, is_of_space: false })
    }

    fn log(&self) -> differences::Log<'_> {
        differences::Log { name: &self.name, contents: &self.contents, steps: &self.steps }
    }
}

fn head(read: &Reading) -> String {
    match &read.logs[..] {
        [(_, LogReport::Carmen(report))] => {
            format!("{}, {} bytes\n", count(report.lines, "line"), grouped(report.bytes))
        }
        _ => read.used(),
    }
}
