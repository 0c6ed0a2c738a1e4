"""One robot of a team lies: the error of the others, beside the same team with nobody lying. The figures of docs/decisions/0038-liars.md.

    cargo build --release -p mapwright-cli
    python3 scripts/figures_liars.py ../shared/data/2d_benchmark [LIES] [POSITIONS]      # offset,scaled 1,3

intel in three, each part a robot of `mapwright fleet simulate` that starts anywhere; the liar is each of the three in turn and lies from 150 s
on. Scored are the relations whose poses are both of honest robots.

The binary is target/release/mapwright, or what MAPWRIGHT names; files go to target/figures/liars.
"""

import json
import sys
from pathlib import Path

from figures_fleet import cut, mapwright, stamps

WORK = Path("target/figures/liars")
LIES = ("offset", "rotation", "scaled", "replay", "forged", "solution")
ROBOTS = 3
LOSS = 0.1
FROM_S = 150


def honest_error(out, relations, liar):
    """Mean error of the relations between poses of all robots but this one; and how many there are."""
    said = json.loads((out / "fleet.json").read_text())
    names = [robot["name"] for robot in said["robots"]]
    of = {round(float(stamp), 4): robot for robot, name in enumerate(names) for stamp in stamps(out / f"trajectory-{name}.tum")}
    rows = [line for line in relations.read_text().splitlines() if line and not line.startswith("#")]
    ends = [[of.get(round(float(stamp), 4)) for stamp in row.split()[:2]] for row in rows]
    path = out / "honest.relations"
    path.write_text("\n".join(row for row, (a, b) in zip(rows, ends) if None not in (a, b) and liar not in (a, b)) + "\n")
    words = mapwright("eval", out / "trajectory.tum", "--relations", path).splitlines()[1].split()
    return float(words[2]), int(words[1]), said


def main():
    if not 2 <= len(sys.argv) <= 4:
        sys.exit(__doc__)
    data = Path(sys.argv[1])
    lies = sys.argv[2].split(",") if len(sys.argv) > 2 else LIES
    positions = [int(k) for k in sys.argv[3].split(",")] if len(sys.argv) > 3 else range(1, ROBOTS + 1)
    WORK.mkdir(parents=True, exist_ok=True)
    relations = data / "intel.relations"
    logs = cut(data / "intel.clf.bz2", "intel", ROBOTS, WORK)
    honest = WORK / "honest"
    mapwright("fleet", "simulate", *logs, "-o", honest, "--loss", LOSS)
    for position in positions:
        before, count, said = honest_error(honest, relations, position - 1)
        print(f"robot {position}, {count} relations of the others: {before:.4f} m, refused "
              f"{sum(r['times'] for robot in said['robots'] for r in robot['refused'])}", flush=True)
        for lie in lies:
            out = WORK / f"{lie}-{position}"
            mapwright("fleet", "simulate", *logs, "-o", out, "--loss", LOSS, "--lies", f"{position}:{lie}@{FROM_S}")
            error, _, said = honest_error(out, relations, position - 1)
            refused = {}
            for robot in said["robots"]:
                for why in robot["refused"]:
                    refused[(why["of"], why["why"])] = refused.get((why["of"], why["why"]), 0) + why["times"]
            times = sum(robot["team_s"] for robot in said["robots"])
            print(f"  {lie}: {error:.4f} m, ratio {error / before:.3f}; {said['pieces']} maps; team {times:.0f} s; {refused}", flush=True)


main()
