//! `mapwright localise`

use crate::args::LocaliseArgs;
use crate::events::{Ending, Interrupt, Log};
use crate::failure::{Failure, Outcome};
use crate::output::write_whole;
use crate::progress::{FirstPass, Progress};
use crate::session::{AnySession, read_any_session};
use crate::settings;
use crate::space;
use crate::terminal::{count, say, say_json};
use mapwright::{
    Localisation, Location, Mapper, Session, Settings, SpaceMapper, SpaceSweep, Status, Update, Withdrawal,
};
use mapwright_formats::{FormatError, LogEvent, StampedPose3, TumWriter};
use mapwright_record::Measurement;
use serde_json::json;
use std::fs::File;
use std::io::{BufWriter, Write};

/// How a scan was located.
#[derive(Debug, Clone, Default)]
struct Counts {
    scans: u64,
    located: u64,
    /// The scan at which the robot was located first, and seconds since the first scan.
    first: Option<(u64, f64)>,
    lost_again: u64,
    /// Where a finding was taken back: the scan, seconds since the first scan, and why.
    taken_back: Vec<(u64, f64, Withdrawal)>,
}

/// Findings that were taken back are named one by one up to here.
const NAMED: usize = 5;

/// Where poses go.
enum Poses<'a> {
    Csv(&'a mut BufWriter<File>),
    Tum(TumWriter<&'a mut BufWriter<File>>),
}

pub(super) fn run(args: &LocaliseArgs) -> Result<Outcome, Failure> {
    let mut settings = settings::load(&args.settings)?;
    settings.motion.use_odometry &= !args.no_odometry;
    let interrupt = Interrupt::watch()?;
    let (session, mut losses) = match read_any_session(&args.map)? {
        (AnySession::Plane(session), losses) => (session, losses),
        (AnySession::Space(session), losses) => return in_space(args, (session, losses), settings, &interrupt),
    };
    if session.keyframes().is_empty() {
        return Err(Failure::Session { path: args.map.clone(), cause: "expected a map, found no keyframe".to_owned() });
    }
    let quiet = args.voice.quiet || args.voice.json;
    let mut first_pass = FirstPass::new(&interrupt, quiet);
    let mut log =
        Log::open_all(&args.logs, &args.source.choice(), &mut |name, messages| first_pass.look(name, messages))?;
    drop(first_pass);
    let mut mapper = Mapper::localising(settings, session)?;
    let mut progress = Progress::new(log.size_bytes(), quiet);
    let is_csv = args.output.extension().is_some_and(|ending| ending == "csv");
    let (counts, ending, name, read) = write_whole(&args.output, |writer| {
        let mut poses = if is_csv { Poses::Csv(writer) } else { Poses::Tum(TumWriter::new(writer)) };
        let failed = |cause: FormatError| Failure::write(&args.output, cause);
        poses.begin().map_err(failed)?;
        let (mut counts, mut began) = (Counts::default(), None);
        let ending = log.for_each(&interrupt, |event, position| {
            match event {
                LogEvent::Scan(scan) => {
                    let update = mapper.add_scan(scan);
                    let began = *began.get_or_insert(update.stamp);
                    counts.add(&update, update.stamp.secs_since(began), mapper.withdrawal());
                    progress.scan(update.stamp, position);
                    poses.add(&update, mapper.location().as_ref()).map_err(failed)?;
                }
                LogEvent::Odometry(odometry) => mapper.add_odometry(odometry),
                LogEvent::TurnRate(rate) => {
                    mapper.add_turn_rate(rate);
                }
                _ => {}
            }
            Ok(())
        })?;
        poses.finish().map_err(failed)?;
        progress.finish();
        let name = log.name();
        Ok((counts, ending, name, log.finish()?))
    })?;
    losses.extend(read.losses());
    losses.extend(counts.losses());
    if ending == Ending::Interrupted {
        losses.push(format!("interrupted after {}; the poses are complete up to there", read.place()));
    }
    let oddities = read.oddities();
    if args.voice.json {
        say_json(&counts.to_json(&name, &losses))?;
    } else if !args.voice.quiet {
        let words = counts.words() + &crate::report::remarks(&losses, &oddities);
        say(&format!("{name}: {words}written  {}\n", args.output.display()))?;
    }
    Ok(Outcome::of_losses(&losses))
}

/// The same in a finished map of space.
fn in_space(
    args: &LocaliseArgs,
    (session, mut losses): (Session<SpaceSweep>, Vec<String>),
    settings: Settings,
    interrupt: &Interrupt,
) -> Result<Outcome, Failure> {
    let [path] = &args.logs[..] else {
        return Err(Failure::Usage("expected one recording of space, for the map is one of space".to_owned()));
    };
    if session.keyframes().is_empty() {
        return Err(Failure::Session { path: args.map.clone(), cause: "expected a map, found no keyframe".to_owned() });
    }
    let is_csv = args.output.extension().is_some_and(|ending| ending == "csv");
    let mut mapper = SpaceMapper::localising(settings, session)?;
    let (counts, said) = write_whole(&args.output, |writer| {
        let mut poses = if is_csv { Poses::Csv(writer) } else { Poses::Tum(TumWriter::new(writer)) };
        let failed = |cause: FormatError| Failure::write(&args.output, cause);
        poses.begin_in_space().map_err(failed)?;
        let (mut counts, mut began) = (Counts::default(), None);
        let said = space::each_cloud(path, &args.source, interrupt, &mut |readings, cloud| {
            readings.drain(..).for_each(|reading| mapper.add_reading(reading));
            let update = mapper.add_cloud(cloud);
            let began = *began.get_or_insert(update.stamp);
            counts.add(&update, update.stamp.secs_since(began), None);
            poses.add_in_space(&update).map_err(failed)
        })?;
        poses.finish().map_err(failed)?;
        Ok((counts, said))
    })?;
    losses.extend(said.losses);
    losses.extend(counts.losses());
    if interrupt.came() {
        losses.push(format!("interrupted after {}; the poses are complete up to there", count(counts.scans, "cloud")));
    }
    let name = path.display().to_string();
    if args.voice.json {
        say_json(&counts.to_json(&name, &losses))?;
    } else if !args.voice.quiet {
        let words = counts.words() + &crate::report::remarks(&losses, &said.odd);
        say(&format!("{name}: {words}written  {}\n", args.output.display()))?;
    }
    Ok(Outcome::of_losses(&losses))
}

fn words_of(why: Withdrawal) -> &'static str {
    match why {
        Withdrawal::Contradicted => "what was seen since contradicts the map there",
        Withdrawal::Overtaken => "another place explains the scans as well or better",
        Withdrawal::Break => "the robot may have been carried",
    }
}

