"""How to talk to a Directed Perception / FLIR pan-tilt unit over an unreliable line.

The protocol is that of the PTU-D46 manual and of public drivers for it. Nothing that writes the unit's EEPROM
(`DS`, `DF`, unit numbers) is ever sent, nor `A`, which would keep the unit from hearing a halt.

The unit answers everything once and in order. So whatever was lost, came late or came twice, the line is
clean again as soon as the answer to `V` has come: it looks like no other, and nothing older follows it.
"""

from __future__ import annotations

from drivers.clock import Clock
from drivers.errors import (
    DeviceLostError,
    DeviceTimeoutError,
    InitialisationError,
    OperationError,
)
from drivers.stages.ptu_ear import QUIET_SECONDS, PtuEar
from drivers.stages.ptu_replies import LIMITS, UNNAMED, VERSION, Reply, cut
from drivers.stages.serial_line import SerialLine

ANSWER_SECONDS = 1.0
"""A command of ten bytes and its answer in words take 60 ms at 9600 baud."""

FENCE_SECONDS = 3.0
"""What a stalled line may hold back before the unit counts as lost."""


class PtuDialogue:
    """Commands and queries to one unit; what it says unasked raises at the next of them."""

    def __init__(self, line: SerialLine, clock: Clock) -> None:
        self._line = line
        self._clock = clock
        self._ear = PtuEar(line, clock)
        self._echo = self.echoed_at_first = False

    @property
    def strays(self) -> int:
        """Answers that belonged to nothing just asked: late ones, doubled ones, noise."""
        return self._ear.strays

    def greet(self, timeout: float) -> None:
        """Set the manner of speaking, again and again while a unit just powered calibrates itself.

        Raises:
            InitialisationError: nothing that speaks this protocol answers within `timeout` seconds.
        """
        with self._ear.expecting_events():
            deadline = self._deadline(timeout)
            while True:
                self._configure()
                self._line.send(b"V ")
                if self._answer(VERSION, self._deadline(ANSWER_SECONDS)) is not None:
                    break
                if self._clock.now() >= deadline:
                    raise InitialisationError(
                        f"{self._line.name}: no pan-tilt unit answers within {timeout:g} s; check its power "
                        "and cable, and the baud rate (9600 as delivered, often 115200 on the E series)"
                    )
            self._configure()  # again: the unit may have woken up after the first of the settings
            self._echo = b"V" in self._fence().before.upper()

    @property
    def is_quiet(self) -> bool:
        """Whether the unit has switched its echo off, so that it tells by echoing when it has restarted."""
        return not self._echo

    def listen(self) -> None:
        """Hear the unit out; raises as `query` for a limit that was hit."""
        self._ear.settle()

    def halt_what_moves(self) -> bool:
        """The first words to a unit: halt; whether it was on its way somewhere then.

        The first byte ends an autoscan, upon which the unit would go home by itself. So where it is and where
        it wants to be is asked in one breath with the halt, in whatever manner it speaks.
        """
        self._line.pending()
        self._line.send(b" PO PP TO TP H ")
        said = self._line.discard(2 * QUIET_SECONDS)
        self.echoed_at_first = b"PO PP" in said.upper()
        numbers = [reply.number for reply in cut(said) if reply.kind == "done" and reply.number is not None]
        return len(numbers) == 4 and numbers[::2] != numbers[1::2]

    def command(self, command: str, timeout: float = ANSWER_SECONDS) -> None:
        """Send a command that may be repeated without harm, and await its `*`; raises as `query`."""
        if self._is_echoed(command, self._exchange(command, "", timeout)):
            self.query("PP")

    def query(self, query: str) -> float:
        """The number that the unit answers to this query, never to another.

        Raises:
            OperationError: the unit refuses.
            LimitError: meanwhile an axis has hit a limit; steps are lost.
            DeviceLostError: no answer, or the unit has restarted.
        """
        number = self._asked(query).number
        assert number is not None
        return number

    def enforces_limits(self) -> bool:
        """Whether the unit itself refuses positions beyond its limits; raises as `query`."""
        return "DISABLED" not in self._asked(LIMITS).text.upper()

    def reset(self, timeout: float) -> None:
        """Calibration move of both axes: the unit runs into its limits and says so (`!T!T!P!P*`).

        Raises:
            DeviceTimeoutError: it did not come to its end.
        """
        with self._ear.expecting_events():
            self._fence()
            self.command("RE")  # or `R` would turn no axis, and be answered all the same
            self._line.send(b"R ")
            reply = self._answer("", self._deadline(timeout))
            if reply is None or reply.kind == "refused":
                raise DeviceTimeoutError(
                    f"{self._line.name}: no end of the calibration move within {timeout:g} s; check the "
                    "unit's power and that nothing blocks it"
                )
            self._configure()
            self._fence()

    def halt(self) -> list[str]:
        """Stop both axes, whatever was being said; the events that came meanwhile. Raises as `query`."""
        self._line.send(b" H ")  # the first space ends a command cut short
        with self._ear.expecting_events() as events:
            self._fence()
        return events

    def _configure(self) -> None:
        """No movement, words, no echo, position control, immediate mode."""
        self._line.send(b" H ")
        self._clock.sleep(0.1)
        self._ear.settle()
        for command in (b"FV ", b"ED ", b"CI ", b"I "):
            self._line.send(command)
        self._clock.sleep(0.2)
        self._ear.settle()

    def _asked(self, query: str) -> Reply:
        reply = self._exchange(query, query, ANSWER_SECONDS)
        if self._is_echoed(query, reply):
            reply = self._exchange(query, query, ANSWER_SECONDS)  # noise can look like an echo, but not twice
            if self._is_echoed(query, reply):
                raise DeviceLostError(
                    f"{self._line.name}: the unit has restarted and lost its settings; close it, open it "
                    "again and home it"
                )
        return reply

    def _exchange(self, sent: str, query: str, timeout: float) -> Reply:
        refusal: Reply | None = None
        for _ in range(2):  # once more where noise spoilt it
            strays = self.strays
            self._ear.absorb()
            if self.strays != strays or query in UNNAMED:
                self._fence()
            self._line.send(f"{sent} ".encode())
            reply = self._answer(query, self._deadline(timeout))
            if reply is not None and reply.kind == "done":
                return reply
            refusal = reply if reply is not None else refusal
            self._fence()
        if refusal is not None:
            raise OperationError(f"{self._line.name}: the unit answers {sent!r} with {refusal.text!r}")
        raise self._silent(sent)

    def _fence(self) -> Reply:
        """Make sure that nothing is left to be answered."""
        for _ in range(2):
            self._line.send(b"V ")
            reply = self._answer(VERSION, self._deadline(FENCE_SECONDS))
            if reply is not None:
                return reply
        raise self._silent("V")

    def _answer(self, query: str, deadline: int) -> Reply | None:
        """The answer to a query (empty = a command), or a refusal; None where none comes in time."""
        while (reply := self._ear.next_reply(bool(query), deadline)) is not None:
            wanted = query != VERSION if reply.kind == "refused" else reply.fits(query)
            if wanted:
                return reply
            self._ear.stray(reply)
        return None

    def _is_echoed(self, command: str, reply: Reply) -> bool:
        """A unit that was powered anew has its echo on again."""
        return command.encode() in reply.before.upper() and not self._echo

    def _silent(self, command: str) -> DeviceLostError:
        return DeviceLostError(
            f"{self._line.name}: the unit does not answer {command!r}; check its power and cable, then "
            "close it, open it again and home it"
        )

    def _deadline(self, seconds: float) -> int:
        return self._clock.now() + round(seconds * 1e9)
