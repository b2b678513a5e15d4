"""A serial line: opened exclusively, read with deadlines, its faults typed."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Self

import serial

from drivers.clock import Clock
from drivers.errors import DeviceLostError, NotAvailableError

POLL_SECONDS = 0.02
"""How long one read blocks; a deadline is overrun by this much at most."""

WRITE_SECONDS = 1.0
"""A command is some ten bytes: a line that takes none of them for a second is dead."""


class SerialLine:
    """Bytes out, bytes in; eight data bits, no parity, one stop bit, no handshaking.

    Args:
        port: an open pyserial port.
        name: how it is called in messages.
        clock: time source of the deadlines.
        heed: called again and again while bytes are awaited; what it raises ends the wait.
    """

    def __init__(
        self, port: serial.Serial, name: str, clock: Clock, heed: Callable[[], None] = lambda: None
    ) -> None:
        self._port = port
        self.name = name
        self._clock, self._heed = clock, heed

    @classmethod
    def open(cls, name: str, baud_rate: int, clock: Clock, heed: Callable[[], None] = lambda: None) -> Self:
        """Open a port (`/dev/ttyUSB0`) or a pyserial URL (`socket://host:4000`).

        Raises:
            NotAvailableError: no such port, no permission, in use, or a URL that cannot be reached.
        """
        try:
            port = serial.serial_for_url(
                name,
                baudrate=baud_rate,
                timeout=POLL_SECONDS,
                write_timeout=WRITE_SECONDS,
                exclusive=None if "://" in name else True,
            )
        except (serial.SerialException, OSError, ValueError) as error:
            raise NotAvailableError(_refusal(name, error)) from error
        return cls(port, name, clock, heed)

    def send(self, data: bytes) -> None:
        """Write all of `data`; raises `DeviceLostError` where the line does not take it."""
        with self._lost_on_fault():
            self._port.write(data)

    def receive(self, timeout: float) -> bytes:
        """What has arrived, at least one byte; empty when nothing comes within `timeout` seconds."""
        deadline = self._clock.now() + round(timeout * 1e9)
        while True:
            self._heed()
            with self._lost_on_fault():
                data: bytes = self._port.read(max(1, self._port.in_waiting))
            if data or self._clock.now() >= deadline:
                return data

    def pending(self) -> bytes:
        """What has already arrived, without waiting."""
        with self._lost_on_fault():
            waiting = self._port.in_waiting
            return self._port.read(waiting) if waiting else b""

    def discard(self, seconds: float) -> bytes:
        """Throw away whatever arrives until the line has been quiet for `seconds`; returns it."""
        thrown = b""
        while data := self.receive(seconds):
            thrown += data
        return thrown

    def close(self) -> None:
        """Release the port; safe when the device is gone."""
        try:
            self._port.close()
        except (serial.SerialException, OSError):
            return

    @contextmanager
    def _lost_on_fault(self) -> Iterator[None]:
        try:
            yield
        except (serial.SerialException, OSError, TypeError) as error:
            # pyserial raises TypeError from a read on a port that another thread has closed.
            raise DeviceLostError(f"{self.name}: the serial line is gone ({error}); open it again") from error


def _refusal(name: str, error: Exception) -> str:
    number = getattr(error, "errno", None)
    if number == errno.ENOENT:
        return (
            f"{name}: there is no such serial port; plug the device in and see `ls /dev/serial/by-id` "
            "for its name"
        )
    if number in (errno.EACCES, errno.EPERM):
        return f"{name}: no permission to open the serial port; run: {permission_remedy(name)}"
    if number in (errno.EAGAIN, errno.EBUSY):
        return f"{name}: another program uses the serial port; find it with: fuser -v {name}"
    return f"{name}: cannot open the serial port ({error})"


def permission_remedy(name: str) -> str:
    """The line that lets this user open the port `name`; it holds from the next login on."""
    try:
        group = Path(name).group()
    except (OSError, KeyError):
        group = "dialout"
    return f"sudo usermod -aG {group} {os.environ.get('USER', '$USER')}  (then log in again)"
