//! `mapwright suite look-alike`

use super::Measure;
use super::floors::{Floor, percent};
use crate::batch::best_revisit;
use crate::failure::Failure;
use crate::simulated::{Closing, PoseError, Scored, Simulated};
use mapwright::{EdgeKind, Settings, Stamp};
use mapwright_record::Measurement;
use mapwright_sim::worlds::{Alias, LookAlikeKind, look_alike};
use mapwright_sim::{Revisit, Revisits};
use serde::Serialize;
use serde_json::{Value, json};

/// A return may be found so long after it began, seconds.
pub(super) const FOUND_WITHIN_S: f64 = 5.0;
/// The map is deceived when it has the copy within this of where the deception would have it, metres and degrees.
const DECEIVED_M: f64 = 0.5;
const DECEIVED_DEG: f64 = 5.0;

pub(super) struct LookAlikes {
    pub(super) settings: Settings,
}

#[derive(Debug, Serialize)]
pub(super) struct World {
    seed: u64,
    kind: &'static str,
    /// Whether odometry cannot tell the alias from a return.
    inside: bool,
    position_sigmas: f64,
    path_m: f64,
    closures: usize,
    long_matches: usize,
    /// Closing edges that are wrong, as measured or in the final map.
    wrong: usize,
    wrong_measured: usize,
    wrong_in_map: usize,
    wrong_closures: usize,
    candidates: usize,
    deceived: bool,
    /// Times on ground seen before, and those of them that are closed.
    times: usize,
    closed: usize,
    /// Pairs of times that see the same place, and those of them that the final map has right.
    pairs: usize,
    pairs_right: usize,
}

impl Measure for LookAlikes {
    type World = World;
    const NAME: &'static str = "look-alike";
    const FILES: [&'static str; 2] = ["look-alike.jsonl", "look-alike.json"];

    fn world(&self, seed: u64) -> Result<World, Failure> {
        let case = look_alike(seed);
        let world = Simulated::map(case.drive(), &self.settings)?;
        let revisits = case.revisits();
        let closings = world.closings();
        let count = |is: &dyn Fn(&Closing) -> bool| closings.iter().filter(|closing| is(closing)).count();
        let (times, closed) = closed_times(&world, &revisits, &closings);
        Ok(World {
            seed,
            kind: kind_name(case.kind),
            inside: case.alias.inside_two_sigma(),
            position_sigmas: case.alias.position_sigmas,
            path_m: world.length_m(),
            closures: count(&|closing| closing.kind == EdgeKind::Closure),
            long_matches: count(&|closing| closing.kind == EdgeKind::Match),
            wrong: count(&|closing| !closing.is_right()),
            wrong_measured: count(&|closing| !closing.measured.is_right()),
            wrong_in_map: count(&|closing| !closing.in_map.is_right()),
            wrong_closures: count(&|closing| closing.kind == EdgeKind::Closure && !closing.is_right()),
            candidates: world.session().candidates().len(),
            deceived: is_deceived(&world, &case.alias),
            times,
            closed,
            pairs: revisits.pairs().len(),
            pairs_right: revisits.pairs().iter().filter(|pair| is_right_in_map(&world, pair)).count(),
        })
    }

    fn line(world: &World) -> String {
        format!(
            "{:6}  {:18} {:7}  {:5} closing, {:3} wrong{}  closed {:3} of {:3}, pairs right {}",
            world.seed,
            world.kind,
            if world.inside { "inside" } else { "outside" },
            world.closures + world.long_matches,
            world.wrong,
            if world.deceived { ", DECEIVED" } else { "" },
            world.closed,
            world.times,
            percent(world.pairs_right, world.pairs),
        )
    }

    fn summary(&self, worlds: &[World]) -> (String, Value, Vec<Floor>) {
        let kinds = [LookAlikeKind::ParallelCorridors, LookAlikeKind::SymmetricFloor, LookAlikeKind::RepeatedRooms];
        let mut groups = vec![
            ("all", worlds.iter().collect()),
            ("alias inside two sigma", worlds.iter().filter(|world| world.inside).collect()),
            ("alias outside", worlds.iter().filter(|world| !world.inside).collect::<Vec<_>>()),
        ];
        groups.extend(kinds.map(kind_name).map(|kind| (kind, worlds.iter().filter(|w| w.kind == kind).collect())));
        let groups: Vec<_> = groups.into_iter().map(|(what, worlds)| (what, Group::of(&worlds))).collect();
        let words = groups.iter().map(|(what, group)| group.line(what)).collect();
        let value: serde_json::Map<_, _> = groups.iter().map(|(what, group)| ((*what).into(), json!(group))).collect();
        let all = Group::of(&worlds.iter().collect::<Vec<_>>());
        let floors = vec![
            Floor::none("no wrong closing edge", all.wrong),
            Floor::share("80 % of the times on known ground closed", 0.8, all.closed, all.times),
        ];
        (words, json!({ "groups": value }), floors)
    }
}

/// Sums over some worlds.
#[derive(Debug, Serialize)]
struct Group {
    worlds: usize,
    closings: usize,
    wrong: usize,
    wrong_measured: usize,
    wrong_in_map: usize,
    worlds_with_wrong: usize,
    deceived: usize,
    times: usize,
    closed: usize,
    pairs: usize,
    pairs_right: usize,
}

impl Group {
    fn of(worlds: &[&World]) -> Self {
        let sum = |pick: fn(&World) -> usize| worlds.iter().map(|world| pick(world)).sum();
        Self {
            worlds: worlds.len(),
            closings: sum(|w| w.closures + w.long_matches),
            wrong: sum(|w| w.wrong),
            wrong_measured: sum(|w| w.wrong_measured),
            wrong_in_map: sum(|w| w.wrong_in_map),
            worlds_with_wrong: sum(|w| usize::from(w.wrong > 0)),
            deceived: sum(|w| usize::from(w.deceived)),
            times: sum(|w| w.times),
            closed: sum(|w| w.closed),
            pairs: sum(|w| w.pairs),
            pairs_right: sum(|w| w.pairs_right),
        }
    }

