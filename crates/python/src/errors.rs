//! Failures as Python's exceptions.

use mapwright_cli::CommandError;
use pyo3::create_exception;
use pyo3::exceptions::{PyRuntimeError, PyValueError};
use pyo3::prelude::*;

create_exception!(mapwright, Error, PyRuntimeError, "Why something was not done, in the words of the command.");

/// Wrong usage is a value that makes no sense; all else is the package's own exception.
pub(crate) fn of_command(error: CommandError) -> PyErr {
    match error {
        CommandError::Usage(words) => PyValueError::new_err(words),
        other => Error::new_err(other.to_string()),
    }
}
