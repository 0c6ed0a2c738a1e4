//! The mapper of space.

use crate::arrays::{exactly, finite, points, row, stamp, table};
use crate::mapper::Shared;
use crate::settings::of_mapper;
use crate::update::Update;
use mapwright::{Cloud, ImuReading, ImuTaken, Pose3, SpaceSensor, SpaceSweep};
use mapwright_cli::{points_of, save_space};
use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;
use std::sync::Arc;

const MOUNT: &str = "mount as x, y, z, qx, qy, qz and qw of the sensor on the robot, metres";
const ODOM: &str = "odom as x, y, z, qx, qy, qz and qw of the robot by odometry, metres";
/// Voxels' side where no cloud has told it, metres.
const RESOLUTION_UNTOLD_M: f64 = 1.0;

/// A map of space, one cloud of points at a time.
///
/// `sensor` is "lidar" or "depth camera", which says how far and how well it sees; `range_min`, `range_max` and `range_sigma`, metres,
/// say otherwise. `mount` is where it sits on the robot: x, y, z and a quaternion qx, qy, qz, qw. `resume` is a folder of results that is
/// gone on with. Every other keyword is a setting, `space_resolution_m=0.2` for `space.resolution_m`; `mapwright config` lists them.
#[pyclass(frozen, module = "mapwright")]
pub(crate) struct Mapper3 {
    mapper: Shared<SpaceSweep>,
    sensor: Arc<SpaceSensor>,
}

#[pymethods]
impl Mapper3 {
    #[new]
    #[pyo3(signature = (*, sensor = "lidar", range_max = None, range_min = None, range_sigma = None, mount = None, resume = None,
                        **settings))]
    fn new(
        sensor: &str,
        range_max: Option<f64>,
        range_min: Option<f64>,
        range_sigma: Option<f64>,
        mount: Option<&Bound<'_, PyAny>>,
        resume: Option<PathBuf>,
        settings: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let usual = match sensor {
            "lidar" => SpaceSensor::lidar(sensor),
            "depth camera" => SpaceSensor::depth_camera(sensor),
            other => {
                let words = format!("expected sensor as \"lidar\" or \"depth camera\", found {other:?}");
                return Err(PyValueError::new_err(words));
            }
        };
        let sensor = SpaceSensor {
            range_min_m: range_min.unwrap_or(usual.range_min_m),
            range_max_m: range_max.unwrap_or(usual.range_max_m),
            range_sigma_m: range_sigma.unwrap_or(usual.range_sigma_m),
            robot_from_sensor: pose_of(mount, MOUNT)?.unwrap_or_default(),
            ..usual
        };
        sensor.check().map_err(PyValueError::new_err)?;
        let mapper = Shared::begin(of_mapper(settings)?, resume.as_deref())?;
        Ok(Self { mapper, sensor: Arc::new(sensor) })
    }

    /// Takes in one cloud.
    ///
    /// `t` is when its first point was taken, seconds. `points` are N x 3, metres, in the sensor's frame; NaN where nothing came back.
    /// `times` are N, when each point was taken after `t`, seconds: with them the motion during a sweep is undone. `odom` is the pose of the
    /// robot by odometry at `t`: x, y, z, qx, qy, qz, qw; None where there is none.
    #[pyo3(signature = (t, points, times = None, *, odom = None))]
    fn add_cloud(
        &self,
        py: Python<'_>,
        t: f64,
        points: &Bound<'_, PyAny>,
        times: Option<&Bound<'_, PyAny>>,
        odom: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Update> {
        let points_m = self::points(points, "points in metres")?;
        let times_s = times.map(|times| row(times, "times in seconds")).transpose()?.unwrap_or_default();
        if times.is_some() && times_s.len() != points_m.len() {
            let words = format!("expected a time for each of {} points, found {}", points_m.len(), times_s.len());
            return Err(PyValueError::new_err(words));
        }
        let cloud = Cloud {
            stamp: stamp(t)?,
            sensor: Arc::clone(&self.sensor),
            points_m,
            times_s,
            colours: Vec::new(),
            intensities: Vec::new(),
            sigmas_m: Vec::new(),
            odom_from_robot: pose_of(odom, ODOM)?,
        };
        self.mapper.with(py, |mapper| Update::of(&mapper.add_cloud(&cloud)))
    }

    /// Remembers a reading of an inertial sensor, along the robot's axes: `gyro` in radians a second, `accel` in metres per second squared
    /// (at rest g upwards) or None. Hand in what was read before the end of a sweep before its cloud. Returns what became of it: "kept",
    /// "unsound", "late" or "set back".
    #[pyo3(signature = (t, gyro, accel = None))]
    fn add_imu(
        &self,
        py: Python<'_>,
        t: f64,
        gyro: &Bound<'_, PyAny>,
        accel: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<&'static str> {
        let turn_rate = exactly::<3>(gyro, "gyro as three turn rates, radians a second")?;
        let force = accel.map(|accel| exactly::<3>(accel, "accel as three accelerations, metres per second squared"));
        let reading = ImuReading {
            stamp: stamp(t)?,
            turn_rate_rad_per_s: turn_rate.into(),
            specific_force_m_per_s2: force.transpose()?.map(Into::into),
        };
        let taken = self.mapper.with(py, |mapper| mapper.add_imu(reading))?;
        Ok(match taken {
            ImuTaken::Kept => "kept",
            ImuTaken::Unsound => "unsound",
            ImuTaken::Late => "late",
            ImuTaken::SetBack => "set back",
        })
    }

    /// No more clouds will come: looks for loop closures once more, by the corrected poses, as `mapwright map` does at a log's end.
    fn finish(&self, py: Python<'_>) -> PyResult<Update> {
        self.mapper.look_again(py)
    }

    /// Every cloud's time in seconds and corrected pose, N x 8: t, x, y, z, qx, qy, qz, qw.
    fn trajectory<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.mapper.trajectory(py)
    }

    /// Every cloud's time in whole nanoseconds.
    fn stamps<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<i64>>> {
        self.mapper.stamps(py)
    }

    /// The map's points as they lie now, N x 3, metres: those of all keyframes, one for each tenth of the smallest voxels.
    fn points<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let points_m = self.mapper.with(py, |mapper| {
            let resolution_m = mapper.resolution_m().unwrap_or(RESOLUTION_UNTOLD_M);
            points_of(mapper.session(), resolution_m)
        })?;
        table(py, points_m.into_flattened(), 3)
    }

    /// Writes session, trajectory, graph and points into a folder, under the names that `mapwright map` gives them; the commands of
    /// mapwright read it, and `Mapper3(resume=folder)` goes on with it.
    fn save(&self, py: Python<'_>, folder: PathBuf) -> PyResult<()> {
        self.mapper.save(py, |mapper| {
            let resolution_m = mapper.resolution_m().unwrap_or(RESOLUTION_UNTOLD_M);
            save_space(mapper.session(), resolution_m, &folder)
        })
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        let [clouds, keyframes] = self.mapper.counts(py)?;
        Ok(format!("<Mapper3 with {clouds} clouds, {keyframes} keyframes>"))
    }
}

fn pose_of(value: Option<&Bound<'_, PyAny>>, expected: &str) -> PyResult<Option<Pose3>> {
    let Some(value) = value else { return Ok(None) };
    let [x, y, z, qx, qy, qz, qw] = finite(value, expected)?;
    let pose = Pose3::from_quaternion([x, y, z], [qx, qy, qz, qw]);
    let words = || format!("expected {expected}, found a quaternion of length zero");
    pose.map(Some).ok_or_else(|| PyValueError::new_err(words()))
}
