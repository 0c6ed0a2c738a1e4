//! What both mappers have in common.

use crate::arrays::table;
use crate::errors::{Error, of_command};
use crate::kind::{Kind, stamps_of, trajectory_rows};
use crate::update::Update;
use mapwright::{MapperOf, Settings};
use mapwright_cli::{CommandError, read_session};
use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use std::path::Path;
use std::sync::Mutex;

/// A mapper that threads of Python share: one at a time has it, and none waits with Python's lock.
pub(crate) struct Shared<M: Kind>(Mutex<MapperOf<M>>);

impl<M: Kind> Shared<M>
where
    MapperOf<M>: Send,
{
    /// A new mapper, or one that goes on with the session of a folder of results.
    pub(crate) fn begin(settings: Settings, resume: Option<&Path>) -> PyResult<Self> {
        let wrong = |error: mapwright::SettingsError| PyValueError::new_err(error.to_string());
        let mapper = match resume {
            None => MapperOf::new(settings).map_err(wrong)?,
            Some(path) => {
                let (session, _) = read_session(path).map_err(of_command)?;
                let session = M::session(session).ok_or_else(|| {
                    let words = "expected a session of this mapper's kind, the plane or space, found one of the other";
                    PyValueError::new_err(format!("{}: {words}", path.display()))
                })?;
                MapperOf::resume(settings, session).map_err(wrong)?
            }
        };
        Ok(Self(Mutex::new(mapper)))
    }

    /// Does something with it, without Python's lock.
    pub(crate) fn with<R: Send>(&self, py: Python<'_>, work: impl FnOnce(&mut MapperOf<M>) -> R + Send) -> PyResult<R> {
        py.detach(|| {
            let mut mapper = self.0.lock().map_err(|_| {
                Error::new_err("this mapper cannot go on: it has panicked, which is a fault of mapwright")
            })?;
            Ok(work(&mut mapper))
        })
    }

    pub(crate) fn look_again(&self, py: Python<'_>) -> PyResult<Update> {
        self.with(py, |mapper| Update::of(&mapper.look_again()))
    }

    /// Every pose, each behind its time in seconds.
    pub(crate) fn trajectory<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let rows = self.with(py, |mapper| trajectory_rows(mapper.session()))?;
        table(py, rows, 1 + M::POSE)
    }

    pub(crate) fn stamps<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let stamps = self.with(py, |mapper| stamps_of(mapper.session()))?;
        Ok(PyArray1::from_vec(py, stamps))
    }

    /// Scans or clouds, and keyframes.
    pub(crate) fn counts(&self, py: Python<'_>) -> PyResult<[usize; 2]> {
        self.with(py, |mapper| [mapper.session().scans().len(), mapper.keyframes().len()])
    }

    /// Writes files, with all that a mapper needs that goes on with them.
    pub(crate) fn save(
        &self,
        py: Python<'_>,
        write: impl FnOnce(&MapperOf<M>) -> Result<(), CommandError> + Send,
    ) -> PyResult<()> {
        let written = self.with(py, |mapper| {
            mapper.checkpoint();
            write(mapper)
        })?;
        written.map_err(of_command)
    }
}
