//! Where a lost robot is: what it has seen since, looked for in all that is known.

use crate::settings::Settings;
use mapwright_geom::{Pose2, stored};
use mapwright_grid::MatcherSettings;
use mapwright_loops::{Atlas, Effort, PlaneSubmap, PlaneSubmapSettings, View, views};
use mapwright_record::{NodeId, Past};
use rustc_hash::FxHashSet;
use std::cell::OnceCell;
use std::f64::consts::FRAC_PI_4;
use std::sync::Arc;

mod hypotheses;
mod look;
mod weigh;

use hypotheses::Hypothesis;
pub(crate) use hypotheses::{Heard, Hope, follow, hopes};
use look::{Look, Place};
pub(crate) use weigh::{Chance, Found, weigh};

/// What was seen on so much way is looked for, metres; nothing of it may contradict a place,
const SINCE_M: f64 = 8.0;
/// and where that is nowhere, what was seen on so much, for a robot that comes from unknown ground knows the rest of it not.
const LATELY_M: f64 = 2.5;
/// What a robot that is lost for long has seen on so much way is looked through for what looks the same, metres.
const BEFORE_M: f64 = 60.0;
/// A place that is found is looked for in what was seen before as well, for so much way back, metres.
const BACK_M: f64 = 1.0;
/// and in so many keyframes, however long the robot turns on the spot.
const BACK_AT_MOST: usize = 8;
/// The atlas has one view, the newest, for each square of this side, metres, and eighth of a turn.
const VIEW_EVERY_M: f64 = 0.5;
/// All that is known, drawn once for as long as the robot is lost.
#[derive(Debug)]
pub(crate) struct Ground {
    atlas: Atlas,
    /// The keyframe of each of its views.
    nodes: Vec<NodeId>,
}

impl Ground {
    fn new(views: Vec<(NodeId, View)>, submaps: &PlaneSubmapSettings) -> Self {
        let (nodes, views) = views.into_iter().unzip();
        Self { atlas: Atlas::new(views, submaps), nodes }
    }
}

/// The same, or what it is to be drawn from.
#[derive(Debug, Clone)]
pub(crate) enum Known {
    Drawn(Arc<Ground>),
    Views(Vec<(NodeId, View)>),
}

/// What a lost robot has seen is looked for in all that is known.
#[derive(Debug, Clone)]
pub(crate) struct Seeking {
    /// Number of the question.
    pub(crate) question: u64,
    /// The newest keyframe that was made aside, whose frame is that of the queries.
    to: NodeId,
    known: Known,
    /// What was seen lately, and all that was seen since the robot is lost, up to a bound.
    lately: Vec<View>,
    since: Vec<View>,
    /// The bound was not reached.
    whole: bool,
    /// What was seen before that and how far back, metres, and from where it is looked for.
    before: Vec<(f64, View)>,
    aside_from_query: Pose2,
    /// The same for the keyframes just before, the oldest first.
    earlier: Vec<Earlier>,
    /// Where the robot may be by earlier answers.
    hopes: Vec<Hope>,
    submaps: PlaneSubmapSettings,
    matcher: MatcherSettings,
    /// What may be spent on it: see [`Budget`].
    effort: u64,
}

/// What was seen lately and on the way, up to an earlier keyframe.
#[derive(Debug, Clone)]
struct Earlier {
    to: NodeId,
    /// Whether there was an answer since.
    answered: bool,
    lately: Vec<View>,
    since: Vec<View>,
    aside_from_query: Pose2,
}

/// What came of it.
#[derive(Debug, Clone)]
pub(crate) struct Sought {
    pub(crate) question: u64,
    pub(crate) to: NodeId,
    pub(crate) ground: Arc<Ground>,
    /// The best place of all.
    pub(crate) best: Option<Place>,
    /// The places that what was seen bears out; `None` where nobody looked.
    pub(crate) hypotheses: Option<Vec<Hypothesis>>,
    /// Where they stood already, the earliest first.
    pub(crate) earlier: Vec<Heard>,
    /// What it might cost, and has.
    pub(crate) given: u64,
    pub(crate) spent: u64,
}

