//! Where a robot is in a finished map.
//!
//! Hypotheses, places in the map, compete by how likely the scans since the robot was switched on are there, under that map alone: what
//! the front end maps since only says how the robot has moved. Evidence is counted in nats, beside a place that merely looks like the
//! right one. The robot is located where one hypothesis leads every rival and that by [`DECIDED_NATS`] (the sequential probability ratio
//! test of Wald 1945); the finding is withdrawn where the scans since speak against it by as much (Page's test, 1954) or where a rival
//! overtakes it.

mod finished;

use crate::front::PlaneFrontEnd;
use crate::front_end::{FrontEnd, Locates};
use crate::settings::Settings;
use finished::{FinishedMap, is_elsewhere, middle_range_m};
use mapwright_geom::{Cov3, Pose2, TangentMatrix, compose_covariance};
use mapwright_grid::{BeamAgreement, Matcher, Prior, Separation};
use mapwright_record::{Localisation, Session, Status, Update};
use mapwright_sensor::{Sweep, SweepPoints};
use std::collections::VecDeque;

/// What is decided is wrong once in a thousand times, as far as beams are right about each other: `ln 1000`.
pub(crate) const DECIDED_NATS: f64 = 7.0;
/// A hypothesis that is so far behind the best does not come back.
const HOPELESS_NATS: f64 = 25.0;
const HYPOTHESES_AT_MOST: usize = 40;
/// Share of what was seen on the last metres that ends in known territory, at least (as of loop closures).
const LEAST_OVERLAP: f64 = 0.5;
/// Nearer than this, metres and radians, two are one.
const SAME: [f64; 2] = [0.2, 0.1];
/// `ln p(beam | right) / p(beam | wrong)` of a beam that ends close to an obstacle, near to one, in free space, and behind a wall. At the right
/// place of a building that has changed since, 80, 5, 11 and 4 % of them do; at the best of the wrong places 50, 7, 24 and 19 %
/// (docs/decisions/0026-runs.md).
const NATS: [f64; 4] = [0.47, -0.34, -0.78, -1.56];
/// Neighbouring beams are right or wrong together: a scan says as much as so many that are independent of each other.
const INDEPENDENT_BEAMS: f64 = 30.0;
/// A robot goes through a wall of the map as seldom as a decision is wrong.
const WALL_NATS: f64 = -DECIDED_NATS;
/// A view is taken after so much motion, metres or radians.
const VIEW_M: f64 = 0.2;
const VIEW_RAD: f64 = 0.2;
/// It sees new things as far as the robot has come relative to what it sees, or has turned, radians.
const NEW_RAD: f64 = 1.0;
/// Views that are remembered.
const VIEWS: usize = 48;
/// Beams of a view that are compared.
const VIEW_BEAMS: usize = 90;
/// Views over so much way make what is looked for in the whole map, metres, of so many points at most.
const QUERY_M: f64 = 4.0;
const QUERY_POINTS: usize = 360;
/// While the robot is not located the whole map is searched after so much motion, metres or radians.
const SEARCH_M: f64 = 0.5;
const SEARCH_RAD: f64 = 0.5;
/// How far a place that was found may be off, metres and radians.
const FOUND_SIGMA: [f64; 2] = [0.2, 0.08];
/// The front end's frame bends where the finished map does not hold it: standard deviations a metre of way or radian of turn, and a scan,
/// metres and radians.
const BENT_SHARE: f64 = 0.05;
const BENT: [f64; 2] = [0.002, 0.0015];
/// Beams are correlated: a match tells a tenth of what they claim, and no pose is known better than this, metres and radians.
const MATCH_SHARE: f64 = 0.1;
const KNOWN_SIGMA: [f64; 2] = [0.004, 0.001];
/// A match is of the beams that end where something is known, as far as the place may be off, so many standard deviations. It is followed
/// where such a share of these fits: elsewhere the front end knows better how the robot moves.
const FOLLOWED_SIGMAS: f64 = 3.0;
const FOLLOWED_INLIER_SHARE: f64 = 0.85;

