//! What rmw_zenoh calls things: keys of messages, tokens of who is there, and what stands beside a message.

use mapwright_live::wire::Delivery;
use sha2::{Digest, Sha256};
use std::time::SystemTime;

/// No message is larger, bytes: none is sent, and of who sends one nothing is taken.
pub(crate) const MESSAGE_MOST: usize = 1 << 28;

/// What a token is of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Kind {
    Publisher,
    Subscription,
    Service,
}

impl Kind {
    fn letters(self) -> &'static str {
        match self {
            Self::Publisher => "MP",
            Self::Subscription => "MS",
            Self::Service => "SS",
        }
    }
}

/// A topic or service by its names.
#[derive(Debug, Clone)]
pub(crate) struct Named {
    /// `/scan`.
    pub(crate) name: String,
    /// `sensor_msgs::msg::dds_::LaserScan_`.
    pub(crate) kind: String,
    /// `RIHS01_` and 64 digits.
    pub(crate) hash: String,
}

impl Named {
    /// The key of its messages.
    pub(crate) fn key(&self, domain: u32) -> String {
        key(domain, self, &self.hash)
    }

    /// The keys of its messages, whatever distribution of ROS the other side is: the hashes of a type differ where anything of it does.
    pub(crate) fn any_key(&self, domain: u32) -> String {
        key(domain, self, "*")
    }
}

fn key(domain: u32, named: &Named, hash: &str) -> String {
    format!("{domain}/{}/{}/{hash}", named.name.trim_matches('/'), named.kind)
}

/// A node in a session.
#[derive(Debug, Clone)]
pub(crate) struct NodeKeys {
    pub(crate) domain: u32,
    /// The session's number.
    pub(crate) session: String,
    /// `/` or `/robot`.
    pub(crate) namespace: String,
    pub(crate) name: String,
}

impl NodeKeys {
    /// The token that there is such a node. It is the session's only one, of number 0.
    pub(crate) fn token(&self) -> String {
        self.token_of(0, "NN")
    }

    /// The token of one of its ends.
    pub(crate) fn end_token(&self, number: usize, kind: Kind, named: &Named, qos: &str) -> String {
        let node = self.token_of(number, kind.letters());
        format!("{node}/{}/{}/{}/{qos}", mangled(&named.name), named.kind, named.hash)
    }

    fn token_of(&self, number: usize, letters: &str) -> String {
        let Self { domain, session, namespace, name } = self;
        format!("@ros2_lv/{domain}/{session}/0/{number}/{letters}/%/{}/{name}", mangled(namespace))
    }
}

/// The tokens of all who hear a topic.
pub(crate) fn listener_tokens(domain: u32, named: &Named) -> String {
    format!("@ros2_lv/{domain}/*/*/*/MS/*/*/*/{}/{}/*/*", mangled(&named.name), named.kind)
}

fn mangled(name: &str) -> String {
    name.replace('/', "%")
}

/// How messages are delivered: reliability, durability, history and depth, deadline, lifespan, liveliness; nothing where it is the default.
pub(crate) fn qos(delivery: Delivery) -> String {
    match delivery {
        Delivery::BestEffort { depth } => format!("2::,{depth}:,:,:,,"),
        Delivery::Reliable { depth } | Delivery::AsOffered { depth } => format!("::,{depth}:,:,:,,"),
        Delivery::Latched { depth } => format!(":1:,{depth}:,:,:,,"),
    }
}

/// What stands beside every message, request and response.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Attachment {
    /// The sender's count.
    pub(crate) number: i64,
    /// Time since 1970.
    pub(crate) stamp_ns: i64,
    /// The sender.
    pub(crate) sender: [u8; SENDER_BYTES],
}

const SENDER_BYTES: usize = 16;
const ATTACHMENT_BYTES: usize = 8 + 8 + 1 + SENDER_BYTES;

impl Attachment {
    pub(crate) fn to_bytes(self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(ATTACHMENT_BYTES);
        bytes.extend(self.number.to_le_bytes());
        bytes.extend(self.stamp_ns.to_le_bytes());
        bytes.push(SENDER_BYTES as u8);
        bytes.extend(self.sender);
        bytes
    }

    /// None where the bytes are anything else.
    pub(crate) fn from_bytes(bytes: &[u8]) -> Option<Self> {
        let (number, rest) = bytes.split_first_chunk()?;
        let (stamp, rest) = rest.split_first_chunk()?;
        let (length, sender) = rest.split_first()?;
        let sender = sender.try_into().ok().filter(|_| usize::from(*length) == SENDER_BYTES)?;
        Some(Self { number: i64::from_le_bytes(*number), stamp_ns: i64::from_le_bytes(*stamp), sender })
    }
}

/// Nanoseconds since 1970.
pub(crate) fn now_ns() -> i64 {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    i64::try_from(since.as_nanos()).unwrap_or(i64::MAX)
}

/// The number by which others know who sent something, made of its token.
pub(crate) fn sender(token: &str) -> [u8; SENDER_BYTES] {
    let mut sender = [0; SENDER_BYTES];
    sender.copy_from_slice(&Sha256::digest(token)[..SENDER_BYTES]);
    sender
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scan() -> Named {
        Named {
            name: "/robot/scan".to_owned(),
            kind: "sensor_msgs::msg::dds_::LaserScan_".to_owned(),
            hash: "RIHS01_64c1".to_owned(),
        }
    }

    #[test]
    fn keys_are_those_of_rmw_zenoh() {
        assert_eq!(scan().key(2), "2/robot/scan/sensor_msgs::msg::dds_::LaserScan_/RIHS01_64c1");
        assert_eq!(scan().any_key(0), "0/robot/scan/sensor_msgs::msg::dds_::LaserScan_/*");
        let node = |namespace: &str| NodeKeys {
            domain: 2,
            session: "aac3178e146ba6f1fc6e6a4085e77f21".to_owned(),
            namespace: namespace.to_owned(),
            name: "talker".to_owned(),
        };
        assert_eq!(node("/").token(), "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%/talker");
        assert_eq!(node("/a/b").token(), "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/0/NN/%/%a%b/talker");
        assert_eq!(
            node("/").end_token(10, Kind::Publisher, &scan(), "::,7:,:,:,,"),
            "@ros2_lv/2/aac3178e146ba6f1fc6e6a4085e77f21/0/10/MP/%/%/talker/%robot%scan/sensor_msgs::msg::dds_::LaserScan_/RIHS01_64c1/\
             ::,7:,:,:,,"
        );
    }

    #[test]
    fn attachments_are_read_back_and_others_refused() {
        let attachment = Attachment { number: 7, stamp_ns: -1, sender: [3; 16] };
        let bytes = attachment.to_bytes();
        assert_eq!(bytes.len(), 33);
        assert_eq!(Attachment::from_bytes(&bytes), Some(attachment));
        for length in 0..33 {
            assert_eq!(Attachment::from_bytes(&bytes[..length]), None, "{length}");
        }
        assert_eq!(Attachment::from_bytes(&[&bytes[..], &[0]].concat()), None, "too long");
        let mut wrong = bytes;
        wrong[16] = 15;
        assert_eq!(Attachment::from_bytes(&wrong), None, "another length");
    }
}
