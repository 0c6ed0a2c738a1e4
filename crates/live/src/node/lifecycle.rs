//! The states of a managed node, and the services that change them.
//!
//! States, transitions, their numbers and names are those of `rcl_lifecycle` (Kilted); what a transition leads to is said by whoever did it.

use super::{Answer, NodeError, NodeName, bytes_of, decode, decode_nothing};
use mapwright_geom::Stamp;
use mapwright_ros::messages::lifecycle::{
    ChangeStateRequest, ChangeStateResponse, GetAvailableStatesResponse, GetAvailableTransitionsResponse,
    GetStateResponse, State as StateMessage, Transition as TransitionMessage, TransitionDescription, TransitionEvent,
};
use std::borrow::Cow;
use std::fmt;

/// A state of a managed node, with its number in `lifecycle_msgs/State`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
#[allow(missing_docs)] // the names say it
pub enum State {
    Unknown = 0,
    Unconfigured = 1,
    Inactive = 2,
    Active = 3,
    Finalized = 4,
    Configuring = 10,
    CleaningUp = 11,
    ShuttingDown = 12,
    Activating = 13,
    Deactivating = 14,
    ErrorProcessing = 15,
}

use State::{
    Activating, Active, CleaningUp, Configuring, Deactivating, ErrorProcessing, Finalized, Inactive, ShuttingDown,
    Unconfigured,
};

const STATES: [State; 11] = [
    State::Unknown,
    Unconfigured,
    Inactive,
    Active,
    Finalized,
    Configuring,
    CleaningUp,
    ShuttingDown,
    Activating,
    Deactivating,
    ErrorProcessing,
];

impl State {
    /// Its name.
    #[must_use]
    pub fn label(self) -> &'static str {
        match self {
            Self::Unknown => "unknown",
            Unconfigured => "unconfigured",
            Inactive => "inactive",
            Active => "active",
            Finalized => "finalized",
            Configuring => "configuring",
            CleaningUp => "cleaningup",
            ShuttingDown => "shuttingdown",
            Activating => "activating",
            Deactivating => "deactivating",
            ErrorProcessing => "errorprocessing",
        }
    }

    fn message(self) -> StateMessage<'static> {
        StateMessage { id: self as u8, label: Cow::Borrowed(self.label()) }
    }
}

impl fmt::Display for State {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.label())
    }
}

/// What a node shall do.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Turn {
    /// Read its parameters, open what it needs.
    Configure,
    /// Begin to map and to publish.
    Activate,
    /// Leave off, and keep what it has.
    Deactivate,
    /// Forget all that it has.
    Cleanup,
    /// End.
    Shutdown,
}

/// How a turn went.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// As it should.
    Success,
    /// It could not be done, and the node is as before.
    Failure,
    /// It went wrong in the middle.
    Error {
        /// Whether all was put away, so that the node can be configured again; else it is finalized.
        is_clean: bool,
    },
}

/// A way from a state to another.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Transition {
    id: u8,
    label: &'static str,
    from: State,
    to: State,
}

const fn way(id: u8, label: &'static str, from: State, to: State) -> Transition {
    Transition { id, label, from, to }
}

const SUCCESS: &str = "transition_success";
const FAILURE: &str = "transition_failure";
const ERROR: &str = "transition_error";

/// All of them, in the order in which `rcl_lifecycle` gives them.
const TRANSITIONS: [Transition; 25] = [
    way(1, "configure", Unconfigured, Configuring),
    way(10, SUCCESS, Configuring, Inactive),
    way(11, FAILURE, Configuring, Unconfigured),
    way(12, ERROR, Configuring, ErrorProcessing),
    way(2, "cleanup", Inactive, CleaningUp),
    way(20, SUCCESS, CleaningUp, Unconfigured),
    way(21, FAILURE, CleaningUp, Inactive),
    way(22, ERROR, CleaningUp, ErrorProcessing),
    way(3, "activate", Inactive, Activating),
    way(30, SUCCESS, Activating, Active),
    way(31, FAILURE, Activating, Inactive),
    way(32, ERROR, Activating, ErrorProcessing),
    way(4, "deactivate", Active, Deactivating),
    way(40, SUCCESS, Deactivating, Inactive),
    way(41, FAILURE, Deactivating, Active),
    way(42, ERROR, Deactivating, ErrorProcessing),
    way(5, "shutdown", Unconfigured, ShuttingDown),
    way(6, "shutdown", Inactive, ShuttingDown),
    way(7, "shutdown", Active, ShuttingDown),
    way(50, SUCCESS, ShuttingDown, Finalized),
    way(51, FAILURE, ShuttingDown, Finalized),
    way(52, ERROR, ShuttingDown, ErrorProcessing),
    way(60, SUCCESS, ErrorProcessing, Unconfigured),
    way(61, FAILURE, ErrorProcessing, Finalized),
    way(62, ERROR, ErrorProcessing, Finalized),
];

