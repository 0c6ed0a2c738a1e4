//! One mapping run: scans in, files out.

use crate::args::{Align, MappingArgs, SettingsArgs, StampPolicy};
use crate::closures::{CLOSURES, ClosureFile};
use crate::failure::Failure;
use crate::interrupt::Interrupt;
use crate::maps::{MadeMap, MapWriter, remove_outdated_maps, ways};
use crate::output::OutputFolder;
use crate::picture::RunNames;
use crate::pieces::Pieces;
use crate::pose_graph::pose_graph;
use crate::progress::Progress;
use crate::session::{SESSION, SessionLog};
use crate::settings;
use crate::sonar::Sonars;
use crate::stamps::Stamper;
use crate::tally::Tally;
use crate::terminal::count;
use crate::timing::StageClock;
use crate::turns::Turns;
use mapwright::{
    Beams, Entry, Job, JobResult, LaserScan, LeftOut, LeftOutReason, LivePolicy, LocalMapReport, Mapper, MapperOf,
    Maps, Odometry, Pose2, RunId, Session, Settings, TurnRate, Update,
};
use mapwright_formats::{LogEvent, TumWriter};
use mapwright_graph::g2o::{AnyPoseGraph, write_g2o};
use mapwright_sensor::SonarReading;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::Write;

const ONLINE: &str = "trajectory_online.tum";

/// A mapper, and everything that is made of its updates.
pub(crate) struct Mapping {
    mapper: Mapper,
    pub(crate) settings: Settings,
    /// What was switched on the command line beside them.
    pub(crate) switched: BTreeMap<&'static str, String>,
    log: SessionLog,
    /// What was lost of the session that is gone on with.
    pub(crate) earlier_losses: Vec<String>,
    pub(crate) local_map: LocalMapReport,
    pub(crate) tally: Tally,
    pub(crate) clock: StageClock,
    pub(crate) output: OutputFolder,
    online: Option<TumWriter<File>>,
    stamper: Stamper,
    progress: Progress,
    policy: StampPolicy,
    align: Align,
    picture_side: Option<u16>,
    has_odometry: bool,
    last_odometry: Option<Pose2>,
    pub(crate) turns: Turns,
    pub(crate) sonars: Sonars,
    /// What was asked for, where the settings are those of sonars beside it; and where the robot starts.
    asked: (SettingsArgs, Pose2),
    /// What the keyframes are of, where it is of several logs or sessions: their names, and the first keyframe of each.
    pub(crate) parts: Vec<(String, usize)>,
}

/// What a run has made, for report and people.
#[derive(Debug, Clone)]
pub(crate) struct Made {
    pub(crate) path_m: f64,
    pub(crate) pieces: Pieces,
    /// One for each of the session's maps, in order.
    pub(crate) maps: Vec<MadeMap>,
}

/// Settings of a run: those of file and command line, and `--no-odometry`.
pub(crate) fn settings_of(args: &MappingArgs) -> Result<Settings, Failure> {
    let mut settings = settings::load(&args.settings)?;
    settings.motion.use_odometry &= !args.no_odometry;
    if let Some(how) = &args.correction {
        settings.set("loops.correction", how)?;
    }
    Ok(settings)
}

/// Takes in a session that was mapped apart, until somebody interrupts; what of it was lost, in words.
pub(crate) fn take_in<M: Maps>(
    mapper: &mut MapperOf<M>,
    log: &mut SessionLog<M>,
    (session, name): (&Session<M>, &str),
    interrupt: &Interrupt,
) -> Result<Option<String>, Failure> {
    if log.session().shares_keyframes(session) {
        return Err(Failure::Usage(format!(
            "{name} is given twice, or overlaps what was given before: it has keyframes that are in the map"
        )));
    }
    let mut unwritten = Vec::new();
    let imported = mapper.import(session, |mut update| {
        unwritten.append(&mut update.unwritten);
        log.add(update.entries).map_err(Some)?;
        if interrupt.came() { Err(None) } else { Ok(()) }
    });
    imported.or_else(|why: Option<Failure>| why.map_or(Ok(()), Err))?;
    Ok(unwritten.first().map(|first| {
        let what = count(unwritten.len() as u64, "entry");
        format!("{name}: {what} that no session can hold, first: {first}")
    }))
}

