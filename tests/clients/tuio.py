"""A TUIO client from PyPI (python-tuio 0.0.9 on python-osc 1.10.2) receives what people draw on a simulated wall.

    python3 tuio.py target/release/foveate graphs/laser_wall.toml

The program runs the rig for some seconds; the client, which shares no code with it, must see cursors come, move and go, all of them on the wall.
"""

import subprocess
import sys
import tempfile
import threading
import time

import pythontuio.dispatcher
from pythontuio import TuioClient, TuioListener

SECONDS = 12
# It tells every bundle.
pythontuio.dispatcher.print = lambda *words: None


class Watcher(TuioListener):
    """What the client tells its listeners."""

    def __init__(self):
        self.added, self.removed, self.moves, self.most = set(), set(), 0, 0
        self.outside = []
        self.now = set()

    def add_tuio_cursor(self, cursor):
        self.added.add(cursor.session_id)
        self.now.add(cursor.session_id)
        self.most = max(self.most, len(self.now))

    def update_tuio_cursor(self, cursor):
        self.moves += 1
        x, y = cursor.position
        if not (0 <= x <= 1 and 0 <= y <= 1):
            self.outside.append((x, y))

    def remove_tuio_cursor(self, cursor):
        self.removed.add(cursor.session_id)
        self.now.discard(cursor.session_id)


def main():
    program, rig = sys.argv[1:]
    watcher = Watcher()
    client = TuioClient(("127.0.0.1", 3333))
    client.add_listener(watcher)
    threading.Thread(target=client.start, daemon=True).start()
    time.sleep(0.5)
    with tempfile.TemporaryDirectory() as out:
        subprocess.run([program, "run", rig, "--duration", str(SECONDS), "--quiet", "--listen", "0", "--out", out], check=True)
    time.sleep(0.5)
    people = f"{len(watcher.added)} cursors, {watcher.most} at once, {watcher.moves} updates"
    assert watcher.most >= 2 and len(watcher.added) >= 4 and watcher.moves > 100, people
    assert not watcher.outside, watcher.outside[:5]
    assert watcher.added == watcher.removed, f"left behind: {watcher.added - watcher.removed}"
    print(f"python-tuio: {people}, none left behind")


if __name__ == "__main__":
    main()