/// What searching everything may cost: so many times what all else has cost until then, so that no log takes more than three
/// times its time because a robot was lost in it. Counted, not timed, so that a run is the same on every machine: in poses and
/// blocks of poses scored, each some 100 look-ups.
#[derive(Debug, Clone, Default)]
pub(crate) struct Budget {
    usual: u64,
    spent: u64,
    /// What a question has to have at least, for one with less was cut short.
    needed: u64,
    /// What the last one has cost.
    last: u64,
}

/// Of what all else has cost.
const TIMES_THE_USUAL: u64 = 2;
/// Some fifteen seconds of work, for logs that have only begun (table in docs/decisions/0012-carried-robots.md).
const AT_FIRST: u64 = 150_000_000;
/// While the robot is nowhere, so much way uses up what is left, metres: it may come to known ground late.
const LASTS_M: f64 = 40.0;
/// What else costs about as much as so many scored poses (of the instructions of a whole log): an evaluation of so many beams as
/// one, a keyframe drawn in and out, a view drawn into a submap.
const BEAMS_A_POSE: u64 = 25;
const KEYFRAME: u64 = 1300;
const VIEW: u64 = 400;

stored!(Budget { usual, spent, needed, last });

impl Budget {
    pub(crate) fn earn_match(&mut self, evaluations: u32, beams: u32) {
        self.usual += u64::from(evaluations) * u64::from(beams) / BEAMS_A_POSE;
    }

    pub(crate) fn earn_keyframe(&mut self) {
        self.usual += KEYFRAME;
    }

    pub(crate) fn earn_verification(&mut self, views: usize, scored: u64) {
        self.usual += VIEW * views as u64 + scored;
    }

    /// What a question may cost, where that is enough.
    pub(crate) fn for_question(&self) -> Option<u64> {
        let left = self.left();
        (left > self.needed).then_some(left)
    }

    fn left(&self) -> u64 {
        (AT_FIRST + TIMES_THE_USUAL * self.usual).saturating_sub(self.spent)
    }

    /// Way between two questions while the robot is nowhere, metres.
    pub(crate) fn every_m(&self) -> f64 {
        LASTS_M * self.last as f64 / self.left().max(1) as f64
    }

    /// What a question was given and has cost; where all of it was spent, the next one has to have twice as much.
    pub(crate) fn spend(&mut self, given: u64, spent: u64) {
        self.spent += spent;
        self.last = spent;
        self.needed = if spent == given { 2 * given } else { 0 };
    }
}

impl Seeking {
    pub(crate) fn run(self) -> Sought {
        let ground = match self.known {
            Known::Drawn(ref ground) => Arc::clone(ground),
            Known::Views(ref views) => Arc::new(Ground::new(views.clone(), &self.submaps)),
        };
        let [since, lately] = [&self.since, &self.lately].map(|views| PlaneSubmap::new(views, &self.submaps));
        let (before, effort) = (OnceCell::new(), Effort::new(self.effort));
        let less = self.lately.len() < self.since.len();
        let look = |query, all, other| Look {
            seeking: &self,
            ground: &ground,
            effort: &effort,
            query,
            since: &since,
            all,
            other: Some(other).filter(|_| less),
            whole: all && self.whole,
            before: &before,
            again: OnceCell::new(),
        };
        let best = look(&since, true, &lately).best();
        let lately = look(&lately, !less, &since);
        let fits = best.as_ref().is_some_and(Place::is_plain);
        // A robot that comes from unknown ground knows little of what it has seen but the last of it.
        let best = if !fits && less { lately.best().or(best) } else { best };
        // For long it is nowhere; a look at every other answer, which looks back, is enough to see it come.
        let is_to_look = self.whole || !self.hopes.is_empty() || self.question.is_multiple_of(2);
        let hypotheses = is_to_look.then(|| lately.hypotheses());
        let (hypotheses, earlier) = hypotheses.unzip();
        let (question, to, given, spent) = (self.question, self.to, self.effort, self.effort - effort.left());
        if effort.is_spent() {
            // Cut short: what was not looked at may be the place, so nothing was found.
            return Sought { question, to, ground, best: None, hypotheses: None, earlier: Vec::new(), given, spent };
        }
        Sought { question, to, ground, best, hypotheses, earlier: earlier.unwrap_or_default(), given, spent }
    }
}

