//! The view as the mapper has it: a handle on its own thread, and the thread behind it.

use crate::access::Access;
use crate::error::ViewerError;
use crate::feed::Feed;
use crate::model::Model;
use crate::news::{News, View};
use crate::page::Served;
use crate::picture::Pen;
use crate::replay::{Player, Replay};
use crate::scene::{Key, Scene};
use crate::server::{Stage, Steer, serve};
use crate::wire;
use mapwright_record::{Session, Update};
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};
use tokio::sync::{oneshot, watch};
use tokio::time::{MissedTickBehavior, interval};

/// News is asked for, drawn and told so often.
const ROUND: Duration = Duration::from_millis(100);
/// While the run is paused its thread looks so often whether it goes on.
const LOOK_AGAIN: Duration = Duration::from_millis(20);
/// Lines of status, and characters of each.
const MOST_LINES: usize = 32;
const MOST_CHARACTERS: usize = 200;
/// What a page can do with a run.
const CAN_PAUSE: u32 = 1;
const HAS_TIME_LINE: u32 = 2;

/// Where the view is, and for whom.
#[derive(Debug, Clone)]
pub struct Settings {
    /// Where it listens; port 0 is any that is free. Any other address than this machine's own asks for a token.
    pub address: SocketAddr,
    /// What whoever looks must know: 16 to 128 characters of A-Z a-z 0-9 - _, hard to guess.
    pub token: Option<String>,
    /// Names by which pages may ask for it beside `localhost` and addresses.
    pub names: Vec<String>,
    /// So many may watch at a time.
    pub most_watching: usize,
    /// Whether a page may pause the run ([`Viewer::hold`]); otherwise it can only stop to look.
    pub can_pause: bool,
}

impl Default for Settings {
    /// Any free port of 127.0.0.1, for eight who watch.
    fn default() -> Self {
        let address = SocketAddr::from((Ipv4Addr::LOCALHOST, 0));
        Self { address, token: None, names: Vec::new(), most_watching: 8, can_pause: false }
    }
}

/// What passes between the mapper's thread and the view's.
#[derive(Debug, Default)]
struct Passage {
    inbox: Mutex<Inbox>,
    /// The view is ready for news, and somebody watches.
    is_wanted: AtomicBool,
    is_paused: AtomicBool,
    watching: Arc<AtomicUsize>,
}

#[derive(Debug, Default)]
struct Inbox {
    news: Option<News>,
    lines: Option<Vec<(String, String)>>,
}

/// A page in browsers that shows a run. It ends when this is dropped.
#[derive(Debug)]
pub struct Viewer {
    passage: Arc<Passage>,
    feed: Feed,
    lines: Vec<(String, String)>,
    lines_are_told: bool,
    scan_m: Option<Vec<[f32; 3]>>,
    address: SocketAddr,
    token: Option<String>,
    stop: Option<oneshot::Sender<()>>,
    thread: Option<JoinHandle<()>>,
}

impl Viewer {
    /// Opens the view of a run that begins or goes on. `pen` says how the map is drawn, and is without meaning for maps of space.
    ///
    /// # Errors
    /// [`ViewerError`]: the address is taken, other machines reach it and there is no token, or the token can be guessed.
    pub fn start(settings: Settings, pen: Pen) -> Result<Self, ViewerError> {
        Self::open(settings, pen, None)
    }

    /// Opens the view of a finished run, which plays it.
    ///
    /// # Errors
    /// As [`Viewer::start`].
    pub fn replay(settings: Settings, pen: Pen, replay: Replay) -> Result<Self, ViewerError> {
        Self::open(settings, pen, Some(replay))
    }

