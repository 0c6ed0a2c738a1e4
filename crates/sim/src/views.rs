//! What two places see in common: the truth about revisits.

use crate::drive::{Drive, DriveSettings};
use crate::laser::Scanner;
use crate::math::{Point, add, distance, rotate, scale, sub, unit};
use crate::route::Site;
use crate::world::World;
use mapwright_geom::{Pose, Pose2, Stamp};
use std::collections::VecDeque;
use std::sync::Arc;

/// A place is seen from elsewhere when it lies no further than this behind what the ray meets, metres.
pub(crate) const BEHIND_M: f64 = 0.1;
/// Beams looked at of each view.
const BEAMS: usize = 45;
/// Samples of a drive lie about this far apart, metres.
const SAMPLE_M: f64 = 1.0;
/// Or where the robot has turned by this, radians.
const SAMPLE_RAD: f64 = 0.5;
/// Poses further apart are not compared, metres.
const COMPARED_M: f64 = 12.0;

/// Two scans see the same place when more than this share of either is seen by the other.
pub const REVISIT_OVERLAP: f64 = 0.5;
/// A revisit has more than this much way between the two times, metres.
pub const REVISIT_PATH_M: f64 = 20.0;

/// Two times of a drive at which the robot truly saw the same place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Revisit<P = Pose2> {
    /// The first time.
    pub earlier: Stamp,
    /// The second time.
    pub later: Stamp,
    /// Share of each view that the other sees too, the smaller of the two.
    pub overlap: f64,
    /// The truth that a closure has to find.
    pub earlier_from_later: P,
}

/// A time of a drive, and points of what is seen there.
#[derive(Debug, Clone)]
pub(crate) struct Sample<P, V> {
    pub(crate) stamp: Stamp,
    pub(crate) along_m: f64,
    pub(crate) world_from_robot: P,
    pub(crate) view: Vec<V>,
}

/// What a robot sees.
pub(crate) trait Sight {
    /// Poses of the robot.
    type Pose: Pose;
    /// Points in the world.
    type Point;

    /// How much the robot has turned between two poses, radians; half a turn to the left and to the right may count as a whole one.
    fn turn_rad(from: Self::Pose, to: Self::Pose) -> f64;

    /// A sample of the drive here.
    fn sample(&self, stamp: Stamp, along_m: f64, world_from_robot: Self::Pose) -> Sample<Self::Pose, Self::Point>;

    /// Share of a view that a robot elsewhere sees.
    fn share_seen(&self, view: &[Self::Point], world_from_robot: Self::Pose) -> f64;

    /// Share of each of two views that the other sees too, the smaller of the two, as far as it exceeds [`REVISIT_OVERLAP`].
    fn overlap(&self, a: &Sample<Self::Pose, Self::Point>, b: &Sample<Self::Pose, Self::Point>) -> f64 {
        if a.world_from_robot.distance(b.world_from_robot) > COMPARED_M {
            return 0.0;
        }
        let of_a = self.share_seen(&a.view, b.world_from_robot);
        if of_a <= REVISIT_OVERLAP { of_a } else { of_a.min(self.share_seen(&b.view, a.world_from_robot)) }
    }

    /// Samples of a drive, about every metre and where the robot has turned.
    fn samples(&self, way: impl IntoIterator<Item = (Stamp, Self::Pose)>) -> Vec<Sample<Self::Pose, Self::Point>> {
        let mut samples: Vec<Sample<Self::Pose, Self::Point>> = Vec::new();
        let (mut along_m, mut last) = (0.0, None);
        for (stamp, world_from_robot) in way {
            along_m += last.replace(world_from_robot).map_or(0.0, |last: Self::Pose| last.distance(world_from_robot));
            let is_new = |s: &Sample<Self::Pose, Self::Point>| {
                along_m - s.along_m >= SAMPLE_M || Self::turn_rad(s.world_from_robot, world_from_robot) > SAMPLE_RAD
            };
            if samples.last().is_none_or(is_new) {
                samples.push(self.sample(stamp, along_m, world_from_robot));
            }
        }
        samples
    }
}

