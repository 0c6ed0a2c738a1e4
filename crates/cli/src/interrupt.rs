//! Ctrl-C.

use crate::failure::Failure;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Exit code of a process that a second Ctrl-C ends at once.
const KILLED_BY_INTERRUPT: i32 = 130;

/// Ctrl-C (or a request to terminate, or a terminal that is gone): the first asks to stop, the second ends the process at once.
pub(crate) struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    pub(crate) fn watch() -> Result<Self, Failure> {
        let asked = Arc::new(AtomicBool::new(false));
        for signal in [SIGINT, SIGTERM, SIGHUP] {
            flag::register_conditional_shutdown(signal, KILLED_BY_INTERRUPT, Arc::clone(&asked))
                .and_then(|_| flag::register(signal, Arc::clone(&asked)))
                .map_err(Failure::Signals)?;
        }
        Ok(Self(asked))
    }

    /// One that never comes.
    pub(crate) fn of_none() -> Self {
        Self(Arc::default())
    }

    /// One that comes when somebody else, who handles the process's signals, says so.
    pub(crate) fn told_by(asked: Arc<AtomicBool>) -> Self {
        Self(asked)
    }

    pub(crate) fn came(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }
}
