"""Maps of intel and fr079 beside GMapping's, over the surveyed relations that GMapping's poses reach; and the CPU a log takes.

    cargo build --release -p mapwright-cli
    python3 scripts/compare_2d.py target/release/mapwright ../shared/data/2d_benchmark

GMapping's poses are LOG.gmapping_reference.txt (stamp x y theta), published corrected logs of others, for a part of the scans; so both are
scored over the relations of which it has both poses. They are scored twice, as poses of the robot and as poses of a laser in front of the
robot's origin or behind it (LASER_X_M), because they do not say which they are; the better counts.

CPU is user and system time of `mapwright map` of the decompressed log, the whole process, the least of COMPARE_2D_ROUNDS runs (5).
Files go to target/figures/compare_2d, or the folder that COMPARE_2D names.
"""

import bz2
import json
import math
import os
import subprocess
import sys
from pathlib import Path

WORK = Path(os.environ.get("COMPARE_2D", "target/figures/compare_2d"))
ROUNDS = int(os.environ.get("COMPARE_2D_ROUNDS", "5"))
# Where the laser sits in front of the robot's origin, said by the log.
LASER_X_M = {"intel": 0.0, "fr079": -0.04}


def rows(path):
    return [line.split() for line in path.read_text().splitlines() if line.strip() and not line.startswith("#")]


def mapped(binary, log, out):
    """The seconds of CPU of one run."""
    before = os.times()
    run = subprocess.run([binary, "map", log, "-o", out, "--quiet"], capture_output=True, text=True)
    if run.returncode not in (0, 3):
        sys.exit(run.stderr)
    after = os.times()
    return after.children_user + after.children_system - before.children_user - before.children_system


def scored(binary, trajectory, relations):
    run = subprocess.run([binary, "eval", trajectory, "--relations", relations, "--json"], capture_output=True, text=True)
    if run.returncode not in (0, 3):
        sys.exit(run.stderr)
    return json.loads(run.stdout)[0]["all"]


def as_tum(poses, path, laser_x_m):
    """Poses of a laser as poses of its robot."""
    with path.open("w") as file:
        for stamp, x, y, theta in poses:
            x_m, y_m, yaw = float(x), float(y), float(theta)
            x_m -= laser_x_m * math.cos(yaw)
            y_m -= laser_x_m * math.sin(yaw)
            print(stamp, f"{x_m:.6f} {y_m:.6f} 0 0 0 {math.sin(yaw / 2):.9f} {math.cos(yaw / 2):.9f}", file=file)
    return path


def words(score):
    return f"{score['translation_m']['mean']:.4f} m / {score['rotation_deg']['mean']:.3f} deg"


def main(binary, data):
    WORK.mkdir(parents=True, exist_ok=True)
    for name, laser_x_m in LASER_X_M.items():
        log = WORK / f"{name}.clf"
        log.write_bytes(bz2.decompress((data / f"{name}.clf.bz2").read_bytes()))
        cpu = min(mapped(binary, log, WORK / name) for _ in range(ROUNDS))
        gmapping = rows(data / f"{name}.gmapping_reference.txt")
        stamps = {float(row[0]) for row in gmapping}
        relations = rows(data / f"{name}.relations")
        reached = [row for row in relations if float(row[0]) in stamps and float(row[1]) in stamps]
        file = WORK / f"{name}.relations"
        file.write_text("".join(" ".join(row) + "\n" for row in reached))
        peers = [scored(binary, as_tum(gmapping, WORK / f"{name}.gmapping.tum", x_m), file) for x_m in (0.0, laser_x_m)]
        ours = WORK / name / "trajectory.tum"
        print(f"{name}: {len(relations)} relations: mapwright {words(scored(binary, ours, data / f'{name}.relations'))}, {cpu:.2f} s CPU")
        print(
            f"{name}: the {len(reached)} relations that GMapping's poses reach: mapwright {words(scored(binary, ours, file))}, "
            f"GMapping {words(min(peers, key=lambda score: score['translation_m']['mean']))}"
        )


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(sys.argv[1], Path(sys.argv[2]))
