//! The command in this process.

use crate::errors::{Error, of_command};
use crate::settings::pairs;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::ffi::OsString;
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::thread;
use std::time::Duration;

/// How often Python is asked whether a signal has come.
const ASK_EVERY: Duration = Duration::from_millis(50);
/// The stack that a process's first thread has, on which the command runs.
const STACK_BYTES: usize = 8 << 20;

/// Maps as the command `mapwright map` does with these words; returns the folder of results.
#[pyfunction]
#[pyo3(signature = (words, settings = None, /))]
pub(crate) fn map_log(py: Python<'_>, words: Vec<OsString>, settings: Option<&Bound<'_, PyDict>>) -> PyResult<PathBuf> {
    let mut all = Vec::new();
    for (key, text) in pairs(settings)? {
        all.extend(["--set".into(), format!("{key}={text}").into()]);
    }
    all.extend(words);
    py.detach(|| map_while_asking(all))
}

/// Maps on a thread of its own, and asks Python for signals meanwhile: its handlers are the program's, Ctrl-C is `KeyboardInterrupt`.
fn map_while_asking(words: Vec<OsString>) -> PyResult<PathBuf> {
    let stop = Arc::new(AtomicBool::new(false));
    let told = Arc::clone(&stop);
    let (done, is_done) = channel::<()>();
    let worker = thread::Builder::new().name("mapwright".to_owned()).stack_size(STACK_BYTES).spawn(move || {
        let _done = done; // hung up when all is done, however it ends
        mapwright_cli::map(words, told)
    })?;
    let mut raised = None;
    while is_done.recv_timeout(ASK_EVERY) == Err(RecvTimeoutError::Timeout) {
        if raised.is_none() {
            raised = Python::attach(|py| py.check_signals()).err();
            stop.store(raised.is_some(), Ordering::Relaxed);
        }
    }
    let mapped = worker.join();
    match (raised, mapped) {
        (Some(signal), _) => Err(signal),
        (None, Ok(mapped)) => mapped.map_err(of_command),
        (None, Err(_)) => Err(Error::new_err("mapping ended in a panic, which is a fault of mapwright")),
    }
}

/// Runs a command line, its first word the command's name; returns what the process should end with.
#[pyfunction]
#[pyo3(signature = (words, /))]
pub(crate) fn run_command(py: Python<'_>, words: Vec<OsString>) -> u8 {
    py.detach(|| mapwright_cli::run_command(words))
}
