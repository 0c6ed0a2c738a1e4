//! A robot in the plane.

use super::asking::Reply;
use super::drawer::{place_of, with_ending};
use super::work::{Answer, Driven, Played, Step, Work};
use crate::commands::map::{Finished, finish};
use crate::events::Ending;
use crate::failure::{Failure, Outcome};
use crate::mapping::Mapping;
use crate::reading::Reading as ReadingReport;
use crate::session::earlier_in_plane;
use crate::terminal::{count, say, say_json};
use mapwright::{Job, JobResult, Localisation, Mapper, Pose2, Session};
use mapwright_geom::Cov3;
use mapwright_live::node::asked::{Asked, PoseGiven, Said, Start, Why};
use mapwright_live::{Passed, Reading};
use mapwright_sensor::Sweep;
use nalgebra::{Rotation3, Vector3};
use serde_json::json;

/// What is done with scans.
pub(super) enum Plane {
    /// A map is made, and written down.
    Mapping(Box<Mapping>),
    /// A finished map says where the robot is.
    Localising(Box<Localising>),
}

/// A robot in a finished map.
pub(super) struct Localising {
    pub(super) mapper: Mapper,
    pub(super) scans: u64,
    pub(super) located: u64,
    /// Until the robot was located first, scans.
    pub(super) first: Option<u64>,
}

impl Plane {
    fn begin_anew(mapping: &mut Mapping, file: &str) -> Result<(), (Why, String)> {
        let path = place_of(mapping.output.folder(), file).map_err(|words| (Why::NoSuchFile, words))?;
        let path = with_ending(&path, "mapwright");
        if !path.exists() {
            return Err((Why::NoSuchFile, format!("there is no {}", path.display())));
        }
        // Wherever it is said to stand: it is found.
        earlier_in_plane(&path)
            .and_then(|(session, _)| mapping.begin_anew(Some(session)))
            .and_then(|()| mapping.switch_on())
            .map_err(|failure| (Why::Unreadable, failure.to_string()))
    }
}

impl Work for Plane {
    type Maps = Sweep;

    fn session(&self) -> &Session {
        match self {
            Self::Mapping(mapping) => mapping.session(),
            Self::Localising(localising) => localising.mapper.session(),
        }
    }

    fn newest(&self) -> &Session {
        match self {
            Self::Mapping(mapping) => mapping.mapper_session(),
            Self::Localising(localising) => localising.mapper.session(),
        }
    }

    fn is_made(&self) -> bool {
        matches!(self, Self::Mapping(_))
    }

    fn add(&mut self, passed: &Passed) -> Result<Option<Step<Sweep>>, Failure> {
        match (self, passed) {
            (Self::Mapping(mapping), Passed::Scan(scan)) => {
                let (update, written) = mapping.add_scan_live(scan);
                Ok(Some(Step { update, is_located: true, written }))
            }
            (Self::Localising(localising), Passed::Scan(scan)) => {
                let update = localising.mapper.add_scan(scan);
                let is_located = update.localisation == Localisation::Joined
                    && localising.mapper.location().is_none_or(|location| location.is_located);
                localising.scans += 1;
                localising.located += u64::from(is_located);
                if is_located && localising.first.is_none() {
                    localising.first = Some(localising.scans);
                }
                Ok(Some(Step { update, is_located, written: Ok(()) }))
            }
            (Self::Mapping(mapping), Passed::Reading(Reading::Odometry(odometry))) => {
                mapping.add_odometry(odometry, 0).map(|()| None)
            }
            (Self::Localising(localising), Passed::Reading(Reading::Odometry(odometry))) => {
                localising.mapper.add_odometry(odometry);
                Ok(None)
            }
            (Self::Mapping(mapping), Passed::Reading(Reading::Turning(rate))) => {
                mapping.add_turn_rate(rate);
                Ok(None)
            }
            (Self::Localising(localising), Passed::Reading(Reading::Turning(rate))) => {
                localising.mapper.add_turn_rate(rate);
                Ok(None)
            }
            (_, Passed::Cloud(_) | Passed::Reading(Reading::InSpace(_))) => Ok(None),
        }
    }

    fn next_job(&mut self) -> Option<Job> {
        match self {
            Self::Mapping(mapping) => mapping.next_job(),
            Self::Localising(localising) => localising.mapper.next_job(),
        }
    }

