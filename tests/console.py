#!/usr/bin/env python3
"""What two viewers of the console cost: processor time of a program that plays the reference rig's 22 cameras at 30 Hz, with and without them.

Usage: python3 tests/console.py FOLDER. The cameras of graphs/face_body.toml are recorded once into FOLDER, which is emptied; a rig plays them at the pace of the wall clock and finds lights and
marks in them. Two viewers look at what the page's grid looks at: every camera at 320 px and 5 Hz, what was found in them at 15 Hz. A third one never reads. The program is FOVEATE_PROGRAM, or that
of a release build.
"""
import base64
import json
import os
import shutil
import socket
import statistics
import struct
import subprocess
import sys
import threading
import time
from pathlib import Path

from sessions import ROOT, program

SECONDS = 10
ROUNDS = 5


class Viewer(threading.Thread):
    """A window that subscribes to the grid of cameras, and reads without drawing."""

    def __init__(self, address, reads=True):
        super().__init__(daemon=True)
        host, port = address.split("/")[2].split(":")
        self.socket = socket.create_connection((host, int(port)))
        key = base64.b64encode(os.urandom(16)).decode()
        self.socket.sendall(
            f"GET /console/socket HTTP/1.1\r\nHost: {host}:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
            f"Sec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
        )
        self.file = self.socket.makefile("rb")
        while self.file.readline().strip():
            pass
        self.reads = reads
        self.pictures = 0

    def read(self):
        first, second = self.file.read(2)
        length = second & 127
        if length > 125:
            size = 2 if length == 126 else 8
            length = int.from_bytes(self.file.read(size), "big")
        return first & 15, self.file.read(length)

    def send(self, value):
        data, mask = json.dumps(value).encode(), os.urandom(4)
        head = struct.pack(">BBH", 0x81, 0xFE, len(data)) if len(data) > 125 else struct.pack(">BB", 0x81, 0x80 | len(data))
        self.socket.sendall(head + mask + bytes(b ^ mask[i & 3] for i, b in enumerate(data)))

    def run(self):
        hello = None
        while hello is None:
            kind, data = self.read()
            hello = json.loads(data) if kind == 1 and b'"hello"' in data else None
        wanted = {"image": {"as": "picture", "width": 320, "hz": 5}, "features": {"as": "value", "hz": 15}}
        source = lambda it: hello["nodes"][hello["instances"][it["instance"]]["node"]]["role"] == "source"
        topics = [
            {"topic": number, **wanted[it["message"]]}
            for number, it in enumerate(hello["topics"])
            if it["message"] in wanted and it["camera"] is not None and source(it) == (it["message"] == "image")
        ]
        self.send({"do": "subscribe", "topics": topics})
        try:
            while self.reads:
                kind, data = self.read()
                self.pictures += kind == 2 and data[4] == 2
            time.sleep(1000)
        except (OSError, ValueError):
            pass


def rig(folder, session):
    text = f"""[rig]
name = "grid"
calibration = "{ROOT}/graphs/face_body.calibration.toml"
[scale.room.node.video]
type = "capture.session"
each = "*"
path = "{session}"
[scale.room.node.leds]
type = "led.detector"
each = "wide-*"
in = {{ image = "video.image" }}
[scale.room.node.targets]
type = "led.integrator"
in = {{ features = "leds.features" }}
[scale.room.node.marks]
type = "painted_mark.tracker"
each = "ptz-*"
in = {{ image = "video.image" }}
[scale.room.node.kept]
type = "export.features"
in = {{ features = "marks.features" }}
[scale.room.node.table]
type = "export.targets"
in = {{ targets = "targets.targets" }}
"""
    path = folder / "grid.toml"
    path.write_text(text)
    return path


def measure(path, out, viewers):
    """Processor time for a second of the session [s], and what the viewers got."""
    console = ["--console", "--listen", "0"] if viewers is not None else ["--paced"]
    command = [PROGRAM, "run", path, "--duration", str(SECONDS), "--out", out, *console]
    child = subprocess.Popen([str(it) for it in command], cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    windows = []
    if viewers:
        address = next(line for line in child.stderr if line.startswith("console: ")).split()[1]
        windows = [Viewer(address, reads=number < 2) for number in range(viewers)]
        for it in windows:
            it.start()
    drain = threading.Thread(target=lambda: list(child.stderr), daemon=True)
    drain.start()
    _, status, used = os.wait4(child.pid, 0)
    assert status == 0, status
    return (used.ru_utime + used.ru_stime) / SECONDS, windows


def main():
    folder = Path(sys.argv[1]).resolve()
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    session = folder / "cameras.mcap"
    subprocess.run(
        [PROGRAM, "run", "graphs/face_body.toml", "--duration", str(SECONDS + 1), "--record", session, "--out", folder / "recorded", "--quiet"],
        cwd=ROOT, check=True, capture_output=True,
    )
    path = rig(folder, session)
    extra, idle, stalled, rates = [], [], [], []
    # The first run reads the recording into memory.
    measure(path, folder / "first", None)
    for number in range(ROUNDS):
        plain, _ = measure(path, folder / f"plain-{number}", None)
        alone, _ = measure(path, folder / f"alone-{number}", 0)
        watched, windows = measure(path, folder / f"watched-{number}", 2)
        third, _ = measure(path, folder / f"stalled-{number}", 3)
        extra.append(100 * (watched - plain))
        idle.append(100 * (alone - plain))
        stalled.append(100 * (third - watched))
        rates += [it.pictures / SECONDS for it in windows]
        print(f"round {number}: plain {100 * plain:.1f} %, console {100 * alone:.1f} %, two viewers {100 * watched:.1f} %, and one that stalls {100 * third:.1f} % of a core", flush=True)
    tables = [(folder / f"{name}-{number}" / "targets.csv").read_bytes() for name in ("plain", "watched", "stalled") for number in range(ROUNDS)]
    print(f"console alone: median {statistics.median(idle):.2f} worst {max(idle):.2f}")
    print(f"two viewers: median {statistics.median(extra):.2f} worst {max(extra):.2f}")
    print(f"a viewer that stalls: median {statistics.median(stalled):.2f} worst {max(stalled):.2f}")
    print(f"pictures a viewer: median {statistics.median(rates):.1f}")
    print(f"runs with the same results: {sum(it == tables[0] for it in tables)} of {len(tables)}")


if __name__ == "__main__":
    PROGRAM = program()
    main()
