"""Whether the images of a frame lie where they belong: rolled or swapped ones, where the data tell."""

import logging
from itertools import permutations

import numpy as np
from numpy.typing import NDArray

from drivers.errors import OperationError
from drivers.usb.profile import Plane

log = logging.getLogger(__name__)

CONTINUOUS, SEAM, LEAST_SEAM = 3.0, 8.0, 1024
"""Steps from row to row, in medians of the frame: at most so large where one image goes on, at least so large
(and so many counts) where another one begins."""

CLOSER = 3.0
"""How much closer to the last frame swapped images must be than these: two frames of one scene differ little,
distance and amplitude much."""

STRIDE = 4
"""Every fourth row and column is enough to tell images apart."""


class OrderCheck:
    """Compares each frame with itself and with the one before.

    Args:
        planes: names of the images, in order.
    """

    def __init__(self, planes: tuple[Plane, ...]) -> None:
        self._planes = planes
        self._last: NDArray[np.int32] | None = None
        self._has_warned = False

    def check(self, images: NDArray[np.uint16]) -> None:
        """Accept a frame, (planes, rows, columns).

        Raises:
            OperationError: its images are rolled against the frame's begin, or swapped against the last one.
        """
        if (row := rolled_at(images)) is not None:
            raise OperationError(
                f"rolled frame: each image goes on in the next and changes at row {row}: bytes were lost"
            )
        samples = images[:, ::STRIDE, ::STRIDE].astype(np.int32)
        if self._last is not None and (order := _swapped(self._last, samples)) is not None:
            found = ", ".join(self._planes[index] for index in order)
            raise OperationError(f"swapped images: expected {', '.join(self._planes)}, found {found}")
        self._last = samples
        self._compare_light(images)

    def _compare_light(self, images: NDArray[np.uint16]) -> None:
        """Modulated light is part of all light, so amplitude hardly exceeds intensity."""
        if "intensity" not in self._planes or self._has_warned:
            return
        amplitude, intensity = (images[self._planes.index(name)] for name in ("amplitude", "intensity"))
        if np.count_nonzero(amplitude > intensity) * 2 > amplitude.size:
            self._has_warned = True
            log.warning("the amplitude exceeds the intensity in most pixels: these two images may be swapped")


def rolled_at(images: NDArray[np.uint16]) -> int | None:
    """The row at which every image turns into the next one, where each also goes on beyond its own last row.

    None where the images begin and end where they should, or where the data do not tell.
    """
    planes, rows, columns = images.shape
    lines = images.reshape(planes * rows, columns).astype(np.int32)
    steps = np.append(np.abs(np.diff(lines, axis=0)).mean(axis=1), 0.0).reshape(planes, rows)
    typical = max(float(np.median(steps)), 1.0)
    if steps[:-1, -1].max() > CONTINUOUS * typical:
        return None
    seams = steps[:, :-1].min(axis=0)
    row = int(seams.argmax())
    return row if seams[row] >= max(SEAM * typical, LEAST_SEAM) else None


def _swapped(last: NDArray[np.int32], now: NDArray[np.int32]) -> tuple[int, ...] | None:
    """Which image of the last frame each of these is closest to, where that is clearly not its own."""
    apart = np.abs(last[:, None] - now[None]).mean(axis=(2, 3))
    straight = float(np.trace(apart))
    for order in permutations(range(len(now))):
        if sum(float(apart[was, place]) for place, was in enumerate(order)) * CLOSER < straight:
            return order
    return None
