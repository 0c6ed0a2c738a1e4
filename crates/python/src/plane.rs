//! The mapper of the plane.

use crate::arrays::{finite, row, stamp};
use crate::mapper::Shared;
use crate::results::Grid;
use crate::settings::of_mapper;
use crate::update::Update;
use mapwright::{LaserModel, LaserScan, Odometry, Pose2, Sweep};
use mapwright_cli::{grid_of, save_plane};
use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

/// What a laser is called that nobody has named.
const LASER: &str = "laser";
const MOUNT: &str = "mount as x, y and yaw of the laser on the robot, metres and radians";
const ODOM: &str = "odom as x, y and yaw of the robot by odometry, metres and radians";

/// A map of the plane, one laser scan at a time.
///
/// `range_max` and `range_min`, metres, are those of the laser: readings outside are no hits. `angle_min` and `angle_increment`,
/// radians, are the bearing of the first beam and the step to the next, counter-clockwise; they can be said with each scan instead.
/// `mount` is where the laser sits on the robot: x, y, yaw. `time_increment` is the time from one beam to the next, seconds.
/// `resume` is a folder of results that is gone on with. Every other keyword is a setting, `map_resolution_m=0.1` for
/// `map.resolution_m`; `mapwright config` lists them.
#[pyclass(frozen, module = "mapwright")]
pub(crate) struct Mapper2 {
    mapper: Shared<Sweep>,
    /// What scans have that say nothing else.
    usual: Usual,
    /// The lasers so far, each as it was last.
    lasers: Mutex<BTreeMap<String, Arc<LaserModel>>>,
}

/// What is known of the laser beforehand.
struct Usual {
    angle_min: Option<f64>,
    angle_increment: Option<f64>,
    range_min: f64,
    range_max: f64,
    mount: Pose2,
    time_increment: f64,
}

#[pymethods]
impl Mapper2 {
    #[new]
    #[pyo3(signature = (*, range_max = None, range_min = 0.0, angle_min = None, angle_increment = None, mount = None,
                        time_increment = 0.0, resume = None, **settings))]
    #[allow(clippy::too_many_arguments, reason = "keywords of Python")]
    fn new(
        range_max: Option<f64>,
        range_min: f64,
        angle_min: Option<f64>,
        angle_increment: Option<f64>,
        mount: Option<&Bound<'_, PyAny>>,
        time_increment: f64,
        resume: Option<PathBuf>,
        settings: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let range_max = range_max.unwrap_or_else(|| LaserModel::half_circle(LASER, 1).range_max_m);
        let mount = pose_of(mount, MOUNT)?.unwrap_or(Pose2::IDENTITY);
        let usual = Usual { angle_min, angle_increment, range_min, range_max, mount, time_increment };
        let angles = [angle_min, angle_increment].map(|angle| angle.or(Some(0.0)));
        usual.laser(LASER, None, angles, 1)?;
        let mapper = Shared::begin(of_mapper(settings)?, resume.as_deref())?;
        Ok(Self { mapper, usual, lasers: Mutex::default() })
    }

    /// Takes in one scan.
    ///
    /// `t` is when its first beam was taken, seconds. `ranges` are metres, one a beam; NaN, infinite and out-of-range ones are no hits.
    /// `odom` is the pose of the robot by odometry then: x, y, yaw; None where there is none. A robot with several lasers names them:
    /// `laser="front"`, each with its `mount` and its bearings.
    #[pyo3(signature = (t, ranges, odom = None, *, angle_min = None, angle_increment = None, mount = None, laser = LASER))]
    #[allow(clippy::too_many_arguments, reason = "keywords of Python")]
    fn add_scan(
        &self,
        py: Python<'_>,
        t: f64,
        ranges: &Bound<'_, PyAny>,
        odom: Option<&Bound<'_, PyAny>>,
        angle_min: Option<f64>,
        angle_increment: Option<f64>,
        mount: Option<&Bound<'_, PyAny>>,
        laser: &str,
    ) -> PyResult<Update> {
        let ranges_m = row(ranges, "ranges in metres")?;
        let mount = pose_of(mount, MOUNT)?;
        let laser = self.usual.laser(laser, mount, [angle_min, angle_increment], ranges_m.len())?;
        let odom_from_robot = pose_of(odom, ODOM)?;
        let scan = LaserScan { stamp: stamp(t)?, laser: self.shared(laser), ranges_m, odom_from_robot };
        self.mapper.with(py, |mapper| Update::of(&mapper.add_scan(&scan)))
    }

    /// Remembers a reading of the wheels, which may come between scans: x, y, yaw by odometry at time `t`, seconds.
    fn add_odometry(&self, py: Python<'_>, t: f64, odom: &Bound<'_, PyAny>) -> PyResult<()> {
        let [x, y, yaw] = finite(odom, ODOM)?;
        let odometry = Odometry { stamp: stamp(t)?, odom_from_robot: Pose2::new(x, y, yaw) };
        self.mapper.with(py, |mapper| mapper.add_odometry(&odometry))
    }

    /// No more scans will come: looks for loop closures once more, by the corrected poses, as `mapwright map` does at a log's end.
    fn finish(&self, py: Python<'_>) -> PyResult<Update> {
        self.mapper.look_again(py)
    }

    /// Every scan's time in seconds and corrected pose, N x 4: t, x, y, yaw.
    fn trajectory<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.mapper.trajectory(py)
    }

    /// Every scan's time in whole nanoseconds.
    fn stamps<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<i64>>> {
        self.mapper.stamps(py)
    }

    /// The map as it is now, drawn from all keyframes.
    fn grid(&self, py: Python<'_>) -> PyResult<Grid> {
        let grid = self.mapper.with(py, |mapper| grid_of(mapper.session()))?;
        Grid::of(py, grid.map_err(crate::errors::of_command)?)
    }

    /// Writes session, trajectory, graph and maps into a folder, under the names that `mapwright map` gives them; the commands of
    /// mapwright read it, and `Mapper2(resume=folder)` goes on with it.
    fn save(&self, py: Python<'_>, folder: PathBuf) -> PyResult<()> {
        self.mapper.save(py, |mapper| save_plane(mapper.session(), &folder))
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let [scans, keyframes] = self.mapper.counts(py)?;
        Ok(format!("<Mapper2 with {scans} scans, {keyframes} keyframes>"))
    }
}

