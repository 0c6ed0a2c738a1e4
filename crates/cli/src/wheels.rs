//! What wheels and scans say of the same motions.

use crate::calibration::{Sample, calibrate};
use mapwright::{Pose2, Pose3, Session};
use mapwright_geom::Pose;

/// Motions are compared over so much way, metres, or such a turn, radians; the median counts.
const MOTION_M: f64 = 0.5;
const MOTION_RAD: f64 = 0.3;
/// What differs by less than so many standard deviations may do so by chance.
const SIGMAS: f64 = 3.0;
/// The point about which the robot turns is looked for in stretches of so many scans, those with most turning, of so many scans at most:
/// more say little that is new, and a run costs the same however long it was.
const STRETCH: usize = 100;
const LOOKED_AT: usize = 2000;

/// The motion that the map says, beside what the wheels say; as equal where it may differ by chance.
pub(crate) struct Wheels {
    /// How many motions were compared.
    pub(crate) motions: usize,
    /// As multiples of what the wheels say.
    pub(crate) turns: f64,
    pub(crate) way: f64,
    /// The direction of the way beside theirs.
    pub(crate) aside_rad: f64,
    /// The point that turns as the wheels say lies so far from where the map has the robot, metres.
    pub(crate) lever_m: f64,
}

/// One motion by both.
struct Motion {
    said: Pose2,
    mapped: Pose2,
}

impl Wheels {
    pub(crate) fn of(session: &Session) -> Self {
        let scans = session.scans().iter().zip(session.trajectory());
        let scans: Vec<Sample> = scans
            .map(|(scan, pose)| Sample {
                stamp: scan.stamp,
                odom_from_robot: scan.odom_from_robot,
                map_from_laser: pose.map_from_robot,
            })
            .collect();
        let pairs = scans.iter().map(|scan| (scan.odom_from_robot, scan.map_from_laser));
        Self { lever_m: lever_m(&scans).unwrap_or(0.0), ..Self::of_motions(&motions(pairs, |motion| motion)) }
    }

    /// The same of a robot in space, by its poses by wheels and in the map: how it moves in its own plane. The point about which it turns is
    /// not looked for.
    pub(crate) fn in_space(poses: impl Iterator<Item = (Pose3, Pose3)>) -> Self {
        let in_plane =
            |motion: Pose3| Pose2::new(motion.translation.x, motion.translation.y, motion.rotation.euler_angles().2);
        Self::of_motions(&motions(poses, in_plane))
    }

    fn of_motions(motions: &[Motion]) -> Self {
        let is_turn = |motion: &&Motion| motion.said.theta.abs() >= MOTION_RAD;
        let (turning, straight): (Vec<&Motion>, Vec<&Motion>) = motions.iter().partition(is_turn);
        let length = |pose: Pose2| pose.x.hypot(pose.y);
        let aside =
            |motion: &&Motion| wrapped(motion.mapped.y.atan2(motion.mapped.x) - motion.said.y.atan2(motion.said.x));
        Self {
            motions: motions.len(),
            turns: median(turning.iter().map(|motion| motion.mapped.theta / motion.said.theta).collect(), 1.0),
            way: median(straight.iter().map(|motion| length(motion.mapped) / length(motion.said)).collect(), 1.0),
            aside_rad: median_direction(straight.iter().map(aside).collect()),
            lever_m: 0.0,
        }
    }
}

/// Motions by poses that wheels and the map say.
fn motions<P: Pose>(poses: impl Iterator<Item = (P, P)>, in_plane: impl Fn(P) -> Pose2) -> Vec<Motion> {
    let mut motions = Vec::new();
    let mut from: Option<(P, P)> = None;
    for (odom_from_robot, map_from_robot) in poses {
        let Some((odom_from_then, map_from_then)) = from else {
            from = Some((odom_from_robot, map_from_robot));
            continue;
        };
        let said = in_plane(odom_from_then.between(odom_from_robot));
        if said.theta.abs() >= MOTION_RAD || said.x.hypot(said.y) >= MOTION_M {
            motions.push(Motion { said, mapped: in_plane(map_from_then.between(map_from_robot)) });
            from = Some((odom_from_robot, map_from_robot));
        }
    }
    motions
}

