#!/usr/bin/env python3
"""Builds and runs our own hop and those of other data-flow systems, one after the other, and prints one table.

    python3 tests/benches/peers/run.py            (from the repository's root)

Needs: the Rust toolchain; for GStreamer `libgstreamer1.0-dev libgstreamer-plugins-base1.0-dev` and a C compiler; for MediaPipe
`pip install mediapipe==0.10.21` for the Python named by --mediapipe (later wheels have no graphs). What is missing is left out, with a line
that says so. Runs under `chrt -f 10` where that is allowed. Every figure is (time of a message through the long chain - through
the short one) / the difference of their lengths, the least of several rounds; one message is on its way at a time.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[2]
BUILD = ROOT / "target" / "peers"


class Missing(Exception):
    pass


def run(command, **options):
    result = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)
    if result.returncode:
        raise Missing(f"{command[0]}: {(result.stderr or result.stdout).strip().splitlines()[-1:]}")
    return result.stdout


def real_time():
    """What to put before a command so that other programs disturb it less."""
    chrt = ["chrt", "-f", "10"]
    try:
        return chrt if shutil.which("chrt") and subprocess.run([*chrt, "true"], stderr=subprocess.DEVNULL).returncode == 0 else []
    except OSError:
        return []


def slope(program, short, long, rounds):
    """Nanoseconds a hop: `program(length)` gives the time of a message through a chain."""
    ends = [min(program(length) for _ in range(rounds)) for length in (short, long)]
    return (ends[1] - ends[0]) / (long - short)


def ours(first):
    run(["cargo", "bench", "--quiet", "--no-run", "-p", "foveate-tests", "--bench", "hop", "--bench", "hop_threads"], cwd=ROOT)
    hop = run([*first, "cargo", "bench", "--quiet", "-p", "foveate-tests", "--bench", "hop"], cwd=ROOT)
    threads = run([*first, "cargo", "bench", "--quiet", "-p", "foveate-tests", "--bench", "hop_threads"], cwd=ROOT)

    def row(text, name):
        return float(re.search(rf"^ *{name} .* ([-\d.]+) ns *$", text, re.M).group(1))

    return [
        ("Foveate, ledger on", "in-thread", row(hop, "64 B"), row(hop, "1 MiB")),
        ("Foveate, ledger on, p50", "cross-thread", row(threads, "p50"), None),
    ]


def copper(first, rounds):
    target = BUILD / "copper"
    run(["cargo", "build", "--quiet", "--release", "--target-dir", str(target)], cwd=HERE / "copper")
    program = target / "release" / "foveate-peer-copper"

    def chain(kind):
        return slope(lambda length: float(run([*first, str(program), f"{kind}{length}"]).split()[-1]), 4, 32, rounds)

    return [
        ("copper-rs 1.3.1, log off", "in-thread", chain("small"), chain("large")),
        ("copper-rs 1.3.1, log on", "in-thread", chain("logged"), None),
    ]


def gstreamer(first, rounds):
    if not shutil.which("pkg-config"):
        raise Missing("no pkg-config")
    flags = run(["pkg-config", "--cflags", "--libs", "gstreamer-1.0", "gstreamer-app-1.0"]).split()
    version = run(["pkg-config", "--modversion", "gstreamer-1.0"]).strip()
    program = BUILD / "gstreamer_hop"
    BUILD.mkdir(parents=True, exist_ok=True)
    run(["cc", "-O2", str(HERE / "gstreamer_hop.c"), "-o", str(program), *flags])

    def chain(size, short, long, *more):
        return slope(lambda n: float(run([*first, str(program), str(n), str(size), "5000", *more])), short, long, rounds)

    return [
        (f"GStreamer {version} identity", "in-thread", chain(64, 4, 32), chain(1 << 20, 4, 32)),
        (f"GStreamer {version} identity ! queue", "cross-thread", chain(64, 2, 10, "queue"), None),
    ]


def mediapipe(first, rounds, python):
    run([python, "-c", "import mediapipe"])

    def chain(size):
        command = lambda n: [*first, python, str(HERE / "mediapipe_hop.py"), str(n), str(size), "2000"]
        return slope(lambda n: float(run(command(n))), 4, 32, rounds)

    return [("MediaPipe 0.10.21, one thread", "in-thread", chain(64), chain(1 << 20))]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=5, help="of each peer; the least counts")
    parser.add_argument("--mediapipe", default=sys.executable, metavar="PYTHON", help="a Python that has mediapipe 0.10.21")
    options = parser.parse_args()
    first = real_time()
    rows, left_out = [], []
    for name, work in [
        ("Foveate", lambda: ours(first)),
        ("copper-rs", lambda: copper(first, options.rounds)),
        ("GStreamer", lambda: gstreamer(first, options.rounds)),
        ("MediaPipe", lambda: mediapipe(first, options.rounds, options.mediapipe)),
    ]:
        print(f"{name} ...", file=sys.stderr, flush=True)
        try:
            rows += work()
        except Missing as missing:
            left_out.append(f"left out: {name}: {missing}")
    load = os.getloadavg()
    print(f"load {load[0]:.1f} over the last minute, {load[1]:.1f} over five, {os.cpu_count()} cores, {' '.join(first) or 'no real-time priority'}")
    print(f"{'a hop':40} {'':14} {'64 B':>12} {'1 MiB':>12}")
    for name, where, small, large in rows:
        cell = lambda ns: "–" if ns is None else f"{ns:.0f} ns" if ns < 2000 else f"{ns / 1000:.2f} µs"
        print(f"{name:40} {where:14} {cell(small):>12} {cell(large):>12}")
    print("cross-process: none of these")
    print(*left_out, sep="\n", end="\n" if left_out else "")


if __name__ == "__main__":
    main()
