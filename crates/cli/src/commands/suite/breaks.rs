//! `mapwright suite breaks`

use super::Measure;
use super::floors::{Floor, percent, stats};
use crate::args::BreaksArgs;
use crate::commands::eval::read_relation_file;
use crate::events::{input, name_of};
use crate::failure::Failure;
use crate::pose_graph::pose_graph;
use crate::recorded::{Missing, Recorded};
use crate::simulated::{PEOPLE, map_events, office, true_relations};
use crate::terminal::{count, duration};
use crate::timing::ThreadClock;
use mapwright::{LaserScan, Settings, Status, TrajectoryPose};
use mapwright_eval::{Relation, StampedPose, relation_errors};
use mapwright_sim::{Event, EventTime, Gap, Rng};
use serde::Serialize;
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::Path;

/// A run is within the bound when its error is at most so many times that of the whole log.
///
/// As much as `suite loops` allows beside a batch solve. Less is no fault: with every increment of odometry 50 % wrong intel's error
/// is 1.13 times the usual at worst (`just figures-noise intel 0.5`), and a gap takes scans with their relations away besides.
const BOUND_TIMES: f64 = 1.3;
/// and so much more, metres: a fifth of a cell of the map. Of logs with small errors it is what counts; relations surveyed by hand
/// have noise of their own of 0.01 to 0.03 m, so that they cannot tell less apart.
const BOUND_MORE_M: f64 = 0.01;
/// So many of the runs must be within the bound.
const LEAST_WITHIN: f64 = 0.9;
/// No run's error may be more, metres.
const MOST_ERROR_M: f64 = 0.5;
/// A run may take so many times the CPU that the whole log takes.
const MOST_CPU: f64 = 2.5;
/// A gap keeps so far from both ends of a log, seconds: before there must be a map, and after it a drive.
const FROM_ENDS_S: f64 = 10.0;
/// Gaps begin at multiples of this share of a log, so that what is printed repeats a run exactly.
const SHARE_STEPS: f64 = 1e4;
/// Of the random numbers that say where gaps begin.
const PLACES_KEY: u64 = 0x6272_6561_6b73;

pub(super) struct Breaks {
    settings: Settings,
    all: bool,
    logs: Vec<Log>,
    /// Each a log and a gap in it.
    runs: Vec<(usize, Gap)>,
}

/// A log, as it was recorded and as it is mapped whole.
struct Log {
    recording: Recording,
    whole: Mapped,
    /// A run's error may be so much, metres.
    bound_m: f64,
}

struct Recording {
    name: String,
    origin: Origin,
    events: Vec<Event<LaserScan>>,
    times: Vec<EventTime>,
    relations: Vec<Relation>,
    /// What could not be read.
    losses: Vec<String>,
    /// What is not used, in words.
    unused: Vec<String>,
}

/// Where a recording comes from.
enum Origin {
    File,
    /// An office floor of this seed.
    Office(u64),
}

/// What came of mapping a log.
#[derive(Debug, Clone, Copy, Serialize)]
struct Mapped {
    /// Those of which both scans are there.
    relations: usize,
    error_m: f64,
    error_deg: f64,
    left_out: usize,
    pieces: usize,
    cpu_s: f64,
}

#[derive(Debug, Serialize)]
pub(super) struct World {
    /// Number of the log.
    log: usize,
    name: String,
    begins_at: f64,
    lasts_s: f64,
    missing_scans: u64,
    missing_readings: u64,
    #[serde(flatten)]
    mapped: Mapped,
    bound_m: f64,
    /// CPU as a multiple of the whole log's.
    cpu_times: f64,
    /// What repeats it.
    command: String,
}

impl Recording {
    fn of(name: String, origin: Origin, events: Vec<Event<LaserScan>>, relations: Vec<Relation>) -> Self {
        let times = events.iter().map(Event::event_time).collect();
        Self { name, origin, events, times, relations, losses: Vec::new(), unused: Vec::new() }
    }

