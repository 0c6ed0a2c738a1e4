//! Encounters of a pair of robots out of all that they saw of each other.

use crate::dead_reckoning::DeadReckoning;
use crate::hypotheses::{WaitReason, one_answer};
use crate::sighting::{RobotId, Sighting};
use crate::solve::{Mode, Outliers};
use crate::window::{Noise, Wheels, Window};
use mapwright_geom::{Cov3, Pose2, Stamp};

/// Two sightings of each other within this time are mutual, seconds.
const MUTUAL_S: f64 = 1.0;
/// Odometry's heading may err by so much between a sighting and the moment, radians: beyond, its errors are no longer small angles.
const WIDEST_WALK_RAD: f64 = 0.2;
/// Most sightings of a window; more of one sensor within seconds say the same.
const MOST_ENTRIES: usize = 24;
/// Share of sightings that are wrong: another barcode read, another robot seen.
const WRONG_SHARE: f64 = 0.02;
/// A waiting group is tried again when the robots moved by this factor more than at the last trial.
const TRIED_AGAIN_AT: f64 = 1.2;

/// How encounters are made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Two sightings of each other within this time are mutual, seconds.
    pub mutual_s: f64,
    /// Share of sightings that are wrong.
    pub wrong_share: f64,
    /// How wrong odometry and sightings are.
    pub noise: Noise,
}

impl Default for Settings {
    fn default() -> Self {
        Self { mutual_s: MUTUAL_S, wrong_share: WRONG_SHARE, noise: Noise::default() }
    }
}

/// What an encounter was made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Both saw each other within a second.
    Mutual,
    /// One or both saw the other at different times; motion between made the relative pose unique.
    Gathered,
}

/// Two robots' relative pose at a moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Encounter {
    /// The moment.
    pub stamp: Stamp,
    /// Robots, the lower number first.
    pub a: RobotId,
    /// The other.
    pub b: RobotId,
    /// Robot `b` in the frame of robot `a`.
    pub a_from_b: Pose2,
    /// Of its right perturbation: m^2, m rad, rad^2.
    pub covariance: Cov3,
    /// What it was made of.
    pub kind: Kind,
    /// Sightings that went into it.
    pub sightings: usize,
    /// Chi-square of their residuals.
    pub chi2: f64,
    /// Its degrees of freedom.
    pub freedom: usize,
    /// Encounters of one group share sightings: of each group one is independent of all other groups.
    pub group: usize,
    /// The most certain of its group: the one to hand on as a join.
    pub is_join: bool,
}

/// Why a sighting was refused.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum RefusalReason {
    /// Not finite, no measurement, or no standard deviation.
    Unsound,
    /// A robot that sees itself.
    Itself,
    /// One of the two is none of the robots.
    Stranger,
    /// Odometry of one of both does not reach its stamp.
    NoOdometry,
    /// The other sightings contradict it: another barcode, another robot.
    Contradicted,
}

/// What came of the sightings of a pair.
#[derive(Debug, Clone, Default)]
pub struct PairResult {
    /// In the order of their stamps.
    pub encounters: Vec<Encounter>,
    /// Sightings refused, by their place in the pair's list.
    pub refused: Vec<(usize, RefusalReason)>,
    /// Sightings that wait for others, by their place in the pair's list.
    pub waiting: Vec<(usize, WaitReason)>,
    /// Sightings of the pair.
    pub sightings: usize,
}

/// What came of the sightings of several robots.
#[derive(Debug, Clone, Default)]
pub struct Meetings {
    /// Each pair of robots, the lower number first, in order.
    pub pairs: Vec<([RobotId; 2], PairResult)>,
    /// Sightings that belong to no pair, by their place in the list: of robots that nobody knows, or that see themselves.
    pub refused: Vec<(usize, RefusalReason)>,
    /// Sightings that wait for somebody to say whom they are of, by their place in the list.
    pub waiting: Vec<(usize, WaitReason)>,
}