/// What is said of where the robot is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Location {
    /// Whether the robot is located.
    pub is_located: bool,
    /// Likeliest pose of the robot in the map, if there is one.
    pub map_from_robot: Pose2,
    /// Its covariance, a right perturbation.
    pub covariance: Cov3,
    /// Evidence for it, nats.
    pub nats: f64,
    /// That for the best rival, or zero for a place that only looks like it, nats.
    pub rival_nats: f64,
    /// How the newest scan agrees with the map there.
    pub agreement: BeamAgreement,
}

/// Why the robot is not located any more.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Withdrawal {
    /// What was seen since contradicts the map there.
    Contradicted,
    /// Another place explains the scans better.
    Overtaken,
    /// The robot may have been carried, or has fitted nowhere for long.
    Break,
}

/// What was seen from one place.
#[derive(Debug, Clone)]
struct View {
    local_from_robot: Pose2,
    origin: [f64; 2],
    points: Vec<[f64; 2]>,
    /// How much of it is new, 0 to 1.
    weight: f64,
}

/// A place in the map.
#[derive(Debug, Clone)]
struct Hypothesis {
    map_from_robot: Pose2,
    /// Of a right perturbation.
    covariance: Cov3,
    /// What was said of it before anything was seen, nats: zero but where somebody says that the robot is there.
    prior: f64,
    /// What each of the views says of it, nats.
    nats: VecDeque<f64>,
}

impl Hypothesis {
    fn sum(&self) -> f64 {
        self.prior + self.nats.iter().sum::<f64>()
    }

    /// Page's test: by how much the newest views together speak against it, nats, none or negative; and how many they are.
    fn against(&self) -> (f64, usize) {
        let (mut sum, mut worst, mut since) = (0.0, 0.0, 0);
        for (count, nats) in self.nats.iter().rev().enumerate() {
            sum += nats;
            if sum < worst {
                (worst, since) = (sum, count + 1);
            }
        }
        (worst, since)
    }

    fn differs_from(&self, other: &Self) -> bool {
        is_elsewhere(self.map_from_robot, other.map_from_robot, SAME)
    }

    fn is_rival(&self, other: &Self) -> bool {
        let Separation { distance_m, angle_rad } = Separation::default();
        is_elsewhere(self.map_from_robot, other.map_from_robot, [distance_m, angle_rad])
    }
}

/// See the module's text.
#[derive(Debug, Clone)]
pub struct Locator {
    finished: FinishedMap,
    matcher: Matcher,
    views: VecDeque<View>,
    /// Best first.
    hypotheses: Vec<Hypothesis>,
    is_located: bool,
    withdrawal: Option<Withdrawal>,
    /// A finding was withdrawn, and none has held since.
    was_wrong: bool,
    local_from_last: Option<Pose2>,
    /// Way, a radian of turning a metre, on which every scan has agreed with the map where the robot is thought to be, metres.
    followed_m: f64,
    /// Motion since the whole map was searched, metres and radians; none before the first time.
    since_search: Option<[f64; 2]>,
    agreement: BeamAgreement,
}

/// The newest scan as the front end has it.
struct Seen<'a> {
    pub(crate) local_from_robot: Pose2,
    pub(crate) points: &'a SweepPoints,
    /// The robot may be anywhere: how it has moved since the scan before is not known.
    pub(crate) is_break: bool,
    /// It fits what the front end has mapped.
    pub(crate) is_believed: bool,
}

impl Locates<Sweep> for Locator {
    fn of(settings: &Settings, session: &Session) -> Option<Self> {
        Some(Self::new(settings, session))
    }

    fn see(&mut self, front: &PlaneFrontEnd, is_break: bool, is_believed: bool) {
        let local_from_robot = front.pose().local_from_robot();
        self.take(&Seen { local_from_robot, points: front.points(), is_break, is_believed });
    }

    fn report(&self, update: &mut Update) {
        self.report_of(update);
    }
}

