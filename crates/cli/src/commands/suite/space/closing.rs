//! `mapwright suite loops --3d` and `look-alike --3d`: what is closed, what of it is wrong, and the error.

use super::super::Measure;
use super::super::floors::{Floor, Number, percent, stats, stats_in_words};
use super::super::look_alike::{FOUND_WITHIN_S, closed_times};
use super::super::loops::MOST_RATIO;
use super::super::nested::Wrong;
use super::{Drives, EVERY};
use crate::batch::{batch_poses, true_pairs};
use crate::failure::Failure;
use crate::simulated::{Closing, PoseError, Simulated};
use mapwright::{EdgeKind, Objection, Pose3, SpaceSweep, Stamp, Verdict};
use mapwright_sim::Revisits;
use mapwright_sim::space::{SpaceSite, worlds};
use serde::Serialize;
use serde_json::{Value, json};
use std::collections::BTreeMap;

/// A loop is at least so much way on ground that the robot has come back to, metres.
const LOOP_M: f64 = 3.0;
/// Such a share of the times on known ground is closed where storeys look alike.
const CLOSED_SHARE: f64 = 0.8;

pub(in super::super) struct Loops(pub(in super::super) Drives);

pub(in super::super) struct LookAlikes(pub(in super::super) Drives);

#[derive(Debug, Serialize)]
pub(in super::super) struct World {
    seed: u64,
    path_m: f64,
    clouds: usize,
    keyframes: usize,
    /// Stretches on known ground to which the robot has come back, and those of them that are closed.
    loops: usize,
    closed: usize,
    /// Stretches on known ground on which it has not been away.
    stayed: usize,
    /// When the others begin and end, seconds.
    open_s: Vec<[f64; 2]>,
    /// Times on known ground, and those of them that are closed.
    times: usize,
    times_closed: usize,
    closures: usize,
    closings: usize,
    wrong: usize,
    wrong_closures: usize,
    wrong_closings: Vec<Wrong>,
    candidates: usize,
    /// Candidates measured right that are no closures, by verdict and objection.
    right_refused: BTreeMap<String, usize>,
    true_closures: usize,
    /// Of the keyframes, as the batch solve's.
    ate_m: f64,
    batch_ate_m: f64,
    ratio: f64,
    /// Of all clouds.
    trajectory_ate_m: f64,
}

impl World {
    fn map(drives: &Drives, site: SpaceSite, seed: u64, name: &str) -> Result<Self, Failure> {
        let failure = |reason: String| Failure::World { name: format!("{name}, seed {seed}"), reason };
        let drive = drives.drive(site, seed);
        let world = Simulated::map_space(&drive, EVERY, &drives.settings, |_, _, _| {})?;
        let revisits = Revisits::in_space(&drive);
        let pairs = true_pairs(&world, &revisits);
        let batch = batch_poses(&world, &pairs).map_err(|cause| failure(cause.to_string()))?;
        let ate = |poses| world.keyframe_ate_m(poses).map_err(|cause| failure(cause.to_string()));
        let (ate_m, batch_ate_m) = (ate(world.keyframe_poses())?, ate(&batch)?);
        let closings = world.closings();
        let (times, times_closed) = closed_times(&world, &revisits, &closings);
        let (loops, known) = (long_of(&world, revisits.returns()), long_of(&world, revisits.stretches()));
        let is_open = |ends: &&[Stamp; 2]| !closings.iter().any(|closing| closes(&world, &revisits, **ends, closing));
        let open: Vec<_> = loops.iter().filter(is_open).collect();
        let wrong_closings = Wrong::among(&closings);
        Ok(Self {
            seed,
            path_m: world.length_m(),
            clouds: world.scan_count(),
            keyframes: world.keyframe_count(),
            loops: loops.len(),
            closed: loops.len() - open.len(),
            stayed: known.len() - loops.len(),
            open_s: open.iter().map(|ends| ends.map(|stamp| stamp.secs_since(Stamp(0)))).collect(),
            times,
            times_closed,
            closures: closings.iter().filter(|closing| closing.kind == EdgeKind::Closure).count(),
            closings: closings.len(),
            wrong: wrong_closings.len(),
            wrong_closures: wrong_closings.iter().filter(|wrong| wrong.is_closure).count(),
            wrong_closings,
            candidates: world.session().candidates().len(),
            right_refused: right_refused(&world),
            true_closures: pairs.len(),
            ate_m,
            batch_ate_m,
            ratio: ate_m / batch_ate_m,
            trajectory_ate_m: world.trajectory_ate_m().map_err(|cause| failure(cause.to_string()))?,
        })
    }

    fn line(&self) -> String {
        format!(
            "{:6}  closed {} of {} loops, {} stayed, {:3} of {:3} times  {:3} closures, {} wrong, {:5} closing, {} wrong  \
             ATE {:6.3} m, batch {:6.3} m, ratio {:5.2}  {:4.0} m of way",
            self.seed,
            self.closed,
            self.loops,
            self.stayed,
            self.times_closed,
            self.times,
            self.closures,
            self.wrong_closures,
            self.closings,
            self.wrong,
            self.ate_m,
            self.batch_ate_m,
            self.ratio,
            self.path_m,
        )
    }
}

/// The stretches of the drive that are long enough.
fn long_of(world: &Simulated<SpaceSweep>, mut stretches: Vec<[Stamp; 2]>) -> Vec<[Stamp; 2]> {
    stretches.retain(|&[from, until]| world.along_at_m(until) - world.along_at_m(from) >= LOOP_M);
    stretches
}