/// All encounters of several robots; each number once.
#[must_use]
pub fn meet_all(robots: &[(RobotId, &DeadReckoning)], sightings: &[Sighting], settings: &Settings) -> Meetings {
    let mut meetings = Meetings::default();
    let is_known = |id: RobotId| robots.iter().any(|(known, _)| *known == id);
    for (place, sighting) in sightings.iter().enumerate() {
        match sighting.observed {
            None => meetings.waiting.push((place, WaitReason::Unidentified)),
            Some(id) if id == sighting.observer => meetings.refused.push((place, RefusalReason::Itself)),
            Some(id) if is_known(id) && is_known(sighting.observer) => {}
            Some(_) => meetings.refused.push((place, RefusalReason::Stranger)),
        }
    }
    let mut sorted = robots.to_vec();
    sorted.sort_by_key(|(id, _)| *id);
    for (place, (a, of_a)) in sorted.iter().enumerate() {
        for (b, of_b) in &sorted[place + 1..] {
            meetings.pairs.push(([*a, *b], meet([*a, *b], sightings, [of_a, of_b], settings)));
        }
    }
    meetings
}

/// All encounters of two robots, `a` the lower number; only sightings of this pair are looked at.
#[must_use]
pub fn meet(
    pair: [RobotId; 2],
    sightings: &[Sighting],
    wheels: [&DeadReckoning; 2],
    settings: &Settings,
) -> PairResult {
    let mut result = PairResult::default();
    let mut table = Table::new(pair, sightings, wheels, settings, &mut result);
    table.mutual(&mut result);
    table.gathered(&mut result);
    table.settle(&mut result);
    result
}

/// What became of a sighting.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Fate {
    Unused,
    Used,
    Contradicted,
    Waiting(WaitReason),
}

/// A sighting with its place in the pair's list.
type Numbered = (usize, Sighting);

/// One pair at work.
struct Table<'a> {
    a: RobotId,
    b: RobotId,
    usable: Vec<Numbered>,
    wheels: Wheels<'a>,
    settings: &'a Settings,
    outliers: Outliers,
    fate: Vec<Fate>,
}

