//! What wheels and scans say of the same motions.

use mapwright::{Pose2, Session};
use nalgebra::{Matrix5, Vector5};

/// Motions are compared over so much way, metres, or such a turn, radians, and at least so many of each; the median counts.
const MOTION_M: f64 = 0.5;
const MOTION_RAD: f64 = 0.3;
const MOTIONS: usize = 20;
/// Scans farther apart say nothing about the speed between them, seconds.
const SPEED_WITHIN_S: f64 = 2.0;
/// Residuals beyond so many robust standard deviations lose weight (Huber 1964).
const HUBER: f64 = 1.345;
const ITERATIONS: usize = 10;
/// What is left of a standard deviation where nothing is, metres: rounding.
const SIGMA_AT_LEAST_M: f64 = 1e-6;

/// The motion that the map says, beside what the wheels say; as equal where the robot has hardly moved.
pub(crate) struct Wheels {
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
    /// The wheels' speed before and after, metres a second, each as seen by the robot then.
    speeds: [[f64; 2]; 2],
}

/// A scan's stamp, seconds, and where wheels and map have the robot.
type Both = (f64, Pose2, Pose2);

impl Wheels {
    pub(crate) fn of(session: &Session) -> Self {
        let scans: Vec<Both> = session
            .scans()
            .iter()
            .zip(session.trajectory())
            .map(|(scan, pose)| (scan.stamp.as_secs_f64(), scan.odom_from_robot, pose.map_from_robot))
            .collect();
        let motions = motions(&scans);
        let is_turn = |motion: &&Motion| motion.said.theta.abs() >= MOTION_RAD;
        let (turning, straight): (Vec<&Motion>, Vec<&Motion>) = motions.iter().partition(is_turn);
        let length = |pose: Pose2| pose.x.hypot(pose.y);
        let aside =
            |motion: &&Motion| wrapped(motion.mapped.y.atan2(motion.mapped.x) - motion.said.y.atan2(motion.said.x));
        let turns = median(turning.iter().map(|motion| motion.mapped.theta / motion.said.theta).collect());
        let way = median(straight.iter().map(|motion| length(motion.mapped) / length(motion.said)).collect());
        Self {
            turns: turns.unwrap_or(1.0),
            way: way.unwrap_or(1.0),
            aside_rad: median(straight.iter().map(aside).collect()).unwrap_or(0.0),
            lever_m: if turning.len() >= MOTIONS { lever_m(&motions).unwrap_or(0.0) } else { 0.0 },
        }
    }
}

fn motions(scans: &[Both]) -> Vec<Motion> {
    let mut motions = Vec::new();
    let mut from = 0;
    for at in 1..scans.len() {
        let ((_, odom_from_from, map_from_from), (_, odom_from_at, map_from_at)) = (scans[from], scans[at]);
        let (said, mapped) = (odom_from_from.between(odom_from_at), map_from_from.between(map_from_at));
        if said.theta.abs() >= MOTION_RAD || said.x.hypot(said.y) >= MOTION_M {
            motions.push(Motion { said, mapped, speeds: [speed_m_per_s(scans, from), speed_m_per_s(scans, at)] });
            from = at;
        }
    }
    motions
}

/// Around a scan; zero where the stamps do not tell.
fn speed_m_per_s(scans: &[Both], at: usize) -> [f64; 2] {
    let (before, after) = (scans[at.saturating_sub(1)], scans[(at + 1).min(scans.len() - 1)]);
    let seconds = after.0 - before.0;
    if !(seconds > 0.0 && seconds < SPEED_WITHIN_S) {
        return [0.0; 2];
    }
    let here = scans[at].1;
    let moved = |odom_from_robot: Pose2| here.between(odom_from_robot);
    let (before, after) = (moved(before.1), moved(after.1));
    [(after.x - before.x) / seconds, (after.y - before.y) / seconds]
}

