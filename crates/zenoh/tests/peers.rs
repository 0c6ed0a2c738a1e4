//! Beside other programs: another process of this crate, sessions of Zenoh that speak as rmw_zenoh does, and a client in Python and one of hiroz where
//! there are such.
#![allow(clippy::unwrap_used, clippy::print_stderr, clippy::print_stdout, reason = "tests may")]

use mapwright_live::wire::{Delivery, Publisher, Service, Topic, Wire};
use mapwright_zenoh::{Configuration, Zenoh};
use std::io::{BufRead, BufReader};
use std::net::TcpListener;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc::{Receiver, channel};
use std::thread::sleep;
use std::time::{Duration, Instant};
use zenoh::Wait;

const KIND: &str = "std_msgs/msg/String";
const KEY: &str =
    "std_msgs::msg::dds_::String_/RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18";
const STATE: &str = "0/echo/state/lifecycle_msgs::srv::dds_::GetState_/RIHS01_800a0a5aae599782b02932de0caf563f6dc4e7e94b794eadde075ba2cbef9795";
const RELIABLE: Delivery = Delivery::Reliable { depth: 10 };
const KEPT: Delivery = Delivery::Latched { depth: 1 };

fn free_port() -> u16 {
    TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port()
}

fn configuration(port: u16) -> Configuration {
    let overrides = vec![("connect/endpoints".to_owned(), format!("[\"tcp/localhost:{port}\"]"))];
    Configuration { overrides, ..Configuration::default() }
}

fn join(port: u16, name: &str) -> Zenoh {
    Zenoh::join(&configuration(port), "/", name).unwrap()
}

/// The example `zenoh_echo`, which Cargo builds with the tests.
struct Echo(Child);

impl Echo {
    fn start(port: u16, [heard, told]: [&str; 2]) -> Self {
        let tests = std::env::current_exe().unwrap();
        let target: PathBuf = tests.parent().unwrap().parent().unwrap().join("examples");
        let mut child = Command::new(target.join("zenoh_echo"))
            .args([heard, told, KIND])
            .env("ROS_DOMAIN_ID", "0")
            .env("ZENOH_CONFIG_OVERRIDE", format!("connect/endpoints=[\"tcp/localhost:{port}\"]"))
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(child.stdout.as_mut().unwrap()).read_line(&mut line).unwrap();
        assert!(line.starts_with("ready"), "{line}");
        Self(child)
    }

    fn signal(&self, signal: &str) {
        assert!(Command::new("kill").args([signal, &self.0.id().to_string()]).status().unwrap().success());
    }
}

