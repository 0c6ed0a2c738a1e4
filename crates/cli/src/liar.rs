//! A robot that lies: its own map is right, what it tells the others is not.

use mapwright::{EdgeKind, Entry, Keyframe, Pose2, RecordedEdge, Session, Sweep, Update};
use mapwright_sensor::BEAM_NO_RETURN;
use mapwright_sim::{Rng, Site, worlds};
use std::f64::consts::FRAC_PI_6;
use std::sync::Arc;

/// What a robot lies about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Lie {
    /// It says that it is 10 m away from where it is; all that it says of its way since, closures too, leads there.
    Offset,
    /// It says that it has turned by 30 degrees more than it has.
    Rotation,
    /// It says that it drives a tenth farther than it does.
    Scaled,
    /// It says that it sees what it saw when it began to drive.
    Replay,
    /// It says that it sees a building that is not there.
    Forged,
    /// As the robot that solves it says that closures, and half of all keyframes, lie 10 m from where they are.
    Solution,
    /// It begins one solution after the other, each of the next term, that leaves out what was found last: at every step.
    Outbid,
}

impl Lie {
    pub(crate) const ALL: [Self; 7] =
        [Self::Offset, Self::Rotation, Self::Scaled, Self::Replay, Self::Forged, Self::Solution, Self::Outbid];

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Offset => "offset",
            Self::Rotation => "rotation",
            Self::Scaled => "scaled",
            Self::Replay => "replay",
            Self::Forged => "forged",
            Self::Solution => "solution",
            Self::Outbid => "outbid",
        }
    }
}

/// How much farther than it drives it says that it does.
const SCALE: f64 = 1.1;
const OFFSET_M: f64 = 10.0;

/// What a robot that lies about its solution says instead of what it has found.
pub(crate) fn falsify_found(entry: &mut Entry) {
    let aside = Pose2::new(OFFSET_M, 0.0, 0.0);
    match entry {
        Entry::Edge(RecordedEdge { edge, .. }) if edge.kind == EdgeKind::Closure => {
            edge.from_from_to = edge.from_from_to * aside;
        }
        Entry::Candidate(candidate) => candidate.from_from_to = candidate.from_from_to.map(|found| found * aside),
        Entry::Snapshot(snapshot) => {
            let half = snapshot.map_from_keyframe.iter_mut().filter(|(id, _)| id.seq % 100 >= 50);
            half.for_each(|(_, pose)| *pose = aside * *pose);
        }
        _ => {}
    }
}

/// A robot that lies from some time on.
#[derive(Debug, Clone)]
pub(crate) struct Liar {
    lie: Lie,
    from_s: f64,
    /// The place among its keyframes of the first one that is a lie.
    first: Option<usize>,
    /// From where its keyframes are to where it says that they are.
    moved: Pose2,
    /// A building that is not there, and the place in it where the lie begins.
    made_up: Site,
    /// What it has truly seen.
    seen: Vec<Arc<Sweep>>,
}

impl Liar {
    pub(crate) fn new(lie: Lie, from_s: f64, seed: u64) -> Self {
        let made_up = worlds::office_floor(Rng::keyed(seed, 0x6c69_6172).next_u64());
        Self { lie, from_s, first: None, moved: Pose2::IDENTITY, made_up, seen: Vec::new() }
    }

    /// Whether it lies about its solution by then.
    pub(crate) fn falsifies_solution(&self, seconds: f64) -> bool {
        self.lie == Lie::Solution && seconds >= self.from_s
    }

    /// Whether it outbids others by then.
    pub(crate) fn outbids(&self, seconds: f64) -> bool {
        self.lie == Lie::Outbid && seconds >= self.from_s
    }

    /// What it tells instead of this; `own` is its session as it is.
    pub(crate) fn tell(&mut self, seconds: f64, update: &Update, own: &Session) -> Update {
        let mut told = update.clone();
        told.entries.iter_mut().for_each(|entry| self.falsify(seconds, entry, own));
        told
    }

