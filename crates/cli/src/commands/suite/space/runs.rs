//! `mapwright suite localise --3d` and `cut`: a robot in a building that is mapped, and a drive in three pieces.

use super::super::Measure;
use super::super::floors::{Floor, Number, stats, stats_in_words};
use super::super::localise::{NOTHING, Witness, World as Located, error, summary};
use super::{Drives, EVERY, Kind, WORLDS};
use crate::failure::Failure;
use crate::simulated::{Simulated, Taken};
use mapwright::{Localisation, Pose3, Session, SpaceMapper, SpaceSweep, Update};
use mapwright_sim::space::SpaceSite;
use nalgebra::Vector3;
use serde::Serialize;
use serde_json::{Value, json};
use std::convert::Infallible;

/// How long a robot is looked at, seconds, and in what time it should know where it is.
const LATER_S: f64 = 25.0;
const LOCATED_WITHIN_S: f64 = 10.0;
/// A waypoint was reached where a keyframe is so near, metres.
const REACHED_M: f64 = 2.0;
/// Places in each building at which a robot is put down, within such a share of the way from either end.
const PLACES: usize = 5;
const BEGIN_SHARE: f64 = 0.7;
/// Beside the whole drive's error that of its pieces, joined.
const MOST_RATIO: f64 = 1.3;
const PIECES: usize = 3;

/// Where there is no other storey that looks the same first; then where there are.
const LATER_WORLDS: [Kind; 3] = [WORLDS[0], WORLDS[1], WORLDS[2]];

pub(in super::super) struct Localise(pub(in super::super) Drives);

/// Robots put down in one building that is mapped.
#[derive(Debug, Serialize)]
pub(in super::super) struct Building {
    robots: Vec<Located>,
}

