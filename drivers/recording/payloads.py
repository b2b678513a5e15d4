"""Payloads fetched from a file by their places, a few opened chunks at hand."""

from collections import OrderedDict
from pathlib import Path
from types import TracebackType
from typing import Self

from mcap.opcode import Opcode

from drivers.errors import RecordingError
from drivers.recording.assembly import Place
from drivers.recording.records import RECORD_HEADER, open_chunk

_AT_HAND = 16 << 20
"""Bytes of opened chunks that are kept; two at least, for a frame of a file sorted by topic lies in two."""


class Payloads:
    """Reads payloads of one file; closed at the end of the context."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._chunks: OrderedDict[int, bytes] = OrderedDict()
        try:
            self._file = path.open("rb")
        except OSError as error:
            raise RecordingError(f"{path}: cannot be read ({error.strerror}); is it still there?") from error

    def read(self, place: Place) -> bytes:
        """The bytes at a place; raises `RecordingError` where the file has changed since it was found."""
        if place.chunk is None:
            payload = self._bytes(place.start, place.end - place.start)
        else:
            payload = self._chunk(place.chunk)[place.start : place.end]
        if len(payload) != place.end - place.start:
            raise self._changed()
        return payload

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._file.close()

    def _chunk(self, offset: int) -> bytes:
        known = self._chunks.pop(offset, None)
        if known is None:
            known = self._opened(offset)
        self._chunks[offset] = known
        while len(self._chunks) > 2 and sum(map(len, self._chunks.values())) > _AT_HAND:
            self._chunks.popitem(last=False)
        return known

    def _opened(self, offset: int) -> bytes:
        opcode, length = RECORD_HEADER.unpack(self._bytes(offset, RECORD_HEADER.size))
        try:
            if opcode == Opcode.CHUNK:
                return open_chunk(self._bytes(offset + RECORD_HEADER.size, length)).content
        except Exception as error:  # as when the file was opened; it was whole then
            raise self._changed() from error
        raise self._changed()

    def _bytes(self, start: int, length: int) -> bytes:
        try:
            self._file.seek(start)
            content = self._file.read(length)
        except OSError as error:
            raise self._changed() from error
        if len(content) != length:
            raise self._changed()
        return content

    def _changed(self) -> RecordingError:
        return RecordingError(f"{self._path}: has changed since it was opened; open it again")
