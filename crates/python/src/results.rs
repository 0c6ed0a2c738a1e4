//! What a folder of results holds, as arrays.

use crate::arrays::table;
use crate::errors::of_command;
use crate::kind::{Kind, stamps_of, trajectory_rows};
use mapwright::{Session, SpaceSweep, Sweep};
use mapwright_cli::AnySession;
use mapwright_formats::{GridImage, UNKNOWN};
use numpy::{PyArray1, PyArray2};
use pyo3::prelude::*;
use std::path::PathBuf;

/// An occupancy grid.
#[pyclass(frozen, module = "mapwright")]
pub(crate) struct Grid {
    cells: Py<PyArray2<i8>>,
    resolution_m: f64,
    origin: [f64; 3],
}

impl Grid {
    /// Of a map whose cells are free, occupied or unknown.
    pub(crate) fn of(py: Python<'_>, image: GridImage) -> PyResult<Self> {
        let cell = |cell: u8| if cell == UNKNOWN { -1 } else { i8::try_from(cell).unwrap_or(-1) };
        let cells = image.cells.into_iter().map(cell).collect();
        let corner = image.world_from_map;
        Ok(Self {
            cells: table(py, cells, image.width)?.unbind(),
            resolution_m: image.resolution_m,
            origin: [corner.x, corner.y, corner.theta],
        })
    }
}

#[pymethods]
impl Grid {
    /// int8, a row for each y and a column for each x, from the lower left corner on: 0 free, 100 occupied, -1 unknown, as of ROS's
    /// OccupancyGrid.
    #[getter]
    fn cells(&self, py: Python<'_>) -> Py<PyArray2<i8>> {
        self.cells.clone_ref(py)
    }

    /// Side of a cell, metres.
    #[getter]
    fn resolution(&self) -> f64 {
        self.resolution_m
    }

    /// Pose of the lower left corner in the map: x, y, yaw. Metres and radians.
    #[getter]
    fn origin(&self) -> (f64, f64, f64) {
        self.origin.into()
    }

    /// Edges of the map in metres for matplotlib's `imshow(grid.cells, origin="lower", extent=grid.extent)`: left, right, bottom, top.
    #[getter]
    fn extent(&self, py: Python<'_>) -> PyResult<(f64, f64, f64, f64)> {
        let (height, width): (usize, usize) = self.cells.bind(py).getattr("shape")?.extract()?;
        let [x, y, _] = self.origin;
        let [right, top] = [(x, width), (y, height)].map(|(low, cells)| low + cells as f64 * self.resolution_m);
        Ok((x, right, y, top))
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let (height, width): (usize, usize) = self.cells.bind(py).getattr("shape")?.extract()?;
        Ok(format!("Grid(width={width}, height={height}, resolution={})", self.resolution_m))
    }
}

/// The map of a folder of results, or of a YAML as map servers read it.
#[pyfunction]
pub(crate) fn read_grid(py: Python<'_>, path: PathBuf) -> PyResult<Grid> {
    let image = py.detach(|| mapwright_cli::read_grid(&path)).map_err(of_command)?;
    Grid::of(py, image)
}

/// Stamps in nanoseconds, rows of time and pose, and what was lost in words.
type Read<'py> = (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray2<f64>>, Vec<String>);

/// The trajectory of a session: stamps, N; time and pose, N x 4 in the plane and N x 8 in space; and what was lost, in words.
#[pyfunction]
pub(crate) fn read_session(py: Python<'_>, path: PathBuf) -> PyResult<Read<'_>> {
    let read = py.detach(|| {
        let (session, losses) = mapwright_cli::read_session(&path)?;
        Ok((numbers_of(&session), losses))
    });
    let ((stamps, rows, columns), losses) = read.map_err(of_command)?;
    Ok((PyArray1::from_vec(py, stamps), table(py, rows, columns)?, losses))
}

/// Stamps, rows, and how many numbers a row has.
fn numbers_of(session: &AnySession) -> (Vec<i64>, Vec<f64>, usize) {
    fn of<M: Kind>(session: &Session<M>) -> (Vec<i64>, Vec<f64>, usize) {
        (stamps_of(session), trajectory_rows(session), 1 + M::POSE)
    }
    match session {
        AnySession::Plane(session) => of::<Sweep>(session),
        AnySession::Space(session) => of::<SpaceSweep>(session),
    }
}
