"""Who is there among the ROS 2 nodes, as their liveliness tokens tell, and who nearly understands another."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import zenoh

_PARTS = 13


@dataclass(frozen=True, slots=True)
class Endpoint:
    """A publisher or subscriber of a node.

    Attributes:
        kind: its type as keys have it, `sensor_msgs::msg::dds_::Image_`.
        type_hash: what stands for the type's definition.
    """

    role: Literal["publisher", "subscriber"]
    domain: int
    node: str
    topic: str
    kind: str
    type_hash: str

    @classmethod
    def of(cls, token: str) -> "Endpoint | None":
        """The endpoint of a token; None for one of another kind."""
        parts = token.split("/")
        if len(parts) != _PARTS or parts[5] not in ("MP", "MS") or not parts[1].isdecimal():
            return None
        namespace = parts[7].replace("%", "/").rstrip("/")
        return cls(
            role="publisher" if parts[5] == "MP" else "subscriber",
            domain=int(parts[1]),
            node=f"{namespace}/{parts[8]}",
            topic=parts[9].replace("%", "/"),
            kind=parts[10],
            type_hash=parts[11],
        )


def endpoints(session: zenoh.Session, timeout: float = 2.0) -> list[Endpoint]:
    """All that can be seen from a session."""
    replies = session.liveliness().get("@ros2_lv/**", timeout=timeout)
    found = (Endpoint.of(str(reply.ok.key_expr)) for reply in replies if reply.ok is not None)
    return [endpoint for endpoint in found if endpoint is not None]


def near_misses(ours: Sequence[Endpoint], others: Sequence[Endpoint]) -> Iterator[str]:
    """Why endpoints of one topic and opposite roles do not find each other, in words, each pair once."""
    told: set[str] = set()
    for one in ours:
        for other in others:
            if one.topic != other.topic or one.role == other.role or one.node == other.node:
                continue
            reasons = list(_differences(one, other))
            line = f"{other.node}, {other.role} of {other.topic}: {', '.join(reasons)}"
            if reasons and line not in told:
                told.add(line)
                yield line


def _differences(one: Endpoint, other: Endpoint) -> Iterator[str]:
    if one.domain != other.domain:
        yield f"domain {other.domain}, here {one.domain}"
    if one.kind != other.kind:
        yield f"type {_plain(other.kind)}, here {_plain(one.kind)}"
    elif one.type_hash != other.type_hash:
        yield _hashes(one.type_hash, other.type_hash)


def _hashes(ours: str, theirs: str) -> str:
    if not theirs.startswith("RIHS"):
        return 'no type hash: a node of Humble, set [ros2] distribution = "humble"'
    if not ours.startswith("RIHS"):
        return "a type hash, here none: a node of Iron or later, set [ros2] distribution accordingly"
    return f"type hash {theirs[:14]}…, here {ours[:14]}…: another definition of the message"


def _plain(kind: str) -> str:
    return kind.replace("::dds_::", "/").replace("::", "/").rstrip("_")
