//! How nodes say that they are there and how they are: clocks, diagnostics, bonds.

use super::{Header, message};
use mapwright_geom::Stamp;
use std::borrow::Cow;

message! {
    /// The time of a simulation or of a recording that is played.
    Clock = ["rosgraph_msgs/Clock"];
    /// It.
    clock: Stamp,
}

message! {
    /// Something known of a component, as texts.
    KeyValue<'a> = ["diagnostic_msgs/KeyValue"];
    /// Its name.
    key: Cow<'a, str>,
    /// What it is.
    value: Cow<'a, str>,
}

message! {
    /// How a component is.
    DiagnosticStatus<'a> = ["diagnostic_msgs/DiagnosticStatus"];
    /// 0 well, 1 warning, 2 error, 3 not heard of.
    level: u8,
    /// The component.
    name: Cow<'a, str>,
    /// How it is, in words.
    message: Cow<'a, str>,
    /// The device, empty where there is none.
    hardware_id: Cow<'a, str>,
    /// Numbers and the like.
    values: Vec<KeyValue<'a>>,
}

message! {
    /// How the components of a robot are.
    DiagnosticArray<'a> = ["diagnostic_msgs/DiagnosticArray"];
    /// When.
    header: Header<'a>,
    /// The components.
    status: Vec<DiagnosticStatus<'a>>,
}

message! {
    /// One side of a bond says that it is alive, or that it leaves.
    BondStatus<'a> = ["bond/Status"];
    /// When.
    header: Header<'a>,
    /// The bond, the same on both sides.
    id: Cow<'a, str>,
    /// The side.
    instance_id: Cow<'a, str>,
    /// Whether it is alive.
    active: bool,
    /// The other side is given up when silent for so long, seconds.
    heartbeat_timeout: f32,
    /// Time between two of these messages, seconds.
    heartbeat_period: f32,
}
