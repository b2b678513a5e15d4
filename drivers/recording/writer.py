"""Writing a recording: one MCAP file with everything needed to fuse and to judge it later."""

import json
import uuid
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import IO, Self, cast

from mcap.data_stream import RecordBuilder
from mcap.records import DataEnd, Footer
from mcap.writer import MCAP0_MAGIC

from drivers.calibration import Calibration, Mount
from drivers.errors import StateError, StorageError
from drivers.frame import Frame
from drivers.messages import Message, Schema, calibration_message, frame_messages
from drivers.recording import attachments
from drivers.recording.compression import Compression, writer_class
from drivers.recording.output import Output
from drivers.recording.versions import library, versions

CHUNK_SIZE = 256 * 1024
"""Bytes before compression; two or three frames, the most that is lost when the process is killed."""

SEQUENCE_MASK = 0xFFFFFFFF
"""MCAP counts in 32 bits; camera/frame holds the whole number."""


class RecordingWriter:
    """A recording being written, under `path + ".active"` until it is closed.

    As a context manager it closes at the end, and discards the file when an exception passes, except when
    the disk failed: then what was written is kept, unless it shall be `whole`.

    Args:
        path: where the recording shall be.
        metadata: run id, rig, camera serial and what else is known; run id and software version are added.
        compression: small, or quick.
        whole: nothing is left where the disk fails, and a file of that name stays as it was: for what can be
            made again.

    Raises:
        StorageError: the file cannot be made or written. Writing is over then; `close` keeps what there is.
    """

    def __init__(
        self,
        path: Path | str,
        metadata: Mapping[str, str] | None = None,
        compression: Compression = Compression.SMALL,
        *,
        whole: bool = False,
    ) -> None:
        self.path = Path(path)
        self._whole = whole
        self._schemas: dict[Schema, int] = {}
        self._channels: dict[str, tuple[int, Schema]] = {}
        self._calibration: bytes | None = None
        self._is_closed = False
        self._output = Output(self.path)
        self._writer = writer_class(compression)(
            cast(IO[bytes], self._output), chunk_size=CHUNK_SIZE, enable_data_crcs=True
        )
        try:
            self._begin(metadata or {})
        except BaseException:
            self.discard()
            raise

    @property
    def working_path(self) -> Path:
        """What the file is called until it is closed."""
        return self._output.working_path

    @property
    def size(self) -> int:
        """Bytes in the file so far; up to one chunk more is held in memory."""
        return self._output.tell()

    @property
    def is_there(self) -> bool:
        """Whether the file still is where it was made: not deleted, its folder not unmounted."""
        return self._output.is_there

    def attach(self, name: str, data: bytes, media_type: str, log_time: int = 0) -> None:
        """Add a named file; `log_time` in ns since the epoch, 0 = not known."""
        self._require_open()
        self._writer.add_attachment(log_time, log_time, name, media_type, data)
        if name == attachments.CALIBRATION:
            self._calibration = data

    def note(self, name: str, content: Mapping[str, str]) -> None:
        """Add a metadata record."""
        self._require_open()
        self._writer.add_metadata(name, dict(content))

    def write(self, message: Message, log_time: int) -> None:
        """Append a message; `log_time` is when this host received it, ns since the epoch."""
        self._require_open()
        self._writer.add_message(
            channel_id=self._channel(message),
            log_time=log_time,
            data=message.payload,
            publish_time=message.publish_time,
            sequence=message.sequence & SEQUENCE_MASK,
        )

    def write_frame(self, frame: Frame, mount: Mount, log_time: int | None = None) -> None:
        """Append a frame with its stage transform; `log_time` is its own timestamp where not given."""
        for message in frame_messages(frame, mount):
            self.write(message, frame.timestamp if log_time is None else log_time)

    def attach_calibration(self, calibration: Calibration, timestamp: int) -> None:
        """Attach the calibration whole, unless it is the one attached last; it holds from `timestamp` on."""
        content = calibration.to_toml().encode()
        if content != self._calibration:
            self.attach(attachments.CALIBRATION, content, "application/toml", timestamp)

    def write_calibration(self, calibration: Calibration, timestamp: int) -> None:
        """Append the calibration as a message and, where it is new in the file, attach it whole."""
        self.attach_calibration(calibration, timestamp)
        self.write(calibration_message(calibration, timestamp), timestamp)

    def flush(self, *, sync: bool = False) -> None:
        """Make everything written so far readable, should the process die; with `sync` also the machine."""
        self._require_open()
        self._writer.flush()  # type: ignore[no-untyped-call]
        if sync:
            self._output.sync()

    def close(self) -> None:
        """Complete the file and give it its name; closing twice does nothing.

        Raises:
            StorageError: the last chunk or the index did not fit; what was written before has been kept
                under the final name and can be read, unless it shall be `whole`.
        """
        if self._is_closed:
            return
        self._is_closed = True
        failed_before = self._output.failure is not None
        if not failed_before:
            with suppress(StorageError):
                self._writer.finish()  # type: ignore[no-untyped-call]
        if self._output.failure is not None:
            if self._whole:
                self._output.discard()
                raise self._output.failure
            self._output.append_last(_ending())
        try:
            self._output.finish()
        except StorageError:
            if self._whole:
                self._output.discard()
            raise
        if self._output.failure is not None and not failed_before:
            raise self._output.failure

    def discard(self) -> None:
        """Give up: remove the file."""
        if not self._is_closed:
            self._is_closed = True
            self._output.discard()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None or (self._output.failure is not None and not self._whole):
            self.close()
        else:
            self.discard()

    def _begin(self, metadata: Mapping[str, str]) -> None:
        here = versions()
        self._writer.start(library=library())
        known = {"run_id": uuid.uuid4().hex, "software_version": here["lidarboost"]}
        self._writer.add_metadata(attachments.METADATA, known | dict(metadata))
        self.attach(attachments.VERSIONS, json.dumps(here, indent=1).encode(), "application/json")

    def _channel(self, message: Message) -> int:
        if message.topic not in self._channels:
            schema = message.schema
            if schema not in self._schemas:
                self._schemas[schema] = self._writer.register_schema(
                    schema.name, schema.encoding, schema.data
                )
            channel = self._writer.register_channel(
                "/" + message.topic, message.message_encoding, self._schemas[schema]
            )
            self._channels[message.topic] = channel, schema
        channel, schema = self._channels[message.topic]
        if schema is not message.schema and schema != message.schema:
            raise ValueError(
                f"topic {message.topic} holds {schema.name}; a message of another schema "
                f"({message.schema.name}) needs a topic of its own"
            )
        return channel

    def _require_open(self) -> None:
        if self._is_closed:
            raise StateError(f"cannot write to {self.path}: the recording is closed; open a new one")


def _ending() -> bytes:
    """The end of a valid MCAP file without an index."""
    builder = RecordBuilder()
    DataEnd(0).write(builder)
    Footer(summary_start=0, summary_offset_start=0, summary_crc=0).write(builder)
    return bytes(builder.end()) + MCAP0_MAGIC  # type: ignore[no-untyped-call]