impl Locator {
    pub(crate) fn new(settings: &Settings, session: &Session) -> Self {
        Self {
            finished: FinishedMap::of(settings, session),
            matcher: Matcher { settings: settings.matcher() },
            views: VecDeque::new(),
            hypotheses: Vec::new(),
            is_located: false,
            withdrawal: None,
            was_wrong: false,
            local_from_last: None,
            since_search: None,
            followed_m: 0.0,
            agreement: BeamAgreement::default(),
        }
    }

    /// Why the last scan has withdrawn the finding, if it has.
    pub(crate) fn withdrawal(&self) -> Option<Withdrawal> {
        self.withdrawal
    }

    pub(crate) fn location(&self) -> Option<Location> {
        let best = self.hypotheses.first()?;
        Some(Location {
            is_located: self.is_located,
            map_from_robot: best.map_from_robot,
            covariance: best.covariance,
            nats: best.sum(),
            rival_nats: self.rival_nats(),
            agreement: self.agreement,
        })
    }

    fn report_of(&self, update: &mut Update) {
        // Where the map says little of a scan, or contradicts it, it does not say where the robot is; who comes back from there is where the
        // map says once that has held for the length of a view.
        let is_told = self.is_located && self.followed_m >= VIEW_M;
        let Some(Location { map_from_robot, covariance, agreement, .. }) = self.location().filter(|_| is_told) else {
            (update.localisation, update.status) = (Localisation::Apart, Status::Lost);
            return;
        };
        update.localisation = Localisation::Joined;
        (update.map_from_robot, update.covariance, update.anchor) = (map_from_robot, covariance, None);
        update.map_from_odom = map_from_robot * update.odom_from_robot.inverse();
        if let Some(matched) = &mut update.matched {
            (matched.inlier_share, matched.known_share) = (agreement.inlier_share(), agreement.known_share());
        }
    }

    fn take(&mut self, seen: &Seen<'_>) {
        self.withdrawal = None;
        if seen.is_break {
            self.forget();
        }
        let last_from_robot = self.local_from_last.map_or(Pose2::IDENTITY, |last| last.between(seen.local_from_robot));
        self.local_from_last = Some(seen.local_from_robot);
        let moved = [last_from_robot.x.hypot(last_from_robot.y), last_from_robot.theta.abs()];
        self.since_search = self.since_search.map(|[m, rad]| [m + moved[0], rad + moved[1]]);
        self.hypotheses.iter_mut().for_each(|hypothesis| hypothesis.go(last_from_robot, moved));
        if seen.points.hits.is_empty() || !seen.is_believed {
            return;
        }
        if let Some(best) = self.hypotheses.first_mut() {
            let follows = best.follow(&self.finished, &self.matcher, &seen.points.hits);
            self.followed_m = if follows { self.followed_m + moved[0] + moved[1] } else { 0.0 };
            self.agreement = self.finished.map.beams(seen.points.origin, &seen.points.hits, best.map_from_robot);
        }
        let Some(weight) = self.weight_of_view(seen) else { return };
        self.look(seen, weight);
        if !self.is_located && self.is_search_due() {
            self.search();
        }
        self.decide();
    }

    /// Somebody says where the robot is: as good as all that would have decided for that place. What is seen from there has to agree, and may
    /// still take it back.
    pub(crate) fn place(&mut self, map_from_robot: Pose2, covariance: Cov3) {
        (self.is_located, self.was_wrong) = (false, false);
        let prior = self.needed_nats();
        self.hypotheses.clear();
        let said = Hypothesis { map_from_robot, covariance, prior, nats: VecDeque::new() };
        let said = self.judged(said, self.local_from_last.unwrap_or(Pose2::IDENTITY));
        self.hypotheses.push(said);
    }

    /// The robot may be anywhere: what was seen up to now says nothing of it.
    pub(crate) fn find_anew(&mut self) {
        self.forget();
        self.withdrawal = None;
    }

