//! `mapwright suite liars`

use super::drive::{Agreed, DRIVE_S, Drives, Truth, sigma_of_sweep_m};
use super::{closures_between, names};
use crate::commands::suite::Measure;
use crate::commands::suite::floors::{Floor, percent};
use crate::failure::Failure;
use crate::liar::{Liar, Lie};
use crate::robots::{Robot, Simulated};
use mapwright::{FragmentStart, RunId, Session, Settings};
use mapwright_fleet::Refusal;
use mapwright_sim::{RadioSettings, Rng};
use serde::Serialize;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// The others' error is at most so many times that without the lie,
const MOST_RATIO: f64 = 1.1;
/// While a robot that lies about solutions solves for some of the others these have so long after their drives to look at what it has found, seconds.
const LOOKED_AT_S: f64 = 15.0;
/// Where more liars are asked for, teams are of so many robots.
const ROBOTS_OF_MANY_LIARS: usize = 8;

/// Robots that share one map, some of which lie, beside the same team with nobody lying.
pub(in crate::commands::suite) struct Liars {
    liars: usize,
    settings: Settings,
}

impl Liars {
    /// So many liars, with cells of such a side.
    pub(in crate::commands::suite) fn new(liars: usize, cell_m: f64, mut settings: Settings) -> Self {
        settings.map.resolution_m = cell_m;
        Self { liars, settings }
    }
}

/// A robot that lies, by its place in the roster, and from when on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
struct Lying {
    robot: usize,
    lie: &'static str,
    #[serde(skip)]
    kind: Lie,
    from_s: f64,
}

/// What is drawn of a seed.
#[derive(Debug, Clone)]
struct Plan {
    seed: u64,
    robots: usize,
    liars: Vec<Lying>,
    loss: f64,
    /// The first so many do not hear the others until after all have driven, so that a robot which lies about solutions solves.
    cut: Option<usize>,
}

impl Plan {
    /// Of one liar all numbers of robots with all kinds occur in 42 seeds, each position with them in 336.
    fn draw(seed: u64, liars: usize) -> Self {
        let mut rng = Rng::keyed(seed, 0x6c69_6172_7300);
        let robots = if liars > 1 { ROBOTS_OF_MANY_LIARS.max(liars + 1) } else { 3 + seed as usize % 6 };
        let row = (seed / 6) as usize;
        let mut kind = (seed as usize % 6 + row) % Lie::ALL.len();
        let mut robot = (row % Lie::ALL.len() + row / Lie::ALL.len()) % robots;
        let mut lying: Vec<Lying> = Vec::new();
        while lying.len() < liars {
            if lying.iter().all(|known| known.robot != robot) {
                let (lie, from_s) = (Lie::ALL[kind], rng.uniform(0.15 * DRIVE_S, 0.7 * DRIVE_S));
                lying.push(Lying { robot, lie: lie.name(), kind: lie, from_s });
            }
            (robot, kind) = (rng.below(robots), rng.below(Lie::ALL.len()));
        }
        lying.sort_by_key(|liar| liar.robot);
        let cut =
            lying.iter().find(|liar| liar.kind == Lie::Solution).map(|liar| liar.robot).filter(|first| *first > 0);
        Self { seed, robots, liars: lying, loss: rng.uniform(0.0, 0.3), cut }
    }

    fn is_liar(&self, robot: usize) -> bool {
        self.liars.iter().any(|liar| liar.robot == robot)
    }

    /// What the others make of it, whether who may lie does or not.
    fn team(&self, drives: &Drives, settings: Settings, is_lying: bool) -> Result<Others, Failure> {
        let radio = RadioSettings { loss: self.loss, doubled: 0.1, delay_s: [0.005, 0.5], seed: self.seed };
        let mut team = Simulated::new(&names(self.robots), settings, radio)?;
        let end_s = DRIVE_S + self.cut.map_or(0.0, |_| LOOKED_AT_S);
        team.split = self.cut.map(|first| (first, [0.0, end_s]));
        for liar in self.liars.iter().filter(|_| is_lying) {
            team.robots[liar.robot].liar = Some(Liar::new(liar.kind, liar.from_s, self.seed));
        }
        let agreed = drives.run(&mut team, end_s, |_, _| ());
        Ok(self.judge(&team, drives, agreed))
    }

