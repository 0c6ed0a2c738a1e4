//! The node's services, parameters, states and bond.

use super::Entrance;
use super::asking::{Reply, ToDraw};
use super::clock::Clock;
use crate::failure::Failure;
use mapwright_geom::Stamp;
use mapwright_live::node::NodeName;
use mapwright_live::node::asked::{Asked, Offered, Said, Why, offered, pose_given};
use mapwright_live::node::bond::{self, Bond};
use mapwright_live::node::lifecycle::{self, Lifecycle, Outcome, State, Turn};
use mapwright_live::node::parameters::{self, ParameterValue, Parameters, Setting};
use mapwright_live::wire::{Answer, Delivery, Publisher, Service, Topic, Wire};
use mapwright_live::{Heard, Lane};
use mapwright_record::Measurement;
use mapwright_ros::messages::PoseWithCovarianceStamped;
use mapwright_ros::{Channel, Decoder, Encoding};
use std::cell::OnceCell;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Nobody who asks waits longer for the mapper, or for who draws.
const PATIENCE: Duration = Duration::from_secs(10);

/// Something that is asked of the mapper, with the way of the answer; none of a topic.
pub(super) struct Question {
    pub(super) asked: Asked,
    pub(super) reply: Option<SyncSender<Reply>>,
}

/// What a node is beside its map. Shared by the threads that answer, map and tell.
pub(super) struct Node {
    pub(super) name: NodeName,
    parameters: Mutex<Parameters>,
    lifecycle: Mutex<Lifecycle>,
    bond: Mutex<Option<Bond>>,
    /// Words that are to be said.
    words: Mutex<Vec<String>>,
    /// Somebody wants the node to end.
    pub(super) is_shut_down: AtomicBool,
    events: Box<dyn Publisher>,
    changes: Box<dyn Publisher>,
    bonds: Box<dyn Publisher>,
    pub(super) diagnostics: Box<dyn Publisher>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Node {
    pub(super) fn new(wire: &mut dyn Wire, name: NodeName, parameters: Parameters) -> Result<Self, Failure> {
        let mut topic = |name: &str, kind| wire.advertise(&Topic::new(name, kind, Delivery::Reliable { depth: 100 }));
        let events = topic(&name.below("transition_event"), "lifecycle_msgs/msg/TransitionEvent")?;
        let changes = topic("/parameter_events", "rcl_interfaces/msg/ParameterEvent")?;
        let bonds = topic(&bond::topic(&name), "bond/msg/Status")?;
        let diagnostics = topic("/diagnostics", "diagnostic_msgs/msg/DiagnosticArray")?;
        let lifecycle = Mutex::new(Lifecycle::new(parameters.flag(Setting::Autostart)));
        let (parameters, bond, words) = (Mutex::new(parameters), Mutex::default(), Mutex::default());
        let is_shut_down = AtomicBool::new(false);
        Ok(Self { name, parameters, lifecycle, bond, words, is_shut_down, events, changes, bonds, diagnostics })
    }

    /// Whether scans are taken in and the map is told.
    pub(super) fn is_active(&self) -> bool {
        lock(&self.lifecycle).state() == State::Active
    }

    pub(super) fn number(&self, setting: Setting) -> f64 {
        lock(&self.parameters).number(setting)
    }

    pub(super) fn flag(&self, setting: Setting) -> bool {
        lock(&self.parameters).flag(setting)
    }

    pub(super) fn tell_paused(&self, is_paused: bool) {
        let _ = lock(&self.parameters).tell(Setting::Paused, ParameterValue::Bool(is_paused));
    }

    /// What is to be said since this was asked last.
    pub(super) fn words(&self) -> Vec<String> {
        std::mem::take(&mut lock(&self.words))
    }

    pub(super) fn note(&self, words: String) {
        let mut all = lock(&self.words);
        if all.len() < 100 {
            all.push(words);
        }
    }

    /// What a node does of itself: becomes active where nobody else brings it there, and says that it is alive.
    pub(super) fn beat(&self, clock: &Clock) {
        let Some(stamp) = clock.stamp() else { return };
        let due = lock(&self.lifecycle).due();
        if let Some(turn) = due {
            let begun = lock(&self.lifecycle).begin(turn, stamp);
            match begun {
                Ok(()) => self.turn(turn, clock, stamp),
                Err(error) => self.note(error.to_string()),
            }
        }
        let message = lock(&self.bond).as_mut().and_then(|bond| bond.due(clock.since_start(), stamp));
        // Whoever misses one hears the next.
        let _ = message.map(|message| self.bonds.publish(&message));
    }

    /// The node ends: whoever watches it hears that it has not died.
    pub(super) fn leave(&self, clock: &Clock) {
        let mut bond = lock(&self.bond);
        if let (Some(bond), Some(stamp)) = (bond.as_mut(), clock.stamp()) {
            let now = clock.since_start();
            bond.leave(now);
            let _ = bond.due(now, stamp).map(|message| self.bonds.publish(&message));
        }
    }

    /// A turn that has begun is done.
    fn turn(&self, turn: Turn, clock: &Clock, stamp: Stamp) {
        match turn {
            Turn::Configure => lock(&self.parameters).set_configured(true),
            Turn::Activate => {
                let period_s = self.number(Setting::BondPeriod);
                if period_s > 0.0 {
                    let period = Duration::from_secs_f64(period_s);
                    *lock(&self.bond) = Some(Bond::new(&self.name, &instance(), period, clock.since_start()));
                }
            }
            Turn::Deactivate => {
                if let Some(bond) = lock(&self.bond).as_mut() {
                    bond.leave(clock.since_start());
                }
            }
            Turn::Cleanup => lock(&self.parameters).set_configured(false),
            Turn::Shutdown => self.is_shut_down.store(true, Ordering::Release),
        }
        let events = {
            let mut lifecycle = lock(&self.lifecycle);
            lifecycle.end(Outcome::Success, stamp);
            lifecycle.events()
        };
        events.iter().for_each(|event| {
            let _ = self.events.publish(event);
        });
        self.note(format!("the node is {}", lock(&self.lifecycle).state()));
    }
}

/// A random UUID, in the usual letters.
fn instance() -> String {
    let bytes = std::fs::File::open("/dev/urandom").and_then(|mut file| {
        let mut bytes = [0_u8; 16];
        std::io::Read::read_exact(&mut file, &mut bytes).map(|()| bytes)
    });
    let bytes = bytes.unwrap_or_else(|_| u128::from(std::process::id()).to_le_bytes());
    let hex: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    [&hex[..8], &hex[8..12], &hex[12..16], &hex[16..20], &hex[20..]].join("-")
}

/// Answers everything that a node is asked.
pub(super) fn serve<M: Measurement + 'static>(
    wire: &mut dyn Wire,
    node: &Arc<Node>,
    (door, lane): (&Arc<Entrance>, Lane),
    (clock, frame): (&Arc<Clock>, &str),
    to_draw: &Sender<ToDraw<M>>,
) -> Result<(), Failure> {
    let mut answer = |name: String, kind: &'static str, answer: Answer| wire.serve(&Service { name, kind }, answer);
    for service in offered(&node.name) {
        let (name, kind) = (service.name.clone(), service.type_name);
        let (node, door, clock, frame) = (Arc::clone(node), Arc::clone(door), Arc::clone(clock), frame.to_owned());
        let asks = Asks { service, node, door, lane, clock, frame };
        let to_draw = to_draw.clone();
        answer(name, kind, Box::new(move |request| asks.answer(request, &to_draw)))?;
    }
    for (name, kind, service) in parameters::services(&node.name) {
        let (node, clock) = (Arc::clone(node), Arc::clone(clock));
        let answered = move |request: &[u8]| {
            let answered = lock(&node.parameters).answer(service, request);
            answered.refusals.into_iter().for_each(|words| node.note(words));
            if !answered.changes.is_empty() {
                let stamp = clock.stamp().unwrap_or(Stamp(0));
                let _ = node.changes.publish(&Parameters::event(&node.name, stamp, &answered.changes));
            }
            answered.bytes
        };
        answer(name, kind, Box::new(answered))?;
    }
    for (name, kind, question) in lifecycle::questions(&node.name) {
        let node = Arc::clone(node);
        answer(name, kind, Box::new(move |request| lock(&node.lifecycle).answer(question, request).bytes))?;
    }
    let (name, changing, clock) = (node.name.below("change_state"), Arc::clone(node), Arc::clone(clock));
    let change = move |request: &[u8]| {
        let stamp = clock.stamp().unwrap_or(Stamp(0));
        let begun = lock(&changing.lifecycle).change(request, stamp);
        match begun {
            Ok(turn) => {
                changing.turn(turn, &clock, stamp);
                lifecycle::changed(Outcome::Success)
            }
            Err(refused) => {
                refused.refusal.into_iter().for_each(|words| changing.note(words));
                refused.bytes
            }
        }
    };
    answer(name, "lifecycle_msgs/srv/ChangeState", Box::new(change))?;
    Ok(())
}

