#!/usr/bin/env python3
"""A CARMEN log of what `sonar_udacity8` holds: readings of eight sonars in millimetres, and poses in millimetres and tenths of a degree.

    scripts/sonar_logs.py ../shared/data/sonar_udacity8 udacity8.clf udacity8.tum
    mapwright map udacity8.clf -o udacity8
    mapwright eval udacity8/trajectory.tum --reference udacity8.tum
    scripts/sonar_logs.py ../shared/data/sonar_udacity8 bad.clf udacity8.tum --wheels 1 --seed 3

The folder says directions and poses and no more: the sonars are taken to sit in the robot's origin, with cones of 15 degrees, as far as the six in
front are apart. 5110 stands for nothing heard; the poses are exact, and become odometry. `--wheels 1` makes it as bad as that of `mapwright demo --sonar`: 10 % of ways and turns by chance, and
3 % of both and half a degree a metre always; `--wheels 0.3` three tenths of that.
"""

import argparse
import math
import pathlib
import random
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


def wrap(angle):
    return math.atan2(math.sin(angle), math.cos(angle))


class Wheels:
    """Odometry of wheels that err, from exact poses."""

    def __init__(self, share, seed):
        self.share, self.random = share, random.Random(seed)
        self.way = 1 + share * self.random.gauss(0, 0.03)
        self.turn = 1 + share * self.random.gauss(0, 0.03)
        self.drift = share * self.random.gauss(0, math.radians(0.5))
        self.true = self.said = None

    def say(self, x, y, theta):
        if self.true is None:
            self.said = (x, y, theta)
        else:
            dx, dy, turned = x - self.true[0], y - self.true[1], wrap(theta - self.true[2])
            cos, sin = math.cos(self.true[2]), math.sin(self.true[2])
            ahead, aside = cos * dx + sin * dy, cos * dy - sin * dx
            driven = math.hypot(ahead, aside)
            way = self.way + (self.share * self.random.gauss(0, 0.1) / math.sqrt(driven) if driven > 0 else 0)
            chance = self.share * self.random.gauss(0, math.sqrt(0.01 * abs(turned) + 1.22e-3 * driven))
            turn = self.turn * turned + self.drift * driven + chance
            middle = self.said[2] + (turn - turned) / 2
            cos, sin = math.cos(middle), math.sin(middle)
            x_said, y_said, theta_said = self.said
            moved = way * (cos * ahead - sin * aside), way * (sin * ahead + cos * aside)
            self.said = (x_said + moved[0], y_said + moved[1], wrap(theta_said + turn))
        self.true = (x, y, theta)
        return self.said


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=pathlib.Path)
    parser.add_argument("log")
    parser.add_argument("poses", nargs="?", help="the exact poses, as TUM writes them")
    parser.add_argument("--wheels", type=float, default=0.0, help="how bad odometry is; 0 is exact")
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    folder, wheels = args.folder, Wheels(args.wheels, args.seed)
    poses = {row[0]: row[1:] for row in rows(folder / "poses.txt")}
    if args.poses:
        with open(args.poses, "w", encoding="ascii") as trajectory:
            for stamp_ms, (x_mm, y_mm, tenths) in poses.items():
                half = math.radians(tenths / 10) / 2
                turn = f"{math.sin(half):.9f} {math.cos(half):.9f}"
                trajectory.write(f"{stamp_ms / 1000:.3f} {x_mm / 1000} {y_mm / 1000} 0 0 0 {turn}\n")
    with open(args.log, "w", encoding="ascii") as log:
        log.write(f"PARAM mapwright_sonar_range_max {REACH_M} nohost 0\n")
        for stamp_ms, *ranges_mm in rows(folder / "measurement.txt"):
            if len(ranges_mm) != len(DIRECTIONS_DEG):
                sys.exit(f"stamp {stamp_ms}: expected {len(DIRECTIONS_DEG)} ranges, found {len(ranges_mm)}")
            stamp = f"{stamp_ms / 1000:.3f} nohost {stamp_ms / 1000:.3f}"
            if stamp_ms in poses:
                x_mm, y_mm, tenths = poses[stamp_ms]
                x, y, theta = x_mm / 1000, y_mm / 1000, math.radians(tenths / 10)
                if args.wheels:
                    x, y, theta = (round(part, 6) for part in wheels.say(x, y, theta))
                log.write(f"ODOM {x} {y} {theta:.6f} 0 0 0 {stamp}\n")
            ranges = " ".join(f"{range_mm / 1000:.2f}" for range_mm in ranges_mm)
            sonars = " ".join(f"0 0 {math.radians(direction):.6f}" for direction in DIRECTIONS_DEG)
            log.write(f"SONAR {math.radians(CONE_DEG):.6f} {len(ranges_mm)} {ranges} {sonars} {stamp}\n")


if __name__ == "__main__":
    main()
