//! The mapper on one thread, its jobs on another.

use crate::door::{Door, Next};
use crate::gate::{Arrived, Gate, Passed, Reading};
use mapwright::{Cloud, Job, JobResult, LaserScan, Maps};
use mapwright_ros::messages::{
    Imu as ImuMessage, LaserScan as ScanMessage, Odometry as OdometryMessage, PointCloud2, TfMessage,
};
use mapwright_ros::{Channel, Decoder, Encoding, RosError};
use std::any::Any;
use std::sync::mpsc::{Receiver, Sender, TryRecvError, channel};
use std::thread;
use std::time::Duration;

/// While nothing arrives, scans that wait are looked at so often.
const LOOK_AGAIN: Duration = Duration::from_millis(5);

/// What somebody asks of the driver, who knows what it is.
pub type Asked = Box<dyn Any + Send>;

/// What comes in at the door: messages as they came, in CDR, and what needs no decoding.
#[derive(Debug)]
pub enum Heard {
    /// `sensor_msgs/LaserScan` of a topic.
    Scan {
        /// Its name.
        topic: String,
        /// The message.
        bytes: Vec<u8>,
    },
    /// `sensor_msgs/PointCloud2` of a topic.
    Cloud {
        /// Its name.
        topic: String,
        /// The message.
        bytes: Vec<u8>,
    },
    /// A cloud of a topic that says itself where its sensor sits and where odometry has the robot: of a recording, or of a lidar over the network.
    WholeCloud {
        /// Its name.
        topic: String,
        /// The cloud.
        cloud: Box<Cloud>,
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
    /// Scans or clouds of a topic that were overtaken before they came to the door.
    Overtaken {
        /// Its name.
        topic: String,
        /// How many.
        count: u64,
    },
    /// A scan of a topic that says itself where its laser sits and where odometry has the robot: of a recording, or of a lidar on a cable.
    Whole {
        /// Its name.
        topic: String,
        /// The scan.
        scan: Box<LaserScan>,
    },
    /// `sensor_msgs/Imu`.
    Imu {
        /// The message.
        bytes: Vec<u8>,
    },
    /// A reading that needs no transform.
    Reading(Reading),
    /// Something that is asked of the driver, in its turn.
    Asked(Asked),
}

/// Decoders of what is heard, and what of it was unreadable beside scans.
#[derive(Debug)]
struct Ears {
    scan: Decoder<ScanMessage<'static>>,
    cloud: Decoder<PointCloud2<'static>>,
    transforms: Decoder<TfMessage<'static>>,
    odometry: Decoder<OdometryMessage<'static>>,
    imu: Decoder<ImuMessage<'static>>,
}

impl Ears {
    fn new() -> Result<Self, RosError> {
        let channel = |name: &str| Channel::new(name, Encoding::Cdr, None);
        Ok(Self {
            scan: Decoder::new(&channel("sensor_msgs/msg/LaserScan")?)?,
            cloud: Decoder::new(&channel("sensor_msgs/msg/PointCloud2")?)?,
            transforms: Decoder::new(&channel("tf2_msgs/msg/TFMessage")?)?,
            odometry: Decoder::new(&channel("nav_msgs/msg/Odometry")?)?,
            imu: Decoder::new(&channel("sensor_msgs/msg/Imu")?)?,
        })
    }

    /// Hands a message on; what is wrong with one that is no scan comes back.
    fn hear(&mut self, heard: Heard, arrived: Arrived, gate: &mut Gate) -> Result<(), RosError> {
        match heard {
            Heard::Scan { topic, bytes } => match self.scan.decode(&bytes) {
                Ok(scan) => gate.hear_scan(&topic, &scan, arrived),
                Err(error) => gate.hear_unreadable(&topic, &error, arrived),
            },
            Heard::Cloud { topic, bytes } => match self.cloud.decode(&bytes) {
                Ok(cloud) => gate.hear_cloud(&topic, &cloud, arrived),
                Err(error) => gate.hear_unreadable(&topic, &error, arrived),
            },
            Heard::WholeCloud { topic, cloud } => gate.hear_whole_cloud(&topic, *cloud, arrived),
            Heard::Transforms { bytes, is_static } => {
                return gate.hear_transforms(&self.transforms.decode(&bytes)?, is_static, arrived);
            }
            Heard::Odometry { bytes } => return gate.hear_odometry(&self.odometry.decode(&bytes)?, arrived),
            Heard::Overtaken { topic, count } => gate.overtaken(&topic, count),
            Heard::Whole { topic, scan } => gate.hear_whole(&topic, *scan, arrived),
            Heard::Imu { bytes } => return gate.hear_imu(&self.imu.decode(&bytes)?, arrived),
            Heard::Reading(reading) => gate.hear_reading(reading, arrived),
            Heard::Asked(_) => {}
        }
        Ok(())
    }
}

/// Which results of jobs are taken in now.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Results {
    /// Those that are there.
    Done,
    /// So many, however long they take: as a run that is replayed has taken them in.
    These(usize),
}

