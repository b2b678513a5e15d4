"""Standard output and error that never undo a result: closed, of a narrow encoding, without a reader."""

import errno
import io
import os
import sys
from typing import IO


class _Lenient(io.RawIOBase):
    """A descriptor to write to; after a failure what is written goes nowhere."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor
        self.failure: OSError | None = None

    def write(self, data: "memoryview | bytes") -> int:  # type: ignore[override]
        size = len(data)
        rest = memoryview(data)
        while rest and self.failure is None:
            try:
                rest = rest[os.write(self._descriptor, rest) :]
            except OSError as error:
                self.failure = error
        return size

    def writable(self) -> bool:
        return True

    def isatty(self) -> bool:
        return os.isatty(self._descriptor)

    def fileno(self) -> int:
        return self._descriptor


def settle() -> None:
    """Have output go on whatever becomes of it; to be called once, before anything is written or opened.

    What an encoding lacks is replaced. Descriptors that are closed become the null device: the next file
    opened would get their number, and with it what others print.
    """
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.open(os.devnull, os.O_RDWR)  # takes the lowest that is free: this one
    if sys.stdin is None:
        sys.stdin = open(0, encoding="utf-8")  # noqa: SIM115 — for good
    sys.stdout = _lenient(sys.stdout, 1)
    sys.stderr = _lenient(sys.stderr, 2)


def is_gone() -> bool:
    """Whether nobody reads standard output any more."""
    return _failure() is not None


def loss() -> str | None:
    """Why standard output could not be written, where that is a loss: not where its reader left."""
    failure = _failure()
    return None if failure is None or failure.errno in (errno.EPIPE, errno.EBADF) else failure.strerror


def _lenient(stream: IO[str] | None, descriptor: int) -> io.TextIOWrapper:
    if stream is not None:
        stream.flush()
    return io.TextIOWrapper(
        io.BufferedWriter(_Lenient(descriptor)),  # type: ignore[type-var]
        encoding=getattr(stream, "encoding", None) or "utf-8",
        errors="replace",
        line_buffering=descriptor == 2 or os.isatty(descriptor),
        write_through=bool(getattr(stream, "write_through", False)),
    )


def _failure() -> OSError | None:
    raw = getattr(getattr(sys.stdout, "buffer", None), "raw", None)
    return raw.failure if isinstance(raw, _Lenient) else None