impl Drop for Echo {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn text(length: usize) -> Vec<u8> {
    let mut bytes = vec![0, 1, 0, 0];
    bytes.extend((length as u32 + 1).to_le_bytes());
    bytes.extend(std::iter::repeat_n(b'x', length).chain([0]));
    bytes
}

fn until(what: impl Fn() -> bool) {
    let begun = Instant::now();
    while !what() {
        assert!(begun.elapsed() < Duration::from_secs(20), "not within 20 s");
        sleep(Duration::from_millis(10));
    }
}

fn hear(wire: &mut Zenoh, name: &str, delivery: Delivery) -> Receiver<Vec<u8>> {
    let (sender, heard) = channel();
    let hear = Box::new(move |bytes: &[u8]| {
        let _ = sender.send(bytes.to_vec());
    });
    wire.subscribe(&Topic::new(name, KIND, delivery), hear).unwrap();
    heard
}

fn next(heard: &Receiver<Vec<u8>>) -> Vec<u8> {
    heard.recv_timeout(Duration::from_secs(20)).unwrap()
}

fn raw(port: u16) -> zenoh::Session {
    let config = format!(
        "{{mode: \"peer\", connect: {{endpoints: [\"tcp/localhost:{port}\"]}}, listen: {{endpoints: [\"tcp/localhost:0\"]}}, \
         scouting: {{multicast: {{enabled: false}}}}, timestamping: {{enabled: true}}}}"
    );
    zenoh::open(zenoh::Config::from_json5(&config).unwrap()).wait().unwrap()
}

/// What is told comes back as it was, small and large; who comes late gets the newest that is kept; who has gone and comes again is heard again.
#[test]
fn messages_go_there_and_back() {
    let port = free_port();
    let mut wire = join(port, "peer");
    assert!(wire.is_router(), "there was none");
    let heard = hear(&mut wire, "/out", KEPT);
    let publisher = wire.advertise(&Topic::new("/in", KIND, RELIABLE)).unwrap();
    let echo = Echo::start(port, ["/in", "/out"]);
    until(|| publisher.listeners() == 1);
    for length in [0, 1, 1000, 100_000, 3_000_000] {
        publisher.publish(&text(length)).unwrap();
        assert_eq!(next(&heard).len(), text(length).len());
    }
    let late = hear(&mut wire, "/out", KEPT);
    assert_eq!(next(&late), text(3_000_000), "the last one is kept for who comes late");
    drop(echo);
    until(|| publisher.listeners() == 0);
    let _again = Echo::start(port, ["/in", "/out"]);
    until(|| publisher.listeners() == 1);
    publisher.publish(&text(7)).unwrap();
    assert_eq!(next(&heard), text(7));
}

/// The first becomes the router, the next ones find each other through it, and nodes of other domains are not heard.
#[test]
fn the_first_is_the_router() {
    let port = free_port();
    let router = join(port, "router");
    let (mut first, mut second) = (join(port, "first"), join(port, "second"));
    assert_eq!((router.is_router(), first.is_router(), second.is_router()), (true, false, false));
    let mut elsewhere = Zenoh::join(&Configuration { domain: 7, ..configuration(port) }, "/", "elsewhere").unwrap();
    let (heard, not_heard) = (hear(&mut second, "/in", RELIABLE), hear(&mut elsewhere, "/in", RELIABLE));
    let publisher = first.advertise(&Topic::new("/in", KIND, RELIABLE)).unwrap();
    until(|| publisher.listeners() == 1);
    publisher.publish(&text(3)).unwrap();
    assert_eq!(next(&heard), text(3));
    assert!(not_heard.try_recv().is_err());
}

/// What listens there is no router: that is said.
#[test]
fn a_port_that_is_taken_is_said() {
    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = taken.local_addr().unwrap().port();
    let error = Zenoh::join(&configuration(port), "/", "map").unwrap_err().to_string();
    assert!(error.contains(&format!("router at tcp/localhost:{port}")), "{error}");
}

#[test]
fn names_and_types_that_cannot_be_are_refused() {
    let port = free_port();
    assert!(Zenoh::join(&configuration(port), "/", "no name").is_err());
    let mut wire = join(port, "names");
    let refused = |wire: &mut Zenoh, name, kind| {
        wire.advertise(&Topic::new(name, kind, RELIABLE)).map(|_| ()).unwrap_err().to_string()
    };
    assert_eq!(refused(&mut wire, "scan", KIND), "topic scan of type std_msgs/msg/String: nothing can be called so");
    assert_eq!(refused(&mut wire, "/scan", "String"), "topic /scan of type String: no such type");
    assert!(
        refused(&mut wire, "/scan", "my_msgs/msg/Secret").contains("definition of my_msgs/msg/Secret is not known")
    );
}

/// Others see the node and its ends, by the tokens of rmw_zenoh.
#[test]
fn others_see_who_is_there() {
    let port = free_port();
    let mut wire = Zenoh::join(&configuration(port), "/robot", "mapper").unwrap();
    let publisher = wire.advertise(&Topic::new("/robot/out", KIND, KEPT)).unwrap();
    let _heard = hear(&mut wire, "/in", Delivery::BestEffort { depth: 5 });
    let service = Service { name: "/echo/state".to_owned(), kind: "lifecycle_msgs/srv/GetState" };
    wire.serve(&service, Box::new(|_| Vec::new())).unwrap();
    let other = raw(port);
    let seen = || {
        let replies = other.liveliness().get("@ros2_lv/0/**").wait().unwrap();
        let tokens = replies.into_iter().filter_map(|reply| Some(reply.result().ok()?.key_expr().to_string()));
        let mut tokens: Vec<String> = tokens.map(|token| token.splitn(4, '/').last().unwrap().to_owned()).collect();
        tokens.sort();
        tokens
    };
    until(|| seen().len() == 4);
    assert_eq!(
        seen(),
        [
            "0/0/NN/%/%robot/mapper".to_owned(),
            format!("0/1/MP/%/%robot/mapper/%robot%out/{KEY}/:1:,1:,:,:,,"),
            format!("0/2/MS/%/%robot/mapper/%in/{KEY}/2::,5:,:,:,,"),
            format!("0/3/SS/%/%robot/mapper/%echo%state/{}/::,10:,:,:,,", STATE.splitn(4, '/').last().unwrap()),
        ]
    );
    drop(publisher);
    until(|| seen().len() == 3);
}

/// Twenty requests as rmw_zenoh's clients ask them, with what stood beside the request beside the response.
#[test]
fn services_answer() {
    let port = free_port();
    let mut wire = join(port, "server");
    let service = Service { name: "/echo/state".to_owned(), kind: "lifecycle_msgs/srv/GetState" };
    wire.serve(&service, Box::new(|request| [request, b"!"].concat())).unwrap();
    let client = raw(port);
    for number in 0..20_i64 {
        let attachment = [&number.to_le_bytes()[..], &5_i64.to_le_bytes(), &[16], &[9; 16]].concat();
        let (response, beside) = ask(&client, STATE, text(number as usize), Some(attachment.clone())).unwrap();
        assert_eq!(response, [text(number as usize), b"!".to_vec()].concat());
        assert_eq!((&beside[..8], &beside[16..]), (&attachment[..8], &attachment[16..]), "number and sender come back");
    }
    let foreign = STATE.replace("RIHS01_8", "RIHS01_9");
    let attachment = [&[0; 16][..], &[16], &[9; 16]].concat();
    assert!(ask(&client, &foreign, text(1), Some(attachment)).is_ok(), "another distribution's hash");
}

fn ask(
    client: &zenoh::Session,
    key: &str,
    request: Vec<u8>,
    attachment: Option<Vec<u8>>,
) -> Result<(Vec<u8>, Vec<u8>), String> {
    let begun = Instant::now();
    loop {
        let query = client.get(key).payload(request.clone()).target(zenoh::query::QueryTarget::AllComplete);
        let query = query.consolidation(zenoh::query::ConsolidationMode::None).timeout(Duration::from_secs(5));
        let replies = match &attachment {
            Some(bytes) => query.attachment(bytes.clone()).wait().unwrap(),
            None => query.wait().unwrap(),
        };
        match replies.recv() {
            Ok(reply) => {
                return match reply.result() {
                    Ok(sample) => {
                        let beside = sample.attachment().map(|bytes| bytes.to_bytes().into_owned()).unwrap_or_default();
                        Ok((sample.payload().to_bytes().into_owned(), beside))
                    }
                    Err(error) => Err(String::from_utf8_lossy(&error.payload().to_bytes()).into_owned()),
                };
            }
            // its queryable has not been heard of yet
            Err(_) => assert!(begun.elapsed() < Duration::from_secs(20), "no answer"),
        }
        sleep(Duration::from_millis(20));
    }
}

/// Bytes that are none of ours, on our topics and services: nothing of it ends anything.
#[test]
fn what_is_hostile_is_survived() {
    let port = free_port();
    let mut wire = join(port, "victim");
    let (heard, kept) = (hear(&mut wire, "/in", RELIABLE), hear(&mut wire, "/kept", KEPT));
    wire.subscribe(&Topic::new("/panics", KIND, RELIABLE), Box::new(|_| std::panic::resume_unwind(Box::new(()))))
        .unwrap();
    let service = Service { name: "/echo/state".to_owned(), kind: "lifecycle_msgs/srv/GetState" };
    let answer = |request: &[u8]| {
        if request.len() > 100 {
            std::panic::resume_unwind(Box::new(()));
        }
        request.to_vec()
    };
    wire.serve(&service, Box::new(answer)).unwrap();
    let publisher = wire.advertise(&Topic::new("/out", KIND, KEPT)).unwrap();
    let other = raw(port);
    let in_key = format!("0/in/{KEY}");
    // until it has been heard of
    let begun = Instant::now();
    while heard.try_recv().is_err() {
        other.put(&in_key, text(0)).wait().unwrap();
        assert!(begun.elapsed() < Duration::from_secs(20));
        sleep(Duration::from_millis(20));
    }
    for length in [0, 1, 3, 5, 33, 70_000] {
        let junk = vec![0xff; length];
        for topic in ["in", "kept", "panics", "out", "echo/state"] {
            let key = format!("0/{topic}/{KEY}");
            other.put(&key, junk.clone()).attachment(junk.clone()).wait().unwrap();
            other.delete(&key).wait().unwrap();
        }
        other.put("0/**", junk.clone()).wait().unwrap();
        other.put(format!("0/kept/{KEY}/@adv/pub/1/1/_"), junk.clone()).wait().unwrap();
        for token in ["@ros2_lv/0/x/y/z/MS/%/%/n/%out/t/h/q", "@ros2_lv/0/1/2/3/NN", "@ros2_lv/0"] {
            drop(other.liveliness().declare_token(token).wait().unwrap());
        }
        assert!(ask(&other, STATE, text(3), Some(junk.clone())).is_err(), "an attachment of {length}");
        assert!(ask(&other, STATE, text(3), None).is_err(), "no attachment");
    }
    let attachment = [&[0; 16][..], &[16], &[9; 16]].concat();
    assert!(ask(&other, STATE, text(1000), Some(attachment.clone())).unwrap_err().contains("not be answered"));
    assert_eq!(ask(&other, STATE, text(3), Some(attachment)).unwrap().0, text(3));
    publisher.publish(&text(1)).unwrap();
    while heard.try_recv().is_ok() || kept.try_recv().is_ok() {}
    other.put(&in_key, text(9)).wait().unwrap();
    assert_eq!(next(&heard), text(9));
}

/// One who has stopped and takes nothing: no message waits for it longer than a tenth of a second, and the others get theirs.
#[test]
fn who_takes_nothing_stops_nobody() {
    let port = free_port();
    let mut wire = join(port, "teller");
    let small = wire.advertise(&Topic::new("/in", KIND, RELIABLE)).unwrap();
    let large = wire.advertise(&Topic::new("/large", KIND, KEPT)).unwrap();
    let (stopped, _two) = (Echo::start(port, ["/in", "/out"]), Echo::start(port, ["/large", "/copy"]));
    let also = Echo::start(port, ["/large", "/copy2"]);
    let mut other = join(port, "other");
    let heard = hear(&mut other, "/in", RELIABLE);
    until(|| small.listeners() == 2 && large.listeners() == 2);
    stopped.signal("-STOP");
    also.signal("-STOP");
    let mut longest = Duration::ZERO;
    let mut got = 0;
    for round in 0..200 {
        for (publisher, bytes) in [(&small, 20_000), (&large, if round % 20 == 0 { 4_000_000 } else { 10 })] {
            let begun = Instant::now();
            publisher.publish(&text(bytes)).unwrap();
            longest = longest.max(begun.elapsed());
        }
        sleep(Duration::from_millis(20));
        got += heard.try_iter().count();
    }
    sleep(Duration::from_millis(500));
    got += heard.try_iter().count();
    eprintln!("longest publish {longest:?}, {got} of 200 heard by the other");
    assert!(longest < Duration::from_millis(150), "{longest:?}");
    assert!(got >= 195, "{got} of 200");
    stopped.signal("-CONT");
    also.signal("-CONT");
}

/// Who has come late, is being sent what was kept and stops in the middle of it: as above, and what others tell is heard meanwhile.
#[test]
fn who_comes_late_and_stops_stops_nobody() {
    if let Ok(port) = std::env::var(LATE) {
        return come_late(port.parse().unwrap());
    }
    let port = free_port();
    let mut wire = join(port, "teller");
    let small = wire.advertise(&Topic::new("/small", KIND, RELIABLE)).unwrap();
    let large = wire.advertise(&Topic::new("/large", KIND, KEPT)).unwrap();
    let heard = hear(&mut wire, "/in", RELIABLE);
    large.publish(&text(200_000_000)).unwrap();
    let mut other = join(port, "other");
    let also_heard = hear(&mut other, "/small", RELIABLE);
    let asker = other.advertise(&Topic::new("/in", KIND, RELIABLE)).unwrap();
    until(|| asker.listeners() == 1 && small.listeners() == 1);
    let own = std::env::current_exe().unwrap();
    let mut stopped: Vec<Echo> = (0..3)
        .map(|_| {
            let mut command = Command::new(&own);
            command.args(["--exact", "who_comes_late_and_stops_stops_nobody", "--nocapture"]);
            let child = command.env(LATE, port.to_string()).stdout(Stdio::piped()).spawn().unwrap();
            let mut late = Echo(child);
            let mut lines = BufReader::new(late.0.stdout.as_mut().unwrap()).lines();
            while !lines.next().unwrap().unwrap().ends_with("asks") {}
            sleep(Duration::from_millis(60));
            late.signal("-STOP");
            late
        })
        .collect();
    let (mut longest, mut longest_way) = (Duration::ZERO, Duration::ZERO);
    for round in 0..300 {
        if round % 100 == 50 {
            stopped.pop();
        }
        for publisher in [&small, &large] {
            let begun = Instant::now();
            publisher.publish(&text(round)).unwrap();
            longest = longest.max(begun.elapsed());
        }
        let begun = Instant::now();
        asker.publish(&text(3)).unwrap();
        next(&heard);
        next(&also_heard);
        longest_way = longest_way.max(begun.elapsed());
        if round == 20 {
            let begun = Instant::now();
            let mut another = join(port, "another");
            assert_eq!(next(&hear(&mut another, "/large", KEPT)).len(), text(20).len());
            eprintln!("another joined and got what was kept within {:?}", begun.elapsed());
        }
        sleep(Duration::from_millis(20));
    }
    eprintln!("longest publish {longest:?}, longest way {longest_way:?}");
    assert!(longest < Duration::from_millis(150), "{longest:?}");
    // with one second in which a peer is given up
    assert!(longest_way < Duration::from_secs(3), "{longest_way:?}");
}

const LATE: &str = "MAPWRIGHT_TEST_LATE";

fn come_late(port: u16) {
    let mut wire = join(port, "late");
    let _small = hear(&mut wire, "/small", RELIABLE);
    println!("asks");
    let heard = hear(&mut wire, "/large", KEPT);
    println!("{}", next(&heard).len());
}

/// Who has been stopped for longer than it is waited for and goes on is heard and hears again, be it at the router or beside it.
#[test]
fn who_goes_on_is_met_again() {
    for is_beside in [false, true] {
        let port = free_port();
        let router = is_beside.then(|| join(port, "router"));
        let mut wire = join(port, "teller");
        assert_eq!(wire.is_router(), router.is_none());
        let large = wire.advertise(&Topic::new("/in", KIND, KEPT)).unwrap();
        let heard = hear(&mut wire, "/out", RELIABLE);
        let echo = Echo::start(port, ["/in", "/out"]);
        until(|| large.listeners() == 1);
        echo.signal("-STOP");
        for _ in 0..40 {
            large.publish(&text(1_000_000)).unwrap();
            sleep(Duration::from_millis(200));
        }
        echo.signal("-CONT");
        let begun = Instant::now();
        while !heard.try_iter().any(|bytes| bytes == text(7)) {
            large.publish(&text(7)).unwrap();
            assert!(begun.elapsed() < Duration::from_secs(30), "beside the router: {is_beside}");
            sleep(Duration::from_millis(100));
        }
        eprintln!("beside the router: {is_beside}, met again after {:?}", begun.elapsed());
    }
}

/// A client in Python on Zenoh's own library, and one of hiroz, which is made by others after rmw_zenoh.
#[test]
fn others_hear_tell_and_are_answered() {
    for variable in ["MAPWRIGHT_ZENOH_PYTHON", "MAPWRIGHT_HIROZ_PEER"] {
        let Ok(program) = std::env::var(variable) else {
            eprintln!("others_hear_tell_and_are_answered: skipped: no {variable}");
            continue;
        };
        let port = free_port();
        let _echo = Echo::start(port, ["/in", "/out"]);
        let script = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/peer.py");
        let mut command = Command::new(&program);
        if variable.ends_with("PYTHON") {
            command.arg(script);
        }
        let output = command.arg(port.to_string()).output().unwrap();
        let said = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "{said}{}", String::from_utf8_lossy(&output.stderr));
        assert_eq!(said.lines().last(), Some("20 of 20 messages, 20 of 20 answers, seen once"), "{variable}: {said}");
    }
}

/// [`Publisher`] is what threads share.
#[test]
fn publishers_are_shared_by_threads() {
    let port = free_port();
    let mut wire = join(port, "threads");
    let heard = hear(&mut wire, "/in", RELIABLE);
    let publisher: Box<dyn Publisher> = wire.advertise(&Topic::new("/in", KIND, RELIABLE)).unwrap();
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| (0..25).for_each(|length| publisher.publish(&text(length)).unwrap()));
        }
    });
    (0..100).for_each(|_| drop(next(&heard)));
}
