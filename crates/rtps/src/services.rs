//! Services on the network: sockets, threads and time around a [`Participant`].

use crate::ids::{Guid, Prefix};
use crate::interfaces::{ALL, LOOK, addresses, own, sender, shared};
use crate::packets::To;
use crate::participant::{Participant, Request, ServiceNames};
use std::collections::hash_map::RandomState;
use std::hash::{BuildHasher, Hasher};
use std::io;
use std::net::{Ipv4Addr, SocketAddr, SocketAddrV4, ToSocketAddrs, UdpSocket};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

/// Ports of a domain, of its participants, and which of them are for what (9.6.2.3).
const PORT_BASE: u32 = 7400;
const DOMAIN_PORTS: u32 = 250;
const PARTICIPANT_PORTS: u32 = 2;
const OWN_PORT: u32 = 10;
/// Participants of a machine that are looked for by their ports.
const PARTICIPANTS: u32 = 120;
/// Whether addresses have changed is looked so often.
const ADDRESSES_EVERY: Duration = Duration::from_secs(3);
const PACKET_MOST: usize = 1 << 16;

/// Called with a client that asks and its request in CDR with its head; what it returns is the response, in CDR as well, or none where
/// the request has none.
pub type Answer = Box<dyn FnMut([u8; 12], &[u8]) -> Option<Vec<u8>> + Send>;

/// Where services are offered.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Configuration {
    /// From 0 to 232.
    pub domain: u16,
    /// On this machine alone.
    pub is_local: bool,
    /// Others are looked for in the networks of this machine; otherwise where `peers` says alone.
    pub is_announced: bool,
    /// Names or addresses of machines where others are looked for besides.
    pub peers: Vec<String>,
}

/// Why services cannot be offered.
#[derive(Debug, thiserror::Error)]
pub enum RtpsError {
    /// The system refuses a socket or a thread.
    #[error("a socket for services: {0}")]
    Socket(#[from] io::Error),
    /// The domain has no ports.
    #[error("domain: expected a number from 0 to 232, found {0}")]
    Domain(u16),
    /// There are more services than numbers for them.
    #[error("expected at most 65535 services")]
    TooMany,
}

/// What the threads share.
struct Shared {
    participant: Mutex<Participant>,
    /// Something is due sooner than was thought.
    is_changed: Mutex<bool>,
    changed: Condvar,
    own: UdpSocket,
    /// Hears what is told to all.
    listening: Option<UdpSocket>,
    /// To all, from each of our addresses.
    senders: Mutex<Vec<(Ipv4Addr, UdpSocket)>>,
    to_all: SocketAddrV4,
    begun: Instant,
    is_over: AtomicBool,
    answers: Mutex<Vec<Arc<Mutex<Answer>>>>,
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    fn now(&self) -> Duration {
        self.begun.elapsed()
    }

    fn change(&self) {
        *lock(&self.is_changed) = true;
        self.changed.notify_one();
    }

    /// Sends what is to be sent, without the participant being held.
    fn flush(&self, mut participant: MutexGuard<'_, Participant>) {
        let packets = std::mem::take(&mut participant.out.0);
        drop(participant);
        for (to, bytes) in packets {
            // Who cannot be reached is told again, as who has not heard is.
            match to {
                To::One(to) => drop(self.own.send_to(&bytes, to)),
                To::All => {
                    for (_, socket) in &*lock(&self.senders) {
                        let _ = socket.send_to(&bytes, self.to_all);
                    }
                }
            }
        }
    }

    /// Hears packets until it is over.
    fn hear(&self, socket: &UdpSocket, requests: &Sender<Request>) {
        let mut packet = vec![0; PACKET_MOST];
        while !self.is_over.load(Ordering::Acquire) {
            let (length, from) = match socket.recv_from(&mut packet) {
                Ok((length, SocketAddr::V4(from))) => (length, from),
                Ok(_) => continue,
                Err(error) => {
                    if !matches!(
                        error.kind(),
                        io::ErrorKind::WouldBlock | io::ErrorKind::TimedOut | io::ErrorKind::Interrupted
                    ) {
                        thread::sleep(Duration::from_millis(10));
                    }
                    continue;
                }
            };
            let mut participant = lock(&self.participant);
            participant.receive(&packet[..length.min(packet.len())], from, self.now());
            while let Some(request) = participant.requests.pop_front() {
                let _ = requests.send(request);
            }
            self.flush(participant);
            self.change();
        }
    }

