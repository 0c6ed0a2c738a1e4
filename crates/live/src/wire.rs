//! What a wire to other programs does, whatever it is made of.

pub mod names;

use std::fmt;

/// How messages of a topic are delivered, by the words of ROS 2.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Delivery {
    /// What gets lost is lost: sensors.
    BestEffort {
        /// So many of the newest are kept for who is slow.
        depth: u32,
    },
    /// What gets lost is sent again.
    Reliable {
        /// So many of the newest are kept for who is slow.
        depth: u32,
    },
    /// For who hears: what gets lost is sent again where whoever sends keeps it, and lost where not. Who sends keeps it.
    AsOffered {
        /// So many of the newest are kept for who is slow.
        depth: u32,
    },
    /// As reliable, and who comes later gets the newest as well (transient local).
    Latched {
        /// So many of the newest are kept for who is slow or late.
        depth: u32,
    },
}

/// A topic.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Topic {
    /// Its full name, `/scan`.
    pub name: String,
    /// Type of its messages, `sensor_msgs/msg/LaserScan`.
    pub kind: &'static str,
    /// How they are delivered.
    pub delivery: Delivery,
}

impl Topic {
    /// A topic of a name, a type and a delivery.
    #[must_use]
    pub fn new(name: &str, kind: &'static str, delivery: Delivery) -> Self {
        Self { name: name.to_owned(), kind, delivery }
    }
}

/// A service.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Service {
    /// Its full name, `/slam_toolbox/save_map`.
    pub name: String,
    /// Its type, `slam_toolbox/srv/SaveMap`.
    pub kind: &'static str,
}

/// Why a wire does not do what it was asked for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WireError {
    /// What was asked for, in words.
    pub doing: String,
    /// Why it was not done, in words.
    pub why: String,
}

impl fmt::Display for WireError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.doing, self.why)
    }
}

impl std::error::Error for WireError {}

/// Called with each message that arrives, in CDR with its four bytes of head, on a thread of the wire: it has to return at once.
pub type Hear = Box<dyn FnMut(&[u8]) + Send>;
/// Called with each request, in CDR with its four bytes of head, on a thread of the wire that serves nothing else meanwhile; what it returns
/// is the response, in CDR as well.
pub type Answer = Box<dyn FnMut(&[u8]) -> Vec<u8> + Send>;

/// A way to other programs: topics and services, messages as bytes in CDR.
pub trait Wire {
    /// Hears a topic as long as the wire is there.
    ///
    /// # Errors
    /// [`WireError`] where there can be no such topic.
    fn subscribe(&mut self, topic: &Topic, hear: Hear) -> Result<(), WireError>;

    /// A way to tell a topic's messages.
    ///
    /// # Errors
    /// [`WireError`] where there can be no such topic.
    fn advertise(&mut self, topic: &Topic) -> Result<Box<dyn Publisher>, WireError>;

    /// Answers a service as long as the wire is there.
    ///
    /// # Errors
    /// [`WireError`] where there can be no such service.
    fn serve(&mut self, service: &Service, answer: Answer) -> Result<(), WireError>;
}

/// Tells a topic's messages.
pub trait Publisher: Send + Sync {
    /// Sends a message, in CDR with its four bytes of head. Nobody who is slow is waited for longer than a tenth of a second.
    ///
    /// # Errors
    /// [`WireError`] where it was not sent.
    fn publish(&self, message: &[u8]) -> Result<(), WireError>;

    /// How many hear the topic.
    fn listeners(&self) -> usize;
}
