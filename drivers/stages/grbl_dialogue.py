"""How to talk to a Grbl 1.1 controller: one line, one `ok`; status on request; alarms at any time."""

from __future__ import annotations

from drivers.clock import Clock
from drivers.errors import DeviceLostError, InitialisationError, LimitError, OperationError
from drivers.stages.grbl_messages import (
    ALARM,
    ALARMS,
    ANSWER,
    BANNER,
    ERRORS,
    LOCKED,
    Status,
    Vector,
    parse_status,
)
from drivers.stages.serial_line import SerialLine

ANSWER_SECONDS = 1.0
"""An answer takes milliseconds at 115200 baud; a settings dump of 1 kB a tenth of a second."""

BANNER_SECONDS = 3.0
"""The boot loader of an Arduino waits for up to two seconds after a reset."""

QUIET_SECONDS = 0.1
SOFT_RESET = b"\x18"


class GrblDialogue:
    """Lines to one controller; an alarm or a restart raises at the next of them."""

    def __init__(self, line: SerialLine, clock: Clock) -> None:
        self._line = line
        self._clock = clock
        self._buffer = b""
        self._offset: Vector | None = None
        self._waiting_for_banner = False

    def greet(self) -> None:
        """Wait for the banner: opening the port resets most boards; others are reset here.

        Raises:
            InitialisationError: no banner, or one of another version.
        """
        if not (self._banner() or self.reset()):
            raise InitialisationError(
                f"{self._line.name}: no Grbl controller answers; check its power and cable, and the baud "
                "rate (115200 as delivered)"
            )

    def reset(self) -> bool:
        """Soft reset; whether the controller came back."""
        self._line.send(SOFT_RESET)
        return self._banner()

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
            self._line.send(f"{command}\n".encode())
            lines: list[str] = []
            deadline = self._deadline(timeout)
            while (line := self._next_line(deadline)) is not None:
                if answer := ANSWER.search(line):
                    if answer[1]:
                        return lines
                    error = int(answer[2])
                    break
                lines.append(line)
            self._settle()
        if error:
            meaning = ERRORS.get(error, "see Grbl's list of errors")
            kind = LimitError if error == LOCKED else OperationError
            raise kind(f"{self._line.name}: Grbl answers {command!r} with error:{error} ({meaning})")
        raise self._silent(command)

    def status(self) -> Status:
        """A status report with machine positions; raises as `command`."""
        for _ in range(3):  # noise may spoil one, and the first after a reset may lack the offset
            self._absorb()
            self._line.send(b"?")
            deadline = self._deadline(ANSWER_SECONDS)
            while (line := self._next_line(deadline)) is not None:
                report = parse_status(line)
                if report is not None:
                    if (complete := self._complete(report)) is not None:
                        return complete
                    break
        raise self._silent("?")

    def _complete(self, report: Status) -> Status | None:
        self._offset = report.offset or self._offset
        if report.machine is not None:
            return report
        if report.work is None or self._offset is None:
            return None
        machine = tuple(w + o for w, o in zip(report.work, self._offset, strict=True))
        return Status(report.state, machine, report.work, self._offset)

    def _banner(self) -> bool:
        self._waiting_for_banner = True
        try:
            deadline = self._deadline(BANNER_SECONDS)
            while (line := self._next_line(deadline)) is not None:
                if banner := BANNER.search(line):
                    if banner[1] != "1":
                        raise InitialisationError(
                            f"{self._line.name}: this is Grbl {banner[1]}.{banner[2]}; version 1.1 is needed"
                        )
                    self._settle()
                    return True
            return False
        finally:
            self._waiting_for_banner = False

    def _silent(self, command: str) -> DeviceLostError:
        return DeviceLostError(
            f"{self._line.name}: the controller does not answer {command!r}; check its power and cable, then "
            "close it, open it again and home it"
        )

    def _absorb(self) -> None:
        """Take what was said unasked: an alarm or a restart raises, the rest is dropped."""
        self._buffer += self._line.pending()
        while self._cut_line() is not None:
            pass
        self._buffer = b""

    def _settle(self) -> None:
        self._buffer += self._line.discard(QUIET_SECONDS)
        self._absorb()

    def _next_line(self, deadline: int) -> str | None:
        while True:
            line = self._cut_line()
            if line is not None:
                return line
            remaining = (deadline - self._clock.now()) / 1e9
            if remaining <= 0:
                return None
            self._buffer += self._line.receive(remaining)

    def _cut_line(self) -> str | None:
        raw, ended, rest = self._buffer.partition(b"\n")
        if not ended:
            return None
        self._buffer = rest
        line = raw.decode("ascii", "replace").strip()
        if not self._waiting_for_banner:
            self._raise_if_upset(line)
        return line

    def _raise_if_upset(self, line: str) -> None:
        if BANNER.search(line):
            raise DeviceLostError(
                f"{self._line.name}: the controller has restarted; close it, open it again and home it"
            )
        if alarm := ALARM.search(line):
            meaning = ALARMS.get(int(alarm[1]), "see Grbl's list of alarms")
            raise LimitError(f"{self._line.name}: ALARM:{alarm[1]}, {meaning}; home it")

    def _deadline(self, seconds: float) -> int:
        return self._clock.now() + round(seconds * 1e9)
