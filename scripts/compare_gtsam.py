"""Solve only, same start: mapwright against GTSAM's Gauss-Newton and Levenberg-Marquardt, fastest of 21 runs each, in three
rounds of seven in turn, so that what else the machine does for a while does not meet one of them alone.

    pip install gtsam
    cargo build --release -p mapwright-graph --example solve_g2o
    python3 scripts/compare_gtsam.py target/release/examples/solve_g2o ../shared/data/g2o

GTSAM takes the information of rotations in space as that of angles; mapwright is told to do the same (`--angles`).
Chi-square is twice GTSAM's error without the prior that holds the first pose.
"""

import subprocess
import sys
import time

import gtsam

GRAPHS = [("M3500", False), ("intel", False), ("sphere2500", True), ("parking-garage", True)]
RUNS = 7
ROUNDS = 3


def load(path, spatial):
    graph, start = gtsam.readG2o(path, spatial)
    first = start.keys()[0]
    if spatial:
        noise = gtsam.noiseModel.Isotropic.Sigma(6, 1e-6)
        graph.add(gtsam.PriorFactorPose3(first, start.atPose3(first), noise))
    else:
        noise = gtsam.noiseModel.Isotropic.Sigma(3, 1e-6)
        graph.add(gtsam.PriorFactorPose2(first, start.atPose2(first), noise))
    return graph, start


def timed(optimizer, settings, graph, start):
    best_ms, chi2 = float("inf"), 0.0
    for _ in range(RUNS):
        began = time.perf_counter()
        result = optimizer(graph, start, settings).optimize()
        best_ms = min(best_ms, 1e3 * (time.perf_counter() - began))
        chi2 = 2 * graph.error(result)
    return best_ms, chi2


def solved(solve, path):
    """What the solver prints, and the milliseconds in it."""
    line = subprocess.run([solve, "--angles", path], capture_output=True, text=True, check=True).stdout.strip()
    return float(line.split()[1]), line


def main(solve, folder):
    optimizers = [
        ("GTSAM GN", gtsam.GaussNewtonOptimizer, gtsam.GaussNewtonParams()),
        ("GTSAM LM", gtsam.LevenbergMarquardtOptimizer, gtsam.LevenbergMarquardtParams()),
    ]
    for name, spatial in GRAPHS:
        path = f"{folder}/{name}.g2o"
        graph, start = load(path, spatial)
        ours, theirs = [], [[] for _ in optimizers]
        for _ in range(ROUNDS):
            ours.append(solved(solve, path))
            for results, (_, optimizer, settings) in zip(theirs, optimizers):
                results.append(timed(optimizer, settings, graph, start))
        our_ms, line = min(ours)
        print(line)
        for (label, _, _), results in zip(optimizers, theirs):
            milliseconds, chi2 = min(results)
            print(f"  {label:20} {milliseconds:8.1f} ms  chi2 {chi2:.6f}  {milliseconds / our_ms:.1f} times")


if __name__ == "__main__":
    main(*sys.argv[1:])