    fn apply(&mut self, result: JobResult) -> Option<Step<Sweep>> {
        match self {
            Self::Mapping(mapping) => {
                let (update, written) = mapping.apply(result);
                Some(Step { update, is_located: true, written })
            }
            Self::Localising(localising) => {
                localising.mapper.apply(result);
                None
            }
        }
    }

    fn answer(&mut self, asked: Asked, frame: &str) -> Answer {
        let refused = |why, words: &str| Answer::Reply(Reply::refused(why, words));
        match (asked, self) {
            (Asked::Reset { .. }, Self::Mapping(mapping)) => {
                mapping.begin_anew(None).map_err(|failure| (Why::Other, failure.to_string())).into()
            }
            (Asked::Deserialize { start: Start::LocaliseFrom { .. }, .. }, Self::Mapping(_)) => {
                refused(Why::WrongMode, "to be found in a finished map, start with --localise")
            }
            (Asked::Deserialize { file, .. }, Self::Mapping(mapping)) => Self::begin_anew(mapping, &file).into(),
            (Asked::FindAnew, Self::Localising(localising)) => {
                localising.mapper.find_anew();
                Answer::Reply(Reply::Said(Said::Done))
            }
            (Asked::SetPose(given), Self::Localising(localising)) => {
                if !given.frame.is_empty() && given.frame != frame {
                    return refused(Why::Other, &format!("expected a pose in {frame}, found one in {}", given.frame));
                }
                let (map_from_robot, covariance) = in_the_plane(&given);
                match localising.mapper.place(map_from_robot, covariance) {
                    true => Answer::Reply(Reply::Said(Said::Done)),
                    false => refused(Why::Other, "expected a pose with a covariance, found none"),
                }
            }
            (Asked::LoadMap { .. } | Asked::Reset { .. } | Asked::Deserialize { .. }, Self::Localising(_)) => {
                refused(Why::WrongMode, "the finished map stays as it is; start again with another one")
            }
            (Asked::FindAnew | Asked::SetPose(_) | Asked::LoadMap { .. }, Self::Mapping(_)) => {
                refused(Why::WrongMode, "a map is being made; to be found in a finished one, start with --localise")
            }
            _ => refused(Why::Other, "that is not offered"),
        }
    }

    fn finish(self, driven: Driven<'_>) -> Result<Outcome, Failure> {
        let Driven { args, played, mut losses, is_interrupted, .. } = driven;
        match self {
            Self::Mapping(mut mapping) => {
                mapping.end_of_scans()?;
                mapping.earlier_losses.append(&mut losses);
                let ending = if played.is_some() && is_interrupted { Ending::Interrupted } else { Ending::OfLog };
                let (name, read) = match played {
                    Some((name, Played::Plane(read))) => (name, *read),
                    Some((name, Played::Space(_))) => (name, ReadingReport::default()),
                    None => ("live".to_owned(), ReadingReport::default()),
                };
                let voice = args.mapping.voice;
                finish(*mapping, Finished { name, read, ending, output: &args.output, voice })
            }
            Self::Localising(localising) => localising.finish(&driven.arrived, losses, args.mapping.voice),
        }
    }
}

impl Localising {
    fn finish(&self, arrived: &[String], losses: Vec<String>, voice: crate::args::Voice) -> Result<Outcome, Failure> {
        let Self { scans, located, first, .. } = self;
        if voice.json {
            say_json(&json!({ "scans": scans, "located": located, "first_located": first, "losses": losses }))?;
        } else if !voice.quiet {
            let first =
                first.map_or("never located".to_owned(), |first| format!("first after {}", count(first, "scan")));
            say(&format!("located  {located} of {}, {first}\n", count(*scans, "scan")))?;
            say(&format!("arrived  {}\n", arrived.join("; ")))?;
        }
        Ok(Outcome::of_losses(&losses))
    }
}

/// What a pose in space says of a robot in the plane, with the covariance in the robot's axes.
fn in_the_plane(given: &PoseGiven) -> (Pose2, Cov3) {
    let pose = given.frame_from_robot;
    let theta = pose.rotation.euler_angles().2;
    let entry = |row: usize, column: usize| given.covariance[6 * row + column];
    let places = [0, 1, 5];
    let in_map = Cov3::from_fn(|row, column| entry(places[row], places[column]));
    let turned = Rotation3::from_axis_angle(&Vector3::z_axis(), theta);
    let covariance = turned.matrix().transpose() * in_map * turned.matrix();
    (Pose2::new(pose.translation.x, pose.translation.y, theta), covariance)
}