    fn judge(&self, team: &Simulated, drives: &Drives, Agreed { agreed_s, .. }: Agreed) -> Others {
        let others = || team.robots.iter().enumerate().filter(|(at, _)| !self.is_liar(*at)).map(|(_, robot)| robot);
        let ids: Vec<u128> = others().map(|robot| RunId::of_robot(&robot.name).robot).collect();
        let none = Session::default();
        let map = others().find_map(|robot| robot.team.map()).unwrap_or(&none);
        let truth = Truth::new(drives, team, map);
        let is_of_others = |robot: u128| ids.contains(&robot);
        let of_others = |place: &usize| is_of_others(map.keyframes()[*place].id.robot);
        let maps = map.maps();
        let errors: Vec<_> = maps.iter().filter_map(|one| truth.error_m(one.places().filter(of_others))).collect();
        let (sse, count) = errors.iter().fold((0.0, 0), |(sse, count), of| (sse + of.sse, count + of.count));
        let is_break = |start: FragmentStart| start == FragmentStart::Contradicted;
        let fragments = map.fragments().iter().filter(|fragment| is_break(fragment.start));
        let (mut accused, mut refused) = (0, BTreeMap::new());
        for (why, of, times) in others().flat_map(|robot| robot.team.node().refused()) {
            let is_honest = of.is_none_or(|name| others().any(|robot| robot.name == name));
            if !is_honest {
                *refused.entry(why.words()).or_default() += times;
            } else if is_accusation(why) {
                accused += times;
            }
        }
        Others {
            identical: team.is_agreed(),
            agreed_s,
            keyframes: count,
            left_out: others().map(mapped).sum::<usize>().saturating_sub(count),
            maps: errors.len(),
            error_m: if count > 0 { (sse / count as f64).sqrt() } else { f64::NAN },
            worst_m: errors.iter().map(|of| of.max).fold(0.0, f64::max),
            closures: closures_between(map, is_of_others).count(),
            wrong: closures_between(map, is_of_others).filter(|known| truth.is_wrong(known)).count(),
            broken: fragments.clone().filter(|fragment| is_of_others(fragment.first.robot)).count(),
            broken_of_liars: fragments.filter(|fragment| !is_of_others(fragment.first.robot)).count(),
            accused,
            refused,
        }
    }
}

fn mapped(robot: &Robot) -> usize {
    robot.mapper.keyframes().len()
}

/// Whether that is refused for what a robot says, not for how its message came.
fn is_accusation(why: Refusal) -> bool {
    !matches!(why, Refusal::Replayed)
}

/// What the robots that never lie have in the end.
#[derive(Debug, Serialize)]
struct Others {
    identical: bool,
    /// Seconds after the drives until they first had the same map with all that they have mapped.
    agreed_s: Option<f64>,
    /// Keyframes of theirs that are in the map, and those that are not.
    keyframes: usize,
    left_out: usize,
    /// The maps that their keyframes are in.
    maps: usize,
    /// How far their keyframes are from the truth, each map aligned rigidly by itself: root mean square and worst, metres.
    error_m: f64,
    worst_m: f64,
    /// Closures between two of them, and those that are wrong.
    closures: usize,
    wrong: usize,
    /// Where one's way is called contradicted in the map, and how often one has refused what another one said.
    broken: usize,
    accused: u64,
    /// Where the way of who may lie is called contradicted in the map.
    broken_of_liars: usize,
    /// What they have refused of who may lie, each robot by itself.
    refused: BTreeMap<&'static str, u64>,
}

/// A team with nobody lying, and the same with a lie.
#[derive(Debug, Serialize)]
pub(in crate::commands::suite) struct World {
    seed: u64,
    robots: usize,
    loss: f64,
    liars: Vec<Lying>,
    honest: Others,
    lying: Others,
    /// The others' error with the lie by that without it.
    ratio: f64,
}

impl World {
    /// Whether the lie has made the others' map worse, beyond what one sweep can tell.
    fn is_worse(&self) -> bool {
        let most_m = (MOST_RATIO * self.honest.error_m).max(self.honest.error_m + sigma_of_sweep_m());
        self.lying.error_m.is_nan() || self.lying.error_m > most_m
    }

    fn accusations(&self) -> u64 {
        [&self.honest, &self.lying].iter().map(|others| others.broken as u64 + others.accused).sum()
    }

    fn line(&self) -> String {
        let who = self.liars.iter().map(|liar| format!("{} {} from {:.1} s", liar.robot + 1, liar.lie, liar.from_s));
        let who: Vec<String> = who.collect();
        let Self { honest, lying, .. } = self;
        let refused = lying.broken_of_liars as u64 + lying.refused.values().sum::<u64>();
        let mut line = format!(
            "{:6}  {} robots, loss {:4.1} %, {:<24}  others {:.4} m beside {:.4} m, ratio {:5.3}  {} maps beside {}  refused of it {refused}",
            self.seed,
            self.robots,
            100.0 * self.loss,
            who.join(", "),
            lying.error_m,
            honest.error_m,
            self.ratio,
            lying.maps,
            honest.maps,
        );
        let flags = [
            (self.is_worse(), "WORSE".to_owned()),
            (!lying.identical, "NOT IDENTICAL".to_owned()),
            (!honest.identical, "NOT IDENTICAL WITHOUT".to_owned()),
            (lying.broken > 0, format!("{} BROKEN", lying.broken)),
            (lying.accused > 0, format!("{} ACCUSED", lying.accused)),
            (honest.broken as u64 + honest.accused > 0, format!("{} WITHOUT", honest.broken as u64 + honest.accused)),
            (lying.wrong > 0, format!("{} WRONG", lying.wrong)),
            (lying.left_out > 0, format!("{} LEFT OUT", lying.left_out)),
        ];
        flags.into_iter().filter(|(holds, _)| *holds).for_each(|(_, word)| line += &format!("  {word}"));
        line
    }
}

