"""Whether one build maps better than another, by distributions over real logs; for docs/decisions/0029-ablation.md and docs/figures.md.

    cargo build --release -p mapwright-cli
    python3 scripts/judge.py ../shared/data target/release/mapwright [OTHER] [--day calm|bad|both] [--runs 20] [--logs intel,csail] [--jobs 2]
    python3 scripts/judge.py ../shared/data target/debug/mapwright --bounds scripts/judge_bounds.json    # what CI runs

A single run of a sparse log is a throw of dice: 3 mm on its readings move the error by tens of per cent. So each log is mapped many times, each time with
other readings (uniform within 3 mm, far below what the lasers resolve) and other wheels: increments scaled by 1 + N(0, 0.01) and turned, on bad days by
0.12, with half a minute cut out somewhere. Two builds get the same. Said of each log: median, 90th percentile and worst error (relations, or the absolute
trajectory error, metres), maps that broke (above three times the first build's median, or no result), those of them that were called good, CPU seconds; of
two builds the geometric mean of the paired ratios, with its standard error. Logs without a reference are judged by what is known of them (FACTS): how
often that came out. A rule stays where taking it out harms beyond this scatter.

With --bounds the file says which logs, and how far the median may go and how many may break; more is exit code 1. Runs are kept in --cache by the build's
bytes, and made once.
"""

import argparse
import bisect
import bz2
import gzip
import hashlib
import json
import math
import os
import random
import statistics
import subprocess
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

LOGS = {name: (f"2d_benchmark/{name}.clf.bz2", f"2d_benchmark/{name}.relations") for name in ("intel", "fr079")}
LOGS |= {f"{name}-without-wheels": LOGS[name] for name in ("intel", "fr079")}
for name in ("fhw", "acapulco", "belgioioso", "csail", "edmonton", "freiburg-079", "intel"):
    called = "ple-intel" if name == "intel" else name
    LOGS[called] = (f"2d_ple/{name}.raw.clf.gz", f"2d_ple/{name}.reference.txt")

# Of robots with short, slow or sparse lidars: what a right map shows. Files, and what is asked of the folder of results and its report.
FACTS = {
    "loop5": (["2d_small/loop5.clf.gz"], lambda out, report: 53.0 <= way_m(out) <= 57.0 and maps(report) == 1),
    "wean1": (["2d_small/wean1.clf.gz"], lambda out, report: report["verdict"]["word"] == "good"),
    "expt10": (["2d_small/19_jan17_expt10.bag"], lambda out, report: maps(report) == 1),
    "may9-twice": (["2d_small/18_may9_before1.bag", "2d_small/18_may9_after1.bag"], lambda out, report: maps(report) == 1),
    "ariana": (["2d_small/ariana_person1.bag"], lambda out, report: tracked(report) >= 0.93),
    "mink-test": (["2d_small/mink_test.bag"], lambda out, report: tracked(report) >= 0.98),
    "mink-wall": (["2d_small/mink_wall.bag"], lambda out, report: tracked(report) >= 0.98),
    "mink-square": (["2d_small/mink_square.bag"], lambda out, report: tracked(report) >= 0.95),
}

WHEELS = {"calm": 0.01, "bad": 0.12}
READINGS_M = 0.003
CUT_S = 30.0
# A map is broken whose error is so many times the median.
BROKEN = 3.0


def compose(a, b):
    c, s = math.cos(a[2]), math.sin(a[2])
    return a[0] + c * b[0] - s * b[1], a[1] + s * b[0] + c * b[1], a[2] + b[2]


def between(a, b):
    c, s = math.cos(a[2]), math.sin(a[2])
    x, y = b[0] - a[0], b[1] - a[1]
    return c * x + s * y, -s * x + c * y, math.remainder(b[2] - a[2], 2 * math.pi)


def jittered(source, day, run, cache):
    """The log of that day and run, made once."""
    name = source.name.split(".")[0]
    made = cache / "logs" / f"{hashlib.sha1(str(source).encode()).hexdigest()[:6]}-{name}-{day}-{run}.clf.gz"
    if made.exists():
        return made
    made.parent.mkdir(parents=True, exist_ok=True)
    dice = random.Random(f"{name} {day} {run}")
    opened = {".bz2": bz2.open, ".gz": gzip.open}.get(source.suffix, open)
    with opened(source, "rt", errors="replace") as file:
        lines = file.read().split("\n")
    gone = cut(lines, dice) if day == "bad" else range(0)
    part, before, now = made.with_suffix(f".{os.getpid()}"), None, None
    with gzip.open(part, "wt", compresslevel=1) as file:
        for number, line in enumerate(lines):
            words = line.split()
            if not words or words[0] not in ("ODOM", "FLASER"):
                file.write(line + "\n")
                continue
            beams = int(words[1]) if words[0] == "FLASER" else 0
            at = 5 + beams if beams else 1
            pose = tuple(map(float, words[at : at + 3]))
            if before is None:
                now = pose
            else:
                step = between(before, pose)
                scale = 1 + dice.gauss(0, WHEELS[day])
                turned = dice.gauss(0, WHEELS[day] * (abs(step[2]) + 0.05 * math.hypot(step[0], step[1])))
                now = compose(now, (step[0] * scale, step[1] * scale, step[2] + turned))
            if beams:
                laser = compose(now, between(pose, tuple(map(float, words[2 + beams : 5 + beams]))))
                words[2 + beams : 5 + beams] = [f"{value:.6f}" for value in laser]
                for k in range(2, 2 + beams):
                    reading = float(words[k])
                    if 0.05 < reading < 30:
                        words[k] = f"{reading + dice.uniform(-READINGS_M, READINGS_M):.3f}"
            before = pose
            words[at : at + 3] = [f"{value:.6f}" for value in now]
            if number not in gone:
                file.write(" ".join(words) + "\n")
    os.replace(part, made)
    return made


