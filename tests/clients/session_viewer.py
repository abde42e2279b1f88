"""Reads an MCAP file of every kind of message with the public schemas: session_viewer.py FILE.

Each schema in the file must agree with the public one of its name, and each message must say the same by both. Prints a line for each message:
its topic and its JSON. Needs mcap, protobuf and foxglove-schemas-protobuf.
"""

import importlib
import sys

from google.protobuf import descriptor_pb2, descriptor_pool, json_format, message_factory
from mcap.reader import make_reader


def shape(message):
    """What a message is by its descriptor, without fields of our own."""
    fields = sorted((it.number, it.name, it.type, it.is_repeated) for it in message.fields if it.number < 1000)
    enums = sorted((it.name, [(value.name, value.number) for value in it.values]) for it in message.enum_types)
    return fields, enums


def compare(ours, public, seen):
    assert shape(ours) == shape(public), f"{ours.full_name}: {shape(ours)} is not {shape(public)}"
    for field in public.fields:
        if field.message_type and field.message_type.full_name not in seen:
            seen.add(field.message_type.full_name)
            compare(ours.fields_by_name[field.name].message_type, field.message_type, seen)
    assert ours.file.name == public.file.name


with open(sys.argv[1], "rb") as file:
    for schema, channel, record in make_reader(file).iter_messages():
        assert schema.encoding == channel.message_encoding == "protobuf"
        pool = descriptor_pool.DescriptorPool()
        for described in descriptor_pb2.FileDescriptorSet.FromString(schema.data).file:
            pool.Add(described)
        descriptor = pool.FindMessageTypeByName(schema.name)
        ours = message_factory.GetMessageClass(descriptor).FromString(record.data)
        text = json_format.MessageToJson(ours, preserving_proto_field_name=True, indent=None)
        print(channel.topic, text)
        package, name = schema.name.split(".")
        if package == "foxglove":
            module = importlib.import_module(f"foxglove_schemas_protobuf.{name}_pb2")
            public = getattr(module, name).FromString(record.data)
            compare(descriptor, public.DESCRIPTOR, set())
            if "foveate_picture" in descriptor.fields_by_name:
                ours.ClearField("foveate_picture")
            public.DiscardUnknownFields()
            assert json_format.MessageToDict(ours) == json_format.MessageToDict(public), channel.topic
