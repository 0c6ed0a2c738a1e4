//! One map of all robots.

use crate::chain::Chain;
use crate::inbox::{Inbox, News, pack};
use crate::intent::Intent;
use crate::message::Refusal;
use crate::node::{Node, Outgoing};
use crate::record::Kind;
use crate::sightings::SightedRobot;
use crate::solution::{Replay, Solutions};
use crate::steps::{Begin, SolutionId, Step};
use followed::Followed;
use mapwright::{Entry, Mapper, Pose2, RunId, Session, Settings, SettingsError, Stamp, Update, WaysSeen};
use mapwright_record::LogWriter;
use rounding::rounded;
use solving::Solving;
use std::collections::BTreeMap;

mod followed;
mod rounding;
mod solving;

/// What was mapped is told after so many keyframes, or so many seconds.
const TOLD_KEYFRAMES: usize = 4;
const TOLD_S: f64 = 2.0;
/// A step that waits for records which nobody has sent for so long is given up, seconds.
const BLOCKED_S: f64 = 10.0;
/// Where the robot that is to solve has taken in nothing of what is there for so long, the next one does, seconds.
const IDLE_S: f64 = 30.0;
/// What the mapper of all is called.
const TEAM: &str = "the team";

/// A robot's part in a team: what it maps is told, and what all have mapped becomes one map.
///
/// Hand in every [`Update`] of the robot's mapper ([`Team::tell`]), every message that comes ([`Team::receive`]), and send what
/// [`Team::poll`] gives. [`Team::work`] does what may take longer: of the robot that solves, the search for places among the maps of others.
pub struct Team {
    node: Node,
    settings: Settings,
    writer: LogWriter,
    untold: Vec<u8>,
    untold_keyframes: usize,
    untold_since: Option<Stamp>,
    /// Entries that could not be told, for they are more than a robot may say.
    unsaid: u64,
    inbox: Inbox,
    solutions: Solutions,
    /// The one that counts,
    followed: Option<Followed>,
    /// and those of robots that are not believed, by their places in the roster: more of their records may bear them out.
    doubted: BTreeMap<u16, Followed>,
    solving: Option<Solving>,
    blocked_since: Option<Stamp>,
    /// How much the solution that counts had taken in when it last took in something, or nothing was left, and when that was.
    progress: (usize, Stamp),
    /// What robots said of their ways beside what they saw, as far as it was compared here.
    ways: WaysSeen,
    falsify: Option<fn(&mut Entry)>,
}

impl Team {
    /// A robot that maps with these settings.
    ///
    /// # Errors
    /// A setting outside its range.
    pub fn new(node: Node, settings: Settings) -> Result<Self, SettingsError> {
        settings.validate()?;
        Ok(Self {
            settings,
            writer: LogWriter::resume(&Session::default()),
            untold: Vec::new(),
            untold_keyframes: 0,
            untold_since: None,
            unsaid: 0,
            inbox: Inbox::new(node.roster()),
            solutions: Solutions::default(),
            followed: None,
            doubted: BTreeMap::new(),
            solving: None,
            blocked_since: None,
            progress: (0, Stamp(0)),
            ways: WaysSeen::default(),
            falsify: None,
            node,
        })
    }

    /// The protocol's side.
    #[must_use]
    pub fn node(&self) -> &Node {
        &self.node
    }

    /// Entries of this robot that others will never hear of, for they are more than a robot may say.
    #[must_use]
    pub fn unsaid(&self) -> u64 {
        self.unsaid
    }

    /// Whether this robot solves.
    #[must_use]
    pub fn is_solving(&self) -> bool {
        self.solving.is_some()
    }

    /// Tells what the robot's mapper has said. Where it was at scans between keyframes, and corrections of its own, are of no use to others.
    pub fn tell(&mut self, now: Stamp, update: &Update) {
        for entry in &update.entries {
            match entry {
                Entry::Scan(_) | Entry::OdometryOrigin(_) | Entry::Snapshot(_) | Entry::Checkpoint(_) => continue,
                Entry::Keyframe { .. } => self.untold_keyframes += 1,
                _ => {}
            }
            if self.writer.append(&mut self.untold, &rounded(entry)).is_err() {
                self.unsaid += 1;
            }
            self.untold_since.get_or_insert(now);
        }
        if self.untold_keyframes >= TOLD_KEYFRAMES {
            self.say();
        }
    }

