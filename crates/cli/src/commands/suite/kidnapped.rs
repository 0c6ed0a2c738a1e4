//! `mapwright suite kidnapped`

use super::Measure;
use super::floors::{Floor, percent};
use crate::failure::Failure;
use crate::simulated::{PoseError, Simulated};
use mapwright::{Pose2, Settings, Stamp, Status, Update};
use mapwright_sim::{Kidnapping, kidnapping};
use serde::Serialize;
use serde_json::{Value, json};

/// So long after being put down it must be noticed, seconds.
const NOTICED_WITHIN_S: f64 = 5.0;
/// So long after it has come to known ground the robot must know where it is, seconds.
const HOME_WITHIN_S: f64 = 10.0;

pub(super) struct Kidnapped {
    pub(super) settings: Settings,
}

#[derive(Debug, Serialize)]
pub(super) struct World {
    seed: u64,
    known_ground: bool,
    /// Seconds after being put down; negative where a covered laser gave it away on the way.
    noticed_s: Option<f64>,
    noticed: bool,
    /// Seconds from being put down until half of what is seen was known for the first time; none where that never happens.
    glimpse_s: Option<f64>,
    /// The same until it was known for at least half of ten seconds.
    home_s: Option<f64>,
    /// Seconds from being put down until the robot knew where it was.
    located_s: Option<f64>,
    /// Whether in time; none where there was no home to be found.
    home: Option<bool>,
    /// Whether in time from the first glimpse on.
    home_by_glimpse: Option<bool>,
    written: usize,
    misplaced: usize,
    wrong: usize,
}

impl Measure for Kidnapped {
    type World = World;
    const NAME: &'static str = "kidnapped";
    const FILES: [&'static str; 2] = ["kidnapped.jsonl", "kidnapped.json"];

    fn world(&self, seed: u64) -> Result<World, Failure> {
        let case = kidnapping(seed);
        let mut witness = Witness::of(&case);
        let world = Simulated::map_watched(case.drive(), &self.settings, |mapper, update, truth| {
            witness.see(mapper.keyframe_poses(), update, truth);
        })?;
        let since_put_down = |stamp: Stamp| stamp.secs_since(case.put_down);
        let in_time = |from: Stamp| witness.located.is_some_and(|at| at.secs_since(from) <= HOME_WITHIN_S);
        Ok(World {
            seed,
            known_ground: case.known_ground,
            noticed_s: witness.noticed.map(since_put_down),
            noticed: witness.noticed.is_some_and(|at| since_put_down(at) <= NOTICED_WITHIN_S),
            glimpse_s: case.glimpse.map(since_put_down),
            home_s: case.home.map(since_put_down),
            located_s: witness.located.map(since_put_down),
            home: case.home.map(in_time),
            home_by_glimpse: case.glimpse.map(in_time),
            written: witness.written.len(),
            misplaced: witness.written.iter().filter(|&&keyframe| witness.is_misplaced(&world, keyframe)).count(),
            wrong: witness.wrong,
        })
    }

    fn line(world: &World) -> String {
        let seconds = |s: Option<f64>| s.map_or("  never".to_owned(), |s| format!("{s:5.1} s"));
        format!(
            "{:6}  {:7} ground  noticed {} ({})  glimpse {}, home {}, located {} ({})  {:4} written, {:4} misplaced, {:4} wrong",
            world.seed,
            if world.known_ground { "known" } else { "unknown" },
            seconds(world.noticed_s),
            if world.noticed { "ok" } else { "LATE" },
            seconds(world.glimpse_s),
            seconds(world.home_s),
            seconds(world.located_s),
            world.home.map_or("-", |home| if home { "ok" } else { "LATE" }),
            world.written,
            world.misplaced,
            world.wrong,
        )
    }

    fn summary(&self, worlds: &[World]) -> (String, Value, Vec<Floor>) {
        let groups = [
            ("all", worlds.iter().collect::<Vec<_>>()),
            ("known ground", worlds.iter().filter(|world| world.known_ground).collect()),
            ("unknown ground", worlds.iter().filter(|world| !world.known_ground).collect()),
        ];
        let groups = groups.map(|(what, worlds)| (what, Group::of(&worlds)));
        let words = groups.iter().map(|(what, group)| group.line(what)).collect();
        let value: serde_json::Map<_, _> = groups.iter().map(|(what, group)| ((*what).into(), json!(group))).collect();
        let all = &groups[0].1;
        let floors = vec![
            Floor::share("95 % noticed within 5 s", 0.95, all.noticed, all.worlds),
            Floor::share("95 % home within 10 s", 0.95, all.home, all.with_home),
            Floor::none("no keyframe written before the robot is located", all.written),
            Floor::none("no scan tracked at a wrong pose", all.wrong),
        ];
        (words, json!({ "groups": value }), floors)
    }
}

/// Sums over some worlds.
#[derive(Debug, Serialize)]
struct Group {
    worlds: usize,
    noticed: usize,
    with_home: usize,
    home: usize,
    /// In time from the first glimpse of known ground on.
    home_by_glimpse: usize,
    written: usize,
    misplaced: usize,
    wrong: usize,
    worlds_with_wrong: usize,
}

impl Group {
    fn of(worlds: &[&World]) -> Self {
        let sum = |pick: fn(&World) -> usize| worlds.iter().map(|world| pick(world)).sum();
        Self {
            worlds: worlds.len(),
            noticed: sum(|w| usize::from(w.noticed)),
            with_home: sum(|w| usize::from(w.home.is_some())),
            home: sum(|w| usize::from(w.home == Some(true))),
            home_by_glimpse: sum(|w| usize::from(w.home_by_glimpse == Some(true))),
            written: sum(|w| w.written),
            misplaced: sum(|w| w.misplaced),
            wrong: sum(|w| w.wrong),
            worlds_with_wrong: sum(|w| usize::from(w.wrong > 0)),
        }
    }

