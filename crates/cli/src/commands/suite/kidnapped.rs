//! `mapwright suite kidnapped`

use super::Measure;
use super::floors::{Floor, percent, stats};
use crate::failure::Failure;
use crate::simulated::{PoseError, Simulated};
use mapwright::{EdgeKind, Fragment, Localisation, Piece, Pose2, Session, Settings, Stamp, Status, Update};
use mapwright_sim::{Kidnapping, kidnapping};
use serde::Serialize;
use serde_json::{Value, json};

/// So long after it has come to known ground what the robot maps must be joined with what was mapped before, seconds.
const HOME_WITHIN_S: f64 = 10.0;

pub(super) struct Kidnapped {
    pub(super) settings: Settings,
}

#[derive(Debug, Serialize)]
pub(super) struct World {
    seed: u64,
    known_ground: bool,
    /// Seconds from being put down until the robot comes to known ground; none where it never does.
    home_s: Option<f64>,
    /// Seconds from being put down until what it maps was joined, and rightly.
    joined_s: Option<f64>,
    /// The same from when it came to known ground; negative where what it sees from elsewhere is enough.
    after_home_s: Option<f64>,
    /// Whether in time; none where it never comes to known ground.
    in_time: Option<bool>,
    /// Whether it was joined rightly once and is joined at the end.
    joined: bool,
    /// Keyframes made since it was put down,
    keyframes: usize,
    /// of which so many are in fragments that nothing joins,
    apart: usize,
    /// and so many of the others lie wrong in the final map.
    misplaced: usize,
    /// Keyframes made on the way, which show no place.
    in_the_air: usize,
    /// Scans at a wrong pose since it was put down that were said to be joined and to fit.
    wrong: usize,
    /// Closures that lead from before it was taken to after and say what is not so.
    wrong_joins: usize,
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
        let joined_since = |from: Stamp| witness.joined.map(|at| at.secs_since(from));
        let (apart, placed) = witness.apart_and_placed(world.session());
        Ok(World {
            seed,
            known_ground: case.known_ground,
            home_s: case.home.map(|home| home.secs_since(case.put_down)),
            joined_s: joined_since(case.put_down),
            after_home_s: case.home.and_then(joined_since),
            in_time: case.home.map(|home| joined_since(home).is_some_and(|s| s <= HOME_WITHIN_S)),
            joined: witness.joined.is_some() && witness.localisation == Localisation::Joined,
            keyframes: witness.made.len(),
            apart: apart.len(),
            misplaced: placed.into_iter().filter(|&keyframe| witness.is_misplaced(&world, keyframe)).count(),
            in_the_air: witness.in_the_air,
            wrong: witness.wrong,
            wrong_joins: witness.wrong_joins(&world),
        })
    }

    fn line(world: &World) -> String {
        let seconds = |s: Option<f64>| s.map_or("  never".to_owned(), |s| format!("{s:5.1} s"));
        format!(
            "{:6}  {:7} ground  home {}, joined {} ({})  {:4} keyframes, {:4} apart, {:4} misplaced, {:3} in the air  {:4} scans and {:2} joins wrong",
            world.seed,
            if world.known_ground { "known" } else { "unknown" },
            seconds(world.home_s),
            seconds(world.joined_s),
            match world.in_time {
                _ if !world.joined => "APART",
                Some(false) => "LATE",
                Some(true) => "ok",
                None => "-",
            },
            world.keyframes,
            world.apart,
            world.misplaced,
            world.in_the_air,
            world.wrong,
            world.wrong_joins,
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
            Floor::none("no keyframe misplaced in the final map", all.misplaced),
            Floor::share("95 % joined at the end", 0.95, all.joined, all.with_home),
            Floor::share("80 % joined within 10 s of known ground", 0.8, all.in_time, all.with_home),
        ];
        (words, json!({ "groups": value }), floors)
    }
}

/// Sums over some worlds.
#[derive(Debug, Serialize)]
struct Group {
    worlds: usize,
    /// In which the robot comes to known ground,
    with_home: usize,
    /// and is joined at the end, and in time.
    joined: usize,
    in_time: usize,
    /// Medians over those in which it was joined and came to known ground, seconds.
    median_joined_s: Option<f64>,
    median_after_home_s: Option<f64>,
    keyframes: usize,
    apart: usize,
    misplaced: usize,
    worlds_with_misplaced: usize,
    in_the_air: usize,
    wrong: usize,
    worlds_with_wrong: usize,
    wrong_joins: usize,
}

