"""Opens a session or a results folder as NumPy arrays:

    from foveate_session import open_session
    take = open_session("take.mcap")                    # or a results folder
    print(take)                                         # topics, counts, rates, remarks
    targets = take.targets("room.targets")              # a row for each target and time: targets.xyz_m, targets.cov_m2
    for time_s, picture in take.pictures("wide-1"): ...

Needs mcap, msgpack and numpy; Pillow for JPEG pictures. Times are those of the session [s], from 0. Nothing is ever written: a file whose recording
was killed, or still runs, is read to its last whole chunk. Pictures and messages come one at a time, and memory holds one chunk (some megabytes).

A topic is named in full, `/room/leds/wide-1/features`, or by parts that only one topic of the kind has: `room.leds[wide-1]`, `wide-1`. Where a node has
several outputs, `room.targets` is the one called as its kind.
"""

import csv
import difflib
import io
import json
import os
import re
import struct
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import msgpack
import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Message, Metadata
from mcap.stream_reader import breakup_chunk

MAGIC = b"\x89MCAP0\r\n"
POINT = [("xyz_m", "f8", 3), ("cov_m2", "f8", (3, 3)), ("n_cameras", "u2"), ("provenance", "U9")]
TARGET = [("time_s", "f8"), ("id", "u4"), *POINT, ("velocity_m_s", "f8", 3)]
MARK = [("time_s", "f8"), ("label", "u4"), *POINT, ("world_xyz_m", "f8", 3)]
FEATURE = [("time_s", "f8"), ("xy_px", "f8", 2), ("cov_px2", "f8", (2, 2)), ("area_px2", "u4"), ("peak", "u1"), ("label", "i8")]
HEAD_POSE = [("time_s", "f8"), ("angles_rad", "f8", 2), ("angles_cov_rad2", "f8", (2, 2)), ("rates_rad_s", "f8", 2), ("zoom", "f8")]
HEAD_POSE += [("camera_from_world", "f8", (4, 4)), ("cov", "f8", (6, 6)), ("age_s", "f8")]


class SessionError(ValueError):
    """What cannot be read: the file, what was found in it, what is expected."""


class Topic(NamedTuple):
    """A topic: `kind` of its messages such as `targets` (empty for what only viewers draw), their `count`, and their rate over the session [Hz]."""

    kind: str
    count: int
    rate_hz: float


def open_session(path: str | os.PathLike) -> "Session | Results":
    """The session of a file, or the results of a folder."""
    path = Path(path)
    if not path.exists():
        raise SessionError(f"`{path}` does not exist: expected a session (.mcap) or a results folder")
    return Results(path) if path.is_dir() else Session(path)


