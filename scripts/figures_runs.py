"""What several drives of one building cost beside one, and how a robot is located: the figures of docs/decisions/0026-runs.md.

    cargo build --release -p mapwright-cli
    python3 scripts/figures_runs.py merge ../shared/data/2d_benchmark      # intel in three, fr079 in two, as logs and as sessions
    python3 scripts/figures_runs.py localise ../shared/data/2d_benchmark/intel.clf.bz2 100

merge: logs are cut by scans, the parts merged, and all relations of the log scored. localise: the second half of a log in a map of the
first, from so many starts, each for 1,500 scans. Seconds count while the robot is on known ground: an earlier pose of the whole log's map
lies within 2 m and 60 degrees. Errors are beside the whole log's map, laid rigidly on the first half's.

The binary is target/release/mapwright, or what MAPWRIGHT names; files go to target/figures/runs.
"""

import bz2
import math
import os
import statistics
import subprocess
import sys
from pathlib import Path

BINARY = os.environ.get("MAPWRIGHT", "target/release/mapwright")
WORK = Path("target/figures/runs")
SCANS = 1500
KNOWN_M, KNOWN_RAD = 2.0, math.radians(60)
# A pause in the log is no time on known ground, seconds.
PAUSE_S = 5.0


def mapwright(*args):
    run = subprocess.run([BINARY, *map(str, args)], capture_output=True, text=True)
    if run.returncode not in (0, 3):
        sys.exit(run.stderr)
    return run.stdout


class Log:
    """A CARMEN log by its scans."""

    def __init__(self, path):
        opened = bz2.open(path, "rt", errors="replace") if str(path).endswith(".bz2") else open(path, errors="replace")
        with opened as file:
            self.lines = file.readlines()
        self.head = [line for line in self.lines if line.startswith("PARAM")]
        self.scans = [at for at, line in enumerate(self.lines) if line.startswith(("FLASER", "ROBOTLASER"))]

    def write(self, path, first, end):
        """The scans from first to end, and what stands between them."""
        lines = self.lines[self.scans[first] : self.scans[end] if end < len(self.scans) else None]
        path.write_text("".join((self.lines[: self.scans[0]] if first == 0 else self.head) + lines))
        return path


def relation_error(out, relations):
    return mapwright("eval", out / "trajectory.tum", "--relations", relations).splitlines()[1].split("|")[0].strip()


def merge(data):
    for name, parts in (("intel", 3), ("fr079", 2)):
        log, relations = Log(data / f"{name}.clf.bz2"), data / f"{name}.relations"
        cuts = [len(log.scans) * k // parts for k in range(parts + 1)]
        logs = [log.write(WORK / f"{name}.{k}.clf", cuts[k], cuts[k + 1]) for k in range(parts)]
        sessions = [WORK / f"{name}.{k}" for k in range(parts)]
        for part, session in zip(logs, sessions):
            mapwright("map", part, "-o", session, "--quiet")
        mapwright("map", data / f"{name}.clf.bz2", "-o", WORK / name, "--quiet")
        print(f"{name}, whole: {relation_error(WORK / name, relations)}")
        for what, inputs in (("logs", logs), ("sessions", sessions)):
            out = WORK / f"{name}.{what}"
            said = mapwright("merge", *inputs, "-o", out)
            pieces = next(line for line in said.splitlines() if line.startswith("pieces"))
            print(f"{name}, {parts} {what} merged: {relation_error(out, relations)}; {pieces}")
        out = WORK / f"{name}.continued"
        for k, part in enumerate(logs):
            mapwright("map", part, "-o", out, "--quiet", *(["--continue"] if k else []))
        print(f"{name}, {parts} logs, each but the first with --continue: {relation_error(out, relations)}")


def poses_of(out):
    rows = [line.split() for line in (out / "trajectory.tum").read_text().splitlines() if not line.startswith("#")]
    rows = [[float(number) for number in row] for row in rows]
    return [(row[1], row[2], 2 * math.atan2(row[6], row[7])) for row in rows]


def turned(angle):
    return abs((angle + math.pi) % (2 * math.pi) - math.pi)


def laid_on(whole, half):
    """The poses of the whole log in the frame of the first half's map."""
    count = len(half)
    centre = [[statistics.fmean(pose[axis] for pose in poses[:count]) for axis in (0, 1)] for poses in (whole, half)]
    sines = cosines = 0.0
    for (x, y, _), (u, v, _) in zip(whole, half):
        (x, y), (u, v) = (x - centre[0][0], y - centre[0][1]), (u - centre[1][0], v - centre[1][1])
        sines, cosines = sines + x * v - y * u, cosines + x * u + y * v
    turn = math.atan2(sines, cosines)
    sine, cosine = math.sin(turn), math.cos(turn)

    def laid(pose):
        x, y = pose[0] - centre[0][0], pose[1] - centre[0][1]
        return (cosine * x - sine * y + centre[1][0], sine * x + cosine * y + centre[1][1], pose[2] + turn)

    return [laid(pose) for pose in whole]


def locate(log, at, map_folder, truth, known):
    """Seconds on known ground until the robot was located, and the mean error of its poses; infinite where it was not."""
    end = min(at + SCANS, len(log.scans))
    poses = WORK / "poses.csv"
    mapwright("localise", log.write(WORK / "start.clf", at, end), "--map", map_folder, "-o", poses, "--quiet")
    seconds, last, errors = 0.0, None, []
    for row, true in zip(poses.read_text().splitlines()[1:], truth[at:end]):
        row = row.split(",")
        elapsed = min(max(float(row[0]) - last, 0.0), PAUSE_S) if last is not None else 0.0
        last = float(row[0])
        if row[1] == "1":
            errors.append(math.hypot(float(row[2]) - true[0], float(row[3]) - true[1]))
        elif not errors and any(
            math.hypot(x - true[0], y - true[1]) < KNOWN_M and turned(heading - true[2]) < KNOWN_RAD for x, y, heading in known
        ):
            seconds += elapsed
    return (seconds, statistics.fmean(errors)) if errors else (math.inf, math.inf)


def localise(path, starts):
    log = Log(path)
    half = len(log.scans) // 2
    mapwright("map", log.write(WORK / "half.clf", 0, half), "-o", WORK / "half", "--quiet")
    mapwright("map", path, "-o", WORK / "whole", "--quiet")
    first_half = poses_of(WORK / "half")
    truth = laid_on(poses_of(WORK / "whole"), first_half)
    places = [half + int(0.97 * (len(log.scans) - half) * k / starts) for k in range(starts)]
    located = [locate(log, at, WORK / "half", truth, truth[: len(first_half)]) for at in places]
    seconds, errors = zip(*located)
    print(
        f"{path.name}: {sum(s <= 10 for s in seconds)} of {starts} starts located within 10 s on known ground, "
        f"{sum(math.isinf(s) for s in seconds)} never; in the median {statistics.median(seconds):.1f} s; "
        f"mean error in the median {statistics.median(errors):.4f} m, of the worst start "
        f"{max((e for e in errors if not math.isinf(e)), default=math.inf):.3f} m, "
        f"{sum(0.05 < e < math.inf for e in errors)} above 0.05 m"
    )


def main():
    WORK.mkdir(parents=True, exist_ok=True)
    what, path = sys.argv[1], Path(sys.argv[2])
    if what == "merge":
        merge(path)
    else:
        localise(path, int(sys.argv[3]))


main()
