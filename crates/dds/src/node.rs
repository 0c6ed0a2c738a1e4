//! A node of ROS 2.

use crate::configuration::Configuration;
use crate::cyclone::{CycloneError, Participant, Writer};
use crate::services::Services;
use mapwright_live::wire::{Answer, Delivery, Hear, Publisher, Service, Topic, Wire, WireError, names};

/// A node of ROS 2 in a domain of DDS.
pub struct Dds {
    topics: Participant,
    services: Services,
    node: Node,
}

/// What others are told of the node's readers and writers (`rmw_dds_common/msg/ParticipantEntitiesInfo`).
struct Node {
    namespace: String,
    name: String,
    readers: Vec<[u8; 16]>,
    writers: Vec<[u8; 16]>,
    graph: Writer,
}

impl std::fmt::Debug for Dds {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Dds").field("node", &self.node.name).finish_non_exhaustive()
    }
}

/// How a node is called that is in no group.
const GRAPH: (&str, &str) = ("ros_discovery_info", "rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_");

impl Dds {
    /// Joins a domain as a node of a name.
    ///
    /// # Errors
    /// [`WireError`] where the network or the name does not allow it.
    pub fn join(configuration: &Configuration, namespace: &str, name: &str) -> Result<Self, WireError> {
        let doing = || format!("joining domain {} as {name}", configuration.domain);
        let failed = |error: CycloneError| WireError { doing: doing(), why: error.to_string() };
        if !names::is_name(&format!("/{name}")) || !(namespace == "/" || names::is_name(namespace)) {
            return Err(WireError { doing: doing(), why: format!("{namespace} and {name} cannot name a node") });
        }
        let topics =
            Participant::new(u32::from(configuration.domain), &configuration.xml(), "enclave=/;").map_err(failed)?;
        let services = Services::new(configuration)?;
        let graph = topics.write(GRAPH.0, GRAPH.1, Delivery::Latched { depth: 1 }).map_err(failed)?;
        let (namespace, name) = (namespace.to_owned(), name.to_owned());
        let node = Node { namespace, name, readers: Vec::new(), writers: Vec::new(), graph };
        let dds = Self { topics, services, node };
        dds.tell_graph().map_err(failed)?;
        Ok(dds)
    }

    /// Tells others which readers and writers are this node's, those of services too, though they are another participant's: a node that is two
    /// participants' would be listed twice.
    fn tell_graph(&self) -> Result<(), CycloneError> {
        let Node { namespace, name, readers, writers, graph } = &self.node;
        graph.write(&entities(self.topics.guid(), namespace, name, readers, writers))
    }
}

/// A message of one participant with one node, in CDR.
fn entities(participant: [u8; 16], namespace: &str, name: &str, readers: &[[u8; 16]], writers: &[[u8; 16]]) -> Vec<u8> {
    let mut out = vec![0, 1, 0, 0];
    out.extend(participant);
    number(&mut out, 1);
    for text in [namespace, name] {
        number(&mut out, text.len() + 1);
        out.extend(text.bytes().chain([0]));
    }
    for guids in [readers, writers] {
        number(&mut out, guids.len());
        guids.iter().for_each(|guid| out.extend(guid));
    }
    out
}

/// A number of four bytes where CDR puts one: at a multiple of four after the head.
fn number(out: &mut Vec<u8>, number: usize) {
    out.resize(out.len().next_multiple_of(4), 0);
    out.extend(u32::try_from(number).unwrap_or(u32::MAX).to_le_bytes());
}

fn topic_names(topic: &Topic) -> Result<(String, String), WireError> {
    let failed =
        |why: &str| WireError { doing: format!("topic {} of type {}", topic.name, topic.kind), why: why.to_owned() };
    let kind = names::dds_type(topic.kind, "").ok_or_else(|| failed("no such type"))?;
    if names::is_name(&topic.name) {
        Ok((format!("rt{}", topic.name), kind))
    } else {
        Err(failed("no topic can be called so"))
    }
}

fn failed(topic: &Topic) -> impl Fn(CycloneError) -> WireError {
    let doing = format!("topic {} of type {}", topic.name, topic.kind);
    move |error| WireError { doing: doing.clone(), why: error.to_string() }
}

impl Wire for Dds {
    fn subscribe(&mut self, topic: &Topic, hear: Hear) -> Result<(), WireError> {
        let (name, kind) = topic_names(topic)?;
        let readers = self.topics.read(&name, &kind, topic.delivery, hear).map_err(failed(topic))?;
        self.node.readers.extend(readers);
        self.tell_graph().map_err(failed(topic))
    }

    fn advertise(&mut self, topic: &Topic) -> Result<Box<dyn Publisher>, WireError> {
        let (name, kind) = topic_names(topic)?;
        let writer = self.topics.write(&name, &kind, topic.delivery).map_err(failed(topic))?;
        self.node.writers.push(writer.guid());
        self.tell_graph().map_err(failed(topic))?;
        Ok(Box::new(Told { writer, topic: topic.clone() }))
    }

    fn serve(&mut self, service: &Service, answer: Answer) -> Result<(), WireError> {
        let failed =
            |why: String| WireError { doing: format!("service {} of type {}", service.name, service.kind), why };
        if !names::is_name(&service.name) {
            return Err(failed("no service can be called so".to_owned()));
        }
        let [reader, writer] = self.services.serve(service, answer)?;
        self.node.readers.push(reader);
        self.node.writers.push(writer);
        self.tell_graph().map_err(|error| failed(error.to_string()))
    }
}

struct Told {
    writer: Writer,
    topic: Topic,
}

impl Publisher for Told {
    fn publish(&self, message: &[u8]) -> Result<(), WireError> {
        self.writer.write(message).map_err(failed(&self.topic))
    }

    fn listeners(&self) -> usize {
        self.writer.matched()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_others_are_told_of_a_node_is_laid_out_as_cdr() {
        let message = entities([7; 16], "/", "map", &[[1; 16]], &[]);
        let expected: Vec<u8> = [0, 1, 0, 0]
            .into_iter()
            .chain([7; 16])
            .chain([1, 0, 0, 0, 2, 0, 0, 0, b'/', 0, 0, 0, 4, 0, 0, 0, b'm', b'a', b'p', 0])
            .chain([1, 0, 0, 0])
            .chain([1; 16])
            .chain([0, 0, 0, 0])
            .collect();
        assert_eq!(message, expected);
    }
}
