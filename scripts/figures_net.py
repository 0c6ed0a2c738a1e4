"""Three robots as processes on a network of their own that loses packets: the figures of docs/decisions/0036-net.md.

    cargo build --release -p mapwright-cli --features net
    python3 scripts/figures_net.py ../shared/data/2d_benchmark/intel.clf.bz2

Needs root, iproute2 and nftables (apt-get install nftables), and a kernel with network namespaces; where these are missing it says so and
ends. Each robot is a process in a namespace, all on one bridge in a fourth one: nothing leaves this computer, and nothing stays. Packets are
dropped where they come in, 30 of 100, by nftables' numgen; TLS goes over TCP with the computer's own settings.

Measured are: how long it takes from the start, and after 15 s in which one robot is cut off, until the last robot holds the last record of
what any of them has mapped; and until the map of each has all keyframes.

The binary is target/release/mapwright, or what MAPWRIGHT names; files go to target/figures/net.
"""

import bz2
import json
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

BINARY = os.environ.get("MAPWRIGHT", "target/release/mapwright")
WORK = Path("target/figures/net")
ROBOTS = ("anna", "bert", "carl")
PREFIX = f"mw{os.getpid() % 10000}"
HUB = f"{PREFIX}hub"
# Of the log: its robots have some 600 records to tell.
SHARE = 0.6
LOSS_PERCENT = 30
CUT_OFF_S = 15
AT_MOST_S = 420


def sh(*words, check=True):
    run = subprocess.run([str(word) for word in words], capture_output=True, text=True)
    if check and run.returncode != 0:
        raise RuntimeError(f"{' '.join(map(str, words))}: {run.stderr.strip()}")
    return run


def namespace(k):
    return f"{PREFIX}r{k}"


def inside(k, *words):
    return sh("ip", "netns", "exec", namespace(k), *words)


def make_network():
    sh("ip", "netns", "add", HUB)
    sh("ip", "-n", HUB, "link", "add", "bridge", "type", "bridge")
    sh("ip", "-n", HUB, "link", "set", "bridge", "up")
    for k in range(len(ROBOTS)):
        sh("ip", "netns", "add", namespace(k))
        sh("ip", "link", "add", "air", "netns", namespace(k), "type", "veth", "peer", "name", f"r{k}", "netns", HUB)
        sh("ip", "-n", HUB, "link", "set", f"r{k}", "master", "bridge", "up")
        sh("ip", "-n", namespace(k), "addr", "add", f"10.78.0.{k + 1}/24", "dev", "air")
        sh("ip", "-n", namespace(k), "link", "set", "air", "up")
        sh("ip", "-n", namespace(k), "link", "set", "lo", "up")
        inside(k, "nft", "add table inet radio")
        for way, hook in (("in", "input"), ("out", "output")):
            inside(k, "nft", f"add chain inet radio {way} {{ type filter hook {hook} priority 0; }}")


def lose(percent):
    for k in range(len(ROBOTS)):
        inside(k, "nft", "flush table inet radio")
        if percent:
            inside(k, "nft", f'add rule inet radio in iifname "air" numgen random mod 100 < {percent} drop')


def cut_off(k):
    for way, name in (("in", "iifname"), ("out", "oifname")):
        inside(k, "nft", f'insert rule inet radio {way} {name} "air" drop')


def remove_network():
    for name in [namespace(k) for k in range(len(ROBOTS))] + [HUB]:
        sh("ip", "netns", "del", name, check=False)


