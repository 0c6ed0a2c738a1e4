//! Worlds on several threads, their results in order.

use crate::events::{Ending, Interrupt};
use crate::failure::Failure;
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::mpsc;

/// Works on every seed and hands the results on in the order of the seeds, each as soon as those before it are there.
///
/// Ends with the first failure of either in that order, or with an interrupt.
pub(super) fn in_order<R: Send>(
    seeds: Range<u64>,
    threads: u32,
    interrupt: &Interrupt,
    work: impl Fn(u64) -> Result<R, Failure> + Sync,
    mut take: impl FnMut(R) -> Result<(), Failure>,
) -> Result<Ending, Failure> {
    let (next, stopped) = (AtomicU64::new(seeds.start), AtomicBool::new(false));
    let mut wanted = seeds.start;
    let taken = std::thread::scope(|scope| {
        let (sender, results) = mpsc::channel();
        for _ in 0..threads {
            let (sender, next, stopped, work) = (sender.clone(), &next, &stopped, &work);
            scope.spawn(move || {
                while !stopped.load(Ordering::Relaxed) && !interrupt.came() {
                    let seed = next.fetch_add(1, Ordering::Relaxed);
                    if seed >= seeds.end || sender.send((seed, work(seed))).is_err() {
                        break;
                    }
                }
            });
        }
        drop(sender);
        let mut early = BTreeMap::new();
        for (seed, result) in results {
            early.insert(seed, result);
            while let Some(result) = early.remove(&wanted) {
                if let Err(failure) = result.and_then(&mut take) {
                    stopped.store(true, Ordering::Relaxed);
                    return Err(failure);
                }
                wanted += 1;
            }
        }
        Ok(())
    });
    taken?;
    Ok(if wanted < seeds.end { Ending::Interrupted } else { Ending::OfLog })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests may")]
mod tests {
    use super::*;

    #[test]
    fn results_come_in_order_whatever_the_threads() {
        let interrupt = Interrupt::watch().unwrap();
        for threads in [1, 4] {
            let mut taken = Vec::new();
            let slow = |seed: u64| {
                std::thread::sleep(std::time::Duration::from_millis((7 - seed) % 3));
                Ok(seed)
            };
            let ending = in_order(3..7, threads, &interrupt, slow, |seed| {
                taken.push(seed);
                Ok(())
            });
            assert_eq!((ending.unwrap(), taken), (Ending::OfLog, vec![3, 4, 5, 6]));
        }
        let fails = |seed: u64| if seed == 5 { Err(Failure::open("five".as_ref(), "no")) } else { Ok(seed) };
        let failed = in_order(0..1000, 2, &interrupt, fails, |_| Ok(()));
        assert!(failed.unwrap_err().to_string().contains("five"));
    }
}
