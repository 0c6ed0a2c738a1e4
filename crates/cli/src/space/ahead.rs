//! Clouds that are read, or matched of two images, on a thread of their own while those before them are mapped.

use super::source::Source;
use crate::failure::Failure;
use mapwright::{Cloud, SpaceReading};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};

/// More clouds do not wait, whatever the threads: the thread that reads is as far ahead with a few, and each may take megabytes.
const WAITING_AT_MOST: usize = 8;

/// What a source has next: the readings before a cloud and the cloud, or the end.
type Next = Result<(Vec<SpaceReading>, Option<Cloud>), Failure>;

/// Hands out clouds in their order, each with the readings before it.
pub(super) struct Ahead<'s, 'a> {
    from: Whence<'s, 'a>,
    /// How many were.
    handed_out: usize,
}

enum Whence<'s, 'a> {
    /// Each is read as it is asked for.
    Source(&'s mut Source<'a>),
    /// Another thread reads.
    Queue(Receiver<Next>),
}

impl Ahead<'_, '_> {
    /// The next cloud; none at the end. Readings that come before it are added to those that are there.
    pub(super) fn next_cloud(&mut self, readings: &mut Vec<SpaceReading>) -> Result<Option<Cloud>, Failure> {
        let cloud = match &mut self.from {
            Whence::Source(source) => source.next_cloud(&mut |reading| readings.push(reading))?,
            Whence::Queue(queue) => {
                // nothing follows the end
                let Ok(next) = queue.recv() else { return Ok(None) };
                let (before, cloud) = next?;
                readings.extend(before);
                cloud
            }
        };
        self.handed_out += usize::from(cloud.is_some());
        Ok(cloud)
    }
}

/// Lets `map` ask for the clouds of a source, which another thread reads ahead where there may be two. That thread has ended when this
/// returns; what it has read for nobody is forgotten, but for what was wrong with it.
pub(super) fn read_ahead<T>(
    source: &mut Source<'_>,
    threads: u32,
    map: impl FnOnce(&mut Ahead<'_, '_>) -> Result<T, Failure>,
) -> Result<T, Failure> {
    if threads < 2 {
        return map(&mut Ahead { from: Whence::Source(source), handed_out: 0 });
    }
    let reads = &mut *source;
    let (mapped, handed_out) = std::thread::scope(|scope| {
        let (sender, queue) = sync_channel((threads as usize - 1).min(WAITING_AT_MOST));
        scope.spawn(move || fill(reads, &sender));
        let mut ahead = Ahead { from: Whence::Queue(queue), handed_out: 0 };
        let mapped = map(&mut ahead);
        // with the queue, which is dropped here, ends who fills it
        (mapped, ahead.handed_out)
    });
    source.forget_after(handed_out);
    mapped
}

/// Reads until the end, an error, or nobody asks any more.
fn fill(source: &mut Source<'_>, sender: &SyncSender<Next>) {
    loop {
        let mut before = Vec::new();
        let next = source.next_cloud(&mut |reading| before.push(reading)).map(|cloud| (before, cloud));
        let is_last = !matches!(next, Ok((_, Some(_))));
        if sender.send(next).is_err() || is_last {
            return;
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may")]
mod tests {
    use super::*;
    use crate::space::Simulation;
    use mapwright::Stamp;
    use mapwright_sim::space::{LidarSettings, SpaceDrive, SpaceDriveSettings, worlds};

    fn source() -> Source<'static> {
        let lidar = LidarSettings { columns: 16, ..LidarSettings::spinning(2) };
        let settings = SpaceDriveSettings { lidar, duration_s: 2.0, ..SpaceDriveSettings::default() };
        let drive = SpaceDrive::new(worlds::two_storey(1).into(), settings);
        Source::Simulated(Box::new(Simulation::of(drive, 1).with_imu()))
    }

    /// How many readings and which cloud, up to so many and how many the source knows of then.
    fn asked(threads: u32, most: usize) -> (Vec<(usize, Option<Stamp>)>, usize) {
        let mut source = source();
        let found = read_ahead(&mut source, threads, |clouds| {
            let next = |_| {
                let mut readings = Vec::new();
                let cloud = clouds.next_cloud(&mut readings).unwrap();
                (readings.len(), cloud.map(|cloud| cloud.stamp))
            };
            Ok((0..most).map(next).collect())
        });
        (found.unwrap(), source.simulation().unwrap().clouds_taken())
    }

    #[test]
    fn clouds_come_in_order_whatever_the_threads_and_end_where_nobody_asks() {
        let (all, known) = asked(1, 30);
        assert!(all[0].0 > 0 && all[0].1.is_some() && all[29].1.is_none() && (5..30).contains(&known), "{known}");
        for threads in [2, 3, 1024] {
            assert_eq!(asked(threads, 30), (all.clone(), known));
            assert_eq!(asked(threads, 3), (all[..3].to_vec(), 3));
            assert_eq!(asked(threads, 0), (Vec::new(), 0));
        }
    }

    #[test]
    fn who_fails_is_not_waited_for() {
        let refused = || Failure::Log("enough".to_owned());
        let failed =
            read_ahead(&mut source(), 2, |clouds| clouds.next_cloud(&mut Vec::new()).and(Err::<(), _>(refused())));
        assert_eq!(failed.unwrap_err().to_string(), refused().to_string());
    }
}
