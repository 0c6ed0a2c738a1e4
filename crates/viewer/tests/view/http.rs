//! Who is let in, and what the others cost.

use crate::client::{Client, records};
use crate::rooms::Rooms;
use crate::{PATIENCE, PEN, drive_until, pose, read_until, viewer};
use mapwright_viewer::{Settings, Viewer, ViewerError};
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

const TOKEN: &str = "0123456789abcdef_-";

/// The answer to some bytes, as text.
fn answer(address: SocketAddr, request: &str) -> String {
    let mut stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream.write_all(request.as_bytes()).unwrap();
    let mut bytes = Vec::new();
    let _ = stream.read_to_end(&mut bytes); // it may be cut off
    String::from_utf8_lossy(&bytes).into_owned()
}

fn get(address: SocketAddr, path: &str, host: &str) -> String {
    answer(address, &format!("GET {path} HTTP/1.1\r\nHost: {host}\r\n\r\n"))
}

#[test]
fn the_page_comes_with_what_a_browser_is_to_forbid_it() {
    let viewer = viewer();
    let (address, host) = (viewer.address(), viewer.address().to_string());
    assert_eq!(viewer.url(), format!("http://{address}/"));
    let page = get(address, "/", &host);
    assert!(page.starts_with("HTTP/1.1 200"), "{page}");
    for line in [
        "content-security-policy: default-src 'none'; script-src 'sha256-",
        "cache-control: no-store",
        "x-content-type-options: nosniff",
        "referrer-policy: no-referrer",
        "frame-ancestors 'none'",
    ] {
        assert!(page.contains(line), "{line}");
    }
    assert!(!page.contains("access-control-allow"), "no other site reads it");
    assert!(page.len() < 28_000 && page.contains("<canvas"));
    let packed = answer(address, &format!("GET / HTTP/1.1\r\nHost: {host}\r\nAccept-Encoding: gzip\r\n\r\n"));
    assert!(packed.contains("content-encoding: gzip") && packed.len() < 20_000);
    assert!(get(address, "/other", &host).starts_with("HTTP/1.1 404"));
}

#[test]
fn other_names_and_other_pages_are_refused() {
    let viewer = viewer();
    let address = viewer.address();
    let host = address.to_string();
    assert!(get(address, "/", "evil.example").starts_with("HTTP/1.1 421"));
    assert!(answer(address, "GET / HTTP/1.1\r\n\r\n").starts_with("HTTP/1.1 400"));
    assert!(Client::connect(address, "").is_ok());
    for (origin, host) in [
        (Some("http://evil.example"), host.as_str()),
        (Some("null"), host.as_str()),
        (None, host.as_str()),
        (Some("http://evil.example"), "evil.example"),
    ] {
        let refused = Client::connect_as(address, "", origin, host);
        assert!(refused.is_err_and(|words| words.contains("403") || words.contains("421")), "{origin:?} {host}");
    }
}

#[test]
fn other_addresses_ask_for_the_token() {
    let settings = |address: &str, token: Option<&str>| Settings {
        address: address.parse().unwrap(),
        token: token.map(str::to_owned),
        ..Settings::default()
    };
    let refused = Viewer::start(settings("0.0.0.0:0", None), PEN);
    assert!(matches!(refused, Err(ViewerError::TokenMissing { .. })));
    let viewer = Viewer::start(settings("0.0.0.0:0", Some(TOKEN)), PEN).unwrap();
    let address = SocketAddr::from(([127, 0, 0, 1], viewer.address().port()));
    let host = address.to_string();
    assert!(viewer.url().ends_with(&format!("/?token={TOKEN}")));
    for path in ["/", "/?token=", "/?token=0123456789abcdef_+"] {
        assert!(get(address, path, &host).starts_with("HTTP/1.1 401"), "{path}");
    }
    assert!(get(address, &format!("/?token={TOKEN}"), &host).starts_with("HTTP/1.1 200"));
    assert!(Client::connect(address, "").is_err());
    assert!(Client::connect(address, &format!("?token={TOKEN}")).is_ok());
    let taken = Viewer::start(settings(&format!("0.0.0.0:{}", address.port()), Some(TOKEN)), PEN);
    assert!(matches!(taken, Err(ViewerError::Listen { .. })));
}

#[test]
fn a_page_that_never_reads_slows_nobody() {
    let (mut viewer, mut rooms) = (viewer(), Rooms::new(90));
    let _silent: Vec<Client> = (0..3).map(|_| Client::connect(viewer.address(), "").unwrap()).collect();
    let mut asks_only = Client::connect(viewer.address(), "").unwrap();
    let mut reads = Client::connect(viewer.address(), "").unwrap();
    read_until(&mut viewer, &mut rooms, &mut reads, |kind, _| kind == 2);
    let (begun, mut messages, mut slowest) = (Instant::now(), 0, Duration::ZERO);
    let mut number = 0;
    while begun.elapsed() < Duration::from_secs(3) {
        let update = rooms.keyframe(pose(number), pose(number));
        let shown = Instant::now();
        viewer.show(&update, &rooms.session);
        slowest = slowest.max(shown.elapsed());
        asks_only.ask("ready");
        messages += usize::from(reads.next(Duration::from_millis(60)).is_some());
        number += 1;
    }
    assert!(messages >= 12, "{messages} messages in 3 s");
    println!("{messages} messages in 3 s; show took {slowest:?} at most");
    assert!(slowest < Duration::from_millis(100), "{slowest:?}");
}