    fn line(&self, what: &str) -> String {
        format!(
            "{what:22}  {} worlds, {} deceived; {} closing edges, {} wrong ({} measured, {} in the map) in {} worlds; \
             closed {}; pairs right {}\n",
            self.worlds,
            self.deceived,
            self.closings,
            self.wrong,
            self.wrong_measured,
            self.wrong_in_map,
            self.worlds_with_wrong,
            percent(self.closed, self.times),
            percent(self.pairs_right, self.pairs),
        )
    }
}

fn kind_name(kind: LookAlikeKind) -> &'static str {
    match kind {
        LookAlikeKind::ParallelCorridors => "parallel corridors",
        LookAlikeKind::SymmetricFloor => "symmetric floor",
        LookAlikeKind::RepeatedRooms => "repeated rooms",
    }
}

/// Whether the final map has the keyframes nearest to a pair's times right.
fn is_right_in_map<M: Measurement<Pose: Scored>>(world: &Simulated<M>, pair: &Revisit<M::Pose>) -> bool {
    let keyframes = world.keyframe_at(pair.earlier).zip(world.keyframe_at(pair.later));
    keyframes.is_some_and(|(from, to)| world.error_between(world.keyframe_poses(), from, to).is_right())
}

/// Times on ground seen before, and how many of them are closed.
pub(super) fn closed_times<M: Measurement<Pose: Scored>>(
    world: &Simulated<M>,
    revisits: &Revisits<M::Pose>,
    closings: &[Closing],
) -> (usize, usize) {
    let stretches = revisits.stretches();
    let newer: Vec<Stamp> = closings.iter().filter(|c| c.is_right()).map(|c| world.stamp(c.to)).collect();
    let (mut times, mut closed) = (0, 0);
    for pairs in revisits.pairs().chunk_by(|a, b| a.later == b.later) {
        let Some(best) = best_revisit(pairs) else { continue };
        let stretch = stretches.iter().find(|[from, until]| (*from..=*until).contains(&best.later));
        let from = stretch.map_or(best.later, |[from, _]| *from);
        let joined = newer.iter().any(|&stamp| stamp >= from && stamp.secs_since(best.later) <= FOUND_WITHIN_S);
        times += 1;
        closed += usize::from(joined && is_right_in_map(world, best));
    }
    (times, closed)
}

/// Whether the final map has the copy where the deception would have it.
fn is_deceived(world: &Simulated, alias: &Alias) -> bool {
    let Some((from, to)) = world.keyframe_at(alias.original).zip(world.keyframe_at(alias.copy)) else {
        return false;
    };
    // The keyframes lie a little beside the two times: by so much, truly.
    let [from_from_original, copy_from_to] =
        [(from, alias.original, false), (to, alias.copy, true)].map(|(keyframe, stamp, back)| {
            let step = world.truth(keyframe).between(world.truth_at(stamp));
            if back { step.inverse() } else { step }
        });
    let deceived = from_from_original * alias.deceived_original_from_copy * copy_from_to;
    let poses = world.keyframe_poses();
    let error = PoseError::of(poses[from].between(poses[to]), deceived);
    error.metres <= DECEIVED_M && error.degrees <= DECEIVED_DEG
}