    fn say(&mut self) {
        let untold = std::mem::take(&mut self.untold);
        (self.untold_keyframes, self.untold_since) = (0, None);
        if !untold.is_empty() && !self.node.publish(Kind::Entries, pack(&untold)) {
            self.unsaid += 1;
        }
    }

    /// Takes in a message.
    pub fn receive(&mut self, now: Stamp, bytes: &[u8]) {
        self.node.receive(now, bytes);
    }

    /// What is to be sent now; asked often, some ten times a second.
    pub fn poll(&mut self, now: Stamp) -> Vec<Outgoing> {
        if self.untold_since.is_some_and(|since| now.secs_since(since) >= TOLD_S) {
            self.say();
        }
        self.node.poll(now)
    }

    /// Tells what the robot saw of others of the team. Where both of two saw each other within a second, their maps become one.
    pub fn tell_sightings(&mut self, sightings: &[SightedRobot]) {
        let mut payload = Vec::new();
        sightings.iter().for_each(|seen| seen.put(&mut payload));
        if !payload.is_empty() && !self.node.publish(Kind::Sightings, pack(&payload)) {
            self.unsaid += 1;
        }
    }

    /// Says with each beat where the robot is and where it goes.
    pub fn tell_intent(&mut self, intent: &Intent) {
        self.node.set_note(intent.encode());
    }

    /// Where the others that are alive are and where they go, by their places in the roster, and when they said so. What cannot be read is left out.
    pub fn intents(&self, now: Stamp) -> impl Iterator<Item = (u16, Stamp, Intent)> {
        let robot = |rank: u16| self.node.roster().name(rank).map(|name| RunId::of_robot(name).robot);
        self.node
            .notes(now)
            .filter_map(move |(rank, heard, note)| Some((rank, heard, Intent::decode(note, robot(rank)?)?)))
    }

    /// Says what is left to be said, where nothing more will come.
    pub fn finish(&mut self) {
        self.say();
    }

    /// The map of all robots, as far as it is known here.
    #[must_use]
    pub fn map(&self) -> Option<&Session> {
        self.replay().map(Replay::session)
    }

    fn replay(&self) -> Option<&Replay> {
        self.followed.as_ref().map(|followed| &followed.replay)
    }

    /// Where the robot's own map lies in the map of all: by the newest keyframe that is in both. None until one is.
    #[must_use]
    pub fn map_from_own(&self, own: &Session) -> Option<Pose2> {
        let map = self.map()?;
        let places = own.keyframes().iter().zip(own.map_from_keyframe()).rev();
        let mut known = places.filter_map(|(keyframe, own)| Some((map.place(keyframe.id)?, *own)));
        known.next().and_then(|(place, own)| Some(*map.map_from_keyframe().get(place)? * own.inverse()))
    }

    /// Reads what has come, and, where it is this robot that solves, takes in so many keyframes; whether there was anything to do.
    pub fn work(&mut self, now: Stamp, keyframes: usize) -> bool {
        let News { begun, refused } = self.inbox.read(self.node.chains());
        begun.into_iter().for_each(|(id, begin)| self.solutions.add(id, begin));
        refused.into_iter().for_each(|(why, of)| self.node.refuse(why, of));
        let mut has_worked = self.follow(now);
        has_worked |= self.audit(now);
        has_worked |= self.doubt_again(now);
        self.watch(now);
        if self.node.leader(now) == Some(self.node.me().rank) {
            has_worked |= self.solve(now, keyframes);
        } else {
            self.stop_solving();
        }
        has_worked
    }