    fn read(log: &Path, relations: &Path) -> Result<Self, Failure> {
        let relations = read_relation_file(relations)?;
        let Recorded { events, turn_rates, reading } = Recorded::read(input(log)?, log)?;
        let unused = (turn_rates > 0).then(|| format!("{} are not used", count(turn_rates, "turn rate")));
        let recording = Self::of(name_of(log), Origin::File, events, relations);
        Ok(Self { losses: reading.losses(), unused: unused.into_iter().collect(), ..recording })
    }

    fn office(seed: u64) -> Self {
        let (mut events, mut truth) = (Vec::new(), Vec::new());
        for event in office(seed, PEOPLE) {
            events.push(match event {
                Event::Odometry(odometry) => Event::Odometry(odometry),
                Event::Scan(taken) => {
                    truth.push(StampedPose { stamp: taken.scan.stamp, world_from_robot: taken.world_from_robot });
                    Event::Scan(taken.scan)
                }
            });
        }
        Self::of(format!("office floor, seed {seed}"), Origin::Office(seed), events, true_relations(&truth))
    }

    fn scans(&self) -> impl DoubleEndedIterator<Item = &EventTime> {
        self.times.iter().filter(|time| time.is_scan)
    }

    /// Time from the first scan to the last, seconds.
    fn span_s(&self) -> f64 {
        self.scans()
            .next()
            .zip(self.scans().next_back())
            .map_or(0.0, |(first, last)| last.stamp.secs_since(first.stamp))
    }

    /// Gaps of these lengths, the same places for each: evenly spread, the first `offset` of a step (0 to 1) after where it might be.
    fn gaps(&self, lengths_s: &[f64], places: u32, offset: f64) -> Result<Vec<Gap>, Failure> {
        let longest_s = lengths_s.iter().copied().fold(0.0, f64::max);
        let (span_s, around_s) = (self.span_s(), longest_s + 2.0 * FROM_ENDS_S);
        if span_s <= around_s {
            let (name, found) = (&self.name, duration(span_s));
            let expected = format!("expected scans over more than {around_s} s to have a gap of {longest_s} s in");
            return Err(Failure::Log(format!("{name}: {expected}, found {found}; --lengths takes shorter ones")));
        }
        let begins_at = |place: u32| {
            let along = (f64::from(place) + offset) / f64::from(places);
            let share = (FROM_ENDS_S + along * (span_s - around_s)) / span_s;
            (share * SHARE_STEPS).round() / SHARE_STEPS
        };
        let gaps =
            lengths_s.iter().flat_map(|&lasts_s| (0..places).map(move |place| Gap::new(begins_at(place), lasts_s)));
        gaps.collect::<Result<_, _>>().map_err(|error| Failure::Log(format!("{}: {error}", self.name)))
    }

    /// Maps the events that are not missing.
    fn map(&self, missing: Option<&Missing>, settings: &Settings) -> Result<Mapped, Failure> {
        let is_missing = |at: usize| missing.is_some_and(|missing| missing.events.get(at) == Some(&true));
        let events = self.events.iter().enumerate().filter(|(at, _)| !is_missing(*at)).map(|(_, event)| event.clone());
        let (clock, mut left_out) = (ThreadClock::start(), 0);
        let session = map_events(events, settings, |_, update, _| {
            left_out += usize::from(update.status == Status::Lost);
        })?;
        let cpu_s = clock.spent_s();
        let pose = |pose: TrajectoryPose| StampedPose { stamp: pose.stamp, world_from_robot: pose.map_from_robot };
        let report = relation_errors(&session.trajectory().map(pose).collect::<Vec<_>>(), &self.relations);
        let reason = || "expected relations with stamps of the scans that are there, found none".to_owned();
        let errors = report.all.ok_or_else(|| Failure::World { name: self.name.clone(), reason: reason() })?;
        Ok(Mapped {
            relations: report.used,
            error_m: errors.translation_m.mean,
            error_deg: errors.rotation_deg.mean,
            left_out,
            pieces: pose_graph(&session, session.map_from_keyframe(), |_, _| true).connected_parts(),
            cpu_s,
        })
    }

