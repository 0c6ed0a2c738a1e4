//! A lidar of space on the network.

use super::cable::{TOPIC, Words};
use super::clock::Clock;
use super::{Entrance, Lanes};
use crate::failure::Failure;
use mapwright::{ImuReading, Pose2, SpaceReading, SpaceSensor};
use mapwright_lidars::{LidarPlace, Udp};
use mapwright_live::outgoing::in_space;
use mapwright_live::{Heard, Reading};
use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

/// Where none is there it is looked again after so long.
const WAIT: Duration = Duration::from_millis(1);
/// An address that is not there is looked for as often.
const AGAIN: Duration = Duration::from_secs(1);
/// After so long without a datagram it is said.
const SILENCE: Duration = Duration::from_secs(3);
/// No datagram is longer, bytes.
const LONGEST: usize = 1 << 16;

/// What a lidar says of itself, from a file.
pub(super) fn metadata(path: &Path) -> Result<String, Failure> {
    let text = std::fs::read_to_string(path).map_err(|error| Failure::open(path, error))?;
    // What is wrong with it is said before anything is begun.
    Udp::ouster(&text).map_err(|error| Failure::Config { path: path.to_owned(), cause: error.to_string() })?;
    Ok(text)
}

/// Reads the lidar until it is over, through cables that are pulled out and put back.
pub(super) fn read(
    place: &LidarPlace,
    metadata: Option<String>,
    robot_from_lidar: Pose2,
    (door, lanes): (&Entrance, &Lanes),
    clock: &Clock,
    (words, over): (&Words, &AtomicBool),
) {
    let udp = metadata.and_then(|text| Udp::ouster(&text).ok()).unwrap_or_default();
    let mut line = Line { udp, robot_from_lidar, sensor: None, problem: None, is_silent: false };
    let mut trouble: Option<String> = None;
    while !over.load(Ordering::Acquire) {
        let result = open(place).and_then(|sockets| {
            let said: Vec<String> =
                sockets.iter().filter_map(|socket| Some(socket.local_addr().ok()?.to_string())).collect();
            words.say(format!("datagrams are heard at {}", said.join(" and ")));
            trouble = None;
            line.read(&sockets, (door, lanes), clock, (words, over))
        });
        let Err(error) = result else { return };
        let said = format!("{}: {error}; it is tried every second", place.place);
        if trouble.as_ref() != Some(&said) {
            words.say(said.clone());
            trouble = Some(said);
        }
        thread::sleep(AGAIN);
    }
}

/// The port that was named, or a whole address, and where the lidar has a second port the next one.
fn open(place: &LidarPlace) -> io::Result<Vec<UdpSocket>> {
    let wrong = || {
        let expected = "expected a port or an address and a port, such as 2368 or 0.0.0.0:2368";
        io::Error::new(io::ErrorKind::InvalidInput, format!("{expected}, found {}", place.place))
    };
    let address: SocketAddr = match place.place.parse() {
        Ok(address) => address,
        Err(_) => ([0, 0, 0, 0], place.place.parse().map_err(|_| wrong())?).into(),
    };
    let ports = (0..).take(place.kind.udp_ports().len().max(1)).filter_map(|k| address.port().checked_add(k));
    ports
        .map(|port| {
            let socket = UdpSocket::bind(SocketAddr::new(address.ip(), port))?;
            socket.set_nonblocking(true)?;
            Ok(socket)
        })
        .collect()
}

struct Line {
    udp: Udp,
    robot_from_lidar: Pose2,
    /// The sensor where it sits.
    sensor: Option<Arc<SpaceSensor>>,
    /// What was wrong when it was said last.
    problem: Option<String>,
    is_silent: bool,
}

impl Line {
    fn read(
        &mut self,
        sockets: &[UdpSocket],
        (door, lanes): (&Entrance, &Lanes),
        clock: &Clock,
        (words, over): (&Words, &AtomicBool),
    ) -> io::Result<()> {
        let mut bytes = vec![0; LONGEST];
        let mut last = clock.since_start();
        while !over.load(Ordering::Acquire) {
            let mut is_idle = true;
            for socket in sockets {
                match socket.recv(&mut bytes) {
                    Ok(count) => {
                        self.udp.receive(&bytes[..count], clock.arrived().stamp);
                        is_idle = false;
                    }
                    Err(error) if matches!(error.kind(), io::ErrorKind::WouldBlock | io::ErrorKind::Interrupted) => {}
                    Err(error) => return Err(error),
                }
            }
            let now = clock.since_start();
            if is_idle {
                self.silence(now.saturating_sub(last), words);
                thread::sleep(WAIT);
                continue;
            }
            last = now;
            self.is_silent = false;
            while let Some(reading) = self.udp.next_reading() {
                let heard = Heard::Reading(Reading::InSpace(SpaceReading::Imu(self.turned(reading))));
                door.put(lanes.others(), (clock.arrived(), heard));
            }
            while let Some(mut cloud) = self.udp.next_cloud() {
                cloud.sensor = self.placed(&cloud.sensor);
                let heard = Heard::WholeCloud { topic: TOPIC.to_owned(), cloud: Box::new(cloud) };
                door.put(lanes.of_scan(TOPIC), (clock.arrived(), heard));
            }
            let problem = self.udp.problem().map(str::to_owned);
            if problem != self.problem {
                problem.iter().for_each(|problem| words.say(problem.clone()));
                self.problem = problem;
            }
        }
        Ok(())
    }

    fn silence(&mut self, silent: Duration, words: &Words) {
        if silent >= SILENCE && !self.is_silent {
            words.say(format!("no datagram for {} s", SILENCE.as_secs()));
            self.is_silent = true;
            self.udp.restart();
        }
    }

    fn placed(&mut self, sensor: &Arc<SpaceSensor>) -> Arc<SpaceSensor> {
        let place = in_space(self.robot_from_lidar);
        let is_known = |known: &Arc<SpaceSensor>| known.name == sensor.name && known.range_max_m == sensor.range_max_m;
        match &self.sensor {
            Some(known) if is_known(known) => Arc::clone(known),
            _ => {
                let made = Arc::new(SpaceSensor { robot_from_sensor: place, ..SpaceSensor::clone(sensor) });
                Arc::clone(self.sensor.insert(made))
            }
        }
    }

    /// A reading in the lidar's frame, in the robot's.
    fn turned(&self, reading: ImuReading) -> ImuReading {
        let rotation = in_space(self.robot_from_lidar).rotation;
        ImuReading {
            turn_rate_rad_per_s: rotation * reading.turn_rate_rad_per_s,
            specific_force_m_per_s2: reading.specific_force_m_per_s2.map(|force| rotation * force),
            ..reading
        }
    }
}
