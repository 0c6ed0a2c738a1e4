use super::*;
use crate::jobs::Outcome;
use mapwright_geom::Pose2;
use mapwright_loops::Solved;
use mapwright_record::{EdgeKind, Localisation, Objection, Verdict};
use mapwright_sensor::LaserScan;
use mapwright_sim::{Drive, DriveSettings, Site, kidnapping, worlds};

/// What was told of a drive from which scans were taken, and each keyframe's true pose.
struct Driven {
    mapper: Mapper,
    /// What the entries of its updates amount to.
    told: Session,
    truth: Vec<Pose2>,
    /// What was said of each scan.
    said: Vec<Localisation>,
}

impl Driven {
    fn new(settings: Settings) -> Self {
        let mapper = Mapper::new(settings).expect("valid");
        Self { mapper, told: Session::default(), truth: Vec::new(), said: Vec::new() }
    }

    fn add(&mut self, scan: &LaserScan, world_from_robot: Pose2) {
        let update = self.mapper.add_scan(scan);
        self.said.push(update.localisation);
        self.told.add_all(update.entries).expect("entries fit to those before");
        self.truth.resize(self.mapper.keyframes().len(), world_from_robot);
    }

    /// `lasts_s` of a drive are missing from `from_s` on; the wheels' count goes on as the robot did.
    fn over_gap(settings: Settings, site: Site, drive: DriveSettings, [from_s, lasts_s]: [f64; 2]) -> Self {
        let mut driven = Self::new(settings);
        let end = Stamp::from_secs_f64(from_s + lasts_s);
        for taken in Drive::new(site.into(), drive).scans() {
            if !(Stamp::from_secs_f64(from_s)..end).contains(&taken.scan.stamp) {
                driven.add(&taken.scan, taken.world_from_robot);
            }
        }
        driven
    }

    /// What fragments begin with, and why.
    fn fragments(&self) -> Vec<(FragmentStart, usize)> {
        let session = self.mapper.session();
        let place = |id| session.place(id).expect("a keyframe");
        session.fragments().iter().map(|fragment| (fragment.start, place(fragment.first))).collect()
    }

    /// Scans that were apart at first, and whether all after them were joined.
    fn apart(&self) -> (usize, bool) {
        let is_apart = |said: &&Localisation| **said == Localisation::Apart;
        let first = self.said.iter().take_while(|said| !is_apart(said)).count();
        let apart = self.said[first..].iter().take_while(is_apart).count();
        (
            apart,
            apart > 0
                && first + apart < self.said.len()
                && !self.said[first + apart..].iter().any(|said| is_apart(&said)),
        )
    }

    /// How far the map has a keyframe from where it is, seen from the one before the break, metres.
    fn error_m(&self, keyframe: usize, before: usize) -> f64 {
        let poses = self.mapper.keyframe_poses();
        let found = poses[before].between(poses[keyframe]);
        self.truth[before].between(self.truth[keyframe]).distance(found)
    }

    /// All lasts that was told.
    fn assert_told(&self) {
        let session = self.mapper.session();
        assert!(self.told == *session && self.told.encode() == session.encode());
    }

    /// The edges of odometry that lead to a keyframe: whether they were withdrawn.
    fn withdrawn_to(&self, keyframe: usize) -> Vec<bool> {
        let edges = self.mapper.session().recorded_edges().iter();
        let leads_there =
            edges.filter(|known| known.ends[1] as usize == keyframe && known.recorded.edge.kind == EdgeKind::Odometry);
        leads_there.map(|known| known.withdrawn).collect()
    }
}

#[test]
fn who_has_seen_nothing_for_a_minute_begins_a_fragment_and_is_joined() {
    let drive = DriveSettings { duration_s: 200.0, seed: 3, ..DriveSettings::default() };
    let driven = Driven::over_gap(Settings::default(), worlds::rooms(3), drive, [80.0, 60.0]);
    let fragments = driven.fragments();
    let [(FragmentStart::SwitchedOn, 0), (FragmentStart::Blind, first)] = fragments[..] else {
        panic!("{fragments:?}");
    };
    let (apart, is_joined_then) = driven.apart();
    assert!(is_joined_then, "apart for {apart} scans");
    let errors_m = (first..driven.truth.len()).map(|keyframe| driven.error_m(keyframe, first - 1));
    assert!(errors_m.fold(0.0, f64::max) < 0.3);
    assert_eq!(driven.withdrawn_to(first), [false], "its wheels have told the truth");
    driven.assert_told();
}