    /// What repeats a run: of a file the log with the gap, for every other command; of a simulated one the run.
    fn command(&self, gap: Gap) -> String {
        match self.origin {
            Origin::File => format!("mapwright perturb {} --gap {gap} -o broken.clf", self.name),
            Origin::Office(seed) => format!("mapwright suite breaks --seed {seed} --gap {gap} --all"),
        }
    }
}

impl Log {
    fn of(recording: Recording, within_m: Option<f64>, settings: &Settings) -> Result<Self, Failure> {
        let whole = recording.map(None, settings)?;
        let bound_m = within_m.unwrap_or(BOUND_TIMES * whole.error_m + BOUND_MORE_M);
        Ok(Self { recording, whole, bound_m })
    }

    fn words(&self) -> String {
        let Self { recording, whole, bound_m } = self;
        let mut text = format!(
            "{}: whole {:.4} m over {}, {} over {}, {} left out, {}, {:.2} s of CPU; bound {bound_m:.4} m\n",
            recording.name,
            whole.error_m,
            count(whole.relations as u64, "relation"),
            count(recording.scans().count() as u64, "scan"),
            duration(recording.span_s()),
            whole.left_out,
            count(whole.pieces as u64, "piece"),
            whole.cpu_s,
        );
        for unused in &recording.unused {
            let _ = writeln!(text, "odd      {unused}");
        }
        text
    }
}

impl Breaks {
    /// Reads the logs, or drives, and maps each whole.
    pub(super) fn prepare(args: &BreaksArgs, settings: Settings) -> Result<Self, Failure> {
        let (logs, relations) = (args.logs.len(), args.relations.len());
        if logs != relations {
            let found = format!("{} and {relations} of relations", count(logs as u64, "log"));
            return Err(Failure::Usage(format!("expected a file of --relations for each log, found {found}")));
        }
        let recordings: Result<Vec<_>, Failure> = if logs > 0 {
            args.logs.iter().zip(&args.relations).map(|(log, relations)| Recording::read(log, relations)).collect()
        } else {
            Ok(super::seeds_of(&args.worlds, 1).map(Recording::office).collect())
        };
        let (mut logs, mut runs) = (Vec::new(), Vec::new());
        let offset = Rng::keyed(args.worlds.run.seed, PLACES_KEY).unit();
        for recording in recordings? {
            let gaps = match &args.gap[..] {
                [] => recording.gaps(&args.lengths, args.places, offset)?,
                given => given.to_vec(),
            };
            for &gap in &gaps {
                Missing::of(&recording.name, &recording.times, &[gap])?; // told before anything is mapped
            }
            runs.extend(gaps.into_iter().map(|gap| (logs.len(), gap)));
            logs.push(recording);
        }
        let logs: Result<_, _> = logs.into_iter().map(|recording| Log::of(recording, args.within, &settings)).collect();
        Ok(Self { settings, all: args.all, logs: logs?, runs })
    }

    /// How many runs there are.
    pub(super) fn runs(&self) -> u64 {
        self.runs.len() as u64
    }
}

impl World {
    fn is_within(&self) -> bool {
        self.mapped.error_m <= self.bound_m
    }

    /// Whether it is beyond what a floor bounds.
    fn is_bad(&self) -> bool {
        !self.is_within() || self.mapped.error_m > MOST_ERROR_M || self.mapped.left_out > 0 || self.cpu_times > MOST_CPU
    }
}