impl Transition {
    fn describe(&self) -> TransitionDescription<'static> {
        let transition = TransitionMessage { id: self.id, label: Cow::Borrowed(self.label) };
        TransitionDescription { transition, start_state: self.from.message(), goal_state: self.to.message() }
    }

    fn event(&self, stamp: Stamp) -> TransitionEvent<'static> {
        let TransitionDescription { transition, start_state, goal_state } = self.describe();
        let timestamp = u64::try_from(stamp.0).unwrap_or(0);
        TransitionEvent { timestamp, transition, start_state, goal_state }
    }
}

/// A service that asks for nothing but what is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Question {
    /// The state.
    State,
    /// All states.
    States,
    /// The transitions that begin at the state.
    Transitions,
    /// All transitions.
    Graph,
}

/// Names and types of the services below a managed node that ask for what is. `change_state` (`lifecycle_msgs/srv/ChangeState`) and the topic
/// `transition_event` (`lifecycle_msgs/msg/TransitionEvent`) are there besides.
#[must_use]
pub fn questions(node: &NodeName) -> [(String, &'static str, Question); 4] {
    [
        (node.below("get_state"), "lifecycle_msgs/srv/GetState", Question::State),
        (node.below("get_available_states"), "lifecycle_msgs/srv/GetAvailableStates", Question::States),
        (node.below("get_available_transitions"), "lifecycle_msgs/srv/GetAvailableTransitions", Question::Transitions),
        (node.below("get_transition_graph"), "lifecycle_msgs/srv/GetAvailableTransitions", Question::Graph),
    ]
}

/// A managed node's state.
#[derive(Debug, Clone, PartialEq)]
pub struct Lifecycle {
    state: State,
    /// Whether nobody else has to bring it to work.
    starts_itself: bool,
    events: Vec<TransitionEvent<'static>>,
}

/// So many events wait to be published at most; a node that nobody asks what happened forgets the oldest.
const EVENTS_MOST: usize = 100;

impl Lifecycle {
    /// Unconfigured. Where it starts itself, [`Lifecycle::due`] says what is next until it is active.
    #[must_use]
    pub fn new(starts_itself: bool) -> Self {
        Self { state: Unconfigured, starts_itself, events: Vec::new() }
    }

    /// Where it is.
    #[must_use]
    pub fn state(&self) -> State {
        self.state
    }

    /// What a node that starts itself does next, for [`Lifecycle::begin`]. It tries once: whoever asks for a transition, or a turn that went wrong,
    /// ends it.
    #[must_use]
    pub fn due(&self) -> Option<Turn> {
        match self.state {
            Unconfigured if self.starts_itself => Some(Turn::Configure),
            Inactive if self.starts_itself => Some(Turn::Activate),
            _ => None,
        }
    }

    /// What has to be published since this was asked last, as `lifecycle_msgs/TransitionEvent`.
    pub fn events(&mut self) -> Vec<Vec<u8>> {
        std::mem::take(&mut self.events).iter().map(bytes_of).collect()
    }

    /// That a turn begins. [`Lifecycle::end`] says how it went.
    ///
    /// # Errors
    /// [`NodeError::Request`] where it does not begin at this state.
    pub fn begin(&mut self, turn: Turn, stamp: Stamp) -> Result<(), NodeError> {
        let label = match turn {
            Turn::Configure => "configure",
            Turn::Activate => "activate",
            Turn::Deactivate => "deactivate",
            Turn::Cleanup => "cleanup",
            Turn::Shutdown => "shutdown",
        };
        self.enter(label.to_owned(), |way| way.label == label, stamp).map(|_| ())
    }

    /// How a turn went; nothing where none was begun.
    pub fn end(&mut self, outcome: Outcome, stamp: Stamp) {
        let (label, after) = match outcome {
            Outcome::Success => (SUCCESS, None),
            Outcome::Failure => (FAILURE, None),
            Outcome::Error { is_clean: true } => (ERROR, Some(SUCCESS)),
            Outcome::Error { is_clean: false } => (ERROR, Some(FAILURE)),
        };
        let before = self.state;
        for label in [Some(label), after].into_iter().flatten() {
            if let Some(way) = TRANSITIONS.iter().find(|way| way.from == self.state && way.label == label) {
                self.go(way, stamp);
            }
        }
        if self.state != before {
            self.starts_itself &= before == Configuring && outcome == Outcome::Success;
        }
    }

    /// What a request of `change_state` wants done. Then [`Lifecycle::end`] says how it went, and [`changed`] is the response.
    ///
    /// # Errors
    /// The response and the reason, where it is no such request or does not begin at this state.
    pub fn change(&mut self, request: &[u8], stamp: Stamp) -> Result<Turn, Answer> {
        let asked = decode::<ChangeStateRequest<'_>>(request).map_err(NodeError::from);
        asked.and_then(|asked| self.asked(&asked.transition, stamp)).map_err(|error| {
            let refusal = Some(format!("change_state: {error}"));
            Answer { bytes: bytes_of(&ChangeStateResponse { success: false }), refusal }
        })
    }

    /// The answer to a question.
    #[must_use]
    pub fn answer(&self, question: Question, request: &[u8]) -> Answer {
        let refusal = decode_nothing(request).err().map(|error| error.to_string());
        let ways = |is_wanted: &dyn Fn(&Transition) -> bool| {
            let available_transitions =
                TRANSITIONS.iter().filter(|way| is_wanted(way)).map(Transition::describe).collect();
            bytes_of(&GetAvailableTransitionsResponse { available_transitions })
        };
        let bytes = match question {
            Question::State => bytes_of(&GetStateResponse { current_state: self.state.message() }),
            Question::States => {
                bytes_of(&GetAvailableStatesResponse { available_states: STATES.map(State::message).to_vec() })
            }
            Question::Transitions => ways(&|way| way.from == self.state),
            Question::Graph => ways(&|_| true),
        };
        Answer { bytes, refusal }
    }

    /// By its name where it has one, else by its number, as `rclcpp` does.
    fn asked(&mut self, asked: &TransitionMessage<'_>, stamp: Stamp) -> Result<Turn, NodeError> {
        if asked.label.is_empty() {
            self.enter(format!("number {}", asked.id), |way| way.id == asked.id, stamp)
        } else {
            self.enter(super::excerpt(&asked.label), |way| way.label == asked.label, stamp)
        }
        .inspect(|_| self.starts_itself = false)
    }

    fn enter(
        &mut self,
        found: String,
        is_asked: impl Fn(&Transition) -> bool,
        stamp: Stamp,
    ) -> Result<Turn, NodeError> {
        let mut begun = TRANSITIONS.iter().filter(|way| way.from == self.state && is_asked(way));
        let begun = begun.find_map(|way| Some((way, turn(way)?)));
        let Some((way, turn)) = begun else {
            let expected = match self.state {
                Unconfigured => "configure or shutdown (the node is unconfigured)",
                Inactive => "activate, cleanup or shutdown (the node is inactive)",
                Active => "deactivate or shutdown (the node is active)",
                Finalized => "none (the node is finalized)",
                _ => "none before the one that goes on has ended",
            };
            return Err(NodeError::Request { what: "the transition", expected, found });
        };
        self.go(way, stamp);
        Ok(turn)
    }

    fn go(&mut self, way: &Transition, stamp: Stamp) {
        self.state = way.to;
        if self.events.len() >= EVENTS_MOST {
            self.events.remove(0);
        }
        self.events.push(way.event(stamp));
    }
}

/// What a node does that goes this way; none where it only ends what it did.
fn turn(way: &Transition) -> Option<Turn> {
    match way.to {
        Configuring => Some(Turn::Configure),
        Activating => Some(Turn::Activate),
        Deactivating => Some(Turn::Deactivate),
        CleaningUp => Some(Turn::Cleanup),
        ShuttingDown => Some(Turn::Shutdown),
        _ => None,
    }
}

/// The response to a request of `change_state` whose turn has ended.
#[must_use]
pub fn changed(outcome: Outcome) -> Vec<u8> {
    bytes_of(&ChangeStateResponse { success: outcome == Outcome::Success })
}