#[test]
fn what_is_no_request_ends_the_connection_and_nothing_else() {
    let mut viewer = viewer();
    let address = viewer.address();
    let handshake = format!(
        "GET /view HTTP/1.1\r\nHost: {address}\r\nOrigin: http://{address}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
         Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
    );
    let huge_frame = [0x82, 0xff, 0, 0, 0, 0, 0x40, 0, 0, 0, 1, 2, 3, 4];
    let garbage: Vec<u8> = (0..4096_u32).map(|k| (k.wrapping_mul(2_654_435_761) >> 13) as u8).collect();
    let masked = |text: &[u8]| [&[0x81, 0x80 | text.len() as u8, 0, 0, 0, 0], text].concat();
    for bytes in
        [huge_frame.to_vec(), garbage.clone(), masked(b"drop table"), masked(&[0xff, 0xfe]), masked(&[b' '; 80])]
    {
        let mut stream = TcpStream::connect(address).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream.write_all(handshake.as_bytes()).unwrap();
        stream.write_all(&bytes).unwrap();
        let mut rest = Vec::new();
        let _ = stream.read_to_end(&mut rest); // ends, or is reset
        assert!(rest.starts_with(b"HTTP/1.1 101"));
    }
    // What is no HTTP either: the view goes on.
    for bytes in [&garbage[..], b"GET / HTTP/1.1\r\nHost: a\r\nHost: b\r\n\r\n", &[b'a'; 100_000]] {
        let mut stream = TcpStream::connect(address).unwrap();
        let _ = stream.write_all(bytes);
        let _ = stream.read(&mut [0; 64]);
    }
    let mut rooms = Rooms::new(90);
    let mut client = Client::connect(address, "").unwrap();
    read_until(&mut viewer, &mut rooms, &mut client, |kind, _| kind == 2);
    drop(client);
    drive_until(&mut viewer, &mut rooms, |viewer| viewer.watching() == 0);
}

#[test]
fn no_more_watch_than_may() {
    let viewer = Viewer::start(Settings { most_watching: 2, ..Settings::default() }, PEN).unwrap();
    let both: Vec<Client> = (0..2).map(|_| Client::connect(viewer.address(), "").unwrap()).collect();
    assert!(Client::connect(viewer.address(), "").is_err_and(|words| words.contains("503")));
    drop(both);
    let begun = Instant::now();
    while Client::connect(viewer.address(), "").is_err() {
        assert!(begun.elapsed() < PATIENCE);
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn who_asks_slowly_is_let_go() {
    let viewer = viewer();
    let mut slow: Vec<TcpStream> = (0..80).map(|_| TcpStream::connect(viewer.address()).unwrap()).collect();
    let begun = Instant::now();
    for stream in &mut slow {
        let _ = stream.write_all(b"GET / HT");
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        let _ = stream.read_to_end(&mut Vec::new());
    }
    assert!(begun.elapsed() < Duration::from_secs(30), "{:?}", begun.elapsed());
    assert!(get(viewer.address(), "/", "localhost").starts_with("HTTP/1.1 200"));
}

#[test]
fn a_run_is_paused_until_the_page_goes() {
    let (mut viewer, mut rooms) =
        (Viewer::start(Settings { can_pause: true, ..Settings::default() }, PEN).unwrap(), Rooms::new(90));
    let mut client = Client::connect(viewer.address(), "").unwrap();
    client.ask("pause");
    drive_until(&mut viewer, &mut rooms, Viewer::is_paused);
    // Who comes while it is paused sees it all the same.
    let update = rooms.candidate(0, 0, mapwright_record::Verdict::Accepted);
    let address = viewer.address();
    let late = std::thread::spawn(move || {
        let mut late = Client::connect(address, "").unwrap();
        let begun = Instant::now();
        while begun.elapsed() < PATIENCE {
            let message = late.next(Duration::from_secs(5)).unwrap_or_default();
            if records(&message).any(|(kind, _)| kind == 2) {
                drop(client);
                return true;
            }
        }
        false
    });
    viewer.hold(&update, &rooms.session);
    assert!(late.join().unwrap() && !viewer.is_paused());
    // Where a run cannot be paused nobody pauses it.
    let (mut viewer, mut rooms) = (crate::viewer(), Rooms::new(90));
    let mut client = Client::connect(viewer.address(), "").unwrap();
    client.ask("pause");
    read_until(&mut viewer, &mut rooms, &mut client, |kind, _| kind == 2);
    assert!(!viewer.is_paused());
}