    /// Nothing is known of where the robot is.
    fn forget(&mut self) {
        if std::mem::take(&mut self.is_located) {
            self.withdrawal = Some(Withdrawal::Break);
        }
        self.was_wrong = false;
        self.views.clear();
        self.hypotheses.clear();
        (self.local_from_last, self.since_search) = (None, None);
    }

    /// How much of what a scan shows is new; none where the robot has not moved enough for another view.
    fn weight_of_view(&self, seen: &Seen<'_>) -> Option<f64> {
        let Some(last) = self.views.back() else { return Some(1.0) };
        let since = last.local_from_robot.between(seen.local_from_robot);
        let (moved_m, turned_rad) = (since.x.hypot(since.y), since.theta.abs());
        let reach_m = middle_range_m(&seen.points.hits).max(VIEW_M);
        (moved_m >= VIEW_M || turned_rad >= VIEW_RAD).then(|| (moved_m / reach_m + turned_rad / NEW_RAD).min(1.0))
    }

    /// Every hypothesis is judged by one more view.
    fn look(&mut self, seen: &Seen<'_>, weight: f64) {
        let SweepPoints { hits, origin, .. } = seen.points;
        let every = hits.len().div_ceil(VIEW_BEAMS).max(1);
        let points: Vec<[f64; 2]> = hits.iter().step_by(every).copied().collect();
        let last_from_robot = self.views.back().map(|last| last.local_from_robot.between(seen.local_from_robot));
        let view = View { local_from_robot: seen.local_from_robot, origin: *origin, points, weight };
        let is_full = self.views.len() == VIEWS;
        for (rank, hypothesis) in self.hypotheses.iter_mut().enumerate() {
            if rank > 0 {
                hypothesis.follow(&self.finished, &self.matcher, hits);
            }
            if is_full {
                hypothesis.nats.pop_front();
            }
            let nats = view_nats(&self.finished, &view, hypothesis.map_from_robot, last_from_robot);
            hypothesis.nats.push_back(nats);
        }
        if is_full {
            self.views.pop_front();
        }
        self.views.push_back(view);
    }

    fn is_search_due(&self) -> bool {
        self.since_search.is_none_or(|[m, rad]| m >= SEARCH_M || rad >= SEARCH_RAD)
    }

    /// Looks for places in the whole map at which the views of late may have been seen.
    fn search(&mut self) {
        let Some(local_from_robot) = self.views.back().map(|view| view.local_from_robot) else { return };
        self.since_search = Some([0.0; 2]);
        let points = self.query(local_from_robot);
        let [m, rad] = FOUND_SIGMA;
        let variances = [m * m, m * m, rad * rad];
        for peak in self.finished.peaks(&points) {
            let prior = Prior { world_from_robot: peak, variances, tail: 1e8 };
            let found = self.matcher.gauss_newton(&self.finished.map, &points, &prior, peak);
            let covariance = Cov3::from_diagonal(&variances.into());
            let (map_from_robot, nats) = (found.world_from_robot, VecDeque::new());
            let hypothesis = Hypothesis { map_from_robot, covariance, prior: 0.0, nats };
            if self.hypotheses.iter().all(|known| known.differs_from(&hypothesis)) {
                self.hypotheses.push(self.judged(hypothesis, local_from_robot));
            }
        }
    }

    /// A hypothesis with what all views say of it.
    fn judged(&self, mut hypothesis: Hypothesis, local_from_robot: Pose2) -> Hypothesis {
        let mut last: Option<Pose2> = None;
        for view in &self.views {
            let robot_from_view = local_from_robot.between(view.local_from_robot);
            let last_from_view = last.map(|last| last.between(view.local_from_robot));
            let at = hypothesis.map_from_robot * robot_from_view;
            hypothesis.nats.push_back(view_nats(&self.finished, view, at, last_from_view));
            last = Some(view.local_from_robot);
        }
        hypothesis
    }

