//! Robots of one team in one process, and the simulated air between them.

use crate::failure::Failure;
use crate::liar::{Liar, falsify_found};
use mapwright::{Mapper, Pose2, RunId, Session, Settings, Stamp, Update};
use mapwright_fleet::{Chain, ChainId, Kind, Node, NodeSettings, Roster, RosterError, Secret, Team};
use mapwright_sim::{Radio, RadioSettings, Rng};
use std::time::{Duration, Instant};

/// A robot: its own mapper, and its part in the team.
pub(crate) struct Robot {
    pub(crate) name: String,
    pub(crate) mapper: Mapper,
    pub(crate) team: Team,
    pub(crate) is_alive: bool,
    /// Time that its own map takes, and what it does for the team; elapsed, so that other work on the computer counts too.
    pub(crate) mapped: Duration,
    pub(crate) shared: Duration,
    /// What it tells is not what it has mapped.
    pub(crate) liar: Option<Liar>,
    /// When its own map and that of the team became one, seconds.
    pub(crate) joined_s: Option<f64>,
}

impl Robot {
    pub(crate) fn is_honest(&self) -> bool {
        self.liar.is_none()
    }
}

/// Robots and the air.
pub(crate) struct Simulated {
    pub(crate) robots: Vec<Robot>,
    pub(crate) radio: Radio,
    /// The first so many do not hear the others between these times, seconds.
    pub(crate) split: Option<(usize, [f64; 2])>,
    /// Who hears whom, by their numbers; all hear all where it is empty.
    pub(crate) reach: Vec<Vec<bool>>,
}

/// Robots hear and work so often, and are asked so often whether their maps are one, seconds.
pub(crate) const STEP_S: f64 = 0.1;
const JOINS_EVERY_S: f64 = 5.0;

/// Keyframes that the robot that solves takes in at a time.
const KEYFRAMES_AT_ONCE: usize = 256;

impl Simulated {
    pub(crate) fn new(names: &[String], settings: Settings, radio: RadioSettings) -> Result<Self, Failure> {
        let secrets: Vec<Secret> = (0..names.len()).map(|k| secret(radio.seed, k)).collect();
        let roster = || roster(names, &secrets);
        let robot = |(name, secret): (&String, &Secret)| {
            let roster = roster().map_err(|cause| Failure::Usage(cause.to_string()))?;
            let node = Node::new(NodeSettings::default(), roster, name, secret.clone(), 0);
            let node = node.ok_or_else(|| Failure::Usage(format!("expected {name} in the team")))?;
            let mapper = Mapper::of_run(settings, RunId::of_robot(name), Pose2::IDENTITY)?;
            Ok(Robot {
                name: name.clone(),
                mapper,
                team: Team::new(node, settings)?,
                is_alive: true,
                liar: None,
                mapped: Duration::ZERO,
                shared: Duration::ZERO,
                joined_s: None,
            })
        };
        let robots = names.iter().zip(&secrets).map(robot).collect::<Result<_, Failure>>()?;
        Ok(Self { robots, radio: Radio::new(radio), split: None, reach: Vec::new() })
    }

    /// A robot's mapper is told something, and tells the team.
    pub(crate) fn map(&mut self, robot: usize, now: Stamp, tell: impl FnOnce(&mut Mapper) -> Option<Update>) {
        let Some(robot) = self.robots.get_mut(robot).filter(|robot| robot.is_alive) else { return };
        let begin = Instant::now();
        let update = tell(&mut robot.mapper);
        robot.mapped += begin.elapsed();
        let begin = Instant::now();
        if let Some(update) = update {
            let told =
                robot.liar.as_mut().map(|liar| liar.tell(now.secs_since(Stamp(0)), &update, robot.mapper.session()));
            robot.team.tell(now, &told.unwrap_or(update));
        }
        robot.shared += begin.elapsed();
    }

