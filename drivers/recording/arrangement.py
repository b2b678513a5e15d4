"""The order in which frames of a recording are played, and the bursts that they make."""

from collections.abc import Callable, Sequence
from itertools import pairwise

from drivers.bursts import BurstCutter, is_another_scan
from drivers.calibration import Calibration
from drivers.recording.assembly import FrameEntry

CalibrationOf = Callable[[FrameEntry], Calibration | None]


def arranged(entries: Sequence[FrameEntry]) -> list[FrameEntry]:
    """Frames in file order, or by log time where that makes fewer bursts, or fewer restarts of the numbers.

    The file's order is that of the camera unless somebody sorted or merged it; log times are MCAP's own
    order, but a clock that was set makes them jump.
    """
    by_time = sorted(entries, key=lambda entry: (entry.log_time, entry.timestamp, entry.sequence))
    return min((list(entries), by_time), key=lambda order: (len(cut(order, None)), _restarts(order)))


def cut(
    entries: Sequence[FrameEntry], frames: int | None, calibration_of: CalibrationOf = lambda _: None
) -> list[list[FrameEntry]]:
    """The bursts of a row of frames; those without an id are cut every `frames` (None = not)."""
    cutter, bursts = BurstCutter(frames), list[list[FrameEntry]]()
    for entry in entries:
        if cutter.begins(entry.fields, entry.shape, calibration_of(entry)):
            bursts.append([])
        bursts[-1].append(entry)
    return bursts


def _restarts(entries: Sequence[FrameEntry]) -> int:
    return sum(after.sequence <= before.sequence for before, after in pairwise(entries))


def scans(bursts: Sequence[Sequence[FrameEntry]]) -> list[list[Sequence[FrameEntry]]]:
    """Bursts by the scan that they belong to."""
    found: list[list[Sequence[FrameEntry]]] = []
    for burst in bursts:
        if not found or is_another_scan(found[-1][-1][-1].fields, burst[0].fields):
            found.append([])
        found[-1].append(burst)
    return found


def indistinct(entries: Sequence[FrameEntry]) -> FrameEntry | None:
    """A frame that another follows with the same time and number: two recordings of one time were merged."""
    for one, other in pairwise(entries):
        if (one.timestamp, one.sequence) == (other.timestamp, other.sequence):
            return one
    return None