/// How far the point that moves as the wheels say lies from where the map has the robot, metres; the nearest that can be within three
/// standard deviations.
///
/// Where the map has the robot off by `d`, it sees it move by `s R t + (Q - 1) d + l (Q v1 - v0)` where the wheels say `t`: `s R` for their
/// radii and a laser that is turned, `Q` for how the robot turned, and `l` seconds by which odometry comes too late. All of that is
/// linear. Least squares with Huber weights.
fn lever_m(motions: &[Motion]) -> Option<f64> {
    let rows: Vec<(Vector5<f64>, f64)> = motions.iter().flat_map(rows_of).collect();
    let mut found = Vector5::new(1.0, 0.0, 0.0, 0.0, 0.0);
    let mut covariance = Matrix5::zeros();
    for _ in 0..ITERATIONS {
        let residuals: Vec<f64> = rows.iter().map(|(row, target)| target - row.dot(&found)).collect();
        let sigma_m = 1.4826 * median(residuals.iter().map(|residual| residual.abs()).collect())?;
        let sigma_m = sigma_m.max(SIGMA_AT_LEAST_M);
        let (mut normal, mut right) = (Matrix5::zeros(), Vector5::zeros());
        for ((row, target), residual) in rows.iter().zip(&residuals) {
            let weight = (HUBER * sigma_m / residual.abs()).min(1.0) / (sigma_m * sigma_m);
            normal += row * row.transpose() * weight;
            right += row * (weight * target);
        }
        covariance = normal.cholesky()?.inverse();
        found = covariance * right;
    }
    let [x, y] = [found[2], found[3]];
    let sigma_m = (covariance[(2, 2)] + covariance[(3, 3)]).sqrt();
    Some((x.hypot(y) - 3.0 * sigma_m).max(0.0)).filter(|lever_m| lever_m.is_finite())
}

fn rows_of(motion: &Motion) -> [(Vector5<f64>, f64); 2] {
    let Motion { said, mapped, speeds: [before, after] } = motion;
    let (sin, cos) = mapped.theta.sin_cos();
    let lags = [cos * after[0] - sin * after[1] - before[0], sin * after[0] + cos * after[1] - before[1]];
    [
        (Vector5::new(said.x, -said.y, cos - 1.0, -sin, lags[0]), mapped.x),
        (Vector5::new(said.y, said.x, sin, cos - 1.0, lags[1]), mapped.y),
    ]
}

fn wrapped(angle_rad: f64) -> f64 {
    angle_rad.sin().atan2(angle_rad.cos())
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied().filter(|_| values.len() >= MOTIONS)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may")]
mod tests {
    use super::*;

    /// A drive with turns to both sides; the map has the robot there on the true one.
    fn driven(robot_from_mapped: Pose2, lag_s: f64, scale: f64) -> Vec<Both> {
        let mut world_from_robot = Pose2::IDENTITY;
        let mut odom_from_robot = Pose2::IDENTITY;
        let step = |at_s: f64| {
            let speed = 0.3 + 0.2 * (0.31 * at_s).sin();
            [0.1 * speed, 0.1 * 0.6 * (0.2 * at_s).sin()]
        };
        (0..4000)
            .map(|k| {
                let now_s = 0.1 * f64::from(k);
                let both = (now_s, odom_from_robot, world_from_robot * robot_from_mapped);
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
            let motions = motions(&driven(Pose2::new(off[0], off[1], 0.0), lag_s, scale));
            let found = lever_m(&motions).unwrap();
            assert!((found - off[0].hypot(off[1])).abs() < 0.02, "{off:?} {lag_s} {scale}: {found}");
        }
    }

    #[test]
    fn a_drive_that_never_turns_says_nothing_of_it() {
        let straight: Vec<Both> = (0..400)
            .map(|k| Pose2::new(0.05 * f64::from(k), 0.0, 0.0))
            .enumerate()
            .map(|(k, pose)| (0.1 * k as f64, pose, pose))
            .collect();
        assert_eq!(lever_m(&motions(&straight)), None);
    }
}