impl Measure for Localise {
    type World = Building;
    const NAME: &'static str = "localise";
    const FILES: [&'static str; 2] = ["localise.jsonl", "localise.json"];

    fn world(&self, seed: u64) -> Result<Building, Failure> {
        let (kind, site) = LATER_WORLDS[(seed % LATER_WORLDS.len() as u64) as usize];
        let site = site(seed);
        let map = Simulated::map_space(&self.0.drive(site.clone(), seed), EVERY, &self.0.settings, |_, _, _| {})?;
        let way = known_way(&site, &map);
        let twice = if kind == LATER_WORLDS[2].0 { kind } else { NOTHING };
        let robots = (0..PLACES).map(|place| self.put_down(&site, &map, (&way, place), (seed, twice)));
        Ok(Building { robots: robots.collect::<Result<_, _>>()? })
    }

    fn line(world: &Building) -> String {
        world.robots.iter().map(Located::line).collect::<Vec<_>>().join("\n")
    }

    fn summary(&self, worlds: &[Building]) -> (String, Value, Vec<Floor>) {
        let robots = || worlds.iter().flat_map(|world| &world.robots);
        let (words, value) = summary(robots());
        let in_time = robots().filter(|robot| robot.located_s.is_some_and(|s| s <= LOCATED_WITHIN_S)).count();
        let floors = vec![
            Floor::none(
                "no robot located wrongly for more than 5 s",
                robots().filter(|robot| robot.is_wrong()).count(),
            ),
            Floor::share("90 % located within 10 s", 0.9, in_time, robots().count()),
        ];
        (words, value, floors)
    }
}

impl Localise {
    /// A robot that is put down on a way that was driven before, and drives on along it; every other one the other way around.
    fn put_down(
        &self,
        site: &SpaceSite,
        map: &Simulated<SpaceSweep>,
        (way, place): (&[[f64; 3]], usize),
        (seed, twice): (u64, &'static str),
    ) -> Result<Located, Failure> {
        let number = seed * PLACES as u64 + place as u64;
        let mut waypoints = way.to_vec();
        if number % 2 == 1 {
            waypoints.reverse();
        }
        // Of a fraction that turns evenly over the numbers: any place is as likely.
        let share = BEGIN_SHARE * (number as f64 * 0.618_033_988_75).fract();
        let site = SpaceSite { waypoints: from_share(&waypoints, share), ..site.clone() };
        let later = Drives { duration_s: LATER_S, ..self.0 };
        let later = later.drive(site, number + 1_000_000);
        let mut mapper = SpaceMapper::localising(self.0.settings, map.session().clone())?;
        let (mut witness, mut was_located) = (Witness::default(), false);
        for cloud in (0..).step_by(EVERY) {
            let Some(taken) = later.cloud(cloud) else { break };
            let update = mapper.add_cloud(&taken.cloud);
            let is_located = update.localisation == Localisation::Joined;
            let error = error(map, update.map_from_robot, taken.world_from_robot);
            witness.see(&update, error, was_located && !is_located);
            was_located = is_located;
        }
        Ok(witness.world(seed, twice))
    }
}

/// The waypoints that were passed, and where the drive ended.
fn known_way(site: &SpaceSite, map: &Simulated<SpaceSweep>) -> Vec<[f64; 3]> {
    let (mut way, mut passed) = (Vec::<[f64; 3]>::new(), 0);
    for waypoint in &site.waypoints {
        let away_m = |k: &usize| (map.truth(*k).translation - Vector3::from(*waypoint)).norm();
        let Some(reached) = (passed..map.keyframe_count()).find(|k| away_m(k) <= REACHED_M) else { break };
        passed = reached;
        way.push(*waypoint);
    }
    way.extend((0..map.keyframe_count()).last().map(|last| <[f64; 3]>::from(map.truth(last).translation)));
    way
}

/// A way from such a share of its length on.
fn from_share(way: &[[f64; 3]], share: f64) -> Vec<[f64; 3]> {
    let length_m = |leg: &[[f64; 3]]| (Vector3::from(leg[1]) - Vector3::from(leg[0])).norm();
    let mut left_m = share * way.windows(2).map(length_m).sum::<f64>();
    for (after, leg) in way.windows(2).enumerate() {
        if left_m < length_m(leg) {
            let begin = Vector3::from(leg[0]).lerp(&Vector3::from(leg[1]), left_m / length_m(leg));
            return std::iter::once(begin.into()).chain(way[after + 1..].iter().copied()).collect();
        }
        left_m -= length_m(leg);
    }
    way.to_vec()
}

pub(in super::super) struct Cut(pub(in super::super) Drives);

#[derive(Debug, Serialize)]
pub(in super::super) struct World {
    seed: u64,
    building: &'static str,
    clouds: usize,
    /// Maps that the pieces make.
    maps: usize,
    joins: usize,
    /// Of all clouds.
    whole_ate_m: f64,
    ate_m: f64,
    ratio: f64,
}

impl Measure for Cut {
    type World = World;
    const NAME: &'static str = "cut";
    const FILES: [&'static str; 2] = ["cut.jsonl", "cut.json"];

    fn world(&self, seed: u64) -> Result<World, Failure> {
        let (building, site) = WORLDS[(seed % WORLDS.len() as u64) as usize];
        let failure = |reason: String| Failure::World { name: format!("{building}, seed {seed}"), reason };
        let drive = self.0.drive(site(seed), seed);
        let mut scans: Vec<Taken<Pose3>> = Vec::new();
        let mut clouds = Vec::new();
        let whole = {
            let mut mapper = SpaceMapper::new(self.0.settings)?;
            for number in (0..).step_by(EVERY) {
                let Some(taken) = drive.cloud(number) else { break };
                scans.push(Taken::of_cloud(&drive, &taken, &scans));
                mapper.add_cloud(&taken.cloud);
                clouds.push(number);
            }
            Simulated::of(mapper.session().clone(), scans.clone())
        };
        let mut merged: Option<SpaceMapper> = None;
        for piece in clouds.chunks(clouds.len().div_ceil(PIECES).max(1)) {
            let mut mapper = SpaceMapper::new(self.0.settings)?;
            piece.iter().filter_map(|&number| drive.cloud(number)).for_each(|taken| {
                mapper.add_cloud(&taken.cloud);
            });
            match &mut merged {
                None => merged = Some(SpaceMapper::resume(self.0.settings, mapper.session().clone())?),
                Some(merged) => import(merged, mapper.session()),
            }
        }
        let session = merged.map_or_else(Session::default, |merged| merged.session().clone());
        let joins = session.edges().filter(|edge| edge.from.run() != edge.to.run()).count();
        let maps = session.maps().len();
        let merged = Simulated::of(session, scans);
        let ate = |of: &Simulated<SpaceSweep>| of.trajectory_ate_m().map_err(|cause| failure(cause.to_string()));
        let (whole_ate_m, ate_m) = (ate(&whole)?, ate(&merged)?);
        Ok(World { seed, building, clouds: clouds.len(), maps, joins, whole_ate_m, ate_m, ratio: ate_m / whole_ate_m })
    }

    fn line(world: &World) -> String {
        let World { seed, building, clouds, maps, joins, whole_ate_m, ate_m, ratio } = world;
        format!(
            "{seed:6}  {building:18}  {clouds:5} clouds  maps of {PIECES} drives: {maps}, {joins:3} edges between them  \
             ATE {ate_m:6.3} m, of the whole drive {whole_ate_m:6.3} m, ratio {ratio:5.2}"
        )
    }

    fn summary(&self, worlds: &[World]) -> (String, Value, Vec<Floor>) {
        let joined: Vec<&World> = worlds.iter().filter(|world| world.maps == 1).collect();
        let rows: [Number<&World>; 2] = [("ATE", " m", |w| w.ate_m), ("ratio", "", |w| w.ratio)];
        let close = joined.iter().filter(|world| world.ratio <= MOST_RATIO).count();
        let [ate, ratio] = rows.map(|(_, _, pick)| stats(&joined, pick));
        let value = json!({
            "joined": joined.len(),
            "ate_m_mean": ate.map(|stats| stats.mean),
            "ratio_mean": ratio.map(|stats| stats.mean),
            "ratio_worst": ratio.map(|stats| stats.max),
        });
        let floors = vec![
            Floor::share("one map of every drive", 1.0, joined.len(), worlds.len()),
            Floor::share("ratio at most 1.3 in every world", 1.0, close, worlds.len()),
        ];
        (stats_in_words(&joined, &rows), value, floors)
    }
}

/// One after the other, as `mapwright merge` does.
fn import(mapper: &mut SpaceMapper, session: &Session<SpaceSweep>) {
    let told = |_: Update<SpaceSweep>| Ok::<(), Infallible>(());
    let Ok(()) = mapper.import(session, told);
}
