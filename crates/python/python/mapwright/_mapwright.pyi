from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Literal, Optional, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

__version__: str

class Error(RuntimeError):
    """Why something was not done, in the words of the command."""

class Closure:
    """A loop closure: two keyframes of one place."""

    @property
    def earlier(self) -> int:
        """Number of the earlier keyframe."""
    @property
    def later(self) -> int:
        """Number of the later keyframe."""
    @property
    def earlier_from_later(self) -> NDArray[np.float64]:
        """Pose of the later keyframe in the frame of the earlier one."""

class Update:
    """What one scan or cloud led to."""

    @property
    def t(self) -> float:
        """The reading's time, seconds."""
    @property
    def stamp_ns(self) -> int:
        """The reading's time, whole nanoseconds."""
    @property
    def scan(self) -> int:
        """Number of the scan or cloud, from zero."""
    @property
    def pose(self) -> NDArray[np.float64]:
        """Pose of the robot in the map: x, y, yaw; in space x, y, z, qx, qy, qz, qw."""
    @property
    def odom(self) -> NDArray[np.float64]:
        """Pose of the robot by odometry alone; it never jumps."""
    @property
    def covariance(self) -> NDArray[np.float64]:
        """3 x 3, in space 6 x 6, of a right perturbation of the pose, translation first."""
    @property
    def status(self) -> Literal["tracking", "degraded", "lost"]: ...
    @property
    def localisation(self) -> Literal["joined", "apart"]: ...
    @property
    def keyframe(self) -> Optional[int]:
        """Number of the keyframe that this became."""
    @property
    def refused(self) -> Optional[str]:
        """Why the reading was refused as a whole."""
    @property
    def inlier_share(self) -> Optional[float]:
        """Share of what was seen that fits the map, 0 to 1."""
    @property
    def moved(self) -> bool:
        """Whether poses of the past have moved."""
    @property
    def closures(self) -> list[Closure]:
        """The loop closures that were accepted."""

class Grid:
    """An occupancy grid."""

    @property
    def cells(self) -> NDArray[np.int8]:
        """A row for each y and a column for each x, from the lower left corner on: 0 free, 100 occupied, -1 unknown."""
    @property
    def resolution(self) -> float:
        """Side of a cell, metres."""
    @property
    def origin(self) -> tuple[float, float, float]:
        """Pose of the lower left corner in the map: x, y, yaw."""
    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Edges of the map, metres: left, right, bottom, top."""

class Mapper2:
    """A map of the plane, one laser scan at a time."""

    def __new__(
        cls,
        *,
        range_max: Optional[float] = None,
        range_min: float = 0.0,
        angle_min: Optional[float] = None,
        angle_increment: Optional[float] = None,
        mount: Optional[ArrayLike] = None,
        time_increment: float = 0.0,
        resume: Union[str, PathLike[str], None] = None,
        **settings: Union[float, int, bool, str],
    ) -> Mapper2: ...
    def add_scan(
        self,
        t: float,
        ranges: ArrayLike,
        odom: Optional[ArrayLike] = None,
        *,
        angle_min: Optional[float] = None,
        angle_increment: Optional[float] = None,
        mount: Optional[ArrayLike] = None,
        laser: str = "laser",
    ) -> Update: ...
    def add_odometry(self, t: float, odom: ArrayLike) -> None: ...
    def finish(self) -> Update: ...
    def trajectory(self) -> NDArray[np.float64]: ...
    def stamps(self) -> NDArray[np.int64]: ...
    def grid(self) -> Grid: ...
    def save(self, folder: Union[str, PathLike[str]]) -> None: ...

class Mapper3:
    """A map of space, one cloud of points at a time."""

    def __new__(
        cls,
        *,
        sensor: Literal["lidar", "depth camera"] = "lidar",
        range_max: Optional[float] = None,
        range_min: Optional[float] = None,
        range_sigma: Optional[float] = None,
        mount: Optional[ArrayLike] = None,
        resume: Union[str, PathLike[str], None] = None,
        **settings: Union[float, int, bool, str],
    ) -> Mapper3: ...
    def add_cloud(
        self,
        t: float,
        points: ArrayLike,
        times: Optional[ArrayLike] = None,
        *,
        odom: Optional[ArrayLike] = None,
    ) -> Update: ...
    def add_imu(
        self, t: float, gyro: ArrayLike, accel: Optional[ArrayLike] = None
    ) -> Literal["kept", "unsound", "late", "set back"]: ...
    def finish(self) -> Update: ...
    def trajectory(self) -> NDArray[np.float64]: ...
    def stamps(self) -> NDArray[np.int64]: ...
    def points(self) -> NDArray[np.float32]: ...
    def save(self, folder: Union[str, PathLike[str]]) -> None: ...

def map_log(words: Sequence[Union[str, PathLike[str]]], settings: Optional[dict[str, Any]] = None, /) -> Path: ...
def run_command(words: Sequence[str], /) -> int: ...
def read_session(path: Union[str, PathLike[str]]) -> tuple[NDArray[np.int64], NDArray[np.float64], list[str]]: ...
def read_grid(path: Union[str, PathLike[str]]) -> Grid:
    """The map of a folder of results, or of a YAML as map servers read it."""
