"""How Zenoh is told what a payload is."""

import zenoh

from drivers.messages import Message


def encoding(message: Message) -> zenoh.Encoding:
    """`application/protobuf;foxglove.RawImage` and the like."""
    kind = zenoh.Encoding.APPLICATION_PROTOBUF
    if message.message_encoding == "json":
        kind = zenoh.Encoding.APPLICATION_JSON
    return kind.with_schema(message.schema.name)
