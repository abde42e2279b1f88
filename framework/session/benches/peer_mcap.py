"""Writes pictures of a dark room with PyPI's mcap, as the bench `session` does with ours: python3 peer_mcap.py FOLDER."""
import os
import sys
import time

import numpy
from mcap.writer import CompressionType, Writer

COUNT, ROWS, COLUMNS = 500, 480, 640


def picture(seed):
    """Noise of up to three bits in a quarter of the pixels, on a gradient."""
    draw = numpy.random.default_rng(seed)
    noise = numpy.where(draw.random((ROWS, COLUMNS)) < 0.25, draw.integers(0, 8, (ROWS, COLUMNS)), 0)
    return (numpy.arange(ROWS)[:, None] // 32 + noise).astype(numpy.uint8).tobytes()


pictures = [picture(seed) for seed in range(20)]
path = os.path.join(sys.argv[1], "peer.mcap")
for name, compression in [("raw", CompressionType.NONE), ("lz4", CompressionType.LZ4), ("zstd", CompressionType.ZSTD)]:
    rates = []
    for _ in range(3):
        with open(path, "wb") as file:
            began = time.perf_counter()
            writer = Writer(file, chunk_size=4 << 20, compression=compression)
            writer.start()
            channel = writer.register_channel(topic="/image", message_encoding="raw", schema_id=0)
            for n in range(COUNT):
                writer.add_message(channel, log_time=n * 1_000_000, publish_time=n * 1_000_000, data=pictures[n % 20])
            writer.finish()
        rates.append(COUNT * ROWS * COLUMNS / 1e6 / (time.perf_counter() - began))
    print(f"PyPI mcap {name}: {sorted(rates)[1]:.0f} MB/s")
os.remove(path)