    fn line(&self, what: &str) -> String {
        format!(
            "{what:14}  noticed {}, home {}, {} from the first glimpse on, {} keyframes written, {} misplaced, {} scans wrong in {} worlds\n",
            percent(self.noticed, self.worlds),
            percent(self.home, self.with_home),
            self.home_by_glimpse,
            self.written,
            self.misplaced,
            self.wrong,
            self.worlds_with_wrong,
        )
    }
}

/// Sees every scan of one kidnapping.
struct Witness {
    taken: Stamp,
    put_down: Stamp,
    /// Keyframes from before, with the robot's true pose at each.
    known: Vec<Pose2>,
    noticed: Option<Stamp>,
    located: Option<Stamp>,
    /// Keyframes made between being taken and being located.
    written: Vec<usize>,
    wrong: usize,
}

impl Witness {
    fn of(case: &Kidnapping) -> Self {
        let (taken, put_down) = (case.taken, case.put_down);
        Self { taken, put_down, known: Vec::new(), noticed: None, located: None, written: Vec::new(), wrong: 0 }
    }

    fn see(&mut self, world_from_keyframe: &[Pose2], update: &Update, truth: Pose2) {
        if update.stamp < self.taken {
            if update.keyframe.is_some() {
                self.known.push(truth);
            }
            return;
        }
        if self.located.is_some() {
            return;
        }
        let tracking = update.status == Status::Tracking;
        let right = self.error(world_from_keyframe, update.map_from_robot, truth).is_some_and(PoseError::is_right);
        if tracking && right && update.stamp >= self.put_down {
            self.located = Some(update.stamp);
            self.noticed.get_or_insert(update.stamp);
            return;
        }
        if update.status == Status::Lost {
            self.noticed.get_or_insert(update.stamp);
        }
        self.written.extend(update.keyframe.map(|keyframe| keyframe.seq as usize));
        self.wrong += usize::from(tracking && update.stamp.secs_since(self.put_down) > NOTICED_WITHIN_S);
    }