impl<'a> Table<'a> {
    fn new(
        [a, b]: [RobotId; 2],
        sightings: &[Sighting],
        [of_a, of_b]: [&'a DeadReckoning; 2],
        settings: &'a Settings,
        result: &mut PairResult,
    ) -> Self {
        let is_of_pair = |s: &&Sighting| [(a, Some(b)), (b, Some(a))].contains(&(s.observer, s.observed));
        let mut of_pair: Vec<Sighting> = sightings.iter().filter(is_of_pair).copied().collect();
        of_pair.sort_by_key(|sighting| sighting.stamp);
        let wheels = Wheels { of_a, of_b };
        result.sightings = of_pair.len();
        let mut usable = Vec::new();
        for (index, sighting) in of_pair.iter().enumerate() {
            let is_reached = of_a.at(sighting.stamp).is_some() && of_b.at(sighting.stamp).is_some();
            match (sighting.is_sound(), is_reached) {
                (false, _) => result.refused.push((index, RefusalReason::Unsound)),
                (true, false) => result.refused.push((index, RefusalReason::NoOdometry)),
                (true, true) => usable.push((index, *sighting)),
            }
        }
        let farthest_m = usable.iter().filter_map(|(_, s)| s.range_m).fold(1.0, f64::max);
        let outliers = Outliers { share: settings.wrong_share, range_m: farthest_m };
        Self { a, b, usable, wheels, settings, outliers, fate: vec![Fate::Unused; of_pair.len()] }
    }

    /// One encounter for each sighting by `a` beside which there is one by `b`.
    fn mutual(&mut self, result: &mut PairResult) {
        let mut modes = Vec::new();
        for [one, two] in self.mutual_pairs() {
            match self.answer_beside([one, two]) {
                Ok(mode) => {
                    self.mark(&mode);
                    let is_held = |index| !mode.refused.contains(&index);
                    if is_held(one.0) && is_held(two.0) {
                        modes.push(mode);
                    }
                }
                Err(reason) => [one.0, two.0].into_iter().for_each(|index| self.wait(index, reason)),
            }
        }
        self.add(modes, Kind::Mutual, result);
    }

    fn answer_beside(&self, [one, two]: [Numbered; 2]) -> Result<Mode, WaitReason> {
        let stamp = between(one.1.stamp, two.1.stamp);
        let chosen = self.around(stamp, [one.0, two.0]);
        let window = Window::new(self.a, stamp, &chosen, self.wheels).ok_or(WaitReason::Open)?;
        one_answer(&window, &self.settings.noise, &self.outliers)
    }

    /// Each sighting by `a` with a bearing, and the one by `b` nearest to it, if it is near enough.
    fn mutual_pairs(&self) -> Vec<[Numbered; 2]> {
        let has_bearing =
            |of: RobotId| move |(_, sighting): &&Numbered| sighting.observer == of && sighting.bearing_rad.is_some();
        let by_b: Vec<&Numbered> = self.usable.iter().filter(has_bearing(self.b)).collect();
        let mut pairs = Vec::new();
        for one in self.usable.iter().filter(has_bearing(self.a)) {
            let apart_s = |two: &Sighting| two.stamp.secs_since(one.1.stamp).abs();
            let after = by_b.partition_point(|two| two.1.stamp < one.1.stamp);
            let beside = [after.checked_sub(1), Some(after)].into_iter().flatten().filter_map(|k| by_b.get(k));
            let nearest = beside.min_by(|two, other| apart_s(&two.1).total_cmp(&apart_s(&other.1)));
            let has_range = |two: &Sighting| one.1.range_m.or(two.range_m).is_some();
            if let Some(two) = nearest.filter(|two| apart_s(&two.1) <= self.settings.mutual_s && has_range(&two.1)) {
                pairs.push([*one, **two]);
            }
        }
        pairs
    }

    /// For how long odometry connects sightings, seconds.
    fn reach_s(&self) -> f64 {
        let per_s = self.settings.noise.odometry.heading_rad2_per_s;
        if per_s > 0.0 { (WIDEST_WALK_RAD * WIDEST_WALK_RAD / per_s).min(600.0) } else { 600.0 }
    }

    /// Sightings around a moment, the denser the nearer, and those that must be there.
    fn around(&self, stamp: Stamp, always: [usize; 2]) -> Vec<Numbered> {
        let reach_s = self.reach_s();
        let near = |(_, sighting): &&Numbered| sighting.stamp.secs_since(stamp).abs() <= reach_s;
        let mut by_time: Vec<Numbered> = self.usable.iter().filter(near).copied().collect();
        let apart_s = |sighting: &Sighting| sighting.stamp.secs_since(stamp);
        by_time.sort_by(|one, two| apart_s(&one.1).abs().total_cmp(&apart_s(&two.1).abs()));
        let half_life_s = self.settings.noise.likeness.half_life_s;
        let mut chosen: Vec<Numbered> = Vec::new();
        for (index, sighting) in by_time {
            let at_s = apart_s(&sighting);
            let spacing_s = (0.5 * at_s.abs()).min(0.5 * half_life_s);
            let is_close =
                |other: &Sighting| other.observer == sighting.observer && (apart_s(other) - at_s).abs() < spacing_s;
            let is_needed = always.contains(&index);
            if is_needed || chosen.len() < MOST_ENTRIES && !chosen.iter().any(|(_, other)| is_close(other)) {
                chosen.push((index, sighting));
            }
        }
        chosen.sort_by_key(|(index, _)| *index);
        chosen
    }

    /// What lies between the sightings of a window says the same as they do.
    fn mark(&mut self, mode: &Mode) {
        let indices = || mode.window.entries.iter().map(|entry| entry.index);
        if let (Some(first), Some(last)) = (indices().min(), indices().max()) {
            for fate in &mut self.fate[first..=last] {
                *fate = if matches!(fate, Fate::Contradicted) { *fate } else { Fate::Used };
            }
        }
        indices().for_each(|index| self.fate[index] = Fate::Used);
        for index in &mode.refused {
            self.fate[*index] = Fate::Contradicted;
        }
    }

    fn wait(&mut self, index: usize, reason: WaitReason) {
        if matches!(self.fate[index], Fate::Unused | Fate::Waiting(_)) {
            self.fate[index] = Fate::Waiting(reason);
        }
    }

    /// What is left is gathered until it has one answer; what odometry no longer connects goes on waiting.
    fn gathered(&mut self, result: &mut PairResult) {
        let left: Vec<Numbered> = self.usable.iter().filter(|(index, _)| self.is_free(*index)).copied().collect();
        let (mut group, mut tried_m, mut modes) = (Vec::new(), 0.0, Vec::new());
        let reach_s = self.reach_s();
        for next in left {
            let is_connected = |(_, old): &Numbered| next.1.stamp.secs_since(old.stamp) <= reach_s;
            group.retain(is_connected);
            group.push(next);
            let moved_m = self.moved_m(&group);
            self.wait(next.0, WaitReason::LittleMotion { moved_m });
            if moved_m < self.least_motion_m(&group) || moved_m < TRIED_AGAIN_AT * tried_m {
                continue;
            }
            match self.try_group(&group, next.1.stamp) {
                Ok(mode) => {
                    self.mark(&mode);
                    modes.push(mode);
                    (group, tried_m) = (Vec::new(), 0.0);
                }
                Err(reason) => {
                    tried_m = moved_m;
                    group.iter().for_each(|(index, _)| self.wait(*index, reason));
                }
            }
        }
        self.add(modes, Kind::Gathered, result);
    }

    /// Not in a mutual encounter, nor so near to one that this says it all.
    fn is_free(&self, index: usize) -> bool {
        matches!(self.fate[index], Fate::Unused | Fate::Waiting(_))
    }

    fn try_group(&self, group: &[Numbered], stamp: Stamp) -> Result<Mode, WaitReason> {
        let thinned = thinned(group);
        let window = Window::new(self.a, stamp, &thinned, self.wheels).ok_or(WaitReason::Open)?;
        one_answer(&window, &self.settings.noise, &self.outliers)
    }

    /// How far the robots drove between the first and the last sighting: that of them that did more.
    fn moved_m(&self, group: &[Numbered]) -> f64 {
        let (Some((_, first)), Some((_, last))) = (group.first(), group.last()) else { return 0.0 };
        let way_m = |wheels: &DeadReckoning| {
            let ends = wheels.at(first.stamp).zip(wheels.at(last.stamp));
            ends.map_or(0.0, |(from, to)| from.odom_from_robot.distance(to.odom_from_robot))
        };
        way_m(self.wheels.of_a).max(way_m(self.wheels.of_b))
    }

    /// Over less the sightings' own errors turn the way by more than is near to certain.
    fn least_motion_m(&self, group: &[Numbered]) -> f64 {
        let across_m = |sighting: &Sighting| match sighting.bearing_rad {
            Some(_) => sighting.bearing_sigma_rad * sighting.range_m.unwrap_or(1.0),
            None => sighting.range_sigma_m,
        };
        group.iter().map(|(_, sighting)| across_m(sighting)).fold(f64::INFINITY, f64::min) / 0.35
    }

    /// Encounters that share a sighting are of one group.
    fn add(&self, modes: Vec<Mode>, kind: Kind, result: &mut PairResult) {
        let (mut group, mut last_of_group) = (result.encounters.last().map_or(0, |e| e.group + 1), None);
        for mode in modes {
            let indices = || mode.window.entries.iter().map(|entry| entry.index);
            let (first, last) = (indices().min(), indices().max());
            if last_of_group.is_some() && first > last_of_group {
                group += 1;
            }
            last_of_group = last_of_group.max(last);
            result.encounters.push(Encounter {
                stamp: mode.window.stamp,
                a: self.a,
                b: self.b,
                a_from_b: mode.a_from_b,
                covariance: mode.covariance,
                kind,
                sightings: mode.window.entries.len(),
                chi2: mode.chi2,
                freedom: mode.freedom,
                group,
                is_join: false,
            });
        }
    }

    fn settle(self, result: &mut PairResult) {
        for (index, fate) in self.fate.iter().enumerate() {
            match fate {
                Fate::Contradicted => result.refused.push((index, RefusalReason::Contradicted)),
                Fate::Waiting(reason) => result.waiting.push((index, *reason)),
                Fate::Used | Fate::Unused => {}
            }
        }
        result.refused.sort_unstable();
        result.encounters.sort_by_key(|encounter| encounter.stamp);
        choose_joins(&mut result.encounters);
    }
}

/// The most certain encounter of each group.
fn choose_joins(encounters: &mut [Encounter]) {
    let groups = encounters.iter().map(|encounter| encounter.group + 1).max().unwrap_or(0);
    let mut best: Vec<Option<usize>> = vec![None; groups];
    for (place, encounter) in encounters.iter().enumerate() {
        let spread = |place: usize| encounters[place].covariance.determinant();
        let best = &mut best[encounter.group];
        if best.is_none_or(|known| encounter.covariance.determinant() < spread(known)) {
            *best = Some(place);
        }
    }
    best.into_iter().flatten().for_each(|place| encounters[place].is_join = true);
}

/// The stamp in the middle of two.
fn between(one: Stamp, two: Stamp) -> Stamp {
    Stamp(one.0 + (two.0.saturating_sub(one.0)) / 2)
}

/// At most so many of a group, evenly, with its ends.
fn thinned(group: &[Numbered]) -> Vec<Numbered> {
    if group.len() <= MOST_ENTRIES {
        return group.to_vec();
    }
    let last = group.len() - 1;
    (0..MOST_ENTRIES).map(|k| group[k * last / (MOST_ENTRIES - 1)]).collect()
}
