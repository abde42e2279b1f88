"""Reads a session with examples/python/foveate_session.py: session_python.py FILE FOLDER COPY.

FOLDER are the results of the run that FILE is of; its targets.csv has every sample. FILE is cut at many places into COPY. Prints a JSON object: messages
by topic, and size and mean of the last picture of wide-1. Needs mcap, msgpack and numpy.
"""

import json
import os
import pathlib
import shutil
import sys

sys.path.insert(0, str(pathlib.Path(__file__).parents[2] / "examples/python"))
import numpy as np
from foveate_session import SessionError, open_session

file, folder, copy = sys.argv[1:]
take, results = open_session(file), open_session(folder)
assert not take.remarks and not results.remarks and results.summary, (take.remarks, results.remarks)

targets, table = take.targets("room.targets"), results.table("targets")
assert len(targets) == len(table) > 500, (len(targets), len(table))
assert (targets.id == table.target).all() and (targets.provenance == table.provenance).all()
for name, found, expected in [
    ("time", targets.time_s, table.time_s),
    ("position", targets.xyz_m, np.stack([table.x_m, table.y_m, table.z_m], 1)),
    ("covariance", targets.cov_m2[:, [0, 0, 2], [0, 1, 2]], np.stack([table.cxx_m2, table.cxy_m2, table.czz_m2], 1)),
]:
    assert np.abs(found - expected).max() < 1e-6, name
n_cameras = [len(it.split("+")) if it else 0 for it in table.cameras]
assert (targets.n_cameras == n_cameras).all()

features = take.features("wide-1")
assert len(features) == results.summary["detector.features.wide-1"] and (features.xy_px > 0).all()
n_found = [len(body["value"]["list"]) for _, body in take.messages("room.leds[wide-1]")]
assert len(n_found) == take.topics["/room/leds/wide-1/features"].count and sum(n_found) == len(features)
pictures = list(take.pictures("wide-1"))
assert len(pictures) == take.topics["/room/video/wide-1/image"].count
assert b"room" in take.file("rig.resolved.toml")

for name, wrong in [
    ("/room/targets/targets", lambda: take.targets("room.target")),
    ("may be /room/leds/wide-1/features", lambda: take.features("room.leds")),
    ("['features', 'image', 'targets']", lambda: take.marks("face")),
    ("`table`, expected one of ['events'", lambda: results.table("table")),
    ("no session", lambda: open_session(__file__)),
]:
    try:
        wrong()
    except SessionError as error:
        assert name in str(error), error
    else:
        raise AssertionError(f"not refused: {name}")

assert [it[0] for it in pictures] == sorted(it[0] for it in pictures)

# Cut anywhere, a file gives the beginning of what the whole one gives.
shutil.copy(file, copy)
size = os.path.getsize(copy)
n_messages = []
for end in [*range(size - 1, size - 10, -1), *np.linspace(size - 2000, 8, 10, dtype=int).tolist()]:
    os.truncate(copy, end)
    cut = open_session(copy)
    assert any("killed or still runs" in it for it in cut.remarks), end
    n_messages.append(sum(it.count for it in cut.topics.values()))
    if "/room/targets/targets" in cut.topics:
        rows = cut.targets("room.targets")
        assert (rows.xyz_m == targets.xyz_m[: len(rows)]).all(), end
        assert sum(1 for _ in cut.messages("/room/targets/targets")) == cut.topics["/room/targets/targets"].count
    if "/room/video/wide-1/image" in cut.topics:
        n = 0
        for (time_s, picture), expected in zip(cut.pictures("wide-1"), pictures):
            assert time_s == expected[0] and (picture == expected[1]).all(), end
            n += 1
        assert n == cut.topics["/room/video/wide-1/image"].count
    assert os.path.getsize(copy) == end
whole = sum(it.count for it in take.topics.values())
assert n_messages[0] == whole and n_messages == sorted(n_messages, reverse=True) and n_messages[-1] == 0, n_messages
assert len(set(n_messages)) > 5, n_messages

time_s, picture = pictures[-1]
topics = {name: it.count for name, it in take.topics.items()}
print(json.dumps({"topics": topics, "n": len(pictures), "time_s": time_s, "shape": picture.shape, "mean": picture.mean()}))
