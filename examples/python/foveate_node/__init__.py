"""Nodes of foveate rigs in Python: messages come on standard input and go out on standard output, pixels lie in shared memory.

    from foveate_node import feature, run

    def detect(message):
        rows, columns = (message.pixels > 60).nonzero()
        return [("features", {"camera": message.value["camera"], "list": [feature(columns.mean(), rows.mean())]})]

    run({"image": detect})

Every message is the dictionary that `foveate nodes TYPE` and the greeting's JSON Schemas describe. What a node prints goes to standard error.
"""

import json
import mmap
import os
import struct
import sys


class Gap(Exception):
    """Raised by a node for a message of which nothing can be made: counted, shown, never silent."""


class Message:
    """One message: `port`, `value` (a dictionary), `time_s`, `now_s` (session clock), `latest` (what other ports hold), `pixels` (an array or None)."""

    def __init__(self, frame, memory):
        self.port, self.value, self.latest = frame["port"], frame["value"], frame.get("latest", {})
        self.time_s, self.now_s = frame["stamp"]["time"] / 1e9, frame["now"] / 1e9
        self.stamp, self.bulk, self.memory = frame["stamp"], frame.get("bulk"), memory

    @property
    def pixels(self):
        """The picture, rows by columns (by 3 for colours): a view of the shared memory, good until the answer is given."""
        import numpy

        if self.bulk is None:
            return None
        flat = numpy.frombuffer(self.memory, numpy.uint8, self.bulk["length"], self.bulk["offset"])
        shape = (self.value["height"], self.value["width"])
        return flat.reshape(shape if flat.size == shape[0] * shape[1] else (*shape, 3))


def feature(x, y, variance=0.01, area=0, peak=0, label=None):
    """A point in a picture [px], with its variance along each axis [px²]."""
    covariance = [float(variance), 0.0, 0.0, float(variance)]
    return {"centre": [float(x), float(y)], "covariance": covariance, "area": int(area), "peak": int(peak), "label": label}


class _Memory:
    """The shared memory that messages name, mapped once."""

    def __init__(self):
        self.path, self.map = None, None

    def of(self, bulk):
        if bulk is None:
            return None
        if bulk["path"] != self.path or len(self.map) != bulk["size"]:
            with open(bulk["path"], "r+b") as file:
                self.map = mmap.mmap(file.fileno(), bulk["size"])
            self.path = bulk["path"]
        return self.map


def _read(stream):
    head = stream.read(4)
    if len(head) < 4:
        return None
    (length,) = struct.unpack("<I", head)
    return json.loads(stream.read(length))


def _write(stream, frame):
    text = json.dumps(frame, separators=(",", ":")).encode()
    stream.write(struct.pack("<I", len(text)) + text)
    stream.flush()


def _answer(given, message):
    """`given`: a list of (port, value) or (port, value, pixels)."""
    emitted = []
    for port, value, *pixels in given or []:
        entry = {"port": port, "value": value}
        if pixels:
            start = message.bulk["answer"]
            data = memoryview(pixels[0]).cast("B")
            message.memory[start : start + len(data)] = data
            entry["bulk"] = [start, len(data)]
        emitted.append(entry)
    return {"emit": emitted}


def run(ports, start=None):
    """Answers messages until the program is done. `ports`: by input port, a function of a `Message` that gives a list of (port, value) or
    (port, value, pixels). `start` is given the greeting before the first message."""
    source = sys.stdin.buffer
    # What the node or its libraries print must not stand between the frames.
    sink = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    hello = _read(source)
    if hello is None:
        return
    missing = [port for port in ports if port not in hello["inputs"]]
    if hello["hello"] != 1 or missing:
        _write(sink, {"refuse": f"expected the inputs {sorted(ports)}, found {sorted(hello['inputs'])}"})
        return
    if start is not None:
        start(hello)
    _write(sink, {"ready": True})
    memory = _Memory()
    while (frame := _read(source)) is not None:
        message = Message(frame, memory.of(frame.get("bulk")))
        try:
            _write(sink, _answer(ports[message.port](message), message))
        except Gap as gap:
            _write(sink, {"gaps": [{"port": next(iter(hello["outputs"])), "reason": str(gap)}]})