impl Mapping {
    /// Begins a run, or goes on with a session, of which something may be lost; `length` is that of the progress bar.
    pub(crate) fn begin(
        args: &MappingArgs,
        output: OutputFolder,
        length: Option<u64>,
        earlier: Option<(Session, Vec<String>)>,
    ) -> Result<Self, Failure> {
        Self::begin_with(args, settings_of(args)?, output, length, earlier)
    }

    /// The same with these settings.
    pub(crate) fn begin_with(
        args: &MappingArgs,
        settings: Settings,
        mut output: OutputFolder,
        length: Option<u64>,
        earlier: Option<(Session, Vec<String>)>,
    ) -> Result<Self, Failure> {
        let clock = StageClock::start();
        let start = args.start.unwrap_or(Pose2::IDENTITY);
        let (earlier, earlier_losses) = earlier.map_or((None, Vec::new()), |(session, losses)| (Some(session), losses));
        let log = SessionLog::begin(&mut output, earlier.as_ref())?;
        let mapper = match earlier {
            Some(session) => Mapper::resume(settings, session)?,
            None => Mapper::starting_at(settings, start)?,
        };
        let online = Some(TumWriter::new(output.begin(ONLINE)?));
        Ok(Self {
            mapper,
            settings,
            switched: BTreeMap::new(),
            log,
            earlier_losses,
            local_map: LocalMapReport::default(),
            tally: Tally::default(),
            clock,
            output,
            online,
            stamper: Stamper::new(args.stamps),
            progress: Progress::new(length, args.voice.quiet || args.voice.json),
            policy: args.stamps,
            align: args.align,
            picture_side: args.picture_side,
            has_odometry: false,
            last_odometry: None,
            turns: Turns::default(),
            sonars: Sonars::default(),
            asked: (args.settings.clone(), start),
            parts: Vec::new(),
        })
    }

    /// One scan through the mapper; `position` is how far along the bar it lies.
    pub(crate) fn add_scan(&mut self, scan: &LaserScan, position: u64) -> Result<(), Failure> {
        let update = self.map(scan);
        self.progress.scan(update.stamp, position);
        self.write(update)
    }

    /// The same while the robot drives: what came of it, and whether it could be written down.
    pub(crate) fn add_scan_live(&mut self, scan: &LaserScan) -> (Update, Result<(), Failure>) {
        let update = self.map(scan);
        (update.clone(), self.write(update))
    }

    /// Another map begins, or goes on with a session, in the same folder; what was mapped up to now stays there under another name.
    pub(crate) fn begin_anew(&mut self, earlier: Option<Session>) -> Result<(), Failure> {
        self.log.finish()?;
        let kept = self.output.keep(SESSION)?;
        let log = SessionLog::begin(&mut self.output, earlier.as_ref())?;
        let mapper = match earlier {
            Some(session) => Mapper::resume(self.settings, session)?,
            None => Mapper::starting_at(self.settings, self.asked.1)?,
        };
        (self.log, self.mapper) = (log, mapper);
        self.online = Some(TumWriter::new(self.output.begin(ONLINE)?));
        (self.tally, self.turns, self.last_odometry) = (Tally::default(), Turns::default(), None);
        self.earlier_losses
            .push(format!("somebody asked for another map; what was mapped before is in {}", kept.display()));
        Ok(())
    }

    /// What the mapper has recorded, the update included that was just made.
    pub(crate) fn mapper_session(&self) -> &Session {
        self.mapper.session()
    }

    /// The next job to be done beside.
    pub(crate) fn next_job(&mut self) -> Option<Job> {
        self.mapper.next_job()
    }

    /// A job's result, what came of it, and whether it could be written down.
    pub(crate) fn apply(&mut self, result: JobResult) -> (Update, Result<(), Failure>) {
        let update = self.mapper.apply(result);
        (update.clone(), self.log.add(update.entries))
    }