class Session:
    """A recorded run: `topics` by name, `duration_s`, `facts` (rig, seed, mode, …: texts), `files` (names), `remarks` (what is missing or damaged)."""

    def __init__(self, path: str | os.PathLike):
        self.path, self.remarks = Path(path), []
        self._channels: dict[int, Channel] = {}
        # By place in the file: how many messages of each channel a chunk holds.
        self._chunks: dict[int, Counter[int]] = {}
        self._files: dict[str, int] = {}
        texts, times, size, end, is_whole = {}, [], self.path.stat().st_size, len(MAGIC), False
        with open(self.path, "rb") as file:
            if (found := file.read(end)) != MAGIC:
                raise SessionError(f"`{path}` is no session: found {size} bytes that begin with {found!r}, expected {MAGIC!r} (MCAP)")
            for at, opcode, end in _records(file, size):
                if opcode == Opcode.CHUNK:
                    self._chunks[at] = Counter()
                    times += [it for it in [struct.unpack("<QQ", file.read(16))] if it[1] > 0]
                elif opcode == Opcode.MESSAGE_INDEX and self._chunks:
                    channel, n_bytes = struct.unpack("<HI", file.read(6))
                    self._chunks[next(reversed(self._chunks))][channel] += n_bytes // 16
                elif opcode == Opcode.CHANNEL:
                    channel = Channel.read(ReadDataStream(file))
                    self._channels[channel.id] = channel
                elif opcode == Opcode.METADATA:
                    record = Metadata.read(ReadDataStream(file))
                    texts[record.name] = record.metadata
                elif opcode == Opcode.ATTACHMENT:
                    self._files[file.read(struct.unpack("<QQI", file.read(20))[2]).decode()] = at
                elif opcode == Opcode.FOOTER:
                    file.seek(end)
                    is_whole = file.read() == MAGIC
            # The last chunk of an unfinished file may lack its index; other chunks are read only for channels that nothing else describes.
            for at, counts in list(self._chunks.items()):
                if not counts or not counts.keys() <= self._channels.keys() or (at == max(self._chunks) and not is_whole):
                    records = self._chunk(file, at)
                    self._channels |= {it.id: it for it in records if isinstance(it, Channel)}
                    self._chunks[at] = Counter(it.channel_id for it in records if isinstance(it, Message))
        self.facts, self.files = texts.get("foveate.session", {}), list(self._files)
        self.duration_s = (max(it[1] for it in times) - min(it[0] for it in times)) / 1e9 if times else 0.0
        if not is_whole:
            self.remarks.append(f"its recording was killed or still runs: read to byte {end} of {size}")
        elif "foveate.end" not in texts and not {"cut", "merged"} & texts.get("foveate.session", {}).keys():
            self.remarks.append("its recording did not end in good order")
        last_words = texts.get("foveate.end", {}).items()
        self.remarks += [f"{it} {key[9:]} were left out" for key, it in last_words if key.startswith("left_out_") and it != "0"]
        self.remarks += [it for key, it in last_words if key.startswith("remark_")]
        counts, self._numbers, self.topics = sum(self._chunks.values(), Counter()), {}, {}
        for channel in sorted(self._channels.values(), key=lambda it: it.topic):
            numbers = self._numbers.setdefault(channel.topic, set())
            numbers.add(channel.id)
            n = sum(counts[it] for it in numbers)
            self.topics[channel.topic] = Topic(channel.metadata.get("message", ""), n, n / max(self.duration_s, 1e-9))

    def _chunk(self, file: BinaryIO, at: int) -> list[Any]:
        """The records of a chunk: none, and a remark, where it is damaged."""
        file.seek(at + 9)
        try:
            return breakup_chunk(Chunk.read(ReadDataStream(file)), validate_crc=True)
        except Exception as damage:  # mcap, lz4 and zstandard each raise their own
            remark = f"the chunk at byte {at} is damaged and left out: {damage or type(damage).__name__}"
            if remark not in self.remarks:
                self.remarks.append(remark)
                warnings.warn(f"`{self.path}`: {remark}", stacklevel=2)
            return []

    def _topic(self, name: str, kind: str | None) -> str:
        """The topic that `name` means among those of `kind`; of all that are not only drawn, if that is None."""
        if name in self.topics and kind in (None, self.topics[name].kind):
            return name
        of_kind = [it for it, topic in self.topics.items() if topic.kind and kind in (None, topic.kind)]
        found = [it for it in of_kind if f" {_words(name)} " in f" {_words(it)} "]
        if len(found) > 1:
            found = [it for it in found if it.endswith(f"/{kind}")] or found
        if len(found) == 1:
            return found[0]
        what = f"`{self.path}`: expected the name of one topic of {kind or 'any kind'}, found `{name}`"
        if not of_kind:
            raise SessionError(f"{what}; there is no such topic, only {sorted({it.kind for it in self.topics.values()} - {''})}")
        near = found or difflib.get_close_matches(name, of_kind, 3, 0.0)
        raise SessionError(f"{what}; {'it may be' if found else 'near are'} {', '.join(near[:5])}{' …' if len(near) > 5 else ''}")

    def _raw(self, topic: str) -> Iterator[tuple[Channel, Message]]:
        numbers = self._numbers[topic]
        with open(self.path, "rb") as file:
            for at in [at for at, counts in self._chunks.items() if numbers & counts.keys()]:
                for record in self._chunk(file, at):
                    if isinstance(record, Message) and record.channel_id in numbers:
                        yield self._channels[record.channel_id], record

    def messages(self, name: str, kind: str | None = None) -> Iterator[tuple[float, dict[str, Any]]]:
        """Time [s] and content of each message of a topic, in the order they were given out.

        The content has `time` [ns], `source`, `sequence`, `value` (as `foveate nodes` describes the kind; SI units, rad, px) and `bulk` (bytes beside it).
        """
        topic = self._topic(name, kind)
        encodings = {self._channels[it].message_encoding for it in self._numbers[topic]}
        if encodings == {"msgpack"}:
            bodies = (msgpack.unpackb(record.data, strict_map_key=False) for _, record in self._raw(topic))
            return ((body["time"] / 1e9, body) for body in bodies)
        if encodings == {"json"}:
            return ((record.log_time / 1e9, json.loads(record.data)) for _, record in self._raw(topic))
        expected = "expected msgpack or json; pictures are read by `pictures`, what viewers draw by mcap-protobuf-support"
        raise SessionError(f"`{self.path}`: `{topic}` is {'/'.join(sorted(encodings))}, {expected}")

    def _rows(self, name: str, kind: str, dtype: list, rows: Callable[[dict], list[tuple]]) -> np.recarray:
        messages = self.messages(name, kind)
        return np.fromiter(((time_s, *row) for time_s, body in messages for row in rows(body["value"])), dtype).view(np.recarray)

    def targets(self, name: str) -> np.recarray:
        """A row for each target and time: `time_s`, `id`, in the scale's space `xyz_m` (3), `cov_m2` (3, 3) of the position and `velocity_m_s` (3);
        `n_cameras` that saw it at this time; `provenance`: measured, predicted or filled."""
        return self._rows(name, "targets", TARGET, _targets)

    def marks(self, name: str) -> np.recarray:
        """A row for each mark and time: as `targets`, with `label` for `id`, `xyz_m` and `cov_m2` in the marks' own space (that of the head, the knee),
        and `world_xyz_m` (3)."""
        return self._rows(name, "marks", MARK, _marks)

    def features(self, name: str) -> np.recarray:
        """A row for each point found in a picture of one camera: `time_s`, `xy_px` (2) in raw pixels of the whole picture, (0, 0) the centre of the
        top-left one; `cov_px2` (2, 2); `area_px2` and `peak` (gray level), 0 where not known; `label` of its mark, -1 where not known."""
        return self._rows(name, "features", FEATURE, _features)

    def head_poses(self, name: str) -> np.recarray:
        """A row for each pose of a camera on a head: `time_s`, `angles_rad` (2: pan, tilt), `angles_cov_rad2` (2, 2), `rates_rad_s` (2), `zoom` of the drive
        (NaN where not known), `camera_from_world` (4, 4) [m], `cov` (6, 6) of its rotation and translation [rad², rad m, m²], `age_s` of the head's answer."""
        return self._rows(name, "head_pose", HEAD_POSE, _head_poses)

    def pictures(self, name: str, windows: bool = False) -> Iterator[tuple]:
        """Time [s] and pixels of each picture: uint8, (rows, columns) or (rows, columns, 3) RGB, read-only. With `windows` also (left, top, shrink): which
        part of the camera's picture it is [px], and how many of the camera's pixels one is wide and high."""
        topic = self._topic(name, "image")

        def read(channel: Channel, record: Message) -> tuple:
            fields = _fields(record.data)
            if 1000 not in fields:
                raise SessionError(f"`{self.path}`: a picture of `{topic}` has no field 1000 (stamp and window): something else recorded it")
            head = _fields(fields[1000])
            rows, columns, channels = head[6], head[5], head[7]
            shape = (rows, columns) if channels == 1 else (rows, columns, channels)
            # A RawImage says its encoding in field 4 and has its pixels in 6; a CompressedImage has a JPEG file in 2.
            pixels = np.frombuffer(fields[6], np.uint8) if 6 in fields else _jpeg(fields[2], f"`{self.path}`: `{topic}`")
            if pixels.size != rows * columns * channels:
                raise SessionError(f"`{self.path}`: a picture of `{topic}` has {pixels.size} bytes, expected {rows} × {columns} × {channels}")
            return (head[1] / 1e9, pixels.reshape(shape), *([(head[8], head[9], head[10])] if windows else []))

        return (read(*it) for it in self._raw(topic))

    def file(self, name: str) -> bytes:
        """The content of one of `files`: `rig.resolved.toml` is the rig with its defaults."""
        if name not in self._files:
            raise SessionError(f"`{self.path}` holds no file `{name}`, expected one of {self.files}")
        with open(self.path, "rb") as file:
            file.seek(self._files[name] + 9)
            return Attachment.read(ReadDataStream(file)).data

    def __str__(self) -> str:
        rig, mode = self.facts.get("rig", "?"), self.facts.get("mode", "?")
        lines = [f"{self.path}: rig `{rig}`, {mode} run, {self.duration_s:.2f} s", *(f"note: {it}" for it in self.remarks)]
        lines.append(f"{'topic':<48} {'messages':>9} {'rate Hz':>9}  kind")
        lines += [f"{name:<48} {it.count:>9} {it.rate_hz:>9.1f}  {it.kind}".rstrip() for name, it in self.topics.items()]
        return "\n".join(lines)

    __repr__ = __str__