impl Mapper2 {
    /// Scans of one laser share it.
    fn shared(&self, laser: LaserModel) -> Arc<LaserModel> {
        let mut lasers = self.lasers.lock().unwrap_or_else(PoisonError::into_inner);
        match lasers.get(&laser.name) {
            Some(known) if **known == laser => Arc::clone(known),
            _ => {
                let laser = Arc::new(laser);
                lasers.insert(laser.name.clone(), Arc::clone(&laser));
                laser
            }
        }
    }
}

impl Usual {
    /// The laser of a scan, if it can be mapped with.
    fn laser(
        &self,
        name: &str,
        mount: Option<Pose2>,
        [angle_min, angle_increment]: [Option<f64>; 2],
        beams: usize,
    ) -> PyResult<LaserModel> {
        let said = |here: Option<f64>, before: Option<f64>, what: &str| {
            let words = || format!("expected {what} in radians, with the scan or with Mapper2(...), found none");
            here.or(before).ok_or_else(|| PyValueError::new_err(words()))
        };
        let laser = LaserModel {
            name: name.to_owned(),
            angle_min_rad: said(angle_min, self.angle_min, "angle_min")?,
            angle_step_rad: said(angle_increment, self.angle_increment, "angle_increment")?,
            range_min_m: self.range_min,
            range_max_m: self.range_max,
            robot_from_laser: mount.unwrap_or(self.mount),
            inverted: false,
            beam_period_s: self.time_increment,
        };
        laser.check(beams).map_err(|words| PyValueError::new_err(format!("{name}: {words}")))?;
        Ok(laser)
    }
}

fn pose_of(value: Option<&Bound<'_, PyAny>>, expected: &str) -> PyResult<Option<Pose2>> {
    let numbers = value.map(|value| finite(value, expected)).transpose()?;
    Ok(numbers.map(|[x, y, yaw]| Pose2::new(x, y, yaw)))
}