    /// Does what is due until it is over.
    fn turn(&self) {
        while !self.is_over.load(Ordering::Acquire) {
            let mut participant = lock(&self.participant);
            let next = participant.turn(self.now());
            self.flush(participant);
            let mut is_changed = lock(&self.is_changed);
            if !*is_changed {
                let wait = next.saturating_sub(self.now()).min(LOOK);
                let waited = self.changed.wait_timeout(is_changed, wait);
                is_changed = waited.map_or_else(|error| error.into_inner().0, |(guard, _)| guard);
            }
            *is_changed = false;
        }
        let mut participant = lock(&self.participant);
        participant.leave();
        self.flush(participant);
    }

    /// Looks around now and then, on a thread of its own: a name that nobody resolves is waited for.
    fn watch(&self, configuration: &Configuration) {
        let mut look_at = Duration::ZERO;
        while !self.is_over.load(Ordering::Acquire) {
            if self.now() >= look_at {
                self.look_around(configuration);
                self.change();
                look_at = self.now() + ADDRESSES_EVERY;
            }
            thread::sleep(LOOK);
        }
    }

    /// Looks where this machine is found now, and where others are.
    fn look_around(&self, configuration: &Configuration) {
        let port = self.own.local_addr().map_or(0, |address| address.port());
        let found = if configuration.is_local { vec![Ipv4Addr::LOCALHOST] } else { addresses() };
        if let Some(listening) = &self.listening {
            let mut senders = lock(&self.senders);
            senders.retain(|(address, _)| found.contains(address));
            for address in &found {
                if !senders.iter().any(|(has, _)| has == address)
                    && let Ok(socket) = sender(*address)
                {
                    // Refused where it hears there already.
                    let _ = listening.join_multicast_v4(&ALL, address);
                    senders.push((*address, socket));
                }
            }
        }
        let local = configuration.is_local.then(|| "127.0.0.1".to_owned());
        let places =
            configuration.peers.iter().chain(&local).flat_map(|peer| resolved(peer, configuration.domain)).collect();
        let locators = found.into_iter().map(|address| SocketAddrV4::new(address, port)).collect();
        lock(&self.participant).found_at(locators, places, self.now());
    }
}

fn port(domain: u16, offset: u32) -> Option<u16> {
    u16::try_from(PORT_BASE + DOMAIN_PORTS * u32::from(domain) + offset).ok()
}

fn shared_port(domain: u16) -> u16 {
    port(domain, 0).unwrap_or(0)
}

fn own_ports(domain: u16) -> impl Iterator<Item = u16> {
    (0..PARTICIPANTS).filter_map(move |at| port(domain, OWN_PORT + PARTICIPANT_PORTS * at))
}

/// Where participants of a machine may hear: at the port that is given, or at those of its first participants.
fn resolved(peer: &str, domain: u16) -> Vec<SocketAddrV4> {
    let v4 = |address: SocketAddr| match address {
        SocketAddr::V4(address) => Some(address),
        SocketAddr::V6(_) => None,
    };
    if let Ok(found) = peer.to_socket_addrs() {
        return found.filter_map(v4).take(1).collect();
    }
    let found = (peer, 0).to_socket_addrs().ok().and_then(|mut found| found.find_map(v4));
    found
        .map(|address| own_ports(domain).map(|port| SocketAddrV4::new(*address.ip(), port)).collect())
        .unwrap_or_default()
}

/// A number that no other participant has: no maker's, and ten random bytes.
fn prefix() -> Prefix {
    let random = || RandomState::new().build_hasher().finish().to_le_bytes();
    let mut prefix = [0; 12];
    prefix[2..10].copy_from_slice(&random());
    prefix[10..].copy_from_slice(&random()[..2]);
    prefix
}

/// Answers services on threads of its own, until dropped.
pub struct Services {
    shared: Arc<Shared>,
    threads: Vec<JoinHandle<()>>,
}

impl std::fmt::Debug for Services {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Services").finish_non_exhaustive()
    }
}