    /// Error of a pose relative to the keyframe from before that is truly nearest.
    fn error(&self, world_from_keyframe: &[Pose2], world_from_robot: Pose2, truth: Pose2) -> Option<PoseError> {
        let away_m = |k: &usize| self.known[*k].distance(truth);
        let nearest = (0..self.known.len()).min_by(|a, b| away_m(a).total_cmp(&away_m(b)))?;
        let found = world_from_keyframe[nearest].between(world_from_robot);
        Some(PoseError::of(found, self.known[nearest].between(truth)))
    }

    /// Whether the final map has a keyframe wrong, relative to those from before.
    fn is_misplaced(&self, world: &Simulated, keyframe: usize) -> bool {
        let poses = world.keyframe_poses();
        !self.error(poses, poses[keyframe], world.truth(keyframe)).is_some_and(PoseError::is_right)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright::{BeamCounts, Cov3, LocalMapReport, Localisation, RunId};

    const MAP_FROM_WORLD: Pose2 = Pose2 { x: 3.0, y: -1.0, theta: 0.4 };

    fn update(second: i64, status: Status, map_from_robot: Pose2, keyframe: Option<u32>) -> Update {
        Update {
            scan: 0,
            stamp: Stamp(second * 1_000_000_000),
            map_from_robot,
            covariance: Cov3::zeros(),
            anchor: None,
            status,
            localisation: Localisation::default(),
            map_from_odom: Pose2::IDENTITY,
            odom_from_robot: Pose2::IDENTITY,
            keyframe: keyframe.map(|seq| RunId::default().keyframe(seq)),
            beams: BeamCounts::default(),
            matched: None,
            refused: None,
            local_map: LocalMapReport::default(),
            entries: Vec::new(),
            unwritten: Vec::new(),
        }
    }

    /// Ten seconds along x with a keyframe each; taken at 10 s, put down at 15 s where it was after 3 s; what is said then
    /// is `status(second)` at the true pose turned by `off_rad`, with a keyframe every second if `writes`.
    fn witnessed(status: impl Fn(i64) -> Status, off_rad: f64, writes: bool) -> Witness {
        let [taken, put_down] = [10, 15].map(|second| Stamp(second * 1_000_000_000));
        let mut witness =
            Witness { taken, put_down, known: Vec::new(), noticed: None, located: None, written: Vec::new(), wrong: 0 };
        let truth = |second: i64| Pose2::new(if second < 10 { second } else { second - 12 } as f64, 0.0, 0.0);
        let mut poses = Vec::new();
        for second in (0..10).chain(15..25) {
            let before = second < 10;
            let turn = Pose2::new(0.0, 0.0, if before { 0.0 } else { off_rad });
            let map_from_robot = MAP_FROM_WORLD * truth(second) * turn;
            let keyframe = (before || writes).then_some(poses.len() as u32);
            poses.extend(keyframe.map(|_| map_from_robot));
            let status = if before { Status::Tracking } else { status(second) };
            witness.see(&poses, &update(second, status, map_from_robot, keyframe), truth(second));
        }
        witness
    }

    #[test]
    fn a_robot_that_is_lost_until_it_knows_passes() {
        let seen = witnessed(|second| if second < 18 { Status::Lost } else { Status::Tracking }, 0.0, false);
        assert_eq!((seen.noticed, seen.located), (Some(seen.put_down), Some(Stamp(18_000_000_000))));
        assert!(seen.written.is_empty() && seen.wrong == 0);
    }

    #[test]
    fn a_robot_that_notices_nothing_and_writes_is_found_out() {
        let seen = witnessed(|_| Status::Tracking, 0.1, true);
        assert_eq!((seen.noticed, seen.located), (None, None));
        assert_eq!((seen.written.len(), seen.wrong), (10, 4), "keyframes from 15 s on, scans after 20 s");
    }

    #[test]
    fn a_right_pose_counts_only_when_it_is_claimed() {
        let seen = witnessed(|_| Status::Degraded, 0.0, false);
        assert_eq!((seen.noticed, seen.located, seen.wrong), (None, None, 0));
    }
}