class Results:
    """A results folder: `summary` (figures by name), `tables` (names for `table`), `remarks`."""

    def __init__(self, path: str | os.PathLike):
        self.path, self.remarks = Path(path), []
        self.tables = sorted(it.stem for it in self.path.glob("*.csv"))
        summary = self.path / "summary.json"
        self.summary: dict[str, Any] = json.loads(summary.read_text("utf-8")) if summary.exists() else {}
        if not summary.exists() and not self.tables:
            raise SessionError(f"`{self.path}` is no results folder: found neither summary.json nor tables (.csv)")
        if not summary.exists():
            self.remarks.append("no summary.json: its run was killed or still runs")

    @property
    def session(self) -> Session:
        """The session that `--record` wrote into the folder."""
        if not (self.path / "session.mcap").exists():
            raise SessionError(f"`{self.path}` holds no session.mcap: expected a run with --record")
        return Session(self.path / "session.mcap")

    def table(self, name: str) -> np.recarray:
        """A table as an array, a field for each column (its name ends in its unit): whole numbers, numbers (empty: NaN) or texts. A last line that a killed
        run cut off is left out."""
        path = self.path / f"{name.removesuffix('.csv')}.csv"
        if not path.exists():
            raise SessionError(f"`{self.path}` holds no table `{name}`, expected one of {self.tables}")
        with open(path, newline="", encoding="utf-8") as file:
            names, *rows = csv.reader(line for line in file if line.endswith("\n")) if path.stat().st_size else [[]]
        for number, row in enumerate(rows, 1):
            if len(row) != len(names):
                raise SessionError(f"`{path}`: row {number} has {len(row)} cells, expected {len(names)}")
        columns = [_column(it) for it in zip(*rows)] if rows else [np.empty(0)] * len(names)
        return np.rec.fromarrays(columns, names=names)

    def __str__(self) -> str:
        return "\n".join([f"{self.path}: {len(self.summary)} figures; tables {', '.join(self.tables)}", *(f"note: {it}" for it in self.remarks)])

    __repr__ = __str__


