//! Where clouds come from: files of a folder, or messages of a recording.

use super::messages::Messages;
use super::simulated::Simulation;
use crate::args::SourceArgs;
use crate::failure::Failure;
use mapwright::{Cloud, Pose3, SpaceReading, SpaceSensor};
use mapwright_clouds::{Clouds, Kind, Notes, Recording, Reference};
use mapwright_logs::{SpaceEvent, SpacePlan};
use serde_json::Value;

/// A source of clouds, and all that is known of it.
pub(crate) enum Source<'a> {
    Files { recording: &'a Recording<'a>, clouds: Box<Clouds<'a>>, name: String },
    Messages(Box<Messages>),
    Simulated(Box<Simulation>),
}

impl<'a> Source<'a> {
    pub(crate) fn files(name: String, recording: &'a Recording<'a>, args: &SourceArgs) -> Result<Self, Failure> {
        let clouds = recording.clouds(&args.camera());
        let clouds = clouds.map_err(|cause| Failure::Log(format!("{name}: {cause}")))?;
        Ok(Self::Files { recording, clouds: Box::new(clouds), name })
    }

    /// The next cloud; none at the end. Readings that come before it are handed to `feel`.
    pub(crate) fn next_cloud(&mut self, feel: &mut dyn FnMut(SpaceReading)) -> Result<Option<Cloud>, Failure> {
        match self {
            Self::Files { clouds, name, .. } => {
                let cloud = clouds.next_cloud().map_err(|cause| Failure::Log(format!("{name}: {cause}")))?;
                clouds.take_readings().into_iter().map(SpaceReading::Imu).for_each(feel);
                Ok(cloud)
            }
            Self::Messages(messages) => loop {
                match messages.stream.next_event().map_err(Failure::log)? {
                    Some(SpaceEvent::Imu(reading)) => feel(SpaceReading::Imu(reading)),
                    Some(SpaceEvent::Odometry(stamp)) => feel(SpaceReading::Odometry(stamp)),
                    Some(SpaceEvent::Cloud(cloud)) => return Ok(Some(cloud)),
                    None => return Ok(None),
                }
            },
            Self::Simulated(simulation) => simulation.next_cloud(&mut |reading| feel(SpaceReading::Imu(reading))),
        }
    }

    /// Its kind, in words.
    fn kind(&self) -> String {
        match self {
            Self::Files { recording, .. } => recording.kind().to_string(),
            Self::Messages(messages) => messages.kind(),
            Self::Simulated(simulation) => simulation.kind(),
        }
    }

    /// How many clouds it has, unless some cannot be read.
    pub(super) fn frames(&self) -> u64 {
        match self {
            Self::Files { recording, .. } => recording.frames() as u64,
            Self::Messages(messages) => messages.stream.plan().messages,
            Self::Simulated(simulation) => simulation.frames(),
        }
    }

    fn sensor(&self) -> &SpaceSensor {
        match self {
            Self::Files { clouds, .. } => clouds.sensor(),
            Self::Messages(messages) => &messages.stream.plan().sensor,
            Self::Simulated(simulation) => simulation.sensor(),
        }
    }

    /// The drive, where it is a simulated one.
    pub(super) fn simulation(&self) -> Option<&Simulation> {
        match self {
            Self::Simulated(simulation) => Some(simulation),
            Self::Files { .. } | Self::Messages(_) => None,
        }
    }

    /// Clouds after so many were read for nobody.
    pub(super) fn forget_after(&mut self, clouds: usize) {
        match self {
            Self::Simulated(simulation) => simulation.forget_after(clouds),
            Self::Files { .. } | Self::Messages(_) => {}
        }
    }

    /// The topic of inertial readings, if there is one.
    fn imu_name(&self) -> Option<&str> {
        match self {
            Self::Files { recording, .. } => recording.has_readings().then(|| match recording.kind() {
                Kind::EurocStereo => "imu0",
                _ => "the lidar's inertial sensor",
            }),
            Self::Simulated(simulation) => simulation.imu_name(),
            Self::Messages(messages) => messages.stream.plan().imu.as_ref().map(|imu| imu.name.as_str()),
        }
    }

    /// What is mapped of a recording of messages, and why.
    pub(super) fn plan(&self) -> Option<&SpacePlan> {
        match self {
            Self::Messages(messages) => Some(messages.stream.plan()),
            Self::Files { .. } | Self::Simulated(_) => None,
        }
    }

    /// What was decided and taken for granted, in words.
    fn decisions(&self) -> Vec<String> {
        match self {
            Self::Files { clouds, .. } => clouds.decisions().to_vec(),
            Self::Messages(messages) => messages.decisions(),
            Self::Simulated(_) => Vec::new(),
        }
    }

    /// The same for people: lines, and what is to be said among what is odd.
    fn decisions_in_words(&self) -> (String, Vec<String>) {
        match self {
            Self::Files { clouds, .. } => (String::new(), clouds.decisions().to_vec()),
            Self::Messages(messages) => (messages.plan_in_words(), Vec::new()),
            Self::Simulated(_) => (String::new(), Vec::new()),
        }
    }

