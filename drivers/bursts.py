"""What a burst is: where one ends and the next begins, and how many frames it should have."""

from collections.abc import Sequence
from typing import Any, Protocol

LONGEST_PAUSE = 15 * 60 * 10**9
"""ns between two frames of one burst, forwards or backwards: a scan may be paused for some minutes, two scans
in one file are further apart."""


class Numbered(Protocol):
    """What is said of a frame beside its images."""

    @property
    def timestamp(self) -> int: ...
    @property
    def sequence(self) -> int: ...
    @property
    def burst(self) -> int | None: ...
    @property
    def pose(self) -> int | None: ...
    @property
    def integration_time(self) -> float | None: ...
    @property
    def modulation_frequency(self) -> float | None: ...
    @property
    def ambiguity_range(self) -> float | None: ...
    @property
    def has_amplitude(self) -> bool: ...


class BurstCutter:
    """Cuts a row of frames into bursts.

    Frames of one burst id belong together. A burst ends nevertheless where the numbers or the poses start
    again, at another time (`LONGEST_PAUSE`), and where size, calibration or modulation change: those are two
    scans in one row, or a burst that was given up and taken anew. Frames without an id are cut by number.

    Args:
        frames: frames of a burst that has no id; None = such frames are not cut by number.
    """

    def __init__(self, frames: int | None) -> None:
        if frames is not None and frames < 1:
            raise ValueError(f"frames: expected at least 1, got {frames}")
        self._frames = frames
        self._last: Numbered | None = None
        self._with: tuple[tuple[int, int], Any] | None = None
        self._length = 0

    def begins(self, frame: Numbered, shape: tuple[int, int], calibration: Any = None) -> bool:
        """Whether the next frame of the row begins a burst; the first one does."""
        last, before = self._last, self._with
        self._last, self._with = frame, (shape, calibration)
        is_new = last is None or before != self._with or not _follows(last, frame) or self._is_full(frame)
        self._length = 1 if is_new else self._length + 1
        return is_new

    def _is_full(self, frame: Numbered) -> bool:
        return frame.burst is None and self._frames is not None and self._length >= self._frames


class ExpectedFrames:
    """How many frames each burst of a row should have.

    Args:
        frames: frames of a burst that has no id.
        planned: what the recording says; None = as many as the fullest burst of the same scan has had so
            far, or as its poses tell.
    """

    def __init__(self, frames: int, planned: int | None = None) -> None:
        self._frames, self._planned = frames, planned
        self._last: Numbered | None = None
        self._fullest = 0

    def of(self, burst: Sequence[Numbered]) -> int:
        """For the next burst of the row, which has at least one frame."""
        first = burst[0]
        if first.burst is None:
            return self._frames
        if self._last is not None and is_another_scan(self._last, first):
            self._fullest = 0
        self._last = burst[-1]
        self._fullest = max(self._fullest, len(burst), 1 + max(frame.pose or 0 for frame in burst))
        return self._planned or self._fullest


def _follows(last: Numbered, frame: Numbered) -> bool:
    """Whether a frame may belong to the burst of the one before it."""
    return (
        frame.burst == last.burst
        and frame.sequence > last.sequence
        and not (frame.pose is not None and last.pose is not None and frame.pose <= last.pose)
        and abs(frame.timestamp - last.timestamp) <= LONGEST_PAUSE
        and frame.modulation_frequency == last.modulation_frequency
        and frame.ambiguity_range == last.ambiguity_range
        and frame.has_amplitude == last.has_amplitude
        and (frame.integration_time is None) == (last.integration_time is None)
    )


def is_another_scan(last: Numbered, first: Numbered) -> bool:
    """Whether a burst that begins with `first` is not of the scan of which `last` was the last frame."""
    return (
        last.burst is None
        or first.burst is None
        or first.burst <= last.burst
        or first.sequence <= last.sequence
    )
