#!/usr/bin/env python3
"""Leaves clouds of the hall out, maps what is left, and counts what its verdict misses.

    python3 scripts/space_faults.py target/release/mapwright ../shared/data/3d_os0_hall

Every n-th cloud, n from 1 to 12, from two beginnings, and gaps of 6, 10, 14 and 20 clouds at every ninth place. An error is ATE beside
the poses of the recording; silently wrong is what is called good beyond 3 times the error of all clouds.
"""

import json
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

GOOD_TIMES = 3.0
BAD_TIMES = 10.0
PER_CLOUD = ["poses_kitti.txt", "times.txt"]


def variants(count):
    yield "all", range(count)
    for every in range(2, 13):
        for first in (0, every // 2):
            yield f"every {every}th from {first}", range(first, count, every)
    for length in (6, 10, 14, 20):
        for first in range(7, count - length - 3, 9):
            gap = range(first, first + length)
            yield f"{first} to {first + length - 1} missing", [k for k in range(count) if k not in gap]


def mapped(mapwright, hall, kept, folder):
    """The error, metres, and the word, of some of the clouds."""
    clouds = sorted((hall / "velodyne").iterdir())
    (folder / "in" / "velodyne").mkdir(parents=True)
    for number, k in enumerate(kept):
        suffix = clouds[k].name.split(".", 1)[1]
        (folder / "in" / "velodyne" / f"{number:06}.{suffix}").symlink_to(clouds[k].resolve())
    for name in PER_CLOUD:
        lines = (hall / name).read_text().splitlines()
        if len(lines) != len(clouds):
            sys.exit(f"expected a line a cloud, {len(clouds)}, found {len(lines)}: {hall / name}")
        (folder / "in" / name).write_text("".join(lines[k] + "\n" for k in kept))
    run = [mapwright, "map", folder / "in", "-o", folder / "out", "--quiet"]
    code = subprocess.run(run).returncode
    if code not in (0, 3):
        sys.exit(f"expected exit code 0 or 3, found {code}: {run}")
    report = json.loads((folder / "out" / "report.json").read_text())
    return report["reference"]["ate_rmse_m"], report["verdict"]["word"]


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    mapwright, hall = sys.argv[1], Path(sys.argv[2])
    count = len(list((hall / "velodyne").iterdir()))
    words, clean_m = Counter(), None
    for name, kept in variants(count):
        with tempfile.TemporaryDirectory() as folder:
            error_m, word = mapped(mapwright, hall, list(kept), Path(folder))
        clean_m = clean_m or error_m
        times = error_m / clean_m
        kind = "below 3 times" if times < GOOD_TIMES else "3 to 10 times" if times <= BAD_TIMES else "beyond 10 times"
        words[kind, word] += 1
        print(f"{name:22} {len(kept):3} clouds {word:8} {error_m:7.4f} m {times:7.1f} times", flush=True)
    for kind in ("below 3 times", "3 to 10 times", "beyond 10 times"):
        print(f"{kind:16}", ", ".join(f"{words[kind, word]} {word}" for word in ("good", "check", "unusable")))


if __name__ == "__main__":
    main()
