//! A lidar on a cable.

use super::clock::Clock;
use super::{Entrance, Lanes};
use mapwright::Pose2;
use mapwright_lidars::{Fan, Lidar, LidarPlace, Request};
use mapwright_live::Heard;
use serial2::SerialPort;
use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::Duration;

/// What its scans are called.
pub(super) const TOPIC: &str = "lidar";
/// A read waits so long at most: requests are looked at as often.
const WAIT: Duration = Duration::from_millis(50);
/// A port that is not there is looked for as often.
const AGAIN: Duration = Duration::from_secs(1);

/// What happens at the cable, in words, for whoever says it.
#[derive(Debug, Default)]
pub(super) struct Words(Mutex<Vec<String>>);

impl Words {
    pub(super) fn take(&self) -> Vec<String> {
        std::mem::take(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }

    pub(super) fn say(&self, words: String) {
        let mut all = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if all.len() < 100 {
            all.push(words);
        }
    }
}

/// Reads the lidar until it is over, through cables that are pulled out and put back.
pub(super) fn read(
    place: &LidarPlace,
    robot_from_laser: Pose2,
    (door, lanes): (&Entrance, &Lanes),
    clock: &Clock,
    (words, over): (&Words, &AtomicBool),
) {
    let mut cable = Cable {
        place,
        lidar: Lidar::new(place.kind),
        fan: Fan::new(TOPIC, robot_from_laser, place.kind.ranges_m()),
        problem: None,
    };
    let mut trouble: Option<String> = None;
    while !over.load(Ordering::Acquire) {
        let result = cable.open().and_then(|port| {
            words.say(format!("{} is open at {} baud", place.place, place.baud));
            trouble = None;
            cable.read(&port, (door, lanes), clock, (words, over))
        });
        let Err(error) = result else { return };
        let said = format!("{}: {error}; it is looked for every second", place.place);
        if trouble.as_ref() != Some(&said) {
            words.say(said.clone());
            trouble = Some(said);
        }
        cable.lidar.restart();
        thread::sleep(AGAIN);
    }
}

struct Cable<'a> {
    place: &'a LidarPlace,
    lidar: Lidar,
    fan: Fan,
    /// What was wrong when it was said last.
    problem: Option<String>,
}

impl Cable<'_> {
    fn open(&self) -> io::Result<SerialPort> {
        let mut port = SerialPort::open(&self.place.place, self.place.baud)?;
        port.set_read_timeout(WAIT)?;
        Ok(port)
    }

    fn read(
        &mut self,
        port: &SerialPort,
        (door, lanes): (&Entrance, &Lanes),
        clock: &Clock,
        (words, over): (&Words, &AtomicBool),
    ) -> io::Result<()> {
        let mut bytes = [0; 4096];
        while !over.load(Ordering::Acquire) {
            let now = clock.arrived().stamp;
            while let Some(request) = self.lidar.next_request(now) {
                send(port, &request)?;
            }
            match port.read(&mut bytes) {
                Ok(0) => return Err(io::ErrorKind::UnexpectedEof.into()),
                Ok(count) => self.lidar.receive(&bytes[..count], clock.arrived().stamp),
                Err(error) if error.kind() == io::ErrorKind::TimedOut => {}
                Err(error) => return Err(error),
            }
            while let Some(revolution) = self.lidar.next_scan() {
                let heard = Heard::Whole { topic: TOPIC.to_owned(), scan: Box::new(self.fan.scan(&revolution)) };
                door.put(lanes.of_scan(TOPIC), (clock.arrived(), heard));
            }
            let problem = self.lidar.problem().map(str::to_owned);
            if problem != self.problem {
                problem.iter().for_each(|problem| words.say(format!("{}: {problem}", self.place.place)));
                self.problem = problem;
            }
        }
        // It goes on turning where the cable is gone.
        self.lidar.last_requests().iter().try_for_each(|request| send(port, request))
    }
}

fn send(port: &SerialPort, request: &Request) -> io::Result<()> {
    match request {
        Request::Bytes(bytes) => port.write_all(bytes),
        // A pseudo-terminal has no such line.
        Request::Dtr(level) => {
            let _ = port.set_dtr(*level);
            Ok(())
        }
    }
}