impl Group {
    fn of(worlds: &[&World]) -> Self {
        let sum = |pick: fn(&World) -> usize| worlds.iter().map(|world| pick(world)).sum();
        let timed: Vec<[f64; 2]> = worlds.iter().filter_map(|w| Some([w.joined_s?, w.after_home_s?])).collect();
        let median = |pick: fn(&[f64; 2]) -> f64| stats(&timed, pick).map(|stats| stats.median);
        Self {
            worlds: worlds.len(),
            with_home: sum(|w| usize::from(w.home_s.is_some())),
            joined: sum(|w| usize::from(w.home_s.is_some() && w.joined)),
            in_time: sum(|w| usize::from(w.in_time == Some(true))),
            median_joined_s: median(|s| s[0]),
            median_after_home_s: median(|s| s[1]),
            keyframes: sum(|w| w.keyframes),
            apart: sum(|w| w.apart),
            misplaced: sum(|w| w.misplaced),
            worlds_with_misplaced: sum(|w| usize::from(w.misplaced > 0)),
            in_the_air: sum(|w| w.in_the_air),
            wrong: sum(|w| w.wrong),
            worlds_with_wrong: sum(|w| usize::from(w.wrong > 0)),
            wrong_joins: sum(|w| w.wrong_joins),
        }
    }

    fn line(&self, what: &str) -> String {
        let seconds = |s: Option<f64>| s.map_or("-".to_owned(), |s| format!("{s:.1} s"));
        format!(
            "{what:14}  joined {}, in time {}, median {} from being put down, {} from known ground; {} keyframes, {} apart, {} misplaced in {} worlds, {} in the air; {} scans wrong in {} worlds, {} joins wrong\n",
            percent(self.joined, self.with_home),
            percent(self.in_time, self.with_home),
            seconds(self.median_joined_s),
            seconds(self.median_after_home_s),
            self.keyframes,
            self.apart,
            self.misplaced,
            self.worlds_with_misplaced,
            self.in_the_air,
            self.wrong,
            self.worlds_with_wrong,
            self.wrong_joins,
        )
    }
}

/// Sees every scan of one kidnapping.
struct Witness {
    taken: Stamp,
    put_down: Stamp,
    /// Keyframes from before, with the robot's true pose at each.
    known: Vec<Pose2>,
    /// When it was first said to be joined where it is, once it was put down, and what is said now.
    joined: Option<Stamp>,
    localisation: Localisation,
    /// Keyframes made since it was put down, and how many on the way.
    made: Vec<usize>,
    in_the_air: usize,
    wrong: usize,
}

impl Witness {
    fn of(case: &Kidnapping) -> Self {
        Self::between(case.taken, case.put_down)
    }

    fn between(taken: Stamp, put_down: Stamp) -> Self {
        Self {
            taken,
            put_down,
            known: Vec::new(),
            joined: None,
            localisation: Localisation::default(),
            made: Vec::new(),
            in_the_air: 0,
            wrong: 0,
        }
    }

    fn see(&mut self, world_from_keyframe: &[Pose2], update: &Update, truth: Pose2) {
        self.localisation = update.localisation;
        if update.stamp < self.taken {
            if update.keyframe.is_some() {
                self.known.push(truth);
            }
            return;
        }
        if update.stamp < self.put_down {
            self.in_the_air += usize::from(update.keyframe.is_some());
            return;
        }
        self.made.extend(update.keyframe.map(|keyframe| keyframe.seq as usize));
        let is_claimed = update.localisation == Localisation::Joined && update.status != Status::Lost;
        if self.joined.is_some() || !is_claimed {
            return;
        }
        if self.error(world_from_keyframe, update.map_from_robot, truth).is_some_and(PoseError::is_right) {
            self.joined = Some(update.stamp);
        } else {
            self.wrong += 1;
        }
    }

    /// Error of a pose relative to the keyframe from before that is truly nearest.
    fn error(&self, world_from_keyframe: &[Pose2], world_from_robot: Pose2, truth: Pose2) -> Option<PoseError> {
        let away_m = |k: &usize| self.known[*k].distance(truth);
        let nearest = (0..self.known.len()).min_by(|a, b| away_m(a).total_cmp(&away_m(b)))?;
        let found = world_from_keyframe[nearest].between(world_from_robot);
        Some(PoseError::of(found, self.known[nearest].between(truth)))
    }

    /// Of the keyframes made since it was put down: those in pieces of the map that nothing joins with what was mapped before, and the
    /// others.
    fn apart_and_placed(&self, session: &Session) -> (Vec<usize>, Vec<usize>) {
        let pieces = session.pieces();
        let first = |fragment: &Fragment| session.place(fragment.first);
        let fragments = |piece: &Piece| piece.fragments.iter().filter_map(first).collect::<Vec<_>>();
        let pieces: Vec<Vec<usize>> = pieces.iter().map(fragments).collect();
        let known = self.known.len().checked_sub(1).and_then(|newest| piece_of(&pieces, newest));
        self.made.iter().partition(|&&keyframe| piece_of(&pieces, keyframe) != known)
    }

    /// Whether the final map has a keyframe wrong, relative to those from before.
    fn is_misplaced(&self, world: &Simulated, keyframe: usize) -> bool {
        let poses = world.keyframe_poses();
        !self.error(poses, poses[keyframe], world.truth(keyframe)).is_some_and(PoseError::is_right)
    }