impl Measure for Breaks {
    type World = World;
    const NAME: &'static str = "breaks";
    const FILES: [&'static str; 2] = ["breaks.jsonl", "breaks.json"];
    const KIND: &'static str = "run";

    fn world(&self, seed: u64) -> Result<World, Failure> {
        let (log, gap) = self.runs[seed as usize];
        let Log { recording, whole, bound_m } = &self.logs[log];
        let missing = Missing::of(&recording.name, &recording.times, &[gap])?;
        let mapped = recording.map(Some(&missing), &self.settings)?;
        Ok(World {
            log,
            name: recording.name.clone(),
            begins_at: gap.begins_at(),
            lasts_s: gap.lasts_s(),
            missing_scans: missing.scans,
            missing_readings: missing.readings,
            mapped,
            bound_m: *bound_m,
            cpu_times: mapped.cpu_s / whole.cpu_s,
            command: recording.command(gap),
        })
    }

    fn is_told(&self, world: &World) -> bool {
        self.all || world.is_bad()
    }

    fn line(world: &World) -> String {
        let Mapped { relations, error_m, left_out, pieces, .. } = world.mapped;
        format!(
            "{:5} s at {:.4}  error {error_m:.4} m ({}), {relations:4} relations  {left_out:4} scans left out  {}  CPU {:.2} times  {}",
            world.lasts_s,
            world.begins_at,
            if world.is_within() { "ok" } else { "BAD" },
            count(pieces as u64, "piece"),
            world.cpu_times,
            world.command,
        )
    }

    fn summary(&self, worlds: &[World]) -> (String, Value, Vec<Floor>) {
        let (mut words, mut values) = (String::new(), Vec::new());
        for (at, log) in self.logs.iter().enumerate() {
            let groups = Group::of_lengths(worlds.iter().filter(|world| world.log == at));
            words += &log.words();
            words += Group::HEAD;
            groups.iter().for_each(|group| words += &group.row());
            values.push(json!({
                "log": log.recording.name, "whole": log.whole, "bound_m": log.bound_m, "groups": groups,
            }));
        }
        (words, json!({ "logs": values }), self.floors(worlds))
    }
}

impl Breaks {
    fn floors(&self, worlds: &[World]) -> Vec<Floor> {
        let such = |is: fn(&&World) -> bool| worlds.iter().filter(is).count();
        let left_out = worlds.iter().map(|world| world.mapped.left_out).sum();
        let losses: Vec<_> = self.logs.iter().flat_map(|log| log.recording.losses.iter().map(String::as_str)).collect();
        let found = if losses.is_empty() { "yes".to_owned() } else { losses.join("; ") };
        vec![
            Floor { what: "all of the logs read", found, holds: losses.is_empty() },
            Floor::share("90 % of the runs within the bound", LEAST_WITHIN, such(|w| w.is_within()), worlds.len()),
            Floor::none("no error above 0.5 m", such(|w| w.mapped.error_m > MOST_ERROR_M)),
            Floor::none("no scan left out", left_out),
            Floor::share("CPU at most 2.5 times in every run", 1.0, such(|w| w.cpu_times <= MOST_CPU), worlds.len()),
        ]
    }
}

/// The runs of a log with gaps of one length.
#[derive(Debug, Serialize)]
struct Group {
    lasts_s: f64,
    runs: usize,
    within: usize,
    error_m_median: f64,
    error_m_worst: f64,
    left_out: usize,
    runs_with_left_out: usize,
    most_pieces: usize,
    cpu_times_mean: f64,
    cpu_times_worst: f64,
}

impl Group {
    const HEAD: &'static str = "     gap  runs  within the bound        error, median and worst    scans left out    pieces  CPU, mean and worst\n";

    /// One for each length, in the order of the runs.
    fn of_lengths<'a>(runs: impl Iterator<Item = &'a World>) -> Vec<Self> {
        let mut lengths: Vec<(f64, Vec<&World>)> = Vec::new();
        for run in runs {
            match lengths.iter_mut().find(|(lasts_s, _)| *lasts_s == run.lasts_s) {
                Some((_, runs)) => runs.push(run),
                None => lengths.push((run.lasts_s, vec![run])),
            }
        }
        lengths.iter().filter_map(|(lasts_s, runs)| Self::of(*lasts_s, runs)).collect()
    }

    /// None without runs.
    fn of(lasts_s: f64, runs: &[&World]) -> Option<Self> {
        let (error_m, cpu_times) = (stats(runs, |run| run.mapped.error_m)?, stats(runs, |run| run.cpu_times)?);
        Some(Self {
            lasts_s,
            runs: runs.len(),
            within: runs.iter().filter(|run| run.is_within()).count(),
            error_m_median: error_m.median,
            error_m_worst: error_m.max,
            left_out: runs.iter().map(|run| run.mapped.left_out).sum(),
            runs_with_left_out: runs.iter().filter(|run| run.mapped.left_out > 0).count(),
            most_pieces: runs.iter().map(|run| run.mapped.pieces).max()?,
            cpu_times_mean: cpu_times.mean,
            cpu_times_worst: cpu_times.max,
        })
    }

