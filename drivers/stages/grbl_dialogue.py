"""How to talk to a Grbl 1.1 controller: one line, one `ok`; status on request; alarms at any time.

Neither an `ok` nor a status report says what it answers. The line keeps order, so a marker, a question whose
answer cannot be taken for another, tells what is late: whatever comes before its answer was for somebody
earlier. Two markers take turns, lest a late answer to the one is taken for the next.
"""

from __future__ import annotations

from itertools import cycle

from drivers.clock import Clock
from drivers.errors import DeviceLostError, InitialisationError, LimitError, OperationError
from drivers.stages.grbl_lines import GrblLines
from drivers.stages.grbl_messages import (
    ALARM,
    ALARMS,
    ANSWER,
    BANNER,
    ERRORS,
    LOCKED,
    Status,
    parse_status,
)
from drivers.stages.serial_line import SerialLine

ANSWER_SECONDS = 1.0
"""An answer takes milliseconds at 115200 baud; a settings dump of 1 kB a tenth of a second."""

MARKER_SECONDS = 1.5
REPORT_SECONDS = 0.25
REPORT_ATTEMPTS = 12
"""A line may stall for two or three seconds."""

HALT_POLL_SECONDS = 0.1
BANNER_SECONDS = 3.0
"""The boot loader of an Arduino waits for up to two seconds after a reset."""

QUIET_SECONDS = 0.1
SOFT_RESET = b"\x18"
HOLD_AND_CANCEL_JOG = b"!\x85"
MARKERS = ("$G", "[GC:"), ("$", "[HLP:")


class RestartedError(DeviceLostError):
    """The controller has started again by itself: it stands, and has lost its position."""