    /// Closures from before it was taken to after that were measured wrong.
    fn wrong_joins(&self, world: &Simulated) -> usize {
        let joins = |from: usize, to: usize| (from < self.known.len()) != (to < self.known.len());
        let closings = world.closings();
        let is_wrong = |at: usize| joins(closings[at].from, closings[at].to) && !closings[at].measured.is_right();
        (0..closings.len()).filter(|&at| closings[at].kind == EdgeKind::Closure && is_wrong(at)).count()
    }
}

/// The number of the piece that a keyframe is in; a piece is the keyframes that its fragments begin with.
fn piece_of(pieces: &[Vec<usize>], keyframe: usize) -> Option<usize> {
    let begins = |firsts: &Vec<usize>| firsts.iter().copied().filter(|&first| first <= keyframe).max();
    (0..pieces.len()).max_by_key(|&number| begins(&pieces[number]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use mapwright::{BeamCounts, Cov3, LocalMapReport, RunId};

    const MAP_FROM_WORLD: Pose2 = Pose2 { x: 3.0, y: -1.0, theta: 0.4 };
    const JOINED: (Localisation, Status) = (Localisation::Joined, Status::Tracking);
    const APART: (Localisation, Status) = (Localisation::Apart, Status::Tracking);
    const LOST: (Localisation, Status) = (Localisation::Joined, Status::Lost);

    fn update(
        second: i64,
        (localisation, status): (Localisation, Status),
        map_from_robot: Pose2,
        keyframe: Option<u32>,
    ) -> Update {
        Update {
            scan: 0,
            stamp: Stamp(second * 1_000_000_000),
            map_from_robot,
            covariance: Cov3::zeros(),
            anchor: None,
            status,
            localisation,
            map_from_odom: Pose2::IDENTITY,
            odom_from_robot: Pose2::IDENTITY,
            keyframe: keyframe.map(|seq| RunId::default().keyframe(seq)),
            beams: BeamCounts::default(),
            matched: None,
            refused: None,
            local_map: LocalMapReport::default(),
            waiting_keyframes: 0,
            entries: Vec::new(),
            unwritten: Vec::new(),
        }
    }

    /// Ten seconds along x with a keyframe each; taken at 10 s, put down at 15 s where it was after 3 s; what is said from then on is
    /// `said(second)` at the true pose turned by `off_rad(second)`, with a keyframe every second, as there is on the way.
    fn witnessed(said: impl Fn(i64) -> (Localisation, Status), off_rad: impl Fn(i64) -> f64) -> Witness {
        let [taken, put_down] = [10, 15].map(|second| Stamp(second * 1_000_000_000));
        let mut witness = Witness::between(taken, put_down);
        let truth = |second: i64| Pose2::new(if second < 10 { second } else { second - 12 } as f64, 0.0, 0.0);
        let mut poses = Vec::new();
        for second in 0..25 {
            let before = second < 10;
            let turn = Pose2::new(0.0, 0.0, if before { 0.0 } else { off_rad(second) });
            let map_from_robot = MAP_FROM_WORLD * truth(second) * turn;
            let keyframe = Some(poses.len() as u32);
            poses.push(map_from_robot);
            let said = if before { JOINED } else { said(second) };
            witness.see(&poses, &update(second, said, map_from_robot, keyframe), truth(second));
        }
        witness
    }

    #[test]
    fn a_robot_that_is_apart_until_it_is_joined_passes() {
        let seen = witnessed(|second| if second < 18 { APART } else { JOINED }, |_| 0.0);
        assert_eq!((seen.joined, seen.wrong), (Some(Stamp(18_000_000_000)), 0));
        assert_eq!((seen.in_the_air, seen.made), (5, (15..25).collect()), "each second from 10 s and from 15 s on");
    }

    #[test]
    fn a_robot_that_notices_nothing_is_found_out() {
        let seen = witnessed(|_| JOINED, |second| if second < 22 { 0.1 } else { 0.0 });
        assert_eq!((seen.joined, seen.wrong), (Some(Stamp(22_000_000_000)), 7), "wrong from 15 s to 21 s");
    }

    #[test]
    fn a_keyframe_is_in_the_piece_of_the_fragment_that_began_last() {
        let pieces = [vec![0, 20], vec![10], vec![30]];
        let piece = |keyframe| piece_of(&pieces, keyframe);
        assert_eq!([0, 9, 10, 19, 20, 29, 30, 99].map(piece), [0, 0, 1, 1, 0, 0, 2, 2].map(Some));
        assert_eq!(piece_of(&[], 3), None);
    }

    #[test]
    fn a_pose_counts_only_when_it_is_claimed() {
        for said in [APART, LOST] {
            for off_rad in [0.0, 0.1] {
                let seen = witnessed(|_| said, |_| off_rad);
                assert_eq!((seen.joined, seen.wrong), (None, 0), "{said:?} {off_rad}");
            }
        }
    }
}