/// Which times of a drive see the same place, more than [`REVISIT_PATH_M`] of way apart and overlapping by more than
/// [`REVISIT_OVERLAP`]: by ray casting among what stands still, sampled about every metre of the way.
#[derive(Debug, Clone)]
pub struct Revisits<P = Pose2> {
    /// The times that were compared, and the length of the way up to each, metres.
    times: Vec<(Stamp, f64)>,
    pairs: Vec<Revisit<P>>,
    /// The times at which the robot was back where it had been away from.
    back: Vec<Stamp>,
}

impl Revisits {
    /// Drives once without its laser and compares all views.
    #[must_use]
    pub fn of(site: &Arc<Site>, settings: &DriveSettings) -> Self {
        let viewer = Viewer::new(&site.world, settings);
        Self::among(&viewer, &samples(site, settings, &viewer))
    }
}

impl<P: Pose> Revisits<P> {
    /// Compares all views of a drive.
    pub(crate) fn among<S: Sight<Pose = P>>(sight: &S, samples: &[Sample<P, S::Point>]) -> Self {
        let (mut pairs, mut back) = (Vec::new(), Vec::new());
        for (k, later) in samples.iter().enumerate() {
            let known = pairs.len();
            let earlier = samples[..k].iter().filter(|s| later.along_m - s.along_m > REVISIT_PATH_M);
            let revisit = |earlier: &Sample<P, S::Point>| {
                let overlap = sight.overlap(earlier, later);
                let earlier_from_later = earlier.world_from_robot.between(later.world_from_robot);
                Revisit { earlier: earlier.stamp, later: later.stamp, overlap, earlier_from_later }
            };
            pairs.extend(earlier.map(revisit).filter(|revisit| revisit.overlap > REVISIT_OVERLAP));
            if was_away(sight, &samples[..k], later, &pairs[known..]) {
                back.push(later.stamp);
            }
        }
        Self { times: samples.iter().map(|sample| (sample.stamp, sample.along_m)).collect(), pairs, back }
    }

    /// Every pair of times, in the order of the later and then the earlier.
    #[must_use]
    pub fn pairs(&self) -> &[Revisit<P>] {
        &self.pairs
    }

    /// The stretches of the drive on which it is on ground seen before, from and to, the longest gap between two times
    /// of a stretch being 3 m of way.
    #[must_use]
    pub fn stretches(&self) -> Vec<[Stamp; 2]> {
        let mut stretches: Vec<[Stamp; 2]> = Vec::new();
        let mut last_m = f64::NEG_INFINITY;
        for &(stamp, along_m) in self.times.iter().filter(|(stamp, _)| self.seen_before(*stamp)) {
            match stretches.last_mut() {
                Some(stretch) if along_m - last_m < 3.0 => stretch[1] = stamp,
                _ => stretches.push([stamp; 2]),
            }
            last_m = along_m;
        }
        stretches
    }

    /// Those of the stretches to which the robot has come back: on more than [`REVISIT_PATH_M`] of way in one go it saw nothing of what
    /// it sees there. Who looks into a room and goes on along the corridor has not been away.
    #[must_use]
    pub fn returns(&self) -> Vec<[Stamp; 2]> {
        let mut stretches = self.stretches();
        stretches.retain(|[from, until]| {
            let first = self.back.partition_point(|stamp| stamp < from);
            self.back.get(first).is_some_and(|stamp| stamp <= until)
        });
        stretches
    }

    /// Whether there is a pair with this later time.
    fn seen_before(&self, later: Stamp) -> bool {
        let first = self.pairs.partition_point(|pair| pair.later < later);
        self.pairs.get(first).is_some_and(|pair| pair.later == later)
    }

    /// Whether the robot saw the same place at the sampled times nearest to these, in either order.
    #[must_use]
    pub fn contains(&self, a: Stamp, b: Stamp) -> bool {
        let (Some(a), Some(b)) = (self.nearest(a), self.nearest(b)) else {
            return false;
        };
        let (earlier, later) = (a.min(b), a.max(b));
        self.pairs.binary_search_by_key(&(later, earlier), |pair| (pair.later, pair.earlier)).is_ok()
    }

