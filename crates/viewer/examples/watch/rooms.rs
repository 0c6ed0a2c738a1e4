//! A session without a mapper: rooms of 10 x 10 m with doors, and a robot that is wherever it is put. For examples and tests.

use mapwright_geom::{Cov3, Pose2, Stamp};
use mapwright_record::{
    Candidate, Detection, Entry, Evidence, Fragment, FragmentStart, Keyframe, KeyframeId, LocalMapReport, Localisation,
    Objection, Run, RunId, ScanPose, Session, Snapshot, Status, Update, Verdict,
};
use mapwright_sensor::{BeamCounts, LaserModel, LaserScan, Sweep};
use std::f64::consts::TAU;
use std::sync::Arc;

const ROOM_M: f64 = 10.0;
const REACH_M: f64 = 25.0;

/// A run as it grows.
pub(crate) struct Rooms {
    /// What it amounts to.
    pub(crate) session: Session,
    laser: Arc<LaserModel>,
    run: RunId,
    snapshots: u32,
}

impl Rooms {
    /// A run that has just begun, of a laser that looks all around with so many beams.
    pub(crate) fn new(beams: usize) -> Self {
        let run = RunId::of_robot("rooms");
        let all_around = LaserModel::half_circle("laser", beams);
        let laser = LaserModel { angle_step_rad: TAU / beams as f64, range_max_m: REACH_M, ..all_around }.into();
        Self { session: Session::default(), laser, run, snapshots: 0 }
    }

    /// Name of a keyframe.
    pub(crate) fn id(&self, number: u32) -> KeyframeId {
        self.run.keyframe(number)
    }

    /// A keyframe at a true pose; it is told at the pose that the map has.
    pub(crate) fn keyframe(&mut self, world_from_robot: Pose2, map_from_robot: Pose2) -> Update {
        let number = self.session.keyframes().len() as u32;
        let (id, stamp) = (self.id(number), Stamp(i64::from(number) * 100_000_000));
        let ranges_m = (0..self.laser.beams_of()).map(|beam| self.range_m(world_from_robot, beam)).collect();
        let scan = LaserScan { stamp, laser: Arc::clone(&self.laser), ranges_m, odom_from_robot: None };
        let (sweep, beams) = Sweep::from_scan(&scan, [0.0; 3]);
        let keyframe =
            Arc::new(Keyframe { id, stamp, scan: u64::from(number), sweep: Arc::new(sweep), hardly_fits: false });
        let odom_from_robot = Pose2::IDENTITY;
        let scan = ScanPose { stamp, keyframe: Some(id), keyframe_from_robot: Pose2::IDENTITY, odom_from_robot };
        let begin = (number == 0).then(|| Entry::Run(Run { id: self.run, settings: String::new() }));
        let mut entries: Vec<Entry> = begin.into_iter().collect();
        entries.push(Entry::Keyframe { keyframe, map_from_keyframe: map_from_robot });
        if number == 0 {
            entries.push(Entry::Fragment(Fragment { first: id, start: FragmentStart::SwitchedOn }));
        }
        entries.push(Entry::Scan(scan));
        Update { keyframe: Some(id), beams, ..self.update(map_from_robot, entries) }
    }

    /// A candidate between two keyframes, or another verdict on it.
    pub(crate) fn candidate(&mut self, from: u32, to: u32, verdict: Verdict) -> Update {
        let (from, to) = (self.id(from), self.id(to));
        let known = self.session.candidates().iter().position(|known| known.from == from && known.to == to);
        let entry = match known {
            Some(number) => Entry::Verdict { number: number as u32, verdict, agreeing: 1 },
            None => Entry::Candidate(Candidate {
                from,
                to,
                detection: Detection::Pose,
                evidence: Evidence::default(),
                verdict,
                from_from_to: None,
                covariance: Cov3::identity(),
            }),
        };
        let newest = self.session.map_from_keyframe().last().copied().unwrap_or_default();
        self.update(newest, vec![entry])
    }

    /// A correction: all keyframes are somewhere else.
    pub(crate) fn correct(&mut self, moved: impl Fn(usize, Pose2) -> Pose2) -> Update {
        self.snapshots += 1;
        let poses = self.session.map_from_keyframe().iter().enumerate();
        let map_from_keyframe = poses.map(|(number, &pose)| (self.id(number as u32), moved(number, pose))).collect();
        let entry = Entry::Snapshot(Snapshot { number: self.snapshots, map_from_keyframe });
        let mut update = self.update(Pose2::IDENTITY, vec![entry]);
        update.map_from_robot = self.session.map_from_keyframe().last().copied().unwrap_or_default();
        update
    }

    fn update(&mut self, map_from_robot: Pose2, entries: Vec<Entry>) -> Update {
        self.session.add_all(entries.iter().cloned()).expect("they fit");
        Update {
            scan: self.session.next_scan().saturating_sub(1),
            stamp: self.session.keyframes().last().map_or(Stamp(0), |keyframe| keyframe.stamp),
            map_from_robot,
            covariance: Cov3::from_diagonal(&[0.01, 0.0025, 1e-4].into()),
            anchor: None,
            status: Status::Tracking,
            localisation: Localisation::Joined,
            map_from_odom: Pose2::IDENTITY,
            odom_from_robot: Pose2::IDENTITY,
            keyframe: None,
            beams: BeamCounts::default(),
            matched: None,
            refused: None,
            local_map: LocalMapReport::default(),
            waiting_keyframes: 0,
            entries,
            unwritten: Vec::new(),
        }
    }

    /// How far a beam goes: walls every 10 m, in the middle of each a door of 2 m.
    fn range_m(&self, world_from_robot: Pose2, beam: usize) -> f32 {
        let angle = world_from_robot.theta + self.laser.bearing_in_robot(beam);
        let (start, way) = ([world_from_robot.x, world_from_robot.y], [angle.cos(), angle.sin()]);
        let mut nearest = f64::INFINITY;
        for axis in 0..2 {
            let step = if way[axis] > 0.0 { 1.0 } else { -1.0 };
            let mut wall = if step > 0.0 { (start[axis] / ROOM_M).ceil() } else { (start[axis] / ROOM_M).floor() };
            while way[axis].abs() > 1e-9 {
                let range = (wall * ROOM_M - start[axis]) / way[axis];
                let along = (start[1 - axis] + range * way[1 - axis]).rem_euclid(ROOM_M) - ROOM_M / 2.0;
                if range > REACH_M {
                    break;
                }
                if range > 1e-6 && along.abs() > 1.0 {
                    nearest = nearest.min(range);
                    break;
                }
                wall += step;
            }
        }
        nearest as f32
    }
}

/// How many beams a laser has that looks all around.
trait AllAround {
    fn beams_of(&self) -> usize;
}

impl AllAround for LaserModel {
    fn beams_of(&self) -> usize {
        (TAU / self.angle_step_rad).round() as usize
    }
}

/// Why a candidate may be refused, one after the other.
pub(crate) fn objection(number: usize) -> Objection {
    [Objection::Ambiguous, Objection::LittleOverlap, Objection::Improbable, Objection::Contradiction][number % 4]
}
