//! Opening a session: as the router where this machine has none, among others where it has.

use crate::configuration::{Configuration, RouterPlace, router_place};
use std::net::{TcpStream, ToSocketAddrs};
use std::thread;
use std::time::{Duration, Instant};
use zenoh::{Session, Wait};

/// A program of this machine answers within that time, or not at all.
const ANSWERS_WITHIN: Duration = Duration::from_millis(250);
/// A router of this machine has taken a session in within that time, however busy.
const TAKEN_IN_WITHIN: Duration = Duration::from_secs(10);
const LOOK_AGAIN: Duration = Duration::from_millis(5);

/// A session, and whether it is the router; else why there is none, in words.
pub(crate) fn open(configuration: &Configuration) -> Result<(Session, bool), String> {
    let config = configuration.session().map_err(|error| error.to_string())?;
    let place = router_place(&config);
    if let Some(place) = place.as_ref().filter(|place| !is_answered(place)) {
        let router = configuration.router(place).map_err(|error| error.to_string())?;
        match zenoh::open(router).wait() {
            Ok(session) => return Ok((session, true)),
            // Another one has become it in the meantime.
            Err(_) if is_answered(place) => {}
            Err(error) => return Err(format!("as the router: {}", first_words(&error.to_string()))),
        }
    }
    let session = zenoh::open(config).wait().map_err(|error| first_words(&error.to_string()).to_owned())?;
    match place.filter(|_| !is_with_router(&session)) {
        None => Ok((session, false)),
        Some(RouterPlace { host, port }) => {
            Err(format!("expected a Zenoh router at tcp/{host}:{port}, found something that does not answer as one"))
        }
    }
}

/// Zenoh's reasons without where in its source they were found.
fn first_words(reason: &str) -> &str {
    reason.split(" at /").next().unwrap_or(reason)
}

fn is_answered(place: &RouterPlace) -> bool {
    let addresses = (place.host.as_str(), place.port).to_socket_addrs();
    addresses.into_iter().flatten().any(|address| TcpStream::connect_timeout(&address, ANSWERS_WITHIN).is_ok())
}

fn is_with_router(session: &Session) -> bool {
    let begun = Instant::now();
    loop {
        if session.info().routers_zid().wait().next().is_some() {
            return true;
        }
        if begun.elapsed() > TAKEN_IN_WITHIN {
            return false;
        }
        thread::sleep(LOOK_AGAIN);
    }
}
