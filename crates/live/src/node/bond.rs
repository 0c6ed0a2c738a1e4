//! A bond with Nav2's lifecycle manager: each side says several times a second that it is alive.
//!
//! The states are those of `bondcpp`; topic, times and names those of Nav2's `LifecycleNode::createBond`. A node makes its bond where it becomes active,
//! and ends it where it leaves off.

use super::{NodeError, NodeName, bytes_of, decode};
use mapwright_geom::Stamp;
use mapwright_ros::messages::{BondStatus, Header};
use std::time::Duration;

/// Between two messages; the parameter `bond_heartbeat_period` of Nav2.
pub const PERIOD: Duration = Duration::from_millis(250);
/// The other side is given up when silent for so long: Nav2's `createBond`.
const HEARTBEAT_TIMEOUT: Duration = Duration::from_secs(4);
/// Nobody answers for so long: `bond/Constants`.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(10);
/// The other side does not confirm the end for so long: `bond/Constants`.
const DISCONNECT_TIMEOUT: Duration = Duration::from_secs(2);
/// Between two messages that say that this side leaves: `bond/Constants`.
const LEAVING_PERIOD: Duration = Duration::from_millis(50);

/// The topic of bonds, of `bond/msg/Status`.
#[must_use]
pub fn topic(node: &NodeName) -> String {
    node.beside("bond")
}

/// How a bond is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BondState {
    /// The other side has not been heard of.
    Waiting,
    /// Both sides are alive.
    Alive,
    /// This side leaves, and the other one has not confirmed it.
    Leaving,
    /// It has ended: nothing is said any more.
    Ended,
}

/// One side of a bond. Times are since the start, by a clock that is never set.
#[derive(Debug, Clone, PartialEq)]
pub struct Bond {
    id: String,
    instance: String,
    period: Duration,
    state: BondState,
    /// When the state ends if nothing is heard.
    ends: Duration,
    next: Duration,
    /// Whether the other side said that it leaves, which is confirmed once.
    confirms: bool,
}

impl Bond {
    /// A node's bond, whose first message is due now. `instance` tells this side from all others that there ever were: a random UUID. [`PERIOD`] is Nav2's;
    /// 20 ms at least.
    #[must_use]
    pub fn new(node: &NodeName, instance: &str, period: Duration, now: Duration) -> Self {
        Self {
            id: node.name().to_owned(),
            instance: instance.to_owned(),
            period: period.clamp(Duration::from_millis(20), HEARTBEAT_TIMEOUT / 2),
            state: BondState::Waiting,
            ends: now.saturating_add(CONNECT_TIMEOUT),
            next: now,
            confirms: false,
        }
    }

    /// How it is.
    #[must_use]
    pub fn state(&self) -> BondState {
        self.state
    }

    /// When [`Bond::due`] has to be asked next; none when it has ended.
    #[must_use]
    pub fn next(&self) -> Option<Duration> {
        let is_over = self.state == BondState::Ended && !self.confirms;
        (!is_over).then_some(self.next.min(self.ends))
    }

    /// Takes in a message of the topic; those of other bonds and of this side say nothing.
    ///
    /// # Errors
    /// [`NodeError::Message`].
    pub fn hear(&mut self, message: &[u8], now: Duration) -> Result<(), NodeError> {
        let status = decode::<BondStatus<'_>>(message)?;
        if status.id != self.id || status.instance_id == self.instance {
            return Ok(());
        }
        match (self.state, status.active) {
            (BondState::Waiting | BondState::Alive, true) => {
                self.state = BondState::Alive;
                self.ends = now.saturating_add(HEARTBEAT_TIMEOUT);
            }
            (BondState::Waiting | BondState::Alive, false) => {
                self.state = BondState::Ended;
                (self.confirms, self.next) = (true, now);
            }
            (BondState::Leaving, false) => self.state = BondState::Ended,
            (BondState::Leaving, true) | (BondState::Ended, _) => {}
        }
        Ok(())
    }

    /// This side leaves: it says so until the other one confirms it, for two seconds at most.
    pub fn leave(&mut self, now: Duration) {
        match self.state {
            BondState::Waiting => {
                self.state = BondState::Ended;
                (self.confirms, self.next) = (true, now);
            }
            BondState::Alive => {
                self.state = BondState::Leaving;
                (self.ends, self.next) = (now.saturating_add(DISCONNECT_TIMEOUT), now);
            }
            BondState::Leaving | BondState::Ended => {}
        }
    }

    /// The message that is due by now, `bond/Status`, if any is.
    pub fn due(&mut self, now: Duration, stamp: Stamp) -> Option<Vec<u8>> {
        if now >= self.ends && self.state != BondState::Ended {
            self.state = BondState::Ended;
        }
        if now < self.next {
            return None;
        }
        match self.state {
            BondState::Ended if !self.confirms => return None,
            BondState::Ended => self.confirms = false,
            BondState::Leaving => self.next = now.saturating_add(LEAVING_PERIOD),
            BondState::Waiting | BondState::Alive => {
                // in step with the beginning, but never two at once
                let in_step = self.next.saturating_add(self.period);
                self.next = if in_step > now { in_step } else { now.saturating_add(self.period) };
            }
        }
        Some(bytes_of(&BondStatus {
            header: Header::new(stamp, ""),
            id: self.id.as_str().into(),
            instance_id: self.instance.as_str().into(),
            active: matches!(self.state, BondState::Waiting | BondState::Alive),
            heartbeat_timeout: HEARTBEAT_TIMEOUT.as_secs_f32(),
            heartbeat_period: self.period.as_secs_f32(),
        }))
    }
}
