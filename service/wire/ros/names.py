"""Keys, tokens and ids as rmw_zenoh has them.

Source: ros2/rmw_zenoh, docs/design.md and liveliness_utils.cpp; proven against `pyzeros`.
"""

import struct
from dataclasses import dataclass

_ATTACHMENT = struct.Struct("<qqB16s")
_VOLATILE, _LATCHED = "::,10:,:,:,,", ":1:,1:,:,:,,"
"""Reliable, keep the last 10, volatile; and transient local, keep the last one. What is default is empty."""


@dataclass(frozen=True, slots=True)
class Node:
    """A ROS node in a Zenoh session.

    Attributes:
        domain: ROS_DOMAIN_ID.
        session: the Zenoh session's id.
        namespace: absolute, `/` = none.
        name: of the node.
    """

    domain: int
    session: str
    namespace: str
    name: str

    @property
    def token(self) -> str:
        """What makes the node visible."""
        return f"{self._root}/0/0/NN/%/{mangled(self.namespace)}/{self.name}"

    def publisher_token(self, entity: int, topic: str, kind: str, type_hash: str, latched: bool) -> str:
        """What makes a publisher visible; `topic` is absolute, `kind` such as `sensor_msgs/msg/Image`."""
        who = f"{self._root}/0/{entity}/MP/%/{mangled(self.namespace)}/{self.name}"
        return f"{who}/{mangled(topic)}/{dds_type(kind)}/{type_hash}/{_LATCHED if latched else _VOLATILE}"

    @property
    def _root(self) -> str:
        return f"@ros2_lv/{self.domain}/{self.session}"


def data_key(domain: int, topic: str, kind: str, type_hash: str) -> str:
    """On which key messages of an absolute topic go."""
    return f"{domain}/{topic.strip('/')}/{dds_type(kind)}/{type_hash}"


def dds_type(kind: str) -> str:
    """`sensor_msgs/msg/Image` as `sensor_msgs::msg::dds_::Image_`."""
    package, part, name = kind.split("/")
    return f"{package}::{part}::dds_::{name}_"


def mangled(name: str) -> str:
    """A name as one part of a key: every slash as %."""
    return name.replace("/", "%") if name.strip("/") else "%"


def gid(token: str) -> bytes:
    """16 bytes that name a publisher: XXH3-128 of its token, the low 64 bits first, little-endian."""
    import xxhash

    return int(xxhash.xxh3_128_intdigest(token.encode())).to_bytes(16, "little")


def attachment(sequence: int, time: int, publisher: bytes) -> bytes:
    """What goes with each message: its number, source time (ns), and the publisher's gid."""
    return _ATTACHMENT.pack(sequence, time, len(publisher), publisher)
