"""The lines that a Grbl controller sends, cut out of a byte stream."""

from __future__ import annotations

from collections.abc import Iterator

from drivers.clock import Clock
from drivers.stages.serial_line import SerialLine


class GrblLines:
    """Lines of text in, bytes out.

    Args:
        line: the serial line.
        clock: time source of the deadlines.
    """

    def __init__(self, line: SerialLine, clock: Clock) -> None:
        self._line, self._clock = line, clock
        self._buffer = b""

    def send(self, data: bytes) -> None:
        """As `SerialLine.send`."""
        self._line.send(data)

    def next(self, deadline: int) -> str | None:
        """The next line; None where none has ended by `deadline` (ns)."""
        while True:
            line = self._cut()
            if line is not None:
                return line
            remaining = (deadline - self._clock.now()) / 1e9
            if remaining <= 0:
                return None
            self._buffer += self._line.receive(remaining)

    def arrived(self) -> Iterator[str]:
        """The lines that have arrived; the beginning of another is dropped."""
        self._buffer += self._line.pending()
        while (line := self._cut()) is not None:
            yield line
        self._buffer = b""

    def discard(self, seconds: float) -> None:
        """Drop whatever arrives until the line has been quiet for `seconds`."""
        self._line.discard(seconds)
        self._buffer = b""

    def _cut(self) -> str | None:
        raw, ended, rest = self._buffer.partition(b"\n")
        if not ended:
            return None
        self._buffer = rest
        return raw.decode("ascii", "replace").strip()
