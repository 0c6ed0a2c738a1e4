//! Clouds of a recording of messages: ROS 1 bags, MCAP, ROS 2 bags.

use crate::failure::Failure;
use crate::reading::damage_words;
use mapwright_clouds::{CameraOptions, Notes, Reference};
use mapwright_logs::{Choice, LogError, SpacePlan, SpaceStream, Survey};
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

impl Messages {
    pub(super) fn open(
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
        let what = match plan.kind {
            kind if kind.is_planar() => "swings of the laser",
            kind if kind.is_clouds() => "clouds",
            _ => "images of depth",
        };
        let container = self.stream.survey().container.container;
        let container = container.map_or_else(|| "a recording".to_owned(), |container| container.to_string());
        let topics = std::iter::once(&plan.topic).chain(&plan.further).cloned().collect::<Vec<_>>().join(" and ");
        format!("{what} of {topics} in {container}")
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
