"""2D lidar SLAM and 3D mapping.

    import mapwright as mw

    run = mw.map("drive.mcap")            # what the command `mapwright map` does, to the same bytes
    run.verdict, run.trajectory, run.grid

    mapper = mw.Mapper2(range_max=30.0, angle_min=-1.57, angle_increment=0.0087)
    update = mapper.add_scan(t, ranges, odom=(x, y, yaw))     # one reading at a time
    update.pose, update.status, mapper.grid()

Metres, seconds and radians throughout. Python's lock is released while anything is mapped.
"""

from __future__ import annotations

import functools
import json
import os
import pathlib
import shutil
import signal
import sys
import tempfile
import threading
import weakref
from collections.abc import Iterable, Sequence
from typing import Any, Union

import numpy as np

from . import _mapwright
from ._mapwright import Closure, Error, Grid, Mapper2, Mapper3, Update, __version__, read_grid

__all__ = ["Closure", "Error", "Grid", "Mapper2", "Mapper3", "Run", "Update", "main", "map", "read_grid"]

Path = Union[str, "os.PathLike[str]"]


class Run:
    """A folder of results, of `mapwright.map` or of the command `mapwright map`."""

    def __init__(self, folder: Path) -> None:
        self._folder = pathlib.Path(folder)
        self._remove: weakref.finalize | None = None
        if not (self._folder / "session.mapwright").is_file():
            raise Error(f"{self._folder}: expected a folder of results, found no session.mapwright in it")

    @property
    def folder(self) -> pathlib.Path:
        """Where the files are. Unless a folder was asked for it is a temporary one, and goes with this object."""
        return self._folder

    @functools.cached_property
    def report(self) -> dict[str, Any]:
        """All of report.json: what was read, used, lost, found, and how well it fits."""
        path = self._folder / "report.json"
        try:
            return json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise Error(f"{path}: there is no report, which `mapwright map` writes") from None

    @property
    def verdict(self) -> str:
        """Whether the map can be used: "good", "check" or "unusable"."""
        return self.report["verdict"]["word"]

    @property
    def warnings(self) -> list[str]:
        """What was lost, and why the verdict is not good; empty where all went well."""
        return list(self.report["losses"])

    @functools.cached_property
    def _session(self) -> tuple[np.ndarray, np.ndarray, list[str]]:
        return _mapwright.read_session(self._folder)

    @property
    def trajectory(self) -> np.ndarray:
        """Time and pose of each scan, float64: N x 4 (t, x, y, yaw) in the plane, N x 8 (t, x, y, z, qx, qy, qz, qw) in space."""
        return self._session[1]

    @property
    def stamps(self) -> np.ndarray:
        """Time of each scan in whole nanoseconds, int64."""
        return self._session[0]

    @functools.cached_property
    def grid(self) -> Grid:
        """The map of the plane, as map.pgm has it."""
        return read_grid(self._of_plane("map.yaml"))

    @functools.cached_property
    def points(self) -> np.ndarray:
        """The points of the map of space, N x 3, float32, as map.ply has them."""
        path = self._folder / "map.ply"
        if not path.is_file():
            raise Error(f"{self._folder}: expected a map of space, found one of the plane: it has a grid")
        return _points_of(path)

    def _of_plane(self, name: str) -> pathlib.Path:
        path = self._folder / name
        if not path.is_file():
            raise Error(f"{self._folder}: expected a map of the plane, found one of space: it has points")
        return path

    def save(self, folder: Path) -> pathlib.Path:
        """Copies all files into a folder, which is made if need be, and returns it."""
        target = pathlib.Path(folder)
        if not (target.exists() and target.samefile(self._folder)):
            shutil.copytree(self._folder, target, dirs_exist_ok=True)
        return target

    def __repr__(self) -> str:
        return f"<Run {self._folder}: {len(self.stamps)} scans, verdict {self.verdict}>"


def _points_of(path: pathlib.Path) -> np.ndarray:
    """Coordinates of a PLY that mapwright has written: binary, float coordinates first."""
    types = {"float": "<f4", "uchar": "u1"}
    with path.open("rb") as file:
        count, fields = 0, []
        for line in iter(file.readline, b""):
            words = line.decode("ascii").split()
            if words[:2] == ["element", "vertex"]:
                count = int(words[2])
            elif words[:1] == ["property"]:
                fields.append((words[2], types[words[1]]))
            elif words == ["end_header"]:
                break
        rows = np.fromfile(file, dtype=np.dtype(fields), count=count)
    return np.stack([rows["x"], rows["y"], rows["z"]], axis=1)


def map(
    logs: Path | Sequence[Path],
    output: Path | None = None,
    *,
    threads: int | None = None,
    start: Sequence[float] | None = None,
    odometry: bool = True,
    options: Iterable[str] = (),
    **settings: float | int | bool | str,
) -> Run:
    """Maps a log, or several of one drive in a row, as the command `mapwright map` does: to the same bytes.

    Results go into the folder `output`, or into a temporary one that goes with the object returned. `start` is the pose of the robot at
    the first scan: x, y, yaw. Without `odometry` poses are predicted by constant velocity. `options` are any further words of the
    command, such as `["--space", "--topic", "/points"]`. Every other keyword is a setting: `map_resolution_m=0.1` for
    `map.resolution_m`; `mapwright config` lists them.

    Raises `mapwright.Error` with the command's words where a log cannot be mapped, ValueError and TypeError where an argument makes no
    sense, and KeyboardInterrupt on Ctrl-C.
    """
    paths = [logs] if isinstance(logs, (str, os.PathLike)) else list(logs)
    if not paths:
        raise ValueError("expected a log, found none")
    if isinstance(options, str):
        raise TypeError("expected options as a list of words, found one text")
    words = [os.fspath(option) for option in options]
    if threads is not None:
        words += ["--threads", str(threads)]
    if start is not None:
        numbers = [float(number) for number in start]
        words += ["--start=" + ",".join(repr(number) for number in numbers)]
    if not odometry:
        words += ["--no-odometry"]
    temporary = None if output is not None else tempfile.mkdtemp(prefix="mapwright-")
    folder = os.fspath(output) if temporary is None else os.path.join(temporary, "run")
    try:
        words += [f"--output={folder}", "--", *(os.fspath(path) for path in paths)]
        run = Run(_mapwright.map_log(words, settings))
    except BaseException:
        if temporary is not None:
            shutil.rmtree(temporary, ignore_errors=True)
        raise
    if temporary is not None:
        run._remove = weakref.finalize(run, shutil.rmtree, temporary, True)
    return run


def main(words: Sequence[str] | None = None) -> int:
    """Runs the command `mapwright` with these words, or with those of the command line; returns its exit code.

    Long commands handle Ctrl-C themselves: in a program that does anything else, call `mapwright.map`.
    """
    sys.stdout.flush()
    return _mapwright.run_command(["mapwright", *(sys.argv[1:] if words is None else words)])


def _command() -> None:
    """The command as it is installed: the process is its own."""
    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # the command's own handler takes its place
    sys.exit(main())