    /// What the views over the last metres have seen, in the robot's frame.
    fn query(&self, local_from_robot: Pose2) -> Vec<[f64; 2]> {
        let (mut way_m, mut at) = (0.0, local_from_robot);
        let views = self.views.iter().rev().take_while(|view| {
            way_m += at.distance(view.local_from_robot);
            at = view.local_from_robot;
            way_m <= QUERY_M
        });
        let mut points = Vec::new();
        for view in views {
            let robot_from_view = local_from_robot.between(view.local_from_robot);
            points.extend(view.points.iter().map(|&point| robot_from_view.transform(point)));
        }
        let every = points.len().div_ceil(QUERY_POINTS).max(1);
        points.into_iter().step_by(every).collect()
    }

    /// The best hypothesis first, without those that are hopeless; whether it is where the robot is.
    fn decide(&mut self) {
        let before = self.hypotheses.first().map(|best| best.map_from_robot);
        if self.is_located && self.hypotheses.first().is_some_and(|best| best.against().0 <= -DECIDED_NATS) {
            self.contradicted();
        }
        self.hypotheses.sort_by(|a, b| b.sum().total_cmp(&a.sum()));
        self.drop_repeated();
        self.hypotheses.truncate(HYPOTHESES_AT_MOST);
        let most = self.hypotheses.first().map_or(0.0, Hypothesis::sum);
        self.hypotheses.retain(|hypothesis| hypothesis.sum() >= most - HOPELESS_NATS);
        let Some(best) = self.hypotheses.first() else { return };
        let lead = best.sum() - self.rival_nats();
        let [same_m, same_rad] = [Separation::default().distance_m, Separation::default().angle_rad];
        let is_other = before.is_none_or(|before| is_elsewhere(before, best.map_from_robot, [same_m, same_rad]));
        if self.is_located && (is_other || lead < DECIDED_NATS) {
            self.is_located = false;
            self.withdrawal = Some(Withdrawal::Overtaken);
        }
        self.was_wrong |= self.withdrawal.is_some();
        let is_decided =
            lead >= self.needed_nats() && best.against().0 > -DECIDED_NATS && self.is_on_known_ground(best);
        self.was_wrong &= !is_decided;
        self.is_located |= is_decided;
    }

    /// By how much a place has to lead. The robot may be where nothing is mapped, and of so many places the best wrong one leads by the logarithm
    /// of their number. Where a finding did not hold, what was learnt of the robot's whereabouts counts against another place as well.
    fn needed_nats(&self) -> f64 {
        let prior = self.finished.places().ln();
        DECIDED_NATS + if self.was_wrong { 2.0 * prior } else { prior }
    }

    /// Whether the map says something about what was seen on the last metres, as it has to of any place that is recognised.
    fn is_on_known_ground(&self, best: &Hypothesis) -> bool {
        let Some(newest) = self.views.back() else { return false };
        let map_from_local = best.map_from_robot * newest.local_from_robot.inverse();
        let (mut all, mut known) = (0, 0);
        for view in self.views.iter().rev().take((QUERY_M / VIEW_M) as usize) {
            let agreement = self.finished.map.beams(view.origin, &view.points, map_from_local * view.local_from_robot);
            (all, known) = (all + agreement.all(), known + agreement.all() - agreement.unknown);
        }
        f64::from(known) >= LEAST_OVERLAP * f64::from(all)
    }

    /// Of hypotheses that have come to the same place the best stays.
    fn drop_repeated(&mut self) {
        let mut kept: Vec<Hypothesis> = Vec::new();
        for hypothesis in self.hypotheses.drain(..) {
            if kept.iter().all(|known| known.differs_from(&hypothesis)) {
                kept.push(hypothesis);
            }
        }
        self.hypotheses = kept;
    }

    /// Where it was is wrong, and what was seen before it began to be contradicted says nothing of where the robot is.
    fn contradicted(&mut self) {
        let best = self.hypotheses.remove(0);
        let stale = self.views.len() - best.against().1;
        self.views.drain(..stale);
        for hypothesis in &mut self.hypotheses {
            hypothesis.nats.drain(..stale);
        }
        (self.is_located, self.since_search) = (false, None);
        self.withdrawal = Some(Withdrawal::Contradicted);
    }

