//! `mapwright suite localise`

use super::Measure;
use super::floors::{Floor, percent, stats};
use crate::failure::Failure;
use crate::simulated::{PoseError, Scored, Simulated};
use mapwright::{Localisation, Mapper, Settings, Stamp, Status, Update};
use mapwright_geom::Pose;
use mapwright_record::Measurement;
use mapwright_sim::Event;
use mapwright_sim::worlds::{TwiceTheSame, relocalisation};
use serde::Serialize;
use serde_json::{Value, json};

/// A robot that is located wrongly for longer has not noticed, seconds.
const NOTICED_WITHIN_S: f64 = 5.0;

pub(super) struct Localise {
    pub(super) settings: Settings,
}

/// A robot that was put down somewhere in a building that is mapped.
#[derive(Debug, Serialize)]
pub(super) struct World {
    seed: u64,
    /// What there is twice in the building.
    twice: &'static str,
    scans: usize,
    /// Seconds until the robot was located rightly; none where it never was.
    pub(super) located_s: Option<f64>,
    /// Whether it is, rightly, at the end.
    located: bool,
    /// Seconds in which it was located wrongly, in all and at a stretch.
    wrong_s: f64,
    longest_wrong_s: f64,
    /// Times that a finding was taken back, and those of them that were right.
    withdrawn: usize,
    withdrawn_rightly_located: usize,
    /// Mean error of the poses while it was located rightly, metres.
    error_m: Option<f64>,
}

impl Measure for Localise {
    type World = World;
    const NAME: &'static str = "localise";
    const FILES: [&'static str; 2] = ["localise.jsonl", "localise.json"];

    fn world(&self, seed: u64) -> Result<World, Failure> {
        let case = relocalisation(seed);
        let map = Simulated::map(case.mapping_drive(), &self.settings)?;
        let mut mapper = Mapper::localising(self.settings, map.session().clone())?;
        let mut witness = Witness::default();
        for event in case.later_drive() {
            match event {
                Event::Odometry(odometry) => mapper.add_odometry(&odometry),
                Event::Scan(scan) => {
                    let update = mapper.add_scan(&scan.scan);
                    let error = error(&map, update.map_from_robot, scan.world_from_robot);
                    witness.see(&update, error, mapper.withdrawal().is_some());
                }
            }
        }
        let twice = match case.twice {
            TwiceTheSame::Nothing => NOTHING,
            TwiceTheSame::EndsOfRoom => "ends of a room",
            TwiceTheSame::Rooms => "rooms",
            TwiceTheSame::Wings => "wings",
        };
        Ok(witness.world(seed, twice))
    }

    fn line(world: &World) -> String {
        world.line()
    }

    fn summary(&self, worlds: &[World]) -> (String, Value, Vec<Floor>) {
        let (words, value) = summary(worlds.iter());
        let located = worlds.iter().filter(|world| world.located).count();
        let floors = vec![
            Floor::none(
                "no robot located wrongly for more than 5 s",
                worlds.iter().filter(|world| world.is_wrong()).count(),
            ),
            Floor::share("95 % located at the end", 0.95, located, worlds.len()),
        ];
        (words, value, floors)
    }
}

/// What a building has only once.
pub(super) const NOTHING: &str = "nothing";

impl World {
    /// Whether the robot took itself to be elsewhere for longer than it may.
    pub(super) fn is_wrong(&self) -> bool {
        self.longest_wrong_s > NOTICED_WITHIN_S
    }

    pub(super) fn line(&self) -> String {
        let located = self.located_s.map_or("   never".to_owned(), |s| format!("{s:6.1} s"));
        let error = self.error_m.map_or("      -".to_owned(), |m| format!("{m:.3} m"));
        format!(
            "{:6}  twice {:14}  located {located}, at the end {:3}  wrong {:5.1} s, {:5.1} at a stretch  taken back {} ({} right)  error {error}",
            self.seed,
            self.twice,
            if self.located { "yes" } else { "NO" },
            self.wrong_s,
            self.longest_wrong_s,
            self.withdrawn,
            self.withdrawn_rightly_located,
        )
    }
}

/// The last lines over all worlds, and the same for programs.
pub(super) fn summary<'a>(worlds: impl Iterator<Item = &'a World>) -> (String, Value) {
    let worlds: Vec<&World> = worlds.collect();
    let mut words = String::new();
    let mut value = serde_json::Map::new();
    let of = |twice: bool| worlds.iter().copied().filter(|world| (world.twice != NOTHING) == twice).collect();
    let groups: [(&str, Vec<&World>); 3] =
        [("all", worlds.clone()), ("ordinary", of(false)), ("two places alike", of(true))];
    for (what, worlds) in groups {
        let group = Group::of(&worlds);
        words += &group.line(what);
        value.insert(what.into(), json!(group));
    }
    (words, json!({ "groups": value }))
}

