//! Reading and writing a connection take turns.

#![cfg_attr(not(unix), allow(unused_imports, dead_code, reason = "nothing is begun anew there"))]

use std::env;
use std::process::Command;

/// By which Zenoh is told which of its threads does what.
const RUNTIME: &str = "ZENOH_RUNTIME";
/// What comes in is read by the thread that writes.
const TURNS: &str = "(rx: (handover: tx))";

/// Begins the program anew with Zenoh's reading and writing on one thread, unless its threads were arranged by whoever has started it.
///
/// Zenoh 1.10 reads and writes a TLS connection at the same time without a lock (`LinkUnicastTls`): where one broke, the writing thread
/// at times found the other's half-written error and crashed. Zenoh reads its environment alone, and that of a process is safely set
/// at its beginning only.
pub(super) fn take_turns() {
    #[cfg(unix)]
    if env::var_os(RUNTIME).is_none()
        && let Ok(program) = env::current_exe()
    {
        use std::os::unix::process::CommandExt;
        let mut arguments = env::args_os();
        let name = arguments.next().unwrap_or_else(|| program.clone().into_os_string());
        // It comes back only where that fails: then all goes on as it would have.
        let _ = Command::new(program).arg0(name).args(arguments).env(RUNTIME, TURNS).exec();
    }
}
