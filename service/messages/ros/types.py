"""Message types of a ROS 2 distribution, by the library `rosbags`."""

import struct
from dataclasses import dataclass
from typing import Any, Literal

from drivers.depth.typestore import typestore
from drivers.errors import NotAvailableError
from service.errors import ConfigurationError

Distribution = Literal["humble", "iron", "jazzy", "kilted", "lyrical"]

UNHASHED = "TypeHashNotSupported"
"""What Humble, which knows no hashes, has in their place."""

_HEADER = 4
"""Bytes of CDR before a message."""

LAST_STAMP = 2**31
"""Seconds; builtin_interfaces/Time counts in 32 bits with a sign."""


@dataclass(frozen=True, slots=True)
class RosMessage:
    """One message: its topic (see `ROS_TOPICS`), and its bytes as CDR with their four-byte header."""

    topic: str
    payload: bytearray


class RosTypes:
    """Makes messages of a distribution.

    Raises:
        ConfigurationError: the library is not installed.
    """

    def __init__(self, distribution: Distribution = "jazzy") -> None:
        self.distribution = distribution
        try:
            self._store = typestore(f"ros2_{distribution}")
        except NotAvailableError as error:
            raise ConfigurationError(
                "[ros2] needs the library rosbags, which is not installed: pip install 'lidarboost[ros2]'"
            ) from error

    def make(self, kind: str, **fields: Any) -> Any:
        """A message of a type such as `sensor_msgs/msg/Image`; every field must be given."""
        return self._store.types[kind](**fields)

    def cdr(self, kind: str, message: Any) -> bytearray:
        """Its bytes, in the order of this machine."""
        whole: Any = self._store.serialize_cdr(message, kind).obj
        return whole if isinstance(whole, bytearray) else bytearray(whole)

    def hash(self, kind: str) -> str:
        """What stands for the type's definition in a key: `RIHS01_…`."""
        found: str = UNHASHED if self.distribution == "humble" else self._store.hash_rihs01(kind)
        return found

    def header(self, timestamp: int, frame_id: str) -> Any:
        """A std_msgs/Header of a time in ns since the epoch; a stamp holds those before 2038."""
        return self.make("std_msgs/msg/Header", stamp=self.time(timestamp), frame_id=frame_id)

    def time(self, timestamp: int) -> Any:
        """A builtin_interfaces/Time of ns since the epoch."""
        seconds, rest = _stamp(timestamp)
        return self.make("builtin_interfaces/msg/Time", sec=seconds, nanosec=rest)


def stamped(payload: bytearray, timestamp: int) -> bytearray:
    """The same message, which begins with a std_msgs/Header, at another time (ns since the epoch)."""
    found = bytearray(payload)
    struct.pack_into("=iI", found, _HEADER, *_stamp(timestamp))
    return found


def _stamp(timestamp: int) -> tuple[int, int]:
    seconds, rest = divmod(timestamp, 10**9)
    return min(seconds, LAST_STAMP - 1), rest