/// Who maps what comes through the door, and hears of all that happens meanwhile.
pub trait Driver {
    /// What is mapped: the plane or space.
    type Maps: Maps;

    /// What comes through the gate: scans or clouds, and what is read between them.
    fn add(&mut self, passed: &Passed, gate: &Gate);
    /// The next job to be done beside.
    fn next_job(&mut self) -> Option<Job<Self::Maps>>;
    /// Which results of jobs are taken in now.
    fn results(&mut self) -> Results {
        Results::Done
    }
    /// The result of a job.
    fn apply(&mut self, result: JobResult<Self::Maps>);
    /// A message of transforms, odometry or inertial readings was refused.
    fn refused(&mut self, error: &RosError);
    /// Something that is asked of it.
    fn asked(&mut self, _what: Asked) {}
    /// Called after each message and a few hundred times a second where none comes.
    fn turn(&mut self, _gate: &mut Gate, _now: Duration) {}
}

/// Maps what comes through the door until it is closed and all that waits is mapped. The driver stays on this thread; what it hands out as jobs
/// (`loops.jobs = "handed-out"`) is done on another, one at a time, and taken in between two scans. `now` tells the time that
/// [`Arrived`] is of, since the start.
///
/// # Errors
/// [`RosError`] where a built-in definition of a message does not fit, which is a fault of this program.
pub fn map<M: Maps>(
    door: &Door<(Arrived, Heard)>,
    now: &dyn Fn() -> Duration,
    gate: &mut Gate,
    driver: &mut dyn Driver<Maps = M>,
) -> Result<(), RosError> {
    let mut ears = Ears::new()?;
    let ((jobs, to_do), (done, results)) = (channel::<Job<M>>(), channel::<JobResult<M>>());
    thread::scope(|scope| {
        scope.spawn(move || work(&to_do, &done));
        let mut worker = Worker { jobs, results, is_busy: false };
        loop {
            let next = door.next(LOOK_AGAIN);
            // What is closed brings no transforms any more.
            let is_over = matches!(next, Next::Closed);
            match next {
                Next::Message((_, Heard::Asked(what))) => driver.asked(what),
                Next::Message((arrived, heard)) => {
                    if let Err(error) = ears.hear(heard, arrived, gate) {
                        driver.refused(&error);
                    }
                }
                Next::Nothing | Next::Closed => {}
            }
            let by_now = if is_over { Duration::MAX } else { now() };
            while let Some(passed) = gate.next(by_now) {
                driver.add(&passed, gate);
                worker.turn(driver);
            }
            worker.turn(driver);
            driver.turn(gate, now());
            if is_over {
                worker.finish(driver);
                return;
            }
        }
    });
    Ok(())
}

/// Does jobs until nobody has any more.
fn work<M: Maps>(to_do: &Receiver<Job<M>>, done: &Sender<JobResult<M>>) {
    for job in to_do {
        if done.send(job.run()).is_err() {
            return;
        }
    }
}

/// The other thread, as the mapper's sees it.
struct Worker<M: Maps> {
    jobs: Sender<Job<M>>,
    results: Receiver<JobResult<M>>,
    is_busy: bool,
}

impl<M: Maps> Worker<M> {
    /// Takes in what results are wanted, and hands out the next job.
    fn turn(&mut self, driver: &mut dyn Driver<Maps = M>) {
        match driver.results() {
            Results::Done if self.is_busy => match self.results.try_recv() {
                Ok(result) => self.apply(result, driver),
                Err(TryRecvError::Empty | TryRecvError::Disconnected) => return,
            },
            Results::Done => {}
            Results::These(count) => {
                for _ in 0..count {
                    self.hand_out(driver);
                    self.wait(driver);
                }
            }
        }
        self.hand_out(driver);
    }

    fn hand_out(&mut self, driver: &mut dyn Driver<Maps = M>) {
        if !self.is_busy
            && let Some(job) = driver.next_job()
        {
            self.is_busy = self.jobs.send(job).is_ok();
        }
    }

    /// Takes in the result of what was handed out.
    fn wait(&mut self, driver: &mut dyn Driver<Maps = M>) {
        if std::mem::take(&mut self.is_busy)
            && let Ok(result) = self.results.recv()
        {
            driver.apply(result);
        }
    }

    /// Until nothing is left to be done.
    fn finish(&mut self, driver: &mut dyn Driver<Maps = M>) {
        self.turn(driver);
        while self.is_busy {
            self.wait(driver);
            self.hand_out(driver);
        }
    }

    fn apply(&mut self, result: JobResult<M>, driver: &mut dyn Driver<Maps = M>) {
        self.is_busy = false;
        driver.apply(result);
    }
}

#[cfg(test)]
mod tests;