/// Whether the robot is known to be where it is said to be.
fn is_located<M: Measurement>(update: &Update<M>) -> bool {
    update.localisation == Localisation::Joined && update.status != Status::Lost
}

impl Counts {
    fn add<M: Measurement>(&mut self, update: &Update<M>, elapsed_s: f64, withdrawal: Option<Withdrawal>) {
        self.taken_back.extend(withdrawal.map(|why| (self.scans, elapsed_s, why)));
        if is_located(update) {
            self.located += 1;
            self.first.get_or_insert((self.scans, elapsed_s));
        } else if self.first.is_some() {
            self.lost_again += 1;
        }
        self.scans += 1;
    }

    fn losses(&self) -> Vec<String> {
        let Some((first, _)) = self.first else {
            return vec!["the robot was nowhere recognised in the map".to_owned()];
        };
        let mut losses = Vec::new();
        if first > 0 {
            losses.push(format!("{} not located before the robot was found", count(first, "scan")));
        }
        if self.lost_again > 0 {
            losses.push(format!(
                "{} not located after the robot had been found: it was lost again",
                count(self.lost_again, "scan")
            ));
        }
        losses
    }

    fn words(&self) -> String {
        let Self { scans, located, first, taken_back, .. } = self;
        let mut text = format!("{} of {} located\n", count(*located, "scan"), count(*scans, "scan"));
        if let Some((scan, elapsed_s)) = first {
            text += &format!("found    at scan {scan}, {elapsed_s:.1} s after the first\n");
        }
        for (scan, elapsed_s, why) in taken_back.iter().take(NAMED) {
            text += &format!("withdrawn at scan {scan}, {elapsed_s:.1} s after the first: {}\n", words_of(*why));
        }
        if taken_back.len() > NAMED {
            text += &format!("withdrawn {} more times\n", taken_back.len() - NAMED);
        }
        text
    }

