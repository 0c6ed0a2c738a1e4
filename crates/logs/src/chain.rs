//! Odometry over several logs of one drive.

use mapwright_geom::{Pose2, Stamp};

/// Odometry goes on where the next log begins at most so long after, and no farther away: seconds, metres, metres per second.
/// Not farther than 10 m even after a minute: odometry that began anew is to be told from one that went on, and the origin of
/// the new one may lie within what a robot can have driven.
const PAUSE_MOST_S: f64 = 60.0;
const STEP_MOST_M: f64 = 10.0;
const SLACK_M: f64 = 1.0;
const SPEED_MOST_M_S: f64 = 3.0;

/// A reading and what it is in the drive's odometry.
#[derive(Debug, Clone, Copy)]
struct Last {
    stamp: Stamp,
    said: Pose2,
    chained: Pose2,
}

/// Joins the odometry of each log to that of the log before.
#[derive(Debug)]
pub(crate) struct Chain {
    drive_from_odom: Pose2,
    last: Option<Last>,
    /// The log whose first reading is still to come.
    fresh: Option<String>,
    pub(crate) notes: Vec<String>,
}

impl Default for Chain {
    fn default() -> Self {
        Self { drive_from_odom: Pose2::IDENTITY, last: None, fresh: None, notes: Vec::new() }
    }
}

impl Chain {
    /// The next log begins.
    pub(crate) fn begin(&mut self, name: &str) {
        self.fresh = Some(name.to_owned());
    }

    /// A pose of the log's odometry in the drive's.
    pub(crate) fn pose(&mut self, stamp: Stamp, said: Pose2) -> Pose2 {
        if let (Some(name), Some(last)) = (self.fresh.take(), self.last) {
            self.join(&name, stamp, said, last);
        }
        let is_moved = self.drive_from_odom != Pose2::IDENTITY;
        let chained = if is_moved { self.drive_from_odom * said } else { said };
        self.last = Some(Last { stamp, said, chained });
        chained
    }

    fn join(&mut self, name: &str, stamp: Stamp, said: Pose2, last: Last) {
        let (pause_s, step_m) = (stamp.secs_since(last.stamp), last.said.distance(said));
        let reach_m = (SLACK_M + SPEED_MOST_M_S * pause_s).min(STEP_MOST_M);
        if (0.0..=PAUSE_MOST_S).contains(&pause_s) && step_m <= reach_m {
            self.notes.push(format!("{name}: odometry goes on {pause_s:.1} s after the log before, {step_m:.2} m on"));
            return;
        }
        self.drive_from_odom = last.chained * said.inverse();
        self.notes.push(format!(
            "{name}: odometry does not go on from the log before ({pause_s:.1} s later, {step_m:.2} m away): joined as if the \
             robot had not moved in between"
        ));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chained(gap_s: f64, first_of_second: Pose2) -> (Pose2, String) {
        let mut chain = Chain::default();
        chain.begin("a");
        assert_eq!(chain.pose(Stamp(0), Pose2::new(5.0, 1.0, 0.3)), Pose2::new(5.0, 1.0, 0.3));
        chain.begin("b");
        let pose = chain.pose(Stamp::from_secs_f64(gap_s), first_of_second);
        (pose, chain.notes.pop().unwrap())
    }

    #[test]
    fn odometry_that_goes_on_is_left_alone() {
        let (pose, note) = chained(0.5, Pose2::new(5.2, 1.0, 0.3));
        assert_eq!(pose, Pose2::new(5.2, 1.0, 0.3));
        assert!(note.contains("goes on 0.5 s"), "{note}");
    }

    #[test]
    fn odometry_that_begins_anew_is_joined_to_the_end_of_the_log_before() {
        for (gap_s, first) in [(0.5, Pose2::IDENTITY), (-100.0, Pose2::new(5.0, 1.0, 0.3)), (1e4, Pose2::IDENTITY)] {
            let (pose, note) = chained(gap_s, first);
            assert!(pose.distance(Pose2::new(5.0, 1.0, 0.3)) < 1e-12, "{pose:?}");
            assert!(note.contains("does not go on"), "{note}");
        }
    }
}
