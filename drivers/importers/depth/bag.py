"""Bags: messages of ROS or Foxglove in MCAP, SQLite or ROS 1's own format, in the order of the file."""

import re
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from drivers.depth.messages import Form
from drivers.errors import NotAvailableError, RecordingError
from drivers.importers.exposure import Findings
from drivers.importers.natural import natural
from drivers.messages import CAMERA_FRAME
from drivers.recording.contents import Contents, check_magic, read_messages

SUFFIXES = (".mcap", ".db3", ".bag")

_FORMS: dict[str, Form] = {"cdr": "cdr", "ros1": "ros1", "protobuf": "protobuf"}


class Packet(NamedTuple):
    """One message: the type's name is `sensor_msgs/msg/Image` or `foxglove.RawImage`; time in ns."""

    topic: str
    kind: str
    form: Form
    log_time: int
    payload: bytes


class Bag:
    """One or several files that belong together, read in their natural order.

    Args:
        paths: files, or folders of a ROS 2 bag.
        findings: where a torn file is noted as lost; the others are read.

    Raises:
        RecordingError: a folder without files of a bag.
    """

    def __init__(self, paths: Sequence[Path], findings: Findings) -> None:
        self.files = [file for path in sorted(paths, key=natural) for file in _files_of(path)]
        self._findings = findings

    def packets(self, topics: Collection[str] | None = None, kinds: Collection[str] = ()) -> Iterator[Packet]:
        """Messages of some topics (None = all) and types (empty = all).

        Raises:
            NotAvailableError: ROS's own formats need a library that is not installed.
            RecordingError: no file can be read.
        """
        read, reason = 0, None
        for file in self.files:
            try:
                yield from self._packets(file, topics, kinds)
                read += 1
            except RecordingError as error:
                if len(self.files) == 1:
                    raise
                reason = error
                self._findings.lose(str(error))
        if not read and reason is not None:
            raise reason

    def _packets(
        self, file: Path, topics: Collection[str] | None, kinds: Collection[str]
    ) -> Iterator[Packet]:
        read = self._mcap if file.suffix == ".mcap" else _by_rosbags
        for packet in read(file, topics):
            if not kinds or packet.kind in kinds:
                yield packet

    def _mcap(self, path: Path, topics: Collection[str] | None) -> Iterator[Packet]:
        check_magic(path)
        contents = Contents()
        try:
            with path.open("rb") as file:
                for found in read_messages(file, contents):
                    channel, schema = found.channel, contents.schemas.get(found.channel.schema_id)
                    if found.topic == CAMERA_FRAME and channel.message_encoding == "json":
                        raise RecordingError(f"{path}: is a recording of this program; use it as it is")
                    form = _FORMS.get(channel.message_encoding)
                    if form is None or schema is None or (topics is not None and channel.topic not in topics):
                        continue
                    kind = _full(schema.name) if form == "ros1" else schema.name
                    yield Packet(channel.topic, kind, form, found.stored.log_time, found.payload)
        except OSError as error:
            raise RecordingError(f"{path}: cannot be read to its end ({error}); copy it again") from error
        torn = [fault for fault in contents.faults if fault.part != "index"]
        if torn:
            self._findings.lose(
                f"{path}: torn or garbled at byte {torn[0].offset:,} ({torn[0].reason}); the rest is read"
            )


def is_bag(path: Path) -> bool:
    """Whether a path is a file of a bag, or a folder of one."""
    if path.is_dir():
        return (path / "metadata.yaml").exists() or any(_inside(path))
    return path.suffix.lower() in SUFFIXES


def _files_of(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path]
    if _is_packed(path / "metadata.yaml"):
        return [path]
    found = sorted(_inside(path), key=natural)
    if not found:
        raise RecordingError(f"{path}: holds no file of a bag; expected {' or '.join(SUFFIXES)} files")
    return found


def _inside(folder: Path) -> Iterator[Path]:
    return (file for file in folder.iterdir() if file.suffix in SUFFIXES and file.is_file())


def _is_packed(metadata: Path) -> bool:
    """Whether files or messages are compressed one by one, which only the folder's description says."""
    try:
        told = metadata.read_text(errors="replace")
    except OSError:
        return False
    return re.search(r"compression_mode:\s*['\"]?(file|message)", told, re.IGNORECASE) is not None


def _by_rosbags(path: Path, topics: Collection[str] | None) -> Iterator[Packet]:
    """SQLite, compressed folders and ROS 1, by the library `rosbags`."""
    try:
        from rosbags import rosbag1, rosbag2
    except ImportError as error:
        raise NotAvailableError(
            f"{path}: bags of this kind are read by the library rosbags, which is not installed: "
            "pip install 'lidarboost[import]'"
        ) from error
    form: Form = "ros1" if path.suffix == ".bag" else "cdr"
    try:
        reader: Any = rosbag1.Reader(path) if form == "ros1" else rosbag2.Reader(path)
        with reader:
            wanted = [c for c in reader.connections if topics is None or c.topic in topics]
            for connection, log_time, payload in reader.messages(wanted) if wanted else ():
                yield Packet(connection.topic, _full(connection.msgtype), form, log_time, bytes(payload))
    except (RecordingError, NotAvailableError):
        raise
    except Exception as error:  # a torn file fails anywhere in the library and in SQLite
        said = " ".join(str(error).split()) or type(error).__name__
        raise RecordingError(f"{path}: cannot be read as a bag to its end ({said}); copy it again") from error


def _full(kind: str) -> str:
    """`sensor_msgs/Image`, as ROS 1 calls it, with the `msg` in between."""
    package, *_, name = kind.split("/")
    return f"{package}/msg/{name}"