    /// Passes over the robot that is to solve where it does not.
    fn watch(&mut self, now: Stamp) {
        let of = self.replay().map(|replay| (replay.id.chain.rank, &replay.taken));
        let taken = |chain| of.and_then(|(_, taken)| taken.get(&chain).copied()).unwrap_or(0);
        let is_any_left = self.inbox.groups().any(|(chain, groups)| groups > taken(chain));
        let (before, since) = self.progress;
        let all = of.map_or(0, |(_, taken)| taken.values().sum());
        if all > before || !is_any_left {
            let solves = of.filter(|_| all > before).map(|(rank, _)| rank);
            self.progress = (all, now);
            solves.into_iter().for_each(|rank| self.node.lead_again(rank));
        } else if now.secs_since(since) >= IDLE_S {
            self.progress = (all, now);
            let me = self.node.me().rank;
            self.node.leader(now).filter(|rank| *rank != me).into_iter().for_each(|rank| self.node.pass_over(rank));
        }
    }

    /// Reads the solution that counts.
    fn follow(&mut self, now: Stamp) -> bool {
        let best = self.solutions.best(|rank| self.node.is_trusted(rank));
        let before = self.followed.take();
        let (followed, has_changed) = self.read_on(best, before, now);
        self.followed = followed;
        has_changed
    }

    /// Reads a solution, from its beginning where it is another one than before; whether that changed its map.
    fn read_on(
        &mut self,
        solution: Option<(SolutionId, Begin)>,
        before: Option<Followed>,
        now: Stamp,
    ) -> (Option<Followed>, bool) {
        let Some((id, begin)) = solution else { return (before, false) };
        let new = || {
            let replay = self.solutions.replay(id, &begin)?;
            Some(Followed::new(replay, now, &self.inbox))
        };
        let Some(mut followed) = before.filter(|before| before.replay.id == id).or_else(new) else {
            return (None, false);
        };
        match followed.replay.advance(&self.solutions, &self.inbox) {
            Ok(has_changed) => {
                if has_changed {
                    followed.changed = now;
                    (followed.sightings, followed.is_audited) = (self.inbox.sightings(), false);
                }
                (Some(followed), has_changed)
            }
            Err(_) => {
                self.node.refuse(Refusal::BadPayload, Some(id.chain.rank));
                self.solutions.break_off(id);
                (None, true)
            }
        }
    }

    /// Looks at what another robot has found, once that has said nothing new for a while; whether that was refused. All who hold the same records come
    /// to the same result.
    fn audit(&mut self, now: Stamp) -> bool {
        let me = self.node.me().rank;
        let Some(followed) = self.followed.as_mut().filter(|followed| followed.replay.id.chain.rank != me) else {
            return false;
        };
        let is_untrue = followed.is_due(now) && !followed.is_true(&self.settings, &mut self.ways);
        if is_untrue && let Some(followed) = self.followed.take() {
            let of = followed.replay.id.chain.rank;
            self.node.distrust(of);
            self.doubted.insert(of, followed);
        }
        is_untrue
    }

    /// Reads on what robots find that are not believed, and looks at it again: records that had not come yet may bear it out. Whether any of them is
    /// believed again.
    fn doubt_again(&mut self, now: Stamp) -> bool {
        let mut is_any_true = false;
        for of in self.doubted.keys().copied().collect::<Vec<_>>() {
            let best = self.solutions.best(|rank| rank == of);
            let before = self.doubted.remove(&of);
            let Some(mut followed) = self.read_on(best, before, now).0 else { continue };
            if followed.is_due(now) && followed.is_true(&self.settings, &mut self.ways) {
                self.node.trust(of);
                self.followed = Some(followed);
                is_any_true = true;
            } else {
                self.doubted.insert(of, followed);
            }
        }
        is_any_true
    }

    /// Whether the map of all was looked at as it is, or this robot has nothing to add to it, where it is its own.
    #[must_use]
    pub fn has_audited(&self) -> bool {
        let is_own = |followed: &Followed| followed.replay.id.chain.rank == self.node.me().rank;
        self.followed
            .as_ref()
            .is_none_or(|followed| if is_own(followed) { followed.replay.is_settled } else { followed.is_audited })
    }

    /// For simulations of robots that lie: what this one finds as the robot that solves goes through here before it is told.
    pub fn falsify(&mut self, falsify: fn(&mut Entry)) {
        self.falsify = Some(falsify);
        self.solving.iter_mut().for_each(|solving| solving.falsify = Some(falsify));
    }