    fn open(settings: Settings, pen: Pen, replay: Option<Replay>) -> Result<Self, ViewerError> {
        let Settings { address, token, names, most_watching, can_pause } = settings;
        let access = Access::new(address, token.clone(), names)?;
        let cannot_listen = |cause| ViewerError::Listen { address, cause };
        let listener = TcpListener::bind(address).map_err(cannot_listen)?;
        let address = listener.local_addr().map_err(cannot_listen)?;
        listener.set_nonblocking(true).map_err(cannot_listen)?;
        let passage = Arc::new(Passage::default());
        let abilities = match &replay {
            Some(_) => CAN_PAUSE | HAS_TIME_LINE,
            None if can_pause => CAN_PAUSE,
            None => 0,
        };
        let stage = Arc::new(Stage {
            access,
            served: Served::new(),
            scene: Mutex::new(Scene::default()),
            steer: Mutex::new(Steer::default()),
            can_steer: abilities != 0,
            changed: watch::Sender::new(0),
            most_watching,
            watching: Arc::clone(&passage.watching),
        });
        let rounds = Rounds {
            passage: Arc::clone(&passage),
            stage: Arc::clone(&stage),
            model: Model::new(pen, abilities),
            player: replay.map(Player::new),
            at_s: 0.0,
        };
        let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build()?;
        let (stop, stopped) = oneshot::channel();
        let run = async move {
            // Its own thread is the only one to make a listener of the runtime.
            let Ok(listener) = tokio::net::TcpListener::from_std(listener) else { return };
            tokio::select! {
                _ = stopped => {}
                () = serve(listener, stage) => {}
                () = rounds.run() => {}
            }
        };
        let thread = thread::Builder::new().name("view".to_owned()).spawn(move || runtime.block_on(run))?;
        Ok(Self {
            passage,
            feed: Feed::default(),
            lines: Vec::new(),
            lines_are_told: true,
            scan_m: None,
            address,
            token,
            stop: Some(stop),
            thread: Some(thread),
        })
    }

    /// Where it listens.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// What to open in a browser, with the token; where the view listens on all addresses, put in the one by which this machine is reached.
    #[must_use]
    pub fn url(&self) -> String {
        let token = self.token.as_ref().map_or_else(String::new, |token| format!("?token={token}"));
        format!("http://{}/{token}", self.address)
    }

    /// How many watch.
    #[must_use]
    pub fn watching(&self) -> usize {
        self.passage.watching.load(Ordering::Relaxed)
    }

    /// Shows what an update has changed, at most ten times a second; between these, and while nobody watches, it is only noted of a
    /// keyframe how certain it was. Never waits. `session` is that of the mapper, the same at each call.
    pub fn show<M: View>(&mut self, update: &Update<M>, session: &Session<M>) {
        self.feed.hear(update, session);
        if !self.passage.is_wanted.load(Ordering::Acquire) {
            return;
        }
        // The view holds it for as long as it takes to take what is in it; then it is for the next update.
        let passage = Arc::clone(&self.passage);
        if let Ok(mut inbox) = passage.inbox.try_lock() {
            self.put(&mut inbox, update, session);
        }
    }

    /// Shows how a run has ended, whoever watches, also those who come later. May wait for the view's thread, for microseconds.
    pub fn finish<M: View>(&mut self, update: &Update<M>, session: &Session<M>) {
        self.feed.hear(update, session);
        let passage = Arc::clone(&self.passage);
        let mut inbox = passage.inbox.lock().unwrap_or_else(PoisonError::into_inner);
        self.put(&mut inbox, update, session);
    }

    fn put<M: View>(&mut self, inbox: &mut Inbox, update: &Update<M>, session: &Session<M>) {
        let news = News { scan: self.scan_m.take(), ..self.feed.news(update, session) };
        inbox.news.get_or_insert_default().add(news);
        if !self.lines_are_told {
            inbox.lines = Some(self.lines.clone());
            self.lines_are_told = true;
        }
        self.passage.is_wanted.store(false, Ordering::Release);
    }

    /// The end points of the scan that the next update is of, in the robot's frame, metres; they are asked for only where they are shown.
    /// Without them the newest keyframe's are.
    pub fn scan(&mut self, points_m: impl FnOnce() -> Vec<[f32; 3]>) {
        if self.passage.is_wanted.load(Ordering::Relaxed) {
            self.scan_m = Some(points_m());
        }
    }

    /// Lines of status, each a name and what is to be said: what is missing, what was dropped. Shown with the next update; 32 lines of 200
    /// characters at most.
    pub fn status(&mut self, lines: &[(String, String)]) {
        let lines = &lines[..lines.len().min(MOST_LINES)];
        if self.lines == lines {
            return;
        }
        let short = |text: &String| text.chars().take(MOST_CHARACTERS).collect::<String>();
        self.lines = lines.iter().map(|(name, value)| (short(name), short(value))).collect();
        self.lines_are_told = false;
    }

