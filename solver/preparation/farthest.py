"""What is too far to be measured: a code for pixels without a distance, which nobody masked, a broken frame.

Where fewer than three frames look, none can contradict it, and a map swings by thousands of times its scene.
"""

import numpy as np
from numpy.typing import NDArray

from solver.errors import FusionInputError
from solver.preparation import noise as noise_law

Image = NDArray[np.float32]

_TURNS = 3.0
"""Ambiguity ranges: some cameras' distances are unwrapped by a turn or two."""

_TIMES = 100.0
"""Of the median distance, where no range is known: from so far comes a ten-thousandth of the light."""


def find_farthest(distance: Image, ambiguity_range: float | None) -> float:
    """The distance beyond which samples (N, H, W) cannot lie; infinite where they tell of none."""
    if ambiguity_range is None:
        return _TIMES * noise_law.usual_distance(distance) or np.inf
    return _TURNS * ambiguity_range


def check_units(distance: Image, ambiguity_range: float | None) -> None:
    """Refuse samples (N, H, W) of another unit than the range.

    Raises:
        FusionInputError: most lie beyond what it can tell.
    """
    if ambiguity_range is None:
        return
    farthest = find_farthest(distance, ambiguity_range)
    beyond, valid = int(_beyond(distance, farthest).sum()), int(np.isfinite(distance).sum())
    if 2 * beyond > valid:
        raise FusionInputError(
            f"{beyond / valid:.0%} of the distances lie beyond {farthest:g}, {_TURNS:g} times the "
            "ambiguity_range; give both in the same unit, and mark invalid pixels with NaN"
        )


def without(distance: Image, farthest: float) -> tuple[Image, NDArray[np.int64]]:
    """Samples (n, H, W) with NaN in place of those too far, and how many these are in each frame.

    The same array where there are none.
    """
    beyond = _beyond(distance, farthest)
    counts = np.count_nonzero(beyond, axis=(1, 2))
    return np.where(beyond, np.float32(np.nan), distance) if counts.any() else distance, counts


def measured(frame: Image, ambiguity_range: float | None) -> Image:
    """The frame (H, W) without what is too far."""
    known, _ = without(frame[None], find_farthest(frame[None], ambiguity_range))
    first: Image = known[0]
    return first


def _beyond(distance: Image, farthest: float) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore", over="ignore"):
        return np.abs(distance) > np.float32(farthest)
