//! The mapper on one thread, its jobs on another.

use crate::door::{Door, Next};
use crate::gate::{Arrived, Gate, Passed};
use mapwright::{Job, JobResult, Mapper, Update};
use mapwright_ros::messages::{LaserScan, Odometry, TfMessage};
use mapwright_ros::{Channel, Decoder, Encoding, RosError};
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread;
use std::time::Duration;

/// While nothing arrives, scans that wait are looked at so often.
const LOOK_AGAIN: Duration = Duration::from_millis(5);

/// A message as it came, in CDR.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Heard {
    /// `sensor_msgs/LaserScan` of a topic.
    Scan {
        /// Its name.
        topic: String,
        /// The message.
        bytes: Vec<u8>,
    },
    /// `tf2_msgs/TFMessage`.
    Transforms {
        /// The message.
        bytes: Vec<u8>,
        /// Whether they hold for all times.
        is_static: bool,
    },
    /// `nav_msgs/Odometry`.
    Odometry {
        /// The message.
        bytes: Vec<u8>,
    },
    /// Scans of a topic that were overtaken before they came to the door.
    Overtaken {
        /// Its name.
        topic: String,
        /// How many.
        count: u64,
    },
}

/// Decoders of what is heard, and what of it was unreadable beside scans.
#[derive(Debug)]
struct Ears {
    scan: Decoder<LaserScan<'static>>,
    transforms: Decoder<TfMessage<'static>>,
    odometry: Decoder<Odometry<'static>>,
}

impl Ears {
    fn new() -> Result<Self, RosError> {
        let channel = |name: &str| Channel::new(name, Encoding::Cdr, None);
        Ok(Self {
            scan: Decoder::new(&channel("sensor_msgs/msg/LaserScan")?)?,
            transforms: Decoder::new(&channel("tf2_msgs/msg/TFMessage")?)?,
            odometry: Decoder::new(&channel("nav_msgs/msg/Odometry")?)?,
        })
    }

    /// Hands a message on; what is wrong with one that is no scan comes back.
    fn hear(&mut self, heard: &Heard, arrived: Arrived, gate: &mut Gate) -> Result<(), RosError> {
        match heard {
            Heard::Scan { topic, bytes } => match self.scan.decode(bytes) {
                Ok(scan) => gate.hear_scan(topic, &scan, arrived),
                Err(error) => gate.hear_unreadable(topic, &error, arrived),
            },
            Heard::Transforms { bytes, is_static } => {
                return gate.hear_transforms(&self.transforms.decode(bytes)?, *is_static, arrived);
            }
            Heard::Odometry { bytes } => return gate.hear_odometry(&self.odometry.decode(bytes)?, arrived),
            Heard::Overtaken { topic, count } => gate.overtaken(topic, *count),
        }
        Ok(())
    }
}

/// What [`map`] tells while it runs.
#[derive(Debug)]
pub enum Told<'a> {
    /// A scan was mapped, or the result of a job taken in.
    Update(&'a Update),
    /// A message of transforms or odometry was refused.
    Refused(&'a RosError),
}

/// Maps what comes through the door until it is closed and all that waits is mapped. The mapper stays on this thread; what it hands out as jobs
/// (`loops.jobs = "handed-out"`) is done on another, one at a time, and taken in between two scans. `now` tells the time that
/// [`Arrived`] is of, since the start.
///
/// # Errors
/// [`RosError`] where a built-in definition of a message does not fit, which is a fault of this program.
pub fn map(
    door: &Door<(Arrived, Heard)>,
    now: &dyn Fn() -> Duration,
    gate: &mut Gate,
    mapper: &mut Mapper,
    tell: &mut dyn FnMut(Told<'_>, &Mapper),
) -> Result<(), RosError> {
    let mut ears = Ears::new()?;
    let ((jobs, to_do), (done, results)) = (channel::<Job>(), channel::<JobResult>());
    thread::scope(|scope| {
        scope.spawn(move || work(&to_do, &done));
        let mut worker = Worker { jobs, results, is_busy: false };
        loop {
            let next = door.next(LOOK_AGAIN);
            if let Next::Message((arrived, heard)) = &next
                && let Err(error) = ears.hear(heard, *arrived, gate)
            {
                tell(Told::Refused(&error), mapper);
            }
            // What is closed brings no transforms any more.
            let is_over = matches!(next, Next::Closed);
            let by_now = if is_over { Duration::MAX } else { now() };
            while let Some(passed) = gate.next(by_now) {
                take_in(passed, mapper, tell);
                worker.turn(mapper, tell);
            }
            worker.turn(mapper, tell);
            if is_over {
                worker.finish(mapper, tell);
                return;
            }
        }
    });
    Ok(())
}

fn take_in(passed: Passed, mapper: &mut Mapper, tell: &mut dyn FnMut(Told<'_>, &Mapper)) {
    match passed {
        Passed::Odometry(odometry) => mapper.add_odometry(&odometry),
        Passed::Scan(scan) => {
            let update = mapper.add_scan(&scan);
            tell(Told::Update(&update), mapper);
        }
    }
}

/// Does jobs until nobody has any more.
fn work(to_do: &Receiver<Job>, done: &Sender<JobResult>) {
    for job in to_do {
        if done.send(job.run()).is_err() {
            return;
        }
    }
}

/// The other thread, as the mapper's sees it.
struct Worker {
    jobs: Sender<Job>,
    results: Receiver<JobResult>,
    is_busy: bool,
}

impl Worker {
    /// Takes in a result that is there, and hands out the next job.
    fn turn(&mut self, mapper: &mut Mapper, tell: &mut dyn FnMut(Told<'_>, &Mapper)) {
        if self.is_busy {
            match self.results.try_recv() {
                Ok(result) => self.apply(result, mapper, tell),
                Err(TryRecvError::Empty | TryRecvError::Disconnected) => return,
            }
        }
        if let Some(job) = mapper.next_job() {
            self.is_busy = self.jobs.send(job).is_ok();
        }
    }

    /// Until nothing is left to be done.
    fn finish(&mut self, mapper: &mut Mapper, tell: &mut dyn FnMut(Told<'_>, &Mapper)) {
        self.turn(mapper, tell);
        while self.is_busy {
            let Ok(result) = self.results.recv() else { return };
            self.apply(result, mapper, tell);
            self.turn(mapper, tell);
        }
    }

    fn apply(&mut self, result: JobResult, mapper: &mut Mapper, tell: &mut dyn FnMut(Told<'_>, &Mapper)) {
        self.is_busy = false;
        let update = mapper.apply(result);
        tell(Told::Update(&update), mapper);
    }
}

#[cfg(test)]
mod tests;
