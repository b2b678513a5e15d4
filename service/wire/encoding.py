"""How Zenoh is told what a payload is."""

from dataclasses import dataclass

import zenoh

from drivers.messages import Message


@dataclass(frozen=True, slots=True)
class Octets:
    """Bytes that are no message, such as a part of a file.

    Attributes:
        topic: what they are called.
        payload: themselves.
    """

    topic: str
    payload: bytes


def encoding(message: Message | Octets) -> zenoh.Encoding:
    """`application/protobuf;foxglove.RawImage` and the like."""
    if isinstance(message, Octets):
        return zenoh.Encoding.APPLICATION_OCTET_STREAM
    kind = zenoh.Encoding.APPLICATION_PROTOBUF
    if message.message_encoding == "json":
        kind = zenoh.Encoding.APPLICATION_JSON
    return kind.with_schema(message.schema.name)