    fn to_json(&self, name: &str, losses: &[String]) -> serde_json::Value {
        let Self { scans, located, first, lost_again, taken_back } = self;
        let withdrawn = taken_back
            .iter()
            .map(|(scan, seconds, why)| json!({ "scan": scan, "seconds": seconds, "why": words_of(*why) }));
        json!({
            "log": name,
            "scans": scans,
            "located": located,
            "first_scan_located": first.map(|(scan, _)| scan),
            "seconds_until_located": first.map(|(_, elapsed_s)| elapsed_s),
            "not_located_afterwards": lost_again,
            "withdrawn": withdrawn.collect::<Vec<_>>(),
            "losses": losses,
        })
    }
}

impl Poses<'_> {
    fn begin(&mut self) -> Result<(), FormatError> {
        match self {
            Self::Csv(writer) => Ok(writeln!(
                writer,
                "stamp_s,located,x_m,y_m,heading_rad,sigma_x_m,sigma_y_m,sigma_heading_rad,inlier_share,status,lead_nats"
            )?),
            Self::Tum(_) => Ok(()),
        }
    }

    fn begin_in_space(&mut self) -> Result<(), FormatError> {
        match self {
            Self::Csv(writer) => Ok(writeln!(
                writer,
                "stamp_s,located,x_m,y_m,z_m,qx,qy,qz,qw,sigma_x_m,sigma_y_m,sigma_z_m,sigma_roll_rad,sigma_pitch_rad,sigma_yaw_rad,\
                 inlier_share,status"
            )?),
            Self::Tum(_) => Ok(()),
        }
    }

    fn add_in_space(&mut self, update: &Update<SpaceSweep>) -> Result<(), FormatError> {
        let (pose, is_located) = (StampedPose3::of_pose(update.stamp, update.map_from_robot), is_located(update));
        match self {
            Self::Tum(writer) if is_located => writer.write(&pose)?,
            Self::Tum(_) => {}
            Self::Csv(writer) => {
                write!(writer, "{:.6},{}", update.stamp.as_secs_f64(), u8::from(is_located))?;
                if is_located {
                    let at = update.map_from_robot.translation;
                    write!(writer, ",{:.4},{:.4},{:.4}", at.x, at.y, at.z)?;
                    let turn = update.map_from_robot.rotation;
                    write!(writer, ",{:.6},{:.6},{:.6},{:.6}", turn.i, turn.j, turn.k, turn.w)?;
                    for axis in 0..6 {
                        write!(writer, ",{:.5}", update.covariance[(axis, axis)].max(0.0).sqrt())?;
                    }
                } else {
                    write!(writer, "{}", ",".repeat(13))?;
                }
                let matched = update.matched.filter(|_| is_located);
                let share = matched.map(|matched| format!("{:.3}", matched.inlier_share)).unwrap_or_default();
                writeln!(writer, ",{share},{}", update.status.name())?;
            }
        }
        Ok(())
    }

    fn add(&mut self, update: &Update, location: Option<&Location>) -> Result<(), FormatError> {
        let (pose, is_located) = (update.map_from_robot, is_located(update));
        match self {
            Self::Tum(writer) if is_located => writer.write_planar(update.stamp, pose)?,
            Self::Tum(_) => {}
            Self::Csv(writer) => {
                write!(writer, "{:.6},{}", update.stamp.as_secs_f64(), u8::from(is_located))?;
                if is_located {
                    write!(writer, ",{:.4},{:.4},{:.5}", pose.x, pose.y, pose.theta)?;
                    for axis in 0..3 {
                        write!(writer, ",{:.5}", update.covariance[(axis, axis)].max(0.0).sqrt())?;
                    }
                } else {
                    write!(writer, ",,,,,,")?;
                }
                let matched = update.matched.filter(|_| is_located);
                let share = matched.map(|matched| format!("{:.3}", matched.inlier_share)).unwrap_or_default();
                let lead = location.map(|at| format!("{:.1}", at.nats - at.rival_nats)).unwrap_or_default();
                writeln!(writer, ",{share},{},{lead}", update.status.name())?;
            }
        }
        Ok(())
    }

    fn finish(self) -> Result<(), FormatError> {
        match self {
            Self::Csv(writer) => Ok(writer.flush()?),
            Self::Tum(writer) => writer.finish().map(|_| ()),
        }
    }
}
