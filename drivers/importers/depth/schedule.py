"""Which images make frames, in which order, and at which times."""

from collections.abc import Sequence
from dataclasses import dataclass
from statistics import median

import numpy as np
from numpy.typing import NDArray

from drivers.importers.depth.survey import ImageTopic
from drivers.importers.exposure import Findings

_OTHER_CLOCK = 10 * 10**9
"""ns between stamp and log time from which the stamps are of another clock."""


@dataclass(frozen=True, slots=True)
class Slot:
    """A frame to be: keys of its images, its own time, and when to look up where the camera was; ns."""

    depth: int
    amplitude: int | None
    timestamp: int
    stamp: int


def schedule(depth: ImageTopic, amplitude: ImageTopic | None, findings: Findings) -> list[Slot]:
    """Slots in order of time; what is odd about the times is noted.

    Images are known by their key: stamp, or log time where that is 0. Of two with one key the second is left
    out. An amplitude image belongs to the depth image whose key is nearest, at most half a period away.
    """
    keys = _keys(depth, findings)
    offset = _offset(depth, findings)
    light = None if amplitude is None else np.array(sorted(_keys(amplitude, findings)))
    slots = []
    reach = _period(keys) / 2
    for key, stamp in sorted(keys.items()):
        found = None if light is None else _nearest(light, key, reach)
        if light is None or found is not None:
            slots.append(Slot(key, found, max(0, key + (offset if stamp else 0)), stamp or key))
    if len(slots) < len(keys):
        findings.lose(f"{len(keys) - len(slots)} depth images have no amplitude image of their time")
    return slots


def image_key(stamp: int, log_time: int) -> int:
    """What an image is known by, ns."""
    return stamp or log_time


def _keys(topic: ImageTopic, findings: Findings) -> dict[int, int]:
    """Stamp of each image by its key."""
    keys: dict[int, int] = {}
    last, back = -1, 0
    for stamp, log_time in topic.times:
        key = image_key(stamp, log_time)
        back += key < last
        last = max(last, key)
        keys.setdefault(key, stamp)
    if back:
        findings.note(f"{topic.name}: {back} images out of order; frames are put in the order of their times")
    if len(keys) < len(topic.times):
        findings.lose(
            f"{topic.name}: {len(topic.times) - len(keys)} images have the time of another; that one is taken"
        )
    unstamped = sum(stamp == 0 for stamp, _ in topic.times)
    if unstamped:
        findings.note(
            f"{topic.name}: {unstamped} images are stamped 0; the times when they were logged are taken"
        )
    return keys


def _offset(topic: ImageTopic, findings: Findings) -> int:
    """ns to add to stamps of another clock, so that they are times since the epoch."""
    ahead = [log_time - stamp for stamp, log_time in topic.times if stamp]
    if not ahead or abs(median(ahead)) < _OTHER_CLOCK:
        return 0
    offset = int(median(ahead))
    findings.note(
        f"{topic.name}: the stamps are of another clock than the log; {offset / 1e9:.3f} s are added to them"
    )
    return offset


def _period(keys: Sequence[int] | dict[int, int]) -> float:
    steps = np.diff(sorted(keys))
    return float(np.median(steps)) if len(steps) else np.inf


def _nearest(times: NDArray[np.int64], key: int, reach: float) -> int | None:
    if not len(times):
        return None
    after = int(np.searchsorted(times, key))
    near = min((int(times[k]) for k in (after - 1, after) if 0 <= k < len(times)), key=lambda t: abs(t - key))
    return near if abs(near - key) <= reach else None
