//! Clouds of a recording of messages: ROS 1 bags, MCAP, ROS 2 bags.

use super::source::Source;
use crate::args::MapArgs;
use crate::events::{input, name_of};
use crate::failure::Failure;
use crate::reading::damage_words;
use mapwright_clouds::{CameraOptions, Notes, Reference};
use mapwright_logs::{Choice, Input, LogError, SpacePlan, SpaceStream, Survey, TopicKind};
use std::fs;
use std::path::Path;

/// Files of poses (`stamp x y z qx qy qz qw`) that may lie beside a recording; of its sensor.
const REFERENCES: [&str; 2] = ["poses_tum.txt", "groundtruth.txt"];
/// Larger ones are none.
const REFERENCE_BYTES_AT_MOST: u64 = 1 << 30;

/// A recording that is mapped in space.
pub(crate) struct Messages {
    pub(super) stream: SpaceStream,
    pub(super) references: Vec<Reference>,
    /// Of the references.
    pub(super) notes: Notes,
}

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
    survey.ok_or_else(|| Failure::log(LogError::Stopped { name: name.to_owned() }))
}

fn not_one(found: &str) -> Failure {
    Failure::Log(format!("--space: expected one recording of clouds or images of depth, found {found}"))
}

impl Messages {
    fn open(
        name: &str,
        path: &Path,
        survey: Survey,
        choice: &Choice,
        options: &CameraOptions,
    ) -> Result<Self, Failure> {
        let plan = SpacePlan::of(&survey, choice, options);
        let plan = plan.map_err(|reason| Failure::log(LogError::refused(name, &reason)))?;
        let stream = SpaceStream::open(name, path, survey, plan).map_err(Failure::log)?;
        let mut notes = Notes::default();
        let references = references_beside(path, &mut notes);
        Ok(Self { stream, references, notes })
    }

    pub(super) fn kind(&self) -> String {
        let plan = self.stream.plan();
        let what = if plan.kind == TopicKind::Cloud { "clouds" } else { "images of depth" };
        let container = self.stream.survey().container.container;
        let container = container.map_or_else(|| "a recording".to_owned(), |container| container.to_string());
        format!("{what} of {} in {container}", plan.topic)
    }

    pub(super) fn decisions(&self) -> Vec<String> {
        let plan = self.stream.plan();
        let reasons = plan.reasons.iter().map(|(what, why)| format!("{what}: {why}"));
        reasons.chain(plan.assumed.iter().map(|assumed| format!("assumed: {assumed}"))).collect()
    }

    pub(super) fn plan_in_words(&self) -> String {
        plan_in_words(self.stream.plan())
    }

    pub(super) fn damages(&self) -> (Vec<String>, Vec<String>) {
        let survey = self.stream.survey();
        let mut odd: Vec<String> = damage_words(&survey.container, false).collect();
        if survey.links.refused > 0 {
            odd.push(format!("transforms that cannot be: {}", crate::terminal::grouped(survey.links.refused)));
        }
        (damage_words(&survey.container, true).collect(), odd)
    }
}

/// A plan as lines.
pub(crate) fn plan_in_words(plan: &SpacePlan) -> String {
    let reasons = plan.reasons.iter().map(|(what, why)| format!("{what:<9}{why}\n"));
    reasons.chain(plan.assumed.iter().map(|assumed| format!("assumed  {assumed}\n"))).collect()
}

fn references_beside(path: &Path, notes: &mut Notes) -> Vec<Reference> {
    let folder = if path.is_dir() { path } else { path.parent().unwrap_or(Path::new("")) };
    let mut read = |name: &&str| {
        let file = folder.join(name);
        let size_bytes = fs::metadata(&file).ok().filter(fs::Metadata::is_file)?.len();
        let bytes = fs::read(&file).ok().filter(|_| size_bytes <= REFERENCE_BYTES_AT_MOST)?;
        Reference::of_tum(name, &bytes, notes)
    };
    REFERENCES.iter().filter_map(&mut read).collect()
}