    /// Evidence for the best rival of the best hypothesis; zero is a place that only looks like the right one.
    fn rival_nats(&self) -> f64 {
        let Some((best, others)) = self.hypotheses.split_first() else { return 0.0 };
        let rivals = others.iter().filter(|other| other.is_rival(best));
        rivals.map(Hypothesis::sum).fold(0.0, f64::max)
    }
}

impl Hypothesis {
    /// The robot has moved.
    fn go(&mut self, last_from_robot: Pose2, [moved_m, turned_rad]: [f64; 2]) {
        let [m, rad] = [BENT[0] + BENT_SHARE * moved_m, BENT[1] + BENT_SHARE * turned_rad];
        let bent = Cov3::from_diagonal(&[m * m, m * m, rad * rad].into());
        self.map_from_robot = self.map_from_robot * last_from_robot;
        self.covariance = compose_covariance(&self.covariance, last_from_robot, &bent);
    }

    /// A scan says where in its place the robot is; whether it does.
    fn follow(&mut self, finished: &FinishedMap, matcher: &Matcher, hits: &[[f64; 2]]) -> bool {
        let variances = [0, 1, 2].map(|axis| self.covariance[(axis, axis)]);
        let prior = Prior { world_from_robot: self.map_from_robot, variances, tail: 1e8 };
        let within_m = FOLLOWED_SIGMAS * self.covariance.position_variance_m2().sqrt();
        let all = hits.len();
        let hits = finished.map.known_points(hits, self.map_from_robot, within_m);
        if (hits.len() as f64) < LEAST_OVERLAP * all as f64 {
            return false;
        }
        let found = matcher.gauss_newton(&finished.map, &hits, &prior, self.map_from_robot);
        let agreement = finished.map.agreement(&hits, found.world_from_robot);
        let moved = self.map_from_robot.between(found.world_from_robot);
        let is_near = moved.x.hypot(moved.y) <= within_m + finished.map.settings.resolution_m
            && moved.theta.abs() <= FOLLOWED_SIGMAS * variances[2].sqrt();
        let follows = is_near && agreement.fitting > 0 && agreement.inlier_share() >= FOLLOWED_INLIER_SHARE;
        let information = self.covariance.try_inverse().map(|prior| prior + found.hessian * MATCH_SHARE);
        let Some(covariance) = information.filter(|_| follows).and_then(|matrix| matrix.try_inverse()) else {
            return false;
        };
        let [m, rad] = KNOWN_SIGMA;
        self.map_from_robot = found.world_from_robot;
        self.covariance = covariance + Cov3::from_diagonal(&[m * m, m * m, rad * rad].into());
        true
    }
}

