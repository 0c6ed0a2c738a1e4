//! `mapwright suite fleet` and `suite partition`

mod drive;
mod liars;

pub(super) use liars::Liars;

use super::Measure;
use super::floors::{Floor, percent};
use crate::failure::Failure;
use crate::picture::meetings;
use crate::robots::{Robot, Simulated};
use drive::{Agreed, DRIVE_S, Drives, Truth};
use mapwright::{EdgeKind, Pose2, Session, Settings, Stamp};
use mapwright_eval::ErrorStats;
use mapwright_fleet::{Chain, Kind, Record};
use mapwright_record::SessionEdge;
use mapwright_sim::{RadioSettings, Rng};
use serde::Serialize;
use serde_json::{Value, json};

/// Robots agree within so long after a partition ends, seconds; in such a share of the seeds with at most so many messages lost.
const REJOINED_S: f64 = 10.0;
const REJOINED_SHARE: f64 = 0.9;
const REJOINED_LOSS: f64 = 0.6;

/// Robots in a small building that share one map over a bad radio.
pub(super) struct Fleets {
    /// How many robots; by the seed where it is none.
    robots: Option<usize>,
    settings: Settings,
}

impl Fleets {
    /// With cells of such a side.
    pub(super) fn new(robots: Option<usize>, cell_m: f64, mut settings: Settings) -> Self {
        settings.map.resolution_m = cell_m;
        Self { robots, settings }
    }
}

/// The same, cut in two until after all drives.
pub(super) struct Partitions(pub(super) Fleets);

/// What is drawn of a seed.
#[derive(Debug, Clone)]
struct Plan {
    seed: u64,
    robots: usize,
    loss: f64,
    /// The first so many do not hear the others between these times, seconds.
    split: (usize, [f64; 2]),
    /// Who dies, and when.
    dies: Option<(usize, f64)>,
}

/// What came of it.
#[derive(Debug, Serialize)]
pub(super) struct World {
    seed: u64,
    robots: usize,
    loss: f64,
    split: (usize, [f64; 2]),
    dies: Option<(usize, f64)>,
    /// Whether each part of the team went on with its map while it was alone.
    went_on: bool,
    /// When they first agreed after drives and partition, and whether they had the same bytes in the end.
    #[serde(flatten)]
    agreed: Agreed,
    identical: bool,
    keyframes: usize,
    /// Maps of robots, and into how many of them closures join them.
    maps: usize,
    joined_into: usize,
    /// Closures between robots, and those of them that are wrong.
    closures: usize,
    wrong: usize,
    /// Of the keyframes of the largest map, aligned rigidly: root mean square and worst, metres.
    error_m: f64,
    worst_m: f64,
    /// Bytes of records that all keyframes took, mapped and as solution, and bytes that all robots sent.
    mapped_bytes: usize,
    solution_bytes: usize,
    sent_bytes: u64,
    /// Time elapsed for each robot's own map, for the team by those that solved in the end, and by the others, seconds.
    #[serde(skip)]
    took_s: [f64; 3],
}

impl Plan {
    fn draw(seed: u64, robots: Option<usize>, until_after: bool) -> Self {
        let mut rng = Rng::keyed(seed, 0x666c_6565_7473);
        let robots = robots.unwrap_or(2 + seed as usize % 5);
        // Every loss with every number of robots.
        let loss = 0.9 * (seed.wrapping_mul(37) % 100) as f64 / 99.0;
        let from = rng.uniform(4.0, 10.0);
        let until = if until_after { DRIVE_S + rng.uniform(0.0, 10.0) } else { from + rng.uniform(5.0, 15.0) };
        let dies =
            (robots > 2 && rng.chance(0.8)).then(|| (rng.below(robots), rng.uniform(0.3 * DRIVE_S, 0.9 * DRIVE_S)));
        Self { seed, robots, loss, split: (1 + rng.below(robots - 1), [from, until]), dies }
    }

    fn world(&self, settings: Settings) -> Result<World, Failure> {
        let drives = Drives::new(self.seed, self.robots);
        let radio = RadioSettings { loss: self.loss, doubled: 0.1, delay_s: [0.005, 0.5], seed: self.seed };
        let mut team = Simulated::new(&names(self.robots), settings, radio)?;
        team.split = Some(self.split);
        let [_, until_s] = self.split.1;
        let mut went_on = false;
        let agreed = drives.run(&mut team, until_s.max(DRIVE_S), |team, seconds| {
            if let Some((robot, _)) = self.dies.filter(|(_, at_s)| *at_s <= seconds) {
                team.robots[robot].is_alive = false;
            }
            if seconds < until_s {
                went_on = self.has_gone_on(team);
            }
        });
        Ok(self.judge(&team, &drives, went_on, agreed))
    }

