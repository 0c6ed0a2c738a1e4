//! A page without a browser: for examples and tests.

use std::net::{SocketAddr, TcpStream};
use std::time::Duration;
use tungstenite::client::IntoClientRequest;
use tungstenite::http::HeaderValue;
use tungstenite::{Message, WebSocket};

/// A connection that asks for the next message when it has taken one.
pub(crate) struct Client {
    /// The connection.
    pub(crate) socket: WebSocket<TcpStream>,
}

impl Client {
    /// A page of the view at this address, and `query` behind its path.
    ///
    /// # Errors
    /// What the view or the system answers.
    pub(crate) fn connect(address: SocketAddr, query: &str) -> Result<Self, String> {
        Self::connect_as(address, query, Some(&format!("http://{address}")), &address.to_string())
    }

    /// The same from another page, or by another name.
    ///
    /// # Errors
    /// What the view or the system answers.
    pub(crate) fn connect_as(
        address: SocketAddr,
        query: &str,
        origin: Option<&str>,
        host: &str,
    ) -> Result<Self, String> {
        let words = |error: &dyn std::fmt::Display| error.to_string();
        let mut request = format!("ws://{address}/view{query}").into_client_request().map_err(|error| words(&error))?;
        let value = |text: &str| HeaderValue::from_str(text).map_err(|error| words(&error));
        request.headers_mut().insert("Host", value(host)?);
        if let Some(origin) = origin {
            request.headers_mut().insert("Origin", value(origin)?);
        }
        let stream = TcpStream::connect(address).map_err(|error| words(&error))?;
        stream.set_read_timeout(Some(Duration::from_secs(10))).map_err(|error| words(&error))?;
        let (socket, _) = tungstenite::client(request, stream).map_err(|error| words(&error))?;
        let mut client = Self { socket };
        client.ask("ready");
        Ok(client)
    }

    /// Asks for something; whether that reached it shows later.
    pub(crate) fn ask(&mut self, what: &str) {
        let _ = self.socket.send(Message::text(what));
    }

    /// The next message, if there is one in time; then the next one is asked for.
    pub(crate) fn next(&mut self, within: Duration) -> Option<Vec<u8>> {
        self.socket.get_ref().set_read_timeout(Some(within)).ok()?;
        loop {
            match self.socket.read() {
                Ok(Message::Binary(bytes)) => {
                    self.ask("ready");
                    return Some(bytes.to_vec());
                }
                Ok(_) => {}
                Err(_) => return None,
            }
        }
    }
}

/// Kinds and bytes of a message's records.
pub(crate) fn records(message: &[u8]) -> impl Iterator<Item = (u32, &[u8])> {
    let word =
        |at: usize| message.get(at..at + 4).map(|bytes| u32::from_le_bytes(bytes.try_into().unwrap_or_default()));
    let mut at = 4;
    std::iter::from_fn(move || {
        let (kind, length) = (word(at)?, word(at + 4)? as usize);
        let bytes = message.get(at + 8..at + 8 + length)?;
        at += 8 + length.next_multiple_of(4);
        Some((kind, bytes))
    })
}