/// Hears where somebody says that the robot is, and whether the other side of the bond lives.
pub(super) fn hear(
    wire: &mut dyn Wire,
    node: &Arc<Node>,
    (door, lane): (&Arc<Entrance>, Lane),
    clock: &Arc<Clock>,
) -> Result<(), Failure> {
    let kind = "geometry_msgs/msg/PoseWithCovarianceStamped";
    let failed = |error: mapwright_ros::RosError| Failure::Log(error.to_string());
    let channel = Channel::new(kind, Encoding::Cdr, None).map_err(failed)?;
    let mut decoder: Decoder<PoseWithCovarianceStamped<'static>> = Decoder::new(&channel).map_err(failed)?;
    let (listener, door, told) = (Arc::clone(node), Arc::clone(door), Arc::clone(clock));
    let hear = move |bytes: &[u8]| {
        let given = decoder.decode(bytes).map_err(|error| error.to_string());
        match given.and_then(|message| pose_given(&message).map_err(|error| error.to_string())) {
            Ok(given) => {
                let question = Question { asked: Asked::SetPose(given), reply: None };
                door.put(lane, (told.arrived(), Heard::Asked(Box::new(question))));
            }
            Err(error) => listener.note(format!("initialpose: {error}")),
        }
    };
    wire.subscribe(
        &Topic::new(&node.name.beside("initialpose"), kind, Delivery::Reliable { depth: 5 }),
        Box::new(hear),
    )?;
    let (node, clock) = (Arc::clone(node), Arc::clone(clock));
    let bonds = Topic::new(&bond::topic(&node.name), "bond/msg/Status", Delivery::Reliable { depth: 100 });
    let hear = move |bytes: &[u8]| {
        let heard = lock(&node.bond).as_mut().map(|bond| bond.hear(bytes, clock.since_start()));
        if let Some(Err(error)) = heard {
            node.note(format!("bond: {error}"));
        }
    };
    wire.subscribe(&bonds, Box::new(hear))?;
    Ok(())
}