    /// All say what they have to say, hear what has arrived, and work; whether anyone had something to do.
    pub(crate) fn step(&mut self, now: Stamp, seconds: f64) -> bool {
        let side = |split: Option<(usize, [f64; 2])>, robot: usize| {
            split.is_some_and(|(first, [from, to])| (from..to).contains(&seconds) && robot < first)
        };
        for robot in &mut self.robots {
            if robot.liar.as_ref().is_some_and(|liar| liar.falsifies_solution(seconds)) {
                robot.team.falsify(falsify_found);
            }
            if robot.liar.as_ref().is_some_and(|liar| liar.outbids(seconds)) {
                robot.team.outbid();
            }
        }
        for from in 0..self.robots.len() {
            let robot = &mut self.robots[from];
            if !robot.is_alive {
                continue;
            }
            for out in robot.team.poll(now) {
                for to in (0..self.robots.len()).filter(|to| *to != from) {
                    let rank = self.robots[to].team.node().me().rank;
                    if out.to.is_none_or(|wanted| wanted == rank) {
                        let hears = self.reach.get(from).is_none_or(|hear| hear[to]);
                        let is_in_reach = hears && side(self.split, from) == side(self.split, to);
                        self.radio.send(now, to, &out.bytes, is_in_reach);
                    }
                }
            }
        }
        for arrival in self.radio.receive(now) {
            if let Some(robot) = self.robots.get_mut(arrival.to).filter(|robot| robot.is_alive) {
                let begin = Instant::now();
                robot.team.receive(now, &arrival.bytes);
                robot.shared += begin.elapsed();
            }
        }
        let mut has_worked = false;
        for robot in self.robots.iter_mut().filter(|robot| robot.is_alive) {
            let begin = Instant::now();
            has_worked |= robot.team.work(now, KEYFRAMES_AT_ONCE);
            robot.shared += begin.elapsed();
        }
        has_worked
    }

    /// Notes whose maps have become one with others', every five seconds.
    pub(crate) fn note_joins(&mut self, seconds: f64) {
        for robot in &mut self.robots {
            let is_one = || robot.team.map().is_some_and(|map| map.runs().len() > 2 && map.pieces().len() == 1);
            if robot.joined_s.is_none() && (seconds % JOINS_EVERY_S) < STEP_S && is_one() {
                robot.joined_s = Some(seconds);
            }
        }
    }

    /// Who lives and does not lie.
    fn honest(&self) -> Vec<&Robot> {
        self.robots.iter().filter(|robot| robot.is_alive && robot.is_honest()).collect()
    }

    /// Whether all who live and do not lie hold all records of what was mapped that any of them holds.
    pub(crate) fn holds_all(&self) -> bool {
        let mapped = |robot: &&Robot| -> Vec<(ChainId, usize)> {
            let of = |chain: &Chain| chain.records().iter().filter(|record| record.kind == Kind::Entries).count();
            let counts = robot.team.node().chains().iter().map(|(id, chain)| (*id, of(chain)));
            counts.filter(|(_, count)| *count > 0).collect()
        };
        let held: Vec<_> = self.honest().iter().map(mapped).collect();
        held.windows(2).all(|pair| pair[0] == pair[1])
    }

    /// Whether they have the same map as well, and have looked at it again.
    pub(crate) fn is_agreed(&self) -> bool {
        self.honest().iter().all(|robot| robot.team.has_audited()) && self.has_one_map()
    }

    /// Whether all who live and do not lie have the same map, to the byte, and all that any of them has mapped is in it.
    pub(crate) fn has_one_map(&self) -> bool {
        let honest = self.honest();
        let maps: Option<Vec<&Session>> = honest.iter().map(|robot| robot.team.map()).collect();
        let Some((maps, first)) = maps.and_then(|maps| Some((maps.clone(), *maps.first()?))) else { return false };
        let has_all =
            |robot: &&Robot| robot.mapper.keyframes().last().is_none_or(|last| first.place(last.id).is_some());
        let is_counted = |other: &&Session| {
            (other.keyframes().len(), other.recorded_edges().len(), other.corrections())
                == (first.keyframes().len(), first.recorded_edges().len(), first.corrections())
        };
        honest.iter().all(has_all)
            && maps.iter().all(is_counted)
            && maps.iter().skip(1).all(|map| map.encode() == first.encode())
    }
}

fn secret(seed: u64, robot: usize) -> Secret {
    let mut rng = Rng::keyed(seed, robot as u64);
    let mut bytes = [0; 32];
    bytes.chunks_mut(8).for_each(|chunk| chunk.copy_from_slice(&rng.next_u64().to_le_bytes()));
    Secret::from_bytes(&bytes)
}

fn roster(names: &[String], secrets: &[Secret]) -> Result<Roster, RosterError> {
    Roster::new(names.iter().cloned().zip(secrets.iter().map(Secret::public)))
}