/// A join that is taken back takes what was matched over it along, and the pieces are apart again.
#[test]
fn a_join_can_be_taken_back() {
    let drive = DriveSettings { duration_s: 400.0, seed: 3, ..DriveSettings::default() };
    let mut driven = Driven::over_gap(Settings::default(), worlds::rooms(3), drive, [80.0, 60.0]);
    let (_, first) = driven.fragments()[1];
    let over_break = |mapper: &Mapper, kind: EdgeKind| {
        let edges = mapper.session().recorded_edges().iter().enumerate();
        let is_over = |ends: [u32; 2]| ends.iter().filter(|&&end| (end as usize) < first).count() == 1;
        let stands =
            edges.filter(|(_, known)| !known.withdrawn && known.recorded.edge.kind == kind && is_over(known.ends));
        stands.map(|(at, _)| at).collect::<Vec<usize>>()
    };
    let joins = over_break(&driven.mapper, EdgeKind::Closure);
    assert!(!joins.is_empty() && !over_break(&driven.mapper, EdgeKind::Match).is_empty());
    assert_eq!(driven.mapper.session().pieces().len(), 1);
    let live_before = |mapper: &mut Mapper| {
        mapper
            .front
            .survey(mapper.store.past())
            .iter()
            .filter(|place| place.live && place.first.index() < first)
            .count()
    };
    assert!(live_before(&mut driven.mapper) > 0);
    let map_from_keyframe = driven.mapper.keyframe_poses().to_vec();
    let solved = Outcome::Solved(Some(Solved { map_from_keyframe, taken_back: joins }));
    let update = driven.mapper.apply(JobResult(solved));
    assert_eq!(update.localisation, Localisation::Apart);
    assert_eq!(live_before(&mut driven.mapper), 0, "nothing of the other piece is matched against");
    assert!([EdgeKind::Closure, EdgeKind::Match].iter().all(|&kind| over_break(&driven.mapper, kind).is_empty()));
    assert_eq!(driven.mapper.session().pieces().len(), 2);
}

/// Without wheels three seconds are enough not to know which way it went.
#[test]
fn who_may_be_elsewhere_after_a_short_gap_begins_a_fragment_and_is_joined() {
    let mut settings = Settings::default();
    settings.motion.use_odometry = false;
    let drive = DriveSettings { duration_s: 200.0, seed: 3, ..DriveSettings::default() };
    let driven = Driven::over_gap(settings, worlds::rooms(3), drive, [80.0, 3.0]);
    let fragments = driven.fragments();
    let [(FragmentStart::SwitchedOn, 0), (FragmentStart::Uncertain, first)] = fragments[..] else {
        panic!("{fragments:?}");
    };
    let (apart, is_joined_then) = driven.apart();
    assert!(is_joined_then, "apart for {apart} scans");
    assert!((first..driven.truth.len()).all(|keyframe| driven.error_m(keyframe, first - 1) < 0.3));
    driven.assert_told();
}

/// The wheels have not turned while it was carried: what they say of it holds until four findings say otherwise.
#[test]
fn what_odometry_says_of_a_carried_robot_is_withdrawn_when_it_is_joined() {
    let case = kidnapping(902);
    let mut driven = Driven::new(Settings::default());
    for taken in case.drive().scans().take_while(|taken| taken.scan.stamp.secs_since(case.put_down) < 40.0) {
        driven.add(&taken.scan, taken.world_from_robot);
        if let [_, (start, first)] = driven.fragments()[..] {
            let is_apart = driven.said.last() == Some(&Localisation::Apart);
            assert_eq!((start, driven.withdrawn_to(first)), (FragmentStart::Blind, vec![!is_apart]));
        }
    }
    let (apart, is_joined_then) = driven.apart();
    assert!(is_joined_then, "apart for {apart} scans");
    let fragments = driven.fragments();
    let (_, first) = fragments[1];
    let joins = |candidate: &&Candidate| {
        let [from, to] =
            [candidate.from, candidate.to].map(|id| driven.mapper.session().place(id).expect("a keyframe"));
        candidate.verdict == Verdict::Accepted && from < first && to >= first
    };
    assert!(driven.mapper.candidates().iter().filter(joins).count() >= 4);
    let was_refused = |candidate: &Candidate| candidate.verdict == Verdict::Withdrawn(Objection::Outvoted);
    assert!(!driven.mapper.candidates().iter().any(was_refused), "no closure was taken back");
    driven.assert_told();
}
