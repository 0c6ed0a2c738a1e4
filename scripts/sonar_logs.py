#!/usr/bin/env python3
"""A CARMEN log of what `sonar_udacity8` holds: readings of eight sonars in millimetres, and poses in millimetres and tenths of a degree.

    scripts/sonar_logs.py ../shared/data/sonar_udacity8 udacity8.clf udacity8.tum
    mapwright map udacity8.clf -o udacity8
    mapwright eval udacity8/trajectory.tum --reference udacity8.tum

The folder says directions and poses and no more: the sonars are taken to sit in the robot's origin, with cones of 15 degrees, as far as the six in
front are apart. 5110 stands for nothing heard; the poses are exact, and become odometry.
"""

import math
import pathlib
import sys

DIRECTIONS_DEG = [-90.0, -37.5, -22.5, -7.5, 7.5, 22.5, 37.5, 90.0]
CONE_DEG = 15.0
REACH_M = 5.1


def rows(path):
    for number, line in enumerate(path.read_text().splitlines(), 1):
        fields = line.split()
        try:
            yield [int(field) for field in fields]
        except ValueError:
            sys.exit(f"{path}:{number}: expected whole numbers, found {line!r}")


def main():
    if len(sys.argv) not in (3, 4):
        sys.exit(__doc__)
    folder = pathlib.Path(sys.argv[1])
    poses = {row[0]: row[1:] for row in rows(folder / "poses.txt")}
    if len(sys.argv) == 4:
        with open(sys.argv[3], "w", encoding="ascii") as trajectory:
            for stamp_ms, (x_mm, y_mm, tenths) in poses.items():
                half = math.radians(tenths / 10) / 2
                turn = f"{math.sin(half):.9f} {math.cos(half):.9f}"
                trajectory.write(f"{stamp_ms / 1000:.3f} {x_mm / 1000} {y_mm / 1000} 0 0 0 {turn}\n")
    with open(sys.argv[2], "w", encoding="ascii") as log:
        log.write(f"PARAM mapwright_sonar_range_max {REACH_M} nohost 0\n")
        for stamp_ms, *ranges_mm in rows(folder / "measurement.txt"):
            if len(ranges_mm) != len(DIRECTIONS_DEG):
                sys.exit(f"stamp {stamp_ms}: expected {len(DIRECTIONS_DEG)} ranges, found {len(ranges_mm)}")
            stamp = f"{stamp_ms / 1000:.3f} nohost {stamp_ms / 1000:.3f}"
            if stamp_ms in poses:
                x_mm, y_mm, tenths = poses[stamp_ms]
                log.write(f"ODOM {x_mm / 1000} {y_mm / 1000} {math.radians(tenths / 10):.6f} 0 0 0 {stamp}\n")
            ranges = " ".join(f"{range_mm / 1000:.2f}" for range_mm in ranges_mm)
            sonars = " ".join(f"0 0 {math.radians(direction):.6f}" for direction in DIRECTIONS_DEG)
            log.write(f"SONAR {math.radians(CONE_DEG):.6f} {len(ranges_mm)} {ranges} {sonars} {stamp}\n")


if __name__ == "__main__":
    main()
