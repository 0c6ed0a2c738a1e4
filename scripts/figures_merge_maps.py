"""Finished maps joined: the figures of docs/decisions/0032-finished-maps.md.

    cargo build --release -p mapwright-cli
    python3 scripts/figures_merge_maps.py halves ../shared/data/2d_benchmark      # intel and fr079, each cut in two and in three
    python3 scripts/figures_merge_maps.py logs ../shared/data                     # every log with a map, cut in two and in three
    python3 scripts/figures_merge_maps.py unrelated ../shared/data 150            # maps of different buildings, so many pairs

halves, logs: logs are cut by scans, each part mapped alone, and the two maps given to `merge-maps`. Truth: each part's trajectory laid rigidly
on the whole log's (least squares over all scans), "fit" being the worse of the two residuals (rms); the error is that of the pose of B in A at
the middle of the overlap, and at B's first pose.

unrelated: wholes and halves of all logs, and floors of `mapwright demo`. Pairs of one place are left out, known (the two logs of intel, of fr079)
or seen in the joined maps (exp3 and test_lab2; the robots with a Neato, ariana_* and mink_*), and so are 18_* and 19_*, which may be one hall.

The binary is target/release/mapwright, or what MAPWRIGHT names; files go to target/figures/merge-maps, and a map that is there stays.
"""

import bz2
import gzip
import itertools
import json
import math
import os
import random
import resource
import subprocess
import sys
from pathlib import Path

BINARY = os.environ.get("MAPWRIGHT", "target/release/mapwright")
WORK = Path("target/figures/merge-maps")
PARTS = {"whole": (0, 1), "half1": (0, 2), "half2": (1, 2), "third1": (0, 3), "third2": (1, 3), "third3": (2, 3)}
PAIRS = [("half1", "half2"), ("third1", "third2"), ("third2", "third3"), ("third1", "third3")]
FLOORS = range(1, 16)
SAME_PLACE = {"ple_intel": "intel", "ple_freiburg-079": "fr079", "test_lab2": "exp3"}


def mapwright(*args):
    run = subprocess.run([BINARY, *map(str, args)], capture_output=True, text=True)
    return run.returncode, run.stdout, run.stderr


def logs_of(data):
    found = {path.name.split(".")[0]: path for path in sorted((data / "2d_benchmark").glob("*.clf.bz2"))}
    found |= {"ple_" + path.name.split(".")[0]: path for path in sorted((data / "2d_ple").glob("*.clf.gz"))}
    return found | {path.name.split(".")[0]: path for path in sorted((data / "2d_small").glob("*.*"))}


def place_of(name):
    if name[:3] in ("18_", "19_"):
        return "carried robots"
    return "neato" if name.startswith(("ariana", "mink")) else SAME_PLACE.get(name, name)


def lines_of(path):
    if path.suffix == ".bag":
        converted = WORK / f"{path.stem}.clf"
        if not converted.exists():
            mapwright("convert", path, converted)
        path = converted
    opened = {".bz2": bz2.open, ".gz": gzip.open}.get(path.suffix, open)
    with opened(path, "rt", errors="replace") as file:
        return file.readlines()


def map_parts(name, path, parts):
    """Maps the parts that are not there yet."""
    if all((WORK / f"{name}.{part}" / "map.yaml").exists() for part in parts):
        return
    lines = lines_of(path)
    head = [line for line in lines if line.startswith("PARAM")]
    scans = [at for at, line in enumerate(lines) if line.startswith(("FLASER", "ROBOTLASER", "RAWLASER"))]
    for part in parts:
        number, count = PARTS[part]
        first, end = len(scans) * number // count, len(scans) * (number + 1) // count
        cut = WORK / f"{name}.{part}.clf"
        body = lines[scans[first] : scans[end] if end < len(scans) else None]
        cut.write_text("".join((lines[: scans[0]] if first == 0 else head) + body))
        mapwright("map", cut, "-o", WORK / f"{name}.{part}", "--quiet", "--threads", "1")
        cut.unlink()


def trajectory(name, part):
    rows = (WORK / f"{name}.{part}" / "trajectory.tum").read_text().splitlines()
    rows = [[float(number) for number in row.split()] for row in rows if not row.startswith("#")]
    return {row[0]: (row[1], row[2], 2 * math.atan2(row[6], row[7])) for row in rows}


def compose(a, b):
    c, s = math.cos(a[2]), math.sin(a[2])
    return (a[0] + c * b[0] - s * b[1], a[1] + s * b[0] + c * b[1], a[2] + b[2])


def inverse(a):
    c, s = math.cos(a[2]), math.sin(a[2])
    return (-c * a[0] - s * a[1], s * a[0] - c * a[1], -a[2])


def laid_on(whole, part):
    """The pose of the part's frame in the whole's, and the residual."""
    pairs = [(pose, whole[stamp]) for stamp, pose in part.items() if stamp in whole]
    count = len(pairs)
    (pu, pv), (qu, qv) = [[sum(pair[k][axis] for pair in pairs) / count for axis in (0, 1)] for k in (0, 1)]
    cosines = sum((p[0] - pu) * (q[0] - qu) + (p[1] - pv) * (q[1] - qv) for p, q in pairs)
    sines = sum((p[0] - pu) * (q[1] - qv) - (p[1] - pv) * (q[0] - qu) for p, q in pairs)
    turn = math.atan2(sines, cosines)
    c, s = math.cos(turn), math.sin(turn)
    pose = (qu - c * pu + s * pv, qv - s * pu - c * pv, turn)
    squares = [(compose(pose, p)[0] - q[0]) ** 2 + (compose(pose, p)[1] - q[1]) ** 2 for p, q in pairs]
    return pose, math.sqrt(sum(squares) / count)