/// What a view says of a place, nats, with the way there from the one before.
fn view_nats(finished: &FinishedMap, view: &View, map_from_robot: Pose2, last_from_robot: Option<Pose2>) -> f64 {
    let BeamAgreement { close, near, short, through, .. } =
        finished.map.beams(view.origin, &view.points, map_from_robot);
    let counted = [close, near, short, through].into_iter().zip(NATS);
    let beams: f64 = counted.map(|(count, nats)| f64::from(count) * nats).sum();
    let independent = (INDEPENDENT_BEAMS / view.points.len().max(1) as f64).min(1.0);
    let wall = last_from_robot.is_some_and(|last_from_robot| {
        let last = map_from_robot * last_from_robot.inverse();
        finished.map.crosses_wall([last.x, last.y], [map_from_robot.x, map_from_robot.y])
    });
    view.weight * independent * beams + if wall { WALL_NATS } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Mapper;
    use mapwright_sensor::{BeamTable, Sweep};
    use mapwright_sim::{Drive, DriveSettings, TrueScan, worlds};

    /// A floor that was mapped, its scans and where the map has each.
    fn mapped() -> (Locator, Vec<TrueScan>, Vec<Pose2>) {
        let drive = DriveSettings { duration_s: 120.0, seed: 5, ..DriveSettings::default() };
        let scans: Vec<TrueScan> = Drive::new(worlds::office_floor(3).into(), drive).scans().collect();
        let mut mapper = Mapper::new(Settings::default()).unwrap();
        scans.iter().for_each(|scan| drop(mapper.add_scan(&scan.scan)));
        let poses = mapper.trajectory().map(|pose| pose.map_from_robot).collect();
        (Locator::new(&Settings::default(), mapper.session()), scans, poses)
    }

    fn see(locator: &mut Locator, scan: &TrueScan, local_from_robot: Pose2) {
        let (mut points, mut table) = (SweepPoints::default(), BeamTable::default());
        points.fill(&Sweep::from_scan(&scan.scan, [0.0; 3]).0, &mut table, 6.0);
        locator.take(&Seen { local_from_robot, points: &points, is_break: false, is_believed: true });
    }

    #[test]
    fn what_contradicts_the_map_takes_the_finding_back_and_the_robot_is_found_again() {
        let (mut locator, scans, poses) = mapped();
        let is_at = |locator: &Locator, pose: Pose2| {
            let location = locator.location().filter(|location| location.is_located);
            location.is_some_and(|location| !is_elsewhere(location.map_from_robot, pose, [0.1, 0.03]))
        };
        (100..200).for_each(|at| see(&mut locator, &scans[at], poses[at]));
        assert!(is_at(&locator, poses[199]), "{:?}", locator.location());
        // Carried, though the front end has not noticed: it goes on where it was.
        let local_from_map = poses[199] * poses[700].inverse();
        let mut withdrawn = Vec::new();
        for at in 700..1000 {
            see(&mut locator, &scans[at], local_from_map * poses[at]);
            withdrawn.extend(locator.withdrawal().map(|why| (at, why)));
        }
        // Within four seconds of driving.
        assert!(matches!(withdrawn[..], [(..740, Withdrawal::Contradicted | Withdrawal::Overtaken)]), "{withdrawn:?}");
        assert!(is_at(&locator, poses[999]), "{:?}", locator.location());
        let location = locator.location().unwrap();
        assert!(location.nats - location.rival_nats > DECIDED_NATS);
    }

    /// The first views agree with what somebody says, or take it back and find the robot where it is.
    #[test]
    fn what_somebody_says_is_believed_as_long_as_nothing_speaks_against_it() {
        let (mut locator, scans, poses) = mapped();
        let sigmas = Cov3::from_diagonal(&[0.01, 0.01, 0.002].into());
        let is_at = |locator: &Locator, pose: Pose2| {
            let location = locator.location().filter(|location| location.is_located);
            location.is_some_and(|location| !is_elsewhere(location.map_from_robot, pose, [0.2, 0.05]))
        };
        see(&mut locator, &scans[100], poses[100]);
        assert!(locator.location().is_none_or(|location| !location.is_located), "one scan tells nobody");
        locator.place(poses[100] * Pose2::new(0.1, -0.05, 0.02), sigmas);
        let found = (101..160).find(|&at| {
            see(&mut locator, &scans[at], poses[at]);
            is_at(&locator, poses[at])
        });
        assert!(found.is_some_and(|at| at < 115), "within a second and a half: {found:?}");
        // Said wrongly: it is elsewhere.
        locator.place(poses[900], sigmas);
        (160..400).for_each(|at| see(&mut locator, &scans[at], poses[at]));
        assert!(is_at(&locator, poses[399]), "{:?}", locator.location());
        locator.find_anew();
        assert!(locator.location().is_none());
    }

    #[test]
    fn in_a_map_without_anything_nothing_is_found() {
        let (_, scans, poses) = mapped();
        let mut locator = Locator::new(&Settings::default(), &Session::default());
        (0..50).for_each(|at| see(&mut locator, &scans[at], poses[at]));
        assert!(locator.location().is_none_or(|location| !location.is_located));
    }
}
