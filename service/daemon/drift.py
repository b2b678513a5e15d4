"""How far the distance of what stands still has drifted since the start: cameras do so while they warm up."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from service.messages.map import FusedMap
from service.messages.status import Drift

_SAMPLES = 4096
"""Pixels of a map that are compared, about."""

_FEWEST = 100
_STATIC = 0.5
"""Share of them that must have kept their place among the others: else something else is in view now."""

_OUTSIDE = 3.0
"""Deviations beyond which a pixel has moved."""

_LOOSE = 5.0
"""Times the maps' own deviation that half of them may differ by: beyond, what is seen is something else."""

_ROUNDS = 4
"""What has moved to one side shifts the median until it is left out."""

_ANEW = 5
"""Maps in a row of something else after which what is in view then is compared with."""


@dataclass(frozen=True, slots=True)
class _Reference:
    distance: NDArray[np.float32]
    variance: NDArray[np.float32]
    timestamp: int
    subject: tuple[object, ...]


class DriftMeter:
    """Compares each map with the first of its kind (same size, method, pose and integration time).

    The drift is the median of what the pixels differ by; those that differ from it by more than three
    deviations have moved, and where most have, the scene is another one.
    """

    def __init__(self) -> None:
        self._reference: _Reference | None = None
        self._others = 0
        self.latest: Drift | None = None
        """Of the last map that could be compared."""

    def note(self, fused: FusedMap) -> None:
        """Compare a map."""
        seen = _seen(fused)
        reference = self._reference
        if reference is None or reference.subject != seen.subject:
            self._begin(seen)
            return
        found = _compared(reference, seen)
        if found is not None:
            self.latest, self._others = found, 0
            return
        self._others += 1
        if self._others >= _ANEW:
            self._begin(seen)

    def _begin(self, seen: _Reference) -> None:
        self._reference, self._others, self.latest = seen, 0, None


def _seen(fused: FusedMap) -> _Reference:
    step = max(1, round((fused.distance.size / _SAMPLES) ** 0.5))
    frame, report = fused.frame, fused.report
    pose = (round(frame.pan, 3), round(frame.tilt, 3))
    subject = (fused.distance.shape, report.method, pose, frame.integration_time, frame.modulation_frequency)
    distance, deviation = (image[::step, ::step].copy() for image in (fused.distance, fused.deviation))
    return _Reference(distance, deviation**2, frame.timestamp, subject)


def _compared(reference: _Reference, seen: _Reference) -> Drift | None:
    """None where they do not show the same."""
    change = (seen.distance - reference.distance).ravel()
    deviation = np.sqrt(seen.variance + reference.variance).ravel()
    known = np.isfinite(change) & np.isfinite(deviation)
    change, deviation = change[known], deviation[known]
    if len(change) < _FEWEST:
        return None
    still = np.ones(len(change), dtype=bool)
    for _ in range(_ROUNDS):
        drift = float(np.median(change[still]))
        off = np.abs(change - drift)
        spread = 1.4826 * float(np.median(off[still]))
        # Edges come out differently from map to map, beyond what the map itself knows of.
        still = off <= _OUTSIDE * np.maximum(deviation, spread)
        if still.mean() < _STATIC or spread > _LOOSE * float(np.median(deviation)):
            return None
    return Drift(
        distance=drift,
        deviation=1.2533 * spread / float(np.sqrt(still.sum())),
        static=float(still.mean()),
        seconds=(seen.timestamp - reference.timestamp) * 1e-9,
    )
