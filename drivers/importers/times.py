"""Times of frames as files tell them, and as a recording needs them."""

from decimal import Decimal
from pathlib import Path

from drivers.errors import RecordingError
from drivers.importers.exposure import Findings

FRAME_TIME = 32_000_000
"""ns; an SR4000 frame takes 31 to 32 ms, and no format says which instant of it was stamped."""

LAST = 1 << 62
"""ns; the year 2116."""


def nanoseconds(time: Decimal) -> int:
    """A time as a recording can hold it; raises `ValueError` where it is none."""
    if not time.is_finite() or not 0 <= time < LAST:
        raise ValueError(f"expected 0 to {LAST / 1e9:.0f} s")
    return round(time)


class Times:
    """Times that rise from frame to frame, whatever files are put after one another.

    Args:
        frame_rate: frames per second where the files store no times; None = not told.
    """

    def __init__(self, frame_rate: float | None, findings: Findings) -> None:
        self._period = None if frame_rate is None else round(1e9 / frame_rate)
        self._findings = findings
        self._last: int | None = None
        self._step = FRAME_TIME
        self._offset = 0

    def next(self, time: int | None, path: Path) -> int:
        """ns of the next frame.

        Raises:
            RecordingError: no time is stored, and no frame rate was told.
        """
        now = self._counted(path) if time is None else self._told(time, path)
        if self._last is not None:
            self._step = now - self._last
        self._last = now
        return now

    def _counted(self, path: Path) -> int:
        if self._last is None:
            self._findings.note(f"no times are stored; {path.name} is taken to be at 0 s")
            return 0
        if self._period is None:
            raise RecordingError(f"{path}: says no times; give the frame rate (--rate)")
        return self._last + self._period

    def _told(self, time: int, path: Path) -> int:
        now = time + self._offset
        if self._last is None or now > self._last:
            return now
        moved = self._last + self._step - now
        self._findings.note(
            f"the clock goes back at {path.name}, from {(self._last - self._offset) / 1e9:.3f} s to "
            f"{time / 1e9:.3f} s: from there on {(self._offset + moved) / 1e9:.3f} s are added to what the "
            "files say"
        )
        self._offset += moved
        return self._last + self._step