impl Services {
    /// Joins a domain.
    ///
    /// # Errors
    /// [`RtpsError`] where the domain or the system does not allow it.
    pub fn join(configuration: &Configuration) -> Result<Self, RtpsError> {
        if configuration.domain > 232 {
            return Err(RtpsError::Domain(configuration.domain));
        }
        let own = own(own_ports(configuration.domain))?;
        let is_heard = configuration.is_announced && !configuration.is_local;
        let all = if is_heard { Some(shared(shared_port(configuration.domain))?) } else { None };
        let participant = Participant::new(prefix(), configuration.domain, "enclave=/;");
        let shared = Arc::new(Shared {
            participant: Mutex::new(participant),
            is_changed: Mutex::new(false),
            changed: Condvar::new(),
            own: own.try_clone()?,
            listening: all.as_ref().map(UdpSocket::try_clone).transpose()?,
            senders: Mutex::new(Vec::new()),
            to_all: SocketAddrV4::new(ALL, shared_port(configuration.domain)),
            begun: Instant::now(),
            is_over: AtomicBool::new(false),
            answers: Mutex::new(Vec::new()),
        });
        let mut services = Self { shared: Arc::clone(&shared), threads: Vec::new() };
        let (sender, requests) = channel();
        for socket in [Some(own), all].into_iter().flatten() {
            let (shared, sender) = (Arc::clone(&shared), sender.clone());
            services.start("rtps hears", move || shared.hear(&socket, &sender))?;
        }
        drop(sender);
        let configuration = configuration.clone();
        services.start("rtps", {
            let shared = Arc::clone(&shared);
            move || shared.turn()
        })?;
        // Nobody waits for its end, for it may wait for a name.
        thread::Builder::new().name("rtps looks".to_owned()).spawn({
            let shared = Arc::clone(&shared);
            move || shared.watch(&configuration)
        })?;
        services.start("services", move || answer(&shared, &requests))?;
        Ok(services)
    }

    fn start(&mut self, name: &str, run: impl FnOnce() + Send + 'static) -> io::Result<()> {
        self.threads.push(thread::Builder::new().name(name.to_owned()).spawn(run)?);
        Ok(())
    }

    /// Answers a service; the sixteen bytes of its reader and its writer come back.
    ///
    /// # Errors
    /// [`RtpsError`] where there are too many.
    pub fn serve(&mut self, names: ServiceNames, answer: Answer) -> Result<[[u8; 16]; 2], RtpsError> {
        let mut participant = lock(&self.shared.participant);
        let guids = participant.serve(names, self.shared.now()).ok_or(RtpsError::TooMany)?;
        lock(&self.shared.answers).push(Arc::new(Mutex::new(answer)));
        self.shared.flush(participant);
        self.shared.change();
        Ok(guids.map(Guid::bytes))
    }
}

impl Drop for Services {
    fn drop(&mut self) {
        self.shared.is_over.store(true, Ordering::Release);
        self.shared.changed.notify_all();
        for thread in self.threads.drain(..) {
            let _ = thread.join();
        }
    }
}

/// Answers requests, one after the other, until nobody hears any.
fn answer(shared: &Shared, requests: &Receiver<Request>) {
    while let Ok(request) = requests.recv() {
        let answer = lock(&shared.answers).get(request.service).map(Arc::clone);
        let response = answer.and_then(|answer| {
            catch_unwind(AssertUnwindSafe(|| lock(&answer)(request.client, &request.bytes))).ok().flatten()
        });
        let mut participant = lock(&shared.participant);
        participant.respond(&request, response, shared.now());
        shared.flush(participant);
        shared.change();
    }
}
