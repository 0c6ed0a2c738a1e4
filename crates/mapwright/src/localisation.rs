//! Whether the robot knows where it is. Nothing else remembers that.

use crate::front::{FrontEnd, Matched};
use check::Check;
use lost::Lost;
use mapwright_geom::Pose2;
use mapwright_record::{NodeId, Past, Status};
use mapwright_sensor::LaserScan;
use trial::{Outcome, Trial};

mod check;
mod look;
mod lost;
mod provisional;
mod trial;

/// From so many usual periods without hits on, and so many seconds, a robot may have been carried away.
const BLIND_PERIODS: f64 = 20.0;
const BLIND_S: f64 = 4.0;
/// After so many scans in a row that fit nowhere the robot is lost, and so much travel.
const LOST_SCANS: u32 = 10;

/// What is known of the robot's place in the map.
#[derive(Debug, Clone, Default)]
pub(crate) enum Localisation {
    /// It is believed.
    #[default]
    Tracking,
    /// After a time without a look at the world.
    Checking(Check),
    /// It was lost, and has found itself.
    OnTrial(Trial),
    /// It may be anywhere.
    Lost(Box<Lost>),
}

impl Localisation {
    /// Its name for the outside.
    pub(crate) fn state(&self) -> mapwright_record::Localisation {
        match self {
            Self::Tracking => mapwright_record::Localisation::Tracking,
            Self::Checking(_) => mapwright_record::Localisation::Checking,
            Self::OnTrial(_) => mapwright_record::Localisation::OnTrial,
            Self::Lost(_) => mapwright_record::Localisation::Lost,
        }
    }

    /// Whether keyframes may be written.
    pub(crate) fn is_tracking(&self) -> bool {
        matches!(self, Self::Tracking)
    }

    pub(crate) fn is_lost(&self) -> bool {
        matches!(self, Self::Lost(_))
    }

    /// A robot that does not know where it is, or may not know: what it maps provisionally.
    pub(crate) fn lost(&mut self) -> Option<&mut Lost> {
        match self {
            Self::Lost(lost) => Some(lost),
            Self::OnTrial(trial) => Some(trial.lost()),
            Self::Tracking | Self::Checking(_) => None,
        }
    }

    /// The robot was found, near an old keyframe; `node` is the one that was made there.
    pub(crate) fn try_out(&mut self, node: NodeId, near: NodeId) {
        *self = match std::mem::take(self) {
            Self::Lost(lost) => Self::OnTrial(Trial::new(node, near, lost)),
            other => other,
        };
    }

    /// Judges a match; its status is what is made of it. Where a robot on trial is not where it was found, the keyframe that was
    /// made there.
    pub(crate) fn judge(
        &mut self,
        front: &FrontEnd,
        past: Past<'_>,
        scan: &LaserScan,
        step: Pose2,
        matched: &mut Matched,
    ) -> Option<NodeId> {
        self.notice_blindness(front, matched.blind_s);
        let may_be_lost = front.settings().loops.relocate && past.newest().is_some();
        let mut made = None;
        *self = match std::mem::take(self) {
            Self::Checking(mut check) => {
                if check.fails(front, past, step, matched) {
                    matched.status = Status::Lost;
                    Self::Lost(Box::new(Lost::new(front)))
                } else if check.is_over() {
                    Self::Tracking
                } else {
                    Self::Checking(check)
                }
            }
            Self::OnTrial(mut trial) => match trial.judge(front, past, scan, step, matched) {
                Outcome::GoesOn => Self::OnTrial(trial),
                Outcome::Passed => Self::Tracking,
                Outcome::Failed => {
                    let (node, lost) = trial.fail();
                    (matched.status, made) = (Status::Lost, Some(node));
                    Self::Lost(lost)
                }
                Outcome::LostAgain => {
                    matched.status = Status::Lost;
                    Self::Lost(Box::new(Lost::new(front)))
                }
            },
            Self::Tracking if may_be_lost && !matched.is_believed() && front.tracker().misfits() >= LOST_SCANS => {
                Self::Lost(Box::new(Lost::new(front)))
            }
            state => state,
        };
        made
    }

    /// After a time without a look at the world the robot may be anywhere.
    fn notice_blindness(&mut self, front: &FrontEnd, blind_s: f64) {
        let usual_s = front.period_s();
        let is_blind = usual_s > 0.0 && blind_s > BLIND_S.max(BLIND_PERIODS * usual_s);
        if !front.settings().loops.relocate || !is_blind {
            return;
        }
        *self = match std::mem::take(self) {
            Self::OnTrial(trial) => Self::OnTrial(trial.anew(front)),
            _ => Self::Checking(Check::default()),
        };
    }
}
