//! The page and what changes, over HTTP.

use crate::access::{Access, Refusal};
use crate::page::Served;
use crate::scene::Scene;
use crate::wire::{Asked, MOST_ASKED};
use axum::Router;
use axum::extract::State;
use axum::extract::ws::{Message, WebSocket, WebSocketUpgrade};
use axum::http::header::{
    ACCEPT_ENCODING, CACHE_CONTROL, CONNECTION, CONTENT_ENCODING, CONTENT_SECURITY_POLICY, CONTENT_TYPE,
    REFERRER_POLICY, X_CONTENT_TYPE_OPTIONS,
};
use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode, Uri};
use axum::response::{IntoResponse, Response};
use axum::routing::get;
use hyper::server::conn::http1;
use hyper_util::rt::{TokioIo, TokioTimer};
use hyper_util::service::TowerToHyperService;
use std::collections::BTreeSet;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::{Semaphore, watch};
use tokio::time::{Instant, sleep, sleep_until, timeout};

/// Connections that ask for something, at a time, and how long each may take: a page is sent in a fraction of that.
const MOST_ASKING: usize = 64;
const TO_ASK: Duration = Duration::from_secs(5);
const TO_ANSWER: Duration = Duration::from_secs(20);
/// Bytes of a request's head, at most.
const MOST_HEAD: usize = 16 * 1024;
/// A page is told of changes so often at most, by messages of so many bytes.
const PACE: Duration = Duration::from_millis(95);
const MOST_MESSAGE: usize = 1 << 20;
/// A message that is not taken within this time ends the connection, as silence does; so often a page is asked whether it lives.
const TO_TAKE: Duration = Duration::from_secs(20);
const SILENCE: Duration = Duration::from_secs(30);
const ASK_AGAIN: Duration = Duration::from_secs(10);

/// What is shared with those who look.
pub(crate) struct Stage {
    pub(crate) access: Access,
    pub(crate) served: Served,
    pub(crate) scene: Mutex<Scene>,
    pub(crate) steer: Mutex<Steer>,
    pub(crate) can_steer: bool,
    /// The scene's version.
    pub(crate) changed: watch::Sender<u64>,
    pub(crate) most_watching: usize,
    pub(crate) watching: Arc<AtomicUsize>,
}

/// What pages have asked for, the newest of each kind.
#[derive(Debug, Default)]
pub(crate) struct Steer {
    next_page: u64,
    /// Pages that have paused the run. What they asked for ends with them.
    pub(crate) paused_by: BTreeSet<u64>,
    pub(crate) pause: Option<bool>,
    pub(crate) seek_s: Option<f64>,
    pub(crate) speed: Option<f64>,
}