    fn nearest(&self, stamp: Stamp) -> Option<Stamp> {
        let after = self.times.partition_point(|(time, _)| *time < stamp);
        let around = [after.checked_sub(1), Some(after)].into_iter().flatten().filter_map(|at| self.times.get(at));
        around.map(|(time, _)| *time).min_by_key(|time| time.0.abs_diff(stamp.0))
    }
}

/// Whether the robot has been away from a place: whether there is more than [`REVISIT_PATH_M`] of way between two of the times, one after
/// the other, that see what it sees; `pairs` are those more than that before.
fn was_away<S: Sight>(
    sight: &S,
    before: &[Sample<S::Pose, S::Point>],
    later: &Sample<S::Pose, S::Point>,
    pairs: &[Revisit<S::Pose>],
) -> bool {
    let Some(last) = pairs.last() else { return false };
    let along_m = |revisit: &Revisit<S::Pose>| {
        let at = before.partition_point(|sample| sample.stamp < revisit.earlier);
        before.get(at).map_or(later.along_m, |sample| sample.along_m)
    };
    let of_late = before.iter().filter(|sample| sample.stamp > last.earlier);
    let sees_it = |sample: &&Sample<_, _>| sight.overlap(sample, later) > REVISIT_OVERLAP;
    let of_late = of_late.filter(sees_it).map(|sample| sample.along_m).chain([later.along_m]);
    let seen_m: Vec<f64> = pairs.iter().map(along_m).chain(of_late).collect();
    seen_m.windows(2).any(|two| two[1] - two[0] > REVISIT_PATH_M)
}

/// Share of each of two views that the other sees too, the smaller of the two; among what stands still, with the laser
/// of the settings.
#[must_use]
pub fn view_overlap(
    world: &World,
    settings: &DriveSettings,
    world_from_robot: Pose2,
    world_from_other_robot: Pose2,
) -> f64 {
    let viewer = Viewer::new(world, settings);
    let sample = |world_from_robot| viewer.sample(Stamp(0), 0.0, world_from_robot);
    viewer.overlap(&sample(world_from_robot), &sample(world_from_other_robot))
}

/// Looked at every 0.2 s from `after` on: the first time at which more than half of the view is that of a time before
/// `before`, and the first such time from which on that is so for at least half of the next `stay_s` seconds.
pub(crate) fn first_on_ground_of(
    site: &Arc<Site>,
    settings: &DriveSettings,
    before: Stamp,
    after: Stamp,
    stay_s: f64,
) -> [Option<Stamp>; 2] {
    let viewer = Viewer::new(&site.world, settings);
    let samples = samples(site, settings, &viewer);
    let known: Vec<&Sample<_, _>> = samples.iter().filter(|sample| sample.stamp < before).collect();
    let is_known = |world_from_robot: Pose2| {
        let here = viewer.sample(after, 0.0, world_from_robot);
        known.iter().any(|sample| viewer.overlap(sample, &here) > REVISIT_OVERLAP)
    };
    let rest = path_at(site, settings, 5.0).into_iter().filter(|(stamp, ..)| *stamp >= after);
    let mut first = None;
    // Times on known ground, and how many others have followed, for as long as it may be the one.
    let mut open: VecDeque<(Stamp, [u32; 2])> = VecDeque::new();
    for (stamp, world_from_robot, _) in rest {
        if let Some(&(entered, [on, off])) = open.front().filter(|(entered, _)| stamp.secs_since(*entered) > stay_s) {
            if on >= off {
                return [first, Some(entered)];
            }
            open.pop_front();
        }
        let on_known = is_known(world_from_robot);
        open.iter_mut().for_each(|(_, counts)| counts[usize::from(!on_known)] += 1);
        if on_known {
            first.get_or_insert(stamp);
            open.push_back((stamp, [0; 2]));
        }
    }
    let entered = open.iter().find(|(_, [on, off])| on >= off).map(|(entered, _)| *entered);
    [first, entered]
}

