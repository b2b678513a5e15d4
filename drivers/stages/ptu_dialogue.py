"""How to talk to a Directed Perception / FLIR pan-tilt unit over an unreliable line.

The protocol is that of the PTU-D46 manual and of public drivers for it. Nothing that writes the unit's EEPROM
(`DS`, `DF`, unit numbers) is ever sent.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from drivers.clock import Clock
from drivers.errors import (
    DeviceLostError,
    DeviceTimeoutError,
    InitialisationError,
    LimitError,
    OperationError,
)
from drivers.stages.ptu_replies import Replies, Reply
from drivers.stages.serial_line import SerialLine

ANSWER_SECONDS = 1.0
"""A command of ten bytes and its answer take 30 ms at 9600 baud."""

QUIET_SECONDS = 0.1
"""Silence after which a unit has said all that it had to say."""

EVENTS = {
    "P": "the pan axis hit a limit",
    "T": "the tilt axis hit a limit",
    "D": "the head's cable came off",
}


class PtuDialogue:
    """Commands and queries to one unit; what it says unasked raises at the next of them."""

    def __init__(self, line: SerialLine, clock: Clock) -> None:
        self._line = line
        self._clock = clock
        self._replies = Replies()
        self._calibrating = False
        self._echo = self._verbose = False
        self.busy_until = 0
        """When a movement should have ended, ns; until then a unit that does not answer counts as moving."""

    def greet(self, timeout: float) -> None:
        """Handshake, repeated while a unit that was just powered calibrates itself.

        Raises:
            InitialisationError: nothing that speaks this protocol answers within `timeout` seconds.
        """
        with self._limits_are_normal():
            deadline = self._deadline(timeout)
            while True:
                self.configure()
                self._line.send(b"PR ")
                if self._next_reply(query=True, deadline=self._deadline(ANSWER_SECONDS)) is not None:
                    break
                if self._clock.now() >= deadline:
                    raise InitialisationError(
                        f"{self._line.name}: no pan-tilt unit answers within {timeout:g} s; check its power "
                        "and cable, and the baud rate (9600 as delivered, often 115200 on the E series)"
                    )
            self.configure()  # again: the unit may have woken up after the first of the settings
            manner = self._exchange("PP", query=True)
            self._echo, self._verbose = b"PP" in manner.before.upper(), manner.verbose

    def configure(self) -> None:
        """Terse, no echo, position control, immediate mode."""
        self._line.send(b" ")  # ends a command cut short, and an autoscan
        self._clock.sleep(0.1)
        self._settle()
        for command in (b"FT ", b"ED ", b"CI ", b"I "):
            self._line.send(command)
        self._clock.sleep(0.2)
        self._settle()

    def command(self, command: str) -> None:
        """Send a command that may be repeated without harm, and await its `*`; raises as `query`."""
        if self._changed_manner(command, self._exchange(command, query=False)):
            self.query("PP")

    def query(self, query: str) -> float:
        """The number that the unit answers.

        Raises:
            OperationError: the unit refuses.
            LimitError: meanwhile an axis has hit a limit; steps are lost.
            DeviceTimeoutError: no answer, but a movement is under way.
            DeviceLostError: no answer, or the unit has restarted.
        """
        reply = self._exchange(query, query=True)
        if self._changed_manner(query, reply):
            reply = self._exchange(query, query=True)  # noise can look like an echo, but not twice
            if self._changed_manner(query, reply):
                raise DeviceLostError(
                    f"{self._line.name}: the unit has restarted and lost its settings; close it, open it "
                    "again and home it"
                )
        assert reply.number is not None
        return reply.number

    def await_movement(self, deadline: int) -> bool:
        """Whether the unit says before `deadline` (ns) that its movement is complete."""
        self._absorb()
        self._line.send(b"A ")
        reply = self._next_reply(query=False, deadline=deadline)
        if reply is not None and reply.kind == "refused":
            raise OperationError(f"{self._line.name}: the unit refuses to await its movement: {reply.text}")
        return reply is not None

    def reset(self, timeout: float) -> None:
        """Calibration move of both axes: the unit runs into its limits and says so (`!T!T!P!P*`).

        Raises:
            DeviceTimeoutError: it did not come to its end.
        """
        with self._limits_are_normal():
            self._absorb()
            self._line.send(b" R ")
            reply = self._next_reply(query=False, deadline=self._deadline(timeout))
            if reply is None or reply.kind == "refused":
                raise DeviceTimeoutError(
                    f"{self._line.name}: no end of the calibration move within {timeout:g} s; check the "
                    "unit's power and that nothing blocks it"
                )
            self.configure()

    def _exchange(self, command: str, query: bool) -> Reply:
        refusal: Reply | None = None
        for _ in range(2):  # once more where noise spoilt it
            self._absorb()
            self._line.send(f"{command} ".encode())
            reply = self._next_reply(query, self._deadline(ANSWER_SECONDS))
            if reply is not None and reply.kind == "done" and (not query or reply.number is not None):
                return reply
            refusal = reply if reply is not None else refusal
            self._settle()
        if refusal is not None:
            raise OperationError(f"{self._line.name}: the unit answers {command!r} with {refusal.text!r}")
        if self._clock.now() < self.busy_until:
            raise DeviceTimeoutError(f"{self._line.name}: the unit is moving and does not answer {command!r}")
        raise DeviceLostError(
            f"{self._line.name}: the unit does not answer {command!r}; check its power and cable, then "
            "close it, open it again and home it"
        )

    def _changed_manner(self, command: str, reply: Reply) -> bool:
        """A unit that was powered anew has echo and words on again."""
        echo = command.encode() in reply.before.upper()
        return (echo and not self._echo) or (reply.verbose and not self._verbose)

    def _absorb(self) -> None:
        """Take what was said unasked: events raise, late answers and noise are dropped."""
        self._replies.feed(self._line.pending())
        while (reply := self._replies.take(query=False, final=True)) is not None:
            self._notice(reply)
        self._replies.clear()

    def _settle(self) -> None:
        self._replies.feed(self._line.discard(QUIET_SECONDS))
        self._absorb()

    def _next_reply(self, query: bool, deadline: int) -> Reply | None:
        while True:
            remaining = max(0.0, (deadline - self._clock.now()) / 1e9)
            data = self._line.receive(min(QUIET_SECONDS, remaining))
            self._replies.feed(data)
            while (reply := self._replies.take(query, final=not data)) is not None:
                self._notice(reply)
                if reply.kind != "event":
                    return reply
            if not data and self._clock.now() >= deadline:
                return None

    def _notice(self, reply: Reply) -> None:
        if reply.kind == "event" and not self._calibrating:
            self.busy_until = 0
            raise LimitError(f"{self._line.name}: {EVENTS[reply.text]}; steps are lost: home it")

    @contextmanager
    def _limits_are_normal(self) -> Iterator[None]:
        self._calibrating = True
        try:
            yield
        finally:
            self._calibrating = False

    def _deadline(self, seconds: float) -> int:
        return self._clock.now() + round(seconds * 1e9)