impl Stage {
    pub(crate) fn scene(&self) -> std::sync::MutexGuard<'_, Scene> {
        self.scene.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(crate) fn steer(&self) -> std::sync::MutexGuard<'_, Steer> {
        self.steer.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Lets in whoever asks, as long as this is awaited.
pub(crate) async fn serve(listener: TcpListener, stage: Arc<Stage>) {
    let asking = Arc::new(Semaphore::new(MOST_ASKING));
    let router = Router::new().route("/", get(page)).route("/view", get(view)).fallback(nothing).with_state(stage);
    loop {
        let Ok((stream, _)) = listener.accept().await else {
            sleep(Duration::from_millis(100)).await; // out of files, say
            continue;
        };
        // One too many is let go.
        if let Ok(permit) = Arc::clone(&asking).try_acquire_owned() {
            let router = router.clone();
            tokio::spawn(async move {
                let _ = timeout(TO_ANSWER, answer(stream, router)).await; // whoever breaks off is not missed
                drop(permit);
            });
        }
    }
}

/// One request a connection; one that becomes a stream of changes goes on by itself.
async fn answer(stream: TcpStream, router: Router) {
    let _ = stream.set_nodelay(true); // then it is slower
    let connection = http1::Builder::new()
        .timer(TokioTimer::new())
        .header_read_timeout(TO_ASK)
        .max_buf_size(MOST_HEAD)
        .serve_connection(TokioIo::new(stream), TowerToHyperService::new(router))
        .with_upgrades();
    let _ = connection.await; // whoever breaks off is not missed
}

async fn nothing() -> Response {
    refuse((StatusCode::NOT_FOUND, "there is nothing but /"))
}

async fn page(State(stage): State<Arc<Stage>>, headers: HeaderMap, uri: Uri) -> Response {
    if let Err(refusal) = stage.access.page(&headers, &uri) {
        return refuse(refusal);
    }
    let accepts = headers.get(ACCEPT_ENCODING).and_then(|value| value.to_str().ok()).unwrap_or_default();
    let body = match &stage.served.gzip {
        Some(gzip) if accepts.contains("gzip") => ([(CONTENT_ENCODING, "gzip")], gzip.clone()).into_response(),
        _ => stage.served.plain.clone().into_response(),
    };
    let policy = HeaderValue::from_str(&stage.served.policy).unwrap_or(HeaderValue::from_static("default-src 'none'"));
    let mut response = guarded(body);
    response.headers_mut().insert(CONTENT_TYPE, HeaderValue::from_static("text/html; charset=utf-8"));
    response.headers_mut().insert(CONTENT_SECURITY_POLICY, policy);
    response
}

fn refuse((status, words): Refusal) -> Response {
    guarded((status, format!("{words}\n")).into_response())
}

/// What any answer says to a browser: keep nothing, guess nothing, tell nobody, show it to no other site.
fn guarded(mut response: Response) -> Response {
    for (name, value) in [
        (CONNECTION, "close"),
        (CACHE_CONTROL, "no-store"),
        (X_CONTENT_TYPE_OPTIONS, "nosniff"),
        (REFERRER_POLICY, "no-referrer"),
        (HeaderName::from_static("cross-origin-resource-policy"), "same-origin"),
        (HeaderName::from_static("cross-origin-opener-policy"), "same-origin"),
    ] {
        response.headers_mut().insert(name, HeaderValue::from_static(value));
    }
    response
}

async fn view(
    State(stage): State<Arc<Stage>>,
    headers: HeaderMap,
    uri: Uri,
    upgrade: Result<WebSocketUpgrade, axum::extract::ws::rejection::WebSocketUpgradeRejection>,
) -> Response {
    if let Err(refusal) = stage.access.stream(&headers, &uri) {
        return refuse(refusal);
    }
    let Ok(upgrade) = upgrade else {
        return refuse((StatusCode::BAD_REQUEST, "expected a WebSocket"));
    };
    let Some(place) = Place::take(&stage) else {
        return refuse((StatusCode::SERVICE_UNAVAILABLE, "too many are watching"));
    };
    let bounded = upgrade.max_message_size(MOST_ASKED).max_frame_size(MOST_ASKED);
    bounded.on_upgrade(move |socket| async move { watch(socket, &place).await })
}

/// A place among those who watch; given back when it is dropped, with what its page asked for.
struct Place {
    stage: Arc<Stage>,
    page: u64,
}

impl Place {
    fn take(stage: &Arc<Stage>) -> Option<Self> {
        let mut steer = stage.steer();
        if stage.watching.load(Ordering::Relaxed) >= stage.most_watching {
            return None;
        }
        stage.watching.fetch_add(1, Ordering::Relaxed);
        steer.next_page += 1;
        Some(Self { stage: Arc::clone(stage), page: steer.next_page })
    }

    fn do_as(&self, asked: Asked) {
        if !self.stage.can_steer {
            return;
        }
        let mut steer = self.stage.steer();
        match asked {
            Asked::Ready => {}
            Asked::Pause => {
                steer.paused_by.insert(self.page);
                steer.pause = Some(true);
            }
            Asked::Resume => {
                steer.paused_by.clear();
                steer.pause = Some(false);
            }
            Asked::Seek(at_s) => steer.seek_s = Some(at_s),
            Asked::Speed(times) => steer.speed = Some(times),
        }
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.stage.watching.fetch_sub(1, Ordering::Relaxed);
        self.stage.steer().paused_by.remove(&self.page);
    }
}

/// Tells a page what changes whenever it says that it is ready for more, until it leaves, falls silent or says what is no request.
async fn watch(mut socket: WebSocket, place: &Place) {
    let mut changed = place.stage.changed.subscribe();
    let (mut known, mut is_ready) = (0, false);
    let mut due = Instant::now();
    let (mut heard, mut asked) = (due, due);
    loop {
        let is_behind = is_ready && *changed.borrow_and_update() > known;
        tokio::select! {
            message = socket.recv() => {
                heard = Instant::now();
                match message {
                    Some(Ok(Message::Text(text))) => match Asked::read(&text) {
                        Some(Asked::Ready) => is_ready = true,
                        Some(other) => place.do_as(other),
                        None => return,
                    },
                    Some(Ok(Message::Pong(_) | Message::Ping(_))) => {}
                    _ => return,
                }
            }
            told = changed.changed(), if is_ready && !is_behind => {
                if told.is_err() {
                    return;
                }
            }
            () = sleep_until(due), if is_behind => {
                let news = place.stage.scene().since(known, MOST_MESSAGE);
                let Some((message, version)) = news else {
                    known = *changed.borrow();
                    continue;
                };
                if !is_taken(&mut socket, Message::Binary(message.into())).await {
                    return;
                }
                is_ready = false;
                known = version;
                due = Instant::now() + if version < *changed.borrow() { Duration::ZERO } else { PACE };
            }
            () = sleep_until(asked + ASK_AGAIN) => {
                asked = Instant::now();
                if heard.elapsed() > SILENCE || !is_taken(&mut socket, Message::Ping(Vec::new().into())).await {
                    return;
                }
            }
        }
    }
}

async fn is_taken(socket: &mut WebSocket, message: Message) -> bool {
    matches!(timeout(TO_TAKE, socket.send(message)).await, Ok(Ok(())))
}