/// True and reported poses of the drive once a second.
pub(crate) fn true_path(site: &Arc<Site>, settings: &DriveSettings) -> Vec<(Stamp, Pose2, Pose2)> {
    path_at(site, settings, 1.0)
}

fn path_at(site: &Arc<Site>, settings: &DriveSettings, rate_hz: f64) -> Vec<(Stamp, Pose2, Pose2)> {
    let mut settings = DriveSettings { scan_rate_hz: rate_hz, odometry_rate_hz: rate_hz, ..settings.clone() };
    settings.laser.beams = 0;
    let scans = Drive::new(Arc::clone(site), settings).scans();
    scans.map(|s| (s.scan.stamp, s.world_from_robot, s.scan.odom_from_robot.unwrap_or_default())).collect()
}

fn samples(site: &Arc<Site>, settings: &DriveSettings, viewer: &Viewer<'_>) -> Vec<Sample<Pose2, Point>> {
    viewer.samples(true_path(site, settings).into_iter().map(|(stamp, world_from_robot, _)| (stamp, world_from_robot)))
}

/// A laser's eye without noise.
struct Viewer<'a> {
    world: &'a World,
    scanner: Scanner,
    directions: Vec<Point>,
    range_m: f64,
    /// Cosine of half of the field of view.
    edge_cosine: f64,
    middle_rad: f64,
}

impl<'a> Viewer<'a> {
    fn new(world: &'a World, settings: &DriveSettings) -> Self {
        let scanner = Scanner::new(settings.laser.clone());
        let model = scanner.model();
        let beams = settings.laser.beams;
        let field_rad = model.angle_step_rad * beams.saturating_sub(1) as f64;
        let sense = if model.inverted { -1.0 } else { 1.0 };
        let bearing = |k: usize| model.angle_min_rad + field_rad * (k as f64 + 0.5) / BEAMS as f64;
        let directions = (0..BEAMS).map(|k| rotate([1.0, 0.0], sense * bearing(k))).collect();
        let half_rad = (0.5 * field_rad.abs()).min(std::f64::consts::PI);
        let edge_cosine = rotate([1.0, 0.0], half_rad)[0] - 1e-3;
        let middle_rad = sense * (model.angle_min_rad + 0.5 * field_rad);
        let range_m = model.range_max_m;
        Self { world, scanner, directions, range_m, edge_cosine, middle_rad }
    }

    fn sees(&self, origin: Point, ahead: Point, point: Point) -> bool {
        let range_m = distance(origin, point);
        let direction = unit(sub(point, origin));
        range_m <= self.range_m
            && direction[0] * ahead[0] + direction[1] * ahead[1] >= self.edge_cosine
            && self.world.cast_still(origin, direction, self.range_m) >= range_m - BEHIND_M
    }
}

