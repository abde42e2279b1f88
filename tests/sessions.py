#!/usr/bin/env python3
"""Runs recorded and replayed, killed, and cut as by a power cut; prints how many came back whole.

Usage: python3 tests/sessions.py FOLDER (for recordings; made anew). The program is FOVEATE_PROGRAM, or that of a release build.
"""
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# What the simulated world writes itself, and how fast the machine was.
NOT_AGAIN = {"session.mcap", "timing.json", "truth.csv", "truth.calibration.toml"}


def program():
    if "FOVEATE_PROGRAM" in os.environ:
        return os.environ["FOVEATE_PROGRAM"]
    build = ["cargo", "build", "--quiet", "--release", "-p", "foveate-cli", "--message-format", "json-render-diagnostics"]
    lines = subprocess.run(build, cwd=ROOT, check=True, capture_output=True, text=True).stdout.splitlines()
    found = [json.loads(line).get("executable") for line in lines if line.startswith("{")]
    return next(it for it in found if it)


def foveate(*arguments):
    return subprocess.run([PROGRAM, *map(str, arguments)], cwd=ROOT, capture_output=True, text=True)


def files(folder):
    return {it.name: it.read_bytes() for it in Path(folder).iterdir() if it.is_file() and it.name not in NOT_AGAIN}


def busy(folder):
    """The room with detectors that cannot keep up, so that messages are dropped."""
    rig = (ROOT / "graphs/room.toml").read_text().replace("[rig]", f'[rig]\nfolder = "{ROOT}/graphs"', 1)
    path = Path(folder) / "busy.toml"
    path.write_text(rig.replace('type = "led.detector"', 'type = "led.detector"\ncost_ms = 12'))
    return path


def replayed(rig, seed, live, folder):
    """Records one run and replays it from its file alone; whether every file is the same, and how many messages were dropped."""
    run = folder / "run"
    session = folder / "s.mcap"
    arguments = ["run", rig, "--seed", seed, "--duration", 3, "--quiet", "--record", session, "--out", run]
    ended = foveate(*arguments, *(["--live"] if live else []))
    again = foveate("replay", session, "--quiet", "--out", folder / "again")
    if ended.returncode not in (0, 3) or again.returncode != ended.returncode:
        print(f"{rig} {seed} live={live}: {ended.stderr[-500:]}{again.stderr[-500:]}", file=sys.stderr)
        return False, 0
    a, b = files(run), files(folder / "again")
    # What simulated judges write, and how fast it was.
    judged = {name for name in a if name not in b and ("score" in name or name.startswith("marks_"))}
    for one in (a, b):
        one["summary.json"] = b"\n".join(it for it in one["summary.json"].splitlines() if b"real_time_factor" not in it)
    different = [name for name in a if name not in judged and a[name] != b.get(name)]
    if different:
        print(f"{rig} {seed} live={live}: {different} differ", file=sys.stderr)
    return not different, json.loads((run / "summary.json").read_text())["messages.dropped"]


def killed(seed, folder):
    """Kills a live run at a random moment; whether the file opens, is mended, and holds all but the last half second."""
    session = folder / "s.mcap"
    arguments = ["run", "graphs/room.toml", "--live", "--seed", str(seed), "--duration", "1000", "--quiet", "--record"]
    child = subprocess.Popen([PROGRAM, *arguments, str(session), "--out", str(folder / "run")], cwd=ROOT)
    while not session.exists() or session.stat().st_size < 500_000:
        time.sleep(0.01)
    began = time.monotonic()
    time.sleep(random.Random(seed).uniform(0.5, 3.0))
    child.send_signal(signal.SIGKILL)
    lived = time.monotonic() - began
    child.wait()
    said = foveate("info", session)
    again = foveate("replay", session, "--quiet", "--out", folder / "again")
    if said.returncode or again.returncode not in (0, 2, 3) or not (folder / "again/summary.json").exists():
        print(f"killed {seed}: {said.stderr}{again.stderr}", file=sys.stderr)
        return False
    lasted = json.loads((folder / "again/summary.json").read_text())["session_s"]
    if lasted < lived - 0.5:
        print(f"killed {seed}: {lasted:.2f} s after {lived:.2f} s", file=sys.stderr)
    return "did not end in good order" in said.stdout and lasted >= lived - 0.5


def cut(whole, seed, folder):
    """A power cut: a file that ends anywhere, with zeros or anything in its last block; whether it opens and replays."""
    draw = random.Random(seed)
    kept = whole[: draw.randrange(len(whole) // 10, len(whole))]
    tail = draw.choice([b"", bytes(4096), draw.randbytes(4096)])
    session = folder / "s.mcap"
    session.write_bytes(kept + tail)
    said = foveate("info", session)
    again = foveate("replay", session, "--quiet", "--out", folder / "again")
    good = said.returncode == 0 and (folder / "again/summary.json").exists()
    if not good:
        print(f"cut {seed}: {said.stdout}{said.stderr}{again.stderr}", file=sys.stderr)
    return good


def main():
    out = Path(sys.argv[1])
    shutil.rmtree(out, ignore_errors=True)

    def each(name, count, what):
        good = 0
        for n in range(count):
            folder = out / name / str(n)
            folder.mkdir(parents=True)
            good += what(n, folder)
            shutil.rmtree(folder)
        return good

    out.mkdir(parents=True)
    rigs = ["graphs/room.toml", "graphs/face_body.toml", "graphs/two_targets.toml", busy(out)]
    dropped = [0]

    def one(live):
        def run(n, folder):
            same, lost = replayed(rigs[n % len(rigs)], 30001 + n, live, folder)
            dropped[0] += lost
            return same

        return run

    print(f"simulated runs replayed to the same bytes: {each('simulated', 20, one(False))} of 20", flush=True)
    print(f"live runs replayed to the same bytes: {each('live', 20, one(True))} of 20", flush=True)
    print(f"messages dropped in these runs: {dropped[0]}", flush=True)
    print(f"killed runs that open and replay: {each('killed', 20, lambda n, folder: killed(30001 + n, folder))} of 20", flush=True)
    whole = out / "whole.mcap"
    foveate("run", "graphs/room.toml", "--live", "--duration", 3, "--quiet", "--record", whole, "--out", out / "whole")
    whole = whole.read_bytes()
    print(f"power cuts after which it opens and replays: {each('cut', 20, lambda n, folder: cut(whole, 30001 + n, folder))} of 20")
    shutil.rmtree(out)


PROGRAM = program()
main()