/// A service whose requests go to the mapper, or to who draws.
struct Asks {
    service: Offered,
    node: Arc<Node>,
    door: Arc<Entrance>,
    lane: Lane,
    clock: Arc<Clock>,
    frame: String,
}

impl Asks {
    fn answer<M: Measurement>(&self, request: &[u8], to_draw: &Sender<ToDraw<M>>) -> Vec<u8> {
        let map = OnceCell::new();
        let answer = self.service.answer(request, |asked| {
            let (reply, replied) = sync_channel(1);
            let is_asked = match asked {
                Asked::Map => to_draw.send(ToDraw::Map(reply)).is_ok(),
                Asked::SaveMap { name } => to_draw.send(ToDraw::Save { name, reply }).is_ok(),
                Asked::Serialize { file } => to_draw.send(ToDraw::Serialize { file, reply }).is_ok(),
                asked => {
                    let question = Question { asked, reply: Some(reply) };
                    self.door.put(self.lane, (self.clock.arrived(), Heard::Asked(Box::new(question))))
                }
            };
            match replied.recv_timeout(if is_asked { PATIENCE } else { Duration::ZERO }) {
                Ok(Reply::Said(said)) => said,
                Ok(Reply::Map(grid)) => Said::Map(map.get_or_init(|| grid).as_message(&self.frame)),
                Err(_) => Said::Refused(Why::Other, format!("not done within {} s", PATIENCE.as_secs())),
            }
        });
        answer.refusal.into_iter().for_each(|words| self.node.note(words));
        answer.bytes
    }
}
