#!/usr/bin/env python3
"""Runs recorded and replayed, killed, and cut as by a power cut; prints how many came back whole.

Usage: python3 tests/sessions.py FOLDER [hour]. Recordings go into FOLDER, which is emptied. With `hour` an hour of a hall with three cameras is recorded
instead, without pictures. The program is FOVEATE_PROGRAM, or that of a release build.
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


def failing(folder):
    """The room with a filter that dies at each 60th message and is made again."""
    script = Path(folder) / "dies.py"
    script.write_text(
        f"import sys\nsys.path.insert(0, {str(ROOT / 'examples/python')!r})\nfrom foveate_node import run\n"
        "n = 0\ndef filter(message):\n    global n\n    n += 1\n    if n == 60:\n        sys.exit('the 60th')\n"
        "    return [('targets', message.value)]\nrun({'targets': filter})\n"
    )
    for name in ("lab.plan.toml", "face_body.calibration.toml"):
        shutil.copy(ROOT / "graphs" / name, folder)
    rig = (ROOT / "graphs/room.toml").read_text()
    path = Path(folder) / "failing.toml"
    path.write_text(
        f'{rig}\n[scale.room.node.dies]\ntype = "process.filter"\ncommand = ["{sys.executable}", "dies.py"]\non_error = "restart"\n'
        'in = { targets = "targets.targets" }\n[scale.room.node.after]\ntype = "export.targets"\nfile = "after.csv"\n'
        'in = { targets = "dies.targets" }\n'
    )
    return path


def replayed(rig, seed, live, folder):
    """Records one run and replays it from its file alone; whether every file is the same, and how many messages were dropped."""
    run = folder / "run"
    session = folder / "s.mcap"
    arguments = ["run", rig, "--seed", seed, "--duration", 3, "--quiet", "--record", session, "--out", run]
    ended = foveate(*arguments, *(["--live"] if live else []))
    again = foveate("replay", session, "--quiet", "--out", folder / "again")
    if ended.returncode not in (0, 2, 3) or again.returncode != ended.returncode:
        print(f"{rig} {seed} live={live}: {ended.stderr[-500:]}{again.stderr[-500:]}", file=sys.stderr)
        return False, 0, 0
    a, b = files(run), files(folder / "again")
    # What simulated judges write, and how fast it was.
    judged = {name for name in a if name not in b and ("score" in name or name.startswith("marks_"))}
    for one in (a, b):
        one["summary.json"] = b"\n".join(it for it in one["summary.json"].splitlines() if b"real_time_factor" not in it)
    different = [name for name in a if name not in judged and a[name] != b.get(name)]
    if different:
        print(f"{rig} {seed} live={live}: {different} differ", file=sys.stderr)
    summary = json.loads((run / "summary.json").read_text())
    return not different, summary["messages.dropped"], summary["faults"]


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


# Opens a file as foveate's own reader has to, and reads the first message at each of the times.
PEER = """
import sys, time
from mcap.reader import make_reader
took = []
for at in sys.argv[2:]:
    began = time.perf_counter()
    with open(sys.argv[1], "rb") as file:
        next(make_reader(file).iter_messages(start_time=int(float(at) * 1e9)))
    took.append((time.perf_counter() - began) * 1e3)
took.sort()
print(f"PyPI mcap opens and reads at any time: median {took[len(took) // 2]:.1f} ms, worst {took[-1]:.1f} ms")
"""


def memory_mb(*arguments):
    """Runs the program; the most memory that it had."""
    child = subprocess.Popen([PROGRAM, *map(str, arguments)], cwd=ROOT)
    _, status, usage = os.wait4(child.pid, 0)
    assert os.waitstatus_to_exitcode(status) in (0, 3), arguments
    return usage.ru_maxrss / 1e3


def hour(out):
    """Memory of a recording by its length, and the time to any place in an hour."""
    rig = out / "hall.toml"
    subprocess.run([PROGRAM, "new", "rig", "hall", "--cameras", "3"], cwd=out, check=True, capture_output=True)
    # Without what keeps the whole run for its pictures and scores.
    rig.write_text(rig.read_text().split("[scale.room.node.pictures]")[0])
    memory = {}
    for seconds in (60, 3600):
        session = out / f"{seconds}.mcap"
        memory[seconds] = memory_mb("run", rig, "--duration", seconds, "--quiet", "--out", out / "run", "--record", session)
        print(f"recording of {seconds} s: {session.stat().st_size / 1e9:.2f} GB, {memory[seconds]:.0f} MB of memory", flush=True)
    print(f"memory of an hour's recording less that of a minute's: {memory[3600] - memory[60]:.0f} MB", flush=True)
    draw = random.Random(30001)
    times = [draw.uniform(0, 3599) for _ in range(20)]
    took = []
    for n, at in enumerate(times):
        part = out / f"part{n}.mcap"
        began = time.perf_counter()
        assert foveate("cut", session, part, "--start", at, "--end", at + 0.05).returncode == 0
        took.append((time.perf_counter() - began) * 1e3)
    took.sort()
    began = time.perf_counter()
    for _ in range(20):
        foveate("--version")
    start = (time.perf_counter() - began) / 20 * 1e3
    print(f"a twentieth of a second cut out of it: median {took[10] - start:.1f} ms, worst {took[-1] - start:.1f} ms, beyond the {start:.1f} ms that the program takes to start", flush=True)
    if "FOVEATE_PEER_PYTHON" in os.environ:
        subprocess.run([os.environ["FOVEATE_PEER_PYTHON"], "-c", PEER, str(session), *map(str, times)], check=True)


def main():
    out = Path(sys.argv[1]).absolute()
    shutil.rmtree(out, ignore_errors=True)
    if sys.argv[2:] == ["hour"]:
        out.mkdir(parents=True)
        hour(out)
        return shutil.rmtree(out)

    def each(name, count, what):
        good = 0
        for n in range(count):
            folder = out / name / str(n)
            folder.mkdir(parents=True)
            good += what(n, folder)
            shutil.rmtree(folder)
        return good

    out.mkdir(parents=True)
    rigs = ["graphs/room.toml", "graphs/face_body.toml", "graphs/two_targets.toml", busy(out), failing(out)]
    counts = [0, 0]

    def one(live):
        def run(n, folder):
            same, *found = replayed(rigs[n % len(rigs)], 30001 + n, live, folder)
            counts[:] = [sum(it) for it in zip(counts, found)]
            return same

        return run

    print(f"simulated runs replayed to the same bytes: {each('simulated', 20, one(False))} of 20", flush=True)
    print(f"live runs replayed to the same bytes: {each('live', 20, one(True))} of 20", flush=True)
    print(f"in these runs: {counts[0]} messages dropped, {counts[1]} failures of a node that was made again", flush=True)
    print(f"killed runs that open and replay: {each('killed', 20, lambda n, folder: killed(30001 + n, folder))} of 20", flush=True)
    whole = out / "whole.mcap"
    foveate("run", "graphs/room.toml", "--live", "--duration", 3, "--quiet", "--record", whole, "--out", out / "whole")
    whole = whole.read_bytes()
    print(f"power cuts after which it opens and replays: {each('cut', 20, lambda n, folder: cut(whole, 30001 + n, folder))} of 20")
    shutil.rmtree(out)


if __name__ == "__main__":
    PROGRAM = program()
    main()