def cut(log, parts):
    """The log in parts by its scans, each beginning with the log's parameters."""
    with bz2.open(log, "rt", errors="replace") as file:
        lines = file.readlines()
    scans = [at for at, line in enumerate(lines) if line.startswith(("FLASER", "ROBOTLASER"))]
    head = [line for line in lines if line.startswith("PARAM")]
    bounds = [int(SHARE * len(scans)) * k // parts for k in range(parts + 1)]
    paths = []
    for k in range(parts):
        first, end = bounds[k], bounds[k + 1]
        body = lines[scans[first] : scans[end] if end < len(scans) else None]
        path = WORK / f"part-{k}.clf"
        path.write_text("".join((lines[: scans[0]] if k == 0 else head) + body))
        paths.append(path)
    return paths


def start(logs, name, *more):
    runs = []
    for k, robot in enumerate(ROBOTS):
        words = [BINARY, "fleet", "join", logs[k], "--config", WORK / "team" / robot / "robot.toml", *more]
        words += ["-o", WORK / name / robot]
        words = ["ip", "netns", "exec", namespace(k), *map(str, words)]
        file = (WORK / f"{name}-{robot}.txt").open("w")
        runs.append(subprocess.Popen(words, stdout=file, stderr=subprocess.STDOUT))
    return runs


def wait(runs):
    end = time.time() + AT_MOST_S
    for run in runs:
        try:
            run.wait(max(1, end - time.time()))
        except subprocess.TimeoutExpired:
            run.kill()
            sys.exit(f"a robot was not done after {AT_MOST_S} s: see {WORK}")


def row(name, since):
    """Seconds after `since` until the last robot held all that was mapped, and had it in its map."""
    reports = [json.loads((WORK / name / robot / "fleet.json").read_text()) for robot in ROBOTS]
    sessions = {(WORK / name / robot / "session.mapwright").read_bytes() for robot in ROBOTS}
    records = {report["records_mapped"]["count"] for report in reports}
    driven = max(report["log_over_clock_s"] for report in reports) - since
    held = max(report["records_mapped"]["since_clock_s"] for report in reports) - since
    in_map = max(report["keyframes_in_map"]["since_clock_s"] for report in reports) - since
    of_all = sum(chain["records"] for chain in reports[0]["own"]["holds"])
    same = "same bytes" if len(sessions) == 1 else f"{len(sessions)} different sessions"
    mapped = ", ".join(map(str, sorted(records)))
    print(f"{name:<24} {mapped:>7} records mapped, {of_all:>4} in all; driven {driven:6.1f} s, held by all {held:6.1f} s, ", end="")
    print(f"in every map {in_map:6.1f} s; {same}", flush=True)


def main():
    if len(sys.argv) not in (2, 3):
        sys.exit(__doc__)
    if os.geteuid() != 0 or not shutil.which("ip") or not shutil.which("nft"):
        sys.exit("skipped: needs root, ip and nft")
    shutil.rmtree(WORK, ignore_errors=True)
    WORK.mkdir(parents=True)
    logs = cut(sys.argv[1], len(ROBOTS))
    places = [f"{robot}@10.78.0.{k + 1}" for k, robot in enumerate(ROBOTS)]
    sh(BINARY, "fleet", "keys", *places, "-o", WORK / "team")
    try:
        make_network()
    except RuntimeError as why:
        remove_network()
        sys.exit(f"skipped: {why}")
    try:
        print("TCP:", inside(0, "cat", "/proc/sys/net/ipv4/tcp_congestion_control").stdout.strip(), flush=True)
        only = sys.argv[2:]  # cut-off: that alone
        for percent in () if only else (0, LOSS_PERCENT):
            lose(percent)
            begun = time.time()
            wait(start(logs, f"loss-{percent}", "--rate", "max"))
            row(f"loss-{percent}", begun)
        for percent in (0, LOSS_PERCENT):
            lose(percent)
            # The logs are over within the time in which the last robot is cut off.
            runs = start(logs, f"cut-off-loss-{percent}", "--rate", "30", "--stay", "30")
            time.sleep(10)
            cut_off(len(ROBOTS) - 1)
            time.sleep(CUT_OFF_S)
            lose(percent)
            healed = time.time()
            wait(runs)
            row(f"cut-off-loss-{percent}", healed)
    finally:
        remove_network()


if __name__ == "__main__":
    main()
