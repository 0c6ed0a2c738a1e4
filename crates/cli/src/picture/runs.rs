//! The runs of a session that have keyframes.

use mapwright::{RunId, Session};
use mapwright_geom::Pose;
use mapwright_record::Measurement;
use serde_json::Value;
use std::collections::BTreeMap;

/// What robots, and the logs of a session, are called.
#[derive(Debug, Clone, Default)]
pub(crate) struct RunNames {
    /// With their places among all, from one on.
    robots: BTreeMap<u128, (usize, String)>,
    /// Logs by the places of their first keyframes.
    logs: BTreeMap<usize, String>,
}

impl RunNames {
    /// Of robots.
    pub(crate) fn of_robots<'a>(names: impl IntoIterator<Item = &'a str>) -> Self {
        let robot = |(label, name): (usize, &str)| (RunId::of_robot(name).robot, (label + 1, name.to_owned()));
        let robots = names.into_iter().enumerate().map(robot).collect();
        Self { robots, logs: BTreeMap::new() }
    }

    /// Of logs, each with the place of its first keyframe.
    pub(crate) fn of_logs<'a>(logs: impl IntoIterator<Item = (&'a str, usize)>) -> Self {
        let short = |name: &str| name.rsplit('/').find(|part| !part.is_empty()).unwrap_or(name).to_owned();
        let logs = logs.into_iter().map(|(name, first)| (first, short(name))).collect();
        Self { robots: BTreeMap::new(), logs }
    }

    /// As the report of a folder of results has them.
    pub(crate) fn of_report(report: &Value) -> Self {
        let list = |key: &str| report[key].as_array().map_or(&[][..], Vec::as_slice);
        let mut first = 0;
        let log = |part: &'_ Value| {
            let begins = first;
            first += part["keyframes"].as_u64().unwrap_or(0) as usize;
            Some((part["name"].as_str()?.to_owned(), begins))
        };
        let logs: Vec<(String, usize)> = list("parts").iter().filter_map(log).collect();
        let logs = Self::of_logs(logs.iter().map(|(name, first)| (name.as_str(), *first)));
        let robots = Self::of_robots(list("robots").iter().filter_map(|robot| robot["name"].as_str()));
        Self { logs: logs.logs, ..robots }
    }

    /// The label and the name of a run by its number, from zero, its id and the places of its first and last keyframes.
    fn name(&self, number: usize, id: RunId, [first, last]: [usize; 2]) -> (usize, String) {
        let log = self.logs.range(..=first).next_back();
        // One of several runs of a log, or of a session that was merged, has no name of its own.
        let log = log.filter(|(begins, _)| **begins == first && self.logs.range(first + 1..=last).next().is_none());
        let robot = self.robots.get(&id.robot).map(|(label, name)| match id.session {
            0 => (*label, name.clone()),
            again => (*label, format!("{name}, {}", again + 1)),
        });
        let log = || log.map_or_else(|| format!("run {}", number + 1), |(_, name)| name.clone());
        robot.unwrap_or_else(|| (number + 1, log()))
    }
}

/// A run that has keyframes.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct RunShown<P> {
    /// Its place among those in the order in which they come, from zero: its colour.
    pub(crate) number: usize,
    /// What it is marked with: a robot's place in its team, or else the same from one on.
    pub(crate) label: usize,
    pub(crate) name: String,
    pub(crate) keyframes: usize,
    /// The robot at each of its scans, or at each keyframe where no scans were recorded, with the place of the keyframe that it follows. Between
    /// two lines nobody knows how it went.
    pub(crate) lines: Vec<Vec<(usize, P)>>,
}

impl<P: Pose> RunShown<P> {
    /// Length of the way, metres.
    pub(crate) fn length_m(&self) -> f64 {
        let steps = self.lines.iter().flat_map(|line| line.windows(2));
        steps.map(|pair| pair[0].1.between(pair[1].1).length()).sum()
    }
}

/// The numbers of runs by the places of their keyframes: in the order in which they come, those without keyframes left out.
pub(crate) fn runs<M: Measurement>(session: &Session<M>) -> Vec<usize> {
    let mut known: Vec<RunId> = Vec::new();
    let mut number = |id: RunId| {
        known.iter().position(|run| *run == id).unwrap_or_else(|| {
            known.push(id);
            known.len() - 1
        })
    };
    session.keyframes().iter().map(|keyframe| number(keyframe.id.run())).collect()
}

/// All runs of a session; none where there are not several.
pub(crate) fn of_several<M: Measurement>(session: &Session<M>, names: &RunNames) -> Option<Vec<RunShown<M::Pose>>> {
    let numbers = runs(session);
    let count = numbers.iter().max().map_or(0, |last| last + 1);
    if count < 2 {
        return None;
    }
    let breaks = session.fragments().iter().filter(|fragment| session.is_break(fragment));
    let breaks: Vec<usize> = breaks.filter_map(|fragment| session.place(fragment.first)).collect();
    let mut at: Vec<Vec<(usize, M::Pose)>> = vec![Vec::new(); count];
    for (scan, pose) in session.scans().iter().zip(session.trajectory()) {
        let place = scan.keyframe.and_then(|id| session.place(id));
        if let Some(place) = place {
            at[numbers[place]].push((place, pose.map_from_robot));
        }
    }
    let run = |(number, scans): (usize, Vec<(usize, M::Pose)>)| {
        let own: Vec<usize> = (0..numbers.len()).filter(|place| numbers[*place] == number).collect();
        let own_breaks: Vec<usize> = breaks.iter().copied().filter(|place| numbers[*place] == number).collect();
        let part = |place: usize| own_breaks.iter().filter(|first| **first <= place).count();
        let poses = session.map_from_keyframe();
        let keyframes = || own.iter().map(|place| (*place, poses[*place])).collect();
        let way: Vec<(usize, M::Pose)> = if scans.is_empty() { keyframes() } else { scans };
        let ends = [own.first(), own.last()].map(|end| end.copied().unwrap_or(0));
        let (label, name) = names.name(number, session.keyframes()[ends[0]].id.run(), ends);
        RunShown {
            number,
            label,
            name,
            keyframes: own.len(),
            lines: way.chunk_by(|a, b| part(a.0) == part(b.0)).map(<[_]>::to_vec).collect(),
        }
    };
    let mut shown: Vec<RunShown<M::Pose>> = at.into_iter().enumerate().map(run).collect();
    shown.sort_by_key(|run| run.label);
    Some(shown)
}
