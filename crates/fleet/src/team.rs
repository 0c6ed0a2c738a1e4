//! One map of all robots.

use crate::chain::Chain;
use crate::inbox::{Inbox, News, pack};
use crate::intent::Intent;
use crate::message::Refusal;
use crate::node::{Node, Outgoing};
use crate::record::{ChainId, Kind};
use crate::sightings::SightedRobot;
use crate::solution::{Replay, Solutions};
use crate::steps::{Begin, SolutionId, Step};
use mapwright::{
    Adoption, Audit, Cov3, Entry, Mapper, Pose2, RecordedEdge, RunId, Session, Settings, SettingsError, Stamp, Update,
    WaysSeen, audit,
};
use mapwright_record::LogWriter;
use std::collections::BTreeMap;

/// What was mapped is told after so many keyframes, or so many seconds.
const TOLD_KEYFRAMES: usize = 4;
const TOLD_S: f64 = 2.0;
/// Poses are told in steps of a metre or a radian divided by this: 2^20.
const POSE_STEPS: f64 = 1_048_576.0;
/// Bytes of steps that make a record of the solution.
const STEPS_BYTES: usize = 1 << 15;
/// Bytes of steps in one record at most.
const STEPS_AT_MOST: usize = 1 << 19;
/// Corrections take at most this share of what is told.
const SNAPSHOTS: f64 = 0.2;
/// Keyframes that are taken in of one robot before it is another one's turn.
const TURN: usize = 8;
/// A step that waits for records which nobody has sent for so long is given up, seconds.
const BLOCKED_S: f64 = 10.0;
/// What the mapper of all is called.
const TEAM: &str = "the team";
/// When nothing has come for so long, the poses are handed out as they are, seconds,
const SETTLED_S: f64 = 5.0;
/// and old places are looked for anew.
const LOOKED_AGAIN_S: f64 = 10.0;
/// When it has said nothing new for so long, others look at what the robot that solves has found, seconds.
const AUDITED_S: f64 = 8.0;
/// and keyframes may lie so far from where they have them, metres: as far as two findings that agree.
const MOVED_AT_MOST_M: f64 = 0.2;
/// Of so many keyframes one may be called contradicted by mistake: where a robot's readings and its ways disagree a little the map as it is now
/// bears out what it did not when the keyframe was taken in.
const CONTRADICTED_OF: usize = 100;

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
    /// What robots said of their ways beside what they saw, as far as it was compared here.
    ways: WaysSeen,
    falsify: Option<fn(&mut Entry)>,
}

/// A solution that is read as its records come.
struct Followed {
    replay: Replay,
    /// When its map has changed last, how many sightings there were then, and whether it was looked at since.
    changed: Stamp,
    sightings: usize,
    is_audited: bool,
}

impl Followed {
    fn new(replay: Replay, now: Stamp, inbox: &Inbox) -> Self {
        Self { replay, changed: now, sightings: inbox.sightings(), is_audited: true }
    }

    /// Whether nothing new has come for a while, and it was not looked at since.
    fn is_due(&self, now: Stamp) -> bool {
        !self.is_audited && (self.replay.is_settled || now.secs_since(self.changed) >= AUDITED_S)
    }

    /// Whether readings bear out what it says.
    fn is_true(&mut self, settings: &Settings, ways: &mut WaysSeen) -> bool {
        self.is_audited = true;
        let Audit { closures, contradictions, moved_m } = audit(settings, self.replay.session(), ways);
        let are_most = |[all, wrong]: [usize; 2]| 2 * wrong > all;
        let are_many = CONTRADICTED_OF * contradictions[1] > self.replay.session().keyframes().len();
        let is_moved = moved_m.is_none_or(|moved_m| moved_m > MOVED_AT_MOST_M);
        !are_most(closures) && !(are_most(contradictions) && are_many) && !is_moved
    }

    /// Whether there is nothing to add to it.
    fn is_complete(&self, inbox: &Inbox) -> bool {
        let has_all = |(chain, groups): (ChainId, usize)| self.replay.taken.get(&chain).copied().unwrap_or(0) == groups;
        self.replay.is_settled && self.sightings == inbox.sightings() && inbox.groups().all(has_all)
    }
}