class GrblDialogue:
    """Lines to one controller; an alarm or a restart raises at the next of them."""

    def __init__(self, line: SerialLine, clock: Clock) -> None:
        self._name, self._clock = line.name, clock
        self._lines = GrblLines(line, clock)
        self._markers = cycle(MARKERS)
        self._owed = False
        """Whether an answer is outstanding, or was never waited for."""
        self._is_deaf = False
        """Whether it heeds nothing but a reset: while homing, or after an alarm for a limit."""

    def greet(self) -> None:
        """Wait for the banner: opening the port resets most boards. Of others, only a silent one is reset.

        Raises:
            InitialisationError: no Grbl, or one that is in the middle of something.
        """
        if not (self._banner() or self._report() or self.reset()):
            raise InitialisationError(
                f"{self._name}: no Grbl controller answers; check its power and cable, and the baud "
                "rate (115200 as delivered)"
            )
        found = self._report()
        state = "unknown" if found is None else found.state
        if state not in ("Idle", "Alarm"):
            raise InitialisationError(
                f"{self._name}: Grbl is in state {state}, in the middle of something that was not begun "
                "here; let it end, or reset it with its button"
            )

    def reset(self) -> bool:
        """Soft reset, which empties the planner; whether the controller came back.

        Where it stood, it keeps its position; where it moved, it falls into an alarm (doc/commands.md).
        """
        self._lines.send(SOFT_RESET)
        self._is_deaf = False
        return self._banner() or self._caught_up()

    def halt(self, seconds: float) -> bool:
        """Stop and leave nothing queued; whether it stands and knows where.

        Args:
            seconds: what coming to a stop may take.

        Raises:
            OperationError: nothing says that it stands.
        """
        if self._is_deaf:
            self._reset_for_certain()
            return False
        self._lines.send(HOLD_AND_CANCEL_JOG)
        self._owed = True
        found = self._standing(self._deadline(seconds))
        if found is not None and found.state == "Idle":
            return True
        self._reset_for_certain()  # a hold that somebody releases would take up the rest of the movement
        after = self._report()
        return found is not None and found.stands and after is not None and after == _idle(found)

    def home(self, timeout: float) -> None:
        """Run the homing cycle; raises as `command`."""
        self._is_deaf = True
        self.command("$H", timeout, attempts=1)
        self._is_deaf = False

    def command(self, command: str, timeout: float = ANSWER_SECONDS, attempts: int = 2) -> list[str]:
        """Send a line, again where noise spoilt it; the lines that came before its `ok`.

        Raises:
            OperationError: the controller answers `error:N`, to every attempt.
            LimitError: it has fallen into an alarm, or is locked by one.
            DeviceLostError: it does not answer, or has restarted.
        """
        error = 0
        for _ in range(attempts):
            self._absorb()
            if self._owed and not self._caught_up():
                break
            self._send(f"{command}\n".encode())
            lines: list[str] = []
            deadline = self._deadline(timeout)
            while (line := self._lines.next(deadline)) is not None:
                self._raise_if_upset(line)
                if answer := ANSWER.search(line):
                    self._owed = False
                    if answer[1]:
                        return lines
                    error = int(answer[2])
                    break
                lines.append(line)
        if error:
            meaning = ERRORS.get(error, "see Grbl's list of errors")
            kind = LimitError if error == LOCKED else OperationError
            raise kind(f"{self._name}: Grbl answers {command!r} with error:{error} ({meaning})")
        raise self._silent(command)

    def status(self) -> Status:
        """A status report that is newer than this call; raises as `command`."""
        self._absorb()
        caught, found = self._caught_up(), self._report()
        if caught and found is not None:
            return found
        if found is not None and found.state in ("Hold", "Door"):
            raise OperationError(
                f"{self._name}: Grbl is in state {found.state}: a feed hold or the safety door stops it"
            )
        raise self._silent("?")

    def _caught_up(self) -> bool:
        """Whether a marker's answer has come, and with it everything that is late."""
        for _ in range(2):
            marker, tag = next(self._markers)
            self._send(f"{marker}\n".encode())
            deadline = self._deadline(MARKER_SECONDS)
            tagged = False
            while (line := self._lines.next(deadline)) is not None:
                self._raise_if_upset(line)
                tagged = tagged or line.startswith(tag)
                if tagged and line == "ok":
                    self._owed = False
                    return True
        return False

    def _report(self, attempts: int = REPORT_ATTEMPTS) -> Status | None:
        """A status report, perhaps an older one."""
        for _ in range(attempts):  # noise may spoil one
            self._send(b"?")
            deadline = self._deadline(REPORT_SECONDS)
            while (line := self._lines.next(deadline)) is not None:
                self._raise_if_upset(line)
                if (found := parse_status(line)) is not None:
                    return found
        return None

    def _standing(self, deadline: int) -> Status | None:
        """The report of a controller that stands; None where it has lost its position or says nothing."""
        try:
            while self._clock.now() < deadline:
                found = self._report(attempts=1)
                if found is not None and found.stands and (found.state != "Idle" or self._caught_up()):
                    again = self._report(attempts=1)  # after what was late, and from the same place
                    if again == found:
                        return found
                self._clock.sleep(HALT_POLL_SECONDS)
        except (LimitError, RestartedError):
            return None
        return None

    def _reset_for_certain(self) -> None:
        if not self.reset():
            raise DeviceLostError(
                f"{self._name}: the controller does not come back from its reset, and may still move: "
                "cut its power"
            )

    def _banner(self) -> bool:
        deadline = self._deadline(BANNER_SECONDS)
        while (line := self._lines.next(deadline)) is not None:
            if BANNER.search(line):
                self._lines.discard(QUIET_SECONDS)
                self._owed = False
                return True
        return False

    def _silent(self, command: str) -> DeviceLostError:
        return DeviceLostError(
            f"{self._name}: the controller does not answer {command!r}; check its power and cable, then "
            "close it, open it again and home it"
        )

    def _absorb(self) -> None:
        """Take what was said unasked: an alarm or a restart raises, the rest is dropped."""
        for line in self._lines.arrived():
            self._raise_if_upset(line)

    def _send(self, data: bytes) -> None:
        self._owed = True
        self._lines.send(data)

    def _raise_if_upset(self, line: str) -> None:
        if BANNER.search(line):
            raise RestartedError(
                f"{self._name}: the controller has restarted; close it, open it again and home it"
            )
        if alarm := ALARM.search(line):
            self._is_deaf = True
            meaning = ALARMS.get(int(alarm[1]), "see Grbl's list of alarms")
            raise LimitError(f"{self._name}: ALARM:{alarm[1]}, {meaning}; home it")

    def _deadline(self, seconds: float) -> int:
        return self._clock.now() + round(seconds * 1e9)


def _idle(status: Status) -> Status:
    """What a controller that stood so reports after a soft reset."""
    return Status("Idle", 0, status.machine)