    fn map(&mut self, scan: &LaserScan) -> Update {
        let update = self.mapper.add_scan_probed(scan, &mut self.clock);
        self.has_odometry |= scan.odom_from_robot.is_some();
        self.tally.add(&update, self.has_odometry && self.settings.motion.use_odometry);
        self.turns.add(&update, scan.odom_from_robot.or(self.last_odometry), &scan.laser);
        self.local_map = update.local_map;
        self.clock.scan(update.scan);
        update
    }

    fn write(&mut self, update: Update) -> Result<(), Failure> {
        if let Some(online) = &mut self.online {
            let written = online.write_planar(self.stamper.next(update.stamp), update.map_from_robot);
            written
                .map_err(|cause| Failure::write(self.output.path(ONLINE), cause))
                .inspect_err(|_| self.output.failed_to_write())?;
        }
        self.log.add(update.entries).inspect_err(|_| self.output.failed_to_write())
    }

    /// One event of a log through the mapper.
    pub(crate) fn take(&mut self, event: LogEvent<'_>, position: u64) -> Result<(), Failure> {
        match event {
            LogEvent::Scan(scan) => {
                self.sonars.see_laser(scan);
                self.add_scan(scan, position)?;
            }
            LogEvent::Odometry(odometry) => self.add_odometry(odometry, position)?,
            LogEvent::Sonar(reading) => self.add_sonar(reading, position)?,
            LogEvent::TurnRate(rate) => self.add_turn_rate(rate),
            _ => {}
        }
        Ok(())
    }

    /// Another run begins, wherever its robot is: the next one of the robot that the session ends with.
    pub(crate) fn switch_on(&mut self) -> Result<(), Failure> {
        let heard = self.sonars.end();
        self.add_scans_of_sonars(heard, 0)?;
        let robot = self.session().runs().last().map_or(RunId::of_robot("robot"), |run| run.id);
        let update = self.mapper.switch_on(robot);
        self.has_odometry = false;
        (self.last_odometry, self.turns) = (None, Turns::default());
        self.log.add(update.entries)
    }

    /// Takes in a session that was mapped apart.
    pub(crate) fn import(&mut self, session: &Session, name: &str, interrupt: &Interrupt) -> Result<(), Failure> {
        self.earlier_losses.extend(take_in(&mut self.mapper, &mut self.log, (session, name), interrupt)?);
        Ok(())
    }

    /// What comes is of this log or session.
    pub(crate) fn begin_part(&mut self, name: String) {
        let first = if self.parts.is_empty() { 0 } else { self.session().keyframes().len() };
        self.parts.push((name, first));
    }

    /// Everything that was recorded.
    pub(crate) fn session(&self) -> &Session {
        self.log.session()
    }

    /// A reading of a gyroscope.
    pub(crate) fn add_turn_rate(&mut self, rate: &TurnRate) {
        self.mapper.add_turn_rate(rate);
    }

    /// A reading of the wheels.
    pub(crate) fn add_odometry(&mut self, odometry: &Odometry, position: u64) -> Result<(), Failure> {
        self.has_odometry = true;
        self.last_odometry = Some(odometry.odom_from_robot);
        self.mapper.add_odometry(odometry);
        let scans = self.sonars.add_odometry(odometry);
        self.add_scans_of_sonars(scans, position)
    }

    /// Readings of a ring of sonars.
    pub(crate) fn add_sonar(&mut self, reading: &SonarReading, position: u64) -> Result<(), Failure> {
        let scans = self.sonars.add(reading);
        self.add_scans_of_sonars(scans, position)
    }

    /// Scans that stand for what sonars have heard. Where they are all that there is, the settings are those of sonars.
    fn add_scans_of_sonars(&mut self, scans: Vec<LaserScan>, position: u64) -> Result<(), Failure> {
        for scan in scans {
            if self.tally.scans == 0 && self.session().keyframes().is_empty() {
                let use_odometry = self.settings.motion.use_odometry;
                self.settings = settings::load_over(Settings::of_sonars(), &self.asked.0)?;
                self.settings.motion.use_odometry = use_odometry;
                self.mapper = Mapper::starting_at(self.settings, self.asked.1)?;
            }
            self.add_scan(&scan, position)?;
        }
        Ok(())
    }

    /// No more scans will come: old places are looked for anew.
    pub(crate) fn look_again(&mut self) -> Result<(), Failure> {
        let update = self.mapper.look_again();
        self.log.add(update.entries)
    }

