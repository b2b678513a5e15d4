"""A device on a pseudo-terminal, so that the real port code runs against it."""

from __future__ import annotations

import os
import select
import threading
import time
import tty
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Self


class PtyEmulator:
    """Answers on a pty in a thread of its own.

    A subclass fills `handle` (bytes have come in) and `tick` (time has passed); both run in the thread.

    Args:
        link: path under which the port is found, also after a replug; none = the pty's own name only.
    """

    TICK_SECONDS = 0.002

    def __init__(self, link: Path | None = None) -> None:
        self._link = link
        self._lock = threading.RLock()
        self._stop = threading.Event()
        self._master: int | None = None
        self._name = ""
        self.now: Callable[[], float] = time.monotonic
        """Seconds; a line in virtual time (`VirtualLine`) puts its own clock here."""
        self.mute = False
        """While set, the device takes bytes and says nothing."""
        self._thread = threading.Thread(target=self._run, name=type(self).__name__, daemon=True)

    @property
    def port(self) -> str:
        return str(self._link) if self._link is not None else self._name

    def __enter__(self) -> Self:
        self.plug()
        self._thread.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop.set()
        self._thread.join()
        self.unplug()

    def plug(self) -> None:
        """Put the cable in: a new pty, as a replugged adapter is a new device."""
        with self._lock:
            self._master, slave = os.openpty()
            tty.setraw(slave)
            self._name = os.ttyname(slave)
            # The slave stays closed here: so the master tells by its hang-up whether a client has it open.
            os.close(slave)
            self._opened = False
            if self._link is not None:
                self._link.unlink(missing_ok=True)
                self._link.symlink_to(self._name)

    def unplug(self) -> None:
        """Pull the cable out."""
        with self._lock:
            if self._master is not None:
                os.close(self._master)
                self._master = None
            if self._link is not None:
                self._link.unlink(missing_ok=True)

    def announce(self, data: bytes) -> None:
        """Send what nobody asked for: an event, an echo, a banner."""
        self.say(data)

    def say(self, data: bytes) -> None:
        """Send an answer to the client."""
        with self._lock:
            if self._master is not None and not self.mute:
                os.write(self._master, data)

    def client_opened(self) -> None:
        """A client has opened the port."""

    def handle(self, data: bytes) -> None:
        """Bytes have come in."""
        raise NotImplementedError

    def tick(self) -> None:
        """Time has passed."""

    def _run(self) -> None:
        while not self._stop.is_set():
            with self._lock:
                self._serve()
                self.tick()
            time.sleep(self.TICK_SECONDS)

    def _serve(self) -> None:
        if self._master is None:
            return
        poll = select.poll()
        poll.register(self._master, select.POLLIN)
        events = poll.poll(0)
        hung_up = bool(events) and bool(events[0][1] & select.POLLHUP)
        if self._opened != (not hung_up):
            self._opened = not hung_up
            if self._opened:
                self.client_opened()
        if events and events[0][1] & select.POLLIN and not hung_up:
            self.handle(os.read(self._master, 4096))


class Motion:
    """One axis that moves at constant speed, in counts."""

    def __init__(self, speed: float, now: Callable[[], float] = time.monotonic) -> None:
        self.speed = speed
        self._now = now
        self._from = self._to = 0.0
        self._started = now()

    @property
    def position(self) -> float:
        travelled = (self._now() - self._started) * self.speed
        distance = abs(self._to - self._from)
        if distance == 0 or travelled >= distance:
            return self._to
        return self._from + (self._to - self._from) * travelled / distance

    @property
    def moving(self) -> bool:
        return self.position != self._to

    def go(self, target: float) -> None:
        self._from, self._to, self._started = self.position, target, self._now()

    @property
    def target(self) -> float:
        return self._to

    def resume(self, position: float) -> None:
        """Go on to the same target from `position`, at the speed that is now set."""
        self._from, self._started = position, self._now()

    def stop(self) -> None:
        self._from = self._to = self.position

    def set(self, position: float) -> None:
        self._from = self._to = position