/// The solution that this robot works on.
struct Solving {
    id: SolutionId,
    mapper: Mapper,
    writer: LogWriter,
    adoptions: BTreeMap<ChainId, Adoption>,
    taken: BTreeMap<ChainId, usize>,
    /// Whose turn it is.
    turn: ChainId,
    steps: Vec<u8>,
    /// What was refused of whom, once each.
    refused: Vec<(Refusal, u16)>,
    /// How many sightings and keyframes there were when joins were last made of them.
    met: [usize; 2],
    last_new: Stamp,
    last_said: Option<Stamp>,
    is_settled: bool,
    has_looked_again: bool,
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
        if self.node.leader(now) == Some(self.node.me().rank) {
            has_worked |= self.solve(now, keyframes);
        } else {
            self.stop_solving();
        }
        has_worked
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

    /// Whether the map of all was looked at as it is, where it is another robot that solves.
    #[must_use]
    pub fn has_audited(&self) -> bool {
        let is_own = |followed: &Followed| followed.replay.id.chain.rank == self.node.me().rank;
        self.followed.as_ref().is_none_or(|followed| is_own(followed) || followed.is_audited)
    }

    /// For simulations of robots that lie: what this one finds as the robot that solves goes through here before it is told.
    pub fn falsify(&mut self, falsify: fn(&mut Entry)) {
        self.falsify = Some(falsify);
        self.solving.iter_mut().for_each(|solving| solving.falsify = Some(falsify));
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
        if self.followed.as_ref().is_some_and(|followed| followed.is_complete(&self.inbox)) {
            return false;
        }
        let Some((mapper, base)) = self.mapper_of_solution(now) else { return false };
        let (adoptions, taken) =
            self.replay().map(|known| (known.adoptions.clone(), known.taken.clone())).unwrap_or_default();
        let Some(id) = self.say_begin(base) else { return false };
        let writer = self
            .replay()
            .map_or_else(|| LogWriter::resume(&Session::default()), |known| LogWriter::resume(known.session()));
        let writer = writer.with_snapshots_of(SNAPSHOTS);
        let mut solving = Solving {
            id,
            mapper,
            writer,
            adoptions,
            taken,
            // The first robot's keyframes come first: the frame is its own.
            turn: ChainId { rank: u16::MAX, session: u32::MAX },
            steps: Vec::new(),
            refused: Vec::new(),
            met: [0; 2],
            last_new: now,
            last_said: None,
            // What the one before has not told yet, of poses that its closures have moved, this one has to tell.
            is_settled: false,
            has_looked_again: false,
            falsify: self.falsify,
        };
        let update = solving.mapper.news();
        solving.find(&update.entries);
        self.solving = Some(solving);
        true
    }

