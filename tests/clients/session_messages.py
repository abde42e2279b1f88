"""Reads a session as any MCAP file: session_messages.py FILE.

Prints a line for each message: topic, time [ns], length [bytes] and a sum of its bytes. The reader that seeks and the one that does not must read the
same, and what the statistics count. Needs mcap, lz4 and zstandard.
"""

import sys

from mcap.reader import NonSeekingReader, SeekingReader, make_reader


def line(channel, message):
    total = 0
    for byte in message.data:
        total = (total * 31 + byte) % 1_000_000_007
    return f"{channel.topic} {message.log_time} {len(message.data)} {total}"


def messages(reader):
    return [(channel.topic, line(channel, message)) for _, channel, message in reader.iter_messages()]


with open(sys.argv[1], "rb") as file:
    reader = make_reader(file, validate_crcs=True)
    assert isinstance(reader, SeekingReader)
    summary = reader.get_summary()
    found = messages(reader)
    assert summary.statistics.message_count == len(found)
    assert len(list(reader.iter_attachments())) == summary.statistics.attachment_count
    assert len(list(reader.iter_metadata())) == summary.statistics.metadata_count
    for topic in {topic for topic, _ in found}:
        of_topic = [line(channel, message) for _, channel, message in reader.iter_messages(topics=[topic])]
        assert sorted(of_topic) == sorted(text for name, text in found if name == topic), topic

with open(sys.argv[1], "rb") as file:
    assert sorted(messages(NonSeekingReader(file, validate_crcs=True))) == sorted(found)

for _, text in found:
    print(text)
