//! Who may look: pages of another site may not, whatever name they gave this machine's address, and beyond this machine nobody without the
//! token.

use crate::error::ViewerError;
use axum::http::header::{HOST, ORIGIN};
use axum::http::{HeaderMap, HeaderName, StatusCode, Uri};
use std::net::{IpAddr, SocketAddr};

/// Characters of a token.
const TOKEN_LENGTHS: [usize; 2] = [16, 128];

/// What is asked of a request.
#[derive(Debug, Clone)]
pub(crate) struct Access {
    is_loopback: bool,
    token: Option<String>,
    names: Vec<String>,
}

/// Why a request is refused.
pub(crate) type Refusal = (StatusCode, &'static str);

impl Access {
    /// # Errors
    /// [`ViewerError::TokenMissing`] for an address that other machines reach, [`ViewerError::Token`] for one that can be guessed.
    pub(crate) fn new(address: SocketAddr, token: Option<String>, names: Vec<String>) -> Result<Self, ViewerError> {
        let is_loopback = address.ip().is_loopback();
        let [least, most] = TOKEN_LENGTHS;
        match &token {
            None if !is_loopback => return Err(ViewerError::TokenMissing { address }),
            Some(token) if !(least..=most).contains(&token.len()) || !token.bytes().all(is_plain) => {
                return Err(ViewerError::Token { least, most, found: token.chars().count() });
            }
            _ => {}
        }
        Ok(Self { is_loopback, token, names })
    }

    /// Whether a page may be told.
    pub(crate) fn page(&self, headers: &HeaderMap, uri: &Uri) -> Result<(), Refusal> {
        let host = only(headers, &HOST).ok_or((StatusCode::BAD_REQUEST, "one Host is expected"))?;
        if !self.is_known(host) {
            return Err((
                StatusCode::MISDIRECTED_REQUEST,
                "the view is asked for by another name than it knows: use its address",
            ));
        }
        match &self.token {
            Some(token) if !is_same(token, token_of(uri).unwrap_or_default()) => {
                Err((StatusCode::UNAUTHORIZED, "the view asks for its token: /?token=..."))
            }
            _ => Ok(()),
        }
    }

    /// Whether it may be told what changes: as for the page, and by a page of this view alone.
    pub(crate) fn stream(&self, headers: &HeaderMap, uri: &Uri) -> Result<(), Refusal> {
        self.page(headers, uri)?;
        let origin = only(headers, &ORIGIN).and_then(|origin| origin.strip_prefix("http://"));
        if origin.is_some() && origin == only(headers, &HOST) {
            Ok(())
        } else {
            Err((StatusCode::FORBIDDEN, "only the view's own page may ask"))
        }
    }

    /// A site whose name was made to mean this address calls it by that name: addresses and names that were given are no such names.
    fn is_known(&self, host: &str) -> bool {
        let name = without_port(host);
        let address = name.trim_start_matches('[').trim_end_matches(']').parse::<IpAddr>().ok();
        name.eq_ignore_ascii_case("localhost")
            || address.is_some_and(|address| address.is_loopback() || !self.is_loopback)
            || self.names.iter().any(|known| known.eq_ignore_ascii_case(name))
    }
}

fn is_plain(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || byte == b'-' || byte == b'_'
}

/// The value of a header that must stand there once.
fn only<'a>(headers: &'a HeaderMap, name: &HeaderName) -> Option<&'a str> {
    let mut values = headers.get_all(name).iter();
    let value = values.next()?.to_str().ok()?;
    values.next().is_none().then_some(value)
}

fn without_port(host: &str) -> &str {
    match host.rsplit_once(':') {
        Some((name, port)) if !port.is_empty() && port.bytes().all(|byte| byte.is_ascii_digit()) => name,
        _ => host,
    }
}

fn token_of(uri: &Uri) -> Option<&str> {
    uri.query()?.split('&').find_map(|pair| pair.strip_prefix("token="))
}

/// Compares in a time that says nothing of where two differ.
fn is_same(token: &str, asked: &str) -> bool {
    let differs = token.bytes().zip(asked.bytes()).fold(0, |differs, (a, b)| differs | (a ^ b));
    std::hint::black_box(differs) == 0 && token.len() == asked.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOKEN: &str = "0123456789abcdef";

    fn access(address: &str, token: Option<&str>) -> Access {
        Access::new(address.parse().unwrap(), token.map(str::to_owned), vec!["robot.lan".to_owned()]).unwrap()
    }

    fn headers(host: &str, origin: Option<&str>) -> HeaderMap {
        let mut headers = HeaderMap::new();
        headers.insert(HOST, host.parse().unwrap());
        origin.into_iter().for_each(|origin| drop(headers.insert(ORIGIN, origin.parse().unwrap())));
        headers
    }

    fn asks(access: &Access, host: &str, path: &str) -> Result<(), StatusCode> {
        access.page(&headers(host, None), &path.parse().unwrap()).map_err(|(status, _)| status)
    }

    #[test]
    fn another_name_for_this_address_is_refused() {
        let local = access("127.0.0.1:0", None);
        for host in ["127.0.0.1:8000", "localhost:1", "LOCALHOST", "[::1]:9", "127.9.9.9", "robot.lan:80"] {
            assert_eq!(asks(&local, host, "/"), Ok(()), "{host}");
        }
        for host in
            ["evil.example", "evil.example:8000", "10.0.0.1", "127.0.0.1.evil.example", "", "localhost.evil", "[::1"]
        {
            assert_eq!(asks(&local, host, "/"), Err(StatusCode::MISDIRECTED_REQUEST), "{host}");
        }
        assert_eq!(asks(&access("0.0.0.0:0", Some(TOKEN)), "10.0.0.1:80", &format!("/?token={TOKEN}")), Ok(()));
    }

    #[test]
    fn only_the_own_page_may_ask_for_changes() {
        let local = access("127.0.0.1:0", None);
        let asks =
            |origin: Option<&str>| local.stream(&headers("127.0.0.1:80", origin), &"/view".parse().unwrap()).is_ok();
        assert!(asks(Some("http://127.0.0.1:80")));
        for origin in
            [None, Some("null"), Some("http://evil.example"), Some("http://127.0.0.1:81"), Some("https://127.0.0.1:80")]
        {
            assert!(!asks(origin), "{origin:?}");
        }
        let mut twice = headers("127.0.0.1:80", Some("http://127.0.0.1:80"));
        twice.append(ORIGIN, "http://evil.example".parse().unwrap());
        assert!(local.stream(&twice, &"/view".parse().unwrap()).is_err());
    }

    #[test]
    fn beyond_this_machine_a_token_is_asked_for() {
        let refused = |address: &str, token: Option<&str>| {
            Access::new(address.parse().unwrap(), token.map(str::to_owned), vec![]).is_err()
        };
        assert!(refused("0.0.0.0:0", None) && refused("192.168.1.2:80", None) && refused("[::]:0", None));
        assert!(refused("0.0.0.0:0", Some("short")) && refused("127.0.0.1:0", Some("with spaces in it !!")));
        let open = access("0.0.0.0:0", Some(TOKEN));
        for path in ["/", "/?token=", "/?token=0123456789abcdeF", "/?token=0123456789abcdef0", "/?t=0123456789abcdef"] {
            assert_eq!(asks(&open, "10.0.0.1", path), Err(StatusCode::UNAUTHORIZED), "{path}");
        }
        assert_eq!(asks(&open, "10.0.0.1", "/?a=b&token=0123456789abcdef"), Ok(()));
    }
}