    /// Says that a solution begins that goes on with another one. Where that is not the one of the highest term, of which records are missing, one
    /// follows on the other until it is.
    fn say_begin(&mut self, mut base: Option<(SolutionId, u32)>) -> Option<SolutionId> {
        let best = self.solutions.best(|rank| self.node.is_trusted(rank)).map_or(0, |(_, begin)| begin.term);
        let mut term = base.and_then(|(id, _)| self.solutions.get(id)).map_or(0, |begin| begin.term);
        let chain = self.node.me();
        for begun in 0.. {
            term = term.checked_add(1)?;
            let id = SolutionId { chain, begin: self.node.chains().get(&chain).map_or(0, Chain::next) };
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

/// An entry as others are told it: poses to a millionth of a metre, information and covariances in single precision. More is noise, and
/// takes most of a message.
fn rounded(entry: &Entry) -> Entry {
    let mut entry = entry.clone();
    match &mut entry {
        Entry::Keyframe { map_from_keyframe, .. } => round_pose(map_from_keyframe),
        Entry::Edge(RecordedEdge { edge, .. }) => {
            round_pose(&mut edge.from_from_to);
            round_matrix(&mut edge.information);
        }
        Entry::Remeasured { from_from_to, information, .. } => {
            round_pose(from_from_to);
            round_matrix(information);
        }
        Entry::Candidate(candidate) => {
            candidate.from_from_to.iter_mut().for_each(round_pose);
            round_matrix(&mut candidate.covariance);
        }
        Entry::Snapshot(snapshot) => snapshot.map_from_keyframe.iter_mut().for_each(|(_, pose)| round_pose(pose)),
        _ => {}
    }
    entry
}

fn round_pose(pose: &mut Pose2) {
    for number in [&mut pose.x, &mut pose.y, &mut pose.theta] {
        *number = (*number * POSE_STEPS).round() / POSE_STEPS;
    }
}

fn round_matrix(matrix: &mut Cov3) {
    matrix.iter_mut().for_each(|number| *number = f64::from(*number as f32));
}

impl Solving {
    /// Takes in so many keyframes, of each robot some in turn; whether there was anything to do.
    fn work(&mut self, inbox: &Inbox, now: Stamp, keyframes: usize) -> bool {
        let mut left = keyframes;
        while left > 0
            && let Some(chain) = self.next_chain(inbox)
        {
            let first = self.taken.get(&chain).copied().unwrap_or(0);
            for number in first..first + TURN.min(left) {
                let Some(group) = inbox.group(chain, number) else { break };
                self.take_in(chain, group);
                left -= 1;
            }
            (self.last_new, self.is_settled, self.has_looked_again) = (now, false, false);
        }
        if self.meet(inbox) {
            (self.last_new, self.is_settled, self.has_looked_again) = (now, false, false);
        }
        let still_s = now.secs_since(self.last_new);
        if left < keyframes || still_s < SETTLED_S {
            return left < keyframes;
        }
        if !self.has_looked_again && still_s >= LOOKED_AGAIN_S {
            (self.has_looked_again, self.is_settled) = (true, false);
            let update = self.mapper.look_again();
            self.find(&update.entries);
        }
        if !self.is_settled {
            self.is_settled = true;
            let mut found = Vec::new();
            self.writer.finish(&mut found);
            self.put_found(&found);
            if self.has_looked_again {
                Step::Settled.put(&mut self.steps);
            }
            return true;
        }
        false
    }

    /// The next chain in turn of which something is left.
    fn next_chain(&mut self, inbox: &Inbox) -> Option<ChainId> {
        let has_more = |&(chain, groups): &(ChainId, usize)| groups > self.taken.get(&chain).copied().unwrap_or(0);
        let after = inbox.groups().filter(has_more).find(|(chain, _)| *chain > self.turn);
        let (chain, _) = after.or_else(|| inbox.groups().find(has_more))?;
        self.turn = chain;
        Some(chain)
    }

    fn take_in(&mut self, chain: ChainId, group: &[Entry]) {
        let adopted = self.mapper.adopt(group, self.adoptions.entry(chain).or_default());
        *self.taken.entry(chain).or_default() += 1;
        self.refused.extend(std::iter::repeat_n((Refusal::Unfitting, chain.rank), adopted.refused));
        let contradicted = usize::from(adopted.is_contradicted) + adopted.contradicted;
        self.refused.extend(std::iter::repeat_n((Refusal::Contradicted, chain.rank), contradicted));
        Step::TakeIn(chain, adopted.map_from_keyframe).put(&mut self.steps);
        let (own, found) = adopted.update.entries.split_at(adopted.own.min(adopted.update.entries.len()));
        for entry in own {
            // What the session has taken the writer takes as well.
            let _ = self.writer.skip(entry);
        }
        self.find(found);
    }

    /// Joins maps of robots that saw each other; whether there was anything to join.
    fn meet(&mut self, inbox: &Inbox) -> bool {
        let known = [inbox.sightings(), self.mapper.keyframes().len()];
        if known[0] == 0 || self.met == known {
            return false;
        }
        self.met = known;
        let mut has_met = false;
        for join in inbox.joins() {
            let update = self.mapper.sighted(&join);
            has_met |= !update.entries.is_empty();
            self.find(&update.entries);
        }
        has_met
    }

    fn find(&mut self, entries: &[Entry]) {
        let mut found = Vec::new();
        for entry in entries {
            let mut entry = entry.clone();
            self.falsify.iter().for_each(|falsify| falsify(&mut entry));
            let _ = self.writer.append(&mut found, &entry);
        }
        self.put_found(&found);
    }

    fn put_found(&mut self, found: &[u8]) {
        if !found.is_empty() {
            Step::Found(found).put(&mut self.steps);
        }
    }

    /// The steps that are due to be told.
    fn take_steps(&mut self, now: Stamp) -> Vec<Vec<u8>> {
        let is_due = self.steps.len() >= STEPS_BYTES
            || self.last_said.is_none_or(|last| now.secs_since(last) >= TOLD_S)
            || self.is_settled;
        if self.steps.is_empty() || !is_due {
            return Vec::new();
        }
        self.last_said = Some(now);
        std::mem::take(&mut self.steps).chunks(STEPS_AT_MOST).map(<[u8]>::to_vec).collect()
    }
}