    fn falsify(&mut self, seconds: f64, entry: &mut Entry, own: &Session) {
        match entry {
            Entry::Keyframe { keyframe, map_from_keyframe } => {
                self.seen.push(Arc::clone(&keyframe.sweep));
                let place = self.seen.len() - 1;
                if seconds >= self.from_s && self.first.is_none() {
                    self.begin(place, *map_from_keyframe);
                }
                if let Some(first) = self.first {
                    self.falsify_sweep(first, keyframe, *map_from_keyframe, own);
                    *map_from_keyframe = self.moved * *map_from_keyframe;
                }
            }
            Entry::Edge(RecordedEdge { edge, .. }) => {
                let ends = own.place(edge.from).zip(own.place(edge.to));
                edge.from_from_to = self.said(ends, edge.from_from_to, own);
            }
            Entry::Candidate(candidate) => {
                let ends = own.place(candidate.from).zip(own.place(candidate.to));
                let said = candidate.from_from_to.map(|found| self.said(ends, found, own));
                candidate.from_from_to = said;
            }
            Entry::Remeasured { number, from_from_to, .. } => {
                let ends = own.recorded_edges().get(*number as usize).map(|known| known.ends);
                let ends = ends.map(|[from, to]| (from as usize, to as usize));
                *from_from_to = self.said(ends, *from_from_to, own);
            }
            _ => {}
        }
    }

    fn begin(&mut self, place: usize, map_from_keyframe: Pose2) {
        self.first = Some(place);
        let aside = match self.lie {
            Lie::Offset => Pose2::new(OFFSET_M, 0.0, 0.0),
            Lie::Rotation => Pose2::new(0.0, 0.0, FRAC_PI_6),
            _ => Pose2::IDENTITY,
        };
        self.moved = map_from_keyframe * aside * map_from_keyframe.inverse();
    }

    /// The relative pose of two of its keyframes as it says it.
    fn said(&self, ends: Option<(usize, usize)>, found: Pose2, own: &Session) -> Pose2 {
        let Some(((from, to), first)) = ends.zip(self.first) else { return found };
        if self.lie == Lie::Scaled && from.max(to) >= first {
            return Pose2 { x: SCALE * found.x, y: SCALE * found.y, ..found };
        }
        let map_from = |place: usize| own.map_from_keyframe().get(place).copied().unwrap_or(Pose2::IDENTITY);
        match (from >= first, to >= first) {
            (false, true) => map_from(from).inverse() * self.moved * map_from(from) * found,
            (true, false) => {
                let map_from_to = map_from(from) * found;
                (self.moved * map_from(from)).inverse() * map_from_to
            }
            _ => found,
        }
    }

    fn falsify_sweep(&self, first: usize, keyframe: &mut Arc<Keyframe>, map_from_keyframe: Pose2, own: &Session) {
        let sweep = match self.lie {
            Lie::Replay => self.seen.get(self.seen.len() - 1 - first).map(Arc::clone),
            Lie::Forged => {
                let begin = own.map_from_keyframe().get(first).copied().unwrap_or(map_from_keyframe);
                let pose = self.made_up.start(0.0) * begin.inverse() * map_from_keyframe;
                Some(Arc::new(self.made_up_sweep(&keyframe.sweep, pose)))
            }
            _ => None,
        };
        if let Some(sweep) = sweep {
            let Keyframe { id, stamp, scan, hardly_fits, .. } = **keyframe;
            *keyframe = Arc::new(Keyframe { id, stamp, scan, sweep, hardly_fits });
        }
    }

    /// What its laser would see in the building that is not there.
    fn made_up_sweep(&self, like: &Sweep, world_from_robot: Pose2) -> Sweep {
        let laser = &like.laser;
        let world_from_laser = world_from_robot * laser.robot_from_laser;
        let origin = world_from_laser.transform([0.0, 0.0]);
        let moment = self.made_up.world.at(0.0, origin, laser.range_max_m);
        let mut sweep = Sweep { codes: Vec::with_capacity(like.codes.len()), ..like.clone() };
        for beam in 0..like.codes.len() {
            let bearing = laser.angle_min_rad + beam as f64 * laser.angle_step_rad;
            let angle = world_from_laser.theta + if laser.inverted { -bearing } else { bearing };
            let range_m = moment.cast(origin, [angle.cos(), angle.sin()]);
            let step = (range_m / like.step_m).round();
            let is_seen = range_m < laser.range_max_m;
            sweep.codes.push(if is_seen { step.clamp(1.0, 65_534.0) as u16 } else { BEAM_NO_RETURN });
        }
        sweep
    }
}