/// Rows of a table: by what is lied about, by where the liar stands in the roster, by how many robots.
fn rows(worlds: &[World]) -> Vec<(String, Vec<&World>)> {
    let of = |is_of: &dyn Fn(&World) -> bool| worlds.iter().filter(|world| is_of(world)).collect::<Vec<_>>();
    let kinds = Lie::ALL
        .into_iter()
        .map(|lie| (lie.name().to_owned(), of(&|world| world.liars.iter().any(|liar| liar.kind == lie))));
    let places = [
        ("first", of(&|world| world.liars.iter().any(|liar| liar.robot == 0))),
        ("not the first", of(&|world| world.liars.iter().all(|liar| liar.robot > 0))),
    ];
    let counts =
        (3..=ROBOTS_OF_MANY_LIARS).map(|robots| (format!("{robots} robots"), of(&|world| world.robots == robots)));
    let all = ("all".to_owned(), of(&|_| true));
    kinds.chain(places.map(|(name, of)| (name.to_owned(), of))).chain(counts).chain([all]).collect()
}

/// The smallest number that is no less than such a share of them.
fn quantile(sorted: &[f64], share: f64) -> f64 {
    let at = (share * sorted.len() as f64).ceil() as usize;
    sorted.get(at.max(1) - 1).copied().unwrap_or(f64::NAN)
}

impl Measure for Liars {
    type World = World;
    const NAME: &'static str = "liars";
    const FILES: [&'static str; 2] = ["liars.jsonl", "liars.json"];
    const KIND: &'static str = "team";

    fn world(&self, seed: u64) -> Result<World, Failure> {
        let plan = Plan::draw(seed, self.liars);
        let drives = Drives::new(seed, plan.robots);
        let honest = plan.team(&drives, self.settings, false)?;
        let lying = plan.team(&drives, self.settings, true)?;
        let ratio = lying.error_m / honest.error_m;
        Ok(World { seed, robots: plan.robots, loss: plan.loss, liars: plan.liars, honest, lying, ratio })
    }

    fn line(world: &World) -> String {
        world.line()
    }

    fn summary(&self, worlds: &[World]) -> (String, Value, Vec<Floor>) {
        let mut words = "                teams  others' error by that without the lie   maps of others   refused  identical  wrong  accused\n\
             \u{20}                      median     90 %    worst   beyond     lie  without   of it in\n"
            .to_owned();
        let mut table = Vec::new();
        for (name, of) in rows(worlds).into_iter().filter(|(_, of)| !of.is_empty()) {
            let mut ratios: Vec<f64> = of.iter().map(|world| world.ratio).collect();
            ratios.sort_unstable_by(f64::total_cmp);
            let [median, most, worst] = [0.5, 0.9, 1.0].map(|share| quantile(&ratios, share));
            let count = |is: &dyn Fn(&World) -> bool| of.iter().filter(|world| is(world)).count();
            let sum = |pick: &dyn Fn(&World) -> u64| of.iter().map(|world| pick(world)).sum::<u64>();
            let worse = count(&World::is_worse);
            let maps = [sum(&|world| world.lying.maps as u64), sum(&|world| world.honest.maps as u64)];
            let refused = count(&|world| world.lying.broken_of_liars > 0 || !world.lying.refused.is_empty());
            let identical = count(&|world| world.lying.identical && world.honest.identical);
            let (wrong, accused) = (sum(&|world| world.lying.wrong as u64), sum(&World::accusations));
            words += &format!(
                "{name:<14} {:6}  {median:7.3}  {most:7.3}  {worst:7.3}  {worse:7}  {:6}  {:7}  {refused:9}  {identical:9}  {wrong:5}  {accused:7}\n",
                of.len(),
                maps[0],
                maps[1],
            );
            table.push(json!({
                "of": name, "teams": of.len(), "ratio": { "median": median, "p90": most, "worst": worst }, "worse": worse,
                "maps": { "lie": maps[0], "without": maps[1] }, "refused_in": refused, "identical": identical, "wrong": wrong, "accused": accused,
            }));
        }
        if self.liars > 1 {
            let held = worlds.iter().filter(|world| !world.is_worse()).count();
            words += &format!(
                "aim      {} liars of {ROBOTS_OF_MANY_LIARS}: others' error at most 1.1 times in {}\n",
                self.liars,
                percent(held, worlds.len())
            );
            return (words, json!({ "table": table }), Vec::new());
        }
        let worse = worlds.iter().filter(|world| world.is_worse()).count();
        let apart = worlds.iter().filter(|world| !world.lying.identical).count();
        let accused: u64 = worlds.iter().map(World::accusations).sum();
        let floors = vec![
            Floor::none("teams whose others' error is more than 1.1 times that without the lie", worse),
            Floor::none("refused of what honest robots say", accused as usize),
            Floor::none("teams whose honest robots do not end with identical maps", apart),
        ];
        (words, json!({ "table": table, "room_m": sigma_of_sweep_m() }), floors)
    }
}