def _records(file: BinaryIO, size: int) -> Iterator[tuple[int, int, int]]:
    """Start, opcode and end of each whole record; the file stands at its content."""
    at = len(MAGIC)
    while at + 9 <= size:
        file.seek(at)
        opcode, length = struct.unpack("<BQ", file.read(9))
        # The end of a file that was being written: cut off, or zeros.
        if opcode == 0 or at + 9 + length > size:
            return
        yield at, opcode, at + 9 + length
        at += 9 + length


def _varint(message: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while message[at] & 0x80:
        value, shift, at = value | (message[at] & 0x7F) << shift, shift + 7, at + 1
    return value | message[at] << shift, at + 1


def _fields(message: bytes) -> dict[int, Any]:
    """The fields of a protobuf message by number: integers, and bytes where it holds more."""
    fields, at = {}, 0
    while at < len(message):
        key, at = _varint(message, at)
        number, wire = divmod(key, 8)
        length, at = _varint(message, at) if wire in (0, 2) else (8 if wire == 1 else 4, at)
        if wire == 0:
            fields[number] = length
            continue
        content = message[at : at + length]
        fields[number], at = content if wire == 2 else int.from_bytes(content, "little", signed=wire == 1), at + length
    return fields


def _jpeg(content: bytes, where: str) -> np.ndarray:
    try:
        from PIL import Image
    except ImportError:
        raise SessionError(f"{where} holds JPEG pictures, which need Pillow: pip install Pillow") from None
    return np.asarray(Image.open(io.BytesIO(content)))


def _words(name: str) -> str:
    return " ".join(re.findall(r"[^./\[\]]+", name))


def _square(numbers: list[float]) -> np.ndarray:
    return np.reshape(numbers, (round(len(numbers) ** 0.5), -1))


def _point(it: dict) -> tuple:
    return it["position"], _square(it["covariance"])[:3, :3], len(it["cameras"]), it["provenance"].lower()


def _targets(value: dict) -> list[tuple]:
    return [(it["id"], *_point(it), it["velocity"]) for it in value["list"]]


def _marks(value: dict) -> list[tuple]:
    world_from_marks = _matrix(value["world_from_marks"])[:3]
    return [(it["label"], *_point(it), world_from_marks @ [*it["position"], 1.0]) for it in value["list"]]


def _features(value: dict) -> list[tuple]:
    labels = [-1 if it["label"] is None else it["label"] for it in value["list"]]
    return [(it["centre"], _square(it["covariance"]), it["area"], it["peak"], label) for it, label in zip(value["list"], labels)]


def _head_poses(it: dict) -> list[tuple]:
    angles, zoom = (it["angles"], _square(it["angles_covariance"]), it["rates"]), np.nan if it["zoom"] is None else it["zoom"]
    return [(*angles, zoom, _matrix(it["camera_from_world"]), _square(it["covariance"]), it["age"] / 1e9)]


def _matrix(pose: dict) -> np.ndarray:
    """(4, 4) of a rotation (x, y, z, w) and a translation [m]."""
    x, y, z, w = pose["rotation"]
    matrix = np.eye(4)
    matrix[:3, :3] += 2 * np.array([[-y * y - z * z, x * y - w * z, x * z + w * y], [x * y + w * z, -x * x - z * z, y * z - w * x],
                                    [x * z - w * y, y * z + w * x, -x * x - y * y]])  # fmt: skip
    matrix[:3, 3] = pose["translation"]
    return matrix


def _column(cells: tuple[str, ...]) -> np.ndarray:
    """As whole numbers, as numbers where all are or are empty, else as texts."""
    for read, dtype in ((int, "i8"), (lambda cell: float(cell or "nan"), "f8")):
        try:
            return np.array([read(it) for it in cells], dtype)
        except (ValueError, OverflowError):
            pass
    return np.array(cells)