def cut(lines, dice):
    """The lines of half a minute somewhere."""
    scans = [k for k, line in enumerate(lines) if line.startswith("FLASER")]
    first = scans[int(dice.uniform(0.1, 0.9) * len(scans))]
    begin = float(lines[first].split()[-3])
    return range(first, next((k for k in scans if k > first and float(lines[k].split()[-3]) >= begin + CUT_S), len(lines)))


def poses(path):
    rows = (line.split() for line in open(path) if line.strip() and line[0] != "#")
    return sorted((float(r[0]), float(r[1]), float(r[2]), 2 * math.atan2(float(r[6]), float(r[7]))) for r in rows)


def way_m(out):
    way = poses(out / "trajectory.tum")
    return sum(math.dist(a[1:3], b[1:3]) for a, b in zip(way, way[1:]))


def maps(report):
    return 1 + len(report["further_maps"])


def tracked(report):
    status = report["status"]
    return status["tracking"] / max(1, sum(status[kind] for kind in ("tracking", "degraded", "lost")))


def nearest(track, stamps, stamp):
    k = bisect.bisect_left(stamps, stamp)
    k = min((k for k in (k - 1, k) if 0 <= k < len(stamps)), key=lambda k: abs(stamps[k] - stamp))
    return track[k] if abs(stamps[k] - stamp) < 0.05 else None


def relations_m(track, reference):
    """Mean error of translation over relations of which both ends are known."""
    stamps, errors = [pose[0] for pose in track], []
    for line in open(reference):
        row = list(map(float, line.split()[:8]))
        ends = [nearest(track, stamps, stamp) for stamp in row[:2]]
        if None not in ends:
            errors.append(math.hypot(*between((row[2], row[3], row[7]), between(ends[0][1:], ends[1][1:]))[:2]))
    return statistics.fmean(errors) if errors else None


def trajectory_m(track, reference):
    """Root mean square of what is left once the trajectory lies on its reference."""
    stamps, pairs = [pose[0] for pose in track], []
    for row in (line.split() for line in open(reference) if line.strip() and line[0] != "#"):
        pose = nearest(track, stamps, float(row[0]))
        if pose:
            pairs.append((complex(pose[1], pose[2]), complex(float(row[1]), float(row[2]))))
    if not pairs:
        return None
    means = [sum(pair[k] for pair in pairs) / len(pairs) for k in range(2)]
    turn = sum((a - means[0]).conjugate() * (b - means[1]) for a, b in pairs)
    turn /= abs(turn) or 1
    return math.sqrt(sum(abs(turn * (a - means[0]) - (b - means[1])) ** 2 for a, b in pairs) / len(pairs))


def mapped(binary, log, day, run, data, cache):
    """Error or fact, CPU seconds and verdict of a run, made once."""
    build = hashlib.sha1(Path(binary).read_bytes()).hexdigest()[:12]
    known = cache / "runs" / f"{build}-{log}-{day}-{run}.json"
    if known.exists():
        return json.loads(known.read_text())
    known.parent.mkdir(parents=True, exist_ok=True)
    sources = [data / name for name in (FACTS[log][0] if log in FACTS else LOGS[log][:1])]
    logs = [jittered(plain(binary, source, cache), day, run, cache) for source in sources]
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        options = ["--no-odometry"] if log.endswith("-without-wheels") else []
        quiet = {name: subprocess.DEVNULL for name in ("stdin", "stdout", "stderr")}
        child = subprocess.Popen([binary, "map", *map(str, logs), "-o", str(out), *options], **quiet)
        _, status, used = os.wait4(child.pid, 0)
        child.returncode = os.waitstatus_to_exitcode(status)
        result = {"error": None, "verdict": None, "cpu_s": used.ru_utime + used.ru_stime}
        if child.returncode in (0, 3):
            report = json.loads((out / "report.json").read_text())
            result["verdict"] = report["verdict"]["word"]
            if log in FACTS:
                result["holds"] = bool(FACTS[log][1](out, report))
            else:
                reference, track = data / LOGS[log][1], poses(out / "trajectory.tum")
                judge = relations_m if reference.suffix == ".relations" else trajectory_m
                result["error"] = judge(track, reference)
    known.write_text(json.dumps(result))
    return result