    fn row(&self) -> String {
        format!(
            "{:6} s  {:4}  {:22}  {:11.4} {:9.4} m  {:6} in {:3} runs  {:7}  {:13.2} {:5.2}\n",
            self.lasts_s,
            self.runs,
            percent(self.within, self.runs),
            self.error_m_median,
            self.error_m_worst,
            self.left_out,
            self.runs_with_left_out,
            self.most_pieces,
            self.cpu_times_mean,
            self.cpu_times_worst,
        )
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may")]
mod tests {
    use super::*;
    use mapwright::{LaserModel, Stamp};

    /// Scans every half a second.
    fn recording(span_s: i64) -> Recording {
        let laser = std::sync::Arc::new(LaserModel::half_circle("front", 3));
        let scan = |k: i64| LaserScan {
            stamp: Stamp(500_000_000 * k),
            laser: laser.clone(),
            ranges_m: vec![1.0; 3],
            odom_from_robot: None,
        };
        let events = (0..=2 * span_s).map(|k| Event::Scan(scan(k))).collect();
        Recording::of("a log".to_owned(), Origin::Office(7), events, Vec::new())
    }

    #[test]
    fn gaps_are_spread_over_all_of_the_log_but_its_ends() {
        let recording = recording(1000);
        for offset in [0.0, 0.5, 0.999] {
            let gaps = recording.gaps(&[3.0, 120.0], 20, offset).unwrap();
            let begins_s = |gaps: &[Gap]| gaps.iter().map(|gap| 1000.0 * gap.begins_at()).collect::<Vec<_>>();
            let (short, long) = (begins_s(&gaps[..20]), begins_s(&gaps[20..]));
            assert_eq!(short, long, "the same places for every length");
            assert!(short.windows(2).all(|pair| (pair[1] - pair[0] - 43.0).abs() < 0.2), "{short:?}");
            assert!(short[0] >= 10.0 && long[19] + 120.0 <= 990.0, "{short:?}");
            assert!(gaps.iter().all(|&gap| Missing::of("a log", &recording.times, &[gap]).is_ok()));
        }
        assert!(recording.gaps(&[3.0, 981.0], 1, 0.5).unwrap_err().to_string().contains("more than 1001 s"));
    }

    #[test]
    fn runs_are_bad_beyond_any_of_the_floors_and_are_grouped_by_length() {
        let run = |lasts_s, error_m, left_out, cpu_times| World {
            log: 0,
            name: "a log".to_owned(),
            begins_at: 0.5,
            lasts_s,
            missing_scans: 1,
            missing_readings: 1,
            mapped: Mapped { relations: 1, error_m, error_deg: 0.0, left_out, pieces: 1, cpu_s: 1.0 },
            bound_m: 0.027,
            cpu_times,
            command: recording(1).command(Gap::new(0.5, lasts_s).unwrap()),
        };
        let runs = [run(3.0, 0.02, 0, 1.0), run(9.0, 0.03, 0, 1.0), run(3.0, 0.02, 4, 1.0), run(9.0, 0.6, 0, 2.6)];
        assert_eq!([0, 1, 2, 3].map(|at| runs[at].is_bad()), [false, true, true, true]);
        assert_eq!(runs[0].command, "mapwright suite breaks --seed 7 --gap 0.5:3 --all");
        let groups = Group::of_lengths(runs.iter());
        let numbers = groups.iter().map(|g| (g.lasts_s, g.runs, g.within, g.left_out, g.error_m_worst));
        assert_eq!(numbers.collect::<Vec<_>>(), [(3.0, 2, 2, 4, 0.02), (9.0, 2, 0, 0, 0.6)]);
        let breaks = Breaks { settings: Settings::default(), all: false, logs: Vec::new(), runs: Vec::new() };
        assert_eq!(
            breaks.floors(&runs).iter().map(|f| f.holds).collect::<Vec<_>>(),
            [true, false, false, false, false]
        );
        assert!(breaks.floors(&runs[..1]).iter().all(|floor| floor.holds));
    }
}