def joined(a, b, out="joined"):
    """What is found, or why nothing is; and the seconds of CPU that it took."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    code, said, complained = mapwright("merge-maps", WORK / a, WORK / b, "-o", WORK / out, "--json")
    seconds = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
    return (json.loads(said) if code == 0 else None), complained.strip().split(" are not joined: ")[-1], seconds


def apart(one, other, place):
    (x, y, _), (u, v, _) = compose(one, (*place, 0.0)), compose(other, (*place, 0.0))
    return math.hypot(x - u, y - v)


def parts(logs):
    errors, refused = [], 0
    print("log | parts | error at the middle m | at B's first pose m | heading deg | stated m | support m | share | rival | misfit m | fit m | CPU s")
    for name, path in logs.items():
        map_parts(name, path, PARTS)
        if not (WORK / f"{name}.whole" / "map.yaml").exists():
            continue
        whole = trajectory(name, "whole")
        for first, second in PAIRS:
            if not all((WORK / f"{name}.{part}" / "map.yaml").exists() for part in (first, second)):
                continue
            trajectories = [trajectory(name, part) for part in (first, second)]
            (pose_a, fit_a), (pose_b, fit_b) = [laid_on(whole, part) for part in trajectories]
            truth = compose(inverse(pose_a), pose_b)
            found, why, seconds = joined(f"{name}.{first}", f"{name}.{second}")
            if found is None:
                refused += 1
                print(f"{name} | {first} {second} | refused: {why}")
                continue
            pose, start = found["a_from_b"], next(iter(trajectories[1].values()))
            error = apart(truth, pose, found["overlap_middle_b"])
            turn = abs(math.degrees(math.remainder(truth[2] - pose[2], 2 * math.pi)))
            rival = found["rival"]["support_m"] / found["support_m"] if found["rival"] else 0.0
            errors.append((error, turn, max(fit_a, fit_b)))
            print(
                f"{name} | {first} {second} | {error:.3f} | {apart(truth, pose, start[:2]):.3f} | {turn:.2f} | "
                f"{math.hypot(*found['deviations'][:2]):.3f} | {found['support_m']:.0f} | {found['share']:.2f} | {rival:.2f} | "
                f"{found['misfit_median_m']:.3f} | {max(fit_a, fit_b):.3f} | {seconds:.1f}"
            )
    within = sum(error <= 0.15 and turn <= 1.0 for error, turn, _ in errors)
    print(f"{len(errors)} of {len(errors) + refused} pairs joined, {within} of them within 0.15 m and 1 degree")


def unrelated(data, count):
    logs = logs_of(data)
    for name, path in logs.items():
        map_parts(name, path, ["whole", "half1", "half2"])
    for seed in FLOORS:
        floor = WORK / f"floor{seed}.whole"
        if not (floor / "map.yaml").exists():
            mapwright("demo", "--seed", seed, "-o", floor, "--quiet", "--threads", "1")
    names = [(name, f"{name}.{part}") for name in logs for part in ("whole", "half1", "half2")]
    names += [(f"floor{seed}", f"floor{seed}.whole") for seed in FLOORS]
    names = [(place_of(name), folder) for name, folder in names if (WORK / folder / "map.yaml").exists()]
    pairs = [(a, b) for (of_a, a), (of_b, b) in itertools.permutations(names, 2) if of_a != of_b]
    random.Random(1).shuffle(pairs)
    reasons, wrong, seconds = {}, [], []
    for number, (a, b) in enumerate(pairs[:count]):
        found, why, took = joined(a, b, "unrelated")
        seconds.append(took)
        if number % 20 == 19:
            print(f"{number + 1} pairs, {len(wrong)} joined", flush=True)
        if found is not None:
            wrong.append((a, b))
            print(f"joined: {a} {b} support {found['support_m']:.0f} m share {found['share']:.2f}")
        else:
            kinds = {"expected one pose": "ambiguous", "% of the walls": "contradicted", "expected a pose": "apart"}
            kind = next((kind for words, kind in kinds.items() if words in why), why)
            reasons[kind] = reasons.get(kind, 0) + 1
    print(f"{len(pairs[:count])} ordered pairs of different buildings: {len(wrong)} joined; refused: {reasons}")
    print(f"CPU a pair: median {sorted(seconds)[len(seconds) // 2]:.1f} s, at most {max(seconds):.1f} s")


def main():
    WORK.mkdir(parents=True, exist_ok=True)
    what, data = sys.argv[1], Path(sys.argv[2])
    if what == "halves":
        parts({name: data / f"{name}.clf.bz2" for name in ("intel", "fr079")})
    elif what == "logs":
        parts(logs_of(data))
    else:
        unrelated(data, int(sys.argv[3]))


main()
