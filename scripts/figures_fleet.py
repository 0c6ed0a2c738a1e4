"""Logs cut into parts that robots drive at the same time, over a radio that loses messages: the figures of docs/decisions/0035-fleet.md and
0039-what-a-team-costs.md.

    cargo build --release -p mapwright-cli
    python3 scripts/figures_fleet.py ../shared/data/2d_benchmark        # intel in two and three, fr079 in two
    python3 scripts/figures_fleet.py ../shared/data/2d_benchmark intel/4        # one of them, or another cut

Each part is a robot of `mapwright fleet simulate`; nobody knows where it starts. Scored are all relations of the log, and those between
poses of different robots alone, each beside the whole log's error on the same relations. Cost is what a robot takes for its own map and for the
team, over its own map alone (`fleet.json`, elapsed: so do nothing else meanwhile).

The binary is target/release/mapwright, or what MAPWRIGHT names; files go to target/figures/fleet.
"""

import bz2
import json
import os
import subprocess
import sys
from pathlib import Path

BINARY = os.environ.get("MAPWRIGHT", "target/release/mapwright")
WORK = Path("target/figures/fleet")
CASES = (("intel", 2), ("intel", 3), ("fr079", 2))
LOSS = 0.3


def mapwright(*args):
    run = subprocess.run([BINARY, *map(str, args)], capture_output=True, text=True)
    if run.returncode not in (0, 3):
        sys.exit(run.stderr)
    return run.stdout


def cut(log, name, parts, folder=WORK):
    """The log in parts by its scans, each beginning with the log's parameters; and the stamp with which each part ends."""
    with bz2.open(log, "rt", errors="replace") as file:
        lines = file.readlines()
    scans = [at for at, line in enumerate(lines) if line.startswith(("FLASER", "ROBOTLASER"))]
    head = [line for line in lines if line.startswith("PARAM")]
    bounds = [len(scans) * k // parts for k in range(parts + 1)]
    paths = []
    for k in range(parts):
        first, end = bounds[k], bounds[k + 1]
        body = lines[scans[first] : scans[end] if end < len(scans) else None]
        path = folder / f"{name}-{parts}.{k}.clf"
        path.write_text("".join((lines[: scans[0]] if k == 0 else head) + body))
        paths.append(path)
    return paths


def stamps(tum):
    return [line.split()[0] for line in tum.read_text().splitlines() if line and not line.startswith("#")]


def error(out, relations):
    words = mapwright("eval", out / "trajectory.tum", "--relations", relations).splitlines()[1].split()
    return float(words[2]), int(words[1])


def across(relations, robots, path):
    """The relations between poses of different robots."""
    of = {}
    for robot, tum in enumerate(robots):
        of.update({round(float(stamp), 4): robot for stamp in stamps(tum)})
    rows = [line for line in relations.read_text().splitlines() if line and not line.startswith("#")]
    ends = [[of.get(round(float(stamp), 4)) for stamp in row.split()[:2]] for row in rows]
    path.write_text("\n".join(row for row, (a, b) in zip(rows, ends) if a is not None and b is not None and a != b) + "\n")
    return path


def main():
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    chosen = [(name, int(parts)) for name, parts in (case.split("/") for case in sys.argv[2:])]
    data = Path(sys.argv[1])
    WORK.mkdir(parents=True, exist_ok=True)
    for name, parts in chosen or CASES:
        relations = data / f"{name}.relations"
        mapwright("map", data / f"{name}.clf.bz2", "-o", WORK / name, "--quiet")
        out = WORK / f"{name}-{parts}"
        mapwright("fleet", "simulate", *cut(data / f"{name}.clf.bz2", name, parts), "-o", out, "--loss", LOSS)
        said = json.loads((out / "fleet.json").read_text())
        robots = [out / f"trajectory-{robot['name']}.tum" for robot in said["robots"]]
        between = across(relations, robots, WORK / f"{name}-{parts}.relations")
        (whole, count), (team, _) = error(WORK / name, relations), error(out, relations)
        (whole_across, count_across), (team_across, _) = error(WORK / name, between), error(out, between)
        told = said["bytes_per_keyframe"]
        costs = [(robot["map_s"] + robot["team_s"]) / robot["map_s"] for robot in said["robots"]]
        print(f"{name} in {parts}: all {count} relations {team:.4f} m (whole log {whole:.4f}, ratio {team / whole:.3f}); "
              f"{count_across} between robots {team_across:.4f} ({whole_across:.4f}, {team_across / whole_across:.3f}); "
              f"{said['pieces']} map, agreed after {said['agreed_s']} s, {told['mapped']:.0f} + {told['solution']:.0f} bytes a keyframe, "
              f"team {', '.join(format(robot['team_s'], '.1f') for robot in said['robots'])} s beside "
              f"{', '.join(format(robot['map_s'], '.1f') for robot in said['robots'])} s of mapping: "
              f"cost mean {sum(costs) / len(costs):.2f}, worst {max(costs):.2f}", flush=True)


if __name__ == "__main__":
    main()