/// Sums over some worlds.
#[derive(Debug, Serialize)]
struct Group {
    worlds: usize,
    located: usize,
    wrong: usize,
    wrong_at_all: usize,
    withdrawn: usize,
    withdrawn_rightly_located: usize,
    median_located_s: Option<f64>,
}

impl Group {
    fn of(worlds: &[&World]) -> Self {
        let count = |is: fn(&World) -> bool| worlds.iter().filter(|world| is(world)).count();
        let sum = |pick: fn(&World) -> usize| worlds.iter().map(|world| pick(world)).sum();
        let located_s: Vec<f64> = worlds.iter().filter_map(|world| world.located_s).collect();
        Self {
            worlds: worlds.len(),
            located: count(|world| world.located),
            wrong: count(World::is_wrong),
            wrong_at_all: count(|world| world.wrong_s > 0.0),
            withdrawn: sum(|world| world.withdrawn),
            withdrawn_rightly_located: sum(|world| world.withdrawn_rightly_located),
            median_located_s: stats(&located_s, |s| *s).map(|stats| stats.median),
        }
    }

    fn line(&self, what: &str) -> String {
        let median = self.median_located_s.map_or("-".to_owned(), |s| format!("{s:.1} s"));
        format!(
            "{what:16}  located {}, median {median}; wrongly for more than 5 s {} ({} at all); taken back {} ({} of them right)\n",
            percent(self.located, self.worlds),
            self.wrong,
            self.wrong_at_all,
            self.withdrawn,
            self.withdrawn_rightly_located,
        )
    }
}

/// Error of a pose relative to the keyframe of the map that is truly nearest: how well the map itself is does not count.
pub(super) fn error<M: Measurement<Pose: Scored>>(
    map: &Simulated<M>,
    map_from_robot: M::Pose,
    truth: M::Pose,
) -> Option<PoseError> {
    let away_m = |k: &usize| map.truth(*k).distance(truth);
    let nearest = (0..map.keyframe_count()).min_by(|a, b| away_m(a).total_cmp(&away_m(b)))?;
    let found = map.keyframe_poses()[nearest].between(map_from_robot);
    Some(PoseError::of(found, map.truth(nearest).between(truth)))
}

/// Sees every scan of the later drive.
#[derive(Debug, Default)]
pub(super) struct Witness {
    scans: usize,
    began: Option<Stamp>,
    last: Option<Stamp>,
    located_s: Option<f64>,
    is_right: bool,
    right: usize,
    error_m: f64,
    wrong_s: f64,
    stretch_s: f64,
    longest_wrong_s: f64,
    withdrawn: usize,
    withdrawn_right: usize,
}

impl Witness {
    /// What came of it.
    pub(super) fn world(&self, seed: u64, twice: &'static str) -> World {
        World {
            seed,
            twice,
            scans: self.scans,
            located_s: self.located_s,
            located: self.is_right,
            wrong_s: self.wrong_s,
            longest_wrong_s: self.longest_wrong_s,
            withdrawn: self.withdrawn,
            withdrawn_rightly_located: self.withdrawn_right,
            error_m: (self.right > 0).then(|| self.error_m / self.right as f64),
        }
    }

    pub(super) fn see<M: Measurement>(&mut self, update: &Update<M>, error: Option<PoseError>, is_withdrawn: bool) {
        let began = *self.began.get_or_insert(update.stamp);
        let elapsed_s = self.last.map_or(0.0, |last| update.stamp.secs_since(last));
        self.last = Some(update.stamp);
        self.scans += 1;
        self.withdrawn += usize::from(is_withdrawn);
        self.withdrawn_right += usize::from(is_withdrawn && self.is_right);
        let is_claimed = update.localisation == Localisation::Joined && update.status != Status::Lost;
        let is_right = error.is_some_and(PoseError::is_right);
        self.is_right = is_claimed && is_right;
        if self.is_right {
            self.located_s.get_or_insert(update.stamp.secs_since(began));
            self.right += 1;
            self.error_m += error.map_or(0.0, |error| error.metres);
        }
        if is_claimed && !is_right {
            self.wrong_s += elapsed_s;
            self.stretch_s += elapsed_s;
            self.longest_wrong_s = self.longest_wrong_s.max(self.stretch_s);
        } else {
            self.stretch_s = 0.0;
        }
    }
}