/// How far the point that moves as the wheels say lies from where the map has the robot, metres, or none where that may be chance. The
/// robot as it was mapped takes the place of the laser in the calibration.
fn lever_m(scans: &[Sample]) -> Option<f64> {
    let turned = |run: &[Sample]| -> f64 {
        let steps = run.windows(2).map(|pair| pair[0].map_from_laser.between(pair[1].map_from_laser));
        steps.map(|step| step.theta.abs()).sum()
    };
    let mut runs: Vec<_> = scans.chunks(STRETCH).map(|run| (turned(run), run)).collect();
    runs.sort_by(|a, b| b.0.total_cmp(&a.0));
    let runs: Vec<Vec<Sample>> = runs.iter().take(LOOKED_AT / STRETCH).map(|(_, run)| run.to_vec()).collect();
    let found = calibrate(&runs, Pose2::IDENTITY).ok()?;
    let sigma_m = found.x_m.sigma.hypot(found.y_m.sigma);
    let lever_m = found.x_m.value.hypot(found.y_m.value);
    let told_m = if lever_m > SIGMAS * sigma_m { lever_m } else { 0.0 };
    lever_m.is_finite().then_some(told_m)
}

fn wrapped(angle_rad: f64) -> f64 {
    angle_rad.sin().atan2(angle_rad.cos())
}

/// The median, or `equal` where that lies within the median's confidence interval by order statistics: of so many values no more lie to
/// one side of their true median than a fair coin would show heads, within [`SIGMAS`] standard deviations.
fn median(mut values: Vec<f64>, equal: f64) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    let half = 0.5 * values.len() as f64;
    let first = half - SIGMAS * (0.5 * half).sqrt();
    if values.is_empty() || first < 0.0 {
        return equal;
    }
    let first = first as usize;
    let by_chance = values[first]..=values[values.len() - 1 - first];
    if by_chance.contains(&equal) { equal } else { values[values.len() / 2] }
}