def plain(binary, source, cache):
    """A recording of messages as a CARMEN log."""
    if source.suffix != ".bag":
        return source
    made = cache / "logs" / f"{source.stem}.clf"
    if not made.exists():
        made.parent.mkdir(parents=True, exist_ok=True)
        part = made.with_suffix(f".{os.getpid()}.clf")
        subprocess.run([binary, "convert", str(source), str(part)], check=False, capture_output=True)
        os.replace(part, made)
    return made


def quantile(values, share):
    return sorted(values)[min(len(values) - 1, int(share * len(values)))]


class Column:
    """One build's runs of a log."""

    def __init__(self, runs):
        self.runs = runs
        self.errors = [math.inf if run["error"] is None else run["error"] for run in runs]

    def broken(self, median_m):
        return [run for run, error in zip(self.runs, self.errors) if error > BROKEN * median_m]

    def words(self, median_m):
        broken = self.broken(median_m)
        good = sum(run["verdict"] == "good" for run in broken)
        cpu_s = statistics.fmean(run["cpu_s"] for run in self.runs)
        return (
            f"{quantile(self.errors, 0.5):9.4f}{quantile(self.errors, 0.9):8.3f}{max(self.errors):8.3f}"
            f"{len(broken):7d}{good:5d}{cpu_s:7.2f}"
        )


def ratio(first, second):
    logs = [math.log(b / a) for a, b in zip(first.errors, second.errors) if 0 < a < math.inf and 0 < b < math.inf]
    mean = statistics.fmean(logs) if logs else math.inf
    return mean, statistics.stdev(logs) / math.sqrt(len(logs)) if len(logs) > 1 else 0.0


def judge(given, day, pool):
    names, runs = given.logs.split(","), range(given.first, given.first + given.runs)
    cache = Path(given.cache)
    jobs = {
        (binary, log, run): pool.submit(mapped, binary, log, day, run, given.data, cache)
        for log in names
        for run in runs
        for binary in given.builds
    }
    columns = {
        log: [Column([jobs[binary, log, run].result() for run in runs]) for binary in given.builds] for log in names
    }
    head = f"{'median':>9}{'p90':>8}{'worst':>8}{'broken':>7}{'good':>5}{'cpu s':>7}" * len(given.builds)
    print(f"{day:22}{head}{'   ratio' * (len(given.builds) > 1)}")
    means, speeds, medians = [], [], {}
    for log, builds in columns.items():
        if log in FACTS:
            kept = [sum(run.get("holds", False) for run in build.runs) for build in builds]
            print(f"{log:22}" + "".join(f"{count:9d} of {len(runs)}" + " " * 30 for count in kept))
            continue
        median_m = quantile(builds[0].errors, 0.5)
        medians[log] = (median_m, len(builds[0].broken(median_m)))
        row = f"{log:22}" + "".join(build.words(median_m) for build in builds)
        if len(builds) > 1:
            mean, scatter = ratio(*builds)
            means.append(mean)
            speeds.append([statistics.fmean(run["cpu_s"] for run in build.runs) for build in builds])
            row += f"   {math.exp(mean):.3f} +- {scatter:.3f}"
        print(row, flush=True)
    if means:
        cpu = statistics.fmean(math.log(b / a) for a, b in speeds)
        print(f"all: error {math.exp(statistics.fmean(means)):.3f}, CPU {math.exp(cpu):.3f} of the first's")
    return medians


def is_within(medians, bounds):
    is_all = True
    for log, (most_m, broken_most) in bounds.items():
        median_m, broken = medians[log]
        if median_m > most_m or broken > broken_most:
            print(f"{log}: expected {most_m} m at most and {broken_most} broken, found {median_m:.4f} m and {broken}")
            is_all = False
    return is_all


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path)
    parser.add_argument("builds", nargs="+")
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--first", type=int, default=1)
    parser.add_argument("--logs", default=",".join([*LOGS, *FACTS]))
    parser.add_argument("--day", choices=["calm", "bad", "both"], default="calm")
    parser.add_argument("--jobs", type=int, default=os.cpu_count())
    parser.add_argument("--cache", default="target/judge")
    parser.add_argument("--bounds", type=Path)
    given = parser.parse_args()
    bounds = json.loads(given.bounds.read_text()) if given.bounds else None
    if bounds:
        given.logs, given.runs, given.day = ",".join(bounds["logs"]), bounds["runs"], "calm"
    with ProcessPoolExecutor(given.jobs) as pool:
        for day in ("calm", "bad") if given.day == "both" else (given.day,):
            medians = judge(given, day, pool)
    if bounds and not is_within(medians, bounds["logs"]):
        sys.exit(1)


if __name__ == "__main__":
    main()