    /// Poses that came with it.
    fn references(&self) -> &[Reference] {
        match self {
            Self::Files { recording, .. } => recording.references(),
            Self::Messages(messages) => &messages.references,
            Self::Simulated(_) => &[],
        }
    }

    /// What was found to be wrong so far.
    fn notes(&self) -> Notes {
        let (mut notes, more) = match self {
            Self::Files { recording, clouds, .. } => (recording.notes().clone(), clouds.notes()),
            Self::Messages(messages) => (messages.notes.clone(), messages.stream.notes()),
            Self::Simulated(_) => return Notes::default(),
        };
        notes.extend(more);
        notes
    }

    /// What is odd about it, and what casts doubt on a map of it, in words.
    fn doubts(&self) -> [Vec<String>; 2] {
        match self {
            Self::Files { clouds, .. } => [clouds.odd().to_vec(), clouds.doubts().to_vec()],
            Self::Messages(messages) => {
                let plan = messages.stream.plan();
                [plan.odd.clone(), plan.doubts.iter().chain(messages.stream.doubts()).cloned().collect()]
            }
            Self::Simulated(_) => Default::default(),
        }
    }

    /// Damage of the container, in words: what may have cost clouds, and what has not.
    fn damages(&self) -> (Vec<String>, Vec<String>) {
        match self {
            Self::Files { .. } | Self::Simulated(_) => (Vec::new(), Vec::new()),
            Self::Messages(messages) => messages.damages(),
        }
    }

    /// All that is to be said of it, once it was read.
    pub(crate) fn read(&self) -> Read {
        let (losses, mut odd) = self.damages();
        let [more, doubts] = self.doubts();
        odd.extend(more);
        let (lines, said) = self.decisions_in_words();
        Read {
            kind: self.kind(),
            frames: self.frames(),
            sensor: Some(self.sensor().clone()),
            decisions: self.decisions(),
            lines,
            said,
            references: self.references().to_vec(),
            imu: self.imu_name().map(str::to_owned),
            json: self.read_json(),
            notes: self.notes(),
            losses,
            odd,
            doubts,
        }
    }

    /// What else a report says of how it was read.
    fn read_json(&self) -> Value {
        match self {
            Self::Files { .. } | Self::Simulated(_) => Value::Null,
            Self::Messages(messages) => crate::reading::survey_json(messages.stream.survey()),
        }
    }
}

/// What is said of a source that was read, or of several in a row.
#[derive(Debug, Clone, Default)]
pub(crate) struct Read {
    pub(super) kind: String,
    pub(super) frames: u64,
    /// None where nothing but sessions was read.
    pub(super) sensor: Option<SpaceSensor>,
    /// What was decided and taken for granted, in words;
    pub(super) decisions: Vec<String>,
    /// the same for people: lines, and what is to be said among what is odd.
    pub(super) lines: String,
    pub(super) said: Vec<String>,
    /// Poses that came with it.
    pub(super) references: Vec<Reference>,
    /// The topic of inertial readings, if there is one.
    pub(super) imu: Option<String>,
    /// What else a report says of how it was read.
    pub(super) json: Value,
    /// What was found to be wrong.
    pub(super) notes: Notes,
    /// Damage of the container, in words: what may have cost clouds, and what has not.
    pub(super) losses: Vec<String>,
    pub(super) odd: Vec<String>,
    /// What casts doubt on a map of it, in words.
    pub(super) doubts: Vec<String>,
}

impl Read {
    /// Of clouds that were heard while the robot drove.
    pub(crate) fn live(topics: &str) -> Self {
        Self { kind: format!("clouds of {topics}, live"), ..Self::default() }
    }

    pub(super) fn robot_from_sensor(&self) -> Pose3 {
        self.sensor.as_ref().map_or_else(Pose3::identity, |sensor| sensor.robot_from_sensor)
    }

    /// Another source is read after these: what is said of both, but for the poses that came with them, whose frames have nothing to do
    /// with each other.
    pub(super) fn and(mut self, mut other: Self, name: &str) -> Self {
        let kinds = [self.kind, other.kind].into_iter().filter(|kind| !kind.is_empty());
        self.kind = kinds.collect::<Vec<_>>().join("; ");
        self.frames += other.frames;
        self.sensor = self.sensor.or(other.sensor);
        self.decisions.extend(other.decisions.into_iter().map(|words| format!("{name}: {words}")));
        self.lines += &other.lines;
        self.said.extend(other.said.into_iter().map(|words| format!("{name}: {words}")));
        self.references.clear();
        self.imu = self.imu.or(other.imu);
        self.notes.extend(&other.notes);
        self.losses.append(&mut other.losses);
        self.odd.append(&mut other.odd);
        self.doubts.extend(other.doubts.into_iter().map(|words| format!("{name}: {words}")));
        self
    }
}