/// The question where in all that is known a lost robot may be, as work to be done; `ground` is what earlier answers
/// were found on, the last of them at the keyframe `answered`.
pub(crate) fn seek(
    settings: &Settings,
    past: Past<'_>,
    sought: Past<'_>,
    (ground, hopes, answered): (Option<&Arc<Ground>>, Vec<Hope>, Option<NodeId>),
    (question, effort, matcher): (u64, u64, MatcherSettings),
) -> Option<Seeking> {
    let to = sought.newest()?;
    let step_m = |node: usize| sought.step_m(node);
    let seen_on = |at: NodeId, way_m: f64| views(sought, at, false, way_m, step_m);
    let known = ground.map_or_else(|| Known::Views(everything(past)), |g| Known::Drawn(Arc::clone(g)));
    let submaps = settings.submaps();
    let mut left_m = SINCE_M;
    let whole = (1..=to.index()).rev().all(|node| {
        left_m -= step_m(node);
        left_m >= 0.0
    });
    let seen_at = |at: NodeId| (seen_on(at, LATELY_M), seen_on(at, SINCE_M), sought.pose(at));
    let (lately, since, aside_from_query) = seen_at(to);
    let before = if whole { Vec::new() } else { seen_before(sought, step_m) };
    let mut back_m = 0.0;
    let before_to = NodeId::first(to.index()).rev().take_while(|&at| {
        back_m += step_m(at.index() + 1);
        back_m <= BACK_M
    });
    let before_to = before_to.take(BACK_AT_MOST);
    let earlier = |to| {
        let (lately, since, aside_from_query) = seen_at(to);
        let answered = answered.is_some_and(|answered| to <= answered);
        Earlier { to, answered, lately, since, aside_from_query }
    };
    let mut earlier: Vec<Earlier> = if whole { Vec::new() } else { before_to.map(earlier).collect() };
    earlier.reverse();
    Some(Seeking {
        question,
        to,
        known,
        lately,
        since,
        whole,
        before,
        aside_from_query,
        earlier,
        hopes,
        submaps,
        matcher,
        effort,
    })
}

/// Views of all ground, along the way; where it was seen often, as it was seen last.
fn everything(past: Past<'_>) -> Vec<(NodeId, View)> {
    let mut seen = FxHashSet::default();
    let mut views = Vec::new();
    for (node, sweep) in past.drawn.iter().enumerate().rev() {
        let (Some(sweep), pose) = (sweep, past.local_from_keyframe[node]) else { continue };
        let [x, y] = [pose.x, pose.y].map(|m| (m / VIEW_EVERY_M).floor() as i32);
        if seen.insert((x, y, (pose.theta / FRAC_PI_4).floor() as i32)) {
            views.push((NodeId::at(node), View { sweep: Arc::clone(sweep), submap_from_keyframe: pose }));
        }
    }
    views.reverse();
    views
}

/// Views of what a lost robot has seen, but for the last of it, and how far back, metres.
fn seen_before(sought: Past<'_>, step_m: impl Fn(usize) -> f64) -> Vec<(f64, View)> {
    let mut back_m = 0.0;
    let mut before = Vec::new();
    for node in (1..sought.drawn.len()).rev() {
        back_m += step_m(node);
        if back_m > BEFORE_M {
            break;
        }
        if let Some(sweep) = sought.drawn[node - 1].as_ref().filter(|_| back_m >= 2.0 * LATELY_M) {
            let submap_from_keyframe = sought.local_from_keyframe[node - 1];
            before.push((back_m, View { sweep: Arc::clone(sweep), submap_from_keyframe }));
        }
    }
    before.reverse();
    before.into_iter().step_by(2).collect()
}