    /// No more scans: takes the bar away.
    pub(crate) fn end_of_scans(&mut self) -> Result<(), Failure> {
        let scans = self.sonars.end();
        self.add_scans_of_sonars(scans, 0)?;
        self.clock.end_of_scans();
        self.progress.finish();
        Ok(())
    }

    /// Writes trajectories and maps.
    pub(crate) fn write_results(&mut self) -> Result<Made, Failure> {
        if let Some(online) = self.online.take() {
            online
                .finish()
                .map_err(|cause| Failure::write(self.output.path(ONLINE), cause))
                .inspect_err(|_| self.output.failed_to_write())?;
        }
        self.log.add(self.mapper.checkpoint().entries)?;
        write_trajectory(&mut self.output, self.log.session(), self.policy)?;
        write_graph(&mut self.output, self.log.session())?;
        let (made, path_m) = self.write_maps()?;
        self.log.add(entries_of_left_out(&made))?;
        self.log.finish()?;
        Ok(Made { path_m, pieces: Pieces::of(self.session()), maps: made })
    }

    /// Each map of the session, and the length of the way, metres.
    fn write_maps(&mut self) -> Result<(Vec<MadeMap>, f64), Failure> {
        let session = self.log.session();
        let maps = session.maps();
        let (ways, path_m) = ways(session, &maps);
        // A local map of everything is the map already; over a break it begins anew.
        let is_whole = self.settings.live.policy == LivePolicy::Everything
            && !session.fragments().iter().any(|fragment| session.is_break(fragment));
        let names = RunNames::of_logs(self.parts.iter().map(|(name, first)| (name.as_str(), *first)));
        let writer = MapWriter {
            settings: &self.settings,
            session,
            drawn: is_whole.then(|| self.mapper.local_map().counts()).filter(|_| !self.sonars.is_alone()),
            sonars: Some(&self.sonars).filter(|sonars| sonars.is_alone()),
            turn_upright: self.align == Align::Walls,
            picture_side: self.picture_side,
            names: &names,
        };
        let mut made = Vec::with_capacity(maps.len());
        for (number, (map, way)) in maps.iter().zip(&ways).enumerate() {
            made.push(writer.write(&mut self.output, (number, map), way)?);
        }
        if self.sonars.is_heard() && !self.sonars.is_alone() {
            writer.write_sonars(&mut self.output, &self.sonars)?;
        }
        remove_outdated_maps(&mut self.output, made.len());
        Ok((made, path_m))
    }
}

/// Keyframes that the maps leave out, for the log.
pub(crate) fn entries_of_left_out(made: &[MadeMap]) -> Vec<Entry> {
    let left_out = made.iter().flat_map(|map| &map.keyframes_left_out).map(|&keyframe| {
        let (beams, reason) = (Beams::All, LeftOutReason::ContradictsTheMap);
        Entry::LeftOut(LeftOut { keyframe, beams, reason })
    });
    left_out.collect()
}

/// The final trajectory, every scan in arrival order.
pub(crate) fn write_trajectory(
    output: &mut OutputFolder,
    session: &Session,
    policy: StampPolicy,
) -> Result<(), Failure> {
    let mut stamper = Stamper::new(policy);
    output.write("trajectory.tum", |writer| {
        let mut trajectory = TumWriter::new(writer);
        for pose in session.trajectory() {
            trajectory.write_planar(stamper.next(pose.stamp), pose.map_from_robot)?;
        }
        trajectory.finish().map(|_| ())
    })
}

/// Keyframes with the edges that stand, and all candidates.
pub(crate) fn write_graph(output: &mut OutputFolder, session: &Session) -> Result<(), Failure> {
    let graph = AnyPoseGraph::Planar(pose_graph(session, session.map_from_keyframe(), |_, _| true));
    output.write("graph.g2o", |writer| Ok(write_g2o(&graph, writer)?))?;
    let closures = ClosureFile::of(session);
    output.write(CLOSURES, |mut writer| {
        serde_json::to_writer_pretty(&mut writer, &closures).map_err(std::io::Error::from)?;
        Ok(writer.write_all(b"\n")?)
    })
}
