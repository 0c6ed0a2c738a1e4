//! Managed nodes: their states, and the services that change them.

use super::message;
use std::borrow::Cow;

message! {
    /// A state of a managed node.
    State<'a> = ["lifecycle_msgs/State"];
    /// Its number.
    id: u8,
    /// Its name.
    label: Cow<'a, str>,
}

message! {
    /// What leads from one state to another.
    Transition<'a> = ["lifecycle_msgs/Transition"];
    /// Its number.
    id: u8,
    /// Its name.
    label: Cow<'a, str>,
}

message! {
    /// A transition with its ends.
    TransitionDescription<'a> = ["lifecycle_msgs/TransitionDescription"];
    /// The transition.
    transition: Transition<'a>,
    /// Where it begins.
    start_state: State<'a>,
    /// Where it leads.
    goal_state: State<'a>,
}

message! {
    /// That a node went through a transition.
    TransitionEvent<'a> = ["lifecycle_msgs/TransitionEvent"];
    /// When, nanoseconds.
    timestamp: u64,
    /// The transition.
    transition: Transition<'a>,
    /// Where it began.
    start_state: State<'a>,
    /// Where it led.
    goal_state: State<'a>,
}

message! {
    /// That a node shall go through a transition.
    ChangeStateRequest<'a> = ["lifecycle_msgs/ChangeState_Request"];
    /// By its name, or where that is empty by its number.
    transition: Transition<'a>,
}

message! {
    /// Whether it did.
    ChangeStateResponse = ["lifecycle_msgs/ChangeState_Response"];
    /// Whether it did.
    success: bool,
}

message! {
    /// Where a node is.
    GetStateResponse<'a> = ["lifecycle_msgs/GetState_Response"];
    /// Its state.
    current_state: State<'a>,
}

message! {
    /// Where a node may be.
    GetAvailableStatesResponse<'a> = ["lifecycle_msgs/GetAvailableStates_Response"];
    /// All states.
    available_states: Vec<State<'a>>,
}

message! {
    /// Transitions: those from a node's state, or all.
    GetAvailableTransitionsResponse<'a> = ["lifecycle_msgs/GetAvailableTransitions_Response"];
    /// The transitions.
    available_transitions: Vec<TransitionDescription<'a>>,
}