    /// For simulations of robots that lie: begins a solution of the next term that goes on with the one that counts, without what was found last.
    pub fn outbid(&mut self) {
        if let Some((id, Begin { term, .. })) = self.solutions.best(|_| true) {
            let mut steps = Vec::new();
            Step::Begin(Begin { term: term.saturating_add(1), base: Some((id, id.begin + 1)) }).put(&mut steps);
            self.node.publish(Kind::Solution, pack(&steps));
        }
    }

    fn solve(&mut self, now: Stamp, keyframes: usize) -> bool {
        let best = self.solutions.best(|rank| self.node.is_trusted(rank)).map(|(id, _)| id);
        let is_current = |solving: &Solving| best == Some(solving.id) || !self.solutions.has(solving.id);
        if self.solving.as_ref().is_some_and(is_current) {
            // It goes on.
        } else if !self.begin(now) {
            return false;
        }
        let Some(solving) = &mut self.solving else { return false };
        let has_worked = solving.work(&self.inbox, now, keyframes);
        for (why, rank) in solving.refused.drain(..) {
            self.node.refuse(why, Some(rank));
        }
        for steps in solving.take_steps(now) {
            self.node.publish(Kind::Solution, pack(&steps));
        }
        has_worked
    }

    fn stop_solving(&mut self) {
        if let Some(mut solving) = self.solving.take() {
            self.ways = solving.mapper.take_ways();
        }
    }

    /// Goes on with the solution that counts; where a step of it waits for what nobody may have any more, after a while with what was before.
    fn begin(&mut self, now: Stamp) -> bool {
        self.stop_solving();
        let may_begin = self.solutions.may_begin(self.next_solution(), 0);
        if !may_begin || self.followed.as_ref().is_some_and(|followed| followed.is_complete(&self.inbox)) {
            return false;
        }
        let Some((mapper, base)) = self.mapper_of_solution(now) else { return false };
        let Some(id) = self.say_begin(base) else { return false };
        let known = self.followed.as_ref().map(|followed| &followed.replay);
        self.solving = Some(Solving::new(id, mapper, known, now, self.falsify));
        true
    }

    /// The one that this robot's next record would begin.
    fn next_solution(&self) -> SolutionId {
        let chain = self.node.me();
        SolutionId { chain, begin: self.node.chains().get(&chain).map_or(0, Chain::next) }
    }

    /// Says that a solution begins that goes on with another one. Where that is not the one of the highest term, of which records are missing, one
    /// follows on the other until it is.
    fn say_begin(&mut self, mut base: Option<(SolutionId, u32)>) -> Option<SolutionId> {
        let best = self.solutions.best(|rank| self.node.is_trusted(rank)).map_or(0, |(_, begin)| begin.term);
        let mut term = base.and_then(|(id, _)| self.solutions.get(id)).map_or(0, |begin| begin.term);
        for begun in 0.. {
            term = term.checked_add(1)?;
            let id = self.next_solution();
            self.solutions.may_begin(id, begun).then_some(())?;
            let mut steps = Vec::new();
            Step::Begin(Begin { term, base }).put(&mut steps);
            self.node.publish(Kind::Solution, pack(&steps)).then_some(())?;
            if term > best {
                return Some(id);
            }
            base = Some((id, id.begin.checked_add(1)?));
        }
        None
    }

    /// A mapper that goes on with the solution that counts, and how far that was read.
    fn mapper_of_solution(&mut self, now: Stamp) -> Option<(Mapper, Option<(SolutionId, u32)>)> {
        let Some(Followed { replay, .. }) = &self.followed else {
            let mut mapper = Mapper::of_run(self.settings, RunId::of_robot(TEAM), Pose2::IDENTITY).ok()?;
            mapper.weigh_ways(std::mem::take(&mut self.ways));
            return Some((mapper, None));
        };
        let Some(reached) = replay.reached() else {
            let since = *self.blocked_since.get_or_insert(now);
            if now.secs_since(since) >= BLOCKED_S {
                self.blocked_since = None;
                self.followed = replay.before_block().map(|replay| Followed::new(replay, now, &self.inbox));
            }
            return None;
        };
        self.blocked_since = None;
        let mut mapper = Mapper::resume(self.settings, replay.session().clone()).ok()?;
        mapper.weigh_ways(std::mem::take(&mut self.ways));
        Some((mapper, Some(reached)))
    }
}