impl Sight for Viewer<'_> {
    type Pose = Pose2;
    type Point = Point;

    fn turn_rad(from: Pose2, to: Pose2) -> f64 {
        (from.theta - to.theta).abs()
    }

    fn sample(&self, stamp: Stamp, along_m: f64, world_from_robot: Pose2) -> Sample<Pose2, Point> {
        let eye = self.scanner.world_from_laser(world_from_robot);
        let origin = [eye.x, eye.y];
        let end = |&direction: &Point| {
            let direction = rotate(direction, eye.theta);
            let range_m = self.world.cast_still(origin, direction, self.range_m);
            range_m.is_finite().then(|| add(origin, scale(direction, range_m)))
        };
        Sample { stamp, along_m, world_from_robot, view: self.directions.iter().filter_map(end).collect() }
    }

    fn share_seen(&self, view: &[Point], world_from_robot: Pose2) -> f64 {
        let eye = self.scanner.world_from_laser(world_from_robot);
        let ahead = rotate([1.0, 0.0], eye.theta + self.middle_rad);
        let seen = view.iter().filter(|&&point| self.sees([eye.x, eye.y], ahead, point)).count();
        seen as f64 / view.len().max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::worlds::three_rooms;

    /// Robots see what is at most 6 m away along x, and from inside a room (y > 1) the room alone.
    struct Corridor;

    impl Sight for Corridor {
        type Pose = Pose2;
        type Point = Point;

        fn turn_rad(_: Pose2, _: Pose2) -> f64 {
            0.0
        }

        fn sample(&self, stamp: Stamp, along_m: f64, world_from_robot: Pose2) -> Sample<Pose2, Point> {
            let Pose2 { x, y, .. } = world_from_robot;
            let view = (-6..=6).map(|k| [x + f64::from(k), y]).collect();
            Sample { stamp, along_m, world_from_robot, view }
        }

        fn share_seen(&self, view: &[Point], from: Pose2) -> f64 {
            let sees = |[x, y]: &&Point| (x - from.x).abs() <= 6.0 && (*y > 1.0) == (from.y > 1.0);
            view.iter().filter(sees).count() as f64 / view.len() as f64
        }
    }

    #[test]
    fn who_looks_into_a_room_and_goes_on_has_not_been_away() {
        let line = |from: Point, to: Point| {
            let length = distance(from, to).round() as usize;
            (0..length).map(move |k| add(from, scale(sub(to, from), k as f64 / length as f64)))
        };
        let drive = |corners: &[Point]| {
            let way = corners.windows(2).flat_map(|two| line(two[0], two[1]));
            let way = way.zip(0..).map(|([x, y], second)| (Stamp(second * 1_000_000_000), Pose2::new(x, y, 0.0)));
            Revisits::among(&Corridor, &Corridor.samples(way))
        };
        for (depth_m, is_away) in [(9.0, false), (14.0, true)] {
            let visit = drive(&[[0.0, 0.0], [20.0, 0.0], [20.0, depth_m], [20.0, 0.0], [40.0, 0.0]]);
            assert_eq!(visit.stretches().len(), 1, "{depth_m}");
            assert_eq!(visit.returns().len(), usize::from(is_away), "{depth_m}");
        }
        let there_and_back = drive(&[[0.0, 0.0], [40.0, 0.0], [0.0, 0.0]]);
        assert_eq!(there_and_back.returns(), there_and_back.stretches());
    }

    #[test]
    fn a_place_overlaps_with_itself_and_not_with_its_back() {
        let site = three_rooms(1);
        let settings = DriveSettings::default();
        let at = |theta: f64| Pose2::new(site.route.waypoints[0][0], site.route.waypoints[0][1], theta);
        assert_eq!(view_overlap(&site.world, &settings, at(0.3), at(0.3)), 1.0);
        assert!(view_overlap(&site.world, &settings, at(0.3), at(0.5)) > 0.85);
        assert!(view_overlap(&site.world, &settings, at(0.3), at(0.3 + std::f64::consts::PI)) < 0.1);
        let elsewhere = site.route.waypoints[3];
        let elsewhere = Pose2::new(elsewhere[0], elsewhere[1], 0.3);
        assert!(view_overlap(&site.world, &settings, at(0.3), elsewhere) < 0.5);
    }

    #[test]
    fn the_third_round_is_one_long_revisit() {
        // A round is shorter than what counts, two are longer.
        let site = Arc::new(three_rooms(2));
        let rounds_s = 3.0 * site.route.length_m() / 0.5;
        let settings = DriveSettings { duration_s: rounds_s, ..DriveSettings::default() };
        let revisits = Revisits::of(&site, &settings);
        let stretches = revisits.stretches();
        let long_s = stretches.iter().map(|s| s[1].secs_since(s[0])).fold(0.0, f64::max);
        assert!(long_s > 0.2 * rounds_s, "{long_s} of {rounds_s}");
        let pair = revisits.pairs()[revisits.pairs().len() / 2];
        assert!(revisits.contains(pair.later, pair.earlier) && !revisits.contains(pair.later, pair.later));
    }
}
