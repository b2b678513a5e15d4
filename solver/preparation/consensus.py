"""Which samples the other frames contradict: somebody walks by, stray light hits a pixel, the phase wraps.

All frames see one scene, so a sample lies within what the frames say of the nearest nine pixels: the least
and the greatest of their medians over the frames. One that lies far outside is left out. Deconvolution would
otherwise fit it by swings many times as large. Where frames look but too few see anything, something dark may
be mixed into the samples around, and all agree; where too few look, the pixels beside tell.

    |y − (low + high) / 2| > (high − low) + 5 σ

Medians hold for as long as fewer than half of the frames disagree (Huber, "Robust Statistics", 1981); where
exactly half do, both sides are kept.
"""

import cv2
import numpy as np
from numpy.typing import NDArray

from solver.kernels import medians as kernels
from solver.runtime import team

Image = NDArray[np.float32]

MAJORITY = 3
"""Frames on a pixel of which two can outvote one."""

_SLACK = (1.0, 5.0, 1e-6)
"""Allowed: high − low from the middle, deviations, and rounding. Two depth maps and two recordings, at
several noise levels and from 3 frames up, have at most 28 samples in a burst beyond it, most of them on the
dark print; half as much beyond the bounds takes 20 true ones off the thin wedges."""

LOST = 12.0
"""A sample that deviates by over a twelfth of the ambiguity range may say anything: it has no vote."""

SURE = 0.5
"""Of the deviation from which a sample is lost: one in three thousand that get no light seems surer."""

_GAP = 5
"""Pixels across which samples left out are joined: at an edge behind somebody, too much is allowed."""

_SWING, _MIXED_SWING = (1.5, 3.0), (0.8, 3.0)
"""What a map may swing to beside edges: high − low from the middle, and deviations. Where samples average
distances, at most one fused pixel in five hundred lies beyond the first without wrong samples. Where they
average phasors, more explains what shares were not known: thin things need the second."""

BEYOND = 4
"""Pixels around the grid on which samples are judged as well, and which a map of `phasor` holds, so that what
looks there counts."""

_FEW = 500
"""One of so many samples of a frame may be judged anew without the frame being exchanged for it."""


class Consensus:
    """What frames say together, and which of their samples agree.

    Attributes:
        measured: (N, H, W) float32, NaN = invalid.
        agrees: (N, H, W).
        bounds: two of (H, W), the least and the greatest distance around; ∓∞ = not known.
    """

    def __init__(
        self, measured: Image, sigma: Image, positions: Image, ambiguity_range: float | None, wraps: bool
    ) -> None:
        """Judge all samples.

        Args:
            sigma: (N, H, W), one standard deviation of each.
            positions: (N, H, W, 2), where they look on the grid.
            wraps: whether whole ambiguity ranges do not matter.
        """
        shape = measured.shape
        self.measured, self.agrees = measured, np.empty(shape, np.bool_)
        self._sigma, self._positions = sigma, positions
        self._ambiguity = np.float32((ambiguity_range or 0.0) if wraps else 0.0)
        self._most = np.float32(ambiguity_range / LOST if ambiguity_range else np.finfo(np.float32).max)
        continued = shape[1] + 2 * BEYOND, shape[2] + 2 * BEYOND
        self._planes = np.empty((shape[0], *continued), np.float32)
        self._bounds = np.empty(continued, np.float32), np.empty(continued, np.float32)
        self.bounds = np.empty(shape[1:], np.float32), np.empty(shape[1:], np.float32)
        self._valid, self._against = np.zeros(len(measured), np.int64), np.zeros(len(measured), np.int64)
        self._align(slice(None))
        self._survey()
        self._judge(slice(None))

    def exchange(self, number: int, distance: Image) -> list[int]:
        """Judge a frame that has taken the place of another one, and all anew if any samples are in dispute.

        Args:
            distance: (N, H, W), `measured` or NaN where a sample is not used until now.

        Returns the other frames of which the verdict on more than a few samples is new.
        """
        one, few = slice(number, number + 1), distance[0].size // _FEW
        self._align(one)
        self._judge(one)
        if self._against.sum() <= few:
            return []
        self._survey()
        self._judge(slice(None))
        changes = np.empty(distance.shape[:2], np.int32)
        team.share(kernels.changes, self.measured, distance, self.agrees, changes)
        changes[number] = 0
        return [int(other) for other in np.flatnonzero(changes.sum(axis=1) > few)]

    def _align(self, frames: slice) -> None:
        samples = self.measured[frames], self._sigma[frames], self._most, self._positions[frames]
        team.share_frames(len(samples[0]), kernels.align, *samples, BEYOND, self._planes[frames])

    def _survey(self) -> None:
        low, high = self._bounds
        team.share(kernels.medians, self._planes, MAJORITY, low, high)
        around, unasked = np.ones((3, 3), np.uint8), low > high
        cv2.erode(low, around, dst=low)
        cv2.dilate(high, around, dst=high)
        low[unasked], high[unasked] = -np.inf, np.inf
        grid = np.s_[BEYOND : low.shape[0] - BEYOND, BEYOND : low.shape[1] - BEYOND]
        for bound, beyond in zip(self.bounds, (low, high), strict=True):
            bound[:] = beyond[grid]

    def _judge(self, frames: slice) -> None:
        agrees, measured = self.agrees[frames], self.measured[frames]
        against = np.empty(measured.shape[:2], np.int32)
        samples = measured, self._sigma[frames], self._positions[frames]
        slack = tuple(np.float32(part) for part in _SLACK)
        law = self._bounds, BEYOND, slack, self._ambiguity
        team.share_frames(len(measured), kernels.judge, *samples, *law, agrees, against)
        for number in np.flatnonzero(against.any(axis=1)):
            agrees[number] = ~_closed(~agrees[number])
        valid = np.isfinite(measured)
        self._valid[frames] = valid.sum(axis=(1, 2))
        self._against[frames] = (valid & ~agrees).sum(axis=(1, 2))

    def kept(self, frames: slice | int = slice(None)) -> Image:
        """The samples that agree, NaN in the place of the others."""
        return np.where(self.agrees[frames], self.measured[frames], np.float32(np.nan))

    def verdicts(self) -> tuple[int, int]:
        """How many of the valid samples the others contradict, and how many there are."""
        return int(self._against.sum()), int(self._valid.sum())

    def disputed(self) -> NDArray[np.float64]:
        """(N,): the part of each frame's valid samples that the others contradict."""
        return self._against / np.maximum(1, self._valid)

    def limit(self, distance: Image, deviation: float, mixed: bool) -> None:
        """Bring a map (βH, βW) that swings far beyond what the frames say back to where that begins.

        Args:
            deviation: of the usual sample.
            mixed: whether samples average phasors, not distances.
        """
        swing = _MIXED_SWING if mixed else _SWING
        near, far = self.bounds
        with np.errstate(invalid="ignore"):  # −∞ + ∞: no bounds
            middle, reach = 0.5 * (near + far), swing[0] * (far - near)
        reach += np.float32(swing[1] * deviation)
        factor = len(distance) // len(self.bounds[0])
        team.share(kernels.limit, distance, middle - reach, middle + reach, factor)


def _closed(apart: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """What samples that do not agree enclose belongs to the same thing before the scene."""
    window = np.ones((_GAP, _GAP), np.uint8)
    return np.asarray(cv2.morphologyEx(apart.view(np.uint8), cv2.MORPH_CLOSE, window) > 0)