    /// Whether somebody who watches has paused the run. It goes on when that page is closed.
    #[must_use]
    pub fn is_paused(&self) -> bool {
        self.passage.is_paused.load(Ordering::Relaxed)
    }

    /// Waits while the run is paused, and goes on showing it to those who come: for callers who can wait, as whoever reads a log.
    pub fn hold<M: View>(&mut self, update: &Update<M>, session: &Session<M>) {
        while self.is_paused() {
            if self.passage.is_wanted.load(Ordering::Acquire) {
                self.finish(&Update { keyframe: None, entries: Vec::new(), ..update.clone() }, session);
            }
            thread::sleep(LOOK_AGAIN);
        }
    }

    /// Waits until the view ends, which it does not by itself: for callers who have nothing else to do.
    pub fn wait(mut self) {
        if let Some(thread) = self.thread.take() {
            let _keep = self.stop.take();
            let _ = thread.join(); // then it has ended
        }
    }
}

impl Drop for Viewer {
    fn drop(&mut self) {
        drop(self.stop.take());
        if let Some(thread) = self.thread.take() {
            let _ = thread.join(); // a view that broke has told nobody anything
        }
    }
}

/// What the view's thread does beside serving.
struct Rounds {
    passage: Arc<Passage>,
    stage: Arc<Stage>,
    model: Model,
    player: Option<Player>,
    at_s: f64,
}

impl Rounds {
    async fn run(mut self) {
        let mut rounds = interval(ROUND);
        rounds.set_missed_tick_behavior(MissedTickBehavior::Delay);
        let mut last = Instant::now();
        loop {
            rounds.tick().await;
            let elapsed_s = last.elapsed().as_secs_f64();
            last = Instant::now();
            self.round(elapsed_s);
        }
    }

    fn round(&mut self, elapsed_s: f64) {
        let is_watched = self.passage.watching.load(Ordering::Relaxed) > 0;
        let Inbox { news, lines } = self.take_inbox();
        if !is_watched && news.is_none() {
            self.follow_steering();
            return;
        }
        let stage = Arc::clone(&self.stage);
        let mut scene = stage.scene();
        if let Some(news) = news {
            self.at_s = news.at_s.unwrap_or(self.at_s);
            self.model.apply(news, &mut scene);
        }
        if let Some(lines) = lines {
            scene.set(Key::Lines, wire::lines(&lines));
        }
        self.follow_steering();
        if let Some(player) = &mut self.player {
            player.advance(elapsed_s);
            player.show(&mut self.model, &mut scene);
        }
        self.model.settle(&mut scene);
        scene.set(Key::Clock, self.clock());
        let version = scene.version();
        drop(scene);
        stage.changed.send_if_modified(|known| std::mem::replace(known, version) != version);
        if is_watched && self.player.is_none() {
            self.passage.is_wanted.store(true, Ordering::Release);
        }
    }

    fn take_inbox(&self) -> Inbox {
        std::mem::take(&mut *self.passage.inbox.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn follow_steering(&mut self) {
        let mut steer = self.stage.steer();
        let (pause, seek_s, speed) = (steer.pause.take(), steer.seek_s.take(), steer.speed.take());
        let is_paused = !steer.paused_by.is_empty();
        drop(steer);
        self.passage.is_paused.store(is_paused && self.player.is_none(), Ordering::Relaxed);
        let Some(player) = &mut self.player else { return };
        match pause {
            Some(true) => player.is_paused = true,
            Some(false) => player.resume(),
            None => {}
        }
        seek_s.into_iter().for_each(|at_s| player.seek(at_s));
        player.speed = speed.unwrap_or(player.speed);
    }

    fn clock(&self) -> Vec<u8> {
        match &self.player {
            Some(player) => wire::clock(player.at_s, player.end_s(), player.speed, player.is_paused),
            None => wire::clock(self.at_s, 0.0, 1.0, self.passage.is_paused.load(Ordering::Relaxed)),
        }
    }
}