    /// Whether each part that lives has a map with what it has mapped since it was cut off.
    fn has_gone_on(&self, team: &Simulated) -> bool {
        let (first, [from_s, _]) = self.split;
        let since = Stamp(((from_s + 5.0) * 1e9) as i64);
        let parts = [&team.robots[..first], &team.robots[first..]];
        parts.into_iter().all(|part| {
            let alive = || part.iter().filter(|robot| robot.is_alive);
            let is_new = |map: &Session| {
                let own = |keyframe: mapwright::KeyframeId| {
                    part.iter().any(|robot| robot.mapper.session().place(keyframe).is_some())
                };
                map.keyframes().iter().any(|keyframe| keyframe.stamp > since && own(keyframe.id))
            };
            alive().next().is_none() || alive().filter_map(|robot| robot.team.map()).any(is_new)
        })
    }

    fn judge(&self, team: &Simulated, drives: &Drives, went_on: bool, agreed: Agreed) -> World {
        let alive: Vec<&Robot> = team.robots.iter().filter(|robot| robot.is_alive).collect();
        let none = Session::default();
        let map = alive.iter().find_map(|robot| robot.team.map()).unwrap_or(&none);
        let truth = Truth::new(drives, team, map);
        let wrong = closures_between(map, |_| true).filter(|known| truth.is_wrong(known)).count();
        let maps = map.maps();
        let error = truth.error_m(maps.iter().take(1).flat_map(|map| map.places()));
        let robots_in: std::collections::BTreeSet<u128> = map.keyframes().iter().map(|key| key.id.robot).collect();
        let said = |kind: Kind| -> usize {
            let chains = alive.first().into_iter().flat_map(|robot| robot.team.node().chains().values());
            chains.flat_map(Chain::records).filter(|record| record.kind == kind).map(Record::message_bytes).sum()
        };
        let took_s = |of: &dyn Fn(&Robot) -> f64| team.robots.iter().map(of).sum::<f64>();
        let solved = |is: bool| took_s(&|r| if r.team.is_solving() == is { r.shared.as_secs_f64() } else { 0.0 });
        World {
            seed: self.seed,
            robots: self.robots,
            loss: self.loss,
            split: self.split,
            dies: self.dies,
            went_on,
            agreed,
            identical: team.is_agreed(),
            keyframes: map.keyframes().len(),
            maps: robots_in.len(),
            joined_into: maps.len(),
            closures: meetings(map).len(),
            wrong,
            error_m: error.map_or(f64::NAN, |error| error.rmse),
            worst_m: error.map_or(f64::NAN, |error| error.max),
            mapped_bytes: said(Kind::Entries),
            solution_bytes: said(Kind::Solution),
            sent_bytes: team.radio.sent().1,
            took_s: [took_s(&|robot| robot.mapped.as_secs_f64()), solved(true), solved(false)],
        }
    }
}

/// What robots are called.
fn names(robots: usize) -> Vec<String> {
    (1..=robots).map(|number| format!("robot {number:02}")).collect()
}

/// Closures that stand between keyframes of different robots, of those for which it holds.
fn closures_between(map: &Session, is_of: impl Fn(u128) -> bool) -> impl Iterator<Item = &SessionEdge<Pose2>> {
    map.recorded_edges().iter().filter(move |known| {
        let [a, b] = known.ends.map(|end| map.keyframes()[end as usize].id.robot);
        !known.withdrawn && known.recorded.edge.kind == EdgeKind::Closure && a != b && is_of(a) && is_of(b)
    })
}

impl World {
    fn line(&self) -> String {
        let agreed =
            self.agreed.agreed_s.map_or("NEVER AGREED".to_owned(), |s| format!("agreed {s:5.1} s after the end"));
        let identical = if self.identical { "" } else { "  NOT IDENTICAL" };
        let wrong = if self.wrong > 0 { format!("  {} WRONG", self.wrong) } else { String::new() };
        format!(
            "{:6}  {} robots, loss {:4.1} %{}  {agreed}  {:3} keyframes, {} maps in {}, {:3} closures between robots, error {:.3} m{identical}{wrong}",
            self.seed,
            self.robots,
            100.0 * self.loss,
            if self.dies.is_some() { ", one dies" } else { "          " },
            self.keyframes,
            self.maps,
            self.joined_into,
            self.closures,
            self.error_m,
        )
    }
}

/// Rows of a table: by how many robots, and by the share that is lost.
fn rows(worlds: &[World]) -> Vec<(String, Vec<&World>)> {
    let mut counts: Vec<usize> = worlds.iter().map(|world| world.robots).collect();
    counts.sort_unstable();
    counts.dedup();
    let by_count = counts.into_iter().map(|robots| {
        let of = worlds.iter().filter(|world| world.robots == robots).collect();
        (format!("{robots} robots"), of)
    });
    let by_loss = [[0.0, 0.3], [0.3, 0.6], [0.6, 0.91]].into_iter().map(|[low, high]| {
        let of = worlds.iter().filter(|world| (low..high).contains(&world.loss)).collect();
        (format!("loss {:.0}-{:.0} %", 100.0 * low, 100.0 * f64::min(high, 0.9)), of)
    });
    by_count.chain(by_loss).chain([("all".to_owned(), worlds.iter().collect())]).collect()
}

