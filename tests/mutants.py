#!/usr/bin/env python3
"""Holds the tests of single crates against a sample of small changes of their code ("mutants"): a change that no test notices is named.

    python3 tests/mutants.py SEED COUNT [TABLE]

Needs `cargo install cargo-mutants --locked`, which lists the changes; they are made and taken back here, so run it in a tree of its own (`git worktree add`).
Each mutant is a line of TABLE (`mutants.tsv`): caught, missed, timeout or unviable, a tab, and what was changed. Those that have a line are left out, so that a
sample that was interrupted goes on. Within a crate the order is the sample's; crates are taken one after the other, which compiles less. A longer sample begins
with the shorter one: COUNT raised in steps gives each crate its share where time is short.
"""

import json
import os
import random
import subprocess
import sys
from pathlib import Path

CRATES = ["estimation", "geometry", "rig", "select", "engine", "led", "painted-mark", "surface", "export"]
# Tests that take longer do not come back [s].
PATIENCE_S = 300


def mutants():
    """All changes of all crates, in the order of the list."""
    for crate in CRATES:
        command = ["cargo", "mutants", "--list", "--json", "--diff", "--package", f"foveate-{crate}"]
        yield from json.loads(subprocess.run(command, check=True, capture_output=True).stdout)


def patch(mutant, *options):
    subprocess.run(["patch", "--quiet", *options, mutant["file"]], input=mutant["diff"], text=True, check=True)


def cargo(package, *options):
    """The exit code of the tests; `None` where they do not end."""
    command = ["cargo", "test", "--quiet", "--package", package, *options]
    # No mutant is to fail by a random case that another one left in a file.
    environment = os.environ | {"PROPTEST_DISABLE_FAILURE_PERSISTENCE": "1"}
    # A group of its own: what does not end has children.
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    with subprocess.Popen(command, **quiet, env=environment, start_new_session=True) as tests:
        try:
            return tests.wait(timeout=None if "--no-run" in options else PATIENCE_S)
        except subprocess.TimeoutExpired:
            os.killpg(tests.pid, 9)
            return None


def outcome(mutant):
    patch(mutant)
    try:
        if cargo(mutant["package"], "--lib", "--no-run") != 0:
            return "unviable"
        # Most are noticed beside the code; the other tests are compiled for the rest only.
        for targets in (["--lib"], []):
            if (code := cargo(mutant["package"], *targets)) != 0:
                return "timeout" if code is None else "caught"
        return "missed"
    finally:
        patch(mutant, "--reverse")


def main():
    seed, count = int(sys.argv[1]), int(sys.argv[2])
    table = Path(sys.argv[3] if len(sys.argv) > 3 else "mutants.tsv")
    everything = list(mutants())
    sample = random.Random(seed).sample(everything, len(everything))[:count]
    order = {f"foveate-{crate}": place for place, crate in enumerate(CRATES)}
    sample.sort(key=lambda it: order[it["package"]])
    lines = table.read_text().splitlines() if table.exists() else []
    done = {line.split("\t")[1] for line in lines}
    for mutant in sample:
        if mutant["name"] not in done:
            lines.append(f"{outcome(mutant)}\t{mutant['name']}")
            print(lines[-1], flush=True)
            table.write_text("\n".join(lines) + "\n")
    found = [line.split("\t")[0] for line in lines]
    print(", ".join(f"{found.count(it)} {it}" for it in sorted(set(found))))


if __name__ == "__main__":
    main()
