//! Services, with what makers do differently: clients of Fast DDS tell and expect beside the message which request a response is to, those of
//! Cyclone DDS in front of it. Who asks is told apart by the two bytes of the maker that begin every participant's number (DDSI-RTPS 2.5,
//! 8.2.4.1 and 9.3.1.5).

use crate::configuration::{Configuration, Range};
use mapwright_live::wire::{Answer, Service, WireError, names};
use mapwright_rtps::ServiceNames;

/// The maker of Cyclone DDS in front of its participants' numbers.
const CYCLONE: [u8; 2] = [0x01, 0x10];
/// What Cyclone's clients put in front of a request: half of their number, and the request's.
const CYCLONE_HEAD_BYTES: usize = 16;
/// The head of CDR.
const CDR_BYTES: usize = 4;

/// What a client puts in front of its request, and the request; none where it is too short.
fn split(client: [u8; 12], request: &[u8]) -> Option<(Vec<u8>, Vec<u8>)> {
    if client[..2] != CYCLONE {
        return Some((Vec::new(), request.to_vec()));
    }
    let (cdr, body) = request.split_at_checked(CDR_BYTES)?;
    let (head, message) = body.split_at_checked(CYCLONE_HEAD_BYTES)?;
    // sixteen bytes leave what follows as it was laid out
    Some((head.to_vec(), [cdr, message].concat()))
}

/// A response with what was in front of the request put in front of it.
fn with_head(head: &[u8], response: Vec<u8>) -> Vec<u8> {
    match response.split_at_checked(CDR_BYTES) {
        Some((cdr, message)) if !head.is_empty() => [cdr, head, message].concat(),
        _ => response,
    }
}

/// Answers services on threads of its own, until dropped.
#[derive(Debug)]
pub(crate) struct Services(mapwright_rtps::Services);

impl Services {
    /// In the domain of a configuration.
    pub(crate) fn new(configuration: &Configuration) -> Result<Self, WireError> {
        let domain = configuration.domain;
        let joined = mapwright_rtps::Services::join(&mapwright_rtps::Configuration {
            domain,
            is_local: configuration.range == Range::Localhost,
            is_announced: configuration.range == Range::Subnet,
            peers: configuration.peers.clone(),
        });
        let failed = |why: mapwright_rtps::RtpsError| WireError {
            doing: format!("a participant for services in domain {domain}"),
            why: why.to_string(),
        };
        joined.map(Self).map_err(failed)
    }

    /// Answers a service; the sixteen bytes of its reader and its writer come back.
    pub(crate) fn serve(&mut self, service: &Service, mut answer: Answer) -> Result<[[u8; 16]; 2], WireError> {
        let failed =
            |why: String| WireError { doing: format!("service {} of type {}", service.name, service.kind), why };
        let topic = |prefix: &str, suffix: &str, part: &str| {
            let kind = names::dds_type(service.kind, part).ok_or_else(|| failed("no such type".to_owned()))?;
            Ok([format!("{prefix}{}{suffix}", service.name), kind])
        };
        let names = ServiceNames {
            requests: topic("rq", "Request", "_Request")?,
            responses: topic("rr", "Reply", "_Response")?,
        };
        let answered = move |client: [u8; 12], request: &[u8]| {
            let (head, message) = split(client, request)?;
            Some(with_head(&head, answer(&message)))
        };
        self.0.serve(names, Box::new(answered)).map_err(|error| failed(error.to_string()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_client_of_cyclone_gets_its_head_back() {
        let cyclone = [1, 0x10, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];
        let cdr = [0, 1, 0, 0];
        let request: Vec<u8> = cdr.into_iter().chain(10..26).chain([7, 0, 0, 0]).collect();
        let (head, message) = split(cyclone, &request).unwrap();
        assert_eq!((head.clone(), message), ((10..26).collect::<Vec<u8>>(), vec![0, 1, 0, 0, 7, 0, 0, 0]));
        let response = with_head(&head, vec![0, 1, 0, 0, 1]);
        assert_eq!(response, cdr.into_iter().chain(10..26).chain([1]).collect::<Vec<u8>>());
        assert_eq!(split(cyclone, &request[..19]), None, "too short");
    }

    #[test]
    fn others_put_nothing_in_front() {
        let fast = [1, 0x0f, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0];
        let (head, message) = split(fast, &[0, 1, 0, 0, 7]).unwrap();
        assert_eq!((head.len(), &message), (0, &vec![0, 1, 0, 0, 7]));
        assert_eq!(with_head(&head, vec![0, 1, 0, 0]), [0, 1, 0, 0]);
    }
}
