//! What pictures and pages show of a session of several runs, such as those of robots that share a map: a colour each, and who met whom where.

mod meetings;
mod runs;

pub(crate) use meetings::{Meeting, meetings};
pub(crate) use runs::{RunNames, RunShown, of_several, runs};

use mapwright::{Pose2, SeparateMap, Session};
use mapwright_formats::RunWay;

/// What the picture of one of a session's maps shows of its runs.
pub(crate) struct MapOfRuns {
    pub(crate) ways: Vec<RunWay>,
    pub(crate) meetings: Vec<([usize; 2], [f64; 2])>,
}

impl MapOfRuns {
    /// None where the session has one run.
    pub(crate) fn of(session: &Session, map: &SeparateMap, names: &RunNames) -> Option<Self> {
        let all = of_several(session, names)?;
        let way = |run: RunShown<Pose2>| {
            let lines = run.lines.iter().flat_map(|line| line.chunk_by(|a, b| map.has(a.0) == map.has(b.0)));
            let lines = lines.filter(|line| map.has(line[0].0));
            let lines = lines.map(|line| line.iter().map(|(_, pose)| *pose).collect()).collect();
            RunWay { number: run.number, label: run.label, name: run.name, lines }
        };
        let ways = all.into_iter().map(way).filter(|way| !way.lines.is_empty()).collect();
        let met = meetings(session).into_iter().filter(|met| met.keyframes.iter().all(|place| map.has(*place)));
        let meetings = met.map(|met| (met.runs, met.place(session))).collect();
        Some(Self { ways, meetings })
    }
}