/// The median of directions, radians: of their deviations from the mean direction, so that it does not matter where the circle is cut.
/// Zero where the median may be so by chance, or where the directions prefer none (Rayleigh's test).
fn median_direction(directions_rad: Vec<f64>) -> f64 {
    let (sin, cos) = directions_rad.iter().fold((0.0, 0.0), |(sin, cos), at| (sin + at.sin(), cos + at.cos()));
    if f64::hypot(sin, cos) < SIGMAS * (directions_rad.len() as f64).sqrt() {
        return 0.0;
    }
    let mean_rad = sin.atan2(cos);
    let beside = directions_rad.iter().map(|at| wrapped(at - mean_rad)).collect();
    wrapped(mean_rad + median(beside, wrapped(-mean_rad)))
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may")]
mod tests {
    use super::*;
    use mapwright::Stamp;

    /// A drive with turns to both sides; the map has the robot there on the true one.
    fn driven(robot_from_mapped: Pose2, lag_s: f64, scale: f64) -> Vec<Sample> {
        let mut world_from_robot = Pose2::IDENTITY;
        let mut odom_from_robot = Pose2::IDENTITY;
        let step = |at_s: f64| {
            let speed = 0.3 + 0.2 * (0.31 * at_s).sin();
            [0.1 * speed, 0.1 * 0.6 * (0.2 * at_s).sin()]
        };
        (0..4000)
            .map(|k| {
                let now_s = 0.1 * f64::from(k);
                let map_from_laser = world_from_robot * robot_from_mapped;
                let both = Sample { stamp: Stamp::from_secs_f64(now_s), odom_from_robot, map_from_laser };
                let [ahead_m, turn_rad] = step(now_s);
                world_from_robot = world_from_robot * Pose2::new(ahead_m, 0.0, turn_rad);
                let [ahead_m, turn_rad] = step(now_s - lag_s);
                odom_from_robot = odom_from_robot * Pose2::new(ahead_m / scale, 0.0, turn_rad);
                both
            })
            .collect()
    }

    #[test]
    fn a_laser_that_is_said_to_sit_elsewhere_shows_in_turns() {
        for (off, lag_s, scale) in
            [([0.0, 0.0], 0.0, 1.0), ([0.2, 0.0], 0.0, 1.04), ([-0.1, 0.15], 0.2, 0.97), ([0.0, 0.0], -0.2, 1.05)]
        {
            let found = lever_m(&driven(Pose2::new(off[0], off[1], 0.0), lag_s, scale)).unwrap();
            assert!((found - off[0].hypot(off[1])).abs() < 0.02, "{off:?} {lag_s} {scale}: {found}");
        }
    }

    #[test]
    fn a_median_is_told_from_chance() {
        let from = |first: i32, count: i32| (first..first + count).map(f64::from).collect();
        assert_eq!(median(from(0, 0), 1.0), 1.0);
        // That all of nine lie to one side of what is equal happens by chance in one drive of 256.
        assert_eq!(median(from(1, 8), 0.0), 0.0);
        assert_eq!(median(from(1, 9), 0.0), 5.0);
        assert_eq!(median(from(0, 9), 0.0), 0.0);
        // So does it that only 35 of a hundred lie to one side, or fewer.
        assert_eq!(median(from(-35, 100), 0.0), 0.0);
        assert_eq!(median(from(-34, 100), 0.0), 16.0);
    }

    #[test]
    fn a_median_direction_does_not_depend_on_where_the_circle_is_cut() {
        // scattered evenly within 2 degrees
        let around =
            |middle_deg: f64| (-20..=20).map(|k| wrapped((middle_deg + 0.1 * f64::from(k)).to_radians())).collect();
        for middle_deg in [180.0, 179.5, -179.0, 135.0, -90.0, 10.0] {
            let off_deg = wrapped(median_direction(around(middle_deg)) - f64::to_radians(middle_deg)).to_degrees();
            assert!(off_deg.abs() < 1e-6, "{middle_deg}: {off_deg}");
        }
        assert_eq!(median_direction(around(0.2)), 0.0, "that may be chance");
        assert_eq!(median_direction((0..60).map(f64::from).collect()), 0.0, "all around the circle");
        assert_eq!(median_direction(Vec::new()), 0.0);
    }

    #[test]
    fn a_robot_mapped_the_wrong_way_round_is_told() {
        for turned_deg in [135.0_f64, 180.0] {
            let scans = driven(Pose2::new(0.0, 0.0, turned_deg.to_radians()), 0.0, 1.0);
            let motions =
                motions(scans.iter().map(|scan| (scan.odom_from_robot, scan.map_from_laser)), |motion| motion);
            let aside =
                |motion: &Motion| wrapped(motion.mapped.y.atan2(motion.mapped.x) - motion.said.y.atan2(motion.said.x));
            let found = median_direction(motions.iter().map(aside).collect());
            assert!((found.abs().to_degrees() - turned_deg).abs() < 3.0, "{turned_deg}: {}", found.to_degrees());
        }
    }

    #[test]
    fn a_drive_that_never_turns_says_nothing_of_it() {
        let sample = |k: u32| {
            let pose = Pose2::new(0.05 * f64::from(k), 0.0, 0.0);
            Sample { stamp: Stamp::from_secs_f64(0.1 * f64::from(k)), odom_from_robot: pose, map_from_laser: pose }
        };
        assert_eq!(lever_m(&(0..400).map(sample).collect::<Vec<_>>()), None);
    }
}