fn median_and_worst(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let stats = ErrorStats::of(&values.filter(|value| value.is_finite()).collect::<Vec<_>>());
    stats.map_or([f64::NAN; 2], |stats| [stats.median, stats.max])
}

fn summary(worlds: &[World], of: &'static str) -> (String, Value, Vec<Floor>) {
    let mut words = format!(
        "                 agreed  {of:<22} maps in   closures  wrong  error, m        bytes a keyframe        ms a keyframe\n\
         \u{20}                seeds   median s, worst s                between          rms     worst  mapped solved sent      own  solver  others\n"
    );
    let mut table = Vec::new();
    for (name, of) in rows(worlds).into_iter().filter(|(_, of)| !of.is_empty()) {
        let agreed = of.iter().filter(|world| world.identical).count();
        let [median_s, worst_s] = median_and_worst(of.iter().filter_map(|world| world.agreed.agreed_s));
        let sum = |pick: &dyn Fn(&World) -> f64| of.iter().map(|world| pick(world)).sum::<f64>();
        let keyframes = sum(&|world| world.keyframes as f64).max(1.0);
        let (maps, into) = (sum(&|world| world.maps as f64), sum(&|world| world.joined_into as f64));
        let (closures, wrong) = (sum(&|world| world.closures as f64), sum(&|world| world.wrong as f64));
        let [error_m, worst_error_m] = median_and_worst(of.iter().map(|world| world.error_m));
        let bytes = [
            sum(&|world| world.mapped_bytes as f64) / keyframes,
            sum(&|world| world.solution_bytes as f64) / keyframes,
            sum(&|world| world.sent_bytes as f64) / keyframes,
        ];
        let ms = [0, 1, 2].map(|k: usize| 1e3 * sum(&|world| world.took_s[k]) / keyframes);
        words += &format!(
            "{name:<14} {agreed:3} of {:<3}  {median_s:6.1} {worst_s:7.1}     {maps:4.0} {into:4.0}   {closures:7.0}  {wrong:5.0}   {error_m:.3}   {worst_error_m:.3}   \
             {:5.0}  {:5.0} {:6.0}   {:6.2}  {:6.2}  {:6.2}\n",
            of.len(),
            bytes[0],
            bytes[1],
            bytes[2],
            ms[0],
            ms[1],
            ms[2],
        );
        table.push(json!({
            "of": name, "seeds": of.len(), "agreed": agreed, "agreed_s": { "median": median_s, "worst": worst_s }, "maps": maps,
            "joined_into": into, "closures": closures, "wrong": wrong, "error_m": { "median": error_m, "worst": worst_error_m },
            "bytes_per_keyframe": { "mapped": bytes[0], "solution": bytes[1], "sent": bytes[2] },
        }));
    }
    let apart = worlds.iter().filter(|world| !world.identical).count();
    let wrong = worlds.iter().map(|world| world.wrong).sum();
    let floors = vec![
        Floor::none("seeds whose robots do not end with identical maps", apart),
        Floor::none("wrong closures between robots", wrong),
    ];
    (words, json!({ "table": table }), floors)
}

impl Measure for Fleets {
    type World = World;
    const NAME: &'static str = "fleet";
    const FILES: [&'static str; 2] = ["fleet.jsonl", "fleet.json"];
    const KIND: &'static str = "fleet";

    fn world(&self, seed: u64) -> Result<World, Failure> {
        Plan::draw(seed, self.robots, false).world(self.settings)
    }

    fn line(world: &World) -> String {
        world.line()
    }

    fn summary(&self, worlds: &[World]) -> (String, Value, Vec<Floor>) {
        summary(worlds, "after the end")
    }
}

impl Measure for Partitions {
    type World = World;
    const NAME: &'static str = "partition";
    const FILES: [&'static str; 2] = ["partition.jsonl", "partition.json"];
    const KIND: &'static str = "fleet";

    fn world(&self, seed: u64) -> Result<World, Failure> {
        Plan::draw(seed, self.0.robots, true).world(self.0.settings)
    }

    fn line(world: &World) -> String {
        world.line() + if world.went_on { "" } else { "  A PART STOOD STILL" }
    }

    fn summary(&self, worlds: &[World]) -> (String, Value, Vec<Floor>) {
        let (mut words, mut value, mut floors) = summary(worlds, "after the partition");
        let went_on = worlds.iter().filter(|world| world.went_on).count();
        words += &format!("both parts went on while they were cut off: {}\n", percent(went_on, worlds.len()));
        value["went_on"] = json!(went_on);
        let heard = || worlds.iter().filter(|world| world.loss <= REJOINED_LOSS);
        let soon = heard().filter(|world| world.agreed.agreed_s.is_some_and(|s| s <= REJOINED_S)).count();
        floors.push(Floor::share(
            "agreed within 10 s after the partition, of those that lose at most 60 %",
            REJOINED_SHARE,
            soon,
            heard().count(),
        ));
        (words, value, floors)
    }
}