/// Whether an edge closes a loop: its older keyframe truly saw what is seen there.
fn closes(
    world: &Simulated<SpaceSweep>,
    revisits: &Revisits<Pose3>,
    [from, until]: [Stamp; 2],
    closing: &Closing,
) -> bool {
    let [older, newer] = [closing.from, closing.to].map(|keyframe| world.stamp(keyframe));
    let is_there = newer >= from && newer.secs_since(until) <= FOUND_WITHIN_S;
    let mut of_loop = revisits.pairs().iter().map(|pair| pair.later).filter(|later| (from..=until).contains(later));
    closing.is_right() && is_there && of_loop.any(|time| revisits.contains(older, time))
}

/// Candidates measured right that are no closures, by verdict and objection.
fn right_refused(world: &Simulated<SpaceSweep>) -> BTreeMap<String, usize> {
    let session = world.session();
    let mut refused = BTreeMap::new();
    for candidate in session.candidates().iter().filter(|candidate| candidate.verdict != Verdict::Accepted) {
        let ends = session.place(candidate.from).zip(session.place(candidate.to)).zip(candidate.from_from_to);
        let is_right =
            ends.is_some_and(|((from, to), found)| PoseError::of(found, world.true_between(from, to)).is_right());
        if is_right {
            let why = candidate.verdict.objection().map_or("", Objection::in_words);
            *refused.entry(format!("{}: {why}", candidate.verdict.name())).or_default() += 1;
        }
    }
    refused
}

/// The last lines over all worlds, and the same for programs.
fn summary(worlds: &[World]) -> (String, Value, Sums) {
    let rows: [Number<World>; 3] =
        [("ATE", " m", |w| w.ate_m), ("batch", " m", |w| w.batch_ate_m), ("ratio", "", |w| w.ratio)];
    let sums = Sums::of(worlds);
    let words = format!(
        "{}loops    {} closed; {} stretches on known ground where it has stayed; times on known ground {}\nwrong    {} of {} closures, {} of {} closing edges\n",
        stats_in_words(worlds, &rows),
        percent(sums.closed, sums.loops),
        sums.stayed,
        percent(sums.times_closed, sums.times),
        sums.wrong_closures,
        sums.closures,
        sums.wrong,
        sums.closings,
    );
    let [ate, batch, ratio] = rows.map(|(_, _, pick)| stats(worlds, pick));
    let value = json!({
        "loops": sums.loops,
        "closed": sums.closed,
        "stayed": sums.stayed,
        "times": sums.times,
        "times_closed": sums.times_closed,
        "closures": sums.closures,
        "closings": sums.closings,
        "wrong_closures": sums.wrong_closures,
        "wrong_closings": sums.wrong,
        "ate_m_mean": ate.map(|stats| stats.mean),
        "batch_ate_m_mean": batch.map(|stats| stats.mean),
        "ratio_mean": ratio.map(|stats| stats.mean),
        "ratio_worst": ratio.map(|stats| stats.max),
    });
    (words, value, sums)
}

struct Sums {
    loops: usize,
    closed: usize,
    stayed: usize,
    times: usize,
    times_closed: usize,
    closures: usize,
    closings: usize,
    wrong: usize,
    wrong_closures: usize,
}

impl Sums {
    fn of(worlds: &[World]) -> Self {
        let sum = |pick: fn(&World) -> usize| worlds.iter().map(pick).sum();
        Self {
            loops: sum(|w| w.loops),
            closed: sum(|w| w.closed),
            stayed: sum(|w| w.stayed),
            times: sum(|w| w.times),
            times_closed: sum(|w| w.times_closed),
            closures: sum(|w| w.closures),
            closings: sum(|w| w.closings),
            wrong: sum(|w| w.wrong),
            wrong_closures: sum(|w| w.wrong_closures),
        }
    }
}

impl Measure for Loops {
    type World = World;
    const NAME: &'static str = "loops in space";
    const FILES: [&'static str; 2] = ["loops-3d.jsonl", "loops-3d.json"];

    fn world(&self, seed: u64) -> Result<World, Failure> {
        World::map(&self.0, worlds::loops_1km(seed), seed, "loops in space")
    }

    fn line(world: &World) -> String {
        world.line()
    }

    fn summary(&self, worlds: &[World]) -> (String, Value, Vec<Floor>) {
        let (words, value, sums) = summary(worlds);
        let within = worlds.iter().filter(|world| world.ratio <= MOST_RATIO).count();
        let floors = vec![
            Floor::none("no wrong closing edge", sums.wrong),
            Floor::share("every loop closed", 1.0, sums.closed, sums.loops),
            Floor::share("ratio at most 1.3 in every world", 1.0, within, worlds.len()),
        ];
        (words, value, floors)
    }
}

impl Measure for LookAlikes {
    type World = World;
    const NAME: &'static str = "look-alike storeys";
    const FILES: [&'static str; 2] = ["look-alike-3d.jsonl", "look-alike-3d.json"];

    fn world(&self, seed: u64) -> Result<World, Failure> {
        World::map(&self.0, worlds::look_alike_storeys(seed), seed, "look-alike storeys")
    }

    fn line(world: &World) -> String {
        world.line()
    }

    fn summary(&self, worlds: &[World]) -> (String, Value, Vec<Floor>) {
        let (words, value, sums) = summary(worlds);
        let floors = vec![
            Floor::none("no wrong closing edge", sums.wrong),
            Floor::share("80 % of the times on known ground closed", CLOSED_SHARE, sums.times_closed, sums.times),
        ];
        (words, value, floors)
    }
}
